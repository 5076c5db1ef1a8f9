"""Small runs that die and are resumed, and what of them must be equal."""

import numpy as np
import torch as th
import zuko
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env

COMMON = {
    "seed": 3,
    "learning_starts": 40,
    "gradient_steps": 1,
    "batch_size": 32,
    "buffer_size": 300,
    "policy_kwargs": {"net_arch": [16]},
}
SETTINGS = {
    **COMMON,
    "encoder_kwargs": {"flow_class": zuko.flows.MAF, "flow_kwargs": {"transforms": 2, "hidden_features": (16,)}},
    "encoder_batch_size": 4,
    "encoder_update_ratio": 0.1,
    "replay_buffer_kwargs": {"n_sequences": 4, "sequence_length": 16},
}


def point(n_envs=3, **kwargs):
    return make_vec_env("sb3_bruno_envs:PointDir-v0", n_envs, seed=0, **kwargs)


class Die(BaseCallback):
    """Ends training in the middle of a rollout, as a kill would."""

    def __init__(self, after):
        super().__init__()
        self.after = after

    def _on_step(self):
        if self.num_timesteps >= self.after:
            raise KeyboardInterrupt
        return True


def fingerprint(model):
    tensors = [tensor for part in model.get_parameters().values() for tensor in tensors_of(part)]
    arrays = [model.replay_buffer.observations, model.replay_buffer.rewards, *model._carried.pack()]
    return [tensor.detach().clone() for tensor in tensors] + [th.as_tensor(array).clone() for array in arrays]


def tensors_of(part):
    if isinstance(part, th.Tensor):
        return [part.cpu()]  # Adam counts its steps there, unless it was loaded
    if isinstance(part, dict):
        return [tensor for value in part.values() for tensor in tensors_of(value)]
    return []


def scramble_random_states():
    np.random.seed(99)  # noqa: NPY002  # what SB3 draws from
    th.manual_seed(98)
