"""The kinds of joints: along or about one axis, of several velocities, chains of joints, and joints that follow one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ....algebra.rotations import UNIT_AXIS
from ....errors import ModelError
from ..types.arguments import OMITTED, ArgumentError, expected, number
from ..types.bases import owned_attribute
from ..types.se3 import SE3
from ..types.tracked_list import OwnedList
from .joint import NOWHERE, JointModel, Step, Vector, X, Y, Z, joint_kind, joint_of

__all__ = [
    "JointModelComposite", "JointModelFreeFlyer", "JointModelHX", "JointModelHY", "JointModelHZ",
    "JointModelHelicalUnaligned", "JointModelMimic", "JointModelPX", "JointModelPY", "JointModelPZ",
    "JointModelPlanar", "JointModelPrismaticUnaligned", "JointModelRUBX", "JointModelRUBY", "JointModelRUBZ",
    "JointModelRX", "JointModelRY", "JointModelRZ", "JointModelRevoluteUnaligned",
    "JointModelRevoluteUnboundedUnaligned", "JointModelSpherical", "JointModelSphericalZYX",
    "JointModelTranslation", "JointModelUniversal",
]  # fmt: skip


def unit(what: str, axis: Any) -> Vector:
    """An axis, an array or three numbers, as a unit vector.

    Raises ArgumentError, a TypeError, for another size, ModelError for the null vector.
    """
    given = axis[0] if len(axis) == 1 else axis
    if len(axis) == 1 and not isinstance(given, np.ndarray):
        raise ArgumentError(f"axis of {what} is a {type(given).__name__}, expected an array or three numbers")
    u = np.asarray(given, dtype=float).ravel()
    if u.shape != (3,):
        raise ArgumentError(f"axis of {what} is {u.tolist()}, of {u.size} numbers, expected three")
    if not np.isfinite(u).all() or not u.any():
        raise ModelError(f"axis of {what} is {u.tolist()}, expected three finite numbers, not all 0")
    norm = math.hypot(*u)
    if abs(norm - 1.0) > UNIT_AXIS:
        u = u / norm
    return float(u[0]) + 0.0, float(u[1]) + 0.0, float(u[2]) + 0.0


def _axis(slot: str, doc: str) -> Any:
    return owned_attribute(slot, lambda value, joint: unit(joint.shortname(), (np.asarray(value),)), doc, np.array)


class OneAxis(JointModel):
    """A joint along or about an axis."""

    __slots__ = ("_axis", "_pitch")
    _kind: str
    _along: Vector | None = None  # the axis, where it is fixed

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__()
        screw = self._kind == "helical"
        if screw and {*named} == {"pitch"}:
            given, named = (*given, named["pitch"]), {}
        wanted = [] if self._along else ["an axis or three numbers"]
        if named or len(given) not in ((0, int(screw)) if self._along else (0, 1 + screw, 3 + screw)):
            what = ", and ".join([*wanted, *["a pitch"] * screw]) or "nothing"
            raise ArgumentError(f"{self._name} got {len(given) + len(named)} arguments, expected {what}")
        axis = given[: len(given) - screw]
        self._axis: Vector = self._along or (unit(self._name, axis) if axis else X)
        self._pitch = number(given[-1], "pitch") if screw and given else 0.0

    def copy(self) -> JointModel:
        made: OneAxis = OneAxis.__new__(type(self))
        made._owner, made._axis, made._pitch = None, self._axis, self._pitch
        made.id, made.idx_q, made.idx_v, made.idx_vExtended = self._indexes()
        return made

    def steps(self) -> tuple[Step, ...]:
        return (Step(self._kind, self._axis, pitch=self._pitch),)

    def parameters(self) -> tuple[Any, ...]:
        return *(() if self._along else self._axis), *([self._pitch] if self._kind == "helical" else [])


_PITCH = owned_attribute("_pitch", lambda x, joint: number(x, "pitch"), "Travel along the axis per radian [m/rad].")


def _motion_axis(joint: Any) -> Any:
    """The axis (3,)."""
    return np.array(joint._axis)


def _about(short: str, name: str, kind: str, doc: str, pitch: str = "") -> list[Any]:
    """The classes of joints about or along x, y, z, and any axis."""
    own: dict[str, Any] = {"_kind": kind, "_steps": (Step(kind),), **({"pitch": _PITCH} if pitch else {})}
    aligned = doc + f": ``({pitch})``, 0 if left out." * bool(pitch)
    axes: list[tuple[str, Vector]] = [("x", X), ("y", Y), ("z", Z)]
    made = [
        joint_kind(f"JointModel{short}{at.upper()}", OneAxis, f"{aligned.format(at).rstrip('.')}.", _along=axis,
                   getMotionAxis=_motion_axis, **own)
        for at, axis in axes
    ]  # fmt: skip
    given = f"``(x, y, z{pitch and ', '}{pitch})`` or ``(axis (3,){pitch and ', '}{pitch})``"
    own["axis"] = _axis("_axis", "The unit axis (3,), a copy: assign to change it.")
    return [*made, joint_kind(f"JointModel{name}Unaligned", OneAxis, f"{doc.format('an axis')}: {given}.", **own)]


_ROWS = (
    ("R", "Revolute", "revolute", "A rotation about {}"),
    ("P", "Prismatic", "prismatic", "A translation along {}"),
    ("RUB", "RevoluteUnbounded", "continuous", "A rotation without limits, q = [cos, sin], about {}"),
    ("H", "Helical", "helical", "A screw, of a pitch in m/rad, about {}", "pitch"),
)
BY_AXIS = {row[2]: _about(*row) for row in _ROWS}  # kind of the library's joint -> its classes
JointModelRX, JointModelRY, JointModelRZ, JointModelRevoluteUnaligned = BY_AXIS["revolute"]
JointModelPX, JointModelPY, JointModelPZ, JointModelPrismaticUnaligned = BY_AXIS["prismatic"]
JointModelRUBX, JointModelRUBY, JointModelRUBZ, JointModelRevoluteUnboundedUnaligned = BY_AXIS["continuous"]
JointModelHX, JointModelHY, JointModelHZ, JointModelHelicalUnaligned = BY_AXIS["helical"]


# --- several velocities ----------------------------------------------------------------------------------


def _several(name: str, doc: str, *steps: Step) -> Any:
    return joint_kind(f"JointModel{name}", JointModel, doc, _steps=steps)


_SPHERICAL = "A rotation: q = quaternion x y z w, v = angular velocity in the body's axes."
_ZYX = "A rotation by three angles, about z, the rotated y, the rotated x; v = their rates."
_PLANAR = "A motion in the plane of x and y: q = x y cos sin, v in the body's axes."
_FREE = "Any motion: q = x y z, quaternion x y z w; v in the body's axes, linear first."
_ALONG = "A translation: q = x y z."
JointModelSpherical = _several("Spherical", _SPHERICAL, Step("spherical"))
JointModelSphericalZYX = _several("SphericalZYX", _ZYX, *(Step("revolute", axis) for axis in (Z, Y, X)))
JointModelTranslation = _several("Translation", _ALONG, *(Step("prismatic", axis) for axis in (X, Y, Z)))
JointModelPlanar = _several("Planar", _PLANAR, Step("planar", Z))
JointModelFreeFlyer = _several("FreeFlyer", _FREE, Step("floating"))


class Universal(JointModel):
    """Two rotations, about ``axis1`` and the rotated ``axis2``: ``(axis1 (3,), axis2 (3,))`` or six numbers."""

    __slots__ = ("_axis1", "_axis2")
    axis1 = _axis("_axis1", "The first axis (3,); a copy: assign to change it.")
    axis2 = _axis("_axis2", "The second axis (3,); a copy: assign to change it.")

    def __init__(self, *axes: Any) -> None:
        super().__init__()
        if len(axes) not in (0, 2, 6):
            raise ArgumentError(f"JointModelUniversal got {len(axes)} arguments, expected two axes or six numbers")
        half = len(axes) // 2
        self._axis1: Vector = unit(self._name, axes[:half]) if axes else X
        self._axis2: Vector = unit(self._name, axes[half:]) if axes else Y

    def steps(self) -> tuple[Step, ...]:
        return Step("revolute", self._axis1), Step("revolute", self._axis2)

    def parameters(self) -> tuple[Any, ...]:
        return *self._axis1, *self._axis2


_UNIVERSAL = Step("revolute", X), Step("revolute", Y)
JointModelUniversal = joint_kind("JointModelUniversal", Universal, Universal.__doc__, _steps=_UNIVERSAL)


class Composite(JointModel):
    """A chain of joints that counts as one: ``(size)`` or ``(joint[, placement[, name]])``, then ``addJoint``.

    joints, jointPlacements   the parts, and the placement of each after the one before it
    """

    __slots__ = ("_names", "jointPlacements", "joints")
    nq = property(lambda self: sum(joint.nq for joint in self.joints), doc=JointModel.nq.__doc__)
    nv = property(lambda self: sum(joint.nv for joint in self.joints), doc=JointModel.nv.__doc__)
    njoints = property(lambda self: len(self.joints), doc="Number of parts.")

    def __init__(self, *arguments: Any) -> None:
        super().__init__()
        self.joints: list[JointModel] = OwnedList(self, JointModel)
        self.jointPlacements: list[SE3] = OwnedList(self, SE3)
        self._names: list[str] = []
        if arguments and not isinstance(arguments[0], int):
            self.addJoint(*arguments)

    def addJoint(self, joint_model: JointModel, joint_placement: Any = OMITTED, name: str = "") -> Composite:
        """Append a part, by default without a displacement; returns the composite."""
        if self.id != NOWHERE:
            raise ModelError(f"the composite is joint {self.id} of a model, expected one that is in none yet")
        self.joints.append(joint_model)
        self.jointPlacements.append(SE3.Identity() if joint_placement is OMITTED else joint_placement)
        self._names.append(str(name))
        return self

    def getJointId(self, joint_name: str) -> int:
        """Index of the part of that name; njoints if there is none."""
        return self._names.index(joint_name) if joint_name in self._names else len(self._names)

    def groups(self) -> list[str]:
        return [group for joint in self.joints for group in joint.groups()]

    def limited(self, tangent: bool) -> list[bool]:
        return [has for joint in self.joints for has in joint.limited(tangent)]

    def setIndexes(self, joint_id: int, idx_q: int, idx_v: int, idx_vExtended: int | None = None) -> None:
        super().setIndexes(joint_id, idx_q, idx_v, idx_vExtended)
        q, v = self.idx_q, self.idx_v
        for joint, placement in zip(self.joints, self.jointPlacements, strict=True) if self.id != NOWHERE else ():
            joint.setIndexes(joint_id, q, v)
            q, v = q + joint.nq, v + joint.nv
            placement._x.flags.writeable = False  # those of a joint in a model stay

    def steps(self) -> tuple[Step, ...]:
        made = []
        for joint, placement in zip(self.joints, self.jointPlacements, strict=True):
            for k, step in enumerate(joint.steps()):
                both = placement.homogeneous @ np.reshape(step.placement, (4, 4))
                made.append(step if k else step._replace(placement=tuple(both.ravel().tolist())))
        return tuple(made)

    def state(self) -> dict[str, Any]:
        placements = [placement._x.ravel().tolist() for placement in self.jointPlacements]
        parts = zip([joint.state() for joint in self.joints], placements, self._names, strict=True)
        return {**super().state(), "parts": [list(part) for part in parts]}

    def _fill(self, given: Mapping[str, Any]) -> None:
        for part, placement, name in given["parts"]:
            self.addJoint(joint_of(part), SE3.over(np.reshape(placement, (4, 4)).astype(float)), name)

    def __repr__(self) -> str:
        parts = (f"  {joint.shortname()}" for joint in self.joints)
        return "\n".join([f"{self.shortname()} containing following models:", *parts, ""])


JointModelComposite = joint_kind("JointModelComposite", Composite, Composite.__doc__)


class Mimic(JointModel):
    """A joint that follows another: ``(joint of a model, scaling, offset)``, q = scaling q' + offset.

    It has the motion of that joint and no coordinates of its own.
    """

    __slots__ = ("_leader", "_motion", "_offset", "_scaling")
    nvExtended = property(lambda self: 1, doc=JointModel.nvExtended.__doc__)
    leader = property(lambda self: self._leader, doc="Index of the leader.")
    scaling = owned_attribute("_scaling", lambda x, joint: float(x), "Ratio of the joint's coordinate to its leader's.")
    offset = owned_attribute("_offset", lambda x, joint: float(x), "Coordinate of the joint where its leader's is 0.")

    def __init__(self, joint_model: Any = OMITTED, scaling: float = 1.0, offset: float = 0.0) -> None:
        super().__init__()
        leader = None if joint_model is OMITTED else expected(joint_model, JointModel, "joint_model")
        self._follow(JointModelRX() if leader is None else leader, leader, scaling, offset)

    @classmethod
    def of(cls, motion: JointModel, leader: JointModel, scaling: float, offset: float) -> Mimic:
        """A joint with the motion of ``motion`` and the coordinates of ``leader``."""
        made: Mimic = cls()
        made._follow(motion, leader, scaling, offset)
        return made

    def _follow(self, motion: JointModel, leader: JointModel | None, scaling: float, offset: float) -> None:
        motion = motion._motion if isinstance(motion, Mimic) else motion
        for joint in (motion, leader or motion):
            if joint.nv != 1:
                raise ModelError(f"a {joint.shortname()} has {joint.nv} freedoms, expected a joint of one")
        self._motion: JointModel = motion.copy()
        self._leader = NOWHERE if leader is None else leader.id
        self._scaling, self._offset = float(scaling), float(offset)
        if leader is not None:
            self.idx_q, self.idx_v = leader.idx_q, leader.idx_v

    def steps(self) -> tuple[Step, ...]:
        return self._motion.steps()

    def neutral(self) -> list[float]:
        return []

    def state(self) -> dict[str, Any]:
        own = {"leader": self._leader, "scaling": self._scaling, "offset": self._offset}
        return {**super().state(), "motion": self._motion.state(), **own}

    def _fill(self, given: Mapping[str, Any]) -> None:
        self._follow(joint_of(given["motion"]), None, given["scaling"], given["offset"])
        self._leader = given["leader"]

    def __repr__(self) -> str:
        motion = f"  Mimicking joint type: {self._motion.shortname()}\n  Mimicked joint id: {self._leader}\n"
        return f"{super().__repr__()}{motion}  Mimic scaling: {self._scaling:g}\n  Mimic offset: {self._offset:g}\n"


JointModelMimic = joint_kind("JointModelMimic", Mimic, Mimic.__doc__)
