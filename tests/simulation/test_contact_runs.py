"""Contacts and joint limits in simulate and rollout: inclines, bounces, a walking quadruped, records, refusals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scenes
from dense import Array
from grounded import DT, G, box, hold, jacobian, mass, quadruped, stance, trot
from slow import slow_but

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.numbers import samples
from spatialdyn.engines.programs.record import recording
from spatialdyn.recursions.control.control_laws import law_spec
from spatialdyn.simulation import fixed_steps
from spatialdyn.simulation.effects import contacts as contact_effect
from spatialdyn.simulation.effects.contacts import contact_of
from spatialdyn.simulation.effects.control import Feedback
from spatialdyn.simulation.steps import step_specs

EPS = float(np.finfo(float).eps)
SAME = 1e4 * EPS  # some hundred steps of rounding in another order, scaled
STEPPED = "semi_implicit_euler"
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="heavy: thousands of steps")


@pytest.fixture(scope="module")
def robot() -> tuple[sd.Model, sd.Contacts, Array]:
    model, feet = quadruped()
    contacts = sd.Contacts(model, feet)
    return model, contacts, stance(model, contacts)


def both(model: sd.Model, q0: Any, v0: Any, dt: float, steps: int, **given: Any) -> tuple[Any, Any]:
    """A rollout and a simulation of the same, with records."""
    kept = dict(record="contacts", **given)
    run = scenes.simulate(model, q0, v0, steps * dt, dt, STEPPED, **{**kept, "record": (1, "contacts")})
    return scenes.rollout(model, q0, v0, dt=dt, steps=steps, **kept), run


# --- by hand --------------------------------------------------------------------------------------------


@compiled
def test_a_mass_slides_down_an_incline_at_3_205858() -> None:
    model = mass(math.pi / 6)
    many, one = both(model, np.zeros(3), np.zeros(3), DT, 500, contacts=sd.Contacts(model, {"z": 0.0}, friction=0.2))
    for v in (many.v, one.v[1:]):
        np.testing.assert_allclose(np.diff(v[:, 0]) / DT, 3.205858157774931, rtol=1e-11)
        assert abs(v[:, 2]).max() <= EPS


@compiled
def test_a_mass_on_0_3_rad_and_mu_0_5_stays_to_the_bit() -> None:
    model = mass(0.3)
    many, one = both(model, np.zeros(3), np.zeros(3), DT, 1000, contacts=sd.Contacts(model, {"z": 0.0}, friction=0.5))
    for x in (many.q, many.v, one.q, one.v):
        assert (x == 0.0).all()


@compiled
def test_a_mass_brakes_over_v_squared_by_two_mu_g() -> None:
    """Less v h / 2, as velocities act at the end of a step; then it rests."""
    model = mass()
    run = sd.rollout(
        sd.Scene(model, contacts=sd.Contacts(model, {"z": 0.0}, friction=0.3)),
        np.zeros(3),
        [1.0, 0.0, 0.0],
        dt=DT,
        steps=500,
    )
    assert 1.0 / (2.0 * 0.3 * G) == pytest.approx(0.169895, abs=5e-6)
    assert run.q[-1, 0] == pytest.approx(0.1698946 - 0.5 * DT, abs=2e-6)
    assert abs(run.v[-1]).max() <= EPS


@compiled
@pytest.mark.parametrize("dt", slow_but([1e-3], [1e-3, 1e-4]))
def test_a_ball_bounces_at_the_times_of_its_geometric_series(dt: float) -> None:
    """From 1 m with e = 0.5: .451524, .903047, 1.128809 s, and without end before 1.354571 s."""
    model = mass()
    fall = math.sqrt(2.0 / G)
    contacts = sd.Contacts(model, {"z": 0.0}, restitution=0.5)
    run = sd.simulate(sd.Scene(model, contacts=contacts), [0.0, 0.0, 1.0], np.zeros(3), 1.6, dt, STEPPED, record=1)
    z, v = run.q[:, 2], run.v[:, 2]
    bounces = run.t[1:][(v[:-1] < 0.0) & (v[1:] > 0.0)]
    wanted = [fall, 2.0 * fall, 2.5 * fall]
    np.testing.assert_allclose(wanted, [0.451524, 0.903047, 1.128809], atol=1e-6)
    np.testing.assert_allclose(bounces[:3], wanted, atol=3.0 * dt)
    rest = run.t[np.flatnonzero(abs(v) > 1e-9)[-1]]
    assert rest == pytest.approx(3.0 * fall, abs=20.0 * dt)
    assert abs(z[run.t > rest + dt]).max() <= 1e-12
    heights = [z[(run.t > a) & (run.t < b)].max() for a, b in ((wanted[0], wanted[1]), (wanted[1], wanted[2]))]
    np.testing.assert_allclose(heights, [0.25, 0.0625], rtol=40.0 * dt)


@compiled
def test_a_box_on_four_corners_creeps_within_the_tolerance() -> None:
    model, corners = box(0.3)
    for tolerance, creep in ((1e-6, 0.26e-6), (1e-10, 2e-11)):
        contacts = sd.Contacts(model, dict.fromkeys(corners, 0.0), friction=0.5, tolerance=tolerance)
        q = sd.neutral(model)
        q[2] -= sd.contact_gaps(model, contacts, q).min()
        run = sd.rollout(sd.Scene(model, contacts=contacts), q, np.zeros(6), dt=DT, steps=500)
        assert np.linalg.norm(run.q[-1, :3] - run.q[249, :3]) / (250 * DT) <= creep


# --- a quadruped ----------------------------------------------------------------------------------------


@compiled
def test_a_quadruped_stands_on_its_weight_and_its_feet_do_not_creep(robot: Any) -> None:
    model, contacts, q0 = robot
    run = sd.rollout(
        sd.Scene(model, contacts=contacts),
        q0,
        np.zeros(18),
        dt=DT,
        steps=2000,
        control=hold(model, q0),
        record="contacts",
    )
    record = run.contacts
    weight = record.impulse[-500:, :, 2].sum(axis=1).mean() / DT
    assert weight == pytest.approx(sd.total_mass(model) * G, rel=1e-3)
    ends = [sd.frame_placement(model, run.q[[-1001, -1]], name)[:, :2, 3] for name in contacts.names]
    assert max(abs(b - a).max() for a, b in ends) <= 1e-6 * 1000 * DT
    assert record.residual.max() <= 1e-4
    assert record.gap.shape == (2000, 4)
    assert abs(record.gap[-1]).max() <= 1e-9


@compiled
@pytest.mark.parametrize("mu", [0.8, 0.3])
def test_every_step_of_a_trotting_quadruped_is_solved(robot: Any, mu: float) -> None:
    model, _, q0 = robot
    contacts = sd.Contacts(model, dict.fromkeys(robot[1].names, 0.02), friction=mu)
    pd = hold(model, q0, trot(model, q0, 800, 2e-3))
    run = sd.rollout(sd.Scene(model, contacts=contacts), q0, np.zeros(18), dt=2e-3, control=pd, record="contacts")
    residual = run.contacts.residual
    assert residual.max() <= 1e-6
    f = run.contacts.impulse
    assert (np.linalg.norm(f[..., :2], axis=-1) <= mu * f[..., 2] + 1e-12).all()
    assert 0.2 < (f[..., 2] > 0.0).mean() < 0.95  # feet lift and land
    assert run.q[:, 2].min() > 0.2


@compiled
def test_impulses_are_what_the_momentum_changes_by(robot: Any) -> None:
    """Of velocities in the axes that the trunk has at the beginning; after the step they are turned with it."""
    model, contacts, q0 = robot
    pd = hold(model, q0, trot(model, q0, 100, DT))
    run = sd.rollout(sd.Scene(model, contacts=contacts), q0, np.zeros(18), dt=DT, control=pd, record="contacts")
    q, v = np.vstack([q0, run.q[:-1]]), np.vstack([np.zeros(18), run.v[:-1]])
    for k in range(0, 100, 7):
        tau = np.zeros(18)
        kp, kd, q_ref = (pd.values[x] for x in ("kp", "kd", "q_ref"))
        tau[6:] = kp[6:] * (q_ref[k, 7:] - q[k, 7:]) - kd[6:] * v[k, 6:]
        M, straight = sd.crba(model, q[k]), np.zeros(18)
        straight[:3] = np.cross(v[k, 3:6], v[k, :3])
        step = sd.contact_step(model, contacts, q[k], v[k], tau, DT)
        turn, before = sd.frame_placement(model, run.q[k], "trunk"), sd.frame_placement(model, q[k], "trunk")
        ahead = run.v[k].copy()
        ahead[:3] = before[:3, :3].T @ turn[:3, :3] @ ahead[:3]
        np.testing.assert_allclose(run.v[k], step.v, rtol=0.0, atol=1e-11)
        np.testing.assert_allclose(run.q[k], step.q, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(run.contacts.impulse[k], step.impulse, rtol=0.0, atol=1e-11)
        assert run.contacts.residual[k] == pytest.approx(step.residual, abs=1e-12)
        free = tau - sd.nonlinear_effects(model, q[k], v[k])
        change = M @ (ahead - v[k] - DT * straight) - DT * free
        J = jacobian(contacts, q[k])
        np.testing.assert_allclose(np.einsum("kin,ki->n", J, step.impulse), change, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(run.contacts.gap, sd.contact_gaps(model, contacts, run.q), rtol=0.0, atol=0.0)


@pytest.mark.slow(quick="constraints/test_contact_step.py::test_a_point_over_heights_feels_the_slope_below_it")
@compiled
def test_a_quadruped_lands_on_rough_ground_on_lanes(robot: Any) -> None:
    model, contacts, q0 = robot
    ground = sd.Heightfield(0.02 * np.random.default_rng(0).normal(size=(8, 8)), 0.4, (-1.6, -1.6))
    rough = sd.Contacts(model, dict.fromkeys(contacts.names, 0.02), terrain=ground)
    q = q0.copy()
    q[2] += 0.03 - sd.contact_gaps(model, rough, q0).min()
    kept: dict[str, Any] = dict(contacts=rough, record="contacts")
    run = scenes.rollout(model, q, np.zeros(18), dt=DT, steps=800, control=hold(model, q0), **kept)
    assert run.contacts.impulse[-1, :, 2].sum() / DT == pytest.approx(sd.total_mass(model) * G, rel=0.05)
    assert abs(run.contacts.gap[-1]).max() <= 1e-4
    assert np.percentile(run.contacts.residual, 95) <= 1e-4
    one = scenes.simulate(model, q, np.zeros(18), 0.02, DT, STEPPED, **kept)
    lanes = scenes.rollout(model, q, np.zeros(18), dt=DT, steps=20, **kept)
    np.testing.assert_allclose(one.v[1:], lanes.v, rtol=0.0, atol=1e-12)


# --- joint limits ---------------------------------------------------------------------------------------


def limited() -> sd.Model:
    """A pendulum that hangs down and turns a little to each side, and a slide with one limit."""
    made = sd.ModelBuilder("limited")
    made.add_body("a", None, "revolute", (0, 1, 0), inertia=(1.0, (0, 0, -0.5), np.eye(3) / 12), limits=(-0.25, 0.5))
    made.add_body("b", None, "prismatic", (0, 0, 1), (1, 0, 0), (1.0, (0, 0, 0), np.eye(3)), limits=(-0.2, math.inf))
    return made.build()


@pytest.mark.parametrize("speed", [3.0, -3.0])
def test_limits_alone_act(speed: float) -> None:
    model = limited()
    for run in both(model, np.zeros(2), [speed, 0.0], DT, 600, limits=True):
        angle = run.q[:, 0]
        assert max(angle.max() - 0.5, -0.25 - angle.min()) == pytest.approx(0.0, abs=1e-12)
        assert run.q[-1, 1] == pytest.approx(-0.2, abs=1e-12)
        assert run.contacts.stop[-1, 1] / DT == pytest.approx(G, abs=1e-9)
        assert run.contacts.impulse.shape[1:] == (0, 3)
        assert run.contacts.residual.max() <= 1e-12
    free = sd.rollout(model, np.zeros(2), [speed, 0.0], dt=DT, steps=600)
    assert free.q[:, 1].min() < -0.5


def test_joints_of_one_chain_stop_together() -> None:
    """Each at its limit under the weight of what it carries: in turn they would pass it on and on."""
    made, parent = sd.ModelBuilder("chain"), None
    for k in range(4):
        made.add_body(
            f"b{k}", parent, "revolute", (0, 1, 0), (0, 0, 0) if k == 0 else (0.5, 0, 0),
            (1.0, (0.25, 0, 0), 0.02 * np.eye(3)), limits=(-1.0, 0.0),
        )  # fmt: skip
        parent = f"b{k}"
    model = made.build()
    run = sd.rollout(sd.Scene(model, limits=True), np.zeros(4), np.zeros(4), dt=DT, steps=300, record="contacts")
    assert abs(run.v).max() <= 1e-6
    assert run.contacts.residual.max() <= 1e-6
    np.testing.assert_allclose(run.contacts.stop[-1] / DT, sd.generalized_gravity(model, np.zeros(4)), rtol=1e-6)


def test_limits_act_beside_feet(robot: Any) -> None:
    """Legs without torque fold up to the limits of their knees and no further."""
    model, contacts, q0 = robot
    rate = np.zeros(18)
    loose = sd.PD(np.zeros(18), np.r_[np.zeros(6), np.full(12, 0.2)], q0)
    kept = dict(dt=DT, steps=400, control=loose, contacts=contacts, check=False)
    shanks = [j.idx_q for j in model.joints if j.name.endswith("shank_joint")]
    free = scenes.rollout(model, q0, rate, **kept)
    held = scenes.rollout(model, q0, rate, limits=True, **kept, record="contacts")
    assert abs(free.q[:, shanks]).max() > 2.5
    assert abs(held.q[:, shanks]).max() <= 2.5 + 1e-4
    assert np.count_nonzero(held.contacts.stop)


# --- however it runs ------------------------------------------------------------------------------------


@pytest.mark.slow(quick="test_every_number_of_samples_gives_each_its_own_bits")
@pytest.mark.parametrize("limits", [False, True])
def test_a_rollout_is_so_many_simulations(robot: Any, limits: bool) -> None:
    model, contacts, q0 = robot
    rng = np.random.default_rng(0)
    tau = 3.0 * rng.standard_normal((3, 30, 18))
    tau[..., :6] = 0.0
    v0 = 0.3 * rng.standard_normal((3, 18))
    kept: dict[str, Any] = dict(contacts=contacts, limits=limits, record="contacts")
    found = scenes.rollout(model, q0, v0, tau, dt=DT, **kept)
    for k in range(3):
        args = (model, q0, v0[k], 30 * DT, DT, STEPPED)
        held = scenes.simulate(*args, torque=tau[k], **kept)
        rows = {round(DT * step, 9): tau[k, step] for step in range(30)}
        asked = lambda t, q, v, rows=rows: rows.get(round(t, 9), np.zeros(18))  # noqa: E731
        python = scenes.simulate(*args, torque=asked, **kept)
        for run in (held, python):
            np.testing.assert_allclose(found.v[k], run.v[1:], rtol=0.0, atol=1e-9)
            np.testing.assert_allclose(found.contacts.impulse[k], run.contacts.impulse[1:], rtol=0.0, atol=1e-9)
            np.testing.assert_allclose(found.contacts.gap[k], run.contacts.gap[1:], rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(found.contacts.stop[k], run.contacts.stop[1:], rtol=0.0, atol=1e-9)
            assert (run.contacts.impulse[0] == 0.0).all()


def test_every_number_of_samples_gives_each_its_own_bits(robot: Any) -> None:
    model, contacts, q0 = robot
    v0 = 0.2 * np.random.default_rng(1).normal(size=(9, 18))
    kept = dict(dt=DT, steps=20, contacts=contacts, record="contacts")
    many = scenes.rollout(model, q0, v0, **kept)
    for k in (0, 8):
        one = scenes.rollout(model, q0, v0[k], **kept)
        for x, y in ((one.q, many.q[k]), (one.v, many.v[k]), (one.contacts.impulse, many.contacts.impulse[k])):
            np.testing.assert_array_equal(x, y)


@pytest.mark.slow(quick="simulation/test_rollouts.py::test_a_rollout_is_so_many_simulations")
def test_records_come_every_k_th_step_and_last(robot: Any) -> None:
    model, contacts, q0 = robot
    kept: dict[str, Any] = dict(dt=DT, steps=12, contacts=contacts)
    whole = scenes.rollout(model, q0, np.zeros((2, 18)), record="contacts", **kept)
    some = scenes.rollout(model, q0, np.zeros((2, 18)), record=(4, "contacts"), **kept)
    last = scenes.rollout(model, q0, np.zeros((2, 18)), record=("last", "contacts"), **kept)
    for x, y, z in zip(whole.contacts, some.contacts, last.contacts, strict=True):
        np.testing.assert_array_equal(y, x[:, 3::4])
        np.testing.assert_array_equal(z, x[:, -1])
    assert sd.rollout(sd.Scene(model, contacts=contacts), q0, np.zeros(18), dt=DT, steps=3).contacts is None
    none = scenes.rollout(model, q0, np.zeros(18), **{**kept, "steps": 0}, record=("last", "contacts"))
    assert (none.contacts.impulse == 0.0).all()
    thin = sd.simulate(
        sd.Scene(model, contacts=contacts), q0, np.zeros(18), 10 * DT, DT, STEPPED, record=(4, "contacts")
    )
    np.testing.assert_array_equal(thin.t, np.array([0, 4, 8, 10]) * DT)
    assert thin.contacts.impulse.shape == (4, 4, 3)


def test_a_step_without_a_program_runs_all_the_same(robot: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    model, contacts, q0 = robot
    bouncing = sd.Contacts(model, dict.fromkeys(contacts.names, 0.02), restitution=0.2)
    args = (model, q0, np.zeros(18), 0.02, DT, STEPPED)
    kept: dict[str, Any] = dict(contacts=bouncing, record="contacts")
    wanted = scenes.simulate(*args, **kept)
    with monkeypatch.context() as patch:
        patch.setattr(fixed_steps, "program", lambda *_: None)
        found = scenes.simulate(*args, **kept)
    np.testing.assert_allclose(found.v, wanted.v, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(found.contacts.impulse, wanted.contacts.impulse, rtol=0.0, atol=1e-10)


@compiled
def test_a_torque_of_python_compiles_no_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes a minute; a program that is interpreted at first answers in milliseconds, with the same bits."""
    model, names = box()
    scene = sd.Scene(model, contacts=sd.Contacts(model, dict.fromkeys(names, 0.0)))
    start = np.array([0, 0, 0.11, 0, 0, 0, 1.0]), np.array([0.3, 0, 0, 0.1, 0.2, 0])
    right, asked_for = numba_kernels.sample_kernel, []

    def noted(spec: Any) -> Any:
        asked_for.append(spec.name)
        return right(spec)

    monkeypatch.setattr(numba_kernels, "sample_kernel", noted)
    free = sd.simulate(scene, *start, 0.05, 1e-3)
    asked = sd.simulate(scene, *start, 0.05, 1e-3, torque=lambda t, q, v: np.zeros(6))
    assert not asked_for
    np.testing.assert_allclose(asked.q, free.q, rtol=0.0, atol=1e-12)


def test_float32_follows_float64(robot: Any) -> None:
    model, contacts, q0 = robot
    kept: dict[str, Any] = dict(dt=DT, steps=30, control=hold(model, q0), contacts=contacts)
    wanted, found = (scenes.rollout(model, q0, np.zeros((2, 18)), **kept, dtype=x) for x in (np.float64, np.float32))
    assert found.v.dtype == np.float32
    assert abs(found.v - wanted.v).max() <= 1e-3


def test_angles_beyond_the_short_sine_are_right_and_disturb_no_other(robot: Any) -> None:
    model, contacts, q0 = robot
    starts = np.tile(q0, (5, 1))
    kept: dict[str, Any] = dict(dt=DT, steps=4, contacts=contacts)
    wanted = scenes.rollout(model, starts, np.zeros(18), **kept)
    starts[2, 7:] += 2.0 * np.pi * 2**20
    found = scenes.rollout(model, starts, np.zeros(18), **kept)
    np.testing.assert_array_equal(found.v[[0, 1, 3, 4]], wanted.v[[0, 1, 3, 4]])
    assert abs(found.v[2] - wanted.v[2]).max() <= 1e-5


def test_smooth_friction_and_forces_act_beside_contacts(robot: Any) -> None:
    model, contacts, q0 = robot
    friction = sd.Friction(np.zeros(18), np.r_[np.zeros(6), np.full(12, 0.5)], smoothing=1.0)
    kept: dict[str, Any] = dict(contacts=contacts, friction=friction, friction_method="smooth")
    args = (model, q0, np.zeros(18), 0.02, DT, STEPPED)
    program = scenes.simulate(*args, **kept)
    resist = lambda t, q, v: sd.friction_torque(model, v, friction)  # noqa: E731
    torque = scenes.simulate(*args, torque=resist, contacts=contacts)
    np.testing.assert_allclose(program.v, torque.v, rtol=0.0, atol=1e-9)
    lift = np.zeros((model.njoints, 6))
    lift[1, 2] = 1.1 * sd.total_mass(model) * G
    up = scenes.simulate(*args, contacts=contacts, fext=lift, record="contacts")
    assert up.contacts is not None
    assert up.contacts.impulse[2:, :, 2].sum(axis=1).max() / DT < 0.5 * sd.total_mass(model) * G
    assert up.v[-1, 2] > 0.0


def test_friction_and_restitution_are_inputs_and_no_part_of_the_program() -> None:
    model = mass(0.5)
    ends = []
    for mu in (0.1, 0.2):
        for e in (0.3, 0.6):
            contacts = sd.Contacts(model, {"z": 0.0}, mu, e)
            run = sd.rollout(sd.Scene(model, contacts=contacts), [0.0, 0.0, 0.01], np.zeros(3), dt=DT, steps=120)
            none = lambda t, q, v: np.zeros(3)  # noqa: E731
            fresh = sd.simulate(
                sd.Scene(model, contacts=contacts), [0.0, 0.0, 0.01], np.zeros(3), 0.12, DT, STEPPED, torque=none
            )
            np.testing.assert_allclose(run.q[-1], fresh.q[-1], rtol=0.0, atol=SAME)
            ends.append(tuple(np.round(run.q[-1], 9)))
    assert len(set(ends)) == 4


# --- work -----------------------------------------------------------------------------------------------


def test_the_ledger_of_a_mass_that_brakes_is_its_friction() -> None:
    """½ m v² is lost to the ground, on lanes and by kernels."""
    model = mass()
    contacts = sd.Contacts(model, {"z": 0.0}, friction=0.3)
    args = (model, np.zeros(3), [1.0, 0.0, 0.0], 0.5, DT, STEPPED)
    for torque in (None, lambda t, q, v: np.zeros(3)):
        run = scenes.simulate(*args, torque=torque, contacts=contacts, record="work")
        ledger = sd.energy_ledger(run)
        assert ledger.labels["contacts"] == ('point "z"',)
        assert ledger.work["contacts"][-1] == pytest.approx([-0.5], abs=1e-12)
        assert (np.diff(ledger.work["contacts"][:, 0]) <= 0.0).all()
        assert abs(ledger.error).max() <= 1e-12


@compiled
def test_the_ledger_of_a_landing_has_points_limits_and_torques() -> None:
    """Impulses do ½ λᵀ(u⁻ + u⁺): an inelastic landing takes the energy of the fall; a joint at its limit gives none."""
    model = limited()
    run = sd.simulate(
        sd.Scene(model, limits=True),
        [0.0, 0.1],
        [1.0, 0.0],
        0.6,
        1e-4,
        STEPPED,
        torque=[0.3, 0.0],
        record=(10, "work", "contacts"),
    )
    ledger = sd.energy_ledger(run)
    assert set(ledger.work) == {"torque", "contacts"}
    assert ledger.work["contacts"].shape[1] == 2
    assert ledger.work["contacts"][-1, 1] == pytest.approx(-G * 0.3, rel=1e-3)
    assert abs(ledger.error).max() <= 2e-3  # of first order in the step


def test_the_ledger_of_a_run_takes_its_contacts_with_the_limits_beside_them() -> None:
    """``limits=True`` adds columns, which the Contacts that were given to the run do not name."""
    model = limited()
    contacts = sd.Contacts(model, {"a": 0.0}, terrain=sd.Plane(height=-9.0))
    run = sd.simulate(
        sd.Scene(model, limits=True, contacts=contacts), [0.0, 0.1], [1.0, 0.0], 0.01, 1e-3, STEPPED, record="work"
    )
    labels = sd.energy_ledger(run).labels["contacts"]
    assert labels == contacts.with_limits().labels
    assert len(labels) == 3


def test_a_control_law_stands_beside_contacts(robot: Any) -> None:
    """Carried with the step, and the same as its torque by a function."""
    model, contacts, q0 = robot
    kd = np.r_[np.zeros(6), np.full(12, 1.5)]
    law = sd.PD(np.zeros(18), kd, q0)
    wanted = sd.rollout(sd.Scene(model, contacts=contacts), q0, np.zeros(18), dt=DT, steps=20, control=law)
    damp = lambda t, q, v: -kd * v  # noqa: E731
    found = sd.simulate(
        sd.Scene(model, contacts=contacts), q0, np.zeros(18), 20 * DT, DT, STEPPED, torque=damp, record="work"
    )
    np.testing.assert_allclose(found.v[1:], wanted.v, rtol=0.0, atol=1e-9)
    assert sd.energy_ledger(found).work["torque"][-1].sum() < 0.0


def test_a_file_keeps_what_was_recorded_of_contacts(tmp_path: Any) -> None:
    model = mass()
    contacts = sd.Contacts(model, {"z": 0.0}, friction=0.3)
    run = sd.simulate(
        sd.Scene(model, contacts=contacts), np.zeros(3), [1.0, 0.0, 0.0], 0.01, DT, STEPPED, record="contacts"
    )
    run.save(tmp_path / "run.npz")
    found = sd.Trajectory.load(tmp_path / "run.npz")
    assert found.contacts is not None
    for name, x in run.contacts._asdict().items():
        np.testing.assert_array_equal(getattr(found.contacts, name), x)
    assert found.states == {}
    assert found.spring_energy is None


# --- cost of none ---------------------------------------------------------------------------------------

COUNTS = {(STEPPED, False): (87, 56, 2), (STEPPED, True): (93, 68, 2), ("rk4", False): (353, 239, 8)}


@pytest.mark.parametrize(("method", "law"), COUNTS)
def test_contacts_that_are_not_asked_for_cost_no_operation(method: str, law: bool) -> None:
    """The counts of ``test_friction_steps``: those of before there was any."""
    specs = step_specs(method, (Feedback(law_spec("pd"), True),) if law else ())
    counts = recording.record(specs, sd.load_urdf("three_link").bodies).program.operations
    assert tuple(counts[x] for x in ("mul", "add", "div")) <= COUNTS[method, law]
    assert counts["select"] == 0


# --- refusals -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [2e-3, 1e-3, 1e-4, 2e-5])
def test_a_point_in_the_ground_comes_out_at_rest_whatever_the_step(dt: float) -> None:
    """By a share of its depth a step it would be thrown, the higher the shorter the step."""
    made = sd.ModelBuilder("ball")
    made.add_body("ball", None, "prismatic", (0, 0, 1), inertia=(1.0, (0, 0, 0), 0.01 * np.eye(3)), limits=(-1.0, 9.0))
    model = made.build()
    contacts = sd.Contacts(model, {"ball": 0.05})
    run = sd.rollout(sd.Scene(model, contacts=contacts), [[0.05 - 9e-4]], [[0.0]], dt=dt, steps=round(0.2 / dt))
    assert run.q.max() < 0.05 + 1e-9
    assert run.q[0, -1] > 0.05 - 1e-6
    low = sd.rollout(sd.Scene(model, limits=True), [[-1.0 - 9e-4]], [[0.0]], dt=dt, steps=round(0.2 / dt))
    assert low.q.max() < -1.0 + 1e-9


def test_a_start_in_the_ground_or_beyond_a_limit_is_named_with_its_depth(robot: Any) -> None:
    model, contacts, q0 = robot
    low = q0.copy()
    low[2] -= 0.012
    with pytest.raises(sd.SimulationError, match='point "lf_foot" starts 12 mm in the ground, expected at most 1 mm'):
        sd.simulate(sd.Scene(model, contacts=contacts), low, np.zeros(18), 0.01, DT, STEPPED)
    with pytest.raises(sd.SimulationError, match='point "lf_foot" starts 12 mm in the ground in sample 1'):
        sd.rollout(sd.Scene(model, contacts=contacts), np.stack([q0, low]), np.zeros(18), dt=DT, steps=1)
    with pytest.raises(sd.SimulationError, match=r'joint "a_joint" starts 0\.1 rad or m beyond its limits'):
        sd.simulate(sd.Scene(limited(), limits=True), [0.6, 0.0], [0.0, 0.0], 0.01, DT, STEPPED)


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"method": "rk4"}, sd.SimulationError, 'method is "rk4" and contacts act, expected semi_implicit_euler'),
        (
            {"method": "rk4", "contacts": None, "limits": True},
            sd.SimulationError,
            'method is "rk4" and limits act, expected',
        ),
        ({"contacts": 3}, sd.ConstraintError, "contacts are a int, expected Contacts"),
        ({"limits": "yes"}, sd.SpatialDynError, "limits is 'yes', expected True or False"),
        ({"contacts": None, "record": "contacts"}, sd.SimulationError, 'record has "contacts", expected contacts'),
    ],
)
def test_what_cannot_be_is_refused_by_name(robot: Any, changes: dict[str, Any], error: Any, words: str) -> None:
    model, contacts, q0 = robot
    given = {"method": STEPPED, "contacts": contacts, **changes}
    with pytest.raises(error, match=words):
        scenes.simulate(model, q0, np.zeros(18), 0.01, DT, **given)
    with pytest.raises(error, match=words):
        scenes.rollout(model, q0, np.zeros(18), dt=DT, steps=2, **given)


@pytest.mark.slow(quick="test_limits_act_beside_feet")
def test_more_than_twelve_points_run_but_not_on_lanes() -> None:
    made = sd.ModelBuilder("raft")
    made.add_body("raft", None, "floating", inertia=(3.0, (0, 0, 0), np.eye(3)))
    for k in range(13):
        made.add_body(f"p{k}", "raft", "fixed", placement=(math.cos(k), math.sin(k), 0.0))
    model = made.build()
    contacts = sd.Contacts(model, {f"p{k}": 0.0 for k in range(13)})
    q0 = sd.neutral(model)
    many = sd.rollout(sd.Scene(model, contacts=contacts), np.tile(q0, (2, 1)), np.zeros(6), dt=DT, steps=5)
    run = sd.simulate(sd.Scene(model, contacts=contacts), q0, np.zeros(6), 5 * DT, DT, STEPPED, record="contacts")
    assert run.contacts is not None
    np.testing.assert_array_equal(many.q[1], run.q[1:])
    assert run.contacts.impulse[-1, :, 2].sum() / DT == pytest.approx(3.0 * G, rel=1e-2)


@compiled
def test_more_heights_than_lanes_take_run_one_by_one(robot: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A few steps wait for no kernel that compiles for half a minute, and calls never do. They read the heights below
    the points alone, and long runs name the heights."""
    model, contacts, q0 = robot
    rows, told = [], []
    monkeypatch.setattr(samples, "table", lambda x, number, made=samples.table: rows.append(len(x)) or made(x, number))
    monkeypatch.setattr(fixed_steps, "SLICE", 0.0)
    says = fixed_steps.reporting
    monkeypatch.setattr(fixed_steps, "reporting", lambda given, doing: told.append(doing) or says(given, doing))
    for name in ("sample_kernel", "batch_kernel"):
        made = getattr(numba_kernels, name)
        monkeypatch.setattr(numba_kernels, name, lambda spec, made=made: made(spec) if not spec.large else None)
    ground = sd.Heightfield(np.zeros((64, 64)), 0.1, (-3.2, -3.2))
    wide = sd.Contacts(model, dict.fromkeys(contacts.names, 0.02), terrain=ground)
    q0 = q0 + np.eye(19)[2]  # above it
    scene, starts = sd.Scene(model, contacts=wide), np.tile(np.zeros(18), (2, 1))
    starts[1, 2] = -0.5
    runs = sd.rollout(scene, q0, starts, dt=DT, steps=2, record="contacts")
    alone = sd.simulate(scene, q0, starts[1], 2 * DT, DT, record="contacts")
    np.testing.assert_array_equal(runs.q[1], alone.q[1:])
    assert runs.contacts is not None
    assert alone.contacts is not None
    np.testing.assert_array_equal(runs.contacts.gap[1], alone.contacts.gap[1:])
    step = sd.contact_step(model, wide, q0, starts[1], np.zeros(18), DT)
    np.testing.assert_allclose(step.q, alone.q[1], rtol=0.0, atol=1e-12)
    assert 0 < max(rows) < 64
    assert {*told} == {"simulate in plain Python, for 4096 heights, more than the 2048 of a program"}
    assert len(told) == 3


def test_a_step_that_is_not_solved_names_sample_time_and_point(robot: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    model, contacts, q0 = robot
    rough = sd.Contacts(model, {"trunk": 0.0, **dict.fromkeys(contacts.names, 0.02)}, tolerance=1.0)  # a sweep
    v0 = np.zeros((2, 18))
    v0[:, 2], v0[:, 3] = -0.5, [0.5, 1.0]
    monkeypatch.setattr(contact_effect, "UNSOLVED", 1e-12)
    kept: dict[str, Any] = dict(dt=DT, steps=30, contacts=rough)
    words = r'point "\w+_foot" misses its law by \S+ m/s in the step from t = \S+ s, expected at most 1e-12'
    with pytest.raises(sd.SimulationError, match=rf"sample 0: {words}.* \(2 samples in all\); check=False lets it"):
        scenes.rollout(model, q0, v0, **kept)
    with pytest.raises(sd.SimulationError, match=words) as caught:
        sd.simulate(sd.Scene(model, contacts=rough), q0, v0[1], 30 * DT, DT, STEPPED)
    assert len(caught.value.trajectory)
    assert scenes.rollout(model, q0, v0, **kept, check=False).q.shape == (2, 30, 19)


def test_nan_reaches_the_state_and_no_other_sample(robot: Any) -> None:
    model, contacts, q0 = robot
    tau = np.zeros((4, 5, 18))
    kept: dict[str, Any] = dict(dt=DT, contacts=contacts, check=False, record="contacts")
    clean = scenes.rollout(model, q0, np.zeros(18), tau, **kept)
    tau[2, 1, 8] = np.nan
    found = scenes.rollout(model, q0, np.zeros(18), tau, **kept)
    assert not np.isfinite(found.v[2, -1]).any()
    np.testing.assert_array_equal(found.v[[0, 1, 3]], clean.v[[0, 1, 3]])
    with pytest.raises(sd.SimulationError, match=r"sample 2: (v0 is|tau is|semi_implicit_euler diverged)"):
        scenes.rollout(model, q0, np.zeros(18), tau, **{**kept, "check": True})


def test_a_robot_with_nothing_to_touch_with_runs_as_without() -> None:
    model = sd.load_urdf("pendulum")
    kept: dict[str, Any] = dict(dt=DT, steps=5)
    free = scenes.rollout(model, [0.3], [0.0], **kept)
    none = scenes.rollout(model, [0.3], [0.0], **kept, contacts=sd.Contacts(model, {}))
    np.testing.assert_array_equal(none.q, free.q)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_steps_have_a_phase_of_rebounds_only_where_a_point_has_restitution(restitution: float) -> None:
    model = mass()
    scene = sd.Scene(model, contacts=sd.Contacts(model, {"z": 0.0}, restitution=restitution))
    effect = contact_of(scene, (), False, None)
    assert effect is not None
    names = {x.name for x in effect._spec(None, False).present}
    assert ("restitution" in names) == (restitution > 0.0)
    assert ("restitution" in effect.values) == (restitution > 0.0)
