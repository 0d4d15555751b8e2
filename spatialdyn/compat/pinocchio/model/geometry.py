"""Geometry models as records of names and indices: nothing here reads a mesh or computes with a shape."""

from __future__ import annotations

from collections.abc import Iterable
from copy import deepcopy
from typing import Any

import numpy as np

from ....errors import ModelError
from ..coverage.coverage import COLLISIONS, Partial, refused
from ..types.arguments import by_name, expected
from ..types.frame import Enum
from ..types.se3 import SE3
from .from_urdf import buildModelFromUrdf
from .model import Model

__all__ = [
    "COLLISION", "VISUAL", "CollisionPair", "GeometryData", "GeometryModel", "GeometryNoMaterial", "GeometryObject",
    "GeometryPhongMaterial", "GeometryType", "buildModelsFromUrdf", "createDatas",
]  # fmt: skip
_FILES = "saveToText saveToXML saveToBinary saveToString loadFromText loadFromXML loadFromBinary loadFromString"


BLACK = (0.0, 0.0, 0.0, 1.0)


class GeometryType(Enum):
    """Purpose of a geometry."""

    VISUAL, COLLISION = range(2)


VISUAL, COLLISION = GeometryType


def _beyond(names: str) -> dict[str, str]:
    return dict.fromkeys(
        [*names.split(), *_FILES.split()], f"takes a collision library, spatialdyn has none: {COLLISIONS}, do that"
    )


class _Bookkeeping(Partial):
    """A record about shapes; members that need a collision library raise."""

    def copy(self) -> Any:
        """An independent copy."""
        return deepcopy(self)

    clone = copy


class GeometryNoMaterial:
    """No material."""


class GeometryPhongMaterial:
    """A material: meshEmissionColor, meshSpecularColor (4,), meshShininess."""

    def __init__(
        self, meshEmissionColor: Any = BLACK, meshSpecularColor: Any = BLACK, meshShininess: Any = 0.0
    ) -> None:
        self.meshEmissionColor, self.meshSpecularColor = np.array(meshEmissionColor), np.array(meshSpecularColor)
        self.meshShininess = float(meshShininess)


class GeometryObject(_Bookkeeping):
    """A shape on a joint: ``(name, parent_joint, [parent_frame,] placement, collision_geometry, ...)``, or a copy.

    name                     str
    parentJoint, parentFrame indices; parentFrame is the largest number if not given
    placement                SE3 in the joint's frame
    geometry                 a shape of a collision library: any object, passed on unchanged
    meshPath, meshScale (3,), overrideMaterial, meshColor (4,), meshTexturePath, meshMaterial, disableCollision
    """

    _instead = _beyond("physicsMaterial")

    def __init__(self, name: Any, parent_joint: Any = None, *arguments: Any, **named: Any) -> None:
        if isinstance(name, GeometryObject):
            self.__dict__.update(deepcopy(name).__dict__)
            return
        framed = "parent_frame" in named or (len(arguments) > 0 and not isinstance(arguments[0], SE3))
        first = "name parent_joint parent_frame placement" if framed else "name parent_joint placement"
        order = f"{first} collision_geometry mesh_path mesh_scale override_material mesh_color mesh_texture_path"
        given = by_name("GeometryObject", f"{order} mesh_material", (name, parent_joint, *arguments), named, 3 + framed)
        self.name, self.parentJoint = expected(name, str, "name"), int(parent_joint)
        self.parentFrame = int(given.get("parent_frame", 2**64 - 1))
        self.placement = SE3(expected(given["placement"], SE3, "placement"))
        self.geometry, self.disableCollision = given.get("collision_geometry"), False
        self.meshPath, self.meshTexturePath = given.get("mesh_path", ""), given.get("mesh_texture_path", "")
        self.meshScale = np.array(given.get("mesh_scale", np.ones(3)), float)
        self.meshColor = np.array(given.get("mesh_color", BLACK), float)
        self.meshMaterial = given.get("mesh_material", GeometryNoMaterial())
        self.overrideMaterial = bool(given.get("override_material", False))

    CreateCapsule = refused("GeometryObject.CreateCapsule")


class CollisionPair:
    """Indices first, second of two geometry objects; ``CollisionPair(1, 2)`` is ``CollisionPair(2, 1)``."""

    def __init__(self, index1: int = -1, index2: int = -1) -> None:
        self.first, self.second = int(index1), int(index2)
        if self.first == self.second and self.first >= 0:
            raise ModelError(f"a collision pair has geometry {self.first} twice, expected two of them")

    def copy(self) -> CollisionPair:
        """An independent copy."""
        return CollisionPair(self.first, self.second)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, CollisionPair) and {self.first, self.second} == {other.first, other.second}

    def __hash__(self) -> int:
        return hash(frozenset((self.first, self.second)))

    def __repr__(self) -> str:
        return f"collision pair ({self.first},{self.second})"


class GeometryModel(_Bookkeeping):
    """Shapes on a model's joints, geometryObjects, and the pairs of them that may collide, collisionPairs.

    Empty as buildModelsFromUrdf returns it; visualizers read the shapes of its file.
    """

    _instead = _beyond("collisionPairMapping setCollisionPairs")

    def __init__(self, other: GeometryModel | None = None) -> None:
        self.geometryObjects: list[GeometryObject] = []
        self.collisionPairs: list[CollisionPair] = []
        self._file: tuple[Any, tuple[Any, ...]] | None = None  # the URDF that it stands for, and package_dirs
        if other is not None:
            self.__dict__.update(deepcopy(expected(other, GeometryModel, "other")).__dict__)

    ngeoms = property(lambda self: len(self.geometryObjects), doc="Number of geometry objects.")

    def createData(self) -> GeometryData:
        """A GeometryData."""
        return GeometryData(self)

    def addGeometryObject(self, geometry_object: GeometryObject, model: Model | None = None) -> int:
        """Append an object, on the joint of its frame if a model is given; returns its index."""
        given = expected(geometry_object, GeometryObject, "geometry_object")
        if model is not None and given.parentFrame < model.nframes:
            given.parentJoint = model.frames[given.parentFrame].parentJoint
        self.geometryObjects.append(given)
        return len(self.geometryObjects) - 1

    def removeGeometryObject(self, name: str) -> None:
        """Remove an object and its pairs; later indices decrease. Raises ModelError if there is none."""
        at = self.getGeometryId(name)
        if at == self.ngeoms:
            raise ModelError(f'there is no geometry "{name}" to remove')
        del self.geometryObjects[at]
        kept = [(p.first, p.second) for p in self.collisionPairs if at not in (p.first, p.second)]
        self.collisionPairs[:] = [CollisionPair(a - (a > at), b - (b > at)) for a, b in kept]

    def getGeometryId(self, name: str) -> int:
        """Index of the object of that name; ngeoms if there is none."""
        return next((k for k, x in enumerate(self.geometryObjects) if x.name == name), len(self.geometryObjects))

    def existGeometryName(self, name: str) -> bool:
        """Whether an object has that name."""
        return self.getGeometryId(name) < len(self.geometryObjects)

    def addCollisionPair(self, pair: CollisionPair) -> None:
        """Add a pair unless it exists. Raises ModelError for an index out of range."""
        for at in (expected(pair, CollisionPair, "pair").first, pair.second):
            if not 0 <= at < self.ngeoms:
                raise ModelError(f"a collision pair has geometry {at}, expected 0 to {self.ngeoms - 1}")
        if pair not in self.collisionPairs:
            self.collisionPairs.append(pair)

    def addAllCollisionPairs(self) -> None:
        """Replace the pairs by all pairs of objects on different joints."""
        objects = list(enumerate(self.geometryObjects))
        self.collisionPairs[:] = [
            CollisionPair(i, j) for i, x in objects for j, y in objects[i + 1 :] if x.parentJoint != y.parentJoint
        ]

    def removeCollisionPair(self, pair: CollisionPair) -> None:
        """Remove a pair if it exists."""
        self.collisionPairs[:] = [x for x in self.collisionPairs if x != pair]

    def removeAllCollisionPairs(self) -> None:
        """Remove all pairs."""
        self.collisionPairs.clear()

    def existCollisionPair(self, pair: CollisionPair) -> bool:
        """Whether a pair exists."""
        return pair in self.collisionPairs

    def findCollisionPair(self, pair: CollisionPair) -> int:
        """Index of a pair; the number of pairs if it does not exist."""
        return self.collisionPairs.index(pair) if pair in self.collisionPairs else len(self.collisionPairs)


class GeometryData(_Bookkeeping):
    """Data of a GeometryModel: oMg, the identity for every object; activeCollisionPairs, flags."""

    _instead = _beyond("""collisionRequests collisionResults collision_functors contactPatchRequests contactPatchResults
        contact_patch_functors distanceRequests distanceResults distance_functors fillInnerOuterObjectMaps radius
        setActiveCollisionPairs setGeometryCollisionStatus setSecurityMargins""")

    def __init__(self, geometry_model: GeometryModel) -> None:
        expected(geometry_model, GeometryModel, "geometry_model")
        self.oMg = [SE3.Identity() for _ in geometry_model.geometryObjects]
        self.activeCollisionPairs = [True for _ in geometry_model.collisionPairs]

    def activateCollisionPair(self, pair_id: int) -> None:
        """Activate a pair."""
        self.activeCollisionPairs[pair_id] = True

    def deactivateCollisionPair(self, pair_id: int) -> None:
        """Deactivate a pair."""
        self.activeCollisionPairs[pair_id] = False

    def deactivateAllCollisionPairs(self) -> None:
        """Deactivate all pairs."""
        self.activeCollisionPairs[:] = [False] * len(self.activeCollisionPairs)


def buildModelsFromUrdf(filename: Any, *arguments: Any, **named: Any) -> tuple[Any, ...]:
    """The Model of a URDF file, and empty GeometryModels, whose shapes visualizers read when they draw.

    filename         str or Path
    package_dirs     a folder or several that hold the packages of ``package://`` names, for visualizers
    root_joint       joint model between the universe and the root link; without it the root link is fixed
    root_joint_name  its name, "root_joint" by default; optional in a call by position
    verbose          ignored
    meshLoader       ignored
    geometry_types   one GeometryModel is returned for each; by default COLLISION and VISUAL
    mimic            True: mimic joints have no coordinates

    Raises what ``buildModelFromUrdf`` does.
    """
    names = ["package_dirs", "root_joint", "verbose", "meshLoader", "geometry_types", "mimic"]
    names.insert(2 if len(arguments) >= 3 and isinstance(arguments[2], str) else 6, "root_joint_name")
    given = by_name("buildModelsFromUrdf", " ".join(names), arguments, named)
    kinds = given.get("geometry_types")
    kinds = (COLLISION, VISUAL) if kinds is None else kinds if isinstance(kinds, Iterable) else [kinds]
    passed = {name: given[name] for name in ("root_joint", "root_joint_name") if given.get(name) is not None}
    model = buildModelFromUrdf(filename, mimic=bool(given.get("mimic", False)), **passed)
    folders = given.get("package_dirs") or ()
    folders = (folders,) if isinstance(folders, str) or hasattr(folders, "__fspath__") else tuple(folders)
    made = [GeometryModel() for _ in kinds]
    for geometry in made:
        geometry._file = filename, folders
    return model, *made


def createDatas(*models: Model | GeometryModel | None) -> tuple[Any, ...]:
    """``createData()`` of each model; None for None."""
    return tuple(None if model is None else model.createData() for model in models)
