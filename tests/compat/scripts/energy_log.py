"""Energies of a double pendulum that swings freely, logged along the way."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

model = pin.buildModelFromUrdf(str(Path(sys.argv[1]) / "double_pendulum_description/urdf/double_pendulum.urdf"))
data = model.createData()
q, v = pin.neutral(model), np.zeros(model.nv)
q = pin.integrate(model, q, np.array([1.0, -0.5]))

kinetic, potential, mechanical, powers = [], [], [], []
dt = 2e-3
for _ in range(500):
    tau = -0.01 * v
    a1 = pin.aba(model, data, q, v, tau)
    q2, v2 = pin.integrate(model, q, 0.5 * dt * v), v + 0.5 * dt * a1
    a2 = pin.aba(model, data, q2, v2, tau)
    q, v = pin.integrate(model, q, dt * v2), v + dt * a2
    kinetic.append(pin.computeKineticEnergy(model, data, q, v))
    potential.append(pin.computePotentialEnergy(model, data, q))
    mechanical.append(pin.computeMechanicalEnergy(model, data, q, v))
    powers.append(tau @ v)
    assert data.kinetic_energy == kinetic[-1]

C = pin.computeCoriolisMatrix(model, data, q, v)
g = pin.computeGeneralizedGravity(model, data, q)
results = {
    "kinetic": np.array(kinetic),
    "potential": np.array(potential),
    "mechanical": np.array(mechanical),
    "dissipated": np.cumsum(powers) * dt,
    "bias": C @ v + g - pin.nle(model, data, q, v),
    "C": C,
}
