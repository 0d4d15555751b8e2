"""What answers the rows of the table of names without a Data: configurations, and the mass of a Model."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot
from typing import Any

import numpy as np

from ....engines.programs.run.single_call import READY, plan_of
from ....errors import SpatialDynError
from ...native import operator_kernels, operators
from ...native.recorded_calls import Follower
from ..coverage.strictness import strict
from ..data.data import Data, library_of
from ..data.dispatch import vector
from ..data.face import Face, key_of_model
from ..model.joint_tree import NO_LIMIT
from ..model.library_model import LibraryModel, checked_library
from ..model.model import Model
from ..types.arguments import OMITTED, ArgumentError, Array, expected, number
from ..types.random import GENERATOR

FAR = 1e30  # products of seven such numbers are finite
PRECISION = 1e-12  # of isNormalized, by default


def kept(model: Model, key: str, make: Callable[[], Any]) -> Any:
    """A builtin or Follower of a Model, made at its first use; rows of the table find its plan by this key."""
    builtins = vars(model)["_builtins"]
    if builtins is None:
        builtins = vars(model)["_builtins"] = {}
    if key not in builtins:
        builtins[key] = make()
        plan = builtins[key].plan if type(builtins[key]) is Follower else plan_of(builtins[key])
        if plan is not None:
            model._plans[key] = plan
    return builtins[key]


# --- calls of the library on configurations ------------------------------------------------------------------


def call_of_library(face: Face, model: Model, *given: Any) -> Array:
    """The call of the library, by its builtin or with argument checks."""
    library, (name,) = checked_library(model), face.call
    found: Array | None = kept(model, key_of_model(face), lambda: getattr(library, name))(*given)
    return _checked(model, library, face, given) if found is None else found


def _checked(model: Model, library: LibraryModel, face: Face, given: tuple[Any, ...]) -> Array:
    values: list[Any] = []
    for x, value in zip(face.inputs, given, strict=True):
        if x.name == "alpha":
            values.append(number(value, x.name))
        else:
            q = vector(x.name, value, model.nv if x.name == "v" else model.nq)
            values.append(_clipped(model, q) if face.name in ("difference", "interpolate") else q)
    found: Array = library.compute(face.call[0], *values)
    return found


def _clipped(model: Model, q: Array) -> Array:
    """q with entries clipped so that the products of a difference are finite; unchanged in strict mode.

    Pinocchio's limits of a free flyer are the largest number, those of its quaternion too, and programs take
    differences to them for the sake of the other joints.
    """
    if strict() or not (abs(q) > FAR).any():
        return q
    bound = np.concatenate([np.full(joint.nq, FAR if joint.nq > 1 else NO_LIMIT / 2.0) for joint in model.joints[1:]])
    return np.where(np.isfinite(q), np.clip(q, -bound, bound), q)


# --- comparisons ---------------------------------------------------------------------------------------------


def is_normalized(face: Face, model: Model, q: Any, prec: Any) -> bool:
    """``isNormalized``."""
    library, given = checked_library(model), [] if type(prec) is float and prec == PRECISION else [prec]
    fixed = {} if given else {"prec": np.array([PRECISION])}
    key = key_of_model(face, *["prec"] * bool(given))
    found: bool | None = kept(model, key, lambda: library.routine("normalized", **fixed))(q, *given)
    if found is not None:
        return found
    prec, q = _precision(prec), vector("q", q, model.nq)
    return all(abs(hypot(*q[unit].tolist()) - 1.0) < prec for unit in library.unit_parts)


def _precision(prec: Any) -> float:
    """A precision as a float. Raises SpatialDynError unless it is 0 or more."""
    if not number(prec, "prec") >= 0.0:
        raise SpatialDynError(f"prec is {prec!r}, expected a number that is not negative")
    return float(prec)


def is_same_configuration(face: Face, model: Model, q1: Any, q2: Any, prec: Any) -> bool:
    """``isSameConfiguration``."""
    library = checked_library(model)
    found: bool | None = kept(model, key_of_model(face), lambda: library.routine("same_configuration"))(q1, q2, prec)
    if found is not None:
        return found
    prec = _precision(prec)
    q1, q2 = (vector(name, q, model.nq) for name, q in (("q1", q1), ("q2", q2)))
    for x, y in ((q1[unit], q2[unit]) for unit in library.unit_parts):
        norms = [hypot(*part.tolist()) for part in (x, y)]
        apart = [hypot(*(x - s * y).tolist()) for s in ((1.0, -1.0) if len(x) == 4 else (1.0,))]
        if max(abs(n - 1.0) for n in norms) > 1e-6 and min(apart) > prec * min(norms):
            return False
    if library.unit_parts:
        q1, q2 = (library.compute("normalize", q) for q in (q1, q2))
    v = library.compute("difference", *(_clipped(model, q) for q in (q1, q2)))
    return all([abs(x) <= prec for x in v.tolist()])  # a list is faster than a generator


# --- others --------------------------------------------------------------------------------------------------


def random_configuration(face: Face, model: Model, lower: Any, upper: Any) -> Array:
    """``randomConfiguration``."""
    units, given = checked_library(model).units, [x for x in (lower, upper) if x is not OMITTED]
    if len(given) == 1:
        raise ArgumentError("randomConfiguration got one bound, expected both or none")
    limits = {"lower": model.lowerPositionLimit, "upper": model.upperPositionLimit} if not given else {}
    if READY:
        key = key_of_model(face, *["lower_bound", "upper_bound"] * bool(given))
        draw = kept(model, key, lambda: operator_kernels.draw_between(GENERATOR, model.nq, units, **limits))
        if (found := draw(*given)) is not None:
            return found  # type: ignore[no-any-return]
    lower = model.lowerPositionLimit if lower is OMITTED else vector("lower_bound", lower, model.nq)
    upper = model.upperPositionLimit if upper is OMITTED else vector("upper_bound", upper, model.nq)
    if READY and given:
        return draw(lower, upper)  # type: ignore[no-any-return]
    q = np.array([*map(operators.between, lower.tolist(), upper.tolist(), GENERATOR.random(model.nq))])
    for first, size in units:
        operators.put_direction(q, first, size, *GENERATOR.random(3).tolist())
    return q


def total_mass(face: Face, model: Model, data: Data) -> float:
    """``computeTotalMass``."""
    if data is not OMITTED:
        library_of(model, data)
    numbers = expected(model, Model, "model")._numbers
    mass: float = sum(numbers.masses.tolist(), 0.0)
    if data is not OMITTED:
        data.hold("mass")[0] = mass
    elif READY:
        kept(model, key_of_model(face), lambda: Follower(numbers.inertias)).keep(mass)
    return mass
