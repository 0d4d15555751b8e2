"""One step in contact: inclines and bounces by hand, Coulomb's law by dense matrices, refusals."""

from __future__ import annotations

import copy
import math
import pickle
from typing import Any

import numpy as np
import pytest
import scenes
from dense import Array
from grounded import DT, RISING, G, box, in_first_axes, jacobian, mass, off_the_law, quadruped, stance
from trees import random_state, random_tree

import spatialdyn as sd
from spatialdyn.algebra.heights import bilinear, by_weights
from spatialdyn.engines import by_table_kernel, run
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Tape, table
from spatialdyn.recursions.contact.contact import CONTACT_GAPS, CONTACT_STEP, CONTACT_STEP_OVER

EPS = float(np.finfo(float).eps)
SAME = 1e3 * EPS  # of a step of order 1: its sums in another order


def at_rest(model: sd.Model, contacts: sd.Contacts, q: Any = None, v: Any = None, tau: Any = None) -> Any:
    """A step of DT from rest at the origin, or from what is given."""
    zero = np.zeros(model.nv)
    return sd.contact_step(
        model, contacts, sd.neutral(model) if q is None else q, zero if v is None else v,
        zero if tau is None else tau, DT,
    )  # fmt: skip


# --- by hand --------------------------------------------------------------------------------------------


def test_a_mass_slides_down_an_incline_at_g_times_sin_less_mu_cos() -> None:
    model = mass(math.pi / 6)
    step = at_rest(model, sd.Contacts(model, {"z": 0.0}, friction=0.2))
    assert step.v[0] / DT == pytest.approx(3.205858157774931, rel=4 * EPS)
    assert step.v[1] == step.v[2] == 0.0
    assert step.impulse[0] / DT == pytest.approx([-0.2 * G * math.cos(math.pi / 6), 0.0, G * math.cos(math.pi / 6)])
    assert step.residual <= EPS


@pytest.mark.parametrize("kg", [1.0, 4.0])
def test_a_mass_within_the_cone_stays_to_the_bit(kg: float) -> None:
    model = mass(0.3, kg)
    step = at_rest(model, sd.Contacts(model, {"z": 0.0}, friction=0.5))
    assert (step.v == 0.0).all()
    assert (step.q == 0.0).all()


def test_a_tilted_plane_is_a_tilted_field_of_gravity() -> None:
    for angle, mu in ((math.pi / 6, 0.2), (0.3, 0.5)):
        level, model = mass(angle), mass()
        plane = sd.Plane(normal=(math.sin(angle), 0.0, math.cos(angle)), height=0.0)
        wanted = at_rest(level, sd.Contacts(level, {"z": 0.0}, mu))
        found = at_rest(model, sd.Contacts(model, {"z": 0.0}, mu, terrain=plane))
        turn = np.array([[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]])
        np.testing.assert_allclose(found.v, turn @ wanted.v, rtol=0.0, atol=1e-17)
        np.testing.assert_allclose(found.impulse[0], turn @ wanted.impulse[0], rtol=0.0, atol=1e-17)


@pytest.mark.parametrize(("height", "speed"), [(1e-3, 0.0), (0.5, -3.0)])
def test_a_point_that_does_not_reach_the_ground_feels_none(height: float, speed: float) -> None:
    model = mass()
    q, v = np.array([0.0, 0.0, height]), np.array([1.0, 0.0, speed])
    step = at_rest(model, sd.Contacts(model, {"z": 0.0}), q, v)
    assert (step.impulse == 0.0).all()
    np.testing.assert_array_equal(step.v, [1.0, 0.0, speed - G * DT])
    assert step.gap == pytest.approx([height])


def test_a_fast_point_stops_on_the_ground_and_not_in_it() -> None:
    model = mass()
    step = at_rest(model, sd.Contacts(model, {"z": 0.02}), np.array([0.0, 0.0, 0.05]), np.array([0.0, 0.0, -100.0]))
    assert step.q[2] == pytest.approx(0.02, abs=1e-16)


def test_a_point_in_the_ground_rises_by_a_fifth_of_its_depth_but_no_faster_than_in_a_hundredth_of_a_second() -> None:
    model = mass()
    contacts = sd.Contacts(model, {"z": 0.0})
    for dt, left in ((5e-3, 0.8e-3), (2e-3, 0.8e-3), (DT, 0.9e-3), (1e-4, 0.99e-3)):
        step = sd.contact_step(model, contacts, [0.0, 0.0, -1e-3], np.zeros(3), np.zeros(3), dt)
        assert step.q[2] == pytest.approx(-left)


@pytest.mark.parametrize(("e", "speed"), [(0.5, -2.0), (1.0, -2.0), (0.0, -2.0), (0.5, -0.005)])
def test_a_point_leaves_at_its_share_of_the_speed_of_approach(e: float, speed: float) -> None:
    """Slower than 0.01 m/s it comes to rest."""
    model = mass()
    step = at_rest(model, sd.Contacts(model, {"z": 0.0}, restitution=e), None, np.array([0.0, 0.0, speed]))
    assert step.v[2] == pytest.approx(-e * speed * (speed < -0.01), abs=1e-15)


def test_a_ball_that_is_thrown_rolls_from_sliding() -> None:
    """Friction μ m g slows the ball and turns it, until ω r = v: 5/7 of the speed for a solid sphere."""
    r = 0.1
    made = sd.ModelBuilder("ball")
    made.add_body("ball", None, "floating", inertia=(2.0, (0, 0, 0), np.eye(3) * 0.4 * 2.0 * r * r))
    model = made.build()
    contacts = sd.Contacts(model, {"ball": r}, friction=0.3)
    q, v = np.array([0, 0, r, 0, 0, 0, 1.0]), np.array([1.0, 0, 0, 0, 0, 0])
    sliding = sd.contact_step(model, contacts, q, v, np.zeros(6), DT)
    change = in_first_axes(model, sliding.v, v, DT)[0] - v
    np.testing.assert_allclose(change[[0, 4]] / DT, [-0.3 * G, 0.3 * G / (0.4 * r)], rtol=1e-12)
    run = sd.rollout(sd.Scene(model, contacts=contacts), q, v, dt=0.1 * DT, steps=4000)
    R = sd.frame_placement(model, run.q[-1], "ball")[:3, :3]
    v, w = R @ run.v[-1, :3], R @ run.v[-1, 3:]
    np.testing.assert_allclose(v, [5 / 7, 0, 0], atol=1e-3)  # of first order in the step
    assert w[1] == pytest.approx(v[0] / r, rel=1e-3)


def test_a_box_on_its_corners_rests_to_the_tolerance() -> None:
    """Twelve rows on six freedoms: their matrix is singular, and all four corners share the weight."""
    model, corners = box(0.3)
    creep = []
    for tolerance in (1e-4, 1e-6, 1e-10):
        contacts = sd.Contacts(model, dict.fromkeys(corners, 0.0), friction=0.5, tolerance=tolerance)
        q = sd.neutral(model)
        q[2] -= sd.contact_gaps(model, contacts, q).min()
        step = at_rest(model, contacts, q)
        creep.append(abs(step.v).max())
    assert creep[0] <= 1e-4
    assert creep[1] <= 1e-6
    assert creep[2] <= 1e-10
    assert step.impulse.sum(axis=0) == pytest.approx([-G * math.sin(0.3) * DT, 0, G * math.cos(0.3) * DT], abs=1e-10)


def test_a_box_slides_down_as_a_mass_does() -> None:
    model, corners = box(0.3)
    contacts = sd.Contacts(model, dict.fromkeys(corners, 0.0), friction=0.2, tolerance=1e-12)
    q = sd.neutral(model)
    q[2] -= sd.contact_gaps(model, contacts, q).min()
    wanted = G * (math.sin(0.3) - 0.2 * math.cos(0.3))
    assert at_rest(model, contacts, q).v[0] / DT == pytest.approx(wanted, rel=1e-9)


# --- the law --------------------------------------------------------------------------------------------


def states(model: sd.Model, contacts: sd.Contacts, n: int, seed: int) -> tuple[Array, Array, Array]:
    """q, v, tau of a quadruped near its stance, its feet in and above the ground."""
    rng, q0 = np.random.default_rng(seed), stance(model, contacts)
    q = sd.integrate(model, q0, 0.1 * rng.normal(size=(n, model.nv)))
    q[:, 2] -= sd.contact_gaps(model, contacts, q).min(axis=1) + rng.uniform(-1e-3, 2e-3, n)
    return q, 0.5 * rng.normal(size=(n, model.nv)), 5.0 * rng.normal(size=(n, model.nv))


@pytest.mark.parametrize("mu", [0.0, 0.3, 0.8])
def test_a_step_meets_coulombs_law_by_dense_matrices(mu: float) -> None:
    model, feet = quadruped()
    contacts = sd.Contacts(model, feet, friction=mu, tolerance=1e-12)
    q, v, tau = states(model, contacts, 60, 0)
    step = sd.contact_step(model, contacts, q, v, tau, DT)
    off = [off_the_law(contacts, q[k], v[k], tau[k], DT, sd.ContactStep(*(x[k] for x in step))) for k in range(len(q))]
    assert np.median(off) <= 1e-12
    assert np.max(off) <= 1e-9
    assert np.max(step.residual) <= 1e-9
    assert 0.1 < (step.impulse[..., 2] == 0.0).mean() < 0.9  # some leave, some touch


def test_the_ground_feels_exact_rotors() -> None:
    model, feet = quadruped()
    geared = model.with_(rotors={name: sd.Rotor(2e-4, 9.0) for name in ("lf_shank_joint", "lf_hip_joint")})
    contacts = sd.Contacts(geared, feet, friction=0.5, tolerance=1e-12)
    q, v, tau = stance(geared, contacts), np.zeros(18), np.linspace(-3.0, 3.0, 18)
    v[:4] = 0.3, 0.1, -0.4, 0.5
    step = sd.contact_step(geared, contacts, q, v, tau, DT)
    assert off_the_law(contacts, q, v, tau, DT, step) <= 1e-9
    plain = sd.contact_step(model, sd.Contacts(model, feet, friction=0.5, tolerance=1e-12), q, v, tau, DT)
    assert abs(step.v - plain.v).max() > 1e-4


def test_a_slope_far_from_the_origin_is_met_too() -> None:
    model, feet = quadruped()
    rng = np.random.default_rng(3)
    plane = sd.Plane(normal=(0.2, -0.1, 1.0), height=40.0)
    contacts = sd.Contacts(model, feet, friction=0.6, terrain=plane, tolerance=1e-12)
    q, v, tau = states(model, sd.Contacts(model, feet), 20, 1)
    n = np.array(plane.normal)
    q[:, :2] += rng.uniform(-50.0, 50.0, (20, 2))
    q[:, :3] -= (sd.contact_gaps(model, contacts, q).min(axis=1) + 1e-3)[:, None] * n
    step = sd.contact_step(model, contacts, q, v, tau, DT)
    for k in range(len(q)):
        one = sd.ContactStep(*(x[k] for x in step))
        assert off_the_law(contacts, q[k], v[k], tau[k], DT, one) <= 1e-9


@pytest.mark.parametrize("seed", range(6))
def test_points_on_random_trees_meet_the_law(seed: int) -> None:
    """Joints of every kind; body origins that a program may move are where points are given."""
    made = random_tree(seed, 5, floating=bool(seed % 2))
    model, rng = made.model, np.random.default_rng(seed)
    links = sorted({f.joint: f.name for f in model.frames if f.joint and f.name.startswith("b")}.values())
    state = random_state(made.tree, rng)
    points = dict.fromkeys(links[-2:], 0.05)
    low = sd.contact_gaps(model, sd.Contacts(model, points), state.q).min()
    contacts = sd.Contacts(model, points, friction=0.5, terrain=sd.Plane(height=float(low) + 1e-4), tolerance=1e-12)
    step = sd.contact_step(model, contacts, state.q, state.v, state.tau, DT)
    assert off_the_law(contacts, state.q, state.v, state.tau, DT, step) <= 1e-8


def test_sliding_opposes_the_velocity_and_sticking_stays_in_the_cone() -> None:
    model, feet = quadruped()
    contacts = sd.Contacts(model, feet, friction=0.4, tolerance=1e-12)
    q, v, tau = states(model, contacts, 100, 5)
    step = sd.contact_step(model, contacts, q, v, tau, DT)
    slid = 0
    for k in range(len(q)):
        x, _ = in_first_axes(model, step.v[k], v[k], DT)
        u = np.einsum("kin,n->ki", jacobian(contacts, q[k]), x)[:, :2]
        f = step.impulse[k]
        moves = (np.linalg.norm(u, axis=1) > 1e-3) & (f[:, 2] > 1e-6)
        slid += int(moves.sum())
        along = u[moves] / np.linalg.norm(u[moves], axis=1, keepdims=True)
        np.testing.assert_allclose(f[moves, :2], -0.4 * f[moves, 2:] * along, rtol=0.0, atol=1e-6 * abs(f).max())
        assert (np.linalg.norm(f[:, :2], axis=1) <= 0.4 * f[:, 2] + 1e-12).all()
    assert slid > 30


def test_a_symmetric_stance_has_symmetric_impulses() -> None:
    model, feet = quadruped()
    contacts = sd.Contacts(model, feet, tolerance=1e-12)
    step = at_rest(model, contacts, stance(model, contacts))
    lf, lh, rf, rh = step.impulse
    for found, sign in ((lh, (-1, 1, 1)), (rf, (1, -1, 1)), (rh, (-1, -1, 1))):
        np.testing.assert_allclose(found, lf * np.array(sign), rtol=0.0, atol=1e-12)


def test_a_planar_robot_has_points_that_cannot_leave_their_plane() -> None:
    """Their block of G is singular, and dropped directions get no impulse."""
    made = sd.ModelBuilder("slider")
    made.add_body("x", None, "prismatic", (1, 0, 0)).add_body(
        "z", "x", "prismatic", (0, 0, 1), inertia=(1.0, (0, 0, 0), np.eye(3))
    )
    model = made.build(gravity=(G * math.sin(0.5), 0.0, -G * math.cos(0.5)))
    step = at_rest(model, sd.Contacts(model, {"z": 0.0}, friction=0.2))
    assert step.v / DT == pytest.approx([G * (math.sin(0.5) - 0.2 * math.cos(0.5)), 0.0])
    assert at_rest(model, sd.Contacts(model, {"z": 0.0}, friction=0.8)).v == pytest.approx([0.0, 0.0], abs=1e-18)
    arm = sd.load_urdf("pendulum")
    level = sd.Plane(height=float(sd.frame_placement(arm, [0.0], arm.frames[-1].name)[2, 3]))
    rests = sd.contact_step(arm, sd.Contacts(arm, {arm.frames[-1].name: 0.0}, terrain=level), [0.0], [0.5], [0.0], DT)
    assert np.isfinite(rests.impulse).all()


@pytest.mark.parametrize("mu", [0.5, 2.5])
def test_a_leaning_rod_slides_or_jams_by_the_law(mu: float) -> None:
    """Above μ = 4/3 a rod can be pushed into the ground by its own friction (Painlevé); as impulses there is a way."""
    made = sd.ModelBuilder("rod")
    made.add_body("x", None, "prismatic", (1, 0, 0)).add_body("z", "x", "prismatic", (0, 0, 1))
    made.add_body("rod", "z", "revolute", (0, 1, 0), inertia=(1.0, (0, 0, 0), np.diag([1, 1, 1e-3]) / 12))
    model = made.add_body("tip", "rod", "fixed", placement=(0, 0, -0.5)).build()
    contacts, at = sd.Contacts(model, {"tip": 0.0}, friction=mu), {j.name: j.idx_q for j in model.joints[1:]}
    for angle in np.linspace(-1.2, 1.2, 9):
        q, v = np.zeros(3), np.zeros(3)
        q[at["rod_joint"]], v[at["x_joint"]] = angle, 1.0
        q[at["z_joint"]] = -sd.contact_gaps(model, contacts, q)[0]
        step = sd.contact_step(model, contacts, q, v, np.zeros(3), DT)
        assert step.residual <= 1e-9
        assert abs(step.v).max() <= 2.0
        assert (step.impulse[0, 2] > 0.0) or abs(angle) > 0.1


# --- ground of heights ----------------------------------------------------------------------------------


def bilinear_by_hand(z: Array, x: float, y: float) -> tuple[float, float, float]:
    """Of heights at whole numbers, and level beyond."""
    nx, ny = z.shape
    i, j = int(np.clip(np.floor(x), 0, nx - 2)), int(np.clip(np.floor(y), 0, ny - 2))
    s, t = np.clip(x - i, 0, 1), np.clip(y - j, 0, 1)
    (a, b), (c, d) = z[i : i + 2, j : j + 2]
    level = (1 - s) * (1 - t) * a + (1 - s) * t * b + s * (1 - t) * c + s * t * d
    along = ((1 - t) * (c - a) + t * (d - b)) * (0 <= x < nx - 1)
    across = ((1 - s) * (b - a) + s * (d - c)) * (0 <= y < ny - 1)
    return float(level), float(along), float(across)


def test_heights_between_four_are_bilinear_in_every_engine() -> None:
    rng = np.random.default_rng(0)
    z = rng.normal(size=(5, 7))
    ground = sd.Heightfield(z, 1.0)
    x, y = rng.uniform(-1.5, 5.5, 200), rng.uniform(-1.5, 7.5, 200)
    x[:5], y[:5] = [0.5, 3.999, 4.001, 2.0, -0.001], [0.001, 5.999, 3.0, 6.001, 2.5]
    tape = Tape()
    made = by_weights(tape.input(0), tape.input(1), table(ground.table.rows), 1)
    recorded = np.array(Program(tape, made, 2).run([x, y])).T
    for k in range(200):
        wanted = bilinear_by_hand(z, x[k], y[k])
        assert bilinear(x[k], y[k], ground.table.rows, 1) == pytest.approx(wanted, abs=1e-13)
        assert recorded[k] == pytest.approx(wanted, abs=1e-13)
    assert np.isnan(bilinear(math.nan, 1.0, ground.table.rows, 1)).all()


def test_heights_on_a_plane_are_that_plane() -> None:
    model, feet = quadruped()
    x = 0.5 * np.arange(9) - 2.0
    heights = sd.Heightfield(0.2 * x[:, None] + 0.1 * x, 0.5, (-2.0, -2.0))
    over, on = (
        sd.Contacts(model, feet, terrain=ground, tolerance=1e-12) for ground in (heights, sd.Plane((-0.2, -0.1, 1.0)))
    )
    q, v, tau = states(model, sd.Contacts(model, feet), 8, 3)
    q[:, 2] -= sd.contact_gaps(model, on, q).min(axis=1)
    found, wanted = (sd.contact_step(model, x, q, v, tau, DT) for x in (over, on))
    for a, b in zip(found, wanted, strict=True):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-9)
    assert (wanted.impulse != 0.0).any()


def test_a_point_over_heights_feels_the_slope_below_it() -> None:
    """As on a plane of that normal; its impulse is in the cone about it."""
    model, rng = mass(), np.random.default_rng(4)
    z = 0.3 * rng.normal(size=(6, 5))
    ground = sd.Heightfield(z, 0.25, (-0.5, 0.25))
    for _ in range(20):
        at = rng.uniform(-0.4, 0.6), rng.uniform(0.3, 1.2)
        level, along, across = bilinear_by_hand(z, (at[0] + 0.5) / 0.25, (at[1] - 0.25) / 0.25)
        normal = np.array([-along / 0.25, -across / 0.25, 1.0])
        q, v = np.array([*at, level]), rng.normal(size=3)
        plane = sd.Plane(normal, float(normal @ q) / float(np.linalg.norm(normal)))
        found, wanted = (
            sd.contact_step(model, sd.Contacts(model, {"z": 0.0}, 0.4, terrain=x), q, v, np.zeros(3), DT)
            for x in (ground, plane)
        )
        np.testing.assert_allclose(found.v, wanted.v, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(found.impulse, wanted.impulse, rtol=0.0, atol=1e-12)


@pytest.mark.slow(quick="test_heights_on_a_plane_are_that_plane")
def test_more_heights_than_a_program_holds_are_read_all_the_same() -> None:
    model, feet = quadruped()
    x = 0.05 * np.arange(81) - 2.0
    heights = sd.Heightfield(0.2 * x[:, None] + 0.1 * x, 0.05, (-2.0, -2.0))
    assert not recording.fits(
        (CONTACT_STEP_OVER,), model.bodies, static=sd.Contacts(model, feet, terrain=heights).tables
    )
    over, on = (sd.Contacts(model, feet, terrain=ground) for ground in (heights, sd.Plane((-0.2, -0.1, 1.0))))
    q, v, tau = states(model, sd.Contacts(model, feet), 8, 3)
    q[:, 2] -= sd.contact_gaps(model, on, q).min(axis=1)
    found, wanted = (sd.contact_step(model, x, q, v, tau, DT) for x in (over, on))
    np.testing.assert_allclose(found.v, wanted.v, rtol=0.0, atol=1e-9)
    q[0, 2] += 1e-3  # gaps are measured along the normal
    kept: dict[str, Any] = dict(record="contacts")
    runs = [
        scenes.simulate(model, q[0], np.zeros(18), 5 * DT, DT, "semi_implicit_euler", contacts=c, **kept)
        for c in (over, on)
    ]
    np.testing.assert_allclose(runs[0].v, runs[1].v, rtol=0.0, atol=1e-9)


# --- joint limits ---------------------------------------------------------------------------------------


def test_a_joint_stops_at_its_limits() -> None:
    model = (
        sd.ModelBuilder("arm")
        .add_body("rod", None, "revolute", (0, 1, 0), inertia=(1.0, (0, 0, -0.5), np.eye(3)), limits=(-0.5, 0.25))
        .build(gravity=(0, 0, 0))
    )
    contacts = sd.Contacts(model, {}).with_limits()
    assert contacts.stops == ("rod_joint",)
    for q, v, after in ((0.25, 1.0, 0.0), (0.2499, 1.0, 0.1), (-0.5, -1.0, 0.0), (0.0, 1.0, 1.0), (0.25, -1.0, -1.0)):
        assert sd.contact_step(model, contacts, [q], [v], [0.0], DT).v[0] == pytest.approx(after, abs=1e-12)
    assert sd.contact_step(model, contacts, [0.26], [0.0], [0.0], DT).v[0] == pytest.approx(-0.01 / RISING)


@pytest.mark.parametrize("push", [0.0, 50.0])
def test_the_ground_pushes_a_joint_off_its_limit(push: float) -> None:
    """Gravity and a torque hold an arm at its limit, and its tip is in the ground by half a millimetre."""
    made = sd.ModelBuilder("arm")
    made.add_body("rod", None, "revolute", (0, -1, 0), inertia=(1.0, (0.5, 0, 0), np.eye(3) / 12), limits=(0.0, 1.0))
    model = made.add_body("tip", "rod", "fixed", placement=(1, 0, 0)).build()
    contacts = sd.Contacts(model, {"tip": 0.0}, terrain=sd.Plane(height=5e-4)).with_limits()
    step = sd.contact_step(model, contacts, [0.0], [0.0], [-push], DT)
    assert step.v[0] == pytest.approx(5e-4 / RISING, rel=1e-9)
    assert step.residual <= 1e-9
    assert step.impulse[0, 2] > 0.0


@pytest.mark.parametrize("q", [-0.02, 0.0, 2e-4])
def test_a_joint_before_at_and_beyond_its_limit_carries_a_foot_by_the_law(q: float) -> None:
    """Both joints of a leg are pressed to their limits by a foot in the ground, each at a velocity of its own."""
    made = sd.ModelBuilder("leg").add_body("body", None, "prismatic", (0, 0, 1), inertia=(5.0, (0, 0, 0), np.eye(3)))
    inertia, limits = (1.0, (0.3, 0.1, 0), np.diag([0.02, 0.1, 0.1])), (0.0, 1.0)
    made.add_body("thigh", "body", "revolute", (0, 1, 0), inertia=inertia, limits=limits)
    made.add_body("shank", "thigh", "revolute", (0, 1, 0), (0.7, 0, 0), inertia, limits=limits)
    model = made.add_body("foot", "shank", "fixed", placement=(0.5, 0, 0)).build()
    contacts = sd.Contacts(model, {"foot": 0.0}, terrain=sd.Plane(height=1e-4), tolerance=1e-10).with_limits()
    state = np.array([0.0, q, 0.5 * q])
    state[0] -= sd.contact_gaps(model, contacts, state)[0]
    step = sd.contact_step(model, contacts, state, np.zeros(3), [-80.0, -3.0, -5.0], DT)
    least = np.array([-x / DT if x >= 0.0 else -x / RISING for x in state[1:]])
    assert (step.v[1:] >= least - 1e-9).all()
    assert step.residual <= 1e-9


def test_limits_and_feet_are_solved_together() -> None:
    """A leg that is pressed to its limit by the ground: all joints stay within, and the feet keep Coulomb's law."""
    model, feet = quadruped()
    contacts = sd.Contacts(model, feet, tolerance=1e-12)
    q0 = stance(model, contacts)
    shanks = [j for j in model.joints if j.name.endswith("shank_joint")]
    both = contacts.with_limits()
    q = q0.copy()
    for j in shanks:
        q[j.idx_q] = math.copysign(2.5, q0[j.idx_q])
    q[2] -= sd.contact_gaps(model, contacts, q).min()
    free, held = at_rest(model, contacts, q), at_rest(model, both, q)
    v = np.array([free.v[j.idx_v] * math.copysign(1.0, q[j.idx_q]) for j in shanks])
    w = np.array([held.v[j.idx_v] * math.copysign(1.0, q[j.idx_q]) for j in shanks])
    assert (v > 1e-3).all()
    assert (w <= 1e-9).all()
    assert held.residual <= 1e-9
    assert held.impulse[:, 2].min() > 0.0


# --- however it runs ------------------------------------------------------------------------------------


@pytest.mark.slow(quick="test_heights_between_four_are_bilinear_in_every_engine")
def test_the_table_kernel_agrees_with_the_program_and_with_plain_python() -> None:
    """Calls do not wait for it; runs without a program do, after their first steps."""
    model, feet = quadruped()
    contacts = sd.Contacts(model, feet, friction=0.5, restitution=0.3).with_limits()
    q, v, tau = states(model, contacts, 12, 7)
    rest = (np.full((1, 1), DT), contacts.friction[None], contacts.restitution[None])
    spec = CONTACT_STEP
    (width,) = recording.shape_of(spec.output, model.bodies, (contacts.table,))
    program, kernel = np.empty((12, width)), np.empty((12, width))
    given = spec, model, [q, v, tau, *rest], (contacts.table,)
    assert not len(run.batch(*given, program).samples)
    assert not len(by_table_kernel._run_table_kernel(*given, kernel, None, None, True).samples)
    np.testing.assert_allclose(kernel, program, rtol=0.0, atol=1e4 * SAME)
    one = sd.contact_step(model, contacts, q[3], v[3], tau[3], DT)
    ahead, _ = in_first_axes(model, one.v, v[3], DT)
    np.testing.assert_allclose(ahead, program[3, : model.nv], rtol=0.0, atol=1e2 * SAME)
    python = np.empty(width)
    named = {"q": q[3], "v": v[3], "tau": tau[3], "dt": DT, "contacts": contacts.table.rows}
    named |= {"mu": contacts.friction, "restitution": contacts.restitution}
    spec.run(model.bodies, np.zeros(model.nv + 1, spec.work), named, python)
    np.testing.assert_allclose(python, program[3], rtol=0.0, atol=1e4 * SAME)


@pytest.mark.slow(quick="simulation/test_contact_runs.py::test_nan_reaches_the_state_and_no_other_sample")
def test_batches_broadcast_and_nan_stays_in_its_sample() -> None:
    model, feet = quadruped()
    contacts = sd.Contacts(model, feet)
    q, v, tau = states(model, contacts, 5, 9)
    clean = sd.contact_step(model, contacts, q, v, tau, DT)
    assert clean.impulse.shape == (5, 4, 3)
    np.testing.assert_array_equal(
        sd.contact_step(model, contacts, q[:, None], v[:, None], tau[:, None], DT).v[:, 0], clean.v
    )
    v[2, 3] = np.nan
    found = sd.contact_step(model, contacts, q, v, tau, DT)
    assert np.isnan(found.v[2]).any()
    for x, y in zip(found, clean, strict=True):
        np.testing.assert_array_equal(np.delete(x, 2, 0), np.delete(y, 2, 0))


def test_a_step_in_exact_numbers_and_as_a_program_of_its_own() -> None:
    model, feet = quadruped()
    contacts = sd.Contacts(model, feet)
    q, v, tau = (x[0] for x in states(model, contacts, 1, 3))
    wanted = sd.contact_step(model, contacts, q, v, tau, DT)
    given = (q, v, tau, DT, contacts.friction, contacts.restitution)
    truth = sd.exact(model, sd.contact_step, constraints=contacts)(*given)
    program = sd.specialize(model, sd.contact_step, constraints=contacts)
    found = program(*given)
    ahead, _ = in_first_axes(model, wanted.v, v, DT)
    for after, impulse in ((truth[0], truth[1]), (found[:18], found[18:30])):
        np.testing.assert_allclose(np.asarray(after, float), ahead, rtol=0.0, atol=1e-9)
        impulses = np.asarray(impulse, float).reshape(4, 3)
        np.testing.assert_allclose(impulses, wanted.impulse, rtol=0.0, atol=1e-9)
    gaps = sd.specialize(model, sd.contact_gaps, constraints=contacts)(q)
    np.testing.assert_allclose(gaps, wanted.gap, rtol=0.0, atol=1e-15)
    hills = sd.Contacts(model, feet, terrain=sd.Heightfield(np.zeros((2, 2)), 1.0))
    held = sd.Constraints(model, [sd.VelocityConstraint(np.eye(18)[:1])])
    for other in (hills, held, None):
        with pytest.raises(sd.SpatialDynError, match="expected Contacts on a Plane of this model: a call takes them"):
            sd.specialize(model, sd.contact_step, constraints=other)
    with pytest.raises(sd.SpatialDynError, match="expected Constraints of this model: a call takes them"):
        sd.specialize(model, sd.constraint_jacobian, constraints=contacts)


@pytest.mark.slow(quick="test_a_step_in_exact_numbers_and_as_a_program_of_its_own")
def test_nan_stays_in_its_sample_of_a_program_of_its_own() -> None:
    model, feet = quadruped()
    contacts = sd.Contacts(model, feet)
    q, v, tau = states(model, contacts, 3, 3)
    k = sd.specialize(model, sd.contact_step, constraints=contacts)
    given = (DT, contacts.friction, contacts.restitution)
    wanted = k(q, v, tau, *given)
    v[1, 3] = np.nan
    found = k(q, v, tau, *given)
    assert np.isnan(found[1]).any()
    np.testing.assert_array_equal(found[[0, 2]], wanted[[0, 2]])


def test_every_part_of_the_contacts_is_in_the_key_of_its_program() -> None:
    """A kernel kept for one foot, plane or tolerance must not answer for another."""
    model, feet = quadruped()
    q, _, tau = states(model, sd.Contacts(model, feet), 1, 11)
    q[0] = stance(model, sd.Contacts(model, feet))
    v = np.zeros((1, 18))
    v[0, :3] = 0.5, 0.2, -0.5
    found = []
    for changes in (
        {}, {"tolerance": 0.1}, {"friction": 0.1}, {"terrain": sd.Plane(height=1e-3)}, {"limits": True},
        {"terrain": sd.Plane((0.0, 0.1, 1.0))}, {"restitution": 1.0}, {"points": {**feet, "lf_foot": 0.022}},
    ):  # fmt: skip
        contacts = sd.Contacts(model, **{"points": feet, **{x: y for x, y in changes.items() if x != "limits"}})
        contacts = contacts.with_limits() if "limits" in changes else contacts
        step = sd.contact_step(model, contacts, q[0], v[0], tau[0], DT)
        found.append(tuple(np.round(step.v, 12)))
        plain = np.empty(recording.shape_of(CONTACT_STEP.output, model.bodies, (contacts.table,)))
        given = {"q": q[0], "v": v[0], "tau": tau[0], "dt": DT, "contacts": contacts.table.rows}
        given |= {"mu": contacts.friction, "restitution": contacts.restitution}
        CONTACT_STEP.run(model.bodies, np.zeros(model.nv + 1, CONTACT_STEP.work), given, plain)
        ahead, _ = in_first_axes(model, step.v, v[0], DT)
        np.testing.assert_allclose(ahead, plain[: model.nv], rtol=0.0, atol=1e-9)
    assert len(set(found)) >= 7  # limits alone may not act here


def test_a_program_does_not_move_the_bodies_on_which_points_are_given(monkeypatch: pytest.MonkeyPatch) -> None:
    """Origins move along axes where no frame is named; moved ones under given points are wrong without a message."""
    model, feet = quadruped()
    contacts = sd.Contacts(model, feet)
    q, v, tau = states(model, contacts, 1, 13)
    wanted = sd.contact_step(model, contacts, q[0], v[0], tau[0], DT)
    moved: list[int] = []
    monkeypatch.setattr(recording, "move_origins", lambda rows: moved.append(len(rows)))
    recording.record((CONTACT_STEP, CONTACT_GAPS), model.bodies, (contacts.table, contacts.table))
    assert not moved
    assert off_the_law(contacts, q[0], v[0], tau[0], DT, wanted) <= 1e-4


# --- refusals -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"points": {"lf_food": 0.1}}, sd.ModelError, "lf_food"),
        ({"points": {"lf_foot": -0.1}}, sd.ConstraintError, 'point "lf_foot" has radius -0.1, expected'),
        ({"points": ["lf_foot"]}, sd.ConstraintError, r"points are \['lf_foot'\], expected {frame: radius}"),
        ({"restitution": 1.5}, sd.ConstraintError, "restitution is 1.5, expected 0 to 1"),
        ({"restitution": {"lf_foot": -0.1}}, sd.ConstraintError, 'restitution of point "lf_foot" is -0.1, expected'),
        ({"friction": -1.0}, sd.ConstraintError, "friction is -1.0, expected a finite number of 0 or more"),
        ({"friction": math.inf}, sd.ConstraintError, "friction is inf, expected a finite number"),
        ({"friction": {"rf_foot": 0.5}}, sd.ConstraintError, "friction has points rf_foot, expected those of points"),
        ({"terrain": 3}, sd.ConstraintError, "terrain is 3, expected a Plane or a Heightfield"),
        ({"sweeps": 20}, sd.ConstraintError, "sweeps is 20, expected a tolerance"),
        ({"tolerance": 0.0}, sd.ConstraintError, "tolerance is 0.0, expected a positive number"),
        ({"steps": 0}, sd.ConstraintError, "steps is 0, expected a whole number of 1 to 100"),
        ({"rounds": 101}, sd.ConstraintError, "rounds is 101, expected a whole number of 1 to 100"),
        ({"sweep": 1}, TypeError, "unexpected keyword argument 'sweep'"),
    ],
)
def test_what_is_no_contact_is_refused_by_name(changes: dict[str, Any], error: Any, words: str) -> None:
    model, _ = quadruped()
    with pytest.raises(error, match=words):
        sd.Contacts(model, **{"points": {"lf_foot": 0.02}, **changes})


def test_planes_are_checked() -> None:
    for given, words in (({"normal": (0, 0, 0)}, "Plane has normal"), ({"height": math.nan}, "Plane has height")):
        with pytest.raises(sd.ConstraintError, match=words):
            sd.Plane(**given)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((np.zeros((1, 4)), 0.1), r"z of shape \(1, 4\), expected \(nx, ny\) of 2 or more each"),
        ((np.full((2, 2), math.nan), 0.1), "heights that are not finite"),
        ((np.zeros((2, 2)), 0.0), "spacing 0.0, expected a finite number above 0"),
        ((np.zeros((2, 2)), 0.1, (0.0, math.inf)), "origin .*, expected two finite numbers"),
    ],
)
def test_heights_are_checked(given: Any, words: str) -> None:
    with pytest.raises(sd.ConstraintError, match=words):
        sd.Heightfield(*given)


def test_a_point_that_does_not_move_is_no_contact() -> None:
    model = sd.load_urdf("two_link")
    with pytest.raises(sd.ConstraintError, match="does not move, expected a frame on a moving body"):
        sd.Contacts(model, {model.robot.root: 0.1})


def test_a_massless_leg_is_named() -> None:
    made = sd.ModelBuilder("hopper").set_inertia("base", (1.0, (0, 0, 0), np.eye(3)))
    model = made.add_body("leg", None, "prismatic", (0, 0, 1)).build(root="floating")
    with pytest.raises(sd.InertiaError, match='joint "leg_joint" has zero articulated inertia'):
        at_rest(model, sd.Contacts(model, {"leg": 0.0}))


def test_dt_and_contacts_of_another_robot_are_refused() -> None:
    model, feet = quadruped()
    contacts = sd.Contacts(model, feet)
    for dt in (0.0, -1.0, math.nan, "1", True):
        with pytest.raises(sd.SimulationError, match="dt is"):
            sd.contact_step(model, contacts, sd.neutral(model), np.zeros(18), np.zeros(18), dt)  # type: ignore[arg-type]
    other = mass()
    with pytest.raises(sd.ModelError, match='contacts are of the model "quadruped", expected those made of the'):
        sd.contact_gaps(other, contacts, np.zeros(3))
    with pytest.raises(sd.ConstraintError, match="contacts are a dict"):
        sd.contact_gaps(other, feet, np.zeros(3))  # type: ignore[arg-type]


def test_contacts_are_values() -> None:
    model, feet = quadruped()
    contacts = sd.Contacts(model, feet, friction=0.4)
    assert contacts == sd.Contacts(model, feet, friction=0.4)
    assert hash(contacts) == hash(copy.deepcopy(contacts))
    assert pickle.loads(pickle.dumps(contacts)) == contacts
    assert contacts != sd.Contacts(model, feet, friction=0.5)
    assert contacts != sd.Contacts(model, feet, 0.4, terrain=sd.Plane(height=1.0))
    rough = sd.Contacts(model, feet, terrain=sd.Heightfield(np.zeros((2, 3)), 0.1))
    assert pickle.loads(pickle.dumps(rough)) == rough != sd.Contacts(model, feet)
    assert rough != sd.Contacts(model, feet, terrain=sd.Heightfield(np.ones((2, 3)), 0.1))
    with pytest.raises(AttributeError, match="a Heightfield is immutable"):
        rough.terrain.z = None
    assert contacts.with_limits().limits
    assert len(contacts) == 4
    with pytest.raises(AttributeError, match="Contacts are immutable"):
        contacts.tolerance = 3
    with pytest.raises(AttributeError, match="Contacts are immutable"):
        del contacts.tolerance
