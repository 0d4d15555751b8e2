"""How much is fuzzed: some thousand cases, the same ones in every run; more of them, and others each time, on demand.

SPATIALDYN_FUZZ=20 runs twenty times as many; ``benchmarks/fuzz.py --minutes 30`` runs that long.
"""

from __future__ import annotations

import os
from typing import Any

import pytest

hypothesis = pytest.importorskip("hypothesis")

FACTOR = int(os.environ.get("SPATIALDYN_FUZZ", "0"))


def cases(count: int) -> Any:
    """Run a test on so many cases, or so many times that."""
    return hypothesis.settings(
        max_examples=count * max(1, FACTOR),
        derandomize=not FACTOR,
        database=None,
        deadline=None,
        suppress_health_check=list(hypothesis.HealthCheck),
    )
