"""The table of calls: a line per public call with its inputs and Pinocchio's function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls import dynamics
from ..model.model import Model
from ..recursions import SPECS
from . import derived

Array = NDArray[np.float64]
REFERENCES = ("local", "world", "local_world_aligned")


@dataclass(frozen=True)
class Call:
    """A public call and its counterpart in Pinocchio.

    label   label of the row: the name of the call, and a variant in brackets
    inputs  fields of States that both libraries take, in order
    peer    name of Pinocchio's function of (model, data, *inputs); or a function of (pin, model, data, *inputs) that
            combines several, which is not timed; empty if there is neither
    result  function that reads the result from Pinocchio's data; None if ``peer`` returns it
    frame   Pinocchio's function of (model, data, frame, reference) to call after ``peer``, for calls of a frame;
            without a peer, any name
    static  arguments of the public call after frame and reference
    data    whether ``peer`` takes data
    """

    label: str
    inputs: str
    peer: str | Callable[..., Any]
    result: Callable[[Any], Any] | None = None
    frame: str = ""
    static: tuple[Any, ...] = ()
    data: bool = True

    @property
    def name(self) -> str:
        """Name of the public call."""
        return self.label.partition(" ")[0]

    @property
    def references(self) -> tuple[str, ...]:
        """The references compared; none for a placement and for calls without a frame.

        Derivatives leave out local_world_aligned: there Pinocchio differentiates the velocity of a point at rest, not
        the velocity that its getFrameVelocity returns.
        """
        asked = REFERENCES[:2] if self.name.endswith("_derivatives") else REFERENCES
        return asked if any(x.name == "reference" for x in SPECS[self.name].present) else ()

    @property
    def rank(self) -> int:
        """Axes of one result."""
        return len(SPECS[self.name].output.shape) if self.name in SPECS else 0


CALLS = (
    Call("rnea", "q v a", "rnea"),
    Call("rnea (fext)", "q v a fext", "rnea"),
    Call("crba", "q", "crba"),
    Call("aba", "q v tau", "aba"),
    Call("aba (fext)", "q v tau fext", "aba"),
    Call("aba_refined", "q v tau", "aba"),
    Call("aba_square_root", "q v tau", "aba"),
    Call("crba_solve", "q v tau", "aba"),
    Call("minverse", "q", "computeMinverse"),
    Call("nonlinear_effects", "q v", "nonLinearEffects"),
    Call("generalized_gravity", "q", "computeGeneralizedGravity"),
    Call("static_torque", "q fext", "computeStaticTorque"),
    Call("kinetic_energy", "q v", "computeKineticEnergy"),
    Call("potential_energy", "q", "computePotentialEnergy"),
    Call("total_mass", "", "computeTotalMass"),
    Call("center_of_mass", "q", "centerOfMass"),
    Call("center_of_mass_velocity", "q v", "centerOfMass", lambda data: data.vcom[0]),
    Call("center_of_mass_acceleration", "q v a", "centerOfMass", lambda data: data.acom[0]),
    Call("subtree_centers_of_mass", "q", "centerOfMass", lambda data: derived.of_masses(data, data.com)),
    Call("subtree_com_velocities", "q v", "centerOfMass", lambda data: derived.of_masses(data, data.vcom)),
    Call("subtree_com_accelerations", "q v a", "centerOfMass", lambda data: derived.of_masses(data, data.acom)),
    Call("com_jacobian", "q", "jacobianCenterOfMass"),
    Call("forward_kinematics", "q", "forwardKinematics", lambda data: list(data.oMi)),
    Call("joint_velocities", "q v", "forwardKinematics", lambda data: list(data.v)),
    Call("joint_accelerations", "q v a", "forwardKinematics", lambda data: list(data.a)),
    Call("joint_forces", "q v a", "rnea", lambda data: derived.but_first(data.f)),
    Call("joint_forces (fext)", "q v a fext", "rnea", lambda data: derived.but_first(data.f)),
    Call("frame_placement", "q", "forwardKinematics", frame="updateFramePlacement"),
    Call("frame_jacobian", "q", "computeJointJacobians", frame="getFrameJacobian"),
    Call("frame_jacobian_dot", "q v", "computeJointJacobiansTimeVariation", frame="getFrameJacobianTimeVariation"),
    Call("frame_velocity", "q v", "forwardKinematics", frame="getFrameVelocity"),
    Call("frame_acceleration", "q v a", "forwardKinematics", frame="getFrameAcceleration"),
    Call(
        "frame_acceleration (classical)", "q v a", "forwardKinematics", None, "getFrameClassicalAcceleration", (True,)
    ),
    Call("jacobian_dot_times_v", "q v", "computeJointJacobiansTimeVariation", frame="getFrameJacobianTimeVariation"),
    Call("joint_jacobians", "q", "computeJointJacobians"),
    Call("joint_jacobians_dot", "q v", "computeJointJacobiansTimeVariation"),
    Call("centroidal_momentum", "q v", "computeCentroidalMomentum"),
    Call("centroidal_momentum_rate", "q v a", "computeCentroidalMomentumTimeVariation"),
    Call("centroidal_map", "q", "computeCentroidalMap"),
    Call("centroidal_map_dot", "q v", "dccrba", lambda data: data.dAg),
    Call("coriolis_matrix", "q v", "computeCoriolisMatrix"),
    Call("mass_matrix_dot", "q v", derived.mass_matrix_dot_by_pin),
    Call("coriolis_transpose_times_velocity", "q v", derived.coriolis_transpose_by_pin),
    Call("modified_rnea", "q v d a", derived.modified_rnea_by_pin),
    Call("christoffel_symbols", "q", derived.christoffel_symbols_by_pin),
    Call("mass_matrix_derivatives", "q", derived.mass_matrix_derivatives_by_pin),
    Call("inertial_parameters", "", derived.inertial_parameters_by_pin),
    Call("joint_torque_regressor", "q v a", derived.joint_torque_regressor_by_pin),
    Call("body_regressor", "q v a", "rnea", frame="frameBodyRegressor"),
    Call("kinetic_energy_regressor", "q v", derived.kinetic_energy_regressor_by_pin),
    Call("potential_energy_regressor", "q", derived.potential_energy_regressor_by_pin),
    Call("static_regressor", "q", derived.static_regressor_by_pin),
    Call("rnea_derivatives", "q v a", "computeRNEADerivatives"),
    Call("rnea_derivatives (fext)", "q v a fext", "computeRNEADerivatives"),
    Call("aba_derivatives", "q v tau", "computeABADerivatives"),
    Call("generalized_gravity_derivatives", "q", "computeGeneralizedGravityDerivatives"),
    Call("static_torque_derivatives", "q fext", "computeStaticTorqueDerivatives"),
    Call("center_of_mass_velocity_derivatives", "q v", derived.center_of_mass_velocity_derivatives_by_pin),
    Call("centroidal_dynamics_derivatives", "q v a", "computeCentroidalDynamicsDerivatives"),
    Call(
        "frame_velocity_derivatives", "q v", "computeForwardKinematicsDerivatives", frame="getFrameVelocityDerivatives"
    ),
    Call(
        "frame_acceleration_derivatives", "q v a", "computeForwardKinematicsDerivatives",
        frame="getFrameAccelerationDerivatives",
    ),
    Call("neutral", "", "neutral", data=False),
    Call("normalize", "raw", "normalize", data=False),
    Call("integrate", "q d", "integrate", data=False),
    Call("difference", "q q1", "difference", data=False),
    Call("interpolate", "q q1 t", "interpolate", data=False),
    Call("dintegrate", "q d", "dIntegrate", data=False),
    Call("ddifference", "q q1", "dDifference", data=False),
    Call("operational_space_inertia_inverse", "q", "", frame="getFrameJacobian"),
    Call("modified_torque_regressor", "q v d a", ""),
    Call("momentum_regressor", "q v", ""),
    Call("coriolis_transpose_regressor", "q v", ""),
    Call("momentum", "q v", ""),
    Call("velocity_from_momentum", "q tau", ""),
    Call("hamiltonian", "q tau", ""),
    Call("momentum_rate", "q v tau", ""),
    Call("momentum_rate (fext)", "q v tau fext", ""),
    Call("hamilton_field", "q tau a", ""),
)  # fmt: skip
FORWARD = ("aba", "aba_refined", "aba_square_root", "crba_solve")
BY_LABEL = {call.label: call for call in CALLS}


def ours_of(call: Call, model: Model, inputs: tuple[Any, ...]) -> Array:
    """The public call's result; for calls of a frame (..., frames, references, *result)."""
    function = getattr(dynamics, call.name)
    if not call.frame:
        return np.asarray(function(model, *inputs))
    answers = [
        [function(model, *inputs, frame, *reference, *call.static) for reference in _words(call)]
        for frame in model.frames
    ]
    lead = np.ndim(answers[0][0]) - call.rank
    return np.moveaxis(np.array(answers), (0, 1), (lead, lead + 1))


def _words(call: Call) -> list[tuple[str, ...]]:
    """The references as argument tuples; one empty tuple without any."""
    return [(reference,) for reference in call.references] or [()]
