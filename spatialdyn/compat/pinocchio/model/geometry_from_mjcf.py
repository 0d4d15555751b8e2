"""Geometry of an MJCF file as GeometryObjects, through MuJoCo's compiled model.

Objects have the names, the order and the shapes of Pinocchio's reader; placements are MuJoCo's.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ....errors import SpatialDynError
from ....sources.mjmodel import Tree, tree_of
from ....sources.mjmodel_values import floats_of, name_of, pose_of
from ..coverage.coal_package import coal_for
from ..types.arguments import Array, by_name, expected
from ..types.se3 import SE3
from .coal_shapes import Described
from .from_mjcf import ROOT_NAME, body_frame, compiled, constraints_of, model_of
from .geometry import GeometryModel
from .geometry_object import COLLISION, VISUAL, GeometryObject, GeometryType
from .model import Model

__all__ = ["buildGeomFromMJCF", "buildModelsFromMJCF"]

PLANE, HFIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = range(8)  # mjtGeom
KINDS = {PLANE: "plane", SPHERE: "sphere", CAPSULE: "capsule", ELLIPSOID: "ellipsoid", CYLINDER: "cylinder", BOX: "box"}
COLLISION_ONLY = 3  # first group of geoms that are no visuals


@dataclass(frozen=True)
class Triangles:
    """A mesh that MuJoCo compiled: vertices (n, 3) and faces (m, 3)."""

    vertices: Array
    faces: Any

    def build(self, name: str) -> Any:
        """coal's shape. Raises OutOfScopeError without coal."""
        package = coal_for(f"the mesh of {name}")
        made = package.BVHModelOBBRSS()
        made.beginModel(len(self.faces), len(self.vertices))
        made.addVertices(self.vertices)
        made.addTriangles(self.faces)
        made.endModel()
        return made


def buildGeomFromMJCF(model: Model, mjcf_filename: Any, geom_type: Any, mesh_loader: Any = None) -> GeometryModel:
    """The geoms of an MJCF file on the joints of a model (pip install mujoco).

    model        of that file
    geom_type    COLLISION: geoms that may be in contact; VISUAL: those of the groups 0 to 2, and those without contact
    mesh_loader  ignored

    Each is named as in the file, or by its body and its number there; meshes are MuJoCo's triangles, without a path.
    Raises ModelError for a body that the model does not have, SpatialDynError for a height field or an SDF.
    """
    wanted = GeometryType(expected(geom_type, GeometryType, "geom_type"))
    return _geometry(compiled(mjcf_filename), expected(model, Model, "model"), wanted)


def buildModelsFromMJCF(filename: Any, *arguments: Any, **named: Any) -> tuple[Any, ...]:
    """The Model of an MJCF file, its contacts and its geometry: (model, contacts, collision_model, visual_model).

    filename         str or Path
    root_joint       joint model between the universe and the bodies of the world
    root_joint_name  its name, "root_joint" by default; optional in a call by position
    verbose          ignored
    meshLoader       ignored
    geometry_types   one GeometryModel is returned for each; by default COLLISION and VISUAL
    contacts         whether a list of RigidConstraintModel, of connects and welds, is the second result; True

    Raises what ``buildModelFromMJCF`` and ``buildGeomFromMJCF`` do.
    """
    names = ["root_joint", "verbose", "meshLoader", "geometry_types", "contacts"]
    names.insert(1 if len(arguments) >= 2 and isinstance(arguments[1], str) else 5, "root_joint_name")
    given = by_name("buildModelsFromMJCF", " ".join(names), arguments, named)
    kinds = given.get("geometry_types")
    kinds = (COLLISION, VISUAL) if kinds is None else kinds if isinstance(kinds, Iterable) else [kinds]
    m, name = compiled(filename), given.get("root_joint_name")
    model = model_of(m, given.get("root_joint"), ROOT_NAME if name is None else name)
    contacts = [constraints_of(m, model)] if given.get("contacts", True) else []
    return model, *contacts, *(_geometry(m, model, GeometryType(kind)) for kind in kinds)


def _geometry(m: Any, model: Model, kind: Any) -> GeometryModel:
    made, tree = GeometryModel(), tree_of(m)
    for added in _objects(m, tree, model, kind):
        made.addGeometryObject(added)
    return made


def _objects(m: Any, tree: Tree, model: Model, wanted: Any) -> Iterator[GeometryObject]:
    """The geoms of a kind, in the file's order."""
    import mujoco

    for g in range(m.ngeom):
        touches = bool(m.geom_contype[g]) or bool(m.geom_conaffinity[g])
        if not touches if wanted == COLLISION else touches and int(m.geom_group[g]) >= COLLISION_ONLY:
            continue
        body, kind = int(m.geom_bodyid[g]), int(m.geom_type[g])
        number = g - int(m.body_geomadr[body])
        own = name_of(m, mujoco.mjtObj.mjOBJ_GEOM, g) or f"{tree.link_of[body] if body else 'universe'}Geom_{number}"
        at = body_frame(tree, model, body)
        frame, material = model.frames[at], int(m.geom_matid[g])
        color = np.array(m.geom_rgba[g] if material < 0 else m.mat_rgba[material], float)
        made = GeometryObject(
            own, frame.parentJoint, at, frame.placement * SE3(pose_of(m.geom_pos[g], m.geom_quat[g])), None,
            KINDS.get(kind, "").upper(), np.ones(3), material >= 0, color, "",
        )  # fmt: skip
        made._described = _shape(m, g, kind, own)
        yield made


def _shape(m: Any, g: int, kind: int, name: str) -> Described | Triangles:
    """What is built when the shape is needed. Raises SpatialDynError."""
    if kind == MESH:
        k = int(m.geom_dataid[g])
        first, count = int(m.mesh_vertadr[k]), int(m.mesh_vertnum[k])
        corners, faces = int(m.mesh_faceadr[k]), int(m.mesh_facenum[k])
        vertices = np.array(m.mesh_vert[first : first + count], float)
        return Triangles(vertices, np.array(m.mesh_face[corners : corners + faces], np.int64))
    if kind not in KINDS:
        raise SpatialDynError(f'geom "{name}" is of kind {kind} of MuJoCo, expected one of {", ".join(KINDS.values())}')
    a, b, c = floats_of(m.geom_size[g])
    sizes = {PLANE: (), SPHERE: (a,), ELLIPSOID: (a, b, c), BOX: (2 * a, 2 * b, 2 * c)}.get(kind, (a, 2 * b))
    return Described(KINDS[kind], sizes)
