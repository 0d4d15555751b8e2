"""A push at a UR5's tool given in the world, as forces in the joints' frames, and what holds the arm against it."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

model = pin.buildModelFromUrdf(str(Path(sys.argv[1]) / "ur_description/urdf/ur5_robot.urdf"))
data = model.createData()
tool = model.getFrameId("tool0")
joint = model.frames[tool].parentJoint
rng = np.random.default_rng(0)

taus, static, accelerations, wrenches = [], [], [], []
for _ in range(20):
    q = rng.uniform(-2.0, 2.0, model.nq)
    v, a = rng.standard_normal(model.nv), rng.standard_normal(model.nv)
    pin.framesForwardKinematics(model, data, q)
    push = pin.Force(np.array([10.0, -5.0, 20.0]), np.array([1.0, 0.0, -2.0]))  # at the tool, in the world's axes
    oMt = data.oMf[tool]
    at_tool = pin.SE3(oMt.rotation.T, np.zeros(3)).act(push)
    in_joint = model.frames[tool].placement.act(at_tool)
    fext = [pin.Force.Zero() for _ in range(model.njoints)]
    fext[joint] = in_joint
    vector = pin.StdVec_Force()
    vector.extend(fext)

    taus.append(pin.rnea(model, data, q, v, a, fext))
    wrenches.append(np.array([f.vector for f in data.f[1:]]) if len(data.f) else np.zeros((0, 6)))
    assert np.allclose(taus[-1], pin.rnea(model, data, q, v, a, vector))
    static.append(pin.computeStaticTorque(model, data, q, fext))
    accelerations.append(pin.aba(model, data, q, v, taus[-1], fext))
    assert np.allclose(accelerations[-1], a)
    J = pin.computeFrameJacobian(model, data, q, tool, pin.LOCAL_WORLD_ALIGNED)
    gravity = pin.computeGeneralizedGravity(model, data, q)
    assert np.allclose(static[-1], gravity - J.T @ push.vector)

results = {"tau": np.array(taus), "static": np.array(static), "ddq": np.array(accelerations), "f": np.array(wrenches)}
