"""The kernel of one program on devices: its PTX, and the launch of a batch or of a time loop."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from .... import errors
from ... import locks
from ..llvm.schedule import MOST_WHOLE
from ..record.kernel_layout import KernelLayout
from ..record.program import Program
from .device import Device, Loaded
from .kernel_text import NVPTX, Target, batch_text, time_loop_text
from .ptx import orders, ptx
from .thread_writer import most_live


class Rows(NamedTuple):
    """An input of a batch: the address of its first row, and the stride to the next sample in numbers (0 if shared)."""

    address: int
    step: int


class StepRows(NamedTuple):
    """An input of a time loop: its address, and the strides to the next sample and the next step in numbers, or 0."""

    address: int
    sample: int
    time: int


class GpuKernel:
    """A program on threads.

    program, layout, dtype  the computation
    states, kept            in a time loop: how many of the first inputs are states, and how many states are recorded
    """

    def __init__(self, program: Program, layout: KernelLayout, dtype: Any, states: int = 0, kept: int = 0) -> None:
        """Raises SpatialDynError for a program too long for one thread."""
        if len(program.lines) > MOST_WHOLE:
            raise errors.SpatialDynError(
                f'the program has {len(program.lines)} operations, expected at most {MOST_WHOLE} with device="cuda"'
            )
        self.program, self.layout, self.dtype = program, layout, np.dtype(dtype)
        self.states, self.kept = states, kept
        self._lock = locks.new()
        self._loaded: dict[tuple[Device, int], Loaded] = {}

    @cached_property
    def orders(self) -> list[list[int]]:
        """Orders of the lines; the first has the fewest values that are held at a time."""
        return sorted(orders(self.program), key=lambda order: most_live(self.program, order))

    def text(self, target: Target, order: int = 0) -> str:
        """The LLVM text with the lines in one of the orders."""
        given = self.program, self.layout, self.dtype
        if self.states:
            return time_loop_text(*given, self.states, self.kept, self.orders[order], target)
        return batch_text(*given, self.orders[order], target)

    @property
    def ptx(self) -> str:
        """The PTX with the lines in the first order."""
        return ptx(self.text(NVPTX))

    def loaded(self, device: Device, number: int) -> Loaded:
        """The kernel on a device, loaded at first use, with the lines in the order that spills least there."""
        key = device, number
        with self._lock:
            if key not in self._loaded:
                best = device.load(lambda target: self.text(target, 0), number)
                for k in range(1, len(self.orders)):
                    if best.spilled:
                        other = device.load(lambda target, k=k: self.text(target, k), number)  # type: ignore[misc]
                        best = other if other.spilled < best.spilled else best
                self._loaded[key] = best
            return self._loaded[key]

    def batch(
        self, device: Device, number: int, n: int, inputs: Sequence[Rows], outputs: Sequence[int], flags: int,
        count: int, stream: int,
    ) -> None:  # fmt: skip
        """Launch the kernel of ``batch_text`` for n samples."""
        given = [n, *(x for rows in inputs for x in rows), *outputs, flags, count]
        device.launch(self.loaded(device, number), number, n, given, stream)

    def time_loop(
        self, device: Device, number: int, steps: tuple[int, int, int], inputs: Sequence[Rows | StepRows],
        records: Sequence[int], flags: int, count: int, stream: int,
    ) -> None:  # fmt: skip
        """Launch the kernel of ``time_loop_text``.

        steps  numbers of samples, of steps, and of steps per record
        """
        n, total, every = steps
        given = [n, total, every, total // every, *(x for rows in inputs for x in rows), *records, flags, count]
        device.launch(self.loaded(device, number), number, n, given, stream)
