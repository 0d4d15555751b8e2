"""``pinocchio.visualize.meshcat_visualizer``: the visualizer, and geometry objects as those of the package meshcat."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from ....errors import pip_install
from ....pictures.shapes import capsule, coal_triangles
from ..coverage.coverage import OutOfScopeError
from .visualizers import MeshcatVisualizer

__all__ = ["MeshcatVisualizer", "hasMeshFileInfo", "isMesh", "loadMesh", "loadPrimitive"]
MESHES = (".dae", ".obj", ".stl")
UPRIGHT = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])  # y to z


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


def _meshcat(call: str) -> Any:
    try:
        return import_module("meshcat.geometry")
    except ImportError as error:
        raise OutOfScopeError(f"{call} takes the package meshcat; {pip_install('meshcat')}") from error
