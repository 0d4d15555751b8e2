"""iLQR with limits of the torques: a cart-pole that swings up, and a Panda that reaches for a point.

Learn    sd.step_derivatives gives all A and B of a horizon in one call, and sd.rollout the motion under a new law, a
         recursion that joins the program of the steps. The rest is Riccati's recursion in compiled loops;
         ``optimal_control`` has the problems.
Look at  the cost of the swing-up, 3.5517082866 as other solvers have it, and the price of limits. With them the gains
         of a joint at its limit are 0: projected Newton steps find which joints that are.
Needs    pip install example-robot-data for the Panda
"""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any

import numba
import numpy as np

import spatialdyn as sd
from spatialdyn.algebra.scalars import select
from spatialdyn.examples.gallery import picture, start, write
from spatialdyn.examples.optimal_control import Problem, cost_of, reach, swing_up
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec, V

Array = np.ndarray


@numba.njit(cache=True)
def add_product(A, B, out):  # type: ignore[no-untyped-def]
    """out + Aᵀ B, written in place. For matrices this small loops are faster than BLAS and sooner compiled."""
    for k in range(len(A)):
        for i in range(len(out)):
            for j in range(B.shape[1]):
                out[i, j] += A[k, i] * B[k, j]
    return out


@numba.njit(cache=True)
def add_by(A, x, out):  # type: ignore[no-untyped-def]
    """out + Aᵀ x, written in place."""
    for k in range(len(A)):
        for i in range(len(out)):
            out[i] += A[k, i] * x[k]
    return out


@numba.njit(cache=True)
def dot(x, y):  # type: ignore[no-untyped-def]
    """x · y."""
    total = 0.0
    for k in range(len(x)):
        total += x[k] * y[k]
    return total


def law(bodies, q, v, push, gains, around, low, high, tau):  # type: ignore[no-untyped-def]
    """push + gains (x - around) within low and high."""
    n = len(tau)
    for i in range(n):
        total = push[i]
        for j in range(n):
            total = total + gains[i, j] * (q[j] - around[j]) + gains[i, n + j] * (v[j] - around[n + j])
        tau[i] = select(low[i] - total, low[i], select(total - high[i], high[i], total))


SIZES = {"push": ("nv",), "gains": ("nv", "nv+nv"), "around": ("nv+nv",), "low": ("nv",), "high": ("nv",)}
LAW = Spec("ilqr", law, None, (Q, V, *(Argument(x, y, "", "") for x, y in SIZES.items())), TAU, "A law of a step.", "")


def forward(p: Problem, x: Array, push: Array, K: Array) -> tuple[Array, Array]:
    """The motion X from x[0], in semi-implicit steps, and its torques U = push + K (X - x) within the limits."""
    n, limits = p.model.nv, {"low": np.nan_to_num(p.low), "high": np.nan_to_num(p.high)}
    control = sd.Control(LAW, {"push": push, "gains": K, "around": x[:-1], **limits})
    X = x.copy()
    X[1:, :n], X[1:, n:] = sd.rollout(sd.Scene(p.model, friction=False), x[0, :n], x[0, n:], dt=p.h, control=control)
    return X, np.clip(push + (K @ (X - x)[:-1, :, None])[..., 0], p.low, p.high)


@numba.njit(cache=True)
def free_inverse(H, free):  # type: ignore[no-untyped-def]
    """H⁻¹ of the free unknowns, 0 elsewhere, by Gauss and Jordan; and whether H is positive there."""
    n, X = len(H), H.copy()
    for k in range(n):
        for j in range(n):
            if not (free[k] and free[j]):
                X[k, j] = 0.0
    for k in range(n):
        pivot = X[k, k]
        if free[k] and not pivot > 0.0:
            return X, False
        if free[k]:
            X[k, k] = 1.0
            for j in range(n):
                X[k, j] /= pivot
            for i in range(n):
                factor = X[i, k]
                if i != k:
                    X[i, k] = 0.0
                    for j in range(n):
                        X[i, j] -= factor * X[k, j]
    return X, True


@numba.njit(cache=True)
def box_minimum(H, g, low, high):  # type: ignore[no-untyped-def]
    """x of the least ½ xᵀHx + gᵀx in a box, by projected Newton steps (Tassa 2014), and ``free_inverse`` of H there."""
    n = len(g)
    x, step, free, inverse, positive = np.zeros(n), np.zeros(n), np.zeros(n, np.bool_), H, True
    for i in range(n):
        x[i] = min(max(0.0, low[i]), high[i])
    for turn in range(50):
        slope, changed = add_by(H, x, g.copy()), turn == 0
        for i in range(n):
            held = (x[i] <= low[i] and slope[i] >= 0.0) or (x[i] >= high[i] and slope[i] <= 0.0)
            changed, free[i] = changed or free[i] == held, not held
        if changed:
            inverse, positive = free_inverse(H, free)
        move, size = add_by(inverse, slope, np.zeros(n)), 1.0
        if not positive or dot(slope, move) <= 1e-20 * abs(dot(g, x)):
            break
        while size > 1e-9:  # until the step, projected onto the box, goes down
            for i in range(n):
                step[i] = min(max(x[i] - size * move[i], low[i]), high[i]) - x[i]
            if dot(step, slope) + 0.5 * dot(step, add_by(H, step, np.zeros(n))) < 0.0:
                break
            size *= 0.5
        else:
            break
        for i in range(n):
            x[i] += step[i]
    return x, inverse, positive


@numba.njit(cache=True)
def backward(C, slope, W, g, H, low, high, mu, k, K):  # type: ignore[no-untyped-def]
    """Riccati's recursion from the end: the decrease, NaN if H is indefinite; new k (T, n), gains K (T, n, 2n).

    C (T, 2n, 3n)  derivatives of the steps by (x, u); slope (T, 3n) and W (3n, 3n) of the cost of each
    g, H           of the cost of the last state
    """
    n, m, less = k.shape[1], 2 * k.shape[1], 0.0
    k, K = np.zeros_like(k), np.zeros_like(K)
    Hux, Huu, damped, minus = np.zeros((n, m)), np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    for t in range(len(C) - 1, -1, -1):
        Q = add_product(C[t], add_product(H, C[t], np.zeros(C[t].shape)), W.copy())
        r = add_by(C[t], g, slope[t].copy())
        for i in range(n):
            for j in range(m):
                Hux[i, j] = Q[m + i, j]
            for j in range(n):
                Huu[i, j] = Q[m + i, m + j]
                damped[i, j] = Huu[i, j] + (mu if i == j else 0.0)
        step, inverse, positive = box_minimum(damped, r[m:], low[t], high[t])
        if not positive:
            return np.nan, k, K
        for i in range(n):
            k[t, i] = step[i]
            for j in range(n):
                minus[i, j] = -inverse[i, j]
        add_product(minus, Hux, K[t])
        by_k = add_by(Huu, step, np.zeros(n))
        less -= dot(step, r[m:]) + 0.5 * dot(step, by_k)
        g = add_by(Hux, step, add_by(K[t], r[m:] + by_k, r[:m].copy()))
        half = add_product(K[t], add_product(0.5 * Huu, K[t], Hux.copy()), 0.5 * Q[:m, :m])
        H = half + half.T
    return less, k, K


def ilqr(p: Problem, u: Array, tolerance: float = 1e-12, most: int = 300) -> tuple[Array, Array, list[float], Array]:
    """States (T + 1, 2 nv), torques (T, nv), costs and gains (T, nv, 2 nv) of a minimum near the torques u."""
    T, n, mu, size, taken = len(u), p.model.nv, 0.0, 1.0, 1.0
    x, k, K = np.zeros((T + 1, 2 * n)), np.zeros((T, n)), np.zeros((T, n, 2 * n))
    x[0] = np.concatenate([p.q0, p.v0])
    new, forces = forward(p, x, u, K)
    costs = [(found := cost_of(p, new, forces))[0]]
    while len(costs) < most and mu < 1e8:
        if size:  # the last step was taken
            x, u, (_, slope, W, last) = new, forces, found
            q, v = x[:-1, :n].copy(), x[:-1, n:].copy()
            C = np.concatenate(sd.step_derivatives(sd.Scene(p.model, friction=False), q, v, u, p.h), axis=2)
        less, k, K = backward(C, slope, W, *last, p.low - u, p.high - u, mu, k, K)
        size = 0.0 if np.isnan(less) else min(1.0, 4.0 * taken)
        while size > 1e-3:
            with suppress(sd.SimulationError):  # of a motion that leaves the range of numbers
                new, forces = forward(p, x, u + size * k, K)
                found = cost_of(p, new, forces)
                if costs[-1] - found[0] >= 0.1 * size * less - 1e-15 * abs(costs[-1]):
                    break
            size *= 0.5
        if size <= 1e-3:
            size, mu = 0.0, max(10.0 * mu, 1e-6)
            continue
        mu, taken = (mu / 10.0 if mu > 1e-6 else 0.0), size
        costs.append(found[0])
        if costs[-2] - costs[-1] <= tolerance * abs(costs[-1]):
            break
    return new, forces, costs, K


def main(quick: bool = False, save: str | None = None) -> dict[str, Any]:
    """Solve and print; returns {name: (states, torques, costs)}."""
    found: dict[str, Any] = {}
    problems = {"swing-up": (swing_up(), 100), "swing-up, 12 N": (swing_up(12.0), 150)}
    if not quick:
        problems["reach"] = (reach(sd.load_urdf("panda")), 100)
    for name, (p, T) in problems.items():
        began = time.perf_counter()
        x, u, costs, _ = ilqr(p, np.tile(p.force, (T, 1)), 1e-9 if name == "reach" else 1e-12)
        spent = 1e3 * (time.perf_counter() - began) / len(costs)
        print(f"{name:15} cost {costs[-1]:.10f} in {len(costs) - 1} iterations, {spent:.2f} ms each with compiling")
        bound = f"{np.mean((u == p.low) | (u == p.high)):.0%} of all at a limit"
        print(f"{'':15} largest torque {abs(u).max():.4f}, {bound}")
        found[name] = x, u, costs
    if save:
        figure, axes = picture()
        for name in ("swing-up", "swing-up, 12 N"):
            axes.step(0.02 * np.arange(len(found[name][1])), found[name][1][:, 0], where="post", label=name)
        axes.set(xlabel="t [s]", ylabel="force on the cart [N]", title="a limit costs a swing more")
        axes.legend()
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
