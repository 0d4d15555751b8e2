"""Cost of derivatives of steps, and of an iteration of iLQR, for a Panda with locked fingers: one thread, one process.

    python benchmarks/steps.py [--quick]

The derivatives are asserted first, along random directions, against central differences of the steps, and A and B of
one knot against differences in 240 bits. Times are medians of rounds in which all contestants take turns.
Needs ``pip install ".[validate,exact]"``.
"""

from __future__ import annotations

import argparse
from time import perf_counter
from typing import Any

import numpy as np
from cases import Array
from measure import interleaved
from tables import draw

import spatialdyn as sd
from spatialdyn.calls.exact import Exact
from spatialdyn.engines import run
from spatialdyn.engines.compiled.numba_kernels import variant
from spatialdyn.examples.ilqr import backward, forward, ilqr
from spatialdyn.examples.optimal_control import cost_of, reach
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.derivatives.step_derivatives import STEPS
from spatialdyn.simulation.steps import step_specs

KNOTS, DT = 100, 0.01
METHODS = ("semi_implicit_euler", "explicit_euler", "velocity_verlet", "rk4")
ROUNDING, DIFFERENCE = 1e-12, 1e-7  # relative to the largest entry: of differences in 240 bits, and in float64


def main() -> None:
    """Check, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer rounds")
    rounds, seconds = (5, 0.02) if parser.parse_args().quick else (25, 0.05)
    sd.set_num_threads(1)
    problem = reach(sd.load_urdf("panda"))
    model, rng = problem.model, np.random.default_rng(0)
    q = sd.random_configuration(model, rng, KNOTS)
    v, tau = rng.normal(size=(2, KNOTS, model.nv))
    for method in METHODS:
        check(model, method, q, v, tau)
        truth(model, method, q[0], v[0], tau[0])
    for spec in (SPECS["aba_derivatives"], *(STEPS[method] for method in METHODS)):
        run.compile_program(variant(spec, ()), model, ())  # it would be interpreted until compiling pays

    def derive(method: str) -> Any:
        return lambda: sd.step_derivatives(sd.Scene(model, friction=False), q, v, tau, DT, method)

    contestants = {"aba_derivatives": lambda: sd.aba_derivatives(model, q, v, tau)}
    contestants |= {method: derive(method) for method in METHODS}
    times = interleaved(contestants, rounds, seconds)
    unit = times["aba_derivatives"]
    rows = [[name, f"{1e6 * x:.1f}", f"{1e9 * x / KNOTS:.0f}", f"{x / unit:.2f}"] for name, x in times.items()]
    draw("steps", [f"{KNOTS} knots", "[µs]", "a knot [ns]", "of aba_derivatives"], rows)
    draw("ilqr", [f"iLQR, T = {KNOTS}", ""], iteration(problem, rounds))


def check(model: sd.Model, method: str, q: Array, v: Array, tau: Array) -> None:
    """AssertionError unless A and B are differences of the step along random directions."""
    A, B = sd.step_derivatives(sd.Scene(model, friction=False), q, v, tau, DT, method)
    dq, dv, dtau = np.random.default_rng(1).normal(size=(3, *v.shape))
    e, ends = 1e-6, []
    for s in (e, -e):
        moved = q + s * dq, v + s * dv, tau + s * dtau
        how = {"dt": DT, "steps": 1, "method": method, "friction": False}
        done = [sd.rollout(model, *(x[k] for x in moved), **how) for k in range(4)]
        ends.append(np.array([np.concatenate([run.q[-1], run.v[-1]]) for run in done]))
    found = (ends[0] - ends[1]) / (2 * e)
    wanted = (A @ np.concatenate([dq, dv], 1)[..., None] + B @ dtau[..., None])[:4, :, 0]
    assert abs(found - wanted).max() < DIFFERENCE * abs(wanted).max(), method


def truth(model: sd.Model, method: str, q: Array, v: Array, tau: Array) -> None:
    """AssertionError unless three columns of a knot are differences of the same step in 240 bits."""
    A, B = sd.step_derivatives(sd.Scene(model, friction=False), q, v, tau, DT, method)
    arithmetic, n = sd.exact(model, sd.aba)._arithmetic, model.nv
    steps = [Exact(model, spec, arithmetic, {}, 240) for spec in step_specs(method)]
    small = arithmetic.context.mpf(10) ** -30
    given = [np.array([arithmetic.context.mpf(float(x)) for x in y], object) for y in (q, v, tau)]
    for k in (1, n + 2, 2 * n + 3):
        ends = []
        for s in (small, -small):
            moved = [x.copy() for x in given]
            moved[k // n][k % n] += s
            ends.append(np.concatenate([step(moved[0], moved[1], DT, moved[2]) for step in steps]))
        column = ((ends[0] - ends[1]) / (2 * small)).astype(float)
        assert abs(np.hstack([A, B])[:, k] - column).max() < ROUNDING * abs(column).max(), method


def iteration(problem: Any, rounds: int) -> list[list[str]]:
    """Rows of an iteration's time, the median over runs from the same start, of its parts, and of what it reaches."""
    start = np.tile(problem.force, (KNOTS, 1))
    _, _, costs, _ = ilqr(problem, start, 1e-9)
    taken = []
    for _ in range(rounds):
        began = perf_counter()
        x, u, made, K = ilqr(problem, start, 1e-9, most=12)
        taken.append((perf_counter() - began) / len(made))
    times = interleaved(parts(problem, x, u, K), rounds, 0.02)
    rows = [[f"{name} [ms]", f"{1e3 * each:.3f}"] for name, each in times.items()]
    return [
        *rows,
        ["one of each [ms]", f"{1e3 * sum(times.values()):.3f}"],
        ["an iteration, with all steps it tries [ms]", f"{1e3 * float(np.median(taken)):.3f}"],
        ["iterations", f"{len(costs) - 1}"],
        ["cost", f"{costs[-1]:.9f}"],
    ]


def parts(p: Any, x: Array, u: Array, K: Array) -> dict[str, Any]:
    """The parts of an iteration about a motion."""
    n, k = p.model.nv, np.zeros_like(u)
    q, v = x[:-1, :n].copy(), x[:-1, n:].copy()

    def derive() -> Array:
        return np.concatenate(sd.step_derivatives(sd.Scene(p.model, friction=False), q, v, u, p.h), axis=2)

    _, slope, W, last = cost_of(p, x, u)
    given = derive(), slope, W, *last, p.low - u, p.high - u, 0.0, k.copy(), K.copy()
    return {
        "derivatives": derive,
        "backward": lambda: backward(*given),
        "forward": lambda: forward(p, x, u, K),
        "cost": lambda: cost_of(p, x, u),
    }


if __name__ == "__main__":
    main()
