"""Operators on small arrays, compiled, for callers with one object at a time.

``compose(A, B, out)`` and its like take arrays as ``algebra.public_arrays`` has them, write the last and return
nothing. The arrays are C-ordered, float64 and writable, and not checked: a wrong size is the caller's fault. ``out``
may be an input.
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

from ...algebra import lie, public_arrays, spatial
from ...algebra.euclidean import Vec
from ...engines.compiled import numba_kernels
from . import operators

Operation = Callable[..., Any]
OK, SIZE, SYMMETRY, SIGN = range(4)
ROUNDING = 1e-12  # relative: an asymmetry or a negative eigenvalue below it is a rounding error


def operation(name: str, operator: Callable[..., Any], kinds: str) -> Operation:
    """``(*inputs, out)`` on arrays, for an operator between ``kinds``: "pose vec -> vec"; a "number" is returned."""
    given, made = (part.split() for part in kinds.split("->"))
    names = [f"x{k}" for k in range(len(given))]
    taken = ", ".join(f"get_{kind}({x})" for x, kind in zip(names, given, strict=True))
    result = f"operator({taken})"
    body = ["stamp", f"return {result}" if made == ["number"] else f"put_{made[0]}(out, {result})"]
    parameters = names if made == ["number"] else [*names, "out"]
    function = numba_kernels.define(f"algebra_{name}", parameters, body, {**vars(public_arrays), "operator": operator})
    compiled: Operation = njit(**{**numba_kernels.FLAGS, "nogil": False})(function)  # giving the lock up costs 0.03 µs
    return compiled


def checked(name: str, body: list[str], ranks: dict[str, int], rank: int, **scope: Any) -> Operation:
    """``(out, *inputs) -> status`` for an output of that rank and inputs of any layout; rank 0 is a number."""
    array: Any = types.Array
    inputs = [array(types.float64, n, "A", readonly=True) if n else types.float64 for n in ranks.values()]
    function = numba_kernels.define(
        f"algebra_{name}", ["out", *ranks], ["stamp", *body], {**vars(public_arrays), **scope}
    )
    made = numba_kernels.compiled(function, (array(types.float64, rank, "C"), *inputs), nogil=False)
    if not numba_kernels.PLAIN:  # transposed matrices too, without which each would take the slow way
        samples = [np.zeros((4,) * n, order="F") if n else 0.0 for n in ranks.values()]
        type(made)._search_new_conversions(made, np.zeros((4,) * rank), *samples)  # type: ignore[attr-defined]
    return made


@cache
def made_pose() -> Operation:
    """``(out (4, 4), R (3, 3), p (3,)) -> status``."""
    body = [f"if R.shape != (3, 3) or p.shape != (3,): return {SIZE}"]
    body += ["put_pose(out, Pose(get_rot(R), get_vec(p)))", f"return {OK}"]
    return checked("made_pose", body, {"R": 2, "p": 1}, 2, Pose=spatial.Pose)


@cache
def made_vector() -> Operation:
    """``(out (6,), linear (3,), angular (3,)) -> status``, for motions and forces alike."""
    body = [f"if linear.shape != (3,) or angular.shape != (3,): return {SIZE}"]
    body += ["put_motion(out, Motion(get_vec(angular), get_vec(linear)))", f"return {OK}"]
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
        "put_body(out, Body(m, get_vec(c), Sym(xx, xy, xz, yy, yz, zz)))",
        f"return {OK}",
    ]
    return checked("made_body", body, {"m": 0, "c": 1, "J": 2}, 1)


@cache
def point_to_parent() -> Operation:
    """``(out (3,), X (4, 4), a (3,)) -> status``: a point of the child's frame, seen from the parent."""
    return _of_point("point_to_parent", operators.point_of)


@cache
def point_to_child() -> Operation:
    """``(out (3,), X (4, 4), a (3,)) -> status``: a point of the parent's frame, seen from the child."""
    return _of_point("point_to_child", operators.point_in)


def _of_point(name: str, operator: Callable[..., Vec]) -> Operation:
    body = [f"if a.shape != (3,): return {SIZE}", "put_vec(out, operator(get_pose(X), get_vec(a)))", f"return {OK}"]
    return checked(name, body, {"X": 2, "a": 1}, 1, operator=operator)


compose = operation("compose", spatial.compose, "pose pose -> pose")
inverse = operation("inverse", spatial.inverse, "pose -> pose")
relative = operation("relative", operators.relative_pose, "pose pose -> pose")
motion_to_parent = operation("motion_to_parent", spatial.motion_to_parent, "pose motion -> motion")
motion_to_child = operation("motion_to_child", spatial.motion_to_child, "pose motion -> motion")
force_to_parent = operation("force_to_parent", spatial.force_to_parent, "pose force -> force")
force_to_child = operation("force_to_child", spatial.force_to_child, "pose force -> force")
body_to_parent = operation("body_to_parent", operators.moved_body, "pose body -> body")
body_to_child = operation("body_to_child", operators.moved_body_back, "pose body -> body")
action = operation("action", operators.action_of, "pose -> tangent")
action_inverse = operation("action_inverse", operators.action_back, "pose -> tangent")
motion_action = operation("motion_action", operators.spin_of, "motion -> tangent")
cross_motion = operation("cross_motion", spatial.cross_motion, "motion motion -> motion")
cross_force = operation("cross_force", spatial.cross_force, "motion force -> force")
momentum = operation("momentum", operators.momentum_of, "body motion -> force")
twice = operation("twice", operators.twice_energy, "body motion -> number")
power = operation("power", spatial.power, "motion force -> number")
body_matrix = operation("body_matrix", operators.about_origin, "body -> inertia")
pull = operation("pull", operators.pull_of, "body motion -> force")
add_body = operation("add_body", operators.both, "body body -> body")
sub_body = operation("sub_body", operators.rest, "body body -> body")
quat_product = operation("quat_product", lie.product, "quat quat -> quat")
quat_matrix = operation("quat_matrix", lie.matrix, "quat -> rot")
matrix_quat = operation("matrix_quat", operators.of_matrix, "rot -> quat")
from_seven = operation("from_seven", operators.pose_from, "seven -> pose")
to_seven = operation("to_seven", operators.pose_as, "pose -> seven")
cross_matrix = operation("cross_matrix", operators.tilde, "vec -> rot")
exp3 = operation("exp3", operators.rotation_of, "vec -> rot")
exp3_quat = operation("exp3_quat", lie.exp_rotation, "vec -> quat")
exp6 = operation("exp6", operators.pose_of, "motion -> pose")
exp6_seven = operation("exp6_seven", operators.ended, "motion -> seven")
log3 = operation("log3", operators.vector_of, "rot -> vec")
log3_quat = operation("log3_quat", lie.log_rotation, "quat -> vec")
log6 = operation("log6", operators.motion_of, "pose -> motion")
log6_seven = operation("log6_seven", operators.started, "seven -> motion")
exp3_jacobian = operation("exp3_jacobian", operators.turned_jacobian, "vec -> rot")
log3_jacobian = operation("log3_jacobian", operators.turned_jacobian_back, "rot -> rot")
exp6_jacobian = operation("exp6_jacobian", lie.exp_jacobian, "motion -> tangent")
log6_jacobian = operation("log6_jacobian", operators.log_jacobian_of, "pose -> tangent")
log3_bend = operation("log3_bend", operators.bent_log, "rot vec -> rot")
