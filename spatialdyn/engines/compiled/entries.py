"""Entries ``entry(context, inputs, outputs) -> 1``, or 0 where not applicable: what a builtin of ``single_call`` runs.

An entry in plain Python returns RAISED where KeyboardInterrupt, say, stops it: the builtin then raises that.

Arguments are addresses: of the context, and of the arrays of addresses of inputs and outputs. A program has such an
entry by itself; here are those of calls on any table of bodies, and of other functions. Plain Python runs them until
compiling pays (see ``tiers``), with the same bits.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from functools import cache
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ...bodies.static_table import StaticTable
from ...recursions.spec import Spec
from . import memory, numba_kernels, tiers
from .memory import Argument, at, read, word
from .stamp import STAMP, covers, names
from .tiers import Tier

NO_LIMIT = np.array([1 << 62])  # a counter of calls
_NO_CALL = np.zeros(1, np.int64)
NO_CODE = 0, 0, _NO_CALL.ctypes.data  # the three words of a plan without code, of which all calls are Python's
RAISED = -1  # what an entry returns that an interrupt stopped
_interrupt: ContextVar[BaseException] = ContextVar("interrupt")  # of the entry that returned RAISED in this thread


def raise_interrupt() -> NoReturn:
    """Raise what stopped an entry: ctypes would write it to stderr and go on."""
    raise _interrupt.get()


class CompiledEntry(Tier):
    """An entry that is compiled, or loaded from disk, when that pays."""

    compile_seconds = 0.6  # the function it calls is compiled already

    def __init__(self, compiled: Callable[[], Callable[..., Any]], key: str = "") -> None:
        """``compiled()`` makes the function to compile.

        key  what the code is, in text, if it is to be kept on disk
        """
        super().__init__()
        self._made_by, self._key = compiled, key
        self._dispatcher: Any = None
        self.address = 0

    def _jitted(self) -> Any:
        from . import jit
        from . import memory_at as memory_at  # it registers what compiled code runs

        if self._dispatcher is None:
            self._dispatcher = jit.numba_jit(
                self._made_by(), nogil=False, keep=bool(self._key), from_c=True, contract=False, key=self._key
            )
        return self._dispatcher

    def _is_stored(self, *arguments: Any) -> bool:
        return bool(self._key) and tiers.is_stored(self._jitted(), _signature())

    def _compile(self) -> Any:
        dispatcher = self._jitted()
        dispatcher.compile(_signature())
        made = dispatcher.overloads[_signature()]
        self.address = made.library.get_pointer_to_function(made.fndesc.llvm_cfunc_wrapper_name)
        return self

    def words(self, context: int) -> tuple[int, int, int]:
        """The three words of a plan for a context, compiled if that pays."""
        self.code()
        return self.address, context, NO_LIMIT.ctypes.data


class Entry(CompiledEntry):
    """An entry that calls plain Python until compiling pays."""

    compile_seconds = Tier.compile_seconds

    def __init__(self, plain: Callable[..., Any], compiled: Callable[[], Callable[..., Any]], key: str = "") -> None:
        """``plain`` is the entry in plain Python; ``compiled`` and ``key`` as of ``CompiledEntry``."""
        super().__init__(compiled, key)

        def call(context: int, inputs: int, outputs: int) -> int:
            try:
                if self._spent >= self.compile_seconds:
                    return 0
                return int(self.in_plain_python(plain, (context, inputs, outputs)))
            except Exception:  # an overflow, say: ctypes would return any number, as if valid
                return 0
            except BaseException as error:
                _interrupt.set(error)
                return RAISED

        self._callback = ctypes.PYFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 3)(call)
        self.address = ctypes.cast(self._callback, ctypes.c_void_p).value or 0
        self.code()


@cache
def _signature() -> tuple[Any, ...]:
    from numba import types

    return (types.intp,) * 3


def entry_of(function: Callable[..., Any], arguments: Sequence[Argument], name: str) -> Entry:
    """The Entry of a function of such arguments that returns whether it applies.

    name  says which function it is, with all that it captures
    """
    key = repr((STAMP, name, function.__module__, function.__qualname__, *arguments)) if covers(function) else ""

    def plain(context: int, inputs: int, outputs: int) -> bool:
        return bool(function(*read(arguments, context, inputs, outputs)))

    def compiled() -> Callable[..., Any]:
        from . import memory_at

        given = memory_at.reader(arguments)

        def entry(context: int, inputs: int, outputs: int) -> int:
            return 1 if function(*given(context, inputs, outputs)) else 0

        entry.__qualname__ = f"entry_{name}"
        return entry

    return Entry(plain, compiled, key)


def context_of(table: Any, static: Sequence[Any] = ()) -> NDArray[np.int64]:
    """The words at the context of an entry of a call: the table's address, and values or addresses of static inputs."""
    words = [table.address]
    for x in static:
        words.append(x.address if isinstance(x, StaticTable) else x.ctypes.data if isinstance(x, np.ndarray) else x)
    return np.array(words, np.int64)


def _text(spec: Spec) -> tuple[list[str], str]:
    """Statements that read the arguments of a call, and these arguments."""
    text, names, given, known = ["stamp", "table = word(context, 0)", "bodies = table_at(table)"], ["table"], 0, 0
    for x in (*spec.present, spec.output):
        names.append(x.name)
        if x.static:
            known += 1
            place = f"word(context, {known})"
        elif x is spec.output:
            place = "word(outputs, 0)"
        else:
            place, given = f"word(inputs, {given})", given + 1
        if x.table or (x.static and not x.shape):
            text.append(f"{x.name} = {place}")
            continue
        shape = ", ".join(numba_kernels.extent(spec, size) for size in numba_kernels.kernel_shape(x))
        one = "" if x.shape or x is spec.output else "[0]"
        text.append(f"{x.name} = at({place}, ({shape},)){one}")
    return text, ", ".join(names)


@cache
def table_entry(spec: Spec) -> Entry:
    """The Entry of a call on any table, whose ``context_of`` is the context, by its ``tiers.table_kernel``."""
    text, passed = _text(spec)
    text.append(f"return 1 if kernel({passed}) == {numba_kernels.OK} else 0")
    scope = {"kernel": tiers.table_kernel(spec), "word": word, "at": at, "table_at": memory.table_at}
    name = f"entry_{numba_kernels.label(spec)}"
    made = numba_kernels.kernel_from_text(name, ["context", "inputs", "outputs"], text, scope)
    return Entry(made, lambda: made, repr((STAMP, name, text)) if names(spec) else "")


@cache
def sample_entry(spec: Spec) -> CompiledEntry:
    """As ``table_entry``, by its ``numba_kernels.sample_kernel``, which gives the bits of batches.

    Other threads run Python meanwhile.
    """
    text, passed = _text(spec)
    text += ["held = leave_python()", f"status = kernel({passed})", "enter_python(held)"]
    text.append(f"return 1 if status == {numba_kernels.OK} else 0")
    name = f"sample_entry_{numba_kernels.label(spec)}"

    def compiled() -> Callable[..., Any]:
        from .memory_at import SampleKernel, enter_python, leave_python

        scope = {"kernel": SampleKernel(spec), "word": word, "at": at, "table_at": memory.table_at}
        scope |= {"leave_python": leave_python, "enter_python": enter_python}
        return numba_kernels.kernel_from_text(name, ["context", "inputs", "outputs"], text, scope)

    return CompiledEntry(compiled, repr((STAMP, name, text)) if names(spec) else "")
