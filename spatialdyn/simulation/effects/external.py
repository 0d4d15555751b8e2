"""External forces: the scene's constant forces, and a run's forces that vary with its steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...recursions import SPECS
from ...recursions.spec import FEXT
from ..arithmetic import Arithmetic
from . import work
from .effect import Effect

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class ExternalForces(Effect):
    """Forces on the joints' bodies, which recursions take as their input ``fext``.

    rows  (samples or 1, steps or 1, 6 njoints)
    """

    rows: Array
    name = "external"
    inputs = (replace(FEXT, optional=False),)
    work = work.EXTERNAL

    @cached_property
    def values(self) -> dict[str, Array]:
        return {FEXT.name: self.rows}

    def structure(self) -> ExternalForces:
        return ExternalForces(np.empty(0))


def external_torque(at: Arithmetic, q: Any) -> Any:
    """Jᵀ f (nv) of the external forces [N m | N]: they reduce the torques that hold the robot still by this."""
    free = at.evaluate(SPECS["generalized_gravity"], q=q)
    loaded = at.evaluate(SPECS["static_torque"], q=q)
    (g,), (tau,) = free.values(), loaded.values()
    return np.array([x - y for x, y in zip(g, tau, strict=True)], g.dtype)
