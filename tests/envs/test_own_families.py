"""Families of somebody's own are registered as ours are."""

import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from sb3_bruno_envs import POINT_DIR_TASKS, Family, PointDirEnv, check_meta_env, register_family
from support.random_play import rewards

MY_FAMILY = """
import gymnasium as gym
import numpy as np
from sb3_bruno_envs import Family


class StayEnv(gym.Env):
    metadata = {"render_modes": ["ansi"]}
    observation_space = gym.spaces.Box(-1.0, 1.0, (1,))
    action_space = gym.spaces.Box(-1.0, 1.0, (1,))

    def __init__(self, render_mode=None, cost=1.0):
        self.render_mode = render_mode
        self.cost = cost

    def set_task(self, task):
        self.place = task[0]

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def step(self, action):
        return np.float32(action), -self.cost * float(abs(action[0] - self.place)), False, False, {}


STAY = Family(StayEnv, [[-0.5], [0.5]], max_episode_steps=4)
"""


@pytest.fixture
def my_package(tmp_path, monkeypatch):
    """A stranger's package with one family, whose import registers it."""
    folder = tmp_path / "my_envs"
    folder.mkdir()
    (folder / "stay.py").write_text(MY_FAMILY)
    line = "register_family('Stay-v0', 'my_envs.stay:STAY')"
    (folder / "__init__.py").write_text(f"from sb3_bruno_envs import register_family\n{line}\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield
    del gym.registry["Stay-v0"], sys.modules["my_envs"], sys.modules["my_envs.stay"]


def test_a_package_of_ones_own_adds_a_family_in_one_file(my_package):
    env = gym.make("my_envs:Stay-v0", draw="cycle", cost=2.0)
    check_meta_env(env)
    env.reset(seed=0)
    assert [env.step(np.zeros(1))[1:4] for _ in range(4)] == [*[(-1.0, False, False)] * 3, (-1.0, False, True)]
    assert EnvSpec.from_json(gym.spec("Stay-v0").to_json()) == gym.spec("Stay-v0")
    with pytest.warns(UserWarning, match=r"render_mode='human' that is not in .*\['ansi'\]"):
        gym.make("Stay-v0", render_mode="human")


def test_a_family_without_a_place_can_be_registered_too():
    register_family("Here-v0", Family(PointDirEnv, POINT_DIR_TASKS, max_episode_steps=7))
    try:
        env = gym.make("Here-v0")
        assert len(rewards(env)) == 7
        assert rewards(gym.make(env.spec)) == rewards(env)
        assert gym.make_vec("Here-v0", num_envs=2).reset(seed=0)[1]["task"].shape == (2, 2)
    finally:
        del gym.registry["Here-v0"]


@pytest.mark.parametrize(
    "place", ["sb3_bruno_envs.classic.point_dir:PointDirEnv", "sb3_bruno_envs.classic.point_dir", PointDirEnv, 3]
)
def test_what_is_no_family_is_refused(place):
    with pytest.raises(ValueError, match=r"family=.* is .*: give a Family, or its place as 'module:NAME'"):
        register_family("Wrong-v0", place)
    assert "Wrong-v0" not in gym.registry
