"""The contacts of a scene as feet: the equations that hold bodies at rest, and their points.

A body with several contact points has its velocity V in its own axes. Points p at rest give the rows [1 -p̃] V = 0, of
which at most six are independent; their orthonormal basis B is constant. A body with one point is at rest where its
sphere touches, along the ground's normal and across it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..constraints.contact_points import Contacts
from ..model.model import Model

Array = NDArray[np.float64]
INDEPENDENT = 1e-8  # of the largest singular value of a foot's rows; lengths in metres


class Foot(NamedTuple):
    """A body that touches the ground.

    row     row of the body in the table
    at      indices of its points among those of the contacts
    B       (r, 6) independent rows, linear first; for one point the three rows of its sphere's lowest point, in order
    """

    row: int
    at: tuple[int, ...]
    B: Array


def feet_of(model: Model, contacts: Contacts) -> list[Foot]:
    """The bodies that have contact points."""
    groups: dict[int, list[int]] = {}
    for k in range(len(contacts)):
        groups.setdefault(int(contacts.table.rows["row"][1 + k]), []).append(k)
    return [Foot(row, tuple(at), basis(contacts, at) if len(at) > 1 else np.eye(3, 6)) for row, at in groups.items()]


def basis(contacts: Contacts, at: Iterable[int]) -> Array:
    """An orthonormal basis (r, 6) of [1 -p̃] of some points of a body."""
    stacked = []
    for k in at:
        p = contacts.table.rows["p"][1 + k]
        x, y, z = float(p["x"]), float(p["y"]), float(p["z"])
        stacked.append(np.hstack([np.eye(3), [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]]))
    _, s, Vt = np.linalg.svd(np.concatenate(stacked))
    found: Array = Vt[: int((s > INDEPENDENT * s[0]).sum())]
    return found


def part_of(contacts: Contacts, foot: Foot, at: tuple[int, ...]) -> Array:
    """Matrix (r, rows of all) that maps the rows of all points to the rows of the points ``at`` that stand."""
    found: Array = np.eye(len(foot.B)) if at == foot.at else basis(contacts, at) @ foot.B.T
    return found
