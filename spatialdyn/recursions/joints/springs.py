"""Springs of series-elastic joints: the torque between a rotor and the joint that it drives, and its energy.

The row of the rotor, at θ, has the row of its joint, at q, in the column ``spring``. With θ = n q in a rigid gear,

    τ = k (θ/n - q) + d (θ̇/n - q̇)  on the joint,    -τ/n  on the rotor.

Source: after Spong, Modeling and control of elastic joint robots (1987); here the rotor is a body, so its momentum on a
moving link is exact.
"""

from __future__ import annotations

from ...algebra.scalars import inline
from ..signatures import Bodies, Config, Record, Vector
from ..spec import TAU, Argument, Q, Spec, V


@inline
def spring_torque(bodies: Bodies, q: Config, v: Vector, tau: Vector) -> None:
    """τ of each spring on its joint and on its rotor; v may be None, for zero."""
    for i in range(len(bodies) - 1):
        tau[i] = 0.0
    add_springs(bodies, q, v, tau)


@inline
def add_springs(bodies: Bodies, q: Config, v: Vector, tau: Vector) -> None:
    """tau += the torques of the springs."""
    for i in range(1, len(bodies)):
        b = bodies[i]
        if b.spring > 0:
            t = b.stiffness * stretch(bodies, b, q)
            if v is not None:
                t = t + b.spring_damping * (v[i - 1] * b.gear - v[b.spring - 1])
            tau[b.spring - 1] = tau[b.spring - 1] + t
            tau[i - 1] = tau[i - 1] - t * b.gear


@inline
def stretch(bodies: Bodies, b: Record, q: Config) -> float:
    """θ/n - q of the spring of row b."""
    return q[b.q_index] * b.gear - q[bodies[b.spring].q_index]  # type: ignore[no-any-return]


@inline
def spring_energy(bodies: Bodies, q: Config, V: Vector) -> None:
    """Σ ½ k (θ/n - q)²."""
    twice = 0.0
    for i in range(1, len(bodies)):
        b = bodies[i]
        if b.spring > 0:
            x = stretch(bodies, b, q)
            twice = twice + b.stiffness * x * x
    V[0] = 0.5 * twice


_SOURCE = "after Spong, Modeling and control of elastic joint robots (1987)."
SPRING_TORQUE = Spec(
    "spring_torque", spring_torque, None, (Q, Argument("v", V.shape, V.unit, V.meaning, optional=True)), TAU,
    "Torques of the springs between rotors and joints.", _SOURCE,
)  # fmt: skip
SPRING_ENERGY = Spec(
    "spring_energy", spring_energy, None, (Q,), Argument("V", (), "J", "energy of the springs"),
    "Energy of the springs between rotors and joints.", _SOURCE,
)  # fmt: skip
