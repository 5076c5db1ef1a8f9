"""What rl_zoo3 is handed in the place of a dict of hyperparameters."""

from __future__ import annotations

from typing import Any

from sb3_bruno.zoo.configs import merged


class Merging(dict[str, Any]):
    """Hyperparameters into which those of a trial are merged.

    rl_zoo3 copies the dict and updates it with what a trial draws: these two calls alone are changed.
    """

    def copy(self) -> Merging:
        return Merging(self)

    def update(self, drawn: dict[str, Any]) -> None:  # type: ignore[override]  # rl_zoo3 passes a dict
        super().update(merged(self, drawn))
