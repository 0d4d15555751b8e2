"""Errors and costs of the options for a task, measured, and the cheapest option within a tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ..calls.arguments import as_count, as_number, as_word, as_words
from ..calls.progress import Progress, check_progress, reporting
from ..engines.compiled import numba_kernels
from ..errors import ModelError, SpatialDynError, literal
from ..model.model import Model
from ..simulation import integrators
from ..simulation.scene import Scene, scene_of
from . import call_errors, integrator_errors
from .references import EACH, LARGEST, LEAST, MANY, MANY_LEAST, NORMS, error_bound
from .results import Option, Recommendation, Tradeoff, checked_tolerance, figure, mark_pareto

TASKS = (*call_errors.TASK_CALLS, "simulate")
BATCH = 8 if numba_kernels.PLAIN else 4096
WORTH = 1.1  # an option must be this many times faster to be tried in more states


def trade(
    model: Model | Scene,
    task: str = "forward_dynamics",
    states: Any = None,
    batch: int | None = None,
    duration: float = 1.0,
    methods: str | Sequence[str] | None = None,
    progress: Progress = False,
) -> Tradeoff:
    """Error and cost of the options for a task, measured on this model and this machine.

    model     Model; for simulations also a Scene: all its effects act in every option
    task      the task, with its calls and the scale of its errors:

              ==================  ==================================================  ==============================
              "forward_dynamics"  aba, crba_solve, aba_refined, aba_square_root,      largest over largest of a
                                  ``forward_dynamics(method="extended")``
              "inverse_dynamics"  rnea                                                largest over largest of tau
              "mass_matrix"       crba                                                entries over √(M_ii M_jj)
              "simulate"          every integrator, at steps from coarse to fine      q over the largest change of
                                                                                      a coordinate, v over the
                                                                                      largest, at 10 times
              ==================  ==================================================  ==============================

              The column "worst joint" is relative to each joint's own scale, see ``Option.each``.
              In a state whose largest entry is below a tenth of the states' median, errors are relative to that tenth.
              Calls run as programs on SIMD lanes in float64 and float32 (with inputs rounded to float32); those without
              a program run in the table kernel, "untraced"; "extended" runs on lanes in batches of 512 or more, up to
              32 freedoms.
    states    states in which errors are measured: the number of random states, or a tuple of arrays (n, ...):
              (q, v, tau), (q, v, a), (q,). 4096 by default; beyond 64 freedoms fewer, 186 at 300, but for inverse
              dynamics. For simulations (q0, v0), by default 4 random states at rest
    batch     samples of a timed call, by default as many as states by default; 1: calls of one sample are timed
    duration  of a simulation [s], without torques
    methods   names of integrators of simulations, or of calls of the table, by default all but ``aba_square_root``:
              it has no program, and its kernel takes long to compile at its first use on a machine
    progress  True for a bar (needs rich), or a function of the number of steps done and their total

    The reference of calls is computed in double-double and checked against the exact engine. All methods of forward
    dynamics have aba's reference, for the model's numbers as they are; "extended" rounds this reference, so its error
    counts as at least half an ulp of the largest entry. The reference of a motion is Gauss collocation of order 32 in
    double-double; its difference from a run with twice the step is the certainty. The reference of a scene is a run of
    its own method at a fine step; its difference from a run with four times the step is added to every error. If that
    is not small, the motion is too chaotic for any method to follow. For programs, ``promised`` is the largest bound on
    their rounding in the same states, by the analysis of ``bounded``; if smaller, it is an option's ``bound``.

    Returns a Tradeoff: ``print`` shows it, ``front``, ``cheapest(tolerance)``, ``to_json()``, ``plot(path)``. It takes
    a few seconds, at first use also the time to compile: seconds for calls, minutes for all integrators. The reference
    of a motion of 1 s takes seconds for an arm, a minute for a humanoid with light fingers.
    Raises  SpatialDynError for an invalid task, states, batch or duration, or if mpmath is not installed;
            ModelError for a model without freedoms; the errors of the call for its states.

    >>> import spatialdyn as sd
    >>> table = sd.trade(sd.load_urdf("two_link"), "mass_matrix")
    >>> table.cheapest(1e-12).code
    'sd.crba(model, q)'
    """
    scene = scene_of(model)
    model = scene.model
    if not isinstance(task, str) or task not in TASKS:
        raise SpatialDynError(f"task is {literal(task)}, expected one of {', '.join(TASKS)}")
    if scene.acts and task != "simulate":
        raise SpatialDynError(f'task is "{task}" of a Scene, expected "simulate", or its model in place of the scene')
    if not model.nv:
        raise ModelError(f'model "{model.name}" has no joint that moves, expected one that does')
    usual = call_errors.usual_count(model, task, BATCH)
    samples, seconds = usual if batch is None else as_count(batch, call_errors.MOST), as_number(duration)
    if not samples:
        raise SpatialDynError(f"batch is {literal(batch)}, expected a number of samples of 1 to {call_errors.MOST}")
    if not 0.0 < seconds < math.inf:
        raise SpatialDynError(f"duration is {literal(duration)}, expected a finite number of seconds above 0")
    known = integrators if task == "simulate" else call_errors.TASK_CALLS[task]
    names = None if methods is None else as_words("methods", methods, known)
    if names == ():
        raise SpatialDynError(f"methods is {literal(methods)}, expected some of {', '.join(known)}")
    check_progress(progress)
    if task == "simulate":
        with reporting(progress, "trade") as report:
            options, count, certainty = integrator_errors.measure_motions(scene, states, seconds, names, report)
        how = "the scene at a fine step" if scene.acts else "double-double"
        truth = f"{how}, {figure(certainty)} from itself with {'four times' if scene.acts else 'twice'} the step"
        found = (
            partial(integrator_errors.confirm_motions, scene, seconds, options)
            if call_errors.is_count(states) and not numba_kernels.PLAIN
            else None
        )
        return Tradeoff(model.name, task, mark_pareto(options), count, 0, seconds, certainty, truth, found, model)
    with reporting(progress, "trade") as report:
        options, count, certainty = call_errors.measure_calls(model, task, states, samples, names, report)
    truth = f"double-double, {figure(certainty)} from the exact engine"
    more = (
        partial(call_errors.confirm_calls, model, task)
        if call_errors.is_count(states) and not numba_kernels.PLAIN
        else None
    )
    return Tradeoff(model.name, task, mark_pareto(options), count, samples, 0.0, certainty, truth, more, model)


def recommend(
    model: Model | Scene,
    task: str = "forward_dynamics",
    tolerance: float = 1e-6,
    states: Any = None,
    batch: int | None = None,
    duration: float = 1.0,
    methods: str | Sequence[str] | None = None,
    progress: Progress = False,
    norm: str = LARGEST,
) -> Recommendation:
    """The cheapest option for a task whose error stays within a tolerance, and the reason.

    tolerance  largest acceptable error, as ``trade`` defines it for the task
    model, task, states, batch, duration, methods, progress   as in ``trade``
    norm       scale of the errors: "largest", as in ``trade``; or "each": every joint's error is within the tolerance
               relative to that joint's own scale, the column "worst joint" of the table

    An option is good enough if its bound is within the tolerance. The bound is its largest error times a margin of 2 or
    more, since other states may be worse than those measured; the margin is larger if errors scatter widely or states
    are few. A cheaper option whose error, but not its bound, is within the tolerance is tried in 65536 random states,
    after which a margin of 1.25 may be enough. Motions from a few states prove little, so an integrator is tried from
    32 other states, against a reference option a hundred times more accurate. Neither is done if it takes longer than
    4 s, or if states are given.

    Returns a Recommendation: ``code`` is the line to write, ``why`` the reason. It can be called like the task's call,
    or with (q0, v0, duration) for a simulation.
    Raises  SpatialDynError if no option is good enough, naming the best; the errors of ``trade``.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> chosen = sd.recommend(model, "inverse_dynamics", tolerance=1e-12)
    >>> chosen.code
    'sd.rnea(model, q, v, a)'
    >>> chosen([0.5, -0.3], [0.0, 0.0], [0.0, 0.0]).shape
    (2,)
    """
    within = checked_tolerance(tolerance)  # before anything is measured
    as_word("norm", norm, NORMS)
    return advice(trade(model, task, states, batch, duration, methods, progress), within, norm)


def advice(found: Tradeoff, tolerance: float, norm: str = LARGEST) -> Recommendation:
    """The cheapest option of a Tradeoff within a tolerance. Raises as ``recommend``."""
    tolerance = checked_tolerance(tolerance)
    found = _of_each(found) if as_word("norm", norm, NORMS) == EACH else found
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


def _of_each(found: Tradeoff) -> Tradeoff:
    """A Tradeoff with the errors of the worst joint, relative to its own scale."""
    options = [
        replace(x, error=x.each, median=math.nan, bound=x.each_bound, promised=math.inf, best=False)
        for x in found.options
    ]
    more = None if found.further is None else partial(found.further, norm=EACH)
    return replace(found, options=mark_pareto(options), further=more)


def _cheaper(found: Tradeoff, chosen: Option | None, tolerance: float) -> Option | None:
    """The cheapest option, cheaper than the chosen one, that many more states confirm; None if there is none."""
    most = math.inf if chosen is None else chosen.ns / WORTH
    open_ = [x for x in found.options if x.ns < most and x.error <= tolerance < x.bound]
    if not open_ or found.further is None:
        return None
    errors = found.further(open_, tolerance) or {}
    return next((x for x in (_in_more(x, errors.get(x.name), tolerance) for x in open_) if x is not None), None)


def _confirmed(found: Tradeoff, tolerance: float) -> Option | None:
    """The cheapest option that motions from more states confirm, as few states say little.

    Without an answer from them the bound decides.
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
    """An option with its errors in more states; None without errors or if their bound exceeds the tolerance."""
    if errors is None:
        return None
    worst = max(x.error, float(errors.max()))
    limit = max(error_bound(errors), worst * (MANY_LEAST if len(errors) >= MANY else LEAST))
    if not limit <= tolerance:
        return None
    return replace(x, error=worst, median=float(np.median(errors)), bound=limit, states=len(errors))


def _why(found: Tradeoff, chosen: Option, tolerance: float) -> str:
    """The reason in words: error and bound, the best cheaper option, and the next better one."""
    of = f"{chosen.states or found.states} states"
    lines = [
        f"{chosen.name}: {chosen.ns:.4g} {found.unit}, error at most {figure(chosen.error)} in {of}, expected below "
        f"{figure(chosen.bound)} in others, within {tolerance:g}"
    ]
    if chosen.promised < math.inf:
        lines.append(
            f"its rounding is bounded by {figure(chosen.promised)} there; sd.specialize(model, sd."
            f"{chosen.name.rpartition(' ')[2]}, tolerance=...) holds each answer to its own bound"
        )
    cheaper = [x for x in found.options if x.ns < chosen.ns]
    if cheaper:
        best = min(cheaper, key=lambda x: x.bound)
        lines.append(
            f"cheaper is {best.name} ({best.ns:.4g} {found.unit}), with {figure(best.error)}, expected below "
            f"{figure(best.bound)}" + (", which more states do not confirm" if best.bound <= tolerance else "")
        )
    better = [x for x in found.options if x.bound < chosen.bound and x.ns > chosen.ns]
    if better:
        best = min(better, key=lambda x: x.ns)
        lines.append(f"the next better costs {best.ns / chosen.ns:.2g} times that: {best.name}")
    return "; ".join(lines)
