"""``Visualizer``: the classes of visualizers by name, and the one that scripts get by default."""

from __future__ import annotations

import os
from enum import Enum

from ..coverage.coverage import OutOfScopeImportError
from .base_visualizer import BaseVisualizer, GepettoVisualizer, Panda3dVisualizer, RVizVisualizer
from .meshcat_visualizer import MeshcatVisualizer
from .viser_visualizer import ViserVisualizer

__all__ = ["Visualizer"]
VARIABLE = "PINOCCHIO_VIEWER"


class Visualizer(Enum):
    """The classes of visualizers."""

    BASE = BaseVisualizer
    GEPETTO = GepettoVisualizer
    MESHCAT = MeshcatVisualizer
    PANDA3D = Panda3dVisualizer
    RVIZ = RVizVisualizer
    VISER = ViserVisualizer

    @classmethod
    def default(cls) -> type[BaseVisualizer]:
        """The class that the environment variable PINOCCHIO_VIEWER names, in any case; without it MeshcatVisualizer.

        Raises OutOfScopeImportError, an ImportError, for another name.
        """
        name = os.environ.get(VARIABLE, cls.MESHCAT.name)
        if name.upper() not in cls.__members__:
            names = ", ".join(cls.__members__).lower()
            raise OutOfScopeImportError(f"{VARIABLE} is {name!r}, expected one of {names}")
        return cls[name.upper()].value
