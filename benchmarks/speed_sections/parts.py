"""Where ``train()`` spends its time."""

from __future__ import annotations

from functools import partial
from typing import Any

from speed_sections.models import CONFIG, KERNEL, trained
from speed_sections.race import Row, Seconds, race, row


def parts(rounds: int) -> tuple[list[Row], Seconds]:
    """Time what ``train()`` does beside SB3's updates, with the default encoder of rewards at CheetahDir's config.

    In one call, an encode takes place once, an update of the encoder once, and the running episodes are encoded again
    at most once: those of 200 steps every fourth time. Here they have 100.
    """
    steps, batch = CONFIG["gradient_steps"], CONFIG["batch_size"]
    model = trained(CONFIG["n_envs"], **KERNEL)
    model.learn(100 * CONFIG["n_envs"], reset_num_timesteps=False)  # into episodes of 200 steps, which had just ended
    model.encoder_learning_starts = 0
    buffer: Any = model.replay_buffer

    def encode() -> None:
        buffer.forget_beliefs()
        buffer.sample(batch)

    def recall() -> None:
        model._rounds_since_recall = 1_000  # so that it is due
        model._recall_running_episodes()

    whole = f"train({steps})"
    work = {
        whole: partial(model.train, steps, batch),
        "an encode and a sample": encode,
        "an encoder update": model._update_encoder,
        "the running episodes encoded again": recall,
    }
    seconds = race(work, rounds, 4)
    return [row(f"part of {whole}, batch {batch}: {name}", seconds, name, whole) for name in [*work][1:]], seconds
