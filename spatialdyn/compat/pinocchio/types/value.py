"""Base of SE3, Motion and their like: numbers in one array, parts of it as attributes, compiled functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, TypeVar

import numpy as np

from ....engines.compiled.generated import function_from_text
from ....engines.object_layout import slot_offset
from ....engines.programs.run.single_call import READY
from ...native import operator_kernels
from .arguments import (
    ArgumentError,
    Array,
    array,
    documented_rows,
    expected,
    module_of_caller,
    near,
    number,
    of_pinocchio,
)
from .bases import Copied

Self = TypeVar("Self", bound="Value")


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

    def __init_subclass__(cls, kind: str = "", near: str = "", same: str = "", **options: Any) -> None:
        """``near`` and ``same`` are formulas of two objects, as of ``on_values``, by default of all their numbers."""
        super().__init_subclass__(**options)
        Value._named[cls.__name__] = cls
        if not kind:
            return
        Value._classes[kind] = cls
        near, same = near or "near(self_in, other_in, prec)", same or "same(self_in, other_in)"
        cls.copy = on_values(f"copy(self: {kind}) -> {kind}", "self", Value.copy.__doc__)  # type: ignore[method-assign]
        cls.__eq__ = on_values(f"__eq__(self: {kind}, other: {kind}) -> truth", same)  # type: ignore[method-assign]
        signature = f"isApprox(self: {kind}, other: {kind}, prec: number = 1e-12) -> truth"
        cls.isApprox = on_values(signature, near, Value.isApprox.__doc__)  # type: ignore[method-assign]

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
        return bool((abs(self._x) <= prec).all())


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


def on_table(rows: str) -> list[Callable[..., Any]]:
    """``on_values`` for each row "signature = formula", documented by the indented lines that follow it."""
    module = module_of_caller()
    split = [(*row.split(" = ", 1), doc) for row, doc in documented_rows(rows)]
    return [on_values(signature, text, doc, module) for signature, text, doc in split]


def on_values(signature: str, text: str, doc: str | None = "", module: str = "") -> Callable[..., Any]:
    """A function with a signature such as "dot(self: Motion, f: Force) -> number", given as a formula in text.

    See ``operator_kernels.Formula``. Arguments of other types, as lists or arrays of integers, are converted, or raise
    ArgumentError; where the name is an operator of Python, it returns NotImplemented. Compiled at its first call.
    """
    formula = operator_kernels.Formula.parsed(signature, text)
    name, inputs, output = formula.name, formula.inputs, formula.output
    kernel = operator_kernels.on_arrays(formula)

    def first(*given: Any) -> Any:
        scope["call"] = convert
        if READY:
            scope["call"] = operator_kernels.bind_values(formula, slot_offset(Value, "_x"), Value._classes, convert)
        return scope["call"](*given)

    def convert(*given: Any) -> Any:
        try:
            ready = [_converted(x, kind, what) for x, (what, kind) in zip(given, inputs.items(), strict=True)]
        except ArgumentError:
            if name.startswith("__"):
                return NotImplemented
            raise
        if output in ("number", "truth"):
            return kernel(*ready) if output == "number" else kernel(*ready) == 1.0
        out = np.empty(operator_kernels.SHAPES[output.lower()])
        kernel(*ready, out)
        return Value._classes[output].over(out) if output in Value._classes else out

    lines = [f"def {name}({formula.parameters}): return call({', '.join(inputs)})"]
    scope: dict[str, Any] = {"call": first, "__name__": module or module_of_caller()}
    function = function_from_text(name, lines, scope, f"value_{formula.label}")
    function.__doc__ = doc
    return function


def _converted(x: Any, kind: str, what: str) -> Any:
    """An argument as its kernel takes it. Raises ArgumentError if it cannot be one of that kind."""
    if kind == "number":
        return number(x, what)
    first, _, other = kind.partition("|")
    own = Value._classes.get(first)
    if own is not None and of_pinocchio(x, own.__name__):
        return own(x)._x  # type: ignore[call-arg]
    if own is not None and (not other or isinstance(x, own)):
        return expected(x, own, what)._x
    return array(x, operator_kernels.SHAPES[operator_kernels.array_kind(kind)], what)
