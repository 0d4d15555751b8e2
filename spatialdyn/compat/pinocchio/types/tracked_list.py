"""Lists and copies of values that notify an owner of writes by its ``changed()``.

SE3, Motion, Force, Inertia, Frame and joint models have a slot ``_owner``, None without an owner; each method that
writes one ends with ``if self._owner is not None: self._owner.changed()``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from .arguments import ArgumentError
from .value import Value as Numbers

Value = TypeVar("Value")


def owned_copy(value: Value, owner: Any) -> Value:
    """A copy of a value that notifies the owner of writes."""
    copy: Any = value.copy()  # type: ignore[attr-defined]
    copy._owner = owner
    return copy  # type: ignore[no-any-return]


class OwnedList(list[Value]):
    """A list of values of one type that belong to an owner; values put in are copied.

    It calls ``changed()`` of the owner when an entry is replaced, added, or written in place.
    """

    def __init__(self, owner: Any, kind: type | tuple[type, ...], values: Iterable[Value] = ()) -> None:
        super().__init__()
        self._owner, self._kind = owner, kind
        self._put: Callable[[Value], None] = super().append
        for value in values:
            self._put(self._own(value))

    def _own(self, value: Value) -> Value:
        if not isinstance(value, self._kind):
            kinds = self._kind if isinstance(self._kind, tuple) else (self._kind,)
            raise ArgumentError(
                f"a {type(value).__name__} was given, expected {' or '.join(kind.__name__ for kind in kinds)}"
            )
        return owned_copy(value, self._owner) if hasattr(value, "_owner") else value

    def __setitem__(self, at: Any, value: Any) -> None:
        """Replace an entry; a Value is written in place, so that references to it see the new numbers."""
        there = self[at]
        if isinstance(there, Numbers) and type(there) is type(value):
            there._x[...] = value._x
            there._owner.changed()
        else:
            super().__setitem__(at, [*map(self._own, value)] if isinstance(at, slice) else self._own(value))
            self._owner.changed()

    def __delitem__(self, at: Any) -> None:
        super().__delitem__(at)
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

    def tolist(self) -> list[Value]:
        """The entries as a plain list."""
        return list(self)

    def reserve(self, size: int) -> None:
        """Do nothing: a list grows by itself."""

    def copy(self) -> list[Value]:
        """A plain list of copies."""
        return [x.copy() if hasattr(x, "copy") else x for x in self]

    def id(self) -> int:
        """The identity of this object."""
        return id(self)
