"""Dynamics under Pinocchio's names: torques, accelerations, M, C, g, energies.

Every function takes the model, its data and arrays; results are new arrays and fields of the data. In regressors π are
toDynamicParameters of the inertias after the universe's, one after the other; columns of all joints lie side by side.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ....errors import ModelError
from ....recursions.tree.regressor import body_force
from ...native import recorded_calls, tree_kernels
from ...native.operator_kernels import on_motions
from ...native.recorded_calls import clock
from ..data.data import Data, library_of
from ..data.dispatch import IDENTITY, fast_calls, frame_index, joint_index, reference_code
from ..data.field_recipes import columns, mechanical_energy
from ..model.library_model import library_model
from ..model.model import Model
from ..types.arguments import ArgumentError, Array, described, expected
from ..types.frame import Convention
from ..types.motion import Motion
from ..types.se3 import SE3

__all__ = [
    "aba", "bodyRegressor", "computeAllTerms", "computeCoriolisMatrix", "computeFrameKinematicRegressor",
    "computeGeneralizedGravity", "computeJointKinematicRegressor", "computeJointTorqueRegressor",
    "computeKineticEnergy", "computeKineticEnergyRegressor", "computeMechanicalEnergy", "computeMinverse",
    "computePotentialEnergy", "computePotentialEnergyRegressor", "computeStaticRegressor", "computeStaticTorque",
    "crba", "frameBodyRegressor", "getCoriolisMatrix", "jointBodyRegressor", "nle", "nonLinearEffects", "rnea",
]  # fmt: skip


def _kind(kind: str, convention: Any) -> str:
    """The kind of call of a convention. Raises ArgumentError for what is none."""
    if not isinstance(convention, Convention):
        raise ArgumentError(f"convention is {described(convention)}, expected a Convention")
    return kind if convention == Convention.LOCAL else f"{kind}_world"


def _aba_kind(fext: Any, convention: Any) -> tuple[str, Any]:
    """Kind and forces of ``aba``, whose convention may stand in place of the forces."""
    return (_kind("aba", fext), None) if isinstance(fext, Convention) else (_kind("aba", convention), fext)


def given_forces(fext: Any) -> None:
    """Raise ArgumentError if forces that have to be given are None."""
    if fext is None:
        raise ArgumentError("fext is None, expected a list of Force")


_CALLS = """
rnea = rnea; forces: fext=None
    Torques τ = M(q) a + C(q, v) v + g(q) - Σ Jᵀ fext (nv,), also ``data.tau``.

    q     (nq,)            joint positions
    v, a  (nv,)            joint velocities and accelerations
    fext  list of njoints  Force on each joint's body, in the joint's frame; the universe's is ignored

    Raises ArgumentError (a TypeError) for a wrong type, ShapeError (a ValueError) for a wrong size.
aba = aba; forces: fext=None; options: convention=LOCAL; when: convention is LOCAL;
  slow: kind, fext = aba_kind(fext, convention)
    Accelerations (nv,) under torques tau (nv,) and external forces, also ``data.ddq``.

    ``aba(model, data, q, v, tau[, fext][, convention])``, fext as in rnea. The convention only selects which fields of
    data are filled.

    Raises as rnea, and InertiaError naming a joint with zero articulated inertia, where Pinocchio returns nan.
crba = crba; options: convention=LOCAL; when: convention is LOCAL; slow: kind = by_convention(kind, convention)
    Mass matrix M(q) (nv, nv), both triangles filled, also ``data.M``; the convention selects the other fields.
nonLinearEffects = nle
    Bias torques C(q, v) v + g(q) (nv,), also ``data.nle``.
computeGeneralizedGravity = gravity
    Gravity torques g(q) (nv,), also ``data.g``.
computeStaticTorque = static; forces: fext; when: fext is not None; slow: given_forces(fext)
    Torques g(q) - Σ Jᵀ fext (nv,) that hold the robot still, also ``data.tau``; fext as in rnea.
computeCoriolisMatrix = coriolis
    Coriolis matrix C(q, v) (nv, nv) of the Christoffel symbols, also ``data.C``.
computeMinverse = minverse; last: ddq
    Inverse of the mass matrix (nv, nv), also ``data.Minv``; without q that of the last ``aba``.

    Raises InertiaError naming a joint with zero articulated inertia, where Pinocchio returns inf.
computeAllTerms = all; returns: None
    Fill ``data`` with M, nle, g, J, dJ, centroidal terms and energies; each is computed at its first read.
computeKineticEnergy = kinetic; returns: run.result.item(); last: v
    Kinetic energy [J], rotor inertia counted, also ``data.kinetic_energy``; without q, v at the last call's.
computePotentialEnergy = potential; returns: run.result.item(); last: oMi
    Potential energy of gravity [J], also ``data.potential_energy``; without q at the last call's.
computeMechanicalEnergy = mechanical; returns: mechanical_energy(run); last: v
    Kinetic plus potential energy [J], all three also in ``data``; without q, v at the last call's.
computeJointTorqueRegressor = torque_regressor; returns: columns(run)
    Y (nv, 10 (njoints - 1)), also ``data.jointTorqueRegressor``: rnea is Y π and the armatures' torques.
computeStaticRegressor = static_regressor; returns: columns(run)
    Y (3, 4 (njoints - 1)), also ``data.staticRegressor``: the centre of mass is Y times masses and first moments.
computeKineticEnergyRegressor = kinetic_regressor; returns: columns(run)
    Y (10 (njoints - 1),), also ``data.kineticEnergyRegressor``: the energy is Y π and the armatures' energies.
computePotentialEnergyRegressor = potential_regressor; returns: columns(run)
    Y (10 (njoints - 1),), also ``data.potentialEnergyRegressor``: the energy is Y π.
"""
(
    rnea, aba, crba, nonLinearEffects, computeGeneralizedGravity, computeStaticTorque, computeCoriolisMatrix,
    computeMinverse, computeAllTerms, computeKineticEnergy, computePotentialEnergy, computeMechanicalEnergy,
    computeJointTorqueRegressor, computeStaticRegressor, computeKineticEnergyRegressor, computePotentialEnergyRegressor,
) = fast_calls(
    _CALLS, LOCAL=Convention.LOCAL, by_convention=_kind, aba_kind=_aba_kind, given_forces=given_forces, columns=columns,
    mechanical_energy=mechanical_energy,
)  # fmt: skip
nle = nonLinearEffects


def getCoriolisMatrix(model: Model, data: Data) -> Array:
    """Coriolis matrix (nv, nv) at the q, v of the last call that filled ``data.dJ``, such as computeCoriolisMatrix."""
    library_of(model, data)
    run = data.latest("dJ", of_call=True)
    if run is None:
        return np.array(data.array("C"))
    found: Array = run.library.compute("coriolis_matrix", run.q, run.v, at=run.state)
    data.put("C", found)
    return found


# --- regressors ------------------------------------------------------------------------------------------


def bodyRegressor(velocity: Motion, acceleration: Motion) -> Array:
    """Y (6, 10), linear first: I a + v ×* I v is Y times toDynamicParameters of I."""
    v, a = expected(velocity, Motion, "velocity"), expected(acceleration, Motion, "acceleration")
    out = np.empty((6, 10))
    _body_force(v._x, a._x, out)
    return out


_body_force = on_motions(body_force)


def jointBodyRegressor(model: Model, data: Data, joint_id: int) -> Array:
    """Y (6, 10) of the body of a joint, from data.v and data.a_gf of rnea. Raises ModelError for no such joint."""
    try:
        library, time, arrays, call = data._bound["body regressor"]
        if library is model._library and time == clock.now[0] and (found := call(joint_id)) is not None:
            return found  # type: ignore[no-any-return]
    except (AttributeError, KeyError):  # the fast path does not apply
        arrays = {}
    library, at = library_of(model, data), _index("joint_id", joint_id, model.njoints)
    made = bodyRegressor(*_motions_of(data, at))
    if library.has_builtins:
        if not arrays:
            arrays = {x: data._held.get(x, np.empty((model.njoints, 6))) for x in ("v", "a_gf")}
            words = {"velocities": arrays["v"].ctypes.data, "accelerations": arrays["a_gf"].ctypes.data}
            call = recorded_calls.joint_body_regressor.bind({"njoints": model.njoints, **words}, *arrays.values())
        for name, x in arrays.items():
            x[...] = data.array(name)
        data._bound["body regressor"] = library, clock.now[0], arrays, call
    return made


def frameBodyRegressor(model: Model, data: Data, frame_id: int) -> Array:
    """Y (6, 10) of a body on a frame, in the frame, from data.v and data.a_gf. Raises ModelError for no such frame."""
    library_of(model, data)
    frame = model.frames[_index("frame_id", frame_id, model.nframes)]
    joint, placement = frame.parentJoint, frame.placement
    return bodyRegressor(*map(placement.actInv, _motions_of(data, joint)))


def _motions_of(data: Data, joint: int) -> Iterator[Motion]:
    """Its v and a_gf; read as ``data.a_gf`` they would be recomputed at each call of rnea from then on."""
    return (Motion.over(data.array(name)[joint]) for name in ("v", "a_gf"))


def computeJointKinematicRegressor(
    model: Model, data: Data, joint_id: int, reference_frame: Any, placement: SE3 | None = None
) -> Array:
    """Y (6, 6 (njoints - 1)), from ``data.oMi``: what a joint's frame, or one placed on the joint, moves by where the
    placements of joints move, each by a motion in its own frame. Raises ModelError for the universe.
    """
    library_of(model, data)
    at = joint_index(model, joint_id)
    place = IDENTITY if placement is None else expected(placement, SE3, "placement")._x
    return _kinematic_regressor(model, data, ("joint_id", at), at, place, reference_frame)


def computeFrameKinematicRegressor(model: Model, data: Data, frame_id: int, reference_frame: Any) -> Array:
    """``computeJointKinematicRegressor`` of a frame of the model."""
    library_of(model, data)
    at = frame_index(model, frame_id)
    frame = model.frames[at]
    return _kinematic_regressor(model, data, ("frame_id", at), frame.parentJoint, frame.placement._x, reference_frame)


def _kinematic_regressor(
    model: Model, data: Data, given: tuple[str, int], at: int, place: Array, reference_frame: Any
) -> Array:
    name, index = given
    if index == 0:
        raise ModelError(f"{name} is 0, the universe, which no joint moves, expected another")
    code, found, library = reference_code(reference_frame), np.zeros((6, 6 * (model.njoints - 1))), library_model(model)
    places = library.numbers.placements, library.parents, at, place
    tree_kernels.kinematic_regressor(data.array("oMi"), *places, code, found)
    return found


def _index(name: str, value: Any, n: int) -> int:
    if not 0 <= value < n:
        raise ModelError(f"{name} is {value}, expected 0 to {n - 1}")
    return int(value)
