"""Identities checked where Pinocchio is no oracle."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InertiaError, NonFiniteError
from ..model.model import Model
from .calls import BY_LABEL, FORWARD, Call, ours_of
from .measures import BOUND, RAISED, raised, rounding, scaled_error, singular, times_vector
from .rows import Row, judged
from .states import States

Array = NDArray[np.float64]
Sides = Callable[[Model, States], tuple[Array, Array]]


def _call(label: str, model: Model, *inputs: Any) -> Array:
    """The public call's result."""
    return ours_of(BY_LABEL[label], model, inputs)


def _frame_accelerations(m: Model, s: States) -> Array:
    """J a + J̇ v, (samples, frames, references, 6)."""
    return times_vector(_call("frame_jacobian", m, s.q), s.a) + _call("jacobian_dot_times_v", m, s.q, s.v)


def _coriolis_forces(m: Model, s: States) -> Array:
    """Bias less gravity."""
    return _call("nonlinear_effects", m, s.q, s.v) - _call("generalized_gravity", m, s.q)


def _given_back(label: str, *fext: str) -> Sides:
    """Both sides of rnea(forward dynamics) = tau."""

    def sides(m: Model, s: States) -> tuple[Array, Array]:
        forces = [getattr(s, name) for name in fext]
        return _call("rnea", m, s.q, s.v, _call(label, m, s.q, s.v, s.tau, *forces), *forces), s.tau

    return sides


def _product(label: str, matrix: str) -> Sides:
    """A call of (q, v) = a matrix call of (q) times v."""
    return lambda m, s: (_call(label, m, s.q, s.v), times_vector(_call(matrix, m, s.q), s.v))


def _forward_derivatives(m: Model, s: States) -> tuple[Array, Array]:
    """M (∂a/∂q, ∂a/∂v, ∂a/∂tau) = (-∂tau/∂q, -∂tau/∂v, 1), the right side at that a."""
    by = _call("rnea_derivatives", m, s.q, s.v, _call("aba", m, s.q, s.v, s.tau))
    right = np.concatenate([-by[:, :2], np.broadcast_to(np.eye(m.nv), by[:, 2:].shape)], 1)
    return by[:, 2:] @ _call("aba_derivatives", m, s.q, s.v, s.tau), right


def _inertia_forces(m: Model, s: States) -> Array:
    """M a."""
    return times_vector(_call("crba", m, s.q), s.a)


# label -> the identity in words, and its two sides
IDENTITIES: dict[str, tuple[str, Sides]] = {
    "rnea": (
        "rnea = M a + bias",
        lambda m, s: (
            _call("rnea", m, s.q, s.v, s.a),
            times_vector(_call("crba", m, s.q), s.a) + _call("nonlinear_effects", m, s.q, s.v),
        ),
    ),
    "rnea (fext)": (
        "rnea - rnea without fext = static torque - gravity",
        lambda m, s: (
            _call("rnea", m, s.q, s.v, s.a, s.fext) - _call("rnea", m, s.q, s.v, s.a),
            _call("static_torque", m, s.q, s.fext) - _call("generalized_gravity", m, s.q),
        ),
    ),
    "crba": (
        "½ vᵀ M v = T",
        lambda m, s: (
            0.5 * np.einsum("si,si->s", s.v, times_vector(_call("crba", m, s.q), s.v)),
            _call("kinetic_energy", m, s.q, s.v),
        ),
    ),
    **{name: (f"rnea({name}) = tau", _given_back(name)) for name in FORWARD},
    "aba (fext)": ("rnea(aba) = tau", _given_back("aba", "fext")),
    "minverse": (
        "M Minv = 1",
        lambda m, s: (
            _call("crba", m, s.q) @ _call("minverse", m, s.q),
            np.broadcast_to(np.eye(m.nv), (len(s.q), m.nv, m.nv)),
        ),
    ),
    "nonlinear_effects": (
        "bias = rnea at a = 0",
        lambda m, s: (_call("nonlinear_effects", m, s.q, s.v), _call("rnea", m, s.q, s.v, 0.0 * s.a)),
    ),
    "generalized_gravity": (
        "g = rnea at v = a = 0",
        lambda m, s: (_call("generalized_gravity", m, s.q), _call("rnea", m, s.q, 0.0 * s.v, 0.0 * s.a)),
    ),
    "static_torque": (
        "static torque = rnea at v = a = 0",
        lambda m, s: (_call("static_torque", m, s.q, s.fext), _call("rnea", m, s.q, 0.0 * s.v, 0.0 * s.a, s.fext)),
    ),
    "coriolis_matrix": (
        "C v = bias - g",
        lambda m, s: (times_vector(_call("coriolis_matrix", m, s.q, s.v), s.v), _coriolis_forces(m, s)),
    ),
    "mass_matrix_dot": (
        "dM/dt = C + Cᵀ",
        lambda m, s: (
            _call("mass_matrix_dot", m, s.q, s.v),
            _call("coriolis_matrix", m, s.q, s.v) + _call("coriolis_matrix", m, s.q, s.v).transpose(0, 2, 1),
        ),
    ),
    "coriolis_transpose_times_velocity": (
        "Cᵀ v = dM/dt v - C v",
        lambda m, s: (
            _call("coriolis_transpose_times_velocity", m, s.q, s.v),
            times_vector(_call("mass_matrix_dot", m, s.q, s.v), s.v) - _coriolis_forces(m, s),
        ),
    ),
    "modified_rnea": (
        "modified rnea = M a_r + C v_r + g",
        lambda m, s: (
            _call("modified_rnea", m, s.q, s.v, s.d, s.a),
            times_vector(_call("crba", m, s.q), s.a)
            + times_vector(_call("coriolis_matrix", m, s.q, s.v), s.d)
            + _call("generalized_gravity", m, s.q),
        ),
    ),
    "christoffel_symbols": (
        "Γ v = C",
        lambda m, s: (
            times_vector(_call("christoffel_symbols", m, s.q), s.v),
            _call("coriolis_matrix", m, s.q, s.v),
        ),
    ),
    "mass_matrix_derivatives": (
        "dM/dq v = dM/dt",
        lambda m, s: (
            times_vector(_call("mass_matrix_derivatives", m, s.q), s.v),
            _call("mass_matrix_dot", m, s.q, s.v),
        ),
    ),
    "rnea_derivatives": (
        "M a = ∂tau/∂a a, 2 C v = ∂tau/∂v v, ∂tau/∂q - ∂g/∂q = ∂M/∂q a at v = 0",
        lambda m, s: (
            np.stack(
                [
                    times_vector(_call("rnea_derivatives", m, s.q, s.v, s.a)[:, 2], s.a),
                    times_vector(_call("rnea_derivatives", m, s.q, s.v, s.a)[:, 1], s.v),
                    times_vector(
                        _call("rnea_derivatives", m, s.q, 0.0 * s.v, s.a)[:, 0]
                        - _call("generalized_gravity_derivatives", m, s.q),
                        s.d,
                    ),
                ]
            ),
            np.stack(
                [
                    _inertia_forces(m, s),
                    2.0 * _coriolis_forces(m, s),
                    times_vector(times_vector(_call("mass_matrix_derivatives", m, s.q).swapaxes(2, 3), s.a), s.d),
                ]
            ),
        ),
    ),
    "rnea_derivatives (fext)": (
        "what fext adds = what it adds to the static torque's",
        lambda m, s: (
            _call("rnea_derivatives (fext)", m, s.q, s.v, s.a, s.fext)[:, 0]
            - _call("rnea_derivatives", m, s.q, s.v, s.a)[:, 0],
            _call("static_torque_derivatives", m, s.q, s.fext) - _call("generalized_gravity_derivatives", m, s.q),
        ),
    ),
    "aba_derivatives": ("M ∂a = -∂tau, and 1", _forward_derivatives),
    "generalized_gravity_derivatives": (
        "∂g/∂q = ∂tau/∂q at v = a = 0",
        lambda m, s: (
            _call("generalized_gravity_derivatives", m, s.q),
            _call("rnea_derivatives", m, s.q, 0.0 * s.v, 0.0 * s.a)[:, 0],
        ),
    ),
    "static_torque_derivatives": (
        "∂(static torque)/∂q = ∂tau/∂q at v = a = 0",
        lambda m, s: (
            _call("static_torque_derivatives", m, s.q, s.fext),
            _call("rnea_derivatives", m, s.q, 0.0 * s.v, 0.0 * s.a, s.fext)[:, 0],
        ),
    ),
    "center_of_mass_velocity_derivatives": (
        "m ∂vc = linear part of ∂h",
        lambda m, s: (
            m.total_mass * _call("center_of_mass_velocity_derivatives", m, s.q, s.v),
            _call("centroidal_dynamics_derivatives", m, s.q, s.v, s.a)[:, ::3, :3],
        ),
    ),
    "centroidal_dynamics_derivatives": (
        "∂(dh/dt)/∂v v = 2 dAg/dt v",
        lambda m, s: (
            times_vector(_call("centroidal_dynamics_derivatives", m, s.q, s.v, s.a)[:, 2], s.v),
            2.0 * times_vector(_call("centroidal_map_dot", m, s.q, s.v), s.v),
        ),
    ),
    "frame_velocity_derivatives": (
        "∂V/∂v = J",
        lambda m, s: (
            _call("frame_velocity_derivatives", m, s.q, s.v)[..., 1, :, :],
            _call("frame_jacobian", m, s.q)[:, :, :2],
        ),
    ),
    "frame_acceleration_derivatives": (
        "∂A/∂v v = 2 J̇ v, in local and world",
        lambda m, s: (
            times_vector(_call("frame_acceleration_derivatives", m, s.q, s.v, s.a)[:, :, :2, 1], s.v),
            2.0 * _call("jacobian_dot_times_v", m, s.q, s.v)[:, :, :2],
        ),
    ),
    "kinetic_energy": ("T = ½ vᵀ M v", lambda m, s: IDENTITIES["crba"][1](m, s)[::-1]),
    "center_of_mass_velocity": ("velocity = J v", _product("center_of_mass_velocity", "com_jacobian")),
    "center_of_mass_acceleration": (
        "m acceleration = d/dt of the momentum",
        lambda m, s: (
            m.total_mass * _call("center_of_mass_acceleration", m, s.q, s.v, s.a),
            (
                times_vector(_call("centroidal_map", m, s.q), s.a)
                + times_vector(_call("centroidal_map_dot", m, s.q, s.v), s.v)
            )[..., :3],
        ),
    ),
    "com_jacobian": (
        "m J = linear part of the centroidal map",
        lambda m, s: (m.total_mass * _call("com_jacobian", m, s.q), _call("centroidal_map", m, s.q)[..., :3, :]),
    ),
    "frame_velocity": ("velocity = J v", _product("frame_velocity", "frame_jacobian")),
    "frame_acceleration": (
        "acceleration = J a + J̇ v, in local and world",
        lambda m, s: (
            _call("frame_acceleration", m, s.q, s.v, s.a)[:, :, :2],
            _frame_accelerations(m, s)[:, :, :2],
        ),
    ),
    "frame_acceleration (classical)": (
        "acceleration = J a + J̇ v, in local_world_aligned",
        lambda m, s: (
            _call("frame_acceleration (classical)", m, s.q, s.v, s.a)[:, :, 2],
            _frame_accelerations(m, s)[:, :, 2],
        ),
    ),
    "centroidal_momentum": ("momentum = Ag v", _product("centroidal_momentum", "centroidal_map")),
    "integrate": (
        "difference(q, integrate(q, d)) = d",
        lambda m, s: (_call("difference", m, s.q, _call("integrate", m, s.q, s.d)), s.d),
    ),
    "difference": ("difference(q, integrate(q, d)) = d", lambda m, s: IDENTITIES["integrate"][1](m, s)),
    "interpolate": (
        "interpolate = integrate(q, t d)",
        lambda m, s: (
            _call("interpolate", m, s.q, s.q1, s.t),
            _call("integrate", m, s.q, s.t[:, None] * s.d),
        ),
    ),
    "operational_space_inertia_inverse": (
        "Λ⁻¹ = J M⁻¹ Jᵀ",
        lambda m, s: (
            _call("operational_space_inertia_inverse", m, s.q),
            (J := _call("frame_jacobian", m, s.q)) @ _call("minverse", m, s.q)[:, None, None] @ np.swapaxes(J, -1, -2),
        ),
    ),
    "modified_torque_regressor": (
        "that of rnea at v_r = v",
        lambda m, s: (
            _call("modified_torque_regressor", m, s.q, s.v, s.v, s.a),
            _call("joint_torque_regressor", m, s.q, s.v, s.a),
        ),
    ),
    "momentum_regressor": (
        "what accelerations v add to that of rnea at rest",
        lambda m, s: (
            _call("momentum_regressor", m, s.q, s.v),
            _call("joint_torque_regressor", m, s.q, 0.0 * s.v, s.v)
            - _call("joint_torque_regressor", m, s.q, 0.0 * s.v, 0.0 * s.v),
        ),
    ),
    "coriolis_transpose_regressor": (
        "dᵀ (Cᵀ v) = vᵀ (C d)",
        lambda m, s: (
            np.einsum("si,sijk->sjk", s.d, _call("coriolis_transpose_regressor", m, s.q, s.v)),
            np.einsum(
                "si,sijk->sjk",
                s.v,
                _call("modified_torque_regressor", m, s.q, s.v, s.d, 0.0 * s.a)
                - _call("modified_torque_regressor", m, s.q, s.v, 0.0 * s.d, 0.0 * s.a),
            ),
        ),
    ),
    "momentum": ("p = M v", _product("momentum", "crba")),
    "velocity_from_momentum": (
        "momentum(velocity) = p",
        lambda m, s: (_call("momentum", m, s.q, _call("velocity_from_momentum", m, s.q, s.tau)), s.tau),
    ),
    "hamiltonian": (
        "H = T + V",
        lambda m, s: (
            _call("hamiltonian", m, s.q, _call("momentum", m, s.q, s.v)),
            _call("kinetic_energy", m, s.q, s.v) + _call("potential_energy", m, s.q),
        ),
    ),
    "momentum_rate": (
        "rate = Cᵀ v + tau - gravity",
        lambda m, s: (
            _call("momentum_rate", m, s.q, s.v, s.tau),
            times_vector(np.swapaxes(_call("coriolis_matrix", m, s.q, s.v), -1, -2), s.v)
            + s.tau
            - _call("generalized_gravity", m, s.q),
        ),
    ),
    "momentum_rate (fext)": (
        "what fext adds = gravity - static torque",
        lambda m, s: (
            _call("momentum_rate", m, s.q, s.v, s.tau, s.fext) - _call("momentum_rate", m, s.q, s.v, s.tau),
            _call("generalized_gravity", m, s.q) - _call("static_torque", m, s.q, s.fext),
        ),
    ),
    "hamilton_field": (
        "v = M⁻¹ p and its momentum rate",
        lambda m, s: (
            _call("hamilton_field", m, s.q, s.tau, s.a),
            np.stack([v := _call("velocity_from_momentum", m, s.q, s.tau), _call("momentum_rate", m, s.q, v, s.a)], 1),
        ),
    ),
}


def by_identity(call: Call, model: Model, states: States, why: str, times: tuple[float, float] | None = None) -> Row:
    """The row of a call for which Pinocchio is no oracle: the error of an identity, if there is one."""
    if call.label not in IDENTITIES:
        return Row(call.label, None, BOUND, True, f"{why}; not compared")
    words, sides = IDENTITIES[call.label]
    try:
        left, right = sides(model, states)
    except (InertiaError, NonFiniteError) as refusal:
        if isinstance(refusal, InertiaError) and not call.peer and singular(_call("crba", model, states.q)):
            return Row(call.label, None, BOUND, True, f"{why}; InertiaError, as M is singular")
        return Row(call.label, float("inf"), BOUND, False, f"{why}; {words} instead: {refusal}")
    error = scaled_error(left, right, min(call.rank, left.ndim - 1))
    if call.name == "velocity_from_momentum" and error > BOUND:  # raised as aba's, see _residual
        M, v = _call("crba", model, states.q), _call(call.label, model, states.q, states.tau)
        rounded = max(map(rounding, M, v, right))
        return judged(call.label, error, raised(rounded), f"{why}; {words} instead; {RAISED}")
    if call.name == "operational_space_inertia_inverse" and error > BOUND:  # as of M⁻¹, which both sides are made of
        M, inverse = _call("crba", model, states.q), _call("minverse", model, states.q)
        rounded = max(rounding(A, X, np.eye(model.nv)) for A, X in zip(M, inverse, strict=True))
        return judged(call.label, error, raised(rounded), f"{why}; {words} instead; {RAISED}")
    return judged(call.label, error, BOUND, f"{why}; {words} instead", times)
