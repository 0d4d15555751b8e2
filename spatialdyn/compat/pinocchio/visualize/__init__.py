"""``pinocchio.visualize``: ViserVisualizer and MeshcatVisualizer draw in viser; the other classes show nothing."""

from __future__ import annotations

from .meshcat_visualizer import MeshcatVisualizer
from .visualizers import BaseVisualizer, GepettoVisualizer, Panda3dVisualizer, RVizVisualizer, ViserVisualizer

__all__ = [
    "BaseVisualizer", "GepettoVisualizer", "MeshcatVisualizer", "Panda3dVisualizer", "RVizVisualizer",
    "ViserVisualizer",
]  # fmt: skip
