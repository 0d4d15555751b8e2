"""The arithmetic of a step: recorded numbers, which become a program, or floats, computed by calls.

The source of an effect serves both: it evaluates a Spec, with inputs and outputs by name. ``Recorded`` runs the
recursion on recorded numbers; ``Computed`` calls the Spec as a public call does, without compiling first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..algebra.scalars import exceeds
from ..bodies.static_table import StaticTable
from ..calls.one_sample import of_model
from ..engines.programs.record import tracer
from ..engines.programs.record.mimic_rows import evaluate, rows_of
from ..errors import ConfigurationError, InertiaError, NonFiniteError
from ..model.model import Model
from ..recursions.spec import Spec, shape_in, sizes_of
from .system import NONFINITE, OK, PIVOT, UNIT, System, set_status

Array = NDArray[Any]


class Arithmetic(Protocol):
    """How effects compute.

    recorded  whether numbers are recorded
    rows      rows of the table of bodies, as recursions on plain objects take them
    given     the inputs of the step by name, including those of all effects
    """

    recorded: bool
    given: dict[str, Any]

    @property
    def rows(self) -> Any:
        """See the class."""

    def evaluate(self, spec: Spec, **more: Any) -> dict[str, Any]:
        """The outputs of a Spec by name; its inputs are those of the step and ``more``, where None means absent."""

    def call(self, spec: Spec, count: int, checked: bool = True) -> Callable[..., int]:
        """``(out, *inputs) -> status``: a Spec without tables, of its first ``count`` inputs, as a kernel.

        checked  whether a result that is not finite is an error
        """

    def refuse(self, wrong: Any, reason: Callable[[], None]) -> None:
        """Refuse the step where ``wrong`` is above 0: ``reason`` raises the error of a computed step."""

    def end(self, v: Any) -> None:
        """Make v infinite in a recorded step that is refused: the program then rejects the sample."""


def _places(spec: Spec, sizes: Mapping[str, int]) -> dict[str, Any]:
    """The places of the outputs, by name, in the output of a Spec."""
    if not spec.parts:
        return {spec.output.name: ...}
    return dict(zip((x.name for x in spec.parts), spec.places(sizes), strict=True))


@lru_cache(maxsize=256)
def _names(spec: Spec) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names of the static inputs of a Spec, and of the others."""
    static, others = (tuple(x.name for x in spec.present if x.static is fixed) for fixed in (True, False))
    return static, others


class Recorded:
    """Recorded numbers."""

    recorded = True

    def __init__(self, rows: Any, given: dict[str, Any]) -> None:
        self.rows, self.given, self._wrong = rows, given, 0.0

    def evaluate(self, spec: Spec, **more: Any) -> dict[str, Any]:
        """See ``Arithmetic``."""
        out, sizes = self._run(spec, {**self.given, **more})
        return {name: out[at] for name, at in _places(spec, sizes).items()}

    def call(self, spec: Spec, count: int, checked: bool = True) -> Callable[..., int]:
        """See ``Arithmetic``."""
        names = [x.name for x in spec.present][:count]

        def write(out: Any, *inputs: Any) -> int:
            out[...] = self._run(spec, dict(zip(names, inputs, strict=True)))[0]
            return OK

        return write

    def _run(self, spec: Spec, known: Mapping[str, Any]) -> tuple[Any, dict[str, int]]:
        sizes = sizes_of(self.rows, [(x, known[x.name]) for x in spec.present if x.table is not None])
        shape = shape_in(spec.output.shape, sizes)
        return evaluate(spec, self.rows, shape, known, np.zeros(len(self.rows) - 1, object)), sizes

    def refuse(self, wrong: Any, reason: Callable[[], None]) -> None:
        """See ``Arithmetic``."""
        self._wrong = self._wrong + wrong

    def end(self, v: Any) -> None:
        """See ``Arithmetic``."""
        lost = self._wrong / exceeds(1.0, self._wrong)
        for i in range(len(v)):
            v[i] = v[i] + lost


class Computed:
    """Floats of one sample, by calls: a program, interpreted until compiling pays.

    ``begin`` sets the System and the time before a step: failures are written to the System's status.
    """

    recorded = False

    def __init__(self, model: Model, given: dict[str, Any]) -> None:
        self.model, self.given = model, given
        self.system: Any = None
        self.t = 0.0
        self._kernels: dict[Any, tuple[Callable[..., int], tuple[int, ...], dict[str, Any]]] = {}

    @cached_property
    def rows(self) -> Any:
        """See ``Arithmetic``."""
        return rows_of(tracer.table(self.model.bodies))

    def begin(self, system: System, t: float) -> None:
        """Set the System, to whose status failures are written, and the time of the step."""
        self.system, self.t = system, t

    def evaluate(self, spec: Spec, **more: Any) -> dict[str, Any]:
        """See ``Arithmetic``."""
        known, (static, others) = {**self.given, **more}, _names(spec)
        values = [*map(known.get, others)]
        key = (spec, *map(known.get, static), *[y is None for y in values])
        if key not in self._kernels:
            tables = tuple(known[name] for name in static)
            inputs = [x for x in spec.present if not x.static]
            there = tuple((known.get(x.name) if x.optional else known[x.name]) is not None for x in inputs)
            sizes = self._sizes(tables)
            kernel = self._kernel(spec, tables, there, True)
            self._kernels[key] = kernel, shape_in(spec.output.shape, sizes), _places(spec, sizes)
        kernel, shape, places = self._kernels[key]
        out = np.empty(shape)
        set_status(self.system, kernel(out, *[y for y in values if y is not None]), self.t)
        return {name: out[at] for name, at in places.items()}

    def call(self, spec: Spec, count: int, checked: bool = True) -> Callable[..., int]:
        """See ``Arithmetic``."""
        return self._kernel(spec, (), tuple(k < count for k in range(len(spec.present))), checked)

    def _kernel(
        self, spec: Spec, static: tuple[Any, ...], there: tuple[bool, ...], checked: bool
    ) -> Callable[..., int]:
        call = of_model(spec, self.model, static, there)
        zero = np.zeros(math.prod(shape_in(spec.output.shape, self._sizes(static))))

        def write(out: Any, *inputs: Any) -> int:
            """Write the result on one sample; returns the status of its error, OK where an input's NaN gives NaN."""
            try:
                out[...] = call(*inputs)
                return OK if not checked or out.ravel().dot(zero) == 0.0 else NONFINITE  # faster than isfinite
            except InertiaError:
                code = PIVOT
            except ConfigurationError:
                code = UNIT
            except NonFiniteError:
                code = NONFINITE
            out[...] = np.nan
            return code

        return write

    def _sizes(self, static: tuple[Any, ...]) -> dict[str, int]:
        """The sizes of arrays."""
        sizes = {"nv": self.model.nv, "nq": self.model.nq, "njoints": self.model.njoints}
        for x in static:
            sizes |= x.sizes if isinstance(x, StaticTable) else {}
        return sizes

    def refuse(self, wrong: Any, reason: Callable[[], None]) -> None:
        """See ``Arithmetic``. A step that has failed already keeps its status."""
        if wrong > 0.0 and self.system.status[0] == OK:
            reason()

    def end(self, v: Any) -> None:
        """See ``Arithmetic``."""
