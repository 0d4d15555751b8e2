"""Arrays that notify an owner of writes, and values that view an array.

A ``TrackedArray`` calls ``changed()`` of its owner after every write through it or a view of it: item assignment,
in-place operators, ``out=``, ``np.copyto`` and its like, methods such as ``fill``. Results computed from it are plain
arrays. Writes that cannot notify the owner raise ValueError, for the array is read-only to them:
``np.asarray(x)[0] = 1``, a memoryview, ``np.nditer``, ``out=`` of a method or of a random generator.
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Self = TypeVar("Self", bound="Value")

WRITERS = {np.copyto, np.put, np.place, np.putmask, np.fill_diagonal, np.put_along_axis}


class TrackedArray(np.ndarray):
    """An array that notifies its owner of every write."""

    _owner: Any = None

    def __array_finalize__(self, source: Any) -> None:
        owner = getattr(source, "_owner", None)
        if owner is not None and self.base is not None:  # a view writes its source's memory; a copy does not
            self._owner = owner

    def _changed(self) -> None:
        if self._owner is not None:
            self._owner.changed()

    def __setitem__(self, at: Any, value: Any) -> None:
        _writable(self)[at] = plain(value)
        self._changed()

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **options: Any) -> Any:
        """Compute on plain arrays; outputs written with ``out=`` or in place notify their owner."""
        if out is not None:
            options["out"] = tuple(_writable(x) for x in out)
        given = [plain(x) for x in inputs]
        if method == "at":
            given[0] = _writable(inputs[0])
        result = getattr(ufunc, method)(*given, **options)
        written = out if out is not None else inputs[:1] if method == "at" else ()
        for x in written:
            if isinstance(x, TrackedArray):
                x._changed()
        return out[0] if out is not None and len(out) == 1 else result

    def __array_function__(self, function: Any, types: Any, arguments: Any, options: Any) -> Any:
        """Call a NumPy function on plain arrays; arrays that it wrote notify their owner."""
        out = options.get("out")
        written = list(arguments[:1]) if function in WRITERS else []
        given = [_writable(x) for x in written] + [_plain(x) for x in arguments[len(written) :]]
        named = {key: _plain(x) for key, x in options.items()}
        if out is not None:
            named["out"] = tuple(_writable(x) for x in out) if isinstance(out, tuple) else _writable(out)
        result = function(*given, **named)
        for x in [*written, *(out if isinstance(out, tuple) else (out,))]:
            if isinstance(x, TrackedArray):
                x._changed()
        if isinstance(out, TrackedArray):
            return out
        for x in arguments if type(result) is np.ndarray else ():
            if isinstance(x, TrackedArray) and np.may_share_memory(result, plain(x)):  # a view, as of np.reshape
                return tracked(result, x._owner)
        return result

    def __repr__(self) -> str:
        return repr(plain(self))

    def astype(self, *arguments: Any, **options: Any) -> Any:
        """As ``numpy.ndarray.astype``, a plain array."""
        return np.array(plain(self).astype(*arguments, **options))

    def flatten(self, order: Any = "C") -> Any:
        """As ``numpy.ndarray.flatten``, a plain array."""
        return plain(self).flatten(order)

    def copy(self, order: Any = "C") -> Any:
        """A plain array of the same numbers."""
        return np.array(plain(self), order=order)

    __copy__ = copy

    def __deepcopy__(self, memo: Any) -> Any:
        return self.copy()

    def __reduce__(self) -> Any:
        return self.copy().__reduce__()

    def __reduce_ex__(self, protocol: Any) -> Any:
        return self.copy().__reduce_ex__(protocol)

    @property
    def flat(self) -> Any:
        """A writable iterator; the owner is notified as of a write."""
        self._changed()
        return _writable(self).flat

    @flat.setter
    def flat(self, value: Any) -> None:
        _writable(self).flat = value
        self._changed()


def _writing(name: str) -> Any:
    method_of_ndarray = getattr(np.ndarray, name)

    def method(self: TrackedArray, *arguments: Any, **options: Any) -> Any:
        result = method_of_ndarray(_writable(self), *arguments, **options)
        self._changed()
        return result

    method.__name__ = method.__qualname__ = name
    method.__doc__ = f"As ``numpy.ndarray.{name}``."
    return method


for _name in ("fill", "sort", "partition", "put", "setfield"):
    setattr(TrackedArray, _name, _writing(_name))


def tracked(x: Array, owner: Any) -> Array:
    """A view of an array that notifies the owner of writes; the array itself if there is no owner."""
    if owner is None:
        return x
    view = x.view(TrackedArray)
    view.flags.writeable = False
    view._owner = owner
    return view


def plain(x: Any) -> Any:
    """A plain read-only view of a TrackedArray; other values unchanged."""
    return x.view(np.ndarray) if isinstance(x, TrackedArray) else x


def _writable(x: Any) -> Any:
    """A plain writable view of a TrackedArray; other values unchanged."""
    if not isinstance(x, TrackedArray):
        return x
    view = x.view(np.ndarray)
    view.flags.writeable = True  # as its base is
    return view


def _plain(x: Any) -> Any:
    """``plain``, also of the entries of tuples and lists."""
    if isinstance(x, (tuple, list)):
        return type(x)(_plain(y) for y in x) if type(x) in (tuple, list) else x
    return plain(x)


class Value:
    """Base of SE3, Motion and their like: numbers in one array ``_x``, and an owner that is notified of writes.

    ``_x`` is float64, C-ordered and writable; it may be a view of a larger array, and then the object is one too.
    """

    __slots__ = ("__dict__", "__weakref__", "_x")
    _owner: Any = None
    _x: Array

    @classmethod
    def over(cls: type[Self], x: Array, owner: Any = None) -> Self:
        """The object whose numbers are an array, as a view of it."""
        made = cls.__new__(cls)
        made._x = x
        if owner is not None:
            made._owner = owner
        return made

    def changed(self) -> None:
        """Notify the owner, if any, of a write."""
        if self._owner is not None:
            self._owner.changed()

    def _write(self, x: Any) -> None:
        self._x[...] = x
        if self._owner is not None:
            self._owner.changed()

    def _view(self, x: Array) -> Array:
        """A writable view of ``_x`` or a part of it, for the caller."""
        return x if self._owner is None else tracked(x, self._owner)

    def copy(self: Self) -> Self:
        """An independent copy."""
        return self.over(self._x.copy())

    def cast(self: Self) -> Self:
        """A copy: the only scalar type is float64."""
        return self.copy()

    def __copy__(self: Self) -> Self:
        return self.copy()

    def __deepcopy__(self: Self, memo: Any) -> Self:
        return self.copy()

    def __getinitargs__(self) -> tuple[Any, ...]:
        """Constructor arguments that make an equal object."""
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
