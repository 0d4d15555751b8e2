"""Contacts of Pinocchio's ``RigidConstraintModel``: J, γ and errors, and dynamics under them as a builtin.

A contact is an array (38,): rows (3 or 6), whether they are in the axes of the world (1), joint 1, joint 2, gains Kp
and Kd, and the placements of its frames on these joints. What is computed of it is an array (78,): force (6), poses of
both frames in the world and of the second in the first (16 each), velocities of both, errors of placement and velocity.
"""

from __future__ import annotations

from functools import cache
from typing import Any

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
from ...engines.compiled import numba_kernels
from ...engines.programs.run.routine import Kind, Routine
from ...recursions.constraints.kkt import solve_factored
from ...recursions.spec import LOCAL
from ...recursions.tree.kinematics import WORK, classical_acceleration, frame_jacobian, frame_motion
from .operators import log_pose, relative_pose
from .recorded_calls import SIZES
from .recorded_constraints import KEEP, KEPT, scope_of_constraints, take_scratch

GIVEN, FOUND = 38, 78  # numbers of a contact, and of its data
ABSOLUTE, RELATIVE, MU, MOST, ITERATIONS, ABSOLUTE_RESIDUAL, RELATIVE_RESIDUAL = range(7)  # of ProximalSettings


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


@cache
def contact_dynamics() -> Routine:
    """``(q, v, tau, settings (7,)) -> a`` under contacts, but dependent ones; it writes the settings.

    Words: table, sizes, m, number of contacts, addresses of arrays of addresses: contacts, data; of the rows of joints;
    bias, factors, clock, stamp, scratch. q, v and a are to be recorded.
    """
    body = [
        "size = 0.0",
        "for k in range(count):",
        f"    size += at(word(contacts, k), ({GIVEN},))[0]",
        f"    if at(word(contacts, k), ({GIVEN},))[1] > 1.0: return 0",
        f"if size != m or not s[{MU}] >= 0.0: return 0",
        *take_scratch(M="nv, nv", x="nv", r="nv", b="nv", L="nv, nv", Y="m, nv", C="m, m", force="m", g="m"),
        *take_scratch(J="m, nv", J1="6, nv", J2="6, nv"),
        f"if mass_matrix(table, q_in, M_in) != {numba_kernels.OK}: return 0",
        f"if bias_of(table, q_in, v_in, b_in) != {numba_kernels.OK}: return 0",
        "bodies, first = table_at(table), 0",
        "work = empty(len(bodies), WORK)",
        "for k in range(count):",
        f"    c, own = at(word(contacts, k), ({GIVEN},)), at(word(datas, k), ({FOUND},))",
        "    end = first + int(c[0])",
        "    J_own, g_own = J_in[first:end], g_in[first:end]",
        "    put(bodies, work, q_in, v_in, at(rows, (njoints,)), c, own, J1_in, J2_in, J_own, g_own)",
        "    first = end",
        "for i in range(nv): r_in[i] = tau_in[i] - b_in[i]",
        f"if solve(bodies, M_in, J_in, r_in, g_in, s[{MU}], L_in, Y_in, C_in, x_in, force_in) != m: return 0",
        "proximally(bodies, J_in, r_in, g_in, s, L_in, Y_in, C_in, x_in, force_in)",
        "copy(x_in, out)",
        "first = 0",
        "for k in range(count):",
        f"    own, rows_of = at(word(datas, k), ({FOUND},)), int(at(word(contacts, k), ({GIVEN},))[0])",
        "    for i in range(rows_of): own[i] = force_in[first + i]",
        "    first += rows_of",
        *KEEP,
        "copy(b_in, at(bias, (nv,)))",
        "return 1",
    ]
    words = ["table", *SIZES, "m", "count", "contacts", "datas", "rows", "bias", *KEPT]
    inputs: dict[str, Kind] = {"q_in": ("nq",), "v_in": ("nv",), "tau_in": ("nv",), "s": (7,)}
    scope = {**scope_of_constraints(), "put": put_contact, "proximally": solve_proximally, "WORK": WORK}
    return Routine("contact_dynamics", words, inputs, body, scope, ("nv",))
