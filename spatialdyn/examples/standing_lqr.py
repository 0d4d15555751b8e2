"""A quadruped that stands by LQR: its stance linearized through the contacts of its feet, and a push.

Learn    sd.linearize of a step with contacts, and which feet stick; the linear system on the motions that keep the feet
         in place, which are the 6 of the trunk; sd.lqr of a step; StateFeedback with external forces.
Look at  the eigenvalues above 1: torques that hold the weight alone let the robot fall. The law takes the push of
         a quarter of the robot's weight for 0.1 s, and ends where it stood.
Needs    pip install scipy example-robot-data for Solo12
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, picture, start, write
from spatialdyn.examples.trotting_quadruped import FEET, references

RADIUS, DT, STEPS, PUSHED = 0.016, 1e-3, 1500, 100


def main(save: str | None = None) -> dict[str, Any]:
    """Linearize a stance, find its gain and push the robot with and without it; returns matrices and runs."""
    need("scipy.linalg", "simulation")
    model = sd.load_urdf("solo12", root="floating")
    contacts = sd.Contacts(model, dict.fromkeys(FEET, RADIUS), friction=0.8)
    scene, n = sd.Scene(model, contacts=contacts, friction=False), model.nv
    q, rest = references(model, 1)[0], np.zeros(n)
    q[2] -= sd.contact_gaps(model, contacts, q).min()

    # of each foot the Jacobian of its lowest point; the forces that carry the trunk, and the torques of the legs then
    J = sd.frame_jacobian(model, q, FEET[0], "local_world_aligned")[:0]
    for foot in FEET:
        at = sd.frame_jacobian(model, q, foot, "local_world_aligned")
        J = np.vstack([J, at[:3] + np.cross(at[3:], [0.0, 0.0, -RADIUS], axis=0)])
    g = sd.generalized_gravity(model, q)
    force = np.linalg.lstsq(J[:, :6].T, g[:6], rcond=None)[0]
    hold = g - J.T @ force
    hold[:6] = 0.0

    A, B = found = sd.linearize(scene, q, rest, hold, DT, "semi_implicit_euler")
    free = np.linalg.svd(J)[2][len(J) :].T  # motions that keep the feet in place
    T = np.kron(np.eye(2), free)
    a, b = T.T @ A @ T, T.T @ B[:, 6:]
    left = abs(A @ T - T @ a).max()
    weight = np.diag([1e4] * free.shape[1] + [1e1] * free.shape[1])
    gain = sd.lqr(a, b, weight, np.eye(n - 6), discrete=True)
    before, after = (np.sort(abs(np.linalg.eigvals(x)))[::-1] for x in (a, a - b @ gain.K))
    print(f"feet: {', '.join(f'{name} {state}' for name, state in zip(found.labels, found.active, strict=True))}")
    print(f"{2 * n} states, of which {len(a)} keep the feet in place, and stay there to {left:.0e}")
    print(f"largest eigenvalues of a step: {before[:3].round(5)}, torques held, {after[:3].round(5)}, by LQR")

    push = np.zeros((STEPS, model.njoints, 6))
    push[:PUSHED, 1, :3] = 0.25 * sd.total_mass(model) * 9.81 * np.array([0.5, 0.8, 0.0])
    K, runs = gain.K @ T.T, {}
    for name, share in (("LQR", 1.0), ("torques held", 0.0)):
        law = sd.StateFeedback(share * K, q, rest, hold, joints=np.arange(6, n), held=True)
        runs[name] = sd.rollout(scene, q, rest, dt=DT, control=law, fext=push, check=False)
    for name, run in runs.items():
        off = 1e3 * abs(run.q[:, :3] - q[:3])
        print(f"{name:12} trunk at most {off.max():6.1f} mm away, {off[-1].max():7.2f} mm at the end")
    if save:
        figure, axes = picture()
        t = DT * np.arange(1, STEPS + 1)
        for name, run in runs.items():
            axes.plot(t, run.q[:, 2], label=name)
        axes.axvspan(0.0, DT * PUSHED, color="0.9", label="push")
        axes.set(
            xlabel="t [s]",
            ylabel="height of the trunk [m]",
            xlim=(0, 0.8),
            title="a push, and the law of the linear system",
        )
        axes.legend()
        write(figure, save)
    return {"A": a, "B": b, "K": gain.K, "left": left, "before": before, "after": after, "q": q, "runs": runs}


if __name__ == "__main__":
    start(main)
