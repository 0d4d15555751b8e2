"""JointModel: the motion that a joint allows, and its indices in q and v.

Every joint is a chain of the library's joints, its ``steps()``: one for most, two for a universal joint, three for
a translation or angles about z, y, x, and the steps of its parts for a composite.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....bodies.kinds import kind_of
from ....model.assembly import IDENTITY
from ..types.arguments import ArgumentError
from .joint_data import JointData

__all__ = ["JointModel"]

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
NOWHERE = 2**64 - 1  # id of a joint that is in no model
X, Y, Z = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Step(NamedTuple):
    """A joint of the library: its kind, axis and pitch, and its placement after the previous step, row by row."""

    kind: str
    axis: Vector = Z
    placement: tuple[float, ...] = IDENTITY
    pitch: float = 0.0


class _Variant(type):
    def __call__(cls, *arguments: Any, **named: Any) -> Any:
        """``JointModel(other)`` is a copy of a joint of any kind, ``JointModel()`` a revolute joint about x."""
        if cls is not JointModel:
            return super().__call__(*arguments, **named)
        if len(arguments) == 1 and isinstance(arguments[0], JointModel):
            return arguments[0].copy()
        if arguments or named:
            raise ArgumentError(f"JointModel got {arguments or named!r}, expected a joint model or nothing")
        return kinds()["JointModelRX"]()


class JointModel(metaclass=_Variant):
    """A joint of any kind.

    id             index in its model
    idx_q, nq      first index and number of its coordinates in q
    idx_v, nv      first index and number of its velocities in v
    """

    __slots__ = ("_owner", "id", "idx_q", "idx_v", "idx_vExtended")
    lieGroup: Any  # set by liegroups, which imports this module
    _nq, _nv, _unlimited = 1, 1, (1, 1)  # the first coordinates and velocities that can have a limit

    def __init__(self) -> None:
        self._owner: Any = None
        self.id: int = NOWHERE
        self.idx_q = self.idx_v = self.idx_vExtended = -1

    @property
    def nq(self) -> int:
        """Number of coordinates."""
        return self._nq

    @property
    def nv(self) -> int:
        """Number of velocities."""
        return self._nv

    @property
    def leader(self) -> int | None:
        """Index of the leader of a mimic joint; None for others."""
        return None

    @property
    def nvExtended(self) -> int:
        """Number of velocities that the joint would have without mimicking."""
        return self.nv

    def steps(self) -> tuple[Step, ...]:
        """The library's joints that make up this one."""
        raise NotImplementedError

    def neutral(self) -> list[float]:
        """Coordinates (nq,) at which the joint's two frames coincide."""
        return [x for step in self.steps() for x in kind_of(step.kind, "cos_sin").undisplaced]

    def parameters(self) -> tuple[Any, ...]:
        """Constructor arguments that make an equal joint."""
        return ()

    def shortname(self) -> str:
        """Name of the kind of joint."""
        return type(self).__name__

    @classmethod
    def classname(cls) -> str:
        """Name of the kind of joint."""
        return cls.__name__

    def extract(self) -> JointModel:
        """The joint itself."""
        return self

    def createData(self) -> JointData:
        """A JointData for the results of ``calc``."""
        return JointData(self)

    def calc(self, data: JointData, q: Any, v: Any = None) -> None:
        """Write pose M, subspace S, and with v velocity v and bias c, at the model's q, v, into the data."""
        data.calc(self, q, v)

    def setIndexes(self, id: int, q: int, v: int, vExtended: int | None = None) -> None:
        """Set the joint's indices in its model."""
        self.id, self.idx_q, self.idx_v = int(id), int(q), int(v)
        self.idx_vExtended = int(v if vExtended is None else vExtended)
        self.changed()

    def hasSameIndexes(self, other: JointModel) -> bool:
        """Whether both have the same indices."""
        return self._indexes() == other._indexes()

    @property
    def hasConfigurationLimit(self) -> list[bool]:
        """Whether each coordinate can have a limit."""
        return [k < self._unlimited[0] for k in range(self.nq)]

    @property
    def hasConfigurationLimitInTangent(self) -> list[bool]:
        """Whether the coordinate of each velocity can have a limit."""
        return [k < self._unlimited[1] for k in range(self.nv)]

    def copy(self) -> JointModel:
        """An independent copy that belongs to no model."""
        made: JointModel = type(self)(*self.parameters())
        made.id, made.idx_q, made.idx_v, made.idx_vExtended = self._indexes()
        return made

    def changed(self) -> None:
        """Notify the owner, if any, of a change."""
        if self._owner is not None:
            self._owner.changed()

    def _indexes(self) -> tuple[int, int, int, int]:
        return self.id, self.idx_q, self.idx_v, self.idx_vExtended

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, JointModel)
            and type(self) is type(other)
            and self._indexes() == other._indexes()
            and self.steps() == other.steps()
        )

    __hash__ = object.__hash__

    def __copy__(self) -> JointModel:
        return self.copy()

    def __deepcopy__(self, memo: Any) -> JointModel:
        return self.copy()

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), self.parameters(), self._indexes())

    def __repr__(self) -> str:
        lines = [
            self.shortname(),
            f"  index: {self.id}",
            f"  index q: {self.idx_q}",
            f"  index v: {self.idx_v}",
            f"  index vExtended: {self.idx_vExtended}",
            f"  nq: {self.nq}",
            f"  nv: {self.nv}",
            f"  nvExtended: {self.nvExtended}",
        ]
        return "\n".join([*lines, ""])


def _restored(kind: type, parameters: tuple[Any, ...], indexes: tuple[int, int, int, int]) -> JointModel:
    made: JointModel = kind(*parameters)
    made.id, made.idx_q, made.idx_v, made.idx_vExtended = indexes
    return made


def kinds(of: type[JointModel] = JointModel) -> dict[str, type[JointModel]]:
    """Joint model classes by name."""
    found = {kind.__name__: kind for kind in of.__subclasses__() if kind.__name__.startswith("JointModel")}
    for kind in of.__subclasses__():
        found |= kinds(kind)
    return found
