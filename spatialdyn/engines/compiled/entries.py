"""Entries ``entry(context, inputs, outputs) -> 1``, or 0 where not applicable: what a builtin of ``single_call`` runs.

Arguments are addresses: of the context, and of the arrays of addresses of inputs and outputs. A program has such an
entry by itself; here are those of calls on any table of bodies, and of other functions. Plain Python runs them until
compiling pays (see ``tiers``), with the same bits.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from ...recursions.spec import Spec
from . import numba_kernels, tiers
from .tiers import NATIVE, Tier, Twin, scope_in

NO_LIMIT = np.array([1 << 62])  # a counter of calls
F8, INDICES, BODIES = np.float64, np.intp, "bodies"
Shape = tuple[int | str, ...]


def of_memory(name: str) -> Callable[[], Any]:
    """A function that gives a function of ``memory_at``, as a Twin needs it."""

    def compiled() -> Any:
        from . import memory_at

        return getattr(memory_at, name)

    return compiled


MEMORY: dict[str, Any] = {  # how a source reads memory: a word, an array of numbers, an array of indices
    "word": Twin(tiers.word, of_memory("word")),
    "at": Twin(lambda address, shape: tiers.array_of(address, shape, F8), of_memory("at")),
    "places": Twin(lambda address, shape: tiers.array_of(address, shape, INDICES), of_memory("places")),
    **NATIVE,
}


class Entry(Tier):
    """An entry generated as text: its address, which calls plain Python until compiling pays."""

    def __init__(self, name: str, text: Sequence[str], scope: Mapping[str, Any]) -> None:
        """Of statements that read ``context``, ``inputs`` and ``outputs``."""
        super().__init__()
        self._made_of = f"entry_{name}", ["context", "inputs", "outputs"], ["stamp", *text]
        self._scope = {**MEMORY, **scope}
        self._dispatcher: Any = None
        plain = self._function(plain=True)

        def call(context: int, inputs: int, outputs: int) -> int:
            if self._spent >= self.compile_seconds:
                return 0
            try:
                return int(self.in_plain_python(plain, (context, inputs, outputs)))
            except ArithmeticError:
                return 0

        self._callback = ctypes.PYFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 3)(call)
        self.address = ctypes.cast(self._callback, ctypes.c_void_p).value or 0
        self.code()

    def _function(self, plain: bool) -> Callable[..., Any]:
        return numba_kernels.kernel_from_text(*self._made_of, scope_in(plain, self._scope))

    def _jitted(self, plain: bool) -> Any:
        from . import jit

        return jit.numba_jit(self._function(plain), nogil=False, from_c=True, contract=False)

    def _is_stored(self, *arguments: Any) -> bool:
        return tiers.is_stored(self._jitted(plain=True), _signature())

    def _compile(self) -> Any:
        self._dispatcher = self._jitted(plain=False)
        self._dispatcher.compile(_signature())
        made = self._dispatcher.overloads[_signature()]
        self.address = made.library.get_pointer_to_function(made.fndesc.llvm_cfunc_wrapper_name)
        return self

    def words(self, context: int) -> tuple[int, int, int]:
        """The three words of a plan for a context, compiled if that pays."""
        self.code()
        return self.address, context, NO_LIMIT.ctypes.data


@cache
def _signature() -> tuple[Any, ...]:
    from numba import types

    return (types.intp,) * 3


@cache
def table_entry(spec: Spec) -> Entry:
    """The Entry of a call on any table, whose address is the context."""
    kernel, arrays = tiers.table_kernel(spec), [*spec.present, spec.output]
    text = ["bodies = table_at(context)"]
    for k, x in enumerate(arrays):
        shape = ", ".join(numba_kernels.extent(spec, size) for size in numba_kernels.kernel_shape(x))
        place = "word(outputs, 0)" if x is spec.output else f"word(inputs, {k})"
        one = "" if x.shape or x is spec.output else "[0]"
        text.append(f"x{k} = at({place}, ({shape},)){one}")
    passed = ", ".join(f"x{k}" for k in range(len(arrays)))
    text.append(f"return 1 if kernel(context, {passed}) == {numba_kernels.OK} else 0")
    return Entry(numba_kernels.label(spec), text, {"kernel": kernel.twin})
