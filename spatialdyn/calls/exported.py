"""A Specialized for other languages and libraries: a name, named arrays, its program, and that of its Jacobian."""

from __future__ import annotations

from typing import NamedTuple

from ..engines.compiled.numba_kernels import variant
from ..engines.programs.record.program import Program
from ..engines.programs.record.recording import Recording
from ..engines.programs.record.tracer import Tape
from ..engines.programs.transform.derivative import hessian, jacobian, jvp, vjp
from ..engines.programs.transform.derived import record, second_derivatives
from ..engines.programs.transform.source_code import Shapes, has_meaning
from ..errors import SpatialDynError, literal
from ..recursions import SPECS
from .specialize_request import SpecializeRequest

MOST_DERIVATIVES = 1 << 17  # those of rnea with 209 joints, a dozen lines each, which CasADi reads in seconds
MOST_TWICE = 36  # input entries of a Hessian: those of aba with 12 joints, recorded in some seconds; grows as the cube


class Exported(NamedTuple):
    """A function of arrays.

    inputs   remaining inputs: name -> shape of one sample
    outputs  results: name -> shape of one sample
    program  from the inputs' entries, array after array in C order, to the outputs' entries
    """

    name: str
    inputs: Shapes
    outputs: Shapes
    program: Program


def exported(request: SpecializeRequest, recorded: Recording, language: str, name: str | None = None) -> Exported:
    """The program of a request as a function, named after its calls by default.

    Inputs are named as in ``signature``, parameters by kind and position: a mass that is the third input is ``mass_3``.
    Results are named ``out_1`` ... if several have the same name, or one has the name of an input.

    Raises SpatialDynError if the name is no identifier, an input's, or reserved in the language.
    """
    name = "_".join(spec.name for spec in request.specs) if name is None else name
    if not (isinstance(name, str) and name.isascii() and name.isidentifier()):
        raise SpatialDynError(f"name is {literal(name)}, expected letters, digits and _")
    if has_meaning(name, language):
        raise SpatialDynError(f"name is {literal(name)}, expected a name that {language.title()} does not reserve")
    inputs: dict[str, tuple[int, ...]] = {}
    numbered = {*request.parameter_names, *("d" + x for x in request.parameter_names)}
    for k, x in enumerate(request.inputs(), start=1):
        kind = x.name.partition(":")[0]
        inputs[f"{kind}_{k}" if x.name in numbered or kind in inputs else kind] = x.shape
    if name in inputs:
        raise SpatialDynError(f"name is {literal(name)}, expected none of its arguments: {', '.join(inputs)}")
    results = request.results()
    outputs = {x.name: x.shape for x in results}
    if len(outputs) < len(results) or {name, *inputs} & set(outputs) or not all(map(str.isidentifier, outputs)):
        outputs = {f"out_{k}": x.shape for k, x in enumerate(results, start=1)}
    program = recorded.program.only(at for part in recorded.layout.outputs for at in part)
    return Exported(name, inputs, outputs, program)


def jacobian_of(request: SpecializeRequest, given: Exported) -> Program:
    """The derivatives of each output entry with respect to each input entry (those of q as they are), row by row.

    Computed by a recursion of derivatives if there is one (for aba 0.4 times the operations), else line by line.

    Raises SpatialDynError for more than MOST_DERIVATIVES.
    """
    (first, *others), model = request.specs, request.model
    entries = len(given.program.outputs) * given.program.inputs
    if entries > MOST_DERIVATIVES:
        raise SpatialDynError(
            f'derivatives of {given.name} of "{model.name}" are {entries} numbers, expected at most {MOST_DERIVATIVES}'
            "; derivatives=False, or jacobian=False for CasADi, leaves them out"
        )
    derivatives = SPECS.get(first.name + "_derivatives")
    plain = not (others or request.constants or request.parameters or request.derivative or request.bounds)
    if derivatives is not None and plain and request.output_places is None and model.nq == model.nv:
        derivatives = variant(derivatives, frozenset())
        n, m, by = model.nv, len(given.program.outputs), len(given.inputs)
        found, layout = record((derivatives,), model.bodies, tuple(request.static.values()))
        if [x.name for x in derivatives.present if not x.static] == [*given.inputs] and len(
            layout.outputs[0]
        ) == n * m * by:
            return found.only(m * n * k + n * row + j for row in range(m) for k in range(by) for j in range(n))
    return jacobian(given.program)


class Derivatives(NamedTuple):
    """Programs of an Exported's derivatives with respect to the entries of its inputs.

    jacobian  from the inputs: derivatives of each output entry with respect to each input entry, row by row
    along     from inputs, directions and outputs: the derivative of the outputs along the directions
    weighted  from inputs, weights and outputs: the derivative of Σ weight · output with respect to each input
    hessian   from inputs, weights and outputs: the second derivatives of Σ weight · output, row by row; None for more
              than MOST_TWICE entries of the inputs
    """

    jacobian: Program
    along: Program
    weighted: Program
    hessian: Program | None


def derivatives_of(request: SpecializeRequest, given: Exported) -> Derivatives:
    """The programs of a request's derivatives. Raises as ``jacobian_of``."""
    first, twice = jacobian_of(request, given), given.program.inputs <= MOST_TWICE
    if request.derivative or request.bounds:
        along, weighted = (_by_lines(given.program, forward) for forward in (True, False))
        return Derivatives(first, along, weighted, hessian(weighted, first.inputs) if twice else None)
    found = []
    for derivative in ("along 1", "along 0 weighted"):
        options = request.options._replace(derivative=derivative, ranged=False)
        recorded, layout = record(request.specs, request.model.bodies, tuple(request.static.values()), options)
        found.append(recorded.only(k for part in layout.outputs for k in part))
    known = request.specs, request.model.bodies, request.options, first, found[1]
    return Derivatives(first, found[0], found[1], second_derivatives(*known) if twice else None)


def _by_lines(program: Program, forward: bool) -> Program:
    """The derivative of a program along a direction, or of its weighted outputs, line by line."""
    tape, n = Tape(), program.inputs
    inputs = [tape.input(k) for k in range(n + (n if forward else len(program.outputs)))]
    found = (jvp if forward else vjp)(tape, program, inputs[:n], inputs[n:])[1]
    return Program(tape, found, len(inputs))
