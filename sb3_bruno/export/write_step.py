"""Writes an agent's step to a file that acts without this package: ONNX, or TorchScript."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import logging
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch as th
from stable_baselines3.common.vec_env import VecNormalize
from torch import Tensor
from torch.distributions import Distribution
from torch.export import ExportedProgram

from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.export.normalization import check_normalization
from sb3_bruno.export.step import Step
from sb3_bruno.export.step_metadata import METADATA, describe
from sb3_bruno.files.whole import check_writable, whole_file

SUFFIXES = (".onnx", ".pt")
N_CHECKED = 5
"""Steps over which a written file is compared with the agent."""
TOLERANCE = 1e-4


def export_agent(model: TaskInference, path: str | Path, *, vec_normalize: VecNormalize | None = None) -> Path:
    """Write one step of an agent to a file, as it is now: with its normalisation and its ``forget_threshold``.

    ``.onnx`` is for onnxruntime, in Python (``Controller``) or any other language; ``.pt`` is TorchScript, for torch
    and libtorch. Both hold a description in JSON, named "sb3_bruno".

    Args:
        model: the agent, of any algorithm here.
        path: the file, whose suffix says what is written.
        vec_normalize: the VecNormalize that it was trained with. None: that of the model's env, if it has one.

    Returns:
        The path.

    Raises:
        ImportError: if a library that writes ONNX is missing.
        ValueError: if the suffix is another, the path cannot be written, or the agent cannot be exported: its weights
            are not finite, its encoder uses what the file cannot hold, or ``vec_normalize`` is none of its env.
    """
    path = Path(path)
    if path.suffix not in SUFFIXES:
        raise ValueError(
            f"`path={str(path)!r}` ends neither in .onnx nor in .pt: give one of them, it says the format."
        )
    if not isinstance(model, TaskInference):
        raise ValueError(
            f"`model` is a {type(model).__name__}: export an algorithm of sb3_bruno, which infers the task."
        )
    for name, weights in model.policy.state_dict().items():  # with the statistics that standardise
        if isinstance(weights, Tensor) and not weights.isfinite().all():
            raise ValueError(f"The agent's weights {name!r} are not finite, for its training diverged: train it again.")
    check_writable(path)
    if path.suffix == ".onnx":
        _check_installed("onnx", "onnxscript", "onnxruntime")
    normalize = model.get_vec_normalize_env() if vec_normalize is None else vec_normalize
    _check_normalization(normalize, model)
    with _traceable():
        step = Step(model.policy, normalize)
        program = _follow(step)
        with whole_file(path) as part:
            write = _write_onnx if path.suffix == ".onnx" else _write_torchscript
            write(step, program, json.dumps(describe(model, step), allow_nan=False), part)
            _check(step, part)
    return path


def _check_installed(*libraries: str) -> None:
    for library in libraries:
        if importlib.util.find_spec(library) is None:
            raise ImportError(f"{library} is not installed: pip install 'sb3_bruno[export]', or export to .pt.")


def _follow(step: Step) -> ExportedProgram:
    """Write down the operations of a step.

    Raises:
        ValueError: if that is not possible, or they draw random numbers.
    """
    try:
        program = th.export.export(step, tuple(step.example().values()), strict=False)
    except Exception as error:  # an encoder may do anything
        raise _refusal(step, error) from error
    for node in program.graph.nodes:
        if _draws(node):
            raise ValueError(
                f"{_encoder(step)} cannot be exported: it draws random numbers by {node.target}, and what is exported "
                "is given them. Draw in `redraw` alone, and call that in `start_episode`."
            )
    return program


def _draws(node: th.fx.Node) -> bool:
    """Whether an operation draws random numbers. A recurrent network would, by dropout, in training alone."""
    if th.Tag.nondeterministic_seeded not in getattr(node.target, "tags", ()):
        return False
    operator: Any = node.target
    given = {argument.name: value for argument, value in zip(operator._schema.arguments, node.args, strict=False)}
    return bool({**given, **node.kwargs}.get("train", True))


def _write_onnx(step: Step, program: ExportedProgram, about: str, path: Path) -> None:
    import onnxscript.optimizer

    from sb3_bruno.export.onnx_operators import translations

    try:
        written = th.onnx.export(
            program,
            input_names=list(step.example()),
            output_names=step.output_names(),
            custom_translation_table=translations(),
            external_data=False,
            verbose=False,
            optimize=False,
        )
        assert written is not None  # with dynamo
        onnxscript.optimizer.fold_constants(written.model, onnx_shape_inference=False)
        _merge_duplicates()(written.model)
    except Exception as error:  # of whatever stage of the translation
        raise _refusal(step, error) from error
    written.model.metadata_props[METADATA] = about
    written.save(path)


def _merge_duplicates() -> Any:
    """Make the pass that keeps one of what is computed twice: a third of the nodes.

    onnxruntime merges nodes too, but not those that read the same numbers from two constants.
    """
    from onnx_ir.passes import Sequential, common

    return Sequential(
        common.LiftConstantsToInitializersPass(lift_all_constants=True, size_limit=0),
        common.DeduplicateInitializersPass(),
        common.CommonSubexpressionEliminationPass(),
        common.RemoveUnusedNodesPass(),
    )


def _write_torchscript(step: Step, program: ExportedProgram, about: str, path: Path) -> None:
    """Trace the step, of which torch.export has shown that no branch of it depends on numbers."""
    traced = th.jit.freeze(th.jit.trace(step, tuple(step.example().values()), check_trace=False).eval())
    th.jit.save(traced, path, _extra_files={METADATA: about})


def _check(step: Step, path: Path) -> None:
    """Compare what a file does with what the agent does.

    Raises:
        ValueError: if the file cannot be run, or acts otherwise.
    """
    act: Any = _onnx_runner(step, path) if path.suffix == ".onnx" else th.jit.load(path)
    generator = th.Generator().manual_seed(0)
    inputs = step.example()
    for _ in range(N_CHECKED):
        free = {name: th.randn(1, inputs[name].shape[1], generator=generator) for name in inputs if name in FREE}
        inputs = {**inputs, **free}
        expected, found = step(*inputs.values()), act(*inputs.values())
        if not th.allclose(found[0], expected[0], rtol=TOLERANCE, atol=TOLERANCE, equal_nan=True):
            raise ValueError(
                f"{_encoder(step)} cannot be exported: what {path.suffix} holds acts otherwise, by {found[0].tolist()} "
                f"instead of {expected[0].tolist()}."
            )
        inputs |= {"action": expected[0], "memory": expected[1], "episode_start": th.zeros(1, 1)}


FREE = ("observation", "reward", "noise")
"""Inputs that do not come from the last step."""


def _onnx_runner(step: Step, path: Path) -> Any:
    """Return a function that runs an ONNX file on tensors.

    Raises:
        ValueError: if onnxruntime does not take it.
    """
    import onnxruntime

    try:
        session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    except Exception as error:  # of an operator that it lacks
        raise _refusal(step, error) from error
    names = [entry.name for entry in session.get_inputs()]

    def run(*tensors: Tensor) -> list[Tensor]:
        return [
            th.as_tensor(array) for array in session.run(None, dict(zip(names, map(np.asarray, tensors), strict=True)))
        ]

    return run


def _refusal(step: Step, error: Exception) -> ValueError:
    """Say which encoder cannot be exported, and for which operation if an error of the exporters names it."""
    told = "\n".join(_chain(error))
    named = re.search(r"aten::?[\w.:]+|aten\.[\w.]+|NOT_IMPLEMENTED[^\n]*", told)
    why = f"the operation {named.group()} cannot be translated" if named else told.splitlines()[0]
    return ValueError(
        f"{_encoder(step)} cannot be exported: {why}. Write its `absorb` and `belief` in other operations."
    )


def _chain(error: BaseException | None) -> Iterator[str]:
    """The messages of an error and of its causes, the deepest first."""
    if error is not None:
        yield from _chain(error.__cause__)
        yield str(error)


def _encoder(step: Step) -> str:
    return type(step.encoder).__name__


@contextlib.contextmanager
def _traceable() -> Iterator[None]:
    """Have distributions not look at their numbers, nor exporters talk, and compute no gradients."""
    checks = Distribution._validate_args
    Distribution.set_default_validate_args(False)
    loud = logging.getLogger("torch.onnx")
    level = loud.level
    loud.setLevel(logging.ERROR)
    try:
        with th.no_grad(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of deprecations inside torch and onnxscript
            yield
    finally:
        Distribution.set_default_validate_args(checks)
        loud.setLevel(level)


def _check_normalization(normalize: Any, model: TaskInference) -> None:
    """Refuse what is no VecNormalize of the agent's observations."""
    if normalize is None:
        return
    remedy = "give what `VecNormalize.load` returns for the statistics that it was trained with"
    if not isinstance(normalize, VecNormalize):
        raise ValueError(f"`vec_normalize={normalize!r:.80}` is no VecNormalize: {remedy}.")
    given, own = (_shapes(space) for space in (normalize.observation_space, model.observation_space))
    if given != own:
        raise ValueError(f"`vec_normalize` is of observations of shapes {given}, the agent's have {own}: {remedy}.")
    try:
        check_normalization(normalize)
    except ValueError as error:
        raise ValueError(f"The agent cannot be exported, for {error}: {remedy}.") from error


def _shapes(space: Any) -> dict[str, Any]:
    """Return the shapes of a Dict, by key; of another space, its own."""
    return {key: entry.shape for key, entry in getattr(space, "spaces", {"": space}).items()}
