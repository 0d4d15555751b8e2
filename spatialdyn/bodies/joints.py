"""Pose and motion across one row of the table of bodies (see ``bodies.table``)."""

from __future__ import annotations

from typing import Any

from ..algebra.euclidean import Mat3, Vec, add, add_mat3, dot, rotate, scale, zero
from ..algebra.records import mat3_of, motion_of, pose_of, put_mat3, put_pose, put_vec, vec_of
from ..algebra.rotations import NORM_ROUNDING, blend, rotation, turn
from ..algebra.scalars import Scalar, anywhere, inline
from ..algebra.spatial import Motion, Pose, add_motion, compose, identity_pose, scale_motion, zero_motion
from .coordinates import coordinate, cosine, sine
from .kinds import CONTINUED, FLOATING, HELICAL, LENGTHS, PLANAR, PRISMATIC, REVOLUTE, REVOLUTE_CS, SPHERICAL, UNITS
from .table import ANY_NORM


@inline
def place_joint(bodies: Any, i: int, q: Any, X: Any) -> None:
    """Write the pose of row i in its parent, X_T X_J(q), to the Pose field X (RBDA table 4.1 and section 4.4).

    Written where it will be stored rather than returned: the twelve numbers of four branches need not meet in
    registers.
    """
    b = bodies[i]
    k = b.q_index
    if b.kind == REVOLUTE:
        put_mat3(X.R, _rotated(b, cosine(q, k), sine(q, k)))
        put_vec(X.p, vec_of(b.X.p))
    elif b.kind == REVOLUTE_CS:
        put_mat3(X.R, _rotated(b, coordinate(q, k), coordinate(q, k + 1)))
        put_vec(X.p, vec_of(b.X.p))
    elif b.kind == PRISMATIC:
        T = pose_of(b.X)
        put_pose(X, Pose(T.R, add(T.p, rotate(T.R, scale(coordinate(q, k), vec_of(b.S.v))))))
    elif b.kind == CONTINUED:
        put_pose(X, identity_pose())
    elif b.kind == HELICAL:
        put_mat3(X.R, _rotated(b, cosine(q, k), sine(q, k)))
        put_vec(X.p, add(vec_of(b.X.p), rotate(mat3_of(b.X.R), scale(coordinate(q, k), vec_of(b.S.v)))))
    else:
        put_pose(X, compose(pose_of(b.X), _general(bodies, i, q)))


@inline
def _rotated(b: Any, c: Scalar, s: Scalar) -> Mat3:
    """R of a joint with one axis, from the cosine and sine of its angle."""
    return add_mat3(mat3_of(b.axial), blend(c, mat3_of(b.transverse), s, mat3_of(b.skewed)))


@inline
def _turned(q: Any, k: int) -> Mat3:
    """R of the quaternion from q_k on."""
    return rotation(coordinate(q, k), coordinate(q, k + 1), coordinate(q, k + 2), coordinate(q, k + 3))


@inline
def _general(bodies: Any, i: int, q: Any) -> Pose:
    """X_J(q) of the kinds with more than one coordinate."""
    kind, k = bodies[i].kind, bodies[i].q_index
    if kind == SPHERICAL:
        return Pose(_turned(q, k), zero())
    if kind == FLOATING:
        return Pose(_turned(q, k + 3), Vec(coordinate(q, k), coordinate(q, k + 1), coordinate(q, k + 2)))
    # planar: the three rows are the two axes of the plane and its normal
    p = add(scale(coordinate(q, k), vec_of(bodies[i].S.v)), scale(coordinate(q, k + 1), vec_of(bodies[i + 1].S.v)))
    normal = vec_of(bodies[i + 2].S.w)
    if kind == PLANAR:
        return Pose(turn(normal, cosine(q, k + 2), sine(q, k + 2)), p)
    return Pose(turn(normal, coordinate(q, k + 2), coordinate(q, k + 3)), p)


@inline
def pitch_of(b: Any) -> Any:
    """Pitch of the joint of row b: its travel along the axis per radian [m/rad]."""
    return dot(vec_of(b.S.w), vec_of(b.S.v))


@inline
def joint_motion(bodies: Any, i: int, v: Any) -> Motion:
    """vJ = Σ S v over the rows of the joint that starts at row i; zero on its other rows."""
    vJ = zero_motion()
    for k in range(i, i + bodies[i].dofs):
        vJ = add_motion(vJ, scale_motion(v[k - 1], motion_of(bodies[k].S)))
    return vJ


@inline
def off_norm(bodies: Any, q: Any) -> bool:
    """Whether the table accepts any norm and a quaternion or pair of q is off unit norm by more than rounding."""
    return bodies[0].kind == ANY_NORM and not norms_within(bodies, q, NORM_ROUNDING)


@inline
def norms_within(bodies: Any, q: Any, tolerance: Any) -> bool:
    """Whether the squared norm of every quaternion and (cos, sin) pair of q is within a tolerance of 1."""
    for i in range(1, len(bodies)):
        kind = bodies[i].kind
        count = UNITS[kind]
        if count > 0:
            k = bodies[i].q_index + LENGTHS[kind]
            square = 0.0
            for m in range(k, k + count):
                square += coordinate(q, m) * coordinate(q, m)
            if anywhere(abs(square - 1.0) > tolerance):
                return False
    return True
