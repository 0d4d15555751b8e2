"""The arrays of a Model with an entry for each coordinate or velocity: limits, armature, friction ..."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ....errors import ShapeError
from ..types.arguments import ArgumentError, Array, described
from ..types.tracked_array import tracked
from .joint import JointModel

NO_LIMIT = float(np.finfo(float).max)  # Pinocchio's value for "no limit"

# name -> default of addJoint, for each coordinate or velocity
POSITIONS = {"lowerPositionLimit": -NO_LIMIT, "upperPositionLimit": NO_LIMIT, "positionLimitMargin": 0.0}
VELOCITIES = {
    "lowerEffortLimit": -NO_LIMIT,
    "upperEffortLimit": NO_LIMIT,
    "lowerVelocityLimit": -NO_LIMIT,
    "upperVelocityLimit": NO_LIMIT,
    "lowerDryFrictionLimit": 0.0,
    "upperDryFrictionLimit": 0.0,
    "damping": 0.0,
    "armature": 0.0,
    "rotorInertia": 0.0,
    "rotorGearRatio": 1.0,
}
ARRAYS = {**POSITIONS, **VELOCITIES}
FRICTION = ("min_friction", "max_friction", "damping")
BOTH = ("min_effort", "max_effort", "min_velocity", "max_velocity", "min_config", "max_config")
LIMITS = {  # limit arguments of addJoint, by their number
    0: (),
    4: ("max_effort", "max_velocity", "min_config", "max_config"),
    9: (*BOTH, *FRICTION),
    10: (*BOTH, "config_limit_margin", *FRICTION),
}
LIMIT_ARRAYS = {
    "min_config": "lowerPositionLimit",
    "max_config": "upperPositionLimit",
    "config_limit_margin": "positionLimitMargin",
    "min_effort": "lowerEffortLimit",
    "max_effort": "upperEffortLimit",
    "min_velocity": "lowerVelocityLimit",
    "max_velocity": "upperVelocityLimit",
    "min_friction": "lowerDryFrictionLimit",
    "max_friction": "upperDryFrictionLimit",
    "damping": "damping",
}


def _array(name: str, meaning: str) -> Any:
    """A property for an array of the model; assignment copies."""

    def read(self: Arrays) -> Array:
        found: Array = self._arrays[name]
        return tracked(found, self._on_edit) if name == "armature" else found

    def write(self: Arrays, value: Any) -> None:
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
            raise ArgumentError(f"{name} is {described(value)}, expected an array of numbers")
        n = self.nq if name in POSITIONS else self.nv
        if value.shape not in ((n,), (n, 1)):
            raise ShapeError(f"{name} has shape {value.shape}, expected ({n},)")
        self._arrays[name][...] = np.asarray(value).reshape(n)  # in place: held arrays see it, as in Pinocchio
        if name == "armature":
            self._on_edit.changed()

    return property(read, write, doc=meaning)


class Arrays:
    """The arrays as attributes; a joint appends its entries."""

    nq: int
    nv: int
    _arrays: dict[str, Array]
    _on_edit: Any
    _library: Any
    lowerPositionLimit = _array("lowerPositionLimit", "(nq,) least coordinates.")
    upperPositionLimit = _array("upperPositionLimit", "(nq,) largest coordinates.")
    positionLimitMargin = _array("positionLimitMargin", "(nq,) margin to the limits; without effect.")
    lowerEffortLimit = _array("lowerEffortLimit", "(nv,) least forces of the joints.")
    upperEffortLimit = _array("upperEffortLimit", "(nv,) largest forces of the joints.")
    lowerVelocityLimit = _array("lowerVelocityLimit", "(nv,) least velocities.")
    upperVelocityLimit = _array("upperVelocityLimit", "(nv,) largest velocities.")
    lowerDryFrictionLimit = _array("lowerDryFrictionLimit", "(nv,) least dry friction; without effect.")
    upperDryFrictionLimit = _array("upperDryFrictionLimit", "(nv,) largest dry friction; without effect.")
    damping = _array("damping", "(nv,) viscous friction; without effect.")
    armature = _array("armature", "(nv,) reflected inertias of the rotors, added to the diagonal of M.")
    rotorInertia = _array("rotorInertia", "(nv,) inertias of the rotors; without effect, see ``armature``.")
    rotorGearRatio = _array("rotorGearRatio", "(nv,) ratios of the gears; without effect.")
    effortLimit = upperEffortLimit
    velocityLimit = upperVelocityLimit
    friction = upperDryFrictionLimit

    def _extend(self, joint: JointModel, values: Mapping[str, Array]) -> None:
        """Append the entries of a joint, from ``values`` by name, else the defaults."""
        for array, default in ARRAYS.items():
            n = joint.nq if array in POSITIONS else joint.nv
            self._arrays[array] = np.concatenate([self._arrays[array], values.get(array, np.full(n, default))])


def limit(joint: str, name: str, value: Any, model: JointModel) -> Array:
    """A limit of a joint as (nq,) or (nv,) numbers."""
    if not isinstance(value, np.ndarray):
        raise ArgumentError(f'{name} of joint "{joint}" is {described(value)}, expected an array')
    n = model.nq if "config" in name else model.nv
    if value.size != n:
        raise ShapeError(f'{name} of joint "{joint}" has {value.size} numbers, expected {n}')
    return np.array(value, dtype=float).reshape(n)
