"""Principles of mechanics as identities of calls: Euler-Poincaré, multipliers, and a sign that a text prints wrong.

Gauss's principle is in ``constraints/test_constrained_dynamics.py``; that tanh friction never sticks, and that gains of
10/dt explode, in ``simulation/test_friction_steps.py`` and ``test_constrained_runs.py``.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from dense import Array

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.examples import gallery

EPS = float(np.finfo(float).eps)
INERTIA = np.array([1.0, 2.0, 3.0])
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="heavy: thousands of steps of gauss6")


def crf(xi: Array) -> Array:
    """ξ ×* of a twist, linear first."""
    v, w = (np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) for x, y, z in (xi[:3], xi[3:]))
    return np.block([[w, np.zeros((3, 3))], [v, w]])


@pytest.fixture(scope="module")
def body() -> sd.Model:
    """One floating body, its centre of mass off its origin, without gravity."""
    made = sd.ModelBuilder("body")
    inertia = (2.0, (0.1, -0.2, 0.3), np.array([[0.3, 0.02, 0.01], [0.02, 0.4, -0.03], [0.01, -0.03, 0.5]]))
    return made.add_body("body", None, "floating", inertia=inertia).build(gravity=(0.0, 0.0, 0.0))


def test_rnea_of_one_floating_body_is_the_euler_poincare_equation(body: sd.Model) -> None:
    """I ξ̇ + ξ ×* I ξ = f for ℓ(ξ) = ½ ξᵀ I ξ, whatever the pose; ad* has the other sign: ad*_ξ = -ξ ×*."""
    rng = np.random.default_rng(0)
    q, (xi, rate) = sd.random_configuration(body, rng), rng.normal(size=(2, 6))
    I = sd.crba(body, q)
    f = sd.rnea(body, q, xi, rate)
    np.testing.assert_allclose(f, I @ rate + crf(xi) @ I @ xi, rtol=0.0, atol=100 * EPS)
    wrong = I @ rate - crf(xi) @ I @ xi
    assert abs(f - wrong).max() > 0.1


@compiled
def test_spatial_momentum_is_constant_in_a_free_motion(body: sd.Model) -> None:
    """Ad*_{g⁻¹} I ξ, the momentum in the world, and not with the other sign of d/dt(I ω) = ± ω × I ω."""
    q0, v0 = sd.neutral(body), np.array([0.3, -0.2, 0.1, 1.0, 2.0, -1.5])
    run = sd.simulate(body, q0, v0, 3.0, 0.01, "gauss6")
    X = np.asarray(sd.frame_placement(body, run.q, "body"))
    h = np.einsum("nij,nj->ni", sd.crba(body, run.q), run.v)
    force = np.einsum("nij,nj->ni", X[:, :3, :3], h[:, :3])
    moment = np.einsum("nij,nj->ni", X[:, :3, :3], h[:, 3:]) + np.cross(X[:, :3, 3], force)
    assert abs(force - force[0]).max() <= 1e3 * EPS
    assert abs(moment - moment[0]).max() <= 1e3 * EPS


def top() -> sd.Model:
    made = sd.ModelBuilder("top").add_body("body", None, "spherical", inertia=(1.0, (0, 0, 0), np.diag(INERTIA)))
    return made.build()


@compiled
def test_a_free_top_moves_by_jacobis_elliptic_functions() -> None:
    pytest.importorskip("scipy")
    example = gallery.module("spinning_top")
    v0 = np.array([1.0, 0.0, 0.6])
    energy, L = 0.5 * v0**2 @ INERTIA, float(np.linalg.norm(v0 * INERTIA))
    run = sd.simulate(top(), [0.0, 0.0, 0.0, 1.0], v0, 20.0, 0.01, "gauss6")
    np.testing.assert_allclose(run.v, example.closed_form(run.t, energy, L), rtol=0.0, atol=2e-13)
    assert abs(run.v - example.closed_form(-run.t, energy, L)).max() > 0.5  # d/dt(I ω) = ω × I ω is time turned round


def test_the_elliptic_functions_solve_eulers_equations() -> None:
    """The closed form itself, by differences: I ω̇ + ω × I ω = 0."""
    pytest.importorskip("scipy")
    example = gallery.module("spinning_top")
    t, h = np.linspace(0.0, 9.0, 40), 1e-4
    now, before, after = (example.closed_form(t + x, 1.04, math.sqrt(4.24)) for x in (0.0, -h, h))
    off = INERTIA * (after - before) / (2.0 * h) + np.cross(now, INERTIA * now)
    assert abs(off).max() < 1e-7


def test_a_multiplier_is_the_force_in_the_rod() -> None:
    """A particle on a rod of length l: the force of the distance is -(m l ω² + m g cos θ) along the rod."""
    made = sd.ModelBuilder("particle")
    made.add_body("x", None, "prismatic", (1, 0, 0), inertia=(0.0, (0, 0, 0), np.zeros((3, 3))))
    made.add_body("m", "x", "prismatic", (0, 0, 1), inertia=(2.0, (0, 0, 0), np.zeros((3, 3))))
    model, l, theta, rate = made.build(), 0.7, 0.4, 1.5
    q = np.array([l * math.sin(theta), -l * math.cos(theta)])
    v = l * rate * np.array([math.cos(theta), math.sin(theta)])
    held = sd.Constraints(model, [sd.DistanceConstraint("m", length=l)])
    found = sd.constrained_dynamics(model, held, q, v, [0.0, 0.0])
    J = sd.constraint_jacobian(model, held, q)
    tension = 2.0 * (l * rate**2 + 9.81 * math.cos(theta))
    np.testing.assert_allclose(J.T @ found.force, -tension * q / l, atol=100 * EPS * tension)
    # the rod cut, and its force as a torque: the same motion
    np.testing.assert_allclose(sd.aba(model, q, v, J.T @ found.force), found.a, atol=100 * EPS * tension)


def test_a_multiplier_is_what_a_change_of_the_constraint_costs() -> None:
    """λ = ∂V/∂c of equilibria with φ = c (of either sign of φ): the potential of a hanging arm whose tip is moved."""
    model = sd.load_urdf("two_link")

    def at(c: float) -> tuple[Array, sd.Constraints]:
        held = sd.Constraints(model, [sd.PointConstraint("tip", axes="x", at_b=(c, 0.0, 0.0))])
        q = np.array([-1.2, 0.7])
        for _ in range(60):  # Newton on ∇V = Jᵀ λ, φ = 0
            g, J = sd.generalized_gravity(model, q), sd.constraint_jacobian(model, held, q)
            phi = sd.constraint_error(model, held, q)
            lam = np.linalg.lstsq(J.T, g, rcond=None)[0]
            off = [
                (sd.generalized_gravity(model, x) - sd.constraint_jacobian(model, held, x).T @ lam)
                for e in np.eye(2) for x in (q + 1e-6 * e, q - 1e-6 * e)
            ]  # fmt: skip
            H = np.stack([(off[0] - off[1]) / 2e-6, (off[2] - off[3]) / 2e-6], 1)
            K = np.block([[H, -J.T], [J, np.zeros((1, 1))]])
            q = q - np.linalg.solve(K, np.concatenate([g - J.T @ lam, phi]))[:2]
        return q, held

    c, h = 0.5, 1e-4
    q, held = at(c)
    force = sd.constrained_dynamics(model, held, q, [0.0, 0.0], [0.0, 0.0])
    assert abs(force.a).max() < 1e-9  # an equilibrium
    slope = (sd.potential_energy(model, at(c + h)[0]) - sd.potential_energy(model, at(c - h)[0])) / (2.0 * h)
    J = sd.constraint_jacobian(model, held, q)
    moved = (sd.constraint_error(model, at(c + h)[1], q) - sd.constraint_error(model, at(c - h)[1], q))[0] / (2.0 * h)
    assert slope == pytest.approx(-force.force[0] * moved, rel=1e-6)
    np.testing.assert_allclose(J.T @ force.force, sd.generalized_gravity(model, q), atol=1e-9)
