"""An inertia-wheel pendulum: raised by IDA-PBC, with a proof, and by an LQR, without one.

Learn    interconnection and damping assignment makes another Hamiltonian system of this one, H_d = ½ pᵀ M_d⁻¹ p + V_d;
         where the wheel gives no torque both systems have to agree, the matching condition, which a test checks in
         symbols. sd.lqr takes nothing but A and B, which describe the robot near its goal alone.
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
from spatialdyn.algebra.scalars import sin
from spatialdyn.examples.gallery import need, picture, start, write
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec, V

I1, I2, M3, DT, TIME = 0.1, 0.2, 10.0, 2e-3, 30.0  # of pendulum and wheel [kg m²], weight times lever [N m]; [s]
A1, A2, A3, K, KV = 0.1, -0.2, 0.5, 0.1, 0.05  # M_d = [[A1, A2], [A2, A3]], stiffness and damping
NUMBERS = np.array([I1, I2, M3, A1, A2, A3, K, KV])


def wheel_pendulum() -> sd.Model:
    """Upright at q = 0; the wheel's joint turns it against the pendulum."""
    mass, lever, wheel, at = 12.0, (M3 / 9.81 - 0.05) / 12.0, 1.0, 0.05
    solid = (mass, (0.0, 0.0, lever), np.diag([0.02, I1 - mass * lever**2 - wheel * at**2, 0.02]))
    builder = sd.ModelBuilder("wheel_pendulum").add_body("pendulum", axis=(0, 1, 0), inertia=solid)
    disc = (wheel, (0.0, 0.0, 0.0), np.diag([0.1, I2, 0.1]))
    builder.add_body("wheel", "pendulum", axis=(0, 1, 0), placement=(0.0, 0.0, at), inertia=disc)
    return builder.build()


def shaped(x: Any) -> Any:
    """H_d of (q₁, q₂, q̇₁, q̇₂), q₂ the wheel's angle from the vertical."""
    z, p1, p2 = x[1] - I1 * (A2 + A3) / (I2 * (A1 + A2)) * x[0], I1 * x[2], I2 * x[3]
    kinetic = 0.5 * (A3 * p1**2 - 2.0 * A2 * p1 * p2 + A1 * p2**2) / (A1 * A3 - A2**2)
    return kinetic + I1 * M3 / (A1 + A2) * np.cos(x[0]) + 0.5 * K * z**2


def assigned(x: Any, numbers: Any, sine: Callable[[Any], Any]) -> Any:
    """The wheel's torque: of energy, ½ Gᵀ (∇V - M_d M⁻¹ ∇V_d) with G = (-1, 1), and of damping, -k_v Gᵀ M_d⁻¹ p."""
    i1, i2, m3, a1, a2, a3, k, kv = numbers
    c = -i1 * (a2 + a3) / (i2 * (a1 + a2))
    z, p1, p2 = x[1] + c * x[0], i1 * x[2], i2 * x[3]
    slope1, slope2 = k * c * z - i1 * m3 / (a1 + a2) * sine(x[0]), k * z
    d1, d2 = -m3 * sine(x[0]) - a1 * slope1 / i1 - a2 * slope2 / i2, -a2 * slope1 / i1 - a3 * slope2 / i2
    return 0.5 * (d2 - d1) - kv * ((a1 + a2) * p2 - (a2 + a3) * p1) / (a1 * a3 - a2 * a2)


def on_the_wheel(bodies: Any, q: Any, v: Any, numbers: Any, tau: Any) -> None:
    """The law as a recursion: it acts wherever rk4 evaluates forces, so it is not held over steps."""
    tau[0], tau[1] = 0.0, assigned((q[0], q[0] + q[1], v[0], v[0] + v[1]), numbers, sin)


def main(save: str | None = None) -> dict[str, Any]:
    """Print where both laws lead, and the torque that they take; returns the motions, times, torques, H_d and poles."""
    need("scipy", "simulation")
    model, rest = wheel_pendulum(), np.zeros(2)
    A, B = sd.linearize(model, rest, rest, rest)
    gains = sd.lqr(A, B[:, [1]], np.diag([10.0, 0.1, 1.0, 0.1]), np.eye(1))
    turn = np.array([[1.0, 0.0], [1.0, 1.0]])  # from angles of joints to those from the vertical
    spec = Spec("ida_pbc", on_the_wheel, None, (Q, V, Argument("numbers", (8,), "", "of the law")), TAU, "", "Ortega")
    raised, caught = sd.Control(spec, {"numbers": NUMBERS}), gains.feedback(rest, joints=[1])
    found: dict[Any, Any] = {"poles": gains.poles, "model": model}
    for name, law, angle in (("IDA-PBC", raised, 3.0), ("LQR", caught, 0.2), ("LQR", caught, 3.0)):
        run = sd.simulate(model, [angle, -angle], rest, TIME, DT, "rk4", control=law)
        found[name, angle] = x = np.hstack([run.q @ turn.T, run.v @ turn.T])
        most, large = float(abs(run.tau).max()), abs(x * [1.0, 1.0, I1, I2]).max(1) > 0.05
        found["torque", name, angle], calm = most, float(run.t[1 + np.flatnonzero(large)[-1]])
        print(f"{name:8} from {angle} rad: (q, p) below 0.05 from {calm:5.2f} s on, torque up to {most:5.1f} N m")
        found["calm", name, angle] = calm
    found["H_d"] = H = shaped(found["IDA-PBC", 3.0].T)
    print(f"H_d falls from {H[0]:.3f} to {H[-1]:.3f}, between samples by {-np.diff(H).max():.0e} or more")
    if save:
        figure, axes = picture(2, width=9.0)
        axes[0].plot(run.t, np.stack([found[x, 3.0][:, 0] for x in ("IDA-PBC", "LQR")], 1), label=["IDA-PBC", "LQR"])
        axes[0].set(xlabel="t [s]", ylabel="angle of the pendulum [rad]")
        axes[0].legend(fontsize="small")
        axes[1].plot(run.t, H)
        axes[1].set(xlabel="t [s]", ylabel="H_d, shaped energy [J]")
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
