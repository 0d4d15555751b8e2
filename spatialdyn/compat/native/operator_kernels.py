"""Operators on small arrays, compiled: the arithmetic of SE3, Motion, Force and Inertia.

``compose(A, B, out)`` and its like take arrays as ``algebra.public_arrays`` lays them out and write ``out`` in place;
it may be an input. Arrays have to be float64, C-ordered, writable and of the right size: nothing is checked.
``write_pose()(out, R, p)`` and its like take arrays of any layout, check sizes and return a status.

A call takes 0.2 µs; the operator takes 1 to 6 in plain Python. Each is compiled at its first call and cached on disk.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import types

from ...algebra import lie, public_arrays, spatial
from ...algebra.euclidean import Vec
from ...engines.compiled import jit, numba_kernels
from . import operators

Operation = Callable[..., Any]
OK, SIZE, SYMMETRY, SIGN = range(4)
ROUNDING = 1e-12  # relative: an asymmetry or a negative eigenvalue below it is a rounding error


def on_arrays(name: str, operator: Callable[..., Any], kinds: str) -> Operation:
    """A kernel ``(*inputs, out)`` for an operator of these kinds, as "pose vec -> vec"; a "number" is returned."""
    inputs, output = (part.split() for part in kinds.split("->"))
    names = [f"x{k}" for k in range(len(inputs))]
    taken = ", ".join(f"read_{kind}({x})" for x, kind in zip(names, inputs, strict=True))
    result = f"operator({taken})"
    body = ["stamp", f"return {result}" if output == ["number"] else f"write_{output[0]}(out, {result})"]
    parameters = names if output == ["number"] else [*names, "out"]
    function = numba_kernels.kernel_from_text(
        f"algebra_{name}", parameters, body, {**vars(public_arrays), "operator": operator}
    )
    compiled: Operation = jit.numba_jit(function, nogil=False, keep=False)  # releasing the GIL costs 0.03 µs
    return compiled


def checked_kernel(name: str, body: list[str], ranks: dict[str, int], rank: int, **scope: Any) -> Operation:
    """A kernel ``(out, *inputs) -> status`` for an output of this rank and inputs of any layout; rank 0 is a number."""
    array: Any = types.Array
    inputs = [array(types.float64, n, "A", readonly=True) if n else types.float64 for n in ranks.values()]
    function = numba_kernels.kernel_from_text(
        f"algebra_{name}", ["out", *ranks], ["stamp", *body], {**vars(public_arrays), **scope}
    )
    kernel = jit.compile_signature(function, (array(types.float64, rank, "C"), *inputs), nogil=False)
    # transposed matrices too, without which each call of one would take the slow path
    samples = [np.zeros((4,) * n, order="F") if n else 0.0 for n in ranks.values()]
    jit.accept(kernel, np.zeros((4,) * rank), *samples)
    return kernel


@cache
def write_pose() -> Operation:
    """``(out (4, 4), R (3, 3), p (3,)) -> status``."""
    body = [f"if R.shape != (3, 3) or p.shape != (3,): return {SIZE}"]
    body += ["write_pose(out, Pose(read_rot(R), read_vec(p)))", f"return {OK}"]
    return checked_kernel("write_pose", body, {"R": 2, "p": 1}, 2, Pose=spatial.Pose)


@cache
def write_vector() -> Operation:
    """``(out (6,), linear (3,), angular (3,)) -> status``, for motions and forces alike."""
    body = [f"if linear.shape != (3,) or angular.shape != (3,): return {SIZE}"]
    body += ["write_motion(out, Motion(read_vec(angular), read_vec(linear)))", f"return {OK}"]
    return checked_kernel("write_vector", body, {"linear": 1, "angular": 1}, 1)


@cache
def write_body() -> Operation:
    """``(out (10,), m, c (3,), J (3, 3)) -> status``: SYMMETRY or SIGN if no J can be so.

    J is positive semidefinite if and only if no coefficient of its characteristic polynomial is negative.
    """
    body = [
        f"if c.shape != (3,) or J.shape != (3, 3): return {SIZE}",
        "xx, xy, yy, xz, yz, zz = J[0, 0], J[1, 0], J[1, 1], J[2, 0], J[2, 1], J[2, 2]",
        "size = abs(xx) + abs(yy) + abs(zz) + abs(xy) + abs(xz) + abs(yz)",
        f"if max(abs(J[0, 1] - xy), abs(J[0, 2] - xz), abs(J[1, 2] - yz)) > {ROUNDING} * size: return {SYMMETRY}",
        "two = yy * zz - yz * yz + xx * zz - xz * xz + xx * yy - xy * xy",
        "three = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)",
        f"if min(xx + yy + zz, two / size, three / size / size) < -{ROUNDING} * size: return {SIGN}",
        "write_body(out, Body(m, read_vec(c), Sym(xx, xy, xz, yy, yz, zz)))",
        f"return {OK}",
    ]
    return checked_kernel("write_body", body, {"m": 0, "c": 1, "J": 2}, 1)


@cache
def point_to_parent() -> Operation:
    """``(out (3,), X (4, 4), a (3,)) -> status``: a point in child coordinates, in parent coordinates."""
    return _point_kernel("point_to_parent", operators.point_to_parent)


@cache
def point_to_child() -> Operation:
    """``(out (3,), X (4, 4), a (3,)) -> status``: a point in parent coordinates, in child coordinates."""
    return _point_kernel("point_to_child", operators.point_to_child)


def _point_kernel(name: str, operator: Callable[..., Vec]) -> Operation:
    body = [f"if a.shape != (3,): return {SIZE}", "write_vec(out, operator(read_pose(X), read_vec(a)))", f"return {OK}"]
    return checked_kernel(name, body, {"X": 2, "a": 1}, 1, operator=operator)


compose = on_arrays("compose", spatial.compose, "pose pose -> pose")
inverse = on_arrays("inverse", spatial.inverse, "pose -> pose")
relative = on_arrays("relative", operators.relative_pose, "pose pose -> pose")
motion_to_parent = on_arrays("motion_to_parent", spatial.motion_to_parent, "pose motion -> motion")
motion_to_child = on_arrays("motion_to_child", spatial.motion_to_child, "pose motion -> motion")
force_to_parent = on_arrays("force_to_parent", spatial.force_to_parent, "pose force -> force")
force_to_child = on_arrays("force_to_child", spatial.force_to_child, "pose force -> force")
body_to_parent = on_arrays("body_to_parent", operators.body_to_parent, "pose body -> body")
body_to_child = on_arrays("body_to_child", operators.body_to_child, "pose body -> body")
action = on_arrays("action", operators.action_matrix, "pose -> tangent")
action_inverse = on_arrays("action_inverse", operators.inverse_action_matrix, "pose -> tangent")
motion_action = on_arrays("motion_action", operators.cross_motion_matrix, "motion -> tangent")
cross_motion = on_arrays("cross_motion", spatial.cross_motion, "motion motion -> motion")
cross_force = on_arrays("cross_force", spatial.cross_force, "motion force -> force")
momentum = on_arrays("momentum", operators.body_momentum, "body motion -> force")
twice_kinetic_energy = on_arrays("twice_kinetic_energy", operators.twice_kinetic_energy, "body motion -> number")
power = on_arrays("power", spatial.power, "motion force -> number")
body_matrix = on_arrays("body_matrix", operators.inertia_about_origin, "body -> inertia")
bias_force = on_arrays("bias_force", operators.bias_force, "body motion -> force")
add_body = on_arrays("add_body", operators.add_bodies, "body body -> body")
sub_body = on_arrays("sub_body", operators.subtract_bodies, "body body -> body")
quat_product = on_arrays("quat_product", lie.product, "quat quat -> quat")
quat_matrix = on_arrays("quat_matrix", lie.matrix, "quat -> rot")
matrix_quat = on_arrays("matrix_quat", operators.quaternion_of_matrix, "rot -> quat")
from_xyzquat = on_arrays("from_xyzquat", operators.pose_from_xyzquat, "seven -> pose")
to_xyzquat = on_arrays("to_xyzquat", operators.pose_to_xyzquat, "pose -> seven")
cross_matrix = on_arrays("cross_matrix", operators.skew, "vec -> rot")
exp3 = on_arrays("exp3", operators.exp_rotation, "vec -> rot")
exp3_quat = on_arrays("exp3_quat", lie.exp_rotation, "vec -> quat")
exp6 = on_arrays("exp6", operators.exp_pose, "motion -> pose")
exp6_xyzquat = on_arrays("exp6_xyzquat", operators.exp_xyzquat, "motion -> seven")
log3 = on_arrays("log3", operators.log_rotation, "rot -> vec")
log3_quat = on_arrays("log3_quat", lie.log_rotation, "quat -> vec")
log6 = on_arrays("log6", operators.log_pose, "pose -> motion")
log6_xyzquat = on_arrays("log6_xyzquat", operators.log_xyzquat, "seven -> motion")
exp3_jacobian = on_arrays("exp3_jacobian", operators.exp_rotation_jacobian, "vec -> rot")
log3_jacobian = on_arrays("log3_jacobian", operators.log_rotation_jacobian, "rot -> rot")
exp6_jacobian = on_arrays("exp6_jacobian", lie.exp_jacobian, "motion -> tangent")
log6_jacobian = on_arrays("log6_jacobian", operators.log_pose_jacobian, "pose -> tangent")
log3_jacobian_derivative = on_arrays(
    "log3_jacobian_derivative", operators.log_rotation_jacobian_derivative, "rot vec -> rot"
)
