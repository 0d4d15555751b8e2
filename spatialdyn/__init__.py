"""Rigid-body dynamics of robots: M(q) q̈ + C(q, q̇) q̇ + g(q) = τ from a URDF, in NumPy and Numba.

>>> import spatialdyn as sd
>>> model = sd.load_urdf("two_link")
>>> q, v = [0.5, -0.3], [1.0, 2.0]
>>> tau = sd.rnea(model, q, v, [0.0, 0.0])
>>> bool(abs(sd.aba(model, q, v, tau)).max() < 1e-12)
True

Every call takes ``(model, arrays...)`` of any leading batch shape; ``help(sd.rnea)`` gives shapes, units and
errors. Quantities and conventions are Pinocchio's: joints depth first by name, spatial vectors linear first,
quaternions x y z w, the velocity of a floating base in its own frame.
"""

from __future__ import annotations

from .accuracy.diagnose import diagnose
from .accuracy.findings import Diagnosis, Finding
from .accuracy.results import Option, Recommendation, Tradeoff
from .accuracy.simplify import simplify
from .accuracy.tradeoff import recommend, trade
from .calls import dynamics as _dynamics
from .calls.dynamics import *
from .calls.exact import Exact, exact
from .calls.forward_dynamics import forward_dynamics
from .calls.specialize import Specialized, specialize
from .calls.states import random_configuration, step, wrench_at
from .constraints.contact import Constrained, Impact, constrained_dynamics, impact
from .engines.compiled.numba_kernels import kernels
from .errors import (
    ConfigurationError,
    ConstraintError,
    InertiaError,
    ModelError,
    NonFiniteError,
    ShapeError,
    SimulationError,
    SimulationInterrupt,
    SpatialDynError,
    UrdfError,
)
from .interop.names import suggestion as _suggestion
from .interop.pinocchio import from_pinocchio
from .interop.states import from_drake, from_mujoco, to_drake, to_mujoco
from .lagrangian.check_conservation import check_conservation
from .lagrangian.conserved import conserved_quantities
from .lagrangian.coriolis_constructions import ChristoffelC, verify_skew_symmetry
from .lagrangian.hamiltonian import hamilton_equations, poisson_bracket
from .lagrangian.symbolic_manipulator import SymbolicManipulator
from .model.builder import ModelBuilder
from .model.model import Frame, Joint, Model, assemble
from .model.robot import Robot
from .simulation import PD, Rollout, Trajectory, hamilton_simulation, integrators, rollout, simulate
from .urdf.load import load_urdf
from .validate import compare_with_pinocchio

__version__ = "0.1.0"
__all__ = [
    *_dynamics.__all__,
    "ChristoffelC", "ConfigurationError", "Constrained", "ConstraintError", "Diagnosis", "Exact", "Finding", "Frame",
    "Impact", "InertiaError", "Joint", "Model", "ModelBuilder", "ModelError", "NonFiniteError", "Option", "PD",
    "Recommendation", "Robot", "Rollout", "ShapeError", "SimulationError", "SimulationInterrupt", "SpatialDynError",
    "Specialized", "SymbolicManipulator", "Tradeoff", "Trajectory", "UrdfError", "assemble", "check_conservation",
    "compare_with_pinocchio", "conserved_quantities", "constrained_dynamics", "diagnose", "exact", "forward_dynamics",
    "from_drake", "from_mujoco", "from_pinocchio", "hamilton_equations", "hamilton_simulation", "impact", "integrators",
    "kernels", "load_urdf", "poisson_bracket", "random_configuration", "recommend", "rollout", "simplify", "simulate",
    "specialize", "step", "to_drake", "to_mujoco", "trade", "verify_skew_symmetry", "wrench_at",
]  # fmt: skip


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])


def __getattr__(name: str) -> object:
    found = "" if name.startswith("_") else _suggestion(name, __all__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}" + (f", {found}" if found else ""))
