"""Contacts and loops as Pinocchio has them: models, data, settings; ``algorithms.rigid_constraints`` solves them."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np

from ....errors import ModelError
from ...native import recorded_contacts as numbers
from ..coverage.coverage import Partial
from ..types.arguments import ArgumentError, Array, by_name, described, expected, number
from ..types.bases import Registered
from ..types.containers import list_class
from ..types.frame import Enum, ReferenceFrame
from ..types.motion import Force, Motion
from ..types.se3 import SE3
from ..types.value import Value, part
from .model import Model

__all__ = [
    "BaumgarteCorrectorParameters", "ContactType", "ProximalSettings", "RigidConstraintData", "RigidConstraintModel",
    "StdVec_RigidConstraintData", "StdVec_RigidConstraintModel",
]  # fmt: skip

_UNWRITTEN = (  # motions of the data that stay zero
    "contact_acceleration", "contact_acceleration_desired", "contact_acceleration_deviation",
    "contact_acceleration_error", "contact1_acceleration_drift", "contact2_acceleration_drift",
)  # fmt: skip
REFERENCES = ReferenceFrame.LOCAL, ReferenceFrame.LOCAL_WORLD_ALIGNED, ReferenceFrame.WORLD
_INSTEAD = "getConstraintJacobian gives J; a ProximalSettings with mu above 0 solves contacts that depend on others"


def _view(first: int, kind: Any, doc: str) -> Any:
    """A property for an SE3, Motion, Force or gains that view numbers of ``_x``; assigning one copies it."""
    shape = (4, 4) if kind is SE3 else (2,) if kind is BaumgarteCorrectorParameters else (6,)

    def numbers_of(self: Any) -> Any:
        return self._x[first : first + math.prod(shape)].reshape(shape)

    def assign(self: Any, value: Any) -> None:
        numbers_of(self)[...] = expected(value, kind, "value")._x

    return property(lambda self: kind.over(numbers_of(self)), assign, doc=doc)


class BaumgarteCorrectorParameters(Value):
    """Gains of errors of a contact, Kp of its placement [1/s²] and Kd of its velocity [1/s]."""

    _arguments = ("Kp", "Kd")
    Kp, Kd = part("Kp", 0, "Kp [1/s²]."), part("Kd", 1, "Kd [1/s].")

    def __init__(self, Kp: Any, Kd: Any) -> None:
        self._x = np.array([number(Kp, "Kp"), number(Kd, "Kd")])


class ProximalSettings:
    """``(accuracy, mu, max_iter)``, ``(absolute_accuracy, relative_accuracy, mu, max_iter)``, or none of them.

    With mu above 0, J a + γ = -mu (λ - λ of the last iteration), which contacts that depend on each other need too.
    ``iter``, ``absolute_residual`` (of J a + γ) and ``relative_residual`` (of λ) are written by a solver.
    """

    absolute_accuracy = part("absolute_accuracy", numbers.ABSOLUTE, "Bound on ``absolute_residual``.")
    relative_accuracy = part("relative_accuracy", numbers.RELATIVE, "Bound on ``relative_residual`` per largest λ.")
    mu = part("mu", numbers.MU, "Above 0 for contacts that depend on each other.")
    max_iter = part("max_iter", numbers.MOST, "Largest number of iterations.", int)
    iter = part("iter", numbers.ITERATIONS, "Number of iterations.", int)
    absolute_residual = part("absolute_residual", numbers.ABSOLUTE_RESIDUAL, "Largest entry of J a + γ.")
    relative_residual = part("relative_residual", numbers.RELATIVE_RESIDUAL, "Largest last change of λ.")

    def __init__(self, *given: Any) -> None:
        if len(given) not in (0, 3, 4):
            raise ArgumentError(f"ProximalSettings got {len(given)} numbers, expected 0, 3 or 4")
        accuracies, (mu, most) = given[:-2] or (1e-12,), given[-2:] or (0.0, 1)
        self._x = np.array([0.0, 0.0, 0.0, 1.0, 0.0, -1.0, -1.0])
        self.absolute_accuracy, self.relative_accuracy = accuracies[0], accuracies[-1]
        self.mu, self.max_iter = mu, most


class ContactType(Enum):
    """Whether a contact constrains a point or a frame."""

    CONTACT_3D, CONTACT_6D, CONTACT_UNDEFINED = range(3)


class RigidConstraintModel(Partial):
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

    _instead = dict.fromkeys(["setCompliance", "retrieveCompliance"], _INSTEAD)
    joint1_id = part("joint1_id", 2, "Index of the first joint.", int)
    joint2_id = part("joint2_id", 3, "Index of the second joint.", int)
    joint1_placement = _view(6, SE3, "Placement of the first frame on its joint.")
    joint2_placement = _view(22, SE3, "Placement of the second frame on its joint.")

    type = property(
        lambda self: ContactType.CONTACT_3D if self._x[0] == 3.0 else ContactType.CONTACT_6D,
        doc="Whether the contact constrains a point or a frame.",
    )
    m_baumgarte_parameters = _view(4, BaumgarteCorrectorParameters, "Gains of errors, a view: 0 at first.")

    @property
    def reference_frame(self) -> ReferenceFrame:
        """The axes of J and of forces: of frame 1 (LOCAL) or of the world (LOCAL_WORLD_ALIGNED)."""
        return REFERENCES[int(self._x[1])]

    @reference_frame.setter
    def reference_frame(self, value: Any) -> None:
        self._x[1] = REFERENCES.index(expected(value, ReferenceFrame, "reference_frame"))

    def __init__(self, contact_type: Any, model: Any = None, joint1_id: Any = None, *rest: Any, **named: Any) -> None:
        if isinstance(contact_type, RigidConstraintModel):
            self.__dict__.update(copy.deepcopy(contact_type).__dict__)
            return
        given, left = dict(named), list(rest)
        if left and isinstance(left[-1], ReferenceFrame):
            given["reference_frame"] = left.pop()
        order = "contact_type model joint1_id joint1_placement joint2_id joint2_placement reference_frame"
        given = by_name("RigidConstraintModel", order, (contact_type, model, joint1_id, *left), given, 3)
        kind = expected(contact_type, ContactType, "contact_type")
        if kind == ContactType.CONTACT_UNDEFINED:
            raise ArgumentError("contact_type is CONTACT_UNDEFINED, expected CONTACT_3D or CONTACT_6D")
        joints = [joint1_id, given.get("joint2_id", 0)]
        for at in joints:
            if not isinstance(at, (int, np.integer)):
                raise ArgumentError(f"joint index is {described(at)}, expected an int")
            if not 0 <= at < expected(model, Model, "model").njoints:
                raise ModelError(f"joint index is {at}, expected one from 0 to {model.njoints - 1}")
        self._x = np.zeros(numbers.GIVEN)  # as ``native.recorded_contacts`` reads it
        self._x[0], self._x[2:4] = 3.0 if kind == ContactType.CONTACT_3D else 6.0, joints
        self.joint1_placement = given.get("joint1_placement", SE3.Identity())
        self.joint2_placement = given.get("joint2_placement", SE3.Identity())
        self.reference_frame = given.get("reference_frame", ReferenceFrame.LOCAL)
        self.name = ""
        self.desired_contact_placement = SE3.Identity()
        self.desired_contact_velocity, self.desired_contact_acceleration = Motion.Zero(), Motion.Zero()

    def residualSize(self) -> int:
        """Number of constraints: 3 or 6."""
        return int(self._x[0])

    def calc(self, model: Model, data: Any, constraint_data: RigidConstraintData) -> None:
        """Write oMc1, oMc2 and c1Mc2 to the data of the contact, from ``data.oMi``."""
        expected(model, Model, "model")
        own, X = expected(constraint_data, RigidConstraintData, "constraint_data"), data.array("oMi")
        own.oMc1 = SE3.over(X[self.joint1_id]) * self.joint1_placement
        own.oMc2 = SE3.over(X[self.joint2_id]) * self.joint2_placement
        own.c1Mc2 = own.oMc1.actInv(own.oMc2)

    def jacobian(self, model: Model, data: Any, constraint_data: RigidConstraintData) -> Array:
        """``getConstraintJacobian`` of this contact."""
        factors = Registered.classes["ConstraintCholeskyDecomposition"]
        return factors.jacobian(model, data, [self], [constraint_data])  # type: ignore[no-any-return]

    def createData(self) -> RigidConstraintData:
        """A RigidConstraintData."""
        return RigidConstraintData(self)

    def copy(self) -> RigidConstraintModel:
        """An independent copy."""
        return RigidConstraintModel(self)

    cast = copy

    def setBaumgarteCorrectorParameters(self, bp: BaumgarteCorrectorParameters) -> None:
        """Set the gains of errors."""
        self.m_baumgarte_parameters = bp


class RigidConstraintData(Partial):
    """Of a contact at the last call: its force, placements oMc1, oMc2, c1Mc2, velocities and errors, in frame 1.

    contact_acceleration* and contact*_acceleration_drift stay zero. What a solver keeps for itself raises
    OutOfScopeError.
    """

    _instead = dict.fromkeys(
        ["extended_motion_propagators_joint1", "extended_motion_propagators_joint2", "lambdas_joint1"],
        "scratch of Pinocchio's solver, none here",
    )
    contact_force = _view(0, Force, "Force of the contact.")
    oMc1, oMc2 = _view(6, SE3, "Pose of the first frame."), _view(22, SE3, "Pose of the second frame.")
    c1Mc2 = _view(38, SE3, "Pose of the second frame in the first.")
    contact1_velocity, contact2_velocity = _view(54, Motion, "Of frame 1."), _view(60, Motion, "Of frame 2.")
    contact_placement_error = _view(66, Motion, "Error of the placement.")
    contact_velocity_error = _view(72, Motion, "Error of the velocity.")

    def __init__(self, contact_model: RigidConstraintModel) -> None:
        expected(contact_model, RigidConstraintModel, "contact_model")
        self._x = np.zeros(numbers.FOUND)
        self.oMc1 = self.oMc2 = self.c1Mc2 = SE3.Identity()
        for name in _UNWRITTEN:
            setattr(self, name, Motion.Zero())


StdVec_RigidConstraintModel, StdVec_RigidConstraintData = (
    list_class(kind.__name__, kind, kind.__name__) for kind in (RigidConstraintModel, RigidConstraintData)
)
