"""Semi-implicit steps of bodies that turn and travel: what they keep of speeds, momenta and energies."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn as sd

EPS = np.finfo(float).eps
RADIUS, SPIN = 0.1, 20.0
STEPPED = "semi_implicit_euler"


def body(gravity: float = 0.0, com: Any = (0, 0, 0), I: Any = (0.01, 0.02, 0.03)) -> sd.Model:
    made = sd.ModelBuilder("ball").add_body("ball", None, "floating", inertia=(1.0, com, np.diag(I)))
    return made.build(gravity=(0, 0, gravity))


@pytest.mark.parametrize("how", ["simulate", "rollout", "step", "contact_step", "constraint", "beside one"])
def test_a_rolling_ball_keeps_its_speed(how: str) -> None:
    """At 20 rad/s and dt 1 ms it gained 18 % a second, and left the ground."""
    ball = body(-9.81, I=(0.004, 0.004, 0.004))
    scene = sd.Scene(ball, contacts=sd.Contacts(ball, {"ball": RADIUS}, 0.5))
    if how == "constraint":
        scene = sd.Scene(ball, constraints=sd.Constraints(ball, [sd.RollingConstraint("ball", None, RADIUS)]))
    elif how == "beside one":  # points and equations are solved for together: the ball stays in the plane of y
        plane = sd.PointConstraint("ball", None, axes="y")
        scene = scene.with_(constraints=sd.Constraints(ball, [plane]))
    q, v = np.array([0, 0, RADIUS, 0, 0, 0, 1.0]), np.array([RADIUS * SPIN, 0, 0, 0, SPIN, 0])
    time = 0.05 if "step" in how else 1.0
    if how == "contact_step":
        for _ in range(50):
            q, v, *_ = sd.contact_step(ball, scene.contacts, q, v, np.zeros(6), 1e-3)
    elif how == "step":
        for _ in range(50):
            q, v = sd.step(scene, q, v, np.zeros(6), 1e-3)
    elif how == "rollout":
        run = sd.rollout(scene, q, v, dt=1e-3, steps=1000)
        q, v = run.q[-1], run.v[-1]
    else:
        run = sd.simulate(scene, q, v, 1.0, 1e-3, STEPPED)
        q, v = run.q[-1], run.v[-1]
    assert np.linalg.norm(v[:3]) == pytest.approx(RADIUS * SPIN, rel=1e-6)
    assert np.linalg.norm(v[3:]) == pytest.approx(SPIN, rel=1e-6)
    assert q[:3] == pytest.approx([RADIUS * SPIN * time, 0.0, RADIUS], abs=1e-6)


@pytest.mark.parametrize("way", [sd.step, "simulate"])
def test_the_linear_momentum_of_a_free_body_is_kept_to_rounding(way: Any) -> None:
    model = body()
    q, v = np.array([0, 0, 0, 0, 0, 0, 1.0]), np.array([1.0, 2.0, 3.0, 3.0, -2.0, 4.0])
    start = v[:3].copy()
    if way == "simulate":
        run = sd.simulate(model, q, v, 0.5, 1e-3, STEPPED)
        q, v = run.q[-1], run.v[-1]
    else:
        for _ in range(500):
            q, v = sd.step(model, q, v, np.zeros(6), 1e-3)
    np.testing.assert_allclose(sd.frame_placement(model, q, "ball")[:3, :3] @ v[:3], start, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(q[:3], 0.5 * start, rtol=0.0, atol=1e-12)  # along a straight line


@pytest.mark.parametrize(
    ("kind", "com"), [("floating", (0, 0, 0)), ("floating", (0.1, 0.05, -0.02)), ("planar", (0.1, 0.2, 0.3))]
)
def test_momenta_of_a_free_body_are_of_order_2(kind: str, com: Any) -> None:
    """About a centre of mass that is elsewhere, too."""
    made = sd.ModelBuilder("body").add_body("body", None, kind, inertia=(1.0, com, np.diag([0.01, 0.02, 0.03])))
    model = made.build(gravity=(0, 0, 0))
    start, v0 = sd.neutral(model), np.array([1.0, 2.0, 3.0, 3.0, -2.0, 4.0])[: model.nv]
    lost = []
    for dt in (4e-3, 2e-3):
        q, v = start, v0
        for _ in range(round(0.5 / dt)):
            q, v = sd.step(model, q, v, np.zeros(model.nv), dt)
        lost.append(abs(sd.centroidal_momentum(model, q, v) - sd.centroidal_momentum(model, start, v0)).max())
    assert lost[0] / lost[1] == pytest.approx(4.0, rel=0.05)
    assert lost[1] <= 1e-4  # explicitly turned .03


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_the_derivative_of_a_step_of_a_free_body_has_what_keeps_its_momenta(kind: str) -> None:
    made = sd.ModelBuilder("body").add_body(
        "body", None, kind, inertia=(1.0, (0.1, 0.05, 0.2), np.diag([0.1, 0.2, 0.3]))
    )
    model, rng = made.build(), np.random.default_rng(0)
    n, h, e = model.nv, 0.05, 1e-6
    q, v, tau = sd.random_configuration(model, rng), 3.0 * rng.normal(size=n), rng.normal(size=n)
    found = sd.step_derivatives(model, q, v, tau, h).A
    d = e * np.eye(2 * n)
    ends = [sd.step(model, sd.integrate(model, q, s * d[:, :n]), v + s * d[:, n:], tau, h) for s in (-1, 1)]
    moved = np.hstack([sd.difference(model, ends[0][0], ends[1][0]), ends[1][1] - ends[0][1]])
    np.testing.assert_allclose(found, moved.T / (2 * e), rtol=0.0, atol=1e-8)


def test_energy_of_a_tumbling_body_is_kept_better_than_turned_explicitly() -> None:
    model = body()
    q, v = np.array([0, 0, 0, 0, 0, 0, 1.0]), np.array([1.0, 2.0, 3.0, 3.0, -2.0, 4.0])
    run = sd.simulate(model, q, v, 1.0, 1e-3, STEPPED)
    assert np.ptp(run.energy) <= 5e-3  # explicitly .097: ½ m h ω² v² a second more


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_all_ways_of_a_step_agree(kind: str) -> None:
    """One step by the call, by a program, and by calls of kernels."""
    made = sd.ModelBuilder("cart")
    made.add_body("hull", None, kind, (0, 0, 1), inertia=(2.0, (0.1, 0.05, 0.02), 0.05 * np.eye(3)))
    made.add_body("arm", "hull", "revolute", (0, 1, 0), (0.2, 0, 0), (0.5, (0.1, 0, 0.1), 0.01 * np.eye(3)))
    model, rng = made.build(), np.random.default_rng(0)
    q, v, tau = sd.random_configuration(model, rng), rng.normal(size=model.nv), rng.normal(size=model.nv)
    one = sd.step(model, q, v, tau, 0.01)
    found = [sd.simulate(model, q, v, 0.01, 0.01, STEPPED, tau)]
    found.append(sd.simulate(model, q, v, 0.01, 0.01, STEPPED, lambda t, q, v: tau))
    for run in found:
        np.testing.assert_allclose(run.q[-1], one[0], rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(run.v[-1], one[1], rtol=0.0, atol=1e-13)
    lanes = sd.rollout(model, np.tile(q, (9, 1)), v, np.broadcast_to(tau, (9, 1, model.nv)), dt=0.01)
    np.testing.assert_allclose(lanes.q[4, -1], one[0], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(lanes.v[4, -1], one[1], rtol=0.0, atol=1e-13)
