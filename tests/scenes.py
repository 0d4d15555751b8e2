"""``simulate`` and ``rollout`` of a model and options in one dict: those of ``Scene`` make the scene."""

from __future__ import annotations

from typing import Any

import spatialdyn as sd
from spatialdyn.simulation.scene import FIELDS


def split(model: sd.Model, given: dict[str, Any]) -> tuple[sd.Scene, dict[str, Any]]:
    """The scene of the options that are of one, and the rest, which are of a run."""
    acts = {name: x for name, x in given.items() if name in FIELDS}
    return sd.Scene(model, **acts), {name: x for name, x in given.items() if name not in acts}


def simulate(model: sd.Model, *args: Any, **given: Any) -> sd.Trajectory:
    """``sd.simulate`` of the scene of the options."""
    scene, rest = split(model, given)
    return sd.simulate(scene, *args, **rest)


def rollout(model: sd.Model, *args: Any, **given: Any) -> sd.Rollout:
    """``sd.rollout`` of the scene of the options."""
    scene, rest = split(model, given)
    return sd.rollout(scene, *args, **rest)
