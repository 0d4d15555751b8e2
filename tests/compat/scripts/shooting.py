"""One sweep of an iterative LQR for a UR5: rollout, derivatives of each step, gains backwards."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

model = pin.buildModelFromUrdf(str(Path(sys.argv[1]) / "ur_description/urdf/ur5_robot.urdf"))
data = model.createData()
n, dt, steps = model.nv, 0.01, 25
goal = np.array([0.4, -1.0, 0.8, -0.2, 0.1, 0.0])
R, Q, final = 1e-2 * np.eye(n), np.diag([1e-2] * n + [1e-3] * n), np.diag([1e2] * n + [1.0] * n)


def step(x, u):
    a = pin.aba(model, data, x[:n], x[n:], u)
    v = x[n:] + dt * a
    return np.concatenate([pin.integrate(model, x[:n], dt * v), v])


def linearised(x, u):
    da_dq, da_dv, da_du = pin.computeABADerivatives(model, data, x[:n], x[n:], u)
    Fv = np.hstack([dt * da_dq, np.eye(n) + dt * da_dv])
    Fq = np.hstack([np.eye(n), np.zeros((n, n))]) + dt * Fv
    return np.vstack([Fq, Fv]), np.vstack([dt * dt * da_du, dt * da_du])


def rollout(us, gains=None, xs_ref=None):
    x, xs = np.concatenate([pin.neutral(model), np.zeros(n)]), []
    cost = 0.0
    for k, u in enumerate(us):
        if gains is not None:
            u = u + gains[k][0] + gains[k][1] @ (x - xs_ref[k])
        xs.append(x)
        e = x - np.concatenate([goal, np.zeros(n)])
        cost += 0.5 * e @ Q @ e + 0.5 * u @ R @ u
        x = step(x, u)
    e = x - np.concatenate([goal, np.zeros(n)])
    return [*xs, x], cost + 0.5 * e @ final @ e


us = [pin.rnea(model, data, pin.neutral(model), np.zeros(n), np.zeros(n))] * steps
xs, before = rollout(us)
target = np.concatenate([goal, np.zeros(n)])
Vx, Vxx, gains = final @ (xs[-1] - target), final, []
for k in reversed(range(steps)):
    A, B = linearised(xs[k], us[k])
    Qx, Qu = Q @ (xs[k] - target) + A.T @ Vx, R @ us[k] + B.T @ Vx
    Qxx, Quu, Qux = Q + A.T @ Vxx @ A, R + B.T @ Vxx @ B, B.T @ Vxx @ A
    d, K = -np.linalg.solve(Quu, Qu), -np.linalg.solve(Quu, Qux)
    Vx, Vxx = Qx + Qux.T @ d, Qxx + Qux.T @ K
    gains.append((0.5 * d, K))
gains.reverse()
xs, after = rollout(us, gains, xs)
assert after < before
results = {"before": before, "after": after, "x": np.array(xs), "K": gains[0][1], "A": A, "B": B}
