"""A smaller model with locked joints and dropped terms: time saved and error made."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_number, as_words, check_model
from ..calls.dynamics import calls
from ..calls.random_configurations import random_configuration
from ..calls.specialize import specialize
from ..engines.compiled import numba_kernels
from ..engines.programs.record import recording
from ..errors import SpatialDynError, literal
from ..model.changes import lock_values, resting_beside
from ..model.model import Model
from ..waiting import watch

Array = NDArray[np.float64]

DROPPED = ("armature", "damping", "friction", "gravity")
TIMED = {"rnea": "qva", "aba": "qvt", "crba": "q"}  # the timed calls and their inputs
FEW = 64  # states in which the two models are compared if no program runs on SIMD lanes
SAMPLES = FEW if numba_kernels.PLAIN else 4096  # states if programs run on lanes
PART = 512  # states at a time: their M of 128 freedoms take 64 MiB
MOST = 0.999  # a quantile of the states: it predicts other states better than the maximum
BATCH = 8 if numba_kernels.PLAIN else 1024  # samples of a timed call
REPEATS = 5  # the fastest counts


class Change(NamedTuple):
    """Change of a quantity over the sampled states.

    absolute  the largest change of an entry
    relative  the largest change over the largest entry
    most      the 99.9 % quantile of the largest changes in the states
    """

    absolute: float
    relative: float
    most: float


class Savings(NamedTuple):
    """Savings and errors of a smaller model.

    locked      {joint: coordinates at which it is locked}, those of light links included
    dropped     names of the properties set to zero
    nv          freedoms (before, after)
    operations  {"rnea", "aba", "crba"}: operations of the program per sample (before, after)
    ns          the same calls: measured nanoseconds per sample of a large batch (before, after)
    cost        {"M", "tau", "a"}: Change in the remaining freedoms, see ``simplify``; empty without freedoms
    states      number of random states of the cost; in other states the change may be larger
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


@watch.call("simplify")
def simplify(
    model: Model,
    lock: Mapping[str, ArrayLike] | Iterable[str] = (),
    merge_lighter_than: float = 0.0,
    drop: str | Iterable[str] = (),
) -> tuple[Model, Savings]:
    """A smaller model, the time that it saves and the error that it makes.

    lock                as ``Model.reduced`` takes it: joint name -> coordinates, or names: locked at rest
    merge_lighter_than  mass [kg]: a joint whose subtree is lighter is locked at neutral, or at its nearest limit if
                        neutral is outside the limits; with the joints that mimic it, if those carry less together
    drop                some of "armature" (rotors too), "damping", "friction", "gravity": set to zero

    Returns the Model and its Savings. The error is the largest difference between the two models over 4096 random
    states, 64 for robots of more than 128 freedoms: a sample, not a bound; its 99.9 % quantile varies less from sample
    to sample. Differences are in the remaining freedoms: of M and, for the same v and a, of tau = rnea, with the locked
    joints at rest anywhere within their limits; and of a = aba, with a torque on the locked joints that holds them if
    nothing accelerates. "relative" is over the largest entry of any unit.
    Raises  ModelError naming a joint, SpatialDynError for an invalid mass or name.

    >>> import spatialdyn as sd
    >>> small, savings = sd.simplify(sd.load_urdf("two_link"), lock={"joint2": 0.3})
    >>> small.nv, savings.nv
    (1, (2, 1))
    """
    check_model(model)
    dropped = as_words("drop", drop, DROPPED)
    locked = _locked(model, lock, merge_lighter_than)
    small = _without(model.reduced(locked), dropped)
    operations: dict[str, tuple[int, int]] = {}
    ns: dict[str, tuple[float, float]] = {}
    for name in TIMED:
        operations[name] = (_operations(model, name), _operations(small, name))
        ns[name] = (_nanoseconds(model, name), _nanoseconds(small, name))
    states = SAMPLES if model.nv <= recording.MOST_ROWS else FEW
    cost = _cost(model, small, states)
    return small, Savings(locked, dropped, (model.nv, small.nv), operations, ns, cost, states if cost else 0)


# --- the smaller model -----------------------------------------------------------------------------------


def _locked(model: Model, lock: Any, lightest: float) -> dict[str, Any]:
    """{joint: coordinates} of the joints to lock."""
    if not 0.0 <= as_number(lightest) < math.inf:
        raise SpatialDynError(f"merge_lighter_than is {literal(lightest)}, expected a finite mass >= 0")
    locked = lock_values(model, lock)
    if lightest > 0.0:
        mass = model.bodies["inertia"]["m"][[j.row for j in model.joints]]
        moves = [{k} for k in range(model.njoints)]  # joints that move with each joint
        for k in range(model.njoints - 1, 0, -1):
            moves[model.joints[k].parent] |= moves[k]
        for k, joint in enumerate(model.joints):
            if joint.mimic is not None:
                moves[joint.mimic[0]] |= moves[k]
        rotors = {j.name for j in model.robot.joints if j.spring is not None}  # without a link's mass, not without use
        for k, joint in enumerate(model.joints[1:], start=1):
            moved = sorted(moves[k if joint.mimic is None else joint.mimic[0]])
            if mass[moved].sum() < lightest and joint.name not in {*locked, *rotors}:
                locked[joint.name] = resting_beside(model, joint, locked)
    return locked


def _without(model: Model, dropped: tuple[str, ...]) -> Model:
    """The Model with the dropped properties set to zero."""
    if not dropped:
        return model
    zeros: dict[str, Any] = {name: 0.0 for name in dropped if name != "gravity"}
    zeros |= {"rotor": None, "shared": None} if "armature" in dropped else {}
    joints = tuple(replace(j, **zeros) for j in model.robot.joints)
    made = Model(replace(model.robot, joints=joints), model.options)
    return made.with_(gravity=(0.0, 0.0, 0.0)) if "gravity" in dropped else made


# --- savings -------------------------------------------------------------------------------------------


def _operations(model: Model, name: str) -> int:
    """Operations of a call's program, 0 without freedoms."""
    return sum(specialize(model, calls[name]).operations.values()) if model.nv else 0


def _nanoseconds(model: Model, name: str) -> float:
    """Time per sample of a batch [ns], of the fastest of a few runs."""
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


# --- cost ----------------------------------------------------------------------------------------------


def _cost(model: Model, small: Model, states: int) -> dict[str, Change]:
    """Changes of M, tau and a in the remaining freedoms over random states; {} without any."""
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
    """Indices in q and in v of a model of the entries of a smaller one."""
    in_q: list[int] = []
    in_v: list[int] = []
    for joint in small.joints[1:]:
        if joint.mimic is not None:
            continue
        whole = model.joint(joint.name)
        in_q += range(whole.idx_q, whole.idx_q + whole.nq)
        in_v += range(whole.idx_v, whole.idx_v + whole.nv)
    return np.array(in_q, np.intp), np.array(in_v, np.intp)


def _change(off: Array, size: float) -> Change:
    """The Change of ``off``, the largest change in each state, with ``size`` the largest entry."""
    largest = float(off.max())
    relative = largest / size if size > 0.0 else 0.0 if largest == 0.0 else math.inf
    return Change(largest, relative, float(np.quantile(off, MOST)))
