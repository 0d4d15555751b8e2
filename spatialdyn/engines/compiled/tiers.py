"""Functions that run in plain Python until compiling them pays, with results equal to the bit.

Numba takes a second or more to compile a function, and a new process with an empty cache calls dozens of functions. So
the source runs in plain Python first. It is compiled when that pays (``compile_clock``), or loaded at once if its
compiled code is on disk. LLVM must not fuse a product and a sum of such a function (``contract``). So compiled code
rounds as plain Python does, and earlier calls change only the time of a call.

Compiled code reads memory by address, plain Python by ``ctypes``: ``memory`` has functions for both.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property
from typing import Any

import numpy as np

from ...recursions.spec import Spec
from .. import locks
from ..compile_clock import CompileClock
from . import angles, memory, numba_kernels
from .numba_settings import PLAIN

COMPILE_SECONDS = 1.0  # expected time to compile a function
BRANCHING_SECONDS = 10.0  # the same for a function that branches on values, the square-root ABA


class Tier(CompileClock):
    """A function that is compiled when that pays. A subclass defines ``_compile`` and ``_is_stored``."""

    compile_seconds = COMPILE_SECONDS

    def __init__(self) -> None:
        super().__init__()
        self._code: Any = None
        self._looked = False
        self._lock = locks.new()  # plain Python lets other threads run, but the memory of a plan serves one thread

    def _compile(self) -> Any:
        raise NotImplementedError

    def _is_stored(self, *arguments: Any) -> bool:
        raise NotImplementedError

    def code(self, *arguments: Any) -> Any:
        """The compiled function if compiling pays, or if its code for such arguments is on disk; else None."""
        if self._code is None:
            with self._lock:
                first, self._looked = not self._looked, True
                if self._code is None and (self.pays or (first and self._is_stored(*arguments))):
                    self._code = self._compile()
        return self._code

    @property
    def is_made(self) -> bool:
        """Whether the compiled function is in memory."""
        return self._code is not None

    @property
    def called(self) -> bool:
        """Whether the function was called."""
        return self._looked

    def compile_now(self) -> None:
        """Compile the function now."""
        self._looked, self._spent = True, self.compile_seconds
        self.code()

    def in_plain_python(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        """A call in plain Python, whose time is counted; one thread calls at a time."""
        with self._lock, np.errstate(all="ignore"):
            return self.timed(function, *arguments)


class Tiered(Tier):
    """A function of arrays and numbers that is called directly."""

    def __init__(self, source: Callable[[], Any], compiled: Callable[[Any], Any]) -> None:
        """``source()`` makes the function, ``compiled`` compiles it."""
        super().__init__()
        self._source, self._compiled = source, compiled
        self._dispatcher: Any = None

    def __call__(self, *arguments: Any) -> Any:
        code = self._code
        if code is None and (code := self.code(*arguments)) is None:
            return self.in_plain_python(self.plain, arguments)
        return code(*arguments)

    @cached_property
    def plain(self) -> Callable[..., Any]:
        """The function in plain Python."""
        made: Callable[..., Any] = self._source()
        return made

    def _compile(self) -> Any:
        self._dispatcher = self._dispatcher or self._compiled(self.plain)
        return self._dispatcher

    def dispatcher(self) -> Any:
        """The compiled function, for code that calls it."""
        return self._compile()

    def _is_stored(self, *arguments: Any) -> bool:
        if PLAIN:
            return True
        from numba import typeof

        return is_stored(self._compile(), tuple(map(typeof, arguments)))


def is_stored(dispatcher: Any, signature: tuple[Any, ...]) -> bool:
    """Whether the code of a dispatcher of ``jit.numba_jit`` for a signature is on disk."""
    return bool(dispatcher._cache.is_stored(signature, dispatcher.targetctx))


SCRATCH = {"memory": memory.memory, "array_at": memory.array_at, "release": memory.release, "turned": angles.turned}


# --- table kernels -----------------------------------------------------------------------------------------


class TableKernel(Tiered):
    """``(address of the table, *inputs, output) -> status`` of a call, as ``numba_kernels.sample_kernel``."""

    def __init__(self, spec: Spec) -> None:
        """Of a call."""
        super().__init__(self._text, self._jitted)
        self._spec = spec
        self.compile_seconds = COMPILE_SECONDS if spec.traceable else BRANCHING_SECONDS

    def _text(self) -> Callable[..., Any]:
        spec = self._spec
        parameters = ["table", *(x.name for x in spec.present), spec.output.name]
        turns = {f"turn({x.name}, {x.name}_turned)": f"{x.name}_turned = turned({x.name}, {x.name}_turned)"
                 for x in spec.present if x.turned}  # fmt: skip
        body = numba_kernels.statements(spec, lambda status: f"return {status}")
        text = ["bodies = table_at(table)", *(turns.get(x, x) for x in body), f"return {numba_kernels.OK}"]
        scope = {**numba_kernels.scope(spec), **SCRATCH, "table_at": memory.table_at}
        return numba_kernels.kernel_from_text(f"{numba_kernels.label(spec)}_unfused", parameters, text, scope)

    @cached_property
    def batches(self) -> Callable[..., int]:
        """Compile a ``numba_kernels.batch_kernel`` with the same bits."""
        self.compile_now()
        return numba_kernels.batches_of(self._spec, self.code(), "unfused_batch")

    def _jitted(self, source: Any) -> Any:
        from . import jit

        return jit.compile_signature(source, numba_kernels.signature(self._spec), contract=False)

    def _is_stored(self, *arguments: Any) -> bool:
        from . import jit

        return is_stored(jit.numba_jit(self.plain, contract=False), numba_kernels.signature(self._spec))


@cache
def table_kernel(spec: Spec) -> Any:
    """The TableKernel of a call; where nothing is compiled, its ``sample_kernel``, which takes the table itself."""
    return numba_kernels.sample_kernel(spec) if PLAIN else TableKernel(spec)
