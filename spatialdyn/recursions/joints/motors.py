"""Geared electric motors: the limits of their torque at a velocity, and their torque over a step.

A gear of efficiency η passes η t of a motor torque t that drives, and t / η of a torque t that brakes:

    gain t - w  and  gain t + w  for t > 0,    gain = (1 + η²) / 2η,    w = |t| (1 - η²) / 2η.

This is dry friction of level w beside a torque gain t, for any efficiency, and ``friction.friction_step`` solves it: at
rest a geared joint passes any torque between the two, and may stick under load. A derivation of our own.
"""

from __future__ import annotations

from ...algebra.scalars import inline, select
from ..signatures import Bodies, Matrix, Number, Vector
from ..spec import Argument, Spec, V


@inline
def motor_limits(
    bodies: Bodies, v: Vector, stall: Vector, damping: Vector, most: Vector, efficiency: Vector, limit: Vector,
    limits: Matrix,
) -> None:  # fmt: skip
    """Least and largest torque (2, nv) at the joints: ±stall - damping v within ±most, through the gear, within ±limit.

    At the two ends of the supply's voltage the current is (±V - k_e n v) / R. The gear passes to the joint the share η
    of the power from the motor, and to the motor the share η of the power from the joint.
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


@inline
def driven(
    voltage: bool, i: int, v: Vector, tau: Vector, stall: Vector, emf: Vector, most: Vector, efficiency: Vector,
    limit: Vector,
) -> tuple[Number, Number, Number]:  # fmt: skip
    """(push, slope, level) of a motor over a step: a torque push - slope v⁺ at the joint and a level of dry friction.

    voltage  True: ``tau`` is the torque of a voltage u at rest, n k_t u / R, which the back-EMF lowers by emf v.
             False: ``tau`` is the torque of a current, n k_t i, limited by the supply's voltage
    """
    if voltage:
        held, slope = within(tau[i], stall[i]), emf[i]
    else:
        back = emf[i] * v[i]
        high, low = tau[i] + back - stall[i], -stall[i] - (tau[i] + back)
        held = select(high, stall[i], select(low, -stall[i], tau[i]))
        slope = select(high, emf[i], select(low, emf[i], 0.0))
    motor = held - slope * v[i]
    passed = select(-(motor * v[i]), efficiency[i], 1.0 / efficiency[i])  # of the gear's own limit, before it
    cap = most[i] - limit[i] * passed
    cap = select(cap, limit[i] * passed, most[i])
    size = select(motor, motor, -motor)
    over = select(cap, size - cap, 1.0)  # a joint without a motor is at both of its limits, also with a torque of 0
    held = select(over, select(motor, cap, -cap), held)
    slope = select(over, 0.0, slope)
    size = select(over, cap, size)
    half = 0.5 / efficiency[i]
    gain = half + 0.5 * efficiency[i]
    return gain * held, gain * slope, (half - 0.5 * efficiency[i]) * size


STALL = Argument("stall", ("nv",), "N m | N", "torque n k_t V / R of the motor at rest, before losses of the gear")
DAMPING = Argument("damping", ("nv",), "N m s/rad | N s/m", "n² k_t k_e / R, by which back-EMF lowers the torque")
MOST = Argument("most", ("nv",), "N m | N", "torque n k_t i of the largest current, before losses of the gear")
EFFICIENCY = Argument("efficiency", ("nv",), "1", "share of the power that the gear passes")
LIMIT = Argument("limit", ("nv",), "N m | N", "largest torque at the joint, of the gear")

SUPPLY = Argument("supply", ("nv",), STALL.unit, "as stall, of motors whose commands are voltages")
EMF = Argument("emf", ("nv",), DAMPING.unit, "as damping, of the motors of a step")
MOTOR_LIMITS = Spec(
    "motor_limits", motor_limits, None, (V, STALL, DAMPING, MOST, EFFICIENCY, LIMIT),
    Argument("limits", (2, "nv"), "N m | N", "least and largest torques"),
    "Limits of the torques of motors at velocities.", "after the equations of a DC motor, V = R i + k_e ω, τ = k_t i",
    composed=True,
)  # fmt: skip
