"""Regressors under Pinocchio's names: the library's, with the columns of all joints side by side.

π are toDynamicParameters of the inertias after the universe's, one after the other.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....algebra import spatial
from ....algebra.euclidean import Vec
from ....errors import ModelError
from ....recursions.regressor import body_force
from ..data.data import Data, library_of
from ..data.dispatch import compute
from ..data.field_recipes import columns
from ..model.model import Model
from ..types.arguments import expected
from ..types.motion import Motion

__all__ = [
    "bodyRegressor", "computeJointTorqueRegressor", "computeKineticEnergyRegressor",
    "computePotentialEnergyRegressor", "computeStaticRegressor", "frameBodyRegressor", "jointBodyRegressor",
]  # fmt: skip

Array = NDArray[np.float64]


def computeJointTorqueRegressor(model: Model, data: Data, q: Any, v: Any, a: Any) -> Array:
    """Y (nv, 10 (njoints - 1)), also ``data.jointTorqueRegressor``: rnea is Y π and the armatures' torques."""
    return columns(compute(model, data, "torque_regressor", q, v, a))


def computeStaticRegressor(model: Model, data: Data, q: Any) -> Array:
    """Y (3, 4 (njoints - 1)), also ``data.staticRegressor``: the centre of mass is Y times masses and first moments."""
    return columns(compute(model, data, "static_regressor", q))


def computeKineticEnergyRegressor(model: Model, data: Data, q: Any, v: Any) -> Array:
    """Y (10 (njoints - 1),), also ``data.kineticEnergyRegressor``: the energy is Y π and the armatures' energies."""
    return columns(compute(model, data, "kinetic_regressor", q, v))


def computePotentialEnergyRegressor(model: Model, data: Data, q: Any) -> Array:
    """Y (10 (njoints - 1),), also ``data.potentialEnergyRegressor``: the energy is Y π."""
    return columns(compute(model, data, "potential_regressor", q))


def bodyRegressor(velocity: Motion, acceleration: Motion) -> Array:
    """Y (6, 10), linear first: I a + v ×* I v is Y times toDynamicParameters of I."""
    v, a = expected(velocity, Motion, "velocity"), expected(acceleration, Motion, "acceleration")
    out = np.empty((6, 10))
    body_force(_motion(v), _motion(a), out)
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


def _index(name: str, value: Any, n: int) -> int:
    if not 0 <= value < n:
        raise ModelError(f"{name} is {value}, expected 0 to {n - 1}")
    return int(value)


def _motion(m: Motion) -> spatial.Motion:
    x, y, z, wx, wy, wz = m.vector.tolist()
    return spatial.Motion(Vec(wx, wy, wz), Vec(x, y, z))
