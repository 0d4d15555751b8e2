"""Programs of some calls on one table, interpreted at once and compiled when that pays.

Recording takes milliseconds, compiling ten to fifty times that. So a program is interpreted first. It is compiled when
that pays (``compile_clock``), by the expected time of interpreting it; compiled code in memory or on disk is used at
once.
All ways give the same bits and reject the same samples, so earlier calls change only the time of a call.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....recursions.spec import Spec
from ....waiting import watch
from ... import locks
from ...compile_clock import CompileClock
from ..record.recording import ALL, ProgramOptions, Recording
from . import batch_kernels, single_call
from .batches import Batches
from .interpreter import TILE_LINE_NS, Interpreted, InterpretedBatches

COMPILE_SECONDS = (0.02, 1e-4)  # expected time to compile a program: for any program, and for each line


class TieredProgram(CompileClock):
    """A program of some calls on one table, in float64."""

    def __init__(
        self,
        specs: tuple[Spec, ...],
        bodies: NDArray[Any],
        key: str,
        static: Sequence[Any] = (),
        options: ProgramOptions = ALL,
        recorded: Recording | None = None,
    ) -> None:
        """As ``batch_kernels.kernel``. Raises ZeroDivisionError if a joint has zero articulated inertia in every state.

        Nothing is recorded if compiled code of this table is in memory or on disk, or if the Recording is given.
        """
        super().__init__()
        self.compile_seconds = math.nan  # until a call may be interpreted
        if recorded is not None:
            self.recording = recorded
        self._arguments = (specs, bodies, key, tuple(static))
        self._options = options
        self._lock = locks.new()
        self._calls = np.zeros(1, np.int64)  # how many single samples are interpreted until compiling pays
        self._compiled: dict[tuple[bool, bool], batch_kernels.Kernel | None] = {}
        self._batches: dict[bool, batch_kernels.Kernel] = {}  # kernels compiled for batches, by ``stream``
        self._looked: set[tuple[bool, bool]] = set()  # (one, stream) whose structure's code was looked for
        if not (self._from_cache(one=True) or self._from_cache(one=False)):
            self.recording

    @cached_property
    def recording(self) -> Recording:
        """The program and its layout."""
        specs, bodies, _, static = self._arguments
        with watch.work(f"recording the program of {specs[0].name}"):
            return batch_kernels.record(specs, bodies, static, self._options)

    @cached_property
    def interpreted(self) -> Interpreted:
        """The program, interpreted."""
        return Interpreted(*self.recording)

    def compiled(self, one: bool, stream: bool = False) -> batch_kernels.Kernel:
        """The compiled program: for single samples, or for batches; ``stream`` for large results.

        Calls that interpret single samples take the compiled program from then on.
        """
        with self._lock:
            made = self._at_hand(one, stream)
            if made is None:
                specs, bodies, key, static = self._arguments
                made = batch_kernels.kernel(
                    specs, bodies, key, static, options=self._options, one=one, stream=stream, recorded=self.recording
                )
                assert made is not None
                self._compiled[one, stream] = made
            if one:
                self._calls[0] = 0
            return made

    def single(self) -> tuple[tuple[int, int, int], object]:
        """The (entry, context, left) of a plan of ``single_call``, and the object at these addresses."""
        with self._lock:
            if self._at_hand(one=True) is None and self._expected() and self._calls[0] > 0:
                code = self.interpreted
                return (code.entry, code.context, self._calls.ctypes.data), (code, self._calls)
            made = self.compiled(one=True)
            return (made.code.entry, made.numbers.ctypes.data, single_call.NO_LIMIT.ctypes.data), made

    def batch(self, samples: int, stream: bool = False) -> Batches:
        """The Batches that compute a batch of this many samples; ``stream`` for large results."""
        known = self._batches.get(stream)
        if known is not None:
            return known
        with self._lock:
            if self._at_hand(one=False, stream=stream) is None and self._expected():
                self.spend(1e-9 * TILE_LINE_NS * self.interpreted.lines * samples)
                if not self.pays:
                    return (self._at_hand(one=False) if stream else None) or self._tiles
            return self._batches.setdefault(stream, self.compiled(one=False, stream=stream))

    @cached_property
    def _tiles(self) -> InterpretedBatches:
        return InterpretedBatches(self.interpreted)

    def _expected(self) -> bool:
        """Whether the program may be interpreted; the first call sets the expected compile time."""
        if math.isnan(self.compile_seconds):
            self.compile_seconds = COMPILE_SECONDS[0] + COMPILE_SECONDS[1] * self.interpreted.lines
            self._calls[0] = math.ceil(1e9 * self.compile_seconds / self.interpreted.expected_ns)
        return self.compile_seconds > 0.0

    def _at_hand(self, one: bool, stream: bool = False) -> batch_kernels.Kernel | None:
        """The compiled program if its code is in memory or on disk.

        The disk is searched once: for code of this table, then for code of another table of the same structure.
        """
        made = self._from_cache(one, stream)
        if made is None and (one, stream) not in self._looked:
            self._looked.add((one, stream))
            made = self._compiled[one, stream] = batch_kernels.shared(self.recording, one, stream)
        return made

    def _from_cache(self, one: bool, stream: bool = False) -> batch_kernels.Kernel | None:
        """The compiled program if it is in memory, or on disk as this table's; nothing is recorded."""
        if (one, stream) not in self._compiled:
            specs, _, key, static = self._arguments
            self._compiled[one, stream] = batch_kernels.cached(specs, key, static, self._options, one, stream)
        return self._compiled[one, stream]
