"""Cost of joint friction in rollouts: steps without, smooth, with bristles and implicit, one thread, one process.

    python benchmarks/friction.py [--quick]

Coulomb's law is asserted first, on every step, by M of ``crba`` and its inverse: the share of steps that are solved to
rounding, and the largest violation, are printed beside the times. Needs ``pip install ".[validate,bench]"``.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from cases import Array, case
from measure import interleaved
from tables import draw

import spatialdyn as sd

ROBOTS = ("ur5", "panda", "anymal", "talos_full")
STATES, STEPS, DT = 256, 100, 1e-3
LOOKED_AT = 20  # states whose steps are checked
SOLVED = {"ur5": 1e-12, "panda": 1e-12, "anymal": 1e-12, "talos_full": 1e-10}  # [rad/s]: eps cond(M) |v|
SHARE = 0.9999  # of the steps, solved to this
WORST = 1e-2  # [rad/s | m/s] of the others
METHOD = "semi_implicit_euler"
WAYS = ("smooth", "lugre", "implicit")


def main() -> None:
    """Check, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer rounds")
    rounds, seconds = (3, 0.05) if parser.parse_args().quick else (15, 0.2)
    sd.set_num_threads(1)
    rows = []
    for name in ROBOTS:
        robot = case(name, STATES)
        model, q, v = robot.ours, robot.state["q"], 0.3 * robot.state["v"]
        friction = friction_of(model)
        slack = sd.Friction(friction.coulomb, 0.0, friction.static, smoothing=1e4)  # stable at this step, of any joint
        tau = sd.generalized_gravity(model, q)[:, None] + np.random.default_rng(7).standard_normal(
            (STATES, STEPS, model.nv)
        )
        solved, worst = coulomb(name, model, q[:LOOKED_AT], v[:LOOKED_AT], tau[:LOOKED_AT], friction)

        def run(way: str | None, model: Any = model, args: Any = (q, v, tau), given: Any = (friction, slack)) -> Any:
            asked = {"friction": False} if way is None else {"friction": given[way == "smooth"], "friction_method": way}
            scene = sd.Scene(model, **asked)
            return lambda: sd.rollout(scene, *args, dt=DT, method=METHOD, check=False, record=STEPS)

        times = interleaved({str(way): run(way) for way in (None, *WAYS)}, rounds, seconds)
        ns = {way: 1e9 * x / (STATES * STEPS) for way, x in times.items()}
        rows.append(
            [name, *(f"{ns[str(way)]:.0f}" for way in (None, *WAYS)), f"{ns['implicit'] / ns['smooth']:.2f}",
             f"{solved:.3%}", f"{worst:.1e}"]
        )  # fmt: skip
    head = ["a step, ns", "none", *WAYS, "implicit / smooth", "solved", "worst [rad/s]"]
    draw("friction", head, rows)


def friction_of(model: sd.Model) -> sd.Friction:
    """Random friction of every joint but a floating base."""
    rng = np.random.default_rng(1)
    coulomb, viscous = rng.uniform(0.1, 1.0, model.nv), rng.uniform(0.0, 0.2, model.nv)
    if model.options.root == "floating":
        coulomb[:6] = viscous[:6] = 0.0
    return sd.Friction(coulomb, viscous, 1.3 * coulomb, 0.05, None, 1e4, 10.0)


def coulomb(name: str, model: sd.Model, q0: Array, v0: Array, tau: Array, friction: sd.Friction) -> tuple[float, float]:
    """The share of the implicit steps that are solved, and the largest violation; AssertionError beyond the bounds."""
    run = sd.rollout(sd.Scene(model, friction=friction), q0, v0, tau, dt=DT, check=False)
    q = np.concatenate([q0[:, None], run.q[:, :-1]], 1)
    v = np.concatenate([v0[:, None], run.v[:, :-1]], 1)
    M, bias, after = sd.crba(model, q), sd.nonlinear_effects(model, q, v), np.array(run.v)
    if model.options.root == "floating":  # a step turns the linear velocity of the base once it is solved
        carried = np.zeros_like(v)
        carried[..., :3] = np.cross(v[..., 3:6], v[..., :3])
        bias = bias - np.einsum("btij,btj->bti", M, carried)
        after[..., :3] = turned(after[..., :3], DT * after[..., 3:6])
    torque = np.einsum("btij,btj->bti", M, after - v) / DT + bias - tau + friction.viscous * after
    weight = 1.0 / np.diagonal(np.linalg.inv(M + DT * np.diag(friction.viscous)), axis1=2, axis2=3)
    _, _, static, fall = friction.law
    level = friction.coulomb + (static - friction.coulomb) * np.exp(-((v / fall) ** 2))
    allowed = np.clip(torque - weight * after / DT, -level, level)
    off = (abs(torque - allowed) * DT / weight).max(axis=2)
    solved, worst = float((off <= SOLVED[name]).mean()), float(off.max())
    assert solved >= SHARE, (name, solved)
    assert worst <= WORST, (name, worst)
    assert (run.v == 0.0).any()
    return solved, worst


def turned(x: Array, w: Array) -> Array:
    """Vectors turned by rotation vectors w (..., 3), by Rodrigues' formula."""
    angle = np.linalg.norm(w, axis=-1, keepdims=True)
    axis = w / np.where(angle > 0.0, angle, 1.0)
    along = np.sum(axis * x, axis=-1, keepdims=True) * axis
    return along + np.cos(angle) * (x - along) + np.sin(angle) * np.cross(axis, x)


if __name__ == "__main__":
    main()
