"""Geometry of a URDF as triangles: meshes, boxes, cylinders and spheres of each link, in the link's frame.

yourdfpy reads the <visual> and <collision> elements, trimesh the mesh files. A mesh that cannot be found or read is
listed by its name in the file.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import SpatialDynError, UrdfError, literal, pip_install
from ..urdf.sources import read_source
from .mesh_files import Color, Folder, NotDrawnError, creased, find_mesh, glb, moved, read_mesh, said

Array = NDArray[np.float64]

GREY: Color = (0.7, 0.7, 0.72, 1.0)  # if the file gives no colour
KINDS = ("visual", "collision")


class Shape(NamedTuple):
    """Triangles of one colour on a link.

    link      name of the link
    vertices  (n, 3) in the link's frame [m]
    faces     (m, 3) indices of vertices
    color     red, green, blue, opacity, each from 0 to 1
    textured  the same shape as GLB, if an image covers it; else empty
    """

    link: str
    vertices: Array
    faces: NDArray[np.int64]
    color: Color
    textured: bytes = b""


class Geometry(NamedTuple):
    """The shapes of a robot, and the problems of its geometry, one line each, the name first.

    missing  meshes that cannot be drawn
    faulty   meshes that are drawn without broken elements of their files, such as materials
    """

    shapes: list[Shape]
    missing: list[str]
    faulty: list[str]


def urdf_shapes(source: Any, kind: str = "visual", package_dirs: Sequence[Folder] = ()) -> Geometry:
    """The geometry in a URDF.

    source        as in ``load_urdf``
    kind          "visual" or "collision"
    package_dirs  folders searched for the packages of ``package://`` names, before those of ``find_mesh``

    Raises  UrdfError if the source cannot be read.
    """
    yourdfpy = _yourdfpy()
    if kind not in KINDS:
        raise SpatialDynError(f"kind is {literal(kind)}, expected one of {', '.join(KINDS)}")
    robot, home = (source.robot, None) if isinstance(source, yourdfpy.URDF) else urdf_elements(source)
    palette = {material.name: material.color for material in robot.materials}
    found: list[Shape] = []
    missing: dict[str, None] = {}
    faulty: dict[str, None] = {}
    for link in robot.links:
        parts: list[Shape] = []
        for element in link.visuals if kind == "visual" else link.collisions:
            try:
                parts += _shapes_of(link.name, element, palette, home, package_dirs, faulty)
            except NotDrawnError as error:
                missing.setdefault(str(error))
        found += _joined(parts)
    return Geometry(found, list(missing), list(faulty))


def urdf_elements(source: Any) -> tuple[Any, Path | None]:
    """The elements of a URDF as yourdfpy reads them, and the file's path. Raises UrdfError if it cannot be read."""
    import yourdfpy

    path, data = read_source(source)
    home = Path(path) if path else None
    try:
        return yourdfpy.URDF.load(io.BytesIO(data), build_scene_graph=False, load_meshes=False).robot, home
    except Exception as error:  # whatever yourdfpy meets in an element that the strict pass does not read
        raise UrdfError(f"geometry of {home or 'the text'} cannot be read: {said(error)}") from error


def _yourdfpy() -> Any:
    try:
        import trimesh  # noqa: F401
        import yourdfpy
    except ImportError as error:
        raise SpatialDynError(f"{error.name} is not installed; {pip_install('view')}") from error
    return yourdfpy


def _shapes_of(
    link: str, element: Any, palette: dict[str, Any], home: Path | None, package_dirs: Sequence[Folder],
    faulty: dict[str, None],
) -> Iterator[Shape]:  # fmt: skip
    """The shapes of a <visual> or <collision>; ``faulty`` gets faults of its mesh. Raises NotDrawnError."""
    given, material = element.geometry, getattr(element, "material", None)
    color = None if material is None else material.color or palette.get(material.name)
    rgba: Color | None = None if color is None else tuple(float(x) for x in color.rgba)  # type: ignore[assignment]
    X = np.eye(4) if element.origin is None else element.origin
    if given is None:
        return
    if given.mesh is None:
        vertices, faces = _primitive(given)
        yield Shape(link, moved(vertices, X), faces, rgba or GREY)
        return
    name = given.mesh.filename or ""
    path = find_mesh(name, home, package_dirs)
    if path is None:
        raise NotDrawnError(f"{name} is not found")
    scale = np.ones(3) if given.mesh.scale is None else np.broadcast_to(given.mesh.scale, 3)
    yield from _mesh_parts(link, path, name, X @ np.diag([*scale, 1.0]), rgba, faulty)


def mesh_shapes(link: str, path: str, scale: Any) -> Geometry:
    """The shapes of a mesh file in the frame of a link; scale: a number or (3,)."""
    _yourdfpy()
    found, faulty = Path(path), dict[str, None]()
    try:
        if not found.is_file():
            raise NotDrawnError(f"{path} is not found")
        X = np.diag([*np.broadcast_to(scale, 3), 1.0])
        return Geometry(_joined([*_mesh_parts(link, found, path, X, None, faulty)]), [], list(faulty))
    except NotDrawnError as error:
        return Geometry([], [str(error)], [])


def coal_shape(link: str, given: Any, color: Color) -> Shape | None:
    """The shape of a box, cylinder, cone, capsule, sphere, ellipsoid or triangles of coal, known by its attributes.

    None for another.
    """
    if hasattr(given, "halfSide"):
        return Shape(link, *box(2.0 * np.ravel(given.halfSide)), color)
    if hasattr(given, "halfLength") and hasattr(given, "radius"):
        made = {"Capsule": capsule, "Cone": cone}.get(type(given).__name__, cylinder)
        return Shape(link, *made(given.radius, 2.0 * given.halfLength), color)
    if hasattr(given, "radii"):
        vertices, faces = sphere(1.0)
        return Shape(link, vertices * np.ravel(given.radii), faces, color)
    found: tuple[Any, Any] | None = sphere(given.radius) if hasattr(given, "radius") else coal_triangles(given)
    return None if found is None else Shape(link, *found, color)


def coal_triangles(shape: Any) -> tuple[Any, Any] | None:
    """Vertices (n, 3) and faces (m, 3) of a mesh, convex shape or height field of coal; None without any."""
    if hasattr(shape, "num_tris"):
        points, corners = shape.vertices(), [shape.tri_indices(k) for k in range(shape.num_tris)]
    elif hasattr(shape, "polygons"):
        points, corners = shape.points(), [shape.polygons(k) for k in range(shape.num_polygons)]
    elif hasattr(shape, "getHeights"):
        return _surface(shape.getXGrid(), shape.getYGrid(), shape.getHeights())
    else:
        return None
    faces = np.array([[int(corner[i]) for i in range(3)] for corner in corners])
    return (np.array(points), faces) if len(faces) else None


def _surface(x: Any, y: Any, heights: Any) -> tuple[Any, Any]:
    """Vertices and faces, upwards, of heights (len(y), len(x)) over a grid whose y falls, as coal's."""
    across, along = np.meshgrid(np.ravel(x), np.ravel(y))
    at = np.arange(heights.size).reshape(heights.shape)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]))
    points = np.stack([across.ravel(), along.ravel(), np.asarray(heights).ravel()], axis=1)
    return points, np.concatenate([np.stack([a, d, b], axis=1), np.stack([a, c, d], axis=1)])


def _mesh_parts(
    link: str, path: Path, name: str, X: Array, color: Color | None, faulty: dict[str, None]
) -> Iterator[Shape]:
    """The parts of a mesh file, moved and scaled by X; ``color`` where the file has none. Raises NotDrawnError."""
    parts, fault = read_mesh(str(path), name, path.stat().st_mtime_ns)
    faulty |= {fault: None} if fault else {}
    for vertices, faces, own, texture in parts:
        if np.linalg.det(X[:3, :3]) < 0.0:
            faces = faces[:, ::-1]
        yield Shape(link, moved(vertices, X), faces, own or color or GREY, b"" if texture is None else glb(texture, X))


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
    return creased(np.asarray(made.vertices), np.asarray(made.faces))


def capsule(radius: float, length: float) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and faces of a capsule along z about the origin: a cylinder of that length between half balls."""
    from trimesh import creation

    made = creation.capsule(height=length, radius=radius)
    vertices = np.array(made.vertices)
    vertices[:, 2] -= 0.5 * (vertices[:, 2].min() + vertices[:, 2].max())
    return vertices, np.asarray(made.faces)


def cone(radius: float, length: float) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and faces of a cone along z about the origin, its tip above, with a sharp rim."""
    from trimesh import creation

    made = creation.cone(radius, length, sections=32)
    return creased(np.asarray(made.vertices) - (0.0, 0.0, 0.5 * length), np.asarray(made.faces))


def sphere(radius: float) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and faces of a sphere about the origin."""
    from trimesh import creation

    made = creation.icosphere(3, radius)
    return np.asarray(made.vertices), np.asarray(made.faces)


def _joined(shapes: list[Shape]) -> list[Shape]:
    """Shapes of one link, merged by colour; textured shapes stay separate."""
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
