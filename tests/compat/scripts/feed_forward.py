"""A RobotWrapper that follows a minimum-jerk trajectory by feed-forward torques, with a payload it does not know of."""

import sys
from os.path import dirname, join

import numpy as np
import pinocchio as pin
from pinocchio.robot_wrapper import RobotWrapper

robots = sys.argv[1]
robot = RobotWrapper.BuildFromURDF(join(robots, "ur_description/urdf/ur5_robot.urdf"), [dirname(dirname(robots))])
true_model = robot.model.copy()
true_data = true_model.createData()
wrist = true_model.getJointId("wrist_3_joint")
true_model.inertias[wrist] = true_model.inertias[wrist] + pin.Inertia.FromSphere(0.5, 0.05)

start = robot.q0.copy()
goal = np.array([0.8, -1.0, 1.2, -0.5, 0.4, 0.3])
T, dt = 1.0, 2.5e-3


def minimum_jerk(t):
    s = min(t / T, 1.0)
    x = 10 * s**3 - 15 * s**4 + 6 * s**5
    dx = (30 * s**2 - 60 * s**3 + 30 * s**4) / T
    ddx = (60 * s - 180 * s**2 + 120 * s**3) / T**2
    return start + (goal - start) * x, (goal - start) * dx, (goal - start) * ddx


stiffness = 400.0 * np.diag(robot.mass(start))
damping = 40.0 * np.diag(robot.mass(start))
q, v = start.copy(), np.zeros(robot.nv)
log = {"q": [], "feedforward": [], "tool": []}
tool = robot.model.getFrameId("tool0")
for k in range(int(T / dt)):
    qr, vr, ar = minimum_jerk(k * dt)
    feedforward = pin.rnea(robot.model, robot.data, qr, vr, ar)
    tau = feedforward + stiffness * (qr - q) + damping * (vr - v)
    a = pin.aba(true_model, true_data, q, v, tau)
    v = v + dt * a
    q = pin.integrate(true_model, q, dt * v)
    log["q"].append(q)
    log["feedforward"].append(feedforward)
    log["tool"].append(robot.framePlacement(q, tool).translation.copy())

results = {key: np.array(value[::8]) for key, value in log.items()}
assert np.abs(goal - q).max() < 0.5
results["mass"] = robot.mass(q)
results["nle"] = robot.nle(q, v)
results["gravity"] = robot.gravity(q)
results["com"] = robot.com(q)
results["placement"] = robot.placement(q, wrist).homogeneous
results["velocity"] = robot.velocity(q, v, wrist).vector
results["jacobian"] = robot.computeFrameJacobian(q, tool)
