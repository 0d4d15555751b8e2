"""Contacts of Pinocchio's ``RigidConstraintModel``: J, γ and errors, and dynamics under them as a builtin.

A contact is an array (38,): rows (3 or 6), whether they are in the axes of the world (1), joint 1, joint 2, gains Kp
and Kd, and the placements of its frames on these joints. What is computed of it is an array (78,): force (6), poses of
both frames in the world and of the second in the first (16 each), velocities of both, errors of placement and velocity.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...algebra.euclidean import rotate, scale
from ...algebra.public_arrays import (
    read_motion,
    read_vec,
    write_motion,
    write_pose,
    write_vec,
)
from ...algebra.scalars import inline
from ...algebra.spatial import Motion, add_motion, cross_motion, motion_to_parent, scale_motion, sub_motion, zero_motion
from ...engines.compiled.memory import at, table_at, word
from ...engines.compiled.numba_kernels import OK
from ...engines.programs.run.routine import routine
from ...recursions.constraints.kkt import constrained, solve_factored
from ...recursions.spec import LOCAL
from ...recursions.tree.kinematics import WORK, classical_acceleration, frame_jacobian, frame_motion
from .operators import log_pose, relative_pose
from .recorded_constraints import (
    Kept,
    behind_system,
    compute_bias,
    compute_M,
    copy_matrix,
    copy_vector,
    keep,
    system_at,
)

GIVEN, FOUND = 38, 78  # numbers of a contact, and of its data
ABSOLUTE, RELATIVE, MU, MOST, ITERATIONS, ABSOLUTE_RESIDUAL, RELATIVE_RESIDUAL = range(7)  # of ProximalSettings


class Contacts(NamedTuple):
    """Words: the number of contacts, addresses of arrays of addresses: of contacts and of their data; of the rows of
    joints.
    """

    size: int
    given: int
    found: int
    rows: int


@inline
def _write(out: Any, m: Motion, point: bool) -> None:
    write_vec(out, m.v)
    if not point:
        write_vec(out, m.w, 3)


@inline
def put_contact(
    bodies: Any, work: Any, q: Any, v: Any, rows: Any, c: Any, own: Any, J1: Any, J2: Any, J: Any, g: Any
) -> None:
    """Write J (rows, nv) and γ (rows,) of a contact with J a + γ = 0, and its data; J1, J2 (6, nv) are scratch.

    γ is the acceleration of frame 1 seen from frame 2 at a = 0, and errors times the gains. In the axes of the world
    Pinocchio leaves out the term that is 0 where J v is.
    """
    point, aligned = c[0] == 3.0, c[1] == 1.0
    X1, V1, A1 = frame_motion(bodies, work, q, v, None, int(rows[int(c[2])]), c[6:22].reshape(4, 4))
    X2, V2, A2 = frame_motion(bodies, work, q, v, None, int(rows[int(c[3])]), c[22:38].reshape(4, 4))
    frame_jacobian(bodies, work, q, int(rows[int(c[2])]), c[6:22].reshape(4, 4), LOCAL, J1)
    frame_jacobian(bodies, work, q, int(rows[int(c[3])]), c[22:38].reshape(4, 4), LOCAL, J2)
    M = relative_pose(X1, X2)
    if point:
        error = Motion(zero_motion().w, scale(-1.0, M.p))
        drift = Motion(zero_motion().w, rotate(M.R, classical_acceleration(A2, V2).v))
        drift = sub_motion(classical_acceleration(A1, V1), drift)
        rate = Motion(zero_motion().w, rotate(M.R, V2.v))
    else:
        error, rate = scale_motion(-1.0, log_pose(M)), motion_to_parent(M, V2)
        drift = sub_motion(A1, motion_to_parent(M, A2))
        if not aligned:
            drift = add_motion(drift, cross_motion(V1, rate))
    rate = sub_motion(V1, rate)
    own[:] = 0.0
    write_pose(own[6:22].reshape(4, 4), X1)
    write_pose(own[22:38].reshape(4, 4), X2)
    write_pose(own[38:54].reshape(4, 4), M)
    write_motion(own[54:60], V1)
    write_motion(own[60:66], V2)
    _write(own[66:72], error, point)
    _write(own[72:78], rate, point)
    for i in range(-1, J.shape[1]):
        if i < 0:
            m = add_motion(drift, add_motion(scale_motion(c[5], rate), scale_motion(c[4], error)))
        elif point:
            m = Motion(zero_motion().w, rotate(M.R, read_vec(J2[:, i])))
            m = sub_motion(read_motion(J1[:, i]), m)
        else:
            m = sub_motion(read_motion(J1[:, i]), motion_to_parent(M, read_motion(J2[:, i])))
        if aligned:
            m = Motion(rotate(X1.R, m.w), rotate(X1.R, m.v))
        _write(g if i < 0 else J[:, i], m, point)


@inline
def put_contacts(bodies: Any, work: Any, q: Any, v: Any, rows: Any, given: Any, found: Any, J: Any, g: Any) -> int:
    """``put_contact`` of contacts (n, 38), their rows one after the other; found (n, 78) is written. Returns 0."""
    J1, J2, first = np.empty((6, J.shape[1])), np.empty((6, J.shape[1])), 0
    for k in range(len(given)):
        end = first + int(given[k, 0])
        put_contact(bodies, work, q, v, rows, given[k], found[k], J1, J2, J[first:end], g[first:end])
        first = end
    return 0


@inline
def solve_proximally(bodies: Any, J: Any, r: Any, g: Any, s: Any, L: Any, Y: Any, C: Any, x: Any, force: Any) -> None:
    """Iterate J x + γ = -mu (λ - λ before) from a solution x, λ of the first, with its factors; writes the settings."""
    mu, before, shifted = s[MU], np.zeros(len(g)), np.empty(len(g))
    for k in range(max(1, int(s[MOST]))):
        if k > 0:
            for i in range(len(x)):
                x[i] = r[i]
            for i in range(len(g)):
                before[i] = force[i]
                shifted[i] = g[i] - mu * force[i]
            solve_factored(bodies, shifted, L, Y, C, x, force)
        step, largest, residual = 0.0, 0.0, 0.0
        for i in range(len(g)):
            step, largest = max(step, abs(force[i] - before[i])), max(largest, abs(force[i]))
            y = g[i]
            for j in range(len(x)):
                y += J[i, j] * x[j]
            residual = max(residual, abs(y))
        s[ITERATIONS], s[ABSOLUTE_RESIDUAL], s[RELATIVE_RESIDUAL] = k + 1.0, residual, step
        if mu == 0.0 or residual <= s[ABSOLUTE] or step <= s[RELATIVE] * largest:
            break


@inline
def rows_of(contacts: Contacts) -> int:
    """How many rows the contacts have; 0 if one is in the axes of the world at its origin."""
    size = 0
    for k in range(contacts.size):
        c = at(word(contacts.given, k), (GIVEN,))
        if c[1] > 1.0:
            return 0
        size += int(c[0])
    return size


@inline
def put_all(table: int, njoints: int, contacts: Contacts, q: Any, v: Any, J1: Any, J2: Any, J: Any, g: Any) -> None:
    """``put_contact`` of contacts in memory, their rows one after the other."""
    bodies, rows, first = table_at(table), at(contacts.rows, (njoints,)), 0
    work = np.empty(len(bodies), WORK)
    for k in range(contacts.size):
        c, own = at(word(contacts.given, k), (GIVEN,)), at(word(contacts.found, k), (FOUND,))
        end = first + int(c[0])
        put_contact(bodies, work, q, v, rows, c, own, J1, J2, J[first:end], g[first:end])
        first = end


@inline
def share(contacts: Contacts, force: Any) -> None:
    """Write each contact's part of the forces to its data."""
    first = 0
    for k in range(contacts.size):
        own, count = at(word(contacts.found, k), (FOUND,)), int(at(word(contacts.given, k), (GIVEN,))[0])
        copy_vector(force[first : first + count], own)
        first += count


@routine(("nv",), q=("nq",), v=("nv",), tau=("nv",), settings=(7,))
def contact_dynamics(
    q: Any, v: Any, tau: Any, settings: Any,
    table: int, nv: int, njoints: int, m: int, contacts: Contacts, bias: int, kept: Kept, scratch: int, out: Any,
) -> bool:  # fmt: skip
    """Accelerations under contacts, but dependent ones; it writes the settings. q, v and a are to be recorded."""
    mu = settings[MU]
    if rows_of(contacts) != m or not mu >= 0.0:
        return False
    s, room = system_at(scratch, nv, m), behind_system(scratch, nv, m)
    r, b, J = at(room, (nv,)), at(room + 8 * nv, (nv,)), at(room + 16 * nv, (m, nv))
    J1, J2 = at(room + 8 * (2 + m) * nv, (6, nv)), at(room + 8 * (8 + m) * nv, (6, nv))
    if compute_M(table, q, s.M) != OK or compute_bias(table, q, v, b) != OK:
        return False
    put_all(table, njoints, contacts, q, v, J1, J2, J, s.g)
    for i in range(nv):
        r[i] = tau[i] - b[i]
    if constrained(table_at(table), s.M, J, r, s.g, mu, s.L, s.Y, s.C, s.x, s.force) != m:
        return False
    solve_proximally(table_at(table), J, r, s.g, settings, s.L, s.Y, s.C, s.x, s.force)
    copy_vector(s.x, out)
    share(contacts, s.force)
    keep(s, kept)
    copy_vector(b, at(bias, (nv,)))
    return True


@routine(("nv",), q=("nq",), v=("nv",), e=(), settings=(7,))
def contact_impact(
    q: Any, v: Any, e: float, settings: Any,
    table: int, nv: int, njoints: int, m: int, contacts: Contacts, M: int, kept: Kept, scratch: int, out: Any,
) -> bool:  # fmt: skip
    """Velocities after an impact of contacts, but dependent ones, of restitution e; q and the result are to be
    recorded.
    """
    mu = settings[MU]
    if rows_of(contacts) != m or not mu >= 0.0 or not 0.0 <= e <= 1.0:
        return False
    s, room = system_at(scratch, nv, m), behind_system(scratch, nv, m)
    r, J = at(room, (nv,)), at(room + 16 * nv, (m, nv))
    J1, J2 = at(room + 8 * (2 + m) * nv, (6, nv)), at(room + 8 * (8 + m) * nv, (6, nv))
    if compute_M(table, q, s.M) != OK:
        return False
    put_all(table, njoints, contacts, q, v, J1, J2, J, s.g)
    for k in range(m):
        s.g[k] = 0.0
        for i in range(nv):
            s.g[k] += (1.0 + e) * J[k, i] * v[i]
    for i in range(nv):
        r[i] = 0.0
    if constrained(table_at(table), s.M, J, r, s.g, mu, s.L, s.Y, s.C, s.x, s.force) != m:
        return False
    solve_proximally(table_at(table), J, r, s.g, settings, s.L, s.Y, s.C, s.x, s.force)
    for i in range(nv):
        out[i] = v[i] + s.x[i]
    share(contacts, s.force)
    keep(s, kept)
    copy_matrix(s.M, at(M, (nv, nv)))
    return True
