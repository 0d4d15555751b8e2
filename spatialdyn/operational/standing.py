"""The constant parts of the program for the points that stand: its rows and variables, and their names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .feet import Foot, part_of
from .quadratic import EQUAL, NONE
from .terms import State

Array = NDArray[np.float64]


class Standing(NamedTuple):
    """The constant parts of the program for some points.

    at       indices of the points
    whole    whether the program has all rows and points, as the call writes it
    bodies   its rows of torques: of the base and of joints with a limit
    feet     (ns, all ns) maps the equations of all feet to its equations of feet
    pyramids its rows of pyramids
    columns  its variables
    sense, names, size  as of ``Program``
    """

    at: tuple[int, ...]
    whole: bool
    bodies: NDArray[np.intp]
    feet: Array
    pyramids: NDArray[np.intp]
    columns: NDArray[np.intp]
    sense: NDArray[np.int32]
    names: tuple[tuple[str, str], ...]
    size: Array

    @classmethod
    def of(cls, body: Any, feet: Sequence[Foot], at: tuple[int, ...]) -> Standing:
        """The constant parts for these points of a WholeBody."""
        n, contacts, parts, k = body.model.nv, body.contacts, [], len(at)
        for foot in feet:
            standing = tuple(p for p in foot.at if p in at)
            parts.append(part_of(contacts, foot, standing) if standing else np.zeros((0, len(foot.B))))
        ns = sum(x.shape[1] for x in parts)
        blocks, i, j = np.zeros((sum(len(x) for x in parts), ns)), 0, 0
        for x in parts:
            blocks[i : i + len(x), j : j + x.shape[1]] = x
            i, j = i + len(x), j + x.shape[1]
        bodies = np.flatnonzero(body.limit < NONE)
        points = np.array(at, np.intp)
        pyramids = (n + ns + 4 * points[:, None] + np.arange(4)).ravel()
        columns = np.r_[np.arange(n), (n + 3 * points[:, None] + np.arange(3)).ravel()].astype(np.intp)
        whole = len(bodies) == n and at == tuple(range(len(contacts)))
        own = [joint for joint in body.model.joints[1:] if joint.mimic is None]
        joints = [(joint.name, *units(joint)) for joint in own for _ in range(joint.nv)]
        names = [(f'position or velocity limit of joint "{x}"', unit) for x, unit, _ in joints]
        names += [(f'push of the ground at point "{contacts.names[p]}"', "N") for p in at for _ in range(3)]
        names += [(f'torque limit of joint "{joints[i][0]}"', joints[i][2]) for i in bodies]
        names += [("feet", "")] * len(blocks)
        names += [(f'friction at point "{contacts.names[p]}"', "N") for p in at for _ in range(4)]
        size = np.concatenate([
            np.ones(n), np.full(3 * k, body.weight), 1.0 / body.unit[bodies], np.ones(len(blocks)),
            np.full(4 * k, body.weight),
        ])  # fmt: skip
        rows = np.r_[np.where(body.limit[bodies] == 0.0, EQUAL, 0), np.full(len(blocks), EQUAL), np.zeros(4 * k)]
        sense = np.r_[np.zeros(n + 3 * k), rows].astype(np.int32)
        return cls(at, whole, bodies, blocks, pyramids, columns, sense, tuple(names), size)

    def program(self, x: State) -> tuple[Array, Array, Array]:
        """The rows and bounds of its program."""
        if self.whole:
            return x.rows, x.low, x.high
        n, width = len(x.bias), x.rows.shape[1]
        feet = slice(n, n + self.feet.shape[1])
        rows = np.concatenate([x.rows[self.bodies], self.feet @ x.rows[feet], x.rows[self.pyramids]])
        bounds = []
        for whole in (x.low, x.high):
            of_rows = whole[width:]
            bounds += [whole[self.columns], of_rows[self.bodies], self.feet @ of_rows[feet], of_rows[self.pyramids]]
        return np.ascontiguousarray(rows[:, self.columns]), np.concatenate(bounds[:4]), np.concatenate(bounds[4:])


def units(joint: Any) -> tuple[str, str]:
    """Units of accelerations and torques of a joint."""
    if joint.nv > 1:
        return "rad/s² | m/s²", "N m | N"
    return ("m/s²", "N") if joint.kind == "prismatic" else ("rad/s²", "N m")
