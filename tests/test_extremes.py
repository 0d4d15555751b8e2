"""Whatever physics allows is answered, to the digits that are stated, or refused by name: never NaN, never a crash."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.engines import jit

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
if not (BENCHMARKS / "accuracy.py").exists():
    pytest.skip("the benchmarks are not here", allow_module_level=True)
sys.path.insert(0, str(BENCHMARKS))

from accuracy import EPS, State, chain, measured, state  # noqa: E402

# Of the largest entry. Of forward dynamics times a scaled condition number up to 1e4, at 5 to 7 bodies.
BOUND = {"rnea": 16 * EPS, "crba": 16 * EPS, "aba": 1e3 * EPS}
FLOAT32 = 2.0**29  # eps of float32 in those of float64
INERTIA = np.array([[0.02, 0.001, 0.0], [0.001, 0.03, 0.002], [0.0, 0.002, 0.025]])
compiled = pytest.mark.skipif(jit.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")


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
    """Each call, alone and in a batch, is finite and within its bound."""
    for name, bound in BOUND.items():
        assert measured(model, name, s) <= scale * bound, name
        if not jit.PLAIN:
            assert measured(model, name, s, in_a_batch(name)) <= scale * bound, name


def in_a_batch(name: str) -> Any:
    """The public call on a batch that runs on lanes; its first sample."""
    return lambda model, *x: getattr(sd, name)(model, *(np.tile(e, (520, 1)) for e in x))[0]


def in_float32(model: sd.Model, s: State, scale: float = 1.0) -> None:
    """Programs of float32: within the bound at float32's rounding, or an error that says what is out of range."""
    for name, bound in BOUND.items():
        program = sd.specialize(model, getattr(sd, name), dtype=np.float32)
        rounded = State(*(x.astype(np.float32).astype(float) for x in s))
        try:
            error = measured(model, name, rounded, lambda _, *x, program=program: program(*x))
        except sd.NonFiniteError as refused:
            assert "float32" in str(refused)  # noqa: PT017 - either way is an answer
        else:
            assert error <= FLOAT32 * scale * bound, name


@pytest.mark.parametrize("speed", [1e-300, 1e-160, 1e-30, 1e-3, 1e3, 1e30, 1e100])
def test_any_speed(speed: float) -> None:
    model = arm()
    s = usual(model)
    held(model, s._replace(v=s.v * speed))
    for gravity in (1e6, 0.0) if speed > 1e-150 else (1e6,):  # of nothing but squares below 1e-308 no digits are left
        held(model.with_(gravity=(0.0, 0.0, -gravity)), s._replace(v=s.v * speed, tau=0 * s.tau))


@pytest.mark.parametrize("angle", [1e-300, 1e-9, 1e3, 1e5, 1.1e5, 1e9, 1e15])
def test_any_angle(angle: float) -> None:
    """Beyond 1e5 the lanes leave a sample to the kernel, whose sine is libm's."""
    model = chain(5, True)
    s = state(model, np.random.default_rng(1))
    held(model, s._replace(q=angle * s.q))


@pytest.mark.parametrize("mass", [1e-300, 1e-9, 1e-3, 1e9, 1e200])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
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
    with pytest.raises(sd.InertiaError, match="moves no inertia: articulated inertia next to 0"):
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


@pytest.mark.parametrize("tilt", [0.0, 1e-17, 1e-16, 1e-15, 1e-12, 1e-8])
def test_axes_next_to_a_coordinate_axis(tilt: float) -> None:
    model = arm(tilt=tilt)
    held(model, usual(model))


@pytest.mark.parametrize("n", [1, 2, 3, 2000])
def test_any_length(n: int) -> None:
    model = chain(n, True)
    s = state(model, np.random.default_rng(4))
    a = sd.aba(model, s.q, s.v, s.tau)
    back = sd.rnea(model, s.q, s.v, a)
    terms = abs(sd.rnea(model, s.q, s.v, 0 * a)).max() + abs(s.tau).max() + n**3 * abs(a).max()
    assert np.isfinite(a).all()
    assert abs(back - s.tau).max() <= 100 * EPS * terms


def test_no_joints_at_all() -> None:
    model = sd.ModelBuilder("post").build()
    nothing = np.zeros(0)
    assert sd.rnea(model, nothing, nothing, nothing).shape == (0,)
    assert sd.aba(model, nothing, nothing, nothing).shape == (0,)
    assert sd.crba(model, nothing).shape == (0, 0)
    assert sd.exact(model, sd.aba)(nothing, nothing, nothing).shape == (0,)


# --- rotations ------------------------------------------------------------------------------------------------


def turned(angle: float, sign: float = 1.0) -> np.ndarray:
    """A floating base turned by an angle about (1, 2, 3)."""
    u = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    quaternion = np.append(np.sin(angle / 2) * u, np.cos(angle / 2))
    return np.concatenate([[0.1, -0.2, 0.3], sign * quaternion / np.linalg.norm(quaternion)])


ANGLES = [
    0.0,
    *(10.0**-k for k in (1, 4, 8, 12, 16, 100, 300)),
    *(np.pi + s * 10.0**-k for s in (-1, 1) for k in (1, 4, 8, 15)),
]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("angle", ANGLES)
def test_rotations_next_to_none_and_to_half_a_turn(angle: float, sign: float) -> None:
    model = sd.ModelBuilder("free").set_inertia("base", (1.0, (0.1, 0.0, 0.2), INERTIA)).build(root="floating")
    start, end = turned(0.0), turned(angle, sign)
    found = sd.difference(model, start, end)
    truth = sd.exact(model, sd.difference)(start, end)
    assert np.isfinite(found).all()
    assert abs((found.astype(object) - truth).astype(float)).max() <= 8 * EPS * np.pi
    s = state(model, np.random.default_rng(0))
    for name in ("rnea", "aba"):
        assert measured(model, name, s._replace(q=end)) <= 64 * EPS


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
            with pytest.raises(sd.InertiaError, match="moves no inertia"):
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
