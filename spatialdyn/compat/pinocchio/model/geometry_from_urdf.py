"""Geometry of a URDF as GeometryObjects: ``buildGeomFromUrdf``, ``buildModelsFromUrdf``.

Objects are in Pinocchio's order, that of the model's bodies; each is named by its link and its number there. A
mesh is read when its shape is first needed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from ....errors import ModelError, UrdfError
from ....pictures.mesh_files import mesh_path
from ....pictures.shapes import urdf_elements
from ....urdf.sources import read_source
from ....urdf.strict_xml import StrictReader
from ..types.arguments import by_name, expected, path, urdf_text
from ..types.frame import BODY
from ..types.se3 import SE3
from .coal_shapes import Described
from .from_urdf import buildModelFromUrdf
from .geometry import GeometryModel
from .geometry_object import COLLISION, GREY, VISUAL, GeometryObject, GeometryType
from .model import Model

__all__ = ["buildGeomFromUrdf", "buildGeomFromUrdfString", "buildModelsFromUrdf"]


def buildGeomFromUrdf(model: Model, urdf_filename: Any, geom_type: Any, *arguments: Any, **named: Any) -> GeometryModel:
    """The shapes of a URDF file on the joints of a model.

    model           of that file, perhaps with joints locked
    geom_type       COLLISION or VISUAL
    geometry_model  a GeometryModel that they are added to and that is returned; a new one if left out
    package_dirs    a folder or several that hold the packages of ``package://`` names; accepted in its place too
    mesh_loader     ignored

    A mesh that is not found is an error when its shape is needed, not before.
    Raises UrdfError for a file that cannot be read, ModelError for a link that the model does not have.
    """
    return _built("buildGeomFromUrdf", model, path(urdf_filename, "urdf_filename"), geom_type, arguments, named)


def buildGeomFromUrdfString(
    model: Model, urdf_string: str, geom_type: Any, *arguments: Any, **named: Any
) -> GeometryModel:
    """The shapes of a URDF text on the joints of a model; other arguments and errors as of ``buildGeomFromUrdf``."""
    return _built("buildGeomFromUrdfString", model, urdf_text(urdf_string, "urdf_string"), geom_type, arguments, named)


def buildModelsFromUrdf(filename: Any, *arguments: Any, **named: Any) -> tuple[Any, ...]:
    """The Model of a URDF file and its geometry: (model, collision_model, visual_model).

    filename         str or Path
    package_dirs     a folder or several that hold the packages of ``package://`` names
    root_joint       joint model between the universe and the root link; without it the root link is fixed
    root_joint_name  its name, "root_joint" by default; optional in a call by position
    verbose          ignored
    meshLoader       ignored
    geometry_types   one GeometryModel is returned for each; by default COLLISION and VISUAL
    mimic            True: mimic joints have no coordinates

    Raises what ``buildModelFromUrdf`` and ``buildGeomFromUrdf`` do.
    """
    names = ["package_dirs", "root_joint", "verbose", "meshLoader", "geometry_types", "mimic"]
    names.insert(2 if len(arguments) >= 3 and isinstance(arguments[2], str) else 6, "root_joint_name")
    given = by_name("buildModelsFromUrdf", " ".join(names), arguments, named)
    kinds = given.get("geometry_types")
    kinds = (COLLISION, VISUAL) if kinds is None else kinds if isinstance(kinds, Iterable) else [kinds]
    passed = {name: given[name] for name in ("root_joint", "root_joint_name") if given.get(name) is not None}
    model = buildModelFromUrdf(filename, mimic=bool(given.get("mimic", False)), **passed)
    return model, *(buildGeomFromUrdf(model, filename, kind, None, given.get("package_dirs")) for kind in kinds)


def _built(
    call: str, model: Model, source: Any, kind: Any, arguments: tuple[Any, ...], named: dict[str, Any]
) -> GeometryModel:
    given = by_name(call, "geometry_model package_dirs mesh_loader", arguments, named)
    made, folders = given.get("geometry_model"), given.get("package_dirs")
    if made is not None and not isinstance(made, GeometryModel):
        made, folders = None, made if folders is None else folders
    folders = () if folders is None else folders
    if isinstance(folders, str) or hasattr(folders, "__fspath__"):
        folders = (folders,)
    wanted = GeometryType(expected(kind, GeometryType, "geom_type"))
    made = GeometryModel() if made is None else made
    for added in _objects(expected(model, Model, "model"), source, wanted, list(map(str, folders))):
        made.addGeometryObject(added)
    return made


def _objects(model: Model, source: Any, kind: Any, folders: Sequence[str]) -> Iterator[GeometryObject]:
    """The objects of a kind, in the order of the model's bodies."""
    StrictReader("geometry", None, skip_leftovers=True).read(read_source(source)[1])
    elements, home = urdf_elements(source)
    palette = {x.name: x for x in elements.materials}
    for link in elements.links:  # the first material of a name that has a colour is that of all
        for element in link.visuals:
            material = element.material
            if material is not None and (material.color is not None or material.texture is not None):
                palette.setdefault(material.name, material)
    bodies = {frame.name: k for k, frame in enumerate(model.frames) if frame.type == BODY}
    for link in sorted(elements.links, key=lambda link: bodies.get(link.name, 0)):
        found = link.visuals if kind == VISUAL else link.collisions
        if found and link.name not in bodies:
            raise ModelError(f'model "{model.name}" has no link "{link.name}", expected one built of this URDF')
        for k, element in enumerate(found):
            at = bodies[link.name]
            frame = model.frames[at]
            origin = np.eye(4) if element.origin is None else np.asarray(element.origin, float)
            shape = _shape(element.geometry, home, folders)
            color, texture, given = _material(element if kind == VISUAL else None, palette, home, folders)
            made = GeometryObject(
                f"{link.name}_{k}", frame.parentJoint, at, frame.placement * SE3(origin), None,
                shape.path or shape.kind.upper(), np.array(shape.sizes) if shape.path else np.ones(3), given, color,
                texture,
            )  # fmt: skip
            made._described = shape
            yield made


def _shape(given: Any, home: Any, folders: Sequence[str]) -> Described:
    """What a <geometry> says. Raises UrdfError for an empty one."""
    if given is not None and given.box is not None:
        return Described("box", tuple(np.asarray(given.box.size, float).tolist()))
    if given is not None and given.cylinder is not None:
        return Described("cylinder", (float(given.cylinder.radius), float(given.cylinder.length)))
    if given is not None and given.sphere is not None:
        return Described("sphere", (float(given.sphere.radius),))
    if given is None or given.mesh is None:
        raise UrdfError("a <geometry> is empty, expected a box, cylinder, sphere or mesh")
    scale = np.ones(3) if given.mesh.scale is None else np.broadcast_to(given.mesh.scale, 3)
    name = given.mesh.filename or ""
    found = mesh_path(name, home, folders)
    return Described("mesh", tuple(np.asarray(scale, float).tolist()), found or name, bool(found))


def _material(element: Any, palette: dict[str, Any], home: Any, folders: Sequence[str]) -> tuple[Any, str, bool]:
    """Colour, texture file and whether a <visual> has a material; grey for a <collision>, None."""
    own = None if element is None else element.material
    if own is None:
        return np.array(GREY), "", False
    material = palette.get(own.name, own) if own.name else own
    color = np.zeros(4) if material.color is None else np.asarray(material.color.rgba, np.float32).astype(float)
    texture = getattr(material.texture, "filename", None) or ""
    return color, mesh_path(texture, home, folders) if texture else "", True
