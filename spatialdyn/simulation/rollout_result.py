"""``Rollout``, the result of ``rollout``: the states of many motions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from ..errors import SimulationError
from ..model.model import Model
from ..waiting import watch
from .contact_record import ContactRecord

if TYPE_CHECKING:
    from .scene import Scene

Array = NDArray[Any]


@dataclass(frozen=True, eq=False, repr=False)
class Rollout:
    """States of a rollout after each recorded step; ``q, v = rollout`` unpacks it.

    q         (B, T, nq)  joint positions [rad | m]; (T, nq) for a single start; without axis T for "last"
    v         (B, T, nv)  joint velocities [rad/s | m/s], likewise
    t         (T,)        times of the records [s]; () for "last"
    model     the Model
    states    {name: (B, T, ...)}  states carried beside q and v, likewise: "bristles" (nv) of LuGre friction [rad | m],
              states of a control law
    contacts  ContactRecord of these states, likewise; None unless asked for
    scene, method   the Scene, and the name of the method
    """

    q: Array
    v: Array
    t: Array
    model: Model
    states: Mapping[str, Array] = field(default_factory=dict)
    contacts: ContactRecord | None = None
    scene: Scene | None = None
    method: str = ""

    @property
    def bristles(self) -> Array | None:
        """Deflections (B, T, nv) of the bristles of LuGre friction [rad | m]; None without bristles."""
        return self.states.get("bristles")

    @property
    def cost(self) -> Array:
        """The sums (B,) of a ``Cost`` over the steps; with an axis T of records unless "last".

        Raises SimulationError for a rollout without a cost.
        """
        if "cost" not in self.states:
            raise SimulationError("the rollout has no cost, expected the argument cost")
        return self.states["cost"][..., 0]

    @property
    def end(self) -> dict[str, Any]:
        """The last states as arguments q0, v0 and states of ``rollout``, to continue the run.

        Raises SimulationError for a rollout without steps.
        """
        if not self.t.size:
            raise SimulationError("the rollout has no steps, expected some for a last state")
        single = self.q.ndim - self.t.ndim == 1

        def last(x: Array) -> Array:
            return x if self.t.ndim == 0 else x[-1] if single else x[:, -1]

        return {"q0": last(self.q), "v0": last(self.v), "states": {name: last(x) for name, x in self.states.items()}}

    def __iter__(self) -> Iterator[Array]:
        return iter((self.q, self.v))

    def __len__(self) -> int:
        return 2

    def __getitem__(self, k: Any) -> Any:
        return (self.q, self.v)[k]

    def __repr__(self) -> str:
        return f"<Rollout: q {self.q.shape}, v {self.v.shape}, {self.q.dtype}>"

    @watch.call("Rollout.plot")
    def plot(
        self, what: str = "q", *, joints: str | Sequence[str] | None = None, sample: int | None = None,
        ax: Any = None, path: Any = None,
    ) -> Any:  # fmt: skip
        """A Matplotlib Figure with the median and the 5 to 95 % band of each coordinate, a panel for each unit.

        what    "q" or "v"
        joints  names of joints, by default all
        sample  number of a sample to draw as well
        ax      Matplotlib axes to draw into, one for each panel
        path    a file to write, by its ending PNG, SVG, PDF, ...

        Samples that are not finite are left out, and counted in the title.
        Raises  SpatialDynError for another name, sample or ending, a rollout that recorded "last" alone, and if
                matplotlib is not installed; ModelError for an unknown joint.
        """
        from ..pictures.rollout_plots import plot_rollout

        return plot_rollout(self, what, joints, sample, ax, path)

    def _repr_html_(self) -> str:
        from ..pictures.notebook import rollout_html

        return rollout_html(self)
