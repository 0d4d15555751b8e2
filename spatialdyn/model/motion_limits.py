"""Limits of a model's own coordinates: those of each joint, and those to which joints that mimic it lead."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import ModelError
from .model import Model

Array = NDArray[np.float64]


def position_limits(model: Model) -> tuple[Array, Array]:
    """Lower and upper positions (nq) within which neither a joint nor one that mimics it passes a limit [rad | m].

    Raises  ModelError naming all joints that mimic others and whose limits no position of those meets
    """
    lower, upper = np.array(model.lower), np.array(model.upper)
    given = {x.name: x for x in model.robot.joints}
    conflicts = []
    for joint in model.joints[1:]:
        if joint.mimic is None:
            continue
        (leader, ratio, offset), own, k = joint.mimic, given[joint.name], joint.idx_q
        if ratio:
            ends = sorted(((own.lower - offset) / ratio, (own.upper - offset) / ratio))
            lower[k], upper[k] = max(lower[k], ends[0]), min(upper[k], ends[1])
        if not (lower[k] <= upper[k] if ratio else own.lower <= offset <= own.upper):
            how = f'"{model.joints[leader].name}"{"" if ratio else f" by ratio 0, at {offset:g},"}'
            conflicts.append(f'joint "{joint.name}" mimics {how} with limits {own.lower:g} to {own.upper:g}')
    if conflicts:
        raise ModelError(f"{'; '.join(conflicts)}, expected some that a position within the limits of that one meets")
    return lower, upper


def velocity_limits(model: Model) -> Array:
    """Largest speeds (nv) of each joint, and of those that mimic it [rad/s | m/s]; infinity for none."""
    largest = np.array(model.velocity_limit)
    largest[~(largest > 0.0)] = np.inf
    given = {x.name: x for x in model.robot.joints}
    for joint in model.joints[1:]:
        if joint.mimic is not None and joint.mimic[1] and given[joint.name].velocity > 0.0:
            own = given[joint.name].velocity / abs(joint.mimic[1])
            largest[joint.idx_v] = min(largest[joint.idx_v], own)
    return largest
