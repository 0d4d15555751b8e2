"""A program and its derivatives, in the form that JAX and PyTorch need."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..engines.programs.run import batch_kernels
from ..errors import SpatialDynError
from . import specialize_fallback
from .arguments import aligned, broadcast

if TYPE_CHECKING:
    from ..engines.programs.run.xla_handler import Registered

MOST_ORDER = 2  # highest order of a derivative: each order has about three times the operations of the previous order


class Node:
    """The results of a program, or a derivative of them, as a function of arrays whose leading axes are equal or 1.

    directions  number of directions of the derivative; if 0 and not weighted, the node computes the results themselves
    weighted    whether the node differentiates Σ weight · result with respect to each input, or the results
    inputs      names: the program's inputs, their tangents in each direction, weights if weighted, then known results
    cores       shape of one sample of each input
    results     shape of one sample of each result
    hinted      whether the last inputs are the program's results, known from an earlier call
    groups      slices of the inputs: the program's inputs, tangents of each direction, weights, known results

    Derivatives are symmetric in their directions, and linear in each direction and in the weights.
    """

    def __init__(self, made: Differentiable, directions: int, weighted: bool) -> None:
        """The node of a program; derivatives are recorded and compiled at first use."""
        self.made, self.directions, self.weighted = made, directions, weighted
        request = made.request_of(directions, weighted)
        self.inputs, self.cores = [x.name for x in request.inputs()], [x.shape for x in request.inputs()]
        self.results, self.hinted = [x.shape for x in request.results()], request.takes_results
        self.name = made.name + "".join(["_along"] * directions + ["_weighted"] * weighted)
        self._handlers: dict[Any, Registered] = {}

    @cached_property
    def program(self) -> Any:
        """The Specialized that computes this node. Raises SpatialDynError if there is no program."""
        return self.made.program_of(self.directions, self.weighted)

    @cached_property
    def groups(self) -> list[slice]:
        """Slices of the inputs: the program's inputs, tangents of each direction, weights, known results."""
        n, m = len(self.made.names), len(self.made.results)
        sizes = [n] * (self.directions + 1) + [m] * (self.weighted + self.hinted)
        return [slice(a, b) for a, b in pairwise(accumulate(sizes, initial=0))]

    def along(self, k: int, arrays: Sequence[Any], results: Sequence[Any], rates: Sequence[Any]) -> tuple[Node, Any]:
        """The derivative of the results along rates of the inputs of group k: a node and its inputs."""
        own, weights, _ = parts = self._parts(arrays)
        if k:
            groups = [*own, *filter(None, parts[1:])]
            return self, _flat([*groups[:k], rates, *groups[k + 1 :]])
        further = self.made.node(self.directions + 1, self.weighted)
        return further, _flat([*own, rates, weights, results if further.hinted else []])

    def back(self, k: int, arrays: Sequence[Any], results: Sequence[Any], seeds: Sequence[Any]) -> tuple[Node, Any]:
        """The derivative of Σ seed · result with respect to the inputs of group k: a node and its inputs."""
        own, weights, known = self._parts(arrays)
        n, node = self.directions, self.made.node
        if k > n:  # linear in the weights
            return node(n + 1, False), _flat([*own, seeds, known])
        if self.weighted:  # a direction and the input of differentiation may change places
            return (self, _flat([*own[:k], seeds, *own[k + 1 :], weights, known])) if k else (
                node(n + 1, True), _flat([*own, seeds, weights])
            )  # fmt: skip
        if k:
            return node(n - 1, True), _flat([*own[:k], *own[k + 1 :], seeds, known])
        further = node(n, True)
        return further, _flat([*own, seeds, results if further.hinted else []])

    def _parts(self, arrays: Sequence[Any]) -> tuple[list[list[Any]], list[Any], list[Any]]:
        """The inputs of the program and of each direction; the weights; known results."""
        found = [list(arrays[group]) for group in self.groups]
        n = self.directions + 1
        return found[:n], found[n] if self.weighted else [], found[-1] if self.hinted else []

    @property
    def key(self) -> str:
        """A text that names everything that the node's program depends on."""
        request = self.made.request_of(self.directions, self.weighted)
        static = tuple(request.static.values())
        named = request.specs, request.model.key, static, request.dtype, request.options
        digest = batch_kernels.name_of(*named, lambda: self.program._recorded)
        return "\n".join((digest, request.model.name, *request.model.names))

    def lead(self, shapes: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
        """The leading axes of the results for inputs of these shapes."""
        leads = [tuple(shape[: len(shape) - len(core)]) for shape, core in zip(shapes, self.cores, strict=True)]
        return broadcast(self.inputs, leads)

    def shapes(self, shapes: Sequence[tuple[int, ...]]) -> list[tuple[int, ...]]:
        """The shapes of the results for inputs of these shapes."""
        lead = self.lead(shapes)
        return [(*lead, *core) for core in self.results]

    def compute(self, inputs: Sequence[NDArray[Any]], dtype: Any) -> list[NDArray[Any]]:
        """The results in a dtype. Raises SpatialDynError for a number beyond the range of float32."""
        found = self.program(*inputs)
        results = [np.asarray(x) for x in (found if isinstance(found, tuple) else (found,))]
        if np.dtype(dtype) == results[0].dtype:
            return results
        with np.errstate(over="ignore"):
            narrow = [x.astype(dtype) for x in results]
        if any((np.isinf(y) & np.isfinite(x)).any() for x, y in zip(results, narrow, strict=True)):
            has = f"a result of {self.name} is beyond the range of {np.dtype(dtype)}"
            raise SpatialDynError(f"{has}, expected inputs of {results[0].dtype}")
        return narrow

    def handler(self, dtype: Any) -> Registered | None:
        """The function that XLA calls for arrays of a dtype.

        Returns None if not applicable: if there is no compiled program, or for float64 inputs of a float32 program,
        since they may be beyond its range.
        """
        from ..engines.programs.run import xla_handler

        k, dtype = self.program, np.dtype(dtype)
        if k._kernel is None or dtype.itemsize > k.dtype.itemsize or not self.cores:
            return None
        if dtype not in self._handlers:
            request = k._request
            inputs, shapes = list(zip(k._inputs, self.cores, strict=True)), self.cores

            def recompute(given: Any, found: Any, batch: Any, samples: Any) -> None:
                rows = [x.reshape(len(x), *(core or (1,))) for x, (_, core) in zip(given, inputs, strict=True)]
                arrays = [x for x, _ in inputs]
                specialize_fallback.compute(request, arrays, rows, found, batch, samples, seen=False)

            made = xla_handler.registered(self.key, k._kernel, shapes, self.results, dtype, recompute)
            self._handlers[dtype] = made
        return self._handlers[dtype]


def _flat(parts: Sequence[Sequence[Any]]) -> list[Any]:
    return [x for part in parts for x in part]


class Differentiable:
    """A Specialized and its derivatives with respect to the entries of its inputs.

    name     names of the calls
    text     signature
    names    names of the inputs
    cores    shape of one sample of each input
    results  shape of one sample of each result
    several  whether the results are a tuple
    """

    def __init__(
        self,
        program: Any,
        text: str,
        request_of: Callable[[int, bool], Any],
        derivative: Callable[[int, bool], Any],
    ) -> None:
        """``request_of`` and ``derivative`` map (directions, weighted) to a derivative's request and its program."""
        request = request_of(0, False)
        self._program, self._derivative, self.request_of, self.text = program, derivative, request_of, text
        self.name = "_".join(spec.name for spec in request.specs)
        self.names, self.cores = [x.name for x in request.inputs()], [x.shape for x in request.inputs()]
        self.results, self.several = [x.shape for x in request.results()], request.several
        self._nodes: dict[tuple[int, bool], Node] = {}

    def aligned(self, shapes: Sequence[tuple[int, ...]]) -> list[tuple[int, ...]]:
        """``arguments.aligned`` for the inputs of the program."""
        return aligned(self.names, self.cores, shapes)

    def node(self, directions: int = 0, weighted: bool = False) -> Node:
        """The results, or a derivative of them. Raises SpatialDynError for an order above MOST_ORDER."""
        if directions + weighted > MOST_ORDER:
            raise SpatialDynError(f"a third derivative of {self.name} is not available, expected first and second ones")
        key = directions, bool(weighted)
        if key not in self._nodes:
            self._nodes[key] = Node(self, *key)
        return self._nodes[key]

    def program_of(self, directions: int, weighted: bool) -> Any:
        """The Specialized of a node."""
        return self._derivative(directions, weighted) if directions or weighted else self._program
