"""``spatialdyn info ROBOT``: what a robot is made of, and what is odd about its file; ``info`` lists robots by name."""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any

from ..model.model import Model
from ..model.robot import Joint
from ..urdf.load import robot_names
from .printing import Column, finite, fold, print_table
from .robots import ROBOT, add_root, load

DEEP = 60  # columns of a tree's branches: without a limit a comb of n links is n² columns


def add(commands: Any) -> None:
    """Register the command with what argparse's ``add_subparsers`` has given."""
    parser = commands.add_parser("info", help="what a robot is made of, and what is odd about its file")
    parser.add_argument("robot", metavar="ROBOT", nargs="?", help=f"{ROBOT} without ROBOT")
    add_root(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    if arguments.robot is None:
        return _list(arguments.json)
    model = load(arguments)
    if arguments.json:
        print(json.dumps(_record(model), indent=2, ensure_ascii=False))
        return 0
    robot, options = model.robot, model.options
    at_root = {x.name: x.mass for x in robot.links}[robot.root]
    print(
        f"{model.name}: {options.root} root, {model.nv} freedoms (nq {model.nq}), {model.total_mass:.6g} kg that move\n"
    )
    print(f"links   {len(robot.links)}, root link {robot.root} of {at_root:.6g} kg")
    print(f"joints  {len(robot.joints)}: {_kinds(robot.joints)}")
    print(f"frames  {len(model.frames)}\n")
    columns = (Column("link"), Column("kg", True), Column("joint"), Column("kind"), Column("v", True))
    print_table((*columns, Column("range", True)), list(_tree(model)))
    print("\nodd about the file:" if robot.notes else "\nnothing is odd about the file")
    for note in robot.notes:
        fold(note, "  - ")
    return 0


def _list(as_json: bool) -> int:
    """Every robot that has a name, and its file."""
    names = {name: str(path) for name, path in robot_names().items()}
    if as_json:
        print(json.dumps(names, indent=2, ensure_ascii=False))
    else:
        print_table((Column("robot"), Column("file")), list(map(list, names.items())))
    return 0


def _kinds(joints: Iterable[Joint]) -> str:
    """How many joints of each kind, and how many mimic others."""
    joints = list(joints)
    count = Counter(joint.kind for joint in joints)
    mimics = sum(joint.mimic is not None for joint in joints)
    words = [f"{n} {kind}" for kind, n in count.most_common()] + [f"{mimics} of them mimics"] * bool(mimics)
    return ", ".join(words) or "none"


def _tree(model: Model) -> Iterator[list[str]]:
    """A row per link; the only child of a link stands right under it, several are set in, the deepest ones no more."""
    robot = model.robot
    children, links = robot.children, {link.name: link for link in robot.links}
    places = {joint.name: joint for joint in model.joints[1:]}
    base = places.get("root_joint") if model.options.root == "floating" else None
    stack: list[tuple[str, Joint | None, str, str]] = [(robot.root, None, "", "")]
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


def _cut(lead: str) -> str:
    """What stands before a link's name, of a deep one only its last columns."""
    return lead if len(lead) <= DEEP else "…" + lead[1 - DEEP :]


def _span(first: int, count: int) -> str:
    return str(first) if count == 1 else f"{first}-{first + count - 1}"


def _axis(joint: Joint) -> str:
    """The axis if it is one of the coordinate axes, a star if not; nothing where a kind has none."""
    if joint.kind not in ("revolute", "continuous", "prismatic", "planar"):
        return ""
    for letter, column in zip("xyz", range(3), strict=True):
        if abs(joint.axis[column]) == 1.0:
            return f" {'-' if joint.axis[column] < 0.0 else ''}{letter}"
    return " *"


def _range(joint: Joint) -> str:
    if joint.kind == "fixed":
        return ""
    if math.isinf(joint.lower) and math.isinf(joint.upper):
        return "unlimited"
    unit = "m" if joint.kind == "prismatic" else "rad"
    return f"{joint.lower:.4g} .. {joint.upper:.4g} {unit:<3}"


def _record(model: Model) -> dict[str, Any]:
    """What ``info`` says, for machines; an absent limit is null."""
    robot = model.robot
    places = {joint.name: joint for joint in model.joints[1:]}
    return {
        "name": model.name,
        "root": model.options.root,
        "nq": model.nq,
        "nv": model.nv,
        "total_mass": model.total_mass,
        "gravity": model.gravity.tolist(),
        "frames": len(model.frames),
        "root_link": robot.root,
        "links": [{"name": link.name, "mass": link.mass, "com": list(link.com)} for link in robot.links],
        "joints": [
            {
                "name": joint.name,
                "kind": joint.kind,
                "parent": joint.parent,
                "child": joint.child,
                "axis": list(joint.axis),
                "lower": finite(joint.lower),
                "upper": finite(joint.upper),
                "velocity": finite(joint.velocity),
                "effort": finite(joint.effort),
                "mimic": None if joint.mimic is None else joint.mimic.leader,
                "idx_v": places[joint.name].idx_v if joint.name in places else None,
            }
            for joint in robot.joints
        ],
        "notes": list(robot.notes),
    }
