"""What is inlined: it computes what it says, leaves no machine code of its own, and may raise."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core import compiler

import spatialdyn as sd
from spatialdyn.algebra import numba_passes
from spatialdyn.algebra.scalars import called, inlined, sin, woven
from spatialdyn.engines.compiled import numba_kernels

COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="about compiled code")


@called
def apart(x: float) -> float:
    """A function that is compiled once."""
    made: float = sin(x) + 1.0
    return made


@inlined
def inside(x: Any, k: int) -> float:
    """What a recursion is made of."""
    return apart(x[k]) * 2.0


@woven
def between(x: Any) -> float:
    """What calls kernels."""
    total = 0.0
    for k in range(len(x)):
        total += inside(x, k)
        if total > 100.0:
            raise ValueError("too much")
    return total


def outermost(x: Any) -> float:
    """What is run."""
    return between(x)


def test_inlined_functions_compute_what_python_does() -> None:
    x = np.array([0.3, -1.2, 2.0])
    expected = sum(2.0 * (math.sin(a) + 1.0) for a in x)
    assert outermost(x) == expected
    assert njit(outermost)(x) == pytest.approx(expected, rel=4e-16)  # a sum of three, in another order of fusing


def test_what_an_inlined_function_raises_arrives() -> None:
    with pytest.raises(ValueError, match="too much"):
        njit(outermost)(np.zeros(60))


@COMPILED
def test_inlined_functions_have_no_machine_code() -> None:
    kernel: Any = njit(outermost)
    kernel(np.ones(2))
    (made,) = kernel.overloads.values()
    defined = {name for name in made.library.codegen._engine._defined_symbols if "NumbaEnv" not in name}
    assert any("outermost" in name for name in defined)
    assert any("apart" in name and __name__ in name for name in defined)
    assert not any(word in name and __name__ in name for name in defined for word in ("6inside", "7between"))


def test_the_passes_left_out_are_numbas() -> None:
    """One that is called otherwise in another version would be run again in silence."""
    state = compiler.StateDict()
    flags: Any = compiler.Flags
    state.flags, state.func_ir = flags(), None
    builder: Any = compiler.DefaultPassBuilder
    there = {found.__name__ for found, _ in builder.define_nopython_pipeline(state).passes}
    assert there >= numba_passes._WITHOUT


@COMPILED
def test_without_what_they_are_made_of_recursions_compile_as_numba_has_them(tmp_path: Path) -> None:
    """Another version of Numba may have its passes elsewhere."""
    script = """
import sys
sys.modules["spatialdyn.algebra.numba_passes"] = None
import spatialdyn as sd
print(sd.rnea(sd.load_urdf("two_link"), [0.3, 0.4], [1.0, 2.0], [0.0, 1.0]).tolist())
"""
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path)}
    ran = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    expected = sd.rnea(sd.load_urdf("two_link"), [0.3, 0.4], [1.0, 2.0], [0.0, 1.0])
    np.testing.assert_allclose(json.loads(ran.stdout), expected, rtol=1e-14)
