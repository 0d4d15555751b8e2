"""Arrays that notify an owner of writes.

A ``TrackedArray`` calls ``changed()`` of its owner after every write through it or a view of it: item assignment,
in-place operators, ``out=``, ``np.copyto`` and its like, methods such as ``fill``. Results computed from it are plain
arrays. Writes that cannot notify the owner raise ValueError, for the array is read-only to them:
``np.asarray(x)[0] = 1``, a memoryview, ``np.nditer``, ``out=`` of a method or of a random generator.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .arguments import Array
from .bases import OwnedValue

WRITERS = {np.copyto, np.put, np.place, np.putmask, np.fill_diagonal, np.put_along_axis}


class TrackedArray(OwnedValue, np.ndarray):
    """An array that notifies its owner of every write."""

    def __array_finalize__(self, source: Any) -> None:
        owner = getattr(source, "_owner", None)
        if owner is not None and self.base is not None:  # a view writes its source's memory; a copy does not
            self._owner = owner

    def __setitem__(self, at: Any, value: Any) -> None:
        _writable(self)[at] = plain(value)
        self.changed()

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
                x.changed()
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
                x.changed()
        if isinstance(out, TrackedArray):
            return out
        for x in arguments if type(result) is np.ndarray else ():
            if isinstance(x, TrackedArray) and np.may_share_memory(result, plain(x)):  # a view, as of np.reshape
                return tracked(result, x._owner)
        return result

    def __repr__(self) -> str:
        return repr(plain(self))

    def copy(self, order: Any = "C") -> Any:
        """A plain array of the same numbers."""
        return np.array(plain(self), order=order)

    def __reduce_ex__(self, protocol: Any) -> Any:
        return self.copy().__reduce_ex__(protocol)

    @property
    def flat(self) -> Any:
        """A writable iterator; the owner is notified as of a write."""
        self.changed()
        return _writable(self).flat

    @flat.setter
    def flat(self, value: Any) -> None:
        _writable(self).flat = value
        self.changed()


def _method(name: str, writes: bool) -> Any:
    """A method of ndarray that writes the array, or that gives a plain one."""
    method_of_ndarray = getattr(np.ndarray, name)

    def method(self: TrackedArray, *arguments: Any, **options: Any) -> Any:
        if not writes:
            return np.array(method_of_ndarray(plain(self), *arguments, **options))
        result = method_of_ndarray(_writable(self), *arguments, **options)
        self.changed()
        return result

    method.__name__ = method.__qualname__ = name
    method.__doc__ = f"As ``numpy.ndarray.{name}``{'' if writes else ', a plain array'}."
    return method


for _name in ("fill", "sort", "partition", "put", "setfield", "astype", "flatten"):
    setattr(TrackedArray, _name, _method(_name, _name not in ("astype", "flatten")))


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
