"""Inverse kinematics by damped least squares: joint angles for a pose of the hand, also where none exists.

Learn    frame_placement and frame_jacobian in a loop: δq = Jᵀ (J Jᵀ + λ² 1)⁻¹ e. λ is a length: what counts as far.
Look at  the target out of reach. Without damping, or with little, joints jump by many turns where the arm is stretched
         and J loses rank; λ = 0.5, of the size of what is missing, stretches the arm and stops at the least error: the
         last column, Jᵀ e, is its slope. The price: many more steps where it is easy.
Needs    pip install example-robot-data for the Panda
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

Array = np.ndarray
START = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.7, 0.8, 0.0, 0.0])


def pose_error(X: Array, target: Array) -> Array:
    """From pose X to the target, in the world's axes: the way [m], then the rotation, sin(angle) times its axis."""
    R = target[:3, :3] @ X[:3, :3].T
    turn = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return np.concatenate([target[:3, 3] - X[:3, 3], turn])


def solve(model: sd.Model, frame: str, target: Array, damping: float, steps: int = 400) -> tuple[Array, ...]:
    """Joint positions, the norm of the error at every step, the largest step of a joint [rad], and Jᵀ e."""
    q, errors, largest = START.copy(), [], 0.0
    for _ in range(steps):
        J = sd.frame_jacobian(model, q, frame, reference="local_world_aligned")
        e = pose_error(sd.frame_placement(model, q, frame), target)
        errors.append(float(np.linalg.norm(e)))
        if errors[-1] < 1e-12:
            break
        dq = J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(6), e)
        largest = max(largest, float(abs(dq).max()))
        q = sd.integrate(model, q, dq)  # q + dq here; right for a floating base too
    return q, np.array(errors), np.array(largest), J.T @ e


def main(save: str | None = None) -> dict[str, tuple[Array, ...]]:
    """Print a row for every target and damping; returns what ``solve`` found for each."""
    model, frame, found = sd.load_urdf("panda"), "panda_link8", {}
    near = sd.frame_placement(model, START + 0.3, frame)
    targets = {"within reach": near, "1.5 m away": near.copy()}
    targets["1.5 m away"][:3, 3] = [1.5, 0.0, 0.5]
    print(f"{'target':14} {'damping':>8} {'steps':>6} {'error left':>11} {'largest step [rad]':>19} {'|Jᵀ e|':>9}")
    for name, target in targets.items():
        for damping in (0.0, 0.05, 0.5):
            found[f"{name}, λ = {damping:g}"] = _, errors, largest, slope = solve(model, frame, target, damping)
            print(f"{name:14} {damping:8g} {len(errors):6} {errors[-1]:11.1e} {largest:19.2g} {abs(slope).max():9.1e}")
    if save:
        figure, axes = picture()
        for name, (_, errors, *_) in found.items():
            axes.semilogy(errors, label=name, linestyle="-" if "within" in name else "--")
        axes.set(xlabel="step", ylabel="error [m, rad]", ylim=(1e-13, 1e2), xlim=(0, 100))
        figure.legend(loc="outside right upper")
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
