"""A loop of your own in @njit: when does a double pendulum first flip over? A map of many starts.

Learn    sd.kernels.aba(model.bodies, q, v, tau, a) is called from compiled code: no Python between two steps, results
         written in place. model.bodies is one array that holds the whole robot.
Look at  the picture. Starts at rest in the lens 2 cos θ1 + cos θ2 > 1 have too little energy to carry the second arm
         over the top: they stay dark, in the simulation as on paper. Next to it, order ends: neighbours differ. (With
         semi-implicit Euler in place of RK4 some of the lens lights up: the energy is not kept well enough.)
"""

from __future__ import annotations

import numba
import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

aba = sd.kernels.aba


@numba.njit(error_model="numpy")
def first_flips(bodies, starts, dt, steps, flips):  # type: ignore[no-untyped-def]
    """Time at which the second arm first points straight up, for each start (n, 2) of angles from hanging; or NaN."""
    q, v, tau, ahead = np.empty(2), np.empty(2), np.zeros(2), np.array([0.0, 0.5 * dt, 0.5 * dt, dt])
    dq, dv = np.zeros((5, 2)), np.zeros((5, 2))  # RK4's slopes of q and v, the first row zero
    for n in range(len(starts)):
        q[0] = starts[n, 0] - 0.5 * np.pi  # the model counts q1 from the horizontal, q2 from the first arm
        q[1] = starts[n, 1] - starts[n, 0]
        v[:] = 0.0
        flips[n] = np.nan
        at = q.copy()
        for step in range(steps):
            for s in range(4):
                for i in range(2):
                    at[i] = q[i] + ahead[s] * dq[s, i]
                    dq[s + 1, i] = v[i] + ahead[s] * dv[s, i]
                aba(bodies, at, dq[s + 1], tau, dv[s + 1])
            for i in range(2):
                q[i] += dt / 6.0 * (dq[1, i] + 2.0 * (dq[2, i] + dq[3, i]) + dq[4, i])
                v[i] += dt / 6.0 * (dv[1, i] + 2.0 * (dv[2, i] + dv[3, i]) + dv[4, i])
            if abs(q[0] + q[1] + 0.5 * np.pi) > np.pi:
                flips[n] = (step + 1) * dt
                break


def main(quick: bool = False, save: str | None = None) -> dict[str, np.ndarray]:
    """Simulate a grid of starts and print how many flip; returns the grid and the times."""
    model, n, dt = sd.load_urdf("two_link"), 24 if quick else 56, 0.02
    angle = np.pi * (2.0 * (np.arange(n) + 0.5) / n - 1.0)  # middles of n cells: the picture's pixels
    starts = np.stack(np.meshgrid(angle, angle), -1).reshape(-1, 2)
    flips = np.empty(len(starts))
    print("compiling the loop, which a process does once: some 10 s", flush=True)
    first_flips(model.bodies, starts, dt, 250 if quick else 750, flips)
    lens = 2 * np.cos(starts[:, 0]) + np.cos(starts[:, 1]) > 1.0
    print(f"{len(starts)} starts at rest: {np.isfinite(flips).mean():.1%} flip; of {lens.sum()} that have too little")
    print(f"energy, 2 cos θ1 + cos θ2 > 1, {np.isfinite(flips[lens]).sum()} flip")
    if save:
        figure, axes = picture(height=6.0)
        times = axes.imshow(flips.reshape(n, n), origin="lower", extent=(-np.pi, np.pi) * 2, cmap="plasma_r")
        axes.set_facecolor("black")  # no flip
        axes.grid(False)
        axes.contour(angle, angle, (2 * np.cos(angle) + np.cos(angle)[:, None]), [1.0], colors="w", linewidths=0.8)
        axes.set(
            xlabel="θ1 at the start [rad]",
            ylabel="θ2 at the start [rad]",
            title="first flip of the second arm; black: none",
        )
        figure.colorbar(times, label="t [s]")
        write(figure, save)
    return {"starts": starts, "flips": flips, "lens": lens}


if __name__ == "__main__":
    start(main)
