"""Contacts are solved to their tolerance: dropped boxes, pushed stances, inclines on which a box just sticks."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from grounded import box, hold, quadruped, stance

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels

compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="heavy: thousands of steps")
SOLVED = 1e-6  # [m/s], the tolerance of contacts if none is given
SHARE = 0.995  # of steps that reach it, of 1600: one box of eight corners may miss it in a few
ABORT = 1e-2  # [m/s] above which a run ends


def dropped(corners: int, mu: float, e: float, n: int, steps: int) -> np.ndarray:
    """Residuals of boxes dropped on their edges and corners, turning."""
    rng = np.random.default_rng(corners + round(10 * mu))
    x, y, z = 0.4, 0.3, 0.2
    made = sd.ModelBuilder("box")
    made.add_body(
        "box", None, "floating", inertia=(1.0, (0, 0, 0), np.diag([y * y + z * z, x * x + z * z, x * x + y * y]) / 12)
    )
    places = [s for s in itertools.product((-0.5, 0.5), repeat=3) if corners == 8 or s[2] < 0.0]
    for k, (a, b, c) in enumerate(places):
        made.add_body(f"c{k}", "box", "fixed", placement=(a * x, b * y, c * z))
    model = made.build()
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
