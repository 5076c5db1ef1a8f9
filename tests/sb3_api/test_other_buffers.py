"""Replay buffers that are copied, exchanged, deleted, or loaded from an agent that draws from its own otherwise."""

from copy import deepcopy

import pytest
from stable_baselines3.common.logger import configure

from sb3_bruno import BrunoSAC, RecurrentSAC
from support.tiny_models import POINT, for_each, tiny


def trains(model):
    model.set_logger(configure(None, []))
    model.train(gradient_steps=2, batch_size=16)
    assert model.replay_buffer.encoder is model.encoder


def test_a_copied_or_exchanged_buffer_is_trained_on(make_model):
    model = make_model(learning_starts=30).learn(50)
    trains(deepcopy(model))
    other = make_model(seed=1)
    other.replay_buffer = deepcopy(model.replay_buffer)
    trains(other)
    other.replay_buffer = model.replay_buffer
    trains(other)
    trains(model)


def test_a_buffer_is_loaded_where_there_is_none(make_model, tmp_path):
    model = make_model().learn(50)
    model.save_replay_buffer(tmp_path / "buffer")
    del model.replay_buffer
    model.load_replay_buffer(tmp_path / "buffer")
    assert model.replay_buffer.size() == 50
    trains(model)


@for_each([BrunoSAC])
def test_what_was_stored_is_drawn_as_the_agent_draws(make_model, tmp_path):
    make_model().learn(70).save_replay_buffer(tmp_path / "shuffled")
    own = {"context": "episode", "n_sequences": 2, "sequence_length": 5, "n_recent": 20}
    for model in (make_model(replay_buffer_kwargs=own), RecurrentSAC("MlpPolicy", POINT, **tiny(RecurrentSAC))):
        before = model.replay_buffer
        model.load_replay_buffer(tmp_path / "shuffled")
        assert model.replay_buffer.size() == 70
        for name in own:
            assert getattr(model.replay_buffer, name) == getattr(before, name)
        trains(model)


@pytest.mark.parametrize("kwargs", [{}, {"context": "episode"}], ids=str)
@for_each([BrunoSAC])
def test_where_there_was_none_the_arguments_say_how(make_model, tmp_path, kwargs):
    make_model().learn(50).save_replay_buffer(tmp_path / "shuffled")
    model = make_model(replay_buffer_kwargs=kwargs)
    del model.replay_buffer
    model.load_replay_buffer(tmp_path / "shuffled")
    assert model.replay_buffer.context == kwargs.get("context", "iid")
