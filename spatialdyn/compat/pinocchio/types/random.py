"""The random generator of ``Random()``, ``setRandom()`` and ``randomConfiguration``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["seed"]

GENERATOR = np.random.default_rng()


def seed(seed_value: int) -> None:
    """Seed the random generator; the numbers differ from Pinocchio's."""
    GENERATOR.bit_generator.state = np.random.default_rng(seed_value).bit_generator.state


def uniform(*shape: int) -> NDArray[np.float64]:
    """Random numbers in [-1, 1)."""
    return GENERATOR.uniform(-1.0, 1.0, shape)
