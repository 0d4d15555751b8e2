"""The unknowns of an identification: inertial parameters of bodies or of a load, armatures, friction and offsets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_words, check_model
from ..calls.dynamics import calls
from ..errors import IdentificationError, literal
from ..model.joint_rows import Joint
from ..model.model import Model
from .pseudo_inertia import NAMES, in_body

Array = NDArray[np.float64]
KINDS = ("armature", "viscous", "coulomb", "offset")  # of a joint of one freedom
WORDS = ("inertial", "friction", *KINDS)
DEFAULT = ("inertial", "friction")


class Body(NamedTuple):
    """A body or a load with ten unknown parameters.

    name   name of the body's joint, or of the frame that carries the load
    joint  index of the joint
    X      None for a body; for a load the placement (4, 4) of its frame in the joint's
    """

    name: str
    joint: int
    X: Array | None


@dataclass(frozen=True)
class Unknowns:
    """Unknown parameters in the order of their columns: ten of each body, then those of joints.

    model   Model
    bodies  Body of each ten columns
    joints  (kind of KINDS, index of a freedom) of each other column
    """

    model: Model
    bodies: tuple[Body, ...]
    joints: tuple[tuple[str, int], ...]

    @property
    def load(self) -> bool:
        """Whether the ten parameters are those of a load, which adds to the model's own."""
        return any(body.X is not None for body in self.bodies)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """A name for each column: "joint.m", "joint.coulomb"."""
        names = [f"{body.name}.{name}" for body in self.bodies for name in NAMES]
        of = {x.idx_v: x.name for x in own_joints(self.model)}
        return (*names, *(f"{of[k]}.{kind}" for kind, k in self.joints))

    @cached_property
    def present(self) -> Array:
        """The model's own values; 0 for a load, and for friction and offsets, which no Model has."""
        own = np.asarray(calls["inertial_parameters"](self.model))
        bodies = [np.zeros(10) if body.X is not None else own[body.joint] for body in self.bodies]
        rest = [self.model.armature[k] if kind == "armature" else 0.0 for kind, k in self.joints]
        return np.concatenate([*bodies, np.array(rest)])

    @property
    def bounded(self) -> NDArray[np.bool_]:
        """Which of the columns of joints are never negative."""
        return np.array([kind != "offset" for kind, _ in self.joints], bool)

    def stacked(self, Y: Array, a: Array, viscous: Array, sign: Array) -> Array:
        """Columns (n, nv, count) from a regressor Y (n, nv, njoints, 10), a, v and sgn v (n, nv)."""
        n, nv = a.shape
        W = np.zeros((n, nv, len(self.names)))
        for k, body in enumerate(self.bodies):
            own = Y[:, :, body.joint]
            W[:, :, 10 * k : 10 * k + 10] = own if body.X is None else own @ in_body(body.X)
        of = {"armature": a, "viscous": viscous, "coulomb": sign, "offset": np.ones_like(a)}
        for column, (kind, k) in enumerate(self.joints, start=10 * len(self.bodies)):
            W[:, k, column] = of[kind][:, k]
        return W

    def values(self, kind: str, x: Array) -> Array:
        """Values (nv,) of one kind from the columns of joints; 0 for a freedom without such a column."""
        found = np.zeros(self.model.nv)
        for column, (own, k) in enumerate(self.joints, start=10 * len(self.bodies)):
            if own == kind:
                found[k] = x[column]
        return found


def unknowns_of(model: Model, parameters: Any, payload: Any = None, bodies: Any = None) -> Unknowns:
    """The Unknowns of arguments. Raises IdentificationError, ModelError."""
    check_model(model)
    if springs := [x.name for x in model.robot.joints if x.spring is not None]:
        raise IdentificationError(
            f'joint "{springs[0]}" has a spring, expected joints without: no equation has its torque; Model.rigid()'
        )
    if not model.nv:
        raise IdentificationError(f'model "{model.name}" has no joint that moves, expected one that does')
    words = words_of(parameters)
    kinds = {*words} | ({"viscous", "coulomb"} if "friction" in words else set())
    made: list[Body] = []
    if bodies is not None and payload is not None:
        raise IdentificationError(
            f"bodies is {literal(bodies)}, expected None beside payload {literal(payload)}: theirs are known"
        )
    if bodies is not None and "inertial" not in words:
        raise IdentificationError(f'bodies is {literal(bodies)}, expected None where parameters has no "inertial"')
    if payload is not None:
        frame = model.frame(payload)
        if not frame.joint:
            raise IdentificationError(
                f'payload is on frame "{frame.name}", which does not move, expected one that does'
            )
        made = [Body(frame.name, frame.joint, np.array(frame.placement))]
    elif "inertial" in words:
        wanted = None if bodies is None else {model.joint(x).name for x in names_of("bodies", bodies)}
        made = [Body(x.name, k, None) for k, x in enumerate(model.joints) if k and (wanted is None or x.name in wanted)]
    joints = [
        (kind, x.idx_v) for kind in KINDS if kind in kinds for x in own_joints(model)
        if x.nv == 1 and (kind != "armature" or _bare(model, x.name))
    ]  # fmt: skip
    if not made and not joints:
        raise IdentificationError(f"parameters is {literal(parameters)}, expected some that this robot has")
    return Unknowns(model, tuple(made), tuple(joints))


def words_of(parameters: Any) -> tuple[str, ...]:
    """Some of WORDS, from words or from one text that joins them by +. Raises SpatialDynError."""
    return as_words("parameters", parameters.split("+") if isinstance(parameters, str) else parameters, WORDS)


def own_joints(model: Model) -> list[Joint]:
    """The joints with freedoms of their own: all but mimic joints."""
    followers = {x.name for x in model.robot.joints if x.mimic is not None} if model.mimic_matrix is not None else set()
    return [x for x in model.joints[1:] if x.name not in followers]


def freedoms_of(model: Model) -> list[str]:
    """A name for each freedom: its joint's, with an index if the joint has several freedoms."""
    return [j.name if j.nv == 1 else f"{j.name}[{k}]" for j in own_joints(model) for k in range(j.nv)]


def floats(model: Model) -> bool:
    """Whether the robot has a floating base as first joint; its six freedoms are then the first."""
    return model.njoints > 1 and model.joints[1].kind == "floating"


def whole_number(name: str, value: Any, least: int, most: int = 1 << 20) -> int:
    """A whole number within bounds. Raises IdentificationError naming the argument."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not least <= value <= most:
        raise IdentificationError(f"{name} is {literal(value)}, expected a whole number of {least} to {most}")
    return int(value)


def names_of(argument: str, given: Any) -> list[str]:
    """A name or several. Raises IdentificationError."""
    if isinstance(given, str):
        return [given]
    try:
        return list(given)
    except TypeError:
        raise IdentificationError(f"{argument} is {literal(given)}, expected names of joints") from None


def _bare(model: Model, name: str) -> bool:
    """Whether a joint's armature is independent of rotors and transmissions."""
    joints = {x.name: x for x in model.robot.joints}
    if name not in joints:
        return False
    own = joints[name]
    behind = any(x.shared is not None and x.shared[0] == name for x in joints.values())
    return own.rotor is None and own.shared is None and own.spring is None and not behind
