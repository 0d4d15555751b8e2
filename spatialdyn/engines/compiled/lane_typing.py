"""How Numba types our kernels: named tuples of numbers become those of lanes where two paths meet.

Numba gives no common type to two named tuples of one class. Our pipelines type a function in a copy of Numba's typing
context that does; Numba's own context and types, which a user's functions have, stay as they are.
"""

from __future__ import annotations

from copy import copy
from functools import cache
from typing import Any

from numba import types
from numba.core import cgutils
from numba.core.compiler import Compiler, CompilerBase
from numba.extending import lower_cast

_NAMED: Any = types.BaseNamedTuple
_TUPLE: Any = types.BaseTuple


@cache
def _class_of(base: Any) -> Any:
    """The class of the copy of a typing context."""

    class Typing(base):  # type: ignore[misc]
        def unify_pairs(self, first: Any, second: Any) -> Any:
            """The common type of two types, or None."""
            if (
                not isinstance(first, _NAMED)
                or not isinstance(second, _NAMED)
                or first.instance_class is not second.instance_class
            ):
                return super().unify_pairs(first, second)
            parts = [self.unify_pairs(a, b) for a, b in zip(first, second, strict=True)]
            return None if None in parts else _TUPLE.from_types(parts, first.instance_class)

        def can_convert(self, fromty: Any, toty: Any) -> Any:
            """How a type converts to another, or None; a named tuple to the common type of it and others."""
            if fromty != toty and isinstance(toty, _NAMED) and self.unify_pairs(fromty, toty) == toty:
                return max(self.can_convert(a, b) for a, b in zip(fromty, toty, strict=True))
            return super().can_convert(fromty, toty)

    return Typing


class Typed(CompilerBase):
    """A pipeline whose functions are typed in such a copy, which shares what Numba registers in its context."""

    def __init__(self, typingctx: Any, *rest: Any) -> None:
        """Set up as every pipeline is."""
        super().__init__(typingctx, *rest)  # type: ignore[no-untyped-call]
        self.state.typingctx = shared = copy(typingctx)
        base: Any = type(typingctx)
        shared.__class__ = _class_of(base)


class TypedAsNumba(Typed, Compiler):
    """Numba's own pipeline, in such a copy."""


WITHOUT_PASSES: dict[str, Any] = {
    "inline": TypedAsNumba,
    "inline_unoptimized": TypedAsNumba,
}  # where ``inlining`` cannot be imported


@lower_cast(_NAMED, _NAMED)  # type: ignore[no-untyped-call, untyped-decorator]
def _cast(context: Any, builder: Any, given: Any, kind: Any, x: Any) -> Any:
    parts = cgutils.unpack_tuple(builder, x, len(given))  # type: ignore[no-untyped-call]
    return context.make_tuple(
        builder, kind, [context.cast(builder, p, a, b) for p, a, b in zip(parts, given, kind, strict=True)]
    )
