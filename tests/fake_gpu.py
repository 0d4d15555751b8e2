"""A GPU that is none: CUDA's driver and CuPy as far as the library calls them, on a grid of threads on the host.

What the library does with them is executed: arrays by DLPack, streams, contexts, arguments of a launch, its blocks.
"""

from __future__ import annotations

import ctypes
import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from spatialdyn.calls import devices
from spatialdyn.engines.programs.gpu import cuda
from spatialdyn.engines.programs.gpu.arrays import CUDA
from spatialdyn.engines.programs.gpu.kernel_text import HOST, NVPTX
from spatialdyn.engines.programs.llvm.host_cpu import LoadedCode, object_code

STREAM = 77  # the caller's


class Driver(ModuleType):
    """The functions of cuda.bindings.driver; ``spills`` are those of the kernels in the order in which they load."""

    def __init__(self, spills: tuple[int, ...] = ()) -> None:
        super().__init__("cuda.bindings.driver")
        self.spills, self.images, self.launches, self.stack = [*spills], [], [], []  # type: ignore[var-annotated]
        self.codes: dict[bytes, tuple[LoadedCode, int]] = {}
        self.waits = 0
        self.CUfunction_attribute = SimpleNamespace(
            CU_FUNC_ATTRIBUTE_LOCAL_SIZE_BYTES="local", CU_FUNC_ATTRIBUTE_NUM_REGS="registers"
        )

    def image(self, _: Any, text: Any) -> bytes:
        """In place of ``Cuda.image``: the code of the host under a name."""
        assert text(NVPTX).count("ptx_kernel") == 1
        source = text(HOST)
        head = next(line for line in source.splitlines() if line.startswith("define void @grid"))
        name = f"image {len(self.codes)}".encode() + b"\0"
        self.codes[name] = LoadedCode(object_code(source)), head.count("%") - 1
        return name

    def cuInit(self, flags: int) -> tuple[int]:
        return (0,)

    def cuDeviceGet(self, number: int) -> tuple[int, int]:
        return 0, number

    def cuDeviceGetName(self, length: int, where: int) -> tuple[int, bytes]:
        return 0, b"no GPU\0\0".ljust(length, b"\0")

    def cuDevicePrimaryCtxRetain(self, where: int) -> tuple[int, str]:
        return 0, f"context {where}"

    def cuCtxPushCurrent(self, context: str) -> tuple[int]:
        self.stack.append(context)
        return (0,)

    def cuCtxPopCurrent(self) -> tuple[int, str]:
        return 0, self.stack.pop()

    def cuModuleLoadData(self, image: bytes) -> tuple[int, bytes]:
        assert self.stack
        self.images.append(image)
        return 0, image

    def cuModuleGetFunction(self, module: bytes, name: bytes) -> tuple[int, bytes]:
        assert name == b"kernel"
        return 0, module

    def cuFuncGetAttribute(self, attribute: str, handle: bytes) -> tuple[int, int]:
        place = self.images.index(handle)
        return 0, (self.spills[place] if place < len(self.spills) else 0) if attribute == "local" else 40

    def CUstream(self, stream: int) -> int:
        return stream

    def cuStreamSynchronize(self, stream: int) -> tuple[int]:
        self.waits += 1
        return (0,)

    def cuLaunchKernel(self, handle: bytes, *rest: Any) -> tuple[int]:
        blocks, _, _, threads, *_, shared, stream, parameters, extra = rest
        assert self.stack
        assert rest[1:3] == rest[4:6] == (1, 1)
        assert (shared, extra) == (0, 0)
        code, count = self.codes[handle]
        addresses = np.ctypeslib.as_array(ctypes.cast(parameters, ctypes.POINTER(ctypes.c_uint64)), (count,))
        values = [ctypes.c_int64.from_address(int(x)).value for x in addresses]
        self.launches.append((handle, blocks, threads, stream))
        ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * (1 + count))(code.address("grid"))(blocks * threads, *values)
        return (0,)


class Array:
    """An array of the fake CuPy."""

    __module__ = "cupy"
    streams: list[Any] = []  # noqa: RUF012  # for which arrays were asked

    def __init__(self, x: Any) -> None:
        self.x = x
        self.shape, self.dtype = x.shape, x.dtype
        self.device = self

    def __enter__(self) -> None:
        pass

    def __exit__(self, *error: Any) -> None:
        pass

    def __dlpack_device__(self) -> tuple[int, int]:
        return CUDA, 0

    def __dlpack__(self, stream: int) -> Any:
        Array.streams.append(stream)
        return self.x.__dlpack__()

    def reshape(self, shape: Any, *more: int) -> Array:
        return Array(self.x.reshape(shape, *more))

    def __getitem__(self, index: Any) -> Array:
        return Array(self.x[index.x if isinstance(index, Array) else index])

    def __setitem__(self, index: Array, values: Array) -> None:
        self.x[index.x] = values.x

    def __add__(self, other: Array) -> Array:
        return Array(self.x + other.x)


def install(monkeypatch: pytest.MonkeyPatch, spills: tuple[int, ...] = ()) -> Driver:
    """Both modules, until the end of the test; returns the driver."""
    driver, cupy = Driver(spills), ModuleType("cupy")
    cupy.empty = lambda shape, dtype: Array(np.full(shape, 9, dtype))  # type: ignore[attr-defined]
    cupy.ones = lambda shape: Array(np.ones(shape))  # type: ignore[attr-defined]
    cupy.zeros = lambda shape, dtype: Array(np.zeros(shape, dtype))  # type: ignore[attr-defined]
    cupy.asarray = lambda x: Array(np.array(x))  # type: ignore[attr-defined]
    cupy.asnumpy = lambda x: x.x.copy()  # type: ignore[attr-defined]
    cupy.cuda = SimpleNamespace(get_current_stream=lambda: SimpleNamespace(ptr=STREAM))  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "cuda.bindings.driver", driver)
    monkeypatch.setitem(sys.modules, "cupy", cupy)
    monkeypatch.setattr(cuda.Cuda, "image", lambda self, text: driver.image(self, text))
    for kept in (cuda._driver, cuda._context, devices._cuda):
        kept.cache_clear()
        monkeypatch.setattr(sys.modules[kept.__module__], kept.__name__, kept.__wrapped__)
    Array.streams.clear()
    return driver
