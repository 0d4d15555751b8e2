"""Comparison with Pinocchio: every public call, entry by entry, on random states of one robot.

``CALLS`` is the whole of it: a line per call that says what ours takes and what Pinocchio's is called. Where Pinocchio
has no answer (a joint that moves no inertia, a robot that moves no mass) or another question (planar joints, whose axis
it ignores), an identity is checked instead, and the row says so.

Pinocchio is imported inside functions only: ``pip install "spatialdyn[validate]"`` brings it.
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
