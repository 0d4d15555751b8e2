"""Operators that no recursion needs: on bodies about their centre of mass, on poses with quaternions, exp and log."""

from __future__ import annotations

from ...algebra import lie
from ...algebra.euclidean import (
    Mat3,
    Sym,
    Vec,
    add,
    add_sym,
    apply_sym,
    congruence,
    matmul,
    parallel_axis,
    rotate,
    scale,
    sub,
    transpose,
    unrotate,
    zero,
)
from ...algebra.public_arrays import Body, Placed
from ...algebra.scalars import EPS, Scalar, inline, select, sqrt
from ...algebra.spatial import (
    Force,
    Inertia,
    Motion,
    Pose,
    cross_force,
    force_at_parent,
    inertia_at_parent,
    motion_at_child,
    power,
)


@inline
def skew(a: Vec) -> Mat3:
    """The matrix ã with ã b = a × b."""
    return Mat3(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)


@inline
def relative_pose(A: Pose, B: Pose) -> Pose:
    """A⁻¹ B: the pose of frame B in frame A."""
    return Pose(matmul(transpose(A.R), B.R), unrotate(A.R, sub(B.p, A.p)))


@inline
def point_to_parent(X: Pose, a: Vec) -> Vec:
    """A point in child coordinates, in parent coordinates."""
    return add(X.p, rotate(X.R, a))


@inline
def point_to_child(X: Pose, a: Vec) -> Vec:
    """A point in parent coordinates, in child coordinates."""
    return unrotate(X.R, sub(a, X.p))


@inline
def body_momentum(B: Body, v: Motion) -> Force:
    """Momentum of a body about the origin: about its centre of mass, then shifted."""
    there = motion_at_child(B.c, v)
    return force_at_parent(B.c, Force(apply_sym(B.I, v.w), scale(B.m, there.v)))


@inline
def twice_kinetic_energy(B: Body, v: Motion) -> Scalar:
    """v · I v of a body, twice its kinetic energy."""
    return power(v, body_momentum(B, v))


@inline
def inertia_about_origin(B: Body) -> Inertia:
    """Spatial inertia of a body about the origin."""
    return inertia_at_parent(B.c, Inertia(B.m, zero(), B.I))


@inline
def bias_force(B: Body, v: Motion) -> Force:
    """v ×* I v of a body, its bias force."""
    return cross_force(v, body_momentum(B, v))


@inline
def body_to_parent(X: Pose, B: Body) -> Body:
    """A body in child coordinates, in parent coordinates."""
    return Body(B.m, point_to_parent(X, B.c), congruence(X.R, B.I))


@inline
def body_to_child(X: Pose, B: Body) -> Body:
    """A body in parent coordinates, in child coordinates."""
    return Body(B.m, point_to_child(X, B.c), congruence(transpose(X.R), B.I))


@inline
def _combined(A: Body, B: Body, sign: Scalar) -> Body:
    """A and B as one body (sign 1), or A without B (sign -1); the centre of zero mass is 0."""
    n = sign * B.m
    m = A.m + n
    # a sum of masses below EPS counts as no mass
    inverse = select(m * m - EPS * EPS, 1.0, 0.0) / select(m * m - EPS * EPS, m, 1.0)
    c = scale(inverse, add(scale(A.m, A.c), scale(n, B.c)))
    d = sub(A.c, B.c)
    J = B.I
    other = Sym(sign * J.xx, sign * J.xy, sign * J.xz, sign * J.yy, sign * J.yz, sign * J.zz)
    return Body(m, c, parallel_axis(add_sym(A.I, other), d, zero(), scale(A.m * n * inverse, d)))


@inline
def add_bodies(A: Body, B: Body) -> Body:
    """A and B as one body."""
    return _combined(A, B, 1.0)


@inline
def subtract_bodies(A: Body, B: Body) -> Body:
    """A without its part B."""
    return _combined(A, B, -1.0)


@inline
def quaternion_of_matrix(R: Mat3) -> lie.Quat:
    """The quaternion of a rotation matrix, scalar part not negative unless it is the smallest.

    Each component can be the root of a sum, and gives the others by division; the largest one cancels no digits.
    Source: Shepperd, Quaternion from rotation matrix (1978).
    """
    w, x, y, z = R.xx + R.yy + R.zz, R.xx, R.yy, R.zz
    a, b, c = R.zy - R.yz, R.xz - R.zx, R.yx - R.xy
    d, e, f = R.yx + R.xy, R.xz + R.zx, R.zy + R.yz
    first = select(w, 1.0, 0.0)
    other = 1.0 - first
    on_x = other * select(y - x, 0.0, select(z - x, 0.0, 1.0))
    on_y = other * (1.0 - on_x) * select(z - y, 0.0, 1.0)
    on_z = other * (1.0 - on_x) * (1.0 - on_y)
    t = 1.0 + first * w + on_x * (x - y - z) + on_y * (y - z - x) + on_z * (z - x - y)
    s = 0.5 / sqrt(t)
    return lie.scale_quat(
        s,
        lie.Quat(
            first * a + on_x * t + on_y * d + on_z * e,
            first * b + on_x * d + on_y * t + on_z * f,
            first * c + on_x * e + on_y * f + on_z * t,
            first * t + on_x * a + on_y * b + on_z * c,
        ),
    )


@inline
def action_matrix(X: Pose) -> lie.Tangent:
    """The matrix that takes motions in child coordinates to parent coordinates."""
    return lie.Tangent(X.R, matmul(skew(X.p), X.R))


@inline
def inverse_action_matrix(X: Pose) -> lie.Tangent:
    """The matrix that takes motions in parent coordinates to child coordinates."""
    return lie.Tangent(transpose(X.R), transpose(matmul(skew(X.p), X.R)))


@inline
def cross_motion_matrix(m: Motion) -> lie.Tangent:
    """The matrix of m × on motions."""
    return lie.Tangent(skew(m.w), skew(m.v))


@inline
def exp_rotation(w: Vec) -> Mat3:
    """exp of a rotation vector, a rotation matrix."""
    return lie.matrix(lie.exp_rotation(w))


@inline
def exp_pose(m: Motion) -> Pose:
    """exp of a motion, a pose."""
    return Pose(lie.matrix(lie.exp_rotation(m.w)), lie.exp_travel(m))


@inline
def log_rotation(R: Mat3) -> Vec:
    """log of a rotation matrix."""
    return lie.log_rotation(quaternion_of_matrix(R))


@inline
def log_pose(X: Pose) -> Motion:
    """log of a pose."""
    w = log_rotation(X.R)
    return Motion(w, lie.log_travel(w, X.p))


@inline
def pose_from_xyzquat(X: Placed) -> Pose:
    """Pose of an origin and a unit quaternion."""
    return Pose(lie.matrix(X.q), X.p)


@inline
def pose_to_xyzquat(X: Pose) -> Placed:
    """Origin and quaternion of a pose."""
    return Placed(X.p, quaternion_of_matrix(X.R))


@inline
def exp_xyzquat(m: Motion) -> Placed:
    """exp of a motion, as origin and quaternion."""
    return Placed(lie.exp_travel(m), lie.exp_rotation(m.w))


@inline
def log_xyzquat(X: Placed) -> Motion:
    """log of an origin and a quaternion."""
    w = lie.log_rotation(X.q)
    return Motion(w, lie.log_travel(w, X.p))


@inline
def exp_rotation_jacobian(w: Vec) -> Mat3:
    """Right Jacobian of exp at a rotation vector."""
    return lie.exp_jacobian(Motion(w, zero())).J


@inline
def log_rotation_jacobian(R: Mat3) -> Mat3:
    """Inverse of the right Jacobian of exp, at log R."""
    return lie.log_jacobian(Motion(log_rotation(R), zero()), 1.0).J


@inline
def log_pose_jacobian(X: Pose) -> lie.Tangent:
    """Inverse of the right Jacobian of exp, at log X."""
    return lie.log_jacobian(log_pose(X), 1.0)


@inline
def log_rotation_jacobian_derivative(R: Mat3, v: Vec) -> Mat3:
    """Derivative of ``log_rotation_jacobian(R exp(s v))`` by s, at s = 0."""
    w = log_rotation(R)
    rate = rotate(lie.log_jacobian(Motion(w, zero()), 1.0).J, v)
    return lie.log_jacobian(Motion(w, rate), 1.0).K
