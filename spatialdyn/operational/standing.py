"""What is constant of the program of some feet: rows of their pyramids, limits, and the names of all of it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .feet import Foot

Array = NDArray[np.float64]


class Standing(NamedTuple):
    """What is constant of some points: rows of the pyramids, limits, names and sizes."""

    feet: list[Foot]
    order: list[int]
    G: Array
    h: Array
    torque_rows: tuple[tuple[slice, float], ...]
    driven: NDArray[np.intp]
    effort: Array
    least: Array
    most: Array
    bounded: bool
    fastest: Array
    groups: tuple[tuple[str, str], ...]
    size: Array
    bounds: tuple[tuple[str, str], ...]
    scale: Array

    @classmethod
    def of(cls, body: Any, feet: list[Foot], order: list[int]) -> Standing:
        """Of the points in that order."""
        model, n, k = body.model, body.model.nv, len(order)
        effort, fastest = np.array(model.effort_limit), np.array(model.velocity_limit)
        driven = np.flatnonzero((effort > 0.0) & np.isfinite(effort) & (np.arange(n) >= body.base))
        if "torque" not in body.limits:
            driven = driven[:0]
        if "velocity" not in body.limits:
            fastest = np.full(n, np.inf)
        fastest = np.where(fastest > 0.0, fastest, np.inf)
        m = len(driven)
        G, h = np.zeros((4 * k + 2 * m, n + 3 * k)), np.zeros(4 * k + 2 * m)
        groups: list[tuple[str, str]] = []
        contacts = body.scene.contacts
        for i, point in enumerate(order):
            assert contacts is not None
            for j, (axis, sign) in enumerate(((1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0))):
                G[4 * i + j, n + 3 * i + axis] = sign
                G[4 * i + j, n + 3 * i] = -contacts.friction[point] / math.sqrt(2.0)
            groups += [(f'friction at point "{contacts.names[point]}"', "N")] * 4
        torque_rows = (slice(4 * k, 4 * k + m), 1.0), (slice(4 * k + m, 4 * k + 2 * m), -1.0)
        h[4 * k :] = 1.0
        groups += [(f'torque limit of joint "{body._names[i]}"', "N m | N") for i in driven] * 2
        least, most = np.full(n + 3 * k, -np.inf), np.full(n + 3 * k, np.inf)
        least[n::3], most[n::3] = 0.0, body.largest / body.weight
        size = np.r_[np.full(4 * k, body.weight), np.tile(effort[driven], 2)]
        bounds = [(f'position or velocity limit of joint "{name}"', "rad/s² | m/s²") for name in body._names]
        for point in order:
            assert contacts is not None
            bounds += [(f'push of the ground at point "{contacts.names[point]}"', "N")] * 3
        scale = np.r_[np.ones(n), np.full(3 * k, body.weight)]
        bounded = "position" in body.limits or bool(np.isfinite(fastest).any())
        return cls(
            feet, order, G, h, torque_rows if m else (), driven, effort[driven], least, most, bounded, fastest,
            tuple(groups), size, tuple(bounds), scale,
        )  # fmt: skip
