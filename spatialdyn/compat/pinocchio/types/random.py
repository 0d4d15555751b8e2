"""The one source of random numbers behind ``Random()``, ``setRandom()`` and ``randomConfiguration``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

GENERATOR = np.random.default_rng()


def seed(seed_value: int) -> None:
    """Start the random numbers again; the same seed gives the same ones, though not those of Pinocchio."""
    GENERATOR.bit_generator.state = np.random.default_rng(seed_value).bit_generator.state


def uniform(*shape: int) -> NDArray[np.float64]:
    """Numbers in [-1, 1)."""
    return GENERATOR.uniform(-1.0, 1.0, shape)


def direction(size: int) -> NDArray[np.float64]:
    """A unit vector, all directions alike."""
    x = GENERATOR.standard_normal(size)
    return x / np.sqrt(x @ x)
