"""Gravity compensation: the torques that hold a Panda still, and what a load in the hand does to them.

Learn    generalized_gravity(model, q) is g(q); with_(payload=...) is the same robot with a load in its hand.
Look at  the last lines: with τ = g(q) the arm stays where it is to the last digit; a load that the model does not know
         pulls the hand down at once. Gravity compensation has no stiffness: nothing brings the arm back. The three
         runs are one batch of ``rollout``, which leaves joint damping out.
Needs    pip install example-robot-data for the Panda; or --robot
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write


def main(robot: str = "panda", save: str | None = None) -> dict[str, np.ndarray]:
    """Print torques with and without a load of 2 kg and simulate half a second; returns torques and depths of falls."""
    model = sd.load_urdf(robot)
    hand = model.frames[-1].name if robot != "panda" else "panda_link8"
    q = sd.neutral(model)
    if robot == "panda":
        q[:7] = [0.0, -0.5, 0.0, -2.2, 0.0, 1.7, 0.8]
    loaded = model.with_(payload={hand: (2.0, (0.0, 0.0, 0.1), np.zeros((3, 3)))})  # 2 kg, 10 cm from the flange
    g, g_loaded = sd.generalized_gravity(model, q), sd.generalized_gravity(loaded, q)

    print(f"{'joint':24} {'g [N m]':>9} {'with 2 kg':>9} {'limit':>7}")
    for joint in model.joints[1:]:
        k = joint.idx_v
        print(f"{joint.name:24} {g[k]:9.3f} {g_loaded[k]:9.3f} {model.effort_limit[k]:7.1f}")

    # the robot that moves is the loaded one; the torques held are those of either model, or none
    names, steps, dt = ("knows the load", "does not", "nothing held"), 500, 1e-3
    tau = np.repeat(np.stack([g_loaded, g, 0 * g])[:, None], steps, axis=1)  # (laws, steps, nv)
    run = sd.rollout(
        sd.Scene(loaded, friction=False), q, np.zeros(model.nv), tau, dt=dt
    )  # joints without friction fall
    fall = sd.frame_placement(model, q, hand)[2, 3] - sd.frame_placement(model, run.q, hand)[..., 2, 3]
    for name, depth in zip(names, fall, strict=True):
        print(f"{name:16} the hand falls {1e3 * depth[-1]:8.3f} mm in 0.5 s")
    if save:
        figure, axes = picture()
        axes.plot(dt * np.arange(1, steps + 1), -fall.T, label=names)
        axes.set(xlabel="t [s]", ylabel="height of the hand above its start [m]")
        axes.set_title("2 kg in the hand; τ = g(q) of a model that ...")
        axes.legend()
        write(figure, save)
    return {"g": g, "loaded": g_loaded, "q": q, "fall": fall[:, -1]}


if __name__ == "__main__":
    start(main)
