"""Cartesian impedance control of a Panda with a null-space posture, pushed at its hand; gravity is switched once."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

model = pin.buildModelFromUrdf(str(Path(sys.argv[1]) / "panda_description/urdf/panda.urdf"))
model.gravity.linear = np.array([0.0, 0.0, -9.81])
data = model.createData()
hand = model.getFrameId("panda_hand")
joint = model.frames[hand].parentJoint
q = np.array([0.0, -0.6, 0.1, -2.2, 0.0, 1.7, 0.8, 0.02, 0.02])
v, q_rest = np.zeros(model.nv), q.copy()
pin.framesForwardKinematics(model, data, q)
goal = data.oMf[hand].copy()
goal.translation += np.array([0.05, -0.03, 0.04])
K, D, dt = np.diag([400.0] * 3 + [30.0] * 3), np.diag([40.0] * 3 + [3.0] * 3), 1e-3
positions, torques = [], []
for k in range(300):
    if k == 150:  # the table is tilted
        model.gravity.linear = np.array([1.0, 0.0, -9.7])
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacement(model, data, hand)
    J = pin.computeFrameJacobian(model, data, q, hand, pin.LOCAL_WORLD_ALIGNED)
    here = data.oMf[hand]
    error = np.hstack([goal.translation - here.translation, here.rotation @ pin.log3(here.rotation.T @ goal.rotation)])
    twist = pin.getFrameVelocity(model, data, hand, pin.LOCAL_WORLD_ALIGNED)
    wrench = K @ error - D @ twist.vector
    Minv = pin.computeMinverse(model, data, q)
    inertia = np.linalg.inv(J @ Minv @ J.T + 1e-9 * np.eye(6))
    N = np.eye(model.nv) - J.T @ inertia @ J @ Minv
    tau = J.T @ wrench + N @ (20.0 * (q_rest - q) - 4.0 * v) + pin.nonLinearEffects(model, data, q, v)
    push = [pin.Force.Zero() for _ in range(model.njoints)]
    if 50 <= k < 120:
        push[joint] = data.oMi[joint].actInv(pin.Force(np.array([5.0, 0.0, -3.0]), np.zeros(3)))
    v = v + dt * pin.aba(model, data, q, v, tau, push)
    q = pin.integrate(model, q, v * dt)
    if k % 15 == 0:
        positions.append(here.translation.copy())
        torques.append(tau)

results = {
    "positions": np.array(positions),
    "torques": np.array(torques),
    "q": q,
    "v": v,
    "gravity": pin.computeGeneralizedGravity(model, data, q),
    "error": float(np.linalg.norm(error)),
}
