"""``solve_ik``: joint positions that bring frames to poses or points, for many targets at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..algebra.lie import larger
from ..calls.arguments import (
    as_count,
    as_finite,
    as_flag,
    as_number,
    broadcast,
    check_model,
    frame_row_and_placement,
    pose_fault,
)
from ..calls.dynamics import calls
from ..calls.random_configurations import random_configuration
from ..engines.programs.record.mimic_rows import evaluate
from ..errors import ShapeError, SpatialDynError, literal
from ..model.model import Frame, Model
from ..recursions import SPECS
from ..recursions.control.inverse_kinematics import damped_step, put_error
from ..recursions.spec import LOCAL_WORLD_ALIGNED, Argument, Spec
from ..waiting import watch
from .programs import repeated

Array = NDArray[np.float64]
WHY = np.array(["converged", "stuck", "exhausted"])  # why a search stopped
CONVERGED, STUCK, EXHAUSTED = range(3)
BEYOND = 1e300  # rad, m: limit of a joint without limits
STEPS, PROGRESS = 6, 0.9  # within these steps the residual must fall to this share
FILL = 128  # attempts side by side: fewer take hardly less time
SAME = 1e-4  # rad, m: solutions that differ by less count as one


class IKResult(NamedTuple):
    """The answer for each target (...):

    q           (..., nq)  the best configuration found
    residual    (..., 2)   largest remaining distance [m] and angle [rad] from a target
    converged   (...)      whether both are within the tolerance
    iterations  (...)      number of steps, of all starts together
    starts      (...)      number of starts that were tried
    why         (...)      "converged"; otherwise, for the best start, "stuck" if its steps made no progress,
                "exhausted" if it took all allowed steps
    solutions   with ``all_solutions`` a list of the distinct solutions (k, nq) of each target, flat; else None
    """

    q: Array
    residual: Array
    converged: NDArray[np.bool_]
    iterations: NDArray[np.intp]
    starts: NDArray[np.intp]
    why: NDArray[np.str_]
    solutions: list[Array] | None


@watch.call("solve_ik")
def solve_ik(
    model: Model,
    targets: Mapping[str | Frame, ArrayLike],
    q0: ArrayLike | None = None,
    *,
    limits: bool = True,
    tolerance: float = 1e-8,
    restarts: int = 20,
    iterations: int = 40,
    seed: int = 0,
    all_solutions: bool = False,
) -> IKResult:
    """Joint positions that bring frames to their targets: inverse kinematics for any batch of targets.

    targets        {frame: pose (..., 4, 4) or position (..., 3)} in the world [m]
    q0             (..., nq)  where the search starts [rad | m]; left out, the middle of the limits, or neutral
    limits         whether positions stay within the limits of the model
    tolerance      largest distance [m] and angle [rad] from a target
    restarts       starts after the first, from random configurations within the limits, the same for all targets
    iterations     largest number of steps of a start
    seed           seed of the random starts
    all_solutions  whether every start is tried, and all distinct configurations that they find are returned

    Damped Gauss-Newton steps on the joints' group, the targets side by side on SIMD lanes; a start whose residual no
    longer falls is abandoned. The result for a target does not depend on the others. Redundant robots have infinitely
    many solutions, of which a few are found. For tasks with priorities, velocity limits and collisions see pink or
    mink.

    Returns IKResult.
    Raises  ModelError for an unknown frame; ShapeError, NonFiniteError; SpatialDynError for a target that is no pose,
            and for settings out of range
    Source  Sugihara, Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method (2011).

    >>> import numpy as np, spatialdyn as sd
    >>> model = sd.load_urdf("ur5")
    >>> goal = sd.frame_placement(model, [0.1, -1.0, 1.2, 0.3, 0.5, 0.2], "tool0")
    >>> found = sd.solve_ik(model, {"tool0": goal})
    >>> bool(found.converged), bool(abs(sd.frame_placement(model, found.q, "tool0") - goal).max() < 1e-7)
    (True, True)
    """
    check_model(model)
    limits, all_solutions = as_flag("limits", limits), as_flag("all_solutions", all_solutions)
    frames, poses, sizes = _targets(model, targets)
    start = _first(model, limits) if q0 is None else as_finite("q0", q0)
    if start.shape[-1:] != (model.nq,):
        raise ShapeError(f"q0 has shape {start.shape}, expected (..., {model.nq})")
    near = as_number(tolerance)
    if not 0.0 < near < 1.0:
        raise SpatialDynError(f"tolerance is {literal(tolerance)}, expected a number between 0 and 1")
    more = as_count(restarts, 10**6)
    if not more and (as_number(restarts) != 0.0 or isinstance(restarts, (float, np.floating))):
        raise SpatialDynError(f"restarts is {literal(restarts)}, expected a whole number from 0 to 1000000")
    if not (steps := as_count(iterations, 10**6)):
        raise SpatialDynError(f"iterations is {literal(iterations)}, expected a whole number from 1 to 1000000")
    batch = broadcast(["q0", "targets"], [start.shape[:-1], poses.shape[:-3]])
    calls["potential_energy"](model, start)  # raises ConfigurationError naming the joint
    lead = np.broadcast_to(poses, (*batch, *poses.shape[-3:])).reshape(-1, 16 * len(sizes))
    first = np.broadcast_to(start, (*batch, model.nq)).reshape(-1, model.nq)
    if limits:
        first = np.clip(first, model.lower, model.upper)
    others = random_configuration(model, seed, (more,))
    search = _Search(model, _spec(sizes), frames, lead, limits, near, steps)
    found, solutions = search.run(first, others, all_solutions)
    q, residual, count, starts, why = (x.reshape((*batch, *x.shape[1:])) for x in found)
    return IKResult(q, residual, why == WHY[CONVERGED], count, starts, why, solutions)


def _targets(model: Model, targets: Any) -> tuple[tuple[Any, ...], Array, tuple[int, ...]]:
    """Rows and placements of the frames, poses (..., K, 4, 4), and the number of equations of each."""
    if not isinstance(targets, Mapping) or not targets:
        raise SpatialDynError(f"targets are {literal(targets)}, expected a mapping of frames to poses or positions")
    frames: list[Any] = []
    poses: list[Array] = []
    sizes: list[int] = []
    for name, value in targets.items():
        frames += frame_row_and_placement(model, name)
        x = as_finite(f"target of {name}", value)
        if x.shape[-2:] == (4, 4):
            if fault := pose_fault(x):
                raise SpatialDynError(f"target of {name} has {fault}, expected a pose")
            poses.append(x)
        elif x.shape[-1:] == (3,):
            pose = np.zeros((*x.shape[:-1], 4, 4))
            pose[..., :, :] = np.eye(4)
            pose[..., :3, 3] = x
            poses.append(pose)
        else:
            raise ShapeError(f"target of {name} has shape {x.shape}, expected (..., 4, 4) or (..., 3)")
        sizes.append(6 if x.shape[-2:] == (4, 4) else 3)
    batch = broadcast([f"target of {name}" for name in targets], [x.shape[:-2] for x in poses])
    return tuple(frames), np.stack([np.broadcast_to(x, (*batch, 4, 4)) for x in poses], -3), tuple(sizes)


def _first(model: Model, limits: bool) -> Array:
    """The middle of the limits where both are finite, neutral elsewhere."""
    q: Array = np.array(calls["neutral"](model))
    both = np.isfinite(model.lower) & np.isfinite(model.upper)
    if limits:
        q[both] = 0.5 * (model.lower[both] + model.upper[both])
    return q


# --- the step -------------------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def _spec(sizes: tuple[int, ...]) -> Spec:
    """A step for frames with these numbers of equations: the next q, and the residual at this q."""
    placement, jacobian = SPECS["frame_placement"], SPECS["frame_jacobian"]
    ends = [sum(sizes[:k]) for k in range(len(sizes) + 1)]
    m = ends[-1]

    def recursion(rows: Any, state: Any, target: Any, lower: Any, upper: Any, *others: Any) -> None:
        (*static, out), n = others, len(rows) - 1
        q = state[:-2]
        J, e = np.zeros((m, n), object), np.zeros(m, object)
        distance, angle = 0.0, 0.0
        for k, size in enumerate(sizes):
            row, place = static[2 * k : 2 * k + 2]
            given = {"q": q, "row": row, "placement": place, "reference": LOCAL_WORLD_ALIGNED}
            X = evaluate(placement, rows, (4, 4), given, None)
            turns = size == 6
            p, w = put_error(X, target.reshape(-1, 4, 4)[k], ends[k], turns, e)
            J[ends[k] : ends[k + 1]] = evaluate(jacobian, rows, (6, n), given, None)[:size]
            distance, angle = (p, w) if k == 0 else (larger(distance, p), larger(angle, w))
        out[-2], out[-1] = distance, angle
        damped_step(
            rows, q, lower, upper, J, e, np.zeros((m, m), object), np.zeros(m, object), np.zeros(n, object), out[:-2]
        )

    named = zip(range(len(sizes)), sizes, strict=True)
    static = [
        x for k, _ in named for x in (
            Argument(f"row_{k}", (), "", "", static=True), Argument(f"placement_{k}", (4, 4), "m", "", static=True)
        )
    ]  # fmt: skip
    bounds = Argument("lower", ("nq",), "rad | m", "limits"), Argument("upper", ("nq",), "rad | m", "limits")
    name = "ik_step_" + "_".join(map(str, sizes))
    state = Argument("ik_state", ("nq+2",), "", "q, and squares of distance and angle that were left before the step")
    return Spec(
        name, recursion, None, (state, Argument("target", (16 * len(sizes),), "m", "poses"), *bounds, *static),
        replace(state, name="ik_after"), "A step of inverse kinematics.", "Sugihara (2011).", composed=True,
    )  # fmt: skip


# --- the search -----------------------------------------------------------------------------------------


class _Attempts(NamedTuple):
    """n attempts, each from one start to one target.

    target, start  (n,) index of the target, and of the start
    state          (n, nq + 2) the present q, and the residual before it
    step, steps    (n,) steps taken, and steps to the best q
    least          (n,) the least residual of earlier rounds
    q, left        (n, nq), (n, 2) the best q, and its residual
    why            (n,) index into WHY: why the attempt ended
    """

    target: NDArray[np.intp]
    start: NDArray[np.intp]
    state: Array
    step: NDArray[np.intp]
    steps: NDArray[np.intp]
    least: Array
    q: Array
    left: Array
    why: NDArray[np.intp]

    @classmethod
    def of(cls, target: NDArray[np.intp], start: NDArray[np.intp], q: Array) -> _Attempts:
        """Attempts that begin at q (n, nq)."""
        n, none = len(q), np.zeros(len(q), np.intp)
        state, inf = np.concatenate([q, np.zeros((n, 2))], 1), np.full((n, 2), np.inf)
        return cls(target, start, state, none, none, inf[:, 0], q, inf, np.full(n, EXHAUSTED))

    @classmethod
    def all(cls, parts: list[_Attempts]) -> _Attempts:
        """All attempts of several lists."""
        return cls(*(np.concatenate(x) for x in zip(*parts, strict=True)))

    def some(self, chosen: NDArray[Any]) -> _Attempts:
        """The attempts chosen by a mask or by indices."""
        at: NDArray[Any] = np.flatnonzero(chosen) if chosen.dtype == np.bool_ else chosen
        return _Attempts(*(x[at] for x in self))

    def beside(self, other: _Attempts) -> _Attempts:
        """These attempts and others."""
        return _Attempts.all([self, other]) if len(other.target) else self

    def moved(self, after: Array, tolerance: float, most: int) -> tuple[_Attempts, NDArray[np.bool_]]:
        """The attempts after steps (n, STEPS, nq + 2), and which of them have ended."""
        n, nq = len(self.q), self.q.shape[1]
        row = np.arange(n)
        square = np.maximum(after[:, :, nq], after[:, :, nq + 1])  # written out: faster than a max over two
        square[np.isnan(square)] = np.inf
        more = most - self.step  # steps still allowed; a round takes STEPS
        if len(more) and more.min() < STEPS:
            square[np.arange(STEPS) > more[:, None]] = np.inf
        good = square <= tolerance * tolerance
        done = good.any(1)
        k = np.where(done, good.argmax(1), square.argmin(1))  # of the states before the steps, the one to keep
        lowest = np.sqrt(square[row, k])
        better = (lowest < np.maximum(self.left[:, 0], self.left[:, 1]))[:, None]
        where = np.where((k == 0)[:, None], self.state[:, :nq], after[row, k - 1, :nq])
        q, left = np.where(better, where, self.q), np.where(better, np.sqrt(after[row, k, nq:]), self.left)
        stuck = ~done & ~(lowest < PROGRESS * self.least)
        step = self.step + STEPS
        why = np.where(done, CONVERGED, np.where(stuck, STUCK, EXHAUSTED))
        steps, least = self.steps + np.where(done, k, np.minimum(more, STEPS)), np.minimum(self.least, lowest)
        made = self._replace(state=after[:, -1], step=step, steps=steps, least=least, q=q, left=left, why=why)
        return made, done | stuck | (step > most)


class _Search(NamedTuple):
    """The search for many targets; targets are (B, 16 K)."""

    model: Model
    spec: Spec
    frames: tuple[Any, ...]
    targets: Array
    limits: bool
    tolerance: float
    most: int

    def run(self, first: Array, others: Array, every: bool) -> tuple[list[Any], list[Array] | None]:
        """(q, residual, iterations, starts, why) of each target, from its first start that converges; all solutions.

        Attempts step side by side. When few are left, further ones begin before it is known whether they are needed,
        and do not count if they are not: no result depends on the other targets.
        """
        model, B, nq = self.model, len(self.targets), self.model.nq
        ends = (model.lower, model.upper) if self.limits else (np.full(nq, -np.inf), np.full(nq, np.inf))
        bounds = [np.clip(x, -BEYOND, BEYOND)[None] for x in ends]  # finite numbers, as lanes take them
        begun, won = np.ones(B, np.intp), np.full(B, len(others) + 1)  # starts of each target; the first that converged
        x = _Attempts.of(np.arange(B), np.zeros(B, np.intp), first)
        over = [x.some(np.zeros(B, np.bool_))]
        while len(x.target):
            after = repeated(self.spec, model, self.frames, x.state, [self.targets[x.target]], bounds, STEPS)
            x, ends_now = x.moved(after, self.tolerance, self.most)
            over.append(x.some(ends_now))
            done = ends_now & (x.why == CONVERGED)
            np.minimum.at(won, x.target[done], x.start[done])
            x = x.some(~ends_now & (every | (x.start < won[x.target])))
            open_ = np.flatnonzero((begun <= len(others)) & (every | (won > len(others))))
            idle = np.bincount(x.target, minlength=B)[open_] == 0
            spare = max(0, (FILL - len(x.target) - int(idle.sum())) // max(1, len(open_)))
            more = np.minimum(idle + spare, len(others) + 1 - begun[open_])
            target = np.repeat(open_, more)
            start = begun[target] + np.arange(len(target)) - np.repeat(np.cumsum(more) - more, more)
            begun[open_] += more
            x = x.beside(_Attempts.of(target, start, others[start - 1]))
        return self._chosen(_Attempts.all(over), won, B, every)

    def _chosen(self, x: _Attempts, won: NDArray[np.intp], B: int, every: bool) -> tuple[list[Any], list[Array] | None]:
        """The results of attempts that have ended."""
        x = x.some(every | (x.start <= won[x.target]))
        good = x.why == CONVERGED
        order = np.lexsort((x.start, np.where(good, 0.0, x.left.max(1)), x.target))
        best = x.some(order[np.unique(x.target[order], return_index=True)[1]])
        counts = np.bincount(x.target, x.steps, B).astype(np.intp), np.bincount(x.target, minlength=B)
        found = [best.q, best.left, *counts, WHY[best.why]]
        if not every:
            return found, None
        solutions: list[list[Array]] = [[] for _ in range(B)]
        for j in np.lexsort((x.start, x.target)):
            if good[j]:
                self._add(solutions[x.target[j]], x.q[j])
        return found, [np.array(y) if y else np.empty((0, self.model.nq)) for y in solutions]

    def _add(self, known: list[Array], q: Array) -> None:
        difference: Any = calls["difference"]
        for x in known:
            way = np.asarray(difference(self.model, x, q))
            if abs(way - 2.0 * np.pi * np.round(way / (2.0 * np.pi)) * self._turns).max() < SAME:
                return
        known.append(q)

    @property
    def _turns(self) -> Array:
        """1 for freedoms that turn without limits, for which whole turns give the same solution; 0 for others."""
        made = np.zeros(self.model.nv)
        for joint in self.model.joints[1:]:
            if joint.nv == 1 and joint.kind in ("continuous", "revolute"):
                endless = not self.limits or not np.isfinite(self.model.upper[joint.idx_q])
                made[joint.idx_v] = float(endless)
        return made
