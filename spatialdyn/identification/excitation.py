"""``excitation``: a path that moves every base parameter, within the limits of the joints."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.kinds import R1
from ..calls.arguments import as_array, as_finite, as_flag, as_number, as_word
from ..calls.dynamics import calls
from ..control.motions import fourier
from ..control.paths import Path
from ..errors import IdentificationError, ShapeError, SpatialDynError, literal
from ..model.model import Model
from ..waiting import watch
from .base import structural_base
from .unknowns import DEFAULT, Unknowns, own_joints, unknowns_of, whole_number, words_of

Array = NDArray[np.float64]
CRITERIA = ("logdet", "cond")
POINTS = 120  # points of a period at which the regressor is evaluated
FINE = 1000  # points of a period at which limits are checked
MARGIN = 0.999  # share of a limit to use: between two points a path exceeds them by less than the rest
FREE = (math.pi, 3.0)  # amplitude and speed of a joint without limits [rad, rad/s | m, m/s]
RIDGE = 1e-9  # of the largest diagonal entry of WᵀW, added so that unexcited directions do not give log 0 = -inf
PERIODS = 1e-9, 1e9  # s: beyond, squares of accelerations leave the range of float64
STEP = 1e-6  # of central differences of the regressor


@watch.call("excitation")
def excitation(
    model: Model,
    duration: float = 10.0,
    harmonics: int = 5,
    criterion: str = "logdet",
    parameters: Any = DEFAULT,
    *,
    payload: str | None = None,
    centre: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    limits: bool = True,
    starts: int = 20,
    steps: int = 60,
    allowed: Callable[[Path], bool] | None = None,
    seed: int = 0,
) -> Path:
    """A periodic path whose torques determine a robot's base parameters as well as possible; at rest at its ends.

    model         Model whose positions are numbers
    duration      length of one period [s]
    harmonics     number of harmonics of the Fourier series, 2 or more
    criterion     "logdet" minimizes the volume of the parameters' error ellipsoid; "cond" minimizes the condition
                  number of the regressor, with columns of norm 1 at the start of the search
    parameters, payload   as in ``identify``
    centre        (nq,) mean configuration; the middle of the limits if left out, 0 where there are none [rad | m]
    acceleration  largest accelerations, a number or (nv,); no limit if left out
    limits        whether positions, velocities and efforts are kept within the model's limits. Joints without limits
                  get an amplitude of π and a speed of 3
    starts        number of random paths, of which the best is improved
    steps         steps of the improvement, along the exact gradient by the path's coefficients
    allowed       a function of a Path that returns whether it may be run, such as a check for collisions
    seed          seed of the random paths

    Returns a Path. Raises  IdentificationError if no start is within the limits and allowed; ShapeError,
    SpatialDynError for arguments
    Source  Swevers et al., Optimal robot excitation and identification (1997).

    >>> import spatialdyn as sd
    >>> path = sd.excitation(sd.load_urdf("two_link"), 4.0, 3, starts=4, steps=4)
    >>> path.duration, bool(abs(path(0.0).v).max() < 1e-12)
    (4.0, True)
    """
    words = words_of(parameters)
    unknowns = unknowns_of(model, words, payload)
    if any(row["kind"] not in R1 for row in model.bodies[1:]):
        raise IdentificationError(f'positions of robot "{model.name}" are not all numbers, expected one that has such')
    period, count = as_number(duration), whole_number("harmonics", harmonics, 2, 100)
    if not PERIODS[0] <= period <= PERIODS[1]:
        raise IdentificationError(
            f"duration is {literal(duration)}, expected a number of {PERIODS[0]:g} to {PERIODS[1]:g} seconds"
        )
    as_word("criterion", criterion, CRITERIA)
    tried, turns = whole_number("starts", starts, 1), whole_number("steps", steps, 0)
    rng = np.random.default_rng(whole_number("seed", seed, 0))
    if allowed is not None and not callable(allowed):
        raise IdentificationError(f"allowed is {literal(allowed)}, expected a function of a Path")
    columns = structural_base(model, words, payload, None, "all").columns
    search = _Search(unknowns, columns, period, count, criterion, as_flag("limits", limits))
    search.bound(centre, acceleration)

    def path_of(x: Array) -> Path:
        rates = search.free @ x
        return fourier(rates[:count], rates[count:], 1.0 / period, search.centre, model, limits=search.limits)

    best, value = None, -math.inf
    for _ in range(tried):
        x = search.within(search.random(rng))
        if x is None or (allowed is not None and not allowed(path_of(x))):
            continue
        found = search.value(x)
        if found > value:
            best, value = x, found
    if best is None:
        raise IdentificationError(
            f'none of {tried} random paths is within the limits of robot "{model.name}" and allowed, expected another '
            "centre, a longer duration or more starts"
        )
    length = 0.3
    for _ in range(turns):
        slope = search.slope(best)
        slope *= np.linalg.norm(best, axis=0) / np.maximum(np.linalg.norm(slope, axis=0), 1e-300)
        while length > 1e-3:
            x = search.within(best + length * slope)
            found = -math.inf if x is None else search.value(x)
            if x is not None and found > value and (allowed is None or allowed(path_of(x))):
                best, value, length = x, found, min(1.5 * length, 1.0)
                break
            length *= 0.5
        else:
            break
    return path_of(best)


class _Search:
    """Coefficients x (2 harmonics - 2, nv) of paths at rest at their ends, their criterion and its gradient."""

    def __init__(
        self, unknowns: Unknowns, columns: NDArray[np.intp], period: float, harmonics: int, criterion: str, limits: bool
    ) -> None:
        self.unknowns, self.columns, self.criterion, self.limits = unknowns, columns, criterion, limits
        self.harmonics = harmonics
        rates: Array = 2.0 * np.pi / period * np.arange(1.0, harmonics + 1.0)
        ends = np.zeros((2, 2 * harmonics))  # v(0) and a(0)
        ends[0, :harmonics], ends[1, harmonics:] = 1.0, rates
        self.free = np.linalg.svd(ends)[2][2:].T
        self.coarse, self.fine = (self._basis(n, period, rates) for n in (POINTS, FINE))
        self.size: Array | None = None  # norms of columns, for "cond"

    def _basis(self, n: int, period: float, rates: Array) -> tuple[Array, Array, Array]:
        """q - centre, v and a (n, 2 harmonics - 2) for each coefficient."""
        angle = np.arange(n)[:, None] * period / n * rates
        c, s = np.cos(angle), np.sin(angle)
        q = np.concatenate([s / rates, -c / rates], 1)
        return (
            q @ self.free,
            np.concatenate([c, s], 1) @ self.free,
            np.concatenate([-s * rates, c * rates], 1) @ self.free,
        )

    def bound(self, centre: Any, acceleration: Any) -> None:
        """Set the limits. Raises ShapeError, SpatialDynError."""
        model = self.unknowns.model
        low, high, fast = model.lower, model.upper, model.velocity_limit
        bounded = np.isfinite(low) & np.isfinite(high)
        if centre is None:
            self.centre = np.where(bounded, 0.5 * np.where(bounded, low, 0.0) + 0.5 * np.where(bounded, high, 0.0), 0.0)
        else:
            self.centre = as_finite("centre", centre)
            if self.centre.shape != (model.nq,):
                raise ShapeError(f"centre has shape {self.centre.shape}, expected ({model.nq},)")
        self.up = np.where(np.isfinite(high) & self.limits, high - self.centre, FREE[0])
        self.down = np.where(np.isfinite(low) & self.limits, self.centre - low, FREE[0])
        if (self.up <= 0.0).any() or (self.down <= 0.0).any():
            k = int(np.argmax((self.up <= 0.0) | (self.down <= 0.0)))
            name = next(x.name for x in own_joints(model) if x.idx_q == k)
            raise IdentificationError(
                f'centre of joint "{name}" is {self.centre[k]:.6g}, expected it within its limits'
            )
        self.fast = np.where(np.isfinite(fast) & self.limits, fast, FREE[1])
        most = as_array("acceleration", math.inf if acceleration is None else acceleration)
        if most.shape not in ((), (model.nv,)) or not (most > 0.0).all():
            raise SpatialDynError(
                f"acceleration is {literal(acceleration)}, expected numbers above 0, one or ({model.nv},)"
            )
        self.most = np.broadcast_to(most, model.nv)
        effort = model.effort_limit
        self.effort = np.where(np.isfinite(effort) & self.limits, effort, math.inf)
        self.noise = np.where(np.isfinite(effort) & (effort > 0.0), effort, 1.0)

    def random(self, rng: np.random.Generator) -> Array:
        k = np.tile(np.arange(1.0, self.harmonics + 1), 2)
        return np.asarray(
            self.free.T @ (rng.normal(size=(2 * self.harmonics, self.unknowns.model.nv)) / np.sqrt(k)[:, None])
        )

    def within(self, x: Array) -> Array | None:
        """The coefficients, scaled so that each joint reaches its nearest limit; None if efforts exceed the limits."""
        q, v, a = (B @ x for B in self.fine)
        with np.errstate(divide="ignore", invalid="ignore"):
            room = [self.up / q.max(0), self.down / -q.min(0), self.fast / abs(v).max(0), self.most / abs(a).max(0)]
        scale = MARGIN * np.min(np.where(np.isfinite(room), room, np.inf), axis=0)
        x = x * np.where(np.isfinite(scale), scale, 1.0)
        for _ in range(12):
            q, v, a = (B @ x for B in self.coarse)
            tau = np.asarray(calls["rnea"](self.unknowns.model, self.centre + q, v, a))
            if (abs(tau) <= self.effort).all():
                return x
            x = 0.8 * x
        return None

    def _columns(self, q: Array, v: Array, a: Array) -> Array:
        """Regressor rows with the base's columns, in units of the noise."""
        Y = np.asarray(calls["joint_torque_regressor"](self.unknowns.model, q, v, a))
        W = self.unknowns.stacked(Y, a, v, np.sign(v))[:, :, self.columns]
        return np.asarray(W / self.noise[:, None])

    def _states(self, x: Array) -> list[Array]:
        q, v, a = (B @ x for B in self.coarse)
        return [self.centre + q, v, a]

    def value(self, x: Array) -> float:
        return self._worth(self._columns(*self._states(x)))[0]

    def _worth(self, W: Array) -> tuple[float, Array]:
        """The criterion, where larger is better, and its derivative by W (n, nv, rank)."""
        A = W.reshape(-1, W.shape[-1])
        if self.size is None:
            self.size = np.maximum(np.sqrt((A * A).sum(0)), 1e-300)
        A = A / self.size
        if self.criterion == "logdet":
            M = A.T @ A
            M[np.diag_indices(len(M))] += RIDGE
            G = 2.0 * A @ np.linalg.inv(M)
            return float(np.linalg.slogdet(M)[1]), (G / self.size).reshape(W.shape)
        u, s, vt = np.linalg.svd(A, full_matrices=False)
        least = max(float(s[-1]), 1e-300)
        G = np.outer(u[:, -1], vt[-1]) / least - np.outer(u[:, 0], vt[0]) / s[0]
        return math.log(least / s[0]), (G / self.size).reshape(W.shape)

    def slope(self, x: Array) -> Array:
        """Gradient by x, from the derivative by W, differences of W by q, v and a, and the basis."""
        states = self._states(x)
        G = self._worth(self._columns(*states))[1]
        dry = [k for k, j in enumerate(self.columns) if self.unknowns.names[j].endswith(".coulomb")]
        G[:, :, dry] = 0.0  # a sign has no slope
        total = np.zeros_like(x)
        for kind, B in enumerate(self.coarse):
            for i in range(x.shape[1]):
                ends = []
                for sign in (1.0, -1.0):
                    moved = [y.copy() for y in states]
                    moved[kind][:, i] += sign * STEP
                    ends.append(np.einsum("nij,nij->n", G, self._columns(*moved)))
                total[:, i] += B.T @ ((ends[0] - ends[1]) / (2.0 * STEP))
        return total
