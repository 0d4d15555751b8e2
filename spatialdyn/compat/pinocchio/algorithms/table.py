"""The table of names: a row for each function that one call of the library answers.

``calls.py`` makes the functions; ``calls.pyi``, written from the rows too, is what editors and type checkers read. In
regressors π are toDynamicParameters of the inertias after the universe's, one after the other; columns of all joints
lie side by side. ∂/∂q is along ``integrate(q, e_k)``.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..data.data import Data, library_of
from ..data.dispatch import last_call
from ..data.face import Face, Input, forces_given
from ..data.field_recipes import DERIVATIVES, columns, mechanical_energy
from ..model.model import Model
from ..types.arguments import OMITTED, ArgumentError, described
from ..types.frame import ACCELERATION, LOCAL, Convention, KinematicLevel
from ..types.motion import Force
from .derivatives import derivatives_of_frame, last_of
from .jacobians import recorded_jacobian
from .kinematics import motion_of_frame
from .of_models import (
    PRECISION,
    call_of_library,
    is_normalized,
    is_same_configuration,
    random_configuration,
    total_mass,
)

FLAG = bool, np.bool_, type(None)  # what Pinocchio takes for a bool
Read = tuple[str, tuple[Any, ...], Any]  # kind, inputs and external forces of a call

# --- arguments ----------------------------------------------------------------------------------------------

Q = Input("q", "x", "Numbers", "(nq,) joint positions [rad | m]")
V = Input("v", "x", "Numbers", "(nv,) joint velocities [rad/s | m/s]")
A = Input("a", "x", "Numbers", "(nv,) joint accelerations [rad/s² | m/s²]")
TAU = Input("tau", "x", "Numbers", "(nv,) joint torques [N m | N]")
FEXT = Input("fext", "f", "Forces", "a list of njoints Force: on each joint's body, in the joint's frame")
PUSHED = FEXT.otherwise(OMITTED)
CONVENTION = Input("convention", "o", "Convention", "only selects the fields of data that are filled", Convention.LOCAL)
SUBTREES = Input("compute_subtree_coms", "o", "bool", "has no effect: centres of subtrees are lazy", True)
LEVEL = Input("kinematic_level", "o", "KinematicLevel | int", "", OMITTED)
JOINT, FRAME = (Input(f"{x}_id", "i", "int", f"index of a {x}") for x in ("joint", "frame"))
REFERENCE = Input("reference_frame", "r", "ReferenceFrame", "axes, and point the spatial vector is about")
LOCALLY = REFERENCE.otherwise(LOCAL)
PLACEMENT = Input("placement", "p", "SE3", "pose of a frame in the joint's frame")
AFTER = Input("last", "r", "ReferenceFrame", "", None)  # a reference frame that follows a placement
Q_, V_, A_, TAU_ = (x.otherwise(OMITTED) for x in (Q, V, A, TAU))
LISTED, LISTED_LOCALLY = (((FRAME, x), (JOINT, PLACEMENT, x)) for x in (REFERENCE, LOCALLY))
Q1, Q2 = (Input(x, "n", "Numbers", "(nq,) joint positions [rad | m]") for x in ("q1", "q2"))
ALPHA = Input("alpha", "n", "float", "from 0 at q1 to 1 at q2")
PREC = Input("prec", "n", "float", "a precision")
LOWER, UPPER = (Input(f"{x}_bound", "n", "Numbers", f"(nq,) {x} bounds", OMITTED) for x in ("lower", "upper"))
OWN_DATA = Input("data", "n", "Data", "whose ``mass[0]`` is written, if any", OMITTED)
OPTIONAL = FRAME.otherwise(None), REFERENCE.otherwise(None), AFTER, JOINT.otherwise(None), PLACEMENT.otherwise(None)


def _kind(face: Face, convention: Any) -> str:
    """The kind of call of a convention. Raises ArgumentError for what is none."""
    if not isinstance(convention, Convention):
        raise ArgumentError(f"convention is {described(convention)}, expected a Convention")
    return face.call[0] + "_world" * (convention == Convention.WORLD)


def _of_crba(face: Face, model: Model, data: Data, q: Any, convention: Any) -> Read:
    return _kind(face, convention), (q,), None


def _of_aba(face: Face, model: Model, data: Data, q: Any, v: Any, tau: Any, fext: Any, convention: Any) -> Read:
    """The convention may stand in place of the forces."""
    fext, convention = (OMITTED, fext) if isinstance(fext, Convention) else (fext, convention)
    return _kind(face, convention), (q, v, tau), forces_given(fext)


def _with_forces(face: Face, model: Model, data: Data, q: Any, fext: Any) -> Read:
    return face.call[0], (q,), forces_given(fext)


def _of_com(face: Face, model: Model, data: Data, q: Any, v: Any, a: Any, subtrees: Any, level: Any) -> Read:
    """A level and the flag may stand in place of q, v and a."""
    values = [x for x in (q, v, a) if x is not OMITTED]
    if values and isinstance(values[-1], FLAG):
        values.pop()
    values += [x for x in (level,) if x is not OMITTED]
    if values and isinstance(values[0], np.ndarray) and len(values) <= 3:
        return face.call[len(values) - 1], tuple(values), None
    level = values[0] if values else ACCELERATION
    if len(values) > 1 or not isinstance(level, (int, KinematicLevel)):
        raise ArgumentError(f"centerOfMass got {', '.join(map(described, values))}, expected arrays or a level")
    runs = [last_call(model, data, *fields.split()) for fields in ("oMi", "v oMi", "a oMi")]
    inputs = [getattr(run, x).copy() for k, (run, x) in enumerate(zip(runs, "qva", strict=True)) if level >= k]
    return face.call[len(inputs) - 1], tuple(inputs), None


def _of_com_jacobian(face: Face, model: Model, data: Data, q: Any, subtrees: Any) -> Read:
    """The flag may stand in place of q."""
    given = q is not OMITTED and not isinstance(q, FLAG)
    return face.call[0], (q if given else last_call(model, data, "oMi").q.copy(),), None


def _of_aba_derivatives(face: Face, model: Model, data: Data, q: Any, v: Any, tau: Any, fext: Any) -> Read:
    """q, v and tau of the last aba if they are left out; the forces may then stand in place of q."""
    if tau is not OMITTED:
        return face.call[0], (q, v, tau), forces_given(fext)
    if v is not OMITTED or (q is not OMITTED and fext is not OMITTED):
        raise ArgumentError("computeABADerivatives got some of q, v and tau, expected all or none")
    library_of(model, data)
    run: Any = last_of(data, "aba", "aba_world")
    if run is None:
        raise ArgumentError("q is not given and aba was not called with this data, expected either")
    fext = forces_given(q if q is not OMITTED else fext)
    if run.fext is not None and fext is None:
        raise ArgumentError("fext is not given and the last aba had some, expected them here too")
    return face.call[0], (run.q.copy(), run.v.copy(), run.tau.copy()), fext


# --- results ------------------------------------------------------------------------------------------------


def _energy(run: Any, result: Any) -> Any:
    return run.result.item()


def _force(run: Any, result: Any) -> Force:
    made = Force.__new__(Force)
    made._x = result
    return made


# --- the rows -----------------------------------------------------------------------------------------------

PAIR, THREE, FOUR = (f"tuple[{', '.join(['Array'] * n)}]" for n in (2, 3, 4))
_motion = partial(Face, returns="Motion", answer=motion_of_frame)
_jacobian = partial(Face, answer=recorded_jacobian)
_derivative = partial(Face, answer=derivatives_of_frame, last=DERIVATIVES)
_configuration = partial(Face, answer=call_of_library, of_data=False)
_moving = (OPTIONAL[0], LOCALLY, *OPTIONAL[2:])

KINEMATICS = (
    Face("forwardKinematics", (Q, V_, A_), ("kinematics0", "kinematics1", "kinematics2"),
         "Poses of the joints; with v their velocities, with a their accelerations too.", "None"),
    _motion("getVelocity", (JOINT, LOCALLY), ("v",), "Velocity of a joint's frame, from ``data.v``."),
    _motion("getAcceleration", (JOINT, LOCALLY), ("a",), "Spatial acceleration of a joint's frame, from ``data.a``."),
    _motion("getClassicalAcceleration", (JOINT, LOCALLY), ("a",),
            "Classical acceleration of a joint's frame, from ``data.v`` and ``data.a``."),
    _motion("getFrameVelocity", _moving, ("v",),
            "Velocity of a frame of the model, or one placed on a joint, from ``data.v``.", overloads=LISTED_LOCALLY),
    _motion("getFrameAcceleration", _moving, ("a",),
            "Spatial acceleration of a frame, from ``data.a``; see getFrameVelocity.", overloads=LISTED_LOCALLY),
    _motion("getFrameClassicalAcceleration", _moving, ("a",),
            "Classical acceleration of a frame, from ``data.v`` and ``data.a``.", overloads=LISTED_LOCALLY),
)  # fmt: skip

DYNAMICS = (
    Face("rnea", (Q, V, A, PUSHED), ("rnea",), "Torques τ = M(q) a + C(q, v) v + g(q) - Σ Jᵀ fext (nv,)."),
    Face("aba", (Q, V, TAU, PUSHED, CONVENTION), ("aba",),
         "Accelerations (nv,) under torques and external forces.\n\n"
         "Raises InertiaError naming a joint with zero articulated inertia, where Pinocchio returns nan.",
         read=_of_aba, overloads=((Q, V, TAU, PUSHED, CONVENTION), (Q, V, TAU, CONVENTION))),
    Face("crba", (Q, CONVENTION), ("crba",), "Mass matrix M(q) (nv, nv), both triangles filled.", read=_of_crba),
    Face("nonLinearEffects", (Q, V), ("nle",), "Bias torques C(q, v) v + g(q) (nv,)."),
    Face("computeGeneralizedGravity", (Q,), ("gravity",), "Gravity torques g(q) (nv,)."),
    Face("computeStaticTorque", (Q, FEXT), ("static",), "Torques g(q) - Σ Jᵀ fext (nv,) that hold the robot still.",
         read=_with_forces),
    Face("computeCoriolisMatrix", (Q, V), ("coriolis",), "Coriolis matrix C(q, v) (nv, nv), of Christoffel symbols."),
    Face("computeMinverse", (Q_,), ("minverse",), "Inverse of the mass matrix (nv, nv); by default at the last aba.\n\n"
         "Raises InertiaError naming a joint with zero articulated inertia, where Pinocchio returns inf.", last="ddq"),
    Face("computeAllTerms", (Q, V), ("all",), "M, nle, g, J, dJ, centroidal terms and energies, in ``data``.", "None"),
    Face("computeKineticEnergy", (Q_, V_), ("kinetic",),
         "Kinetic energy [J], rotor inertia counted; by default at the last call.", "float", "v", made=_energy),
    Face("computePotentialEnergy", (Q_,), ("potential",),
         "Potential energy of gravity [J]; by default at the last call.", "float", "oMi", made=_energy),
    Face("computeMechanicalEnergy", (Q_, V_), ("mechanical",),
         "Kinetic plus potential energy [J]; by default at the last call.", "float", "v", made=mechanical_energy),
    Face("computeJointTorqueRegressor", (Q, V, A), ("torque_regressor",),
         "Y (nv, 10 (njoints - 1)): rnea is Y π and the armatures' torques.", made=columns),
    Face("computeStaticRegressor", (Q,), ("static_regressor",),
         "Y (3, 4 (njoints - 1)): the centre of mass is Y times masses and first moments.", made=columns),
    Face("computeKineticEnergyRegressor", (Q, V), ("kinetic_regressor",),
         "Y (10 (njoints - 1),): the energy is Y π and the armatures' energies.", made=columns),
    Face("computePotentialEnergyRegressor", (Q,), ("potential_regressor",),
         "Y (10 (njoints - 1),): the energy is Y π.", made=columns),
)  # fmt: skip

JACOBIANS = (
    Face("computeJointJacobians", (Q_,), ("jacobians",),
         "Jacobians of all joints in the world (6, nv); by default at the last call.", last="oMi"),
    Face("computeJointJacobiansTimeVariation", (Q, V), ("jacobians_dot",),
         "Time derivatives of all joints' Jacobians in the world (6, nv)."),
    _jacobian("getJointJacobian", (JOINT, REFERENCE), ("frame_jacobian",),
              "Jacobian (6, nv) of a joint, at the q of ``data.J``.", last="J"),
    _jacobian("getFrameJacobian", OPTIONAL, ("frame_jacobian",),
              "Jacobian (6, nv) of a frame of the model, or of one placed on a joint, at the q of ``data.J``.",
              last="J", overloads=LISTED),
    _jacobian("getJointJacobianTimeVariation", (JOINT, REFERENCE), ("frame_jacobian_dot",),
              "Time derivative (6, nv) of a joint's Jacobian, at the q, v of ``data.dJ``.", last="dJ"),
    _jacobian("getFrameJacobianTimeVariation", OPTIONAL, ("frame_jacobian_dot",),
              "Time derivative (6, nv) of a frame's Jacobian at the q, v of ``data.dJ``.", last="dJ", overloads=LISTED),
)  # fmt: skip

CENTROIDAL = (
    Face("centerOfMass", (Q_, V_, A_, SUBTREES, LEVEL), ("com0", "com1", "com2"),
         "Centre of mass of all moving bodies (3,), also ``data.com[0]``; vcom and acom likewise.\n\n"
         "A level in place of arrays takes so many inputs of the last forwardKinematics. ``data.com[k]`` is the\n"
         "centre of joint k's subtree, in its frame.", read=_of_com,
         overloads=((Q, SUBTREES), (Q, V, SUBTREES), (Q, V, A, SUBTREES), (LEVEL, SUBTREES))),
    Face("jacobianCenterOfMass", (Q_, SUBTREES), ("com_jacobian",),
         "Jacobian of the centre of mass (3, nv) in the world; by default at the last call.", read=_of_com_jacobian,
         overloads=((Q, SUBTREES), (SUBTREES,))),
    Face("ccrba", (Q, V), ("ccrba",), "Centroidal momentum matrix Ag (6, nv); the momentum is ``data.hg``."),
    Face("dccrba", (Q, V), ("dccrba",), "Time derivative of the centroidal momentum matrix (6, nv)."),
    Face("computeCentroidalMap", (Q,), ("map",), "Centroidal momentum matrix Ag (6, nv)."),
    Face("computeCentroidalMapTimeVariation", (Q, V), ("map_dot",),
         "Time derivative of the centroidal momentum matrix (6, nv)."),
    Face("computeCentroidalMomentum", (Q_, V_), ("momentum",),
         "Momentum about the centre of mass; by default at the last call.", "Force", "v", made=_force),
    Face("computeCentroidalMomentumTimeVariation", (Q_, V_, A_), ("momentum_dot",),
         "Rate of the momentum about the centre of mass; by default at the last call.", "Force", "a", made=_force),
)  # fmt: skip

OF_CALLS = (
    Face("computeRNEADerivatives", (Q, V, A, PUSHED), ("rnea_derivatives",),
         "∂tau/∂q, ∂tau/∂v and ∂tau/∂a = M, (nv, nv) each.", THREE),
    Face("computeABADerivatives", (Q_, V_, TAU_, PUSHED), ("aba_derivatives",),
         "∂ddq/∂q, ∂ddq/∂v and ∂ddq/∂tau = M⁻¹, (nv, nv) each; by default at the inputs of the last aba.\n\n"
         "Raises InertiaError naming a joint with zero articulated inertia.", THREE, read=_of_aba_derivatives,
         overloads=((Q, V, TAU, PUSHED), (PUSHED,))),
    Face("computeGeneralizedGravityDerivatives", (Q,), ("gravity_derivatives",),
         "∂g/∂q (nv, nv) of the gravity torques."),
    Face("computeStaticTorqueDerivatives", (Q, FEXT), ("static_derivatives",),
         "∂tau/∂q (nv, nv) of the static torques g(q) - Σ Jᵀ fext.", read=_with_forces),
    Face("computeCentroidalDynamicsDerivatives", (Q, V, A), ("centroidal_derivatives",),
         "∂h/∂q, ∂(dh/dt)/∂q, ∂(dh/dt)/∂v and ∂(dh/dt)/∂a = Ag, (6, nv) each, of the centroidal momentum h.", FOUR),
    Face("computeForwardKinematicsDerivatives", (Q, V, A_), ("kinematics_derivatives1", "kinematics_derivatives2"),
         "Record q, v and a for the derivatives of velocities and, with a, of accelerations.", "None"),
    _derivative("getJointVelocityDerivatives", (JOINT, REFERENCE), ("frame_velocity_derivatives",),
                "∂V/∂q and ∂V/∂v, (6, nv) each, of a joint's frame, after computeForwardKinematicsDerivatives.\n\n"
                "In LOCAL_WORLD_ALIGNED ∂V/∂q is, as in Pinocchio, that of the velocity at the frame's origin as a\n"
                "fixed point.", PAIR),
    _derivative("getJointAccelerationDerivatives", (JOINT, REFERENCE), ("frame_acceleration_derivatives",),
                "∂V/∂q, ∂A/∂q, ∂A/∂v and ∂A/∂a, (6, nv) each, of the spatial acceleration A of a joint's frame, after\n"
                "computeForwardKinematicsDerivatives with a; see getJointVelocityDerivatives.", FOUR, bound=False),
    _derivative("getFrameVelocityDerivatives", OPTIONAL, ("frame_velocity_derivatives",),
                "∂V/∂q and ∂V/∂v of a frame; see getJointVelocityDerivatives.", PAIR, overloads=LISTED),
    _derivative("getFrameAccelerationDerivatives", OPTIONAL, ("frame_acceleration_derivatives",),
                "∂V/∂q, ∂A/∂q, ∂A/∂v, ∂A/∂a of a frame; see getJointAccelerationDerivatives.", FOUR, bound=False,
                overloads=LISTED),
)  # fmt: skip

OF_MODELS = (
    Face("computeTotalMass", (OWN_DATA,), ("total_mass",),
         "Mass of all moving bodies [kg], also ``data.mass[0]``; bodies on the universe do not count.", "float",
         answer=total_mass, of_data=False),
    _configuration("neutral", (), ("neutral",), "Configuration (nq,) without displacement of any joint."),
    _configuration("integrate", (Q, V), ("integrate",),
                   "Configuration (nq,) reached from q by the displacement v: a velocity held for unit time.\n\n"
                   "Raises in strict mode ConfigurationError for a quaternion or (cos, sin) pair whose norm is not 1."),
    _configuration("difference", (Q1, Q2), ("difference",),
                   "Displacement v (nv,) with integrate(q1, v) = q2, by the shorter way round.\n\n"
                   "Outside strict mode joints with several coordinates have them clipped to ±1e30, so that products\n"
                   "stay finite."),
    _configuration("interpolate", (Q1, Q2, ALPHA), ("interpolate",),
                   "Configuration (nq,) at the fraction alpha of the way from q1 to q2."),
    _configuration("normalize", (Q,), ("normalize",),
                   "q (nq,) with its quaternions and (cos, sin) pairs at unit norm."),
    Face("isNormalized", (Q, PREC.otherwise(PRECISION)), ("normalized",),
         "Whether the norms of all quaternions and (cos, sin) pairs are within prec of 1.\n\n"
         "Raises SpatialDynError, a ValueError, for a prec below 0.", "bool", answer=is_normalized, of_data=False),
    Face("isSameConfiguration", (Q1, Q2, PREC), ("same_configuration",),
         "Whether two configurations agree to prec; a quaternion and its negative are one rotation.\n\n"
         "Quaternions and pairs off their unit norm agree if their numbers do, to prec of the smaller norm. Raises as\n"
         "``isNormalized``.", "bool", answer=is_same_configuration, of_data=False),
    Face("randomConfiguration", (LOWER, UPPER), ("random",),
         "A random configuration (nq,) between the bounds, by default the model's; rotations are uniform.\n\n"
         "A coordinate without a finite limit is drawn from an interval of width 2 (Pinocchio: not finite).",
         answer=random_configuration, of_data=False),
)  # fmt: skip

FACES = (*KINEMATICS, *DYNAMICS, *JACOBIANS, *CENTROIDAL, *OF_CALLS, *OF_MODELS)
