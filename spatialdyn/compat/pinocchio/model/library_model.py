"""The library's Model behind a Model of this package, assembled at the first call; its numbers follow edits.

``model._library`` caches it; an edit of the tree sets it to None, an edit of numbers shows in the block of ``Numbers``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, NamedTuple
from weakref import WeakSet

import numpy as np
from numpy.typing import NDArray

from ....algebra.rotations import NORM_ROUNDING
from ....bodies.kinds import kind_of, unit_part
from ....bodies.table import joint_table
from ....calls import dynamics
from ....engines import run as engine
from ....engines.compiled.numba_kernels import PLAIN, TABLE, variant
from ....engines.programs.run.call_code import CallCode
from ....engines.programs.run.single_call import READY, unavailable
from ....errors import ModelError
from ....interop.pinocchio import check_depth_first, fresh_name
from ....model.assembly import IDENTITY, Options
from ....model.model import Model as SdModel
from ....model.robot import Link, Mimic, Robot, RobotJoint
from ....model.robot_checks import clear_rounding, make_joint, make_link
from ....model.update import edited
from ....recursions import SPECS
from ...native import recorded_calls
from ...native.configurations import ROUTINES
from ...native.edited_table import MOVED, REFUSED, put_numbers
from ...native.recorded_calls import clock
from ..coverage.strictness import strict
from ..types.arguments import Array, expected
from ..types.inertia import Inertia
from .joints import Mimic as MimicJoint
from .model import Model
from .numbers import Numbers

Indices = NDArray[np.intp]
ROOT = "universe"
PAST = 64  # edits before the earlier ones are forgotten


class LibraryModel:
    """The library's Model behind a Model.

    model     the library's Model: same q, v and armature, ``continuous="cos_sin"``
    table     a Table, which builtins read; numbers that are edited are written in place
    numbers   those of the table
    state     their bytes
    kernel_table  the table as kernels take it
    rows      (njoints,) row of its table of bodies that carries each joint's body; 0 for the universe
    parents   (njoints,) of the Model's joints
    strict    whether norms are checked
    edited    whether it was edited after its first call: the table kernels then answer, whose table is written in place
    joints    None if its joints are the Model's one to one; else (njoints,) its joint that carries each joint's body

    Calls of the library for one sample are attributes, as builtins: ``library.integrate(q, v)``, which returns None if
    not applicable.
    """

    def __init__(self, model: SdModel, joint_map: Indices, parents: Indices, block: Array, simple: bool) -> None:
        """From the library's model, its joint that carries each joint's body, and the block of numbers of the Model.

        simple  whether no joint has a placement of its own
        """
        self.joint_map, self.parents, self.strict = joint_map, parents, strict()
        self.rows = np.array([model.joints[k].row for k in joint_map], np.intp)
        self.row_numbers = self.rows.astype(np.float64)
        self.joints = None if model.njoints == len(joint_map) else joint_map
        self.frames: FramePlacements | None = None  # of joints_as_frames
        firsts = [(joint, model.bodies[joint.row - joint.nv + 1]) for joint in model.joints[1:]]
        parts = [unit_part(int(first["kind"]), joint.idx_q) for joint, first in firsts]
        self.unit_parts = [part for part in parts if part is not None]  # slices of q: quaternions and (cos, sin) pairs
        self.units = tuple((part.start, part.stop - part.start) for part in self.unit_parts)
        self.has_builtins = READY and model.mimic_matrix is None  # not with mimic joints, nor without compiled code
        self.takes_edits = self.has_builtins and self.joints is None and simple
        self.edited = False
        self._take(model, block.tobytes(), np.frombuffer(model.bodies.tobytes(), np.uint8), block)

    def _take(self, model: SdModel, state: bytes, bodies: Any, block: Array) -> None:
        """Hold a model assembled from these numbers, a copy of its table with those of ``state``, and the Model's."""
        self._model, self._state_of_model, self.state, self._block = model, state, state, block
        self.numbers = Numbers(len(self.parents), len(model.armature), np.frombuffer(state).copy())
        self.table = recorded_calls.Table(bodies, block, self.numbers.block)
        self.address = self.table.address
        self.kernel_table: Any = model.bodies if PLAIN else self.address
        self._chain = None if model.mimic_matrix is None else joint_table(model.bodies)
        self._put_numbers: Any = None
        self._at_call: dict[bytes, SdModel] = {}  # with the numbers of the last earlier call that asked
        self._masses: tuple[Any, Array] = None, np.empty(0)
        self._past: list[tuple[int, bytes]] = []  # states, and the time until which they were those of the table
        self._codes: dict[Any, CallCode] = {}
        self._with_forces: dict[str, Callable[..., Any]] = {}
        self.runs: WeakSet[Any] = WeakSet()  # the last calls, which keep their state before it is forgotten
        self.words = {"table": self.address, "nq": model.nq, "nv": model.nv, "njoints": model.njoints}

    @property
    def joint_table(self) -> Any:
        """The table of independent joints, as kernels take it that factor M: with mimic joints a chain, M is full."""
        return self.kernel_table if self._chain is None else getattr(self._chain, TABLE)

    def of_tree(self, q: Array, v: Array | None = None) -> tuple[Array, Array]:
        """q and v of the whole tree, in which mimic joints have coordinates too; copies."""
        model, speed = self._model, np.zeros(self._model.nv) if v is None else np.array(v)
        if model.mimic_matrix is None:
            return np.array(q), speed
        return self.tree_q(q), model.mimic_matrix @ speed

    def tree_q(self, q: Array) -> Array:
        """q of the whole tree: a copy with mimic joints, else q itself."""
        model = self._model
        if model.mimic_matrix is None:
            return q
        found: Array = q[model.mimic_index] * model.mimic_ratio + model.mimic_offset
        return found

    def of_joints(self, J: Array) -> Array:
        """A Jacobian (m, nv) of one for the velocities of the whole tree."""
        G = self._model.mimic_matrix
        return J if G is None else np.ascontiguousarray(J @ G)

    @property
    def tree_nv(self) -> int:
        """Number of velocities of the whole tree."""
        return len(self._model.bodies) - 1

    def copy(self, block: Array) -> LibraryModel:
        """An independent one, of another Model with such a block."""
        found = LibraryModel.__new__(LibraryModel)
        names = ("joint_map", "parents", "rows", "row_numbers", "joints", "frames", "unit_parts", "units",
                 "has_builtins", "takes_edits", "edited", "strict")  # fmt: skip
        found.__dict__.update({name: self.__dict__[name] for name in names})
        found._take(self._model, self.state, self.table.bytes, block)
        found._state_of_model = self._state_of_model
        return found

    def follow(self) -> bool:
        """Write the Model's numbers to the table if they were edited; False if they need to be checked.

        The next read makes ``model``.
        """
        state, before = self._block.tobytes(), self.state
        if state == before:
            return True
        if not self.takes_edits:
            return False
        if self._put_numbers is None:
            self._put_numbers = self._bound_put_numbers()
        done = self._put_numbers()
        if done == REFUSED:
            return False
        if not self.edited:  # recording programs of an edited model takes milliseconds each: table kernels answer
            self.edited = True
            for code in self._codes.values():
                code.use_table()
        self._past.append((clock.now[0] + 1, before))
        self.state = state
        if done == MOVED:
            self.table.note_move()
        if len(self._past) == PAST:
            for run in self.runs:
                run.keep_state()
            self._past.clear()
        return True

    def _bound_put_numbers(self) -> Callable[[], Any]:
        now, then, sums = self._block, self.numbers.block, np.empty((len(self._model.bodies), 3))
        words = {"now": now, "then": then, "rows": self.rows, "sums": sums, "table": self.address}
        words |= {"size": len(now), "njoints": len(self.rows), "count": len(sums)}
        return put_numbers.bind(words, self.table)

    def state_at(self, stamp: int) -> bytes:
        """The state at the time of a call."""
        for end, state in self._past:
            if stamp < end:
                return state
        return self.state

    def numbers_of(self, state: bytes) -> Numbers:
        """The numbers of a state."""
        return self.numbers if state is self.state else Numbers(len(self.parents), len(self._model.armature), state)

    def subtree_masses(self, state: bytes) -> Array:
        """Mass (njoints,) of each joint's subtree, the universe's own left out; kept for one state."""
        if self._masses[0] is not state:
            masses = self.numbers_of(state).inertias[:, 0].tolist()
            self._masses = state, subtree_masses(masses, self.parents.tolist())
        return self._masses[1]

    @property
    def model(self) -> SdModel:
        """The library's Model."""
        if self.state is not self._state_of_model:
            self._model, self._state_of_model = self._edited(self.state), self.state
        return self._model

    def model_at(self, state: bytes) -> SdModel:
        """The library's Model with the numbers of an earlier call."""
        if state is self.state:
            return self.model
        if state not in self._at_call:
            self._at_call = {state: self._edited(state)}
        return self._at_call[state]

    def table_at(self, state: bytes) -> Any:
        """The table with the numbers of an earlier call, as kernels take it."""
        return self.kernel_table if state is self.state else getattr(self.model_at(state), TABLE)

    def _edited(self, state: bytes) -> SdModel:
        model, then, now = self._model, self.numbers_of(self._state_of_model), self.numbers_of(state)
        links = model.robot.links
        changed = np.flatnonzero((now.inertias != then.inertias).any(1)).tolist()
        moved, joints = (now.placements != then.placements).any((1, 2))[1:], {}
        for k, (joint, row) in enumerate(zip(model.robot.joints, model.joints[1:], strict=True)):
            own = slice(row.idx_v, row.idx_v + row.nv)
            if moved[k] or (now.armature[own] != then.armature[own]).any():
                place = _pose(now.placements[k + 1])
                joints[k] = make_joint(replace(joint, placement=place, armature=_rotor(now.armature[own])))
        return edited(model, {k: _link(links[k].name, now.inertias[k]) for k in changed}, joints, _gravity(now))

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name not in SPECS:
            raise AttributeError(f"no call {name!r}")
        call = self.__dict__[name] = self._bound(name)
        return call

    def routine(self, name: str, **fixed: Array) -> Callable[..., Any]:
        """A routine on configurations as a builtin, which returns None if not applicable.

        fixed  inputs that no caller passes
        """
        if not self.has_builtins:
            return unavailable
        units, scratch = np.array(self.units, np.int64), np.empty(self.words["nv"])
        words = {"units": units, "count": len(units), "scratch": scratch, **self.words, **fixed}
        return ROUTINES[name].bind(words, self.table)

    def code(self, name: str, forces: bool = False) -> CallCode:
        """The code of a call: the library's program, or the table kernel if there is none or the model was edited."""
        spec = variant(SPECS[name], frozenset(["fext"] if forces else []))
        found = self._codes.get(spec)
        if found is None:
            made = None if self.edited else engine.program(spec, self._model, ())
            program = None if made is None else made.program
            found = self._codes[spec] = CallCode(spec, self.table, program)
        return found

    def renew(self, name: str, forces: bool = False) -> bool:
        """Take faster code of a call if there is some by now; whether there is."""
        return self.has_builtins and self.code(name, forces).renew()

    def _bound(self, name: str, forces: bool = False) -> Callable[..., Any]:
        """A call as a builtin, which returns None if not applicable."""
        if not self.has_builtins:
            return unavailable
        return recorded_calls.recorded_call(self.code(name, forces), self.words)

    def compute(self, name: str, *values: Any, at: bytes | None = None) -> Any:
        """A call, external forces last, if any; ``at`` the state of an earlier call: by a builtin, or with checks."""
        if values and values[-1] is None:
            values = values[:-1]
        spec, now = SPECS[name], at is None or at is self.state
        forces = bool(values) and len(values) == len(spec.present) and spec.present[-1].optional
        for _ in range(2 if now else 0):
            if forces:
                call = self._with_forces.get(name)
                if call is None:
                    call = self._with_forces[name] = self._bound(name, True)
                found = call(*values[:-1], values[-1].ravel())
            else:
                found = getattr(self, name)(*values)
            if found is not None:
                return found
            if not self.renew(name, forces):
                break
        if now and not self.edited and self.has_builtins:
            return dynamics.calls[name](self._model, *values)
        return dynamics.table_call(name, self.model if at is None else self.model_at(at), *values)

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
    """Frames on joints; the placements are read where they are, so that their edits count.

    joints  (nframes,) parent joints
    rows    (nframes,) rows of the table of bodies that carry them
    places  their placements (4, 4) in the parent joints' frames, and their addresses
    """

    joints: Indices
    rows: Indices
    places: list[Array]
    addresses: NDArray[np.int64]

    @classmethod
    def of(cls, joints: Indices, rows: Indices, places: Iterable[Array]) -> FramePlacements:
        """Frames with these placements."""
        held = [*places]
        return cls(joints, rows, held, np.array([x.ctypes.data for x in held], np.int64))

    @property
    def placements(self) -> Array:
        """A copy of the placements (nframes, 4, 4)."""
        return np.array(self.places).reshape(-1, 4, 4)

    def words(self, rows: bool = False) -> dict[str, Any]:
        """Words of a builtin's plan about the frames; ``rows``: their rows of the table in place of their joints."""
        joints = self.rows if rows else self.joints
        return {"frames": len(joints), "joints": joints, "placements": self.addresses}


def checked_library(model: Any) -> LibraryModel:
    """``library_model`` of an argument, which has to be a Model."""
    return library_model(expected(model, Model, "model"))


def library_model(model: Model) -> LibraryModel:
    """The LibraryModel of a Model, assembled again if the Model was edited otherwise than by numbers.

    Raises ModelError for joints that are not depth first, gravity with an angular part, and other impossible models.
    """
    found: LibraryModel | None = model._library
    if found is None or not found.follow():
        before: LibraryModel | None = model._library_before
        found = _assembled(model)
        found.edited = model._edited if before is None else before.edited or before.state != found.state
        own = vars(model)
        own["_library"] = own["_library_before"] = found
        model._forget()
    return found


def frame_placements(model: Model) -> FramePlacements:
    """The FramePlacements of a Model, gathered again if its frames changed. Raises ModelError for one on no joint."""
    rows = library_model(model).rows
    found: FramePlacements | None = model._frame_placements
    if found is None:
        for frame in model.frames:
            if not 0 <= frame.parentJoint < model.njoints:
                raise ModelError(
                    f'frame "{frame.name}" has parent joint {frame.parentJoint}, expected a joint\'s index'
                )
        joints = np.array([frame.parentJoint for frame in model.frames], np.intp)
        found = FramePlacements.of(joints, rows[joints], [frame.placement._x for frame in model.frames])
        model._frame_placements = found
    return found


def joints_as_frames(model: Model) -> FramePlacements:
    """The joints as frames: each at the identity on itself."""
    library = library_model(model)
    if library.frames is None:
        joints = np.arange(model.njoints)
        library.frames = FramePlacements.of(joints, library.rows, np.tile(np.eye(4), (len(joints), 1, 1)))
    return library.frames


def _gravity(numbers: Numbers) -> tuple[float, float, float]:
    a, b, c = numbers.gravity[:3].tolist()
    return a, b, c


def _assembled(model: Model) -> LibraryModel:
    check_depth_first(model)
    numbers = model._numbers
    if numbers.gravity[3:].any():
        raise ModelError(f"gravity has angular part {model.gravity.angular.tolist()}, expected zero")
    links, joints = [_link(ROOT, numbers.inertias[0])], []
    names = {ROOT}
    ends = [ROOT]  # the link of each joint of the model
    last = [0]  # of each, the library's joint that carries its body
    mimics, simple = False, True
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
            simple = simple and step.placement == IDENTITY
            if n == 0:
                X = numbers.placements[k] @ X
            freedoms = kind_of(step.kind).nv
            rotor = 0.0 if mimic is not None else _rotor(numbers.armature[at : at + freedoms])
            at += freedoms
            own: dict[str, Any] = {"armature": rotor, "mimic": mimic, "pitch": step.pitch}
            robot_joint = RobotJoint(name, step.kind, parent, name, _pose(X), step.axis, **own)
            joints.append(make_joint(robot_joint))
            links.append(_link(name, numbers.inertias[k] if n == len(steps) - 1 else None))
            parent = name
        ends.append(parent)
        last.append(len(joints))
    robot = Robot(model.name or "robot", ROOT, tuple(links), tuple(joints), ordered=True)
    compiled = SdModel(robot, Options("fixed", _gravity(numbers), "cos_sin", mimics, any_norm=not strict()))
    return LibraryModel(compiled, np.array(last, np.intp), np.array(model.parents, np.intp), numbers.block, simple)


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
