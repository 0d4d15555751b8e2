"""Interpreted programs have the bits of compiled ones and reject the same samples, one by one and in tiles."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Sequence
from copy import copy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inputs import EPS, options, random_inputs, sorted_inputs
from numpy.typing import NDArray
from slow import slow_but, thinned
from trees import random_tree

import spatialdyn as sd
from spatialdyn.algebra import scalars
from spatialdyn.algebra.rotations import UNIT_TOLERANCE
from spatialdyn.engines.compiled import disk_cache
from spatialdyn.engines.compiled.numba_kernels import variant
from spatialdyn.engines.programs.llvm import host_cpu, schedule, simd
from spatialdyn.engines.programs.llvm.instructions import ARITHMETIC, CODE_BITS, TURN, Encoded, encode, opcodes
from spatialdyn.engines.programs.llvm.simd import MAX_ANGLE
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.record.kernel_layout import Float32Range, KernelLayout
from spatialdyn.engines.programs.record.operations import CONST, COS, FORMS, INPUT, SIN, Form, Operation
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Number, Tape
from spatialdyn.engines.programs.run import batches, interpreter
from spatialdyn.engines.programs.run.batch_kernels import Kernel, MachineCode
from spatialdyn.engines.programs.run.interpreter import Interpreted, InterpretedBatches
from spatialdyn.engines.threads import thread_pool
from spatialdyn.errors import SpatialDynError
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import Spec

Array = NDArray[np.float64]
N = 75  # samples: a tile of 64 and part of another
SPECIAL = (0.0, -0.0, 1.0, -1.0, 5e-324, -2e-310, 1e-160, -3e200, 1.7e308, np.inf, -np.inf, np.nan, 0.3, -1.1)
LEVELS = (0, 1)  # of LLVM


class Outcome:
    """What an engine makes of samples: whether each is valid (n,), and the results of the valid ones by output."""

    def __init__(self, valid: NDArray[np.bool_], outputs: Sequence[Array]) -> None:
        self.valid, self.outputs = valid, [y[valid] for y in outputs]

    def __eq__(self, other: object) -> bool:
        """The same bits, signs of zeros among them."""
        return (
            isinstance(other, Outcome)
            and np.array_equal(self.valid, other.valid)
            and all(np.array_equal(bits(x), bits(y)) for x, y in zip(self.outputs, other.outputs, strict=True))
        )


def bits(x: Array) -> NDArray[np.uint64]:
    """Numbers as their bits."""
    return np.ascontiguousarray(x).view(np.uint64)


def made(layout: KernelLayout, n: int) -> list[Array]:
    """Outputs full of a number that no engine leaves."""
    return [np.full((n, len(places)), 7.25) for places in layout.outputs]


def in_batches(run: batches.Batches, layout: KernelLayout, inputs: Sequence[Array], n: int) -> Outcome:
    outputs = made(layout, n)
    rejected = run(inputs, outputs)
    assert rejected is not None
    valid = np.ones(n, bool)
    valid[rejected] = False
    return Outcome(valid, outputs)


def one_by_one(run: Interpreted, layout: KernelLayout, inputs: Sequence[Array], n: int) -> Outcome:
    outputs = made(layout, n)
    call = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 3)(run.entry)
    valid = np.empty(n, bool)
    for k in range(n):
        given = [x[k if len(x) > 1 else 0] for x in inputs]
        addresses = [np.array([x.ctypes.data for x in arrays]) for arrays in (given, [y[k] for y in outputs])]
        valid[k] = call(run.context, *(x.ctypes.data for x in addresses))
        if not valid[k]:
            assert all((y[k] == 7.25).all() for y in outputs)  # not written
    return Outcome(valid, outputs)


def compiled(program: Program, layout: KernelLayout, one: bool, level: int) -> Kernel:
    """The program compiled for single samples, or for the lanes of this host."""
    lanes = 1 if one else host_cpu.lanes_of(np.float64)
    writer = simd.Writer(program, layout, np.float64, lanes, host_cpu.host()[3])
    code, columns = host_cpu.object_code(writer.text(), level), tuple(map(len, layout.outputs))
    loaded = MachineCode(code, writer.workspace, layout.inputs, columns, np.float64, one)
    return Kernel(loaded, writer.numbers.values(np.float64))


LANES = ((False, 1),)  # the compiled program of batches


def agreed(
    program: Program,
    layout: KernelLayout,
    inputs: Sequence[Array],
    engines: Sequence[tuple[bool, int]] = LANES,
    n: int = N,
) -> Outcome:
    """The outcome of n samples, the same one by one, in tiles, and compiled, by (whether on one lane, level)."""
    inputs = [np.ascontiguousarray(x, float) for x in inputs]
    interpreted = Interpreted(program, layout)
    wanted = one_by_one(interpreted, layout, inputs, n)
    assert in_batches(InterpretedBatches(interpreted), layout, inputs, n) == wanted
    for one, level in engines:
        assert in_batches(compiled(program, layout, one, level), layout, inputs, n) == wanted, (one, level)
    return wanted


def program_of(function: Any, inputs: int, **layout: Any) -> tuple[Program, KernelLayout]:
    """The program of a function of Numbers, with an input and an output array."""
    tape = Tape()
    results = list(function(*(tape.input(k) for k in range(inputs))))
    layout = {"outputs": (tuple(range(len(results))),)} | layout
    return Program(tape, results, inputs), KernelLayout((inputs,), **layout)


# --- calls on robots ----------------------------------------------------------------------------------------


@cache
def robot(name: str) -> sd.Model:
    """A robot by name; small ones have quaternions, (cos, sin) pairs, a plane or screws."""
    trees: dict[str, dict[str, Any]] = {
        "floating": dict(seed=3, n_joints=2, kinds=["spherical", "prismatic"], floating=True),
        "cos_sin": dict(seed=4, n_joints=3, kinds=["continuous", "planar"], continuous="cos_sin"),
        "planar": dict(seed=5, n_joints=2, kinds=["planar", "revolute"]),
        "screws": dict(seed=6, n_joints=3, kinds=["helical"]),
    }
    return random_tree(**trees[name]).model if name in trees else sd.load_urdf(name)


def samples(model: sd.Model, spec: Spec, n: int = N) -> list[Array]:
    """Valid inputs by array, and between them ones that are not finite, far, zero or off unit norm."""
    values = dict(zip([x.name for x in sorted_inputs(spec)], random_inputs(model, spec, 1, (n,)), strict=True))
    given = [np.array(values[x.name]).reshape(n, -1) for x in spec.present if not x.static]
    rng = np.random.default_rng(2)
    k = iter(range(1, n, 2))
    for x in given:
        for bad in (np.nan, np.inf, -np.inf, 1.1 * MAX_ANGLE, -3e154, 1e200):
            x[next(k), rng.integers(x.shape[1])] = bad
        x[next(k)] = 0.0
        x[next(k)] *= 1.0 + 1e-5
        x[next(k)] *= 1.0 + 1e-7
    return given


def static_of(model: sd.Model, spec: Spec) -> list[Any]:
    """Values of the static inputs of a call."""
    frame = options(model, spec).get("frame")
    known: dict[str, Any] = {"reference": 1, "classical": 1}
    if frame is not None:
        known |= {"row": model.joints[frame.joint].row, "placement": frame.placement}
    return [known[x.name] for x in spec.present if x.static]


def check(
    name: str, call: str, engines: Sequence[tuple[bool, int]] = LANES, present: frozenset[str] | None = None
) -> None:
    """A call on a robot has one outcome on all engines, some samples valid and some not."""
    model, spec = robot(name), SPECS[call]
    spec = spec if present is None else variant(spec, present)
    if not spec.traceable or not recording.fits((spec,), model.bodies):
        pytest.skip("no program")
    program, layout = recording.record((spec,), model.bodies, static_of(model, spec))
    outcome = agreed(program, layout, samples(model, spec), engines)
    assert outcome.valid[::2].any()
    assert outcome.valid.all() == (not sum(layout.inputs))


TRACED = [name for name, spec in SPECS.items() if spec.traceable]
LARGE = ("rnea", "crba", "aba")
ROBOTS = ("floating", "cos_sin", "planar", "screws")


@pytest.mark.parametrize("call", slow_but(TRACED[::3], TRACED))
def test_every_call_has_the_bits_of_compiled_code(call: str) -> None:
    check("two_link", call, [(True, 0), (False, 1)])


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("call", ["rnea", "crba", "integrate", "difference", "normalize"])
def test_every_kind_of_joint_has_the_bits_of_compiled_code(name: str, call: str) -> None:
    check(name, call, [(False, 0)])


@pytest.mark.parametrize("call", ["rnea", "aba"])
def test_optional_forces_are_read_if_present(call: str) -> None:
    for present in ((), ("fext",)):
        check("two_link", call, present=frozenset(present))


@pytest.mark.slow(quick="test_every_kind_of_joint_has_the_bits_of_compiled_code")
@pytest.mark.parametrize(
    ("name", "call"),
    [
        *(("panda", call) for call in thinned(LARGE, TRACED, 1)),
        *(
            (name, call)
            for name in [*ROBOTS, "ur5"]
            for call in ("crba", "aba", "coriolis_matrix", "frame_acceleration")
        ),
        *(("talos_full", call) for call in LARGE),
    ],
)
def test_calls_on_large_robots_has_the_bits_of_compiled_code(name: str, call: str) -> None:
    check(name, call, [(True, 1), (False, 1)])


# --- operations -------------------------------------------------------------------------------------------


def specials(count: int) -> Array:
    """Every choice of ``count`` special values, fewer of them for three."""
    return np.array(list(itertools.product(SPECIAL[:: 1 if count < 3 else 2], repeat=count)))


def operation(code: int, signs: Sequence[int] = ()) -> tuple[Program, KernelLayout]:
    """The program of one operation, its operands inputs, those in ``signs`` negated."""
    count = FORMS[code].arity
    tape = Tape()
    lines = [tape.input(k).line for k in range(count)]
    result = Number(tape, tape.line(Operation(code, *(-k - 1 if k in signs else k for k in lines))), False)
    return Program(tape, [result, -result], count, fuse=False), KernelLayout((count,), ((0, 1),))


@pytest.mark.parametrize("code", list(FORMS))
def test_an_operation_has_the_same_bits_on_special_values(code: int) -> None:
    x = specials(FORMS[code].arity)
    assert agreed(*operation(code), [x], n=len(x)).valid.any()


@pytest.mark.parametrize("code", [code for code, form in FORMS.items() if form.signs])
def test_an_operation_reads_negated_values(code: int) -> None:
    count = FORMS[code].arity
    x = specials(count)
    for signs in ([0], [count - 1], range(count)):
        assert agreed(*operation(code, signs), [x], n=len(x)).valid.any()


@pytest.mark.parametrize("code", ARITHMETIC)
def test_constants_are_operands(code: int) -> None:
    """In every place, of every sign: tiles do not hold a number for each sample of them."""
    count = FORMS[code].arity
    tape, results = Tape(), []
    for place, value in itertools.product(range(count), (0.0, -0.0, 3.0, -1e-310)):
        lines = [tape.input(k).line for k in range(count)]
        lines[place] = tape.line(Operation(CONST, value=value))
        results.append(Number(tape, tape.line(Operation(code, *lines)), False))
    program, x = Program(tape, results, count, fuse=False), specials(count)
    layout = KernelLayout((count,), tuple((k,) for k in range(len(results))))
    assert agreed(program, layout, [x], n=len(x)).valid.any()


def test_sine_and_cosine_of_one_angle_are_one_instruction() -> None:
    def turn(x: Number, y: Number) -> list[Any]:
        s, c = scalars.sin(x), scalars.cos(x)
        far = scalars.sin(x * y + c)  # of a result: in its place in the program
        return [s * y, c + far, scalars.cos(x * y + c), scalars.cos(y), scalars.sin(y), -s]

    program, layout = program_of(turn, 2)
    sines = sum(op.code in (SIN, COS) for op in program.lines)
    assert sines == 6
    used = (encode(program, layout).code[:, 0] & (1 << CODE_BITS) - 1).tolist()
    assert [used.count(opcodes()[code]) for code in (TURN, SIN, COS)] == [3, 0, 0]
    assert agreed(program, layout, [np.random.default_rng(0).normal(size=(N, 2))]).valid.all()


def test_a_new_operation_is_one_row(monkeypatch: pytest.MonkeyPatch) -> None:
    """Written once as llvm, it runs one by one and in tiles."""
    form = Form(
        "relu", 1, ("max",), lambda a: np.maximum(a, 0.0), "", "",
        lambda t, a: t.select(t.above_zero(a), a, t.constant(0.0)), None,
    )  # fmt: skip
    monkeypatch.setitem(FORMS, 99, form)
    for function in (interpreter._one, interpreter._tiles):
        monkeypatch.setattr(interpreter, function.__name__, function.__wrapped__)
    outcome = agreed(*operation(99), [np.array([[-2.0], [3.0], [-0.0]])], n=3)
    assert outcome.outputs[0][:, 0].tolist() == [0.0, 3.0, 0.0]


# --- checks -----------------------------------------------------------------------------------------------


def near(x: float, count: int = 4) -> Array:
    """The floats next to x, x in the middle."""
    found = [x]
    for _ in range(count):
        found = [np.nextafter(found[0], -np.inf), *found, np.nextafter(found[-1], np.inf)]
    return np.array(found)


def test_pivots_must_exceed_their_least_value() -> None:
    """To the bit, also where the result is negated or an input."""
    program, layout = program_of(
        lambda x, y: [x * y, -(x * x), x], 2, pivots=((0, 0.1), (1, -4.0), (2, 0.05)), outputs=((0,),)
    )
    x = [(a, 0.1 / a * b) for a in (0.05, 0.3, 2.0, -0.2) for b in near(1.0)]
    x += [(a, 1.0) for a in (*near(2.0), *near(0.05), np.nan)]
    valid = agreed(program, layout, [x], n=len(x)).valid
    assert valid.any()
    assert not valid.all()


@pytest.mark.parametrize("group", [(0, 1), (3, 1, 0, 2)])
def test_inputs_and_results_of_unit_norm_are_checked_in_order(group: tuple[int, ...]) -> None:
    program, layout = program_of(lambda *x: [x[0] + 0.0 * x[1], x[1], -x[2], x[3]], 4)
    rng = np.random.default_rng(0)
    x = rng.normal(size=(600, 4))
    x /= np.linalg.norm(x[:, group], axis=1)[:, None]
    x *= np.sqrt(1.0 + rng.choice([UNIT_TOLERANCE, -UNIT_TOLERANCE], 600))[:, None]
    x *= 1.0 + rng.integers(-1, 2, size=(600, 4)) * EPS  # on the edge, to a few ulp
    found = []
    for check in ({"units": (group,)}, {"norms": (group,)}):
        layout = KernelLayout((4,), ((0, 1, 2, 3),), **check)
        found.append(agreed(program, layout, [x], n=600).valid)
    assert np.array_equal(*found)
    assert 100 < found[0].sum() < 500


@pytest.mark.parametrize(("late", "pivots"), [(False, False), (True, True), (False, True)])
@pytest.mark.parametrize("whole", [False, True])
def test_squares_of_angles_are_summed_as_compiled_code_sums_them(
    late: bool, pivots: bool, whole: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the order of lines, with pivots in that of outputs unless the program is long, function by function in very
    long ones.
    """

    def turns(*x: Number) -> list[Any]:
        sines = [scalars.sin(x[k]) for k in (4, 1, 6)]
        deep = scalars.cos(x[0] * 0.25 + x[6]) + scalars.sin(x[5]) * sines[2]
        return [deep * sines[0], scalars.sin(x[0]) * scalars.cos(x[3]), scalars.sin(x[2] * 1.5) + 1.0, *sines]

    if not whole:
        monkeypatch.setattr(schedule, "MOST_WHOLE", 5)
        monkeypatch.setattr(schedule, "CHUNK_LENGTH", 6)
    program, layout = program_of(turns, 7, pivots=((2, -9.0),) * pivots)
    if not late:
        monkeypatch.setattr(schedule, "MOST_LATE", len(program.lines) - 1)
    assert schedule.late(program, layout) == late
    groups = schedule.angles(program, layout)
    assert (len(groups) == 1) == whole
    x = np.random.default_rng(1).normal(size=(7, 3000))
    only_angles = copy(program)
    only_angles.outputs = [(line, False) for group in groups for line in group]
    squares = np.square(only_angles.run(x))
    starts = np.cumsum([0, *map(len, groups)])
    longest = np.max([squares[a:b].sum(axis=0) for a, b in itertools.pairwise(starts)], axis=0)
    x = (x * (MAX_ANGLE / np.sqrt(longest))).T  # on the edge, to a few ulp
    valid = agreed(program, layout, [x], n=3000).valid
    assert 300 < valid.sum() < 2700


@pytest.mark.parametrize("name", ["planar", "screws", "ur5"])
@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("most", [40, 12000])
def test_angles_are_those_of_the_schedule(name: str, late: bool, most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Function by function, each in the order of its first sine or cosine."""
    for name_of_most in ("MOST_WHOLE", "MOST_SOLVED"):
        monkeypatch.setattr(schedule, name_of_most, most)
    monkeypatch.setattr(schedule, "MOST_LATE", 3000 if late else 0)
    monkeypatch.setattr(schedule, "CHUNK_LENGTH", 30)
    for call in ("aba", "crba"):
        program, layout = recording.record((SPECS[call],), robot(name).bodies)
        lines, whole = program.lines, schedule.is_whole(program, layout)
        assert whole == (most > 40)
        wanted = [
            list(dict.fromkeys(lines[k].a for k in chunk if lines[k].code in FORMS and FORMS[lines[k].code].angle))
            for chunk in schedule.Schedule(program, layout, whole).chunks
        ]
        assert schedule.angles(program, layout) == wanted
        assert sum(map(len, wanted))


# --- instructions ------------------------------------------------------------------------------------------


def test_slots_are_used_again_after_the_last_reader() -> None:
    program, layout = recording.record((SPECS["aba"],), robot("ur5").bodies)
    found = encode(program, layout)
    assert isinstance(found, Encoded)
    assert found.slots < len(program.lines) / 3
    assert found.code[:, 1:].max() < found.slots
    assert (found.code[:, 0] >> CODE_BITS).max() < found.slots
    computed = [op for op in program.lines if op.code not in (INPUT, CONST)]
    assert len(found.code) < 1.1 * len(computed)
    assert found.inputs == sum(layout.inputs)
    assert [len(x) for x in found.outputs] == [len(x) for x in layout.outputs]


def test_a_range_of_float32_is_refused() -> None:
    program, layout = program_of(lambda x: [x], 1, range=Float32Range(1.0, 0.5, None))
    with pytest.raises(SpatialDynError, match=r"range is Float32Range\(most=1.0.*expected None"):
        Interpreted(program, layout)


def test_two_programs_keep_their_values_apart() -> None:
    programs = [program_of(lambda x, k=k: [x * k], 1) for k in (2.0, 3.0)]
    runs = [Interpreted(*made) for made in programs]
    assert runs[0].context != runs[1].context
    assert runs[0].entry == runs[1].entry
    x = np.arange(4.0)[:, None]
    for factor, run, (_, layout) in zip((2.0, 3.0), runs, programs, strict=True):
        assert (one_by_one(run, layout, [x], 4).outputs[0] == factor * x).all()


def test_outputs_of_one_sample_may_lie_on_inputs() -> None:
    program, layout = program_of(lambda x, y: [y, x, x + y], 2)
    run = Interpreted(program, KernelLayout((2,), ((0, 1), (2,))))
    x, z = np.array([1.0, 2.0]), np.zeros(1)
    call = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 3)(run.entry)
    given, written = (np.array([y.ctypes.data for y in arrays]) for arrays in ([x], [x, z]))
    assert call(run.context, given.ctypes.data, written.ctypes.data)
    assert (x.tolist(), z.tolist()) == ([2.0, 1.0], [3.0])
    assert layout.inputs == (2,)


def test_a_longer_program_is_expected_to_take_longer() -> None:
    short, long = (
        Interpreted(*recording.record((SPECS[call],), robot("two_link").bodies)) for call in ("rnea", "aba_derivatives")
    )
    assert short.lines < long.lines
    assert 0.0 < short.expected_ns < long.expected_ns


# --- batches -----------------------------------------------------------------------------------------------


@cache
def arm() -> tuple[Program, KernelLayout]:
    return recording.record((variant(SPECS["aba"], frozenset()),), robot("two_link").bodies)


@pytest.mark.parametrize("n", [0, 1, 15, 16, 63, 64, 65, 200])
@pytest.mark.parametrize("wide", [16, 32, 64])
def test_a_batch_of_any_size_has_the_bits_of_single_samples(n: int, wide: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """In tiles of any size, of which one is not full; memory behind the results is not written."""
    monkeypatch.setattr(interpreter, "TILES", (wide,))
    program, layout = arm()
    inputs = samples(robot("two_link"), variant(SPECS["aba"], frozenset()), 201)
    run = Interpreted(program, layout)
    tiles = InterpretedBatches(run)
    assert tiles.lanes == wide
    wanted = one_by_one(run, layout, inputs, 201)
    whole = np.full((n + 1, 2), 7.25)
    rejected = tiles([x[:n] for x in inputs], [whole[:n]])
    assert rejected is not None
    assert rejected.tolist() == np.flatnonzero(~wanted.valid[:n]).tolist()
    assert (whole[n] == 7.25).all()
    assert np.array_equal(bits(np.delete(whole[:n], rejected, 0)), bits(wanted.outputs[0][: n - len(rejected)]))


def test_an_input_may_be_one_row_for_all_samples() -> None:
    program, layout = arm()
    inputs = samples(robot("two_link"), variant(SPECS["aba"], frozenset()))
    for shared in ((0,), (1, 2), (0, 1, 2)):
        given = [x[:1] if k in shared else x for k, x in enumerate(inputs)]
        assert agreed(program, layout, given).valid[0]


def test_arrays_that_do_not_fit_are_not_applicable() -> None:
    tiles = InterpretedBatches(Interpreted(*arm()))
    x, out = [np.zeros((70, 2)) for _ in range(3)], np.zeros((70, 2))
    assert tiles(x, [out]) is not None
    assert tiles([x[0], x[1], np.zeros((69, 2))], [out]) is None
    assert tiles([x[0], x[1], np.zeros((70, 3))], [out]) is None
    assert tiles([x[0], x[1], np.zeros((70, 4))[:, ::2]], [out]) is None
    assert tiles([x[0], x[1], np.zeros((70, 2), np.float32)], [out]) is None
    assert tiles([x[0], x[1], out], [out]) is None  # an output on an input
    read_only = np.zeros((70, 2))
    read_only.flags.writeable = False
    assert tiles(x, [read_only]) is None


@pytest.fixture
def threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two threads, each of a tile at least."""
    monkeypatch.setattr(interpreter, "SHARE_NS", 1.0)
    monkeypatch.setattr(type(thread_pool), "size", 2)


@pytest.mark.usefixtures("threads")
@pytest.mark.parametrize("slice_ns", [1.0, 1e9])
def test_threads_and_slices_change_no_bit(slice_ns: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interpreter, "SLICE_NS", slice_ns)
    program, layout = arm()
    run = Interpreted(program, layout)
    tiles, n = InterpretedBatches(run), 333
    assert tiles.threads(6) == 2
    inputs = samples(robot("two_link"), variant(SPECS["aba"], frozenset()), n)
    assert in_batches(tiles, layout, inputs, n) == one_by_one(run, layout, inputs, n)


@pytest.mark.usefixtures("threads")
def test_an_interrupted_batch_holds_nan_where_it_has_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interpreter, "SLICE_NS", 1.0)
    program, layout = arm()
    tiles, n = InterpretedBatches(Interpreted(program, layout)), 333
    inputs, out = samples(robot("two_link"), variant(SPECS["aba"], frozenset()), n), np.zeros((n, 2))
    run, slices = thread_pool.run, iter(range(9))

    def stopped(parts: Any, threads: int) -> Any:
        if next(slices) == 1:
            raise KeyboardInterrupt
        return run(parts, threads)

    monkeypatch.setattr(thread_pool, "run", stopped)
    with pytest.raises(KeyboardInterrupt):
        tiles(inputs, [out])
    assert np.isfinite(out[:128:2]).all()
    assert np.isnan(out[1]).all()  # rejected
    assert np.isnan(out[128:]).all()


# --- machine code ------------------------------------------------------------------------------------------


def test_machine_code_is_compiled_once_and_kept_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Under a digest of its text: another text is other code; a second process reads it."""
    monkeypatch.setenv(disk_cache.VARIABLE, str(tmp_path))
    texts: list[str] = []
    compile_text = host_cpu.object_code

    def counted(text: str, opt: int = 1) -> bytes:
        texts.append(text)
        return compile_text(text, opt)

    monkeypatch.setattr(host_cpu, "object_code", counted)
    text = "define i64 @f() {{ ret i64 {} }}"
    for k in (1, 2, 1, 2):
        code = host_cpu.stored_code(text.format(k))
        assert ctypes.CFUNCTYPE(ctypes.c_int64)(code.address("f"))() == k
    assert texts == [text.format(1), text.format(2)]


def test_levels_of_llvm_compute_the_same_bits() -> None:
    """Compiled for one lane and for many."""
    model = robot("floating")
    program, layout = recording.record((SPECS["crba"],), model.bodies)
    engines = [(one, level) for one in (True, False) for level in LEVELS]
    assert agreed(program, layout, samples(model, SPECS["crba"]), engines).valid.any()
