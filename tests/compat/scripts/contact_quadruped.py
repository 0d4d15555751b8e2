"""A quadruped that stands: forward dynamics with its four feet held, by stacked frame Jacobians."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

model = pin.buildModelFromUrdf(
    str(Path(sys.argv[1]) / "solo_description" / "robots" / "solo12.urdf"), pin.JointModelFreeFlyer()
)
data = model.createData()
feet = [model.getFrameId(f"{leg}_FOOT") for leg in ("FL", "FR", "HL", "HR")]

q0 = pin.neutral(model)
q0[2] = 0.25
q0[7:] = np.array([0.1, 0.8, -1.6, -0.1, 0.8, -1.6, 0.1, -0.8, 1.6, -0.1, -0.8, 1.6])
q, v = q0.copy(), np.zeros(model.nv)
q[7:] += 0.02
rate, dt = 50.0, 1e-3

forces, heights, accelerations = [], [], []
pin.framesForwardKinematics(model, data, q)
anchors = [data.oMf[f].translation.copy() for f in feet]
for _ in range(150):
    pin.forwardKinematics(model, data, q, v, 0 * v)
    pin.updateFramePlacements(model, data)
    pin.computeJointJacobians(model, data, q)
    J, drift = [], []
    for f, anchor in zip(feet, anchors, strict=True):
        J.append(pin.getFrameJacobian(model, data, f, pin.LOCAL_WORLD_ALIGNED)[:3])
        acceleration = pin.getFrameClassicalAcceleration(model, data, f, pin.LOCAL_WORLD_ALIGNED).linear
        velocity = pin.getFrameVelocity(model, data, f, pin.LOCAL_WORLD_ALIGNED).linear
        position = data.oMf[f].translation - anchor
        drift.append(acceleration + 2 * rate * velocity + rate**2 * position)
    J, gamma = np.vstack(J), np.concatenate(drift)
    tau = np.zeros(model.nv)
    tau[6:] = 5.0 * (q0[7:] - q[7:]) - 0.2 * v[6:]
    a = pin.forwardDynamics(model, data, q, v, tau, J, gamma, 1e-10)
    forces.append(data.lambda_c.copy())
    v = v + dt * a
    q = pin.integrate(model, q, dt * v)
    heights.append(q[2])
    accelerations.append(a.copy())

after = pin.impulseDynamics(model, data, q, v, J, 0.0, 1e-10)
M = np.triu(data.M) + np.triu(data.M, 1).T  # the upper triangle is what is filled here
results = {
    "forces": np.array(forces[::5]),
    "heights": np.array(heights),
    "accelerations": np.array(accelerations[::10]),
    "residual": M @ a + data.nle - tau,
    "after": after,
    "q": q,
}
