"""The protocol of an effect, one thing that acts in a run. A new one needs its file and a line in ``effects.of_run``.

A spring from each joint to the world, whole:

    @dataclass(frozen=True, eq=False)
    class WorldSpring(Effect):
        '''A torque -k q on every joint whose position is one number.'''

        stiffness: Array  # (nv,) [N m/rad | N/m]
        name = "world spring"
        inputs = (Argument("world_stiffness", ("nv",), "N m/rad | N/m", "to the world"),)
        work = work_of("world_spring", ("nv",), "of the springs to the world")

        @property
        def values(self):
            return {"world_stiffness": self.stiffness[None, None]}

        def torque(self, at, q, v):
            k = at.given["world_stiffness"]
            return np.array([-k[i] * q[i] for i in range(len(v))], v.dtype)

It acts in every method, in programs and in kernels; its work is recorded, and the ledger shows it as "world_spring".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from numpy.typing import NDArray

from ...engines.compiled.stamp import covers
from ...recursions.spec import Argument
from ..arithmetic import Arithmetic

Array = NDArray[Any]
Kind = TypeVar("Kind", bound="Effect")
Forces = dict[str, Any]  # {state of work: torques (nv,), or the work as a function of the displacement h (v + v⁺)/2}


class Effect:
    """One thing that acts in a run. Effects are equal if their steps are the same programs; values are inputs.

    name    its name in messages and ledgers
    inputs  inputs that it adds to a step, including its static tables
    values  {name: (samples or 1, steps or 1, columns)} of the inputs that are not tables
    tables  the inputs that are tables, in their order
    states  states that the run carries from step to step
    work    the state of its work; None if it does none
    form    everything else that a step depends on
    solves  whether ``solve`` finds the velocities after a step, together with all impulses
    drives  whether it may add energy; if nothing does, a run whose energy rises has diverged
    """

    name = ""
    solves = False
    drives = True

    @property
    def inputs(self) -> tuple[Argument, ...]:
        """See the class."""
        return ()

    @property
    def tables(self) -> tuple[Any, ...]:
        """See the class."""
        return ()

    @property
    def states(self) -> tuple[Argument, ...]:
        """See the class."""
        return ()

    @property
    def work(self) -> Argument | None:
        """See the class."""
        return None

    @property
    def form(self) -> tuple[Any, ...]:
        """See the class."""
        return ()

    @property
    def values(self) -> Mapping[str, Array]:
        """See the class."""
        return {}

    @property
    def stamped(self) -> bool:
        """Whether the stamp of the package's sources covers its part of a program, which is then cached by name."""
        return covers(type(self))

    def structure(self) -> Effect:
        """An equal effect without large values, for the keys of caches."""
        return self

    def as_coupled(self) -> Effect:
        """The effect to use if a later effect finds the velocities."""
        return self

    def torque(self, at: Arithmetic, q: Any, v: Any) -> Any:
        """Torques (nv) of the effect at a state; None if it has none."""
        return None

    def held_torque(self, at: Arithmetic, q: Any, v: Any, tau: Any) -> Any:
        """tau plus the effect's torque at the beginning of a step, held over the step."""
        return tau

    def solve(self, at: Arithmetic, acting: tuple[Effect, ...], tau: Any) -> tuple[Any, dict[str, Any], Forces]:
        """v⁺, the effect's states after the step, and forces that do work, from ``at.given`` at its beginning.

        acting  all effects of the run, including those that are solved for together
        """
        raise NotImplementedError

    def failure(self, states: dict[str, Array], dt: float, t: float) -> str:
        """The error in the steps until t, found from the states after them (one sample, flat); "" without one.

        A sample has none if one with larger states has none, so that many samples are judged by their largest states.
        """
        return ""

    @property
    def _key(self) -> tuple[Any, ...]:
        return type(self), self.inputs, self.states, self.form

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Effect) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


def torques_of(acting: tuple[Effect, ...], at: Arithmetic, q: Any, v: Any) -> list[tuple[Effect, Any]]:
    """The effects that have torques at a state, with these (nv)."""
    found = ((x, x.torque(at, q, v)) for x in acting)
    return [(x, torque) for x, torque in found if torque is not None]


def find(acting: tuple[Effect, ...], kind: type[Kind]) -> Kind | None:
    """The effect of this class; None if there is none."""
    return next((x for x in acting if isinstance(x, kind)), None)
