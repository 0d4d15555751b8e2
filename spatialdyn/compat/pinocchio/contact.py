"""Dynamics under constraints J a + γ = 0, and impacts.

Constraints that depend on each other leave their forces open; where Pinocchio then answers with rounding errors, an
error names the rank. A damping μ makes J a + γ = -μ λ of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...constraints.contact import Solved
from ...constraints.contact import solve as solved
from ...errors import ConstraintError, ShapeError
from .arguments import NUMBERS, ArgumentError, described, number
from .calls import vector
from .cholesky import half_inverse, stored
from .data import prepared
from .dynamics import computeAllTerms, crba
from .frame import Convention

Array = NDArray[np.float64]


def forwardDynamics(model: Any, data: Any, *arguments: Any, **named: Any) -> Array:
    """Accelerations a (nv,) under constraints: M a + b = τ + Jᵀ λ and J a + γ = 0; λ (m,) goes to data.lambda_c.

    q, v                 (nq,), (nv,); both left out if computeAllTerms has been called for them
    tau                  (nv,)
    constraint_jacobian  J (m, nv)
    constraint_drift     γ (m,), J̇ v for constraints on accelerations
    damping              μ, J a + γ = -μ λ; 0 by default

    Raises ConstraintError naming the rank of constraints that are not independent, if there is no damping; ShapeError,
    InertiaError for a singular M
    """
    names = ("q", "v", "tau", "constraint_jacobian", "constraint_drift", "damping")
    prepared(model, data)
    given = _given("forwardDynamics", names, 2, 1, arguments, named)
    tau = vector("tau", given["tau"], model.nv)
    J = _jacobian(given["constraint_jacobian"], model.nv)
    gamma = vector("constraint_drift", given["constraint_drift"], len(J))
    mu = _damping(given.get("damping", 0.0))
    if "q" in given:
        computeAllTerms(model, data, given["q"], given["v"])
    f = _solve(model, data, J, tau - data.array("nle"), gamma, mu)
    data.put("ddq", f.x)
    data.put("lambda_c", f.force)
    return f.x


def impulseDynamics(model: Any, data: Any, *arguments: Any, **named: Any) -> Array:
    """Velocities (nv,) behind an impact: M (v⁺ - v⁻) = Jᵀ Λ and J v⁺ = -e J v⁻; Λ (m,) goes to data.impulse_c.

    q                        (nq,); left out if crba has been called for it
    v_before                 (nv,)
    constraint_jacobian      J (m, nv)
    restitution_coefficient  e, from 0 (default) to 1
    damping                  μ, J v⁺ + e J v⁻ = -μ Λ; 0 by default

    Raises as forwardDynamics, and ConstraintError for an e that is not from 0 to 1
    """
    names = ("q", "v_before", "constraint_jacobian", "restitution_coefficient", "damping")
    prepared(model, data)
    given = _given("impulseDynamics", names, 1, 2, arguments, named)
    v = vector("v_before", given["v_before"], model.nv)
    J = _jacobian(given["constraint_jacobian"], model.nv)
    e = number(given.get("restitution_coefficient", 0.0), "restitution_coefficient")
    if not 0.0 <= e <= 1.0:
        raise ConstraintError(f"restitution_coefficient is {e}, expected 0 to 1")
    mu = _damping(given.get("damping", 0.0))
    if "q" in given:
        crba(model, data, given["q"], Convention.WORLD)
    f = _solve(model, data, J, np.zeros(model.nv), (1.0 + e) * (J @ v), mu)
    after: Array = v + f.x
    data.put("dq_after", after)
    data.put("impulse_c", f.force)
    return after


def computeKKTContactDynamicMatrixInverse(
    model: Any, data: Any, q: Any, constraint_jacobian: Any, damping: float = 0.0
) -> Array:
    """Inverse (nv + m, nv + m) of [M Jᵀ; J -μ 1].

    Raises as forwardDynamics
    """
    prepared(model, data)
    J = _jacobian(constraint_jacobian, model.nv)
    mu = _damping(damping)
    crba(model, data, q, Convention.WORLD)
    return _inverse(_solve(model, data, J, np.zeros(model.nv), np.zeros(len(J)), mu))


def getKKTContactDynamicMatrixInverse(model: Any, data: Any, constraint_jacobian: Any) -> Array:
    """The same with M and μ of the last forwardDynamics or impulseDynamics, for the Jacobian given there.

    Raises ConstraintError if neither has been called, or not with so many constraints
    """
    prepared(model, data)
    J = _jacobian(constraint_jacobian, model.nv)
    f: Solved | None = data.__dict__.get("_contact")
    if f is None or len(f.Y) != len(J):
        raise ConstraintError(
            f"data holds no contact of {len(J)} rows, expected forwardDynamics or impulseDynamics to be called before"
        )
    return _inverse(f)


def _solve(model: Any, data: Any, J: Array, r: Array, gamma: Array, mu: float) -> Solved:
    """M x = r + Jᵀ λ, J x + γ = -μ λ with data.M, kept in ``data``."""
    found = solved(prepared(model, data).model, data.array("M"), r, J, gamma, mu)
    stored(data, np.tril(found.L))
    data._contact = found
    return found


def _inverse(f: Solved) -> Array:
    """[M⁻¹ - HᵀH, HᵀC⁻¹; C⁻ᵀH, -C⁻ᵀC⁻¹] with H = C⁻¹ J M⁻¹, written so that it is symmetric to the bit."""
    m, n = f.Y.shape
    G = half_inverse(f.L)
    Ci = np.linalg.inv(np.tril(f.C))
    H = Ci @ (f.Y / np.sqrt(f.L.diagonal())) @ G
    out = np.empty((n + m, n + m))
    out[:n, :n] = G.T @ G - H.T @ H
    out[n:, :n] = Ci.T @ H
    out[:n, n:] = out[n:, :n].T
    out[n:, n:] = -Ci.T @ Ci
    return out


def _given(
    name: str, names: tuple[str, ...], first: int, last: int, arguments: tuple[Any, ...], named: dict[str, Any]
) -> dict[str, Any]:
    """Arguments by name, in the longest form that fits: without the ``first`` names, and any of the ``last`` numbers.

    Raises ArgumentError if none fits
    """
    for order in (names, names[first:]):
        given = {**named, **dict(zip(order, arguments, strict=False))}
        needed = set(order[: len(order) - last])
        if (
            len(given) == len(arguments) + len(named)
            and needed <= set(given) <= set(order)
            and all((np.ndim(x) == 0) == (key in names[-last:]) for key, x in given.items())
        ):
            return given
    kinds = ", ".join([*map(described, arguments), *(f"{key}={described(x)}" for key, x in named.items())])
    raise ArgumentError(
        f"{name} got ({kinds}), expected ({', '.join(names)}), with or without {', '.join(names[:first])}"
    )


def _jacobian(value: Any, columns: int) -> Array:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in NUMBERS:
        raise ArgumentError(f"constraint_jacobian is {described(value)}, expected an array of numbers")
    if value.ndim != 2 or value.shape[1] != columns:
        raise ShapeError(f"constraint_jacobian has shape {value.shape}, expected (m, {columns})")
    return np.asarray(value, np.float64)


def _damping(value: Any) -> float:
    mu = number(value, "damping")
    if not mu >= 0.0:
        raise ConstraintError(f"damping is {mu}, expected 0 or more")
    return mu
