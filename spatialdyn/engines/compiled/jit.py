"""Numba's part of the compiled kernels: the only module that makes Numba functions.

Importing this module imports Numba, which takes time, so other modules import it in the function that compiles.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, cast

import numpy as np
from numba import carray, njit, types  # type: ignore[attr-defined]
from numba.core import cgutils
from numba.core.compiler_lock import global_compiler_lock
from numba.core.typing.templates import infer_global, make_intrinsic_template
from numba.extending import intrinsic
from numba.np import arrayobj

from ...algebra.scalars import compiled_as, inline, inlined_as, register
from ...bodies.table import BODIES
from ...waiting import watch
from ..interrupt import interruptible
from . import angles, disk_cache
from . import memory as plain_memory
from .numba_cache import NumbaCache
from .numba_settings import PLAIN
from .sines import turn as turn

try:
    from .inlining import PIPELINES, Plain
except ImportError:  # in this version of Numba these parts are elsewhere: compiling takes several times as long
    from .lane_typing import WITHOUT_PASSES as PIPELINES
    from .lane_typing import TypedAsNumba as Plain  # type: ignore[assignment]
OWN: dict[str, Any] = {"pipeline_class": Plain}

ON_STACK = 1 << 13  # most bytes of a kernel's scratch array on the stack; larger arrays are allocated
FLAGS: dict[str, Any] = {
    "nogil": True, "error_model": "numpy", "fastmath": {"contract"}, "no_cfunc_wrapper": True
}  # fmt: skip


# --- functions of compiled code -----------------------------------------------------------------------------


def _pointer_at(typing_context: Any, address: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(address), generate


def _memory(typing_context: Any, size: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        (size,) = arguments
        large = builder.icmp_signed(">", size, size.type(ON_STACK))
        small = builder.alloca(cgutils.int8_t, builder.select(large, size.type(0), size))
        small.align = 64
        ways = {builder.block: small}
        with builder.if_then(large, likely=False):
            allocated = context.nrt.allocate(builder, size)
            ways[builder.block] = allocated
        found = builder.phi(small.type)
        for block, way in ways.items():
            found.add_incoming(way, block)
        return found

    return types.voidptr(types.intp), generate


def _release(typing_context: Any, address: Any, size: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address, size = arguments
        with builder.if_then(builder.icmp_signed(">", size, size.type(ON_STACK)), likely=False):
            context.nrt.free(builder, address)
        return context.get_dummy_value()

    return types.none(types.voidptr, types.intp), generate


def _array_at(typing_context: Any, memory: Any, shape: Any, dtype: Any) -> Any:
    array: Any = types.Array
    kind = array(dtype.dtype, len(shape), "C")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        extents = [builder.extract_value(arguments[1], axis) for axis in range(kind.ndim)]
        return array_of(context, builder, kind, arguments[0], extents)

    return kind(memory, shape, dtype), generate


def array_of(context: Any, builder: Any, kind: Any, place: Any, extents: list[Any]) -> Any:
    """The array of a type and shape, in C order, at an address or a pointer."""
    made, put = context.make_array(kind)(context, builder), cast(Any, arrayobj.populate_array)
    size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    strides = [context.get_constant(types.intp, size)]
    for extent in reversed(extents[1:]):
        strides.insert(0, builder.mul(strides[0], extent))
    cast_to = builder.inttoptr if place.type == extents[0].type else builder.bitcast
    put(made, cast_to(place, made.data.type), extents, strides, strides[-1], meminfo=None)
    return made._getvalue()


def intrinsic_as(function: Callable[..., Any], define: Callable[..., Any]) -> Any:
    """The intrinsic of a definition, which compiled code runs in place of ``function``."""
    made: Any = intrinsic(define)
    template: Any = make_intrinsic_template
    of_global: Any = infer_global
    of_global(function, types.Function(template(made, define, function.__name__)))
    return made


pointer: Any = intrinsic(_pointer_at)
# (bytes) -> memory for the calling function, on the stack if small
memory = intrinsic_as(plain_memory.memory, _memory)
release = intrinsic_as(plain_memory.release, _release)  # (memory, bytes): free the memory if it is not on the stack
# (memory, shape, dtype) -> the array there: as carray, but compiles faster
array_at = intrinsic_as(plain_memory.array_at, _array_at)


@inline
@inlined_as(plain_memory.table_at)
def table_at(address: int) -> Any:
    """The table of bodies at an address; ``last_row`` of row 0 is the number of rows that follow it."""
    world = carray(pointer(address), (1,), BODIES)
    return carray(pointer(address), (world[0].last_row + 1,), BODIES)


@inline
def rows_at(address: int, dtype: Any) -> Any:
    """The static table of that dtype at an address; ``last_row`` of row 0 is the number of rows that follow it."""
    header = carray(pointer(address), (1,), dtype)
    return carray(pointer(address), (header[0].last_row + 1,), dtype)


@inline
@inlined_as(angles.turned)
def turned(q: Any, memory: Any) -> Any:
    """q, cos q and sin q as an array (3, nq) in ``memory``, the form in which a recursion takes ``TURNED_Q``."""
    turn(q, memory)
    return memory


def number(x: Any) -> Any:
    """The value of a float, or of an array without axes."""
    return x


@compiled_as(number)
def _number_of(x):  # type: ignore[no-untyped-def]
    return (lambda x: x[()]) if isinstance(x, types.Array) else (lambda x: x)


# --- functions and signatures --------------------------------------------------------------------------------


def hand_over() -> None:
    """Register with Numba all functions that compiled code may call."""
    register(PIPELINES)


def numba_jit(
    function: Callable[..., Any], nogil: bool = True, keep: bool = True, from_c: bool = False, contract: bool = True,
    key: str = "",
) -> Callable[..., Any]:  # fmt: skip
    """A function of compiled code, compiled at its first call of each type, and cached on disk if ``keep``.

    from_c    whether the function has an entry that C can call
    contract  whether LLVM may fuse multiplications and additions
    key       text that says what the code is; a function of ``kernel_from_text``, which captures text only, needs none
    """
    hand_over()
    flags = {name: x for name, x in FLAGS.items() if contract or name != "fastmath"}
    dispatcher: Any = njit(**{**flags, "nogil": nogil, "no_cfunc_wrapper": not from_c, **OWN})(function)
    if keep and not PLAIN:
        dispatcher._cache = NumbaCache(function, key)
    return compile_aside(dispatcher)


def compile_aside(dispatcher: Any) -> Callable[..., Any]:
    """A dispatcher that compiles on another thread, so that the main thread can handle Ctrl-C."""
    if not PLAIN:
        dispatcher._compile_for_args = partial(_aside, dispatcher._compile_for_args)
    made: Callable[..., Any] = dispatcher
    return made


def _aside(compiled: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    """As ``interruptible``, but on this thread if it is compiling: another thread would wait for its compiler lock."""
    lock: Any = global_compiler_lock
    if lock.is_locked():
        return compiled(*arguments, **named)
    dispatcher: Any = compiled.__self__  # type: ignore[attr-defined]
    with watch.work(f"compiling {dispatcher.py_func.__name__}", disk_cache.kept):
        return interruptible(partial(compiled, *arguments, **named))


def compile_signature(
    function: Callable[..., Any],
    signature: tuple[Any, ...],
    nogil: bool = True,
    keep: bool = True,
    contract: bool = True,
) -> Callable[..., Any]:
    """A function compiled for one signature only: arguments that do not match raise TypeError at once."""
    if PLAIN:
        return _plain(function, signature)
    dispatcher: Any = numba_jit(function, nogil, keep, contract=contract)
    _aside(dispatcher.compile, signature)
    dispatcher.disable_compile()
    for strided in (False, True):
        for writable in (False, True):
            dispatcher._search_new_conversions(*(_sample(t, strided, writable) for t in signature))
    # By default Numba would search for a conversion of other arguments before it raises.
    dispatcher._search_new_conversions = _no_conversion
    dispatcher._explain_matching_error = _no_match
    made: Callable[..., Any] = dispatcher
    return made


def accept(function: Callable[..., Any], *samples: Any) -> None:
    """Make a function of ``compile_signature`` also convert arguments of the types of these samples."""
    if not PLAIN:
        type(function)._search_new_conversions(function, *samples)  # type: ignore[attr-defined]


def _plain(function: Callable[..., Any], signature: tuple[Any, ...]) -> Callable[..., Any]:
    """The function in plain Python; it raises TypeError where its compiled form would."""

    @np.errstate(all="ignore")
    def checked(table: Any, *arguments: Any) -> Any:
        for x, kind in zip(arguments, signature[1:], strict=True):
            if isinstance(kind, types.Array) and (
                type(x) is not np.ndarray
                or x.ndim != kind.ndim
                or x.dtype != (np.int8 if kind.dtype == types.int8 else np.float64)
                or (kind.mutable and not (x.flags.writeable and x.flags.c_contiguous))
            ):
                raise TypeError("no such signature")
            if kind == types.float64 and isinstance(x, np.ndarray):
                raise TypeError("no such signature")
        return function(table, *arguments)

    return checked


def _sample(kind: Any, strided: bool, writable: bool) -> Any:
    """A sample value of a type, from which Numba finds the conversion."""
    if not isinstance(kind, types.Array):
        return 0.0 if kind == types.float64 else 0
    x = np.zeros((4,) * kind.ndim, str(kind.dtype))
    if strided and kind.layout == "A":
        x = x[(slice(None, None, 2),) * kind.ndim]
    x.flags.writeable = writable or kind.mutable
    return x


def _no_conversion(*arguments: Any, **named: Any) -> bool:
    return False


def _no_match(*arguments: Any, **named: Any) -> None:
    raise TypeError("no such signature")
