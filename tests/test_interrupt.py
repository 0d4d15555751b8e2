"""Ctrl-C: work that takes long is done in slices, which change no bit, and what was done stays in ``out``."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs import batch_kernels, time_loop

COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: no lanes")


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    return sd.load_urdf("two_link")


@pytest.fixture(params=[1, 3])
def threads(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """So many threads for every batch, however small."""
    monkeypatch.setattr(batch_kernels.Kernel, "threads", lambda self, tiles: batch_kernels.team.size)
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
    arm: sd.Model, n: int, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    q, v, tau = states(arm, n)
    q[700:705] += 1e6  # beyond the program's range, in a later slice
    with monkeypatch.context() as patch:
        patch.setattr(batch_kernels.Kernel, "threads", lambda self, tiles: 1)
        wanted = sd.aba(arm, q, v, tau)
    parts = stopping(monkeypatch, batch_kernels.Kernel, "_part", 0)
    monkeypatch.setattr(batch_kernels, "REACH", 1)
    np.testing.assert_array_equal(sd.aba(arm, q, v, tau), wanted)
    assert parts[0] >= n / _kernel(arm).lanes  # a tile each


def _kernel(model: sd.Model) -> Any:
    from spatialdyn.recursions import SPECS

    return batch_kernels.kernel((numba_kernels.variant(SPECS["aba"], frozenset()),), model.bodies, model.key)


@COMPILED
@pytest.mark.parametrize("record", [1, 3, 7, "last"])
@pytest.mark.parametrize("reach", [1, 5, 8, 100])
def test_a_rollout_in_slices_gives_the_same_bits(
    arm: sd.Model, record: Any, reach: int, threads: int, monkeypatch: pytest.MonkeyPatch
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
    monkeypatch.setattr(batch_kernels.time, "perf_counter", lambda: clock[0])
    cuts = []
    for first, end in batch_kernels.slices(100, 512, 64):
        clock[0] += 0.01 * (end - first)
        cuts.append((first, end))
    assert cuts[0] == (0, 1)
    assert [a for a, _ in cuts[1:]] == [b for _, b in cuts[:-1]]
    assert cuts[-1][1] == 100
    assert max(b - a for a, b in cuts) <= 5
    assert next(batch_kernels.slices(1000, 8, 8)) == (0, 1000)  # a small batch of a small robot in one go
    assert batch_kernels.SLICE <= 0.1


# --- what was done stays --------------------------------------------------------------------------------


@COMPILED
def test_ctrl_c_leaves_what_a_program_has_done(arm: sd.Model, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """But not what it has left to the kernel for any model, which has not been asked yet."""
    q, v, tau = states(arm, 4096)
    q[5] += 1e6
    wanted, out = sd.aba(arm, q, v, tau), np.zeros((4096, 2))
    monkeypatch.setattr(batch_kernels.Kernel, "reach", 4)
    stopping(monkeypatch, batch_kernels._Team, "run", 3)  # before the third slice has been looked at
    with pytest.raises(KeyboardInterrupt):
        sd.aba(arm, q, v, tau, out=out)
    wanted[[5, *range(2 * 4 * threads * _kernel(arm).lanes, 4096)]] = np.nan
    np.testing.assert_array_equal(out, wanted)


@pytest.mark.parametrize("given", [True, False])
def test_ctrl_c_leaves_what_the_kernel_for_any_model_has_done(
    arm: sd.Model, threads: int, given: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    n = 60
    q, v, tau = states(arm, n)
    wanted, out = sd.aba_square_root(arm, q, v, tau), np.zeros((n, 2))
    monkeypatch.setattr(batch_kernels, "FIRST", 90)
    monkeypatch.setattr(batch_kernels, "SLICE", 0.0)
    stopping(monkeypatch, batch_kernels._Team, "share", 5)
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
    wanted, out, right = sd.aba(arm, q, v, tau), np.zeros((2000, 2)), batch_kernels.slices

    def stopped(n: int, rows: int, results: int) -> Iterator[tuple[int, int]]:
        for k, cut in enumerate(right(n, 1 << 9, 1 << 9)):
            if k == 2:
                signal.raise_signal(signal.SIGINT)
            yield cut

    monkeypatch.setattr(batch_kernels, "slices", stopped)
    monkeypatch.setattr(batch_kernels, "SLICE", 0.0)
    with pytest.raises(KeyboardInterrupt):
        call(q, v, tau, out=out)
    wanted[4::2] = np.nan
    np.testing.assert_array_equal(out, wanted)


@COMPILED
def test_ctrl_c_ends_a_rollout(arm: sd.Model, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    q, v, _ = states(arm, 100)
    monkeypatch.setattr(batch_kernels.Kernel, "reach", 10)
    slices = stopping(monkeypatch, batch_kernels._Team, "run", 4)
    with pytest.raises(KeyboardInterrupt):
        sd.rollout(arm, q, v, dt=1e-3, steps=50)
    assert slices == [4]


def test_threads_have_ended_when_ctrl_c_is_heard() -> None:
    go, ended = threading.Event(), []

    def slow() -> None:
        go.wait(10.0)
        ended.append(1)

    def stopped() -> None:
        go.set()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        batch_kernels.team.run([stopped, slow, slow])
    assert ended == [1, 1]


@COMPILED
def test_an_out_that_overlaps_an_input_is_refused_in_slices_too(
    arm: sd.Model, threads: int, monkeypatch: pytest.MonkeyPatch
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
model, n = sd.load_urdf("two_link"), 1_000_000
x, out = np.zeros((n, 2)), np.full((n, 2), np.nan)
sd.aba_square_root(model, x[:2], x[:2], x[:2])

def stop():
    while np.isnan(out[n // 10, 0]):  # some slices on
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
    assert 0 < int(done.stdout) < 1_000_000
