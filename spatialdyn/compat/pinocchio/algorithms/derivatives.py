"""Derivatives of torques, accelerations, motions and momenta under Pinocchio's names.

∂/∂q is along ``integrate(q, e_k)``. Results are tuples of new arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ....engines.programs.run.single_call import unavailable
from ....errors import SpatialDynError
from ...native import recorded_calls
from ..data.data import Data, library_of
from ..data.dispatch import (
    ALIGNED,
    IN_WORLD,
    REFERENCES,
    about_frame,
    fast_calls,
    frames_for,
    joint_index,
    last_call,
    named,
    reference_code,
)
from ..data.run import Run
from ..model.model import Model
from ..types.arguments import ArgumentError, Array, ValueRuntimeError, documented_rows, expected
from ..types.se3 import SE3
from .dynamics import given_forces
from .jacobians import call_about_frame

__all__ = [
    "computeABADerivatives", "computeCentroidalDynamicsDerivatives", "computeForwardKinematicsDerivatives",
    "computeGeneralizedGravityDerivatives", "computeRNEADerivatives", "computeStaticTorqueDerivatives",
    "getCenterOfMassVelocityDerivatives", "getCentroidalDynamicsDerivatives", "getFrameAccelerationDerivatives",
    "getFrameVelocityDerivatives", "getJointAccelerationDerivatives", "getJointVelocityDerivatives",
    "getPointClassicAccelerationDerivatives", "getPointVelocityDerivatives",
]  # fmt: skip


# --- torques and accelerations -----------------------------------------------------------------------------


def _last_aba(model: Model, data: Data, q: Any, v: Any, tau: Any, fext: Any) -> tuple[Any, ...]:
    """q, v, tau and fext of computeABADerivatives; q, v, tau of the last aba if they are left out.

    The fext of a call without them may stand in place of q.
    """
    if tau is not None:
        return q, v, tau, fext
    if v is not None or (q is not None and fext is not None):
        raise ArgumentError("computeABADerivatives got some of q, v and tau, expected all or none")
    library_of(model, data)
    run: Any = _last(data, "aba", "aba_world")
    if run is None:
        raise ArgumentError("q is not given and aba was not called with this data, expected either")
    fext = q if fext is None else fext
    if run.fext is not None and fext is None:
        raise ArgumentError("fext is not given and the last aba had some, expected them here too")
    return run.q.copy(), run.v.copy(), run.tau.copy(), fext


_CALLS = """
computeRNEADerivatives = rnea_derivatives; forces: fext=None
    ∂tau/∂q, ∂tau/∂v and ∂tau/∂a = M, (nv, nv) each, also ``data.dtau_dq``, ``data.dtau_dv`` and ``data.M``.

    q     (nq,)            joint positions
    v, a  (nv,)            joint velocities and accelerations
    fext  list of njoints  Force on each joint's body, fixed in the joint's frame

    Raises ArgumentError (a TypeError) for a wrong type, ShapeError (a ValueError) for a wrong size.
computeABADerivatives = aba_derivatives; forces: fext=None; optional: q, v, tau;
  slow: q, v, tau, fext = last_aba(model, data, q, v, tau, fext)
    ∂ddq/∂q, ∂ddq/∂v and ∂ddq/∂tau = M⁻¹, (nv, nv) each, also ``data.ddq_dq``, ``data.ddq_dv`` and ``data.Minv``.

    ``(model, data, q, v, tau[, fext])``, or ``(model, data[, fext])`` at the inputs of the last ``aba``.

    Raises as computeRNEADerivatives, and InertiaError naming a joint with zero articulated inertia.
computeGeneralizedGravityDerivatives = gravity_derivatives
    ∂g/∂q (nv, nv) of the gravity torques.
computeStaticTorqueDerivatives = static_derivatives; forces: fext; when: fext is not None; slow: given_forces(fext)
    ∂tau/∂q (nv, nv) of the static torques g(q) - Σ Jᵀ fext; fext as in computeRNEADerivatives.
computeCentroidalDynamicsDerivatives = centroidal_derivatives
    ∂h/∂q, ∂(dh/dt)/∂q, ∂(dh/dt)/∂v and ∂(dh/dt)/∂a = Ag, (6, nv) each, of the centroidal momentum h.
computeForwardKinematicsDerivatives = kinematics_derivatives1 kinematics_derivatives2; returns: None
    Record q, v and a for the derivatives of velocities and, with a, of accelerations below.
"""
(
    computeRNEADerivatives, computeABADerivatives, computeGeneralizedGravityDerivatives,
    computeStaticTorqueDerivatives, computeCentroidalDynamicsDerivatives, computeForwardKinematicsDerivatives,
) = fast_calls(_CALLS, last_aba=_last_aba, given_forces=given_forces)  # fmt: skip


def getCentroidalDynamicsDerivatives(model: Model, data: Data) -> tuple[Array, Array, Array, Array]:
    """``computeCentroidalDynamicsDerivatives`` at the inputs of the last computeRNEADerivatives."""
    library_of(model, data)
    run = _last(data, "rnea_derivatives", "centroidal_derivatives")
    if run is None:
        raise ValueRuntimeError("derivatives were not computed, expected computeRNEADerivatives to be called before")
    found: tuple[Array, Array, Array, Array] = computeCentroidalDynamicsDerivatives(
        model, data, run.q.copy(), run.v.copy(), run.a.copy()
    )
    return found


def getCenterOfMassVelocityDerivatives(model: Model, data: Data) -> Array:
    """∂vcom/∂q (3, nv) at the inputs of the last call that filled ``data.vcom``."""
    run = last_call(model, data, "vcom", before="centerOfMass with q and v")
    found = run.library.compute("center_of_mass_velocity_derivatives", run.q, run.v, at=run.state)
    return np.array(found[0])


def _last(data: Data, *kinds: str) -> Run | None:
    """The latest call of these kinds, if any."""
    runs: list[Run] = [run for kind in kinds if (run := data._runs.get(kind)) is not None and run.stamp]
    return max(runs, key=lambda run: run.stamp, default=None)


# --- frames ------------------------------------------------------------------------------------------------


def _kinematics(model: Model, data: Data, accelerations: bool = False) -> Run:
    """The last call whose inputs derivatives of frames take. Raises ValueRuntimeError if there was none."""
    library_of(model, data)
    kinds = ("kinematics_derivatives2", "rnea_derivatives", "centroidal_derivatives")
    run = _last(data, *kinds, *([] if accelerations else ["kinematics_derivatives1"]))
    if run is None:
        raise ValueRuntimeError(
            "derivatives were not computed, expected computeForwardKinematicsDerivatives"
            + (" with accelerations" if accelerations else "")
            + " to be called before"
        )
    return run


def _of_frame(name: str, run: Run, joint: int, placement: Array, reference: Any, *static: int) -> Array:
    """Derivatives of the motion of a frame on a joint; in LOCAL_WORLD_ALIGNED as Pinocchio defines them.

    There they are those in WORLD, translated to the frame's origin as a fixed point.
    """
    code = reference_code(reference)
    if code != ALIGNED:
        return call_about_frame(name, run, joint, placement, code, *static)
    found = call_about_frame(name, run, joint, placement, IN_WORLD, *static)
    x = call_about_frame("frame_placement", run, joint, placement)[:3, 3]
    found[:, :3] += np.cross(found[:, 3:], x, axisa=1, axisc=1)
    return found


def _bind_velocities(model: Model, run: Run, name: str, of_joints: bool, about: tuple[Any, ...]) -> None:
    """Bind the builtin of the derivatives of velocities of frames at the inputs of a run, for later calls."""
    library, (key, frames) = run.library, frames_for(model, name, of_joints, about)
    if key == name and library.has_builtins:
        words = {"q_address": run.q.ctypes.data, "v_address": run.v.ctypes.data, "time": run.stamp_words["time"]}
        words |= {**library.words, **REFERENCES, **frames.words(rows=True)}
        run.bound[name] = frames, recorded_calls.frame_velocity_derivatives.bind(words, library, run.memory, frames)


def _derivatives(name: str, doc: str) -> Callable[..., tuple[Array, ...]]:
    """Derivatives of the velocity of a frame or a joint's frame, and of its spatial acceleration."""
    of_joints, accelerations = "Frame" not in name, "Acceleration" in name

    def function(model: Model, data: Data, *given: Any, **named: Any) -> tuple[Array, ...]:
        run = _kinematics(model, data, accelerations)
        frames, call = (None, unavailable) if accelerations or named else run.bound.get(name, (None, unavailable))
        if frames is not None and frames is (run.library.frames if of_joints else model._frame_placements):
            found = call(*given)
            if found is not None:
                return tuple(found)
        about = about_frame(model, of_joints, *given, **named)
        velocities = _of_frame("frame_velocity_derivatives", run, *about)
        if not accelerations:
            if frames is None and not named:
                _bind_velocities(model, run, name, of_joints, given)
            return tuple(velocities)
        return velocities[0], *_of_frame("frame_acceleration_derivatives", run, *about, 0)

    return named(function, name, doc)


(
    getJointVelocityDerivatives, getJointAccelerationDerivatives, getFrameVelocityDerivatives,
    getFrameAccelerationDerivatives,
) = (_derivatives(*row) for row in documented_rows("""
getJointVelocityDerivatives
    ∂V/∂q and ∂V/∂v, (6, nv) each, of a joint's frame, ``(model, data, joint_id, reference_frame)``; needs
    computeForwardKinematicsDerivatives.

    In LOCAL_WORLD_ALIGNED ∂V/∂q is, as in Pinocchio, that of the velocity at the frame's origin as a fixed point.
getJointAccelerationDerivatives
    ∂V/∂q, ∂A/∂q, ∂A/∂v and ∂A/∂a, (6, nv) each, of the spatial acceleration A of a joint's frame.

    It needs computeForwardKinematicsDerivatives with a; see getJointVelocityDerivatives.
getFrameVelocityDerivatives
    ∂V/∂q and ∂V/∂v of a frame: ``(model, data, frame_id, reference_frame)`` or ``(model, data, joint_id, placement,
    reference_frame)``; see getJointVelocityDerivatives.
getFrameAccelerationDerivatives
    ∂V/∂q, ∂A/∂q, ∂A/∂v and ∂A/∂a of a frame, arguments as of getFrameVelocityDerivatives.
"""))  # fmt: skip


def getPointVelocityDerivatives(
    model: Model, data: Data, joint_id: int, placement: Any, reference_frame: Any
) -> tuple[Array, Array]:
    """∂v/∂q and ∂v/∂v, (3, nv) each, of the velocity of a point fixed to a joint; LOCAL or LOCAL_WORLD_ALIGNED."""
    about = _point(model, joint_id, placement, reference_frame)
    by_q, J = call_about_frame("frame_velocity_derivatives", _kinematics(model, data), *about)
    return by_q[:3].copy(), J[:3].copy()


def getPointClassicAccelerationDerivatives(
    model: Model, data: Data, joint_id: int, placement: Any, reference_frame: Any
) -> tuple[Array, Array, Array, Array]:
    """∂v/∂q, ∂a/∂q, ∂a/∂v and ∂a/∂a, (3, nv) each, of the acceleration a of a point fixed to a joint."""
    by_q, _ = getPointVelocityDerivatives(model, data, joint_id, placement, reference_frame)
    about = _point(model, joint_id, placement, reference_frame)
    classical = call_about_frame("frame_acceleration_derivatives", _kinematics(model, data, True), *about, 1)
    return by_q, classical[0, :3].copy(), classical[1, :3].copy(), classical[2, :3].copy()


def _point(model: Model, joint_id: Any, placement: Any, reference_frame: Any) -> tuple[int, Array, int]:
    """Joint, placement and reference code of a point."""
    joint, place = joint_index(model, joint_id), expected(placement, SE3, "placement")._x
    code = reference_code(reference_frame)
    if code == IN_WORLD:
        raise SpatialDynError("reference frame is WORLD, expected LOCAL or LOCAL_WORLD_ALIGNED")
    return joint, place, code
