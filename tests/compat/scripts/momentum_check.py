"""A quadruped in free flight: momentum about its centre of mass stays, whatever the joint torques do."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

filename = Path(sys.argv[1]) / "solo_description/robots/solo12.urdf"
model = pin.buildModelFromUrdf(str(filename), pin.JointModelFreeFlyer())
data = model.createData()
model.gravity.linear = np.zeros(3)

rng = np.random.default_rng(42)
q = pin.neutral(model)
q[7:] = 0.3 * rng.standard_normal(12)
q[3:7] = [0.1, 0.2, 0.3, 0.9]
q = pin.normalize(model, q)
v = 0.5 * rng.standard_normal(model.nv)

dt, momenta, coms = 1e-3, [], []
for k in range(200):
    tau = np.zeros(model.nv)
    tau[6:] = np.sin(10 * k * dt + np.arange(12))
    a = pin.aba(model, data, q, v, tau)
    v = v + a * dt
    q = pin.integrate(model, q, v * dt)
    hg = pin.computeCentroidalMomentum(model, data, q, v)
    momenta.append(hg.vector.copy())
    coms.append(pin.centerOfMass(model, data, q, v).copy())

Ag = pin.ccrba(model, data, q, v).copy()
assert np.allclose(Ag @ v, data.hg.vector)
pin.centerOfMass(model, data, q, v, a)
results = {
    "momenta": np.array(momenta),
    "coms": np.array(coms),
    "Ag": Ag,
    "Ig": data.Ig.inertia,
    "vcom": data.vcom[0].copy(),
    "acom": data.acom[0].copy(),
    "Jcom": pin.jacobianCenterOfMass(model, data, q),
    "mass": pin.computeTotalMass(model),
    "normalized": pin.isNormalized(model, q, 1e-9),
    "dhg": pin.computeCentroidalMomentumTimeVariation(model, data, q, v, a).vector,
}
