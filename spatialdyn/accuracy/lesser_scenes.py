"""A scene with parts left out or in a cheaper form: the scene, the map of its states to the whole scene's, its code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..actuation.friction import Friction
from ..actuation.motors import Motor
from ..constraints.contact_points import Contacts
from ..constraints.table import Constraints
from ..errors import SimulationError
from ..model.model import Model
from ..simulation.scene import Scene
from .embedding import Embedding

Array = NDArray[np.float64]
CONSTRAINTS = "sd.Constraints(model, scene.constraints)"
ABOVE = 1e6  # times the voltage of a motor: limits that no run reaches
BOUND = ("constraints", "contacts")  # effects that belong to one model


@dataclass(frozen=True)
class Choice:
    """The parts of a scene that are left out or take a cheaper form; "" and empty: as in the scene.

    without   names of effects: limits, contacts, constraints, motor, fext
    points    frames of contact points
    friction  "coulomb" in place of bristles, "viscous" or "none"
    motor     "unlimited"
    rotors    "armature" in place of exact rotors, or "none"
    locked    {joint: coordinates}
    """

    without: frozenset[str] = frozenset()
    points: frozenset[str] = frozenset()
    friction: str = ""
    motor: str = ""
    rotors: str = ""
    rigid: bool = False
    weightless: bool = False
    locked: Mapping[str, Any] = field(default_factory=dict)

    def __or__(self, other: Choice) -> Choice:
        """Both choices; if they have two forms of one effect, that of ``other``."""
        return Choice(
            self.without | other.without, self.points | other.points, other.friction or self.friction,
            other.motor or self.motor, other.rotors or self.rotors, self.rigid or other.rigid,
            self.weightless or other.weightless, {**self.locked, **other.locked},
        )  # fmt: skip


@dataclass(frozen=True)
class Lesser:
    """A scene of a Choice: the Scene, its Embedding, and lines of code that make ``lesser`` from ``scene``."""

    scene: Scene
    embedding: Embedding
    lines: tuple[str, ...]


def lesser(scene: Scene, choice: Choice, q: Array) -> Lesser:
    """The scene of a choice; q (nq,) is a state of the whole robot.

    Raises  what the models and effects raise that cannot be made so
    """
    model, lines = _model(scene.model, choice)
    at = Embedding.of(scene.model, model, choice.locked, choice.rigid, q)
    changes: dict[str, Any] = {}
    words: dict[str, str] = {}
    for name in sorted(choice.without):
        changes[name] = False if name == "limits" else None
        words[name] = repr(changes[name])
    left = {name: None if name in choice.without else getattr(scene, name) for name in (*BOUND, "motor", "fext")}
    if choice.friction and scene.friction not in (None, False):
        changes["friction"], words["friction"] = _friction(scene.friction, choice.friction)
        changes["friction_method"] = "smooth" if scene.friction_method == "smooth" else "implicit"
        if choice.friction == "none":
            changes["friction_method"] = "implicit"
        if changes["friction_method"] != scene.friction_method:
            words["friction_method"] = repr(changes["friction_method"])
    if choice.motor and left["motor"] is not None:
        m = left["motor"]
        changes["motor"] = Motor(m.torque_constant, m.resistance, ABOVE * m.voltage, m.ratio, m.back_emf,
                                 efficiency=m.efficiency)  # fmt: skip
        m = "scene.motor"
        words["motor"] = (
            f"sd.Motor({m}.torque_constant, {m}.resistance, {ABOVE:g} * {m}.voltage, {m}.ratio, {m}.back_emf, "
            f"efficiency={m}.efficiency)"
        )
    points = left["contacts"]
    if points is not None and (choice.points or model is not scene.model):
        changes["contacts"], words["contacts"] = _contacts(points, model, choice.points)
    if left["constraints"] is not None and model is not scene.model:
        changes["constraints"], words["constraints"] = Constraints(model, left["constraints"]), CONSTRAINTS
    if model is not scene.model:
        changes["model"], words["model"] = model, "model"
    if not at.whole:
        _lessen(scene, at, changes, words)
        lines += [f"keep_q, keep_v = {at.in_q.tolist()}, {at.in_v.tolist()}"]
    if not changes:
        return Lesser(scene, at, ("lesser = scene",))
    given = ", ".join(f"{name}={word}" for name, word in words.items())
    return Lesser(scene.with_(**changes), at, (*lines, f"lesser = scene.with_({given})"))


def _model(model: Model, choice: Choice) -> tuple[Model, list[str]]:
    """The model of a choice, the same object if it does not change, and the lines of code that make it."""
    made, lines = model, ["model = scene.model"]
    if choice.rigid:
        made = made.rigid()
        lines.append("model = model.rigid()")
    if choice.rotors:
        exact = [j for j in made.robot.joints if j.rotor is not None and j.spring is None and j.shared is None]
        if exact:
            none = dict.fromkeys((j.name for j in exact), None)
            made = made.with_(rotors=none)
            lines.append(f"model = model.with_(rotors={none})")
        if choice.rotors == "armature":
            simple: dict[str, Any] = {j.name: j.armature for j in exact}
        else:
            simple = {name: 0.0 for name in armatures(made)}
        if simple:
            made = made.with_(armature=simple)
            lines.append(f"model = model.with_(armature={simple})")
    if choice.weightless:
        made = made.with_(gravity=(0.0, 0.0, 0.0))
        lines.append("model = model.with_(gravity=(0.0, 0.0, 0.0))")
    locked = choice.locked
    if choice.rigid:
        springs = {j.name for j in model.robot.joints if j.spring is not None}
        locked = {name: x for name, x in locked.items() if name not in springs}
    if locked:
        made = made.reduced(locked)
        lines.append(f"model = model.reduced({dict(locked)})")
    return made, lines if made is not model else []


def armatures(model: Model) -> list[str]:
    """Joints whose armature is that of no rotor and no transmission."""
    shared = {j.shared[0] for j in model.robot.joints if j.shared is not None}
    return [
        j.name for j in model.robot.joints
        if np.any(j.armature) and j.rotor is None and j.shared is None and j.name not in shared
    ]  # fmt: skip


def _friction(friction: Any, form: str) -> tuple[Any, str]:
    """Friction in a cheaper form, and its code."""
    if form == "none":
        return False, "False"
    if form == "viscous":
        smooth = friction.smoothing
        more = "" if smooth is None else ", smoothing=scene.friction.smoothing"
        return Friction(
            viscous=friction.viscous, smoothing=smooth
        ), f"sd.Friction(viscous=scene.friction.viscous{more})"
    kept = ("coulomb", "viscous", "static", "stribeck_velocity")
    given = {x.name: getattr(friction, x.name) for x in fields(friction) if x.name in kept}
    words = ", ".join(f"{name}=scene.friction.{name}" for name, x in given.items() if x is not None)
    return Friction(**given), f"sd.Friction({words})"


def _contacts(contacts: Contacts, model: Model, out: frozenset[str]) -> tuple[Contacts | None, str]:
    """The contacts on a model without some points, and their code."""
    keep = [k for k, name in enumerate(contacts.names) if name not in out]
    if not keep:
        return None, "None"
    parts = [
        {contacts.names[k]: float(x[k]) for k in keep}
        for x in (contacts.radii, contacts.friction, contacts.restitution)
    ]
    solver = ("terrain", "tolerance", "steps", "rounds")
    kept: dict[str, Any] = {name: getattr(contacts, name) for name in solver}
    made = Contacts(model, parts[0], parts[1], parts[2], **kept)
    ground = ", ".join(f"{name}=scene.contacts.{name}" for name in solver)
    of = "model" if model is not contacts.model else "scene.model"
    return made, f"sd.Contacts({of}, {', '.join(map(repr, parts))}, {ground})"


def _lessen(scene: Scene, at: Embedding, changes: dict[str, Any], words: dict[str, str]) -> None:
    """Coefficients and forces of the remaining freedoms and joints. Raises SimulationError for lost forces."""
    small, nv = changes["model"], scene.model.nv
    friction = changes.get("friction", scene.friction)
    if isinstance(friction, Friction):
        changes["friction"] = made = _friction_of(friction.check(scene.model), at, nv)
        words["friction"] = _written("Friction", made)
    motor = changes.get("motor", scene.motor)
    if motor is not None:
        changes["motor"] = of_motor = _motor_of(motor.check(scene.model), at, nv)
        words["motor"] = _written("Motor", of_motor)
    if scene.fext is not None and "fext" not in changes:
        rows = [scene.model.names.index(name) for name in small.names]
        lost = np.delete(scene.fext, rows, axis=0)
        if lost.any():
            raise SimulationError("fext acts on a joint that is locked, expected none there")
        changes["fext"], words["fext"] = scene.fext[rows], f"scene.fext[{rows}]"


def _friction_of(friction: Friction, at: Embedding, nv: int) -> Friction:
    E = abs(at.matrix(nv))
    given: dict[str, Any] = {}
    for x in fields(friction):
        value = getattr(friction, x.name)
        if value is not None:
            summed = {"coulomb": E, "static": E, "viscous": E * E}.get(x.name)
            given[x.name] = value[at.in_v] if summed is None else summed.T @ value
    return Friction(**given)


def _motor_of(motor: Motor, at: Embedding, nv: int) -> Motor:
    """The motors of a model with rigid springs: such a joint gets its rotor's motor, through the gear."""
    source, gear = at.in_v.copy(), np.ones(len(at.in_v))
    for _, _, rotor, joint, n in at.turns:
        k = int(np.flatnonzero(at.in_v == joint)[0])
        source[k], gear[k] = rotor, n
    given = {x.name: np.broadcast_to(getattr(motor, x.name), nv)[source] for x in fields(motor)}
    return Motor(**{**given, "ratio": given["ratio"] * gear, "torque": given["torque"] * abs(gear)})


def _written(name: str, made: Any) -> str:
    """A record of arrays as code, to the same bits."""

    def value(x: Array) -> str:
        return "[" + ", ".join(f'float("{y}")' if not np.isfinite(y) else repr(float(y)) for y in x) + "]"

    given = ", ".join(f"{x.name}={value(y)}" for x in fields(made) if (y := getattr(made, x.name)) is not None)
    return f"sd.{name}({given})"
