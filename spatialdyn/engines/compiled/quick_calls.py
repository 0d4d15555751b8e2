"""Single samples through a program on one lane, by the shortest way from Python: a Numba function that takes arrays.

Numba reads the arrays (0.1 µs each), checks sizes, layout and overlap, and calls the program by its address. One such
function serves all programs with as many inputs and outputs of the same ranks; what differs between them is in
``plan``, an array that it gets the address of.
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

from . import numba_kernels
from .checks import apart

_LOCK = threading.RLock()
_WORD = ir.IntType(64)


def plan(address: int, workspace: int, shapes: Sequence[tuple[int, ...]]) -> NDArray[np.int64]:
    """What ``caller`` has to know of a program: its address, words of workspace, the axes of inputs and outputs."""
    return np.array([address, workspace // 8 + 1, *(n for shape in shapes for n in shape)], np.int64)


@cache
def caller(inputs: tuple[int, ...], outputs: tuple[int, ...]) -> Callable[..., int]:
    """``(address of plan, *inputs, *outputs) -> status`` of one sample, for arrays of these ranks; rank 0 is a float.

    0 says that the results are there; anything else that they are not, and that another way has to say why.
    """
    with _LOCK:
        ins, outs = [f"x{k}" for k in range(len(inputs))], [f"y{k}" for k in range(len(outputs))]
        at, wrong, body = 2, [], []
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
        body.append(f"return run(plan, {sources}, {_tuple(outs)})")
        scope = {"word": _word, "run": _run, "apart": apart, "empty": np.empty}
        label = "_".join(["one", *map(str, inputs), "to", *map(str, outputs)])
        function = numba_kernels.define(label, ["plan", *ins, *outs], body, scope)
        array: Any = types.Array
        given = [array(types.float64, rank, "A", readonly=True) if rank else types.float64 for rank in inputs]
        made = [array(types.float64, rank, "C") for rank in outputs]
        return numba_kernels.compiled(
            function, (types.intp, *given, *made), nogil=False
        )  # giving it up takes 0.03 µs of 0.4


def _tuple(names: Sequence[str]) -> str:
    return f"({''.join(f'{name}, ' for name in names)})" if names else "()"


def _word_at(typing_context: Any, plan: Any, k: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _load(builder, *arguments)

    return types.int64(types.intp, types.intp), generate


def _load(builder: Any, plan: Any, k: Any) -> Any:
    return builder.load(builder.gep(builder.inttoptr(plan, _WORD.as_pointer()), [k]))


def _run_at(typing_context: Any, plan: Any, inputs: Any, outputs: Any) -> Any:
    """Call the program of a plan for one tile, on arrays, which so live until it is done; 0 if its lane is in order."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        at, sources, targets = arguments
        address, words = (_load(builder, at, _WORD(k)) for k in range(2))
        bits = builder.alloca(ir.IntType(16))
        room = builder.alloca(_WORD, size=words)
        room.align = 64

        def start(kind: Any, value: Any) -> Any:
            return builder.bitcast(context.make_array(kind)(context, builder, value).data, cgutils.voidptr_t)

        passed = [_WORD(1)]
        for k, kind in enumerate(inputs):
            passed += [start(kind, builder.extract_value(sources, k)), _WORD(0)]
        passed += [start(kind, builder.extract_value(targets, k)) for k, kind in enumerate(outputs)]
        passed += [builder.bitcast(x, cgutils.voidptr_t) for x in (bits, room)]
        kind = ir.FunctionType(ir.VoidType(), [x.type for x in passed])
        builder.call(builder.inttoptr(address, kind.as_pointer()), passed)
        fine = builder.icmp_unsigned("==", builder.load(bits), ir.IntType(16)(1))
        return builder.select(fine, _WORD(0), _WORD(1))

    return types.int64(types.intp, inputs, outputs), generate


_word: Any = intrinsic(_word_at)
_run: Any = intrinsic(_run_at)
