"""``Recording``: positions and torques of a robot over time, checked, from arrays, a file or a simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, as_flag, check_model
from ..calls.files import check_ending
from ..errors import IdentificationError, ShapeError, SpatialDynError, literal
from ..model.joint_rows import Joint
from ..model.model import Model
from ..simulation.trajectory import Trajectory
from ..waiting import watch
from .tables import KINDS, arrays_of, from_csv, from_parquet
from .unknowns import floats, own_joints

Array = NDArray[np.float64]
TABLES = (".csv", ".parquet")
GAP = 1.5  # median steps: in a longer step samples are missing
JITTER = 0.01  # of a step: times with larger deviations are refused
STUCK = 3  # samples in a row at the largest torque, equal to the bit: a saturated or clipped signal
LEAST = 5  # samples
APART = 0.3  # of a motion: velocities whose integral differs more from the positions do not belong to them
MOVES = 0.02  # rad or m, standard deviation of positions: a joint that moves less may be at rest
BEYOND = 0.01  # of a range of positions


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """A measured motion: N samples at even times.

    t         (N,)      increasing [s]
    q         (N, nq)   joint positions [rad | m]
    tau       (N, nv)   joint torques [N m | N]; the six of a floating base may be left out, and are then 0
    v, a      (N, nv)   velocities and accelerations; None if they were not measured
    wrenches  {frame: (N, 6)}  forces on the robot, linear first, in the frame's axes and at its origin [N | N m]

    ``Recording(..., resample=True)`` interpolates samples at uneven times linearly to an even grid; without it steps
    that differ by more than 1 % are refused.

    Raises  IdentificationError naming the row and column of a number that is not finite, for times that do not increase
            or are uneven, and for fewer than 5 samples; ShapeError

    >>> import numpy as np, spatialdyn as sd
    >>> t = np.linspace(0.0, 1.0, 101)
    >>> log = sd.Recording(t, np.sin(t)[:, None], np.cos(t)[:, None])
    >>> log.dt, len(log)
    (0.01, 101)
    """

    t: Array
    q: Array
    tau: Array
    v: Array | None = None
    a: Array | None = None
    wrenches: Mapping[str, Array] = field(default_factory=dict)
    dt: float = field(init=False)
    _commanded: bool = field(init=False, default=False)  # whether torques are commands to a motor
    _filled: tuple[str, ...] = field(init=False)  # a note if samples were missing

    def __init__(
        self, t: ArrayLike, q: ArrayLike, tau: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None,
        wrenches: Mapping[str, ArrayLike] | None = None, *, resample: bool = False,
    ) -> None:  # fmt: skip
        """Keep checked copies."""
        given: dict[str, Any] = {"q": q, "tau": tau, "v": v, "a": a}
        found = {name: np.array(as_array(name, x)) for name, x in given.items() if x is not None}
        if wrenches is not None and not isinstance(wrenches, Mapping):
            raise IdentificationError(f"wrenches is {literal(wrenches)}, expected a mapping of frames to arrays (N, 6)")
        forces = {str(name): np.array(as_array(f"wrench of {name}", x)) for name, x in (wrenches or {}).items()}
        when = np.array(as_array("t", t))
        if when.ndim != 1 or len(when) < LEAST:
            raise IdentificationError(f"t has shape {when.shape}, expected (N,) with N of {LEAST} or more")
        for name, x in {**found, **{f"wrench of {k}": x for k, x in forces.items()}}.items():
            if x.ndim != 2 or len(x) != len(when) or (name.startswith("wrench") and x.shape[1] != 6):
                wide = 6 if name.startswith("wrench") else "n"
                raise ShapeError(f"{name} has shape {x.shape}, expected ({len(when)}, {wide})")
            if not np.isfinite(x).all():
                row, column = np.argwhere(~np.isfinite(x))[0]
                raise IdentificationError(f"{name} is {x[row, column]} in row {row}, column {column}, expected numbers")
        steps = np.diff(when)
        if not np.isfinite(when).all() or (steps <= 0.0).any():
            row = int(np.argmax(~np.isfinite(when))) if not np.isfinite(when).all() else int(np.argmax(steps <= 0)) + 1
            raise IdentificationError(f"t is {when[row]} in row {row}, expected times that increase")
        filled: tuple[str, ...] = ()
        dt = float((when[-1] - when[0]) / (len(when) - 1))
        row = int(abs(steps - dt).argmax())
        if abs(steps[row] - dt) > JITTER * dt:
            if not as_flag("resample", resample):
                raise IdentificationError(
                    f"t has a step of {steps[row]:.6g} s in row {row} among steps of {dt:.6g} s, expected even ones: "
                    "resample=True puts them on a grid"
                )
            filled = _gaps(when)
            grid = when[0] + dt * np.arange(len(when))
            found = {name: _on_grid(when, x, grid) for name, x in found.items()}
            forces = {name: _on_grid(when, x, grid) for name, x in forces.items()}
            when = grid
        for x in (when, *found.values(), *forces.values()):
            x.flags.writeable = False
        kept = {"t": when, "v": None, "a": None, **found, "wrenches": forces, "dt": dt, "_filled": filled}
        for name, value in kept.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        more = [name for name in ("v", "a") if getattr(self, name) is not None] + [*self.wrenches]
        also = f", with {', '.join(more)}" if more else ""
        return f"<Recording: {len(self)} samples of {self.dt:g} s, {self.tau.shape[1]} torques{also}>"

    @classmethod
    @watch.call("Recording.of")
    def of(cls, run: Trajectory) -> Recording:
        """The Recording of a simulation's samples, of its positions, velocities and torques.

        For ``identify``, hold="after" is right if torques are held from sample to sample: a constant or a table, a law
        with held=True, or torques that semi_implicit_euler and explicit_euler evaluate once a step; every step must be
        recorded (``record=1``), or the torque constant between samples. For a function or a law that rk4 and other
        methods evaluate within a step use hold=None. ``tau`` does not contain forces of contacts, limits, constraints
        and ``fext``; neither do the equations of ``identify``.

        With motors ``tau`` is the commanded torque, not the torque that acted: ``requires`` replays it, ``identify``
        refuses it.
        """
        if not isinstance(run, Trajectory):
            raise IdentificationError(f"run is a {type(run).__name__}, expected a Trajectory")
        made = cls(run.t, run.q, run.tau, run.v)
        object.__setattr__(made, "_commanded", run.scene is not None and run.scene.motor is not None)
        return made

    @classmethod
    @watch.call("Recording.load")
    def load(cls, path: Any, model: Model | None = None, *, resample: bool = False) -> Recording:
        """The Recording in a table, CSV by NumPy or parquet by pandas.

        path   a name that ends in .csv or .parquet: columns t, q0 ..., tau0 ... and optionally v0 ..., a0 ..., and for
               a force on a frame wrench_FRAME_0 ... wrench_FRAME_5. Other columns are ignored
        model  if given, columns may be named by joints of one freedom: q_NAME, tau_NAME, ...

        The first line of a CSV file has the names; commas, semicolons or tabs separate.

        Raises  SpatialDynError for a file that cannot be read, naming line and column; IdentificationError naming the
                missing column
        """
        check_ending("path", path, TABLES)
        columns = from_csv(path) if str(path).lower().endswith(".csv") else from_parquet(path)
        return cls.from_columns(columns, model, resample=resample)

    @classmethod
    def from_columns(
        cls, columns: Mapping[str, ArrayLike], model: Model | None = None, *, resample: bool = False
    ) -> Recording:
        """The Recording of named columns, such as a pandas DataFrame: see ``load``."""
        if not isinstance(columns, Mapping) and not hasattr(columns, "columns"):
            raise IdentificationError(f"columns is a {type(columns).__name__}, expected a mapping, or a DataFrame")
        return cls(**arrays_of(columns, None if model is None else check_model(model)), resample=resample)

    @watch.call("Recording.save")
    def save(self, path: Any) -> None:
        """Write the samples with all digits to a CSV file that ``load`` reads."""
        check_ending("path", path, (".csv",))
        kinds = {kind: getattr(self, kind) for kind in KINDS if getattr(self, kind) is not None}
        kinds |= {f"wrench_{frame}_": x for frame, x in self.wrenches.items()}
        names = ["t", *(f"{kind}{k}" for kind, x in kinds.items() for k in range(x.shape[1]))]
        rows = np.column_stack([self.t, *kinds.values()])
        try:
            np.savetxt(path, rows, "%.17g", ",", header=",".join(names), comments="")
        except (OSError, ValueError) as error:
            raise SpatialDynError(f"{literal(path)} cannot be written: {error}") from error

    def check(self, model: Model) -> tuple[str, ...]:
        """Warnings about the recording for a robot, in words; empty if there are none.

        Raises  ShapeError for arrays of another robot; IdentificationError naming a joint that moves while its torque
                is constant to the bit: saturated, or not recorded
        """
        nq, nv = check_model(model).nq, model.nv
        widths = {
            "q": (nq,),
            "tau": (nv, nv - 6) if floats(model) else (nv,),
            "v": (nv,),
            "a": (nv,),
        }
        for name, wide in widths.items():
            x = getattr(self, name)
            if x is not None and x.shape[1] not in wide:
                raise ShapeError(f'{name} has {x.shape[1]} columns, expected {wide[0]} of robot "{model.name}"')
        for name in self.wrenches:
            model.frame(name)
        tau, notes = self.torques(model), [*self._filled]
        for joint in own_joints(model):
            if joint.nv != 1:
                continue
            x, q = tau[:, joint.idx_v], self.q[:, joint.idx_q]
            if np.ptp(q) > 0.0 and (x == x[0]).all() and x[0] != 0.0:
                raise IdentificationError(
                    f'torque of joint "{joint.name}" is {x[0]:.6g} in every sample while it moves, expected a '
                    "measured one: it is saturated, or was not recorded"
                )
            notes += self._odd_motion(model, joint)
            if np.ptp(q) > 0.0 and not x.any():
                notes.append(
                    f'torque of joint "{joint.name}" is 0 in every sample while it moves: it has no drive, or its '
                    "torque was not recorded"
                )
            for extreme in (x.max(), x.min()):
                at = int((x == extreme).sum())
                longest = _longest_run(x == extreme)
                if extreme != 0.0 and longest >= STUCK:
                    notes.append(f'torque of joint "{joint.name}" is {extreme:.6g} in {at} samples: saturated')
            limit = model.effort_limit[joint.idx_v]
            if abs(x).max() > limit * (1.0 + 1e-9):
                notes.append(
                    f'torque of joint "{joint.name}" is up to {abs(x).max():.6g}, beyond its limit {limit:.6g}'
                )
        return tuple(notes)

    def _odd_motion(self, model: Model, joint: Joint) -> list[str]:
        """Notes on positions beyond the limits of a joint of one freedom, and on velocities that do not fit them."""
        q, notes = self.q[:, joint.idx_q], []
        low, high = float(model.lower[joint.idx_q]), float(model.upper[joint.idx_q])
        room = BEYOND * (high - low)
        if high > low and (q.min() < low - room or q.max() > high + room):
            notes.append(
                f'position of joint "{joint.name}" goes from {q.min():.4g} to {q.max():.4g}, beyond its limits '
                f"{low:.4g} to {high:.4g}: degrees, or another zero?"
            )
        if self.v is not None:
            v = self.v[:, joint.idx_v]
            way = np.concatenate([[0.0], np.cumsum(0.5 * self.dt * (v[1:] + v[:-1]))])
            size, off = max(float(q.std()), float(way.std())), float((way - q).std())
            if size > MOVES and off > APART * size:
                notes.append(
                    f'velocity of joint "{joint.name}" is not the slope of its position, {off / size:.0%} off: another '
                    "unit, sign or joint, or angles that jump by a turn?"
                )
        return notes

    @watch.call("Recording.torques")
    def torques(self, model: Model) -> Array:
        """(N, nv) of all freedoms: 0 for a floating base whose torques were left out."""
        missing = check_model(model).nv - self.tau.shape[1]
        return np.concatenate([np.zeros((len(self), missing)), self.tau], axis=1) if missing > 0 else self.tau


def _longest_run(x: NDArray[np.bool_]) -> int:
    """The largest number of neighbours that are True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], x, [False]]).astype(int)))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _gaps(t: Array) -> tuple[str, ...]:
    """A note on steps in which samples are missing; empty without such steps."""
    steps = np.diff(t)
    usual, worst = float(np.median(steps)), int(steps.argmax())
    count = int((steps > GAP * usual).sum())
    if not count:
        return ()
    many = "a gap" if count == 1 else f"{count} gaps, the longest"
    return (
        f"t has {many} of {steps[worst]:.6g} s from {t[worst]:.6g} s on, among steps of {usual:.6g} s: filled by "
        "straight lines",
    )


def _on_grid(t: Array, x: Array, grid: Array) -> Array:
    return np.stack([np.interp(grid, t, y) for y in x.T], 1)
