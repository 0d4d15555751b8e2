"""A scene as a text of TOML, without its robot: what ``Scene.to_toml`` writes and ``Scene.from_toml`` reads."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from ..actuation.friction import Friction
from ..actuation.motors import Motor
from ..constraints.contact_points import Contacts, Heightfield, Plane
from ..constraints.kinds import Constraint
from ..constraints.table import Constraints
from ..errors import SimulationError, SpatialDynError, literal
from ..model.model import Model

PLAIN = ("stabilization", "friction_method", "limits", "drive", "fext")  # options that are values
TABLES = ("contacts", "friction", "motor")
GROUNDS = {"plane": Plane, "heightfield": Heightfield}


def write(given: Mapping[str, Any], defaults: Mapping[str, Any]) -> str:
    """The text of a scene's options, without those at their defaults."""
    lines: list[str] = []
    for name in PLAIN:
        value = given[name]
        if value is not None and (name == "fext" or value != defaults[name]):
            lines.append(f"{name} = {_value(value)}")
    friction, motor, contacts, constraints = (given[x] for x in ("friction", "motor", "contacts", "constraints"))
    if isinstance(friction, bool):
        lines.append(f"friction = {_value(friction)}")
    tables: dict[str, dict[str, Any]] = {}
    if isinstance(friction, Friction):
        tables["friction"] = _fields(friction)
    if motor is not None:
        tables["motor"] = _fields(motor)
    if contacts is not None:
        tables["contacts"] = {"tolerance": contacts.tolerance, "steps": contacts.steps, "rounds": contacts.rounds}
        for name, of_points in (("points", contacts.radii), ("friction", contacts.friction.tolist()),
                                ("restitution", contacts.restitution.tolist())):  # fmt: skip
            tables[f"contacts.{name}"] = dict(zip(contacts.names, of_points, strict=True))
        ground = contacts.terrain
        kind = "plane" if isinstance(ground, Plane) else "heightfield"
        parts = ("normal", "height") if kind == "plane" else ("z", "spacing", "origin")
        tables["contacts.terrain"] = {"kind": kind, **{x: getattr(ground, x) for x in parts}}
    for name, entries in tables.items():
        lines += ["", f"[{name}]", *(f"{_key(x)} = {_value(y)}" for x, y in entries.items())]
    for x in constraints if constraints is not None else ():
        kind = type(x).__name__.removesuffix("Constraint").lower()
        lines += ["", "[[constraint]]", f"kind = {_value(kind)}", *(f"{k} = {_value(y)}" for k, y in _of(x).items())]
    return "\n".join(lines).strip() + "\n" if lines else ""


def read(model: Model, text: str) -> dict[str, Any]:
    """The options of a scene of this model. Raises SpatialDynError before Python 3.11, which cannot read TOML;
    SimulationError for any other text, naming the key; otherwise the errors of its parts.
    """
    try:
        import tomllib
    except ImportError:
        raise SpatialDynError("a scene in TOML needs Python 3.11, expected sd.Scene(model, ...)") from None
    if not isinstance(text, str):
        raise SimulationError(f"TOML is a {type(text).__name__}, expected its text")
    try:
        given = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise SimulationError(f"the scene is no TOML: {error}, expected a text and no {literal(text):.60}") from None
    return options_of(model, given)


def options_of(model: Model, given: Mapping[str, Any]) -> dict[str, Any]:
    """The options of a scene of this model, given as the tables that a TOML text has. Raises as ``read``."""
    known = (*PLAIN, *TABLES, "constraint")
    for name in given:
        if name not in known:
            raise SimulationError(f"the scene in TOML has {name}, expected some of {', '.join(known)}")
    found = {name: given[name] for name in PLAIN if name in given}
    if "friction" in given:
        friction = given["friction"]
        found["friction"] = friction if isinstance(friction, bool) else _made("friction", Friction, friction)
    if "motor" in given:
        found["motor"] = _made("motor", Motor, given["motor"])
    if "contacts" in given:
        options = ("points", "friction", "restitution", "terrain", "tolerance", "steps", "rounds")
        entries = _table("contacts", given["contacts"], options)
        if "points" not in entries:
            raise SimulationError("[contacts] of the scene lacks points, expected {frame = radius}")
        if "terrain" in entries:
            ground = _table(
                "contacts.terrain", entries["terrain"], ("kind", "normal", "height", "z", "spacing", "origin")
            )
            kind = GROUNDS.get(str(ground.pop("kind", None)))
            if kind is None:
                raise SimulationError(f"[contacts.terrain] has no kind of {', '.join(GROUNDS)}, expected one")
            entries["terrain"] = _called("contacts.terrain", kind, ground)
        found["contacts"] = Contacts(model, **entries)
    if "constraint" in given:
        found["constraints"] = Constraints.of_entries(model, given["constraint"])
    return found


def _table(name: str, given: Any, known: tuple[str, ...]) -> dict[str, Any]:
    """A copy of a table. Raises SimulationError for another value, and unknown keys."""
    if not isinstance(given, dict):
        raise SimulationError(f"{name} of the scene is {literal(given)}, expected a table [{name}]")
    unknown = [x for x in given if x not in known]
    if unknown:
        raise SimulationError(f"[{name}] of the scene has {unknown[0]}, expected some of {', '.join(known)}")
    return dict(given)


def _made(name: str, kind: Any, given: Any) -> Any:
    """A record of a table of its fields."""
    return _called(name, kind, _table(name, given, tuple(x.name for x in fields(kind))))


def _called(name: str, kind: Any, given: dict[str, Any]) -> Any:
    try:
        return kind(**given)
    except TypeError as error:
        raise SimulationError(f"[{name}] of the scene: {error}") from None


def _fields(given: Any) -> dict[str, Any]:
    """The fields that a record has."""
    return {x.name: y for x in fields(given) if (y := getattr(given, x.name)) is not None}


def _of(x: Constraint) -> dict[str, Any]:
    """The fields of a constraint that are not their defaults."""
    return {field.name: y for field in fields(x) if (y := getattr(x, field.name)) is not None}


def _key(name: str) -> str:
    return json.dumps(name, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(x: Any) -> str:
    """A value in TOML; numbers so that they are read to the same bits."""
    if isinstance(x, (bool, np.bool_)):
        return "true" if x else "false"
    if isinstance(x, str):
        return _key(x)
    if isinstance(x, (int, np.integer)):
        return str(int(x))
    if isinstance(x, (float, np.floating)):
        return repr(float(x))
    if isinstance(x, Mapping):
        return "{" + ", ".join(f"{_key(k)} = {_value(y)}" for k, y in x.items()) + "}"
    return "[" + ", ".join(_value(y) for y in (x.tolist() if isinstance(x, np.ndarray) else x)) + "]"
