"""Lists whose entries are views of the rows of one array: Data's fields of joints and frames."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from .arguments import ArgumentError, Array, described, expected


class Rows(Sequence[Any]):
    """A list whose entries are views of the rows of an array; assigning an entry copies into its row.

    kind  SE3, Motion, Force or Inertia; None for plain arrays, which are numbers if the array has one axis
    """

    __slots__ = ("_kind", "_views", "array")

    def __init__(self, array: Array, kind: Any = None) -> None:
        self.array, self._kind = array, kind
        self._views: list[Any] = [None] * len(array)  # views of rows, made at the first read

    def __len__(self) -> int:
        return len(self.array)

    def __getitem__(self, at: Any) -> Any:
        if isinstance(at, slice):
            return [self[k] for k in range(*at.indices(len(self)))]
        found = self._views[at]  # raises IndexError, and TypeError for what is no index, as a list does
        if found is None:
            x = self.array[at]
            if x.ndim == 0:
                return float(x)
            found = self._views[at] = x if self._kind is None else self._kind.over(x)
        return found

    def __setitem__(self, at: Any, value: Any) -> None:
        self._views[at]  # raises as __getitem__
        if self._kind is not None:
            value = expected(value, self._kind, "value")._x
        elif not isinstance(at, slice) and (np.shape(value) != self.array.shape[1:] or isinstance(value, str)):
            raise ArgumentError(f"value is {described(value)}, expected one of shape {self.array.shape[1:]}")
        self.array[at] = value

    def __iter__(self) -> Iterator[Any]:
        return (self[k] for k in range(len(self.array)))

    def write(self, values: Iterable[Any]) -> None:
        """Copy values into all rows."""
        given = list(values)
        if len(given) != len(self.array):
            raise ValueError(f"{len(given)} values were given for a list of {len(self.array)}")
        for k, value in enumerate(given):
            self[k] = value

    def tolist(self) -> list[Any]:
        """The entries as a plain list."""
        return list(self)

    def copy(self) -> list[Any]:
        """A plain list of copies."""
        return [x if isinstance(x, float) else x.copy() for x in self]

    def id(self) -> int:
        """The identity of this object."""
        return id(self)

    def __eq__(self, other: object) -> Any:
        if not isinstance(other, Rows):
            return NotImplemented
        return self._kind is other._kind and np.array_equal(self.array, other.array, equal_nan=True)

    __hash__ = object.__hash__

    def __reduce__(self) -> tuple[Any, ...]:
        return Rows, (self.array, self._kind)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.tolist()!r})"
