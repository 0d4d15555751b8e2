"""A Model of Pinocchio's own class as the state that ``serialization_format.fill`` makes a Model of, entry by entry."""

from __future__ import annotations

from typing import Any

import numpy as np

from ....errors import ModelError
from ....interop.pinocchio import PINOCCHIO_KINDS, screw_of
from ..types.arguments import Array
from ..types.frame import Frame
from ..types.inertia import Inertia
from ..types.motion import Motion
from ..types.se3 import SE3
from .joint import kind_named
from .joint_tree import ARRAYS
from .joints import OneAxis
from .serialization_format import frame_state, numbers

MOTION, LEADER = "Mimicking joint type", "Mimicked joint id"  # said of a mimic joint in its text alone
BEFORE_4 = {"Effort": "effortLimit", "Velocity": "velocityLimit", "DryFriction": "friction"}  # names of upper limits


def pinocchio_state(given: Any) -> dict[str, Any]:
    """The state of a Model of Pinocchio's own class. Raises ModelError for a joint of a kind that is not here."""
    joints = zip(given.names, given.parents, given.jointPlacements, given.inertias, strict=True)
    return {
        "name": given.name, "nbodies": given.nbodies, "gravity": numbers(Motion(given.gravity)),
        "joints": [
            {
                "name": name, "parent": int(parent), "joint": _joint_state(given, given.joints[k], name) if k else {},
                "placement": numbers(SE3(X)), "inertia": numbers(Inertia(I)),
            }
            for k, (name, parent, X, I) in enumerate(joints)
        ],
        "frames": [frame_state(Frame(x)) for x in given.frames],
        "arrays": {name: _array(given, name) for name in ARRAYS},
        "configurations": {x.key(): np.array(x.data(), float) for x in given.referenceConfigurations},
    }  # fmt: skip


def _array(given: Any, name: str) -> Array:
    """An array of a model. A lower limit that is missing, or is the upper one by Pinocchio's slip, is its negative."""
    for kind, old in BEFORE_4.items():
        if name in (f"lower{kind}Limit", f"upper{kind}Limit"):
            upper = np.array(getattr(given, f"upper{kind}Limit", getattr(given, old)), float)
            lower = np.array(getattr(given, f"lower{kind}Limit", upper), float)
            return upper if name.startswith("upper") else np.where(lower == upper, -upper, lower)
    default = np.full(ARRAYS[name].size(given), ARRAYS[name].default)
    return np.array(getattr(given, name, default), float)


def _joint_state(model: Any, joint: Any, name: str) -> dict[str, Any]:
    """The state, as of ``JointModel.state``, of a joint or a part of one, without the names of a composite's parts."""
    kind = joint.shortname()
    if kind == "JointModelMimic":
        mimic = joint.extract()
        lines = dict(line.strip().split(": ") for line in str(mimic).splitlines() if ": " in line)
        axis, pitch = _screw(model, joint, lines[MOTION])
        axis = axis / (mimic.scaling or 1.0)  # Pinocchio's subspace is by the leader's velocity
        own = {"leader": int(lines[LEADER]), "scaling": mimic.scaling, "offset": mimic.offset}
        return {"kind": kind, "parameters": [], "motion": _one_axis(lines[MOTION], axis, pitch), **own}
    if kind == "JointModelComposite":
        whole = joint.extract()
        chain = zip(whole.joints, whole.jointPlacements, strict=True)
        parts = [[_joint_state(model, part, name), numbers(SE3(placement)), ""] for part, placement in chain]
        return {"kind": kind, "parameters": [], "parts": parts}
    if kind == "JointModelUniversal":
        whole = joint.extract()
        return {"kind": kind, "parameters": [*whole.axis1, *whole.axis2]}
    try:
        one = issubclass(kind_named(kind), OneAxis)
    except KeyError:
        raise ModelError(f'joint "{name}" is a {kind} of Pinocchio, expected a kind that is here too') from None
    return _one_axis(kind, *_screw(model, joint, kind)) if one else {"kind": kind, "parameters": []}


def _screw(model: Any, joint: Any, kind: str) -> tuple[Array, float]:
    """Axis and pitch of a joint that moves along or about one axis."""
    axis, pitch = screw_of(model, joint, PINOCCHIO_KINDS[kind])
    return np.array(axis), pitch


def _one_axis(kind: str, axis: Array, pitch: float) -> dict[str, Any]:
    """The state of a joint of such a kind."""
    pitches = [pitch] * (PINOCCHIO_KINDS[kind] == "helical")
    return {"kind": kind, "parameters": [*([] if kind_named(kind)._along else axis.tolist()), *pitches]}
