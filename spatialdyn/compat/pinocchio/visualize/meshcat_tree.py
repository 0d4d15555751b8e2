"""MeshCat's tree of names, drawn by viser: ``viewer[path]`` with set_object, set_transform, set_property, delete.

Objects are those of the package meshcat (``meshcat.geometry``), known by their attributes, so that meshcat itself is
not imported: boxes, spheres, ellipsoids, cylinders, cones, triangles, mesh files, points, lines, and ``Mesh(geometry,
material)`` of them. There is no server of MeshCat's, and nothing of its protocol.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ....pictures.mesh_files import NotDrawnError, triangles_of
from ....pictures.shapes import box, sphere
from ....pictures.stage import Stage, plain, quaternions
from ..coverage.coverage import OutOfScopeError
from ..types.arguments import ValueRuntimeError

Array = NDArray[np.float64]
Triangles = tuple[Array, NDArray[np.int64]]
ROOT = "/tree"
SETTINGS = ("Background", "Lights", "Axes", "Cameras", "Render Settings")  # of MeshCat's page: they have no effect
SIDES = 48  # of a cylinder
WHITE = 0xFFFFFF


class DrawnRobot(Protocol):
    """The robot of a viewer, whose shapes have paths too."""

    viewerRootNodeName: str

    def named_shapes(self) -> dict[str, dict[str, list[Any]]]:
        """viser's handles of its geometry, by layer and object."""
        ...

    def forget(self, path: tuple[str, ...]) -> None:
        """Drop what is at a path and below: it was removed."""
        ...


class Tree:
    """What was drawn under the names of a tree, on a Stage.

    frames    viser's frames by path
    drawn     its objects by path
    """

    def __init__(self, stage: Stage, robot: DrawnRobot) -> None:
        self.stage, self.robot = stage, robot
        self.scene: Any = stage.server.scene
        self.frames: dict[tuple[str, ...], Any] = {}
        self.drawn: dict[tuple[str, ...], Any] = {}

    def frame(self, path: tuple[str, ...]) -> Any:
        """The frame of a path, which is made with those above it if it is new."""
        for k in range(len(path) + 1):
            if path[:k] not in self.frames:
                self.frames[path[:k]] = self.scene.add_frame(node(path[:k]), show_axes=False)
        return self.frames[path]

    def of_robot(self, path: tuple[str, ...]) -> list[Any]:
        """The handles of the robot's shapes below a path: ``ROOT/visuals/NAME``, as getViewerNodeName says."""
        found = []
        for kind, shapes in self.robot.named_shapes().items():
            for name, handles in shapes.items():
                whole = parts_of(f"{self.robot.viewerRootNodeName}/{kind}/{name}")
                found += handles if whole[: len(path)] == path else []
        return found

    def remove(self, path: tuple[str, ...]) -> None:
        """Remove what is at a path and below it."""
        for handle in self.of_robot(path):
            handle.remove()
        self.robot.forget(path)
        if path in self.frames:
            self.frames[path].remove()  # and viser what is below it
        for table in (self.drawn, self.frames):
            for key in [key for key in table if key[: len(path)] == path]:
                del table[key]


class Branch:
    """A path of a Tree: ``viewer["arm"]["tip"]`` is ``viewer["arm/tip"]``."""

    def __init__(self, tree: Tree, path: tuple[str, ...] = ()) -> None:
        self._tree, self._path = tree, path

    def __getitem__(self, path: Any) -> Branch:
        return Branch(self._tree, (*self._path, *parts_of(path)))

    def __repr__(self) -> str:
        return f"<path /{'/'.join(self._path)} of a viewer>"

    def set_object(self, geometry: Any, material: Any = None) -> Branch:
        """Draw an object of meshcat's, in place of one that is here; returns the path.

        geometry  of ``meshcat.geometry``, alone or with its material as ``Mesh``, ``Points``, ``Line`` ...
        material  of a geometry alone

        Raises OutOfScopeError for another kind, naming it.
        """
        tree, path = self._tree, self._path
        if hasattr(geometry, "geometry") and hasattr(geometry, "material"):
            kind = str(getattr(geometry, "_type", "Mesh"))
            geometry, material = geometry.geometry, geometry.material
        else:
            kind = "Mesh"
        tree.frame(path)
        if path in tree.drawn:
            tree.drawn.pop(path).remove()
        tree.drawn[path] = draw(tree.scene, f"{node(path)}/object", kind, geometry, material)
        return self

    def set_transform(self, matrix: Any = None) -> Branch:
        """Move what is here and below to a pose (4, 4), relative to the path above; returns the path.

        Scales are taken by the object that is here. Raises ValueRuntimeError for another shape or entries that are not
        finite, OutOfScopeError for the robot's own shapes, which ``display`` moves.
        """
        X = np.eye(4) if matrix is None else np.asarray(matrix, float)
        if X.shape != (4, 4) or not np.isfinite(X).all():
            raise ValueRuntimeError(f"matrix is {X.tolist()}, expected finite numbers (4, 4)")
        if self._setting():
            return self
        if self._tree.of_robot(self._path):
            raise OutOfScopeError(f"{self!r} is of the robot, expected display(q) to move it")
        scale = np.linalg.norm(X[:3, :3], axis=0)
        frame = self._tree.frame(self._path)
        frame.wxyz = quaternions(X[:3, :3] / np.where(scale > 0.0, scale, 1.0))
        frame.position = X[:3, 3]
        if self._path in self._tree.drawn:
            self._tree.drawn[self._path].scale = tuple(scale.tolist())
        return self

    def set_property(self, key: str, value: Any) -> Branch:
        """Set "visible", "color" (r, g, b, a), "opacity", "position", "quaternion" (x, y, z, w) or "scale" here.

        Returns the path. Those of MeshCat's page, /Background, /Lights, /Axes, /Cameras, have no effect; /Grid's is
        the floor's. Raises OutOfScopeError for another key.
        """
        if self._setting():
            return self
        tree, known = self._tree, ("visible", "color", "opacity", "position", "quaternion", "scale")
        if key == "modulated_opacity":
            key = "opacity"
        if key not in known:
            raise OutOfScopeError(f"set_property of {key!r} is not offered, expected one of {', '.join(known)}")
        if self._path[:1] == ("Grid",):
            floor = tree.scene.get_handle_by_name("/floor")
            if floor is not None and key == "visible":
                floor.visible = bool(value)
            return self
        if key in ("position", "quaternion"):
            frame = tree.frame(self._path)
            if key == "position":
                frame.position = np.asarray(value, float)
            else:
                x, y, z, w = np.asarray(value, float)
                frame.wxyz = np.array([w, x, y, z])
            return self
        handles = [handle for path, handle in tree.drawn.items() if path[: len(self._path)] == self._path]
        for handle in [*handles, *tree.of_robot(self._path)]:
            _set(handle, key, value)
        return self

    def delete(self) -> None:
        """Remove what is here and below."""
        self._tree.remove(self._path)

    def set_animation(self, *arguments: Any, **named: Any) -> None:
        """Raises OutOfScopeError: there are no animations of MeshCat's."""
        raise OutOfScopeError("set_animation is not offered, expected spatialdyn.view(model, q, dt), whose pages play")

    def _setting(self) -> bool:
        return self._path[:1] != () and self._path[0] in SETTINGS


def parts_of(path: Any) -> tuple[str, ...]:
    """The names of a path, "/a/b" or "a/b"."""
    return tuple(part for part in str(path).split("/") if part)


def node(path: tuple[str, ...]) -> str:
    """The name in viser's scene of a path."""
    return "/".join([ROOT, *map(plain, path)])


# --- objects ---------------------------------------------------------------------------------------------


def draw(scene: Any, name: str, kind: str, geometry: Any, material: Any) -> Any:
    """Draw a geometry of meshcat's; returns viser's handle. Raises OutOfScopeError."""
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
    """Vertices and faces of a geometry of meshcat's. Raises OutOfScopeError."""
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
    raise OutOfScopeError(f"{what}, expected a box, sphere, cylinder, triangles, a mesh, points or lines")


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
    """The triangles of a mesh file that a geometry holds."""
    contents = geometry.contents
    data = contents.encode() if isinstance(contents, str) else bytes(contents)
    try:
        return triangles_of(data, str(geometry.mesh_format))
    except NotDrawnError as error:
        raise ValueRuntimeError(str(error)) from error


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


def _set(handle: Any, key: str, value: Any) -> None:
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
            _set(handle, "opacity", rgba[3])
