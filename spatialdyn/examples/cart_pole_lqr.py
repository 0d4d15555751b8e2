"""LQR of a cart-pole: the linear model from aba_derivatives, the gain from SciPy, tried on the nonlinear one.

Learn    ModelBuilder makes a robot without a file; aba_derivatives gives ∂q̈/∂(q, v, τ), so A and B of ẋ = A x + B u.
Look at  the last lines: from 0.4 rad the pole comes up, from 1.1 rad the same gain drives the cart away. The linear
         model says that all starts end well; that is all it can say.
Needs    pip install scipy
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, picture, start, write


def cart_pole(cart: float = 1.0, pole: float = 0.2, length: float = 0.5) -> sd.Model:
    """A cart on a rail along x and a point mass on a light rod; the angle is 0 upright."""
    builder = sd.ModelBuilder("cart_pole")
    builder.add_body("cart", joint="prismatic", axis=(1, 0, 0), inertia=(cart, (0, 0, 0), np.zeros((3, 3))))
    builder.add_body("pole", "cart", axis=(0, 1, 0), inertia=(pole, (0, 0, length), np.zeros((3, 3))))
    return builder.build()


def main(save: str | None = None) -> dict[str, Any]:
    """Print A, B, the gain and where it leads; returns them, with a run from each start."""
    linalg = need("scipy.linalg", "simulation")
    model, rest = cart_pole(), np.zeros(2)
    by_q, by_v, by_tau = sd.aba_derivatives(model, rest, rest, rest)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [by_q, by_v]])
    B = np.concatenate([np.zeros(2), by_tau[:, 0]])[:, None]  # the motor drives the cart alone
    Q, R = np.diag([1.0, 1.0, 0.1, 0.1]), np.array([[0.1]])
    P = linalg.solve_continuous_are(A, B, Q, R)
    K = np.linalg.solve(R, B.T @ P)
    poles = np.linalg.eigvals(A - B @ K)
    print(f"A =\n{A.round(6)}\nB = {B.ravel()}\nK = {K.ravel().round(4)}")
    print(f"eigenvalues without control {np.linalg.eigvals(A).round(3)}")
    print(f"eigenvalues with it         {poles.round(3)}")

    def law(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([float(-K[0] @ np.concatenate([q, v])), 0.0])

    runs = {}
    for angle in (0.1, 0.4, 1.1):
        runs[angle] = run = sd.simulate(model, [0.0, angle], rest, 8.0 if angle < 1 else 0.8, 2e-3, torque=law)
        x = np.concatenate([run.q[-1], run.v[-1]])
        print(f"from {angle} rad: after {run.t[-1]:g} s cart at {x[0]:8.4f} m, pole at {x[1]:8.4f} rad")
    if save:
        figure, axes = picture()
        for angle, run in runs.items():
            axes.plot(run.t, run.q[:, 1], label=f"from {angle} rad")
        axes.set(xlabel="t [s]", ylabel="angle of the pole [rad]", xlim=(0, 4))
        axes.set_title("the law of the linear system holds the pole, but not from 1.1 rad")
        axes.legend()
        write(figure, save)
    return {"A": A, "B": B, "K": K, "P": P, "poles": poles, "runs": runs}


if __name__ == "__main__":
    start(main)
