"""Restitution by Poisson's law: no hit makes energy, and a frictionless one rebounds with e."""

from __future__ import annotations

import numpy as np
import pytest

import spatialdyn as sd

H = 1e-10  # [s] a step in which nothing but a hit happens
SOLVED = 1e-8  # [m/s]
GAIN = 1e-7  # of the energy before: what SOLVED leaves of a slow body's, and what turning does in such a step


def body(points: np.ndarray, inertia: np.ndarray) -> sd.Model:
    """A body of 1 kg with points, in no field."""
    made = sd.ModelBuilder("body")
    made.add_body("body", None, "floating", inertia=(1.0, (0, 0, 0), inertia))
    for k, at in enumerate(points):
        made.add_body(f"p{k}", "body", "fixed", placement=tuple(at))
    return made.build(gravity=(0.0, 0.0, 0.0))


def hits(n: int, count: int, mu: float, e: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Energy before and after random hits of a body on one point, or on the corners of its side; those solved."""
    rng = np.random.default_rng(seed)
    J = np.diag(rng.uniform(0.02, 0.04, 3))  # corners throw each other down, as those of a plate do
    corners = np.array([[x, y, -0.2] for x in (-0.3, 0.3) for y in (-0.2, 0.2)])
    model = body(corners[:count] if count > 1 else 0.25 * rng.standard_normal((1, 3)), J)
    contacts = sd.Contacts(
        model, {f"p{k}": 0.0 for k in range(count)}, friction=mu, restitution=e, tolerance=SOLVED,
    )  # fmt: skip
    q = np.tile(sd.neutral(model), (n, 1))
    q[:, 2] -= sd.contact_gaps(model, contacts, q).min(axis=1)
    v = rng.standard_normal((n, 6)) * np.array([1, 1, 1, 3, 3, 3])
    v[:, 2] -= 1.0
    step = sd.contact_step(model, contacts, q, v, np.zeros((n, 6)), H)
    solved = step.residual <= SOLVED
    return sd.kinetic_energy(model, q, v)[solved], sd.kinetic_energy(model, q, step.v)[solved]


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("mu", [0.0, 0.3, 0.8, 1.5])
def test_no_hit_makes_energy(count: int, mu: float) -> None:
    for e in (0.3, 0.8, 1.0):
        before, after = hits(200, count, mu, e, round(10 * mu))
        assert len(before) >= 190
        assert (after - before <= GAIN * before).all()
        assert (after < before).any() or mu == 0.0


def test_without_friction_and_loss_a_hit_conserves_energy() -> None:
    for count in (1, 4):
        before, after = hits(200, count, 0.0, 1.0, 7)
        np.testing.assert_allclose(after, before, rtol=GAIN)


@pytest.mark.parametrize("e", [0.2, 0.5, 1.0])
def test_a_frictionless_point_rebounds_with_its_restitution(e: float) -> None:
    rng = np.random.default_rng(2)
    at = np.array([0.1, -0.2, -0.15])
    model = body(at[None], np.diag([0.02, 0.03, 0.04]))
    contacts = sd.Contacts(model, {"p0": 0.0}, friction=0.0, restitution=e, terrain=sd.Plane(height=-0.15))
    for _ in range(10):
        v = rng.standard_normal(6)
        J = sd.frame_jacobian(model, sd.neutral(model), "p0", "local_world_aligned")[2]
        v[2] -= 1.0 + J @ v + 0.1
        step = sd.contact_step(model, contacts, sd.neutral(model), v, np.zeros(6), H)
        assert J @ v < -1e-2
        assert J @ step.v == pytest.approx(-e * (J @ v), rel=GAIN)
