"""Stacks of rows: the inertia of a subtree as a sum of squares, in an array, and reflections that keep the sum.

A row [s | r | z] stands for ½ (s x + r·a + z)²: x is the acceleration of a joint, a the acceleration of its body; s is
a number, r a Force (angular part first), z the velocity term. Sums of rows are rows, so a reflection may mix them.
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import Vec
from ...algebra.scalars import Scalar, inline, no_inline, sqrt
from ...algebra.spatial import Force, add_force, scale_force, zero_force
from ..signatures import Matrix, Vector


class Row(NamedTuple):
    """A row of a stack."""

    s: Scalar
    r: Force
    z: Scalar


@inline
def row_of(stack: Matrix, k: int) -> Row:
    """Read a row."""
    n, f = Vec(stack[k, 1], stack[k, 2], stack[k, 3]), Vec(stack[k, 4], stack[k, 5], stack[k, 6])
    return Row(stack[k, 0], Force(n, f), stack[k, 7])


@inline
def put_row(stack: Matrix, k: int, row: Row) -> None:
    """Write a row."""
    n, f = row.r.n, row.r.f
    stack[k, 0], stack[k, 1], stack[k, 2], stack[k, 3] = row.s, n.x, n.y, n.z
    stack[k, 4], stack[k, 5], stack[k, 6], stack[k, 7] = f.x, f.y, f.z, row.z


@inline
def _plus(a: Row, w: Scalar, b: Row) -> Row:
    """a + w b."""
    return Row(a.s + w * b.s, add_force(a.r, scale_force(w, b.r)), a.z + w * b.z)


@inline
def _larger(a: Row, b: Row) -> Row:
    """a with each entry of r replaced by the larger of a's and the magnitude of b's; s and z stay."""
    n, f, m, g = a.r.n, a.r.f, b.r.n, b.r.f
    return Row(
        a.s,
        Force(
            Vec(max(n.x, abs(m.x)), max(n.y, abs(m.y)), max(n.z, abs(m.z))),
            Vec(max(f.x, abs(g.x)), max(f.y, abs(g.y)), max(f.z, abs(g.z))),
        ),
        a.z,
    )


# --- reflections ----------------------------------------------------------------------------------------


@no_inline
def triangular(stack: Matrix, first: int, end: int, felt: Vector) -> int:
    """Reduce rows first .. end to their rank, at most six, with the same RᵀR and Rᵀz; returns their new end.

    felt  (6,) of 0 and 1: columns to keep; the entries left in the other columns are dropped

    Rows of very different size keep their own accuracy if pivots are chosen by columns and rows (Cox and Higham
    1998). Angular and linear columns have different units, so each is compared with the largest entry of its three.
    """
    angular, linear = 0.0, 0.0
    for top in range(first, min(end, first + 6)):
        largest = Row(0.0, zero_force(), 0.0)
        for k in range(top, end):
            largest = _larger(largest, row_of(stack, k))
        n, f = largest.r.n, largest.r.f
        if top == first:
            angular, linear = max(n.x, max(n.y, n.z)), max(f.x, max(f.y, f.z))
        sizes = (n.x, n.y, n.z, f.x, f.y, f.z)
        best, column = 0.0, 0
        for j in range(6):
            scale = angular if j < 3 else linear
            if felt[j] > 0.0 and scale > 0.0 and sizes[j] / scale > best:
                best, column = sizes[j] / scale, j + 1
        if column == 0:
            return top
        reflect(stack, top, end, column)
    return min(end, first + 6)


@no_inline
def reflect(stack: Matrix, top: int, end: int, column: int) -> None:
    """Householder reflection of rows top .. end that zeroes a column below its first entry, the row of its largest
    entry swapped to the top; a column of zeros is left as it is.
    """
    pivot = top
    for k in range(top + 1, end):
        if abs(stack[k, column]) > abs(stack[pivot, column]):
            pivot = k
    p = stack[pivot, column]
    if p == 0.0:
        return
    first = row_of(stack, pivot)
    put_row(stack, pivot, row_of(stack, top))
    square = 1.0
    for k in range(top + 1, end):
        w = stack[k, column] / p
        square += w * w
        stack[k, column] = w
    norm = sqrt(square)
    y = _plus(first, norm, first)
    for k in range(top + 1, end):
        y = _plus(y, stack[k, column], row_of(stack, k))
    put_row(stack, top, _plus(first, -1.0 / norm, y))
    for k in range(top + 1, end):
        row = row_of(stack, k)
        put_row(stack, k, _plus(row, -stack[k, column] / (norm * (1.0 + norm)), y))
        stack[k, column] = 0.0
    stack[top, column] = -norm * p
