"""What a step is computed with: recorded numbers, which become a program, or floats, by kernels.

An effect is written once, for both: it takes the outputs of a Spec by name, of inputs by name. ``Recorded`` runs
the recursion on recorded numbers; ``Computed`` calls the Spec's kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..bodies.static_table import StaticTable
from ..engines import run
from ..engines.compiled import numba_kernels
from ..engines.programs.record import tracer
from ..engines.programs.record.mimic_rows import evaluate, rows_of
from ..model.model import Model
from ..recursions.spec import Spec, shape_in, sizes_of
from .system import System, set_status

Array = NDArray[Any]


class Arithmetic(Protocol):
    """How effects compute.

    recorded  whether numbers are recorded
    rows      of the table of bodies, as recursions take them on plain objects
    given     the inputs of the step by name, those of all effects among them
    """

    recorded: bool
    rows: Any
    given: dict[str, Any]

    def evaluate(self, spec: Spec, **more: Any) -> dict[str, Any]:
        """The outputs of a Spec by name; its inputs are those of the step, and ``more``. None is left out."""


def _evaluated(spec: Spec, rows: Any, known: Mapping[str, Any]) -> dict[str, Any]:
    """The outputs of a Spec by name, of plain objects."""
    sizes = sizes_of(rows, [(x, known[x.name]) for x in spec.present if x.table is not None])
    shape = shape_in(spec.output.shape, sizes)
    out = evaluate(spec, rows, shape, known, np.zeros(len(rows) - 1, object))
    return dict(zip(_names(spec), spec.split(out, sizes), strict=True))


def _names(spec: Spec) -> list[str]:
    """Of the outputs."""
    return [x.name for x in spec.parts or (spec.output,)]


class Recorded:
    """Recorded numbers. Where something is wrong in a step, ``wrong`` is not 0: it makes the state infinite."""

    recorded = True

    def __init__(self, rows: Any, given: dict[str, Any]) -> None:
        self.rows, self.given, self.wrong = rows, given, 0.0

    def evaluate(self, spec: Spec, **more: Any) -> dict[str, Any]:
        """See ``Arithmetic``."""
        return _evaluated(spec, self.rows, {**self.given, **more})


class Computed:
    """Floats of one sample.

    once  whether it is for one step, which recursions take in plain Python rather than compile their kernels

    Before a step, ``begin`` says when and with which System it is: failures become its status.
    """

    recorded = False

    def __init__(self, model: Model, given: dict[str, Any], once: bool = False) -> None:
        self.model, self.given, self.once = model, given, once
        self.rows = rows_of(tracer.table(model.bodies))
        self.system: Any = None
        self.t = 0.0
        self._kernels: dict[Any, tuple[Spec, Callable[..., int]]] = {}

    def begin(self, system: System, t: float) -> None:
        """The System whose status failures are written to, and the time of the step."""
        self.system, self.t = system, t

    def evaluate(self, spec: Spec, **more: Any) -> dict[str, Any]:
        """See ``Arithmetic``."""
        known = {**self.given, **more}
        walks = spec.work is not None or not spec.composed  # the tree: kernels have rows of independent joints alone
        if self.once or (self.model.mimic_matrix is not None and walks):
            plain = {name: x.rows if isinstance(x, StaticTable) else x for name, x in known.items()}
            with np.errstate(all="ignore"):
                made = _evaluated(spec, self.rows, plain)
            found = {name: x.astype(np.float64) for name, x in made.items()}
            finite = all(np.isfinite(x).all() for x in found.values())
            set_status(self.system, numba_kernels.OK if finite else numba_kernels.NONFINITE, self.t)
            return found
        if spec.large:
            static = tuple(known[x.name] for x in spec.present if x.static)
            if run.program(numba_kernels.variant(spec, self._optional(spec, known)), self.model, static) is not None:
                return self._by_program(spec, known)
        own, kernel = self._kernel(spec, known)
        sizes, out = self._sized(own, known)
        given = (self._passed(known[x.name]) for x in own.present)
        set_status(self.system, kernel(self.system.table, *given, out), self.t)
        return dict(zip(_names(own), own.split(out, sizes), strict=True))

    def _by_program(self, spec: Spec, known: Mapping[str, Any]) -> dict[str, Any]:
        """The same as calls answer."""
        own = numba_kernels.variant(spec, self._optional(spec, known))
        sizes, out = self._sized(own, known)
        given = [x for x in own.present if not x.static]
        inputs = [np.asarray(known[x.name], np.float64)[None] for x in given]
        static = tuple(known[x.name] for x in own.present if x.static)
        failed = run.batch(own, self.model, inputs, static, out.reshape((1, -1)), seen=False)
        set_status(self.system, int(failed.status[0]) if len(failed.samples) else numba_kernels.OK, self.t)
        return dict(zip(_names(own), own.split(out, sizes), strict=True))

    def _sized(self, own: Spec, known: Mapping[str, Any]) -> tuple[dict[str, int], Array]:
        """The sizes of a call, and space for what it gives."""
        sizes = {"nv": self.model.nv, "nq": self.model.nq, "njoints": self.model.njoints}
        for x in own.present:
            if x.table is not None:
                sizes |= {name: int(known[x.name].rows[0][name]) for name in x.sizes}
        return sizes, np.empty(shape_in(own.output.shape, sizes))

    @staticmethod
    def _optional(spec: Spec, known: Mapping[str, Any]) -> frozenset[str]:
        """The optional inputs that are there."""
        return frozenset(x.name for x in spec.present if x.optional and known.get(x.name) is not None)

    def _kernel(self, spec: Spec, known: Mapping[str, Any]) -> tuple[Spec, Callable[..., int]]:
        """The Spec with the optional inputs that are there, and its kernel."""
        present = self._optional(spec, known)
        if (spec, present) not in self._kernels:
            own = numba_kernels.variant(spec, present)
            self._kernels[spec, present] = own, numba_kernels.sample_kernel(own)
        return self._kernels[spec, present]

    @staticmethod
    def _passed(x: Any) -> Any:
        """An input as a kernel takes it."""
        if isinstance(x, StaticTable):
            return getattr(x, run.STATIC)
        return np.ascontiguousarray(x) if isinstance(x, np.ndarray) else x
