"""Chaplygin's sleigh and a rolling disc: constraints on velocities that no constraint on positions replaces.

Learn    VelocityConstraint, RollingConstraint, simulate(constraints=...), project_velocity.
Look at  the sleigh, which turns ever more slowly until it glides straight on, its centre of mass ahead of its blade: it
         keeps its energy and has a direction of time nonetheless, as no motion under constraints on positions has. The
         disc rolls upright above √(g / 3 r) and falls over below.
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write


def main(save: str | None = None) -> dict[str, float]:
    """Print both motions beside their closed forms; returns the differences and the disc's largest leans."""
    m, I, a, u0, w0 = 2.0, 0.3, 0.4, 0.5, 2.0  # mass, inertia about it, its distance from the blade, first speeds
    made = sd.ModelBuilder("sleigh")
    made.add_body("sleigh", None, "planar", (0, 0, 1), inertia=(m, (a, 0, 0), np.diag([0.1, 0.2, I])))
    sleigh = made.build()
    blade = sd.Constraints(sleigh, [sd.VelocityConstraint([0, 1, 0], name="blade")])  # v is (vx, vy, ω) of the sleigh
    run = sd.simulate(sd.Scene(sleigh, constraints=blade), np.zeros(3), [u0, 0, w0], 2.0, 1e-3)
    k = np.sqrt((I + m * a * a) / m)
    V = np.hypot(u0, k * w0)
    phase = a * V * run.t / k**2 + np.arctanh(u0 / V)
    u, w = V * np.tanh(phase), V / k / np.cosh(phase)
    sleigh_off = float(max(abs(run.v[:, 0] - u).max(), abs(run.v[:, 2] - w).max(), abs(run.v[:, 1]).max()))
    print(f"sleigh: from {u0} m/s and {w0} rad/s to {run.v[-1, 0]:.10f} m/s and {run.v[-1, 2]:.10f} rad/s in 2 s")
    print(f"off u = V tanh and ω = V/k sech by at most {sleigh_off:.1e}; energy within {np.ptp(run.energy):.1e} J")

    r = 0.1
    made = sd.ModelBuilder("disc")
    made.add_body("disc", None, "floating", inertia=(1.0, (0, 0, 0), 0.25 * r**2 * np.diag([1, 2, 1])))
    disc = made.build()
    ground = sd.Constraints(disc, [sd.RollingConstraint("disc", (0, 1, 0), r)])
    critical, leans = np.sqrt(9.81 / (3 * r)), {}
    for share in (0.95, 1.05):
        lean = 1e-4  # [rad] at the beginning
        q = np.array([0, 0, r * np.cos(lean), np.sin(lean / 2), 0, 0, np.cos(lean / 2)])
        rate = share * critical
        v = np.array([r * rate, 0, 0, 0, rate, 0])
        roll = sd.simulate(sd.Scene(disc, constraints=ground), q, sd.project_velocity(disc, ground, q, v), 3.0, 1e-3)
        tilt = np.arcsin(sd.frame_placement(disc, roll.q, "disc")[:, 2, 1])
        leans[share] = abs(tilt).max(), roll.t, tilt
        print(f"disc at {share} of {critical:.6f} rad/s: leans by at most {abs(tilt).max():.4f} rad in 3 s")
    if save:
        figure, axes = picture(2, width=10.0)
        axes[0].plot(run.q[:, 0], run.q[:, 1])
        axes[0].set(xlabel="x [m]", ylabel="y [m]", title="the sleigh's blade", aspect="equal")
        for share, (_, t, tilt) in leans.items():
            axes[1].plot(t, tilt, label=f"{share} of the critical rate")
        axes[1].set(xlabel="t [s]", ylabel="lean [rad]", title="the disc")
        axes[1].legend()
        write(figure, save)
    slow, fast = (float(leans[share][0]) for share in (0.95, 1.05))
    return {"u": run.v[-1, 0], "w": run.v[-1, 2], "sleigh": sleigh_off, "slow": slow, "fast": fast}


if __name__ == "__main__":
    start(main)
