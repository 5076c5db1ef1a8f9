"""``sb3-bruno export``: writes a trained agent to a file that acts without this package."""

from __future__ import annotations

import argparse
from pathlib import Path

from sb3_bruno.cli.evaluate import load_agent
from sb3_bruno.cli.mistake import Mistake, check_installed, told_as_mistake
from sb3_bruno.cli.parser import add_agent, command_parser
from sb3_bruno.cli.values import writable_file


def export(arguments: list[str]) -> None:
    """Write a trained agent to a file that acts without this package: .onnx or .pt (docs/deploy.md).

    What VecNormalize learned becomes part of the file.

    example: sb3-bruno export --algo bruno_sac --env CheetahDir-v0 -f logs --out agent.onnx
    """
    parser = command_parser("export", export)
    add_agent(parser)
    parser.add_argument("--out", type=exported_file, default=Path("agent.onnx"), help="the file (default: agent.onnx)")
    parser.set_defaults(split="test", tasks=None, steps=None)  # which only a test would choose
    options = parser.parse_args(arguments)
    check_installed(*(["onnxscript", "onnxruntime"] if options.out.suffix == ".onnx" else []), extra="export")

    from sb3_bruno.algorithms.task_inference import TaskInference

    agent = load_agent(options)
    if not isinstance(agent.model, TaskInference):
        raise Mistake(f"--algo {options.algo} infers no task: SB3's guide says how to export its own algorithms")
    with told_as_mistake():
        agent.model.export(options.out, vec_normalize=agent.vec_normalize)
    print(f"Saved {options.out}")


def exported_file(text: str) -> Path:
    """Check that an agent can be exported to a file.

    Raises:
        argparse.ArgumentTypeError: if it cannot be written, or its suffix says no format.
    """
    if Path(text).suffix not in (".onnx", ".pt"):
        raise argparse.ArgumentTypeError(f"{text!r} ends neither in .onnx nor in .pt: give one, it says the format")
    return writable_file(text)
