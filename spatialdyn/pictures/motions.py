"""The motion in a picture: configurations and their times, and the choice of those that are shown."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_array, as_number
from ..errors import NonFiniteError, ShapeError, SpatialDynError, literal
from ..model.model import Model
from ..simulation import Rollout, Trajectory

Array = NDArray[np.float64]
MOST = 16  # samples shown of a rollout


class Motion(NamedTuple):
    """Configurations at times.

    t  (N,)        seconds, increasing
    q  (S, N, nq)  joint positions [rad | m] of S samples, the first of which is shown solid, others pale
    """

    t: Array
    q: Array


def motion_of(model: Model, given: Any, dt: Any = None, sample: Any = None) -> Motion:
    """The motion in a Trajectory, a Rollout or an array of configurations.

    given   Trajectory; Rollout; or q (N, nq) or (S, N, nq)
    dt      seconds from one configuration of an array to the next
    sample  index of the one sample to show; None shows the first MOST

    Raises  ShapeError, NonFiniteError, SpatialDynError naming the argument.
    """
    times = given.t if isinstance(given, (Trajectory, Rollout)) else None
    if times is not None and times.ndim == 0:
        raise SpatialDynError('rollout holds the last states only, expected others too: record=1 in place of "last"')
    q = as_array("q", given.q if isinstance(given, (Trajectory, Rollout)) else given)
    if q.ndim not in (2, 3) or q.shape[-1] != model.nq or not q.size:
        raise ShapeError(f"q has shape {q.shape}, expected (N, {model.nq}) or (S, N, {model.nq}) of at least one")
    q = q[None] if q.ndim == 2 else q
    if sample is None:
        q = q[:MOST]
    else:
        whole = isinstance(sample, (int, np.integer)) and not isinstance(sample, bool)
        if not (whole and 0 <= sample < len(q)):
            raise SpatialDynError(f"sample is {literal(sample)}, expected an index from 0 to {len(q) - 1}")
        q = q[sample : sample + 1]
    lost = np.flatnonzero(~np.isfinite(q).all((0, 2)))
    if len(lost):
        raise NonFiniteError(f"q is not finite at index {lost[0]} of {q.shape[1]}, expected finite numbers")
    if dt is None and times is None:
        raise SpatialDynError("dt is None, expected the seconds from one configuration to the next")
    if dt is not None:
        step = as_number(dt)
        if not 0.0 < step < np.inf:
            raise SpatialDynError(f"dt is {literal(dt)}, expected a positive number of seconds")
        return Motion(np.arange(q.shape[1], dtype=np.float64) * step, q)
    t = np.asarray(times, np.float64)
    return Motion(t - t[0], q)


def frames(t: Array, fps: float, speed: float) -> tuple[NDArray[np.intp], Array]:
    """Indices of the configurations to show, and the seconds after the start at which each is shown.

    Configurations are not interpolated: each frame shows the nearest one in time, and none is shown twice.
    """
    for name, value in (("fps", fps), ("speed", speed)):
        if not 0.0 < as_number(value) < np.inf:
            raise SpatialDynError(f"{name} is {literal(value)}, expected a positive number")
    count = int(np.floor((t[-1] - t[0]) * fps / speed + 1e-9)) + 1
    wanted = t[0] + np.arange(count) * (speed / fps)
    after = np.clip(np.searchsorted(t, wanted), 1, max(len(t) - 1, 1))
    near = np.where(wanted - t[after - 1] <= t[np.minimum(after, len(t) - 1)] - wanted, after - 1, after)
    shown = np.unique(np.append(np.minimum(near, len(t) - 1), len(t) - 1))
    return shown, (t[shown] - t[0]) / speed
