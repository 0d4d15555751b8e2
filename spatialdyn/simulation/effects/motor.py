"""Motors: torques of a run act through gears and brakes, within the motors' limits.

Gear losses are dry friction in proportion to the load, and the back EMF acts as viscous friction
(``recursions.joints.motors.driven``). The step that solves for the friction of the joints includes both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...actuation.motors import Motor
from ...recursions.joints.motors import EFFICIENCY, EMF, LIMIT, MOST, STALL, SUPPLY, driven
from .effect import Effect

Array = NDArray[Any]
Law = tuple[Any, Any, Any, Any]  # coulomb, viscous, static, stribeck
CURRENT, VOLTAGE = DRIVES = ("current", "voltage")  # the input of a motor


@dataclass(frozen=True, eq=False)
class Drive(Effect):
    """A motor through which torques act, together with dry friction."""

    motor: Motor
    given: str
    name = "motor"
    drives = False  # adds no energy beyond that of the commanded torques

    @cached_property
    def inputs(self) -> Any:
        return (SUPPLY if self.given == VOLTAGE else STALL, EMF, MOST, EFFICIENCY, LIMIT)

    @cached_property
    def values(self) -> dict[str, Array]:
        return {x.name: y[None, None] for x, y in zip(self.inputs, self.motor.lines, strict=True)}

    @property
    def rubs(self) -> NDArray[np.bool_]:
        """The freedoms (nv,) that their gears may hold."""
        lossy: NDArray[np.bool_] = self.motor.lines[3] < 1.0
        return lossy


def geared(given: Mapping[str, Any], v: Any, tau: Any, law: Law) -> tuple[Any, Law]:
    """Torques and friction of a step with the motor in ``given``, if any; its gears and brakes count as friction."""
    if EMF.name not in given:
        return tau, law
    coulomb, viscous, static, stribeck = law
    voltage = SUPPLY.name in given
    first = SUPPLY if voltage else STALL
    lines = [given[x.name] for x in (first, EMF, MOST, EFFICIENCY, LIMIT)]
    rows = np.array([driven(voltage, i, v, tau, *lines) for i in range(len(v))], np.asarray(tau).dtype)
    push, slope, level = rows.reshape((-1, 3)).T
    return push, (coulomb + level, viscous + slope, static + level, stribeck)
