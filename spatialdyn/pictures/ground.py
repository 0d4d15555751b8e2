"""The ground of contacts in a picture: its normal below a point, and a heightfield as triangles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..algebra.heights import bilinear
from ..constraints.contact_points import Contacts, Heightfield, Plane
from ..constraints.kinds import across

Array = NDArray[np.float64]
MOST = 30_000  # vertices of a surface, up to which cells are cut into smaller ones
FINEST = 4  # the most parts of a cell's side, as a bilinear cell is curved


class Surface(NamedTuple):
    """Triangles: vertices (n, 3) [m] in the world, faces (m, 3) of their indices; edges (l, 2, 3) of the cells [m]."""

    vertices: Array
    faces: NDArray[np.int64]
    edges: Array


def normals(contacts: Contacts, points: Array) -> Array:
    """The ground's normals (..., k, 3) where the spheres of k points, at (..., k, 3) of the world, touch it."""
    terrain = contacts.terrain
    if isinstance(terrain, Plane):
        return np.broadcast_to(np.array(terrain.normal, np.float64), points.shape)
    assert contacts.ground is not None
    rows, layers = contacts.ground.rows.view(np.recarray), contacts.table.rows["heights"][1 : 1 + len(contacts)]
    cells = (points[..., :2] - terrain.origin) / terrain.spacing
    found = np.ones((points.size // 3, 3))
    firsts = np.broadcast_to(layers, points.shape[:-1]).ravel().tolist()
    for n, (x, y), first in zip(found, cells.reshape(-1, 2).tolist(), firsts, strict=True):
        n[:2] = -np.array(bilinear(x, y, rows, first)[1:]) / terrain.spacing
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True)).reshape(points.shape)


def height(terrain: Heightfield, xy: Array) -> Array:
    """Heights (n,) [m] of a heightfield at places (n, 2) [m]."""
    return _slopes(terrain, xy)[:, 0]


def _slopes(terrain: Heightfield, xy: Array) -> Array:
    """(height, ∂/∂x, ∂/∂y) (n, 3) at places (n, 2) [m], derivatives by cells."""
    rows = terrain.table.rows.view(np.recarray)
    cells = (xy - terrain.origin) / terrain.spacing
    return np.array([bilinear(x, y, rows, 1) for x, y in cells.tolist()], np.float64).reshape(-1, 3)


def surface(terrain: Heightfield, box: Array) -> Surface:
    """A heightfield and the level ground beyond its rim, as far as a box (2, 3) [m] around the motion reaches."""
    nx, ny = terrain.z.shape
    parts = FINEST
    while parts > 1 and (parts * nx) * (parts * ny) > MOST:
        parts -= 1
    lines, whole = [], []
    for k, n in enumerate((nx, ny)):
        low, high = terrain.origin[k], terrain.origin[k] + (n - 1) * terrain.spacing
        inside = low + terrain.spacing * np.arange((n - 1) * parts + 1) / parts
        before, after = ([box[0, k]] if box[0, k] < low else []), ([box[1, k]] if box[1, k] > high else [])
        lines.append(np.concatenate([before, inside, after]))
        whole.append(len(before) + parts * np.arange(n))  # those between cells
    x, y = np.meshgrid(*lines, indexing="ij")
    xy = np.stack([x.ravel(), y.ravel()], axis=1)
    at = np.arange(x.size).reshape(x.shape)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[:-1, 1:].ravel(), at[1:, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    vertices = np.column_stack([xy, height(terrain, xy)])
    rows, columns = at[whole[0]], at[:, whole[1]].T
    ends = [np.stack([x[:, :-1], x[:, 1:]], axis=-1).reshape(-1, 2) for x in (rows, columns)]
    return Surface(vertices, faces, vertices[np.concatenate(ends)])


def axes_of(terrain: Plane) -> Array:
    """The rotation (3, 3) of a plane, z its normal."""
    n = np.array(terrain.normal, np.float64)
    return np.column_stack([*across(n), n])


def centres(contacts: Contacts, X: Array) -> Array:
    """Centres (..., k, 3) of the points' spheres, with bodies at X (..., bodies, 4, 4) [m]."""
    frames = [contacts.model.frame(name) for name in contacts.names]
    made = [X[..., f.joint, :3, :3] @ f.placement[:3, 3] + X[..., f.joint, :3, 3] for f in frames]
    return np.stack(made, axis=-2) if made else np.empty((*X.shape[:-3], 0, 3))
