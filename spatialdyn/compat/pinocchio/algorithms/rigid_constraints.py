"""Dynamics of contacts and loops, ``RigidConstraintModel``, under Pinocchio's names.

A contact is a Jacobian J of frame 1 seen from frame 2, in the axes of frame 1 (LOCAL) or of the world, and γ with
J a + γ = 0, errors times the gains of Baumgarte included. ``constraints.contact`` solves them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ....constraints.contact import Solved, inverse, solve
from ....engines.compiled import numba_kernels, table_kernels
from ....engines.programs.run.routine import Routine
from ....errors import ConstraintError, ShapeError, SimulationError
from ....recursions.tree.kinematics import WORK
from ...native.recorded_calls import record
from ...native.recorded_constraints import words_of_factors
from ...native.recorded_contacts import FOUND, GIVEN, contact_dynamics, contact_impact, put_contacts
from ..data.data import Data, library_of
from ..data.dispatch import IN_FRAME, forces, last_call, vector
from ..data.run import Run
from ..explog import Jlog6
from ..model.constraints import ContactType, ProximalSettings, RigidConstraintData, RigidConstraintModel
from ..model.model import Model
from ..types.arguments import ArgumentError, Array, all_expected, described, expected, number
from ..types.frame import Convention, ReferenceFrame
from ..types.motion import Force, Motion
from ..types.se3 import SE3
from .calls import computeAllTerms, crba
from .jacobians import Inputs, call_about_frame

__all__ = [
    "computeConstraintDynamicsDerivatives", "computeDelassusMatrix", "constraintDynamics", "getConstraintJacobian",
    "getConstraintsJacobian", "initConstraintDynamics",
]  # fmt: skip


class Side(NamedTuple):
    """A frame of a contact: its pose, and in its own axes J (6, nv), velocity and acceleration (6,)."""

    X: SE3
    J: Array
    V: Array
    A: Array


class Contact(NamedTuple):
    """A contact at a state, for derivatives: frame 2 from frame 1, J (rows, nv) in the axes of frame 1.

    turn  (rows, rows) takes rows and forces to the axes of the reference frame
    """

    model: RigidConstraintModel
    sides: tuple[Side, Side]
    M: SE3
    J: Array
    turn: Array


# --- J and γ ---------------------------------------------------------------------------------------------


def _cross(V: Array) -> Array:
    """The matrix of V × on motions, linear first; its negative transpose is that on forces."""
    return np.asarray(Motion(V).action)


def _side(at: Any, joint: int, placement: SE3) -> Side:
    """A frame at q, v and a."""
    if joint == 0:
        return Side(SE3(placement), np.zeros((6, len(at.v))), np.zeros(6), np.zeros(6))
    where = joint, placement._x
    J = call_about_frame("frame_jacobian", at, *where, IN_FRAME)
    A = call_about_frame("frame_acceleration", at, *where, IN_FRAME, 0)
    return Side(SE3.over(call_about_frame("frame_placement", at, *where)), J, J @ at.v, A)


def _point(side: Side) -> Array:
    """The classical acceleration of a frame's origin, A + ω × v."""
    return np.asarray(side.A[:3] + np.cross(side.V[3:], side.V[:3]))


def _contact(at: Any, model: RigidConstraintModel) -> Contact:
    """A contact at q, v, a."""
    one = _side(at, model.joint1_id, model.joint1_placement)
    two = _side(at, model.joint2_id, model.joint2_placement)
    M, n = one.X.actInv(two.X), model.residualSize()
    J = one.J[:3] - M.rotation @ two.J[:3] if n == 3 else one.J - M.action @ two.J
    aligned = model.reference_frame == ReferenceFrame.LOCAL_WORLD_ALIGNED
    turn = np.kron(np.eye(n // 3), one.X.rotation if aligned else np.eye(3))
    return Contact(model, (one, two), M, J, np.asarray(turn, float))


def pairs_of(models: Any, datas: Any) -> list[tuple[RigidConstraintModel, RigidConstraintData]]:
    """Contacts and their data, checked."""
    for x, kind in ((models, RigidConstraintModel), (datas, RigidConstraintData)):
        if not isinstance(x, list):
            raise ArgumentError(f"contacts are {described(x)}, expected a list of {kind.__name__}")
        all_expected(x, kind, "contacts")
    if len(models) != len(datas):
        raise ShapeError(f"{len(models)} contacts have {len(datas)} data, expected one for each")
    for model in models:
        if model.reference_frame == ReferenceFrame.WORLD:
            raise ConstraintError(f'reference_frame of "{model.name}" is WORLD, expected LOCAL or LOCAL_WORLD_ALIGNED')
    return list(zip(models, datas, strict=True))


def system_of(at: Any, pairs: Any, write: bool = True) -> tuple[Array, Array]:
    """J (m, nv) and γ (m,) of contacts; ``write``: placements, velocities and errors are written to their data."""
    library, (n, m) = at.library, (len(pairs), sum(x.residualSize() for x, _ in pairs))
    given, found = np.array([x._x for x, _ in pairs]).reshape(n, GIVEN), np.empty((n, FOUND))
    J, gamma, rows = np.empty((m, library.tree_nv)), np.empty(m), library.row_numbers
    run = table_kernels.kernel(put_contacts, 1, 1, 1, 2, 2, 2, 1, work=WORK)
    run(getattr(library.model, numba_kernels.TABLE), *library.of_tree(at.q, at.v), rows, given, found, J, gamma)
    for x, (_, own) in zip(found, pairs, strict=True):
        own._x[6:] = x[6:] if write else own._x[6:]
    return library.of_joints(J), gamma


def _six(x: Array) -> Array:
    """Three numbers and three zeros, or six numbers."""
    made = np.zeros(6)
    made[: len(x)] = x
    return made


def _at(model: Model, data: Data, q: Any, v: Any = None, a: Any = None) -> Any:
    """A state, as the calls about a frame take it."""
    v = np.zeros(model.nv) if v is None else v
    library = library_of(model, data)
    return Inputs(library, library.state, q, v, a)


# --- calls -----------------------------------------------------------------------------------------------


def initConstraintDynamics(model: Model, data: Data, contact_models: Any, contact_datas: Any) -> None:
    """Check a list of RigidConstraintModel and their RigidConstraintData, for the size of ``data.constraint_chol``."""
    library_of(model, data)
    data.contacts = pairs_of(contact_models, contact_datas), ProximalSettings()


def constraintDynamics(
    model: Model, data: Data, q: Any, v: Any, tau: Any, contact_models: Any, contact_datas: Any,
    prox_settings: ProximalSettings | None = None,
) -> Array:  # fmt: skip
    """Accelerations a (nv,) under contacts: M a + b = τ + Jᵀ λ and J a + γ = 0; also ``data.ddq``, with λ in
    ``data.lambda_c`` and in the contacts' ``contact_force``.

    q, v, tau                      (nq,), (nv,), (nv,)
    contact_models, contact_datas  lists of RigidConstraintModel and RigidConstraintData
    prox_settings                  a ProximalSettings; with mu = 0, the default, the contacts have to be independent

    Raises ConstraintError naming the rank of contacts that are not independent, if mu is 0; as ``rnea``
    """
    settings = None
    try:
        library, models, datas, before, run, solved, call = data._bound[contact_dynamics]
        if library is model._library and models == contact_models and datas == contact_datas:
            settings = _settings(prox_settings)
            found: Array | None = call(q, v, tau, settings._x)
            if found is None and library.follow():  # numbers were edited
                found = call(q, v, tau, settings._x)
            if found is not None:
                run.contact = solved
                if data.contacts[1] is not settings:  # an attribute of Data takes long to write
                    data.contacts = data.contacts[0], settings
                data.note_builtin_call(before)
                data.note_builtin_call(run)
                return found
    except (AttributeError, KeyError, TypeError):  # the fast path does not apply
        pass
    pairs, settings = pairs_of(contact_models, contact_datas), _settings(prox_settings)
    computeAllTerms(model, data, q, v)
    tau = vector("tau", tau, model.nv)
    every = data._runs["all"]
    J, gamma = system_of(every, pairs)
    solved = _solved(every, data.array("M"), tau - data.array("nle"), J, gamma, settings)
    run = data.run_of("contacts", every.library, solved.x.shape)
    run.result[...], run.contact = solved.x, solved
    _share(pairs, solved.force)
    data.note_call(run)
    data.contacts = pairs, settings
    _bind(contact_dynamics, data, every, run, pairs)
    return np.array(solved.x)


def _bind(make: Routine, data: Data, every: Run, run: Run, pairs: Any) -> None:
    """Bind the builtin of these contacts for later calls; it reads and writes the arrays of contacts and data."""
    library, f = every.library, run.contact
    if not library.has_builtins:
        return
    models, datas = [x for x, _ in pairs], [own for _, own in pairs]
    given, found = (np.array([one._x.ctypes.data for one in some], np.int64) for some in (models, datas))
    words = {**library.words, **words_of_factors(f), **every.words_before, "bias": every.result, "M": every.result}
    words |= {"rows": library.row_numbers, "size": len(pairs), "given": given, "found": found}
    noted = record(1 if make is contact_impact else 2, every.memory, run.result, run._stamp, library.table)
    call = make.bind(words, library, models, datas, every, run, record=noted)
    data._bound[make] = library, models, datas, every, run, f, call


def impulse_of_contacts(
    model: Model, data: Data, q: Any, v: Any, contact_models: Any, contact_datas: Any, r_coeff: Any = 0.0,
    prox_settings: ProximalSettings | None = None,
) -> Array:  # fmt: skip
    """``impulseDynamics`` of a list of contacts."""
    try:
        library, models, datas, before, run, solved, call = data._bound[contact_impact]
        if library is model._library and models == contact_models and datas == contact_datas:
            given = q, v, number(r_coeff, "r_coeff"), _settings(prox_settings)._x
            found: Array | None = call(*given)
            if found is None and library.follow():  # numbers were edited
                found = call(*given)
            if found is not None:
                run.contact = solved
                data.note_builtin_call(before)
                data.note_builtin_call(run)
                return found
    except (AttributeError, KeyError, TypeError):  # the fast path does not apply
        pass
    pairs, settings = pairs_of(contact_models, contact_datas), _settings(prox_settings)
    e = number(r_coeff, "r_coeff")
    if not 0.0 <= e <= 1.0:
        raise ConstraintError(f"r_coeff is {e}, expected 0 to 1")
    v = vector("v", v, model.nv)
    crba(model, data, q, Convention.WORLD)
    before = data._runs["crba_world"]
    J, _ = system_of(_at(model, data, before.q, v), pairs)
    solved = _solved(before, data.array("M"), np.zeros(model.nv), J, (1.0 + e) * (J @ v), settings)
    run = data.run_of("impact", before.library, solved.x.shape)
    run.result[...], run.contact = v + solved.x, solved
    _share(pairs, solved.force)
    data.note_call(run)
    _bind(contact_impact, data, before, run, pairs)
    return np.array(run.result)


def _settings(given: Any) -> ProximalSettings:
    found: ProximalSettings = _DEFAULT if given is None else expected(given, ProximalSettings, "settings")
    return found


_DEFAULT = ProximalSettings()


def _share(pairs: Any, force: Array) -> None:
    """Write each contact's force to its data."""
    first = 0
    for x, own in pairs:
        size = x.residualSize()
        own._x[:6] = _six(force[first : first + size])
        first += size


def _solved(at: Any, M: Array, r: Array, J: Array, gamma: Array, settings: ProximalSettings) -> Solved:
    """x and λ; with mu above 0 by proximal iterations J x + γ = -mu (λ - λ before)."""
    force, mu = np.zeros(len(gamma)), settings.mu
    for k in range(max(1, settings.max_iter)):
        solved = solve(at.library.model, M, r, J, gamma - mu * force, mu)
        settings.iter = k + 1
        settings.relative_residual = float(abs(solved.force - force).max(initial=0.0))
        settings.absolute_residual = float(abs(J @ solved.x + gamma).max(initial=0.0))
        small = settings.relative_accuracy * abs(solved.force).max(initial=0.0)
        force = solved.force
        if mu == 0.0 or settings.absolute_residual <= settings.absolute_accuracy or settings.relative_residual <= small:
            break
    return solved


def getConstraintsJacobian(model: Model, data: Data, constraint_models: Any, constraint_datas: Any) -> Array:
    """J (m, nv) of contacts, at the q of ``data.oMi``."""
    run = last_call(model, data, "oMi", before="computeJointJacobians")
    return system_of(_at(model, data, run.q.copy()), pairs_of(constraint_models, constraint_datas), False)[0]


def getConstraintJacobian(model: Model, data: Data, constraint_model: Any, constraint_data: Any) -> Array:
    """J (3 or 6, nv) of a contact, at the q of ``data.oMi``."""
    return getConstraintsJacobian(model, data, [constraint_model], [constraint_data])


def computeDelassusMatrix(
    model: Model, data: Data, q: Any, contact_models: Any, contact_datas: Any, mu: float = 0.0
) -> Array:
    """G = J M⁻¹ Jᵀ (m, m) of contacts; with mu above 0 (G⁻¹ + mu)⁻¹, as in Pinocchio."""
    M = crba(model, data, q)
    J = system_of(_at(model, data, vector("q", q, model.nq)), pairs_of(contact_models, contact_datas), False)[0]
    G = J @ np.linalg.solve(M, J.T)
    softened = np.linalg.solve(np.eye(len(G)) + number(mu, "mu") * G, G)
    return np.asarray(0.5 * (softened + softened.T))


# --- derivatives -----------------------------------------------------------------------------------------


def computeConstraintDynamicsDerivatives(
    model: Model, data: Data, contact_models: Any, contact_datas: Any, settings: ProximalSettings | None = None
) -> tuple[Array, ...]:
    """∂a and ∂λ by q, v and τ: ``ddq_dq, ddq_dv, ddq_dtau, dlambda_dq, dlambda_dv, dlambda_dtau``, at the inputs of the
    last constraintDynamics; also fields of ``data``.

    M a + b = τ + Jᵀ λ and J a + γ = 0 are differentiated: M ∂a - Jᵀ ∂λ = ∂(τ - b - M a + Jᵀ λ), J ∂a = -∂(J a + γ).
    Raises SimulationError if constraintDynamics was not called with these contacts.
    """
    pairs, run = pairs_of(contact_models, contact_datas), data._runs.get("contacts")
    _settings(settings)
    size = sum(x.residualSize() for x, _ in pairs)
    if run is None or len(run.contact.force) != size or library_of(model, data).state is not run.state:
        raise SimulationError("data holds no such contacts, expected constraintDynamics to be called before")
    solved, every = run.contact, data._runs["all"]
    at, n, m = _at(model, data, every.q, every.v, run.result), model.nv, size
    contacts = [_contact(at, x) for x, _ in pairs]
    fext, rows, first = [Force.Zero() for _ in range(model.njoints)], np.zeros((m, 2 * n)), 0
    by_force, turning = np.zeros((n, n)), np.zeros((m, n))
    for c in contacts:
        part = slice(first, first + len(c.J))
        force = c.turn.T @ solved.force[part]
        rows[part] = c.turn @ _rows_by_state(at, c)
        by_force += _load(c, force, fext)
        if c.model.reference_frame == ReferenceFrame.LOCAL_WORLD_ALIGNED:  # forces turn with frame 1
            w = c.sides[0].J[3:]
            turning[part] = c.turn @ np.vstack([np.cross(w, f, axisa=0, axisb=0).T for f in force.reshape(-1, 3)])
        first += len(c.J)
    given = forces(fext, at.library, model.njoints)
    by_q, by_v, _ = at.library.compute("rnea_derivatives", at.q, at.v, at.a, given)
    right = np.vstack([np.hstack([by_force - by_q, -by_v, np.eye(n)]), np.hstack([-rows, np.zeros((m, n))])])
    both = inverse(at.library.model, solved) @ right
    parts = [*np.hsplit(both[:n], 3), *np.hsplit(-both[n:], 3)]
    parts[3] = parts[3] + turning
    for name, x in zip(_PARTS, parts, strict=True):
        data.put(name, x)
    return tuple(parts)


_PARTS = ("ddq_dq", "ddq_dv", "ddq_dtau", "dlambda_dq", "dlambda_dv", "dlambda_dtau")


def _seen(c: Contact) -> Array:
    """The motion (6, nv) of frame 2 seen from frame 1, in its axes."""
    return np.asarray(c.M.toActionMatrix() @ c.sides[1].J - c.sides[0].J)


def _rows_by_state(at: Any, c: Contact) -> Array:
    """∂(J a + γ) by q and v (size, 2 nv), in the axes of frame 1."""
    rows = (c.model.joint1_id, c.model.joint1_placement._x), (c.model.joint2_id, c.model.joint2_placement._x)
    point, gains = c.model.type == ContactType.CONTACT_3D, c.model.m_baumgarte_parameters
    (A1_q, A1_v, _), (A2_q, A2_v, _) = (
        call_about_frame("frame_acceleration_derivatives", at, *where, IN_FRAME, int(point)) for where in rows
    )
    dV1, dV2 = (call_about_frame("frame_velocity_derivatives", at, *where, IN_FRAME)[0] for where in rows)
    one, two = c.sides
    S, X = _seen(c), c.M.toActionMatrix()
    if point:
        R = c.M.rotation

        def turned(x: Array) -> Array:
            """∂(R x) for a constant x."""
            return np.cross(S[3:], R @ x, axisa=0).T

        by_q, by_v = A1_q[:3] - R @ A2_q[:3] - turned(_point(two)), A1_v[:3] - R @ A2_v[:3]
        rate = dV1[:3] - R @ dV2[:3] - turned(two.V[:3])
        error = -S[:3] - np.cross(S[3:], c.M.translation, axisa=0).T
    else:

        def moved(x: Array) -> Array:
            """∂(X x) for a constant x."""
            return -_cross(X @ x) @ S

        V2 = X @ two.V
        by_q, by_v = A1_q - X @ A2_q - moved(two.A), A1_v - X @ A2_v
        if c.model.reference_frame == ReferenceFrame.LOCAL:
            by_q = by_q - _cross(V2) @ dV1 + _cross(one.V) @ (moved(two.V) + X @ dV2)
            by_v = by_v - _cross(V2) @ one.J + _cross(one.V) @ (X @ two.J)
        rate = dV1 - X @ dV2 - moved(two.V)
        error = -Jlog6(c.M) @ np.linalg.solve(X, S)
    return np.hstack([by_q + gains.Kd * rate + gains.Kp * error, by_v + gains.Kd * c.J])


def _load(c: Contact, force: Array, fext: list[Force]) -> Array:
    """Add the contact's forces to those on joints, in their frames; what Jᵀ λ changes by beside (nv, nv)."""
    wrench = _six(force)
    S, X = _seen(c), c.M.toActionMatrix()
    if len(force) == 3:  # at the origin of frame 2
        R = c.M.rotation
        second = np.append(R.T @ force, np.zeros(3))
        change = np.vstack([R.T @ np.cross(S[3:], force, axisa=0).T, np.zeros((3, S.shape[1]))])
    else:
        second = X.T @ wrench
        change = X.T @ np.stack([-_cross(s).T @ wrench for s in S.T], axis=1)
    on = (c.model.joint1_id, c.model.joint1_placement, wrench), (c.model.joint2_id, c.model.joint2_placement, -second)
    for joint, place, x in on:
        fext[joint] = fext[joint] + place.act(Force(x))
    return np.asarray(c.sides[1].J.T @ change)
