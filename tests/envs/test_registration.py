"""Tests of the registered ids: every way to make them, and the checks of others and our own."""

import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box, Dict
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordEpisodeStatistics
from stable_baselines3.common.env_checker import check_env as sb3_check_env

from sb3_bruno_envs import (
    CARTPOLE_TASKS,
    CHEETAH_PARAMS_TASKS,
    CHEETAH_VEL_TASKS,
    POINT_DIR_TASKS,
    TaskSampler,
    check_meta_env,
)
from sb3_bruno_envs.registration import FAMILIES
from support.random_play import rewards

STEPS = {  # per episode
    "CheetahDir-v0": 200,
    "CheetahVel-v0": 200,
    "CartpoleSwingUp-v0": 200,
    "CheetahGravity-v0": 200,
    "CheetahParams-v0": 200,
    "AntDir-v0": 200,
    "AntDir2D-v0": 200,
    "AntGoal-v0": 200,
    "HopperParams-v0": 200,
    "WalkerParams-v0": 200,
    "HumanoidDir-v0": 200,
    "PointDir-v0": 30,
    "PointGoal-v0": 50,
    "PointRotation-v0": 50,
    "SparsePointGoal-v0": 60,
    "Wind-v0": 75,
}
TRIALS = ["SparsePointGoal-v0"]  # which end by themselves, after several inner episodes
FALLING = ["AntDir-v0", "AntDir2D-v0", "HopperParams-v0", "WalkerParams-v0", "HumanoidDir-v0"]  # which ends an episode
OBSERVE = ["transition", "task", "plain"]

family = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.mujoco] * (".mujoco." in place)) for name, place in FAMILIES.items()]
)
observed = pytest.mark.parametrize("observe", OBSERVE)


def make(name, **kwargs):
    return gym.make(f"sb3_bruno_envs:{name}", **kwargs)


def test_the_length_of_every_familys_episodes_is_known_here():
    assert set(STEPS) == set(FAMILIES)


@family
def test_the_spec_becomes_json_and_comes_back(name):
    spec = gym.spec(name)
    assert spec.entry_point == FAMILIES[name]
    assert spec.entry_point.startswith("sb3_bruno_envs.")
    again = EnvSpec.from_json(spec.to_json())
    assert again == spec
    assert rewards(gym.make(again)) == rewards(make(name))


@family
@observed
@pytest.mark.filterwarnings("ignore::UserWarning")  # of infinite bounds, and of wrappers
def test_gymnasiums_check_passes(name, observe):
    check_env(make(name, observe=observe).unwrapped, skip_render_check=True)
    check_env(make(name, observe=observe, disable_env_checker=True), skip_render_check=True)


@family
@observed
def test_sb3s_check_passes(name, observe):
    sb3_check_env(make(name, observe=observe), skip_render_check=True)


@family
@pytest.mark.parametrize(("split", "draw"), [("train", "random"), ("test", "cycle"), ("train", "fixed")])
def test_our_own_check_passes(name, split, draw):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_meta_env(make(name, split=split, draw=draw))


@family
def test_episodes_have_the_registered_length_or_the_one_asked_for(name):
    if name != "CartpoleSwingUp-v0":  # random actions leave its track; its own tests steer
        kwargs = {"terminate_when_unhealthy": False} if name in FALLING else {}
        assert len(rewards(make(name, **kwargs))) == STEPS[name]
        assert len(rewards(make(name, max_episode_steps=7, **kwargs))) == 7
        longest = STEPS[name] if name in TRIALS else 300
        assert len(rewards(make(name, max_episode_steps=300, **kwargs))) == longest


@pytest.mark.parametrize("name", TRIALS)
def test_a_trial_has_as_many_episodes_as_asked_for(name):
    env = make(name, n_episodes=5)
    env.reset(seed=0)
    infos = [env.step(env.action_space.sample())[4] for _ in range(100)]
    assert [info["episode_index"] for info in infos] == [step // 20 for step in range(100)]
    assert len(rewards(gym.make(env.spec))) == 100
    with pytest.raises(ValueError, match="n_episodes=0 is not a positive integer"):
        make(name, n_episodes=0)


@family
@observed
@pytest.mark.parametrize(
    "kwargs",
    [
        {},
        {"split": "test", "draw": "cycle", "max_episode_steps": 7},
        {"render_mode": "rgb_array_list"},
    ],
)
def test_an_environment_is_rebuilt_from_its_spec(name, observe, kwargs):
    env = RecordEpisodeStatistics(make(name, observe=observe, **kwargs))
    again = gym.make(env.spec)
    assert str(again) == str(env)  # the same wrappers, each once
    assert again.observation_space == env.observation_space
    assert again.spec == env.spec


def test_given_tasks_survive_the_rebuilding_too():
    env = make("PointDir-v0", tasks=np.float32([[0.0, 1.0], [0.6, 0.8]]), draw="cycle")
    again = gym.make(env.spec)
    for expected in ([0.0, 1.0], [0.6, 0.8]):
        np.testing.assert_array_equal(env.reset()[1]["task"], np.float32(expected))
        np.testing.assert_array_equal(again.reset()[1]["task"], np.float32(expected))
    assert rewards(again) == rewards(env)


@family
def test_observe_decides_what_the_agent_sees(name):
    transition, task, plain = (make(name, observe=observe) for observe in OBSERVE)
    assert isinstance(transition.observation_space, Dict)
    dim = plain.observation_space.shape[0]
    assert transition.observation_space["observation"].shape == (dim,)
    task_dim = plain.get_wrapper_attr("task_space").shape[0]
    assert task.observation_space.shape == (dim + task_dim,)
    assert rewards(transition) == rewards(task) == rewards(plain)
    assert "task" in plain.reset()[1]


@pytest.mark.mujoco
@pytest.mark.parametrize(
    ("name", "tasks"),
    [
        ("CheetahVel-v0", CHEETAH_VEL_TASKS),
        ("CartpoleSwingUp-v0", CARTPOLE_TASKS),
        ("CheetahParams-v0", CHEETAH_PARAMS_TASKS),
    ],
)
def test_the_splits_hold_different_tasks(name, tasks):
    env = make(name, split="test", draw="cycle")
    drawn = np.stack([env.reset()[1]["task"] for _ in tasks.tasks("test")])
    np.testing.assert_array_equal(drawn, tasks.tasks("test"))


@pytest.mark.mujoco
def test_a_hidden_body_reaches_the_simulation():
    heavy, light = (make("CheetahParams-v0", tasks=[[mass, 1.0, 1.0, 1.0]]) for mass in (2.0, 0.5))
    for env, mass in ((heavy, 28.0), (light, 7.0)):
        env.reset(seed=0)
        assert env.unwrapped.model.body_mass.sum() == pytest.approx(mass)  # kg
    short = make("CartpoleSwingUp-v0", tasks=[[2.0, 0.25]])
    short.reset(seed=0)
    assert (short.unwrapped.mass, short.unwrapped.length) == (2.0, 0.25)


def test_the_task_space_does_not_depend_on_the_tasks():
    spaces = [
        make("CheetahVel-v0", **kwargs).get_wrapper_attr("task_space")
        for kwargs in ({}, {"split": "test"}, {"tasks": [[1.0]]}, {"tasks": lambda rng: rng.uniform(0, 2, 1)})
    ]
    assert spaces == [Box(0.0, 3.0, (1,))] * 4


def test_endless_tasks_and_a_wider_space():
    fast = TaskSampler(lambda rng: rng.uniform(4.0, 5.0, 1), Box(0.0, 5.0, (1,)))
    env = make("CheetahVel-v0", tasks=fast, task_space=Box(0.0, 5.0, (1,)))
    assert 4.0 <= env.reset()[1]["task"][0] <= 5.0
    with pytest.raises(ValueError, match="widen task_space"):
        make("CheetahVel-v0", tasks=[[4.0]])


def test_arguments_reach_the_environment():
    assert make("CheetahDir-v0", ctrl_cost_weight=0.5).unwrapped._ctrl_cost_weight == 0.5


@pytest.mark.parametrize("kwargs", [{"split": "valid"}, {"draw": "sorted"}, {"observe": "all"}])
def test_unknown_choices_are_refused(kwargs):
    with pytest.raises(ValueError, match="is unknown: use"):
        make("PointDir-v0", **kwargs)


def test_an_unknown_argument_is_refused():
    with pytest.raises(TypeError, match="gravity"):
        make("PointDir-v0", gravity=9.81)


def test_many_environments_in_one_process_have_their_own_tasks():
    venv = gym.make_vec("sb3_bruno_envs:PointDir-v0", num_envs=4, vectorization_mode="sync")
    _, info = venv.reset(seed=0)
    assert info["task"].shape == (4, 2)
    assert len(np.unique(info["task"], axis=0)) > 1
    rows = POINT_DIR_TASKS.tasks()[info["task_index"]]
    np.testing.assert_array_equal(rows, info["task"])


def test_meta_world_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "metaworld", None)
    monkeypatch.delitem(sys.modules, "sb3_bruno_envs.metaworld", raising=False)
    with pytest.raises(ModuleNotFoundError, match=r"metaworld is not installed: pip install 'sb3_bruno\[metaworld\]'"):
        gym.make("sb3_bruno_envs.metaworld:ML1Reach-v0")
