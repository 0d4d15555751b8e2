"""JointModel: the motion that a joint allows, and its indices in q and v.

Every joint is a chain of the library's joints, its ``steps()``: one for most, two for a universal joint, three for
a translation or angles about z, y, x, and the steps of its parts for a composite.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ....algebra import spatial
from ....algebra.euclidean import Vec
from ....bodies.kinds import kind_of
from ....errors import ShapeError
from ....model.assembly import IDENTITY
from ....model.joint_rows import joint_transform, matrix_from_pose, pose_from_matrix, subspace
from ..types.arguments import ArgumentError, Array, described, expected, module_of_caller
from ..types.bases import OwnedValue, Registered
from ..types.motion import Motion
from ..types.se3 import SE3

__all__ = ["JointData", "JointModel"]


Vector = tuple[float, float, float]
NOWHERE = 2**64 - 1  # id of a joint that is in no model
X, Y, Z = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Step(NamedTuple):
    """A joint of the library: its kind, axis and pitch, and its placement after the previous step, row by row."""

    kind: str
    axis: Vector = Z
    placement: tuple[float, ...] = IDENTITY
    pitch: float = 0.0


class Variant(type):
    """Class of the joint model classes."""

    def __call__(cls, *arguments: Any, **named: Any) -> Any:
        """``JointModel(other)`` is a JointModel that holds a copy of any joint, ``JointModel()`` a rotation about x."""
        if cls is not JointModel:
            return super().__call__(*arguments, **named)
        if len(arguments) == 1 and isinstance(arguments[0], JointModel):
            return arguments[0].copy().held()
        if arguments or named:
            raise ArgumentError(f"JointModel got {arguments or named!r}, expected a joint model or nothing")
        return kind_named("JointModelRX")().held()


class JointModel(OwnedValue, metaclass=Variant):
    """A joint of any kind, as ``model.joints`` holds it; ``extract()`` is one of its own kind.

    id             index in its model
    idx_q, nq      first index and number of its coordinates in q
    idx_v, nv      first index and number of its velocities in v
    """

    __slots__ = ("_owner", "id", "idx_q", "idx_v", "idx_vExtended")
    _name = "JointModel"
    _steps: tuple[Step, ...] = ()
    _nq, _nv, _bounded = 0, 0, 0  # of the steps; the first coordinates, this many, can have a limit
    _own_kind: Any  # the class of its kind, and that of joints in a model
    _any_kind: Any

    def __init__(self) -> None:
        self._owner: Any = None
        self.id: int = NOWHERE
        self.idx_q = self.idx_v = self.idx_vExtended = -1

    nq: Any = property(lambda self: self._nq, doc="Number of coordinates.")
    nv: Any = property(lambda self: self._nv, doc="Number of velocities.")
    leader: Any = property(lambda self: None, doc="Index of the leader of a mimic joint; None for others.")
    nvExtended: Any = property(lambda self: self.nv, doc="Number of velocities that it would have without mimicking.")
    hasConfigurationLimit = property(lambda self: self.limited(False), doc="Whether each coordinate can have a limit.")
    hasConfigurationLimitInTangent = property(
        lambda self: self.limited(True), doc="Whether the coordinate of each velocity can have a limit."
    )

    def steps(self) -> tuple[Step, ...]:
        """The library's joints that make up this one."""
        return self._steps

    def neutral(self) -> list[float]:
        """Coordinates (nq,) at which the joint's two frames coincide."""
        return [x for step in self.steps() for x in kind_of(step.kind, "cos_sin").undisplaced]

    def parameters(self) -> tuple[Any, ...]:
        """Constructor arguments that make an equal joint."""
        return ()

    @classmethod
    def shortname(cls) -> str:
        """Name of the kind of joint."""
        return cls._name

    classname = shortname

    def extract(self) -> JointModel:
        """A copy, of the class of its kind."""
        made = self.copy()
        made.__class__ = self._own_kind
        return made

    def held(self) -> JointModel:
        """The joint itself as a JointModel, which is of no kind: the class of those in a model."""
        self.__class__ = self._any_kind
        return self

    def state(self) -> dict[str, Any]:
        """Kind and parameters as names and numbers, of which ``joint_of`` makes an equal joint without indices."""
        return {"kind": self._name, "parameters": [*self.parameters()]}

    def _fill(self, given: Mapping[str, Any]) -> None:
        """Take over what the constructor does not take, from a state."""

    def groups(self) -> list[str]:
        """The factors of the configuration space."""
        groups = [kind_of(step.kind, "cos_sin").group for step in self.steps()] if self.nv else []
        return [groups[0]] if groups and groups[0] != "R" else [f"R^{len(groups)}"] * bool(groups)

    def lieGroup(self) -> Any:
        """The configuration space of the joint."""
        return Registered.classes["LieGroup"](self.groups())

    def createData(self) -> JointData:
        """A JointData for the results of ``calc``."""
        return JointData(self)

    def calc(self: Any, jdata: JointData, q: Any, v: Any = None) -> None:
        """Write pose M, subspace S, and with v velocity v and bias c, at the model's q, v, into the data."""
        jdata.joint_q[:] = _own("q", q, self.idx_q, _coordinates(self))
        jdata.joint_v[:] = 0.0 if v is None else _own("v", v, self.idx_v, len(jdata.joint_v))
        if self.leader is not None:
            jdata.joint_q[:] = self.scaling * jdata.joint_q + self.offset
            jdata.joint_v *= self.scaling
        X, twist, bias = spatial.identity_pose(), spatial.zero_motion(), spatial.zero_motion()
        columns: list[spatial.Motion] = []
        at, n = 0, 0
        for step in self.steps():
            nq = kind_of(step.kind, "cos_sin").nq
            q_step = jdata.joint_q[at : at + nq]
            moved = pose_from_matrix(joint_transform(step.kind, step.axis, q_step, "cos_sin", step.pitch))
            moved = spatial.compose(pose_from_matrix(step.placement), moved)
            S = [spatial.Motion(Vec(*s[:3]), Vec(*s[3:])) for s in subspace(step.kind, step.axis, step.pitch).tolist()]
            own = spatial.zero_motion()
            for s in S:
                own = spatial.add_motion(own, spatial.scale_motion(float(jdata.joint_v[n]), s))
                n += 1
            X = spatial.compose(X, moved)
            twist = spatial.add_motion(spatial.motion_to_child(moved, twist), own)
            bias = spatial.add_motion(spatial.motion_to_child(moved, bias), spatial.cross_motion(twist, own))
            columns = [spatial.motion_to_child(moved, s) for s in columns] + S
            at += nq
        jdata.M = SE3.over(np.array(matrix_from_pose(X)))
        jdata.S[...] = np.array([_linear_first(s) for s in columns]).T.reshape(jdata.S.shape)
        if v is not None:
            jdata.v, jdata.c = Motion.over(_linear_first(twist)), Motion.over(_linear_first(bias))

    def setIndexes(self, joint_id: int, idx_q: int, idx_v: int, idx_vExtended: int | None = None) -> None:
        """Set the joint's indices in its model."""
        self.id, self.idx_q, self.idx_v = int(joint_id), int(idx_q), int(idx_v)
        self.idx_vExtended = int(idx_v if idx_vExtended is None else idx_vExtended)
        self.changed()

    def hasSameIndexes(self, other: JointModel) -> bool:
        """Whether both have the same indices."""
        return bool(self._indexes() == expected(other, JointModel, "other")._indexes())

    def limited(self, tangent: bool) -> list[bool]:
        """Whether each coordinate can have a limit; ``tangent``: whether that of each velocity can."""
        return [k < self._bounded for k in range(self.nv if tangent else self.nq)]

    def copy(self) -> JointModel:
        """An independent copy that belongs to no model."""
        made: JointModel = joint_of(self.state(), type(self), self._indexes())
        return made

    def _indexes(self) -> tuple[int, int, int, int]:
        return self.id, self.idx_q, self.idx_v, self.idx_vExtended

    def __eq__(self, other: object) -> bool:
        return isinstance(other, JointModel) and self._indexes() == other._indexes() and self.state() == other.state()

    __hash__ = object.__hash__

    def __reduce__(self) -> tuple[Any, ...]:
        kind = None if type(self) is self._any_kind else self._own_kind
        return joint_of, (self.state(), kind, self._indexes())

    def __repr__(self) -> str:
        indexes = zip(("index", "index q", "index v", "index vExtended"), self._indexes(), strict=True)
        numbers = [*indexes, ("nq", self.nq), ("nv", self.nv), ("nvExtended", self.nvExtended)]
        return "\n".join([self.shortname(), *(f"  {name}: {x}" for name, x in numbers), ""])


def joint_kind(name: str, base: Any, doc: str | None, **own: Any) -> Any:
    """The class of a kind of joints with that name, and beside it the class of such joints in a model.

    base  class that behaves as these joints do
    own   its attributes: _steps, of which the numbers of coordinates follow ...
    """
    space = {"__slots__": (), "__doc__": doc, "__module__": module_of_caller()}
    kinds = [kind_of(step.kind, "cos_sin") for step in own.get("_steps", ())]
    sizes = [(kind.nq, kind.nv, kind.nq if kind.unit is None else kind.lengths) for kind in kinds]
    numbers = dict(zip(("_nq", "_nv", "_bounded"), map(sum, zip(*sizes, strict=True)), strict=bool(sizes)))
    behaviour: Any = Variant(f"_{name}", (base,), {**space, "_name": name, **numbers, **own})
    behaviour._any_kind = Variant("JointModel", (behaviour,), space)
    behaviour._own_kind = Variant(name, (behaviour,), space)
    return behaviour._own_kind


@cache
def kind_named(name: str) -> Any:
    """The class of a kind of joints. Raises KeyError if there is none."""
    below: list[Any] = [JointModel]
    while below:
        found = below.pop()
        if found.__dict__.get("_name") == name and found is not JointModel:
            return found._own_kind
        below += found.__subclasses__()
    raise KeyError(name)


def joint_of(state: Mapping[str, Any], kind: Any = "own", indexes: tuple[int, int, int, int] | None = None) -> Any:
    """The joint of a ``state()``: of a class, of its own kind by default, of none if None."""
    made = kind_named(state["kind"])(*state["parameters"])
    made._fill(state)
    if kind != "own":
        made.__class__ = made._any_kind if kind is None else kind
    if indexes is not None:
        made.setIndexes(*indexes)
    return made


class JointData:
    """Results of ``joint.calc(data, q[, v])``.

    M                pose of the frame after the joint in the frame before it
    S                (6, nv) motion subspace, (6,) of a joint with one velocity
    v, c             Motion: velocity, and acceleration at zero joint acceleration
    joint_q, joint_v the joint's own coordinates and velocities
    U, Dinv, UDinv   articulated inertia times S and its products; zero, for no algorithm writes them
    """

    def __init__(self, joint: Any) -> None:
        n = joint.nvExtended
        self._kind: str = joint.shortname()
        self.M, self.v, self.c = SE3.Identity(), Motion.Zero(), Motion.Zero()
        self.S = np.zeros((6, n)) if n > 1 else np.zeros(6)
        self.U, self.UDinv = np.zeros(self.S.shape), np.zeros(self.S.shape)
        self.Dinv = np.zeros((n, n))
        self.joint_q, self.joint_v = np.zeros(_coordinates(joint)), np.zeros(n)

    def shortname(self) -> str:
        """Name of the kind of joint data."""
        return self._kind.replace("JointModel", "JointData")

    def __repr__(self) -> str:
        return self.shortname()


def _linear_first(m: spatial.Motion) -> Array:
    return np.array([*m.v, *m.w], dtype=float)


def _coordinates(joint: Any) -> int:
    """Number of coordinates of the joint's motion, its own or its leader's."""
    return sum(kind_of(step.kind, "cos_sin").nq for step in joint.steps())


def _own(name: str, value: Any, at: int, n: int) -> Array:
    """A joint's entries of a vector of the model; for a joint in no model, the first entries."""
    if not isinstance(value, np.ndarray):
        raise ArgumentError(f"{name} is {described(value)}, expected an array")
    first = max(at, 0)
    part = np.asarray(value, dtype=float).ravel()[first : first + n]
    if len(part) != n:
        raise ShapeError(f"{name} has {value.size} numbers, expected at least {first + n}")
    return part
