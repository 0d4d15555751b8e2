"""Programs run without compiling them: line by line, by machine code that is compiled once for all programs.

``Interpreted`` holds a program's instructions and the address of the function that runs one sample;
``InterpretedBatches`` runs batches in tiles. Both have the bits of the compiled program and reject the same samples.
The machine code is kept in the disk cache under a digest of its text, the host and LLVM's version.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...threads import PIECES, thread_pool
from ..llvm import host_cpu
from ..llvm.instructions import encode
from ..llvm.interpreter_text import (
    BITS,
    CODE,
    CONSTANT_COUNT,
    CONSTANTS,
    INPUT_COUNT,
    INPUTS,
    OUTPUT_COUNT,
    OUTPUTS,
    VALUES,
    WORDS,
    one_text,
    tiles_text,
)
from ..llvm.llvm_entry import ALIGNMENT
from ..record.kernel_layout import KernelLayout
from ..record.program import Program
from .batches import Batches, overlap, rejected

BASE_NS = 50.0  # time of the call for one sample
NUMBER_NS = 0.5  # time of an input or output
LINE_NS = 1.7  # time of a line, in programs of any length
TILES = (64, 32, 16)  # samples of a tile
TILE_BYTES = 1 << 19  # most bytes of a tile's slots, which then stay in the L2 cache
TILE_LINE_NS = 0.25  # time of a line for one sample of a tile, on vectors of four numbers
SHARE_NS, SLICE_NS = 1e5, 5e7  # least for a thread, and until Ctrl-C is handled
RESULT_NS = 3.0  # of each byte of results in a slice, as of ``batch_kernels.RESULT_COST``


@cache
def _one() -> host_cpu.LoadedCode:
    return host_cpu.stored_code(one_text())


@cache
def _tiles() -> tuple[host_cpu.LoadedCode, Callable[..., None]]:
    """The code that runs tiles, and its function."""
    code = host_cpu.stored_code(tiles_text(host_cpu.lanes_of(np.float64)))
    kind = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 6, ctypes.c_int64, ctypes.c_int64)
    return code, kind(code.address("interpret_tiles"))


def _aligned(count: int) -> NDArray[np.float64]:
    """Numbers aligned to ALIGNMENT."""
    memory = np.empty(8 * count + ALIGNMENT, np.uint8)
    first = -memory.ctypes.data % ALIGNMENT
    return memory[first : first + 8 * count].view(np.float64)


class Interpreted:
    """A program as instructions, and the function that runs one sample of it.

    entry    address of ``interpret_one(context, inputs, outputs)``, which returns 1, or 0 if the sample is rejected
             and no output written. ``inputs`` and ``outputs`` are addresses of arrays of addresses of float64 numbers,
             contiguous and aligned, one for each of the layout's. Outputs may lie on inputs, but not on each other.
    context  address of the context, which includes a slot for each value, so it serves one thread at a time
    lines    instructions of a sample
    words    the context
    """

    def __init__(self, program: Program, layout: KernelLayout) -> None:
        """Encode a program in float64. Raises SpatialDynError if the layout has a range."""
        made = encode(program, layout)
        self.encoded, self.layout = made, layout
        self.lines = len(made.code)
        self._code = _one()
        self.entry = self._code.address("interpret_one")
        self._values = _aligned(made.slots)
        self._values[: len(made.constants)] = made.constants
        widths = np.array(layout.inputs, np.int64)
        first = len(made.constants) + np.concatenate(([0], np.cumsum(widths)))[:-1]
        self._inputs = np.column_stack((first, widths)).astype(np.int64)
        self._outputs = np.array([(x.ctypes.data, len(x)) for x in made.outputs], np.int64)
        self.words = np.zeros(WORDS, np.int64)
        self.words[CODE] = made.code.ctypes.data
        self.words[VALUES] = self._values.ctypes.data
        self.words[INPUTS], self.words[INPUT_COUNT] = self._inputs.ctypes.data, len(widths)
        self.words[OUTPUTS], self.words[OUTPUT_COUNT] = self._outputs.ctypes.data, len(made.outputs)
        self.words[CONSTANT_COUNT] = len(made.constants)
        self.context = int(self.words.ctypes.data)

    @property
    def expected_ns(self) -> float:
        """Expected time of a sample [ns]."""
        numbers = self.encoded.inputs + sum(map(len, self.encoded.outputs))
        return BASE_NS + NUMBER_NS * numbers + LINE_NS * self.lines


class InterpretedBatches(Batches):
    """An interpreted program over batches, in tiles: each line runs for all samples of a tile."""

    def __init__(self, interpreted: Interpreted) -> None:
        """For the program of an ``Interpreted``."""
        made, layout = interpreted.encoded, interpreted.layout
        self._program, self.dtype = interpreted, np.dtype(np.float64)
        self.inputs, self.outputs = layout.inputs, tuple(map(len, layout.outputs))
        self._rows = made.slots - len(made.constants) + 1
        self.lanes = next((wide for wide in TILES if 8 * wide * self._rows <= TILE_BYTES), TILES[-1])
        spent = TILE_LINE_NS * self.lanes * interpreted.lines
        written = self.lanes * self.dtype.itemsize * sum(self.outputs)
        self.share = max(1, int(SHARE_NS / spent))
        self._reach = max(1, int(SLICE_NS / (spent + RESULT_NS * written)))
        self._code, self._run = _tiles()
        lanes = host_cpu.lanes_of(np.float64)
        self._constants = _aligned(lanes * len(made.constants))
        self._constants.reshape(-1, lanes)[:] = made.constants[:, None]
        self._context = interpreted.words.copy()
        self._context[CONSTANTS] = self._constants.ctypes.data
        self._address = self._context.ctypes.data

    @property
    def reach(self) -> int:
        return self._reach

    def _part(self, n: int, arguments: list[Any], threads: int) -> NDArray[np.intp] | None:
        k = len(self.inputs)
        inputs, outputs = arguments[: 2 * k : 2], arguments[2 * k :]
        if overlap(inputs, outputs):
            return None
        tiles = -(-n // self.lanes)
        pieces = 1 if threads == 1 else min(tiles, PIECES * threads)
        cuts = [min(tiles * j // pieces * self.lanes, n) for j in range(pieces + 1)]
        parts = [
            partial(self._piece, b - a, self._cut(inputs, a, b, n), [y[a:b] for y in outputs])
            for a, b in pairwise(cuts)
        ]
        made = [parts[0]()] if pieces == 1 else thread_pool.run(parts, threads)
        found = [samples + first for first, samples in zip(cuts, made, strict=False)]
        return found[0] if pieces == 1 else np.concatenate(found)

    def _piece(self, n: int, inputs: list[Any], outputs: list[Any]) -> NDArray[np.intp]:
        """Compute n samples in this thread; ``inputs`` are arrays, each followed by its rows."""
        k, rows = len(self.inputs), inputs[1::2]
        steps = [8 * columns if several > 1 else 0 for columns, several in zip(self.inputs, rows, strict=True)]
        bits = np.empty(-(-n // self.lanes) * self.lanes // BITS, np.uint16)
        workspace = _aligned(self._rows * self.lanes)
        self._run(
            self._address,
            (ctypes.py_object * k)(*inputs[::2]),
            (ctypes.c_int64 * k)(*steps),
            (ctypes.py_object * len(outputs))(*outputs),
            bits.ctypes.data,
            workspace.ctypes.data,
            self.lanes,
            n,
        )
        return rejected(bits, BITS, n)
