"""The Model: a robot as a table of bodies, with its names, limits and frames."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ModelError, literal
from ..waiting import watch
from .assembly import GRAVITY, IDENTITY, Frame, Options, Tables, tables
from .changes import changed, gravity_of, locked, rigid, subtree_robot
from .joint_rows import Joint, frozen
from .robot import Robot, RobotJoint, Rotor
from .robot_checks import missing
from .transmission import Transmission

Array = NDArray[np.float64]
__all__ = ["Frame", "Joint", "Model", "Options", "assemble"]

DEEP = 40  # levels that a printed tree indents; deeper ones are numbered, or a chain of n links would take n² columns


class Model:
    """A robot ready for computation: immutable, hashable by content, thread-safe.

    key           digest of everything that results depend on: models with equal keys give equal results
    bodies        (1 + rows,) the table that every recursion walks (see ``spatialdyn.bodies.table``), read-only
    nq, nv        number of coordinates and of velocities
    njoints       number of joints, the world included
    joints        tuple of Joint; joints[0] is the world
    frames        tuple of Frame: every link and joint, in the order of the tree
    names         joint names
    mimic_matrix  None, or G (rows, nv) with v of the full tree = G v; mimic_index, mimic_ratio, mimic_offset give q of
                  the full tree, and free_q, free_v the indices of the model's own coordinates in it
    lower, upper  (nq,) position limits, infinite where there are none
    velocity_limit, effort_limit, damping, friction, armature   (nv,)
    gravity       (3,) [m/s²]
    address       of ``bodies`` in memory, for compiled kernels
    total_mass    of all moving bodies [kg]; links fixed to a fixed root are left out
    robot         the checked robot it was made from
    notes         oddities of its source, and what in it has no counterpart in a Model
    """

    __slots__ = (
        *Tables._fields,
        *(
            "options",
            "name",
            "njoints",
            "names",
            "gravity",
            "address",
            "total_mass",
            "_frame_index",
            "_joint_index",
            "_plans",
            "__weakref__",
        ),
    )

    robot: Robot
    options: Options
    name: str
    key: str
    bodies: NDArray[Any]
    nq: int
    nv: int
    njoints: int
    joints: tuple[Joint, ...]
    frames: tuple[Frame, ...]
    names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity_limit: Array
    effort_limit: Array
    damping: Array
    friction: Array
    armature: Array
    gravity: Array
    address: int
    total_mass: float
    mimic_matrix: Array | None
    mimic_index: NDArray[np.intp]
    mimic_ratio: Array
    mimic_offset: Array
    free_q: NDArray[np.intp]
    free_v: NDArray[np.intp]
    _frame_index: dict[str, int]
    _joint_index: dict[str, int]
    _plans: dict[str, Any]  # what ``calls`` keeps of its programs: no part of the model's content

    def __init__(self, robot: Robot, options: Options) -> None:
        """The Model of a checked robot; ``assemble`` takes the options one by one."""
        if hasattr(self, "key"):
            raise AttributeError("a Model is immutable: it cannot be made again")
        if not isinstance(robot, Robot) or not isinstance(options, Options):
            given = f"a {type(robot).__name__} and a {type(options).__name__}"
            raise ModelError(f"a Model is made of {given}, expected a Robot and Options: assemble(robot) makes one")
        with watch.work("making a Model"):
            self._hold(tables(robot, options), options)

    def _hold(self, made: Tables, options: Options) -> None:
        robot = made.robot
        slots = {
            **made._asdict(),
            "options": options,
            "name": robot.name,
            "njoints": len(made.joints),
            "names": tuple(j.name for j in made.joints),
            "gravity": frozen(options.gravity),
            "address": made.bodies.ctypes.data,
            "total_mass": float(made.bodies["inertia"]["m"][1:].sum()),
            "_frame_index": {f"{f.kind}:{f.name}": k for k, f in enumerate(made.frames)},
            "_joint_index": {j.name: k for k, j in enumerate(made.joints)},
            "_plans": {},
        }
        for slot, value in slots.items():
            object.__setattr__(self, slot, value)

    def __setattr__(self, name: str, value: Any) -> None:
        how = "model.with_() and model.reduced() make new ones"
        raise AttributeError(f"a Model is immutable: {name} cannot be set; {how}")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"a Model is immutable: {name} cannot be deleted")

    def __reduce__(self) -> tuple[Any, ...]:
        return Model, (self.robot, self.options)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Model) and self.robot == other.robot and self.options == other.options

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def notes(self) -> tuple[str, ...]:
        """Oddities of the source, and what in it has no counterpart in a Model."""
        return self.robot.notes

    def joint(self, name: str) -> Joint:
        """The joint of that name. Raises ModelError, with similar names, if there is none."""
        try:
            return self.joints[self._joint_index[name]]
        except (KeyError, TypeError):
            raise ModelError(missing("joint", name, self.name, self._joint_index)) from None

    def frame(self, name: str | Frame) -> Frame:
        """The frame of that name: a link's, else a joint's; ``link:NAME`` and ``joint:NAME`` say which.

        Raises ModelError, with similar names, if there is none.
        """
        if isinstance(name, Frame):  # perhaps of another model: its name alone counts
            name = f"{name.kind}:{name.name}"
        if not isinstance(name, str):
            raise ModelError(f'frame is {literal(name)}, expected the name of one of robot "{self.name}"')
        for key in (name, f"link:{name}", f"joint:{name}"):
            if key in self._frame_index:
                return self.frames[self._frame_index[key]]
        raise ModelError(missing("frame", str(name), self.name, [f.name for f in self.frames]))

    def reduced(self, lock: Mapping[str, ArrayLike] | Iterable[str]) -> Model:
        """The Model with some joints locked: their bodies merge into their parents', their frames remain.

        lock  joint name -> coordinates at which it is locked: a number, or (nq,) of the joint. Or names of joints:
              locked at neutral, or at the nearest limit if neutral is outside the limits

        Raises ModelError if lock is neither, or naming an unknown joint or a value of the wrong size or norm.
        """
        return Model(*locked(self, lock))

    def rigid(self, joints: Iterable[str] | None = None) -> Model:
        """The Model with series-elastic joints made rigid: their rotors turn with the joints, exactly.

        joints  names of joints behind springs (``ModelBuilder.add_series_elastic``), by default all

        A torque on a rotor becomes that torque times the gear's ratio on its joint.
        Raises ModelError for anything but names, and naming a joint without a spring.
        """
        return Model(*rigid(self, joints))

    def subtree(self, link: str) -> Model:
        """The Model of a link and its subtree, the link fixed in the world.

        Raises ModelError if there is no such link.
        """
        return Model(subtree_robot(self.robot, link), replace(self.options, root="fixed", base=IDENTITY))

    def with_(
        self,
        gravity: ArrayLike | None = None,
        armature: Mapping[str, float] | None = None,
        payload: Mapping[str, tuple[float, ArrayLike, ArrayLike]] | None = None,
        rotors: Mapping[str, Rotor | None] | None = None,
        transmissions: Iterable[Transmission] = (),
        inertial_parameters: ArrayLike | None = None,
    ) -> Model:
        """A new Model with other gravity, rotor inertias, loads or inertial parameters.

        gravity   (3,) [m/s²]
        armature  joint name -> reflected rotor inertia [kg m² | kg], in place of the present one
        payload   frame -> (mass [kg], com (3,) [m], inertia (3, 3) about it [kg m²]) in that frame, added to its link
        rotors    joint name -> Rotor, or None for none; it takes the place of the joint's armature
        transmissions  Transmissions, whose rotor inertias take the place of their joints' armatures. Off the diagonal
                  of M they may couple a joint of one freedom with the joint right before it only, which keeps M sparse
        inertial_parameters  (njoints, 10)  such as identified ones, in the form of ``sd.inertial_parameters``; the
                  first row is ignored. A joint's link takes the joint's row; links fixed to it then have no mass.
                  Inertias that are not physical are kept, as those of files are

        Raises ModelError, InertiaError naming the joint or frame and the value.
        """
        return Model(*changed(self, gravity, armature, payload, rotors, transmissions, inertial_parameters))

    def __repr__(self) -> str:
        return (
            f"<Model {self.name}: nq {self.nq}, nv {self.nv}, {len(self.robot.links)} links, {self.total_mass:.6g} kg>"
        )

    def __str__(self) -> str:
        return "\n".join(self._tree())

    def _repr_html_(self) -> str:
        from ..pictures.notebook import model_html

        return model_html(self)

    def _tree(self) -> Iterator[str]:
        """A readable tree: a line per link, with its joint."""
        options = self.options
        yield f"{self.name}: {self.nv} freedoms, {self.total_mass:.6g} kg moving, {options.root} root"
        mass = {x.name: x.mass for x in self.robot.links}
        children = self.robot.children
        stack: list[tuple[str, int, RobotJoint | None]] = [(self.robot.root, 0, None)]
        while stack:
            link, depth, joint = stack.pop()
            indent = "  " * depth if depth <= DEEP else "  " * DEEP + f"({depth}) "
            how = "" if joint is None else f" <- {joint.name} ({joint.kind})"
            yield f"{indent}{link}{how}  {mass[link]:.6g} kg"
            stack += [(j.child, depth + 1, j) for j in reversed(children[link])]


def assemble(
    robot: Robot,
    root: str = "fixed",
    gravity: ArrayLike = GRAVITY,
    continuous: str = "angle",
    mimic: bool = False,
) -> Model:
    """The Model of a checked robot.

    root        "fixed", or "floating": six freedoms between the world and the root link, joint ``root_joint``
    gravity     (3,) acceleration of gravity [m/s²]
    continuous  "angle": one coordinate; "cos_sin": two, as Pinocchio has it (planar joints too)
    mimic       True makes the coordinates of mimic joints dependent

    Raises ModelError naming the option, or the mimic joint without a leader; or if robot is not a Robot.
    """
    if not isinstance(robot, Robot):
        raise ModelError(
            f"robot is a {type(robot).__name__}, expected a Robot, as read_urdf and ModelBuilder make them"
        )
    return Model(robot, options_of(root, gravity, continuous, mimic))


def options_of(root: str, gravity: ArrayLike, continuous: str, mimic: bool) -> Options:
    """The options of ``assemble``. Raises ModelError naming an invalid one and its value."""
    if not isinstance(mimic, (bool, np.bool_, int)) or mimic not in (0, 1):
        raise ModelError(f"mimic is {literal(mimic)}, expected True or False")
    return Options(root, gravity_of(gravity), continuous, bool(mimic))
