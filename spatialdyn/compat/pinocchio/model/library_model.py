"""The library's Model behind a Model of this face, made when it is first asked for after an edit.

``model._made`` and ``model._placed`` are None from an edit on until ``made`` and ``placed`` are called; callers in a
hurry write ``model._made or made(model)``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....bodies.joints import ROUNDING
from ....calls.arguments import core_shape
from ....calls.failures import unit_part
from ....engines.compiled.cpython import READY, refused
from ....errors import ModelError
from ....interop.pinocchio import check_depth_first, fresh_name
from ....model.assembly import Options
from ....model.model import Model as Compiled
from ....model.robot import Joint as RobotJoint
from ....model.robot import Link, Mimic, Robot, make_joint, make_link
from ....model.update import edited
from ....recursions import SPECS
from ...native import recorded_calls
from ..coverage.strictness import strict
from ..types.inertia import Inertia
from .joint_mimic import JointModelMimic
from .model import Model

Array = NDArray[np.float64]
Places = NDArray[np.intp]
ROOT = "universe"


class Given(NamedTuple):
    """What of a Model a Made depends on: inertias, placements, armature, gravity; and whether norms are checked."""

    inertias: Array
    placements: Array
    armature: Array
    gravity: Array
    strict: bool


class Made:
    """What a Model is to the library.

    model   the library's Model: same q, v and armature, ``continuous="cos_sin"``
    rows    (njoints,) row of its table that carries each joint's body; 0 for the universe
    joints  None if its joints are one to one this model's; else (njoints,) which of them carries each joint's body

    Calls of the library for one sample are attributes, as builtins: ``made.integrate(q, v)``, None if it has to be
    asked in another way.
    """

    def __init__(self, model: Compiled, places: Places, given: Given) -> None:
        """Of the library's model, which of its joints carries each joint's body, and what it was made from."""
        self.model, self.given = model, given
        self.places = places
        self.rows = np.array([model.joints[k].row for k in places], np.intp)
        self.joints = None if model.njoints == len(places) else places
        self.frames: Placed | None = None  # of joints_as_frames
        firsts = [(joint, model.bodies[joint.row - joint.nv + 1]) for joint in model.joints[1:]]
        parts = [unit_part(int(first["kind"]), joint.idx_q) for joint, first in firsts]
        self.units = [part for part in parts if part is not None]  # quaternions and pairs in q

    def edited(self, model: Compiled, given: Given) -> Made:
        """The same for a model of the same tree."""
        found = Made.__new__(Made)
        found.__dict__.update({name: self.__dict__[name] for name in ("places", "rows", "joints", "frames", "units")})
        found.model, found.given = model, given
        return found

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name not in SPECS:
            raise AttributeError(f"no call {name!r}")
        call: Callable[..., Any] = refused
        if self.whole:
            axes = {f"axis{k}": n for k, n in enumerate(core_shape(self.model, SPECS[name].output) or (1,))}
            call = recorded_calls.made(name).bind(self.model, **self.words, **axes)
        self.__dict__[name] = call
        return call

    def off_norm(self, q: Array) -> bool:
        """Whether a quaternion or pair of q is off its unit norm by more than rounding, and is taken so."""
        return self.model.options.any_norm and any(
            abs(part @ part - 1.0) > ROUNDING for part in (q[unit] for unit in self.units)
        )

    @property
    def whole(self) -> bool:
        """Whether compiled code can be given the arrays of its users as they are."""
        return READY and self.model.mimic_matrix is None

    @property
    def words(self) -> dict[str, int]:
        """What the plan of a builtin has to say of the model."""
        model = self.model
        return {"table": model.address, "nq": model.nq, "nv": model.nv, "njoints": model.njoints}


class Placed(NamedTuple):
    """Frames of a Model, or its joints as frames.

    joints      (nframes,) parent joints
    rows        (nframes,) the rows of the table that carry those
    placements  (nframes, 4, 4) in the parent joints' frames
    """

    joints: Places
    rows: Places
    placements: Array

    def words(self, rows: bool = False) -> dict[str, int]:
        """What the plan of a builtin has to say of them, by their joints or by the rows of those."""
        joints = self.rows if rows else self.joints
        places = {"joints": joints.ctypes.data, "placements": self.placements.ctypes.data}
        return {"frames": len(joints), **places}


def made(model: Model) -> Made:
    """What the model is to the library, made again if it was written since.

    Raises ModelError for joints that are not depth first, gravity with an angular part, and what else cannot be.
    """
    found: Made | None = model._made
    if found is None:
        before: Made | None = model._before
        found = None if before is None else _edited(model, before)
        if found is None:
            found = _made(model)
            model._placed = None
        model._made = model._before = found
    return found


def placed(model: Model) -> Placed:
    """The model's frames, gathered again if one was written since. Raises ModelError for one on no joint."""
    rows = made(model).rows
    found: Placed | None = model._placed
    if found is None:
        for frame in model.frames:
            if not 0 <= frame.parentJoint < model.njoints:
                raise ModelError(
                    f'frame "{frame.name}" has parent joint {frame.parentJoint}, expected a joint\'s index'
                )
        joints = np.array([frame.parentJoint for frame in model.frames], np.intp)
        placements = np.array([frame.placement._x for frame in model.frames]).reshape(-1, 4, 4)
        found = model._placed = Placed(joints, rows[joints], placements)
    return found


def joints_as_frames(model: Model) -> Placed:
    """The joints, each as a frame where it stands itself."""
    compiled = made(model)
    if compiled.frames is None:
        joints = np.arange(model.njoints)
        compiled.frames = Placed(joints, compiled.rows, np.tile(np.eye(4), (len(joints), 1, 1)))
    return compiled.frames


def _given(model: Model) -> Given:
    inertias = np.array([inertia._x for inertia in model.inertias]).reshape(-1, 10)
    placements = np.array([X._x for X in model.jointPlacements]).reshape(-1, 4, 4)
    return Given(inertias, placements, model._arrays["armature"].copy(), model.gravity._x.copy(), strict())


def _made(model: Model) -> Made:
    check_depth_first(model)
    _check_gravity(model)
    links, joints = [_link(ROOT, model.inertias[0])], []
    names = {ROOT}
    ends = [ROOT]  # the link of each joint of the model
    last = [0]  # the library's joint of each
    mimics = False
    for k in range(1, model.njoints):
        joint, parent = model.joints[k], ends[model.parents[k]]
        mimic = None
        if isinstance(joint, JointModelMimic):
            mimic, mimics = Mimic(ends[joint.leader], joint.scaling, joint.offset), True
        steps = joint.steps()
        if not steps:
            raise ModelError(f'joint "{model.names[k]}" is an empty composite, expected one with joints')
        at = joint.idx_v
        for n, step in enumerate(steps):
            name = fresh_name(model.names[k] if n == 0 else f"{model.names[k]}.{n + 1}", names)
            X = np.reshape(step.placement, (4, 4))
            if n == 0:
                X = model.jointPlacements[k].homogeneous @ X
            freedoms = {"spherical": 3, "floating": 6, "planar": 3}.get(step.kind, 1)
            rotor = 0.0 if mimic is not None else _rotor(model.armature[at : at + freedoms])
            at += freedoms
            made = RobotJoint(name, step.kind, parent, name, _pose(X), step.axis, armature=rotor, mimic=mimic)
            joints.append(make_joint(made))
            links.append(_link(name, model.inertias[k] if n == len(steps) - 1 else None))
            parent = name
        ends.append(parent)
        last.append(len(joints))
    robot = Robot(model.name or "robot", ROOT, tuple(links), tuple(joints), ordered=True)
    gravity = tuple(model.gravity.linear.tolist())
    compiled = Compiled(robot, Options("fixed", gravity, "cos_sin", mimics, any_norm=not strict()))
    return Made(compiled, np.array(last, np.intp), _given(model))


def _edited(model: Model, before: Made) -> Made | None:
    """What is made of a model of which only numbers were written since; None if that takes making it anew."""
    now, then, compiled = _given(model), before.given, before.model
    if before.joints is not None or compiled.mimic_matrix is not None:
        return None
    _check_gravity(model)
    robot = compiled.robot
    links = {
        int(k): _link(robot.links[k].name, model.inertias[k])
        for k in np.flatnonzero((now.inertias != then.inertias).any(1))
    }
    moved = (now.placements != then.placements).any((1, 2))
    for at in np.flatnonzero(now.armature != then.armature):
        moved[np.searchsorted(model.idx_vs[1:], at, "right")] = True
    joints: dict[int, RobotJoint] = {}
    for k in map(int, np.flatnonzero(moved[1:])):
        joint = model.joints[k + 1]
        rotor = _rotor(now.armature[joint.idx_v : joint.idx_v + joint.nv])
        given = replace(robot.joints[k], armature=rotor)
        if (now.placements[k + 1] != then.placements[k + 1]).any():
            X = model.jointPlacements[k + 1].homogeneous @ np.reshape(joint.steps()[0].placement, (4, 4))
            given = replace(given, placement=_pose(X))
        joints[k] = make_joint(given)
    gravity = None if (now.gravity == then.gravity).all() else tuple(now.gravity[:3].tolist())
    norms = None if now.strict == then.strict else not now.strict
    if not links and not joints and gravity is None and norms is None:
        return before
    return before.edited(edited(compiled, links, joints, gravity, norms), now)


def _check_gravity(model: Model) -> None:
    if model.gravity._x[3:].any():
        raise ModelError(f"gravity has angular part {model.gravity.angular.tolist()}, expected zero")


def _rotor(armature: Array) -> float | tuple[float, ...]:
    """Armatures of a joint: one number if they are alike."""
    rotors = tuple(armature.tolist())
    return rotors[0] if len({*rotors}) == 1 else rotors


def _link(name: str, inertia: Inertia | None) -> Link:
    if inertia is None:
        return Link(name)
    return make_link(name, (inertia.mass, np.array(inertia.lever), np.array(inertia.inertia)))


def _pose(X: Array) -> tuple[float, ...]:
    """A placement row by row; rotation entries below 1e-15 are zero."""
    X = np.array(X)
    X[:3, :3][abs(X[:3, :3]) < 1e-15] = 0.0
    return tuple(X.ravel().tolist())
