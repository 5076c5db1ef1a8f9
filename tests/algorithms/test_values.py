"""A value that cannot be meant is refused at construction, by argument, value and remedy."""

import numpy as np
import pytest
from stable_baselines3.common.noise import NormalActionNoise

from sb3_bruno import BrunoSAC, BrunoTD3, BrunoTQC, RecurrentSAC
from sb3_bruno.algorithms.values import check_values
from sb3_bruno.encoders import BrunoEncoder, CausalTransformer, RandomFeatures, RecurrentEncoder

POINT = "sb3_bruno_envs:PointDir-v0"
SMALL = {"policy_kwargs": {"net_arch": [8]}, "buffer_size": 100}


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ({"batch_size": 0}, ValueError),
        ({"batch_size": -1}, ValueError),
        ({"batch_size": "many"}, TypeError),
        ({"batch_size": 2.5}, TypeError),
        ({"batch_size": True}, TypeError),
        ({"buffer_size": 1e5}, TypeError),
        ({"buffer_size": 0}, ValueError),
        ({"gradient_steps": -2}, ValueError),
        ({"gradient_steps": "1"}, TypeError),
        ({"gradient_steps": 0.5}, TypeError),
        ({"learning_starts": -1}, ValueError),
        ({"learning_starts": [100]}, TypeError),
        ({"learning_starts": 0.5}, TypeError),
        ({"train_freq": 0}, ValueError),
        ({"train_freq": "1"}, ValueError),
        ({"train_freq": (1, "steps")}, ValueError),
        ({"n_steps": 0}, ValueError),
        ({"stats_window_size": 0}, ValueError),
        ({"verbose": "loud"}, TypeError),
        ({"seed": "one"}, TypeError),
        ({"seed": -1}, ValueError),
        ({"target_update_interval": 0}, ValueError),
        ({"learning_rate": "lin-1e-3"}, TypeError),
        ({"learning_rate": [1e-3]}, TypeError),
        ({"encoder_learning_rate": "fast"}, TypeError),
        ({"encoder_batch_size": 1.5}, TypeError),
        ({"encoder_learning_starts": "now"}, TypeError),
        ({"encoder_update_ratio": "half"}, TypeError),
        ({"encoder_tau": "slow"}, TypeError),
        ({"gamma": "0.9"}, TypeError),
        ({"tau": [0.1]}, TypeError),
        ({"ent_coef": "auto-0.1"}, ValueError),
        ({"target_entropy": "low"}, ValueError),
        ({"use_sde": "yes"}, TypeError),
        ({"task_readout": 5}, TypeError),
        ({"encoder_kwargs": 3}, TypeError),
        ({"policy_kwargs": "net_arch"}, TypeError),
        ({"replay_buffer_kwargs": ["context"]}, TypeError),
        ({"action_noise": 0.1}, TypeError),
        ({"tensorboard_log": 1}, TypeError),
        ({"device": "gpu"}, ValueError),
        ({"batch_size": None}, TypeError),
        ({"gamma": None}, TypeError),
        ({"replay_buffer_class": "TaskReplayBuffer"}, TypeError),
        ({"learning_rate": None}, TypeError),
        ({"ent_coef": None}, ValueError),
        ({"target_entropy": None}, ValueError),
        ({"train_freq": None}, ValueError),
        ({"stats_window_size": None}, TypeError),
        ({"ent_coef": "auto_inf"}, ValueError),
    ],
    ids=str,
)
def test_an_argument_is_named_with_its_value_and_a_remedy(given, error):
    ((name, value),) = given.items()
    with pytest.raises(error) as told:
        BrunoSAC("MlpPolicy", POINT, **given)
    assert str(told.value).startswith(f"`{name}={value!r}` is ") and ": give " in str(told.value)


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"replay_buffer_kwargs": {"n_sequences": 1.5}}, "`n_sequences=1.5` is no whole number"),
        ({"replay_buffer_kwargs": {"n_recent": "a"}}, "`n_recent='a'` is no whole number"),
        ({"replay_buffer_kwargs": {"sequence_length": None}}, "`sequence_length=None` is no value of it"),
        (
            {"replay_buffer_kwargs": {"handle_timeout_termination": "no"}},
            "`handle_timeout_termination='no'` is neither",
        ),
        ({"replay_buffer_kwargs": {3: 4}}, "`replay_buffer_kwargs` has no `3`"),
        ({"replay_buffer_class": "TaskReplayBuffer"}, "`replay_buffer_class='TaskReplayBuffer'` is no class"),
        ({"encoder_kwargs": {"n_weights": None}}, "`n_weights=None` is no value of it: leave it out for "),
        ({"encoder_kwargs": {"net_arch": 3}}, "`net_arch` must hold the size of each layer"),
        ({"encoder_kwargs": {"net_arch": (8, 0)}}, "`net_arch` must hold the size of each layer"),
        ({"encoder_update_ratio": np.inf}, "`encoder_update_ratio` must be finite"),
        ({"critic_input": ["task"]}, "`critic_input` must be 'task', 'belief' or 'both'"),
    ],
    ids=str,
)
def test_what_would_fail_later_or_be_taken_for_something_else_is_refused(given, line):
    with pytest.raises((TypeError, ValueError)) as told:
        BrunoSAC(**{"policy": "MlpPolicy", "env": POINT, **SMALL, **given})
    assert line in str(told.value)


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"net_ach": [8]}, "`policy_kwargs` has no `net_ach`: did you mean `net_arch`?"),
        ({"critics": 3}, "`policy_kwargs` has no `critics`: did you mean `n_critics`?"),
        ({"optimizer_kwargs": {"weigth_decay": 0.1}}, "`optimizer_kwargs` has no `weigth_decay`: did you mean"),
        ({"optimizer_kwargs": {"lr": 0.1}}, "`optimizer_kwargs` has no `lr`"),
        ({"net_arch": 3}, "`net_arch=3` is no list"),
        ({"net_arch": [64, "64"]}, "`net_arch='64'` is no whole number"),
        ({"net_arch": [0]}, "`net_arch=0` is too small"),
        ({"net_arch": {"pi": [8], "vf": [8]}}, "`net_arch['vf']` is unknown"),
        ({"n_critics": 0}, "`n_critics=0` is too small"),
        ({"net_arch": {"pi": [8]}}, "`net_arch={'pi': [8]}` lacks a net"),
        ({"use_sde": True}, "pass `use_sde=...` to the algorithm itself"),
        ({"activation_fn": "relu"}, "`activation_fn='relu'` is no class"),
        ({"optimizer_class": "adam"}, "`optimizer_class='adam'` is no class"),
        ({"log_std_init": "low"}, "`log_std_init='low'` is no number"),
        ({"forget_threshold": "a"}, "`forget_threshold='a'` is no number"),
    ],
    ids=str,
)
def test_what_a_policy_does_not_take_is_named(given, line):
    with pytest.raises((TypeError, ValueError)) as told:
        BrunoSAC("MlpPolicy", POINT, policy_kwargs=given)
    assert line in str(told.value)


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"env": None}, "`env=None` has no observations"),
        ({"encoder_kwargs": {"extra_dims": "x"}}, "`extra_dims='x'` is no whole number"),
        ({"encoder_kwargs": {"extra_dims": 0.5}}, "`extra_dims=0.5` is no whole number"),
        ({"replay_buffer_kwargs": {"sequence_length": "x"}}, "`sequence_length='x'` is no whole number"),
        ({"policy_kwargs": {"activation_fn": "relu"}}, "`activation_fn='relu'` is no class"),
        ({"policy_kwargs": {"optimizer_class": "adam"}}, "`optimizer_class='adam'` is no class"),
        ({"policy_kwargs": {"forget_threshold": "high"}}, "`forget_threshold='high'` is no number"),
    ],
    ids=str,
)
def test_what_is_inside_an_argument_is_named_too(given, line):
    with pytest.raises((TypeError, ValueError)) as told:
        BrunoSAC("MlpPolicy", **{"env": POINT, **given})
    assert line in str(told.value)


def test_siblings_refuse_values_of_their_own():
    with pytest.raises(ValueError, match="policy_delay=0"):
        BrunoTD3("MlpPolicy", POINT, policy_delay=0)
    with pytest.raises(TypeError, match="target_policy_noise='loud'"):
        BrunoTD3("MlpPolicy", POINT, target_policy_noise="loud")
    with pytest.raises(ValueError, match="top_quantiles_to_drop_per_net=-1"):
        BrunoTQC("MlpPolicy", POINT, top_quantiles_to_drop_per_net=-1)
    with pytest.raises(ValueError, match="top_quantiles_to_drop_per_net=25` leaves none of the 25 quantiles"):
        BrunoTQC("MlpPolicy", POINT, **SMALL, top_quantiles_to_drop_per_net=25)
    with pytest.raises(TypeError, match="`hidden_size='8'` is no whole number"):
        RecurrentSAC("MlpPolicy", POINT, **SMALL, encoder_kwargs={"hidden_size": "8"})
    with pytest.raises(TypeError, match="encoder_kwargs=3"):
        RecurrentSAC("MlpPolicy", POINT, encoder_kwargs=3)
    with pytest.raises(ValueError, match="`policy_kwargs` has no `n_quantile`: did you mean `n_quantiles`"):
        BrunoTQC("MlpPolicy", POINT, policy_kwargs={"n_quantile": 3})


def test_what_sb3_takes_is_taken():
    noise = NormalActionNoise(np.zeros(2), np.ones(2))
    given = {"batch_size": np.int64(8), "gradient_steps": -1, "train_freq": (2, "step"), "action_noise": noise}
    given |= {"learning_rate": lambda left: 1e-3 * left, "ent_coef": "auto_0.1", "target_entropy": -1, "seed": None}
    given |= {"learning_starts": 1e2, "verbose": True}
    check_values({**given, "train_freq": [1, "episode"], "ent_coef": 0.1, "learning_rate": np.float32(1e-3)})
    assert BrunoSAC("MlpPolicy", POINT, **SMALL, **given).gradient_steps == -1


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"total_timesteps": "100"}, "`total_timesteps='100'` is no number"),
        ({"total_timesteps": None}, "`total_timesteps=None` is no number"),
        ({"total_timesteps": np.nan}, "`total_timesteps=nan` is none: give a number"),
        ({"total_timesteps": -5}, "`total_timesteps=-5` is none: give a number"),
        ({"total_timesteps": 10, "log_interval": 0}, "`log_interval=0` is no interval"),
        ({"total_timesteps": 10, "log_interval": "a"}, "`log_interval='a'` is no whole number"),
    ],
    ids=str,
)
def test_learn_refuses_what_it_cannot_count_to(given, line):
    model = BrunoSAC("MlpPolicy", POINT, **SMALL)
    with pytest.raises((TypeError, ValueError)) as told:
        model.learn(**given)
    assert line in str(told.value)
    assert model.learn(1e0, log_interval=None).num_timesteps == 1


TRUE_FOR_A_NUMBER = [
    *({name: True} for name in ("batch_size", "learning_starts", "gamma", "tau", "learning_rate", "ent_coef", "seed")),
    *({name: True} for name in ("train_freq", "gradient_steps", "target_entropy", "encoder_tau", "stats_window_size")),
    *({f"encoder_{name}": True} for name in ("batch_size", "update_ratio", "learning_starts", "learning_rate")),
    *({"encoder_kwargs": {name: True}} for name in ("n_weights", "extra_dims")),
    *({"replay_buffer_kwargs": {name: True}} for name in ("n_sequences", "sequence_length", "n_recent")),
    *({"policy_kwargs": {name: True}} for name in ("forget_threshold", "n_critics", "log_std_init", "clip_mean")),
    {"policy_kwargs": {"net_arch": [True]}},
]


@pytest.mark.parametrize("given", TRUE_FOR_A_NUMBER, ids=str)
def test_true_is_no_number(given):
    with pytest.raises((TypeError, ValueError), match=r"=True|=.True, |got True"):
        BrunoSAC("MlpPolicy", POINT, **given)


@pytest.mark.parametrize("nats", [True, False, np.True_, "5", 0, -1.0, float("nan"), [5.0]])
def test_a_threshold_that_is_set_later_is_positive_nats(nats):
    model = BrunoSAC("MlpPolicy", POINT, **SMALL)
    with pytest.raises(ValueError, match="`forget_threshold` must be positive nats, got "):
        model.policy.forget_threshold = nats
    assert model.policy.forget_threshold is None


@pytest.mark.parametrize(
    ("encoder", "arguments"),
    [
        (BrunoEncoder, {"n_weights": True}),
        (BrunoEncoder, {"extra_dims": True, "process": "gaussian"}),
        (BrunoEncoder, {"net_arch": (True,)}),
        (RecurrentEncoder, {"hidden_size": True}),
        (CausalTransformer, {"window": True}),
        (RandomFeatures, {"n_features": True}),
    ],
)
def test_true_is_no_size_of_an_encoder(encoder, arguments):
    with pytest.raises(ValueError, match=r"got .*True"):
        encoder(2, 2, **arguments)
