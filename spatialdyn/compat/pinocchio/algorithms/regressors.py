"""Regressors under Pinocchio's names: the library's, with the columns of all joints side by side.

π are toDynamicParameters of the inertias after the universe's, one after the other.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ....algebra.public_arrays import read_motion
from ....errors import ModelError
from ....recursions.regressor import body_force
from ....recursions.spec import LOCAL_WORLD_ALIGNED as ALIGNED
from ....recursions.spec import WORLD as IN_WORLD
from ..data.data import Data, library_of
from ..data.dispatch import fast_calls
from ..data.field_recipes import columns
from ..data.frame_arguments import frame_index, joint_index, reference_code
from ..model.model import Model
from ..types.arguments import Array, expected
from ..types.motion import Motion
from ..types.se3 import SE3

__all__ = [
    "bodyRegressor", "computeFrameKinematicRegressor", "computeJointKinematicRegressor", "computeJointTorqueRegressor",
    "computeKineticEnergyRegressor", "computePotentialEnergyRegressor", "computeStaticRegressor",
    "frameBodyRegressor", "jointBodyRegressor",
]  # fmt: skip


_CALLS = """
computeJointTorqueRegressor = torque_regressor; returns: columns(run)
    Y (nv, 10 (njoints - 1)), also ``data.jointTorqueRegressor``: rnea is Y π and the armatures' torques.
computeStaticRegressor = static_regressor; returns: columns(run)
    Y (3, 4 (njoints - 1)), also ``data.staticRegressor``: the centre of mass is Y times masses and first moments.
computeKineticEnergyRegressor = kinetic_regressor; returns: columns(run)
    Y (10 (njoints - 1),), also ``data.kineticEnergyRegressor``: the energy is Y π and the armatures' energies.
computePotentialEnergyRegressor = potential_regressor; returns: columns(run)
    Y (10 (njoints - 1),), also ``data.potentialEnergyRegressor``: the energy is Y π.
"""
computeJointTorqueRegressor, computeStaticRegressor, computeKineticEnergyRegressor, computePotentialEnergyRegressor = (
    fast_calls(_CALLS, columns=columns)
)


def bodyRegressor(velocity: Motion, acceleration: Motion) -> Array:
    """Y (6, 10), linear first: I a + v ×* I v is Y times toDynamicParameters of I."""
    v, a = expected(velocity, Motion, "velocity"), expected(acceleration, Motion, "acceleration")
    out = np.empty((6, 10))
    body_force(read_motion(v.vector.tolist()), read_motion(a.vector.tolist()), out)
    return out


def jointBodyRegressor(model: Model, data: Data, joint_id: int) -> Array:
    """Y (6, 10) of the body of a joint, from data.v and data.a_gf of rnea. Raises ModelError for no such joint."""
    library_of(model, data)
    at = _index("joint_id", joint_id, model.njoints)
    return bodyRegressor(data.v[at], data.a_gf[at])


def frameBodyRegressor(model: Model, data: Data, frame_id: int) -> Array:
    """Y (6, 10) of a body on a frame, in the frame, from data.v and data.a_gf. Raises ModelError for no such frame."""
    library_of(model, data)
    frame = model.frames[_index("frame_id", frame_id, model.nframes)]
    joint, placement = frame.parentJoint, frame.placement
    return bodyRegressor(placement.actInv(data.v[joint]), placement.actInv(data.a_gf[joint]))


def computeJointKinematicRegressor(
    model: Model, data: Data, joint_id: int, reference_frame: Any, placement: SE3 | None = None
) -> Array:
    """Y (6, 6 (njoints - 1)), from ``data.oMi``: what a joint's frame, or one placed on the joint, moves by where the
    placements of joints move, each by a motion in its own frame.
    """
    library_of(model, data)
    at, code = joint_index(model, joint_id), reference_code(reference_frame)
    here = data.oMi[at] if placement is None else data.oMi[at] * expected(placement, SE3, "placement")
    found = np.zeros((6, 6 * (model.njoints - 1)))
    turn = SE3(here.rotation, np.zeros(3)) if code == ALIGNED else SE3.Identity()
    for k in list(model.supports[at])[1:]:
        X = data.oMi[model.parents[k]] * model.jointPlacements[k]
        X = X if code == IN_WORLD else turn * here.actInv(X)
        found[:, 6 * (k - 1) : 6 * k] = X.action
    return found


def computeFrameKinematicRegressor(model: Model, data: Data, frame_id: int, reference_frame: Any) -> Array:
    """``computeJointKinematicRegressor`` of a frame of the model."""
    library_of(model, data)
    frame = model.frames[frame_index(model, frame_id)]
    return computeJointKinematicRegressor(model, data, frame.parentJoint, reference_frame, frame.placement)


def _index(name: str, value: Any, n: int) -> int:
    if not 0 <= value < n:
        raise ModelError(f"{name} is {value}, expected 0 to {n - 1}")
    return int(value)
