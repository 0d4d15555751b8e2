"""The equations of a recording: rows W π = y, of torques at samples or of momenta over steps.

torque    Y(q, v, a) π = τ at each sample, with accelerations
momentum  (p(k+1) - p(k)) / h - mean of (Cᵀ v - g) = mean torque of a step, linear in π and without accelerations; the
          mean on the left by Simpson's rule on a cubic. A torque held over a step equals its mean, except that
          velocities miss part of its jumps (``held_weights``); the mean of another torque is that of a cubic through
          four samples
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..actuation.friction import Friction
from ..calls.dynamics import calls
from ..errors import IdentificationError
from .motions import MEANS, States, cubic_at, held_weights, means_of_steps, motion_of, shared_by_means, summed
from .recording import Recording
from .unknowns import Unknowns

Array = NDArray[np.float64]
FORMS = ("torque", "momentum")
HOLDS = ("after", "before")  # a torque acts from its sample to the next one, or from the previous one to its sample
CHUNK = 2048  # rows of each joint at a time
KEPT = 1 << 25  # largest size of all rows, over all recordings, that is kept in memory


@dataclass(frozen=True, eq=False)
class Settings:
    """Settings that make equations from a recording: see ``identify``."""

    unknowns: Unknowns
    form: str = "torque"
    hold: str | None = None
    window: int = 1
    cutoff: float | None = None
    v_min: float = 0.0
    friction: Friction | None = None
    base_rows: bool = False

    @property
    def freedoms(self) -> int:
        """Number of rows per time; six for rows of the floating base alone."""
        return 6 if self.base_rows else self.unknowns.model.nv


class Rows(NamedTuple):
    """Rows of n times: W (n, nv, count), y (n, nv), which of them count (n, nv), t (n,) [s], measured τ (n, nv)."""

    W: Array
    y: Array
    keep: NDArray[np.bool_]
    t: Array
    tau: Array


class Equations:
    """The equations of one recording, with a delay: the torque of time t acts at t + delay."""

    def __init__(self, recording: Recording, settings: Settings, kept: int = KEPT) -> None:
        """Filter the motion. Rows are made later; up to ``kept`` numbers of them stay in memory.

        Raises IdentificationError for commanded torques.
        """
        if recording._commanded:
            raise IdentificationError(
                "recording is of a run with motors, whose tau is the commanded torque, expected the torque that acted: "
                "where the motors were within their limits, Recording(run.t, run.q, run.tau, run.v)"
            )
        self.recording, self.settings = recording, settings
        model = settings.unknowns.model
        self.model = model
        self.motion = motion_of(recording, model, settings.cutoff, settings.form == "torque")
        self._kept = kept
        self._made: dict[float, list[tuple[Array, Array, NDArray[np.bool_]]]] = {}

    @cached_property
    def torques(self) -> Array:
        """Torques (N or N - 1, nv) on the right of the rows without a delay, by the index of their sample."""
        return self._acting(0.0)

    def shared(self, delay: float) -> tuple[int, float]:
        """``shared_by_means`` of the rows; (1, 1) if rows share no sample."""
        return shared_by_means(self.settings.window, self._weights(self._split(delay)[1]))

    def _split(self, delay: float) -> tuple[int, float]:
        """Whole samples of a delay, and the remaining part of a sample."""
        whole = int(np.floor(delay / self.recording.dt + 1e-9))
        part = max(0.0, delay / self.recording.dt - whole)
        return whole, 0.0 if part < 1e-9 else part

    def _weights(self, part: float) -> Array:
        """Weights of the samples whose sum is a row's torque."""
        if self.settings.form == "torque":
            return np.ones(1)
        return np.array(MEANS) if self.settings.hold is None else held_weights(self.motion.velocities, part)

    def _acting(self, part: float) -> Array:
        """Torques (N or N - 1, nv) of samples or steps, shifted by ``part`` of a step."""
        tau = self.recording.torques(self.model)
        if self.settings.form == "torque":
            return tau
        if self.settings.hold is None:
            return means_of_steps(tau)
        return summed(tau[:-1] if self.settings.hold == "after" else tau[1:], self._weights(part))

    def rows(self, delay: float = 0.0) -> Iterator[Rows]:
        """All rows, in chunks; a window of several rows gives the mean of both sides."""
        whole, part = self._split(delay)
        torques = self._acting(part) if part else self.torques
        window, rest = self.settings.window, None
        at = self.motion.first - whole  # the sample whose torque belongs to the first row
        for W, known, keep in self._left(part):
            n = len(W)
            first, last = max(0, -at), min(n, len(torques) - at)
            if last > first:
                tau = torques[at + first : at + last, : known.shape[1]]
                t = self.recording.t[at + first : at + last]
                made = Rows(W[first:last], tau - known[first:last], keep[first:last], t, tau)
                if window == 1:
                    yield made
                else:
                    made = made if rest is None else _joined(rest, made)
                    end = len(made.y) // window * window
                    rest = _cut(made, end, len(made.y))
                    if end:
                        yield _means(_cut(made, 0, end), window)
            at += n

    def left_sides(self, most: int) -> Iterator[tuple[Array, Array, NDArray[np.bool_]]]:
        """W, the known part of the torque, and which rows count, without a delay; for at most about ``most`` times."""
        n = 0
        for one in self._left(0.0):
            yield one
            n += len(one[0])
            if n >= most:
                return

    def _left(self, part: float) -> Iterator[tuple[Array, Array, NDArray[np.bool_]]]:
        """Left sides with their known parts; kept in memory if small, for one value of ``part``."""
        if part in self._made:
            yield from self._made[part]
            return
        count = len(self.settings.unknowns.names)
        keep = len(self.motion) * self.model.nv * count <= self._kept
        made = []
        end = len(self.motion) - (1 if part else 0) - (1 if self.settings.form == "momentum" else 0)
        for start in range(0, end, CHUNK):
            stop = min(start + CHUNK, end)
            one = self._samples(start, stop, part) if self.settings.form == "torque" else self._steps(start, stop, part)
            made += [one] * keep
            yield one
        if keep:
            self._made = {part: made}

    def _samples(self, start: int, stop: int, part: float) -> tuple[Array, Array, NDArray[np.bool_]]:
        q, v, a = self.motion.between(start, stop, part)
        assert a is not None
        Y = np.asarray(calls["joint_torque_regressor"](self.model, q, v, a))
        W = self.settings.unknowns.stacked(Y, a, v, np.sign(v))
        whole = np.asarray(calls["rnea"](self.model, q, v, a))
        still = abs(v) <= self.settings.v_min
        return self._known(W, whole, v, np.sign(v), still, self._wrenches(q, start, part))

    def _steps(self, start: int, stop: int, part: float) -> tuple[Array, Array, NDArray[np.bool_]]:
        h, model = self.motion.dt, self.model
        ends = self.motion.between(start, stop + 1, part)
        half = part + 0.5
        middle = self.motion.between(start + int(half), stop + int(half), half - int(half))
        p = np.asarray(calls["momentum_regressor"](model, ends.q, ends.v))
        rate, at_middle = self._rates(ends), self._rates(middle)
        Y = (p[1:] - p[:-1]) / h - (rate[1:] + 4.0 * at_middle + rate[:-1]) / 6.0
        a, (v0, v1) = (ends.v[1:] - ends.v[:-1]) / h, (ends.v[:-1], ends.v[1:])
        v = np.asarray(calls["difference"](model, ends.q[:-1], ends.q[1:])) / h
        span = v1 - v0
        same = span == 0.0
        sign = np.where(same, np.sign(v0), (abs(v1) - abs(v0)) / np.where(same, 1.0, span))  # of a straight line
        W = self.settings.unknowns.stacked(Y, a, v, sign)
        p = np.asarray(calls["momentum"](model, ends.q, ends.v))
        none = np.zeros(model.nv)
        rates = [np.asarray(calls["momentum_rate"](model, x.q, x.v, none)) for x in (ends, middle)]
        whole = (p[1:] - p[:-1]) / h - (rates[0][1:] + 4.0 * rates[1] + rates[0][:-1]) / 6.0
        still = (np.minimum(abs(v0), abs(v1)) < self.settings.v_min) | ((v0 == 0.0) & (v1 == 0.0))
        still |= self._turning(start, stop, part)
        if not self.recording.wrenches:
            return self._known(W, whole, v, sign, still, None)
        last = len(self.motion) - (1 if part else 0)
        first, end = max(0, start - 1), min(stop + 2, last)  # one neighbour more on both sides, for means over four
        forces = self._wrenches(self.motion.between(first, end, part).q, first, part)
        assert forces is not None
        means = means_of_steps(forces)[start - first :][: stop - start]
        return self._known(W, whole, v, sign, still, means)

    def _turning(self, start: int, stop: int, part: float) -> NDArray[np.bool_]:
        """Which steps (n, nv) use samples before and after a joint reverses, where dry friction jumps."""
        v = self.motion.states.v
        k = np.arange(start, stop)
        few = self.settings.hold is not None and self.motion.velocities == "measured"
        first, last = (0, 1) if few else (-1, 2)
        near = np.sign([v[np.clip(k + i, 0, len(v) - 1)] for i in range(first, last + (2 if part else 1))])
        return np.asarray(near.min(0) != near.max(0))

    def _rates(self, x: States) -> Array:
        """Regressor of Cᵀ v - g."""
        still = np.zeros_like(x.v)
        gravity = np.asarray(calls["joint_torque_regressor"](self.model, x.q, still, still))
        return np.asarray(calls["coriolis_transpose_regressor"](self.model, x.q, x.v) - gravity)

    def _known(
        self, W: Array, whole: Array, v: Array, sign: Array, still: NDArray[np.bool_], forces: Array | None
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """W, the known part of the torque, and which rows count."""
        unknowns, friction = self.settings.unknowns, self.settings.friction
        known = whole - W @ unknowns.present
        kinds = {kind for kind, _ in unknowns.joints}
        if friction is not None:
            known += 0.0 if "viscous" in kinds else friction.viscous * v
            known += 0.0 if "coulomb" in kinds else friction.coulomb * sign
        if forces is not None:
            known = known - forces
        keep = np.ones(known.shape, bool)
        dry = friction is not None and bool(np.any(friction.coulomb))
        for kind, k in unknowns.joints:
            if kind == "coulomb":
                keep[:, k] = ~still[:, k]
        if dry and "coulomb" not in kinds:
            keep &= ~still
        rows = self.settings.freedoms
        return W[:, :rows], known[:, :rows], keep[:, :rows]

    def _wrenches(self, q: Array, start: int, part: float) -> Array | None:
        """Torques (n, nv) of the measured wrenches; None without any."""
        if not self.recording.wrenches:
            return None
        total = np.zeros((len(q), self.model.nv))
        for frame, given in self.recording.wrenches.items():
            first = self.motion.first + start
            force = cubic_at(given, first, first + len(q), part) if part else given[first : first + len(q)]
            J = np.asarray(calls["frame_jacobian"](self.model, q, frame))
            total += np.einsum("nij,ni->nj", J, force)
        return total


def _joined(one: Rows, other: Rows) -> Rows:
    pairs: Any = [np.concatenate(pair) for pair in zip(one, other, strict=True)]
    return Rows(*pairs)


def _cut(rows: Rows, first: int, last: int) -> Rows:
    parts: Any = [x[first:last] for x in rows]
    return Rows(*parts)


def _means(rows: Rows, window: int) -> Rows:
    n = len(rows.y) // window
    W, y, tau = (x.reshape(n, window, *x.shape[1:]).mean(1) for x in (rows.W, rows.y, rows.tau))
    keep = np.asarray(rows.keep.reshape(n, window, -1).all(1))
    return Rows(W, y, keep, rows.t.reshape(n, window).mean(1), tau)


def refuse_flight(recording: Recording, settings: Settings) -> None:
    """Raise IdentificationError for base rows without a measured force, which determine only ratios of parameters."""
    if settings.base_rows and not recording.wrenches:
        raise IdentificationError(
            "recording has no wrenches, expected them for the rows of the base alone: without a measured force they "
            "tell ratios of inertias, of no scale"
        )
