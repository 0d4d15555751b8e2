"""``pinocchio.visualize``: ViserVisualizer and MeshcatVisualizer draw in viser; the other classes show nothing."""

from __future__ import annotations

from . import meshcat_visualizer as meshcat_visualizer
from .visualizers import (
    BaseVisualizer,
    GepettoVisualizer,
    MeshcatVisualizer,
    Panda3dVisualizer,
    RVizVisualizer,
    ViserVisualizer,
)

__all__ = [
    "BaseVisualizer", "GepettoVisualizer", "MeshcatVisualizer", "Panda3dVisualizer", "RVizVisualizer",
    "ViserVisualizer",
]  # fmt: skip
