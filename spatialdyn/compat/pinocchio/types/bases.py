"""Bases of classes: those that modules below them make objects of, and those that copy themselves."""

from __future__ import annotations

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
