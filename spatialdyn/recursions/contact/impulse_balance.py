"""The equations of a step by impulses, as functions of its state and its solution: for derivatives of steps.

With x the velocities after the step, in the axes at its beginning, and impulses λ of points and joints and μ of
constraints, ``impulse_step`` and ``contact_step`` leave

    M (x - v - d) + h (bias + b (x - d) - τ) - Jᵀ λ - Cᵀ μ = 0,    C (x - d) + h Ċ v = 0,

with d of floating and planar joints, see ``add_begun``. Other outputs are u = J x, with a point's target c added along
its normal, and the terms of the laws for u: gaps, levels of dry friction and the ranges of joints' limits.

Source: see ``recursions.contact.impulse_step``.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

from ...algebra.euclidean import Vec, unrotate
from ...algebra.records import mat3_of
from ...algebra.scalars import inline
from ..constraints.constrained import RATE, WORK, write_equations
from ..constraints.constraint_rows import CONSTRAINTS_ARGUMENT, place_bias
from ..coordinates.coordinate_rates import add_begun
from ..joints.friction import DT, LAW, Law, dry_level
from ..signatures import Array, Bodies, Config, Matrix, Number, Record, Vector, Work
from ..spec import FEXT, TAU, Argument, Q, Spec, V
from ..tree.rnea import rnea
from .contact_rows import (
    CONTACTS_ARGUMENT,
    GAP,
    HEIGHTS_ARGUMENT,
    Contact,
    allowed,
    place_points,
    target,
    velocity,
    write_rows,
)
from .impulse_rows import ROWS


class Balance(NamedTuple):
    """The outputs of ``impulse_balance``."""

    momentum: Vector
    velocity: Vector
    gap: Vector
    axes: Vector
    level: Vector
    least: Vector
    most: Vector
    closing: Vector
    begun: Vector


class Given(NamedTuple):
    """Impulses of a solution."""

    impulse: Vector  # (rows) of points, in the axes of their ground, and joints
    reaction: Vector  # (nc) of constraints


class BalanceScratch(NamedTuple):
    """Scratch of ``impulse_balance``."""

    J: Matrix = (ROWS, "nv")
    b: Vector = (ROWS,)  # targets c
    slopes: Array = ("np", 3, 3)
    y: Vector = ("nv",)  # acceleration


class HeldBalanceScratch(NamedTuple):
    """The same of constraints."""

    C: Matrix = ("nc", "nv")
    error: Vector = ("nc",)


@inline
def impulse_balance(
    bodies: Bodies, work: Work, q: Config, v: Vector, x: Vector, tau: Vector, fext: Matrix, dt: Number,
    contact: Contact, law: Law, constraints: Record, rate: Number, given: Given, out: Balance,
    s: BalanceScratch, h: HeldBalanceScratch,
) -> None:  # fmt: skip
    """The residuals of the equations of a step.

    x  (nv)  velocities after the step, in the axes at its beginning
    fext, law, constraints, rate  may be None; then h and given.reaction are None too without constraints
    """
    n, contacts = len(bodies) - 1, contact.contacts
    points, limits, joints = contacts[0].np, contacts[0].nl, contacts[0].nl + contacts[0].nd
    add_begun(bodies, dt, v, out.begun)
    for i in range(n):
        s.y[i] = (x[i] - v[i] - out.begun[i]) / dt
    rnea(bodies, work, q, v, s.y, fext, out.momentum)
    for i in range(n):
        push = out.momentum[i] - tau[i]
        if law is not None:
            push = push + law.viscous[i] * (x[i] - out.begun[i])
        out.momentum[i] = dt * push

    place_points(bodies, work, contacts, contact.heights, out.gap, s.slopes)
    write_rows(bodies, work, contacts, contact.heights, s.slopes, s.J)
    for k in range(3 * points + joints):
        s.b[k] = 0.0
        for i in range(n):
            out.momentum[i] = out.momentum[i] - s.J[k, i] * given.impulse[k]
    for p in range(points):
        s.b[3 * p], _ = target(out.gap[p], 0.0, 0.0, dt, 0.0)
        write_axes(contacts, contact.heights, s.slopes[p], p, out.axes)
    for k in range(3 * points + joints):
        out.velocity[k] = velocity(s.J, s.b, x, k)
    for j in range(joints):
        c = contacts[1 + points + j]
        out.level[j] = 0.0 if law is None else dt * dry_level(v, law, c.row - 1)
        if j < limits:
            out.least[j], out.most[j] = allowed(c, q, dt)

    if constraints is not None:
        place_bias(bodies, work, v)
        write_equations(bodies, work, q, v, constraints, rate, h.C, out.closing, h.error)
        for k in range(len(out.closing)):
            out.closing[k] = dt * out.closing[k]
            for i in range(n):
                was = out.begun[i] if rate is None else out.begun[i] + v[i]
                out.closing[k] = out.closing[k] + h.C[k, i] * (x[i] - was)
                out.momentum[i] = out.momentum[i] - h.C[k, i] * given.reaction[k]


@inline
def write_axes(contacts: Record, heights: Record, T: Matrix, p: int, axes: Vector) -> None:
    """axes (9 np): the axes of each point's rows in the world, its normal first."""
    R = mat3_of(contacts[0].axes)
    for i in range(3):
        e = Vec(1.0 if i == 0 else 0.0, 1.0 if i == 1 else 0.0, 1.0 if i == 2 else 0.0)
        if heights is not None:
            e = Vec(T[i, 0], T[i, 1], T[i, 2])
        e = unrotate(R, e)
        axes[9 * p + 3 * i], axes[9 * p + 3 * i + 1], axes[9 * p + 3 * i + 2] = e.x, e.y, e.z


AHEAD = Argument("x", ("nv",), "rad/s | m/s", "velocities after the step, in the axes at its beginning")
IMPULSES = Argument("impulse", (ROWS,), "N s | N m s", "of points, in the axes of their ground, and of joints")
REACTIONS = Argument("reaction", ("nc",), "N s | N m s", "of constraints")
ALL = ("heights", "friction", "constraints", "rate", "fext")
OVER, RUBS, HOLDS, STEADIES, PUSHED = ALL


@cache
def impulse_balance_spec(has: frozenset[str]) -> Spec:
    """The Spec of the equations of a step with some of ALL; a rate beside constraints."""

    def given(what: str, x: Record) -> Record:
        return x if what in has else None

    ground = Contact(CONTACTS_ARGUMENT, given(OVER, HEIGHTS_ARGUMENT), None, None)
    held = "nc" if HOLDS in has else 0
    parts = Balance(
        Argument("momentum", ("nv",), "N s | N m s", "what is left of the equations of motion"),
        Argument("velocity", (ROWS,), "m/s | rad/s", "of points, with their target, and of joints"),
        GAP,
        Argument("axes", ("+".join(["np"] * 9),), "1", "of points, their normal first, in the world"),
        Argument("level", ("nl+nd",), "N m s | N s", "most impulse of dry friction"),
        Argument("least", ("nl",), "rad/s | m/s", "velocity that a lower limit leaves"),
        Argument("most", ("nl",), "rad/s | m/s", "velocity that an upper limit leaves"),
        Argument("closing", (held,), "m/s | rad/s", "what is left of constraints"),
        Argument("begun", ("nv",), "rad/s | m/s", "d"),
    )
    width = "+".join(str(x) for part in parts for x in part.shape if x)
    return Spec(
        "_".join(["impulse_balance", *(x for x in ALL if x in has)]), impulse_balance, WORK,
        (
            Q, V, AHEAD, TAU, given(PUSHED, FEXT), DT, ground, given(RUBS, LAW),
            given(HOLDS, CONSTRAINTS_ARGUMENT), given(STEADIES, replace(RATE, optional=False)),
            Given(IMPULSES, given(HOLDS, REACTIONS)),
        ),
        Argument("result", (width,), "", ", ".join(x.name for x in parts)),
        "What is left of the equations of a step by impulses.", "see ``recursions.contact.impulse_balance``",
        regroup=True, composed=True, scratch=(BalanceScratch(), HeldBalanceScratch() if HOLDS in has else None),
        parts=parts,
    )  # fmt: skip
