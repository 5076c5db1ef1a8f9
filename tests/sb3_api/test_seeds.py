"""A seed reaches all random numbers, those of the replay buffer and of the read-out too, whenever it is given."""

import numpy as np
import torch as th
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.utils import set_random_seed

from support.tiny_models import POINT, assert_same


def parameters(model):
    return model.policy.state_dict()


def test_an_agent_that_is_seeded_later_learns_the_same_again(algorithm, make_model, tmp_path):
    make_model(seed=None, learning_starts=20).save(tmp_path / "agent")

    def run(seed):
        model = algorithm.load(tmp_path / "agent", env=make_vec_env(POINT, 1))
        model.set_random_seed(seed)
        return parameters(model.learn(30))

    first = run(3)
    assert_same(first, run(3))
    other = run(4)
    assert not all(th.equal(first[name], other[name]) for name in first if name.startswith("actor"))


def test_sb3s_global_seed_is_enough(make_model):
    def run():
        set_random_seed(0)
        env = make_vec_env(POINT, 1, seed=0)
        env.action_space.seed(0)
        return parameters(make_model(env, seed=None, learning_starts=20).learn(30))

    assert_same(run(), run())


def test_agents_of_different_seeds_draw_differently_from_one_file(make_model, tmp_path):
    make_model().learn(60).save_replay_buffer(tmp_path / "buffer")

    def rewards(seed):
        model = make_model(seed=seed)
        model.load_replay_buffer(tmp_path / "buffer")
        return model.replay_buffer.sample(16).rewards.numpy()

    np.testing.assert_array_equal(rewards(1), rewards(1))
    assert not np.array_equal(rewards(1), rewards(2))
