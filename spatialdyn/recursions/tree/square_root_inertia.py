"""Square roots of the inertia of a body: rows R and rates z with RᵀR = I and Rᵀz = v ×* I v.

The rows belong to a few points with the same mass, first and second moments as the body, three rows to a point: a link
without mass, or without extent, has fewer or none.
"""

from __future__ import annotations

from ...algebra.euclidean import Sym, Vec, add, apply_sym, cross, dot, scale, second_moment, sub, zero
from ...algebra.scalars import EPS, Scalar, inline, sqrt
from ...algebra.spatial import Force, Inertia, Motion
from ..signatures import Matrix, Vector
from .square_root_rows import Row, put_row, triangular


@inline
def body_rows(stack: Matrix, rows: int, I: Inertia, v: Motion, felt: Vector) -> int:
    """Append the rows of a body: with Σ x xᵀ its second moments of mass, rows [-x̃, 0] and z = ω × (ω × x) for each x.

    Mass and first moment make one more point, s = √m and x = h/s, which also translates: [-x̃, s 1] and
    z = ω × (s v + ω × x). Returns the new number of rows.
    """
    s, x = sqrt(I.m), zero()
    if s != 0.0:
        x = Vec(I.h.x / s, I.h.y / s, I.h.z / s)
        z = cross(v.w, add(scale(s, v.v), cross(v.w, x)))
        put_row(stack, rows, Row(0.0, Force(Vec(0.0, x.z, -x.y), Vec(s, 0.0, 0.0)), z.x))
        put_row(stack, rows + 1, Row(0.0, Force(Vec(-x.z, 0.0, x.x), Vec(0.0, s, 0.0)), z.y))
        put_row(stack, rows + 2, Row(0.0, Force(Vec(x.y, -x.x, 0.0), Vec(0.0, 0.0, s)), z.z))
        rows += 3
    M = second_moment(I.I)
    least = 16.0 * EPS * (abs(M.xx) + abs(M.yy) + abs(M.zz))  # bound on rounding errors
    rest = Sym(
        M.xx - x.x * x.x, M.xy - x.x * x.y, M.xz - x.x * x.z, M.yy - x.y * x.y, M.yz - x.y * x.z, M.zz - x.z * x.z
    )
    first = rows
    for _ in range(3):
        d, axis = _largest(rest)
        if d > 0.0:
            x, rest = _without_axis(rest, axis, d)
            z = cross(v.w, cross(v.w, x))
            put_row(stack, rows, Row(0.0, Force(Vec(0.0, x.z, -x.y), zero()), z.x))
            put_row(stack, rows + 1, Row(0.0, Force(Vec(-x.z, 0.0, x.x), zero()), z.y))
            put_row(stack, rows + 2, Row(0.0, Force(Vec(x.y, -x.x, 0.0), zero()), z.z))
            rows += 3
    if not _size(rest) <= least:
        rows = _turning_rows(stack, first, I, v.w)
    elif rows - first > 3:
        rows = triangular(stack, first, rows, felt)
    return rows


@inline
def _turning_rows(stack: Matrix, rows: int, I: Inertia, w: Vec) -> int:
    """Append rows of a rotational inertia about the com that no distribution of mass has; NaN if it is not positive
    semidefinite and so has no root. Returns the new number of rows.
    """
    least = 16.0 * EPS * (abs(I.I.xx) + abs(I.I.yy) + abs(I.I.zz))
    rest = I.I
    if I.m > 0.0:
        c, h = Vec(I.h.x / I.m, I.h.y / I.m, I.h.z / I.m), I.h
        hc = dot(h, c)
        rest = Sym(
            rest.xx - (hc - h.x * c.x), rest.xy + h.x * c.y, rest.xz + h.x * c.z,
            rest.yy - (hc - h.y * c.y), rest.yz + h.y * c.z, rest.zz - (hc - h.z * c.z),
        )  # fmt: skip
    moment = cross(w, apply_sym(rest, w))
    for _ in range(3):
        d, axis = _largest(rest)
        if d > 0.0:
            x, rest = _without_axis(rest, axis, d)
            along = moment.x if axis == 0 else (moment.y if axis == 1 else moment.z)
            z = along / sqrt(d)
            moment = sub(moment, scale(z, x))
            put_row(stack, rows, Row(0.0, Force(x, zero()), z))
            rows += 1
    if not _size(rest) <= least:
        nan = Vec(sqrt(-1.0), 0.0, 0.0)
        put_row(stack, rows, Row(0.0, Force(nan, nan), nan.x))
        rows += 1
    return rows


@inline
def _largest(M: Sym) -> tuple[Scalar, int]:
    """The largest entry on the diagonal, and its index."""
    if M.yy > M.xx:
        return (M.zz, 2) if M.zz > M.yy else (M.yy, 1)
    return (M.zz, 2) if M.zz > M.xx else (M.xx, 0)


@inline
def _size(M: Sym) -> Scalar:
    """The largest magnitude of an entry."""
    diagonal = max(abs(M.xx), max(abs(M.yy), abs(M.zz)))
    return max(diagonal, max(abs(M.xy), max(abs(M.xz), abs(M.yz))))


@inline
def _without_axis(M: Sym, axis: int, d: Scalar) -> tuple[Vec, Sym]:
    """x and M - x xᵀ, a step of Cholesky's: x is M's column of the axis over √d, d the entry on the diagonal."""
    s = sqrt(d)
    if axis == 0:
        x = Vec(s, M.xy / s, M.xz / s)
        return x, Sym(0.0, 0.0, 0.0, M.yy - x.y * x.y, M.yz - x.y * x.z, M.zz - x.z * x.z)
    if axis == 1:
        x = Vec(M.xy / s, s, M.yz / s)
        return x, Sym(M.xx - x.x * x.x, 0.0, M.xz - x.x * x.z, 0.0, 0.0, M.zz - x.z * x.z)
    x = Vec(M.xz / s, M.yz / s, s)
    return x, Sym(M.xx - x.x * x.x, M.xy - x.x * x.y, 0.0, M.yy - x.y * x.y, 0.0, 0.0)
