"""The problems of optimal control of the examples: a cart-pole that swings up, and a Panda that reaches for a point."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.cart_pole_lqr import cart_pole

Array = np.ndarray


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


def cost_of(p: Problem, x: Array, u: Array) -> tuple[float, Array, Array, tuple[Array, Array]]:
    """Cost of a motion x (T + 1, 2 nv) under u (T, nv), its slopes and Hessian by (x, u), and those of the last x."""
    n = x.shape[1]
    z, W = np.hstack([x[:-1] - p.goal, u - p.force]), np.zeros((n + u.shape[1], n + u.shape[1]))
    W[:n, :n], W[n:, n:] = p.h * p.Q, p.h * p.R
    slope, (end, *last) = z @ W, p.final(x[-1])
    return 0.5 * float((z * slope).sum()) + end, slope, W, (last[0], last[1])


def swing_up(limit: float = np.inf) -> Problem:
    """A cart-pole that hangs at rest and is to stand; its motor drives the cart alone."""
    Q, final, most = np.diag([1.0, 1.0, 0.1, 0.1]), np.diag([100.0, 100.0, 10.0, 10.0]), np.array([limit, 0.0])

    def end(x: Array) -> tuple[float, Array, Array]:
        return 0.5 * float(x @ final @ x), final @ x, final

    none, R = np.zeros(2), 0.01 * np.eye(2)
    return Problem(
        cart_pole(1.0, 0.1, 0.5), np.array([0.0, np.pi]), none, 0.02, np.zeros(4), Q, R, end, none, -most, most
    )


def reach(panda: sd.Model) -> Problem:
    """An arm that is to bring its last link 0.3 m forward and 0.2 m down within 1 s, by two fifths of its torques."""
    model = panda.reduced([j.name for j in panda.joints if "finger" in j.name])
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
