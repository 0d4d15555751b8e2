"""``pinocchio.visualize.meshcat_visualizer``: the visualizer, and geometry objects as those of the package meshcat."""

from __future__ import annotations

import warnings
from importlib import import_module
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from ....errors import pip_install
from ....pictures.shapes import capsule, coal_shape, coal_triangles
from ..algorithms import calls, kinematics
from ..coverage.coverage import OutOfScopeError
from ..model.geometry_object import VISUAL, GeometryObject
from ..types.arguments import ValueRuntimeError
from ..types.frame import LOCAL_WORLD_ALIGNED
from .meshcat_tree import parts_of
from .viser_visualizer import ViserVisualizer, without
from .window import MeshcatWindow

__all__ = ["MeshcatVisualizer", "hasMeshFileInfo", "isMesh", "loadMesh", "loadPrimitive"]
MESHES = (".dae", ".obj", ".stl")
UPRIGHT = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])  # y to z
WHITE = (1.0, 1.0, 1.0, 1.0)
_PRESETS = {  # target and position of the camera
    "preset0": [0.0, 0.0, 0.0, 3.0, 0.0, 1.0], "preset1": [0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
    "preset2": [0.0, 0.0, 0.6, 0.8, 1.0, 1.2], "acrobot": [0.0, 0.1, 0.0, 0.5, 0.0, 0.2],
    "cam_ur": [0.4, 0.6, -0.2, 1.0, 0.4, 1.2], "cam_ur2": [0.4, 0.3, 0.0, 0.5, 0.1, 1.4],
    "cam_ur3": [0.4, 0.3, 0.0, 0.6, 1.3, 0.3], "cam_ur4": [-1.0, 0.3, 0.0, 1.3, 0.1, 1.2],
    "cam_ur5": [-1.0, 0.3, 0.0, -0.05, 1.5, 1.2], "talos": [0.0, 1.2, 0.0, 1.5, 0.3, 1.5],
    "talos2": [0.0, 1.1, 0.0, 1.2, 0.6, 1.5],
}  # fmt: skip


def hasMeshFileInfo(geometry_object: Any) -> bool:
    """Whether a geometry object names a mesh file of a format that MeshCat reads: DAE, OBJ, STL."""
    return str(geometry_object.meshPath).lower().endswith(MESHES)


isMesh = hasMeshFileInfo


def loadPrimitive(geometry_object: Any) -> Any:
    """An object of ``meshcat.geometry`` for a box, sphere, cylinder, cone or capsule of a geometry object.

    A capsule and a shape of triangles become triangles. Raises OutOfScopeError without the package meshcat, or naming
    the kind of another shape.
    """
    mg, given = _meshcat("loadPrimitive"), geometry_object.geometry
    if hasattr(given, "halfSide"):
        return mg.Box((2.0 * np.ravel(given.halfSide)).tolist())
    if hasattr(given, "halfLength"):
        kind, height, radius = type(given).__name__, 2.0 * given.halfLength, given.radius
        if kind == "Capsule":
            return mg.TriangularMeshGeometry(*capsule(radius, height))
        upright = type("RotatedCylinder", (mg.Cylinder,), {"intrinsic_transform": lambda self: UPRIGHT})
        return upright(height, 0.0, 0.0, radius) if kind == "Cone" else upright(height, radius)
    if hasattr(given, "radius"):
        return mg.Sphere(float(given.radius))
    return loadMesh(given)


def loadMesh(mesh: Any) -> Any:
    """A ``meshcat.geometry.TriangularMeshGeometry`` of triangles of coal. Raises OutOfScopeError for another shape."""
    mg = _meshcat("loadMesh")
    found = coal_triangles(mesh)
    if found is None:
        what = f"a {type(mesh).__name__} is not converted"
        raise OutOfScopeError(f"{what}, expected a box, sphere, cylinder, cone, capsule or triangles")
    return mg.TriangularMeshGeometry(*found)


class MeshcatVisualizer(ViserVisualizer):
    """A visualizer that draws in viser, its window under MeshCat's names; without viser it shows nothing."""

    FORCE_SCALE, FRAME_VEL_COLOR = 0.06, 0x00FF00
    CAMERA_PRESETS: ClassVar[dict[str, list[list[float]]]] = {name: [x[:3], x[3:]] for name, x in _PRESETS.items()}
    viewerRootNodeName = "pinocchio"
    viewerVisualGroupName = property(lambda self: f"{self.viewerRootNodeName}/visuals", doc="Path of the visuals.")
    viewerCollisionGroupName = property(
        lambda self: f"{self.viewerRootNodeName}/collisions", doc="Path of the collision geometry."
    )

    def _window(self, server: Any) -> Any:
        return MeshcatWindow(server, self._scene(), self)

    def getViewerNodeName(self, geometry_object: Any, geometry_type: Any) -> str:
        """The path of a geometry object in ``viewer``."""
        layer = "visuals" if geometry_type == VISUAL else "collisions"
        return f"{self.viewerRootNodeName}/{layer}/{geometry_object.name}"

    def setCameraPreset(self, preset_key: str) -> None:
        """Point the camera as one of ``CAMERA_PRESETS``: [target (3,), position (3,)]."""
        if preset_key not in self.CAMERA_PRESETS:
            raise ValueRuntimeError(f"preset_key is {preset_key!r}, expected one of {', '.join(self.CAMERA_PRESETS)}")
        target, position = self.CAMERA_PRESETS[preset_key]
        self.setCameraTarget(target)
        self.setCameraPosition(position)

    def loadPrimitive(self, geometry_object: GeometryObject) -> Any:
        """The shape of an object of coal, as triangles of meshcat's that ``viewer[path].set_object`` draws.

        Returns None, with a warning, for a shape that has none. Raises OutOfScopeError without the package meshcat.
        """
        shape = coal_shape(geometry_object.name, geometry_object.geometry, WHITE)
        if shape is None:
            kind = type(geometry_object.geometry).__name__
            warnings.warn(f"{geometry_object.name} is a {kind}, expected a shape with triangles", stacklevel=2)
            return None
        return _meshcat("loadPrimitive").TriangularMeshGeometry(shape.vertices, shape.faces)

    def loadMeshFromFile(self, geometry_object: GeometryObject) -> Any:
        """The mesh file of an object, as a geometry of meshcat's that ``viewer[path].set_object`` draws.

        Returns None, with a warning, without a path or for a file that is no .dae, .obj or .stl. Raises
        OutOfScopeError without the package meshcat.
        """
        path = str(geometry_object.meshPath)
        if not hasMeshFileInfo(geometry_object):
            warnings.warn(f"{geometry_object.name} has the mesh {path!r}, expected .dae, .obj or .stl", stacklevel=2)
            return None
        kind = path.rpartition(".")[2].title()
        return getattr(_meshcat("loadMeshFromFile"), f"{kind}MeshGeometry").from_file(path)

    def drawFrameVelocities(self, frame_id: int, v_scale: float = 0.2, color: int = FRAME_VEL_COLOR) -> None:
        """Draw the linear velocity of a frame, of the last forwardKinematics with v, times v_scale, as a line."""
        if self.viewer is None:
            return
        kinematics.updateFramePlacement(self.model, self.data, frame_id)
        v = calls.getFrameVelocity(self.model, self.data, frame_id, LOCAL_WORLD_ALIGNED).linear
        start = self.data.oMf[frame_id].translation
        line = SimpleNamespace(position=np.stack([start, start + v_scale * v], axis=1))
        drawn = SimpleNamespace(geometry=line, material=SimpleNamespace(color=color), _type="LineSegments")
        self.viewer[f"{self.viewerVisualGroupName}/lines/ee_vel/{frame_id}"].set_object(drawn)

    def named_shapes(self) -> dict[str, dict[str, list[Any]]]:
        """viser's handles of the geometry that is drawn, by layer and object."""
        return self._named

    def forget(self, path: tuple[str, ...]) -> None:
        """Drop what is at a path of ``viewer`` and below from what is drawn: it was removed."""
        for layer, shapes in self._named.items():
            for name in list(shapes):
                if parts_of(f"{self.viewerRootNodeName}/{layer}/{name}")[: len(path)] == path:
                    gone = shapes.pop(name)
                    self._shown[layer] = without(self._shown.get(layer, []), gone)


def _meshcat(what: str) -> Any:
    """``meshcat.geometry``. Raises OutOfScopeError naming it, and what needs it."""
    try:
        return import_module("meshcat.geometry")
    except ImportError as error:
        what = f"{what} takes the package meshcat, which is not installed"
        raise OutOfScopeError(f"{what}; {pip_install('meshcat')}") from error
