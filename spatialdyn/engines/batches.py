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
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies import FLOATING, PLANAR, PLANAR_CS, PRISMATIC, REVOLUTE_CS, SPHERICAL
from ..errors import SpatialDynError
from ..recursions.checks import EPS
from ..recursions.spec import Spec
from . import lanes, store
from .jit import STAMP
from .parameters import Parameter, put, withdraw
from .parameters import shape as parameter_shape
from .regroup import regroup
from .trace import Number, Program, Tape, scratch, table

FROM = 512  # samples from which a batch is worth a program
MOST_ROWS = 128  # above, programs grow too long: rnea, aba, crba of 101 rows compile in 0.7, 1.3 and 2.0 s
KEPT = 128  # programs in memory
MOST_RESULTS = MOST_ROWS**2  # of a sample: Christoffel symbols of 18 rows compile in 1 s, of 50 rows in 54 s
STREAM = 16 << 20  # bytes of output from which it goes past the caches: 17 x Pinocchio instead of 9 on talos crba

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


_team = _Team()
if hasattr(os, "register_at_fork"):  # threads do not live on in a forked child
    os.register_at_fork(after_in_child=_team.forget)


def set_num_threads(n: int) -> None:
    """Over how many threads batches run from now on; 1 unless set. Results do not depend on it.

    Raises SpatialDynError for a number below 1.
    """
    if int(n) < 1:
        raise SpatialDynError(f"n is {n}, expected at least 1 thread")
    _team.size = int(n)


class Recorded(NamedTuple):
    """A program, what its kernel reads, writes and checks."""

    program: Program
    layout: lanes.Layout


class Choice(NamedTuple):
    """What of some calls is wanted, of what the rest is a constant: hashable, and text by ``repr``.

    fixed       (input, its entries, flat: NaN where they stay inputs) for each input that has constant ones
    parameters  of the table, which become inputs, after the others
    outputs     for each call the places of the wanted entries of its output, flat; empty for all of all
    """

    fixed: tuple[tuple[str, tuple[float, ...]], ...] = ()
    parameters: tuple[Parameter, ...] = ()
    outputs: tuple[tuple[int, ...], ...] = ()


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
    fixed, known = iter(static), dict(choice.fixed)
    tape, rows = Tape(), table(bodies)
    taken = withdraw(rows, choice.parameters)
    if all(spec.regroup for spec in specs):
        regroup(rows)
    n, sizes = len(bodies) - 1, _sizes(bodies)

    def shape(symbols: Sequence[str | int]) -> tuple[int, ...]:
        return _shape(symbols, sizes)

    given: dict[str, Any] = {}
    widths, units, count = [], [], 0
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
            count += width
    loads = []
    for p in choice.parameters:
        widths.append(math.prod(parameter_shape(p, n)))
        loads.append([tape.input(count + k) for k in range(widths[-1])])
        count += widths[-1]
    put(rows, choice.parameters, loads, taken)
    results: list[Any] = []
    places, pivots = [], []
    for k, spec in enumerate(specs):
        out = np.zeros(shape(spec.output.shape) or (1,), dtype=object)
        inner = [np.zeros(n, dtype=object)] if spec.pivots else []
        work = [] if spec.work is None else [scratch(spec.work, n + 1)]
        inputs = [None if x is None else given[x.name] for x in spec.inputs]
        spec.recursion(rows, *work, *inputs, out, *inner)
        wanted = out.ravel()[list(choice.outputs[k])] if choice.outputs else out.ravel()
        places.append(tuple(range(len(results), len(results) + len(wanted))))
        results += wanted.tolist()
        if spec.pivots:
            margins = pivot_margins(rows, given["q"], inner[0], EPS if dtype == np.float64 else np.finfo(dtype).eps)
            pivots += [(len(results) + at, least) for at, (_, least) in enumerate(margins)]
            results += [margin for margin, _ in margins]
    layout = lanes.Layout(tuple(widths), tuple(places), tuple(dict.fromkeys(units)), tuple(pivots))
    return Recorded(Program(tape, results, count), layout)


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

    With t the sum of m distances |q| that joints below the root have travelled, 2 b t <= b (1 + t²) and
    t² <= m Σ q²: a polynomial, which a program can hold. ``rows`` are plain; what of them is a Number is part of it.
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
        growth = (small * len(moved)) * (row.bound.y + row.bound.z) * squares
        for part in (small * (row.armature + row.bound.x), small * row.bound.y if moved else 0.0, growth):
            if isinstance(part, Number):
                D = D - part
            else:
                least += part
        margins.append((D, least))
    return margins


class Kernel:
    """A compiled program over batches."""

    def __init__(self, code: bytes, workspace: int, layout: lanes.Layout, dtype: Any) -> None:
        """Load object code made by ``lanes.compiled`` from a program of that layout."""
        self._loaded = lanes.Loaded(code)
        self.address = self._loaded.address
        self.layout, self.dtype, self.workspace = layout, np.dtype(dtype), workspace
        self.lanes = lanes.lanes_of(dtype)
        pairs = [ctypes.c_void_p, ctypes.c_int64] * len(layout.inputs)
        pointers = [ctypes.c_void_p] * (len(layout.outputs) + 2)
        kind = ctypes.CFUNCTYPE(None, ctypes.c_int64, *pairs, *pointers)
        self._call: Callable[..., None] = kind(self._loaded.address)

    def __call__(
        self, n: int, inputs: Sequence[tuple[NDArray[Any], int]], outputs: Sequence[NDArray[Any]]
    ) -> NDArray[np.intp]:
        """Compute n samples; returns the numbers of those that the caller has to do again.

        inputs   (rows, step) per input: C-ordered (samples, columns), step 0 where one row serves all
        outputs  C-ordered (n, columns)
        """
        W = self.lanes
        tiles = n // W
        bits = np.empty(tiles + (n % W > 0), np.uint16)
        threads = min(_team.size, max(1, tiles // 64))
        if threads == 1:
            self._range(0, tiles, inputs, outputs, bits)
        else:
            cuts = [tiles * k // threads for k in range(threads + 1)]
            pool = _team.pool(threads)
            jobs = [pool.submit(self._range, a, b, inputs, outputs, bits) for a, b in pairwise(cuts)]
            for job in jobs:
                job.result()
        if n % W:
            self._tail(tiles * W, n, inputs, outputs, bits[tiles:])
        whole = (1 << W) - 1
        odd = np.flatnonzero(bits != whole)
        if not len(odd):
            return odd
        lane = np.arange(W)
        again = (odd[:, None] * W + lane)[(bits[odd, None] >> lane & 1) == 0]
        return np.asarray(again[again < n])

    def _range(
        self,
        first: int,
        end: int,
        inputs: Sequence[tuple[NDArray[Any], int]],
        outputs: Sequence[NDArray[Any]],
        bits: NDArray[np.uint16],
    ) -> None:
        """Tiles first .. end - 1; the GIL is free meanwhile."""
        room = np.empty(self.workspace + 64, np.uint8)
        size, start = self.dtype.itemsize, first * self.lanes
        arguments: list[int] = [end - first]
        for (x, step), columns in zip(inputs, self.layout.inputs, strict=True):
            arguments += [x.ctypes.data + step * start * columns * size, step * columns]
        for out, places in zip(outputs, self.layout.outputs, strict=True):
            arguments.append(out.ctypes.data + start * len(places) * size)
        self._call(*arguments, bits.ctypes.data + 2 * first, room.ctypes.data + -room.ctypes.data % 64)

    def _tail(
        self,
        first: int,
        n: int,
        inputs: Sequence[tuple[NDArray[Any], int]],
        outputs: Sequence[NDArray[Any]],
        bits: NDArray[np.uint16],
    ) -> None:
        """The last samples, fewer than a tile: on copies, filled up with the last of them."""
        at = np.minimum(np.arange(first, first + self.lanes), n - 1)
        padded = [(np.ascontiguousarray(x[at]), 1) if step else (x, 0) for x, step in inputs]
        results = [_on_a_line((self.lanes, len(places)), self.dtype) for places in self.layout.outputs]
        self._range(0, 1, padded, results, bits)
        for out, result in zip(outputs, results, strict=True):
            out.reshape(n, -1)[first:] = result[: n - first]


def _on_a_line(shape: tuple[int, int], dtype: Any) -> NDArray[Any]:
    """An empty array that starts on a cache line, as streamed results have to."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    raw = np.empty(size + 64, np.uint8)
    start = -raw.ctypes.data % 64
    array: NDArray[Any] = raw[start : start + size].view(dtype).reshape(shape)
    return array


def fits(specs: Sequence[Spec], bodies: NDArray[Any], results: int | None = None) -> bool:
    """Whether calls on a table can be a program: it would not be too long, and no output is checked for its norm.

    results  numbers wanted of one sample, if not all
    """
    if results is None:
        sizes = _sizes(bodies)
        results = sum(math.prod(_shape(spec.output.shape, sizes)) for spec in specs)
    short = 1 < len(bodies) <= MOST_ROWS + 1 and results <= MOST_RESULTS
    return short and not any(spec.output.unit_norm for spec in specs)


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
    """The kernel of some calls for the table whose content has that key; None if they have no vector form.

    one     for single samples: on one lane
    stream  for outputs larger than the caches, which start on a vector's boundary
    """
    names = "|".join(f"{s.name}({','.join(x.name for x in s.given)})" for s in specs)
    processor, features, _, _ = lanes.host()
    values = "|".join(x.tobytes().hex() if isinstance(x, np.ndarray) else str(x) for x in static)
    chosen = "" if choice == ALL else repr(choice)
    dtype_name = np.dtype(dtype).name + (" one" if one else "") + (" stream" if stream else "")
    text = "\n".join((key, names, values, chosen, dtype_name, STAMP, processor, features, lanes.VERSION))
    digest = hashlib.sha256(text.encode()).hexdigest()
    with _lock:
        if digest in _kept:
            _kept.move_to_end(digest)
            return _kept[digest]
        made = _from_disk(digest, dtype) or _made(specs, bodies, static, digest, dtype, choice, one, stream)
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
    if not lanes.supported(program):
        return None
    code, workspace = lanes.compiled(program, layout, dtype, stream, one)
    made = Kernel(code, workspace, layout, dtype)
    store.write(digest, _packed(code, workspace, layout))
    return made


def _packed(code: bytes, workspace: int, layout: lanes.Layout) -> bytes:
    """Layout and code; a kernel that is loaded needs of its layout the widths alone."""
    widths = [len(layout.inputs), *layout.inputs, len(layout.outputs), *(len(o) for o in layout.outputs), workspace]
    return struct.pack(f"<q{len(widths)}q", len(widths), *widths) + code


def _from_disk(digest: str, dtype: Any) -> Kernel | None:
    payload = store.read(digest)
    if payload is None:
        return None
    (count,) = struct.unpack_from("<q", payload)
    numbers = list(struct.unpack_from(f"<{count}q", payload, 8))
    inputs = tuple(numbers[1 : 1 + numbers[0]])
    outputs = tuple(tuple(range(k)) for k in numbers[2 + numbers[0] : -1])
    return Kernel(payload[8 + 8 * count :], numbers[-1], lanes.Layout(inputs, outputs), dtype)
