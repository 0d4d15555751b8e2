"""Geometry objects: shapes on joints by name and placement, with their materials."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np

from ....errors import literal
from ..coverage.coal_package import coal_for
from ..coverage.coverage import COLLISIONS, Partial
from ..types.arguments import ArgumentError, RangeError, array, by_name, described, expected, number
from ..types.frame import Enum
from ..types.se3 import SE3

__all__ = ["COLLISION", "VISUAL", "GeometryNoMaterial", "GeometryObject", "GeometryPhongMaterial", "GeometryType"]
_FILES = "saveToText saveToXML saveToBinary saveToString loadFromText loadFromXML loadFromBinary loadFromString"
BLACK, GREY = np.array([0.0, 0.0, 0.0, 1.0]), np.array([0.9, 0.9, 0.9, 1.0])


class GeometryType(Enum):
    """Purpose of a geometry."""

    VISUAL, COLLISION = range(2)


VISUAL, COLLISION = GeometryType


def beyond(names: str) -> dict[str, str]:
    """Why members are not offered: these, and those that write and read files."""
    return dict.fromkeys([*names.split(), *_FILES.split()], f"is not offered: {COLLISIONS}")


def _checked(name: str, check: Callable[[Any, str], Any], doc: str) -> Any:
    """An attribute that keeps ``check(value, name)`` of what is assigned."""

    def write(self: Any, value: Any) -> None:
        vars(self)[name] = check(value, name)

    return property(lambda self: vars(self)[name], write, doc=doc)


def _few(size: int) -> Callable[[Any, str], Any]:
    """A check for so many numbers: an array of them, or a column, is copied."""

    def check(value: Any, what: str) -> Any:
        try:
            return array(value, (size,), what)
        except ArgumentError as error:
            raise ArgumentError(
                f"{what} is {literal(value)}, {described(value)}, expected an array of shape ({size},)"
            ) from error

    return check


def _of(*kinds: type) -> Callable[[Any, str], Any]:
    """A check for one of some types."""

    def check(value: Any, what: str) -> Any:
        if not isinstance(value, kinds):
            names = " or ".join(kind.__name__ for kind in kinds)
            raise ArgumentError(f"{what} is {literal(value)}, {described(value)}, expected {names}")
        return value

    return check


def _flag(value: Any, what: str) -> bool:
    """A check for True and False, which may be 1 and 0."""
    if not isinstance(value, (int, np.bool_)):
        raise ArgumentError(f"{what} is {literal(value)}, expected True or False")
    return bool(value)


def _index(value: Any, what: str) -> int:
    """A check for indices. Raises ArgumentError, RangeError for a negative one."""
    if not isinstance(value, (int, np.integer)):
        raise ArgumentError(f"{what} is {literal(value)}, expected an index")
    if value < 0:
        raise RangeError(f"{what} is {value}, expected an index from 0")
    return int(value)


class Bookkeeping(Partial):
    """A record about shapes; members that are not offered raise. Copies share the shapes, which never change."""

    def copy(self) -> Any:
        """An independent copy."""
        return deepcopy(self)

    clone = copy


class GeometryNoMaterial:
    """No material."""


class GeometryPhongMaterial:
    """A material."""

    meshEmissionColor: Any = _checked("meshEmissionColor", _few(4), "Red, green, blue, opacity (4,), from 0 to 1.")
    meshSpecularColor: Any = _checked("meshSpecularColor", _few(4), "Red, green, blue, opacity (4,), from 0 to 1.")
    meshShininess: Any = _checked("meshShininess", number, "A number.")

    def __init__(
        self, meshEmissionColor: Any = BLACK, meshSpecularColor: Any = BLACK, meshShininess: Any = 0.0
    ) -> None:
        self.meshEmissionColor, self.meshSpecularColor = meshEmissionColor, meshSpecularColor
        self.meshShininess = meshShininess


class GeometryObject(Bookkeeping):
    """A shape on a joint: ``(name, parent_joint, [parent_frame,] placement, collision_geometry, ...)``, or a copy.

    Assigning an attribute a value of another type or size raises ArgumentError, a negative index RangeError.

    geometry  the shape: coal's, or what was given. Of a URDF it is made, and a mesh read, when it is first read, which
              raises MissingMeshError, or OutOfScopeError for a mesh without coal
    """

    name: Any = _checked("name", _of(str), "Its name.")
    parentJoint: Any = _checked("parentJoint", _index, "Index of the joint that carries it.")
    parentFrame: Any = _checked("parentFrame", _index, "Index of its frame; the largest number if it has none.")
    placement: Any = _checked("placement", lambda x, what: expected(x, SE3, what).copy(), "SE3 in the joint's frame.")
    meshPath: Any = _checked("meshPath", _of(str), "Path of its mesh file, or the word of its shape.")
    meshTexturePath: Any = _checked("meshTexturePath", _of(str), "Path of its texture.")
    meshScale: Any = _checked("meshScale", _few(3), "Scale (3,) of its mesh.")
    meshColor: Any = _checked("meshColor", _few(4), "Red, green, blue, opacity (4,), from 0 to 1.")
    meshMaterial: Any = _checked("meshMaterial", _of(GeometryNoMaterial, GeometryPhongMaterial), "Its material.")
    overrideMaterial: Any = _checked("overrideMaterial", _flag, "Whether meshColor holds in place of the file's.")
    disableCollision: Any = _checked("disableCollision", _flag, "Whether it is left out of collisions.")
    _instead = beyond("physicsMaterial")
    _described: Any = None  # what builds it: Described, or another with its ``build``
    _geometry: Any = None

    def __init__(self, name: Any, parent_joint: Any = None, *arguments: Any, **named: Any) -> None:
        if isinstance(name, GeometryObject):
            self.__dict__.update(deepcopy(name).__dict__)
            return
        framed = "parent_frame" in named or (len(arguments) > 0 and not isinstance(arguments[0], SE3))
        first = "name parent_joint parent_frame placement" if framed else "name parent_joint placement"
        order = f"{first} collision_geometry mesh_path mesh_scale override_material mesh_color mesh_texture_path"
        given = by_name("GeometryObject", f"{order} mesh_material", (name, parent_joint, *arguments), named, 3 + framed)
        self.name, self.parentJoint, self.placement = name, parent_joint, given["placement"]
        self.parentFrame = given.get("parent_frame", 2**64 - 1)
        self._geometry, self.disableCollision = given.get("collision_geometry"), False
        self.meshPath, self.meshTexturePath = given.get("mesh_path", ""), given.get("mesh_texture_path", "")
        self.meshScale, self.meshColor = given.get("mesh_scale", np.ones(3)), given.get("mesh_color", BLACK)
        self.meshMaterial = given.get("mesh_material", GeometryNoMaterial())
        self.overrideMaterial = given.get("override_material", False)

    @property
    def geometry(self) -> Any:
        """The shape."""
        if self._geometry is None and self._described is not None:
            self._geometry = self._described.build(f'geometry object "{self.name}"')
        return self._geometry

    @geometry.setter
    def geometry(self, value: Any) -> None:
        self._geometry, self._described = value, None

    def __eq__(self, other: object) -> bool:
        """Whether all is equal, the shapes too."""
        if not isinstance(other, GeometryObject):
            return NotImplemented
        names = ("name", "parentJoint", "parentFrame", "placement", "meshPath", "meshTexturePath", "overrideMaterial")
        if any(getattr(self, name) != getattr(other, name) for name in (*names, "disableCollision")):
            return False
        if (self.meshColor != other.meshColor).any() or (self.meshScale != other.meshScale).any():
            return False
        if self._described is not None and self._described is other._described:
            return True
        return self.geometry is other.geometry or bool(self.geometry == other.geometry)

    __hash__ = object.__hash__

    def __deepcopy__(self, memo: dict[int, Any]) -> GeometryObject:
        made = GeometryObject.__new__(GeometryObject)
        shared = {"_geometry", "_described"}
        made.__dict__.update(deepcopy({name: x for name, x in self.__dict__.items() if name not in shared}, memo))
        made.__dict__.update({name: x for name, x in self.__dict__.items() if name in shared})
        return made

    def __getstate__(self) -> dict[str, Any]:
        """Without the shape where it can be made again."""
        return {name: x for name, x in self.__dict__.items() if name != "_geometry" or self._described is None}

    @staticmethod
    def CreateCapsule(radius: float, length: float) -> GeometryObject:
        """A capsule on the universe. Raises OutOfScopeError without coal."""
        shape = coal_for("GeometryObject.CreateCapsule").Capsule(radius, length)
        return GeometryObject("", 0, 0, SE3.Identity(), shape)
