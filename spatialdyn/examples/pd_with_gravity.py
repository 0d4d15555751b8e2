"""PD control with and without gravity: what is left of the error when the arm has come to rest.

Learn    simulate takes a torque function f(t, q, v) -> τ; the laws differ by their gravity term alone.
Look at  the errors at the end. PD alone rests where Kp (q_d - q) = g(q), away from q_d; with g(q) the arm rests in q_d
         for any Kp > 0. The chapter's section 10.4 stops half-way over "g(q) - g(q_d)": with g(q) evaluated where the
         arm is, the terms cancel and nothing is left to correct. It is the law with the constant g(q_d) that needs a Kp
         above the slope of g, and with less of it falls: the third row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

Array = np.ndarray


def main(save: str | None = None) -> dict[str, Any]:
    """Print final errors of four laws; returns the final positions, and the limit of the slope of g."""
    model = sd.load_urdf("two_link")
    q_d, q0 = np.array([np.pi / 2, 0.3]), np.array([1.0, 0.6])  # nearly upright, where g pushes away from q_d
    Kp, Kd = 60.0, 15.0
    slope = np.linalg.norm(sd.generalized_gravity_derivatives(model, q_d), 2)

    def law(gravity: Callable[[Array], Array], kp: float) -> Callable[[float, Array, Array], Array]:
        return lambda t, q, v: gravity(q) + kp * (q_d - q) - Kd * v

    laws = {
        "PD": law(np.zeros_like, Kp),
        "PD + g(q_d)": law(lambda q: sd.generalized_gravity(model, q_d), Kp),
        "PD + g(q_d), Kp 15": law(lambda q: sd.generalized_gravity(model, q_d), 15.0),
        "PD + g(q), Kp 15": law(lambda q: sd.generalized_gravity(model, q), 15.0),
    }
    print(f"slope of g at q_d: {slope:.1f} N m/rad\n{'law':20} {'error of q at the end [rad]':>28}")
    found: dict[str, Any] = {"slope": slope}
    runs = {}
    for name, torque in laws.items():
        runs[name] = sd.simulate(model, q0, [0.0, 0.0], 30.0, 0.01, torque=torque)
        found[name] = runs[name].q[-1]
        print(f"{name:20} {found[name][0] - q_d[0]:14.2e} {found[name][1] - q_d[1]:13.2e}")
    if save:
        figure, axes = picture()
        for name, run in runs.items():
            axes.plot(run.t, run.q[:, 0] - q_d[0], label=name)
        axes.set(xlabel="t [s]", ylabel="error of q1 [rad]", xlim=(0, 10))
        axes.legend()
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
