"""The control law of a run as an effect; ``control.control`` has laws and their values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...control.control import Control
from ...control.law_specs import Law, begun_of, in_step, inputs_of, law_on, moved_states, states_of, static_rows
from ...errors import SimulationError
from ...model.model import Model
from ...recursions.spec import Spec
from ..arithmetic import Arithmetic
from ..methods.methods import EXPLICIT_METHODS, SCIPY_METHODS
from .effect import Effect

Array = NDArray[Any]


def check_law(control: Control | None, method: str) -> None:
    """Raise SimulationError if the method is SciPy's and cannot take the control law."""
    if control is None or method not in SCIPY_METHODS:
        return
    ends = len(control.spec.states) - len(moved_states(control.spec))
    if control.held or ends or begun_of(control.spec):
        which = (
            "is held over a step"
            if control.held or begun_of(control.spec)
            else "has states that change at the end of a step"
        )
        raise SimulationError(
            f'control "{control.spec.name}" {which}, expected a fixed step for it: {", ".join(EXPLICIT_METHODS)}'
        )


@dataclass(frozen=True, eq=False)
class Feedback(Effect):
    """A control law of a run.

    spec    Spec of the law
    held    whether the torque at the beginning of a step is held over it
    static  values of its static inputs
    rows    (samples or 1, steps or 1, columns) of the other inputs
    """

    spec: Spec
    held: bool
    static: tuple[Any, ...] = ()
    rows: Mapping[str, Array] = field(default_factory=dict)
    name = "control"
    stamped = False  # a law may be of any source

    @classmethod
    def of(cls, control: Control, model: Model, samples: int, steps: int) -> Feedback:
        """The law of a run of this many samples and steps. Raises ShapeError."""
        return cls(control.spec, control.held, control.static, control.rows(model, samples, steps))

    def structure(self) -> Feedback:
        return Feedback(self.spec, self.held)

    @cached_property
    def form(self) -> Any:
        return self.spec, self.held

    @cached_property
    def inputs(self) -> Any:
        return inputs_of(self.spec)

    @cached_property
    def states(self) -> Any:
        return states_of(self.spec)

    @cached_property
    def tables(self) -> tuple[Any, ...]:
        return self.static

    @cached_property
    def values(self) -> dict[str, Array]:
        return dict(self.rows)

    @property
    def integrated(self) -> tuple[str, ...]:
        """Names of the states that have rates."""
        return moved_states(self.spec)

    def law(self, at: Arithmetic) -> Law:
        """``(q, v, tau, states) -> tau, made``: the torque, and rates or ends of its states."""
        spec = self.spec
        if at.recorded:
            return law_on(spec, at.rows, at.given)
        tables = {in_step(x.name): static_rows(at.given[in_step(x.name)]) for x in spec.present if x.static}
        recorded = law_on(spec, at.rows, {**at.given, **tables})

        def law(q: Any, v: Any, tau: Any, states: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
            wanted, made = recorded(q, v, tau, states)
            return np.asarray(wanted, float), {name: np.asarray(x, float) for name, x in made.items()}

        return law
