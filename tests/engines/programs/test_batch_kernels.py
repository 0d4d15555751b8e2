"""Batches on lanes agree with the table kernel, for any size, layout, number of threads and other samples."""

from __future__ import annotations

import os
import pickle
import threading
import tracemalloc
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from inputs import (
    EPS,
    MAIN_CALLS,
    empty_memory,
    kernel_inputs,
    options,
    public,
    random_inputs,
    run_python,
    sorted_inputs,
)
from numpy.typing import NDArray
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.calls import dynamics
from spatialdyn.engines import by_table_kernel, run
from spatialdyn.engines.compiled import disk_cache, numba_kernels
from spatialdyn.engines.programs.llvm import host_cpu, simd
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.engines.programs.run.tiered_program import TieredProgram
from spatialdyn.model.robot import Mimic
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import Spec
from spatialdyn.urdf.load import example_robots

pytestmark = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: every sample goes the plain way")

Array = NDArray[np.float64]
Parts = list[tuple[int, int]]  # samples and threads of batches
B = 512  # the least batch that runs on lanes
FEW = 16  # valid samples beside those that a program rejects
ROUNDING = 64 * EPS  # of the largest entry of a sample: both round the same equations in another order
SOLVED = 4.0  # times the table kernel's error, plus ROUNDING, for results of a solve
BITS = 140  # of the exact values
CALLS = [name for name, spec in SPECS.items() if sorted_inputs(spec)]
MEGABYTE = 2**20


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Restore the number of threads and the choice of program after a test."""
    forget_choices()
    yield
    sd.set_num_threads(1)
    forget_choices()


def forget_choices() -> None:
    """Empty the caches that choose between program and table kernel."""
    run.forget_programs()
    dynamics.plan_of.cache_clear()


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """No program in memory or on disk; returns the folder of the disk cache."""
    monkeypatch.delenv(disk_cache.VARIABLE, raising=False)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    empty_memory(monkeypatch)
    return tmp_path / "spatialdyn"


@pytest.fixture
def parts(monkeypatch: pytest.MonkeyPatch) -> Parts:
    """Any batch of more than a tile runs over threads; returns a list of the samples and the threads of each."""
    sizes: Parts = []
    run = batch_kernels.Kernel._part

    def counted(self: Any, n: int, arguments: Any, threads: int) -> Any:
        sizes.append((n, threads))
        return run(self, n, arguments, threads)

    monkeypatch.setattr(batch_kernels.Kernel, "_part", counted)
    monkeypatch.setattr(batch_kernels, "THREAD_BYTES", 1)
    empty_memory(monkeypatch)  # read at load
    return sizes


def cut(parts: Parts, n: int, threads: int, dtype: Any = np.float64) -> bool:
    """Whether the last call shared n samples among the threads, as far as there are tiles."""
    shared = parts.copy()
    parts.clear()
    return shared == [(n, min(threads, -(-n // host_cpu.lanes_of(dtype))))]


@pytest.fixture(scope="module", params=["fixed", "floating, cos_sin"])
def model(request: pytest.FixtureRequest) -> sd.Model:
    """A tree with every kind of joint."""
    floating = request.param != "fixed"
    made = random_tree(108, 6, floating=floating, continuous="cos_sin" if floating else "angle").model
    assert len({j.kind for j in made.joints[1:]}) == 6
    return made


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    """Five joints that turn and slide."""
    return random_tree(2, 5, ["revolute", "prismatic", "continuous"]).model


def untraced(model: sd.Model, spec: Spec, values: list[Any], **more: Any) -> Any:
    """The public call by the table kernel."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "program", lambda *arguments: None)
        patch.setattr(dynamics, "plan_of", dynamics.plan_of.__wrapped__)
        return public(model, spec, values, **more)


def one_by_one(model: sd.Model, spec: Spec, values: list[Any], samples: Iterable[int]) -> Any:
    """Samples of it, each alone: of the bits of the batch, by the kernel of one sample, which other files need too."""
    return np.concatenate([untraced(model, spec, [x[k : k + 1] for x in values]) for k in samples])


def in_numpy(model: sd.Model, spec: Spec, values: list[Any]) -> Any:
    """The public call by its recursion in NumPy, to which ``test_numba_kernels`` holds the table kernel."""

    def compute(spec: Spec, table: Any, inputs: Any, static: Any, out: Any, seen: bool = True) -> Any:
        return by_table_kernel.run_in_numpy(spec, table, inputs, static, out, np.arange(len(out)), seen=seen)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(by_table_kernel, "run_table_kernel", compute)
        return untraced(model, spec, values)


def on_lanes(model: sd.Model, spec: Spec, values: list[Any], **more: Any) -> Any:
    """The public call on lanes at any size; fails if it runs otherwise."""
    seen = []
    run = batch_kernels.Kernel.__call__

    def counted(self: Any, *arguments: Any) -> Any:
        samples = run(self, *arguments)
        if samples is not None:  # None: arrays of another size, order or dtype
            seen.append(samples)
        return samples

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TieredProgram, "batch", lambda self, n, stream=False: self.compiled(one=False, stream=stream))
        patch.setattr(batch_kernels.Kernel, "__call__", counted)
        found = public(model, spec, values, **more)
    assert len(seen) == 1
    return found


def scaled(x: Any, y: Any, axes: int) -> float:
    """The largest difference of a sample, of its largest entry or 1; ``axes`` are those of one sample."""
    x, y = np.asarray(x), np.asarray(y)
    assert x.shape == y.shape
    core = tuple(range(x.ndim - axes, x.ndim))
    error = abs(x - y).max(axis=core, initial=0.0) / np.maximum(abs(y).max(axis=core, initial=0.0), 1.0)
    return float(np.max(error, initial=0.0))


def bare(name: str) -> Spec:
    """A call without its optional inputs."""
    return numba_kernels.variant(SPECS[name], frozenset())


# --- agreement with the table kernel --------------------------------------------------------------------


TREES = ("fixed", "floating, cos_sin")
OF_PAIRS = {  # calls that have a case of their own for (cos, sin), and the three that all know
    *(name for name in CALLS
    if SPECS[name].recursion.__module__.startswith("spatialdyn.recursions.coordinates.configuration")), "rnea", "crba",
    "aba",
}  # fmt: skip
AT_ONCE = [(tree, name) for tree in TREES for name in CALLS if name in (MAIN_CALLS if tree == "fixed" else OF_PAIRS)]
OTHERS = [name for name in CALLS if name not in MAIN_CALLS and name not in OF_PAIRS]
IN_TURN = [*((TREES[0], name) for name in sorted(OF_PAIRS)), *((TREES[k % 2], name) for k, name in enumerate(OTHERS))]
EACH = [*AT_ONCE, *(x for x in IN_TURN if x not in AT_ONCE)]  # call, on one of the trees or on both


@pytest.mark.parametrize(("model", "name"), slow_but(AT_ONCE, EACH), indirect=["model"])
def test_lanes_equal_the_untraced_call(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    static = kernel_inputs(model, spec, [None] * len(sorted_inputs(spec)))  # type: ignore[list-item]
    static = [value for x, value in zip(spec.present, static, strict=True) if x.static]
    values = random_inputs(model, spec, batch=(B + 3,))
    if not recording.fits((spec,), model.bodies):
        assert not spec.traceable
        np.testing.assert_array_equal(public(model, spec, values), untraced(model, spec, values))
        return
    wanted = (in_numpy if name in MAIN_CALLS or name in OF_PAIRS else untraced)(model, spec, values)
    found = on_lanes(model, spec, values)
    if not spec.pivots:  # a single number is a sum that may cancel: measured against the largest of the batch
        assert scaled(found, wanted, len(spec.output.shape) or 1) <= ROUNDING


def exact(model: sd.Model, spec: Spec, values: list[Array], sample: int) -> Array:
    """The true result, rounded to float64 at the end."""
    return np.asarray(sd.exact(model, dynamics.calls[spec.name], BITS)(*(v[sample] for v in values)).astype(np.float64))


@pytest.mark.parametrize("name", ["aba", "minverse"])
def test_what_is_solved_for_is_as_near_the_exact_value(model: sd.Model, name: str) -> None:
    spec = bare(name)
    values = random_inputs(model, spec, seed=7, batch=(B,))
    few = range(12)
    wanted = np.array([exact(model, spec, values, k) for k in few])
    axes = len(spec.output.shape)
    found = on_lanes(model, spec, values)[: len(few)], one_by_one(model, spec, values, few)
    errors = [scaled(x, wanted, axes) for x in found]
    assert errors[0] <= SOLVED * errors[1] + ROUNDING


def test_carriers_without_mass_lose_no_digits() -> None:
    """Three axes through a point, as at each joint of this human, whose bodies between have no inertia."""
    path = next(path for path in example_robots() if path.name == "human.urdf")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        human = sd.load_urdf(path, root="floating")
    spec = bare("aba")
    values = random_inputs(human, spec, seed=4, batch=(B,))
    few = range(4)
    wanted = np.array([exact(human, spec, values, k) for k in few])
    found = on_lanes(human, spec, values)[: len(few)], one_by_one(human, spec, values, few)
    errors = [scaled(x, wanted, 1) for x in found]
    assert errors[0] <= SOLVED * errors[1] + ROUNDING


# --- every size and form --------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [*range(18), *range(B, B + 18)])
def test_every_tail_is_right(arm: sd.Model, n: int) -> None:
    """Inside a larger array: no entry before or behind the results is written."""
    for name in ("rnea", "crba", "kinetic_energy"):
        spec = bare(name)
        values = random_inputs(arm, spec, seed=n, batch=(n,))
        wanted = untraced(arm, spec, values)
        room = np.full((n + 8, *wanted.shape[1:]), np.nan)
        out = room[4 : n + 4]
        if n:
            found = on_lanes(arm, spec, values, out=out)
            assert found is out
        else:
            public(arm, spec, values, out=out)
        assert scaled(out, wanted, len(spec.output.shape)) <= ROUNDING
        assert np.isnan(room[:4]).all()
        assert np.isnan(room[n + 4 :]).all()


@pytest.mark.parametrize("shape", [(3, 400), (2, 1, 300), (600, 1), (1, 513)])
def test_batches_of_more_axes_are_the_flat_one(arm: sd.Model, shape: tuple[int, ...]) -> None:
    spec = SPECS["rnea"]
    values = random_inputs(arm, spec, batch=shape)
    found = on_lanes(arm, spec, values)
    flat = on_lanes(arm, spec, [x.reshape(-1, *x.shape[len(shape) :]) for x in values])
    np.testing.assert_array_equal(found.reshape(flat.shape), flat)


@pytest.mark.parametrize("threads", [1, 3])
def test_an_input_of_one_sample_serves_all_as_its_copies_do(arm: sd.Model, parts: Parts, threads: int) -> None:
    sd.set_num_threads(threads)
    spec, n = bare("rnea"), 4098
    q, v, a = random_inputs(arm, spec, batch=(n,))
    for some in ([q, v[7], a], [q, v[7:8], a[3]], [q[0], v, a], [q.reshape(2, n // 2, -1), v[: n // 2], a[:1]]):
        batch = np.broadcast_shapes(*(x.shape[:-1] for x in some))
        copies = [np.broadcast_to(x, (*batch, arm.nv)).copy() for x in some]
        found = on_lanes(arm, spec, some)
        assert cut(parts, n, threads)
        sd.set_num_threads(1)
        np.testing.assert_array_equal(found, on_lanes(arm, spec, copies))
        sd.set_num_threads(threads)
        parts.clear()


def test_the_form_of_an_input_changes_no_bit(arm: sd.Model) -> None:
    spec = bare("rnea")
    values = random_inputs(arm, spec, batch=(600,))
    wanted = on_lanes(arm, spec, values)
    forms = [
        np.asfortranarray,
        lambda x: np.repeat(x, 2, axis=0)[::2],
        lambda x: np.repeat(x, 2, axis=1)[:, ::2],
        lambda x: x[::-1].copy()[::-1],
        lambda x: x.astype(x.dtype.newbyteorder()),
        lambda x: np.frombuffer(b"?" + x.tobytes(), np.uint8)[1:].view(float).reshape(x.shape),
        lambda x: x.tolist(),
    ]
    for form in forms:
        np.testing.assert_array_equal(on_lanes(arm, spec, [form(x) for x in values]), wanted)
    before = [x.copy() for x in values]
    for x in values:
        x.flags.writeable = False
    np.testing.assert_array_equal(on_lanes(arm, spec, values), wanted)
    for x, y in zip(values, before, strict=True):
        np.testing.assert_array_equal(x, y)


def test_results_go_to_an_array_at_any_address(arm: sd.Model) -> None:
    """Eight bytes off a vector's alignment, and at sizes at which results are streamed."""
    for n in (B + 1, 40000):
        for name in ("rnea", "crba"):
            spec = bare(name)
            values = random_inputs(arm, spec, batch=(n,))
            wanted = untraced(arm, spec, values)
            for offset in range(0, 72, 8):
                room = np.zeros(wanted.nbytes + 160, np.uint8)
                first = -room.ctypes.data % 64 + offset
                out = room[first : first + wanted.nbytes].view(np.float64).reshape(wanted.shape)
                public(arm, spec, values, out=out)
                assert scaled(out, wanted, len(spec.output.shape)) <= ROUNDING
                assert not room[:first].any()
                assert not room[first + wanted.nbytes :].any()
                if n > B + 1 and offset:
                    break


# --- the same to the bit --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rnea", "crba", "aba", "forward_kinematics", "kinetic_energy"])
def test_a_sample_has_the_same_bits_in_any_batch_on_any_number_of_threads(
    model: sd.Model, parts: Parts, name: str
) -> None:
    spec, rng = bare(name), np.random.default_rng(1)
    values = random_inputs(model, spec, batch=(2003,))
    wanted = on_lanes(model, spec, values)
    parts.clear()
    fixed = [slice(1, 1500), slice(5, 5 + B), slice(None, None, -1), slice(0, 2000, 3), slice(70, 71)]
    for threads in (1, 2, 3, 7):
        sd.set_num_threads(threads)
        np.testing.assert_array_equal(on_lanes(model, spec, values), wanted)
        assert cut(parts, 2003, threads)
        drawn = [slice(*sorted(pair)) for pair in rng.choice(2003, (6, 2), replace=False).tolist()]
        for some in (*fixed, *drawn):
            np.testing.assert_array_equal(on_lanes(model, spec, [x[some] for x in values]), wanted[some])
            assert cut(parts, len(wanted[some]), threads)


@pytest.mark.parametrize("threads", [2, 3])
@pytest.mark.parametrize("n", [1, 7, 8, 9, 16, 17, 33, 701])
def test_threads_write_their_own_part_of_out_and_nothing_else(
    arm: sd.Model, parts: Parts, n: int, threads: int
) -> None:
    for name in ("rnea", "crba"):
        spec = bare(name)
        values = random_inputs(arm, spec, seed=n, batch=(n,))
        wanted = on_lanes(arm, spec, values)
        room = np.full((n + 8, *wanted.shape[1:]), np.nan)
        out = room[4 : n + 4]
        parts.clear()
        sd.set_num_threads(threads)
        assert on_lanes(arm, spec, values, out=out) is out
        assert cut(parts, n, threads)
        sd.set_num_threads(1)
        np.testing.assert_array_equal(out, wanted)
        assert np.isnan(room[:4]).all()
        assert np.isnan(room[n + 4 :]).all()


@pytest.mark.parametrize("shape", [(1003,), (17, 59)])
def test_forces_of_threads_are_those_of_one(model: sd.Model, parts: Parts, shape: tuple[int, ...]) -> None:
    """An optional input with two axes a sample; of one sample for all; NaN in a part behind the first."""
    spec = SPECS["rnea"]
    values = random_inputs(model, spec, batch=shape)
    assert [x.name for x in sorted_inputs(spec)][-1] == "fext"
    values[-1].reshape(1003, -1)[[700, 1002], 8] = np.nan
    for some in (values, [*values[:-1], values[-1].reshape(1003, -1, 6)[5]]):
        sd.set_num_threads(1)
        wanted = on_lanes(model, spec, some)
        parts.clear()
        sd.set_num_threads(3)
        np.testing.assert_array_equal(on_lanes(model, spec, some), wanted)
        assert cut(parts, 1003, 3)


def test_an_array_that_overlaps_another_threads_part_is_refused(arm: sd.Model, parts: Parts) -> None:
    """The first part's results would overwrite the second part's inputs."""
    sd.set_num_threads(2)
    kernel, n = rnea_kernel(arm), 1024
    room = np.random.default_rng(0).normal(size=(2 * n, arm.nv))
    before, v = room.copy(), np.ones((n, arm.nv))
    for first in (0, n // 2, n // 2 + 1, n - 1):
        assert kernel([room[first : first + n], v, v], [room[:n]]) is None
        assert kernel([room[:n], v, v], [room[first : first + n]]) is None
        with pytest.raises(sd.ShapeError, match="out overlaps q in memory"):
            sd.rnea(arm, room[first : first + n], v, v, out=room[:n])
        np.testing.assert_array_equal(room, before)


@pytest.mark.parametrize("n", [0, -3, 1.5, True, "2", None])
def test_what_is_no_number_of_threads_is_refused(n: Any) -> None:
    with pytest.raises(sd.SpatialDynError, match=f"n is {n!r}, expected a whole number of threads, at least 1"):
        sd.set_num_threads(n)


# --- rejected samples -----------------------------------------------------------------------------------


@pytest.mark.parametrize("threads", [1, 3])
def test_rejected_samples_are_as_in_the_table_kernel_and_valid_ones_unchanged(
    model: sd.Model, parts: Parts, threads: int
) -> None:
    """NaN and inf give NaN, an angle beyond the short sine is recomputed with the long one; in the tail too."""
    sd.set_num_threads(threads)
    for name in ("rnea", "crba", "aba", "generalized_gravity"):
        spec = bare(name)
        values = random_inputs(model, spec, batch=(2005,))
        wanted = on_lanes(model, spec, values)
        angle = next(j.idx_q for j in model.joints if j.kind == "revolute")
        rejected = {3: np.nan, 8: np.inf, 15: -np.inf, 1000: 1e6, 1001: 99999.0, 1999: -3e15, 2004: 1e5 + 1.0}
        for k, value in rejected.items():
            values[0][k, angle] = value
        if len(values) > 1:
            rejected[77] = np.nan
            values[-1][77, -1] = np.nan
        parts.clear()
        found = on_lanes(model, spec, values)
        assert cut(parts, 2005, threads)
        good = np.setdiff1d(np.arange(2005), list(rejected))
        np.testing.assert_array_equal(found[good], wanted[good])
        some = [*rejected, *good[:FEW].tolist()]
        again = one_by_one(model, spec, values, some)
        np.testing.assert_array_equal(np.isfinite(found[some]), np.isfinite(again))
        assert np.isfinite(found[good]).all()
        if name != "aba":
            finite = np.isfinite(again).reshape(len(some), -1).all(axis=1)
            assert finite[: len(rejected)].any()
            assert scaled(found[some][finite], again[finite], len(spec.output.shape)) <= ROUNDING
        for k in (8, 1000, 2004):  # whatever their number
            np.testing.assert_array_equal(on_lanes(model, spec, [x[k : k + 1] for x in values]), found[k : k + 1])
        assert np.isnan(found[3]).any()
        assert np.isfinite(found[1000]).all()


def test_an_input_of_one_sample_that_is_nan_makes_all_nan(arm: sd.Model) -> None:
    q, v, a = random_inputs(arm, bare("rnea"), batch=(600,))
    v0 = v[0].copy()
    v0[0] = np.nan
    np.testing.assert_array_equal(sd.rnea(arm, q, v0, a), untraced(arm, bare("rnea"), [q, v0, a]))


@pytest.mark.parametrize("batch", [(1003,), (17, 59)])
def test_a_norm_that_is_not_one_is_named_with_its_sample(batch: tuple[int, ...]) -> None:
    model = random_tree(108, 6, continuous="cos_sin").model
    q, v, a = random_inputs(model, bare("rnea"), batch=batch)
    flat = q.reshape(-1, model.nq)
    for joint in model.joints[1:]:
        part = {"spherical": slice(0, 4), "floating": slice(3, 7), "continuous": slice(0, 2), "planar": slice(2, 4)}
        if joint.kind not in part:
            continue
        at = slice(joint.idx_q + part[joint.kind].start, joint.idx_q + part[joint.kind].stop)
        for k in (0, 640, 1002):
            kept = flat[k].copy()
            flat[k, at] *= 1.01
            where = str(k) if len(batch) == 1 else str(tuple(int(i) for i in np.unravel_index(k, batch)))
            out = np.zeros((*batch, model.nv))
            with pytest.raises(sd.ConfigurationError) as caught:
                sd.rnea(model, q, v, a, out=out)
            assert f'"{joint.name}" in sample {where}, expected' in str(caught.value)
            flat[k] = kept
    sd.rnea(model, q, v, a)


def test_a_norm_within_the_tolerance_is_no_error() -> None:
    model = random_tree(108, 6).model
    (q,) = random_inputs(model, SPECS["crba"], batch=(600,))
    q = q.astype(np.float32).astype(float)
    assert scaled(on_lanes(model, SPECS["crba"], [q]), untraced(model, SPECS["crba"], [q]), 2) <= ROUNDING


def rod_on_a_turntable() -> sd.Model:
    """A mass at the end of a rod that swings about y, on a massless table that turns about z: at q₂ = 0 the mass is
    on the table's axis.
    """
    builder = sd.ModelBuilder("turntable")
    builder.add_body("table", axis=(0, 0, 1), joint_name="turn")
    rod = (1.0, (0.0, 0.0, 1.0), np.zeros((3, 3)))
    builder.add_body("rod", "table", axis=(0, 1, 0), joint_name="swing", inertia=rod)
    return builder.build()


@pytest.mark.parametrize("name", ["aba", "minverse"])
def test_a_joint_that_moves_no_inertia_is_named_with_its_sample(name: str) -> None:
    model, spec = rod_on_a_turntable(), bare(name)
    values = random_inputs(model, spec, batch=(700,))
    values[0][:, 1] = np.linspace(0.5, 2.5, 700)
    on_lanes(model, spec, values)
    values[0][[333, 699], 1] = 0.0
    with pytest.raises(sd.InertiaError, match='"turn" has zero articulated inertia in sample 333, the first of 2'):
        on_lanes(model, spec, values)


@pytest.mark.parametrize("sample", [0, 300, 698])
def test_an_error_in_any_threads_part_is_named(sample: int) -> None:
    """Of a batch without a program, cut among three threads."""
    model, spec = rod_on_a_turntable(), bare("minverse")
    values = random_inputs(model, spec, batch=(700,))
    values[0][:, 1] = np.linspace(0.5, 2.5, 700)
    sd.set_num_threads(3)
    wanted = untraced(model, spec, values)
    values[0][[sample, 699], 1] = 0.0
    message = f'"turn" has zero articulated inertia in sample {sample}, the first of 2'
    with pytest.raises(sd.InertiaError, match=message):
        untraced(model, spec, values)
    sd.set_num_threads(1)
    values[0][[sample, 699], 1] = 1.0
    same = np.setdiff1d(np.arange(700), [sample, 699])
    np.testing.assert_array_equal(untraced(model, spec, values)[same], wanted[same])


def test_a_massless_tip_is_refused_in_every_batch() -> None:
    builder = sd.ModelBuilder("tip")
    builder.add_body("a", axis=(0, 0, 1), inertia=(1.0, (0.3, 0, 0), 0.1 * np.eye(3)))
    builder.add_body("b", "a", axis=(0, 1, 0), placement=(1, 0, 0), joint_name="last")
    model = builder.build()
    values = random_inputs(model, bare("aba"), batch=(B,))
    with pytest.raises(sd.InertiaError, match='"last" has zero articulated inertia in sample 0, the first of 512'):
        on_lanes(model, bare("aba"), values)


def test_a_product_beyond_the_range_is_named_with_its_sample(arm: sd.Model) -> None:
    q, v, a = random_inputs(arm, bare("rnea"), batch=(600,))
    v[411] = 1e200
    v[5] = np.nan
    with pytest.raises(sd.NonFiniteError, match="rnea of finite input is not finite in sample 411"):
        sd.rnea(arm, q, v, a)


# --- cached programs --------------------------------------------------------------------------------------


@pytest.mark.slow(quick="engines/compiled/test_disk_cache.py::test_what_is_whole_is_read")
def test_a_second_process_records_and_compiles_nothing(arm: sd.Model, tmp_path: Path) -> None:
    (q,) = random_inputs(arm, SPECS["crba"], batch=(B,))
    (tmp_path / "task").write_bytes(pickle.dumps((arm, q)))
    script = """
import pickle, sys
from pathlib import Path
import numpy as np
import spatialdyn as sd
from spatialdyn.engines.programs.run import batch_kernels; from spatialdyn.engines.programs.llvm import simd
task, found, how = sys.argv[1:]
model, q = pickle.loads(Path(task).read_bytes())
def refuse(*arguments, **named):
    raise AssertionError("made anew")
if how == "second":
    batch_kernels.record = simd.compile_program = refuse
sd.compile(model, [sd.generalized_gravity, sd.crba])
results = [sd.generalized_gravity(model, q), sd.crba(model, q)]
q[1] = np.nan
results.append(sd.generalized_gravity(model, q))
Path(found).write_bytes(pickle.dumps(results))
"""
    found = []
    for how in ("first", "second"):
        run_python(script, str(tmp_path / "task"), str(tmp_path / how), how, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
        found.append(pickle.loads((tmp_path / how).read_bytes()))
    programs = list((tmp_path / "cache").rglob("*" + disk_cache.PROGRAM))
    assert len(programs) == 2 * 2 + 1  # one sample and many, and the builtin of all calls
    for x, y in zip(*found, strict=True):
        np.testing.assert_array_equal(x, y)
    assert scaled(found[0][0], untraced(arm, SPECS["generalized_gravity"], [q]), 1) <= ROUNDING


def recordings(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the calls that are recorded after this."""
    seen: list[str] = []
    record = recording.record

    def counted(specs: Any, *arguments: Any, **named: Any) -> Any:
        seen.extend(spec.name for spec in specs)
        return record(specs, *arguments, **named)

    monkeypatch.setattr(batch_kernels, "record", counted)
    return seen


def rnea_kernel(model: sd.Model) -> batch_kernels.Kernel:
    kernel = batch_kernels.kernel((bare("rnea"),), model.bodies, model.key)
    assert kernel is not None
    return kernel


@pytest.mark.parametrize("kind", [disk_cache.PROGRAM, disk_cache.NUMBERS])
@pytest.mark.parametrize("damage", ["bit", "cut", "empty", "head"])
def test_a_damaged_file_is_made_anew(
    arm: sd.Model, fresh: Path, monkeypatch: pytest.MonkeyPatch, damage: str, kind: str
) -> None:
    seen = recordings(monkeypatch)
    values = random_inputs(arm, bare("rnea"), batch=(B,))
    wanted = on_lanes(arm, bare("rnea"), values)
    (file,) = fresh.glob("*" + kind)
    whole = file.read_bytes()
    middle = len(whole) // 2
    file.write_bytes(
        {
            "bit": whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :],
            "cut": whole[:middle],
            "empty": b"",
            "head": bytes([whole[0] ^ 1]) + whole[1:],
        }[damage]
    )
    batch_kernels.forget()
    forget_choices()
    assert rnea_kernel(arm) is not None
    np.testing.assert_array_equal(on_lanes(arm, bare("rnea"), values), wanted)
    assert seen == ["rnea", "rnea"]
    assert file.read_bytes() == whole
    batch_kernels.forget()
    forget_choices()
    on_lanes(arm, bare("rnea"), values)
    assert seen == ["rnea", "rnea"]


def test_unwritable_programs_are_cached_in_memory(arm: sd.Model, fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fresh.write_text("a file where the folder should be")
    seen = recordings(monkeypatch)
    values = random_inputs(arm, bare("rnea"), batch=(B,))
    on_lanes(arm, bare("rnea"), values)
    on_lanes(arm, bare("rnea"), values)
    assert seen == ["rnea"]


def test_other_sources_models_calls_dtypes_and_hosts_are_other_programs(
    arm: sd.Model, fresh: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = recordings(monkeypatch)
    first = rnea_kernel(arm)
    assert rnea_kernel(arm) is first
    assert len(seen) == 1
    heavier = arm.with_(gravity=(0, 0, -1))
    assert rnea_kernel(heavier) is not first
    batch_kernels.kernel((SPECS["rnea"],), arm.bodies, arm.key)
    batch_kernels.kernel((bare("rnea"),), arm.bodies, arm.key, dtype=np.float32)
    batch_kernels.kernel((bare("aba"),), arm.bodies, arm.key)
    assert len(seen) == 5
    monkeypatch.setattr(batch_kernels, "STAMP", "edited")
    assert rnea_kernel(arm) is not first
    name, features, width, fma = host_cpu.host()
    monkeypatch.setattr(host_cpu, "host", lambda: (name, features + ",", width, fma))
    monkeypatch.setattr(batch_kernels, "_from_disk_cache", lambda *arguments: None)
    monkeypatch.setattr(simd, "compile_program", None)  # not callable
    with pytest.raises(TypeError):
        rnea_kernel(arm)
    assert seen[5:] == ["rnea", "rnea"]
    for kind in (disk_cache.PROGRAM, disk_cache.NUMBERS):
        assert len(list(fresh.glob("*" + kind))) == 6


def test_an_equal_model_shares_the_program(arm: sd.Model, fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = recordings(monkeypatch)
    first = rnea_kernel(arm)
    assert rnea_kernel(pickle.loads(pickle.dumps(arm))) is first
    assert seen == ["rnea"]


def test_no_more_programs_are_cached_than_stated(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch_kernels, "CACHE_SIZE", 3)
    models = [random_tree(seed, 2, ["revolute"]).model for seed in range(5)]
    values = [random_inputs(model, bare("rnea"), batch=(B,)) for model in models]
    results = [on_lanes(model, bare("rnea"), some) for model, some in zip(models, values, strict=True)]
    assert len(batch_kernels._programs) == 3
    seen = recordings(monkeypatch)
    for model, some, wanted in zip(models, values, results, strict=True):
        np.testing.assert_array_equal(on_lanes(model, bare("rnea"), some), wanted)
    assert seen == []  # they are on disk
    assert len(batch_kernels._programs) <= 3


def test_the_choice_of_programs_holds_no_more_of_them_than_are_cached() -> None:
    most = run.program.cache_info().maxsize
    assert most is not None
    assert most <= batch_kernels.CACHE_SIZE


def test_eight_threads_may_make_the_first_call(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = recordings(monkeypatch)
    model = random_tree(11, 6).model
    values = random_inputs(model, bare("rnea"), batch=(B + 1,))
    wanted = untraced(model, bare("rnea"), values)
    start, found, wrong = threading.Barrier(8), [np.empty(0)] * 8, []

    def work(k: int) -> None:
        try:
            start.wait()
            found[k] = sd.rnea(model, *values)
        except BaseException as error:
            wrong.append(repr(error))

    threads = [threading.Thread(target=work, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
    assert seen == ["rnea"]
    for result in found:
        np.testing.assert_array_equal(result, found[0])
    assert scaled(found[0], wanted, 1) <= ROUNDING


def test_concurrent_callers_share_the_thread_pool(arm: sd.Model, parts: Parts) -> None:
    """Four threads, each of whose batches runs on three."""
    sd.set_num_threads(3)
    forget_choices()
    sd.compile(arm, [sd.rnea])
    values = random_inputs(arm, bare("rnea"), batch=(4096,))
    wanted, wrong = sd.rnea(arm, *values), []

    def work() -> None:
        wrong.extend(k for k in range(20) if not np.array_equal(sd.rnea(arm, *values), wanted))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
    assert parts == 81 * [(4096, 3)]


SCRIPT_FORK = """
import os, time, warnings
import numpy as np
import spatialdyn as sd
from spatialdyn.engines import threads
from spatialdyn.engines.programs.run import batch_kernels
warnings.simplefilter("ignore")  # of forking a process with threads
batch_kernels.THREAD_BYTES = 1
model, x = sd.load_urdf("two_link"), np.ones((4096, 2))
sd.set_num_threads(2)
sd.compile(model, [sd.rnea])
tau = sd.rnea(model, x, x, x)
assert len(threads.thread_pool._pools) == 1
child = os.fork()
if child == 0:
    right = threads.thread_pool.size == 1 and np.array_equal(sd.rnea(model, x, x, x), tau)
    right &= not threads.thread_pool._pools
    sd.set_num_threads(2)
    right &= np.array_equal(sd.rnea(model, x, x, x), tau) and len(threads.thread_pool._pools) == 1
    os._exit(0 if right else 1)
end = time.monotonic() + 120.0
ended, status = 0, None
while not ended and time.monotonic() < end:
    ended, status = os.waitpid(child, os.WNOHANG)
    time.sleep(0.01)
if not ended:
    os.kill(child, 9)
    os.waitpid(child, 0)
print("hangs" if not ended else "wrong" if status else "right")
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_child_has_no_threads_until_it_sets_their_number() -> None:
    """As by ``multiprocessing``; a child does not have the parent's."""
    assert run_python(SCRIPT_FORK).strip() == "right"


# --- limits ---------------------------------------------------------------------------------------------


def test_a_model_of_too_many_rows_goes_untraced(arm: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    values = random_inputs(arm, bare("rnea"), batch=(B,))
    wanted = untraced(arm, bare("rnea"), values)
    monkeypatch.setattr(batch_kernels, "record", None)
    empty_memory(monkeypatch)
    monkeypatch.setattr(recording, "most_rows", lambda spec: arm.nv - 1)
    np.testing.assert_array_equal(sd.rnea(arm, *values), wanted)
    assert not recording.fits((bare("rnea"),), arm.bodies)
    monkeypatch.setattr(recording, "most_rows", lambda spec: arm.nv)
    assert recording.fits((bare("rnea"),), arm.bodies)


def test_calls_that_grow_as_the_rows_do_have_programs_of_longer_tables() -> None:
    """With a joint that mimics another, aba factors M: its program would have the cube of the rows."""
    for name, within in (("rnea", True), ("aba", True), ("crba", False), ("crba_solve", False)):
        n = recording.most_rows(bare(name)) if within else recording.MOST_ROWS
        chain = random_tree(1, n + 1, kinds=("revolute",), branching=0.0).model
        assert (n > recording.MOST_ROWS) == within
        assert recording.fits((bare(name),), chain.bodies[:-1])
        assert not recording.fits((bare(name),), chain.bodies)
        mimic = chain.bodies[:-1].copy()
        mimic["leader"][2] = 1
        assert recording.fits((bare(name),), mimic) == (name != "aba")


@pytest.mark.parametrize("samples", [1, 2, 63, 200])
def test_a_small_batch_takes_the_program_too(arm: sd.Model, samples: int) -> None:
    values = random_inputs(arm, bare("rnea"), batch=(700,))
    wanted = on_lanes(arm, bare("rnea"), values)
    found = sd.rnea(arm, *(x[:samples] for x in values))
    np.testing.assert_array_equal(found, wanted[:samples])
    assert not np.array_equal(wanted, untraced(arm, bare("rnea"), values))


def test_a_model_without_joints_has_no_program() -> None:
    model = sd.ModelBuilder("rock").build()
    assert sd.rnea(model, *np.zeros((3, 1000, 0))).shape == (1000, 0)
    assert sd.crba(model, np.zeros((1000, 0))).shape == (1000, 0, 0)


def test_a_model_with_mimic_joints_is_the_full_tree_reduced() -> None:
    builder = sd.ModelBuilder("gripper")
    for k, parent in enumerate([None, "b0", "b0"]):
        body = (1.0 + k, (0.1, 0.2, 0.3), 0.1 * np.eye(3))
        builder.add_body(f"b{k}", parent, "prismatic" if k else "revolute", (1, k, 0), inertia=body, joint_name=f"j{k}")
    whole = builder.build()
    q, v, a = random_inputs(whole, bare("rnea"), batch=(600,))
    G = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, -2.0]])
    robot = whole.robot
    joints = tuple(replace(j, mimic=Mimic("j1", -2.0, 0.0)) if j.name == "j2" else j for j in robot.joints)
    model = sd.Model(replace(robot, joints=joints), replace(whole.options, mimic=True))
    assert model.nv == 2
    wanted = on_lanes(whole, bare("rnea"), [x[:, :2] @ G.T for x in (q, v, a)]) @ G
    assert scaled(on_lanes(model, bare("rnea"), [x[:, :2] for x in (q, v, a)]), wanted, 1) <= ROUNDING


def test_a_large_batch_takes_no_large_memory() -> None:
    """Inputs of 96 MB: they are transposed tile by tile, in registers."""
    model, n = sd.load_urdf("two_link"), 2_000_000
    values = [np.ones((n, 2)) for _ in range(3)]
    values[0][n // 2] = 2e5  # one sample that is recomputed
    out = np.empty((n, 2))
    sd.rnea(model, *(x[:B] for x in values))
    for threads in (1, 2):
        sd.set_num_threads(threads)
        tracemalloc.start()
        try:
            sd.rnea(model, *values, out=out)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak < 16 * MEGABYTE
    np.testing.assert_array_equal(out[-1], out[0])
    assert options(model, SPECS["rnea"]) == {}
