"""Inertias as shapes: the robot of the dynamics, independent of its meshes.

A link's box of even density has the link's mass, centre of mass and inertia, so a wrong inertia shows as a box that is
too large, too thin or turned. A box for an inertia that no mass distribution has is red.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..model.physical_inertia import inertia_defect
from ..model.robot import Link, Robot
from .mesh_files import Color
from .shapes import Shape, box, cylinder, sphere

Array = NDArray[np.float64]
BOX: Color = (0.35, 0.55, 0.85, 0.3)
WRONG: Color = (0.85, 0.1, 0.1, 0.5)
CENTRE: Color = (0.95, 0.6, 0.1, 1.0)
AXIS: dict[str, Color] = {"prismatic": (0.2, 0.65, 0.3, 1.0)}  # others turn
TURNING: Color = (0.25, 0.25, 0.3, 1.0)
BAR: Color = (0.6, 0.6, 0.62, 1.0)
THIN = 4e-3  # of the robot's size: sides of a box are drawn at least this thick


def box_of(link: Link) -> tuple[Array, Array]:
    """The box of even density with a link's mass, centre and inertia: its pose (4, 4) in the link, its sides (3,) [m].

    With Σ = ½ tr(I) 1 - I the second moments of mass and m the mass, the sides are √(12 σ / m), σ the eigenvalues of Σ.
    Sides of negative σ, which no mass distribution has, are √(12 |σ| / m).
    """
    I = np.reshape(link.inertia, (3, 3))
    second, axes = np.linalg.eigh(0.5 * np.trace(I) * np.eye(3) - I)
    X = np.eye(4)
    X[:3, :3] = axes if np.linalg.det(axes) > 0.0 else axes * [1.0, 1.0, -1.0]
    X[:3, 3] = link.com
    return X, np.sqrt(12.0 * abs(second) / link.mass)


def inertia_boxes(links: Sequence[Link], size: float) -> list[Shape]:
    """A box for each link with mass, and at its centre of mass a ball of a volume proportional to the mass.

    size  of the robot [m]
    """
    made = []
    total = sum(link.mass for link in links)
    for link in links:
        if link.mass <= 0.0:
            continue
        X, sides = box_of(link)
        vertices, faces = box(np.maximum(sides, THIN * size))
        color = WRONG if inertia_defect(np.reshape(link.inertia, (3, 3))) else BOX
        made.append(Shape(link.name, vertices @ X[:3, :3].T + X[:3, 3], faces, color))
        ball, faces = sphere(0.03 * size * math.cbrt(link.mass / total))
        made.append(Shape(link.name, ball + X[:3, 3], faces, CENTRE))
    return made


def joint_axes(robot: Robot, size: float) -> list[Shape]:
    """A rod along the axis of each moving joint, a ball for joints without axis; in the frame of the child link."""
    made = []
    for joint in robot.joints:
        if joint.kind == "fixed":
            continue
        if joint.kind in ("spherical", "floating"):
            vertices, faces = sphere(0.02 * size)
        else:
            slides = joint.kind in AXIS
            vertices, faces = cylinder((0.005 if slides else 0.012) * size, (0.16 if slides else 0.08) * size)
            vertices = vertices @ turned_to(np.array(joint.axis)).T
        made.append(Shape(joint.child, vertices, faces, AXIS.get(joint.kind, TURNING)))
    return made


def bars(robot: Robot, size: float) -> list[Shape]:
    """A bar from the origin of each link to each joint that it carries: the robot's skeleton."""
    made = []
    for joint in robot.joints:
        end = np.reshape(joint.placement, (4, 4))[:3, 3]
        if np.linalg.norm(end) > 1e-6 * size:
            made.append(Shape(joint.parent, *bar(np.zeros(3), end, 0.004 * size), BAR))
    return made


def bar(start: Array, end: Array, radius: float) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and faces of a cylinder from one point to another."""
    along = end - start
    vertices, faces = cylinder(radius, float(np.linalg.norm(along)))
    return vertices @ turned_to(along).T + 0.5 * (start + end), faces


def turned_to(direction: Array) -> Array:
    """A rotation (3, 3) that takes z to a direction."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(np.eye(3)[int(np.argmin(abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def reach(robot: Robot) -> float:
    """A size of the robot [m]: the longest way along joints from the root to a link's origin or centre of mass.

    If all of them are at one point, the largest side of a link's box; 1 without boxes.
    """
    far = {robot.root: 0.0}
    links, children = {link.name: link for link in robot.links}, robot.children
    stack, longest = [robot.root], 0.0
    while stack:
        name = stack.pop()
        longest = max(longest, far[name] + math.hypot(*links[name].com) * (links[name].mass > 0.0))
        for joint in children[name]:
            far[joint.child] = far[name] + math.hypot(*np.reshape(joint.placement, (4, 4))[:3, 3])
            stack.append(joint.child)
    if not longest > 0.0:
        longest = max((float(box_of(link)[1].max()) for link in robot.links if link.mass > 0.0), default=0.0)
    return longest if 0.0 < longest < math.inf else 1.0
