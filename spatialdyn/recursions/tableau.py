"""A symmetric matrix of which some rows are held: principal pivots, done and undone row by row, without branches.

Of u = b + A x, with rows H held (their u is kept, their x follows) and the others free, the tableau has

    A_ff - A_fh A_hh⁻¹ A_hf   of two free rows,    A_hh⁻¹ A_hf   between held and free,    -A_hh⁻¹   of two held.

A row passes from one set to the other by one rank-one change, so that each row's own response, all other held rows
taken out, costs one column instead of a factorization. A derivation of our own, with the signs that keep the
tableau symmetric; statisticians know the change of a row as the sweep operator.
"""

from __future__ import annotations

from ..algebra.scalars import Scalar, no_inline, select
from .signatures import Matrix, Vector


@no_inline
def turn_row(T: Matrix, k: int, change: Scalar, held: Scalar, column: Vector) -> None:
    """Hold row k of T, in place, if it is free, and free it if it is held; nothing if ``change`` is 0.

    T       (m, m), its lower triangle is read and written
    change  1 or 0
    held    1 or 0, whether the row is held so far
    column  (m), scratch
    """
    m = len(T)
    each = select(change, 1.0 / select(change, T[k, k], 1.0), 0.0)
    for i in range(m):
        column[i] = T[i, k] if i > k else T[k, i]
    sign = 1.0 - (held + held)
    for i in range(m):
        if i != k:
            share = column[i] * each
            for j in range(i + 1):
                if j != k:
                    T[i, j] = T[i, j] - share * column[j]
            turned = select(change, sign * share, column[i])
            if i > k:
                T[i, k] = turned
            else:
                T[k, i] = turned
    T[k, k] = select(change, -each, T[k, k])


@no_inline
def open_rows(T: Matrix, held: Vector, k: int, count: int, B: Matrix, C: Matrix) -> None:
    """The responses to ``count`` rows from k on as if they alone were free; the tableau is left as it is.

    B  (at least count, at least count), written: of those rows, all other held rows taken out
    C  (m, at least count), written: of the other rows, u of free ones and -x of held ones; 0 of themselves
    """
    m = len(T)
    for a in range(count):
        for i in range(m):
            inside = k <= i < k + count
            C[i, a] = 0.0 if inside else (T[i, k + a] if i > k + a else T[k + a, i])
        for c in range(count):
            B[a, c] = T[k + a, k + c] if a >= c else T[k + c, k + a]
    for a in range(count):
        h = held[k + a]
        each = select(h, 1.0 / select(h, B[a, a], 1.0), 0.0)
        for i in range(m):
            if i < k or i >= k + count:
                share = C[i, a] * each
                for c in range(count):
                    if c != a:
                        C[i, c] = C[i, c] - share * B[a, c]
                C[i, a] = select(h, -share, C[i, a])
        for c in range(count):
            if c != a:
                share = B[c, a] * each
                for d in range(count):
                    if d != a:
                        B[c, d] = B[c, d] - share * B[a, d]
        for c in range(count):
            if c != a:
                B[c, a] = select(h, -(B[c, a] * each), B[c, a])
                B[a, c] = B[c, a]
        B[a, a] = select(h, -each, B[a, a])
