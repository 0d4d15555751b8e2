"""Closed-loop inverse kinematics of a Panda's hand: damped least squares on the logarithm of the error."""

import sys
from pathlib import Path

import numpy as np
import pinocchio
from numpy.linalg import norm, solve

model = pinocchio.buildModelFromUrdf(str(Path(sys.argv[1]) / "panda_description/urdf/panda.urdf"))
data = model.createData()

FRAME = model.getFrameId("panda_link8")
R_des = pinocchio.utils.rotate("x", np.pi) @ pinocchio.rpy.rpyToMatrix(0.0, 0.2, 0.4)
oMdes = pinocchio.SE3(R_des, np.array([0.4, 0.2, 0.5]))

q = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.7, 0.0, 0.0])
eps, DT, damp = 1e-8, 0.5, 1e-8
norms = []
i = 0
while True:
    pinocchio.framesForwardKinematics(model, data, q)
    fMd = data.oMf[FRAME].actInv(oMdes)
    err = pinocchio.log6(fMd).vector
    norms.append(norm(err))
    if norm(err) < eps:
        success = True
        break
    if i >= 200:
        success = False
        break
    J = pinocchio.computeFrameJacobian(model, data, q, FRAME)  # in the local frame
    J = -np.dot(pinocchio.Jlog6(fMd.inverse()), J)
    v = -J.T.dot(solve(J.dot(J.T) + damp * np.eye(6), err))
    q = pinocchio.integrate(model, q, v * DT)
    i += 1

elbow = model.getJointId("panda_joint4")
pinocchio.computeJointJacobians(model, data, q)
results = {
    "success": success,
    "q": q,
    "iterations": i,
    "norms": np.array(norms),
    "pose": data.oMf[FRAME].homogeneous,
    "xyzquat": pinocchio.SE3ToXYZQUAT(data.oMf[FRAME]),
    "elbow": pinocchio.getJointJacobian(model, data, elbow, pinocchio.ReferenceFrame.WORLD),
    "frames": [f.name for f in model.frames],
}
