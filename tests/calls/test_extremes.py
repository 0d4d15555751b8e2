"""Every physical state is computed to the stated digits, or refused by name: never NaN, never a crash."""

from __future__ import annotations

import itertools
import sys
import warnings
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from slow import slow_but

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
if not (BENCHMARKS / "accuracy.py").exists():
    pytest.skip("the benchmarks are not here", allow_module_level=True)
sys.path.insert(0, str(BENCHMARKS))

from accuracy import EPS, State, chain, error, inputs, measured, state  # noqa: E402

# Of the largest entry. Of forward dynamics times a scaled condition number up to 1e4, at 5 to 7 bodies.
BOUND = {"rnea": 16 * EPS, "crba": 16 * EPS, "aba": 1e3 * EPS}
FLOAT32 = 2.0**29  # eps of float32 in those of float64
TINY, HUGE = (float(x) for x in (np.finfo(np.float32).tiny, np.finfo(np.float32).max))
LEAST = 2.0**-149  # of float32
INERTIA = np.array([[0.02, 0.001, 0.0], [0.001, 0.03, 0.002], [0.0, 0.002, 0.025]])
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")


def arm(mass: float = 1.0, size: float = 1.0, n: int = 5, tilt: float = 0.0, **options: Any) -> sd.Model:
    """Hinges about x, y, z in turn, a slide among them; ``tilt`` turns every axis by that much."""
    builder = sd.ModelBuilder("arm")
    for k in range(n):
        axis = np.eye(3)[k % 3] + tilt * np.eye(3)[(k + 1) % 3]
        body = (mass, (0.1 * size, 0.05 * size, 0.2 * size), mass * size * size * INERTIA)
        place = (0.0, 0.1 * size, 0.5 * size) if k else None
        builder.add_body(
            f"b{k:04d}", f"b{k - 1:04d}" if k else None, ("revolute", "prismatic")[k == 3], axis, place, body
        )
    return builder.build(**options)


def usual(model: sd.Model, size: float = 1.0) -> State:
    """A state whose slide moves by about the arm's size."""
    s = state(model, np.random.default_rng(1))
    for x in s[:3]:
        x[3] *= size
    return s


def held(model: sd.Model, s: State, scale: float = 1.0) -> None:
    """Each call, alone, in a batch and in float32, is finite and within its bound."""
    for name, bound in BOUND.items():
        assert measured(model, name, s) <= scale * bound, name
        if not numba_kernels.PLAIN:
            assert measured(model, name, s, in_a_batch(name)) <= scale * bound, name
    if not numba_kernels.PLAIN:
        in_float32(model, s, scale)


def in_a_batch(name: str) -> Any:
    """The public call on a batch that runs on lanes; its first sample."""
    return lambda model, *x: getattr(sd, name)(model, *(np.tile(e, (520, 1)) for e in x))[0]


def narrowed(x: np.ndarray) -> np.ndarray:
    """Rounded to float32, but for entries that it has no digits of."""
    with np.errstate(over="ignore"):
        rounded = x.astype(np.float32).astype(float)
    return np.where(np.isfinite(rounded) & (abs(rounded) >= TINY), rounded, x)


def in_float32(model: sd.Model, s: State, scale: float = 1.0) -> None:
    """Programs of float32: within the bound at float32's rounding, or an error that says what is out of range."""
    rounded = State(*map(narrowed, s))
    for name, bound in BOUND.items():
        program = sd.specialize(model, getattr(sd, name), dtype=np.float32)
        given = inputs(name, rounded)
        try:
            found = program(*given)
        except sd.NonFiniteError as refused:
            assert "float32" in str(refused)  # noqa: PT017 - either way is an answer
            assert max(abs(x).max(initial=0.0) for x in (*given, getattr(sd, name)(model, *given))) > HUGE
            continue
        truth = sd.exact(model, getattr(sd, name))(*given)
        off = np.sign(truth - found) * np.minimum(abs(truth - found), LEAST)  # rounding to 1.4e-45 at the end
        assert error(name, found + off, truth) <= FLOAT32 * scale * bound, name


@pytest.mark.parametrize("speed", [1e-300, 1e-160, 1e-30, 1e-3, 1e3, 1e30, 1e100])
def test_any_speed(speed: float) -> None:
    model = arm()
    s = usual(model)
    held(model, s._replace(v=s.v * speed))
    for gravity in (1e6, 0.0) if speed > 1e-150 else (1e6,):  # of nothing but squares below 1e-308 no digits are left
        held(model.with_(gravity=(0.0, 0.0, -gravity)), s._replace(v=s.v * speed, tau=0 * s.tau))


@pytest.mark.parametrize("gravity", [0.0, 1e-30, 1e6])
def test_any_gravity(gravity: float) -> None:
    model = arm(gravity=(0.0, 0.0, -gravity))
    s = usual(model)
    held(model, s)
    held(model, s._replace(v=0 * s.v, a=0 * s.a, tau=0 * s.tau))


@pytest.mark.parametrize("angle", [1e-300, 1e-9, 1e3, 1e5, 1.1e5, 1e9, 1e15])
def test_any_angle(angle: float) -> None:
    """Beyond 1e5 the table kernel recomputes the sample with libm's sine."""
    model = chain(5, True)
    s = state(model, np.random.default_rng(1))
    held(model, s._replace(q=angle * s.q))


@pytest.mark.parametrize("mass", [1e-300, 1e-9, 1e-3, 1e9, 1e200])
@pytest.mark.parametrize("size", slow_but([1.0], [1e-3, 1.0, 1e3]))
def test_any_mass_and_size(mass: float, size: float) -> None:
    model = arm(mass, size)
    s = usual(model, size)
    held(model, s._replace(tau=s.tau * mass * size * size))


def test_denormal_masses_lose_digits_and_nothing_else() -> None:
    """2⁻¹⁰⁷⁴ kg is the least float: a mass of 1e-310 has four digits fewer than usual."""
    model = arm(1e-310)
    s = usual(model)
    assert measured(model, "rnea", s) <= 1e-10
    assert np.isfinite(sd.crba(model, s.q)).all()
    with pytest.raises((sd.InertiaError, sd.NonFiniteError)):  # 1/D overflows
        sd.aba(model, s.q, s.v, s.tau)


@pytest.mark.parametrize("method", ["aba", "crba", "refined", "square_root"])
def test_an_inertia_whose_reciprocal_overflows_is_one_error_by_every_method(method: str) -> None:
    model = arm(1e-310)
    s = usual(model)
    with pytest.raises(sd.InertiaError, match="has zero articulated inertia: zero to rounding"):
        sd.forward_dynamics(model, s.q, s.v, s.tau, method=method)


@pytest.mark.parametrize("q", [0.0, 1e-9, np.pi, np.pi / 2])
def test_straight_and_folded_poses(q: float) -> None:
    for spatial in (False, True):
        model = chain(6, spatial)
        s = state(model, np.random.default_rng(2))
        held(model, s._replace(q=np.full(6, q)), scale=10)


def test_links_of_no_length() -> None:
    builder = sd.ModelBuilder("wrist")
    for k in range(6):
        parent = f"b{k - 1}" if k else None
        builder.add_body(f"b{k}", parent, "revolute", np.eye(3)[k % 3], None, (1.0, (0.0, 0.0, 0.1), INERTIA))
    model = builder.build()
    held(model, state(model, np.random.default_rng(3)), scale=10)


@pytest.mark.parametrize("tilt", slow_but([0.0, 1e-16, 1e-8], [0.0, 1e-17, 1e-16, 1e-15, 1e-12, 1e-8]))
def test_axes_next_to_a_coordinate_axis(tilt: float) -> None:
    model = arm(tilt=tilt)
    held(model, usual(model))


LENGTHS = (1, 2, 3, 10, 30, 100, 2000)


@pytest.mark.parametrize("n", slow_but((1, 3, 30), LENGTHS))
def test_any_length(n: int) -> None:
    """In float32 from 10 links on the digits of q̈ go, not those of the torques that it takes: to its rounding."""
    model = chain(n, True)
    s = state(model, np.random.default_rng(4))
    s = State(*map(narrowed, s))
    for eps in (EPS,) if numba_kernels.PLAIN else (EPS, FLOAT32 * EPS):
        call = sd.aba if eps == EPS else lambda _, *x: sd.specialize(model, sd.aba, dtype=np.float32)(*x).astype(float)
        a = call(model, s.q, s.v, s.tau)
        back = sd.rnea(model, s.q, s.v, a)
        terms = abs(sd.rnea(model, s.q, s.v, 0 * a)).max() + abs(s.tau).max() + n**3 * abs(a).max()
        assert np.isfinite(a).all()
        assert abs(back - s.tau).max() <= 100 * eps * terms


def test_no_joints_at_all() -> None:
    model = sd.ModelBuilder("post").build()
    nothing = np.zeros(0)
    assert sd.rnea(model, nothing, nothing, nothing).shape == (0,)
    assert sd.aba(model, nothing, nothing, nothing).shape == (0,)
    assert sd.crba(model, nothing).shape == (0, 0)
    assert sd.exact(model, sd.aba)(nothing, nothing, nothing).shape == (0,)


# --- rotations ------------------------------------------------------------------------------------------------


AXES = [np.array(u) / np.linalg.norm(u) for u in ((1.0, 2.0, 3.0), (1.0, 1e-12, 0.0), (-0.3, 0.0, 1e-160))]
ANGLES = [
    0.0,
    *(10.0**-k for k in (1, 4, 8, 12, 16, 30, 100, 300)),
    *(1.0, 2.0, 3.0),
    *(np.pi + s * 10.0**-k for s in (-1, 1) for k in (1, 2, 4, 8, 12, 15)),
    np.pi,
    2.0 * np.pi - 1e-8,
]


@cache
def free() -> sd.Model:
    """A floating base with a ball joint on it."""
    builder = sd.ModelBuilder("free").set_inertia("base", (1.0, (0.1, 0.0, 0.2), INERTIA))
    builder.add_body("b0000", "base", "spherical", (0, 0, 1), (0.0, 0.1, 0.5), (1.0, (0.1, 0.05, 0.2), INERTIA))
    return builder.build(root="floating")


PLACE = (0.1, -0.2, 0.3)


def turned(angle: float, axis: np.ndarray = AXES[0], sign: float = 1.0, place: Any = PLACE) -> np.ndarray:
    """``free`` somewhere, both joints turned by an angle about an axis."""
    quaternion = np.append(np.sin(angle / 2) * axis, np.cos(angle / 2))
    quaternion *= sign / np.linalg.norm(quaternion)
    return np.concatenate([place, quaternion, quaternion])


START = turned(0.0, place=(0.0, 0.0, 0.0))
ELSEWHERE = turned(1.9, np.array([0.6, 0.0, -0.8]), place=(-0.2, 0.1, 0.4))


def off(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Absolute errors."""
    return np.asarray(abs(np.asarray(found).astype(object) - truth), dtype=float)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("angle", ANGLES)
def test_logarithms_are_within_eight_eps_and_relatively_so_of_small_rotations(angle: float, sign: float) -> None:
    """On SO(3) and SE(3), from nothing and from another place, whose product with the end rounds absolutely."""
    model, truth = free(), sd.exact(free(), sd.difference)
    for axis in AXES:
        end = turned(angle, axis, sign)
        for start in (START, ELSEWHERE):
            found, wanted = sd.difference(model, start, end), truth(start, end)
            assert np.isfinite(found).all()
            assert off(found, wanted).max() <= 8 * EPS
        found, wanted = (call(START, end) for call in (partial(sd.difference, model), truth))
        if angle <= 0.1:
            for part in (slice(3, 6), slice(6, 9)):
                assert off(found, wanted)[part].max() <= 8 * EPS * float(abs(wanted[part]).max())


@pytest.mark.parametrize("angle", ANGLES)
def test_exponentials_are_within_eight_eps_and_relatively_so_of_small_rotations(angle: float) -> None:
    model, truth = free(), sd.exact(free(), sd.integrate)
    for axis in AXES:
        v = np.concatenate([[0.3, -0.5, 0.4], angle * axis, angle * axis])
        for start in (START, ELSEWHERE):
            found, wanted = sd.integrate(model, start, v), truth(start, v)
            if found[3:7] @ wanted[3:7] < 0:  # half a turn ends in either of two quaternions
                assert abs(angle - np.pi) < 1e-14
                wanted[3:7] *= -1
            assert off(found, wanted).max() <= 8 * EPS
        found, wanted = sd.integrate(model, START, v), truth(START, v)
        if angle <= 0.1:
            for part in (slice(3, 6), slice(7, 10)):
                assert off(found, wanted)[part].max() <= 8 * EPS * float(abs(wanted[part]).max())


@compiled
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_logarithms_and_exponentials_in_float32(sign: float) -> None:
    """A quaternion of float32 is of unit norm to its rounding, and the travel is turned by it as it is."""
    model, wide = free(), sd.specialize(free(), sd.difference, dtype=np.float32)
    move = sd.specialize(free(), sd.integrate, dtype=np.float32)
    for angle in ANGLES:
        for axis in AXES:
            start, end = START, narrowed(turned(angle, axis, sign))
            v = narrowed(np.concatenate([[0.3, -0.5, 0.4], angle * axis, angle * axis]))
            wanted = sd.difference(model, start, end)
            assert off(wide(start, end), wanted).max() <= 8 * FLOAT32 * EPS
            if angle <= 0.1:
                size = abs(wanted[6:]).max()
                assert off(wide(start, end), wanted)[6:].max() <= 8 * FLOAT32 * EPS * size + LEAST
            assert off(move(start, v), sd.integrate(model, start, v)).max() <= 8 * FLOAT32 * EPS


@pytest.mark.parametrize("sign", slow_but([-1.0], [1.0, -1.0]))
@pytest.mark.parametrize(
    "angle", [0.0, 1e-300, 1e-30, 1e-16, 1e-8, *(np.pi + s * 10.0**-k for s in (-1, 1) for k in (4, 8, 15))]
)
def test_quaternions_next_to_the_identity_and_to_half_a_turn(angle: float, sign: float) -> None:
    model = free()
    held(model, state(model, np.random.default_rng(0))._replace(q=turned(angle, sign=sign)))


# --- float32 and what has no answer -----------------------------------------------------------------------------


@compiled
@pytest.mark.parametrize(
    ("mass", "size", "speed", "angle"),
    [(1, 1, 1, 1), (1e-9, 1, 1, 1), (1e9, 1, 1, 1), (1, 1e-3, 1, 1), (1, 1e3, 1, 1), (1, 1, 1e15, 1), (1, 1, 1e25, 1),
     (1, 1, 1e-30, 1), (1, 1, 1, 1e6), (1, 1, 1, 1e-20), (1e-28, 1e-3, 1, 1), (1e30, 1e3, 1, 1)],
)  # fmt: skip
def test_float32_holds_its_digits_or_says_that_it_cannot(mass: float, size: float, speed: float, angle: float) -> None:
    model = arm(mass, size)
    s = usual(model, size)
    q = s.q * np.where(np.arange(5) == 3, 1, angle)
    in_float32(model, State(q, s.v * speed, s.a, s.tau * mass * size * size), scale=4)


@compiled
@pytest.mark.parametrize("call", [sd.rnea, sd.aba, sd.kinetic_energy, sd.coriolis_matrix])
def test_what_float32_cannot_hold_counts_where_it_is_all_there_is(call: Any) -> None:
    """Beside entries of 1 an entry of 1e-50 is nothing; alone, it is answered by its own digits or rounds to 0."""
    for mass, speed in itertools.product((1e-42, 1.0, 1e12, 1e30), (1e-50, 1e-42, 1e-30, 1e-20)):
        model = arm(mass, gravity=(0.0, 0.0, 0.0))
        program = sd.specialize(model, call, dtype=np.float32)
        s = usual(model)
        for v in (s.v * speed, s.v * [speed, 1.0, speed, speed, 1.0]):
            last = {sd.rnea: [0 * s.a], sd.aba: [s.tau * mass * speed]}.get(call, [])
            for more in [last, [np.zeros(5)]] if last else [last]:
                found, wanted = program(s.q, v, *more), np.asarray(call(model, s.q, v, *more))
                bound = 1e3 * EPS * FLOAT32 * abs(wanted).max() + LEAST
                np.testing.assert_allclose(found, wanted, rtol=0.0, atol=bound)


@compiled
def test_a_robot_at_rest_stays_with_float32() -> None:
    """Exact zeros have lost nothing: no sample is recomputed."""
    model = arm(gravity=(0.0, 0.0, 0.0))
    q, rest = np.tile(usual(model).q, (64, 1)).astype(np.float32), np.zeros((64, 5), np.float32)
    for call, given in ((sd.rnea, (q, rest, rest)), (sd.coriolis_matrix, (q, rest)), (sd.aba, (q, rest, rest))):
        program = sd.specialize(model, call, dtype=np.float32)
        out = np.empty((64, 25 if call is sd.coriolis_matrix else 5), np.float32)
        assert not len(program._kernel(list(given), [out]))
        assert not out.any()
        np.testing.assert_array_equal(program(*given), 0.0)
        again = program._kernel([q, *[rest + np.float32(1e-30)] * (len(given) - 1)], [out])
        assert len(again) == 64


@compiled
def test_a_constant_velocity_below_float32_counts_where_it_is_all_there_is() -> None:
    model = arm(1e17, gravity=(0.0, 0.0, 0.0))
    s = usual(model)
    program = sd.specialize(model, sd.rnea, fixed={"v": 1e-25}, dtype=np.float32)
    wanted = sd.rnea(model, s.q, np.full(5, 1e-25), np.zeros(5))
    np.testing.assert_allclose(program(s.q, np.zeros(5)), wanted, rtol=0.0, atol=FLOAT32 * EPS * abs(wanted).max())


@compiled
@pytest.mark.parametrize("mass", [1e-42, 1e-20, 1e25])
def test_rollouts_of_robots_out_of_range_are_those_of_float64(mass: float) -> None:
    model = arm(mass)
    s = usual(model)
    wide, narrow = (
        sd.rollout(model, s.q, s.v, tau=s.tau * mass, dt=1e-3, steps=20, dtype=dtype)
        for dtype in (np.float64, np.float32)
    )
    assert narrow.v.dtype == np.float32
    np.testing.assert_allclose(narrow.v, wide.v, rtol=0.0, atol=FLOAT32 * EPS * abs(wide.v).max())


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_pivot_that_would_fail_raises(dtype: Any) -> None:
    """A wrist of two hinges on one axis that carries nothing in between, and one that carries nothing at all."""
    for bodies in ([None, (1.0, (0.3, 0.7, 0.1), INERTIA)], [(1.0, (0.3, 0.7, 0.1), INERTIA), None]):
        builder = sd.ModelBuilder("wrist")
        builder.add_body("a", None, "revolute", (0, 0, 1), (0.1, 0, 0), bodies[0])
        builder.add_body("b", "a", "revolute", (0, 0, 1), None, bodies[1])
        model = builder.build()
        for call, arguments in ((sd.aba, ([0.3, 0.4], [1, 2], [1, 1])), (sd.minverse, ([0.3, 0.4],))):
            run = call if dtype is np.float64 else sd.specialize(model, call, dtype=dtype)
            with pytest.raises(sd.InertiaError, match="has zero articulated inertia"):
                run(*((model,) if dtype is np.float64 else ()), *arguments)


@pytest.mark.parametrize("speed", [1e155, 1e200, 1e300])
def test_speeds_whose_squares_overflow_are_refused(speed: float) -> None:
    model = arm()
    s = usual(model)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for call, last in ((sd.rnea, s.a), (sd.aba, s.tau)):
            with pytest.raises(sd.NonFiniteError, match="not finite"):
                call(model, s.q, s.v * speed, last)
