"""The arrays of a Model with an entry for each coordinate or velocity: limits, armature, friction ..."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ....errors import ShapeError
from ..types.arguments import NUMBERS, ArgumentError, Array, described
from ..types.tracked_array import tracked
from .joint import JointModel

NO_LIMIT = float(np.finfo(float).max)  # Pinocchio's value for "no limit"
FRICTION = ("min_friction", "max_friction", "damping")
BOTH = ("min_effort", "max_effort", "min_velocity", "max_velocity", "min_config", "max_config")
LIMITS = {  # limit arguments of addJoint, by their number
    0: (),
    4: ("max_effort", "max_velocity", "min_config", "max_config"),
    9: (*BOTH, *FRICTION),
    10: (*BOTH, "config_limit_margin", *FRICTION),
}


class Entries:
    """An array of a model: (nq,) or (nv,), as its docstring begins; assignment copies.

    default  of a joint that ``addJoint`` gets no limits for
    limit    the argument of ``addJoint`` for a joint's entries, if any
    """

    name = ""

    def __init__(self, default: float, doc: str, limit: str = "") -> None:
        self.default, self.limit, self.__doc__ = default, limit, doc
        self.of_q = doc.startswith("(nq,)")

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = self.name or name  # the first of several

    def size(self, of: Any) -> int:
        """Number of entries of a model or a joint."""
        return int(of.nq if self.of_q else of.nv)

    def __get__(self, model: Any, kind: Any = None) -> Any:
        if model is None:
            return self
        found = model._arrays[self.name]
        return tracked(found, model._on_edit) if self.name == "armature" else found

    def __set__(self, model: Any, value: Any) -> None:
        if not isinstance(value, np.ndarray) or value.dtype.kind not in NUMBERS:
            raise ArgumentError(f"{self.name} is {described(value)}, expected an array of numbers")
        n = self.size(model)
        if value.shape not in ((n,), (n, 1)):
            raise ShapeError(f"{self.name} has shape {value.shape}, expected ({n},)")
        model._arrays[self.name][...] = np.asarray(value).reshape(n)  # in place: held arrays see it, as in Pinocchio
        if self.name == "armature":
            model._on_edit.changed()


class Arrays:
    """The arrays as attributes; a joint appends its entries."""

    _arrays: dict[str, Array]
    lowerPositionLimit = Entries(-NO_LIMIT, "(nq,) least coordinates.", "min_config")
    upperPositionLimit = Entries(NO_LIMIT, "(nq,) largest coordinates.", "max_config")
    positionLimitMargin = Entries(0.0, "(nq,) margin to the limits; without effect.", "config_limit_margin")
    lowerEffortLimit = Entries(-NO_LIMIT, "(nv,) least forces of the joints.", "min_effort")
    upperEffortLimit = effortLimit = Entries(NO_LIMIT, "(nv,) largest forces of the joints.", "max_effort")
    lowerVelocityLimit = Entries(-NO_LIMIT, "(nv,) least velocities.", "min_velocity")
    upperVelocityLimit = velocityLimit = Entries(NO_LIMIT, "(nv,) largest velocities.", "max_velocity")
    lowerDryFrictionLimit = Entries(0.0, "(nv,) least dry friction; without effect.", "min_friction")
    upperDryFrictionLimit = friction = Entries(0.0, "(nv,) largest dry friction; without effect.", "max_friction")
    damping = Entries(0.0, "(nv,) viscous friction; without effect.", "damping")
    armature = Entries(0.0, "(nv,) reflected inertias of the rotors, added to the diagonal of M.")
    rotorInertia = Entries(0.0, "(nv,) inertias of the rotors; without effect, see ``armature``.")
    rotorGearRatio = Entries(1.0, "(nv,) ratios of the gears; without effect.")

    def _extend(self, joint: JointModel, values: Mapping[str, Array]) -> None:
        """Append the entries of a joint, from ``values`` by name, else the defaults."""
        for name, x in ARRAYS.items():
            new = values.get(name, np.full(x.size(joint), x.default))
            self._arrays[name] = np.concatenate([self._arrays[name], new])


ARRAYS = {x.name: x for x in vars(Arrays).values() if isinstance(x, Entries)}
BY_LIMIT = {x.limit: x for x in ARRAYS.values()}


def limit(joint: str, name: str, value: Any, model: JointModel) -> Array:
    """A limit of a joint as (nq,) or (nv,) numbers."""
    if not isinstance(value, np.ndarray):
        raise ArgumentError(f'{name} of joint "{joint}" is {described(value)}, expected an array')
    n = BY_LIMIT[name].size(model)
    if value.size != n:
        raise ShapeError(f'{name} of joint "{joint}" has {value.size} numbers, expected {n}')
    return np.array(value, dtype=float).reshape(n)
