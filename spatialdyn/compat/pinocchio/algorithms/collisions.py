"""Geometry placed by kinematics, and what the package coal finds of its pairs: collisions and distances."""

from __future__ import annotations

import warnings
from typing import Any

from ....errors import ModelError
from ..coverage.coal_package import coal_for
from ..coverage.coverage import OutOfScopeError
from ..data.data import Data
from ..model.geometry import GeometryData, GeometryModel
from ..model.model import Model
from ..types.arguments import by_name, expected
from ..types.se3 import SE3
from . import calls

__all__ = [
    "computeCollision", "computeCollisions", "computeDistance", "computeDistances", "updateGeometryPlacements",
]  # fmt: skip
MARGIN = 1e-6  # [m] beyond a request's security margin up to which coal bounds the distance, as in Pinocchio


def updateGeometryPlacements(
    model: Model, data: Data, geometry_model: GeometryModel, geometry_data: GeometryData, q: Any = None
) -> None:
    """Place the objects: ``geometry_data.oMg``, at q, or by ``data.oMi`` as it is."""
    if q is not None:
        calls.forwardKinematics(model, data, q)
    objects = expected(geometry_model, GeometryModel, "geometry_model").geometryObjects
    if len(expected(geometry_data, GeometryData, "geometry_data").oMg) != len(objects):
        raise ModelError(
            f"geometry_data has {len(geometry_data.oMg)} objects, expected those of the model, {len(objects)}"
        )
    oMi = data.oMi
    for k, x in enumerate(objects):
        if not 0 <= x.parentJoint < model.njoints:
            where = f'geometry object "{x.name}" is on joint {x.parentJoint}'
            raise ModelError(f"{where}, expected one of the model, from 0 to {model.njoints - 1}")
        geometry_data.oMg[k] = oMi[x.parentJoint] * x.placement if x.parentJoint else SE3(x.placement)


def computeCollision(
    geometry_model: GeometryModel, geometry_data: GeometryData, pair_index: int, collision_request: Any = None
) -> bool:
    """Whether the objects of a pair collide where ``geometry_data.oMg`` has them; ``collisionResults`` says more.

    Raises OutOfScopeError without coal, ModelError for a pair that is not there or an object without a shape.
    """
    package, (first, second) = coal_for("computeCollision"), _pair(geometry_model, geometry_data, pair_index)
    request = geometry_data.collisionRequests[pair_index] if collision_request is None else collision_request
    result = geometry_data.collisionResults[pair_index]
    result.clear()
    package.collide(*first, *second, request, result)
    return bool(result.isCollision())


def computeCollisions(*arguments: Any, **named: Any) -> bool:
    """Whether any active pair collides; ``geometry_data.collisionResults`` has each.

    (geometry_model, geometry_data, stop_at_first_collision=False)                  where objects are placed
    (model, data, geometry_model, geometry_data, q, stop_at_first_collision=False)  after placing them at q

    Raises ModelError for a model without objects, OutOfScopeError without coal. Warns if there are no pairs.
    """
    geometry_model, geometry_data, stop = _placed("computeCollisions", arguments, named)
    collides = False
    for k in _active(geometry_model, geometry_data, "computeCollisions"):
        request = geometry_data.collisionRequests[k]
        request.distance_upper_bound = request.security_margin + MARGIN
        collides |= computeCollision(geometry_model, geometry_data, k)
        if collides and stop:
            return True
    return collides


def computeDistance(geometry_model: GeometryModel, geometry_data: GeometryData, pair_index: int) -> Any:
    """coal's DistanceResult of a pair where ``geometry_data.oMg`` has its objects. Errors as ``computeCollision``."""
    package, (first, second) = coal_for("computeDistance"), _pair(geometry_model, geometry_data, pair_index)
    result = geometry_data.distanceResults[pair_index]
    result.clear()
    package.distance(*first, *second, geometry_data.distanceRequests[pair_index], result)
    return result


def computeDistances(*arguments: Any, **named: Any) -> int:
    """Number of the nearest active pair; ``geometry_data.distanceResults`` has each. The number of pairs if none is.

    (geometry_model, geometry_data)                  where objects are placed
    (model, data, geometry_model, geometry_data, q)  after placing them at q, or by ``data.oMi`` without q

    Errors as ``computeCollisions``.
    """
    geometry_model, geometry_data, _ = _placed("computeDistances", arguments, named)
    nearest, least = len(geometry_model.collisionPairs), float("inf")
    for k in _active(geometry_model, geometry_data, "computeDistances"):
        distance = computeDistance(geometry_model, geometry_data, k).min_distance
        if distance < least:
            nearest, least = k, distance
    return nearest


def _placed(call: str, arguments: tuple[Any, ...], named: dict[str, Any]) -> tuple[GeometryModel, GeometryData, bool]:
    """The geometry of either form of arguments, placed."""
    whole = "model" in named or (bool(arguments) and isinstance(arguments[0], Model))
    names = ["geometry_model", "geometry_data", *["stop_at_first_collision"] * (call == "computeCollisions")]
    least = 2
    if whole:
        names[2:2] = ["q"]
        names[:0] = ["model", "data"]
        least = 4 + (call == "computeCollisions")
    given = by_name(call, " ".join(names), arguments, named, least)
    geometry_model = expected(given["geometry_model"], GeometryModel, "geometry_model")
    geometry_data = expected(given["geometry_data"], GeometryData, "geometry_data")
    coal_for(call)
    if whole:
        updateGeometryPlacements(given["model"], given["data"], geometry_model, geometry_data, given.get("q"))
    return geometry_model, geometry_data, bool(given.get("stop_at_first_collision", False))


def _active(geometry_model: GeometryModel, geometry_data: GeometryData, call: str) -> list[int]:
    """Numbers of the pairs to compute. Raises ModelError where there is no geometry, warns where there is no pair."""
    objects, pairs = geometry_model.geometryObjects, geometry_model.collisionPairs
    if not objects:
        raise ModelError(f"{call} of a geometry model without objects, expected some to compute")
    _check_pairs(geometry_model, geometry_data)
    if not pairs:
        warnings.warn(
            f"{call} of a geometry model without collisionPairs says nothing: addAllCollisionPairs", stacklevel=4
        )
    return [
        k
        for k, (pair, on) in enumerate(zip(pairs, geometry_data.activeCollisionPairs, strict=True))
        if on and not (objects[pair.first].disableCollision or objects[pair.second].disableCollision)
    ]


def _check_pairs(geometry_model: GeometryModel, geometry_data: GeometryData) -> None:
    pairs, known = len(geometry_model.collisionPairs), len(geometry_data.activeCollisionPairs)
    if pairs != known:
        raise ModelError(f"geometry_data is of {known} pairs and the model has {pairs}, expected data made after pairs")


def _pair(
    geometry_model: GeometryModel, geometry_data: GeometryData, k: int
) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    """(shape, pose) of both objects of a pair. Raises ModelError."""
    _check_pairs(geometry_model, geometry_data)
    if not 0 <= k < len(geometry_model.collisionPairs):
        raise ModelError(f"pair_index is {k}, expected 0 to {len(geometry_model.collisionPairs) - 1}")
    pair = geometry_model.collisionPairs[k]
    first, second = (_object(geometry_model, geometry_data, at) for at in (pair.first, pair.second))
    return first, second


def _object(geometry_model: GeometryModel, geometry_data: GeometryData, at: int) -> tuple[Any, Any]:
    package, x, X = coal_for("a shape"), geometry_model.geometryObjects[at], geometry_data.oMg[at]
    shape = x.geometry
    if not isinstance(shape, package.CollisionGeometry):
        what = "no shape" if shape is None else f"a {type(shape).__name__}"
        raise OutOfScopeError(f'geometry object "{x.name}" has {what}, expected one of coal')
    return shape, package.Transform3s(X.rotation, X.translation)
