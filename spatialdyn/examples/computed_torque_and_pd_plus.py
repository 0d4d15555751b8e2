"""Computed torque against PD+ on a Panda that carries more than its controller knows.

Learn    sd.quintic makes a path; sd.ComputedTorque is one rnea of a_d + Kd ė + Kp e, sd.PDPlus one modified_rnea of v_d
         and a_d plus springs and dampers. Here the same two lines are in a loop, because the controller's model is not
         the robot's.
         With springs as stiff as the diagonal of M both laws are alike; held torques need λmax(M⁻¹ Kd) h < 2.
Look at  the columns. Without payload both follow the path up to the error of the steps, and rest exactly at its end.
         With it both sag under its weight. The chapter's 10.3 says that parameters wrong by 20 % raise the error by a
         factor of 5 to 10; where the error was zero there is no such factor.
Needs    pip install example-robot-data for the Panda
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

Array = np.ndarray
DT, TIME = 1e-3, 2.0
KP, KD = (float(x) for x in sd.critical_gains(15.0))
START = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.7, 0.8, 0.02, 0.02])
WAY = np.array([0.8, 0.5, -0.4, 0.6, 0.3, -0.4, 0.5, 0.0, 0.0])
LOAD = (0.3, (0.0, 0.0, 0.1), 1e-3 * np.eye(3))


def computed_torque(model: sd.Model, inertia: Array, at: sd.PathPoint, q: Array, v: Array) -> Array:
    """M (a_d + Kp e + Kd ė) + C v + g."""
    return np.asarray(sd.rnea(model, q, v, at.a + KP * (at.q - q) + KD * (at.v - v)))


def pd_plus(model: sd.Model, inertia: Array, at: sd.PathPoint, q: Array, v: Array) -> Array:
    """M a_d + C v_d + g and springs, which do not know the model but for their stiffness."""
    return np.asarray(sd.modified_rnea(model, q, v, at.v, at.a) + inertia * (KP * (at.q - q) + KD * (at.v - v)))


def follow(law: Callable[..., Array], model: sd.Model, robot: sd.Model, path: sd.Path) -> Array:
    """Errors (steps, 9) of a robot whose torque is that of a law of another, held over each step."""
    q, v, errors, inertia = START, np.zeros(9), [], np.diagonal(sd.crba(model, START))
    points = [sd.PathPoint(*x) for x in zip(*path(DT * np.arange(round(TIME / DT) + 1)), strict=True)]
    for now, then in pairwise(points):
        q, v = sd.step(robot, q, v, law(model, inertia, now, q, v), DT)
        errors.append(q - then.q)
    return np.array(errors)


def main(save: str | None = None) -> dict[str, Any]:
    """Print the largest and the last errors of both laws without and with a payload; returns the errors, and robots."""
    model = sd.load_urdf("panda")
    path = sd.quintic(START, START + WAY, 1.2)
    robots = {"as modelled": model, "0.3 kg in hand": model.with_(payload={"panda_hand": LOAD})}
    known = {"computed torque": computed_torque, "PD+": pd_plus}
    errors = {(x, y): follow(law, model, robots[y], path) for x, law in known.items() for y in robots}
    print(f"{'':16}{'':14}{'largest error [rad]':>20}{'at the end':>12}")
    for (name, load), off in errors.items():
        print(f"{name:16}{load:14}{abs(off[:, :7]).max():20.2e}{abs(off[-1, :7]).max():12.2e}")
    if save:
        figure, axes = picture()
        for (name, load), off in errors.items():
            t, line = DT * np.arange(1, len(off) + 1), "--" if name == "PD+" else "-"
            axes.semilogy(t, np.linalg.norm(off[:, :7], axis=1), line, label=f"{name}, {load}")
        axes.set(xlabel="t [s]", ylabel="norm of the error of q [rad]")
        axes.legend(fontsize="small")
        write(figure, save)
    return {"errors": errors, "robots": robots, "path": path}


if __name__ == "__main__":
    start(main)
