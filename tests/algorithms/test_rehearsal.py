"""Tests of the rehearsal before training: it warns of tasks that are not in force, and touches nothing."""

import random
import warnings
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium.envs.classic_control import PendulumEnv
from gymnasium.utils import EzPickle
from gymnasium.wrappers import TimeLimit
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_bruno import BrunoSAC
from sb3_bruno.algorithms.rehearsal import warn_of_task_without_effect
from sb3_bruno_envs import MetaTask, TransitionObservation
from sb3_bruno_envs.registration import FAMILIES

GRAVITIES = [[5.0], [10.0], [15.0]]


def set_gravity(env, task):
    env.g = float(task[0])


def do_nothing(env, task):
    pass


def misspell(env, task):
    env.gravty = float(task[0])


def scale_gravity(env, task):
    env.g *= float(task[0]) / 8.0


def meta(apply_task=set_gravity, env=None, **kwargs):
    env = TimeLimit(PendulumEnv() if env is None else env, 30)
    return TransitionObservation(MetaTask(env, apply_task, GRAVITIES, **kwargs))


def found(env):
    """The warnings before training."""
    vec_env = DummyVecEnv([lambda: env]) if isinstance(env, gym.Env) else env
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_task_without_effect(vec_env)
    return [str(warning.message) for warning in caught]


class Overwriting(gym.Wrapper):
    """Writes the parameter in its reset."""

    def reset(self, **kwargs):
        self.env.unwrapped.g = 10.0
        return self.env.reset(**kwargs)


@pytest.mark.parametrize("env_id", FAMILIES)
def test_our_own_environments_are_in_force(env_id, tmp_path):
    kwargs = {"n_envs": 1, "monitor_dir": str(tmp_path), "monitor_kwargs": {"allow_early_resets": False}}
    assert found(make_vec_env(f"sb3_bruno_envs:{env_id}", **kwargs)) == []
    assert (
        found(make_vec_env(f"sb3_bruno_envs:{env_id}", **kwargs, env_kwargs={"split": "test", "draw": "cycle"})) == []
    )


@pytest.mark.parametrize(
    ("apply_task", "env", "message"),
    [
        (do_nothing, PendulumEnv(), "made no difference"),
        (misspell, PendulumEnv(), "made no difference"),
        (set_gravity, Overwriting(PendulumEnv()), "when='after_reset'"),
        (scale_gravity, PendulumEnv(), "gave another episode when it came again"),
        pytest.param(do_nothing, "Hopper-v5", "made no difference", marks=pytest.mark.mujoco),
    ],
)
def test_learn_warns_of_tasks_that_are_not_in_force(apply_task, env, message):
    env = gym.make(env) if isinstance(env, str) else env
    model = BrunoSAC("MlpPolicy", meta(apply_task, env), learning_starts=100, seed=0)
    with pytest.warns(UserWarning, match=rf"The tasks of .* are not in force: .*{message}"):
        model.learn(2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.learn(2, reset_num_timesteps=False)


def test_the_environment_and_its_records_stay_as_they_were(tmp_path):
    def episode(rehearse):
        """All that training would see, and the Monitor's file."""
        folder = tmp_path / str(rehearse)
        vec_env = make_vec_env(meta, 2, seed=3, monitor_dir=str(folder))
        random.seed(0), np.random.seed(0), th.manual_seed(0)  # noqa: NPY002
        if rehearse:
            assert found(vec_env) == []
        seen = [vec_env.reset()]
        vec_env.action_space.seed(0)
        for _ in range(70):
            seen.extend(vec_env.step(np.stack([vec_env.action_space.sample()] * 2))[:2])
        files = [line.split(",")[:2] for path in sorted(folder.iterdir()) for line in path.read_text().split("\n")[1:]]
        globals_ = [random.random(), np.random.random(), th.rand(1).item()]  # noqa: NPY002
        return repr(seen), vec_env.envs[0].get_wrapper_attr("total_steps"), files, globals_

    assert episode(True) == episode(False)


def test_equal_seeds_learn_equally_whether_the_tasks_are_rehearsed_or_not(monkeypatch):
    def weights():
        model = BrunoSAC("MlpPolicy", meta(), learning_starts=20, seed=0).learn(25)
        return th.cat([parameter.flatten() for parameter in model.policy.parameters()])

    rehearsed = weights()
    monkeypatch.setattr("sb3_bruno.algorithms.task_inference.warn_of_task_without_effect", lambda env: None)
    assert th.equal(rehearsed, weights())


class Closing(PendulumEnv):
    """Closes something when it is collected, as a client of a simulator does."""

    closed = 0

    def __del__(self):
        Closing.closed += 1


class Connecting(PendulumEnv, EzPickle):
    """Opens something when it is built."""

    built = 0

    def __init__(self):
        EzPickle.__init__(self)
        super().__init__()
        Connecting.built += 1


def holding_file(tmp_path):
    env = PendulumEnv()
    env.log = open(tmp_path / "log", "w")  # noqa: SIM115
    return env


def holding_data():
    env = PendulumEnv()
    env.data = np.zeros(60_000_000, np.uint8)
    return env


def test_what_a_copy_might_touch_is_not_copied(tmp_path):
    closing, connecting = Closing(), Connecting()
    Connecting.built = 0
    kept = gym.Wrapper(PendulumEnv())
    untouchable = {
        "a finaliser": meta(do_nothing, closing),
        "a constructor": meta(do_nothing, connecting),
        "a file": meta(do_nothing, holding_file(tmp_path)),
        "a data set": meta(do_nothing, holding_data()),
        "a window": meta(do_nothing, PendulumEnv(render_mode="human")),
        "a closure": meta(lambda env, task: setattr(kept.unwrapped, "g", task[0]), kept),
    }
    assert {name: found(env) for name, env in untouchable.items()} == {name: [] for name in untouchable}
    assert (Closing.closed, Connecting.built, kept.unwrapped.g) == (0, 0, 10.0)


def test_a_video_is_not_written(tmp_path):
    env = gym.wrappers.RecordVideo(gym.make("Pendulum-v1", render_mode="rgb_array"), str(tmp_path / "videos"))
    assert found(meta(do_nothing, env)) == []
    assert list((tmp_path / "videos").iterdir()) == []


def test_an_environment_that_is_copied_by_its_gymnasium_class_is_rehearsed():
    assert found(meta(do_nothing, gym.make("Pendulum-v1", render_mode="rgb_array"))) != []


def test_other_processes_and_environments_without_meta_task_are_let_be():
    assert found(SimpleNamespace(unwrapped="envs in other processes")) == []
    assert found(PendulumEnv()) == []


def test_an_environment_that_raises_is_left_to_the_training():
    def fail(env, task):
        raise RuntimeError("battery empty")

    assert found(meta(fail)) == []
