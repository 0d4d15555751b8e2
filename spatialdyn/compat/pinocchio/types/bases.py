"""Bases of classes: those that modules below them make objects of, those that copy themselves, those with an owner."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import Any, ClassVar


class Registered:
    """Base of classes that modules below their own name: ``Registered.classes["Data"]``."""

    __slots__ = ()
    classes: ClassVar[dict[str, Any]] = {}

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        Registered.classes[cls.__name__] = cls


class Copied:
    """Base of what ``copy.copy`` and ``copy.deepcopy`` copy by its own ``copy()``."""

    __slots__ = ()
    copy: Any

    def __copy__(self) -> Any:
        return self.copy()

    def __deepcopy__(self, memo: Any) -> Any:
        return self.copy()


class Owner:
    """An owner of values: ``changed()`` is called after each write of one of them."""

    __slots__ = ("changed",)

    def __init__(self, changed: Callable[[], None]) -> None:
        self.changed = changed


class OwnedValue(Copied):
    """Base of what may belong to an owner, such as a model: ``_owner``, None without one, is notified of writes."""

    __slots__ = ()
    _owner: Any = None

    def changed(self) -> None:
        """Notify the owner, if any, of a write."""
        if self._owner is not None:
            self._owner.changed()


def owned_attribute(slot: str, check: Callable[[Any, Any], Any], doc: str, read: Any = None) -> Any:
    """An attribute kept in a slot as ``check(value, self)``, read as ``read`` of it; assigning notifies the owner."""

    def write(self: Any, value: Any) -> None:
        setattr(self, slot, check(value, self))
        self.changed()

    get = attrgetter(slot)
    return property(get if read is None else lambda self: read(get(self)), write, doc=doc)
