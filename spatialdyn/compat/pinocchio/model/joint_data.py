"""JointData: pose, motion subspace, velocity and bias of one joint."""

from __future__ import annotations

from typing import Any

import numpy as np

from ....algebra.euclidean import Vec
from ....algebra.spatial import Motion as Twist
from ....algebra.spatial import (
    add_motion,
    compose,
    cross_motion,
    identity_pose,
    motion_to_child,
    scale_motion,
    zero_motion,
)
from ....bodies.kinds import kind_of
from ....errors import ShapeError
from ....model.joint_rows import joint_transform, matrix_from_pose, pose_from_matrix, subspace
from ..types.arguments import ArgumentError, Array, described
from ..types.motion import Motion
from ..types.se3 import SE3

__all__ = ["JointData"]


class JointData:
    """Results of ``joint.calc(data, q[, v])``.

    M                pose of the frame after the joint in the frame before it
    S                (6, nv) motion subspace, (6,) of a joint with one velocity
    v, c             Motion: velocity, and acceleration at zero joint acceleration
    joint_q, joint_v the joint's own coordinates and velocities
    U, Dinv, UDinv   articulated inertia times S and its products; zero, for no algorithm writes them
    """

    def __init__(self, joint: Any) -> None:
        n = joint.nvExtended
        self._kind: str = joint.shortname()
        self.M, self.v, self.c = SE3.Identity(), Motion.Zero(), Motion.Zero()
        self.S = np.zeros((6, n)) if n > 1 else np.zeros(6)
        self.U, self.UDinv = np.zeros(self.S.shape), np.zeros(self.S.shape)
        self.Dinv = np.zeros((n, n))
        self.joint_q, self.joint_v = np.zeros(_coordinates(joint)), np.zeros(n)

    def shortname(self) -> str:
        """Name of the kind of joint data."""
        return self._kind.replace("JointModel", "JointData")

    def calc(self, joint: Any, q: Any, v: Any = None) -> None:
        """Write the results of a joint at the model's q, v."""
        self.joint_q[:] = _own("q", q, joint.idx_q, _coordinates(joint))
        self.joint_v[:] = 0.0 if v is None else _own("v", v, joint.idx_v, len(self.joint_v))
        if joint.leader is not None:
            self.joint_q[:] = joint.scaling * self.joint_q + joint.offset
            self.joint_v *= joint.scaling
        X, twist, bias = identity_pose(), zero_motion(), zero_motion()
        columns: list[Twist] = []
        at, n = 0, 0
        for step in joint.steps():
            nq = kind_of(step.kind, "cos_sin").nq
            q_step = self.joint_q[at : at + nq]
            moved = pose_from_matrix(joint_transform(step.kind, step.axis, q_step, "cos_sin", step.pitch))
            moved = compose(pose_from_matrix(step.placement), moved)
            S = [Twist(Vec(*s[:3]), Vec(*s[3:])) for s in subspace(step.kind, step.axis, step.pitch).tolist()]
            own = zero_motion()
            for s in S:
                own = add_motion(own, scale_motion(float(self.joint_v[n]), s))
                n += 1
            X = compose(X, moved)
            twist = add_motion(motion_to_child(moved, twist), own)
            bias = add_motion(motion_to_child(moved, bias), cross_motion(twist, own))
            columns = [motion_to_child(moved, s) for s in columns] + S
            at += nq
        self.M = SE3.over(np.array(matrix_from_pose(X)))
        self.S[...] = np.array([_linear_first(s) for s in columns]).T.reshape(self.S.shape)
        if v is not None:
            self.v, self.c = Motion.over(_linear_first(twist)), Motion.over(_linear_first(bias))

    def __repr__(self) -> str:
        return self.shortname()


def _linear_first(m: Twist) -> Array:
    return np.array([*m.v, *m.w], dtype=float)


def _coordinates(joint: Any) -> int:
    """Number of coordinates of the joint's motion, its own or its leader's."""
    return sum(kind_of(step.kind, "cos_sin").nq for step in joint.steps())


def _own(name: str, value: Any, at: int, n: int) -> Array:
    """A joint's entries of a vector of the model; for a joint in no model, the first entries."""
    if not isinstance(value, np.ndarray):
        raise ArgumentError(f"{name} is {described(value)}, expected an array")
    first = max(at, 0)
    part = np.asarray(value, dtype=float).ravel()[first : first + n]
    if len(part) != n:
        raise ShapeError(f"{name} has {value.size} numbers, expected at least {first + n}")
    return part
