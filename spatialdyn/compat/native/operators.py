"""Operators that recursions have no use for: on bodies about their centre of mass, poses by quaternion, logarithms."""

from __future__ import annotations

from ...algebra import lie
from ...algebra.euclidean import (
    Rot,
    Sym,
    Vec,
    add_sym,
    apply_sym,
    congruence,
    matmul,
    minus,
    plus,
    rotate,
    shifted,
    times,
    transpose,
    unrotate,
    zero,
)
from ...algebra.public_arrays import Body, Placed
from ...algebra.scalars import Scalar, inlined, select, sqrt
from ...algebra.spatial import (
    Force,
    Inertia,
    Motion,
    Pose,
    cross_force,
    power,
    shift_motion,
    unshift_force,
    unshift_inertia,
)

EPS = 2.220446049250313e-16  # a sum of masses below it counts as no mass


@inlined
def tilde(a: Vec) -> Rot:
    """The matrix ã with ã b = a × b."""
    return Rot(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)


@inlined
def relative_pose(A: Pose, B: Pose) -> Pose:
    """A⁻¹ B: the frame B seen from the frame A."""
    return Pose(matmul(transpose(A.R), B.R), unrotate(A.R, minus(B.p, A.p)))


@inlined
def point_of(X: Pose, a: Vec) -> Vec:
    """A point in child coordinates, in parent coordinates."""
    return plus(X.p, rotate(X.R, a))


@inlined
def point_in(X: Pose, a: Vec) -> Vec:
    """A point in parent coordinates, in child coordinates."""
    return unrotate(X.R, minus(a, X.p))


@inlined
def momentum_of(B: Body, v: Motion) -> Force:
    """Momentum of a body about the origin: taken about its centre of mass, then shifted."""
    there = shift_motion(B.c, v)
    return unshift_force(B.c, Force(apply_sym(B.I, v.w), times(B.m, there.v)))


@inlined
def twice_energy(B: Body, v: Motion) -> Scalar:
    """v · I v of a body."""
    return power(v, momentum_of(B, v))


@inlined
def about_origin(B: Body) -> Inertia:
    """A body as an Inertia about the origin."""
    return unshift_inertia(B.c, Inertia(B.m, zero(), B.I))


@inlined
def pull_of(B: Body, v: Motion) -> Force:
    """v ×* I v of a body."""
    return cross_force(v, momentum_of(B, v))


@inlined
def moved_body(X: Pose, B: Body) -> Body:
    """A body in child coordinates, in parent coordinates."""
    return Body(B.m, point_of(X, B.c), congruence(X.R, B.I))


@inlined
def moved_body_back(X: Pose, B: Body) -> Body:
    """A body in parent coordinates, in child coordinates."""
    return Body(B.m, point_in(X, B.c), congruence(transpose(X.R), B.I))


@inlined
def with_sign(A: Body, B: Body, sign: Scalar) -> Body:
    """Two bodies made one (sign 1), or the body that B leaves of A (-1); no mass has its centre at 0."""
    n = sign * B.m
    m = A.m + n
    scale = select(m * m - EPS * EPS, 1.0, 0.0) / select(m * m - EPS * EPS, m, 1.0)
    c = times(scale, plus(times(A.m, A.c), times(n, B.c)))
    d = minus(A.c, B.c)
    J = B.I
    other = Sym(sign * J.xx, sign * J.xy, sign * J.xz, sign * J.yy, sign * J.yz, sign * J.zz)
    return Body(m, c, shifted(add_sym(A.I, other), d, zero(), times(A.m * n * scale, d)))


@inlined
def both(A: Body, B: Body) -> Body:
    """Two bodies made one."""
    return with_sign(A, B, 1.0)


@inlined
def rest(A: Body, B: Body) -> Body:
    """The body that is left of A without B."""
    return with_sign(A, B, -1.0)


@inlined
def of_matrix(R: Rot) -> lie.Quat:
    """The quaternion of a rotation matrix, scalar part not negative unless it is the smallest.

    Each of the four squares gives one component without cancelling and the others by division; the largest is taken.
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


@inlined
def action_of(X: Pose) -> lie.Tangent:
    """The matrix that takes motions in child coordinates to parent coordinates."""
    return lie.Tangent(X.R, matmul(tilde(X.p), X.R))


@inlined
def action_back(X: Pose) -> lie.Tangent:
    """The matrix that takes motions in parent coordinates to child coordinates."""
    return lie.Tangent(transpose(X.R), transpose(matmul(tilde(X.p), X.R)))


@inlined
def spin_of(m: Motion) -> lie.Tangent:
    """The matrix of m ×."""
    return lie.Tangent(tilde(m.w), tilde(m.v))


@inlined
def rotation_of(w: Vec) -> Rot:
    """exp of a rotation vector."""
    return lie.matrix(lie.exp_rotation(w))


@inlined
def pose_of(m: Motion) -> Pose:
    """exp of a motion."""
    return Pose(lie.matrix(lie.exp_rotation(m.w)), lie.exp_travel(m))


@inlined
def vector_of(R: Rot) -> Vec:
    """log of a rotation matrix."""
    return lie.log_rotation(of_matrix(R))


@inlined
def motion_of(X: Pose) -> Motion:
    """log of a pose."""
    w = vector_of(X.R)
    return Motion(w, lie.log_travel(w, X.p))


@inlined
def pose_from(X: Placed) -> Pose:
    """The pose of an origin and a unit quaternion."""
    return Pose(lie.matrix(X.q), X.p)


@inlined
def pose_as(X: Pose) -> Placed:
    """Origin and quaternion of a pose."""
    return Placed(X.p, of_matrix(X.R))


@inlined
def ended(m: Motion) -> Placed:
    """exp of a motion, as origin and quaternion."""
    return Placed(lie.exp_travel(m), lie.exp_rotation(m.w))


@inlined
def started(X: Placed) -> Motion:
    """log of an origin and a quaternion."""
    w = lie.log_rotation(X.q)
    return Motion(w, lie.log_travel(w, X.p))


@inlined
def turned_jacobian(w: Vec) -> Rot:
    """Right Jacobian of exp at a rotation vector."""
    return lie.exp_jacobian(Motion(w, zero())).J


@inlined
def turned_jacobian_back(R: Rot) -> Rot:
    """Inverse of the right Jacobian of exp at log R."""
    return lie.log_jacobian(Motion(vector_of(R), zero()), 1.0).J


@inlined
def log_jacobian_of(X: Pose) -> lie.Tangent:
    """Inverse of the right Jacobian of exp at log X."""
    return lie.log_jacobian(motion_of(X), 1.0)


@inlined
def bent_log(R: Rot, v: Vec) -> Rot:
    """The derivative of that inverse as R turns on by v, given in the turned axes."""
    w = vector_of(R)
    rate = rotate(lie.log_jacobian(Motion(w, zero()), 1.0).J, v)
    return lie.log_jacobian(Motion(w, rate), 1.0).K
