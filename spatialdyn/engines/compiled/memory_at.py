"""Memory at an address, and arguments of entries, in compiled code; ``memory`` has the same in plain Python."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import carray, typeof, types  # type: ignore[attr-defined]
from numba.extending import intrinsic, typeof_impl

from ...algebra.scalars import inlined_as
from ...recursions.spec import Spec
from . import jit, memory, numba_kernels
from .memory import Argument, Place
from .tiers import TableKernel

_WORD = ir.IntType(64)
_pointer = jit.pointer


def _word_at(typing_context: Any, base: Any, k: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _word(builder, *arguments)

    return types.int64(types.intp, types.intp), generate


def _word(builder: Any, base: Any, k: Any) -> Any:
    return builder.load(builder.gep(builder.inttoptr(base, _WORD.as_pointer()), [k]))


def _real_function(typing_context: Any, address: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        function = ir.FunctionType(ir.DoubleType(), [_WORD]).as_pointer()
        return builder.call(builder.inttoptr(values[0], function), [values[1]])

    return types.float64(types.intp, types.intp), generate


jit.intrinsic_as(memory.word, _word_at)
jit.intrinsic_as(memory.real_of, _real_function)


@inlined_as(memory.at)
def _at(address: int, shape: tuple[int, ...]) -> Any:
    return carray(_pointer(address), shape, np.float64)


@inlined_as(memory.places)
def _places(address: int, shape: tuple[int, ...]) -> Any:
    return carray(_pointer(address), shape, np.intp)


@inlined_as(memory.records)
def _records(address: int, shape: tuple[int, ...], dtype: Any) -> Any:
    return carray(_pointer(address), shape, dtype)


@typeof_impl.register(TableKernel)
def _type_of_kernel(kernel: TableKernel, found: Any) -> Any:
    kind: Any = typeof
    return kind(kernel.dispatcher())


class SampleKernel(NamedTuple):
    """A ``numba_kernels.sample_kernel`` in the text of a function, compiled only with that function."""

    spec: Spec


@typeof_impl.register(SampleKernel)
def _type_of_sample_kernel(kernel: SampleKernel, found: Any) -> Any:
    kind: Any = typeof
    return kind(numba_kernels.sample_kernel(kernel.spec))


def _leave(typing_context: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.get_python_api(builder).save_thread()

    return types.voidptr(), generate


def _enter(typing_context: Any, held: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        context.get_python_api(builder).restore_thread(arguments[0])
        return context.get_dummy_value()

    return types.none(types.voidptr), generate


leave_python: Any = intrinsic(_leave)  # other threads run Python until ``enter_python`` of its result
enter_python: Any = intrinsic(_enter)


def reader(arguments: Sequence[Argument]) -> Callable[..., Any]:
    """``(context, inputs, outputs)`` -> the tuple of an entry's arguments, as ``memory.read`` in plain Python."""

    def typed(typing_context: Any, context: Any, inputs: Any, outputs: Any) -> Any:
        kinds = [_kind(x) for x in arguments]

        def generate(target: Any, builder: Any, signature: Any, given: Any) -> Any:
            def at(k: int, base: Any) -> Any:
                return _word(builder, base, _WORD(k))

            def value(x: Argument, kind: Any) -> Any:
                if x.place is Place.WORDS:
                    words = [at(k, given[0]) for k in x.at]
                    return words[0] if x.record is None else target.make_tuple(builder, kind, words)
                address = at(x.at[0], given[2 if x.place is Place.OUTPUT else 1])
                if x.shape is None:
                    return at(0, address)
                if not x.shape and x.place is Place.INPUT:
                    return builder.load(builder.inttoptr(address, ir.DoubleType().as_pointer()))
                sizes = [_WORD(n) if n >= 0 else at(~n, given[0]) for n in x.shape or (1,)]
                return jit.array_of(target, builder, kind, address, sizes)

            return target.make_tuple(builder, signature.return_type, [*map(value, arguments, kinds)])

        made: Any = types.Tuple
        return made(kinds)(types.intp, types.intp, types.intp), generate

    made: Callable[..., Any] = intrinsic(typed)
    return made


def _kind(x: Argument) -> Any:
    if x.place is Place.WORDS:
        made: Any = types.NamedUniTuple
        return types.int64 if x.record is None else made(types.int64, len(x.at), x.record)
    if x.shape is None:
        return types.int64
    array: Any = types.Array
    return array(types.float64, max(len(x.shape), 1), "C") if x.shape or x.place is Place.OUTPUT else types.float64
