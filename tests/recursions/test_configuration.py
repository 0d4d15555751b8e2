"""The configuration space: exponential, logarithm, their derivatives, and what compiled code makes of them."""

from __future__ import annotations

import itertools
from functools import cache
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from numba import njit
from slow import slow_but

from spatialdyn.algebra import scalars
from spatialdyn.bodies.kinds import (
    CONTINUED,
    FLOATING,
    HELICAL,
    NQ,
    NV,
    PLANAR,
    PLANAR_CS,
    PRISMATIC,
    REVOLUTE,
    REVOLUTE_CS,
    SPHERICAL,
)
from spatialdyn.bodies.table import BODIES
from spatialdyn.engines.compiled import jit
from spatialdyn.recursions.coordinates import configuration

EPS = np.finfo(float).eps
ROUNDING = 8 * EPS  # a few dozen operations on numbers of order one
KINDS = (FLOATING, REVOLUTE, SPHERICAL, REVOLUTE_CS, PLANAR, PRISMATIC, PLANAR_CS, SPHERICAL, FLOATING, HELICAL)
NAMES = ("neutral", "normalize", "integrate", "difference", "interpolate", "dintegrate", "ddifference")


def table(kinds: tuple[int, ...]) -> np.ndarray:
    """A chain of joints of the given kinds; the recursions read kind, dofs and q_index alone."""
    bodies = np.zeros(1 + sum(NV[k] for k in kinds), BODIES)
    i, at = 1, 0
    for kind in kinds:
        bodies[i]["kind"], bodies[i]["dofs"], bodies[i]["q_index"] = kind, NV[kind], at
        for j in range(i, i + NV[kind]):
            bodies[j]["parent"] = j - 1
            if j > i:
                bodies[j]["kind"] = CONTINUED
        i, at = i + NV[kind], at + NQ[kind]
    bodies[0]["q_index"] = at
    return bodies


def compiled(name: str, count: int) -> Any:
    """The recursion as compiled code that divides as the engine has it."""
    jit.hand_over()
    f = getattr(configuration, name)
    if count == 0:
        return njit(error_model="numpy")(lambda bodies, out: f(bodies, out))
    if count == 1:
        return njit(error_model="numpy")(lambda bodies, a, out: f(bodies, a, out))
    if count == 2:
        return njit(error_model="numpy")(lambda bodies, a, b, out: f(bodies, a, b, out))
    return njit(error_model="numpy")(lambda bodies, a, b, c, out: f(bodies, a, b, c, out))


COMPILED = {name: compiled(name, n) for name, n in zip(NAMES, (0, 1, 2, 2, 3, 2, 2), strict=True)}


class Space:
    """The seven recursions on one table, in plain Python or compiled."""

    def __init__(self, kinds: tuple[int, ...], fast: bool) -> None:
        self.kinds, self.fast, self.bodies = kinds, fast, table(kinds)
        self.nq, self.nv = int(self.bodies[0]["q_index"]), len(self.bodies) - 1

    def __getattr__(self, name: str) -> Any:
        shape = {"difference": (self.nv,), "dintegrate": (2, self.nv, self.nv), "ddifference": (2, self.nv, self.nv)}

        def call(*inputs: Any) -> np.ndarray:
            inputs = tuple(x if np.ndim(x) == 0 else np.array(x, float) for x in inputs)
            out = np.full(shape.get(name, (self.nq,)), 777.0)
            if self.fast:
                COMPILED[name](self.bodies, *inputs, out)
            else:
                with np.errstate(divide="raise", invalid="raise", over="raise"):
                    getattr(configuration, name)(self.bodies.view(np.recarray), *inputs, out)
            return out

        return call

    def random(self, rng: np.random.Generator) -> np.ndarray:
        return self.normalize(rng.normal(size=self.nq))


@pytest.fixture(params=slow_but([False], [False, True]), ids=["plain", "compiled"])  # which takes 8 s to compile
def fast(request: pytest.FixtureRequest) -> bool:
    return request.param


def rotation(a: np.ndarray) -> np.ndarray:
    x, y, z, w = a
    S = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * S + 2 * S @ S


def cross(u: Any) -> mp.matrix:
    return mp.matrix([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])


def exact_exp(v: np.ndarray) -> np.ndarray:
    """(4, 4) pose after the twist v, linear first, to 30 digits, by the matrix exponential."""
    with mp.workdps(60):
        A = mp.zeros(4)
        A[:3, :3] = cross([mp.mpf(x) for x in v[3:]])
        A[:3, 3] = mp.matrix([mp.mpf(x) for x in v[:3]])
        scale = max(0, int(mp.ceil(mp.log(mp.norm(A) + 1, 2)))) + 4
        A, E, term = A / 2**scale, mp.eye(4), mp.eye(4)
        for k in range(1, 40):
            term = term * A / k
            E += term
        for _ in range(scale):
            E = E * E
        return np.array(E.tolist(), dtype=float)


def exact_jacobian(v: np.ndarray, inverse: bool = False) -> np.ndarray:
    """(6, 6) right Jacobian Σ (-ad)ᵏ/(k+1)! at the twist v, or its inverse, linear first."""
    return _exact_jacobian(tuple(v.tolist()), inverse)


@cache
def _exact_jacobian(v: tuple[float, ...], inverse: bool) -> np.ndarray:
    with mp.workdps(60):
        ad = mp.zeros(6)
        W, V = cross([mp.mpf(x) for x in v[3:]]), cross([mp.mpf(x) for x in v[:3]])
        ad[:3, :3], ad[3:, 3:], ad[:3, 3:] = W, W, V
        J, term = mp.eye(6), mp.eye(6)
        for k in range(1, 150):
            term = term * -ad / (k + 1)
            J += term
        return np.array((J**-1 if inverse else J).tolist(), dtype=float)


def off(a: Any, b: Any) -> float:
    a, b = np.asarray(a), np.asarray(b)
    return float(abs(a - b).max(initial=0.0) / max(1.0, abs(b).max(initial=0.0)))


# --- by hand --------------------------------------------------------------------------------------------


def test_a_quarter_turn_to_the_left_ends_where_the_circle_does(fast: bool) -> None:
    quarter = np.pi / 2
    root = np.sqrt(0.5)
    floating = Space((FLOATING,), fast)
    end = floating.integrate(floating.neutral(), [quarter, 0, 0, 0, 0, quarter])
    assert off(end, [1, 1, 0, 0, 0, root, root]) < ROUNDING
    assert off(floating.difference(floating.neutral(), end), [quarter, 0, 0, 0, 0, quarter]) < ROUNDING
    planar = Space((PLANAR, PLANAR_CS), fast)
    end = planar.integrate(planar.neutral(), [quarter, 0, quarter] * 2)
    assert off(end, [1, 1, quarter, 1, 1, 0, 1]) < ROUNDING
    assert off(planar.interpolate(planar.neutral(), end, 0.5)[:2], [root, 1 - root]) < ROUNDING


def test_numbers_add_and_pairs_turn(fast: bool) -> None:
    s = Space((REVOLUTE, PRISMATIC, REVOLUTE_CS), fast)
    assert off(s.integrate([1, 2, 0, 1], [10, 20, np.pi]), [11, 22, 0, -1]) < ROUNDING
    assert off(s.difference([1, 2, 0, 1], [11, 22, 1, 0]), [10, 20, -np.pi / 2]) < ROUNDING
    assert (s.dintegrate([1, 2, 0, 1], [1, 2, 3]) == [np.eye(3), np.eye(3)]).all()
    assert (s.ddifference([1, 2, 0, 1], [1, 2, 0, 1]) == [-np.eye(3), np.eye(3)]).all()


def test_neutral_has_no_displacement(fast: bool) -> None:
    s = Space(KINDS, fast)
    q = s.neutral()
    assert (s.difference(q, q) == 0.0).all()
    assert (q == s.normalize(q)).all()
    assert q.sum() == 6  # four quaternions, two pairs


# --- identities -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_difference_undoes_integrate(seed: int, fast: bool) -> None:
    s, rng = Space(KINDS, fast), np.random.default_rng(seed)
    for scale in (1.5, 1e-3, 1e-8, 0.0):
        q, v = s.random(rng), rng.uniform(-1, 1, s.nv) * scale
        assert abs(s.difference(q, s.integrate(q, v)) - v).max() < 4 * ROUNDING


@pytest.mark.parametrize("seed", range(4))
def test_integrate_reaches_the_other_configuration(seed: int, fast: bool) -> None:
    s, rng = Space(KINDS, fast), np.random.default_rng(seed)
    q0, q1 = s.random(rng), s.random(rng)
    v = s.difference(q0, q1)
    assert off(s.interpolate(q0, q1, 0.0), q0) < ROUNDING
    for end in (s.integrate(q0, v), s.interpolate(q0, q1, 1.0)):
        assert abs(s.difference(q1, end)).max() < 4 * ROUNDING
    half = s.interpolate(q0, q1, 0.5)
    assert off(s.difference(q0, half), s.difference(half, q1)) < 4 * ROUNDING


def test_a_quaternion_and_its_negative_are_one_rotation(fast: bool) -> None:
    s, rng = Space((SPHERICAL, FLOATING), fast), np.random.default_rng(5)
    q0, q1 = s.random(rng), s.random(rng)
    minus = q1.copy()
    minus[:4] *= -1
    minus[7:] *= -1
    assert (s.difference(q0, q1) == s.difference(q0, minus)).all()
    assert (s.ddifference(q0, q1) == s.ddifference(q0, minus)).all()


def test_norm_does_not_drift(fast: bool) -> None:
    s, rng = Space((FLOATING, REVOLUTE_CS, PLANAR_CS, SPHERICAL), fast), np.random.default_rng(6)
    q = s.neutral()
    q[3:7] *= 1 + 1e-6
    for _ in range(100):
        q = s.integrate(q, rng.normal(size=s.nv))
    norms = [np.linalg.norm(q[k]) for k in (slice(3, 7), slice(7, 9), slice(11, 13), slice(13, 17))]
    assert off(norms, np.ones(4)) < 3 * EPS


def test_normalize_takes_any_size(fast: bool) -> None:
    s, rng = Space((SPHERICAL, REVOLUTE_CS), fast), np.random.default_rng(7)
    q = s.random(rng)
    for size in (1e-300, 1e-160, 1e-3, 1.0, 1e3, 1e200, 1e307):
        assert off(s.normalize(q * size), q) < ROUNDING
    assert (s.normalize(0 * q) == 0).all()
    assert off(s.normalize(np.full(6, 5e-324)), [0.5] * 4 + [np.sqrt(0.5)] * 2) < ROUNDING


# --- accuracy -------------------------------------------------------------------------------------------

SCALES = (1e-300, 1e-200, 1e-160, 1e-30, 1e-18, 1e-16, 1e-8, 1.3e-4, 1e-3, 0.1, 0.5, 0.99, 1.0, 1.01, 2.0, 3.0)


@pytest.mark.parametrize("scale", [*SCALES, 3.14159, 6.28, 10.0, 100.0, 1000.0])
def test_exponential_is_exact_to_rounding(scale: float, fast: bool) -> None:
    s, rng = Space((FLOATING,), fast), np.random.default_rng(8)
    for linear in (scale, 1.0):
        w = rng.normal(size=3)
        v = np.concatenate([rng.normal(size=3) * linear, scale * w / np.linalg.norm(w)])
        q = s.integrate(s.neutral(), v)
        E = exact_exp(v)
        assert abs(rotation(q[3:]) - E[:3, :3]).max() < ROUNDING * max(1.0, scale)  # θ itself is rounded
        assert abs(q[:3] - E[:3, 3]).max() < ROUNDING * abs(v[:3]).max() * max(1.0, scale)
        if scale < 1e-8:
            assert abs(q[3:6] / v[3:] - 0.5).max() < ROUNDING


@pytest.mark.parametrize("scale", [*SCALES, 1000.0])
def test_planar_exponential_is_exact_to_rounding(scale: float, fast: bool) -> None:
    s = Space((PLANAR, PLANAR_CS), fast)
    q = s.integrate(s.neutral(), [0.3, -0.7, scale, 0.3, -0.7, scale])
    E = exact_exp(np.array([0.3, -0.7, 0, 0, 0, scale]))
    assert off(q, [*E[:2, 3], scale, *E[:2, 3], *E[:2, 0]]) < ROUNDING
    if scale < np.pi:
        assert off(s.difference(s.neutral(), q), [0.3, -0.7, scale] * 2) < ROUNDING


@pytest.mark.parametrize("scale", SCALES)
def test_logarithm_undoes_the_exponential_from_neutral_relatively(scale: float, fast: bool) -> None:
    s, rng = Space((FLOATING, SPHERICAL), fast), np.random.default_rng(9)
    w = rng.normal(size=3)
    w *= scale / np.linalg.norm(w)
    for linear in (scale, 1.0):
        v = np.concatenate([rng.normal(size=3) * linear, w, w])
        back = s.difference(s.neutral(), s.integrate(s.neutral(), v))
        assert abs(back - v)[3:].max() < ROUNDING * scale
        assert abs(back - v)[:3].max() < ROUNDING * abs(v[:3]).max() * 2


@pytest.mark.parametrize("gap", [10.0**-k for k in range(1, 17)] + [0.0])
def test_logarithm_holds_up_to_half_a_turn(gap: float, fast: bool) -> None:
    s, rng = Space((FLOATING, SPHERICAL, REVOLUTE_CS, PLANAR, PLANAR_CS), fast), np.random.default_rng(10)
    w = rng.normal(size=3)
    w /= np.linalg.norm(w)
    turn = np.pi - gap
    v = np.concatenate([[1, 2, 3], turn * w, -turn * w, [turn], [1, 2, -turn], [1, 2, turn]])
    q = s.random(rng)
    end = s.integrate(q, v)
    back = s.difference(q, end)
    assert abs(np.linalg.norm(back[3:6]) - turn) < ROUNDING
    assert abs(back[[9, 12, 15]]).max() <= np.pi
    again = s.difference(end, s.integrate(q, back))
    assert abs(again).max() < 4 * ROUNDING


@pytest.mark.parametrize("scale", slow_but([*SCALES[::3], 6.0], [*SCALES, 3.1, 6.0, 12.0, 30.0]))
def test_jacobians_are_exact_to_rounding(scale: float, fast: bool) -> None:
    s, rng = Space((FLOATING,), fast), np.random.default_rng(11)
    w = rng.normal(size=3)
    v = np.concatenate([rng.normal(size=3), scale * w / np.linalg.norm(w)])
    by_q, by_v = s.dintegrate(s.neutral(), v)
    tolerance = ROUNDING * max(1.0, scale)
    assert off(by_v, exact_jacobian(v)) < tolerance
    E = exact_exp(v)
    R, p = E[:3, :3], E[:3, 3]
    assert off(by_q, np.block([[R.T, -R.T @ np.cross(np.eye(3), p)], [np.zeros((3, 3)), R.T]])) < 2 * tolerance
    if scale < np.pi:
        by_0, by_1 = s.ddifference(s.neutral(), s.integrate(s.neutral(), v))
        assert off(by_1, exact_jacobian(v, inverse=True)) < 4 * tolerance
        assert off(by_0, -exact_jacobian(-v, inverse=True)) < 4 * tolerance


@pytest.mark.parametrize("seed", range(3))
def test_jacobians_are_the_derivatives(seed: int, fast: bool) -> None:
    s, rng = Space(KINDS, fast), np.random.default_rng(seed)
    q, v, h = s.random(rng), rng.uniform(-2, 2, s.nv), 1e-5
    q1 = s.random(rng)
    end = s.integrate(q, v)
    by_q, by_v = s.dintegrate(q, v)
    by_0, by_1 = s.ddifference(q, q1)
    for j in range(s.nv):
        e = h * np.eye(s.nv)[j]
        slopes = [
            (s.difference(end, s.integrate(s.integrate(q, d), v)) for d in (e, -e)),
            (s.difference(end, s.integrate(q, v + d)) for d in (e, -e)),
            (s.difference(s.integrate(q, d), q1) for d in (e, -e)),
            (s.difference(q, s.integrate(q1, d)) for d in (e, -e)),
        ]
        for (ahead, behind), J in zip(slopes, (by_q, by_v, by_0, by_1), strict=True):
            assert off((ahead - behind) / (2 * h), J[:, j]) < 1e-8  # h² and eps/h, times third derivatives


# --- oracle ---------------------------------------------------------------------------------------------

ORACLE = 1e-11  # ours are within ROUNDING of the exact values (above); its Jacobians lose digits near θ = 0 and π
SMALL_ANGLE = 1e-3  # Pinocchio 4.1 misses the exact values by 7e-5 (dIntegrate, floating, θ = 1.3e-4)


def pinocchio_model(kinds: tuple[int, ...]) -> Any:
    pin = pytest.importorskip("pinocchio")
    make = {
        FLOATING: pin.JointModelFreeFlyer, SPHERICAL: pin.JointModelSpherical, REVOLUTE: pin.JointModelRX,
        PRISMATIC: pin.JointModelPY, REVOLUTE_CS: pin.JointModelRUBZ, PLANAR: pin.JointModelPlanar,
        PLANAR_CS: pin.JointModelPlanar, HELICAL: lambda: pin.JointModelHZ(0.3),
    }  # fmt: skip
    model, parent = pin.Model(), 0
    for n, kind in enumerate(kinds):
        parent = model.addJoint(parent, make[kind](), pin.SE3.Identity(), str(n))
    return model


def to_pinocchio(kinds: tuple[int, ...], q: np.ndarray) -> np.ndarray:
    """The angles of planar joints as pairs."""
    parts, at = [], 0
    for kind in kinds:
        x = q[at : at + NQ[kind]]
        parts.append([x[0], x[1], np.cos(x[2]), np.sin(x[2])] if kind == PLANAR else x)
        at += NQ[kind]
    return np.concatenate(parts)


@pytest.mark.parametrize("seed", range(10))
def test_equals_pinocchio(seed: int, fast: bool) -> None:
    pin = pytest.importorskip("pinocchio")
    s, rng = Space(KINDS, fast), np.random.default_rng(seed)
    model = pinocchio_model(KINDS)
    there = lambda q: to_pinocchio(KINDS, q)  # noqa: E731
    assert (there(s.neutral()) == pin.neutral(model)).all()
    raw = rng.normal(size=s.nq)
    assert off(there(s.normalize(raw)), pin.normalize(model, there(raw))) < ORACLE
    for scale in (1.0, 3.0, 10.0):
        q, q1, v = s.random(rng), s.random(rng), scale * rng.uniform(0.5, 1, s.nv) * rng.choice([-1, 1], s.nv)
        assert off(there(s.integrate(q, v)), pin.integrate(model, there(q), v)) < ORACLE
        assert off(s.difference(q, q1), pin.difference(model, there(q), there(q1))) < ORACLE
        t = rng.uniform(0.1, 0.9)
        assert off(there(s.interpolate(q, q1, t)), pin.interpolate(model, there(q), there(q1), t)) < ORACLE
        for ours, theirs in zip(s.dintegrate(q, v), pin.dIntegrate(model, there(q), v), strict=True):
            assert off(ours, theirs) < ORACLE
        for ours, theirs in zip(s.ddifference(q, q1), pin.dDifference(model, there(q), there(q1)), strict=True):
            assert off(ours, theirs) < ORACLE


@pytest.mark.parametrize("angle", [1e-9, 1e-6, 1e-4, 1e-3, 1e-2])
def test_pinocchio_loses_digits_at_small_angles(angle: float) -> None:
    pin = pytest.importorskip("pinocchio")
    kinds = (FLOATING, PLANAR_CS)
    s, rng, model = Space(kinds, True), np.random.default_rng(15), pinocchio_model(kinds)
    q, v = s.random(rng), rng.normal(size=s.nv)
    v[[3, 4, 5, 8]] *= angle
    end = s.integrate(q, v)
    assert off(s.difference(q, end), v) < 4 * ROUNDING  # ours do not
    pairs = [
        (end, pin.integrate(model, q, v)),
        (s.difference(q, end), pin.difference(model, q, end)),
        *zip(s.dintegrate(q, v), pin.dIntegrate(model, q, v), strict=True),
        *zip(s.ddifference(q, end), pin.dDifference(model, q, end), strict=True),
    ]
    for ours, theirs in pairs:
        assert off(ours, theirs) < SMALL_ANGLE


# --- limits ---------------------------------------------------------------------------------------------


def test_a_table_without_joints_has_one_configuration(fast: bool) -> None:
    s, none = Space((), fast), np.zeros(0)
    for name, inputs in zip(NAMES, ((), (none,), (none, none), (none, none), (none, none, 0.5)), strict=False):
        assert getattr(s, name)(*inputs).size == 0
    assert s.dintegrate(none, none).shape == (2, 0, 0)


@np.errstate(invalid="ignore")  # uncompiled, NumPy warns of these operations
@pytest.mark.parametrize("kind", sorted(set(KINDS)))
def test_nan_comes_out_where_it_goes_in(kind: int) -> None:
    s, rng = Space((kind,), True), np.random.default_rng(12)
    q, q1, v = s.random(rng), s.random(rng), rng.normal(size=s.nv)
    for j in range(s.nq):
        bad = q.copy()
        bad[j] = np.nan
        assert np.isnan(s.integrate(bad, v)).any()
        assert np.isnan(s.normalize(bad)).any()
        assert np.isnan(s.difference(bad, q1)).any()
        assert np.isnan(s.difference(q1, bad)).any()
    for j, value in itertools.product(range(s.nv), (np.nan, np.inf)):
        bad = v.copy()
        bad[j] = value
        assert not np.isfinite(s.integrate(q, bad)).all()
        if NV[kind] > 1 and not (kind in (PLANAR, PLANAR_CS) and j < 2 and value == np.inf):
            assert not np.isfinite(s.dintegrate(q, bad)).all()


def test_compiled_code_and_plain_python_agree() -> None:
    plain, fast, rng = Space(KINDS, False), Space(KINDS, True), np.random.default_rng(13)
    q, q1, v = plain.random(rng), plain.random(rng), rng.normal(size=plain.nv)
    for name, inputs in dict(integrate=(q, v), difference=(q, q1), interpolate=(q, q1, 0.3), dintegrate=(q, v)).items():
        assert off(getattr(fast, name)(*inputs), getattr(plain, name)(*inputs)) < 4 * EPS


class Recorded:
    """A number that cannot be compared, like the tracer's."""

    def __init__(self, x: Any) -> None:
        self.x = x.x if isinstance(x, Recorded) else float(x)

    def __bool__(self) -> bool:
        raise TypeError("a recorded value was compared")

    __lt__ = __gt__ = __le__ = __ge__ = __eq__ = __float__ = lambda *_: Recorded(0).__bool__()  # type: ignore
    __hash__ = None  # type: ignore[assignment]
    __neg__ = lambda a: Recorded(-a.x)  # noqa: E731
    __add__ = __radd__ = lambda a, b: Recorded(a.x + Recorded(b).x)
    __mul__ = __rmul__ = lambda a, b: Recorded(a.x * Recorded(b).x)
    __sub__ = lambda a, b: Recorded(a.x - Recorded(b).x)  # noqa: E731
    __rsub__ = lambda a, b: Recorded(Recorded(b).x - a.x)  # noqa: E731
    __truediv__ = lambda a, b: Recorded(a.x / Recorded(b).x)  # noqa: E731
    __rtruediv__ = lambda a, b: Recorded(Recorded(b).x / a.x)  # noqa: E731


for _name in ("sin", "cos", "sqrt"):
    _f = getattr(scalars, _name)
    _f.register(Recorded)(lambda a, _f=_f: Recorded(_f(a.x)))
scalars.atan2.register(Recorded)(lambda a, b: Recorded(scalars.atan2(a.x, Recorded(b).x)))
scalars.select.register(Recorded)(lambda c, a, b: Recorded(scalars.select(c.x, Recorded(a).x, Recorded(b).x)))


def test_no_recursion_compares_a_value() -> None:
    s, rng = Space(KINDS, False), np.random.default_rng(14)
    q, q1, v = s.random(rng), s.random(rng), rng.normal(size=s.nv)
    cases = dict(normalize=(q,), integrate=(q, v), difference=(q, q1), interpolate=(q, q1, 0.3))
    for name, inputs in (cases | dict(dintegrate=(q, v), ddifference=(q, q1))).items():
        expected = getattr(s, name)(*inputs)
        out = np.empty(expected.shape, object)
        objects = [np.array([Recorded(y) for y in x], object) if np.ndim(x) else Recorded(x) for x in inputs]
        getattr(configuration, name)(s.bodies.view(np.recarray), *objects, out)
        assert (np.array([Recorded(x).x for x in out.ravel()]) == expected.ravel()).all()
