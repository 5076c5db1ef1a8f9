"""Makes generators of random numbers that SB3's seeds reach."""

from __future__ import annotations

import numpy as np


def random_generator(seed: int | None = None) -> np.random.Generator:
    """Make a generator from a seed; None: from NumPy's global state, which SB3's ``set_random_seed`` seeds."""
    if seed is None:
        seed = np.random.randint(2**31)  # noqa: NPY002  # it is this state, and no generator, that SB3 seeds
    return np.random.default_rng(seed)
