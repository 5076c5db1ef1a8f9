"""An exported agent beside the agent that it was made of, on the same observations."""

import numpy as np
import torch as th

from sb3_bruno.algorithms.carried import Carried
from sb3_bruno.encoders import Transitions

STARTS = {0: 1.0, 7: 0.5, 12: 1.0}
"""Where a task begins in twenty steps (1), and where another episode of the same one does (0.5)."""
BARE = {"n_weights": 2, "net_arch": (8,), "modelled": "rewards", "flow_class": None}
"""A small encoder with a kernel."""


def disturb(model):
    """Give every statistic that standardises a value of its own, as training would."""
    generator = th.Generator().manual_seed(0)
    for name, buffer in model.policy.named_buffers():
        if name.endswith((".mean", "ra_mean")):
            buffer.copy_(0.1 * th.randn(buffer.shape, generator=generator))
        elif name.endswith((".var", "ra_var")):
            buffer.copy_(0.5 + th.rand(buffer.shape, generator=generator))
    normalize = model.get_vec_normalize_env()
    for key in () if normalize is None else ("observation", "action", "reward"):
        statistics = normalize.obs_rms[key]
        statistics.mean = np.random.default_rng(0).normal(size=statistics.mean.shape)
        statistics.var = np.random.default_rng(0).uniform(0.5, 2, statistics.var.shape)


class Agent:
    """What a model tells of one env, step by step."""

    def __init__(self, model):
        self.model, self.before, self.state, self.action, self.seen = model, None, None, None, None

    def act(self, observation, reward, start):
        """Return the action of ``predict``. start: as the observation's key ``episode_start``."""
        model, space = self.model, self.model.action_space
        last = np.zeros(space.shape, np.float32) if start else model.policy.scale_action(self.action)
        seen = {
            "observation": np.asarray(observation, np.float32),
            "action": np.asarray(last, np.float32).ravel(),
            "reward": np.array([0.0 if start else reward], np.float32),
            "episode_start": np.array([start], np.float32),
        }
        normalize = model.get_vec_normalize_env()
        self.seen = seen if normalize is None else normalize.normalize_obs(seen)
        self.before, is_new = self.state, np.array([start == 1.0])
        self.action, self.state = model.predict(self.seen, self.state, is_new, deterministic=True)
        return self.action

    def surprise(self):
        """The log Bayes factor at the last transition, in nats; 0 where none led here."""
        if self.seen["episode_start"] > 0:
            return 0.0
        carried = Carried.unpack(self.before, self.model.encoder, self.model.device)
        columns = (self.seen[key].reshape(1, -1) for key in ("action", "reward", "observation"))
        transition = Transitions(carried.observation, *map(th.as_tensor, columns))
        with th.no_grad():
            return self.model.encoder.log_bayes_factor(carried.memory, transition).item()


def assert_acts_alike(model, controller):
    """Compare both over twenty random steps."""
    generator, agent = np.random.default_rng(0), Agent(model)
    for t in range(20):
        start = STARTS.get(t, 0.0)
        begin(controller, start)
        observation, reward = generator.normal(size=controller.observation_shape), generator.normal()
        action = agent.act(observation, reward, start)
        np.testing.assert_allclose(controller.act(observation, reward), action, atol=1e-5, rtol=0)
        found, expected = controller.task_estimate(), model.task_estimate(agent.state)
        np.testing.assert_allclose(found.mean, expected.mean[0], atol=1e-4, rtol=1e-4)
        np.testing.assert_allclose(found.std, expected.std[0], atol=1e-4, rtol=1e-4)
        if found.probabilities is not None:
            np.testing.assert_allclose(found.probabilities, expected.probabilities[0], atol=1e-4)
            np.testing.assert_array_equal(found.tasks, expected.tasks)
        assert found.labels == expected.labels
        if controller.surprise is not None:
            np.testing.assert_allclose(controller.surprise, agent.surprise(), atol=1e-4, rtol=1e-4)


def begin(controller, start):
    """Tell a controller what the observation's key ``episode_start`` says."""
    if start == 1.0:
        controller.reset()
    elif start:
        controller.start_episode()
