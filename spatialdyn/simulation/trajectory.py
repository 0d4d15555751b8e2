"""The result of a simulation: states, torques and energy at the recorded times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import check_model
from ..errors import ModelError, SpatialDynError, literal
from ..model.model import Model
from ..sources import run_files
from ..waiting import watch
from .contact_record import ContactRecord

if TYPE_CHECKING:
    from .scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """The recorded part of a simulation, N samples.

    t            (N,)      time [s]
    q            (N, nq)   joint positions [rad | m]
    v            (N, nv)   joint velocities [rad/s | m/s]
    p            (N, nv)   joint momenta M(q) v [kg m²/s | kg m/s]
    tau          (N, nv)   joint torques at these times [N m | N]; held torques are those of the step that begins there;
                           NaN at the last state if Ctrl-C came before the torque function was called
    energy       (N,)      T + V [J], including the energy in springs of series-elastic joints
    method, dt   name of the method, its step [s]
    robot        name of the model
    interrupted  whether Ctrl-C ended the simulation
    model        the Model; None after ``load`` without one
    states       {name: (N, ...)}  states that the run carried beside q and v: "bristles" (N, nv) of LuGre friction
                 [rad | m], states of a control law, and work [J] if it was recorded
    contacts     ContactRecord of these times, None unless asked for
    spring_energy  (N,)    the energy in springs of series-elastic joints [J]; None without springs
    scene        the Scene that was simulated; None after ``load`` without a model
    """

    t: Array
    q: Array
    v: Array
    p: Array
    tau: Array
    energy: Array
    method: str
    dt: float
    robot: str
    interrupted: bool = False
    model: Model | None = None
    states: Mapping[str, Array] = field(default_factory=dict)
    contacts: ContactRecord | None = None
    spring_energy: Array | None = None
    scene: Scene | None = None

    @property
    def bristles(self) -> Array | None:
        """Deflections (N, nv) of the bristles of LuGre friction [rad | m]; None without bristles."""
        return self.states.get("bristles")

    @property
    def end(self) -> dict[str, Any]:
        """The last state as arguments q0, v0 and states of ``simulate``, to continue the run."""
        return {"q0": self.q[-1], "v0": self.v[-1], "states": {name: x[-1] for name, x in self.states.items()}}

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        if not len(self):
            return f"<Trajectory of {self.robot}: {self.method}, empty>"
        cut = ", interrupted" if self.interrupted else ""
        return (
            f"<Trajectory of {self.robot}: {self.method}, dt {self.dt:g} s, {len(self)} samples of "
            f"{self.t[0]:g} .. {self.t[-1]:g} s, energy {self.energy[0]:.9g} J changes by up to "
            f"{abs(self.energy - self.energy[0]).max():.3g} J{cut}>"
        )

    @watch.call("Trajectory.save")
    def save(self, path: str | PathLike[str] | IO[bytes]) -> None:
        """Write everything but the robot to a file in NumPy's npz format, which ``Trajectory.load`` reads.

        The scene is written as its TOML text, with a digest of its robot.

        path  a name that ends in .npz, or a file open for writing bytes

        Raises SpatialDynError for another ending, or if the file cannot be written.
        """
        run_files.write(self, path)

    @classmethod
    @watch.call("Trajectory.load")
    def load(cls, path: str | PathLike[str], model: Model | None = None) -> Trajectory:
        """The Trajectory in a file written by ``save``.

        model  the robot, which is not in the file: if given, the trajectory has its ``model`` and ``scene``

        Raises SpatialDynError if the file cannot be read, is damaged or holds something else; ModelError for another
        model than that of the run.
        """
        if model is not None:
            check_model(model)
        read: tuple[Trajectory, str | None, str] = run_files.read(path, cls, ContactRecord)
        made, key, text = read
        if model is None:
            return made
        if key is None or key != model.key:
            what = f'a run of robot "{made.robot}"' if key is not None else "no scene"
            raise ModelError(
                f'{literal(path)} holds {what}, expected one of this model "{model.name}" with its numbers'
            )
        from .scene import Scene

        return replace(made, model=model, scene=Scene.from_toml(model, text))

    def to_dataframe(self) -> Any:
        """A pandas DataFrame: time as index, columns q0 ..., v0 ..., p0 ..., tau0 ..., energy, NAME0 ... of states."""
        try:
            import pandas
        except ImportError as error:
            raise SpatialDynError("pandas is not installed, expected it for a DataFrame; pip install pandas") from error
        columns = {f"{name}{k}": x for name in ("q", "v", "p", "tau") for k, x in enumerate(getattr(self, name).T)}
        columns["energy"] = self.energy
        for name, x in self.states.items():
            columns |= {f"{name}{k}": y for k, y in enumerate(x.reshape((len(x), -1)).T)}
        return pandas.DataFrame(columns, index=pandas.Index(self.t, name="t"))

    @watch.call("Trajectory.plot")
    def plot(
        self, what: str | Sequence[str] = ("q", "v", "energy"), *, joints: str | Sequence[str] | None = None,
        ax: Any = None, path: Any = None,
    ) -> Any:  # fmt: skip
        """A Matplotlib Figure with panels over time for each name in ``what``; angles and lengths in separate panels.

        what    one or several of "q", "v", "tau", "p", with dotted limits if they are near; "energy": T, V, their sum,
                and its change on a log axis; "phase": v against q of each joint of one freedom; "limits": q, v and tau
                as fractions of their limits, the outside shaded; "contacts": for each point the gap, the force along
                the ground's normal, the used share of its friction cone, and the force in the cone
        joints  names of joints, by default all
        ax      Matplotlib axes to draw into, one for each panel
        path    a file to write, by its ending PNG, SVG, PDF, ...

        Raises  SpatialDynError for another name, number of axes or ending, a file that cannot be written, or if
                matplotlib is not installed; ModelError for an unknown joint.
        """
        from ..pictures.trajectory_plots import plot_trajectory

        return plot_trajectory(self, what, joints, ax, path)

    @watch.call("Trajectory.report")
    def report(self, path: str | PathLike[str]) -> None:
        """Write one HTML page of the run, which needs no network: robot, player, plots, numbers, how to reproduce it.

        path  a name that ends in .html, or an open file

        The player needs viser, ``pip install viser pycollada``; without viser the page says so.
        Raises  SpatialDynError for another ending, if the file cannot be written, or if matplotlib is not installed.
        """
        from ..pictures.page import report_trajectory

        report_trajectory(self, path)

    def _repr_html_(self) -> str:
        from ..pictures.notebook import trajectory_html

        return trajectory_html(self)
