"""Comparison with Pinocchio: every public call, entry by entry, on random states of one robot.

The table ``CALLS`` has a line per call: its inputs and Pinocchio's function. If Pinocchio gives no finite result (a
joint with zero articulated inertia, a robot without moving mass) or computes something else (planar joints, whose axis
it ignores), an identity is checked instead, and the row's note says so.

Functions import Pinocchio when called: ``pip install pin`` installs it.
"""

from __future__ import annotations

from .calls import CALLS
from .comparison import OMITTED, compare_with_pinocchio
from .measures import BOUND, RAISED, VALUE_BOUND
from .peer import pinocchio, pinocchio_model
from .rows import Comparison, Row
from .states import States, random_states

__all__ = [
    "BOUND", "CALLS", "OMITTED", "RAISED", "VALUE_BOUND", "Comparison", "Row", "States", "compare_with_pinocchio",
    "pinocchio", "pinocchio_model", "random_states",
]  # fmt: skip
