"""Errors and costs of calls: as a program on SIMD lanes in float64 or float32, or in the table kernel."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_array, as_count
from ..calls.dynamics import calls
from ..calls.forward_dynamics import EXTENDED, extended_runs_on_lanes, forward_dynamics
from ..calls.progress import Report, Steps
from ..calls.random_configurations import random_configuration
from ..calls.specialize import specialize
from ..engines import run as engine
from ..engines.compiled import numba_kernels
from ..engines.compiled.numba_kernels import variant
from ..engines.extended import LEAST_BATCH
from ..engines.programs.record import recording
from ..engines.programs.transform import derived
from ..errors import InertiaError, NonFiniteError, ShapeError, SpatialDynError, literal
from ..model.model import Model
from ..recursions import SPECS
from .references import EACH, LARGEST, MANY, MANY_LEAST, NORMS, error_bound, of_calls, relative, truths
from .results import INPUTS, Option

Array = NDArray[np.float64]

TASK_CALLS = {
    "forward_dynamics": ("aba", "crba_solve", "aba_refined", "aba_square_root", EXTENDED),
    "inverse_dynamics": ("rnea",),
    "mass_matrix": ("crba",),
}
WHEN_NAMED = ("aba_square_root",)  # only if named: it has no program, and its kernel takes long to compile
STATES = 8 if numba_kernels.PLAIN else 4096  # with fewer, other states exceed the bound too often
ROUNDS = 25  # the fastest counts
SECONDS = 5e-4  # per candidate and round: short, so that some round is undisturbed
SLOW = 1.0  # a run that takes so many seconds is timed once
SPENT = 0.3  # total per candidate, beyond 3 rounds
MOST = 1 << 24  # random or timed samples at once
MOST_NUMBERS = 1 << 24  # in the results of all samples, or in M where a call factors it, unless samples are given
CHUNK = 1024  # further states at a time; an option that fails in one chunk skips the rest
HALF_ULP = 2.0**-53  # of the result: the least error of "extended", which rounds the reference itself
MOST_BOUNDED = 12  # freedoms up to which rounding is analysed: the analysis of aba needs M⁻¹
PATIENCE = 4.0  # seconds of this thread spent on further states


class Candidate(NamedTuple):
    """An option before it is measured."""

    name: str
    code: str
    dtype: type
    run: Callable[..., Any]


def calls_of(model: Model, task: str, wanted: tuple[str, ...] | None = None) -> list[str]:
    """The calls of a task that have all terms of a model: all but WHEN_NAMED, or those wanted."""
    names = [name for name in TASK_CALLS[task] if (name not in WHEN_NAMED if wanted is None else name in wanted)]
    lacks = {name: SPECS[name].lacks if name in SPECS else () for name in names}
    return [name for name, columns in lacks.items() if not any(model.bodies[x].any() for x in columns)]


def call_states(model: Model, task: str, states: Any) -> list[Array]:
    """The inputs of a task: the given arrays, or that many random states.

    Random torques are normal, scaled per joint to the inverse dynamics of normal v and a.
    Raises ShapeError, SpatialDynError for invalid states.
    """
    names = INPUTS[task]
    if is_count(states):
        count = usual_count(model, task, STATES) if states is None else as_count(states, MOST)
        if not count:
            raise SpatialDynError(f"states is {literal(states)}, expected 1 to {MOST}, or arrays {', '.join(names)}")
        return random_call_states(model, task, count, 0)
    given = list(states) if isinstance(states, (tuple, list)) else [states]
    if len(given) != len(names):
        raise ShapeError(f"states has {len(given)} arrays, expected {len(names)}: {', '.join(names)}")
    arrays = []
    for name, value in zip(names, given, strict=True):
        x, size = as_array(name, value), model.nq if name == "q" else model.nv
        if x.ndim not in (1, 2) or x.shape[-1] != size or not x.size:
            raise ShapeError(f"{name} has shape {x.shape}, expected (n, {size})")
        arrays.append(np.ascontiguousarray(x.reshape(-1, size)))
    if len({len(x) for x in arrays}) > 1:
        raise ShapeError(f"states has {', '.join(str(len(x)) for x in arrays)} samples, expected one number")
    if not all(np.isfinite(x).all() for x in arrays):
        raise NonFiniteError("states holds numbers that are not finite, expected finite ones")
    return arrays


def usual_count(model: Model, task: str, most: int) -> int:
    """So many samples, fewer for large robots: 4096 up to 64 freedoms, 186 at 300, but for inverse dynamics.

    4096 mass matrices of 300 freedoms would take 3 GB, and in double-double a minute of processor time.
    """
    return max(1, min(most, MOST_NUMBERS // max(1, model.nv) ** (1 if task == "inverse_dynamics" else 2)))


def is_count(states: Any) -> bool:
    """Whether ``states`` is the number of random states: None or a whole number."""
    return states is None or (isinstance(states, (int, np.integer)) and not isinstance(states, bool))


def random_call_states(model: Model, task: str, count: int, seed: int | list[int]) -> list[Array]:
    """Random inputs of a task."""
    rng = np.random.default_rng(seed)
    q = random_configuration(model, rng, count)
    v, a, tau = rng.normal(size=(3, count, model.nv))
    if task == "forward_dynamics":
        typical = np.asarray(calls["rnea"](model, q, v, a))
        tau = tau * np.sqrt((typical**2).mean(axis=0))
    return {"forward_dynamics": [q, v, tau], "inverse_dynamics": [q, v, a], "mass_matrix": [q]}[task]


def candidates(model: Model, task: str, batch: int, wanted: tuple[str, ...] | None = None) -> Iterator[list[Candidate]]:
    """The candidates of each call for a task, at a batch size; making them compiles."""
    given = ", ".join(INPUTS[task])
    for name in calls_of(model, task, wanted):
        found: list[Candidate] = []
        extended = name == EXTENDED
        call = partial(forward_dynamics, method=EXTENDED) if extended else calls[name]
        code = f'sd.forward_dynamics(model, {given}, method="{name}")' if extended else f"sd.{name}(model, {given})"
        traces = _traces(model, name)
        way = "lanes" if traces and (not extended or batch >= LEAST_BATCH) else "untraced"
        if traces and not extended:
            engine.compile_program(variant(SPECS[name], ()), model, ())  # compile the timed code
            k = specialize(model, call, dtype=np.float32)
            if k.engine == "lanes":
                text = f"sd.specialize(model, sd.{name}, dtype=np.float32)({given})"
                found.append(Candidate(f"lanes float32 {name}", text, np.float32, k))
        found.append(Candidate(f"{way} float64 {name}", code, np.float64, partial(call, model)))
        yield found


def _traces(model: Model, name: str) -> bool:
    if name == EXTENDED:
        return extended_runs_on_lanes(model)
    return not numba_kernels.PLAIN and engine.program(variant(SPECS[name], ()), model, ()) is not None


def _errors(name: str, first: str, found: Any, truth: Array, norm: str = LARGEST) -> Array:
    """Errors of a candidate; if it rounds the reference itself, at least half an ulp."""
    errors = of_calls(first, np.asarray(found), truth, norm)
    return np.maximum(errors, HALF_ULP) if name.endswith(EXTENDED) else errors


def measure_calls(
    model: Model, task: str, states: Any, batch: int, wanted: tuple[str, ...] | None, report: Report
) -> tuple[list[Option], int, float]:
    """Options of a task, the number of states they were measured in, and the error of the reference."""
    steps = Steps(report, len(calls_of(model, task, wanted)) + 2)
    arrays = call_states(model, task, states)
    first = TASK_CALLS[task][0]
    calls[first](model, *arrays)  # raises for invalid states or an invalid model
    truth, certainty = truths(model, first, arrays)
    steps.next()
    repeated = [np.ascontiguousarray(np.resize(x, (batch, x.shape[1]))) for x in arrays]
    if batch == 1:
        repeated = [np.array(x[0]) for x in repeated]
    found: list[tuple[Candidate, dict[str, Array], str]] = []
    promises: dict[str, dict[str, Array]] = {}
    for some in candidates(model, task, batch, wanted):
        for candidate in some:
            try:
                made, note = candidate.run(*arrays), ""
                errors = {norm: _errors(candidate.name, first, made, truth, norm) for norm in NORMS}
            except (InertiaError, NonFiniteError) as error:
                errors, note = dict.fromkeys(NORMS, np.full(1, math.inf)), str(error)
            promises[candidate.name] = _promised(model, candidate, first, arrays, truth)
            found.append((candidate, errors, note))
        steps.next()
    timed = {
        candidate.name: partial(candidate.run, *(x.astype(candidate.dtype) for x in repeated))
        for candidate, errors, _ in found
        if np.isfinite(errors[LARGEST]).all()
    }
    ns = costs(timed, batch)
    steps.next()
    options = []
    for candidate, errors, note in found:
        promised, of = promises[candidate.name], errors[LARGEST]
        bounds = {norm: min(error_bound(errors[norm]), error_bound(promised[norm])) for norm in NORMS}
        options.append(
            Option(
                candidate.name, candidate.code, float(of.max()), float(np.median(of)), bounds[LARGEST],
                ns.get(candidate.name, math.inf), note=note, run=candidate.run, promised=float(promised[LARGEST].max()),
                each=float(errors[EACH].max()), each_bound=bounds[EACH],
            )
        )  # fmt: skip
    return options, len(arrays[0]), certainty


def _promised(model: Model, candidate: Candidate, first: str, arrays: list[Array], truth: Array) -> dict[str, Array]:
    """Bounds on the errors of a program, by norm, for its rounding in NumPy: without fused operations, which changes no
    printed digit. Infinite for other candidates, and for robots of more than MOST_BOUNDED freedoms, whose analysis
    would take longer than all else.
    """
    way, _, name = candidate.name.rpartition(" ")
    if not way.startswith("lanes") or name == EXTENDED or model.nv > MOST_BOUNDED:
        return dict.fromkeys(NORMS, np.full(1, math.inf))
    options = recording.ProgramOptions(bounds=True)
    program, layout = derived.record((variant(SPECS[name], ()),), model.bodies, (), options, candidate.dtype)
    columns: NDArray[Any] = np.concatenate(arrays, axis=1).astype(candidate.dtype).T
    with np.errstate(all="ignore"):
        bounds = program.only(layout.outputs[1]).run(columns)
    off = np.array([np.broadcast_to(x, len(truth)) for x in bounds], np.float64).T.reshape(truth.shape)
    off = np.where(np.isnan(off), math.inf, off)
    return {norm: relative(first, off, truth, norm) for norm in NORMS}


def confirm_calls(
    model: Model, task: str, options: Sequence[Option], tolerance: float, norm: str = LARGEST
) -> dict[str, Array] | None:
    """Errors in MANY further states of the options within the tolerance; options that exceed it are left out.

    Returns None if the references of MANY states take longer than PATIENCE.
    """
    first = TASK_CALLS[task][0]
    began, errors = time.thread_time(), {x.name: np.empty(0) for x in options}
    chunk = usual_count(model, task, CHUNK)
    parts = -(-MANY // chunk)
    for k in range(parts):
        arrays = random_call_states(model, task, chunk, [0, k + 1])
        truth, _ = truths(model, first, arrays, 0)
        for x in options:
            if x.name not in errors or x.run is None:
                continue
            try:
                found = _errors(x.name, first, x.run(*arrays), truth, norm)
            except (InertiaError, NonFiniteError):
                found = np.full(1, math.inf)
            errors[x.name] = np.append(errors[x.name], found)
            if MANY_LEAST * found.max() > tolerance:
                del errors[x.name]
        if not errors:
            break
        if k + 1 < parts and time.thread_time() - began > PATIENCE:
            return None
    return errors


def costs(runs: Mapping[str, Callable[[], Any]], batch: int) -> dict[str, float]:
    """Nanoseconds per sample, of the fastest of interleaved rounds; of one run where it takes longer than SLOW."""
    repeats, spent, best = {}, dict.fromkeys(runs, 0.0), dict.fromkeys(runs, math.inf)
    for name, run in runs.items():
        run()  # compiles
        once = _seconds(run, 1)
        repeats[name] = max(1, int(SECONDS / max(once, 1e-9)))
        if once > SLOW:
            spent[name], best[name] = math.inf, once
    for k in range(2 if numba_kernels.PLAIN else ROUNDS):
        for name, run in runs.items():
            if spent[name] < SPENT or (k < 3 and math.isfinite(spent[name])):
                once = _seconds(run, repeats[name])
                spent[name] += once * repeats[name]
                best[name] = min(best[name], once)
    return {name: 1e9 * x / batch for name, x in best.items()}


def _seconds(run: Callable[[], Any], repeats: int) -> float:
    start = time.perf_counter()
    for _ in range(repeats):
        run()
    return (time.perf_counter() - start) / repeats
