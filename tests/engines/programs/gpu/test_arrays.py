"""Arrays by DLPack, of NumPy, PyTorch and JAX in the memory of the CPU, which stands for a GPU's."""

from __future__ import annotations

from typing import Any

import fake_gpu
import numpy as np
import pytest

from spatialdyn.engines.programs.gpu.arrays import CPU, CUDA, LIBRARIES, View, device_of, library_of, read
from spatialdyn.errors import ShapeError, SpatialDynError

DTYPES = [np.float64, np.float32, np.int64, np.int32, np.uint8]
torch: Any
jax: Any


@pytest.fixture(scope="module", autouse=True)
def libraries() -> None:
    """Import both for the tests alone: it takes seconds in each process that collects them."""
    global torch, jax
    torch, jax = pytest.importorskip("torch"), pytest.importorskip("jax")


@pytest.mark.parametrize("dtype", DTYPES)
def test_address_shape_strides_and_dtype_are_read(dtype: Any) -> None:
    x = np.arange(24, dtype=dtype).reshape(2, 3, 4)
    for y in (x, x[:, ::2], x[1:, :, 1:3], x.transpose(2, 0, 1), x[0, 0, 0:0]):
        for given in (y, torch.from_numpy(y)):
            view = read("x", given, None)
            assert view.address == y.ctypes.data or not y.size
            assert view.shape == y.shape
            assert all(a == b // y.itemsize for a, b, n in zip(view.strides, y.strides, y.shape, strict=True) if n > 1)
            assert view.dtype == dtype
            assert view.contiguous == y.flags.c_contiguous or not y.size


def test_arrays_of_jax_are_read() -> None:
    x = jax.numpy.arange(6.0, dtype="float32").reshape(2, 3)
    view = read("x", x, None)
    assert (view.address, view.shape, view.strides, view.dtype) == (
        x.unsafe_buffer_pointer(),
        (2, 3),
        (3, 1),
        np.float32,
    )


def test_the_extent_of_an_array_is_what_its_strides_span() -> None:
    x = np.zeros((4, 5))
    low = x.ctypes.data
    assert read("x", x, None).extent == (low, low + 160)
    assert read("x", x[:, 1:3], None).extent == (low + 8, low + 8 * 18)
    assert read("x", x[:0], None).extent[0] == read("x", x[:0], None).extent[1]
    assert View(800, (3,), (-2,), np.dtype(float), None).extent == (800 - 32, 808)


def test_what_has_no_dlpack_or_refuses_it_is_named() -> None:
    with pytest.raises(ShapeError, match="q is a list, expected an array of PyTorch, CuPy or JAX on a GPU"):
        device_of("q", [1.0])
    with pytest.raises(ShapeError, match=r"q is not given by Tensor: .*requires? grad"):
        read("q", torch.ones(2, requires_grad=True), None)


@pytest.mark.parametrize("name", ["numpy", "torch", "jax"])
def test_a_library_makes_and_moves_arrays_of_its_own(name: str) -> None:
    made = {"numpy": np.array, "torch": torch.tensor, "jax": jax.numpy.array}[name](
        np.float32([[1, 2], [3, 4], [5, 6]])
    )
    library = LIBRARIES[name](made)
    empty = library.empty((3, 2), np.float32)
    assert type(empty) is type(made)
    assert read("x", empty, None).shape == (3, 2)
    assert read("x", empty, None).dtype == np.float32
    assert library.to_host(library.zero()).tolist() == [0]
    assert library.stream == 0
    index = np.array([0, 2])
    np.testing.assert_array_equal(library.rows(made, 3, index), [[1, 2], [5, 6]])
    after = library.put(made, 3, index, np.float32([[7, 8], [9, 0]]))
    np.testing.assert_array_equal(library.to_host(after), [[7, 8], [3, 4], [9, 0]])
    assert (after is made) == (name != "jax")
    copy = library.upload(np.ones(3, np.float32))
    assert type(copy) is type(made)


def test_an_empty_array_of_jax_shares_its_memory_with_no_other() -> None:
    library = LIBRARIES["jax"](jax.numpy.ones(1))
    made = [library.empty((5, 3), np.float32) for _ in range(4)]
    assert len({x.unsafe_buffer_pointer() for x in made}) == 4


def test_arrays_of_one_library_on_one_device_are_expected() -> None:
    x, y, there = np.ones(2), torch.ones(2), fake_gpu.Array(np.ones(2))
    library, number = library_of(["q", "v"], [y, y], CPU)
    assert (type(library), number) == (LIBRARIES["torch"], 0)
    with pytest.raises(SpatialDynError, match="v is of torch on device 0, expected numpy on device 0 as q"):
        library_of(["q", "v"], [x, y], CPU)
    with pytest.raises(
        ShapeError, match=r'v is a ndarray in the memory of the CPU, expected one on a GPU, as device="cuda"'
    ):
        library_of(["q", "v"], [there, x], CUDA)
    odd = type("Odd", (fake_gpu.Array,), {"__module__": "odd.arrays"})(np.ones(2))
    with pytest.raises(SpatialDynError, match="q is of odd, expected an array of PyTorch, CuPy or JAX"):
        library_of(["q"], [odd], CUDA)
