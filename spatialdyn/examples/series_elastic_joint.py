"""A series-elastic joint: a spring between gear and link, the blow that it softens, and the step that it allows.

Learn    builder.add_series_elastic(joint, stiffness, damping, rotor, ratio) adds the rotor as a freedom of its own and
         the spring, which acts in simulate and rollout; spring_torque and spring_energy are the rest.
Look at  the frequency √(k (1/I + 1/n²J)) and the largest torque v √(k I n²J / (I + n²J)) after a blow of v: the softer
         the spring, the less reaches the gear. A step above 2 over that frequency is refused with the step that is not.
"""

from __future__ import annotations

import math

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

INERTIA, J, N = 0.2, 1e-4, 50.0  # of the link, of the rotor [kg m²], and the gear between: n²J is 0.25
BLOW = 5.0  # velocity of the link after it [rad/s]


def joint(stiffness: float) -> sd.Model:
    """A link on a vertical axis behind a spring."""
    b = sd.ModelBuilder("sea").add_body("link", inertia=(1.0, (0, 0, 0), INERTIA * np.eye(3)), joint_name="joint")
    return b.add_series_elastic("joint", stiffness, rotor=J, ratio=N).build()


def main(save: str | None = None) -> dict[float, dict[str, float]]:
    """Print frequency and torque after a blow, by hand and simulated; returns them by stiffness."""
    found: dict[float, dict[str, float]] = {}
    runs = {}
    print(
        f"{'k':>6} {'rad/s by hand':>14} {'simulated':>10} {'N m by hand':>12} {'simulated':>10} {'energy':>9} "
        f"{'dt <':>9}"
    )
    for k in (30.0, 300.0, 3000.0):
        model, felt = joint(k), 1.0 / (1.0 / INERTIA + 1.0 / (N * N * J))  # inertia against which both move
        rate, most = math.sqrt(k / felt), BLOW * math.sqrt(k * felt)
        period = 2.0 * math.pi / rate
        run = sd.simulate(model, [0.0, 0.0], [BLOW, 0.0], 1.25 * period, period / 400, "rk4")
        torque = -sd.spring_torque(model, run.q)[:, 0]  # on the rotor's side
        down = int(np.flatnonzero((torque[:-1] > 0.0) & (torque[1:] <= 0.0))[0])  # half a period after the blow
        zero = run.t[down] + (run.t[down + 1] - run.t[down]) * torque[down] / (torque[down] - torque[down + 1])
        energy = run.energy  # that of the spring too
        found[k] = {
            "rate": rate, "simulated rate": float(math.pi / zero), "torque": most, "simulated": float(torque.max()),
            "energy": float(abs(energy - energy[0]).max() / energy[0]), "step": 2.0 / rate,
        }  # fmt: skip
        runs[k] = run.t, torque
        x = found[k]
        print(
            f"{k:6.0f} {rate:14.4f} {x['simulated rate']:10.4f} {most:12.4f} {x['simulated']:10.4f} "
            f"{x['energy']:9.1e} {x['step']:9.2g}"
        )
    try:
        sd.rollout(joint(3000.0), [0.0, 0.0], [BLOW, 0.0], dt=0.02, steps=10)
    except sd.SimulationError as error:
        print(f"\na step of 20 ms: {error}")
    if save:
        figure, axes = picture()
        for k, (t, torque) in runs.items():
            axes.plot(1e3 * t, torque, label=f"{k:.0f} N m/rad")
        axes.set(xlabel="time [ms]", ylabel="torque at the gear [N m]", title=f"After a blow of {BLOW} rad/s")
        axes.legend()
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
