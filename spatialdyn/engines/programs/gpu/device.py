"""Devices that run kernels: the interface, and a grid of threads on the host that stands for a GPU in tests."""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ..llvm.host_cpu import LoadedCode, object_code
from .arrays import CPU
from .kernel_text import BLOCK, HOST, Target

Text = Callable[[Target], str]  # of a kernel for a target


class Loaded(NamedTuple):
    """A kernel on a device.

    handle     what the device launches
    spilled    bytes of a thread's local memory: registers that are spilled
    registers  of a thread
    keep       what holds it
    """

    handle: Any
    spilled: int
    registers: int
    keep: Any = None


class Device(ABC):
    """What loads and launches kernels.

    kind  of DLPack, that its arrays have
    """

    kind: int

    @abstractmethod
    def load(self, text: Text, number: int) -> Loaded:
        """Load a kernel on the device of a number."""

    @abstractmethod
    def launch(self, kernel: Loaded, number: int, threads: int, arguments: Sequence[int], stream: int) -> None:
        """Run so many threads of a kernel with these integers and addresses, after what is on the stream."""

    @abstractmethod
    def wait(self, number: int, stream: int) -> None:
        """Wait for what is on a stream."""

    @abstractmethod
    def stream_for_dlpack(self, stream: int) -> int | None:
        """A stream as an argument of ``__dlpack__``."""


class HostGrid(Device):
    """Runs the threads of a grid one after another, on arrays in the memory of the CPU; whole blocks, as a GPU does."""

    kind = CPU

    def load(self, text: Text, number: int) -> Loaded:
        code = LoadedCode(object_code(text(HOST)))
        return Loaded(code.address("grid"), 0, 0, code)

    def launch(self, kernel: Loaded, number: int, threads: int, arguments: Sequence[int], stream: int) -> None:
        whole = -(-threads // BLOCK) * BLOCK
        kinds = [ctypes.c_int64] * (1 + len(arguments))
        ctypes.CFUNCTYPE(None, *kinds)(kernel.handle)(whole, *arguments)

    def wait(self, number: int, stream: int) -> None:
        pass

    def stream_for_dlpack(self, stream: int) -> int | None:
        return None
