"""Forward dynamics to any precision: the library's own ABA on mpmath's numbers, from the doubles that a model holds."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
from dense import Array

from spatialdyn import scalars
from spatialdyn.engines.trace import Row, scratch, table
from spatialdyn.recursions import SPECS

BITS = 400

for function, of in ((scalars.sin, mpmath.sin), (scalars.cos, mpmath.cos), (scalars.sqrt, mpmath.sqrt)):
    function.register(mpmath.mpf)(of)


def exact(row: Row) -> Row:
    """A row whose floats are mpmath's."""
    for name, value in row.__dict__.items():
        row.__dict__[name] = exact(value) if isinstance(value, Row) else _mpf(value)
    return row


def _mpf(x: Any) -> Any:
    return mpmath.mpf(x) if isinstance(x, float) else x


def forward_dynamics(model: Any, q: Array, v: Array, tau: Array, fext: Array | None = None) -> Array:
    """q̈ (nv,) of one sample, rounded at the very end."""
    spec, n = SPECS["aba"], model.nv
    with mpmath.workprec(BITS):
        arrays = [None if x is None else np.vectorize(mpmath.mpf, otypes=[object])(x) for x in (q, v, tau, fext)]
        a, pivots = np.empty(n, object), np.empty(n, object)
        rows = [exact(row) for row in table(model.bodies)]
        spec.recursion(rows, scratch(spec.work, n + 1), *arrays, a, pivots)
        return np.array([float(x) for x in a])
