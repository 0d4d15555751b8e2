"""Ground truth of a call: the same recursion in any number of digits, or in exact rationals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.static_table import StaticTable
from ..bodies.table import independent
from ..engines.compiled import numba_kernels
from ..engines.compiled.checks import singular_row, unit_norm
from ..engines.numbers import multiprecision as engine
from ..engines.programs.record.mimic_rows import MimicRows, diagonal_of_M, evaluate, rows_of
from ..engines.programs.record.tracer import table
from ..errors import ConfigurationError, InertiaError, ModelError, NonFiniteError, ShapeError, SpatialDynError
from ..model.model import Frame, Model
from ..model.robot_checks import masked
from ..recursions.spec import Argument, Spec, sizes_of
from ..waiting import watch
from .arguments import batch_shape, broadcast, check_model, core_shape
from .failures import zero_inertia_message
from .specs import expected_call, spec_of, static_of

Numbers = NDArray[Any]


def exact(
    model: Model,
    call: Callable[..., Any],
    bits: int | None = 240,
    frame: str | Frame | None = None,
    reference: str = "local",
    classical: bool = False,
    constraints: Any = None,
) -> Exact:
    """A public call of one model in high precision: its result without rounding errors.

    model  Model; its numbers and floats among the inputs are taken at their exact binary values
    call   a public call such as ``sd.aba``
    bits   precision of the result, at least 53; None for exact rationals: only for models without mimic joints and
           calls that use + - * / and sines and cosines of angles. Each angle of q is then given as t = tan(q/2).
    frame, reference, classical   for calls that take them
    constraints   for calls that take Constraints; ``constrained_dynamics`` takes the further input ``rate`` = 1/T of
           its stabilization. For ``contact_step`` and ``contact_gaps`` Contacts on a Plane; a step then returns v,
           impulses, gaps, impulses of limits, residuals and work, and takes friction and restitution of the points as
           its last inputs

    Returns a callable that takes the call's inputs in order (fext last or by name), each of any leading batch shape.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> tau = [0.1, 0.2]
    >>> truth = sd.exact(model, sd.aba)([0.5, -0.3], [1.0, 2.0], tau)
    >>> bool(abs(sd.aba(model, [0.5, -0.3], [1.0, 2.0], tau) - truth).max() < 1e-14 * abs(truth).max())
    True
    >>> from fractions import Fraction
    >>> M = sd.exact(model, sd.crba, bits=None)([Fraction(1, 2), Fraction(1, 3)])
    >>> type(M[0, 0]).__name__
    'Fraction'

    Raises
        SpatialDynError for an unknown call, too few bits, or if mpmath is not installed (extra "exact")
        ModelError for mimic joints with rationals: an angle's multiple has no rational tangent
    """
    check_model(model)
    spec = spec_of(call)
    if spec is None:
        raise SpatialDynError(f"call is {expected_call(call, 'a public call such as spatialdyn.aba')}")
    arithmetic = engine.arithmetic(bits)
    if model.mimic_matrix is not None and bits is None:
        raise ModelError(f'model "{model.name}" has mimic joints, expected one without (mimic=False) for rationals')
    static = static_of(model, [x.name for x in spec.present if x.static], frame, reference, classical, constraints)
    return Exact(model, spec, arithmetic, static, bits)


class Exact:
    """A call in high precision, made by ``exact``: takes the public call's inputs, returns arrays of objects.

    model    the Model
    call     name of the public call
    bits     precision of the results, None for exact rationals
    context  mpmath's context of the results, whose ``nstr`` prints them; None for rationals

    Results are arrays of mpmath's ``mpf`` or of ``Fraction``, a single number where the call returns one;
    ``.astype(float)`` rounds them. A call of several outputs returns a tuple.

    Raises
        ShapeError for shapes that do not match; SpatialDynError for values that are no numbers, or have no exact
            rational value
        ConfigurationError for a quaternion or pair whose norm is not 1 within 1e-6
        InertiaError naming a joint with zero articulated inertia, NonFiniteError for another division by 0
        NaN in a sample gives NaN in what depends on it
    """

    def __init__(
        self, model: Model, spec: Spec, arithmetic: engine.Arithmetic, static: dict[str, Any], bits: int | None
    ) -> None:
        """Convert the numbers of the model to the precision."""
        made = isinstance(model, Model) and isinstance(spec, Spec) and isinstance(static, dict)
        if not made or not hasattr(arithmetic, "number"):
            raise SpatialDynError("arguments are not those that ``exact`` makes, expected exact(model, call)")
        self.model, self.call, self.bits = model, spec.name, bits
        self.context = getattr(arithmetic, "context", None)
        self._spec, self._arithmetic = spec, arithmetic
        self._rows = rows_of(table(model.bodies, arithmetic.number))
        placed = {"placement": engine.numbers(arithmetic, static["placement"])} if "placement" in static else {}
        tables = {name: table(x.rows, arithmetic.number) for name, x in static.items() if isinstance(x, StaticTable)}
        self._static, self._values = {**static, **placed, **tables}, tuple(static.values())

    @watch.call("Exact")
    def __call__(self, *values: Any, **named: Any) -> Any:
        """The call on one sample, or on batches, sample by sample."""
        model, spec = self.model, self._spec
        given = self._match_inputs(values, named)
        arrays = {x.name: self._array(x, value) for x, value in given}
        shapes = [batch_shape(model, x, arrays[x.name], self._values) for x, _ in given]
        batch = broadcast([x.name for x, _ in given], shapes)
        core = core_shape(model, spec.output, self._values)
        result = np.empty(batch + core, dtype=object)
        whole = {x.name: np.broadcast_to(arrays[x.name], batch + core_shape(model, x, self._values)) for x, _ in given}
        for at in np.ndindex(batch):
            sample = {x.name: np.array(whole[x.name][at], dtype=object) for x, _ in given}
            result[at] = self._sample(sample, at)
        for at in np.ndindex(result.shape):
            result[at] = self._arithmetic.shown(result[at])
        if spec.parts:
            sizes = sizes_of(self._rows, [(x, self._static[x.name]) for x in spec.present if x.table is not None])
            parts = zip(spec.parts, spec.split(result, sizes), strict=True)
            return tuple(x if part.shape else x[..., 0] if batch else x[0] for part, x in parts)
        return result if result.shape else result[()]

    def __repr__(self) -> str:
        how = "rationals" if self.bits is None else f"{self.bits} bits"
        inputs = ", ".join(x.name for x in self._spec.present if not x.static)
        return f"<Exact {self.call} of {self.model.name} in ({inputs}): {how}>"

    def _match_inputs(self, values: tuple[Any, ...], named: dict[str, Any]) -> list[tuple[Argument, Any]]:
        """Inputs and their values, in the recursion's order. Raises ShapeError for missing or unknown ones."""
        varying = [x for x in self._spec.present if not x.static]
        order = [x for x in varying if not x.optional] + [x for x in varying if x.optional]
        if len(values) > len(order):
            raise ShapeError(f"{self.call} takes {len(order)} inputs, {len(values)} were given")
        found = dict(zip((x.name for x in order), values, strict=False))
        for name, value in named.items():
            if name in found or name not in {x.name for x in order}:
                what = "twice" if name in found else "as an input it does not have"
                raise ShapeError(f"{self.call} is given {name} {what}, expected {', '.join(x.name for x in order)}")
            found[name] = value
        missing = [x.name for x in order if not x.optional and found.get(x.name) is None]
        if missing:
            raise ShapeError(f"{self.call} lacks {missing[0]}, expected {', '.join(x.name for x in order)}")
        return [(x, found[x.name]) for x in varying if found.get(x.name) is not None]

    def _array(self, argument: Argument, value: Any) -> Numbers:
        if masked(value):
            raise ShapeError(f"{argument.name} is masked, expected an array without a mask, which would be lost")
        try:
            given = np.asarray(value)
        except ValueError:
            raise ShapeError(f"{argument.name} is ragged, expected an array of numbers") from None
        try:
            return engine.numbers(self._arithmetic, given)
        except SpatialDynError as error:
            raise type(error)(f"{argument.name}: {error}") from None

    def _sample(self, sample: dict[str, Numbers], at: tuple[int, ...]) -> Numbers:
        """The result of one sample."""
        model, spec, arithmetic = self.model, self._spec, self._arithmetic
        where = f" in sample {at[0] if len(at) == 1 else at}" if at else ""
        inputs: dict[str, Any] = {}
        for x in spec.present:
            if not x.static and x.name in sample:
                value = sample[x.name]
                if x.unit_norm and not unit_norm(self._rows, value):
                    raise ConfigurationError(
                        f"{x.name}{where} holds a quaternion or (cos, sin) pair that is not of unit norm, expected 1 "
                        "within 1e-6; normalize(model, q) is the cure"
                    )
                if x.shape == ("nq",):
                    inputs[x.name] = arithmetic.coordinates(independent(model.bodies), value)
                else:
                    inputs[x.name] = value if x.shape else value[()]
        pivots = np.full(model.nv, None, dtype=object)
        present = numba_kernels.variant(spec, frozenset(sample))
        try:
            shape = core_shape(model, spec.output, self._values)
            out = evaluate(present, self._rows, shape, {**inputs, **self._static}, pivots)
        except ZeroDivisionError:
            if not spec.pivots:
                raise NonFiniteError(f"{spec.name} divides by 0{where}, expected a robot with mass") from None
            row = 1 + max(k for k, D in enumerate(pivots) if D is None)  # the row at which the inward pass stopped
            raise InertiaError(zero_inertia_message(model, self._row_of_tree(row), where)) from None
        if spec.pivots and all(arithmetic.finite(e) for value in sample.values() for e in value.ravel()):
            if isinstance(self._rows, MimicRows):
                least = [model.nv * arithmetic.eps * x for x in diagonal_of_M(self._rows, inputs["q"])]
                small = [k for k, D in enumerate(pivots, start=1) if not least[k - 1] < D]
                row = small[-1] if small else 0
            else:
                row = singular_row(self._rows, inputs["q"], pivots, arithmetic.eps)
            if row:
                raise InertiaError(zero_inertia_message(model, self._row_of_tree(row), where))
        return out.reshape(shape)[()]

    def _row_of_tree(self, row: int) -> int:
        """The row of the model's table for a row counted without mimic joints."""
        return int(np.flatnonzero(self.model.bodies["leader"] == 0)[row])
