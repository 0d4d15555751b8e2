"""Functions with the calling convention of CPython's builtins, generated as text and compiled by Numba once that pays.

Besides its arguments a function gets its *plan* as ``self``: an array of addresses and sizes. A function whose argument
checks fail returns None and sets no error: the caller falls back to a call that names the fault. Where ``READY`` is
False (see ``object_layout``) every function made here returns None. Until compiling pays (see ``tiers``) the same text
runs in plain Python.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from types import FunctionType
from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, types  # type: ignore[attr-defined]
from numba.extending import intrinsic
from numpy.lib.stride_tricks import as_strided

from ...algebra.scalars import inline
from .. import object_layout as layout
from ..object_layout import ALIGNED, DATA, DOUBLE, DTYPE, FLAGS, ITEMS, KIND, RANK, SAME, SHAPE, STRIDES, TYPE
from . import jit, numba_kernels, tiers
from .numba_settings import PLAIN
from .tiers import Tier, scope_in

F8 = np.float64
HEAD = ("none", "true", "ndarray", "float64", "integer", "real", "new", "up", "down", "as_size", "forget",
        "allocate", "from_double")  # fmt: skip
NONE, TRUE, NDARRAY, FLOAT64, INTEGER, REAL, MAKE, UP, DOWN, AS_SIZE, FORGET, ALLOCATE, FROM_DOUBLE = range(len(HEAD))
READY = layout.READY and not PLAIN
_HALF, _WORD = ir.IntType(32), ir.IntType(64)


# --- functions of compiled code -----------------------------------------------------------------------


def _call(result: Any, *given: Any) -> Any:
    """An intrinsic ``(address, *words) -> word`` that calls a C function of this type."""

    def at(typing_context: Any, address: Any, arguments: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            function = builder.inttoptr(values[0], ir.FunctionType(result, given).as_pointer())
            passed = [builder.extract_value(values[1], k) for k in range(len(given))]
            narrow = [x if kind == _WORD else builder.trunc(x, kind) for x, kind in zip(passed, given, strict=True)]
            made = builder.call(function, narrow)
            return _WORD(0) if isinstance(result, ir.VoidType) else made

        several: Any = types.UniTuple
        return types.intp(types.intp, several(types.intp, len(given))), generate

    return intrinsic(at)


def _real_call(typing_context: Any, address: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        function = ir.FunctionType(_WORD, [ir.DoubleType()]).as_pointer()
        return builder.call(builder.inttoptr(values[0], function), [values[1]])

    return types.intp(types.intp, types.float64), generate


def _real_function(typing_context: Any, address: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        function = ir.FunctionType(ir.DoubleType(), [_WORD]).as_pointer()
        return builder.call(builder.inttoptr(values[0], function), [values[1]])

    return types.float64(types.intp, types.intp), generate


def _word_at(typing_context: Any, base: Any, k: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(builder.gep(builder.inttoptr(arguments[0], _WORD.as_pointer()), [arguments[1]]))

    return types.int64(types.intp, types.intp), generate


_make: Any = _call(_WORD, _WORD, _HALF, _WORD, _HALF, _WORD, _WORD, _HALF, _HALF, _WORD)
_count: Any = _call(ir.VoidType(), _WORD)
_size: Any = _call(_WORD, _WORD)
_void: Any = _call(ir.VoidType())
_allocate: Any = _call(_WORD, _WORD, _WORD)
_from_double: Any = intrinsic(_real_call)
real_function: Any = intrinsic(_real_function)  # (address, word) -> float64 of a C function
word: Any = intrinsic(_word_at)
_pointer = jit.pointer


@inline
def at(address: int, shape: tuple[int, ...]) -> Any:
    """Array of float64 at an address, in C order."""
    return carray(_pointer(address), shape, F8)


@inline
def places(address: int, count: int) -> Any:
    """Array of indices at an address."""
    return carray(_pointer(address), (count,), np.intp)


@inline
def advance(address: int) -> None:
    """Add 1 to the counter at an address."""
    places(address, 1)[0] += 1


@inline
def is_float64(plan: int, x: int) -> Any:
    """Whether an array is of float64 in native byte order."""
    return word(word(x, DTYPE), KIND) & SAME == word(plan, FLOAT64)


@inline
def is_vector(plan: int, x: int, size: int) -> Any:
    """Whether an object is a float64 array (size,)."""
    return (
        word(x, TYPE) == word(plan, NDARRAY)
        and is_float64(plan, x)
        and word(x, RANK) & 0xFFFFFFFF == 1
        and word(word(x, SHAPE), 0) == size
        and word(x, FLAGS) & ALIGNED != 0
    )


@inline
def is_matrix(plan: int, x: int, columns: int) -> Any:
    """Whether an object is a float64 array (..., columns) of two axes."""
    return (
        word(x, TYPE) == word(plan, NDARRAY)
        and is_float64(plan, x)
        and word(x, RANK) & 0xFFFFFFFF == 2
        and word(word(x, SHAPE), 1) == columns
        and word(x, FLAGS) & ALIGNED != 0
    )


@inline
def vector(x: int, size: int) -> Any:
    """View of an array that ``is_vector`` accepts, of any stride."""
    return as_strided(at(word(x, DATA), (size,)), (size,), (word(word(x, STRIDES), 0),))


@inline
def no_overlap(x: int, size: int, first: int, count: int) -> Any:
    """Whether an array that ``is_vector`` accepts shares no memory with ``count`` numbers at address ``first``."""
    one = word(x, DATA)
    other = one + word(word(x, STRIDES), 0) * (size - 1)
    return size == 0 or max(one, other) + 8 <= first or min(one, other) >= first + 8 * count


@inline
def matrix(x: int) -> Any:
    """View of an array that ``is_matrix`` accepts."""
    shape = (word(word(x, SHAPE), 0), word(word(x, SHAPE), 1))
    return as_strided(at(word(x, DATA), shape), shape, (word(word(x, STRIDES), 0), word(word(x, STRIDES), 1)))


@inline
def index(plan: int, x: int, count: int) -> Any:
    """The value of an int from 0 to count - 1; -1 for any other object."""
    if word(x, TYPE) != word(plan, INTEGER):
        return -1
    k = _size(word(plan, AS_SIZE), (x,))
    if k == -1:  # the value -1, or an overflow, which sets an error
        _void(word(plan, FORGET), ())
    return k if 0 <= k < count else -1


@inline
def is_real(plan: int, x: int) -> Any:
    """Whether an object is a float."""
    return word(x, TYPE) == word(plan, REAL)


@inline
def real(x: int) -> Any:
    """The value of a float: its word DATA."""
    return at(x + 8 * DATA, (1,))[0]


@inline
def new_array(plan: int, rank: int, shape: int) -> Any:
    """A new float64 array in C order, with its shape read at address ``shape``; 0 if there is no memory."""
    return _make(word(plan, MAKE), (word(plan, NDARRAY), rank, shape, DOUBLE, 0, 0, 0, 0, 0))


@inline
def new_real(plan: int, x: float) -> Any:
    """A new float; 0 if there is no memory."""
    return _from_double(word(plan, FROM_DOUBLE), x)


@inline
def new_object(plan: int, kind: int, slot: int, x: int) -> Any:
    """A new object of a class; its slot at offset ``slot`` takes over the new object x; 0 if there is no memory."""
    made = _allocate(word(plan, ALLOCATE), (kind, 0))
    if made == 0:
        _count(word(plan, DOWN), (x,))
        return made
    places(made + slot, 1)[0] = x
    return made


@inline
def new_tuple(plan: int, kind: int, x: int, shape: int) -> Any:
    """A new tuple of count new arrays (m, n) from the numbers at address x; 0 if there is no memory.

    shape  address of the words count, m, n
    """
    count, size = word(shape, 0), word(shape, 1) * word(shape, 2)
    made = _allocate(word(plan, ALLOCATE), (kind, count))
    for k in range(count if made != 0 else 0):
        part = new_array(plan, 2, shape + 8)
        if part == 0:
            _count(word(plan, DOWN), (made,))
            return part
        numbers = at(word(part, DATA), (size,))
        numbers[:] = at(x + 8 * size * k, (size,))
        places(made, ITEMS + k + 1)[ITEMS + k] = part
    return made


@inline
def return_none(plan: int) -> Any:
    """A new reference to None."""
    _count(word(plan, UP), (word(plan, NONE),))
    return word(plan, NONE)


@inline
def return_true(plan: int) -> Any:
    """A new reference to True."""
    _count(word(plan, UP), (word(plan, TRUE),))
    return word(plan, TRUE)


@inline
def discard(plan: int, x: int) -> Any:
    """Release a new object; returns a new reference to None in its place."""
    _count(word(plan, DOWN), (x,))
    return return_none(plan)


SCOPE: dict[str, Any] = {
    "word": word, "at": at, "places": places, "is_vector": is_vector, "is_matrix": is_matrix, "vector": vector,
    "no_overlap": no_overlap, "matrix": matrix, "index": index, "is_real": is_real, "real": real,
    "new_array": new_array, "new_real": new_real, "new_object": new_object, "new_tuple": new_tuple,
    "advance": advance, "return_none": return_none, "return_true": return_true, "discard": discard,
}  # fmt: skip


@cache
def _plain() -> dict[str, Any]:
    """The functions above in plain Python: the same source, with plain Python's meaning of native functions."""
    native: dict[str, Any] = {"word": tiers.word, "at": lambda address, shape: tiers.array_of(address, shape, F8)}
    native |= {"advance": tiers.advance, "places": lambda address, count: tiers.array_of(address, (count,), np.intp)}
    native |= dict.fromkeys(("_make", "_size", "_allocate"), tiers.call_words)
    native |= {"_count": tiers.call_void, "_void": tiers.call_void, "_from_double": tiers.call_real}
    scope = {**globals(), **native}
    for name, function in {"is_float64": is_float64, **SCOPE}.items():
        if name not in native:
            scope[name] = FunctionType(function.__code__, scope, name)
    return {name: scope[name] for name in SCOPE}


@cache
def _head() -> list[int]:
    """The first words of every plan."""
    constants: list[object] = [None, True, np.ndarray]
    heads = [*map(id, constants), layout.kind(np.dtype(F8)), id(int), id(float)]
    functions = (
        "Py_IncRef",
        "Py_DecRef",
        "PyLong_AsSsize_t",
        "PyErr_Clear",
        "PyType_GenericAlloc",
        "PyFloat_FromDouble",
    )
    return [*heads, layout.array_maker(), *map(layout.api, functions)]


# --- functions -------------------------------------------------------------------------------------------


def unavailable(*arguments: Any) -> None:
    """The function used if no builtin can be made: returns None."""


_SIGNATURE = (types.intp, types.intp, types.intp)


class _OfWords(Tier):
    """A function of three words that returns a word, generated as text."""

    def __init__(self, name: str, words: Sequence[str], text: Sequence[str], scope: Mapping[str, Any]) -> None:
        super().__init__()
        self._made_of = name, list(words), list(text)
        self._scope = scope
        self._dispatcher: Any = None

    def _function(self, plain: bool) -> Callable[..., Any]:
        scope = {**(_plain() if plain else SCOPE), **scope_in(plain, self._scope)}
        return numba_kernels.kernel_from_text(*self._made_of, scope)

    def _is_stored(self, *arguments: Any) -> bool:
        jitted: Any = jit.numba_jit(self._function(plain=True), nogil=False, from_c=True, contract=False)
        return tiers.is_stored(jitted, _SIGNATURE)

    def _compiled_address(self) -> int:
        """Compile the function; returns its address."""
        self._dispatcher = jit.numba_jit(self._function(plain=False), nogil=False, from_c=True, contract=False)
        self._dispatcher.compile(_SIGNATURE)
        made = self._dispatcher.overloads[_SIGNATURE]
        address: int = made.library.get_pointer_to_function(made.fndesc.llvm_cfunc_wrapper_name)
        return address


class Builtin(_OfWords):
    """A function that is bound to plans."""

    def __init__(
        self,
        label: str,
        arguments: Sequence[str],
        words: Sequence[str],
        body: Sequence[str],
        scope: Mapping[str, Any],
        optional: int = 0,
    ) -> None:
        """A function of ``arguments``, which are addresses of objects; its ``body`` names the words of a plan.

        The body returns ``new_array(...)``, ``return_true(plan)`` or ``return_none(plan)``, or 0 after it has set a
        Python error. An exception that it raises becomes a SystemError. A call may leave out some of the last
        ``optional`` arguments, from the end; they are then 0. Values in the scope may be of type Twin.
        """
        self.words = tuple(words)
        least, most = len(arguments) - optional, len(arguments)
        text = ["stamp", f"plan = word(self, {DATA})", f"if n < {least} or n > {most}: return return_none(plan)"]
        text += [f"{name} = word(plan, {len(HEAD) + k})" for k, name in enumerate(words)]
        for k, name in enumerate(arguments):
            text.append(f"{name} = word(args, {k})" if k < least else f"{name} = word(args, {k}) if n > {k} else 0")
        super().__init__(f"builtin_{label}", ["self", "args", "n"], [*text, *body], scope)
        self._label = label
        self._plain: Any = None

    def _compile(self) -> Callable[..., Any]:
        return layout.maker(self._label, self._compiled_address())

    def interpret(self, plan: layout.Words, given: tuple[Any, ...]) -> Any:
        """A call in plain Python."""
        self._plain = self._plain or self._function(plain=True)
        addresses = (ctypes.c_int64 * max(1, len(given)))(*map(id, given))
        try:
            passed = id(plan), ctypes.addressof(addresses), len(given)
            made = self.in_plain_python(self._plain, passed)
        except ArithmeticError as fault:
            raise SystemError(f"{self._label} failed in plain Python") from fault
        if not made:
            raise MemoryError(f"there is no memory for the result of {self._label}")
        found = ctypes.cast(made, ctypes.py_object).value
        ctypes.pythonapi.Py_DecRef(ctypes.py_object(found))
        return found

    def bind(self, *alive: Any, **words: int) -> Callable[..., Any]:
        """The function with a plan, ``function.__self__``, which keeps references to the objects at its addresses."""
        given = [words.pop(name) for name in self.words]
        if words:
            raise TypeError(f"a plan has no words {sorted(words)}, expected {', '.join(self.words)}")
        plan, make = layout.words([*_head(), *given], self, *alive), self.code()
        return Interpreted(self, plan) if make is None else make(plan)


class Interpreted:
    """A Builtin with a plan that is not compiled yet."""

    __slots__ = ("__self__", "_builtin", "_compiled")

    def __init__(self, builtin: Builtin, plan: layout.Words) -> None:
        """Bind a Builtin to a plan."""
        self._builtin, self.__self__ = builtin, plan
        self._compiled: Any = None

    def __call__(self, *given: Any) -> Any:
        call = self._compiled
        if call is None:
            make = self._builtin.code()
            if make is None:
                return self._builtin.interpret(self.__self__, given)
            call = self._compiled = make(self.__self__)
        return call(*given)


def dims(words: Sequence[str], first: str) -> str:
    """Address of the word ``first`` in a plan, as text for a body: the shape of a new array."""
    return f"plan + {8 * (len(HEAD) + list(words).index(first))}"
