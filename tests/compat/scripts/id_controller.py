"""A task-space inverse dynamics controller of a quadruped on point feet: contacts, accelerations, torques, forces."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

robot = pin.RobotWrapper(
    pin.buildModelFromUrdf(str(Path(sys.argv[1]) / "solo_description/robots/solo12.urdf"), pin.JointModelFreeFlyer())
)
model, data = robot.model, robot.data
feet = [model.getFrameId(f"{leg}_FOOT") for leg in ("FL", "FR", "HL", "HR")]
q = robot.q0.copy()
q[2] = 0.24
q[7:] = np.tile([0.0, 0.7, -1.4], 4)
v = np.zeros(model.nv)
S = np.vstack([np.zeros((6, model.nv - 6)), np.eye(model.nv - 6)])
com_goal = robot.com(q).copy() + np.array([0.01, 0.0, -0.02])
kp, kd, dt = 60.0, 15.0, 2e-3
log = {"com": [], "tau": [], "forces": []}
for k in range(100):
    pin.computeAllTerms(model, data, q, v)
    pin.updateFramePlacements(model, data)
    J = np.vstack([pin.getFrameJacobian(model, data, i, pin.LOCAL_WORLD_ALIGNED)[:3] for i in feet])
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    drift = np.hstack([pin.getFrameClassicalAcceleration(model, data, i, pin.LOCAL_WORLD_ALIGNED).linear for i in feet])
    a_com = kp * (com_goal - robot.com(q, v)[0]) - kd * robot.vcom(q, v)
    momentum = robot.centroidalMomentum(q, v)
    # least squares for accelerations under contacts, then torques and forces that give them
    Jcom = robot.Jcom(q)
    rows = np.vstack([J, Jcom, 0.1 * S.T])
    goal = np.hstack([-drift, a_com, 0.1 * (-20.0 * v[6:])])
    a = np.linalg.lstsq(rows, goal, rcond=None)[0]
    h = pin.nonLinearEffects(model, data, q, v)
    M = pin.crba(model, data, q)
    x = np.linalg.lstsq(np.hstack([S, J.T]), M @ a + h, rcond=None)[0]
    tau, forces = x[: model.nv - 6], x[model.nv - 6 :]
    f = [pin.Force.Zero() for _ in range(model.njoints)]
    for n, i in enumerate(feet):
        frame = model.frames[i]
        X = pin.SE3(data.oMf[i].rotation, data.oMf[i].translation)
        local = pin.Force(X.rotation.T @ forces[3 * n : 3 * n + 3], np.zeros(3))
        f[frame.parentJoint] = f[frame.parentJoint] + frame.placement.act(local)
    v = v + dt * pin.aba(model, data, q, v, S @ tau, f)
    q = pin.integrate(model, q, v * dt)
    if k % 10 == 0:
        log["com"].append(robot.com(q).copy())
        log["tau"].append(tau)
        log["forces"].append(forces)

results = {**{name: np.array(x) for name, x in log.items()}, "q": q, "v": v, "momentum": momentum.vector.copy()}
