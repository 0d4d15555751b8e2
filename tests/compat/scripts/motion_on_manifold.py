"""Steps, means and splines of a floating robot's configurations, and of a frame's poses."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

model = pin.buildModelFromUrdf(
    str(Path(sys.argv[1]) / "anymal_b_simple_description/robots/anymal.urdf"), pin.JointModelFreeFlyer()
)
data = model.createData()
rng = np.random.default_rng(11)
start = pin.neutral(model)
configurations = [pin.integrate(model, start, 0.4 * rng.standard_normal(model.nv)) for _ in range(6)]

# the mean, by Gauss-Newton on the group
mean = configurations[0].copy()
for _ in range(20):
    step = np.mean([pin.difference(model, mean, q) for q in configurations], axis=0)
    mean = pin.integrate(model, mean, step)
    if np.linalg.norm(step) < 1e-12:
        break

path = [pin.interpolate(model, configurations[0], configurations[1], s) for s in np.linspace(0.0, 1.0, 11)]
J0, J1 = pin.dDifference(model, configurations[0], configurations[1])
Jq = pin.dIntegrate(model, start, 0.1 * np.ones(model.nv), pin.ArgumentPosition.ARG0)

A, B = pin.SE3(pin.Quaternion(0.8, 0.6, 0.0, 0.0), np.array([1.0, 2.0, 3.0])), pin.SE3.Identity()
poses = [(A * pin.exp6(s * pin.log6(A.inverse() * B))).homogeneous for s in np.linspace(0.0, 1.0, 7)]
turns = [pin.Quaternion(A.rotation).slerp(s, pin.Quaternion.Identity()).coeffs() for s in np.linspace(0.0, 1.0, 5)]
results = {
    "mean": mean,
    "path": np.array(path),
    "J0": J0,
    "J1": J1,
    "Jq": Jq,
    "poses": np.array(poses),
    "turns": np.array(turns),
    "distance": pin.distance(model, configurations[0], mean),
    "same": pin.isSameConfiguration(model, path[0], configurations[0], 1e-9),
    "blocks": [(int(i), int(n)) for i, n in zip(model.idx_vs, model.nvs, strict=True)],
    "roll": pin.rpy.matrixToRpy(A.rotation),
}
