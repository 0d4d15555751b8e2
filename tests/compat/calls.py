"""The table of calls that compat shares with Pinocchio: one line a call, run unchanged under both modules.

A text may use ``pin``, ``model``, ``data``, inputs, and lists of indices: ``frames``, ``carried`` (on joints that
move), ``joints``, ``heavy`` (joints that carry some mass). ``fields`` are those of data that the call fills in both
modules, ``but`` those that differ, with the reason beside them.
"""

from __future__ import annotations

from dataclasses import dataclass

BOUND = 1e-11  # scaled: of the largest entry, or 1
DERIVED = 1e-9  # of derivatives


@dataclass(frozen=True)
class Row:
    """A call.

    text      an expression; before ";" calls that it needs, which are statements
    fields    fields of data to compare after it
    but       fields that Pinocchio fills and compat does not, or with other values
    solves    it divides by the mass matrix: no result for robots with massless ends, rounding where M is near singular
    mass      it divides by the mass of the moving bodies, or of a subtree
    jacobian  Pinocchio crashes where nv is 0
    bound     on the scaled error
    """

    text: str
    fields: str = ""
    but: str = ""
    solves: bool = False
    mass: bool = False
    jacobian: bool = False
    bound: float = BOUND


SLOPES = "dtau_dq dtau_dv"
TORQUE = f"tau M {SLOPES}"
SWEPT = "J dJ oMi liMi ov v oa a oa_gf of oYcrb"
SCRATCHED = "dFda dFdq dFdv"
WEIGHED = "oa_gf of oYcrb Ag dFdq"
PREPARED = "pin.computeForwardKinematicsDerivatives(model, data, q, v, a); pin.updateFramePlacements(model, data)"
MASSES = "com mass oMi liMi"
MAP = "Ag J oMi liMi oYcrb"
# com holds the subtrees' centres here, only the robot's in Pinocchio; J, h and f are listed where they are equal
CALLS = (
    # --- dynamics
    Row("pin.rnea(model, data, q, v, a)", "tau v a_gf f h liMi"),
    Row("pin.rnea(model, data, q, v, a, fext)", "tau v a_gf f h liMi"),
    # a holds c + v × vJ in Pinocchio, an intermediate result; f[0] its sum at the universe
    Row("pin.aba(model, data, q, v, tau)", "ddq v a_gf h liMi", "a f", solves=True),
    Row("pin.aba(model, data, q, v, tau, fext)", "ddq v a_gf h liMi", "a f", solves=True),
    Row(
        "pin.aba(model, data, q, v, tau, pin.Convention.WORLD)", "ddq J oMi liMi oYcrb oa oa_gf oh ov", "of",
        solves=True,
    ),
    Row("pin.crba(model, data, q)", "M Ycrb liMi"),
    Row("pin.crba(model, data, q, pin.Convention.WORLD)", f"M {MAP}", "com mass", mass=True),
    Row("pin.nonLinearEffects(model, data, q, v)", "nle v a_gf f liMi"),
    Row("pin.nle(model, data, q, v)", "nle v a_gf f liMi"),
    Row("pin.computeGeneralizedGravity(model, data, q)", "g a_gf f liMi"),
    Row("pin.computeStaticTorque(model, data, q, fext)", "tau a_gf f liMi"),
    # Ag holds momenta about the world's origin in Pinocchio
    Row("pin.computeCoriolisMatrix(model, data, q, v)", "C J dJ liMi oMi oYcrb oh ov v", "Ag dFdv"),
    Row("pin.computeCoriolisMatrix(model, data, q, v); pin.getCoriolisMatrix(model, data)", "C"),
    Row("pin.computeMinverse(model, data, q)", "Minv J oMi liMi oYcrb", solves=True),
    Row(
        "pin.computeAllTerms(model, data, q, v)",
        f"{MASSES} {MAP} Ig Jcom M a a_gf dAg dJ dhg f g h hg kinetic_energy mechanical_energy nle ov potential_energy "
        "v vcom",
        mass=True,
    ),
    Row("pin.computeKineticEnergy(model, data, q, v)", "kinetic_energy liMi oMi v"),
    Row("pin.forwardKinematics(model, data, q, v); pin.computeKineticEnergy(model, data)", "kinetic_energy"),
    Row("pin.computePotentialEnergy(model, data, q)", "potential_energy liMi oMi"),
    Row("pin.forwardKinematics(model, data, q); pin.computePotentialEnergy(model, data)", "potential_energy"),
    Row(
        "pin.computeMechanicalEnergy(model, data, q, v)",
        "kinetic_energy potential_energy mechanical_energy liMi oMi v",
    ),
    Row("pin.forwardKinematics(model, data, q, v); pin.computeMechanicalEnergy(model, data)", "mechanical_energy"),
    # --- kinematics
    Row("pin.forwardKinematics(model, data, q)", "oMi liMi"),
    Row("pin.forwardKinematics(model, data, q, v)", "oMi liMi v"),
    Row("pin.forwardKinematics(model, data, q, v, a)", "oMi liMi v a"),
    Row("pin.framesForwardKinematics(model, data, q)", "oMi liMi oMf"),
    Row("pin.forwardKinematics(model, data, q); pin.updateFramePlacements(model, data)", "oMf"),
    Row("pin.forwardKinematics(model, data, q); [pin.updateFramePlacement(model, data, k) for k in frames]"),
    Row("pin.forwardKinematics(model, data, q); pin.updateGlobalPlacements(model, data)", "oMi"),
    Row("pin.rnea(model, data, q, v, a); pin.updateGlobalPlacements(model, data)", "oMi liMi"),
    *(
        Row(
            "pin.forwardKinematics(model, data, q, v, a); "
            f"[pin.{name}(model, data, k, r) for k in {which} for r in both]"
        )
        for which, names in (
            ("joints", "getVelocity getAcceleration getClassicalAcceleration"),
            ("frames", "getFrameVelocity getFrameAcceleration getFrameClassicalAcceleration"),
        )
        for name in names.split()
    ),
    Row("pin.forwardKinematics(model, data, q, v, a); [pin.getFrameVelocity(model, data, k) for k in frames]"),
    *(
        Row(
            "pin.forwardKinematics(model, data, q, v, a); "
            f"[pin.{name}(model, data, k, placement, r) for k in joints for r in both]"
        )
        for name in ("getFrameVelocity", "getFrameAcceleration", "getFrameClassicalAcceleration")
    ),
    Row("pin.computeJointJacobians(model, data, q)", "J oMi liMi", jacobian=True),
    Row("pin.forwardKinematics(model, data, q); pin.computeJointJacobians(model, data)", "J", jacobian=True),
    Row(
        "pin.computeJointJacobians(model, data, q); "
        "[pin.getJointJacobian(model, data, k, r) for k in joints for r in both]",
        jacobian=True,
    ),
    # iMf is scratch: joints in the frame. Pinocchio places only the joints that carry it, hence all frames and joints
    Row(
        "[pin.computeJointJacobian(model, data, q, k) for k in range(1, model.njoints)]", "liMi", "iMf", jacobian=True
    ),
    Row(
        "[pin.computeFrameJacobian(model, data, q, k, r) for k in range(model.nframes) for r in both]",
        "liMi oMi oMf", "iMf", jacobian=True,
    ),
    Row(
        "[pin.computeFrameJacobian(model, data, q, k, pin.WORLD) for k in range(model.nframes)]", "liMi oMi", "iMf",
        jacobian=True,
    ),
    Row("[pin.computeFrameJacobian(model, data, q, k) for k in range(model.nframes)]", "liMi", "iMf", jacobian=True),
    Row(
        "pin.computeJointJacobians(model, data, q); "
        "[pin.getFrameJacobian(model, data, k, r) for k in frames for r in both]",
        jacobian=True,
    ),
    Row(
        "pin.computeJointJacobians(model, data, q); "
        "[pin.getFrameJacobian(model, data, k, placement, r) for k in joints for r in both]",
        jacobian=True,
    ),
    Row("pin.computeJointJacobiansTimeVariation(model, data, q, v)", "J dJ oMi liMi ov v", jacobian=True),
    *(
        Row(
            "pin.computeJointJacobiansTimeVariation(model, data, q, v); "
            f"[pin.{name}(model, data, k, r) for k in {which} for r in both]",
            jacobian=True,
        )
        for name, which in (("getJointJacobianTimeVariation", "joints"), ("getFrameJacobianTimeVariation", "frames"))
    ),
    Row(
        "[pin.frameJacobianTimeVariation(model, data, q, v, k, r) for k in frames for r in both]",
        "J dJ oMi liMi oMf ov v", jacobian=True,
    ),
    # --- the robot as a whole
    Row("pin.centerOfMass(model, data, q)", MASSES, mass=True),
    Row("pin.centerOfMass(model, data, q, v)", f"{MASSES} v vcom", mass=True),
    Row("pin.centerOfMass(model, data, q, v, a)", f"{MASSES} v vcom a acom", mass=True),
    Row("pin.centerOfMass(model, data, q, v, a, False)", "oMi liMi v a", "com vcom acom mass", mass=True),
    Row("pin.forwardKinematics(model, data, q, v, a); pin.centerOfMass(model, data)", "com vcom acom mass", mass=True),
    Row(
        "pin.forwardKinematics(model, data, q, v); pin.centerOfMass(model, data, pin.VELOCITY)", "com vcom mass",
        mass=True,
    ),
    Row("pin.forwardKinematics(model, data, q); pin.centerOfMass(model, data, 0)", "mass", "com", mass=True),
    Row("pin.jacobianCenterOfMass(model, data, q)", "Jcom J com mass oMi liMi", mass=True),
    Row("pin.jacobianCenterOfMass(model, data, q, False)", "Jcom J oMi liMi", "com mass", mass=True),
    # com and J hold intermediate results in Pinocchio
    Row(
        "[pin.jacobianSubtreeCenterOfMass(model, data, q, k) for k in heavy]", "oMi liMi", "com mass J", mass=True,
        jacobian=True,
    ),
    Row(
        "pin.jacobianCenterOfMass(model, data, q); [pin.getJacobianSubtreeCenterOfMass(model, data, k) for k in heavy]",
        mass=True, jacobian=True,
    ),
    Row("pin.computeTotalMass(model)"),
    Row("pin.computeTotalMass(model, data)", "mass"),
    Row("pin.computeSubtreeMasses(model, data)", "mass"),
    Row("pin.ccrba(model, data, q, v)", f"{MAP} Ig hg", "com", mass=True),
    Row("pin.dccrba(model, data, q, v)", f"{MAP} Ig hg dAg dJ ov v", "com vcom", mass=True),
    Row("pin.computeCentroidalMap(model, data, q)", MAP, "com", mass=True),
    # Pinocchio 4.1 leaves out the motion of the centre of mass: its dAg is no derivative of Ag, see test_data
    Row("(pin.computeCentroidalMapTimeVariation(model, data, q, v), 0)[1]", f"{MAP} dJ ov v", "com dAg", mass=True),
    # com and vcom of subtrees are intermediate results in Pinocchio
    Row("pin.computeCentroidalMomentum(model, data, q, v)", "hg h mass oMi liMi v", "com vcom", mass=True),
    Row("pin.forwardKinematics(model, data, q, v); pin.computeCentroidalMomentum(model, data)", "hg", mass=True),
    Row(
        "pin.computeCentroidalMomentumTimeVariation(model, data, q, v, a)", "dhg hg h f mass oMi liMi v a", "com vcom",
        mass=True,
    ),
    Row(
        "pin.forwardKinematics(model, data, q, v, a); pin.computeCentroidalMomentumTimeVariation(model, data)",
        "dhg hg", mass=True,
    ),
    Row(
        "pin.rnea(model, data, q, v, a); pin.forwardKinematics(model, data, q); "
        "[pin.computeSupportedInertiaByFrame(model, data, k, w).matrix() for k in carried for w in (True, False)]"
    ),
    # without forwardKinematics Pinocchio reads a and oMi of the call before
    Row(
        "pin.rnea(model, data, q, v, a); pin.forwardKinematics(model, data, q, v, a); "
        "[pin.computeSupportedForceByFrame(model, data, k) for k in carried]"
    ),
    # --- regressors
    Row("pin.computeJointTorqueRegressor(model, data, q, v, a)", "jointTorqueRegressor v a_gf liMi"),
    Row("pin.computeStaticRegressor(model, data, q)", "staticRegressor oMi liMi", mass=True),
    Row("pin.computeKineticEnergyRegressor(model, data, q, v)", "kineticEnergyRegressor v oMi liMi"),
    Row("pin.computePotentialEnergyRegressor(model, data, q)", "potentialEnergyRegressor oMi liMi"),
    Row("pin.rnea(model, data, q, v, a); [pin.jointBodyRegressor(model, data, k) for k in joints]"),
    # of frames in the world Pinocchio reads a_gf[0], which rnea does not write
    Row(
        "pin.rnea(model, data, q, v, a); "
        "[pin.frameBodyRegressor(model, data, k) for k in frames if model.frames[k].parentJoint]"
    ),
    # --- contacts; of M Pinocchio fills the upper triangle, of com and mass the robot's entry
    Row(
        "pin.forwardDynamics(model, data, q, v, tau, J, gamma, 1e-6)",
        "Ag D Ig J Jcom U a a_gf com dAg dJ ddq dhg f g h hg kinetic_energy lambda_c liMi mass mechanical_energy nle "
        "oMi oYcrb ov potential_energy v vcom",
        "M", solves=True, mass=True,
    ),
    Row(
        "pin.computeAllTerms(model, data, q, v); pin.forwardDynamics(model, data, tau, J, gamma, 1e-6)",
        "D U ddq lambda_c", solves=True, mass=True,
    ),
    Row(
        "pin.impulseDynamics(model, data, q, v, J, 0.5, 1e-6)", f"{MAP} D U dq_after impulse_c", "M com mass",
        solves=True, mass=True,
    ),
    Row(
        "pin.computeKKTContactDynamicMatrixInverse(model, data, q, J, 1e-3)", f"{MAP} D U", "M com mass",
        solves=True, mass=True,
    ),
    Row("pin.crba(model, data, q); pin.cholesky.decompose(model, data)", "D U", solves=True),
    *(
        Row(f"pin.crba(model, data, q); pin.cholesky.decompose(model, data); pin.cholesky.{text}", fields, solves=True)
        for text, fields in (("solve(model, data, tau)", ""), ("computeMinv(model, data)", "Minv"))
    ),
    # --- derivatives; forces, momenta and inertias of subtrees are intermediate results in Pinocchio
    Row("pin.computeRNEADerivatives(model, data, q, v, a)", f"{TORQUE} {SWEPT}", f"oh {SCRATCHED}", bound=DERIVED),
    Row(
        "pin.computeRNEADerivatives(model, data, q, v, a, fext)", f"{TORQUE} {SWEPT}", f"oh {SCRATCHED}", bound=DERIVED
    ),
    Row(
        "pin.computeABADerivatives(model, data, q, v, tau)", f"ddq ddq_dq ddq_dv Minv {SLOPES} J dJ oMi liMi ov",
        f"oa oa_gf of oh oYcrb {SCRATCHED}", solves=True,
    ),
    Row(
        "pin.computeABADerivatives(model, data, q, v, tau, fext)", f"ddq ddq_dq ddq_dv Minv {SLOPES} J dJ oMi liMi ov",
        f"oa oa_gf of oh oYcrb {SCRATCHED}", solves=True,
    ),
    Row(
        "pin.aba(model, data, q, v, tau, pin.Convention.WORLD); pin.computeABADerivatives(model, data)",
        "ddq_dq ddq_dv Minv", solves=True,
    ),
    Row("pin.computeGeneralizedGravityDerivatives(model, data, q)", "g J oMi liMi", f"{WEIGHED}", bound=DERIVED),
    Row("pin.computeStaticTorqueDerivatives(model, data, q, fext)", "tau J oMi liMi", f"{WEIGHED}", bound=DERIVED),
    Row("pin.computeForwardKinematicsDerivatives(model, data, q, v)", "J dJ oMi liMi ov v"),
    Row("pin.computeForwardKinematicsDerivatives(model, data, q, v, a)", "J dJ oMi liMi ov v oa a"),
    *(
        Row(
            f"{PREPARED}; [pin.{name}(model, data, k, {more}r) for k in {which} for r in both]", bound=DERIVED,
            jacobian=True,
        )
        for name, which, more in (
            ("getJointVelocityDerivatives", "joints", ""),
            ("getJointAccelerationDerivatives", "joints", ""),
            ("getFrameVelocityDerivatives", "frames", ""),
            ("getFrameAccelerationDerivatives", "frames", ""),
            ("getFrameVelocityDerivatives", "joints", "placement, "),
            ("getFrameAccelerationDerivatives", "joints", "placement, "),
        )
    ),
    *(
        Row(
            f"{PREPARED}; [pin.{name}(model, data, k, placement, r) for k in joints for r in both[::2]]",
            bound=DERIVED, jacobian=True,
        )
        for name in ("getPointVelocityDerivatives", "getPointClassicAccelerationDerivatives")
    ),
    Row(
        "pin.computeCentroidalDynamicsDerivatives(model, data, q, v, a)", "Ag Ig dhg hg J dJ oMi liMi ov v oa a tau",
        f"com mass of oh oYcrb dHdq {SCRATCHED}", mass=True, bound=DERIVED,
    ),
    Row(
        "pin.computeRNEADerivatives(model, data, q, v, a); pin.getCentroidalDynamicsDerivatives(model, data)", "Ag hg",
        mass=True, bound=DERIVED,
    ),
    Row(
        "pin.centerOfMass(model, data, q, v); pin.getCenterOfMassVelocityDerivatives(model, data)", mass=True,
        bound=DERIVED,
    ),
    # --- configurations
    Row("pin.neutral(model)"),
    Row("pin.integrate(model, q, d)"),
    Row("pin.difference(model, q, q1)"),
    Row("pin.interpolate(model, q, q1, t)"),
    Row("pin.distance(model, q, q1)"),
    Row("pin.squaredDistance(model, q, q1)"),
    Row("pin.normalize(model, raw)"),
    Row("pin.isNormalized(model, q)"),
    Row("pin.isNormalized(model, q1, 1e-6)"),
    Row("[pin.isSameConfiguration(model, q, x, 1e-8) for x in (q, q1)]"),
    Row("pin.dIntegrate(model, q, d)"),
    Row("pin.dIntegrate(model, q, d, pin.ARG0), pin.dIntegrate(model, q, d, pin.ARG1)"),
    Row("pin.dDifference(model, q, q1)", bound=DERIVED),
    Row("pin.dDifference(model, q, q1, pin.ARG0), pin.dDifference(model, q, q1, pin.ARG1)", bound=DERIVED),
    Row("[pin.dIntegrateTransport(model, q, d, columns, x) for x in (pin.ARG0, pin.ARG1)]"),
    Row("pin.tangentMap(model, q)"),
    Row("pin.compactTangentMap(model, q)"),
    Row("pin.tangentMapProduct(model, q, columns)"),
    Row("pin.tangentMapTransposeProduct(model, q, pin.tangentMapProduct(model, q, columns))"),
)  # fmt: skip
