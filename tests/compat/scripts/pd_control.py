"""PD control with gravity compensation of a UR5, simulated with the articulated body algorithm."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

model = pin.buildModelFromUrdf(str(Path(sys.argv[1]) / "ur_description/urdf/ur5_robot.urdf"))
data = model.createData()

kp = np.diag([100.0, 100.0, 80.0, 20.0, 10.0, 5.0])
kd = 0.3 * kp
q_des = np.array([0.5, -1.2, 1.0, 0.3, -0.4, 0.2])
dt = 1e-3

q = pin.neutral(model)
v = np.zeros(model.nv)
qs, taus = [], []
for k in range(400):
    tau = kp @ pin.difference(model, q, q_des) - kd @ v + pin.computeGeneralizedGravity(model, data, q)
    tau = np.clip(tau, -model.effortLimit, model.effortLimit)
    a = pin.aba(model, data, q, v, tau)
    v += a * dt
    q = pin.integrate(model, q, v * dt)
    if k % 20 == 0:
        qs.append(q.copy())
        taus.append(tau.copy())

results = {
    "q": np.array(qs),
    "tau": np.array(taus),
    "v": v,
    "ddq": data.ddq.copy(),
    "names": list(model.names),
    "limits": np.vstack([model.lowerPositionLimit, model.upperPositionLimit, model.velocityLimit]),
}
