"""iLQR with limits of the torques: a cart-pole that swings up, and a Panda that reaches for a point.

Learn    sd.step_derivatives gives all A and B of a horizon in one call, and sd.kernels.aba the motion under a new law
         in compiled code. The rest is Riccati's recursion, written out in loops, which compile in seconds.
Look at  the cost of the swing-up, 3.5517082866 as other solvers have it, and the price of limits. With them the gains
         of a joint at its limit are 0: projected Newton steps find which joints that are.
Needs    the second half needs a robot: pip install "spatialdyn[validate]"
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import numba
import numpy as np

import spatialdyn as sd
from spatialdyn.examples.cart_pole_lqr import cart_pole
from spatialdyn.examples.gallery import picture, start, write

Array = np.ndarray
aba = sd.kernels.aba


class Problem(NamedTuple):
    """Σ ½ h (xᵀ Q x + uᵀ R u) + final cost, over semi-implicit steps of h; x = (q, v) - goal, u = tau - force.

    final  ``final(x) -> (cost, gradient, Hessian)`` at the last state (q, v)
    """

    model: sd.Model
    q0: Array
    v0: Array
    h: float
    goal: Array
    Q: Array
    R: Array
    final: Callable[[Array], tuple[float, Array, Array]]
    force: Array
    low: Array
    high: Array


@numba.njit
def forward(bodies, x, u, k, K, size, low, high, h, X, U):  # type: ignore[no-untyped-def]
    """Semi-implicit steps under u + size k + K (X - x) within low and high; the motion X and its U are written."""
    n = len(low)
    q, v, a = X[0, :n].copy(), X[0, n:].copy(), np.empty(n)
    for t in range(len(u)):
        for i in range(n):
            s = u[t, i] + size * k[t, i]
            for j in range(2 * n):
                s += K[t, i, j] * (X[t, j] - x[t, j])
            U[t, i] = min(max(s, low[i]), high[i])
        aba(bodies, q, v, U[t], a)
        for i in range(n):
            v[i] += h * a[i]
            q[i] += h * v[i]
            X[t + 1, i], X[t + 1, n + i] = q[i], v[i]


@numba.njit(cache=True)
def times(X, Y, Z):  # type: ignore[no-untyped-def]
    """Z = X Y."""
    for i in range(X.shape[0]):
        for j in range(Y.shape[1]):
            Z[i, j] = 0.0
        for k in range(X.shape[1]):
            for j in range(Y.shape[1]):
                Z[i, j] += X[i, k] * Y[k, j]


@numba.njit(cache=True)
def add_transposed(X, Y, Z):  # type: ignore[no-untyped-def]
    """Z += Xᵀ Y."""
    for k in range(X.shape[0]):
        for i in range(X.shape[1]):
            for j in range(Y.shape[1]):
                Z[i, j] += X[k, i] * Y[k, j]


@numba.njit(cache=True)
def solve_free(H, free, X, L):  # type: ignore[no-untyped-def]
    """X = H⁻¹ X of the free unknowns, in place, the other rows 0, by Cholesky; False where H is not positive."""
    n = len(H)
    for i in range(n):
        for j in range(i + 1):
            s = H[i, j] if free[i] and free[j] else (1.0 if i == j else 0.0)
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j and not s > 0.0:
                return False
            L[i, j] = np.sqrt(s) if i == j else s / L[j, j]
    for c in range(X.shape[1]):
        for i in range(n):
            s = X[i, c] if free[i] else 0.0
            for k in range(i):
                s -= L[i, k] * X[k, c]
            X[i, c] = s / L[i, i]
        for i in range(n - 1, -1, -1):
            s = X[i, c]
            for k in range(i + 1, n):
                s -= L[k, i] * X[k, c]
            X[i, c] = s / L[i, i]
    return True


@numba.njit(cache=True)
def box_minimum(H, g, low, high, x, free, move, L):  # type: ignore[no-untyped-def]
    """x = the least ½ xᵀHx + gᵀx within a box, by projected Newton steps (Tassa 2014); which x are free, too."""
    n = len(x)
    for i in range(n):
        x[i] = min(max(0.0, low[i]), high[i])
    for _ in range(50):
        slope = 0.0
        for i in range(n):
            move[i, 0] = g[i]
            for j in range(n):
                move[i, 0] += H[i, j] * x[j]
            at_low, at_high = x[i] <= low[i] and move[i, 0] >= 0, x[i] >= high[i] and move[i, 0] <= 0
            free[i] = not (at_low or at_high)
            slope += move[i, 0] ** 2 if free[i] else 0.0
        if not solve_free(H, free, move, L):
            return False
        if slope < 1e-24:
            break
        size = 1.0
        for _ in range(30):  # until the step, projected onto the box, goes down
            change = 0.0
            for i in range(n):
                L[0, i] = min(max(x[i] - size * move[i, 0], low[i]), high[i]) - x[i]
            for i in range(n):
                change += L[0, i] * g[i]
                for j in range(n):
                    change += L[0, i] * H[i, j] * (x[j] + 0.5 * L[0, j])
            if change < 0.0:
                for i in range(n):
                    x[i] += L[0, i]
                break
            size *= 0.5
        if not change < 0.0:
            break
    return True


@numba.njit(cache=True)
def backward(A, B, gx, Hx, gu, Hu, low, high, mu, k, K):  # type: ignore[no-untyped-def]
    """Riccati's recursion from the end: changes k (T, n), gains K (T, n, 2n); the decrease, NaN if H is indefinite."""
    T, nx, nu = len(A), A.shape[1], B.shape[2]
    g, H, W, HA, HB = gx[T].copy(), Hx[T].copy(), np.empty((nx, nx)), np.empty((nx, nx)), np.empty((nx, nu))
    Hxx, Hux, Huu, firm = np.empty((nx, nx)), np.empty((nu, nx)), np.empty((nu, nu)), np.empty((nu, nu))
    gb, ga, free, move, L = np.empty(nu), np.empty(nx), np.ones(nu, np.bool_), np.empty((nu, 1)), np.empty((nu, nu))
    UK, less = np.empty((nu, nx)), 0.0
    for t in range(T - 1, -1, -1):
        times(H, A[t], HA)
        times(H, B[t], HB)
        Hxx[:], Hux[:], Huu[:], ga[:], gb[:] = Hx[t], 0.0, Hu, gx[t], gu[t]
        add_transposed(A[t], HA, Hxx)
        add_transposed(B[t], HA, Hux)
        add_transposed(B[t], HB, Huu)
        for i in range(nx):
            for j in range(nx):
                ga[j] += A[t, i, j] * g[i]
            for j in range(nu):
                gb[j] += B[t, i, j] * g[i]
        firm[:] = Huu
        for i in range(nu):
            firm[i, i] += mu
        if not box_minimum(firm, gb, low[t], high[t], k[t], free, move, L):
            return np.nan
        K[t] = Hux
        solve_free(firm, free, K[t], L)
        for i in range(nu):
            for j in range(nx):
                K[t, i, j] = -K[t, i, j]
        times(Huu, K[t], UK)  # the value: g = ga + Kᵀ(Huu k + gb) + Huxᵀ k, H = Hxx + Kᵀ Huu K + Kᵀ Hux + Huxᵀ K
        g[:] = ga
        for i in range(nu):
            s = gb[i]
            for j in range(nu):
                s += Huu[i, j] * k[t, j]
            less -= 0.5 * k[t, i] * (s + gb[i])
            for j in range(nx):
                g[j] += K[t, i, j] * s + Hux[i, j] * k[t, i]
        W[:] = 0.0
        for i in range(nu):
            for j in range(nx):
                UK[i, j] = 0.5 * UK[i, j] + Hux[i, j]
        add_transposed(K[t], UK, W)
        for i in range(nx):
            for j in range(nx):
                H[i, j] = 0.5 * (Hxx[i, j] + Hxx[j, i]) + W[i, j] + W[j, i]
    return less


def cost_of(p: Problem, x: Array, u: Array) -> tuple[float, Array, Array]:
    """Cost of a motion x (T + 1, 2 nv) under u (T, nv), and the final cost's gradient and Hessian."""
    e, w, (end, g, H) = x[:-1] - p.goal, u - p.force, p.final(x[-1])
    return 0.5 * p.h * float(((e @ p.Q) * e).sum() + ((w @ p.R) * w).sum()) + end, g, H


def ilqr(p: Problem, u: Array, tolerance: float = 1e-12, most: int = 300) -> tuple[Array, Array, list[float], Array]:
    """States (T + 1, 2 nv), torques (T, nv), costs and gains (T, nv, 2 nv) of a minimum near the torques u."""
    T, n, mu, size = len(u), p.model.nv, 0.0, 1.0
    x, k, K = np.zeros((T + 1, 2 * n)), np.zeros((T, n)), np.zeros((T, n, 2 * n))
    x[0] = np.concatenate([p.q0, p.v0])
    u = np.array(u, float)
    new, forces, limits = x.copy(), u.copy(), (p.low, p.high, p.h)
    forward(p.model.bodies, x, u, k, K, size, *limits, new, forces)
    cost, gx_end, Hx_end = cost_of(p, new, forces)
    costs, Hx = [cost], np.broadcast_to(p.h * p.Q, (T + 1, 2 * n, 2 * n)).copy()
    while len(costs) < most and mu < 1e8:
        if size:  # the last step was taken
            x, u, new, forces = new, forces, x, u
            new[0] = x[0]
            made = sd.step_derivatives(p.model, x[:-1, :n].copy(), x[:-1, n:].copy(), u, p.h, friction=False)
            A, B = map(np.ascontiguousarray, made)
            gx, Hx[T] = np.vstack([p.h * (x[:-1] - p.goal) @ p.Q, gx_end]), Hx_end
            gu = p.h * (u - p.force) @ p.R
        less = backward(A, B, gx, Hx, gu, p.h * p.R, p.low - u, p.high - u, mu, k, K)
        size = 0.0 if np.isnan(less) else 1.0
        while size > 1e-3:
            with suppress(ValueError):  # the kernel's, of a motion that leaves the range of numbers
                forward(p.model.bodies, x, u, k, K, size, *limits, new, forces)
                found, gx_end, Hx_end = cost_of(p, new, forces)
                if cost - found >= 0.1 * size * less - 1e-15 * abs(cost):
                    break
            size *= 0.5
        if size <= 1e-3:
            size, mu = 0.0, max(10.0 * mu, 1e-6)
            continue
        mu = mu / 10.0 if mu > 1e-6 else 0.0
        costs.append(found)
        done, cost = cost - found <= tolerance * abs(found), found
        if done:
            break
    return new, forces, costs, K


def swing_up(limit: float = np.inf, T: int = 100) -> Problem:
    """A cart-pole that hangs at rest and is to stand; its motor drives the cart alone."""
    Q, final, most = np.diag([1.0, 1.0, 0.1, 0.1]), np.diag([100.0, 100.0, 10.0, 10.0]), np.array([limit, 0.0])

    def end(x: Array) -> tuple[float, Array, Array]:
        return 0.5 * float(x @ final @ x), final @ x, final

    none, R = np.zeros(2), 0.01 * np.eye(2)
    return Problem(
        cart_pole(1.0, 0.1, 0.5), np.array([0.0, np.pi]), none, 0.02, np.zeros(4), Q, R, end, none, -most, most
    )


def reach(robot: str = "panda") -> Problem:
    """An arm that is to bring its last link 0.3 m forward and 0.2 m down within 1 s, by two fifths of its torques."""
    model = sd.load_urdf(robot)
    model = model.reduced([j.name for j in model.joints if "finger" in j.name])
    n, q0, link = model.nv, np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.5, 0.7]), "panda_link8"
    there = sd.frame_placement(model, q0, link)[:3, 3] + [0.3, 0.0, -0.2]

    def end(x: Array) -> tuple[float, Array, Array]:
        e = sd.frame_placement(model, x[:n], link)[:3, 3] - there
        J = np.hstack([sd.frame_jacobian(model, x[:n], link, "local_world_aligned")[:3], np.zeros((3, n))])
        rest = np.diag(np.repeat([0.0, 10.0], n))
        return float(5e3 * e @ e + 0.5 * x @ rest @ x), 1e4 * J.T @ e + rest @ x, 1e4 * J.T @ J + rest

    hold, most = sd.generalized_gravity(model, q0), 0.4 * model.effort_limit
    low, high = np.minimum(-most, hold - 1.0), np.maximum(most, hold + 1.0)
    Q = np.diag(np.concatenate([np.zeros(n), np.full(n, 0.1)]))
    return Problem(model, q0, np.zeros(n), 0.01, np.zeros(2 * n), Q, 1e-2 * np.eye(n), end, hold, low, high)


def main(quick: bool = False, save: str | None = None) -> dict[str, Any]:
    """Solve and print; returns {name: (states, torques, costs)}."""
    found: dict[str, Any] = {}
    problems = {"swing-up": (swing_up(), 100), "swing-up, 12 N": (swing_up(12.0, 150), 150)}
    if not quick:
        problems["reach"] = (reach(), 100)
    for name, (p, T) in problems.items():
        began = time.perf_counter()
        x, u, costs, _ = ilqr(p, np.tile(p.force, (T, 1)), 1e-9 if name == "reach" else 1e-12)
        spent = 1e3 * (time.perf_counter() - began) / len(costs)
        print(
            f"{name:15} cost {costs[-1]:.10f} in {len(costs) - 1} iterations, {spent:.2f} ms each, compiling included"
        )
        bound = np.mean((u == p.low) | (u == p.high))
        print(f"{'':15} largest torque {abs(u).max():.4f}, {bound:.0%} of all at a limit")
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
