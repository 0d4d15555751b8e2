"""Derivatives of steps in which points bounce, by Poisson's phases (``recursions.contact.impulses``).

Each phase solves equations of the same form (``active_set``). The first phase brings the points to rest by impulses
λ_c. Each later phase adds impulses whose normal parts are at least a share of earlier ones. Derivatives are chained: λ
and the least impulses of a phase are functions of the state, as is the part of λ_c that only balances forces. The
phases of a step are part of its state: if they are about to change, the step is at a switch.

The derivative is that of the step, whose hits act at its end: no step resolves the time of a hit. Points of a rigid
body that hit at once and could take each other's load rebound together if they have the same restitution and no
friction. Other such points are refused: their rebound depends on their shares of the load, which no law determines.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import SimulationError
from ..recursions.contact.contact_rows import BOUNCING, PRESSED, REST
from ..recursions.contact.impulses import PHASES
from .active_set import SMALL, ActiveSet

Array = NDArray[Any]
SWEEPS = 50  # sweeps over friction before the Newton steps of a phase


class Phase(NamedTuple):
    """The values at the beginning of a phase.

    first     (rows) impulses of points in earlier phases; 0 for joints, whose impulses are sums over all phases
    lower     (np) least normal impulses
    by_first, by_lower  (rows, m), (np, m) their derivatives
    open      (np) whether a point's only target of normal velocity is rest: it bounces when it reaches the ground
    switching (np) whether a point was at a switch in an earlier phase
    """

    first: Array
    lower: Array
    by_first: Array
    by_lower: Array
    open: NDArray[np.bool_]
    switching: NDArray[np.bool_]


class Hits(NamedTuple):
    """Bounces of the points in a step.

    bounces          restitution; 0 without a bounce
    open, switching  as in ``Phase``
    before, free     velocities along normals, before the step and without impulses
    """

    bounces: Array
    open: NDArray[np.bool_]
    switching: NDArray[np.bool_]
    before: Array
    free: Array


def hits_of(steps: Any, at: Any, by_x: Any, solution: tuple[Array, Array, Array], kept: NDArray[np.bool_]) -> Hits:
    """The Hits of a step, by the rule of ``contact_rows.target``; ``at`` is any solution of the step's equations."""
    x, impulse, reaction = solution
    M, J, C = by_x.momentum[0], by_x.velocity[0], by_x.closing[0]
    left = at.momentum[0] + J.T @ impulse + C.T @ reaction
    free = x + _solved(M, C[kept], -left, -at.closing[0][kept])[: len(x)]
    before, ahead, e = J[steps.first] @ steps.v[0], J[steps.first] @ free, steps.laws.bounces
    fast = np.clip(PRESSED * (before - ahead), REST, BOUNCING)
    reach, quick, thrown = -(at.gap[0] / steps.h[0] + ahead), -before - fast, before - fast
    reaches = (reach > 0.0) & (quick > 0.0)
    margin = np.minimum(np.where(quick > 0.0, abs(reach), np.inf), np.where(reach > 0.0, abs(quick), np.inf))
    margin = np.minimum(margin, abs(thrown))
    opened = reaches & (e > 0.0)
    return Hits(
        np.where(reaches | (thrown > 0.0), e, 0.0), opened, (margin <= steps.switch) & (e > 0.0), before, free
    )  # fmt: skip


def last_phase(
    steps: Any, hits: Hits, at: Any, by_x: Any, solution: tuple[Array, Array, Array], kept: NDArray[np.bool_]
) -> ActiveSet:  # fmt: skip
    """The solution of the last phase of a step; sets ``steps.phase``, the values at the beginning of that phase."""
    points, rows, m = len(hits.open), steps.rows, steps.m
    normal = steps.first
    zero = np.zeros((rows, m))
    steps.phase = Phase(np.zeros(rows), np.zeros(points), zero, zero[:points], hits.open, hits.switching)
    load, by_load = np.zeros(points), np.zeros((points, m))
    for p in np.flatnonzero(hits.bounces > 0.0):
        load[p], by_load[p] = _load(steps, hits, by_x, int(p), kept)
    share, M, J = 1.0, by_x.momentum[0], by_x.velocity[0]
    for count in range(PHASES):
        solved: ActiveSet = steps.solved(0, at, by_x, solution, kept)
        phase: Phase = steps.phase
        force = solved.impulse[normal]
        if count == 0:
            share = min([1.0, *hits.bounces[force > 0.0]])
        hit = force - (load if count == 0 else phase.lower)
        each = hits.bounces if count == 0 else np.full(points, share)
        more = solved.own[normal] * hit - (REST if count else 0.0)
        again = (more > 0.0) & (each * hit > 0.0)
        near = (abs(more) <= steps.switch) & (each > 0.0) & (force > 0.0)
        switching = phase.switching | near | np.array(solved.switching[:points], np.bool_)
        if not again.any() or count == PHASES - 1:
            steps.phase = phase._replace(switching=switching)
            return solved
        if (apart := again & solved.gives_back_apart(np.where(again, each, 0.0))).any():
            _refuse(steps, apart)
        moved = steps.derivative(0, solved)[1]
        by_hit = moved[normal] - (by_load if count == 0 else phase.by_lower)
        lower = np.where(again, each * hit, 0.0)
        first, by_first = phase.first.copy(), phase.by_first.copy()
        first[: 3 * points] += solved.impulse[: 3 * points]
        by_first[: 3 * points] += moved[: 3 * points]
        steps.phase = Phase(first, lower, by_first, np.where(again, each, 0.0)[:, None] * by_hit, hits.open, switching)
        impulse = solved.impulse.copy()
        impulse[: 3 * points] = 0.0
        impulse[normal] = lower
        x = _rubbed(solved, solved.x + np.linalg.solve(M, J[normal].T @ lower), impulse)
        solution = x, impulse, solved.reaction
        at = steps.values(*(y[None] for y in (x, first + impulse, solved.reaction)))
    raise AssertionError


def _rubbed(solved: ActiveSet, x: Array, impulse: Array) -> Array:
    """The start of the Newton steps: x after sweeps over the friction of points, so that no sliding direction reverses.

    The tangential parts of ``impulse`` are written in place.
    """
    answers = np.linalg.solve(solved.M, solved.J.T)
    for _ in range(SWEEPS):
        for p in range(solved.points):
            across, most = slice(3 * p + 1, 3 * p + 3), solved.mu[p] * impulse[3 * p]
            wanted = impulse[across] - solved.J[across] @ x / solved.friction[p]
            size = float(np.linalg.norm(wanted))
            wanted = wanted * (most / size if size > most else 1.0)
            x = x + answers[:, across] @ (wanted - impulse[across])
            impulse[across] = wanted
    return x


def _refuse(steps: Any, points: NDArray[np.bool_]) -> None:
    """Raise SimulationError for points that hit at once and could take each other's load."""
    names = [steps.laws.labels[p] for p in np.flatnonzero(points)]
    if len(names) == 1:
        raise SimulationError(
            f"{steps.where(0)}{names[0]} bounces where constraints or joints that stick could take its load, expected "
            "one that is its own: the law does not say how far it rebounds"
        )
    raise SimulationError(
        f"{steps.where(0)}{', '.join(names)} bounce at once and could take each other's load, expected points of which "
        "each has a load of its own, or of one restitution without friction: the law does not say how far each of them "
        "rebounds"
    )


def _load(steps: Any, hits: Hits, by_x: Any, p: int, kept: NDArray[np.bool_]) -> tuple[float, Array]:
    """The impulse that holds a single point against the forces of the step, and its derivatives."""
    k, M, C = 3 * p, by_x.momentum[0], by_x.closing[0]
    pressed = hits.before[p] - hits.free @ by_x.velocity[0][k]
    if not pressed > 0.0:
        return 0.0, np.zeros(steps.m)
    J, nv = by_x.velocity[0][k], len(hits.free)
    answer = _solved(M, C[kept], J, np.zeros(kept.sum()))
    load = pressed / max(J @ answer[:nv], SMALL)
    x = hits.free + load * answer[:nv]
    impulse, reaction = np.zeros(steps.rows), np.zeros(len(kept))
    impulse[k] = load
    left = steps.values(x[None], impulse[None], reaction[None]).momentum[0]
    reaction[kept] = np.linalg.lstsq(C[kept].T, left)[0] if kept.any() else 0.0
    by = steps.by_state(0, x, impulse, reaction)
    rest = steps.by_state(0, steps.v[0], impulse, reaction)
    row = by.velocity[k] - rest.velocity[k]
    row[nv : 2 * nv] -= J
    held = np.vstack([C[kept], J[None]])
    K = np.block([[M, -held.T], [held, np.zeros((len(held), len(held)))]])
    whole = np.vstack([by.momentum, by.closing[kept], row[None]])
    made: Array = -np.linalg.solve(K, whole)[-1]
    return float(load), made


def _solved(M: Array, C: Array, momentum: Array, closing: Array) -> Array:
    """The solution (x, μ) of M x - Cᵀ μ = momentum, C x = closing."""
    K = np.block([[M, -C.T], [C, np.zeros((len(C), len(C)))]])
    made: Array = np.linalg.solve(K, np.concatenate([momentum, closing]))
    return made
