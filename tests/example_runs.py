"""Examples run in their quick setting, for tests of their numbers."""

from __future__ import annotations

import inspect
from typing import Any

import pytest

from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.examples import gallery
from spatialdyn.urdf.load import example_robots

G = 9.81
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: minutes of plain Python")
robots = pytest.mark.skipif(not example_robots(), reason="robots of example-robot-data")


def run(name: str, **options: Any) -> Any:
    """What an example returns; quick where it has a quick setting."""
    main = gallery.module(name).main
    quick = "quick" in inspect.signature(main).parameters
    return main(**gallery.checked(name, main, quick=quick, **options))
