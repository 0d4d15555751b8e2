"""Argument checks of constructors and methods, and their errors."""

from __future__ import annotations

import math
import sys
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import ModelError, ShapeError, SpatialDynError
from ....model.robot_checks import masked

Array = NDArray[np.float64]
NUMBERS = "fiub"  # kinds of dtype that become float64
FACE = __package__.rpartition(".")[0]
CONVERTED = ("AngleAxis", "Force", "Frame", "Inertia", "Model", "Motion", "Quaternion", "SE3")  # of Pinocchio's own too
OF_PINOCCHIO = ("pinocchio.", "coal.", "eigenpy.")  # modules of Pinocchio's own classes and of rotations


class _Omitted:
    """What stands for an argument that is not given, where None is one that is refused."""

    def __repr__(self) -> str:
        return "..."


OMITTED: Any = _Omitted()


class ArgumentError(SpatialDynError, TypeError):
    """An argument of a wrong type or size; a TypeError, as from Boost.Python."""


class ValueRuntimeError(SpatialDynError, RuntimeError):
    """An argument of the right type that cannot be used, where Pinocchio raises a RuntimeError."""


class SizeError(ShapeError, ArgumentError, ValueRuntimeError):
    """An array of numbers of a wrong size; from Pinocchio a TypeError, ValueError or RuntimeError, by the call."""


class RangeError(SpatialDynError, IndexError, OverflowError):
    """An index of a joint or frame that the model does not have."""


def array(value: Any, shape: tuple[int, ...], what: str) -> Array:
    """A new float64 array of that shape; a column (n, 1) is taken for (n,)."""
    if isinstance(value, np.ndarray) and value.dtype.kind in NUMBERS and not masked(value):
        made = np.empty(shape)
        value = np.asarray(value)  # a slice of an np.matrix keeps two axes
        if value.shape == shape:
            made[...] = value
            return made
        if value.shape == (*shape, 1):
            made[...] = value[..., 0]
            return made
        raise SizeError(f"{what} is {described(value)}, expected an array of shape {shape}")
    raise ArgumentError(f"{what} is {described(value)}, expected an array of shape {shape}")


def described(value: Any) -> str:
    """A value by type, shape and dtype, for error messages; a class of another package with its module."""
    if value is OMITTED:
        return "left out"
    if isinstance(value, np.ndarray):
        if masked(value):
            return "a masked array, whose mask would be lost"
        return f"an array of shape {value.shape} and dtype {value.dtype}"
    kind = type(value)
    if kind.__module__ == "builtins" or f"{kind.__module__}.".startswith(f"{FACE}."):
        return f"a {kind.__name__}"
    converts = [f"{FACE}.{name}(...) converts" for name in CONVERTED if of_pinocchio(value, name)]
    cures = [*converts, *[f"{FACE}.install() avoids"] * kind.__module__.startswith("pinocchio.")]
    if kind.__module__.startswith("spatialdyn.model.") and kind.__name__ == "Model":
        cures = ["the calls of spatialdyn itself take"]
    return f"a {kind.__module__}.{kind.__qualname__}" + f", which {' and '.join(cures)}" * bool(cures)


def of_pinocchio(value: Any, kind: str) -> bool:
    """Whether a value is of Pinocchio's own class of that name; those of its symbolic numbers are left out."""
    given: Any = type(value)
    return _is_pinocchios(given, kind)


@lru_cache(256)
def _is_pinocchios(given: Any, kind: str) -> bool:
    return any(
        x.__name__ == kind and f"{x.__module__}.".startswith(OF_PINOCCHIO) and "casadi" not in x.__module__
        for x in given.__mro__
    )


def only(given: tuple[Any, ...], what: str, wanted: str) -> Any:
    """The one argument that is given, OMITTED without any. Raises ArgumentError if there are more."""
    found = [x for x in given if x is not OMITTED]
    if len(found) > 1:
        raise ArgumentError(f"{what} got {', '.join(map(described, found))}, expected {wanted}")
    return found[0] if found else OMITTED


def expected(value: Any, kind: type, what: str) -> Any:
    """The value itself. Raises ArgumentError if it is not of that type."""
    if not isinstance(value, kind):
        raise ArgumentError(f"{what} is {described(value)}, expected {kind.__name__}")
    return value


def path(value: Any, what: str) -> Any:
    """The str or Path itself. Raises ArgumentError for anything else."""
    if not isinstance(value, str) and not hasattr(value, "__fspath__"):
        raise ArgumentError(f"{what} is {described(value)}, expected a str or Path")
    return value


def urdf_text(value: Any, what: str) -> str:
    """The text itself. Raises ArgumentError, or ModelError for what is no XML, as a path."""
    text: str = expected(value, str, what)
    if not text.lstrip("\ufeff \t\r\n").startswith("<"):
        raise ModelError(f"{what} is {text[:40]!r}, expected URDF text")
    return text


def all_expected(values: Any, kind: type, what: str) -> Any:
    """The values themselves. Raises ArgumentError, naming the first item that is not of that type."""
    for k, x in enumerate(values):
        if not isinstance(x, kind):
            raise ArgumentError(f"{what}[{k}] is {described(x)}, expected {kind.__name__}")
    return values


def number(value: Any, what: str) -> float:
    """A real number as Boost.Python takes one: int, float and their subclasses."""
    if not isinstance(value, (int, float, np.floating, np.integer)):
        raise ArgumentError(f"{what} is {described(value)}, expected a number")
    return float(value)


def near(a: Array, b: Array, precision: float) -> bool:
    """|a - b| <= precision min(|a|, |b|) in the Euclidean norm."""
    x, y = a.ravel().tolist(), b.ravel().tolist()
    return math.dist(x, y) <= precision * min(math.hypot(*x), math.hypot(*y))


def by_name(call: str, names: str, arguments: tuple[Any, ...], named: dict[str, Any], least: int = 0) -> dict[str, Any]:
    """The arguments of a call by their names, of which the first ``least`` have to be given, and each only once."""
    order = names.split()
    given = {**dict(zip(order, arguments, strict=False)), **named}
    if len(given) < len(arguments) + len(named) or not {*order[:least]} <= {*given} <= {*order}:
        got = " and ".join(filter(None, [f"{len(arguments)} arguments", ", ".join(named)]))
        raise ArgumentError(
            f"{call} got {got}, expected {', '.join([*order[:least], *map('[{}]'.format, order[least:])])}"
        )
    return given


def row(values: Any, width: int = 0) -> str:
    """Numbers side by side with six digits, right-aligned."""
    texts = [f"{x:g}" for x in values]
    width = max(width, *map(len, texts))
    return " ".join(text.rjust(width) for text in texts)


def rows(matrix: Any) -> str:
    """A matrix with six digits, all columns of one width."""
    width = max(len(f"{x:g}") for line in matrix for x in line)
    return "\n".join(row(line, width) for line in matrix)


def module_of_caller() -> str:
    """Name of the module whose line calls the calling function: the ``__module__`` of what that makes."""
    return str(sys._getframe(2).f_globals["__name__"])
