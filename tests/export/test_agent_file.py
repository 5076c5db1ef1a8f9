"""An agent that is loaded from an agent file acts and believes as the one that was saved, to the last bit."""

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from stable_baselines3.common.noise import NormalActionNoise, OrnsteinUhlenbeckActionNoise, VectorizedActionNoise
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
from torch import nn

from sb3_bruno import BrunoSAC, BrunoTD3, PearlSAC
from sb3_bruno.encoders import ENCODERS, HasPosterior, Predicts, Transitions
from sb3_bruno.export import load_agent, save_agent
from sb3_bruno.export.written_agent import WrittenAgent
from support.tiny_models import ALGORITHMS, POINT, assert_same, make_pendulum, make_point, normalized, rollout, tiny

BY_ENCODER = [name for name in ENCODERS if name not in {cls.default_encoder for cls in ALGORITHMS}]
AGENTS = [*((cls, {}) for cls in ALGORITHMS), *((BrunoSAC, {"encoder_class": name}) for name in BY_ENCODER)]
NAMES = [*(cls.__name__ for cls in ALGORITHMS), *BY_ENCODER]


def made(algorithm, env, **options):
    """A tiny agent, whose encoder is of its own default size if it is not the algorithm's."""
    arguments = tiny(algorithm, **options)
    if "encoder_class" in options:
        arguments = {name: value for name, value in arguments.items() if not name.startswith("encoder_")} | options
    return algorithm("MlpPolicy", env, **arguments)


def again(model, path, env=None):
    """Save an agent, and load it."""
    save_agent(model, path)
    return load_agent(path, env, device="cpu")


def steps_of(model, env):
    env.seed(3)
    th.manual_seed(0)  # of an encoder that samples
    return [(state, action) for _, state, action in rollout(model, env, 60)]


@pytest.mark.parametrize(("algorithm", "options"), AGENTS, ids=NAMES)
def test_a_loaded_agent_acts_and_believes_as_the_saved_one(algorithm, options, tmp_path):
    env = normalized(make_point)
    model = made(algorithm, env, **options)
    model.learn(45)
    env.training = False
    forgets = isinstance(model.encoder, Predicts) and (options or algorithm is BrunoSAC)
    model.policy.forget_threshold = 5.0 if forgets else None
    loaded = again(model, tmp_path / "point.agent")
    assert type(loaded) is algorithm
    assert (loaded.num_timesteps, loaded.seed, loaded.get_env()) == (45, 0, None)
    assert loaded.policy.forget_threshold == model.policy.forget_threshold
    steps = steps_of(model, env)
    assert_same(steps_of(loaded, env), steps)
    assert_same(loaded.policy.state_dict(), model.policy.state_dict())
    state = steps[-1][0]
    estimates = [agent.task_estimate(state) for agent in (loaded, model)]
    assert estimates[0].texts() == estimates[1].texts() and estimates[0].labels == model.task_labels
    assert_same(estimates[0].mean, estimates[1].mean)
    if isinstance(model.encoder, HasPosterior):
        seen = env.observation_space["observation"].shape[0]
        transitions = Transitions(*(np.full((7, dim), 0.1, np.float32) for dim in (seen, 2, 1, seen)))
        beliefs = [agent.infer(transitions) for agent in (loaded, model)]  # in the env's own units
        assert_same(beliefs[0].mean, beliefs[1].mean)
        if isinstance(model.encoder, Predicts):
            asked = [np.full(dim, 0.1, np.float32) for dim in (seen, 2, seen)]
            th.manual_seed(0)
            outcomes = [loaded.predict_outcomes(beliefs[0], *asked, n_samples=5)]
            th.manual_seed(0)
            outcomes.append(model.predict_outcomes(beliefs[1], *asked, n_samples=5))
            assert_same(outcomes[0].mean(), outcomes[1].mean())


def test_the_env_that_is_given_is_normalised_as_in_training(tmp_path):
    env = normalized(make_pendulum, norm_reward=True, clip_obs=3.0, norm_obs_keys=["observation", "reward"])
    model = made(BrunoSAC, env)
    model.learn(60)
    loaded = again(model, tmp_path / "pendulum.agent", make_pendulum())
    shown = loaded.get_env()
    assert isinstance(shown, VecNormalize)
    assert not shown.training
    raw = {key: space.sample()[None] for key, space in env.observation_space.spaces.items()}
    assert_same(shown.normalize_obs(raw), env.normalize_obs(raw))
    assert_same(shown.normalize_reward(np.ones(1)), env.normalize_reward(np.ones(1)))
    env.training = False
    assert_same(steps_of(loaded, shown), steps_of(model, env))


def test_with_an_env_it_learns_from_the_start_with_what_it_was_made_with(tmp_path):
    schedule = LinearSchedule(1e-3, 0.0, 1.0)
    model = made(BrunoSAC, make_point(), learning_rate=schedule, gamma=0.9, train_freq=(2, "step"), ent_coef="auto_0.5")
    model.learn(60)
    loaded = again(model, tmp_path / "point.agent", POINT)
    assert (loaded.gamma, tuple(loaded.train_freq), loaded.buffer_size) == (0.9, tuple(model.train_freq), 1_000)
    assert loaded.learning_rate(0.5) == schedule(0.5)
    assert_same(loaded.log_ent_coef.detach(), model.log_ent_coef.detach())
    assert loaded.replay_buffer.size() == 0
    loaded.learn(60)
    assert loaded.replay_buffer.size() == 60
    assert not th.equal(next(loaded.encoder.parameters()), next(model.encoder.parameters()))


def test_an_agent_that_reads_no_task_comes_back_as_such(tmp_path):
    loaded = again(made(PearlSAC, make_point(), task_readout=False), tmp_path / "point.agent")
    assert loaded.policy.readout is None


def test_tasks_that_are_many_are_read_as_before(tmp_path):
    env = DummyVecEnv([lambda: gym.make("sb3_bruno_envs:Wind-v0")])
    model = made(PearlSAC, env)
    model.learn(45)
    loaded = again(model, tmp_path / "wind.agent")
    state = steps_of(model, env)[-1][0]
    assert loaded.task_estimate(state).texts() == model.task_estimate(state).texts()
    assert loaded.task_labels == model.task_labels and model.task_labels.names


def test_without_an_env_it_refuses_to_learn_later_on(tmp_path):
    loaded = again(made(BrunoSAC, make_point()), tmp_path / "point.agent")
    loaded.set_env(DummyVecEnv([make_point]))
    for learn in (lambda: loaded.learn(60), lambda: loaded.train(1), loaded.fit_readout):
        with pytest.raises(ValueError, match=r"loaded without an env.*`load_agent\(path, env\)`"):
            learn()


@pytest.mark.parametrize(
    "options",
    [
        {"use_sde": True},
        {"encoder_tau": 0.01},
        {"critic_input": "both"},
        {"policy_kwargs": {"net_arch": {"pi": [8], "qf": [16, 8]}, "activation_fn": nn.Tanh}},
        {"policy_kwargs": {"optimizer_class": th.optim.AdamW, "optimizer_kwargs": {"weight_decay": 1e-3}}},
        {"encoder_kwargs": {"flow_class": "paper_maf", "flow_kwargs": None, "process": "gaussian", "extra_dims": 1}},
        {"encoder_kwargs": {"process": "kernel_student_t"}},
    ],
    ids=lambda options: "-".join(options),
)
def test_every_option_comes_back(options, tmp_path):
    env = DummyVecEnv([make_point])
    model = made(BrunoSAC, env, **options)
    loaded = again(model, tmp_path / "point.agent")
    assert_same(steps_of(loaded, env), steps_of(model, env))
    assert loaded.policy.optimizer_class is model.policy.optimizer_class
    assert loaded.policy.encoder_kwargs == model.policy.encoder_kwargs


@pytest.mark.parametrize(
    "noise",
    [
        NormalActionNoise(np.zeros(2), np.full(2, 0.1)),
        VectorizedActionNoise(OrnsteinUhlenbeckActionNoise(np.zeros(2), np.full(2, 0.1)), 1),
    ],
)
def test_action_noise_comes_back(noise, tmp_path):
    loaded = again(made(BrunoTD3, make_point(), action_noise=noise), tmp_path / "point.agent")
    assert repr(loaded.action_noise) == repr(getattr(noise, "base_noise", noise))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"learning_rate": lambda progress: 1e-3 * progress}, "`learning_rate` is <lambda>.* a function is not data"),
        ({"encoder_learning_rate": lambda progress: 1e-3}, "`encoder_learning_rate` is <lambda>"),
        ({"policy_kwargs": {"activation_fn": lambda: nn.ReLU()}}, r"`policy_kwargs.activation_fn` is <lambda>"),
    ],
)
def test_what_is_no_plain_data_is_refused_by_name(options, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        save_agent(made(BrunoSAC, make_point(), **options), tmp_path / "point.agent")
    assert not list(tmp_path.iterdir())


def test_weights_that_are_not_finite_are_not_saved(tmp_path):
    model = made(PearlSAC, make_point())
    with th.no_grad():
        next(model.policy.actor.parameters()).fill_(float("nan"))
    with pytest.raises(ValueError, match=r"the tensor 'policy\.actor.* not finite"):
        save_agent(model, tmp_path / "point.agent")


@pytest.mark.parametrize("statistic", ["mean", "var", "count"])
def test_an_agent_whose_normalisation_is_not_finite_is_neither_saved_nor_exported(statistic, tmp_path):
    env = normalized(make_point)
    model = made(PearlSAC, env)
    vars(env.obs_rms["reward"])[statistic] *= float("nan")
    for write, name in ((save_agent, "point.agent"), (PearlSAC.export, "point.pt")):
        with pytest.raises(ValueError, match=rf"normalisation has a {statistic} of observations\.reward that is not"):
            write(model, tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_what_would_not_be_loaded_is_not_saved(tmp_path):
    model = made(PearlSAC, make_point(), policy_kwargs={"net_arch": [4_097]})
    with pytest.raises(ValueError, match=r"'policy_kwargs\.net_arch' has 4097, and whole numbers up to 4,096 are"):
        save_agent(model, tmp_path / "point.agent")


def test_what_is_no_agent_or_no_path_is_refused(tmp_path):
    with pytest.raises(TypeError, match="no agent that infers a task"):
        save_agent(nn.Linear(1, 1), tmp_path / "point.agent")
    with pytest.raises(TypeError, match="`path=5` is no path: give the name of a file"):
        save_agent(made(PearlSAC, make_point()), 5)
    with pytest.raises(ValueError, match="cannot be written"):
        save_agent(made(PearlSAC, make_point()), tmp_path)


def test_the_same_agent_makes_the_same_bytes(tmp_path):
    model = made(PearlSAC, make_point())
    loaded = again(model, tmp_path / "first.agent")
    save_agent(loaded, tmp_path / "second.agent")
    assert (tmp_path / "second.agent").read_bytes() == (tmp_path / "first.agent").read_bytes()


def test_loading_draws_nothing_from_torch(tmp_path):
    save_agent(made(PearlSAC, make_point()), tmp_path / "point.agent")
    th.manual_seed(1)
    expected = th.rand(3)
    th.manual_seed(1)
    load_agent(tmp_path / "point.agent")
    assert_same(th.rand(3), expected)


@pytest.mark.parametrize(
    ("env", "message"),
    [
        (lambda: make_pendulum(), "spaces do not match"),
        (lambda: normalized(make_point), "brings the agent's own"),
    ],
)
def test_an_env_that_is_not_that_of_the_training_is_refused(env, message, tmp_path):
    save_agent(made(PearlSAC, make_point()), tmp_path / "point.agent")
    with pytest.raises(ValueError, match=message):
        load_agent(tmp_path / "point.agent", env())


def test_a_file_of_a_newer_format_asks_for_an_update():
    with pytest.raises(ValueError, match=r"version 2 of the format.*update"):
        WrittenAgent.read({"format": "sb3_bruno agent", "version": 2})


def test_the_room_can_be_entered_without_torch():
    script = "import sys, sb3_bruno.export; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
