"""Arguments of calls about a joint or a frame: its index, a placement on it, and the reference frame."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from ....recursions.spec import LOCAL as IN_FRAME
from ....recursions.spec import LOCAL_WORLD_ALIGNED as ALIGNED
from ....recursions.spec import WORLD as IN_WORLD
from ..model.library_model import frame_placements
from ..model.model import Model
from ..types.arguments import ArgumentError, Array, RangeError, described, expected
from ..types.frame import LOCAL, LOCAL_WORLD_ALIGNED, WORLD, ReferenceFrame
from ..types.se3 import SE3

CODES = {LOCAL: IN_FRAME, WORLD: IN_WORLD, LOCAL_WORLD_ALIGNED: ALIGNED}
REFERENCES = {"in_frame": id(LOCAL), "in_world": id(WORLD), "aligned": id(LOCAL_WORLD_ALIGNED)}
IDENTITY = np.eye(4)


def named(function: Callable[..., Any], name: str, doc: str) -> Callable[..., Any]:
    """A function made from a row of a table, with its name and docstring."""
    function.__name__ = function.__qualname__ = name
    function.__doc__ = doc
    return function


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


def about_frame(
    model: Model,
    of_joints: bool,
    frame_id: Any = None,
    reference_frame: Any = None,
    last: Any = None,
    joint_id: Any = None,
    placement: Any = None,
) -> tuple[int, Array, Any]:
    """Joint, placement and reference of (frame_id, reference_frame), or (joint_id, placement[, reference_frame]).

    of_joints  the index is a joint's, without a placement
    last       the reference frame where the second argument is a placement, LOCAL if it is left out
    """
    index = joint_id if frame_id is None else frame_id
    if isinstance(reference_frame, SE3) and not of_joints:
        placement, reference_frame, last = reference_frame, LOCAL if last is None else last, None
    if last is not None:
        raise ArgumentError(f"{described(last)} follows the reference frame, expected nothing")
    if of_joints:
        return joint_index(model, index), IDENTITY, reference_frame
    if placement is not None:
        return joint_index(model, index), expected(placement, SE3, "placement")._x, reference_frame
    k, frames = frame_index(model, index), frame_placements(model)
    return int(frames.joints[k]), frames.placements[k], reference_frame
