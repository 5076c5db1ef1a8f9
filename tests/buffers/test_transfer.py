"""What crosses between host and device: no more than where SB3's own algorithm acts and learns.

Each crossing makes host and GPU wait for each other. The tests need no GPU: every tensor is taken for the device's
unless it was made without naming a device, and what makes one of an array, or a number of it, is counted.
"""

import numpy as np
import pytest
import torch as th
from sb3_contrib import TQC, CrossQ
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.save_util import load_from_zip_file
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._pytree import tree_leaves

from sb3_bruno import BrunoCrossQ, BrunoSAC, BrunoTD3, BrunoTQC
from sb3_bruno.buffers.transfer import to_device, to_host

PAIRS = [(BrunoSAC, SAC), (BrunoTQC, TQC), (BrunoCrossQ, CrossQ), (BrunoTD3, TD3)]
TO_NUMBERS = {
    Tensor.item,
    Tensor.tolist,
    Tensor.cpu,
    Tensor.__bool__,
    Tensor.__int__,
    Tensor.__float__,
    Tensor.__index__,
    Tensor.nonzero,
    th.nonzero,
    th.masked_select,
}
FROM_NUMBERS = {th.tensor, th.as_tensor, th.from_numpy}
MAKERS = FROM_NUMBERS | {th.arange, th.empty, th.full, th.ones, th.rand, th.randint, th.randn, th.randperm, th.zeros}


class Crossings(TorchFunctionMode):
    """Counts transfers: ``up`` to the device, ``down`` to the host."""

    def __init__(self):
        super().__init__()
        self.up = self.down = 0

    def __torch_function__(self, func, types, args=(), kwargs=None):
        kwargs = kwargs or {}
        tensors = [leaf for leaf in tree_leaves((args, kwargs)) if isinstance(leaf, Tensor)]
        on_device = [leaf for leaf in tensors if not getattr(leaf, "on_host", False)]
        if func in MAKERS:
            named = kwargs.get("device") is not None
            self.up += func in FROM_NUMBERS and named and not on_device
            return self._mark(func(*args, **kwargs), on_host=not named and not on_device)
        if func in TO_NUMBERS:
            self.down += bool(on_device)
            return self._mark(func(*args, **kwargs), on_host=True)
        if func is Tensor.__getitem__ and on_device:
            for index in tree_leaves(args[1]):
                self.down += isinstance(index, Tensor) and index.dtype == th.bool
                self.up += isinstance(index, np.ndarray) or getattr(index, "on_host", False)
        elif func is Tensor.numpy:
            assert not on_device, "a tensor of a GPU has no array"
        elif on_device and isinstance(func, type(th.add)):
            strangers = [tensor for tensor in tensors if getattr(tensor, "on_host", False) and tensor.ndim > 0]
            assert not strangers, f"{func} mixes tensors of host and device"
        return self._mark(func(*args, **kwargs), on_host=bool(tensors) and not on_device)

    def _mark(self, result, on_host):
        if on_host:
            for leaf in tree_leaves(result):
                if isinstance(leaf, Tensor):
                    leaf.on_host = True
        return result


def crossings(call):
    """(up, down) of a call."""
    with Crossings() as counted:
        call()
    return counted.up, counted.down


def make(algorithm, **kwargs):
    """A model in mid-episode, with 80 transitions in its buffer."""
    own = {"encoder_learning_starts": 0} if algorithm.__name__.startswith("Bruno") else {}
    env_kwargs = {} if own else {"observe": "plain"}
    env = make_vec_env("sb3_bruno_envs:PointDir-v0", 2, seed=0, env_kwargs=env_kwargs)
    options = {"policy_kwargs": {"net_arch": [8]}, "buffer_size": 1_000, "learning_starts": 1_000, "seed": 0}
    return algorithm("MlpPolicy", env, device="cpu", **options, **own, **kwargs).learn(80)


def warm_up(model):
    """Let the optimisers make their state. The steps that SB3's count, unless fused, are on the host."""
    model.train(3, 256)
    for optimizer in (model.actor.optimizer, model.critic.optimizer, getattr(model, "ent_coef_optimizer", None)):
        for state in optimizer.state.values() if optimizer else ():
            state["step"].on_host = True


@pytest.mark.parametrize(("ours", "theirs"), PAIRS, ids=lambda algorithm: algorithm.__name__)
def test_training_fetches_little_and_sends_little(ours, theirs):
    model, plain = make(ours, encoder_update_ratio=1), make(theirs)
    for each in (model, plain):
        warm_up(each)
    for gradient_steps in (1, 2, 8):
        up, down = crossings(lambda n=gradient_steps: model.train(n, 256))
        up_plain, down_plain = crossings(lambda n=gradient_steps: plain.train(n, 256))
        assert up_plain == 5 * gradient_steps and down_plain >= gradient_steps  # so the counting counts
        if theirs in (SAC, TQC):  # both losses, the entropy coefficient and its loss; no distribution is validated
            assert down_plain == 4 * gradient_steps
        assert down == down_plain + 1  # what is logged of encoder and beliefs, when SB3 has fetched its losses
        n_encodes = -(-gradient_steps // 4)  # 16 x 64 transitions are four batches of 256
        recall = 2  # transitions of the running episodes, and how many each counts for
        # transitions with tasks, the rest of an encode and the order of its samples; the sequences of an encoder update
        readout = 3 if gradient_steps == 8 else 0  # one update in eight: episodes, their weights, steps to be read
        assert up == 3 * n_encodes + gradient_steps + recall + readout
        assert up <= up_plain + (2 if gradient_steps == 1 else 0)


def test_a_distribution_is_not_validated_whatever_the_default(monkeypatch):
    monkeypatch.setattr(th.distributions.Distribution, "_validate_args", True)  # which zuko turned off on import
    model = make(BrunoSAC, encoder_update_ratio=0, gradient_steps=0)
    model.learning_starts = 0
    warm_up(model)
    assert crossings(lambda: model.train(1, 256))[1] == 4  # SB3's losses
    assert crossings(lambda: model.learn(20, reset_num_timesteps=False)) == (10, 10)


@pytest.mark.parametrize("process", ["gaussian", "kernel_student_t"])
def test_so_it_is_with_every_process(process):
    model, plain = make(BrunoSAC, encoder_kwargs={"process": process}), make(SAC)
    for each in (model, plain):
        warm_up(each)
    counts = [crossings(lambda each=each: each.train(8, 256)) for each in (model, plain)]
    assert counts[0][1] == counts[1][1] + 1 and counts[0][0] <= counts[1][0]
    observation = model.get_env().reset()
    assert crossings(lambda: model.predict(observation)) == (1, 2)


@pytest.mark.parametrize(("ours", "theirs"), PAIRS, ids=lambda algorithm: algorithm.__name__)
def test_a_rollout_step_crosses_as_often_as_sb3s(ours, theirs):
    model, plain = make(ours, gradient_steps=0), make(theirs, gradient_steps=0)
    model.learning_starts = plain.learning_starts = 0
    steps = 40  # an episode ends among them
    counts = [crossings(lambda each=each: each.learn(2 * steps, reset_num_timesteps=False)) for each in (model, plain)]
    assert counts[0] == counts[1] == (steps, steps)


def test_predict_takes_two_transfers_each_way():
    model = make(BrunoSAC)
    observation = model.get_env().reset()
    assert crossings(lambda: model.predict(observation)) == (1, 2)
    _, state = model.predict(observation)
    assert crossings(lambda: model.predict(observation, state)) == (2, 2)
    assert all(isinstance(array, np.ndarray) for array in state)


def test_a_line_of_the_log_waits_for_nothing():
    model = make(BrunoSAC)
    model.train(4)
    assert {"encoder/bound_nats", "belief/var"} <= model.logger.name_to_value.keys()
    assert crossings(model.logger.dump) == (0, 0)


def test_arrays_come_back_as_they_were():
    arrays = [np.arange(6, dtype=np.float32).reshape(3, 2), np.ones((3, 1), dtype=bool), np.zeros((3, 4))]
    tensors = to_device(arrays, "cpu")
    assert [tuple(tensor.shape) for tensor in tensors] == [(3, 2), (3, 1), (3, 4)]
    assert all(tensor.dtype == th.float32 for tensor in tensors)
    for one, back in zip(arrays, to_host(tensors), strict=True):
        np.testing.assert_array_equal(one, back)
    arrays[0][:] = -1  # an env may reuse its array
    assert tensors[0][0, 1] == 1


def test_a_belief_is_saved_as_arrays_which_load_on_any_device(tmp_path):
    model = make(BrunoSAC)
    model.save(tmp_path / "model.zip")
    data, _, _ = load_from_zip_file(tmp_path / "model.zip")
    assert all(isinstance(array, np.ndarray) for array in data["_carried"])
    loaded = BrunoSAC.load(tmp_path / "model.zip", device="cpu")
    for carried, again in zip(model._carried.pack(), loaded._carried.pack(), strict=True):
        np.testing.assert_array_equal(carried, again)
