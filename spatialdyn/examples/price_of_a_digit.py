"""The price of a digit: what each way to compute forward dynamics costs on your robot, and how wrong it is.

Learn    trade measures error and time of every option on the model, on this machine; recommend takes the cheapest that
         is good enough, and is itself the call.
Look at  the rows with a star: nothing cheaper is more exact. Six digits (float32) and fifteen cost nearly the same in a
         batch; what costs is the last digit. Each robot has its own table: try --robot panda, or your file.
Needs    pip install mpmath
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, picture, start


def main(quick: bool = False, save: str | None = None, robot: str = "three_link") -> dict[str, Any]:
    """Print the table and two recommendations; returns them, and the largest error of the second in a fresh batch."""
    need("mpmath", "exact")
    model = sd.load_urdf(robot)
    states, batch = (64, 512) if quick else (512, 4096)
    table = sd.trade(model, "forward_dynamics", states, batch)
    print(table)
    if save:
        picture()  # raises if Matplotlib is missing
        table.plot(save)

    found: dict[str, Any] = {"table": table}
    rng = np.random.default_rng(7)
    q, v = sd.random_configuration(model, rng, (512,)), rng.normal(size=(512, model.nv))
    tau = rng.normal(size=(512, model.nv))
    for tolerance in (1e-3, 1e-12):
        cheapest = table.cheapest(tolerance)
        print(f"\nwithin {tolerance:g}: " + ("nothing" if cheapest is None else f"{cheapest.name}: {cheapest.code}"))
        if cheapest is None or cheapest.run is None:
            continue
        exact, first = sd.exact(model, sd.aba), np.asarray(cheapest.run(q, v, tau), dtype=float)[:8]
        truth = np.array([np.asarray(exact(*x), dtype=float) for x in zip(q[:8], v[:8], tau[:8], strict=True)])
        error = float((abs(first - truth).max(1) / abs(truth).max(1)).max())
        found[f"{tolerance:g}"] = (cheapest, error)
        print(f"tried in 8 new states against exact arithmetic: error {error:.1e}, it was to be below {tolerance:g}")
    return found


if __name__ == "__main__":
    start(main)
