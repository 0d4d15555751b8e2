"""The shapes of a robot in a picture: its URDF's geometry, or its inertias for links without geometry."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from ..model.model import Model
from .inertia_shapes import bars, inertia_boxes, joint_axes, reach
from .mesh_files import Folder
from .shapes import KINDS, Geometry, Shape, urdf_shapes
from .stage import warn_of

SHAPES = (*KINDS, "inertia")


def robot_shapes(model: Model, kind: str, urdf: Any = None, package_dirs: Sequence[Folder] = ()) -> Geometry:
    """The shapes to draw, with warnings of missing and faulty meshes; inertias replace missing geometry.

    kind          one of SHAPES
    urdf          source of the geometry, as in ``load_urdf``; by default the file from which the model was read
    package_dirs  folders that hold the packages of ``package://`` names
    """
    robot, links = model.robot, {link.name for link in model.robot.links}
    source = urdf if urdf is not None else robot.source or None
    if kind == "inertia" or source is None:
        return Geometry(_inertias(model), [], [])
    if urdf is None and not os.path.isfile(source):
        missing = [f"{source} is not there any more"]
        warn_of(robot.name, missing)
        return Geometry(_inertias(model), missing, [])
    shapes, missing, faulty = urdf_shapes(source, kind, package_dirs)
    shapes = [shape for shape in shapes if shape.link in links]
    warn_of(robot.name, missing, faulty)
    if not shapes:
        return Geometry(_inertias(model), missing, faulty)
    bare = links - {shape.link for shape in shapes}
    without = [link for link in robot.links if link.name in bare]
    return Geometry(shapes + (inertia_boxes(without, reach(robot)) if missing else []), missing, faulty)


def _inertias(model: Model) -> list[Shape]:
    robot, size = model.robot, reach(model.robot)
    return [*inertia_boxes(robot.links, size), *joint_axes(robot, size), *bars(robot, size)]
