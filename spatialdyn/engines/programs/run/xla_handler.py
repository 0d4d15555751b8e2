"""Compiled programs as handlers of XLA's foreign function interface: a name, an address, and the objects in use.

XLA keeps a handler for as long as the process runs, and executables refer to it by name, so objects that a handler uses
are never freed. The name determines what the handler computes: an executable that is loaded in another process finds
the same program or none.
"""

from __future__ import annotations

import ctypes
import hashlib
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import locks, object_layout
from ...threads import thread_pool
from ..llvm.host_cpu import LoadedCode, object_code
from ..llvm.llvm_entry import buffer_size
from ..llvm.xla_text import WORDS, Handler, handler
from .batch_kernels import Kernel
from .batches import rejected

Recompute = Callable[[Sequence[NDArray[Any]], Sequence[NDArray[Any]], tuple[int, ...], NDArray[np.intp]], None]
_lock = locks.new()


class Registered(NamedTuple):
    """A handler: its name, its address, and the objects that it uses."""

    name: str
    address: int
    alive: tuple[Any, ...]


def registered(
    key: str,
    kernel: Kernel,
    inputs: Sequence[tuple[int, ...]],
    outputs: Sequence[tuple[int, ...]],
    buffers: Any,
    recompute: Recompute,
) -> Registered:
    """The handler of a kernel, made once for all kernels with the same key and dtype of buffers.

    key        names what the kernel computes
    inputs     shape of one sample of each input; ``outputs`` likewise
    buffers    dtype of XLA's buffers; numbers are converted if it is not the kernel's dtype
    recompute  function of inputs (n or 1, columns), outputs (n, columns), the batch's shape and the indices of the
               samples that the kernel rejects; it writes their results in the kernel's dtype. An exception that it
               raises becomes the error of the call, whose last line has the exception's class and message
    """
    dtype = np.dtype(buffers)
    name = f"spatialdyn_{hashlib.sha256(key.encode()).hexdigest()[:24]}_{dtype.name}"
    with _lock:
        known = _handlers()
        if name not in known:
            known[name] = _made(name, kernel, inputs, outputs, dtype, recompute)
        return known[name]


@cache
def _handlers() -> dict[str, Registered]:
    """The handlers made so far, by name."""
    return {}


@cache
def recomputing() -> NDArray[np.int64]:
    """(2,) whether the process ends, and the number of calls that recompute samples; handlers read and write it."""
    return np.zeros(2, np.int64)


def _made(
    name: str,
    kernel: Kernel,
    inputs: Sequence[tuple[int, ...]],
    outputs: Sequence[tuple[int, ...]],
    dtype: np.dtype[Any],
    recompute: Recompute,
) -> Registered:
    code = kernel.code
    called = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)(_callback(kernel, recompute))
    give_way, owner = _give_way()
    text = handler(
        Handler(
            inputs=tuple(zip(kernel.inputs, map(len, inputs), strict=True)),
            outputs=tuple(zip(kernel.outputs, map(len, outputs), strict=True)),
            size=kernel.dtype.itemsize,
            buffers=dtype.itemsize,
            lanes=kernel.lanes,
            share=kernel.share,
            buffer=buffer_size(kernel.inputs, kernel.outputs, code.workspace, kernel.lanes, kernel.dtype.itemsize),
            run=code.batch,
            numbers=id(kernel.numbers),
            callback=ctypes.cast(called, ctypes.c_void_p).value or 0,
            allocate=object_layout.api("PyMem_RawMalloc"),
            free=object_layout.api("PyMem_RawFree"),
            give_way=give_way,
            threads=thread_pool.most.ctypes.data,
            recomputing=recomputing().ctypes.data,
        )
    )
    loaded = LoadedCode(object_code(text))
    return Registered(name, loaded.address("handler"), (kernel, called, owner, loaded, thread_pool.most))


def end() -> None:
    """Let handlers recompute no more samples: such a call is an error. Waits for those that do so now."""
    state = recomputing()
    state[0] = 1
    while state[1]:
        time.sleep(1e-3)


@cache
def _give_way() -> tuple[int, Any]:
    """The address of a function without arguments that lets another thread run, and the library that holds it."""
    library: Any = ctypes.CDLL("kernel32" if sys.platform == "win32" else None)
    function = library.SwitchToThread if sys.platform == "win32" else library.sched_yield
    return ctypes.cast(function, ctypes.c_void_p).value or 0, library


def _callback(kernel: Kernel, recompute: Recompute) -> Callable[[int], int]:
    """The function that a handler calls for a batch with rejected samples; see ``WORDS``."""
    several, results = len(kernel.inputs), len(kernel.outputs)
    message = threading.local()  # text of the last error, until XLA has copied it

    def array(address: int, rows: int, columns: int) -> NDArray[Any]:
        held: Any = (ctypes.c_byte * (rows * columns * kernel.dtype.itemsize)).from_address(address)
        return np.asarray(np.frombuffer(held, kernel.dtype)).reshape(rows, columns)

    def call(address: int) -> int:
        try:
            words = object_layout.words_at(address, len(WORDS) + 2 * several + results)
            n, bits, rank, dims = words[: len(WORDS)]
            at, rows = words[len(WORDS) :], words[len(WORDS) + several :]
            tiles = -(-n // kernel.lanes)
            held: Any = (ctypes.c_uint16 * tiles).from_address(bits)
            samples = rejected(np.frombuffer(held, np.uint16), kernel.lanes, n)
            given = [array(*x) for x in zip(at, rows, kernel.inputs, strict=False)]
            found = [array(x, n, columns) for x, columns in zip(rows[several:], kernel.outputs, strict=True)]
            recompute(given, found, tuple(object_layout.words_at(dims, rank)), samples)
        except BaseException as error:  # XLA passes the error on as text
            message.text = f"a program refuses its inputs\n{type(error).__name__}: {error}".encode() + b"\0"
            return ctypes.cast(ctypes.c_char_p(message.text), ctypes.c_void_p).value or 0
        return 0

    return call
