"""The compiled operators on small arrays equal their source in plain Python."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from spatialdyn.algebra import lie, public_arrays, spatial
from spatialdyn.compat.native import operator_kernels, operators

EPS = float(np.finfo(float).eps)
FUSED = 32 * EPS  # compiled code may fuse a product and a sum, plain Python does not; entries are of order one

OPERATIONS = {
    "compose": (spatial.compose, "pose pose -> pose"),
    "inverse": (spatial.inverse, "pose -> pose"),
    "relative": (operators.relative_pose, "pose pose -> pose"),
    "motion_to_parent": (spatial.motion_to_parent, "pose motion -> motion"),
    "motion_to_child": (spatial.motion_to_child, "pose motion -> motion"),
    "force_to_parent": (spatial.force_to_parent, "pose force -> force"),
    "force_to_child": (spatial.force_to_child, "pose force -> force"),
    "body_to_parent": (operators.body_to_parent, "pose body -> body"),
    "body_to_child": (operators.body_to_child, "pose body -> body"),
    "cross_motion": (spatial.cross_motion, "motion motion -> motion"),
    "cross_force": (spatial.cross_force, "motion force -> force"),
    "momentum": (operators.body_momentum, "body motion -> force"),
    "add_body": (operators.add_bodies, "body body -> body"),
    "sub_body": (operators.subtract_bodies, "body body -> body"),
    "from_xyzquat": (operators.pose_from_xyzquat, "seven -> pose"),
    "to_xyzquat": (operators.pose_to_xyzquat, "pose -> seven"),
    "exp6": (operators.exp_pose, "motion -> pose"),
    "log6": (operators.log_pose, "pose -> motion"),
    "log6_jacobian": (operators.log_pose_jacobian, "pose -> tangent"),
    "quat_product": (lie.product, "quat quat -> quat"),
}
SHAPES = {
    "pose": (4, 4), "motion": (6,), "force": (6,), "vec": (3,), "rot": (3, 3), "quat": (4,), "seven": (7,),
    "body": (10,), "inertia": (6, 6), "tangent": (6, 6),
}  # fmt: skip


def given(kind: str, rng: np.random.Generator) -> Any:
    """A random array of a kind."""
    x = rng.standard_normal(SHAPES[kind])
    if kind in ("pose", "seven", "quat"):
        q = rng.standard_normal(4)
        q /= np.linalg.norm(q)
        if kind == "quat":
            return q
        seven, pose = np.concatenate([rng.standard_normal(3), q]), np.empty((4, 4))
        operator_kernels.from_xyzquat(seven, pose)
        return seven if kind == "seven" else pose
    return abs(x) if kind == "body" else x


@pytest.mark.parametrize("name", OPERATIONS)
def test_compiled_operators_give_what_their_source_gives(name: str) -> None:
    operator, kinds = OPERATIONS[name]
    takes, made = (part.split() for part in kinds.split("->"))
    for seed in range(5):
        rng = np.random.default_rng(seed)
        inputs = [given(kind, rng) for kind in takes]
        before = [x.copy() for x in inputs]
        out, plain = np.full(SHAPES[made[0]], np.nan), np.full(SHAPES[made[0]], np.nan)
        getattr(operator_kernels, name)(*inputs, out)
        arguments = [
            getattr(public_arrays, f"read_{kind}")(x.tolist() if x.ndim == 1 else x)
            for kind, x in zip(takes, inputs, strict=True)
        ]
        getattr(public_arrays, f"write_{made[0]}")(plain, operator(*arguments))
        assert np.abs(out - plain).max() <= FUSED * max(1.0, np.abs(plain).max())
        assert all(np.array_equal(x, y) for x, y in zip(inputs, before, strict=True))


def test_an_input_may_be_the_output() -> None:
    rng = np.random.default_rng(0)
    A, B, out = given("pose", rng), given("pose", rng), np.empty((4, 4))
    operator_kernels.compose(A, B, out)
    operator_kernels.compose(A, B, A)
    assert np.array_equal(A, out)


@pytest.mark.parametrize(
    "turn", [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (1, -1, 1, -1), (1, 1e-9, 0, 0)]
)
def test_quaternion_of_a_matrix_is_exact_at_half_a_turn(turn: tuple[float, ...]) -> None:
    q = np.array(turn, float) / np.linalg.norm(turn)
    R, back = np.empty((3, 3)), np.empty(4)
    operator_kernels.quat_matrix(q, R)
    operator_kernels.matrix_quat(R, back)
    assert min(np.abs(back - q).max(), np.abs(back + q).max()) <= 4 * EPS


def test_checked_makers_take_any_layout_and_tell_what_is_wrong() -> None:
    R, p, out = np.arange(9.0).reshape(3, 3), np.arange(6.0)[::2], np.empty((4, 4))
    assert operator_kernels.write_pose()(out, R.T, p) == operator_kernels.OK
    assert np.array_equal(out, np.vstack([np.column_stack([R.T, p]), [0.0, 0.0, 0.0, 1.0]]))
    assert operator_kernels.write_pose()(out, np.eye(4), p) == operator_kernels.SIZE
    assert operator_kernels.write_vector()(np.empty(6), np.zeros(2), p) == operator_kernels.SIZE
    body = np.empty(10)
    assert operator_kernels.write_body()(body, 1.0, p, np.eye(3)) == operator_kernels.OK
    assert operator_kernels.write_body()(body, 1.0, p, np.zeros((3, 3))) == operator_kernels.OK
    assert operator_kernels.write_body()(body, 1.0, p, R) == operator_kernels.SYMMETRY
    assert operator_kernels.write_body()(body, 1.0, p, np.diag([1.0, 1.0, -0.1])) == operator_kernels.SIGN
    assert operator_kernels.point_to_parent()(np.empty(3), np.eye(4), np.zeros(4)) == operator_kernels.SIZE
