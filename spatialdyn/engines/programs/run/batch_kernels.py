"""Compiled programs, cached by a digest of all that they depend on, which run over the samples of a batch.

``kernel`` returns the compiled program of some calls for one table of bodies: from memory, from the disk cache, or
compiled now. Machine code belongs to a program's structure and is shared by all tables of that structure; their numbers
are passed by pointer. A file of the cache holds either the code of a structure, or the numbers of a table and the
digest of its structure. If the names of calls and the stamp do not determine what the calls compute, the content of
their program names them in place of the table. Calling a kernel computes the valid samples and returns the indices of
the others, which NumPy then recomputes: it handles sines of large angles, NaN and errors.
"""

from __future__ import annotations

import ctypes
import hashlib
import struct
from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ....recursions.spec import Spec
from ....waiting import watch
from ... import locks
from ...compiled import disk_cache
from ...compiled.stamp import STAMP, names
from ...threads import PIECES, thread_pool
from ..llvm import host_cpu, simd
from ..llvm.llvm_entry import DATA_OFFSET, buffer_size
from ..record import structure
from ..record.kernel_layout import KernelLayout
from ..record.program import Program
from ..record.recording import ALL, ProgramOptions, Recording
from ..transform.derived import record as record
from .batches import Batches, rejected

Made = TypeVar("Made")
CACHE_SIZE = 128  # most programs in memory, and most structures
THREAD_BYTES = 16 << 20  # least bytes of machine code that a thread runs: fewer take less time than waking it
SLICE_BYTES = 1 << 30  # bytes of machine code that a thread runs until Ctrl-C is handled
RESULT_COST = 64  # bytes of machine code that take as long as a byte of results in fresh memory
DIGEST_SIZE = 64  # characters of a digest
STREAM_BYTES = 16 << 20  # least bytes of an output that bypasses the CPU caches

_lock = locks.new()
_programs: OrderedDict[str, Kernel | None] = OrderedDict()
_codes: OrderedDict[str, MachineCode] = OrderedDict()


class MachineCode:
    """The loaded machine code of a program's structure."""

    def __init__(
        self,
        code: bytes,
        workspace: int,
        inputs: tuple[int, ...],
        outputs: tuple[int, ...],
        dtype: Any,
        one: bool = False,
    ) -> None:
        """Load object code made by ``simd.compile_program``, for arrays with these numbers of columns."""
        self._loaded = host_cpu.LoadedCode(code)
        self.dtype, self.lanes = np.dtype(dtype), 1 if one else host_cpu.lanes_of(dtype)
        self.inputs, self.outputs, self.workspace, self.length = inputs, outputs, workspace, len(code)
        self.address = self._loaded.address("kernel")
        self.entry = self._loaded.address("one_entry") if one else 0  # as ``single_call`` calls it
        kinds: list[Any] = [ctypes.py_object, ctypes.c_int64] * len(inputs)
        kinds += [ctypes.py_object] * (len(outputs) + 3)
        kind = ctypes.CFUNCTYPE(ctypes.c_int64, *kinds, ctypes.c_int64, ctypes.c_int64)
        self.batch = self._loaded.address("batch_entry")
        self.run: Callable[..., int] = kind(self.batch)


class Kernel(Batches):
    """A compiled program over batches: the machine code of its structure, and its numbers."""

    def __init__(self, code: MachineCode, numbers: NDArray[Any]) -> None:
        """Of a structure's code and the numbers of one program of that structure, in its dtype."""
        self.code, self.numbers = code, numbers
        self.dtype, self.lanes = code.dtype, code.lanes
        self.inputs, self.outputs = code.inputs, code.outputs
        size = self.dtype.itemsize
        self._buffer_size = buffer_size(self.inputs, self.outputs, code.workspace, self.lanes, size)
        self.share = max(1, THREAD_BYTES // code.length)
        self._results: int = self.lanes * size * sum(self.outputs)

    @property
    def reach(self) -> int:
        return max(1, SLICE_BYTES // (self.code.length + RESULT_COST * self._results))

    def _part(self, n: int, arguments: list[Any], threads: int) -> NDArray[np.intp] | None:
        tiles = -(-n // self.lanes)
        shared = np.zeros(8 + 2 * tiles, np.uint8)
        if threads == 1:
            done = self.code.run(*arguments, self.numbers, shared, np.empty(self._buffer_size, np.uint8), n, tiles)
        else:
            piece = max(1, tiles // (PIECES * threads))

            def work() -> int:
                buffer = np.empty(self._buffer_size, np.uint8)
                return int(self.code.run(*arguments, self.numbers, shared, buffer, n, piece))

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

    one       for single samples, on one lane
    stream    for outputs larger than the CPU caches, which must be aligned to a vector
    recorded  the Recording of the calls, if it is known
    """
    if not all(map(names, specs)):
        try:
            recorded = recorded or record(specs, bodies, static, options, dtype)
        except ZeroDivisionError:
            return None
        key = structure.content(*recorded)
    digest = _digest(specs, key, static, dtype, options, one, stream)
    others = f" and {len(specs) - 1} more" if len(specs) > 1 else ""
    with _lock, watch.work(f"compiling the program of {specs[0].name}{others}", disk_cache.kept):
        known, made = _at_hand(digest, dtype, one)
        if known:
            return made
        try:
            program, layout = recorded or record(specs, bodies, static, options, dtype)
        except ZeroDivisionError:  # a joint with zero articulated inertia in every state
            return _keep(_programs, digest, None)
        of_code, numbers = _of_structure(program, layout, dtype, one, stream)
        code = _code_at_hand(of_code, dtype, one)
        if code is None:
            objects, workspace = simd.compile_program(program, layout, dtype, stream, one)
            disk_cache.write(of_code, _packed(objects, workspace, layout))
            columns = tuple(map(len, layout.outputs))
            code = _keep(_codes, of_code, MachineCode(objects, workspace, layout.inputs, columns, dtype, one))
        disk_cache.write(digest, of_code.encode() + numbers.tobytes(), disk_cache.NUMBERS)
        return _keep(_programs, digest, Kernel(code, numbers))


def name_of(
    specs: tuple[Spec, ...],
    key: str,
    static: Sequence[Any],
    dtype: Any,
    options: ProgramOptions,
    recorded: Callable[[], Recording],
) -> str:
    """A digest of what ``kernel`` returns for these arguments; calls ``recorded`` if they do not determine it."""
    key = key if all(map(names, specs)) else structure.content(*recorded())
    return _digest(specs, key, static, dtype, options, False, False)


def compiled(program: Program, layout: KernelLayout, dtype: Any = np.float64, one: bool = False) -> Kernel:
    """The kernel of a program, compiled in memory."""
    code, workspace = simd.compile_program(program, layout, dtype, one=one)
    columns = tuple(map(len, layout.outputs))
    numbers = structure.Numbers(program, layout).values(dtype)
    return Kernel(MachineCode(code, workspace, layout.inputs, columns, dtype, one), numbers)


def cached(
    specs: tuple[Spec, ...],
    key: str,
    static: Sequence[Any] = (),
    options: ProgramOptions = ALL,
    one: bool = False,
    stream: bool = False,
) -> Kernel | None:
    """As ``kernel`` in float64, but None if it is neither in memory nor on disk under its name."""
    if not all(map(names, specs)):
        return None
    with _lock:
        return _at_hand(_digest(specs, key, static, np.float64, options, one, stream), np.float64, one)[1]


def shared(recorded: Recording, one: bool = False, stream: bool = False) -> Kernel | None:
    """The kernel of a recorded program in float64 if the code of its structure is in memory or on disk."""
    with _lock:
        of_code, numbers = _of_structure(*recorded, np.float64, one, stream)
        code = _code_at_hand(of_code, np.float64, one)
        return None if code is None else Kernel(code, numbers)


def forget() -> None:
    """Forget programs and machine code in memory, so that they are looked for on disk again."""
    with _lock:
        _programs.clear()
        _codes.clear()


def _digest(
    specs: Sequence[Spec], key: str, static: Sequence[Any], dtype: Any, options: ProgramOptions, one: bool, stream: bool
) -> str:
    """A digest of all that a kernel depends on."""
    listed = "|".join(f"{s.name}({','.join(x.name for x in s.present)})" for s in specs)
    values = "|".join(x.tobytes().hex() if isinstance(x, np.ndarray) else str(x) for x in static)
    chosen = "" if options == ALL else repr(options)
    return _hash(key, listed, values, chosen, _machine(dtype, one, stream))


def _of_structure(
    program: Program, layout: KernelLayout, dtype: Any, one: bool, stream: bool
) -> tuple[str, NDArray[Any]]:
    """A digest of all that the machine code of a program depends on, and its numbers."""
    digest = _hash(structure.digest(program, layout), _machine(dtype, one, stream))
    return digest, structure.Numbers(program, layout).values(dtype)


def code_digest(what: str) -> str:
    """A digest of machine code for this host: of ``what`` it computes and of the sources that make it."""
    return _hash(what, _machine(np.float64, False, False))


def _machine(dtype: Any, one: bool, stream: bool) -> str:
    """What machine code depends on in addition to its program, as text."""
    processor, features, _, _ = host_cpu.host()
    kind = np.dtype(dtype).name + (" one" if one else "") + (" stream" if stream else "")
    return "\n".join((kind, STAMP, processor, features, host_cpu.llvm_version(), str(DATA_OFFSET)))


def _hash(*parts: str) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _at_hand(digest: str, dtype: Any, one: bool) -> tuple[bool, Kernel | None]:
    """Whether a kernel is in memory or on disk, and the kernel; None if it is known that there is no kernel."""
    if digest in _programs:
        _programs.move_to_end(digest)
        return True, _programs[digest]
    held = _from_disk_cache(digest, disk_cache.NUMBERS)
    if held is None:
        return False, None
    code = _code_at_hand(held[:DIGEST_SIZE].decode(), dtype, one)
    if code is None:
        return False, None
    return True, _keep(_programs, digest, Kernel(code, np.frombuffer(held[DIGEST_SIZE:], dtype)))


def _code_at_hand(digest: str, dtype: Any, one: bool) -> MachineCode | None:
    """The machine code of a structure if it is in memory or on disk."""
    if digest in _codes:
        _codes.move_to_end(digest)
        return _codes[digest]
    payload = _from_disk_cache(digest, disk_cache.PROGRAM)
    if payload is None:
        return None
    (count,) = struct.unpack_from("<q", payload)
    widths = struct.unpack_from(f"<{count}q", payload, 8)
    inputs, outputs, workspace = widths[1 : 1 + widths[0]], widths[2 + widths[0] : -1], widths[-1]
    return _keep(_codes, digest, MachineCode(payload[8 + 8 * count :], workspace, inputs, outputs, dtype, one))


def _keep(held: OrderedDict[str, Made], digest: str, made: Made) -> Made:
    """Hold ``made`` in memory, with the CACHE_SIZE last used; returns it."""
    held[digest] = made
    while len(held) > CACHE_SIZE:
        held.popitem(last=False)
    return made


def _packed(code: bytes, workspace: int, layout: KernelLayout) -> bytes:
    """The bytes of a file of machine code: the code behind the widths of its arrays."""
    widths = [len(layout.inputs), *layout.inputs, len(layout.outputs), *(len(o) for o in layout.outputs), workspace]
    return struct.pack(f"<q{len(widths)}q", len(widths), *widths) + code


def _from_disk_cache(digest: str, kind: str) -> bytes | None:
    return disk_cache.read(digest, kind)
