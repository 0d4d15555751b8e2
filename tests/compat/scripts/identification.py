"""Identification of a UR5's inertial parameters from torques along random motions, with the torque regressor."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

model = pin.buildModelFromUrdf(str(Path(sys.argv[1]) / "ur_description/urdf/ur5_robot.urdf"))
data = model.createData()
rng = np.random.default_rng(3)

truth = np.concatenate([model.inertias[i].toDynamicParameters() for i in range(1, model.njoints)])
rows, torques = [], []
for _ in range(60):
    q, v, a = rng.uniform(-2, 2, model.nq), rng.standard_normal(model.nv), 3 * rng.standard_normal(model.nv)
    rows.append(pin.computeJointTorqueRegressor(model, data, q, v, a).copy())
    torques.append(pin.rnea(model, data, q, v, a))
W, tau = np.vstack(rows), np.concatenate(torques)

residual = W @ truth - tau
rank = np.linalg.matrix_rank(W, tol=1e-8)
estimate = np.linalg.pinv(W, rcond=1e-10) @ tau

# the estimated base parameters predict motions never seen
predicted, measured = [], []
for _ in range(5):
    q, v, a = rng.uniform(-2, 2, model.nq), rng.standard_normal(model.nv), rng.standard_normal(model.nv)
    predicted.append(pin.computeJointTorqueRegressor(model, data, q, v, a) @ estimate)
    measured.append(pin.rnea(model, data, q, v, a))

body = pin.Inertia.FromDynamicParameters(truth[10:20])
results = {
    "W": W[:12],
    "rank": int(rank),
    "residual": residual,
    "prediction": np.array(predicted),
    "error": np.array(predicted) - np.array(measured),
    "pseudo": body.toPseudoInertia().toMatrix(),
    "body": body.matrix(),
}
