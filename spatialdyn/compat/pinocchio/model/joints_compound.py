"""Joint models with several velocities, and chains of joint models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import ModelError
from ..types.arguments import ArgumentError
from ..types.se3 import SE3
from ..types.tracked_list import OwnedList
from .joint import NOWHERE, JointModel, Step, Vector, X, Y, Z
from .joints_one_axis import unit

__all__ = [
    "JointModelComposite", "JointModelFreeFlyer", "JointModelPlanar", "JointModelSpherical",
    "JointModelSphericalZYX", "JointModelTranslation", "JointModelUniversal",
]  # fmt: skip

Array = NDArray[np.float64]


class JointModelSpherical(JointModel):
    """A rotation: q = quaternion x y z w, v = angular velocity in the body's axes."""

    __slots__ = ()
    _nq, _nv, _unlimited = 4, 3, (0, 0)

    def steps(self) -> tuple[Step, ...]:
        return (Step("spherical"),)


class JointModelSphericalZYX(JointModel):
    """A rotation by three angles, about z, the rotated y, the rotated x; v = their rates."""

    __slots__ = ()
    _nq, _nv, _unlimited = 3, 3, (3, 3)

    def steps(self) -> tuple[Step, ...]:
        return Step("revolute", Z), Step("revolute", Y), Step("revolute", X)


class JointModelTranslation(JointModel):
    """A translation: q = x y z."""

    __slots__ = ()
    _nq, _nv, _unlimited = 3, 3, (3, 3)

    def steps(self) -> tuple[Step, ...]:
        return Step("prismatic", X), Step("prismatic", Y), Step("prismatic", Z)


class JointModelPlanar(JointModel):
    """A motion in the plane of x and y: q = x y cos sin, v in the body's axes."""

    __slots__ = ()
    _nq, _nv, _unlimited = 4, 3, (2, 2)

    def steps(self) -> tuple[Step, ...]:
        return (Step("planar", Z),)


class JointModelFreeFlyer(JointModel):
    """Any motion: q = x y z, quaternion x y z w; v in the body's axes, linear first."""

    __slots__ = ()
    _nq, _nv, _unlimited = 7, 6, (3, 3)

    def steps(self) -> tuple[Step, ...]:
        return (Step("floating"),)


class JointModelUniversal(JointModel):
    """Two rotations, about ``axis1`` and the rotated ``axis2``: ``(axis1 (3,), axis2 (3,))`` or six numbers."""

    __slots__ = ("_axis1", "_axis2")
    _nq, _nv, _unlimited = 2, 2, (2, 2)

    def __init__(self, *axes: Any) -> None:
        super().__init__()
        if len(axes) not in (0, 2, 6):
            raise ArgumentError(f"JointModelUniversal got {len(axes)} arguments, expected two axes or six numbers")
        half = len(axes) // 2
        self._axis1: Vector = unit("JointModelUniversal", axes[:half]) if axes else X
        self._axis2: Vector = unit("JointModelUniversal", axes[half:]) if axes else Y

    @property
    def axis1(self) -> Array:
        """The first axis (3,); a copy: assign to change it."""
        return np.array(self._axis1)

    @axis1.setter
    def axis1(self, value: Any) -> None:
        self._axis1 = unit("JointModelUniversal", (np.asarray(value),))
        self.changed()

    @property
    def axis2(self) -> Array:
        """The second axis (3,); a copy: assign to change it."""
        return np.array(self._axis2)

    @axis2.setter
    def axis2(self, value: Any) -> None:
        self._axis2 = unit("JointModelUniversal", (np.asarray(value),))
        self.changed()

    def steps(self) -> tuple[Step, ...]:
        return Step("revolute", self._axis1), Step("revolute", self._axis2)

    def parameters(self) -> tuple[Any, ...]:
        return *self._axis1, *self._axis2


class JointModelComposite(JointModel):
    """A chain of joints that counts as one: ``(size)`` or ``(joint[, placement[, name]])``, then ``addJoint``.

    joints, jointPlacements   the parts, and the placement of each after the one before it
    """

    __slots__ = ("_joints", "_names", "_placements")

    def __init__(self, *arguments: Any) -> None:
        super().__init__()
        self._joints: list[JointModel] = OwnedList(self, JointModel)
        self._placements: list[SE3] = OwnedList(self, SE3)
        self._names: list[str] = []
        if arguments and not isinstance(arguments[0], int):
            self.addJoint(*arguments)

    @property
    def nq(self) -> int:
        return sum(joint.nq for joint in self._joints)

    @property
    def nv(self) -> int:
        return sum(joint.nv for joint in self._joints)

    @property
    def njoints(self) -> int:
        """Number of parts."""
        return len(self._joints)

    @property
    def joints(self) -> list[JointModel]:
        """The parts."""
        return self._joints

    @property
    def jointPlacements(self) -> list[SE3]:
        """Placement of each part after the one before it."""
        return self._placements

    def addJoint(self, joint: JointModel, placement: SE3 | None = None, name: str = "") -> JointModelComposite:
        """Append a part; returns the composite."""
        if self.id != NOWHERE:
            raise ModelError(f"the composite is joint {self.id} of a model, expected one that is in none yet")
        self._joints.append(joint)
        self._placements.append(SE3.Identity() if placement is None else placement)
        self._names.append(str(name))
        return self

    def getJointId(self, name: str) -> int:
        """Index of the part of that name; njoints if there is none."""
        return self._names.index(name) if name in self._names else len(self._names)

    @property
    def hasConfigurationLimit(self) -> list[bool]:
        return [has for joint in self._joints for has in joint.hasConfigurationLimit]

    @property
    def hasConfigurationLimitInTangent(self) -> list[bool]:
        return [has for joint in self._joints for has in joint.hasConfigurationLimitInTangent]

    def setIndexes(self, id: int, q: int, v: int, vExtended: int | None = None) -> None:
        super().setIndexes(id, q, v, vExtended)
        for joint in self._joints:
            joint.setIndexes(id, q, v)
            q, v = q + joint.nq, v + joint.nv

    def steps(self) -> tuple[Step, ...]:
        made = []
        for joint, placement in zip(self._joints, self._placements, strict=True):
            at = np.asarray(placement.homogeneous, dtype=float)
            for k, step in enumerate(joint.steps()):
                both = at @ np.reshape(step.placement, (4, 4)) if k == 0 else np.reshape(step.placement, (4, 4))
                made.append(step._replace(placement=tuple(both.ravel().tolist())))
        return tuple(made)

    def copy(self) -> JointModel:
        made = JointModelComposite()
        for joint, placement, name in zip(self._joints, self._placements, self._names, strict=True):
            made.addJoint(joint, placement, name)
        made.id, made.idx_q, made.idx_v, made.idx_vExtended = self._indexes()
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        return _composite, (list(self._joints), list(self._placements), list(self._names), self._indexes())

    def __repr__(self) -> str:
        parts = (f"  {joint.shortname()}" for joint in self._joints)
        return "\n".join([f"{self.shortname()} containing following models:", *parts, ""])


def _composite(
    joints: Sequence[JointModel], placements: Sequence[SE3], names: Sequence[str], indexes: tuple[int, int, int, int]
) -> JointModelComposite:
    made = JointModelComposite()
    for part in zip(joints, placements, names, strict=True):
        made.addJoint(*part)
    made.id, made.idx_q, made.idx_v, made.idx_vExtended = indexes
    return made
