"""What each digit costs on a model and on this machine, and the cheapest way to as many as are needed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..calls.arguments import as_count, as_number, check_model, words
from ..engines.compiled import numba_kernels
from ..errors import ModelError, SpatialDynError
from ..model.model import Model
from ..simulation import integrators
from . import call_errors, integrator_errors
from .references import LEAST, MANY, MANY_LEAST, bound
from .results import Option, Recommendation, Tradeoff, checked_tolerance, figure, marked

TASKS = (*call_errors.TASKS, "simulate")
BATCH = 8 if numba_kernels.PLAIN else 4096
WORTH = 1.1  # times that a way must be faster to be worth more states


def trade(
    model: Model,
    task: str = "forward_dynamics",
    states: Any = None,
    batch: int = BATCH,
    duration: float = 1.0,
    methods: str | Sequence[str] | None = None,
) -> Tradeoff:
    """Error and cost of every way of doing a task, measured on this model, on this machine, now.

    model     Model without mimic joints
    task      what is done, by which ways, and how an error is measured:

              ==================  ==================================================  ==============================
              "forward_dynamics"  aba, crba_solve, aba_refined, aba_square_root       largest over largest of a
              "inverse_dynamics"  rnea                                                largest over largest of tau
              "mass_matrix"       crba                                                entries over √(M_ii M_jj)
              "simulate"          every integrator, at steps from coarse to fine      of q over how far any
                                                                                      coordinate goes, of v over the
                                                                                      largest, at 10 times
              ==================  ==================================================  ==============================

              A state whose largest entry is below a tenth of their median is measured by that instead.
              Calls run as programs on SIMD lanes in float64 and float32 (whose inputs are rounded to float32 too), and
              by the kernel for any model, "untraced".
    states    in which errors are measured: a number of random ones, 4096 by default, or a tuple of arrays (n, ...): (q,
              v, tau), (q, v, a), (q,). Of simulations (q0, v0), by default 4 random configurations at rest
    batch     samples of a call whose time is taken; 1 for calls of one sample
    duration  of a simulation [s], without torques
    methods   integrators of simulations, by default all

    The truth of calls is computed in double-double, and that is held against the exact engine; of crba_solve and the
    others it is that of aba, for the numbers of the model as they are. The truth of a motion is Gauss's collocation of
    order 32 in double-double, and how far it is from itself with twice the step is its certainty; where that is not
    small, the motion is too chaotic for any way to follow.

    Returns a Tradeoff: ``print`` shows it, ``front``, ``cheapest(tolerance)``, ``to_json()``, ``plot(path)``. It takes
    a few seconds, and the first time of all what there is to compile: seconds for calls, minutes for all integrators.
    The truth of a second takes seconds for an arm, a minute for a humanoid with light fingers.
    Raises  SpatialDynError for a task, states, batch or duration that are none, or where mpmath is not installed;
            ModelError for mimic joints; what the call raises for its states.

    >>> import spatialdyn as sd
    >>> table = sd.trade(sd.load_urdf("two_link"), "mass_matrix")
    >>> table.cheapest(1e-12).code
    'sd.crba(model, q)'
    """
    check_model(model)
    if not isinstance(task, str) or task not in TASKS:
        raise SpatialDynError(f"task is {task!r}, expected one of {', '.join(TASKS)}")
    if model.mimic_matrix is not None:
        raise ModelError(f'model "{model.name}" has mimic joints, expected one without (mimic=False) to trade')
    if not model.nv:
        raise ModelError(f'model "{model.name}" has no joint that moves, expected one that does')
    samples, seconds = as_count(batch, call_errors.MOST), as_number(duration)
    if not samples:
        raise SpatialDynError(f"batch is {batch!r}, expected a number of samples of 1 to {call_errors.MOST}")
    if not 0.0 < seconds < math.inf:
        raise SpatialDynError(f"duration is {duration!r}, expected a finite number of seconds above 0")
    names = None if methods is None else words("methods", methods, integrators)
    if names == ():
        raise SpatialDynError(f"methods is {methods!r}, expected some of {', '.join(integrators)}")
    if task == "simulate":
        options, count, certainty = integrator_errors.measured(model, states, seconds, names)
        truth = f"double-double, {figure(certainty)} from itself with twice the step"
        found = (
            integrator_errors.further(model, seconds, options)
            if call_errors.drawn(states) and not numba_kernels.PLAIN
            else None
        )
        return Tradeoff(model.name, task, marked(options), count, 0, seconds, certainty, truth, found)
    options, count, certainty = call_errors.measured(model, task, states, samples)
    truth = f"double-double, {figure(certainty)} from the exact engine"
    more = call_errors.further(model, task) if call_errors.drawn(states) and not numba_kernels.PLAIN else None
    return Tradeoff(model.name, task, marked(options), count, samples, 0.0, certainty, truth, more)


def recommend(
    model: Model,
    task: str = "forward_dynamics",
    tolerance: float = 1e-6,
    states: Any = None,
    batch: int = BATCH,
    duration: float = 1.0,
    methods: str | Sequence[str] | None = None,
) -> Recommendation:
    """The cheapest way of doing a task whose error stays within a tolerance, and why.

    tolerance  largest error that will do, as ``trade`` defines it for the task
    model, task, states, batch, duration, methods   as in ``trade``

    A way is taken for good enough if its largest error times a margin of 2 or more is within the tolerance; the margin
    is larger where errors scatter widely or states are few, for other states may be worse than those measured. Where
    that leaves open whether a cheaper way will do, it is tried in 65536 random states, after which a margin of 1.25 may
    be enough. Motions from a few states say little, so a way to simulate is tried from 32 others, its truth a way a
    hundred times better. Neither is done if it takes longer than 4 seconds, or if the states are given.

    Returns a Recommendation: ``code`` is what to write, ``why`` the reason, and it can be called like the task's own
    call, a simulation's with (q0, v0, duration).
    Raises  SpatialDynError if no way is good enough, naming the best; what ``trade`` raises.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> chosen = sd.recommend(model, "inverse_dynamics", tolerance=1e-12)
    >>> chosen.code
    'sd.rnea(model, q, v, a)'
    >>> chosen([0.5, -0.3], [0.0, 0.0], [0.0, 0.0]).shape
    (2,)
    """
    within = checked_tolerance(tolerance)  # before anything is measured
    return advice(trade(model, task, states, batch, duration, methods), within)


def advice(found: Tradeoff, tolerance: float) -> Recommendation:
    """The cheapest of what ``trade`` has found that stays within a tolerance. Raises what ``recommend`` does."""
    tolerance = checked_tolerance(tolerance)
    if found.task == "simulate" and found.further is not None:
        chosen = _confirmed(found, tolerance)
    else:
        chosen = found.cheapest(tolerance)
        chosen = _cheaper(found, chosen, tolerance) or chosen
    if chosen is None:
        best = min(found.options, key=lambda x: x.bound)
        raise SpatialDynError(
            f'tolerance is {tolerance:g} for {found.task} of "{found.model}", expected at least {best.bound:.1e}, '
            f"the bound of {best.name}"
        )
    return Recommendation(chosen, _why(found, chosen, tolerance), tolerance, found)


def _cheaper(found: Tradeoff, chosen: Option | None, tolerance: float) -> Option | None:
    """A way cheaper than the chosen one that many more states show to be good enough, None if there is none."""
    most = math.inf if chosen is None else chosen.ns / WORTH
    open_ = [x for x in found.options if x.ns < most and x.error <= tolerance < x.bound]
    if not open_ or found.further is None:
        return None
    errors = found.further(open_, tolerance) or {}
    return next((x for x in (_in_more(x, errors.get(x.name), tolerance) for x in open_) if x is not None), None)


def _confirmed(found: Tradeoff, tolerance: float) -> Option | None:
    """The cheapest way that motions from more states show to be good enough, for those of a few say little.

    Where that cannot be told the bound decides.
    """
    assert found.further is not None
    for x in found.options:
        if x.error <= tolerance:
            errors = found.further([x], tolerance)
            good = _in_more(x, errors.get(x.name), tolerance) if errors is not None else x
            if good is not None and good.bound <= tolerance:
                return good
    return None


def _in_more(x: Option, errors: Any, tolerance: float) -> Option | None:
    """A way with its errors in more states, if there are any and their bound is within a tolerance."""
    if errors is None:
        return None
    worst = max(x.error, float(errors.max()))
    limit = max(bound(errors), worst * (MANY_LEAST if len(errors) >= MANY else LEAST))
    if not limit <= tolerance:
        return None
    return replace(x, error=worst, usual=float(np.median(errors)), bound=limit, states=len(errors))


def _why(found: Tradeoff, chosen: Option, tolerance: float) -> str:
    """The reason in words: its error and margin, and what was passed over."""
    of = f"{chosen.states or found.states} states"
    lines = [
        f"{chosen.name}: {chosen.ns:.4g} {found.unit}, error at most {figure(chosen.error)} in {of}, expected below "
        f"{figure(chosen.bound)} in others, within {tolerance:g}"
    ]
    cheaper = [x for x in found.options if x.ns < chosen.ns]
    if cheaper:
        best = min(cheaper, key=lambda x: x.bound)
        lines.append(
            f"cheaper is {best.name} ({best.ns:.4g} {found.unit}), with {figure(best.error)}, expected below "
            f"{figure(best.bound)}" + (", which more states have not borne out" if best.bound <= tolerance else "")
        )
    better = [x for x in found.options if x.bound < chosen.bound and x.ns > chosen.ns]
    if better:
        best = min(better, key=lambda x: x.ns)
        lines.append(f"the next better costs {best.ns / chosen.ns:.2g} times that: {best.name}")
    return "; ".join(lines)
