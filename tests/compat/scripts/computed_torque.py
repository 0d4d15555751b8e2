"""Computed torque control of a Panda along sines, with M and h from CRBA and RNEA."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

urdf = Path(sys.argv[1]) / "panda_description" / "urdf" / "panda.urdf"
model = pin.buildModelFromUrdf(urdf)
data = pin.Data(model)
nq, nv = model.nq, model.nv

amplitude, frequency = 0.3, 2 * np.pi * 0.5
q0 = np.array([0.0, -0.5, 0.0, -1.8, 0.0, 1.4, 0.3, 0.02, 0.02])
kp, kd = 400.0, 40.0


def desired(t):
    s, c = np.sin(frequency * t), np.cos(frequency * t)
    return q0 + amplitude * s, amplitude * frequency * c * np.ones(nv), -amplitude * frequency**2 * s * np.ones(nv)


q, v, dt = q0 + 0.02, np.zeros(nv), 2e-3
errors, torques = [], []
for k in range(250):
    qd, vd, ad = desired(k * dt)
    M = pin.crba(model, data, q)
    h = pin.nonLinearEffects(model, data, q, v)
    assert np.allclose(M, M.T)
    tau = M @ (ad + kp * (qd - q) + kd * (vd - v)) + h
    a = np.linalg.solve(M, tau - pin.nle(model, data, q, v))
    v = v + a * dt
    q = pin.integrate(model, q, v * dt)
    errors.append(qd - q)
    torques.append(tau)

np.testing.assert_allclose(data.nle, h, atol=1e-10)
results = {"errors": np.array(errors), "tau": np.array(torques[::10]), "M": data.M.copy(), "q": q, "v": v}
