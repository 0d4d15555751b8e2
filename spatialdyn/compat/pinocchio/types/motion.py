"""Motion and Force: spatial vectors, linear part first."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ....algebra import spatial
from ...native import operators
from .arguments import OMITTED, ArgumentError, Array, array, described, of_pinocchio, only, row
from .random import uniform
from .value import IN_PLACE, TIMES, TIMES_LEFT, InFrames, Summable, on_values, own_value, part, preset

__all__ = ["Force", "Motion"]

FLOAT = np.dtype(np.float64)
_joined = on_values("joined", spatial.Motion, "motion", angular="vec", linear="vec")


class Spatial(Summable, InFrames):
    """Base of Motion and Force: six numbers, sums and multiples."""

    _arguments = ("linear", "angular")
    _letters: ClassVar[tuple[str, str]]

    def __init__(
        self, linear: Any = OMITTED, angular: Any = OMITTED, *, array: Any = OMITTED, clone: Any = OMITTED
    ) -> None:
        if angular is not OMITTED and linear is not OMITTED:
            self._x = _joined(angular, linear)
        elif type(linear) is np.ndarray and linear.shape == (6,) and linear.dtype == FLOAT:
            self._x = linear.copy()
        else:
            name = type(self).__name__
            if angular is not OMITTED:
                raise ArgumentError(f"{name} got angular alone, expected linear too")
            self._x = self._six(only((linear, array, clone), name, f"an array of shape (6,) or a {name}"))

    @classmethod
    def _six(cls, given: Any) -> Array:
        if given is OMITTED:
            return np.zeros(6)
        if of_pinocchio(given, cls.__name__):
            return np.array(given.vector, float)
        return given._x.copy() if isinstance(given, cls) else array(given, (6,), cls.__name__)

    _, setZero = preset(lambda: np.zeros(6), "zero")
    Random, setRandom = preset(lambda: uniform(6), "six random numbers in ±1")

    linear = part("linear", np.s_[:3], "The linear part (3,), a view.")
    angular = part("angular", np.s_[3:], "The angular part (3,), a view.")
    vector = part("vector", np.s_[:], "All six numbers, linear first, a view.")
    np = property(vector.fget, doc="As ``vector``.")

    def __array__(self, dtype: Any = None, copy: Any = None) -> Array:
        x = self._x.astype(dtype or FLOAT)
        x.flags.writeable = bool(copy)  # a write to it would be lost
        return x

    def __repr__(self) -> str:
        linear, angular = self._letters
        return f"{linear} = {row(self._x[:3])}\n{angular} = {row(self._x[3:])}\n"


class Force(Spatial, kind="Force", near=operators.near_spatial):
    """A spatial force: ``Force(linear (3,), angular (3,))``, ``Force(vector (6,))`` [N, N m about the origin] or
    ``Force(other)``, also of Pinocchio's own class.
    """

    _letters = ("  f", "tau")
    __add__ = on_values("__add__", spatial.add_force, "Force", self="Force", other="Force")
    __sub__ = on_values("__sub__", spatial.sub_force, "Force", self="Force", other="Force")
    __iadd__ = on_values("add", spatial.add_force, "truth", form=IN_PLACE, self="Force", other="Force")
    __isub__ = on_values("sub", spatial.sub_force, "truth", form=IN_PLACE, self="Force", other="Force")
    __neg__ = on_values("__neg__", operators.minus_force, "Force", self="Force")
    __mul__ = on_values("__mul__", operators.scaled_force, "Force", form=TIMES, self="Force", s="number")
    __rmul__ = on_values("__rmul__", operators.scaled_force, "Force", form=TIMES_LEFT, self="Force", s="number")
    __truediv__ = on_values("__truediv__", operators.divided_force, "Force", form=TIMES, self="Force", s="number")
    _to_parent = on_values("act", spatial.force_to_parent, "Force", self="Pose", x="Force")
    _to_child = on_values("actInv", spatial.force_to_child, "Force", self="Pose", x="Force")
    Zero = staticmethod(on_values("Zero", spatial.zero_force, "Force", "Zero."))
    dot = on_values("dot", operators.power_of_force, "number", "Power along a Motion [W].", self="Force", m="Motion")


class Motion(Spatial, kind="Motion", near=operators.near_spatial):
    """A spatial velocity: ``Motion(linear (3,), angular (3,))``, ``Motion(vector (6,))`` [m/s, rad/s] or
    ``Motion(other)``, also of Pinocchio's own class.

    ``v ^ w`` and ``v.cross(w)`` are v × w for a Motion w, v ×* w for a Force.
    """

    _letters = ("  v", "  w")
    __add__ = on_values("__add__", spatial.add_motion, "Motion", self="Motion", other="Motion")
    __sub__ = on_values("__sub__", spatial.sub_motion, "Motion", self="Motion", other="Motion")
    __iadd__ = on_values("add", spatial.add_motion, "truth", form=IN_PLACE, self="Motion", other="Motion")
    __isub__ = on_values("sub", spatial.sub_motion, "truth", form=IN_PLACE, self="Motion", other="Motion")
    __neg__ = on_values("__neg__", operators.minus_motion, "Motion", self="Motion")
    __mul__ = on_values("__mul__", operators.scaled_motion, "Motion", form=TIMES, self="Motion", s="number")
    __rmul__ = on_values("__rmul__", operators.scaled_motion, "Motion", form=TIMES_LEFT, self="Motion", s="number")
    __truediv__ = on_values(
        "__truediv__", operators.divided_motion, "Motion", form=TIMES, self="Motion", scale="number"
    )
    _to_parent = on_values("act", spatial.motion_to_parent, "Motion", self="Pose", x="Motion")
    _to_child = on_values("actInv", spatial.motion_to_child, "Motion", self="Pose", x="Motion")
    Zero = staticmethod(on_values("Zero", spatial.zero_motion, "Motion", "Zero."))
    dot = on_values("dot", spatial.power, "number", "The power of a Force along it [W].", self="Motion", f="Force")
    _action = on_values("action", operators.cross_matrix, "tangent", self="Motion")
    action = property(_action, doc="The matrix (6, 6) of self × on Motion vectors.")
    dualAction = property(lambda self: -self.action.T, doc="The matrix (6, 6) of self ×* on Force vectors.")

    def __xor__(self, other: Any) -> Any:
        if isinstance(other, Motion) or (not isinstance(other, Force) and of_pinocchio(other, "Motion")):
            return _cross_motion(self, other)
        return _cross_force(self, other)

    def cross(self, other: Any) -> Any:
        """self × other for a Motion, self ×* other for a Force."""
        made = self ^ other if isinstance(other, Spatial) or own_value(other) is not None else NotImplemented
        if made is NotImplemented:
            raise ArgumentError(f"other is {described(other)}, expected Motion or Force")
        return made

    @property
    def homogeneous(self) -> Array:
        """[ω̃ v; 0 0] (4, 4)."""
        vx, vy, vz, x, y, z = self._x.tolist()
        return np.array([[0.0, -z, y, vx], [z, 0.0, -x, vy], [-y, x, 0.0, vz], [0.0, 0.0, 0.0, 0.0]])


_cross_motion = on_values("__xor__", spatial.cross_motion, "Motion", self="Motion", other="Motion")
_cross_force = on_values("__xor__", spatial.cross_force, "Force", self="Motion", other="Force")
