"""A table of bodies as engines take it, and the values of static inputs as keys of caches."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


class Table(Hashable, Protocol):
    """A table of bodies, hashed and compared by its content."""

    @property
    def bodies(self) -> NDArray[Any]:
        """The rows, a structured array of BODIES."""

    @property
    def key(self) -> str:
        """A digest of their content."""

    @property
    def address(self) -> int:
        """Their address in memory."""


def hashable(static: tuple[Any, ...]) -> tuple[bytes | int, ...]:
    """Hashable values of static inputs: arrays as bytes; a StaticTable is hashed by its content."""
    return tuple(x.tobytes() if isinstance(x, np.ndarray) else x for x in static)
