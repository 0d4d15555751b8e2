"""What a simulation leaves: states, torques and energy at the times that were recorded."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ..errors import SpatialDynError
from ..model.model import Model

Array = NDArray[np.float64]
ARRAYS = ("t", "q", "v", "p", "tau", "energy")
WORDS = ("method", "dt", "robot", "interrupted")


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """The recorded part of a simulation, N samples.

    t            (N,)      time [s]
    q            (N, nq)   joint positions [rad | m]
    v            (N, nv)   joint velocities [rad/s | m/s]
    p            (N, nv)   joint momenta M(q) v [kg m²/s | kg m/s]
    tau          (N, nv)   joint torques at these times, of those held over steps that of the step that begins there;
                           NaN where Ctrl-C came before a function had said
    energy       (N,)      T + V [J]
    method, dt   what made it
    robot        name of the model
    interrupted  whether Ctrl-C ended it before its time
    model        whose motion it is; None after ``load``, for a file holds numbers alone
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

    def save(self, path: str | PathLike[str]) -> None:
        """Write all of it to a file in NumPy's npz format, which ``Trajectory.load`` reads."""
        parts = {name: np.asarray(getattr(self, name)) for name in (*ARRAYS, *WORDS)}
        with open(path, "wb") as file:
            np.savez_compressed(file, allow_pickle=False, **parts)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Trajectory:
        """The Trajectory of a file that ``save`` has written. Raises SpatialDynError if it holds something else."""
        try:
            with open(path, "rb") as file, np.load(file, allow_pickle=False) as parts:
                arrays = [parts[name] for name in ARRAYS]
                words = [parts[name].item() for name in WORDS]
        except (KeyError, ValueError, TypeError, EOFError, BadZipFile) as error:
            raise SpatialDynError(f"{path} holds no trajectory: {error}") from error
        return cls(*arrays, *words)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with the time as index and columns q0 ..., v0 ..., p0 ..., tau0 ..., energy."""
        try:
            import pandas
        except ImportError as error:
            raise SpatialDynError("pandas is not installed, expected it for a DataFrame; pip install pandas") from error
        columns = {f"{name}{k}": x for name in ("q", "v", "p", "tau") for k, x in enumerate(getattr(self, name).T)}
        return pandas.DataFrame({**columns, "energy": self.energy}, index=pandas.Index(self.t, name="t"))

    def plot(self, what: tuple[str, ...] = ("q", "v", "energy")) -> Any:
        """A matplotlib Figure with one set of axes for each of q, v, p, tau, energy that is asked for.

        The change of energy since the beginning is what is drawn of it. ``figure.savefig(path)`` writes it to a file.
        Raises  SpatialDynError for another name, or where matplotlib is not installed.
        """
        labels = {
            "q": "q [rad | m]",
            "v": "v [rad/s | m/s]",
            "p": "p [kg m²/s | kg m/s]",
            "tau": "τ [N m | N]",
            "energy": "change of energy [J]",
        }
        if not what or not set(what) <= set(labels):
            raise SpatialDynError(f"plot of {what!r}, expected some of {', '.join(labels)}")
        try:
            from matplotlib.figure import Figure
        except ImportError as error:
            raise SpatialDynError('matplotlib is not installed; pip install "spatialdyn[plot]"') from error
        figure = Figure(figsize=(7.0, 2.2 * len(what) + 0.6), layout="constrained")
        rows = figure.subplots(len(what), 1, sharex=True, squeeze=False)[:, 0]
        for axes, name in zip(rows, what, strict=True):
            y = self.energy - self.energy[0] if name == "energy" else getattr(self, name)
            lines = axes.plot(self.t, y, linewidth=1.0)
            axes.set_ylabel(labels[name])
            if 1 < len(lines) <= 10:
                words = [f"{name}{k}" for k in range(len(lines))]
                axes.legend(lines, words, fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
            axes.grid(alpha=0.3)
        rows[0].set_title(f"{self.robot}: {self.method}, dt {self.dt:g} s")
        rows[-1].set_xlabel("t [s]")
        return figure
