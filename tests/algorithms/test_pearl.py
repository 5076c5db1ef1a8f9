"""PEARL's sampled beliefs in an agent: drawn where episodes begin, kept until they end, shared where it learns."""

import inspect
import warnings

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env

from sb3_bruno import PearlSAC, TaskCrossQ, TaskSAC, TaskTD3, TaskTQC
from sb3_bruno.encoders import ProductOfGaussians
from sb3_bruno.evaluation import evaluate_adaptation
from sb3_bruno_envs import POINT_DIR_TASKS
from support.configs import settings_of, zoo_config
from support.tiny_models import POINT, TINY, TRIAL, assert_same, rollout

SAMPLE = {"net_arch": (16,), "belief": "sample"}
PROTOCOL = {**SAMPLE, "exploration_episodes": 1}


def make(env_id=POINT, n_envs=2, algorithm=PearlSAC, **kwargs):
    settings = {**TINY, "encoder_kwargs": SAMPLE, **kwargs}
    return algorithm("MlpPolicy", make_vec_env(env_id, n_envs, seed=0), **settings)


class Watch(BaseCallback):
    """Keeps the memory in which the agent acted at every step."""

    def __init__(self):
        super().__init__()
        self.memories = []

    def _on_step(self):
        self.memories.append(self.model._next_carried.memory)
        return True


def test_the_noise_is_drawn_where_an_episode_begins_and_stays_whatever_is_learned_meanwhile():
    watch, model = Watch(), make()
    model.learn(2 * 65, watch)  # two episodes of 30 steps, and five steps
    assert model._n_encoder_updates > 20
    noise = th.stack([memory.noise for memory in watch.memories])  # (step, env, latent_dim)
    starts = (noise[1:] != noise[:-1]).any(dim=-1).any(dim=-1).nonzero().flatten() + 1
    assert starts.tolist() == [30, 60]
    assert (noise[0] != noise[30]).all() and (noise[:, 0] != noise[:, 1]).all()


def test_in_trials_z_is_held_for_an_inner_episode():
    watch, model = Watch(), make(TRIAL, 1, encoder_kwargs=PROTOCOL)
    model.learn(70, watch)  # a trial of three episodes of 20 steps, and ten steps
    beliefs = th.stack([model.encoder.belief(memory)[0] for memory in watch.memories])
    starts = (beliefs[1:] != beliefs[:-1]).any(dim=-1).nonzero().flatten() + 1
    assert starts.tolist() == [20, 40, 60]
    assert [int(watch.memories[step].episodes) for step in (0, 19, 20, 40, 60)] == [1, 1, 2, 3, 1]
    th.testing.assert_close(beliefs[0], watch.memories[0].noise[0])  # of the prior


def test_an_agent_whose_z_is_drawn_repeats_itself_given_the_state_and_given_torchs_seed():
    model = make().learn(60)
    env = make_vec_env(POINT, 2, seed=0)
    for observation, state, _ in rollout(model, env, 4)[1:]:
        one, other = (model.predict(observation, state, deterministic=True) for _ in range(2))
        assert_same(one, other)
    played = []
    for seed in (1, 1, 2):
        th.manual_seed(seed)
        env.seed(0)
        played.append(np.stack([action for *_, action in rollout(model, env, 4)]))
    assert np.array_equal(played[0], played[1]) and not np.array_equal(played[0], played[2])


@pytest.mark.parametrize("encoder_kwargs", [SAMPLE, PROTOCOL])
def test_the_buffer_draws_once_for_each_sequence_also_for_the_target_encoder(monkeypatch, encoder_kwargs):
    """As long as the target equals the encoder, both believe the same."""
    model, beliefs = make(encoder_tau=0.5, encoder_kwargs=encoder_kwargs, learning_starts=1_000).learn(140), []

    def keep(made):
        beliefs.append(made)
        return made

    for encoder in (model.encoder, model.policy.encoder_target):
        real = encoder.prefix_beliefs
        monkeypatch.setattr(encoder, "prefix_beliefs", lambda *args, real=real: keep(real(*args)))
    for context in ("iid", "episode"):
        model.replay_buffer.context = context
        for _ in range(2):
            model.replay_buffer.forget_beliefs()
            model.replay_buffer.sample(16)
        now, by_target, again, _ = beliefs[-4:]  # (4, time + 1, latent_dim)
        th.testing.assert_close(now, by_target)
        assert (now[0, 0] != now[1, 0]).all() and (now[0, 0] != again[0, 0]).all()
        assert (now[:, 0] != now[:, 4]).all()  # not held: it learns from contexts of every length


@pytest.mark.parametrize("algorithm", [TaskTQC, TaskCrossQ, TaskTD3])
def test_its_encoder_learns_with_every_algorithm(algorithm):
    own = {"policy_delay": 1} if algorithm in (TaskCrossQ, TaskTD3) else {}
    model = make(algorithm=algorithm, encoder_class="product_of_gaussians", **own)
    before = [parameter.clone() for parameter in model.encoder.parameters()]
    model.learn(60)
    for parameter, old in zip(model.encoder.parameters(), before, strict=True):
        assert not th.equal(parameter, old)


def test_it_is_task_sac_with_a_name_and_logs_its_kl():
    model = make()
    named = TaskSAC("MlpPolicy", POINT, encoder_class="product_of_gaussians", **TINY)
    assert type(model.encoder) is type(named.encoder) and model.policy.critic_input == "belief"
    model.learn(60)
    assert model.logger.name_to_value["encoder/kl_nats"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("belief", ["mean_var", "sample"])
def test_pearl_sac_works_out_which_way_to_go(belief):
    config = zoo_config("pearl_sac", "PointDir-v0")
    env = make_vec_env(POINT, config["n_envs"], seed=0)
    settings = {**settings_of(config), "encoder_kwargs": {"belief": belief}, "seed": 0}
    model = PearlSAC("MlpPolicy", env, **settings).learn(int(config["n_timesteps"]))
    tasks = POINT_DIR_TASKS.tasks("test")
    returns = evaluate_adaptation(model, lambda: gym.make(POINT), tasks, n_episodes=8).mean_return()
    assert min(returns) > 0.8 * 28.5  # of what an agent that is told earns


@pytest.mark.parametrize(
    ("env_id", "kl_lambda", "n_tasks", "scale"),
    [
        ("PointGoal-v0", 0.1, 16, 100),
        ("SparsePointGoal-v0", 1.0, 16, 100),
        ("CheetahDir-v0", 0.1, 4, 5),
        ("CheetahVel-v0", 0.1, 16, 5),
        ("AntDir-v0", 0.1, 4, 5),
        ("AntDir2D-v0", 0.1, 4, 5),
        ("AntGoal-v0", 1.0, 10, 5),
        ("HopperParams-v0", 0.1, 10, 5),
        ("WalkerParams-v0", 0.1, 10, 5),
    ],
)
def test_the_zoo_weighs_the_kl_as_pearls_own_configs_do(env_id, kl_lambda, n_tasks, scale):
    """In the unit of SB3's SAC: there it is summed over a batch of tasks, and rewards are multiplied."""
    default = inspect.signature(ProductOfGaussians).parameters["kl_weight"].default
    weight = zoo_config("pearl_sac", env_id).get("encoder_kwargs", {}).get("kl_weight", default)
    assert weight == pytest.approx(kl_lambda * n_tasks / (2 * scale**2))


def test_who_explores_without_a_trial_is_warned():
    settings = {**TINY, "encoder_kwargs": {**PROTOCOL, "net_arch": (8,)}}
    with pytest.warns(UserWarning, match=r"exploration_episodes.*Trial"):
        PearlSAC("MlpPolicy", POINT, **settings).learn(2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        PearlSAC("MlpPolicy", TRIAL, **settings).learn(2)
