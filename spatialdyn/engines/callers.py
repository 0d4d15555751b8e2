"""The shortest ways from arrays in Python to a compiled program: Numba functions that take the arrays.

Numba reads arrays (0.1 µs each; ctypes needs 1 µs for an address), checks sizes, layout and overlap, and calls the
program by its address. One such function serves all programs with as many inputs and outputs; what differs between
them is in ``plan``, an array that it gets the address of: ``one`` runs a single sample on a program of one lane,
``many`` a batch, tile by tile.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from ..recursions.checks import apart
from ..scalars import inlined
from . import jit

_LOCK = threading.RLock()
_WORD = ir.IntType(64)


def plan(address: int, workspace: int, lanes: int, shapes: Sequence[tuple[int, ...]]) -> NDArray[np.int64]:
    """What a caller has to know of a program: address, words of workspace, lanes, the axes of inputs and outputs."""
    return np.array([address, workspace // 8 + 1, lanes, *(n for shape in shapes for n in shape)], np.int64)


@cache
def one(inputs: tuple[int, ...], outputs: tuple[int, ...]) -> Callable[..., int]:
    """``(address of plan, *inputs, *outputs) -> status`` of one sample, for arrays of these ranks; rank 0 is a float.

    0 says that the results are there; anything else that they are not, and that another way has to say why.
    """
    with _LOCK:
        ins, outs = [f"x{k}" for k in range(len(inputs))], [f"y{k}" for k in range(len(outputs))]
        at, wrong, body = 3, [], []
        for name, rank in zip(ins + outs, inputs + outputs, strict=True):
            wrong += [f"{name}.shape[{axis}] != word(plan, {at + axis})" for axis in range(rank)]
            at += rank
        for name, rank in zip(ins, inputs, strict=True):
            if rank:
                wrong.append(f"{name}.strides[{rank - 1}] != 8")
            wrong += [f"{name}.strides[{axis}] != 8 * {name}.shape[1]" for axis in range(rank - 1)]
            wrong += [f"not apart({name}, {out})" for out in outs if rank]
        wrong += [f"not apart({b}, {a})" for k, a in enumerate(outs) for b in outs[k + 1 :]]
        body = ["stamp", f"if {' or '.join(wrong)}:", "    return 1"]
        for name, rank in zip(ins, inputs, strict=True):
            if not rank:
                body += [f"{name}_at = empty(1)", f"{name}_at[0] = {name}"]
        sources = _tuple([name if rank else f"{name}_at" for name, rank in zip(ins, inputs, strict=True)])
        fixed = _tuple(["0"] * len(ins))
        body.append("bits = empty(1, uint16)")
        body.append(f"run(plan, 1, {sources}, {fixed}, {_tuple(outs)}, bits, stack(word(plan, 1)))")
        body.append("return 0 if bits[0] == 1 else 1")
        label = "_".join(["one", *map(str, inputs), "to", *map(str, outputs)])
        function = jit.define(label, ["plan", *ins, *outs], body, dict(_SCOPE))
        array: Any = types.Array
        given = [array(types.float64, rank, "A", readonly=True) if rank else types.float64 for rank in inputs]
        made = [array(types.float64, rank, "C") for rank in outputs]
        return jit.compiled(function, (types.intp, *given, *made), nogil=False)  # giving it up takes 0.03 µs of 0.4


@cache
def many(inputs: int, outputs: int, dtype: np.dtype) -> Callable[..., int]:
    """``(address of plan, *inputs, *outputs, bits) -> number of tiles not all in order`` of a batch; -1: does not fit.

    Inputs are (n, columns), or (1, columns) for all samples, outputs (n, columns), all of them in C order; bits holds
    one number a tile, with one bit a sample. A last tile that is not full runs on copies, filled up with the last.
    """
    with _LOCK:
        ins, outs = [f"x{k}" for k in range(inputs)], [f"y{k}" for k in range(outputs)]
        size = dtype.itemsize
        wrong = ["len(bits) * lanes < n"]
        for k, name in enumerate(ins):
            wrong += [f"{name}.shape[1] != word(plan, {3 + k})", f"({name}.shape[0] != n and {name}.shape[0] != 1)"]
            wrong += [f"({name}.shape[1] > 1 and {name}.strides[1] != {size})"]
            wrong += [f"({name}.shape[0] > 1 and {name}.strides[0] != {size} * {name}.shape[1])"]
            wrong += [f"not apart({name}, {out})" for out in outs]
        for k, name in enumerate(outs):
            wrong += [f"{name}.shape[1] != word(plan, {3 + inputs + k})", f"{name}.shape[0] != n"]
        wrong += [f"not apart({b}, {a})" for k, a in enumerate(outs) for b in outs[k + 1 :]]
        steps, last, tiles = (
            _tuple([word.format(x) for x in names])
            for word, names in (("step({}, n)", ins), ("{}_last", ins), ("{}_tile", outs))
        )
        body = [
            "stamp",
            "n, lanes = y0.shape[0], word(plan, 2)",
            f"if {' or '.join(wrong)}:",
            "    return -1",
            "tiles, room = n // lanes, aligned(8 * word(plan, 1), uint8)",
            f"run(plan, tiles, {_tuple(ins)}, {steps}, {_tuple(outs)}, bits, room)",
            "first = tiles * lanes",
            "if first < n:",
            *(f"    {x}_last = last({x}, first, n, lanes)" for x in ins),
            *(f"    {y}_tile = tile({y}, lanes)" for y in outs),
            f"    run(plan, 1, {last}, {steps}, {tiles}, bits[tiles:], room)",
            *(f"    {y}[first:] = {y}_tile[: n - first]" for y in outs),
            "    tiles += 1",
            "odd = 0",
            "for t in range(tiles):",
            "    if bits[t] != (1 << lanes) - 1:",
            "        odd += 1",
            "return odd",
        ]
        label = f"many_{inputs}_to_{outputs}_{dtype.name}"
        function = jit.define(label, ["plan", *ins, *outs, "bits"], body, dict(_SCOPE))
        array: Any = types.Array
        number = types.float64 if size == 8 else types.float32
        given = [array(number, 2, "A", readonly=True)] * inputs
        return jit.compiled(
            function, (types.intp, *given, *[array(number, 2, "C")] * outputs, array(types.uint16, 1, "C"))
        )


def _tuple(names: Sequence[str]) -> str:
    return f"({''.join(f'{name}, ' for name in names)})" if names else "()"


@inlined
def _step(x: Any, n: int) -> int:
    """Numbers from one sample to the next."""
    return 0 if len(x) < n else x.shape[1]


@inlined
def _aligned(count: int, dtype: Any) -> Any:
    """Room for so many numbers, on a vector's boundary."""
    raw = np.empty(count + 64, dtype)
    start = (-raw.ctypes.data % 64) // raw.itemsize
    return raw[start : start + count]


@inlined
def _tile(like: Any, lanes: int) -> Any:
    """Room for a tile of samples."""
    return _aligned(lanes * like.shape[1], like.dtype).reshape((lanes, like.shape[1]))


@inlined
def _last(x: Any, first: int, n: int, lanes: int) -> Any:
    """The samples from the first on as a tile, the last of them again and again where they end."""
    tile = _tile(x, lanes)
    for r in range(lanes):
        tile[r] = x[min(first + r, n - 1) if len(x) == n else 0]
    return tile


def _word_at(typing_context: Any, plan: Any, k: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _load(builder, *arguments)

    return types.int64(types.intp, types.intp), generate


def _load(builder: Any, plan: Any, k: Any) -> Any:
    return builder.load(builder.gep(builder.inttoptr(plan, _WORD.as_pointer()), [k]))


def _stack_at(typing_context: Any, words: Any) -> Any:
    """The address of so many words on the stack, until the function that asks returns."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        room = builder.alloca(_WORD, size=arguments[0])
        room.align = 64
        return builder.ptrtoint(room, _WORD)

    return types.intp(types.int64), generate


def _run_at(
    typing_context: Any, plan: Any, tiles: Any, sources: Any, steps: Any, targets: Any, bits: Any, room: Any
) -> Any:
    """Call the program of a plan for some tiles: on arrays, so that they live until it is done."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        at, count, inputs, strides, outputs, flags, workspace = arguments

        def start(kind: Any, value: Any) -> Any:
            data = value if isinstance(kind, types.Integer) else context.make_array(kind)(context, builder, value).data
            cast = builder.inttoptr if isinstance(kind, types.Integer) else builder.bitcast
            return cast(data, cgutils.voidptr_t)

        passed = [count]
        for k, kind in enumerate(sources):
            passed += [start(kind, builder.extract_value(inputs, k)), builder.extract_value(strides, k)]
        passed += [start(kind, builder.extract_value(outputs, k)) for k, kind in enumerate(targets)]
        passed += [start(bits, flags), start(room, workspace)]
        function = ir.FunctionType(ir.VoidType(), [x.type for x in passed])
        builder.call(builder.inttoptr(_load(builder, at, _WORD(0)), function.as_pointer()), passed)
        return context.get_dummy_value()

    return types.void(plan, types.intp, sources, steps, targets, bits, room), generate


_word: Any = intrinsic(_word_at)
_run: Any = intrinsic(_run_at)
_stack: Any = intrinsic(_stack_at)
_SCOPE: dict[str, Any] = {
    "aligned": _aligned, "apart": apart, "empty": np.empty, "last": _last, "run": _run, "stack": _stack, "step": _step,
    "tile": _tile, "uint16": np.uint16, "uint8": np.uint8, "word": _word,
}  # fmt: skip
