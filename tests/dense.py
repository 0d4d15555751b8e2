"""The oracle: rigid body dynamics in dense 6 x 6 matrices, straight from the book's tables.

Source: R. Featherstone, Rigid Body Dynamics Algorithms (RBDA, 2008): spatial algebra of chapter 2, the recursive
Newton-Euler algorithm of table 5.1, the composite rigid body algorithm of table 6.2, the articulated body algorithm
of table 7.1. Slow, and sharing nothing with the library it judges: it imports NumPy only. A joint of n freedoms has a
6 x n subspace S and its articulated inertia is a dense n x n solve.

Bodies are numbered 1 .. n as joints are in the public calls; 0 is the world. Inside, spatial vectors are angular
first; every 6-vector that a function takes or returns is linear first, as the library's public arrays are:

kind            q                       v
revolute        angle                   rate about the axis
prismatic       displacement            rate along the axis
helical         angle                   rate about the axis, along which the body moves by pitch a radian
continuous_cs   cos, sin of the angle   rate about the axis
spherical       quaternion x y z w      angular velocity in the body frame
floating        x y z, quaternion       body twist in the body frame, linear first
planar          x, y, angle             body twist vx, vy, ω along the turned x, y axes and the axis
planar_cs       x, y, cos, sin          as planar

A planar joint moves in the plane normal to its axis; the plane's x and y are those that the shortest rotation Q
taking z to the axis makes of the joint's x and y (the half turn about x for the axis -z). The body frame is not
turned: its pose in the joint frame is Q P(x, y, θ) Qᵀ.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

NQ = dict(revolute=1, prismatic=1, helical=1, continuous_cs=2, spherical=4, floating=7, planar=3, planar_cs=4)
NV = dict(revolute=1, prismatic=1, helical=1, continuous_cs=1, spherical=3, floating=6, planar=3, planar_cs=3)
REFERENCES = ("local", "world", "local_world_aligned")


@dataclass(frozen=True)
class Body:
    """A body and the joint it hangs on.

    parent     number of the parent body, 0 (or -1) for the world
    kind       one of the kinds above
    axis       (3,)   unit vector in the joint's frame, read by the kinds that have one
    placement  (4, 4) pose of the joint in the parent's frame
    mass       [kg];  com (3,) [m];  inertia (3, 3) about the com [kg m²]; in the body's frame
    armature   added to every M_ii of the joint [kg m² | kg]
    pitch      of a helical joint [m/rad]
    """

    parent: int
    kind: str
    axis: ArrayLike = (0.0, 0.0, 1.0)
    placement: ArrayLike = field(default_factory=lambda: np.eye(4))
    mass: float = 0.0
    com: ArrayLike = (0.0, 0.0, 0.0)
    inertia: ArrayLike = field(default_factory=lambda: np.zeros((3, 3)))
    armature: float = 0.0
    pitch: float = 0.0


@dataclass(frozen=True)
class Tree:
    """Bodies, parents first, and the acceleration of gravity (3,) [m/s²]."""

    bodies: tuple[Body, ...]
    gravity: ArrayLike = (0.0, 0.0, -9.81)

    @cached_property
    def nq(self) -> int:
        """Number of coordinates."""
        return sum(NQ[b.kind] for b in self.bodies)

    @cached_property
    def nv(self) -> int:
        """Number of freedoms."""
        return sum(NV[b.kind] for b in self.bodies)

    @cached_property
    def njoints(self) -> int:
        """Number of joints, the world counted."""
        return len(self.bodies) + 1

    @cached_property
    def parents(self) -> list[int]:
        """Parent of each body; entry 0 stands for the world."""
        return [0, *(max(b.parent, 0) for b in self.bodies)]

    @cached_property
    def q_slices(self) -> list[slice]:
        """Where each body's coordinates lie in q; empty for the world."""
        return _slices([NQ[b.kind] for b in self.bodies])

    @cached_property
    def v_slices(self) -> list[slice]:
        """Where each body's freedoms lie in v; empty for the world."""
        return _slices([NV[b.kind] for b in self.bodies])


def _slices(sizes: list[int]) -> list[slice]:
    ends = np.cumsum([0, *sizes]).tolist()
    return [slice(0, 0), *(slice(a, b) for a, b in pairwise(ends))]


# --- spatial algebra: RBDA chapter 2, angular first ------------------------------------------------------


def skew(a: ArrayLike) -> Array:
    """a×, (3, 3)."""
    x, y, z = np.asarray(a, float)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def quarters(a: Array, b: Array | float, c: Array, d: Array | float) -> Array:
    """The map (6, 6) of those four, row by row: ``np.block`` of them takes ten times as long."""
    m = np.empty((6, 6))
    m[:3, :3], m[:3, 3:], m[3:, :3], m[3:, 3:] = a, b, c, d
    return m


def crm(v: Array) -> Array:
    """v×, (6, 6): eq. 2.31."""
    w = skew(v[:3])
    return quarters(w, 0.0, skew(v[3:]), w)


def crf(v: Array) -> Array:
    """v×*, (6, 6): eq. 2.32."""
    return -crm(v).T


def plucker(T: Array) -> Array:
    """Motion transform (6, 6) from the parent to the frame whose pose in the parent is T (4, 4): section 2.8."""
    E, r = T[:3, :3].T, T[:3, 3]
    return quarters(E, 0.0, -E @ skew(r), E)


def spatial_inertia(mass: float, com: ArrayLike, inertia: ArrayLike) -> Array:
    """Inertia (6, 6) about the frame's origin of a body known by its com and its inertia about it: eq. 2.63."""
    c = skew(com)
    return quarters(np.asarray(inertia) + mass * c @ c.T, mass * c, mass * c.T, mass * np.eye(3))


def flip(m: ArrayLike) -> Array:
    """A spatial vector (6,), or the rows of a map (6, n): linear first <-> angular first."""
    return np.roll(np.asarray(m, float), 3, axis=0)


def pose(R: ArrayLike | None = None, p: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """A pose (4, 4)."""
    T = np.eye(4)
    T[:3, :3] = np.eye(3) if R is None else R
    T[:3, 3] = p
    return T


def invert(T: Array) -> Array:
    """The inverse of a pose (4, 4)."""
    return pose(T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])


def expm(A: Array) -> Array:
    """The matrix exponential: Taylor series, scaled and squared."""
    squarings = max(0, int(np.ceil(np.log2(max(np.abs(A).sum(axis=1).max(), 1e-300)))) + 1)
    B = A / 2.0**squarings
    E = term = np.eye(len(A))
    for k in range(1, 20):
        term = term @ B / k
        E = E + term
    for _ in range(squarings):
        E = E @ E
    return E


def hat(twist: ArrayLike) -> Array:
    """A twist (6,), linear first, as a matrix (4, 4) whose exponential is the pose reached after unit time."""
    twist = np.asarray(twist, float)
    A = np.zeros((4, 4))
    A[:3, :3] = skew(twist[3:])
    A[:3, 3] = twist[:3]
    return A


# --- joints ---------------------------------------------------------------------------------------------


def rotation_about(axis: ArrayLike, c: float, s: float) -> Array:
    """Rotation (3, 3) by the angle of cosine c and sine s about a unit axis (Rodrigues)."""
    u = np.asarray(axis, float)
    return c * np.eye(3) + s * skew(u) + (1.0 - c) * np.outer(u, u)


def rotation_of(quaternion: ArrayLike) -> Array:
    """Rotation (3, 3) of a quaternion x y z w, used as given."""
    x, y, z, w = np.asarray(quaternion, float)
    u = skew((x, y, z))
    return np.eye(3) + 2.0 * w * u + 2.0 * u @ u


def shortest_rotation(axis: ArrayLike) -> Array:
    """The rotation (3, 3) by the smallest angle that takes z to a unit axis; the half turn about x for -z."""
    x, y, z = np.asarray(axis, float)
    square = x * x + y * y
    if z < 0.0 and square == 0.0:
        return np.diag([1.0, -1.0, -1.0])
    c = skew((-y, x, 0.0))
    return np.eye(3) + c + c @ c * ((1.0 - z) / square if z < 0.0 else 1.0 / (1.0 + z))


def joint_pose(body: Body, q: Array) -> Array:
    """Pose (4, 4) of the body in its joint's frame."""
    if body.kind == "revolute":
        return pose(rotation_about(body.axis, np.cos(q[0]), np.sin(q[0])))
    if body.kind == "continuous_cs":
        return pose(rotation_about(body.axis, q[0], q[1]))
    if body.kind == "prismatic":
        return pose(p=q[0] * np.asarray(body.axis, float))
    if body.kind == "helical":
        turned = pose(rotation_about(body.axis, np.cos(q[0]), np.sin(q[0])))
        return turned @ pose(p=body.pitch * q[0] * np.asarray(body.axis, float))
    if body.kind == "spherical":
        return pose(rotation_of(q))
    if body.kind == "floating":
        return pose(rotation_of(q[3:]), q[:3])
    c, s = (np.cos(q[2]), np.sin(q[2])) if body.kind == "planar" else q[2:]
    Q = pose(shortest_rotation(body.axis))
    return Q @ pose([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], (q[0], q[1], 0.0)) @ Q.T


def subspace(body: Body) -> Array:
    """Motion subspace S (6, n) in the body's frame; constant for every kind, so that c_J = 0 (section 4.4)."""
    o, one, axis = np.zeros((3, 3)), np.eye(3), np.asarray(body.axis, float)
    if body.kind in ("revolute", "continuous_cs"):
        return np.r_[axis, np.zeros(3)][:, None]
    if body.kind == "prismatic":
        return np.r_[np.zeros(3), axis][:, None]
    if body.kind == "helical":
        return np.r_[axis, body.pitch * axis][:, None]
    if body.kind == "spherical":
        return np.vstack([one, o])
    if body.kind == "floating":
        return np.block([[o, one], [one, o]])
    Q = shortest_rotation(body.axis)
    return np.array([np.r_[np.zeros(3), Q[:, 0]], np.r_[np.zeros(3), Q[:, 1]], np.r_[Q[:, 2], np.zeros(3)]]).T


@dataclass(frozen=True)
class _Parts:
    """What every table starts from; entry 0 is the world."""

    X: list[Array]  # motion transform (6, 6) from the parent to the body
    S: list[Array]  # (6, n)
    I: list[Array]  # (6, 6)
    T: list[Array]  # pose (4, 4) in the world
    W: list[Array]  # S in world coordinates


def _parts(tree: Tree, q: ArrayLike) -> _Parts:
    q = np.asarray(q, float)
    if q.shape != (tree.nq,):
        raise ValueError(f"q has shape {q.shape}, expected ({tree.nq},)")
    X, S, I, T = [np.eye(6)], [np.zeros((6, 0))], [np.zeros((6, 6))], [np.eye(4)]
    for i, body in enumerate(tree.bodies, 1):
        local = np.asarray(body.placement, float) @ joint_pose(body, q[tree.q_slices[i]])
        X.append(plucker(local))
        S.append(subspace(body))
        I.append(spatial_inertia(body.mass, body.com, body.inertia))
        T.append(T[tree.parents[i]] @ local)
    return _Parts(X, S, I, T, [plucker(invert(pose)) @ columns for pose, columns in zip(T, S, strict=True)])


def _gravity(tree: Tree, gravity: ArrayLike | None) -> Array:
    """The acceleration of gravity as a spatial vector (6,)."""
    return np.r_[np.zeros(3), np.asarray(tree.gravity if gravity is None else gravity, float)]


def _armature(tree: Tree) -> Array:
    """The armature of each freedom (nv,)."""
    return np.array([body.armature for body in tree.bodies for _ in range(NV[body.kind])])


# --- the equation of motion -----------------------------------------------------------------------------


def rnea(
    tree: Tree,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    fext: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
) -> Array:
    """Inverse dynamics τ (nv,). Source: RBDA table 5.1; external forces are given in body coordinates.

    fext  (njoints, 6)  force on each body in its own frame, linear first; row 0, the world's, is ignored
    """
    p, at, parent = _parts(tree, q), tree.v_slices, tree.parents
    qd, qdd = np.asarray(v, float), np.asarray(a, float)
    fx = np.zeros((tree.njoints, 6)) if fext is None else np.roll(np.asarray(fext, float), 3, axis=1)
    vel, acc, f = [np.zeros(6)], [-_gravity(tree, gravity)], [np.zeros(6)]
    tau = np.zeros(tree.nv)
    for i in range(1, tree.njoints):
        vJ = p.S[i] @ qd[at[i]]
        vel.append(p.X[i] @ vel[parent[i]] + vJ)
        acc.append(p.X[i] @ acc[parent[i]] + p.S[i] @ qdd[at[i]] + crm(vel[i]) @ vJ)
        f.append(p.I[i] @ acc[i] + crf(vel[i]) @ p.I[i] @ vel[i] - fx[i])
    for i in range(tree.njoints - 1, 0, -1):
        tau[at[i]] = p.S[i].T @ f[i]
        f[parent[i]] = f[parent[i]] + p.X[i].T @ f[i]
    return tau + _armature(tree) * qdd


def bias(tree: Tree, q: ArrayLike, v: ArrayLike, gravity: ArrayLike | None = None) -> Array:
    """C(q, q̇) q̇ + g(q), (nv,)."""
    return rnea(tree, q, v, np.zeros(tree.nv), gravity=gravity)


def gravity_torque(tree: Tree, q: ArrayLike, gravity: ArrayLike | None = None) -> Array:
    """g(q), (nv,)."""
    return rnea(tree, q, np.zeros(tree.nv), np.zeros(tree.nv), gravity=gravity)


def crba(tree: Tree, q: ArrayLike) -> Array:
    """Mass matrix M (nv, nv). Source: RBDA table 6.2."""
    p, at, parent = _parts(tree, q), tree.v_slices, tree.parents
    H = np.diag(_armature(tree)) if tree.nv else np.zeros((0, 0))
    Ic = list(p.I)
    for i in range(tree.njoints - 1, 0, -1):
        Ic[parent[i]] = Ic[parent[i]] + p.X[i].T @ Ic[i] @ p.X[i]
        F = Ic[i] @ p.S[i]
        H[at[i], at[i]] += p.S[i].T @ F
        j = i
        while parent[j]:
            F = p.X[j].T @ F
            j = parent[j]
            H[at[i], at[j]] = F.T @ p.S[j]
            H[at[j], at[i]] = H[at[i], at[j]].T
    return H


def mass_matrix_by_jacobians(tree: Tree, q: ArrayLike) -> Array:
    """Mass matrix M (nv, nv) = Σ JᵀI J over the bodies, plus armature."""
    M = np.diag(_armature(tree)) if tree.nv else np.zeros((0, 0))
    for i, body in enumerate(tree.bodies, 1):
        J = flip(jacobian(tree, q, i, "local"))
        M = M + J.T @ spatial_inertia(body.mass, body.com, body.inertia) @ J
    return M


def minverse(tree: Tree, q: ArrayLike) -> Array:
    """M⁻¹ (nv, nv), by a dense inverse."""
    return np.asarray(np.linalg.inv(crba(tree, q)))


def aba(
    tree: Tree,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    fext: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
) -> Array:
    """Forward dynamics q̈ (nv,). Source: RBDA table 7.1; ``fext`` as in ``rnea``."""
    p, at, parent, n = _parts(tree, q), tree.v_slices, tree.parents, tree.njoints
    qd, tau = np.asarray(v, float), np.asarray(tau, float)
    fx = np.zeros((n, 6)) if fext is None else np.roll(np.asarray(fext, float), 3, axis=1)
    vel, c, IA, pA = [np.zeros(6)], [np.zeros(6)], list(p.I), [np.zeros(6)]
    for i in range(1, n):
        vJ = p.S[i] @ qd[at[i]]
        vel.append(p.X[i] @ vel[parent[i]] + vJ)
        c.append(crm(vel[i]) @ vJ)
        pA.append(crf(vel[i]) @ p.I[i] @ vel[i] - fx[i])
    U, D, u = [np.zeros((6, 0))] * n, [np.zeros((0, 0))] * n, [np.zeros(0)] * n
    for i in range(n - 1, 0, -1):
        U[i] = IA[i] @ p.S[i]
        D[i] = p.S[i].T @ U[i] + tree.bodies[i - 1].armature * np.eye(p.S[i].shape[1])
        u[i] = tau[at[i]] - p.S[i].T @ pA[i]
        if parent[i]:
            Ia = IA[i] - U[i] @ np.linalg.solve(D[i], U[i].T)
            pa = pA[i] + Ia @ c[i] + U[i] @ np.linalg.solve(D[i], u[i])
            IA[parent[i]] = IA[parent[i]] + p.X[i].T @ Ia @ p.X[i]
            pA[parent[i]] = pA[parent[i]] + p.X[i].T @ pa
    acc, qdd = [-_gravity(tree, gravity)], np.zeros(tree.nv)
    for i in range(1, n):
        a = p.X[i] @ acc[parent[i]] + c[i]
        qdd[at[i]] = np.linalg.solve(D[i], u[i] - U[i].T @ a)
        acc.append(a + p.S[i] @ qdd[at[i]])
    return qdd


# --- kinematics -----------------------------------------------------------------------------------------


def placements(tree: Tree, q: ArrayLike) -> Array:
    """Pose in the world of every body, (njoints, 4, 4); row 0 is the world itself."""
    return np.array(_parts(tree, q).T)


def _expressed(T: Array, reference: str) -> Array:
    """Motion transform (6, 6) from a frame of pose T in the world to the reference."""
    if reference == "local":
        return np.eye(6)
    if reference == "world":
        return plucker(invert(T))
    if reference == "local_world_aligned":
        return plucker(pose(T[:3, :3].T))
    raise ValueError(f"reference is {reference!r}, expected one of {REFERENCES}")


def velocities(tree: Tree, q: ArrayLike, v: ArrayLike, reference: str = "local") -> Array:
    """Spatial velocity of every body, (njoints, 6), linear first, by the outward pass of RBDA table 5.1."""
    p, at, qd = _parts(tree, q), tree.v_slices, np.asarray(v, float)
    vel = [np.zeros(6)]
    for i in range(1, tree.njoints):
        vel.append(p.X[i] @ vel[tree.parents[i]] + p.S[i] @ qd[at[i]])
    return np.array([flip(_expressed(T, reference) @ m) for T, m in zip(p.T, vel, strict=True)])


def accelerations(
    tree: Tree, q: ArrayLike, v: ArrayLike, a: ArrayLike, reference: str = "local", classical: bool = False
) -> Array:
    """Acceleration of every body, (njoints, 6), linear first, gravity not included.

    Spatial, or classical (that of the frame's origin: linear part + ω × its velocity; about the world's origin for
    ``reference="world"``).
    """
    p, at, qd, qdd = _parts(tree, q), tree.v_slices, np.asarray(v, float), np.asarray(a, float)
    vel, acc = [np.zeros(6)], [np.zeros(6)]
    for i in range(1, tree.njoints):
        vJ = p.S[i] @ qd[at[i]]
        vel.append(p.X[i] @ vel[tree.parents[i]] + vJ)
        acc.append(p.X[i] @ acc[tree.parents[i]] + p.S[i] @ qdd[at[i]] + crm(vel[i]) @ vJ)
    out = []
    for T, vi, ai in zip(p.T, vel, acc, strict=True):
        X = _expressed(T, reference)
        vi, ai = X @ vi, X @ ai
        out.append(flip(ai + np.r_[np.zeros(3), np.cross(vi[:3], vi[3:])] if classical else ai))
    return np.array(out)


def _world_jacobian(tree: Tree, p: _Parts, i: int) -> Array:
    """Jacobian (6, nv) of body i in world coordinates, angular first: S of every joint that carries the body."""
    J = np.zeros((6, tree.nv))
    while i:
        J[:, tree.v_slices[i]] = p.W[i]
        i = tree.parents[i]
    return J


def _world_jacobian_dot(tree: Tree, p: _Parts, i: int, v: Array) -> Array:
    """Time derivative (6, nv) of the above: each S moves with its body, so Ṡ = v × S."""
    Jd = np.zeros((6, tree.nv))
    while i:
        J = _world_jacobian(tree, p, i)
        Jd[:, tree.v_slices[i]] = crm(J @ v) @ J[:, tree.v_slices[i]]
        i = tree.parents[i]
    return Jd


def jacobian(tree: Tree, q: ArrayLike, body: int, reference: str = "local", offset: ArrayLike | None = None) -> Array:
    """Jacobian J (6, nv), linear first, of a body, or of the frame whose pose in the body is ``offset`` (4, 4)."""
    p = _parts(tree, q)
    T = p.T[body] @ (np.eye(4) if offset is None else np.asarray(offset, float))
    return flip(_expressed(T, reference) @ plucker(T) @ _world_jacobian(tree, p, body))


def jacobian_dot(
    tree: Tree,
    q: ArrayLike,
    v: ArrayLike,
    body: int,
    reference: str = "local",
    offset: ArrayLike | None = None,
) -> Array:
    """Time derivative (6, nv) of ``jacobian`` along q̇ = v, analytic.

    J q̈ + J̇ q̇ is the derivative of the components of J q̇: the spatial acceleration in local and world, the classical
    one in local_world_aligned.
    """
    p, v = _parts(tree, q), np.asarray(v, float)
    T = p.T[body] @ (np.eye(4) if offset is None else np.asarray(offset, float))
    J, Jd = _world_jacobian(tree, p, body), _world_jacobian_dot(tree, p, body, v)
    if reference == "world":
        return flip(Jd)
    if reference == "local":
        return flip(plucker(T) @ (Jd - crm(J @ v) @ J))
    X = _expressed(T, reference) @ plucker(T)
    moving = np.zeros((6, 6))
    moving[3:, :3] = -skew((X @ J @ v)[3:])  # d/dt of X, which carries the linear part to the frame's origin
    return flip(X @ Jd + moving @ J)


def jacobian_dot_times_v(
    tree: Tree,
    q: ArrayLike,
    v: ArrayLike,
    body: int,
    reference: str = "local",
    offset: ArrayLike | None = None,
) -> Array:
    """J̇ q̇ (6,), linear first."""
    return jacobian_dot(tree, q, v, body, reference, offset) @ np.asarray(v, float)


# --- the Coriolis matrix and what it is made of ---------------------------------------------------------


def coriolis_matrix(tree: Tree, q: ArrayLike, v: ArrayLike) -> Array:
    """C (nv, nv) = Σ Jᵀ (I J̇ + ½ (v×* I + (I v)×̄* - I v×) J) over the bodies, in world coordinates."""
    p, v, C = _parts(tree, q), np.asarray(v, float), np.zeros((tree.nv, tree.nv))
    for i in range(1, tree.njoints):
        X, J, Jd = plucker(p.T[i]), _world_jacobian(tree, p, i), _world_jacobian_dot(tree, p, i, v)
        I, u = X.T @ p.I[i] @ X, J @ v
        n, f = (I @ u)[:3], (I @ u)[3:]
        of_momentum = quarters(-skew(n), -skew(f), -skew(f), 0.0)
        C = C + J.T @ (I @ Jd + 0.5 * (crf(u) @ I + of_momentum - I @ crm(u)) @ J)
    return C


def christoffel_symbols(tree: Tree, q: ArrayLike) -> Array:
    """Γ (nv, nv, nv): C is linear in v."""
    columns = [coriolis_matrix(tree, q, e) for e in np.eye(tree.nv)]
    return np.moveaxis(np.array(columns).reshape((tree.nv,) * 3), 0, -1)


def mass_matrix_dot(tree: Tree, q: ArrayLike, v: ArrayLike) -> Array:
    """dM/dt (nv, nv) = Σ J̇ᵀ I J + Jᵀ İ J + Jᵀ I J̇ over the bodies, in world coordinates."""
    p, v, M = _parts(tree, q), np.asarray(v, float), np.zeros((tree.nv, tree.nv))
    for i in range(1, tree.njoints):
        X, J, Jd = plucker(p.T[i]), _world_jacobian(tree, p, i), _world_jacobian_dot(tree, p, i, v)
        I, u = X.T @ p.I[i] @ X, J @ v
        M = M + Jd.T @ I @ J + J.T @ (crf(u) @ I - I @ crm(u)) @ J + J.T @ I @ Jd
    return M


def mass_matrix_derivatives(tree: Tree, q: ArrayLike) -> Array:
    """∂M_ij/∂q_k (nv, nv, nv)."""
    rates = [mass_matrix_dot(tree, q, e) for e in np.eye(tree.nv)]
    return np.moveaxis(np.array(rates).reshape((tree.nv,) * 3), 0, -1)


def modified_rnea(tree: Tree, q: ArrayLike, v: ArrayLike, v_r: ArrayLike, a_r: ArrayLike) -> Array:
    """M a_r + C v_r + g (nv,)."""
    return crba(tree, q) @ np.asarray(a_r) + coriolis_matrix(tree, q, v) @ np.asarray(v_r) + gravity_torque(tree, q)


# --- energy, centre of mass, momentum -------------------------------------------------------------------


def kinetic_energy(tree: Tree, q: ArrayLike, v: ArrayLike) -> float:
    """T = ½ Σ vᵀI v over the bodies, plus that of the armature [J]."""
    vel, v = velocities(tree, q, v), np.asarray(v, float)
    T = 0.5 * float(v @ (_armature(tree) * v))
    for i, body in enumerate(tree.bodies, 1):
        m = flip(vel[i])
        T += 0.5 * float(m @ spatial_inertia(body.mass, body.com, body.inertia) @ m)
    return T


def potential_energy(tree: Tree, q: ArrayLike, gravity: ArrayLike | None = None) -> float:
    """V = -Σ m gᵀ c over the bodies, null at the world's origin [J]."""
    T, g = placements(tree, q), _gravity(tree, gravity)[3:]
    V = 0.0
    for i, body in enumerate(tree.bodies, 1):
        V -= body.mass * float(g @ (T[i] @ np.r_[np.asarray(body.com, float), 1.0])[:3])
    return V


def total_mass(tree: Tree) -> float:
    """Mass of all bodies [kg]."""
    return float(sum(body.mass for body in tree.bodies))


def com(tree: Tree, q: ArrayLike) -> Array:
    """Centre of mass (3,) in the world [m]."""
    T = placements(tree, q)
    moment = sum(b.mass * (T[i] @ np.r_[np.asarray(b.com, float), 1.0])[:3] for i, b in enumerate(tree.bodies, 1))
    return np.asarray(moment / total_mass(tree))


def com_jacobian(tree: Tree, q: ArrayLike) -> Array:
    """Jacobian (3, nv) of the centre of mass in the world."""
    J = np.zeros((3, tree.nv))
    for i, body in enumerate(tree.bodies, 1):
        J += body.mass * jacobian(tree, q, i, "local_world_aligned", pose(p=body.com))[:3]
    return J / total_mass(tree)


def com_velocity(tree: Tree, q: ArrayLike, v: ArrayLike) -> Array:
    """Velocity (3,) of the centre of mass in the world."""
    return com_jacobian(tree, q) @ np.asarray(v, float)


def com_acceleration(tree: Tree, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
    """Acceleration (3,) of the centre of mass in the world."""
    acc = com_jacobian(tree, q) @ np.asarray(a, float)
    for i, body in enumerate(tree.bodies, 1):
        drift = jacobian_dot_times_v(tree, q, v, i, "local_world_aligned", pose(p=body.com))[:3]
        acc = acc + body.mass / total_mass(tree) * drift
    return acc


def _momentum_maps(tree: Tree, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
    """The map (6, nv) from q̇ to the momentum about the world's origin, angular first, and its time derivative."""
    p, v = _parts(tree, q), np.asarray(v, float)
    A, Ad = np.zeros((6, tree.nv)), np.zeros((6, tree.nv))
    for i in range(1, tree.njoints):
        X = plucker(p.T[i])
        I, J, Jd = X.T @ p.I[i] @ X, _world_jacobian(tree, p, i), _world_jacobian_dot(tree, p, i, v)
        vel = J @ v
        A += I @ J
        Ad += I @ Jd + (crf(vel) @ I - I @ crm(vel)) @ J  # İ = v×* I - I v×
    return A, Ad


def centroidal_map(tree: Tree, q: ArrayLike) -> Array:
    """The map A_g (6, nv) from q̇ to the centroidal momentum, linear first."""
    A, _ = _momentum_maps(tree, q, np.zeros(tree.nv))
    return flip(np.vstack([A[:3] - skew(com(tree, q)) @ A[3:], A[3:]]))


def centroidal_map_dot(tree: Tree, q: ArrayLike, v: ArrayLike) -> Array:
    """The time derivative Ȧ_g (6, nv) along q̇ = v, linear first, analytic, the motion of the com included."""
    A, Ad = _momentum_maps(tree, q, v)
    c, cd = skew(com(tree, q)), skew(com_velocity(tree, q, v))
    return flip(np.vstack([Ad[:3] - c @ Ad[3:] - cd @ A[3:], Ad[3:]]))


def centroidal_momentum(tree: Tree, q: ArrayLike, v: ArrayLike) -> Array:
    """Momentum (6,) about the centre of mass along the world's axes, linear first.

    Body by body, not through the map: linear m ċ, angular I ω + m (c - c_all) × ċ.
    """
    T, vel, h = placements(tree, q), velocities(tree, q, v), np.zeros(6)
    middle = com(tree, q)
    for i, b in enumerate(tree.bodies, 1):
        R, w = T[i][:3, :3], vel[i][3:]
        linear = b.mass * R @ (vel[i][:3] + np.cross(w, b.com))
        arm = T[i][:3, 3] + R @ np.asarray(b.com, float) - middle
        h += np.r_[linear, R @ np.asarray(b.inertia) @ w + np.cross(arm, linear)]
    return h


# --- configurations -------------------------------------------------------------------------------------


def _times_right(w: Array) -> Array:
    """The matrix (4, 4) with q ⊗ (w, 0) = matrix @ q for quaternions x y z w."""
    x, y, z = w
    return np.array([[0.0, z, -y, x], [-z, 0.0, x, y], [y, -x, 0.0, z], [-x, -y, -z, 0.0]])


def _average(W: Array) -> Array:
    """∫ exp(s W) ds over [0, 1] for W (n, n): the map from a body twist's linear part to the displacement."""
    n = len(W)
    return expm(np.block([[W, np.eye(n)], [np.zeros((n, 2 * n))]]))[:n, n:]


def _quaternion_log(q0: Array, q1: Array) -> Array:
    """The rotation vector (3,) from q0 to q1, in the frame of q0, of length at most π."""
    u, w = q0[:3], q0[3]
    d = np.r_[w * q1[:3] - q1[3] * u - np.cross(u, q1[:3]), w * q1[3] + u @ q1[:3]]
    d = -d if d[3] < 0.0 else d
    sine = float(np.linalg.norm(d[:3]))
    return d[:3] * (2.0 / d[3] if sine < 1e-150 else 2.0 * np.arctan2(sine, d[3]) / sine)


def integrate(tree: Tree, q: ArrayLike, v: ArrayLike) -> Array:
    """q ∘ exp(v), (nq,): where q is after unit time at the constant velocity v of each joint.

    Of the two quaternions of a rotation by more than π, a spherical joint has the one reached on the way, a floating
    one the one nearer to q, as in Pinocchio.
    """
    q, v = np.array(q, float), np.asarray(v, float)
    for body, at, to in zip(tree.bodies, tree.q_slices[1:], tree.v_slices[1:], strict=True):
        x, d = q[at], v[to]  # x is a view: q is written through it
        if body.kind in ("revolute", "prismatic", "helical"):
            x[0] += d[0]
        elif body.kind == "continuous_cs":
            x[:] = expm(d[0] * np.array([[0.0, -1.0], [1.0, 0.0]])) @ x
        elif body.kind == "spherical":
            x[:] = expm(0.5 * _times_right(d)) @ x
        elif body.kind == "floating":
            x[:3] += rotation_of(x[3:]) @ _average(skew(d[3:])) @ d[:3]
            there = expm(0.5 * _times_right(d[3:])) @ x[3:]
            x[3:] = -there if there @ x[3:] < 0.0 else there
        else:
            c, s = (np.cos(x[2]), np.sin(x[2])) if body.kind == "planar" else x[2:]
            W = d[2] * np.array([[0.0, -1.0], [1.0, 0.0]])
            x[:2] += np.array([[c, -s], [s, c]]) @ _average(W) @ d[:2]
            if body.kind == "planar":
                x[2] += d[2]
            else:
                x[2:] = expm(W) @ x[2:]
    return q


def difference(tree: Tree, q0: ArrayLike, q1: ArrayLike) -> Array:
    """The v (nv,) that ``integrate`` takes from q0 to q1; rotations by at most π, an angle of one number as it is."""
    q0, q1, v = np.asarray(q0, float), np.asarray(q1, float), np.zeros(tree.nv)
    for body, at, to in zip(tree.bodies, tree.q_slices[1:], tree.v_slices[1:], strict=True):
        x, y, d = q0[at], q1[at], v[to]
        if body.kind in ("revolute", "prismatic", "helical"):
            d[:] = y - x
        elif body.kind == "continuous_cs":
            d[0] = np.arctan2(x[0] * y[1] - x[1] * y[0], x[0] * y[0] + x[1] * y[1])
        elif body.kind == "spherical":
            d[:] = _quaternion_log(x, y)
        elif body.kind == "floating":
            d[3:] = _quaternion_log(x[3:], y[3:])
            d[:3] = np.linalg.solve(_average(skew(d[3:])), rotation_of(x[3:]).T @ (y[:3] - x[:3]))
        else:
            c, s = (np.cos(x[2]), np.sin(x[2])) if body.kind == "planar" else x[2:]
            angle = y[2] - x[2] if body.kind == "planar" else np.arctan2(c * y[3] - s * y[2], c * y[2] + s * y[3])
            W = angle * np.array([[0.0, -1.0], [1.0, 0.0]])
            d[:2] = np.linalg.solve(_average(W), np.array([[c, s], [-s, c]]) @ (y[:2] - x[:2]))
            d[2] = angle
    return v


def neutral(tree: Tree) -> Array:
    """The configuration (nq,) at which every joint is at its placement."""
    one = dict(continuous_cs=0, spherical=3, floating=6, planar_cs=2)  # where the coordinate that is 1 stands
    q = np.zeros(tree.nq)
    for body, at in zip(tree.bodies, tree.q_slices[1:], strict=True):
        if body.kind in one:
            q[at.start + one[body.kind]] = 1.0
    return q
