"""Effects that act by impulses: contacts and joint limits, solved together with dry friction and constraints.

A step solves for v⁺ and all impulses together, so its method is ``semi_implicit_euler``. Contacts and limits alone use
``contact_step``, which is ``impulse_step`` without dry friction and constraints. A run carries the largest residual so
far, with its point and step, and on request the impulses of the last step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.scalars import select
from ...bodies.static_table import StaticTable
from ...calls.dynamics import calls
from ...calls.failures import joint_of_velocity
from ...constraints.contact_dynamics import contact_gaps
from ...constraints.contact_points import Contacts
from ...engines.programs.record.recording import MOST_TABLE
from ...errors import SimulationError
from ...recursions.contact.contact_rows import CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT, MU, RESTITUTION
from ...recursions.contact.impulse_step import START as IMPULSES
from ...recursions.contact.impulse_step import impulse_step_spec
from ...recursions.joints.friction import BRISTLES
from ...recursions.spec import FEXT, Argument, Spec
from ..arithmetic import Arithmetic
from ..contact_record import ContactRecord
from . import work
from .constraints import Constrained
from .effect import Effect, Forces, find
from .external import external_torque
from .friction import IMPLICIT, LUGRE, JointFriction, bent, dry, law_of, named, with_torques
from .motor import geared

Array = NDArray[Any]
MOST_POINTS = 12  # in a rollout: with more, J M⁻¹ Jᵀ costs more than the robot, and its program is long
MOST_ROWS = 36  # in a rollout: one per dry joint and limit, three per point; a sweep's tableaus cost rows cubed
START = 1e-3  # [m | rad] largest depth in the ground, or beyond a limit, at which a run may start
UNSOLVED = 1e-2  # [m/s | rad/s] residual that is an error
WORST = 5  # entries: residual of the last step, the largest so far, its point or joint, its step, steps so far

SOLVED = Argument(
    "contact_residual", (WORST,), "", "residual now, largest so far, its point, its step, step", start=0.0
)
RECORDED = Argument("contact_record", (f"{WORST}+np+np+np+nl",), "", "the same, and impulses", start=0.0)


@dataclass(frozen=True, eq=False)
class Contact(Effect):
    """Points on the ground, and limits of joints.

    contacts     Contacts; they may hold joint limits alone, or nothing beside constraints
    records      whether impulses are recorded
    table        table of the contacts and of the freedoms with dry friction
    way          the friction method that is solved for together with them; None without one
    constrained  whether constraints are solved for together with them
    """

    contacts: Contacts
    records: bool
    table: StaticTable
    way: str | None = None
    constrained: bool = False
    name = "contacts"
    solves = True

    @cached_property
    def form(self) -> Any:
        return self.way, self.constrained

    @property
    def own(self) -> Argument:
        """The state that the effect carries from step to step."""
        return RECORDED if self.records else SOLVED

    @cached_property
    def states(self) -> Any:
        return (self.own, IMPULSES) if self.warm else (self.own,)

    @property
    def warm(self) -> bool:
        """Whether a step starts from the impulses of the previous step: with dry joints, where that saves most."""
        return self.way == IMPLICIT and len(self.table.rows) > 1

    @cached_property
    def work(self) -> Any:
        return work.CONTACTS if self.table.sizes["np"] + self.table.sizes["nl"] else None

    @cached_property
    def tables(self) -> tuple[StaticTable, ...]:
        """Tables of the contacts, and of the ground's heights if it has some."""
        return (self.table, *self.contacts.tables[1:])

    @cached_property
    def inputs(self) -> Any:
        return (*(CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT)[: len(self.tables)], *self._coefficients)

    @property
    def _coefficients(self) -> tuple[Argument, ...]:
        return (MU, RESTITUTION)[: bool(len(self.contacts)) + self.bounces]

    @property
    def bounces(self) -> bool:
        """Whether a point has restitution; without any, steps have no phase of rebounds."""
        return bool(self.contacts.restitution.any())

    @cached_property
    def values(self) -> dict[str, Array]:
        rows = self.contacts.friction, self.contacts.restitution
        return {x.name: y[None, None] for x, y in zip(self._coefficients, rows, strict=False)}

    @property
    def too_long(self) -> str:
        """Why programs of its steps are too long: of many points, heights, or rows solved for together; "" if not."""
        points, rows = len(self.contacts), len(self.table.rows) - 1
        together = rows + 2 * points if self.way is not None or self.constrained else 0
        heights = sum(len(x.rows) - 1 for x in self.tables[1:])
        for count, most, what in (
            (points, MOST_POINTS, "points"), (heights, MOST_TABLE, "heights"), (together, MOST_ROWS, "impulses"),
        ):  # fmt: skip
            if count > most:
                return f"{count} {what}, more than the {most} of a program"
        return ""

    def solve(self, at: Arithmetic, acting: tuple[Effect, ...], tau: Any) -> tuple[Any, dict[str, Any], Forces]:
        given, v, push = at.given, at.given["v"], tau
        constrained = find(acting, Constrained)
        lost, law = None, None
        if self.way is not None:
            push, law = geared(given, v, tau, law_of(given))
            lost = push - tau if push is not tau else None
        pushed = given.get(FEXT.name) is not None
        general = self.way is not None or constrained is not None
        push, forces = with_torques(at, acting, push)
        if pushed and not general:
            made = external_torque(at, given["q"])
            push, forces[work.EXTERNAL.name] = push + made, made
        known = {"tau": push, **({} if law is None else named(law))}
        if not len(self.contacts):
            known[MU.name] = np.zeros(0, v.dtype)
        spec = self._spec(constrained, general and pushed)
        parts = at.evaluate(spec, **known)
        after, states = parts["v"], {self.own.name: self._noted(parts, given[self.own.name])}
        if self.warm:
            states[IMPULSES.name] = parts[f"{IMPULSES.name}_after"]
        if work.CONTACTS.name in given:
            states[work.CONTACTS.name] = given[work.CONTACTS.name] + parts["energy"]
        if law is not None and self.way == LUGRE:
            states[BRISTLES.name] = parts["bristles"]
            torque = bent(given, law, after, parts["bristles"])
        elif law is not None:
            torque = parts["friction"] - law[1] * after
        if law is not None:
            forces[work.FRICTION.name] = torque if lost is None else torque + lost
        if constrained is not None:
            constrained.judge(at, (given["q"], v, tau), *parts["missed"])
            force = np.array([x / given["dt"] for x in parts["reaction"]], after.dtype)
            forces[work.CONSTRAINTS.name] = lambda way: force * constrained.rates(at, given["q"], way)
        return after, states, forces

    def _spec(self, constrained: Constrained | None, pushed: bool) -> Spec:
        """The Spec of the step."""
        has = {"heights": len(self.tables) > 1, "friction": self.way is not None, "bristles": self.way == LUGRE}
        has |= {"fext": pushed, "start": self.warm, "no_bounce": not self.bounces}
        if constrained is not None:
            has |= {"constraints": True, "rate": not constrained.projects, "chosen": constrained.chooses}
        return impulse_step_spec(frozenset(name for name, there in has.items() if there))

    def _noted(self, parts: dict[str, Any], before: Any) -> Any:
        """The effect's own state after a step: residuals of this step and of all steps, and impulses."""
        residual = parts["residual"]
        now, which = (residual[0], 0.0) if len(residual) else (0.0, 0.0)
        for k, x in enumerate(residual[1:], 1):
            more = x - now
            now, which = select(more, x, now), select(more, float(k), which)
        _, worst, at, step, count = before[:WORST]
        more = now - worst
        row = [now, select(more, now, worst), select(more, which, at), select(more, count, step), count + 1.0]
        row += [*parts["impulse"], *parts["stop"]] if self.records else []
        return np.array(row, parts["v"].dtype)

    def failure(self, states: dict[str, Array], dt: float, t: float) -> str:
        own = states[self.own.name]
        worst, which, step = own[1], int(own[2]), int(own[3])
        if not worst > UNSOLVED:
            return ""
        return (
            f"{self.label(which)} misses its law by {worst:.2g} m/s in the step from t = {step * dt:.9g} s, "
            f"expected at most {UNSOLVED:g} of a solved step"
        )

    def label(self, k: int) -> str:
        """The name of a point or joint in messages, in the order of residuals."""
        known = self.contacts.labels
        if k < len(known):
            return known[k]
        return f'friction of joint "{joint_of_velocity(self.contacts.model, self.table.rows[1 + k]["row"] - 1).name}"'

    def record(self, q: Array, own: Array) -> ContactRecord:
        """The record, from positions (..., nq) and the effect's own state (..., width)."""
        contacts, model = self.contacts, self.contacts.model
        k, limits, lead = len(contacts), self.table.sizes["nl"], own.shape[:-1]
        stop = np.zeros((*lead, model.nv), own.dtype)
        stop[..., self.table.rows["row"][1 + k : 1 + k + limits] - 1] = own[..., WORST + 3 * k :]
        impulse = own[..., WORST : WORST + 3 * k].reshape((*lead, k, 3))
        known = np.isfinite(q).all(axis=-1, keepdims=True)
        gap = np.where(known, contact_gaps(model, contacts, np.where(known, q, calls["neutral"](model))), np.nan)
        return ContactRecord(impulse.copy(), gap.astype(own.dtype), abs(own[..., 0]), stop)


def contact_of(
    scene: Any, acting: tuple[Effect, ...], records: bool, constrained: Constrained | None
) -> Contact | None:
    """The effect of all that acts by impulses in a run of a scene; None without any.

    acting   the effects of the scene
    records  whether impulses are recorded

    Raises  SimulationError if contacts are to be recorded but do not act
    """
    friction, given = find(acting, JointFriction), scene.unilateral
    nothing = scene.contacts is None and not given.stops  # also with limits=True for a robot without limits
    if nothing and records:
        expected = "expected contacts, or limits=True of joints that have limits, in the scene"
        raise SimulationError(f'record has "contacts", {expected}')
    solved = friction.way if friction is not None and friction.way in (IMPLICIT, LUGRE) else None
    if nothing and (constrained is None or solved != IMPLICIT):
        return None
    table = given.with_dry(dry(acting, scene.model.nv))
    made = Contact(given, records, table, solved, constrained is not None)
    return made if len(table.rows) > 1 or constrained is not None else None


def check_start(scene: Any, q: Array) -> None:
    """Raise SimulationError, with the depth, if a point starts in the ground, or a joint beyond its limits."""
    model, contacts = scene.model, scene.unilateral
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
