"""The calls under the names that other libraries and textbooks give them."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import NamedTuple


class Names(NamedTuple):
    """Other names of one public call; several are separated by spaces."""

    words: str  # what textbooks and people say
    pinocchio: str = ""
    mujoco: str = ""
    toolbox: str = ""  # robotics-toolbox-python
    drake: str = ""  # MultibodyPlant
    pybullet: str = ""


NAMES: dict[str, Names] = {
    "load_urdf": Names(
        "load_robot load read_urdf from_urdf",
        "buildModelFromUrdf",
        "MjModel",
        "ERobot URDF",
        "Parser AddModels",
        "loadURDF",
    ),
    "rnea": Names(
        "inverse_dynamics id newton_euler",
        "rnea",
        "mj_inverse mj_rne",
        "rne",
        "CalcInverseDynamics",
        "calculateInverseDynamics",
    ),
    "crba": Names(
        "mass_matrix inertia_matrix joint_space_inertia M",
        "crba",
        "mj_fullM mj_makeM",
        "inertia",
        "CalcMassMatrix",
        "calculateMassMatrix",
    ),
    "aba": Names("fd articulated_body", "aba", "mj_forward", "accel"),
    "minverse": Names("inverse_mass_matrix mass_matrix_inverse", "computeMinverse", "mj_solveM"),
    "coriolis_matrix": Names("coriolis C", "computeCoriolisMatrix", "", "coriolis"),
    "nonlinear_effects": Names(
        "bias bias_force bias_forces coriolis_and_gravity", "nonLinearEffects", "qfrc_bias", "", "CalcBiasTerm"
    ),
    "generalized_gravity": Names(
        "gravity gravity_vector gravity_torque g",
        "computeGeneralizedGravity",
        "",
        "gravload",
        "CalcGravityGeneralizedForces",
    ),
    "forward_kinematics": Names("fk joint_placements", "forwardKinematics", "mj_kinematics", "fkine_all"),
    "frame_placement": Names(
        "frame_pose link_pose frame_placements", "updateFramePlacement updateFramePlacements framesForwardKinematics",
        "xpos xmat", "fkine", "EvalBodyPoseInWorld CalcRelativeTransform", "getLinkState"
    ),
    "frame_jacobian": Names(
        "jacobian jac",
        "getFrameJacobian computeFrameJacobian",
        "mj_jac mj_jacBody mj_jacSite",
        "jacob0 jacobe",
        "CalcJacobianSpatialVelocity",
        "calculateJacobian",
    ),
    "frame_jacobian_dot": Names(
        "jacobian_dot jacobian_derivative", "getFrameJacobianTimeVariation", "mj_jacDot", "jacob0_dot"
    ),
    "joint_jacobians": Names("", "computeJointJacobians getJointJacobian computeJointJacobian"),
    "center_of_mass": Names("com", "centerOfMass", "subtree_com", "", "CalcCenterOfMassPositionInWorld"),
    "com_jacobian": Names("center_of_mass_jacobian", "jacobianCenterOfMass", "mj_jacSubtreeCom"),
    "centroidal_map": Names("centroidal_momentum_matrix", "ccrba computeCentroidalMap", "mj_angmomMat"),
    "centroidal_momentum": Names("", "computeCentroidalMomentum", "subtree_angmom"),
    "kinetic_energy": Names("", "computeKineticEnergy", "", "", "CalcKineticEnergy"),
    "potential_energy": Names("", "computePotentialEnergy", "", "", "CalcPotentialEnergy"),
    "hamiltonian": Names(
        "energy mechanical_energy total_energy", "computeMechanicalEnergy", "mj_energyPos mj_energyVel"
    ),
    "rnea_derivatives": Names("inverse_dynamics_derivatives", "computeRNEADerivatives", "mjd_inverseFD"),
    "aba_derivatives": Names("forward_dynamics_derivatives linearize", "computeABADerivatives", "mjd_transitionFD"),
    "joint_torque_regressor": Names("regressor", "computeJointTorqueRegressor"),
    "integrate": Names("configuration_plus", "", "mj_integratePos"),
    "difference": Names("configuration_minus", "", "mj_differentiatePos"),
    "random_configuration": Names("random_q", "randomConfiguration", "", "random_q"),
    "neutral": Names("home zero_configuration q0", "", "qpos0", "qz qr"),
    "wrench_at": Names("external_force fext apply_force", "", "mj_applyFT xfrc_applied", "", "", "applyExternalForce"),
    "step": Names("", "", "mj_step", "", "", "stepSimulation"),
    "simulate": Names("ode45 odeint solve_ivp run", "", "", "fdyn nofriction"),
    "constrained_dynamics": Names("contact_dynamics", "forwardDynamics constraintDynamics"),
    "impact": Names("impulse", "impulseDynamics"),
    "compare_with_pinocchio": Names("compare validate_against_pinocchio"),
}  # fmt: skip


def suggestion(name: str, public: Iterable[str]) -> str:
    """``did you mean`` of a name that the library does not have; empty when nothing is near.

    name    what was asked for
    public  the names that there are
    """
    plain = name.lower()
    for ours, others in NAMES.items():
        if plain in {word.lower() for field in others for word in field.split()}:
            return f"did you mean {ours}"
    near = get_close_matches(name, sorted(public), n=1, cutoff=0.75)
    return f"did you mean {near[0]}" if near else ""
