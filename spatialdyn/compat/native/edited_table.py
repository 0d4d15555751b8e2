"""Other inertias in a table of bodies: what ``model.update`` does, compiled, for an edit before each call."""

from __future__ import annotations

from functools import cache
from typing import Any

from ...algebra.public_arrays import read_body
from ...algebra.records import inertia_of, motion_of, put_inertia
from ...algebra.scalars import inline, sqrt
from ...bodies.table import BODIES
from ...engines.compiled import jit
from ...engines.compiled.cpython import Builtin
from .operators import inertia_about_origin

MOST = 1e100  # of numbers whose products stay finite
_FIELDS: Any = BODIES.fields
GRAVITY = int(_FIELDS["gravity"][1])  # bytes from the beginning of the table


@inline
def _length(x: float, y: float, z: float) -> Any:
    return sqrt(x * x + y * y + z * z)


@inline
def put_inertias(bodies: Any, before: Any, after: Any, rows: Any, sums: Any) -> int:
    """Write the inertias (njoints, 10) that changed to their rows, and all bounds of composite inertias.

    rows (njoints,) numbers of rows, sums (rows, 3) scratch. Returns -1, with the table as it was, for numbers that are
    not finite, a negative mass, or any beyond ``MOST``; else 0.
    """
    for k in range(1, len(rows)):
        if not after[k, 0] >= 0.0:
            return -1
        for i in range(10):
            if not abs(after[k, i]) < MOST:
                return -1
    for k in range(1, len(rows)):
        same = True
        for i in range(10):
            same = same and before[k, i] == after[k, i]
        if not same:
            put_inertia(bodies[int(rows[k])].inertia, inertia_about_origin(read_body(after[k])))
    for i in range(len(bodies)):
        for j in range(3):
            sums[i, j] = 0.0
    for i in range(len(bodies) - 1, 0, -1):
        b = bodies[i]
        I, S, up = inertia_of(b.inertia), motion_of(b.S), b.parent
        diagonal = I.I.xx * I.I.xx + I.I.yy * I.I.yy + I.I.zz * I.I.zz
        mixed = I.I.xy * I.I.xy + I.I.xz * I.I.xz + I.I.yz * I.I.yz
        m = sums[i, 0] + I.m
        first = sums[i, 1] + _length(I.h.x, I.h.y, I.h.z)
        second = sums[i, 2] + sqrt(diagonal + 2.0 * mixed)
        if S.w.x != 0.0 or S.w.y != 0.0 or S.w.z != 0.0:
            pitch = _length(S.v.x, S.v.y, S.v.z)
            b.inertia_bound.x, b.inertia_bound.y, b.inertia_bound.z = second + pitch * pitch * m, first, m
        else:
            b.inertia_bound.x, b.inertia_bound.y, b.inertia_bound.z = m, 0.0, 0.0
        p = _length(b.X.p.x, b.X.p.y, b.X.p.z)
        sums[up, 0] += m
        sums[up, 1] += first + p * m
        sums[up, 2] += second + 2.0 * p * first + p * p * m
    return 0


@cache
def builtin() -> Builtin:
    """``(before, after) -> True``: ``put_inertias``; returns None for its -1. Words: table, sizes, rows and sums."""
    body = [
        "if not (is_matrix(plan, before, 10) and is_matrix(plan, after, 10)): return return_none(plan)",
        "given = matrix(before), matrix(after), at(rows, (njoints,)), at(sums, (count, 3))",
        "if put_inertias(table_at(table), given[0], given[1], given[2], given[3]) != 0: return return_none(plan)",
        "return return_true(plan)",
    ]
    scope = {"put_inertias": put_inertias, "table_at": jit.table_at}
    return Builtin("put_inertias", ["before", "after"], ["table", "njoints", "count", "rows", "sums"], body, scope)
