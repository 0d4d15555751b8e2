"""LQR of an inverted pendulum on a cart, built by hand and linearised with the derivatives of the dynamics."""

import numpy as np
import pinocchio as pin


def cart_pole(mass=0.3, length=0.5):
    model = pin.Model()
    model.name = "cart_pole"
    cart = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    model.appendBodyToJoint(cart, pin.Inertia.FromBox(1.0, 0.2, 0.2, 0.1), pin.SE3.Identity())
    pole = model.addJoint(cart, pin.JointModelRY(), pin.SE3.Identity(), "hinge")
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, length]))
    model.appendBodyToJoint(pole, pin.Inertia.FromSphere(mass, 0.05), tip)
    model.addFrame(pin.Frame("tip", pole, 0, tip, pin.FrameType.OP_FRAME))
    return model


model = cart_pole()
data = model.createData()
nv = model.nv
x_ref, u_ref = np.zeros(2 * nv), np.zeros(nv)

# linearise about the upright pole
ddq_dq, ddq_dv, ddq_dtau = pin.computeABADerivatives(model, data, x_ref[:nv], x_ref[nv:], u_ref)
B_act = np.array([[1.0], [0.0]])  # only the cart is driven
A = np.block([[np.zeros((nv, nv)), np.eye(nv)], [ddq_dq, ddq_dv]])
B = np.vstack([np.zeros((nv, 1)), ddq_dtau @ B_act])

dt = 0.01
Ad, Bd = np.eye(2 * nv) + dt * A, dt * B
Q, R = np.diag([10.0, 100.0, 1.0, 1.0]), np.array([[0.1]])
P = Q.copy()
for _ in range(600):
    K = np.linalg.solve(R + Bd.T @ P @ Bd, Bd.T @ P @ Ad)
    P = Q + Ad.T @ P @ (Ad - Bd @ K)

q, v = np.array([0.2, 0.15]), np.zeros(nv)
tips, states = [], []
for _ in range(300):
    u = -K @ np.concatenate([q, v])
    a = pin.aba(model, data, q, v, B_act @ u)
    v = v + dt * a
    q = pin.integrate(model, q, v * dt)
    pin.framesForwardKinematics(model, data, q)
    tips.append(data.oMf[model.getFrameId("tip")].translation.copy())
    states.append(np.concatenate([q, v]))

dtau_dq, dtau_dv, M = pin.computeRNEADerivatives(model, data, q, v, a)
results = {
    "A": A,
    "B": B,
    "K": K,
    "states": np.array(states),
    "tips": np.array(tips),
    "dtau_dq": dtau_dq.copy(),
    "M": M.copy(),
}
