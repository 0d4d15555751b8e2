"""Dry friction on a slide: an oscillator stops beside its spring's rest, and on a belt it sticks and slips.

Learn    Friction and simulate(friction_method=...); a torque as a law of its own, a Spec in a Control, whose clock is a
         state that the run carries.
Look at  where the oscillator stops: at -0.01 m, as each half period takes 2 F/k and the spring no longer moves it;
         v is 0 to the last bit. With tanh(v/ε) for the sign, which the chapter's section 17.2 proposes, nothing ever
         sticks: the mass creeps for ever. On the belt it slips for 0.471239 s and sticks for 0.2 s, the closed form's
         times, to a step of dt.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec

K, METHOD = 100.0, "semi_implicit_euler"  # [N/m] of a mass of 1 kg


def spring(bodies: Any, q: Any, clock: Any, stiffness: Any, speed: Any, tau: Any, clock_rate: Any) -> None:
    """A spring in the frame of a belt, whose end moves with it: the clock, a state, has the rate 1."""
    tau[0] = -stiffness[0] * (q[0] + speed[0] * clock[0])
    clock_rate[0] = 1.0


INPUTS = (
    Q, Argument("clock", (1,), "s", "time", start=0.0), Argument("stiffness", (1,), "N/m", "of the spring"),
    Argument("speed", (1,), "m/s", "of the belt"),
)  # fmt: skip
SPRING = Spec(
    "spring", spring, None, INPUTS, TAU, "A spring.", "Hooke", parts=(TAU, Argument("clock_rate", (1,), "1", "1"))
)


def main(save: str | None = None) -> dict[str, Any]:
    """Print where it stops, how it creeps, and the times on the belt; returns them."""
    mass = sd.ModelBuilder("mass").add_body("m", None, "prismatic", (1, 0, 0), inertia=(1.0, (0, 0, 0), np.eye(3)))
    model, dt = mass.build(gravity=(0.0, 0.0, 0.0)), 1e-4
    found: dict[str, Any] = {}
    free, dry = sd.Control(SPRING, {"stiffness": [K], "speed": [0.0]}), sd.Friction([2.0], [0.0], smoothing=[1e-3])
    for way in ("implicit", "smooth"):
        run = sd.simulate(
            sd.Scene(model, friction=dry, friction_method=way), [0.21], [0.0], 2.0, dt, METHOD, control=free, record=1
        )
        found[way] = run.q[-1, 0], run.v[-1, 0]
        print(f"{way:9} at 2 s: x = {run.q[-1, 0]:.8f} m, v = {run.v[-1, 0]:.2e} m/s")
    fs, fc, speed = 3.0, 2.0, 0.1
    belt = sd.Control(SPRING, {"stiffness": [K], "speed": [speed]})
    run = sd.simulate(
        sd.Scene(model, friction=sd.Friction([fc], [0.0], [fs])), [0.0], [0.0], 2.5, dt, METHOD, control=belt, record=1
    )
    sticks, x = run.v[:, 0] == 0.0, run.q[:, 0] + speed * run.t  # in the room; q is in the belt's frame
    changes = run.t[np.flatnonzero(sticks[1:] != sticks[:-1])]
    found["slip"], found["stick"] = (float(np.diff(changes)[k::2].mean()) for k in range(2))
    wanted = 0.2 * (math.pi - math.atan((fs - fc) * 10.0 / (K * speed))), 2.0 * (fs - fc) / (K * speed)
    for name, closed in zip(("slip", "stick"), wanted, strict=True):
        print(f"belt: {name:5} for {found[name]:.5f} s, closed form {closed:.6f} s")
    if save:
        figure, axes = picture()
        axes.plot(run.t, x)
        axes.set(xlabel="t [s]", ylabel="x in the room [m]", title="a mass on a belt")
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
