"""Other inertias in a table of bodies: what ``model.update`` does, compiled, for an edit before each call."""

from __future__ import annotations

from functools import cache
from typing import Any

from ...algebra.public_arrays import read_body
from ...algebra.records import inertia_of, motion_of, put_inertia
from ...algebra.scalars import inline, sqrt
from ...bodies.table import BODIES
from ...engines.compiled.cpython import Builtin, dims
from ...engines.compiled.table_kernels import kernel
from ...engines.compiled.tiers import NATIVE
from ...engines.object_layout import DATA
from .operator_kernels import deferred
from .operators import inertia_about_origin

MOST = 1e100  # of numbers whose products stay finite
_FIELDS: Any = BODIES.fields
GRAVITY = int(_FIELDS["gravity"][1])  # bytes from the beginning of the table


@inline
def _length(x: float, y: float, z: float) -> Any:
    return sqrt(x * x + y * y + z * z)


@inline
def sound(inertia: Any) -> bool:
    """Whether the numbers (10,) of an inertia are finite, none beyond ``MOST``, and its mass is not negative."""
    for i in range(10):
        if not abs(inertia[i]) < MOST:
            return False
    return bool(inertia[0] >= 0.0)


@inline
def put_bounds(bodies: Any, sums: Any) -> None:
    """Write all bounds of composite inertias; sums (rows, 3) is scratch."""
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


@inline
def _put_bounds(bodies: Any, sums: Any) -> int:
    put_bounds(bodies, sums)
    return 0


bounds = deferred(lambda: kernel(_put_bounds, 2))  # (table, sums (rows, 3)): ``put_bounds``


@cache
def builtin() -> Builtin:
    """``(inertias (njoints, 10), joint, inertia (10,)) -> (njoints, 10)``: the inertias with that of a joint, which is
    written to its row; returns None, with the table as it was, if it is not ``sound``.

    Words: table, njoints, ten (10), numbers of rows (njoints,), scratch (count, 3).
    """
    words = ["table", "njoints", "ten", "rows", "sums", "count"]
    body = [
        "k = index(plan, joint, njoints)",
        "if k < 0 or not (is_matrix(plan, before, ten) and is_vector(plan, inertia, ten)): return return_none(plan)",
        "given, bodies = vector(inertia, ten), table_at(table)",
        "if not sound(given): return return_none(plan)",
        f"answer = new_array(plan, 2, {dims(words, 'njoints')})",
        "if answer == 0: return 0",
        f"then, now = matrix(before), at(word(answer, {DATA}), (njoints, 10))",
        "for i in range(njoints):",
        "    for j in range(10): now[i, j] = then[i, j]",
        "for j in range(10): now[k, j] = given[j]",
        "if k > 0:",
        "    put(bodies[int(at(rows, (njoints,))[k])].inertia, about_origin(read(given)))",
        "    put_bounds(bodies, at(sums, (count, 3)))",
        "return answer",
    ]
    scope = {
        "sound": sound, "put": put_inertia, "about_origin": inertia_about_origin, "read": read_body,
        "put_bounds": put_bounds, "table_at": NATIVE["table_at"],
    }  # fmt: skip
    return Builtin("put_inertia", ["before", "joint", "inertia"], words, body, scope)
