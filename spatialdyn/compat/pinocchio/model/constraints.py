"""Contacts and loops as Pinocchio has them: models, data, settings; ``algorithms.rigid_constraints`` solves them."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from ....errors import ModelError
from ..coverage.coverage import OutOfScopeAttributeError
from ..types.arguments import ArgumentError, described, expected, number
from ..types.containers import StdVec
from ..types.frame import Enum, ReferenceFrame
from ..types.motion import Force, Motion
from ..types.se3 import SE3
from .model import Model

__all__ = [
    "BaumgarteCorrectorParameters", "ContactType", "ProximalSettings", "RigidConstraintData", "RigidConstraintModel",
    "StdVec_RigidConstraintData", "StdVec_RigidConstraintModel",
]  # fmt: skip

_MOTIONS = (  # of the data, zero at rest
    "contact_placement_error", "contact_velocity_error", "contact_acceleration", "contact_acceleration_desired",
    "contact_acceleration_deviation", "contact_acceleration_error", "contact1_velocity", "contact1_acceleration_drift",
    "contact2_velocity", "contact2_acceleration_drift",
)  # fmt: skip
_INSTEAD = "getConstraintJacobian gives J; a ProximalSettings with mu above 0 solves contacts that depend on others"


class BaumgarteCorrectorParameters:
    """Gains of errors of a contact, Kp of its placement [1/s²] and Kd of its velocity [1/s]."""

    def __init__(self, Kp: Any, Kd: Any) -> None:
        self.Kp, self.Kd = number(Kp, "Kp"), number(Kd, "Kd")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, BaumgarteCorrectorParameters) and (self.Kp, self.Kd) == (other.Kp, other.Kd)

    __hash__ = object.__hash__


class ProximalSettings:
    """``(accuracy, mu, max_iter)``, ``(absolute_accuracy, relative_accuracy, mu, max_iter)``, or none of them.

    With mu above 0, J a + γ = -mu (λ - λ of the last iteration), which contacts that depend on each other need too.
    ``iter``, ``absolute_residual`` (of J a + γ) and ``relative_residual`` (of λ) are written by a solver.
    """

    def __init__(self, *given: Any) -> None:
        if len(given) not in (0, 3, 4):
            raise ArgumentError(f"ProximalSettings got {len(given)} numbers, expected 0, 3 or 4")
        accuracies = given[:-2] or (1e-12,)
        mu, most = given[-2:] or (0.0, 1)
        self.absolute_accuracy, self.relative_accuracy = (
            number(accuracies[0], "accuracy"),
            number(accuracies[-1], "accuracy"),
        )
        self.mu, self.max_iter = number(mu, "mu"), int(number(most, "max_iter"))
        self.iter, self.absolute_residual, self.relative_residual = 0, -1.0, -1.0


class ContactType(Enum):
    """Whether a contact constrains a point or a frame."""

    CONTACT_3D = 0
    CONTACT_6D = 1
    CONTACT_UNDEFINED = 2


class RigidConstraintModel:
    """A contact between two joints: a point of the first, or a frame on it, that does not move on the second.

    ``(contact_type, model, joint1_id[, joint1_placement[, joint2_id, joint2_placement]][, reference_frame])`` or a
    copy. Raises ModelError for a joint that does not exist.

    type                                ContactType
    joint1_id, joint2_id                indices; 0 is the world
    joint1_placement, joint2_placement  SE3 on those joints
    reference_frame                     ReferenceFrame
    name                                str
    m_baumgarte_parameters              BaumgarteCorrectorParameters, zero at first
    desired_contact_placement, desired_contact_velocity, desired_contact_acceleration  kept, unused as in Pinocchio
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
        self.name, self.m_baumgarte_parameters = "", BaumgarteCorrectorParameters(0.0, 0.0)
        self.desired_contact_placement = SE3.Identity()
        self.desired_contact_velocity, self.desired_contact_acceleration = Motion.Zero(), Motion.Zero()

    def residualSize(self) -> int:
        """Number of constraints: 3 or 6."""
        return 3 if self.type == ContactType.CONTACT_3D else 6

    def createData(self) -> RigidConstraintData:
        """A RigidConstraintData."""
        return RigidConstraintData(self)

    def copy(self) -> RigidConstraintModel:
        """An independent copy."""
        return RigidConstraintModel(self)

    def cast(self) -> RigidConstraintModel:
        """An independent copy."""
        return self.copy()

    def setBaumgarteCorrectorParameters(self, bp: BaumgarteCorrectorParameters) -> None:
        """Set the gains of errors."""
        self.m_baumgarte_parameters = copy.copy(expected(bp, BaumgarteCorrectorParameters, "bp"))

    def __getattr__(self, name: str) -> Any:
        if name in ("calc", "jacobian", "setCompliance", "retrieveCompliance"):
            raise OutOfScopeAttributeError(f"RigidConstraintModel.{name}: {_INSTEAD}")
        raise AttributeError(f"a RigidConstraintModel has no attribute {name!r}")


class RigidConstraintData:
    """Of a contact at the last call: its force, placements oMc1, oMc2, c1Mc2, velocities and errors, in frame 1.

    contact_acceleration* and contact*_acceleration_drift stay zero. What a solver keeps for itself raises
    OutOfScopeError.
    """

    contact_placement_error: Motion
    contact_velocity_error: Motion
    contact_acceleration: Motion
    contact_acceleration_desired: Motion
    contact_acceleration_deviation: Motion
    contact_acceleration_error: Motion
    contact1_velocity: Motion
    contact1_acceleration_drift: Motion
    contact2_velocity: Motion
    contact2_acceleration_drift: Motion

    def __init__(self, contact_model: RigidConstraintModel) -> None:
        expected(contact_model, RigidConstraintModel, "contact_model")
        self.contact_force = Force.Zero()
        for name in _MOTIONS:
            setattr(self, name, Motion.Zero())
        self.oMc1, self.oMc2, self.c1Mc2 = SE3.Identity(), SE3.Identity(), SE3.Identity()

    def __getattr__(self, name: str) -> Any:
        if name in ("extended_motion_propagators_joint1", "extended_motion_propagators_joint2", "lambdas_joint1"):
            raise OutOfScopeAttributeError(f"RigidConstraintData.{name}: scratch of Pinocchio's solver, none here")
        raise AttributeError(f"a RigidConstraintData has no attribute {name!r}")


class _Contacts(StdVec):
    """A list of copies, which does not watch them."""

    def _own(self, value: Any) -> Any:
        return copy.deepcopy(super()._own(value))


class StdVec_RigidConstraintModel(_Contacts):
    """A list of RigidConstraintModel."""

    kind = RigidConstraintModel


class StdVec_RigidConstraintData(_Contacts):
    """A list of RigidConstraintData."""

    kind = RigidConstraintData
