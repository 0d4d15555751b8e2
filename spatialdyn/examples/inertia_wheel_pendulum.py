"""An inertia-wheel pendulum: raised by IDA-PBC, with a proof, and by an LQR, without one.

Learn    interconnection and damping assignment makes another Hamiltonian system of this one, H_d = ½ pᵀ M_d⁻¹ p + V_d;
         what the wheel cannot push has to match by itself, a condition that the tests hold in symbols. sd.lqr takes
         nothing but A and B, and knows nothing far from them.
Look at  H_d, which falls all the way: that is why the pendulum comes up from 3 rad. The LQR brings it up from there
         too, sooner and with four times the torque, and no line of its theory says that it will.
Needs    pip install scipy

After Ortega, Spong, Gómez-Estern and Blankenstein (2002); the gains are others.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, picture, start, write
from spatialdyn.examples.swing_up_by_energy import DT, play

Array = np.ndarray
I1, I2, M3, TIME = 0.1, 0.2, 10.0, 35.0  # of pendulum and wheel [kg m²], weight times lever [N m]; [s]
A1, A2, A3, K, KV = 0.1, -0.2, 0.5, 0.1, 0.05  # M_d = [[A1, A2], [A2, A3]], stiffness and damping
C = -I1 * (A2 + A3) / (I2 * (A1 + A2))


def wheel_pendulum() -> sd.Model:
    """Upright at q = 0; the wheel's joint turns it against the pendulum."""
    mass, lever, wheel, at = 12.0, (M3 / 9.81 - 0.05) / 12.0, 1.0, 0.05
    solid = (mass, (0.0, 0.0, lever), np.diag([0.02, I1 - mass * lever**2 - wheel * at**2, 0.02]))
    builder = sd.ModelBuilder("wheel_pendulum").add_body("pendulum", axis=(0, 1, 0), inertia=solid)
    disc = (wheel, (0.0, 0.0, 0.0), np.diag([0.1, I2, 0.1]))
    builder.add_body("wheel", "pendulum", axis=(0, 1, 0), placement=(0.0, 0.0, at), inertia=disc)
    return builder.build()


def shaped(x: Array) -> Any:
    """H_d of (q₁, q₂, q̇₁, q̇₂), q₂ the wheel's angle from the vertical."""
    z, p1, p2 = x[1] + C * x[0], I1 * x[2], I2 * x[3]
    kinetic = 0.5 * (A3 * p1**2 - 2.0 * A2 * p1 * p2 + A1 * p2**2) / (A1 * A3 - A2**2)
    return kinetic + I1 * M3 / (A1 + A2) * np.cos(x[0]) + 0.5 * K * z**2


def assigned(x: Array) -> Any:
    """The wheel's torque: of energy, ½ Gᵀ (∇V - M_d M⁻¹ ∇V_d) with G = (-1, 1), and of damping, -KV Gᵀ M_d⁻¹ p."""
    z, p1, p2 = x[1] + C * x[0], I1 * x[2], I2 * x[3]
    slope1, slope2 = -I1 * M3 / (A1 + A2) * np.sin(x[0]) + K * C * z, K * z
    d1, d2 = -M3 * np.sin(x[0]) - A1 * slope1 / I1 - A2 * slope2 / I2, -A2 * slope1 / I1 - A3 * slope2 / I2
    spin = ((A1 + A2) * p2 - (A2 + A3) * p1) / (A1 * A3 - A2**2)
    return 0.5 * (d2 - d1) - KV * spin


def main(save: str | None = None) -> dict[str, Any]:
    """Print where both laws lead, and the torque that they take; returns the motions, torques, H_d and poles."""
    need("scipy", "simulation")
    model, rest = wheel_pendulum(), np.zeros(2)
    A, B = sd.linearize(model, rest, rest, rest)
    gains = sd.lqr(A, B[:, [1]], np.diag([10.0, 0.1, 1.0, 0.1]), np.eye(1))
    turn = np.array([[1.0, 0.0], [1.0, 1.0]])  # from angles of joints to those from the vertical
    gain = gains.K[0] @ np.kron(np.eye(2), np.linalg.inv(turn))
    found: dict[Any, Any] = {"poles": gains.poles, "model": model}

    def linear(x: Array) -> Any:
        return -gain @ x

    for name, law, angle in (("IDA-PBC", assigned, 3.0), ("LQR", linear, 0.2), ("LQR", linear, 3.0)):

        def torque(q: Array, v: Array, law: Callable[[Array], Any] = law) -> Array:
            return np.array([0.0, law(np.concatenate([turn @ q, turn @ v]))])

        q, v = play(model, torque, np.array([angle, -angle]), rest, TIME)
        found[name, angle] = x = np.hstack([q @ turn.T, v @ turn.T])
        found["torque", name, angle] = most = abs(law(x.T)).max()
        calm = DT * (1 + np.flatnonzero(abs(x * [1.0, 1.0, I1, I2]).max(1) > 0.05)[-1])
        print(f"{name:8} from {angle} rad: (q, p) below 0.05 from {calm:5.2f} s on, torque up to {most:5.1f} N m")
    found["H_d"] = shaped(found["IDA-PBC", 3.0].T)
    print(f"H_d falls from {found['H_d'][0]:.3f} to {found['H_d'][-1]:.3f}, rises by {np.diff(found['H_d']).max():.0e}")
    if save:
        figure, axes = picture(2, width=9.0)
        for name, angle in (("IDA-PBC", 3.0), ("LQR", 3.0)):
            axes[0].plot(DT * np.arange(len(found["H_d"])), found[name, angle][:, 0], linewidth=0.9, label=name)
        axes[0].set(xlabel="t [s]", ylabel="angle of the pendulum [rad]")
        axes[0].legend(fontsize="small")
        axes[1].plot(DT * np.arange(len(found["H_d"])), found["H_d"])
        axes[1].set(xlabel="t [s]", ylabel="H_d, shaped energy [J]")
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
