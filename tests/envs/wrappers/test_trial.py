"""Tests of Trial: when inner episodes begin and end, what the infos say, and that they share a task."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box

from sb3_bruno_envs import MetaTask, PointDirEnv, TaskObservation, TransitionObservation, Trial, check_meta_env

DIRECTIONS = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]


class Counter(gym.Env):
    """Observes 100 times the number of its resets plus the step; terminates after ``length`` steps, if ever."""

    observation_space = Box(0.0, np.inf, (1,))
    action_space = Box(-1.0, 1.0, (1,))

    def __init__(self, length=None):
        self.length = length
        self.resets = []  # seed and options of each
        self.seen = np.zeros(1, np.float32)  # one array, used again and again

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.resets.append((seed, options))
        self.seen[:] = 100 * len(self.resets)
        return self.seen, {"own": "reset"}

    def step(self, action):
        self.seen += 1
        return self.seen, float(self.seen[0]), self.seen[0] % 100 == self.length, False, {"own": "step"}


def run(env, n_steps):
    """Steps as (observation, reward, terminated, truncated, info), each observation as the number it was."""
    return [
        (observation.item(), reward, terminated, truncated, info)
        for observation, reward, terminated, truncated, info in (env.step(np.zeros(1)) for _ in range(n_steps))
    ]


def set_gravity(pendulum, task):
    pendulum.g = float(task[0])


def meta_point(n_episodes=3, **kwargs):
    trial = Trial(gym.wrappers.TimeLimit(PointDirEnv(), 5), n_episodes)
    return TransitionObservation(MetaTask(trial, PointDirEnv.set_task, DIRECTIONS, **kwargs))


@pytest.mark.parametrize("terminates", [True, False])
def test_an_inner_end_begins_the_next_episode_and_the_last_ends_the_trial(terminates):
    env = Trial(Counter(2) if terminates else gym.wrappers.TimeLimit(Counter(), 2), 3)
    observation, info = env.reset(seed=4, options={"speed": 3})
    assert (observation.item(), info) == (100, {"own": "reset", "episode_index": 0})
    steps = run(env, 6)
    assert [observation for observation, *_ in steps] == [101, 200, 201, 300, 301, 302]
    assert [reward for _, reward, *_ in steps] == [101, 102, 201, 202, 301, 302]
    assert [(terminated, truncated) for _, _, terminated, truncated, _ in steps] == [
        *[(False, False)] * 5,
        (terminates, not terminates),
    ]
    infos = [info for *_, info in steps]
    assert [info["episode_index"] for info in infos] == [0, 0, 1, 1, 2, 2]
    assert [info.get("trial_final_observation") for info in infos] == [None, 102, None, 202, None, None]
    assert all(info["own"] == "step" for info in infos)
    assert env.unwrapped.resets == [(4, {"speed": 3}), (None, None), (None, None)]


def test_a_reset_in_mid_trial_begins_a_new_trial():
    env = Trial(Counter(2), 2)
    env.reset()
    run(env, 3)
    assert env.reset()[1]["episode_index"] == 0
    assert [terminated for _, _, terminated, _, _ in run(env, 4)] == [False, False, False, True]


def test_one_episode_makes_a_trial_of_what_it_was():
    env = Trial(Counter(2), 1)
    env.reset()
    assert [(terminated, "trial_final_observation" in info) for _, _, terminated, _, info in run(env, 2)] == [
        (False, False),
        (True, False),
    ]


def test_inner_episodes_share_a_task_and_trials_do_not():
    env = meta_point(draw="cycle")
    for expected in DIRECTIONS:
        tasks = [env.reset()[1]["task"]] + [env.step(np.zeros(2))[4]["task"] for _ in range(15)]
        np.testing.assert_array_equal(tasks, np.tile(np.float32(expected), (16, 1)))


def test_inner_episodes_start_in_places_of_their_own_that_the_seed_decides():
    def starts(seed):
        env = meta_point()
        first = env.reset(seed=seed)[0]["observation"]
        seen = [env.step(np.zeros(2))[0]["observation"] for _ in range(14)]
        return np.stack([first, seen[4], seen[9]])

    assert len(np.unique(starts(0), axis=0)) == 3
    np.testing.assert_array_equal(starts(0), starts(0))
    assert not np.isin(starts(1), starts(0)).any()


def test_the_dict_marks_the_start_and_keeps_what_was_last_done_and_earned():
    env = meta_point()
    env.reset(seed=0)
    action = np.float32([0.5, -0.25])
    for step in range(1, 16):
        observation, reward, _, truncated, info = env.step(action)
        inner_end = step in (5, 10)
        assert ("trial_final_observation" in info) == inner_end
        assert observation["episode_start"].tolist() == [0.5 * inner_end]
        assert observation["action"].tolist() == [0.5, -0.25]
        assert observation["reward"].tolist() == [np.float32(reward)]
        assert truncated == (step == 15)


def test_trials_pass_our_own_check():
    check_meta_env(meta_point())


def test_a_trial_around_any_environment_is_rebuilt_from_its_spec():
    pendulum = gym.make("Pendulum-v1", max_episode_steps=5)
    env = MetaTask(Trial(pendulum, n_episodes=3), set_gravity, [[8.0], [12.0]])
    again = gym.make(env.spec)
    assert str(again) == str(env)
    assert again.spec == env.spec
    again.reset(seed=0)
    assert [again.step(np.zeros(1))[3] for _ in range(15)] == [False] * 14 + [True]


def test_a_pickled_copy_continues_the_trial():
    env = meta_point()
    env.reset(seed=0)
    for _ in range(7):
        env.step(np.ones(2))
    copy = pickle.loads(pickle.dumps(env))
    for _ in range(8):
        step, expected = copy.step(np.ones(2)), env.step(np.ones(2))
        np.testing.assert_array_equal(step[0]["observation"], expected[0]["observation"])
        assert (step[1:4], step[4]["episode_index"]) == (expected[1:4], expected[4]["episode_index"])


@pytest.mark.parametrize("n_episodes", [0, -3, 2.5, 2.0, np.nan, "3"])
def test_no_episodes_and_no_parts_of_one_are_refused(n_episodes):
    with pytest.raises(ValueError, match=rf"n_episodes={n_episodes!r} is not a positive integer: give at least 1"):
        Trial(Counter(2), n_episodes)


def test_an_integer_of_numpy_is_one():
    env = Trial(Counter(2), np.int64(2))
    env.reset()
    assert [ended for _, _, ended, _, _ in run(env, 4)] == [False, False, False, True]


@pytest.mark.parametrize("show", [TransitionObservation, TaskObservation])
def test_an_observation_wrapper_belongs_inside(show):
    short = gym.wrappers.TimeLimit(PointDirEnv(), 5)

    def tenfold(env):
        return gym.wrappers.TransformObservation(env, lambda seen: 10 * seen, env.observation_space)

    show(MetaTask(Trial(tenfold(short), 3), PointDirEnv.set_task, DIRECTIONS))
    for env in (
        MetaTask(tenfold(Trial(short, 3)), PointDirEnv.set_task, DIRECTIONS),
        tenfold(MetaTask(Trial(short, 3), PointDirEnv.set_task, DIRECTIONS)),
    ):
        with pytest.raises(ValueError, match=r"TransformObservation around a Trial .* put it inside the Trial"):
            show(env)


def test_the_oracle_is_shown_the_task_where_an_inner_episode_ends_too():
    env = TaskObservation(
        MetaTask(Trial(gym.wrappers.TimeLimit(PointDirEnv(), 5), 3), PointDirEnv.set_task, DIRECTIONS)
    )
    _, info = env.reset(seed=0)
    finals = [env.step(np.zeros(2))[4].get("trial_final_observation") for _ in range(15)]
    assert [step for step, final in enumerate(finals) if final is not None] == [4, 9]
    assert all(env.observation_space.contains(finals[step]) for step in (4, 9))
    np.testing.assert_array_equal([finals[step][-2:] for step in (4, 9)], [info["task"]] * 2)


def test_a_task_drawn_inside_is_refused():
    with pytest.raises(ValueError, match="wrap Trial in MetaTask instead"):
        Trial(MetaTask(gym.wrappers.TimeLimit(PointDirEnv(), 5)), 3)
