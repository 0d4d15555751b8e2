"""Errors and costs of integrators at steps from coarse to fine, against the motion in double-double, or, for a scene,
at a finer step.
"""

from __future__ import annotations

import importlib.util
import math
import time
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_array, as_count
from ..calls.dynamics import calls
from ..calls.progress import Report, Steps
from ..calls.random_configurations import random_configuration
from ..engines.compiled import numba_kernels
from ..errors import NonFiniteError, ShapeError, SimulationError, SpatialDynError, literal
from ..model.model import Model
from ..simulation import integrators, simulate
from ..simulation.scene import Scene, check_method
from .call_errors import PATIENCE, is_count
from .reference_motion import ReferenceMotion, exact_motion
from .references import EACH, LARGEST, NORMS, SMALL, error_bound
from .results import Option

Array = NDArray[np.float64]

STATES = 4
MOST = 1 << 12
SAMPLES = 10  # times at which motions are compared
FIRST, FACTOR = 40, 4  # steps of the coarsest run; factor to the next finer one
BUDGET = 0.15  # longest run [s]
FINEST = 2.0  # longest run of the reference of a scene [s]
MOST_STEPS = 1 << 16
AGREED = 1e-11  # relative difference to a run of a fourth of the steps below which a reference is fine enough
FLOOR = 0.3  # a finer step that leaves more than this share of the error is the last
MORE = 32  # further states, after which a margin of 2 may be enough
FINER = 0.01  # error of a reference motion, relative to the tolerance
TOLERANCES = (1e-6, 1e-9, 1e-12)  # rtol of adaptive methods


def motion_states(model: Model, states: Any) -> tuple[Array, Array]:
    """The given (q0, v0), or that many random configurations at rest."""
    if is_count(states):
        count = STATES if states is None else as_count(states, MOST)
        if not count:
            raise SpatialDynError(f"states is {literal(states)}, expected 1 to {MOST}, or arrays q0, v0")
        return random_motion_states(model, count, 0)
    try:
        given = dict(zip(("q0", "v0"), states, strict=True))
    except (TypeError, ValueError):
        raise ShapeError("states is no pair of arrays, expected q0 and v0") from None
    q0, v0 = (np.atleast_2d(as_array(name, x)) for name, x in given.items())
    if q0.shape != (len(q0), model.nq) or v0.shape != (len(q0), model.nv) or not len(q0):
        raise ShapeError(f"states has shapes {q0.shape} and {v0.shape}, expected (n, {model.nq}) and (n, {model.nv})")
    if not (np.isfinite(q0).all() and np.isfinite(v0).all()):
        raise NonFiniteError("states holds numbers that are not finite, expected finite ones")
    return q0, v0


def random_motion_states(model: Model, count: int, seed: int | list[int]) -> tuple[Array, Array]:
    """Random configurations at rest."""
    return random_configuration(model, np.random.default_rng(seed), count), np.zeros((count, model.nv))


def measure_motions(
    scene: Scene, states: Any, duration: float, methods: Sequence[str] | None, report: Report
) -> tuple[list[Option], int, float]:
    """Options of a simulation, the number of states they were measured in, and the error of the reference.

    methods  names of integrators, None for all that are installed and take the scene
    """
    model, names = scene.model, list(scene.methods if methods is None else methods)
    if methods is None and importlib.util.find_spec("scipy") is None:
        names = [name for name in names if integrators[name].family is not None]
    for name in names:
        check_method(scene, name, integrators)
    steps = Steps(report, len(names) + 1)
    q0, v0 = motion_states(model, states)
    calls["aba"](model, q0, v0, np.zeros(model.nv))  # raises for invalid states or an invalid model
    t = np.linspace(0.0, duration, SAMPLES + 1)
    truth = fine_motion(scene, q0, v0, t) if scene.acts else exact_motion(model, q0, v0, t)
    steps.next()
    options = []
    for name in names:
        method = integrators[name]
        options += _fixed(scene, name, truth, duration) if method.family else _adaptive(scene, name, truth, duration)
        steps.next()
    return options, len(q0), float(truth.error.max())


def fine_motion(scene: Scene, q0: Array, v0: Array, t: Array) -> ReferenceMotion:
    """Motions of a scene by its method, at finer and finer steps, until two agree or a run costs much."""
    steps, before, model = 4 * FIRST, None, scene.model
    while True:
        began, runs = time.thread_time(), []
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for q, v in zip(q0, v0, strict=True):
                runs.append(
                    simulate(scene, q, v, t[-1], dt=t[-1] / steps, method=scene.method, record=steps // SAMPLES)
                )
        q, v = np.stack([x.q for x in runs], 1), np.stack([x.v for x in runs], 1)
        if before is not None:
            way = np.maximum.accumulate(abs(calls["difference"](model, np.broadcast_to(q[:1], q.shape), q)))
            off = _relative(abs(calls["difference"](model, before[0], q)), way)
            error = np.maximum(off, _relative(abs(before[1] - v), np.maximum.accumulate(abs(v))))
            spent = (time.thread_time() - began) / len(q0)
            if error.max() <= AGREED or spent * FACTOR > FINEST or steps > MOST_STEPS or numba_kernels.PLAIN:
                return ReferenceMotion(t, q, v, error, steps)
        before, steps = (q, v), FACTOR * steps


def _relative(wrong: Array, size: Array) -> Array:
    """(N,) the largest entry of (N, K, nv), relative to the largest size of each motion until then."""
    largest = np.maximum(size.max(axis=2), np.finfo(float).tiny)
    made: Array = (wrong.max(axis=2) / largest).max(axis=1)
    return made


def motion_error(model: Model, run: Any, truth: ReferenceMotion, k: int, norm: str = LARGEST) -> float:
    """Error of a motion: the largest of q over the largest change of a coordinate, and of v over the largest |v|.

    norm  "each": each coordinate relative to its own change, or to SMALL times the largest change if that is larger
    """
    if len(run) != len(truth.t) or not (np.isfinite(run.q).all() and np.isfinite(run.v).all()):
        return math.inf
    q, v = truth.q[:, k], truth.v[:, k]
    wrong = abs(np.asarray(calls["difference"](model, q, calls["normalize"](model, run.q)))).max(axis=0)
    way = abs(np.asarray(calls["difference"](model, np.broadcast_to(q[0], q.shape), q))).max(axis=0)
    return max(_over(wrong, way, norm), _over(abs(run.v - v).max(axis=0), abs(v).max(axis=0), norm))


def confirm_motions(
    scene: Scene, duration: float, options: Sequence[Option], open_: Sequence[Option], tolerance: float,
    norm: str = LARGEST,
) -> dict[str, Array] | None:  # fmt: skip
    """Errors in MORE further states, of the options ``open_`` that are within the tolerance.

    The reference is another option, whose bound is at most a hundredth of the tolerance and, if possible, of the errors
    of the judged options; its bound is added to their errors. Returns None without such an option, or if it takes
    longer than PATIENCE.
    """
    t = np.linspace(0.0, duration, SAMPLES + 1)
    finer = _finer(options, open_, tolerance)
    if finer is None or finer.run is None:
        return None
    began, errors = time.thread_time(), {x.name: np.empty(0) for x in open_}
    for q, v in zip(*random_motion_states(scene.model, MORE, [0, 1]), strict=True):
        try:
            best = finer.run(q, v, duration, sampled=True)
        except (SimulationError, NonFiniteError):
            return None
        truth = ReferenceMotion(t, best.q[:, None], best.v[:, None], np.zeros(len(best)), 0)
        for x in open_:
            if x.name not in errors or x.run is None:
                continue
            try:
                run = x.run(q, v, duration, sampled=True)
                found = motion_error(scene.model, run, truth, 0, norm) + finer.bound
            except (SimulationError, NonFiniteError):
                found = math.inf
            errors[x.name] = np.append(errors[x.name], found)
            if found > tolerance:
                del errors[x.name]
        if not errors:
            break
        if time.thread_time() - began > PATIENCE:
            return None
    return errors


def _finer(options: Sequence[Option], judged: Sequence[Option], tolerance: float) -> Option | None:
    """The cheapest option accurate enough as a reference for others; else the most accurate."""
    names = {x.name for x in judged}
    others = [x for x in options if x.name not in names and x.bound <= FINER * tolerance]
    goal = FINER * min((x.error for x in judged), default=0.0)
    fine = [x for x in others if x.bound <= goal]
    return min(fine, key=lambda x: x.ns) if fine else min(others, key=lambda x: x.bound, default=None)


def _over(wrong: Array, size: Array, norm: str) -> float:
    """The largest of errors (nv,) over the largest size, or each over its own."""
    largest = float(size.max(initial=0.0))
    if not largest > 0.0:
        return float(wrong.max(initial=0.0))
    scale = np.maximum(size, SMALL * largest) if norm == EACH else largest
    return float((wrong / scale).max(initial=0.0))


def _fixed(scene: Scene, name: str, truth: ReferenceMotion, duration: float) -> list[Option]:
    """Options of a method at finer and finer steps, until they cost too much or gain nothing."""
    found: list[Option] = []
    steps = FIRST
    while True:
        dt = duration / steps
        option = _option(scene, f"{name}, dt {dt:.3g}", f'{dt!r}, "{name}"', truth, duration, method=name, dt=dt)
        found.append(option)
        seconds = option.ns * 1e-9 * duration
        stale = len(found) > 1 and math.isfinite(option.error) and not option.error < FLOOR * found[-2].error
        if numba_kernels.PLAIN or stale or seconds * FACTOR > BUDGET:
            return found
        steps *= FACTOR


def _adaptive(scene: Scene, name: str, truth: ReferenceMotion, duration: float) -> list[Option]:
    """Options of a method at several tolerances."""
    made = []
    for rtol in TOLERANCES:
        words = {"dt": duration / SAMPLES, "rtol": rtol, "atol": 1e-3 * rtol}
        code = f'{words["dt"]!r}, "{name}", rtol={rtol!r}, atol={words["atol"]!r}'
        made.append(_option(scene, f"{name}, rtol {rtol:g}", code, truth, duration, method=name, **words))
        if numba_kernels.PLAIN or made[-1].ns * 1e-9 * duration > BUDGET:
            break
    return made


def _motion(
    scene: Scene, every: int, words: Mapping[str, Any], q0: Any, v0: Any, duration: float, sampled: bool = False
) -> Any:
    """The run of an option; sampled: recorded at every so many steps."""
    return simulate(scene, q0, v0, duration, record=every if sampled else None, **words)


def _option(scene: Scene, label: str, code: str, truth: ReferenceMotion, duration: float, **words: Any) -> Option:
    """The option of a method, measured on all motions."""
    run = partial(_motion, scene, max(1, round(duration / words["dt"] / SAMPLES)), words)
    errors: dict[str, list[float]] = {norm: [] for norm in NORMS}
    seconds, note = [], ""
    uncertain = float(truth.error.max()) if scene.acts else 0.0  # that of double-double is far below any option's
    motions = range(truth.q.shape[1])
    for k in motions if len(motions) > 1 else (0, 0):  # at least two runs: the faster counts
        start = (truth.q[0, k], truth.v[0, k], duration, True)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                if not k:
                    run(truth.q[0, 0], truth.v[0, 0], min(duration, 3 * words["dt"]))  # compiles
                began = time.perf_counter()
                found = run(*start)
            seconds.append(time.perf_counter() - began)
            for norm, known in errors.items():
                known.append(motion_error(scene.model, found, truth, k, norm) + uncertain)
        except (SimulationError, NonFiniteError) as error:
            for known in errors.values():
                known.append(math.inf)
            note = str(error)
    of_all, each = (np.array(errors[norm]) for norm in NORMS)
    ns = 1e9 * min(seconds) / duration if seconds else math.inf
    full = f"sd.simulate({'scene' if scene.acts else 'model'}, q0, v0, duration, {code})"
    return Option(
        label, full, float(of_all.max()), float(np.median(of_all)), error_bound(of_all), ns, note=note, run=run,
        each=float(each.max()), each_bound=error_bound(each),
    )  # fmt: skip
