"""Inverse operational-space inertia Λ⁻¹ = J M⁻¹ Jᵀ of a frame, and of two frames, without M and without J.

A unit force on body i accelerates it by Φ_i, the inverse of the body's operational-space inertia. With U and D of the
articulated sweep, a row's acceleration is a_i = X a_λ + S q̈ with q̈ = (u - U·X a_λ) / D, so with y = X Φ_λ Xᵀ U

    Φ_i = X Φ_λ Xᵀ - (S yᵀ + y Sᵀ) / D + S Sᵀ (1/D + U·y / D²),    Φ_0 = 0,

from the world to the body. Φ pairs with forces as an inertia does with motions, so it is kept as an ``Articulated``
whose moments stand for linear velocities: I is the linear-linear block, H linear-angular, M angular-angular. The q̈ of
a row behind a differential also has the term -m q̈_λ / D: ``joined`` is the row's Σ a q̈ over the unit forces, ``own``
its Σ q̈².

For two bodies, column by column: a unit force on one body loads the joints that carry it, inward, and accelerates the
other body, outward.
"""

from __future__ import annotations

from ...algebra.articulated import (
    Articulated,
    articulated_at_parent,
    articulated_force,
    articulated_to_parent,
    rotate_articulated,
)
from ...algebra.euclidean import Mat3, Sym, Vec, neg, transpose, zero
from ...algebra.public_arrays import read_pose, write_motion
from ...algebra.records import (
    articulated_of,
    force_of,
    motion_of,
    pose_of,
    put_articulated,
    put_force,
    put_motion,
    table_dtype,
)
from ...algebra.scalars import Scalar, inline
from ...algebra.spatial import (
    Force,
    Motion,
    Pose,
    add_motion,
    compose,
    force_to_parent,
    identity_pose,
    inverse,
    motion_to_child,
    power,
    scale_force,
    scale_motion,
    sub_force,
    zero_force,
    zero_motion,
)
from ..signatures import Array, Bodies, Config, Matrix, Vector, Work
from ..spec import LOCAL, PLACEMENT, REFERENCE, ROW, TURNED_Q, WORLD, Argument, MassMatrix, Spec
from .aba import articulate
from .kinematics import express_in

WORK = table_dtype(
    X=Pose,  # pose of the row in its parent; of the articulated sweep, as are IA, U and d
    IA=Articulated,
    U=Force,
    d=float,
    Phi=Articulated,  # inverse inertia of the row's body; outward
    joined=Motion,  # Σ a q̈ of the row over the unit forces; outward, of rows before a differential
    own=float,  # Σ q̈² of the row over the unit forces
)
WORK_OF_TWO = table_dtype(
    X=Pose,  # of the articulated sweep, as are IA, U and d
    IA=Articulated,
    U=Force,
    d=float,
    F=Force,  # force on the row that reaches it; inward, column by column
    u=float,  # torque S·F on the row, less the torque through a differential; inward
    a=Motion,  # acceleration of the row; outward
    qdd=float,  # of the row's joint; outward
)


@inline
def zero_inverse() -> Articulated:
    """Φ of the world, which no force moves."""
    o = Sym(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return Articulated(o, Mat3(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), o)


@inline
def inverse_to_child(X: Pose, Phi: Articulated) -> Articulated:
    """Φ from parent to child coordinates: X Φ Xᵀ, as an articulated inertia goes to the parent."""
    return rotate_articulated(transpose(X.R), articulated_at_parent(neg(X.p), Phi))


@inline
def moved(Phi: Articulated, f: Force) -> Motion:
    """Φ f."""
    found = articulated_force(Phi, Motion(f.f, f.n))
    return Motion(found.f, found.n)


@inline
def swapped(m: Motion) -> Force:
    """A motion in the order of Φ's rows: the linear velocity in place of the moment."""
    return Force(m.v, m.w)


@inline
def through_row(bodies: Bodies, work: Work, i: int, X: Pose, S: Motion, U: Force, d: Scalar) -> Articulated:
    """Φ of row i from that of its parent."""
    b, parent = bodies[i], work[bodies[i].parent]
    W = inverse_to_child(X, articulated_of(parent.Phi))
    y = moved(W, U)
    t = power(y, U)
    if b.coupled:
        joined = motion_to_child(X, motion_of(parent.joined))
        t = t + 2.0 * b.coupling * power(joined, U) + b.coupling * b.coupling * parent.own
        y = add_motion(y, scale_motion(b.coupling, joined))
    own = d + d * d * t
    # W - (S yᵀ + y Sᵀ) / D + S Sᵀ own = W - S rᵀ - r Sᵀ
    r = add_motion(scale_motion(d, y), scale_motion(-0.5 * own, S))
    if b.partner > 0:
        put_motion(work[i].joined, add_motion(scale_motion(own, S), scale_motion(-d, y)))
        work[i].own = own
    return subtract_both(W, swapped(S), swapped(r))


@inline
def subtract_both(A: Articulated, s: Force, r: Force) -> Articulated:
    """A - s rᵀ - r sᵀ."""
    a, b, c, d = s.n, s.f, r.n, r.f
    I, H, M = A.I, A.H, A.M
    return Articulated(
        Sym(
            I.xx - 2.0 * (a.x * c.x), I.xy - (a.x * c.y + c.x * a.y), I.xz - (a.x * c.z + c.x * a.z),
            I.yy - 2.0 * (a.y * c.y), I.yz - (a.y * c.z + c.y * a.z), I.zz - 2.0 * (a.z * c.z),
        ),
        Mat3(
            H.xx - (a.x * d.x + c.x * b.x), H.xy - (a.x * d.y + c.x * b.y), H.xz - (a.x * d.z + c.x * b.z),
            H.yx - (a.y * d.x + c.y * b.x), H.yy - (a.y * d.y + c.y * b.y), H.yz - (a.y * d.z + c.y * b.z),
            H.zx - (a.z * d.x + c.z * b.x), H.zy - (a.z * d.y + c.z * b.y), H.zz - (a.z * d.z + c.z * b.z),
        ),
        Sym(
            M.xx - 2.0 * (b.x * d.x), M.xy - (b.x * d.y + d.x * b.y), M.xz - (b.x * d.z + d.x * b.z),
            M.yy - 2.0 * (b.y * d.y), M.yz - (b.y * d.z + d.y * b.z), M.zz - 2.0 * (b.z * d.z),
        ),
    )  # fmt: skip


@inline
def operational_space_inertia_inverse(
    bodies: Bodies, work: Work, q: Config, row: int, placement: Matrix, reference: int, out: Matrix, pivots: Vector
) -> None:
    """Φ of the frame, through the rows that carry it."""
    articulate(bodies, work, q, pivots)
    put_articulated(work[0].Phi, zero_inverse())
    world = identity_pose()
    for i in range(1, row + 1):
        if row <= bodies[i].last_row:  # i carries the frame
            here = work[i]
            X, S = pose_of(here.X), motion_of(bodies[i].S)
            put_articulated(here.Phi, through_row(bodies, work, i, X, S, force_of(here.U), here.d))
            if reference != LOCAL:
                world = compose(world, X)
    X = read_pose(placement)
    Phi = inverse_to_child(X, articulated_of(work[row].Phi))
    if reference != LOCAL:
        world = compose(world, X)
        if reference != WORLD:
            world = Pose(world.R, zero())
        Phi = articulated_to_parent(world, Phi)
    I, H, M = Phi.I, Phi.H, Phi.M
    out[0, 0], out[0, 1], out[0, 2], out[0, 3], out[0, 4], out[0, 5] = I.xx, I.xy, I.xz, H.xx, H.xy, H.xz
    out[1, 0], out[1, 1], out[1, 2], out[1, 3], out[1, 4], out[1, 5] = I.xy, I.yy, I.yz, H.yx, H.yy, H.yz
    out[2, 0], out[2, 1], out[2, 2], out[2, 3], out[2, 4], out[2, 5] = I.xz, I.yz, I.zz, H.zx, H.zy, H.zz
    out[3, 0], out[3, 1], out[3, 2], out[3, 3], out[3, 4], out[3, 5] = H.xx, H.yx, H.zx, M.xx, M.xy, M.xz
    out[4, 0], out[4, 1], out[4, 2], out[4, 3], out[4, 4], out[4, 5] = H.xy, H.yy, H.zy, M.xy, M.yy, M.yz
    out[5, 0], out[5, 1], out[5, 2], out[5, 3], out[5, 4], out[5, 5] = H.xz, H.yz, H.zz, M.xz, M.yz, M.zz


# --- two frames -----------------------------------------------------------------------------------------


@inline
def frame_in_world(bodies: Bodies, work: Work, row: int, placement: Matrix) -> Pose:
    """Pose of a frame in the world, from the X of the rows that carry it."""
    X = read_pose(placement)
    i = row
    while i > 0:
        X = compose(pose_of(work[i].X), X)
        i = bodies[i].parent
    return X


@inline
def unit_force(X: Pose, reference: int, k: int) -> Force:
    """Unit force k of a reference, linear first, in the coordinates of the frame whose pose in the world is X."""
    unit = Vec(1.0 if k % 3 == 0 else 0.0, 1.0 if k % 3 == 1 else 0.0, 1.0 if k % 3 == 2 else 0.0)
    f = Force(zero(), unit)
    if k >= 3:
        f = Force(unit, zero())
    if reference == LOCAL:
        return f
    at = X
    if reference != WORLD:
        at = Pose(X.R, zero())
    return force_to_parent(inverse(at), f)


@inline
def operational_space_coupling(
    bodies: Bodies, work: Work, q: Config, row: int, placement: Matrix, other_row: int, other_placement: Matrix,
    reference: int, out: Matrix, pivots: Vector,
) -> None:  # fmt: skip
    """Column k: the acceleration of the frame that a unit force k on the other frame causes."""
    n = len(bodies) - 1
    articulate(bodies, work, q, pivots)
    of_frame, of_other = read_pose(placement), read_pose(other_placement)
    world = frame_in_world(bodies, work, row, placement)
    from_other = frame_in_world(bodies, work, other_row, other_placement)
    put_motion(work[0].a, zero_motion())
    for k in range(6):
        for i in range(n + 1):
            put_force(work[i].F, zero_force())
            work[i].u = 0.0
        put_force(work[other_row].F, force_to_parent(of_other, unit_force(from_other, reference, k)))
        for i in range(other_row, 0, -1):
            if other_row <= bodies[i].last_row:
                here, parent = work[i], work[bodies[i].parent]
                F = force_of(here.F)
                u = power(motion_of(bodies[i].S), F)
                if bodies[i].partner > 0:
                    behind = work[bodies[i].partner]
                    u = u - bodies[bodies[i].partner].coupling * (behind.d * behind.u)
                here.u = u
                left = sub_force(F, scale_force(here.d * u, force_of(here.U)))
                put_force(parent.F, force_to_parent(pose_of(here.X), left))
        for i in range(1, row + 1):
            if row <= bodies[i].last_row:
                here, parent = work[i], work[bodies[i].parent]
                a = motion_to_child(pose_of(here.X), motion_of(parent.a))
                qdd = here.d * (here.u - power(a, force_of(here.U)))
                if bodies[i].coupled:
                    qdd = qdd - here.d * (bodies[i].coupling * parent.qdd)
                here.qdd = qdd
                put_motion(here.a, add_motion(a, scale_motion(qdd, motion_of(bodies[i].S))))
        a = motion_to_child(of_frame, motion_of(work[row].a))
        write_motion(out[:, k], express_in(world, a, reference))


def inverse_through_M(M: MassMatrix, q: Array, row: Array, placement: Array, reference: Array) -> Array:
    """J M⁻¹ Jᵀ."""
    J = M.call("frame_jacobian", q, row, placement, reference)
    return J @ M.inverse @ J.swapaxes(-1, -2)


def coupling_through_M(
    M: MassMatrix, q: Array, row: Array, placement: Array, other_row: Array, other_placement: Array, reference: Array
) -> Array:
    """J M⁻¹ J₂ᵀ."""
    J = M.call("frame_jacobian", q, row, placement, reference)
    other = M.call("frame_jacobian", q, other_row, other_placement, reference)
    return J @ M.inverse @ other.swapaxes(-1, -2)


_UNIT = "1/kg | 1/(kg m) | 1/(kg m²)"
SPECS = (
    Spec(
        "operational_space_inertia_inverse", operational_space_inertia_inverse, WORK,
        (TURNED_Q, ROW, PLACEMENT, REFERENCE),
        Argument("Lambda_inv", (6, 6), _UNIT, "acceleration per force on the frame, linear first, in the reference"),
        "Inverse Λ⁻¹ = J M(q)⁻¹ Jᵀ of the operational-space inertia of a frame, without forming M or J.",
        "after Kreutz-Delgado, Jain and Rodriguez, Recursive formulation of operational space control (1992).",
        pivots=True, regroup=True, through_M=inverse_through_M,
    ),
)  # fmt: skip
COUPLING = Spec(
    "operational_space_coupling", operational_space_coupling, WORK_OF_TWO,
    (
        TURNED_Q, ROW, PLACEMENT,
        Argument("other_row", (), "", "row of the body that carries the other frame", static=True),
        Argument("other_placement", (4, 4), "m", "pose of the other frame in that body", static=True), REFERENCE,
    ),
    Argument("coupling", (6, 6), _UNIT, "acceleration of the frame per force on the other, linear first"),
    "Coupling J M(q)⁻¹ J₂ᵀ of two frames: how a force on the second accelerates the first.",
    "after Jain, Robot and Multibody Dynamics (2011), operational space compliance of several frames.",
    pivots=True, regroup=True, through_M=coupling_through_M,
)  # fmt: skip
