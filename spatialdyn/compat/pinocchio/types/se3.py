"""SE3: a rigid displacement, stored as its 4 x 4 homogeneous matrix."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ....algebra import spatial
from ....engines.object_layout import slot_offset
from ....engines.programs.run.single_call import READY
from ...native import operator_kernels, operators
from .arguments import OMITTED, ArgumentError, Array, array, described, number, of_pinocchio, only, row, rows
from .random import GENERATOR
from .rotations import Quaternion
from .value import Value, as_array, on_values, own_value, part, preset

__all__ = ["SE3"]

IDENTITY = np.eye(4)
WANTED = "a rotation and a translation, a matrix or an SE3"

_point_to_parent = on_values("act", operators.point_to_parent, "vec", self="Pose", point="vec")
_point_to_child = on_values("actInv", operators.point_to_child, "vec", self="Pose", point="vec")
_pose_of = on_values("pose_of", spatial.Pose, "pose", rotation="rot", translation="vec")
_pose_of_quaternion = on_values("pose_of", operators.pose_of_quaternion, "pose", quat="Quat", translation="vec")
_random = on_values("Random", operators.random_pose, "Pose", u="motion")


class SE3(Value, kind="Pose", near=operators.near_poses, same=operators.same_poses, raw=False):
    """The pose of a frame in a reference frame: ``SE3(rotation (3, 3), translation (3,))``,
    ``SE3(quaternion, translation)``, ``SE3(homogeneous (4, 4))``, ``SE3(other)``, also of Pinocchio's own class or
    coal's Transform3s, ``SE3(1)`` for the identity.

    ``A * B`` composes, ``A * x`` takes a point (3,), Motion, Force or Inertia from the frame to the reference frame,
    ``A.actInv(x)`` takes it back. ``rotation`` and ``translation`` are writable views. ``SE3()`` is the identity.
    """

    _arguments = ("rotation", "translation")

    def __init__(
        self,
        rotation: Any = OMITTED,
        translation: Any = OMITTED,
        *,
        quat: Any = OMITTED,
        array: Any = OMITTED,
        clone: Any = OMITTED,
    ) -> None:
        if rotation is OMITTED or quat is not OMITTED or array is not OMITTED or clone is not OMITTED:
            rotation = only((rotation, quat, array, clone), "SE3", WANTED)
        if translation is OMITTED:
            self._x = _homogeneous(rotation)
        elif type(rotation) is np.ndarray:  # the usual case first
            self._x = _pose_of(rotation, translation)
        else:
            turned = isinstance(rotation, Quaternion) or of_pinocchio(rotation, "Quaternion")
            self._x = (_pose_of_quaternion if turned else _pose_of)(rotation, translation)

    rotation = part("rotation", np.s_[:3, :3], "The rotation matrix (3, 3), a view.")
    translation = part("translation", np.s_[:3, 3], "The translation (3,) [m], a view.")

    _matrix = on_values("matrix", operators.itself, "pose", "The homogeneous matrix (4, 4), a copy.", self="Pose")
    inverse = on_values("inverse", spatial.inverse, "Pose", "Pose of the reference frame in the frame.", self="Pose")
    toActionMatrix = on_values("toActionMatrix", operators.action, "tangent",
        "The matrix (6, 6) that takes Motion vectors from the frame to the reference frame.", self="Pose")  # fmt: skip
    toActionMatrixInverse = on_values("toActionMatrixInverse", operators.action_back, "tangent",
        "The inverse of ``toActionMatrix``.", self="Pose")  # fmt: skip
    _to_parent = on_values("act", spatial.compose, "Pose", self="Pose", other="Pose")  # also of what an SE3 moves
    _to_child = on_values("actInv", operators.relative_pose, "Pose", self="Pose", other="Pose")
    Identity = on_values("Identity", spatial.identity_pose, "Pose", "The identity.")
    Identity, __invert__, __array__ = staticmethod(Identity), inverse, as_array(_matrix)
    homogeneous = np = property(_matrix)

    setIdentity = preset(lambda: IDENTITY, "the identity")[1]
    setRandom = preset(lambda: SE3.Random()._x, "a uniform random rotation and a translation within ±1 m")[1]

    @staticmethod
    def Random() -> SE3:
        """A uniform random rotation and a random translation within ±1 m."""
        return _draw()()  # type: ignore[no-any-return]

    Interpolate = staticmethod(
        on_values(
            "Interpolate", operators.interpolated, "Pose",
            "A exp(alpha log(A⁻¹ B)): from A (alpha = 0) to B (alpha = 1) at a constant motion.",
            A="Pose", B="Pose", alpha="number",
        )
    )  # fmt: skip

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
        if type(other) is np.ndarray:
            return _point_to_parent(self, other)
        try:
            move = type(other)._to_parent
        except AttributeError:
            mine = own_value(other)
            return _point_to_parent(self, other) if mine is None else self.act(mine)
        return move(self, other)

    def actInv(self, other: Any) -> Any:
        """A point (3,), SE3, Motion, Force or Inertia from the reference frame to the frame."""
        if type(other) is np.ndarray:
            return _point_to_child(self, other)
        try:
            move = type(other)._to_child
        except AttributeError:
            mine = own_value(other)
            return _point_to_child(self, other) if mine is None else self.actInv(mine)
        return move(self, other)

    def isIdentity(self, prec: float = 1e-12) -> bool:
        """Whether no entry differs from the identity's by more than prec."""
        return bool((abs(self._x - IDENTITY) <= number(prec, "prec")).all())

    def __str__(self) -> str:
        return f"  R =\n{rows(self._x[:3, :3])}\n  p = {row(self._x[:3, 3])}\n"

    def __repr__(self) -> str:
        text = np.array2string(self._x, separator=", ").replace("\n", "").replace("], [", "],[").replace(",  [", ",[")
        return f"SE3(array({text}))"


@cache
def _draw() -> Callable[..., Any]:
    def in_python() -> Any:
        return _random(GENERATOR.random(6))

    if not READY:
        return in_python
    return operator_kernels.draw_pose(GENERATOR, slot_offset(Value, "_x"), SE3, in_python)


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
    elif given is not OMITTED and not isinstance(given, int):
        raise ArgumentError(f"SE3 got {described(given)}, expected {WANTED}")
    return x
