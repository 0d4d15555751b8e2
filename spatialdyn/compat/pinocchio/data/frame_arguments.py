"""Arguments of calls about a joint or a frame: its index, a placement on it, and the reference frame."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....recursions.spec import LOCAL as IN_FRAME
from ....recursions.spec import LOCAL_WORLD_ALIGNED as ALIGNED
from ....recursions.spec import WORLD as IN_WORLD
from ..model.library_model import frame_placements
from ..model.model import Model
from ..types.arguments import ArgumentError, RangeError, described
from ..types.frame import LOCAL, LOCAL_WORLD_ALIGNED, WORLD, ReferenceFrame
from ..types.se3 import SE3

Array = NDArray[np.float64]
CODES = {LOCAL: IN_FRAME, WORLD: IN_WORLD, LOCAL_WORLD_ALIGNED: ALIGNED}
REFERENCES = {"in_frame": id(LOCAL), "in_world": id(WORLD), "aligned": id(LOCAL_WORLD_ALIGNED)}
IDENTITY = np.eye(4)


def joint_index(model: Model, index: Any) -> int:
    """Checked index of a joint. Raises RangeError if the model has no such joint, ArgumentError for no integer."""
    return _index(index, model.njoints, "joint")


def frame_index(model: Model, index: Any) -> int:
    """Checked index of a frame. Raises RangeError if the model has no such frame, ArgumentError for no integer."""
    return _index(index, len(model.frames), "frame")


def _index(index: Any, count: int, what: str) -> int:
    try:
        k = operator.index(index)
    except TypeError:
        raise ArgumentError(f"{what} index is {described(index)}, expected an integer") from None
    if not 0 <= k < count:
        raise RangeError(f"{what} index is {k}, expected one from 0 to {count - 1}")
    return k


def reference_code(reference_frame: Any) -> int:
    """The library's code of a ReferenceFrame. Raises ArgumentError for anything else."""
    if type(reference_frame) is not ReferenceFrame:
        raise ArgumentError(f"reference frame is {described(reference_frame)}, expected a ReferenceFrame")
    return CODES[reference_frame]


def frame_argument(model: Model, first: Any, rest: tuple[Any, ...], named: dict[str, Any]) -> tuple[int, Array, Any]:
    """Joint, placement and reference of (frame_id[, reference]) or (joint_id, placement[, reference])."""
    if "placement" in named:
        rest = (named["placement"], *rest)
    if rest and isinstance(rest[0], SE3):
        joint, placement, rest = joint_index(model, first), rest[0]._x, rest[1:]
    else:
        k, frames = frame_index(model, first), frame_placements(model)
        joint, placement = int(frames.joints[k]), frames.placements[k]
    if len(rest) > 1:
        raise ArgumentError(f"{len(rest)} arguments follow the frame, expected a ReferenceFrame")
    return joint, placement, rest[0] if rest else named.get("reference_frame", LOCAL)


def index_argument(given: tuple[Any, ...], named: dict[str, Any]) -> tuple[Any, tuple[Any, ...]]:
    """The index, by position or by name, and the arguments after it."""
    for name in ("frame_id", "joint_id"):
        if name in named:
            return named[name], given
    if not given:
        raise ArgumentError("no index is given, expected that of a frame, or of a joint with a placement")
    return given[0], given[1:]
