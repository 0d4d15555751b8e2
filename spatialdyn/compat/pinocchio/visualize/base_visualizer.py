"""Visualizers that show nothing: they construct, their methods do nothing, and the first one of a process warns."""

from __future__ import annotations

import time
import warnings
from functools import cache
from typing import Any, ClassVar

from ....errors import pip_install
from ..coverage.coverage import OutOfScopeAttributeError, OutOfScopeError, refused
from ..data.data import Data
from ..model.geometry import GeometryData, GeometryModel, createDatas
from ..model.model import Model

__all__ = ["BaseVisualizer", "GepettoVisualizer", "Panda3dVisualizer", "RVizVisualizer"]
_ADVICE = f"ViserVisualizer and MeshcatVisualizer draw where viser is installed: {pip_install('view')}"


@cache
def _warn() -> None:
    """Warn once per process that visualizers show nothing."""
    warnings.warn(f"this visualizer of spatialdyn shows nothing: {_ADVICE}", stacklevel=3)


class BaseVisualizer:
    """A visualizer that shows nothing: its methods accept anything; images and videos raise OutOfScopeError.

    model, collision_model, visual_model; data, collision_data, visual_data, made if not given; viewer, that of
    ``initViewer``, None before
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
        if not self._draws():
            _warn()
        models: list[Any] = [Model() if model is None else model, collision_model, visual_model]
        self.model, self.collision_model, self.visual_model = (
            x.copy() if copy_models and x is not None else x for x in models
        )
        self.data: Any = data
        self.collision_data: Any = collision_data
        self.visual_data: Any = visual_data
        self.viewer: Any = None
        if data is None:
            self.rebuildData()

    @classmethod
    def _draws(cls) -> bool:
        """Whether there is a picture."""
        return False

    def rebuildData(self) -> None:
        """Make new data for the models as they are now."""
        models = self.model, self.collision_model, self.visual_model
        self.data, self.collision_data, self.visual_data = createDatas(*models)

    def initViewer(self, viewer: Any = None, *arguments: Any, **named: Any) -> None:
        """Store a viewer; none is opened."""
        self.viewer = viewer

    def getViewerNodeName(self, geometry_object: Any, geometry_type: Any) -> str:
        """The name of a geometry object."""
        return str(geometry_object.name)

    def has_video_writer(self) -> bool:
        """False: there are no videos."""
        return False

    def captureImage(self, *arguments: Any, **named: Any) -> Any:
        """Raises OutOfScopeError."""
        raise OutOfScopeError(f"captureImage: this visualizer of spatialdyn shows nothing, {_ADVICE}")

    create_video_ctx = refused("BaseVisualizer.create_video_ctx")

    def display(self, q: Any = None) -> None:
        """Do nothing."""

    def play(
        self, q_trajectory: Any, dt: Any = None, callback: Any = None, capture: bool = False, **named: Any
    ) -> None:
        """Call ``display(q)``, then ``callback(k, q, self)``, for each configuration, one each dt seconds if it draws.

        There are no videos: ``capture`` is ignored.
        """
        for k, q in enumerate(q_trajectory):
            start = time.monotonic()
            self.display(q)
            if callback is not None:
                callback(k, q, self)
            if dt is not None and self._draws():
                time.sleep(max(0.0, start + float(dt) - time.monotonic()))

    def __getattr__(self, name: str) -> Any:
        if name in _IDLE.split():
            return _nothing
        raise OutOfScopeAttributeError(f"a visualizer of spatialdyn has no {name}; {_ADVICE}")


_IDLE = """
    addGeometryObject clean delete disableCameraControl displayCollisions displayFrames displayVisuals
    drawFrameVelocities enableCameraControl initializeFrames loadViewerGeometryObject loadViewerModel reload reset
    setBackgroundColor setCameraPose setCameraPosition setCameraPreset setCameraTarget setCameraZoom sleep updateFrames
    updatePlacements
"""


def _nothing(*arguments: Any, **named: Any) -> None:
    """Do nothing."""


def _idle(name: str) -> type[BaseVisualizer]:
    return type(name, (BaseVisualizer,), {"__doc__": "A visualizer that shows nothing.", "__module__": __name__})


GepettoVisualizer, RVizVisualizer, Panda3dVisualizer = map(
    _idle, ("GepettoVisualizer", "RVizVisualizer", "Panda3dVisualizer")
)
