"""The operators of ``spatial`` and ``recursions.lie`` on small arrays, compiled, for callers with one object at a time.

``compose(A, B, out)`` and its like take arrays as ``layouts`` has them, write the last and return nothing. The arrays
are C-ordered, float64 and writable, and not checked: a wrong size is the caller's fault. ``out`` may be an input.
``made_pose()(out, R, p)`` and its like are for arrays of any layout: they check sizes and return a status.

A call takes 0.2 µs, where the operator itself takes 1 to 6 in plain Python. Each is compiled when first called and
kept on disk.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import njit, types

from . import layouts, spatial
from .engines import jit
from .euclidean import (
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
from .layouts import Body, Placed
from .recursions import lie
from .scalars import Scalar, inlined, select, sqrt
from .spatial import Force, Inertia, Motion, Pose

Operation = Callable[..., Any]
EPS = 2.220446049250313e-16  # a sum of masses below it counts as no mass
OK, SIZE, SYMMETRY, SIGN = range(4)
ROUNDING = 1e-12  # relative: an asymmetry or a negative eigenvalue below it is a rounding error


# --- operators that the library has no other use for ------------------------------------------------------


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
    there = spatial.shift_motion(B.c, v)
    return spatial.unshift_force(B.c, Force(apply_sym(B.I, v.w), times(B.m, there.v)))


@inlined
def twice_energy(B: Body, v: Motion) -> Scalar:
    """v · I v of a body."""
    return spatial.power(v, momentum_of(B, v))


@inlined
def about_origin(B: Body) -> Inertia:
    """A body as an Inertia about the origin."""
    return spatial.unshift_inertia(B.c, Inertia(B.m, zero(), B.I))


@inlined
def pull_of(B: Body, v: Motion) -> Force:
    """v ×* I v of a body."""
    return spatial.cross_force(v, momentum_of(B, v))


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


# --- compiled -------------------------------------------------------------------------------------------


def operation(name: str, operator: Callable[..., Any], kinds: str) -> Operation:
    """``(*inputs, out)`` on arrays, for an operator between ``kinds``: "pose vec -> vec"; a "number" is returned."""
    given, made = (part.split() for part in kinds.split("->"))
    names = [f"x{k}" for k in range(len(given))]
    taken = ", ".join(f"get_{kind}({x})" for x, kind in zip(names, given, strict=True))
    result = f"operator({taken})"
    body = ["stamp", f"return {result}" if made == ["number"] else f"put_{made[0]}({result}, out)"]
    parameters = names if made == ["number"] else [*names, "out"]
    function = jit.define(f"algebra_{name}", parameters, body, {**vars(layouts), "operator": operator})
    compiled: Operation = njit(**{**jit.FLAGS, "nogil": False})(function)  # giving the lock up costs 0.03 µs
    return compiled


def checked(name: str, body: list[str], ranks: dict[str, int], rank: int, **scope: Any) -> Operation:
    """``(out, *inputs) -> status`` for an output of that rank and inputs of any layout; rank 0 is a number."""
    array: Any = types.Array
    inputs = [array(types.float64, n, "A", readonly=True) if n else types.float64 for n in ranks.values()]
    function = jit.define(f"algebra_{name}", ["out", *ranks], ["stamp", *body], {**vars(layouts), **scope})
    made = jit.compiled(function, (array(types.float64, rank, "C"), *inputs), nogil=False)
    if not jit.PLAIN:  # transposed matrices too, without which each would take the slow way
        samples = [np.zeros((4,) * n, order="F") if n else 0.0 for n in ranks.values()]
        type(made)._search_new_conversions(made, np.zeros((4,) * rank), *samples)  # type: ignore[attr-defined]
    return made


@cache
def made_pose() -> Operation:
    """``(out (4, 4), R (3, 3), p (3,)) -> status``."""
    body = [f"if R.shape != (3, 3) or p.shape != (3,): return {SIZE}"]
    body += ["put_pose(Pose(get_rot(R), get_vec(p)), out)", f"return {OK}"]
    return checked("made_pose", body, {"R": 2, "p": 1}, 2)


@cache
def made_vector() -> Operation:
    """``(out (6,), linear (3,), angular (3,)) -> status``, for motions and forces alike."""
    body = [f"if linear.shape != (3,) or angular.shape != (3,): return {SIZE}"]
    body += ["put_motion(Motion(get_vec(angular), get_vec(linear)), out)", f"return {OK}"]
    return checked("made_vector", body, {"linear": 1, "angular": 1}, 1)


@cache
def made_body() -> Operation:
    """``(out (10,), m, c (3,), J (3, 3)) -> status``; SYMMETRY or SIGN where no J can be so.

    J is not negative if and only if none of the three coefficients of its characteristic polynomial is.
    """
    body = [
        f"if c.shape != (3,) or J.shape != (3, 3): return {SIZE}",
        "xx, xy, yy, xz, yz, zz = J[0, 0], J[1, 0], J[1, 1], J[2, 0], J[2, 1], J[2, 2]",
        "size = abs(xx) + abs(yy) + abs(zz) + abs(xy) + abs(xz) + abs(yz)",
        f"if max(abs(J[0, 1] - xy), abs(J[0, 2] - xz), abs(J[1, 2] - yz)) > {ROUNDING} * size: return {SYMMETRY}",
        "two = yy * zz - yz * yz + xx * zz - xz * xz + xx * yy - xy * xy",
        "three = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)",
        f"if min(xx + yy + zz, two / size, three / size / size) < -{ROUNDING} * size: return {SIGN}",
        "put_body(Body(m, get_vec(c), Sym(xx, xy, xz, yy, yz, zz)), out)",
        f"return {OK}",
    ]
    return checked("made_body", body, {"m": 0, "c": 1, "J": 2}, 1)


@cache
def point_to_parent() -> Operation:
    """``(out (3,), X (4, 4), a (3,)) -> status``: a point of the child's frame, seen from the parent."""
    return _of_point("point_to_parent", point_of)


@cache
def point_to_child() -> Operation:
    """``(out (3,), X (4, 4), a (3,)) -> status``: a point of the parent's frame, seen from the child."""
    return _of_point("point_to_child", point_in)


def _of_point(name: str, operator: Callable[..., Vec]) -> Operation:
    body = [f"if a.shape != (3,): return {SIZE}", "put_vec(operator(get_pose(X), get_vec(a)), out)", f"return {OK}"]
    return checked(name, body, {"X": 2, "a": 1}, 1, operator=operator)


compose = operation("compose", spatial.compose, "pose pose -> pose")
inverse = operation("inverse", spatial.inverse, "pose -> pose")
relative = operation("relative", relative_pose, "pose pose -> pose")
motion_to_parent = operation("motion_to_parent", spatial.motion_to_parent, "pose motion -> motion")
motion_to_child = operation("motion_to_child", spatial.motion_to_child, "pose motion -> motion")
force_to_parent = operation("force_to_parent", spatial.force_to_parent, "pose force -> force")
force_to_child = operation("force_to_child", spatial.force_to_child, "pose force -> force")
body_to_parent = operation("body_to_parent", moved_body, "pose body -> body")
body_to_child = operation("body_to_child", moved_body_back, "pose body -> body")
action = operation("action", action_of, "pose -> tangent")
action_inverse = operation("action_inverse", action_back, "pose -> tangent")
motion_action = operation("motion_action", spin_of, "motion -> tangent")
cross_motion = operation("cross_motion", spatial.cross_motion, "motion motion -> motion")
cross_force = operation("cross_force", spatial.cross_force, "motion force -> force")
momentum = operation("momentum", momentum_of, "body motion -> force")
twice = operation("twice", twice_energy, "body motion -> number")
power = operation("power", spatial.power, "motion force -> number")
body_matrix = operation("body_matrix", about_origin, "body -> inertia")
pull = operation("pull", pull_of, "body motion -> force")
add_body = operation("add_body", both, "body body -> body")
sub_body = operation("sub_body", rest, "body body -> body")
quat_product = operation("quat_product", lie.product, "quat quat -> quat")
quat_matrix = operation("quat_matrix", lie.matrix, "quat -> rot")
matrix_quat = operation("matrix_quat", of_matrix, "rot -> quat")
from_seven = operation("from_seven", pose_from, "seven -> pose")
to_seven = operation("to_seven", pose_as, "pose -> seven")
cross_matrix = operation("cross_matrix", tilde, "vec -> rot")
exp3 = operation("exp3", rotation_of, "vec -> rot")
exp3_quat = operation("exp3_quat", lie.exp_rotation, "vec -> quat")
exp6 = operation("exp6", pose_of, "motion -> pose")
exp6_seven = operation("exp6_seven", ended, "motion -> seven")
log3 = operation("log3", vector_of, "rot -> vec")
log3_quat = operation("log3_quat", lie.log_rotation, "quat -> vec")
log6 = operation("log6", motion_of, "pose -> motion")
log6_seven = operation("log6_seven", started, "seven -> motion")
exp3_jacobian = operation("exp3_jacobian", turned_jacobian, "vec -> rot")
log3_jacobian = operation("log3_jacobian", turned_jacobian_back, "rot -> rot")
exp6_jacobian = operation("exp6_jacobian", lie.exp_jacobian, "motion -> tangent")
log6_jacobian = operation("log6_jacobian", log_jacobian_of, "pose -> tangent")
log3_bend = operation("log3_bend", bent_log, "rot vec -> rot")
