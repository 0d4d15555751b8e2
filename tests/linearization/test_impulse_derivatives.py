"""Derivatives of steps by impulses and under constraints: against central differences of the step, and by hand."""

from __future__ import annotations

import itertools
import sys
from pathlib import Path
from typing import Any

import grounded
import numpy as np
import pytest
from dense import Array

import spatialdyn as sd

sys.path.insert(0, str(Path(__file__).parents[1] / "constraints"))
import mechanisms

DT = 1e-3
DIFFERENCE = 1e-7  # of the entries of A and B: what is asked for, of central differences over 2e-5 or 2e-6
EXACT = 1e-13  # steps are solved to this where they are differenced
IN = 1e-5  # [m] in the ground: a point at rest on it is at a switch


def differences(scene: sd.Scene, q: Array, v: Array, tau: Array, dt: float, e: float = 1e-6) -> Array:
    """(2 nv, 3 nv) by central differences, all of them steps of one batch."""
    model, n = scene.model, scene.model.nv
    unit = e * np.concatenate([np.eye(3 * n), -np.eye(3 * n)])
    moved = sd.integrate(model, np.broadcast_to(q, (6 * n, model.nq)), np.ascontiguousarray(unit[:, :n]))
    ends = sd.step(scene, moved, v + unit[:, n : 2 * n], tau + unit[:, 2 * n :], dt)
    after = sd.step(scene, q, v, tau, dt)[0]
    both = np.hstack([sd.difference(model, np.broadcast_to(after, ends[0].shape), ends[0]), ends[1]])
    return (both[: 3 * n] - both[3 * n :]).T / (2.0 * e)


def agree(scene: sd.Scene, q: Array, v: Array, tau: Array | None = None, dt: float = DT, e: float = 1e-6) -> Any:
    """The derivatives, which differences of steps agree with."""
    tau = np.zeros(scene.model.nv) if tau is None else tau
    found = sd.step_derivatives(scene, q, v, tau, dt)
    wanted = differences(scene, q, v, tau, dt, e)
    np.testing.assert_allclose(np.hstack(found), wanted, rtol=0, atol=DIFFERENCE * max(1.0, abs(wanted).max()))
    assert not found.switching.any()
    return found


def pendulum(limits: tuple[float, float] = (-9.0, 9.0)) -> sd.Model:
    made = sd.ModelBuilder("pendulum")
    made.add_body("rod", None, "revolute", (0, 1, 0), None, (2.0, (0, 0, -0.7), np.zeros((3, 3))), limits=limits)
    return made.build()


def ball() -> tuple[sd.Model, sd.Contacts]:
    made = sd.ModelBuilder("ball").add_body("ball", None, "floating", inertia=(2.0, (0, 0, 0), 0.008 * np.eye(3)))
    model = made.build()
    return model, sd.Contacts(model, {"ball": 0.1}, friction=0.5, tolerance=EXACT)


def on_the_ground(model: sd.Model, contacts: sd.Contacts, q: Array) -> Array:
    q = np.array(q)
    for _ in range(5):  # over slopes gaps are no heights
        q[2] -= sd.contact_gaps(model, contacts, q).min() + IN
    return q


def standing() -> tuple[sd.Model, dict[str, float], Array, Array]:
    """The quadruped, its feet, a stance and torques that hold it."""
    model, feet = grounded.quadruped()
    contacts = sd.Contacts(model, feet)
    q = on_the_ground(model, contacts, grounded.stance(model, contacts))
    g, J = sd.generalized_gravity(model, q), grounded.jacobian(contacts, q).reshape((-1, model.nv))
    tau = g - J.T @ np.linalg.lstsq(J.T[:6], g[:6], rcond=None)[0]
    tau[:6] = 0.0
    return model, feet, q, tau


# --- by hand --------------------------------------------------------------------------------------------


def test_a_pendulum_that_rubs_slips_and_sticks() -> None:
    """m l² (v⁺ - v) = h (τ - m g l sin q - b v⁺) ∓ h F(v); at rest v⁺ is 0 whatever acts."""
    model, h, q, v, tau = pendulum(), 1e-2, np.array([0.4]), np.array([0.7]), np.array([0.1])
    scene = sd.Scene(model, friction=sd.Friction(1.0, 0.1, 1.5, 0.3))
    A, B = found = agree(scene, q, v, tau, h)
    assert (found.labels, found.active.tolist()) == (('friction of joint "rod_joint"',), ["slides"])
    inertia, level = 2.0 * 0.49, 0.5 * np.exp(-((0.7 / 0.3) ** 2)) * -2.0 * 0.7 / 0.09
    M = inertia + 0.1 * h
    by_v = (inertia - h * level) / M
    by_q = -h * 2.0 * 9.81 * 0.7 * np.cos(0.4) / M
    np.testing.assert_allclose(A, [[1.0 + h * by_q, h * by_v], [by_q, by_v]], rtol=0, atol=1e-12)
    np.testing.assert_allclose(B, [[h * h / M], [h / M]], rtol=0, atol=1e-12)
    A, B = found = agree(scene, np.array([0.01]), np.zeros(1), tau, h)
    assert found.active.tolist() == ["sticks"]
    np.testing.assert_allclose(A, [[1.0, 0.0], [0.0, 0.0]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(B, [[0.0], [0.0]], rtol=0, atol=1e-15)


@pytest.mark.parametrize("friction", [False, sd.Friction(1.0, 0.1)])
def test_a_joint_that_reaches_a_limit_ends_there(friction: Any) -> None:
    """q⁺ is the limit, whatever the state: v⁺ = (upper - q) / h."""
    scene = sd.Scene(pendulum((-1.0, 1.0)), limits=True, friction=friction)
    A, B = found = agree(scene, np.array([0.99]), np.array([2.0]), dt=1e-2)
    assert found.active.tolist() == ["upper limit"]
    np.testing.assert_allclose(A, [[0.0, 0.0], [-100.0, 0.0]], rtol=0, atol=1e-12)
    np.testing.assert_allclose(B, [[0.0], [0.0]], rtol=0, atol=1e-15)
    assert agree(scene, np.array([0.5]), np.array([2.0]), dt=1e-2).active[0] in ("free", "slides")


def test_what_is_about_to_change_is_at_a_switch() -> None:
    """A joint at its limit to the last bit, and a point at rest on the ground: the derivative is that of one side."""
    model = pendulum((-1.0, 1.0))
    found = sd.step_derivatives(
        sd.Scene(model, limits=True), [1.0 - 2e-2], [2.0], [2.0 * 9.81 * 0.7 * np.sin(0.98)], 1e-2
    )
    assert found.switching.tolist() == [True]
    model, contacts = ball()
    found = sd.step_derivatives(sd.Scene(model, contacts=contacts), [0, 0, 0.1, 0, 0, 0, 1], [0.0] * 6, [0.0] * 6, DT)
    assert (found.active.tolist(), found.switching.tolist()) == (["sticks"], [True])


# --- against differences --------------------------------------------------------------------------------


def test_a_ball_rolls_slips_and_flies() -> None:
    model, contacts = ball()
    scene = sd.Scene(model, contacts=contacts)
    q = on_the_ground(model, contacts, sd.integrate(model, sd.neutral(model), np.array([0, 0, 0, 0.3, 0.5, -0.2])))
    R, w = sd.frame_placement(model, q, "ball")[:3, :3], np.array([1.0, 20.0, 3.0])
    rolls = np.cross(w, [0.0, 0.0, 0.1])
    for more, state in (([0, 0, 0], "sticks"), ([1.0, 0.5, 0.0], "slides"), ([0, 0, 1.0], "separates")):
        found = agree(scene, q, np.r_[R.T @ (rolls + more), R.T @ w])
        assert found.active.tolist() == [state]


def test_a_ball_rolls_over_heights() -> None:
    model, _ = ball()
    x = np.linspace(-0.5, 0.5, 11)
    ground = sd.Heightfield(0.1 * np.sin(3.0 * x)[:, None] + 0.05 * np.cos(2.0 * x)[None], 0.1, (-0.5, -0.5))
    contacts = sd.Contacts(model, {"ball": 0.1}, friction=0.5, tolerance=EXACT, terrain=ground)
    q = on_the_ground(model, contacts, np.array([0.13, 0.27, 0.0, 0.0, 0.6, 0.0, 0.8]))
    for v in ([0.5, 0.2, 0.0, 1.0, 2.0, 0.5], [0.0] * 6):
        agree(scene := sd.Scene(model, contacts=contacts), q, np.array(v))
    assert sd.step_derivatives(scene, q, v, np.zeros(6), DT).active.tolist() == ["sticks"]


@pytest.mark.parametrize("state", ["slides", "sticks"])
def test_a_box_slides_and_rests(state: str) -> None:
    """On four corners, whose impulses depend on each other: velocities do not."""
    model, corners = grounded.box(0.1)
    contacts = sd.Contacts(
        model, dict.fromkeys(corners, 0.0), friction=0.05 if state == "slides" else 0.9, tolerance=EXACT
    )
    v = np.array([0.5, 0.2, 0, 0, 0, 0]) * (state == "slides")
    found = agree(sd.Scene(model, contacts=contacts), on_the_ground(model, contacts, sd.neutral(model)), v, e=1e-7)
    assert found.active.tolist() == 4 * [state]


def test_a_quadruped_stands() -> None:
    model, feet, q, tau = standing()
    contacts = sd.Contacts(model, feet, friction=0.8, tolerance=EXACT)
    found = agree(sd.Scene(model, contacts=contacts), q, np.zeros(model.nv), tau)
    assert found.active.tolist() == 4 * ["sticks"]


@pytest.mark.slow(quick="test_a_quadruped_stands")
def test_a_quadruped_moves_on_dry_joints_between_limits() -> None:
    model, feet, q, tau = standing()
    contacts = sd.Contacts(model, feet, friction=0.8, tolerance=EXACT)
    v = 0.05 * np.random.default_rng(1).normal(size=model.nv)
    rubs = sd.Friction(np.r_[np.zeros(6), np.full(12, 0.5)], 0.1)
    scene = sd.Scene(model, contacts=contacts, limits=True, friction=rubs)
    found = agree(scene, q, v, tau)
    assert found.active.tolist() == 4 * ["sticks"] + 12 * ["slides"]


@pytest.mark.slow(quick="test_what_is_about_to_change_is_at_a_switch")
def test_joints_that_stick_in_a_closed_loop_of_legs_are_at_a_switch() -> None:
    """Two hips stick while all feet do: as the state moves, one of them has to let go."""
    model, feet, q, tau = standing()
    rubs = sd.Friction(np.r_[np.zeros(6), np.full(12, 0.5)], 0.1)
    scene = sd.Scene(model, contacts=sd.Contacts(model, feet, friction=0.8, tolerance=1e-11), friction=rubs)
    found = sd.step_derivatives(scene, q, 0.05 * np.random.default_rng(0).normal(size=model.nv), tau, DT)
    assert (found.active == "sticks").sum() == 6
    assert found.switching.any()


# --- under constraints ----------------------------------------------------------------------------------


def along_states(scene: sd.Scene, q: Array, v: Array, dt: float, method: str, atol: float = DIFFERENCE) -> Any:
    """The derivatives, which agree with differences along states that meet the constraints."""
    model, e, rng = scene.model, 1e-5, np.random.default_rng(0)
    held = scene.constraints
    assert held is not None
    tau = 0.2 * rng.normal(size=model.nv)
    found = sd.step_derivatives(scene, q, v, tau, dt, method)
    end = sd.step(scene, q, v, tau, dt, method)[0]
    for d, w, t in rng.normal(size=(2, 3, model.nv)):
        rows = []
        for s in (e, -e):
            x = sd.project_configuration(model, held, sd.integrate(model, q, s * d))
            u = sd.project_velocity(model, held, x, v + s * w)
            after = sd.step(scene, x, u, tau + s * t, dt, method)
            rows.append(np.r_[sd.difference(model, q, x), u, s * t, sd.difference(model, end, after[0]), after[1]])
        moved, n = (rows[0] - rows[1]) / (2.0 * e), model.nv
        wanted = moved[3 * n :]
        np.testing.assert_allclose(
            np.hstack(found) @ moved[: 3 * n], wanted, rtol=0, atol=atol * max(1.0, abs(wanted).max())
        )
    return found


@pytest.mark.parametrize("method", ["semi_implicit_euler", "velocity_verlet", "rk4", "stormer_verlet", "variational"])
def test_a_four_bar_by_methods_that_take_constraints(method: str) -> None:
    model = mechanisms.four_bar()
    q, v = mechanisms.four_bar_state()
    along_states(sd.Scene(model, constraints=mechanisms.pin_of(model)), q, v, 1e-2, method)


@pytest.mark.parametrize(("level", "time"), [(0.05, None), (0.05, 0.1), (3.0, None)])
def test_a_four_bar_with_dry_joints(level: float, time: float | None) -> None:
    model = mechanisms.four_bar()
    q, v = mechanisms.four_bar_state()
    rubs = sd.Friction(level, 0.1)
    scene = sd.Scene(model, constraints=mechanisms.pin_of(model), friction=rubs, stabilization=time)
    found = along_states(scene, q, v * (level < 1.0), 1e-2, "semi_implicit_euler")
    assert set(found.active.tolist()) == {"slides" if level < 1.0 else "sticks"}


@pytest.mark.slow(quick="test_a_four_bar_with_dry_joints")
@pytest.mark.parametrize("name", mechanisms.REDUNDANT)
@pytest.mark.parametrize("method", ["dry", "semi_implicit_euler", "stormer_verlet", "variational"])
def test_redundant_loops_have_derivatives(name: str, method: str) -> None:
    """Of which some equations depend on others: those that are not kept have multipliers of 0."""
    model, held, q, v = mechanisms.REDUNDANT[name]()
    dry = method == "dry"
    scene = sd.Scene(model, constraints=held, friction=sd.Friction(0.02, 0.01) if dry else None)
    along_states(scene, q, v, DT if dry else 1e-2, "semi_implicit_euler" if dry else method)


def test_continuous_time_under_constraints_is_the_limit_of_a_step() -> None:
    model = mechanisms.four_bar()
    q, v = mechanisms.four_bar_state()
    held, h, tau = mechanisms.pin_of(model), 1e-6, np.zeros(3)
    scene = sd.Scene(model, constraints=held, stabilization=0.1)
    A, B = sd.linearize(scene, q, v, tau)
    by_state, by_tau = sd.step_derivatives(scene, q, v, tau, h, "explicit_euler")
    np.testing.assert_allclose((by_state - np.eye(6)) / h, A, rtol=0, atol=1e-6 * abs(A).max())
    np.testing.assert_allclose(by_tau / h, B, rtol=0, atol=1e-6 * abs(B).max())


# --- motors, bristles, bounces --------------------------------------------------------------------------


@pytest.mark.parametrize("drive", ["current", "voltage"])
@pytest.mark.parametrize("more", [{}, {"current": 1.9}, {"torque": 3.0}])
def test_motors_act_on_the_branch_on_which_they_are(drive: str, more: dict[str, float]) -> None:
    """As they drive or brake, within the limits of supply, current and gear, and at them; between, at a switch."""
    motor = sd.Motor(0.05, 1.0, 24.0, 20.0, efficiency=0.8, **more)
    scene = sd.Scene(pendulum(), motor=motor, drive=drive, friction=sd.Friction(0.2, 0.1, 0.3, 0.3))
    found = set()
    for tau, v in itertools.product((0.1, 1.8, 40.0), (0.7, -0.3)):
        by = agree(scene, np.array([0.4]), np.array([v]), np.array([tau]), 1e-2)
        assert by.labels == ('friction of joint "rod_joint"', 'motor of joint "rod_joint"')
        found.add(by.active[1])
        assert (abs(by.B).max() == 0.0) == (by.active[1] == "saturated")
    assert found == {"commanded", "saturated"}
    edge = 24.0 if drive == "voltage" and not more else 1.9 * 20 * 0.05 + 400 * 0.0025 * 0.7 * (drive == "voltage")
    if "torque" not in more and (more or drive == "voltage"):
        by = sd.step_derivatives(scene, [0.4], [0.7], [edge], 1e-2)
        assert by.switching.tolist() == [False, True]


@pytest.mark.parametrize("drive", ["current", "voltage"])
def test_a_joint_without_a_motor_has_no_torque(drive: str) -> None:
    """A torque of 0 is at both of its limits, which are 0; beside gears with and without losses."""
    model, q, v, tau = sd.load_urdf("two_link"), np.array([0.4, 0.2]), np.array([0.7, -0.3]), np.array([1.0, 0.0])
    for eta in (1.0, 0.8):
        motor = sd.Motor([0.05, 0.0], 1.0, 24.0, 20.0, efficiency=eta)
        by = agree(sd.Scene(model, motor=motor, drive=drive), q, v, tau)
        assert by.labels[-1] == 'motor of joint "joint1"'
        assert abs(by.B[:, 0]).min() > 0.0
        assert not by.B[:, 1].any()


def with_bristles(scene: sd.Scene, q: Array, v: Array, tau: Array, z: Array, dt: float, e: float = 1e-6) -> Any:
    """The derivatives by (q, v, z), which differences of steps agree with."""
    model, n = scene.model, scene.model.nv
    found = sd.step_derivatives(scene, q, v, tau, dt, states={"bristles": z})
    assert (found.A.shape, found.B.shape) == ((3 * n, 3 * n), (3 * n, n))
    unit = e * np.concatenate([np.eye(4 * n), -np.eye(4 * n)])
    moved = sd.integrate(model, np.broadcast_to(q, (8 * n, model.nq)), np.ascontiguousarray(unit[:, :n]))
    bent = {"bristles": z + unit[:, 2 * n : 3 * n]}
    ends = sd.step(scene, moved, v + unit[:, n : 2 * n], tau + unit[:, 3 * n :], dt, states=bent)
    end = sd.step(scene, q, v, tau, dt, states={"bristles": z})[0]
    both = np.hstack([sd.difference(model, np.broadcast_to(end, ends[0].shape), ends[0]), ends[1], ends[2]["bristles"]])
    wanted = (both[: 4 * n] - both[4 * n :]).T / (2.0 * e)
    np.testing.assert_allclose(np.hstack(found), wanted, rtol=0, atol=DIFFERENCE * max(1.0, abs(wanted).max()))
    assert not found.switching.any()
    return found


LUGRE = {"bristle_stiffness": 1e3, "bristle_damping": 2.0}


@pytest.mark.parametrize("limits", [False, True])
def test_bristles_are_a_state_of_the_linear_system(limits: bool) -> None:
    """Alone by the program of the step, beside limits by the laws of impulses."""
    rubs = sd.Friction(1.0, 0.1, 1.5, 0.3, **LUGRE)
    scene = sd.Scene(pendulum(), friction=rubs, friction_method="lugre", limits=limits)
    q, v, tau, z = np.array([0.4]), np.array([0.7]), np.array([0.1]), np.array([3e-4])
    found = with_bristles(scene, q, v, tau, z, 1e-2)
    assert found.active.tolist() == ["free"] * limits + ["bends"]
    still = sd.step_derivatives(scene, q, [0.0], tau, 1e-2)  # bristles at 0
    assert still.switching.tolist() == [False] * limits + [True]


@pytest.mark.slow(quick="test_bristles_are_a_state_of_the_linear_system")
def test_a_quadruped_stands_on_joints_with_bristles() -> None:
    model, feet, q, tau = standing()
    legs, rng = np.r_[np.zeros(6), np.ones(12)], np.random.default_rng(1)
    rubs = sd.Friction(0.5 * legs, 0.1 * legs, **LUGRE)
    contacts = sd.Contacts(model, feet, friction=0.8, tolerance=EXACT)
    scene = sd.Scene(model, contacts=contacts, friction=rubs, friction_method="lugre")
    v, z = 0.05 * rng.normal(size=18), 1e-4 * legs * rng.normal(size=18)
    assert with_bristles(scene, q, v, tau, z, DT).active.tolist() == ["sticks"] * 4 + ["bends"] * 12


@pytest.mark.parametrize("e", [0.5, 1.0])
def test_a_ball_bounces_and_glances(e: float) -> None:
    """Two phases, chained; what holds it against its weight is not given back."""
    model, _ = ball()
    q, states = np.array([0.0, 0.0, 0.1003, 0.0, 0.6, 0.0, 0.8]), []
    for mu, v in itertools.product((0.5, 0.05), ([0.3, 0.2, -1.0, 1.0, 2.0, 0.5], [0.0, 0.0, -0.05, 3.0, 0.0, 0.0])):
        contacts = sd.Contacts(model, {"ball": 0.1}, friction=mu, restitution=e, tolerance=EXACT)
        states += agree(sd.Scene(model, contacts=contacts), q, np.array(v), dt=1e-2).active.tolist()
    assert set(states) == {"bounces", "glances"}
    contacts = sd.Contacts(model, {"ball": 0.1}, friction=0.0, restitution=e)
    A, _ = sd.step_derivatives(sd.Scene(model, contacts=contacts), sd.neutral(model) + 0.1003 * np.eye(7)[2],
                               [0, 0, -1.0, 0, 0, 0], np.zeros(6), 1e-2)  # fmt: skip
    assert A[8, 8] == pytest.approx(-e, abs=1e-12)


def test_a_box_bounces_on_a_corner() -> None:
    """Its friction may turn back as it bounces."""
    model, corners = grounded.box(0.1)
    rng, found = np.random.default_rng(3), []
    for _ in range(8):
        contacts = sd.Contacts(model, dict.fromkeys(corners, 0.0), friction=0.3, restitution=0.5, tolerance=1e-12)
        q = sd.integrate(model, sd.neutral(model), np.r_[0, 0, 0, 0.02 * rng.normal(size=3)])
        q[2] -= sd.contact_gaps(model, contacts, q).min() - 1e-4
        v, scene = np.r_[rng.normal(size=2), -1.0, 0.3 * rng.normal(size=3)], sd.Scene(model, contacts=contacts)
        if not (by := sd.step_derivatives(scene, q, v, np.zeros(6), DT)).switching.any():
            found.append(by.active)
            agree(scene, q, v, e=1e-7)
    assert len(found) >= 6


FALLS = {"flat": [0, 0, -1, 0, 0, 0], "along": [0.1, 0.2, -1, 0, 0, 0.1], "turning": [0, 0, -1, 0.5, 0, 0]}


@pytest.mark.parametrize("mu", [0.1, 2.0])
def test_a_point_that_moves_in_a_plane_bounces(mu: float) -> None:
    """Across that plane friction has nothing to hold, and no load to share."""
    made = sd.ModelBuilder("hopper").add_body("z", None, "prismatic", (0, 0, 1), inertia=(2.0, (0, 0, 0), np.eye(3)))
    made.add_body("x", "z", "prismatic", (1, 0, 0), inertia=(1.0, (0, 0, 0), np.eye(3)))
    made.add_body("leg", "x", "revolute", (0, 1, 0), inertia=(0.5, (0, 0, -0.1), 2e-2 * np.eye(3)))
    made.add_body("foot", "leg", "fixed", placement=(0, 0, -0.25))
    model = made.build()
    contacts = sd.Contacts(model, {"foot": 0.02}, friction=mu, restitution=0.5, tolerance=EXACT)
    q = np.array([0.2703, 0.0, 0.3])
    q[0] -= sd.contact_gaps(model, contacts, q)[0] - 3e-4
    found = agree(sd.Scene(model, contacts=contacts), q, np.array([-1.5, 0.3, 0.2]), e=1e-5)
    assert found.active.tolist() == ["bounces" if mu > 1.0 else "glances"]


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3])
def test_a_planar_robot_stands_at_any_angle_to_the_axes_of_the_ground(angle: float) -> None:
    """Out of its plane no impulse acts on it, whichever axes say so."""
    c, s = np.cos(angle), np.sin(angle)
    made = sd.ModelBuilder("walker").add_body(
        "a", None, "planar", (-s, c, 0), inertia=(10.0, (0, 0, 0), 0.5 * np.eye(3))
    )
    for name, x in (("left", -0.2), ("right", 0.2)):
        made.add_body(name, "a", "fixed", placement=(x * c, x * s, -0.7), inertia=(1.0, (0, 0, 0), 0.02 * np.eye(3)))
    model, tau, found = made.build(), np.zeros(3), []
    contacts = sd.Contacts(model, {"left": 0.02, "right": 0.02}, friction=0.1)
    up = np.array([0.0, 1.0, 0.0])  # the planar root's own second axis
    for axis in (up, np.array([1.0, 0.0, 0.0])):
        lifted = sd.contact_gaps(model, contacts, sd.integrate(model, np.zeros(3), axis)).min()
        found.append(lifted - sd.contact_gaps(model, contacts, np.zeros(3)).min())
    q = np.r_[found[1], found[0], 0.0] * -(sd.contact_gaps(model, contacts, np.zeros(3)).min() + IN)
    by = sd.step_derivatives(sd.Scene(model, contacts=contacts), q, np.zeros(3), tau, DT)
    assert by.active.tolist() == ["sticks", "sticks"]
    assert abs(by.A[3:, 3:]).max() < 1e-12  # no velocity is left
    assert abs(by.B).max() < 1e-12


@pytest.mark.parametrize("fall", FALLS)
@pytest.mark.parametrize(("mu", "e"), [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (0.0, 0.5), (0.0, 1.0)])
def test_a_box_falls_flat_on_four_corners(fall: str, mu: float, e: float) -> None:
    """What they press against each other no law says, and no velocity depends on it, even where all bounce alike."""
    model, corners = grounded.box(0.1)
    contacts = sd.Contacts(model, dict.fromkeys(corners, 0.0), mu, restitution=e, tolerance=1e-12)
    q = on_the_ground(model, contacts, sd.neutral(model))
    found = agree(sd.Scene(model, contacts=contacts), q, np.array(FALLS[fall]), e=1e-7)
    assert found.active.tolist() == 4 * ["sticks" if mu else "glances" if e else "slides"]
    assert not found.undetermined.any()


# --- springs, and loads that are shared -----------------------------------------------------------------


@pytest.mark.parametrize("touches", [True, False])
def test_springs_have_derivatives_beside_impulses_and_alone(touches: bool) -> None:
    made = sd.ModelBuilder("leg")
    made.add_body("foot", None, "prismatic", (0, 0, 1), inertia=(0.2, (0, 0, 0), 0.1 * np.eye(3)))
    made.add_body("body", "foot", "prismatic", (0, 0, 1), (0, 0, 0.5), (3.0, (0, 0, 0), 0.1 * np.eye(3)))
    model = made.add_series_elastic("body_joint", 2000.0, 6.0, 0.01, 2.0).build()
    scene = sd.Scene(model, contacts=sd.Contacts(model, {"foot": 0.0}, tolerance=EXACT) if touches else None)
    q, v = np.array([-IN, 0.02, 0.01]), np.array([-0.3, 0.2, 0.1])
    assert agree(scene, q, v, np.array([0.0, 0.1, 0.2])).active.tolist() == ["sticks"] * touches


def test_a_sliding_box_says_that_its_corners_share_the_load_as_they_may() -> None:
    """Four corners on a plane: any three could bear it; on three corners nothing is open."""
    model, corners = grounded.box()
    contacts = sd.Contacts(model, dict.fromkeys(corners, 0.0), 0.5)
    q, v = on_the_ground(model, contacts, sd.neutral(model)), np.array([1.0, 0, 0, 0, 0, 0.5])
    found = sd.step_derivatives(sd.Scene(model, contacts=contacts), q, v, np.zeros(6), DT)
    assert found.active.tolist() == ["slides"] * 4
    assert found.undetermined.all()
    few = sd.Contacts(model, dict.fromkeys(corners[:3], 0.0), 0.5)
    found = sd.step_derivatives(sd.Scene(model, contacts=few), q, v, np.zeros(6), DT)
    assert not found.undetermined.any()


# --- batches and errors ---------------------------------------------------------------------------------


def test_a_batch_is_its_samples_and_nan_stays_in_its_own() -> None:
    model, contacts = ball()
    scene = sd.Scene(model, contacts=contacts, fext=np.array([[0.0] * 6, [0.1, 0.2, -0.3, 0.0, 0.1, 0.0]]))
    q = np.tile(on_the_ground(model, contacts, sd.neutral(model)), (2, 2, 1))
    v = np.zeros((2, 2, 6))
    v[0, 1, 0], v[1, 0, 2], v[1, 1, 3] = 1.0, 1.0, np.nan
    found = sd.step_derivatives(scene, q, v, np.zeros(6), DT)
    assert found.active[..., 0].tolist() == [["sticks", "slides"], ["separates", ""]]
    for k in ((0, 0), (0, 1), (1, 0)):
        one = sd.step_derivatives(scene, q[k], v[k], np.zeros(6), DT)
        np.testing.assert_array_equal(np.hstack(one), np.concatenate([x[k] for x in found], axis=1))
        wanted = differences(scene, q[k], v[k], np.zeros(6), DT)
        np.testing.assert_allclose(np.hstack(one), wanted, rtol=0, atol=DIFFERENCE * abs(wanted).max())
    assert np.isnan(found.A[1, 1]).all()


def test_what_has_no_derivative_is_named() -> None:
    model, _ = ball()
    q, v, tau = [0, 0, 0.1, 0, 0, 0, 1], [0, 0, -1.0, 0, 0, 0], [0.0] * 6
    box, corners = grounded.box(0.1)
    flat = sd.Scene(box, contacts=sd.Contacts(box, dict.fromkeys(corners, 0.0), friction=0.5, restitution=0.5))
    start = on_the_ground(box, flat.contacts, sd.neutral(box))
    with pytest.raises(sd.SimulationError, match=r"bounce at once and could take each other's load, expected points"):
        sd.step_derivatives(flat, start, [0.4, -0.6, -1.0, 0.1, -0.5, 0.4], tau, DT)
    with pytest.raises(sd.SimulationError, match=r"states have bristles, expected none"):
        sd.step_derivatives(flat, start, v, tau, DT, states={"bristles": [0.0] * 6})
    scene = sd.Scene(model, contacts=sd.Contacts(model, {"ball": 0.1}))
    with pytest.raises(
        sd.SimulationError, match="contacts acts in the scene, expected constant forces, constraints, s"
    ):
        sd.linearize(scene, q, v, tau)
    with pytest.raises(sd.SimulationError, match='method is "rk4" and contacts act, expected semi_implicit_euler'):
        sd.step_derivatives(scene, q, v, tau, DT, "rk4")
    four_bar = mechanisms.four_bar()
    held = sd.Scene(four_bar, constraints=mechanisms.pin_of(four_bar))
    start = mechanisms.four_bar_state()
    with pytest.raises(sd.SimulationError, match='method is "gauss4" and constraints act, expected one of expl'):
        sd.step_derivatives(held, start[0], start[1], np.zeros(3), DT, "gauss4")
    with pytest.raises(sd.SimulationError, match=r"dt is -0\.001, expected more than 0 s in a scene"):
        sd.step_derivatives(scene, q, np.zeros(6), tau, -DT)
