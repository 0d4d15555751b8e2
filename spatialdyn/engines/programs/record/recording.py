"""Calls on one table of bodies recorded as one program: its constants, inputs, outputs and checks."""

from __future__ import annotations

import gc
import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....algebra import regions
from ....algebra.scalars import EPS
from ....bodies.joints import pitch_of
from ....bodies.kinds import LENGTHS, SCREWS, SLIDES, unit_parts
from ....bodies.static_table import StaticTable
from ....bodies.table import independent
from ....errors import SpatialDynError
from ....recursions.spec import Argument, Spec, shape_in, sizes_of
from ..llvm import host_cpu
from ..transform import float32_range
from ..transform.to_double_double import to_double_double
from .constants import constant
from .kernel_layout import KernelLayout
from .mimic_rows import MimicRows, diagonal_of_M, evaluate, rows_of
from .move_origins import move_origins
from .parameters import Parameter, put, withdraw
from .parameters import shape as parameter_shape
from .program import Program
from .regroup import regroup
from .tracer import Tape, table

MOST_ROWS = 128  # of a call whose program may grow by the square of the rows: crba_solve takes 40 s to compile
MOST_NUMBERS = 100  # in a row of scratch of a call that walks the tree, see ``most_rows``
MOST_RESULTS = MOST_ROWS**2  # most results or terms of a sample: Christoffel symbols grow by the cube of the rows
MOST_TABLE = 2048  # most rows of a static table: each height of a ground is in its program
MOST_EQUATIONS = 36  # most equations of a static table: a matrix of 36 rows takes 8400 multiplications to factor
ALONE = ("nl", "nd", "total")  # sizes of a static table that are no equations: entries with a row of J alone, results
POSITION = "rad | m"  # unit of the inputs that are positions


class Recording(NamedTuple):
    """A program and its layout: what its kernel reads, writes and checks."""

    program: Program
    layout: KernelLayout


class ProgramOptions(NamedTuple):
    """Constant inputs, parameters and wanted outputs of some calls: hashable, and text by ``repr``.

    fixed          (input, its entries, flat: NaN for those that are no constants) for each input with constant entries
    parameters     parameters of the table that become inputs, after the other inputs
    outputs        for each call the flat indices of the wanted entries of its output; empty for all of all calls
    ranged         reject samples whose result may depend on numbers below or above float32's range
    double_double  compute in double-double, on the table without regrouping, since its numbers are exact
    bounds         add an output array with a bound on the rounding error of each result; for one call only
    exact_inputs   for bounds in float32: inputs are float32 numbers, not rounded from others
    derivative     "jvp": tangents are further inputs, an array for each input, and derivatives along them are further
                   outputs. "vjp": weights of the results are further inputs, and derivatives of the weighted sum by
                   each input are further outputs. Derivatives by a configuration are by displacements. "along k": only
                   the derivative of order k, without the results, by the entries of all inputs along k directions;
                   each direction has the arrays of the inputs. "along k weighted": weights of the results follow these
                   inputs, and the program is the derivative of the weighted sum by each input
    straight       record short loops pass by pass: derivatives, bounds, double-double and CasADi take no others
    """

    fixed: tuple[tuple[str, tuple[float, ...]], ...] = ()
    parameters: tuple[Parameter, ...] = ()
    outputs: tuple[tuple[int, ...], ...] = ()
    ranged: bool = False
    double_double: bool = False
    bounds: bool = False
    derivative: str = ""
    exact_inputs: bool = False
    straight: bool = False


ALL = ProgramOptions()


def along(derivative: str) -> tuple[int, bool] | None:
    """The number of directions of an "along" derivative, and whether it has weights; None for other derivatives."""
    words = derivative.split()
    return (int(words[1]), len(words) > 2) if words[:1] == ["along"] else None


@contextmanager
def _collector_off() -> Iterator[None]:
    """A context in which Python's garbage collector is off."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


@_collector_off()
def record(
    specs: Sequence[Spec],
    bodies: NDArray[Any],
    static: Sequence[Any] = (),
    options: ProgramOptions = ALL,
    dtype: Any = np.float64,
    errors: bool = False,
) -> Recording:
    """Some calls on one table of bodies as one program; an input of one name is one input.

    static   values of the static inputs of the calls, in their order
    options  constant inputs, parameters that are inputs, and wanted outputs; ``derived`` adds bounds and derivatives to
             the program recorded here
    dtype    dtype of the program; its eps is the scale of pivots' limits
    errors   record the errors of constants, on the table as it is: moving origins supposes rotations that are
             orthogonal to the last bit

    Python's garbage collector is off meanwhile, in all threads. The many small objects made here, none of them in a
    cycle, would start collections that visit all objects of the process, which takes 0.1 s if there are millions.
    """
    for spec in specs:
        if not traces(spec, bodies):
            raise SpatialDynError(f"{spec.name} branches on values, expected a call that can be a program")
    fixed, known = iter(static), dict(options.fixed)
    tape = Tape(errors)
    number = tape.unfolded if options.double_double else constant
    tree = table(bodies, number)
    vars(tree[0])["kind"] = 0  # programs reject samples off unit norm, also where the table allows any norm
    taken = withdraw(tree, options.parameters)
    if all(spec.regroup for spec in specs) and not (options.double_double or errors):
        in_body = options.parameters or any(_in_body(x) for spec in specs for x in spec.present)
        if not in_body and dtype == np.float64:  # in float32 moving an origin costs digits
            move_origins(tree)
        regroup(tree, any(spec.pivots for spec in specs))
    rows, own = rows_of(tree), independent(bodies)
    n, sizes = len(own) - 1, _sizes(bodies, static)

    def shape(symbols: Sequence[str | int]) -> tuple[int, ...]:
        return shape_in(symbols, sizes)

    given: dict[str, Any] = {}
    widths, kinds, units, count, moves = [], [], [], 0, False
    for spec in specs:
        for x in spec.present:
            if x.name in given:
                continue
            if x.static:
                value = next(fixed)
                if isinstance(value, StaticTable):
                    given[x.name] = table(value.rows, number)
                else:
                    given[x.name] = _tracked(value) if errors and isinstance(value, np.ndarray) else value
                continue
            entries = known.get(x.name, (math.nan,) * int(np.prod(shape(x.shape), dtype=int)))
            order = itertools.count(count)
            places_of = [next(order) if math.isnan(e) else None for e in entries]  # None: a constant
            numbers = np.empty(len(entries), dtype=object)
            numbers[:] = [
                tape.input(at) if at is not None else tape.number(e) if errors and e else e
                for e, at in zip(entries, places_of, strict=True)
            ]
            given[x.name] = numbers.reshape(shape(x.shape)) if x.shape else numbers[0]
            if x.unit_norm:
                parts = [tuple(places_of[k] for k in part) for part in unit_parts(own)]
                units += [tuple(k for k in part if k is not None) for part in parts if None not in part]
            width = next(order) - count
            if width or not entries:
                widths.append(width)
                kinds.append(x.unit)
            count += width
            moves |= x.unit != POSITION and any(at is None and e for e, at in zip(entries, places_of, strict=True))
    loads = []
    for p in options.parameters:
        widths.append(math.prod(parameter_shape(p, n)))
        loads.append([tape.input(count + k) for k in range(widths[-1])])
        count += widths[-1]
    put(tree, options.parameters, loads, taken)
    results: list[Any] = []
    places, pivots, norms = [], [], []
    for k, spec in enumerate(specs):
        inner = np.zeros(n, dtype=object)
        straight = errors or options.double_double or options.straight
        with regions.running(tape.unroll if straight else tape.repeat):
            out = evaluate(spec, rows, shape(spec.output.shape), given, inner)
        wanted = out.ravel()[list(options.outputs[k])] if options.outputs else out.ravel()
        places.append(tuple(range(len(results), len(results) + len(wanted))))
        if spec.output.unit_norm:
            chosen = options.outputs[k] if options.outputs else range(out.size)
            at_of = {entry: len(results) + at for at, entry in enumerate(chosen)}
            norms += [tuple(at_of[e] for e in part) for part in unit_parts(own) if set(part) <= set(at_of)]
        results += wanted.tolist()
        if spec.pivots:
            margins = pivot_margins(rows, given["q"], inner, EPS if dtype == np.float64 else float(np.finfo(dtype).eps))
            pivots += [(len(results) + at, least) for at, (_, least) in enumerate(margins)]
            results += [margin for margin, _ in margins]
    program, sizes_of = Program(tape, results, count, fuse=not options.double_double), None
    if options.double_double:
        program = to_double_double(program, host_cpu.host()[3])
    if options.ranged:
        driving = None if moves else [k for k, x in enumerate(kinds) if x != POSITION]
        sizes_of, least = float32_range.ranges(bodies, driving)
        pivots = [(place, max(bound, least)) for place, bound in pivots]
    layout = KernelLayout(
        tuple(widths), tuple(places), tuple(dict.fromkeys(units)), tuple(pivots), tuple(norms), sizes_of
    )
    return Recording(program, layout)


def _in_body(x: Argument) -> bool:
    """Whether an input is given in the coordinates of bodies, whose origins must then stay where they are."""
    return x.name == "fext" or x.table is not None or (x.static and x.shape == (4, 4))


def _tracked(values: NDArray[Any]) -> NDArray[Any]:
    """An array of Constants, whose arithmetic records its errors."""
    made = np.empty(values.shape, dtype=object)
    made.ravel()[:] = [constant(x) for x in values.ravel().tolist()]
    return made


def _sizes(bodies: NDArray[Any], static: Sequence[Any]) -> dict[str, int]:
    """Values of the symbols in the shape of a model's argument, also of symbols that static tables add."""
    found = sizes_of(independent(bodies))
    for x in static:
        if isinstance(x, StaticTable):
            found |= x.sizes
    return found


def shape_of(argument: Argument, bodies: NDArray[Any], static: Sequence[Any] = ()) -> tuple[int, ...]:
    """Shape of one sample of an argument, for a table of bodies and these values of the static inputs."""
    return shape_in(argument.shape, _sizes(bodies, static))


def pivot_margins(rows: Sequence[Any], q: Any, pivots: Any, eps: float = EPS) -> list[tuple[Any, float]]:
    """(margin, least) of each D: margin > least means that D is above n eps times a bound on its composite inertia.

    Let t be the sum of the m distances |x| that joints below the root have travelled. Then 2 b t <= a + c t², because
    b² <= a c for the moments of any body, and t² <= m Σ x². So the bound is a polynomial, which a program can hold, and
    the same in all units. Entries of ``rows`` that are no floats count in the margin, floats in the least value. With
    mimic joints the composite inertias are the diagonal of M.
    """
    n = len(rows) - 1
    if isinstance(rows, MimicRows):
        diagonal = diagonal_of_M(rows, q)  # recorded already
        return [(D - (n * eps) * x, 0.0) for D, x in zip(pivots, diagonal, strict=True)]
    moved: list[Any] = []
    for row in rows[1:]:
        if row.kind in SCREWS:
            moved.append(pitch_of(row) * q[row.q_index])
        elif row.parent > 0 or row.kind in SLIDES:
            moved += [q[k] for k in range(row.q_index, row.q_index + LENGTHS[row.kind])]
    squares: Any = 0.0
    for x in moved:
        squares = squares + x * x
    margins = []
    for row, D in zip(rows[1:], pivots, strict=True):
        least, small = 0.0, n * eps
        growth = (small * 2 * len(moved)) * row.inertia_bound.z * squares
        for part in (
            small * (row.armature + row.inertia_bound.x),
            small * row.inertia_bound.x if moved else 0.0,
            growth,
        ):
            if isinstance(part, float):
                least += part
            else:
                D = D - part
        margins.append((D, float(least)))
    return margins


def fits(specs: Sequence[Spec], bodies: NDArray[Any], results: int | None = None, static: Sequence[Any] = ()) -> bool:
    """Whether calls on a table can be a program: no call branches on values, and the program is not too long.

    results  number of wanted results of one sample, if not all
    static   values of the static inputs; static tables make a program longer
    """
    if results is None:
        sizes = _sizes(bodies, static)
        shapes = [(spec.output.shape, _terms(spec, bodies)) for spec in specs]
        results = sum(max(math.prod(shape_in(shape, sizes)) for shape in (out, terms)) for out, terms in shapes)
    short = 1 < len(bodies) <= min(map(most_rows, specs)) + 1 and results <= MOST_RESULTS
    several = (item for x in static if isinstance(x, StaticTable) for item in x.sizes.items())
    short &= all(n <= MOST_EQUATIONS for name, n in several if name not in ALONE)
    short &= all(len(x.rows) <= MOST_TABLE + 1 for x in static if isinstance(x, StaticTable))
    return short and all(traces(spec, bodies) for spec in specs)


def most_rows(spec: Spec) -> int:
    """Most rows of a table with which a call becomes a program: 474 of rnea, 196 of aba, 128 of calls of many terms.

    A program has to be 1.3 times as fast as the kernels on lanes and of one sample, with AVX-512 and with AVX2: its
    compile time, up to 5 s of CPU time each for one sample and for batches, is then saved by 2 to 5 million samples of
    batches. The lines of a call that walks the tree grow as the rows do, with the numbers in a row of its scratch: rnea
    has 97 of a row, aba 280 to 325. On chains of mixed joints a Zen 4 computes batches by programs of

        rnea   156 rows 1.45, 208 1.42, 288 1.44, 380 1.38, 468 1.30; with AVX2 1.59, 1.37, 1.46, 1.37, 1.30
        aba    156 rows 1.77, 208 1.68, 288 1.57, 468 1.61; with AVX2 1.45, 1.03, 1.12, 1.25

    times as fast as on lanes, beside other work. Single calls take 22 to 25 ns a row by rnea's compiled program, 33 to
    35 in the table kernel, and 130 interpreted until then; by aba's 58 to 74, 88 to 102, and 370 to 430
    (``benchmarks/chains.py --crossover``).
    """
    if spec.composed or spec.work is None:
        return MOST_ROWS
    return max(MOST_ROWS, MOST_ROWS * MOST_NUMBERS * 8 // spec.work.itemsize)


def _terms(spec: Spec, bodies: NDArray[Any]) -> tuple[Any, ...]:
    """Shape of the terms that a program sums; with mimic joints a call that solves factors M."""
    factored = spec.through_M is not None and bodies["leader"].any()
    return spec.term_shape or (("nv", "nv") if factored else ())


def traces(spec: Spec, bodies: NDArray[Any]) -> bool:
    """Whether a call on a table can be recorded; with mimic joints a call that solves runs another recursion."""
    return spec.traceable or (spec.through_M is not None and bool(bodies["leader"].any()))
