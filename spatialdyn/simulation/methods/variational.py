"""A variational integrator in O(n), on the joints' group: discrete mechanics of the bodies' average velocities.

In a step each body moves from its pose T_i to T_i exp(h V_i). The discrete Lagrangian, h times the kinetic energy
Σ ½ V_i·I_i V_i less the mean of the potential energy at both ends, has the momenta

    μ⁻_i = (dexp⁻¹ at +h V_i)ᵀ I_i V_i    at the beginning, in the body's frame there
    μ⁺_i = (dexp⁻¹ at -h V_i)ᵀ I_i V_i    at the end, in the body's frame there

With Jᵀ the inward sweep of the RNEA, a step solves J(q)ᵀ μ⁻ = p + ½ h f(q) for the displacement ξ of the joints,
q⁺ = q ∘ exp(ξ), and sets p⁺ = J(q⁺)ᵀ μ⁺ + ½ h f(q⁺), with f the sum of joint, gravity and external torques. The map is
symplectic, symmetric without torques, and preserves the momentum of a free robot whatever its joints do. ξ changes by
-h M⁻¹ r, with r the residual, until it changes no longer; ``anderson_step`` accelerates slow iterations.

Armatures add armature ξ to both momenta, so that the step solves M a + C v + g = τ with armatures on the diagonal of M,
as all methods do. On joints of one freedom, and on balls with one armature for all their axes, that is the discrete
mechanics of ½ armature v². On other joints with armatures no Lagrangian has these equations
(``lagrangian.hamiltonian``): the step is of order 2 and symmetric, but preserves neither Ω nor momenta of symmetries.

Displacements of bodies are stored as (quaternion, translation): both keep their relative accuracy however small the
step, so the rounding error of a momentum is 1e-16 of it, not 1e-16 / h.

Source: Lee, Liu, Park, Srinivasa, A linear-time variational integrator for multibody systems (2016), for the use of M⁻¹
in O(n); the form in (q, p) and on joints of several freedoms is derived here.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...algebra.euclidean import Vec, add, cross, dot, scale, unrotate, zero
from ...algebra.lie import Quat, Tangent, exp_rotation, exp_travel, log_jacobian, log_rotation, log_travel, product
from ...algebra.records import (
    force_of,
    inertia_of,
    motion_of,
    pose_of,
    put_force,
    put_vec,
    table_dtype,
    vec_of,
)
from ...algebra.scalars import inline, inline_or_by_rows, inline_unoptimized
from ...algebra.spatial import Force, Motion, Pose, add_force, force_to_parent, momentum, power, zero_force
from ...bodies.joints import joint_motion, place_joint
from ...bodies.kinds import CONTINUED
from ...engines.compiled import numba_kernels
from ...engines.compiled.table_kernels import kernel
from ...recursions import SPECS
from ...recursions.tree.rotors import of_other
from ..system import OK, TURNED, State, System, copy, set_status
from .symplectic import LARGEST, SLOW, SWEEPS, anderson_step, converged, relative

ROWS = 17
TURN = 0.5  # cosine of half the angle by which a body may turn in one step, 120°
WORK_BEFORE = table_dtype(X=Pose, x=float, y=float, z=float, w=float, d=Vec, p=Force)
WORK_AFTER = table_dtype(X=Pose, p=Force)


class VariationalKernels(NamedTuple):
    """load(system, q, g), which writes the torques g that balance gravity and ``fext``, and compiled kernels."""

    load: Any
    static_torque: Any
    velocity: Any
    integrate: Any
    before: Any
    after: Any


def kernels(loaded: bool) -> VariationalKernels:
    """The kernels of the method, compiled at first use; ``loaded``: with external forces."""
    return VariationalKernels(
        _loaded if loaded else _free,
        numba_kernels.sample_kernel(SPECS["static_torque" if loaded else "generalized_gravity"]),
        numba_kernels.sample_kernel(SPECS["velocity_from_momentum"]),
        numba_kernels.sample_kernel(SPECS["integrate"]),
        kernel(momenta_before, 1, 1, 2, 1, work=WORK_BEFORE),
        kernel(momenta_after, 1, 1, 2, 1, work=WORK_AFTER),
    )


@inline_unoptimized
def _free(system: System, q: Any, g: Any) -> int:
    return system.kernels.static_torque(system.table, q, g)  # type: ignore[no-any-return]


@inline_unoptimized
def _loaded(system: System, q: Any, g: Any) -> int:
    return system.kernels.static_torque(system.table, q, system.fext, g)  # type: ignore[no-any-return]


# --- the sweeps -----------------------------------------------------------------------------------------


@inline
def momenta_before(bodies: Any, work: Any, q: Any, xi: Any, moved: Any, out: Any) -> int:
    """h J(q)ᵀ μ⁻: the momenta at the beginning of a step of unit length.

    q      (nq)         coordinates at the beginning of the step
    xi     (nv)         displacement of the joints
    moved  (rows + 1, 6)  written: the twist log(T⁻¹ T⁺) = h V of every body, angular first
    out    (nv)         written
    Returns TURNED where a body turns by more than 120°, else OK.
    """
    sum_before(bodies, work, q, xi, moved, out)
    status = OK
    for i in range(1, len(bodies)):
        if bodies[i].joint > 0 and not work[i].w > TURN:
            status = TURNED
    return status


@inline_or_by_rows
def sum_before(bodies: Any, work: Any, q: Any, xi: Any, moved: Any, out: Any) -> None:
    """``momenta_before`` without looking at the turns: cosines of half of them are in the scratch."""
    _put_displacement(work[0], Quat(0.0, 0.0, 0.0, 1.0), zero())
    put_force(work[0].p, zero_force())
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        place_joint(bodies, i, q, here.X)
        X = pose_of(here.X)
        a, d = _carried(X, Quat(parent.x, parent.y, parent.z, parent.w), vec_of(parent.d))
        if b.kind != CONTINUED:
            m = joint_motion(bodies, i, xi)
            t = exp_travel(m)
            a, d = product(a, exp_rotation(m.w)), add(add(d, t), _turned(a, t))
        _put_displacement(here, a, d)
        put_force(here.p, zero_force())
        if b.joint > 0:
            w = log_rotation(a)
            V = Motion(w, log_travel(w, d))
            _put_twist(moved[i], V)
            put_force(here.p, _dual(log_jacobian(V, -1.0), -1.0, momentum(inertia_of(b.inertia), V)))
        if b.geared:
            _add_spin(bodies, work, i, moved, xi, -1.0)
    _sum_inward(bodies, work, out)
    _add_rotors(bodies, xi, out)
    _add_along(bodies, moved, out)


@inline_or_by_rows
def momenta_after(bodies: Any, work: Any, q: Any, xi: Any, moved: Any, out: Any) -> int:
    """h J(q⁺)ᵀ μ⁺, the momenta at the end of a step of unit length; q is q⁺, and ``moved`` is read."""
    put_force(work[0].p, zero_force())
    for i in range(1, len(bodies)):
        b, here = bodies[i], work[i]
        place_joint(bodies, i, q, here.X)
        put_force(here.p, zero_force())
        if b.joint > 0:
            V = _twist(moved[i])
            put_force(here.p, _dual(log_jacobian(V, 1.0), 1.0, momentum(inertia_of(b.inertia), V)))
        if b.geared:
            _add_spin(bodies, work, i, moved, xi, 1.0)
    _sum_inward(bodies, work, out)
    _add_rotors(bodies, xi, out)
    _add_along(bodies, moved, out)
    return OK


@inline
def _add_spin(bodies: Any, work: Any, i: int, moved: Any, xi: Any, side: float) -> None:
    """Add the momentum n J ξ e of the rotor of row i to that of the body that carries it."""
    parent = work[bodies[i].parent]
    spun = Force(scale(xi[i - 1], vec_of(bodies[i].rotor)), zero())
    V = _twist(moved[bodies[i].parent])
    put_force(parent.p, add_force(force_of(parent.p), _dual(log_jacobian(V, side), side, spun)))


@inline
def _add_along(bodies: Any, moved: Any, out: Any) -> None:
    """out += n J e·w of the rotors, w the turn of the body that carries it: the discrete energy has n J ξ e·w."""
    for i in range(1, len(bodies)):
        if bodies[i].geared:
            out[i - 1] += dot(vec_of(bodies[i].rotor), _twist(moved[bodies[i].parent]).w)


@inline
def _sum_inward(bodies: Any, work: Any, out: Any) -> None:
    """out_i = S_i · (sum of the momenta of the subtree of row i)."""
    for i in range(len(bodies) - 1, 0, -1):
        here, parent = work[i], work[bodies[i].parent]
        p = force_of(here.p)
        out[i - 1] = power(motion_of(bodies[i].S), p)
        put_force(parent.p, add_force(force_of(parent.p), force_to_parent(pose_of(here.X), p)))


@inline
def _add_rotors(bodies: Any, xi: Any, out: Any) -> None:
    """out += armature ξ, and what motors of two joints add: the same at both ends of a step, on every joint.

    As in M a + C v, where an armature multiplies the acceleration only. On a joint that turns its own axes a Lagrangian
    ½ armature v² would have the momentum's rate ω × p beside it, by the dual of dexp⁻¹.
    """
    for i in range(1, len(bodies)):
        out[i - 1] += bodies[i].armature * xi[i - 1] + of_other(bodies, i, xi)


@inline
def _dual(T: Tangent, side: float, f: Force) -> Force:
    """side Tᵀ f."""
    return Force(
        scale(side, add(unrotate(T.J, f.n), unrotate(T.K, f.f))),
        scale(side, unrotate(T.J, f.f)),
    )


@inline
def _turned(a: Quat, p: Vec) -> Vec:
    """(R(a) - 1) p, accurate for a small rotation."""
    u = Vec(a.x, a.y, a.z)
    s = cross(u, p)
    return scale(2.0, add(scale(a.w, s), cross(u, s)))


@inline
def _carried(X: Pose, a: Quat, d: Vec) -> tuple[Quat, Vec]:
    """A displacement (a, d) of the parent frame, in the frame X: X⁻¹ (a, d) X."""
    u = unrotate(X.R, Vec(a.x, a.y, a.z))
    return Quat(u.x, u.y, u.z, a.w), unrotate(X.R, add(d, _turned(a, X.p)))


@inline
def _put_displacement(here: Any, a: Quat, d: Vec) -> None:
    here.x, here.y, here.z, here.w = a.x, a.y, a.z, a.w
    put_vec(here.d, d)


@inline
def _put_twist(row: Any, m: Motion) -> None:
    row[0], row[1], row[2] = m.w.x, m.w.y, m.w.z
    row[3], row[4], row[5] = m.v.x, m.v.y, m.v.z


@inline
def _twist(row: Any) -> Motion:
    return Motion(Vec(row[0], row[1], row[2]), Vec(row[3], row[4], row[5]))


# --- the method -----------------------------------------------------------------------------------------


@inline_unoptimized
def start(system: System, state: State) -> None:
    """Nothing to do: the method works on (q, p) itself."""


@inline_unoptimized
def observe(system: System, t: float, state: State) -> None:
    """v = M⁻¹ p."""
    set_status(system, system.kernels.velocity(system.table, state.q, state.w, state.v), t)


@inline_unoptimized
def variational(system: System, t: float, h: float, state: State) -> None:
    """One step; the torques at both ends are those of the average velocity ξ/h, which keeps the order at 2."""
    n, k = len(system.tau), system.kernels
    xi, old, older = state.work[0], state.work[1], state.work[2]
    mean, g, left, change = state.work[3], state.work[4], state.work[5], state.work[6]
    F, U = state.work[7:12], state.work[12:17]
    straight = 0.0  # 1 once two displacements are known: the guess extrapolates them
    for i in range(n):
        straight = 1.0 if old[i] != 0.0 else straight
    for i in range(n):
        older[i], old[i], xi[i] = old[i], xi[i], xi[i] + straight * (xi[i] - old[i])
    set_status(system, k.load(system, state.q, g), t)
    before, known = math.inf, 0
    for sweep in range(SWEEPS):
        for i in range(n):
            mean[i] = xi[i] / h
        system.torque(system, t, state.q, mean)
        set_status(system, k.before(system.table, state.q, xi, state.by_row, left), t)
        for i in range(n):
            left[i] = left[i] / h - state.w[i] - 0.5 * h * (system.tau[i] - g[i])
        set_status(system, k.velocity(system.table, state.q, left, change), t)
        moved = size = 0.0
        for i in range(n):
            change[i] *= -h
            if not abs(change[i]) <= LARGEST:
                moved = math.inf
            xi[i] += change[i]
            change[i] *= system.unit[i]
            moved = max(moved, abs(change[i]))
            size = max(size, system.unit[i] * (abs(xi[i]) + abs(old[i])))
        moved = relative(moved, size)
        if converged(system, t, moved, before, sweep, False, known > 0):
            break
        if known > 0 or moved > SLOW * before:
            anderson_step(known, change, xi, F, U)
            known += 1
        before = moved
    copy(state.stage, state.q)
    set_status(system, k.integrate(system.table, state.stage, xi, state.q), t + h)
    set_status(system, k.before(system.table, state.stage, xi, state.by_row, left), t)
    set_status(system, k.after(system.table, state.q, xi, state.by_row, left), t + h)
    set_status(system, k.load(system, state.q, g), t + h)
    for i in range(n):
        mean[i] = xi[i] / h
    system.torque(system, t + h, state.q, mean)
    for i in range(n):
        state.w[i] = left[i] / h + 0.5 * h * (system.tau[i] - g[i])
