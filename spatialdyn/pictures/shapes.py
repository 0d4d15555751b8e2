"""Geometry of a URDF as triangles: meshes, boxes, cylinders and spheres of each link, in the link's frame.

yourdfpy reads the <visual> and <collision> elements, trimesh the mesh files. A mesh that cannot be found or read is
listed by its name in the file.
"""

from __future__ import annotations

import io
import os
import warnings
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import SpatialDynError, UrdfError
from ..urdf.sources import read_source

Array = NDArray[np.float64]
Color = tuple[float, float, float, float]  # red, green, blue, opacity, each from 0 to 1
Folder = str | os.PathLike[str]

GREY: Color = (0.7, 0.7, 0.72, 1.0)  # where the file says nothing
KINDS = ("visual", "collision")
SEARCHED = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH")  # variables that list folders of packages
STEPS = 2**20  # of the longest side of a mesh: vertices nearer than one are merged
CREASE = 0.5  # rad: edges sharper than this are drawn sharp


class Shape(NamedTuple):
    """Triangles of one colour on a link.

    link      name of the link
    vertices  (n, 3) in the link's frame [m]
    faces     (m, 3) indices of vertices
    color     red, green, blue, opacity, each from 0 to 1
    textured  the same as GLB, where an image covers it; else empty
    """

    link: str
    vertices: Array
    faces: NDArray[np.int64]
    color: Color
    textured: bytes = b""


class Geometry(NamedTuple):
    """The shapes of a robot, and what of its geometry cannot be drawn: a line each, the name in the file first."""

    shapes: list[Shape]
    missing: list[str]


def urdf_shapes(source: Any, kind: str = "visual", package_dirs: Sequence[Folder] = ()) -> Geometry:
    """The geometry in a URDF.

    source        what ``load_urdf`` takes
    kind          "visual" or "collision"
    package_dirs  folders searched for the packages of ``package://`` names, before those of ``find_mesh``

    Raises  UrdfError if the source cannot be read.
    """
    yourdfpy = _yourdfpy()
    if kind not in KINDS:
        raise SpatialDynError(f"kind is {kind!r}, expected one of {', '.join(KINDS)}")
    if isinstance(source, yourdfpy.URDF):
        robot, home = source.robot, None
    else:
        path, data = read_source(source)
        home = Path(path) if path else None
        try:
            robot = yourdfpy.URDF.load(io.BytesIO(data), build_scene_graph=False, load_meshes=False).robot
        except Exception as error:  # whatever yourdfpy meets in an element that the strict pass does not read
            raise UrdfError(f"geometry of {home or 'the text'} cannot be read: {_said(error)}") from error
    palette = {material.name: material.color for material in robot.materials}
    found: list[Shape] = []
    missing: dict[str, None] = {}
    for link in robot.links:
        parts: list[Shape] = []
        for element in link.visuals if kind == "visual" else link.collisions:
            try:
                parts += _shapes_of(link.name, element, palette, home, package_dirs)
            except _NotDrawnError as error:
                missing.setdefault(str(error))
        found += _joined(parts)
    return Geometry(found, list(missing))


def find_mesh(name: str, home: Path | None, package_dirs: Sequence[Folder] = ()) -> Path | None:
    """The file that a mesh name of a URDF means, or None.

    ``package://PACKAGE/...``, with two or three slashes, and ``model://`` are searched in ``package_dirs``, in the
    folders of ROS_PACKAGE_PATH, AMENT_PREFIX_PATH and CMAKE_PREFIX_PATH, and in the folders above the URDF; a folder
    counts if it holds PACKAGE or has its name. ``file://`` is a path; any other name is relative to the URDF, else to
    ``package_dirs``.
    """
    scheme, colon, rest = name.partition("://")
    if not colon:
        places = [*([home.parent] if home is not None else []), *map(Path, package_dirs)]
        return next((place / name for place in places if (place / name).is_file()), None)
    if scheme == "file":
        return Path(rest) if Path(rest).is_file() else None
    if scheme not in ("package", "model"):
        return None
    package, *inner = [part for part in rest.split("/") if part]
    for folder in (*map(Path, package_dirs), *_listed_folders(), *(home.parents if home is not None else ())):
        for base in (folder / package, *([folder] if folder.name == package else [])):
            if inner and base.joinpath(*inner).is_file():
                return base.joinpath(*inner)
    return None


def _listed_folders() -> Iterator[Path]:
    """Folders of the environment's variables, and ``share`` in each of them."""
    for variable in SEARCHED:
        for folder in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield Path(folder)
            yield Path(folder, "share")


class _NotDrawnError(Exception):
    """Says what of the geometry cannot be drawn, and why."""


def _yourdfpy() -> Any:
    try:
        import trimesh  # noqa: F401
        import yourdfpy
    except ImportError as error:
        raise SpatialDynError(f'{error.name} is not installed; pip install "spatialdyn[view]"') from error
    return yourdfpy


def _said(error: Exception) -> str:
    """The first line of an error, or its type."""
    return str(error).strip().partition("\n")[0] or type(error).__name__


def _shapes_of(
    link: str, element: Any, palette: dict[str, Any], home: Path | None, package_dirs: Sequence[Folder]
) -> Iterator[Shape]:
    """The shapes of a <visual> or <collision>. Raises _NotDrawnError."""
    given, material = element.geometry, getattr(element, "material", None)
    color = None if material is None else material.color or palette.get(material.name)
    rgba: Color | None = None if color is None else tuple(float(x) for x in color.rgba)  # type: ignore[assignment]
    X = np.eye(4) if element.origin is None else element.origin
    if given is None:
        return
    if given.mesh is None:
        vertices, faces = _primitive(given)
        yield Shape(link, _moved(vertices, X), faces, rgba or GREY)
        return
    name = given.mesh.filename or ""
    path = find_mesh(name, home, package_dirs)
    if path is None:
        raise _NotDrawnError(f"{name} is not found")
    scale = np.ones(3) if given.mesh.scale is None else np.broadcast_to(given.mesh.scale, 3)
    yield from _mesh_parts(link, path, name, X @ np.diag([*scale, 1.0]), rgba)


def mesh_shapes(link: str, path: str, scale: Any) -> tuple[list[Shape], list[str]]:
    """The shapes of a mesh file, in the frame of a link, and a line if it cannot be drawn; scale: a number or (3,)."""
    _yourdfpy()
    found = Path(path)
    try:
        if not found.is_file():
            raise _NotDrawnError(f"{path} is not found")
        return _joined([*_mesh_parts(link, found, path, np.diag([*np.broadcast_to(scale, 3), 1.0]), None)]), []
    except _NotDrawnError as error:
        return [], [str(error)]


def primitive_shape(link: str, given: Any, color: Color) -> Shape | None:
    """The shape of a box, cylinder or sphere of coal, known by halfSide, halfLength and radius; None for another."""
    if hasattr(given, "halfSide"):
        return Shape(link, *box(2.0 * np.ravel(given.halfSide)), color)
    if hasattr(given, "halfLength") and hasattr(given, "radius"):
        return Shape(link, *cylinder(given.radius, 2.0 * given.halfLength), color)
    return Shape(link, *sphere(given.radius), color) if hasattr(given, "radius") else None


def _mesh_parts(link: str, path: Path, name: str, X: Array, color: Color | None) -> Iterator[Shape]:
    """The parts of a mesh file, moved and scaled by X; ``color`` where the file has none. Raises _NotDrawnError."""
    for vertices, faces, own, texture in _mesh_file(str(path), name, path.stat().st_mtime_ns):
        if np.linalg.det(X[:3, :3]) < 0.0:
            faces = faces[:, ::-1]
        yield Shape(
            link, _moved(vertices, X), faces, own or color or GREY, b"" if texture is None else _glb(texture, X)
        )


def _moved(vertices: Array, X: Array) -> Array:
    return np.asarray(vertices @ X[:3, :3].T + X[:3, 3])


def _primitive(given: Any) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and faces of a box, cylinder or sphere of yourdfpy."""
    if given.box is not None:
        return box(given.box.size)
    if given.cylinder is not None:
        return cylinder(given.cylinder.radius, given.cylinder.length)
    return sphere(given.sphere.radius)


def box(size: Any) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (24, 3) and faces of a box about the origin; size (3,) [m]. Each side has vertices of its own."""
    from trimesh import creation

    made = creation.box(np.asarray(size, float))
    return np.asarray(made.vertices[made.faces].reshape(-1, 3)), np.arange(3 * len(made.faces)).reshape(-1, 3)


def cylinder(radius: float, length: float) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and faces of a cylinder along z about the origin, with a sharp rim."""
    from trimesh import creation

    made = creation.cylinder(radius, length, sections=32)
    return _creased(np.asarray(made.vertices), np.asarray(made.faces))


def sphere(radius: float) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and faces of a sphere about the origin."""
    from trimesh import creation

    made = creation.icosphere(3, radius)
    return np.asarray(made.vertices), np.asarray(made.faces)


@lru_cache(maxsize=256)
def _mesh_file(path: str, name: str, changed: int) -> list[tuple[Array, NDArray[np.int64], Color | None, Any]]:
    """(vertices, faces, colour of the file's own, textured mesh) for each part of a mesh file; ``changed``: its time.

    Raises _NotDrawnError.
    """
    import trimesh

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            loaded = trimesh.load_scene(path, process=False)  # merged below, five times faster
    except Exception as error:  # of any reader of any format
        raise _NotDrawnError(f"{name} cannot be read ({_said(error)})") from error
    unit = str(loaded.units or "").partition(" * meters")  # of COLLADA, where it is not a metre
    scale = float(unit[0]) if unit[1] else 1.0
    parts = []
    for node in loaded.graph.nodes_geometry:
        X, key = loaded.graph[node]
        mesh = loaded.geometry[key]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        X = np.diag([scale, scale, scale, 1.0]) @ X
        vertices, faces = _moved(np.asarray(mesh.vertices), X), np.asarray(mesh.faces)
        if np.linalg.det(X[:3, :3]) < 0.0:
            faces = faces[:, ::-1]
        visual: Any = mesh.visual
        material = getattr(visual, "material", None)
        image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
        texture = mesh.copy().apply_transform(X) if image is not None and visual.uv is not None else None
        color: Color | None = None
        if material is not None or visual.defined:
            r, g, b, opacity = (np.asarray((material or visual).main_color) / 255.0).tolist()
            color = (r, g, b, opacity)
        parts.append((*_creased(vertices, faces), color, texture))
    if not parts:
        raise _NotDrawnError(f"{name} holds no triangles")
    return parts


def _glb(mesh: Any, X: Array) -> bytes:
    """A textured mesh, moved by X, in the format GLB."""
    return bytes(mesh.copy().apply_transform(X).export(file_type="glb"))


def _creased(vertices: Array, faces: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """The mesh with a vertex of its own on each side of an edge sharper than CREASE, so that it is shaded sharp.

    Around a vertex, faces whose normals agree with the first of them within CREASE share one copy, of the others those
    that agree with the next, and so on. Copies of a vertex that the mesh has already are merged first.
    """
    low, high = vertices.min(0), vertices.max(0)
    grid = np.rint((vertices - low) * (STEPS / max(float((high - low).max()), 1e-300))).astype(np.int64)
    _, one, same = np.unique(grid @ [1, STEPS + 1, (STEPS + 1) ** 2], return_index=True, return_inverse=True)
    vertices, faces = vertices[one], same.reshape(-1)[faces]
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    normals = np.cross(b - a, c - a).astype(np.float32)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float32).tiny)
    order = np.argsort(faces.ravel(), kind="stable")
    at, face = faces.ravel()[order], order // 3
    group, left, level = np.zeros(len(at), np.int64), np.arange(len(at)), 0
    while len(left):
        first = np.flatnonzero(np.diff(at[left], prepend=-1))
        lead = np.repeat(face[left[first]], np.diff(first, append=len(left)))
        agrees = np.einsum("ij,ij->i", normals[face[left]], normals[lead]) >= np.cos(CREASE)
        agrees[first] = True
        group[left[agrees]] = level
        left, level = left[~agrees], level + 1
    copies, where = np.unique(at * level + group, return_inverse=True)
    made = np.empty(len(order), np.int64)
    made[order] = where.reshape(-1)
    return vertices[copies // level], made.reshape(-1, 3)


def _joined(shapes: list[Shape]) -> list[Shape]:
    """Shapes of one link with those of one colour as one; textured ones apart."""
    by_color: dict[Color, list[Shape]] = {}
    for shape in shapes:
        if not shape.textured:
            by_color.setdefault(shape.color, []).append(shape)
    plain = []
    for color, same in by_color.items():
        starts = np.cumsum([0, *(len(shape.vertices) for shape in same)])
        faces = [shape.faces + start for shape, start in zip(same, starts, strict=False)]
        plain.append(Shape(same[0].link, np.concatenate([s.vertices for s in same]), np.concatenate(faces), color))
    return [*plain, *(shape for shape in shapes if shape.textured)]
