"""An energy ledger: where the energy of an arm with damping and dry friction goes, joint by joint.

Learn    simulate(record="work") carries the work of every kind as states of the same integrator; energy_ledger adds
         them up, E⁺ - E = W_torque + W_friction + ε, and plots them.
Look at  ε, what the integrator itself adds: with friction that is solved for (order 1) it is halved with dt, with the
         smooth law and RK4 it falls by 16. The table says which joint's friction took what, and that none of them gave
         energy back. The motor's work is in it too, of either sign.
"""

from __future__ import annotations

from typing import Any

import spatialdyn as sd
from spatialdyn.examples.gallery import start, write

FRICTION = sd.Friction([0.6, 0.4, 0.2], [0.6, 0.4, 0.2], [0.8, 0.5, 0.3], 0.1, 0.4)
WAYS = {"implicit": "semi_implicit_euler", "smooth": "rk4"}


def main(quick: bool = False, save: str | None = None) -> dict[Any, Any]:
    """Print the ledgers; returns them by way and step."""
    model = sd.load_urdf("three_link")
    duration = 1.0 if quick else 4.0
    found: dict[Any, Any] = {}
    print(f"{'friction':10}{'dt [s]':>8}{'E+ - E [J]':>12}{'motors':>10}{'friction':>10}{'ε':>10}")
    for way, method in WAYS.items():
        for dt in (2e-3, 1e-3, 5e-4):
            run = sd.simulate(
                sd.Scene(model, friction=FRICTION, friction_method=way),
                [-1.0, 0.5, 0.3],
                [0.0, 0.0, 0.0],
                duration,
                dt,
                method,
                torque=[4.0, 1.0, 0.5],
                record="work",
            )
            ledger = found[way, dt] = sd.energy_ledger(run)
            motors, rubbed = (ledger.work[kind][-1].sum() for kind in ("torque", "friction"))
            print(f"{way:10}{dt:8g}{ledger.change[-1]:12.5f}{motors:10.4f}{rubbed:10.4f}{ledger.error[-1]:10.1e}")
    ledger = found["implicit", 5e-4]
    print("\nwork by joint [J]:")
    for kind, work in ledger.work.items():
        print(f"{kind:10}", *(f"{name} {x:.4f}" for name, x in zip(ledger.labels[kind], work[-1], strict=True)))
    if save:
        write(ledger.plot(), save)
    return found


if __name__ == "__main__":
    start(main)
