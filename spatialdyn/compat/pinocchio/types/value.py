"""Base of SE3, Motion and their like: numbers in one array, parts of it as attributes, compiled functions."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Any, ClassVar, TypeVar

import numpy as np

from ....engines.object_layout import slot_offset
from ....engines.programs.run.single_call import READY, unavailable
from ...native import operator_kernels, operators
from .arguments import (
    ArgumentError,
    Array,
    array,
    expected,
    module_of_caller,
    near,
    number,
    of_pinocchio,
)
from .bases import Copied

Self = TypeVar("Self", bound="Value")
FLOAT64 = np.dtype(np.float64)


class Value(Copied):
    """Base of SE3, Motion and their like: numbers in one array ``_x``.

    ``_x`` is float64, C-ordered and writable; it may be a view of a larger array, and then the object is one too.
    """

    __slots__ = ("__dict__", "__weakref__", "_x")  # for subclasses too, which name none
    _x: Array
    _classes: ClassVar[dict[str, type[Value]]] = {}  # by the kind of their array, capitalized
    _named: ClassVar[dict[str, type[Value]]] = {}  # by their own names
    _arguments: ClassVar[tuple[str, ...]]  # attributes that the constructor takes
    _compared: ClassVar[tuple[Any, ...]] = (...,)  # places of the parts whose norms ``isApprox`` compares

    def __init_subclass__(
        cls, kind: str = "", near: Any = operators.near, same: Any = operators.same, raw: bool = True, **options: Any
    ) -> None:
        """``near`` and ``same`` compare two objects as functions of ``on_values``, by default all their numbers."""
        super().__init_subclass__(**options)
        Value._named[cls.__name__] = cls
        if not kind:
            return
        Value._classes[kind] = cls
        cls.copy = on_values("copy", operators.itself, kind, Value.copy.__doc__, self=kind)  # type: ignore[method-assign]
        cls.__eq__ = on_values("__eq__", same, "truth", raw=raw, self=kind, other=kind)  # type: ignore[method-assign]
        cls.isApprox = on_values(  # type: ignore[method-assign]
            "isApprox", near, "truth", Value.isApprox.__doc__, raw=raw, self=kind, other=kind, prec="precision"
        )

    @classmethod
    def over(cls: type[Self], x: Array) -> Self:
        """The object whose numbers are an array, as a view of it."""
        made = cls.__new__(cls)
        made._x = x
        return made

    def _write(self: Self, x: Any) -> Self:
        self._x[...] = x
        return self

    def copy(self: Self) -> Self:
        """An independent copy."""
        return self.over(self._x.copy())

    def cast(self: Self) -> Self:
        """A copy: the only scalar type is float64."""
        return self.copy()

    def isApprox(self, other: Any, prec: float = 1e-12) -> bool:
        """Whether both agree to prec of their norms, part by part."""
        a, b = self._x, expected(own_value(other) or other, type(self), "other")._x
        return all(near(a[at], b[at], prec) for at in self._compared)

    def __getinitargs__(self) -> tuple[Any, ...]:
        """Constructor arguments that make an equal object."""
        found = (getattr(self, name) for name in self._arguments)
        return tuple(x.copy() if isinstance(x, np.ndarray) else x for x in found)

    def __reduce__(self) -> tuple[Any, ...]:
        return self.over, (self._x.copy(),)

    def __eq__(self, other: object) -> Any:
        mine = other if isinstance(other, type(self)) else own_value(other)
        return self._x.tolist() == mine._x.tolist() if isinstance(mine, type(self)) else NotImplemented

    __hash__ = object.__hash__

    def _reflected(self, other: Any, name: str) -> Any:
        """``other`` operator self, of Pinocchio's own object on the left; NotImplemented for another."""
        mine = own_value(other)
        act = getattr(type(mine), name, None)
        return NotImplemented if mine is None or act is None else act(mine, self)

    def __radd__(self, other: Any) -> Any:
        return self._reflected(other, "__add__")

    def __rsub__(self, other: Any) -> Any:
        return self._reflected(other, "__sub__")

    def __rmul__(self, other: Any) -> Any:
        return self._reflected(other, "__mul__")

    def __rxor__(self, other: Any) -> Any:
        return self._reflected(other, "__xor__")


def own_value(given: Any) -> Value | None:
    """The value that one of Pinocchio's own objects converts to; None for anything else."""
    kind = Value._named.get(type(given).__name__)
    return kind(given) if kind is not None and of_pinocchio(given, kind.__name__) else None  # type: ignore[call-arg]


class Summable(Value):
    """Base of values that form a vector space: Motion, Force, Inertia and Symmetric3."""

    def __iadd__(self, other: Any) -> Any:
        return self._write((self + other)._x)

    def __isub__(self, other: Any) -> Any:
        return self._write((self - other)._x)

    def isZero(self, prec: float = 1e-12) -> bool:
        """Whether no entry exceeds prec."""
        return bool((abs(self._x) <= number(prec, "prec")).all())


class InFrames(Value):
    """Base of values that an SE3 takes from frame to frame: Motion, Force and Inertia."""

    def se3Action(self: Self, M: Any) -> Self:
        """The value from the frame M in M's reference frame: ``M.act(self)``."""
        return expected(M, Value._classes["Pose"], "M").act(self)  # type: ignore[no-any-return]

    def se3ActionInverse(self: Self, M: Any) -> Self:
        """The value from M's reference frame in the frame M: ``M.actInv(self)``."""
        return expected(M, Value._classes["Pose"], "M").actInv(self)  # type: ignore[no-any-return]


# --- attributes --------------------------------------------------------------------------------------------


def part(name: str, at: Any, doc: str, kind: Any = None) -> Any:
    """An attribute for the numbers ``_x[at]``: a writable view, or a float if ``at`` names one number.

    kind  makes what is read of the numbers, as np.array makes a copy
    """
    if kind is None and (isinstance(at, int) or (isinstance(at, tuple) and all(isinstance(k, int) for k in at))):
        kind = float

    def read(self: Value) -> Any:
        return self._x[at]

    def read_made(self: Value) -> Any:
        return kind(self._x[at])

    def write(self: Value, given: Any) -> None:
        there = self._x[at]
        if type(given) is np.ndarray and given.dtype == FLOAT64 and given.shape == there.shape:  # the usual case first
            there[...] = given
        else:
            self._x[at] = array(given, there.shape, name) if there.shape else number(given, name)

    return property(read if kind is None else read_made, write, doc=doc)


def preset(numbers: Callable[[], Any], what: str) -> tuple[Any, Any]:
    """A class method that makes an object of these numbers, and a method that sets them."""

    def make(cls: type[Value]) -> Value:
        return cls.over(np.array(numbers(), float))

    def assign(self: Value) -> None:
        self._write(numbers())

    make.__doc__, assign.__doc__ = f"{what[0].upper()}{what[1:]}.", f"Set it to {what}."
    return classmethod(make), assign


def as_array(read: Callable[[Any], Array]) -> Callable[..., Array]:
    """The method ``__array__`` of a class whose objects are that array."""

    def method(self: Any, dtype: Any = None, copy: Any = None) -> Array:
        return read(self) if dtype is None else read(self).astype(dtype)

    return method


# --- compiled functions ------------------------------------------------------------------------------------


def on_values(
    name: str,
    function: Callable[..., Any],
    output: str,
    doc: str | None = "",
    /,
    raw: bool = False,
    form: Callable[..., Any] | None = None,
    **inputs: str,
) -> Callable[..., Any]:
    """The function ``name`` of arguments and a result of these kinds, computed by a function of compiled code.

    See ``operator_kernels.Operator``. Arguments of other types, as lists or arrays of integers, are converted, or raise
    ArgumentError; where the name is an operator of Python, it returns NotImplemented. Compiled at its first call.

    form  what is made of the arguments and of ``call``, which computes the result; by default that is returned
    """
    operator = operator_kernels.Operator(function, inputs, output, raw, form is IN_PLACE)

    def first(*given: Any) -> Any:
        scope["call"] = bound(convert)
        return scope["call"](*given)

    def bound(otherwise: Callable[..., Any]) -> Callable[..., Any]:
        return operator.bind(slot_offset(Value, "_x"), Value._classes, otherwise) if READY else otherwise

    def convert(*given: Any) -> Any:
        try:
            ready = [_converted(x, kind, what) for x, (what, kind) in zip(given, inputs.items(), strict=True)]
        except ArgumentError:
            if name.startswith("__"):
                return NotImplemented
            raise
        return of_converted()(*ready)

    @cache
    def of_converted() -> Callable[..., Any]:
        return bound(plain)

    def plain(*ready: Any) -> Any:
        found = operator.in_plain_python(*(x._x if isinstance(x, Value) else x for x in ready))
        return Value._classes[output].over(found) if output in Value._classes else found

    scope: dict[str, Any] = {"call": first, "__name__": module_of_caller()}
    code = (form or _CALLS[len(inputs)]).__code__.replace(co_name=name, co_varnames=tuple(inputs))
    made = FunctionType(code, scope, name, tuple(x.default for x in operator.kinds if x.default is not None))
    made.__qualname__, made.__doc__ = name, doc
    return made


# of functions of so many arguments: a function of ``on_values`` has this code with its own names and its own ``call``
call: Callable[..., Any] = unavailable
_CALLS: tuple[Any, ...] = (
    lambda: call(), lambda a: call(a), lambda a, b: call(a, b), lambda a, b, c: call(a, b, c)
)  # fmt: skip
# other forms: the result is written to the first argument; a factor, from the right and from the left, whose type is
# compared first, which is faster than isinstance
IN_PLACE: Any = lambda a, b: call(a, b) and a  # noqa: E731
TIMES: Any = lambda a, b: (  # noqa: E731
    call(a, b)
    if type(b) is float
    else call(a, float(b))
    if type(b) is int or isinstance(b, (float, int))
    else NotImplemented
)
TIMES_LEFT: Any = lambda a, b: (  # noqa: E731
    call(a, b)
    if type(b) is float
    else call(a, float(b))
    if type(b) is int or isinstance(b, (float, int))
    else a._reflected(b, "__mul__")
)


def _converted(x: Any, kind: str, what: str) -> Any:
    """An argument as its builtin takes it. Raises ArgumentError if it cannot be one of that kind."""
    shape, _, _, owner, or_array, _ = operator_kernels.KINDS[kind]
    if not shape:
        return number(x, what)
    own = Value._classes.get(owner)
    if own is not None and of_pinocchio(x, own.__name__):
        return own(x)  # type: ignore[call-arg]
    if own is not None and (not or_array or isinstance(x, own)):
        return own.over(expected(x, own, what)._x)
    return np.array(array(x, shape, what))
