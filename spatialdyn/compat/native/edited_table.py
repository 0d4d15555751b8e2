"""Other numbers in a table of bodies: what ``model.update`` does, compiled, for an edit before each call."""

from __future__ import annotations

from typing import Any

from ...algebra.euclidean import Mat3, Vec, add_mat3, cross, rotate, scale
from ...algebra.lie import outer
from ...algebra.public_arrays import read_body, read_pose
from ...algebra.records import inertia_of, motion_of, put_inertia, put_mat3, put_pose, put_vec
from ...algebra.rotations import ROTATION_ZERO
from ...algebra.scalars import inline, sqrt
from ...algebra.spatial import Pose
from ...bodies.kinds import CONTINUED, SCREWS, TURNS
from ...engines.compiled.memory import at, places, table_at
from ...engines.programs.run.routine import routine
from .operators import inertia_about_origin

MOST = 1e100  # of numbers whose products stay finite
REFUSED, WRITTEN, MOVED = -1.0, 0.0, 1.0  # what ``put_numbers`` returns


@inline
def _sound(x: Any, njoints: int) -> bool:
    """Whether the numbers of a block are below ``MOST``, masses and armatures not negative, gravity linear."""
    for i in range(len(x)):
        if not abs(x[i]) < MOST or (i >= 6 + 26 * njoints and x[i] < 0.0):
            return False
    for k in range(njoints):
        if x[6 + 16 * njoints + 10 * k] < 0.0:
            return False
    return bool(x[3] == 0.0 and x[4] == 0.0 and x[5] == 0.0)


@inline
def _differ(x: Any, y: Any, first: int, size: int) -> bool:
    different = False
    for i in range(first, first + size):
        different |= x[i] != y[i]
    return different


@inline
def _cleared(x: float) -> Any:
    return x if abs(x) >= ROTATION_ZERO else 0.0


@inline
def _put_place(b: Any, X: Pose) -> None:
    """Write the pose of a row in its parent, and what turning joints have of it (see ``bodies.table``)."""
    R, u = X.R, motion_of(b.S).w
    R = Mat3(
        _cleared(R.xx), _cleared(R.xy), _cleared(R.xz), _cleared(R.yx), _cleared(R.yy), _cleared(R.yz),
        _cleared(R.zx), _cleared(R.zy), _cleared(R.zz),
    )  # fmt: skip
    put_pose(b.X, Pose(R, X.p))
    if b.kind in TURNS or b.kind in SCREWS:
        s = rotate(R, u)
        x, y, z = cross(Vec(R.xx, R.xy, R.xz), u), cross(Vec(R.yx, R.yy, R.yz), u), cross(Vec(R.zx, R.zy, R.zz), u)
        put_mat3(b.axial, outer(s, u))
        put_mat3(b.transverse, add_mat3(R, outer(scale(-1.0, s), u)))
        put_mat3(b.skewed, Mat3(x.x, x.y, x.z, y.x, y.y, y.z, z.x, z.y, z.z))


@inline
def _length(x: float, y: float, z: float) -> Any:
    return sqrt(x * x + y * y + z * z)


@inline
def _put_bounds(bodies: Any, sums: Any) -> None:
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
def _put_numbers(bodies: Any, rows: Any, now: Any, then: Any, sums: Any) -> float:
    njoints, moved, weighed = len(rows), WRITTEN, False
    if not _sound(now, njoints):
        return REFUSED
    for k in range(1, njoints):
        row, place, body = rows[k], 6 + 16 * k, 6 + 16 * njoints + 10 * k
        if _differ(now, then, body, 10):
            put_inertia(bodies[row].inertia, inertia_about_origin(read_body(now[body : body + 10])))
            weighed = True
        while bodies[row].kind == CONTINUED:
            row -= 1
        if _differ(now, then, place, 16):
            _put_place(bodies[row], read_pose(now[place : place + 16].reshape(4, 4)))
            moved = MOVED
    for i in range(1, len(bodies)):
        bodies[i].armature = now[5 + 26 * njoints + i]
    put_vec(bodies[0].gravity, Vec(now[0], now[1], now[2]))
    if weighed or moved == MOVED:
        _put_bounds(bodies, sums)
    for i in range(len(now)):
        then[i] = now[i]
    return moved


@routine(())
def put_numbers(
    table: int, now: int, then: int, size: int, rows: int, njoints: int, sums: int, count: int, out: Any
) -> bool:
    """Write what differs between two blocks of ``Numbers`` of a Model to its table, and ``now`` to ``then``.

    The result is MOVED if placements differ, else WRITTEN; REFUSED, with nothing written, if the numbers need checks.

    rows, sums  addresses of the rows (njoints,) of the joints' bodies, and of scratch (count, 3)
    """
    blocks = at(now, (size,)), at(then, (size,))
    out[0] = _put_numbers(table_at(table), places(rows, (njoints,)), blocks[0], blocks[1], at(sums, (count, 3)))
    return True
