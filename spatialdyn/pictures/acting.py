"""The effects of a scene in a robot's picture: ground, contact points and their impulses, loops, constant forces.

Drawn on a Stage with the robot: the ground of ``Contacts``, a sphere for each point, an arrow for its impulse; a mark
for each place of a constraint, and a line to its counterpart, of length 0 if the constraint is met; wheels that roll;
constant forces. Couplers, constraints on velocities alone, friction and limits have no place and are not drawn.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..constraints.contact_points import Contacts, Plane
from ..constraints.kinds import (
    Constraint,
    DistanceConstraint,
    HingeConstraint,
    PointConstraint,
    RollingConstraint,
    WeldConstraint,
    across,
    placed,
)
from ..model.model import Model
from ..simulation import Rollout, Trajectory
from ..simulation.scene import Scene
from .ground import axes_of, centres, normals, surface
from .mesh_files import Color
from .stage import Stage, plain, quaternions

Array = NDArray[np.float64]
POINT: Color = (0.98, 0.8, 0.15, 0.55)  # spheres of contact points
IMPULSE: Color = (0.35, 0.05, 0.6, 1.0)
CUT: Color = (0.85, 0.05, 0.1, 1.0)  # arrows that are cut
HELD: Color = (0.1, 0.55, 0.3, 1.0)
SOIL: Color = (0.86, 0.82, 0.74, 1.0)
SLOPES: Color = (0.62, 0.56, 0.45, 1.0)  # a heightfield; light makes it paler
FORCE: Color = (0.85, 0.1, 0.55, 1.0)  # none of these is red, green or blue: those are the axes of frames
MOMENT: Color = (0.0, 0.55, 0.6, 1.0)
ARROW = 0.25  # of the robot's size: length of the median impulse, and of the largest constant force
LONGEST = 1.0  # of the robot's size: longer arrows are cut
TINY = 0.04  # of the robot's size: radius of a point without one
WINDOW = 1.0 / 60.0  # [s] before the time shown, over which impulses are averaged


class Place(NamedTuple):
    """A place on a body: its index, 0 the world, and the pose (4, 4) there."""

    body: int
    X: Array

    def at(self, bodies: Array) -> Array:
        """Where it is in the world (3,), with bodies at (n, 4, 4)."""
        return np.asarray(bodies[self.body, :3, :3] @ self.X[:3, 3] + bodies[self.body, :3, 3])


def scene_of_run(given: Any) -> Scene | None:
    """The scene of a Trajectory or a Rollout, None if it has none."""
    return given.scene if isinstance(given, (Trajectory, Rollout)) else None


def impulses_of(given: Any, sample: int) -> Array | None:
    """The recorded impulses (N, k, 3) of a Trajectory, or of a sample of a Rollout; None without [N s]."""
    record = given.contacts if isinstance(given, (Trajectory, Rollout)) else None
    if record is None or not record.impulse.shape[-2]:
        return None
    x = np.asarray(record.impulse, np.float64)
    return x if x.ndim == 3 else x[sample]


def places(model: Model, x: Constraint) -> tuple[Place, Place] | None:
    """The two places that a constraint holds together: on a's and on b's body; None for one without places."""
    if not isinstance(x, (PointConstraint, WeldConstraint, HingeConstraint, DistanceConstraint)):
        return None
    a = model.frame(x.frame_a)
    held = Place(a.joint, a.placement @ placed(x.at_a))
    if x.frame_b is None:
        return held, Place(0, placed(x.at_b))
    b = model.frame(x.frame_b)
    return held, Place(b.joint, b.placement @ placed(x.at_b))


class Acting:
    """The effects of a scene, drawn on a Stage.

    scene      the Scene
    impulses   (N, k, 3)  of the steps that end at the times t (N,), None if not recorded [N s]
    scale      [m/(N s)]  length of an impulse's arrow: the median nonzero impulse is a quarter of the robot's size
    """

    def __init__(self, stage: Stage, scene: Scene, size: float, box: Array, impulses: Array | None, t: Array) -> None:
        """``size`` of the robot [m], ``box`` (2, 3) around its motion [m]."""
        self.scene, self.size, self.impulses, self.t = scene, size, impulses, t
        self._stage, self._server = stage, stage.server.scene
        self.handles: list[Any] = []
        self._arrows: list[Any] = []
        self._lines: list[tuple[Place, Place, Any]] = []
        self.scale = 0.0
        self._visible = True
        contacts = scene.contacts
        if contacts is not None and len(contacts):
            self._add_ground(contacts, box)
            self._add_points(contacts)
        for x in scene.constraints or ():
            self._add_constraint(x)
        if scene.fext is not None:
            self._add_forces(scene.fext)

    def place(self, X: Array, first: int | None = None, last: int | None = None) -> None:
        """Move the parts that are not fixed to a body, for bodies at X (bodies, 4, 4).

        first, last  the recorded steps, ends included, whose mean impulse is drawn; None draws none
        """
        for a, b, handle in self._lines:
            handle.points = np.stack([a.at(X), b.at(X)])[None].astype(np.float32)
        contacts = self.scene.contacts
        if contacts is None or not self._arrows:
            return
        mean = np.zeros((len(contacts), 3))
        if self.impulses is not None and first is not None and last is not None:
            mean = self.impulses[first : last + 1].mean(axis=0)
        at = centres(contacts, X)
        foot = at - np.array(contacts.radii)[:, None] * normals(contacts, at)
        for handle, start, impulse in zip(self._arrows, foot, mean, strict=True):
            arrow = self.scale * impulse
            length, longest = float(np.linalg.norm(arrow)), LONGEST * self.size
            handle.visible = self._visible and length > 1e-3 * self.size
            if handle.visible:
                cut = arrow * (longest / length if length > longest else 1.0)
                handle.points = np.stack([start, start + cut])[None].astype(np.float32)
                handle.colors = as_bytes(CUT if length > longest else IMPULSE)

    def first_of(self, k: int) -> int:
        """The first of the recorded steps that are shown only at the k-th time."""
        return min(k, int(np.searchsorted(self.t, self.t[k] - WINDOW, side="right")))

    def show(self, on: bool) -> None:
        """Show all of it or hide it; arrows come with the next ``place``."""
        self._visible = on
        for handle in (*self.handles, *(self._arrows if not on else ())):
            handle.visible = on

    # --- ground, points and impulses -----------------------------------------------------------------------

    def _add_ground(self, contacts: Contacts, box: Array) -> None:
        terrain, radius = contacts.terrain, max(0.5 * float(np.linalg.norm(box[1] - box[0])), self.size)
        if isinstance(terrain, Plane):
            n, middle = np.array(terrain.normal), box.mean(0)
            at = middle + (terrain.height - n @ middle) * n
            made = self._stage.add_grid("/ground", at, axes_of(terrain), radius, SOIL)
        else:
            wide = np.stack([box.mean(0) - 2.0 * radius, box.mean(0) + 2.0 * radius])
            vertices, faces, edges = surface(terrain, wide)
            made = self._server.add_mesh_simple(
                "/ground", vertices, faces, color=SLOPES[:3], side="double", flat_shading=True
            )
            grid = np.array([0.75 * x for x in SLOPES[:3]])
            self.handles.append(
                self._server.add_line_segments("/ground/edges", edges, grid, thickness=0.01 * terrain.spacing)
            )
        self.handles.append(made)

    def _add_points(self, contacts: Contacts) -> None:
        for name, radius in zip(contacts.names, contacts.radii, strict=True):
            frame = contacts.model.frame(name)
            self._ball(Place(frame.joint, frame.placement), f"contact_{name}", POINT, radius or TINY * self.size)
        if self.impulses is None:
            return
        sizes = np.linalg.norm(self.impulses, axis=-1)
        acting = sizes[sizes > 0.0]
        if not acting.size:
            return
        self.scale = ARROW * self.size / float(np.median(acting))
        for name in contacts.names:
            ends = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, self.size]]])
            self._arrows.append(self._arrow(f"/impulses/{plain(name)}", ends, IMPULSE))

    # --- constraints and forces ----------------------------------------------------------------------------

    def _add_constraint(self, x: Constraint) -> None:
        if isinstance(x, RollingConstraint):
            self._add_wheel(x)
        pair = places(self.scene.model, x)
        if pair is None:
            return
        a, b = pair
        radius, name = 0.018 * self.size, plain(x.label)
        if isinstance(x, WeldConstraint):
            node = self._stage.fresh_name(a.body, f"held_{name}")
            turn = quaternions(a.X[:3, :3])
            self.handles.append(
                self._server.add_box(node, HELD[:3], 3 * [2.0 * radius], wxyz=turn, position=a.X[:3, 3])
            )
        else:
            self._ball(a, f"held_{name}", HELD, radius)
        if isinstance(x, HingeConstraint):
            along = 5.0 * radius * (a.X[:3, :3] @ np.array(x.axis))
            self._segments(a.body, f"axis_{name}", [[a.X[:3, 3] - along, a.X[:3, 3] + along]], 0.5 * radius)
        if isinstance(x, DistanceConstraint):
            self._ball(b, f"held_to_{name}", HELD, radius)
        elif b.body == 0:  # a cross in the world, along the axes that are held
            held = [k for k, letter in enumerate("xyz") if letter in getattr(x, "axes", "xyz")]
            arms = 3.0 * radius * b.X[:3, :3].T[held]
            self._segments(0, f"held_to_{name}", np.stack([b.X[:3, 3] - arms, b.X[:3, 3] + arms], 1), 0.3 * radius)
        line = self._server.add_line_segments(
            self._stage.fresh_name(0, f"between_{name}"), np.zeros((1, 2, 3)), np.array(HELD[:3]),
            thickness=0.6 * radius,
        )  # fmt: skip
        self.handles.append(line)
        self._lines.append((a, b, line))

    def _add_wheel(self, x: RollingConstraint) -> None:
        """The rim of a wheel, or three circles of a sphere."""
        frame = self.scene.model.frame(x.frame)
        turns = np.linspace(0.0, 2.0 * np.pi, 49)[:, None]
        segments = []
        for axis in np.eye(3) if x.axis is None else np.array([x.axis]):
            u, w = across(np.asarray(axis, np.float64))
            rim = x.radius * (np.cos(turns) * u + np.sin(turns) * w)
            points = rim @ frame.placement[:3, :3].T + frame.placement[:3, 3]
            segments.append(np.stack([points[:-1], points[1:]], axis=1))
        self._segments(frame.joint, f"rolls_{plain(x.label)}", np.concatenate(segments), 0.008 * self.size)

    def _add_forces(self, fext: Array) -> None:
        """Constant forces and moments at their bodies, in the joints' frames."""
        for part, color, word in ((fext[:, :3], FORCE, "force"), (fext[:, 3:], MOMENT, "moment")):
            largest = float(np.linalg.norm(part[1:], axis=1).max(initial=0.0))
            for k in range(1, len(part)):
                if part[k].any():
                    end = ARROW * self.size / largest * part[k]
                    node = self._stage.fresh_name(k, f"constant_{word}")
                    self.handles.append(self._arrow(node, np.stack([np.zeros(3), end])[None], color))

    def _ball(self, place: Place, name: str, color: Color, radius: float) -> None:
        opacity = None if color[3] >= 1.0 else color[3]
        node = self._stage.fresh_name(place.body, name)
        self.handles.append(
            self._server.add_icosphere(node, radius, color=color[:3], opacity=opacity, position=place.X[:3, 3])
        )

    def _segments(self, body: int, name: str, ends: Any, thickness: float) -> None:
        node = self._stage.fresh_name(body, name)
        made = self._server.add_line_segments(node, np.asarray(ends), np.array(HELD[:3]), thickness=thickness)
        self.handles.append(made)

    def _arrow(self, node: str, ends: Array, color: Color) -> Any:
        radius = 0.011 * self.size
        return self._server.add_arrows(
            node, ends, np.array(color[:3]), shaft_radius=radius, head_radius=2.5 * radius, head_length=5.0 * radius
        )


def as_bytes(color: Color) -> NDArray[np.uint8]:
    """A colour as viser keeps it."""
    return np.round(255.0 * np.array(color[:3])).astype(np.uint8)
