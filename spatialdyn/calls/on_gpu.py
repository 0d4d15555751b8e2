"""The program of a ``specialize`` request on a GPU: one thread a sample, arrays by DLPack."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engines.programs.gpu import arrays as device_arrays
from ..engines.programs.gpu.arrays import Library, View
from ..engines.programs.gpu.device import Device
from ..engines.programs.gpu.gpu_kernel import GpuKernel, Rows
from ..errors import ShapeError, SpatialDynError
from . import specialize_fallback
from .arguments import as_flag, broadcast
from .differentiable import Differentiable
from .specialize_request import Array, SpecializeRequest
from .specialized import Specialized, lead_of, of_request


class SpecializedOnGpu(Specialized):
    """A program on a GPU, called as ``Specialized`` with arrays of PyTorch, CuPy or JAX in its memory.

    ``k(q, v, a, out=None, check=True)`` takes arrays of the program's dtype and of any batch shape, with a constant
    stride between rows; an input shared by all samples has no batch axes. Results are arrays of the same library, on
    the caller's stream.

    check  True: samples that lanes reject (large angles, NaN, joints without inertia) are computed on the CPU, and
           their errors raised; the call waits for the GPU. False: results of such samples are NaN

    engine    "cuda"; ``ptx`` is the text that the driver compiles
    """

    def __init__(
        self, request: SpecializeRequest, maker: Callable[..., Specialized], arguments: tuple[Any, ...], device: Device
    ) -> None:
        """Record the program of a request; it is loaded at the first call."""
        self._read_request(request, (maker, arguments))
        self._device = device
        if not self._fits:
            names = ", ".join(self.calls)
            raise SpatialDynError(
                f'{names} of "{request.model.name}" has no program in {request.dtype}, expected one for device="cuda"'
            )
        start = time.perf_counter()
        self._on_device: GpuKernel = self._threads
        self.compile_seconds = time.perf_counter() - start

    @property
    def engine(self) -> str:
        """The engine of batches."""
        return "cuda"

    @cached_property
    def _lanes(self) -> Specialized:
        """The same program on the CPU, for rejected samples."""
        return of_request(self._request, *self._made_by)

    @property
    def _differentiable(self) -> Differentiable:
        return self._lanes._differentiable

    def __call__(self, *arrays: Any, out: Any = None, check: bool = True) -> Any:
        request, names = self._request, [x.name for x in self._inputs]
        check = as_flag("check", check)
        if len(arrays) != len(names):
            raise TypeError(f"{len(arrays)} inputs were given, expected {len(names)}: ({', '.join(names)})")
        device = self._device
        library, number = device_arrays.library_of(names, arrays, device.kind)
        stream = library.stream
        given = [self._viewed(x, array, stream) for x, array in zip(self._inputs, arrays, strict=True)]
        leads = [lead_of(x, view.shape) for x, view in zip(self._inputs, given, strict=True)]
        batch = broadcast(names, leads)
        rows = [_rows(x, view, batch) for x, view in zip(self._inputs, given, strict=True)]
        whole = [batch + shape for shape in self._shapes]
        made = [library.empty(shape, request.dtype) for shape in whole] if out is None else self._given(out, len(whole))
        views = [device_arrays.read("out", x, device.stream_for_dlpack(stream)) for x in made]
        if out is not None:
            device_arrays.library_of(["out"] * len(made), made, device.kind)
            self._check_outs(views, whole, given)
        n = math.prod(batch)
        if n:
            flags, count = library.empty((n,), np.uint8), library.zero()
            noted = [device_arrays.read("flags", x, device.stream_for_dlpack(stream)).address for x in (flags, count)]
            addresses = [view.address for view in views]
            self._on_device.batch(device, number, n, rows, addresses, noted[0], noted[1], stream)
            if check or not library.is_async():
                device.wait(number, stream)
            if check and int(library.to_host(count)[0]):
                index = np.flatnonzero(library.to_host(flags) == 0)
                found = self._rejected(library, arrays, rows, batch, index)
                made = [library.put(x, n, index, part) for x, part in zip(made, found, strict=True)]
        return tuple(made) if request.several else made[0]

    def _rejected(
        self, library: Library, arrays: Sequence[Any], rows: Sequence[Rows], batch: tuple[int, ...],
        index: NDArray[np.intp],
    ) -> list[NDArray[Any]]:  # fmt: skip
        """The results (count, columns) of some samples: by lanes, then by the recursion in NumPy if lanes reject."""
        n, request, lanes = math.prod(batch), self._request, self._lanes
        parts = []
        for x, array, at in zip(self._inputs, arrays, rows, strict=True):
            some = library.rows(array, n, index) if at.step else library.rows(array, 1, np.zeros(1, np.intp))
            parts.append(np.ascontiguousarray(some).reshape((-1, *(x.shape or (1,)))))
        found = [np.empty((len(index), math.prod(shape)), request.dtype) for shape in self._shapes]
        left = None
        if lanes._kernel is not None:
            left = lanes._kernel([x.reshape((len(x), -1)) for x in parts], found)
        left = np.arange(len(index)) if left is None else left
        if len(left):  # at their places in the batch, which errors name; untouched memory costs nothing
            both = zip(parts, rows, strict=True)
            wide = [np.zeros((n, *part.shape[1:]), part.dtype) if at.step else part for part, at in both]
            for whole, part, at in zip(wide, parts, rows, strict=True):
                if at.step:
                    whole[index[left]] = part[left]
            results = [np.zeros((n, x.shape[1]), x.dtype) for x in found]
            specialize_fallback.compute(request, self._inputs, wide, results, batch, index[left], False)
            for result, part in zip(results, found, strict=True):
                part[left] = result[index[left]]
        return found

    def _viewed(self, wanted: Array, value: Any, stream: int = 0) -> View:
        view = device_arrays.read(wanted.name, value, self._device.stream_for_dlpack(stream))
        if view.dtype != self.dtype:
            raise ShapeError(f"{wanted.name} has dtype {view.dtype}, expected {self.dtype}, that of the program")
        return view

    def _given(self, out: Any, count: int, inputs: Any = None) -> list[Any]:
        outs = out if self._request.several else (out,)
        if not isinstance(outs, (tuple, list)) or len(outs) != count:
            raise ShapeError(f"out is {type(out).__name__}, expected a tuple of {count} arrays")
        return list(outs)

    def _check_outs(self, outs: Sequence[View], shapes: Sequence[tuple[int, ...]], inputs: Sequence[View]) -> None:
        """Check ``out``. Raises ShapeError."""
        for k, (x, shape) in enumerate(zip(outs, shapes, strict=True)):
            if x.shape != shape or x.dtype != self.dtype:
                raise ShapeError(f"out is shape {x.shape}, {x.dtype}, expected an array of shape {shape}, {self.dtype}")
            if not x.contiguous:
                raise ShapeError("out is not an array in C order")
            others = [("another out", y) for y in outs[:k]]
            others += [(i.name, y) for i, y in zip(self._inputs, inputs, strict=True)]
            for name, y in others:
                if x.extent[0] < y.extent[1] and y.extent[0] < x.extent[1]:
                    raise ShapeError(f"out overlaps {name} in memory, expected an array of its own")


def _rows(wanted: Array, x: View, batch: tuple[int, ...]) -> Rows:
    """The rows of an input. Raises ShapeError unless the stride between them is constant."""
    lead, rank = lead_of(wanted, x.shape), len(wanted.shape)
    if not math.prod(batch):
        return Rows(x.address, 0)
    if rank and not x._replace(shape=x.shape[len(lead) :], strides=x.strides[len(lead) :]).contiguous:
        raise ShapeError(f"{wanted.name} has strides {x.strides}, expected the numbers of a sample side by side")
    if math.prod(lead) <= 1 and math.prod(batch) != math.prod(lead):
        return Rows(x.address, 0)
    several = [(size, stride) for size, stride in zip(lead, x.strides, strict=False) if size != 1]
    step = several[-1][1] if several else max(1, math.prod(wanted.shape))
    expected = step
    for size, stride in reversed(several):
        if stride != expected:
            raise ShapeError(f"{wanted.name} has strides {x.strides}, expected rows that lie one stride apart")
        expected = stride * size
    if math.prod(lead) != math.prod(batch):
        raise ShapeError(f"{wanted.name} has shape {x.shape}, expected all of the batch shape {batch}, or none of it")
    return Rows(x.address, step)
