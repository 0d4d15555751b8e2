"""The comparison of one robot: every public call, entry by entry, on random states.

An error is max |x - x_pin| / max(1, max |x_pin|) of one result, the largest over all samples, frames and references.
Forward dynamics and the inverse of M are judged by their residual: Pinocchio's RNEA of the result must give the torque,
Pinocchio's M times the result must give 1. Their values are compared only if M is well conditioned. No float64 result x
has a residual below the rounding of its entries, about eps |M| |x|: a residual above BOUND may be up to four times
that, and the row's note says so (icub's M has a condition number of 4e10: the exact acceleration, rounded, misses tau
by 3e-8). Derivatives of forward dynamics are taken at an acceleration, which is rounded too: the change of their
torques when it is refined counts as rounding.
"""

from __future__ import annotations

import difflib
import warnings
from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_count, as_flag, as_items
from ..calls.progress import Progress, Steps, check_progress, reporting
from ..calls.random_configurations import generator
from ..errors import InertiaError, NonFiniteError, SpatialDynError, literal
from ..model.model import Model
from ..urdf.load import load_urdf
from .calls import BY_LABEL, CALLS, FORWARD, Call, ours_of
from .identities import by_identity
from .measures import (
    BOUND,
    RAISED,
    VALUE_BOUND,
    WELL_CONDITIONED,
    raised,
    rounding,
    scaled_error,
    singular,
    sort_key,
    unit_diagonal,
)
from .peer import Peer, pinocchio, pinocchio_model, pinocchio_twin
from .rows import Comparison, Row, judged
from .states import States, random_states
from .times import times_of

Array = NDArray[np.float64]

MOST_SAMPLES = 1_000_000
SOLVED = (*FORWARD, "minverse", "aba_derivatives")  # through M⁻¹: judged by their residual
OMITTED = (
    "left out where M is ill conditioned or Pinocchio's own residual above half the bound"  # note of a row of values
)
_CRASHES_WITHOUT_FREEDOMS = ("getFrameJacobian", "getFrameJacobianTimeVariation")  # seen with Pinocchio 4.1


def compare_with_pinocchio(
    source: Any,
    root: str | None = None,
    samples: int = 20,
    seed: int = 0,
    timing: bool = False,
    continuous: str | None = None,
    progress: Progress = False,
    calls: Collection[str] | None = None,
) -> Comparison:
    """Compare every public call with Pinocchio's on random states.

    source      path, URDF text or the name of a robot, as in ``load_urdf``; or a Model, compared as it is with a
                Pinocchio model built joint by joint
    root        "fixed" (default) or "floating"; a Model has its own
    samples     number of random states, at least 1
    seed        seed of the random states
    timing      True: also time single calls of both from Python, medians of interleaved rounds
    continuous  as in ``load_urdf``, by default "cos_sin"; "angle" agrees with Pinocchio only on robots without
                continuous joints. A Model has its own
    progress    True for a bar (needs rich), or a function of the number of calls compared and their total
    calls       names of the calls to compare, e.g. ("rnea", "crba"); all if left out

    >>> import spatialdyn as sd
    >>> sd.compare_with_pinocchio("two_link", samples=2).ok
    True

    Raises SpatialDynError if Pinocchio is not installed, does not load the robot, has other sizes or lacks a joint of
    the Model, and for a name that is no call; UrdfError as ``load_urdf``.
    """
    pin = pinocchio()
    asked = _asked(calls)
    count = as_count(samples, MOST_SAMPLES)
    if not count:
        raise SpatialDynError(f"samples is {literal(samples)}, expected a whole number of 1 to {MOST_SAMPLES}")
    rng, timed = generator("seed", seed), as_flag("timing", timing)
    check_progress(progress)
    model, pin_model = _both_models(source, root, continuous)
    if (model.nq, model.nv, model.njoints) != (pin_model.nq, pin_model.nv, pin_model.njoints):
        raise SpatialDynError(
            f'robot "{model.name}" has nq {model.nq}, nv {model.nv}, {model.njoints} joints, and in Pinocchio '
            f"{pin_model.nq}, {pin_model.nv}, {pin_model.njoints}"
        )
    peer = Peer(pin, pin_model, model)
    states = random_states(model, count, rng)
    rows = [_joint_order(model, pin_model)]
    with reporting(progress, "compare") as report:
        rows += _rows(asked, peer, states, timed, Steps(report, len(asked)))
    return Comparison(model.name, model.options.root, model.nq, model.nv, count, tuple(rows))


def _asked(names: Collection[str] | None) -> Sequence[Call]:
    """The rows of the table of calls with these names."""
    if names is None:
        return CALLS
    if isinstance(names, str):
        raise SpatialDynError(f'calls is "{names}", expected names of calls, ("{names}",) for one')
    names = as_items("calls", names, str, "names of calls")
    known = {call.name for call in CALLS}
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(str(name), known, 3, 0.5) or sorted(known)
            raise SpatialDynError(f"calls has {literal(name)}, expected some of {', '.join(near)}")
    return [call for call in CALLS if call.name in names]


def _rows(calls: Sequence[Call], peer: Peer, states: States, timing: bool, steps: Steps) -> Iterator[Row]:
    """The rows of those calls."""
    model = peer.ours
    other = _other_question(model)
    for call in calls:
        why = (other or _left_out(call, model)) if call.peer else "Pinocchio has no such call"
        if why:
            yield by_identity(call, model, states, why)
        else:
            yield from _compared(call, model, peer, states, timing)
        steps.next()


def _both_models(source: Any, root: str | None, continuous: str | None) -> tuple[Model, Any]:
    """Our Model and Pinocchio's."""
    if isinstance(source, Model):
        for name, value in (("root", root), ("continuous", continuous)):
            if value not in (None, getattr(source.options, name)):
                own = getattr(source.options, name)
                raise SpatialDynError(f'{name} is {literal(value)}, expected "{own}", which the Model was made with')
        return source, pinocchio_twin(source)
    root = "fixed" if root is None else root
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = load_urdf(source, root=root, continuous="cos_sin" if continuous is None else continuous)
    return model, pinocchio_model(source, root)


def _other_question(model: Model) -> str:
    """Why Pinocchio computes another robot; empty if it does not."""
    for joint in model.joints[1:]:
        if joint.kind == "planar" and joint.axis.tolist() != [0.0, 0.0, 1.0]:
            return f'Pinocchio ignores the axis of planar joint "{joint.name}"'
    return ""


def _left_out(call: Call, model: Model) -> str:
    """Why Pinocchio's answer to one call is another; empty if it is not. Seen with Pinocchio 4.1, in no URDF."""
    if call.name == "kinetic_energy" and model.armature.any():
        return "Pinocchio leaves rotor inertias out of the kinetic energy"
    if call.name == "frame_acceleration_derivatives":
        for joint in model.joints[1:]:
            if joint.nv > 1 and joint.parent:
                return f'Pinocchio\'s differ for joint "{joint.name}" on a moving body'
    return ""


def _joint_order(model: Model, pin_model: Any) -> Row:
    differ = [(ours, theirs) for ours, theirs in zip(model.names, pin_model.names, strict=True) if ours != theirs]
    note = f'joint "{differ[0][0]}" stands where Pinocchio has "{differ[0][1]}"' if differ else ""
    return judged("joint order", float(len(differ)), 0.5, note)


def _compared(call: Call, model: Model, peer: Peer, states: States, timing: bool) -> Iterator[Row]:
    """The rows of a call: one, and a second one of values if the first is of a residual."""
    inputs = tuple(getattr(states, name) for name in call.inputs.split())
    first = tuple(x[0] for x in inputs)
    batched = bool(inputs)
    if model.nv == 0 and call.frame in _CRASHES_WITHOUT_FREEDOMS:
        left = float(abs(ours_of(call, model, inputs)).sum())
        yield judged(call.label, left, BOUND, "Pinocchio crashes where nv is 0; sum of entries = 0 instead")
        return
    theirs = np.array([peer(call, states, k) for k in range(len(states.q) if batched else 1)])
    try:
        single = ours_of(call, model, first)
        ours = ours_of(call, model, inputs) if batched else single[None]
        residual, bound = _residual(call, peer, states, ours) if call.name in SOLVED else (0.0, BOUND)
    except (InertiaError, NonFiniteError) as error:
        yield _refused(call, model, peer, states, theirs, error)
        return
    times = times_of(call, model, peer, states) if timing and isinstance(call.peer, str) else None
    same = np.array_equal(single, ours[0], equal_nan=True)
    note = "" if same else "a single call and a batch of it differ"
    if call.name in SOLVED:
        if bound > BOUND and not note:
            note = f"{RAISED}, for M is ill conditioned and rounding the exact answer costs a quarter of that"
        yield judged(call.label, residual if same else float("inf"), bound, note, times)
        yield _values(call, peer, states, ours, theirs)
        return
    if not np.isfinite(theirs).all():
        yield by_identity(call, model, states, "Pinocchio gives nan", times)
        return
    yield judged(call.label, scaled_error(ours, theirs, call.rank) if same else float("inf"), BOUND, note, times)


def _missed(call: Call, peer: Peer, states: States, k: int, x: Array) -> tuple[float, float]:
    """Residual of a result x in sample k, and its rounding: of forward dynamics tau in Pinocchio's RNEA, of minverse
    M x = 1, of the derivatives M x = -∂tau, and 1, at the acceleration.

    The rounding is the residual by rounding of x, eps |M| |x|, scaled alike.
    """
    M = np.array(peer.pin.crba(peer.model, peer.data, states.q[k]))
    if call.name in FORWARD:
        force = Call(call.label, call.inputs.replace("tau", "a"), "rnea")
        accelerations = np.zeros_like(states.a)
        accelerations[k] = x
        left, right = peer(force, states._replace(a=accelerations), k), states.tau[k]
    elif call.name == "aba_derivatives":
        left, right, finer = M @ x, *(_torques(peer, states, k, method) for method in ("aba", "aba_refined"))
        known = scaled_error(finer, right, right.ndim)
        return scaled_error(left, right, right.ndim), rounding(M, x, right) + known
    else:
        left, right = M @ x, np.eye(len(M))
    return scaled_error(left, right, right.ndim), rounding(M, x, right)


def _torques(peer: Peer, states: States, k: int, method: str) -> Array:
    """M times the derivatives of forward dynamics, (-∂tau/∂q, -∂tau/∂v, 1), at the acceleration by that method."""
    accelerations = np.zeros_like(states.a)
    accelerations[k] = ours_of(BY_LABEL[method], peer.ours, (states.q[k], states.v[k], states.tau[k]))
    by = peer(BY_LABEL["rnea_derivatives"], states._replace(a=accelerations), k)
    return np.stack([-by[0], -by[1], np.eye(peer.ours.nv)])


def _residual(call: Call, peer: Peer, states: States, ours: Array) -> tuple[float, float]:
    """The residual of our results, and its bound.

    A sample's bound is raised only for an error above BOUND. Returns those of the worst sample in units of its bound,
    among the failed samples if any, else among those with a raised bound.
    """
    found: list[tuple[float, float]] = []
    for k, x in enumerate(ours):
        error, rounded = _missed(call, peer, states, k, x)
        found.append((error, BOUND if error <= BOUND else raised(rounded)))
    return max(found, key=lambda pair: (not pair[0] <= pair[1], pair[1] > BOUND, sort_key(pair[0]) / pair[1]))


def _values(call: Call, peer: Peer, states: States, ours: Array, theirs: Array) -> Row:
    """The row that compares values, in states in which M is well conditioned and Pinocchio's own residual is small."""
    label = f"{call.name} (fext, values)" if "fext" in call.inputs else f"{call.name} (values)"
    M = peer.mass_matrices(states)
    sound = np.array([m.size == 0 or float(np.linalg.cond(m)) <= WELL_CONDITIONED for m in unit_diagonal(M)])
    sound &= [_missed(call, peer, states, k, x)[0] <= 0.5 * VALUE_BOUND for k, x in enumerate(theirs)]
    note = "" if sound.all() else OMITTED
    if not sound.any():
        return Row(label, None, VALUE_BOUND, True, f"{note}: in all")
    return judged(label, scaled_error(ours[sound], theirs[sound], call.rank), VALUE_BOUND, note)


def _refused(call: Call, model: Model, peer: Peer, states: States, theirs: Array, error: SpatialDynError) -> Row:
    """The row of a call that raises: ok if Pinocchio's M is singular, or its mass zero and its result not finite."""
    gives = "no finite numbers" if not np.isfinite(theirs).all() else "numbers"
    if isinstance(error, InertiaError):
        M = peer.mass_matrices(states)
        if singular(M):
            row = by_identity(BY_LABEL["rnea"], model, states, "")
            what = str(error).partition(":")[0].partition(" in sample")[0]
            note = f"InertiaError, as M is singular: {what} (Pinocchio gives {gives}); rnea = M a + bias instead"
            return Row(call.label, row.error, row.bound, row.ok, note)
    elif peer.pin.computeTotalMass(peer.model) == 0.0 and gives != "numbers":
        return Row(call.label, None, BOUND, True, "refused, as no mass moves (Pinocchio gives no finite numbers)")
    return Row(call.label, float("inf"), BOUND, False, f"refused, where Pinocchio gives {gives}: {error}")
