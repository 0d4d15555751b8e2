"""A Kalman-style filter on a floating base: Jacobians of the process and of measurements by differences over q."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

model = pin.buildModelFromUrdf(
    str(Path(sys.argv[1]) / "solo_description/robots/solo12.urdf"), pin.JointModelFreeFlyer()
)
data = model.createData()
feet = [model.getFrameId(f"{leg}_FOOT") for leg in ("FL", "FR", "HL", "HR")]
rng = np.random.default_rng(4)
nv, dt = model.nv, 0.01


def measured(q):
    """Feet from the base, and the base's upright direction."""
    pin.framesForwardKinematics(model, data, q)
    base = data.oMi[1]
    return np.hstack(
        [*(base.actInv(data.oMf[i].translation) for i in feet), base.rotation.T @ np.array([0.0, 0.0, 1.0])]
    )


def differences(f, q, eps=1e-4):
    return np.array(
        [(f(pin.integrate(model, q, eps * e)) - f(pin.integrate(model, q, -eps * e))) / (2 * eps) for e in np.eye(nv)]
    ).T


q = pin.neutral(model)
q[7:] = np.tile([0.0, 0.7, -1.4], 4)
estimate = pin.integrate(model, q, 0.05 * rng.normal(size=nv))
P, Q, R = 0.01 * np.eye(nv), 1e-5 * np.eye(nv), 1e-4 * np.eye(15)
errors, traces = [], []
for k in range(12):
    v = 0.5 * np.sin(0.3 * k + np.arange(nv))
    F, G = pin.dIntegrate(model, estimate, v * dt)
    q, estimate = pin.integrate(model, q, v * dt), pin.integrate(model, estimate, v * dt)
    P = F @ P @ F.T + G @ Q @ G.T
    z = measured(q) + 0.01 * rng.normal(size=15)
    H = differences(measured, estimate)
    gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    estimate = pin.integrate(model, estimate, gain @ (z - measured(estimate)))
    P = (np.eye(nv) - gain @ H) @ P
    errors.append(pin.difference(model, q, estimate))
    traces.append(np.trace(P))

estimate = pin.normalize(model, estimate)
results = {
    "estimate": estimate,
    "errors": np.array(errors),
    "traces": np.array(traces),
    "same": pin.isSameConfiguration(model, estimate, q, 1e-3),
    "middle": pin.interpolate(model, q, estimate, 0.5),
    "distance": float(pin.distance(model, q, estimate)),
}
