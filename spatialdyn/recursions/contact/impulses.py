"""The impulses of a step, which satisfy the laws of points in contact, of limits and of dry joints together.

First come sweeps (``impulse_rows``): feet on rigid legs need 3 or 4. With dry joints, or contacts whose forces are
not unique, sweeps alone may take thousands. Newton's steps (``newton_step``) then solve for all rows at once,
with a proximal term ε that vanishes as the residual falls. All steps are taken, and the best λ is kept; if 12 steps do
not converge, sweeps from there and 12 more steps follow. The rounds differ, because their cycles do. In every second
round, a step that makes λ far too large is undone and ε grown, for rigid points that press against each other. In the
third and fourth of four rounds, points first have much more friction, for legs that would jam when sliding (Painlevé)
and must stick.

Points bounce in a second phase (Poisson). The first phase brings them to rest, with impulses λ_c; the second adds Λ_n
of at least e λ_c, complementary to u_n, with friction of its own within μ Λ_n. The part of Λ_n above e λ_c brings a
point to rest that another point's rebound threw down; a further phase returns that part, until none is left. Each
impact then loses work, except with e = 1 and no friction; Newton's law, u_n⁺ = -e u_n⁻, may gain work with friction.
The part of λ_c that only balances forces is not returned.

Source: Pfeiffer, Glocker, Multibody dynamics with unilateral contacts (1996), for Poisson's law; the law as in
``contact``; its solution is a derivation of our own.
"""

from __future__ import annotations

from ...algebra.regions import repeat, settled, when
from ...algebra.scalars import Scalar, inline, select
from ..signatures import Record, Vector
from .contact_rows import REST, Contact
from .impulse_rows import (
    CAREFUL,
    COUNT,
    EPSILON,
    GRIP,
    JAMS,
    LEAST,
    PHASE,
    RES,
    ROUND,
    SHARE,
    STOPS,
    Impulses,
    beyond_limits,
    residual,
    residual_of_joints,
    residual_of_points,
    respond,
    sweep_joints,
    sweep_points,
)
from .newton_step import newton_step

SWEEPS, SWEEPS_DRY, SWEEPS_AGAIN = 5, 2, 8  # before Newton's steps: at first, at first with dry joints, and later
PROX = (1e-3, 1e-2, 1e-4)  # first ε of each round; the last is for all further rounds
PROX_LEAST = 1e-7  # least ε, because of rounding
PROX_MOST, REGROWN = 1e-1, 100.0  # largest ε after an undone step, and the factor by which it grows
THROWN = 30.0  # times the least residual: a step with a larger residual is undone
PHASES = 8  # the most phases of an impact; one point needs two
GRIPS, GRIPPED = 1e3, 4  # factor of μ in the first steps of a round, and the number of these steps
FAR = 1e30  # above any residual


@inline
def solve_impulses(
    contact: Contact, held: Record, first: int, rubs: bool, w: Vector, s: Impulses
) -> None:  # fmt: skip
    """Solve for λ from its value in ``force``, and update w.

    held   scratch of constraints, whose rows N Newton's steps treat as stiff; None without constraints
    first  sweeps before Newton's steps
    rubs   whether joints rub dry
    """
    rows, state = len(s.force), s.state
    for k in range(rows):
        s.first[k] = 0.0
    for k in range(len(state)):
        state[k] = 0.0
    state[SHARE] = 1.0
    if contact.restitution is None:
        solve_phase(contact, held, first, rubs, w, s)
        return
    s.phase[0] = 1.0
    for _ in repeat(PHASES, s.phase, s.force, s.first, s.lower, s.free, w, state):
        if settled(s.phase[0]):
            break
        solve_phase(contact, held, first, rubs, w, s)
        s.phase[0] = 0.0
        for p in range(len(s.lower)):  # after the first phase, points of one impact share their least e
            least = select(s.bounces[p] - state[SHARE], state[SHARE], s.bounces[p])
            state[SHARE] = select(state[PHASE], state[SHARE], select(s.force[3 * p], least, state[SHARE]))
        for p in range(len(s.lower)):
            share = select(state[PHASE], state[SHARE], s.bounces[p])
            hit = s.force[3 * p] - select(state[PHASE], s.lower[p], s.load[p])
            again = select(s.B[p, 0, 0] * hit - select(state[PHASE], REST, 0.0), share * hit, 0.0)
            s.phase[0] = select(again, 1.0, s.phase[0])
            s.next[p] = again
        for p in range(len(s.lower)):
            s.lower[p] = select(s.phase[0], s.next[p], s.lower[p])
        for k in range(rows):
            s.first[k] = s.first[k] + select(s.phase[0], s.force[k], 0.0)
            s.force[k] = select(s.phase[0], 0.0, s.force[k])
        for i in range(len(w)):
            s.free[i] = select(s.phase[0], w[i], s.free[i])
        state[PHASE] = 1.0


@inline
def solve_phase(
    contact: Contact, held: Record, first: int, rubs: bool, w: Vector, s: Impulses
) -> None:  # fmt: skip
    """Solve for λ of one phase."""
    head, rows = contact.contacts[0], len(s.force)
    state, tolerance = s.state, head.tolerance
    for k in range(rows):
        s.best[k] = s.force[k]
    state[RES], state[LEAST], state[ROUND], state[EPSILON], state[COUNT] = FAR, FAR, 0.0, 0.0, 0.0
    state[CAREFUL], state[JAMS] = 0.0, 0.0
    s.left[0] = 1.0
    for _ in repeat(head.rounds, s.left, s.force, s.best, w, state):
        if settled(s.left[0]):
            break
        for k in range(rows):
            s.force[k] = s.best[k]
        respond(w, s)
        state[COUNT] = select(state[ROUND], 1.0 * SWEEPS_AGAIN, 1.0 * first)
        s.sweeping[0] = 1.0
        state[STOPS] = 1.0
        if not rubs:
            again = state[ROUND] + state[PHASE]
            state[STOPS] = select(again, 1.0, select(beyond_limits(w, s) - tolerance, 1.0, 0.0))
        for _ in repeat(SWEEPS_AGAIN, s.sweeping, s.force, w, state):
            if settled(s.sweeping[0]):
                break
            sweep_points(contact, held is not None, w, s)
            state[COUNT] = state[COUNT] - 1.0
            sweep_stops(contact, rubs, w, s)
            s.sweeping[0] = select(state[COUNT], state[RES] - tolerance, 0.0)
        keep(select(state[ROUND], 1.0, state[LEAST] - state[RES]), s)
        state[EPSILON] = select(state[ROUND], select(state[ROUND] - 1.0, PROX[2], PROX[1]), PROX[0])
        state[COUNT] = 0.0
        s.stepping[0] = state[RES] - tolerance
        for _ in repeat(head.steps, s.stepping, s.force, s.best, w, s.held, s.goal, state):
            if settled(s.stepping[0]):
                break
            state[GRIP] = select(state[JAMS], select(GRIPPED - state[COUNT], GRIPS, 1.0), 1.0)
            newton_step(contact, held, w, s)
            new = residual(contact, w, s)
            less = 0.1 * state[EPSILON]
            less = select(less - PROX_LEAST, less, PROX_LEAST)
            state[EPSILON] = select(0.5 * state[RES] - new, less, state[EPSILON])
            state[RES] = new
            state[COUNT] = state[COUNT] + 1.0
            keep(state[LEAST] - new, s)
            s.thrown[0] = select(state[CAREFUL], new - THROWN * state[LEAST], 0.0)
            for _ in when(s.thrown[0], s.force, w, state):
                for k in range(rows):
                    s.force[k] = s.best[k]
                respond(w, s)
                more = REGROWN * state[EPSILON]
                state[EPSILON] = select(more - PROX_MOST, PROX_MOST, more)
                state[RES] = state[LEAST]
            s.stepping[0] = new - tolerance
        state[ROUND] = state[ROUND] + 1.0
        state[JAMS] = select(state[CAREFUL], 1.0 - state[JAMS], state[JAMS])
        state[CAREFUL] = 1.0 - state[CAREFUL]
        s.left[0] = state[LEAST] - tolerance
    for k in range(rows):
        s.force[k] = s.best[k]
    respond(w, s)


@inline
def sweep_stops(contact: Contact, rubs: bool, w: Vector, s: Impulses) -> None:
    """The joints' part of a sweep, and the residual; without dry friction only if a joint would pass a limit.

    Until one does their impulses are 0, and limits are looked at where the points are solved, and after the last sweep.
    """
    state, tolerance = s.state, contact.contacts[0].tolerance
    if rubs or len(s.level) == 0:
        sweep_joints(w, s)
        state[RES] = residual(contact, w, s)
    else:
        state[RES] = 0.0
        for _ in when(state[STOPS], s.force, w, state):
            sweep_joints(w, s)
            state[RES] = residual_of_joints(w, s)
        of_points = residual_of_points(contact, w, s)
        state[RES] = select(of_points - state[RES], of_points, state[RES])
        looks = select(state[STOPS], 0.0, select(state[COUNT], tolerance - state[RES], 1.0))
        for _ in when(looks, state):
            beyond = beyond_limits(w, s)
            state[STOPS] = select(beyond - tolerance, 1.0, 0.0)
            state[RES] = select(beyond - state[RES], beyond, state[RES])


@inline
def keep(better: Scalar, s: Impulses) -> None:
    """Keep λ and its residual as the best if ``better`` is above 0."""
    for k in range(len(s.force)):
        s.best[k] = select(better, s.force[k], s.best[k])
    s.state[LEAST] = select(better, s.state[RES], s.state[LEAST])
