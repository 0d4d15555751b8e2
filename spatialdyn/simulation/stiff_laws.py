"""Laws that a step is too long for: errors that grow by the step alone, found before a run explodes."""

from __future__ import annotations

import warnings
from collections.abc import Hashable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.dynamics import calls
from ..engines.programs.run import time_loop
from ..laws.control import Control, recorded
from ..laws.law_specs import in_step
from ..model.model import Model
from ..recursions.control.paths import CLOCK
from .plan import Plan
from .steps import step_specs

Array = NDArray[Any]
DELTA = 1e-6  # of central differences of a step, whose errors are some 1e-10
HALVINGS = 10  # of dt: the errors of a step of a thousandth of it are those of the motion itself
GROWTH, ROUNDING = 1.1, 1e-6  # beyond what the motion lets errors grow; beyond 1 where they change their sign each step
MOST = 8  # sets of numbers that are judged of one kind of law: loops that plan make a new one each time
REFERENCES = ("q_ref", "v_ref", "a_ref", "hold", "centre", "way", "times", "coefficients", "scale", "cosines", "sines")


def warn_of_stiff_law(
    plan: Plan, control: Control, start: tuple[Array, Array], tau: Array | None, dt: float, level: int = 4
) -> None:
    """Warn, once for a law, scene and dt, of errors that grow in a step of an explicit method as the motion has none.

    start  q and v of a sample; tau  rows of torques, or None; level  of the caller's call, for the warning

    Judged are smooth laws of this library whose numbers are those of all samples and steps, in scenes without impulses.
    """
    if not control.smooth or control.axes(plan.model) or not plan.is_program or plan.scene.solves:
        return
    if {x.name for x in (*plan.states,)} - {in_step(CLOCK.name)} or not all(np.isfinite(x).all() for x in start):
        return
    kind = plan.model.key, plan.method, plan.structure, dt
    seen = _judged(kind)
    if len(seen) >= MOST or (gains := _gains(control)) in seen:
        return
    seen.add(gains)
    found = _growth(plan, start, tau, dt)
    if found is not None:
        joint, size, own, step = found
        cure = "smaller gains there" if step is None else f"smaller gains there, or a dt of {step:.3g} s"
        warnings.warn(
            f'control "{control.spec.name}" is too stiff for steps of {dt:g} s of {plan.method}: errors grow by '
            f'{size:.4g} in each, most in joint "{joint}", where the motion itself has {own:.4g}; {cure}',
            stacklevel=level,
        )


@lru_cache(maxsize=32)
def _gains(control: Control) -> bytes:
    """The numbers of a law, its references left out; of one and the same law once."""
    return b"".join(x.tobytes() for name, x in control.values.items() if not name.startswith(REFERENCES))


@lru_cache(maxsize=256)
def _judged(kind: Hashable) -> set[bytes]:
    """Numbers that have been judged of laws of a kind."""
    return set()


def _growth(
    plan: Plan, start: tuple[Array, Array], tau: Array | None, dt: float
) -> tuple[str, float, float, float | None] | None:
    """The joint, the growth of errors in a step, that of the motion, and a step that would do; None if all is well."""
    model, n = plan.model, plan.model.nv
    made = recorded(step_specs(plan.method, plan.structure, (), tau is not None), model, plan.tables, np.dtype(float))
    if made is None:
        return None
    times = dt * 0.5 ** np.arange(HALVINGS + 1.0)
    ways = np.tile(DELTA * np.concatenate([np.eye(2 * n), -np.eye(2 * n)]), (len(times), 1))
    states = [np.asarray(calls["integrate"](model, start[0], ways[:, :n])), start[1] + ways[:, n:]]
    states += [np.zeros((len(ways), 1)) for _ in plan.states]
    given = [np.repeat(times, 4 * n).reshape(-1, 1, 1), *(() if tau is None else (tau[:1, :1],))]
    given += [x[:1, :1] for x in plan.values.values()]
    after = [np.empty((len(ways), 1, x.shape[1])) for x in states]
    if len(time_loop.replay(made.program, states, given, after, 1, 1)):
        return None
    q, v = (x.reshape(len(times), 2, 2 * n, -1) for x in after[:2])
    moved = np.concatenate([np.asarray(calls["difference"](model, q[:, 1], q[:, 0])), v[:, 0] - v[:, 1]], -1)
    A = np.swapaxes(moved, -1, -2) / (2.0 * DELTA)
    values, vectors = np.linalg.eig(A)
    worst = abs(values).argmax(-1)
    size = abs(values).max(-1)
    turned = values[np.arange(len(times)), worst].real < 0.0
    own = np.exp(np.minimum(np.log(max(1.0, size[-1])) * times / times[-1], 700.0))
    bad = (size > 1.0 + ROUNDING) & (turned | (size > GROWTH * own))
    if not bad[0]:
        return None
    joint = joint_of_mode(model, A[0], values[0, worst[0]], vectors[0, :, worst[0]])
    fine = np.flatnonzero(~bad)
    return joint, float(size[0]), float(own[0]), float(times[fine[0]]) if len(fine) else None


def joint_of_mode(model: Model, A: Array, value: complex, vector: Array) -> str:
    """The joint that takes most part in a mode of a step A (2 nv, 2 nv): by |left x right eigenvector|, freedom by
    freedom, which finds the one whose gain makes it, where the right one alone finds the one that it shakes most.
    """
    values, vectors = np.linalg.eig(A.T)
    left = vectors[:, int(abs(values - value).argmin())]
    part = abs(left * vector).reshape(2, model.nv).sum(0)
    k = int(part.argmax())
    return next(x.name for x in model.joints[1:] if x.idx_v <= k < x.idx_v + x.nv)
