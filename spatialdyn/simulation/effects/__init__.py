"""The effects that act in a run, one file each, listed here; ``effect`` has the protocol, with an example."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .constraints import Constrained
from .contacts import contact_of
from .effect import Effect
from .external import ExternalForces

Array = NDArray[np.float64]


def of_run(scene: Any, constrained: Constrained | None, records: bool, forces: Array | None) -> tuple[Effect, ...]:
    """The effects of a run of a scene.

    constrained  the run's constraints, with their rank at the beginning
    records      whether impulses of contacts are recorded
    forces       (samples or 1, steps or 1, 6 njoints) external forces of the scene and the run; None without any
    """
    acting: tuple[Effect, ...] = scene.effects
    contact = contact_of(scene, acting, records, constrained)
    if contact is not None:
        acting = tuple(x.as_coupled() for x in acting)
    others = constrained, contact, None if forces is None else ExternalForces(forces)
    return (*acting, *(x for x in others if x is not None))


def of_structure(scene: Any) -> tuple[Effect, ...]:
    """The effects of a scene for programs, which do not depend on the initial state."""
    rate = None if scene.stabilization is None else 1.0 / scene.stabilization
    constrained = None if scene.constraints is None else Constrained(scene.constraints, rate, np.zeros(1, np.intp))
    forces = None if scene.fext is None else scene.fext.reshape((1, 1, -1))
    return of_run(scene, constrained, False, forces)
