"""Inverse kinematics of a grid of poses: where a UR5 can point its tool down, and in how many ways.

Learn    sd.solve_ik takes any batch of targets, keeps to the limits, restarts what is stuck, and says why it stopped;
         all_solutions=True returns the distinct arms of one pose.
Look at  the picture: a ring. Too far out the arm is stretched, too near its own axis it cannot fold; behind it, far
         from where searches begin, some need a second start. A pose inside has up to eight arms: shoulder left or
         right, elbow up or down, wrist flipped or not; each in several turns of its joints, which count once here.
Needs    pip install example-robot-data for the UR5
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

Array = np.ndarray
HEIGHT, WIDE = 0.2, 1.0
TOOL = "tool0"


def poses(n: int) -> Array:
    """(n, n, 4, 4) of a tool that points down, over a square at a height."""
    x = np.linspace(-WIDE, WIDE, n)
    made = np.zeros((n, n, 4, 4))
    made[...] = np.diag([1.0, -1.0, -1.0, 1.0])
    made[..., 0, 3], made[..., 1, 3] = np.meshgrid(x, x, indexing="ij")
    made[..., 2, 3] = HEIGHT
    return made


def arms(solutions: Array) -> int:
    """How many configurations (k, nq) differ by more than turns."""
    turned = np.exp(1j * solutions)
    return sum(all(abs(x - y).max() > 1e-3 for y in turned[:k]) for k, x in enumerate(turned))


def main(quick: bool = False, save: str | None = None) -> dict[str, Any]:
    """Print how many poses of the grid are reached, and the arms of one; returns the result, poses and arms."""
    model, grid = sd.load_urdf("ur5"), poses(16 if quick else 60)
    found = sd.solve_ik(model, {TOOL: grid}, restarts=20)
    out = np.linalg.norm(grid[..., :2, 3], axis=-1)
    good = found.converged
    print(f"{good.sum()} of {good.size} poses are reached, from {out[good].min():.2f} to {out[good].max():.2f} m")
    for why, count in zip(*np.unique(found.why, return_counts=True), strict=True):
        print(f"  {why}: {count}, of {found.starts[found.why == why].mean():.1f} starts on average")
    one = grid[0, 0].copy()
    one[:2, 3] = 0.5, 0.2
    several = sd.solve_ik(model, {TOOL: one}, all_solutions=True, restarts=60).solutions
    count = arms(several[0]) if several else 0
    print(f"a tool at (0.5, 0.2) m is held by {count} arms")
    if save:
        figure, axes = picture(width=5.6, height=4.6)
        steps = np.where(good, found.iterations, np.nan)
        drawn = axes.imshow(steps.T, origin="lower", extent=(-WIDE, WIDE, -WIDE, WIDE), vmax=60, zorder=2)
        axes.set(xlabel="x [m]", ylabel="y [m]", title="steps until a pose is reached; white: it is not")
        figure.colorbar(drawn, ax=axes)
        write(figure, save)
    return {"found": found, "poses": grid, "arms": count}


if __name__ == "__main__":
    start(main)
