"""Mechanisms of the tests: four-bars, a slider-crank, wheels; and constraints of every kind on random trees."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from dense import Array
from trees import random_rotation, random_state, random_tree

import spatialdyn as sd

G = 9.81


def rod(length: float, mass: float | None = None) -> tuple[float, Any, Array]:
    """Inertia of a thin rod along x, by default of 1 kg/m."""
    m = length if mass is None else mass
    return m, (length / 2, 0, 0), np.diag([0, m * length**2 / 12, m * length**2 / 12])


def four_bar(a: float = 0.2, b: float = 0.5, c: float = 0.4, d: float = 0.5) -> sd.Model:
    """Crank a and rocker c on the ground, d apart, and the coupler b on the crank; rods of 1 kg/m, gravity along -y."""
    made = sd.ModelBuilder("four_bar")
    made.add_body("crank", None, "revolute", (0, 0, 1), (0, 0, 0), rod(a))
    made.add_body("coupler", "crank", "revolute", (0, 0, 1), (a, 0, 0), rod(b))
    made.add_body("rocker", None, "revolute", (0, 0, 1), (d, 0, 0), rod(c))
    return made.build(gravity=(0, -G, 0))


def pin_of(model: sd.Model, b: float = 0.5, c: float = 0.4, kind: str = "point", **options: Any) -> sd.Constraints:
    """The pin between coupler and rocker of a four-bar."""
    ends = {"at_a": (b, 0, 0), "at_b": (c, 0, 0), "name": "pin", **options}
    held = sd.PointConstraint if kind == "point" else sd.HingeConstraint
    return sd.Constraints(model, [held("coupler", "rocker", **ends)])


def turned_four_bar(seed: int) -> tuple[sd.Model, sd.Constraints]:
    """The same four-bar in a plane askew to all axes: what is out of plane is rounding, not 0."""
    R = random_rotation(np.random.default_rng(seed))

    def inertia(length: float) -> Any:
        m, com, I = rod(length)
        return m, R @ com, R @ I @ R.T

    made, n = sd.ModelBuilder("askew"), R @ [0, 0, 1]
    made.add_body("crank", None, "revolute", n, (0, 0, 0), inertia(0.2))
    made.add_body("coupler", "crank", "revolute", n, R @ [0.2, 0, 0], inertia(0.5))
    made.add_body("rocker", None, "revolute", n, R @ [0.5, 0, 0], inertia(0.4))
    model = made.build(gravity=R @ [0, -G, 0])
    return model, pin_of(model, at_a=R @ [0.5, 0, 0], at_b=R @ [0.4, 0, 0])


def four_bar_state(theta: float = math.pi / 3, rate: float = 2.0) -> tuple[Array, Array]:
    """q and v of the default four-bar at a crank angle and rate."""
    model = four_bar()
    held = pin_of(model)
    coupler, rocker = math.radians(26.6184), math.radians(83.2514)
    q = sd.close_loops(model, held, [theta, coupler - theta, rocker], free=["coupler_joint", "rocker_joint"])
    J, phi = sd.constraint_jacobian(model, held, q)[:2], sd.constraint_error(model, held, q)[:2]
    q[1:] -= np.linalg.solve(J[:, 1:], phi)  # to the last digit
    J = sd.constraint_jacobian(model, held, q)[:2]
    return q, rate * np.concatenate([[1.0], np.linalg.solve(J[:, 1:], -J[:, 0])])


def every_kind(seed: int, floating: bool = True) -> tuple[sd.Model, sd.Constraints, Any]:
    """A random tree with a constraint of every kind, and a state; no loop is closed, which J and drift do not need."""
    made = random_tree(seed, 8, ("revolute", "prismatic", "spherical", "planar", "revolute"), floating=floating)
    model, rng = made.model, np.random.default_rng(seed)
    links = {f.joint: f.name for f in model.frames if f.joint and f.name.startswith("b")}
    a, b, c = (str(x) for x in rng.choice(sorted(links.values()), 3, replace=False))
    one = [j.name for j in model.joints[1:] if j.nq == j.nv == 1]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = random_rotation(rng), rng.normal(size=3)
    items = [
        sd.PointConstraint(a, b, at_a=rng.normal(size=3), at_b=pose),
        sd.PointConstraint(c, axes="zx", at_b=pose),
        sd.WeldConstraint(b, c, at_a=pose),
        sd.WeldConstraint(a, at_b=pose),
        sd.HingeConstraint(a, c, rng.normal(size=3), at_b=rng.normal(size=3)),
        sd.DistanceConstraint(b, a, 0.7, at_a=rng.normal(size=3)),
        sd.CouplerConstraint(one[0], one[-1], -1.5, 0.2),
        sd.VelocityConstraint(rng.normal(size=(2, model.nv))),
        sd.RollingConstraint(a, rng.normal(size=3), 0.2, rng.normal(size=3)),
        sd.RollingConstraint(b, None, 0.3),
    ]
    return model, sd.Constraints(model, items), random_state(made.tree, rng)
