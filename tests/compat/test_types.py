"""The spatial types under both imports: one table of expressions, evaluated with the same seeded random numbers.

Values agree to TOLERANCE times their size, shapes and types of results exactly, and where the wheel raises, compat
raises an error of the same built-in class. Near the identity, where the wheel's Jlog6 and Jexp6 are off by up to 1e-7,
and near half a turn, where its log6 is off by 4e-14, the reference is mpmath.
"""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as ours
from spatialdyn import SpatialDynError
from spatialdyn.compat.pinocchio.model.library_model import library_model
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.errors import InertiaError

EPS = float(np.finfo(float).eps)
TOLERANCE = (
    4500 * EPS
)  # 1e-12, the bound of compat's types; products of a few matrices of entries near 1 need some 10 eps
EXACT = 16 * EPS  # exp, log and their Jacobians against mpmath, relative to the largest entry


def random_values(pin: Any, seed: int) -> dict[str, Any]:
    """The same objects under either import."""
    rng = np.random.default_rng(seed)
    w, t, s = rng.standard_normal(3), rng.standard_normal(3), rng.standard_normal(6)
    R = turned(w)
    half = rng.standard_normal((3, 3))
    J = half @ half.T + np.eye(3)
    quat, other = rng.standard_normal(4), rng.standard_normal(4)
    quat, other = quat / np.linalg.norm(quat), other / np.linalg.norm(other)
    return {
        "pin": pin, "np": np, "copy": copy, "pickle": pickle,
        "R": R, "w": w, "t": t, "s": s, "J6": J, "quat": quat, "other": other, "column": t.reshape(3, 1),
        "M": pin.SE3(R, t), "N": pin.SE3(R.T @ R.T, s[:3]),
        "v": pin.Motion(s), "a": pin.Motion(t, w), "f": pin.Force(w, t), "g": pin.Force(s[::-1].copy()),
        "I": pin.Inertia(1.3, t, J), "K": pin.Inertia(0.4, w, J + np.diag([0.3, 0.2, 0.1])),
        "S": pin.Symmetric3(J), "T": pin.Symmetric3(s),
        "q": pin.Quaternion(quat), "p": pin.Quaternion(other), "aa": pin.AngleAxis(0.7, t / np.linalg.norm(t)),
    }  # fmt: skip


def turned(w: Any) -> Any:
    """The rotation by |w| about w, by Rodrigues."""
    angle = float(np.sqrt(w @ w))
    x, y, z = w / angle
    W = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * W + (1.0 - np.cos(angle)) * W @ W


VALUES = """
M; M.rotation; M.translation; M.homogeneous; M.np; np.array(M); np.asarray(M); M.action; M.actionInverse; M.dualAction
M.toActionMatrix(); M.toActionMatrixInverse(); M.toDualActionMatrix(); M.copy(); M.cast(); copy.copy(M)
copy.deepcopy(M); pickle.loads(pickle.dumps(M)); str(M); pin.SE3(M); pin.SE3(M.homogeneous); pin.SE3(1)
pin.SE3(q, t); pin.SE3(R, column); pin.SE3(np.eye(3, dtype=int), np.array([1, 2, 3])); pin.SE3(2 * R, t)
pin.SE3(R.astype(np.float32), t.astype(np.float32)); pin.SE3(rotation=R, translation=t); pin.SE3(quat=q, translation=t)
pin.SE3(R.T, t[::-1]); pin.SE3(np.asfortranarray(R), t); pin.SE3.Identity()
M * N; M * N * M; M.act(N); M.actInv(N); M.inverse(); ~M; M * v; M.act(v); M.actInv(v); M * f; M.act(f); M.actInv(f)
M * I; M.act(I); M.actInv(I); M * t; M.act(t); M.actInv(t); M * column; M.act(column); M.act(np.array([1, 2, 3]))
M == M; M != M; M == N; M != N; M == M.copy(); M == 1; M == "M"; M.isApprox(M * (N * ~N), 1e-9); M.isApprox(N)
M.isIdentity(); (M * ~M).isIdentity(1e-9); pin.SE3.Interpolate(M, N, 0.3); pin.SE3.Interpolate(M, N, 0.0)
pin.SE3.Interpolate(M, N, 1.0); M * np.ones(4); M * np.ones((4, 4)); np.allclose(M, M); np.linalg.inv(M)
M.__getinitargs__()
v; v.linear; v.angular; v.vector; v.np; np.array(v); v.homogeneous; v.action; v.dualAction; v.copy(); v.cast()
copy.copy(v); copy.deepcopy(v); pickle.loads(pickle.dumps(v)); pickle.loads(pickle.dumps(f)); repr(v); str(f)
pin.Motion(t, w); pin.Motion(linear=t, angular=w); pin.Motion(s); pin.Motion(s.reshape(6, 1)); pin.Motion(v)
pin.Motion(column, t); pin.Motion(np.arange(6)); pin.Motion(s[::-1]); pin.Motion(); pin.Motion.Zero(); pin.Force.Zero()
v + a; v - a; -v; v * 2; v * 2.0; 2 * v; 2.5 * v; v / 3; v / 3.0; v * True; v * np.float64(2); f + g; f - g; -f; 2 * f
v ^ a; v ^ f; v.cross(a); v.cross(f); v.dot(f); f.dot(v); v == v; v != v; v == a; v == v.copy(); v == f; v != f
v.isApprox(v * (1 + 1e-13)); v.isApprox(a); v.isZero(); (0 * v).isZero(); v.isZero(100); v.isApprox(1.01 * v, 0.02)
(1e-13 * v).isApprox(0 * v); (0 * f).isApprox(1e-13 * f); (1e-11 * v).isApprox(0 * v); (0.01 * f).isApprox(0 * f, 1.0)
pin.Motion(t, 1e-14 * w).isApprox(pin.Motion(t, 0 * w)); pin.Force(t, 1e-14 * w).isApprox(pin.Force(t, -1e-14 * w))
pin.Motion(1e3 * t, 1e-11 * w).isApprox(pin.Motion(1e3 * t, 0 * w)); (1e-13 * v).isApprox(1e-13 * a)
v.se3Action(M); v.se3ActionInverse(M); f.se3Action(M); f.se3ActionInverse(M); v + np.ones(6); np.ones(6) + v
np.ones(6) * v; v * np.ones(6); np.float64(2) * v; v * np.int64(3); np.linalg.norm(v); np.linalg.norm(v.vector)
v == v.vector; v.__getinitargs__(); np.allclose(v, v); np.concatenate([v, f]); v.vector @ f.vector; sum([v, a], a)
np.vstack([v, a]).shape; pin.Force(f); f.vector
I; I.mass; I.lever; I.inertia; I.matrix(); I.np; np.array(I); I.copy(); copy.deepcopy(I); pickle.loads(pickle.dumps(I))
repr(I); pin.Inertia(I); pin.Inertia(2, t, J6); pin.Inertia(mass=2.0, lever=t, inertia=J6); pin.Inertia(1.0, column, J6)
pin.Inertia(1.0, np.array([1, 2, 3]), np.eye(3, dtype=int)); pin.Inertia(1.0, t, np.asfortranarray(J6))
pin.Inertia(-1.0, t, J6); pin.Inertia(0.0, t, np.zeros((3, 3))); pin.Inertia.Zero(); pin.Inertia.Identity()
I + K; I + K + I; I - K; (I + K) - K; I - I; pin.Inertia.Zero() + I; I * v; I.vtiv(v); I.vxiv(v); I.vxi(v); I.ivx(v)
I.variation(v); I.inverse(); I.se3Action(M); I.se3ActionInverse(M); I == I; I != I; I == K; I.isApprox(I); I.isApprox(K)
I.isZero(); pin.Inertia.Zero().isZero(); I.toDynamicParameters(); I.__getinitargs__()
pin.Inertia.FromDynamicParameters(I.toDynamicParameters()); pin.Inertia.FromSphere(1.5, 0.3)
pin.Inertia.FromBox(1.5, 0.1, 0.2, 0.3); pin.Inertia.FromCylinder(1.5, 0.2, 0.7)
pin.Inertia.FromEllipsoid(1.5, 0.1, 0.2, 0.3); pin.Inertia.FromCapsule(1.5, 0.2, 0.7); I.toPseudoInertia()
pin.Inertia.FromPseudoInertia(I.toPseudoInertia()); I.toPseudoInertia().toMatrix(); I.toPseudoInertia().mass
I.toPseudoInertia().toDynamicParameters()
pin.PseudoInertia.FromMatrix(I.toPseudoInertia().toMatrix()).toInertia(); pin.PseudoInertia.FromInertia(I)
pin.PseudoInertia(1.3, t, J6).toDynamicParameters(); repr(I.toPseudoInertia())
pin.LogCholeskyParameters(np.arange(10) / 10).toDynamicParameters()
pin.LogCholeskyParameters(np.arange(10) / 10).calculateJacobian()
pin.LogCholeskyParameters(np.arange(10) / 10).toInertia()
pin.LogCholeskyParameters(np.arange(10) / 10).toPseudoInertia().toMatrix()
pin.Inertia.FromLogCholeskyParameters(pin.LogCholeskyParameters(np.arange(10) / 10))
repr(pin.LogCholeskyParameters(np.arange(10) / 10))
S; S.data; S.matrix(); repr(S); S.copy(); copy.deepcopy(S); pin.Symmetric3(1, 2, 3, 4, 5, 6).matrix()
pin.Symmetric3(s).matrix(); pin.Symmetric3(S); pin.Symmetric3(np.arange(9.0).reshape(3, 3)).matrix()
pin.Symmetric3.Zero(); pin.Symmetric3.Identity(); S + T; S - T; S + J6; S - J6; S * t; S * column; S.vtiv(t)
S.rotate(R); S == S; S != T; S.isApprox(S); S.isApprox(T); S.isZero(); pin.Symmetric3.Zero().isZero()
q; q.x; q.y; q.z; q.w; q[0]; q[3]; q.coeffs(); q.vec(); q.matrix(); q.toRotationMatrix(); repr(q); str(q); abs(q)
pin.Quaternion(1, 0, 0, 0); pin.Quaternion(1.0, 2.0, 3.0, 4.0); pin.Quaternion(w=1.0, x=2.0, y=3.0, z=4.0)
pin.Quaternion(R); pin.Quaternion(q); pin.Quaternion(aa); pin.Quaternion(quat.reshape(4, 1)); pin.Quaternion(t, w)
pin.Quaternion(np.array([1, 2, 3, 4])); pin.Quaternion(2 * quat).matrix(); pin.Quaternion(2 * quat) * t
pin.Quaternion.Identity(); pin.Quaternion.FromTwoVectors(t, w); pin.Quaternion.FromTwoVectors(t, t); q * p; q * t
q * column; q._transformVector(t); q.conjugate(); q.inverse()
pin.Quaternion(3 * quat).inverse(); pin.Quaternion(np.zeros(4)).inverse(); q.dot(p); q.norm(); q.squaredNorm()
pin.Quaternion(3 * quat).norm(); pin.Quaternion(3 * quat).normalized(); pin.Quaternion(3 * quat).normalize()
q.angularDistance(p); q.angularDistance(q); q.slerp(0.3, p); q.slerp(0.3, q); q.slerp(0.3, pin.Quaternion(-other))
q == q; q != q; q == p; q == pin.Quaternion(-quat); q.isApprox(q); q.isApprox(p); q.isApprox(pin.Quaternion(-quat))
t == q; q != t; t + q; q + t; t * q; np.float64(2.0) * q; len(q); q.__imul__(t); q.__imul__(M); np.asarray(q).dtype.kind
q.isApprox(p, 10.0); pin.Quaternion.Identity().assign(aa); pin.Quaternion.Identity().assign(q); q == 1
pin.Quaternion(np.diag([1.0, -1.0, -1.0])); pin.Quaternion(np.diag([-1.0, 1.0, -1.0]))
pin.Quaternion(np.diag([-1.0, -1.0, 1.0])); pin.Quaternion(-quat).setIdentity()
aa; aa.angle; aa.axis; aa.matrix(); aa.toRotationMatrix(); repr(aa); pin.AngleAxis(R); pin.AngleAxis(q)
pin.AngleAxis(aa)
pin.AngleAxis(pin.Quaternion(-quat)); pin.AngleAxis(np.eye(3)); pin.AngleAxis(np.diag([-1.0, -1.0, 1.0]))
pin.AngleAxis(0.3, 2 * t).matrix(); pin.AngleAxis(0.3, column); aa * aa; aa * q; aa * t; aa.inverse(); aa == aa
aa != aa
S.inverse(t); S.inverse(M); S.rhsMult(S, t, M)
aa.isApprox(aa); aa.isApprox(aa.inverse()); pin.AngleAxis(0.1, t).fromRotationMatrix(R)
pin.skew(t); pin.skew(column); pin.unSkew(pin.skew(t)); pin.unSkew(R); pin.skewSquare(t, w)
pin.XAxis; pin.YAxis; pin.ZAxis
pin.rpy.rpyToMatrix(0.1, -0.2, 3.0); pin.rpy.rpyToMatrix(t); pin.rpy.rpyToMatrix(column); pin.rpy.matrixToRpy(R)
pin.rpy.matrixToRpy(pin.rpy.rpyToMatrix(3.0, 2.0, -3.0)); pin.rpy.rotate("x", 0.3); pin.rpy.rotate("y", 0.3)
pin.rpy.rotate("z", 0.3); pin.rpy.computeRpyJacobian(t); pin.rpy.computeRpyJacobian(t, pin.WORLD)
pin.rpy.computeRpyJacobian(t, pin.LOCAL_WORLD_ALIGNED); pin.rpy.computeRpyJacobianInverse(t)
pin.rpy.computeRpyJacobianInverse(t, pin.WORLD); pin.rpy.computeRpyJacobianTimeDerivative(t, w)
pin.rpy.computeRpyJacobianTimeDerivative(t, w, pin.ReferenceFrame.WORLD)
pin.rpy.matrixToRpy(np.diag([-1.0, -1.0, 1.0])); pin.rpy.matrixToRpy(np.diag([-1.0, 1.0, -1.0]))
pin.rpy.matrixToRpy(np.diag([1.0, -1.0, -1.0])); pin.rpy.matrixToRpy(-np.diag([1.0, 1.0, -1.0]))
pin.rpy.matrixToRpy(-np.diag([-1.0, 1.0, 1.0])); pin.rpy.matrixToRpy(pin.utils.rotate("z", np.pi))
pin.rpy.matrixToRpy(pin.utils.rotate("z", -np.pi)); pin.rpy.matrixToRpy(pin.utils.rotate("x", -np.pi))
pin.rpy.matrixToRpy(pin.rpy.rpyToMatrix(0.0, -0.2, np.pi)); pin.utils.rotate("x", 1); pin.utils.rotate("x", "1")
[x.flags.writeable for x in (q.coeffs(), q.vec(), np.asarray(v), np.asarray(f), v.vector, v.linear)]
[x.flags.writeable for x in (np.asarray(M), np.asarray(I), M.homogeneous, M.action, v.action, I.inertia, S.data)]
str(pin.Frame("tip", 2, 1, M, pin.OP_FRAME, I)); str(pin.Frame("tip", 2, 1, M, pin.BODY))
str(pin.Frame(name="tip", parent_joint=2, parent_frame=1, placement=M, type=pin.BODY, inertia=I))
str(pin.Frame("tip", 2, M, type=pin.BODY)); str(pin.Frame("tip", parent_joint=2, placement=M, type=pin.BODY))
pin.Frame("tip", 2, placement=M); pin.Frame(tip=M); pin.Frame("tip", 2, 1, M, pin.BODY) == t
pin.Inertia.FromDynamicParameters(dynamic_parameters=I.toDynamicParameters())
pin.SE3ToXYZQUAT(M); pin.SE3ToXYZQUATtuple(M); pin.XYZQUATToSE3(pin.SE3ToXYZQUAT(M)); pin.XYZQUATToSE3([*t, *quat])
pin.XYZQUATToSE3((1, 2, 3, 0, 0, 0, 1)); pin.classicAcceleration(v, a); pin.classicAcceleration(v, a, M)
pin.utils.zero(3); pin.utils.zero((2, 3)); pin.utils.eye(3); pin.utils.isapprox(M, M.homogeneous)
pin.utils.isapprox(1, 1.1); pin.utils.isapprox(1, 1 + 9e-7); pin.utils.isapprox(1, 1 + 1.1e-6); pin.utils.isapprox(v, a)
pin.utils.isapprox(t, 1.0000009 * t); pin.utils.isapprox(t, 1.000002 * t)
pin.utils.npToTuple(t); pin.utils.npToTuple(R)
pin.utils.npToTTuple(R); pin.utils.rotate("x", 0.1); pin.utils.rand(3).shape; pin.utils.rand((2, 3)).shape
pin.utils.fromListToVectorOfString(["a", "b"]).tolist()
len(pin.StdVec_Force(3, f)); len(pin.StdVec_SE3([M, N])[:1]); f in pin.StdVec_Force([f]); pin.StdVec_Double([1.0])[0]
list(pin.StdVec_StdString(["a"]))
M.isApprox(v); M.act([0, 0, 0]); M.act(1); M.act(np.zeros((3, 2))); M.act(S); M * 2; 2 * M; M @ M; M * S; M * np.ones(6)
pin.SE3(R, [0, 0, 0]); pin.SE3(R, np.zeros(4)); pin.SE3(np.eye(4), t); pin.SE3(R); pin.SE3([1, 2]); pin.SE3(R * 1j, t)
pin.SE3(R, np.zeros((1, 3))); pin.SE3(np.ones((4, 3))); setattr(M, "translation", [1, 2, 3])
setattr(M, "translation", np.zeros(4)); setattr(M, "rotation", np.eye(4)); setattr(v, "vector", np.ones(5))
pin.Motion(np.zeros(5)); pin.Motion([0] * 6); pin.Motion(np.zeros((1, 6))); pin.Motion(np.zeros(2), t); pin.Motion(f)
pin.Force(v); v + f; v * v; f ^ f; v.dot(a); f.dot(g); v.dot(f.vector); v * 1j; v + 1; v.isApprox(f); v / "a"; v ^ 3
pin.Inertia.FromSphere(t, 0.3); pin.Inertia.FromBox(1.0, 0.1, "a", 0.3); pin.Inertia.FromCapsule(1.0, None, 0.7)
pin.Inertia.FromCylinder(1.0, t, 0.7); pin.Inertia.FromEllipsoid(1, 2, 3, t); pin.Inertia.FromSphere(1, 2); v.isZero(t)
S.isZero("a"); M.isIdentity(t); M.isIdentity(None)
I * 2; I * f; I + 3; I.vtiv(f); pin.Inertia(1.0, np.zeros(2), J6); pin.Inertia(1.0, t, np.eye(2))
pin.Inertia(np.eye(6))
pin.Inertia(1.0, t, S); pin.Inertia(1.0, t, R); pin.Inertia(1.0, t, -J6); setattr(I, "inertia", S); I * I
v.se3Action(t)
pin.Inertia.FromDynamicParameters(np.zeros(9)); S * 2; 2 * S; S + 2; pin.Symmetric3(np.zeros(5)); q[4]; q[-1]
pin.Quaternion(np.zeros(3)); pin.Quaternion([0, 0, 0, 1]); pin.Quaternion(1.0, 2.0, 3.0); pin.Quaternion(np.eye(4))
q * 2; q * aa; pin.AngleAxis(0.2, [1, 0, 0]); pin.skew(np.zeros(4)); pin.skew([1, 2, 3]); pin.unSkew(np.eye(2))
pin.rpy.rpyToMatrix(np.zeros(4)); pin.rpy.rpyToMatrix([0.1, 0.2, 0.3]); pin.rpy.rotate("w", 0.3)
pin.XYZQUATToSE3(np.zeros(6)); pin.XYZQUATToSE3([1, 2]); pin.SE3ToXYZQUAT(np.eye(4)); pin.StdVec_Force([f])[3]
pin.StdVec_Force().append(3); pin.StdVec_Force([v]); pin.exp([0, 0, 0]); pin.exp(np.zeros(5)); pin.exp(f)
pin.log(np.zeros(3)); pin.log6(np.eye(3)); pin.exp3(np.zeros(4)); pin.log3(np.eye(4)); pin.Jlog6(np.eye(4))
pin.log6_quat(np.zeros(8)); pin.log3(R, 0.0); pin.exp6(np.zeros(5)); pin.Jexp3(np.zeros(4)); pin.exp3([0, 0, 0])
"""

DERIVATIVES = """
pin.exp(1.5); pin.exp(w); pin.exp(s); pin.exp(v); pin.log(1.5); pin.log(R); pin.log(M); pin.log(M.homogeneous)
pin.exp3(w); pin.exp3(w.reshape(3, 1)); pin.exp3(5 * w); pin.exp3(np.zeros(3)); pin.exp3_quat(w); pin.exp3_quat(9 * w)
pin.log3(R); pin.log3(np.eye(3)); pin.log3(q); pin.log3(quat); pin.log3(-quat); pin.log3(np.diag([-1.0, -1.0, 1.0]))
pin.log3(np.diag([-1.0, 1.0, -1.0])); pin.log3(np.diag([1.0, -1.0, -1.0])); pin.exp6(v); pin.exp6(s); pin.exp6(9 * s)
pin.exp6_quat(s); pin.exp6_quat(np.zeros(6)); pin.log6(M); pin.log6(M.homogeneous); pin.log6(pin.SE3.Identity())
pin.log6_quat(np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8])); pin.log6_quat(np.concatenate([t, quat]))
pin.Jexp3(w); pin.Jexp3(np.zeros(3)); pin.Jexp3(4 * w); pin.Jexp6(v); pin.Jexp6(s); pin.Jexp6(np.zeros(6))
pin.Jexp6(4 * s)
pin.Jlog3(R); pin.Jlog3(np.eye(3)); pin.Jlog6(M); pin.Jlog6(pin.SE3.Identity()); pin.Jlog6(M * N); pin.Hlog3(R, t)
"""

EFFECTS = """
M.translation[0] = 5.0; r = M
M.rotation[:] = np.eye(3); r = M
x = M.translation; M.translation = w; r = x, M
M.translation += w; r = M
M.rotation = R.T; r = M
x = M.copy(); x.translation[:] = 0; r = M, x
x = M.homogeneous; x[:] = 0; r = M
np.copyto(M.translation, w); r = M
np.add(M.translation, 1, out=M.translation); r = M
M.translation.fill(2); r = M
M.setIdentity(); r = M
M.foo = 3; r = M.foo
x = M; x *= N; r = M, x
v.linear[1] = 2; r = v
v.linear = w; r = v
v.angular = column; r = v
v.vector[2] += 3; r = v
v.vector = np.arange(6.0); r = v
v.np[:] = 1; r = v
x = v; x += a; r = v, x
x = v; x -= a; r = v, x
x = f; x += g; r = f, x
x = v; x *= 2; r = v, x
x = v.linear; v.setZero(); r = x, v
x = pin.Motion(v); x.setZero(); r = v
f.linear[:] = 0; r = f
I.mass = 7; r = I
I.lever[0] = 7; r = I
I.lever = w; r = I
I.inertia = np.eye(3); r = I
I.inertia = -J6; r = I
I.inertia = np.diag([1.0, -1.0, 3.0]); r = I
I.inertia = R; r = I
I.inertia = J6 + 1e-9 * R; r = I
x = np.asarray(v); x[0] = 5.0; r = v
x = q.coeffs(); x[0] = 5.0; r = q
x = q.coeffs(); q.x = 5.0; r = x.copy()
q *= t; r = q
x = I.inertia; x[:] = 0; r = I
x = I; x += K; r = I, x
x = I; x -= K; r = I, x
I.setIdentity(); r = I
I.setZero(); r = I
S.data = s; r = S
S.setDiagonal(t); r = S
S.setIdentity(); r = S
S.setZero(); r = S
S.fill(2); r = S
S += T; r = S
S -= T; r = S
S *= 2.0; r = S
q.x = 2; q.w = 3.0; r = q
q[1] = 2; r = q
q *= p; r = q
x = q.normalize(); x.x = 0.5; r = q
q.setFromTwoVectors(t, w); r = q
aa.angle = 2; r = aa
aa.axis = w; r = aa
aa.axis[0] = 1; r = aa
r = np.zeros(1); pin.log3(R, r)
r = np.zeros(1); pin.log3(quat, r)
x = I.toPseudoInertia(); r = x.h, x.sigma, x.mass
x = I.toPseudoInertia(); x.mass = 2; x.h = t; x.sigma = J6; r = x
x = pin.LogCholeskyParameters(np.arange(10) / 10); r = x.parameters
x = pin.Force(t, w); r = x.angular
x = pin.StdVec_Force([f, g]); r = x[1], x[-1], list(x), x.tolist()
x = pin.StdVec_Force([f]); y = x.copy(); z = pickle.loads(pickle.dumps(x)); r = y[0], z[0]
x = pin.StdVec_Force([f]); x[0].linear[0] = 9; r = x[0], f
x = pin.StdVec_Force([f]); x[0] = g; g.setZero(); r = x[0]
x = pin.StdVec_Force([f]); x.append(g); x.extend([f]); del x[0]; r = list(x)
"""


def expressions(table: str) -> list[str]:
    """The entries of a table, which stand between semicolons and line ends."""
    return [entry.strip() for line in table.strip().splitlines() for entry in line.split(";") if entry.strip()]


def statements(table: str) -> list[str]:
    """One program a line; programs name their lists, for the wheel's entries do not outlive their list."""
    return [line.strip() for line in table.strip().splitlines()]


def plain(value: Any) -> Any:
    """A result as arrays, numbers, texts and tuples of these, with the name of its type."""
    kind = type(value).__name__
    if kind in ("SE3", "Motion", "Force"):
        return kind, np.array(value)
    if kind == "Inertia":
        return kind, np.array([value.mass, *value.lever, *value.inertia.ravel()])
    if kind == "PseudoInertia":
        return kind, value.toMatrix()
    if kind == "Symmetric3":
        return kind, value.matrix()
    if kind == "Quaternion":
        return kind, np.array(value.coeffs())
    if kind == "AngleAxis":
        return kind, np.array([value.angle, *value.axis])
    if isinstance(value, (tuple, list)):
        return tuple(plain(x) for x in value)
    return value


def outcome(program: str, values: dict[str, Any]) -> tuple[Any, Any]:
    """The plain result ``r`` of a program, or the error it raises."""
    try:
        with np.errstate(all="ignore"):
            exec(program, values)
    except Exception as error:
        return None, error
    return plain(values["r"]), None


def builtin(error: BaseException) -> type:
    """The most specific built-in class of an error."""
    return next(kind for kind in type(error).__mro__ if kind.__module__ == "builtins")


def same(ours: Any, theirs: Any, tolerance: float) -> bool:
    """Whether results agree: arrays in shape and to the tolerance times their size, all else exactly."""
    if isinstance(theirs, tuple):
        return len(ours) == len(theirs) and all(same(x, y, tolerance) for x, y in zip(ours, theirs, strict=True))
    if isinstance(theirs, np.ndarray) and theirs.dtype != bool:
        size = max(1.0, float(np.abs(theirs).max(initial=0.0)))
        return (
            type(ours) is np.ndarray
            and ours.shape == theirs.shape
            and bool((np.abs(ours - theirs) <= tolerance * size).all())
        )
    if isinstance(theirs, np.ndarray):
        return bool(np.array_equal(ours, theirs))
    if isinstance(theirs, float):
        return bool(isinstance(ours, float) and abs(ours - theirs) <= tolerance * max(1.0, abs(theirs)))
    return type(ours) is type(theirs) and bool(ours == theirs)


def agree(program: str, seed: int, tolerance: float) -> None:
    """Run a program under both imports and compare."""
    pin = pytest.importorskip("pinocchio")
    expected, error = outcome(program, random_values(pin, seed))
    result, raised = outcome(program, random_values(ours, seed))
    if error is not None:
        assert raised is not None, f"{program} gives {result!r}, the wheel raises {error!r}"
        assert isinstance(raised, builtin(error)), f"{program} raises {raised!r}, the wheel {error!r}"
    else:
        assert raised is None, f"{program} raises {raised!r}, the wheel gives {expected!r}"
        assert same(result, expected, tolerance), f"{program} gives {result!r}, the wheel {expected!r}"


@pytest.mark.parametrize("expression", expressions(VALUES))
def test_values_are_the_wheels(expression: str) -> None:
    for seed in range(3):
        agree(f"r = {expression}", seed, TOLERANCE)


@pytest.mark.parametrize("expression", expressions(DERIVATIVES))
def test_exponentials_and_logarithms_are_the_wheels(expression: str) -> None:
    for seed in range(3):
        agree(f"r = {expression}", seed, TOLERANCE)


@pytest.mark.parametrize("program", statements(EFFECTS))
def test_writes_have_the_effects_they_have_in_the_wheel(program: str) -> None:
    for seed in range(2):
        agree(program, seed, TOLERANCE)


TYPES = ("SE3", "Motion", "Force", "Inertia", "Symmetric3", "Quaternion", "AngleAxis", "PseudoInertia")
TYPES += ("LogCholeskyParameters", "StdVec_SE3", "StdVec_Force")


@pytest.mark.parametrize("name", TYPES)
def test_every_public_attribute_of_the_wheel_is_there(name: str) -> None:
    pin = pytest.importorskip("pinocchio")
    theirs = {x for x in dir(getattr(pin, name)) if not x.startswith("_")}
    assert theirs - set(dir(getattr(ours, name))) == set()
    assert {x for x in ("rpy", "utils") for y in dir(getattr(pin, x)) if y[0] != "_" and not known(pin, x, y)} == set()


def known(pin: Any, module: str, name: str) -> bool:
    """Whether a function of a module of the wheel is in ours; modules that it imports do not count."""
    return hasattr(getattr(ours, module), name) or not callable(getattr(getattr(pin, module), name))


# --- where the wheel loses digits, and where it gives none -----------------------------------------------------


def exact_jacobian(mp: Any, v: Any) -> Any:
    """The right Jacobian of exp at a motion, by its series in the matrix of v ×."""
    ad = mp.zeros(6)
    for row, column, part in ((0, 0, v[3:]), (3, 3, v[3:]), (0, 3, v[:3])):
        x, y, z = part
        for i, j, entry in ((0, 1, z), (1, 2, x), (2, 0, y), (1, 0, -z), (2, 1, -x), (0, 2, -y)):
            ad[row + i, column + j] = entry  # -(v ×)
    total, term = mp.zeros(6), mp.eye(6)
    for k in range(100):
        total += term / mp.factorial(k + 1)
        term = term * ad
    return total


def exact_pose(mp: Any, v: Any) -> Any:
    """exp of a motion, by the series of its 4 x 4 matrix."""
    x, y, z = v[3:]
    return mp.expm(mp.matrix([[0, -z, y, v[0]], [z, 0, -x, v[1]], [-y, x, 0, v[2]], [0, 0, 0, 0]]), method="taylor")


@pytest.mark.parametrize("angle", [1e-12, 1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 0.999, 1.001, 2.0, 3.1, 3.14159])
def test_exponential_and_logarithm_are_exact_at_every_angle(angle: float) -> None:
    mp = pytest.importorskip("mpmath")
    w = np.random.default_rng(7).standard_normal(3)
    v = np.concatenate([[0.3, -1.0, 0.8], angle * w / np.linalg.norm(w)])
    with mp.workdps(50):
        precise = [mp.mpf(x) for x in v.tolist()]
        X, J = exact_pose(mp, precise), exact_jacobian(mp, precise)
        X, J, back = (np.array(A.tolist(), dtype=float) for A in (X, J, J**-1))
    for found, exact in (
        (ours.exp6(v).homogeneous, X),
        (ours.log6(X).vector, v),
        (ours.Jexp6(v), J),
        (ours.Jlog6(ours.SE3(X)), back),
        (ours.exp3(v[3:]), X[:3, :3]),
        (ours.log3(X[:3, :3]), v[3:]),
        (ours.Jexp3(v[3:]), J[3:, 3:]),
        (ours.Jlog3(X[:3, :3]), back[3:, 3:]),
    ):
        assert np.abs(found - exact).max() <= EXACT * max(1.0, np.abs(exact).max())


def test_hessian_of_the_logarithm_is_its_limit_at_the_identity() -> None:
    """∂²log/∂δ² is half the cross product there; the wheel gives NaN."""
    t = np.array([0.3, -0.2, 0.5])
    assert np.allclose(ours.Hlog3(np.eye(3), t), 0.5 * ours.skew(t), rtol=0.0, atol=EPS)


def test_constructors_without_arguments_are_neutral() -> None:
    """The wheel's are uninitialized."""
    assert ours.SE3().isIdentity(0.0)
    assert ours.Quaternion() == ours.Quaternion.Identity()
    assert np.array_equal(ours.AngleAxis().matrix(), np.eye(3))
    assert ours.Inertia().isZero(0.0)
    assert ours.Symmetric3().isZero(0.0)


def test_a_heavier_body_can_be_taken_away() -> None:
    """The wheel divides by eps when the mass left is negative."""
    values = random_values(ours, 0)
    I, K = values["I"], values["K"]
    assert ((K - I) + I).isApprox(K, 64 * EPS)


def test_bodies_without_mass_have_no_centre_and_no_inverse() -> None:
    for make in (
        lambda: ours.Inertia.FromDynamicParameters(np.zeros(10)),
        lambda: ours.Inertia(0.0, np.zeros(3), np.eye(3)).inverse(),
        lambda: ours.Inertia(1.0, np.zeros(3), np.zeros((3, 3))).inverse(),
    ):
        with pytest.raises(InertiaError, match=r"mass is 0|singular"):
            make()


def test_null_vectors_have_no_direction() -> None:
    with pytest.raises(SpatialDynError, match="b is"):
        ours.Quaternion.FromTwoVectors(np.ones(3), np.zeros(3))


@pytest.mark.parametrize("pitch", [0.5 * np.pi, -0.5 * np.pi])
def test_angles_at_a_right_pitch_give_the_rotation_back(pitch: float) -> None:
    """Roll and yaw are not unique there; what is found is to rounding as good as any."""
    for nearly in (0.0, 1e-16, 1e-9, 1e-5):
        R = ours.rpy.rpyToMatrix(0.4, pitch - nearly, -0.7)
        found = ours.rpy.matrixToRpy(R)
        assert np.allclose(ours.rpy.rpyToMatrix(found), R, rtol=0.0, atol=8 * EPS)


def test_symmetric_matrix_writes_its_inverse_and_product() -> None:
    """The wheel writes them to a copy."""
    S, t = random_values(ours, 0)["S"], np.array([1.0, 2.0, 3.0])
    made, product = np.zeros((3, 3)), np.zeros(3)
    S.inverse(made)
    ours.Symmetric3.rhsMult(S, t, product)
    assert np.allclose(made @ product, t, rtol=0.0, atol=64 * EPS * np.abs(product).max())


def test_all_types_can_be_pickled() -> None:
    for name in ("M", "v", "f", "I", "S", "q", "aa"):
        value = random_values(ours, 0)[name]
        assert pickle.loads(pickle.dumps(value)) == value


def test_opposite_directions_are_half_a_turn_apart() -> None:
    for t in (np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.0, -1.0])):
        q = ours.Quaternion.FromTwoVectors(t, -t)
        assert np.allclose(q * t, -t, rtol=0.0, atol=1e-7)  # cos is flat at -1: the angle is known to its root
        assert abs(q.norm() - 1.0) <= 4 * EPS


def test_lists_hold_copies_of_one_type() -> None:
    x, f = np.ones(3), ours.Force.Zero()
    arrays, forces = ours.StdVec_Vector3([x]), ours.StdVec_Force([f])
    x[0], f.linear[0] = 5.0, 5.0
    assert arrays[0][0] == 1.0
    assert forces[0].linear[0] == 0.0
    assert isinstance(forces[:1], ours.StdVec_Force)
    assert isinstance(copy.deepcopy(forces), ours.StdVec_Force)
    assert forces.copy()[0] is not forces[0]
    assert forces.tolist()[0] is forces[0]
    assert forces.tolist(True)[0] is not forces[0]
    arrays.append(ours.buildSampleModelManipulator().jointPlacements[1].translation)
    assert type(arrays[1]) is np.ndarray
    names = ours.StdMap_String_VectorXd()
    names["half_sitting"] = np.zeros((3, 1))
    assert names["half_sitting"].shape == (3,)
    for wrong in (lambda: arrays.append(1.0), lambda: names.__setitem__(1, x), lambda: ours.StdVec_Force(f)):
        with pytest.raises(TypeError):
            wrong()


def test_errors_name_the_thing_and_are_the_librarys_own() -> None:
    for call, text in (
        (lambda: ours.SE3(np.eye(4), np.zeros(3)), "rotation is an array of shape"),
        (lambda: ours.Motion(np.zeros(5)), r"Motion is an array of shape \(5,\)"),
        (lambda: ours.Inertia(1.0, np.zeros(3), -np.eye(3)), "inertia has the eigenvalues"),
        (lambda: ours.Motion.Zero().dot(3), "f is a int, expected Force"),
    ):
        with pytest.raises(SpatialDynError, match=text):
            call()


def test_random_values_are_seeded_and_sound() -> None:
    for kind in (ours.SE3, ours.Motion, ours.Force, ours.Inertia, ours.Symmetric3):
        ours.seed(3)
        first = kind.Random()
        assert kind.Random() != first
        ours.seed(3)
        assert kind.Random() == first
    ours.seed(3)
    R, I = ours.SE3.Random().rotation, ours.Inertia.Random()
    assert np.allclose(R @ R.T, np.eye(3), rtol=0.0, atol=8 * EPS)
    assert np.linalg.eigvalsh(I.toPseudoInertia().toMatrix())[0] > 0.0


# --- values that belong to something ---------------------------------------------------------------------------


WRITES = """
x[0] = 1.0
x[:] = 2.0
x[[0, 1]] = 3.0
x[x > 0] = 4.0
x += 1.0
x *= 2.0
np.add(x, 1.0, out=x)
np.multiply(x, x, x)
np.add.at(x, [0], 1.0)
np.copyto(x, np.zeros(3))
np.put(x, [0], [5.0])
np.clip(x, 0.0, 1.0, out=x)
np.dot(np.eye(3), np.ones(3), out=x)
x.fill(1.0)
x.sort()
x.put([0], [3.0])
x[1:][0] = 3.0
x.reshape(3, 1)[0] = 3.0
np.reshape(x, (3, 1))[0] = 3.0
np.atleast_2d(x)[0, 1] = 3.0
x.T[0] = 3.0
x.flat[0] = 3.0
x[::-1] -= 1.0
x.real[0] = 3.0
np.einsum("i->i", x)[0] = 3.0
np.einsum("ij->ji", x.reshape(3, 1))[0] = 3.0
np.ones(3).cumsum(out=x)
np.fill_diagonal(x.reshape(3, 1), 4.0)
"""
OTHERS = """
np.asarray(x)[0] = 1.0
x.view(np.ndarray)[0] = 1.0
memoryview(x)[0] = 1.0
np.random.default_rng(0).random(out=x)
np.zeros(3).take([0, 1, 2], out=x)
np.frombuffer(x)[0] = 1.0
[y.__setitem__(..., 1.0) for y in np.nditer(x, op_flags=["readwrite"])]
np.lib.stride_tricks.as_strided(np.asarray(x), (3,), (8,))[0] = 1.0
"""


@pytest.mark.parametrize("write", statements(WRITES) + statements(OTHERS))
def test_a_model_sees_every_write_of_its_numbers(write: str) -> None:
    """However an array of a model is written, the next call counts it."""
    model, x = ours.Model(), np.array([2.0, 1.5, 2.5])
    for k in range(3):
        model.addJoint(k, ours.JointModelRX(), ours.SE3.Identity(), f"joint {k}")
    model.armature = x
    held, before = library_model(model), library_model(model).state
    exec(write, {"x": model.armature, "np": np})
    exec(write, {"x": x, "np": np})
    assert np.array_equal(library_model(model).numbers.armature, x)
    if not numba_kernels.PLAIN:  # a Model without builtins is built anew
        assert library_model(model) is held
        assert held.state != before


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("M", "x.translation[0] = 1"), ("M", "x.rotation[:] = 0"), ("M", "x.translation = np.ones(3)"),
        ("M", "x.rotation = np.eye(3)"), ("M", "x.setIdentity()"), ("M", "x.setRandom()"),
        ("v", "x.linear[0] = 1"), ("v", "x.angular = np.ones(3)"), ("v", "x.vector[1] = 1"), ("v", "x += x"),
        ("v", "x.linear = np.ones(3)"), ("v", "x.vector = np.ones(6)"), ("v", "x.setZero()"), ("f", "x.np[0] = 1"),
        ("f", "x -= x"),
        ("I", "x.mass = 2"), ("I", "x.lever[0] = 2"), ("I", "x.lever = np.ones(3)"), ("I", "x.inertia = np.eye(3)"),
        ("I", "x += x"), ("I", "x -= x"), ("I", "x.setZero()"), ("I", "x.setIdentity()"), ("S", "x.fill(1.0)"),
        ("S", "x.setDiagonal(np.ones(3))"), ("S", "x += x"), ("S", "x *= 2.0"), ("q", "x.x = 1.0"), ("q", "x[0] = 1.0"),
        ("q", "x.normalize()"), ("q", "x *= x"), ("aa", "x.angle = 1.0"), ("aa", "x.axis[0] = 1.0"),
    ],
)  # fmt: skip
def test_a_write_of_a_value_is_one_of_the_array_it_views(name: str, write: str) -> None:
    value = random_values(ours, 0)[name]
    buffer = value._x.copy()
    exec(write, {"x": type(value).over(buffer), "np": np})
    assert not np.array_equal(buffer, value._x)


@pytest.mark.parametrize("name", ["M", "v", "f", "I", "S", "q", "aa"])
def test_copies_of_a_value_have_numbers_of_their_own(name: str) -> None:
    value = random_values(ours, 0)[name]
    makers: tuple[Callable[[Any], Any], ...] = (lambda x: x.copy(), copy.deepcopy, type(value))
    for make in makers:
        made = make(value)
        made._write(0.0)
    assert value._x.any()


@pytest.mark.parametrize("name", ["Motion", "Force", "Inertia"])
def test_sums_in_place_have_the_bits_of_sums_in_the_same_array(name: str) -> None:
    a, b = (getattr(ours, name).Random() for _ in range(2))
    for wanted, way in ((a + b, "__iadd__"), (a - b, "__isub__")):
        held = a.copy()
        numbers = held._x
        assert getattr(held, way)(b) is held
        assert held._x is numbers
        assert held._x.tobytes() == wanted._x.tobytes()
        with pytest.raises(TypeError, match=r"^other is "):
            getattr(held, way)(3.0)
        assert held == wanted


def test_an_overflow_of_a_sum_in_place_warns_no_more_than_the_wheels() -> None:
    v = ours.Motion(np.full(6, 1.7e308))
    v += v
    assert (v.vector == np.inf).all()


def test_random_poses_take_the_numbers_of_the_generator_in_order() -> None:
    from spatialdyn.compat.pinocchio.types import random, se3

    ours.seed(3)
    drawn = [ours.SE3.Random() for _ in range(50)]
    ours.seed(3)
    assert drawn == [se3._random(random.GENERATOR.random(6)) for _ in range(50)]
