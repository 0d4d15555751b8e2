"""Answers within a tolerance: the promise is kept, by the way that the report says, or it is refused by name."""

from __future__ import annotations

import pickle
import re
from typing import Any

import numpy as np
import pytest
from trees import random_tree

import spatialdyn as sd
from spatialdyn.accuracy.references import recorded_call
from spatialdyn.calls import promise
from spatialdyn.calls.promise import Promise
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.numbers.enclosures import Enclosure, Zeros
from spatialdyn.recursions import SPECS

pytestmark = pytest.mark.skipif(numba_kernels.PLAIN, reason="bounds are of programs")

N = 400


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    return random_tree(3, 3, kinds=("revolute", "prismatic"), branching=0.0).model


def states(model: sd.Model, n: int = N) -> list[np.ndarray]:
    rng = np.random.default_rng(5)
    return [rng.uniform(-3.0, 3.0, (n, model.nq)), *rng.standard_normal((2, n, model.nv))]


def truth(model: sd.Model, call: str, given: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The exact results in double-double, by the interpreter that is held against mpmath: high and low."""
    program, shape = recorded_call(model, call)
    return tuple(x.T.reshape((-1, *shape)) for x in program(np.ascontiguousarray(np.concatenate(given, 1).T)))


def relative_errors(found: np.ndarray, exact: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    high, low = (x.reshape(len(found), -1) for x in exact)
    off = abs((found.reshape(len(found), -1) - high) - low)
    return np.asarray(off.max(1) / abs(high).max(1))


def heavy(tip: float) -> sd.Model:
    """Three links about y, the last heavier."""
    builder = sd.ModelBuilder()
    for i in range(3):
        mass = tip if i == 2 else 1.0
        inertia = (mass, (0.2, 0.01, 0.0), np.diag([0.01, 0.02, 0.02]) * mass)
        builder.add_body(f"l{i}", f"l{i - 1}" if i else None, "revolute", (0, 1, 0), (0.4 * (i > 0), 0, 0), inertia)
    return builder.build()


def blocks(k: Promise) -> dict[str, int]:
    return {way: count for way, count in k.report.items() if count}


@pytest.mark.parametrize("call", ["rnea", "crba", "aba"])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-9, 3e-15, 1.2e-16])
def test_the_promise_is_kept(arm: sd.Model, call: str, tolerance: float) -> None:
    given = states(arm)[: 1 if call == "crba" else 3]
    k = sd.specialize(arm, getattr(sd, call), dtype=np.float32, tolerance=tolerance)
    found = k(*given)
    assert found.dtype == np.float64
    assert relative_errors(found, truth(arm, call, given)).max() <= tolerance
    ways = blocks(k)
    assert sum(ways.values()) == N
    assert list(k.report) == list(k.ways)
    only = {1e-3: "float32", 1e-9: "float64", 1.2e-16: "double-double"}
    if tolerance in only:
        assert ways == {only[tolerance]: N}


@pytest.mark.parametrize("tolerance", [1e-4, 1e-13])
def test_each_sample_has_the_bits_of_its_way_wherever_it_stands(arm: sd.Model, tolerance: float) -> None:
    k, given = sd.specialize(arm, sd.aba, dtype=np.float32, tolerance=tolerance), states(arm)
    found = k(*given)
    ways = blocks(k)
    assert len(ways) == 2  # a tolerance that splits the batch
    narrow = sd.specialize(arm, sd.aba, dtype=np.float32)(*(x.astype(np.float32) for x in given))
    bits = {
        "float32": narrow.astype(float), "float64": sd.specialize(arm, sd.aba)(*given),
        "double-double": truth(arm, "aba", given)[0],
    }  # fmt: skip
    same = {way: int((found == bits[way]).all(1).sum()) for way in ways}
    assert all(same[way] >= ways[way] for way in ways)
    assert (np.any([(found == bits[way]).all(1) for way in ways], axis=0)).all()
    for n in (0, 7, 151):
        np.testing.assert_array_equal(k(*(x[n] for x in given)), found[n])
    np.testing.assert_array_equal(k(*(x[::-1] for x in given)), found[::-1])
    far = [np.concatenate([x, x[:1] * (1e40 if j == 1 else 1.0)]) for j, x in enumerate(given)]
    np.testing.assert_array_equal(k(*far)[:N], found)  # one that float32 cannot hold moves no other


def test_where_no_bound_holds_the_samples_are_named() -> None:
    """With a constant input there is no double-double, and a heavy tip leaves float64 few digits."""
    model = heavy(1e8)
    q, v, _ = states(model, 40)
    values, bounds = sd.bounded(model, sd.aba, fixed={"tau": 0.0})(q, v)
    tolerance = float(f"{np.median(bounds.max(1) / abs(values).max(1)):.1e}")
    k = sd.specialize(model, sd.aba, tolerance=tolerance, fixed={"tau": 0.0})
    within = re.escape(f"aba is not known within {tolerance:g} of the largest entry")
    pattern = rf"{within} in samples ((\d+, )+\d+) and \d+ others: bound "
    with pytest.raises(sd.SpatialDynError, match=pattern) as raised:
        k(q, v)
    found = re.match(pattern, str(raised.value))
    assert found is not None
    named = [int(x) for x in found[1].split(", ")]
    lost = ~(bounds.max(1) * (1.0 + tolerance) <= tolerance * abs(values).max(1))
    np.testing.assert_array_equal(np.flatnonzero(lost)[:8], named)
    assert blocks(k) == {}  # nothing was answered
    with pytest.raises(sd.SpatialDynError, match=rf"{within}: bound .*float64$"):
        k(q[named[0]], v[named[0]])
    with pytest.raises(sd.SpatialDynError, match=rf"{within} in samples \(0, 0\), .* in sample \(0, 0\), by"):
        k(q[lost][:4].reshape(2, 2, -1), v[lost][:4].reshape(2, 2, -1))
    kept = np.flatnonzero(~lost)
    assert len(kept)
    k(q[kept], v[kept])
    assert blocks(k) == {"float64": len(kept)}


def test_double_double_answers_where_float64_has_lost_its_digits() -> None:
    model = heavy(1e6)
    given, k = states(model, 60), sd.specialize(model, sd.aba, tolerance=1e-13)
    found = k(*given)
    assert blocks(k)["double-double"] > 10
    assert relative_errors(found, truth(model, "aba", given)).max() <= 1e-13


def test_where_no_way_has_a_bound_the_input_is_named() -> None:
    k = sd.specialize(sd.load_urdf("two_link"), sd.rnea, tolerance=1e-9)
    words = "no way has a bound where q has 1.0e+200, by float64, double-double"
    with pytest.raises(sd.SpatialDynError, match=re.escape(words)):
        k([1e200, 0.3], [1.0, 2.0], [0.0, 0.0])


def test_what_only_one_program_has_is_named(arm: sd.Model) -> None:
    k = sd.specialize(arm, sd.rnea, tolerance=1e-9)
    for name in ("c_code", "to_casadi", "operations", "to_jax", "to_torch"):
        bounds = (
            "$" if name in ("to_jax", "to_torch") else ", .* sd.bounded\\("
        )  # those two differentiate results alone
        with pytest.raises(
            AttributeError, match=f"a Promise has no {name}: .* sd.specialize\\(model, sd.rnea\\).{name}{bounds}"
        ):
            getattr(k, name)
    with pytest.raises(AttributeError, match="'Promise' object has no attribute 'unknown'"):
        k.__getattr__("unknown")


def test_a_result_near_zero_needs_an_absolute_tolerance() -> None:
    model = sd.load_urdf("two_link")
    up = [np.pi / 2, 0.0]
    assert abs(sd.generalized_gravity(model, up)).max() < 1e-14
    with pytest.raises(sd.SpatialDynError, match=r"is not known within 1e-40 of the largest entry: .* double-double$"):
        sd.specialize(model, sd.generalized_gravity, tolerance=1e-40)(up)
    weightless = model.with_(gravity=(0.0, 0.0, 0.0))
    still = [0.3, 0.1], [1e-200, 0.0]  # of the order of 1e-400: a float64 of 0, and not 0
    with pytest.raises(sd.SpatialDynError, match=r"bound .* of 0.0e\+00, by .*; tolerance=\(0.5, absolute\) allows"):
        sd.specialize(weightless, sd.kinetic_energy, tolerance=0.5)(*still)
    k = sd.specialize(model, sd.generalized_gravity, tolerance=(1e-20, 1e-13))
    np.testing.assert_allclose(k(up), 0.0, rtol=0.0, atol=1e-13)
    assert repr(k).startswith('<Promise generalized_gravity of "two_link" within 1e-20 and 1e-13: ')


def test_a_result_that_is_zero_is_answered() -> None:
    """At rest, among others and with rest as a constant, of quaternions too; a bound is never 0."""
    model = sd.load_urdf("two_link")
    q, v, _ = states(model, 5)
    v[1:4] = 0.0
    k = sd.specialize(model, sd.coriolis_matrix, tolerance=1e-12)
    assert (sd.bounded(model, sd.coriolis_matrix)(q, v)[1][1:4] > 0.0).all()
    np.testing.assert_array_equal(k(q, v), sd.specialize(model, sd.coriolis_matrix)(q, v))
    assert blocks(k) == {"float64": 5}
    fixed = sd.specialize(model, sd.coriolis_matrix, tolerance=1e-12, fixed={"v": 0.0}, outputs=[0])
    np.testing.assert_array_equal(fixed(q), 0.0)
    ball = random_tree(5, 1, floating=True).model
    rest = sd.specialize(ball, sd.kinetic_energy, tolerance=1e-12)
    assert rest(sd.random_configuration(ball, np.random.default_rng(0)), np.zeros(ball.nv)) == 0.0


@pytest.mark.parametrize("call", ["rnea", "crba", "aba", "minverse", "coriolis_matrix"])
def test_zeros_are_those_of_exact_arithmetic(arm: sd.Model, call: str) -> None:
    """What is called 0 is 0 in 300 bits; of the inputs some are 0."""
    spec = numba_kernels.variant(SPECS[call], frozenset())
    given = states(arm, 12)[: len(spec.present)]
    for k in range(12):
        for x in given:
            x[k] *= [k & 1, k & 2, k & 4] if k < 8 else 0.0
    found, exact = Zeros(spec, arm.bodies)(given), sd.exact(arm, getattr(sd, call), bits=300)
    for k in range(12):
        wanted = np.ravel(exact(*(x[k] for x in given)))
        assert not any(zero and x != 0 for zero, x in zip(found[k].tolist(), wanted, strict=True))
    assert call != "coriolis_matrix" or found[8:].all()


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf])
def test_nan_and_infinity_stay_in_their_sample_and_are_no_answer(arm: sd.Model, odd: float) -> None:
    given, k = states(arm, 5), sd.specialize(arm, sd.rnea, dtype=np.float32, tolerance=1e-4)
    whole = k(*given)
    given[1][2, 0] = odd
    found = k(*given)
    np.testing.assert_array_equal(found[2], sd.rnea(arm, *(x[2] for x in given)))  # NaN
    assert np.isnan(found[2]).any()
    np.testing.assert_array_equal(np.delete(found, 2, 0), np.delete(whole, 2, 0))
    assert blocks(k) == {"float32": 9}


def test_errors_of_values_name_the_place_in_the_whole_batch() -> None:
    builder = sd.ModelBuilder()
    builder.add_body("slider", None, "prismatic", (1, 0, 0), None, (1e-3, (0, 0, 0), 1e-3 * np.eye(3)))
    model = builder.build()
    k = sd.specialize(model, sd.aba, dtype=np.float32, tolerance=1e-4)
    given = [np.zeros((6, 1)), np.zeros((6, 1)), np.ones((6, 1))]
    given[2][4] = 1e307
    assert "float32" in k.ways
    with pytest.raises(sd.NonFiniteError, match="in sample 4, expected"):
        k(*given)


def test_inputs_shapes_and_out_are_those_of_any_call(arm: sd.Model) -> None:
    k = sd.specialize(arm, sd.rnea, tolerance=1e-9, inputs=f"mass:{arm.names[2]}")
    assert k.signature == f"(q (nq,), v (nv,), a (nv,), mass:{arm.names[2]} ()) -> tau (nv,)"
    assert k.ways == ("float64",)  # with parameters there is no double-double
    q, v, a = states(arm, 6)
    mass = np.array([1.0, 2.0])[:, None]
    found = k(q, v[0], a, mass)
    assert found.shape == (2, 6, 3)
    wanted = sd.specialize(arm, sd.rnea, inputs=f"mass:{arm.names[2]}")(q, v[0], a, mass)
    np.testing.assert_array_equal(found, wanted)
    out = np.empty((2, 6, 3))
    assert k(q, v[0], a, mass, out=out) is out
    np.testing.assert_array_equal(out, wanted)
    assert k(q[:0], v[0], a[:0], 1.0).shape == (0, 3)
    energy = sd.specialize(arm, sd.kinetic_energy, tolerance=1e-9)
    assert energy(q[0], v[0]) == sd.specialize(arm, sd.kinetic_energy)(q[0], v[0])
    for wrong, error in (
        ((q, v), TypeError),
        ((q[:, :2], v, a, 1.0), sd.ShapeError),
        ((q, v[:5], a, 1.0), sd.ShapeError),
    ):
        with pytest.raises(error):
            k(*wrong)
    for bad in (np.empty(3), np.empty((2, 6, 3), np.float32), [0.0]):
        with pytest.raises(sd.ShapeError, match="out is"):
            k(q, v[0], a, mass, out=bad)


@pytest.mark.parametrize("call", ["frame_placement", "frame_jacobian"])
def test_frames_have_double_double(arm: sd.Model, call: str) -> None:
    """Of a frame off its joint, in the world's axes; no float64 is that near."""
    words = {"frame": arm.frames[-1].name, **({"reference": "world"} if call == "frame_jacobian" else {})}
    q = states(arm, 6)[0]
    k = sd.specialize(arm, getattr(sd, call), tolerance=1.2e-16, **words)
    found = k(q)
    assert k.report["double-double"] == 6
    exact = np.array([sd.exact(arm, getattr(sd, call), **words)(x) for x in q])
    np.testing.assert_array_equal(found, exact.astype(float))


def test_quaternions_have_no_double_double_but_bounds() -> None:
    model = random_tree(5, 2, floating=True).model
    rng = np.random.default_rng(0)
    q = sd.random_configuration(model, rng, (20,))
    v, a = rng.standard_normal((2, 20, model.nv))
    k = sd.specialize(model, sd.rnea, tolerance=1e-11)
    assert k.ways == ("float64",)
    np.testing.assert_array_equal(k(q, v, a), sd.specialize(model, sd.rnea)(q, v, a))


@pytest.mark.parametrize("call", ["rnea", "aba", "minverse"])
def test_enclosures_hold_the_exact_result(arm: sd.Model, call: str) -> None:
    """The running bound alone, of any call: far below float64's rounding, above the error in 60 bits more."""
    spec = numba_kernels.variant(SPECS[call], frozenset())
    given = states(arm, 8)[: len(spec.present)]
    high, low, bound = Enclosure(spec, arm.bodies)(given)
    exact = sd.exact(arm, getattr(sd, call), bits=240)
    worst = 0.0
    for k in range(len(high)):
        wanted = np.ravel(exact(*(x[k] for x in given)))
        for h, l, b, x in zip(high[k].tolist(), low[k].tolist(), bound[k].tolist(), wanted, strict=True):
            error = float(abs(x - h - l))
            assert error <= b
            worst = max(worst, error / b if b else 0.0)
    assert worst > 1e-5  # a bound ten thousand times smaller would not hold
    assert (bound <= 1e-25 * abs(high).max()).all()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"tolerance": 0.0}, "tolerance is 0.0, expected a number above 0 and below 1, or "),
        ({"tolerance": 1.5}, "tolerance is 1.5, expected"),
        ({"tolerance": (1e-9, -1.0)}, "tolerance is .*, expected"),
        ({"tolerance": "1e-9"}, "tolerance is '1e-9', expected"),
        ({"tolerance": 1e-9, "derivative": "vjp"}, "tolerance is 1e-09 with a derivative, expected one call"),
    ],
)
def test_what_cannot_be_promised_is_refused(arm: sd.Model, words: dict[str, Any], message: str) -> None:
    with pytest.raises(sd.SpatialDynError, match=message):
        sd.specialize(arm, sd.aba, **words)
    with pytest.raises(sd.SpatialDynError, match="with several calls"):
        sd.specialize(arm, [sd.aba, sd.rnea], tolerance=1e-9)


def test_float32_is_tried_first_where_it_is_cheaper_or_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what is solved for, from so many freedoms on, where most states hold in it."""
    model = sd.load_urdf("two_link")
    assert sd.specialize(model, sd.aba, tolerance=1e-3).ways == ("float64", "double-double")
    monkeypatch.setattr(promise, "LEAST_SOLVED", 2)
    assert sd.specialize(model, sd.aba, tolerance=1e-3).ways == ("float32", "float64", "double-double")
    assert sd.specialize(model, sd.aba, tolerance=1e-6).ways == ("float64", "double-double")
    assert sd.specialize(model, sd.rnea, tolerance=1e-3).ways == ("float64", "double-double")
    assert sd.specialize(model, sd.rnea, dtype=np.float32, tolerance=1e-9).ways[0] == "float32"


def test_a_promise_is_pickled_by_what_made_it(arm: sd.Model) -> None:
    k, given = sd.specialize(arm, sd.rnea, tolerance=(1e-9, 1e-9)), [x[0] for x in states(arm, 1)]
    again = pickle.loads(pickle.dumps(k))
    assert again.tolerance == (1e-9, 1e-9)
    np.testing.assert_array_equal(again(*given), k(*given))
