"""A program with its gradients, as frameworks that differentiate ask for both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arguments import aligned
from .specialize_request import SpecializeRequest


class Differentiable:
    """A Specialized, and the derivatives of a weighted sum of its results by each entry of its inputs.

    name     of its calls
    text     its signature
    names    of the inputs
    cores    shape of one sample of each input
    results  shape of one sample of each result
    several  whether it returns a tuple
    """

    def __init__(
        self,
        request: SpecializeRequest,
        text: str,
        plain: Callable[..., Any],
        backward: Callable[..., Any],
        along: Callable[[], Callable[..., Any]],
    ) -> None:
        """``plain`` computes the results, ``backward`` of inputs and weights the results and derivatives, what
        ``along()`` makes of inputs and tangents.
        """
        self._plain, self._backward, self._along, self.text = plain, backward, along, text
        self.name = "_".join(spec.name for spec in request.specs)
        self.names, self.cores = [x.name for x in request.inputs()], [x.shape for x in request.inputs()]
        self.results, self.several = [x.shape for x in request.results()], request.several

    def aligned(self, shapes: Sequence[tuple[int, ...]]) -> list[tuple[int, ...]]:
        """``arguments.aligned`` of the inputs."""
        return aligned(self.names, self.cores, shapes)

    def shapes(self, shapes: Sequence[tuple[int, ...]]) -> list[tuple[int, ...]]:
        """The shapes of the results for inputs of these aligned shapes."""
        leads = [shape[: len(shape) - len(core)] for shape, core in zip(shapes, self.cores, strict=True)]
        return [(*np.broadcast_shapes(*leads), *core) for core in self.results]

    def values(self, inputs: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
        """The results."""
        found = self._plain(*inputs)
        return [np.asarray(x) for x in (found if self.several else (found,))]

    def gradients(self, inputs: Sequence[NDArray[Any]], weights: Sequence[NDArray[Any]]) -> list[NDArray[np.float64]]:
        """The derivatives of Σ weight · result by each input, in its shape: summed over samples that share it."""
        found = self._backward(*inputs, *weights)[len(self.results) :]
        summed = []
        for x, given, core in zip(found, inputs, self.cores, strict=True):
            shared = tuple(k for k in range(given.ndim - len(core)) if given.shape[k] == 1)
            summed.append(np.asarray(x).sum(axis=shared, keepdims=True))
        return summed

    def tangents(self, inputs: Sequence[NDArray[Any]], along: Sequence[NDArray[Any]]) -> list[NDArray[np.float64]]:
        """The derivatives of the results along tangents of the inputs, each in the shape of its input."""
        found = self._along()(*inputs, *along)
        return [np.asarray(x) for x in found[len(self.results) :]]
