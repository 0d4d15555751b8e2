"""Programs made from recorded ones: with a bound on the error of each result, or with derivatives."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....algebra.rotations import rotation
from ....bodies.kinds import CONTINUED, LENGTHS, NV, R1, UNITS
from ....bodies.table import independent
from ....errors import SpatialDynError
from ....recursions import SPECS
from ....recursions.spec import Spec
from ...compiled.numba_kernels import variant
from ..llvm import host_cpu
from ..record import recording
from ..record.kernel_layout import KernelLayout
from ..record.operations import SUB
from ..record.parameters import shape as parameter_shape
from ..record.program import Program
from ..record.recording import ALL, ProgramOptions, Recording, along, shape_of
from ..record.tracer import Tape
from .derivative import Turn, hessian, jvp, vjp
from .error_bound import Bounded, Bounding

MOST_PRODUCT = 12  # most freedoms for which the residual M M⁻¹ - 1 bounds the error of M⁻¹: it takes n³ products


def record(
    specs: Sequence[Spec],
    bodies: NDArray[Any],
    static: Sequence[Any] = (),
    options: ProgramOptions = ALL,
    dtype: Any = np.float64,
) -> Recording:
    """Some calls on one table of bodies as one program, as ``recording.record``, also with bounds and derivatives."""
    if options.bounds:
        return _with_bounds(specs, bodies, static, options._replace(bounds=False, straight=True), dtype)
    if along(options.derivative):
        return _derivative_alone(specs, bodies, static, options, dtype)
    if options.derivative:
        return _with_derivative(specs, bodies, static, options, dtype)
    return recording.record(specs, bodies, static, options, dtype)


def _with_bounds(
    specs: Sequence[Spec], bodies: NDArray[Any], static: Sequence[Any], options: ProgramOptions, dtype: Any
) -> Recording:
    """One call with bounds, by running error analysis, or for a call that solves by its residual, which is sharper."""
    (spec,) = specs
    matrix = len(spec.output.shape) == 2
    fma = host_cpu.host()[3]
    if not spec.residual or (matrix and len(independent(bodies)) - 1 > MOST_PRODUCT):
        program, layout = recording.record(specs, bodies, static, options, dtype)
        with_errors = recording.record(specs, bodies, static, options, dtype, errors=True).program
        made = Bounding(dtype, with_errors.operations["depth"], fma)
        inputs = made.inputs(program.inputs, layout.units, options.exact_inputs)
        results = made.run(program, inputs, bounds=False)
        found = made.run(with_errors, inputs)
        return _beside(made, program, layout, results, made.beside(results, found, layout.outputs[0]))
    whole = options._replace(outputs=())
    program, layout = recording.record(specs, bodies, static, whole, dtype)
    given, solving = (variant(SPECS[name], {x.name for x in spec.present}) for name in spec.residual)
    back, inverse = (recording.record((x,), bodies, (), whole, dtype, errors=True).program for x in (given, solving))
    made = Bounding(dtype, sum(x.operations["depth"] for x in (program, back, inverse)) + len(bodies), fma)
    inputs = made.inputs(program.inputs, layout.units, options.exact_inputs)
    results = made.run(program, inputs, bounds=False)
    columns = _columns(spec, options, bodies, inputs)
    n = len(independent(bodies)) - 1
    entries = made.run(inverse, _chosen(solving, options, bodies, columns, inputs))[: n * n]
    rows = [entries[n * i : n * i + n] for i in range(n)]
    if matrix:
        mass = made.run(back, _chosen(given, options, bodies, columns, inputs))
        by_column = [made.solved(rows, made.product(mass, [x.x for x in results[j : n * n : n]], j)) for j in range(n)]
        bounds = [by_column[j][i] for i in range(n) for j in range(n)]
    else:
        columns[spec.output.name] = [made.exact(x.x) for x in results[:n]]
        found = made.run(back, _chosen(given, options, bodies, columns, inputs))
        wanted = columns[given.output.name]
        bounds = made.solved(rows, [made.apply(SUB, x, y) for x, y in zip(found, wanted, strict=False)])
    places = options.outputs[0] if options.outputs else layout.outputs[0]
    chosen = replace(layout, outputs=(tuple(places),))
    return _beside(made, program, chosen, results, [bounds[k] for k in places])


def _beside(
    made: Bounding, program: Program, layout: KernelLayout, results: Sequence[Bounded], bounds: Sequence[Any]
) -> Recording:
    """A program with its results, then the bounds of the results in the layout."""
    outputs = [x.x for x in results] + list(bounds)
    places = (*layout.outputs, tuple(range(len(results), len(outputs))))
    return Recording(Program(made.tape, outputs, program.inputs, fuse=False), replace(layout, outputs=places, bounds=1))


def _columns(
    spec: Spec, options: ProgramOptions, bodies: NDArray[Any], inputs: Sequence[Bounded]
) -> dict[str, list[Bounded]]:
    """The entries of each input of a call, from the program's columns or from constants."""
    known, order, found = dict(options.fixed), iter(inputs), {}
    for x in spec.present:
        entries = known.get(x.name, (math.nan,) * math.prod(shape_of(x, bodies)))
        found[x.name] = [next(order) if math.isnan(e) else Bounded(e, 0.0) for e in entries]
    return found


def _chosen(
    spec: Spec,
    options: ProgramOptions,
    bodies: NDArray[Any],
    columns: dict[str, list[Bounded]],
    inputs: Sequence[Bounded],
) -> list[Bounded]:
    """The inputs of another call's program with the same options: entries by name, then the parameters."""
    known = dict(options.fixed)
    chosen = [
        entry
        for x in spec.present
        for entry, constant in zip(columns[x.name], known.get(x.name, columns[x.name]), strict=True)
        if not isinstance(constant, float) or math.isnan(constant)
    ]
    count = sum(math.prod(parameter_shape(p, len(independent(bodies)) - 1)) for p in options.parameters)
    return [*chosen, *inputs[len(inputs) - count :]]


def _derivative_alone(
    specs: Sequence[Spec], bodies: NDArray[Any], static: Sequence[Any], options: ProgramOptions, dtype: Any
) -> Recording:
    """A derivative of any order of some calls by the entries of their inputs, without the results themselves.

    A first derivative takes the results as further inputs, behind all others: calls that solve need them.
    """
    directions, weighted = along(options.derivative) or (0, False)
    if directions + weighted == 1 and inverse_of(specs, bodies, options):
        return _by_inverse(specs[0], bodies, weighted)
    program, layout = recording.record(
        specs, bodies, static, options._replace(derivative="", ranged=False, straight=True), dtype
    )
    entries, checks = program.inputs, _checks(layout)
    program = program.only([*checks, *itertools.chain.from_iterable(layout.outputs)])
    for _ in range(directions):
        tape, n = Tape(), program.inputs
        inputs = [tape.input(k) for k in range(n + entries)]
        values, rates = jvp(tape, program, inputs[:n], [*inputs[n:], *[0.0] * (n - entries)])
        program = Program(tape, [*values[: len(checks)], *rates[len(checks) :]], n + entries)
    columns = tuple(map(len, layout.outputs))
    given = layout.inputs * (directions + 1)
    if weighted:
        tape, n = Tape(), program.inputs
        inputs = [tape.input(k) for k in range(n + sum(columns))]
        values, found = vjp(tape, program, inputs[:n], [*[0.0] * len(checks), *inputs[n:]])
        program = Program(tape, [*values[: len(checks)], *found[:entries]], n + sum(columns))
        given, columns = (*given, *columns), layout.inputs
    return Recording(program, _behind_checks(layout, given, columns))


def inverse_of(specs: Sequence[Spec], bodies: NDArray[Any], options: ProgramOptions) -> bool:
    """Whether there is one call, which solves for its result from q, v and a force, without quaternions or pairs.

    Its derivatives are then those of its inverse, multiplied by M⁻¹, which takes two thirds of the operations of
    differentiating its own lines.
    """
    residual = specs[0].residual
    if set(bodies["kind"][1:].tolist()) - {CONTINUED, *R1}:  # off unit norm aba and rnea are not inverse
        return False
    plain = not (len(specs) > 1 or options.fixed or options.parameters or options.outputs)
    if not (plain and residual):
        return False
    inverse, (spec,) = variant(SPECS[residual[0]], frozenset()), specs
    back = ["q", "v", spec.output.name], ["q", "v", inverse.output.name]
    return ([x.name for x in inverse.present], [x.name for x in spec.present]) == back


def _by_inverse(spec: Spec, bodies: NDArray[Any], weighted: bool) -> Recording:
    """The first derivative of a call that solves rnea(q, v, a) = tau: M da = dtau - ∂rnea/∂q dq - ∂rnea/∂v dv."""
    solver, layout = _solver(spec, bodies)
    n, checks, nq = len(independent(bodies)) - 1, _checks(layout), layout.inputs[0]
    solver = solver.only([*checks, *layout.outputs[0]])
    forces = recording.record((variant(SPECS[spec.residual[0]], frozenset()),), bodies).program
    forces = forces.only(range(n))
    given = (nq, n, n, n, n) if weighted else (nq, n, n, nq, n, n, n)  # inputs, directions or weights, result
    tape = Tape()
    parts = [
        [tape.input(k) for k in range(a, b)] for a, b in itertools.pairwise(itertools.accumulate(given, initial=0))
    ]
    q, v, a = parts[0], parts[1], parts[-1]

    def solved(force: Sequence[Any]) -> list[Any]:
        return jvp(tape, solver, [*q, *force], [0.0] * (nq + n))[0]

    if weighted:
        found = solved(parts[3])
        slopes = vjp(tape, forces, [*q, *v, *a], found[len(checks) :])[1]
        results = [*found[: len(checks)], *(-x for x in slopes[: nq + n]), *found[len(checks) :]]
        columns: tuple[int, ...] = (nq, n, n)
    else:
        rates = jvp(tape, forces, [*q, *v, *a], [*parts[3], *parts[4], *[0.0] * n])[1]
        results, columns = solved([x - y for x, y in zip(parts[5], rates, strict=True)]), (n,)
    return Recording(Program(tape, results, sum(given)), _behind_checks(layout, given, columns))


def _solver(spec: Spec, bodies: NDArray[Any]) -> Recording:
    """From q and a force at rest without gravity to M⁻¹ force."""
    still = bodies.copy()
    still[0]["gravity"] = 0.0
    n = len(independent(bodies)) - 1
    return recording.record((spec,), still, (), ProgramOptions(fixed=(("v", (0.0,) * n),)))


def second_derivatives(
    specs: Sequence[Spec], bodies: NDArray[Any], options: ProgramOptions, jacobian: Program, weighted: Program
) -> Program:
    """The second derivatives of Σ weight · result by the entries of the inputs: from inputs, weights and results.

    jacobian  the program of the first derivatives, row by row
    weighted  the program of the first derivatives of Σ weight · result

    Of a call that solves rnea(q, v, a) = tau, with λ = M⁻¹ weight and the Jacobian J of a, they are
    -(1 J)ᵀ ∂²(λ·rnea) (1 J): λ·rnea(q, v, a) = λ·tau is differentiated twice at constant λ.
    """
    n = len(independent(bodies)) - 1
    if not inverse_of(specs, bodies, options):
        return hessian(weighted, jacobian.inputs)
    (spec,), inverse = specs, variant(SPECS[specs[0].residual[0]], frozenset())
    solver, layout = _solver(spec, bodies)
    slopes, beside = record((inverse,), bodies, (), ProgramOptions(derivative="along 0 weighted"))
    slopes = slopes.only(itertools.chain.from_iterable(beside.outputs))
    tape, given = Tape(), (n, n, n, n, n)  # q, v, tau, weights, a
    q, v, tau, weights, a = (
        [tape.input(k) for k in range(first, end)]
        for first, end in itertools.pairwise(itertools.accumulate(given, initial=0))
    )

    def replayed(program: Program, inputs: Sequence[Any]) -> list[Any]:
        return jvp(tape, program, inputs, [0.0] * len(inputs))[0]

    J = replayed(jacobian, [*q, *v, *tau])
    force = replayed(solver.only(layout.outputs[0]), [*q, *weights])
    F = replayed(hessian(slopes, 3 * n), [*q, *v, *a, *force])
    upper = {}
    for i in range(3 * n):
        for j in range(i, 3 * n):
            total = F[3 * n * i + j] if j < 2 * n else 0.0
            for k in range(n):
                for by, other in ((i, j), (j, i)):
                    if by < n:  # rnea has a and its other inputs together in a product with q alone
                        total = total + F[3 * n * by + 2 * n + k] * J[3 * n * k + other]
            upper[i, j] = -total
    entries = [upper[min(i, j), max(i, j)] for i in range(3 * n) for j in range(3 * n)]
    return Program(tape, entries, sum(given))


def _checks(layout: KernelLayout) -> list[int]:
    """The places of all results that have checks other than being finite."""
    return [place for place, _ in layout.pivots] + [place for group in layout.norms for place in group]


def _behind_checks(layout: KernelLayout, inputs: tuple[int, ...], outputs: Sequence[int]) -> KernelLayout:
    """The layout of a program that has the results of ``_checks``, then arrays with these numbers of columns."""
    order = itertools.count(len(layout.pivots))
    norms = tuple(tuple(next(order) for _ in group) for group in layout.norms)
    ends = itertools.accumulate(outputs, initial=next(order))
    return replace(
        layout,
        inputs=inputs,
        outputs=tuple(tuple(range(a, b)) for a, b in itertools.pairwise(ends)),
        pivots=tuple((k, least) for k, (_, least) in enumerate(layout.pivots)),
        norms=norms,
    )


def _with_derivative(
    specs: Sequence[Spec], bodies: NDArray[Any], static: Sequence[Any], options: ProgramOptions, dtype: Any
) -> Recording:
    """Some calls with their derivatives."""
    own = independent(bodies)
    program, layout = recording.record(
        specs, bodies, static, options._replace(derivative="", ranged=False, straight=True), dtype
    )
    tape, order = Tape(), itertools.count(program.inputs)
    inputs = [tape.input(k) for k in range(program.inputs)]
    arrays = _arrays(specs, options, bodies)
    ends = list(itertools.accumulate(layout.inputs, initial=0))
    parts = [inputs[a:b] for a, b in itertools.pairwise(ends)]
    forward = options.derivative == "jvp"
    further, results = [], []
    turns = [_turns(own, part) if mover else [] for mover, part in zip(arrays, parts, strict=True)]
    every = [turn for those in turns for _, turn in those]
    if forward:
        tangents: list[Any] = []
        turning: list[Any] = []
        for mover, part, those in zip(arrays, parts, turns, strict=True):
            further.append(len(own) - 1 if mover else len(part))
            along = [tape.input(next(order)) for _ in range(further[-1])]
            turning += [along[freedom] for freedom, _ in those]
            if mover:
                rest = [0.0] * len(part)
                along = jvp(tape, _mover(mover, bodies), [*part, *[0.0] * len(along)], [*rest, *along])[1]
            tangents += along
        values, rates = jvp(tape, program, inputs, [*tangents, *turning], every)
        results = [[rates[k] for k in places] for places in layout.outputs]
    else:
        weights: list[Any] = [0.0] * len(program.outputs)
        for places in layout.outputs:
            further.append(len(places))
            for k in places:
                weights[k] = tape.input(next(order))
        values, found = vjp(tape, program, inputs, weights, every)
        by_turn = iter(found[len(inputs) :])
        for mover, part, first, those in zip(arrays, parts, ends, turns, strict=False):
            by = found[first : first + len(part)]
            if mover:
                by = vjp(tape, _mover(mover, bodies), [*part, *[0.0] * (len(own) - 1)], by)[1][len(part) :]
            for freedom, _ in those:
                by[freedom] = by[freedom] + next(by_turn)
            results.append(by)
    outputs = [*values, *itertools.chain.from_iterable(results)]
    at = itertools.count(len(values))
    beside = tuple(tuple(next(at) for _ in part) for part in results)
    layout = replace(layout, inputs=(*layout.inputs, *further), outputs=(*layout.outputs, *beside))
    return Recording(Program(tape, outputs, next(order)), layout)


def _turns(bodies: NDArray[Any], q: Sequence[Any]) -> list[tuple[int, Turn]]:
    """For each freedom by which a quaternion of q turns, its index and how it turns the rotation matrix R.

    Along a turn φ in the body's own axes R' = R [φ]×, so the derivative of a column is another column.
    """
    found: list[tuple[int, Turn]] = []
    for i, row in enumerate(bodies[1:]):
        kind = int(row["kind"])
        if UNITS[kind] == 4:
            first = int(row["q_index"]) + LENGTHS[kind]
            R = rotation(*q[first : first + 4])
            for k in range(3):
                after, before = (k + 1) % 3, (k + 2) % 3
                turn: dict[int, Any] = {}
                for r in (0, 3, 6):
                    for x, slope in ((R[r + after], R[r + before]), (R[r + before], -R[r + after])):
                        turn[x.line] = -slope if x.minus else slope
                found.append((i + NV[kind] - 3 + k, turn))
    return found


def _mover(name: str, bodies: NDArray[Any]) -> Program:
    """The program of the call that moves a configuration."""
    return recording.record((SPECS[name],), bodies).program


def _arrays(specs: Sequence[Spec], options: ProgramOptions, bodies: NDArray[Any]) -> list[str]:
    """For each input array the name of the call that moves it, "" for an array of numbers.

    Raises SpatialDynError if some entries of a configuration with quaternions, pairs or planar joints are fixed.
    """
    known, found = dict(options.fixed), {}
    on_group = not set(bodies["kind"][1:].tolist()) <= {CONTINUED, *R1}  # a planar joint's twist is in its body's axes
    for spec in specs:
        for x in spec.present:
            if x.static or (x.name in known and not any(map(math.isnan, known[x.name]))):
                continue
            moved = bool(x.moved_by) and on_group
            if moved and x.name in known:
                raise SpatialDynError(
                    f"{x.name} has fixed entries, expected all or none where joints have quaternions or pairs"
                )
            found[x.name] = x.moved_by if moved else ""
    return [*found.values(), *[""] * len(options.parameters)]
