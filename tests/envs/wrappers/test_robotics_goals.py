"""Tests of hide_goal on gymnasium-robotics' environments, where that is installed."""

import gymnasium as gym
import numpy as np
import pytest

from sb3_bruno_envs import TransitionObservation, check_meta_env, goal_tasks, hide_goal


@pytest.mark.mujoco
@pytest.mark.parametrize(
    "env_id", ["FetchReachDense-v4", "FetchPush-v4", "PointMaze_UMazeDense-v3", "AntMaze_UMaze-v5"]
)
def test_the_goals_of_gymnasium_robotics(env_id):
    gym.register_envs(pytest.importorskip("gymnasium_robotics"))
    tasks = goal_tasks(gym.make(env_id), 10, 5)
    env = hide_goal(gym.make(env_id), tasks)
    names = [env.name_of(task) for task in tasks.tasks("train")]
    assert len(set(names)) == 10 and len(env.task_entries) == tasks.space.shape[0]
    if env_id != "AntMaze_UMaze-v5":  # where random actions reach nothing for long
        check_meta_env(TransitionObservation(env))
    _, info = env.reset(seed=0, options={"task": tasks.tasks("test")[0]})
    if "Maze" in env_id:  # where the picture shows the goal
        place = env.unwrapped.target_site_id
        model = getattr(env.unwrapped, "point_env", None) or env.unwrapped.ant_env
        np.testing.assert_allclose(model.model.site_pos[place][:2], info["task"])
    observation, reward, *_, info = env.step(env.action_space.sample())
    assert reward == env.unwrapped.compute_reward(observation["achieved_goal"], np.float64(info["task"]), info)
    assert info["is_success"] in (0.0, 1.0)


@pytest.mark.mujoco
def test_a_maze_that_moves_its_target_is_refused():
    gym.register_envs(pytest.importorskip("gymnasium_robotics"))
    maze = gym.make("PointMaze_UMaze-v3", reset_target=True)
    env = hide_goal(maze, goal_tasks(maze, 3, 2))
    env.reset(seed=0)
    env.unwrapped.data.qpos[:2] = env.unwrapped.goal  # there at once
    env.step(np.zeros(2))  # and only then another goal
    with pytest.raises(ValueError, match="reset_target=False"):
        env.step(np.zeros(2))
