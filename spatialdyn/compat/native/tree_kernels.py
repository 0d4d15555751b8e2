"""Kernels that no call of the library has: factors of M, Jacobians of centres of mass, kinematic regressors."""

from __future__ import annotations

from typing import Any

from ...algebra.euclidean import matmul, rotate, scale
from ...algebra.lie import Tangent
from ...algebra.public_arrays import read_body, read_pose, write_body, write_tangent, write_vec
from ...algebra.records import inertia_of, motion_of, pose_of
from ...algebra.scalars import inline
from ...algebra.spatial import Pose, compose, momentum, motion_to_parent, zero_motion
from ...engines.compiled.checks import all_finite, unit_norm
from ...engines.compiled.memory import array_at, at, memory, places, release, table_at, word
from ...engines.compiled.numba_kernels import OK
from ...engines.compiled.table_kernels import kernel
from ...engines.compiled.tiers import table_kernel
from ...engines.programs.run.routine import Index, routine
from ...recursions import SPECS
from ...recursions.constraints.kkt import factored
from ...recursions.momenta import centroidal
from ...recursions.spec import LOCAL_WORLD_ALIGNED, WORLD
from ...recursions.tree.ltdl import solve_tree
from .operator_kernels import compiled, deferred
from .operators import add_bodies, body_to_parent, relative_pose, skew
from .recorded_constraints import copy_matrix, write_upper
from .recorded_kinematics import OF_FRAME, Frames

WORK_SIZE = centroidal.WORK.itemsize
_forward_kinematics = table_kernel(SPECS["forward_kinematics"])


@inline
def _factor_upper(bodies: Any, M: Any, L: Any, U: Any, D: Any) -> int:
    """M = U D Uᵀ of the upper triangle of M, U with unit diagonal; L is scratch. -1 if M is singular, D unchanged."""
    n = len(D)
    for i in range(n):
        for j in range(n):
            U[i, j] = M[j, i]
    if factored(bodies, U, L) < 0:
        return -1
    for i in range(n):
        D[i] = L[i, i]
    write_upper(L, U)
    return 0


@inline
def _solve_upper(bodies: Any, U: Any, D: Any, L: Any, x: Any) -> int:
    """Each row of x (m, nv) becomes M⁻¹ of it, in place; L is scratch. Returns -1 if D is not positive, else 0."""
    for i in range(len(D)):
        if not D[i] > 0.0:
            return -1
        for j in range(i):
            L[i, j] = U[j, i]
        L[i, i] = D[i]
    for k in range(len(x)):
        solve_tree(bodies, L, x[k])
    return 0


@inline
def _subtree_com_jacobian(bodies: Any, work: Any, q: Any, root: Any, J: Any) -> int:
    """Column i: momentum, over its mass, of what row i moves of the subtree of the row ``root[0]``; 0: the robot."""
    centroidal.center_of_mass_jacobian(bodies, work, q, J)
    row = int(root[0])
    whole = inertia_of(work[row].I)
    for i in range(1, len(bodies)):
        moved = inertia_of(work[i].I) if row == 0 or row <= i <= bodies[row].last_row else whole
        S = motion_to_parent(pose_of(work[i].X), motion_of(bodies[i].S))
        if not (row == 0 or row <= i <= bodies[row].last_row or i <= row <= bodies[i].last_row):
            S = zero_motion()
        write_vec(J[:, i - 1], scale(1.0 / whole.m, momentum(moved, S).f))
    return 0


@routine(("nv", "nv"))
def decompose(table: int, nv: int, M: int, U: int, D: int, scratch: int, out: Any) -> bool:
    """U, also written to its address, and D, of the M at an address; it does not apply to a singular M."""
    L = at(scratch, (nv, nv))
    if _factor_upper(table_at(table), at(M, (nv, nv)), L, out, at(D, (nv,))) < 0:
        return False
    copy_matrix(out, at(U, (nv, nv)))
    return True


@routine(("nv",), v=("nv",))
def solve(v: Any, table: int, nv: int, U: int, D: int, scratch: int, out: Any) -> bool:
    """M⁻¹ v of the factors at these addresses; it does not apply if D is not positive. ``scratch`` (nv, nv)."""
    for i in range(nv):
        out[i] = v[i]
    factors = at(U, (nv, nv)), at(D, (nv,))
    return bool(_solve_upper(table_at(table), factors[0], factors[1], at(scratch, (nv, nv)), out.reshape(1, nv)) == 0)


@inline
def _subtree_com_jacobian_of(table: int, q: Any, root: Any, out: Any) -> None:
    bodies = table_at(table)
    space = len(bodies) * WORK_SIZE
    scratch = memory(space)
    _subtree_com_jacobian(bodies, array_at(scratch, (len(bodies),), centroidal.WORK), q, root, out)
    release(scratch, space)


@routine((3, "nv"), k=Index("njoints"))
def subtree_com_jacobian_at_recorded(k: int, table: int, nq: int, q: int, rows: int, njoints: int, out: Any) -> bool:
    """The Jacobian of joint k's subtree at the recorded q; ``rows`` are those of the joints, as floats."""
    _subtree_com_jacobian_of(table, at(q, (nq,)), at(rows, (njoints,))[k : k + 1], out)
    return True


@routine((3, "nv"), q=("nq",), k=Index("njoints"))
def subtree_com_jacobian_at(q: Any, k: int, table: int, rows: int, njoints: int, out: Any) -> bool:
    """The Jacobian of joint k's subtree at q, which is to be recorded."""
    if not unit_norm(table_at(table), q):
        return False
    _subtree_com_jacobian_of(table, q, at(rows, (njoints,))[k : k + 1], out)
    return bool(all_finite(out))


factor_upper = deferred(lambda: kernel(_factor_upper, 2, 2, 2, 1, contract=False))
solve_upper = deferred(lambda: kernel(_solve_upper, 2, 1, 2, 2, contract=False))
subtree_com_jacobian = deferred(lambda: kernel(_subtree_com_jacobian, 1, 1, 2, work=centroidal.WORK, contract=False))


@inline
def _kinematic_regressor(X: Any, placements: Any, parents: Any, joint: Any, place: Any, code: Any, out: Any) -> None:
    """Columns of the joints that carry a frame at a place on a joint: actions of their placements X_λ P."""
    here, k = compose(read_pose(X[joint]), read_pose(place)), joint
    while k > 0:
        moved = compose(read_pose(X[parents[k]]), read_pose(placements[k]))
        if code != WORLD:
            moved = relative_pose(here, moved)
        if code == LOCAL_WORLD_ALIGNED:
            moved = Pose(matmul(here.R, moved.R), rotate(here.R, moved.p))
        write_tangent(out[:, 6 * k - 6 : 6 * k], Tangent(moved.R, matmul(skew(moved.p), moved.R)))
        k = parents[k]


@inline
def _composite_bodies(X: Any, bodies: Any, parents: Any, out: Any) -> None:
    """Inertias (njoints, 10) of all subtrees in the world, row 0 the robot's, from bodies in their joints' frames."""
    for k in range(len(out)):
        for j in range(10):
            out[k, j] = 0.0
        if k > 0:
            write_body(out[k], body_to_parent(read_pose(X[k]), read_body(bodies[k])))
    for k in range(len(out) - 1, 0, -1):
        write_body(out[parents[k]], add_bodies(read_body(out[parents[k]]), read_body(out[k])))


@routine((6, "columns"), **OF_FRAME)
def frame_kinematic_regressor(
    k: int, code: int, poses: int, in_parents: int, parents: int, njoints: int, frames: Frames, out: Any
) -> bool:
    """``_kinematic_regressor`` of a frame, but not of the universe."""
    if k == 0:
        return False
    out[:] = 0.0
    X, P, up = at(poses, (njoints, 4, 4)), at(in_parents, (njoints, 4, 4)), places(parents, (njoints,))
    _kinematic_regressor(X, P, up, word(frames.joints, k), at(word(frames.placements, k), (4, 4)), code, out)
    return True


@routine(q=("nq",))
def place_robot_inertia(
    q: Any, table: int, njoints: int, bodies: int, parents: int, poses: int, sums: int, Ig: int
) -> bool:
    """The inertia (10,) of the robot about its centre of mass; scratch: ``poses``, and ``sums`` (njoints, 10)."""
    X, composite, out = at(poses, (njoints, 4, 4)), at(sums, (njoints, 10)), at(Ig, (10,))
    if _forward_kinematics(table, q, X) != OK:
        return False
    _composite_bodies(X, at(bodies, (njoints, 10)), places(parents, (njoints,)), composite)
    for i in range(10):
        out[i] = 0.0 if 1 <= i <= 3 else composite[0, i]
    return True


kinematic_regressor, composite_bodies = compiled(_kinematic_regressor), compiled(_composite_bodies)
