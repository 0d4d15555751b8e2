"""SE3: a rigid displacement, stored as its 4 x 4 homogeneous matrix."""

from __future__ import annotations

from typing import Any

import numpy as np

from .arguments import ArgumentError, Array, array, described, of_pinocchio, row, rows
from .random import GENERATOR
from .rotations import Quaternion
from .value import Value, as_array, on_table, on_values, own_value, part, preset

__all__ = ["SE3"]

IDENTITY = np.eye(4)

_point_to_parent, _point_to_child, _pose_of, _pose_of_quaternion, _random = on_table("""
act(self: Pose, point: vec) -> vec = point_to_parent(self, point)
actInv(self: Pose, point: vec) -> vec = point_to_child(self, point)
pose_of(rotation: rot, translation: vec) -> pose = Pose(rotation, translation)
pose_of(quat: Quat, translation: vec) -> pose = Pose(rotation_matrix(quat), translation)
Random(u: motion) -> Pose = Pose(rotation_matrix(random_rotation(u.v)), sub(scale(2.0, u.w), Vec(1.0, 1.0, 1.0)))
""")


class SE3(
    Value,
    kind="Pose",
    near="near(self.R, other.R, prec) * near(self.p, other.p, prec)",
    same="same(self.R, other.R) * same(self.p, other.p)",
):
    """The pose of a frame in a reference frame: ``SE3(rotation (3, 3), translation (3,))``,
    ``SE3(quaternion, translation)``, ``SE3(homogeneous (4, 4))``, ``SE3(other)``, also of Pinocchio's own class or
    coal's Transform3s, ``SE3(1)`` for the identity.

    ``A * B`` composes, ``A * x`` takes a point (3,), Motion, Force or Inertia from the frame to the reference frame,
    ``A.actInv(x)`` takes it back. ``rotation`` and ``translation`` are writable views. ``SE3()`` is the identity.
    """

    _arguments = ("rotation", "translation")

    def __init__(
        self, rotation: Any = None, translation: Any = None, *, quat: Any = None, array: Any = None, clone: Any = None
    ) -> None:
        if translation is None or rotation is None:
            rotation = next((x for x in (rotation, quat, array, clone) if x is not None), None)
        if of_pinocchio(rotation, "Quaternion"):
            rotation = Quaternion(rotation)
        if translation is None:
            self._x = _homogeneous(rotation)
        else:
            self._x = (_pose_of_quaternion if isinstance(rotation, Quaternion) else _pose_of)(rotation, translation)

    rotation = part("rotation", np.s_[:3, :3], "The rotation matrix (3, 3), a view.")
    translation = part("translation", np.s_[:3, 3], "The translation (3,) [m], a view.")

    _matrix, inverse, toActionMatrix, toActionMatrixInverse, _to_parent, _to_child, Identity = on_table("""
matrix(self: Pose) -> pose = self
    The homogeneous matrix (4, 4), a copy.
inverse(self: Pose) -> Pose = inverse(self)
    The pose of the reference frame in the frame.
toActionMatrix(self: Pose) -> tangent = Tangent(self.R, matmul(skew(self.p), self.R))
    The matrix (6, 6) that takes Motion vectors from the frame to the reference frame.
toActionMatrixInverse(self: Pose) -> tangent = Tangent(transpose(self.R), transpose(matmul(skew(self.p), self.R)))
    The inverse of ``toActionMatrix``.
act(self: Pose, other: Pose) -> Pose = compose(self, other)
actInv(self: Pose, other: Pose) -> Pose = relative_pose(self, other)
Identity() -> Pose = identity_pose()
    The identity.
""")  # the other classes that an SE3 moves have _to_parent and _to_child too
    Identity, __invert__, __array__ = staticmethod(Identity), inverse, as_array(_matrix)
    homogeneous = np = property(_matrix)

    setIdentity = preset(lambda: IDENTITY, "the identity")[1]
    setRandom = preset(lambda: SE3.Random()._x, "a uniform random rotation and a translation within ±1 m")[1]

    @staticmethod
    def Random() -> SE3:
        """A uniform random rotation and a random translation within ±1 m."""
        return _random(GENERATOR.random(6))  # type: ignore[no-any-return]

    Interpolate = staticmethod(
        on_values(
            "Interpolate(A: Pose, B: Pose, alpha: number) -> Pose",
            "compose(A, exp_pose(scale_motion(alpha, log_pose(relative_pose(A, B)))))",
            "A exp(alpha log(A⁻¹ B)): from A (alpha = 0) to B (alpha = 1) at a constant motion.",
        )
    )

    def toDualActionMatrix(self) -> Array:
        """The matrix (6, 6) that takes Force vectors from the frame to the reference frame."""
        return self.toActionMatrixInverse().T.copy()  # type: ignore[no-any-return]

    action = property(toActionMatrix)
    actionInverse = property(toActionMatrixInverse)
    dualAction = property(toDualActionMatrix)

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return _point_to_parent(self, other) if other.shape in ((3,), (3, 1)) else NotImplemented
        move = getattr(type(other), "_to_parent", None)
        if move is None:
            mine = own_value(other)
            return NotImplemented if mine is None else self * mine
        return move(self, other)

    def act(self, other: Any) -> Any:
        """A point (3,), SE3, Motion, Force or Inertia from the frame to the reference frame."""
        move = getattr(type(other), "_to_parent", None)
        if move is None and (mine := own_value(other)) is not None:
            return self.act(mine)
        return (move or _point_to_parent)(self, other)

    def actInv(self, other: Any) -> Any:
        """A point (3,), SE3, Motion, Force or Inertia from the reference frame to the frame."""
        move = getattr(type(other), "_to_child", None)
        if move is None and (mine := own_value(other)) is not None:
            return self.actInv(mine)
        return (move or _point_to_child)(self, other)

    def isIdentity(self, prec: float = 1e-12) -> bool:
        """Whether no entry differs from the identity's by more than prec."""
        return bool((abs(self._x - IDENTITY) <= prec).all())

    def __str__(self) -> str:
        return f"  R =\n{rows(self._x[:3, :3])}\n  p = {row(self._x[:3, 3])}\n"

    def __repr__(self) -> str:
        text = np.array2string(self._x, separator=", ").replace("\n", "").replace("], [", "],[").replace(",  [", ",[")
        return f"SE3(array({text}))"


def _homogeneous(given: Any) -> Array:
    """The homogeneous matrix of the constructor's one argument."""
    x = IDENTITY.copy()
    if isinstance(given, SE3):
        x[...] = given._x
    elif of_pinocchio(given, "SE3"):
        x[:3] = given.homogeneous[:3]
    elif of_pinocchio(given, "Transform3s"):  # coal's
        x[:3, :3], x[:3, 3] = given.getRotation(), given.getTranslation()
    elif isinstance(given, np.ndarray):
        x[:3] = array(given, (4, 4), "homogeneous matrix")[:3]
    elif given is not None and not isinstance(given, int):
        raise ArgumentError(f"SE3 got {described(given)}, expected a rotation and a translation, a matrix or an SE3")
    return x
