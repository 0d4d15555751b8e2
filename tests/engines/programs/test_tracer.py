"""The tracer: constant folding, shared operations, and programs that agree with the recursion."""

from __future__ import annotations

import gc
import math
import operator
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from inputs import EPS, MAIN_CALLS, kernel_inputs, options, public, random_inputs, sorted_inputs
from numpy.typing import NDArray
from robots import ROBOTS
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.algebra import scalars
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record import operations, recording
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Number, Tape
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import Spec

Array = NDArray[np.float64]
ROUNDING = 64 * EPS  # of the largest entry: both round the same equations, one with fused products
CONDITIONED = 1e-9  # the same after solving for the accelerations of a random tree, as in test_numba_kernels
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
    assert len(tape.lines) == 9  # the constant 2 and one product
    assert same(-2.0 * x, -(x * 2.0))  # the constant of the other sign is at hand
    assert len(tape.lines) == 9
    assert (-3.0 * x).minus is False  # else a constant keeps its sign: other numbers have the same structure
    assert same(y - 3.0 * x, y + -3.0 * x)


def test_sine_and_cosine_of_an_angle_are_written_once_each() -> None:
    tape, (x,) = tape_of(1)
    assert same(scalars.sin(-x), -scalars.sin(x))
    assert same(scalars.cos(-x), scalars.cos(x))
    program = Program(tape, [scalars.sin(x), scalars.cos(-x), scalars.sin(-x) * scalars.cos(x)], 1)
    assert program.operations["sincos"] == 1
    assert len([op for op in program.lines if op.code in (operations.SIN, operations.COS)]) == 2


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


def test_exp_keeps_the_sign_of_its_argument_and_is_written_once() -> None:
    tape, (x,) = tape_of(1)
    program = Program(tape, [scalars.exp(-x), scalars.exp(x) * scalars.exp(x)], 1)
    assert program.operations["exp"] == 2
    found = program.run([np.array([0.0, 2.0])])
    np.testing.assert_array_equal(found[0], np.exp([-0.0, -2.0]))


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


@pytest.mark.parametrize("use", [bool, float, int, hash, math.sin, np.sin, lambda x: x in (1.0,), lambda x: x**2])
def test_a_recorded_value_is_no_truth_and_no_float(use: Callable[[Any], Any]) -> None:
    _, (x,) = tape_of(1)
    with pytest.raises(TypeError):
        use(x)


def test_numpy_scalars_leave_the_arithmetic_to_numbers() -> None:
    tape, (x,) = tape_of(1)
    made = [np.float64(2.0) * x, np.float64(2.0) + x, np.float64(2.0) - x, np.float64(2.0) / x, x / np.float64(2.0)]
    assert all(isinstance(y, Number) for y in made)
    assert [float(y) for y in Program(tape, made, 1).run([5.0])] == [10.0, 7.0, -3.0, 0.4, 2.5]


# --- recursions -----------------------------------------------------------------------------------------


def static_values(model: sd.Model, spec: Spec) -> list[Any]:
    """The static inputs of a call, as the tests of the engine choose them."""
    values = kernel_inputs(model, spec, [None] * len(sorted_inputs(spec)))  # type: ignore[list-item]
    return [value for x, value in zip(spec.present, values, strict=True) if x.static]


def run_program(model: sd.Model, spec: Spec, values: list[Array]) -> Array:
    """The program of a call in NumPy; values as of ``random_inputs``, of one batch axis."""
    program = recording.record((spec,), model.bodies, static_values(model, spec)).program
    by_name = dict(zip((x.name for x in sorted_inputs(spec)), values, strict=True))
    n = len(values[0]) if values else 1
    columns = [np.reshape(by_name[x.name], (n, -1)).T for x in spec.present if not x.static]
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


@pytest.mark.parametrize("name", slow_but(MAIN_CALLS, [name for name, spec in SPECS.items() if spec.traceable]))
def test_program_in_numpy_equals_the_untraced_call(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    values = random_inputs(model, spec, batch=(7,))
    expected = public(model, spec, values)
    found = run_program(model, spec, values)
    assert deviation(found if values else found[0], expected) <= (CONDITIONED if spec.pivots else ROUNDING)


@pytest.mark.parametrize("name", ["rnea", "aba", "generalized_gravity", "static_torque"])
def test_program_without_the_optional_inputs_equals_the_untraced_call(model: sd.Model, name: str) -> None:
    spec = numba_kernels.variant(SPECS[name], frozenset())
    assert len(spec.present) <= len(SPECS[name].present)
    values = random_inputs(model, spec, batch=(5,))
    expected = public(model, spec, values)
    assert deviation(run_program(model, spec, values), expected) <= (CONDITIONED if spec.pivots else ROUNDING)


def test_several_calls_share_one_program(model: sd.Model) -> None:
    """An input of one name is one input; the kinematics are computed once."""
    specs = tuple(numba_kernels.variant(SPECS[name], frozenset()) for name in ("crba", "nonlinear_effects"))
    alone = [recording.record((spec,), model.bodies).program for spec in specs]
    both = recording.record(specs, model.bodies)
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
        recording.record((SPECS[name],), model.bodies)
    assert model.bodies.tobytes() == before


def test_two_recordings_are_the_same_program(model: sd.Model) -> None:
    first, second = (recording.record((SPECS["aba"],), model.bodies) for _ in range(2))
    assert first.program.lines == second.program.lines
    assert first.program.outputs == second.program.outputs
    assert first.layout == second.layout


@pytest.mark.parametrize("on", [True, False])
def test_the_garbage_collector_is_off_while_a_program_is_recorded(on: bool) -> None:
    """And as it was before when that is done, or fails; nothing recorded waits for it."""
    model, spec, seen = random_tree(3, 3).model, SPECS["aba"], []
    recursion = spec.recursion

    def watched(*arguments: Any) -> None:
        seen.append(gc.isenabled())
        recursion(*arguments)
        if len(seen) == 2:
            raise ZeroDivisionError

    assert gc.isenabled()
    try:
        if not on:
            gc.disable()
        recording.record((replace(spec, recursion=watched),), model.bodies)
        assert gc.isenabled() == on
        with pytest.raises(ZeroDivisionError):
            recording.record((replace(spec, recursion=watched),), model.bodies)
        assert gc.isenabled() == on
    finally:
        gc.enable()
    assert seen == [False, False]


@pytest.mark.slow(quick="test_program_in_numpy_equals_the_untraced_call")
def test_recording_leaves_no_garbage_in_cycles() -> None:
    model = random_tree(3, 3).model
    recording.record((SPECS["aba"],), model.bodies)  # what a first call alone makes
    gc.disable()
    while gc.collect():  # what finalizers leave is found by the next
        pass
    try:
        recording.record((SPECS["aba"],), model.bodies)
        assert gc.collect() == 0
    finally:
        gc.enable()


def test_what_a_recursion_branches_on_is_no_recorded_value(model: sd.Model) -> None:
    """Every traceable call records; frame options stay constants."""
    for spec in SPECS.values():
        if spec.traceable:
            recording.record((spec,), model.bodies, static_values(model, spec))
        else:
            assert not recording.fits((spec,), model.bodies)
            with pytest.raises(sd.SpatialDynError, match="branches on values"):
                recording.record((spec,), model.bodies)
        assert set(options(model, spec)) <= {"frame", "reference", "classical"}


OPERATIONS = {("ur5", "crba"): 170, ("ur5", "rnea"): 280, ("ur5", "aba"): 700, ("panda", "rnea"): 720}  # mul + add


@pytest.mark.skipif(not ROBOTS, reason="example-robot-data is not installed")
@pytest.mark.parametrize(("robot", "name"), OPERATIONS)
def test_programs_have_no_more_operations_than(robot: str, name: str) -> None:
    program = recording.record((numba_kernels.variant(SPECS[name], frozenset()),), sd.load_urdf(robot).bodies).program
    assert program.operations["mul"] + program.operations["add"] <= OPERATIONS[robot, name]


def test_the_pendulum_needs_what_its_equation_needs() -> None:
    """τ = (I + m l²) q̈ + m g l sin q: two products, a sum and a sine."""
    builder = sd.ModelBuilder("pendulum")
    builder.add_body("b", axis=(0, 1, 0), inertia=(2.0, (0.0, 0.0, -0.5), 0.1 * np.eye(3)))
    model = builder.build()
    spec = numba_kernels.variant(SPECS["rnea"], frozenset())
    program = recording.record((spec,), model.bodies).program
    counts = program.operations
    assert (counts["sincos"], counts["div"], counts["sqrt"]) == (1, 0, 0)
    assert counts["mul"] + counts["add"] <= 8
    (tau,) = program.run([0.3, 5.0, 2.0])
    assert tau == pytest.approx(0.6 * 2.0 + 2.0 * 9.81 * 0.5 * math.sin(0.3), rel=8 * EPS, abs=0.0)


CORPUS = {name: path for name, path in ROBOTS.items() if name != "ur3"}
FLOATING_TOO = ("anymal", "solo12", "iris_simple", "ur5")
SINGULAR = {"romeo", "romeo_laas_small"}  # their aba raises


ROOTED = [*((name, "fixed") for name in CORPUS), *((x, "floating") for x in FLOATING_TOO if x in CORPUS)]


@pytest.mark.parametrize(("name", "root"), slow_but([*ROOTED[::10], *ROOTED[len(CORPUS) :: 2]], ROOTED))
def test_programs_of_every_robot_equal_the_untraced_calls(name: str, root: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of inertias that no body can have
        model = sd.load_urdf(CORPUS[name], root=root)
    if model.nv == 0:
        assert not recording.fits((SPECS["rnea"],), model.bodies)
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
