"""Builtins of functions that are no programs: an entry of ``compiled.entries`` with the arguments and result of a plan.

A routine is written once, as a function; each caller binds it to words, which are sizes and addresses, and gets a
builtin.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from ....algebra.scalars import inline
from ... import object_layout as layout
from ...compiled.entries import Entry, entry_of
from ...compiled.memory import Argument, Place
from ..llvm.call_words import ARRAY, CHOICE, FIXED, INDEX, NUMBER, PLACED, TRUTH
from . import single_call
from .single_call import Item, Parameter, unavailable

Shape = tuple[int | str, ...]  # numbers, or names of words


class Index(NamedTuple):
    """An int from 0 to below a word."""

    below: str


class Choice(NamedTuple):
    """One of the objects whose ids are words; the routine gets its place among them."""

    words: tuple[str, ...]


class Owner(NamedTuple):
    """An object of a class that has an array in a slot; words are the address of the class and the slot's offset.

    or_array  the array itself is taken too
    """

    shape: Shape
    kind: str
    slot: str
    or_array: bool = False


class Truth(NamedTuple):
    """A result: True or False for a number other than 0 or 0."""


class Parts(NamedTuple):
    """A result: the parts of an array of three axes, a tuple of new arrays."""

    shape: Shape


Kind = Shape | Index | Choice | Owner
Result = Shape | Owner | Truth | Parts | None


def routine(output: Result = None, name: str = "", /, **inputs: Kind) -> Callable[[Callable[..., bool]], Routine]:
    """Decorator that makes a Routine of a function."""

    def made(function: Callable[..., bool]) -> Routine:
        return Routine(inline(function), inputs, output, name)

    return made


class Routine:
    """A function of one sample, which is bound to words."""

    def __init__(
        self, function: Callable[..., bool], inputs: Mapping[str, Kind], output: Result = None, name: str = ""
    ) -> None:
        """``function`` returns whether the routine applies.

        Its parameters are the inputs: arrays, numbers, places of an Index or a Choice; ``out``, the array of the
        result, if there is one; and words: an int, or a named tuple of them. A new array, float or object is returned,
        or True without an output.

        name  says what the function captures, besides other functions of compiled code
        """
        self.function, self.inputs, self.output, self._name = function, dict(inputs), output, name

    @cached_property
    def _read(self) -> tuple[list[str], list[Argument]]:
        """The words of a context, and where the arguments of the function are."""
        words: list[str] = []
        order = list(self.inputs)

        def place(word: str) -> int:
            if word not in words:
                words.append(word)
            return words.index(word)

        def argument(x: str, hint: Any) -> Argument:
            if x == "out":
                return Argument(Place.OUTPUT, (0,), extents(self.output))
            if x in order:
                return Argument(Place.INPUT, (order.index(x),), extents(self.inputs[x]))
            fields = getattr(hint, "_fields", None)
            return Argument(Place.WORDS, tuple(map(place, fields or [x])), record=hint if fields else None)

        def extents(kind: Kind | Result) -> tuple[int, ...] | None:
            if isinstance(kind, (Index, Choice)):
                return None
            shape = kind.shape if isinstance(kind, (Owner, Parts)) else () if isinstance(kind, Truth) else kind or ()
            return tuple(~place(n) if isinstance(n, str) else n for n in shape)

        hints = get_type_hints(self.function)
        hints.pop("return", None)
        return words, [argument(*x) for x in hints.items()]

    @cached_property
    def entry(self) -> Entry:
        """Its code."""
        return entry_of(self.function, self._read[1], self._name or self.function.__name__)

    def bind(
        self,
        words: Mapping[str, Any],
        *alive: Any,
        record: layout.Words | None = None,
        otherwise: Callable[..., Any] = unavailable,
    ) -> Callable[..., Any]:
        """The builtin of these words, which keeps references to the objects at their addresses.

        words      ints, arrays, which stand for their addresses, or None, which is 0; an input that is among them is
                   an array that no caller passes, of an Index or a Choice an array of that int
        record     see ``single_call.record``
        otherwise  called with the arguments where the routine does not apply
        """
        context, entry = layout.words([_word(words[x]) for x in self._read[0]], words, *alive), self.entry

        def sizes(shape: Shape) -> tuple[int, ...]:
            return tuple(words[x] if isinstance(x, str) else x for x in shape)

        def item(kind: Kind | Truth, place: Any) -> Item:
            if isinstance(kind, Truth):
                return Item(TRUTH)
            if place is not None and isinstance(kind, (Index, Choice)):
                return single_call.placed((), _word(place))
            if isinstance(kind, Index):
                return Item(INDEX, 8, (words[kind.below],))
            if isinstance(kind, Choice):
                return Item(CHOICE, 8, tuple(words[x] for x in kind.words))
            if isinstance(kind, Owner):
                return single_call.value(sizes(kind.shape), words[kind.kind], words[kind.slot], kind.or_array)
            return single_call.array(sizes(kind)) if place is None else single_call.placed(sizes(kind), _word(place))

        given = [item(kind, words.get(x)) for x, kind in self.inputs.items()]
        if isinstance(self.output, Parts):
            memory = np.empty(sizes(self.output.shape))
            result, several = single_call.placed(memory.shape, memory.ctypes.data), single_call.PARTS
        else:
            memory, several = None, single_call.ONE
            result = Item(PLACED, 0) if self.output is None else item(self.output, None)
        code = entry.words(context.ctypes.data)
        plan = single_call.plan(code, [result], given, several, (context, entry, memory), record=record)

        kinds = [
            Parameter(x, FIXED if x in words else NUMBER if kind == () else ARRAY) for x, kind in self.inputs.items()
        ]

        def python(*given: Any, **named: Any) -> Any:
            code = entry.words(context.ctypes.data)
            if plan[0] == code[0]:
                return otherwise(*given, **named)
            plan[:3] = code  # compiled by now
            return single_call.bound(otherwise, kinds, plan)(*given, **named)  # this builtin itself would be a cycle

        return single_call.bound(python, kinds, plan)


def _word(x: Any) -> int:
    found: int = 0 if x is None else x.ctypes.data if isinstance(x, np.ndarray) else x
    return found
