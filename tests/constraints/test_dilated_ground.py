"""Ground dilated by a sphere's radius: planes, bowls and hills by hand, ridges, and the period in a bowl."""

from __future__ import annotations

import numpy as np
import pytest
from dense import Array

import spatialdyn as sd
from spatialdyn.constraints.dilated_ground import dilated

G, R = 9.81, 1.5
SPACING = 0.05
X, Y = np.meshgrid(np.arange(-20, 21) * SPACING, np.arange(-20, 21) * SPACING, indexing="ij")
INSIDE = X**2 + Y**2 <= 0.09
SAMPLED = 2e-5  # [m] of heights 50 mm apart on a sphere of 1.5 m: its fourth derivatives


def bowl(radius: float) -> Array:
    """Heights of a sphere's inside, with its lowest point at 0."""
    return np.asarray(radius - np.sqrt(radius**2 - np.minimum(X**2 + Y**2, 0.9 * radius**2)))


@pytest.mark.parametrize("radius", [0.0, 0.02, 0.3])
def test_over_a_plane_it_is_the_plane_a_radius_away(radius: float) -> None:
    z = 0.2 * X + 0.1 * Y
    inside = slice(3, -3)  # at its rim the ground goes on level
    found = dilated(z, SPACING, radius) - (z + radius * np.sqrt(1.05))
    assert abs(found[inside, inside]).max() <= 1e-14


@pytest.mark.parametrize("radius", [0.02, 0.1, 0.8])
def test_over_a_bowl_or_a_hill_it_is_a_sphere_of_another_radius(radius: float) -> None:
    """The centre of a sphere inside one of 1.5 m is on one of 1.5 m less its radius; outside, more."""
    found = dilated(bowl(R), SPACING, radius)
    assert abs(found[INSIDE] - (R - np.sqrt((R - radius) ** 2 - (X**2 + Y**2)[INSIDE]))).max() <= SAMPLED
    hill = dilated(-bowl(R), SPACING, radius)
    assert abs(hill[INSIDE] - (np.sqrt((R + radius) ** 2 - (X**2 + Y**2)[INSIDE]) - R)).max() <= SAMPLED


def test_a_spike_holds_a_sphere_by_its_side() -> None:
    """Within a radius of the spike the sphere is on it, elsewhere on the ground."""
    z, radius = np.zeros((21, 21)), 0.16
    z[10, 10] = 0.1
    found, away = dilated(z, SPACING, radius), SPACING * np.hypot(*(np.indices(z.shape) - 10))
    least, most = (
        0.1 + np.sqrt(np.maximum(radius**2 - x**2, 0.0)) for x in (away, np.maximum(away - SPACING / 2, 0.0))
    )
    on = away < radius
    assert (found[on] >= np.maximum(least[on], radius) - 1e-12).all()
    assert (found[on] <= most[on] + 1e-12).all()
    np.testing.assert_allclose(found[away > 0.3], radius, rtol=0.0, atol=1e-12)


def test_each_point_has_the_ground_of_its_own_radius() -> None:
    made = sd.ModelBuilder("pair").add_body("a", None, "prismatic", (0, 0, 1), (0.21, 0.07, 0.0))
    made.add_body("b", None, "prismatic", (0, 0, 1), (0.21, 0.07, 0.0), (1.0, (0, 0, 0), np.eye(3)))
    model = made.build()
    ground = sd.Heightfield((0.2 * X + 0.1 * Y)[10:31, 10:31], SPACING, (-0.5, -0.5))
    contacts = sd.Contacts(model, {"a": 0.3, "b": 0.1}, terrain=ground)
    steep, level = np.sqrt(1.05), 0.2 * 0.21 + 0.1 * 0.07
    wanted = [(1.0 - level) / steep - 0.3, (2.0 - level) / steep - 0.1]
    np.testing.assert_allclose(sd.contact_gaps(model, contacts, [1.0, 2.0]), wanted, rtol=0.0, atol=1e-14)


def test_a_sphere_in_a_trough_swings_in_the_period_of_its_centre() -> None:
    """2π √((R - r) / g) (1 + θ²/16): over the slope below its centre it would be 2.6 % longer at r = R / 20."""
    radius, angle, spacing = 0.05 * R, 0.1, 5e-3
    made = sd.ModelBuilder("sphere")
    made.add_body("x", None, "prismatic", (1, 0, 0)).add_body("y", "x", "prismatic", (0, 1, 0))
    model = made.add_body("z", "y", "prismatic", (0, 0, 1), inertia=(1.0, (0, 0, 0), np.eye(3))).build()
    x = spacing * np.arange(-50, 51)
    trough = np.tile(R - np.sqrt(R**2 - x**2), (3, 1)).T
    ground = sd.Heightfield(trough, spacing, (x[0], -spacing))
    contacts = sd.Contacts(model, {"z": radius}, 0.0, terrain=ground)
    q = np.array([(R - radius) * np.sin(angle), 0.0, R])
    for _ in range(2):
        q[2] -= sd.contact_gaps(model, contacts, q)[0]
    period = 2.0 * np.pi * np.sqrt((R - radius) / G) * (1.0 + angle**2 / 16.0)
    run = sd.simulate(sd.Scene(model, contacts=contacts), q, np.zeros(3), 1.5 * period, 1e-3)
    x = run.q[:, 0]
    across = np.flatnonzero(x[:-1] * x[1:] <= 0.0)
    at = run.t[across] + 1e-3 * x[across] / (x[across] - x[across + 1])
    assert at[2] - at[0] == pytest.approx(period, rel=1e-3)
