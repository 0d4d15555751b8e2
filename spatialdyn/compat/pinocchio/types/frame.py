"""Frame, and the enumerations of Pinocchio."""

from __future__ import annotations

from enum import EnumMeta, IntEnum
from typing import Any

from .arguments import ArgumentError, expected
from .inertia import Inertia
from .se3 import SE3
from .tracked_list import owned_copy

__all__ = [
    "ACCELERATION", "ARG0", "ARG1", "ARG2", "ARG3", "ARG4", "BODY", "FIXED_JOINT", "JOINT", "LOCAL",
    "LOCAL_WORLD_ALIGNED", "OP_FRAME", "POSITION", "SENSOR", "VELOCITY", "WORLD", "ArgumentPosition", "Convention",
    "Frame", "FrameType", "KinematicLevel", "ReferenceFrame",
]  # fmt: skip


class _Members(EnumMeta):
    """``names`` and ``values``, as Boost.Python's enumerations have them."""

    @property
    def names(cls) -> dict[str, Any]:
        """The members by name."""
        members: Any = cls
        return {member.name: member for member in members}

    @property
    def values(cls) -> dict[int, Any]:
        """The members by number."""
        members: Any = cls
        return {int(member): member for member in members}


class Enum(IntEnum, metaclass=_Members):
    """An enumeration whose members print as their names; | gives a plain int."""

    def __str__(self) -> str:
        return self.name

    __or__ = int.__or__
    __and__ = int.__and__


class FrameType(Enum):
    """Kind of a frame; values combine to masks: ``FrameType.JOINT | FrameType.FIXED_JOINT``."""

    OP_FRAME = 1
    JOINT = 2
    FIXED_JOINT = 4
    BODY = 8
    SENSOR = 16


class ReferenceFrame(Enum):
    """The axes and the point in which a spatial vector is expressed."""

    WORLD = 0
    LOCAL = 1
    LOCAL_WORLD_ALIGNED = 2


class KinematicLevel(Enum):
    """Highest derivative of the position that is computed."""

    POSITION = 0
    VELOCITY = 1
    ACCELERATION = 2


class Convention(Enum):
    """The frame in which Pinocchio runs a recursion; it does not change results."""

    WORLD = 0
    LOCAL = 1


class ArgumentPosition(Enum):
    """An argument of a function, by position."""

    ARG0 = 0
    ARG1 = 1
    ARG2 = 2
    ARG3 = 3
    ARG4 = 4


ANY_FRAME = 31  # all kinds of frames
OP_FRAME, JOINT, FIXED_JOINT, BODY, SENSOR = FrameType
WORLD, LOCAL, LOCAL_WORLD_ALIGNED = ReferenceFrame
POSITION, VELOCITY, ACCELERATION = KinematicLevel
ARG0, ARG1, ARG2, ARG3, ARG4 = ArgumentPosition


class Frame:
    """A named frame fixed to the body of a joint.

    name, type    str, FrameType
    parentJoint   index of the joint that carries it
    parentFrame   index of the parent frame
    placement     SE3 in the parent joint's frame
    inertia       of the frame's body, in the frame
    """

    __slots__ = ("_inertia", "_name", "_owner", "_parent", "_placement", "parentFrame", "type")

    def __init__(self, *arguments: Any) -> None:
        """``Frame()``, ``Frame(other)``, ``Frame(name, joint[, parent frame], placement, type[, inertia])``."""
        self._owner: Any = None
        self.parentFrame: int
        self.type: FrameType
        if not arguments:
            arguments = ("", 0, 0, SE3.Identity(), FrameType.OP_FRAME)
        if len(arguments) == 1 and isinstance(arguments[0], Frame):
            other = arguments[0]
            arguments = (other.name, other.parentJoint, other.parentFrame, other.placement, other.type, other.inertia)
        if len(arguments) > 2 and isinstance(arguments[2], SE3):
            arguments = (*arguments[:2], 0, *arguments[2:])
        if len(arguments) == 5:
            arguments = (*arguments, Inertia.Zero())
        if not (
            len(arguments) == 6
            and isinstance(arguments[0], str)
            and isinstance(arguments[3], SE3)
            and isinstance(arguments[5], Inertia)
        ):
            given = ", ".join(type(x).__name__ for x in arguments)
            raise ArgumentError(
                f"Frame got ({given}), expected (name, parent joint, [parent frame,] placement, type, [inertia])"
            )
        self._name: str = arguments[0]
        self._parent = int(arguments[1])
        self.parentFrame = int(arguments[2])
        self.type = FrameType(arguments[4])
        self._placement = owned_copy(arguments[3], self)
        self._inertia = owned_copy(arguments[5], self)

    def changed(self) -> None:
        """Notify the model of a change."""
        if self._owner is not None:
            self._owner.changed()

    @property
    def name(self) -> str:
        """Name of the frame."""
        return self._name

    @name.setter
    def name(self, value: str) -> None:
        self._name = expected(value, str, "name")
        self.changed()

    @property
    def placement(self) -> SE3:
        """SE3 in the parent joint's frame."""
        return self._placement

    @placement.setter
    def placement(self, value: SE3) -> None:
        self._placement = owned_copy(expected(value, SE3, "placement"), self)
        self.changed()

    @property
    def inertia(self) -> Inertia:
        """Inertia of the frame's body, in the frame."""
        return self._inertia

    @inertia.setter
    def inertia(self, value: Inertia) -> None:
        self._inertia = owned_copy(expected(value, Inertia, "inertia"), self)

    @property
    def parentJoint(self) -> int:
        """Index of the joint that carries the frame."""
        return self._parent

    @parentJoint.setter
    def parentJoint(self, value: int) -> None:
        self._parent = int(value)
        self.changed()

    parent = parentJoint  # its name in Pinocchio 2 and 3

    @property
    def previousFrame(self) -> int:
        """Index of the parent frame, by its name in Pinocchio 2."""
        return self.parentFrame

    def copy(self) -> Frame:
        """An independent copy that belongs to no model."""
        return Frame(self)

    def cast(self) -> Frame:
        """A copy: the only scalar type is float64."""
        return Frame(self)

    def _content(self) -> tuple[Any, ...]:
        return self.name, self._parent, self.parentFrame, self._placement, self.type, self._inertia

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Frame) and self._content() == other._content()

    __hash__ = object.__hash__

    def __copy__(self) -> Frame:
        return Frame(self)

    def __deepcopy__(self, memo: Any) -> Frame:
        return Frame(self)

    def __reduce__(self) -> tuple[Any, ...]:
        return Frame, self._content()

    def __repr__(self) -> str:
        return (
            f"Frame name: {self.name} paired to (parent joint/ parent frame)({self.parentJoint}/{self.parentFrame})\n"
            f"with relative placement wrt parent joint:\n{self._placement}\ncontaining inertia:\n{self._inertia}\n"
        )
