"""A good environment, and wrappers that each break the contract of task inference in one way."""

import gymnasium as gym
import numpy as np
from gymnasium.envs.classic_control import PendulumEnv
from gymnasium.spaces import Box
from gymnasium.wrappers import TimeLimit

from sb3_bruno_envs import MetaTask, PointDirEnv, TransitionObservation

DIRECTIONS = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]


def meta_point(**kwargs):
    return MetaTask(PointDirEnv(), PointDirEnv.set_task, DIRECTIONS, **kwargs)


def draw_direction(rng):
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return [np.cos(angle), np.sin(angle)]


def endless():
    plane = Box(-1.0, 1.0, (2,))
    return TransitionObservation(MetaTask(PointDirEnv(), PointDirEnv.set_task, draw_direction, task_space=plane))


def good():
    return TimeLimit(TransitionObservation(meta_point()), 20)


class Edit(gym.Wrapper):
    """Changes what a good environment returns by ``edit(observation, info, step)``; step 0 is the reset."""

    def __init__(self, edit, env=None):
        super().__init__(env or good())
        self.edit = edit
        self.count = 0

    def reset(self, *, seed=None, options=None):
        self.count = 0
        observation, info = self.env.reset(seed=seed, options=options)
        self.edit(observation, info, 0)
        return observation, info

    def step(self, action):
        self.count += 1
        observation, reward, terminated, truncated, info = self.env.step(action)
        self.edit(observation, info, self.count)
        return observation, reward, terminated, truncated, info


class Stubborn(gym.Wrapper):
    """Ignores the options."""

    def reset(self, *, seed=None, options=None):
        return self.env.reset(seed=seed)


class Unseeded(gym.Wrapper):
    """Ignores the seed."""

    def reset(self, *, seed=None, options=None):
        return self.env.reset(options=options)


class SeededAlike(MetaTask):
    """Falls into the trap: its generator is seeded as the environment's."""

    def _restart_drawing(self, seed):
        super()._restart_drawing(seed)
        self._rng = np.random.default_rng(seed)


class Telltale(gym.ObservationWrapper):
    """Adds the task to the observation."""

    def __init__(self, env):
        super().__init__(env)
        self.observation_space = Box(-np.inf, np.inf, (4,))

    def observation(self, observation):
        return np.concatenate([observation, self.get_wrapper_attr("task")])


class Shown(gym.ObservationWrapper):
    """A point that is shown at ``value``, also at the reset."""

    def __init__(self, value):
        super().__init__(PointDirEnv())
        self.value = value

    def observation(self, observation):
        return np.full_like(observation, self.value)


class StepsInReset(gym.Wrapper):
    """Takes a step before it shows anything, as BipedalWalker does: the physics show in the first observation."""

    def reset(self, *, seed=None, options=None):
        _, info = self.env.reset(seed=seed, options=options)
        return self.env.step(np.zeros(1))[0], info


class FromRest(PendulumEnv):
    """A pendulum that starts at one angle, or a little beside it."""

    def reset(self, *, seed=None, options=None):
        _, info = super().reset(seed=seed, options={"x_init": 0.1, "y_init": 0.1})
        self.state = self.state * 0.1 + 1.0
        return self._get_obs(), info


def set_gravity(pendulum, task):
    pendulum.g = float(task[0])


def physics_shown(meta_task=MetaTask, env=FromRest):
    gravities = np.linspace(5.0, 15.0, 21)[:, None]
    return TransitionObservation(meta_task(TimeLimit(StepsInReset(env()), 20), set_gravity, gravities))


class Spaces(gym.Wrapper):
    """A good environment that declares other spaces."""

    def __init__(self, action_space=None, task_space=None, **spaces):
        super().__init__(good())
        keys = {**self.env.observation_space, **spaces}
        self.observation_space = gym.spaces.Dict({key: box for key, box in keys.items() if box is not None})
        self.action_space = self.env.action_space if action_space is None else action_space
        self.task_space = self.env.get_wrapper_attr("task_space") if task_space is None else task_space


def put(key, value, when=lambda step: True):
    def edit(observation, info, step):
        if when(step):
            (info if key.startswith("task") else observation)[key] = value

    return edit


def drop(key):
    return lambda observation, info, step: (info if key.startswith("task") else observation).pop(key)


def at_end(step):
    return step == 20


def mid_episode(step):
    return step > 0


def seeded_alike(sample, env):
    space = Box(-np.inf, np.inf, (len(sample(np.random.default_rng(0))),))
    return TimeLimit(TransitionObservation(SeededAlike(env, lambda *_: None, sample, task_space=space)), 20)
