"""``spatialdyn info ROBOT``: links, joints and limits of a robot, oddities of its file; ``info`` lists robots."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from typing import Any

from ..calls.json_numbers import finite_or_none
from ..model.model import Model
from ..model.robot_checks import quoted
from ..pictures.mesh_files import named_meshes
from ..pictures.robot_rows import kinds_of, neutral_outside, tree_rows
from ..urdf.load import robot_names
from .printing import Column, fold, print_table, terminal_width
from .robots import ROBOT, add_package_dirs, add_root, load


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    parser.add_argument("robot", metavar="ROBOT", nargs="?", help=f"{ROBOT} without ROBOT")
    add_root(parser)
    add_package_dirs(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    if arguments.robot is None:
        return _list(arguments.json)
    model = load(arguments)
    if arguments.json:
        print(json.dumps(_record(model, arguments.package_dir), indent=2, ensure_ascii=False))
        return 0
    robot, options = model.robot, model.options
    at_root = {x.name: x.mass for x in robot.links}[robot.root]
    size = f"{model.nv} freedoms (nq {model.nq}), {model.total_mass:.6g} kg that move"
    fold(f"{model.name}: {options.root} root, {size}", "")
    print()
    fold(f"{len(robot.links)}, root link {robot.root} of {at_root:.6g} kg", "links   ")
    fold(f"{len(robot.joints)}: {kinds_of(robot.joints)}", "joints  ")
    fold(f"{len(model.frames)}", "frames  ")
    found = named_meshes(robot.source, arguments.package_dir)
    if found.names:
        lost = f"{len(found.missing)} missing: {quoted(found.missing)}" if found.missing else "none missing"
        lost += f", {len(found.faulty)} broken in part: {quoted(found.faulty)}" if found.faulty else ""
        fold(f"{len(found.names)} of {found.visual} visual and {found.collision} collision shapes, {lost}", "meshes  ")
    print()
    columns = (Column("link"), Column("kg", True), Column("joint"), Column("kind"), Column("v", True))
    rows = list(tree_rows(model))
    widest = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    if sum(widest) + 2 * len(widest) <= terminal_width():
        print_table((*columns, Column("range", True)), rows)
    else:
        _print_narrow(rows)
    outside = list(neutral_outside(model))
    if outside:
        print("\nneutral is outside the limits:")
    for line in outside:
        fold(line, "  - ")
    print("\nodd about the file:" if robot.notes else "\nnothing is odd about the file")
    for note in robot.notes:
        fold(note, "  - ")
    return 0


def _print_narrow(rows: Sequence[Sequence[str]]) -> None:
    """One line per link and one per joint, used if a table would be wider than the terminal."""
    for link, mass, joint, kind, at, span in rows:
        fold(f"{link}  {mass} kg", "")
        if joint:
            words = [f"{joint}: {kind}", *[f"v {at}"] * bool(at), *[span.strip()] * bool(span)]
            fold(", ".join(words), "      ")


def _list(as_json: bool) -> int:
    """Every robot that has a name, and its file."""
    names = {name: str(path) for name, path in robot_names().items()}
    if as_json:
        print(json.dumps(names, indent=2, ensure_ascii=False))
    else:
        print_table((Column("robot"), Column("file")), list(map(list, names.items())))
    return 0


def _record(model: Model, package_dirs: Sequence[str]) -> dict[str, Any]:
    """The output of ``info`` as JSON types; an absent limit is None."""
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
                "lower": finite_or_none(joint.lower),
                "upper": finite_or_none(joint.upper),
                "velocity": finite_or_none(joint.velocity),
                "effort": finite_or_none(joint.effort),
                "mimic": None if joint.mimic is None else joint.mimic.leader,
                "idx_v": places[joint.name].idx_v if joint.name in places else None,
            }
            for joint in robot.joints
        ],
        "meshes": named_meshes(robot.source, package_dirs)._asdict(),
        "neutral_outside_limits": list(neutral_outside(model)),
        "notes": list(robot.notes),
    }
