"""Tests of the cart-pole: its dynamics against MuJoCo's and its energy, its reward, its ends, its images."""

import math
import pickle

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sb3_bruno_envs import CARTPOLE_TASKS, CartpoleSwingUpEnv
from sb3_bruno_envs.classic import cartpole

MASSES, LENGTHS = st.floats(0.1, 3.0), st.floats(0.1, 1.0)  # kg, m
STATES = st.tuples(st.floats(-2, 2), st.floats(-5, 5), st.floats(-7, 7), st.floats(-15, 15))

MODEL = """
<mujoco>
  <option gravity="0 0 -9.82"/>
  <worldbody>
    <body>
      <joint type="slide" axis="1 0 0" damping="0.1"/>
      <inertial pos="0 0 0" mass="{mass}" diaginertia="1 1 1"/>
      <body>
        <joint type="hinge" axis="0 -1 0"/>
        <inertial pos="0 0 {half}" mass="0.5" diaginertia="{inertia} {inertia} 1e-9"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""  # the pole is a thin rod, upright at 0; its hinge turns counterclockwise for one who sees x to the right


def cart_pole(mass, length, state=(0.0, 0.0, math.pi, 0.0), **kwargs):
    env = CartpoleSwingUpEnv(**kwargs)
    env.set_task([mass, length])
    env.reset(seed=0)
    env.state = state
    return env


def energy(env):
    """Kinetic and potential, in J: of the cart, and of a thousand pieces of the pole."""
    _, velocity, angle, spin = env.state
    along = (np.arange(1000) + 0.5) / 1000 * env.length  # m from the hinge
    vx, vz = velocity - along * spin * math.cos(angle), -along * spin * math.sin(angle)
    pole = 0.5 * np.mean(0.5 * (vx**2 + vz**2) + 9.82 * along * math.cos(angle))
    return 0.5 * env.mass * velocity**2 + pole


@pytest.mark.mujoco
@given(mass=MASSES, length=LENGTHS, state=STATES, action=st.floats(-1.0, 1.0, width=32))
def test_a_step_is_an_euler_step_with_mujocos_accelerations(mass, length, state, action):
    model = mujoco.MjModel.from_xml_string(
        MODEL.format(mass=mass, half=length / 2, inertia=0.5 * length**2 / 12)  # kg m^2
    )
    data = mujoco.MjData(model)
    x, velocity, angle, spin = state
    data.qpos[:], data.qvel[:], data.qfrc_applied[0] = (x, angle), (velocity, spin), 10.0 * action
    mujoco.mj_forward(model, data)
    env = cart_pole(mass, length, state)
    env.step(np.float32([action]))
    cart, pole = data.qacc
    expected = x + 0.01 * velocity, velocity + 0.01 * cart, angle + 0.01 * spin, spin + 0.01 * pole
    np.testing.assert_allclose(env.state, expected, rtol=1e-6, atol=1e-9)  # the rod's own breadth is 1e-9


@pytest.mark.parametrize("friction", [0.0, 0.1])
@pytest.mark.parametrize(("mass", "length"), [(0.1, 0.98), (3.0, 0.1), (1.0, 0.5)])
def test_energy_comes_from_the_force_and_goes_into_friction(monkeypatch, friction, mass, length):
    dt = 1e-5  # s
    monkeypatch.setattr(cartpole, "_DT", dt)
    monkeypatch.setattr(cartpole, "_FRICTION", friction)
    env = cart_pole(mass, length, (0.0, 0.3, 2.0, 1.0))
    before, gained = energy(env), 0.0
    for _ in range(20_000):
        velocity = env.state[1]
        gained += dt * (3.0 - friction * velocity) * velocity  # J
        env.step(np.float32([0.3]))
    assert abs(gained) > 0.02
    assert energy(env) - before == pytest.approx(gained, abs=1e-3)
    if friction == 0.0:
        before = energy(env)
        for _ in range(20_000):
            env.step(np.zeros(1))
        assert energy(env) == pytest.approx(before, abs=1e-3)


@given(mass=MASSES, length=LENGTHS, state=STATES)
def test_left_and_right_are_mirror_images(mass, length, state):
    env, mirrored = cart_pole(mass, length, state), cart_pole(mass, length, tuple(-value for value in state))
    (_, reward, *_), (_, mirrored_reward, *_) = env.step(np.float32([0.7])), mirrored.step(np.float32([-0.7]))
    assert env.state == tuple(-value for value in mirrored.state)
    assert reward == mirrored_reward


def test_the_pole_hangs_stably_and_stands_unstably():
    hanging, standing = (cart_pole(1.0, 0.5, (0.0, 0.0, angle, 0.0)) for angle in (math.pi + 0.01, 0.01))
    for _ in range(100):
        hanging.step(np.zeros(1))
        standing.step(np.zeros(1))
    assert abs(hanging.state[2] - math.pi) < 0.02
    assert abs(standing.state[2]) > 0.5


@pytest.mark.parametrize(
    ("x", "angle", "expected"),
    [(0.0, 0.0, 1.0), (0.0, math.pi, 0.0), (1.2, 0.0, math.sqrt(0.5)), (-1.6, math.pi / 2, 0.25), (2.4, 0.0, 0.0)],
)
def test_the_reward_wants_an_upright_pole_in_the_middle(x, angle, expected):
    env = cart_pole(1.0, 0.5, (x, 0.0, angle, 0.0))  # at rest: one Euler step keeps both positions
    assert env.step(np.zeros(1))[1] == pytest.approx(expected, abs=1e-9)


def test_the_observation_follows_the_state_that_is_rewarded():
    env = cart_pole(1.0, 0.5, (0.1, 2.0, 0.5, -3.0))
    observation, reward, *_ = env.step(np.float32([1.0]))
    x, velocity, angle, spin = env.state
    np.testing.assert_array_equal(observation, np.float32([x, velocity, np.cos(angle), np.sin(angle), spin]))
    assert (x, angle) == pytest.approx((0.12, 0.47))
    assert reward == pytest.approx((np.cos(0.47) + 1) / 2 * np.cos(np.pi * 0.12 / 4.8))


@pytest.mark.parametrize(("x", "terminated"), [(2.4, False), (2.4001, True), (-2.4, False), (-2.4001, True)])
def test_it_terminates_beyond_the_track_alone(x, terminated):
    env = cart_pole(1.0, 0.5, (x, 0.0, 0.0, 0.0))
    assert env.step(np.zeros(1))[2:4] == (terminated, False)


@pytest.mark.parametrize(("action", "clipped"), [(5.0, 1.0), (-5.0, -1.0)])
def test_the_action_is_clipped(action, clipped):
    env, within = cart_pole(1.0, 0.5), cart_pole(1.0, 0.5)
    np.testing.assert_array_equal(env.step(np.float32([action]))[0], within.step(np.float32([clipped]))[0])


def test_it_starts_hanging_with_a_spread_that_the_seed_decides():
    env, starts = CartpoleSwingUpEnv(), []
    for seed in range(1000):
        env.reset(seed=seed)
        starts.append(env.state)
    standard_error = 0.2 / math.sqrt(1000)
    np.testing.assert_allclose(np.mean(starts, axis=0), [0.0, 0.0, math.pi, 0.0], atol=5 * standard_error)
    np.testing.assert_allclose(np.std(starts, axis=0), 0.2, rtol=0.15)
    env.reset(seed=7)
    assert env.state == starts[7]


@pytest.mark.parametrize("kwargs", [{}, {"max_episode_steps": 500}])
def test_an_episode_that_stays_on_the_track_has_the_registered_length(kwargs):
    env = gym.make("sb3_bruno_envs:CartpoleSwingUp-v0", observe="plain", draw="cycle", **kwargs)
    for seed in range(len(CARTPOLE_TASKS.tasks())):
        observation, _ = env.reset(seed=seed)
        steps, terminated, truncated = 0, False, False
        while not (terminated or truncated):
            x, velocity = observation[:2]
            observation, _, terminated, truncated, _ = env.step(np.float32([-0.5 * x - 0.5 * velocity]))
            steps += 1
        assert (steps, terminated) == (kwargs.get("max_episode_steps", 200), False)


def test_full_force_one_way_leaves_the_track():
    env = gym.make("sb3_bruno_envs:CartpoleSwingUp-v0", observe="plain")
    env.reset(seed=0)
    steps = [env.step(np.ones(1, np.float32)) for _ in range(150)]
    assert [step[2] for step in steps].index(True) < 149


@pytest.mark.parametrize("task", [[0.0, 0.5], [0.5, -0.1], [np.nan, 1.0]])
def test_an_impossible_task_is_refused(task):
    with pytest.raises(ValueError, match=r"give the cart's mass .*, of shape \(2,\), finite and above 0"):
        CartpoleSwingUpEnv().set_task(task)


def test_images_show_the_track_the_cart_and_the_pole():
    image = cart_pole(1.0, 0.98, (1.0, 0.0, 0.0, 0.0), render_mode="rgb_array").render()
    assert (image.shape, image.dtype) == ((128, 128, 3), np.uint8)
    rows, columns = np.nonzero((image == (40, 160, 70)).all(axis=2))  # the pole stands on the cart
    assert (abs(columns.mean() - (64 + 25)) < 1.5, 37 <= rows.min() <= 41, rows.max() <= 66) == (True, True, True)
    _, columns = np.nonzero((image == (30, 80, 200)).all(axis=2))  # the cart, at x = 1 m
    assert abs(columns.mean() - (64 + 25)) < 1.5
    assert (image[64] == (190, 190, 190)).all(axis=1).sum() > 90  # the track
    leaning = cart_pole(1.0, 0.98, (0.0, 0.0, math.pi / 2, 0.0), render_mode="rgb_array").render()
    _, columns = np.nonzero((leaning == (40, 160, 70)).all(axis=2))
    assert columns.max() <= 66  # a quarter turn counterclockwise points to the left


def test_without_a_render_mode_there_is_no_image():
    assert cart_pole(1.0, 0.5).render() is None


def test_an_unknown_render_mode_is_refused():
    with pytest.raises(ValueError, match="render_mode='human' is not supported: use None or 'rgb_array'"):
        CartpoleSwingUpEnv(render_mode="human")


def test_a_pickled_copy_continues_the_episode_of_its_task():
    env = gym.make("sb3_bruno_envs:CartpoleSwingUp-v0", observe="plain")
    env.reset(seed=0, options={"task": [2.5, 0.25]})
    env.step(np.ones(1, np.float32))
    copy = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(copy.step(np.ones(1))[0], env.step(np.ones(1))[0])
    np.testing.assert_array_equal(copy.reset()[0], env.reset()[0])
    np.testing.assert_array_equal(copy.get_wrapper_attr("task"), env.get_wrapper_attr("task"))


def test_the_cart_poles_tasks_are_two_grids():
    train, test = CARTPOLE_TASKS.tasks("train"), CARTPOLE_TASKS.tasks("test")
    assert train.tolist() == [[mass, length] for mass in (0.5, 1.0, 1.5, 2.0, 2.5) for length in (0.25, 0.5, 0.75)]
    masses, lengths = np.float32([0.1, 0.25, 0.75, 1.75, 2.25, 3.0]), np.float32([0.1, 0.2, 0.4, 0.6, 0.9, 0.98])
    np.testing.assert_array_equal(test, [[mass, length] for mass in masses for length in lengths])
    inside = test[CARTPOLE_TASKS.inside_train_box(test)]
    np.testing.assert_array_equal(
        inside, [[m, length] for m in (0.75, 1.75, 2.25) for length in np.float32([0.4, 0.6])]
    )
    assert all(task in CARTPOLE_TASKS.space for task in (*train, *test))
