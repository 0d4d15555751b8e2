"""The search for the cheapest scene that keeps a motion: parts one by one, then together, then methods and steps."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import SimulationError, SpatialDynError
from ..simulation.methods.methods import EXPLICIT_METHODS
from ..simulation.scene import Scene
from .lesser_scenes import Choice, Lesser, lesser
from .motions_around import Motion, Timed, reason
from .references import FEW, FEW_LEAST, LEAST, error_bound
from .requirement import Part
from .scene_parts import METHODS, PRECISION, Candidate, touches, why

Array = NDArray[Any]
PART = 0.75  # of the tolerance: what a change, as often as its margin, and the certainty may be at the whole's step
FREE = 1e-3  # of the tolerance: parts that change less are left out together
GAIN = 0.02  # share of the cost: a smaller gain is within the noise of times
WORSE = 1.1  # times the cost: a simpler scene that costs more is not taken
FINEST = 1 << 17  # the most steps
MOST_STEPS = 1 << 24  # the most steps of the first fine scene
PATIENCE = 4.0  # CPU seconds of one run of the whole scene, beyond which its step is not halved
DENSE = 64  # the most times between two records at which limits and gaps are examined
STEP = 1e-3  # [s] step of the first run, if none is given
NARROW = np.dtype(np.float32)
WIDE = np.dtype(np.float64)


class Trial(NamedTuple):
    """A run of a scene and its measured change and cost."""

    method: str
    steps: int
    dtype: Any
    change: float
    ns: float

    @property
    def name(self) -> tuple[str, str]:
        """The words of the method and the precision."""
        return self.method, np.dtype(self.dtype).name


@dataclass
class Stage:
    """A scene on the way from the whole to the least, with its change at the fine step and its cost."""

    choice: Choice
    made: Lesser
    change: float
    ns: float
    label: tuple[str, str]
    labels: tuple[tuple[str, str], ...] = ()


@dataclass
class Search:
    """A search for the cheapest scene of a motion, from states to judge by and fresh states to verify by.

    starts  (q, v) of states to judge by
    fresh   (q, v) of states to verify by
    q0, v0  the middle of them; v0 is None if states must not be moved to the position of a locked joint
    steps   of the fine scene; its motions at twice as many steps are the reference
    upto    number of records that are judged
    """

    motion: Motion
    tolerance: float
    starts: tuple[Array, Array]
    fresh: tuple[Array, Array]
    q0: Array
    v0: Array | None
    method: str
    steps: int = 0
    upto: int = 0
    certainty: float = 0.0
    known: dict[Any, tuple[Array, Array]] = field(default_factory=dict)

    @property
    def scene(self) -> Scene:
        """The whole Scene."""
        return self.motion.scene

    @property
    def whole(self) -> Stage:
        """The whole scene, at its fine step."""
        made = lesser(self.scene, Choice(), self.q0)
        return Stage(Choice(), made, 0.0, self._ns(made), ("whole scene", self.method))

    @property
    def margin(self) -> float:
        """The factor of a change that has to be within the tolerance."""
        return LEAST if len(self.fresh[0]) >= FEW else FEW_LEAST

    @property
    def fine(self) -> float:
        """The largest difference of the whole scene between its step and half of it: its own step is then a trial."""
        return PART / (1.0 + self.margin) * self.tolerance

    def judged(self, change: float) -> bool:
        """Whether a change is below the tolerance with a margin."""
        return self.margin * change + self.certainty <= self.tolerance

    def nearly(self, change: float) -> str:
        """Why a change within the tolerance is too large: in other samples it may be several times as large."""
        return f"within the tolerance, {self.margin:g} times that is not" if change <= self.tolerance else ""

    # --- the whole scene against itself -----------------------------------------------------------------------

    def settle(self, dt: float | None) -> None:
        """Find a step at which the whole scene differs little from itself at half the step, and the time of that.

        Raises SimulationError if it differs more already at the first record.
        """
        base, made = self.motion.base, lesser(self.scene, Choice(), self.q0)
        ratio = self.motion.duration / (STEP if dt is None else dt)  # of floats of Python: infinite where it overflows
        if not ratio <= MOST_STEPS:
            raise SimulationError(
                f"duration is {self.motion.duration:g} s, {ratio:.3g} steps of dt, expected at most {MOST_STEPS}"
            )
        each = max(1, math.ceil(self.motion.duration / (STEP if dt is None else dt) / base - 1e-9))
        steps = base * each
        self.upto = self.motion.records
        before = None
        while True:
            try:
                before = self.motion.run(made, *self.starts, steps, self.method) if before is None else before
                began = time.thread_time()
                after = self.motion.run(made, *self.starts, 2 * steps, self.method)
            except SimulationError:
                if before is not None or dt is not None or 2 * steps > FINEST:
                    raise
                steps *= 2  # explicit methods refuse a step at which springs grow
                continue
            off = self.motion.change(before, after).max(axis=0)
            spent = time.thread_time() - began
            if off.max() <= self.fine or 4 * steps > FINEST or spent > PATIENCE / 2.0:
                break
            steps, before = 2 * steps, after
        far = np.flatnonzero(off > self.fine)
        self.upto = int(far[0]) if len(far) else self.motion.records
        if not self.upto:
            at = self.motion.duration / self.motion.records
            most = f"{self.fine:.2g}, {self.fine / self.tolerance:.2g} of the tolerance"
            raise SimulationError(
                f"the scene with dt {self.motion.duration / steps:.3g} s differs by {off[0]:.2g} at t = {at:.3g} s "
                f"from itself with half of it, expected at most {most}; a shorter duration or a larger "
                "tolerance can be judged"
            )
        self.steps, self.certainty = steps, float(off[: self.upto].max())

    # --- measuring --------------------------------------------------------------------------------------------

    def reference(self, made: Lesser, steps: int, fresh: bool = False) -> tuple[Array, Array]:
        """Motions of the whole scene, up to the horizon, from states at which a lesser scene can start."""
        q, v, key = self.from_states(made, fresh)
        if (key, steps) not in self.known:
            whole = lesser(self.scene, Choice(), self.q0)
            self.known[key, steps] = self.motion.run(whole, q, v, steps, self.method, upto=self.upto)
        return self.known[key, steps]

    def from_states(self, made: Lesser, fresh: bool = False) -> tuple[Array, Array, Any]:
        """The states, and a key of them: scattered ones with the joints that are locked, and rest, where they are."""
        q, v = self.fresh if fresh else self.starts
        at_q, at_v = made.embedding.locked(self.scene.model.nv)
        if not len(at_q) or self.v0 is None or self.v0[at_v].any():
            return q, v, (fresh, b"", b"")
        q, v = q.copy(), v.copy()
        q[:, at_q], v[:, at_v] = made.embedding.base[at_q], 0.0
        return q, v, (fresh, at_q.tobytes(), made.embedding.base[at_q].tobytes())

    def changes(self, made: Lesser, method: str, steps: int, dtype: Any, fresh: bool, against: int) -> Array:
        """(samples,) largest changes of a lesser scene against the whole one."""
        truth = self.reference(made, against, fresh)
        q, v, _ = self.from_states(made, fresh)
        found = self.motion.run(made, q, v, steps, method, dtype, upto=self.upto)
        return np.asarray(self.motion.change(found, truth).max(axis=1))

    def stage(self, choice: Choice, label: tuple[str, str]) -> Stage:
        """Measure a choice at the fine step. Raises the errors of its run."""
        made = lesser(self.scene, choice, self.q0)
        method = self.method if self.method in made.scene.methods else made.scene.method
        change = self.changes(made, method, self.steps, WIDE, False, self.steps)
        return Stage(choice, made, float(change.max()), self._ns(made), label)

    def _ns(self, made: Lesser) -> float:
        method = self.method if self.method in made.scene.methods else made.scene.method
        return self._cost(made, method, self.steps, WIDE)

    def _cost(self, made: Lesser, method: str, steps: int, dtype: Any) -> float:
        whole = lesser(self.scene, Choice(), self.q0)
        beside = Timed(whole, self.from_states(whole)[:2], self.method, self.steps)
        return self.motion.cost(Timed(made, self.from_states(made)[:2], method, steps, dtype), beside)

    # --- parts ------------------------------------------------------------------------------------------------

    def alone(self, found: list[Candidate], tick: Callable[[], None]) -> list[tuple[Candidate, Part]]:
        """Measure each candidate alone; those of a rank only if lower ranks change too much."""
        rows: list[tuple[Candidate, Part]] = []
        whole, enough = self.whole, set[str]()
        dt = self.motion.duration / self.steps
        for x in sorted(found, key=lambda x: x.rank):
            tick()
            if x.rank and x.part in enough:
                continue
            if x.choice.points and touches(self.scene, x, self.dense[0]):
                continue
            moved = self._moved(x)
            if moved is not None:
                rows.append((x, Part(x.part, x.form, moved, math.nan, dt, math.nan, "needed", self._why(x))))
                continue
            try:
                made = self.stage(x.choice, (x.part, x.form))
            except SpatialDynError as error:
                rows.append((x, Part(x.part, x.form, math.inf, math.nan, dt, math.nan, "cannot", reason(error))))
                continue
            saved = 1.0 - made.ns / whole.ns
            good = self.judged(made.change)
            verdict, words = "needed" if not good else "saves nothing", self._why(x)
            words = words if good else "; ".join(x for x in (self.nearly(made.change), words) if x)
            rows.append((x, Part(x.part, x.form, made.change, made.ns, dt, saved, verdict, words)))
            if good and (x.simpler or saved > GAIN):
                enough.add(x.part)
        return [row for x in found for row in rows if row[0] is x]

    def _moved(self, x: Candidate) -> float | None:
        """The motion of locked joints in the whole scene, which locking removes, if it alone exceeds the tolerance."""
        if not x.choice.locked or self.motion.observe != "q":
            return None
        try:
            made = lesser(self.scene, x.choice, self.q0)
            q, _ = self.reference(made, self.steps)
        except SpatialDynError:
            return None
        least = 0.0
        model = self.scene.model
        for name in x.choice.locked:
            joint = model.joint(name)
            if joint.mimic is None and joint.nq == joint.nv:
                at = slice(joint.idx_q, joint.idx_q + joint.nq)
                least = max(least, float(abs(q[..., at] - made.embedding.base[at]).max()))
        return None if self.judged(least) else least

    def _why(self, x: Candidate) -> str:
        if not x.choice.locked:
            return why(self.scene, x, *self.dense)
        try:
            made = lesser(self.scene, x.choice, self.q0)
        except SpatialDynError:
            return ""
        return why(self.scene, x, *self.reference(made, self.steps))

    @cached_property
    def dense(self) -> tuple[Array, Array]:
        """Motions of the whole scene at many times."""
        made = lesser(self.scene, Choice(), self.q0)
        each = self.steps // self.motion.records
        finer = max(k for k in range(1, DENSE + 1) if each % k == 0)
        return self.motion.run(made, *self.starts, self.steps, self.method, upto=self.upto, finer=finer)

    # --- together ---------------------------------------------------------------------------------------------

    def together(self, rows: list[tuple[Candidate, Part]], tick: Callable[[], None]) -> tuple[list[Stage], list[Part]]:
        """Stages from the whole scene on, greedily: first parts that change nothing, then by savings per change."""
        stages = [self.whole]
        good = [(x, row) for x, row in rows if row.verdict == "saves nothing" and (x.simpler or row.saved > GAIN)]
        free = [(x, row) for x, row in good if row.change <= FREE * self.tolerance]
        rest = [(x, row) for x, row in good if row.change > FREE * self.tolerance]
        rest.sort(key=lambda pair: -pair[1].saved / pair[1].change)
        verdicts: dict[int, str] = {}
        groups = ([free] if free else []) + [[pair] for pair in rest]
        while groups:
            tick()
            group = groups.pop(0)
            choice = stages[-1].choice
            for x, _ in group:
                choice = choice | x.choice
            label = " and ".join(x.part for x, _ in group), group[0][0].form if len(group) == 1 else "left out"
            try:
                made = self.stage(choice, label)
                fine = self.judged(made.change)
                nothing = group is free and all(x.simpler for x, _ in group)  # whatever the noise of a time
                gains = nothing or made.ns <= WORSE * stages[-1].ns
            except SpatialDynError:
                fine = gains = False
            if fine and gains:
                made.labels = (*stages[-1].labels, *((x.part, x.form) for x, _ in group))
                stages.append(made)
            elif len(group) > 1:
                groups = [[pair] for pair in group] + groups
                continue
            for _, row in group:
                verdicts[id(row)] = "not with the others" if not fine else "left out" if gains else "saves nothing"
        return stages, [replace(row, verdict=verdicts.get(id(row), row.verdict)) for _, row in rows]

    # --- methods and steps ------------------------------------------------------------------------------------

    def trials(self, stage: Stage, methods: tuple[str, ...] | None, kinds: tuple[str, ...]) -> list[Trial]:
        """The coarsest step of each method that is good enough, the cheapest first; in float32 of the cheapest."""
        scene = stage.made.scene
        known = [x for x in (EXPLICIT_METHODS if methods is None else methods) if x in scene.methods]
        same = self.method if self.method in scene.methods else scene.method
        known = [x for x in known if METHODS in kinds or x == same]
        found = [trial for x in known for trial in self._coarsest(stage, x, WIDE)]
        found.sort(key=lambda x: x.ns * x.steps)
        best = next((x for x in found if self.judged(x.change)), None)
        if best is not None and PRECISION in kinds and scene.constraints is None:
            found += self._coarsest(stage, best.method, NARROW, best.steps)
        return sorted(found, key=lambda x: x.ns * x.steps)

    def _coarsest(self, stage: Stage, method: str, dtype: Any, least: int = 0) -> list[Trial]:
        """The Trial of the fewest steps that is good enough, or of the least change if none is."""
        base, finest, best = max(self.motion.base, least), 2 * self.steps, None
        doubled = {base << k for k in range(max(0, finest // base).bit_length())} | {max(base, self.steps)}
        for steps in [*sorted(x for x in doubled if x < finest), finest]:
            try:
                change = float(self.changes(stage.made, method, steps, dtype, False, finest).max())
            except SpatialDynError:
                change = math.inf
            if best is None or change < best[1]:
                best = steps, change
            if self.judged(change) or (dtype == NARROW and steps >= 4 * least):
                break
        if best is None or not math.isfinite(best[1]):
            return []
        ns = self._cost(stage.made, method, best[0], dtype)
        return [Trial(method, best[0], dtype, best[1], ns)]

    def finer(self, stage: Stage, trial: Trial) -> list[Trial]:
        """The Trial at half the step, if that is not below that of the reference and good enough."""
        steps = min(2 * trial.steps, 2 * self.steps)
        if steps == trial.steps:
            return []
        change = float(self.changes(stage.made, trial.method, steps, trial.dtype, False, 2 * self.steps).max())
        made = trial._replace(steps=steps, change=change)
        return [made] if self.judged(change) else self.finer(stage, made)

    def rows_of_trials(self, trials: list[Trial], taken: Trial | None) -> list[Part]:
        """A Part for each method and precision; savings are in addition to those of the parts left out."""
        if not trials:
            return []
        whole = self.whole
        full = whole.ns * self.steps
        rows = []
        for x in trials:
            dt = self.motion.duration / x.steps
            part = "precision" if x.dtype == NARROW else "method"
            form = f"{x.method}, {'float32, ' if x.dtype == NARROW else ''}dt {dt:.3g}"
            good = self.judged(x.change)
            verdict = "taken" if x is taken else "not taken" if good else "needed"
            words = "" if good else self.nearly(x.change) or "at no step that was tried within the tolerance"
            if verdict == "needed":
                verdict = "not taken"
            rows.append(Part(part, form, x.change, x.ns, dt, 1.0 - x.ns * x.steps / full, verdict, words))
        return rows

    # --- verification -----------------------------------------------------------------------------------------

    def verified(self, stage: Stage, trial: Trial) -> tuple[float, float, float]:
        """Largest change in fresh samples, its bound, and the whole scene's certainty in these samples."""
        made = stage.made
        errors = self.changes(made, trial.method, trial.steps, trial.dtype, True, 2 * self.steps)
        off = self.motion.change(self.reference(made, self.steps, True), self.reference(made, 2 * self.steps, True))
        certain = float(off.max())
        return float(errors.max()), error_bound(errors) + certain, certain
