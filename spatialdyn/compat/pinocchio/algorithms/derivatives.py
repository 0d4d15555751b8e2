"""Derivatives of torques, accelerations, motions and momenta under Pinocchio's names.

∂/∂q is along ``integrate(q, e_k)``. Results are tuples of new arrays.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ....errors import SpatialDynError
from ...native import recorded_kinematics
from ..data.data import Data, library_of
from ..data.dispatch import (
    ALIGNED,
    IN_WORLD,
    about_frame,
    compute,
    joint_index,
    last_call,
    reference_code,
)
from ..data.face import Face
from ..data.field_recipes import CALL_KINDS
from ..data.run import Run
from ..model.model import Model
from ..types.arguments import Array, ValueRuntimeError, expected
from ..types.se3 import SE3
from .jacobians import bind_getter, call_about_frame

__all__ = [
    "getCenterOfMassVelocityDerivatives", "getCentroidalDynamicsDerivatives", "getPointClassicAccelerationDerivatives",
    "getPointVelocityDerivatives",
]  # fmt: skip


def getCentroidalDynamicsDerivatives(model: Model, data: Data) -> tuple[Array, Array, Array, Array]:
    """``computeCentroidalDynamicsDerivatives`` at the inputs of the last computeRNEADerivatives."""
    library_of(model, data)
    run = last_of(data, "rnea_derivatives", "centroidal_derivatives")
    if run is None:
        raise ValueRuntimeError("derivatives were not computed, expected computeRNEADerivatives to be called before")
    return compute(model, data, "centroidal_derivatives", (run.q.copy(), run.v.copy(), run.a.copy()))[1]  # type: ignore[no-any-return]


def getCenterOfMassVelocityDerivatives(model: Model, data: Data) -> Array:
    """∂vcom/∂q (3, nv) at the inputs of the last call that filled ``data.vcom``."""
    run = last_call(model, data, "vcom", before="centerOfMass with q and v")
    found = run.library.compute("center_of_mass_velocity_derivatives", run.q, run.v, at=run.state)
    return np.array(found[0])


def last_of(data: Data, *kinds: str) -> Run | None:
    """The latest call of these kinds, if any."""
    runs: list[Run] = [run for kind in kinds if (run := data._runs.get(kind)) is not None and run.stamp]
    return max(runs, key=lambda run: run.stamp, default=None)


# --- frames ------------------------------------------------------------------------------------------------


def _kinematics(model: Model, data: Data, accelerations: bool = False) -> Run:
    """The last call whose inputs derivatives of frames take. Raises ValueRuntimeError if there was none."""
    library_of(model, data)
    kinds = [x for x, kind in CALL_KINDS.items() if kind.derivatives and ("a" in kind.fills or not accelerations)]
    run = last_of(data, *kinds)
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


def derivatives_of_frame(face: Face, model: Model, data: Data, *about: Any) -> tuple[Array, ...]:
    """Derivatives of the velocity of a frame or a joint's frame, and of its spatial acceleration."""
    accelerations = "Acceleration" in face.name
    run = _kinematics(model, data, accelerations)
    joint, place, reference = about_frame(model, face.of_joints, *about)
    velocities = _of_frame("frame_velocity_derivatives", run, joint, place, reference)
    if accelerations:
        return velocities[0], *_of_frame("frame_acceleration_derivatives", run, joint, place, reference, 0)
    if reference_code(reference) != ALIGNED:
        bind_getter(recorded_kinematics.frame_velocity_derivatives, run, face, model, data, about)
    return tuple(velocities)


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
