"""Origins moved along joint axes, so that placements have more zeros.

A body that turns about an axis may have its origin anywhere on it: X_T · Rot(u, q) moved by s u on both sides is the
same joint, with its placement, those of the joints it carries and its inertia seen from the new origin. What is said
of the whole robot stays as it is; forces and placements given in a body's frame would not. Denavit and Hartenberg
choose all origins so; here one is moved only where placements get more zeros than they lose. Saves 10 to 30 % of
the operations of legs and of a UR5, nothing of arms whose right angles are written with twelve digits.
"""

from __future__ import annotations

from typing import Any

from ...algebra.euclidean import Vec, dot, identity, minus, negative, plus, rotate, times
from ...algebra.records import (
    inertia_of,
    motion_of,
    put_inertia,
    put_vec,
    rot_of,
    vec_of,
)
from ...algebra.spatial import Pose, inertia_to_parent
from ...bodies.table import REVOLUTE, REVOLUTE_CS

ALONG = 0.99  # of an axis that counts as a coordinate's: its entry can be made zero without a long way
PARALLEL = 1e-9


def move_origins(rows: Any) -> None:
    """Move origins in a table of bodies, in place, from the root to the tips."""
    moved: dict[int, Vec] = {}
    for i in range(1, len(rows)):
        b = rows[i]
        if b.parent in moved:
            put_vec(b.X.p, minus(vec_of(b.X.p), moved[b.parent]))
        if b.kind not in (REVOLUTE, REVOLUTE_CS):
            continue
        p, axis, u = vec_of(b.X.p), rotate(rot_of(b.X.R), motion_of(b.S).w), motion_of(b.S).w
        k = max(range(3), key=lambda k: abs(axis[k]))
        if p[k] == 0.0 or abs(axis[k]) < ALONG:
            continue
        s = -p[k] / axis[k]
        there = plus(p, times(s, axis))
        there = Vec(*(0.0 if c == k else x for c, x in enumerate(there)))
        way = times(s, u)
        lost = sum(_entries(minus(q, way)) - _entries(q) for q in _carried(rows, i, u))
        if _entries(there) + lost < _entries(p):
            moved[i] = way
            put_vec(b.X.p, there)
            put_inertia(b.inertia, inertia_to_parent(Pose(identity(), negative(way)), inertia_of(b.inertia)))


def _carried(rows: Any, i: int, u: Vec) -> list[Vec]:
    """Placements of the joints that body i carries, but for those that can move back along the same axis."""
    found = []
    for row in rows[i + 1 :]:
        if row.parent == i:
            axis = rotate(rot_of(row.X.R), motion_of(row.S).w)
            back = row.kind in (REVOLUTE, REVOLUTE_CS) and abs(abs(dot(axis, u)) - 1.0) < PARALLEL
            found += [] if back else [vec_of(row.X.p)]
    return found


def _entries(p: Vec) -> int:
    return sum(x != 0.0 for x in p)
