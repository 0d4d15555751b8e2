"""Ctrl-C: long work runs in slices, which change no bit; ``out`` keeps the finished samples."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from inputs import no_programs

import spatialdyn as sd
from spatialdyn.compat import pinocchio as pin
from spatialdyn.compat.pinocchio.algorithms import parallel
from spatialdyn.constraints import contact
from spatialdyn.engines import by_table_kernel, extended, threads
from spatialdyn.engines.compiled import lane_names, numba_kernels
from spatialdyn.engines.mimic_batches import Reduced
from spatialdyn.engines.programs.run import batch_kernels, time_loop
from spatialdyn.engines.programs.run.interpreter import RESULT_NS, SLICE_NS, InterpretedBatches
from spatialdyn.engines.programs.run.tiered_program import TieredProgram
from spatialdyn.recursions import SPECS

dynamics, forward_dynamics, specialized = (
    import_module(f"spatialdyn.calls.{name}") for name in ("dynamics", "forward_dynamics", "specialized")
)  # modules, whose names in the package are functions

COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: no lanes")


@pytest.fixture(autouse=True)
def compiled_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Programs are compiled at once: small batches are interpreted otherwise."""
    monkeypatch.setattr(TieredProgram, "batch", lambda self, n, stream=False: self.compiled(False, stream))


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    return sd.load_urdf("two_link")


@pytest.fixture(params=[1, 3])
def thread_count(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """So many threads for every batch, however small."""
    monkeypatch.setattr(batch_kernels.Kernel, "threads", lambda self, tiles: threads.thread_pool.size)
    sd.set_num_threads(request.param)
    yield request.param
    sd.set_num_threads(1)


def states(model: sd.Model, n: int, seed: int = 1) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [sd.random_configuration(model, rng, n), *(rng.standard_normal((n, model.nv)) for _ in range(2))]


def stopping(monkeypatch: pytest.MonkeyPatch, where: Any, name: str, after: int) -> list[int]:
    """Have a signal come when a function was called so many times; returns what counts the calls."""
    right: Callable[..., Any] = getattr(where, name)
    count = [0]

    def counted(*arguments: Any, **words: Any) -> Any:
        made = right(*arguments, **words)
        count[0] += 1
        if count[0] == after:
            signal.raise_signal(signal.SIGINT)
        return made

    monkeypatch.setattr(where, name, counted)
    return count


# --- slices change no bit -------------------------------------------------------------------------------


@COMPILED
@pytest.mark.parametrize("n", [513, 1000, 1024])
def test_a_program_in_slices_gives_the_same_bits(
    arm: sd.Model, n: int, thread_count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    q, v, tau = states(arm, n)
    q[700:705] += 1e6  # beyond the program's range, in a later slice
    with monkeypatch.context() as patch:
        patch.setattr(batch_kernels.Kernel, "threads", lambda self, tiles: 1)
        wanted = sd.aba(arm, q, v, tau)
    parts = stopping(monkeypatch, batch_kernels.Kernel, "_part", 0)
    monkeypatch.setattr(batch_kernels, "SLICE_BYTES", 1)
    np.testing.assert_array_equal(sd.aba(arm, q, v, tau), wanted)
    assert parts[0] >= n / _kernel(arm).lanes / thread_count  # a tile each, and thread


def _kernel(model: sd.Model) -> Any:
    from spatialdyn.recursions import SPECS

    return batch_kernels.kernel((numba_kernels.variant(SPECS["aba"], frozenset()),), model.bodies, model.key)


@pytest.mark.parametrize("columns", [(1,), (36,), (1936,), (2, 85184)])
def test_a_slice_ends_by_code_and_by_results(columns: tuple[int, ...]) -> None:
    """A tile costs its code, and what pages of results cost that nothing has touched yet: 16 MiB at most."""
    kernel = object.__new__(batch_kernels.Kernel)
    kernel.code, kernel._results = SimpleNamespace(length=100_000), 8 * 8 * sum(columns)
    written = kernel.reach * kernel._results
    assert written <= 16 << 20
    assert kernel.reach * kernel.code.length <= batch_kernels.SLICE_BYTES
    most = batch_kernels.SLICE_BYTES - kernel.code.length - 64 * kernel._results
    assert kernel.reach * kernel.code.length + 64 * written > most  # one tile more would be too many


@COMPILED
@pytest.mark.parametrize("name", ["crba", "mass_matrix_derivatives"])
def test_results_end_a_slice_of_an_interpreted_program(name: str) -> None:
    model = sd.load_urdf("ur5")
    spec = numba_kernels.variant(SPECS[name], frozenset())
    batches = InterpretedBatches(TieredProgram((spec,), model.bodies, model.key, ()).interpreted)
    written = batches.lanes * 8 * batches.outputs[0]
    assert batches.reach * RESULT_NS * written <= SLICE_NS
    assert batches.reach * written <= 16 << 20


@COMPILED
def test_results_end_a_slice_where_code_alone_would_not(
    arm: sd.Model, thread_count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernel = _kernel(arm)
    assert kernel._results == kernel.lanes * 2 * 8
    q, v, tau = states(arm, 1024)
    tiles = 1024 // kernel.lanes
    parts = stopping(monkeypatch, batch_kernels.Kernel, "_part", 0)
    monkeypatch.setattr(batch_kernels, "SLICE_BYTES", tiles * kernel.code.length)
    monkeypatch.setattr(batch_kernels, "RESULT_COST", 0)
    wanted, least = sd.aba(arm, q, v, tau), parts[0]
    monkeypatch.setattr(batch_kernels, "RESULT_COST", 3 * kernel.code.length // kernel._results)  # code is a quarter
    np.testing.assert_array_equal(sd.aba(arm, q, v, tau), wanted)
    assert (least, parts[0] - least) == (1, 4 if thread_count == 1 else 2)  # three threads reach further


@COMPILED
@pytest.mark.parametrize("record", [1, 3, 7, "last"])
@pytest.mark.parametrize("reach", [1, 5, 8, 100])
def test_a_rollout_in_slices_gives_the_same_bits(
    arm: sd.Model, record: Any, reach: int, thread_count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of samples, of steps, of both; torques of every step, or of every sample too."""
    q, v, _ = states(arm, 43)
    each = np.random.default_rng(2).standard_normal((43, 20, 2))
    for tau in (each[0], each):
        with monkeypatch.context() as patch:
            patch.setattr(batch_kernels.Kernel, "threads", lambda self, tiles: 1)
            wanted = sd.rollout(arm, q, v, tau, dt=1e-3, record=record)
            one = sd.rollout(arm, q[0], v[0], tau if tau.ndim == 2 else tau[0], dt=1e-3, record=record)
        with monkeypatch.context() as patch:
            patch.setattr(batch_kernels.Kernel, "reach", reach)
            found = sd.rollout(arm, q, v, tau, dt=1e-3, record=record)
            again = sd.rollout(arm, q[0], v[0], tau if tau.ndim == 2 else tau[0], dt=1e-3, record=record)
        for x, y in zip((*found, *again), (*wanted, *one), strict=True):
            np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize(
    ("steps", "every", "most"), [(20, 1, 6), (20, 3, 7), (20, 7, 3), (20, 20, 6), (5, 9, 2), (6, 3, 3)]
)
def test_pieces_end_where_a_record_is_due(steps: int, every: int, most: int) -> None:
    done, records = 0, []
    for first, count, each in time_loop._pieces(steps, every, most):
        assert first == done
        assert 1 <= count <= most
        records += [first + k for k in range(each, count + 1, each)]
        done += count
    assert done == steps
    assert records == list(range(every, steps + 1, every))


def test_slices_are_as_long_as_they_may_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that counts 10 ms a sample: 5 of them take SLICE, and the first are so many as are cheap anywhere."""
    clock = [0.0]
    monkeypatch.setattr(threads.time, "perf_counter", lambda: clock[0])
    cuts = []
    for first, end in threads.slices(100, 512, 64):
        clock[0] += 0.01 * (end - first)
        cuts.append((first, end))
    assert cuts[0] == (0, 1)
    assert [a for a, _ in cuts[1:]] == [b for _, b in cuts[:-1]]
    assert cuts[-1][1] == 100
    assert max(b - a for a, b in cuts) <= 5
    assert next(threads.slices(1000, 8, 8)) == (0, 1000)  # a small batch of a small robot in one go
    assert threads.SLICE_SECONDS <= 0.1


# --- what was done stays --------------------------------------------------------------------------------


@COMPILED
def test_ctrl_c_leaves_what_a_program_has_done(
    arm: sd.Model, thread_count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But not samples beyond its range, which the table kernel has not recomputed yet."""
    q, v, tau = states(arm, 4096)
    q[5] += 1e6
    wanted, out = sd.aba(arm, q, v, tau), np.zeros((4096, 2))
    monkeypatch.setattr(batch_kernels.Kernel, "reach", 4)
    stopping(monkeypatch, batch_kernels.Kernel, "_part", 3)  # before the third slice has been looked at
    with pytest.raises(KeyboardInterrupt):
        sd.aba(arm, q, v, tau, out=out)
    wanted[[5, *range(2 * 4 * thread_count * _kernel(arm).lanes, 4096)]] = np.nan
    np.testing.assert_array_equal(out, wanted)


@COMPILED
def test_ctrl_c_in_the_only_slice_leaves_nan(arm: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not what a program makes of samples beyond its range."""
    q, v, tau = states(arm, 1000)
    q[5] += 1e6
    out = np.zeros((1000, 2))
    stopping(monkeypatch, batch_kernels.Kernel, "_part", 1)
    with pytest.raises(KeyboardInterrupt):
        sd.aba(arm, q, v, tau, out=out)
    assert np.isnan(out).all()


@pytest.mark.parametrize("way", ["program", "slices", "table", "mimic", "double-double", "specialize"])
def test_results_that_the_caller_never_sees_are_not_filled(
    arm: sd.Model, gripper: sd.Model, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """600 MB of fresh pages take longer to fill than Ctrl-C may take."""
    if numba_kernels.PLAIN and way not in ("table", "mimic"):
        pytest.skip("NUMBA_DISABLE_JIT: no lanes")
    made: list[np.ndarray] = []

    def empty(shape: Any, dtype: Any = float) -> np.ndarray:
        made.append(np.full(shape, 7.0, dtype))
        return made[-1]

    if way == "mimic":
        no_programs(monkeypatch)
    n = 60 if way in ("table", "mimic") else 2048
    model = gripper if way == "mimic" else arm
    given = states(model, n)
    call: Callable[..., Any] = sd.aba_square_root if way == "table" else sd.aba
    call = partial(call, model)
    if way == "double-double":
        call = partial(sd.forward_dynamics, model, method="extended")
    if way == "specialize":
        call = sd.specialize(model, sd.aba)
        given[0][::2] += 1e6
    call(*given)  # compiles
    for module in (dynamics, specialized):
        monkeypatch.setattr(module, "empty", empty)
    own = type(np)("own")
    vars(own).update(vars(np) | {"empty": empty})
    monkeypatch.setattr(forward_dynamics, "np", own)
    if way in ("program", "slices", "double-double"):
        monkeypatch.setattr(batch_kernels.Kernel, "reach", 1 << 20 if way == "program" else 4)
        stopping(monkeypatch, batch_kernels.Kernel, "_part", 1 if way == "program" else 3)
    else:
        stopping_slices(monkeypatch, threads, 2)
    with pytest.raises(KeyboardInterrupt):
        call(*given)
    assert made
    assert made[0].size >= n * model.nv
    assert not any(np.isnan(x).any() for x in made)
    assert way in ("program", "specialize") or any((x == 7.0).any() for x in made)  # neither leaves any


@pytest.mark.parametrize("given", [True, False])
def test_ctrl_c_leaves_what_the_table_kernel_has_done(
    arm: sd.Model, thread_count: int, given: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    n = 60
    monkeypatch.setattr(by_table_kernel, "MANY_ALONE", 1)  # also where its kernel is not compiled yet
    q, v, tau = states(arm, n)
    wanted, out = sd.aba_square_root(arm, q, v, tau), np.zeros((n, 2))
    monkeypatch.setattr(threads, "FIRST_SLICE", 90)
    monkeypatch.setattr(threads, "SLICE_SECONDS", 0.0)
    stopping(monkeypatch, threads.ThreadPool, "share", 5)
    with pytest.raises(KeyboardInterrupt):
        sd.aba_square_root(arm, q, v, tau, out=out if given else None)
    if given:
        wanted[10 + 3 :] = np.nan  # after the first slice none is longer than a sample
        np.testing.assert_array_equal(out, wanted)


@COMPILED
@pytest.mark.parametrize("through", ["call", "specialize"])
def test_ctrl_c_leaves_what_was_done_of_samples_that_a_program_has_left(
    arm: sd.Model, through: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    q, v, tau = states(arm, 2000)
    q[::2] += 1e6
    special = sd.specialize(arm, sd.aba)
    call = special if through == "specialize" else lambda *x, out: sd.aba(arm, *x, out=out)
    wanted, out, right = sd.aba(arm, q, v, tau), np.zeros((2000, 2)), threads.slices

    def stopped(n: int, rows: int, results: int, least: int = 1) -> Iterator[tuple[int, int]]:
        for k, cut in enumerate(right(n, 1 << 9, 1 << 9)):
            if k == 2:
                signal.raise_signal(signal.SIGINT)
            yield cut

    monkeypatch.setattr(threads, "slices", stopped)
    monkeypatch.setattr(threads, "SLICE_SECONDS", 0.0)
    with pytest.raises(KeyboardInterrupt):
        call(q, v, tau, out=out)
    wanted[4::2] = np.nan
    np.testing.assert_array_equal(out, wanted)


def stopping_slices(
    monkeypatch: pytest.MonkeyPatch, where: Any, after: int, first: int = 1, of: int = 0
) -> list[tuple[int, int]]:
    """Have slices of so many samples, or the least there may be, and a signal before one; returns those begun.

    of  samples of the batch, where calls in it have slices of their own
    """
    right, cuts = threads.slices, []

    def stopped(n: int, rows: int, results: int, least: int = 1) -> Iterator[tuple[int, int]]:
        for k, cut in enumerate(right(n, 1, threads.FIRST_SLICE // first, least)):
            if of not in (0, n):
                yield cut
                continue
            if k == after:
                signal.raise_signal(signal.SIGINT)
            cuts.append(cut)
            yield cut

    monkeypatch.setattr(where, "slices", stopped)
    monkeypatch.setattr(threads, "SLICE_SECONDS", 0.0)
    return cuts


@pytest.fixture
def gripper() -> sd.Model:
    """A finger that mimics another joint."""
    inertia = (1.0, (0.1, 0.0, 0.2), np.diag([0.1, 0.2, 0.15]))
    builder = sd.ModelBuilder("gripper").add_body("b0", axis=(0, 1, 0), inertia=inertia, joint_name="lead")
    mimic = {"leader": "lead", "multiplier": 2.0, "offset": 0.1}
    builder.add_body("b1", "b0", axis=(1, 0, 0), inertia=inertia)
    return builder.add_body("b2", "b1", axis=(0, 1, 0), inertia=inertia, mimic=mimic).build(mimic=True)


@pytest.mark.parametrize("name", ["crba", "aba", "aba_derivatives"])
@pytest.mark.parametrize("n", [40, 2000])
def test_ctrl_c_leaves_what_was_done_of_a_model_with_mimic_joints(
    gripper: sd.Model, name: str, n: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    no_programs(monkeypatch)
    values = states(gripper, n)[: 1 if name == "crba" else 3]
    wanted = getattr(sd, name)(gripper, *values)
    out = np.zeros(wanted.shape)
    cuts = stopping_slices(monkeypatch, threads, 2, 4, n)
    with pytest.raises(KeyboardInterrupt):
        getattr(sd, name)(gripper, *values, out=out)
    done, least = cuts[-1][1], lane_names.width() if lane_names.fits(SPECS[name]) else 1
    assert done == max(4, least) + least  # after the first slice none is longer than the least
    wanted[done:] = np.nan
    np.testing.assert_array_equal(out, wanted)


@pytest.mark.parametrize("name", ["crba", "aba"])
def test_ctrl_c_within_a_slice_of_a_mimic_batch_leaves_nan_in_all_of_it(
    gripper: sd.Model, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second of slices of 7 samples is half written when the signal comes."""
    no_programs(monkeypatch)
    values = states(gripper, 30)[: 1 if name == "crba" else 3]
    wanted, right, begun = getattr(sd, name)(gripper, *values), Reduced.compute, []

    def stopped(self: Reduced, *given: Any) -> None:
        right(self, *given)
        out = given[-2]
        begun.append(1)
        if len(begun) == 2:
            out[4:] = 7.0
            raise KeyboardInterrupt

    monkeypatch.setattr(threads, "slices", lambda n, *_: ((k, min(k + 7, n)) for k in range(0, n, 7)))
    monkeypatch.setattr(Reduced, "compute", stopped)
    out = np.zeros(wanted.shape)
    with pytest.raises(KeyboardInterrupt):
        getattr(sd, name)(gripper, *values, out=out)
    wanted[7:] = np.nan
    np.testing.assert_array_equal(out, wanted)


def test_constrained_dynamics_hears_ctrl_c_and_slices_change_no_bit(
    arm: sd.Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    n = 40
    q, v, tau = states(arm, n)
    J = np.random.default_rng(3).standard_normal((n, 1, 2))
    drift = J[:, :, 0]
    calls: list[Callable[[], Any]] = [
        lambda: sd.constrained_dynamics(arm, q, v, tau, J, drift), lambda: sd.impact(arm, q, v, J)
    ]  # fmt: skip
    for call in calls:
        wanted = call()
        for after in (100, 3):
            with monkeypatch.context() as patch:
                own = type(threads)("own")
                own.slices = threads.slices  # type: ignore[attr-defined]
                patch.setattr(contact, "threads", own)
                cuts = stopping_slices(patch, own, after)
                if after == 3:
                    with pytest.raises(KeyboardInterrupt):
                        call()
                    assert len(cuts) == 3
                    continue
                for x, y in zip(call(), wanted, strict=True):
                    np.testing.assert_array_equal(x, y)
                assert len(cuts) == n


def test_ctrl_c_leaves_what_double_double_has_done_without_a_program(
    arm: sd.Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    q, v, tau = states(arm, 30)
    wanted, out = sd.forward_dynamics(arm, q, v, tau, method="extended"), np.zeros((30, 2))
    own = type(threads)("own")
    own.slices = threads.slices  # type: ignore[attr-defined]
    monkeypatch.setattr(extended, "threads", own)
    cuts = stopping_slices(monkeypatch, own, 3)
    with pytest.raises(KeyboardInterrupt):
        sd.forward_dynamics(arm, q, v, tau, method="extended", out=out)
    wanted[cuts[-1][1] :] = np.nan
    np.testing.assert_array_equal(out, wanted)


@COMPILED
def test_ctrl_c_leaves_what_double_double_has_done_on_lanes(
    arm: sd.Model, thread_count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    q, v, tau = states(arm, 1024)
    wanted, out = sd.forward_dynamics(arm, q, v, tau, method="extended"), np.zeros((1024, 2))
    plain = sd.aba(arm, q, v, tau)
    right, count = batch_kernels.Kernel.__call__, [0]

    def second(self: Any, *arguments: Any) -> Any:
        count[0] += 1
        if count[0] == 2:  # the first is ABA's own
            monkeypatch.setattr(batch_kernels.Kernel, "reach", 4)
            stopping(monkeypatch, batch_kernels.Kernel, "_part", 3)
        return right(self, *arguments)

    monkeypatch.setattr(batch_kernels.Kernel, "__call__", second)
    with pytest.raises(KeyboardInterrupt):
        sd.forward_dynamics(arm, q, v, tau, method="extended", out=out)
    done = 2 * 4 * thread_count * _kernel(arm).lanes
    np.testing.assert_array_equal(out[:done], wanted[:done])
    assert np.isnan(out[done:]).all()
    assert (plain != wanted).any()


@COMPILED
def test_ctrl_c_leaves_nan_in_every_later_result_of_several_calls(
    arm: sd.Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And, where a mass is an input, in every later sample."""
    q, v, tau = states(arm, 600)
    q[::2] += 1e6
    several = sd.specialize(arm, [sd.aba, sd.generalized_gravity])
    outs = np.zeros((600, 2)), np.zeros((600, 2))
    with monkeypatch.context() as patch:
        stopping_slices(patch, threads, 2)
        with pytest.raises(KeyboardInterrupt):
            several(q, v, tau, out=outs)
    for out, first in zip(outs, (4, 0), strict=True):
        assert np.isnan(out[first::2]).all()
        assert np.isfinite(out[:first]).all()
        assert np.isfinite(out[1::2]).all()
    massive = sd.specialize(arm, sd.generalized_gravity, inputs="payload")
    payload = np.zeros((600, 10))
    payload[:, 0] = np.linspace(1.0, 2.0, 600)
    out = np.zeros((600, 2))
    stopping_slices(monkeypatch, threads, 2)
    with pytest.raises(KeyboardInterrupt):
        massive(q, payload, out=out)
    assert np.isnan(out[4::2]).all()
    assert np.isfinite(out[:4]).all()
    assert np.isfinite(out[5::2]).all()


@COMPILED
def test_pinocchios_parallel_calls_hear_ctrl_c_between_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    model = pin.buildSampleModelManipulator()
    n = 4196
    q, v, a = (np.random.default_rng(k).standard_normal((model.nv, n)) for k in range(3))
    pool = pin.ModelPool(model, 2)
    wanted = pin.rneaInParallel(2, pool, q, v, a)
    for after in (100, 2):
        with monkeypatch.context() as patch:
            cuts = stopping_slices(patch, parallel, after)
            if after == 2:
                with pytest.raises(KeyboardInterrupt):
                    pin.rneaInParallel(2, pool, q, v, a)
                assert len(cuts) == 2
                continue
            np.testing.assert_array_equal(pin.rneaInParallel(2, pool, q, v, a), wanted)
            assert cuts[-1][1] == n


@COMPILED
def test_ctrl_c_ends_a_rollout(arm: sd.Model, thread_count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    q, v, _ = states(arm, 100)
    monkeypatch.setattr(batch_kernels.Kernel, "reach", 10)
    slices = stopping(monkeypatch, threads.ThreadPool, "run", 4)
    with pytest.raises(KeyboardInterrupt):
        sd.rollout(arm, q, v, dt=1e-3, steps=50)
    assert slices == [4]


def test_threads_that_have_begun_have_ended_when_ctrl_c_is_heard() -> None:
    go, begun, ended = threading.Event(), threading.Semaphore(0), []

    def slow() -> None:
        begun.release()
        go.wait(10.0)
        ended.append(1)

    def stopped() -> None:
        for _ in range(2):
            begun.acquire()
        go.set()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        threads.thread_pool.run([stopped, slow, slow])
    assert ended == [1, 1]


def test_a_part_that_fails_ends_the_others() -> None:
    """In whichever thread it runs; what follows is not begun."""
    done: list[int] = []

    def wrong() -> None:
        raise ValueError("wrong")

    for threads_of_it in (1, 2):
        done.clear()
        with pytest.raises(ValueError, match="wrong"):
            threads.thread_pool.run([wrong, *(lambda k=k: done.append(k) for k in range(1000))], threads_of_it)
        assert len(done) < 1000


@COMPILED
def test_an_out_that_overlaps_an_input_is_refused_in_slices_too(
    arm: sd.Model, thread_count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By half: no slice overlaps its own."""
    whole = np.random.default_rng(0).standard_normal((1536, 2))
    before, (q, v, _) = whole.copy(), states(arm, 1024)
    monkeypatch.setattr(batch_kernels.Kernel, "reach", 1)
    with pytest.raises(sd.ShapeError, match="overlaps"):
        sd.aba(arm, q, v, whole[:1024], out=whole[512:])
    np.testing.assert_array_equal(whole, before)


SCRIPT = """
import os, signal, threading
import numpy as np, spatialdyn as sd
model, n = sd.load_urdf("two_link"), 4_000_000  # seconds are left when the signal comes
x, out = np.zeros((n, 2)), np.full((n, 2), np.nan)
sd.aba_square_root(model, x[:2], x[:2], x[:2])

def stop():
    while np.isnan(out[n // 40, 0]):  # some slices on
        pass
    os.kill(os.getpid(), signal.SIGINT)

threading.Thread(target=stop).start()
try:
    sd.aba_square_root(model, x, x, x, out=out)
except KeyboardInterrupt:
    print(int((~np.isnan(out[:, 0])).sum()))
"""


@COMPILED
@pytest.mark.skipif(sys.platform == "win32", reason="a signal to oneself ends the process there")
def test_a_signal_is_heard_long_before_the_end() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True, timeout=300)
    assert 0 < int(done.stdout) < 4_000_000
