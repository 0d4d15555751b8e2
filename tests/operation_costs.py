"""``requires`` by counted operations in place of measured times, which depend on what else the machine does."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.accuracy import motions_around
from spatialdyn.simulation.scene_text import operations

HALF = {"float32": 0.5, "float64": 1.0}


def count_operations(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step costs a nanosecond an operation of its recorded program, half of one in float32."""

    def cost(self: Any, timed: Any, beside: Any) -> float:
        count = operations(timed.made.scene)
        assert count is not None
        return count * sd.integrators[timed.method].evaluations * HALF[np.dtype(timed.dtype).name]

    monkeypatch.setattr(motions_around.Motion, "cost", cost)
