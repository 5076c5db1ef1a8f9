"""Small models whose encoder the critics or the actor teach."""

from stable_baselines3.common.env_util import make_vec_env

from sb3_bruno import RecurrentCrossQ, RecurrentSAC, RecurrentTD3, RecurrentTQC

POINT = "sb3_bruno_envs:PointDir-v0"
ALGORITHMS = [RecurrentSAC, RecurrentTQC, RecurrentCrossQ, RecurrentTD3]


def make_model(algorithm=RecurrentSAC, steps=70, **kwargs):
    """A model in mid-episode, before its first update."""
    settings = {"learning_starts": 1_000, "batch_size": 16, "policy_kwargs": {"net_arch": [16]}, "seed": 0}
    settings |= {"encoder_kwargs": {"hidden_size": 8}, "replay_buffer_kwargs": {"n_sequences": 4}, "device": "cpu"}
    settings |= {"buffer_size": 1_000}
    return algorithm("MlpPolicy", make_vec_env(POINT, 2, seed=0), **{**settings, **kwargs}).learn(steps)


class Stop(Exception):
    """Ends SB3's update."""


def stop(*_):
    raise Stop
