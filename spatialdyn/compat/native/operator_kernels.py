"""Operators on small arrays, and on objects that hold one, compiled: the arithmetic of SE3, Motion, Force, Inertia.

``compose(A, B, out)`` and its like take arrays as ``algebra.public_arrays`` lays them out and write ``out`` in place;
it may be an input. Arrays have to be float64, C-ordered, writable and of the right size: nothing is checked.
``Operator.bind`` makes builtins of Python that check their arguments and make the result.

A call is much faster than the operator in plain Python, which answers until compiling pays.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ...algebra import public_arrays, spatial
from ...algebra.euclidean import Vec
from ...algebra.public_arrays import (
    read_body,
    read_force,
    read_motion,
    read_pose,
    write_body,
    write_force,
    write_motion,
    write_pose,
)
from ...algebra.scalars import inline
from ...engines.compiled.memory import real_of, word
from ...engines.compiled.stamp import STAMP, covers
from ...engines.compiled.tiers import Tiered
from ...engines.programs.run.routine import Owner, Result, Routine, Shape, Truth, routine
from ...engines.programs.run.single_call import unavailable
from . import operators

Operation = Callable[..., Any]


class Kind(NamedTuple):
    """What an operator takes or returns: the shape of an array and the functions that read and write it.

    owner     key of the class whose objects hold the array; "" for the array itself, or a float
    or_array  the array itself is taken too
    default   of an argument; None if it has to be given
    """

    shape: tuple[int, ...]
    read: Operation
    write: Operation
    owner: str = ""
    or_array: bool = False
    default: float | None = None


@inline
def _write_number(out: Any, x: Any) -> None:
    out[0] = x


SHAPES: dict[str, tuple[int, ...]] = {
    "pose": (4, 4), "motion": (6,), "force": (6,), "vec": (3,), "rot": (3, 3), "quat": (4,), "seven": (7,),
    "body": (10,), "inertia": (6, 6), "tangent": (6, 6),
}  # fmt: skip
_NUMBER = Kind((), operators.itself, _write_number)
KINDS: dict[str, Kind] = {"number": _NUMBER, "truth": _NUMBER, "precision": _NUMBER._replace(default=1e-12)}
for _name, _shape in SHAPES.items():
    # a kind in lower case is the array; a capitalized one an object that holds it; "Motion|motion" is either
    _read, _write = getattr(public_arrays, f"read_{_name}", operators.itself), getattr(public_arrays, f"write_{_name}")
    _kind = Kind(_shape, _read, _write)
    KINDS[_name], KINDS[_name.capitalize()] = _kind, _kind._replace(owner=_name.capitalize())
    KINDS[f"{_name.capitalize()}|{_name}"] = _kind._replace(owner=_name.capitalize(), or_array=True)


# --- on arrays ---------------------------------------------------------------------------------------------


def deferred(make: Callable[[], Operation]) -> Operation:
    """A function that another one makes at its first call: Numba takes milliseconds to list a function."""
    kernel = None

    def call(*arguments: Any) -> Any:
        nonlocal kernel
        kernel = kernel or make()
        return kernel(*arguments)

    return call


def compiled(function: Operation, name: str = "") -> Operation:
    """A kernel of a function of compiled code; ``name`` says what it captures. Plain Python runs it until that pays."""

    def jitted(made: Operation) -> Any:
        from ...engines.compiled import jit

        key = repr((STAMP, made.__module__, made.__qualname__, name)) if covers(made) else ""
        # releasing the GIL costs time
        return jit.numba_jit(made, nogil=False, keep=bool(key), contract=False, key=key)

    return Tiered(lambda: function, jitted)


def label(function: Operation) -> str:
    """The name of a function, with its module."""
    return f"{function.__module__}.{function.__name__}"


def _on_pair(function: Operation, read_a: Operation, read_b: Operation, write: Operation) -> Operation:
    """A kernel ``(a, b, out)`` of a function."""

    def on_pair(a: Any, b: Any, out: Any) -> None:
        write(out, function(read_a(a), read_b(b)))

    return compiled(on_pair, label(function))


compose = _on_pair(spatial.compose, read_pose, read_pose, write_pose)
force_to_parent = _on_pair(spatial.force_to_parent, read_pose, read_force, write_force)
force_to_child = _on_pair(spatial.force_to_child, read_pose, read_force, write_force)
body_to_parent = _on_pair(operators.body_to_parent, read_pose, read_body, write_body)
add_body = _on_pair(operators.add_bodies, read_body, read_body, write_body)


def _on_rows(function: Operation, read_a: Operation, read_b: Operation, write: Operation) -> Operation:
    """``(a, places, b, out)``: out[k] = function(a[places[k]], b[k]), a kernel on rows of arrays."""

    def rows(a: Any, places: Any, b: Any, out: Any) -> None:
        for k in range(len(places)):
            write(out[k], function(read_a(a[places[k]]), read_b(b[k])))

    return compiled(rows, label(function))


compose_all = _on_rows(spatial.compose, read_pose, read_pose, write_pose)
relative_all = _on_rows(operators.relative_pose, read_pose, read_pose, write_pose)
motions_to_parent = _on_rows(spatial.motion_to_parent, read_pose, read_motion, write_motion)
motions_to_child = _on_rows(spatial.motion_to_child, read_pose, read_motion, write_motion)
forces_to_parent = _on_rows(spatial.force_to_parent, read_pose, read_force, write_force)
bodies_to_parent = _on_rows(operators.body_to_parent, read_pose, read_body, write_body)
momenta = _on_rows(operators.body_momentum, read_body, read_motion, write_force)


def on_motions(function: Operation) -> Operation:
    """A kernel ``(v, a, out)`` of a function of two motions that writes an array."""

    def of_motions(v: Any, a: Any, out: Any) -> None:
        function(read_motion(v), read_motion(a), out)

    return compiled(of_motions, label(function))


# --- on objects --------------------------------------------------------------------------------------------


class Operator(NamedTuple):
    """A function of values: its arguments and its result, as names of ``KINDS``.

    raw      the function takes the arrays themselves
    in_place  the result is written to the first argument, and the output is a truth, True
    """

    function: Operation
    inputs: dict[str, str]
    output: str
    raw: bool = False
    in_place: bool = False

    @property
    def kinds(self) -> list[Kind]:
        """Of the arguments."""
        return [KINDS[x] for x in self.inputs.values()]

    def on_arrays(self) -> Callable[..., bool]:
        """The function as ``(*arrays, out) -> True``; a number is written to ``out[0]``."""
        function, write = self.function, KINDS[self.output].write
        reads = [operators.itself if self.raw else x.read for x in self.kinds]
        read0, read1, read2 = (*reads, *[operators.itself] * 3)[:3]

        def of_none(out: Any) -> bool:
            write(out, function())
            return True

        def of_one(x0: Any, out: Any) -> bool:
            write(out, function(read0(x0)))
            return True

        def of_two(x0: Any, x1: Any, out: Any) -> bool:
            write(out, function(read0(x0), read1(x1)))
            return True

        def of_three(x0: Any, x1: Any, x2: Any, out: Any) -> bool:
            write(out, function(read0(x0), read1(x1), read2(x2)))
            return True

        def to_first(x0: Any, x1: Any, out: Any) -> bool:
            write_first(x0, function(read0(x0), read1(x1)))
            write(out, 1.0)
            return True

        if self.in_place:
            write_first = self.kinds[0].write
            return to_first
        return (of_none, of_one, of_two, of_three)[len(reads)]

    def in_plain_python(self, *arrays: Any) -> Any:
        """The result of arrays and numbers, an array, a number or a truth."""
        shape = KINDS[self.output].shape
        out = np.empty(shape or (1,))
        with np.errstate(all="ignore"):
            self.on_arrays()(*arrays, out)
        return out if shape else bool(out[0]) if self.output == "truth" else float(out[0])

    def routine(self) -> Routine:
        """``(*inputs) -> output``: inputs that are arrays may have any strides, results are new.

        Words: ``slot``, the offset of the slot; ``class0``, ... the classes of the inputs, and ``made``.
        """

        def described(kind: Kind, word: str) -> Shape | Owner:
            return Owner(kind.shape, word, "slot", kind.or_array) if kind.owner else kind.shape

        inputs = {f"x{k}": described(kind, f"class{k}") for k, kind in enumerate(self.kinds)}
        output: Result = Truth() if self.output == "truth" else described(KINDS[self.output], "made")
        name = "_".join(
            [label(self.function), *self.inputs.values(), self.output, "raw" * self.raw, "in_place" * self.in_place]
        )
        return Routine(inline(self.on_arrays()), inputs, output, name)

    def bind(self, slot: int, classes: Mapping[str, type], otherwise: Operation = unavailable) -> Operation:
        """The builtin of the ``routine`` for the classes of its kinds and the offset of their slot."""
        owners = {f"class{k}": kind.owner for k, kind in enumerate(self.kinds)} | {"made": KINDS[self.output].owner}
        words = {x: id(classes[owner]) if owner else 0 for x, owner in owners.items()}
        return self.routine().bind({"slot": slot, **words}, *classes.values(), otherwise=otherwise)


def draw_pose(generator: Any, slot: int, made: type, otherwise: Operation) -> Operation:
    """A builtin ``() -> pose`` of ``operators.random_pose`` with draws of a generator of NumPy, in their order.

    made  class of the pose, which has its array in the slot at an offset
    """
    words = {"slot": slot, "made": id(made), **_draws_of(generator)}
    return _draw_pose.bind(words, generator, made, otherwise=otherwise)


@routine(Owner((4, 4), "made", "slot"))
def _draw_pose(next_double: int, state: int, out: Any) -> bool:
    x, y, z = real_of(next_double, state), real_of(next_double, state), real_of(next_double, state)
    turn = Vec(x, y, z)
    x, y, z = real_of(next_double, state), real_of(next_double, state), real_of(next_double, state)
    write_pose(out, operators.random_pose(spatial.Motion(Vec(x, y, z), turn)))
    return True


def _draws_of(generator: Any) -> dict[str, int]:
    """Words: the address of the function that draws a number in [0, 1), which NumPy offers, and of its state."""
    interface = generator.bit_generator.ctypes
    address = ctypes.cast(interface.next_double, ctypes.c_void_p).value or 0
    return {"next_double": address, "state": interface.state_address}


def draw_between(
    generator: Any, size: int, units: tuple[tuple[int, int], ...] = (), **limits: np.ndarray
) -> Callable[..., Any]:
    """A builtin ``(lower, upper) -> (size,)`` of ``operators.between`` with draws of a generator of NumPy.

    units   first index and size of parts of unit norm, drawn by ``operators.put_direction``
    limits  lower and upper, which it then reads where they are

    Returns None if not applicable. A call of the generator from Python takes far longer than a draw.
    """
    parts = np.array(units, np.int64).ravel()
    words = {"units": parts, "count": len(units), "n": size, **_draws_of(generator)}
    return _draw_between.bind({**words, **limits}, generator)


@routine(("n",), lower=("n",), upper=("n",))
def _draw_between(
    lower: Any, upper: Any, next_double: int, state: int, units: int, count: int, n: int, out: Any
) -> bool:
    for k in range(n):
        out[k] = operators.between(lower[k], upper[k], real_of(next_double, state))
    for k in range(count):
        share, one, two = real_of(next_double, state), real_of(next_double, state), real_of(next_double, state)
        operators.put_direction(out, word(units, 2 * k), word(units, 2 * k + 1), share, one, two)
    return True
