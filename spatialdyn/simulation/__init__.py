"""Integrators of the equation of motion, structure-preserving ones among them."""

from .effects.pd import PD
from .methods import Method, integrators
from .rollout_result import Rollout
from .rollouts import rollout
from .runs import hamilton_simulation, simulate
from .trajectory import Trajectory

__all__ = ["PD", "Method", "Rollout", "Trajectory", "hamilton_simulation", "integrators", "rollout", "simulate"]
