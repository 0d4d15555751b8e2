"""The motion across one row of the table of bodies (see ``bodies.table``)."""

from __future__ import annotations

from typing import Any

from ..algebra.euclidean import Vec, add_rot, plus, rotate, times, zero
from ..algebra.records import (
    motion_of,
    pose_of,
    put_pose,
    put_rot,
    put_vec,
    rot_of,
    vec_of,
)
from ..algebra.rotations import blend, rotation, turn
from ..algebra.scalars import cos, inlined, sin
from ..algebra.spatial import Motion, Pose, add_motion, compose, identity_pose, scale_motion, zero_motion
from .table import ANY_NORM, FLOATING, FOLLOW, PLANAR, PLANAR_CS, PRISMATIC, REVOLUTE, REVOLUTE_CS, SPHERICAL

ROUNDING = 1e-12  # of a squared norm


@inlined
def place_joint(bodies: Any, i: int, q: Any, X: Any) -> None:
    """Write the pose of row i in its parent, X_T X_J(q), to the Pose field X (RBDA table 4.1 and section 4.4).

    Written where it will be stored rather than returned: the twelve numbers of four branches need not meet in
    registers, which makes it a third faster.
    """
    b = bodies[i]
    k = b.at
    if b.kind == REVOLUTE:
        put_rot(X.R, add_rot(rot_of(b.along), blend(cos(q[k]), rot_of(b.across), sin(q[k]), rot_of(b.turned))))
        put_vec(X.p, vec_of(b.X.p))
    elif b.kind == REVOLUTE_CS:
        put_rot(X.R, add_rot(rot_of(b.along), blend(q[k], rot_of(b.across), q[k + 1], rot_of(b.turned))))
        put_vec(X.p, vec_of(b.X.p))
    elif b.kind == PRISMATIC:
        T = pose_of(b.X)
        put_pose(X, Pose(T.R, plus(T.p, rotate(T.R, times(q[k], vec_of(b.S.v))))))
    elif b.kind == FOLLOW:
        put_pose(X, identity_pose())
    else:
        put_pose(X, compose(pose_of(b.X), _general(bodies, i, q)))


@inlined
def _general(bodies: Any, i: int, q: Any) -> Pose:
    """X_J(q) of the kinds with more than one coordinate."""
    kind, k = bodies[i].kind, bodies[i].at
    if kind == SPHERICAL:
        return Pose(rotation(q[k], q[k + 1], q[k + 2], q[k + 3]), zero())
    if kind == FLOATING:
        return Pose(rotation(q[k + 3], q[k + 4], q[k + 5], q[k + 6]), Vec(q[k], q[k + 1], q[k + 2]))
    # planar: the three rows are the two axes of the plane and its normal
    p = plus(times(q[k], vec_of(bodies[i].S.v)), times(q[k + 1], vec_of(bodies[i + 1].S.v)))
    normal = vec_of(bodies[i + 2].S.w)
    if kind == PLANAR:
        return Pose(turn(normal, cos(q[k + 2]), sin(q[k + 2])), p)
    return Pose(turn(normal, q[k + 2], q[k + 3]), p)


@inlined
def joint_motion(bodies: Any, i: int, v: Any) -> Motion:
    """vJ = Σ S v over the rows of the joint that starts at row i; null on its further rows."""
    vJ = zero_motion()
    for k in range(i, i + bodies[i].dofs):
        vJ = add_motion(vJ, scale_motion(v[k - 1], motion_of(bodies[k].S)))
    return vJ


@inlined
def off_norm(bodies: Any, q: Any) -> bool:
    """Whether the table takes q as it is, and a quaternion or pair is off its unit norm by more than rounding."""
    return bodies[0].kind == ANY_NORM and not norms_within(bodies, q, ROUNDING)


@inlined
def norms_within(bodies: Any, q: Any, tolerance: Any) -> bool:
    """Whether the squared norm of every quaternion and (cos, sin) pair of q is within a tolerance of 1."""
    for i in range(1, len(bodies)):
        kind, k = bodies[i].kind, bodies[i].at
        if kind < REVOLUTE_CS:
            continue
        count = 0
        if kind == REVOLUTE_CS:
            count = 2
        elif kind == SPHERICAL:
            count = 4
        elif kind == FLOATING:
            k, count = k + 3, 4
        elif kind == PLANAR_CS:
            k, count = k + 2, 2
        if count > 0:
            square = 0.0
            for m in range(k, k + count):
                square += q[m] * q[m]
            if abs(square - 1.0) > tolerance:
                return False
    return True
