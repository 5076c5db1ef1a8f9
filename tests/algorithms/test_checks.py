"""What cannot work is refused at construction, or at the first reset, each time with what to do."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from stable_baselines3 import HerReplayBuffer
from stable_baselines3.common.torch_layers import CombinedExtractor
from stable_baselines3.sac.policies import SACPolicy

from sb3_bruno import BrunoSAC
from sb3_bruno_envs import MetaTask, TransitionObservation

POINT = "sb3_bruno_envs:PointDir-v0"


def pendulum():
    return TransitionObservation(MetaTask(gym.make("Pendulum-v1")))


class WithoutTask(gym.Wrapper):
    """Hides the task from the infos."""

    def reset(self, **kwargs):
        observation, info = self.env.reset(**kwargs)
        return observation, {key: value for key, value in info.items() if key != "task"}


class Images(gym.Env):
    """Observations are pictures."""

    observation_space = spaces.Dict(
        {
            "observation": spaces.Box(0, 255, (36, 36, 3), np.uint8),
            "action": spaces.Box(-1, 1, (1,)),
            "reward": spaces.Box(-np.inf, np.inf, (1,)),
            "episode_start": spaces.Box(0, 1, (1,)),
        }
    )
    action_space = spaces.Box(-1, 1, (1,))
    task_space = spaces.Box(-1, 1, (1,))
    render_mode = None


@pytest.mark.parametrize(
    ("settings", "remedy"),
    [
        ({"n_steps": 3}, "n_steps=1"),
        ({"replay_buffer_class": HerReplayBuffer}, "subclass `TaskReplayBuffer`"),
        ({"optimize_memory_usage": True}, "buffer_size"),
        ({"policy": "CnnPolicy"}, "observation wrapper"),
        ({"policy": SACPolicy}, "subclass"),
        ({"policy_kwargs": {"features_extractor_class": CombinedExtractor}}, "observation wrapper"),
        ({"encoder_batch_size": 0}, "at least 1"),
        ({"encoder_update_ratio": -0.5}, "not be negative"),
        ({"critic_input": "reward"}, "'task', 'belief' or 'both'"),
        ({"encoder_kwargs": {"modelled": "actions"}}, "'rewards', 'next_observations', 'both'"),
        ({"replay_buffer_kwargs": {"context": "last"}}, "'iid', 'recent' or 'episode'"),
        ({"policy_kwargs": {"encoder_kwargs": {}}}, "encoder_kwargs=..."),
    ],
)
def test_settings_that_cannot_work(settings, remedy):
    settings = {"policy": "MlpPolicy", "env": POINT, **settings}
    with pytest.raises(ValueError, match=remedy):
        BrunoSAC(**settings)


@pytest.mark.parametrize(
    ("env", "remedy"),
    [
        (lambda: gym.make("Pendulum-v1"), "TransitionObservation"),
        (lambda: MetaTask(gym.make("Pendulum-v1")), "TransitionObservation"),
        (lambda: TransitionObservation(gym.make("Pendulum-v1")), "MetaTask"),
        (Images, "Images are not supported"),
    ],
)
def test_envs_that_cannot_work(env, remedy):
    with pytest.raises(ValueError, match=remedy):
        BrunoSAC("MlpPolicy", env())


def test_a_missing_task_is_named_at_the_first_reset_before_any_step():
    model = BrunoSAC("MlpPolicy", WithoutTask(pendulum()))
    with pytest.raises(ValueError, match='reset info has no "task"'):
        model.learn(10)
    assert model.num_timesteps == 0


def test_another_task_space_is_refused_by_set_env_and_load(tmp_path):
    model = BrunoSAC("MlpPolicy", pendulum())
    model.save(tmp_path / "model")
    other = TransitionObservation(MetaTask(gym.make("Pendulum-v1"), lambda env, task: None, tasks=[[0, 1], [1, 0]]))
    with pytest.raises(ValueError, match="task_space"):
        model.set_env(other)
    with pytest.raises(ValueError, match="task_space"):
        BrunoSAC.load(tmp_path / "model", other)


def test_other_bounds_of_the_task_space_are_a_warning():
    model = BrunoSAC("MlpPolicy", pendulum())
    wider = TransitionObservation(MetaTask(gym.make("Pendulum-v1"), lambda env, task: None, tasks=[[-1], [1]]))
    with pytest.warns(UserWarning, match="other bounds"):
        model.set_env(wider)
