"""Ways to answer a call: by the program on SIMD lanes in float64 or float32, or by the kernel for any model."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_array, as_count, broadcast
from ..calls.dynamics import calls
from ..calls.specialize import specialize
from ..calls.states import random_configuration
from ..engines.compiled import numba_kernels
from ..engines.programs import batch_kernels
from ..errors import InertiaError, NonFiniteError, ShapeError, SpatialDynError
from ..model.model import Model
from ..recursions import SPECS
from .references import MANY, MANY_LEAST, bound, of_calls, truths
from .results import INPUTS, Further, Option

Array = NDArray[np.float64]

TASKS = {
    "forward_dynamics": ("aba", "crba_solve", "aba_refined", "aba_square_root"),
    "inverse_dynamics": ("rnea",),
    "mass_matrix": ("crba",),
}
STATES = 8 if numba_kernels.PLAIN else 4096  # from 1024, one thousand other states of a UR5 in 12 goes beyond its bound
ROUNDS = 25  # of which the fastest counts
SECONDS = 5e-4  # a way in a round: short, so that some round is spared what else the machine does
SPENT = 0.3  # on a way that takes longer, and 3 rounds
MOST = 1 << 24  # samples that are drawn, or timed, at once
CHUNK = 1024  # more states at a time, so that what has failed in some is not tried in the others
PATIENCE = 4.0  # seconds of this thread on more states


class Way(NamedTuple):
    """A way before it is measured."""

    name: str
    code: str
    dtype: type
    run: Callable[..., Any]


def states_of(model: Model, task: str, states: Any) -> list[Array]:
    """The inputs of a task: those that are given, or so many random ones.

    Torques are normal, of the size that the inverse dynamics of normal v and a has in each joint.
    Raises ShapeError, SpatialDynError for states that are none.
    """
    names = INPUTS[task]
    if drawn(states):
        count = STATES if states is None else as_count(states, MOST)
        if not count:
            raise SpatialDynError(f"states is {states!r}, expected 1 to {MOST}, or arrays {', '.join(names)}")
        return random_states(model, task, count, 0)
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
        raise ShapeError(f"states has {', '.join(str(len(x)) for x in arrays)} samples, expected as many of each")
    if not all(np.isfinite(x).all() for x in arrays):
        raise NonFiniteError("states holds numbers that are not finite, expected finite ones")
    return arrays


def drawn(states: Any) -> bool:
    """Whether states are a number of random ones."""
    return states is None or (isinstance(states, (int, np.integer)) and not isinstance(states, bool))


def random_states(model: Model, task: str, count: int, seed: int | list[int]) -> list[Array]:
    """Random inputs of a task."""
    rng = np.random.default_rng(seed)
    q = random_configuration(model, rng, count)
    v, a, tau = rng.normal(size=(3, count, model.nv))
    if task == "forward_dynamics":
        usual = np.asarray(calls["rnea"](model, q, v, a))
        tau = tau * np.sqrt((usual**2).mean(axis=0))
    return {"forward_dynamics": [q, v, tau], "inverse_dynamics": [q, v, a], "mass_matrix": [q]}[task]


def ways(model: Model, task: str, batch: int) -> list[Way]:
    """All there are for so many samples a call."""
    found, given = [], ", ".join(INPUTS[task])
    for name in TASKS[task]:
        call = calls[name]

        def public(*x: Any, call: Any = call) -> Any:
            return call(model, *x)

        def piecewise(*x: Any, call: Any = call) -> Any:
            """The same for so few samples at a time that no program is made."""
            arrays = [as_array(name, y) for name, y in zip(INPUTS[task], x, strict=True)]
            shape = broadcast(list(INPUTS[task]), [y.shape[:-1] for y in arrays])
            count, step = math.prod(shape), batch_kernels.FROM - 1
            if count <= step:
                return call(model, *arrays)
            flat = [np.broadcast_to(y, (*shape, *y.shape[-1:])).reshape(count, -1) for y in arrays]
            parts = [call(model, *(y[k : k + step] for y in flat)) for k in range(0, count, step)]
            whole = np.concatenate(parts)
            return whole.reshape(shape + whole.shape[1:])

        code = f"sd.{name}(model, {given})"
        if _traces(model, name):
            for dtype in (np.float32, np.float64):
                k = specialize(model, call, dtype=dtype)
                if k.engine != "lanes":
                    continue
                words = ", dtype=np.float32" if dtype == np.float32 else ""
                whole = dtype == np.float64 and batch >= batch_kernels.FROM
                text = code if whole else f"sd.specialize(model, sd.{name}{words})({given})"
                found.append(Way(f"lanes {np.dtype(dtype)} {name}", text, dtype, public if whole else k))
        traces = _traces(model, name)  # and a large batch has a program made
        text = (
            f"{code}  # at most {batch_kernels.FROM - 1} samples at once"
            if traces and batch >= batch_kernels.FROM
            else code
        )
        found.append(Way(f"untraced float64 {name}", text, np.float64, piecewise if traces else public))
    return found


def _traces(model: Model, name: str) -> bool:
    return not numba_kernels.PLAIN and SPECS[name].traces


def measured(model: Model, task: str, states: Any, batch: int) -> tuple[list[Option], int, float]:
    """Options of a task, how many states they were measured in, and the error of the truth."""
    arrays = states_of(model, task, states)
    first = TASKS[task][0]
    calls[first](model, *arrays)  # names what is wrong with the states, or with the model
    truth, certainty = truths(model, first, arrays)
    repeated = [np.ascontiguousarray(np.resize(x, (batch, x.shape[1]))) for x in arrays]
    if batch == 1:
        repeated = [np.array(x[0]) for x in repeated]
    found: list[tuple[Way, Array, str]] = []
    for way in ways(model, task, batch):
        try:
            errors = of_calls(first, np.asarray(way.run(*arrays)), truth)
            note = ""
        except (InertiaError, NonFiniteError) as error:
            errors, note = np.full(1, math.inf), str(error)
        found.append((way, errors, note))
    timed = {
        way.name: partial(way.run, *(x.astype(way.dtype) for x in repeated))
        for way, errors, _ in found
        if np.isfinite(errors).all()
    }
    ns = costs(timed, batch)
    options = [
        Option(
            way.name, way.code, float(errors.max()), float(np.median(errors)), bound(errors),
            ns.get(way.name, math.inf), note=note, run=way.run,
        )
        for way, errors, note in found
    ]  # fmt: skip
    return options, len(arrays[0]), certainty


def further(model: Model, task: str) -> Further:
    """What says of ways in how many more states they stay within a tolerance: their errors, if in all of MANY.

    Ways that fail are left out. None where the truth of MANY states takes longer than PATIENCE.
    """
    first = TASKS[task][0]

    def judged(options: Sequence[Option], tolerance: float) -> dict[str, Array] | None:
        began, errors = time.thread_time(), {x.name: np.empty(0) for x in options}
        for k in range(MANY // CHUNK):
            arrays = random_states(model, task, CHUNK, [0, k + 1])
            truth, _ = truths(model, first, arrays, 0)
            for x in options:
                if x.name not in errors or x.run is None:
                    continue
                try:
                    found = of_calls(first, np.asarray(x.run(*arrays)), truth)
                except (InertiaError, NonFiniteError):
                    found = np.full(1, math.inf)
                errors[x.name] = np.append(errors[x.name], found)
                if MANY_LEAST * found.max() > tolerance:
                    del errors[x.name]
            if not errors:
                break
            if k + 1 < MANY // CHUNK and time.thread_time() - began > PATIENCE:
                return None
        return errors

    return judged


def costs(runs: Mapping[str, Callable[[], Any]], batch: int) -> dict[str, float]:
    """Nanoseconds of a sample, the fastest of rounds in which all take turns."""
    repeats, spent, best = {}, dict.fromkeys(runs, 0.0), dict.fromkeys(runs, math.inf)
    for name, run in runs.items():
        run()  # compiled by now
        repeats[name] = max(1, int(SECONDS / max(_seconds(run, 1), 1e-9)))
    for k in range(2 if numba_kernels.PLAIN else ROUNDS):
        for name, run in runs.items():
            if k < 3 or spent[name] < SPENT:
                once = _seconds(run, repeats[name])
                spent[name] += once * repeats[name]
                best[name] = min(best[name], once)
    return {name: 1e9 * x / batch for name, x in best.items()}


def _seconds(run: Callable[[], Any], repeats: int) -> float:
    start = time.perf_counter()
    for _ in range(repeats):
        run()
    return (time.perf_counter() - start) / repeats
