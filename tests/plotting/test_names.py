"""Methods are called as people call them, and what differs from their config is said."""

import pytest

from sb3_bruno.plotting.names import choices, method_name


@pytest.mark.parametrize(
    ("config", "name"),
    [
        ({"algo": "bruno_sac"}, "BrunoSAC"),
        ({"algo": "bruno_crossq", "conf": None, "params": {}}, "BrunoCrossQ"),
        ({"algo": "recurrent_td3"}, "RecurrentTD3"),
        ({"algo": "sac", "conf": "oracle"}, "told the task"),
        ({"algo": "sac", "conf": "markov"}, "no memory"),
        ({"algo": "tqc", "conf": "oracle"}, "TQC, told the task"),
        ({"algo": "bruno_sac", "conf": "paper"}, "BrunoSAC, paper"),
        ({"algo": "sac", "conf": "oracle", "params": {"env_kwargs.split": "test"}}, "told the task, split=test"),
        ({"algo": "bruno_sac", "params": {"a.b": 1}, "deterministic": False}, "BrunoSAC, b=1, stochastic"),
        ({"algo": "BrunoSAC"}, "BrunoSAC"),
        ({"algo": "../x $"}, "../x $"),
    ],
)
def test_a_method_is_called_by_its_class_or_by_what_it_knows(config, name):
    assert method_name(config) == name


def test_what_goes_without_saying_is_left_out():
    config = {"algo": "bruno_sac", "params": {"encoder_kwargs.belief": "mean", "train_freq": 4}}
    assert choices(config) == ["belief=mean", "train_freq=4"]
    assert method_name(config, {"belief=mean"}) == "BrunoSAC, train_freq=4"
