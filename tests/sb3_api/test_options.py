"""Every option of SB3 and of ours runs, and what cannot work is refused by name."""

from copy import deepcopy

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.noise import NormalActionNoise, OrnsteinUhlenbeckActionNoise
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecNormalize

from sb3_bruno import BrunoSAC, BrunoTD3, BrunoTQC, RecurrentCrossQ, RecurrentSAC
from sb3_bruno.diagnostics.diagnose import diagnose
from sb3_bruno.encoders import BrunoEncoder, Transitions
from sb3_bruno_envs import MetaTask, TransitionObservation
from support.tiny_models import (
    ALGORITHMS,
    BRUNO,
    LSTM,
    POINT,
    RECURRENT,
    assert_same,
    for_each,
    for_each_that_takes,
    n_absorbed,
)

EVERY_BASE = [BrunoTQC, BrunoTD3, RecurrentSAC, RecurrentCrossQ]
NOISE = {"mean": np.zeros(2), "sigma": 0.1 * np.ones(2)}
OPTIONS_OF_SB3 = [
    {"ent_coef": "auto_0.1"},
    {"ent_coef": 0.01},
    {"train_freq": 4},
    {"train_freq": (4, "step"), "gradient_steps": 2},
    {"train_freq": (1, "episode"), "gradient_steps": -1},
    {"action_noise": NormalActionNoise(**NOISE)},
    {"action_noise": OrnsteinUhlenbeckActionNoise(**NOISE)},
    {"use_sde": True, "sde_sample_freq": 4},
    {"use_sde": True, "use_sde_at_warmup": True, "policy_kwargs": {"use_expln": True}},
    {"tau": 1.0, "target_update_interval": 4},
    {"buffer_size": 1, "batch_size": 2},
    {"policy_kwargs": {"n_critics": 1}},
    {"policy_kwargs": {"n_critics": 3, "net_arch": {"pi": [8], "qf": [8, 8]}}},
    {"policy_kwargs": {"optimizer_class": th.optim.AdamW, "optimizer_kwargs": {"weight_decay": 0.1}}},
    {"policy_kwargs": {"net_arch": []}},
    {"learning_starts": 0},
]
OUR_OPTIONS = [
    {"learning_rate": LinearSchedule(1e-3, 1e-4, 0.5), "encoder_learning_rate": LinearSchedule(1e-3, 1e-4, 0.5)},
    {"learning_rate": lambda left: left * 1e-3, "encoder_learning_rate": lambda left: left * 1e-3},
    {"learning_starts": 0, "encoder_learning_starts": 0},
    {"encoder_learning_starts": 10},
    {"encoder_learning_starts": 60},
    {"encoder_update_ratio": 0.25},
    {"encoder_update_ratio": 2},
    {"buffer_size": 20},  # shorter than an episode
    {"batch_size": 3},  # fewer than sequences
    {"replay_buffer_kwargs": {"context": "episode"}},
    {"replay_buffer_kwargs": {"handle_timeout_termination": False}},
    {"critic_input": "belief"},
    {"critic_input": "both"},
    {"encoder_tau": 0.1},
    {"encoder_kwargs": {"modelled": "next_observations"}},
    {"encoder_kwargs": {"process": "kernel_student_t", "n_weights": 3, "net_arch": (16,)}},
    {"encoder_kwargs": {"process": "gaussian", "flow_class": "paper_maf", "flow_kwargs": None, "extra_dims": 1}},
    {"encoder_kwargs": {"process": "kernel", "belief": "mean"}},
    LSTM,
    {"encoder_kwargs": {"learns_from": "actor"}},
    {"encoder_kwargs": {"learns_from": "actor"}, "critic_input": "both", "encoder_tau": 0.1},
    {"encoder_kwargs": {"max_grad_norm": None}},
    {"learning_rate": 1e-3, "encoder_learning_rate": LinearSchedule(1e-3, 1e-4, 0.5)},
]
OTHERS = [algorithm for algorithm in ALGORITHMS if algorithm not in (*BRUNO, *RECURRENT)]
OPTIONS_OF_OTHERS = [
    {"train_freq": (1, "episode"), "gradient_steps": -1},
    {"buffer_size": 1, "batch_size": 2},
    {"learning_starts": 0, "encoder_learning_starts": 0},
    {"encoder_tau": 0.1, "critic_input": "belief"},
    {"encoder_kwargs": {"learns_from": "actor"}, "critic_input": "both"},
    {"encoder_kwargs": {"bottleneck": 1e-2, "head": "mixture", "belief": "moments"}},
]


@for_each_that_takes(*OPTIONS_OF_SB3, algorithms=EVERY_BASE)
def test_every_option_of_sb3_learns(make_model, options):
    check_learning(make_model(**options), options)


@for_each_that_takes(*OUR_OPTIONS, algorithms=[BrunoSAC, RecurrentCrossQ])
def test_every_option_of_ours_learns(make_model, options):
    check_learning(make_model(**options), options)


@for_each_that_takes(*OPTIONS_OF_OTHERS, algorithms=OTHERS)
def test_options_of_other_encoders_learn(make_model, options):
    check_learning(make_model(**options), options)


def check_learning(model, options):
    before = deepcopy(model.get_parameters()["policy"])
    model.learn(70)
    after = model.get_parameters()["policy"]
    assert model.num_timesteps >= 70
    assert all(value.isfinite().all() for value in after.values())
    parts = ["actor.", "critic.", "critic_target.", "encoder."]
    if options.get("buffer_size") == 1 and model.encoder.order == "time":
        parts.remove("encoder.")  # the one transition has none before it, so its belief teaches nothing
    for part in parts:
        of_it = [name for name in before if name.startswith(part)]  # CrossQ has no targets
        assert not of_it or any(not th.equal(before[name], after[name]) for name in of_it)


@for_each([BrunoSAC])
def test_the_last_transitions_of_a_task_may_be_its_context(make_model):
    assert make_model(replay_buffer_kwargs={"context": "recent", "n_recent": 10}).learn(70)._n_encoder_updates > 0


@pytest.mark.parametrize("train_freq", ["4", ("1", "episode"), (1, "close")])
def test_a_train_freq_that_sb3_refuses_is_refused(make_model, train_freq):
    with pytest.raises(ValueError, match=r"train_freq|train frequency|invalid literal|integer"):
        make_model(train_freq=train_freq).learn(1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"policy": "CnnPolicy"}, "CnnPolicy"),
        ({"n_steps": 3}, "n_steps=3"),
        ({"optimize_memory_usage": True}, "optimize_memory_usage"),
        ({"policy_kwargs": {"features_extractor_kwargs": {"features_dim": 3}}}, "features_extractor_kwargs"),
        ({"replay_buffer_kwargs": {"context": "future"}}, "'future'"),
        ({"encoder_batch_size": 0}, "encoder_batch_size"),  # or at all, where the critics teach the encoder
        ({"encoder_update_ratio": -1.0}, "encoder_update_ratio"),
        ({"critic_input": "reward"}, "critic_input"),
        ({"policy_kwargs": {"critic_input": "both"}}, r"policy_kwargs.*critic_input"),
        ({"env": "Pendulum-v1"}, "TransitionObservation"),
    ],
    ids=str,
)
def test_what_cannot_work_is_refused_by_name(make_model, options, message):
    with pytest.raises(ValueError, match=message):
        make_model(**options)


@for_each(ALGORITHMS)
def test_both_names_and_the_class_mean_the_same_policy(make_model):
    model = make_model(policy="MlpPolicy")
    for policy in ("MultiInputPolicy", type(model.policy)):
        assert_same(model.get_parameters(), make_model(policy=policy).get_parameters())


@pytest.mark.parametrize("n_envs", [1, 3])
def test_gradient_steps_count_the_transitions_of_all_envs(make_model, n_envs):
    env = make_vec_env(POINT, n_envs, seed=0)
    noise = NormalActionNoise(**NOISE)  # SB3 makes it one noise per env
    model = make_model(env, learning_starts=0, train_freq=5, gradient_steps=-1, action_noise=noise)
    model.learn(15 * n_envs)
    assert model._n_updates == 15 * n_envs
    assert model.replay_buffer.size() == 15


@for_each([BrunoSAC, RecurrentSAC])
def test_envs_in_subprocesses(make_model):
    env = make_vec_env(POINT, 2, seed=0, vec_env_cls=SubprocVecEnv, vec_env_kwargs={"start_method": "fork"})
    try:
        model = make_model(env).learn(80)
        evaluate_policy(model, env, n_eval_episodes=2)
    finally:
        env.close()
    taskless = SubprocVecEnv([lambda: TransitionObservation(gym.make("Pendulum-v1"))], start_method="fork")
    try:
        with pytest.raises(ValueError, match="no `task_space`"):
            make_model(taskless)
    finally:
        taskless.close()


class MatrixEnv(gym.Env):
    """Observations (2, 3) and actions (2, 2), both float64; the actions' bounds are lopsided."""

    observation_space = spaces.Box(-1.0, 1.0, (2, 3), np.float64)
    action_space = spaces.Box(-1.0, 3.0, (2, 2), np.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.np_random.uniform(-1.0, 1.0, (2, 3)), {}

    def step(self, action):
        assert self.action_space.contains(action)
        return self.np_random.uniform(-1.0, 1.0, (2, 3)), float(action.sum()), False, False, {}


def matrix_env():
    return TransitionObservation(MetaTask(gym.wrappers.TimeLimit(MatrixEnv(), 20)))


@for_each_that_takes({}, {"use_sde": True})
def test_matrices_of_float64(make_model, options):
    env = matrix_env()
    model = make_model(env, **options).learn(60)
    action, _ = model.predict(env.reset(seed=0)[0])
    assert env.action_space.contains(action)


@pytest.mark.parametrize("normalize", [False, True])
@for_each([BrunoSAC])
def test_what_is_believed_of_matrices(make_model, normalize):
    env = DummyVecEnv([matrix_env])
    env = VecNormalize(env, norm_reward=False, norm_obs_keys=["observation", "reward"]) if normalize else env
    model = make_model(env, encoder_kwargs={"modelled": "both"}).learn(60)
    rng = np.random.default_rng(0)
    seen, actions, rewards, arrived = (rng.uniform(-1, 1, (5, 7, *shape)) for shape in ((2, 3), (2, 2), (1,), (2, 3)))
    flat = [array.reshape(5, 7, -1) for array in (seen, actions, rewards, arrived)]
    belief, of_flat = model.infer(Transitions(seen, actions, rewards, arrived)), model.infer(Transitions(*flat))
    np.testing.assert_array_equal(belief.mean, of_flat.mean)
    outcomes = model.predict_outcomes(belief, seen[:, 0], actions[:, 0], n_samples=50)
    assert outcomes.rewards.shape == (50, 5, 1) and outcomes.next_observations.shape == (50, 5, 6)
    vec_normalize = env if normalize else None
    found = diagnose(model, matrix_env, np.zeros((1, 1)), n_episodes=2, vec_normalize=vec_normalize)
    assert len(found.quantities) == 1 + 6 and found.pit.shape[-1] == 7


@for_each([BrunoSAC])
def test_sequences_too_short_for_the_objective_are_refused_at_once(make_model):
    with pytest.raises(ValueError, match=r"`sequence_length=1` is too short .*sequence_length=2"):
        make_model(encoder_kwargs={"objective": "holdout"}, replay_buffer_kwargs={"sequence_length": 1})


@for_each([BrunoSAC])
def test_training_never_forgets(make_model, monkeypatch):
    monkeypatch.setattr(BrunoEncoder, "log_bayes_factor", lambda *given: th.ones_like(given[-1].rewards[..., 0]))
    for ratio in (0, 1):  # whether or not the running episodes are encoded again
        model = make_model(policy_kwargs={"forget_threshold": 0.5}, encoder_update_ratio=ratio, learning_starts=5)
        model.learn(25)
        assert model._carried.suspicion is None and n_absorbed(model, model._carried.memory) == [24]
