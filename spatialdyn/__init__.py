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

from importlib import import_module
from typing import TYPE_CHECKING

from .calls import dynamics as _dynamics
from .calls import progress as _progress  # noqa: F401 - engines report long work to it
from .calls.dynamics import set_num_threads as set_num_threads
from .calls.dynamics import total_mass as total_mass
from .calls.random_configurations import random_configuration
from .calls.wrenches import wrench_at
from .engines.compiled.numba_kernels import kernels
from .errors import (
    ConfigurationError,
    ConstraintError,
    IdentificationError,
    InertiaError,
    ModelError,
    NonFiniteError,
    ShapeError,
    SimulationError,
    SimulationInterrupt,
    SpatialDynError,
    StudyError,
    UrdfError,
    literal,
)
from .model.model import Frame, Joint, Model, assemble
from .model.robot import JointLimits, Robot, Rotor
from .urdf.load import load_urdf

if TYPE_CHECKING:
    from .accuracy.diagnose import diagnose
    from .accuracy.findings import Diagnosis, Finding
    from .accuracy.requirement import Requirement
    from .accuracy.requires import requires
    from .accuracy.results import Option, Recommendation, Tradeoff
    from .accuracy.simplify import simplify
    from .accuracy.tradeoff import recommend, trade
    from .actuation.friction import Friction, friction_regressor, friction_torque
    from .actuation.motors import Motor, torque_limits
    from .actuation.springs import spring_energy, spring_torque
    from .actuation.transmissions import to_actuators, to_joints
    from .calls.bounded import bounded
    from .calls.dynamics import *
    from .calls.exact import Exact, exact
    from .calls.forward_dynamics import forward_dynamics
    from .calls.prepare import compile
    from .calls.promise import Promise
    from .calls.specialize import specialize
    from .calls.specialized import Specialized
    from .constraints.contact import Constrained, Impact, constrained_dynamics, impact
    from .constraints.contact_dynamics import ContactStep, contact_gaps, contact_step
    from .constraints.contact_points import Contacts, Heightfield, Plane
    from .constraints.derivatives import ConstrainedDerivatives, constrained_dynamics_derivatives
    from .constraints.dynamics import (
        ConstrainedImpact,
        ConstrainedMotion,
        constraint_drift,
        constraint_error,
        constraint_jacobian,
        delassus,
    )
    from .constraints.kinds import (
        CouplerConstraint,
        DistanceConstraint,
        HingeConstraint,
        PointConstraint,
        RollingConstraint,
        VelocityConstraint,
        WeldConstraint,
    )
    from .constraints.loops import (
        Mobility,
        close_loops,
        independent_joints,
        mobility,
        project_configuration,
        project_velocity,
    )
    from .constraints.table import Constraints
    from .control.adaptive import ExcitationRecord, NaturalAdaptation, SlotineLi
    from .control.control import Control
    from .control.cost import Cost
    from .control.gains import LQR, Gains, critical_gains, gravity_stiffness_bound, largest_step, lqr
    from .control.impedance import Impedance, cartesian_damping
    from .control.inverse_kinematics import IKResult, solve_ik
    from .control.laws import PD, ComputedTorque, EnergyShaping, Gravity, Passivity, PDGravity, PDPlus, StateFeedback
    from .control.motions import fourier, quintic, spline, trapezoid
    from .control.observers import (
        ContactWrench,
        MomentumObserver,
        base_velocity,
        contact_wrench,
        detection_thresholds,
        momentum_observer_step,
    )
    from .control.paths import Path, PathPeaks, PathPoint
    from .embedded.export import export
    from .identification.base import Base, base_parameters
    from .identification.excitation import excitation
    from .identification.identified import Identified, Validation
    from .identification.identify import identify
    from .identification.recording import Recording
    from .interop.pinocchio import from_pinocchio
    from .interop.states import from_drake, from_mujoco, to_drake, to_mujoco
    from .lagrangian.check_conservation import check_conservation
    from .lagrangian.conserved import conserved_quantities
    from .lagrangian.coriolis_constructions import ChristoffelC, verify_skew_symmetry
    from .lagrangian.hamiltonian import hamilton_equations, poisson_bracket
    from .lagrangian.symbolic_manipulator import SymbolicManipulator
    from .linearization.closed_step import ClosedStep, closed_step
    from .linearization.step_derivatives import linearize, step_derivatives
    from .model.builder import ModelBuilder
    from .model.transmission import Transmission
    from .monitors.ledger import EnergyLedger, energy_ledger
    from .monitors.monitors import LyapunovRecord, PassivityRecord, lyapunov, passivity
    from .operational.hierarchy import TaskTorque, task_torque
    from .operational.quadratic import Relaxation
    from .operational.space import OperationalSpace, operational_space, operational_space_coupling
    from .operational.tasks import ComTask, FrameTask, PostureTask
    from .operational.whole_body import WholeBody, WholeBodyMotion
    from .pictures.comparison_plots import plot
    from .pictures.view import view
    from .simulation.contact_record import ContactRecord
    from .simulation.methods.methods import integrators
    from .simulation.rollout_result import Rollout
    from .simulation.rollouts import rollout
    from .simulation.runs import hamilton_simulation, simulate
    from .simulation.scene import Scene
    from .simulation.single_step import step
    from .simulation.trajectory import Trajectory
    from .sources.load import load
    from .sources.mjmodel import from_mjmodel
    from .sources.to_mjcf import to_mjcf
    from .sources.to_urdf import to_urdf
    from .studies.reductions import Moments, Quantiles, TallQR, Worst
    from .studies.study import Study, study
    from .urdf.transmissions import read_transmissions
    from .validate.comparison import compare_with_pinocchio

__version__ = "0.1.0"
__all__ = [
    *_dynamics.__all__,
    "Base", "ChristoffelC", "ClosedStep", "ComTask", "ComputedTorque", "ConfigurationError", "Constrained",
    "ConstrainedDerivatives", "ConstrainedImpact", "ConstrainedMotion", "ConstraintError", "Constraints",
    "ContactRecord", "ContactStep", "ContactWrench", "Contacts", "Control", "Cost", "CouplerConstraint", "Diagnosis",
    "DistanceConstraint", "EnergyLedger", "EnergyShaping", "Exact", "ExcitationRecord", "Finding", "Frame", "FrameTask",
    "Friction", "Gains", "Gravity", "Heightfield", "HingeConstraint", "IKResult", "IdentificationError", "Identified",
    "Impact", "Impedance", "InertiaError", "Joint", "JointLimits", "LQR", "LyapunovRecord", "Mobility", "Model",
    "ModelBuilder", "ModelError", "Moments", "MomentumObserver", "Motor", "NaturalAdaptation", "NonFiniteError",
    "OperationalSpace", "Option", "PD", "PDGravity", "PDPlus", "Passivity", "PassivityRecord", "Path", "PathPeaks",
    "PathPoint", "Plane", "PointConstraint", "PostureTask", "Promise", "Quantiles", "Recommendation", "Recording",
    "Relaxation", "Requirement", "Robot", "RollingConstraint", "Rollout", "Rotor", "Scene", "ShapeError",
    "SimulationError", "SimulationInterrupt", "SlotineLi", "SpatialDynError", "Specialized", "StateFeedback", "Study",
    "StudyError", "SymbolicManipulator", "TallQR", "TaskTorque", "Tradeoff", "Trajectory", "Transmission", "UrdfError",
    "Validation", "VelocityConstraint", "WeldConstraint", "WholeBody", "WholeBodyMotion", "Worst", "assemble",
    "base_parameters", "base_velocity", "bounded", "cartesian_damping", "check_conservation", "close_loops",
    "closed_step", "compare_with_pinocchio", "compile", "conserved_quantities", "constrained_dynamics",
    "constrained_dynamics_derivatives", "constraint_drift", "constraint_error", "constraint_jacobian", "contact_gaps",
    "contact_step", "contact_wrench", "critical_gains", "delassus", "detection_thresholds", "diagnose",
    "energy_ledger", "exact", "excitation", "export", "forward_dynamics", "fourier", "friction_regressor",
    "friction_torque", "from_drake", "from_mjmodel", "from_mujoco", "from_pinocchio", "gravity_stiffness_bound",
    "hamilton_equations", "hamilton_simulation", "identify", "impact", "independent_joints", "integrators", "kernels",
    "largest_step", "linearize", "load", "load_urdf", "lqr", "lyapunov", "mobility", "momentum_observer_step",
    "operational_space", "operational_space_coupling", "passivity", "plot", "poisson_bracket", "project_configuration",
    "project_velocity", "quintic", "random_configuration", "read_transmissions", "recommend", "requires", "rollout",
    "simplify", "simulate", "solve_ik", "specialize", "spline", "spring_energy", "spring_torque", "step",
    "step_derivatives", "study", "task_torque", "to_actuators", "to_drake", "to_joints", "to_mjcf", "to_mujoco",
    "to_urdf", "torque_limits", "trade", "trapezoid", "verify_skew_symmetry", "view", "wrench_at",
]  # fmt: skip

_LATE = {  # {module: public names}, imported when one is asked for, so that an import is short
    "accuracy.diagnose": "diagnose", "accuracy.findings": "Diagnosis Finding",
    "accuracy.requirement": "Requirement", "accuracy.requires": "requires",
    "accuracy.results": "Option Recommendation Tradeoff", "accuracy.simplify": "simplify",
    "accuracy.tradeoff": "recommend trade", "actuation.friction": "Friction friction_regressor friction_torque",
    "actuation.motors": "Motor torque_limits", "actuation.springs": "spring_energy spring_torque",
    "actuation.transmissions": "to_actuators to_joints",
    "calls.bounded": "bounded", "calls.exact": "Exact exact",
    "calls.forward_dynamics": "forward_dynamics", "calls.prepare": "compile", "calls.promise": "Promise",
    "calls.specialize": "specialize",
    "calls.specialized": "Specialized",
    "constraints.contact": "Constrained Impact constrained_dynamics impact",
    "constraints.contact_dynamics": "ContactStep contact_gaps contact_step",
    "constraints.contact_points": "Contacts Heightfield Plane",
    "constraints.derivatives": "ConstrainedDerivatives constrained_dynamics_derivatives",
    "constraints.dynamics": "ConstrainedImpact ConstrainedMotion constraint_drift constraint_error constraint_jacobian "
    "delassus",
    "constraints.kinds": "CouplerConstraint DistanceConstraint HingeConstraint PointConstraint RollingConstraint "
    "VelocityConstraint WeldConstraint",
    "constraints.loops": "Mobility close_loops independent_joints mobility project_configuration project_velocity",
    "constraints.table": "Constraints",
    "control.adaptive": "ExcitationRecord NaturalAdaptation SlotineLi",
    "control.impedance": "Impedance cartesian_damping",
    "operational.whole_body": "WholeBody WholeBodyMotion", "operational.quadratic": "Relaxation",
    "control.inverse_kinematics": "IKResult solve_ik",
    "control.observers": "ContactWrench MomentumObserver base_velocity contact_wrench detection_thresholds "
    "momentum_observer_step",
    "control.laws": "ComputedTorque EnergyShaping Gravity PD PDGravity PDPlus Passivity StateFeedback",
    "control.gains": "Gains LQR critical_gains gravity_stiffness_bound largest_step lqr",
    "monitors.monitors": "LyapunovRecord PassivityRecord lyapunov passivity",
    "control.motions": "fourier quintic spline trapezoid", "control.paths": "Path PathPeaks PathPoint",
    "embedded.export": "export", "interop.pinocchio": "from_pinocchio",
    "identification.base": "Base base_parameters", "identification.identified": "Identified Validation",
    "identification.identify": "identify", "identification.excitation": "excitation",
    "identification.recording": "Recording",
    "interop.states": "from_drake from_mujoco to_drake to_mujoco",
    "lagrangian.check_conservation": "check_conservation", "lagrangian.conserved": "conserved_quantities",
    "lagrangian.coriolis_constructions": "ChristoffelC verify_skew_symmetry",
    "lagrangian.hamiltonian": "hamilton_equations poisson_bracket",
    "lagrangian.symbolic_manipulator": "SymbolicManipulator",
    "linearization.closed_step": "ClosedStep closed_step",
    "linearization.step_derivatives": "linearize step_derivatives", "model.builder": "ModelBuilder",
    "model.transmission": "Transmission", "urdf.transmissions": "read_transmissions",
    "operational.hierarchy": "TaskTorque task_torque",
    "operational.space": "OperationalSpace operational_space operational_space_coupling",
    "operational.tasks": "ComTask FrameTask PostureTask",
    "pictures.comparison_plots": "plot", "pictures.view": "view",
    "control.control": "Control", "control.cost": "Cost", "simulation.contact_record": "ContactRecord",
    "monitors.ledger": "EnergyLedger energy_ledger",
    "simulation.methods.methods": "integrators", "simulation.rollout_result": "Rollout",
    "simulation.rollouts": "rollout", "simulation.runs": "hamilton_simulation simulate", "simulation.scene": "Scene",
    "simulation.single_step": "step", "simulation.trajectory": "Trajectory", "sources.load": "load",
    "sources.mjmodel": "from_mjmodel", "sources.to_mjcf": "to_mjcf", "sources.to_urdf": "to_urdf",
    "studies.reductions": "Moments Quantiles TallQR Worst", "studies.study": "Study study",
    "validate.comparison": "compare_with_pinocchio",
}  # fmt: skip
_MODULE_OF = {name: module for module, names in _LATE.items() for name in names.split()}
_ROOMS = (
    "accuracy", "actuation", "constraints", "control", "embedded", "identification", "interop", "lagrangian",
    "linearization", "monitors", "operational", "pictures", "sources", "simulation", "studies", "validate",
)  # fmt: skip


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])


def __getattr__(name: str) -> object:
    if name in _dynamics.calls:
        value: object = _dynamics.calls[name]
        globals()[name] = value
        return value
    if name in _MODULE_OF:
        value = getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)
        globals()[name] = value
        return value
    if name in _ROOMS:
        return import_module(f".{name}", __name__)
    if name.startswith("_"):
        found = ""
    else:
        from .interop.names import suggestion

        found = suggestion(name, __all__)
    raise AttributeError(
        f"module {literal(__name__)} has no attribute {literal(name)}" + (f", {found}" if found else "")
    )
