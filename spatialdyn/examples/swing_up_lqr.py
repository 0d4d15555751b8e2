"""LQR along a swing-up: gains for each step of a motion, from the exact derivatives of its steps.

Learn    sd.step_derivatives takes the whole motion at once and gives A and B of every step, of the very method that
         simulates it; Riccati's recursion turns them into gains K(t). sd.step takes a hundred starts at once.
Look at  the last lines: pushed off its path the open loop ends anywhere, the gains bring nearly all starts up. At the
         top they have become those of the standing pole.
Needs    pip install scipy
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, picture, start, write
from spatialdyn.examples.ilqr import ilqr
from spatialdyn.examples.optimal_control import swing_up

Array = np.ndarray
STEP = 0.02
Q, R = np.diag([1.0, 1.0, 0.1, 0.1]) * STEP, 0.01 * STEP


def riccati(A: Array, B: Array, P: Array) -> tuple[Array, Array]:
    """Gains (T, 4) of steps x⁺ = A x + B u, whose last has the cost ½ xᵀ P x after it, and P before the first."""
    K = np.empty((len(A), 4))
    for t in range(len(A) - 1, -1, -1):
        PB = P @ B[t]
        K[t] = (PB @ A[t]) / (R + B[t] @ PB)
        P = Q + A[t].T @ P @ (A[t] - np.outer(B[t], K[t]))
        P = 0.5 * (P + P.T)
    return K, P


def main(quick: bool = False, save: str | None = None) -> dict[str, Any]:
    """Print how many starts end upright; returns gains, and the angles of all runs."""
    need("scipy", "simulation")
    problem, stay = swing_up(), 100
    model = problem.model
    x, u, costs, _ = ilqr(problem, np.zeros((100, 2)))
    x, force = np.vstack([x[:-1], np.zeros((stay + 1, 4))]), np.concatenate([u[:, 0], np.zeros(stay)])
    tau = np.stack([force, 0.0 * force], 1)
    A, B = sd.step_derivatives(model, x[:-1, :2].copy(), x[:-1, 2:].copy(), tau, STEP)
    A0, B0 = A[-1], B[-1, :, 0]
    top, P = riccati(np.broadcast_to(A0, (2000, 4, 4)), np.broadcast_to(B0, (2000, 4)), np.zeros((4, 4)))
    K, _ = riccati(A, B[..., 0], P)
    radius = abs(np.linalg.eigvals(A0 - np.outer(B0, top[0]))).max()
    print(f"cost of the swing {costs[-1]:.9f}; gains at the top {top[0].round(6)}, spectral radius {radius:.7f}")
    rng, n = np.random.default_rng(0), 20 if quick else 100
    off = rng.normal(size=(n, 4)) * [0.05, 0.1, 0.1, 0.2]
    runs: dict[str, Array] = {}
    for name, gain in (("open loop", 0.0 * K), ("with gains", K)):
        y, path = x[0] + off, [x[0] + off]
        for t in range(len(force)):
            push = force[t] - (y - x[t]) @ gain[t]
            q, v = sd.step(model, y[:, :2], y[:, 2:], np.stack([push, 0.0 * push], 1), STEP)
            y = np.hstack([q, v])
            path.append(y)
        runs[name] = np.array(path)
        up = (abs(y[:, 1]) < 0.05) & (abs(y[:, 3]) < 0.1)
        print(f"{name:10}: {up.sum():3} of {n} starts stand after {STEP * len(force):g} s")
    if save:
        figure, axes = picture(2, width=9.0)
        for one, (name, run) in zip(axes, runs.items(), strict=True):
            one.plot(STEP * np.arange(len(run)), run[:, :20, 1], linewidth=0.8)
            one.set(xlabel="t [s]", ylabel="angle of the pole [rad]", title=name, ylim=(-4, 8))
        write(figure, save)
    return {"K": K, "top": top[0], "radius": radius, "runs": runs, "cost": costs[-1]}


if __name__ == "__main__":
    start(main)
