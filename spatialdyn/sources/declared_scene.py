"""The declarations of a robot's file beside bodies and joints, as options of a ``Scene``, for parts that can move."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from ..constraints.kinds import CouplerConstraint
from ..constraints.table import Constraints
from ..model.model import Model
from . import scene_toml


def options_of(model: Model) -> dict[str, Any]:
    """Damping, friction, position limits and mimic joints; of MJCF also its loops, contacts of feet, and motors."""
    more = scene_toml.options_of(model, _declared(model))
    items = [*couplers_of(model), *more.pop("constraints", ())]
    rubs = bool(model.damping.any() or model.friction.any())
    stops = bool(np.isfinite(model.lower).any() or np.isfinite(model.upper).any())
    held = Constraints(model, items) if items else None
    return {"friction": True if rubs else None, "limits": stops, "constraints": held, **more}


def couplers_of(model: Model) -> list[CouplerConstraint]:
    """The mimic joints of the robot's file, of a model that does not move them with their leaders."""
    if model.mimic_matrix is not None:
        return []
    moves = {x.name for x in model.robot.joints if x.kind != "fixed"}
    follow = [(x.name, x.mimic) for x in model.robot.joints if x.mimic is not None and x.name in moves]
    return [CouplerConstraint(name, m.leader, m.multiplier, m.offset) for name, m in follow if m is not None]


def _declared(model: Model) -> dict[str, Any]:
    """What the file declares, in the form of ``scene_toml``, without the parts that do not move in the Model."""
    given: dict[str, Any] = json.loads(model.robot.declared or "{}").get("scene", {})
    moving = {f"{frame.kind}:{frame.name}" for frame in model.frames if frame.joint}
    moving |= {joint.name for joint in model.joints[1:]}
    ends = ("frame_a", "frame_b", "joint", "to")
    held = [x for x in given.pop("constraint", ()) if any(x.get(end) in moving for end in ends)]
    if held:
        given["constraint"] = held
    if "contacts" in given:
        for name in ("points", "friction"):
            given["contacts"][name] = {x: y for x, y in given["contacts"][name].items() if x in moving}
        if not given["contacts"]["points"]:
            del given["contacts"]
    return given
