"""Bounds of calls hold against double-double, and are near the errors."""

from __future__ import annotations

import copy
import functools
import itertools
import math
import pickle
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
from slow import slow_but, thinned
from trees import random_tree

import spatialdyn as sd
from spatialdyn.accuracy.references import recorded_call
from spatialdyn.bodies.kinds import unit_parts
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.recursions import SPECS

pytestmark = pytest.mark.skipif(numba_kernels.PLAIN, reason="bounds are computed by programs")

SAMPLES = 1000
CALLS = ("rnea", "crba", "aba", "aba_refined", "crba_solve", "minverse", "generalized_gravity", "coriolis_matrix")


def rods(thin: float, count: int = 2) -> sd.Model:
    """Rods in a row, turned about x and y by turns, whose inertia about their own axis is next to nothing."""
    builder = sd.ModelBuilder()
    for i in range(count):
        inertia = (1.0, (0.25, 0.0, 0.0), np.diag([thin, 1 / 48, 1 / 48]))
        axis = ((1, 0, 0), (0, 1, 0))[i % 2]
        builder.add_body(f"l{i}", f"l{i - 1}" if i else None, "revolute", axis, (0.5 * i, 0, 0), inertia)
    return builder.build()


def chain(tip: float) -> sd.Model:
    """Five links about y, the last heavier."""
    builder = sd.ModelBuilder()
    for i in range(5):
        mass = tip if i == 4 else 1.0
        inertia = (mass, (0.2, 0.01, 0.0), np.diag([0.01, 0.02, 0.02]) * mass)
        builder.add_body(f"l{i}", f"l{i - 1}" if i else None, "revolute", (0, 1, 0), (0.4 * (i > 0), 0, 0), inertia)
    return builder.build()


MODELS: dict[str, Callable[[], sd.Model]] = {
    "two_link": lambda: sd.load_urdf("two_link"),
    "tree": lambda: random_tree(3, 4).model,
    "floating": lambda: random_tree(5, 3, floating=True).model,
    "ur5": lambda: sd.load_urdf("ur5"),
    "panda": lambda: sd.load_urdf("panda"),
    "z1": lambda: sd.load_urdf("z1"),
    "xarm7": lambda: sd.load_urdf("xarm7"),
    "thin": lambda: rods(1e-9),
    "tip 1e6": lambda: chain(1e6),
}
ARMS = {"two_link", "ur5", "panda", "z1", "xarm7"}
SHARP = {"rnea": 100.0, "crba": 40.0, "aba": 350.0, "aba_refined": 450.0, "minverse": 350.0}  # medians on arms
QUICK = [("ur5", "rnea"), ("ur5", "aba"), ("thin", "crba")]
PAIRS = [(name, call) for name in MODELS for call in CALLS if name not in ("z1", "xarm7") or call in SHARP]
ON_ARMS = [(name, call) for name, call in PAIRS if name in ("ur5", "panda") and call in SHARP]
CASES = thinned({*QUICK, *ON_ARMS}, PAIRS, 0)
DTYPES = np.float64, np.float32
BOTH = [(*case, dtype) for case in QUICK for dtype in DTYPES]
INFINITE = [("tip 1e6", "crba_solve")]  # in float32, as a warning says
IN_TURN = [
    (*case, np.float64 if case in INFINITE else DTYPES[k % 2])
    for k, case in enumerate(x for x in CASES if x not in QUICK)
]


def states(model: sd.Model, call: str, samples: int) -> list[np.ndarray]:
    """Inputs of a call: random, and a tenth each at right angles and at great speed."""
    rng = np.random.default_rng(7)
    q = np.array([sd.random_configuration(model, rng) for _ in range(samples)])
    tenth = samples // 10
    if model.nq == model.nv:
        q[:tenth] = rng.integers(-2, 3, (tenth, model.nq)) * (math.pi / 2)
    v, a = rng.standard_normal((2, samples, model.nv))
    v[tenth : 2 * tenth] *= 1e3
    count = len(recorded_inputs(call))
    return [q, v, a][:count]


def normed(model: sd.Model, q: np.ndarray) -> np.ndarray:
    """What to add to q for quaternions and (cos, sin) pairs of unit norm: 1 / |x| - 1 of each, by the first terms."""
    low = np.zeros_like(q)
    for part in unit_parts(model.bodies):
        x = q[:, list(part)]
        excess = np.array([[float(sum(Fraction(e) ** 2 for e in row) - 1)] for row in x.tolist()])
        low[:, list(part)] = x * (-0.5 * excess + 0.375 * excess**2)
    return low


def recorded_inputs(call: str) -> list[str]:
    spec = numba_kernels.variant(SPECS[call], frozenset())
    return [x.name for x in spec.present]


def checked(model: sd.Model, call: str, dtype: Any, samples: int = SAMPLES) -> tuple[np.ndarray, np.ndarray]:
    """(errors, bounds) of a call in random states, flat; the values are those of the call without bounds."""
    function = getattr(sd, call)
    given = states(model, call, samples)
    values, bounds = sd.bounded(model, function, dtype=dtype)(*(x.astype(dtype) for x in given))
    assert values.dtype == bounds.dtype == dtype
    plain = sd.specialize(model, function, dtype=dtype)(*(x.astype(dtype) for x in given))
    finite = np.isfinite(bounds)
    np.testing.assert_array_equal(np.where(finite, values, 0.0), np.where(finite, plain, 0.0))
    program, shape = recorded_call(model, call)
    lows = [normed(model, given[0]), *(0.0 * x for x in given[1:])]
    high, low = program(*(np.ascontiguousarray(np.concatenate(x, axis=1).T) for x in (given, lows)))
    high, low = (x.T.reshape((samples, *shape)) for x in (high, low))
    return abs((values.astype(np.float64) - high) - low).ravel(), bounds.astype(np.float64).ravel()


@pytest.mark.parametrize(("name", "call", "dtype"), slow_but(BOTH, [*BOTH, *IN_TURN]))
def test_no_error_is_above_its_bound(name: str, call: str, dtype: Any) -> None:
    errors, bounds = checked(MODELS[name](), call, dtype)
    assert (errors <= bounds).all()
    if name in ARMS and call in SHARP:
        assert np.isfinite(bounds).mean() > 0.99
        there = (errors > 0.0) & np.isfinite(bounds)
        assert np.median(bounds[there] / errors[there]) < SHARP[call]


def test_a_bound_below_the_error_would_be_seen() -> None:
    errors, bounds = checked(MODELS["ur5"](), "rnea", np.float64)
    assert (errors > bounds / 200.0).any()
    errors, bounds = checked(MODELS["ur5"](), "aba", np.float64)
    assert (errors > bounds / 2000.0).any()


def test_float32_bounds_hold_for_inputs_that_were_rounded_to_it() -> None:
    """As test_no_error_is_above_its_bound assumes, which passes float32 and has its truth at float64."""
    model = MODELS["ur5"]()
    given = states(model, "generalized_gravity", 200)
    k = sd.bounded(model, sd.generalized_gravity, dtype=np.float32)
    for one, two in zip(k(*given), k(*(x.astype(np.float32) for x in given)), strict=True):
        np.testing.assert_array_equal(one, two)


EXACT = [("two_link", "rnea"), ("ur5", "rnea"), ("panda", "rnea"), ("floating", "aba")]


@pytest.mark.parametrize(("name", "call"), slow_but(EXACT[:1], EXACT))
def test_bounds_of_exact_inputs_are_smaller_and_hold(name: str, call: str) -> None:
    """Inputs that are float32 numbers; others are refused, so that nothing is rounded and not counted."""
    model, function = MODELS[name](), getattr(sd, call)
    given = [x.astype(np.float32) for x in states(model, call, SAMPLES)]
    k = sd.bounded(model, function, dtype=np.float32, exact_inputs=True)
    values, bounds = k(*given)
    same, wider = sd.bounded(model, function, dtype=np.float32)(*given)
    np.testing.assert_array_equal(values, same)
    program, shape = recorded_call(model, call)
    exact = [x.astype(np.float64) for x in given]
    lows = [normed(model, exact[0]), *(0.0 * x for x in exact[1:])]
    high, low = program(*(np.ascontiguousarray(np.concatenate(x, axis=1).T) for x in (exact, lows)))
    high, low = (x.T.reshape((SAMPLES, *shape)) for x in (high, low))
    errors, known = abs((values.astype(np.float64) - high) - low), np.isfinite(bounds)
    assert known.mean() > 0.9
    assert (errors <= bounds).all()
    assert np.median(bounds[known] / wider[known]) < 0.85
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(k))(*given)[1], bounds)
    with pytest.raises(
        sd.SpatialDynError, match=r"q holds .*0\.1.*, expected numbers of float32, as exact_inputs=True"
    ):
        k(given[0] * 0.0 + np.float64(0.1), *given[1:])


def test_one_sample_batches_and_given_results_agree() -> None:
    model = MODELS["ur5"]()
    k = sd.bounded(model, sd.aba)
    given = [x[:40] for x in states(model, "aba", 40)]
    many = k(*given)
    out = np.empty((40, model.nv)), np.empty((40, model.nv))
    assert k(*given, out=out)[0] is out[0]
    for one, two in zip(many, out, strict=True):
        np.testing.assert_array_equal(one, two)
    for s in (0, 17):
        for one, two in zip(k(*(x[s] for x in given)), many, strict=True):
            np.testing.assert_array_equal(one, two[s])
    assert k.signature == "(q (nq,), v (nv,), tau (nv,)) -> (a (nv,), bound (nv,))"
    again = pickle.loads(pickle.dumps(k))
    np.testing.assert_array_equal(again(*given)[1], many[1])


def test_fixed_inputs_loads_and_selected_results_have_their_bounds() -> None:
    model = MODELS["ur5"]()
    q, v, tau = (x[:30] for x in states(model, "aba", 30))
    payload = np.array([1.5, 0.1, 0.0, 0.05, 0.01, 0.0, 0.0, 0.02, 0.0, 0.03])
    last = model.frames[-1].name
    k = sd.bounded(model, sd.aba, fixed={"v": 0}, inputs={"payload": last}, outputs=[0, 2])
    assert k.signature == f"(q (nq,), tau (nv,), payload:{last} (10,)) -> (a (2,), bound (2,))"
    a, bound = k(q, tau, payload)
    inertia = np.array([[0.01, 0, 0], [0, 0.02, 0], [0, 0, 0.03]])
    loaded = model.with_(payload={last: (1.5, payload[1:4], inertia)})
    exact = sd.exact(loaded, sd.aba, bits=200)
    for s in range(10):
        truth = exact(q[s], 0.0 * v[s], tau[s])[[0, 2]]
        off = [abs(float(t - float(x))) for t, x in zip(truth, a[s], strict=True)]
        assert (off <= bound[s]).all()
        assert (bound[s] < 1e-9 * abs(a[s]).max()).all()


def test_a_sample_beyond_the_program_has_an_infinite_bound() -> None:
    model = sd.load_urdf("two_link")
    k = sd.bounded(model, sd.rnea)
    q = np.array([[0.1, 0.2], [1e7, 0.2]])
    tau, bound = k(q, np.ones((2, 2)), np.zeros((2, 2)))
    assert np.isfinite(bound[0]).all()
    assert np.isinf(bound[1]).all()
    np.testing.assert_array_equal(tau[1], sd.rnea(model, q[1], np.ones(2), np.zeros(2)))


def test_where_most_bounds_are_infinite_in_float32_it_is_said_once() -> None:
    """A thin rod that turns about its own axis; NaN in a sample is the caller's, and counts for none."""
    builder = sd.ModelBuilder("drill")
    for i, axis in enumerate(((0, 0, 1), (0, 1, 0), (1, 0, 0))):
        rod = (1.0, (0.5, 0.0, 0.0), np.diag([1e-7, 1 / 12, 1 / 12]))
        builder.add_body(f"l{i}", f"l{i - 1}" if i else None, "revolute", axis, (float(i > 0), 0, 0), rod)
    model = builder.build()
    k, (q, v, tau) = sd.bounded(model, sd.aba, dtype=np.float32), np.random.default_rng(1).standard_normal((3, 5, 3))
    q[:3] = np.nan
    with pytest.warns(UserWarning, match='aba of "drill" has infinite bounds in float32 in 2 of 3 samples'):
        k(q[2:], v[2:], tau[2:])
    k(q[2:], v[2:], tau[2:])
    sd.bounded(model, sd.aba, dtype=np.float32)(q, v, tau)  # of two in five
    sd.bounded(model, sd.aba)(q, v, tau)
    ways = sd.specialize(model, sd.aba, dtype=np.float32, tolerance=1e-4).ways
    assert ways == ("float64", "double-double")
    assert sd.specialize(rods(1e-3), sd.aba, dtype=np.float32, tolerance=1e-9).ways[0] == "float32"


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_what_the_call_refuses_is_refused_in_its_words_and_nothing_else(dtype: Any) -> None:
    """Rods without inertia about their axes: M is singular at 0 alone, and known to no digit near it."""
    model, k = rods(0.0), sd.bounded(rods(0.0), sd.aba, dtype=dtype)
    q, v, tau = np.array([[0.3, 0.5], [0.0, 0.0], [0.2, 1e-8], [0.0, 0.0]], dtype), np.ones(2, dtype), np.ones(2, dtype)
    words = r'"l0_joint" has zero articulated inertia in sample 1, the first of'
    for call in (k, functools.partial(sd.aba, model)):
        with pytest.raises(sd.InertiaError, match=words):
            call(q, v, tau)
    a, bound = k(q[::2], v, tau)
    np.testing.assert_allclose(a, sd.aba(model, q[::2], v, tau), rtol=1e-4 if dtype == np.float32 else 1e-12)
    assert np.isfinite(bound[0]).all()
    assert np.isinf(bound[1]).all()
    q[1] = q[3] = np.nan
    a, bound = k(q, v, tau)
    assert np.isnan(a[1::2]).all()
    assert np.isinf(bound[1::2]).all()
    assert np.isfinite(bound[0]).all()


def test_the_bound_grows_with_the_condition_of_m() -> None:
    """A chain whose tip outweighs it up to 1e12 times: the bound grows, and always holds."""
    relative = []
    for tip in (1.0, 1e4, 1e8, 1e12):
        model = chain(tip)
        errors, bounds = checked(model, "aba", np.float64, 200)
        assert (errors <= bounds).all()
        relative.append(float(np.median(bounds)))
    assert all(a < b for a, b in itertools.pairwise(relative))


@pytest.mark.parametrize("count", [10, 40])
def test_bounds_of_a_chain_grow_with_each_body_and_are_of_use_up_to_forty(count: int) -> None:
    """The least and the largest growth per body: 1.2 and 1.6; the error of 40 bodies is a few roundings."""
    model, (q, v, a) = rods(0.01, count), np.random.default_rng(0).uniform(-1.0, 1.0, (3, count))
    tau, bound = sd.bounded(model, sd.rnea)(q, v, a)
    truth = sd.exact(model, sd.rnea, bits=200)(q, v, a)
    assert all(abs(float(t - float(x))) <= b for t, x, b in zip(truth, tau, bound, strict=True))
    relative = bound.max() / abs(tau).max()
    assert 2.0**-53 * 1.2**count < relative < 2.0**-53 * 40.0 * 1.6**count
    assert relative < 1e-3


@pytest.mark.slow(quick="test_no_error_is_above_its_bound")
def test_what_is_solved_for_is_near_what_solves_it() -> None:
    """A right angle, where entries of M are next to 0, of a robot whose rotations are orthogonal to rounding alone:
    minverse itself, in exact arithmetic, is off by more than its bound there.
    """
    model = sd.load_urdf("kinova")
    q = np.array([2.0, -1.0, -2.0, 2.0, -2.0, -1.0]) * (math.pi / 2)
    found, bound = sd.bounded(model, sd.minverse)(q)
    with mpmath.workprec(200):
        inverse = mpmath.matrix(sd.exact(model, sd.crba, bits=200)(q).tolist()) ** -1
        off = [abs(float(inverse[k] - x)) for k, x in zip(np.ndindex(6, 6), found.ravel().tolist(), strict=True)]
    assert (np.reshape(off, (6, 6)) <= bound).all()


def test_forces_and_frames_are_bounded_too() -> None:
    model = sd.load_urdf("two_link")
    q, v, a = np.array([0.3, -0.2]), np.array([1.0, 2.0]), np.array([0.1, 0.2])
    fext = np.random.default_rng(0).normal(size=(model.njoints, 6))
    k = sd.bounded(model, sd.rnea, inputs="fext")
    tau, bound = k(q, v, a, fext)
    truth = sd.exact(model, sd.rnea, bits=200)(q, v, a, fext)
    assert all(abs(float(t - float(x))) <= b for t, x, b in zip(truth, tau, bound, strict=True))
    a_, bound = sd.bounded(model, sd.aba, inputs="fext")(q, v, tau, fext)
    truth = sd.exact(model, sd.aba, bits=200)(q, v, tau, fext)
    assert all(abs(float(t - float(x))) <= b for t, x, b in zip(truth, a_, bound, strict=True))
    frame = model.frames[-1].name
    J, bound = sd.bounded(model, sd.frame_jacobian, frame=frame)(q)
    truth = sd.exact(model, sd.frame_jacobian, bits=200, frame=frame)(q)
    assert all(abs(float(t - float(x))) <= b for t, x, b in zip(truth.ravel(), J.ravel(), bound.ravel(), strict=True))


def test_what_has_no_bounds_is_named() -> None:
    model = sd.load_urdf("two_link")
    with pytest.raises(sd.SpatialDynError, match=r"aba_square_root .*has no program in float64"):
        sd.bounded(model, sd.aba_square_root)
    with pytest.raises(sd.SpatialDynError, match="expected one public call"):
        sd.bounded(model, [sd.rnea])  # type: ignore[arg-type]
    long = rods(0.01, 197)
    with pytest.raises(sd.SpatialDynError, match=r"with 197 rows .*, at most 196, expected .* bounds; sd\.exact "):
        sd.bounded(long, sd.aba)
    assert isinstance(sd.exact(long, sd.aba), sd.Exact)
    assert copy.copy(sd.bounded(model, sd.rnea)).engine == "lanes"
