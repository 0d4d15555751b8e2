"""LQR along a swing-up: gains for each step of a motion, from the exact derivatives of its steps.

Learn    sd.step_derivatives takes the whole motion at once and gives A and B of every step, of the very method that
         simulates it; Riccati's recursion turns them into gains K(t). sd.step takes a hundred starts at once.
         The motion itself is found the same way (iLQR): gains and a change of the force, tried at twelve sizes at once.
Look at  the last lines: pushed off its path the open loop ends anywhere, the gains bring nearly all starts up. At the
         top they have become those of the standing pole.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write
from spatialdyn.examples.optimal_control import Problem, cost_of, swing_up

Array = np.ndarray
STEP = 0.02
Q, R = np.diag([1.0, 1.0, 0.1, 0.1]) * STEP, 0.01 * STEP
SIZES = 0.5 ** np.arange(12.0)[:, None]
MOST = 1e3  # [N]: motions that are lost stay in the range of numbers


def swing(p: Problem, steps: int) -> tuple[Array, Array, list[float]]:
    """States (steps + 1, 4), forces (steps,) and costs of iLQR from no force at all, without limits."""
    x, u = np.tile(np.concatenate([p.q0, p.v0]), (steps + 1, 1)), np.zeros(steps)
    k, K, costs = np.zeros(steps), np.zeros((steps, 4)), [np.inf]
    while True:
        runs, pushes = drive(p.model, x, u, K, k * SIZES, np.tile(x[0], (len(SIZES), 1)))
        found = [cost_of(p, run, np.stack([push, 0.0 * push], 1))[0] for run, push in zip(runs, pushes, strict=True)]
        best = int(np.argmin(found))
        x, u = runs[best], pushes[best]
        costs.append(found[best])
        if not costs[-1] < costs[-2] * (1.0 - 1e-12):
            return x, u, costs[1:]
        A, B = sd.step_derivatives(p.model, x[:-1, :2].copy(), x[:-1, 2:].copy(), np.stack([u, 0.0 * u], 1), STEP)
        _, slope, P = p.final(x[-1])
        for t in range(steps - 1, -1, -1):
            b, PA = B[t, :, 0], P @ A[t]
            weight, by_u, both = R + b @ P @ b, R * u[t] + b @ slope, b @ PA
            k[t], K[t] = -by_u / weight, both / weight
            slope = Q @ x[t] + A[t].T @ slope + both * k[t]
            P = Q + A[t].T @ PA - np.outer(both, K[t])
            P = 0.5 * (P + P.T)


def drive(model: sd.Model, x: Array, u: Array, K: Array, more: Array, start: Array) -> tuple[Array, Array]:
    """Motions (n, T + 1, 4) from n states, and their forces (n, T): u + more - K (y - x)."""
    y, path, forces = start, [start], []
    for t in range(len(u)):
        push = (u[t] + more[:, t] - (y - x[t]) @ K[t]).clip(-MOST, MOST)
        q, v = sd.step(model, y[:, :2], y[:, 2:], np.stack([push, 0.0 * push], 1), STEP)
        y = np.hstack([q, v])
        path.append(y)
        forces.append(push)
    return np.stack(path, 1), np.stack(forces, 1)


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
    problem, stay = swing_up(), 100
    model = problem.model
    print("looking for the swing: some seconds", flush=True)
    x, u, costs = swing(problem, 100)
    x, force = np.vstack([x[:-1], np.zeros((stay + 1, 4))]), np.concatenate([u, np.zeros(stay)])
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
        paths, _ = drive(model, x, force, gain, np.zeros((n, len(force))), x[0] + off)
        runs[name], y = paths.transpose(1, 0, 2), paths[:, -1]
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
