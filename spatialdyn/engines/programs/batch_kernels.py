"""Programs compiled, cached by a digest of all they depend on, and run over the samples of a batch.

``kernel`` returns the program of some calls for one table of bodies: from memory, from the disk cache, or compiled.
Calling it computes the valid samples and returns the indices of the others, to be recomputed by the table kernel,
which handles sines of large angles, NaN and errors.
"""

from __future__ import annotations

import ctypes
import hashlib
import struct
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...recursions.spec import Spec
from ..compiled import disk_cache
from ..compiled.numba_kernels import STAMP
from ..threads import PIECES, thread_pool
from . import host_cpu, simd
from .batches import Batches, rejected
from .kernel_layout import KernelLayout
from .llvm_entry import DATA_OFFSET, buffer_size
from .recording import ALL, ProgramOptions, Recording
from .recording import record as record

CACHE_SIZE = 128  # programs in memory
THREAD_BYTES = 16 << 20  # least bytes of machine code that a thread runs: some 100 µs
SLICE_BYTES = 1 << 30  # bytes of machine code that a thread runs until Ctrl-C is handled: some 50 ms
RESULT_COST = 64  # bytes of machine code for each byte of results: 0.3 ns of fresh memory, 10 in a machine without any
STREAM_BYTES = 16 << 20  # least bytes of an output that bypasses the CPU caches: half the time of crba of talos

_lock = threading.RLock()
_programs: OrderedDict[str, Kernel | None] = OrderedDict()


class Kernel(Batches):
    """A compiled program over batches."""

    def __init__(self, code: bytes, workspace: int, layout: KernelLayout, dtype: Any, one: bool = False) -> None:
        """Load object code made by ``simd.compile_program`` from a program of that layout."""
        self._loaded = host_cpu.LoadedCode(code)
        self.dtype, self.lanes = np.dtype(dtype), 1 if one else host_cpu.lanes_of(dtype)
        self.address, self.workspace = self._loaded.address("kernel"), workspace
        self.entry = self._loaded.address("one_entry") if one else 0  # as ``single_call`` calls it
        self.inputs, self.outputs = layout.inputs, tuple(map(len, layout.outputs))
        self._buffer_size = buffer_size(self.inputs, self.outputs, workspace, self.lanes, self.dtype.itemsize)
        self.share, self._length = max(1, THREAD_BYTES // len(code)), len(code)
        self._results: int = self.lanes * self.dtype.itemsize * sum(self.outputs)
        kinds: list[Any] = [ctypes.py_object, ctypes.c_int64] * len(self.inputs)
        kinds += [ctypes.py_object] * (len(self.outputs) + 2)
        kind = ctypes.CFUNCTYPE(ctypes.c_int64, *kinds, ctypes.c_int64, ctypes.c_int64)
        self._run: Callable[..., int] = kind(self._loaded.address("batch_entry"))

    @property
    def reach(self) -> int:
        return max(1, SLICE_BYTES // (self._length + RESULT_COST * self._results))

    def _part(self, n: int, arguments: list[Any], threads: int) -> NDArray[np.intp] | None:
        tiles = -(-n // self.lanes)
        shared = np.zeros(8 + 2 * tiles, np.uint8)
        if threads == 1:
            done = self._run(*arguments, shared, np.empty(self._buffer_size, np.uint8), n, tiles)
        else:
            piece = max(1, tiles // (PIECES * threads))

            def work() -> int:
                return int(self._run(*arguments, shared, np.empty(self._buffer_size, np.uint8), n, piece))

            done = min(thread_pool.together(work, threads))
        if not done:
            return None
        return rejected(shared[8:].view(np.uint16), self.lanes, n)


def kernel(
    specs: tuple[Spec, ...],
    bodies: NDArray[Any],
    key: str,
    static: Sequence[Any] = (),
    dtype: Any = np.float64,
    options: ProgramOptions = ALL,
    one: bool = False,
    stream: bool = False,
    recorded: Recording | None = None,
) -> Kernel | None:
    """The kernel of some calls for the table whose digest is ``key``; None if a joint has zero articulated inertia.

    one       for single samples: on one lane
    stream    for outputs larger than the CPU caches, which are aligned to a vector
    recorded  what ``record`` returns for it, if that is known
    """
    digest = _digest(specs, key, static, dtype, options, one, stream)
    with _lock:
        known, made = _at_hand(digest, dtype, one)
        if known:
            return made
        return _keep(digest, _compile(specs, bodies, static, digest, dtype, options, one, stream, recorded))


def _compile(
    specs: tuple[Spec, ...],
    bodies: NDArray[Any],
    static: Sequence[Any],
    digest: str,
    dtype: Any,
    options: ProgramOptions,
    one: bool,
    stream: bool,
    recorded: Recording | None,
) -> Kernel | None:
    try:
        program, layout = recorded or record(specs, bodies, static, options, dtype)
    except ZeroDivisionError:  # a joint with zero articulated inertia in every state
        return None
    code, workspace = simd.compile_program(program, layout, dtype, stream, one)
    disk_cache.write(digest, _packed(code, workspace, layout))
    return Kernel(code, workspace, layout, dtype, one)


def cached(
    specs: tuple[Spec, ...],
    key: str,
    static: Sequence[Any] = (),
    options: ProgramOptions = ALL,
    one: bool = False,
    stream: bool = False,
) -> Kernel | None:
    """As ``kernel`` in float64, but None if it is neither in memory nor on disk."""
    with _lock:
        return _at_hand(_digest(specs, key, static, np.float64, options, one, stream), np.float64, one)[1]


def _digest(
    specs: Sequence[Spec], key: str, static: Sequence[Any], dtype: Any, options: ProgramOptions, one: bool, stream: bool
) -> str:
    """A digest of all that the code of a kernel depends on."""
    names = "|".join(f"{s.name}({','.join(x.name for x in s.present)})" for s in specs)
    processor, features, _, _ = host_cpu.host()
    values = "|".join(x.tobytes().hex() if isinstance(x, np.ndarray) else str(x) for x in static)
    chosen = "" if options == ALL else repr(options)
    dtype_name = np.dtype(dtype).name + (" one" if one else "") + (" stream" if stream else "")
    host = (processor, features, host_cpu.llvm_version(), str(DATA_OFFSET))
    text = "\n".join((key, names, values, chosen, dtype_name, STAMP, *host))
    return hashlib.sha256(text.encode()).hexdigest()


def _at_hand(digest: str, dtype: Any, one: bool) -> tuple[bool, Kernel | None]:
    """Whether a kernel is in memory or on disk, and the kernel, None where it is known that there is none."""
    if digest in _programs:
        _programs.move_to_end(digest)
        return True, _programs[digest]
    made = _from_disk_cache(digest, dtype, one)
    return made is not None, None if made is None else _keep(digest, made)


def _keep(digest: str, made: Kernel | None) -> Kernel | None:
    """A kernel, held in memory with the CACHE_SIZE last used."""
    _programs[digest] = made
    while len(_programs) > CACHE_SIZE:
        _programs.popitem(last=False)
    return made


def _packed(code: bytes, workspace: int, layout: KernelLayout) -> bytes:
    """The bytes of a cache file: code, and of its layout the widths, which are all that a loaded kernel needs."""
    widths = [len(layout.inputs), *layout.inputs, len(layout.outputs), *(len(o) for o in layout.outputs), workspace]
    return struct.pack(f"<q{len(widths)}q", len(widths), *widths) + code


def _from_disk_cache(digest: str, dtype: Any, one: bool) -> Kernel | None:
    payload = disk_cache.read(digest)
    if payload is None:
        return None
    (count,) = struct.unpack_from("<q", payload)
    numbers = list(struct.unpack_from(f"<{count}q", payload, 8))
    inputs = tuple(numbers[1 : 1 + numbers[0]])
    outputs = tuple(tuple(range(k)) for k in numbers[2 + numbers[0] : -1])
    return Kernel(payload[8 + 8 * count :], numbers[-1], KernelLayout(inputs, outputs), dtype, one)
