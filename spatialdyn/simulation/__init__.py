"""Integrators of the equation of motion, including structure-preserving methods."""

from .methods.methods import Method, integrators
from .rollout_result import Rollout
from .rollouts import rollout
from .runs import hamilton_simulation, simulate
from .trajectory import Trajectory

__all__ = ["Method", "Rollout", "Trajectory", "hamilton_simulation", "integrators", "rollout", "simulate"]
