"""``Plan``: what a run is made of, from its scene, method and control law, for all that runs it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import core_shape
from ..model.model import Model
from ..recursions.spec import Argument
from .effects import work
from .effects.constraints import Constrained
from .effects.contacts import Contact
from .effects.control import Feedback
from .effects.effect import Effect, find
from .methods.methods import EXPLICIT_METHODS, SCIPY_METHODS
from .scene import Scene

Array = NDArray[Any]
Force = Callable[[float, Array, Array], Array]


@dataclass(frozen=True, eq=False)
class Plan:
    """A run.

    scene    what acts
    method   name of the method
    effects  what acts in this run, its control law among them
    works    whether work is recorded
    force    external forces of a run that are a function of (t, q, v); their effect holds its last value
    """

    scene: Scene
    method: str
    effects: tuple[Effect, ...]
    works: bool = False
    force: Force | None = None

    @property
    def model(self) -> Model:
        """Of the scene."""
        return self.scene.model

    @cached_property
    def feedback(self) -> Feedback | None:
        """The control law."""
        found: Feedback | None = find(self.effects, Feedback)
        return found

    @cached_property
    def constrained(self) -> Constrained | None:
        """The constraints."""
        found: Constrained | None = find(self.effects, Constrained)
        return found

    @cached_property
    def contact(self) -> Contact | None:
        """What acts by impulses."""
        found: Contact | None = find(self.effects, Contact)
        return found

    @property
    def work(self) -> tuple[Argument, ...]:
        """The states of the work that is recorded. Symplectic methods integrate no work of constraints: it is 0."""
        if not self.works:
            return ()
        found = [x.work for x in self.effects if x.work is not None]
        if self.constrained is not None and self.method not in (*EXPLICIT_METHODS, *SCIPY_METHODS):
            found.remove(work.CONSTRAINTS)
        elif self.constrained is not None and self.constrained.projects:
            found.append(work.PROJECTION)
        return (work.TORQUE, *found)

    @cached_property
    def states(self) -> tuple[Argument, ...]:
        """The states that the run carries beside q and v."""
        return (*(x for effect in self.effects for x in effect.states), *self.work)

    @cached_property
    def tables(self) -> tuple[Any, ...]:
        """Static inputs of a step, in their order."""
        return tuple(x for effect in self.effects for x in effect.tables)

    @cached_property
    def values(self) -> dict[str, Array]:
        """(samples or 1, steps or 1, columns) of the other inputs, in their order, but for dt and tau."""
        return {name: x for effect in self.effects for name, x in effect.values.items()}

    @cached_property
    def structure(self) -> tuple[Effect, ...]:
        """The effects without large values: keys of caches."""
        return tuple(x.structure() for x in self.effects)

    @cached_property
    def bare(self) -> bool:
        """Whether nothing acts but torques and constant forces, so that a loop may be compiled as it is."""
        return self.force is None and not self.works and all(x.work is work.EXTERNAL for x in self.effects)

    @cached_property
    def _cores(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the inputs that are no tables."""
        tables = [x for x in self.tables if hasattr(x, "sizes")]
        found = (x for effect in self.effects for x in effect.inputs if x.name in self.values)
        return {x.name: core_shape(self.model, x, tables) for x in found}

    def given(self, sample: int, step: int) -> dict[str, Any]:
        """The inputs of one step of one sample, by name."""
        made: dict[str, Any] = {}
        for name, x in self.values.items():
            row = x[min(sample, len(x) - 1), min(step, x.shape[1] - 1)].reshape(self._cores[name])
            made[name] = row if self._cores[name] else float(row)
        static = (x for effect in self.effects for x in effect.inputs if x.static)
        return made | dict(zip((x.name for x in static), self.tables, strict=True))

    def failure(self, states: dict[str, Array], dt: float, t: float) -> str:
        """What is wrong with the steps until t, by states (flat) after them; "" if nothing is."""
        return next((found for x in self.effects if (found := x.failure(states, dt, t))), "")


def forces_of(scene: Scene, fext: Any) -> Any:
    """Rows (samples or 1, steps or 1, 6 njoints) of forces (..., njoints, 6) of scene and run, None for none."""
    if fext is None and scene.fext is None:
        return None
    if fext is None:
        return np.ascontiguousarray(scene.fext).reshape((1, 1, -1))
    rows = np.array(fext, float) if scene.fext is None else fext + scene.fext
    return rows.reshape((1,) * (4 - rows.ndim) + rows.shape[:-2] + (-1,))
