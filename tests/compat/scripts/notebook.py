"""A teaching notebook: a planar arm built joint by joint, looked at, moved, drawn if there is a viewer."""

import numpy as np
import pinocchio as pin

model = pin.Model()
model.name = "arm"
lengths, parent, placement = (0.5, 0.4, 0.2), 0, pin.SE3.Identity()
for k, length in enumerate(lengths):
    parent = model.addJoint(parent, pin.JointModelRY(), placement, f"joint{k}")
    body = pin.Inertia.FromCylinder(1.0 + k, 0.03, length)
    model.appendBodyToJoint(parent, body, pin.SE3(np.eye(3), np.array([0.0, 0.0, length / 2])))
    model.addJointFrame(parent)
    placement = pin.SE3(np.eye(3), np.array([0.0, 0.0, length]))
tip = model.addFrame(pin.Frame("tip", parent, 0, placement, pin.FrameType.OP_FRAME))
model.lowerPositionLimit, model.upperPositionLimit = -np.ones(3), np.ones(3)
data = model.createData()
seen = [
    f"{name}: {joint.shortname()} nq {joint.nq} nv {joint.nv}"
    for name, joint in zip(model.names, model.joints, strict=True)
]
masses = [inertia.mass for inertia in model.inertias]

# a first look
q = np.array([0.3, -0.5, 0.8])
pin.forwardKinematics(model, data, q)
pin.updateFramePlacements(model, data)
places = [np.array(M.translation) for M in data.oMi]
angles = [pin.rpy.matrixToRpy(M.rotation) for M in data.oMi]

# the Jacobian, by hand and by the library
hand = data.oMf[tip].translation.copy()
by_hand = []
for k in range(model.nv):
    step = np.zeros(model.nv)
    step[k] = 1e-6
    pin.framesForwardKinematics(model, data, pin.integrate(model, q, step))
    by_hand.append((data.oMf[tip].translation - hand) / 1e-6)
J = pin.computeFrameJacobian(model, data, q, tip, pin.LOCAL_WORLD_ALIGNED)
agree = bool(np.allclose(np.array(by_hand).T, J[:3], atol=1e-5))

# the equation of motion, term by term
v, a = np.array([0.1, -0.2, 0.3]), np.array([1.0, 0.0, -1.0])
M, h, g = pin.crba(model, data, q), pin.nle(model, data, q, v), pin.computeGeneralizedGravity(model, data, q)
C = pin.computeCoriolisMatrix(model, data, q, v)
tau = pin.rnea(model, data, q, v, a)
balance = float(abs(M @ a + C @ v + g - tau).max())
energy = pin.computeMechanicalEnergy(model, data, q, v)

# a pendulum that swings, and a picture of it where there is a viewer
robot = pin.RobotWrapper(model)
try:
    robot.setVisualizer(pin.visualize.BaseVisualizer(model, None, None))
    robot.display(q)
    drawn = True
except Exception:
    drawn = False
trajectory, x, w = [], q.copy(), np.zeros(3)
for _ in range(200):
    w = w + 5e-3 * pin.aba(model, data, x, w, -0.05 * w)
    x = pin.integrate(model, x, 5e-3 * w)
    trajectory.append(x)

results = {
    "seen": seen, "masses": np.array(masses), "places": np.array(places), "angles": np.array(angles), "J": J,
    "agree": agree, "M": M, "h": h, "g": g, "C": C, "tau": tau, "small": balance < 1e-12, "energy": energy,
    "trajectory": np.array(trajectory), "mass": pin.computeTotalMass(model), "com": pin.centerOfMass(model, data, q),
    "M in data": np.array(data.M), "str": str(model),
}  # fmt: skip
