"""JointModelMimic: a joint that follows another joint."""

from __future__ import annotations

from typing import Any

from ....errors import ModelError
from ..types.arguments import expected
from .joint import NOWHERE, JointModel, Step
from .joints_one_axis import JointModelRX

__all__ = ["JointModelMimic"]


class JointModelMimic(JointModel):
    """A joint that follows another: ``(joint of a model, scaling, offset)``, q = scaling q' + offset.

    It has the motion of that joint and no coordinates of its own.
    """

    __slots__ = ("_leader", "_motion", "_offset", "_scaling")
    _nq, _nv, _unlimited = 0, 0, (0, 0)

    def __init__(self, joint: JointModel | None = None, scaling: float = 1.0, offset: float = 0.0) -> None:
        super().__init__()
        if joint is not None:
            expected(joint, JointModel, "joint")
        self._follow(JointModelRX() if joint is None else joint, joint, scaling, offset)

    @classmethod
    def of(cls, motion: JointModel, leader: JointModel, scaling: float, offset: float) -> JointModelMimic:
        """A joint with the motion of ``motion`` and the coordinates of ``leader``."""
        made: JointModelMimic = cls()
        made._follow(motion, leader, scaling, offset)
        return made

    def _follow(self, motion: JointModel, leader: JointModel | None, scaling: float, offset: float) -> None:
        motion = motion._motion if isinstance(motion, JointModelMimic) else motion
        for joint in (motion, leader or motion):
            if joint.nv != 1:
                raise ModelError(f"a {joint.shortname()} has {joint.nv} freedoms, expected a joint of one")
        self._motion: JointModel = motion.copy()
        self._leader = NOWHERE if leader is None else leader.id
        self._scaling, self._offset = float(scaling), float(offset)
        if leader is not None:
            self.idx_q, self.idx_v = leader.idx_q, leader.idx_v

    @property
    def leader(self) -> int:
        """Index of the leader."""
        return self._leader

    @property
    def scaling(self) -> float:
        """Ratio of the joint's coordinate to its leader's."""
        return self._scaling

    @scaling.setter
    def scaling(self, value: float) -> None:
        self._scaling = float(value)
        self.changed()

    @property
    def offset(self) -> float:
        """Coordinate of the joint where its leader's is 0."""
        return self._offset

    @offset.setter
    def offset(self, value: float) -> None:
        self._offset = float(value)
        self.changed()

    @property
    def nvExtended(self) -> int:
        return 1

    def steps(self) -> tuple[Step, ...]:
        return self._motion.steps()

    def neutral(self) -> list[float]:
        return []

    def copy(self) -> JointModel:
        return _mimic(self._motion, self._leader, self._scaling, self._offset, self._indexes())

    def __eq__(self, other: object) -> bool:
        return super().__eq__(other) and self._followed() == other._followed()  # type: ignore[attr-defined]

    __hash__ = object.__hash__

    def _followed(self) -> tuple[int, float, float]:
        return self._leader, self._scaling, self._offset

    def __reduce__(self) -> tuple[Any, ...]:
        return _mimic, (self._motion, *self._followed(), self._indexes())

    def __repr__(self) -> str:
        lines = [
            f"  Mimicking joint type: {self._motion.shortname()}",
            f"  Mimicked joint id: {self._leader}",
            f"  Mimic scaling: {self._scaling:g}",
            f"  Mimic offset: {self._offset:g}",
        ]
        return super().__repr__() + "\n".join([*lines, ""])


def _mimic(
    motion: JointModel, leader: int, scaling: float, offset: float, indexes: tuple[int, int, int, int]
) -> JointModelMimic:
    made: JointModelMimic = JointModelMimic(motion, scaling, offset)
    made._leader = leader
    made.id, made.idx_q, made.idx_v, made.idx_vExtended = indexes
    return made
