"""Configurations under Pinocchio's names: distances, derivatives of integrate and difference, tangent maps."""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot
from typing import Any

import numpy as np

from ....bodies.kinds import kind_of
from ....errors import ShapeError
from ..data.dispatch import vector
from ..model.joints import Mimic
from ..model.library_model import checked_library
from ..model.model import Model
from ..types.arguments import NUMBERS, OMITTED, ArgumentError, Array, described, expected
from ..types.frame import ARG0, ARG1, ArgumentPosition
from ..types.rotations import Quaternion
from .calls import difference as difference
from .calls import integrate as integrate
from .calls import interpolate as interpolate
from .calls import neutral as neutral
from .calls import normalize as normalize
from .calls import randomConfiguration as randomConfiguration

__all__ = [
    "compactTangentMap", "dDifference", "dIntegrate", "dIntegrateTransport", "distance", "squaredDistance",
    "tangentMap", "tangentMapProduct", "tangentMapTransposeProduct",
]  # fmt: skip


def squaredDistance(model: Model, q1: Any, q2: Any) -> Array:
    """Squared norms of the difference, joint by joint (njoints - 1,)."""
    v = difference(model, q1, q2)
    squares = [x * x for x in v.tolist()]
    return np.array([sum(squares[at : at + n]) for at, n in zip(model.idx_vs[1:], model.nvs[1:], strict=True)])


def distance(model: Model, q1: Any, q2: Any) -> float:
    """Norm of the difference."""
    v = difference(model, q1, q2)
    return hypot(*v.tolist())


# --- derivatives -----------------------------------------------------------------------------------------


def _position(position: Any) -> int:
    if not isinstance(position, ArgumentPosition):
        raise ArgumentError(f"argument position is {described(position)}, expected ARG0 or ARG1")
    if position not in (ARG0, ARG1):
        raise ArgumentError(f"argument position is {position}, expected ARG0 or ARG1")
    return int(position)


def dIntegrate(model: Model, q: Any, v: Any, argument_position: Any = OMITTED) -> Any:
    """Derivatives (nv, nv) of integrate by q and by v, a tuple; one of them for ARG0, ARG1."""
    both = checked_library(model).compute("dintegrate", vector("q", q, model.nq), vector("v", v, model.nv))
    return tuple(both) if argument_position is OMITTED else both[_position(argument_position)]


def dDifference(model: Model, q1: Any, q2: Any, argument_position: Any = OMITTED) -> Any:
    """Derivatives (nv, nv) of difference by q1 and by q2, a tuple; one of them for ARG0, ARG1."""
    both = checked_library(model).compute("ddifference", vector("q1", q1, model.nq), vector("q2", q2, model.nq))
    return tuple(both) if argument_position is OMITTED else both[_position(argument_position)]


def dIntegrateTransport(model: Model, q: Any, v: Any, Jin: Any, argument_position: Any) -> Array:
    """The derivative of integrate(q, v) by q (ARG0) or v (ARG1), times a matrix Jin (nv, n)."""
    by = dIntegrate(model, q, v, argument_position)
    return np.asarray(by @ _matrix("Jin", Jin, model.nv))


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
