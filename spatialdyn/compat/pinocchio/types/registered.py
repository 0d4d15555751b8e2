"""Classes that methods of lower modules make objects of: each registers itself when it is defined."""

from __future__ import annotations

from typing import Any, ClassVar


class Registered:
    """Base of classes that modules below their own name: ``Registered.classes["Data"]``."""

    __slots__ = ()
    classes: ClassVar[dict[str, Any]] = {}

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        Registered.classes[cls.__name__] = cls
