"""Parts of derivatives of steps: matrices of 3 nv columns, by (δq, δv, δτ), and blocks of joints that act on them."""

from __future__ import annotations

from ..algebra.euclidean import dot
from ..algebra.scalars import Scalar, inline, select
from ..bodies.kinds import NV, SE2, SE3
from .configuration import twist
from .signatures import Array, Bodies, Matrix, Record, Vector


@inline
def travels(b: Record) -> bool:
    """Whether a joint turns and travels: it is floating or planar."""
    return b.kind in SE3 or b.kind in SE2


@inline
def largest_turn(bodies: Bodies, u: Vector, most: Scalar) -> Scalar:
    """The larger of ``most`` and the squares of the angles by which u turns joints of several freedoms."""
    for i in range(1, len(bodies)):
        b = bodies[i]
        if NV[b.kind] > 1:
            w = twist(b, i - 1, u).w
            square = dot(w, w)
            most = select(square - most, square, most)
    return most


@inline
def put_turn(turn: Scalar, n: int, out: Matrix) -> None:
    """The last row, if there is one."""
    for i in range(2 * n, len(out)):
        for j in range(3 * n):
            out[i, j] = turn if j == 0 else 0.0


@inline
def put_moved(bodies: Bodies, by_step: Array, U: Matrix, out: Matrix) -> None:
    """out = P [1 0 0] + R U of q ∘ exp(u)."""
    out[:] = 0.0
    for i in range(1, len(bodies)):
        d = NV[bodies[i].kind]
        for r in range(i - 1, i - 1 + d):
            for c in range(i - 1, i - 1 + d):
                out[r, c] = by_step[0, r, c]
    add_blocks(bodies, by_step[1], U, out)


@inline
def put_acceleration(D: Array, by_q: Matrix, W: Matrix, out: Matrix) -> None:
    """out = D_q Q + D_v W + M⁻¹ [0 0 1]."""
    n = len(W)
    for i in range(n):
        into = out[i]
        for j in range(2 * n):
            into[j] = 0.0
        for j in range(n):
            into[2 * n + j] = D[2, i, j]
        for k in range(n):
            x, y, first, second = D[0, i, k], D[1, i, k], by_q[k], W[k]
            for j in range(3 * n):
                into[j] = into[j] + x * first[j] + y * second[j]


@inline
def add_blocks(bodies: Bodies, T: Matrix, X: Matrix, out: Matrix) -> None:
    """out += T X, T with a block for each joint."""
    for i in range(1, len(bodies)):
        d = NV[bodies[i].kind]
        for r in range(i - 1, i - 1 + d):
            into = out[r]
            for k in range(i - 1, i - 1 + d):
                x, row = T[r, k], X[k]
                for j in range(len(row)):
                    into[j] = into[j] + x * row[j]


@inline
def add_turned(bodies: Bodies, T: Matrix, x: Vector, out: Vector) -> None:
    """out += T x, T with a block for each joint."""
    for i in range(1, len(bodies)):
        d = NV[bodies[i].kind]
        for r in range(i - 1, i - 1 + d):
            for k in range(i - 1, i - 1 + d):
                out[r] = out[r] + T[r, k] * x[k]


@inline
def put_scaled(c: Scalar, X: Matrix, out: Matrix) -> None:
    """out = c X."""
    for i in range(len(X)):
        row, into = X[i], out[i]
        for j in range(len(row)):
            into[j] = c * row[j]


@inline
def add_scaled(c: Scalar, X: Matrix, out: Matrix) -> None:
    """out += c X."""
    for i in range(len(X)):
        row, into = X[i], out[i]
        for j in range(len(row)):
            into[j] = into[j] + c * row[j]


@inline
def add_unit(which: int, out: Matrix) -> None:
    """out += [1 0 0], [0 1 0] or [0 0 1]."""
    n = len(out)
    for i in range(n):
        out[i, which * n + i] = out[i, which * n + i] + 1.0
