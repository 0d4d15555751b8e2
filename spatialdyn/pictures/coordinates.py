"""Names, units and limits of coordinates, freedoms and torques, as plots and tables label them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from ..bodies.kinds import ANGLE, PAIR, kind_of
from ..errors import SpatialDynError, literal
from ..model.model import Model
from .inertia_shapes import reach

UNITS = {  # of an angular and of a linear part
    "q": ("rad", "m"), "v": ("rad/s", "m/s"), "p": ("kg m²/s", "kg m/s"), "tau": ("N m", "N"),
}  # fmt: skip
SYMBOLS = {"q": "q", "v": "v", "p": "p", "tau": "τ"}
NORMED = "1"  # unit of quaternions, cosines and sines


class Coordinate(NamedTuple):
    """A column of q, v, p or tau.

    column        its index
    joint         name of the joint, "" without a model
    label         the joint's name, and the part of a joint with several
    unit          in SI
    lower, upper  limits, infinite where there are none
    """

    column: int
    joint: str
    label: str
    unit: str
    lower: float = -math.inf
    upper: float = math.inf


def coordinates(model: Model | None, quantity: str, count: int) -> list[Coordinate]:
    """All columns of "q", "v", "p" or "tau"; without a model they are numbered and their unit is of either kind."""
    angular, linear = UNITS[quantity]
    if model is None:
        return [Coordinate(k, "", f"{SYMBOLS[quantity]}{k}", f"{angular} | {linear}") for k in range(count)]
    return list(_of_positions(model) if quantity == "q" else _of_freedoms(model, quantity))


def _of_positions(model: Model) -> Iterator[Coordinate]:
    angular, linear = UNITS["q"]
    for joint in model.joints[1:]:
        if joint.mimic is not None and model.mimic_matrix is not None:
            continue
        kind = kind_of(joint.kind, model.options.continuous)
        turn = {0: [], ANGLE: ["angle"], PAIR: ["cos", "sin"]}.get(kind.turn, ["qx", "qy", "qz", "qw"])
        parts = [*"xyz"[: kind.lengths], *turn]
        for k, part in enumerate(parts):
            unit = linear if k < kind.lengths else angular if kind.turn == ANGLE else NORMED
            at = joint.idx_q + k
            label = joint.name if len(parts) == 1 else f"{joint.name} {part}"
            yield Coordinate(at, joint.name, label, unit, float(model.lower[at]), float(model.upper[at]))


def _of_freedoms(model: Model, quantity: str) -> Iterator[Coordinate]:
    angular, linear = UNITS[quantity]
    limits = {"v": model.velocity_limit, "tau": model.effort_limit}.get(quantity)
    for joint in model.joints[1:]:
        if joint.mimic is not None and model.mimic_matrix is not None:
            continue
        kind = kind_of(joint.kind, model.options.continuous)
        turning = joint.nv - kind.lengths
        parts = [*"xyz"[: kind.lengths], *([""] if turning == 1 else [f"ω{axis}" for axis in "xyz"[:turning]])]
        if kind.lengths and turning == 1:
            parts[-1] = "ω"
        for k, part in enumerate(parts):
            at = joint.idx_v + k
            limit = math.inf if limits is None else float(limits[at])
            label = joint.name if len(parts) == 1 else f"{joint.name} {part}"
            yield Coordinate(at, joint.name, label, linear if k < kind.lengths else angular, -limit, limit)


def natural_scale(model: Model | None, unit: str) -> float:
    """The scale of a quantity in its unit, from the robot's mass, its reach and one second; 0 without a model."""
    if model is None:
        return 0.0
    length, mass = reach(model.robot), float(model.total_mass)
    factors = {"rad": 0, "m": 1, NORMED: 0, "rad/s": 0, "m/s": 1, "kg m²/s": 2, "kg m/s": 1, "N m": 2, "N": 1, "J": 2}
    return length ** factors[unit] * (mass if unit in (*UNITS["p"], *UNITS["tau"], "J") else 1.0)


def chosen(columns: Sequence[Coordinate], model: Model | None, joints: Any) -> list[Coordinate]:
    """The columns of the named joints, in the order of the model; all for None.

    Raises SpatialDynError if joints is no sequence of names, or there is no model; ModelError for an unknown name.
    """
    if joints is None:
        return list(columns)
    try:
        names = [joints] if isinstance(joints, str) else list(joints)
    except TypeError:
        raise SpatialDynError(f"joints is {literal(joints)}, expected names of joints") from None
    if model is None:
        raise SpatialDynError(
            f"joints is {literal(joints)}, expected None: the trajectory was loaded without its model"
        )
    if not names:
        raise SpatialDynError(f"joints is {literal(joints)}, expected at least one name")
    known = {model.joint(name).name for name in names}
    return [x for x in columns if x.joint in known]


def by_unit(columns: Sequence[Coordinate]) -> dict[str, list[Coordinate]]:
    """{unit: columns}, in the order of the first column of each unit."""
    groups: dict[str, list[Coordinate]] = {}
    for x in columns:
        groups.setdefault(x.unit, []).append(x)
    return groups


def title(quantity: str, unit: str) -> str:
    """The label of an axis."""
    return f"{SYMBOLS[quantity]} [{unit}]" if unit != NORMED else f"{SYMBOLS[quantity]}, of unit norm"
