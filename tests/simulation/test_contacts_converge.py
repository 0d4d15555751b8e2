"""Contacts are solved to their tolerance: dropped boxes, pushed stances, inclines on which a box just sticks."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from grounded import G, box, hold, quadruped, stance

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels

compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="heavy: thousands of steps")
fused = pytest.mark.skipif(numba_kernels.PLAIN, reason="a residual of products that are not fused ends 1e-10 higher")
SOLVED = 1e-6  # [m/s], the tolerance of contacts if none is given
SHARE = 0.995  # of steps that reach it, of 1600: one box of eight corners may miss it in a few
JAMMED = 3  # of 1000 states, where 2 are not solved; 8 were before
ABORT = 1e-2  # [m/s] above which a run ends


def corners_of_a_box(corners: int) -> sd.Model:
    """A box with its corners, the lower ones or all."""
    x, y, z = 0.4, 0.3, 0.2
    made = sd.ModelBuilder("box")
    made.add_body(
        "box", None, "floating", inertia=(1.0, (0, 0, 0), np.diag([y * y + z * z, x * x + z * z, x * x + y * y]) / 12)
    )
    places = [s for s in itertools.product((-0.5, 0.5), repeat=3) if corners == 8 or s[2] < 0.0]
    for k, (a, b, c) in enumerate(places):
        made.add_body(f"c{k}", "box", "fixed", placement=(a * x, b * y, c * z))
    return made.build()


def dropped(corners: int, mu: float, e: float, n: int, steps: int) -> np.ndarray:
    """Residuals of boxes dropped on their edges and corners, turning."""
    rng, model = np.random.default_rng(corners + round(10 * mu)), corners_of_a_box(corners)
    contacts = sd.Contacts(model, {f"c{k}": 0.0 for k in range(corners)}, friction=mu, restitution=e)
    turns = rng.standard_normal((n, 4))
    q = np.c_[np.zeros((n, 3)), turns / np.linalg.norm(turns, axis=1, keepdims=True)]
    q[:, 2] -= sd.contact_gaps(model, contacts, q).min(axis=1) - 0.05
    v = rng.standard_normal((n, 6)) * np.array([1, 1, 1, 3, 3, 3])
    run = sd.rollout(sd.Scene(model, contacts=contacts), q, v, dt=2e-3, steps=steps, record="contacts", check=False)
    assert run.contacts is not None
    assert np.isfinite(run.q).all()
    return run.contacts.residual


@compiled
@pytest.mark.parametrize("corners", [4, 8])
def test_dropped_boxes_are_solved(corners: int) -> None:
    residual = np.concatenate([dropped(corners, mu, e, 8, 200) for mu, e in ((0.3, 0.0), (0.8, 0.5))])
    assert residual.max() <= ABORT
    assert (residual <= SOLVED).mean() >= SHARE


@compiled
def test_a_stance_that_is_pushed_is_solved() -> None:
    """σ .3 m/s and .4 rad/s of the trunk, where friction nearly jams the feet."""
    model, feet = quadruped()
    contacts, rng = sd.Contacts(model, feet, friction=0.8), np.random.default_rng(3)
    q, v = stance(model, contacts), np.zeros((16, 18))
    v[:, :6] = rng.standard_normal((16, 6)) * np.array([0.3] * 3 + [0.4] * 3)
    run = sd.rollout(
        sd.Scene(model, contacts=contacts), q, v, dt=2e-3, steps=200, control=hold(model, q), record="contacts"
    )
    assert run.contacts is not None
    assert run.contacts.residual.max() <= SOLVED


@compiled
@pytest.mark.parametrize("slope", [0.3, 0.6])
def test_a_box_that_just_sticks_does_not_creep(slope: float) -> None:
    """With μ of 1.01 tan α: below 1 µm/s at 1e-6, below .01 µm/s at 1e-8."""
    model, corners = box(slope)
    for tolerance, creep in ((1e-6, 1e-6), (1e-8, 1e-8)):
        mu = 1.01 * math.tan(slope)
        contacts = sd.Contacts(model, dict.fromkeys(corners, 0.0), friction=mu, tolerance=tolerance)
        q = sd.neutral(model)
        q[2] -= sd.contact_gaps(model, contacts, q).min()
        run = sd.rollout(sd.Scene(model, contacts=contacts), q, np.zeros(6), dt=1e-3, steps=300)
        assert abs(run.v[150:, :3]).max() <= creep


@pytest.mark.parametrize("kg", [1e4, pytest.param(1e8, marks=fused)])
def test_a_heavy_trunk_is_held_by_the_dry_joints_of_a_light_leg(kg: float) -> None:
    """Joints of 1 g m² that hold up to 1e8 kg, from no impulse at first."""
    made = sd.ModelBuilder("hopper").add_body("x", None, "prismatic", (1, 0, 0))
    made.add_body("z", "x", "prismatic", (0, 0, 1), inertia=(kg, (0, 0, 0), kg * np.eye(3)))
    made.add_body("thigh", "z", "revolute", (0, 1, 0), inertia=(0.6, (0, 0, -0.1), 4e-3 * np.eye(3)))
    made.add_body("shank", "thigh", "revolute", (0, 1, 0), (0, 0, -0.25), (0.15, (0, 0, -0.1), 1e-3 * np.eye(3)))
    model = made.add_body("foot", "shank", "fixed", placement=(0, 0, -0.25)).build()
    contacts = sd.Contacts(model, {"foot": 0.0}, friction=0.8)
    q = np.array([0.0, 0.0, 0.7, -1.4])
    q[1] -= sd.contact_gaps(model, contacts, q).min()
    dry = sd.Friction(0.2 * G * kg * np.array([0, 0, 1, 1]), 0.0)
    scene = sd.Scene(model, contacts=contacts, friction=dry)
    run = sd.rollout(scene, q, np.zeros(4), dt=2e-3, steps=20, record="contacts")
    assert run.contacts is not None
    assert run.contacts.residual.max() <= SOLVED
    assert abs(run.v).max() <= 10 * SOLVED  # of several rows


def test_a_box_whose_corners_cannot_all_stick_is_solved() -> None:
    """It turns onto its side: what four corners move along the ground is not 0 at once, and μ of 1.5 holds each."""
    model = corners_of_a_box(8)
    contacts = sd.Contacts(model, {f"c{k}": 0.0 for k in range(8)}, friction=1.5)
    q = np.array([0.092862, 0.09505, 0.101521, -0.000208, -0.003787, -0.054096, 0.998529])
    q[3:] /= np.linalg.norm(q[3:])
    v = np.array([0.600573, 0.002699, -1.133817, 0.190687, 5.541135, 0.120914])
    assert sd.contact_step(model, contacts, q, v, np.zeros(6), 2e-3).residual <= SOLVED


@compiled
def test_feet_on_legs_that_stop_jam_rarely() -> None:
    """Where a foot slides and its leg is rigid at its limits, an impulse may push it into the ground: it sticks."""
    model, feet = quadruped(limits=0.1)
    contacts, rng, n = sd.Contacts(model, feet, friction=0.8), np.random.default_rng(5), 1000
    q, v, tau = np.tile(stance(model, contacts), (n, 1)), np.zeros((n, 18)), np.zeros((n, 18))
    legs = np.array([joint.idx_q for joint in model.joints[2:] if "hip" not in joint.name])
    side = rng.choice([-1, 0, 1], (n, len(legs)))
    q[:, legs] += 0.1 * side
    q[:, 2] -= sd.contact_gaps(model, contacts, q).min(axis=1)
    v[:, :6] = rng.standard_normal((n, 6)) * np.array([0.3] * 3 + [0.4] * 3)
    tau[:, legs - 1] = 8.0 * side + 2.0 * rng.standard_normal((n, len(legs)))
    residual = sd.contact_step(model, contacts.with_limits(), q, v, tau, 2e-3).residual
    assert (residual > SOLVED).sum() <= JAMMED
