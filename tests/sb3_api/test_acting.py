"""predict: one observation or many, the same every time, with a belief that nobody changes behind its back."""

from copy import deepcopy

import numpy as np
import pytest
import torch as th
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

from sb3_bruno import BrunoEncoder, RecurrentEncoder, Transitions
from sb3_bruno.encoders import ProductOfGaussians, RecurrentVae, SupervisedBelief
from sb3_bruno.encoders.base import training_mode
from support.tiny_models import assert_same, make_pendulum, rollout


def test_predict_takes_one_observation_or_many(trained):
    env = make_pendulum()
    observation = env.reset(seed=0)[0]
    action, _ = trained.predict(observation, deterministic=True)
    assert action.shape == (1,)
    many = {key: np.stack([value] * 4) for key, value in observation.items()}
    actions, states = trained.predict(many, deterministic=True)
    assert actions.shape == (4, 1)
    np.testing.assert_allclose(actions, np.stack([action] * 4), atol=1e-6)
    assert all(len(part) == 4 for part in states)
    with pytest.raises(ValueError, match="mixing Gym API"):
        trained.predict(env.reset())


class DropoutEncoder(BrunoEncoder):
    """Forgets half of what it sees, in training."""

    def see(self, transitions, noise=None):
        seen = super().see(transitions, noise)
        return seen._replace(z=th.nn.functional.dropout(seen.z, training=self.training))


class DropoutRecurrentEncoder(RecurrentEncoder):
    """Forgets half of the features that it reads, in training."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.features.append(th.nn.Dropout())


class DropoutProduct(ProductOfGaussians):
    """Forgets half of the factors that it reads, in training."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.network.append(th.nn.Dropout())


def dropping_out(encoder_class):
    """A subclass that forgets half of what its network reads, in training."""

    class Dropout(encoder_class):
        def __init__(self, *args, **kwargs):
            super().__init__(*args, **kwargs)
            self.reader.features.append(th.nn.Dropout())

    return Dropout


THAT_DROP_OUT = {
    "bruno": DropoutEncoder,
    "recurrent": DropoutRecurrentEncoder,
    "product_of_gaussians": DropoutProduct,
    "recurrent_vae": dropping_out(RecurrentVae),
    "supervised_belief": dropping_out(SupervisedBelief),
}


def test_predict_changes_nothing_and_repeats_itself(algorithm, make_model):
    model = make_model(make_pendulum(), encoder_class=THAT_DROP_OUT[algorithm.default_encoder]).learn(50)
    transitions = Transitions(*(th.ones(1, 8, dim) for dim in (3, 1, 1, 3)))
    with th.no_grad(), training_mode(model.encoder):
        first, second = (model.encoder.belief(model.encoder.prefixes(transitions)) for _ in range(2))
    assert not th.equal(first, second)  # it would show if the encoder were left to learn
    env = make_vec_env(make_pendulum, 2, seed=0)
    model.policy.set_training_mode(True)  # as ``train`` leaves it
    parameters = deepcopy(model.get_parameters())
    for observation, state, _ in rollout(model, env, 5)[1:]:
        held = deepcopy((observation, state))
        model.policy.set_training_mode(True)
        first = model.predict(observation, state, deterministic=True)
        assert_same(first, model.predict(observation, state, deterministic=True))
        assert_same(held, (observation, state))
    assert_same(parameters, model.get_parameters())


def test_evaluate_policy_equals_a_loop_written_by_hand(trained):
    env = make_vec_env(make_pendulum, 2)
    env.seed(3)
    returns, lengths = evaluate_policy(trained, env, n_eval_episodes=4, return_episode_rewards=True)
    env.seed(3)
    observation, state, start = env.reset(), None, np.ones(2, dtype=bool)
    by_hand, running = [], np.zeros(2)
    for _ in range(50):
        action, state = trained.predict(observation, state, start, deterministic=True)
        observation, reward, start, _ = env.step(action)
        running += reward
        if start.all():
            by_hand.extend(running)
            running = np.zeros(2)
    np.testing.assert_allclose(returns, by_hand, rtol=1e-5)
    assert lengths == [25] * 4
    env.seed(3)
    assert evaluate_policy(trained.policy, env, 4, return_episode_rewards=True)[0] == returns


def test_acting_without_the_state_is_warned_about(trained):
    env = make_pendulum()
    env.reset(seed=0)
    observation, *_ = env.step(env.action_space.sample())
    with pytest.warns(UserWarning, match="pass back the state"):
        trained.predict(observation)
