"""A planar arm made by hand, edited in place, copied and pickled: domain randomisation before a rollout."""

import copy
import pickle

import numpy as np
import pinocchio as pin

model = pin.Model()
parent, placement = 0, pin.SE3.Identity()
for k in range(3):
    parent = model.addJoint(parent, pin.JointModelRevoluteUnaligned(0.0, 0.0, 1.0), placement, f"joint{k + 1}")
    body = pin.Inertia.FromCylinder(1.0 + 0.1 * k, 0.05, 0.4)
    model.appendBodyToJoint(parent, body, pin.SE3(pin.utils.rotate("y", np.pi / 2), np.array([0.2, 0.0, 0.0])))
    frame = model.addJointFrame(parent)
    model.addBodyFrame(f"link{k + 1}", parent, pin.SE3.Identity(), frame)
    placement = pin.SE3(np.eye(3), np.array([0.4, 0.0, 0.0]))
model.addFrame(pin.Frame("tip", parent, model.nframes - 1, placement, pin.FrameType.OP_FRAME))
model.gravity.linear = np.array([0.0, -9.81, 0.0])

rng = np.random.default_rng(5)
q, v, tau = np.array([0.3, -0.4, 0.5]), np.array([1.0, 0.0, -1.0]), np.array([0.5, 0.2, 0.1])
nominal = pin.aba(model, model.createData(), q, v, tau)

rollouts, masses = [], []
for _ in range(5):
    sample = model.copy()
    for k in range(1, sample.njoints):
        sample.inertias[k].mass *= rng.uniform(0.8, 1.2)
        sample.inertias[k].lever += rng.uniform(-0.02, 0.02, 3)
        sample.jointPlacements[k].translation[0] *= rng.uniform(0.95, 1.05)
    sample.armature[:] = rng.uniform(0.0, 0.05, 3)
    data = sample.createData()
    x, dx = q.copy(), v.copy()
    for _ in range(40):
        dx += 0.01 * pin.aba(sample, data, x, dx, tau)
        x = pin.integrate(sample, x, 0.01 * dx)
    rollouts.append(np.concatenate([x, dx]))
    masses.append(pin.computeTotalMass(sample))

again = pickle.loads(pickle.dumps(model))
assert again == model
assert copy.deepcopy(model) == model
pin.framesForwardKinematics(again, data := again.createData(), q)
results = {
    "nominal": nominal,
    "again": pin.aba(again, data, q, v, tau),
    "rollouts": np.array(rollouts),
    "masses": np.array(masses),
    "tip": data.oMf[again.getFrameId("tip")].homogeneous,
    "parents": [int(p) for p in model.parents],
    "frames": [(f.name, int(f.parentJoint), f.type.name) for f in model.frames],
    "sizes": [model.nq, model.nv, model.njoints, model.nframes],
}
