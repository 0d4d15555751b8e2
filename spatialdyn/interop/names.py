"""Names of the calls in other libraries and textbooks, and subjects that an example or another library covers."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import NamedTuple


class Aliases(NamedTuple):
    """Other names of one public call, separated by spaces."""

    words: str  # in textbooks and in common use
    pinocchio: str = ""
    mujoco: str = ""
    toolbox: str = ""  # robotics-toolbox-python
    drake: str = ""  # MultibodyPlant
    pybullet: str = ""


NAMES: dict[str, Aliases] = {
    "load_urdf": Aliases(
        "load_robot read_urdf from_urdf",
        "buildModelFromUrdf",
        "MjModel",
        "ERobot URDF",
        "Parser AddModels",
        "loadURDF",
    ),
    "rnea": Aliases(
        "inverse_dynamics id newton_euler",
        "rnea",
        "mj_inverse mj_rne",
        "rne",
        "CalcInverseDynamics",
        "calculateInverseDynamics",
    ),
    "crba": Aliases(
        "mass_matrix inertia_matrix joint_space_inertia M",
        "crba",
        "mj_fullM mj_makeM",
        "inertia",
        "CalcMassMatrix",
        "calculateMassMatrix",
    ),
    "aba": Aliases("fd articulated_body", "aba", "mj_forward", "accel"),
    "minverse": Aliases("inverse_mass_matrix mass_matrix_inverse", "computeMinverse", "mj_solveM"),
    "coriolis_matrix": Aliases("coriolis C", "computeCoriolisMatrix", "", "coriolis"),
    "nonlinear_effects": Aliases(
        "bias bias_force bias_forces coriolis_and_gravity", "nonLinearEffects", "qfrc_bias", "", "CalcBiasTerm"
    ),
    "generalized_gravity": Aliases(
        "gravity gravity_vector gravity_torque g",
        "computeGeneralizedGravity",
        "",
        "gravload",
        "CalcGravityGeneralizedForces",
    ),
    "forward_kinematics": Aliases("fk joint_placements", "forwardKinematics", "mj_kinematics", "fkine_all"),
    "frame_placement": Aliases(
        "frame_pose link_pose frame_placements", "updateFramePlacement updateFramePlacements framesForwardKinematics",
        "xpos xmat", "fkine", "EvalBodyPoseInWorld CalcRelativeTransform", "getLinkState"
    ),
    "frame_jacobian": Aliases(
        "jacobian jac",
        "getFrameJacobian computeFrameJacobian",
        "mj_jac mj_jacBody mj_jacSite",
        "jacob0 jacobe",
        "CalcJacobianSpatialVelocity",
        "calculateJacobian",
    ),
    "frame_jacobian_dot": Aliases(
        "jacobian_dot jacobian_derivative", "getFrameJacobianTimeVariation", "mj_jacDot", "jacob0_dot"
    ),
    "joint_jacobians": Aliases("", "computeJointJacobians getJointJacobian computeJointJacobian"),
    "center_of_mass": Aliases("com", "centerOfMass", "subtree_com", "", "CalcCenterOfMassPositionInWorld"),
    "com_jacobian": Aliases("center_of_mass_jacobian", "jacobianCenterOfMass", "mj_jacSubtreeCom"),
    "centroidal_map": Aliases("centroidal_momentum_matrix", "ccrba computeCentroidalMap", "mj_angmomMat"),
    "centroidal_momentum": Aliases("", "computeCentroidalMomentum", "subtree_angmom"),
    "kinetic_energy": Aliases("", "computeKineticEnergy", "", "", "CalcKineticEnergy"),
    "potential_energy": Aliases("", "computePotentialEnergy", "", "", "CalcPotentialEnergy"),
    "hamiltonian": Aliases(
        "energy mechanical_energy total_energy", "computeMechanicalEnergy", "mj_energyPos mj_energyVel"
    ),
    "rnea_derivatives": Aliases("inverse_dynamics_derivatives", "computeRNEADerivatives", "mjd_inverseFD"),
    "aba_derivatives": Aliases("forward_dynamics_derivatives", "computeABADerivatives", "mjd_transitionFD"),
    "joint_torque_regressor": Aliases("regressor", "computeJointTorqueRegressor"),
    "integrate": Aliases("configuration_plus", "", "mj_integratePos"),
    "difference": Aliases("configuration_minus", "", "mj_differentiatePos"),
    "random_configuration": Aliases("random_q", "randomConfiguration", "", "random_q"),
    "neutral": Aliases("home zero_configuration q0", "", "qpos0", "qz qr"),
    "wrench_at": Aliases(
        "external_force fext apply_force", "", "mj_applyFT xfrc_applied", "", "", "applyExternalForce"
    ),
    "step": Aliases("", "", "mj_step", "", "", "stepSimulation"),
    "simulate": Aliases("ode45 odeint solve_ivp run simulator simulation", "", "", "fdyn nofriction"),
    "friction_torque": Aliases("joint_friction coulomb_friction", "", "qfrc_passive frictionloss", "friction"),
    "constrained_dynamics": Aliases("contact_dynamics", "forwardDynamics constraintDynamics"),
    "constrained_dynamics_derivatives": Aliases("", "computeConstraintDynamicsDerivatives"),
    "constraint_jacobian": Aliases("", "getConstraintsJacobian getConstraintJacobian"),
    "delassus": Aliases("", "computeDelassusMatrix"),
    "impact": Aliases("impulse", "impulseDynamics"),
    "compare_with_pinocchio": Aliases("compare validate_against_pinocchio"),
    "view": Aliases("visualize visualise viz show display render animate viewer meshcat"),
    "plot": Aliases("plot_trajectory plots"),
    "trade": Aliases("benchmark"),
    "solve_ik": Aliases(
        "ik inverse_kinematics compute_ik clik", "", "", "ikine ikine_LM ikine_GN ikine_NR",
        "InverseKinematics", "calculateInverseKinematics"
    ),
    "PD": Aliases("pid pd pd_control pd_controller controller joint_control"),
    "ComputedTorque": Aliases("computed_torque inverse_dynamics_control feedback_linearization"),
    "Passivity": Aliases("slotine_li passivity_based"),
    "lqr": Aliases("dlqr riccati care dare"),
    "MomentumObserver": Aliases("momentum_observer disturbance_observer collision_detection contact_observer"),
    "spline": Aliases("splines trajectory cubic_spline waypoints trajectory_generation", "", "", "mstraj"),
    "quintic": Aliases("minimum_jerk min_jerk", "", "", "jtraj"),
    "trapezoid": Aliases("trapezoidal trapezoidal_profile velocity_profile", "", "", "mtraj"),
    "fourier": Aliases("fourier_series"),
    "identify": Aliases("identification parameter_identification system_identification sysid"),
    "Trajectory": Aliases("trajectories"),
    "SymbolicManipulator": Aliases("symbolic sympy eom equations_of_motion lagrange"),
}  # fmt: skip

EXAMPLES: dict[str, str] = {  # example of the gallery -> words for subjects that it shows and no call covers
    "cart_pole_lqr": "cart_pole",
    "ilqr": "ilqr ddp trajopt trajectory_optimization optimal_control",
    "mppi_on_lanes": "mppi mpc",
    "gravity_compensation": "gravity_compensation",
    "friction_network": "network neural lagrangian hamiltonian dissipation residual learning",
    "gradient_of_a_design": "grad gradient gradients autodiff autograd",
    "c_export": "c_code codegen export_c",
    "casadi_export": "casadi to_casadi",
    "vector_environment": "gym gymnasium env environment",
    "own_loop": "jit njit",
    "double_pendulum": "pendulum double_pendulum",
}  # fmt: skip

_FACE = "spatialdyn.compat.pinocchio"
ABSENT: dict[str, str] = {  # library to use instead -> words
    "no shapes are here to collide; Pinocchio with coal, or MuJoCo, finds collisions": "collision collisions collide "
    "check_collision distance_to closest_points geometry computeCollisions computeDistances",
    "sd.load reads MJCF, xacro and URDF, from_mjmodel a mujoco.MjModel": "mjcf load_mjcf from_mjcf read_mjcf "
    "buildModelFromMJCF load_xml xacro load_xacro",
    "SDF is not read; Drake reads it": "sdf load_sdf buildModelFromSdf buildModelsFromSdf",
    f"poses are arrays (4, 4); {_FACE}.SE3 is a class of them": "SE3 SE_3 pose Pose transform Transform SO3",
    f"quaternions are arrays (4,), x y z w; {_FACE}.Quaternion is a class of them": "quaternion quaternions",
    f"calls take and return arrays, nothing is kept between them; {_FACE}.Data is a class that keeps results": "Data "
    "create_data createData MjData",
    "paths are not planned here; OMPL finds them, and spline joins their points": "plan planner planning "
    "motion_planning rrt",
    "every call takes any leading batch shape": "vmap batch batched vectorize",
}


def suggestion(name: str, public: Iterable[str]) -> str:
    """A hint for an unknown name: ``did you mean ...``, an example, or another library; empty if no name is similar.

    name    the unknown name
    public  the library's names
    """
    plain = name.lower()
    for ours, others in NAMES.items():
        if plain in _words(*others):
            return f"did you mean {ours}"
    for example, words in EXAMPLES.items():
        if plain in _words(words):
            return f"see `spatialdyn example {example}`"
    for instead, words in ABSENT.items():
        if plain in _words(words):
            return instead
    near = get_close_matches(name, sorted(public), n=1, cutoff=0.75)
    return f"did you mean {near[0]}" if near else ""


def _words(*fields: str) -> set[str]:
    return {word.lower() for field in fields for word in field.split()}
