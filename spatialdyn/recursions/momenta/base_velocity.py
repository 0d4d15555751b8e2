"""The velocity of a floating base from the motion of the joints and the momentum of the whole robot.

The first six rows of p = M v are M_bb v_b + M_bj q̇_j = h: M_bb is the composite inertia of the robot, and M_bj q̇_j the
momentum of the joints' motion with the base at rest. After RBDA (2008), tables 6.2 and 5.1.
"""

from __future__ import annotations

from ...algebra.euclidean import Vec, add, cross, scale, sub, unrotate
from ...algebra.public_arrays import read_vec, write_vec
from ...algebra.records import force_of, inertia_of, pose_of, put_force, put_inertia, put_motion, table_dtype
from ...algebra.scalars import inline
from ...algebra.spatial import (
    Force,
    Inertia,
    Motion,
    Pose,
    add_force,
    add_inertia,
    force_to_parent,
    inertia_to_parent,
    momentum,
    zero_force,
    zero_motion,
)
from ...bodies.joints import place_joint
from ..signatures import Bodies, Config, Vector, Work
from ..spec import Argument, Q, Spec, V
from ..steps import body_velocity
from ..tree.rotors import add_rotor_momentum

BASE = 6  # rows of the floating joint, the first of the table
WORK = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # velocity with the base at rest; outward
    p=Force,  # momentum of that motion, outward; of the subtree, inward
    I=Inertia,  # inertia, outward; of the subtree, inward
)


@inline
def base_velocity(bodies: Bodies, work: Work, q: Config, v: Vector, momentum_of: Vector, out: Vector) -> None:
    """v_b = M_bb⁻¹ (h - M_bj q̇_j).

    v            (nv)  joint velocities; the first six are not read
    momentum_of  (6)   h: linear, and angular about the centre of mass, in the world
    out          (6)   written: the base's velocity in its own frame, linear first
    """
    for i in range(1, len(bodies)):
        place_joint(bodies, i, q, work[i].X)
        put_motion(work[i].v, zero_motion())
        put_force(work[i].p, zero_force())
        put_inertia(work[i].I, inertia_of(bodies[i].inertia))
        if i > BASE:
            vi = body_velocity(bodies, work, i, v)
            put_motion(work[i].v, vi)
            put_force(work[i].p, momentum(inertia_of(bodies[i].inertia), vi))
    for i in range(len(bodies) - 1, BASE, -1):
        here, parent = work[i], work[bodies[i].parent]
        X = pose_of(here.X)
        put_inertia(parent.I, add_inertia(inertia_of(parent.I), inertia_to_parent(X, inertia_of(here.I))))
        h = add_rotor_momentum(bodies, i, v, force_to_parent(X, force_of(here.p)))
        put_force(parent.p, add_force(force_of(parent.p), h))
    # of the whole robot in the base's axes: linear l = m (v + ω × c), angular about the centre of mass k = I_c ω
    I, moved, R = inertia_of(work[BASE].I), force_of(work[BASE].p), pose_of(work[1].X).R
    c = scale(1.0 / I.m, I.h)
    l = sub(unrotate(R, read_vec(momentum_of, 0)), moved.f)
    k = sub(unrotate(R, read_vec(momentum_of, 3)), sub(moved.n, cross(c, moved.f)))
    w = about_centre(I, c, k)
    write_vec(out, add(scale(1.0 / I.m, l), cross(c, w)), 0)
    write_vec(out, w, 3)


@inline
def about_centre(I: Inertia, c: Vec, k: Vec) -> Vec:
    """ω = I_c⁻¹ k, with I_c the inertia about the centre of mass c: Cramer's rule."""
    m, J = I.m, I.I
    xx, yy = J.xx - m * (c.y * c.y + c.z * c.z), J.yy - m * (c.x * c.x + c.z * c.z)
    zz = J.zz - m * (c.x * c.x + c.y * c.y)
    xy, xz, yz = J.xy + m * c.x * c.y, J.xz + m * c.x * c.z, J.yz + m * c.y * c.z
    axx, axy, axz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    ayy, ayz, azz = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    d = 1.0 / (xx * axx + xy * axy + xz * axz)
    return Vec(
        d * (axx * k.x + axy * k.y + axz * k.z),
        d * (axy * k.x + ayy * k.y + ayz * k.z),
        d * (axz * k.x + ayz * k.y + azz * k.z),
    )


BASE_VELOCITY = Spec(
    "base_velocity", base_velocity, WORK,
    (Q, V, Argument("momentum", (6,), "kg m/s | kg m²/s", "linear; angular about the centre of mass, in the world")),
    Argument("v_base", (6,), "m/s | rad/s", "velocity of the base in its own frame, linear first"),
    "Velocity of a floating base for a given momentum of the robot.", "after Featherstone, RBDA (2008), table 6.2.",
)  # fmt: skip
