"""Dynamics under constraints J a + γ = 0, and impacts, under Pinocchio's names.

Dependent constraints leave their forces undetermined: an error names the rank, where Pinocchio returns rounding errors.
A damping μ makes J a + γ = -μ λ of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ....constraints.contact import Solved, inverse
from ....constraints.contact import solve as solved
from ....engines.compiled.cpython import Builtin
from ....errors import ConstraintError, ShapeError
from ...native import recorded_constraints
from ..data.data import Data, library_of
from ..data.dispatch import vector
from ..data.last_call import Run
from ..model.model import Model
from ..types.arguments import NUMBERS, ArgumentError, Array, described, number
from ..types.frame import Convention
from .dynamics import computeAllTerms, crba
from .rigid_constraints import impulse_of_contacts

__all__ = [
    "computeKKTContactDynamicMatrixInverse", "forwardDynamics", "getKKTContactDynamicMatrixInverse",
    "impulseDynamics",
]  # fmt: skip

CONSTRAINED, IMPACT, BORDERED = "constrained", "impact", "bordered"


def forwardDynamics(model: Model, data: Data, *arguments: Any, **named: Any) -> Array:
    """Accelerations a (nv,) under constraints: M a + b = τ + Jᵀ λ and J a + γ = 0; λ (m,) goes to data.lambda_c.

    q, v                 (nq,), (nv,); optional, both, after computeAllTerms at them
    tau                  (nv,)
    constraint_jacobian  J (m, nv)
    constraint_drift     γ (m,), J̇ v for constraints on accelerations
    damping              μ, J a + γ = -μ λ; 0 by default

    Raises ConstraintError naming the rank of constraints that are not independent, if there is no damping; ShapeError,
    InertiaError for a singular M
    """
    found = None if named else _fast_call(CONSTRAINED, model, data, arguments)
    if found is not None:
        return found
    names = ("q", "v", "tau", "constraint_jacobian", "constraint_drift", "damping")
    library = library_of(model, data)
    given = _arguments("forwardDynamics", names, 2, 1, arguments, named)
    tau = vector("tau", given["tau"], model.nv)
    J = _jacobian(given["constraint_jacobian"], model.nv)
    gamma = vector("constraint_drift", given["constraint_drift"], len(J))
    mu = _damping(given.get("damping", 0.0))
    if "q" in given:
        computeAllTerms(model, data, given["q"], given["v"])
    f = solved(library.model, data.array("M"), tau - data.array("nle"), J, gamma, mu)
    run = _record(CONSTRAINED, model, data, f, f.x)
    if "q" in given:
        every = data._runs["all"]
        _bind(CONSTRAINED, recorded_constraints.dynamics, data, every, run, bias=every.result.ctypes.data)
    return f.x


def impulseDynamics(model: Model, data: Data, *arguments: Any, **named: Any) -> Array:
    """Velocities (nv,) after an impact: M (v⁺ - v⁻) = Jᵀ Λ and J v⁺ = -e J v⁻; Λ (m,) goes to data.impulse_c.

    q                        (nq,); optional after crba at it
    v_before                 (nv,)
    constraint_jacobian      J (m, nv)
    restitution_coefficient  e, from 0 (default) to 1
    damping                  μ, J v⁺ + e J v⁻ = -μ Λ; 0 by default

    ``(model, data, q, v, contact_models, contact_datas[, r_coeff[, prox_settings]])`` takes contacts, as
    constraintDynamics does. Raises as forwardDynamics, and ConstraintError for an e outside 0 to 1
    """
    if "contact_models" in named or (len(arguments) > 2 and isinstance(arguments[2], list)):
        return impulse_of_contacts(model, data, *arguments, **named)
    found = None if named else _fast_call(IMPACT, model, data, arguments)
    if found is not None:
        return found
    names = ("q", "v_before", "constraint_jacobian", "restitution_coefficient", "damping")
    library = library_of(model, data)
    given = _arguments("impulseDynamics", names, 1, 2, arguments, named)
    v = vector("v_before", given["v_before"], model.nv)
    J = _jacobian(given["constraint_jacobian"], model.nv)
    e = number(given.get("restitution_coefficient", 0.0), "restitution_coefficient")
    if not 0.0 <= e <= 1.0:
        raise ConstraintError(f"restitution_coefficient is {e}, expected 0 to 1")
    mu = _damping(given.get("damping", 0.0))
    if "q" in given:
        crba(model, data, given["q"], Convention.WORLD)
    f = solved(library.model, data.array("M"), np.zeros(model.nv), J, (1.0 + e) * (J @ v), mu)
    after: Array = v + f.x
    run = _record(IMPACT, model, data, f, after)
    if "q" in given:
        masses = data._runs["crba_world"]
        _bind(IMPACT, recorded_constraints.impact, data, masses, run, M=masses.result.ctypes.data)
    return after


def computeKKTContactDynamicMatrixInverse(
    model: Model, data: Data, q: Any, constraint_jacobian: Any, damping: float = 0.0
) -> Array:
    """Inverse (nv + m, nv + m) of [M Jᵀ; J -μ 1].

    Raises as forwardDynamics
    """
    found = _fast_call(BORDERED, model, data, (q, constraint_jacobian, damping))
    if found is not None:
        return found
    library = library_of(model, data)
    J = _jacobian(constraint_jacobian, model.nv)
    mu = _damping(damping)
    crba(model, data, q, Convention.WORLD)
    f = solved(library.model, data.array("M"), np.zeros(model.nv), J, np.zeros(len(J)), mu)
    run = _record(BORDERED, model, data, f, np.empty(0))
    masses, size = data._runs["crba_world"], model.nv + len(J)
    words = {"M": masses.result.ctypes.data, "rows": size, "columns": size}
    _bind(BORDERED, recorded_constraints.inverse, data, masses, run, **words)
    return inverse(library.model, f)


def getKKTContactDynamicMatrixInverse(model: Model, data: Data, constraint_jacobian: Any) -> Array:
    """Inverse (nv + m, nv + m) with M and μ of the last forwardDynamics or impulseDynamics, for its Jacobian.

    Raises ConstraintError if neither was called with that many constraints
    """
    library_of(model, data)
    J = _jacobian(constraint_jacobian, model.nv)
    f: Solved | None = data.__dict__.get("_contact")
    if f is None or len(f.Y) != len(J):
        raise ConstraintError(
            f"data holds no contact of {len(J)} rows, expected forwardDynamics or impulseDynamics to be called before"
        )
    return inverse(library_of(model, data).model, f)


def _fast_call(kind: str, model: Model, data: Data, arguments: tuple[Any, ...]) -> Array | None:
    """The result by a builtin that records it; returns None if not applicable."""
    try:
        library, before, run, call = data._bound[kind]
        if library is not model._library:
            return None
        found: Array | None = call(*arguments)
    except (AttributeError, KeyError, SystemError):  # the fast path does not apply
        return None
    if found is not None:
        data.note_builtin_call(before)
        data.note_builtin_call(run)
        data.__dict__["_contact"] = run.contact
    return found


def _record(kind: str, model: Model, data: Data, f: Solved, result: Array) -> Run:
    """Record a solved system and its result as the call of a kind."""
    run: Run = data.run_of(kind, model, library_of(model, data), result.shape)
    run.result[...], run.contact = result, f
    data.note_call(run)
    data.__dict__["_contact"] = f
    return run


def _bind(kind: str, builtin: Callable[[], Builtin], data: Data, before: Run, run: Run, **words: int) -> None:
    """Bind a builtin to the inputs of the call before, and to the result and factors of this kind, for later calls."""
    library, f = run.library, run.contact
    if not library.has_builtins:
        return
    places = {"memory": before.memory, "result": run.result, "L": f.L, "Y": f.Y, "C": f.C, "force": f.force}
    words |= {"m": len(f.C), **library.words, **{name: x.ctypes.data for name, x in places.items()}}
    made = builtin()
    call = made.bind(library, before, run, f, **{name: words[name] for name in made.words})
    data._bound[kind] = library, before, run, call


def _arguments(
    name: str, names: tuple[str, ...], first: int, last: int, arguments: tuple[Any, ...], named: dict[str, Any]
) -> dict[str, Any]:
    """Arguments by name: all, or all but the ``first`` names; the ``last`` ones, numbers, are optional.

    Raises ArgumentError if they fit neither
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
