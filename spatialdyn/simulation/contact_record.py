"""What is recorded of contacts."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import NDArray

Array = NDArray[Any]


class ContactRecord(NamedTuple):
    """Contacts at the recorded times, (N, ...) of a simulation, (B, T, ...) of a rollout.

    impulse   (..., k, 3)  of the step that ends there, on each of the k points, in the world's axes [N s]
    gap       (..., k)     distance of each sphere from the ground, negative in it [m]
    residual  (...)        by how much the impulses of that step miss Coulomb's law at worst [m/s]
    stop      (..., nv)    impulse of joint limits in that step, positive from the lower one [N m s | N s]
    """

    impulse: Array
    gap: Array
    residual: Array
    stop: Array
