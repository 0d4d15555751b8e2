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
from ..llvm.host_cpu import LoadedCode, stored_code
from ..llvm.single_call_text import (
    ARRAY,
    ARRAY_WORDS,
    MOST,
    MOST_OUTPUTS,
    MOST_WORDS,
    OUT,
    PLAN,
    WORD,
    module,
)

NO_LIMIT = np.array([1 << 62])  # a counter of calls
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
    )
    return (*map(id, constants), layout.kind(np.dtype(np.float64)), id(str), id(float), id(np.float64), *functions)


class Parameter(NamedTuple):
    """A parameter of a call, after the model: its name and kind, and whether it may be left out."""

    name: str
    kind: int
    optional: bool = False


def _form(
    python: Callable[..., Any],
    parameters: Sequence[Parameter],
    keys: Sequence[str],
    model: tuple[type, str] | None,
    plan: layout.Words | None,
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
        "required": sum(1 << k for k, x in enumerate(parameters) if not x.optional),
        "optional": first,
        "choices": sum(1 << (k - first) for k in optional),
        "named": named[0] if named else -1,
        "rest": (1 << len(named[1:])) - 1,
        "out": sum(1 << k for k, x in enumerate(parameters) if x.kind == OUT),
    }
    names = [sys.intern(x.name) for x in parameters]
    pairs = [word for x, name in zip(parameters, names, strict=True) for word in (id(name), x.kind)]
    pairs += [0] * (2 * MOST - len(pairs))
    return layout.words([*_process(), *words.values(), *pairs, *map(id, keys)], python, names, keys, model, plan)


def _array_words(shape: tuple[int, ...] | None) -> list[int]:
    """The words of an array of float64, of a float (no axes), or of a parameter that is no array (None)."""
    if shape is None:
        return [-2, *[0] * (ARRAY_WORDS - 1)]
    found = [len(shape) if shape else -1, 8 * math.prod(shape), *shape]
    return [*found, *[0] * (ARRAY_WORDS - len(found))]


def plan(
    program: tuple[int, int, int],
    outputs: Sequence[tuple[int, ...]],
    inputs: Sequence[tuple[int, ...] | None],
    several: bool = False,
    alive: object = None,
) -> layout.Words:
    """The words of a plan.

    program  (entry, context, left) of a compiled program, see PLAN
    outputs  shapes of the results of one sample, () for a float
    inputs   for each parameter the shape of one sample, () for a float, None if it is no input; the last ones may lack
    several  whether the results are a tuple, also if there is one result
    alive    the objects at the addresses
    """
    words = [*program, len(outputs), int(several)]
    for shape in outputs:
        words += _array_words(shape)
    words += _array_words(None) * (MOST_OUTPUTS - len(outputs))
    for given in [*inputs, *[None] * (MOST - len(inputs))]:
        words += _array_words(given)
    return layout.words(words, alive)


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
    model: type,
) -> Callable[..., Any]:
    """The builtin of call ``k`` of ``count``, with a Python function's name, signature and docstring.

    keys   keys of its plans in the slot ``_plans`` of a model, one for each choice of optional inputs
    model  class of its first argument
    """
    form = _form(python, parameters, keys, (model, "_plans"), None)
    layout.never_free(form)  # the function is never freed either
    ctypes.cast(_forms_of(count), ctypes.POINTER(ctypes.c_int64))[k] = form.ctypes.data
    doc = f"{python.__name__}{inspect.signature(python)}\n--\n\n{python.__doc__}"
    make = layout.maker(python.__name__, _code(count).address(f"call_{k}"), python.__module__, doc, keywords=True)
    return make()


@cache
def _forms_of(count: int) -> int:
    get = ctypes.CFUNCTYPE(ctypes.c_int64)(_code(count).address("forms_address"))
    return int(get())


def bound(python: Callable[..., Any], parameters: Sequence[Parameter], made: layout.Words) -> Callable[..., Any]:
    """The builtin of one plan, without a model."""
    form = _form(python, parameters, ("",), None, made)
    return layout.maker("call", _code(0).address("bound_call"), keywords=True)(form)
