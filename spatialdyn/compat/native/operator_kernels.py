"""Operators on small arrays, and on objects that hold one, compiled: the arithmetic of SE3, Motion, Force, Inertia.

``compose(A, B, out)`` and its like take arrays as ``algebra.public_arrays`` lays them out and write ``out`` in place;
it may be an input. Arrays have to be float64, C-ordered, writable and of the right size: nothing is checked.
``bind_values`` makes builtins of Python that check their arguments and make the result.

A call is much faster than the operator in plain Python, which answers until compiling pays.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from inspect import signature
from typing import Any, NamedTuple

import numpy as np

from ...algebra import euclidean, lie, public_arrays, spatial
from ...engines.compiled import numba_kernels
from ...engines.compiled.entries import of_memory
from ...engines.compiled.tiers import Tiered, Twin, real_of
from ...engines.programs.run.routine import Held, Kind, Routine, Shape, Truth
from ...engines.programs.run.single_call import unavailable
from . import operators

Operation = Callable[..., Any]
SCOPE: dict[str, Any] = {**vars(euclidean), **vars(spatial), **vars(lie), **vars(operators), **vars(public_arrays)}
SCOPE["rotation_matrix"] = SCOPE.pop("matrix")  # of a quaternion
SHAPES: dict[str, tuple[int, ...]] = {
    "pose": (4, 4), "motion": (6,), "force": (6,), "vec": (3,), "rot": (3, 3), "quat": (4,), "seven": (7,),
    "body": (10,), "inertia": (6, 6), "tangent": (6, 6), "number": (), "truth": (),
}  # fmt: skip


class Formula(NamedTuple):
    """A function of values: its name, its arguments with their kinds, the kind of its result, and how to compute it.

    A kind in lower case is an array, or a float for "number". A capitalized kind is an object of one class whose slot
    holds the array; "Motion|motion" is either. A "truth" is 1.0 or 0.0.

    parameters  of a function of Python, with defaults
    text        an expression of the arguments and functions of the algebra; ``x_in`` is the array of the argument x
    """

    name: str
    inputs: dict[str, str]
    output: str
    text: str
    parameters: str

    @classmethod
    def parsed(cls, signature: str, text: str) -> Formula:
        """From a signature such as "near(self: Motion, other: Motion, prec: number = 1e-12) -> truth"."""
        name, arguments, output = re.split(r"\(|\) -> ", signature)
        inputs = dict(re.findall(r"(\w+): ([\w|]+)", arguments))
        return cls(name, inputs, output, text, re.sub(r": [\w|]+(?: (=) )?", r"\1", arguments))

    @property
    def label(self) -> str:
        """Its name and kinds."""
        return "_".join([self.name, *self.inputs.values(), self.output]).replace("|", "_or_")

    def statements(self) -> list[str]:
        """Statements that compute ``result`` from arrays and numbers ``x_in``."""
        reads = [f"{x} = {_read(array_kind(kind), f'{x}_in')}" for x, kind in self.inputs.items()]
        return [*reads, f"result = {self.text}"]


def array_kind(kind: str) -> str:
    """The kind of the array of an argument."""
    return kind.lower().partition("|")[0]


def _read(kind: str, x: str) -> str:
    return f"read_{kind}({x})" if SHAPES[kind] else x


# --- on arrays ---------------------------------------------------------------------------------------------


def deferred(make: Callable[[], Operation]) -> Operation:
    """A function that another one makes at its first call: Numba takes milliseconds to list a function."""
    kernel = None

    def call(*arguments: Any) -> Any:
        nonlocal kernel
        kernel = kernel or make()
        return kernel(*arguments)

    return call


def on_arrays(formula: Formula) -> Operation:
    """A kernel ``(*inputs, out)`` of a formula; a number is returned."""
    output, parameters = formula.output.lower(), [f"{x}_in" for x in formula.inputs]
    if not SHAPES[output]:
        return compiled_text(formula.label, parameters, [*formula.statements(), "return result"])
    return compiled_text(formula.label, [*parameters, "out"], [*formula.statements(), f"write_{output}(out, result)"])


def compiled_text(name: str, parameters: Sequence[str], body: Sequence[str], **scope: Any) -> Operation:
    """A kernel of statements that name functions of the algebra and of ``scope``, made at its first call.

    Plain Python runs it until compiling pays (``tiers``).
    """

    def source(plain: bool) -> Operation:
        text, names = ["stamp", *body], {**SCOPE, **scope}
        return numba_kernels.kernel_from_text(f"algebra_{name}", list(parameters), text, names)

    def jitted(made: Operation) -> Any:
        from ...engines.compiled import jit

        return jit.numba_jit(made, nogil=False, contract=False)  # releasing the GIL costs time

    return Tiered(source, jitted)


def compiled(function: Operation) -> Operation:
    """A kernel of an inlined function, with its parameters."""
    names = [*signature(function).parameters]
    return compiled_text(function.__name__.strip("_"), names, [f"function({', '.join(names)})"], function=function)


compose, motion_to_parent, force_to_parent, force_to_child, body_to_parent, add_body = (
    on_arrays(Formula.parsed(f"{name}(A: {kinds[0]}, B: {kinds[1]}) -> {kinds[1]}", f"{name}(A, B)"))
    for name, *kinds in (
        ("compose", "pose", "pose"), ("motion_to_parent", "pose", "motion"), ("force_to_parent", "pose", "force"),
        ("force_to_child", "pose", "force"), ("body_to_parent", "pose", "body"), ("add_bodies", "body", "body"),
    )
)  # fmt: skip
quat_matrix = on_arrays(Formula.parsed("matrix(q: quat) -> rot", "rotation_matrix(q)"))


# --- on objects --------------------------------------------------------------------------------------------


def value_routine(formula: Formula) -> Routine:
    """``(*inputs) -> output`` of a formula.

    Inputs that are arrays may have any strides, results are new. Words: ``slot``, the offset of the slot; ``class0``,
    ... the classes of the inputs, 0 for arrays; ``made``, that of the output.
    """

    def kind(x: str, word: str) -> Shape | Held:
        shape = SHAPES[array_kind(x)]
        return Held(shape, word, "slot", "|" in x) if x[0].isupper() else shape

    inputs: dict[str, Kind] = {
        f"{x}_in": kind(given, f"class{k}") for k, (x, given) in enumerate(formula.inputs.items())
    }
    output = formula.output.lower()
    last = f"write_{output}(out, result)" if SHAPES[output] else "out[0] = result"
    body = [*formula.statements(), last, "return 1"]
    result: Shape | Held | Truth = Truth() if output == "truth" else kind(formula.output, "made")
    return Routine(f"value_{formula.label}", [], inputs, body, SCOPE, result)


def bind_values(
    formula: Formula, slot: int, classes: Mapping[str, type], otherwise: Operation = unavailable
) -> Operation:
    """The builtin of a ``value_routine`` for the classes of its kinds and the offset of their slot."""

    def address(kind: str) -> int:
        return id(classes[kind.partition("|")[0]]) if kind[0].isupper() else 0

    words = {f"class{k}": address(kind) for k, kind in enumerate(formula.inputs.values())}
    words |= {"slot": slot, "made": address(formula.output)}
    return value_routine(formula).bind(words, *classes.values(), otherwise=otherwise)


@cache
def draw_between(generator: Any, size: int, units: tuple[tuple[int, int], ...] = ()) -> Callable[..., Any]:
    """A builtin ``(lower, upper) -> (size,)`` of ``operators.between`` with draws of a generator of NumPy.

    units  first index and size of parts of unit norm, drawn by ``operators.put_direction``

    Returns None if not applicable. A call of the generator from Python takes far longer than a draw.
    """
    interface = generator.bit_generator.ctypes  # NumPy offers it for compiled code
    address = ctypes.cast(interface.next_double, ctypes.c_void_p).value or 0
    parts = np.array(units, np.int64).ravel()
    words = {"units": parts.ctypes.data, "count": len(units), "n": size}
    words |= {"next_double": address, "state": interface.state_address}
    return _draw_between().bind(words, generator, parts)


@cache
def _draw_between() -> Routine:
    body = [
        "for k in range(n): out[k] = between(lower[k], upper[k], draw(next_double, state))",
        "for k in range(count):",
        "    first, size = word(units, 2 * k), word(units, 2 * k + 1)",
        "    share, one, two = draw(next_double, state), draw(next_double, state), draw(next_double, state)",
        "    put_direction(out, first, size, share, one, two)",
        "return 1",
    ]
    scope = {
        "between": operators.between,
        "put_direction": operators.put_direction,
        "draw": Twin(real_of, of_memory("real_function")),
    }
    inputs: dict[str, Kind] = {"lower": ("n",), "upper": ("n",)}
    return Routine("draw_between", ["next_double", "state", "units", "count", "n"], inputs, body, scope, ("n",))
