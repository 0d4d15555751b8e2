"""The tangent map T of a configuration: q̇ = T(q) v."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ....bodies.kinds import kind_of
from ....errors import ShapeError
from ...native import operator_kernels
from ..data.dispatch import vector
from ..model.joints import Mimic
from ..model.model import Model
from ..types.arguments import NUMBERS, ArgumentError, Array, described, expected

__all__ = ["compactTangentMap", "tangentMap", "tangentMapProduct", "tangentMapTransposeProduct"]

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
        operator_kernels.quat_matrix(np.array(q[3:7]), T[:3, :3])
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
    return np.asarray(T @ _matrix(mat_in, T.shape[1]))


def tangentMapTransposeProduct(model: Model, q: Any, mat_in: Any) -> Array:
    """Tᵀ mat_in, for a matrix (nq, n)."""
    T = tangentMap(model, q)
    return np.asarray(T.T @ _matrix(mat_in, len(T)))


def _matrix(x: Any, rows: int) -> Array:
    """A checked matrix with this number of rows. Raises ArgumentError, ShapeError."""
    if not isinstance(x, np.ndarray) or x.dtype.kind not in NUMBERS or x.ndim not in (1, 2):
        raise ArgumentError(f"mat_in is {described(x)}, expected a matrix")
    if len(x) != rows:
        raise ShapeError(f"mat_in has shape {x.shape}, expected ({rows}, n)")
    return x
