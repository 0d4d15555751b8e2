"""Integrators of the equation of motion, those that keep its structure among them."""

from .methods import Method, integrators
from .runs import hamilton_simulation, simulate
from .trajectory import Trajectory

__all__ = ["Method", "Trajectory", "hamilton_simulation", "integrators", "simulate"]
