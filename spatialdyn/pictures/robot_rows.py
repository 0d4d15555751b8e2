"""A robot as rows of words: its tree of links and joints, and its oddities."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator

from ..bodies.kinds import kind_of
from ..model.model import Model
from ..model.robot import WITH_AXIS, RobotJoint

DEEP = 60  # columns of a tree's branches: without a limit a comb of n links takes n² columns


def tree_rows(model: Model) -> Iterator[list[str]]:
    """A row per link; an only child is not indented, several children are, except very deep ones."""
    robot = model.robot
    children, links = robot.children, {link.name: link for link in robot.links}
    places = {joint.name: joint for joint in model.joints[1:]}
    base = places.get("root_joint") if model.options.root == "floating" else None
    stack: list[tuple[str, RobotJoint | None, str, str]] = [(robot.root, None, "", "")]
    while stack:
        name, joint, lead, below = stack.pop()
        if joint is None:
            of = ["", "", "", ""] if base is None else ["root_joint", "floating", _span(base.idx_v, 6), "unlimited"]
        else:
            place = places.get(joint.name)
            at = "" if place is None else _span(place.idx_v, place.nv)
            of = [joint.name, joint.kind + _axis(joint), at, _range(joint)]
        yield [lead + name, f"{links[name].mass:.4g}", *of]
        several = len(children[name]) > 1
        for k, child in enumerate(reversed(children[name])):
            branch, under = ("└ ", "  ") if k == 0 else ("├ ", "│ ")
            stack.append((child.child, child, _cut(below + branch * several), _cut(below + under * several)))


def neutral_outside(model: Model) -> Iterator[str]:
    """A line per joint whose neutral coordinate, 0, is outside its limits."""
    for joint in model.joints[1:]:
        lower, upper = model.lower[joint.idx_q], model.upper[joint.idx_q]
        if joint.mimic is None and joint.nq == 1 and not lower <= 0.0 <= upper:
            yield f"{joint.name}: 0 is outside {_interval(lower, upper)} {_unit(joint.kind)}"


def kinds_of(joints: Iterable[RobotJoint]) -> str:
    """How many joints of each kind, and how many mimic others."""
    joints = list(joints)
    count = Counter(joint.kind for joint in joints)
    mimics = sum(joint.mimic is not None for joint in joints)
    words = [f"{n} {kind}" for kind, n in count.most_common()] + [f"{mimics} of them mimics"] * bool(mimics)
    return ", ".join(words) or "none"


def _cut(lead: str) -> str:
    """The branches before a link's name; of a deep one only the last columns."""
    return lead if len(lead) <= DEEP else "…" + lead[1 - DEEP :]


def _span(first: int, count: int) -> str:
    return str(first) if count == 1 else f"{first}-{first + count - 1}"


def _axis(joint: RobotJoint) -> str:
    """The axis if it is one of the coordinate axes, a star if not; nothing where a kind has none."""
    if joint.kind not in WITH_AXIS:
        return ""
    for letter, column in zip("xyz", range(3), strict=True):
        if abs(joint.axis[column]) == 1.0:
            return f" {'-' if joint.axis[column] < 0.0 else ''}{letter}"
    return " *"


def _range(joint: RobotJoint) -> str:
    if joint.kind == "fixed":
        return ""
    if math.isinf(joint.lower) and math.isinf(joint.upper):
        return "unlimited"
    return f"{_interval(joint.lower, joint.upper)} {_unit(joint.kind):<3}"


def _interval(lower: float, upper: float) -> str:
    return f"{lower:.4g} .. {upper:.4g}"


def _unit(kind: str) -> str:
    return "m" if kind_of(kind).motion == "slide" else "rad"
