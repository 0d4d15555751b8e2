"""Lists of values that notify an owner of writes by its ``changed()``; lists of the rows of an array.

Frames and joint models have a slot ``_owner``, None without an owner, which their attributes notify.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import wraps
from typing import Any, TypeVar

import numpy as np

from .arguments import ArgumentError, Array, described, expected
from .bases import OwnedValue
from .value import Value as Numbers

Value = TypeVar("Value")


def owned_copy(value: Value, owner: Any) -> Value:
    """A copy of a value that notifies the owner of writes."""
    copy: Any = value.copy()  # type: ignore[attr-defined]
    copy._owner = owner
    return copy  # type: ignore[no-any-return]


class Listed:
    """Base of lists under the names of Boost.Python's."""

    __slots__ = ()

    def tolist(self) -> list[Any]:
        """The entries as a plain list."""
        return list(self)  # type: ignore[call-overload,no-any-return]

    def id(self) -> int:
        """The identity of this object."""
        return id(self)


def notifying(method: Callable[..., Any]) -> Any:
    """A method of ``list`` that notifies the list's owner, also where it raises on its way."""

    @wraps(method)
    def call(self: Any, *arguments: Any, **named: Any) -> Any:
        try:
            return method(self, *arguments, **named)
        finally:
            self._owner.changed()

    return call


class OwnedList(list[Value], Listed):
    """A list of values of one type that belong to an owner; values put in are copied.

    It calls ``changed()`` of the owner when an entry is replaced, added, removed, moved, or written in place.
    """

    __delitem__, clear, pop = notifying(list.__delitem__), notifying(list.clear), notifying(list.pop)
    remove, reverse, sort = notifying(list.remove), notifying(list.reverse), notifying(list.sort)

    def __init__(self, owner: Any, kind: type | tuple[type, ...], values: Iterable[Value] = ()) -> None:
        self._owner, self._kind = owner, kind
        super().__init__([self._own(value) for value in values])

    def _own(self, value: Value) -> Value:
        if not isinstance(value, self._kind):
            kinds = self._kind if isinstance(self._kind, tuple) else (self._kind,)
            raise ArgumentError(
                f"{described(value)} was given, expected {' or '.join(kind.__name__ for kind in kinds)}"
            )
        if isinstance(value, OwnedValue):
            return owned_copy(value, self._owner)
        return value.copy() if isinstance(value, Numbers) else value

    def for_owner(self, owner: Any) -> OwnedList[Value]:
        """A copy of the list, and of its values, that belongs to another owner."""
        made = type(self).__new__(type(self))
        made._owner, made._kind = owner, self._kind
        list.extend(made, self)
        for k, x in enumerate(self):
            if not isinstance(x, OwnedValue):
                break
            list.__setitem__(made, k, owned_copy(x, owner))
        return made

    def __setitem__(self, at: Any, value: Any) -> None:
        """Replace an entry; a Value is written in place, so that references to it see the new numbers."""
        there = self[at]
        if isinstance(there, Numbers) and type(there) is type(value):
            there._x[...] = value._x
            self._owner.changed()
        else:
            super().__setitem__(at, [*map(self._own, value)] if isinstance(at, slice) else self._own(value))
            self._owner.changed()

    def append(self, value: Value) -> None:
        super().append(self._own(value))
        self._owner.changed()

    def insert(self, at: Any, value: Value) -> None:
        super().insert(at, self._own(value))
        self._owner.changed()

    def extend(self, values: Iterable[Value]) -> None:
        super().extend([self._own(x) for x in values])
        self._owner.changed()

    def __iadd__(self, values: Iterable[Value]) -> OwnedList[Value]:  # type: ignore[override, misc]
        self.extend(values)
        return self

    def __imul__(self, times: Any) -> OwnedList[Value]:  # type: ignore[misc]
        """Repeat the entries as copies of their own, in place."""
        if times > 0:
            self.extend([*self] * (times - 1))
        else:
            self.clear()
        return self

    def reserve(self, new_cap: int) -> None:
        """Do nothing: a list grows by itself."""

    def copy(self) -> list[Value]:
        """A plain list of copies."""
        return [x.copy() if hasattr(x, "copy") else x for x in self]


class Rows(Listed, Sequence[Any]):
    """A list whose entries are views of the rows of an array; assigning an entry copies into its row.

    kind  SE3, Motion, Force or Inertia; None for plain arrays, which are numbers if the array has one axis
    """

    __slots__ = ("_kind", "_views", "array")

    def __init__(self, array: Array, kind: Any = None) -> None:
        self.array, self._kind = array, kind
        self._views: list[Any] = [None] * len(array)  # views of rows, made at the first read

    def move(self, array: Array) -> None:
        """Be the rows of another array, of as many rows or more, and its views of them too."""
        for view, x in zip(self._views, array, strict=False):
            if view is not None:
                view._x = x
        self.array, self._views = array, [*self._views, *[None] * (len(array) - len(self._views))]

    def __len__(self) -> int:
        return len(self.array)

    def __getitem__(self, at: Any) -> Any:
        if isinstance(at, slice):
            return [self[k] for k in range(*at.indices(len(self)))]
        try:
            found = self._views[at]
        except IndexError:
            raise IndexError(f"Index out of range: it is {at}, expected one below {len(self)}") from None
        except TypeError:
            raise TypeError(f"Invalid index type: it is {described(at)}, expected an int or a slice") from None
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

    def copy(self) -> list[Any]:
        """A plain list of copies."""
        return [x if isinstance(x, float) else x.copy() for x in self]

    def __eq__(self, other: object) -> Any:
        if not isinstance(other, Rows):
            return NotImplemented
        return self._kind is other._kind and np.array_equal(self.array, other.array, equal_nan=True)

    __hash__ = object.__hash__

    def __reduce__(self) -> tuple[Any, ...]:
        return Rows, (self.array, self._kind)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.tolist()!r})"
