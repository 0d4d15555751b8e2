"""A call that computes each sample within a tolerance, in the cheapest precision whose error bound allows it."""

from __future__ import annotations

import math
import threading
import typing
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.kinds import unit_parts
from ..engines import locks
from ..engines.numbers.enclosures import Enclosure, Zeros, rounded
from ..errors import ShapeError, SpatialDynError, literal
from .arguments import aligned, as_array, as_number
from .random_configurations import random_configuration
from .specialize_request import SpecializeRequest
from .specialized import Specialized

Array = NDArray[np.float64]
Call = Callable[..., tuple[Any, Any]]

SINGLE, DOUBLE, PAIRS = "float32", "float64", "double-double"
HALF_ULP = 2.0**-24  # float32 meets no tolerance below it
LEAST_SOLVED = 6  # freedoms from which calls that solve try float32 first: see Promise
STATES, SEED, SHARE = 64, 7, 0.75  # and only if float32 is enough in this share of the states: a failed try costs time
WIDEST = 1e9  # larger inputs are beyond float32's safe range
UNKNOWN = 3  # no precision has answered the sample yet
LISTED = 8  # the most samples named in an error


def checked_tolerance(tolerance: Any) -> tuple[float, float]:
    """(relative, absolute). Raises SpatialDynError."""
    pair = tolerance if isinstance(tolerance, (tuple, list)) else (tolerance, 0.0)
    try:
        relative, absolute = map(as_number, pair)
    except (ValueError, TypeError):
        relative = absolute = math.nan
    if not (0.0 <= relative < 1.0 and 0.0 <= absolute < math.inf and relative + absolute > 0.0):
        raise SpatialDynError(
            f"tolerance is {literal(tolerance)}, expected a number above 0 and below 1, or (relative, absolute)"
        )
    return relative, absolute


class Promise:
    """A call whose results are all within a tolerance of the exact ones, made by ``specialize(tolerance=)``.

    Called like a function, ``k(q, v, a)``, for one sample or batches, ``out=`` optional; results are float64. Each
    sample is computed in the first of these precisions whose bound (see ``bounded``) is within the tolerance; the
    choice depends on the sample and the model alone:

        "float32"        with dtype=np.float32, unless most random states have infinite bounds in it, as for thin rods
                         that turn about their own axes. Without dtype=np.float32 only where it is cheaper: for calls
                         that solve (aba, minverse), from 6 freedoms on, if it is enough for three quarters of 64 random
                         states, as for tolerances of about 1e-3
        "float64"
        "double-double"  for calls without ``fixed``, ``outputs``, parameters and tables, and models without quaternions
                         and (cos, sin) pairs; far slower, and compiled at its first sample

    ways       the precisions in that order; the last is used only if needed
    report     {precision: number of samples it has answered so far}
    tolerance  (relative, absolute): the largest error of a sample's entries is at most relative times its largest
               entry, plus absolute
    signature  inputs and result, with their shapes

    A Promise gives certainty, it does not save time. On one core, for a ur5 and seven joints of a panda, a batch of
    ``bounded`` takes 2 to 3 times as long as a batch without bounds in rnea and crba, 5 times in aba. A Promise, which
    checks each sample in NumPy, takes some 6 to 14 times as long (on a busy machine). Starting at float32 takes 0.8 to
    1.1 times as long as starting at float64; if float32 is never enough, both are computed.
    ``benchmarks/tradeoff.py --only samples`` measures this.

    Raises
        SpatialDynError naming samples where no precision's bound is within the tolerance: near a singular
            configuration, or near a result of 0 without an absolute tolerance. A result that is exactly 0 (C at rest)
            has no error and is returned
        the errors of a Specialized. NaN or infinity in a sample gives NaN there, as in the call, and ``report`` does
            not count that sample
    """

    def __init__(
        self,
        request: SpecializeRequest,
        tolerance: Any,
        bounded: Callable[[Any], Specialized],
        maker: Callable[..., Any],
        arguments: tuple[Any, ...],
    ) -> None:
        """``bounded(dtype)`` makes the call with bounds; ``maker(*arguments)`` makes all of it again."""
        if not isinstance(request, SpecializeRequest) or not callable(bounded):
            kinds = f"a {type(request).__name__} and a {type(bounded).__name__}"
            raise SpatialDynError(f"request and bounded are {kinds}, expected specialize(model, call, tolerance=)")
        self.tolerance = checked_tolerance(tolerance)
        self._request, self._made_by = request, (maker, arguments)
        (self._spec,) = request.specs
        self._cores = [x.shape for x in request.inputs()]
        self._core = request.results()[0].shape
        ladder: dict[str, Call] = {DOUBLE: bounded(np.float64)}
        asked = request.dtype == np.float32
        cheaper = bool(self._spec.residual) and request.model.nv >= LEAST_SOLVED
        if asked or (cheaper and sum(self.tolerance) >= HALF_ULP):
            narrow = bounded(np.float32)
            narrow._watches_bounds = False  # no warning: the next precision computes these samples
            known, held = self._shares(narrow)
            if known > 0.5 if asked else held >= SHARE:
                ladder = {SINGLE: narrow, **ladder}
        self._ladder = ladder
        self._counts = dict.fromkeys(self.ways, 0)
        self._lock = locks.new(threading.Lock)

    @property
    def ways(self) -> tuple[str, ...]:
        """The precisions, in the order in which they are tried."""
        return (*self._ladder, *([PAIRS] * self._has_pairs))

    @property
    def report(self) -> dict[str, int]:
        """Number of samples computed in each precision so far; samples with NaN or infinity are not counted."""
        with self._lock:
            return dict(self._counts)

    @property
    def signature(self) -> str:
        """Inputs and result with the shapes of one sample."""
        given = ", ".join(f"{x.name} {x.shape_text}" for x in self._request.inputs())
        result = self._request.results()[0]
        return f"({given}) -> {result.name} {result.shape_text}"

    def __repr__(self) -> str:
        relative, absolute = self.tolerance
        within = f"{relative:g}" + (f" and {absolute:g}" if absolute else "")
        ways = ", ".join(f"{way} {count}" for way, count in self.report.items())
        return f'<Promise {self._spec.name} of "{self._request.model.name}" within {within}: {ways}>'

    if not typing.TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_") or not hasattr(Specialized, name):
                raise AttributeError(f"{literal(type(self).__name__)} object has no attribute {literal(name)}")
            call = self._spec.name
            bounds = f", or with its error sd.bounded(model, sd.{call}).{name}"
            raise AttributeError(
                f"a Promise has no {name}: each sample chooses its program; expected that of one program, "
                f"sd.specialize(model, sd.{call}).{name}{bounds * (name not in ('to_jax', 'to_torch'))}"
            )

    def __reduce__(self) -> tuple[Any, ...]:
        return self._made_by

    def __call__(self, *arrays: ArrayLike, out: Any = None) -> Any:
        """The call, of one sample or a batch."""
        names = [x.name for x in self._request.inputs()]
        given = [as_array(name, x) for name, x in zip(names, arrays, strict=False)]
        shapes = aligned(names, self._cores, [np.shape(x) for x in arrays])
        batch = np.broadcast_shapes(*(x[: len(x) - len(core)] for x, core in zip(shapes, self._cores, strict=True)))
        rows = [
            np.broadcast_to(x.reshape(shape), (*batch, *core)).reshape(-1, *core)
            for x, shape, core in zip(given, shapes, self._cores, strict=True)
        ]
        values, way = self._answers(rows, given, batch)
        with self._lock:
            for code, name in enumerate((SINGLE, DOUBLE, PAIRS)):
                if name in self._counts:
                    self._counts[name] += int((way == code).sum())
        made = values.reshape((*batch, *self._core))
        if out is None:
            return made if made.ndim else float(made)
        if not isinstance(out, np.ndarray) or out.dtype != np.float64 or out.shape != made.shape:
            what = f"shape {out.shape}, {out.dtype}" if isinstance(out, np.ndarray) else type(out).__name__
            raise ShapeError(f"out is {what}, expected an array of shape {made.shape}, float64")
        out[...] = made
        return out

    def _answers(self, rows: list[Array], given: list[Array], batch: tuple[int, ...]) -> tuple[Array, NDArray[np.intp]]:
        """(values, index of the precision that computed each sample, -1 for NaN). Raises SpatialDynError."""
        n = math.prod(batch)
        values = bounds = np.empty(0)
        way, at = np.full(n, UNKNOWN), np.arange(n)
        for code, name in enumerate((SINGLE, DOUBLE)):
            if name not in self._ladder:
                continue
            tried = at if name == DOUBLE else at[self._narrow(rows)]
            if not len(tried):
                continue
            try:
                found = self._ladder[name](*(x if len(tried) == n else x[tried] for x in rows))
            except SpatialDynError:
                self._ladder[DOUBLE](*given)  # names the sample by its place among all
                raise
            if len(tried) == n:  # no copy: it would take longer than a crba with its bound
                values, bounds = (np.asarray(x, np.float64).reshape(n, *self._core) for x in found)
            else:
                if not len(values):
                    values, bounds = np.empty((2, n, *self._core))
                values[tried], bounds[tried] = found
            way[tried[self._holds(*found)]] = code
            at = np.flatnonzero(way == UNKNOWN)
        if len(at):
            sound = [np.isfinite(x[at].reshape(len(at), -1)).all(axis=1) for x in rows]
            way[at[~np.logical_and.reduce(sound)]] = -1
            at = np.flatnonzero(way == UNKNOWN)
        if len(at):
            still = at[self._are_zeros([x[at] for x in rows], values[at], bounds[at])]
            way[still] = 1
            at = np.flatnonzero(way == UNKNOWN)
        if len(at) and self._has_pairs:
            values[at], bounds[at] = self._by_pairs([x[at] for x in rows])
            held = self._holds(values[at], bounds[at])
            way[at[held]], at = 2, at[~held]
        if len(at):
            raise SpatialDynError(self._failure(at, values, bounds, batch, rows))
        return values, way

    # -- ways

    @cached_property
    def _has_pairs(self) -> bool:
        request = self._request
        plain = not (request.constants or request.parameters or request.output_places is not None)
        plain &= all(x.table is None for x in self._spec.present)
        return plain and not unit_parts(request.model.bodies)

    @cached_property
    def _enclosure(self) -> Enclosure:
        return Enclosure(self._spec, self._request.model.bodies, self._request.static)

    def _by_pairs(self, rows: Sequence[Array]) -> tuple[Array, Array]:
        """Values and bounds by double-double."""
        high, low, error = self._enclosure([x.reshape(len(x), -1) for x in rows])
        shape = (len(high), *self._core)
        return high.reshape(shape), rounded(low, error).reshape(shape)

    @cached_property
    def _zeros(self) -> Zeros:
        return Zeros(self._spec, self._request.model.bodies, self._request.static)

    def _are_zeros(self, rows: Sequence[Array], values: Array, bounds: Array) -> NDArray[np.bool_]:
        """Which samples are exactly 0 in all entries: no bound is within a relative tolerance of 0."""
        found: NDArray[np.bool_] = (_largest(values, self._core) == 0.0) & np.isfinite(_largest(bounds, self._core))
        request, count = self._request, len(values)
        if request.parameters or any(x.table is not None for x in self._spec.present) or not found.any():
            return np.zeros(count, bool)
        given, whole = dict(zip((x.name for x in request.inputs()), rows, strict=True)), []
        for x in request.arguments:
            entries = given[x.name].reshape(count, -1) if x.name in given else np.empty((count, 0))
            if x.name in request.constants:
                known = np.tile(request.constants[x.name], (count, 1))
                known[np.isnan(known)] = entries.ravel()
                entries = known
            whole.append(entries)
        places = slice(None) if request.output_places is None else request.output_places[0].ravel()
        found &= self._zeros(whole)[:, places].all(axis=1)
        return found

    def _narrow(self, rows: Sequence[Array]) -> Any:
        """Which samples are in float32's safe range, as an index."""
        if all(not x.size or abs(x).max() <= WIDEST for x in rows):
            return slice(None)
        found = [_largest(x, core) <= WIDEST for x, core in zip(rows, self._cores, strict=True)]
        return np.logical_and.reduce(found)

    # -- judgements

    def _holds(self, values: Array, bounds: Array) -> NDArray[np.bool_]:
        """Whether each sample's bound is within the tolerance of its exact largest entry, at least |value| - bound."""
        relative, absolute = self.tolerance
        largest, bound = _largest(values, self._core), _largest(bounds, self._core)
        with np.errstate(invalid="ignore", over="ignore"):
            held: NDArray[np.bool_] = bound * (1.0 + relative) <= (relative * largest + absolute) * (1.0 - 2.0**-50)
        held &= np.isfinite(bound)
        return held

    def _shares(self, narrow: Call) -> tuple[float, float]:
        """The shares of random states with a finite bound in float32, and with a bound within the tolerance."""
        rng, request = np.random.default_rng(SEED), self._request
        inputs = []
        for x, core in zip(request.inputs(), self._cores, strict=True):
            moved = x.name == "q" and core == (request.model.nq,)
            inputs.append(
                random_configuration(request.model, rng, (STATES,)) if moved else rng.standard_normal((STATES, *core))
            )
        try:
            values, bounds = narrow(*inputs)
        except SpatialDynError:
            return 1.0, 0.0
        finite = np.isfinite(bounds.reshape(STATES, -1)).all(axis=1)
        return float(finite.mean()), float(self._holds(values, bounds).mean())

    def _failure(
        self, at: NDArray[np.intp], values: Array, bounds: Array, batch: tuple[int, ...], rows: Sequence[Array]
    ) -> str:
        """The message of the error. ``rows`` are the inputs."""
        n = len(values)
        largest = abs(values.reshape(n, -1)).max(axis=1, initial=0.0)[at]
        worst = bounds.reshape(n, -1).max(axis=1, initial=0.0)[at]
        relative, absolute = self.tolerance
        within = f"{relative:g} of the largest entry" + (f" and {absolute:g}" if absolute else "")
        places = [tuple(map(int, np.unravel_index(k, batch))) for k in at[:LISTED]] if batch else []
        named = [str(x[0] if len(x) == 1 else x) for x in places]
        more = f" and {len(at) - LISTED} others" if len(at) > LISTED else ""
        where = f" in sample{'s' if len(at) > 1 else ''} {', '.join(named)}{more}" if batch else ""
        of = f"bound {worst[0]:.1e} of {largest[0]:.1e}"
        if math.isnan(worst[0]) or math.isnan(largest[0]):
            sizes = [abs(x[at[0]]).max(initial=0.0) for x in rows]
            k = int(np.argmax(sizes))
            of = f"no way has a bound where {self._request.inputs()[k].name} has {sizes[k]:.1e}"
        of += f" in sample {named[0]}" if len(at) > 1 else ""
        cure = ""
        if not absolute and worst[0] >= largest[0]:
            cure = f"; tolerance=({relative:g}, absolute) allows an error beside a result of next to 0"
        return f"{self._spec.name} is not known within {within}{where}: {of}, by {', '.join(self.ways)}{cure}"


def _largest(x: Any, core: tuple[int, ...]) -> Array:
    """The largest magnitude in each sample; column by column, which is faster than a reduction."""
    columns = np.asarray(x, np.float64).reshape(len(x), math.prod(core))
    found = np.zeros(len(columns))
    for k in range(columns.shape[1]):
        np.maximum(found, abs(columns[:, k]), out=found)
    return found
