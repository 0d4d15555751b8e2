"""A table that a call takes beside the table of bodies: one value for all samples, hashed by its content."""

from __future__ import annotations

import hashlib
from typing import Any

from numpy.typing import NDArray


class StaticTable:
    """A structured array whose row 0 is a header: it is the key of caches, so equal contents share programs.

    rows     (rows,) read-only; ``last_row`` of row 0 is the number of rows that follow
    sizes    values of the symbols that shapes may use, read from the header
    key      digest of dtype and content
    address  of ``rows`` in memory, for compiled kernels
    """

    __slots__ = ("_hash", "address", "key", "rows", "sizes")

    def __init__(self, rows: NDArray[Any], sizes: tuple[str, ...]) -> None:
        """A copy of ``rows``, with 0.0 for -0.0; ``sizes`` names the columns of its header that are sizes."""
        self.rows = rows.copy()
        _without_signed_zeros(self.rows)
        self.rows.flags.writeable = False
        self.sizes = {name: int(rows[0][name]) for name in sizes}
        content = (repr(rows.dtype.descr), self.rows.tobytes())
        self.key = hashlib.sha256(content[0].encode() + content[1]).hexdigest()
        self.address = int(self.rows.ctypes.data)
        self._hash = hash(self.key)

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, StaticTable) and self.key == other.key)

    def __hash__(self) -> int:
        return self._hash

    def __repr__(self) -> str:
        return f"<StaticTable {self.key}>"


def _without_signed_zeros(rows: NDArray[Any]) -> None:
    """Write 0.0 over -0.0, in place: what is equal has one key."""
    for name in rows.dtype.names or ():
        column = rows[name]
        if column.dtype.names:
            _without_signed_zeros(column)
        elif column.dtype.kind == "f":
            column += 0.0
