"""Forward dynamics by the articulated body algorithm on square roots of inertias.

By Gauss's principle the accelerations of a subtree make ½ |R a + z|² - l·a smallest, with a row of R and an entry of z
for each direction in which it has inertia: RᵀR is its articulated inertia, which is never formed, so nothing of a
light link is lost beside a heavy one. A joint is eliminated by a reflection of the rows; what does not feel it goes on
to the parent. Rows of a body come from its mass and the second moments of its mass, so a link may have none.

The stack of a body is an array, a row of it [s | r | z]: s along the joint's axis, r a Force (angular part first) that
pairs with the acceleration, z the rate.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..euclidean import (
    Rot,
    Sym,
    Vec,
    apply_sym,
    cross,
    dot,
    minus,
    negative,
    plus,
    second_moment,
    times,
    unrotate,
    zero,
)
from ..scalars import Scalar, called, inlined, sqrt
from ..spatial import (
    Force,
    Inertia,
    Motion,
    Pose,
    add_force,
    add_motion,
    cross_motion,
    force_to_parent,
    motion_to_child,
    power,
    scale_force,
    scale_motion,
    sub_force,
    sub_motion,
    zero_force,
    zero_motion,
)
from ..tables import (
    force_from,
    force_of,
    inertia_of,
    motion_of,
    pose_of,
    put_force,
    put_motion,
    table_dtype,
    vec_of,
)
from .joints import joint_motion, place_joint
from .rnea import rnea
from .spec import FEXT_OPTIONAL, TAU, A, Q, Spec, V

FOLDED = 12  # rows that children leave before they are made six
ROWS = 18  # at most 6 of children, 3 and 9 of the body before they are made 6, and 1 of the armature
EPS = 2.220446049250313e-16

WORK = table_dtype(
    X=Pose, v=Motion, c=Motion, a=Motion, l=Force, r=Force, s=float, z=float, t=float,
    w=Vec, dw=Vec, dv=Vec, f=Force, rows=int, relative=int, stack=(float, (ROWS, 8)),
    reach=(float, (6,)), felt=(float, (6,)),
)  # fmt: skip


class Row(NamedTuple):
    """A row of a stack."""

    s: Scalar
    r: Force
    z: Scalar


@inlined
def aba_square_root(
    bodies: Any, work: Any, q: Any, v: Any, tau: Any, fext: Any, a: Any, pivots: Any, residual: Any
) -> None:
    """RBDA table 7.1 with rows [R z] and l in place of IA and pA; fext may be None, for zero.

    Then once a += M⁻¹ (τ - RNEA(q, v, a)) with the rows that are there: a joint whose axis a heavy link feels no more
    than a light one mixes their rows, and the light one's may lose digits.

    pivots    (nv), written: the root of D times that of a bound on the composite inertia, for a joint is singular here
              when the first is next to nothing of the second
    residual  (nv), written: what the last step has changed
    """
    _roots(bodies, work, q, v, pivots)
    for i in range(1, len(bodies)):
        put_force(work[i].l, zero_force())
        if fext is not None and bodies[i].joint > 0:
            put_force(work[i].l, force_from(fext[bodies[i].joint]))
    _inward(bodies, work, tau)
    _outward(bodies, work, vec_of(bodies[0].gravity), True, a)

    rnea(bodies, work, q, v, a, fext, residual)
    for i in range(1, len(bodies)):
        residual[i - 1] = tau[i - 1] - residual[i - 1]
        put_force(work[i].l, zero_force())
    _inward(bodies, work, residual)
    _outward(bodies, work, zero(), False, residual)
    for i in range(len(bodies) - 1):
        a[i] = a[i] + residual[i]


@inlined
def _roots(bodies: Any, work: Any, q: Any, v: Any, pivots: Any) -> None:
    """Place the bodies, and eliminate each joint from the rows of its subtree."""
    n = len(bodies) - 1
    put_motion(work[0].v, zero_motion())
    for k in range(6):
        work[0].felt[k] = 0.0
    for i in range(1, n + 1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        place_joint(bodies, i, q, here.X)
        vJ = joint_motion(bodies, i, v)
        vi = add_motion(motion_to_child(pose_of(here.X), motion_of(parent.v)), vJ)
        put_motion(here.v, vi)
        put_motion(here.c, cross_motion(vi, vJ))
        here.rows = 0
        _reach(here, parent, motion_of(b.S))

    for i in range(n, 0, -1):
        b, here = bodies[i], work[i]
        rows = _gather(b, here)
        _reflect(here.stack, 0, rows, 0)
        first = _row(here.stack, 0)
        here.s, here.z = first.s, first.z
        put_force(here.r, first.r)
        pivots[i - 1] = abs(first.s) * sqrt(b.armature + b.bound.x)
        if b.parent > 0:
            _hand_over(here, work[b.parent], rows)


@inlined
def _inward(bodies: Any, work: Any, tau: Any) -> None:
    """t of each joint, from the torques and the forces l that are there."""
    put_force(work[0].l, zero_force())
    for i in range(len(bodies) - 1, 0, -1):
        here, parent = work[i], work[bodies[i].parent]
        S, l = motion_of(bodies[i].S), force_of(here.l)
        total = tau[i - 1] + power(S, l)
        here.t = total / here.s
        if not here.relative:
            l = sub_force(l, scale_force(total, as_force(S)))
        if bodies[i].parent > 0:
            up = force_to_parent(pose_of(here.X), sub_force(l, scale_force(here.t, force_of(here.r))))
            put_force(parent.l, add_force(force_of(parent.l), up))


@inlined
def _outward(bodies: Any, work: Any, gravity: Vec, moving: bool, a: Any) -> None:
    """The accelerations, of joints and bodies; not moving leaves out what velocities add."""
    put_motion(work[0].a, Motion(zero(), negative(gravity)))
    for i in range(1, len(bodies)):
        here, S = work[i], motion_of(bodies[i].S)
        ai, t = motion_to_child(pose_of(here.X), motion_of(work[bodies[i].parent].a)), here.t
        if moving:
            ai, t = add_motion(ai, motion_of(here.c)), t - here.z
        x = (t - power(ai, force_of(here.r))) / here.s
        a[i - 1] = x
        if not here.relative:
            along = power(ai, as_force(S))
            a[i - 1] = x - along
            ai = sub_motion(ai, scale_motion(along, S))
        put_motion(here.a, add_motion(ai, scale_motion(x, S)))


@inlined
def _reach(here: Any, parent: Any, S: Motion) -> None:
    """Mark the entries of a body's acceleration that joints above it (reach), or they and its own (felt) can change.

    The others are known beforehand, so rows need not be kept for them; and where the axes of a planar arm are those
    of its frames, nothing of the forces across the plane gets into the plane by rounding.
    """
    X = pose_of(here.X)
    R, p = X.R, X.p
    felt = parent.felt
    w = Vec(felt[0], felt[1], felt[2])
    v = Vec(
        felt[3] + abs(p.z) * w.y + abs(p.y) * w.z,
        felt[4] + abs(p.x) * w.z + abs(p.z) * w.x,
        felt[5] + abs(p.y) * w.x + abs(p.x) * w.y,
    )
    turned = Rot(abs(R.xx), abs(R.xy), abs(R.xz), abs(R.yx), abs(R.yy), abs(R.yz), abs(R.zx), abs(R.zy), abs(R.zz))
    w, v = unrotate(turned, w), unrotate(turned, v)
    reached = (w.x, w.y, w.z, v.x, v.y, v.z)
    along = (S.w.x, S.w.y, S.w.z, S.v.x, S.v.y, S.v.z)
    for k in range(6):
        here.reach[k] = 1.0 if reached[k] > 0.0 else 0.0
        here.felt[k] = 1.0 if reached[k] > 0.0 or along[k] != 0.0 else 0.0


# --- the rows of a body -----------------------------------------------------------------------------------


@inlined
def as_force(S: Motion) -> Force:
    """The row that takes of a motion its part along the unit S."""
    return Force(S.w, S.v)


@inlined
def _row(stack: Any, k: int) -> Row:
    """Read a row."""
    n, f = Vec(stack[k, 1], stack[k, 2], stack[k, 3]), Vec(stack[k, 4], stack[k, 5], stack[k, 6])
    return Row(stack[k, 0], Force(n, f), stack[k, 7])


@inlined
def _put(stack: Any, k: int, row: Row) -> None:
    """Write a row."""
    n, f = row.r.n, row.r.f
    stack[k, 0], stack[k, 1], stack[k, 2], stack[k, 3] = row.s, n.x, n.y, n.z
    stack[k, 4], stack[k, 5], stack[k, 6], stack[k, 7] = f.x, f.y, f.z, row.z


@inlined
def _plus(a: Row, w: Scalar, b: Row) -> Row:
    """a + w b."""
    return Row(a.s + w * b.s, add_force(a.r, scale_force(w, b.r)), a.z + w * b.z)


@inlined
def _larger(a: Row, b: Row) -> Row:
    """The larger of each entry of a and each magnitude of b, but those of s and z."""
    n, f, m, g = a.r.n, a.r.f, b.r.n, b.r.f
    return Row(
        a.s,
        Force(
            Vec(max(n.x, abs(m.x)), max(n.y, abs(m.y)), max(n.z, abs(m.z))),
            Vec(max(f.x, abs(g.x)), max(f.y, abs(g.y)), max(f.z, abs(g.z))),
        ),
        a.z,
    )


@inlined
def _gather(b: Any, here: Any) -> int:
    """Make the stack whole and split it along the joint's axis; returns how many rows it has.

    The unknown of a joint is the acceleration of its body along the axis, so that what goes on to the parent feels
    exactly nothing along it. An armature feels the difference to the parent's. Where it is the greater part, the
    difference is the unknown: a small one would be lost in the sum.
    """
    stack, S = here.stack, motion_of(b.S)
    rows: int = here.rows
    if rows > 6:
        rows = _triangular(stack, 0, rows, here.felt)
    if b.joint > 0:
        rows = _own_rows(stack, rows, inertia_of(b.inertia), motion_of(here.v), here.felt)
    total = 0.0
    for k in range(rows):
        s = power(S, _row(stack, k).r)
        stack[k, 0] = s
        total += s * s
    here.relative = 1 if b.armature > total else 0
    if not here.relative:
        for k in range(rows):
            row = _row(stack, k)
            _put(stack, k, Row(row.s, sub_force(row.r, scale_force(row.s, as_force(S))), row.z))
    if b.armature > 0.0:
        s = sqrt(b.armature)
        _put(stack, rows, Row(s, zero_force() if here.relative else scale_force(-s, as_force(S)), 0.0))
        rows += 1
    return rows


@inlined
def _own_rows(stack: Any, rows: int, I: Inertia, v: Motion, felt: Any) -> int:
    """Append the rows of a body: with Σ x xᵀ its second moments of mass, rows [-x̃, 0] and z = ω × (ω × x) for each x.

    Mass and first moment are one more such point, s = √m and x = h/s, which moves: [-x̃, s 1] and
    z = ω × (s v + ω × x). Returns the new number of rows.
    """
    s, x = sqrt(I.m), zero()
    if s != 0.0:
        x = Vec(I.h.x / s, I.h.y / s, I.h.z / s)
        z = cross(v.w, plus(times(s, v.v), cross(v.w, x)))
        _put(stack, rows, Row(0.0, Force(Vec(0.0, x.z, -x.y), Vec(s, 0.0, 0.0)), z.x))
        _put(stack, rows + 1, Row(0.0, Force(Vec(-x.z, 0.0, x.x), Vec(0.0, s, 0.0)), z.y))
        _put(stack, rows + 2, Row(0.0, Force(Vec(x.y, -x.x, 0.0), Vec(0.0, 0.0, s)), z.z))
        rows += 3
    M = second_moment(I.I)
    least = 16.0 * EPS * (abs(M.xx) + abs(M.yy) + abs(M.zz))  # what rounding may leave
    rest = Sym(
        M.xx - x.x * x.x, M.xy - x.x * x.y, M.xz - x.x * x.z, M.yy - x.y * x.y, M.yz - x.y * x.z, M.zz - x.z * x.z
    )
    first = rows
    for _ in range(3):
        d, axis = _largest(rest)
        if d > 0.0:
            x, rest = _without_axis(rest, axis, d)
            z = cross(v.w, cross(v.w, x))
            _put(stack, rows, Row(0.0, Force(Vec(0.0, x.z, -x.y), zero()), z.x))
            _put(stack, rows + 1, Row(0.0, Force(Vec(-x.z, 0.0, x.x), zero()), z.y))
            _put(stack, rows + 2, Row(0.0, Force(Vec(x.y, -x.x, 0.0), zero()), z.z))
            rows += 3
    if not _size(rest) <= least:
        rows = _turning_rows(stack, first, I, v.w)
    elif rows - first > 3:
        rows = _triangular(stack, first, rows, felt)
    return rows


@inlined
def _turning_rows(stack: Any, rows: int, I: Inertia, w: Vec) -> int:
    """Append rows of the rotational inertia about the com, for one that no distribution of mass has; NaN if it is
    not positive semidefinite, when it has none. Returns the new number of rows.
    """
    least = 16.0 * EPS * (abs(I.I.xx) + abs(I.I.yy) + abs(I.I.zz))
    rest = I.I
    if I.m > 0.0:
        c, h = Vec(I.h.x / I.m, I.h.y / I.m, I.h.z / I.m), I.h
        hc = dot(h, c)
        rest = Sym(
            rest.xx - (hc - h.x * c.x), rest.xy + h.x * c.y, rest.xz + h.x * c.z,
            rest.yy - (hc - h.y * c.y), rest.yz + h.y * c.z, rest.zz - (hc - h.z * c.z),
        )  # fmt: skip
    moment = cross(w, apply_sym(rest, w))
    for _ in range(3):
        d, axis = _largest(rest)
        if d > 0.0:
            x, rest = _without_axis(rest, axis, d)
            along = moment.x if axis == 0 else (moment.y if axis == 1 else moment.z)
            z = along / sqrt(d)
            moment = minus(moment, times(z, x))
            _put(stack, rows, Row(0.0, Force(x, zero()), z))
            rows += 1
    if not _size(rest) <= least:
        lost = Vec(sqrt(-1.0), 0.0, 0.0)
        _put(stack, rows, Row(0.0, Force(lost, lost), lost.x))
        rows += 1
    return rows


@inlined
def _largest(M: Sym) -> tuple[Scalar, int]:
    """The largest entry on the diagonal, and where it is."""
    if M.yy > M.xx:
        return (M.zz, 2) if M.zz > M.yy else (M.yy, 1)
    return (M.zz, 2) if M.zz > M.xx else (M.xx, 0)


@inlined
def _size(M: Sym) -> Scalar:
    """The largest magnitude of an entry."""
    diagonal = max(abs(M.xx), max(abs(M.yy), abs(M.zz)))
    return max(diagonal, max(abs(M.xy), max(abs(M.xz), abs(M.yz))))


@inlined
def _without_axis(M: Sym, axis: int, d: Scalar) -> tuple[Vec, Sym]:
    """x and M - x xᵀ, a step of Cholesky's: x is M's column of the axis over √d, d the entry on the diagonal."""
    s = sqrt(d)
    if axis == 0:
        x = Vec(s, M.xy / s, M.xz / s)
        return x, Sym(0.0, 0.0, 0.0, M.yy - x.y * x.y, M.yz - x.y * x.z, M.zz - x.z * x.z)
    if axis == 1:
        x = Vec(M.xy / s, s, M.yz / s)
        return x, Sym(M.xx - x.x * x.x, 0.0, M.xz - x.x * x.z, 0.0, 0.0, M.zz - x.z * x.z)
    x = Vec(M.xz / s, M.yz / s, s)
    return x, Sym(M.xx - x.x * x.x, M.xy - x.x * x.y, 0.0, M.yy - x.y * x.y, 0.0, 0.0)


# --- reflections ------------------------------------------------------------------------------------------


@inlined
def _hand_over(here: Any, parent: Any, rows: int) -> None:
    """Append the rows of a body that its joint does not feel, row 0 left out, to its parent's stack."""
    X, c, stack, last = pose_of(here.X), motion_of(here.c), here.stack, rows
    if rows > 7:
        last = _triangular(stack, 1, rows, here.reach)
    at = parent.rows
    if at + last - 1 > FOLDED:
        at = _triangular(parent.stack, 0, at, parent.felt)
    for k in range(1, last):
        r = _row(stack, k).r
        _put(parent.stack, at, Row(0.0, force_to_parent(X, r), stack[k, 7] + power(c, r)))
        at += 1
    parent.rows = at


@called
def _triangular(stack: Any, first: int, end: int, felt: Any) -> int:
    """Make rows first .. end as few as their rank, at most six, with the same RᵀR and Rᵀz; returns their new end.

    felt  (6,) of 0 and 1: columns that count; what is left of rows when these are done is given up

    Rows of very different size keep their own accuracy if pivots are chosen by columns and rows (Cox and Higham
    1998). Angular and linear columns have different units, so each is judged by the largest entry among its three.
    """
    angular, linear = 0.0, 0.0
    for top in range(first, min(end, first + 6)):
        largest = Row(0.0, zero_force(), 0.0)
        for k in range(top, end):
            largest = _larger(largest, _row(stack, k))
        n, f = largest.r.n, largest.r.f
        if top == first:
            angular, linear = max(n.x, max(n.y, n.z)), max(f.x, max(f.y, f.z))
        sizes = (n.x, n.y, n.z, f.x, f.y, f.z)
        best, column = 0.0, 0
        for j in range(6):
            scale = angular if j < 3 else linear
            if felt[j] > 0.0 and scale > 0.0 and sizes[j] / scale > best:
                best, column = sizes[j] / scale, j + 1
        if column == 0:
            return top
        _reflect(stack, top, end, column)
    return min(end, first + 6)


@called
def _reflect(stack: Any, top: int, end: int, column: int) -> None:
    """Householder's reflection of rows top .. end that leaves of a column its first entry, the row of its largest
    entry put on top; nothing is done to a column of 0.
    """
    pivot = top
    for k in range(top + 1, end):
        if abs(stack[k, column]) > abs(stack[pivot, column]):
            pivot = k
    p = stack[pivot, column]
    if p == 0.0:
        return
    first = _row(stack, pivot)
    _put(stack, pivot, _row(stack, top))
    square = 1.0
    for k in range(top + 1, end):
        w = stack[k, column] / p
        square += w * w
        stack[k, column] = w
    norm = sqrt(square)
    y = _plus(first, norm, first)
    for k in range(top + 1, end):
        y = _plus(y, stack[k, column], _row(stack, k))
    _put(stack, top, _plus(first, -1.0 / norm, y))
    for k in range(top + 1, end):
        row = _row(stack, k)
        _put(stack, k, _plus(row, -stack[k, column] / (norm * (1.0 + norm)), y))
        stack[k, column] = 0.0
    stack[top, column] = -norm * p


SPECS = (
    Spec(
        "aba_square_root", aba_square_root, WORK, (Q, V, TAU, FEXT_OPTIONAL), A,
        "Forward dynamics a = M(q)⁻¹ (tau - C(q, v) v - g(q) + Σ Jᵀ fext) by the articulated body algorithm on square "
        "roots of inertias.",
        "after Featherstone, RBDA (2008), table 7.1; a derivation of our own from Gauss's principle of least "
        "constraint.", pivots=True, traces=False, spare=(("nv",),),
    ),
)  # fmt: skip
