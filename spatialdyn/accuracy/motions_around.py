"""Motions of a scene and of lesser scenes from states scattered around a start, and the cost of a step."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..calls.dynamics import calls
from ..constraints.contact_dynamics import contact_gaps
from ..constraints.loops import project_configuration, project_velocity
from ..control.control import Control
from ..errors import ShapeError, SimulationError, SpatialDynError
from ..simulation import rollout
from ..simulation.scene import Scene
from .lesser_scenes import Lesser

Array = NDArray[Any]
Observe = Callable[[Array, Array], Any]
RECORDS = 20  # times at which motions are compared
COUNT = 64  # steps of a timed run, at most
FEW, TIMED, MOST = 8, 256, 8192  # samples of the first run, of the run that sets their number, and the most timed
ROUNDS = 5  # the median counts
SPENT = 0.015  # seconds of a timed run, about


@dataclass(frozen=True)
class Motion:
    """How the motions of a scene are run and compared.

    scene     the whole Scene
    duration  [s]
    torque    None, (nv,) or (steps, nv); control None or a Control
    observe   function of q (n, nq) and v (n, nv) of the whole robot, or "q" or "v"
    base      steps of any run are a multiple of it: those of the torques and of the control, and of the records
    records   times at which motions are compared
    """

    scene: Scene
    duration: float
    torque: Array | None
    control: Control | None
    observe: Any
    base: int
    records: int
    ns: dict[Any, float] = field(default_factory=dict)

    @classmethod
    def of(cls, scene: Scene, duration: float, torque: Array | None, control: Control | None, observe: Any) -> Motion:
        """From checked arguments. Raises SimulationError for a control with an axis of samples."""
        steps = [1] if torque is None or torque.ndim == 1 else [len(torque)]
        for name, lead in ({} if control is None else control.axes(scene.model)).items():
            if len(lead) > 1 and lead[0] != 1:
                raise SimulationError(f"{name} has an axis of {lead[0]} samples, expected one value for all of them")
            steps.append(lead[-1])
        given = math.lcm(*steps)
        fit = [k for k in range(RECORDS // 2, 2 * RECORDS + 1) if given % k == 0]
        records = min(fit, key=lambda k: abs(k - RECORDS)) if fit else RECORDS
        return cls(scene, duration, torque, control, observe, math.lcm(given, records), records)

    def run(
        self, made: Lesser, q: Array, v: Array, steps: int, method: str, dtype: DTypeLike = np.float64, upto: int = 0,
        finer: int = 1,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Motions q, v (samples, records, ...) of a lesser scene, from states and as states of the whole robot.

        upto   number of records up to the end of the run; 0: all
        finer  factor of the number of records
        """
        x, w = made.embedding.to_reduced(q, v, self.scene.model.nv)
        last = upto or self.records
        some = steps // self.records * last
        tau, control = self.forces(made, steps, some)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = rollout(
                made.scene, x, w, tau, dt=self.duration / steps, steps=some, method=method, dtype=dtype,
                record=steps // self.records // finer, control=control,
            )  # fmt: skip
        end = np.asarray(found.q, float), np.asarray(found.v, float)
        return made.embedding.to_full(*end, self.scene.model.nv)

    def forces(self, made: Lesser, steps: int, some: int) -> tuple[Array | None, Control | None]:
        """Torques and control of a lesser scene for a number of steps, of which the first are run."""
        tau, control = self.torque, self.control
        if tau is not None:
            tau = tau @ made.embedding.matrix(self.scene.model.nv)
            tau = np.repeat(tau, steps // len(tau), axis=0)[:some] if tau.ndim == 2 else tau
        return tau, None if control is None else lesser_control(control, self.scene, made, steps, some)

    def change(self, one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
        """(samples, records) largest changes of the observed quantities."""
        if self.observe == "v":
            off = abs(one[1] - other[1])
        elif self.observe == "q":
            norm = calls["normalize"]
            model = self.scene.model
            off = abs(np.asarray(calls["difference"](model, norm(model, one[0]), norm(model, other[0]))))
        else:
            off = abs(self._observed(*one) - self._observed(*other))
        return np.asarray(off.reshape((*off.shape[:2], -1)).max(axis=-1, initial=0.0))

    def _observed(self, q: Array, v: Array) -> Array:
        """``observe`` of states (samples, records, ...). Raises ShapeError, SimulationError."""
        n = q.shape[0] * q.shape[1]
        x = np.asarray(self.observe(q.reshape((n, -1)), v.reshape((n, -1))))
        if x.dtype.kind not in "fiu" or x.shape[:1] != (n,):
            raise ShapeError(f"observe gives {x.dtype} of shape {x.shape}, expected real numbers of shape ({n}, ...)")
        if not np.isfinite(x).all():
            raise SimulationError("observe gives numbers that are not finite, expected finite ones")
        return x.reshape((*q.shape[:2], -1)).astype(float)

    def cost(self, timed: Timed, beside: Timed) -> float:
        """CPU nanoseconds per step and sample, from runs of many samples that alternate with runs of the whole scene.

        timed, beside  the timed run, and that of the whole scene; the result is their ratio times the whole's cost
        """
        if timed.key not in self.ns:
            runs = [self._timed(x) for x in ((timed,) if timed.key == beside.key else (timed, beside))]
            spent = np.array([[run() for run in runs] for _ in range(ROUNDS)])
            whole = self.ns.setdefault(beside.key, 1e9 * float(spent[:, -1].min()))
            self.ns[timed.key] = whole * float(np.median(spent[:, 0] / spent[:, -1]))
        return self.ns[timed.key]

    def _timed(self, x: Timed) -> Callable[[], float]:
        """A function that runs some steps and returns CPU seconds of one."""
        q, v = x.made.embedding.to_reduced(*x.states, self.scene.model.nv)
        count = min(COUNT, x.steps)
        tau, control = self.forces(x.made, x.steps, count)

        def run(samples: int) -> float:
            x0, w0 = (np.ascontiguousarray(np.resize(y, (samples, y.shape[1]))) for y in (q, v))
            began = time.process_time()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                rollout(
                    x.made.scene, x0, w0, tau, dt=self.duration / x.steps, steps=count, method=x.method, dtype=x.dtype,
                    record="last", control=control, check=False,
                )  # fmt: skip
            return (time.process_time() - began) / count / samples

        run(FEW)  # compiled
        once = max(run(TIMED), 1e-12)
        return partial(run, int(min(max(TIMED, SPENT / once / count), MOST)))


class Timed(NamedTuple):
    """A timed run: a scene, (q, v) of the whole robot, a method, its steps and its precision."""

    made: Lesser
    states: tuple[Array, Array]
    method: str
    steps: int
    dtype: Any = np.float64

    @property
    def key(self) -> Any:
        """A key that is equal for runs of the same cost."""
        return self.made.scene, self.method, np.dtype(self.dtype).name


def lesser_control(control: Control, scene: Scene, made: Lesser, steps: int, some: int) -> Control:
    """The law on a lesser scene: values with an entry per coordinate or freedom keep the remaining entries.

    Raises SimulationError for springs made rigid, since a law may use their rotors, and for static inputs.
    """
    values, at, inputs = dict(control.values), made.embedding, {x.name: x for x in control.spec.present}
    if at.turns:
        raise SimulationError("a control law acts on rotors that a rigid spring has not, expected torques")
    if not at.whole and control.static:
        raise SimulationError("a control law has static inputs, which are of the whole robot")
    for name, x in values.items():
        shape = inputs[name].shape
        lead = x.shape[: x.ndim - len(shape)]
        if not at.whole and x.ndim:
            for axis, size in enumerate(shape, start=len(lead)):
                if size in ("nq", "nv"):
                    x = np.take(x, at.in_q if size == "nq" else at.in_v, axis=axis)
        if lead and lead[-1] > 1:
            x = np.repeat(x, steps // lead[-1], axis=len(lead) - 1)
            x = np.take(x, np.arange(some), axis=len(lead) - 1)
        values[name] = x
    return control if not values else Control.of(control.spec, values, control.static, control.held)


def scattered(
    scene: Scene, q0: Array, v0: Array, spread: tuple[Array, Array], samples: int, rng: Any, first: bool
) -> tuple[Array, Array]:
    """States (samples, ...) normally distributed around (q0, v0), at which the scene may start.

    first  whether the first is (q0, v0) itself

    Rotors behind springs turn with their joints; coordinates stay within limits that act, states on the constraints; a
    floating base rises until its points are no deeper in the ground than at q0, else the state moves towards q0.
    """
    model = scene.model
    off = rng.normal(size=(2, samples, model.nv)) * np.stack(np.broadcast_arrays(*spread))[:, None]
    for x in model.robot.joints:
        if x.spring is not None:  # stretched as at the start
            rotor, driven = model.joint(x.name).idx_v, model.joint(x.spring.joint).idx_v
            off[..., rotor] = x.spring.ratio * off[..., driven]
    if first:
        off[:, 0] = 0.0
    q, v = _moved(scene, q0, off[0]), v0 + off[1]
    if scene.contacts is not None:
        least = np.minimum(contact_gaps(model, scene.contacts, q0), 0.0)
        floats = model.joints[1].kind == "floating" if model.njoints > 1 else False
        for _ in range(60):
            low = (least - contact_gaps(model, scene.contacts, q)).max(axis=-1)
            deep = low > 0.0
            if not deep.any():
                break
            if floats and scene.constraints is None:
                up = getattr(scene.contacts.terrain, "normal", (0.0, 0.0, 1.0))
                q[deep, :3] += np.asarray(up, float) * low[deep, None]
            else:
                off[0, deep] *= 0.5
                q = _moved(scene, q0, off[0])
    if scene.constraints is not None:
        v = project_velocity(model, scene.constraints, q, v)
    return np.ascontiguousarray(q), np.ascontiguousarray(v)


def _moved(scene: Scene, q0: Array, off: Array) -> Array:
    model = scene.model
    q = np.array(calls["integrate"](model, np.broadcast_to(q0, (len(off), model.nq)), off))
    still = ~off.any(axis=1)
    q[still] = q0
    if scene.limits:
        q[~still] = np.clip(q, model.lower, model.upper)[~still]
    if scene.constraints is not None:
        q[~still] = project_configuration(model, scene.constraints, q[~still])
    return q


def reason(error: SpatialDynError) -> str:
    """The words of an error, in one line."""
    return " ".join(str(error).split())
