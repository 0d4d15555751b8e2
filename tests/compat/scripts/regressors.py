"""A regressor study: which parameters of a robot can be identified, by torques, energies, momenta and placements."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

model = pin.buildModelFromUrdf(str(Path(sys.argv[1]) / "ur_description/urdf/ur5_robot.urdf"))
data = model.createData()
rng = np.random.default_rng(7)
pi = np.hstack([model.inertias[k].toDynamicParameters() for k in range(1, model.njoints)])
rows, torques, sizes = [], [], []
for _ in range(40):
    q, v, a = rng.uniform(-2.0, 2.0, model.nq), rng.normal(size=model.nv), rng.normal(size=model.nv)
    Y = pin.computeJointTorqueRegressor(model, data, q, v, a)
    rows.append(Y)
    torques.append(pin.rnea(model, data, q, v, a))
    sizes.append(abs(Y @ pi - torques[-1]).max())
W, tau = np.vstack(rows), np.hstack(torques)
singular = np.linalg.svd(W, compute_uv=False)
rank = int((singular > 1e-9 * singular[0]).sum())
found = np.linalg.lstsq(W, tau, rcond=1e-9)[0]

bodies = []
pin.rnea(model, data, q, v, a)
for k in range(1, model.njoints):
    Y = pin.bodyRegressor(data.v[k], data.a_gf[k])
    f = model.inertias[k] * data.a_gf[k] + data.v[k].cross(model.inertias[k] * data.v[k])
    bodies.append(abs(Y @ model.inertias[k].toDynamicParameters() - f.vector).max())
tool = model.getFrameId("tool0")
kinetic = pin.computeKineticEnergyRegressor(model, data, q, v)
potential = pin.computePotentialEnergyRegressor(model, data, q)
static = pin.computeStaticRegressor(model, data, q)

# placements of the joints, as a calibration from poses of the tool would find them
pin.framesForwardKinematics(model, data, q)
K = [
    pin.computeFrameKinematicRegressor(model, data, tool, at) for at in (pin.LOCAL, pin.WORLD, pin.LOCAL_WORLD_ALIGNED)
]
Kj = pin.computeJointKinematicRegressor(
    model, data, model.njoints - 1, pin.LOCAL, pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.2]))
)

results = {
    "rank": rank, "singular": singular[:rank], "fits": bool(np.allclose(W @ found, tau, atol=1e-8)),
    "small": bool(max(sizes) < 1e-10 and max(bodies) < 1e-10), "Y": rows[0],
    "frame": pin.frameBodyRegressor(model, data, tool),
    "joint": pin.jointBodyRegressor(model, data, 3), "kinetic": np.ravel(kinetic), "potential": np.ravel(potential),
    "static": static, "local": K[0], "world": K[1], "aligned": K[2], "placed": Kj,
    "energy": pin.computeKineticEnergy(model, data, q, v), "parameters": pi,
}  # fmt: skip
