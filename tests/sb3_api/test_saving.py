"""What is saved comes back: parameters, options, replay buffers, and nothing that was excluded."""

from copy import deepcopy

import numpy as np
import pytest
import torch as th
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from sb3_bruno.buffers.task_ring import _RING as RING
from sb3_bruno.encoders import HasPosterior
from support.tiny_models import (
    BRUNO,
    LSTM,
    POINT,
    RECURRENT,
    TINY_BRUNO,
    assert_carries,
    assert_same,
    for_each,
    for_each_in_turn,
    for_each_that_takes,
    make_pendulum,
    rollout,
)


@for_each_that_takes({}, {"ent_coef": 0.01, "use_sde": True, "critic_input": "both"}, {**LSTM, "encoder_tau": 0.1})
def test_a_loaded_model_has_the_same_parameters_actions_and_beliefs(algorithm, make_model, tmp_path, options):
    env = make_vec_env(make_pendulum, 2)
    model = make_model(env, **options).learn(70)
    model.save(tmp_path / "model")
    loaded = algorithm.load(tmp_path / "model", env=env, device="cpu")
    without_env = algorithm.load(tmp_path / "model", device="cpu")
    for copy in (loaded, without_env):
        assert_same(model.get_parameters(), copy.get_parameters())
    for observation, state, action in rollout(model, env, 10):
        predicted = model.predict(observation, state, deterministic=True)
        for copy in (loaded, without_env):
            assert_same(copy.predict(observation, state, deterministic=True), predicted)
            if isinstance(model.encoder, HasPosterior):
                assert_same(model.belief(state).mean, copy.belief(state).mean)
        assert env.action_space.contains(action[0])
    without_env.set_env(env)
    for copy in (loaded, without_env):
        copy.learn(20, reset_num_timesteps=False)
        assert copy.num_timesteps == 90


@for_each(BRUNO)
def test_a_model_keeps_its_encoder_options_when_loaded(algorithm, make_model, tmp_path):
    options = {"encoder_learning_rate": 3e-4, "encoder_batch_size": 5, "encoder_update_ratio": 0.3}
    make_model(critic_input="both", encoder_learning_starts=7, **options).save(tmp_path / "model")
    loaded = algorithm.load(tmp_path / "model", encoder_batch_size=6, custom_objects={"encoder_update_ratio": 0.4})
    assert (loaded.encoder_learning_rate, loaded.encoder_learning_starts) == (3e-4, 7)
    assert (loaded.encoder_batch_size, loaded.encoder_update_ratio) == (6, 0.4)
    assert loaded.policy.critic_input == "both"
    assert loaded.encoder_optimizer.param_groups[0]["lr"] == 3e-4


@for_each(RECURRENT)
def test_a_recurrent_model_keeps_its_encoder_options_when_loaded(algorithm, make_model, tmp_path):
    encoder_kwargs = {"cell": "lstm", "hidden_size": 4, "learns_from": "actor", "max_grad_norm": None}
    make_model(encoder_kwargs=encoder_kwargs, encoder_tau=0.2, encoder_learning_rate=3e-4).save(tmp_path / "model")
    loaded = algorithm.load(tmp_path / "model", custom_objects={"encoder_learning_rate": 2e-4})
    encoder, target = loaded.encoder, loaded.policy.encoder_target
    assert (encoder.belief_dim, encoder.learns_from, encoder.max_grad_norm) == (4, "actor", None)
    assert (loaded.encoder_tau, loaded.encoder_learning_rate, loaded.policy.critic_input) == (0.2, 2e-4, "task")
    assert isinstance(target.rnn, th.nn.LSTM) and loaded.replay_buffer_kwargs["context"] == "episode"
    with pytest.raises(ValueError, match=r"`encoder_kwargs=\{'cell': 'gru'\}` is not what"):
        algorithm.load(tmp_path / "model", encoder_kwargs={"cell": "gru"})


@for_each(BRUNO)
def test_load_does_not_ignore_how_the_encoder_is_to_be_built(algorithm, make_model, tmp_path):
    make_model(critic_input="both").save(tmp_path / "model")
    algorithm.load(tmp_path / "model", critic_input="both", encoder_kwargs=TINY_BRUNO)
    with pytest.raises(ValueError, match="`critic_input='task'` is not what the model was saved with, 'both'"):
        algorithm.load(tmp_path / "model", critic_input="task")
    with pytest.raises(ValueError, match=r"`encoder_kwargs=\{'n_weights': 2\}` is not what"):
        algorithm.load(tmp_path / "model", encoder_kwargs={"n_weights": 2})


@for_each(BRUNO)
def test_a_threshold_that_was_set_on_the_policy_is_saved(algorithm, make_model, tmp_path):
    model = make_model()
    model.policy.forget_threshold = 10.0
    model.save(tmp_path / "model")
    assert algorithm.load(tmp_path / "model").policy.forget_threshold == 10.0


def test_attributes_are_excluded_and_included_by_name(algorithm, make_model, tmp_path):
    make_model(verbose=2).save(tmp_path / "model", exclude=["verbose"])
    assert algorithm.load(tmp_path / "model").verbose == 0
    make_model(verbose=2).save(tmp_path / "model", exclude=["verbose"], include=["verbose"])
    assert algorithm.load(tmp_path / "model").verbose == 2


def test_policy_and_actor_are_saved_alone(tmp_path, trained):
    observation = make_pendulum().reset(seed=1)[0]
    extended, _ = trained.policy.extend(observation)
    trained.policy.save(tmp_path / "policy")
    trained.actor.save(tmp_path / "actor")
    policy = type(trained.policy).load(tmp_path / "policy", device="cpu")
    actor = type(trained.actor).load(tmp_path / "actor", device="cpu")
    assert_same(policy.state_dict(), trained.policy.state_dict())
    expected, state = trained.predict(observation, deterministic=True)
    assert_same(policy.predict(observation, deterministic=True), (expected, state))
    assert_same(actor.predict(extended.numpy(), deterministic=True)[0], expected)


def test_parameters_move_from_model_to_model(make_model):
    source, target = make_model(seed=1).learn(60), make_model(seed=2)
    target.set_parameters(source.get_parameters())
    assert_same(target.get_parameters(), source.get_parameters())

    parameters = source.get_parameters()
    assert {"policy", "encoder_optimizer", "actor.optimizer"} <= parameters.keys()
    with pytest.raises(ValueError, match="unknown"):
        target.set_parameters({**parameters, "unknown": {}}, exact_match=False)
    del parameters["encoder_optimizer"]
    with pytest.raises(ValueError, match="encoder_optimizer"):
        target.set_parameters(parameters)
    target.set_parameters(parameters, exact_match=False)
    given = source.get_parameters()
    given["policy"] = dict(list(given["policy"].items())[1:])
    for error in (RuntimeError, ValueError):  # SB3's, and ours everywhere else
        with pytest.raises(error, match=r"not those of such an agent.*Give its own"):
            target.set_parameters(given)


def test_a_replay_buffer_comes_back_and_is_learned_from(make_model, tmp_path):
    model = make_model().learn(50)
    model.save_replay_buffer(tmp_path / "buffer")
    other = make_model(seed=1, learning_starts=0)
    other.load_replay_buffer(tmp_path / "buffer")
    for name in RING:
        assert_same(getattr(model.replay_buffer, name), getattr(other.replay_buffer, name))
    assert len(model.replay_buffer.tasks) == len(other.replay_buffer.tasks)
    other.learn(30)
    assert (other.replay_buffer.size(), other._n_updates) == (80, 30)


@for_each_in_turn("truncate", [True, False])
def test_a_replay_buffer_may_be_loaded_in_mid_episode(make_model, tmp_path, truncate):
    model = make_model(learning_starts=1_000).learn(50)  # 20 steps into the second episode
    model.save_replay_buffer(tmp_path / "buffer")
    model.load_replay_buffer(tmp_path / "buffer", truncate_last_traj=truncate)
    model.learn(5, reset_num_timesteps=False)
    _, length = model.replay_buffer.episodes.holding(np.array([54]))
    assert length[0] == (5 if truncate else 25)
    assert_carries(model, [length[0]])


def test_a_replay_buffer_of_another_number_of_envs_is_refused(make_model, tmp_path):
    make_model(make_vec_env(POINT, 2)).save_replay_buffer(tmp_path / "buffer")
    with pytest.raises(ValueError, match="`n_envs=2`, the model has 1"):
        make_model().load_replay_buffer(tmp_path / "buffer")


def test_a_copied_model_learns(make_model):
    model = make_model().learn(50)
    twin = deepcopy(model)
    assert_same(twin.get_parameters(), model.get_parameters())
    twin.learn(20, reset_num_timesteps=False)
    assert (twin._n_updates, model._n_updates) == (30, 10)


def test_a_buffer_of_another_algorithm_is_refused(make_model, tmp_path):
    SAC("MultiInputPolicy", POINT, buffer_size=10).save_replay_buffer(tmp_path / "buffer")
    with pytest.raises(ValueError, match="TaskReplayBuffer"):
        make_model().load_replay_buffer(tmp_path / "buffer")
