"""Operators on small arrays, and on objects that hold one, compiled: the arithmetic of SE3, Motion, Force, Inertia.

``compose(A, B, out)`` and its like take arrays as ``algebra.public_arrays`` lays them out and write ``out`` in place;
it may be an input. Arrays have to be float64, C-ordered, writable and of the right size: nothing is checked.
``value_builtin`` makes functions of Python's own calling convention that check their arguments and make the result.

A call takes 0.1 to 0.2 µs; the operator takes 1 to 6 in plain Python. Each is compiled at its first call and cached on
disk.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np

from ...algebra import lie, public_arrays, spatial
from ...engines.compiled import numba_kernels
from ...engines.object_layout import DATA, RANK, SHAPE, TYPE
from . import operators

Operation = Callable[..., Any]
SHAPES: dict[str, tuple[int, ...]] = {
    "pose": (4, 4), "motion": (6,), "force": (6,), "vec": (3,), "rot": (3, 3), "quat": (4,), "seven": (7,),
    "body": (10,), "inertia": (6, 6), "tangent": (6, 6), "number": (),
}  # fmt: skip


# --- on arrays ---------------------------------------------------------------------------------------------


def deferred(make: Callable[[], Operation]) -> Operation:
    """A function that another one makes at its first call: Numba takes milliseconds to list a function."""
    kernel = None

    def call(*arguments: Any) -> Any:
        nonlocal kernel
        kernel = kernel or make()
        return kernel(*arguments)

    return call


def on_arrays(name: str, operator: Operation, kinds: str) -> Operation:
    """A kernel ``(*inputs, out)`` for an operator of these kinds, as "pose vec -> vec"; a "number" is returned."""
    inputs, (output,) = (part.split() for part in kinds.split("->"))
    names = [f"x{k}" for k in range(len(inputs))]
    result = f"operator({', '.join(_read(kind, x) for x, kind in zip(names, inputs, strict=True))})"
    statement = f"return {result}" if output == "number" else f"write_{output}(out, {result})"
    return deferred(
        lambda: compiled_text(f"algebra_{name}", names + ["out"] * (output != "number"), [statement], operator)
    )


def compiled_text(name: str, parameters: list[str], body: list[str], operator: Operation) -> Operation:
    """A kernel of statements that call ``operator`` and the readers and writers of ``public_arrays``."""
    from ...engines.compiled import jit

    scope = {**vars(public_arrays), "operator": operator}
    function = numba_kernels.kernel_from_text(name, parameters, ["stamp", *body], scope)
    return jit.numba_jit(function, nogil=False)  # releasing the GIL costs 0.03 µs


def _read(kind: str, x: str) -> str:
    return x if kind == "number" else f"read_{kind}({x})"


compose = on_arrays("compose", spatial.compose, "pose pose -> pose")
motion_to_parent = on_arrays("motion_to_parent", spatial.motion_to_parent, "pose motion -> motion")
force_to_parent = on_arrays("force_to_parent", spatial.force_to_parent, "pose force -> force")
force_to_child = on_arrays("force_to_child", spatial.force_to_child, "pose force -> force")
body_to_parent = on_arrays("body_to_parent", operators.body_to_parent, "pose body -> body")
add_body = on_arrays("add_body", operators.add_bodies, "body body -> body")
quat_matrix = on_arrays("quat_matrix", lie.matrix, "quat -> rot")


# --- on objects --------------------------------------------------------------------------------------------


@cache
def value_builtin(label: str, operator: Operation, inputs: tuple[str, ...], output: str) -> Any:
    """A builtin ``(*inputs) -> output`` that returns None if not applicable.

    A kind in lower case is a new array, as an input a float64 array of any strides, or a float for "number". A
    capitalized kind is an object of one class whose slot holds the array, and "Motion|motion" is either.

    Words: ``slot``, the offset of the slot; ``class0``, ... the classes of the inputs, 0 for arrays; ``made``, that of
    the output; ``extent0``, ... the axes of its array.
    """
    from ...engines.compiled.cpython import Builtin, dims

    names = [f"x{k}" for k in range(len(inputs))]
    extents = SHAPES[output.lower()]
    words = ["slot", *(f"class{k}" for k in range(len(inputs))), "made", *(f"extent{k}" for k in range(len(extents)))]
    body = [line for k, kind in enumerate(inputs) for line in _input_statements(k, kind)]
    passed = (_read(kind.lower().partition("|")[0], f"{x}_in") for x, kind in zip(names, inputs, strict=True))
    result = f"operator({', '.join(passed)})"
    if output == "number":
        body.append(f"return new_real(plan, {result})")
    else:
        body += [
            f"result = {result}",
            f"answer = new_array(plan, {len(extents)}, {dims(words, 'extent0')})",
            "if answer == 0: return 0",
            f"write_{output.lower()}(at(word(answer, {DATA}), {extents}), result)",
            "return new_object(plan, made, slot, answer)" if output[0].isupper() else "return answer",
        ]
    return Builtin(f"value_{label}", names, words, body, {**vars(public_arrays), "operator": operator})


def _input_statements(k: int, kind: str) -> list[str]:
    """Statements that check the argument object ``xk`` and read it as an array or number ``xk_in``."""
    x, shape = f"x{k}", SHAPES[kind.lower().partition("|")[0]]
    if kind == "number":
        return [f"if not is_real(plan, {x}): return return_none(plan)", f"{x}_in = real({x})"]
    lines = []
    if kind[0].isupper():
        if "|" not in kind:
            lines = [f"if word({x}, {TYPE}) != class{k}: return return_none(plan)"]
        lines.append(f"if word({x}, {TYPE}) == class{k}: {x} = word({x} + slot, 0)")
        lines.append(f"if {x} == 0: return return_none(plan)")  # a slot without a value
    if len(shape) == 1:
        fits, view = f"is_vector(plan, {x}, {shape[0]})", f"vector({x}, {shape[0]})"
    else:
        fits, view = f"is_matrix(plan, {x}, {shape[1]}) and word(word({x}, {SHAPE}), 0) == {shape[0]}", f"matrix({x})"
    return [*lines, f"if not ({fits}): return return_none(plan)", f"{x}_in = {view}"]


def bind_values(builtin: Any, slot: int, classes: Mapping[str, type], inputs: tuple[str, ...], output: str) -> Any:
    """A ``value_builtin`` bound to the classes of its kinds and the offset of their slot."""

    def address(kind: str) -> int:
        return id(classes[kind.partition("|")[0]]) if kind[0].isupper() else 0

    words = {f"class{k}": address(kind) for k, kind in enumerate(inputs)}
    words |= {f"extent{k}": n for k, n in enumerate(SHAPES[output.lower()])}
    return builtin.bind(*classes.values(), slot=slot, made=address(output), **words)


@cache
def draw_between(generator: Any, units: tuple[tuple[int, int], ...] = ()) -> Any:
    """A builtin ``(lower, upper) -> (n,)`` of ``operators.between`` with draws of a generator of NumPy.

    units  first index and size of parts of unit norm, drawn by ``operators.put_direction``

    Returns None if not applicable. A call of the generator takes Python 0.5 µs and more, a draw 2 ns.
    """
    interface = generator.bit_generator.ctypes  # NumPy offers it for compiled code
    address = ctypes.cast(interface.next_double, ctypes.c_void_p).value or 0
    parts, builtin = np.array(units, np.int64).ravel(), _draw_between()
    words = {"units": parts.ctypes.data, "count": len(units)}
    return builtin.bind(generator, parts, next_double=address, state=interface.state_address, **words)


@cache
def _draw_between() -> Any:
    from ...engines.compiled.cpython import NDARRAY, Builtin, real_function

    body = [
        f"if word(lower, {TYPE}) != word(plan, {NDARRAY}) or word(lower, {RANK}) & 0xFFFFFFFF != 1:",
        "    return return_none(plan)",
        f"n = word(word(lower, {SHAPE}), 0)",
        "if not (is_vector(plan, lower, n) and is_vector(plan, upper, n)): return return_none(plan)",
        f"answer = new_array(plan, 1, word(lower, {SHAPE}))",
        "if answer == 0: return 0",
        f"low, high, out = vector(lower, n), vector(upper, n), at(word(answer, {DATA}), (n,))",
        "for k in range(n): out[k] = between(low[k], high[k], draw(next_double, state))",
        "for k in range(count):",
        "    first, size = word(units, 2 * k), word(units, 2 * k + 1)",
        "    share, one, two = draw(next_double, state), draw(next_double, state), draw(next_double, state)",
        "    put_direction(out, first, size, share, one, two)",
        "return answer",
    ]
    scope = {"between": operators.between, "put_direction": operators.put_direction, "draw": real_function}
    return Builtin("draw_between", ["lower", "upper"], ["next_double", "state", "units", "count"], body, scope)
