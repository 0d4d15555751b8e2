"""A recursion on all samples of a batch at once in NumPy, without recording or compiling.

It computes the samples that programs reject (angles beyond the short sine, NaN, joints of almost no articulated
inertia) with the meaning of a table kernel: a NaN reaches all that the recursion computes from it. sin and cos are the
C library's. The bits of a sample depend on that sample alone, since each operation is rounded by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra import heights, regions, scalars
from ...algebra.rotations import UNIT_TOLERANCE
from ...bodies.kinds import unit_parts
from ...bodies.static_table import StaticTable
from ...bodies.table import ANY_NORM, independent
from ...recursions.spec import Argument, Spec
from ..compiled.numba_kernels import NONFINITE, OK, PIVOT, UNIT
from ..programs.record import parameters
from ..programs.record.mimic_rows import evaluate, rows_of
from ..programs.record.parameters import Parameter
from ..programs.record.recording import pivot_margins, shape_of, traces
from ..programs.record.tracer import table

MOST = 1024  # samples computed at a time: an operation in NumPy then costs hardly more than on one sample
F8 = np.float64


class Samples:
    """One number of each sample: an array that an object array holds as one entry."""

    __slots__ = ("x",)
    __array_ufunc__ = None  # NumPy's scalars then call our operators

    def __init__(self, x: NDArray[np.float64]) -> None:
        """The numbers (n)."""
        self.x = x

    def __neg__(self) -> Samples:
        return Samples(-self.x)

    def __abs__(self) -> Samples:
        return Samples(abs(self.x))

    def __add__(self, other: Any) -> Samples:
        return Samples(self.x + _array(other))

    __radd__ = __add__

    def __sub__(self, other: Any) -> Samples:
        return Samples(self.x - _array(other))

    def __rsub__(self, other: Any) -> Samples:
        return Samples(other - self.x)

    def __mul__(self, other: Any) -> Samples:
        return Samples(self.x * _array(other))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Samples:
        return Samples(np.divide(self.x, _array(other)))

    def __rtruediv__(self, other: Any) -> Samples:
        return Samples(other / self.x)

    def _refuse(self, other: Any = None) -> bool:
        raise TypeError(
            "numbers of several samples have no truth and no order; a recursion chooses with scalars.select"
        )

    __bool__ = __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = _refuse
    __hash__ = None  # type: ignore[assignment]


def _array(x: Any) -> Any:
    return x.x if isinstance(x, Samples) else x


def _each(function: Callable[..., float]) -> Callable[..., Samples]:
    """A function of floats, number by number: the bits of NumPy's own functions depend on the place in an array."""

    def run(*given: Any) -> Samples:
        return Samples(
            np.array([function(*x) for x in zip(*np.broadcast_arrays(*map(_array, given)), strict=True)], F8)
        )

    return run


def _select(x: Samples, positive: Any, otherwise: Any) -> Samples:
    return Samples(np.where(x.x > 0.0, _array(positive), _array(otherwise)))


def _repeat(cap: int, x: Any, carried: regions.Carried) -> Iterator[None]:
    """A region of ``algebra.regions``: samples that have finished keep their values."""
    for k in range(cap):
        runs = _array(x if k == 0 else carried.left[0]) > 0.0
        if not np.any(runs):
            return
        before = carried.get()
        yield
        after = carried.get()
        carried.put(a if a is b else _chosen(runs, a, b) for a, b in zip(after, before, strict=True))


def _chosen(runs: Any, after: Any, before: Any) -> Samples:
    return Samples(np.where(runs, _array(after), _array(before)))


def _bilinear(x: Any, y: Any, rows: Any, first: int) -> tuple[Samples, ...]:
    x, y = np.broadcast_arrays(_array(x), _array(y))
    found = np.array([heights.bilinear(*at, rows, first) for at in zip(x.tolist(), y.tolist(), strict=True)], F8)
    return tuple(map(Samples, found.T))


for _function in (scalars.sin, scalars.cos, scalars.exp, scalars.atan2):
    _function.register(Samples)(_each(_function.dispatch(float)))
scalars.sqrt.register(Samples)(lambda x: Samples(np.sqrt(x.x)))
scalars.select.register(Samples)(_select)
regions.settled.register(Samples)(lambda x: False)
heights.bilinear.register(Samples)(_bilinear)


class Rows(Sequence[Any]):
    """The rows of a static table, made when they are read: of a ground of 10 000 heights a point reads four."""

    def __init__(self, static: StaticTable) -> None:
        self._records = static.rows
        self._read: dict[int, Any] = {}

    def __len__(self) -> int:
        return len(self._records)

    def __getitem__(self, k: Any) -> Any:
        if k not in self._read:
            self._read[k] = table(self._records[k : k + 1], F8)[0]
        return self._read[k]


class Evaluation:
    """A call on a table of bodies and values of the static inputs; the call may branch on values.

    parameters  the parameters of the table whose values vary by sample
    """

    def __init__(
        self, spec: Spec, bodies: NDArray[Any], static: Sequence[Any], parameters: Sequence[Parameter] = ()
    ) -> None:
        """Set up the call; only with mimic joints may the norms be any that the table allows, else they must be 1."""
        self._spec, self._bodies, self._parameters = spec, bodies, parameters
        self._varying = [x for x in spec.present if not x.static]
        self._shapes = [shape_of(x, bodies, static) for x in self._varying]
        self._shape = shape_of(spec.output, bodies, static)
        known = [Rows(x) if isinstance(x, StaticTable) else x for x in static]
        self._static: dict[str, Any] = dict(zip((x.name for x in spec.present if x.static), known, strict=True))
        own = independent(bodies)
        self._kind = bodies[0]["kind"] if len(own) < len(bodies) else 0  # mimic joints have no table kernel
        self._units = [] if self._kind == ANY_NORM else unit_parts(own)
        self._together = traces(spec, bodies) and self._kind != ANY_NORM  # with ANY_NORM recursions branch on the norm

    def __call__(
        self,
        inputs: Sequence[NDArray[np.float64]],
        out: NDArray[np.float64],
        status: NDArray[np.int8],
        values: Sequence[NDArray[np.float64]] = (),
    ) -> None:
        """Compute samples; results and their status, as of a table kernel, are written in place.

        inputs  each (n, ...), or (1, ...) for all samples
        out     (n, columns)
        values  of the parameters, likewise
        """
        n, count = len(out), MOST if self._together else 1
        for first in range(0, n, count):
            here = slice(first, first + count)
            part, with_values = ([x[here] if len(x) == n else x for x in of] for of in (inputs, values))
            given = part, out[here], status[here], with_values
            with np.errstate(all="ignore"):
                if not self._together or len(given[1]) == 1:  # floats are faster
                    try:
                        self._part(*given, wrapped=False)
                        continue
                    except ZeroDivisionError:  # from Python's own floats, such as cosines
                        if not self._together:
                            raise
                self._part(*given, wrapped=True)

    def _part(
        self, inputs: Sequence[Any], out: NDArray[np.float64], status: NDArray[np.int8], values: Sequence[Any],
        wrapped: bool,
    ) -> None:  # fmt: skip
        n = len(out)
        given: dict[str, Any] = dict(self._static)
        for x, shape, value in zip(self._varying, self._shapes, inputs, strict=True):
            numbers = _columns(value, n, wrapped)
            given[x.name] = numbers.reshape(shape) if x.shape else numbers[0]
        tree = table(self._bodies, F8)
        vars(tree[0])["kind"] = self._kind
        taken = parameters.withdraw(tree, self._parameters)
        parameters.put(tree, self._parameters, [_columns(x, n, wrapped).tolist() for x in values], taken)
        rows = rows_of(tree)
        pivots = np.zeros(len(rows) - 1, object)
        with regions.running(_repeat) if wrapped else nullcontext():
            found = evaluate(self._spec, rows, self._shape, given, pivots, 0.0).ravel()
        for k, x in enumerate(found):
            out[:, k] = _array(x)
        status[:] = np.where(np.isfinite(out).all(axis=1), OK, NONFINITE)
        status[self._off_norm(self._spec.output, found, n)] = UNIT
        if self._spec.pivots:
            for margin, least in pivot_margins(rows, given["q"], pivots):
                status[np.broadcast_to(~(np.asarray(_array(margin), F8) > least), n)] = PIVOT
        for x in self._varying:
            status[self._off_norm(x, given[x.name], n)] = UNIT

    def _off_norm(self, argument: Argument, numbers: Any, n: int) -> NDArray[np.bool_]:
        """Whether a quaternion or pair is off its unit norm in each sample; one with a NaN is not."""
        found = np.zeros(n, np.bool_)
        for part in self._units if argument.unit_norm else ():
            found |= abs(sum(np.square(_array(numbers[k])) for k in part) - 1.0) > UNIT_TOLERANCE
        return found


def _columns(values: NDArray[np.float64], n: int, wrapped: bool) -> NDArray[Any]:
    """The entries of an input (n or 1, ...) in order: Samples, or floats if there is one sample."""
    flat = values.reshape((len(values), -1))
    made = np.empty(flat.shape[1], object)
    for k in range(len(made)):
        made[k] = Samples(np.ascontiguousarray(np.broadcast_to(flat[:, k], n))) if wrapped else flat[0, k]
    return made
