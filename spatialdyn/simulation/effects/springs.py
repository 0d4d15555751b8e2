"""Springs of series-elastic joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...model.model import Model
from ...recursions.joints.springs import SPRING_TORQUE
from ..arithmetic import Arithmetic
from . import work
from .effect import Effect


def has_springs(model: Model) -> bool:
    """Whether a model has springs between rotors and joints."""
    return bool(model.bodies["spring"].any())


@dataclass(frozen=True, eq=False)
class Springs(Effect):
    """The springs of the model."""

    name = "springs"
    work = work.SPRINGS

    def torque(self, at: Arithmetic, q: Any, v: Any) -> Any:
        (made,) = at.evaluate(SPRING_TORQUE, q=q, v=v).values()
        return made


def spring_effects(model: Model) -> tuple[Springs, ...]:
    """The springs of a model, if it has some."""
    return (Springs(),) if has_springs(model) else ()
