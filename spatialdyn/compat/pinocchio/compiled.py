"""The library's Model behind a Model of this face, made when it is first asked for after an edit.

``model._made`` and ``model._placed`` are None from an edit on until ``made`` and ``placed`` are called; callers in a
hurry write ``model._made or made(model)``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import kept
from ...assembly import Options
from ...border import core_shape
from ...engines.builtin import READY, refused
from ...errors import ModelError
from ...interop import check_depth_first, fresh_name
from ...model import Model as Compiled
from ...recursions import SPECS
from ...robot import Joint as RobotJoint
from ...robot import Link, Mimic, Robot, make_joint, make_link
from .inertia import Inertia
from .joint_mimic import JointModelMimic
from .model import Model

Array = NDArray[np.float64]
Places = NDArray[np.intp]
ROOT = "universe"


class Made:
    """What a Model is to the library.

    model   the library's Model: same q, v and armature, ``continuous="cos_sin"``
    rows    (njoints,) row of its table that carries each joint's body; 0 for the universe
    joints  None if its joints are one to one this model's; else (njoints,) which of them carries each joint's body

    Calls of the library for one sample are attributes, as builtins: ``made.integrate(q, v)``, None if it has to be
    asked in another way.
    """

    def __init__(self, model: Compiled, rows: Places, joints: Places | None) -> None:
        self.model, self.rows, self.joints = model, rows, joints
        self.frames: Placed | None = None  # of joints_as_frames

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name not in SPECS:
            raise AttributeError(f"no call {name!r}")
        call: Callable[..., Any] = refused
        if self.whole:
            axes = {f"axis{k}": n for k, n in enumerate(core_shape(self.model, SPECS[name].output) or (1,))}
            call = kept.made(name).bind(self.model, **self.words, **axes)
        self.__dict__[name] = call
        return call

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
        found = model._made = _made(model)
        model._placed = None
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
        placements = np.array([frame.placement.homogeneous for frame in model.frames]).reshape(-1, 4, 4)
        found = model._placed = Placed(joints, rows[joints], placements)
    return found


def joints_as_frames(model: Model) -> Placed:
    """The joints, each as a frame where it stands itself."""
    compiled = made(model)
    if compiled.frames is None:
        joints = np.arange(model.njoints)
        compiled.frames = Placed(joints, compiled.rows, np.tile(np.eye(4), (len(joints), 1, 1)))
    return compiled.frames


def _made(model: Model) -> Made:
    check_depth_first(model)
    if model.gravity.angular.any():
        raise ModelError(f"gravity has angular part {model.gravity.angular.tolist()}, expected zero")
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
            rotors = tuple(model.armature[at : at + freedoms].tolist()) if mimic is None else (0.0,)
            rotor = rotors[0] if len({*rotors}) == 1 else rotors
            at += freedoms
            made = RobotJoint(name, step.kind, parent, name, _pose(X), step.axis, armature=rotor, mimic=mimic)
            joints.append(make_joint(made))
            links.append(_link(name, model.inertias[k] if n == len(steps) - 1 else None))
            parent = name
        ends.append(parent)
        last.append(len(joints))
    robot = Robot(model.name or "robot", ROOT, tuple(links), tuple(joints), ordered=True)
    gravity = tuple(model.gravity.linear.tolist())
    compiled = Compiled(robot, Options("fixed", gravity, "cos_sin", mimics))
    places = np.array(last, np.intp)
    rows = np.array([compiled.joints[k].row for k in last], np.intp)
    return Made(compiled, rows, None if len(joints) + 1 == model.njoints else places)


def _link(name: str, inertia: Inertia | None) -> Link:
    if inertia is None:
        return Link(name)
    return make_link(name, (inertia.mass, np.array(inertia.lever), np.array(inertia.inertia)))


def _pose(X: Array) -> tuple[float, ...]:
    """A placement row by row; rotation entries below 1e-15 are zero."""
    X = np.array(X)
    X[:3, :3][abs(X[:3, :3]) < 1e-15] = 0.0
    return tuple(X.ravel().tolist())
