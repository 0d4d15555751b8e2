"""Derivatives of a step of the implicit methods, by the implicit function theorem at its solution.

A step of ``symplectic`` takes z = (x, π) to z⁺, by stages whose slopes ż have derivatives F by z and G by τ: the same
equations, linear in the derivatives, are solved instead of iterated. Before and after the step, p = M v maps (δq, δv)
to (δq, δp), and ``chart_rate``, which is linear in v and ṗ and so the tangent map of the charts, maps this to δz.

A step of ``variational`` solves p⁻(q, ξ, τ) = p for ξ, and then q⁺ = q ∘ exp(ξ) and p⁺ = p⁺(q, ξ, τ).

Programs compute F, G and the derivatives of p⁻, p⁺, M v and M⁻¹ p along unit directions, which are lanes of one batch:
one for each freedom of each sample. Springs and smooth friction are torques τ(q, v), which add G ∂τ/∂z to F. The
program of a run computes the step itself, or, with springs, smooth friction or constraints, its loop;
``constrained_methods`` has the steps under constraints.

Source: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), VI.4, for derivatives of symplectic methods.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.by_program import along, run
from ..calls.dynamics import calls
from ..calls.failures import sample_of
from ..engines.compiled import numba_kernels
from ..errors import SimulationError, SpatialDynError, literal
from ..model.model import Model
from ..recursions import SPECS
from ..recursions.momenta.canonical_coordinates import CHARTS, SLOPE, STATE
from ..recursions.momenta.discrete_momenta import MOMENTA
from ..recursions.spec import Spec
from ..simulation.arithmetic import Computed
from ..simulation.effects.constraints import Constrained
from ..simulation.effects.effect import Effect
from ..simulation.effects.external import ExternalForces
from ..simulation.fixed_steps import failure_message
from ..simulation.methods.call_kernels import kernels_of
from ..simulation.methods.constrained_symplectic import UNDER
from ..simulation.methods.methods import DISCRETE, Method, integrators
from ..simulation.methods.symplectic import GAUSS2, GAUSS4, GAUSS6, Tableau
from ..simulation.momenta_steps import begun as begun_rows
from ..simulation.momenta_steps import kept, momenta_specs
from ..simulation.system import State, System, units
from . import constrained_methods
from .constrained_methods import Rows, Slopes, rows_of
from .step_torques import smooth_torques

Array = NDArray[Any]
TABLEAUX = {"implicit_midpoint": GAUSS2, "gauss4": GAUSS4, "gauss6": GAUSS6}


class Solved(NamedTuple):
    """Solved steps of n samples.

    q, p     (n, ...)  the states after the steps
    z        (n, 2 nv)  before and after, for canonical methods
    work     (n, rows, 2 nv or nv)  the method's scratch after the step
    centres  (n, nv + 1, 6)
    """

    q: Array
    p: Array
    z: tuple[Array, Array]
    work: Array
    centres: Array


class Begun(NamedTuple):
    """n samples at the beginning of a step: h (n,), fext (n, njoints, 6) or None."""

    q: Array
    v: Array
    p: Array
    tau: Array
    h: Array
    fext: Array | None

    def of(self, k: int) -> Begun:
        """One sample."""
        q, v, p, tau, h, fext = self
        return Begun(q[k], v[k], p[k], tau[k], h[k], None if fext is None else fext[k])


class Beside(NamedTuple):
    """What acts beside torques and forces: effects that are torques by q and v, their inputs by name, constraints."""

    effects: tuple[Effect, ...] = ()
    given: dict[str, Any] = {}  # noqa: RUF012  no field of it is written
    constrained: Constrained | None = None


ALONE = Beside()


def check_implicit(method: Any) -> None:
    """Raise SpatialDynError for a name of no method, or of one whose steps adapt."""
    known = [name for name, x in integrators.items() if x.family is not None]
    if not isinstance(method, str) or method not in integrators:
        raise SpatialDynError(f"method is {literal(method)}, expected one of {', '.join(known)}")
    if method not in known:
        raise SpatialDynError(
            f"method is {literal(method)}, whose steps adapt to a tolerance and have no derivative; expected one of "
            f"{', '.join(known)}"
        )


def derivatives(
    model: Model, method: Method, begun: Begun, batch: tuple[int, ...], samples: NDArray[np.intp],
    beside: Beside = ALONE,
) -> Array:  # fmt: skip
    """Derivatives (n, 2 nv, 3 nv) by q, v and tau, for n samples of finite numbers.

    batch    shape of the batch that contains the samples
    samples  (n,)  their places in it
    Raises SimulationError, naming the first sample and how many, for steps that are not solved.
    """
    q, v = begun.q, begun.v
    n, nv = len(q), model.nv
    solved = _solve(model, method, begun, batch, samples, beside)
    unit = np.broadcast_to(np.eye(3 * nv), (n, 3 * nv, 3 * nv))
    of_q, of_v, of_tau = unit[:, :nv], unit[:, nv : 2 * nv], unit[:, 2 * nv :]
    of_p = along(model, SPECS["momentum"], [q, v], [of_q, of_v])
    constrained = beside.constrained
    rows = None if constrained is None else (rows_of(model, constrained, q), rows_of(model, constrained, solved.q))
    step = _variational if method.family is DISCRETE else _canonical
    moved, changed, ahead = step(model, method, solved, begun, beside.effects, rows, (of_q, of_p, of_tau))
    if rows is None or ahead is None:
        back = along(model, SPECS["velocity_from_momentum"], [solved.q, solved.p], [moved, changed])
    else:
        back = constrained_methods.met(model, solved.q, ahead, solved.p, moved, changed, rows[1])
    return np.concatenate([moved, back], axis=1)


def _variational(
    model: Model, method: Method, solved: Solved, begun: Begun, effects: tuple[Effect, ...],
    rows: tuple[Rows, Rows] | None, given: tuple[Array, Array, Array],
) -> tuple[Array, Array, Array | None]:  # fmt: skip
    """δq⁺ and δp⁺ (n, nv, 3 nv) of the variational method; under constraints p before velocities meet them, and its."""
    q, _, p, tau, h, fext = begun
    of_q, of_p, of_tau = given
    n, nv = len(q), model.nv
    xi, half = solved.work[:, 0], 0.5 * h[:, None, None]
    spec, forces, still = _with_forces(MOMENTA, fext)
    unit = np.broadcast_to(np.eye(nv), (n, nv, nv))
    states = [q, xi, tau, *forces, h[:, None]]
    by_state = along(model, spec, states, [of_q, nv, of_tau, *still, 1])
    by_xi = along(model, spec, states, [nv, unit, nv, *still, 1])
    by_q, by_step = np.moveaxis(calls["dintegrate"](model, q, xi), 1, 0)
    zero, mean = np.zeros_like(unit), xi / h[:, None]
    push = smooth_torques(
        model,
        effects,
        q,
        mean,
        np.concatenate([of_q, zero], 2),
        np.concatenate([0.0 * of_q, unit / h[:, None, None]], 2),
    )
    if push is not None:
        by_state[:, :nv] -= half * push[1][:, :, : 3 * nv]
        by_xi[:, :nv] -= half * push[1][:, :, 3 * nv :]
    if rows is None:
        d_xi = np.linalg.solve(by_xi[:, :nv], of_p - by_state[:, :nv])
    else:
        values = run(model, spec, "", states)
        left = values[:, :nv] - p - (0.0 if push is None else half[:, 0] * push[0])
        slopes = by_state[:, :nv] - of_p, by_xi[:, :nv], (by_q, by_step)
        d_xi = constrained_methods.variational(left, *slopes, of_q, *rows)
    moved = by_q @ of_q + by_step @ d_xi
    changed = by_state[:, nv:] + by_xi[:, nv:] @ d_xi
    more = smooth_torques(model, effects, solved.q, mean, moved, d_xi / h[:, None, None])
    if more is not None:
        changed = changed + half * more[1]
    if rows is None:
        return moved, changed, None
    return moved, changed, values[:, nv:] + (0.0 if more is None else half[:, 0] * more[0])


def _canonical(
    model: Model, method: Method, solved: Solved, begun: Begun, effects: tuple[Effect, ...],
    rows: tuple[Rows, Rows] | None, given: tuple[Array, Array, Array],
) -> tuple[Array, Array, Array | None]:  # fmt: skip
    """δq⁺ and δp⁺ (n, nv, 3 nv) of a method in canonical coordinates; under constraints as ``_variational``."""
    q, _, p, tau, h, fext = begun
    of_q, of_p, of_tau = given
    n, nv = len(q), model.nv
    z0, z1 = solved.z
    centres = solved.centres[:, : nv + 1].reshape((n, -1))  # rows of joints that mimic others follow
    spec, forces, still = _with_forces(SLOPE, fext)
    unit = np.broadcast_to(np.eye(3 * nv), (n, 3 * nv, 3 * nv))
    pairs = unit[:, : 2 * nv, : 2 * nv]

    def slopes(z: Array) -> Slopes:
        """The Slopes of ż at z."""
        total, by = tau, None
        if effects:
            at, momenta = run(model, STATE, "", [z, centres], outputs=2)
            back = np.linalg.solve(to_chart(z, pairs[:, :nv], pairs[:, nv:]), pairs)
            v = calls["velocity_from_momentum"](model, at, momenta)
            by_v = along(model, SPECS["velocity_from_momentum"], [at, momenta], [back[:, :nv], back[:, nv:]])
            if (more := smooth_torques(model, effects, at, v, back[:, :nv], by_v)) is not None:
                total, by = tau + more[0], more[1]
        states = [z, total, *forces, centres]
        found = along(model, spec, states, [unit[:, : 2 * nv], unit[:, 2 * nv :], *still, 6 * nv + 6])
        F, G = found[..., : 2 * nv], found[..., 2 * nv :]
        return Slopes(run(model, spec, "", states) if rows else np.empty(0), F if by is None else F + G @ by, G)

    def to_chart(z: Array, moved: Array, changed: Array) -> Array:
        """δz for (δq, δp)."""
        m = moved.shape[2]
        lanes = [np.repeat(z, m, axis=0), *(x.transpose(0, 2, 1).reshape((n * m, nv)) for x in (moved, changed))]
        made: Array = run(model, CHARTS, "", [*lanes, np.repeat(centres, m, axis=0)])
        return made.reshape((n, m, 2 * nv)).transpose(0, 2, 1)

    step = h[:, None, None]
    if rows is not None:  # of joints whose charts are themselves
        middle = solved.work[:, 2, nv:]
        start, end = (slopes(np.concatenate([x, middle], axis=1)) for x in (q, solved.q))
        return constrained_methods.rattle(p, middle, start, end, 0.5 * step, given, *rows)
    begin = to_chart(z0, of_q, of_p)
    if method.name in TABLEAUX:
        made = _gauss(TABLEAUX[method.name], solved, slopes, begin, of_tau, step)
    else:
        made = _partitioned(method.name, solved, slopes, begin, of_tau, step)
    after: Array = np.linalg.solve(to_chart(z1, pairs[:, :nv], pairs[:, nv:]), made)
    return after[:, :nv], after[:, nv:], None


def _gauss(method: Tableau, solved: Solved, slopes: Any, start: Array, of_tau: Array, h: Array) -> Array:
    """δz⁺ from δL_i = h b_i (F_i (δz + Σ mu_ij δL_j) + G_i δτ), z⁺ = z + Σ L_i."""
    s, n, size = len(method.b), len(start), start.shape[1]
    z0, L = solved.z[0], solved.work[:, 7 : 7 + len(method.b)]
    system = np.broadcast_to(np.eye(s * size), (n, s * size, s * size)).copy()
    right = np.empty((n, s * size, start.shape[2]))
    for a in range(s):
        _, F, G = slopes(z0 + sum(method.mu[a][b] * L[:, b] for b in range(s)))
        here = slice(a * size, a * size + size)
        right[:, here] = h * method.b[a] * (F @ start + G @ of_tau)
        for b in range(s):
            system[:, here, b * size : b * size + size] -= h * method.b[a] * method.mu[a][b] * F
    made: Array = start + np.linalg.solve(system, right).reshape((n, s, size, -1)).sum(axis=1)
    return made


def _partitioned(name: str, solved: Solved, slopes: Any, start: Array, of_tau: Array, h: Array) -> Array:
    """δz⁺ of symplectic Euler, or of Störmer-Verlet, a half step of symplectic Euler and one of its adjoint."""
    z0, z1 = solved.z
    k = z0.shape[1] // 2
    one = np.eye(k)

    def implicit(F: Array, G: Array, c: Array, x: Array, half: slice, other: slice, base: Array) -> Array:
        """Solve δy = base + c δẏ for one half of y, given the other half."""
        right = base + c * (F[:, half, other] @ x + G[:, half] @ of_tau)
        made: Array = np.linalg.solve(one - c * F[:, half, half], right)
        return made

    first, last = slice(0, k), slice(k, 2 * k)
    if name == "symplectic_euler":
        _, F, G = slopes(np.concatenate([z0[:, :k], z1[:, k:]], axis=1))
        later = implicit(F, G, h, start[:, first], last, first, start[:, last])
        moved = start[:, first] + h * (F[:, first] @ np.concatenate([start[:, first], later], 1) + G[:, first] @ of_tau)
        return np.concatenate([moved, later], axis=1)
    middle, half = solved.work[:, 2, k:], 0.5 * h
    _, F, G = slopes(np.concatenate([z0[:, :k], middle], axis=1))
    between = implicit(F, G, half, start[:, first], last, first, start[:, last])
    base = start[:, first] + half * (F[:, first] @ np.concatenate([start[:, first], between], 1) + G[:, first] @ of_tau)
    _, F, G = slopes(np.concatenate([z1[:, :k], middle], axis=1))
    moved = implicit(F, G, half, between, first, last, base)
    changed = between + half * (F[:, last] @ np.concatenate([moved, between], 1) + G[:, last] @ of_tau)
    return np.concatenate([moved, changed], axis=1)


def _with_forces(spec: Spec, fext: Array | None) -> tuple[Spec, list[Array], list[int]]:
    """The spec with or without external forces, their rows as an input, and the columns of their tangent, all 0."""
    if fext is None:
        return numba_kernels.variant(spec, frozenset()), [], []
    rows = fext.reshape((len(fext), -1))
    return numba_kernels.variant(spec, frozenset({"fext"})), [rows], [rows.shape[1]]


def _solve(
    model: Model, method: Method, begun: Begun, batch: tuple[int, ...], samples: NDArray[np.intp], beside: Beside
) -> Solved:
    """The steps, each as ``simulate`` takes the first one from that state."""
    family = method.family
    assert family is not None
    q, _, p, tau, h, fext = begun
    n, nv, name = len(q), model.nv, method.name
    start = begun_rows(model, name, q, p)
    work = np.zeros((n, family.rows, nv * (1 + family.wide)))
    centres = np.zeros((n, nv + 1, 6))
    if beside.effects or beside.constrained is not None:
        q1, p1 = np.full_like(q, np.nan), np.full_like(p, np.nan)
    else:
        acting = () if fext is None else (ExternalForces(np.empty(0)),)
        specs = momenta_specs(name, acting)
        forces = [] if fext is None else [fext.reshape((n, -1))]
        given = [q, p, *start, h[:, None], tau, *forces, units(model)[None]]
        q1, p1, *found = run(model, specs, "", given, outputs=len(specs))
        for x, at in zip(found, kept(name).values(), strict=True):
            if at is None:
                centres[:] = x.reshape(centres.shape)
            else:
                work[:, at] = x.reshape((n, -1, work.shape[2]))
    unsolved: list[tuple[int, str]] = []
    for k in np.flatnonzero(~(np.isfinite(q1).all(axis=1) & np.isfinite(p1).all(axis=1))).tolist():
        state, reason = _alone(model, method, begun.of(k), beside, k)
        if reason:
            unsolved.append((int(samples[k]), reason))
        q1[k], p1[k], work[k], centres[k] = state.q, state.w, state.work, state.by_row[: nv + 1]
    if unsolved:
        where = sample_of(unsolved[0][0], len(unsolved), batch)
        raise SimulationError(f"{where.removeprefix(' in ')}: {unsolved[0][1]}" if where else unsolved[0][1])
    return Solved(q1, p1, (start[0], work[:, 0]), work, centres)


def _alone(model: Model, method: Method, begun: Begun, beside: Beside, sample: int) -> tuple[State, str]:
    """The state after a step that the program rejects, and why it is not solved; "" if it is solved."""
    family, nv, (q, _, p, tau, h, fext) = method.family, model.nv, begun
    assert family is not None
    step: Any = method.advance
    if beside.constrained is not None:
        step = UNDER[method.name](beside.constrained.of_sample(sample), model)
    status, still, forces = np.zeros(3), np.zeros(nv), np.zeros((0, 6)) if fext is None else fext
    at = Computed(model, {})

    def torque(system: System, t: float, q: Array, v: Array) -> None:
        system.tau[:] = tau
        for effect in beside.effects:
            if (more := effect.torque(at, q, v)) is not None:
                system.tau[:] += more

    kernels = kernels_of(at, family, fext)
    system = System(kernels, torque, None, None, tau[None], forces, units(model), still, tau.copy(), status)
    scratch = np.zeros((len(model.bodies), 6)), np.zeros((family.rows, nv * (1 + family.wide)))
    state = State(q.copy(), p.copy(), np.zeros(nv), np.zeros(model.nq), *scratch)
    at.begin(system, 0.0)
    at.given.update(beside.given)
    with np.errstate(all="ignore"):
        if family.start is not None:
            family.start(system, state)
        step(system, 0.0, float(h), state)
        family.observe(system, h, state)
    return state, failure_message(status, method, model, float(h), state) if status[0] != 0 else ""
