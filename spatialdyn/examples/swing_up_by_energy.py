"""Swing-up of a pendulum and of a cart-pole by their energy, the cart-pole caught by an LQR.

Learn    a law of one's own in a loop of sd.step; sd.linearize and sd.lqr make the gains that catch, and xᵀPx of the
         same Riccati solution says when to: inside its ellipsoid.
Look at  the times: the pendulum, whose motor is too weak to lift it, has the energy of the upright rest at 5.55 s, the
         cart-pole is caught after a few swings. Energy alone pumps: v (E - E*) < 0 is all that the law knows.
Needs    pip install scipy
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.cart_pole_lqr import cart_pole
from spatialdyn.examples.gallery import need, picture, start, write

Array = np.ndarray
DT, G, TURN = 2e-3, 9.81, 2.0 * np.pi


def play(model: sd.Model, law: Callable[[Array, Array], Array], q: Array, v: Array, time: float) -> tuple[Array, Array]:
    """q and v (steps + 1, n) of a motion under a law, held over steps of rk4."""
    qs, vs = [q], [v]
    for _ in range(round(time / DT)):
        q, v = sd.step(model, q, v, law(q, v), DT, "rk4")
        qs.append(q)
        vs.append(v)
    return np.array(qs), np.array(vs)


def pump(q: Array, v: Array) -> Array:
    """The pendulum's torque, at most 2 N m; E* is the energy of the upright rest, G."""
    return np.asarray(np.clip(-0.5 * v * (0.5 * v * v - G * np.cos(q) - G), -2.0, 2.0))


def main(save: str | None = None) -> dict[str, Any]:
    """Print when the pendulum has its energy and the cart-pole is caught; returns both times and the motions."""
    need("scipy", "simulation")
    rod = sd.ModelBuilder("pendulum").add_body("rod", axis=(0, 1, 0), inertia=(1.0, (0, 0, -1.0), np.zeros((3, 3))))
    swing = play(rod.build(), pump, np.array([0.01]), np.zeros(1), 8.0)
    missing = abs(0.5 * swing[1][:, 0] ** 2 - G * np.cos(swing[0][:, 0]) - G)
    reached = DT * int(np.argmax(missing < 0.01))
    model, rest = cart_pole(1.0, 1.0, 1.0), np.zeros(2)
    A, B = sd.linearize(model, rest, rest, rest)
    gains = sd.lqr(A, B[:, [0]], np.diag([1.0, 1.0, 0.1, 0.1]), 0.1 * np.eye(1))
    caught: list[bool] = []

    def cart(q: Array, v: Array) -> Array:
        s, c = np.sin(q[1]), np.cos(q[1])  # of the angle from upright
        x = np.array([q[0], q[1] - TURN * np.round(q[1] / TURN), *v])
        caught.append(bool(x @ gains.P @ x < 10.0 or (caught and caught[-1])))
        if caught[-1]:
            return np.array([-gains.K[0] @ x, 0.0])
        u = 0.2 * v[1] * c * (0.5 * v[1] ** 2 + G * c - G) - 0.2 * (q[0] + v[0])
        return np.array([2.0 * u + (G * s - u * c) * c - v[1] ** 2 * s, 0.0])  # the force for ẍ = u

    lift = play(model, cart, np.array([0.0, np.pi - 0.01]), np.zeros(2), 16.0)
    when = DT * int(np.argmax(caught))
    end = np.concatenate([lift[0][-1] - [0.0, TURN * np.round(lift[0][-1, 1] / TURN)], lift[1][-1]])
    print(f"pendulum: |E - E*| < 0.01 J from {reached:.2f} s on")
    print(f"cart-pole: caught at {when:.2f} s, at the end off by {abs(end).max():.1e}")
    if save:
        figure, axes = picture(2, width=9.0)
        axes[0].plot(DT * np.arange(len(swing[0])), swing[0][:, 0])
        axes[0].set(xlabel="t [s]", ylabel="angle from hanging [rad]", title="pendulum, at most 2 N m")
        axes[1].plot(DT * np.arange(len(lift[0])), lift[0], label=["cart [m]", "pole from upright [rad]"])
        axes[1].axvline(when, color="0.6", linewidth=0.8)
        axes[1].set(xlabel="t [s]", title="cart-pole, caught by LQR at the line")
        axes[1].legend(fontsize="small")
        write(figure, save)
    return {"reached": reached, "caught": when, "end": end, "swing": swing, "lift": lift}


if __name__ == "__main__":
    start(main)
