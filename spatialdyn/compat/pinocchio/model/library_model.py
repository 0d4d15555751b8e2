"""The library's Model behind a Model of this package, assembled at the first call after an edit.

``model._library`` and ``model._frame_placements`` cache it; an edit sets them to None.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple
from weakref import WeakSet

import numpy as np
from numpy.typing import NDArray

from ....algebra.rotations import NORM_ROUNDING
from ....bodies.kinds import kind_of, unit_part
from ....bodies.table import BODIES
from ....calls import dynamics
from ....engines import run as engine
from ....engines.compiled.cpython import READY, Entry, unavailable
from ....engines.compiled.numba_kernels import PLAIN, variant
from ....errors import ModelError
from ....interop.pinocchio import check_depth_first, fresh_name
from ....model.assembly import Options
from ....model.model import Model as SdModel
from ....model.robot import Link, Mimic, Robot, RobotJoint
from ....model.robot_checks import clear_rounding, make_joint, make_link
from ....model.update import edited, put_placement
from ....recursions import SPECS
from ...native import edited_table, recorded_calls
from ...native.edited_table import GRAVITY, MOST, bounds
from ...native.recorded_calls import clock
from ..coverage.strictness import strict
from ..types.arguments import Array
from ..types.inertia import Inertia
from .joints import Mimic as MimicJoint
from .model import Model

Indices = NDArray[np.intp]
ROOT = "universe"

PAST = 64  # edits of inertias before the earlier ones are forgotten


class ModelNumbers(NamedTuple):
    """The numbers of a Model that a LibraryModel is assembled from beside inertias, and whether norms are checked."""

    placements: Array
    armature: Array
    strict: bool


class LibraryModel:
    """The library's Model behind a Model.

    model     the library's Model: same q, v and armature, ``continuous="cos_sin"``
    table     a copy of its table of bodies as bytes, which builtins read; gravity (3,), a view, is written in place
    inertias  (njoints, 10) of its joints' bodies, a new array after an edit
    kernel_table  the table as kernels take it
    rows      (njoints,) row of its table of bodies that carries each joint's body; 0 for the universe
    parents   (njoints,) of the Model's joints
    edited    whether it was edited after its first call: the table kernels then answer, whose table is written in place
    joints    None if its joints are the Model's one to one; else (njoints,) its joint that carries each joint's body

    Calls of the library for one sample are attributes, as builtins: ``library.integrate(q, v)``, which returns None if
    not applicable.
    """

    def __init__(
        self, model: SdModel, joint_map: Indices, parents: Indices, inertias: Array, numbers: ModelNumbers
    ) -> None:
        """From the library's model, its joint that carries each joint's body, and the numbers it was assembled from."""
        self.joint_map, self.parents = joint_map, parents
        self.rows = np.array([model.joints[k].row for k in joint_map], np.intp)
        self.row_numbers = self.rows.astype(np.float64)
        self.joints = None if model.njoints == len(joint_map) else joint_map
        self.frames: FramePlacements | None = None  # of joints_as_frames
        firsts = [(joint, model.bodies[joint.row - joint.nv + 1]) for joint in model.joints[1:]]
        parts = [unit_part(int(first["kind"]), joint.idx_q) for joint, first in firsts]
        self.unit_parts = [part for part in parts if part is not None]  # slices of q: quaternions and (cos, sin) pairs
        self.units = tuple((part.start, part.stop - part.start) for part in self.unit_parts)
        self.has_builtins = READY and model.mimic_matrix is None  # not with mimic joints, nor without compiled code
        self.takes_edits = self.has_builtins and self.joints is None
        self.edited = False
        self._take(model, np.frombuffer(model.bodies.tobytes(), np.uint8), inertias, numbers)

    def _take(self, model: SdModel, bodies: Any, inertias: Array, numbers: ModelNumbers) -> None:
        self._model, self._model_inertias, self.inertias, self.numbers = model, inertias, inertias, numbers
        self._placed: dict[int, RobotJoint] = {}  # joints that are edited in the table, and not yet in ``_model``
        table = bodies.copy()
        self.table, self.address = table, table.ctypes.data
        self.kernel_table: Any = model.bodies if PLAIN else self.address
        self.gravity: Array = table[GRAVITY : GRAVITY + 24].view(np.float64)
        self._at_call: dict[bytes, SdModel] = {}  # with gravity and inertias of the last call that asked
        self._put_inertia: Any = None
        self._masses: tuple[Any, Array] = None, np.empty(0)
        self._past: list[tuple[int, Array]] = []  # inertias, and the time until which they were those of the table
        self._entries: dict[Any, Entry] = {}
        self.runs: WeakSet[Any] = WeakSet()  # the last calls, which keep the inertias before they are forgotten
        self.words = {"table": self.address, "nq": model.nq, "nv": model.nv, "njoints": model.njoints}

    def with_model(self, model: SdModel, bodies: Any, inertias: Array, numbers: ModelNumbers) -> LibraryModel:
        """The LibraryModel of the same tree, as a Model with other numbers; bodies as bytes."""
        found = LibraryModel.__new__(LibraryModel)
        names = ("joint_map", "parents", "rows", "row_numbers", "joints", "frames", "unit_parts", "units",
                 "has_builtins", "takes_edits", "edited")  # fmt: skip
        found.__dict__.update({name: self.__dict__[name] for name in names})
        found._take(model, bodies, inertias, numbers)
        return found

    def copy(self) -> LibraryModel:
        """An independent one."""
        found = self.with_model(self._model, self.table, self.inertias, self.numbers)
        found._model_inertias, found._placed = self._model_inertias, {**self._placed}
        return found

    def with_joints(self, placed: dict[int, RobotJoint], numbers: ModelNumbers) -> LibraryModel | None:
        """The LibraryModel with other armatures, and some joints placed anew; None if the numbers need checks."""
        at, armature = numbers.placements, numbers.armature
        if not (abs(at) < MOST).all() or not ((armature >= 0.0) & (armature < MOST)).all():
            return None
        self.note_edit()
        found = self.copy()
        found.numbers, found._placed, bodies = numbers, {**self._placed, **placed}, found.table.view(BODIES)
        bodies["armature"][1:] = armature
        for joint in placed.values():
            put_placement(self._model, bodies, joint)
        if placed:
            bounds(found.kernel_table, np.empty((len(bodies), 3)))
        return found

    def put_inertia(self, joint: int, inertia: Array) -> bool:
        """Write the inertia (10,) of a joint to the table; False if it needs checks. The next read makes ``model``."""
        before = self.inertias
        if self._put_inertia is None:
            sums = np.empty((len(self._model.bodies), 3))
            words = {"rows": self.row_numbers.ctypes.data, "sums": sums.ctypes.data, "count": len(sums)}
            words |= {"table": self.address, "njoints": len(before), "ten": 10}
            self._put_inertia = edited_table.builtin().bind(self, sums, **words)
        after = self._put_inertia(before, joint, inertia)
        if after is None:
            return False
        self.note_edit()
        self._past.append((clock.now[0] + 1, before))
        if len(self._past) == PAST:
            for run in self.runs:
                run.keep_inertias()
            self._past.clear()
        self.inertias = after
        return True

    def subtree_masses(self, inertias: Array) -> Array:
        """Mass (njoints,) of each joint's subtree, the universe's own left out; kept for the inertias of one array."""
        if self._masses[0] is not inertias:
            self._masses = inertias, subtree_masses(inertias[:, 0].tolist(), self.parents.tolist())
        return self._masses[1]

    def inertias_at(self, stamp: int) -> Array:
        """Inertias (njoints, 10) at the time of a call."""
        for end, inertias in self._past:
            if stamp < end:
                return inertias
        return self.inertias

    @property
    def model(self) -> SdModel:
        """The library's Model."""
        model, then = self._model, self._model_inertias
        joints = _changed_joints(model, self._placed, self.numbers.armature) if self.takes_edits else {}
        if joints or self.inertias is not then or not (self.gravity == model.gravity).all():
            links = _changed_links(model, then, self.inertias)
            self._model = edited(model, links, joints, _numbers(self.gravity))
            self._placed, self._model_inertias = {}, self.inertias
        return self._model

    def is_at(self, gravity: Array, inertias: Array) -> bool:
        """Whether gravity (3,) and inertias (njoints, 10) are those of the table."""
        return inertias is self.inertias and gravity.tobytes() == self.gravity.tobytes()

    def model_at(self, gravity: Array, inertias: Array) -> SdModel:
        """The library's Model with the gravity (3,) and the inertias (njoints, 10) of an earlier call."""
        if self.is_at(gravity, inertias):
            return self.model
        key = gravity.tobytes() + inertias.tobytes()
        if key not in self._at_call:
            links = _changed_links(self.model, self.inertias, inertias)
            self._at_call = {key: edited(self.model, links, {}, _numbers(gravity))}
        return self._at_call[key]

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name not in SPECS:
            raise AttributeError(f"no call {name!r}")
        call = self.__dict__[name] = self._bound(name)
        return call

    def note_edit(self) -> None:
        """Have table kernels answer from now on: recording programs of an edited model takes milliseconds each."""
        if not self.edited:
            self.edited = True
            for entry in self._entries.values():
                entry.use_table()

    def entry(self, name: str, forces: bool = False) -> Entry:
        """What runs a call: the library's program, or the table kernel if there is none or the model was edited."""
        spec = variant(SPECS[name], frozenset(["fext"] if forces else []))
        found = self._entries.get(spec)
        if found is None:
            made = None if self.edited else engine.program(spec, self._model, ())
            found = self._entries[spec] = Entry(spec, None if made is None else made.program)
        return found

    def renew(self, name: str, forces: bool = False) -> bool:
        """Take faster code of a call if there is some by now; whether there is."""
        return self.has_builtins and self.entry(name, forces).renew()

    def _bound(self, name: str, forces: bool = False) -> Callable[..., Any]:
        """A call as a builtin, which returns None if not applicable."""
        if not self.has_builtins:
            return unavailable
        call = recorded_calls.recorded_call(name, forces=forces)
        return call.bind(self, entry=self.entry(name, forces), **self.words)

    def compute(self, name: str, *values: Any, at: tuple[Array, Array] | None = None) -> Any:
        """A call, external forces last, if any; ``at`` gravity and inertias of an earlier call: by a builtin, or with
        checks.
        """
        if values and values[-1] is None:
            values = values[:-1]
        spec, now = SPECS[name], at is None or self.is_at(*at)
        forces = bool(values) and len(values) == len(spec.present) and spec.present[-1].optional
        for _ in range(2 if now else 0):
            if forces:
                found = self._bound(name, True)(*values[:-1], values[-1].ravel())
            else:
                found = getattr(self, name)(*values)
            if found is not None:
                return found
            if not self.renew(name, forces):
                break
        if now and not self.edited and self.has_builtins:
            return dynamics.calls[name](self._model, *values)
        return dynamics.table_call(name, self.model if at is None else self.model_at(*at), *values)

    def off_norm(self, q: Array) -> bool:
        """Whether norms are not checked and a quaternion or (cos, sin) pair of q is off its unit norm."""
        return self._model.options.any_norm and any(
            abs(part @ part - 1.0) > NORM_ROUNDING for part in (q[unit] for unit in self.unit_parts)
        )


def subtree_masses(masses: list[float], parents: list[int]) -> Array:
    """Mass of each joint's subtree, from those of the bodies and parents; the universe's own does not count."""
    m = [0.0, *masses[1:]]
    for k in range(len(m) - 1, 0, -1):
        m[parents[k]] += m[k]
    return np.array(m)


class FramePlacements(NamedTuple):
    """Placements of the frames of a Model on their joints.

    joints      (nframes,) parent joints
    rows        (nframes,) rows of the table of bodies that carry them
    placements  (nframes, 4, 4) in the parent joints' frames
    """

    joints: Indices
    rows: Indices
    placements: Array

    def words(self, rows: bool = False) -> dict[str, int]:
        """Words of a builtin's plan about the frames; ``rows``: their rows of the table in place of their joints."""
        joints = self.rows if rows else self.joints
        places = {"joints": joints.ctypes.data, "placements": self.placements.ctypes.data}
        return {"frames": len(joints), **places}


def library_model(model: Model) -> LibraryModel:
    """The LibraryModel of a Model, assembled again if the Model was edited.

    Raises ModelError for joints that are not depth first, gravity with an angular part, and other impossible models.
    """
    found: LibraryModel | None = model._library
    if found is None:
        before: LibraryModel | None = model._library_before
        if before is not None:
            found = before if _takes_edit(model, before) else _updated(model, before)
        if found is None:
            found = _assembled(model)
            found.edited = before is not None or bool(model._edited)
            model._frame_placements = None
        own = vars(model)
        own["_library"] = own["_library_before"] = found
    return found


def _takes_edit(model: Model, before: LibraryModel) -> bool:
    """Write the inertias that were edited to the table; False if anything else was edited too."""
    changed, placements = model._edited_inertias, model._placement_numbers
    if not changed or placements is None or model._inertia_numbers is not before.inertias:
        return False
    numbers = before.numbers
    if placements[0] is not numbers.placements or strict() is not numbers.strict or not before.takes_edits:
        return False
    for key, inertia in changed.items():
        if not before.put_inertia(model._inertia_rows[key], inertia._x):
            return False
    changed.clear()
    vars(model)["_inertia_numbers"] = before.inertias  # past the checks of Model, which take longer
    return True


def frame_placements(model: Model) -> FramePlacements:
    """The FramePlacements of a Model, gathered again if a frame was edited. Raises ModelError for one on no joint."""
    rows = library_model(model).rows
    found: FramePlacements | None = model._frame_placements
    if found is None:
        for frame in model.frames:
            if not 0 <= frame.parentJoint < model.njoints:
                raise ModelError(
                    f'frame "{frame.name}" has parent joint {frame.parentJoint}, expected a joint\'s index'
                )
        joints = np.array([frame.parentJoint for frame in model.frames], np.intp)
        placements = np.array([frame.placement._x for frame in model.frames]).reshape(-1, 4, 4)
        found = model._frame_placements = FramePlacements(joints, rows[joints], placements)
    return found


def joints_as_frames(model: Model) -> FramePlacements:
    """The joints as frames: each at the identity on itself."""
    compiled = library_model(model)
    if compiled.frames is None:
        joints = np.arange(model.njoints)
        compiled.frames = FramePlacements(joints, compiled.rows, np.tile(np.eye(4), (len(joints), 1, 1)))
    return compiled.frames


def _numbers_of(model: Model) -> tuple[Array, ModelNumbers]:
    """Inertias and other numbers; inertias and placements are gathered again only if one of them was edited."""
    if model._inertia_numbers is None or model._edited_inertias:
        model._edited_inertias.clear()
        model._inertia_rows = {id(inertia): k for k, inertia in enumerate(model.inertias)}
        model._inertia_numbers = np.concatenate([inertia._x for inertia in model.inertias]).reshape(-1, 10)
    if model._placement_numbers is None:
        placements = np.array([X._x for X in model.jointPlacements]).reshape(-1, 4, 4)
        model._placement_numbers = placements, model._arrays["armature"].copy()
    placements, armature = model._placement_numbers
    return model._inertia_numbers, ModelNumbers(placements, armature, strict())


def _numbers(x: Array) -> tuple[float, float, float]:
    a, b, c = x.tolist()
    return a, b, c


def _changed_links(compiled: SdModel, then: Array, now: Array) -> dict[int, Link]:
    """Links of the inertias that differ, by index in the robot."""
    links = compiled.robot.links
    return {int(k): _link(links[k].name, now[k]) for k in np.flatnonzero((now != then).any(1))}


def _assembled(model: Model) -> LibraryModel:
    check_depth_first(model)
    _check_gravity(model)
    links, joints = [_link(ROOT, model.inertias[0]._x)], []
    names = {ROOT}
    ends = [ROOT]  # the link of each joint of the model
    last = [0]  # of each, the library's joint that carries its body
    mimics = False
    for k in range(1, model.njoints):
        joint, parent = model.joints[k], ends[model.parents[k]]
        mimic = None
        if isinstance(joint, MimicJoint):
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
            freedoms = kind_of(step.kind).nv
            rotor = 0.0 if mimic is not None else _rotor(model.armature[at : at + freedoms])
            at += freedoms
            own: dict[str, Any] = {"armature": rotor, "mimic": mimic, "pitch": step.pitch}
            robot_joint = RobotJoint(name, step.kind, parent, name, _pose(X), step.axis, **own)
            joints.append(make_joint(robot_joint))
            links.append(_link(name, model.inertias[k]._x if n == len(steps) - 1 else None))
            parent = name
        ends.append(parent)
        last.append(len(joints))
    robot = Robot(model.name or "robot", ROOT, tuple(links), tuple(joints), ordered=True)
    gravity = _numbers(model.gravity._x[:3])
    compiled = SdModel(robot, Options("fixed", gravity, "cos_sin", mimics, any_norm=not strict()))
    return LibraryModel(compiled, np.array(last, np.intp), np.array(model.parents, np.intp), *_numbers_of(model))


def _updated(model: Model, before: LibraryModel) -> LibraryModel | None:
    """The LibraryModel after an edit of numbers alone; None if it has to be assembled again."""
    if not before.takes_edits:
        return None
    (inertias, now), then = _numbers_of(model), before.numbers
    _check_gravity(model)
    same = now.placements is then.placements and now.armature is then.armature and now.strict == then.strict
    unmoved = before.gravity.tolist() == model.gravity._x[:3].tolist()
    if same and inertias is before.inertias and unmoved:
        return before
    placed = {}
    for k in map(int, np.flatnonzero((now.placements != then.placements).any((1, 2))[1:])):
        X = model.jointPlacements[k + 1].homogeneous @ np.reshape(model.joints[k + 1].steps()[0].placement, (4, 4))
        placed[k] = make_joint(replace(before._model.robot.joints[k], placement=_pose(X)))
    if now.strict == then.strict and inertias is before.inertias and unmoved:
        found = before.with_joints(placed, now)
        if found is not None:
            return found
    compiled = before.model
    norms = None if now.strict == then.strict else not now.strict
    links, joints = _changed_links(compiled, before.inertias, inertias), _changed_joints(compiled, placed, now.armature)
    made = edited(compiled, links, joints, _numbers(model.gravity._x[:3]), norms)
    if links or joints or not unmoved:  # else norms alone are checked otherwise
        before.note_edit()
    return before.with_model(made, np.frombuffer(made.bodies.tobytes(), np.uint8), inertias, now)


def _changed_joints(compiled: SdModel, placed: dict[int, RobotJoint], armature: Array) -> dict[int, RobotJoint]:
    """Joints by index in the robot: those placed anew, and those with other armatures."""
    if not placed and (compiled.armature == armature).all():
        return {}
    found = {}
    for k, (joint, row) in enumerate(zip(compiled.robot.joints, compiled.joints[1:], strict=True)):
        own = slice(row.idx_v, row.idx_v + row.nv)
        if k in placed or (compiled.armature[own] != armature[own]).any():
            found[k] = make_joint(replace(placed.get(k, joint), armature=_rotor(armature[own])))
    return found


def _check_gravity(model: Model) -> None:
    x = model.gravity._x
    if not x[3] == 0.0 == x[4] or x[5] != 0.0:
        raise ModelError(f"gravity has angular part {model.gravity.angular.tolist()}, expected zero")


def _rotor(armature: Array) -> float | tuple[float, ...]:
    """Armatures of a joint: one number if all are equal."""
    rotors = tuple(armature.tolist())
    return rotors[0] if len({*rotors}) == 1 else rotors


def _link(name: str, inertia: Array | None) -> Link:
    """The Link of an inertia's numbers (10,)."""
    if inertia is None:
        return Link(name)
    body = Inertia.over(inertia)
    return make_link(name, (body.mass, np.array(body.lever), np.array(body.inertia)))


def _pose(X: Array) -> tuple[float, ...]:
    """A placement row by row; rotation entries below 1e-15 become zero."""
    X = np.array(X)
    clear_rounding(X[:3, :3])
    return tuple(X.ravel().tolist())
