"""Shapes of geometry objects: what a URDF says of each, and the object of the package coal that computes with it.

coal is imported, and a mesh file read, when a shape is first needed. Without coal boxes, cylinders, capsules and
spheres are records of the same names; meshes and collisions raise an error that names the package.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ....errors import ModelError
from ..coverage.coal_package import coal_for, has_coal


class MissingMeshError(ModelError):
    """A mesh of a geometry object that is not found or cannot be read."""


@dataclass(frozen=True)
class Box:
    """A box, as coal names its numbers: halfSide (3,) [m]."""

    halfSide: Any


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along z, as coal names its numbers [m]."""

    radius: float
    halfLength: float


@dataclass(frozen=True)
class Capsule:
    """A cylinder along z between two half balls, as coal names its numbers [m]."""

    radius: float
    halfLength: float


@dataclass(frozen=True)
class Sphere:
    """A sphere, as coal names its numbers [m]."""

    radius: float


@dataclass(frozen=True)
class Described:
    """What a URDF says of a shape.

    kind   "box", "cylinder", "capsule", "sphere", "ellipsoid", "plane" or "mesh"
    sizes  (3,) sides; radius and length; radius; radii; none; scales (3,) of a mesh
    path   of a mesh's file, or its name in the URDF where no file is found
    found  whether there is a file
    """

    kind: str
    sizes: tuple[float, ...]
    path: str = ""
    found: bool = True

    def build(self, name: str) -> Any:
        """The shape, coal's where that is installed. Raises OutOfScopeError, MissingMeshError for a mesh."""
        if self.kind == "mesh":
            return self._mesh(name)
        if not has_coal():
            return self._record(name)
        package = coal_for("a shape")
        if self.kind == "plane":
            return package.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
        return getattr(package, self.kind.capitalize())(*self.sizes)

    def _record(self, name: str) -> Any:
        if self.kind == "box":
            return Box(0.5 * np.array(self.sizes))
        if self.kind == "sphere":
            return Sphere(*self.sizes)
        if self.kind in ("cylinder", "capsule"):
            return (Cylinder if self.kind == "cylinder" else Capsule)(self.sizes[0], 0.5 * self.sizes[1])
        return coal_for(f"the {self.kind} of {name}")  # which is not installed: raises

    def _mesh(self, name: str) -> Any:
        package = coal_for(f"the mesh of {name}")
        if not self.found:
            raise MissingMeshError(f"the mesh {self.path} of {name} is not found, expected package_dirs that hold it")
        try:
            return package.MeshLoader().load(self.path, np.array(self.sizes))
        except Exception as error:  # of coal's readers, of any kind
            raise MissingMeshError(f"the mesh {self.path} of {name} cannot be read: {error}") from error
