"""A knife edge on an incline: of two mechanics of velocity constraints, experiments agree with d'Alembert's.

Learn    VelocityConstraint; to constrain a motion is not to constrain the motions that it is compared with.
Look at  where each lets the spinning blade go. By d'Alembert and Lagrange, as in this library, constraint forces do no
         work in allowed displacements, and the blade stays up: it drifts across the slope in loops of one height.
         Hamilton's principle among motions that meet the constraint ("vakonomic") lets the same blade run downhill;
         it is right for a boat's optimal course, not for a wheel. Its multiplier has a first value to choose, here 0.
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

I, PULL, SPIN = 0.3, 9.81 * np.sin(0.3), 2.0  # inertia [kg m²] of 1 kg, gravity down the slope, first rate [rad/s]


def vakonomic(duration: float, steps: int) -> np.ndarray:
    """(x, y, θ) of the variational motion, by Runge and Kutta's method of order 4.

    L + μ (ẋ sin θ - ẏ cos θ) has p_x = ẋ + μ sin θ, which grows by the pull alone, p_y = ẏ - μ cos θ, which is kept,
    and I θ̈ = μ u with the speed u along the blade.
    """

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        c, s = np.cos(z[2]), np.sin(z[2])
        px, py = PULL * t, 0.0
        u, mu = px * c + py * s, px * s - py * c
        return np.array([u * c, u * s, z[3], mu * u / I])

    h, z = duration / steps, np.array([0.0, 0.0, 0.0, SPIN])
    found = [z]
    for k in range(steps):
        t = k * h
        a = rate(t, z)
        b = rate(t + h / 2, z + h / 2 * a)
        c = rate(t + h / 2, z + h / 2 * b)
        z = z + h / 6 * (a + 2 * b + 2 * c + rate(t + h, z + h * c))
        found.append(z)
    return np.array(found)[:, :3]


def main(save: str | None = None) -> dict[str, float]:
    """Print how far both go downhill; returns that, and how far the library's motion is off its closed form."""
    made = sd.ModelBuilder("knife")
    made.add_body("blade", None, "planar", (0, 0, 1), inertia=(1.0, (0, 0, 0), np.diag([0.1, 0.2, I])))
    model = made.build(gravity=(PULL, 0, -9.81 * np.cos(0.3)))  # x is downhill
    edge = sd.Constraints(model, [sd.VelocityConstraint([0, 1, 0], name="edge")])
    run = sd.simulate(sd.Scene(model, constraints=edge), np.zeros(3), [0, 0, SPIN], 6.0, 1e-3)
    c, angle = PULL / (2 * SPIN**2), SPIN * run.t
    closed = np.stack([c * np.sin(angle) ** 2, c * (angle - 0.5 * np.sin(2 * angle)), angle], axis=1)
    off = float(abs(run.q - closed).max())
    other = vakonomic(6.0, 6000)
    down, slid = float(run.q[:, 0].max()), float(other[:, 0].max())
    print(f"d'Alembert and Lagrange: at most {down:.4f} m downhill in 6 s, {run.q[-1, 1]:.4f} m across")
    print(f"off x = g sin β / (2 ω²) sin² ωt and its kin by at most {off:.1e}")
    print(f"a variation among allowed motions: {slid:.1f} m downhill")
    if save:
        figure, axes = picture()
        axes.plot(run.q[:, 1], -run.q[:, 0], label="d'Alembert and Lagrange")
        axes.plot(other[:1500, 1], -other[:1500, 0], label="vakonomic, 1.5 s")
        axes.set(xlabel="across [m]", ylabel="up the slope [m]", title="a knife edge on an incline")
        axes.legend()
        write(figure, save)
    return {"off": off, "down": down, "slid": slid, "across": float(run.q[-1, 1])}


if __name__ == "__main__":
    start(main)
