"""Batches of a model with mimic joints that has no program: by the table kernels of its whole tree, reduced by G.

v of the whole tree is G v; an entry of its q is ratio q_leader + offset. ``recursions.mimic`` says which recursions run
on the whole tree and which solve with M = Gᵀ M G, whose factors are computed by kernels as well. Sums over followers
are taken in the order of their rows, so a sample has the same bits in every batch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..bodies.kinds import NQ
from ..bodies.table import independent
from ..recursions import REDUCTION, SPECS
from ..recursions.spec import Argument, Spec, gather, shape_in, sizes_of
from .compiled.numba_kernels import NONFINITE, OK, PIVOT, UNIT, variant

Array = NDArray[np.float64]
Status = NDArray[np.int8]
EPS = float(np.finfo(np.float64).eps)


class Held:
    """A table of bodies of this module."""

    def __init__(self, bodies: NDArray[Any]) -> None:
        """The rows (n + 1)."""
        self.bodies, self.address = bodies, bodies.ctypes.data
        self.sizes = sizes_of(bodies)


class Run(Protocol):
    """The runner of a table kernel over a batch: results and their status are written in place."""

    def __call__(
        self, spec: Spec, table: Held, inputs: Sequence[Array], static: tuple[Any, ...], out: Array, status: Status
    ) -> None: ...


def fits(spec: Spec) -> bool:
    """Whether table kernels of the whole tree compute a call: recursions made of others take reduced ones instead."""
    sizes = {size for x in (*spec.present, spec.output) for size in x.shape if isinstance(size, str)}
    return not spec.composed and sizes <= {"nq", "nv", "njoints"} and all(x.table is None for x in spec.present)


class Reduced:
    """A table in which joints mimic others."""

    def __init__(self, bodies: NDArray[Any]) -> None:
        """Make the table of the whole tree, that of the joints with coordinates of their own, and G."""
        follows = bodies["leader"] > 0
        whole = bodies.copy()
        whole["leader"] = 0
        self.tree, self.own = Held(whole), Held(independent(bodies))
        rows, behind = np.flatnonzero(~follows)[1:], np.flatnonzero(follows)
        led = np.searchsorted(rows, bodies["leader"][behind])
        self._v, self._v_behind, self._v_led = rows - 1, behind - 1, led
        self._ratio, self._offset = bodies["ratio"][behind], bodies["offset"][behind]
        widths = [NQ[int(kind)] for kind in bodies["kind"][rows]]
        self._q = np.concatenate(
            [np.arange(first, first + width) for first, width in zip(bodies["q_index"][rows], widths, strict=True)]
        )
        self._q_behind, self._q_led = bodies["q_index"][behind], self.own.bodies["q_index"][1 + led]

    def input_of_tree(self, argument: Argument, x: Array) -> Array:
        """An input of the model as an input of the whole tree: each (n, ...)."""
        if argument.shape == ("nq",):
            made = np.empty((len(x), self.tree.sizes["nq"]))
            made[:, self._q] = x
            made[:, self._q_behind] = self._ratio * x[:, self._q_led] + self._offset
            return made
        if argument.shape != ("nv",):
            return x
        made = np.zeros((len(x), self.tree.sizes["nv"]))
        made[:, self._v] = x
        if not argument.is_force:
            made[:, self._v_behind] = self._ratio * x[:, self._v_led]
        return made

    def output_of_model(self, argument: Argument, x: Array) -> Array:
        """An output of the whole tree as an output of the model: axes "nv" times G, or the independent entries."""
        for axis, size in enumerate(argument.shape, start=1):
            if size == "nq":
                x = np.take(x, self._q, axis)
            elif size == "nv":
                y = np.moveaxis(x, axis, 0)
                x = np.take(x, self._v, axis)
                total = np.moveaxis(x, axis, 0)
                for k, at, ratio in zip(self._v_behind, self._v_led, self._ratio, strict=True):
                    if not argument.per_coordinate:
                        total[at] += ratio * y[k]
        return x

    def compute(
        self, run: Run, spec: Spec, inputs: Sequence[Array], static: tuple[Any, ...], out: Array, status: Status
    ) -> None:
        """Compute samples; results and their status, as of a table kernel, are written in place.

        inputs  each (n, ...), or (1, ...) for all samples
        out     (n, ...)
        """
        with np.errstate(all="ignore"):
            if spec.through_M is None:
                found, status[:] = self.on_tree(run, spec, inputs, static)
                out[...] = found.reshape((len(found), *out.shape[1:]))
            else:
                self._through_M(run, spec, inputs, static, out, status)
        lost = ~np.isfinite(out.reshape(len(out), -1)).all(axis=1)
        status[lost & (status == OK)] = NONFINITE

    def visit(self, see: Callable[[Spec], None], spec: Spec, static: tuple[Any, ...]) -> None:
        """Call ``see`` with each Spec whose table kernel computes a part of a call; no kernel runs."""

        def run(spec: Spec, table: Held, inputs: Any, static: Any, out: Array, status: Status) -> None:
            see(spec)
            out[...], status[...] = 1.0, OK

        shapes = [(1, *(shape_in(x.shape, self.own.sizes) or (1,))) for x in spec.present if not x.static]
        out = np.empty((1, *(shape_in(spec.output.shape, self.own.sizes) or (1,))))
        self.compute(run, spec, [np.zeros(shape) for shape in shapes], static, out, np.empty(1, np.int8))

    def on_tree(
        self, run: Run, spec: Spec, inputs: Sequence[Array], static: tuple[Any, ...]
    ) -> tuple[Array, Status]:  # fmt: skip
        """The results of a call on the whole tree (n, ...), reduced, and their status."""
        varying = [x for x in spec.present if not x.static]
        given = [self.input_of_tree(x, y) for x, y in zip(varying, inputs, strict=True)]
        found, status = _run(run, spec, self.tree, given, static)
        return self.output_of_model(spec.output, found), status

    def _through_M(
        self, run: Run, spec: Spec, inputs: Sequence[Array], static: tuple[Any, ...], out: Array, status: Status
    ) -> None:
        taken, known = iter(inputs), iter(static)
        passed = gather(spec.inputs, lambda x: np.asarray(next(known))[None] if x.static else next(taken))
        given = {x.name: y for x, y in zip(spec.present, _flat(passed), strict=True)}
        M = MassMatrices(run, self, given["q"])
        assert spec.through_M is not None
        found = spec.through_M(M, *passed)
        parts = np.stack(np.broadcast_arrays(*found), axis=1) if isinstance(found, tuple) else found
        out[...] = parts.reshape((len(parts), *out.shape[1:]))
        status[:] = OK
        regular = (M.pivots - (self.own.sizes["nv"] * EPS) * M.diagonal > 0.0).all(axis=1)
        if spec.pivots:
            status[np.broadcast_to(~regular, len(out))] = PIVOT
        status[np.broadcast_to(M.status == UNIT, len(out))] = UNIT


class MassMatrices:
    """A ``recursions.spec.MassMatrix`` of the samples of a batch: M(q) of a model with mimic joints, factored.

    diagonal  (n, nv) of M
    pivots    (n, nv) D of M = LᵀD L
    status    (n) of M
    """

    def __init__(self, run: Run, of: Reduced, q: Array) -> None:
        """Compute M and factor it."""
        self._run, self._of = run, of
        M, self.status = of.on_tree(run, SPECS[REDUCTION.mass_matrix], [q], ())
        self._L, _ = _run(run, REDUCTION.factored, of.own, [M], ())
        self.diagonal = M.diagonal(axis1=1, axis2=2)
        self.pivots = self._L.diagonal(axis1=1, axis2=2)

    def solve(self, x: Array) -> Array:
        """M⁻¹ x (n, nv)."""
        return _run(self._run, REDUCTION.solved, self._of.own, [self._L, x], ())[0]

    @cached_property
    def inverse(self) -> Array:
        """M⁻¹ (n, nv, nv)."""
        return _run(self._run, REDUCTION.inverted, self._of.own, [self._L], ())[0]

    def call(self, name: str, *inputs: Any) -> Array:
        """The result (n, ...) of the recursion of this name; optional inputs come last, None for one left out."""
        public = sorted(SPECS[name].present, key=lambda x: x.optional)
        given = {x.name: y for x, y in zip(public, inputs, strict=False) if y is not None}
        spec = variant(SPECS[name], given)
        varying = [given[x.name] for x in spec.present if not x.static]
        static = tuple(given[x.name][0] for x in spec.present if x.static)
        found, _ = self._of.on_tree(self._run, spec, varying, static)
        return found if spec.output.shape else found[:, 0]


def _flat(passed: Sequence[Any]) -> list[Any]:
    return [x for x in passed if x is not None]


def _run(
    run: Callable[..., None], spec: Spec, table: Held, inputs: Sequence[Array], static: tuple[Any, ...]
) -> tuple[Array, Status]:
    """New results (n, ...) of a table kernel, and their status; n is 1 if no input varies."""
    n = max(map(len, inputs), default=1)
    out = np.full((n, *(shape_in(spec.output.shape, table.sizes) or (1,))), np.nan)
    status = np.empty(n, np.int8)
    run(spec, table, [np.ascontiguousarray(x) for x in inputs], static, out, status)
    return out, status


class Itself:
    """Bodies that equal no others: those of an edited sample have other numbers under the name of their model."""

    def __init__(self, bodies: NDArray[Any]) -> None:
        """The rows (n + 1), kept so that no others have their address."""
        self.bodies = bodies

    def __hash__(self) -> int:
        return id(self.bodies)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Itself) and self.bodies is other.bodies


def reduced(table: Any) -> Reduced | None:
    """The Reduced of a table; None without mimic joints."""
    return _reduced(Itself(table.bodies))


@lru_cache(maxsize=16)
def _reduced(of: Itself) -> Reduced | None:
    return Reduced(of.bodies) if of.bodies["leader"].any() else None
