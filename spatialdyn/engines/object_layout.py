"""Memory layout of CPython's and NumPy's objects, for compiled functions that read their argument objects themselves.

Such a function has the calling convention of CPython's builtins. It checks type, size and layout of its arguments in
memory and calls NumPy to make the result: unpacking an array in Numba and making one in Python would each cost as much
as the dynamics of an arm. The function holds the GIL throughout, so no other thread changes an argument meanwhile, but
for calls of models too large for a program: other threads run while the table kernel does.

The layout of arrays is part of NumPy's C interface and the same since 1.0; the other layouts are CPython's. They were
tried on CPython 3.11 and NumPy 2.4, 64 bits, little endian, with the GIL. ``READY`` says whether this process has that
layout. If not (another implementation or byte order, a build without the GIL), no such function is made, and plain
Python runs instead. Dtypes are compared by type number and byte order, not by address, since an unpickled array has
another dtype object.
"""

from __future__ import annotations

import ctypes
import platform
import sys
import sysconfig
from collections.abc import Callable
from typing import Any

import numpy as np

F8 = np.float64
TYPE, DATA, RANK, SHAPE, STRIDES, DTYPE, FLAGS = 1, 2, 3, 4, 5, 7, 8  # words of an array object
KIND = 3  # word of a dtype: kind, letter, byte order and flags, a byte each, and the type number
SAME = ~0xFF010000  # mask of the bits that are the same in equal dtypes: no flags; "=" (0x3D) and "<" (0x3C) agree
LENGTH, ITEMS = 2, 3  # words of a tuple: the number of items, and the first item
REAL = 2  # word of a float, or of np.float64: its value
FASTCALL, KEYWORDS = 0x80, 0x2  # METH_FASTCALL, METH_KEYWORDS
CONTIGUOUS, ALIGNED, WRITEABLE = 0x1, 0x100, 0x400  # NPY_ARRAY_C_CONTIGUOUS, ...
DOUBLE = 12  # NPY_DOUBLE
_NEW = 93  # PyArray_New in NumPy's table of functions


class Definition(ctypes.Structure):
    """A PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("address", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


class Words(np.ndarray):
    """Words for a compiled function, with references to the objects at their addresses."""

    alive: Any = None


def words(values: list[int], *alive: Any) -> Words:
    """The words that a compiled function reads; they keep references to the objects at their addresses."""
    made = np.array(values, np.int64).view(Words)
    made.alive = alive
    return made


def maker(
    name: str, address: int, module: str | None = None, doc: str = "", keywords: bool = False
) -> Callable[..., Callable[..., Any]]:
    """A function that makes Python functions from the address of a compiled one.

    Its argument is the object that the compiled function gets first; None if there is no such object.

    module  ``__module__`` of the functions
    doc     docstring, which may begin with the signature and a line "--"
    """
    flags = FASTCALL | KEYWORDS if keywords else FASTCALL
    definition = Definition(name.encode(), address, flags, doc.encode() if doc else None)
    never_free(definition)  # 32 bytes, which a function reads when it is freed, perhaps after its maker is gone

    def make(bound: object = None) -> Callable[..., Any]:
        new: Any = ctypes.pythonapi.PyCFunction_NewEx
        new.restype, new.argtypes = ctypes.py_object, [ctypes.c_void_p] * 3
        objects = (None if x is None else id(x) for x in (bound, module))
        made: Callable[..., Any] = new(ctypes.addressof(definition), *objects)
        return made

    return make


def never_free(x: object) -> None:
    """Keep an object until the process ends."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(x))


def api(name: str) -> int:
    """The address of a function of CPython's C interface."""
    return ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0


def vectorcall() -> int:
    """The address of the C function that calls a Python function with its arguments in an array.

    CPython 3.10 does not export PyObject_Vectorcall, which is inline in its headers; there the address is the one in
    the function's own slot.
    """
    return api("PyObject_Vectorcall" if hasattr(ctypes.pythonapi, "PyObject_Vectorcall") else "_PyFunction_Vectorcall")


def array_maker() -> int:
    """The address of NumPy's PyArray_New."""
    core = sys.modules["numpy._core" if np.lib.NumpyVersion(np.__version__) >= "2.0.0" else "numpy.core"]
    get: Any = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return words_at(get(core.multiarray._ARRAY_API, None), _NEW + 1)[_NEW]


def words_at(address: int, count: int) -> list[int]:
    """Words at an address."""
    found: list[int] = ctypes.cast(address, ctypes.POINTER(ctypes.c_int64))[:count]
    return found


def kind(dtype: np.dtype) -> int:
    """A word computed from a dtype; equal dtypes have the same word."""
    return words_at(id(dtype), KIND + 1)[KIND] & SAME


def slot_offset(kind: type, name: str) -> int:
    """Bytes from an object to a slot of its class."""
    member = vars(kind)[name]  # a PyMemberDescrObject, whose word 5 is the address of a PyMemberDef
    return words_at(words_at(id(member), 6)[5], 3)[2]


def _as_expected() -> bool:
    """Whether objects and arrays have the memory layout that compiled code assumes."""
    plain = platform.python_implementation() == "CPython" and object.__basicsize__ == 16
    gil = not sysconfig.get_config_var("Py_GIL_DISABLED")
    if not (plain and gil) or sys.byteorder != "little" or ctypes.sizeof(ctypes.c_void_p) != 8:
        return False
    x = np.zeros((3, 5))[:, 1:3]
    array, numbers, pair = words_at(id(x), FLAGS + 1), (0.1, np.float64(0.1)), (x, "q")

    class Slots:
        __slots__ = ("first", "second")

    slots = Slots()
    slots.second = pair  # type: ignore[attr-defined]
    offset = slot_offset(Slots, "second")
    return (
        array[TYPE] == id(np.ndarray)
        and array[DATA] == x.ctypes.data
        and array[RANK] & 0xFFFFFFFF == 2
        and words_at(array[SHAPE], 2) == [3, 2]
        and words_at(array[STRIDES], 2) == [40, 8]
        and array[DTYPE] == id(np.dtype(F8))
        and kind(np.dtype("<f8")) == DOUBLE << 32 | ord("<") << 16 | ord("d") << 8 | ord("f")
        and kind(np.dtype(">f8")) != kind(np.dtype("<f8"))
        and array[FLAGS] & 0xFFFFFFFF == x.flags.num
        and np.zeros((2, 2)).flags.num & 0xFFF == CONTIGUOUS | ALIGNED | WRITEABLE | 0x4
        and np.dtype(F8).num == DOUBLE
        and all(float(np.int64(words_at(id(number), REAL + 1)[REAL]).view(F8)) == number for number in numbers)
        and words_at(id(pair), ITEMS + 2)[LENGTH:] == [2, id(x), id(pair[1])]
        and 16 <= offset <= 64
        and offset % 8 == 0
        and words_at(id(slots) + offset, 1)[0] == id(pair)
    )


READY = _as_expected()
