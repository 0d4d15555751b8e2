"""Rows of a tile in memory to columns on lanes, and back: whole-vector loads and stores, transposed in registers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from .host_cpu import host
from .llvm_vectors import Vectors

STAGED = 24  # least columns of a row that is staged
IN_PLACE = ("znver4",)  # processors on which staging takes longer: a load waits for the two stores that it straddles


def halved(columns: int, lanes: int) -> bool:
    """Whether half a vector divides a row evenly and a whole one does not.

    Half vectors straddle no cache line then, and take one round of shuffles less: crba of a UR5 takes 18 % less time.
    """
    return lanes >= 8 and columns % lanes == lanes // 2


def staged(columns: int, lanes: int, stream: bool) -> bool:
    """Whether a tile's rows of results are written to the workspace, and from there in whole vectors.

    Written in place, most vectors straddle two cache lines, unless a vector divides a row evenly. All rows of a tile
    together are whole vectors: on a Xeon crba of a Panda takes 22 to 43 % less time with AVX-512, 14 to 30 % less with
    AVX2, and rows of 9 numbers take 6 % more. On a Zen 4 it takes 12 to 20 % more, and rows of 606 numbers twice the
    time. Stores that bypass the CPU caches (``stream``) must be of whole lines.
    """
    ragged = columns % lanes > 0
    faster = columns >= STAGED and not halved(columns, lanes) and host()[0] not in IN_PLACE
    return ragged and (stream or faster)


def blocks(columns: int, lanes: int) -> Iterator[tuple[int, int]]:
    """(first column, width) of blocks that cover the columns; widths are powers of two, and the last block may overlap.

    The last block is only as wide as the columns that are left, since a narrower one takes fewer shuffles.
    """
    width = lanes // 2 if halved(columns, lanes) else lanes
    while width > columns:
        width //= 2
    for first in range(0, columns - width + 1, width):
        yield first, width
    rest = columns % width
    if rest:
        narrow = 2
        while narrow < rest:
            narrow *= 2
        yield columns - narrow, narrow


def starts(t: Vectors, array: str, step: int | str) -> list[str]:
    """The addresses of the tile's rows in an array; ``step`` to the next row, in numbers."""
    rows = [t.add("%first", r) for r in range(t.lanes)]
    return [t.number(array, t.times(row, step)) for row in rows]


def read(t: Vectors, array: str, step: str, width: int) -> list[str]:
    """The columns of the tile's rows in an array."""
    row, found = starts(t, array, step), [""] * width
    for first, size in blocks(width, t.lanes):
        loaded = []
        for i in range(size):
            places = [row[g * size + i] for g in range(t.lanes // size)]
            loaded.append(_joined(t, [t.load(t.kind(size), t.number(x, first), t.size) for x in places], size))
        found[first : first + size] = t.transposed(loaded)
    return found


def write(t: Vectors, row: Sequence[str], first: int, vectors: list[str], align: int, stream: bool) -> None:
    """Store a block of columns, from column ``first`` on, to rows at these addresses."""
    size = len(vectors)
    for i, x in enumerate(t.transposed(vectors)):
        for g in range(t.lanes // size):
            part = x if size == t.lanes else t.shuffle(t.vector, x, x, range(g * size, (g + 1) * size))
            t.store(t.kind(size), part, t.number(row[g * size + i], first), align, stream)


def _joined(t: Vectors, parts: list[str], size: int) -> str:
    """Concatenate vectors of ``size`` numbers."""
    while len(parts) > 1:
        pairs = zip(parts[::2], parts[1::2], strict=True)
        parts = [t.shuffle(t.kind(size), a, b, range(2 * size)) for a, b in pairs]
        size *= 2
    return parts[0]
