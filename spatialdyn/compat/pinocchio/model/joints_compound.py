"""Joint models with several velocities, and chains of joint models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ....errors import ModelError
from ..types.arguments import ArgumentError
from ..types.se3 import SE3
from ..types.tracked_list import OwnedList
from .joint import NOWHERE, JointModel, Step, Vector, X, Y, Z, joint_kind, joint_of
from .joints_one_axis import axis_property, unit

__all__ = [
    "JointModelComposite", "JointModelFreeFlyer", "JointModelPlanar", "JointModelSpherical",
    "JointModelSphericalZYX", "JointModelTranslation", "JointModelUniversal",
]  # fmt: skip


def _several(name: str, nq: int, nv: int, limits: int, doc: str, *steps: Step) -> Any:
    return joint_kind(f"JointModel{name}", JointModel, doc, _nq=nq, _nv=nv, _unlimited=(limits, limits), _steps=steps)


JointModelSpherical = _several(
    "Spherical", 4, 3, 0,
    "A rotation: q = quaternion x y z w, v = angular velocity in the body's axes.",
    Step("spherical"),
)  # fmt: skip
JointModelSphericalZYX = _several(
    "SphericalZYX", 3, 3, 3,
    "A rotation by three angles, about z, the rotated y, the rotated x; v = their rates.",
    *(Step("revolute", axis) for axis in (Z, Y, X)),
)  # fmt: skip
JointModelTranslation = _several(
    "Translation", 3, 3, 3, "A translation: q = x y z.", *(Step("prismatic", axis) for axis in (X, Y, Z))
)
JointModelPlanar = _several(
    "Planar", 4, 3, 2, "A motion in the plane of x and y: q = x y cos sin, v in the body's axes.", Step("planar", Z)
)
JointModelFreeFlyer = _several(
    "FreeFlyer", 7, 6, 3,
    "Any motion: q = x y z, quaternion x y z w; v in the body's axes, linear first.",
    Step("floating"),
)  # fmt: skip


class Universal(JointModel):
    """Two rotations, about ``axis1`` and the rotated ``axis2``: ``(axis1 (3,), axis2 (3,))`` or six numbers."""

    __slots__ = ("_axis1", "_axis2")
    _nq, _nv, _unlimited = 2, 2, (2, 2)
    axis1 = axis_property("_axis1", "The first axis (3,); a copy: assign to change it.")
    axis2 = axis_property("_axis2", "The second axis (3,); a copy: assign to change it.")

    def __init__(self, *axes: Any) -> None:
        super().__init__()
        if len(axes) not in (0, 2, 6):
            raise ArgumentError(f"JointModelUniversal got {len(axes)} arguments, expected two axes or six numbers")
        half = len(axes) // 2
        self._axis1: Vector = unit(self._name, axes[:half]) if axes else X
        self._axis2: Vector = unit(self._name, axes[half:]) if axes else Y

    def steps(self) -> tuple[Step, ...]:
        return Step("revolute", self._axis1), Step("revolute", self._axis2)

    def parameters(self) -> tuple[Any, ...]:
        return *self._axis1, *self._axis2


class Composite(JointModel):
    """A chain of joints that counts as one: ``(size)`` or ``(joint[, placement[, name]])``, then ``addJoint``.

    joints, jointPlacements   the parts, and the placement of each after the one before it
    """

    __slots__ = ("_names", "jointPlacements", "joints")

    def __init__(self, *arguments: Any) -> None:
        super().__init__()
        self.joints: list[JointModel] = OwnedList(self, JointModel)
        self.jointPlacements: list[SE3] = OwnedList(self, SE3)
        self._names: list[str] = []
        if arguments and not isinstance(arguments[0], int):
            self.addJoint(*arguments)

    @property
    def nq(self) -> int:
        return sum(joint.nq for joint in self.joints)

    @property
    def nv(self) -> int:
        return sum(joint.nv for joint in self.joints)

    @property
    def njoints(self) -> int:
        """Number of parts."""
        return len(self.joints)

    def addJoint(self, joint: JointModel, placement: SE3 | None = None, name: str = "") -> Composite:
        """Append a part; returns the composite."""
        if self.id != NOWHERE:
            raise ModelError(f"the composite is joint {self.id} of a model, expected one that is in none yet")
        self.joints.append(joint)
        self.jointPlacements.append(SE3.Identity() if placement is None else placement)
        self._names.append(str(name))
        return self

    def getJointId(self, name: str) -> int:
        """Index of the part of that name; njoints if there is none."""
        return self._names.index(name) if name in self._names else len(self._names)

    @property
    def hasConfigurationLimit(self) -> list[bool]:
        return [has for joint in self.joints for has in joint.hasConfigurationLimit]

    @property
    def hasConfigurationLimitInTangent(self) -> list[bool]:
        return [has for joint in self.joints for has in joint.hasConfigurationLimitInTangent]

    def setIndexes(self, id: int, q: int, v: int, vExtended: int | None = None) -> None:
        super().setIndexes(id, q, v, vExtended)
        for joint in self.joints if self.id != NOWHERE else ():
            joint.setIndexes(id, q, v)
            q, v = q + joint.nq, v + joint.nv

    def steps(self) -> tuple[Step, ...]:
        made = []
        for joint, placement in zip(self.joints, self.jointPlacements, strict=True):
            at = np.asarray(placement.homogeneous, dtype=float)
            for k, step in enumerate(joint.steps()):
                both = at @ np.reshape(step.placement, (4, 4)) if k == 0 else np.reshape(step.placement, (4, 4))
                made.append(step._replace(placement=tuple(both.ravel().tolist())))
        return tuple(made)

    def state(self) -> dict[str, Any]:
        placements = [placement._x.ravel().tolist() for placement in self.jointPlacements]
        parts = zip([joint.state() for joint in self.joints], placements, self._names, strict=True)
        return {**super().state(), "parts": [list(part) for part in parts]}

    def _fill(self, given: Mapping[str, Any]) -> None:
        for part, placement, name in given["parts"]:
            self.addJoint(joint_of(part), SE3.over(np.reshape(placement, (4, 4)).astype(float)), name)

    def __repr__(self) -> str:
        parts = (f"  {joint.shortname()}" for joint in self.joints)
        return "\n".join([f"{self.shortname()} containing following models:", *parts, ""])


JointModelUniversal = joint_kind("JointModelUniversal", Universal, Universal.__doc__)
JointModelComposite = joint_kind("JointModelComposite", Composite, Composite.__doc__)
