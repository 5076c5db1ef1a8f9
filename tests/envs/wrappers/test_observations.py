"""Tests of the observation wrappers: what they show, on which scale, and what they refuse."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Sequence, Tuple, flatten
from gymnasium.wrappers import FlattenObservation, TimeLimit
from hypothesis import given
from hypothesis import strategies as st
from stable_baselines3.common.env_checker import check_env as sb3_check_env

from sb3_bruno_envs import MetaTask, PointDirEnv, TaskObservation, TransitionObservation, Trial


class Still(gym.Env):
    """Nothing moves: any spaces, the observation is zero, the reward the step's number."""

    def __init__(self, observations=None, actions=None):
        self.observation_space = Box(-1.0, 1.0, (2,)) if observations is None else observations
        self.action_space = Box(-1.0, 1.0, (2,)) if actions is None else actions
        self.steps = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self._zeros(), {}

    def step(self, action):
        self.steps += 1
        return self._zeros(), self.steps, False, False, {}

    def _zeros(self):
        return np.zeros(self.observation_space.shape, self.observation_space.dtype)


NESTED = Dict(
    {
        "velocity": Box(-2.0, 2.0, (2,), dtype=np.float64),
        "mode": Discrete(3, start=5),
        "arm": Dict({"joints": Box(0.0, np.inf, (2, 2)), "touch": MultiBinary(2)}),
        "pair": Tuple((MultiDiscrete([2, 3]), Box(-1, 1, (1,), dtype=np.int8))),
    }
)


class Sampling(Still):
    """Draws each observation from its space, and shows what it drew last."""

    def _zeros(self):
        self.drawn = self.observation_space.sample()
        return self.drawn


def set_gravity(pendulum, task):
    pendulum.g = float(task[0])


@pytest.fixture
def pendulum():
    return TransitionObservation(MetaTask(gym.make("Pendulum-v1"), set_gravity, [[8.0], [12.0]]))


def test_the_pendulums_torque_is_scaled_to_one(pendulum):
    pendulum.reset(seed=0)
    for torque, shown in [(2.0, 1.0), (-2.0, -1.0), (1.0, 0.5), (9.0, 1.0)]:  # N m; the last one is clipped
        observation, reward, *_ = pendulum.step(np.float32([torque]))
        assert observation["action"].tolist() == [shown]
        assert observation["reward"].tolist() == [np.float32(reward)]
        assert observation["episode_start"].tolist() == [0.0]


def test_the_wrapped_pendulum_steps_as_the_bare_one():
    env, bare = TransitionObservation(gym.make("Pendulum-v1")), gym.make("Pendulum-v1")
    np.testing.assert_array_equal(env.reset(seed=0)[0]["observation"], bare.reset(seed=0)[0])
    for torque in np.linspace(-2.0, 2.0, 20, dtype=np.float32):
        observation, reward, *_ = env.step(torque[None])
        expected, expected_reward, *_ = bare.step(torque[None])
        np.testing.assert_array_equal(observation["observation"], expected)
        assert reward == expected_reward


def test_a_reset_shows_no_action_no_reward_and_a_start(pendulum):
    pendulum.reset(seed=0)
    pendulum.step(np.ones(1))
    observation, _ = pendulum.reset()
    assert observation["action"].tolist() == [0.0]
    assert observation["reward"].tolist() == [0.0]
    assert observation["episode_start"].tolist() == [1.0]


@pytest.mark.filterwarnings("ignore:We recommend you to use a symmetric")
def test_the_wrapped_pendulum_passes_sb3s_check(pendulum):
    sb3_check_env(pendulum, skip_render_check=True)


def test_each_bound_is_scaled_by_itself_and_the_shape_becomes_flat():
    low, high = np.float32([[0.0, -10.0], [2.0, -1.0]]), np.float32([[1.0, 10.0], [4.0, 1.0]])
    env = TransitionObservation(Still(actions=Box(low, high)))
    env.reset()
    observation, *_ = env.step(np.array([[0.5, 10.0], [2.0, 0.5]]))
    assert observation["action"].tolist() == [0.0, 1.0, -1.0, 0.5]
    assert observation in env.observation_space


@given(
    low=st.floats(-1e3, 1e3, width=32),
    width=st.floats(0.125, 1e3, width=32),
    action=st.floats(-1e4, 1e4, width=32),
)
def test_any_action_lands_in_the_space_and_comes_back(low, width, action):
    bounds = Box(np.float32([low]), np.float32([low + width]))
    env = TransitionObservation(Still(actions=bounds))
    observation, *_ = env.step(np.float32([action]))
    assert observation in env.observation_space
    back = bounds.low + (observation["action"] + 1.0) / 2.0 * (bounds.high - bounds.low)
    np.testing.assert_allclose(back, np.clip(action, bounds.low, bounds.high), atol=1e-3)


@pytest.mark.parametrize(
    "space",
    [
        Box(-1.0, 1.0, (3, 4, 5)),
        Box(-1.0, 1.0, ()),
        Box(-1e300, 1e300, (2,), dtype=np.float64),
        Box(0, 255, (8,), dtype=np.uint8),
        Box(-5, 5, (2,), dtype=np.int64),
    ],
)
def test_boxes_of_any_shape_and_number_become_float32(space):
    env = TransitionObservation(Still(space))
    observation, _ = env.reset()
    shown = env.observation_space["observation"]
    assert (shown.shape, shown.dtype) == (space.shape, np.float32)
    assert observation["observation"].dtype == np.float32


def test_an_observation_is_a_copy():
    env = TransitionObservation(PointDirEnv())
    first, _ = env.reset(seed=0)
    first["observation"][:] = 9.0
    assert env.step(np.zeros(2))[0]["observation"].max() < 1.0


@pytest.mark.parametrize(
    "space",
    [Discrete(3), Discrete(4, start=-2), MultiDiscrete([2, 3]), MultiDiscrete([[2, 2]]), MultiBinary(4), NESTED],
)
def test_other_spaces_are_flattened_as_gymnasium_does_it(space):
    bare = Sampling(space)
    env = TransitionObservation(Trial(TimeLimit(bare, 2), 2))
    shown = env.observation_space["observation"]
    observation, _ = env.reset(seed=0)
    for step in range(3):
        assert shown.contains(observation["observation"])
        np.testing.assert_array_equal(observation["observation"], np.float32(flatten(space, bare.drawn)))
        observation, _, _, _, info = env.step(np.zeros(2))
        assert ("trial_final_observation" in info) == (step == 1)
        if step == 1:
            assert shown.contains(info["trial_final_observation"])
    oracle = TaskObservation(MetaTask(Sampling(space), lambda env, task: None, [[7.0]]))
    told, _ = oracle.reset(seed=0)
    assert oracle.observation_space.contains(told) and told[-1] == 7 and told.shape == (shown.shape[0] + 1,)
    sb3_check_env(TransitionObservation(Sampling(space)), skip_render_check=True)


@pytest.mark.parametrize("wrapper", [TransitionObservation, lambda env: TaskObservation(MetaTask(env))])
@pytest.mark.parametrize(
    ("space", "named"),
    [
        (Box(0, 255, (8, 8, 3), dtype=np.uint8), r"observation_space=.* is an image"),
        (Dict({"eye": Dict({"left": Box(0, 255, (4, 4), dtype=np.uint8)})}), r"\['eye'\]\['left'\]=.* is an image"),
        (Sequence(Box(0, 1, (2,))), r"observation_space=.* has no fixed size"),
        (Dict({"found": Sequence(Discrete(2))}), r"observation_space=.* has no fixed size"),
        (Dict({}), r"observation_space=.* holds nothing"),
        (Dict({"hand": Box(0, 1, (2,)), "eyes": Dict({"left": Tuple([])})}), r"\['eyes'\]\['left'\]=.* holds nothing"),
    ],
)
def test_observations_that_are_no_vector_are_refused(wrapper, space, named):
    with pytest.raises(ValueError, match=named):
        wrapper(Still(space))


@pytest.mark.parametrize(
    "space", [Discrete(3), Box(-np.inf, np.inf, (1,)), Box(0.0, np.inf, (1,)), Box(1.0, 1.0, (1,))]
)
def test_actions_without_a_scale_are_refused(space):
    with pytest.raises(ValueError, match=r"action_space=.* (is no Box|has open or empty bounds)"):
        TransitionObservation(Still(actions=space))


def test_the_oracle_sees_the_observation_and_then_the_task():
    env = TaskObservation(MetaTask(PointDirEnv(), PointDirEnv.set_task, [[0.0, 1.0], [1.0, 0.0]]))
    observation, info = env.reset(seed=0, options={"task": [1.0, 0.0]})
    assert observation.dtype == np.float32
    assert observation[2:].tolist() == info["task"].tolist() == [1.0, 0.0]
    moved, *_ = env.step(np.float32([1.0, 0.0]))
    np.testing.assert_allclose(moved - observation, [0.1, 0.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_array_equal(env.observation_space.low, np.float32([-np.inf, -np.inf, 0.0, 0.0]))
    np.testing.assert_array_equal(env.observation_space.high, np.float32([np.inf, np.inf, 1.0, 1.0]))


def test_the_oracle_flattens_a_box_of_any_shape():
    env = TaskObservation(MetaTask(Still(Box(-1.0, 1.0, (2, 3)))))
    assert env.reset()[0].shape == env.observation_space.shape == (7,)


def test_the_oracle_needs_a_task():
    with pytest.raises(ValueError, match="wrap it in MetaTask before TaskObservation"):
        TaskObservation(FlattenObservation(PointDirEnv()))
