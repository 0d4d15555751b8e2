"""Principles of mechanics as numbers: Euler-Poincaré, Lagrange's multipliers, Gauss's least constraint, d'Alembert.

Learn    which call is which principle: rnea of one floating body, the force of constrained_dynamics, delassus.
Look at  the differences, all of them rounding. The multiplier of a distance is the force in its rod: cut the rod and
         apply Jᵀ λ as a torque, and the motion is the same. Gauss: of all accelerations that the constraints allow the
         true one is nearest to the free one in the metric of M, and how far that is J, γ and G say beforehand. An ideal
         constraint does no work: λᵀ J v = 0.
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import start

Array = np.ndarray


def cross(x: Array) -> Array:
    """The matrix of x ×."""
    return -np.cross(np.eye(3), x).T


def euler_poincare(rng: np.random.Generator) -> float:
    """I ξ̇ + ξ ×* I ξ against rnea of a floating body without gravity, in any pose; ξ is linear first."""
    made = sd.ModelBuilder("body")
    made.add_body("body", None, "floating", inertia=(2.0, (0.1, -0.2, 0.3), np.diag([0.3, 0.4, 0.5])))
    model = made.build(gravity=(0.0, 0.0, 0.0))
    q, (xi, rate) = sd.random_configuration(model, rng), rng.normal(size=(2, 6))
    I, v, w = sd.crba(model, q), cross(xi[:3]), cross(xi[3:])
    force = I @ rate + np.block([[w, np.zeros((3, 3))], [v, w]]) @ I @ xi
    return float(abs(sd.rnea(model, q, xi, rate) - force).max())


def main() -> dict[str, float]:
    """Print how far both sides of each principle differ; returns it by name."""
    rng = np.random.default_rng(0)
    found = {"Euler-Poincaré: I ξ̇ + ξ ×* I ξ = rnea": euler_poincare(rng)}
    model = sd.load_urdf("three_link")
    held = sd.Constraints(model, [sd.DistanceConstraint("link3", length=1.2, at_b=(0.3, 0.0, 1.0))])
    q = sd.close_loops(model, held, [0.4, 0.8, -0.5])
    v, tau = sd.project_velocity(model, held, q, rng.normal(size=3)), rng.normal(size=3)
    a, force, _, _ = sd.constrained_dynamics(model, held, q, v, tau)
    J, gamma = sd.constraint_jacobian(model, held, q), sd.constraint_drift(model, held, q, v)
    free, M = sd.aba(model, q, v, tau), sd.crba(model, q)
    cut = sd.aba(model, q, v, tau + J.T @ force)
    found["Lagrange: a = aba(tau + Jᵀ λ)"] = float(abs(cut - a).max())
    off = J @ free + gamma
    least = 0.5 * off @ np.linalg.solve(sd.delassus(model, held, q), off)
    found["Gauss: ½ |a - a_free|²_M = ½ (J a_free + γ)ᵀ G⁻¹ (J a_free + γ)"] = float(
        abs(0.5 * (a - free) @ M @ (a - free) - least)
    )
    other = a + 0.1 * np.linalg.svd(J)[2][1]  # along the constraint
    found["Gauss: another a that it allows is no farther"] = max(
        0.0, float(least - 0.5 * (other - free) @ M @ (other - free))
    )
    found["d'Alembert: λᵀ J v"] = float(abs(force @ J @ v))
    for name, x in found.items():
        print(f"{name:66} {x:8.1e}")
    return found


if __name__ == "__main__":
    start(main)
