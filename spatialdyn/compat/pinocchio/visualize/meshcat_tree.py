"""MeshCat's tree of names, drawn by viser: ``viewer[path]`` with set_object, set_transform, set_property, delete.

Objects are those of the package meshcat that ``pictures.meshcat_objects`` draws, and ``Mesh(geometry, material)`` of
them. There is no server of MeshCat's, and nothing of its protocol.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ....pictures.mesh_files import NotDrawnError
from ....pictures.meshcat_objects import UnknownObjectError, draw, set_property
from ....pictures.stage import Stage, plain, quaternions
from ..coverage.coverage import OutOfScopeError
from ..types.arguments import ValueRuntimeError

ROOT = "/tree"
SETTINGS = ("Background", "Lights", "Axes", "Cameras", "Render Settings")  # of MeshCat's page: they have no effect


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

        Raises OutOfScopeError for another kind, naming it, ValueRuntimeError for a mesh that cannot be read.
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
        try:
            tree.drawn[path] = draw(tree.scene, f"{node(path)}/object", kind, geometry, material)
        except UnknownObjectError as error:
            raise OutOfScopeError(str(error)) from error
        except NotDrawnError as error:
            raise ValueRuntimeError(str(error)) from error
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
            set_property(handle, key, value)
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
