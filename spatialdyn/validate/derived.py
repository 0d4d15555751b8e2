"""Results that Pinocchio has no call for, or in another shape, from its calls: functions of (pin, model, data, ...)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def coriolis_matrix_by_pin(pin: Any, model: Any, data: Any, q: Array, v: Array) -> Array:
    """C (nv, nv), for nv = 1 too."""
    return np.array(pin.computeCoriolisMatrix(model, data, q, v), float).reshape(model.nv, model.nv)


def mass_matrix_dot_by_pin(pin: Any, model: Any, data: Any, q: Array, v: Array) -> Array:
    """C + Cᵀ."""
    C = coriolis_matrix_by_pin(pin, model, data, q, v)
    return C + C.T


def coriolis_transpose_by_pin(pin: Any, model: Any, data: Any, q: Array, v: Array) -> Array:
    """Cᵀ v."""
    C = coriolis_matrix_by_pin(pin, model, data, q, v)
    return C.T @ v


def modified_rnea_by_pin(pin: Any, model: Any, data: Any, q: Array, v: Array, v_r: Array, a_r: Array) -> Array:
    """M a_r + g, and C v_r."""
    at_rest = np.array(pin.rnea(model, data, q, np.zeros(model.nv), a_r), float).reshape(model.nv)
    C = coriolis_matrix_by_pin(pin, model, data, q, v)
    return np.asarray(at_rest + C @ v_r)


def christoffel_symbols_by_pin(pin: Any, model: Any, data: Any, q: Array) -> Array:
    """Γ from C at unit velocities, as C is linear in v."""
    symbols = np.zeros((model.nv, model.nv, model.nv))
    for k, e in enumerate(np.eye(model.nv)):
        symbols[:, :, k] = coriolis_matrix_by_pin(pin, model, data, q, e)
    return symbols


def mass_matrix_derivatives_by_pin(pin: Any, model: Any, data: Any, q: Array) -> Array:
    """Γ_ijk + Γ_jik."""
    symbols = christoffel_symbols_by_pin(pin, model, data, q)
    return symbols + symbols.transpose(1, 0, 2)


def inertial_parameters_by_pin(pin: Any, model: Any, data: Any) -> Array:
    """Of each joint's inertia; 0 for the world."""
    return np.array([np.zeros(10), *(inertia.toDynamicParameters() for inertia in list(model.inertias)[1:])])


def joint_torque_regressor_by_pin(pin: Any, model: Any, data: Any, q: Array, v: Array, a: Array) -> Array:
    """Columns by joint, those of the world 0."""
    return _by_joint(model, 10, pin.computeJointTorqueRegressor(model, data, q, v, a))


def kinetic_energy_regressor_by_pin(pin: Any, model: Any, data: Any, q: Array, v: Array) -> Array:
    """Entries by joint, those of the world 0."""
    return _by_joint(model, 10, pin.computeKineticEnergyRegressor(model, data, q, v))


def potential_energy_regressor_by_pin(pin: Any, model: Any, data: Any, q: Array) -> Array:
    """Entries by joint, those of the world 0."""
    return _by_joint(model, 10, pin.computePotentialEnergyRegressor(model, data, q))


def static_regressor_by_pin(pin: Any, model: Any, data: Any, q: Array) -> Array:
    """Columns by joint, those of the world 0."""
    return _by_joint(model, 4, pin.computeStaticRegressor(model, data, q))


def _by_joint(model: Any, parameters: int, found: Any) -> Array:
    """Regressors (..., n parameters) of the joints below the world as (..., njoints, parameters)."""
    found = np.array(found, float)
    rows = found.shape[:-1] if found.shape[-1:] == (parameters * (model.njoints - 1),) else (found.shape[0],)
    parts = found.reshape((*rows, model.njoints - 1, parameters))
    return np.concatenate([np.zeros((*rows, 1, parameters)), parts], axis=-2)


def center_of_mass_velocity_derivatives_by_pin(pin: Any, model: Any, data: Any, q: Array, v: Array) -> Array:
    """∂vc/∂q and the Jacobian ∂vc/∂v."""
    pin.computeAllTerms(model, data, q, v)
    by_q = np.array(pin.getCenterOfMassVelocityDerivatives(model, data), float).reshape(3, model.nv)
    return np.stack([by_q, np.array(pin.jacobianCenterOfMass(model, data, q), float).reshape(3, model.nv)])


def of_masses(data: Any, found: Any) -> Array:
    """Vectors (n, 3) of the subtrees, zero instead of nan for those without mass."""
    masses = np.array(data.mass)[:, None]
    return np.where(masses > 0.0, np.array([np.ravel(x) for x in found]), 0.0)


def but_first(forces: Any) -> Array:
    """Forces (n, 6), zero for the world, where Pinocchio leaves another call's result."""
    found = np.array([force.vector for force in forces])
    found[0] = 0.0
    return found
