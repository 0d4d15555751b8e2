"""The names of ``pinocchio.visualize``, for scripts that can do without a picture: nothing is shown.

A visualizer can be made, and its methods do nothing; the first one made warns. ``spatialdyn.simulate`` gives a
Trajectory, whose poses MeshCat or viser draw.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, ClassVar

from .coverage.coverage import OutOfScopeAttributeError, OutOfScopeError
from .data.data import Data
from .model.geometry import GeometryData, GeometryModel
from .model.model import Model

_ADVICE = "draw the poses data.oMi with meshcat or viser"


@cache
def _warn() -> None:
    """Say once a process that nothing is shown."""
    warnings.warn(f"visualizers of spatialdyn show nothing: {_ADVICE}", stacklevel=3)


class BaseVisualizer:
    """A visualizer that shows nothing.

    model, collision_model, visual_model  what it would show
    data, collision_data, visual_data     their data, made if not given
    viewer                                what ``initViewer`` was given, else None

    ``display`` and the other methods of Pinocchio's visualizers accept anything and do nothing. Images and videos
    raise OutOfScopeError.
    """

    _video_writer: ClassVar[Any] = None

    def __init__(
        self,
        model: Model | None = None,
        collision_model: GeometryModel | None = None,
        visual_model: GeometryModel | None = None,
        copy_models: bool = False,
        data: Data | None = None,
        collision_data: GeometryData | None = None,
        visual_data: GeometryData | None = None,
    ) -> None:
        _warn()
        given = [Model() if model is None else model, collision_model, visual_model]
        if copy_models:
            given = [None if x is None else x.copy() for x in given]
        self.model, self.collision_model, self.visual_model = given
        self.data: Any = data
        self.collision_data: Any = collision_data
        self.visual_data: Any = visual_data
        self.viewer: Any = None
        if data is None:
            self.rebuildData()

    def rebuildData(self) -> None:
        """Make new data for the models as they are now."""
        self.data, self.collision_data, self.visual_data = (
            None if x is None else x.createData() for x in (self.model, self.collision_model, self.visual_model)
        )

    def initViewer(self, viewer: Any = None, *arguments: Any, **named: Any) -> None:
        """Keep a viewer; nothing is opened."""
        self.viewer = viewer

    def getViewerNodeName(self, geometry_object: Any, geometry_type: Any) -> str:
        """The name of a geometry object."""
        return str(geometry_object.name)

    def has_video_writer(self) -> bool:
        """False: there are no videos."""
        return False

    def captureImage(self, *arguments: Any, **named: Any) -> Any:
        """Raises OutOfScopeError."""
        raise OutOfScopeError(f"captureImage: visualizers of spatialdyn show nothing, {_ADVICE}")

    @contextmanager
    def create_video_ctx(self, *arguments: Any, **named: Any) -> Iterator[None]:
        """Raises OutOfScopeError."""
        raise OutOfScopeError(f"create_video_ctx: visualizers of spatialdyn show nothing, {_ADVICE}")
        yield

    def display(self, q: Any = None) -> None:
        """Nothing."""

    def play(
        self, q_trajectory: Any, dt: Any = None, callback: Any = None, capture: bool = False, **named: Any
    ) -> None:
        """Nothing; the callback is called as for a picture of each configuration: ``callback(k, q, self)``."""
        if callback is not None:
            for k, q in enumerate(q_trajectory):
                callback(k, q, self)

    def __getattr__(self, name: str) -> Any:
        if name in _IDLE.split():
            return _nothing
        raise OutOfScopeAttributeError(f"a visualizer of spatialdyn has no {name}, for it shows nothing: {_ADVICE}")


_IDLE = """
    addGeometryObject clean delete disableCameraControl displayCollisions displayFrames displayVisuals
    drawFrameVelocities enableCameraControl initializeFrames loadViewerGeometryObject loadViewerModel reload reset
    setBackgroundColor setCameraPose setCameraPosition setCameraPreset setCameraTarget setCameraZoom sleep updateFrames
    updatePlacements
"""


def _nothing(*arguments: Any, **named: Any) -> None:
    """Do nothing."""


class MeshcatVisualizer(BaseVisualizer):
    """A visualizer that shows nothing, under this name."""


class GepettoVisualizer(BaseVisualizer):
    """A visualizer that shows nothing, under this name."""


class ViserVisualizer(BaseVisualizer):
    """A visualizer that shows nothing, under this name."""


class RVizVisualizer(BaseVisualizer):
    """A visualizer that shows nothing, under this name."""


class Panda3dVisualizer(BaseVisualizer):
    """A visualizer that shows nothing, under this name."""


__all__ = [
    "BaseVisualizer",
    "GepettoVisualizer",
    "MeshcatVisualizer",
    "Panda3dVisualizer",
    "RVizVisualizer",
    "ViserVisualizer",
]
