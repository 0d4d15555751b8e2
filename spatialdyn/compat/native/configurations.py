"""Comparisons of configurations, as builtins on the table of bodies; they do not apply to a precision below 0."""

from __future__ import annotations

from typing import Any

from ...algebra.rotations import NORM_ROUNDING
from ...algebra.scalars import inline, sqrt
from ...engines.compiled.memory import at, word
from ...engines.compiled.numba_kernels import OK
from ...engines.compiled.tiers import table_kernel
from ...engines.programs.run.routine import Truth, routine
from ...recursions import SPECS

_difference = table_kernel(SPECS["difference"])


@inline
def _are_unit(q: Any, units: int, count: int, precision: float) -> bool:
    """Whether the norms of parts of q, first index and size of each at an address, are within a precision of 1."""
    for k in range(count):
        first, squares = word(units, 2 * k), 0.0
        for i in range(first, first + word(units, 2 * k + 1)):
            squares += q[i] * q[i]
        if not abs(sqrt(squares) - 1.0) < precision:
            return False
    return True


@routine(Truth(), q=("nq",), prec=())
def normalized(q: Any, prec: float, units: int, count: int, out: Any) -> bool:
    """Whether the norms of the parts of unit norm are within prec of 1."""
    out[0] = 1.0 if _are_unit(q, units, count, prec) else 0.0
    return bool(prec >= 0.0)


@routine(Truth(), q1=("nq",), q2=("nq",), prec=())
def same_configuration(
    q1: Any, q2: Any, prec: float, table: int, nv: int, units: int, count: int, scratch: int, out: Any
) -> bool:
    """Whether no entry of the difference exceeds prec; it does not apply to parts off their unit norm."""
    v = at(scratch, (nv,))
    unit = _are_unit(q1, units, count, NORM_ROUNDING) and _are_unit(q2, units, count, NORM_ROUNDING)
    if not (unit and prec >= 0.0) or _difference(table, q1, q2, v) != OK:
        return False
    out[0] = 1.0
    for i in range(nv):
        if not abs(v[i]) <= prec:
            out[0] = 0.0
    return True


ROUTINES = {"normalized": normalized, "same_configuration": same_configuration}
