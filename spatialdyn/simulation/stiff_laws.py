"""Detects control laws that are too stiff for the step or their period, before a run diverges."""

from __future__ import annotations

import math
import warnings
from collections.abc import Hashable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..actuation.friction import Friction
from ..calls.dynamics import calls
from ..control.control import Control, recorded
from ..control.law_specs import in_step
from ..engines.programs.record.program import Program
from ..engines.programs.run import time_loop
from ..model.model import Model
from .effects.friction import IMPLICIT
from .plan import Plan
from .scene import Scene
from .states import HIDDEN
from .steps import step_specs

Array = NDArray[Any]
DELTA = 1e-6  # of central differences of a step, whose errors are some 1e-10
HALVINGS = 10  # of dt: errors over a step of about dt/1000 evolve as in the motion itself
GROWTH, ROUNDING = 1.1, 1e-6  # limits of growth: relative to that of the motion; above 1 if errors alternate in sign
PERIOD_GROWTH, PERIOD_HALVINGS = 1.01, 3  # over a period, relative to the same law evaluated in each step
FLIPS = 1e-6  # relative: an eigenvalue this near the negative axis makes errors alternate from period to period
MOST = 8  # sets of values to judge for one kind of law: planning loops make a new set each time
MOST_LINES = 300_000  # lines of the step's program times steps of a period: some tenths of a second
MOST_STEPS = 100_000  # steps until laws of several periods are evaluated together again
WHOLE = 1e-6  # of a step: a period this near to whole steps counts as whole
REFERENCES = ("q_ref", "v_ref", "a_ref", "hold", "centre", "way", "times", "coefficients", "scale", "cosines", "sines")


def rough(scene: Scene) -> tuple[str, ...]:
    """The effects of a scene that have no derivative: contacts, limits, motors and Coulomb's friction."""
    found = [x for x in scene.acts if x in ("contacts", "limits", "motor")]
    if isinstance(scene.friction, Friction) and scene.friction_method == IMPLICIT:
        coulomb, _, static, _ = scene.friction.law
        found += ["dry friction"] if (coulomb > 0.0).any() or (static > 0.0).any() else []
    return tuple(found)


def steps_of_periods(control: Control, dt: float) -> int:
    """Steps of dt until all torques that a law holds for a period are evaluated together again; 1 without such torques.

    0 if there are more than MOST_STEPS.
    """
    whole = 1
    for name, *_ in control.periods:
        ratio = float(control.values[name].item()) / dt
        for several in range(1, 65):
            steps = round(several * ratio)
            if steps and abs(several * ratio - steps) < WHOLE * several:
                break
        else:
            return 0
        whole = math.lcm(whole, max(1, steps))
        if whole > MOST_STEPS:
            return 0
    return whole


def warn_of_stiff_law(
    plan: Plan, control: Control, start: tuple[Array, Array], tau: Array | None, dt: float, level: int = 4
) -> None:
    """Warn, once for a law, scene and dt, if errors grow over a step of an explicit method, or over the period of a
    held law, faster than in the motion itself.

    start  q and v of a sample; tau  rows of torques, or None; level  stack level of the caller, for the warning

    The check covers smooth laws of this library with the same values in all samples and steps, in scenes of smooth
    effects without constraints, over periods of at most MOST_STEPS steps and MOST_LINES lines.
    """
    if not control.smooth or control.axes(plan.model) or not plan.is_program or plan.scene.constraints is not None:
        return
    if rough(plan.scene) or plan.works or not all(np.isfinite(x).all() for x in start):
        return
    kind = plan.model.key, plan.method, plan.structure, dt
    seen = _judged(kind)
    if len(seen) >= MOST or (gains := _gains(control)) in seen:
        return
    seen.add(gains)
    if text := _text(plan, control, start, tau, dt):
        warnings.warn(f'control "{control.spec.name}" is too stiff for {text}', stacklevel=level)


@lru_cache(maxsize=32)
def _gains(control: Control) -> bytes:
    """The values of a law without its references; computed once for a law."""
    return b"".join(x.tobytes() for name, x in control.values.items() if not name.startswith(REFERENCES))


@lru_cache(maxsize=256)
def _judged(kind: Hashable) -> set[bytes]:
    """The sets of values that have been judged for laws of a kind."""
    return set()


def _text(plan: Plan, control: Control, start: tuple[Array, Array], tau: Array | None, dt: float) -> str:
    """The warning: for what a law is too stiff, where and by how much; "" if it is not."""
    made = recorded(
        step_specs(plan.method, plan.structure, (), tau is not None), plan.model, plan.tables, np.dtype(float)
    )
    if made is None:
        return ""
    law = _Judged(plan, made.program, start, tau, tuple(in_step(x) for x, *_ in control.periods))
    scales = 0.5 ** np.arange(HALVINGS + 1.0)
    fresh = law.modes(dt * scales, dt * scales)
    if fresh is None:
        return ""
    own = np.exp(np.minimum(np.log(max(1.0, fresh.size[-1])) * scales / scales[-1], 700.0))
    turned = fresh.value.real < 0.0
    bad = (fresh.size > 1.0 + ROUNDING) & (turned | (fresh.size > GROWTH * own))
    if bad[0]:
        fine = np.flatnonzero(~bad)
        cure = f"a dt of {dt * scales[fine[0]]:.3g} s" if len(fine) else ""
        return _said(law, fresh, own[0], f"steps of {dt:g} s of {plan.method}: errors grow by {{}} in each", cure)
    steps = steps_of_periods(control, dt)
    if steps < 2 or steps * len(made.program.lines) > MOST_LINES:
        return ""
    scales = scales[: PERIOD_HALVINGS + 1]
    held, anew = law.modes(dt * scales, None, steps), law.modes(dt * scales[:1], dt * scales[:1], steps)
    if held is None or anew is None:
        return ""
    own = np.maximum(1.0, anew.size) ** scales
    turned = (held.value.real < 0.0) & (abs(held.value.imag) < FLIPS * held.size)
    bad = (held.size > 1.0 + ROUNDING) & (turned | (held.size > PERIOD_GROWTH * own))
    if not bad[0]:
        return ""
    fine = np.flatnonzero(~bad)
    each = sorted({float(control.values[x].item()) for x, *_ in control.periods})
    listed = " and ".join(f"{x:g}" for x in each)
    less = " and ".join(f"{x * scales[fine[0]]:.3g}" for x in each) if len(fine) else ""
    several = "s" if len(each) > 1 else ""
    cure = f"{'' if several else 'a '}period{several} of {less} s" if less else ""
    told = f"its period{several} of {listed} s: errors grow by {{}} in {dt * steps:.3g} s"
    return _said(law, held, own[0], told, cure)


class _Modes(NamedTuple):
    """For each time scale: the map A of errors, its largest eigenvalue with its vector, and the magnitude."""

    A: Array
    value: Array
    vector: Array
    size: Array


def _said(law: _Judged, modes: _Modes, own: float, told: str, cure: str) -> str:
    joint = joint_of_mode(law.plan.model, modes.A[0], modes.value[0], modes.vector[0])
    less = f"smaller gains there, or {cure}" if cure else "smaller gains there"
    grown = told.format(f"{modes.size[0]:.4g}")
    return f'{grown}, most in joint "{joint}", where the motion itself has {own:.4g}; {less}'


class _Judged(NamedTuple):
    """A law in a plan, judged by the program of its step; ``periods`` names the inputs that are periods."""

    plan: Plan
    program: Program
    start: tuple[Array, Array]
    tau: Array | None
    periods: tuple[str, ...]

    def modes(self, times: Array, periods: Array | None, steps: int = 1) -> _Modes | None:
        """The modes of steps of these times (k,), with these periods (k,), or the law's periods in proportion to the
        first time; None for states that are not finite.
        """
        model, n, plan = self.plan.model, self.plan.model.nv, self.plan
        law = () if plan.feedback is None else plan.feedback.states
        more = plan.unstarted.starts
        moved = [k for k, x in enumerate(plan.states) if x not in law and x.name not in HIDDEN]
        # bristles; other states of a law are its clock, a cost, or evaluated anew
        sizes = [more[k].shape[1] for k in moved]
        total = 2 * n + sum(sizes)
        ways = np.tile(DELTA * np.concatenate([np.eye(total), -np.eye(total)]), (len(times), 1))
        parts = np.split(ways, np.cumsum([n, n, *sizes])[:-1] if sizes else [n], axis=1)
        states = [np.asarray(calls["integrate"](model, self.start[0], parts[0])), self.start[1] + parts[1]]
        states += [np.tile(x[:1], (len(ways), 1)) for x in more]
        for k, way in zip(moved, parts[2:], strict=True):
            states[2 + k] = states[2 + k] + way
        rows = np.repeat(times, 2 * total).reshape(-1, 1, 1)
        given = [rows, *(() if self.tau is None else (self.tau[:1, :1],))]
        for name, x in plan.values.items():
            if name in self.periods:
                scaled = rows * (x[:1, :1] / times[0]) if periods is None else np.repeat(periods, 2 * total)
                given.append(scaled.reshape(-1, 1, 1))
            else:
                given.append(x[:1, :1])
        after = [np.empty((len(ways), 1, x.shape[1])) for x in states]
        if len(time_loop.replay(self.program, states, given, after, steps, steps)):
            return None
        q, *others = (x.reshape(len(times), 2, total, -1) for x in (after[0], after[1], *(after[2 + k] for k in moved)))
        change = [np.asarray(calls["difference"](model, q[:, 1], q[:, 0])), *(x[:, 0] - x[:, 1] for x in others)]
        A = np.swapaxes(np.concatenate(change, -1), -1, -2) / (2.0 * DELTA)
        values, vectors = np.linalg.eig(A)
        worst = abs(values).argmax(-1)
        at = np.arange(len(times))
        return _Modes(A, values[at, worst], vectors[at, :, worst], abs(values).max(-1))


def joint_of_mode(model: Model, A: Array, value: complex, vector: Array) -> str:
    """The joint that takes most part in a mode of a step A (2 nv + ..., 2 nv + ...): by |left x right eigenvector|,
    freedom by freedom. This finds the joint whose gain causes the mode; the right eigenvector alone would find the
    joint that moves most. States after q and v belong to no joint.
    """
    values, vectors = np.linalg.eig(A.T)
    left = vectors[:, int(abs(values - value).argmin())]
    part = abs(left * vector)[: 2 * model.nv].reshape(2, model.nv).sum(0)
    k = int(part.argmax())
    return next(x.name for x in model.joints[1:] if x.idx_v <= k < x.idx_v + x.nv)
