"""Frame, and the enumerations of Pinocchio."""

from __future__ import annotations

from collections.abc import Callable
from enum import EnumMeta, IntEnum
from operator import attrgetter
from typing import Any

from .arguments import ArgumentError, by_name, described, expected, of_pinocchio
from .bases import OwnedValue, owned_attribute
from .inertia import Inertia
from .se3 import SE3

__all__ = [
    "ACCELERATION", "ARG0", "ARG1", "ARG2", "ARG3", "ARG4", "BODY", "FIXED_JOINT", "JOINT", "LOCAL",
    "LOCAL_WORLD_ALIGNED", "OP_FRAME", "POSITION", "SENSOR", "VELOCITY", "WORLD", "ArgumentPosition", "Convention",
    "Frame", "FrameType", "KinematicLevel", "ReferenceFrame",
]  # fmt: skip


class _Members(EnumMeta):
    """``names`` and ``values``, as Boost.Python's enumerations have them."""

    names = property(lambda cls: dict(cls.__members__), doc="The members by name.")
    values = property(lambda cls: {x.value: x for x in cls.__members__.values()}, doc="The members by number.")


class Enum(IntEnum, metaclass=_Members):
    """An enumeration whose members print as their names; | gives a plain int."""

    def __str__(self) -> str:
        return self.name

    __or__ = int.__or__
    __and__ = int.__and__


class FrameType(Enum):
    """Kind of a frame; values combine to masks: ``FrameType.JOINT | FrameType.FIXED_JOINT``."""

    OP_FRAME, JOINT, FIXED_JOINT, BODY, SENSOR = 1, 2, 4, 8, 16


class ReferenceFrame(Enum):
    """The axes and the point in which a spatial vector is expressed."""

    WORLD, LOCAL, LOCAL_WORLD_ALIGNED = range(3)


class KinematicLevel(Enum):
    """Highest derivative of the position that is computed."""

    POSITION, VELOCITY, ACCELERATION = range(3)


class Convention(Enum):
    """The frame in which Pinocchio runs a recursion; it does not change results."""

    WORLD, LOCAL = range(2)


class ArgumentPosition(Enum):
    """An argument of a function, by position."""

    ARG0, ARG1, ARG2, ARG3, ARG4 = range(5)


ANY_FRAME = 31  # all kinds of frames
OP_FRAME, JOINT, FIXED_JOINT, BODY, SENSOR = FrameType
WORLD, LOCAL, LOCAL_WORLD_ALIGNED = ReferenceFrame
POSITION, VELOCITY, ACCELERATION = KinematicLevel
ARG0, ARG1, ARG2, ARG3, ARG4 = ArgumentPosition


_FIELDS: tuple[tuple[str, Callable[[Any, Any], Any], str], ...] = (
    ("name", lambda x, frame: expected(x, str, "name"), "Name of the frame."),
    ("parentJoint", lambda x, frame: int(x), "Index of the joint that carries the frame."),
    ("parentFrame", lambda x, frame: int(x), "Index of the parent frame."),
    ("placement", lambda x, frame: expected(x, SE3, "placement").copy(), "SE3 in the joint's frame."),
    ("type", lambda x, frame: FrameType(x), "FrameType."),
    ("inertia", lambda x, frame: expected(x, Inertia, "inertia").copy(), "Inertia of its body."),
)


_CONTENT = attrgetter(*(f"_{row[0]}" for row in _FIELDS))


def _like(value: Any) -> Any:
    """A copy of a Value; its own ``copy`` checks more."""
    made = object.__new__(type(value))
    made._x = value._x.copy()
    return made


class Frame(OwnedValue):
    """A named frame fixed to the body of a joint: ``Frame()``, ``Frame(other)``, also of Pinocchio's own class,
    ``Frame(name, joint[, parent frame], placement, type[, inertia])``.
    """

    __slots__ = ("_inertia", "_name", "_owner", "_parentFrame", "_parentJoint", "_placement", "_type")

    name, parentJoint, parentFrame, placement, type, inertia = (
        owned_attribute(f"_{x}", own, doc) for x, own, doc in _FIELDS
    )
    parent = parentJoint  # its name in Pinocchio 2 and 3
    previousFrame = parentFrame  # its name in Pinocchio 2

    def __init__(self, *arguments: Any, **named: Any) -> None:
        self._owner: Any = None
        if named:
            placed = "parent_frame" not in named and (len(arguments) < 3 or isinstance(arguments[2], SE3))
            order = f"name parent_joint {'' if placed else 'parent_frame '}placement type inertia"
            other = named.keys() & {"other", "clone"}
            order, least = (other.pop(), 1) if other else (order, len(order.split()) - 1)
            given = by_name("Frame", order, arguments, named, least)
            arguments = tuple(given[x] for x in order.split() if x in given)
        if not arguments:
            arguments = ("", 0, 0, SE3.Identity(), FrameType.OP_FRAME)
        if len(arguments) == 1 and isinstance(arguments[0], Frame):
            arguments = arguments[0]._content()
        elif len(arguments) == 1 and of_pinocchio(arguments[0], "Frame"):
            x = arguments[0]
            arguments = (x.name, x.parentJoint, x.parentFrame, SE3(x.placement), FrameType[x.type.name])
            arguments = (*arguments, Inertia(x.inertia))
        if len(arguments) > 2 and isinstance(arguments[2], SE3):
            arguments = (*arguments[:2], 0, *arguments[2:])
        if len(arguments) == 5:
            arguments = (*arguments, Inertia.Zero())
        kinds = (str, object, object, SE3, object, Inertia)
        if len(arguments) != 6 or not all(map(isinstance, arguments, kinds)):
            got = ", ".join(described(x).partition(" ")[2] for x in arguments)
            raise ArgumentError(
                f"Frame got ({got}), expected (name, parent joint, [parent frame,] placement, type, [inertia])"
            )
        for row, value in zip(_FIELDS, arguments, strict=True):
            setattr(self, row[0], value)

    def copy(self) -> Frame:
        """An independent copy that belongs to no model."""
        own: Any = self
        made: Any = Frame.__new__(Frame)
        made._owner, made._name, made._type = None, own._name, own._type
        made._parentJoint, made._parentFrame = own._parentJoint, own._parentFrame
        made._placement, made._inertia = _like(own._placement), _like(own._inertia)
        return made  # type: ignore[no-any-return]

    cast = copy  # the only scalar type is float64

    def _content(self) -> tuple[Any, ...]:
        content: tuple[Any, ...] = _CONTENT(self)
        return content

    def __eq__(self, other: object) -> Any:
        return self._content() == other._content() if isinstance(other, Frame) else NotImplemented

    __hash__ = object.__hash__

    def __reduce__(self) -> tuple[Any, ...]:
        return Frame, self._content()

    def __repr__(self) -> str:
        return (
            f"Frame name: {self.name} paired to (parent joint/ parent frame)({self.parentJoint}/{self.parentFrame})\n"
            f"with relative placement wrt parent joint:\n{self.placement}containing inertia:\n{self.inertia}\n"
        )
