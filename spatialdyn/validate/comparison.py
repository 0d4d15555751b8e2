"""The comparison of one robot: every public call, entry by entry, on random states.

An error is max |x - x_pin| / max(1, max |x_pin|) of one result, the largest over all samples, frames and references.
Forward dynamics and the inverse of M are asked more: that their answer, put into Pinocchio's RNEA or times its M, gives
back the torque or 1; their values are compared too, where M is well conditioned. No float64 answer x gets such a
residual below what rounding its entries costs, about eps |M| |x|: a residual above BOUND may be up to four times that,
and the row says so (icub's M has a condition number of 4e10: the exact acceleration, rounded, misses tau by 3e-8).
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InertiaError, NonFiniteError, SpatialDynError
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
    size,
    unit_diagonal,
)
from .peer import Peer, pinocchio, pinocchio_model
from .rows import Comparison, Row, judged
from .states import States, random_states
from .times import times_of

Array = NDArray[np.float64]

SOLVED = (*FORWARD, "minverse", "aba_derivatives")  # through M⁻¹: judged by what is left of their equation
OMITTED = "left out where M is ill conditioned or Pinocchio's own residual above half the bound"  # note on values
_CRASHES_WITHOUT_FREEDOMS = ("getFrameJacobian", "getFrameJacobianTimeVariation")  # seen with Pinocchio 4.1


def compare_with_pinocchio(
    source: Any,
    root: str = "fixed",
    samples: int = 20,
    seed: int = 0,
    timing: bool = False,
    continuous: str = "cos_sin",
) -> Comparison:
    """Compare every public call with Pinocchio's on random states.

    source      path, URDF text or the name of a robot, as ``load_urdf`` takes them
    root        "fixed" or "floating"
    samples     number of random states, at least 1
    seed        of their generator
    timing      also time single calls of both from Python: median of interleaved rounds
    continuous  as ``load_urdf`` has it; "angle" fits Pinocchio on robots without continuous joints only

    >>> import spatialdyn as sd
    >>> sd.compare_with_pinocchio("two_link", samples=2).ok
    True

    Raises SpatialDynError if Pinocchio is not installed, refuses the robot, or has other sizes; UrdfError as
    ``load_urdf`` does.
    """
    pin = pinocchio()
    if samples < 1:
        raise SpatialDynError(f"samples is {samples}, expected at least 1")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = load_urdf(source, root=root, continuous=continuous)
    pin_model = pinocchio_model(source, root)
    if (model.nq, model.nv, model.njoints) != (pin_model.nq, pin_model.nv, pin_model.njoints):
        raise SpatialDynError(
            f'robot "{model.name}" has nq {model.nq}, nv {model.nv}, {model.njoints} joints, and in Pinocchio '
            f"{pin_model.nq}, {pin_model.nv}, {pin_model.njoints}"
        )
    peer = Peer(pin, pin_model, model)
    states = random_states(model, samples, np.random.default_rng(seed))
    rows = [_joint_order(model, pin_model)]
    other = _other_question(model)
    for call in CALLS:
        why = other if call.peer else "Pinocchio has no such call"
        rows += [by_identity(call, model, states, why)] if why else _compared(call, model, peer, states, timing)
    return Comparison(model.name, root, model.nq, model.nv, samples, tuple(rows))


def _other_question(model: Model) -> str:
    """Why Pinocchio's answers are those of another robot, or nothing."""
    for joint in model.joints[1:]:
        if joint.kind == "planar" and joint.axis.tolist() != [0.0, 0.0, 1.0]:
            return f'Pinocchio ignores the axis of planar joint "{joint.name}"'
    return ""


def _joint_order(model: Model, pin_model: Any) -> Row:
    differ = [(ours, theirs) for ours, theirs in zip(model.names, pin_model.names, strict=True) if ours != theirs]
    note = f'joint "{differ[0][0]}" stands where Pinocchio has "{differ[0][1]}"' if differ else ""
    return judged("joint order", float(len(differ)), 0.5, note)


def _compared(call: Call, model: Model, peer: Peer, states: States, timing: bool) -> Iterator[Row]:
    """The rows of a call: one, and one for its values where its residual is what is bounded."""
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
    """How far an answer x of forward dynamics is from giving tau in Pinocchio's RNEA, in sample k; of minverse, from
    M x = 1; of its derivatives, from M x = -∂tau, and 1, at the acceleration.

    And what rounding the entries of x makes of that: eps |M| |x|, scaled alike.
    """
    M = np.array(peer.pin.crba(peer.model, peer.data, states.q[k]))
    if call.name in FORWARD:
        force = Call(call.label, call.inputs.replace("tau", "a"), "rnea")
        accelerations = np.zeros_like(states.a)
        accelerations[k] = x
        left, right = peer(force, states._replace(a=accelerations), k), states.tau[k]
    elif call.name == "aba_derivatives":
        accelerations = np.zeros_like(states.a)
        accelerations[k] = ours_of(BY_LABEL["aba"], peer.ours, (states.q[k], states.v[k], states.tau[k]))
        by = peer(BY_LABEL["rnea_derivatives"], states._replace(a=accelerations), k)
        left, right = M @ x, np.stack([-by[0], -by[1], np.eye(len(M))])
    else:
        left, right = M @ x, np.eye(len(M))
    return scaled_error(left, right, right.ndim), rounding(M, x, right)


def _residual(call: Call, peer: Peer, states: States, ours: Array) -> tuple[float, float]:
    """Residual of our answers, and its bound.

    A sample's bound is raised only for an error that needs it. Both are of the sample that is worst in units of its
    bound, among the failed ones if there are any, else among those whose bound is raised.
    """
    found: list[tuple[float, float]] = []
    for k, x in enumerate(ours):
        error, rounded = _missed(call, peer, states, k, x)
        found.append((error, BOUND if error <= BOUND else raised(rounded)))
    return max(found, key=lambda pair: (not pair[0] <= pair[1], pair[1] > BOUND, size(pair[0]) / pair[1]))


def _values(call: Call, peer: Peer, states: States, ours: Array, theirs: Array) -> Row:
    """The values themselves, in those states in which M is well conditioned and Pinocchio's own residual is small."""
    label = f"{call.name} (fext, values)" if "fext" in call.inputs else f"{call.name} (values)"
    M = peer.mass_matrices(states)
    sound = np.array([m.size == 0 or float(np.linalg.cond(m)) <= WELL_CONDITIONED for m in unit_diagonal(M)])
    sound &= [_missed(call, peer, states, k, x)[0] <= 0.5 * VALUE_BOUND for k, x in enumerate(theirs)]
    note = "" if sound.all() else OMITTED
    if not sound.any():
        return Row(label, None, VALUE_BOUND, True, f"{note}: in all")
    return judged(label, scaled_error(ours[sound], theirs[sound], call.rank), VALUE_BOUND, note)


def _refused(call: Call, model: Model, peer: Peer, states: States, theirs: Array, error: SpatialDynError) -> Row:
    """The row of a call that ours refuses: right where there is no answer, as Pinocchio's M or mass has to bear out."""
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
