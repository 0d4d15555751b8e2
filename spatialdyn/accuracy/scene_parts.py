"""The parts of a scene that a motion may not need: each left out or in a cheaper form."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..constraints.contact_dynamics import contact_gaps
from ..model.assembly import ROOT_JOINT
from ..model.model import Model
from ..simulation.effects.springs import has_springs
from ..simulation.scene import Scene
from .lesser_scenes import Choice, armatures

Array = NDArray[np.float64]
EFFECTS, JOINTS, LINKS, PRECISION, METHODS = KINDS = ("effects", "joints", "links", "precision", "methods")
PARTS = (
    "limits", "contacts", "constraints", "fext", "friction", "motor", "rotors", "armatures", "springs", "gravity",
)  # fmt: skip
LIGHT = 0.02  # share of a robot's mass below which a subtree is light
NEAR = 1e-4  # [m | rad] distance below which a limit is reached
TOUCHES = 1e-4  # [m] distance below which a point touches the ground


class Candidate(NamedTuple):
    """A part and its cheaper form.

    part, form  in words
    choice      the parts that are left out
    rank        a form of higher rank is tried only if all forms of lower ranks change too much
    simpler     whether it is taken even if it saves no time
    """

    part: str
    form: str
    choice: Choice
    rank: int = 0
    simpler: bool = True


def candidates(scene: Scene, q: Array, kinds: tuple[str, ...]) -> list[Candidate]:
    """All candidates of a scene, joints locked as they are at q (nq,)."""
    found = [x for x in _effects(scene) if EFFECTS in kinds or x.part in kinds]
    light = _light(scene.model, 2 if JOINTS in kinds else 1) if LINKS in kinds else {}
    found += [
        Candidate(f'links from "{name}" on', f"merged, {mass:.2g} kg", Choice(locked=_locked(scene.model, names, q)))
        for name, (mass, names) in light.items()
    ]
    if JOINTS in kinds:
        for joint in scene.model.joints[1:]:
            if joint.name == ROOT_JOINT or joint.mimic is not None or _is_rotor(scene.model, joint.name):
                continue
            names = _followed(scene.model, joint.name)
            found.append(Candidate(f'joint "{joint.name}"', "locked", Choice(locked=_locked(scene.model, names, q))))
    return found


def _effects(scene: Scene) -> list[Candidate]:
    model, friction = scene.model, scene.friction
    found = []
    for name in ("limits", "contacts", "constraints", "fext"):
        if name in scene.acts:
            found.append(Candidate(name, "left out", Choice(without=frozenset([name]))))
    points = () if scene.contacts is None else scene.contacts.names
    for name in points if len(points) > 1 else ():
        found.append(Candidate("contacts", f'without "{name}"', Choice(points=frozenset([name])), 1))
    if friction is not None and not isinstance(friction, bool):
        found.append(Candidate("friction", "left out", Choice(friction="none")))
        if friction.static.any() and friction.viscous.any():
            found.append(Candidate("friction", "viscous alone", Choice(friction="viscous"), 1))
        if scene.friction_method == "lugre":
            found.append(Candidate("friction", "Coulomb's, without bristles", Choice(friction="coulomb"), 2))
    if scene.motor is not None:
        found.append(Candidate("motor", "left out", Choice(without=frozenset(["motor"]))))
        found.append(Candidate("motor", "without limits", Choice(motor="unlimited"), 1, simpler=False))
    exact = any(j.rotor is not None and j.spring is None and j.shared is None for j in model.robot.joints)
    if exact:
        found.append(Candidate("rotors", "left out", Choice(rotors="none")))
        found.append(Candidate("rotors", "armatures", Choice(rotors="armature"), 1))
    elif armatures(model):
        found.append(Candidate("armatures", "left out", Choice(rotors="none")))
    if has_springs(model):
        found.append(Candidate("springs", "rigid", Choice(rigid=True)))
    if model.gravity.any():
        found.append(Candidate("gravity", "left out", Choice(weightless=True)))
    return found


def _is_rotor(model: Model, name: str) -> bool:
    return any(j.name == name and j.spring is not None for j in model.robot.joints)


def _followed(model: Model, name: str) -> list[str]:
    """The joints that are locked together: a joint, its mimic joints, and the rotor of its spring."""
    names = [name]
    if model.mimic_matrix is not None:
        k = model.names.index(name)
        names += [j.name for j in model.joints[1:] if j.mimic is not None and j.mimic[0] == k]
    return names + [j.name for j in model.robot.joints if j.spring is not None and j.spring.joint in names]


def _locked(model: Model, names: list[str], q: Array) -> dict[str, Any]:
    """{joint: coordinates} at q."""
    found: dict[str, Any] = {}
    for name in names:
        joint = model.joint(name)
        value = q[joint.idx_q : joint.idx_q + joint.nq]
        if joint.mimic is not None:
            leader, ratio, offset = joint.mimic
            value = ratio * q[model.joints[leader].idx_q : model.joints[leader].idx_q + 1] + offset
        found[name] = float(value[0]) if joint.nq == 1 or joint.mimic is not None else value.tolist()
    return found


def _light(model: Model, least: int) -> dict[str, tuple[float, list[str]]]:
    """{joint: (mass, joints)} of light subtrees of at least ``least`` joints, without subtrees inside them.

    A subtree counts if no joint outside it mimics one inside, nor the other way round.
    """
    pairs = [(j.name, model.joints[j.mimic[0]].name) for j in model.joints[1:] if j.mimic is not None]
    mass = model.bodies["inertia"]["m"][[j.row for j in model.joints]].copy()
    below: list[list[str]] = [[j.name] for j in model.joints]
    for k in range(model.njoints - 1, 0, -1):
        parent = model.joints[k].parent
        mass[parent] += mass[k]
        below[parent] += below[k]
    found: dict[str, tuple[float, list[str]]] = {}
    inside: set[str] = set()
    for k in range(1, model.njoints):
        name = model.joints[k].name
        rotor = any(_is_rotor(model, x) for x in below[k])
        tied = any((x in below[k]) != (leader in below[k]) for x, leader in pairs)
        light = mass[k] < LIGHT * model.total_mass and name != ROOT_JOINT and not rotor and not tied
        if light and len(below[k]) >= least and name not in inside:
            found[name] = float(mass[k]), sorted(below[k])
            inside |= set(below[k])
    return found


def why(scene: Scene, candidate: Candidate, q: Array, v: Array) -> str:
    """A remark on a part from the motion (samples, records, ...), in words; "" if there is none."""
    model, part = scene.model, candidate.part
    if part == "limits":
        stops = scene.unilateral
        if not stops.stops:
            return "no joint has limits"
        rows = stops.table.rows[1 + len(stops) :]
        x = q[..., rows["q_index"]]
        room = np.minimum(x - rows["lower"], rows["upper"] - x).min(axis=(0, 1))
        k = int(np.argmin(room))
        near, name = float(room[k]), stops.stops[k]
        return f'reached by "{name}"' if near < NEAR else f'never nearer than {near:.2g}, of "{name}"'
    if part == "contacts" and scene.contacts is not None:
        gaps = contact_gaps(model, scene.contacts, q).min(axis=(0, 1))
        near = float(
            gaps[[k for k, x in enumerate(scene.contacts.names) if candidate.form in ("left out", _without(x))]].min()
        )
        return "touches the ground" if near < TOUCHES else f"never nearer than {near:.2g} m"
    if part == "friction" and not isinstance(scene.friction, bool) and scene.friction is not None:
        torque = (scene.friction.static + scene.friction.viscous * abs(v).max(axis=(0, 1))).max()
        return f"up to {torque:.2g} N m or N"
    if candidate.choice.locked:
        joints = [j for j in model.joints[1:] if j.name in candidate.choice.locked and j.mimic is None]
        way = max(float(np.ptp(q[..., j.idx_q : j.idx_q + j.nq], axis=1).max()) for j in joints)
        return f"moves by {way:.2g}"
    return ""


def touches(scene: Scene, candidate: Candidate, q: Array) -> bool:
    """Whether a candidate leaves out single points of contact and one of them touches the ground in a motion."""
    if not candidate.choice.points or scene.contacts is None:
        return False
    gaps = contact_gaps(scene.model, scene.contacts, q).min(axis=(0, 1))
    return any(gaps[scene.contacts.names.index(x)] < TOUCHES for x in candidate.choice.points)


def _without(name: str) -> str:
    return f'without "{name}"'
