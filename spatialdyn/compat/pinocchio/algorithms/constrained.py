"""Dynamics under constraints J a + γ = 0, and impacts.

Constraints that depend on each other leave their forces open; where Pinocchio then answers with rounding errors, an
error names the rank. A damping μ makes J a + γ = -μ λ of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....constraints.contact import Solved, inverse
from ....constraints.contact import solve as solved
from ....errors import ConstraintError, ShapeError
from ...native import recorded_constraints
from ..data.data import prepared
from ..data.dispatch import vector
from ..data.last_call import Run
from ..types.arguments import NUMBERS, ArgumentError, described, number
from ..types.frame import Convention
from .dynamics import computeAllTerms, crba

Array = NDArray[np.float64]
CONSTRAINED, IMPACT, BORDERED = "constrained", "impact", "bordered"


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
    found = None if named else _quickly(CONSTRAINED, model, data, arguments)
    if found is not None:
        return found
    names = ("q", "v", "tau", "constraint_jacobian", "constraint_drift", "damping")
    compiled = prepared(model, data)
    given = _given("forwardDynamics", names, 2, 1, arguments, named)
    tau = vector("tau", given["tau"], model.nv)
    J = _jacobian(given["constraint_jacobian"], model.nv)
    gamma = vector("constraint_drift", given["constraint_drift"], len(J))
    mu = _damping(given.get("damping", 0.0))
    if "q" in given:
        computeAllTerms(model, data, given["q"], given["v"])
    f = solved(compiled.model, data.array("M"), tau - data.array("nle"), J, gamma, mu)
    run = _note(CONSTRAINED, model, data, f, f.x)
    if compiled.whole and "q" in given:
        every = data._runs["all"]
        words = {"bias": every.result.ctypes.data, **_words(every, run, f)}
        call = recorded_constraints.dynamics().bind(compiled.model, every, run, f, **words)
        data._bound[CONSTRAINED] = compiled, every, run, call
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
    found = None if named else _quickly(IMPACT, model, data, arguments)
    if found is not None:
        return found
    names = ("q", "v_before", "constraint_jacobian", "restitution_coefficient", "damping")
    compiled = prepared(model, data)
    given = _given("impulseDynamics", names, 1, 2, arguments, named)
    v = vector("v_before", given["v_before"], model.nv)
    J = _jacobian(given["constraint_jacobian"], model.nv)
    e = number(given.get("restitution_coefficient", 0.0), "restitution_coefficient")
    if not 0.0 <= e <= 1.0:
        raise ConstraintError(f"restitution_coefficient is {e}, expected 0 to 1")
    mu = _damping(given.get("damping", 0.0))
    if "q" in given:
        crba(model, data, given["q"], Convention.WORLD)
    f = solved(compiled.model, data.array("M"), np.zeros(model.nv), J, (1.0 + e) * (J @ v), mu)
    after: Array = v + f.x
    run = _note(IMPACT, model, data, f, after)
    if compiled.whole and "q" in given:
        masses = data._runs["crba_world"]
        words = {"M": masses.result.ctypes.data, **_words(masses, run, f)}
        data._bound[IMPACT] = (
            compiled,
            masses,
            run,
            recorded_constraints.impact().bind(compiled.model, masses, run, f, **words),
        )
    return after


def computeKKTContactDynamicMatrixInverse(
    model: Any, data: Any, q: Any, constraint_jacobian: Any, damping: float = 0.0
) -> Array:
    """Inverse (nv + m, nv + m) of [M Jᵀ; J -μ 1].

    Raises as forwardDynamics
    """
    found = _quickly(BORDERED, model, data, (q, constraint_jacobian, damping))
    if found is not None:
        return found
    compiled = prepared(model, data)
    J = _jacobian(constraint_jacobian, model.nv)
    mu = _damping(damping)
    crba(model, data, q, Convention.WORLD)
    f = solved(compiled.model, data.array("M"), np.zeros(model.nv), J, np.zeros(len(J)), mu)
    run = _note(BORDERED, model, data, f, np.empty(0))
    if compiled.whole:
        masses, size = data._runs["crba_world"], model.nv + len(J)
        words = {"M": masses.result.ctypes.data, "rows": size, "columns": size, **_words(masses, run, f)}
        del words["result"]
        call = recorded_constraints.inverse().bind(compiled.model, masses, run, f, **words)
        data._bound[BORDERED] = compiled, masses, run, call
    return inverse(compiled.model, f)


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
    return inverse(prepared(model, data).model, f)


def _quickly(kind: str, model: Any, data: Any, arguments: tuple[Any, ...]) -> Array | None:
    """The answer by a builtin, noted; None if it has to be found otherwise."""
    try:
        compiled, before, run, call = data._bound[kind]
        if compiled is not model._made:
            return None
        found: Array | None = call(*arguments)
    except (AttributeError, KeyError, SystemError):  # whatever is not as simple as that
        return None
    if found is not None:
        data.redo(before)
        data.redo(run)
        data.__dict__["_contact"] = run.contact
    return found


def _note(kind: str, model: Any, data: Any, f: Solved, result: Array) -> Run:
    """Note how a system was solved, as that of a call of a kind."""
    run: Run = data.run_of(kind, model, prepared(model, data), result.shape)
    run.result[...], run.contact = result, f
    data.ran(run)
    data.__dict__["_contact"] = f
    return run


def _words(before: Run, run: Run, f: Solved) -> dict[str, int]:
    """What the plans of builtins have in common: where to note what they were given and what they find."""
    places = {"memory": before.memory, "result": run.result, "L": f.L, "Y": f.Y, "C": f.C, "force": f.force}
    return {"m": len(f.C), **run.made.words, **{name: x.ctypes.data for name, x in places.items()}}


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
