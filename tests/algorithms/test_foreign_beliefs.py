"""A belief or a state of another model is refused by the queries that would misread it."""

import numpy as np
import pytest
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_bruno import BrunoSAC, RecurrentSAC, Transitions
from support.tiny_models import make_pendulum, make_point, tiny


def make(env_fn=make_point, algorithm=BrunoSAC, **encoder_kwargs):
    return algorithm("MlpPolicy", DummyVecEnv([env_fn]), **tiny(algorithm, encoder_kwargs=encoder_kwargs))


def transitions(n=3):
    return Transitions(np.zeros((n, 2)), np.zeros((n, 2)), np.zeros((n, 1)), np.zeros((n, 2)))


@pytest.fixture(scope="module")
def model():
    return make()


@pytest.fixture(
    scope="module",
    params=[{"n_weights": 4}, {"modelled": "rewards"}, {"process": "gaussian"}],
    ids=str,
)
def other(request):
    return make(**request.param)


def assert_refused(model, belief):
    for asked in (
        lambda: model.predict_outcomes(belief, np.zeros(2), np.zeros(2)),
        lambda: model.task_probabilities(belief, np.eye(2)),
    ):
        with pytest.raises(ValueError, match=r"`belief` is of another model: it rests on .* this BrunoEncoder keeps"):
            asked()


def test_a_belief_of_another_model_is_refused(model, other):
    assert_refused(model, other.infer(transitions()))


def test_a_belief_of_another_process_is_refused_though_its_memory_has_the_same_shape(model):
    assert_refused(model, make(process="kernel_student_t").infer(transitions()))


def test_a_state_of_another_model_is_refused(model, other):
    _, state = other.predict(other.get_env().reset())
    for asked in (lambda: model.belief(state), lambda: model.predict(model.get_env().reset(), state)):
        with pytest.raises(ValueError, match=r"`state`"):
            asked()


@pytest.mark.parametrize("algorithm", [BrunoSAC, RecurrentSAC])
def test_a_state_of_another_env_is_refused_though_its_memory_has_the_same_shape(algorithm):
    options = {"modelled": "rewards"} if algorithm is BrunoSAC else {}
    model, other = make(algorithm=algorithm, **options), make(make_pendulum, algorithm, **options)
    _, state = other.predict(other.get_env().reset())
    with pytest.raises(ValueError, match=r"`state` is of 1 envs and observations of 3 numbers"):
        model.predict(model.get_env().reset(), state)
    if algorithm is BrunoSAC:
        with pytest.raises(ValueError, match=r"`state` holds observations of shape \(3,\), this model's have \(2,\)"):
            model.belief(state)


def test_a_state_with_arrays_of_other_shapes_at_its_end_is_refused(model):
    model.policy.forget_threshold = 5.0
    observation = model.get_env().reset()
    _, state = model.predict(observation)
    model.policy.forget_threshold = None
    for bad in ((*state[:-1], np.zeros((1, 2))), (*state[:-2], state[-2][..., :1], state[-1]), (*state[:-1], [0.0])):
        with pytest.raises(ValueError, match="`state` ends with arrays of shapes"):
            model.predict(observation, bad)
