"""What is asked of CUDA's driver, by one that is not there: images, orders, contexts, launches, errors."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import fake_gpu
import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.gpu import cuda
from spatialdyn.engines.programs.gpu.device import Loaded
from spatialdyn.engines.programs.gpu.kernel_text import BLOCK
from spatialdyn.errors import SpatialDynError

N = BLOCK + 3
PROGRAMS = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: there are no programs")


@pytest.fixture
def states() -> list[Any]:
    """q, v and a of some samples."""
    return [fake_gpu.Array(x) for x in np.random.default_rng(0).normal(size=(3, N, 2))]


@PROGRAMS
def test_a_launch_is_of_whole_blocks_on_the_callers_stream(monkeypatch: pytest.MonkeyPatch, states: list[Any]) -> None:
    driver, model = fake_gpu.install(monkeypatch), sd.load_urdf("two_link")
    k = sd.specialize(model, sd.rnea, device="cuda")
    for check in (True, False):
        tau = k(*states, check=check)  # type: ignore[call-arg]
        np.testing.assert_array_equal(tau.x, sd.specialize(model, sd.rnea)(*(x.x for x in states)))
        assert driver.waits == 1  # of the check
    assert driver.launches == 2 * [(driver.images[0], 2, BLOCK, fake_gpu.STREAM)]
    assert {*fake_gpu.Array.streams} == {fake_gpu.STREAM}  # on which the arrays are ready
    assert driver.stack == []


@PROGRAMS
@pytest.mark.parametrize(("spills", "images", "kept"), [((0, 9), 1, 0), ((8, 4), 2, 1), ((8, 8), 2, 0)])
def test_the_order_that_spills_less_is_kept(
    monkeypatch: pytest.MonkeyPatch, states: list[Any], spills: tuple[int, ...], images: int, kept: int
) -> None:
    driver = fake_gpu.install(monkeypatch, spills)
    sd.specialize(sd.load_urdf("two_link"), sd.rnea, device="cuda")(*states)
    assert len(driver.images) == images
    assert driver.launches[0][0] == driver.images[kept]


@PROGRAMS
def test_a_kernel_is_loaded_once(monkeypatch: pytest.MonkeyPatch, states: list[Any]) -> None:
    driver = fake_gpu.install(monkeypatch)
    k = sd.specialize(sd.load_urdf("two_link"), sd.rnea, device="cuda")
    k(*states)
    k(*states)
    assert len(driver.images) == 1


@PROGRAMS
def test_an_error_of_the_driver_names_its_call_and_leaves_the_context(
    monkeypatch: pytest.MonkeyPatch, states: list[Any]
) -> None:
    driver = fake_gpu.install(monkeypatch)
    k = sd.specialize(sd.load_urdf("two_link"), sd.rnea, device="cuda")
    monkeypatch.setattr(driver, "cuLaunchKernel", lambda *given: (700,), raising=False)
    with pytest.raises(SpatialDynError, match="cuLaunchKernel of the CUDA driver failed: 700"):
        k(*states)
    assert driver.stack == []


def test_the_name_of_a_gpu_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    fake_gpu.install(monkeypatch)
    assert cuda.Cuda().name(0) == "no GPU"


def test_bindings_that_are_missing_are_named(monkeypatch: pytest.MonkeyPatch, states: list[Any]) -> None:
    fake_gpu.install(monkeypatch)
    monkeypatch.setitem(sys.modules, "cuda.bindings.driver", None)  # an import of it fails
    with pytest.raises(SpatialDynError, match=r"cuda-bindings is not installed; pip install cuda-bindings$"):
        cuda.Cuda().wait(0, 0)


def test_a_driver_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(flags: int) -> Any:
        raise RuntimeError("no libcuda")

    module = ModuleType("cuda.bindings.driver")
    module.cuInit = missing  # type: ignore[attr-defined]
    fake_gpu.install(monkeypatch)
    monkeypatch.setitem(sys.modules, "cuda.bindings.driver", module)
    with pytest.raises(SpatialDynError, match="expected a machine with a GPU of NVIDIA and its driver: no libcuda"):
        cuda.Cuda().launch(Loaded(b"", 0, 0), 0, 1, [], 0)
