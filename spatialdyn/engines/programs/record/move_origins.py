"""Body origins moved along joint axes, so that placements have more zeros.

A body that turns about an axis may have its origin anywhere on the axis: X_T · Rot(u, q) translated by s u on both
sides is the same joint, if its placement, the placements of its children and its inertia are expressed at the new
origin. Quantities of the whole robot do not change; forces and placements given in a body's frame would. Denavit and
Hartenberg choose all origins in this way; here an origin is moved only if placements get more zeros than they lose.
That saves operations for legs and for a UR5, but none for arms whose right angles are written with twelve digits.
"""

from __future__ import annotations

from typing import Any

from ....algebra.euclidean import Vec, add, dot, identity, neg, rotate, scale, sub
from ....algebra.records import (
    inertia_of,
    mat3_of,
    motion_of,
    put_inertia,
    put_vec,
    vec_of,
)
from ....algebra.spatial import Pose, inertia_to_parent
from ....bodies.kinds import TURNS

ALIGNED = 0.99  # least entry of an axis along which a short distance makes an entry of the placement zero
PARALLEL = 1e-9


def move_origins(rows: Any) -> None:
    """Move the origins of a table of bodies from the root to the tips; the table is written in place."""
    moved: dict[int, Vec] = {}
    for i in range(1, len(rows)):
        b = rows[i]
        if b.parent in moved:
            put_vec(b.X.p, sub(vec_of(b.X.p), moved[b.parent]))
        if b.kind not in TURNS:
            continue
        p, axis, u = vec_of(b.X.p), rotate(mat3_of(b.X.R), motion_of(b.S).w), motion_of(b.S).w
        k = max(range(3), key=lambda k: abs(axis[k]))
        if p[k] == 0.0 or abs(axis[k]) < ALIGNED:
            continue
        s = -p[k] / axis[k]
        there = add(p, scale(s, axis))
        there = Vec(*(0.0 if c == k else x for c, x in enumerate(there)))
        way = scale(s, u)
        lost = sum(_nonzero_entries(sub(q, way)) - _nonzero_entries(q) for q in _child_placements(rows, i, u))
        if _nonzero_entries(there) + lost < _nonzero_entries(p):
            moved[i] = way
            put_vec(b.X.p, there)
            put_inertia(b.inertia, inertia_to_parent(Pose(identity(), neg(way)), inertia_of(b.inertia)))


def _child_placements(rows: Any, i: int, u: Vec) -> list[Vec]:
    """Placements of the child joints of body i, except joints whose own origin can move back along the same axis."""
    found = []
    for row in rows[i + 1 :]:
        if row.parent == i:
            axis = rotate(mat3_of(row.X.R), motion_of(row.S).w)
            back = row.kind in TURNS and abs(abs(dot(axis, u)) - 1.0) < PARALLEL
            found += [] if back else [vec_of(row.X.p)]
    return found


def _nonzero_entries(p: Vec) -> int:
    return sum(x != 0.0 for x in p)
