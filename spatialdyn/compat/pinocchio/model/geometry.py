"""Geometry models: geometry objects, pairs of them, and what is computed of those."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np

from ....errors import ModelError, ShapeError
from ..coverage.coal_package import coal_for
from ..types.arguments import expected, row
from ..types.containers import StdVec_Bool, StdVec_SE3, list_class
from ..types.se3 import SE3
from .geometry_object import Bookkeeping, GeometryObject, beyond
from .model import Model

__all__ = [
    "CollisionPair", "GeometryData", "GeometryModel", "StdVec_CollisionPair", "StdVec_GeometryObject", "createDatas",
]  # fmt: skip


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


StdVec_GeometryObject, StdVec_CollisionPair = (
    list_class(kind.__name__, kind, kind.__name__) for kind in (GeometryObject, CollisionPair)
)


class GeometryModel(Bookkeeping):
    """Shapes on a model's joints, geometryObjects, and the pairs of them that may collide, collisionPairs.

    Both are lists of copies of what is put in; their entries can be written in place.
    """

    _instead = beyond("")

    def __init__(self, other: GeometryModel | None = None) -> None:
        self.geometryObjects: list[GeometryObject] = StdVec_GeometryObject()
        self.collisionPairs: list[CollisionPair] = StdVec_CollisionPair()
        if other is not None:
            self.__dict__.update(deepcopy(expected(other, GeometryModel, "other")).__dict__)

    def __eq__(self, other: object) -> bool:
        """Whether the objects and the pairs are equal."""
        if not isinstance(other, GeometryModel):
            return NotImplemented
        return self.geometryObjects == other.geometryObjects and self.collisionPairs == other.collisionPairs

    __hash__ = object.__hash__

    def __repr__(self) -> str:
        return f"Nb geometry objects = {self.ngeoms}\n" + "".join(map(_shown, self.geometryObjects))

    ngeoms = property(lambda self: len(self.geometryObjects), doc="Number of geometry objects.")

    @property
    def collisionPairMapping(self) -> Any:
        """Numbers (ngeoms, ngeoms) of the pairs of two objects, -1 for none."""
        made = np.full((self.ngeoms, self.ngeoms), -1, np.int32)
        for k, pair in enumerate(self.collisionPairs):
            made[pair.first, pair.second] = made[pair.second, pair.first] = k
        return made

    def setCollisionPairs(self, collision_map: Any, upper: bool = True) -> None:
        """Replace the pairs by those i < j with a true entry (i, j), or (j, i) if not ``upper``, in their order."""
        found = _map_of(self, collision_map, upper)
        self.removeAllCollisionPairs()
        for i, j in zip(*np.nonzero(np.triu(found, 1)), strict=True):
            self.addCollisionPair(CollisionPair(int(i), int(j)))

    def createData(self) -> GeometryData:
        """A GeometryData."""
        return GeometryData(self)

    def addGeometryObject(self, geometry_object: GeometryObject, model: Model | None = None) -> int:
        """Append a copy of an object, on the joint of its frame if a model is given; returns its index."""
        given = GeometryObject(expected(geometry_object, GeometryObject, "geometry_object"))
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


_COAL = {
    "collisionRequests": "CollisionRequest", "collisionResults": "CollisionResult",
    "distanceRequests": "DistanceRequest", "distanceResults": "DistanceResult",
}  # fmt: skip


def _per_pair(name: str) -> property:
    """The attribute of a GeometryData that holds coal's objects of this kind."""
    return property(lambda self: self._of_pairs(name), doc=f"coal's {_COAL[name]}s, one for each pair.")


class GeometryData(Bookkeeping):
    """Data of a GeometryModel: placements of its objects, and requests and results for its pairs at the time.

    oMg                   SE3 of each object in the world, by ``updateGeometryPlacements``
    activeCollisionPairs  a flag for each pair
    collisionRequests, collisionResults, distanceRequests, distanceResults  coal's, one for each pair
    """

    _instead = beyond("""collision_functors contactPatchRequests contactPatchResults contact_patch_functors
        distance_functors fillInnerOuterObjectMaps radius""")
    oMg: list[SE3]
    activeCollisionPairs: list[bool]
    _kept: dict[str, list[Any]]

    def __init__(self, geometry_model: GeometryModel) -> None:
        expected(geometry_model, GeometryModel, "geometry_model")
        self.oMg = StdVec_SE3([SE3.Identity() for _ in geometry_model.geometryObjects])
        self.activeCollisionPairs = StdVec_Bool([True for _ in geometry_model.collisionPairs])
        self._kept = {}

    def activateCollisionPair(self, pair_id: int) -> None:
        """Activate a pair."""
        self.activeCollisionPairs[pair_id] = True

    def deactivateCollisionPair(self, pair_id: int) -> None:
        """Deactivate a pair."""
        self.activeCollisionPairs[pair_id] = False

    def deactivateAllCollisionPairs(self) -> None:
        """Deactivate all pairs."""
        self.activeCollisionPairs[:] = [False] * len(self.activeCollisionPairs)

    def setActiveCollisionPairs(self, geometry_model: GeometryModel, collision_map: Any, upper: bool = True) -> None:
        """Activate the pairs with a true entry of a matrix (ngeoms, ngeoms), above its diagonal or below it."""
        found = _map_of(geometry_model, collision_map, upper)
        self.activeCollisionPairs[:] = [bool(found[_low_high(pair)]) for pair in geometry_model.collisionPairs]

    def setGeometryCollisionStatus(self, geom_model: GeometryModel, geom_id: int, enable_collision: bool) -> None:
        """Activate or deactivate the pairs of an object."""
        for k, pair in enumerate(geom_model.collisionPairs):
            if geom_id in (pair.first, pair.second):
                self.activeCollisionPairs[k] = bool(enable_collision)

    def setSecurityMargins(
        self, geometry_model: GeometryModel, security_margin_map: Any, upper: bool = True,
        sync_distance_upper_bound: bool = True,
    ) -> None:  # fmt: skip
        """Set the margins of all pairs from a matrix (ngeoms, ngeoms), above its diagonal or below it [m]."""
        found = _map_of(geometry_model, security_margin_map, upper)
        for request, pair in zip(self.collisionRequests, geometry_model.collisionPairs, strict=True):
            request.security_margin = float(found[_low_high(pair)])
            if sync_distance_upper_bound:
                request.distance_upper_bound = request.security_margin

    def _of_pairs(self, name: str) -> list[Any]:
        """coal's objects of a kind, one for each pair, made when first asked for. Raises OutOfScopeError."""
        if name not in self._kept:
            package = coal_for(f"GeometryData.{name}")
            made = PerPair()
            for _ in self.activeCollisionPairs:
                one = getattr(package, _COAL[name])()
                if name.endswith("Requests"):  # as Pinocchio makes them
                    one.gjk_initial_guess = package.GJKInitialGuess.CachedGuess
                if name == "collisionRequests":
                    one.enable_contact = False
                made.append(one)
            self._kept[name] = made
        return self._kept[name]

    def __repr__(self) -> str:
        """As Pinocchio prints it."""
        lines = [f"Number of collision pairs = {len(self.activeCollisionPairs)}"]
        lines += [f"Pairs {k} {'active' if on else 'inactive'}" for k, on in enumerate(self.activeCollisionPairs)]
        return "\n".join([*lines, f"Number of geometry objects = {len(self.oMg)}", ""])

    def __deepcopy__(self, memo: dict[int, Any]) -> GeometryData:
        """Requests and results of coal are made anew."""
        made = GeometryData.__new__(GeometryData)
        made.oMg, made.activeCollisionPairs = deepcopy(self.oMg, memo), self.activeCollisionPairs.copy()
        made._kept = {}
        return made

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_kept": {}}

    collisionRequests, collisionResults, distanceRequests, distanceResults = map(_per_pair, _COAL)


def _shown(x: GeometryObject) -> str:
    """An object as Pinocchio prints it."""
    parts = {
        "Name": x.name, "Parent frame ID": x.parentFrame, "Parent joint ID": x.parentJoint,
        "Position in parent frame": x.placement, "Absolute path to mesh file": x.meshPath,
        "Scale for transformation of the mesh": row(x.meshScale), "Disable collision": int(x.disableCollision),
    }  # fmt: skip
    return "".join(f"{name}: \t \n{value}\n" for name, value in parts.items()) + "\n\n"


class PerPair(list[Any]):
    """coal's objects, one for each pair; scripts set attributes of the list too, which Pinocchio accepts."""


def _low_high(pair: CollisionPair) -> tuple[int, int]:
    return min(pair.first, pair.second), max(pair.first, pair.second)


def _map_of(geometry_model: GeometryModel, given: Any, upper: bool) -> Any:
    """A matrix of pairs of objects, whose entries above the diagonal count. Raises ShapeError."""
    made, n = np.asarray(given), expected(geometry_model, GeometryModel, "geometry_model").ngeoms
    if made.shape != (n, n):
        raise ShapeError(f"the map of pairs has shape {made.shape}, expected {(n, n)}")
    return made if upper else made.T


def createDatas(*models: Model | GeometryModel | None) -> tuple[Any, ...]:
    """``createData()`` of each model; None for None."""
    return tuple(None if model is None else model.createData() for model in models)
