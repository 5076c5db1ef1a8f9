"""Pictures show a robot on the same floor wherever it runs, and the physics do not notice that they are made."""

import os

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import sb3_bruno_envs  # noqa: F401  # registers the ids

pytestmark = pytest.mark.mujoco

FAR = 400.0  # m, a whole number of squares of every robot's floor


def states(env, render):
    """What the physics hold after each of ten steps, ``(10, size)``."""
    env.reset(seed=0)
    action, kept = np.ones(env.action_space.shape, np.float32), []
    for _ in range(10):
        env.step(action)
        if render:
            env.render()
        data = env.unwrapped.data
        kept.append(np.concatenate([data.qpos, data.qvel, data.geom_xpos.ravel(), data.light_xpos.ravel()]))
    return np.array(kept)


@pytest.mark.parametrize("env_id", ["CheetahDir-v0", "HopperParams-v0"])
def test_the_floor_follows_the_robot_in_pictures_alone(env_id, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", os.environ.get("MUJOCO_GL", "egl"))
    env = gym.make(env_id, render_mode="rgb_array", width=96, height=96)
    np.testing.assert_array_equal(states(env, render=True), states(env, render=False))
    here = env.render().astype(float)
    model, data = env.unwrapped.model, env.unwrapped.data
    data.qpos[0] += FAR
    mujoco.mj_forward(model, data)
    there = env.render().astype(float)
    env.close()
    assert np.abs(here - there).mean() < 2.0
    assert here[-30:].std() > 10.0  # there is a floor


def test_a_floor_that_has_no_end_stays_and_one_without_a_pattern_follows():
    from sb3_bruno_envs.mujoco.endless_floor import endless_floor

    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
        <geom name="no end" type="plane" size="0 0 1"/> <geom name="plain" type="plane" size="5 5 1" pos="0 0 -1"/>
        <geom name="wall" type="plane" size="5 5 1" euler="0 90 0"/>
        <body pos="7.2 0 1"><freejoint/><geom size="0.1"/></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with endless_floor(model, data):
        assert data.geom_xpos[:3, 0].tolist() == [0.0, 7.0, 0.0]
    assert data.geom_xpos[:3, 0].tolist() == [0.0, 0.0, 0.0]
