"""JointModelMimic: a joint that follows another joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ....errors import ModelError
from ..types.arguments import expected
from .joint import NOWHERE, JointModel, Step, joint_kind, joint_of
from .joints_one_axis import JointModelRX

__all__ = ["JointModelMimic"]


def _number(slot: str, doc: str) -> Any:
    """A property for a number; assigning it is an edit."""

    def assign(joint: Any, value: float) -> None:
        setattr(joint, slot, float(value))
        joint.changed()

    return property(lambda joint: getattr(joint, slot), assign, doc=doc)


class Mimic(JointModel):
    """A joint that follows another: ``(joint of a model, scaling, offset)``, q = scaling q' + offset.

    It has the motion of that joint and no coordinates of its own.
    """

    __slots__ = ("_leader", "_motion", "_offset", "_scaling")
    _nq, _nv, _unlimited = 0, 0, (0, 0)
    nvExtended = property(lambda self: 1, doc=JointModel.nvExtended.__doc__)
    leader = property(lambda self: self._leader, doc="Index of the leader.")
    scaling = _number("_scaling", "Ratio of the joint's coordinate to its leader's.")
    offset = _number("_offset", "Coordinate of the joint where its leader's is 0.")

    def __init__(self, joint: JointModel | None = None, scaling: float = 1.0, offset: float = 0.0) -> None:
        super().__init__()
        if joint is not None:
            expected(joint, JointModel, "joint")
        self._follow(JointModelRX() if joint is None else joint, joint, scaling, offset)

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
        lines = [
            f"  Mimicking joint type: {self._motion.shortname()}",
            f"  Mimicked joint id: {self._leader}",
            f"  Mimic scaling: {self._scaling:g}",
            f"  Mimic offset: {self._offset:g}",
        ]
        return super().__repr__() + "\n".join([*lines, ""])


JointModelMimic = joint_kind("JointModelMimic", Mimic, Mimic.__doc__)
