"""Objects of the package meshcat, drawn by viser.

They are those of ``meshcat.geometry``, known by their attributes, so that meshcat itself is not imported: boxes,
spheres, ellipsoids, cylinders, cones, triangles, mesh files, points, lines.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .mesh_files import NotDrawnError, triangles_of
from .shapes import box, sphere

Array = NDArray[np.float64]
Triangles = tuple[Array, NDArray[np.int64]]
SIDES = 48  # of a cylinder
WHITE = 0xFFFFFF


class UnknownObjectError(NotDrawnError):
    """An object of a kind that is not drawn; the message names it."""


def draw(scene: Any, name: str, kind: str, geometry: Any, material: Any) -> Any:
    """Draw a geometry of meshcat's; returns viser's handle. Raises NotDrawnError."""
    rgb, opacity = colour(material)
    X = np.asarray(geometry.intrinsic_transform(), float) if hasattr(geometry, "intrinsic_transform") else np.eye(4)
    if hasattr(geometry, "position"):
        return _points(scene, name, kind, geometry, material, X, rgb)
    vertices, faces = triangles(geometry)
    vertices = vertices @ X[:3, :3].T + X[:3, 3]
    if np.linalg.det(X[:3, :3]) < 0.0:
        faces = faces[:, ::-1]
    wire = bool(getattr(material, "wireframe", False))
    return scene.add_mesh_simple(
        name, vertices, faces, color=rgb, opacity=None if opacity >= 1.0 else opacity, side="double", wireframe=wire
    )


def colour(material: Any) -> tuple[tuple[float, float, float], float]:
    """(red, green, blue) and opacity of a material, from 0 to 1."""
    value = int(getattr(material, "color", WHITE) or 0)
    rgb = tuple(((value >> shift) & 0xFF) / 255.0 for shift in (16, 8, 0))
    return (rgb[0], rgb[1], rgb[2]), float(getattr(material, "opacity", 1.0))


def triangles(geometry: Any) -> Triangles:
    """Vertices and faces of a geometry of meshcat's. Raises NotDrawnError."""
    if hasattr(geometry, "lengths"):
        return box(np.asarray(geometry.lengths, float))
    if hasattr(geometry, "radiusTop"):
        return frustum(float(geometry.radiusTop), float(geometry.radiusBottom), float(geometry.height))
    if hasattr(geometry, "vertices") and hasattr(geometry, "faces"):
        return np.asarray(geometry.vertices, float).reshape(-1, 3), np.asarray(geometry.faces, np.int64).reshape(-1, 3)
    if hasattr(geometry, "contents"):
        return _of_file(geometry)
    if hasattr(geometry, "radius"):
        return sphere(float(geometry.radius))
    what = f"a {type(geometry).__name__} is not drawn"
    raise UnknownObjectError(f"{what}, expected a box, sphere, cylinder, triangles, a mesh, points or lines")


def frustum(top: float, bottom: float, height: float) -> Triangles:
    """A cylinder or cone along y about the origin, with a sharp rim."""
    angle = np.arange(SIDES) * (2.0 * np.pi / SIDES)
    ring = np.stack([np.sin(angle), np.zeros(SIDES), np.cos(angle)], axis=1)
    up = np.array([0.0, 0.5 * height, 0.0])
    rings = [bottom * ring - up, top * ring + up]
    vertices = np.concatenate([*rings, *rings, [-up], [up]])
    k, after, n = np.arange(SIDES), np.roll(np.arange(SIDES), -1), SIDES
    around = [np.stack([k, after, n + after], 1), np.stack([k, n + after, n + k], 1)]
    caps = [np.stack([2 * n + after, 2 * n + k, np.full(n, 4 * n)], 1)]
    caps += [np.stack([3 * n + k, 3 * n + after, np.full(n, 4 * n + 1)], 1)]
    return vertices, np.concatenate([*around, *caps])


def _of_file(geometry: Any) -> Triangles:
    """The triangles of a mesh file that a geometry holds. Raises NotDrawnError."""
    contents = geometry.contents
    data = contents.encode() if isinstance(contents, str) else bytes(contents)
    return triangles_of(data, str(geometry.mesh_format))


def _points(scene: Any, name: str, kind: str, geometry: Any, material: Any, X: Array, rgb: Any) -> Any:
    """Points, or lines through them."""
    points = np.asarray(geometry.position, float).T.reshape(-1, 3) @ X[:3, :3].T + X[:3, 3]
    colors = getattr(geometry, "color", None)
    colours = None if colors is None else np.clip(np.asarray(colors, float).T.reshape(-1, 3), 0.0, 1.0)
    if kind == "Points":
        size = float(getattr(material, "size", 0.01))
        return scene.add_point_cloud(name, points, np.array(rgb) if colours is None else colours, point_size=size)
    order = np.arange(len(points))
    if kind == "LineLoop":
        order = np.append(order, 0)
    at = order.reshape(-1, 2) if kind == "LineSegments" else np.stack([order[:-1], order[1:]], axis=1)
    shades: Any = np.array(rgb) if colours is None else colours[at]
    width = float(getattr(material, "linewidth", 1.0))
    return scene.add_line_segments(name, points[at], shades, thickness=2.0 * width, thickness_units="screen")


def set_property(handle: Any, key: str, value: Any) -> None:
    """Set a property of viser's handle, as far as it has one."""
    if key == "visible":
        handle.visible = bool(value)
    elif key == "scale":
        handle.scale = tuple(np.broadcast_to(np.asarray(value, float), 3).tolist())
    elif key == "opacity" and hasattr(handle, "opacity"):
        handle.opacity = None if float(value) >= 1.0 else float(value)
    elif key == "color":
        rgba = np.asarray(value, float)
        if hasattr(handle, "color"):
            handle.color = tuple(np.round(255.0 * rgba[:3]).astype(int).tolist())
        if len(rgba) > 3:
            set_property(handle, "opacity", rgba[3])
