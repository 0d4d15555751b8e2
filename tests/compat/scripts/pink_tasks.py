"""Differential inverse kinematics in the manner of pink: weighted frame and posture tasks with Levenberg damping."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin


class Configuration:
    """A model at a configuration, with its frames placed and its Jacobians computed."""

    def __init__(self, model, data, q):
        self.model, self.data, self.q = model, data, q.copy()
        self.update(q)

    def update(self, q):
        self.q = q.copy()
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)

    def placement(self, frame):
        return self.data.oMf[self.model.getFrameId(frame)].copy()

    def jacobian(self, frame):
        return pin.getFrameJacobian(self.model, self.data, self.model.getFrameId(frame), pin.ReferenceFrame.LOCAL)

    def integrated(self, v, dt):
        return pin.integrate(self.model, self.q, v * dt)


class FrameTask:
    def __init__(self, frame, position_cost, orientation_cost, gain=0.6, damping=1e-3):
        self.frame, self.gain, self.damping = frame, gain, damping
        self.cost = np.array([position_cost] * 3 + [orientation_cost] * 3)

    def error_and_jacobian(self, configuration):
        there = configuration.placement(self.frame)
        difference = self.target.actInv(there)
        return pin.log6(difference).vector, pin.Jlog6(difference) @ configuration.jacobian(self.frame)

    def objective(self, configuration):
        e, J = self.error_and_jacobian(configuration)
        W, mu = np.diag(self.cost**2), self.damping * e @ e
        return J.T @ W @ J + mu * np.eye(J.shape[1]), self.gain * (e @ W @ J)


class PostureTask:
    def __init__(self, cost, target):
        self.cost, self.target = cost, target

    def objective(self, configuration):
        e = pin.difference(configuration.model, self.target, configuration.q)
        return self.cost**2 * np.eye(len(e)), 0.1 * self.cost**2 * e


model = pin.buildModelFromUrdf(str(Path(sys.argv[1]) / "ur_description/urdf/ur5_robot.urdf"))
data = model.createData()
q0 = np.array([0.3, -1.1, 1.4, -0.6, 0.5, 0.2])
configuration = Configuration(model, data, q0)
tool = FrameTask("tool0", 1.0, 0.75)
tool.target = configuration.placement("tool0") * pin.SE3(
    pin.rpy.rpyToMatrix(0.2, -0.1, 0.3), np.array([0.05, 0.1, -0.08])
)
tasks, dt, errors = [tool, PostureTask(1e-2, q0)], 0.05, []
for _ in range(60):
    H, c = np.zeros((model.nv, model.nv)), np.zeros(model.nv)
    for task in tasks:
        P, g = task.objective(configuration)
        H, c = H + P, c + g
    v = -np.linalg.solve(H, c) / dt
    v = np.clip(v, -model.velocityLimit, model.velocityLimit)
    configuration.update(configuration.integrated(v, dt))
    errors.append(np.linalg.norm(tool.error_and_jacobian(configuration)[0]))

results = {
    "q": configuration.q,
    "errors": np.array(errors),
    "tool": configuration.placement("tool0").homogeneous,
    "manipulability": float(
        np.sqrt(np.linalg.det(configuration.jacobian("tool0") @ configuration.jacobian("tool0").T))
    ),
    "within": bool(
        (model.lowerPositionLimit <= configuration.q).all() and (configuration.q <= model.upperPositionLimit).all()
    ),
}
