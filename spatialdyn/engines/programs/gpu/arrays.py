"""Arrays of other libraries: read by DLPack, and made by the library of the caller's arrays."""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....errors import ShapeError, SpatialDynError

CPU, CUDA = 1, 2  # kinds of devices in DLPack
PLACES = {CPU: "in the memory of the CPU", CUDA: "on a GPU"}
CODES = {0: "i", 1: "u", 2: "f"}  # type codes of DLPack -> kinds of NumPy


class _Tensor(ctypes.Structure):
    """DLTensor of DLPack, the first field of the struct in a capsule."""

    _fields_ = (
        ("data", ctypes.c_void_p), ("kind", ctypes.c_int32), ("number", ctypes.c_int32), ("rank", ctypes.c_int32),
        ("code", ctypes.c_uint8), ("bits", ctypes.c_uint8), ("lanes", ctypes.c_uint16),
        ("shape", ctypes.POINTER(ctypes.c_int64)), ("strides", ctypes.POINTER(ctypes.c_int64)),
        ("offset", ctypes.c_uint64),
    )  # fmt: skip


class View(NamedTuple):
    """An array in the memory of a device.

    strides  in numbers
    dtype    None if NumPy has no such dtype
    keep     the object that owns the memory
    """

    address: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    dtype: np.dtype[Any] | None
    keep: Any

    @property
    def contiguous(self) -> bool:
        """Whether the array is in C order."""
        expected = 1
        for size, stride in zip(reversed(self.shape), reversed(self.strides), strict=True):
            if size != 1 and stride != expected:
                return False
            expected *= size
        return True

    @property
    def extent(self) -> tuple[int, int]:
        """The first address and the end of the memory that the array spans."""
        if 0 in self.shape or self.dtype is None:
            return self.address, self.address
        ends = [stride * (size - 1) for size, stride in zip(self.shape, self.strides, strict=True)]
        low, high = sum(min(x, 0) for x in ends), sum(max(x, 0) for x in ends) + 1
        return self.address + low * self.dtype.itemsize, self.address + high * self.dtype.itemsize


def device_of(name: str, x: Any) -> tuple[int, int]:
    """Kind and number of the device that holds an array. Raises ShapeError if the array does not support DLPack."""
    if not (hasattr(x, "__dlpack__") and hasattr(x, "__dlpack_device__")):
        raise ShapeError(f"{name} is a {type(x).__name__}, expected an array of PyTorch, CuPy or JAX on a GPU")
    kind, number = x.__dlpack_device__()
    return int(kind), int(number)


def read(name: str, x: Any, stream: int | None) -> View:
    """The View of an array by DLPack, ready for work on a stream of its device.

    stream  None on the CPU

    Raises ShapeError naming the argument if its library does not export it.
    """
    try:
        capsule = x.__dlpack__() if stream is None else x.__dlpack__(stream=stream)
    except (BufferError, TypeError, RuntimeError) as error:
        raise ShapeError(f"{name} is not given by {type(x).__name__}: {error}") from error
    address = ctypes.pythonapi.PyCapsule_GetPointer
    address.restype, address.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    tensor = ctypes.cast(address(capsule, b"dltensor"), ctypes.POINTER(_Tensor)).contents
    shape = tuple(tensor.shape[k] for k in range(tensor.rank))
    if tensor.strides:
        strides = tuple(tensor.strides[k] for k in range(tensor.rank))
    else:  # in C order
        strides = tuple(int(np.prod(shape[k + 1 :], dtype=np.int64)) for k in range(len(shape)))
    dtype = None
    if tensor.lanes == 1 and tensor.code in CODES and tensor.bits in (8, 16, 32, 64):
        word = f"{CODES[tensor.code]}{tensor.bits // 8}"
        dtype = None if word == "f1" else np.dtype(word)
    return View((tensor.data or 0) + tensor.offset, shape, strides, dtype, (capsule, x))


class Library(ABC):
    """The library of some arrays: makes arrays on their device, and moves them to and from the host."""

    def __init__(self, like: Any) -> None:
        """The library of the array ``like``; new arrays are on its device."""
        self.like = like

    @property
    @abstractmethod
    def stream(self) -> int:
        """The caller's stream, as a number for the driver."""

    @abstractmethod
    def empty(self, shape: tuple[int, ...], dtype: Any) -> Any:
        """An array whose memory no other array shares."""

    @abstractmethod
    def zero(self) -> Any:
        """An array of one int32, 0."""

    @abstractmethod
    def upload(self, x: NDArray[Any]) -> Any:
        """A copy on the device."""

    @abstractmethod
    def to_host(self, x: Any) -> NDArray[Any]:
        """A copy on the host; waits for the caller's stream."""

    @abstractmethod
    def rows(self, x: Any, n: int, index: NDArray[np.intp]) -> NDArray[Any]:
        """Rows of an array as (n, columns), on the host."""

    @abstractmethod
    def put(self, x: Any, n: int, index: NDArray[np.intp], rows: NDArray[Any]) -> Any:
        """The array with rows written, in place if its library does so."""

    def is_async(self) -> bool:
        """Whether later work on an array waits for the caller's stream."""
        return True


class _Torch(Library):
    @property
    def _torch(self) -> Any:
        return import_module("torch")

    @property
    def stream(self) -> int:
        where = self.like.device
        return int(self._torch.cuda.current_stream(where).cuda_stream) if where.type == "cuda" else 0

    def _dtype(self, dtype: Any) -> Any:
        return getattr(self._torch, np.dtype(dtype).name)

    def empty(self, shape: tuple[int, ...], dtype: Any) -> Any:
        return self._torch.empty(shape, dtype=self._dtype(dtype), device=self.like.device)

    def zero(self) -> Any:
        return self._torch.zeros(1, dtype=self._torch.int32, device=self.like.device)

    def upload(self, x: NDArray[Any]) -> Any:
        return self._torch.from_numpy(np.array(x)).to(self.like.device)

    def to_host(self, x: Any) -> NDArray[Any]:
        return np.asarray(x.detach().cpu().numpy())

    def rows(self, x: Any, n: int, index: NDArray[np.intp]) -> NDArray[Any]:
        return self.to_host(x.detach().reshape(n, -1)[self.upload(index)])

    def put(self, x: Any, n: int, index: NDArray[np.intp], rows: NDArray[Any]) -> Any:
        x.view(n, -1)[self.upload(index)] = self.upload(rows)
        return x


class _Cupy(Library):
    @property
    def _cupy(self) -> Any:
        return import_module("cupy")

    @property
    def stream(self) -> int:
        return int(self._cupy.cuda.get_current_stream().ptr)

    def empty(self, shape: tuple[int, ...], dtype: Any) -> Any:
        with self.like.device:
            return self._cupy.empty(shape, dtype)

    def zero(self) -> Any:
        with self.like.device:
            return self._cupy.zeros(1, np.int32)

    def upload(self, x: NDArray[Any]) -> Any:
        with self.like.device:
            return self._cupy.asarray(x)

    def to_host(self, x: Any) -> NDArray[Any]:
        return np.asarray(self._cupy.asnumpy(x))

    def rows(self, x: Any, n: int, index: NDArray[np.intp]) -> NDArray[Any]:
        return self.to_host(x.reshape((n, -1))[self.upload(index)])

    def put(self, x: Any, n: int, index: NDArray[np.intp], rows: NDArray[Any]) -> Any:
        x.reshape((n, -1))[self.upload(index)] = self.upload(rows)
        return x


class _Jax(Library):
    """JAX, whose arrays are not written in place: a new array is filled before any other function sees it.

    JAX's stream has no public name, so it waits by DLPack, and the driver's stream is waited for before an array is
    returned.
    """

    @property
    def stream(self) -> int:
        return 0

    def _on(self, x: Any) -> Any:
        (where,) = self.like.devices()
        return import_module("jax").device_put(x, where)

    def empty(self, shape: tuple[int, ...], dtype: Any) -> Any:
        return self._on(import_module("jax").numpy.zeros(shape, dtype)).copy().block_until_ready()

    def zero(self) -> Any:
        return self.empty((1,), np.int32)

    def upload(self, x: NDArray[Any]) -> Any:
        return self._on(np.array(x)).copy().block_until_ready()

    def to_host(self, x: Any) -> NDArray[Any]:
        return np.array(x)

    def rows(self, x: Any, n: int, index: NDArray[np.intp]) -> NDArray[Any]:
        return np.array(x.reshape((n, -1))[self.upload(index)])

    def put(self, x: Any, n: int, index: NDArray[np.intp], rows: NDArray[Any]) -> Any:
        return x.reshape((n, -1)).at[self.upload(index)].set(self.upload(rows)).reshape(x.shape)

    def is_async(self) -> bool:
        return False


class _Numpy(Library):
    """NumPy, for a grid of threads on the host."""

    stream = 0

    def empty(self, shape: tuple[int, ...], dtype: Any) -> Any:
        return np.empty(shape, dtype)

    def zero(self) -> Any:
        return np.zeros(1, np.int32)

    def upload(self, x: NDArray[Any]) -> Any:
        return np.array(x)

    def to_host(self, x: Any) -> NDArray[Any]:
        return np.array(x)

    def rows(self, x: Any, n: int, index: NDArray[np.intp]) -> NDArray[Any]:
        return np.asarray(x.reshape((n, -1))[index])

    def put(self, x: Any, n: int, index: NDArray[np.intp], rows: NDArray[Any]) -> Any:
        x.reshape((n, -1))[index] = rows
        return x


LIBRARIES: dict[str, type[Library]] = {
    "torch": _Torch,
    "cupy": _Cupy,
    "jax": _Jax,
    "jaxlib": _Jax,
    "numpy": _Numpy,
}


def library_of(names: Sequence[str], arrays: Sequence[Any], kind: int) -> tuple[Library, int]:
    """The library of some arrays on devices of a kind, and the number of their device.

    Raises ShapeError naming an array that is elsewhere; SpatialDynError for arrays of several libraries or devices, or
    of an unknown library.
    """
    found = [device_of(name, x) for name, x in zip(names, arrays, strict=True)]
    for name, x, (where, _) in zip(names, arrays, found, strict=True):
        if where != kind:
            raise ShapeError(
                f"{name} is a {type(x).__name__} {PLACES.get(where, f'on a device of kind {where}')}, "
                f'expected one {PLACES[kind]}, as device="cuda" says'
            )
    roots = [type(x).__module__.partition(".")[0] for x in arrays]
    known = [LIBRARIES.get(root) for root in roots]
    for name, root, one in zip(names, roots, known, strict=True):
        if one is None:
            raise SpatialDynError(f"{name} is of {root}, expected an array of PyTorch, CuPy or JAX")
    first, (_, number) = roots[0], found[0]
    for name, root, place in zip(names, roots, found, strict=True):
        if known[roots.index(root)] is not known[0] or place != found[0]:
            raise SpatialDynError(
                f"{name} is of {root} on device {place[1]}, expected {first} on device {number} as {names[0]}"
            )
    made = known[0]
    assert made is not None
    return made(arrays[0]), number
