"""The record of contacts in a run."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import NDArray

Array = NDArray[Any]


class ContactRecord(NamedTuple):
    """Contacts at the recorded times: (N, ...) in a simulation, (B, T, ...) in a rollout.

    impulse   (..., k, 3)  on each of the k points in the step that ends at the record, in the world's axes [N s]
    gap       (..., k)     distance of each sphere from the ground, negative below its surface [m]
    residual  (...)        largest violation of Coulomb's law by the impulses of that step [m/s]
    stop      (..., nv)    impulse of the joint limits in that step, positive at a lower limit [N m s | N s]
    """

    impulse: Array
    gap: Array
    residual: Array
    stop: Array
