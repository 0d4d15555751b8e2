"""API by task: every public name in a group, with its first line, and its docstring below."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import spatialdyn as sd

from .docstrings import body, escaped, parameters, summary


class Group(NamedTuple):
    """A page of names: its title, a line on what it is for, and the names."""

    title: str
    about: str
    names: str


GROUPS = {
    "robots": Group(
        "Load, build and change robots",
        "From a file, from another library, or without a file; and back to a file.",
        "load load_urdf from_mjmodel from_pinocchio ModelBuilder Model Frame Joint JointLimits Rotor Robot assemble "
        "to_urdf to_mjcf total_mass inertial_parameters",
    ),
    "dynamics": Group(
        "Inverse and forward dynamics",
        "Torques of a motion, accelerations of torques, and the terms of M(q) q̈ + C(q, q̇) q̇ + g(q) = τ.",
        "rnea nonlinear_effects generalized_gravity static_torque modified_rnea aba forward_dynamics crba_solve "
        "aba_refined aba_square_root crba minverse coriolis_matrix coriolis_transpose_times_velocity mass_matrix_dot "
        "joint_forces wrench_at",
    ),
    "kinematics": Group(
        "Kinematics and Jacobians",
        "Where frames are, how they move, and which joints move them.",
        "frame_placement frame_velocity frame_acceleration frame_jacobian frame_jacobian_dot jacobian_dot_times_v "
        "forward_kinematics joint_velocities joint_accelerations joint_jacobians joint_jacobians_dot solve_ik IKResult",
    ),
    "configurations": Group(
        "Configurations",
        "Positions of joints as points of a Lie group: quaternions and floating bases included.",
        "neutral random_configuration integrate difference interpolate normalize dintegrate ddifference",
    ),
    "derivatives": Group(
        "Derivatives",
        "By position, velocity and torque; exact, from recursions of their own.",
        "rnea_derivatives aba_derivatives generalized_gravity_derivatives static_torque_derivatives "
        "mass_matrix_derivatives christoffel_symbols frame_velocity_derivatives frame_acceleration_derivatives "
        "center_of_mass_velocity_derivatives centroidal_dynamics_derivatives step_derivatives linearize",
    ),
    "momentum": Group(
        "Energy, momentum and the centre of mass",
        "Of the whole robot and of its parts.",
        "kinetic_energy potential_energy momentum velocity_from_momentum momentum_rate center_of_mass "
        "center_of_mass_velocity center_of_mass_acceleration com_jacobian subtree_centers_of_mass "
        "subtree_com_velocities subtree_com_accelerations centroidal_momentum centroidal_momentum_rate centroidal_map "
        "centroidal_map_dot",
    ),
    "simulation": Group(
        "Simulation",
        "A scene is a robot and what acts on it; a run is its motion.",
        "Scene simulate step rollout integrators Trajectory Rollout ContactRecord Control Cost energy_ledger "
        "EnergyLedger hamilton_simulation",
    ),
    "chips": Group(
        "Code for a chip",
        "C of calls, laws and steps, without allocation.",
        "export",
    ),
    "studies": Group(
        "Studies",
        "A function of a scene on any number of random samples, in chunks, on any executor.",
        "study Study Moments Quantiles Worst TallQR",
    ),
    "actuation": Group(
        "Friction, motors and springs",
        "What stands between a motor and a joint.",
        "Friction friction_torque friction_regressor Motor torque_limits Transmission read_transmissions to_actuators "
        "to_joints spring_torque spring_energy",
    ),
    "constraints": Group(
        "Constraints, loops and contacts",
        "Closed loops, held points, rolling, impacts, feet on the ground.",
        "Constraints PointConstraint WeldConstraint HingeConstraint DistanceConstraint CouplerConstraint "
        "RollingConstraint VelocityConstraint constrained_dynamics Constrained ConstrainedMotion "
        "constrained_dynamics_derivatives ConstrainedDerivatives constraint_error constraint_jacobian constraint_drift "
        "delassus impact Impact ConstrainedImpact close_loops project_configuration project_velocity mobility Mobility "
        "independent_joints Contacts Plane Heightfield contact_step ContactStep contact_gaps",
    ),
    "control": Group(
        "Control",
        "Paths, laws, gains, observers, and checks of a run.",
        "Path PathPoint PathPeaks quintic trapezoid spline fourier PD PDGravity PDPlus ComputedTorque Passivity "
        "EnergyShaping StateFeedback Gravity Impedance SlotineLi NaturalAdaptation ExcitationRecord cartesian_damping "
        "Gains critical_gains gravity_stiffness_bound lqr LQR closed_step "
        "ClosedStep largest_step MomentumObserver momentum_observer_step detection_thresholds ContactWrench "
        "contact_wrench base_velocity passivity PassivityRecord lyapunov LyapunovRecord",
    ),
    "tasks": Group(
        "Operational space and tasks",
        "Inertia and forces of a frame; tasks in strict order; robots that stand on their feet.",
        "operational_space OperationalSpace operational_space_inertia_inverse operational_space_coupling task_torque "
        "TaskTorque FrameTask ComTask PostureTask WholeBody WholeBodyMotion Relaxation",
    ),
    "identification": Group(
        "Regressors and identification",
        "Torques, forces and energies as linear functions of masses, centres of mass and inertias; these from logs.",
        "identify Identified Validation Recording excitation base_parameters Base joint_torque_regressor "
        "body_regressor kinetic_energy_regressor potential_energy_regressor static_regressor "
        "modified_torque_regressor momentum_regressor coriolis_transpose_regressor",
    ),
    "mechanics": Group(
        "Lagrange and Hamilton",
        "Closed forms, Hamilton's equations, what is conserved.",
        "SymbolicManipulator ChristoffelC verify_skew_symmetry hamiltonian hamilton_equations hamilton_field "
        "poisson_bracket conserved_quantities check_conservation",
    ),
    "accuracy": Group(
        "Speed and accuracy",
        "How far off a number may be, what it costs, and what a motion needs.",
        "specialize Specialized Promise bounded exact Exact trade Tradeoff Option recommend Recommendation requires "
        "Requirement simplify diagnose Diagnosis Finding compare_with_pinocchio",
    ),
    "running": Group(
        "Compiling, threads and loops of one's own",
        "How calls are run.",
        "compile kernels set_num_threads",
    ),
    "pictures": Group(
        "Pictures",
        "In the browser and as plots.",
        "view plot",
    ),
    "conversion": Group(
        "States of other libraries",
        "Joint positions and velocities in the order and conventions of MuJoCo and Drake.",
        "to_mujoco from_mujoco to_drake from_drake",
    ),
    "errors": Group(
        "Errors",
        "All derive from SpatialDynError, a ValueError.",
        "SpatialDynError ShapeError ConfigurationError NonFiniteError UrdfError InertiaError ModelError "
        "ConstraintError IdentificationError SimulationError SimulationInterrupt StudyError",
    ),
}
# where a name that no group lists goes, by the package that it is of
BY_PACKAGE = {
    "accuracy": "accuracy", "actuation": "actuation", "calls": "dynamics", "constraints": "constraints",
    "control": "control", "interop": "conversion", "monitors": "control", "lagrangian": "mechanics",
    "linearization": "derivatives", "model": "robots",
    "pictures": "pictures", "recursions": "dynamics", "simulation": "simulation", "sources": "robots",
    "urdf": "robots", "identification": "identification", "studies": "studies", "operational": "tasks",
    "embedded": "chips",
}  # fmt: skip


@cache
def groups() -> dict[str, tuple[str, ...]]:
    """{page: its names}: those of GROUPS, then further public names, by their packages."""
    found = {page: [x for x in group.names.split() if x in sd.__all__] for page, group in GROUPS.items()}
    listed = {x for names in found.values() for x in names}
    for name in sorted({*sd.__all__} - listed):
        package = str(getattr(getattr(sd, name), "__module__", "")).split(".")[1:2]
        found[BY_PACKAGE.get(package[0] if package else "", "dynamics")].append(name)
    return {page: tuple(names) for page, names in found.items()}


def page_of() -> dict[str, str]:
    """{public name: its page}."""
    return {name: page for page, names in groups().items() for name in names}


def index() -> str:
    """The page that lists all groups and names."""
    lines = [
        "API by task", "===========", "",
        f"The {len(sd.__all__)} public names, as ``sd.NAME`` after ``import spatialdyn as sd``. ``help(sd.NAME)`` "
        "prints the same text. Each call takes any leading batch shape.", "",
        ".. toctree::", "   :hidden:", "", *(f"   {page}" for page in GROUPS),
    ]  # fmt: skip
    for page, group in GROUPS.items():
        lines += [
            "",
            group.title,
            "-" * (2 * len(group.title)),
            "",
            f"{group.about} :doc:`{group.title} <{page}>`.",
            "",
        ]
        lines += _table(groups()[page])
    return "\n".join(lines) + "\n"


def page(name: str) -> str:
    """The page of a group: its names, then the docstring of each."""
    group = GROUPS[name]
    lines = [group.title, "=" * (2 * len(group.title)), "", group.about, "", ".. py:currentmodule:: spatialdyn", ""]
    lines += _table(groups()[name])
    for public in groups()[name]:
        lines += ["", *_entry(public, getattr(sd, public))]
    return "\n".join(lines) + "\n"


def _table(names: tuple[str, ...]) -> Iterator[str]:
    yield from (".. list-table::", "   :widths: 30 70", "   :class: names", "")
    for name in names:
        yield f"   * - :py:obj:`{name} <spatialdyn.{name}>`"
        yield f"     - {escaped(summary(getattr(sd, name)))}"


def _entry(name: str, thing: Any) -> Iterator[str]:
    if inspect.isclass(thing):
        error = issubclass(thing, BaseException)
        yield f".. py:{'exception' if error else 'class'}:: {name}{'' if error else parameters(thing)}"
    elif callable(thing):
        yield f".. py:function:: {name}{parameters(thing)}"
    else:
        yield f".. py:data:: {name}"
    yield from (textwrap.indent(line, "   ") for line in body(thing))
    for member, value in sorted(vars(thing).items()) if inspect.isclass(thing) else ():
        if not member.startswith("_"):
            yield from (textwrap.indent(line, "   ") for line in _member(thing, member, value))


def _member(thing: Any, member: str, value: Any) -> Iterator[str]:
    called = isinstance(value, (classmethod, staticmethod)) or inspect.isfunction(value)
    documented = value if isinstance(value, property) or called else None
    if documented is None or not inspect.getdoc(documented):
        return
    if called:
        given = parameters(getattr(thing, member)).replace("(self, ", "(").replace("(self)", "()")
        yield f".. py:method:: {member}{given}"
        if not inspect.isfunction(value):
            yield f"   :{type(value).__name__}:"
    else:
        yield f".. py:property:: {member}"
    yield from (textwrap.indent(line, "   ") for line in body(getattr(thing, member) if called else value))
