"""Programs on lanes: every operation, vector width and number of columns, and the bit of valid samples."""

from __future__ import annotations

import ctypes
import math
import platform
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import mpmath
import numpy as np
import pytest
from inputs import EPS, random_inputs
from numpy.typing import NDArray
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.algebra import scalars
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.polynomials import MAX_ANGLE
from spatialdyn.engines.programs.llvm import columns, host_cpu, schedule, simd
from spatialdyn.engines.programs.llvm.host_cpu import LoadedCode
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.record.kernel_layout import Float32Range, KernelLayout
from spatialdyn.engines.programs.record.operations import FORMS, UFP
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.regions import Region
from spatialdyn.engines.programs.record.tracer import Number, Tape
from spatialdyn.engines.programs.transform.error_bound import REDUCED, TURN
from spatialdyn.recursions import SPECS

ULPS = 1.5  # of sin and cos in float64 for |q| <= MAX_ANGLE
ABSOLUTE = {np.float64: 2.0**-53, np.float32: 2.0**-24}  # half an ulp of 1
FLOAT32_SINE = 2.0  # of these, in float32: two roundings of the reduced angle and one of the polynomial
ATAN2_ULPS = 3.0  # two roundings of its quotient's parts, one of the quotient, and the sums with multiples of π/4
EXP_ULPS = 1.0  # half an ulp of the last sum, a quarter of the one before, and the polynomial's
WIDTHS = (1, 2, 4, 8, 16)
ROUNDING = 64  # eps of the largest entry
SENTINEL = 7.25  # fills the memory behind the results, which must not be written
X86 = platform.machine().lower() in ("x86_64", "amd64")


class Shape(NamedTuple):
    """Target of a program: lanes, fused multiply-add or not, for this CPU or the baseline."""

    lanes: int
    fma: bool
    baseline: bool = False


SHAPES = [Shape(W, fma) for W in WIDTHS for fma in (True, False)] + [Shape(2, False, baseline=True)] * X86
NARROW = [Shape(W, False) for W in WIDTHS] + [Shape(2, False, baseline=True)] * X86


def name_of(shape: Shape) -> str:
    """The name of a parameter in pytest."""
    return f"{shape.lanes}{'-fma' if shape.fma else ''}{'-baseline' if shape.baseline else ''}"


class Runner:
    """A program compiled for a shape, called on whole tiles as ``batch_kernels.Kernel`` calls its own."""

    def __init__(
        self, program: Program, layout: KernelLayout, shape: Shape, dtype: Any = np.float64, stream: bool = False
    ) -> None:
        self.layout, self.shape, self.dtype = layout, shape, np.dtype(dtype)
        writer = simd.Writer(program, layout, dtype, shape.lanes, shape.fma, stream)
        name, features, _, has_fma = host_cpu.host()
        if shape.fma and not has_fma:
            pytest.skip("no fused multiply-add here")
        if shape.baseline:
            name, features = "x86-64", ""
        machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(
            cpu=name, features=features, opt=2, reloc="pic", codemodel="jitdefault", jit=True
        )
        self.loaded = LoadedCode(machine.emit_object(llvm.parse_assembly(writer.text())))
        self.workspace, self.numbers = writer.workspace, writer.numbers.values(dtype)

    def aligned(self, count: int) -> NDArray[Any]:
        """An array aligned to a vector, full of SENTINEL."""
        size = self.shape.lanes * self.dtype.itemsize
        workspace = np.empty(count * self.dtype.itemsize + size, np.uint8)
        first = -workspace.ctypes.data % size
        made = workspace[first : first + count * self.dtype.itemsize].view(self.dtype)
        made[:] = SENTINEL
        return made

    def __call__(self, *inputs: Any, steps: Sequence[int] | None = None) -> tuple[list[NDArray[Any]], NDArray[Any]]:
        """Results (n, columns) per output, and whether each sample is valid (n,)."""
        W = self.shape.lanes
        steps = [1] * len(inputs) if steps is None else steps
        given = [
            np.ascontiguousarray(x, self.dtype).reshape(-1, width)
            for x, width in zip(inputs, self.layout.inputs, strict=True)
        ]
        n = next(len(x) for x, step in zip(given, steps, strict=True) if step)
        assert n % W == 0
        outs = [self.aligned(n * len(places) + W) for places in self.layout.outputs]
        bits = np.full(n // W + 1, 0xABCD, np.uint16)
        workspace = np.empty(self.workspace + 128, np.uint8)
        arguments: list[int] = [n // W]
        kinds: list[Any] = [ctypes.c_int64]
        for x, step in zip(given, steps, strict=True):
            arguments += [x.ctypes.data, step * x.shape[1]]
            kinds += [ctypes.c_void_p, ctypes.c_int64]
        aligned = workspace.ctypes.data + -workspace.ctypes.data % 128
        pointers = [*(x.ctypes.data for x in outs), bits.ctypes.data, aligned, self.numbers.ctypes.data]
        call = ctypes.CFUNCTYPE(None, *kinds, *[ctypes.c_void_p] * len(pointers))(self.loaded.address("kernel"))
        call(*arguments, *pointers)
        assert bits[-1] == 0xABCD
        for x in outs:
            np.testing.assert_array_equal(x[-W:], SENTINEL)
        valid = (bits[:-1, None] >> np.arange(W) & 1).astype(bool).ravel()
        return [x[:-W].reshape(n, -1) for x in outs], valid


def program_of(
    function: Callable[..., Sequence[Any]], inputs: int, fuse: bool = True, **layout: Any
) -> tuple[Program, KernelLayout]:
    """The program of a function of Numbers, each input and output an array of its own columns."""
    tape = Tape()
    results = list(function(*(tape.input(k) for k in range(inputs))))
    return Program(tape, results, inputs, fuse), KernelLayout((inputs,), (tuple(range(len(results))),), **layout)


# --- sin and cos ----------------------------------------------------------------------------------------


def angles() -> NDArray[np.float64]:
    """Dense near the multiples of π/2, where sin or cos is near 0, and everywhere else, to MAX_ANGLE."""
    rng = np.random.default_rng(0)
    last = int(MAX_ANGLE / (math.pi / 2))
    k = np.concatenate([np.arange(200), rng.integers(200, last, 500), np.arange(last - 60, last + 1)])
    near = k * (math.pi / 2)
    ulp = np.spacing(near)
    wide = [near + m * ulp for m in (-2, -1, 0, 1, 2, 37)] + [near * (1 + 1e-9), near + 1e-4, near + math.pi / 4]
    small = 10.0 ** rng.uniform(-320, 0, 300)
    some = np.concatenate(
        [*wide, rng.uniform(-MAX_ANGLE, MAX_ANGLE, 1500), small, [0.0, -0.0, MAX_ANGLE, -MAX_ANGLE, 5e-324]]
    )
    some = np.concatenate([some, -some])
    some = some[abs(some) <= MAX_ANGLE]
    return some[: len(some) // 16 * 16]


@pytest.fixture(scope="module")
def sines() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Angles (n,), and sin and cos of them to twice the digits: (n, 2) the float, (n, 2) its rounding error."""
    x = angles()
    high, low = np.empty((len(x), 2)), np.empty((len(x), 2))
    with mpmath.workprec(160):
        for i, angle in enumerate(x.tolist()):
            pair = mpmath.cos_sin(mpmath.mpf(angle))
            for j, value in enumerate(pair[::-1]):
                high[i, j] = float(value)
                low[i, j] = float(value - high[i, j])
    return x, high, low


def sin_and_cos(x: Number) -> list[Any]:
    return [scalars.sin(x), scalars.cos(x)]


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_sine_and_cosine_are_within_one_and_a_half_ulp(sines: tuple[NDArray[np.float64], ...], shape: Shape) -> None:
    x, high, low = sines
    (found,), valid = Runner(*program_of(sin_and_cos, 1), shape)(x)
    assert valid.all()
    off = abs((found - high) - low)
    assert (off / np.spacing(abs(high))).max() <= ULPS
    assert within_the_analysis(x, found, off, shape).all()


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_sines_in_step_have_the_bits_of_each_alone(shape: Shape) -> None:
    """Of two groups of inputs, and of angles that are no inputs; in the text the groups' operations alternate."""

    def turns(*q: Number) -> list[Any]:
        return [f(x) for x in (*q, q[0] + q[1]) for f in (scalars.sin, scalars.cos)]

    x = np.random.default_rng(shape.lanes).uniform(-9.0, 9.0, (32, 8))
    program, layout = program_of(turns, 8)
    (found,), valid = Runner(program, layout, shape)(x)
    alone = Runner(*program_of(sin_and_cos, 1), shape)
    for k, angle in enumerate([*x.T, x[:, 0] + x[:, 1]]):
        np.testing.assert_array_equal(found[:, 2 * k : 2 * k + 2], alone(angle)[0][0])
    assert valid.all()
    text = simd.Writer(program, layout, np.float64, shape.lanes, True).text()
    shifts = [k for k, line in enumerate(text.split("\n")) if "0x3FE45F306DC9C883" in line]  # products with 2/π
    together = 6 if shape.lanes in (1, 8) else 3
    assert np.diff(shifts)[: together - 1].max() <= 2 < np.diff(shifts)[together - 1]


def within_the_analysis(x: NDArray[Any], found: NDArray[Any], off: NDArray[Any], shape: Shape) -> NDArray[np.bool_]:
    """Whether errors of sines and cosines are within those that bounds of programs are made with."""
    kind = np.finfo(found.dtype)
    size, half_ulp = kind.dtype.itemsize, FORMS[UFP].numpy
    angles = half_ulp(x).reshape((-1,) + (1,) * (found.ndim - 1))
    error = half_ulp(found) + TURN[size, shape.fma] * abs(found) + REDUCED[size] * angles
    return np.asarray(off <= error * (0.5 * kind.eps) + kind.tiny)


WORST: dict[tuple[Any, bool], tuple[float, ...]] = {  # angles of 20 million, in float32 of all, by the error of a sine
    (np.float64, True): (73290.3402353959, -8485.316668470416, 8279.792462561254, -72009.89087033892),
    (np.float64, False): (-4449.2967416981355, -93425.47693154756, -20713.29387957339, 27389.188099639938),
    (np.float32, True): (54250.59375, 97277.84375, 25.921314239501953, 1888.882568359375),
    (np.float32, False): (54250.59375, 97277.84375, 25.921314239501953, 1888.882568359375),
}  # fmt: skip


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_the_worst_angles_have_the_error_that_bounds_count_on_and_four_fifths_of_it_are_too_few(
    dtype: Any, shape: Shape, monkeypatch: pytest.MonkeyPatch
) -> None:
    x = np.array(WORST[dtype, shape.fma] * 4, dtype)
    (found,), valid = Runner(*program_of(sin_and_cos, 1), shape, dtype)(x)
    assert valid.all()
    with mpmath.workprec(160):
        pairs = [mpmath.cos_sin(mpmath.mpf(float(angle)))[::-1] for angle in x]
        off = [
            [abs(float(mpmath.mpf(float(x)) - exact)) for x, exact in zip(*row, strict=True)]
            for row in zip(found, pairs, strict=True)
        ]
    assert within_the_analysis(x, found, np.array(off), shape).all()
    key = np.dtype(dtype).itemsize, shape.fma
    monkeypatch.setitem(TURN, key, 0.8 * TURN[key])
    assert not within_the_analysis(x, found, np.array(off), shape).all()


def many_angles(dtype: Any) -> Iterator[NDArray[Any]]:
    """Ten million: next to every multiple of π/2 to MAX_ANGLE, where r is just above 1/2, small ones, and evenly.

    In float32 also each from 65536 to MAX_ANGLE, where the parts of π/2 lack most.
    """
    rng = np.random.default_rng(1)
    if dtype is np.float32:
        yield np.arange(*np.float32([65536.0, MAX_ANGLE]).view(np.int32), dtype=np.int32).view(dtype)
    near = np.arange(1, int(MAX_ANGLE / (math.pi / 2)) + 1) * (math.pi / 2)
    half = near + rng.uniform(0.5, 0.5236, len(near))
    sets = [np.nextafter(dtype(0.0), dtype(1.0), dtype=dtype) * np.arange(16), 10.0 ** rng.uniform(-30, 5, 500_000)]
    sets += [near.astype(dtype) + m * np.spacing(near.astype(dtype)) for m in range(-3, 4)] + [half, -half]
    sets += [rng.uniform(-MAX_ANGLE, MAX_ANGLE, 1_000_000) for _ in range(9)]
    for x in sets:
        x = x.astype(dtype)
        x = x[abs(x) <= dtype(MAX_ANGLE)]
        yield x[: len(x) // 16 * 16]


@pytest.mark.slow(quick="test_sine_and_cosine_are_within_one_and_a_half_ulp")
@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no wider float to compare with")
@pytest.mark.parametrize(("dtype", "wider"), [(np.float64, np.longdouble), (np.float32, np.float64)])
def test_sine_and_cosine_of_ten_million_angles_are_within_one_and_a_half_ulp(dtype: Any, wider: Any) -> None:
    """Of wide vectors with fused multiply-add and of narrow ones without, where there is such an instruction."""
    shapes = [Shape(8, True)] * host_cpu.host()[3] + [Shape(2, False)]
    runners = [(shape, Runner(*program_of(sin_and_cos, 1), shape, dtype)) for shape in shapes]
    for x in many_angles(dtype):
        truth = [function(x.astype(wider)) for function in (np.sin, np.cos)]
        ulps = [np.spacing(abs(wanted.astype(dtype))).astype(wider) for wanted in truth]
        for shape, run in runners:
            (found,), valid = run(x)
            assert valid.all()
            for column, (wanted, ulp) in enumerate(zip(truth, ulps, strict=True)):
                off = abs(found[:, column] - wanted)
                assert (off / ulp).max() <= ULPS
                assert within_the_analysis(x, found[:, column], off, shape).all()


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_float32_sine_and_cosine_are_near_rounding(shape: Shape) -> None:
    x = np.asarray(angles(), np.float32)
    x = np.where(abs(x) <= np.float32(MAX_ANGLE), x, np.float32(1.0))
    x[:4] = 54250.59375, 97277.84375, 25.921314239501953, 1888.882568359375  # the worst of all
    (found,), valid = Runner(*program_of(sin_and_cos, 1), shape, np.float32)(x)
    assert valid.all()
    wanted = np.stack([np.sin(x.astype(float)), np.cos(x.astype(float))], axis=1)
    assert abs(found - wanted).max() <= FLOAT32_SINE * ABSOLUTE[np.float32]
    assert within_the_analysis(x, found, abs(found - wanted), shape).all()


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_an_angle_out_of_range_is_flagged_and_no_other(dtype: Any) -> None:
    beyond = float(np.nextafter(dtype(MAX_ANGLE), dtype(np.inf)))
    x = np.array(
        [0.5, beyond, MAX_ANGLE, -MAX_ANGLE, -beyond, np.nan, np.inf, -np.inf, 1e300 if dtype is np.float64 else 1e30]
        * 16
    )
    for shape in SHAPES:
        _, valid = Runner(*program_of(sin_and_cos, 1), shape, dtype)(x)
        np.testing.assert_array_equal(valid, np.asarray(abs(x) <= MAX_ANGLE))


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("count", [2, 7])
def test_the_range_of_every_angle_is_checked(count: int, dtype: Any) -> None:
    """Of several angles in one program, each far in turn, and the others near."""
    x = np.full((16 * count, count), 0.5)
    x[np.arange(count), np.arange(count)] = 2.0 * MAX_ANGLE
    runner = Runner(
        *program_of(lambda *q: [f(e) for e in q for f in (scalars.sin, scalars.cos)], count), Shape(4, False), dtype
    )
    _, valid = runner(x)
    np.testing.assert_array_equal(valid, np.arange(16 * count) >= count)


def test_an_angle_that_no_sine_is_taken_of_may_be_far() -> None:
    (found,), valid = Runner(*program_of(lambda x, y: [x + scalars.sin(y)], 2), Shape(4, False))([[1e9, 0.0]] * 4)
    assert valid.all()
    np.testing.assert_array_equal(found, 1e9)


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_beyond_the_range_the_sine_is_that_of_libm_to_the_bit(dtype: Any) -> None:
    """A hinge about z has the rotation [cos -sin; sin cos], and no translation. Large and small angles share tiles."""
    model = sd.ModelBuilder("hinge").add_body("tip", None, "revolute", (0, 0, 1)).build()
    rng, largest = np.random.default_rng(2), float(np.finfo(dtype).max)
    least = float(np.nextafter(dtype(MAX_ANGLE), dtype(np.inf)))
    near = (np.floor(2.0 ** rng.uniform(16.0, 52.0, 3000)) * (math.pi / 2))[:, None]
    hard = [least, 1e22, 6381956970095103.0 * 2.0**797, math.ldexp(6381956970095103, 44), 1e15, largest]
    far = np.concatenate(
        [
            hard,
            *(10.0 ** rng.uniform(5.0, top, 3000) for top in (7.0, math.log10(largest))),
            (near + np.spacing(near) * [-1, 0, 1]).ravel(),
        ]
    )
    with np.errstate(over="ignore"):
        far = far.astype(dtype)
    far = far[np.isfinite(far) & (far >= least)]
    x = np.empty((len(far), 4), dtype)
    x[:, 0], x[:, 1], x[:, 2], x[:, 3] = far, -far, 0.5, MAX_ANGLE
    q = x.reshape(-1, 1)
    wanted = [[dtype(f(angle)) for f in (math.cos, math.sin)] for angle in x[:, :2].ravel().tolist()]
    program = sd.specialize(model, sd.frame_placement, dtype=dtype, frame="tip")
    assert program.engine == "lanes"
    ways = [program] if dtype is np.float32 else [program, lambda q: sd.frame_placement(model, q, "tip")]
    for call in ways:
        for found in (call(q), np.stack([call(q[k]) for k in range(16)])):
            pairs = found.reshape(-1, 4, 4, 4)[:, :2, :2, 0]
            np.testing.assert_array_equal(pairs.reshape(-1, 2), wanted[: 2 * len(pairs)])


def test_sums_of_squares_are_held_to_their_range() -> None:
    """Rejects inputs above ``most``, results below ``least`` unless all driving inputs are 0, and infinite squares."""
    wide = Float32Range(most=8.0, least=1e-3, driving=(1,))
    x = np.array(
        [[0.5, 0.5], [9.0, 1e-3], [1e-4, 1e-4], [1e-4, 0.0], [1e-4, -0.0], [1e-30, 1e-44], [np.nan, 0.0], [0, 0]]
    )
    for shape in (Shape(8, True), Shape(4, False)):
        tape = Tape()
        a, b = tape.input(0), tape.input(1)
        for results, kept in (
            (((a, b * 2.0), (a + b,)), [1, 0, 0, 1, 1, 0, 0, 1]),
            (((a, 1.0), (a + b, 1.0)), [1, 0, 1, 1, 1, 1, 0, 1]),
            (((0.0, 0.0), (a * 1e20, 1.0)), [0, 0, 1, 1, 1, 1, 0, 1]),
        ):
            places = (tuple(range(2)), tuple(range(2, 2 + len(results[1]))))
            layout = KernelLayout((1, 1), places, range=wide)
            runner = Runner(Program(tape, [*results[0], *results[1]], 2), layout, shape, np.float32)
            _, valid = runner(x[:, :1], x[:, 1:])
            np.testing.assert_array_equal(valid, np.array(kept, bool))


# --- exp -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_exp_is_within_one_ulp_from_underflow_to_overflow(shape: Shape, dtype: Any) -> None:
    least, most = (-750.0, 709.78) if dtype is np.float64 else (-105.0, 88.7)
    rng, wider = np.random.default_rng(shape.lanes), np.longdouble if dtype is np.float64 else np.float64
    halves = np.arange(math.floor(least), math.ceil(most)) * (math.log(2.0) / 2.0)  # where n changes
    x = np.concatenate(
        [
            rng.uniform(least, most, 1 << 14), rng.uniform(-2.0, 2.0, 1 << 14),
            rng.choice([-1.0, 1.0], 1 << 12) * 10.0 ** rng.uniform(-20.0, 0.0, 1 << 12),
            halves, np.nextafter(halves, 1e9), [0.0, -0.0, 1.0, -1.0, most, least],
        ]
    ).astype(dtype)  # fmt: skip
    x = np.concatenate([x, np.zeros(-len(x) % 16, dtype)])
    (found,), valid = Runner(*program_of(lambda x: [scalars.exp(x)], 1), shape, dtype)(x)
    assert valid.all()
    wanted = np.exp(x.astype(wider))
    if np.finfo(np.longdouble).eps < 1e-18 or dtype is np.float32:
        ulp = np.spacing(wanted.astype(dtype)).astype(wider)
        assert (abs(found[:, 0] - wanted) / ulp).max() <= EXP_ULPS
    assert (found[x == 0.0, 0] == 1.0).all()


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_exp_beyond_the_range_is_zero_or_infinite_and_of_nan_nan(dtype: Any) -> None:
    """An infinite exp that only a quotient reads leaves the sample valid: tanh is 1 there."""
    x = np.array([-1e30, -np.inf, 1e30, np.inf, np.nan, 800.0, -800.0, 0.0] * 2)
    made = program_of(lambda x, y: [1.0 / (1.0 + scalars.exp(y)), x * 0.0], 2)
    for shape in SHAPES:
        (found,), valid = Runner(*made, shape, dtype)(np.stack([0.0 * np.zeros(16), x], 1))
        np.testing.assert_array_equal(valid, np.isfinite(x))
        np.testing.assert_array_equal(found[valid, 0], np.array([1.0, 0.0, 0.0, 1.0, 0.5] * 2))


# --- atan2 ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_atan2_is_within_three_ulp(shape: Shape, dtype: Any) -> None:
    rng = np.random.default_rng(shape.lanes)
    angle, radius = rng.uniform(-math.pi, math.pi, 1 << 14), 10.0 ** rng.uniform(-9.0, 9.0, 1 << 14)
    points = np.stack([radius * np.sin(angle), radius * np.cos(angle)], axis=1)
    points[:4096] *= 10.0 ** rng.uniform(-12.0, 12.0, (4096, 2))
    corners = [[a, b] for a in (1.0, -1.0, 0.41421356, -3.0) for b in (1.0, -1.0, 2.4142135, -3.0)]
    corners += [[0.0, 1.0], [1.0, 0.0], [-1.0, 0.0], [0.0, -2.0], [-0.0, -2.0], [-0.0, 2.0], [3.0, -0.0], [1e-20, 1.0]]
    points = np.concatenate([points, corners, corners]).astype(dtype)
    points = points[: len(points) // shape.lanes * shape.lanes]
    run = Runner(*program_of(lambda y, x: [scalars.atan2(y, x), -scalars.atan2(-y, x)], 2), shape, dtype)
    (found,), valid = run(points)
    assert valid.all()
    wanted = np.arctan2(*points.T.astype(np.longdouble if dtype is np.float64 else np.float64))
    error = abs(found[:, 0] - wanted) / np.spacing(abs(wanted).astype(dtype))
    assert error.max() <= ATAN2_ULPS
    np.testing.assert_array_equal(np.signbit(found[:, 0]), np.signbit(wanted))
    np.testing.assert_array_equal(found[:, 1], found[:, 0])


def test_atan2_of_the_origin_is_left_to_the_caller() -> None:
    points = np.array([[0.0, 0.0], [0.0, -0.0], [1.0, 1.0], [0.0, 1.0]])
    (found,), valid = Runner(*program_of(lambda y, x: [scalars.atan2(y, x)], 2), Shape(4, False))(points)
    np.testing.assert_array_equal(valid, [False, False, True, True])
    np.testing.assert_array_equal(found[2:, 0], [math.pi / 4, 0.0])


# --- every operation ------------------------------------------------------------------------------------


def everything(x: Number, y: Number, z: Number) -> list[Any]:
    """Each operation but sin and cos, with signs where allowed; constants and repeated results."""
    results = [x + y, x - y, y - x, x * y, -x * z, x / y, -x / y, 1.0 / z, scalars.sqrt(y), -scalars.sqrt(x * x)]
    results += [scalars.sqrt(-(x - 20.0)), x * 3.0 + z, x * 3.0 - z, z - x * 5.0, x * y * z + y * z * 7.0]
    results += [scalars.select(x, y, z), scalars.select(-x, -y, 2.5), scalars.select(x - y, -z, -y), -x]
    return [*results, 0.0, -1.5, results[0], -results[5], 1e300 * x * 1e-300]


def samples(n: int, seed: int = 0) -> NDArray[np.float64]:
    """Inputs of ``everything``: any x and z, positive y."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 3))
    x[:, 1] = abs(x[:, 1]) + 0.1
    x[::7, 0] = 0.0
    return x


@pytest.mark.parametrize("shape", NARROW, ids=name_of)
def test_every_operation_rounds_as_numpy_does(shape: Shape) -> None:
    """Without fused products the program is exact to the bit, division and square root too."""
    x = samples(48)
    program, layout = program_of(everything, 3)
    (found,), valid = Runner(program, layout, shape)(x)
    wanted = np.array([np.broadcast_to(r, len(x)) for r in program.run(x.T)]).T
    np.testing.assert_array_equal(found, wanted)
    assert valid.all()


@pytest.mark.parametrize("shape", NARROW, ids=name_of)
def test_every_operation_rounds_as_numpy_does_in_float32(shape: Shape) -> None:
    def some(x: Number, y: Number, z: Number) -> list[Any]:
        return everything(x, y, z)[:-1]

    x = samples(48).astype(np.float32)
    program, layout = program_of(some, 3)
    (found,), valid = Runner(program, layout, shape, np.float32)(x)
    assert found.dtype == np.float32
    rounded = [op._replace(value=float(np.float32(op.value))) for op in program.lines]
    assert rounded == program.lines  # constants that float32 has
    wanted = np.array([np.broadcast_to(r, len(x)).astype(np.float32) for r in program.run(x.T)]).T
    np.testing.assert_array_equal(found, wanted)
    assert valid.all()


@pytest.mark.parametrize("shape", [s for s in SHAPES if s.fma], ids=name_of)
def test_a_fused_product_is_rounded_once(shape: Shape) -> None:
    """(1 + e)(1 - e) - 1 = -e² shows only where the product is not rounded before."""
    e = 2.0**-30
    for function, third, wanted in (
        (lambda x, y, z: [x * y + z], -1.0, -e * e),
        (lambda x, y, z: [-(x * y) - z], -1.0, e * e),
        (lambda x, y, z: [x * y - z], 1.0, -e * e),
        (lambda x, y, z: [z - x * y], 1.0, e * e),
        (lambda x, y, z: [scalars.sqrt(z) - x * y], 1.0, e * e),
        (lambda x, y, z: [x * y - scalars.sqrt(z)], 1.0, -e * e),
    ):
        program, layout = program_of(function, 3)
        (found,), _ = Runner(program, layout, shape)([[1.0 + e, 1.0 - e, third]] * 16)
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_a_program_of_constants_alone_is_written_to_every_sample(shape: Shape) -> None:
    program, layout = program_of(lambda x: [0.0, -2.0, 3.5], 1)
    (found,), valid = Runner(program, layout, shape)(np.r_[np.zeros(31), np.nan])
    np.testing.assert_array_equal(found, [[0.0, -2.0, 3.5]] * 32)
    np.testing.assert_array_equal(valid, [True] * 31 + [False])


# --- rows and columns -----------------------------------------------------------------------------------


@pytest.mark.parametrize("width", WIDTHS)
def test_blocks_cover_the_columns_and_no_more(width: int) -> None:
    for count in range(1, 70):
        blocks = list(columns.blocks(count, width))
        assert {c for first, size in blocks for c in range(first, first + size)} == set(range(count))
        assert all(size <= width and size & (size - 1) == 0 for _, size in blocks)


@pytest.mark.parametrize("shape", NARROW, ids=name_of)
@pytest.mark.parametrize("dtype", slow_but([np.float64], [np.float64, np.float32]))
def test_any_number_of_columns_is_transposed_there_and_back(shape: Shape, dtype: Any) -> None:
    """Two inputs of c and 21 - c columns, which is each number to 20, dealt out to two outputs, signs turned."""
    for c in (1, 4, 7, 8, 13, 20):
        tape = Tape()
        x = [tape.input(k) for k in range(21)]
        places = (tuple(range(c)), tuple(range(c, 21)))
        results = [-x[(8 * k + 3) % 21] for k in range(21)]
        runner = Runner(Program(tape, results, 21), KernelLayout((c, 21 - c), places), shape, dtype)
        whole = np.arange(3 * shape.lanes * 21, dtype=dtype).reshape(-1, 21)
        (first, second), valid = runner(whole[:, :c], whole[:, c:])
        wanted = -whole[:, [(8 * k + 3) % 21 for k in range(21)]]
        np.testing.assert_array_equal(first, wanted[:, :c])
        np.testing.assert_array_equal(second, wanted[:, c:])
        assert valid.all()


@pytest.mark.skipif(not X86, reason="AVX-512 is of x86")
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_avx512_transposes_without_indices_in_a_register(dtype: Any) -> None:
    """Those shuffles keep multiply-adds waiting."""
    lanes = 64 // np.dtype(dtype).itemsize
    host_cpu.host()  # initializes LLVM's targets
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(cpu="skylake-avx512", opt=1)
    for count in (4, 6, 8, 16):
        writer = simd.Writer(*program_of(lambda *x: [-e for e in x], count), dtype, lanes, True)
        made = machine.emit_assembly(llvm.parse_assembly(writer.text()))
        assert "zmm" in made
        assert "vpermt2" not in made
        assert "vpermi2" not in made


@pytest.mark.parametrize("shape", [s for s in NARROW if s.lanes > 1], ids=name_of)
@pytest.mark.parametrize("dtype", slow_but([np.float64], [np.float64, np.float32]))
def test_rows_are_written_in_place_in_halves_staged_or_streamed(
    monkeypatch: pytest.MonkeyPatch, shape: Shape, dtype: Any
) -> None:
    """Columns that are whole vectors, half ones more, and neither, cut into functions or not."""
    for c in (1, 5, 8, 28, 49):
        tape = Tape()
        x = [tape.input(k) for k in range(3)]
        results = [x[k % 3] * float(k + 2) for k in range(c)]
        program, layout = Program(tape, results, 3), KernelLayout((3,), (tuple(range(c)), tuple(range(c // 2 + 1))))
        values = np.arange(4 * shape.lanes * 3).reshape(-1, 3)
        wanted = np.stack([values[:, k % 3] * (k + 2) for k in range(c)], axis=1)
        for whole in (schedule.MOST_WHOLE, 0) if c == 49 else (schedule.MOST_WHOLE,):
            with monkeypatch.context() as patch:
                patch.setattr(schedule, "MOST_WHOLE", whole)
                patch.setattr(simd, "STORED", 8)
                patch.setattr(columns, "IN_PLACE", ())
                for stream in (False, True):
                    (first, second), valid = Runner(program, layout, shape, dtype, stream)(values)
                    assert valid.all()
                    np.testing.assert_array_equal(first, wanted)
                    np.testing.assert_array_equal(second, wanted[:, : c // 2 + 1])


@pytest.mark.parametrize("columns_of", [(36, True, False), (81, False, True), (6, False, False), (64, False, False)])
def test_long_rows_are_staged_unless_a_vector_or_half_of_one_divides_them(
    columns_of: tuple[int, bool, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor are they where staging is slower, unless they bypass the CPU caches."""
    count, halved, staged = columns_of
    assert columns.halved(count, 8) == halved
    for processor, fast in (("cascadelake", True), ("znver4", False)):
        monkeypatch.setattr(columns, "host", lambda name=processor: (name, "", 64, True))
        assert columns.staged(count, 8, stream=False) == (staged and fast)
        assert columns.staged(count, 8, stream=True) == (count % 8 > 0)


@pytest.mark.parametrize("stream", [False, True])
def test_the_rows_of_a_single_call_are_written_in_place(stream: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """No copy in the text, and no slots for rows: of long rows, which batches stage."""
    monkeypatch.setattr(columns, "IN_PLACE", ())
    program, layout = program_of(lambda x: [x * float(k + 2) for k in range(49)], 1)
    one, many = (simd.Writer(program, layout, np.float64, lanes, True, stream) for lanes in (1, 8))
    assert "call void @copy" in many.text()
    assert "call void @copy" not in one.text()
    assert many.workspace // 64 - one.workspace // 8 == 49


def test_an_input_with_step_zero_serves_every_sample() -> None:
    tape = Tape()
    x, y, z = (tape.input(k) for k in range(3))
    for shape in SHAPES:
        runner = Runner(Program(tape, [x + y, x * z], 3), KernelLayout((1, 2), ((0, 1),)), shape)
        q = np.arange(32.0)
        (found,), valid = runner(q, [[5.0, 7.0]], steps=[1, 0])
        np.testing.assert_array_equal(found, np.stack([q + 5.0, q * 7.0], axis=1))
        assert valid.all()
        assert not runner(q, [[5.0, np.nan]], steps=[1, 0])[1].any()


@pytest.mark.parametrize("shape", [Shape(8, True), Shape(2, False)], ids=name_of)
@pytest.mark.parametrize("n", [1, 3, 5, 7, 11])
def test_mass_matrices_of_odd_sizes_are_written_whole(n: int, shape: Shape) -> None:
    made = random_tree(n, n, ["revolute", "prismatic"], branching=0.4)
    program, layout = recording.record((SPECS["crba"],), made.model.bodies)[:2]
    assert layout.outputs == (tuple(range(n * n)),)
    (q,) = random_inputs(made.model, SPECS["crba"], batch=(48,))
    (M,), valid = Runner(program, layout, shape)(q)
    wanted = sd.crba(made.model, q)
    assert abs(M.reshape(-1, n, n) - wanted).max() <= ROUNDING * EPS * abs(wanted).max()
    assert valid.all()


# --- long programs --------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [Shape(8, True), Shape(4, False), Shape(2, False)], ids=name_of)
@pytest.mark.parametrize("chunk", slow_but([7, 2000], [1, 7, 100, 2000]))
def test_a_program_cut_into_functions_gives_the_same_bits(
    monkeypatch: pytest.MonkeyPatch, shape: Shape, chunk: int
) -> None:
    model = random_tree(3, 4, ["revolute", "spherical", "prismatic"]).model
    for name, few in (("rnea", False), ("crba", True)):
        if few and chunk == 1:
            continue  # seconds to compile
        spec = numba_kernels.variant(SPECS[name], frozenset())
        program, layout = recording.record((spec,), model.bodies)[:2]
        values = random_inputs(model, spec, batch=(64,))
        values[0][5, 0] = np.nan
        values[0][11] *= 1.5
        monkeypatch.setattr(schedule, "MOST_WHOLE", len(program.lines))
        (whole,), valid = Runner(program, layout, shape)(*values)
        monkeypatch.setattr(schedule, "MOST_WHOLE", 0)
        monkeypatch.setattr(schedule, "CHUNK_LENGTH", chunk)
        monkeypatch.setattr(simd, "STORED", max(8, chunk))
        cut = Runner(program, layout, shape)
        (found,), also = cut(*values)
        assert cut.workspace > shape.lanes * 8
        np.testing.assert_array_equal(found, whole)
        np.testing.assert_array_equal(also, valid)
        assert not valid[5]
        assert valid.sum() < 64


def test_a_cut_program_of_every_operation_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    program, layout = program_of(lambda x, y, z: [*everything(x, y, z), *sin_and_cos(z), -scalars.sin(z)], 3)
    x = samples(48, seed=4)
    (whole,), _ = Runner(program, layout, Shape(4, False))(x)
    for chunk in (1, 2, 3, 5, 1000):
        monkeypatch.setattr(schedule, "MOST_WHOLE", 0)
        monkeypatch.setattr(schedule, "CHUNK_LENGTH", chunk)
        (found,), valid = Runner(program, layout, Shape(4, False))(x)
        np.testing.assert_array_equal(found, whole)
        assert valid.all()


def test_long_programs_with_bounds_load_their_numbers_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the same bits; what is held is spilled."""
    program, layout = program_of(lambda x, y: [0.3 * x + y, (0.3 * y - x) * (x + 0.3)], 2)
    bounded, x = replace(layout, bounds=1), samples(48, seed=4)[:, :2]
    (wanted,), _ = Runner(program, bounded, Shape(4, False))(x)
    for most, given, loads in ((len(program.lines), bounded, 0), (0, layout, 0), (0, bounded, 3)):
        monkeypatch.setattr(schedule, "MOST_HELD", most)
        assert simd.Writer(program, given, np.float64, 4, False).text().count("load volatile double") == loads
    (found,), _ = Runner(program, bounded, Shape(4, False))(x)
    np.testing.assert_array_equal(found, wanted)


def shared_by_two_sweeps(count: int) -> Callable[..., list[Any]]:
    """Each number is read on the way out and on the way back."""

    def run(x: Number) -> list[Any]:
        given = [0.5 + k / 1024 for k in range(count)]
        for number in (*given, *reversed(given)):
            x = x * number + 1.0
        return [x]

    return run


def used_up(count: int) -> Callable[..., list[Any]]:
    """Each number is read twice in a row."""

    def run(x: Number) -> list[Any]:
        for k in range(count):
            number = 0.5 + k / 1024
            x = (x * number + x) * number
        return [x]

    return run


def with_vectors(size: int, patch: pytest.MonkeyPatch) -> None:
    """Schedule programs as for a host with vectors of so many bytes."""
    patch.setattr(schedule, "host", lambda: ("", "", size, True))


def test_numbers_wanted_at_once_are_loaded_anew_with_wide_vectors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the same bits. Two sweeps want all numbers between them; it does not count how many there are."""
    most, found = schedule.MOST_NUMBERS, []
    x = samples(48, seed=4)[:, :1]
    for size, make, count, loads in (
        (64, shared_by_two_sweeps, most, 4 * most),
        (64, shared_by_two_sweeps, most - 2, 0),
        (64, used_up, 10 * most, 0),
        (32, shared_by_two_sweeps, most, 0),
    ):
        with_vectors(size, monkeypatch)
        program, layout = program_of(make(count), 1)
        text = simd.Writer(program, layout, np.float64, 4, False).text()
        assert text.count("load volatile double") == loads, (size, make, count)
        if count == most:
            found.append(Runner(program, layout, Shape(4, False))(x)[0][0])
        pivots, regions = replace(layout, pivots=((0, 0.0),)), copy(program)
        regions.regions = (Region(0, 0, 1, ()),)
        assert schedule.held(program, pivots)
        assert schedule.held(regions, layout)
        for whole in (True, False):
            one = simd.Writer(program, layout, np.float64, 1, False, whole=whole).text()
            assert one.count("load volatile double") == (0 if whole else loads)
        monkeypatch.setattr(schedule, "MOST_SOLVED", 0)  # then it is cut
        assert schedule.held(program, pivots) == (loads == 0)
        monkeypatch.undo()
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize(
    ("length", "numbers", "size", "whole"),
    [
        (schedule.MOST_WIDE - 200, 2, 64, True),
        (schedule.MOST_WIDE + 9, 2, 64, False),
        (schedule.MOST_WIDE + 9, 2, 32, True),
        (schedule.MOST_WIDE + 9, schedule.MOST_NUMBERS, 64, True),
        (schedule.MOST_ANEW + 9, schedule.MOST_NUMBERS, 64, False),
        (schedule.MOST_WHOLE + 9, schedule.MOST_NUMBERS, 32, False),
    ],
)
def test_longer_programs_are_cut_with_wide_vectors(
    length: int, numbers: int, size: int, whole: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At another length if they load their numbers anew; those with pivots, bounds or common inputs are not."""

    def run(x: Number, y: Number) -> list[Any]:
        for step in shared_by_two_sweeps(numbers)(x):
            x = step
        for _ in range(length - 3 * numbers - 3):
            x = x * y
        return [x, y]

    with_vectors(size, monkeypatch)
    program, layout = program_of(run, 2)
    assert len(program.lines) == length
    assert schedule.is_whole(program, layout) == whole
    assert len(schedule.Schedule(program, layout, whole).chunks) == (
        1 if whole else -(-(length - 3 - numbers) // schedule.CHUNK_LENGTH)
    )
    if length < schedule.MOST_WHOLE:
        for other in ({"pivots": ((1, 0.0),)}, {"bounds": 1}, {"common": (0,)}):
            assert schedule.is_whole(program, replace(layout, **other))


def test_slots_of_the_workspace_are_reused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A long chain of operations with few live values at a time."""

    def chain(x: Number, y: Number) -> list[Any]:
        for k in range(500):
            x, y = x * y + float(k), x
        return [x]

    monkeypatch.setattr(schedule, "MOST_WHOLE", 0)
    monkeypatch.setattr(schedule, "CHUNK_LENGTH", 10)
    writer = simd.Writer(*program_of(chain, 2), np.float64, 4, False)
    assert len(writer.schedule.chunks) >= 50
    assert writer.schedule.slot_count < 20


def test_forward_dynamics_is_cut_earlier_than_other_programs() -> None:
    """As soon as values are not computed near their readers, or a little before; its derivatives are not."""
    tape = Tape()
    x, y = tape.input(0), tape.input(1)
    for _ in range(schedule.MOST_SOLVED):
        x = x * y
    program = Program(tape, [x, y], 2)
    solved, not_solved = (KernelLayout((2,), (places,), pivots=((1, 0.0),)) for places in ((0,), (0, 0)))
    assert len(program.lines) > schedule.MOST_SOLVED
    assert not schedule.is_whole(program, solved)
    assert schedule.is_whole(program, not_solved)
    assert schedule.is_whole(program, KernelLayout((2,), ((0, 1),)))


# --- the bit of a sample --------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_sample_is_valid_by_itself(shape: Shape, dtype: Any) -> None:
    """NaN and inf in an input, though no result reads it; a result beyond the range; other samples are unchanged."""
    program, layout = program_of(lambda x, y, z: [x * x, x + 1.0], 3)
    x = np.ones((48, 3))
    invalid = {
        3: (2, np.nan),
        8: (1, np.inf),
        9: (1, -np.inf),
        21: (0, 1e200 if dtype is np.float64 else 1e30),
        47: (0, np.nan),
    }
    for k, (column, value) in invalid.items():
        x[k, column] = value
    (found,), valid = Runner(program, layout, shape, dtype)(x)
    np.testing.assert_array_equal(np.flatnonzero(~valid), list(invalid))
    np.testing.assert_array_equal(found[valid], [[1.0, 2.0]] * valid.sum())


def test_a_unit_part_is_valid_within_the_tolerance_of_its_square() -> None:
    program, layout = program_of(lambda *x: [x[0] + x[4]], 5, units=((0, 1), (2, 3, 4)))
    square = 1.0 + np.array([0.0, 1.9e-6, -1.9e-6, 2.1e-6, -2.1e-6, 3.0, -1.0, np.nan])
    with np.errstate(invalid="ignore"):
        side = np.sqrt(square)
    x = np.zeros((16, 5))
    x[:, 1] = x[:, 3] = 1.0
    x[:8, 1] = side
    x[8:, 3] = side
    _, valid = Runner(program, layout, Shape(8, host_cpu.host()[3]))(x)
    np.testing.assert_array_equal(valid, [True, True, True, False, False, False, False, False] * 2)


def test_a_pivot_is_valid_above_its_least_value() -> None:
    """A pivot need not be among the results that are written."""
    tape = Tape()
    x, y = tape.input(0), tape.input(1)
    layout = KernelLayout((2,), ((0,),), pivots=((1, 0.0), (2, 1e-3)))
    runner = Runner(Program(tape, [x + y, x * y, -x], 2), layout, Shape(4, False))
    pairs = [
        (-1.0, -1.0),
        (-1.0, 0.0),
        (-1.0, 1.0),
        (-1e-3, -1.0),
        (-1.1e-3, -1.0),
        (1.0, 1.0),
        (-np.nan, -1.0),
        (-1.0, -1),
    ]
    (found,), valid = runner(pairs)
    np.testing.assert_array_equal(valid, [True, False, False, False, True, False, False, True])
    assert found.shape == (8, 1)


def test_the_workspace_and_code_of_this_host_are_those_of_the_writer() -> None:
    program, layout = program_of(everything, 3)
    code, workspace = simd.compile_program(program, layout)
    assert LoadedCode(code).address("kernel")
    assert workspace == host_cpu.lanes_of(np.float64) * 8
    assert host_cpu.lanes_of(np.float32) == 2 * host_cpu.lanes_of(np.float64)
    assert simd.compile_program(program, layout)[0] == code


def test_object_code_without_a_kernel_is_refused() -> None:
    host_cpu.host()
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(jit=True)
    other = machine.emit_object(llvm.parse_assembly("define void @other() {\n  ret void\n}\n"))
    with pytest.raises(ValueError, match="no kernel"):
        LoadedCode(other).address("kernel")
