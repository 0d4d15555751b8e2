"""Every robot of example-robot-data on SIMD lanes, against the table kernel and against exact values.

    python benchmarks/corpus.py [--robots panda,ur5] [--roots fixed,floating] [--samples 24]

rnea, crba and kinematics: lanes within 64 eps of the untraced kernel, of a sample's largest entry. aba and minverse:
the error against a run in 40 digits at most 4 times the untraced kernel's, and 64 eps. Prints a row per failure
and a summary; the exit status is the number of failures. Needs example-robot-data and mpmath.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

import numpy as np
from cases import Array, deepest, load, random_state
from tables import Bar

import spatialdyn as sd
from spatialdyn.calls.dynamics import calls
from spatialdyn.urdf.load import example_robots

EPS = float(np.finfo(float).eps)
ROUNDING = 64 * EPS  # both sides round in another order
SOLVED = 4.0  # times the untraced error, plus ROUNDING, for aba and minverse
BITS = 140
FAR = 1e3  # rad
EXACT = 6  # samples computed in BITS bits
CALLS = {
    "rnea": "qva",
    "crba": "q",
    "forward_kinematics": "q",
    "joint_jacobians": "q",
    "frame_jacobian": "q",
    "aba": "qvt",
    "minverse": "q",
}


def exact(model: sd.Model, name: str, values: list[Array]) -> Array:
    """One sample of aba or minverse in BITS bits, rounded at the end."""
    return np.asarray(sd.exact(model, calls[name], BITS)(*values).astype(np.float64))


def scaled(x: Array, wanted: Array) -> float:
    """The largest difference of each sample, over its largest entry or 1."""
    x, wanted = (np.reshape(y, (len(x), -1)) for y in (x, wanted))
    errors = abs(x - wanted).max(axis=1, initial=0.0) / np.maximum(abs(wanted).max(axis=1, initial=0.0), 1.0)
    return float(errors.max(initial=0.0))


def compared(model: sd.Model, name: str, samples: int) -> tuple[str, float, float]:
    """(how it ran, error in units of eps, bound in units of eps) of one call on one model."""
    state = random_state(model, samples)
    q = state["q"]
    q[abs(q) > FAR] = state["v"].flat[0]  # limits of 1e16, which two quadrotors have, leave no digits of an angle
    values = [state[letter] for letter in CALLS[name]]
    options = {"frame": f"joint:{deepest(model)}"} if name == "frame_jacobian" else {}
    call = getattr(sd, name)
    try:
        k = sd.specialize(model, call, **options)
        if k.engine != "lanes":
            return "untraced", 0.0, 0.0
        found = k(*values)
        wanted = np.array([call(model, *(x[i] for x in values), **options) for i in range(samples)])
    except sd.InertiaError:
        return "refused, a joint has zero articulated inertia", 0.0, 0.0
    left = redone(k, values)
    if left:
        return f"lanes, with {left} of {samples} samples left to the untraced kernel", np.inf, 0.0
    if name not in ("aba", "minverse"):
        return "lanes", scaled(found, wanted) / EPS, ROUNDING / EPS
    few = range(min(EXACT, samples))
    truth = np.array([exact(model, name, [x[i] for x in values]) for i in few])
    error, before = (scaled(x[: len(few)], truth) for x in (found, wanted))
    return "lanes", error / EPS, (SOLVED * before + ROUNDING) / EPS


def redone(k: sd.Specialized, values: list[Array]) -> int:
    """The number of samples that the program leaves to the table kernel, whose results do not test it."""
    kernel = k._kernel
    assert kernel is not None
    n = len(values[0])
    samples = kernel(values, [np.empty((n, columns)) for columns in kernel.outputs])
    assert samples is not None
    return len(samples)


def main() -> int:
    """Check all of them and print failures."""
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", default="", help="parts of file names, by default all")
    parser.add_argument("--roots", default="fixed,floating")
    parser.add_argument("--calls", default=",".join(CALLS))
    parser.add_argument("--samples", type=int, default=24, help="of each robot, not a multiple of the lanes")
    options = parser.parse_args()
    parts, calls = options.robots.split(","), options.calls.split(",")
    paths = [path for path in map(str, example_robots()) if any(part in path for part in parts)]
    roots = options.roots.split(",")
    bar, start = Bar(len(paths) * len(roots)), time.perf_counter()
    ways: Counter[str] = Counter()
    worst: dict[str, tuple[float, str]] = {}
    failures = []
    for path in paths:
        for root in roots:
            short = "/".join(path.split("/")[-2:]) + f", {root}"
            bar.step(short)
            try:
                model = load(path, root=root)
            except sd.UrdfError as error:
                ways[f"no model: {str(error)[-60:]}"] += 1
                continue
            if not model.nv:
                ways["nothing moves"] += 1
                continue
            for name in calls:
                how, error, bound = compared(model, name, options.samples)
                ways[how] += 1
                worst[name] = max(worst.get(name, (0.0, "")), (error / bound if bound else 0.0, short))
                if not error <= bound:
                    failures.append(f"{short}, {name}: {error:.1f} eps, expected at most {bound:.1f}")
    bar.end()
    print("\n".join([*failures, ""]))
    for name, (share, where) in worst.items():
        print(f"{name:20} at most {100 * share:.0f} % of its bound: {where}")
    print(", ".join(f"{how}: {count}" for how, count in ways.items()))
    print(f"{len(paths)} files, {len(failures)} failures, {time.perf_counter() - start:.0f} s")
    return len(failures)


if __name__ == "__main__":
    raise SystemExit(main())
