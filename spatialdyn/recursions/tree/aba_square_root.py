"""Forward dynamics by the articulated body algorithm on square roots of inertias.

By Gauss's principle the accelerations of a subtree minimize ½ |R a + z|² - l·a, with a row of R and an entry of z for
each direction in which the subtree has inertia. RᵀR is its articulated inertia; it is never formed, so that a light
link loses no digits beside a heavy one. A Householder reflection of the rows eliminates a joint: one row keeps the
joint's acceleration, the others pass to the parent. ``square_root_inertia`` makes the rows of one body,
``square_root_rows`` stores and reflects the rows of a subtree.
"""

from __future__ import annotations

from ...algebra.euclidean import Mat3, Sym, Vec, cross, dot, neg, scale, sub_sym, unrotate, zero
from ...algebra.public_arrays import read_force
from ...algebra.records import (
    force_of,
    inertia_of,
    motion_of,
    pose_of,
    put_force,
    put_inertia,
    put_motion,
    table_dtype,
    vec_of,
)
from ...algebra.scalars import Scalar, inline, sqrt
from ...algebra.spatial import (
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
from ...bodies.joints import joint_motion, place_joint
from ..signatures import Bodies, Config, Matrix, Record, Vector, Work
from ..spec import FEXT_OPTIONAL, TAU, TURNED_Q, A, Spec, V
from ..steps import moved_by_joint
from .aba import acceleration_through_M
from .rnea import rnea
from .rotors import add_couple, in_row_axes
from .square_root_inertia import body_rows
from .square_root_rows import Row, put_row, reflect, row_of, triangular

FOLDED = 12  # most rows from children in a stack; more are reduced to six first
ROWS = 18  # at most 6 of children, 3 and 9 of the body before they are reduced to 6, and 1 of the armature
BLUR = 16.0  # BLUR n eps bounds the computed value of a root that is 0; random robots of massless root reach 3 n eps

WORK = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # spatial velocity; outward
    c=Motion,  # velocity-product acceleration v × S q̇; outward
    I=Inertia,  # of the body, less J e eᵀ of the rotors that turn on it; outward
    a=Motion,  # spatial acceleration; last sweep
    l=Force,  # force given to the body and by its children; inward, for each right side
    r=Force,  # Force of the row that the joint keeps; inward
    s=float,  # number of that row, a root of D; inward
    z=float,  # velocity term of that row; inward
    t=float,  # torque across the joint over s; inward, for each right side
    w=Vec,  # of rnea, as are the fields to f
    dw=Vec,
    dv=Vec,
    f=Force,
    rows=int,  # rows of the stack in use; inward
    relative=int,  # 1 if the unknown is the joint acceleration, 0 if the body's along the axis; inward
    stack=(float, (ROWS, 8)),  # rows [s | r | z] of the subtree; inward
    reach=(float, (6,)),  # 1 for entries of the acceleration that joints above can change; outward
    felt=(float, (6,)),  # 1 for entries that joints above or its own joint can change; outward
)


@inline
def aba_square_root(
    bodies: Bodies,
    work: Work,
    q: Config,
    v: Vector,
    tau: Vector,
    fext: Matrix,
    a: Vector,
    pivots: Vector,
    residual: Vector,
) -> None:
    """RBDA table 7.1 with rows [R z] and l in place of IA and pA; fext may be None, for zero.

    Then one refinement a += M⁻¹ (τ - RNEA(q, v, a)) by the same rows: if a heavy link has no more inertia about an axis
    than a light one, the joint mixes their rows, and the rows of the light link may lose digits.

    pivots    (nv), written: √D times the root of a bound on the composite inertia, over BLUR; a joint is singular if
              √D is within rounding of 0 relative to that root
    residual  (nv), written: the last change of a
    """
    _roots(bodies, work, q, v, pivots)
    for i in range(1, len(bodies)):
        put_force(work[i].l, zero_force())
        if fext is not None and bodies[i].joint > 0:
            put_force(work[i].l, read_force(fext[bodies[i].joint]))
        if bodies[i].geared:
            parent = work[bodies[i].parent]
            w, e = motion_of(parent.v).w, vec_of(bodies[i].rotor)
            turns = v[i - 1] + dot(e, w) / bodies[i].armature
            put_force(parent.l, add_couple(force_of(parent.l), scale(-turns, cross(w, e))))
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


@inline
def _roots(bodies: Bodies, work: Work, q: Config, v: Vector, pivots: Vector) -> None:
    """Place the bodies, and eliminate each joint from the rows of its subtree."""
    n = len(bodies) - 1
    put_motion(work[0].v, zero_motion())
    for k in range(6):
        work[0].felt[k] = 0.0
    for i in range(1, n + 1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        place_joint(bodies, i, q, here.X)
        vJ = joint_motion(bodies, i, v)
        vi = moved_by_joint(here, parent, vJ)
        put_motion(here.v, vi)
        put_motion(here.c, cross_motion(vi, vJ))
        put_inertia(here.I, inertia_of(b.inertia))
        if b.geared:
            put_inertia(parent.I, _without_rotor(inertia_of(parent.I), vec_of(b.rotor), b.armature))
        here.rows = 0
        _reach(here, parent, motion_of(b.S))

    for i in range(n, 0, -1):
        b, here = bodies[i], work[i]
        rows = _gather(b, here)
        if rows == 0:  # the scratch may hold anything
            put_row(here.stack, 0, Row(0.0, zero_force(), 0.0))
        reflect(here.stack, 0, rows, 0)
        first = row_of(here.stack, 0)
        here.s, here.z = first.s, first.z
        put_force(here.r, first.r)
        pivots[i - 1] = abs(first.s) * sqrt(b.armature + b.inertia_bound.x) / BLUR
        if b.parent > 0:
            _hand_over(here, work[b.parent], rows)


@inline
def _inward(bodies: Bodies, work: Work, tau: Vector) -> None:
    """t of each joint, from the torques and the forces l in the scratch."""
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


@inline
def _outward(bodies: Bodies, work: Work, gravity: Vec, moving: bool, a: Vector) -> None:
    """Accelerations of joints and bodies; the velocity terms are left out unless ``moving``."""
    put_motion(work[0].a, Motion(zero(), neg(gravity)))
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


@inline
def _reach(here: Record, parent: Record, S: Motion) -> None:
    """Mark the entries of a body's acceleration that joints above it (reach), or also its own joint (felt), can change.

    The other entries are known beforehand and need no rows. If the axes of a planar arm are those of its frames,
    rounding then adds no force from across the plane.
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
    turned = Mat3(abs(R.xx), abs(R.xy), abs(R.xz), abs(R.yx), abs(R.yy), abs(R.yz), abs(R.zx), abs(R.zy), abs(R.zz))
    w, v = unrotate(turned, w), unrotate(turned, v)
    reached = (w.x, w.y, w.z, v.x, v.y, v.z)
    along = (S.w.x, S.w.y, S.w.z, S.v.x, S.v.y, S.v.z)
    for k in range(6):
        here.reach[k] = 1.0 if reached[k] > 0.0 else 0.0
        here.felt[k] = 1.0 if reached[k] > 0.0 or along[k] != 0.0 else 0.0


# --- the stack of a body --------------------------------------------------------------------------------


@inline
def as_force(S: Motion) -> Force:
    """The row that projects a motion on the unit S."""
    return Force(S.w, S.v)


@inline
def _gather(b: Record, here: Record) -> int:
    """Add the body's rows to the stack and split it along the joint's axis; returns the number of rows.

    The unknown of a joint is the acceleration of its body along the axis, so that the rows for the parent are exactly
    0 along it. An armature acts on the difference from the parent's acceleration. If the armature is the greater part
    of the inertia, this difference is the unknown, since a small difference would be lost in the sum. A rotor acts on
    the difference and on the parent's acceleration about its axis; its inertia J e eᵀ is therefore taken from the
    parent's inertia.
    """
    stack, S = here.stack, motion_of(b.S)
    rows: int = here.rows
    if rows > 6:
        rows = triangular(stack, 0, rows, here.felt)
    if b.joint > 0:
        rows = body_rows(stack, rows, inertia_of(here.I), motion_of(here.v), here.felt)
    total = 0.0
    for k in range(rows):
        s = power(S, row_of(stack, k).r)
        stack[k, 0] = s
        total += s * s
    here.relative = 1 if b.armature > total else 0
    if not here.relative:
        for k in range(rows):
            row = row_of(stack, k)
            put_row(stack, k, Row(row.s, sub_force(row.r, scale_force(row.s, as_force(S))), row.z))
    if b.armature > 0.0:
        s = sqrt(b.armature)
        r, z = zero_force() if here.relative else scale_force(-s, as_force(S)), 0.0
        if b.geared:  # the row of √J (n q̈ + e·ω̇)
            e = scale(1.0 / s, in_row_axes(b, pose_of(here.X)))
            r, z = add_couple(r, e), -dot(e, motion_of(here.c).w)
        if b.coupled:  # coupled motors have no square root here: NaN instead of a wrong number
            s = sqrt(-1.0)
        put_row(stack, rows, Row(s, r, z))
        rows += 1
    return rows


@inline
def _without_rotor(I: Inertia, e: Vec, armature: Scalar) -> Inertia:
    """I less J e eᵀ, from n J e and n² J."""
    u = scale(1.0 / armature, e)
    ring = Sym(e.x * u.x, e.x * u.y, e.x * u.z, e.y * u.y, e.y * u.z, e.z * u.z)
    return Inertia(I.m, I.h, sub_sym(I.I, ring))


@inline
def _hand_over(here: Record, parent: Record, rows: int) -> None:
    """Append the rows of a body to its parent's stack, except row 0, which the joint keeps."""
    X, c, stack, last = pose_of(here.X), motion_of(here.c), here.stack, rows
    if rows > 7:
        last = triangular(stack, 1, rows, here.reach)
    at = parent.rows
    if at + last - 1 > FOLDED:
        at = triangular(parent.stack, 0, at, parent.felt)
    for k in range(1, last):
        r = row_of(stack, k).r
        put_row(parent.stack, at, Row(0.0, force_to_parent(X, r), stack[k, 7] + power(c, r)))
        at += 1
    parent.rows = at


SPECS = (
    Spec(
        "aba_square_root", aba_square_root, WORK, (TURNED_Q, V, TAU, FEXT_OPTIONAL), A,
        "Forward dynamics a = M(q)⁻¹ (tau - C(q, v) v - g(q) + Σ Jᵀ fext) by the articulated body algorithm on square "
        "roots of inertias.",
        "after Featherstone, RBDA (2008), table 7.1; a derivation of our own from Gauss's principle of least "
        "constraint.", pivots=True, traceable=False, scratch=(("nv",),),
        through_M=acceleration_through_M, lacks=("coupled",),
    ),
)  # fmt: skip
