"""Builtins of functions that are no programs: an entry of ``compiled.entries`` with the arguments and result of a plan.

A routine is written once, as statements over the words, inputs and output that it names; each caller binds it to words,
which are sizes and addresses, and gets a builtin.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

from ... import object_layout as layout
from ...compiled.entries import Entry
from ..llvm.single_call_text import ARRAY, CHOICE, FIXED, INDEX, NUMBER, PLACED, TRUTH
from . import single_call
from .single_call import Item, Parameter, unavailable

Shape = tuple[int | str, ...]  # numbers, or names of words


class Index(NamedTuple):
    """An int from 0 to below a word."""

    below: str


class Choice(NamedTuple):
    """One of the objects whose ids are words; the routine gets its place among them."""

    words: tuple[str, ...]


class Held(NamedTuple):
    """An object of a class that holds an array in a slot; words are the address of the class and the slot's offset.

    or_array  the array itself is taken too
    """

    shape: Shape
    kind: str
    slot: str
    or_array: bool = False


class Truth(NamedTuple):
    """A result: True or False for a number other than 0 or 0."""


Kind = Shape | Index | Choice | Held


class Routine:
    """A function of one sample, which is bound to words."""

    def __init__(
        self,
        name: str,
        words: Sequence[str],
        inputs: Mapping[str, Kind],
        body: Sequence[str],
        scope: Mapping[str, Any],
        output: Shape | Held | Truth | None = None,
    ) -> None:
        """Statements that end in ``return 1``, or in ``return 0`` where the routine does not apply.

        They name the words; inputs: arrays, numbers, places of an Index or a Choice; and ``out``, the array of the
        result, if there is one. A new array, float or object is returned, or True without an output. Values in the
        scope may be of type Twin.
        """
        self.words, self.inputs, self.output = tuple(words), dict(inputs), output
        text = [f"{x} = word(context, {k})" for k, x in enumerate(words)]
        for k, (x, kind) in enumerate(self.inputs.items()):
            place = f"word(inputs, {k})"
            if isinstance(kind, (Index, Choice)):
                text.append(f"{x} = word({place}, 0)")
            else:
                shape = kind.shape if isinstance(kind, Held) else kind
                text.append(f"{x} = at({place}, {_text(shape or (1,))}){'' if shape else '[0]'}")
        if output is not None:
            shape = output.shape if isinstance(output, Held) else output
            text.append(f"out = at(word(outputs, 0), {_text(shape or (1,))})")
        self._made_of = name, [*text, *body], dict(scope)

    @cached_property
    def entry(self) -> Entry:
        """Its code."""
        return Entry(*self._made_of)

    def bind(
        self,
        words: Mapping[str, int],
        *alive: Any,
        record: layout.Words | None = None,
        places: Mapping[str, int] | None = None,
        otherwise: Callable[..., Any] = unavailable,
    ) -> Callable[..., Any]:
        """The builtin of these words, which keeps references to the objects at their addresses.

        record  see ``single_call.record``
        places  addresses of inputs that no caller passes
        otherwise  called with the arguments where the routine does not apply
        """
        context = layout.words([words[x] for x in self.words], *alive)
        entry, places = self.entry, places or {}

        def sizes(shape: Shape) -> tuple[int, ...]:
            return tuple(words[x] if isinstance(x, str) else x for x in shape)

        def item(kind: Kind | Truth, place: int | None) -> Item:
            if isinstance(kind, Truth):
                return Item(TRUTH)
            if isinstance(kind, Index):
                return Item(INDEX, 8, (words[kind.below],))
            if isinstance(kind, Choice):
                return Item(CHOICE, 8, tuple(words[x] for x in kind.words))
            if isinstance(kind, Held):
                return single_call.value(sizes(kind.shape), words[kind.kind], words[kind.slot], kind.or_array)
            return single_call.array(sizes(kind)) if place is None else single_call.placed(sizes(kind), place)

        given = [item(kind, places.get(x)) for x, kind in self.inputs.items()]
        result = Item(PLACED, 0) if self.output is None else item(self.output, None)
        code = entry.words(context.ctypes.data)
        plan = single_call.plan(code, [result], given, alive=(context, entry), record=record)

        kinds = [
            Parameter(x, FIXED if x in places else NUMBER if kind == () else ARRAY) for x, kind in self.inputs.items()
        ]

        def python(*given: Any, **named: Any) -> Any:
            code = entry.words(context.ctypes.data)
            if plan[0] == code[0]:
                return otherwise(*given, **named)
            plan[:3] = code  # compiled by now
            return single_call.bound(otherwise, kinds, plan)(*given, **named)  # this builtin itself would be a cycle

        return single_call.bound(python, kinds, plan)


def _text(shape: Shape) -> str:
    return f"({', '.join(map(str, shape))},)"
