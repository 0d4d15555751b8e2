"""Limits of the torque that a geared electric motor gives at a velocity: its torque-speed lines."""

from __future__ import annotations

from ..algebra.scalars import inline, select
from .signatures import Bodies, Matrix, Number, Vector
from .spec import Argument, Spec, V


@inline
def motor_limits(
    bodies: Bodies, v: Vector, stall: Vector, damping: Vector, most: Vector, efficiency: Vector, limit: Vector,
    limits: Matrix,
) -> None:  # fmt: skip
    """Least and largest torque (2, nv) at the joints: ±stall - damping v within ±most, through the gear, within ±limit.

    At either end of the supply's voltage the current is (±V - k_e n v) / R. The gear passes the part η of the power
    that the motor gives, and to the motor η of the power that it takes.
    """
    for i in range(len(bodies) - 1):
        for row in range(2):
            line = (stall[i] if row == 1 else -stall[i]) - damping[i] * v[i]
            motor = within(line, most[i])
            limits[row, i] = within(motor * select(-(motor * v[i]), 1.0 / efficiency[i], efficiency[i]), limit[i])


@inline
def within(x: Number, most: Number) -> Number:
    """x, or the nearer of ±most."""
    x = select(x - most, most, x)
    return select(-most - x, -most, x)


STALL = Argument("stall", ("nv",), "N m | N", "torque n k_t V / R of the motor at rest, before losses of the gear")
DAMPING = Argument("damping", ("nv",), "N m s/rad | N s/m", "n² k_t k_e / R, by which its voltage at speed lowers it")
MOST = Argument("most", ("nv",), "N m | N", "torque n k_t i of the largest current, before losses of the gear")
EFFICIENCY = Argument("efficiency", ("nv",), "1", "part of the power that the gear passes")
LIMIT = Argument("limit", ("nv",), "N m | N", "largest torque at the joint, of the gear")

MOTOR_LIMITS = Spec(
    "motor_limits", motor_limits, None, (V, STALL, DAMPING, MOST, EFFICIENCY, LIMIT),
    Argument("limits", (2, "nv"), "N m | N", "least and largest torques"),
    "Limits of the torques of motors at velocities.", "after the equations of a DC motor, V = R i + k_e ω, τ = k_t i",
)  # fmt: skip
