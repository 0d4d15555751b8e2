"""Reductions of samples that are too many to keep: states of chunks that merge to the state of the whole study.

A reduction is any object with three methods, whose state is a dict of arrays:

    of(arrays, first)  the state of the arrays that a chunk's function returned; ``first`` numbers its first sample
    merge(a, b)        the state of two states, with the samples of a before those of b
    finish(state)      the result

States are merged in the order of chunks, so a result does not depend on which chunk was done first. Source: moments by
T. Chan, G. Golub, R. LeVeque, "Updating formulae and a pairwise algorithm for computing sample variances" (1979).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_finite, as_flag
from ..errors import StudyError, literal

Array = NDArray[Any]
State = dict[str, Array]
MANTISSA = 52  # bits of a float64
MOST_BITS = 20
MOST = 2**62  # samples


class Reduction(Protocol):
    """The protocol of the argument ``reduce`` of a study."""

    def of(self, arrays: Mapping[str, Array], first: int) -> State:
        """The state of a chunk."""

    def merge(self, a: State, b: State) -> State:
        """The state of the samples of a, followed by those of b."""

    def finish(self, state: State) -> Any:
        """The result."""


class Statistics(NamedTuple):
    """Moments of an output of N samples: numbers of its shape.

    samples          N
    mean, variance   of the samples; the variance is the mean of (x - mean)²
    least, greatest  the extremes
    """

    samples: int
    mean: Array
    variance: Array
    least: Array
    greatest: Array

    @property
    def std(self) -> Array:
        """The standard deviation."""
        return np.sqrt(self.variance)


@dataclass(frozen=True)
class Moments:
    """The mean, the variance and the extremes of an output of any shape.

    output  name of an array (n, ...) that the study's function returns

    The result is a ``Statistics``. Raises StudyError for values that are not finite.

    >>> import numpy as np
    >>> import spatialdyn as sd
    >>> r = sd.Moments("x")
    >>> parts = [r.of({"x": np.array(x)}, 0) for x in ([1.0, 2.0], [6.0])]
    >>> float(r.finish(r.merge(*parts)).mean)
    3.0
    """

    output: str

    def __post_init__(self) -> None:
        names_of("output", [self.output])

    def of(self, arrays: Mapping[str, Array], first: int) -> State:
        """The state of a chunk."""
        x = numbers(arrays, self.output, first)
        mean = x.mean(axis=0)
        return {
            "count": np.array(len(x)), "mean": mean, "squares": ((x - mean) ** 2).sum(axis=0),
            "least": x.min(axis=0), "greatest": x.max(axis=0),
        }  # fmt: skip

    def merge(self, a: State, b: State) -> State:
        """Of both."""
        _check(("count", "mean", "squares", "least", "greatest"), a, b)
        n, m = a["count"], b["count"]
        change = b["mean"] - a["mean"]
        return {
            "count": n + m,
            "mean": a["mean"] + change * (m / (n + m)),
            "squares": a["squares"] + b["squares"] + change**2 * (n * (m / (n + m))),
            "least": np.minimum(a["least"], b["least"]),
            "greatest": np.maximum(a["greatest"], b["greatest"]),
        }

    def finish(self, state: State) -> Statistics:
        """The ``Statistics``."""
        _check(("count", "mean", "squares", "least", "greatest"), state)
        count = int(state["count"])
        return Statistics(count, state["mean"], np.asarray(state["squares"] / count), state["least"], state["greatest"])


@dataclass(frozen=True)
class Quantiles:
    """Quantiles of an output of any shape, to a relative error, in memory that does not grow with the samples.

    output  name of an array (n, ...) that the study's function returns
    at      quantiles, each in [0, 1]: the least sample that this part of the samples does not exceed
    bits    bits of the mantissa that distinguish samples: the error is 2^-(bits+1) of the value, .05 % by default

    Samples are counted by sign, exponent and first bits of the mantissa, so counts of chunks add in any order. The
    result is (len(at), ...). Raises StudyError for values that are not finite.

    >>> import numpy as np
    >>> import spatialdyn as sd
    >>> r = sd.Quantiles("x", (0.5, 0.99))
    >>> r.finish(r.of({"x": np.arange(1.0, 1001.0)}, 0)).round()
    array([500., 990.])
    """

    output: str
    at: tuple[float, ...] = (0.01, 0.05, 0.5, 0.95, 0.99)
    bits: int = 10

    def __post_init__(self) -> None:
        names_of("output", [self.output])
        at = np.atleast_1d(as_finite("at", self.at))
        if at.ndim > 1 or not len(at) or not ((at >= 0.0) & (at <= 1.0)).all():
            raise StudyError(f"at is {literal(self.at)}, expected quantiles in [0, 1]")
        object.__setattr__(self, "at", tuple(at.tolist()))
        if not is_whole(self.bits, 1) or self.bits > MOST_BITS:
            raise StudyError(f"bits is {literal(self.bits)}, expected 1 to {MOST_BITS}")

    def of(self, arrays: Mapping[str, Array], first: int) -> State:
        """The state of a chunk."""
        x = numbers(arrays, self.output, first)
        flat = np.ascontiguousarray(x.reshape(len(x), -1))
        size = flat.view(np.int64) & np.int64(2**63 - 1)
        code = np.where(flat < 0.0, -1, 1) * (size >> (MANTISSA - self.bits))
        found = [np.unique(x, return_counts=True) for x in code.T]  # half the time of a sort by both keys
        column = np.repeat(np.arange(len(found)), [len(codes) for codes, _ in found])
        codes, counts = (np.concatenate([np.empty(0, np.int64), *(x[k] for x in found)]) for k in (0, 1))
        return {"column": column, "code": codes, "shape": np.array(x.shape[1:], int), "count": counts}

    def merge(self, a: State, b: State) -> State:
        """Of both."""
        _check(("column", "code", "count", "shape"), a, b)
        column, code, count = (np.concatenate([a[name], b[name]]) for name in ("column", "code", "count"))
        return self._counted(column, code, count, a["shape"])

    @staticmethod
    def _counted(column: Array, code: Array, count: Array, shape: Array) -> State:
        """The state with the codes of each column in order, without repetition."""
        order = np.lexsort((code, column))
        column, code, count = column[order], code[order], count[order]
        new = np.ones(len(code), np.bool_)
        new[1:] = (column[1:] != column[:-1]) | (code[1:] != code[:-1])
        return {
            "column": column[new], "code": code[new], "shape": shape,
            "count": np.add.reduceat(count, np.flatnonzero(new)) if len(count) else count,
        }  # fmt: skip

    def finish(self, state: State) -> Array:
        """The quantiles (len(at), ...)."""
        _check(("column", "code", "count", "shape"), state)
        shape = tuple(int(k) for k in state["shape"])
        made = np.empty((len(self.at), int(np.prod(shape))))
        for k in range(made.shape[1]):
            here = state["column"] == k
            counts, codes = np.cumsum(state["count"][here]), state["code"][here]
            rank = np.clip(np.ceil(np.array(self.at) * counts[-1]), 1, counts[-1])
            made[:, k] = self._value(codes[np.searchsorted(counts, rank)])
        return made.reshape((len(self.at), *shape))

    def _value(self, code: Array) -> Array:
        """The middle of a code's samples."""
        shift = MANTISSA - self.bits
        low = (np.abs(code) << shift).view(np.float64)
        high = ((np.abs(code) + 1) << shift).view(np.float64)
        return np.sign(code) * np.where(np.isfinite(high), low + 0.5 * (high - low), low)


class Extremes(NamedTuple):
    """The samples with the largest, or smallest, values of an output: the worst first; k of them.

    value   (k,)
    sample  (k,)  numbers of the samples in the study: sample // chunk is the chunk that draws the sample again
    beside  by name, (k, ...) each: other outputs of the function for these samples
    """

    value: Array
    sample: Array
    beside: dict[str, Array]


@dataclass(frozen=True)
class Worst:
    """The samples with the largest values of an output (n,), with other outputs of these samples.

    output   name of an array (n,) that the study's function returns
    count    how many samples are kept
    beside   names of other arrays (n, ...), such as inputs, whose rows are kept for these samples
    least    whether to keep the samples with the smallest values instead

    The result is an ``Extremes``; of equal values the earlier sample comes first. Raises StudyError for values that are
    not finite, and for an output that is not one number per sample.

    >>> import numpy as np
    >>> import spatialdyn as sd
    >>> r = sd.Worst("miss", 1, ("q",))
    >>> worst = r.finish(r.of({"miss": np.array([1.0, 7.0, 3.0]), "q": np.eye(3)}, 100))
    >>> worst.value, worst.sample, worst.beside["q"]
    (array([7.]), array([101]), array([[0., 1., 0.]]))
    """

    output: str
    count: int = 10
    beside: tuple[str, ...] = ()
    least: bool = False

    def __post_init__(self) -> None:
        names_of("output", [self.output])
        object.__setattr__(self, "beside", names_of("beside", self.beside))
        object.__setattr__(self, "least", as_flag("least", self.least))
        if not is_whole(self.count, 1):
            raise StudyError(f"count is {literal(self.count)}, expected a number of samples, at least 1")

    def of(self, arrays: Mapping[str, Array], first: int) -> State:
        """The state of a chunk."""
        x = numbers(arrays, self.output, first)
        if x.ndim != 1:
            raise StudyError(f"{self.output} has shape {x.shape}, expected (n,): one number a sample to order them by")
        made = {"value": x, "sample": first + np.arange(len(x))}
        return self._first({**made, **{f"beside {name}": array_of(arrays, name) for name in self.beside}})

    def merge(self, a: State, b: State) -> State:
        """Of both."""
        _check(("value", "sample"), a, b)
        return self._first({name: np.concatenate([a[name], b[name]]) for name in a})

    def _first(self, state: State) -> State:
        order = np.lexsort((state["sample"], state["value"] if self.least else -state["value"]))[: self.count]
        return {name: x[order] for name, x in state.items()}

    def finish(self, state: State) -> Extremes:
        """The ``Extremes``."""
        _check(("value", "sample"), state)
        return Extremes(state["value"], state["sample"], {name: state[f"beside {name}"] for name in self.beside})


@dataclass(frozen=True)
class TallQR:
    """R of the QR factors of all rows of an output: least squares of data that do not fit in memory.

    output  name of an array (n, c), or (n, m, c) for m rows per sample, that the study's function returns

    R (c, c) is upper triangular, its diagonal is not negative, and RᵀR is the sum of the rows' squares; with the
    right-hand side as the last column, R[:-1, :-1] x = R[:-1, -1] gives the least-squares solution and |R[-1, -1]| is
    the norm of the residual. Raises StudyError for values that are not finite.

    >>> import numpy as np
    >>> import spatialdyn as sd
    >>> r = sd.TallQR("rows")
    >>> r.finish(r.of({"rows": np.array([[3.0, 0.0], [4.0, 5.0]])}, 0)).round(12)
    array([[5., 4.],
           [0., 3.]])
    """

    output: str

    def __post_init__(self) -> None:
        names_of("output", [self.output])

    def of(self, arrays: Mapping[str, Array], first: int) -> State:
        """The state of a chunk."""
        x = numbers(arrays, self.output, first)
        if x.ndim < 2:
            raise StudyError(f"{self.output} has shape {x.shape}, expected (n, c) or (n, m, c): rows of c numbers")
        return {"R": _triangle(x.reshape((-1, x.shape[-1])))}

    def merge(self, a: State, b: State) -> State:
        """Of both."""
        _check(("R",), a, b)
        return {"R": _triangle(np.concatenate([a["R"], b["R"]]))}

    def finish(self, state: State) -> Array:
        """R (c, c)."""
        _check(("R",), state)
        return state["R"]


def _triangle(rows: Array) -> Array:
    """R (c, c) with a diagonal that is not negative."""
    c = rows.shape[1]
    R: Array = np.asarray(np.linalg.qr(rows, mode="r"))
    R = np.concatenate([R, np.zeros((c - len(R), c))]) if len(R) < c else R
    made: Array = R * np.where(np.diag(R) < 0.0, -1.0, 1.0)[:, None]
    return made


def names_of(what: str, given: Any) -> tuple[str, ...]:
    """Names of outputs, or one name, as a tuple. Raises StudyError."""
    names = (given,) if isinstance(given, str) else given
    if not isinstance(names, (tuple, list)) or not all(isinstance(x, str) and x for x in names):
        raise StudyError(f"{what} is {literal(given)}, expected names of outputs")
    return tuple(names)


def is_whole(x: Any, least: int) -> bool:
    """Whether it is an integer from ``least`` to MOST."""
    return isinstance(x, (int, np.integer)) and not isinstance(x, bool) and least <= int(x) <= MOST


def _check(names: tuple[str, ...], *states: Any) -> None:
    """Raise StudyError unless all are states: dicts with arrays of these names."""
    for x in states:
        if not isinstance(x, dict) or not all(isinstance(x.get(name), (np.ndarray, np.generic)) for name in names):
            raise StudyError(f"a state is {literal(x)}, expected what of() or merge() returned")


def array_of(arrays: Mapping[str, Array], name: str) -> Array:
    """An output by name. Raises StudyError."""
    if name not in arrays:
        raise StudyError(f'the function returns no "{name}", expected one of {", ".join(arrays)}')
    return arrays[name]


def numbers(arrays: Mapping[str, Array], name: str, first: int) -> Array:
    """An output as finite float64. Raises StudyError that names a sample."""
    if not isinstance(arrays, Mapping):
        raise StudyError(f"arrays is {literal(arrays)}, expected a dict of arrays (n, ...)")
    if not is_whole(first, 0):
        raise StudyError(f"first is {literal(first)}, expected the number of a sample")
    given = np.asarray(array_of(arrays, name))
    if given.dtype.kind not in "fiub":
        raise StudyError(f"{name} has dtype {given.dtype}, expected real numbers")
    x = given.astype(np.float64, copy=False)
    if not np.isfinite(x).all():
        bad = np.flatnonzero(~np.isfinite(x).reshape((len(x), -1)).all(axis=1))
        raise StudyError(f"{name} is not finite in {len(bad)} of {len(x)} samples, the first is {first + bad[0]}")
    return x


def reductions_of(reduce: Any) -> dict[str, Reduction]:
    """The reductions of the argument ``reduce`` by label. Raises StudyError."""
    if reduce is None:
        return {}
    given = reduce if isinstance(reduce, Mapping) else {getattr(reduce, "output", "result"): reduce}
    for label, one in given.items():
        if not isinstance(label, str) or not label or "/" in label:
            raise StudyError(f"reduce has the label {literal(label)}, expected a name without a slash")
        lacks = [name for name in ("of", "merge", "finish") if not callable(getattr(one, name, None))]
        if lacks or isinstance(one, type):
            raise StudyError(f'reduce of "{label}" is {literal(one)}, expected a reduction such as sd.Moments("tau")')
    return dict(given)


def merged(reduction: Reduction, states: Sequence[State]) -> State:
    """The merged state of chunks, in order."""
    whole = states[0]
    for state in states[1:]:
        whole = reduction.merge(whole, state)
    return whole
