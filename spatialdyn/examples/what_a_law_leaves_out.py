"""What a control law leaves out: C v at speed, and the rotors' inertia under high gears.

Learn    computed torque by rnea of three models: the robot's, without velocities (M a + g), without rotors. sd.Rotor
         carries the gear; M has n² J on its diagonal.
Look at  which of the two costs more. In a direct drive it is C v, the more so the faster the motion. Behind a gear of
         50 the rotors are half of M: a law without them gives half of the intended acceleration at any speed, and C v
         is small beside that. The chapter's 18.3 says the latter; higher gains help, as it says, until noise or the
         step limits them.
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

Array = np.ndarray
ROTOR, GEARS, TIMES = 2e-4, (1.0, 10.0, 50.0), (2.0, 1.0, 0.5)
STEPS = 400
START, WAY = np.array([0.3, 0.2, -0.4]), np.array([1.2, -0.8, 1.0])


def arm(gear: float | None) -> sd.Model:
    """Three rods of 1 kg and 0.5 m that turn about y, with motors that turn ``gear`` times as fast, or without."""
    rod = (1.0, (0.0, 0.0, -0.25), np.diag([0.02, 0.02, 1e-3]))
    builder, below = sd.ModelBuilder("geared"), None
    for k in range(3):
        placement, motor = None if below is None else (0.0, 0.0, -0.5), sd.Rotor(ROTOR, gear) if gear else None
        builder.add_body(f"rod{k}", below, "revolute", (0, 1, 0), placement, rod, rotor=motor)
        below = f"rod{k}"
    return builder.build()


def follow(robot: sd.Model, known: sd.Model, with_C: bool, time: float) -> float:
    """The largest error [rad] of computed torque by a model that is known, along a path of that time."""
    path, (Kp, Kd) = sd.quintic(START, START + WAY, time), (float(x) for x in sd.critical_gains(15.0))

    q, v, dt, passed = START, np.zeros(3), time / STEPS, []
    for q_d, v_d, a_d in zip(*path(dt * np.arange(STEPS)), strict=True):
        passed.append(q)
        a = a_d + Kp * (q_d - q) + Kd * (v_d - v)
        q, v = sd.step(robot, q, v, sd.rnea(known, q, v if with_C else np.zeros(3), a), dt)
    return float(abs(np.array(passed) - path(dt * np.arange(STEPS)).q).max())


def main(save: str | None = None) -> dict[tuple[float, float, str], float]:
    """Print the errors by gear, time and what is left out; returns them, and the rotors' share of M."""
    found: dict[tuple[float, float, str], float] = {}
    print(f"{'largest error without':>28}{'nothing':>11}{'C v':>11}{'rotors':>11}")
    print(f"{'gear':>5}{'rotors in M':>13}{'time [s]':>10}")
    for gear in GEARS:
        robot, bare = arm(gear), arm(None)
        share = float(np.mean(ROTOR * gear**2 / np.diagonal(sd.crba(robot, START))))
        for time in TIMES:
            for name, known, with_C in (("nothing", robot, True), ("C v", robot, False), ("rotors", bare, True)):
                found[gear, time, name] = follow(robot, known, with_C, time)
            row = "".join(f"{found[gear, time, name]:11.1e}" for name in ("nothing", "C v", "rotors"))
            print(f"{gear:5g}{share:13.0%}{time:10g}{row}")
        found[gear, 0.0, "share"] = share
    if save:
        figure, axes = picture(2, width=9.0)
        for one, name in zip(axes, ("C v", "rotors"), strict=True):
            for gear in GEARS:
                one.semilogy(TIMES, [found[gear, x, name] for x in TIMES], marker="o", label=f"gear {gear:g}")
            one.set(
                xlabel="time of the motion [s]", ylabel="largest error [rad]", title=f"without {name}", ylim=(1e-5, 3.0)
            )
        axes[1].legend(fontsize="small")
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
