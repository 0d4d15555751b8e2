"""Arrays that tell when they are written, and values that are kept in one array.

A ``Live`` array calls ``changed()`` of its owner after every write through it or a view of it: item assignment,
in-place operators, ``out=``, ``np.copyto`` and its like, methods such as ``fill``. What is computed from one is a plain
array. Towards everything else it is read-only, so that a write that its owner would not hear of raises ValueError:
``np.asarray(x)[0] = 1``, a memoryview, ``np.nditer``, ``out=`` of a method or of a generator of random numbers.
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Self = TypeVar("Self", bound="Value")

WRITERS = {np.copyto, np.put, np.place, np.putmask, np.fill_diagonal, np.put_along_axis}


class Live(np.ndarray):
    """An array whose owner hears of every write."""

    _owner: Any = None

    def __array_finalize__(self, source: Any) -> None:
        owner = getattr(source, "_owner", None)
        if owner is not None and self.base is not None:  # a view writes where its source stands; a copy does not
            self._owner = owner

    def _changed(self) -> None:
        if self._owner is not None:
            self._owner.changed()

    def __setitem__(self, at: Any, value: Any) -> None:
        _writable(self)[at] = bare(value)
        self._changed()

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **options: Any) -> Any:
        """Compute on plain arrays; what was written with ``out=`` or in place tells its owner."""
        if out is not None:
            options["out"] = tuple(_writable(x) for x in out)
        given = [bare(x) for x in inputs]
        if method == "at":
            given[0] = _writable(inputs[0])
        result = getattr(ufunc, method)(*given, **options)
        written = out if out is not None else inputs[:1] if method == "at" else ()
        for x in written:
            if isinstance(x, Live):
                x._changed()
        return out[0] if out is not None and len(out) == 1 else result

    def __array_function__(self, function: Any, types: Any, arguments: Any, options: Any) -> Any:
        """NumPy's functions on plain arrays."""
        out = options.get("out")
        written = list(arguments[:1]) if function in WRITERS else []
        given = [_writable(x) for x in written] + [_bare(x) for x in arguments[len(written) :]]
        named = {key: _bare(x) for key, x in options.items()}
        if out is not None:
            named["out"] = tuple(_writable(x) for x in out) if isinstance(out, tuple) else _writable(out)
        result = function(*given, **named)
        for x in [*written, *(out if isinstance(out, tuple) else (out,))]:
            if isinstance(x, Live):
                x._changed()
        if isinstance(out, Live):
            return out
        for x in arguments if type(result) is np.ndarray else ():
            if isinstance(x, Live) and np.may_share_memory(result, bare(x)):  # np.reshape and its like
                return live(result, x._owner)
        return result

    def __repr__(self) -> str:
        return repr(bare(self))

    def astype(self, *arguments: Any, **options: Any) -> Any:
        """As ``numpy.ndarray.astype``, a plain array."""
        return np.array(bare(self).astype(*arguments, **options))

    def flatten(self, order: Any = "C") -> Any:
        """As ``numpy.ndarray.flatten``, a plain array."""
        return bare(self).flatten(order)

    def copy(self, order: Any = "C") -> Any:
        """A plain array of the same numbers."""
        return np.array(bare(self), order=order)

    __copy__ = copy

    def __deepcopy__(self, memo: Any) -> Any:
        return self.copy()

    def __reduce__(self) -> Any:
        return self.copy().__reduce__()

    def __reduce_ex__(self, protocol: Any) -> Any:
        return self.copy().__reduce_ex__(protocol)

    @property
    def flat(self) -> Any:
        """An iterator that can write; the owner counts it as a write."""
        self._changed()
        return _writable(self).flat

    @flat.setter
    def flat(self, value: Any) -> None:
        _writable(self).flat = value
        self._changed()


def _writing(name: str) -> Any:
    plain = getattr(np.ndarray, name)

    def method(self: Live, *arguments: Any, **options: Any) -> Any:
        result = plain(_writable(self), *arguments, **options)
        self._changed()
        return result

    method.__name__ = method.__qualname__ = name
    method.__doc__ = f"As ``numpy.ndarray.{name}``."
    return method


for _name in ("fill", "sort", "partition", "put", "setfield"):
    setattr(Live, _name, _writing(_name))


def live(x: Array, owner: Any) -> Array:
    """A view of an array that tells the owner of writes; the array itself if there is no owner."""
    if owner is None:
        return x
    view = x.view(Live)
    view.flags.writeable = False
    view._owner = owner
    return view


def bare(x: Any) -> Any:
    """A plain view of a Live array, to be read; anything else as it is."""
    return x.view(np.ndarray) if isinstance(x, Live) else x


def _writable(x: Any) -> Any:
    """A plain view of a Live array, to be written; anything else as it is."""
    if not isinstance(x, Live):
        return x
    view = x.view(np.ndarray)
    view.flags.writeable = True  # as what it is a view of
    return view


def _bare(x: Any) -> Any:
    """The same within tuples and lists of arguments."""
    if isinstance(x, (tuple, list)):
        return type(x)(_bare(y) for y in x) if type(x) in (tuple, list) else x
    return bare(x)


class Value:
    """An SE3, a Motion and their like: numbers in one array ``_x``, and an owner who hears when they are written.

    ``_x`` is float64, C-ordered and writable; it may be part of a larger array, and then the object is a view of it.
    """

    __slots__ = ("__dict__", "__weakref__", "_x")
    _owner: Any = None
    _x: Array

    @classmethod
    def over(cls: type[Self], x: Array, owner: Any = None) -> Self:
        """The object that an array is, as a view of it."""
        made = cls.__new__(cls)
        made._x = x
        if owner is not None:
            made._owner = owner
        return made

    def changed(self) -> None:
        """Tell the owner, if there is one, that something was written."""
        if self._owner is not None:
            self._owner.changed()

    def _write(self, x: Any) -> None:
        self._x[...] = x
        if self._owner is not None:
            self._owner.changed()

    def _shown(self, x: Array) -> Array:
        """A writable view of ``_x`` or a part of it, for the caller."""
        return x if self._owner is None else live(x, self._owner)

    def copy(self: Self) -> Self:
        """An equal object of its own."""
        return self.over(self._x.copy())

    def cast(self: Self) -> Self:
        """A copy: there is one type of number."""
        return self.copy()

    def __copy__(self: Self) -> Self:
        return self.copy()

    def __deepcopy__(self: Self, memo: Any) -> Self:
        return self.copy()

    def __getinitargs__(self) -> tuple[Any, ...]:
        """What the constructor takes to make an equal object."""
        raise NotImplementedError

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), self.__getinitargs__()

    def __eq__(self, other: object) -> Any:
        if type(other) is not type(self) and not isinstance(other, type(self)):
            return NotImplemented
        return bool((self._x == other._x).all())

    def __ne__(self, other: object) -> Any:
        if type(other) is not type(self) and not isinstance(other, type(self)):
            return NotImplemented
        return bool((self._x != other._x).any())

    __hash__ = object.__hash__
