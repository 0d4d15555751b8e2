"""Batches through traced programs: recorded, compiled and kept by what they depend on, run over threads.

``kernel`` gives the program of some calls for one table of bodies, from memory, from disk or by compiling it.
Calling it computes every sample that is in order and returns the others' numbers, to be done again by the
untraced kernel, which knows the long sine, NaN and errors.
"""

from __future__ import annotations

import ctypes
import hashlib
import itertools
import math
import os
import struct
import sys
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...bodies.table import FLOATING, PLANAR, PLANAR_CS, PRISMATIC, REVOLUTE_CS, SPHERICAL
from ...errors import SpatialDynError
from ...recursions.spec import Spec
from ..compiled import disk_cache
from ..compiled.checks import EPS
from ..compiled.numba_kernels import STAMP
from . import float32_range, host_cpu, simd
from .llvm_entry import DATA, room
from .move_origins import move_origins
from .parameters import Parameter, put, withdraw
from .parameters import shape as parameter_shape
from .regroup import regroup
from .to_double_double import doubled
from .tracer import Number, Program, Tape, evaluate, table

FROM = 512  # samples from which a batch is worth a program
MOST_ROWS = 128  # above, programs grow too long: rnea, aba, crba of 101 rows compile in 0.7, 1.3 and 2.0 s
KEPT = 128  # programs in memory
SHARE = 16 << 20  # bytes of machine code to run through before another thread is worth waking: some 100 µs
REACH = 1 << 30  # bytes of machine code to run through before Ctrl-C is looked at: some 50 ms, in each thread
SLICE = 0.05  # seconds between two looks at Ctrl-C where samples are no program's
FIRST = 1 << 18  # rows times rows, or results, of the samples before the first look: 2 to 30 ms
MOST_RESULTS = MOST_ROWS**2  # or terms, of a sample: Christoffel symbols of 18 rows compile in 1 s, of 50 rows in 54 s
STREAM = 16 << 20  # bytes of output from which it goes past the caches: half the time of crba of talos

POSITION = "rad | m"  # unit of what a robot's speed does not come from

NONE = np.empty(0, np.intp)

_lock = threading.RLock()
_kept: OrderedDict[str, Kernel | None] = OrderedDict()


class _Team:
    """How many threads share a batch, and the threads."""

    size = 1

    def __init__(self) -> None:
        self._pools: dict[int, ThreadPoolExecutor] = {}

    def forget(self) -> None:
        self._pools.clear()

    def pool(self, threads: int) -> ThreadPoolExecutor:
        with _lock:
            if threads not in self._pools:
                self._pools[threads] = ThreadPoolExecutor(threads, thread_name_prefix="spatialdyn")
            return self._pools[threads]

    def run(self, parts: Sequence[Callable[[], Any]]) -> list[Any]:
        """The results of parts, the first in this thread; all have ended when it returns, or raises."""
        jobs = [self.pool(len(parts)).submit(part) for part in parts[1:]]
        try:
            return [parts[0](), *(job.result() for job in jobs)]
        finally:
            wait(jobs)

    def share(self, first: int, end: int, least: int, part: Callable[[int, int], int]) -> int:
        """The sum of ``part(first, end)`` over samples cut among the threads, with at least so many for each."""
        n = end - first
        threads = max(1, min(self.size, n // least))
        if threads == 1:
            return part(first, end)
        cuts = [first + n * k // threads for k in range(threads + 1)]
        return sum(self.run([partial(part, *cut) for cut in pairwise(cuts)]))


def slices(n: int, rows: int, results: int) -> Iterator[tuple[int, int]]:
    """(first, end) of n samples in turn, so many at a time that the caller takes some SLICE seconds for them: between
    them Ctrl-C is heard.

    rows, results  of the table, and numbers of a sample, which say how many may be dared at first
    """
    end, count = 0, max(1, FIRST // (rows * max(rows, results)))
    while end < n:
        began, done = time.perf_counter(), end
        end = min(n, done + count)
        yield done, end
        spent = max(time.perf_counter() - began, 1e-6)
        count = max(1, int(min(10.0 * count, count * SLICE / spent)))


team = _Team()
if hasattr(os, "register_at_fork"):  # threads do not live on in a forked child
    os.register_at_fork(after_in_child=team.forget)


def set_num_threads(n: int) -> None:
    """Over how many threads batches run from now on; 1 unless set. Results do not depend on it.

    Raises SpatialDynError for what is no whole number of 1 or more.
    """
    if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 1:
        raise SpatialDynError(f"n is {n!r}, expected a whole number of threads, 1 at least")
    team.size = int(n)


class Recorded(NamedTuple):
    """A program, what its kernel reads, writes and checks."""

    program: Program
    layout: simd.Layout


class Choice(NamedTuple):
    """What of some calls is wanted, of what the rest is a constant: hashable, and text by ``repr``.

    fixed       (input, its entries, flat: NaN where they stay inputs) for each input that has constant ones
    parameters  of the table, which become inputs, after the others
    outputs     for each call the places of the wanted entries of its output, flat; empty for all of all
    ranged      samples in which what float32 cannot hold may count are left to the caller
    doubled     in double-double, on the table as it is: its numbers are exact
    """

    fixed: tuple[tuple[str, tuple[float, ...]], ...] = ()
    parameters: tuple[Parameter, ...] = ()
    outputs: tuple[tuple[int, ...], ...] = ()
    ranged: bool = False
    doubled: bool = False


ALL = Choice()


def record(
    specs: Sequence[Spec],
    bodies: NDArray[Any],
    static: Sequence[Any] = (),
    choice: Choice = ALL,
    dtype: Any = np.float64,
) -> Recorded:
    """Some calls on one table of bodies as one program; an input of one name is one input.

    static  values of the static inputs of the calls, in their order
    choice  what is constant, what else an input, and what is wanted
    dtype   in which the program will run, and pivots be judged
    """
    for spec in specs:
        if not spec.traces:
            raise SpatialDynError(f"{spec.name} branches on values, expected a call that can be a program")
    fixed, known = iter(static), dict(choice.fixed)
    tape = Tape()
    rows = table(bodies, tape.unfolded) if choice.doubled else table(bodies)
    vars(rows[0])["kind"] = 0  # what is off its unit norm is left to the caller, whatever the table says of it
    taken = withdraw(rows, choice.parameters)
    if all(spec.regroup for spec in specs) and not choice.doubled:
        in_body = choice.parameters or any(x.name == "fext" for spec in specs for x in spec.given)
        if not in_body and dtype == np.float64:  # float32 would feel the way
            move_origins(rows)
        regroup(rows, any(spec.pivots for spec in specs))
    n, sizes = len(bodies) - 1, _sizes(bodies)

    def shape(symbols: Sequence[str | int]) -> tuple[int, ...]:
        return _shape(symbols, sizes)

    given: dict[str, Any] = {}
    widths, kinds, units, count, moves = [], [], [], 0, False
    for spec in specs:
        for x in spec.given:
            if x.name in given:
                continue
            if x.static:
                given[x.name] = next(fixed)
                continue
            entries = known.get(x.name, (math.nan,) * int(np.prod(shape(x.shape), dtype=int)))
            order = itertools.count(count)
            places_of = [next(order) if math.isnan(e) else None for e in entries]  # None: a constant
            numbers = np.empty(len(entries), dtype=object)
            numbers[:] = [e if at is None else tape.input(at) for e, at in zip(entries, places_of, strict=True)]
            given[x.name] = numbers.reshape(shape(x.shape)) if x.shape else numbers[0]
            if x.unit_norm:
                parts = [tuple(places_of[k] for k in part) for part in unit_parts(bodies)]
                units += [tuple(k for k in part if k is not None) for part in parts if None not in part]
            width = next(order) - count
            if width or not entries:
                widths.append(width)
                kinds.append(x.unit)
            count += width
            moves |= x.unit != POSITION and any(at is None and e for e, at in zip(entries, places_of, strict=True))
    loads = []
    for p in choice.parameters:
        widths.append(math.prod(parameter_shape(p, n)))
        loads.append([tape.input(count + k) for k in range(widths[-1])])
        count += widths[-1]
    put(rows, choice.parameters, loads, taken)
    results: list[Any] = []
    places, pivots, norms = [], [], []
    for k, spec in enumerate(specs):
        inner = np.zeros(n, dtype=object)
        out = evaluate(spec, rows, shape(spec.output.shape), given, inner)
        wanted = out.ravel()[list(choice.outputs[k])] if choice.outputs else out.ravel()
        places.append(tuple(range(len(results), len(results) + len(wanted))))
        if spec.output.unit_norm:
            chosen = choice.outputs[k] if choice.outputs else range(out.size)
            at_of = {entry: len(results) + at for at, entry in enumerate(chosen)}
            norms += [tuple(at_of[e] for e in part) for part in unit_parts(bodies) if set(part) <= set(at_of)]
        results += wanted.tolist()
        if spec.pivots:
            margins = pivot_margins(rows, given["q"], inner, EPS if dtype == np.float64 else float(np.finfo(dtype).eps))
            pivots += [(len(results) + at, least) for at, (_, least) in enumerate(margins)]
            results += [margin for margin, _ in margins]
    program, sizes_of = Program(tape, results, count, fuse=not choice.doubled), None
    if choice.doubled:
        program = doubled(program, host_cpu.host()[3])
    if choice.ranged:
        driving = None if moves else [k for k, x in enumerate(kinds) if x != POSITION]
        sizes_of, least = float32_range.ranges(bodies, driving)
        pivots = [(place, max(bound, least)) for place, bound in pivots]
    layout = simd.Layout(
        tuple(widths), tuple(places), tuple(dict.fromkeys(units)), tuple(pivots), tuple(norms), sizes_of
    )
    return Recorded(program, layout)


def _sizes(bodies: NDArray[Any]) -> dict[str, int]:
    """What the words in an argument's shape stand for."""
    return {"nq": int(bodies[0]["at"]), "nv": len(bodies) - 1, "njoints": int(bodies[0]["dofs"])}


def _shape(symbols: Sequence[str | int], sizes: dict[str, int]) -> tuple[int, ...]:
    return tuple(sizes[s] if isinstance(s, str) else s for s in symbols)


def unit_parts(bodies: NDArray[Any]) -> list[tuple[int, ...]]:
    """The coordinates of q that form a quaternion or a (cos, sin) pair."""
    parts = {REVOLUTE_CS: (0, 2), SPHERICAL: (0, 4), FLOATING: (3, 7), PLANAR_CS: (2, 4)}
    found = []
    for row in bodies[1:]:
        if int(row["kind"]) in parts:
            first, end = parts[int(row["kind"])]
            found.append(tuple(int(row["at"]) + k for k in range(first, end)))
    return found


def pivot_margins(rows: Sequence[Any], q: Any, pivots: Any, eps: float = EPS) -> list[tuple[Any, float]]:
    """For each D what has to exceed which constant, for it to be above n eps of a bound on its composite inertia.

    With t the sum of m distances |q| that joints below the root have travelled, 2 b t <= a + c t², for b² <= a c of
    the moments of any body, and t² <= m Σ q²: a polynomial, which a program can hold, and the same in all units.
    ``rows`` are plain; what of them is a Number is part of it.
    """
    n = len(rows) - 1
    moved: list[int] = []
    for row in rows[1:]:
        if row.kind == PRISMATIC:
            moved.append(row.at)
        elif row.parent > 0 and row.kind in (PLANAR, PLANAR_CS, FLOATING):
            moved += [row.at + k for k in range(3 if row.kind == FLOATING else 2)]
    squares: Any = 0.0
    for k in moved:
        squares = squares + q[k] * q[k]
    margins = []
    for row, D in zip(rows[1:], pivots, strict=True):
        least, small = 0.0, n * eps
        growth = (small * 2 * len(moved)) * row.bound.z * squares
        for part in (small * (row.armature + row.bound.x), small * row.bound.x if moved else 0.0, growth):
            if isinstance(part, Number):
                D = D - part
            else:
                least += part
        margins.append((D, least))
    return margins


class Kernel:
    """A compiled program over batches."""

    def __init__(self, code: bytes, workspace: int, layout: simd.Layout, dtype: Any, one: bool = False) -> None:
        """Load object code made by ``simd.compiled`` from a program of that layout."""
        self._loaded = host_cpu.Loaded(code)
        self.dtype, self.lanes = np.dtype(dtype), 1 if one else host_cpu.lanes_of(dtype)
        self.address, self.workspace = self._loaded.address("kernel"), workspace
        self.inputs, self.outputs = layout.inputs, tuple(map(len, layout.outputs))
        self._room = room(self.inputs, self.outputs, workspace, self.lanes, self.dtype.itemsize)
        self._share, self._length = max(1, SHARE // len(code)), len(code)
        kinds: list[Any] = [ctypes.py_object, ctypes.c_int64] * len(self.inputs)
        kinds += [ctypes.py_object] * (len(self.outputs) + 1)
        kind = ctypes.CFUNCTYPE(ctypes.c_int64, *kinds, ctypes.c_int64)
        self._run: Callable[..., int] = kind(self._loaded.address("entry"))

    def __call__(self, inputs: Sequence[NDArray[Any]], outputs: Sequence[NDArray[Any]]) -> NDArray[np.intp] | None:
        """Compute a batch; returns the numbers of the samples that the caller has to do again.

        inputs   (n, columns) in C order, or (1, columns) for one that serves all samples
        outputs  (n, columns) in C order

        None, with nothing done, if arrays are not of these sizes, order and dtype, or outputs overlap anything. At
        Ctrl-C, which is heard between slices, outputs hold what was done, and NaN for the other samples.
        """
        n, arguments = len(outputs[0]), []
        for x, columns in zip(inputs, self.inputs, strict=True):
            rows = len(x)
            if x.shape != (rows, columns) or not (rows == n or rows == 1) or not self._fit(x):
                return None
            arguments += [x, rows]
        for y, columns in zip(outputs, self.outputs, strict=True):
            if y.shape != (n, columns) or not self._fit(y) or not y.flags.writeable:
                return None
        tiles = -(-n // self.lanes)
        threads = self.threads(tiles)
        reach = self.reach * threads
        if threads <= 1 and tiles <= reach:
            return self._part(n, [*arguments, *outputs])
        if any(np.may_share_memory(y, x) for k, y in enumerate(outputs) for x in (*inputs, *outputs[:k])):
            return None  # which a part would not see of the others
        found: list[NDArray[np.intp]] = []
        for tile in range(0, tiles, reach):
            more = min(reach, tiles - tile)
            cuts = [min((tile + more * k // threads) * self.lanes, n) for k in range(threads + 1)]
            parts = [(b - a, [*self._cut(inputs, a, b, n), *(y[a:b] for y in outputs)]) for a, b in pairwise(cuts)]
            try:
                made = team.run([partial(self._part, *part) for part in parts])
            except KeyboardInterrupt:  # what is left to be done again, or at all, is NaN
                for y in outputs:
                    y[np.concatenate([*found, np.arange(cuts[0], n)])] = np.nan
                raise
            found += [samples + first for first, samples in zip(cuts, made, strict=False)]
        return np.concatenate(found)

    @property
    def reach(self) -> int:
        """How many tiles, or steps of one, a thread runs before Ctrl-C is looked at."""
        return max(1, REACH // self._length)

    def threads(self, tiles: int) -> int:
        """How many threads are worth waking for so many tiles, of those there may be."""
        return 1 if team.size == 1 else max(1, min(team.size, tiles // self._share))

    def _fit(self, x: NDArray[Any]) -> bool:
        return (x.dtype is self.dtype or x.dtype == self.dtype) and x.flags.c_contiguous

    def _cut(self, inputs: Sequence[NDArray[Any]], first: int, end: int, n: int) -> list[Any]:
        arguments: list[Any] = []
        for x in inputs:
            part = x[first:end] if len(x) == n else x
            arguments += [part, len(part)]
        return arguments

    def _part(self, n: int, arguments: list[Any]) -> NDArray[np.intp] | None:
        """Some samples, in this thread; the GIL is free meanwhile."""
        tiles = -(-n // self.lanes)
        buffer = np.empty(2 * tiles + self._room, np.uint8)
        if not self._run(*arguments, buffer, n):
            return None
        bits = buffer[: 2 * tiles].view(np.uint16)
        whole = (1 << self.lanes) - 1
        if bits.tobytes() == whole.to_bytes(2, sys.byteorder) * tiles:
            return NONE
        lane = np.arange(self.lanes)
        odd = np.flatnonzero(bits != whole)
        again = (odd[:, None] * self.lanes + lane)[(bits[odd, None] >> lane & 1) == 0]
        return np.asarray(again[again < n])


def fits(specs: Sequence[Spec], bodies: NDArray[Any], results: int | None = None) -> bool:
    """Whether calls on a table can be a program: none branches on values, and it would not be too long.

    results  numbers wanted of one sample, if not all
    """
    if results is None:
        sizes = _sizes(bodies)
        shapes = [(spec.output.shape, spec.terms) for spec in specs]
        results = sum(max(math.prod(_shape(shape, sizes)) for shape in (out, terms)) for out, terms in shapes)
    short = 1 < len(bodies) <= MOST_ROWS + 1 and results <= MOST_RESULTS
    return short and all(spec.traces for spec in specs)


def kernel(
    specs: tuple[Spec, ...],
    bodies: NDArray[Any],
    key: str,
    static: Sequence[Any] = (),
    dtype: Any = np.float64,
    choice: Choice = ALL,
    one: bool = False,
    stream: bool = False,
) -> Kernel | None:
    """The kernel of some calls for the table whose content has that key; None if a joint moves no inertia.

    one     for single samples: on one lane
    stream  for outputs larger than the caches, which start on a vector's boundary
    """
    names = "|".join(f"{s.name}({','.join(x.name for x in s.given)})" for s in specs)
    processor, features, _, _ = host_cpu.host()
    values = "|".join(x.tobytes().hex() if isinstance(x, np.ndarray) else str(x) for x in static)
    chosen = "" if choice == ALL else repr(choice)
    dtype_name = np.dtype(dtype).name + (" one" if one else "") + (" stream" if stream else "")
    text = "\n".join((key, names, values, chosen, dtype_name, STAMP, processor, features, host_cpu.VERSION, str(DATA)))
    digest = hashlib.sha256(text.encode()).hexdigest()
    with _lock:
        if digest in _kept:
            _kept.move_to_end(digest)
            return _kept[digest]
        made = _from_disk(digest, dtype, one) or _made(specs, bodies, static, digest, dtype, choice, one, stream)
        _kept[digest] = made
        while len(_kept) > KEPT:
            _kept.popitem(last=False)
        return made


def _made(
    specs: tuple[Spec, ...],
    bodies: NDArray[Any],
    static: Sequence[Any],
    digest: str,
    dtype: Any,
    choice: Choice = ALL,
    one: bool = False,
    stream: bool = False,
) -> Kernel | None:
    try:
        program, layout = record(specs, bodies, static, choice, dtype)
    except ZeroDivisionError:  # a joint that moves no inertia in any state
        return None
    code, workspace = simd.compiled(program, layout, dtype, stream, one)
    made = Kernel(code, workspace, layout, dtype, one)
    disk_cache.write(digest, _packed(code, workspace, layout))
    return made


def _packed(code: bytes, workspace: int, layout: simd.Layout) -> bytes:
    """Layout and code; a kernel that is loaded needs of its layout the widths alone."""
    widths = [len(layout.inputs), *layout.inputs, len(layout.outputs), *(len(o) for o in layout.outputs), workspace]
    return struct.pack(f"<q{len(widths)}q", len(widths), *widths) + code


def _from_disk(digest: str, dtype: Any, one: bool) -> Kernel | None:
    payload = disk_cache.read(digest)
    if payload is None:
        return None
    (count,) = struct.unpack_from("<q", payload)
    numbers = list(struct.unpack_from(f"<{count}q", payload, 8))
    inputs = tuple(numbers[1 : 1 + numbers[0]])
    outputs = tuple(tuple(range(k)) for k in numbers[2 + numbers[0] : -1])
    return Kernel(payload[8 + 8 * count :], numbers[-1], simd.Layout(inputs, outputs), dtype, one)
