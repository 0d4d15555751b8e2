"""Dry joints, motors, bristles, springs and constraints beside contacts, and dry joints of closed loops."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
from dense import Array
from grounded import DT, G, hold, mass, quadruped, stance, trot

import spatialdyn as sd
from spatialdyn.bodies.static_table import StaticTable
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.recursions.contact.impulse_step import impulse_step_spec
from spatialdyn.recursions.spec import shape_in

sys.path.append(str(Path(__file__).parents[1] / "constraints"))
from mechanisms import four_bar, four_bar_state, pin_of, rod

STEPPED = "semi_implicit_euler"
EPS = float(np.finfo(float).eps)
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="heavy: thousands of steps")


def walker() -> tuple[sd.Model, sd.Contacts, Array]:
    """A trunk in the plane of x and z on two legs with knees, on its feet."""
    made = sd.ModelBuilder("walker")
    made.add_body("x", None, "prismatic", (1, 0, 0)).add_body("z", "x", "prismatic", (0, 0, 1))
    made.add_body("trunk", "z", "revolute", (0, 1, 0), inertia=(6.0, (0, 0, 0), 0.2 * np.eye(3)))
    for name, side in (("front", 1.0), ("hind", -1.0)):
        thigh, shank = f"{name}_thigh", f"{name}_shank"
        heavy, light = (0.6, (0, 0, -0.1), 4e-3 * np.eye(3)), (0.2, (0, 0, -0.1), 1e-3 * np.eye(3))
        made.add_body(thigh, "trunk", "revolute", (0, 1, 0), (0.25 * side, 0, 0), heavy, limits=(-1.5, 1.5))
        made.add_body(shank, thigh, "revolute", (0, 1, 0), (0, 0, -0.25), light)
        made.add_body(f"{name}_foot", shank, "fixed", placement=(0, 0, -0.25))
    model = made.build()
    contacts = sd.Contacts(model, {"front_foot": 0.02, "hind_foot": 0.02})
    q = np.array([0.0, 1.0, 0.0, 0.6, -1.2, -0.6, 1.2])
    q[1] -= sd.contact_gaps(model, contacts, q).min()
    return model, contacts, q


def legs(model: sd.Model, level: float, damping: float = 0.05, **named: Any) -> sd.Friction:
    """Friction of the walker's legs."""
    there = np.r_[np.zeros(3), np.ones(model.nv - 3)]
    return sd.Friction(level * there, damping * there, **named)


def footed() -> tuple[sd.Model, sd.Constraints, Array]:
    """A four-bar in the plane of x and y with a foot below its coupler."""
    made = sd.ModelBuilder("footed")
    made.add_body("crank", None, "revolute", (0, 0, 1), (0, 0, 0), rod(0.2))
    made.add_body("coupler", "crank", "revolute", (0, 0, 1), (0.2, 0, 0), rod(0.5))
    made.add_body("rocker", None, "revolute", (0, 0, 1), (0.5, 0, 0), rod(0.4))
    made.add_body("foot", "coupler", "fixed", placement=(0.25, -0.05, 0))
    model = made.build(gravity=(0, -G, 0))
    return model, pin_of(model), four_bar_state()[0]


def solved(model: sd.Model, has: set[str], table: StaticTable, given: dict[str, Any], held: Any = None) -> Any:
    """The parts of a step by the recursion itself, in plain Python."""
    spec = impulse_step_spec(frozenset(has))
    sizes = {"nv": model.nv, "nq": model.nq, "njoints": model.njoints, **table.sizes}
    values = {"contacts": table.rows, **given}
    if held is not None:
        sizes |= held.table.sizes
        values["constraints"] = held.table.rows
    out = np.full(shape_in(spec.output.shape, sizes), np.nan)
    spec.run(model.bodies, np.zeros(model.nv + 1, spec.work), values, out, lambda shape: np.full(shape, np.nan))
    return {x.name: y for x, y in zip(spec.parts, spec.split(out, sizes), strict=True)}


def coefficients(friction: sd.Friction) -> dict[str, Array]:
    """As a step takes them."""
    return dict(zip(("coulomb", "viscous", "static", "stribeck"), friction.law, strict=True))


# --- by hand --------------------------------------------------------------------------------------------


def test_a_mass_brakes_by_the_ground_and_by_its_joint() -> None:
    """μ g + F/m, as in MuJoCo, whose friction is soft; then it rests to the bit."""
    model = mass()
    contacts = sd.Contacts(model, {"z": 0.0}, friction=0.3)
    friction = sd.Friction(np.array([2.0, 0.0, 0.0]), 0.0)
    kept: dict[str, Any] = dict(dt=DT, contacts=contacts, friction=friction, record="contacts")
    run = scenes.rollout(model, np.zeros(3), [1.0, 0.0, 0.0], steps=300, **kept)
    moving = run.v[:, 0] > 0.01
    assert 150 < moving.sum() < 250
    np.testing.assert_allclose(np.diff(run.v[moving, 0]) / DT, -(0.3 * G + 2.0), rtol=1e-9)
    assert (run.v[-1, :1] == 0.0).all()
    assert run.contacts.residual.max() <= 1e-12


def test_joints_that_rub_brake_as_in_mujoco() -> None:
    mujoco = pytest.importorskip("mujoco")
    text = """<mujoco><option timestep="0.001" cone="elliptic" impratio="100"/><worldbody>
      <geom type="plane" size="0 0 1" friction="0.3 0 0"/>
      <body pos="0 0 0.1"><joint type="slide" axis="1 0 0" frictionloss="2"/><joint type="slide" axis="0 1 0"/>
      <joint type="slide" axis="0 0 1"/><geom type="sphere" size="0.1" mass="1" friction="0.3 0 0"/></body>
      </worldbody></mujoco>"""
    theirs = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(theirs)
    data.qvel[:] = [1.0, 0.5, 0.0]
    model = mass()
    contacts = sd.Contacts(model, {"z": 0.0}, friction=0.3)
    friction = sd.Friction(np.array([2.0, 0.0, 0.0]), 0.0)
    run = sd.rollout(
        sd.Scene(model, contacts=contacts, friction=friction), np.zeros(3), [1.0, 0.5, 0.0], dt=DT, steps=150
    )
    for k in range(150):
        mujoco.mj_step(theirs, data)
        np.testing.assert_allclose(data.qvel[:2], run.v[k, :2], rtol=0.0, atol=0.02)
    np.testing.assert_allclose(data.qpos[:2], run.q[-1, :2], rtol=0.03)


@pytest.mark.parametrize(("share", "sticks"), [(0.98, False), (1.02, True)])
def test_a_loop_sticks_by_the_sum_of_its_joints(share: float, sticks: bool) -> None:
    """Along the one freedom of a four-bar: Σ F_i |dq_i/dθ| against the weight; which joint holds it is left open."""
    model, held, (q, _) = four_bar(), pin_of(four_bar()), four_bar_state()
    along = four_bar_state(rate=1.0)[1]
    weight = abs(sd.generalized_gravity(model, q) @ along)
    level = np.array([3.0, 1.0, 2.0])
    friction = sd.Friction(level * share * weight / (level @ abs(along)), 0.0)
    run = sd.rollout(sd.Scene(model, constraints=held, friction=friction), q, np.zeros(3), dt=DT, steps=50)
    assert (run.v == 0.0).all() == sticks
    if sticks:
        assert abs(run.q - q).max() <= 1e-13
    else:
        assert run.v[-1, 0] < -1e-3


def test_a_loop_that_moves_feels_the_friction_of_each_joint() -> None:
    """As torques -F sgn v - b v in the dynamics under constraints, to the order of the step."""
    model, held, (q, v) = four_bar(), pin_of(four_bar()), four_bar_state()
    friction = sd.Friction(np.array([0.3, 0.2, 0.1]), np.array([0.05, 0.0, 0.02]))
    tau = sd.friction_torque(model, v, friction)
    wanted = sd.constrained_dynamics(model, held, q, v, tau).a
    run = sd.rollout(sd.Scene(model, constraints=held, friction=friction), q, v, dt=1e-6, steps=1)
    np.testing.assert_allclose((run.v[0] - v) / 1e-6, wanted, rtol=1e-4)
    slow = sd.rollout(sd.Scene(model, constraints=held, friction=friction, stabilization=0.01), q, v, dt=1e-6, steps=1)
    np.testing.assert_allclose((slow.v[0] - v) / 1e-6, wanted, rtol=1e-4)


def test_a_motor_without_losses_brakes_a_loop_as_damping_does() -> None:
    model, held, (q, v) = four_bar(), pin_of(four_bar()), four_bar_state()
    m = sd.Motor(torque_constant=[0.1] * 3, resistance=1.0, voltage=50.0, ratio=3.0)
    kept: dict[str, Any] = dict(dt=DT, steps=100, constraints=held)
    found = scenes.rollout(model, q, v, **kept, motor=m, drive="voltage")
    wanted = scenes.rollout(model, q, v, **kept, friction=sd.Friction(np.zeros(3), m.damping))
    np.testing.assert_allclose(found.v, wanted.v, rtol=0.0, atol=1e-12)
    assert abs(found.v[-1] - scenes.rollout(model, q, v, **kept).v[-1]).max() > 0.1


def test_gears_hold_a_loop_under_its_weight_if_they_lose_enough() -> None:
    """A current that lifts 1.2 times the weight of the loop through a gear that passes half of it: it neither rises
    nor sinks; through one without losses it rises.
    """
    model, held, (q, _) = four_bar(), pin_of(four_bar()), four_bar_state()
    along = four_bar_state(rate=1.0)[1]
    lift = np.array([1.2 * sd.generalized_gravity(model, q) @ along, 0.0, 0.0])
    ends = []
    for efficiency in (0.5, 1.0):
        m = sd.Motor(torque_constant=[0.1] * 3, resistance=1.0, voltage=500.0, ratio=10.0, efficiency=efficiency)
        ends.append(sd.rollout(sd.Scene(model, constraints=held, motor=m), q, np.zeros(3), lift, dt=DT, steps=40).v[-1])
    assert ends[0][0] == 0.0
    assert abs(ends[0]).max() <= 1e-15  # joints without a load do not rub
    assert ends[1][0] > 1e-3


# --- a far ground changes nothing -----------------------------------------------------------------------


@compiled
@pytest.mark.parametrize("what", ["implicit", "lugre", "motor", "springs"])
def test_ground_that_is_out_of_reach_changes_nothing(what: str) -> None:
    """The joint step of all against the steps of each alone."""
    made = sd.ModelBuilder("arm")
    made.add_body("upper", None, "revolute", (0, 1, 0), inertia=(1.0, (0, 0, -0.3), 0.05 * np.eye(3)))
    made.add_body("lower", "upper", "revolute", (0, 1, 0), (0, 0, -0.6), (0.5, (0.1, 0, -0.2), 0.02 * np.eye(3)))
    if what == "springs":
        made.add_series_elastic("lower_joint", 50.0, 0.1, 1e-3, 5.0)
    model = made.build()
    n = model.nv
    kept: dict[str, Any] = {
        "implicit": {"friction": sd.Friction(0.8 * np.ones(n), 0.1, 1.0 * np.ones(n), 0.1)},
        "lugre": {
            "friction": sd.Friction(0.3 * np.ones(n), 0.1, bristle_stiffness=1e3, bristle_damping=3.0),
            "friction_method": "lugre",
        },
        "motor": {"motor": sd.Motor([0.1] * n, 1.0, 24.0, ratio=20.0, efficiency=0.7)},
        "springs": {"friction": sd.Friction(0.2 * np.ones(n), 0.0)},
    }[what]
    low = sd.Contacts(model, {"lower": 0.0}, terrain=sd.Plane(height=-9.0), tolerance=1e-12)
    q, v, tau = 0.5 * np.ones(n), np.linspace(0.4, -0.4, n), np.linspace(0.5, 0.1, n)
    near, free = (scenes.rollout(model, q, v, tau, dt=DT, steps=300, contacts=x, **kept) for x in (low, None))
    np.testing.assert_allclose(near.v, free.v, rtol=0.0, atol=1e-8)
    assert ((near.v == 0.0) == (free.v == 0.0)).mean() > 0.99
    if what == "implicit":
        assert 0.0 < (free.v == 0.0).mean() < 1.0


# --- legs ------------------------------------------------------------------------------------------------


@compiled
def test_a_walker_sags_until_its_dry_joints_hold_it() -> None:
    """Weak springs of a control law let it sink; then friction takes the rest of the weight, and nothing creeps."""
    model, contacts, q0 = walker()
    kp, kd = np.r_[np.zeros(3), np.full(4, 25.0)], np.r_[np.zeros(3), np.full(4, 0.3)]
    kept: dict[str, Any] = dict(dt=DT, steps=1500, control=sd.PD(kp, kd, q0), contacts=contacts, record="contacts")
    run = scenes.rollout(model, q0, np.zeros(7), friction=legs(model, 2.0), **kept)
    assert run.q[-1, 1] < q0[1] - 0.005
    assert (run.v[-500:, 3:] == 0.0).all()
    assert abs(run.q[-1] - run.q[-500]).max() <= 1e-7
    assert run.contacts.residual[-500:].max() <= 1e-5
    assert run.contacts.impulse[-1, :, 2].sum() / DT == pytest.approx(sd.total_mass(model) * G, rel=1e-4)
    free = scenes.rollout(model, q0, np.zeros(7), **kept)
    assert free.q[-1, 1] < run.q[-1, 1] - 0.01


@pytest.mark.slow(quick="simulation/test_contact_runs.py::test_limits_act_beside_feet")
@compiled
def test_float32_stands_as_float64_does() -> None:
    model, contacts, q0 = walker()
    law = sd.PD(np.r_[np.zeros(3), np.full(4, 25.0)], np.r_[np.zeros(3), np.full(4, 0.3)], q0)
    kept: dict[str, Any] = dict(dt=DT, steps=600, control=law, contacts=contacts, friction=legs(model, 2.0))
    wanted, found = (scenes.rollout(model, q0, np.zeros(7), **kept, dtype=x) for x in (np.float64, np.float32))
    assert found.v.dtype == np.float32
    assert (found.v[-1, 3:] == 0.0).all()
    assert abs(found.q[-1] - wanted.q[-1]).max() <= 1e-5


@pytest.mark.parametrize("seed", range(4))
def test_a_step_meets_every_law_by_dense_matrices(seed: int) -> None:
    """M (v⁺ - v) is h (τ - bias - b v⁺), what the ground gives and friction does; that by Coulomb's law."""
    model, contacts, q = walker()
    rng = np.random.default_rng(seed)
    friction = legs(model, 2.0)
    table = contacts.with_dry(friction.coulomb > 0.0)
    v, tau = rng.normal(size=7) * (seed > 0), np.r_[np.zeros(3), 3.0 * rng.normal(size=4)]
    given = {"q": q, "v": v, "tau": tau, "dt": DT, "mu": contacts.friction, "restitution": contacts.restitution}
    made = solved(model, {"friction"}, table, given | coefficients(friction))
    assert made["residual"].max() <= 1e-6
    M, bias = sd.crba(model, q), sd.nonlinear_effects(model, q, v)
    J = [sd.frame_jacobian(model, q, x, "local_world_aligned") for x in contacts.names]
    pushed = sum(
        (j[:3] + np.cross(j[3:], [0, 0, -0.02], axis=0)).T @ f
        for j, f in zip(J, made["impulse"].reshape(2, 3), strict=True)
    )
    after = made["v"]
    rubbed = M @ (after - v) - DT * (tau - bias - friction.viscous * after) - pushed
    np.testing.assert_allclose(rubbed, DT * made["friction"], rtol=0.0, atol=1e-7)
    assert (abs(made["friction"]) <= 2.0 + 1e-12).all()
    moving = after[3:] != 0.0
    np.testing.assert_allclose(made["friction"][3:][moving], -2.0 * np.sign(after[3:][moving]), rtol=1e-12)
    assert moving.any() or seed == 0


def test_a_robot_held_more_often_than_it_can_move_rests() -> None:
    """On two feet that stick and legs that are stiff: eight equations of seven freedoms, and no sweep is lost to it."""
    model, contacts, q = walker()
    friction, contacts = legs(model, 50.0), sd.Contacts(model, dict.fromkeys(contacts.names, 0.02), tolerance=1e-9)
    table = contacts.with_dry(friction.coulomb > 0.0)
    given = {"q": q, "v": np.zeros(7), "tau": np.zeros(7), "dt": DT, "mu": contacts.friction}
    given |= {"restitution": contacts.restitution, **coefficients(friction)}
    made = solved(model, {"friction"}, table, given)
    assert abs(made["v"]).max() <= 1e-9
    assert made["residual"].max() <= 1e-9
    assert made["impulse"].reshape(2, 3)[:, 2].sum() == pytest.approx(DT * sd.total_mass(model) * G, rel=1e-6)


def test_dry_joints_stop_at_their_limits_too() -> None:
    """A joint pushed against its limit: friction takes its level, the limit the rest."""
    made = sd.ModelBuilder("stop")
    made.add_body("slide", None, "prismatic", (1, 0, 0), inertia=(1.0, (0, 0, 0), np.eye(3)), limits=(-1.0, 0.1))
    model = made.build()
    friction = sd.Friction([2.0], 0.0)
    kept: dict[str, Any] = dict(dt=DT, steps=400, limits=True, friction=friction, record="contacts")
    run = scenes.rollout(model, [0.0], [0.0], [5.0], **kept)
    np.testing.assert_allclose(np.diff(run.v[:100, 0]) / DT, 3.0, rtol=1e-9)
    assert run.q[-1, 0] == pytest.approx(0.1, abs=1e-12)
    assert run.contacts.stop[-1, 0] / DT == pytest.approx(-3.0, rel=1e-9)
    stays = scenes.rollout(model, [0.0], [0.0], [1.9], **kept)
    assert (stays.v == 0.0).all()


@compiled
def test_friction_and_ground_take_energy_and_give_none() -> None:
    model, contacts, q0 = walker()
    high = q0 + 0.05 * np.eye(7)[1]
    given: dict[str, Any] = dict(contacts=contacts, friction=legs(model, 1.0), record=(1, "work"))
    run = scenes.simulate(model, high, np.zeros(7), 0.15, 5e-4, STEPPED, **given)
    ledger = sd.energy_ledger(run)
    assert (np.diff(ledger.work["contacts"], axis=0) <= 1e-5).all()  # what a point rises by, out of the ground
    assert (np.diff(ledger.work["friction"].sum(axis=1)) <= 1e-6).all()
    assert ledger.work["contacts"][-1].sum() < -0.2
    assert ledger.work["friction"][-1].sum() < -0.01
    assert abs(ledger.error).max() <= 0.05 * abs(ledger.change).max()


@compiled
@pytest.mark.slow(quick="test_a_walker_sags_until_its_dry_joints_hold_it")
def test_a_quadruped_with_dry_joints_stands_and_trots() -> None:
    model, feet = quadruped()
    contacts = sd.Contacts(model, feet)
    q0 = stance(model, contacts)
    legs_only = np.r_[np.zeros(6), np.ones(12)]
    friction = sd.Friction(2.0 * legs_only, 0.05 * legs_only)
    law = sd.PD(40.0 * legs_only, 0.5 * legs_only, q0)
    kept: dict[str, Any] = dict(dt=2e-3, contacts=contacts, friction=friction, record="contacts")
    stood = scenes.rollout(model, q0, np.zeros(18), steps=1000, control=law, **kept)
    assert (stood.v[-500:, 6:] == 0.0).all()
    assert stood.contacts.residual[-500:].max() <= 1e-5
    assert stood.contacts.impulse[-1, :, 2].sum() / 2e-3 == pytest.approx(sd.total_mass(model) * G, rel=1e-4)
    walk = hold(model, q0, trot(model, q0, 800, 2e-3))
    run = scenes.rollout(model, q0, np.zeros(18), control=walk, **kept)
    assert np.percentile(run.contacts.residual, 99.8) <= 1e-6
    assert run.q[:, 2].min() > 0.3


# --- constraints beside contacts -------------------------------------------------------------------------


def ground_of(model: sd.Model, q: Array, drop: float, friction: float = 0.4) -> sd.Contacts:
    """A level ground, y upward, that a footed four-bar meets after a drop of its foot."""
    at = sd.frame_placement(model, q, "foot")[1, 3]
    return sd.Contacts(model, {"foot": 0.01}, friction, terrain=sd.Plane((0, 1, 0), at - 0.01 - drop))


@compiled
def test_a_four_bar_with_a_foot_keeps_its_loop_and_the_ground() -> None:
    model, held, q0 = footed()
    contacts = ground_of(model, q0, 0.05)
    kept: dict[str, Any] = dict(constraints=held, contacts=contacts, record="contacts")
    run = scenes.rollout(model, q0, np.zeros(3), dt=DT, steps=600, **kept)
    assert abs(sd.constraint_error(model, held, run.q)).max() <= 1e-9
    gap = run.contacts.gap[:, 0]
    assert gap.min() >= -5e-5
    assert run.contacts.residual.max() <= 1e-6
    assert abs(gap[-1]) <= 1e-5
    assert abs(run.v[-1]).max() <= 1e-6
    falling = scenes.rollout(model, q0, np.zeros(3), dt=DT, steps=90, **kept)
    on = scenes.rollout(model, **falling.end, dt=DT, steps=5, **kept)
    np.testing.assert_array_equal(on.v, run.v[90:95])
    along = sd.frame_jacobian(model, run.q[-1], "foot", "local_world_aligned")[:3]
    J = np.vstack([sd.constraint_jacobian(model, held, run.q[-1])[:2], along[:2]])
    weight = sd.generalized_gravity(model, run.q[-1])
    x = np.linalg.lstsq(J.T, weight, rcond=None)[0]  # statics: the loop and the foot carry the weight
    assert abs(J.T @ x - weight).max() <= 1e-9
    tangent = along[:, :] @ sd.project_velocity(model, held, run.q[-1], np.ones(3))
    assert abs(tangent[1]) > 1e-3  # the ground stops a motion that the loop allows


def left_moving(held: sd.Constraints, run: Any) -> Array:
    """|J v| of every sample, the largest of its equations."""
    J = sd.constraint_jacobian(held.model, held, run.q)
    return abs((J @ run.v[..., None])[..., 0]).max(axis=-1)


@compiled
def test_steps_with_impulses_leave_no_velocity_of_the_constraints_behind() -> None:
    """5e-6 m/s at 20 rad/s on dry joints, at first as after 3000 steps, of order dt³; 7e-4 if v met the old J alone."""
    model, held, q0 = footed()
    v0, kept = four_bar_state(rate=4.0)[1], dict(constraints=held, friction=sd.Friction(0.02 * np.ones(3), 0.0))
    runs = [scenes.rollout(model, q0, v0, dt=dt, steps=round(3.0 / dt), **kept) for dt in (2e-3, 1e-3)]
    coarse, fine = (left_moving(held, x) for x in runs)
    assert abs(runs[1].v).max() > 15.0
    assert fine.max() <= 1e-5
    assert fine[1500:].max() <= fine[:1500].max()
    assert 7.0 <= coarse.max() / fine.max() <= 9.0


@compiled
def test_a_run_goes_on_from_the_step_of_an_impact() -> None:
    """There J v is of order dt², 3e-4 m/s of a foot that bounces at 1 m/s; 2e-2 if v met the old J alone."""
    model, held, q0 = footed()
    contacts = ground_of(model, q0, 0.05)
    bouncing = sd.Contacts(model, {"foot": 0.01}, restitution=0.5, terrain=contacts.terrain)
    kept: dict[str, Any] = dict(constraints=held, contacts=bouncing, record="contacts")
    run = scenes.rollout(model, q0, np.zeros(3), dt=DT, steps=400, **kept)
    assert left_moving(held, run).max() <= 5e-4
    hit = int(np.flatnonzero(run.contacts.impulse[:, 0, 1])[0])
    assert abs(run.v[hit] - run.v[hit - 1]).max() > 1.0
    on = scenes.rollout(model, run.q[hit], run.v[hit], dt=DT, steps=5, **kept)
    np.testing.assert_array_equal(on.v, run.v[hit + 1 : hit + 6])
    with pytest.raises(sd.ConstraintError, match=r"v0 of sample 0 moves pin y at -0\.0\d+, expected 0"):
        scenes.rollout(model, run.q[hit], run.v[hit] + [0.0, 0.0, 0.1], dt=DT, steps=5, **kept)


@pytest.mark.slow(quick="test_a_step_meets_every_law_by_dense_matrices")
@compiled
def test_programs_kernels_and_the_recursion_take_the_same_steps() -> None:
    """A footed four-bar with dry joints, on lanes, by one program, by kernels, with the work of each."""
    model, held, q0 = footed()
    contacts = ground_of(model, q0, 0.01)
    friction = sd.Friction(np.array([0.1, 0.05, 0.1]), 0.01)
    kept: dict[str, Any] = dict(constraints=held, contacts=contacts, friction=friction)
    lanes = scenes.rollout(model, np.tile(q0, (3, 1)), np.zeros(3), dt=DT, steps=120, **kept, record="contacts")
    args = (model, q0, np.zeros(3), 120 * DT, DT, STEPPED)
    still = lambda t, q, v: np.zeros(3)  # noqa: E731
    for torque in (None, still):
        one = scenes.simulate(*args, torque=torque, **kept, record=(1, "work", "contacts"))
        np.testing.assert_allclose(one.v[1:], lanes.v[1], rtol=0.0, atol=1e-9)
        assert one.contacts is not None
        np.testing.assert_allclose(one.contacts.impulse[1:], lanes.contacts.impulse[1], rtol=0.0, atol=1e-9)
        ledger = sd.energy_ledger(one)
        assert (np.diff(ledger.work["contacts"], axis=0) <= 1e-9).all()
        assert ledger.work["friction"][-1].sum() < 0.0
        assert abs(ledger.error).max() <= 0.05 * abs(ledger.change).max()
    table = contacts.with_dry(friction.coulomb > 0.0)
    q, v = lanes.q[0, 99], lanes.v[0, 99]
    given = {"q": q, "v": v, "tau": np.zeros(3), "dt": DT, "mu": contacts.friction, "restitution": np.zeros(1)}
    made = solved(model, {"friction", "constraints"}, table, given | coefficients(friction), held)
    np.testing.assert_allclose(made["v"], lanes.v[0, 100], rtol=0.0, atol=1e-11)
    again = scenes.simulate(**one.end, model=model, duration=0.01, dt=DT, method=STEPPED, **kept, record="work")
    assert np.isfinite(again.v).all()


def test_stabilization_keeps_a_loop_with_a_foot_closed() -> None:
    model, held, q0 = footed()
    contacts = ground_of(model, q0, 0.02)
    run = sd.rollout(
        sd.Scene(model, constraints=held, contacts=contacts, stabilization=0.01), q0, np.zeros(3), dt=DT, steps=400
    )
    assert abs(sd.constraint_error(model, held, run.q)).max() <= 1e-4
    assert sd.contact_gaps(model, contacts, run.q).min() >= -1e-4


def test_limits_stop_a_loop() -> None:
    made = sd.ModelBuilder("limited")
    made.add_body("crank", None, "revolute", (0, 0, 1), (0, 0, 0), rod(0.2), limits=(0.8, 3.0))
    made.add_body("coupler", "crank", "revolute", (0, 0, 1), (0.2, 0, 0), rod(0.5))
    made.add_body("rocker", None, "revolute", (0, 0, 1), (0.5, 0, 0), rod(0.4))
    model = made.build(gravity=(0, -G, 0))
    held, q0 = pin_of(model), four_bar_state()[0]
    run = sd.rollout(
        sd.Scene(model, constraints=held, limits=True), q0, np.zeros(3), dt=DT, steps=400, record="contacts"
    )
    assert run.q[:, 0].min() >= 0.8 - 1e-5
    assert run.q[-1, 0] == pytest.approx(0.8, abs=1e-5)
    assert abs(sd.constraint_error(model, held, run.q)).max() <= 1e-9
    along = four_bar_state(0.8, 1.0)[1]
    load = sd.generalized_gravity(model, run.q[-1]) @ along
    assert run.contacts.stop[-1, 0] / DT == pytest.approx(load, rel=1e-3)


def test_a_loop_that_its_constraints_lock_stays() -> None:
    """Nothing moves a joint there, and its row has no inertia of its own: no impulse is made of rounding."""
    model, (q, _) = four_bar(), four_bar_state()
    tied = sd.Constraints(model, [*pin_of(model), sd.VelocityConstraint([1.0, 0, 0], name="brake")])
    friction = sd.Friction(0.1 * np.ones(3), 0.0)
    run = sd.rollout(sd.Scene(model, constraints=tied, friction=friction), q, np.zeros(3), dt=DT, steps=3)
    assert abs(run.v).max() <= 1e-15


WRONG = r"step from t = 0 s: far rod contradicts the other constraints: 1 of 2 equations are independent"
PARTED = r"step from t = 0.006 s: the rank of near rod, far rod is 2, at the beginning it was 1: a branch point"


def tied() -> tuple[sd.Model, dict[str, Any], Array, Array]:
    """A mass on two rods in one line, of 1 and 2 m, with ground and limits: they agree at rest only, and on no way.

    Also samples of v, one of which moves, and of torques, one of which pushes in step 5.
    """
    made = sd.ModelBuilder("tied").add_body("x", None, "prismatic", (1, 0, 0))
    made.add_body("z", "x", "prismatic", (0, 0, 1), inertia=(1.0, (0, 0, 0), 0.01 * np.eye(3)), limits=(-1.0, 2.0))
    model, names = made.build(), {1.0: "near rod", 2.0: "far rod"}
    rods = [sd.DistanceConstraint("z", None, r, at_b=(-r, 0, 0), name=name) for r, name in names.items()]
    kept = dict(constraints=sd.Constraints(model, rods), contacts=sd.Contacts(model, {"z": 0.0}), limits=True)
    v, tau = np.zeros((3, 2)), np.zeros((3, 8, 2))
    v[1, 1], tau[1, 5, 1] = 1.0, 2000.0
    return model, kept, v, tau


@compiled
def test_contradictions_beside_contacts_and_limits_are_named_with_time_sample_and_constraint() -> None:
    """From rest the circles part as soon as the mass moves: another rank, in the step after it was pushed."""
    model, kept, v, tau = tied()
    q = np.zeros((3, 2))
    assert not scenes.rollout(model, q, 0.0 * v, dt=1e-3, steps=8, **kept).v.any()
    with pytest.raises(sd.SimulationError, match="sample 1: " + PARTED):
        scenes.rollout(model, q, 0.0 * v, tau, dt=1e-3, **kept)
    for friction in (None, sd.Friction(np.array([0.0, 0.1]), 0.0)):
        with pytest.raises(sd.SimulationError, match="sample 1: " + WRONG):
            scenes.rollout(model, q, v, dt=1e-3, steps=8, friction=friction, **kept)


@pytest.mark.slow(quick="test_contradictions_beside_contacts_and_limits_are_named_with_time_sample_and_constraint")
@compiled
def test_a_simulation_names_contradictions_beside_contacts_with_their_time() -> None:
    """The table kernel takes the step that a program has no answer to."""
    model, kept, v, tau = tied()
    kept["friction"], q = sd.Friction(np.array([0.0, 0.1]), 0.0), np.zeros(2)
    with pytest.raises(sd.SimulationError, match="^" + WRONG):
        scenes.simulate(model, q, v[1], 8e-3, 1e-3, STEPPED, **kept)
    with pytest.raises(sd.SimulationError, match="^" + PARTED) as caught:
        scenes.simulate(model, q, 0.0 * v[1], 8e-3, 1e-3, STEPPED, torque=tau[1], **kept)
    assert caught.value.trajectory.t[-1] == pytest.approx(0.006)


@pytest.mark.slow(quick="test_contradictions_beside_contacts_and_limits_are_named_with_time_sample_and_constraint")
@compiled
def test_a_branch_point_beside_dry_joints_is_named_with_its_time() -> None:
    model = four_bar(1.0, 1.0, 1.0, 1.0)
    held = pin_of(model, 1.0, 1.0)
    kept: dict[str, Any] = dict(constraints=held, friction=sd.Friction(0.01 * np.ones(3), 0.0))
    flat, rate = np.zeros(3), np.array([1.0, -1.0, 1.0])
    text = r"step from t = 0\S* s: the rank of pin is 2, at the beginning it was 1: a branch point"
    with pytest.raises(sd.SimulationError, match=r"sample 0: " + text):
        scenes.rollout(model, np.tile(flat, (2, 1)), rate, dt=1e-2, steps=5, **kept)
    with pytest.raises(sd.SimulationError, match=text):
        scenes.simulate(model, flat, rate, 0.1, 1e-2, STEPPED, **kept)


def test_springs_carry_a_leg_on_the_ground() -> None:
    """A mass on a series-elastic slide with its foot on the ground: once at rest the spring bears it."""
    made = sd.ModelBuilder("leg")
    made.add_body("foot", None, "prismatic", (0, 0, 1), inertia=(0.2, (0, 0, 0), 0.1 * np.eye(3)))
    made.add_body("body", "foot", "prismatic", (0, 0, 1), (0, 0, 0.5), (3.0, (0, 0, 0), 0.1 * np.eye(3)))
    model = made.add_series_elastic("body_joint", 2000.0, 60.0, 0.01, 2.0).build()
    contacts = sd.Contacts(model, {"foot": 0.0})
    rotor = next(k for k, j in enumerate(model.joints[1:]) if j.name not in ("foot_joint", "body_joint"))
    locked = np.zeros(3)
    locked[rotor] = 50.0  # its own dry friction holds the rotor
    friction = sd.Friction(locked, 0.0)
    run = sd.rollout(
        sd.Scene(model, contacts=contacts, friction=friction), np.zeros(3), np.zeros(3), dt=5e-4, steps=4000
    )
    pull = sd.spring_torque(model, run.q[-1])
    body = next(j.idx_v for j in model.joints[1:] if j.name == "body_joint")
    assert pull[body] == pytest.approx(3.0 * G, rel=1e-3)
    assert abs(run.q[-1, 0]) <= 1e-9
    assert (run.v[:, rotor] == 0.0).all()


# --- refusals --------------------------------------------------------------------------------------------


def test_more_impulses_than_lanes_take_run_one_by_one() -> None:
    made, parent = sd.ModelBuilder("chain"), None
    for k in range(37):
        made.add_body(f"b{k}", parent, "revolute", (0, 1, 0), (0.1, 0, 0), (1.0, (0, 0, 0), np.eye(3)))
        parent = f"b{k}"
    model = made.build()
    contacts = sd.Contacts(model, {"b0": 0.0}, terrain=sd.Plane(height=-9.0))
    scene = sd.Scene(model, contacts=contacts, friction=sd.Friction(np.ones(37), 0.0))
    runs = sd.rollout(scene, np.zeros(37), np.zeros((2, 37)), dt=DT, steps=1)
    alone = sd.simulate(scene, np.zeros(37), np.zeros(37), DT, DT)
    np.testing.assert_array_equal(runs.q[1], alone.q[1:])


def test_nan_of_a_sample_is_not_taken_for_rest() -> None:
    model, held, (q, _) = four_bar(), pin_of(four_bar()), four_bar_state()
    tau = np.zeros((2, 2, 3))
    tau[1, 0, 1] = math.nan
    friction = sd.Friction(5.0 * np.ones(3), 0.0)
    run = sd.rollout(sd.Scene(model, constraints=held, friction=friction), q, np.zeros(3), tau, dt=DT, check=False)
    assert (run.v[0] == 0.0).all()
    assert not np.isfinite(run.v[1]).any()
