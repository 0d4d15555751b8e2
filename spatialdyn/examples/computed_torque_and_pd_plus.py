"""Computed torque against PD+ on a Panda that carries more than its controller knows.

Learn    sd.quintic makes a path; sd.ComputedTorque is one rnea of a_d + Kd ė + Kp e, sd.PDPlus one modified_rnea of v_d
         and a_d, and springs. Here the same two lines are torque functions, because the controller's model is not the
         robot's; critical_gains and the diagonal of M make both as stiff.
Look at  the columns. Without payload both follow the path: their errors are those of the steps. With it both sag by what
         its weight bends, the more the less the inertia of a joint is, for that is what their stiffness is made of. The
         chapter's 10.3 says that 20 % of parameters cost a factor of 5 to 10: from no error, any factor is reached.
Needs    pip install example-robot-data for the Panda
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

Array = np.ndarray
DT, TIME = 2e-3, 2.0
START = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.7, 0.8, 0.02, 0.02])
WAY = np.array([0.8, 0.5, -0.4, 0.6, 0.3, -0.4, 0.5, 0.0, 0.0])
LOAD = (1.0, (0.0, 0.0, 0.1), 1e-3 * np.eye(3))


def laws(model: sd.Model, path: sd.Path) -> dict[str, Callable[[float, Array, Array], Array]]:
    """Torque functions of a model along a path."""
    Kp, Kd = (float(x) for x in sd.critical_gains(15.0))
    inertia = np.diagonal(sd.crba(model, START))

    def computed_torque(t: float, q: Array, v: Array) -> Array:
        at = path(t)
        return np.asarray(sd.rnea(model, q, v, at.a + Kp * (at.q - q) + Kd * (at.v - v)))

    def pd_plus(t: float, q: Array, v: Array) -> Array:
        at = path(t)
        springs = inertia * (Kp * (at.q - q) + Kd * (at.v - v))
        return np.asarray(sd.modified_rnea(model, q, v, at.v, at.a) + springs)

    return {"computed torque": computed_torque, "PD+": pd_plus}


def follow(robot: sd.Model, law: Callable[[float, Array, Array], Array], path: sd.Path) -> Array:
    """Errors (steps, 7) of the arm, whose torque is held over each step."""
    q, v, errors = START, np.zeros(9), []
    for k in range(round(TIME / DT)):
        q, v = sd.step(robot, q, v, law(k * DT, q, v), DT)
        errors.append(q - path((k + 1) * DT).q)
    return np.array(errors)[:, :7]


def main(save: str | None = None) -> dict[str, Any]:
    """Print the largest and the last errors of both laws without and with a payload; returns the errors, and robots."""
    model = sd.load_urdf("panda")
    path = sd.quintic(START, START + WAY, 1.2)
    robots = {"as modelled": model, "1 kg in hand": model.with_(payload={"panda_hand": LOAD})}
    errors = {(x, y): follow(robots[y], law, path) for x, law in laws(model, path).items() for y in robots}
    print(f"{'':16}{'':14}{'largest error [rad]':>20}{'at the end':>12}")
    for (name, load), off in errors.items():
        print(f"{name:16}{load:14}{abs(off).max():20.2e}{abs(off[-1]).max():12.2e}")
    if save:
        figure, axes = picture()
        for (name, load), off in errors.items():
            t, line = DT * np.arange(1, len(off) + 1), "--" if name == "PD+" else "-"
            axes.semilogy(t, np.linalg.norm(off, axis=1), line, label=f"{name}, {load}")
        axes.set(xlabel="t [s]", ylabel="norm of the error of q [rad]")
        axes.legend(fontsize="small")
        write(figure, save)
    return {**errors, "robots": robots, "laws": laws(model, path), "path": path}


if __name__ == "__main__":
    start(main)
