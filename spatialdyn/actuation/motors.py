"""Geared electric motors at the joints: their torque limits as functions of velocity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, check_model
from ..calls.dynamics import checked_call
from ..errors import ModelError, ShapeError, literal
from ..model.model import Model
from ..recursions.joints.motors import MOTOR_LIMITS

Array = NDArray[np.float64]
UNLIMITED = 1e30  # [N m | N] instead of infinity, which recursions take for an invalid sample; finite in float32 too
EXPECTED: dict[str, tuple[Callable[[Array], Any], str]] = {  # for each value its check, and this in words
    "torque_constant": (lambda x: np.isfinite(x) & (x >= 0.0), "a finite number of 0 or more"),
    "back_emf": (lambda x: np.isfinite(x) & (x >= 0.0), "a finite number of 0 or more"),
    "ratio": (lambda x: np.isfinite(x) & (x != 0.0), "a finite number other than 0"),
    "current": (lambda x: x > 0.0, "a number above 0"),
    "torque": (lambda x: x > 0.0, "a number above 0"),
    "efficiency": (lambda x: (x > 0.0) & (x <= 1.0), "a number above 0, at most 1"),
}  # fmt: skip
POSITIVE: tuple[Callable[[Array], Any], str] = (lambda x: (x > 0.0) & np.isfinite(x), "a finite number above 0")


@dataclass(frozen=True, eq=False, repr=False)
class Motor:
    """Motors of a robot's freedoms, each with a gear; compared and hashed by content.

    torque_constant  (nv,)  k_t [N m/A]; 0 for a freedom without a motor, which then has no torque
    resistance       (nv,)  R of the winding [Ω]
    voltage          (nv,)  largest voltage V of the supply, of either sign [V]
    ratio            (nv,)  n = θ̇ / q̇ of the gear: turns of the motor [1 | rad/m]; 1 if left out
    back_emf         (nv,)  k_e [V s/rad]; k_t if left out, its value in these units
    current          (nv,)  largest current [A]; infinite if left out
    torque           (nv,)  largest torque at the joint, that of the gear [N m | N]; infinite if left out
    efficiency       (nv,)  fraction η of the power that passes the gear, in either direction; 1 if left out

    The winding has R i = V - k_e θ̇, without inductance, and τ = k_t i: at full voltage the torque at the joint is
    stall_torque - damping q̇. A value may be one number for all freedoms if another is an array.

    stall_torque     (nv,)  n k_t V / R, or that of the largest current, before losses of the gear [N m | N]
    no_load_speed    (nv,)  V / (k_e n) of the joint [rad/s | m/s]
    damping          (nv,)  n² k_t k_e / R: a motor at a given voltage (0 if shorted) adds this to the viscous
                            coefficient of ``Friction`` [N m s/rad | N s/m]

    If all values are single numbers, they hold for each freedom of any robot.
    Raises  ShapeError for arrays that do not broadcast to (nv,); ModelError naming a value out of its range

    >>> import spatialdyn as sd
    >>> motor = sd.Motor(torque_constant=[0.03, 0.03], resistance=0.6, voltage=24.0, ratio=50.0, current=20.0)
    >>> motor.stall_torque, motor.no_load_speed
    (array([30., 30.]), array([16., 16.]))
    """

    torque_constant: Array
    resistance: Array
    voltage: Array
    ratio: Array
    back_emf: Array
    current: Array
    torque: Array
    efficiency: Array

    def __init__(
        self,
        torque_constant: ArrayLike,
        resistance: ArrayLike,
        voltage: ArrayLike,
        ratio: ArrayLike = 1.0,
        back_emf: ArrayLike | None = None,
        current: ArrayLike = np.inf,
        torque: ArrayLike = np.inf,
        efficiency: ArrayLike = 1.0,
    ) -> None:
        """Keep copies of the values."""
        emf = torque_constant if back_emf is None else back_emf
        given = (torque_constant, resistance, voltage, ratio, emf, current, torque, efficiency)
        arrays = {x.name: as_array(x.name, y) for x, y in zip(fields(self), given, strict=True)}
        try:
            shape = np.broadcast_shapes((1,), *(x.shape for x in arrays.values()))
        except ValueError:
            shape = ()
        if len(shape) != 1:
            listed = ", ".join(f"{name} {x.shape}" for name, x in arrays.items())
            raise ShapeError(f"values of motors have shapes {listed}, expected (nv,) or one number")
        for name, x in arrays.items():
            value = np.array(np.broadcast_to(x, shape))
            valid, expected = EXPECTED.get(name, POSITIVE)
            if not valid(value).all():
                k = int(np.argmin(valid(value)))
                of = f" of freedom {k}" if len(value) > 1 else ""
                raise ModelError(f"motor{of}: {name.replace('_', ' ')} is {value[k]:g}, expected {expected}")
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    @property
    def stall_torque(self) -> Array:
        """Torque of the motor at a joint at rest, at the largest voltage or current, before losses of the gear."""
        current = np.minimum(self.voltage / self.resistance, self.current)
        return np.asarray(abs(self.ratio) * self.torque_constant * current)

    @property
    def no_load_speed(self) -> Array:
        """Velocity of the joint at which the largest voltage drives no current."""
        with np.errstate(divide="ignore"):  # infinite without a motor
            return np.asarray(self.voltage / (self.back_emf * abs(self.ratio)))

    @property
    def damping(self) -> Array:
        """Damping of the joint by the back EMF."""
        return np.asarray(self.ratio**2 * self.torque_constant * self.back_emf / self.resistance)

    @property
    def lines(self) -> tuple[Array, Array, Array, Array, Array]:
        """Stall torque of the supply, damping, torque of the largest current, efficiency, largest torque at the joint:
        the arguments of the recursions.
        """
        gain = abs(self.ratio) * self.torque_constant
        with np.errstate(over="ignore"):
            most = np.minimum(gain * np.minimum(self.current, UNLIMITED), UNLIMITED)
        limit = np.minimum(self.torque, UNLIMITED)
        return gain * self.voltage / self.resistance, self.damping, most, self.efficiency, limit

    def check(self, model: Model) -> Motor:
        """These motors with values for each freedom of the model. Raises ShapeError for another number of freedoms."""
        n = check_model(model).nv
        if len(self.ratio) == n:
            return self
        if len(self.ratio) != 1:
            raise ShapeError(f'motor has {len(self.ratio)} freedoms, expected the {n} of robot "{model.name}"')
        return Motor(*(np.broadcast_to(getattr(self, x.name), n) for x in fields(self)))

    def _content(self) -> tuple[bytes, ...]:
        return tuple((getattr(self, x.name) + 0.0).tobytes() for x in fields(self))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Motor) and self._content() == other._content()

    def __hash__(self) -> int:
        return hash(self._content())

    def __reduce__(self) -> tuple[Callable[..., Motor], tuple[Any, ...]]:
        return Motor, tuple(getattr(self, x.name) for x in fields(self))

    def __repr__(self) -> str:
        n, shown = len(self.ratio), (self.stall_torque, self.no_load_speed)
        stall, free = (np.array2string(x, precision=4, separator=", ", threshold=8) for x in shown)
        return f"<Motor of {n} freedom{'s' * (n != 1)}: stall torque {stall}, no-load speed {free}>"


def check_motor(model: Model, motor: Any) -> Motor:
    """The Motor of an argument, if it fits the model. Raises ModelError, ShapeError."""
    if not isinstance(motor, Motor):
        raise ModelError(f"motor is {literal(motor)}, expected a Motor")
    return motor.check(model)


def torque_limits(model: Model, v: ArrayLike, motor: Motor) -> tuple[Array, Array]:
    """Least and largest torque of motors at given joint velocities: (n k_t / R) (±V - k_e n q̇), within their limits.

    Source: after the equations of a DC motor, V = R i + k_e ω and τ = k_t i.

    model  Model
    v      (..., nv)  joint velocities [rad/s | m/s]
    motor  Motor

    The limit of a driving motor falls with the speed, to 0 at the no-load speed; the limit of a braking motor grows, up
    to the torque at the largest current. Beyond the no-load speed both limits oppose the motion: the motor can only
    brake. A gear of efficiency η < 1 passes η times the torque of a driving motor, and 1/η times that of a braking one;
    a motor at rest counts as driving.

    Returns (lower, upper), both (..., nv) [N m | N]: a torque is possible if it is between them, and
            ``np.clip(tau, lower, upper)`` otherwise.
    Raises
        ShapeError for shapes that do not match
        ModelError naming the joint with a value out of its range
        NaN in a sample gives NaN in what depends on it, in no other sample.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> motor = sd.Motor(torque_constant=[0.03, 0.03], resistance=0.6, voltage=24.0, ratio=50.0, current=20.0)
    >>> lower, upper = sd.torque_limits(model, [12.0, -12.0], motor)
    >>> lower, upper
    (array([-30., -15.]), array([15., 30.]))
    """
    made = checked_call(MOTOR_LIMITS, model, (v, *check_motor(check_model(model), motor).lines), (), None)
    return made[..., 0, :], made[..., 1, :]
