"""The momentum observer: unmodelled torques, from positions, velocities and motor torques alone.

r = K (p - p₀ - ∫ (β + r) dt) with p = M v and β = τ + Cᵀ v - g, the rate of p without external torques. So
ṙ = K (τ_ext - r): r is the filtered torque of contacts, without accelerations and without M⁻¹. Discretized by the
trapezoidal rule, implicit in r, with z = p₀ + ∫ (β + r) dt:

    s = z + ½h (β + β⁺),    r⁺ = K (p⁺ - s - ½h r) / (1 + ½h K),    z⁺ = s + ½h (r + r⁺).

ṗ = Cᵀv + τ - g holds for quasi-velocities, so floating bases and quaternion joints need nothing more. Source: De Luca
and Mattone, Sensorless robot collision detection and hybrid force/motion control (2005); the discretization after ours.
"""

from __future__ import annotations

from ...algebra.scalars import Scalar, inline
from ..momenta.hamilton import WORK_RATE, generalized_momentum, momentum_rate
from ..signatures import Bodies, Config, Vector, Work
from ..spec import TAU, TURNED_Q, Argument, Spec, V

MEMORY = Argument("observed", ("nv+nv+nv",), "kg m²/s, N m", "z, the rate β and the residual r, one after the other")


@inline
def momentum_observer_step(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, gain: Vector, dt: Scalar, memory: Vector,
    after: Vector, p: Vector, rate: Vector,
) -> None:  # fmt: skip
    """The memory after a step h that ends at q, v and tau.

    memory, after  (3 nv)  z, β and r, one after the other
    p, rate        (nv) scratch: p⁺ and β⁺
    """
    n, h = len(bodies) - 1, 0.5 * dt
    generalized_momentum(bodies, work, q, v, p)
    momentum_rate(bodies, work, q, v, tau, None, rate)
    for i in range(n):
        r = memory[2 * n + i]
        s = memory[i] + h * (memory[n + i] + rate[i])
        ahead = gain[i] * (p[i] - s - h * r) / (1.0 + h * gain[i])
        after[i] = s + h * (r + ahead)
        after[n + i] = rate[i]
        after[2 * n + i] = ahead


OBSERVER = Spec(
    "momentum_observer_step", momentum_observer_step, WORK_RATE,
    (
        TURNED_Q, V, TAU, Argument("gain", ("nv",), "1/s", "of the filter"), Argument("dt", (), "s", "the step"),
        MEMORY,
    ),
    Argument("observed_after", ("nv+nv+nv",), "kg m²/s, N m", "the memory after the step"),
    "A step of the momentum observer.", "De Luca and Mattone (2005), by the trapezoidal rule.",
    scratch=(("nv",), ("nv",)), regroup=True,
)  # fmt: skip
