"""The tracer: what folds away, what is shared, and that the line that remains computes what the recursion does."""

from __future__ import annotations

import math
import operator
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from test_engine import EPS, kernel_inputs, options, public, random_inputs, sorted_inputs
from trees import random_tree

import spatialdyn as sd
from spatialdyn.algebra import scalars
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs import batch_kernels, tracer
from spatialdyn.engines.programs.tracer import Number, Program, Tape
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import Spec
from spatialdyn.urdf.load import example_robots, robot_names

Array = NDArray[np.float64]
ROUNDING = 64 * EPS  # of the largest entry: both round the same equations, one with fused products
CONDITIONED = 1e-9  # the same after solving for the accelerations of a random tree, as in test_engine
SOLVED_ROBOTS = 1e-11  # residual of M q̈ = τ, of the sum of |M| |q̈|: real robots' q̈ alone are too ill-conditioned


def tape_of(n: int) -> tuple[Tape, list[Number]]:
    """A tape with n inputs."""
    tape = Tape()
    return tape, [tape.input(k) for k in range(n)]


def same(x: Any, y: Any) -> bool:
    """Whether two Numbers are one line with one sign."""
    return (x.line, x.minus) == (y.line, y.minus)


# --- folding --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("zero", [0, 0.0, -0.0, np.float64(0.0)])
def test_zero_is_absorbed(zero: Any) -> None:
    tape, (x,) = tape_of(1)
    assert same(x + zero, x)
    assert same(zero + x, x)
    assert same(x - zero, x)
    assert same(zero - x, -x)
    for product in (x * zero, zero * x, zero / x):
        assert type(product) is float
        assert product == 0.0
    assert len(tape.lines) == 1


@pytest.mark.parametrize("one", [1, 1.0, np.float64(1.0)])
def test_one_is_absorbed_and_minus_one_is_a_sign(one: Any) -> None:
    tape, (x,) = tape_of(1)
    assert all(same(y, x) for y in (x * one, one * x, x / one))
    assert all(same(y, -x) for y in (x * -one, -one * x, x / -one))
    assert same(-(x * -1.0), x)
    assert len(tape.lines) == 1


def test_a_number_less_itself_is_zero_and_over_itself_one() -> None:
    tape, (x, y) = tape_of(2)
    written = len(tape.lines)
    assert [x - x, x + -x, -x + x, -x - -x] == [0.0] * 4
    assert [x / x, -x / x, x / -x, -x / -x] == [1.0, -1.0, -1.0, 1.0]
    assert len(tape.lines) == written
    product = x * y
    assert y * x - product == 0.0
    assert (x + y) - (y + x) == 0.0


def test_a_number_times_its_inverse_is_one() -> None:
    _, (x,) = tape_of(1)
    assert [x * (1.0 / x), (1.0 / x) * x, -x * (1.0 / x), x * (-1.0 / x), x * (1.0 / -x)] == [
        1.0,
        1.0,
        -1.0,
        -1.0,
        -1.0,
    ]


def test_a_number_times_another_inverse_is_not_one() -> None:
    """1/y, and 2/x: neither is the inverse of x."""
    _, (x, y) = tape_of(2)
    assert isinstance(x * (1.0 / y), Number)
    assert isinstance(x * (2.0 / x), Number)


def test_equal_operations_are_one_line_whatever_their_order_and_sign() -> None:
    tape, (x, y) = tape_of(2)
    assert same(x + y, y + x)
    assert same(-x - y, -(x + y))
    assert same(x - y, -(y - x))
    assert len(tape.lines) == 4
    assert all(same(p, x * y) for p in (y * x, -x * -y, -(x * -y)))
    assert len(tape.lines) == 5
    assert same(-x / y, -(x / y))
    assert same(x / -y, -(x / y))
    assert not same(x / y, y / x)
    assert len(tape.lines) == 7
    assert same(2.0 * x, x * 2.0)
    assert same(-2.0 * x, -(x * 2.0))
    assert len(tape.lines) == 9  # the constant 2 and one product


def test_sine_and_cosine_of_an_angle_are_written_once_each() -> None:
    tape, (x,) = tape_of(1)
    assert same(scalars.sin(-x), -scalars.sin(x))
    assert same(scalars.cos(-x), scalars.cos(x))
    program = Program(tape, [scalars.sin(x), scalars.cos(-x), scalars.sin(-x) * scalars.cos(x)], 1)
    assert program.operations["sincos"] == 1
    assert len([op for op in program.lines if op.code in (tracer.SIN, tracer.COS)]) == 2


def test_sqrt_atan2_and_select_keep_the_signs_of_their_arguments() -> None:
    tape, (x, y) = tape_of(2)
    results = [scalars.sqrt(-x), scalars.sqrt(x), scalars.atan2(-y, x), scalars.atan2(y, -x)]
    results += [scalars.select(-x, -y, 3.0), scalars.select(x, -2.0, -y), scalars.atan2(y, 1.0)]
    program = Program(tape, results, 2)
    a, b = np.array([4.0, -9.0]), np.array([0.5, 2.0])
    found = program.run([a, b])
    wanted = [
        [math.nan, 3.0], [2.0, math.nan], np.arctan2(-b, a), np.arctan2(b, -a), [3.0, -2.0], [-2.0, -2.0],
        np.arctan2(b, 1.0),
    ]  # fmt: skip
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(one, other)


def test_select_at_zero_and_nan_takes_the_second() -> None:
    tape, (x,) = tape_of(1)
    program = Program(tape, [scalars.select(x, 1.0, 2.0)], 1)
    np.testing.assert_array_equal(program.run([np.array([1e-300, 0.0, -0.0, -1.0, np.nan])])[0], [1, 2, 2, 2, 2])


@pytest.mark.parametrize("operation", [operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne])
def test_a_recorded_value_has_no_order(operation: Callable[[Any, Any], Any]) -> None:
    _, (x, y) = tape_of(2)
    for other in (y, x, 0.0, np.float64(1.0)):
        with pytest.raises(TypeError, match=r"no truth and no order; a recursion chooses with scalars\.select"):
            operation(x, other)
        with pytest.raises(TypeError, match="no truth and no order"):
            operation(other, x)


@pytest.mark.parametrize("use", [bool, float, int, hash, abs, math.sin, np.sin, lambda x: x in (1.0,), lambda x: x**2])
def test_a_recorded_value_is_no_truth_and_no_float(use: Callable[[Any], Any]) -> None:
    _, (x,) = tape_of(1)
    with pytest.raises(TypeError):
        use(x)


def test_numpy_scalars_leave_the_arithmetic_to_numbers() -> None:
    tape, (x,) = tape_of(1)
    made = [np.float64(2.0) * x, np.float64(2.0) + x, np.float64(2.0) - x, np.float64(2.0) / x, x / np.float64(2.0)]
    assert all(isinstance(y, Number) for y in made)
    assert [float(y) for y in Program(tape, made, 1).run([5.0])] == [10.0, 7.0, -3.0, 0.4, 2.5]


# --- programs -------------------------------------------------------------------------------------------


def test_dead_lines_are_dropped_and_inputs_stay_counted() -> None:
    tape, (x, y, z) = tape_of(3)
    scalars.sin(y) / z
    program = Program(tape, [x + z], 3)
    assert [op.code for op in program.lines] == [tracer.INPUT, tracer.INPUT, tracer.ADD]
    assert [op.a for op in program.lines[:2]] == [0, 2]
    assert program.inputs == 3
    assert program.run([1.0, np.nan, 2.0]) == [3.0]


def test_lines_that_only_a_negated_operand_needs_stay() -> None:
    tape, (x, y) = tape_of(2)
    assert Program(tape, [scalars.sqrt(-(x - y * 2.0))], 2).run([1.0, 5.0]) == [3.0]
    assert Program(tape, [scalars.select(x, -(y * y), 0.0)], 2).run([1.0, 5.0])[0] == -25.0


def test_outputs_may_be_constants_inputs_negated_and_repeated() -> None:
    tape, (x,) = tape_of(1)
    program = Program(tape, [0.0, -2.5, x, -x, x, 1], 1)
    assert program.run([7.0]) == [0.0, -2.5, 7.0, -7.0, 7.0, 1.0]
    assert program.operations["depth"] == 0


def test_listing_and_counts_of_a_small_program() -> None:
    tape, (x, y) = tape_of(2)
    s = scalars.sin(x)
    program = Program(tape, [s * y + 2.0, -(s / y), scalars.sqrt(-y), scalars.select(x, -y, s)], 2)
    assert program.listing().splitlines() == [
        "x0 = input[0]",
        "x1 = input[1]",
        "x2 = sin(x0)",
        "x3 = 2.0",
        "x4 = fma(x1, x2, x3)",
        "x5 = x2 / x1",
        "x6 = sqrt(-x1)",
        "x7 = select(x0, -x1, x2)",
        "output[0] = x4",
        "output[1] = -x5",
        "output[2] = x6",
        "output[3] = x7",
    ]
    assert program.operations == dict(mul=1, add=1, div=1, sqrt=1, sincos=1, atan2=0, select=1, depth=2)


def test_a_product_of_one_use_joins_its_sum() -> None:
    for expression, name, value in (
        (lambda x, y, z: x * y + z, "fma", 13.0),
        (lambda x, y, z: z + y * x, "fma", 13.0),
        (lambda x, y, z: x * y - z, "fnma", -1.0),
        (lambda x, y, z: z - x * y, "fnma", 1.0),
        (lambda x, y, z: (z + y) * x - (z - y), "f", 16.0),
    ):
        tape, inputs = tape_of(3)
        program = Program(tape, [expression(*inputs)], 3)
        fused = [tracer.NAMES[op.code] for op in program.lines if op.code in (tracer.FMA, tracer.FMS, tracer.FNMA)]
        assert len(fused) == 1
        assert fused[0].startswith(name)
        assert not any(op.code == tracer.MUL for op in program.lines)
        assert program.run([2.0, 3.0, 7.0]) == [value]
        plain = Program(tape, [expression(*inputs)], 3, fuse=False)
        assert plain.run([2.0, 3.0, 7.0]) == [value]
        assert plain.operations["mul"] == program.operations["mul"] == 1
        assert plain.operations["add"] == program.operations["add"]


def test_a_product_of_more_uses_stays() -> None:
    for outputs in (
        lambda x, y, z: [x * y + z, x * y],
        lambda x, y, z: [x * y + z, x * y - z],
        lambda x, y, z: [x * y + x * y],
        lambda x, y, z: [x * y + z, scalars.sqrt(-(x * y))],
    ):
        tape, inputs = tape_of(3)
        program = Program(tape, outputs(*inputs), 3)
        assert sum(op.code == tracer.MUL for op in program.lines) == 1
        assert not any(op.code in (tracer.FMA, tracer.FMS, tracer.FNMA) for op in program.lines)


def test_of_two_products_the_sum_takes_one() -> None:
    tape, (x, y, z) = tape_of(3)
    for sum_, value in ((x * y + y * z, 27.0), (x * y - y * z, -15.0), (y * z - x * y, 15.0)):
        program = Program(tape, [sum_], 3)
        assert program.operations["mul"] == 2
        assert len(program.lines) == 5  # three inputs, a product, a fused sum
        assert program.run([2.0, 3.0, 7.0]) == [value]


@pytest.mark.parametrize("seed", range(20))
def test_random_expressions_are_computed_to_the_bit(seed: int) -> None:
    """+ - * / and select of signs and constants as floats have them: the fused sums too, which NumPy rounds twice."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=5).tolist()
    tape, numbers = tape_of(5)
    pool: list[tuple[Any, float]] = list(zip(numbers, values, strict=True))
    for _ in range(60):
        (a, x), (b, y), (c, z) = (pool[k] for k in rng.integers(len(pool), size=3))
        if rng.random() < 0.2:
            b = y = float(rng.choice([0.0, 1.0, -1.0, 2.0, -0.3]))
        if rng.random() < 0.3:
            a, x = -a, -x
        kind = rng.integers(5)
        if kind == 0:
            pool.append((a + b, x + y))
        elif kind == 1:
            pool.append((b - a, y - x))
        elif kind == 2:
            pool.append((a * b, x * y))
        elif kind == 3 and isinstance(a, Number) and isinstance(b, Number) and y != 0.0:
            pool.append((a / b, x / y))
        elif isinstance(a, Number):
            pool.append((scalars.select(a, b, c), y if x > 0.0 else z))
    results, wanted = zip(*pool[5:], strict=True)
    for fuse in (True, False):
        np.testing.assert_array_equal(Program(tape, results, 5, fuse).run(values), wanted)


# --- recursions -----------------------------------------------------------------------------------------


def static_values(model: sd.Model, spec: Spec) -> list[Any]:
    """The static inputs of a call, as the tests of the engine choose them."""
    values = kernel_inputs(model, spec, [None] * len(sorted_inputs(spec)))  # type: ignore[list-item]
    return [value for x, value in zip(spec.given, values, strict=True) if x.static]


def run_program(model: sd.Model, spec: Spec, values: list[Array]) -> Array:
    """The program of a call in NumPy; values as of ``random_inputs``, of one batch axis."""
    program = batch_kernels.record((spec,), model.bodies, static_values(model, spec)).program
    by_name = dict(zip((x.name for x in sorted_inputs(spec)), values, strict=True))
    n = len(values[0]) if values else 1
    columns = [np.reshape(by_name[x.name], (n, -1)).T for x in spec.given if not x.static]
    results = program.run(list(np.concatenate(columns)) if columns else [])
    core = batches_shape(model, spec)
    size = math.prod(core)
    return np.array([np.broadcast_to(x, n) for x in results[:size]]).T.reshape(n, *core)


def batches_shape(model: sd.Model, spec: Spec) -> tuple[int, ...]:
    """Shape of one sample of the output of a call."""
    known = {"nq": model.nq, "nv": model.nv, "njoints": model.njoints}
    return tuple(known[s] if isinstance(s, str) else s for s in spec.output.shape)


def deviation(x: Any, y: Any) -> float:
    """The largest difference, of the largest entry or 1."""
    x, y = np.asarray(x), np.asarray(y)
    assert x.shape == y.shape
    return float(abs(x - y).max(initial=0.0) / max(1.0, abs(y).max(initial=0.0)))


@pytest.fixture(scope="module", params=["fixed", "floating, cos_sin"])
def model(request: pytest.FixtureRequest) -> sd.Model:
    """A tree with every kind of joint."""
    floating = request.param != "fixed"
    made = random_tree(108, 6, floating=floating, continuous="cos_sin" if floating else "angle").model
    assert len({j.kind for j in made.joints[1:]}) == 6
    return made


@pytest.mark.parametrize("name", [name for name, spec in SPECS.items() if spec.traces])
def test_program_in_numpy_equals_the_untraced_call(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    values = random_inputs(model, spec, batch=(7,))
    expected = public(model, spec, values)
    found = run_program(model, spec, values)
    assert deviation(found if values else found[0], expected) <= (CONDITIONED if spec.pivots else ROUNDING)


@pytest.mark.parametrize("name", ["rnea", "aba", "generalized_gravity", "static_torque"])
def test_program_without_the_optional_inputs_equals_the_untraced_call(model: sd.Model, name: str) -> None:
    spec = numba_kernels.variant(SPECS[name], frozenset())
    assert len(spec.given) <= len(SPECS[name].given)
    values = random_inputs(model, spec, batch=(5,))
    expected = public(model, spec, values)
    assert deviation(run_program(model, spec, values), expected) <= (CONDITIONED if spec.pivots else ROUNDING)


def test_several_calls_share_one_program(model: sd.Model) -> None:
    """An input of one name is one input; the kinematics are computed once."""
    specs = tuple(numba_kernels.variant(SPECS[name], frozenset()) for name in ("crba", "nonlinear_effects"))
    alone = [batch_kernels.record((spec,), model.bodies).program for spec in specs]
    both = batch_kernels.record(specs, model.bodies)
    assert both.layout.inputs == (model.nq, model.nv)
    assert [len(places) for places in both.layout.outputs] == [model.nv**2, model.nv]
    count = [p.operations["mul"] + p.operations["add"] for p in (*alone, both.program)]
    assert count[2] < count[0] + count[1]
    rng = np.random.default_rng(0)
    q, v = sd.random_configuration(model, rng, (4,)), rng.normal(size=(4, model.nv))
    results = [np.broadcast_to(x, 4) for x in both.program.run([*q.T, *v.T])]
    M = np.array([results[k] for k in both.layout.outputs[0]]).T.reshape(4, model.nv, model.nv)
    bias = np.array([results[k] for k in both.layout.outputs[1]]).T
    assert deviation(M, sd.crba(model, q)) <= ROUNDING
    assert deviation(bias, sd.nonlinear_effects(model, q, v)) <= ROUNDING


def test_recording_leaves_the_table_as_it_was(model: sd.Model) -> None:
    before = model.bodies.tobytes()
    for name in ("rnea", "aba", "forward_kinematics"):
        batch_kernels.record((SPECS[name],), model.bodies)
    assert model.bodies.tobytes() == before


def test_two_recordings_are_the_same_program(model: sd.Model) -> None:
    first, second = (batch_kernels.record((SPECS["aba"],), model.bodies) for _ in range(2))
    assert first.program.lines == second.program.lines
    assert first.program.outputs == second.program.outputs
    assert first.layout == second.layout


def test_what_a_recursion_branches_on_is_no_recorded_value(model: sd.Model) -> None:
    """Every call records, but those that say they cannot; the frame options reach it as what they are."""
    for spec in SPECS.values():
        if spec.traces:
            batch_kernels.record((spec,), model.bodies, static_values(model, spec))
        else:
            assert not batch_kernels.fits((spec,), model.bodies)
            with pytest.raises(sd.SpatialDynError, match="branches on values"):
                batch_kernels.record((spec,), model.bodies)
        assert set(options(model, spec)) <= {"frame", "reference", "classical"}


OPERATIONS = {("ur5", "crba"): 170, ("ur5", "rnea"): 280, ("ur5", "aba"): 700, ("panda", "rnea"): 720}  # mul + add


@pytest.mark.skipif(not example_robots(), reason="example-robot-data is not installed")
@pytest.mark.parametrize(("robot", "name"), OPERATIONS)
def test_programs_have_no_more_operations_than(robot: str, name: str) -> None:
    program = batch_kernels.record(
        (numba_kernels.variant(SPECS[name], frozenset()),), sd.load_urdf(robot).bodies
    ).program
    assert program.operations["mul"] + program.operations["add"] <= OPERATIONS[robot, name]


def test_the_pendulum_needs_what_its_equation_needs() -> None:
    """τ = (I + m l²) q̈ + m g l sin q: two products, a sum and a sine."""
    builder = sd.ModelBuilder("pendulum")
    builder.add_body("b", axis=(0, 1, 0), inertia=(2.0, (0.0, 0.0, -0.5), 0.1 * np.eye(3)))
    model = builder.build()
    spec = numba_kernels.variant(SPECS["rnea"], frozenset())
    program = batch_kernels.record((spec,), model.bodies).program
    counts = program.operations
    assert (counts["sincos"], counts["div"], counts["sqrt"]) == (1, 0, 0)
    assert counts["mul"] + counts["add"] <= 8
    (tau,) = program.run([0.3, 5.0, 2.0])
    assert tau == pytest.approx(0.6 * 2.0 + 2.0 * 9.81 * 0.5 * math.sin(0.3), rel=8 * EPS)


CORPUS = {name: path for name, path in robot_names().items() if path in set(example_robots()) and name != "ur3"}
FLOATING_TOO = ("anymal", "solo12", "iris_simple", "ur5")
SINGULAR = {"romeo", "romeo_laas_small"}  # their aba raises


@pytest.mark.parametrize(
    ("name", "root"), [*((name, "fixed") for name in CORPUS), *((x, "floating") for x in FLOATING_TOO if x in CORPUS)]
)
def test_programs_of_every_robot_equal_the_untraced_calls(name: str, root: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of inertias that no body can have
        model = sd.load_urdf(CORPUS[name], root=root)
    if model.nv == 0:
        assert not batch_kernels.fits((SPECS["rnea"],), model.bodies)
        return
    for call in ("rnea", "crba", "aba"):
        spec = numba_kernels.variant(SPECS[call], frozenset())
        if call == "aba" and name in SINGULAR:
            continue
        values = random_inputs(model, spec, seed=1, batch=(3,))
        found = run_program(model, spec, values)
        if call != "aba":
            assert deviation(found, public(model, spec, values)) <= ROUNDING
            continue
        q, v, tau = values
        M, rest = sd.crba(model, q), tau - sd.nonlinear_effects(model, q, v)
        residual = abs((M @ found[..., None])[..., 0] - rest)
        scale = (abs(M) @ abs(found)[..., None])[..., 0]
        assert (residual <= SOLVED_ROBOTS * np.maximum(scale.max(axis=-1, keepdims=True), 1.0)).all()
