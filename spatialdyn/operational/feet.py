"""The contacts of a scene as feet: points on each body, the equations that keep it still, and forces on the points.

A body with contact points has its velocity V in its own axes. Points p that stay where they are make the rows
[1 -p̃] V = 0, of which at most six are independent: B, an orthonormal basis of them, is constant. A force f on a point,
as (normal, tangent, tangent), has the joint torques Jᵀ [Rᵀ D f; p × Rᵀ D f], J the body's Jacobian, R its orientation
and D the ground's axes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.dynamics import calls
from ..constraints.contact_points import Contacts, Plane
from ..errors import ConstraintError, literal
from ..model.model import Model

Array = NDArray[np.float64]
INDEPENDENT = 1e-8  # of the largest singular value of a foot's rows; lengths in metres


class Foot(NamedTuple):
    """A body that touches the ground.

    frame   name of a frame of the body, whose coordinates are the body's
    joint   index of its joint
    at      indices of its points among those of the contacts
    levers  (k, 3, 3) p̃ of its points in the body
    radii   (k,) of their spheres
    rolls   whether one of them is not 0
    rows    (r, 6) B
    """

    frame: str
    joint: int
    at: tuple[int, ...]
    levers: Array
    radii: Array
    rolls: bool
    rows: Array


def feet_of(model: Model, contacts: Contacts, at: tuple[int, ...]) -> list[Foot]:
    """The bodies of some points of the contacts."""
    groups: dict[int, list[int]] = {}
    for k in at:
        groups.setdefault(model.frame(contacts.names[k]).joint, []).append(k)
    found = []
    for joint, points in groups.items():
        p = np.array([model.frame(contacts.names[k]).placement[:3, 3] for k in points])
        levers = np.array([cross_matrix(x) for x in p])
        stacked = np.concatenate([np.hstack([np.eye(3), -x]) for x in levers])
        _, s, Vt = np.linalg.svd(stacked)
        rank = int((s > INDEPENDENT * s[0]).sum())
        radii = np.array([contacts.radii[k] for k in points])
        name = f"joint:{model.joints[joint].name}"
        found.append(Foot(name, joint, tuple(points), levers, radii, bool(radii.any()), Vt[:rank]))
    return found


def ground_axes(contacts: Contacts) -> Array:
    """The ground's normal and two tangents, as columns. Raises ConstraintError for ground that is not flat."""
    if not isinstance(contacts.terrain, Plane):
        raise ConstraintError(f"the contacts' terrain is {literal(contacts.terrain)}, expected a Plane for WholeBody")
    axes = contacts.table.rows[0]["axes"]
    return np.array([[axes[letter + column] for letter in "xyz"] for column in "xyz"])


def cross_matrix(p: Array) -> Array:
    """p̃."""
    return np.array([[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]])


class Stance(NamedTuple):
    """The feet at a state.

    J      (r, nv), drift (r,), rate (r,)  rows of J, J̇ v, and J v: of all feet
    pull   (nv, 3 k)  joint torques per force, three columns for each point
    """

    J: Array
    drift: Array
    rate: Array
    pull: Array


def stance(model: Model, feet: list[Foot], axes: Array, q: Array, v: Array) -> Stance:
    """The feet's rows and forces at q (nq,), v (nv,)."""
    rows = sum(len(foot.rows) for foot in feet)
    J, drift = np.empty((rows, model.nv)), np.empty(rows)
    pull = np.empty((model.nv, 3 * sum(len(foot.at) for foot in feet)))
    i = j = 0
    for foot in feet:
        body = calls["frame_jacobian"](model, q, foot.frame)
        R = calls["frame_placement"](model, q, foot.frame)[:3, :3]
        D = R.T @ axes  # the ground's axes in the body
        wrench = np.empty((6, len(foot.at), 3))
        wrench[:3] = D[:, None, :]
        wrench[3:] = (foot.levers @ D).transpose(1, 0, 2)
        if foot.rolls:  # a sphere touches below its centre: p - r n, and n × n is 0
            wrench[3:, :, 1] -= np.multiply.outer(np.cross(D[:, 0], D[:, 1]), foot.radii)
            wrench[3:, :, 2] -= np.multiply.outer(np.cross(D[:, 0], D[:, 2]), foot.radii)
        m, n = len(foot.rows), 3 * len(foot.at)
        J[i : i + m] = foot.rows @ body
        drift[i : i + m] = foot.rows @ calls["jacobian_dot_times_v"](model, q, v, foot.frame)
        pull[:, j : j + n] = body.T @ wrench.reshape(6, n)
        i, j = i + m, j + n
    return Stance(J, drift, J @ v, pull)
