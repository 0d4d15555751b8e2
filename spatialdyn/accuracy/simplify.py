"""Only what a scene requires: a smaller model, what it saves and what it costs."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_number, check_model, words
from ..calls.dynamics import calls
from ..calls.specialize import specialize
from ..calls.states import random_configuration
from ..engines.compiled import numba_kernels
from ..engines.programs import batch_kernels
from ..errors import ModelError, SpatialDynError
from ..model.model import Joint, Model

Array = NDArray[np.float64]

DROPPED = ("armature", "damping", "friction", "gravity")
TIMED = {"rnea": "qva", "aba": "qvt", "crba": "q"}  # and what each takes
FEW = 64  # states in which the two models are compared where no program is on SIMD lanes
SAMPLES = FEW if numba_kernels.PLAIN else 4096  # and where one is
PART = 512  # at a time: M of 128 freedoms are 64 MiB then
MOST = 0.999  # of the states, whose largest change says more of others than the largest of all
BATCH = 8 if numba_kernels.PLAIN else 1024  # samples of a timed call
REPEATS = 5  # of which the fastest counts


class Change(NamedTuple):
    """How much a quantity changes over the sampled states.

    absolute  the largest change of an entry
    relative  that over the largest entry there is
    most      what 999 of 1000 of these states are within
    """

    absolute: float
    relative: float
    most: float


class Savings(NamedTuple):
    """What a smaller model saves and what it costs.

    locked      {joint: coordinates at which it is frozen}, those of light links included
    dropped     what was set to zero
    nv          freedoms (before, after)
    operations  {"rnea", "aba", "crba"}: operations of the program of a sample (before, after)
    ns          the same: nanoseconds of a sample of a large batch, measured here and now (before, after)
    cost        {"M", "tau", "a"}: Change of what is left, see ``simplify``; empty where nothing is
    states      how many random ones the cost is of: in others the change may be larger
    """

    locked: dict[str, Any]
    dropped: tuple[str, ...]
    nv: tuple[int, int]
    operations: dict[str, tuple[int, int]]
    ns: dict[str, tuple[float, float]]
    cost: dict[str, Change]
    states: int

    def __str__(self) -> str:
        lines = [f"freedoms  {self.nv[0]} -> {self.nv[1]}"]
        if self.locked:
            lines.append("locked    " + ", ".join(self.locked))
        if self.dropped:
            lines.append("dropped   " + ", ".join(self.dropped))
        for name, (before, after) in self.operations.items():
            was, now = self.ns[name]
            lines.append(f"{name:<9} {before} -> {after} operations, {was:.3g} -> {now:.3g} ns")
        for name, change in self.cost.items():
            lines.append(
                f"{name:<9} changes by {change.absolute:.3g} in the worst of {self.states} sampled states, "
                f"{change.relative:.2g} of the largest, and by {change.most:.3g} in 99.9 % of them"
            )
        if not self.nv[1]:
            lines.append("nothing is left that moves, so no M, tau or a to compare")
        return "\n".join(lines)


def simplify(
    model: Model,
    lock: Mapping[str, ArrayLike] | Iterable[str] = (),
    merge_lighter_than: float = 0.0,
    drop: str | Iterable[str] = (),
) -> tuple[Model, Savings]:
    """A model with less in it, what that saves and what it costs.

    lock                joint name -> coordinates at which it is frozen, or names: frozen where they are neutral
    merge_lighter_than  mass [kg]: a joint that carries less in all is frozen where it is neutral, or at the nearest
                        limit if that is beyond it
    drop                some of "armature", "damping", "friction", "gravity": set to zero

    Returns the Model and its Savings. The cost is the largest difference between the two models over random states, a
    sample and no bound: 4096, or 64 of robots of more than 128 freedoms. What 99.9 % of them are within is beside it,
    which changes less from sample to sample. It is in the freedoms that are left: of M and, for the same v and a, of
    tau = rnea, with the frozen joints anywhere within their limits and at rest; and of a = aba, with a torque on the
    frozen joints that holds them as long as nothing accelerates. Lengths and angles are not weighed against each other:
    "relative" is of the largest entry.
    Raises  ModelError naming a joint, SpatialDynError for a mass or a name that makes no sense.

    >>> import spatialdyn as sd
    >>> small, savings = sd.simplify(sd.load_urdf("two_link"), lock={"joint2": 0.3})
    >>> small.nv, savings.nv
    (1, (2, 1))
    """
    if check_model(model).mimic_matrix is not None:
        raise ModelError(f'model "{model.name}" has mimic joints, expected one without (mimic=False) to simplify')
    dropped = words("drop", drop, DROPPED)
    locked = _locked(model, lock, merge_lighter_than)
    small = _without(model.reduced(locked), dropped)
    operations: dict[str, tuple[int, int]] = {}
    ns: dict[str, tuple[float, float]] = {}
    for name in TIMED:
        operations[name] = (_operations(model, name), _operations(small, name))
        ns[name] = (_nanoseconds(model, name), _nanoseconds(small, name))
    states = SAMPLES if model.nv <= batch_kernels.MOST_ROWS else FEW
    cost = _cost(model, small, states)
    return small, Savings(locked, dropped, (model.nv, small.nv), operations, ns, cost, states if cost else 0)


# --- the smaller model -----------------------------------------------------------------------------------


def _locked(model: Model, lock: Any, lightest: float) -> dict[str, Any]:
    """Joints to freeze, and where."""
    if not 0.0 <= as_number(lightest) < math.inf:
        raise SpatialDynError(f"merge_lighter_than is {lightest!r}, expected a finite mass >= 0")
    if isinstance(lock, Mapping):
        locked = dict(lock)
    else:
        try:
            names = [lock] if isinstance(lock, str) else list(lock)
        except TypeError:
            what = "expected names of joints, or a mapping of them to coordinates"
            raise SpatialDynError(f"lock is {lock!r}, {what}") from None
        locked = {name: _resting(model, joint) for name, joint in zip(names, map(model.joint, names), strict=True)}
    if lightest > 0.0:
        carried = model.bodies["inertia"]["m"][[j.row for j in model.joints]]
        for k in range(model.njoints - 1, 0, -1):
            carried[model.joints[k].parent] += carried[k]
        for joint, mass in zip(model.joints[1:], carried[1:], strict=True):
            if mass < lightest and joint.name not in locked:
                locked[joint.name] = _resting(model, joint)
    return locked


def _resting(model: Model, joint: Joint) -> Any:
    """A joint's neutral coordinates, moved to a limit where they are beyond it; a float where there is one."""
    place = slice(joint.idx_q, joint.idx_q + joint.nq)
    q = np.asarray(calls["neutral"](model))[place]
    if joint.nq == 1:
        return float(np.clip(q[0], model.lower[place][0], model.upper[place][0]))
    return q.tolist()


def _without(model: Model, dropped: tuple[str, ...]) -> Model:
    """A Model with some of its properties zero."""
    if not dropped:
        return model
    zeros: dict[str, Any] = {name: 0.0 for name in dropped if name != "gravity"}
    joints = tuple(replace(j, **zeros) for j in model.robot.joints)
    made = Model(replace(model.robot, joints=joints), model.options)
    return made.with_(gravity=(0.0, 0.0, 0.0)) if "gravity" in dropped else made


# --- what it saves ---------------------------------------------------------------------------------------


def _operations(model: Model, name: str) -> int:
    """Operations of a call's program, 0 where nothing moves."""
    return sum(specialize(model, calls[name]).operations.values()) if model.nv else 0


def _nanoseconds(model: Model, name: str) -> float:
    """Time of a sample of a batch, the fastest of a few runs."""
    if not model.nv:
        return 0.0
    rng = np.random.default_rng(0)
    given = {"q": random_configuration(model, rng, BATCH)}
    given.update((x, rng.normal(size=(BATCH, model.nv))) for x in "vat")
    call, arrays = calls[name], [given[x] for x in TIMED[name]]
    call(model, *arrays)  # compiled
    best = math.inf
    for _ in range(REPEATS):
        start = time.perf_counter()
        call(model, *arrays)
        best = min(best, time.perf_counter() - start)
    return best / BATCH * 1e9


# --- what it costs ---------------------------------------------------------------------------------------


def _cost(model: Model, small: Model, states: int) -> dict[str, Change]:
    """Changes of M, tau and a in the freedoms that both have, if any, over so many states."""
    if not small.nv:
        return {}
    rng = np.random.default_rng(0)
    q = random_configuration(model, rng, states)
    in_q, in_v = _places(model, small)
    frozen = np.setdiff1d(np.arange(model.nv), in_v)
    v, a, tau = rng.normal(size=(3, states, model.nv))
    v[:, frozen] = a[:, frozen] = 0.0
    tau *= abs(np.asarray(calls["rnea"](model, q, v, a))).max() / abs(tau).max()
    tau[:, frozen] = np.asarray(calls["nonlinear_effects"](model, q, v))[:, frozen]
    changes: dict[str, list[Array]] = {"M": [], "tau": [], "a": []}
    sizes = dict.fromkeys(changes, 0.0)
    for first in range(0, states, PART):
        given = {"q": q, "v": v, "a": a, "t": tau}
        given = {name: np.ascontiguousarray(x[first : first + PART]) for name, x in given.items()}
        part = {name: np.ascontiguousarray(x[:, in_q if name == "q" else in_v]) for name, x in given.items()}
        for of, name in (("M", "crba"), ("tau", "rnea"), ("a", "aba")):
            letters = TIMED[name]
            before = np.asarray(calls[name](model, *(given[x] for x in letters)))[:, in_v]
            before = before[:, :, in_v] if of == "M" else before
            after = np.asarray(calls[name](small, *(part[x] for x in letters)))
            changes[of].append(abs(after - before).reshape(len(after), -1).max(axis=1))
            sizes[of] = max(sizes[of], float(abs(before).max()))
    return {of: _change(np.concatenate(parts), sizes[of]) for of, parts in changes.items()}


def _places(model: Model, small: Model) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Where in q and in v of a model the entries of a smaller one are."""
    in_q: list[int] = []
    in_v: list[int] = []
    for joint in small.joints[1:]:
        whole = model.joint(joint.name)
        in_q += range(whole.idx_q, whole.idx_q + whole.nq)
        in_v += range(whole.idx_v, whole.idx_v + whole.nv)
    return np.array(in_q, np.intp), np.array(in_v, np.intp)


def _change(off: Array, size: float) -> Change:
    """Of the largest change in each state, and the largest entry of all."""
    largest = float(off.max())
    relative = largest / size if size > 0.0 else 0.0 if largest == 0.0 else math.inf
    return Change(largest, relative, float(np.quantile(off, MOST)))
