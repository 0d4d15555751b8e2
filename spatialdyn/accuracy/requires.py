"""``requires``: which parts of a scene a motion needs, and the cheapest scene that keeps it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, as_count, as_number, as_words
from ..calls.dynamics import calls
from ..calls.progress import Progress, Steps, check_progress, reporting
from ..control.control import Control, check_control
from ..errors import ModelError, NonFiniteError, ShapeError, SpatialDynError, literal
from ..identification.motions import motion_of
from ..identification.recording import Recording
from ..model.model import Model
from ..simulation import integrators
from ..simulation.methods.methods import EXPLICIT_METHODS
from ..simulation.scene import Scene, scene_of, warn_of_friction
from .motions_around import Motion, Observe, scattered
from .references import error_bound
from .requirement import Part, Requirement
from .results import checked_tolerance
from .scene_parts import KINDS, PARTS, candidates
from .scene_search import WIDE, WORSE, Search, Stage, Trial

Array = NDArray[np.float64]
SAMPLES = 32
MOST = 1 << 12
EPS = float(np.finfo(np.float64).eps)
TOLERANCE = 1e-3  # rad | m
OBSERVED = {"q": "q [rad | m]", "v": "v [rad/s | m/s]"}
SPREAD = 0.01  # [rad | m], [rad/s | m/s]


def requires(
    scene: Scene | Model,
    q0: ArrayLike | Recording,
    v0: ArrayLike | None = None,
    duration: float | None = None,
    tolerance: float = TOLERANCE,
    torque: ArrayLike | None = None,
    control: Control | None = None,
    observe: str | Observe | None = None,
    *,
    samples: int = SAMPLES,
    spread: ArrayLike = SPREAD,
    spread_v: ArrayLike = SPREAD,
    dt: float | None = None,
    methods: str | Iterable[str] | None = None,
    kinds: str | Iterable[str] = KINDS,
    progress: Progress = False,
) -> Requirement:
    """The parts of a scene that a motion requires, and the cheapest scene that keeps the motion, measured here.

    scene      Scene: the robot and all that acts on it; a Model is a scene without further effects
    q0, v0     (nq,), (nv,)  the start [rad | m], [rad/s | m/s], around which samples scatter; or states (n, nq), (n,
               nv): every other state is used to choose, the rest to verify the choice
               q0 may be a Recording: its first state, its torques, each held until the next sample, and its duration,
               or a shorter one; then leave out v0, torque and control
    duration   of the motion [s]
    tolerance  largest change of the observed quantities, against the whole scene
    torque     (nv,), or (steps, nv) each held over its step, of the whole robot [N m | N]; zero if left out
    control    a ``Control``, whose torque is added. If joints are locked, the law acts on the remaining joints, with
               their entries of values of shape nq or nv
    observe    "q", the default: coordinates, by ``difference`` [rad | m]; "v": velocities; or a function of q (n, nq)
               and v (n, nv), n states of the whole robot, that returns (n, ...) numbers
    samples    number of states to choose by, and of fresh states to verify by
    spread, spread_v   deviations of normal samples around q0 and v0: a number or (nv,) [rad | m], [rad/s | m/s]
    dt         first step of the whole scene [s], halved until it is fine enough; 1 ms if left out
    methods    methods to try, by default those of ``scene.methods`` that run on lanes
    kinds      some of "effects": each one left out or in a cheaper form: friction as bristles, Coulomb's, viscous,
               none; limits, contacts, each point that never touches, constraints and fext left out; motors left out or
               without limits; rotors exact, as armatures, none; springs rigid; no gravity. "joints": each one locked
               at its place in q0. "links": light subtrees merged. "precision": float32. "methods": each one, at coarser
               steps. Or names of effects, "friction", "gravity", ...
    progress   True for a bar (needs rich), or a function of the number of steps done and their total

    First the whole scene is run at its step and at half of it; the difference is the ``certainty``. From the time at
    which it exceeds a quarter of the tolerance (0.15 of it for fewer than 32 samples), after impacts or in chaos,
    nothing is judged; that time is the ``horizon``. Then each part is measured alone, and parts within the tolerance
    are left out together, greedily. Then each method takes its coarsest step, and the cheapest method float32. The
    result is verified in fresh samples: its
    bound is the largest change times a margin of 2 or more (4 for fewer than 32 samples), plus the certainty. If that
    exceeds the tolerance, the next cheapest scene is verified, and finally the whole scene remains. A scene with a
    locked joint that is at rest at the start is compared with the whole robot from states with that joint at its
    locked position.

    Returns a Requirement: ``print`` shows it; ``scene``, ``method``, ``dt``, ``dtype``, ``code``, ``rows``,
    ``to_full``, ``to_reduced``, ``plot(path)``. Each candidate may compile a program: seconds for an arm.
    Raises  ShapeError, NonFiniteError for arrays; SpatialDynError for an invalid tolerance, duration, samples, spread,
            dt, methods, kinds or observe; SimulationError where the whole scene does not run, or where the certainty
            exceeds the tolerance from the start; ModelError for a robot without freedoms

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> scene = sd.Scene(model, friction=sd.Friction(viscous=1e-9))
    >>> found = sd.requires(scene, [0.5, -0.3], [0.0, 0.0], 0.2, 1e-3, kinds="effects", samples=4)
    >>> [(x.part, x.verdict) for x in found.rows[:2]], found.scene.acts
    ([('friction', 'left out'), ('gravity', 'needed')], ())
    """
    scene = scene_of(scene)
    model = scene.model
    if isinstance(q0, Recording):
        q0, v0, duration, torque = _recorded(model, q0, v0, duration, torque, control)
    elif v0 is None or duration is None:
        raise SpatialDynError(f"{'v0' if v0 is None else 'duration'} is None, expected it where q0 is no Recording")
    within, seconds, count = checked_tolerance(tolerance), as_number(duration), as_count(samples, MOST)
    if not math.isfinite(within):
        raise SpatialDynError(f"tolerance is {literal(tolerance)}, expected a finite number above 0")
    if not model.nv:
        raise ModelError(f'model "{model.name}" has no joint that moves, expected one that does')
    if not 0.0 < seconds < math.inf:
        raise SpatialDynError(f"duration is {literal(duration)}, expected a finite number of seconds above 0")
    if not count:
        raise SpatialDynError(f"samples is {literal(samples)}, expected a number of 1 to {MOST}")
    if dt is not None and not 0.0 < as_number(dt) < math.inf:
        raise SpatialDynError(f"dt is {literal(dt)}, expected None or a positive number of seconds")
    names = None if methods is None else _methods(scene, as_words("methods", methods, integrators))
    wanted = as_words("kinds", kinds, (*KINDS, *PARTS))
    check_progress(progress)
    sees = _observed(observe)
    torques = _torque(model, torque)
    q, v = _state("q0", q0, model.nq), _state("v0", v0, model.nv)
    deviations = _deviations("spread", spread, model.nv), _deviations("spread_v", spread_v, model.nv)
    law = check_control(control)
    warn_of_friction(scene, "requires")
    whole = scene.with_(friction=False) if scene.friction is None else scene  # it warns no more
    starts, fresh, middle = _samples(whole, q, v, deviations, count)
    farthest = max(float(abs(x).max(initial=0.0)) for pair in (starts, fresh) for x in pair)
    if farthest * EPS > within:
        raise SpatialDynError(
            f"a start has position or velocity {farthest:g}, expected less than {within / EPS:.2g}, of which float64 "
            "tells changes of the tolerance"
        )
    motion = Motion.of(whole, seconds, torques, law, sees)
    search = Search(motion, within, starts, fresh, *middle, _method(whole))
    found = candidates(whole, search.q0, wanted)
    with reporting(progress, "requires") as report:
        steps = Steps(report, 2 * len(found) + 4)
        search.settle(None if dt is None else float(dt))
        steps.next()
        alone = search.alone(found, steps.next)
        stages, parts = search.together(alone, steps.next)
        made = _cheapest(search, stages, parts, names, wanted)
        steps.next(steps.total)
    return made


def _cheapest(
    search: Search, stages: list[Stage], parts: list[Part], methods: tuple[str, ...] | None, kinds: tuple[str, ...]
) -> Requirement:
    """The cheapest scene and method that fresh samples confirm; if there is none, the whole scene."""
    motion, whole = search.motion, stages[0]
    seen: list[Trial] = []
    for k in range(len(stages) - 1, -1, -1):
        trials = search.trials(stages[k], methods, kinds)
        seen = seen or trials
        waiting = [x for x in trials if search.judged(x.change)]
        while waiting:
            trial = waiting.pop(0)
            if trial.ns * trial.steps > (WORSE if k else 1.0) * whole.ns * search.steps:
                continue
            error, bound, certainty = search.verified(stages[k], trial)
            if bound <= search.tolerance:
                shown = [trial if x.name == trial.name else x for x in trials]
                rows = _settled(parts, stages[: k + 1], search.rows_of_trials(shown, trial))
                return _made(search, stages[: k + 1], trial, rows, (error, bound, certainty))
            waiting += search.finer(stages[k], trial)
            waiting.sort(key=lambda x: x.ns * x.steps)
    off = motion.change(
        search.reference(whole.made, search.steps, True), search.reference(whole.made, 2 * search.steps, True)
    ).max(axis=1)
    certainty = float(off.max())
    trial = Trial(search.method, search.steps, WIDE, search.certainty, whole.ns)
    rows = _settled(parts, stages[:1], search.rows_of_trials(seen, None))
    return _made(search, stages[:1], trial, rows, (certainty, error_bound(off), certainty))


def _settled(parts: list[Part], stages: list[Stage], trials: list[Part]) -> tuple[Part, ...]:
    """The rows; parts of stages that failed verification are not marked as left out."""
    kept = stages[-1].labels
    rows = [
        Part(**{**vars(x), "verdict": "not with the others"})
        if x.verdict == "left out" and (x.part, x.form) not in kept else x
        for x in parts
    ]  # fmt: skip
    return (*rows, *trials)


def _made(
    search: Search, stages: list[Stage], trial: Trial, rows: tuple[Part, ...], found: tuple[float, float, float]
) -> Requirement:
    motion, last = search.motion, stages[-1]
    fine, dt = motion.duration / search.steps, motion.duration / trial.steps
    path = [
        Part(*x.label, x.change, x.ns, fine, 1.0 - x.ns / stages[0].ns, "left out" if k else "whole", "")
        for k, x in enumerate(stages)
    ]
    saved = 1.0 - trial.ns * trial.steps / stages[0].ns / search.steps
    dtype = np.dtype(trial.dtype).name
    path.append(Part(trial.method, dtype, trial.change, trial.ns, dt, saved, "taken", ""))
    horizon = motion.duration * search.upto / motion.records
    observed = OBSERVED[motion.observe] if isinstance(motion.observe, str) else "what is observed"
    return Requirement(
        motion.scene, last.made.scene, trial.method, dt, dtype, _code(search, last, trial), observed, search.tolerance,
        *found, horizon, motion.duration, len(search.fresh[0]), (search.method, fine), rows, tuple(path),
        last.made.embedding,
    )  # fmt: skip


def _code(search: Search, stage: Stage, trial: Trial) -> str:
    """Lines that make the scene and run it."""
    motion, at = search.motion, stage.made.embedding
    some = trial.steps // motion.records * search.upto
    q, v = ("q0", "v0") if at.whole else ("np.asarray(q0)[..., keep_q]", "np.asarray(v0)[..., keep_v]")
    lines, given = list(stage.made.lines), [q, v]
    if motion.torque is not None:
        word = "np.asarray(torque, float)"
        if at.turns:
            word += f" @ np.array({at.matrix(motion.scene.model.nv).tolist()})"
        elif not at.whole:
            word += "[..., keep_v]"
        if motion.torque.ndim == 2:
            word = f"np.repeat({word}, {trial.steps // len(motion.torque)}, axis=0)[:{some}]"
        given.append(word)
    words = [f"dt={motion.duration / trial.steps!r}", f"steps={some}", f'method="{trial.method}"']
    words += ['dtype="float32"'] if np.dtype(trial.dtype) != WIDE else []
    if motion.control is not None:
        lines.append(_control_code(search, stage, trial, some))
        words.append("control=law")
    lines.append(f"run = sd.rollout(lesser, {', '.join([*given, *words])})")
    return "\n".join(lines)


def _control_code(search: Search, stage: Stage, trial: Trial, some: int) -> str:
    """The line that makes the law of the lesser scene."""
    control, at = search.motion.control, stage.made.embedding
    assert control is not None
    inputs, changed, values = {x.name: x for x in control.spec.present}, False, []
    for name, x in control.values.items():
        shape, word = inputs[name].shape, f'control.values["{name}"]'
        lead = x.shape[: x.ndim - len(shape)]
        for axis, size in enumerate(shape, start=len(lead)):
            if not at.whole and x.ndim and size in ("nq", "nv"):
                word, changed = f"np.take({word}, keep_{size[1]}, {axis})", True
        if lead and lead[-1] > 1:
            axis, changed = len(lead) - 1, True
            word = f"np.repeat({word}, {trial.steps // lead[-1]}, {axis})"
            word = f"np.take({word}, range({some}), {axis})"
        values.append(f'"{name}": {word}')
    if not changed:
        return "law = control"
    return f"law = sd.Control.of(control.spec, {{{', '.join(values)}}}, (), control.held)"


# --- arguments -------------------------------------------------------------------------------------------


def _methods(scene: Scene, names: tuple[str, ...]) -> tuple[str, ...]:
    for name in names:
        if name not in scene.methods:
            raise SpatialDynError(f'methods has "{name}", expected some of {", ".join(scene.methods)} for this scene')
    if not names:
        raise SpatialDynError("methods is empty, expected some of " + ", ".join(scene.methods))
    return names


def _method(scene: Scene) -> str:
    """The method of the whole scene."""
    return scene.method if scene.method in EXPLICIT_METHODS else "rk4"


def _observed(observe: Any) -> Any:
    if observe is None:
        return "q"
    if isinstance(observe, str) and observe in ("q", "v"):
        return observe
    if not callable(observe) or isinstance(observe, type):
        raise SpatialDynError(f'observe is {literal(observe)}, expected "q", "v" or a function of q and v')
    return observe


def _torque(model: Model, torque: Any) -> Array | None:
    if torque is None:
        return None
    if callable(torque):
        raise SpatialDynError(
            "torque is a function, expected an array, or the function as a Control: samples run on lanes"
        )
    x = as_array("torque", torque)
    if x.ndim not in (1, 2) or x.shape[-1] != model.nv or not len(x):
        raise ShapeError(f"torque has shape {x.shape}, expected ({model.nv},) or (steps, {model.nv})")
    if not np.isfinite(x).all():
        raise NonFiniteError("torque has numbers that are not finite, expected finite ones")
    return np.array(x)


def _recorded(
    model: Model, log: Recording, v0: Any, duration: float | None, torque: Any, control: Any
) -> tuple[Array, Array, float, Array]:
    """q0, v0, duration and torques of a recording. Raises SpatialDynError."""
    for name, given in (("v0", v0), ("torque", torque)):
        if given is not None:
            raise SpatialDynError(f"{name} was given, expected None beside a Recording, which has it")
    if control is not None:
        raise SpatialDynError("control was given, expected None beside a Recording, whose torques have the law's")
    log.check(model)
    motion = motion_of(log, model, None, False)
    whole = len(motion) - 1
    wanted = whole if duration is None else as_number(duration) / log.dt
    steps = round(wanted) if 0.5 < wanted < whole + 0.5 else 0
    if not steps:
        raise SpatialDynError(f"duration is {literal(duration)}, expected None or {log.dt:g} to {whole * log.dt:g} s")
    tau = log.torques(model)[motion.first : motion.first + steps]
    return motion.states.q[0], motion.states.v[0], steps * log.dt, tau


def _state(name: str, given: Any, size: int) -> Array:
    x = as_array(name, given)
    if x.ndim not in (1, 2) or x.shape[-1] != size or x.shape[0] == 0:
        raise ShapeError(f"{name} has shape {x.shape}, expected ({size},) or (n, {size})")
    if not np.isfinite(x).all():
        raise NonFiniteError(f"{name} has numbers that are not finite, expected finite ones")
    return x


def _deviations(name: str, given: Any, nv: int) -> Array:
    x = as_array(name, given)
    if x.shape not in ((), (nv,)):
        raise ShapeError(f"{name} has shape {x.shape}, expected a number or ({nv},)")
    if not (np.isfinite(x) & (x >= 0.0)).all():
        raise SpatialDynError(f"{name} is {x.tolist()}, expected finite numbers of 0 or more")
    return np.array(np.broadcast_to(x, nv))


def _samples(
    scene: Scene, q: Array, v: Array, spread: tuple[Array, Array], count: int
) -> tuple[tuple[Array, Array], tuple[Array, Array], tuple[Array, Array | None]]:
    """States to judge by, fresh states, and the middle of both. Raises ShapeError."""
    if q.ndim == v.ndim == 1:
        q = np.asarray(calls["normalize"](scene.model, q)) if scene.model.nq != scene.model.nv else q
        made = [scattered(scene, q, v, spread, count, np.random.default_rng([7, k]), not k) for k in (0, 1)]
        return made[0], made[1], (q, v)
    n = max(len(x) if x.ndim == 2 else 1 for x in (q, v))
    if any(x.ndim == 2 and len(x) != n for x in (q, v)):
        raise ShapeError(f"q0 and v0 have {len(q)} and {len(v)} states, expected the same number of each")
    if n < 2:
        raise ShapeError("q0 and v0 have one state with an axis, expected several, or one without")
    q, v = (np.array(np.broadcast_to(x, (n, x.shape[-1]))) for x in (q, v))
    return (q[::2], v[::2]), (q[1::2], v[1::2]), (q[0], None)
