"""Bounds on rounding errors: whether they hold, how near they are, and what they cost.

    python benchmarks/bounds.py [--quick] [--samples 5000]

Of 20 robots every entry of every sample of rnea, crba and aba, in float64 and float32, is compared with double-double:
an error above its bound ends the run. Prints the median of bound over error, the share of samples without a bound, and,
of three arms, the time of the bounded call over the plain one, on one thread. Needs ``pip install
".[validate,bench]"``.
"""

from __future__ import annotations

import argparse
import warnings
from typing import Any

import numpy as np
from measure import interleaved
from tables import Bar, draw

import spatialdyn as sd
from spatialdyn.accuracy.references import recorded_call

ARMS = ("ur5_robot", "panda", "kinova")
ROBOTS = (
    *ARMS, "ur3_robot", "ur10_robot", "xarm7", "z1", "so100", "so101", "talos_left_arm", "finger_edu", "solo", "bolt",
    "solo12", "hyq_no_sensors", "a1", "go1", "b1", "laikago", "double_pendulum",
)  # fmt: skip
CALLS = ("rnea", "crba", "aba")
DTYPES = {"float64": np.float64, "float32": np.float32}
BATCH = 4096


def states(model: sd.Model, call: str, samples: int) -> list[np.ndarray]:
    """Random positions within a turn, velocities and accelerations or torques."""
    rng = np.random.default_rng(7)
    q = rng.uniform(-np.pi, np.pi, (samples, model.nq))
    return [q, *rng.standard_normal((2, samples, model.nv))][: 1 if call == "crba" else 3]


def held(model: sd.Model, call: str, dtype: Any, samples: int) -> tuple[float, float]:
    """(median of bound over error, share of samples without a bound). Ends the run if an error is above its bound."""
    given = states(model, call, samples)
    values, bounds = sd.bounded(model, getattr(sd, call), dtype=dtype)(*(x.astype(dtype) for x in given))
    program, shape = recorded_call(model, call)
    high, low = (x.T.reshape((samples, *shape)) for x in program(np.ascontiguousarray(np.concatenate(given, 1).T)))
    errors = abs((values.astype(np.float64) - high) - low)
    if not (errors <= bounds).all():
        raise SystemExit(f"{call} of {model.name} in {dtype.__name__}: {(errors > bounds).sum()} errors above bounds")
    there = (errors > 0.0) & np.isfinite(bounds)
    return float(np.median(bounds[there] / errors[there])), float(np.isinf(bounds).reshape(samples, -1).any(1).mean())


def cost(model: sd.Model, call: str, dtype: Any, rounds: int) -> tuple[float, float]:
    """Nanoseconds of a sample, plain and bounded."""
    function, given = getattr(sd, call), [x.astype(dtype) for x in states(model, call, BATCH)]
    plain, bounded = sd.specialize(model, function, dtype=dtype), sd.bounded(model, function, dtype=dtype)
    out, outs = plain(*given), bounded(*given)
    runs = {"plain": lambda: plain(*given, out=out), "bounded": lambda: bounded(*given, out=outs)}
    times = interleaved(runs, rounds, 0.05)
    return times["plain"] / BATCH * 1e9, times["bounded"] / BATCH * 1e9


def main() -> None:
    """Check, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two robots, few samples and rounds")
    parser.add_argument("--samples", type=int, default=5000, help="of each robot (default: 5000)")
    asked = parser.parse_args()
    robots, samples, rounds = (ROBOTS[:2], 200, 3) if asked.quick else (ROBOTS, asked.samples, 15)
    warnings.simplefilter("ignore")
    sd.set_num_threads(1)
    rows = []
    bar = Bar(len(robots) * len(CALLS) * len(DTYPES))
    for name in robots:
        model = sd.load_urdf(name)
        for call in CALLS:
            for word, dtype in DTYPES.items():
                bar.step(f"{name} {call}")
                ratio, unknown = held(model, call, dtype, samples)
                row = [name, call, word, f"{ratio:.0f}", f"{unknown:.1%}"]
                if name in ARMS:
                    plain, bounded = cost(model, call, dtype, rounds)
                    row += [f"{plain:.0f}", f"{bounded:.0f}", f"{bounded / plain:.1f}"]
                rows.append(row + [""] * (8 - len(row)))
    bar.end()
    head = ["robot", "call", "dtype", "bound / error", "no bound", "ns", "with bound", "ratio"]
    draw(f"bounds of {samples * len(robots)} samples: none below its error", head, rows)


if __name__ == "__main__":
    main()
