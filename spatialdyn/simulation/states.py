"""States that a run carries beside q and v: bristles of friction, states of a control law, the work of each kind."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_array, core_shape
from ..control.law_specs import own_name
from ..errors import NonFiniteError, ShapeError, SimulationError, literal
from ..model.model import Model
from ..recursions.spec import Argument

Array = NDArray[Any]
HIDDEN = ("violation", "contact_residual", "contact_record", "impulses_before")  # states that a caller does not see


@dataclass(frozen=True)
class RunStates:
    """The states of a run.

    arguments  the Argument of each state, named as in a step, in the order of their row
    shapes     the shape of each
    starts     (samples or 1, entries) for each, flat
    """

    arguments: tuple[Argument, ...] = ()
    shapes: tuple[tuple[int, ...], ...] = ()
    starts: tuple[Array, ...] = field(default=(), repr=False)

    @cached_property
    def names(self) -> list[str]:
        """Names of the states, as a caller knows them."""
        return [own_name(x.name) for x in self.arguments]

    @cached_property
    def slices(self) -> list[slice]:
        """The place of each state in their row."""
        ends = np.cumsum([0, *(math.prod(x) for x in self.shapes)]).tolist()
        return [slice(a, b) for a, b in pairwise(ends)]

    def views(self, row: Array) -> list[Array]:
        """The states (..., *shape) in rows (..., size)."""
        return [row[..., at].reshape(row.shape[:-1] + x) for at, x in zip(self.slices, self.shapes, strict=True)]

    def shown(self, row: Array) -> dict[str, Array]:
        """The states in rows (..., size) by name, without HIDDEN ones."""
        return self.named([row[..., at] for at in self.slices])

    def named(self, parts: Sequence[Any]) -> dict[str, Any]:
        """As ``shown``, from a list of states (..., entries), in the memory of any device."""
        each = zip(self.names, parts, self.shapes, strict=True)
        return {name: x.reshape((*x.shape[:-1], *shape)) for name, x, shape in each if name not in HIDDEN}


def run_states(
    model: Model, arguments: Sequence[Argument], static: Sequence[Any], given: Any, samples: int | None = None
) -> RunStates:
    """The states of a run, with the given starts {name: array} or None, or else the starts of the arguments.

    samples  number of samples of a rollout; its starts may have this axis

    Raises  SimulationError for two states of one name, and for a start of an unknown state; ShapeError, NonFiniteError
            naming a start.
    """
    names = [own_name(x.name) for x in arguments]
    if len(set(names)) < len(names):
        twice = next(name for k, name in enumerate(names) if name in names[:k])
        raise SimulationError(f"two states of the run are named {twice}, expected different names")
    if given is not None and not isinstance(given, Mapping):
        raise SimulationError(f"states are {literal(given)}, expected a dict of arrays by name")
    known = [name for name in names if name not in HIDDEN]
    for name in given or {}:
        if name not in known:
            listed = f"some of {', '.join(known)}" if known else "none: this run has no states beside q and v"
            raise SimulationError(f"states have {name}, expected {listed}")
    shapes = tuple(core_shape(model, x, static) for x in arguments)
    starts = []
    for name, x, shape in zip(names, arguments, shapes, strict=True):
        value = (given or {}).get(name)
        if value is None:
            starts.append(np.full((1, math.prod(shape)), x.start, np.float64))
            continue
        start = as_array(f"state {name}", value)
        single = start.shape == shape
        if not (single or (samples is not None and start.shape == (samples, *shape))):
            wanted = f"{shape}" if samples is None else f"{shape} or {(samples, *shape)}"
            raise ShapeError(f"state {name} has shape {start.shape}, expected {wanted}")
        if not np.isfinite(start).all():
            raise NonFiniteError(f"state {name} is {start.tolist()}, expected finite numbers")
        starts.append(start.reshape((1 if single else start.shape[0], -1)).copy())
    return RunStates(tuple(arguments), shapes, tuple(starts))
