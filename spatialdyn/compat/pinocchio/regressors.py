"""Regressors: what the library gives by joint, as Pinocchio's matrices of all joints' parameters side by side.

π are toDynamicParameters of the inertias behind the universe's, one after the other.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import dynamics as library
from ... import spatial
from ...errors import ModelError
from ...recursions.regressor import body_force
from .arguments import expected
from .data import prepared
from .model import Model
from .motion import Motion
from .sizes import vector

Array = NDArray[np.float64]


def computeJointTorqueRegressor(model: Model, data: Any, q: Any, v: Any, a: Any) -> Array:
    """Y (nv, 10 (njoints - 1)), also to ``data``: rnea is Y π and the armatures' torques."""
    return _by_body("jointTorqueRegressor", "joint_torque_regressor", model, data, q=q, v=v, a=a)


def computeStaticRegressor(model: Model, data: Any, q: Any) -> Array:
    """Y (3, 4 (njoints - 1)), also to ``data``: the centre of mass is Y times all masses and first moments."""
    return _by_body("staticRegressor", "static_regressor", model, data, q=q)


def computeKineticEnergyRegressor(model: Model, data: Any, q: Any, v: Any) -> Array:
    """Y (10 (njoints - 1),), also to ``data``: the kinetic energy is Y π and the armatures' energies."""
    return _by_body("kineticEnergyRegressor", "kinetic_energy_regressor", model, data, q=q, v=v)


def computePotentialEnergyRegressor(model: Model, data: Any, q: Any) -> Array:
    """Y (10 (njoints - 1),), also to ``data``: the potential energy is Y π."""
    return _by_body("potentialEnergyRegressor", "potential_energy_regressor", model, data, q=q)


def bodyRegressor(velocity: Motion, acceleration: Motion) -> Array:
    """Y (6, 10), linear first: I a + v ×* I v is Y times toDynamicParameters of I."""
    v, a = expected(velocity, Motion, "velocity"), expected(acceleration, Motion, "acceleration")
    out = np.empty((6, 10))
    body_force(_motion(v), _motion(a), out)
    return out


def jointBodyRegressor(model: Model, data: Any, joint_id: int) -> Array:
    """Y (6, 10) of the body of a joint, by data.v and data.a_gf that rnea has left. Raises ModelError for no joint."""
    prepared(model, data)
    at = _index("joint_id", joint_id, model.njoints)
    return bodyRegressor(data.v[at], data.a_gf[at])


def frameBodyRegressor(model: Model, data: Any, frame_id: int) -> Array:
    """Y (6, 10) of a body on a frame, in its coordinates, by what rnea has left. Raises ModelError for no frame."""
    prepared(model, data)
    frame = model.frames[_index("frame_id", frame_id, model.nframes)]
    joint, placement = frame.parentJoint, frame.placement
    return bodyRegressor(placement.actInv(data.v[joint]), placement.actInv(data.a_gf[joint]))


def _by_body(field: str, call: str, model: Model, data: Any, **given: Any) -> Array:
    """What a call of the library gives, the columns of the joints below the universe side by side."""
    made = prepared(model, data)
    values = [vector(name, x, model.nq if name == "q" else model.nv) for name, x in given.items()]
    Y: Array = library.calls[call](made.model, *values)
    kept = Y[..., 1:, :] if made.joints is None else Y[..., made.joints[1:], :]
    found = np.ascontiguousarray(kept.reshape((*Y.shape[:-2], -1)))
    data.put(field, found)
    return found


def _index(name: str, value: Any, n: int) -> int:
    if not 0 <= value < n:
        raise ModelError(f"{name} is {value}, expected 0 to {n - 1}")
    return int(value)


def _motion(m: Motion) -> spatial.Motion:
    x, y, z, wx, wy, wz = m.vector.tolist()
    return spatial.Motion(spatial.Vec(wx, wy, wz), spatial.Vec(x, y, z))
