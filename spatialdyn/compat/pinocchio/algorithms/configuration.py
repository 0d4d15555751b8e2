"""Configurations under Pinocchio's names: integrate, difference, interpolate, random ones, derivatives."""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot
from typing import Any

import numpy as np

from ....bodies.kinds import kind_of
from ....engines.programs.run.single_call import READY
from ....errors import ShapeError, SpatialDynError
from ...native import operator_kernels, operators
from ..coverage.strictness import strict
from ..data.dispatch import vector
from ..model.joint_tree import NO_LIMIT
from ..model.joints import Mimic
from ..model.library_model import library_model
from ..model.model import Model
from ..types.arguments import NUMBERS, ArgumentError, Array, described, expected, number
from ..types.frame import ARG0, ARG1, ArgumentPosition
from ..types.random import GENERATOR
from ..types.rotations import Quaternion

__all__ = [
    "compactTangentMap", "dDifference", "dIntegrate", "dIntegrateTransport", "difference", "distance", "integrate",
    "interpolate", "isNormalized", "isSameConfiguration", "neutral", "normalize", "randomConfiguration",
    "squaredDistance", "tangentMap", "tangentMapProduct", "tangentMapTransposeProduct",
]  # fmt: skip


FAR = 1e30  # products of seven such numbers are finite


def _library_model(model: Model) -> Any:
    return library_model(expected(model, Model, "model"))


def _checked(model: Model, name: str, clipped: bool = False, **given: Any) -> Array:
    """A call of the library with argument checks; ``clipped``: configurations are clipped to finite products first."""
    library = _library_model(model)
    values: list[Any] = []
    for x, value in given.items():
        if x == "alpha":
            values.append(number(value, x))
        else:
            q = vector(x, value, model.nv if x == "v" else model.nq)
            values.append(_clipped(model, q) if clipped else q)
    found: Array = library.compute(name, *values)
    return found


def neutral(model: Model) -> Array:
    """Configuration (nq,) without displacement of any joint."""
    try:
        found: Array | None = model._library.neutral()
    except AttributeError:
        found = None
    return _checked(model, "neutral") if found is None else found


def integrate(model: Model, q: Any, v: Any) -> Array:
    """Configuration (nq,) reached from q (nq,) by the displacement v (nv,): a velocity held for unit time.

    Raises ArgumentError, a TypeError, for a wrong type, ShapeError, a ValueError, for a wrong size, and in strict mode
    ConfigurationError for a quaternion or (cos, sin) pair whose norm is not 1.
    """
    try:
        found: Array | None = model._library.integrate(q, v)
    except AttributeError:
        found = None
    return _checked(model, "integrate", q=q, v=v) if found is None else found


def difference(model: Model, q1: Any, q2: Any) -> Array:
    """Displacement v (nv,) with integrate(q1, v) = q2, by the shorter way round.

    Outside strict mode joints with several coordinates have them clipped to ±1e30, so that products stay finite.
    """
    try:
        found: Array | None = model._library.difference(q1, q2)
    except AttributeError:
        found = None
    return _checked(model, "difference", True, q1=q1, q2=q2) if found is None else found


def interpolate(model: Model, q1: Any, q2: Any, alpha: float) -> Array:
    """Configuration (nq,) at the fraction alpha of the way from q1 to q2."""
    try:
        found: Array | None = model._library.interpolate(q1, q2, alpha)
    except AttributeError:
        found = None
    return _checked(model, "interpolate", True, q1=q1, q2=q2, alpha=alpha) if found is None else found


def normalize(model: Model, q: Any) -> Array:
    """q (nq,) with its quaternions and (cos, sin) pairs at unit norm."""
    try:
        found: Array | None = model._library.normalize(q)
    except AttributeError:
        found = None
    return _checked(model, "normalize", q=q) if found is None else found


def _clipped(model: Model, q: Array) -> Array:
    """q with entries clipped so that the products of a difference are finite; unchanged in strict mode.

    Pinocchio's limits of a free flyer are the largest number, those of its quaternion too, and programs take
    differences to them for the sake of the other joints.
    """
    if strict() or not (abs(q) > FAR).any():
        return q
    bound = np.concatenate([np.full(joint.nq, FAR if joint.nq > 1 else NO_LIMIT / 2.0) for joint in model.joints[1:]])
    return np.where(np.isfinite(q), np.clip(q, -bound, bound), q)


def squaredDistance(model: Model, q1: Any, q2: Any) -> Array:
    """Squared norms of the difference, joint by joint (njoints - 1,)."""
    v = difference(model, q1, q2)
    squares = [x * x for x in v.tolist()]
    return np.array([sum(squares[at : at + n]) for at, n in zip(model.idx_vs[1:], model.nvs[1:], strict=True)])


def distance(model: Model, q1: Any, q2: Any) -> float:
    """Norm of the difference."""
    v = difference(model, q1, q2)
    return hypot(*v.tolist())


def isNormalized(model: Model, q: Any, prec: float = 1e-12) -> bool:
    """Whether the norms of all quaternions and (cos, sin) pairs are within prec of 1. Raises SpatialDynError, a
    ValueError, for a prec below 0.
    """
    try:
        found: bool | None = model._library.normalized(q, prec)
        if found is not None:
            return found
    except AttributeError:  # the fast path does not apply
        pass
    prec = _precision(prec)
    parts = _unit_parts(expected(model, Model, "model"), vector("q", q, model.nq))
    return all(abs(hypot(*part.tolist()) - 1.0) < prec for part in parts)


def _precision(prec: Any) -> float:
    """A precision as a float. Raises SpatialDynError unless it is 0 or more."""
    if not number(prec, "prec") >= 0.0:
        raise SpatialDynError(f"prec is {prec!r}, expected a number that is not negative")
    return float(prec)


def _unit_parts(model: Model, q: Array) -> list[Array]:
    """Views of the quaternions and (cos, sin) pairs of a configuration."""
    return [q[unit] for unit in (model._library or library_model(model)).unit_parts]


def isSameConfiguration(model: Model, q1: Any, q2: Any, prec: float) -> bool:
    """Whether two configurations agree to prec; a quaternion and its negative are one rotation.

    Quaternions and pairs off their unit norm agree if their numbers do, to prec of the smaller norm. Raises as
    ``isNormalized``.
    """
    try:
        found: bool | None = model._library.same_configuration(q1, q2, prec)
        if found is not None:
            return found
    except AttributeError:  # the fast path does not apply
        pass
    prec = _precision(prec)
    units = (expected(model, Model, "model")._library or library_model(model)).unit_parts
    if units:
        q1, q2 = (vector(name, q, model.nq) for name, q in (("q1", q1), ("q2", q2)))
    for x, y in ((q1[unit], q2[unit]) for unit in units):
        norms = [hypot(*part.tolist()) for part in (x, y)]
        apart = [hypot(*(x - s * y).tolist()) for s in ((1.0, -1.0) if len(x) == 4 else (1.0,))]
        if max(abs(n - 1.0) for n in norms) > 1e-6 and min(apart) > prec * min(norms):
            return False
    if units:
        q1, q2 = normalize(model, q1), normalize(model, q2)
    return all([abs(x) <= prec for x in difference(model, q1, q2).tolist()])  # a list is faster than a generator


# --- derivatives -----------------------------------------------------------------------------------------


def _position(position: Any) -> int:
    if not isinstance(position, ArgumentPosition):
        raise ArgumentError(f"argument position is {described(position)}, expected ARG0 or ARG1")
    if position not in (ARG0, ARG1):
        raise ArgumentError(f"argument position is {position}, expected ARG0 or ARG1")
    return int(position)


def dIntegrate(model: Model, q: Any, v: Any, argument_position: Any = None) -> Any:
    """Derivatives (nv, nv) of integrate by q and by v, a tuple; one of them for ARG0, ARG1."""
    both = _library_model(model).compute("dintegrate", vector("q", q, model.nq), vector("v", v, model.nv))
    return tuple(both) if argument_position is None else both[_position(argument_position)]


def dDifference(model: Model, q1: Any, q2: Any, argument_position: Any = None) -> Any:
    """Derivatives (nv, nv) of difference by q1 and by q2, a tuple; one of them for ARG0, ARG1."""
    both = _library_model(model).compute("ddifference", vector("q1", q1, model.nq), vector("q2", q2, model.nq))
    return tuple(both) if argument_position is None else both[_position(argument_position)]


def dIntegrateTransport(model: Model, q: Any, v: Any, Jin: Any, argument_position: Any) -> Array:
    """The derivative of integrate(q, v) by q (ARG0) or v (ARG1), times a matrix Jin (nv, n)."""
    by = dIntegrate(model, q, v, argument_position)
    return np.asarray(by @ _matrix("Jin", Jin, model.nv))


# --- random ones -----------------------------------------------------------------------------------------


def randomConfiguration(model: Model, lower_bound: Any = None, upper_bound: Any = None) -> Array:
    """A random configuration (nq,) between the bounds, by default the model's; rotations are uniform.

    A coordinate without a finite limit is drawn from an interval of width 2 (Pinocchio: not finite).
    """
    library = expected(model, Model, "model")._library or library_model(model)
    lower = model.lowerPositionLimit if lower_bound is None else vector("lower_bound", lower_bound, model.nq)
    upper = model.upperPositionLimit if upper_bound is None else vector("upper_bound", upper_bound, model.nq)
    q: Array | None = operator_kernels.draw_between(GENERATOR, model.nq, library.units)(lower, upper) if READY else None
    if q is None:
        q = np.array([*map(operators.between, lower.tolist(), upper.tolist(), GENERATOR.random(model.nq))])
        for first, size in library.units:
            operators.put_direction(q, first, size, *GENERATOR.random(3).tolist())
    return q


# --- the tangent map T: q̇ = T(q) v ----------------------------------------------------------------------


COLUMNS = 6  # of compactTangentMap


def _blocks(model: Model, q: Array) -> Iterator[tuple[int, int, Array]]:
    """First index in q, in v, and the block of T, of each of the library's joints."""
    for joint in model.joints[1:]:
        if isinstance(joint, Mimic):
            continue
        row, column = joint.idx_q, joint.idx_v
        for step in joint.steps():
            block = _block(kind_of(step.kind, "cos_sin").group, q[row:])
            yield row, column, block
            row, column = row + len(block), column + block.shape[1]


def _block(group: str, q: Array) -> Array:
    """T of a joint whose coordinates q begins with."""
    if group == "R":  # an angle or a length
        return np.ones((1, 1))
    if group == "SO(2)":  # cos, sin
        return np.array([[-q[1]], [q[0]]])
    if group == "SO(3)":  # x y z w: half the product with an angular velocity in the body's axes
        x, y, z, w = (0.5 * q[:4]).tolist()
        return np.array([[w, -z, y], [z, w, -x], [-y, x, w], [-x, -y, -z]])
    at = 2 if group == "SE(2)" else 3  # lengths come first, with velocities along the body's axes
    turned = _block(f"SO({at})", q[at:])
    T = np.zeros((at + len(turned), at + turned.shape[1]))
    T[at:, at:] = turned
    if group == "SE(2)":
        T[:2, :2] = [[q[2], -q[3]], [q[3], q[2]]]
    else:
        T[:3, :3] = Quaternion(np.array(q[3:7])).matrix()
    return T


def tangentMap(model: Model, q: Any) -> Array:
    """T (nq, nv), the derivative of integrate(q, v) by v at v = 0. Raises ArgumentError, ShapeError."""
    q = vector("q", q, expected(model, Model, "model").nq)
    T = np.zeros((model.nq, model.nv))
    for row, column, block in _blocks(model, q):
        T[row : row + len(block), column : column + block.shape[1]] = block
    return T


def compactTangentMap(model: Model, q: Any) -> Array:
    """The rows of T (nq, 6), each from the first velocity of its joint.

    Raises ShapeError for a joint of more than 6 velocities.
    """
    T = tangentMap(model, q)
    out = np.zeros((model.nq, COLUMNS))
    for k, joint in enumerate(model.joints[1:], 1):
        if joint.nv > COLUMNS:
            raise ShapeError(f'joint "{model.names[k]}" has {joint.nv} velocities, expected at most {COLUMNS}')
        rows = slice(joint.idx_q, joint.idx_q + joint.nq)
        out[rows, : joint.nv] = T[rows, joint.idx_v : joint.idx_v + joint.nv]
    return out


def tangentMapProduct(model: Model, q: Any, mat_in: Any) -> Array:
    """T mat_in, for a matrix (nv, n)."""
    T = tangentMap(model, q)
    return np.asarray(T @ _matrix("mat_in", mat_in, T.shape[1]))


def tangentMapTransposeProduct(model: Model, q: Any, mat_in: Any) -> Array:
    """Tᵀ mat_in, for a matrix (nq, n)."""
    T = tangentMap(model, q)
    return np.asarray(T.T @ _matrix("mat_in", mat_in, len(T)))


def _matrix(name: str, x: Any, rows: int) -> Array:
    """A checked matrix with this number of rows. Raises ArgumentError, ShapeError."""
    if not isinstance(x, np.ndarray) or x.dtype.kind not in NUMBERS or x.ndim not in (1, 2):
        raise ArgumentError(f"{name} is {described(x)}, expected a matrix of numbers")
    if len(x) != rows:
        raise ShapeError(f"{name} has shape {x.shape}, expected ({rows}, n)")
    return x
