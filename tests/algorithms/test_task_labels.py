"""What an agent calls tasks, it learns from its environments, and says when these change."""

import warnings
from functools import partial

import gymnasium as gym
import pytest
from gymnasium.spaces import Box
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

from sb3_bruno import BrunoSAC
from sb3_bruno.algorithms.task_estimate import few_tasks, read_labels
from sb3_bruno.export import load_agent, save_agent
from sb3_bruno_envs import MetaTask, PointDirEnv, TaskSampler, TransitionObservation
from support.tiny_models import POINT, TINY, TINY_ENCODER


def bruno(env, **options):
    return BrunoSAC("MlpPolicy", env, **{**TINY, **TINY_ENCODER["bruno"], **options})


def pendulum(tasks, **kwargs):
    def set_gravity(env, task):
        env.g = float(task[0])

    def make():
        return TransitionObservation(
            MetaTask(gym.make("Pendulum-v1", max_episode_steps=20), set_gravity, tasks, **kwargs)
        )

    return make


@pytest.mark.parametrize("endless", [False, True])
def test_envs_of_other_processes_may_hold_functions(endless):
    tasks = TaskSampler(lambda rng: rng.uniform(5, 15, size=1), Box(5, 15, (1,))) if endless else [[8.0], [12.0]]
    env = SubprocVecEnv([pendulum(tasks)] * 2, start_method="fork")
    model = bruno(env, learning_starts=42).learn(50)
    assert (model.task_labels.tasks == ()) == endless
    env.close()


def test_the_tasks_are_those_of_all_envs():
    sets = [[[1.0, 0.0], [-1.0, 0.0]], [[0.0, 1.0], [0.0, -1.0]]]
    makers = [partial(gym.make, POINT, tasks=tasks, task_space=Box(-1, 1, (2,))) for tasks in sets]
    model = bruno(DummyVecEnv(makers))
    assert model.task_labels.tasks == ("right", "left", "up", "down")


def test_other_tasks_are_warned_of_and_learned_anew():
    model = bruno(POINT, learning_starts=52).learn(60)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.set_env(make_vec_env(POINT, 1, env_kwargs={"tasks": [[1.0, 0.0]]}))
    with pytest.warns(UserWarning, match="fit_readout"):
        model.set_env(make_vec_env(POINT, 1, env_kwargs={"tasks": [[0.0, 1.0], [0.0, -1.0]]}))
    model.learn(40, reset_num_timesteps=False)
    model.fit_readout(2)
    assert model.task_labels.tasks == ("up", "down")
    assert model.task_estimate(model.predict(model.get_env().reset())[1]).probabilities.shape == (1, 2)


def test_an_agent_that_is_loaded_with_other_tasks_is_warned_of_once(tmp_path):
    def point(tasks):
        return make_vec_env(POINT, 1, env_kwargs={"tasks": tasks})

    model = bruno(POINT)
    model.save(tmp_path / "model.zip")
    save_agent(model, tmp_path / "model.agent")
    for load, name in ((BrunoSAC.load, "model.zip"), (load_agent, "model.agent")):
        with pytest.warns(UserWarning, match="fit_readout") as warned:
            load(tmp_path / name, point([[0.0, 1.0], [0.0, -1.0]]))
        assert len(warned) == 1
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for env in (None, point([[1.0, 0.0]])):
                load(tmp_path / name, env)


def test_a_name_stays_on_its_line():
    def name_task(task):
        return "left\n turn" if task[0] < 0 else "r" * 300

    env = MetaTask(PointDirEnv(), PointDirEnv.set_task, [[-1.0, 0.0], [1.0, 0.0]], name_task=name_task)
    model = bruno(TransitionObservation(env))
    assert model.task_labels.tasks == ("left turn", "r" * 100)


def labels_of(tasks, name_task=None):
    env = DummyVecEnv([pendulum(tasks, name_task=name_task)])
    return read_labels(env, few_tasks(env)).tasks


def test_tasks_that_share_a_name_are_told_apart_as_in_logs():
    near = [[9.79], [9.81], [12.0]]
    assert labels_of(near, lambda task: f"{task[0]:.1f}") == ("9.8 (9.79)", "9.8 (9.81)", "12.0")
    assert labels_of([[1.0], [1.0000001]], lambda task: "a") == ("a (1) #0", "a (1) #1")
    assert labels_of([[1.0], [1.0000001]]) == ("(1 #0)", "(1 #1)")
    assert labels_of([[1.0, 0.0], [0.0, 1.0]]) == ("(1, 0)", "(0, 1)")
    longer = labels_of(near, lambda task: "r" * 150 + str(task[0]))  # they differ after what is kept
    assert len(set(longer)) == 3 and all(len(label) < 120 for label in longer)


def test_the_longest_names_are_saved_and_loaded(tmp_path):
    tasks = [[-1.23456e8 - i * 1e3] * 8 for i in range(3)]
    env = DummyVecEnv([pendulum(tasks, name_task=lambda task: "r" * 150)])
    model = bruno(env)
    assert len(set(model.task_labels.tasks)) == 3
    save_agent(model, tmp_path / "model.agent")
    assert load_agent(tmp_path / "model.agent", device="cpu").task_labels == model.task_labels
