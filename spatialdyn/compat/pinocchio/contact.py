"""Dynamics under constraints J v̇ + γ = 0, and impacts: M a + b = τ + Jᵀ λ, solved through Y = C⁻¹ Jᵀ with M = C Cᵀ.

J M⁻¹ Jᵀ = YᵀY is factored densely: it has a row per constraint. Constraints that depend on each other leave λ open;
where Pinocchio then answers with rounding errors, an error names the rank. A damping μ makes J a + γ = -μ λ of them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import ShapeError, SpatialDynError
from .arguments import NUMBERS, ArgumentError, described, number
from .calls import vector
from .cholesky import factor
from .data import prepared
from .dynamics import computeAllTerms, crba
from .frame import Convention

Array = NDArray[np.float64]


class ContactError(SpatialDynError):
    """Constraints that do not determine their forces, or numbers that no contact has."""


class Factored(NamedTuple):
    """M = C Cᵀ (nv, nv), Y = C⁻¹ Jᵀ (nv, m), S = YᵀY + μ 1 (m, m)."""

    C: Array
    Y: Array
    S: Array


def forwardDynamics(model: Any, data: Any, *arguments: Any, **named: Any) -> Array:
    """Accelerations a (nv,) under constraints: M a + b = τ + Jᵀ λ and J a + γ = 0; λ (m,) goes to data.lambda_c.

    q, v                 (nq,), (nv,); both left out if computeAllTerms has been called for them
    tau                  (nv,)
    constraint_jacobian  J (m, nv)
    constraint_drift     γ (m,), J̇ v for constraints on accelerations
    damping              μ, J a + γ = -μ λ; 0 by default

    Raises ContactError naming the rank of constraints that are not independent, if there is no damping; ShapeError,
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
    f = _factored(model, data, J, mu)
    free = np.linalg.solve(f.C, tau - data.array("nle"))
    force = -np.linalg.solve(f.S, f.Y.T @ free + gamma)
    a: Array = np.linalg.solve(f.C.T, free + f.Y @ force)
    data.put("ddq", a)
    data.put("lambda_c", force)
    return a


def impulseDynamics(model: Any, data: Any, *arguments: Any, **named: Any) -> Array:
    """Velocities (nv,) behind an impact: M (v⁺ - v⁻) = Jᵀ Λ and J v⁺ = -e J v⁻; Λ (m,) goes to data.impulse_c.

    q                        (nq,); left out if crba has been called for it
    v_before                 (nv,)
    constraint_jacobian      J (m, nv)
    restitution_coefficient  e, from 0 (default) to 1
    damping                  μ, J v⁺ + e J v⁻ = -μ Λ; 0 by default

    Raises as forwardDynamics, and ContactError for an e that is not from 0 to 1
    """
    names = ("q", "v_before", "constraint_jacobian", "restitution_coefficient", "damping")
    prepared(model, data)
    given = _given("impulseDynamics", names, 1, 2, arguments, named)
    v = vector("v_before", given["v_before"], model.nv)
    J = _jacobian(given["constraint_jacobian"], model.nv)
    e = number(given.get("restitution_coefficient", 0.0), "restitution_coefficient")
    if not 0.0 <= e <= 1.0:
        raise ContactError(f"restitution_coefficient is {e}, expected 0 to 1")
    mu = _damping(given.get("damping", 0.0))
    if "q" in given:
        crba(model, data, given["q"], Convention.WORLD)
    f = _factored(model, data, J, mu)
    impulse = -np.linalg.solve(f.S, (1.0 + e) * (J @ v))
    after: Array = v + np.linalg.solve(f.C.T, f.Y @ impulse)
    data.put("dq_after", after)
    data.put("impulse_c", impulse)
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
    return _inverse(_factored(model, data, J, mu))


def getKKTContactDynamicMatrixInverse(model: Any, data: Any, constraint_jacobian: Any) -> Array:
    """The same with M and μ of the last forwardDynamics or impulseDynamics, for the Jacobian given there.

    Raises ContactError if neither has been called, or not with so many constraints
    """
    prepared(model, data)
    J = _jacobian(constraint_jacobian, model.nv)
    f: Factored | None = data.__dict__.get("_contact")
    if f is None or f.S.shape != (len(J), len(J)):
        raise ContactError(
            f"data holds no contact of {len(J)} rows, expected forwardDynamics or impulseDynamics to be called before"
        )
    return _inverse(f)


def _factored(model: Any, data: Any, J: Array, mu: float) -> Factored:
    """What data.M, J and μ make, kept in ``data``. Raises ContactError if S is singular to rounding."""
    C = factor(model, data.array("M"))
    Y = np.linalg.solve(C, J.T)
    S = Y.T @ Y + mu * np.eye(len(J))
    scale = np.sqrt(S.diagonal())
    good = scale > 0.0
    unit = S[np.ix_(good, good)] / np.outer(scale[good], scale[good])  # units of rows do not matter
    rank = int((np.linalg.eigvalsh(unit) > len(J) * np.finfo(float).eps * len(unit)).sum())
    if rank < len(J):
        raise ContactError(
            f"constraint_jacobian has rank {rank}, expected its {len(J)} rows to be independent, or a larger damping"
        )
    data._contact = found = Factored(C, Y, S)
    return found


def _inverse(f: Factored) -> Array:
    """[M⁻¹ - W S⁻¹ Wᵀ, W S⁻¹; S⁻¹ Wᵀ, -S⁻¹] with W = M⁻¹ Jᵀ, written with what is symmetric of it."""
    n, m = f.Y.shape
    Li = np.linalg.inv(np.linalg.cholesky(f.S))
    Ci = np.linalg.inv(f.C)
    half = Li @ f.Y.T @ Ci  # (m, n): halfᵀ half = W S⁻¹ Wᵀ
    out = np.empty((n + m, n + m))
    out[:n, :n] = Ci.T @ Ci - half.T @ half
    out[n:, :n] = Li.T @ half
    out[:n, n:] = out[n:, :n].T
    out[n:, n:] = -Li.T @ Li
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
        raise ContactError(f"damping is {mu}, expected 0 or more")
    return mu
