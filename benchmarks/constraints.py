"""Constrained dynamics of a quadruped on its feet against Pinocchio: one process, one thread, calls in turn.

``python benchmarks/constraints.py`` prints nanoseconds and ratios; on a busy machine read the least. Every answer is
checked against Pinocchio's before anything is timed: accelerations and forces differ by at most 1e-12 + 100 eps
cond(KKT), relative.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

import spatialdyn as sd
from spatialdyn.urdf.load import find_robot

ROBOT, FEET = "anymal_b_simple_description/anymal", ("LF_FOOT", "LH_FOOT", "RF_FOOT", "RH_FOOT")
SAMPLES, ROUNDS, FEW = 8192, 300, 32
WARM = 80_000  # single calls before any is timed
PROXIMAL = 1e-12  # of Pinocchio: its default of 0 fails where rows depend on others

Array = np.ndarray


def pair(path: str, feet: tuple[str, ...]) -> tuple[sd.Model, sd.Constraints, Any, Any]:
    """The robot with its feet held in the world: (model, constraints) here, (model, constraints) of Pinocchio."""
    ours, theirs = sd.load_urdf(path, root="floating"), pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())
    held = sd.Constraints(ours, [sd.PointConstraint(foot) for foot in feet])
    models = pin.StdVec_RigidConstraintModel()
    for foot in feet:
        frame = theirs.frames[theirs.getFrameId(foot)]
        models.append(
            pin.RigidConstraintModel(
                pin.ContactType.CONTACT_3D, theirs, frame.parentJoint, frame.placement, pin.LOCAL_WORLD_ALIGNED
            )
        )
    return ours, held, theirs, models


def states(model: sd.Model, n: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """q, v and tau of n samples."""
    rng = np.random.default_rng(seed)
    q = sd.random_configuration(model, rng, (n,))
    return q, rng.standard_normal((n, model.nv)), 10.0 * rng.standard_normal((n, model.nv))


def solver(theirs: Any, models: Any) -> Callable[[Array, Array, Array], tuple[Array, Array]]:
    """Pinocchio's (a, forces) of one sample."""
    data, datas = theirs.createData(), pin.StdVec_RigidConstraintData()
    for model in models:
        datas.append(model.createData())
    pin.initConstraintDynamics(theirs, data, models, datas)
    settings = pin.ProximalSettings(1e-14, PROXIMAL, 10)

    def solve(q: Array, v: Array, tau: Array) -> tuple[Array, Array]:
        a = pin.constraintDynamics(theirs, data, q, v, tau, models, datas, settings)
        return a, data.lambda_c

    return solve


def check(ours: sd.Model, held: sd.Constraints, solve: Any, q: Array, v: Array, tau: Array) -> tuple[float, float]:
    """Largest relative differences of accelerations and forces over the samples, each over what is allowed."""
    worst = np.zeros(2)
    for k in range(len(q)):
        found = sd.constrained_dynamics(ours, held, q[k], v[k], tau[k])
        a, force = (np.array(x) for x in solve(q[k], v[k], tau[k]))
        n, m = ours.nv, held.nc
        J, whole = sd.constraint_jacobian(ours, held, q[k]), np.zeros((ours.nv + held.nc,) * 2)
        whole[:n, :n], whole[:n, n:], whole[n:, :n] = sd.crba(ours, q[k]), J.T, J
        least = 1e-12 + 100.0 * np.finfo(float).eps * np.linalg.cond(whole)
        worst[0] = max(worst[0], abs(found.a - a).max() / abs(a).max() / least)
        worst[1] = max(worst[1], abs(found.force - force).max() / abs(force).max() / least)
        assert m == found.rank
    return float(worst[0]), float(worst[1])


def per_call(functions: dict[str, tuple[Callable[[], Any], int]]) -> dict[str, tuple[float, float]]:
    """(least, median) nanoseconds of each function's samples, the functions called in turn."""
    found: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(ROUNDS):
        for name, (function, count) in functions.items():
            start = time.perf_counter_ns()
            function()
            found[name].append((time.perf_counter_ns() - start) / count)
    return {name: (min(x), float(np.median(x))) for name, x in found.items()}


def main() -> None:
    """Check, measure, print."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    sd.set_num_threads(1)
    ours, held, theirs, models = pair(str(find_robot(ROBOT)), FEET)
    q, v, tau = states(ours, SAMPLES)
    solve = solver(theirs, models)
    differences = check(ours, held, solve, q[:64], v[:64], tau[:64])
    assert max(differences) <= 1.0, differences
    print("difference from Pinocchio over 1e-12 + 100 eps cond(KKT): a {:.2g}, force {:.2g}".format(*differences))
    few = [(q[k].copy(), v[k].copy(), tau[k].copy()) for k in range(FEW)]
    functions: dict[str, tuple[Callable[[], Any], int]] = {
        "batch": (lambda: sd.constrained_dynamics(ours, held, q, v, tau), SAMPLES),
        "single": (lambda: [sd.constrained_dynamics(ours, held, *x) for x in few], FEW),
        "pin": (lambda: [solve(*x) for x in few], FEW),
        "aba batch": (lambda: sd.aba(ours, q, v, tau), SAMPLES),
    }
    for name, (function, count) in functions.items():
        for _ in range(WARM // count if name == "single" else 20):  # programs are compiled once that pays
            function()
    times = per_call(functions)
    for name, (least, median) in times.items():
        ratios = times["pin"][0] / least, times["pin"][1] / median
        print(
            "{:10} {:9.0f} {:9.0f} ns (least, median), {:6.1f} {:6.1f} times as fast".format(
                name, least, median, *ratios
            )
        )


if __name__ == "__main__":
    main()
