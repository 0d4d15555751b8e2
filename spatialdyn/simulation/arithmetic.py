"""The arithmetic of a step: recorded numbers, which become a program, or floats, computed by calls.

The source of an effect serves both: it evaluates a Spec, with inputs and outputs by name. ``Recorded`` runs the
recursion on recorded numbers; ``Computed`` calls the Spec as a public call does, without compiling first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

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
    rows: Any
    given: dict[str, Any]

    def evaluate(self, spec: Spec, **more: Any) -> dict[str, Any]:
        """The outputs of a Spec by name; its inputs are those of the step and ``more``, where None means absent."""


def _evaluated(spec: Spec, rows: Any, known: Mapping[str, Any]) -> dict[str, Any]:
    """The outputs of a Spec by name, computed on plain objects."""
    sizes = sizes_of(rows, [(x, known[x.name]) for x in spec.present if x.table is not None])
    shape = shape_in(spec.output.shape, sizes)
    out = evaluate(spec, rows, shape, known, np.zeros(len(rows) - 1, object))
    return dict(zip(_names(spec), spec.split(out, sizes), strict=True))


def _names(spec: Spec) -> list[str]:
    """Names of the outputs."""
    return [x.name for x in spec.parts or (spec.output,)]


class Recorded:
    """Recorded numbers. If a step finds an error, ``wrong`` is not 0 and makes the state infinite."""

    recorded = True

    def __init__(self, rows: Any, given: dict[str, Any]) -> None:
        self.rows, self.given, self.wrong = rows, given, 0.0

    def evaluate(self, spec: Spec, **more: Any) -> dict[str, Any]:
        """See ``Arithmetic``."""
        return _evaluated(spec, self.rows, {**self.given, **more})


class Answer(NamedTuple):
    """The function that computes a Spec on one sample, the shape of its output, and the place of each part in it."""

    call: Callable[..., Any]
    shape: tuple[int, ...]
    parts: dict[str, Any]


class Computed:
    """Floats of one sample, by calls: a program, interpreted until compiling pays.

    ``begin`` sets the System and the time before a step: failures are written to the System's status.
    """

    recorded = False

    def __init__(self, model: Model, given: dict[str, Any]) -> None:
        self.model, self.given = model, given
        self.rows = rows_of(tracer.table(model.bodies))
        self.system: Any = None
        self.t = 0.0
        self._calls: dict[Any, Answer] = {}

    def begin(self, system: System, t: float) -> None:
        """Set the System, to whose status failures are written, and the time of the step."""
        self.system, self.t = system, t

    def evaluate(self, spec: Spec, **more: Any) -> dict[str, Any]:
        """See ``Arithmetic``."""
        known = {**self.given, **more}
        named = [known.get(x.name) if x.optional else known[x.name] for x in spec.present]
        static = tuple(y for x, y in zip(spec.present, named, strict=True) if x.static)
        values = [y for x, y in zip(spec.present, named, strict=True) if not x.static]
        key = spec, static, *(x is None for x in values)
        made = self._calls.get(key)
        if made is None:
            made = self._calls.setdefault(key, self._made(spec, static, tuple(x is not None for x in values)))
        call, shape, parts = made
        out = np.empty(shape)
        code = answered(call, out, *(x for x in values if x is not None))
        set_status(self.system, finite(code, out), self.t)
        return {name: out[at] for name, at in parts.items()}

    def _made(self, spec: Spec, static: tuple[Any, ...], there: tuple[bool, ...]) -> Answer:
        """The Answer for a Spec with the inputs that are given."""
        model = self.model
        sizes = {"nv": model.nv, "nq": model.nq, "njoints": model.njoints}
        for x in static:
            sizes |= x.sizes if isinstance(x, StaticTable) else {}
        shape, at = shape_in(spec.output.shape, sizes), 0
        parts: dict[str, Any] = {} if spec.parts else {spec.output.name: ...}
        for x in spec.parts:
            parts[x.name] = slice(at, at + math.prod(shape_in(x.shape, sizes)))
            at = parts[x.name].stop
        return Answer(of_model(spec, model, static, there), shape, parts)


def answered(call: Callable[..., Any], out: Any, *inputs: Any) -> int:
    """Write the result of a call on one sample; returns the status of its error, OK where an input's NaN gives NaN."""
    try:
        out[...] = call(*inputs)
        return OK
    except InertiaError:
        code = PIVOT
    except ConfigurationError:
        code = UNIT
    except NonFiniteError:
        code = NONFINITE
    out[...] = np.nan
    return code


def finite(code: int, out: Any) -> int:
    """The status of a result that must be finite."""
    return NONFINITE if code == OK and not np.isfinite(out).all() else code
