"""The kinds of constraints: frozen, hashable, checked when they are made; ``Constraints`` puts them on a robot.

A frame is a name, as everywhere; ``at_a`` and ``at_b`` displace the two frames, by a position (3) or a pose (4, 4) in
the frame, or in the world if ``frame_b`` is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..algebra.rotations import UNIT_TOLERANCE
from ..calls.arguments import as_array, as_number
from ..errors import ConstraintError, literal

Array = NDArray[np.float64]
Numbers = tuple[float, ...]
Entries = tuple[tuple[float, ...], ...]
AXES = "xyz"
NAMES = ("frame_a", "frame_b", "frame", "joint", "to")  # fields that label a constraint


@dataclass(frozen=True)
class Constraint:
    """The base class of all kinds: a name for messages, by default the kind and its frames."""

    @property
    def label(self) -> str:
        """The name that messages use."""
        given: str | None = getattr(self, "name", None)
        if given is not None:
            return given
        named = [
            getattr(self, x.name) for x in fields(self) if x.name in ("frame_a", "frame_b", "frame", "joint", "to")
        ]
        return f"{type(self).__name__}({', '.join(repr(x) for x in named if x is not None)})"

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def _check_names(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            if not isinstance(value, str) and not (value is None and name in ("frame_b", "name")):
                raise ConstraintError(f"{type(self).__name__} has {name} {literal(value)}, expected a name")

    def _check_places(self) -> None:
        for name in ("at_a", "at_b"):
            self._set(name, _pose(self, name, getattr(self, name)))


@dataclass(frozen=True)
class PointConstraint(Constraint):
    """The origin of frame_a stays on that of frame_b, along some of frame_b's axes: a foot, a ball joint.

    frame_a     name of a frame
    frame_b     name of another; the world if left out
    axes        axes of frame_b, or of the world, along which the origin is held: one to three of "xyz"
    at_a, at_b  (3,) the points in their frames, or in the world; the origins if left out [m]
    name        for messages

    Equations: the position of a's point from b's, in b's axes. The force acts on a's body [N].
    Raises  ConstraintError for other axes, places or names

    >>> import spatialdyn as sd
    >>> sd.PointConstraint("tip", axes="xz").label
    "PointConstraint('tip')"
    """

    frame_a: str
    frame_b: str | None = None
    axes: str = AXES
    at_a: ArrayLike | None = None
    at_b: ArrayLike | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        self._check_names("frame_a", "frame_b", "name")
        self._check_places()
        if (
            not isinstance(self.axes, str)
            or not self.axes
            or len({*self.axes}) < len(self.axes)
            or {*self.axes} - {*AXES}
        ):
            raise ConstraintError(f'{self.label} has axes {literal(self.axes)}, expected one to three of "xyz"')


@dataclass(frozen=True)
class WeldConstraint(Constraint):
    """Frame_a stays on frame_b, or in the world, position and axes.

    frame_a     name of a frame
    frame_b     name of another; the world if left out
    at_a, at_b  (3,) or (4, 4) in their frames, or in the world; the frames themselves if left out [m]
    name        for messages

    Equations: the position of a from b, in b's axes, then the axis of a's rotation times the sine of the angle. The
    force acts on a's body [N, N m]. At half a turn the sine is 0 too: ``project_configuration`` refuses that.
    Raises  ConstraintError for other places or names
    """

    frame_a: str
    frame_b: str | None = None
    at_a: ArrayLike | None = None
    at_b: ArrayLike | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        self._check_names("frame_a", "frame_b", "name")
        self._check_places()


@dataclass(frozen=True)
class HingeConstraint(Constraint):
    """Frame_a turns about an axis fixed in frame_b, or in the world, without any other motion: the pin of a loop.

    frame_a     name of a frame
    frame_b     name of another; the world if left out
    axis        (3,) in both frames, of any length; z if left out
    at_a, at_b  (3,) or (4, 4) in their frames, or in the world; the frames themselves if left out [m]
    name        for messages

    Equations: the position of a from b, in b's axes, then the components of a's axis in two directions orthogonal to
    b's axis. The force acts on a's body [N, N m].
    Raises  ConstraintError for other axes, places or names
    """

    frame_a: str
    frame_b: str | None = None
    axis: ArrayLike = (0.0, 0.0, 1.0)
    at_a: ArrayLike | None = None
    at_b: ArrayLike | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        self._check_names("frame_a", "frame_b", "name")
        self._check_places()
        self._set("axis", _direction(self, "axis", self.axis))


@dataclass(frozen=True)
class DistanceConstraint(Constraint):
    """The origins of two frames stay at a fixed distance: a massless rod between ball joints.

    frame_a     name of a frame
    frame_b     name of another; the world if left out
    length      of the rod [m], above 0
    at_a, at_b  (3,) the points in their frames, or in the world; the origins if left out [m]
    name        for messages

    Equation: (|r|² - length²) / (2 length) of the distance |r|. Its force is the rod's, a push if positive [N].
    Raises  ConstraintError for another length, places or names
    """

    frame_a: str
    frame_b: str | None = None
    length: float = math.nan
    at_a: ArrayLike | None = None
    at_b: ArrayLike | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        self._check_names("frame_a", "frame_b", "name")
        self._check_places()
        self._set("length", _above_zero(self, "length", self.length))


@dataclass(frozen=True)
class CouplerConstraint(Constraint):
    """One joint follows another: q_joint = ratio q_to + offset, a gear or a belt.

    joint, to  names of joints whose position is one number
    ratio      of the joint's motion to the other's
    offset     [rad | m]
    name       for messages

    Equation: q_joint - ratio q_to - offset. Its force is the torque on the joint [N m | N].
    Raises  ConstraintError for other numbers or names
    """

    joint: str
    to: str
    ratio: float = 1.0
    offset: float = 0.0
    name: str | None = None

    def __post_init__(self) -> None:
        self._check_names("joint", "to", "name")
        for name in ("ratio", "offset"):
            value = as_number(getattr(self, name))
            if not math.isfinite(value):
                raise ConstraintError(
                    f"{self.label} has {name} {literal(getattr(self, name))}, expected a finite number"
                )
            self._set(name, value)


@dataclass(frozen=True)
class RollingConstraint(Constraint):
    """A wheel, or a sphere, rolls on a plane without slipping: its point of contact is at rest.

    frame   name of the frame in the wheel's centre
    axis    (3,) the wheel's axis in the frame, of any length; None for a sphere
    radius  [m], above 0
    normal  (3,) of the plane, upward, in the world
    name    for messages

    Equations, of velocities only: the velocity of the lowest point of the rim is 0, in world axes. The force is that of
    the ground on the wheel [N]. A wheel that lies flat has no lowest point.
    Raises  ConstraintError for other axes, radii or names
    """

    frame: str
    axis: ArrayLike | None
    radius: float
    normal: ArrayLike = (0.0, 0.0, 1.0)
    name: str | None = None

    def __post_init__(self) -> None:
        self._check_names("frame", "name")
        self._set("axis", None if self.axis is None else _direction(self, "axis", self.axis))
        self._set("normal", _direction(self, "normal", self.normal))
        self._set("radius", _above_zero(self, "radius", self.radius))


@dataclass(frozen=True)
class VelocityConstraint(Constraint):
    """Joint velocities satisfy A v = 0 with a constant A: the blade of a sleigh is A = (0, 1, 0).

    A     (nv,) or (k, nv)  no row of zeros
    name  for messages

    The force is the factor of each row in the joint torques, Aᵀ force.
    Raises  ConstraintError for another A or name
    """

    A: ArrayLike
    name: str | None = None

    def __post_init__(self) -> None:
        self._check_names("name")
        A = np.atleast_2d(as_array("A", self.A))
        if A.ndim != 2 or not A.size or not np.isfinite(A).all() or not A.any(axis=1).all():
            raise ConstraintError(
                f"{self.label} has A {literal(self.A)}, expected finite rows (k, nv), each with an entry that is not 0"
            )
        self._set("A", tuple(map(tuple, A.tolist())))


KINDS = (
    PointConstraint, WeldConstraint, HingeConstraint, DistanceConstraint, CouplerConstraint, RollingConstraint,
    VelocityConstraint,
)  # fmt: skip


# --- numbers ---------------------------------------------------------------------------------------------


def _pose(constraint: Constraint, name: str, value: ArrayLike | None) -> Entries | None:
    """A position or a pose as the rows of a pose."""
    if value is None:
        return None
    given, made = as_array(name, value), np.eye(4)
    if given.shape == (3,):
        made[:3, 3] = given
    elif given.shape == (4, 4):
        made = given
    R = made[:3, :3]
    rigid = bool(abs(R @ R.T - np.eye(3)).max() <= UNIT_TOLERANCE and np.linalg.det(R) > 0.0)
    rigid &= made[3].tolist() == [0, 0, 0, 1]
    if given.shape not in ((3,), (4, 4)) or not np.isfinite(made).all() or not rigid:
        what = f"shape {given.shape}" if given.shape not in ((3,), (4, 4)) else str(given.tolist())
        raise ConstraintError(f"{constraint.label} has {name} {what}, expected a position (3,) or a pose (4, 4)")
    return tuple(map(tuple, made.tolist()))


def _direction(constraint: Constraint, name: str, value: ArrayLike) -> Numbers:
    """A unit vector along a nonzero one."""
    given = as_array(name, value)
    norm = math.hypot(*given.tolist()) if given.shape == (3,) else math.nan
    if not 0.0 < norm < math.inf:
        raise ConstraintError(f"{constraint.label} has {name} {literal(value)}, expected a nonzero vector (3,)")
    return tuple((given / norm).tolist())


def _above_zero(constraint: Constraint, name: str, value: Any) -> float:
    number = as_number(value)
    if not 0.0 < number < math.inf:
        raise ConstraintError(f"{constraint.label} has {name} {literal(value)}, expected a finite number above 0")
    return number


def placed(entries: Any) -> Array:
    """The pose (4, 4) of a place, the identity if it is None."""
    return np.eye(4) if entries is None else np.array(entries)


def across(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors that form a right-handed basis with a unit vector; for a coordinate axis, coordinate axes."""
    u, first = axis, np.zeros(3)
    first[(int(np.argmax(abs(u))) + 1) % 3] = 1.0
    first -= (first @ u) * u
    first /= np.linalg.norm(first)
    return first, np.cross(u, first)
