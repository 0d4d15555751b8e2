"""The names of contacts for scripts that make them: solving is left to ``forwardDynamics`` and ``impulseDynamics``."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from ....errors import ModelError
from ..coverage.coverage import OutOfScopeAttributeError, OutOfScopeError
from ..types.arguments import ArgumentError, described, expected
from ..types.frame import Enum, ReferenceFrame
from ..types.motion import Force, Motion
from ..types.se3 import SE3
from .model import Model

_ADVICE = "forwardDynamics and impulseDynamics take the constraint's Jacobian, getFrameJacobian of the contact say"


class ContactType(Enum):
    """What a contact holds: a point, or a frame."""

    CONTACT_3D = 0
    CONTACT_6D = 1
    CONTACT_UNDEFINED = 2


class RigidConstraintModel:
    """A contact between two joints, as numbers: nothing here solves for its forces.

    ``(contact_type, model, joint1_id[, joint1_placement[, joint2_id, joint2_placement]][, reference_frame])`` or a
    copy. Raises ModelError for a joint that is not there.

    type                                ContactType
    joint1_id, joint2_id                indices; 0 is the world
    joint1_placement, joint2_placement  SE3 on those joints
    reference_frame                     ReferenceFrame
    name                                str
    desired_contact_placement, desired_contact_velocity, desired_contact_acceleration
    """

    def __init__(self, contact_type: Any, model: Any = None, joint1_id: Any = None, *rest: Any, **named: Any) -> None:
        if isinstance(contact_type, RigidConstraintModel):
            self.__dict__.update(copy.deepcopy(contact_type).__dict__)
            return
        given, left = dict(named), list(rest)
        if left and isinstance(left[-1], ReferenceFrame):
            given["reference_frame"] = left.pop()
        order = ("joint1_placement", "joint2_id", "joint2_placement", "reference_frame")
        given |= dict(zip(order, left, strict=False))
        if len(left) > len(order) or not {*given} <= {*order}:
            raise ArgumentError(
                f"RigidConstraintModel got {len(rest) + 3} arguments and {', '.join(named)}, expected contact_type, "
                f"model, joint1_id and some of {', '.join(order)}"
            )
        self.type = expected(contact_type, ContactType, "contact_type")
        if self.type == ContactType.CONTACT_UNDEFINED:
            raise ArgumentError("contact_type is CONTACT_UNDEFINED, expected CONTACT_3D or CONTACT_6D")
        joints = [joint1_id, given.get("joint2_id", 0)]
        for at in joints:
            if not isinstance(at, (int, np.integer)):
                raise ArgumentError(f"joint index is {described(at)}, expected an int")
            if not 0 <= at < expected(model, Model, "model").njoints:
                raise ModelError(f"joint index is {at}, expected one from 0 to {model.njoints - 1}")
        self.joint1_id, self.joint2_id = map(int, joints)
        self.joint1_placement, self.joint2_placement = (
            SE3(expected(given.get(name, SE3.Identity()), SE3, name))
            for name in ("joint1_placement", "joint2_placement")
        )
        self.reference_frame = ReferenceFrame(given.get("reference_frame", ReferenceFrame.LOCAL))
        self.name = ""
        self.desired_contact_placement = SE3.Identity()
        self.desired_contact_velocity, self.desired_contact_acceleration = Motion.Zero(), Motion.Zero()

    def residualSize(self) -> int:
        """Number of constraints: 3 or 6."""
        return 3 if self.type == ContactType.CONTACT_3D else 6

    def createData(self) -> RigidConstraintData:
        """A RigidConstraintData."""
        return RigidConstraintData(self)

    def copy(self) -> RigidConstraintModel:
        """An equal one of its own."""
        return RigidConstraintModel(self)

    def calc(self, *arguments: Any) -> Any:
        """Raises OutOfScopeError."""
        raise OutOfScopeError(f"RigidConstraintModel.calc: spatialdyn has no constraint solver, {_ADVICE}")

    def jacobian(self, *arguments: Any) -> Any:
        """Raises OutOfScopeError."""
        raise OutOfScopeError(f"RigidConstraintModel.jacobian: spatialdyn has no constraint solver, {_ADVICE}")

    def __getattr__(self, name: str) -> Any:
        if name in ("m_baumgarte_parameters", "setBaumgarteCorrectorParameters", "setCompliance", "retrieveCompliance"):
            raise OutOfScopeAttributeError(
                f"RigidConstraintModel.{name}: spatialdyn has no constraint solver, {_ADVICE}"
            )
        raise AttributeError(f"a RigidConstraintModel has no attribute {name!r}")


class RigidConstraintData:
    """Of a contact: contact_force, contact_placement_error, contact_velocity_error, oMc1, oMc2, c1Mc2, at rest.

    Nothing here fills them.
    """

    def __init__(self, contact_model: RigidConstraintModel) -> None:
        expected(contact_model, RigidConstraintModel, "contact_model")
        self.contact_force = Force.Zero()
        self.contact_placement_error, self.contact_velocity_error = Motion.Zero(), Motion.Zero()
        self.oMc1, self.oMc2, self.c1Mc2 = SE3.Identity(), SE3.Identity(), SE3.Identity()
