"""One step of an agent: exported, and by ``predict``."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sb3_bruno import BrunoSAC
from sb3_bruno.export import Controller
from speed_sections.models import CHEETAH, ENV_ID, KERNEL
from speed_sections.race import Row, Seconds, race, row

STEPS = 200


def acting(rounds: int) -> tuple[list[Row], Seconds]:
    """Time a control loop's step: the controller, with read-out and surprise, beside ``predict``."""
    rows, everything = [], {}
    for encoder_name, kwargs in (("the default encoder", KERNEL), ("CheetahDir's encoder", CHEETAH)):
        model = BrunoSAC("MlpPolicy", ENV_ID, device="cpu", **kwargs)
        with tempfile.TemporaryDirectory() as folder:
            model.export(Path(folder) / "agent.onnx")
            controller = Controller(Path(folder) / "agent.onnx")
        seconds = race({"controller": partial(control, controller), "predict": partial(predict, model)}, rounds, 1)
        what = f"steps of an exported agent, {encoder_name}"
        rows.append(row(what, seconds, "controller", "predict", "3,300 per second", STEPS))
        everything |= {f"{what}: {who}": times for who, times in seconds.items()}
    return rows, everything


def control(controller: Controller) -> None:
    """Act for an episode by the exported agent."""
    controller.reset()
    for t in range(STEPS):
        controller.act(np.full(controller.observation_shape, 0.01 * t), 1.0)


def predict(model: Any) -> None:
    """Act for an episode by the agent itself."""
    spaces, state = model.observation_space, None
    for t in range(STEPS):
        seen = {key: np.full(space.shape, 0.01 * t if key == "observation" else 0.0) for key, space in spaces.items()}
        seen["episode_start"] = np.array([float(t == 0)])
        _, state = model.predict(seen, state, deterministic=True)
