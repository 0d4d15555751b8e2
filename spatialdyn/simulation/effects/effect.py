"""The protocol of an effect: one thing that acts in a run. Adding one touches its file and ``effects.of_run``.

A spring from a joint to the world, whole:

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

It acts in every method, in programs and by kernels; its work is recorded, and the ledger shows it as "world_spring".
"""

from __future__ import annotations

from typing import Any, TypeVar

from numpy.typing import NDArray

from ...bodies.static_table import StaticTable
from ...engines.compiled.stamp import covers
from ...recursions.spec import Argument
from ..arithmetic import Arithmetic

Array = NDArray[Any]
Kind = TypeVar("Kind", bound="Effect")
Forces = dict[str, Any]  # by names of states of work: torques (nv,), or functions of the way h (v + v⁺)/2 to the work


class Effect:
    """What acts in a run. Two effects are equal if steps with them are the same programs: values are inputs.

    name    as messages and ledgers call it
    inputs  of a step, its static tables among them
    states  that the run carries from step to step
    work    the state of its work; None if it does none
    form    what a step depends on beside the inputs and states
    drives  whether it may add to the energy, by which runs are else found to diverge
    """

    name = ""
    drives = True

    @property
    def inputs(self) -> tuple[Argument, ...]:
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
    def values(self) -> dict[str, Array]:
        """(samples or 1, steps or 1, columns) of each input that is no table."""
        return {}

    @property
    def tables(self) -> tuple[StaticTable, ...]:
        """Of the inputs that are tables, in their order."""
        return ()

    @property
    def stamped(self) -> bool:
        """Whether the stamp of the package's sources covers what it adds to a program, which is then kept by name."""
        return covers(type(self))

    @property
    def solves(self) -> bool:
        """Whether it finds the velocities after a step, with what acts by impulses: it has ``solve``."""
        return False

    def structure(self) -> Effect:
        """An equal effect without large values, for the keys of caches."""
        return self

    def as_coupled(self) -> Effect:
        """The effect where another one, which comes later, finds the velocities."""
        return self

    def torque(self, at: Arithmetic, q: Any, v: Any) -> Any:
        """Torques (nv) of the effect at a state; None if it gives none."""
        return None

    def held_torque(self, at: Arithmetic, q: Any, v: Any, tau: Any) -> Any:
        """tau, with a torque that is that of the beginning of a step, held over it."""
        return tau

    def solve(self, at: Arithmetic, acting: tuple[Effect, ...], tau: Any) -> tuple[Any, dict[str, Any], Forces]:
        """v⁺, the effect's states after the step, and forces that do work, from what is ``given`` at its beginning.

        acting  all effects of the run, those that are solved for together among them
        """
        raise NotImplementedError

    def failure(self, states: dict[str, Array], dt: float, t: float) -> str:
        """What is wrong with the steps until t, from states (of one sample, flat) after them; "" if nothing is."""
        return ""

    @property
    def _key(self) -> tuple[Any, ...]:
        return type(self), self.inputs, self.states, self.form

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Effect) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


def find(acting: tuple[Effect, ...], kind: type[Kind]) -> Kind | None:
    """The effect of that class; None if there is none."""
    return next((x for x in acting if isinstance(x, kind)), None)
