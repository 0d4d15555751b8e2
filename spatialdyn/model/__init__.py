"""From a robot to the table of bodies: joint rows, mimic joints, assembly, and the immutable Model."""

from .model import Frame, Joint, Model, assemble
from .robot import Robot

__all__ = ["Frame", "Joint", "Model", "Robot", "assemble"]
