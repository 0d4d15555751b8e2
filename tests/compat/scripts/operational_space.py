"""Operational-space control of a Panda's hand on a circle, with posture in the null space."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

full = pin.buildModelFromUrdf(str(Path(sys.argv[1]) / "panda_description/urdf/panda.urdf"))
fingers = [full.getJointId("panda_finger_joint1"), full.getJointId("panda_finger_joint2")]
model = pin.buildReducedModel(full, fingers, pin.neutral(full))
data = model.createData()
tool = model.getFrameId("panda_hand")

q = np.array([0.0, -0.4, 0.1, -2.0, 0.1, 1.7, 0.6])
posture, v = q.copy(), np.zeros(model.nv)
pin.framesForwardKinematics(model, data, q)
centre = data.oMf[tool].copy()
dt, log = 2e-3, []
for k in range(200):
    t = k * dt
    angle, rate = 4.0 * t, 4.0
    p_des = centre.translation + 0.05 * np.array([0.0, np.cos(angle) - 1.0, np.sin(angle)])
    v_des = 0.05 * rate * np.array([0.0, -np.sin(angle), np.cos(angle)])
    a_des = -0.05 * rate**2 * np.array([0.0, np.cos(angle), np.sin(angle)])

    pin.computeAllTerms(model, data, q, v)
    pin.updateFramePlacements(model, data)
    M, h = data.M.copy(), data.nle.copy()
    J = pin.getFrameJacobian(model, data, tool, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    dJ = pin.getFrameJacobianTimeVariation(model, data, tool, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    Minv = pin.computeMinverse(model, data, q)
    Lambda = np.linalg.inv(J @ Minv @ J.T)

    pose, twist = data.oMf[tool], J @ v
    rotation_error = pose.rotation @ pin.log3(pose.rotation.T @ centre.rotation)
    acceleration = np.concatenate(
        [
            a_des + 400.0 * (p_des - pose.translation) + 40.0 * (v_des - twist[:3]),
            400.0 * rotation_error - 40.0 * twist[3:],
        ]
    )
    wrench = Lambda @ (acceleration - dJ @ v)
    Jbar = Minv @ J.T @ Lambda
    null = np.eye(model.nv) - J.T @ Jbar.T
    tau = J.T @ wrench + h + null @ (M @ (50.0 * (posture - q) - 10.0 * v))
    v = v + dt * pin.aba(model, data, q, v, tau)
    q = pin.integrate(model, q, dt * v)
    log.append(np.concatenate([p_des - pose.translation, rotation_error]))

results = {"errors": np.array(log), "q": q, "v": v, "Lambda": Lambda, "dJ": dJ, "joints": list(model.names)}
