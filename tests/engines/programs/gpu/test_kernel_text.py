"""Kernels on a grid of threads on the host: the bits of lanes, the samples that lanes reject, strides, the last block.

The text that is run is the one that becomes PTX, but for the number of a thread.
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np
import pytest
from inputs import options, random_inputs, sorted_inputs
from numpy.typing import NDArray
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.algebra import scalars
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.compiled.numba_kernels import variant
from spatialdyn.engines.polynomials import MAX_ANGLE
from spatialdyn.engines.programs.gpu import kernel_text
from spatialdyn.engines.programs.gpu.device import HostGrid
from spatialdyn.engines.programs.gpu.gpu_kernel import GpuKernel, Rows
from spatialdyn.engines.programs.gpu.kernel_text import BLOCK, HOST, NVPTX, batch_text
from spatialdyn.engines.programs.gpu.thread_writer import MARGIN
from spatialdyn.engines.programs.llvm import host_cpu
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.record.kernel_layout import KernelLayout
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Tape
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.recursions import SPECS

Array = NDArray[Any]
N = 2 * BLOCK + 45  # two whole blocks and a part of one
SENTINEL = 7.25  # in memory that must not be written
TRACED = [name for name, spec in SPECS.items() if spec.traceable]
GRID = HostGrid()
PROGRAMS = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: there are no programs")
fused = pytest.mark.skipif(not host_cpu.host()[3], reason="lanes without fused multiply-add round otherwise")


class Found(NamedTuple):
    """What a kernel wrote."""

    valid: NDArray[np.bool_]
    outputs: list[Array]
    rejected: int


def robot(name: str) -> sd.Model:
    """A robot by name, or a small one of quaternions and pairs."""
    if name == "floating":
        return random_tree(seed=3, n_joints=2, kinds=["spherical", "continuous"], floating=True).model
    return sd.load_urdf(name)


def recorded(model: sd.Model, call: str, dtype: Any) -> tuple[Program, KernelLayout]:
    """The program of a call."""
    made: Any = sd.specialize(model, getattr(sd, call), dtype, device="cuda", **options(model, SPECS[call]))
    program, layout = made._recorded
    return program, layout


def samples(model: sd.Model, call: str, dtype: Any, n: int = N) -> list[Array]:
    """Inputs, and among them some that are not finite, far, zero or off unit norm."""
    spec = variant(SPECS[call], frozenset())
    rng, k = np.random.default_rng(2), iter(range(1, n, 2))
    given = [np.array(x, dtype).reshape(n, -1) for x in random_inputs(model, spec, 1, (n,))]
    names = [x.name for x in sorted_inputs(spec)]
    given = [given[names.index(x.name)] for x in spec.present if not x.static]
    for x in given:
        for bad in (np.nan, np.inf, -np.inf, 1.1 * MAX_ANGLE, -3e30, 1e38, 1e-30):
            x[next(k), rng.integers(x.shape[1])] = bad
        x[next(k)] = 0.0
        x[next(k)] *= dtype(1.0 + 1e-5)
    return given


def on_threads(kernel: GpuKernel, inputs: list[Array], n: int = N) -> Found:
    """Outputs of n threads, and memory behind them that must not be written."""
    loaded = kernel.layout.outputs
    outputs = [np.full((n + BLOCK, len(places)), SENTINEL, kernel.dtype) for places in loaded]
    flags, count = np.full(n + BLOCK, 9, np.uint8), np.full(1, 1000, np.int32)
    rows = [Rows(x.ctypes.data, x.strides[0] // x.itemsize if len(x) > 1 else 0) for x in inputs]
    addresses = [x.ctypes.data for x in outputs]
    kernel.batch(GRID, 0, n, rows, addresses, flags.ctypes.data, count.ctypes.data, 0)
    assert all((x[n:] == SENTINEL).all() for x in outputs)
    assert (flags[n:] == 9).all()
    assert set(flags[:n].tolist()) <= {0, 1}
    return Found(flags[:n] == 1, [x[:n] for x in outputs], int(count[0]) - 1000)


def check(name: str, call: str, dtype: Any) -> None:
    """Threads against lanes, by each order of lines."""
    model = robot(name)
    program, layout = recorded(model, call, dtype)
    inputs = samples(model, call, dtype)
    wanted = [np.empty((N, len(places)), dtype) for places in layout.outputs]
    left = batch_kernels.compiled(program, layout, dtype)(inputs, wanted)
    valid = np.ones(N, bool)
    valid[left] = False
    kernel = GpuKernel(program, layout, dtype)
    for order in list(kernel.orders):
        kernel.orders = [order]
        kernel._loaded.clear()
        found = on_threads(kernel, inputs)
        np.testing.assert_array_equal(found.valid, valid)
        assert found.rejected == (~valid).sum() > 0
        for x, y in zip(found.outputs, wanted, strict=True):
            assert x[valid].tobytes() == y[valid].tobytes()
            assert np.isnan(x[~valid]).all()


QUICK = [
    ("floating", "rnea", np.float64), ("floating", "aba", np.float32), ("ur5", "crba", np.float64),
    ("floating", "integrate", np.float64), ("ur5", "rnea", np.float32), ("two_link", "coriolis_matrix", np.float64),
    ("panda", "minverse", np.float64),  # with pivots that are too small
]  # fmt: skip
TURNS = "floating", "two_link", "floating", "panda"
ALL = [  # each call on one of the robots in one of the precisions, in turn: one in four on the large one
    (TURNS[k % 4], call, (np.float64, np.float32)[(k // 4 + k // 2) % 2]) for k, call in enumerate(TRACED)
]


@PROGRAMS
@fused
@pytest.mark.parametrize(("name", "call", "dtype"), slow_but(QUICK, [*QUICK, *(x for x in ALL if x not in QUICK)]))
def test_threads_have_the_bits_of_lanes_and_reject_the_same(name: str, call: str, dtype: Any) -> None:
    model = robot(name)
    if not (sorted_inputs(variant(SPECS[call], frozenset())) and recording.fits((SPECS[call],), model.bodies)):
        pytest.skip("no program, or no input")
    check(name, call, dtype)


def program_of(function: Any, inputs: tuple[int, ...], **layout: Any) -> tuple[Program, KernelLayout]:
    """The program of a function of Numbers, with one output array."""
    tape = Tape()
    results = list(function(*(tape.input(k) for k in range(sum(inputs)))))
    whole = {"outputs": (tuple(range(len(results))),)} | layout
    return Program(tape, results, sum(inputs)), KernelLayout(inputs, **whole)


@pytest.mark.parametrize("n", [1, BLOCK - 1, BLOCK, BLOCK + 1])
def test_the_last_block_ends_with_the_last_sample(n: int) -> None:
    kernel = GpuKernel(*program_of(lambda a, b: [a + b], (1, 1)), np.float64)
    x = np.arange(2.0 * n).reshape(2, n, 1)
    found = on_threads(kernel, [x[0], x[1]], n)
    np.testing.assert_array_equal(found.outputs[0], x[0] + x[1])
    assert found.valid.all()


def test_rows_may_lie_apart_or_be_one_for_all() -> None:
    kernel = GpuKernel(*program_of(lambda a, b, c: [a + b, b + c], (2, 1)), np.float64)
    wide = np.random.default_rng(0).normal(size=(3 * N, 5))
    apart, one = wide[::3, 1:3], wide[:1, 4:]
    found = on_threads(kernel, [apart, one])
    np.testing.assert_array_equal(found.outputs[0], np.stack([apart[:, 0] + apart[:, 1], apart[:, 1] + one[0, 0]], 1))


def test_inputs_are_loaded_where_they_are_read_and_results_stored_where_they_are_computed() -> None:
    def function(*x: Any) -> list[Any]:
        results = []
        for a, b in zip(x[::2], x[1::2], strict=True):
            results.append(a * b)
        return results

    text = batch_text(*program_of(function, (8,)), np.float64, target=HOST)
    kinds = re.findall(r"(load <1|store <1|fmul) ", text)
    assert "".join(kinds[:20]) == "load <1load <1fmulstore <1" * 4 + "store <1" * 4  # the last: NaN if rejected


def test_a_column_that_no_line_reads_is_checked() -> None:
    kernel = GpuKernel(*program_of(lambda a, b, c: [a + a], (3,)), np.float64)
    x = np.ones((N, 3))
    x[4, 2] = np.nan
    assert np.flatnonzero(~on_threads(kernel, [x]).valid).tolist() == [4]


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_threads_reject_a_little_more_where_squares_are_summed(dtype: Any) -> None:
    kernel = GpuKernel(*program_of(lambda a: [scalars.sin(a)], (1,)), dtype)
    margin = MARGIN["double" if dtype == np.float64 else "float"]
    inside, edge = MAX_ANGLE * (1.0 - margin), MAX_ANGLE * (1.0 - 0.1 * margin)
    x = np.array([[inside], [edge], [1.01 * MAX_ANGLE]], dtype)
    assert on_threads(kernel, [x], 3).valid.tolist() == [True, False, False]


@PROGRAMS
def test_more_numbers_than_constant_memory_holds_lie_in_global_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    given = recorded(robot("two_link"), "rnea", np.float64)
    inputs = samples(robot("two_link"), "rnea", np.float64)
    whole = on_threads(GpuKernel(*given, np.float64), inputs)
    assert "@numbers = internal addrspace(4)" in batch_text(*given, np.float64, target=NVPTX)
    monkeypatch.setattr(kernel_text, "CONSTANT_BYTES", 8)
    assert "@numbers = internal addrspace(1)" in batch_text(*given, np.float64, target=NVPTX)
    again = on_threads(GpuKernel(*given, np.float64), inputs)
    assert [x.tobytes() for x in again.outputs] == [x.tobytes() for x in whole.outputs]
