"""Devices that run kernels: the interface, and a grid of threads on the host that stands for a GPU in tests."""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ..llvm.host_cpu import LoadedCode, object_code
from .arrays import CPU
from .kernel_text import BLOCK, HOST, Target

Text = Callable[[Target], str]  # makes the text of a kernel for a target


class Loaded(NamedTuple):
    """A kernel on a device.

    handle     the handle that the device launches
    spilled    bytes of a thread's local memory, which holds spilled registers
    registers  registers of a thread
    keep       the object that owns the kernel
    """

    handle: Any
    spilled: int
    registers: int
    keep: Any = None


class Device(ABC):
    """A device that loads and launches kernels.

    kind  DLPack's kind of device of its arrays
    """

    kind: int

    @abstractmethod
    def load(self, text: Text, number: int) -> Loaded:
        """Load a kernel on device ``number``."""

    @abstractmethod
    def launch(self, kernel: Loaded, number: int, threads: int, arguments: Sequence[int], stream: int) -> None:
        """Launch threads of a kernel with these integers and addresses, after earlier work on the stream."""

    @abstractmethod
    def wait(self, number: int, stream: int) -> None:
        """Wait for the work on a stream."""

    @abstractmethod
    def stream_for_dlpack(self, stream: int) -> int | None:
        """A stream as the argument of ``__dlpack__``."""


class HostGrid(Device):
    """A host that runs the threads of a grid one after another, in whole blocks as on a GPU, on arrays of the CPU."""

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
