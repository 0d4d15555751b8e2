"""ViserVisualizer: draws in viser; where viser is not installed it shows nothing.

It draws the objects of GeometryModels that are mesh files, boxes, cylinders or spheres; without any it draws boxes of
the inertias.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ....model.robot import Link
from ....pictures.inertia_shapes import inertia_boxes
from ....pictures.shapes import Shape, coal_shape, mesh_shapes
from ....pictures.stage import HOST, Stage, has_screen, warn_of
from ..algorithms import calls, configuration
from ..coverage.coal_package import installed
from ..model.geometry import GeometryModel
from ..model.geometry_object import VISUAL, GeometryObject
from ..types.arguments import ValueRuntimeError
from .base_visualizer import BaseVisualizer

__all__ = ["ViserVisualizer"]
PRIMITIVES = ("BOX", "CYLINDER", "SPHERE", "CAPSULE")  # meshPath of shapes that are no mesh


class ViserVisualizer(BaseVisualizer):
    """A visualizer that draws in viser; ``viewer`` is the viser.ViserServer. Without viser it shows nothing."""

    _stage: Stage | None = None  # made by initViewer

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._shown: dict[str, list[Any]] = {}  # what was drawn, by layer
        self._named: dict[str, dict[str, list[Any]]] = {}  # of the layers of geometry, by object

    @classmethod
    def _draws(cls) -> bool:
        return installed("viser")

    def initViewer(
        self,
        viewer: Any = None,
        open: bool = False,
        loadModel: bool = False,
        host: str = HOST,
        port: Any = 8000,
        **named: Any,
    ) -> None:
        """Start viser's server, at the next free port from ``port``, or take a running one.

        viewer     None, or a viser.ViserServer
        open       whether to open a tab of the browser
        loadModel  whether to call ``loadViewerModel``

        Raises  a RuntimeError for a viewer that is no server of viser.
        """
        self.viewer = viewer
        if not self._draws():
            return
        from viser import ViserServer

        server = getattr(viewer, "server", viewer)
        if server is not None and not isinstance(server, ViserServer):
            raise ValueRuntimeError(f"viewer is a {type(viewer).__name__}, expected None or a viser.ViserServer")
        self._stage = Stage(list(self.model.names), host, int(port), server)
        self._shown = {}
        self.viewer = self._window(self._stage.server)
        if open and has_screen():
            self._stage.open_tab()
        if loadModel:
            self.loadViewerModel()

    def _window(self, server: Any) -> Any:
        return server

    def _scene(self) -> Stage:
        if self._stage is None:
            raise ValueRuntimeError("the visualizer has no viewer, expected initViewer before")
        return self._stage

    def loadViewerModel(self, rootNodeName: str = "pinocchio", *arguments: Any, **named: Any) -> None:
        """Draw the robot at the poses ``data.oMi``, at first the neutral ones, in place of another of that name in
        the viewer. Arguments beside the first are ignored.

        A mesh that is not found is named in a warning.
        """
        if not self._draws():
            return
        stage = self._scene()
        self.viewerRootNodeName = rootNodeName
        calls.forwardKinematics(self.model, self.data, configuration.neutral(self.model))
        with stage.at_once():
            stage.root_at(rootNodeName)
            self._shown = {"visuals": self._geometry(self.visual_model, "visuals") or self._inertias()}
            self.display()
            stage.look_at(stage.bounds(stage.shown), 0.0)

    def _add(self, at: Any, shape: Shape) -> Any:
        """Draw a shape at a frame or geometry object."""
        return self._scene().add_shape(at.parentJoint, at.placement.homogeneous, shape)

    def _has_joint(self, added: GeometryObject, missing: list[str]) -> bool:
        """Whether the model has the joint of an object, which is listed as missing otherwise."""
        there = bool(0 <= added.parentJoint < self.model.njoints)
        if not there:
            missing.append(f"{added.name} is on joint {added.parentJoint}, expected one below {self.model.njoints}")
        return there

    def _geometry(self, given: GeometryModel | None, layer: str) -> list[Any]:
        """Draw the objects of a GeometryModel."""
        self._named[layer] = {}
        return self._draw([] if given is None else given.geometryObjects, layer)

    def _draw(self, objects: list[GeometryObject], layer: str) -> list[Any]:
        """Draw objects of a layer; returns viser's handles."""
        missing: list[str] = []
        faulty: list[str] = []
        made = {
            added.name: [self._add(added, shape) for shape in _shapes_of(added, missing, faulty)]
            for added in objects
            if self._has_joint(added, missing)
        }
        self._named.setdefault(layer, {}).update(made)
        warn_of(self.model.name, list(dict.fromkeys(missing)), list(dict.fromkeys(faulty)))
        return [handle for handles in made.values() for handle in handles]

    def loadViewerGeometryObject(self, geometry_object: Any, geometry_type: Any = VISUAL, color: Any = None) -> None:
        """Draw an object, in place of one of its name; color (4,) in place of its own."""
        layer = "visuals" if geometry_type == VISUAL else "collisions"
        self.delete(geometry_object, geometry_type)
        one = geometry_object.copy()
        if color is not None:
            one.meshColor, one.overrideMaterial = np.asarray(color, float), True
        self._shown.setdefault(layer, []).extend(self._draw([one], layer))

    def addGeometryObject(self, obj: Any, color: Any = None) -> None:
        """Add an object to the visual model and draw it."""
        if self.visual_model is not None:
            self.visual_model.addGeometryObject(obj)
        self.loadViewerGeometryObject(obj, VISUAL, color)

    def reload(self, new_geometry_object: Any, geometry_type: Any = VISUAL) -> None:
        """Draw the object of a name again, and put it in place of the old one in its model."""
        given = self.visual_model if geometry_type == VISUAL else self.collision_model
        if given is not None and given.existGeometryName(new_geometry_object.name):
            given.geometryObjects[given.getGeometryId(new_geometry_object.name)] = new_geometry_object
        self.loadViewerGeometryObject(new_geometry_object, geometry_type)

    def delete(self, geometry_object: Any, geometry_type: Any = VISUAL) -> None:
        """Remove an object from the picture."""
        layer = "visuals" if geometry_type == VISUAL else "collisions"
        gone = self._named.get(layer, {}).pop(geometry_object.name, [])
        self._shown[layer] = without(self._shown.get(layer, []), gone)
        for handle in gone:
            handle.remove()

    def _inertias(self) -> list[Any]:
        """Boxes of the joints' inertias."""
        links = [
            Link(name, I.mass, tuple(I.lever.tolist()), tuple(np.ravel(I.inertia).tolist()))
            for name, I in zip(self.model.names, self.model.inertias, strict=True)
        ]
        points = [*(X.translation for X in self.data.oMi), *(link.com for link in links)]
        size = max(float(np.linalg.norm(point)) for point in points) or 1.0
        joints = {name: k for k, name in enumerate(self.model.names)}
        return [self._scene().add_shape(joints[s.link], np.eye(4), s) for s in inertia_boxes(links[1:], size)]

    def display(self, q: Any = None) -> None:
        """Show the robot at q (nq,), or at the poses ``data.oMi`` as they are."""
        if self._stage is None:
            return
        if q is not None:
            calls.forwardKinematics(self.model, self.data, np.asarray(q, float))
        with self._stage.at_once():
            self._stage.pose(np.array([X.homogeneous for X in self.data.oMi]))

    def _switch(self, layer: str, visibility: bool, draw: Callable[[Stage], list[Any]] = lambda stage: []) -> None:
        """Show or hide a layer, drawn when it is first shown."""
        if self._stage is None:
            return
        if visibility and layer not in self._shown:
            self._shown[layer] = draw(self._stage)
        for handle in self._shown.get(layer, []):
            handle.visible = bool(visibility)

    def displayVisuals(self, visibility: bool) -> None:
        """Show or hide the visual geometry."""
        self._switch("visuals", visibility)

    def displayCollisions(self, visibility: bool) -> None:
        """Show or hide the collision geometry, which is read when it is first shown."""
        self._switch("collisions", visibility, lambda stage: self._geometry(self.collision_model, "collisions"))

    def displayFrames(self, visibility: bool, *arguments: Any, **named: Any) -> None:
        """Show or hide the axes of all frames."""

        def draw(stage: Stage) -> list[Any]:
            frames = self.model.frames
            return [stage.add_axes(x.parentJoint, x.placement.homogeneous, x.name, 0.2) for x in frames]

        self._switch("frames", visibility, draw)

    def clean(self) -> None:
        """Remove what was drawn."""
        for handle in [handle for layer in self._shown.values() for handle in layer]:
            handle.remove()
        self._shown, self._named = {}, {}

    def setCameraTarget(self, target: Any) -> None:
        """Point the camera at a position (3,)."""
        self._camera("look_at", target)

    def setCameraPosition(self, position: Any) -> None:
        """Put the camera at a position (3,)."""
        self._camera("position", position)

    def _camera(self, name: str, value: Any) -> None:
        """Set an attribute of the camera of each client, and of those to come."""
        if self._stage is not None:
            clients = self._stage.server.get_clients().values()
            for camera in (self._stage.server.initial_camera, *(client.camera for client in clients)):
                setattr(camera, name, np.asarray(value, float))

    def captureImage(
        self, w: Any = None, h: Any = None, client_id: Any = None, transport_format: Any = "jpeg", **named: Any
    ) -> Any:
        """The picture (h, w, 3) of a browser that shows the robot, the first one's by default.

        Raises  a RuntimeError if no browser has the page open; OutOfScopeError without viser.
        """
        if self._stage is None:
            return super().captureImage()
        clients = self._stage.server.get_clients()
        client = next(iter(clients.values()), None) if client_id is None else clients.get(client_id)
        if client is None:
            raise ValueRuntimeError(f"no browser shows {self._stage.url}, expected one for an image")
        height, width = h or client.camera.image_height, w or client.camera.image_width
        return client.get_render(height=height, width=width, transport_format=transport_format)


def without(handles: list[Any], gone: list[Any]) -> list[Any]:
    """The handles but for some, which are compared by identity: viser's have arrays."""
    return [x for x in handles if all(x is not y for y in gone)]


def _shapes_of(added: GeometryObject, missing: list[str], faulty: list[str]) -> list[Shape]:
    """The shapes of a GeometryObject: its mesh file, or a box, cylinder or sphere of coal."""
    color = tuple(np.asarray(added.meshColor, float).tolist())
    if added.meshPath and added.meshPath not in PRIMITIVES:
        found, lost, broken = mesh_shapes(added.name, added.meshPath, added.meshScale)
        missing += lost
        faulty += broken
        return [shape._replace(color=color) if added.overrideMaterial else shape for shape in found]
    shape = coal_shape(added.name, added.geometry, color)
    if shape is not None:
        return [shape]
    missing.append(f"{added.name} is a {type(added.geometry).__name__}, expected a mesh file, box, cylinder, sphere")
    return []
