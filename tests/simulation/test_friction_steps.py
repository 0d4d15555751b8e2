"""Friction in simulate and rollout: classical oscillators to the digits of their closed forms, passivity, refusals."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scenes
from dense import Array
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record import recording
from spatialdyn.recursions.control.control_laws import law_spec
from spatialdyn.simulation import fixed_steps
from spatialdyn.simulation.driver import check_solved
from spatialdyn.simulation.effects import friction as friction_effect
from spatialdyn.simulation.effects.control import Feedback
from spatialdyn.simulation.effects.friction import WAYS, DryFriction
from spatialdyn.simulation.plan import Plan
from spatialdyn.simulation.steps import step_specs

EPS = float(np.finfo(float).eps)
SAME = 1e3 * EPS  # a few dozen steps of rounding in another order, scaled
STEPPED = "semi_implicit_euler"
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="heavy: thousands of steps")
K = 100.0  # [N/m] stiffness of the oscillators below, of 1 kg: ω = 10 rad/s


def masses(count: int = 1) -> sd.Model:
    """Masses of 1 kg on a slide, each on the one before it, without gravity: M is constant."""
    builder = sd.ModelBuilder("slides")
    for k in range(count):
        parent = f"mass{k - 1}" if k else None
        builder.add_body(f"mass{k}", parent, "prismatic", (1, 0, 0), inertia=(1.0, (0, 0, 0), np.eye(3) * 0.1))
    return builder.build(gravity=(0.0, 0.0, 0.0))


def spring(t: float, q: Array, v: Array, tau: Array) -> None:
    tau[:] = -K * q


def belt_spring(speed: float) -> Callable[..., None]:
    """The spring of a mass on a belt, in the belt's frame."""

    def pull(t: float, q: Array, v: Array, tau: Array) -> None:
        tau[:] = -K * (q + speed * t)

    return pull


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    return sd.load_urdf("three_link")


ARM = sd.Friction([0.5, 0.4, 0.3], [0.1, 0.1, 0.1], [0.7, 0.6, 0.5], 0.05, 1.0, 1e4, 30.0)


# --- oscillators ----------------------------------------------------------------------------------------


@compiled
def test_an_oscillator_stops_where_its_spring_no_longer_moves_it() -> None:
    """Each half period takes 2 F/k: .21, -.17, .13, -.09, .05, -.01, at t = 5π/10, and |k x| is then below F."""
    run = sd.simulate(
        sd.Scene(masses(), friction=sd.Friction([2.0], [0.0])),
        [0.21],
        [0.0],
        2.0,
        1e-4,
        STEPPED,
        torque=spring,
        record=1,
    )
    x, v = run.q[:, 0], run.v[:, 0]
    turns = np.flatnonzero(v[1:-1] * v[2:] <= 0.0) + 1
    np.testing.assert_allclose(
        [x[k] for k in turns[np.r_[True, np.diff(turns) > 10]][:4]], [-0.17, 0.13, -0.09, 0.05], atol=1e-6
    )
    assert x[-1] == pytest.approx(-0.01, abs=3e-8)  # -0.01000002
    rest = int(np.flatnonzero(v != 0.0)[-1]) + 1
    assert run.t[rest] == pytest.approx(5.0 * math.pi / 10.0, abs=3e-4)
    assert (v[rest:] == 0.0).all()
    assert (x[rest:] == x[-1]).all()


@compiled
def test_smooth_friction_creeps_where_a_dry_joint_rests() -> None:
    """An error of the textbook remedy: under τ below F the mass moves at ε atanh(τ/F), for ever."""
    smooth = sd.Friction([2.0], [0.0], smoothing=[1e-3])
    run = sd.simulate(
        sd.Scene(masses(), friction=smooth, friction_method="smooth"), [0.21], [0.0], 2.0, 1e-4, STEPPED, torque=spring
    )
    assert run.v[-1, 0] == pytest.approx(1e-3 * math.atanh(-K * run.q[-1, 0] / 2.0), rel=1e-3)
    assert run.v[-1, 0] == pytest.approx(5e-4, rel=0.1)


def check_belt(dt: float, tolerance: float) -> None:
    fs, fc, speed, omega = 3.0, 2.0, 0.1, math.sqrt(K)
    friction = sd.Friction([fc], [0.0], [fs])
    run = sd.simulate(
        sd.Scene(masses(), friction=friction), [0.0], [0.0], 1.5, dt, STEPPED, torque=belt_spring(speed), record=1
    )
    sticks, x = run.v[:, 0] == 0.0, run.q[:, 0] + speed * run.t
    changes = np.flatnonzero(sticks[1:] != sticks[:-1])
    slip = 2.0 / omega * (math.pi - math.atan((fs - fc) * omega / (K * speed)))
    assert slip == pytest.approx(0.471239, abs=1e-6)
    np.testing.assert_allclose(run.t[changes[0]], fs / (K * speed), atol=tolerance)
    np.testing.assert_allclose(np.diff(run.t[changes]), [slip, 2.0 * (fs - fc) / (K * speed), slip], atol=tolerance)
    np.testing.assert_allclose(
        x[changes], [fs / K, (2.0 * fc - fs) / K, fs / K, (2.0 * fc - fs) / K], atol=0.2 * tolerance
    )


@compiled
def test_a_mass_on_a_belt_sticks_and_slips() -> None:
    """It slips for 0.471239 s and sticks for 0.2 s, from F_s/k to (2 F_c - F_s)/k."""
    check_belt(1e-4, 3e-4)


@compiled
@pytest.mark.slow(quick="test_a_mass_on_a_belt_sticks_and_slips")
def test_stick_and_slip_converge_with_the_step() -> None:
    check_belt(2.5e-5, 7.5e-5)


@compiled
def test_bristles_bend_under_a_slow_ramp_and_slide_at_coulombs_level() -> None:
    friction = sd.Friction([1.0], [2.0], [1.5], [1e-3], bristle_stiffness=1e5, bristle_damping=300.0)
    ramp = np.linspace(0.0, 1.2, 2000)[:, None]
    run = sd.rollout(sd.Scene(masses(), friction=friction, friction_method="lugre"), [0.0], [0.0], ramp, dt=1e-3)
    assert run.bristles is not None
    assert run.bristles.shape == (2000, 1)
    assert run.bristles[-1, 0] == pytest.approx(1.2 / 1e5, rel=3e-3)
    slide = sd.rollout(
        sd.Scene(masses(), friction=friction, friction_method="lugre"),
        [0.0],
        [0.0],
        [2.0],
        dt=1e-3,
        steps=10_000,
        record="last",
    )
    assert slide.v[0] == pytest.approx((2.0 - 1.0) / 2.0, rel=1e-6)
    assert slide.bristles is not None
    assert slide.bristles[0] == pytest.approx(1.0 / 1e5, rel=1e-6)


def test_bristles_are_stable_where_an_explicit_step_explodes() -> None:
    """h² σ0 / m is 4e5; Euler's explicit step would grow by as much."""
    friction = sd.Friction([1.0], [0.0], bristle_stiffness=1e9, bristle_damping=300.0)
    run = sd.rollout(sd.Scene(masses(), friction=friction, friction_method="lugre"), [0.0], [1.0], dt=2e-2, steps=200)
    assert (abs(run.v) <= 1.0).all()
    assert abs(run.v[-1, 0]) < 1e-6


# --- passivity ------------------------------------------------------------------------------------------


@compiled
@pytest.mark.parametrize("way", ["implicit", "lugre"])
def test_friction_never_adds_energy(way: str) -> None:
    """Of masses with a constant M, whose own step keeps T to rounding; LuGre's bristles hold some of it."""
    model, rng = masses(4), np.random.default_rng(0)
    friction = sd.Friction(
        rng.uniform(0.0, 1.0, 4), rng.uniform(0.0, 0.3, 4), bristle_stiffness=1e3, bristle_damping=0.0
    )
    v0 = rng.normal(size=(50, 4))
    run = sd.rollout(sd.Scene(model, friction=friction, friction_method=way), np.zeros(4), v0, dt=2e-3, steps=1500)
    T = 0.5 * np.einsum("bti,ij,btj->bt", run.v, sd.crba(model, np.zeros(4)), run.v)
    stored = 0.0 if run.bristles is None else 0.5e3 * (run.bristles**2).sum(axis=2)
    total = T + stored
    assert (np.diff(total, axis=1) <= 1e-12).all()
    assert (total[:, -1] < 0.7 * total[:, 0]).all()


@compiled
def test_a_held_arm_stays_to_the_bit_and_falls_when_it_is_let_go(arm: sd.Model) -> None:
    q0 = np.array([0.3, -0.4, 0.5])
    g = abs(sd.generalized_gravity(arm, q0))
    tight, loose = (sd.Friction(x * g, np.zeros(3)) for x in (1.001, 0.5))
    held = sd.simulate(sd.Scene(arm, friction=tight), q0, np.zeros(3), 0.5, 1e-3, STEPPED)
    assert (held.q == q0).all()
    assert (held.v == 0.0).all()
    assert abs(sd.simulate(sd.Scene(arm, friction=loose), q0, np.zeros(3), 0.5, 1e-3, STEPPED).q[-1] - q0).max() > 0.1


# --- the same however it runs ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("way", "root"), slow_but([("implicit", "fixed")], [(x, root) for x in WAYS for root in ("fixed", "floating")])
)
def test_a_rollout_is_so_many_simulations(way: str, root: str) -> None:
    model = random_tree(108, 4, floating=root == "floating").model
    rng = np.random.default_rng(1)
    n = model.nv
    friction = sd.Friction(
        rng.uniform(0.0, 0.5, n), rng.uniform(0.0, 0.5, n), rng.uniform(0.5, 1.0, n), 0.1, 0.5, 1e3, 10.0
    )
    q0, v0 = sd.random_configuration(model, rng, (3,)), 0.3 * rng.standard_normal((3, n))
    tau = rng.standard_normal((3, 12, n))
    found = sd.rollout(sd.Scene(model, friction=friction, friction_method=way), q0, v0, tau, dt=2e-3, check=False)
    for k in range(3):
        args = (model, q0[k], v0[k], 12 * 2e-3, 2e-3, STEPPED)
        held = scenes.simulate(*args, torque=tau[k], friction=friction, friction_method=way)
        rows = {round(2e-3 * step, 9): tau[k, step] for step in range(12)}
        asked = lambda t, q, v, rows=rows: rows.get(round(t, 9), np.zeros(n))  # noqa: E731
        python = scenes.simulate(*args, torque=asked, friction=friction, friction_method=way)
        for run in (held, python):
            for x, y in ((found.q[k], run.q[1:]), (found.v[k], run.v[1:])):
                assert abs(x - y).max() <= SAME * max(1.0, abs(y).max())


@pytest.mark.parametrize("method", ["rk4", "velocity_verlet", "gauss4", "dop853"])
def test_smooth_friction_is_a_torque_of_every_method(arm: sd.Model, method: str) -> None:
    q0, v0 = np.array([0.4, 0.2, -0.3]), np.array([1.0, -0.5, 0.2])

    def resist(t: float, q: Array, v: Array) -> Array:
        return sd.friction_torque(arm, v, ARM)

    wanted = sd.simulate(arm, q0, v0, 0.2, 2e-3, method, torque=resist)
    found = sd.simulate(sd.Scene(arm, friction=ARM, friction_method="smooth"), q0, v0, 0.2, 2e-3, method)
    np.testing.assert_allclose(found.q, wanted.q, rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(found.tau, 0.0)  # the torque of the caller alone is recorded


def test_a_step_without_a_program_runs_all_the_same(arm: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    args = (arm, [0.3, 0.2, 0.1], [1.0, -1.0, 0.5], 0.05, 1e-3, STEPPED)
    for way in WAYS:
        wanted = scenes.simulate(*args, friction=ARM, friction_method=way)
        with monkeypatch.context() as patch:
            patch.setattr(fixed_steps, "program", lambda *_: None)
            found = scenes.simulate(*args, friction=ARM, friction_method=way)
        np.testing.assert_allclose(found.q, wanted.q, rtol=0.0, atol=SAME)
        np.testing.assert_allclose(found.v, wanted.v, rtol=0.0, atol=1e2 * SAME)


@pytest.mark.slow(quick="test_smooth_friction_is_a_torque_of_every_method")
@pytest.mark.parametrize("method", [STEPPED, "rk4"])
def test_external_forces_act_beside_friction(arm: sd.Model, method: str) -> None:
    """A force that cancels gravity on every body leaves the arm to its friction."""
    weightless, way = arm.with_(gravity=(0.0, 0.0, 0.0)), "implicit" if method == STEPPED else "smooth"
    args, kept = ([0.3, 0.2, 0.1], [1.0, -1.0, 0.5], 5e-3, 1e-3, method), dict(friction=ARM, friction_method=way)
    wanted = scenes.simulate(weightless, *args, **kept)
    fext = np.zeros((arm.njoints, 6))
    found = scenes.simulate(weightless, *args, **kept, fext=fext)
    np.testing.assert_allclose(found.q, wanted.q, rtol=0.0, atol=SAME)
    fext[-1, 3:] = 2.0
    assert abs(scenes.simulate(weightless, *args, **kept, fext=fext).v[-1] - wanted.v[-1]).max() > 1e-4


@pytest.mark.parametrize("way", WAYS)
def test_every_number_of_samples_gives_each_its_own_bits(arm: sd.Model, way: str) -> None:
    rng = np.random.default_rng(3)
    q0, v0 = rng.normal(size=(9, 3)), rng.normal(size=(9, 3))
    kept = dict(dt=1e-3, steps=40, friction=ARM, friction_method=way)
    many = scenes.rollout(arm, q0, v0, **kept)
    for k in (0, 8):
        one = scenes.rollout(arm, q0[k], v0[k], **kept)
        np.testing.assert_array_equal(one.q, many.q[k])
        if way == "lugre":
            assert one.bristles is not None
            assert many.bristles is not None
            np.testing.assert_array_equal(one.bristles, many.bristles[k])
        else:
            assert one.bristles is None


def test_angles_beyond_the_short_sine_are_right_and_disturb_no_other(arm: sd.Model) -> None:
    q0, v0 = np.zeros((5, 3)), np.ones((5, 3))
    kept = dict(dt=1e-3, steps=8, friction=ARM)
    wanted = scenes.rollout(arm, q0, v0, **kept)
    far = q0.copy()
    far[2, 0] += 2.0 * np.pi * 2**20
    found = scenes.rollout(arm, far, v0, **kept)
    np.testing.assert_array_equal(found.q[[0, 1, 3, 4]], wanted.q[[0, 1, 3, 4]])
    assert abs(found.v[2] - wanted.v[2]).max() <= 1e-6  # an angle of 7e6 has lost ten digits


def test_float32_follows_float64_and_sticks(arm: sd.Model) -> None:
    v0 = np.array([[1.0, 0.5, -0.5], [0.0, 0.0, 0.0]])
    kept = dict(dt=1e-3, steps=30, friction=ARM)
    wanted, found = (scenes.rollout(arm, np.zeros(3), v0, **kept, dtype=x) for x in (np.float64, np.float32))
    assert abs(found.v - wanted.v).max() <= 1e-4
    loaded = sd.Friction([100.0] * 3, [0.0] * 3)
    assert (
        sd.rollout(sd.Scene(arm, friction=loaded), np.zeros(3), np.zeros(3), dt=1e-3, steps=9, dtype=np.float32).v
        == 0.0
    ).all()


def test_coefficients_are_inputs_and_no_part_of_the_program(arm: sd.Model) -> None:
    """A program kept for one friction must not answer for another."""
    ends, none = [], lambda t, q, v: np.zeros(3)
    for scale in (1.0, 2.0):
        for stribeck in (None, 0.05):
            friction = sd.Friction([0.1 * scale] * 3, [0.1] * 3, [0.3 * scale] * 3, stribeck)
            found = sd.rollout(sd.Scene(arm, friction=friction), np.zeros(3), np.ones(3), dt=1e-3, steps=50)
            fresh = sd.simulate(
                sd.Scene(arm, friction=friction), np.zeros(3), np.ones(3), 0.05, 1e-3, STEPPED, torque=none
            )
            np.testing.assert_allclose(found.q[-1], fresh.q[-1], rtol=0.0, atol=SAME)
            ends.append(found.q[-1, 0])
    assert len({round(x, 9) for x in ends}) == 4


# --- cost of none ---------------------------------------------------------------------------------------

COUNTS = {  # mul, add, div of a step without friction, as before there was any
    (STEPPED, False): (87, 56, 2), (STEPPED, True): (93, 68, 2), ("rk4", False): (353, 239, 8),
    ("rk4", True): (359, 251, 8),
}  # fmt: skip


@pytest.mark.parametrize(("method", "law"), COUNTS)
def test_friction_that_is_not_asked_for_costs_no_operation(arm: sd.Model, method: str, law: bool) -> None:
    counts = recording.record(
        step_specs(method, (Feedback(law_spec("pd"), True),) if law else ()), arm.bodies
    ).program.operations
    assert tuple(counts[x] for x in ("mul", "add", "div")) <= COUNTS[method, law]
    assert counts["exp"] == counts["select"] == 0


# --- asked for or not -----------------------------------------------------------------------------------


def test_the_urdfs_friction_acts_where_it_is_asked_for() -> None:
    model = sd.load_urdf("tree")
    q0, v0 = np.zeros(model.nq), np.ones(model.nv)
    with pytest.warns(UserWarning, match="which simulate ignores unless friction=True"):
        free = sd.simulate(model, q0, v0, 0.02, 1e-3, STEPPED)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        none = sd.simulate(sd.Scene(model, friction=False), q0, v0, 0.02, 1e-3, STEPPED)
        acts = sd.simulate(sd.Scene(model, friction=True), q0, v0, 0.02, 1e-3, STEPPED)
        given = sd.simulate(sd.Scene(model, friction=sd.Friction.of(model)), q0, v0, 0.02, 1e-3, STEPPED)
    np.testing.assert_array_equal(none.q, free.q)
    np.testing.assert_array_equal(acts.q, given.q)
    assert abs(acts.q[-1] - free.q[-1]).max() > 1e-6
    many = sd.rollout(sd.Scene(model, friction=True), q0, v0, dt=1e-3, steps=20)
    np.testing.assert_allclose(many.q[-1], acts.q[-1], rtol=0.0, atol=SAME)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"method": "rk4"}, 'method is "rk4" and friction acts, expected semi_implicit_euler; impulses and'),
        (
            {"method": "gauss4", "friction_method": "lugre"},
            'method is "gauss4" and friction acts, expected semi_implicit_euler',
        ),
        ({"friction_method": "tanh"}, "friction_method is 'tanh', expected one of implicit, lugre, smooth"),
        ({"friction": sd.Friction([1.0] * 3, 0.0), "friction_method": "smooth"}, "friction has no smoothing"),
        ({"friction": sd.Friction([1.0] * 3, 0.0), "friction_method": "lugre"}, "friction has no bristle_stiffness"),
        (
            {"friction": None, "friction_method": "lugre"},
            'friction_method is "lugre" and no friction is given, expected',
        ),
        ({"dt": 0.5, "friction_method": "smooth"}, r"expected at most \S+ s, where semi_implicit_euler is stable"),
    ],
)
def test_what_cannot_be_is_refused_by_name(arm: sd.Model, changes: dict[str, Any], words: str) -> None:
    given: dict[str, Any] = {"dt": 1e-3, "method": STEPPED, "friction": ARM, **changes}
    with pytest.raises(sd.SimulationError, match=words):
        scenes.simulate(arm, np.zeros(3), np.zeros(3), 1.0, **given)
    if given["method"] in ("rk4", STEPPED):
        with pytest.raises(sd.SimulationError, match=words):
            scenes.rollout(arm, np.zeros(3), np.zeros(3), steps=2, **given)


@compiled
@pytest.mark.parametrize(("method", "factor"), [("rk4", 2.785), (STEPPED, 2.0)])
def test_the_stability_limit_of_smooth_friction_is_the_one_named(method: str, factor: float) -> None:
    """v̇ = -F/(m ε) v near rest: above the limit v jumps from side to side, below it decays."""
    model, friction = masses(), sd.Friction([2.0], [0.0], smoothing=[1e-2])
    limit = factor * 1e-2 / 2.0
    for dt, stays in ((0.95 * limit, False), (1.05 * limit, True)):
        kept = dict(friction=friction, friction_method="smooth")
        if stays:
            with pytest.raises(sd.SimulationError, match=f"expected at most {limit:.3g} s"):
                scenes.simulate(model, [0.0], [1e-5], 1.0, dt, method, **kept)
        else:
            assert abs(scenes.simulate(model, [0.0], [1e-5], 200 * dt, dt, method, **kept).v[-1, 0]) < 1e-8


def test_a_step_that_is_not_solved_is_an_error_with_its_sample(arm: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(friction_effect, "UNSOLVED", -1.0)  # any step is then beyond it
    with pytest.raises(sd.SimulationError, match=r"sample 0: friction violates Coulomb's law by \S+ rad/s or m/s"):
        sd.rollout(sd.Scene(arm, friction=ARM), np.zeros((2, 3)), np.zeros((2, 3)), dt=1e-3, steps=3)
    with pytest.raises(sd.SimulationError, match=r"friction violates Coulomb's law by .* up to t = \S+ s") as caught:
        sd.simulate(sd.Scene(arm, friction=ARM), np.zeros(3), np.zeros(3), 1e-2, 1e-3, STEPPED)
    assert len(caught.value.trajectory)
    assert sd.rollout(sd.Scene(arm, friction=ARM), np.zeros(3), np.zeros(3), dt=1e-3, steps=3, check=False).q.shape == (
        3,
        3,
    )


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("what", ["v0", "tau"])
def test_nan_and_overflow_reach_the_state_and_no_other_sample(arm: sd.Model, way: str, what: str) -> None:
    """A joint of unknown torque does not stick."""
    given: dict[str, Any] = {"v0": np.full((4, 3), 0.1), "tau": np.zeros((4, 5, 3))}
    kept = dict(dt=1e-3, friction=ARM, friction_method=way, check=False)
    clean = scenes.rollout(arm, np.zeros(3), **given, **kept)
    for bad in (np.nan, 1e200):
        given[what][2] = bad
        found = scenes.rollout(arm, np.zeros(3), **given, **kept)
        assert not np.isfinite(found.v[2, -1]).any()
        np.testing.assert_array_equal(found.v[[0, 1, 3]], clean.v[[0, 1, 3]])
    with pytest.raises(sd.SimulationError, match=r"sample 2: (v0 is|tau is|semi_implicit_euler diverged)"):
        scenes.rollout(arm, np.zeros(3), **given, **{**kept, "check": True})


def test_no_steps_leave_the_first_state_as_the_last(arm: sd.Model) -> None:
    last = sd.rollout(
        sd.Scene(arm, friction=ARM, friction_method="lugre"),
        np.ones((2, 3)),
        np.ones(3),
        dt=1e-3,
        steps=0,
        record="last",
    )
    np.testing.assert_array_equal(last.q, 1.0)
    np.testing.assert_array_equal(last.bristles, np.zeros((2, 3)))


@pytest.mark.parametrize("way", WAYS)
def test_a_robot_without_joints_has_no_friction(way: str) -> None:
    model = sd.ModelBuilder("plate").add_body("plate", None, "fixed").build()
    none = np.zeros(0)
    friction = sd.Friction(none, none, smoothing=none, bristle_stiffness=none)
    kept = dict(friction=friction, friction_method=way)
    assert scenes.simulate(model, none, none, 1e-2, 1e-3, STEPPED, **kept).q.shape == (11, 0)
    assert scenes.rollout(model, np.zeros((2, 0)), none, dt=1e-3, steps=3, **kept).q.shape == (2, 3, 0)
    assert scenes.rollout(model, np.zeros((0, 0)), none, dt=1e-3, steps=3, **kept).q.shape == (0, 3, 0)


def test_ctrl_c_leaves_a_whole_state(arm: sd.Model) -> None:
    def stop(t: float, q: Array, v: Array) -> Array:
        if t > 5e-3:
            raise KeyboardInterrupt
        return np.zeros(3)

    with pytest.raises(sd.SimulationInterrupt) as caught:
        sd.simulate(sd.Scene(arm, friction=ARM), np.zeros(3), np.ones(3), 1.0, 1e-3, STEPPED, torque=stop)
    whole = sd.simulate(sd.Scene(arm, friction=ARM), np.zeros(3), np.ones(3), 5e-3, 1e-3, STEPPED)
    kept = caught.value.trajectory
    np.testing.assert_allclose(kept.q[5], whole.q[5], rtol=0.0, atol=SAME)


@compiled
def test_an_unsolved_sample_is_found_behind_solved_ones(arm: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    """Samples are judged together, by one look while all are solved."""
    looks: list[float] = []
    whole = DryFriction.failure

    def failure(self: DryFriction, states: dict[str, Array], dt: float, t: float) -> str:
        looks.append(states["violation"][0])
        return whole(self, states, dt, t)

    monkeypatch.setattr(DryFriction, "failure", failure)
    scene, given = sd.Scene(arm, friction=ARM), (np.zeros((5, 3)), np.zeros((5, 3)))
    sd.rollout(scene, *given, dt=1e-3, steps=2)
    assert looks == [0.0]
    violations = np.array([0.0, 0.0, 0.5, 0.0, 0.4]).reshape(5, 1, 1)
    plan, records = Plan(scene, STEPPED, scene.effects), [np.zeros((5, 1, 3))] * 2
    with pytest.raises(sd.SimulationError, match=r"sample 2: friction violates .* by 0\.5 .* \(2 samples in all\)"):
        check_solved(plan, [*records, violations], 1e-3, 1)
