"""``pinocchio.visualize``: ViserVisualizer and MeshcatVisualizer draw in viser; the other classes show nothing."""

from __future__ import annotations

from .base_visualizer import BaseVisualizer, GepettoVisualizer, Panda3dVisualizer, RVizVisualizer
from .meshcat_visualizer import MeshcatVisualizer
from .viser_visualizer import ViserVisualizer
from .visualizers import Visualizer

__all__ = [
    "BaseVisualizer", "GepettoVisualizer", "MeshcatVisualizer", "Panda3dVisualizer", "RVizVisualizer",
    "ViserVisualizer", "Visualizer",
]  # fmt: skip
