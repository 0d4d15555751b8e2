"""Operators that no recursion needs: on bodies about their centre of mass, on poses with quaternions, exp and log."""

from __future__ import annotations

import math
from typing import Any

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
    neg,
    parallel_axis,
    rotate,
    scale,
    sub,
    transpose,
    unrotate,
    zero,
)
from ...algebra.public_arrays import Body, Placed
from ...algebra.scalars import EPS, Scalar, atan2, cos, inline, select, sin, sqrt
from ...algebra.spatial import (
    Force,
    Inertia,
    Motion,
    Pose,
    compose,
    cross_force,
    force_at_parent,
    inertia_at_parent,
    motion_at_child,
    power,
    scale_force,
    scale_motion,
)

PI = 3.141592653589793
NO_LIMIT = 1.7976931348623157e308  # the largest number: a limit of that size is none
TURN = 6.283185307179586  # [rad]
SOUND, NEGATIVE, ASYMMETRIC = 0.0, 1.0, 2.0  # faults of a rotational inertia
ROUNDING = 1e-12  # relative: an asymmetry or a negative eigenvalue below it is a rounding error


@inline
def itself(x: Any) -> Any:
    """x."""
    return x


# --- rotations ---------------------------------------------------------------------------------------------


@inline
def skew(a: Vec) -> Mat3:
    """The matrix ã with ã b = a × b."""
    return Mat3(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)


@inline
def rotation_of_angles(roll: Scalar, pitch: Scalar, yaw: Scalar) -> Mat3:
    """R_z(yaw) R_y(pitch) R_x(roll)."""
    a, b, c = cos(roll), cos(pitch), cos(yaw)
    s, t, u = sin(roll), sin(pitch), sin(yaw)
    return Mat3(
        c * b, c * t * s - u * a, c * t * a + u * s,
        u * b, u * t * s + c * a, u * t * a - c * s,
        -t, b * s, b * a,
    )  # fmt: skip


@inline
def rotation_of_rpy(rpy: Vec) -> Mat3:
    """``rotation_of_angles`` of a vector."""
    return rotation_of_angles(rpy.x, rpy.y, rpy.z)


@inline
def unskew(A: Mat3) -> Vec:
    """The vector whose matrix is the antisymmetric part of A."""
    return scale(0.5, Vec(A.zy - A.yz, A.xz - A.zx, A.yx - A.xy))


@inline
def skew_product(a: Vec, b: Vec) -> Mat3:
    """ã b̃."""
    return matmul(skew(a), skew(b))


@inline
def dot_quats(p: lie.Quat, q: lie.Quat) -> Scalar:
    """The sum of the products of coefficients."""
    return p.x * q.x + p.y * q.y + p.z * q.z + p.w * q.w


@inline
def rpy_of_rotation(R: Mat3) -> Vec:
    """Roll, pitch and yaw of a rotation matrix.

    The yaw turned back leaves R_y(pitch) R_x(roll), whose second row is (0, cos roll, -sin roll): no angle loses
    digits, and at a pitch of ±π/2, where roll and yaw are not unique, rounding errors choose the yaw.
    """
    yaw = atan2(R.yx, R.xx)
    s, c = sin(yaw), cos(yaw)
    roll = atan2(s * R.xz - c * R.yz, c * R.yy - s * R.xy)
    return Vec(roll, atan2(-R.zx, sqrt(R.zy * R.zy + R.zz * R.zz)), yaw)


# --- motions and poses -------------------------------------------------------------------------------------


@inline
def divide(a: Vec, s: Scalar) -> Vec:
    """a / s."""
    return Vec(a.x / s, a.y / s, a.z / s)


@inline
def divided_motion(m: Motion, s: Scalar) -> Motion:
    """m / s."""
    return Motion(divide(m.w, s), divide(m.v, s))


@inline
def divided_force(f: Force, s: Scalar) -> Force:
    """f / s."""
    return Force(divide(f.n, s), divide(f.f, s))


@inline
def scaled_motion(m: Motion, s: Scalar) -> Motion:
    """s m."""
    return scale_motion(s, m)


@inline
def scaled_force(f: Force, s: Scalar) -> Force:
    """s f."""
    return scale_force(s, f)


@inline
def minus_motion(m: Motion) -> Motion:
    """-m."""
    return Motion(neg(m.w), neg(m.v))


@inline
def minus_force(f: Force) -> Force:
    """-f."""
    return Force(neg(f.n), neg(f.f))


@inline
def power_of_force(f: Force, m: Motion) -> Scalar:
    """The power of f along m."""
    return power(m, f)


@inline
def cross_matrix(m: Motion) -> lie.Tangent:
    """The matrix of m ×."""
    return lie.Tangent(skew(m.w), skew(m.v))


@inline
def pose_of_quaternion(q: lie.Quat, p: Vec) -> Pose:
    """The pose of a quaternion and an origin."""
    return Pose(lie.matrix(q), p)


@inline
def pose_of_seven(x: Placed) -> Pose:
    """The pose of an origin and a quaternion."""
    return Pose(lie.matrix(x.q), x.p)


@inline
def seven_of_pose(X: Pose) -> Placed:
    """The origin and the quaternion of a pose."""
    return Placed(X.p, quaternion_of_matrix(X.R))


@inline
def random_pose(u: Motion) -> Pose:
    """A uniform rotation and an origin within ±1 in each axis, of six draws in [0, 1)."""
    return Pose(lie.matrix(random_rotation(u.v)), sub(scale(2.0, u.w), Vec(1.0, 1.0, 1.0)))


@inline
def action(X: Pose) -> lie.Tangent:
    """The matrix that takes motions from the frame X to its reference frame."""
    return lie.Tangent(X.R, matmul(skew(X.p), X.R))


@inline
def action_back(X: Pose) -> lie.Tangent:
    """The inverse of ``action``."""
    return lie.Tangent(transpose(X.R), transpose(matmul(skew(X.p), X.R)))


@inline
def interpolated(A: Pose, B: Pose, alpha: Scalar) -> Pose:
    """A exp(alpha log(A⁻¹ B))."""
    return compose(A, exp_pose(scale_motion(alpha, log_pose(relative_pose(A, B)))))


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


# --- bodies ------------------------------------------------------------------------------------------------


@inline
def lower_triangle(J: Mat3) -> Sym:
    """The symmetric matrix whose lower triangle is J's."""
    return Sym(J.xx, J.yx, J.zx, J.yy, J.zy, J.zz)


@inline
def fault_of_inertia(J: Mat3) -> Scalar:
    """ASYMMETRIC (or not finite) or NEGATIVE if no body has the rotational inertia J, else SOUND.

    J is positive semidefinite if and only if no coefficient of its characteristic polynomial is negative.
    """
    size = abs(J.xx) + abs(J.yy) + abs(J.zz) + abs(J.yx) + abs(J.zx) + abs(J.zy)
    if not (size < math.inf and max(abs(J.xy - J.yx), abs(J.xz - J.zx), abs(J.yz - J.zy)) <= ROUNDING * size):
        return ASYMMETRIC
    two = J.yy * J.zz - J.zy * J.zy + J.xx * J.zz - J.zx * J.zx + J.xx * J.yy - J.yx * J.yx
    three = J.xx * (J.yy * J.zz - J.zy * J.zy) - J.yx * (J.yx * J.zz - J.zy * J.zx)
    three += J.zx * (J.yx * J.zy - J.yy * J.zx)
    least = min((J.xx + J.yy + J.zz) * size * size, two * size, three)
    return NEGATIVE if least < -ROUNDING * size * size * size else SOUND


@inline
def body_momentum(B: Body, v: Motion) -> Force:
    """Momentum of a body about the origin: about its centre of mass, then shifted."""
    there = motion_at_child(B.c, v)
    return force_at_parent(B.c, Force(apply_sym(B.I, v.w), scale(B.m, there.v)))


@inline
def body_of_parameters(p: Body) -> Body:
    """The body whose mass, first moments and rotational inertia about the origin stand in the places of a body."""
    m, J = p.m, p.I
    c = divide(p.c, m if m != 0.0 else 1.0)
    xx, yy, zz = m * c.x * c.x, m * c.y * c.y, m * c.z * c.z
    yz, zx, xy = m * c.y * c.z, m * c.z * c.x, m * c.x * c.y
    I = Sym(J.xx - (yy + zz), J.xy + xy, J.xz + zx, J.yy - (xx + zz), J.yz + yz, J.zz - (xx + yy))
    return Body(m, c, I)


@inline
def inertia_about_origin(B: Body) -> Inertia:
    """Spatial inertia of a body about the origin."""
    return inertia_at_parent(B.c, Inertia(B.m, zero(), B.I))


@inline
def body_to_parent(X: Pose, B: Body) -> Body:
    """A body in child coordinates, in parent coordinates."""
    return Body(B.m, point_to_parent(X, B.c), congruence(X.R, B.I))


@inline
def body_to_child(X: Pose, B: Body) -> Body:
    """A body in parent coordinates, in child coordinates."""
    return Body(B.m, point_to_child(X, B.c), congruence(transpose(X.R), B.I))


@inline
def combined(A: Body, B: Body, sign: Scalar) -> Body:
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
def body_of(mass: Scalar, lever: Vec, inertia: Mat3) -> Body:
    """A body of these parts, of which the lower triangle of the inertia."""
    return Body(mass, lever, lower_triangle(inertia))


@inline
def rotational_inertia(B: Body) -> Mat3:
    """The rotational inertia about the centre of mass."""
    return Mat3(B.I.xx, B.I.xy, B.I.xz, B.I.xy, B.I.yy, B.I.yz, B.I.xz, B.I.yz, B.I.zz)


@inline
def without(A: Body, B: Body) -> Body:
    """A without B."""
    return combined(A, B, -1.0)


@inline
def bias_force(B: Body, v: Motion) -> Force:
    """v ×* I v."""
    return cross_force(v, body_momentum(B, v))


@inline
def twice_the_energy(B: Body, v: Motion) -> Scalar:
    """vᵀ I v."""
    return power(v, body_momentum(B, v))


@inline
def add_bodies(A: Body, B: Body) -> Body:
    """A and B as one body."""
    return combined(A, B, 1.0)


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
def exp_pose(m: Motion) -> Pose:
    """exp of a motion, a pose."""
    return Pose(lie.matrix(lie.exp_rotation(m.w)), lie.exp_travel(m))


@inline
def log_matrix(R: Mat3) -> Vec:
    """log of a rotation matrix."""
    return lie.log_rotation(quaternion_of_matrix(R))


@inline
def log_pose(X: Pose) -> Motion:
    """log of a pose."""
    return log_placed(X.p, log_matrix(X.R))


@inline
def exp_matrix(w: Vec) -> Mat3:
    """exp of a rotation vector, a rotation matrix."""
    return lie.matrix(lie.exp_rotation(w))


@inline
def exp_matrix_jacobian(w: Vec) -> Mat3:
    """The right Jacobian of exp of a rotation vector."""
    return lie.exp_jacobian(Motion(w, zero())).J


@inline
def log_matrix_jacobian(R: Mat3) -> Mat3:
    """The inverse of the right Jacobian of exp at log R."""
    return lie.log_jacobian(Motion(log_matrix(R), zero()), 1.0).J


@inline
def exp_seven(m: Motion) -> Placed:
    """exp of a motion, an origin and a quaternion."""
    return Placed(lie.exp_travel(m), lie.exp_rotation(m.w))


@inline
def log_seven(x: Placed) -> Motion:
    """log of an origin and a quaternion."""
    return log_placed(x.p, lie.log_rotation(x.q))


@inline
def log_pose_jacobian(X: Pose) -> lie.Tangent:
    """The inverse of the right Jacobian of exp at log X."""
    return lie.log_jacobian(log_pose(X), 1.0)


@inline
def log_placed(p: Vec, w: Vec) -> Motion:
    """log of an origin and a rotation vector."""
    return Motion(w, lie.log_travel(w, p))


@inline
def log_matrix_jacobian_derivative(R: Mat3, v: Vec) -> Mat3:
    """Derivative of the inverse right Jacobian of exp at log(R exp(s v)) by s, at s = 0."""
    w = log_matrix(R)
    rate = rotate(lie.log_jacobian(Motion(w, zero()), 1.0).J, v)
    return lie.log_jacobian(Motion(w, rate), 1.0).K


@inline
def random_rotation(u: Vec) -> lie.Quat:
    """A quaternion, uniform over rotations if u is uniform over the unit cube (Shoemake, Uniform random rotations)."""
    r, s, a, b = sqrt(1.0 - u.x), sqrt(u.x), 2.0 * PI * u.y, 2.0 * PI * u.z
    return lie.Quat(r * sin(a), r * cos(a), s * sin(b), s * cos(b))


# --- numbers -----------------------------------------------------------------------------------------------


@inline
def same(a: Any, b: Any) -> Scalar:
    """1 if two vectors or tuples agree in each entry, else 0."""
    for i in range(len(a)):
        if a[i] != b[i]:
            return 0.0
    return 1.0


@inline
def near(a: Any, b: Any, precision: Scalar) -> Scalar:
    """1 if |a - b| <= precision min(|a|, |b|) in the Euclidean norm of vectors or tuples, else 0."""
    apart = first = second = 0.0
    for i in range(len(a)):
        apart += (a[i] - b[i]) * (a[i] - b[i])
        first += a[i] * a[i]
        second += b[i] * b[i]
    return 1.0 if apart <= precision * precision * min(first, second) else 0.0


@inline
def small(a: Any, precision: Scalar) -> Scalar:
    """1 if no entry of a vector exceeds the precision, else 0."""
    for i in range(len(a)):
        if not abs(a[i]) <= precision:
            return 0.0
    return 1.0


@inline
def near_or_small(a: Any, b: Any, precision: Scalar) -> Scalar:
    """1 if two vectors are ``near`` or both ``small``, else 0."""
    return max(near(a, b, precision), small(a, precision) * small(b, precision))


@inline
def near_spatial(a: Any, b: Any, precision: Scalar) -> Scalar:
    """1 if the linear and the angular parts of two arrays (6,) are ``near_or_small``, else 0."""
    return near_or_small(a[:3], b[:3], precision) * near_or_small(a[3:], b[3:], precision)


@inline
def same_poses(A: Pose, B: Pose) -> Scalar:
    """1 if two poses agree in each entry, else 0."""
    return same(A.R, B.R) * same(A.p, B.p)


@inline
def near_poses(A: Pose, B: Pose, precision: Scalar) -> Scalar:
    """1 if rotations and origins are ``near``, else 0."""
    return near(A.R, B.R, precision) * near(A.p, B.p, precision)


@inline
def near_bodies(a: Any, b: Any, precision: Scalar) -> Scalar:
    """1 if mass, centre and rotational inertia of two arrays of bodies are ``near``, else 0."""
    parts = near(a[:1], b[:1], precision) * near(a[1:4], b[1:4], precision)
    return parts * near(a[4:], b[4:], precision)


@inline
def between(lower: Scalar, upper: Scalar, draw: Scalar) -> Scalar:
    """A number between bounds, by a draw in [0, 1); a bound that is none is 2 away from the other, or one of ±1."""
    low, high = lower, upper
    if abs(lower) >= NO_LIMIT:
        low = -1.0 if abs(upper) >= NO_LIMIT else upper - 2.0
    if abs(upper) >= NO_LIMIT:
        high = 1.0 if abs(lower) >= NO_LIMIT else lower + 2.0
    return low + (high - low) * draw


@inline
def put_direction(out: Any, first: int, size: int, share: Scalar, one: Scalar, two: Scalar) -> None:
    """Write a point of the unit circle (size 2) or of the unit sphere in four dimensions (4), by draws in [0, 1).

    Uniform: on the sphere the square of the radius of the first two coordinates is uniform in [0, 1].
    """
    radius = sqrt(1.0 - share) if size == 4 else 1.0
    out[first], out[first + 1] = radius * cos(TURN * one), radius * sin(TURN * one)
    if size == 4:
        radius = sqrt(share)
        out[first + 2], out[first + 3] = radius * cos(TURN * two), radius * sin(TURN * two)
