"""Random configurations, uniform within the limits of joints."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.kinds import ANGLE, KINDS, PAIR, QUATERNION
from ..errors import ShapeError, SpatialDynError, literal
from ..model.model import Model
from ..model.robot_checks import masked
from ..waiting import watch
from .arguments import check_model

Array = NDArray[np.float64]


@watch.call("random_configuration")
def random_configuration(
    model: Model, rng: np.random.Generator | int | None = None, shape: int | tuple[int, ...] = ()
) -> Array:
    """Random configurations: within the limits, rotations uniform on the sphere of quaternions.

    rng    a NumPy Generator, a seed, or None for different states each time; a sample draws nv numbers, so a batch of
           n equals n single samples
    shape  batch shape

    A coordinate without limits is uniform in [-1, 1] m or [-π, π] rad; one with a single limit, in an interval of the
    same length that ends at the limit. Positions of floating and planar joints count as unlimited. With mimic joints
    the independent coordinates are drawn; the others may leave their limits.

    Returns q (*shape, nq) [rad | m].
    Raises  SpatialDynError if rng is none of these; ShapeError if shape is no batch shape.

    >>> import spatialdyn as sd
    >>> random_configuration(sd.load_urdf("two_link"), 0, (5, 3)).shape
    (5, 3, 2)
    """
    check_model(model)
    rng = generator("rng", rng)
    batch = _shape(shape)
    u = rng.random((*batch, model.nv))
    q = np.empty((*batch, model.nq))
    for joint in model.joints[1:]:
        if joint.mimic is not None:
            continue
        kind = KINDS[model.bodies[joint.row - joint.nv + 1]["kind"]]
        part = u[..., joint.idx_v : joint.idx_v + joint.nv]
        at = joint.idx_q
        if kind.group == "R":
            reach = 1.0 if kind.lengths else math.pi
            q[..., at : at + 1] = _within(float(model.lower[at]), float(model.upper[at]), reach, part)
        else:
            q[..., at : at + kind.lengths] = _place(part[..., : kind.lengths])
            if kind.turn:
                q[..., at + kind.lengths : at + kind.nq] = _TURNED[kind.turn](part[..., kind.lengths :])
    return q


def generator(name: str, rng: Any) -> np.random.Generator:
    """A Generator as it is, or a new one from a seed or from None. Raises SpatialDynError naming the argument."""
    if isinstance(rng, np.random.Generator):
        return rng
    whole = isinstance(rng, (int, np.integer)) and not isinstance(rng, bool)
    if rng is None or (whole and rng >= 0):
        return np.random.default_rng(rng)
    what = repr(rng) if whole else f"a {type(rng).__name__}"
    raise SpatialDynError(f"{name} is {what}, expected a numpy.random.Generator, a seed or None")


def _shape(shape: int | tuple[int, ...]) -> tuple[int, ...]:
    try:
        if masked(shape):
            raise TypeError
        sizes = [shape] if np.ndim(shape) == 0 else list(shape)  # type: ignore[arg-type]
        if any(isinstance(n, (bool, np.bool_)) for n in sizes):
            raise TypeError
        batch = tuple(map(operator.index, sizes))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        batch = (-1,)
    if any(n < 0 for n in batch) or math.prod(batch) >= 1 << 48:  # beyond any memory
        raise ShapeError(f"shape is {literal(shape)}, expected a size or a tuple of sizes")
    return batch


def _within(lower: float, upper: float, reach: float, u: Array) -> Array:
    """u in [0, 1) scaled to the limits, or without limits to an interval of length 2 reach."""
    if math.isinf(lower) and math.isinf(upper):
        lower, upper = -reach, reach
    elif math.isinf(lower):
        lower = upper - 2.0 * reach
    elif math.isinf(upper):
        upper = lower + 2.0 * reach
    return np.clip(lower * (1.0 - u) + upper * u, lower, upper)  # upper - lower may overflow


def _place(u: Array) -> Array:
    """Coordinates in [-1, 1] m."""
    return _within(-math.inf, math.inf, 1.0, u)


def _angle(u: Array) -> Array:
    """Angles in [-π, π]."""
    return _within(-math.inf, math.inf, math.pi, u)


def _pair(u: Array) -> Array:
    """(cos, sin) of uniform angles, u (..., 1)."""
    return np.concatenate([np.cos(_angle(u)), np.sin(_angle(u))], -1)


def _quaternion(u: Array) -> Array:
    """Uniform quaternions x y z w from u (..., 3).

    Hopf coordinates of the sphere: (x, y) and (z, w) have uniform phases, and x² + y² is uniform in [0, 1].
    """
    a, b = np.sqrt(u[..., :1]), np.sqrt(1.0 - u[..., :1])
    return np.concatenate([a * _pair(u[..., 1:2]), b * _pair(u[..., 2:])], -1)


_TURNED: dict[int, Callable[[Array], Array]] = {ANGLE: _angle, PAIR: _pair, QUATERNION: _quaternion}
