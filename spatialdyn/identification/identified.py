"""``Identified``: the parameters identified from a recording, their accuracy, and the model that has them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..actuation.friction import Friction
from ..calls.dynamics import calls
from ..calls.json_numbers import finite_or_none, json_text
from ..errors import IdentificationError, InertiaError
from ..model.model import Model
from ..simulation.scene import Scene
from ..waiting import watch
from .base import Base
from .equations import Equations, Settings
from .least_squares import whiteness
from .pseudo_inertia import pseudo_inertia
from .recording import Recording
from .unknowns import own_joints

Array = NDArray[np.float64]
COLUMNS = ("base parameter", "value", "±95 %", "σ %", "model")
POOR = 0.3  # of |β|: with a larger deviation a parameter counts as poorly determined


@dataclass(frozen=True, eq=False, repr=False)
class Validation:
    """Measured and predicted torques of a motion, at n times for nv freedoms (six for a base alone).

    t          (n,)     [s]
    tau        (n, nv)  measured, with the delay, window and hold of the fit [N m | N]
    predicted  (n, nv)  by the identified parameters
    rms        (nv,)    of the difference
    noise      (nv,)    rms in the recording that was identified
    ratio      (nv,)    rms / noise: 1 if the model explains this motion equally well
    share      (nv,)    rms over the standard deviation of the measured torque
    white      (nv,)    probability that white noise is at least as correlated as this difference
    """

    t: Array
    tau: Array
    predicted: Array
    rms: Array
    noise: Array
    ratio: Array
    share: Array
    white: Array

    def __repr__(self) -> str:
        return f"<Validation: {len(self.t)} times, rms of the torque up to {self.ratio.max():.3g} times the noise>"


@dataclass(frozen=True, eq=False, repr=False)
class Identified:
    """Parameters of a robot from its recording; ``print`` shows the table.

    start            Model that the identification began from
    method           "ols", "wls", "log_cholesky" or "sdp"
    base             Base: the base parameters of the torques
    beta             (rank,)  base parameters; 0 if removed
    deviation        (rank,)  standard deviations, from noise in the torques alone; infinite if the recording does not
                     determine the parameter
    half_width       (rank,)  of the 95 % intervals: beta ± half_width
    covariance       (rank, rank)  0 for removed parameters
    parameters       (count,)  of ``names``: with ols and wls those that give beta and are nearest to the model's own
    consistent       whether the method ensures physically consistent inertias, and all found are, beyond rounding
    noise            (nv,)  standard deviation of the residuals of each freedom [N m | N]
    white            (nv,)  probability that white noise is at least as correlated as these residuals; NaN for a
                     generator
    residuals        (n, nv)  with their times ``t`` (n,); NaN if a row did not count; empty for a generator
    rows             (nv,)  number of equations of each freedom
    delay            [s]  the torque of time t acts at t + delay; with its ``delay_deviation``, 0 if it was given
    singular_values  (rank,)  of the base's columns, each of norm 1, weighted
    seen             (rank,)  whether the recording excites the parameter at all
    removed          names of base parameters that were removed, in this order
    bounds           names of parameters that are held at 0
    notes            warnings, in words
    steps            number of steps of the search for consistent inertias
    settings         settings of the equations
    """

    start: Model
    method: str
    base: Base
    beta: Array
    deviation: Array
    half_width: Array
    covariance: Array
    parameters: Array
    consistent: bool
    noise: Array
    white: Array
    residuals: Array
    t: Array
    rows: NDArray[np.int64]
    delay: float
    delay_deviation: float
    singular_values: Array
    seen: NDArray[np.bool_]
    removed: tuple[str, ...]
    bounds: tuple[str, ...]
    notes: tuple[str, ...]
    steps: int
    settings: Settings

    @property
    def names(self) -> tuple[str, ...]:
        """Names of ``parameters``."""
        return self.base.names

    @property
    def condition(self) -> float:
        """Condition number of the base's columns, each of norm 1, weighted."""
        s = self.singular_values
        return float(s[0] / s[-1]) if len(s) and s[-1] > 0.0 else math.inf

    @property
    def correlation(self) -> Array:
        """(rank, rank) correlation of the base parameters; 0 for removed ones."""
        d = np.sqrt(self.covariance.diagonal())
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.nan_to_num(self.covariance / d / d[:, None])

    @property
    def eigenvalues(self) -> dict[str, Array]:
        """{body: (4,)} eigenvalues of the pseudo-inertias, increasing: all above 0 for physical bodies."""
        bodies = self.settings.unknowns.bodies
        P = pseudo_inertia(self.parameters[: 10 * len(bodies)].reshape(-1, 10))
        return {body.name: values for body, values in zip(bodies, np.linalg.eigvalsh(P), strict=True)}

    @property
    def friction(self) -> Friction | None:
        """The identified Coulomb and viscous friction; None if friction was not an unknown. Raises ModelError."""
        unknowns = self.settings.unknowns
        if not {"coulomb", "viscous"} & {kind for kind, _ in unknowns.joints}:
            return None
        return Friction(*(unknowns.values(kind, self.parameters) for kind in ("coulomb", "viscous"))).check(self.start)

    @property
    def offset(self) -> Array:
        """(nv,) constant torque that sensors or drives add to the robot's [N m | N]."""
        return self.settings.unknowns.values("offset", self.parameters)

    def model(self) -> Model:
        """The Model with the identified inertias, armatures, and friction of its joints, as a URDF has them.

        Raises  InertiaError naming the body whose inertia no mass distribution has ("log_cholesky" and "sdp" give no
                such inertia); IdentificationError naming the joint of a friction or armature below 0
        """
        unknowns = self.settings.unknowns
        for name, values in self.eigenvalues.items():
            if not values[0] > 0.0:
                raise InertiaError(
                    f'body of "{name}" has a pseudo-inertia of eigenvalues {np.array2string(values, precision=3)}, '
                    'expected them above 0: method="log_cholesky" finds inertias that bodies can have'
                )
        for kind, k in unknowns.joints:
            x = unknowns.values(kind, self.parameters)[k]
            if kind != "offset" and x < 0.0:
                name = next(j.name for j in own_joints(self.start) if j.idx_v == k)
                raise IdentificationError(
                    f'joint "{name}" has {kind} {x:.6g}, expected 0 or more: method="log_cholesky" keeps it'
                )
        made = self.start
        if unknowns.load:
            body = unknowns.bodies[0]
            pi = self.parameters[:10]
            c = pi[1:4] / pi[0]
            I = np.array([[pi[4], pi[5], pi[7]], [pi[5], pi[6], pi[8]], [pi[7], pi[8], pi[9]]])
            made = made.with_(payload={body.name: (pi[0], c, I - pi[0] * (c @ c * np.eye(3) - np.outer(c, c)))})
        elif unknowns.bodies:
            table = np.array(calls["inertial_parameters"](made))
            for k, body in enumerate(unknowns.bodies):
                table[body.joint] = self.parameters[10 * k : 10 * k + 10]
            made = made.with_(inertial_parameters=table)
        kinds = {kind for kind, _ in unknowns.joints}
        at = {joint.name: joint.idx_v for joint in own_joints(made) if joint.nv == 1}
        if "armature" in kinds:
            new = unknowns.values("armature", self.parameters)
            own = {k for kind, k in unknowns.joints if kind == "armature"}
            made = made.with_(armature={name: float(new[k]) for name, k in at.items() if k in own})
        changes = {"viscous": "damping", "coulomb": "friction"}
        wanted: dict[str, Any] = {
            changes[kind]: unknowns.values(kind, self.parameters) for kind in changes if kind in kinds
        }
        if not wanted:
            return made
        joints = []
        for j in made.robot.joints:
            own_values: dict[str, Any] = {name: float(x[at[j.name]]) for name, x in wanted.items() if j.name in at}
            joints.append(replace(j, **own_values))
        return Model(replace(made.robot, joints=tuple(joints)), made.options)

    def scene(self) -> Scene:
        """The Scene of the model and its friction, including friction that was known. Raises as ``model``."""
        known, found = self.settings.friction, self.friction
        model = self.model()
        if known is None or found is None:
            return Scene(model, friction=found if known is None else known)
        kinds = {kind for kind, _ in self.settings.unknowns.joints}
        return Scene(model, friction=Friction(
            found.coulomb if "coulomb" in kinds else known.coulomb,
            found.viscous if "viscous" in kinds else known.viscous,
        ))  # fmt: skip

    @watch.call("Identified.validate")
    def validate(self, recording: Recording) -> Validation:
        """How well the identified parameters predict the torques of another motion. Raises as ``identify``."""
        if not isinstance(recording, Recording):
            raise IdentificationError(f"recording is a {type(recording).__name__}, expected a Recording")
        recording.check(self.start)
        equations = Equations(recording, self.settings)
        t, tau, predicted = predictions(self, [equations])
        off = tau - predicted
        rms = np.sqrt(np.nanmean(off**2, axis=0))
        white = np.array([whiteness(x[np.isfinite(x)], *equations.shared(self.delay))[0] for x in off.T])
        spread = np.maximum(np.nanstd(tau, axis=0), np.finfo(float).tiny)
        return Validation(t, tau, predicted, rms, self.noise, rms / self.noise, rms / spread, white)

    @watch.call("Identified.report")
    def report(self, path: Any, validation: Recording | None = None) -> None:
        """Write one HTML page that needs no network: parameters with intervals, residuals of each joint, parameters
        that the recording does not determine, inertias, and measured and predicted torques of another motion.

        path        a name that ends in .html, or an open file
        validation  a Recording of another motion

        Raises  SpatialDynError for another ending, if the file cannot be written, or if matplotlib is not installed.
        """
        from ..pictures.identification_page import report_identified

        report_identified(self, path, validation)

    def table(self) -> list[list[str]]:
        """Cells of a table, a row for each base parameter, in the order of ``COLUMNS``."""
        own = self.base.K @ self.settings.unknowns.present
        return [
            [
                label, f"{b:.5g}", f"{h:.2g}" if math.isfinite(h) else "-",
                "removed" if label in self.removed else "not seen" if not seen else _share(d, b), f"{x:.5g}",
            ]
            for label, b, d, h, x, seen in zip(
                self.base.labels, self.beta, self.deviation, self.half_width, own, self.seen, strict=True
            )
        ]  # fmt: skip

    @property
    def poor(self) -> tuple[str, ...]:
        """Names of base parameters that the recording hardly determines: their deviation is above 30 % of them."""
        weak = ~self.seen | (self.deviation > POOR * abs(self.beta))
        return tuple(label for label, w in zip(self.base.labels, weak, strict=True) if w and label not in self.removed)

    @property
    def head(self) -> str:
        """The title of the table."""
        late = f", delay {1e3 * self.delay:.4g} ms" if self.delay else ""
        return (
            f"{self.start.name}: {self.base.rank} base parameters by {self.method} from {int(self.rows.sum())} "
            f"equations, condition {self.condition:.3g}{late}"
        )

    def __str__(self) -> str:
        rows = [list(COLUMNS), *self.table()]
        widths = [max(len(row[k]) for row in rows) for k in range(len(COLUMNS))]
        lines = [self.head]
        for row in rows:
            cells = [c.rjust(w) if k else c.ljust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))]
            lines.append("  ".join(cells).rstrip())
        noise = ", ".join(f"{x:.3g}" for x in self.noise)
        return "\n".join([*lines, f"noise of each freedom {noise}", *(f"note    {x}" for x in self.notes)])

    def __repr__(self) -> str:
        return f"<Identified {self.start.name}: {self.base.rank} base parameters by {self.method}>"

    def to_dict(self) -> dict[str, Any]:
        """All numbers as JSON types; numbers that are not finite become None."""
        arrays = ("beta", "deviation", "half_width", "parameters", "noise", "white", "singular_values", "rows")
        own = {name: [finite_or_none(x) for x in getattr(self, name).tolist()] for name in arrays}
        names = ("method", "consistent", "delay", "delay_deviation")
        plain = {name: finite_or_none(getattr(self, name)) for name in names}
        words = {name: list(getattr(self, name)) for name in ("names", "removed", "bounds", "notes")}
        return {"model": self.start.name, "base": list(self.base.labels), **plain, **own, **words}

    def to_json(self) -> str:
        """All numbers as JSON text."""
        return json_text(self.to_dict())


def predictions(found: Identified, equations: Iterable[Equations]) -> tuple[Array, Array, Array]:
    """Times (n,), and torques (n, nv) measured and predicted; NaN where a row does not count."""
    t, tau, predicted = [], [], []
    for one in equations:
        for rows in one.rows(found.delay):
            t.append(rows.t)
            tau.append(np.where(rows.keep, rows.tau, np.nan))
            own = rows.W[:, :, found.base.columns] @ found.beta + rows.tau - rows.y
            predicted.append(np.where(rows.keep, own, np.nan))
    if not t:
        raise IdentificationError("recording has no row left, expected more samples than the delay and the window take")
    return np.concatenate(t), np.concatenate(tau), np.concatenate(predicted)


def _share(deviation: float, beta: float) -> str:
    if not beta or not math.isfinite(deviation):
        return "-"
    share = 100.0 * deviation / abs(beta)
    return f"{share:.2g}" if share < 100.0 else "over 100"
