"""Regions of recursions, loops and branches: the same bits by every engine, and each sample as if it were alone."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from trees import random_tree

import spatialdyn as sd
from spatialdyn.algebra import regions, scalars
from spatialdyn.algebra.regions import repeat, settled, when
from spatialdyn.algebra.scalars import inline, select
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.numbers.multiprecision import ExactRational
from spatialdyn.engines.numbers.samples import Evaluation
from spatialdyn.engines.programs.llvm import schedule
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.record.operations import AGAIN, REPEAT
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Tape, evaluate, table
from spatialdyn.engines.programs.run import batch_kernels, time_loop
from spatialdyn.engines.programs.run.interpreter import Interpreted, InterpretedBatches
from spatialdyn.engines.programs.transform import derived
from spatialdyn.engines.programs.transform.source_code import c_code, python_code
from spatialdyn.errors import SpatialDynError
from spatialdyn.recursions.spec import Argument, Spec, V

Array = NDArray[np.float64]
CAP = 9
N = 75  # a tile of 64, and part of another


@inline
def halved(bodies: Any, v: Any, out: Any, x: Any, left: Any, pair: Any) -> None:
    """v halved until its first number is at most 1: with passes counted, two numbers swapped and negated in each, an
    inner loop that doubles a number that is below 8, and what the cap leaves. All of it is exact.
    """
    for i in range(2):
        x[i] = v[i]
    left[0] = v[0] - 1.0
    pair[0], pair[1], pair[2], pair[3], pair[4] = 3.0, v[1], 0.0, 1.0, 0.0
    for _ in repeat(CAP, left, x, pair):
        if settled(left[0]):
            break
        x[0], x[1] = 0.5 * x[0], x[1] + x[0]
        pair[0], pair[1] = -pair[1], pair[0]
        pair[2] = pair[2] + 1.0
        pair[4] = 8.0 - pair[3]
        for _ in when(pair[4], pair):
            pair[3] = 2.0 * pair[3]
        left[0] = x[0] - 1.0
    out[0], out[1], out[2], out[3], out[4], out[5], out[6] = x[0], x[1], pair[0], pair[1], pair[2], pair[3], left[0]
    for _ in when(1.0 - v[1], out):
        out[1] = -out[1] * v[0]


HALVED = Spec(
    "halved", halved, None, (V,), Argument("out", (7,), "", "what is left"), "Halves.", "a toy",
    scratch=((2,), (1,), (5,)),
)  # fmt: skip


def by_hand(v: Any) -> list[Any]:
    """The same in plain Python."""
    x, y, a, b, count, doubled = v[0], v[1], 3, v[1], 0, 1
    while x - 1 > 0 and count < CAP:
        x, y, a, b, count = x / 2, y + x, -b, a, count + 1
        doubled = 2 * doubled if doubled < 8 else doubled
    if v[1] < 1:
        y = -y * v[0]
    return [x, y, a, b, count, doubled, x - 1]


@cache
def model() -> sd.Model:
    return random_tree(1, 3, ["revolute"]).model


@cache
def program() -> recording.Recording:
    return recording.record((HALVED,), model().bodies)


def inputs(n: int = N) -> Array:
    """Samples that need 0 to more than CAP passes, in no order."""
    rng = np.random.default_rng(5)
    v = np.zeros((n, model().nv))
    v[:, 0] = rng.integers(-4, 4000, n) * 0.25
    v[: n // 3, 0] = rng.integers(-4, 9, n // 3)
    v[:, 1] = rng.integers(-9, 9, n)
    return v


def wanted(v: Array) -> Array:
    return np.array([[float(x) for x in by_hand(row)] for row in v.tolist()])


def bits(x: Array) -> NDArray[np.uint64]:
    return np.ascontiguousarray(x + 0.0).view(np.uint64)


def through_batches(run: Any, v: Array) -> Array:
    out = np.full((len(v), 7), 7.25)
    rejected = run([np.ascontiguousarray(v)], [out])
    out[rejected] = np.nan
    return out


def on_lanes(v: Array) -> Array:
    return through_batches(batch_kernels.compiled(*program()), v)


def in_tiles(v: Array) -> Array:
    return through_batches(InterpretedBatches(Interpreted(*program())), v)


def on_one_lane(v: Array) -> Array:
    return np.concatenate([through_batches(batch_kernels.compiled(*program(), one=True), x[None]) for x in v])


def interpreted(v: Array) -> Array:
    run = Interpreted(*program())
    call = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 3)(run.entry)
    out = np.full((len(v), 7), 7.25)
    for x, y in zip(v, out, strict=True):
        given, written = np.array([x.ctypes.data]), np.array([y.ctypes.data])
        if not call(run.context, given.ctypes.data, written.ctypes.data):
            y[:] = np.nan
    return out


def by_the_table_kernel(v: Array) -> Array:
    out, status = np.empty((len(v), 7)), np.empty(len(v), np.int8)
    kernel, rows = numba_kernels.batch_kernel(HALVED), getattr(model(), numba_kernels.TABLE)
    kernel(rows, len(v), v, 1, out, status)
    return out


def by_samples(v: Array) -> Array:
    out, status = np.empty((len(v), 7)), np.empty(len(v), np.int8)
    Evaluation(HALVED, model().bodies, ())([v], out, status)
    return out


def replayed(v: Array) -> Array:
    made = program().program.run(list(v.T))
    return np.stack([np.broadcast_to(x, len(v)) for x in made], axis=1)


def of_floats(v: Array) -> Array:
    rows = table(model().bodies)
    return np.array([evaluate(HALVED, rows, (7,), {"v": x.astype(object)}, None).tolist() for x in v])


def in_numpy(v: Array) -> Array:
    scope: dict[str, Any] = {}
    exec(python_code("f", program().program, {"v": (model().nv,)}, {"out": (7,)}), scope)
    found: Array = scope["f"](v)
    return found


ENGINES: list[Callable[[Array], Array]] = [
    on_lanes, on_one_lane, interpreted, in_tiles, by_the_table_kernel, by_samples, replayed, of_floats, in_numpy,
]  # fmt: skip


@pytest.mark.parametrize("engine", ENGINES)
def test_engines_agree_to_the_bit(engine: Callable[[Array], Array]) -> None:
    v = inputs()
    assert {0, CAP} <= set(wanted(v)[:, 4].tolist())
    assert np.array_equal(bits(engine(v)), bits(wanted(v)))


@pytest.mark.parametrize("engine", [on_lanes, in_tiles, by_samples])
def test_samples_do_not_see_their_neighbours(engine: Callable[[Array], Array]) -> None:
    v = inputs()
    assert np.array_equal(bits(engine(v)), bits(np.concatenate([engine(x[None]) for x in v])))


@pytest.mark.parametrize("engine", [on_lanes, in_tiles, by_the_table_kernel, by_samples, of_floats])
def test_nan_ends_a_loop_and_stays_in_its_sample(engine: Callable[[Array], Array]) -> None:
    v = inputs()
    v[9, 0] = np.nan
    found, rest = engine(v), np.arange(N) != 9
    assert np.isnan(found[9, 0])
    assert np.array_equal(bits(found[rest]), bits(wanted(v[rest])))


def test_exact_numbers_run_the_loop_itself() -> None:
    v = [Fraction(700, 3), Fraction(1, 7), Fraction(0)]
    found = evaluate(HALVED, table(model().bodies), (7,), {"v": np.array([*map(ExactRational, v)], object)}, None)
    assert [ExactRational(x).value for x in found] == by_hand(v)


@pytest.mark.parametrize(("most", "cut"), [(1000, 0), (12, 1), (0, 3)])
def test_a_program_in_several_functions_cuts_long_regions(most: int, cut: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Short regions are within a function; of those that are cut, one is within another, and one ends the program."""
    monkeypatch.setattr(schedule, "MOST_WHOLE", 4)
    monkeypatch.setattr(schedule, "CHUNK_LENGTH", 3)
    monkeypatch.setattr(schedule, "MOST_REGION", most)
    assert len(schedule.Schedule(*program(), whole=False).cut) == cut
    assert np.array_equal(bits(on_lanes(inputs())), bits(wanted(inputs())))
    assert np.array_equal(bits(on_one_lane(inputs()[:9])), bits(wanted(inputs()[:9])))


def adding(bodies: Any, v: Any, out: Any, x: Any, left: Any) -> None:
    """Passes, v[1] in all, that begin with what is computed before them."""
    before = v[0] + v[1]
    x[0], left[0] = 0.0, v[1]
    for _ in repeat(CAP, left, x):
        if settled(left[0]):
            break
        x[0] = x[0] + before
        x[0] = (x[0] + 1.0) * 0.5 + (x[0] - 3.0) * 0.25
        left[0] = left[0] - 1.0
    out[0] = x[0]


def test_every_pass_in_functions_reads_what_was_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its place in the workspace is not given to values of the body."""
    spec = Spec(
        "adding", adding, None, (V,), Argument("out", (1,), "", "sum"), "Adds.", "a toy", scratch=((1,), (1,))
    )  # fmt: skip
    made = recording.record((spec,), model().bodies)
    for name in ("MOST_WHOLE", "CHUNK_LENGTH", "MOST_REGION"):
        monkeypatch.setattr(schedule, name, 1)
    v, out = inputs(), np.empty((N, 1))
    batch_kernels.compiled(*made)([v], [out])
    assert np.array_equal(bits(out[:, 0]), bits(made.program.run(list(v.T))[0]))


def test_bodies_are_recorded_once_and_dead_ones_dropped() -> None:
    codes = [op.code for op in program().program.lines]
    assert codes.count(REPEAT) == codes.count(AGAIN) == 3
    assert not program().program.only([]).regions
    count = program().program.only([4])  # the passes need the first number alone
    assert len(count.regions) == 1
    assert len(count.lines) < len(program().program.lines) // 2
    assert np.array_equal(count.run(list(inputs().T))[0], wanted(inputs())[:, 4])


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_c_code_has_loops(tmp_path: Path) -> None:
    text = c_code("f", program().program, {"v": (model().nv,)}, {"out": (7,)})
    assert text.count("while (") == 3
    (tmp_path / "f.c").write_text(text)
    subprocess.run(["cc", "-std=c99", "-Wall", "-Werror", "-O2", "-shared", "-fPIC", "-o", "f.so", "f.c", "-lm"],
                   cwd=tmp_path, check=True)  # fmt: skip
    run = ctypes.CDLL(str(tmp_path / "f.so")).f
    out, v = np.empty((N, 7)), inputs()
    for x, y in zip(v, out, strict=True):
        run(ctypes.c_void_p(x.ctypes.data), ctypes.c_void_p(y.ctypes.data))
    assert np.array_equal(bits(out), bits(wanted(v)))


@inline
def stepped(bodies: Any, v: Any, out: Any, left: Any) -> None:
    """v a step on: by 1 while it is below the next multiple of 4."""
    for i in range(len(out)):
        out[i] = v[i]
    left[0] = 4.0 - v[0]
    for _ in repeat(3, left, out):
        if settled(left[0]):
            break
        out[0] = out[0] + 1.0
        out[1] = out[1] + 0.5
        left[0] = 4.0 - out[0]


STEPPED = Spec("stepped", stepped, None, (V,), Argument("out", ("nv",), "", ""), "Steps.", "a toy", scratch=((1,),))


def test_time_loops_run_regions() -> None:
    kernel = batch_kernels.compiled(*recording.record((STEPPED,), model().bodies))
    v, records = inputs(), np.empty((N, 4, model().nv))
    rejected = time_loop.run(kernel, [v], [], [records], 4, 1)
    assert not len(rejected)
    for k in range(4):
        for _ in range(3):
            v[v[:, 0] < 4.0] += np.array([1.0, 0.5] + [0.0] * (model().nv - 2))
        assert np.array_equal(records[:, k], v)


def test_short_loops_are_recorded_pass_by_pass_for_what_needs_a_straight_line() -> None:
    """The same numbers to the bit; the derivative is that of each sample's passes, exact as all of them is."""
    options, v = recording.ALL._replace(straight=True), inputs()
    straight, looped = (derived.record((HALVED,), model().bodies, (), x) for x in (options, recording.ALL))
    assert looped.program.regions
    assert not straight.program.regions
    found = [np.empty((N, 7)) for _ in range(2)]
    for made, out in zip((straight, looped), found, strict=True):
        assert not len(batch_kernels.compiled(*made)([v], [out]))
    assert np.array_equal(bits(found[0]), bits(wanted(v)))
    assert np.array_equal(bits(found[0]), bits(found[1]))
    slopes, tangent = np.empty((N, 7)), np.zeros_like(v)
    tangent[:, 0] = 1.0
    made = derived.record((HALVED,), model().bodies, (), recording.ALL._replace(derivative="jvp"))
    assert not len(batch_kernels.compiled(*made)([v, tangent], [np.empty((N, 7)), slopes]))
    passes = found[0][:, 4]
    assert np.array_equal(slopes[:, 6], 0.5**passes)
    assert len(set(passes)) > 5


def test_programs_that_need_a_straight_line_refuse_long_loops_by_name() -> None:
    def long(bodies: Any, v: Any, out: Any, x: Any, left: Any) -> None:
        x[0], left[0] = v[0], v[1]
        for _ in repeat(99, left, x):
            if settled(left[0]):
                break
            x[0], left[0] = 0.5 * x[0], left[0] - 1.0
        out[0] = x[0]

    spec = Spec("long", long, None, (V,), Argument("out", (1,), "", ""), "Halves.", "a toy", scratch=((1,), (1,)))
    asked = [("a derivative", {"derivative": "jvp"}), ("a derivative", {"derivative": "vjp"})]
    asked += [("a bound of errors", {"bounds": True}), ("double-double", {"double_double": True})]
    for what, options in asked:
        with pytest.raises(SpatialDynError, match=f"{what} got a program with loops"):
            derived.record((spec,), model().bodies, (), recording.ALL._replace(**options))


def recorded(body: Callable[[Any, Tape], Any]) -> Program:
    tape = Tape()
    x = np.array([tape.input(0)], object)
    with regions.running(tape.repeat):
        result = body(x, tape)
    return Program(tape, [result], 1)


def test_what_is_not_carried_is_refused() -> None:
    def body(x: Any, tape: Tape) -> Any:
        beside = np.array([0.0], object)
        for _ in when(x[0]):
            beside[0] = x[0] * 2.0
        return beside[0] + 1.0

    with pytest.raises(SpatialDynError, match="expected it to be carried"):
        recorded(body)


def turning(bodies: Any, v: Any, out: Any, x: Any, left: Any) -> None:
    """Passes, v[1] in all, that add the sine and cosine of an angle that begins at v[0] and grows tenfold in each."""
    x[0], x[1], left[0] = v[0], 0.0, v[1]
    for _ in repeat(CAP, left, x):
        if settled(left[0]):
            break
        x[1] = x[1] + scalars.sin(x[0]) + 2.0 * scalars.cos(-x[0])
        x[0] = 10.0 * x[0]
        left[0] = left[0] - 1.0
    out[0] = x[1]


TURNING = Spec(
    "turning", turning, None, (V,), Argument("out", (1,), "", "sum"), "Turns.", "a toy", scratch=((2,), (1,)),
)  # fmt: skip


@pytest.mark.parametrize("cut", [False, True])
def test_a_sine_of_a_region_is_of_the_samples_that_run_it(cut: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Angles beyond the lanes' range reject their sample, but not one whose passes have ended before."""
    if cut:
        for name in ("MOST_WHOLE", "CHUNK_LENGTH", "MOST_REGION"):
            monkeypatch.setattr(schedule, name, 3)
    made = recording.record((TURNING,), model().bodies)
    v = np.zeros((11, model().nv))
    v[:, 0], v[:, 1] = 0.7, np.arange(11) - 1.0
    v[3, 0] = 3e3  # whose third angle would be 3e5, after its last pass
    v[4, 0] = 1e4  # whose third is 1e6
    v[10, 0] = 1e-9
    found = []
    for run in (batch_kernels.compiled(*made), InterpretedBatches(Interpreted(*made))):
        out = np.full((11, 1), 7.25)
        rejected = run([v], [out])
        assert rejected.tolist() == [4, 8, 9]  # 0.7e6 is beyond 1e5
        out[rejected] = 0.0
        found.append(out)
    assert np.array_equal(bits(found[0]), bits(found[1]))
    angles = [v[k, 0] * 10.0 ** np.arange(min(max(k - 1, 0), CAP)) for k in range(11)]
    exact = np.array([(np.sin(x) + 2.0 * np.cos(x)).sum() for x in angles])
    kept = np.setdiff1d(np.arange(11), [4, 8, 9])
    np.testing.assert_allclose(found[0][kept, 0], exact[kept], rtol=0.0, atol=1e-11)


def test_what_is_computed_before_is_shared_and_what_within_is_not() -> None:
    def body(x: Any, tape: Tape) -> Any:
        before, y = x[0] * 3.0, np.array([0.0], object)
        start = x[0]
        for _ in when(x[0] - 5.0, y):
            y[0] = start * 3.0 + start * 7.0
        return before + y[0] + select(x[0], start * 7.0, 0.0)

    made = recorded(body)
    for x in (2.0, 6.0, -1.0):
        assert made.run([x])[0] == 3.0 * x + (10.0 * x if x > 5.0 else 0.0) + (7.0 * x if x > 0.0 else 0.0)
