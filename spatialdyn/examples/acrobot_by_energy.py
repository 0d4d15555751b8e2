"""Swing-up of an acrobot, whose only motor is its elbow, by energy and Lyapunov's argument; then an LQR catches it.

Learn    crba and nonlinear_effects in a law: V = ½ Ẽ² + ½ kD v₂² + ½ kP q₂² falls by -kV v₂², if the denominator
         kD M₁₁ + Ẽ Δ never vanishes, which kD > 35.74 ensures for this arm. sd.lqr makes the gains that catch, and xᵀPx
         of its Riccati solution says when to.
Look at  V in the picture: it never rises until the LQR takes over. Left to itself the energy law needs most of a minute
         to come near the top at rest; the LQR catches the arm as it flies by, within some swings.
Needs    pip install scipy

After Xin and Kaneda, Analysis of the energy-based control for swinging up two-link robots (2007).
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, picture, start, write

Array = np.ndarray
DT, TIME, G = 2e-3, 12.0, 9.8
KD, KP, KV = 40.0, 60.0, 30.0


def acrobot() -> sd.Model:
    """Two rods of 1 kg, lengths 1 and 2 m, that hang at q = 0."""
    builder = sd.ModelBuilder("acrobot")
    for k, (at, centre, inertia) in enumerate(((0.0, -0.5, 0.083), (-1.0, -1.0, 0.33))):
        solid = (1.0, (0.0, 0.0, centre), inertia * np.diag([1.0, 1.0, 0.0]))
        builder.add_body(f"rod{k}", f"rod{k - 1}" if k else None, axis=(0, 1, 0), placement=(0, 0, at), inertia=solid)
    return sd.assemble(builder.build().robot, gravity=(0.0, 0.0, -G))


def main(save: str | None = None) -> dict[str, Any]:
    """Print the largest rise of V and when the arm is caught; returns both, and the motion."""
    need("scipy", "simulation")
    model, up, rest = acrobot(), np.array([np.pi, 0.0]), np.zeros(2)
    most = float(sd.potential_energy(model, up))
    A, B = sd.linearize(model, up, rest, rest)
    gains = sd.lqr(A, B[:, [1]], np.diag([10.0, 10.0, 1.0, 1.0]), np.eye(1))
    q, v = np.array([0.5, 0.0]), rest
    record, V, caught = [q], [], None
    for k in range(round(TIME / DT)):
        x = np.array([q[0] % (2 * np.pi) - np.pi, q[1], v[0], v[1]])
        caught = k * DT if caught is None and x @ gains.P @ x < 60.0 else caught
        if caught is not None:
            tau = np.array([0.0, -gains.K[0] @ x])
        else:
            M, h = sd.crba(model, q), sd.nonlinear_effects(model, q, v)
            lack = float(sd.kinetic_energy(model, q, v)) + float(sd.potential_energy(model, q)) - most
            D = np.linalg.det(M)
            pull = (KV * v[1] + KP * q[1]) * D + KD * (M[1, 0] * h[0] - M[0, 0] * h[1])
            tau = np.array([0.0, -pull / (KD * M[0, 0] + lack * D)])
            V.append(0.5 * (lack**2 + KD * v[1] ** 2 + KP * q[1] ** 2))
        q, v = sd.step(model, q, v, tau, DT, "rk4")
        record.append(q)
    rise = float(np.diff(V).max())
    path, drawn = np.array(record), np.array(V)
    print(f"V falls from {V[0]:.1f} to {V[-1]:.3g}, rises by {rise:.1e} at most; caught at {caught} s")
    if save:
        figure, axes = picture(2, width=9.0)
        axes[0].plot(DT * np.arange(len(path)), path, label=["shoulder", "elbow"], linewidth=0.8)
        axes[0].set(xlabel="t [s]", ylabel="q [rad]")
        axes[0].legend(fontsize="small")
        axes[1].semilogy(DT * np.arange(len(drawn)), drawn)
        axes[1].set(xlabel="t [s]", ylabel="V, until it is caught")
        write(figure, save)
    return {"rise": rise, "caught": caught, "q": path, "v": v, "V": drawn}


if __name__ == "__main__":
    start(main)
