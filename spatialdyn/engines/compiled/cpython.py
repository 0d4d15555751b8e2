"""Compiled functions that Python calls as it calls its own builtins: no argument is unpacked that need not be.

Numba takes 0.1 µs for each array it is given and Python as much to make one for the answer; a small robot's dynamics
take 0.2. Here the compiled code gets the Python objects themselves, looks at type, size and layout where they stand,
and has NumPy make the answer. What a function knows beside its arguments is in its *plan*, an array of addresses and
sizes that comes to it as ``self``. One that is not sure of its arguments returns None, and says nothing: another way
has to find out why. Python's lock is held throughout, so nobody else touches what is looked at.

How arrays stand in memory is part of NumPy's C interface and the same since 1.0; ``READY`` says whether this
process agrees, and where it does not every function made here returns None. Of a dtype the type number and the byte
order are read, not its address: that of an array that was unpickled is another object.
"""

from __future__ import annotations

import ctypes
import platform
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, types  # type: ignore[attr-defined]
from numba.extending import intrinsic
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from ...algebra.scalars import inlined
from . import numba_kernels
from .quick_calls import _word

Array = NDArray[Any]
F8 = np.float64
TYPE, DATA, RANK, SHAPE, STRIDES, DTYPE, FLAGS = 1, 2, 3, 4, 5, 7, 8  # words of an array object
KIND = 3  # word of a dtype: kind, letter, byte order and flags, a byte each, and the type number
SAME = ~0xFF010000  # the bits in which equal dtypes agree: without flags, and "=" (0x3D) is "<" (0x3C)
FASTCALL = 0x80  # METH_FASTCALL
ALIGNED = 0x100  # NPY_ARRAY_ALIGNED
NEW = 93  # PyArray_New in NumPy's table of functions
HEAD = ("none", "true", "ndarray", "float64", "integer", "real", "new", "up", "down", "as_size", "forget")
NONE, TRUE, NDARRAY, FLOAT64, INTEGER, REAL, MAKE, UP, DOWN, AS_SIZE, FORGET = range(len(HEAD))
_HALF, _WORD = ir.IntType(32), ir.IntType(64)


class Plan(np.ndarray):
    """Words for a compiled function, and what they point at."""

    alive: Any = None


# --- what compiled code is made of -----------------------------------------------------------------------


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


_make: Any = _call(_WORD, _WORD, _HALF, _WORD, _HALF, _WORD, _WORD, _HALF, _HALF, _WORD)
_count: Any = _call(ir.VoidType(), _WORD)
_size: Any = _call(_WORD, _WORD)
_void: Any = _call(ir.VoidType())
word = _word
_pointer = numba_kernels._pointer
_DOUBLE = 12  # NPY_DOUBLE


@inlined
def at(address: int, shape: tuple[int, ...]) -> Any:
    """Numbers at an address, in C order."""
    return carray(_pointer(address), shape, F8)


@inlined
def places(address: int, count: int) -> Any:
    """Indices at an address."""
    return carray(_pointer(address), (count,), np.intp)


@inlined
def is_float64(plan: int, x: int) -> Any:
    """Whether the numbers of an array are float64 in the byte order of this machine."""
    return word(word(x, DTYPE), KIND) & SAME == word(plan, FLOAT64)


@inlined
def is_vector(plan: int, x: int, size: int) -> Any:
    """Whether an object is a float64 array of this one axis."""
    return (
        word(x, TYPE) == word(plan, NDARRAY)
        and is_float64(plan, x)
        and word(x, RANK) & 0xFFFFFFFF == 1
        and word(word(x, SHAPE), 0) == size
        and word(x, FLAGS) & ALIGNED != 0
    )


@inlined
def is_matrix(plan: int, x: int, columns: int) -> Any:
    """Whether an object is a float64 array (..., columns) of two axes."""
    return (
        word(x, TYPE) == word(plan, NDARRAY)
        and is_float64(plan, x)
        and word(x, RANK) & 0xFFFFFFFF == 2
        and word(word(x, SHAPE), 1) == columns
        and word(x, FLAGS) & ALIGNED != 0
    )


@inlined
def vector(x: int, size: int) -> Any:
    """The numbers of such an array, wherever they stand."""
    return as_strided(at(word(x, DATA), (size,)), (size,), (word(word(x, STRIDES), 0),))


@inlined
def apart(x: int, size: int, first: int, count: int) -> Any:
    """Whether such an array shares nothing with so many numbers at an address."""
    one = word(x, DATA)
    other = one + word(word(x, STRIDES), 0) * (size - 1)
    return size == 0 or max(one, other) + 8 <= first or min(one, other) >= first + 8 * count


@inlined
def matrix(x: int) -> Any:
    """The numbers of an array of two axes."""
    shape = (word(word(x, SHAPE), 0), word(word(x, SHAPE), 1))
    return as_strided(at(word(x, DATA), shape), shape, (word(word(x, STRIDES), 0), word(word(x, STRIDES), 1)))


@inlined
def index(plan: int, x: int, count: int) -> Any:
    """The value of an int from 0 to count - 1; -1 for anything else."""
    if word(x, TYPE) != word(plan, INTEGER):
        return -1
    k = _size(word(plan, AS_SIZE), (x,))
    if k == -1:  # perhaps one too large, which leaves an error behind
        _void(word(plan, FORGET), ())
    return k if 0 <= k < count else -1


@inlined
def is_real(plan: int, x: int) -> Any:
    """Whether an object is a float."""
    return word(x, TYPE) == word(plan, REAL)


@inlined
def real(x: int) -> Any:
    """The value of a float, which stands where an array has its data."""
    return at(x + 8 * DATA, (1,))[0]


@inlined
def fresh(plan: int, rank: int, shape: int) -> Any:
    """A new float64 array in C order, its axes at an address; 0 if there is no memory."""
    return _make(word(plan, MAKE), (word(plan, NDARRAY), rank, shape, _DOUBLE, 0, 0, 0, 0, 0))


@inlined
def no(plan: int) -> Any:
    """None, to be returned."""
    _count(word(plan, UP), (word(plan, NONE),))
    return word(plan, NONE)


@inlined
def yes(plan: int) -> Any:
    """True, to be returned."""
    _count(word(plan, UP), (word(plan, TRUE),))
    return word(plan, TRUE)


@inlined
def never_mind(plan: int, x: int) -> Any:
    """None, to be returned in place of a new object."""
    _count(word(plan, DOWN), (x,))
    return no(plan)


SCOPE: dict[str, Any] = {
    "word": word, "at": at, "places": places, "is_vector": is_vector, "is_matrix": is_matrix, "vector": vector,
    "apart": apart,
    "matrix": matrix, "index": index, "is_real": is_real, "real": real, "fresh": fresh, "no": no, "yes": yes,
    "never_mind": never_mind,
}  # fmt: skip


# --- what this process looks like ------------------------------------------------------------------------


def _words(address: int, count: int) -> list[int]:
    return ctypes.cast(address, ctypes.POINTER(ctypes.c_int64))[:count]


def _kind(dtype: np.dtype) -> int:
    """What ``is_float64`` reads of a dtype."""
    return _words(id(dtype), KIND + 1)[KIND] & SAME


def _as_expected() -> bool:
    """Whether objects and arrays stand in memory as compiled code takes them to."""
    plain = platform.python_implementation() == "CPython" and object.__basicsize__ == 16
    if numba_kernels.PLAIN or not plain or sys.byteorder != "little" or ctypes.sizeof(ctypes.c_void_p) != 8:
        return False
    x = np.zeros((3, 5))[:, 1:3]
    words, number = _words(id(x), FLAGS + 1), 0.1
    return (
        words[TYPE] == id(np.ndarray)
        and words[DATA] == x.ctypes.data
        and words[RANK] & 0xFFFFFFFF == 2
        and _words(words[SHAPE], 2) == [3, 2]
        and _words(words[STRIDES], 2) == [40, 8]
        and words[DTYPE] == id(np.dtype(F8))
        and _kind(np.dtype("<f8")) == _DOUBLE << 32 | ord("<") << 16 | ord("d") << 8 | ord("f")
        and _kind(np.dtype(">f8")) != _kind(np.dtype("<f8"))
        and words[FLAGS] & 0xFFFFFFFF == x.flags.num
        and np.dtype(F8).num == _DOUBLE
        and np.int64(_words(id(number), DATA + 1)[DATA]).view(F8) == number
    )


def _head() -> list[int]:
    """The words that are the same for all."""
    core = sys.modules["numpy._core" if "numpy._core" in sys.modules else "numpy.core"]
    api: Any = ctypes.pythonapi
    api.PyCapsule_GetPointer.restype = ctypes.c_void_p
    api.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    table = api.PyCapsule_GetPointer(core.multiarray._ARRAY_API, None)

    def function(name: str) -> int:
        return ctypes.cast(getattr(api, name), ctypes.c_void_p).value or 0

    constants: list[object] = [None, True, np.ndarray]
    functions = [function(name) for name in ("Py_IncRef", "Py_DecRef", "PyLong_AsSsize_t", "PyErr_Clear")]
    heads = [*map(id, constants), _kind(np.dtype(F8)), id(int), id(float)]
    return [*heads, _words(table, NEW + 1)[NEW], *functions]


READY = _as_expected()
_WORDS = _head() if READY else []


class _Definition(ctypes.Structure):
    """A PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("address", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


# --- functions -------------------------------------------------------------------------------------------


def refused(*arguments: Any) -> None:
    """What stands for a function where none can be made."""


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
        """A function of ``arguments``, objects by their addresses, in whose ``body`` the words of a plan have names.

        The body returns ``fresh(...)``, ``yes(plan)`` or ``no(plan)``; 0 for an error that Python knows of. What it
        raises becomes a SystemError. Of the last ``optional`` arguments the first ones may be given; the others are 0.
        """
        self.words = tuple(words)
        least, most = len(arguments) - optional, len(arguments)
        text = ["stamp", f"plan = word(self, {DATA})", f"if n < {least} or n > {most}: return no(plan)"]
        text += [f"{name} = word(plan, {len(HEAD) + k})" for k, name in enumerate(words)]
        for k, name in enumerate(arguments):
            text.append(f"{name} = word(args, {k})" if k < least else f"{name} = word(args, {k}) if n > {k} else 0")
        function = numba_kernels.define(f"builtin_{label}", ["self", "args", "n"], [*text, *body], {**SCOPE, **scope})
        dispatcher: Any = numba_kernels.jitted(function, nogil=False, from_c=True)
        signature = (types.intp, types.intp, types.intp)
        dispatcher.compile(signature)
        made = dispatcher.overloads[signature]
        self._code = dispatcher  # keeps what was compiled where it is
        address = made.library.get_pointer_to_function(made.fndesc.llvm_cfunc_wrapper_name)
        self._definition = _Definition(label.encode(), address, FASTCALL, None)
        # A function looks at its definition when it is freed, which may be after this is: 32 bytes that stay.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._definition))

    def bind(self, *alive: Any, **words: int) -> Callable[..., Any]:
        """The function with a plan, ``function.__self__``, which keeps what its words point at alive."""
        given = [words.pop(name) for name in self.words]
        if words:
            raise TypeError(f"a plan has no words {sorted(words)}, expected {', '.join(self.words)}")
        plan = np.array([*_WORDS, *given], np.int64).view(Plan)
        plan.alive = (self, *alive)
        new: Any = ctypes.pythonapi.PyCFunction_NewEx
        new.restype, new.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
        made: Callable[..., Any] = new(ctypes.addressof(self._definition), plan, None)
        return made


def retarget(function: Any, model: Any) -> None:
    """Have a builtin use the table of another model of the same sizes, if it uses one."""
    plan = getattr(function, "__self__", None)
    if isinstance(plan, Plan) and plan.alive[0].words[:1] == ("table",):
        plan[len(HEAD)] = model.address
        plan.alive = (plan.alive[0], model, *plan.alive[2:])


def dims(words: Sequence[str], first: str) -> str:
    """Where in a plan the word of that name is, as text for a body: the axes of a new array."""
    return f"plan + {8 * (len(HEAD) + list(words).index(first))}"
