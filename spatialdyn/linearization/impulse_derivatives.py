"""Derivatives of steps by impulses, contacts, joint limits and dry friction, by the implicit function theorem.

At the solution of a step each point separates, sticks or slides, and each joint moves freely, rubs, sticks or stays at
a limit. The equations of that state, with those of motion, are smooth in the solution and in the initial state of the
step (``recursions.contact.impulse_balance``): Newton's steps on them refine the solution to rounding, its derivative
solves the linearized equations. If a state is about to change, the derivative is that of the side on which the step is.

With dependent rows, as for a box on four corners, impulses are undetermined but velocities are not: the least change in
the metric of M is taken. If such points slide, the change of friction with the velocity depends on how they share the
load: the derivative is that of the impulses found, and the result says so.

A derivation of our own, after Alart and Curnier (1991) for the equations of sliding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies.static_table import StaticTable
from ..calls.by_program import along, run
from ..calls.dynamics import calls, checked_call
from ..calls.failures import sample_of
from ..constraints.dynamics import constraint_jacobian, rows_to_keep
from ..errors import SimulationError
from ..model.model import Model
from ..recursions.contact.impulse_balance import Balance, impulse_balance_spec
from ..recursions.contact.impulse_step import impulse_step_spec
from ..recursions.joints.friction import FRICTION_STEP
from ..recursions.spec import Spec, shape_in
from ..simulation.effects.constraints import Constrained
from ..simulation.effects.contacts import Contact
from ..simulation.effects.effect import find
from ..simulation.effects.friction import DryFriction, LuGreFriction, dry
from .active_set import ActiveSet
from .bounces import Phase, hits_of, last_phase
from .constrained_methods import jacobian_slopes
from .step_ends import Closing, led
from .step_torques import Torques

Array = NDArray[Any]
SWITCH = 1e-6  # [m/s | rad/s] margin below which a state is at a switch: the tolerance of a solved step


@dataclass(frozen=True)
class Laws:
    """The laws that act in the steps, and the tables of their equations.

    table    table of contacts, limits and dry joints
    static   the tables of the equations, in order
    has      some of ``impulse_balance.ALL``
    mu       (np) friction coefficients of points
    bounces  (np) restitution of points
    labels   names of points and joints
    """

    model: Model
    contact: Contact | None
    constrained: Constrained | None
    table: StaticTable
    static: tuple[StaticTable, ...]
    has: frozenset[str]
    mu: Array
    bounces: Array
    labels: tuple[str, ...]

    @property
    def spec(self) -> Spec:
        """The Spec of the equations."""
        return impulse_balance_spec(self.has)

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of points, of joints with limits, and of other joints with dry friction."""
        x = self.table.sizes
        return x["np"], x["nl"], x["nd"]


class Found(NamedTuple):
    """Derivatives of n steps by q, v, z and τ: (n, 2 nv, 3 nv), with bristles (n, 3 nv, 4 nv); states of points and
    joints (n, rows); which are at a switch; which slide with a load that others could take.
    """

    derivatives: Array
    active: Array
    switching: Array
    undetermined: Array


def laws_of(model: Model, effects: tuple[Any, ...], touching: Any, forced: bool) -> Laws:
    """The laws of the effects of a run that act by impulses; ``touching`` has the contacts and limits of its scene."""
    contact, constrained = find(effects, Contact), find(effects, Constrained)
    rubs, bends = find(effects, DryFriction), find(effects, LuGreFriction)
    heights: tuple[StaticTable, ...] = ()
    if contact is not None:
        table, heights = contact.table, contact.contacts.tables[1:]
        names = [contact.label(k) for k in range(len(table.rows) - 1)]
    else:
        assert rubs is not None  # solved for, and not a contact
        table = touching.with_dry(dry(effects, model.nv))
        named = Contact(touching, False, table, rubs.way)
        names = [named.label(k) for k in range(len(table.rows) - 1)]
    has = {
        "heights": bool(heights),
        "friction": rubs is not None or bends is not None,
        "constraints": constrained is not None,
    }
    has["rate"] = constrained is not None and not constrained.projects
    has["fext"] = forced
    held = () if constrained is None else (constrained.constraints.table,)
    return Laws(
        model, contact, constrained, table, (table, *heights, *held), frozenset(x for x, y in has.items() if y),
        touching.friction, touching.restitution, tuple(names),
    )  # fmt: skip


def derivatives(
    laws: Laws, q: Array, v: Array, z: Array | None, acting: Torques, h: Array, fext: Array | None,
    batch: tuple[int, ...], samples: NDArray[np.intp],
) -> Found:  # fmt: skip
    """Derivatives of n steps of finite numbers, by q, v, z and tau.

    z        (n, nv) bristles; None without bristles
    acting   torques and friction of the steps
    h        (n,)
    fext     (n, njoints, 6)
    batch    shape of the batch that contains the samples
    samples  (n,)  their places in it

    Raises SimulationError, naming the first sample, for steps that are not solved.
    """
    parts = []
    for k in range(len(q)):  # one by one: bits do not depend on neighbours; directions are lanes
        one = slice(k, k + 1)
        forces, bent = None if fext is None else fext[one], None if z is None else z[one]
        steps = _Steps(laws, q[one], v[one], bent, acting.of(one), h[one], forces, batch, samples[one])
        parts.append(steps.derivatives())
    return Found(*(np.concatenate(x) for x in zip(*parts, strict=True)))


class _Steps:
    """A step and its solution; arrays have an axis of steps, of length one."""

    def __init__(
        self, laws: Laws, q: Array, v: Array, z: Array | None, acting: Torques, h: Array, fext: Array | None,
        batch: tuple[int, ...], samples: NDArray[np.intp],
    ) -> None:  # fmt: skip
        self.laws, self.q, self.v, self.z, self.h, self.batch, self.samples = laws, q, v, z, h, batch, samples
        self.acting, self.tau, self.law, self.fext = acting, acting.torque, acting.law, fext
        (self.n, self.nv), self.m, self.switch = v.shape, acting.by_torque.shape[2], SWITCH
        self.held = 0 if laws.constrained is None else laws.constrained.constraints.nc
        points, limits, dry = laws.sizes
        self.rows = 3 * points + limits + dry
        self.first = np.arange(0, 3 * points, 3)
        self.of_joint = laws.table.rows["row"][1 + points :].astype(int) - 1

    # --- equations ---

    def _inputs(self, x: Array, impulse: Array, reaction: Array) -> list[Array]:
        h, laws = self.h[:, None], self.laws
        forces = [] if self.fext is None else [self.fext.reshape((self.n, -1))]
        rate = [np.full((self.n, 1), laws.constrained.rate)] if "rate" in laws.has and laws.constrained else []
        held = [reaction] if self.held else []
        return [self.q, self.v, x, self.tau, *forces, h, *self.law, *rate, impulse, *held]

    def _split(self, out: Array) -> Balance:
        """Split by outputs, along axis 1."""
        points, limits, dry = self.laws.sizes
        sizes = {"nv": self.nv, "np": points, "nl": limits, "nd": dry, "nc": self.held}
        widths = [int(np.prod(shape_in(x.shape, sizes))) for x in self.laws.spec.parts]
        return Balance(*np.split(out, np.cumsum(widths)[:-1], axis=1))

    def values(self, x: Array, impulse: Array, reaction: Array) -> Balance:
        """The residuals of the equations."""
        given = [np.ascontiguousarray(y) for y in self._inputs(x, impulse, reaction)]
        return self._split(run(self.laws.model, self.laws.spec, "", given, self.laws.static))

    def slopes(self, x: Array, impulse: Array, reaction: Array, moving: tuple[str, ...]) -> Balance:
        """The derivatives of the residuals by the named ones of "q", "v", "x"."""
        given = [np.ascontiguousarray(y) for y in self._inputs(x, impulse, reaction)]
        names = [y.name for y in self.laws.spec.present if not y.static]
        unit = np.eye(len(moving) * self.nv)
        along_unit: dict[str, Array | int] = {}
        for k, name in enumerate(moving):
            part = unit[k * self.nv : (k + 1) * self.nv]
            along_unit[name] = np.broadcast_to(part, (self.n, self.nv, len(unit)))
        tangents: list[Array | int] = [
            along_unit.get(name, self.nv if name == "q" else int(y.shape[1]))
            for name, y in zip(names, given, strict=True)
        ]
        return self._split(along(self.laws.model, self.laws.spec, given, tangents, self.laws.static))

    # --- solutions ---

    def begin(self, bounces: Array) -> tuple[Array, Array, Array]:
        """x, impulses and reactions from the step itself, to its tolerance; ``bounces`` (np) has the restitution."""
        laws, model = self.laws, self.laws.model
        points, limits, _ = laws.sizes
        impulse, reaction = np.zeros((self.n, self.rows)), np.zeros((self.n, self.held))
        if not laws.labels and not self.held:
            M, push = calls["crba"](model, self.q), self.tau - calls["nonlinear_effects"](model, self.q, self.v)
            return self.v + self.h[:, None] * np.linalg.solve(M, push[..., None])[..., 0], impulse, reaction
        if laws.contact is None:
            out = checked_call(FRICTION_STEP, model, (self.q, self.v, self.tau, self.fext, self.h, *self.law), (), None)
            impulse[:] = (self.h[:, None] * out[:, 2])[:, self.of_joint]
            return out[:, 0], impulse, reaction
        has = laws.has - {"fext"} | ({"fext"} if self.fext is not None else set())
        kept = self._kept()[0]
        spec = impulse_step_spec(frozenset(has if kept.all() else {*has, "chosen"}))
        rate = (laws.constrained.rate,) if "rate" in has and laws.constrained is not None else ()
        known = {
            "q": self.q, "v": self.v, "tau": self.tau, "fext": self.fext, "dt": self.h, "mu": laws.mu,
            "restitution": bounces, "rate": rate[0] if rate else None, "chosen": kept.astype(float),
            **dict(zip(("coulomb", "viscous", "static", "stribeck"), self.law, strict=False)),
        }  # fmt: skip
        values = tuple(known[y.name] for y in spec.present if not y.static)
        out = checked_call(spec, model, values, laws.static, None)
        x, force, _, stop, _, _, friction, _, reaction, *_ = spec.split(out, self._sizes(spec))
        axes = self.values(np.ascontiguousarray(x), impulse, reaction).axes.reshape((self.n, points, 3, 3))
        of_points = np.einsum("npij,npj->npi", axes, force.reshape((self.n, points, 3)))
        impulse[:, : 3 * points] = of_points.reshape((self.n, -1))
        if friction.shape[-1]:
            impulse[:, 3 * points :] = (self.h[:, None] * friction)[:, self.of_joint]
        impulse[:, 3 * points : 3 * points + limits] += stop
        return np.ascontiguousarray(x), impulse, np.ascontiguousarray(reaction)

    def _sizes(self, spec: Spec) -> dict[str, int]:
        points, limits, dry = self.laws.sizes
        return {"nv": self.nv, "np": points, "nl": limits, "nd": dry, "nc": self.held}

    def derivatives(self) -> Found:
        """See the module."""
        points, none = self.laws.sizes[0], np.zeros((self.rows, self.m))
        kept = self._kept()
        bounces = self.laws.bounces
        x, impulse, reaction = self.begin(0.0 * bounces)
        by_x = self.slopes(x, impulse, reaction, ("x",))
        at = self.values(x, impulse, reaction)
        self.begun = at.begun
        still = np.zeros(points, np.bool_)
        self.phase = Phase(none[:, 0], none[:points, 0], none, none[:points], still, still)
        start = [(x[k], impulse[k], reaction[k]) for k in range(self.n)]
        hits = hits_of(self, at, by_x, start[0], kept[0]) if bounces.any() else None
        if hits is not None and hits.bounces.any():
            first = [last_phase(self, hits, at, by_x, start[0], kept[0])]
        else:
            if hits is not None:
                self.phase = self.phase._replace(switching=hits.switching)
            first = [self.solved(k, at, by_x, start[k], kept[k]) for k in range(self.n)]
        moved = np.array([self.derivative(k, s)[0] for k, s in enumerate(first)])
        if self.held and self.laws.constrained is not None and self.laws.constrained.projects:
            return self._met(first, moved, by_x)
        ahead = np.array([s.x for s in first])
        return self._ended(first, ahead, moved)

    def solved(
        self, k: int, at: Balance, by_x: Balance, solution: tuple[Array, Array, Array], kept: NDArray[np.bool_]
    ) -> ActiveSet:  # fmt: skip
        """Step k, solved from the values ``at`` an approximate solution; impulses of points are those of its phase."""
        velocity, gap, opened = at.velocity[k].copy(), at.gap[k].copy(), self.phase.open
        rest = self.first[opened]
        velocity[rest], gap[opened] = by_x.velocity[k][rest] @ solution[0], np.inf
        made = ActiveSet(
            *solution, by_x.momentum[k], by_x.velocity[k], by_x.closing[k], at.momentum[k], velocity,
            at.closing[k], gap, at.level[k], at.least[k], at.most[k], self.laws.mu, self.phase.lower, self.of_joint,
            kept, SWITCH, float(self.h[k]),
        )  # fmt: skip
        if not made.settle():
            shares = made.shared()
            names = [x for x, shared in zip(self.laws.labels, shares, strict=False) if shared] or self.laws.labels
            why = "could take each other's load where friction is at its most, which no law shares out between them"
            raise SimulationError(
                f"{self.where(k)}the laws of {', '.join(names)} are not solved in the step, expected a state from "
                f"which a step is{f': they {why}' if shares.any() else ''}"
            )
        return made

    def by_state(self, k: int, x: Array, impulse: Array, reaction: Array) -> Balance:
        """Slopes of step k by the state, including those of torques."""
        slopes = self.slopes(x[None].copy(), impulse[None].copy(), reaction[None].copy(), ("q", "v"))
        rest = self.m - 2 * self.nv
        by = Balance(*(np.concatenate([y[0], np.zeros((y.shape[1], rest))], axis=1) for y in slopes))
        return self._with_torques(by, x, k)

    def derivative(self, k: int, s: ActiveSet, closing: Array | None = None) -> tuple[Array, Array]:
        """δx (nv, m), δλ (rows, m) by the state; ``closing`` (nc, m) adds to the slope of the constraints' residual."""
        phase = self.phase
        by = self.by_state(k, s.x, s.impulse + phase.first, s.reaction)
        if closing is not None:
            by = by._replace(closing=by.closing + closing)
        if phase.open.any():
            target = self.by_state(k, np.zeros(self.nv), s.impulse, s.reaction).velocity
            by.velocity[self.first[phase.open]] -= target[self.first[phase.open]]
        if phase.by_first.any():
            by = by._replace(momentum=by.momentum - s.J.T @ phase.by_first)
        return s.derivative(by, phase.by_lower)

    def _with_torques(self, by: Balance, x: Array, k: int) -> Balance:
        """``by`` plus the slopes from torques and friction of step k, which change with the state."""
        acting, push = self.acting, -self.acting.by_torque[k]
        if not np.isscalar(acting.by_viscous):
            push = push + (x - self.begun[k])[:, None] * acting.by_viscous[k]
        by = by._replace(momentum=by.momentum + self.h[k] * push)
        if not np.isscalar(acting.by_level):
            by = by._replace(level=by.level + self.h[k] * acting.by_level[k][self.of_joint])
        return by

    def where(self, k: int, count: int = 1) -> str:
        """The name of a step in messages."""
        found = sample_of(int(self.samples[k]), count, self.batch).removeprefix(" in ")
        return f"{found}: " if found else ""

    # --- constraints ---

    def _kept(self) -> list[NDArray[np.bool_]]:
        """Equations of constraints that are kept."""
        if self.laws.constrained is None:
            return [np.zeros(0, np.bool_)] * self.n
        chosen, _ = rows_to_keep(self.laws.model, self.laws.constrained.constraints, self.q)
        return [x > 0.0 for x in chosen]

    def _met(self, first: list[ActiveSet], moved: Array, by_x: Balance) -> Found:
        """The second part of a step under constraints, which meets C v⁺ = 0 at its end: ``meet``."""
        laws = self.laws
        assert laws.constrained is not None
        unit = np.broadcast_to(np.eye(self.nv, self.m), (self.n, self.nv, self.m))
        q1, moved1, w1, changed1 = led(laws.model, self.q, np.array([s.x for s in first]), moved, self.h)
        damping, turned = None, None
        if self.law:
            damping = self.h[:, None] * self.law[1]
            if not np.isscalar(self.acting.by_viscous):  # that of bristles, with v
                turned = self.h[:, None, None] * self.acting.by_viscous
        held = laws.constrained.constraints
        close = Closing(laws.model, held, self._kept())
        back, by_back = close.back(self.q, unit, q1, moved1, damping, turned)
        q2 = calls["integrate"](laws.model, q1, back)
        by_q, by_step = np.moveaxis(calls["dintegrate"](laws.model, q1, back), 1, 0)
        moved2 = by_q @ moved1 + by_step @ by_back
        there = constraint_jacobian(laws.model, held, q2)
        more = np.einsum("nij,nj->ni", there, w1)  # C v⁺ there, which the rest of the step takes away
        changed = there @ changed1 + np.einsum("nijk,nj->nik", jacobian_slopes(laws.model, held, q2), w1) @ moved2
        start = [(s.x, s.impulse, s.reaction) for s in first]
        x, impulse, reaction = (np.array(y) for y in zip(*start, strict=True))
        at = self.values(x, impulse + self.phase.first, reaction)
        at = at._replace(closing=at.closing + more)
        second = [self.solved(k, at, by_x, start[k], first[k].kept) for k in range(self.n)]
        moved = np.array([self.derivative(k, s, changed[k])[0] for k, s in enumerate(second)])
        return self._ended(second, np.array([s.x for s in second]), moved)

    # --- ends ---

    def _ended(self, solved: list[ActiveSet], x: Array, moved: Array) -> Found:
        """Derivatives of the state after the step by those of x."""
        model, acting = self.laws.model, self.acting
        end, here, _, changed = led(model, self.q, x, moved, self.h)
        if self.laws.constrained is not None and self.laws.constrained.projects:
            close = Closing(model, self.laws.constrained.constraints, self._kept())
            back, by_back = close.back(end, here, end, here)
            by_q, by_step = np.moveaxis(calls["dintegrate"](model, end, back), 1, 0)
            here = by_q @ here + by_step @ by_back
        before = np.zeros(len(self.laws.labels), np.bool_)
        before[: len(self.first)] = self.phase.switching
        ends = [here, changed]
        if self.z is not None:
            ends.append(self._bent(x, moved))
        return Found(
            np.concatenate(ends, axis=1), np.hstack([np.array([s.names for s in solved]), acting.active]),
            np.hstack([np.array([s.switching for s in solved], np.bool_) | before, acting.margins <= SWITCH]),
            np.hstack([np.array([s.undetermined() for s in solved], np.bool_), np.zeros(acting.active.shape, bool)]),
        )  # fmt: skip

    def _bent(self, x: Array, moved: Array) -> Array:
        """Derivatives of the bristles after the step, kept (z + h x)."""
        acting, h = self.acting, self.h[:, None]
        assert self.z is not None
        assert acting.kept is not None
        assert acting.by_kept is not None
        way = np.eye(self.nv, self.m, 2 * self.nv) + h[..., None] * moved
        made: Array = acting.kept[..., None] * way + (self.z + h * x)[..., None] * acting.by_kept
        return made
