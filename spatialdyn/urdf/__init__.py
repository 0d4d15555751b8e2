"""URDF files and text to a Robot or a Model; robots by name."""

from .load import load_urdf
from .robot_files import example_robots, find_robot

__all__ = ["example_robots", "find_robot", "load_urdf"]
