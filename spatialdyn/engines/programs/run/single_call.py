"""Public calls of one sample as builtins of CPython: one compiled function for all calls, models and programs.

The function reads the argument objects, checks type, dtype, shape and layout, calls NumPy to make the result, and runs
a program of the model. In all other cases (batches, lists, other dtypes, bad input, samples that the program rejects, a
model's first call) it calls a Python function with the same parameters, which computes the result or raises an error.

The text of the function is in ``single_call_text``; this module makes the forms and plans, arrays of words that the
text reads.
"""

from __future__ import annotations

import ctypes
import inspect
import math
import sys
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ... import locks
from ... import object_layout as layout
from ...compiled.entries import NO_CODE as NO_CODE
from ...compiled.entries import NO_LIMIT as NO_LIMIT
from ...compiled.entries import raise_interrupt
from ...compiled.numba_settings import PLAIN
from ..llvm.call_words import (
    ARRAY,
    ARRAY_WORDS,
    EITHER,
    FIXED,
    FLOAT,
    FOLLOWED,
    MOST,
    MOST_OUTPUTS,
    MOST_WORDS,
    NOTHING,
    OUT,
    PLACED,
    PLAN,
    RECORD,
    VALUE,
    WORD,
)  # fmt: skip
from ..llvm.call_words import ONE as ONE
from ..llvm.call_words import PARTS as PARTS
from ..llvm.call_words import SEVERAL as SEVERAL
from ..llvm.host_cpu import LoadedCode, stored_code
from ..llvm.single_call_text import module

READY = layout.READY and not PLAIN  # whether builtins can be made
_lock = locks.new()


def _code(calls: int) -> LoadedCode:
    """The machine code, made only once: a second copy, made by another thread, would be freed while builtins run it."""
    with _lock:
        return _loaded(calls)


@cache
def _loaded(calls: int) -> LoadedCode:
    return stored_code(module(calls))


@cache
def _process() -> tuple[int, ...]:
    api, constants = layout.api, (None, True, False, np.ndarray)
    functions = (
        layout.array_maker(),
        *map(api, ("Py_IncRef", "Py_DecRef", "PyDict_GetItemWithError", "PyTuple_Pack")),
        layout.vectorcall(),
        *map(api, ("PyFloat_FromDouble", "PyTuple_New")),
        id(int),
        *map(api, ("PyLong_AsSsize_t", "PyErr_Clear", "PyType_GenericAlloc")),
        *map(api, ("PyObject_GetAttr", "PyObject_CallFunctionObjArgs")),
        id(raise_interrupt),
    )
    return (*map(id, constants), layout.kind(np.dtype(np.float64)), id(str), id(float), id(np.float64), *functions)


class Parameter(NamedTuple):
    """A parameter of a call, after the model: its name and kind, and whether it may be left out."""

    name: str
    kind: int
    optional: bool = False


class Following(NamedTuple):
    """How a call with data, its second argument, finds its plan in a run of it, and what follows the call; see FORM.

    data, runs, noted      class of the data, and names of its slots
    attribute              of the model
    run, library, run_plan, after, recompute  class of the runs, and names of its slots
    held, edited, made     functions; ``made`` may be None, and is ``unavailable`` if the result itself is returned
    switch                 position of the input that is ``off`` or ``on``; -1 if there is none
    """

    data: type
    runs: str
    noted: str
    attribute: str
    run: type
    library: str
    run_plan: str
    after: str
    recompute: str
    held: Callable[..., Any]
    edited: Callable[..., bool]
    made: Callable[..., Any] | None
    switch: int
    off: object
    on: object

    def words(self) -> dict[str, int]:
        """The words of a form."""
        of_data = {x: layout.slot_offset(self.data, getattr(self, x)) for x in ("runs", "noted")}
        slots = "library", "run_plan", "after", "recompute"
        of_run = {x: layout.slot_offset(self.run, getattr(self, x)) for x in slots}
        objects = {x: id(getattr(self, x)) for x in ("held", "edited", "off", "on")}
        made = 0 if self.made is unavailable else id(self.made)
        here = {"data_type": id(self.data), "attribute_name": id(self.attribute), "made": made, "switch": self.switch}
        found = {**of_data, **of_run, **objects, **here}
        return {x: found[x] for x in FOLLOWED}


def _form(
    python: Callable[..., Any],
    parameters: Sequence[Parameter],
    keys: Sequence[str],
    model: tuple[type, str] | None,
    plan: layout.Words | None,
    data: Following | None = None,
    nones: bool = False,
) -> layout.Words:
    """The words of a form; see FORM."""
    optional = [k for k, x in enumerate(parameters) if x.optional and x.kind == ARRAY]
    named = [k for k, x in enumerate(parameters) if x.kind == WORD]
    if len(parameters) > MOST or len(named) > MOST_WORDS or len(keys) != 1 << len(optional):
        raise ValueError(f"{len(parameters)} parameters, {len(named)} words and {len(keys)} keys are no form")
    first = optional[0] if optional else 0
    words = {
        "python": id(python),
        "model_type": 0 if model is None else id(model[0]),
        "plans": 0 if model is None else layout.slot_offset(*model),
        "plan": 0 if plan is None else plan.ctypes.data,
        "count": len(parameters),
        "required": sum(1 << k for k, x in enumerate(parameters) if not x.optional and x.kind != FIXED),
        "optional": first,
        "choices": sum(1 << (k - first) for k in optional),
        "named": named[0] if named else -1,
        "rest": (1 << len(named[1:])) - 1,
        "out": sum(1 << k for k, x in enumerate(parameters) if x.kind == OUT),
        "before": 0 if model is None and data is None else 1 if data is None else 2,
        "nones": int(nones),
        **(dict.fromkeys(FOLLOWED, 0) | {"switch": -1} if data is None else data.words()),
    }
    names = [sys.intern(x.name) for x in parameters]
    pairs = [word for x, name in zip(parameters, names, strict=True) for word in (id(name), x.kind)]
    pairs += [0] * (2 * MOST - len(pairs))
    return layout.words([*_process(), *words.values(), *pairs, *map(id, keys)], python, names, keys, model, plan, data)


class Item(NamedTuple):
    """What a plan says of an input or a result: its kind, bytes, and up to four words; see PLAN."""

    kind: int
    bytes: int = 8
    words: tuple[int, ...] = ()


def array(shape: tuple[int, ...], flags: int = 0, last: int = 0) -> Item:
    """An array of float64, or a float if there are no axes; ``last``: the last of the words."""
    rest = (0,) * (ARRAY_WORDS - 3 - len(shape)) + (last,)
    return Item(len(shape) | flags if shape or flags else FLOAT, 8 * math.prod(shape), (*shape, *rest))


def placed(shape: tuple[int, ...], address: int) -> Item:
    """Numbers at an address."""
    return array(shape, PLACED, address)


def value(shape: tuple[int, ...], kind: int, slot: int, or_array: bool = False) -> Item:
    """An object that holds an array in the slot at an offset; ``kind`` is the address of its class.

    or_array  the array itself is taken too
    """
    sizes = (*shape, *[0] * (ARRAY_WORDS - 4 - len(shape)))
    return Item(len(shape) | VALUE | EITHER * or_array, 8 * math.prod(shape), (*sizes, kind, slot))


Described = Item | tuple[int, ...] | None


def _array_words(x: Described) -> list[int]:
    """The words of an Item, of an array of that shape, or of no input (None)."""
    found = Item(NOTHING) if x is None else x if isinstance(x, Item) else array(x)
    return [found.kind, found.bytes, *found.words, *[0] * (ARRAY_WORDS - 2 - len(found.words))]


def plan(
    program: tuple[int, int, int],
    outputs: Sequence[Described],
    inputs: Sequence[Described],
    several: int = ONE,
    alive: object = None,
    shared: int = 0,
    record: layout.Words | None = None,
) -> layout.Words:
    """The words of a plan.

    program  (entry, context, left) of a compiled program, see PLAN
    outputs  results of one sample: shapes, () for a float, or Items
    inputs   for each parameter the same, or None if it is no input; the last ones may lack
    several  whether the results are a tuple, also if there is one result; or PARTS
    alive    the objects at the addresses
    shared   address of the three words that the call reads in place of ``program``
    record   the words of a ``record``
    """
    words = [*program, shared, len(outputs), int(several), 0 if record is None else record.ctypes.data]
    for x in [*outputs, *[None] * (MOST_OUTPUTS - len(outputs)), *inputs, *[None] * (MOST - len(inputs))]:
        words += _array_words(x)
    made = layout.words(words, alive, record)
    made[PLAN.index("program")] = shared or made.ctypes.data
    return made


def record(**words: int) -> layout.Words:
    """The words of a record; see RECORD."""
    return layout.words([words.get(name, 0) for name in RECORD])


def copy_entry() -> int:
    """The address of an entry that copies its input to its output; its context is the number of bytes."""
    return _code(0).address("copy_entry")


def unavailable(*arguments: Any, **named: Any) -> None:
    """Return None: the function that a builtin calls, or in its place, if the caller has another way."""


def exhausted(made: layout.Words) -> bool:
    """Whether a plan's program answers no more calls."""
    return not layout.words_at(int(made[PLAN.index("left")]), 1)[0]


def change(made: layout.Words, program: tuple[int, int, int], alive: object) -> None:
    """Change a plan to another program with the same results; the caller holds the GIL."""
    made.alive = (*made.alive, alive)
    made[: len(program)] = program


def builtin(
    k: int,
    count: int,
    python: Callable[..., Any],
    parameters: Sequence[Parameter],
    keys: Sequence[str],
    model: type | None,
    data: Following | None = None,
    signature: str = "",
    nones: bool = False,
) -> Callable[..., Any]:
    """The builtin of call ``k`` of ``count``, with a Python function's name, signature and docstring.

    keys       for each choice of optional inputs: of a plan in the slot ``_plans`` of a model, or of a run of data
    model      class of its first argument; None for one with data
    signature  parameters in the docstring; those of the Python function if empty
    nones      whether None is a value like others, not what is left out
    """
    form = _form(python, parameters, keys, None if model is None else (model, "_plans"), None, data, nones)
    layout.never_free(form)  # the function is never freed either
    ctypes.cast(_forms_of(count), ctypes.POINTER(ctypes.c_int64))[k] = form.ctypes.data
    doc = f"{python.__name__}{signature or inspect.signature(python)}\n--\n\n{python.__doc__}"
    make = layout.maker(python.__name__, _code(count).address(f"call_{k}"), python.__module__, doc, keywords=True)
    return make()


@cache
def _forms_of(count: int) -> int:
    get = ctypes.CFUNCTYPE(ctypes.c_int64)(_code(count).address("forms_address"))
    return int(get())


def bound(python: Callable[..., Any], parameters: Sequence[Parameter], made: layout.Words) -> Callable[..., Any]:
    """The builtin of one plan, without a model."""
    form = _form(python, parameters, ("",), None, made)
    return _maker_of_bound()(form)


@cache
def _maker_of_bound() -> Callable[..., Callable[..., Any]]:
    """What makes all builtins of one plan: a maker is never freed."""
    return layout.maker("call", _code(0).address("bound_call"), keywords=True)


def plan_of(call: Callable[..., Any]) -> layout.Words | None:
    """The plan of a ``bound`` builtin; None of another function."""
    form = getattr(call, "__self__", None)
    found: layout.Words | None = form.alive[4] if type(form) is layout.Words else None
    return found
