"""A task buffer filled with observation = number of the transition, so that a wrong row shows; its encoder counts."""

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.utils import set_random_seed

from sb3_bruno.buffers.extended_obs import ExtendedObs
from sb3_bruno.buffers.task_buffer import TaskReplayBuffer
from sb3_bruno.encoders import TaskEncoder

SPACE = spaces.Dict(
    {
        "observation": spaces.Box(-np.inf, np.inf, (1,), np.float32),
        "action": spaces.Box(-1, 1, (1,), np.float32),
        "reward": spaces.Box(-np.inf, np.inf, (1,), np.float32),
        "episode_start": spaces.Box(0, 1, (1,), np.float32),
    }
)
ACTIONS = spaces.Box(-1, 1, (1,), np.float32)
LAYOUT = ExtendedObs(1, 2, 1)


class Recorder(TaskEncoder):
    """A stand-in whose belief tells what was absorbed: how many transitions, and the sum of their observations."""

    belief_dim = 2

    def __init__(self):
        super().__init__()
        self.anchor = th.nn.Parameter(th.zeros(1))

    def prefixes(self, transitions, weights=None):
        seen = th.cat([th.ones_like(transitions.observations), transitions.observations], dim=-1)
        if weights is not None:
            seen = seen * weights[..., None]
        return (th.nn.functional.pad(seen.cumsum(dim=-2), (0, 0, 1, 0)),)

    def belief(self, statistics):
        return statistics[0]

    def empty(self, batch_shape=()):
        return (th.zeros(*batch_shape, 2),)

    absorb = None  # never asked for here


Recorder.__abstractmethods__ = frozenset()


class Stream:
    """Feeds a buffer numbered transitions: transition i goes from observation i to i + 0.5 with reward 10 i."""

    def __init__(self, n_envs=1, buffer_size=100, **kwargs):
        set_random_seed(0)
        self.buffer = TaskReplayBuffer(buffer_size, SPACE, ACTIONS, "cpu", n_envs, **kwargs)
        self.buffer.set_encoder(Recorder(), LAYOUT)
        self.n_envs, self.count = n_envs, 0
        self.task_of, self.episode_of, self.step_of, self.inner_end_of = [], [], [], []
        self.running = [([], 0)] * n_envs
        self.steps = [0] * n_envs
        self.episodes = list(range(n_envs))

    def add(self, tasks, dones=None, timeouts=None, inner_ends=None):
        n = self.n_envs
        dones = [False] * n if dones is None else dones
        timeouts = [False] * n if timeouts is None else timeouts
        inner_ends = [False] * n if inner_ends is None else inner_ends
        numbers = np.arange(self.count, self.count + n, dtype=np.float32)[:, None]
        shown = np.where(np.reshape(inner_ends, (n, 1)), -9, numbers + 0.5)  # -9 begins another inner episode
        infos = [{"task": [tasks[i]], "TimeLimit.truncated": timeouts[i]} for i in range(n)]
        for i in np.flatnonzero(inner_ends):
            infos[i]["trial_final_observation"] = numbers[i] + 0.5
        self.count += n
        for i in range(n):
            self.task_of.append(tasks[i])
            self.inner_end_of.append(inner_ends[i])
            self.episode_of.append(self.episodes[i])
            self.step_of.append(self.steps[i])
            self.steps[i] = 0 if dones[i] else self.steps[i] + 1
            self.episodes[i] += n if dones[i] else 0
        self.buffer.add(
            {"observation": numbers},
            {"observation": shown},
            numbers / 1_000,
            10 * numbers[:, 0],
            np.array(dones),
            infos,
        )
        return self

    def check(self, samples):
        """Every part of every sampled transition belongs to the same transition, and its task is its own."""
        number = samples.observations[:, LAYOUT.observation].numpy()
        ended = np.array([[self.inner_end_of[int(i)]] for i in number[:, 0]])  # what came next was not its end
        np.testing.assert_allclose(samples.next_observations[:, LAYOUT.observation], np.where(ended, -9, number + 0.5))
        np.testing.assert_allclose(samples.rewards, 10 * number)
        np.testing.assert_allclose(samples.actions, number / 1_000, rtol=1e-6)
        tasks = np.array([self.task_of[int(i)] for i in number[:, 0]])
        for observations in (samples.observations, samples.next_observations):
            np.testing.assert_array_equal(observations[:, LAYOUT.task][:, 0], tasks)
        seen, after = samples.observations[:, LAYOUT.belief], samples.next_observations[:, LAYOUT.belief]
        np.testing.assert_allclose(after[:, 0] - seen[:, 0], ~ended[:, 0])  # one more transition: itself
        gained, total = (after[:, 1] - seen[:, 1]).numpy(), after[:, 1].numpy()
        assert (np.abs(gained - np.where(ended, 0, number)[:, 0]) <= 1e-3 + 1e-6 * total).all()  # float32 sums
        return number[:, 0].astype(int), seen.numpy()
