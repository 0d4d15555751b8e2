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


# --- mechanisms with more equations than independent ones -----------------------------------------------


def _turn(axis: int, angle: float) -> Array:
    """A pose (4, 4) that turns about x or z."""
    c, s, i = math.cos(angle), math.sin(angle), [(1, 2), None, (0, 1)][axis]
    made = np.eye(4)
    assert i is not None
    made[np.ix_(i, i)] = [[c, -s], [s, c]]
    return made


def _link(length: float, twist: float) -> Array:
    """From a joint's frame, its axis z, to the next joint's: along x, then turned about it."""
    made = _turn(0, twist)
    made[0, 3] = length
    return made


def _spatial_chain(links: list[tuple[float, float]]) -> tuple[sd.Model, sd.Constraints]:
    """A loop of links (length, twist), the first of them the ground, cut at its last joint, which a hinge closes."""
    made, at, under = sd.ModelBuilder("loop"), _link(*links[0]), None
    for k, (length, _) in enumerate(links[1:]):
        mass, com, I = rod(length)
        body = (mass, com, I + 1e-3 * mass * np.eye(3))
        made.add_body(f"link{k}", under, "revolute", (0, 0, 1), at, body)
        at, under = _link(*links[k + 1]), f"link{k}"
    model = made.build(gravity=(0, -0.6 * G, -0.8 * G))
    return model, sd.Constraints(model, [sd.HingeConstraint(str(under), None, (0, 0, 1), at_a=at, name="pin")])


def bennett(rate: float = 2.0) -> tuple[sd.Model, sd.Constraints, Array, Array]:
    """Bennett's loop of four revolute axes, a / sin α = b / sin β: one velocity is free, Grübler counts -2."""
    a, b, alpha = 0.5, 0.3, math.radians(70.0)
    beta = math.asin(b / a * math.sin(alpha))
    model, held = _spatial_chain([(a, alpha), (b, beta), (a, alpha), (b, beta)])
    q = sd.close_loops(model, held, [1.2, 1.0, -1.2])
    return model, held, *_start(model, held, q, rate)


def bricard(rate: float = 2.0) -> tuple[sd.Model, sd.Constraints, Array, Array]:
    """Bricard's threefold-symmetric loop of six revolute axes at right angles: one velocity is free, Grübler's 0."""
    links = [(0.3, math.pi / 2 if k % 2 else -math.pi / 2) for k in range(6)]
    model, held = _spatial_chain(links)
    first = 1.5
    q = sd.close_loops(model, held, [first, 2.3, first, 2.3, first])
    return model, held, *_start(model, held, q, rate)


def three_cranks(rate: float = 1.5) -> tuple[sd.Model, sd.Constraints, Array, Array]:
    """A plate on three equal cranks: any two of them lead it. Singular values of J M^-1/2 are far apart."""
    r, pivots = 0.2, np.array([[0.0, 0.0], [0.6, 0.1], [0.25, 0.4]])
    made = sd.ModelBuilder("three_cranks")
    made.add_body("crank0", None, "revolute", (0, 0, 1), (0, 0, 0), rod(r))
    plate = 1.0, (0.28, 0.17, 0), np.diag([0.02, 0.03, 0.05])
    made.add_body("plate", "crank0", "revolute", (0, 0, 1), (r, 0, 0), plate)
    pins = []
    for k in (1, 2):
        made.add_body(f"crank{k}", None, "revolute", (0, 0, 1), (*pivots[k], 0), rod(r))
        ends = {"at_a": (*pivots[k], 0), "at_b": (r, 0, 0)}
        pins.append(sd.PointConstraint("plate", f"crank{k}", axes="xy", name=f"pin{k}", **ends))
    model = made.build(gravity=(0, -G, 0))
    names = [j.name for j in model.joints[1:]]
    q = np.array([{"plate_joint": -0.6}.get(name, 0.6) for name in names])
    held = sd.Constraints(model, pins)
    return model, held, *_start(model, held, sd.project_configuration(model, held, q), rate)


def double_parallelogram(rate: float = 2.0) -> tuple[sd.Model, sd.Constraints, Array, Array]:
    """Three parallel bars of .3 m on a coupler, as pins in space: six equations, of which three are independent."""
    made = sd.ModelBuilder("double_parallelogram")
    made.add_body("bar0", None, "revolute", (0, 0, 1), (0, 0, 0), rod(0.3))
    made.add_body("coupler", "bar0", "revolute", (0, 0, 1), (0.3, 0, 0), rod(0.8))
    for k, x in ((1, 0.5), (2, 0.8)):
        made.add_body(f"bar{k}", None, "revolute", (0, 0, 1), (x, 0, 0), rod(0.3))
    model = made.build(gravity=(0, -G, 0))
    pins = [
        sd.PointConstraint("coupler", f"bar{k}", at_a=(x, 0, 0), at_b=(0.3, 0, 0), name=f"pin{k}")
        for k, x in ((1, 0.5), (2, 0.8))
    ]
    names, down = [j.name for j in model.joints[1:]], -math.pi / 2 + 0.6
    q = np.array([{"coupler_joint": -down}.get(name, down) for name in names])
    held = sd.Constraints(model, pins)
    return model, held, *_start(model, held, sd.project_configuration(model, held, q), rate)


REDUNDANT = {
    "bennett": bennett,
    "bricard": bricard,
    "three_cranks": three_cranks,
    "parallelogram": double_parallelogram,
}


def _start(model: sd.Model, held: sd.Constraints, q: Array, rate: float) -> tuple[Array, Array]:
    """q, and the velocity in the null space of J, to rounding, in which the first joint turns at a rate."""
    for _ in range(3):
        J = sd.constraint_jacobian(model, held, q)
        q = q - np.linalg.pinv(J, rcond=1e-9) @ sd.constraint_error(model, held, q)
    free = np.linalg.svd(sd.constraint_jacobian(model, held, q))[2][-1]
    return q, rate * free / free[0]


def slider_crank(theta: float = 0.6, rate: float = 3.0) -> tuple[sd.Model, sd.Constraints, Array, Array]:
    """A crank and a rod of the same length, its end on a line through the crank's pivot: folded at 90 degrees.

    There the slider is at the pivot, and the mechanism may go on in two ways: the slider moves through, x = 2 r cos θ,
    or the rod turns with the crank.
    """
    made = sd.ModelBuilder("slider_crank")
    made.add_body("crank", None, "revolute", (0, 0, 1), (0, 0, 0), rod(0.3))
    made.add_body("rod", "crank", "revolute", (0, 0, 1), (0.3, 0, 0), rod(0.3))
    made.add_body("slider", None, "prismatic", (1, 0, 0), (0, 0, 0), (0.4, (0, 0, 0), 1e-3 * np.eye(3)))
    model = made.build(gravity=(0, 0, -G))
    held = sd.Constraints(model, [sd.PointConstraint("rod", "slider", axes="xy", at_a=(0.3, 0, 0), name="pin")])
    at = {"crank_joint": (theta, 1.0), "rod_joint": (-2.0 * theta, -2.0)}
    at["slider_joint"] = 0.6 * math.cos(theta), -0.6 * math.sin(theta)
    names = [j.name for j in model.joints[1:]]
    return model, held, np.array([at[x][0] for x in names]), rate * np.array([at[x][1] for x in names])
