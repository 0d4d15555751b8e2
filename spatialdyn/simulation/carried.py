"""States that a run carries beside q and v: bristles of friction, a control law's own states, the work of each kind.

A state with a rate goes through the methods of ``explicit`` beside v: they move w = (v, states) by its derivative, so
it has the order of the method. Others change at the end of a step. The step is one source for recorded numbers and for
floats, as the methods are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_array, core_shape
from ..errors import NonFiniteError, ShapeError, SimulationError
from ..model.model import Model
from ..recursions.spec import Argument
from . import works
from .control_laws import OWN_INPUT
from .system import State, System

Array = NDArray[Any]
HIDDEN = ("violation", "contact_residual", "contact_record")  # states that a caller does not see
Power = Mapping[str, Any]


@dataclass(frozen=True)
class Carried:
    """The states of a run.

    arguments  of each, as a step names them, in the order in which they lie side by side
    shapes     of each
    starts     (samples or 1, entries) of each, flat
    """

    arguments: tuple[Argument, ...] = ()
    shapes: tuple[tuple[int, ...], ...] = ()
    starts: tuple[Array, ...] = field(default=(), repr=False)

    @property
    def names(self) -> list[str]:
        """Names of the states, as a caller knows them."""
        return [x.name.removeprefix(OWN_INPUT) for x in self.arguments]

    @property
    def slices(self) -> list[slice]:
        """Where each is in their row."""
        ends = np.cumsum([0, *(math.prod(x) for x in self.shapes)]).tolist()
        return [slice(a, b) for a, b in pairwise(ends)]

    @property
    def size(self) -> int:
        """Entries of all of them."""
        return sum(math.prod(x) for x in self.shapes)

    def views(self, row: Array) -> list[Array]:
        """The states (..., *shape) in rows (..., size)."""
        return [row[..., at].reshape(row.shape[:-1] + x) for at, x in zip(self.slices, self.shapes, strict=True)]

    def shown(self, row: Array) -> dict[str, Array]:
        """The states in rows (..., size) by name, but for those that are a run's own affair."""
        return {name: x for name, x in zip(self.names, self.views(row), strict=True) if name not in HIDDEN}


def carried(
    model: Model, arguments: Sequence[Argument], static: Sequence[Any], given: Any, samples: int | None = None
) -> Carried:
    """The states of a run, from the starts that are given, {name: array} or None, or from those of the arguments.

    samples  of a rollout, whose starts may have an axis of them

    Raises  SimulationError for two states of one name, and for a start of a state that there is none; ShapeError,
            NonFiniteError naming a start.
    """
    names = [x.name.removeprefix(OWN_INPUT) for x in arguments]
    if len(set(names)) < len(names):
        twice = next(name for k, name in enumerate(names) if name in names[:k])
        raise SimulationError(f"two states of the run are named {twice}, expected different names")
    if given is not None and not isinstance(given, Mapping):
        raise SimulationError(f"states are {given!r}, expected a dict of arrays by name")
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
    return Carried(tuple(arguments), shapes, tuple(starts))


# --- a step ---------------------------------------------------------------------------------------------


class Acting(NamedTuple):
    """What acts in a step that carries states.

    free        ``(system, q, v, a) -> status, powers``: writes the acceleration of all but the law; powers by name of
                states of work
    law         ``(q, v, tau, states) -> tau, made``: the control law, made are the rates or ends of its states; or None
    held        whether the law's torque is that of the beginning of the step
    integrated  names of the states that have rates
    """

    free: Callable[[System, Any, Any, Any], tuple[int, Power]]
    law: Callable[[Any, Any, Any, Power], tuple[Any, Power]] | None
    held: bool
    integrated: tuple[str, ...]


def carry(
    advance: Callable[..., None], system: System, t: Any, h: Any, state: State, own: Power, acting: Acting
) -> dict[str, Any]:
    """A step of a method of ``explicit``: moves q and w of the state, and returns the states after it, by name.

    own  the states at the beginning, by name
    """
    n, kernels, torque = len(state.w), system.kernels, system.torque
    ends, at = {}, {}
    begun = None
    if acting.law is not None:
        torque(system, t, state.q, state.w)
        begun, made = acting.law(state.q, state.w, system.tau, own)
        ends = {name: x for name, x in made.items() if name not in acting.integrated}
    size = n
    for name in acting.integrated:
        at[name] = slice(size, size + own[name].size)
        size = at[name].stop
    w = np.concatenate([state.w, *(own[name].ravel() for name in acting.integrated)])

    def states(w: Any) -> dict[str, Any]:
        return {**own, **{name: w[part].reshape(own[name].shape) for name, part in at.items()}}

    def accelerate(system: System, q: Any, w: Any, a: Any) -> int:
        v, tau = w[:n], system.tau
        rates: Power = {}
        if acting.law is not None:
            wanted, rates = acting.law(q, v, tau, states(w))
            tau = tau + (begun if acting.held else wanted)
        code, powers = acting.free(system._replace(tau=tau, kernels=kernels), q, v, a[:n])
        for name, part in at.items():
            a[part] = powers[name] if name in powers else rates[name]
        return code

    def moved(table: Any, q: Any, u: Any, out: Any) -> int:
        code: int = kernels.integrate(table, q, u[:n], out)
        return code

    def turning(table: Any, u: Any, w: Any, out: Any) -> int:
        code: int = kernels.displacement_rate(table, u[:n], w[:n], out[:n])
        return code

    def drive(system: System, t: float, q: Any, w: Any) -> None:
        torque(system, t, q, w[:n])

    wide = kernels._replace(accelerate=accelerate, integrate=moved, displacement_rate=turning)
    both = State(state.q, w, w, state.stage, None, np.zeros((10, size), w.dtype))
    advance(system._replace(kernels=wide, torque=drive), t, h, both)
    state.w[:] = w[:n]
    return {**states(w), **{name: x.reshape(own[name].shape) for name, x in ends.items()}}


def times(h: Any, x: Any) -> Any:
    """h x of an array: a recorded number times an array is none."""
    return np.array([h * y for y in x.flat], x.dtype).reshape(x.shape)


def carry_solved(
    solve: Callable[[Any], tuple[Any, dict[str, Any], Any]], h: Any, q: Any, v: Any, tau: Any, own: Power,
    acting: Acting,
) -> tuple[Any, dict[str, Any]]:  # fmt: skip
    """A step whose velocities are solved for with friction: v⁺, and the states after it, by name.

    solve  ``tau -> v⁺, friction's own states, forces`` that do work, by the names of their states of work: torques, or
           functions of the way h (v + v⁺)/2 that return the work

    A law acts by its torque at the beginning. An impulse h f that changes v to v⁺ does the work h f (v + v⁺)/2, which
    is exact for a constant mass matrix.
    """
    made: Power = {}
    if acting.law is not None:
        wanted, made = acting.law(q, v, tau, own)
        tau = tau + wanted
    after, solved, forces = solve(tau)
    found = {**own, **solved}
    for name, x in made.items():
        x = x.reshape(own[name].shape)
        found[name] = own[name] + times(h, x) if name in acting.integrated else x
    way = times(0.5 * h, v + after)
    for name, force in {works.TORQUE.name: tau, **forces}.items():
        if name in own:
            found[name] = own[name] + (force(way) if callable(force) else force * way)
    return after, found
