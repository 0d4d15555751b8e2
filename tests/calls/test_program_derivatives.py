"""Derivatives along a direction and of weighted sums, of any call: against the analytic ones and complex steps."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from inputs import random_inputs
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.algebra import scalars
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.record.operations import DIV, FORMS, SELECT
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Tape
from spatialdyn.engines.programs.transform import derivative, derived
from spatialdyn.engines.programs.transform.derivative import jvp, vjp
from spatialdyn.recursions import SPECS

compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="derivatives are of programs")

MODELS: dict[str, Callable[[], sd.Model]] = {
    "two_link": lambda: sd.load_urdf("two_link"),
    "tree": lambda: random_tree(3, 3).model,
    "floating": lambda: random_tree(5, 3, floating=True).model,
    "panda": lambda: sd.load_urdf("panda"),
}
ANALYTIC = ("rnea", "aba")
CASES = [(name, call) for name in MODELS for call in ANALYTIC]


@compiled
@pytest.mark.parametrize(
    ("name", "call"), slow_but([("tree", "rnea"), ("floating", "rnea"), ("two_link", "aba")], CASES)
)
def test_both_equal_the_analytic_derivatives(name: str, call: str) -> None:
    model, rng = MODELS[name](), np.random.default_rng(3)
    given = random_inputs(model, numba_kernels.variant(SPECS[call], frozenset()), seed=4, batch=(20,))
    parts = getattr(sd, call + "_derivatives")(model, *given)
    forward = sd.specialize(model, getattr(sd, call), derivative="jvp")
    backward = sd.specialize(model, getattr(sd, call), derivative="vjp")
    along, weights = rng.standard_normal((3, 20, model.nv)), rng.standard_normal((20, model.nv))
    value, rate = forward(*given, *along)
    wanted = sum(np.einsum("sij,sj->si", parts[:, k], along[k]) for k in range(3))
    np.testing.assert_allclose(value, getattr(sd, call)(model, *given), rtol=1e-9, atol=1e-9 * abs(value).max())
    scale = abs(parts).max() * 10.0
    np.testing.assert_allclose(rate, wanted, rtol=0.0, atol=1e-12 * scale)
    same, *by = backward(*given, weights)
    np.testing.assert_array_equal(same.shape, value.shape)
    for k in range(3):
        wanted = np.einsum("sij,si->sj", parts[:, k], weights)
        np.testing.assert_allclose(by[k], wanted, rtol=0.0, atol=1e-12 * scale)
    plain = sd.specialize(model, getattr(sd, call)).operations
    for k in (forward, backward):
        assert count(k.operations) <= 3.0 * count(plain)


def count(operations: dict[str, int]) -> int:
    return sum(n for what, n in operations.items() if what != "depth")


# of the longest derivatives: of many results, each of whose weights is a sum more, or with few sums to share
LONGEST = ("crba", "minverse", "coriolis_matrix", "generalized_gravity", "forward_kinematics", "joint_jacobians")


@pytest.mark.parametrize("name", ["ur5", "panda", "ball joints", "floating"])
@pytest.mark.parametrize("call", LONGEST)
def test_both_take_three_times_the_operations_of_the_call(name: str, call: str) -> None:
    model = random_tree(2, 2).model if name == "ball joints" else MODELS.get(name, lambda: sd.load_urdf(name))()
    spec, bodies = numba_kernels.variant(SPECS[call], frozenset()), model.bodies
    own = count(recording.record((spec,), bodies).program.operations)
    for kind in ("jvp", "vjp"):
        made = derived.record((spec,), bodies, (), recording.ALL._replace(derivative=kind)).program
        assert count(made.operations) <= 3.0 * own


def test_the_derivative_of_a_turned_vector_is_the_other_way_turned() -> None:
    """By the angle: one product each, of values that the program has, where the chain rule takes four."""
    tape = Tape()
    x, y, angle = (tape.input(k) for k in range(3))
    s, c = scalars.sin(angle), scalars.cos(angle)
    program = Program(tape, [x * c + y * s, y * c - x * s, (x * y) * c - 3.0 * (y * y) * s], 3)
    made = Tape()
    values, rates = jvp(made, program, [made.input(k) for k in range(3)], [0.0, 0.0, made.input(3)])
    again = Program(made, [*values, *rates[:2]], 4)
    assert again.operations["mul"] == Program(made, values, 4).operations["mul"] + 2
    given = [0.3, -1.2, 0.7, 1.0]
    first, second, third = (float(x) for x in Program(made, rates, 4).run(given))
    one, other, _ = (float(x) for x in program.run(given))
    assert (first, second) == (other, -one)
    assert third == pytest.approx(0.36 * np.sin(0.7) - 4.32 * np.cos(0.7), abs=1e-15)
    made = Tape()
    _, by = vjp(made, program, [made.input(k) for k in range(3)], [made.input(3 + k) for k in range(3)])
    weights = np.array([0.2, -0.4, 0.9])
    found = Program(made, by, 6).run([*given[:3], *weights])
    by_third = [-1.2 * np.cos(0.7), 0.3 * np.cos(0.7) + 7.2 * np.sin(0.7)]
    wanted = weights @ [[np.cos(0.7), np.sin(0.7)], [-np.sin(0.7), np.cos(0.7)], by_third]
    np.testing.assert_allclose(np.array(found, float), [*wanted, weights @ [first, second, third]], atol=1e-15)


def test_a_nearly_right_angle_turns_as_one_rotation() -> None:
    """c + k s and s - k c, as of placements written with twelve digits: each is the other's derivative, at no cost."""
    tape = Tape()
    x, angle = tape.input(0), tape.input(1)
    s, c = scalars.sin(angle), scalars.cos(angle)
    program = Program(tape, [c + 1e-12 * s, s - 1e-12 * c, x * (s - 1e-12 * c)], 2)
    made = Tape()
    values, rates = jvp(made, program, [made.input(0), made.input(1)], [0.0, made.input(2)])
    own, both = (Program(made, y, 3).operations["mul"] for y in (values, [*values, *rates]))
    assert both == own + 3  # by the rate of the angle, the last one by that of s - k c
    first, second, third = (float(y) for y in Program(made, rates, 3).run([0.5, 0.7, 1.0]))
    assert (first, second) == pytest.approx((-np.sin(0.7), np.cos(0.7)), abs=2e-12)
    assert third == pytest.approx(0.5 * np.cos(0.7), abs=2e-12)


@compiled
@pytest.mark.parametrize("call", ["crba", "coriolis_matrix", "kinetic_energy", "center_of_mass", "generalized_gravity"])
def test_any_call_has_both_and_they_agree(call: str) -> None:
    """<weights, f' d> = <f'ᵀ weights, d>, and f' d is the difference quotient along q ∘ exp(h d)."""
    model, rng = MODELS["tree"](), np.random.default_rng(1)
    spec = numba_kernels.variant(SPECS[call], frozenset())
    given = random_inputs(model, spec, seed=2)
    function = getattr(sd, call)
    along = rng.standard_normal((len(given), model.nv))
    value, rate = sd.specialize(model, function, derivative="jvp")(*given, *along)
    weights = rng.standard_normal(np.shape(value))
    _, *by = sd.specialize(model, function, derivative="vjp")(*given, weights)
    forth = float(np.sum(weights * rate))
    assert sum(float(g @ d) for g, d in zip(by, along, strict=True)) == pytest.approx(forth, rel=1e-10, abs=1e-12)
    h = 1e-5

    def at(step: float) -> Any:
        q = sd.integrate(model, given[0], step * along[0])
        return function(model, q, *(x + step * d for x, d in zip(given[1:], along[1:], strict=True)))

    quotient = (at(h) - at(-h)) / (2.0 * h)
    np.testing.assert_allclose(rate, quotient, rtol=0.0, atol=1e-7 * max(1.0, np.abs(quotient).max()))


@compiled
@pytest.mark.parametrize("angle", [0.0, 1e-18, 1e-16, 1e-13, 1e-10, 1e-3])
def test_small_rotations_have_derivatives_of_all_digits(angle: float) -> None:
    """Of a step and of a difference, along a turn: what sin(θ)/θ rounds to is not divided by θ again."""
    builder = sd.ModelBuilder()
    builder.add_body("trunk", None, "floating", inertia=(1.0, (0.0, 0.0, 0.0), np.eye(3)))
    model, rng = builder.build(), np.random.default_rng(2)
    step, along = np.array([1.0, 2.0, 3.0, 0.6 * angle, 0.0, 0.8 * angle]), rng.standard_normal((2, 6))
    q = sd.random_configuration(model, rng)
    to, D = sd.integrate(model, q, step), sd.dintegrate(model, q, step)
    moved = sd.difference(model, to, sd.integrate(model, q, step + 1e-6 * along[1])) * 1e6
    _, rate = sd.specialize(model, sd.integrate, derivative="jvp")(q, step, np.zeros(6), along[1])
    np.testing.assert_allclose(moved, D[1] @ along[1], atol=1e-4)
    turned = sd.difference(model, to, sd.normalize(model, to + 1e-6 * rate)) * 1e6
    np.testing.assert_allclose(turned, D[1] @ along[1], atol=1e-4)
    wanted = np.einsum("kij,kj->i", sd.ddifference(model, q, to), along)
    _, rate = sd.specialize(model, sd.difference, derivative="jvp")(q, to, *along)
    np.testing.assert_allclose(rate, wanted, atol=1e-9)
    weights = rng.standard_normal(6)
    _, *by = sd.specialize(model, sd.difference, derivative="vjp")(q, to, weights)
    assert sum(float(g @ d) for g, d in zip(by, along, strict=True)) == pytest.approx(float(weights @ rate), abs=1e-9)


@compiled
def test_names_shapes_batches_and_loads() -> None:
    model = MODELS["floating"]()
    k = sd.specialize(model, sd.rnea, derivative="jvp", inputs="gravity")
    assert k.signature == (
        "(q (nq,), v (nv,), a (nv,), gravity (3,), dq (nv,), dv (nv,), da (nv,), dgravity (3,)) "
        "-> (tau (nv,), dtau (nv,))"
    )
    k = sd.specialize(model, [sd.rnea, sd.kinetic_energy], derivative="vjp", fixed={"v": 0})
    assert k.signature.startswith("(q (nq,), a (nv,), tau_bar (nv,), ")
    assert k.signature.endswith("q_bar (nv,), a_bar (nv,))")
    two = sd.load_urdf("two_link")
    k = sd.specialize(two, sd.rnea, derivative="vjp", inputs={"payload": two.frames[-1].name})
    q, v, a, load, w = [0.3, 0.1], [1.0, 2.0], [0.1, 0.2], [1.5, 0.1, 0, 0, 0, 0, 0, 0, 0, 0.1], [1.0, -2.0]
    _, *by = k(q, v, a, load, w)
    h = 1e-6
    more = [
        np.dot(w, k(q, v, a, np.array(load) + h * e, w)[0] - k(q, v, a, np.array(load) - h * e, w)[0])
        for e in np.eye(10)
    ]
    np.testing.assert_allclose(by[3], np.array(more) / (2 * h), atol=1e-7)
    wide = sd.specialize(two, sd.rnea, derivative="jvp")
    given = [np.ones((9, 2)) * x for x in (0.3, 0.2, 0.1, 1.0, 2.0, 3.0)]
    again = pickle.loads(pickle.dumps(wide))
    for one, other in zip(again(*(x[0] for x in given)), wide(*given), strict=True):
        np.testing.assert_array_equal(one, other[0])


@compiled
def test_what_has_no_derivative_is_named() -> None:
    model = sd.load_urdf("two_link")
    with pytest.raises(sd.SpatialDynError, match='derivative is \'grad\', expected "jvp", "vjp" or None'):
        sd.specialize(model, sd.rnea, derivative="grad")
    with pytest.raises(
        sd.SpatialDynError, match=r"aba_square_root .* has no program in float64, expected one for deriv"
    ):
        sd.specialize(model, sd.aba_square_root, derivative="jvp")
    long = sd.ModelBuilder("long")
    for k in range(363):
        long.add_body(f"{k}", f"{k - 1}" if k else None, "revolute", (0, 1, 0), None, (1.0, (0, 0, 0.5), np.eye(3)))
    k = sd.specialize(long.build(), sd.crba)
    for bridge in (k.to_torch, k.to_jax):
        with pytest.raises(sd.SpatialDynError, match=r"131769 results, at most 16384, .*; outputs= leaves some"):
            bridge()
    with pytest.raises(sd.SpatialDynError, match='crba of "long" has 131769 results, expected at most 131072 in'):
        k.c_code()
    k = sd.specialize(long.build(), sd.aba)
    with pytest.raises(sd.SpatialDynError, match=r"363 rows .*, at most 196, .* derivatives; sd\.aba_derivatives comp"):
        k.to_torch()
    with pytest.raises(sd.SpatialDynError, match="dtype is float32, expected float64 with a derivative"):
        sd.specialize(model, sd.rnea, derivative="jvp", dtype=np.float32)
    k = sd.specialize(model, sd.generalized_gravity, derivative="jvp")
    words = (
        "generalized_gravity has no derivative by its program{}, where the largest input is q with 1e\\+07: expected"
    )
    for q, where in (([[0.1, 0.2], [1e7, 0.0], [0.0, 2e7]], " in sample 1, the first of 2"), ([0.0, 1e7], "")):
        with pytest.raises(sd.SpatialDynError, match=words.format(where)):
            k(np.array(q), np.ones(2))
    assert np.isnan(k(np.array([[0.1, 0.2], [np.nan, 0.0]]), np.ones((2, 2)))[1][1]).any()
    free = MODELS["floating"]()
    with pytest.raises(sd.SpatialDynError, match="q has fixed entries, expected all or none"):
        sd.specialize(free, sd.rnea, derivative="jvp", fixed={"q": {free.joints[-1].name: 0.1}})


def test_each_operation_has_a_derivative_that_matters() -> None:
    assert set(derivative.PARTIALS) | {SELECT, DIV} == set(FORMS)


@pytest.mark.parametrize("code", sorted(FORMS))
def test_an_operations_derivative_is_its_difference_quotient(code: int) -> None:
    form, rng = FORMS[code], np.random.default_rng(code)
    given = 0.5 + rng.random(form.arity)

    def of(tape: Tape, x: list[Any]) -> Any:
        from spatialdyn.engines.programs.record.replay import record

        return record(tape, code, x)

    tape = Tape()
    program = Program(tape, [of(tape, [tape.input(k) for k in range(form.arity)])], form.arity, fuse=False)
    for k in range(form.arity):
        made = Tape()
        inputs = [made.input(j) for j in range(form.arity)]
        tangents = [made.number(1.0) if j == k else 0.0 for j in range(form.arity)]
        _, (rate,) = jvp(made, program, inputs, tangents)
        (forward,) = Program(made, [rate], form.arity).run(given)
        made = Tape()
        inputs = [made.input(j) for j in range(form.arity)]
        _, by = vjp(made, program, inputs, [made.number(1.0)])
        (backward,) = Program(made, [by[k]], form.arity).run(given)
        h = 1e-6 * np.eye(form.arity)[k]
        quotient = (float(form.numpy(*(given + h))) - float(form.numpy(*(given - h)))) / 2e-6
        assert float(forward) == pytest.approx(quotient, abs=1e-8)
        assert float(backward) == pytest.approx(quotient, abs=1e-8)


@compiled
def test_a_planar_joint_moves_along_its_twist() -> None:
    """Its coordinates are numbers and still no vector space: x and y of a twist turn with the body."""
    builder = sd.ModelBuilder("puck")
    builder.add_body("puck", None, "planar", (0, 0, 1), inertia=(2.0, (0.3, 0.1, 0.0), 0.5 * np.eye(3)))
    builder.add_body("lid", "puck", "planar", (0, 0.6, 0.8), inertia=(1.0, (0.1, 0.2, 0.1), 0.2 * np.eye(3)))
    model = builder.build()
    q, v, a, d = np.random.default_rng(3).normal(size=(4, 6))
    _, dtau = sd.specialize(model, sd.rnea, derivative="jvp")(q, v, a, d, 0.0 * d, 0.0 * d)
    wanted = sd.rnea_derivatives(model, q, v, a)[0] @ d
    np.testing.assert_allclose(dtau, wanted, rtol=0, atol=1e-12 * abs(wanted).max())
