"""The belief that an agent carries follows its encoder, at a cost that does not grow with the running episode."""

import numpy as np
import pytest
from stable_baselines3.common.env_util import make_vec_env

from sb3_bruno import BrunoSAC, RecurrentSAC, TaskSAC
from support.largest_tensor import LargestTensor
from support.tiny_models import POINT, TINY, n_absorbed, tiny

LENGTH = 5_000


def in_a_long_episode(algorithm):
    """A model that takes its two envs to be 5,000 and 21 steps into their episodes; and the sizes of its encodes."""
    model = algorithm("MlpPolicy", make_vec_env(POINT, 2, seed=0), **tiny(algorithm)).learn(40)
    slots = np.arange(LENGTH) % 20 * 2 + np.array([[0], [1]])
    model.replay_buffer.episodes.running = lambda: (slots, np.array([LENGTH, 21]))
    encoded, prefixes = [], model.encoder.prefixes
    model.encoder.prefixes = lambda transitions, *rest: (
        encoded.append(transitions.rewards.shape[1]) or prefixes(transitions, *rest)
    )
    return model, encoded


def test_a_round_encodes_no_more_of_5000_steps_than_of_384():
    model, encoded = in_a_long_episode(BrunoSAC)
    for _ in range(60):
        model._recall_running_episodes()
    assert encoded == [384] * 10  # 64 a round
    assert n_absorbed(model, model._carried.memory) == [LENGTH - 1, 20]


def test_an_encoder_that_reads_in_time_reads_all_and_as_seldom_as_that_takes():
    model, encoded = in_a_long_episode(RecurrentSAC)
    for _ in range(2 * LENGTH // 64 + 2):
        model._recall_running_episodes()
    assert encoded == [LENGTH] * 2


def test_a_round_of_updates_copies_the_window_of_a_transformer_for_no_step_but_the_newest():
    kwargs = {"encoder_class": "causal_transformer", "encoder_kwargs": {"hidden_size": 8, "window": 200}}
    model = TaskSAC("MlpPolicy", POINT, **TINY, **kwargs).learn(57)  # 27 steps into the second episode
    model._readout_due = 7
    with LargestTensor() as largest:
        model.train(1, 16)
    assert model.logger.name_to_value["readout/loss"] and model.logger.name_to_value["belief/mean_abs"]
    assert largest.n_bytes < 20 * model._carried.memory.window.nbytes


@pytest.mark.parametrize(
    "arguments", [{"batch_size": 0}, {"batch_size": -1}, {"batch_size": 2.5}, {"gradient_steps": -1}]
)
@pytest.mark.parametrize("algorithm", [BrunoSAC, RecurrentSAC])
def test_train_names_an_argument_that_counts_nothing(algorithm, arguments):
    model = algorithm("MlpPolicy", POINT, **tiny(algorithm)).learn(3)
    (name,) = arguments
    with pytest.raises((TypeError, ValueError), match=f"`{name}="):
        model.train(**{"gradient_steps": 1, "batch_size": 16, **arguments})
    for sample, named in (
        (model.replay_buffer.sample, "batch_size"),
        (model.replay_buffer.sample_sequences, "n_sequences"),
    ):
        with pytest.raises(ValueError, match=f"`{named}=0` is no number of"):
            sample(0)


@pytest.mark.parametrize("episodes", [{"max_episode_steps": 1}, {"max_episode_steps": 2}], ids=str)
def test_learn_warns_of_episodes_in_which_nothing_is_inferred(episodes, recwarn):
    model = BrunoSAC("MlpPolicy", make_vec_env(POINT, 2, env_kwargs=episodes), **tiny(BrunoSAC, learning_starts=100))
    model.learn(50)
    told = [str(warning.message) for warning in recwarn if "none held a transition" in str(warning.message)]
    assert len(told) == (1 if episodes["max_episode_steps"] == 1 else 0)
