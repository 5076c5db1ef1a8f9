"""What editors, notebooks and type checkers are told of the arguments is what the algorithms take."""

import inspect
import re
from typing import get_type_hints

import pytest
from sb3_contrib import TQC, CrossQ
from stable_baselines3 import SAC, TD3

from sb3_bruno import (
    BeliefSAC,
    BrunoCrossQ,
    BrunoSAC,
    BrunoTD3,
    BrunoTQC,
    PearlSAC,
    RecurrentCrossQ,
    RecurrentSAC,
    RecurrentTD3,
    RecurrentTQC,
    TaskReplayBuffer,
    TaskSAC,
    VaribadSAC,
)
from sb3_bruno.algorithms.arguments import CrossQArguments, SACArguments, TD3Arguments, TQCArguments, check_names
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.buffers.task_buffer import BufferArguments

POINT = "sb3_bruno_envs:PointDir-v0"
BASES = {
    SAC: (SACArguments, [BeliefSAC, BrunoSAC, PearlSAC, RecurrentSAC, VaribadSAC]),
    TQC: (TQCArguments, [BrunoTQC, RecurrentTQC]),
    CrossQ: (CrossQArguments, [BrunoCrossQ, RecurrentCrossQ]),
    TD3: (TD3Arguments, [BrunoTD3, RecurrentTD3]),
}


def named(algorithm):
    """Its parameters by name, those aside that every algorithm takes first or that stand for others."""
    parameters = inspect.signature(algorithm).parameters.values()
    others = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    kept = [parameter for parameter in parameters if parameter.kind not in others]
    return {parameter.name: parameter for parameter in kept if parameter.name not in ("policy", "env")}


@pytest.mark.parametrize("base", BASES)
def test_editors_and_notebooks_see_every_argument_with_its_default(base):
    typed, algorithms = BASES[base]
    expected = {**named(base), **named(TaskInference)}
    assert set(get_type_hints(typed)) == set(expected)
    for algorithm in algorithms:
        shown = named(algorithm)
        assert set(shown) == set(expected)
        assert all(shown[name].default == expected[name].default for name in shown)
        assert list(inspect.signature(algorithm).parameters)[:2] == ["policy", "env"]


def test_the_typed_arguments_of_the_buffer_are_those_of_its_constructor():
    from_sb3 = {"buffer_size", "observation_space", "action_space", "device", "n_envs", "optimize_memory_usage"}
    assert set(get_type_hints(BufferArguments)) == set(inspect.signature(TaskReplayBuffer).parameters) - from_sb3


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"encoder_kwargs": {"proces": "gaussian"}}, "`encoder_kwargs` has no `proces`: did you mean `process`?"),
        ({"encoder_kwargs": {"observation_dim": 3}}, "`encoder_kwargs` has no `observation_dim`: "),
        ({"encoder_kwargs": {"xyz": 1}}, "`encoder_kwargs` has no `xyz`: it takes modelled, "),
        (
            {"replay_buffer_kwargs": {"contxt": "iid"}},
            "`replay_buffer_kwargs` has no `contxt`: did you mean `context`?",
        ),
        ({"encoder_class": "brunoo"}, "'brunoo'` is unknown: use one of"),
    ],
)
def test_a_wrong_name_is_refused_with_the_nearest_right_one(settings, told):
    with pytest.raises(ValueError, match=re.escape(told)):
        BrunoSAC("MlpPolicy", POINT, **settings)


@pytest.mark.parametrize(("name", "nearest"), [("learning_rat", "learning_rate"), ("encoder_kwarg", "encoder_kwargs")])
def test_a_wrong_argument_is_a_type_error_with_the_nearest_right_one(name, nearest):
    with pytest.raises(TypeError, match=f"`RecurrentSAC` has no `{name}`: did you mean `{nearest}`?"):
        RecurrentSAC("MlpPolicy", POINT, **{name: None})


def test_names_that_are_passed_on_are_left_to_whom_they_are_passed():
    def passes_on(**kwargs):
        raise NotImplementedError

    check_names("encoder_kwargs", {"anything": 1}, passes_on, set())


def test_one_class_takes_any_encoder_and_the_defaults_are_the_encoders():
    model = TaskSAC("MlpPolicy", POINT, encoder_class="recurrent")
    assert type(model.encoder) is type(RecurrentSAC("MlpPolicy", POINT).encoder)
    assert model.replay_buffer.context == "episode"
    assert model.encoder_optimizer.param_groups[0]["lr"] == model.encoder.learning_rate == 1e-4
    assert BrunoSAC("MlpPolicy", POINT).encoder_optimizer.param_groups[0]["lr"] == 1e-3
