"""CPU time of the first ``simulate`` of a process, of this version and of another, with an empty and with a warm cache.

    git worktree add --detach /tmp/before COMMIT
    python benchmarks/first_run.py --before /tmp/before

A free arm, and a four-bar under its constraints; processes of the versions take turns. Imports that ``simulate`` makes
are in the time, those of ``import spatialdyn`` and of loading the robot are not. LLVM's own import is some 50 ms of it.
"""

from __future__ import annotations

import argparse
import inspect
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parents[1]
CASES = ("arm", "four-bar")


def main() -> None:
    """Run both versions and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", help="folder of a checkout of the other version")
    parser.add_argument("--runs", type=int, default=9, help="processes of each kind")
    parser.add_argument("--case", choices=CASES, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.case:
        print(first_run(given.case))
        return
    roots = {"before": str(given.before), "now": str(HERE)}
    print(f"{'first simulate [ms CPU]':26}{'before':>8}{'now':>8}{'ratio':>8}")
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            for state in ("empty", "warm"):
                spent: dict[str, list[float]] = {name: [] for name in roots}
                for k in range(given.runs + (state == "warm")):
                    for name, root in roots.items():
                        cache = f"{folder}/{name}" + (f"-{case}-{k}" if state == "empty" else "")
                        spent[name].append(measured(root, case, cache))
                before, now = (median(x[state == "warm" :]) for x in spent.values())
                print(f"{case + ', ' + state + ' cache':26}{before:8.0f}{now:8.0f}{now / before:8.2f}")


def measured(root: str, case: str, cache: str) -> float:
    """CPU time in a process of its own [ms]."""
    own = {"PYTHONPATH": root, "SPATIALDYN_CACHE_DIR": cache, "NUMBA_CACHE_DIR": f"{cache}/numba"}
    command = [sys.executable, __file__, "--case", case]
    return float(subprocess.run(command, env={**os.environ, **own}, capture_output=True, check=True).stdout)


def first_run(case: str) -> float:
    """CPU time of the first simulate of this process [ms]."""
    import spatialdyn as sd

    if case == "arm":
        model, q, v = sd.load_urdf("two_link"), np.array([0.5, -0.3]), np.zeros(2)
        start = time.process_time()
        sd.simulate(model, q, v, 0.1, 1e-3, "rk4")
        return 1e3 * (time.process_time() - start)
    b = sd.ModelBuilder("four_bar")
    bodies = ("crank", None, 0.0, 0.2), ("coupler", "crank", 0.2, 0.5), ("rocker", None, 0.5, 0.4)
    for name, parent, at, length in bodies:
        rod = length, (length / 2, 0, 0), np.diag([0, length**3 / 12, length**3 / 12])
        b.add_body(name, parent, "revolute", (0, 0, 1), (at, 0, 0), rod)
    model = b.build(gravity=(0, -9.81, 0))
    pin = sd.PointConstraint("coupler", "rocker", at_a=(0.5, 0, 0), at_b=(0.4, 0, 0), name="pin")
    held: Any = sd.Constraints(model, [pin])
    q = sd.close_loops(model, held, [0.7, 0.2, 1.4])
    v = sd.project_velocity(model, held, q, [1.0, 0, 0])
    start = time.process_time()
    if "constraints" in inspect.signature(sd.simulate).parameters:  # before there were scenes
        sd.simulate(model, q, v, 0.1, 1e-3, "rk4", constraints=held)
    else:
        sd.simulate(sd.Scene(model, constraints=held), q, v, 0.1, 1e-3, "rk4")
    return 1e3 * (time.process_time() - start)


if __name__ == "__main__":
    main()
