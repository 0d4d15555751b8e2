"""Friction's steps: by hand, Coulomb's law against M of other calls, in every engine, and how guesses settle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from dense import Array
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.engines import by_table_kernel, run
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.compiled.numba_kernels import variant
from spatialdyn.engines.numbers.multiprecision import arithmetic, numbers
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.record.tracer import evaluate, scratch, table
from spatialdyn.recursions.joints import friction
from spatialdyn.recursions.joints.friction import AT_ONCE, BRISTLE_STEP, FRICTION_STEP, FRICTION_TORQUE
from spatialdyn.urdf.load import example_robots

EPS = float(np.finfo(float).eps)
CLOSE = 100 * EPS  # of the largest entry: a few dozen operations in another order
DT = 1e-3
STEP, BRISTLES = (variant(spec, set()) for spec in (FRICTION_STEP, BRISTLE_STEP))  # without external forces
SOLVED = {"panda": 1e-13, "talos_full": 1e-11}  # [rad/s]: eps times the condition of M, 1e2 and 7e5, times |v|
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="heavy: thousands of states")
robots = pytest.mark.skipif(not example_robots(), reason="robots of example-robot-data")


def mass(m: float = 1.0) -> sd.Model:
    """A mass on a slide, without gravity."""
    builder = sd.ModelBuilder("slide")
    builder.add_body("mass", None, "prismatic", (1, 0, 0), inertia=(m, (0, 0, 0), np.eye(3) * 0.1))
    return builder.build(gravity=(0.0, 0.0, 0.0))


def in_numpy(model: sd.Model, spec: Any, arrays: Sequence[Any]) -> Array:
    """Samples (n, ...) by the recorded program, in NumPy."""
    n = max(len(x) for x in arrays)
    columns = [y for x in arrays for y in np.broadcast_to(x, (n, *np.shape(x)[1:])).reshape(n, -1).T]
    made = recording.record((spec,), model.bodies)
    results = made.program.run(columns)
    wanted = [results[k] for k in made.layout.outputs[0]]
    return np.stack([np.broadcast_to(np.asarray(x, float), n) for x in wanted], 1)


def states(model: sd.Model, n: int, torque: float, seed: int = 0) -> dict[str, Array]:
    """Random states near equilibrium, many joints of which are at rest, and friction of all joints."""
    rng = np.random.default_rng(seed)
    shape = (n, model.nv)
    q = sd.random_configuration(model, rng, (n,))
    v = rng.standard_normal(shape) * rng.choice([0.0, 1e-3, 0.1, 1.0], shape)
    coulomb = rng.uniform(0.0, 2.0, (1, model.nv))
    return {
        "q": q, "v": v, "tau": sd.nonlinear_effects(model, q, v) + torque * rng.standard_normal(shape),
        "dt": np.full((1, 1), DT), "coulomb": coulomb, "viscous": rng.uniform(0.0, 0.5, (1, model.nv)),
        "static": 1.3 * coulomb, "stribeck": np.full((1, model.nv), 0.05),
    }  # fmt: skip


def violation(model: sd.Model, s: dict[str, Array], after: Array) -> tuple[Array, Array]:
    """By how much velocities (n, nv) violate Coulomb's law and the equation of motion, by M of crba and its inverse."""
    v, dt = s["v"], s["dt"]
    M, bias = sd.crba(model, s["q"]), sd.nonlinear_effects(model, s["q"], v)
    torque = np.einsum("nij,nj->ni", M, after - v) / dt + bias - s["tau"] + s["viscous"] * after
    H = M + dt[..., None] * np.eye(model.nv) * s["viscous"][:, None]
    weight = 1.0 / np.diagonal(np.linalg.inv(H), axis1=1, axis2=2)
    level = s["coulomb"] + (s["static"] - s["coulomb"]) * np.exp(-((v / s["stribeck"]) ** 2))
    allowed = np.clip(torque - weight * after / dt, -level, level)
    return (abs(torque - allowed) * dt / weight).max(axis=1), weight


# --- by hand --------------------------------------------------------------------------------------------


def test_a_mass_slows_by_coulombs_friction_and_stops_to_the_bit() -> None:
    model, spec = mass(2.0), STEP
    coefficients = [np.array([[x]]) for x in (3.0, 0.0, 4.0, AT_ONCE)]
    v = np.array([[1.0], [-1.0], [1e-3], [-1e-3], [0.0], [0.0], [0.0]])
    tau = np.array([[0.0], [0.0], [0.0], [0.0], [3.9], [-3.9], [4.5]])
    found = in_numpy(model, spec, [0.0 * v, v, tau, np.array([[DT]]), *coefficients])
    wanted = [1.0 - 1.5 * DT, -1.0 + 1.5 * DT, 0.0, 0.0, 0.0, 0.0, 0.5 * (4.5 - 4.0) * DT]
    np.testing.assert_allclose(found[:, 0], wanted, rtol=CLOSE, atol=0.0)
    assert (found[2:6, 0] == 0.0).all()
    assert (found[:, 1] == 0.0).all()


def test_damping_alone_is_eulers_implicit_method() -> None:
    """v⁺ = (v + h τ/m) / (1 + h b/m), at any h b."""
    given = [np.full((1, 1), x) for x in (0.0, 1.5, 0.7, 0.1, 0.0, 900.0, 0.0, AT_ONCE)]
    found = in_numpy(mass(2.0), STEP, given)
    assert found[0, 0] == pytest.approx((1.5 + 0.1 * 0.7 / 2.0) / (1.0 + 0.1 * 900.0 / 2.0), rel=CLOSE)


@pytest.mark.parametrize("v", [0.3, -0.02, 0.0])
def test_bristles_follow_the_closed_form_of_one_mass(v: float) -> None:
    """v⁺ = (v + h/m (f - B)) / (1 + h A/m), z⁺ = (z + h v⁺) d."""
    m, f, z, s0, s1, s2, fc, fs, vs = 2.0, 0.8, 3e-6, 1e5, 300.0, 0.4, 1.0, 1.5, 1e-3
    g = fc + (fs - fc) * math.exp(-((v / vs) ** 2))
    d = 1.0 / (1.0 + DT * s0 * abs(v) / g)
    A, B = s0 * DT * d + s1 * d + s2, s0 * z * d + s1 * (z * d - z) / DT
    after = (v + DT / m * (f - B)) / (1.0 + DT * A / m)
    given = [np.array([[x]]) for x in (0.0, v, z, f, DT, fc, s2, fs, vs, s0, s1)]
    found = in_numpy(mass(m), BRISTLES, given)
    np.testing.assert_allclose(found[0], [after, (z + DT * after) * d], rtol=CLOSE)


def test_a_joint_without_friction_has_no_bristles_and_no_nan() -> None:
    given = [np.array([[x]]) for x in (0.0, 0.0, 0.0, 2.0, DT, 0.0, 0.0, 0.0, AT_ONCE, 1e5, 300.0)]
    assert in_numpy(mass(), BRISTLES, given)[0].tolist() == [2.0 * DT, 0.0]


# --- Coulomb's law --------------------------------------------------------------------------------------


@robots
@compiled
@pytest.mark.parametrize(
    ("name", "torque"), slow_but([("panda", 1.0)], [(r, x) for r in SOLVED for x in (0.1, 1.0, 10.0)])
)
def test_coulombs_law_holds_at_the_end_of_the_step(name: str, torque: float) -> None:
    """In every one of 2000 random states, to rounding."""
    model = sd.load_urdf(name)
    s = states(model, 2000, torque)
    found = in_numpy(model, STEP, list(s.values())).reshape(-1, 3, model.nv)
    off, _ = violation(model, s, found[:, 0])
    assert off.max() <= SOLVED[name]
    own = found[:, 1].max(axis=1)
    assert abs(off - own).max() <= SOLVED[name]  # what the recursion says of itself
    assert (found[:, 0] == 0.0).any(axis=1).mean() > 0.3
    assert (own == 0.0).all()


@robots
@compiled
def test_a_humanoid_is_solved_too() -> None:
    model = sd.load_urdf("talos_full")
    s = states(model, 300, 1.0)
    found = in_numpy(model, STEP, list(s.values())).reshape(-1, 3, model.nv)
    assert violation(model, s, found[:, 0])[0].max() <= SOLVED["talos_full"]


def test_a_guess_that_has_not_settled_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(friction, "SWEEPS", 1)
    model = random_tree(4, 6, ["revolute"]).model
    s = states(model, 300, 1.0)
    found = in_numpy(model, STEP, list(s.values())).reshape(-1, 3, model.nv)
    off, _ = violation(model, s, found[:, 0])
    assert (off > 1e-3).any()
    np.testing.assert_allclose(found[:, 1].max(axis=1), off, rtol=1e-6, atol=1e-12)


@compiled
def test_a_guess_that_cycles_is_ended_by_correcting_the_worst_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of 20 000 states of one of eleven trees whose guesses, each joint corrected at once, return for ever."""
    model = random_tree(3, 8, ["revolute"]).model
    s = {name: x[14778:14779] if len(x) > 1 else x for name, x in states(model, 20_000, 1.0, 3).items()}
    solved = in_numpy(model, STEP, list(s.values())).reshape(3, model.nv)
    assert (solved[1] == 0.0).all()
    assert violation(model, s, solved[:1])[0][0] <= SOLVED["panda"]
    monkeypatch.setattr(friction, "BOLD", 99)
    assert in_numpy(model, STEP, list(s.values())).reshape(3, model.nv)[1].max() > 1e-3


def test_the_weights_are_those_of_the_inverse_mass_matrix() -> None:
    model = random_tree(7, 5, floating=True).model
    s = states(model, 1, 1.0)
    n, rows = model.nv, table(model.bodies)
    work, after, pivots = scratch(friction.WORK, rows), np.zeros((3, n)), np.zeros(n)
    given = [x[0] for x in s.values()]
    given[3] = DT
    beside = friction.StepScratch(np.zeros((n, n)), np.zeros((n, n)), np.zeros((2, n)), np.zeros(1), np.zeros(1))
    friction.friction_step(rows, work, *given[:3], None, DT, friction.Law(*given[4:]), after, pivots, beside)
    assert work is not None
    wanted = violation(model, s, after[:1])[1][0]
    np.testing.assert_allclose([row.weight for row in work[1:]], wanted, rtol=1e-10)


# --- engines --------------------------------------------------------------------------------------------


@pytest.mark.slow(quick="test_torques_agree_in_every_engine")
@pytest.mark.parametrize("floating", [False, True])
def test_programs_kernels_and_the_exact_engine_agree(floating: bool) -> None:
    model = random_tree(3, 5, floating=floating).model
    s, spec = states(model, 40, 1.0), STEP
    inputs = [np.ascontiguousarray(x) for x in s.values()]
    found = [np.empty((40, 3 * model.nv)) for _ in range(2)]
    assert not len(run.batch(spec, model, inputs, (), found[0]).samples)
    assert not len(by_table_kernel.run_table_kernel(spec, model, inputs, (), found[1]).samples)
    np.testing.assert_allclose(found[0], found[1], rtol=0.0, atol=1e-11)
    np.testing.assert_array_equal(found[0][:, : model.nv] == 0.0, found[1][:, : model.nv] == 0.0)
    digits = arithmetic(120)
    for k in range(3):
        exact = {x: numbers(digits, y[min(k, len(y) - 1)]) for x, y in s.items()}
        exact["dt"] = exact["dt"][0]
        after = evaluate(spec, table(model.bodies, digits.number), (3, model.nv), exact, np.empty(model.nv, object))
        off = abs(np.array([float(x) for x in after[0]]) - found[0][k, : model.nv]).max()
        assert off <= 1e-11 * max(1.0, abs(found[0][k]).max())


def test_torques_agree_in_every_engine() -> None:
    model, spec = random_tree(2, 4, ["revolute"]).model, variant(FRICTION_TORQUE, {"smoothing"})
    s = states(model, 30, 1.0)
    given = {k: s[k] for k in ("v", "coulomb", "viscous", "static", "stribeck")} | {"smoothing": s["stribeck"] / 4.0}
    found = [np.empty((30, model.nv)) for _ in range(2)]
    run.batch(spec, model, list(given.values()), (), found[0])
    by_table_kernel.run_table_kernel(spec, model, list(given.values()), (), found[1])
    digits = arithmetic(120)
    exact = {x: numbers(digits, y[0]) for x, y in given.items()}
    truth = evaluate(spec, table(model.bodies, digits.number), (model.nv,), exact, None)
    for x in found:
        np.testing.assert_allclose(x, found[0], rtol=CLOSE, atol=4 * EPS)
        np.testing.assert_allclose(x[0], [float(y) for y in truth], rtol=CLOSE, atol=4 * EPS)


@pytest.mark.slow(quick="test_torques_agree_in_every_engine")
def test_a_joint_without_inertia_is_flagged() -> None:
    builder = sd.ModelBuilder("light").add_body(
        "rod", None, "revolute", (0, 0, 1), inertia=(1.0, (0, 0, 0), np.zeros((3, 3)))
    )
    model = builder.build()
    given = [np.array([[x]]) for x in (0.1, 0.0, 0.0, DT, 1.0, 0.0, 1.0, AT_ONCE)]
    failed = by_table_kernel.run_table_kernel(STEP, model, given, (), np.empty((1, 3)))
    assert len(failed.samples) == 1
