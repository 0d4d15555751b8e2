"""Dynamics under constraints J a + γ = 0, and impacts, under Pinocchio's names.

Dependent constraints leave their forces undetermined: an error names the rank, where Pinocchio returns rounding errors.
A damping μ makes J a + γ = -μ λ of them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ....constraints.contact import Solved, inverse
from ....constraints.contact import solve as solved
from ....engines.programs.run.routine import Routine
from ....errors import ConstraintError, ShapeError
from ...native import recorded_constraints
from ...native.recorded_calls import record
from ..data.data import Data, library_of
from ..data.dispatch import vector
from ..data.run import Run
from ..model.model import Model
from ..types.arguments import NUMBERS, ArgumentError, Array, described, number
from ..types.frame import Convention
from .calls import computeAllTerms, crba
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
    given = _arguments("forwardDynamics", names, 2, 1, model, data, arguments, named)
    if "q" in given:
        computeAllTerms(model, data, given["q"], given["v"])
    r, J = given["tau"] - data.array("nle"), given["constraint_jacobian"]
    f = _solve(CONSTRAINED, model, data, r, J, given["constraint_drift"], given["damping"], "q" in given)
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
    given = _arguments("impulseDynamics", names, 1, 2, model, data, arguments, named)
    v, J, e = (given[name] for name in names[1:4])
    if not 0.0 <= e <= 1.0:
        raise ConstraintError(f"restitution_coefficient is {e}, expected 0 to 1")
    if "q" in given:
        crba(model, data, given["q"], Convention.WORLD)
    gamma = (1.0 + e) * (J @ v)
    f = _solve(IMPACT, model, data, np.zeros(model.nv), J, gamma, given["damping"], "q" in given, v)
    return np.asarray(v + f.x)


def computeKKTContactDynamicMatrixInverse(
    model: Model, data: Data, q: Any, constraint_jacobian: Any, damping: float = 0.0
) -> Array:
    """Inverse (nv + m, nv + m) of [M Jᵀ; J -μ 1].

    Raises as forwardDynamics
    """
    found = _fast_call(BORDERED, model, data, (q, constraint_jacobian, damping))
    if found is not None:
        return found
    library, J, mu = library_of(model, data), _jacobian(constraint_jacobian, model.nv), _damping(damping)
    crba(model, data, q, Convention.WORLD)
    f = _solve(BORDERED, model, data, np.zeros(model.nv), J, np.zeros(len(J)), mu, True)
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
        arguments = (*arguments, *[0.0] * (_BUILTINS[kind].inputs - len(arguments)))  # restitution, damping
        found: Array | None = call(*arguments)
        if found is None and library.follow():  # numbers were edited
            found = call(*arguments)
    except (AttributeError, KeyError):  # the fast path does not apply
        return None
    if found is not None:
        data.note_builtin_call(before)
        data.note_builtin_call(run)
        data.__dict__["_contact"] = run.contact
    return found


def _solve(
    kind: str, model: Model, data: Data, r: Array, J: Array, gamma: Array, mu: float, bind: bool, before: Any = 0.0
) -> Solved:
    """Solve M x = r + Jᵀ λ, J x + γ = -μ λ with the M of ``data``, and record it as a call whose result is before + x.

    bind  its q is that of the call before: bind a builtin to the inputs of that, and to result and factors of this
    """
    library, (make, source, reads, recorded, _) = library_of(model, data), _BUILTINS[kind]
    f = solved(library.model, data.array("M"), r, J, gamma, mu)
    result = np.empty(0) if kind == BORDERED else before + f.x
    run: Run = data.run_of(kind, library, result.shape)
    run.result[...], run.contact = result, f
    data.note_call(run)
    data.__dict__["_contact"] = f
    if bind and library.has_builtins:
        call = data._runs[source]
        words = {**library.words, **recorded_constraints.words_of_factors(f), **call.words_before, reads: call.result}
        words |= {"D": data._held.get("D"), "U": data._held.get("U"), "rows": len(f.C) + model.nv}
        kept = None if kind == BORDERED else run.result
        noted = record(recorded, call.memory, kept, run._stamp, library.table)
        data._bound[kind] = library, call, run, make.bind(words, library, call, run, record=noted)
    return f


class _Builtin(NamedTuple):
    """The builtin of a kind, the call before it, what it reads of that call's result, how many inputs are recorded, and
    how many there are.
    """

    make: Routine
    source: str
    reads: str
    recorded: int
    inputs: int


_BUILTINS = {
    CONSTRAINED: _Builtin(recorded_constraints.dynamics, "all", "bias", 2, 6),
    IMPACT: _Builtin(recorded_constraints.impact, "crba_world", "M", 1, 5),
    BORDERED: _Builtin(recorded_constraints.inverse, "crba_world", "M", 1, 3),
}


def _arguments(
    call: str, names: tuple[str, ...], first: int, last: int, model: Model, data: Data,
    arguments: tuple[Any, ...], named: dict[str, Any],
) -> dict[str, Any]:  # fmt: skip
    """Arguments by name, checked: all, or all but the ``first`` names; the ``last`` ones, numbers, are 0 if left out.

    Raises ArgumentError if they fit neither
    """
    library_of(model, data)
    for order in (names, names[first:]):
        given = {**named, **dict(zip(order, arguments, strict=False))}
        needed = set(order[: len(order) - last])
        if (
            len(given) == len(arguments) + len(named)
            and needed <= set(given) <= set(order)
            and all((np.ndim(x) == 0) == (key in names[-last:]) for key, x in given.items())
        ):
            break
    else:
        kinds = ", ".join([*map(described, arguments), *(f"{key}={described(x)}" for key, x in named.items())])
        raise ArgumentError(
            f"{call} got ({kinds}), expected ({', '.join(names)}), with or without {', '.join(names[:first])}"
        )
    given = dict.fromkeys(names[-last:], 0.0) | given
    J = given["constraint_jacobian"] = _jacobian(given["constraint_jacobian"], model.nv)
    sizes = {"tau": model.nv, "v_before": model.nv, "constraint_drift": len(J)}
    given |= {name: vector(name, given[name], size) for name, size in sizes.items() if name in given}
    given |= {name: number(given[name], name) for name in names[-last:-1]}
    return given | {"damping": _damping(given["damping"])}


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
