"""Kernels on NVIDIA GPUs, through the CUDA driver and cuda-bindings: the driver compiles PTX for its GPU."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from ....errors import SpatialDynError, literal, pip_install
from .arrays import CUDA
from .device import Device, Loaded, Text
from .kernel_text import BLOCK, NVPTX
from .ptx import ptx

LEGACY = 1  # the default stream in DLPack and the driver; 0 has another meaning in DLPack


class Cuda(Device):
    """The CUDA driver."""

    kind = CUDA

    def image(self, text: Text) -> bytes:
        """The image that the driver loads: PTX with a zero byte at its end."""
        return ptx(text(NVPTX)).encode() + b"\0"

    def load(self, text: Text, number: int) -> Loaded:
        driver = _driver()
        attribute = driver.CUfunction_attribute
        with _current(number):
            module = _done("cuModuleLoadData", driver.cuModuleLoadData(self.image(text)))
            handle = _done("cuModuleGetFunction", driver.cuModuleGetFunction(module, b"kernel"))
            spilled, registers = (
                int(_done("cuFuncGetAttribute", driver.cuFuncGetAttribute(x, handle)))
                for x in (attribute.CU_FUNC_ATTRIBUTE_LOCAL_SIZE_BYTES, attribute.CU_FUNC_ATTRIBUTE_NUM_REGS)
            )
        return Loaded(handle, spilled, registers, module)

    def launch(self, kernel: Loaded, number: int, threads: int, arguments: Sequence[int], stream: int) -> None:
        driver = _driver()
        values = np.array(arguments, np.int64)  # the driver takes the address of each argument
        addresses = (values.ctypes.data + 8 * np.arange(len(values))).astype(np.uint64)
        blocks = -(-threads // BLOCK)
        with _current(number):
            made = driver.cuLaunchKernel(
                kernel.handle, blocks, 1, 1, BLOCK, 1, 1, 0, driver.CUstream(stream or LEGACY), addresses.ctypes.data, 0
            )
            _done("cuLaunchKernel", made)

    def wait(self, number: int, stream: int) -> None:
        driver = _driver()
        with _current(number):
            _done("cuStreamSynchronize", driver.cuStreamSynchronize(driver.CUstream(stream or LEGACY)))

    def stream_for_dlpack(self, stream: int) -> int | None:
        return stream or LEGACY

    def name(self, number: int) -> str:
        """The name of a GPU."""
        driver = _driver()
        where = _done("cuDeviceGet", driver.cuDeviceGet(number))
        made: bytes = _done("cuDeviceGetName", driver.cuDeviceGetName(128, where))
        return made.split(b"\0")[0].decode()


def _done(call: str, found: Any) -> Any:
    """The result of a call of the driver. Raises SpatialDynError naming a call that failed."""
    error, *rest = found
    if int(error) != 0:
        raise SpatialDynError(f"{call} of the CUDA driver failed: {literal(error)}")
    return rest[0] if len(rest) == 1 else rest


@cache
def _driver() -> Any:
    """The bindings, initialized. Raises SpatialDynError if they or the driver are missing."""
    try:
        driver = import_module("cuda.bindings.driver")
    except ImportError:
        raise SpatialDynError(f"cuda-bindings is not installed; {pip_install('cuda')}") from None
    try:
        _done("cuInit", driver.cuInit(0))
    except (RuntimeError, OSError) as error:  # from the loader
        raise SpatialDynError(
            f'device is "cuda", expected a machine with a GPU of NVIDIA and its driver: {error}'
        ) from None
    return driver


@cache
def _context(number: int) -> Any:
    """The primary context of a GPU, which other libraries use too."""
    driver = _driver()
    where = _done("cuDeviceGet", driver.cuDeviceGet(number))
    return _done("cuDevicePrimaryCtxRetain", driver.cuDevicePrimaryCtxRetain(where))


@contextmanager
def _current(number: int) -> Iterator[None]:
    """A context in which a GPU is the thread's current GPU."""
    driver = _driver()
    _done("cuCtxPushCurrent", driver.cuCtxPushCurrent(_context(number)))
    try:
        yield
    finally:
        _done("cuCtxPopCurrent", driver.cuCtxPopCurrent())
