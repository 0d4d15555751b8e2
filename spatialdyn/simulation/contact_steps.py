"""Contacts in simulations: what a run takes with it, the step on recorded numbers and by kernels, what is reported.

Contacts and joint limits act by ``recursions.contact``: v⁺ and all impulses are found together, so the step is that of
``semi_implicit_euler``. A run carries the largest residual so far, with its point and step, and on request the
impulses of the last step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..algebra.scalars import select
from ..calls.arguments import as_flag
from ..calls.dynamics import calls
from ..constraints.contact_dynamics import contact_gaps, step_spec
from ..constraints.contact_points import Contacts, check_contacts
from ..engines import run
from ..engines.compiled import numba_kernels
from ..engines.programs.recording import MOST_TABLE
from ..engines.programs.tracer import scratch
from ..errors import ModelError, SimulationError
from ..model.model import Model
from ..recursions.contact import CONTACT_STEP, CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT, MU, RESTITUTION, WORK, contact_step
from ..recursions.spec import Argument, shape_in
from . import explicit, ledger
from .contact_record import ContactRecord
from .friction_steps import SMOOTH, STEPPED, Rubbing, smooth_kernel
from .springs import has_springs
from .system import State, System, set_status

Array = NDArray[Any]
MOST_POINTS = 12  # in a rollout: beyond, J M⁻¹ Jᵀ costs more than the robot, and its program is long
START = 1e-3  # [m | rad] deepest that a run may start in the ground, or beyond a limit
UNSOLVED = 1e-2  # [m/s | rad/s] residual that is an error
WORST = 5  # numbers: residual of the last step, the largest so far, its point or joint, its step, steps so far

SOLVED = Argument(
    "contact_residual", (WORST,), "", "residual now, largest so far, its point, its step, step", start=0.0
)
RECORDED = Argument("contact_record", (f"{WORST}+np+np+np+nl",), "", "the same, and impulses", start=0.0)


@dataclass(frozen=True)
class Touching:
    """The contacts of a run.

    contacts  Contacts, perhaps of joint limits alone
    records   whether impulses are recorded
    """

    contacts: Contacts
    records: bool

    @property
    def own(self) -> Argument:
        """The state that they carry."""
        return RECORDED if self.records else SOLVED

    @property
    def width(self) -> int:
        """The numbers of that state."""
        return int(shape_in(self.own.shape, self.contacts.table.sizes)[0])

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """That state, and the inputs that a step takes last, the tables first."""
        return (self.own, *(CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT)[: len(self.contacts.tables)], *self.inputs)

    @property
    def inputs(self) -> tuple[Argument, ...]:
        """The inputs that are no tables."""
        return (MU, RESTITUTION) if len(self.contacts) else ()

    @property
    def values(self) -> tuple[Array, ...]:
        """(np,) of each."""
        return (self.contacts.friction, self.contacts.restitution)[: len(self.inputs)]

    def record(self, q: Array, own: Array) -> ContactRecord:
        """What was recorded: positions (..., nq), and the state of its own (..., width)."""
        contacts, model = self.contacts, self.contacts.model
        k, lead = len(contacts), own.shape[:-1]
        stop = np.zeros((*lead, model.nv), own.dtype)
        stop[..., contacts.table.rows["row"][1 + k :] - 1] = own[..., WORST + 3 * k :]
        impulse = own[..., WORST : WORST + 3 * k].reshape((*lead, k, 3))
        known = np.isfinite(q).all(axis=-1, keepdims=True)
        gap = np.where(known, contact_gaps(model, contacts, np.where(known, q, calls["neutral"](model))), np.nan)
        return ContactRecord(impulse.copy(), gap.astype(own.dtype), abs(own[..., 0]), stop)


def touching(
    model: Model, contacts: Any, limits: Any, records: Any, method: str, q: Array, found: Rubbing | None, held: Any
) -> Touching | None:
    """The contacts of a run by the arguments of ``simulate`` and ``rollout``, from positions (..., nq); None for none.

    Raises  SimulationError for a method that takes none, a start in the ground or beyond a limit, with its depth, and
            for constraints and friction beside them; ConstraintError, ModelError
    """
    stops, kept = as_flag("limits", limits), as_flag("record_contacts", records)
    if contacts is None and not stops:
        if kept:
            raise SimulationError("record_contacts is True, expected contacts or limits=True with it")
        return None
    given = Contacts(model, {}) if contacts is None else check_contacts(model, contacts)
    if stops and not given.limits:
        given = given.with_limits()
    what = "limits are to act" if contacts is None else "contacts are given"
    if method != STEPPED:
        raise SimulationError(
            f'{what} and method is "{method}", expected method="{STEPPED}": impulses and velocities are found together'
        )
    if held is not None:
        raise SimulationError(f"{what} beside constraints, expected one of them")
    if has_springs(model):
        raise SimulationError(f'{what} and model "{model.name}" has springs at its rotors, expected one of them')
    if found is not None and found.has_motor:
        raise SimulationError(f"{what} beside a motor, expected one of them: gears rub, and no dry joint acts here")
    if found is not None and found.way != SMOOTH:
        raise SimulationError(f'{what} and friction_method is "{found.way}", expected friction_method="smooth"')
    _check_start(model, given, q)
    return Touching(given, kept) if given.table.sizes["np"] + given.table.sizes["nl"] else None


def _check_start(model: Model, contacts: Contacts, q: Array) -> None:
    """Raise SimulationError if a point starts in the ground, or a joint beyond its limits."""
    rows = contacts.table.rows[1 + len(contacts) :]
    x = q[..., rows["q_index"]]
    beyond = np.maximum(rows["lower"] - x, x - rows["upper"])
    depth = np.concatenate([-contact_gaps(model, contacts, q), beyond], axis=-1)
    bad = np.argwhere(depth > START)
    if len(bad):
        index, k = tuple(int(i) for i in bad[0, :-1]), int(bad[0, -1])
        where = "" if not index else f" in sample {index[0]}"
        size = depth[(*index, k)]
        if k < len(contacts):
            raise SimulationError(
                f'point "{contacts.names[k]}" starts {1e3 * size:.3g} mm in the ground{where}, expected at most '
                f"{1e3 * START:g} mm; contact_gaps says how far to lift the robot"
            )
        name = contacts.stops[k - len(contacts)]
        raise SimulationError(f'joint "{name}" starts {size:.3g} rad or m beyond its limits{where}, expected within')


def check_few(found: Touching | None) -> None:
    """Raise ModelError if there are more points, or heights, than a rollout takes."""
    heights = 0 if found is None else sum(len(x.rows) - 1 for x in found.contacts.tables[1:])
    if heights > MOST_TABLE:
        raise ModelError(
            f"terrain has {heights} heights, expected at most {MOST_TABLE} in a rollout; simulate and contact_step "
            "take more"
        )
    if found is not None and len(found.contacts) > MOST_POINTS:
        raise ModelError(
            f"contacts have {len(found.contacts)} points, expected at most {MOST_POINTS} in a rollout; simulate and "
            "contact_step take more"
        )


def samples_unsolved(own: Array) -> NDArray[np.intp]:
    """The samples with a step that is not solved, of the state of its own (samples, width)."""
    return np.flatnonzero(own[:, 1] > UNSOLVED)


def unsolved(found: Touching, own: Array, dt: float) -> str:
    """What is wrong with the step of the largest residual of one sample; "" if it is solved."""
    worst, which, step = own[1], int(own[2]), int(own[3])
    if not worst > UNSOLVED:
        return ""
    return (
        f"{found.contacts.labels[which]} misses its law by {worst:.2g} m/s in the step from t = {step * dt:.9g} s, "
        f"expected at most {UNSOLVED:g} of a solved step; more sweeps may help"
    )


# --- a step, traced -------------------------------------------------------------------------------------


def traced_step(own: Argument, rows: Any, given: dict[str, Any], tau: Any, rubbed: Any) -> tuple[Any, Any, Any]:
    """The velocities after a step, states after it by name, forces that do work; of ``given`` inputs by name.

    rubbed  torques of smooth friction, None for none
    """
    q, v, contacts, before = given["q"], given["v"], given[CONTACTS_ARGUMENT.name], given[own.name]
    n, sizes = len(v), {"nv": len(v), "np": contacts[0].np, "nl": contacts[0].nl}
    shapes = [shape_in(x.shape, sizes) for x in CONTACT_STEP.parts] + CONTACT_STEP.extra_outputs(sizes)
    made = [np.full(shape, 0.0, object) for shape in shapes]
    mu, restitution = (given.get(x.name, np.zeros(0, object)) for x in (MU, RESTITUTION))
    whole = tau if rubbed is None else tau + rubbed
    heights = given.get(HEIGHTS_ARGUMENT.name)
    contact_step(rows, scratch(WORK, n + 1), q, v, whole, given["dt"], contacts, heights, mu, restitution, *made)
    after, impulse, _, stop, residual, work = made[:6]
    now, which = residual[0], 0.0
    for k, x in enumerate(residual[1:], 1):
        more = x - now
        now, which = select(more, x, now), select(more, float(k), which)
    _, worst, at, step, count = before[:WORST]
    more = now - worst
    solved = [now, select(more, now, worst), select(more, which, at), select(more, count, step), count + 1.0]
    states = {own.name: np.array(solved + ([*impulse, *stop] if own.name == RECORDED.name else []), object)}
    if ledger.CONTACTS.name in given:
        states[ledger.CONTACTS.name] = given[ledger.CONTACTS.name] + work
    return after, states, {} if rubbed is None else {ledger.FRICTION.name: rubbed}


# --- a step by kernels ----------------------------------------------------------------------------------


def by_kernels(found: Touching, own: Array, fext: Array | None, rubs: Rubbing | None) -> Callable[..., None]:
    """The step of ``semi_implicit_euler`` under contacts; ``own`` is written in place.

    rubs  smooth friction, None for none
    """
    solve = solver(found, fext, rubs)

    def step(system: System, t: float, h: float, state: State) -> None:
        system.torque(system, t, state.q, state.w)
        after, states, _ = solve(system, t, h, state, {found.own.name: own})
        state.w[:], own[:] = after, states[found.own.name]
        displacement = state.work[1]
        displacement[:] = h * state.w
        explicit.move(system, t, displacement, state)

    return step


def solver(found: Touching, fext: Array | None, rubs: Rubbing | None) -> Callable[..., tuple[Array, Any, Any]]:
    """``(system, t, h, state, own) -> v⁺, states after by name, forces that do work``, as ``traced_step``."""
    contacts, model = found.contacts, found.contacts.model
    kernel = numba_kernels.sample_kernel(step_spec(contacts))
    tables, k, stops = [getattr(x, run.STATIC) for x in contacts.tables], len(contacts), contacts.table.sizes["nl"]
    resist = None if rubs is None else smooth_kernel(rubs)
    ends = np.cumsum([model.nv, 3 * k, k, stops, k + stops])

    def solve(system: System, t: float, h: float, state: State, own: Any) -> tuple[Array, Any, Any]:
        out, tau, forces = np.empty(ends[-1] + k + stops), system.tau, {}
        if resist is not None:
            forces[ledger.FRICTION.name] = resist(system.table, state.w)
            tau = tau + forces[ledger.FRICTION.name]
        if fext is not None:
            q = np.array(state.q)
            forces[ledger.EXTERNAL.name] = calls["generalized_gravity"](model, q) - calls["static_torque"](
                model, q, fext
            )
            tau = tau + forces[ledger.EXTERNAL.name]
        given = (state.q, state.w, tau, h, *tables, contacts.friction, contacts.restitution)
        set_status(system, kernel(system.table, *given, out), t)
        after, impulse, _, stop, residual, work = np.split(out, ends)
        now = own[found.own.name].copy()
        now[0] = residual.max(initial=0.0)
        if now[0] > now[1]:
            now[1:4] = now[0], np.argmax(residual), now[4]
        now[4] += 1.0
        if found.records:
            now[WORST:] = np.concatenate([impulse, stop])
        states = {found.own.name: now}
        if ledger.CONTACTS.name in own:
            states[ledger.CONTACTS.name] = own[ledger.CONTACTS.name] + work
        return after, states, forces

    return solve
