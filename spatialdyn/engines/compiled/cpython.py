"""Compiled functions with the calling convention of CPython's builtins, made of text by Numba.

What a function needs beside its arguments is its *plan*, an array of addresses and sizes that it gets as ``self``. A
function whose argument checks fail returns None and sets no error: the caller falls back to a call that names the
fault. Where ``READY`` is False (see ``object_layout``) every function made here returns None.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, types  # type: ignore[attr-defined]
from numba.extending import intrinsic
from numpy.lib.stride_tricks import as_strided

from ...algebra.scalars import inline
from ...recursions.spec import Spec
from .. import object_layout as layout
from ..object_layout import ALIGNED, DATA, DOUBLE, DTYPE, FLAGS, ITEMS, KIND, RANK, SAME, SHAPE, STRIDES, TYPE
from . import jit, numba_kernels

F8 = np.float64
HEAD = ("none", "true", "ndarray", "float64", "integer", "real", "new", "up", "down", "as_size", "forget",
        "allocate", "from_double")  # fmt: skip
NONE, TRUE, NDARRAY, FLOAT64, INTEGER, REAL, MAKE, UP, DOWN, AS_SIZE, FORGET, ALLOCATE, FROM_DOUBLE = range(len(HEAD))
READY = layout.READY and not numba_kernels.PLAIN
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


def _kernel_call(typing_context: Any, kernel: Any, table: Any, arrays: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kinds, convention = [types.intp, *signature.args[2]], context.call_conv
        function = convention.get_function_type(types.int64, kinds).as_pointer()
        passed = [values[1], *(builder.extract_value(values[2], k) for k in range(len(kinds) - 1))]
        status, found = convention.call_function(
            builder, builder.inttoptr(values[0], function), types.int64, kinds, passed
        )
        with builder.if_then(status.is_error, likely=False):
            convention.return_status_propagate(builder, status)
        return found

    return types.int64(types.intp, types.intp, arrays), generate


_make: Any = _call(_WORD, _WORD, _HALF, _WORD, _HALF, _WORD, _WORD, _HALF, _HALF, _WORD)
_count: Any = _call(ir.VoidType(), _WORD)
_size: Any = _call(_WORD, _WORD)
_void: Any = _call(ir.VoidType())
_allocate: Any = _call(_WORD, _WORD, _WORD)
_from_double: Any = intrinsic(_real_call)
real_function: Any = intrinsic(_real_function)  # (address, word) -> float64 of a C function
run_kernel: Any = intrinsic(_kernel_call)  # (address, table, arrays) -> status of a ``sample_kernel``
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
    if k == -1:  # -1, or an overflow, which sets an error
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
    """A new float64 array in C order, its shape at an address; 0 if there is no memory."""
    return _make(word(plan, MAKE), (word(plan, NDARRAY), rank, shape, DOUBLE, 0, 0, 0, 0, 0))


@inline
def new_real(plan: int, x: float) -> Any:
    """A new float; 0 if there is no memory."""
    return _from_double(word(plan, FROM_DOUBLE), x)


@inline
def new_object(plan: int, kind: int, slot: int, x: int) -> Any:
    """A new object of a class, whose slot at that offset takes over the new object x; 0 if there is no memory."""
    made = _allocate(word(plan, ALLOCATE), (kind, 0))
    if made == 0:
        _count(word(plan, DOWN), (x,))
        return made
    places(made + slot, 1)[0] = x
    return made


@inline
def new_tuple(plan: int, kind: int, x: int, shape: int) -> Any:
    """A new tuple of new arrays with the numbers (..., m, n) at address x, their shape at another; 0 if no memory."""
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
    """Release a new object; a new reference to None, which is returned in its place."""
    _count(word(plan, DOWN), (x,))
    return return_none(plan)


SCOPE: dict[str, Any] = {
    "word": word, "at": at, "places": places, "is_vector": is_vector, "is_matrix": is_matrix, "vector": vector,
    "no_overlap": no_overlap, "matrix": matrix, "index": index, "is_real": is_real, "real": real,
    "new_array": new_array, "new_real": new_real, "new_object": new_object, "new_tuple": new_tuple,
    "return_none": return_none, "return_true": return_true, "discard": discard, "run_kernel": run_kernel,
}  # fmt: skip


@cache
def kernel_address(spec: Spec) -> int:
    """The address of the machine code of a ``sample_kernel``, for ``run_kernel``."""
    kernel: Any = numba_kernels.sample_kernel(spec)
    (made,) = kernel.overloads.values()
    address: int = made.library.get_pointer_to_function(made.fndesc.llvm_func_name)
    return address


@cache
def _head() -> list[int]:
    """The words that all plans begin with."""
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
    """The function where no builtin can be made: returns None."""


class Builtin:
    """A compiled function, to be bound to plans."""

    def __init__(
        self,
        label: str,
        arguments: Sequence[str],
        words: Sequence[str],
        body: Sequence[str],
        scope: Mapping[str, Any],
        optional: int = 0,
    ) -> None:
        """A function of ``arguments``, addresses of objects; its ``body`` names the words of a plan.

        The body returns ``new_array(...)``, ``return_true(plan)`` or ``return_none(plan)``; 0 if it has set a Python
        error. An exception that it raises becomes a SystemError. Of the last ``optional`` arguments a call may pass
        the first ones; the others are 0.
        """
        self.words = tuple(words)
        least, most = len(arguments) - optional, len(arguments)
        text = ["stamp", f"plan = word(self, {DATA})", f"if n < {least} or n > {most}: return return_none(plan)"]
        text += [f"{name} = word(plan, {len(HEAD) + k})" for k, name in enumerate(words)]
        for k, name in enumerate(arguments):
            text.append(f"{name} = word(args, {k})" if k < least else f"{name} = word(args, {k}) if n > {k} else 0")
        function = numba_kernels.kernel_from_text(
            f"builtin_{label}", ["self", "args", "n"], [*text, *body], {**SCOPE, **scope}
        )
        dispatcher: Any = jit.numba_jit(function, nogil=False, from_c=True)
        signature = (types.intp, types.intp, types.intp)
        dispatcher.compile(signature)
        made = dispatcher.overloads[signature]
        self._code = dispatcher  # keeps the code in memory
        address = made.library.get_pointer_to_function(made.fndesc.llvm_cfunc_wrapper_name)
        self._make = layout.maker(label, address)

    def bind(self, *alive: Any, **words: int) -> Callable[..., Any]:
        """The function with a plan, ``function.__self__``, which keeps a reference to what its words point at."""
        given = [words.pop(name) for name in self.words]
        if words:
            raise TypeError(f"a plan has no words {sorted(words)}, expected {', '.join(self.words)}")
        return self._make(layout.words([*_head(), *given], self, *alive))


def retarget(function: Any, model: Any) -> None:
    """Point the plan of a builtin to the table of another model of the same sizes, if it has one."""
    plan = getattr(function, "__self__", None)
    if isinstance(plan, layout.Words) and plan.alive[0].words[:1] == ("table",):
        plan[len(HEAD)] = model.address
        plan.alive = (plan.alive[0], model, *plan.alive[2:])


def dims(words: Sequence[str], first: str) -> str:
    """Address of the word ``first`` in a plan, as text for a body: the shape of a new array."""
    return f"plan + {8 * (len(HEAD) + list(words).index(first))}"
