"""The library under the names and conventions of Pinocchio: ``import spatialdyn.compat.pinocchio as pin``.

Vectors are [linear; angular]; a free flyer has q = [x y z, quaternion x y z w] and v in its own axes; continuous
joints have q = [cos, sin]; external forces are given in the joints' own frames. What differs from Pinocchio on purpose
is listed in ``differences``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from . import cholesky, explog, liegroups, linalg, robot_wrapper, rpy, shortcuts, utils
from .builders import buildModelFromUrdf, buildModelFromXML
from .centroidal import (
    ccrba,
    centerOfMass,
    computeCentroidalMap,
    computeCentroidalMapTimeVariation,
    computeCentroidalMomentum,
    computeCentroidalMomentumTimeVariation,
    computeSubtreeMasses,
    computeSupportedForceByFrame,
    computeSupportedInertiaByFrame,
    computeTotalMass,
    dccrba,
    getJacobianSubtreeCenterOfMass,
    jacobianCenterOfMass,
    jacobianSubtreeCenterOfMass,
)
from .chance import seed
from .configuration import (
    dDifference,
    difference,
    dIntegrate,
    dIntegrateTransport,
    distance,
    integrate,
    interpolate,
    isNormalized,
    isSameConfiguration,
    neutral,
    normalize,
    randomConfiguration,
    squaredDistance,
)
from .contact import (
    computeKKTContactDynamicMatrixInverse,
    forwardDynamics,
    getKKTContactDynamicMatrixInverse,
    impulseDynamics,
)
from .containers import (
    StdMap_String_VectorXd,
    StdVec_Bool,
    StdVec_BooleanVector,
    StdVec_Double,
    StdVec_EigenIndex,
    StdVec_EigenIndexVector,
    StdVec_Force,
    StdVec_Frame,
    StdVec_Index,
    StdVec_IndexVector,
    StdVec_Inertia,
    StdVec_int,
    StdVec_Matrix6,
    StdVec_Matrix6x,
    StdVec_MatrixXs,
    StdVec_Motion,
    StdVec_Scalar,
    StdVec_SE3,
    StdVec_StdString,
    StdVec_StdVec_Int,
    StdVec_Symmetric3,
    StdVec_Vec3s,
    StdVec_Vector3,
)
from .coverage import coverage, missing
from .data import Data
from .derivatives import (
    computeABADerivatives,
    computeCentroidalDynamicsDerivatives,
    computeForwardKinematicsDerivatives,
    computeGeneralizedGravityDerivatives,
    computeRNEADerivatives,
    computeStaticTorqueDerivatives,
    getCenterOfMassVelocityDerivatives,
    getCentroidalDynamicsDerivatives,
    getFrameAccelerationDerivatives,
    getFrameVelocityDerivatives,
    getJointAccelerationDerivatives,
    getJointVelocityDerivatives,
    getPointClassicAccelerationDerivatives,
    getPointVelocityDerivatives,
)
from .differences import differences
from .dynamics import (
    aba,
    computeAllTerms,
    computeCoriolisMatrix,
    computeGeneralizedGravity,
    computeKineticEnergy,
    computeMechanicalEnergy,
    computeMinverse,
    computePotentialEnergy,
    computeStaticTorque,
    crba,
    getCoriolisMatrix,
    nle,
    nonLinearEffects,
    rnea,
)
from .explog import (
    Hlog3,
    Jexp3,
    Jexp6,
    Jlog3,
    Jlog6,
    SE3ToXYZQUAT,
    SE3ToXYZQUATtuple,
    XYZQUATToSE3,
    classicAcceleration,
    exp,
    exp3,
    exp3_quat,
    exp6,
    exp6_quat,
    log,
    log3,
    log6,
    log6_quat,
)
from .frame import (
    ACCELERATION,
    ARG0,
    ARG1,
    ARG2,
    ARG3,
    ARG4,
    BODY,
    FIXED_JOINT,
    JOINT,
    LOCAL,
    LOCAL_WORLD_ALIGNED,
    OP_FRAME,
    POSITION,
    SENSOR,
    VELOCITY,
    WORLD,
    ArgumentPosition,
    Convention,
    Frame,
    FrameType,
    KinematicLevel,
    ReferenceFrame,
)
from .geometry import COLLISION, VISUAL, GeometryModel, GeometryType, buildModelsFromUrdf, createDatas
from .inertia import Inertia
from .joint import JointModel
from .joint_data import JointData
from .joint_mimic import JointModelMimic
from .joints import (
    JointModelPrismaticUnaligned,
    JointModelPX,
    JointModelPY,
    JointModelPZ,
    JointModelRevoluteUnaligned,
    JointModelRevoluteUnboundedUnaligned,
    JointModelRUBX,
    JointModelRUBY,
    JointModelRUBZ,
    JointModelRX,
    JointModelRY,
    JointModelRZ,
)
from .joints_many import (
    JointModelComposite,
    JointModelFreeFlyer,
    JointModelPlanar,
    JointModelSpherical,
    JointModelSphericalZYX,
    JointModelTranslation,
    JointModelUniversal,
)
from .kinematics import (
    computeFrameJacobian,
    computeJointJacobian,
    computeJointJacobians,
    computeJointJacobiansTimeVariation,
    forwardKinematics,
    frameJacobianTimeVariation,
    framesForwardKinematics,
    getAcceleration,
    getClassicalAcceleration,
    getFrameAcceleration,
    getFrameClassicalAcceleration,
    getFrameJacobian,
    getFrameJacobianTimeVariation,
    getFrameVelocity,
    getJointJacobian,
    getJointJacobianTimeVariation,
    getVelocity,
    updateFramePlacement,
    updateFramePlacements,
    updateGlobalPlacements,
)
from .liegroups import LieGroup, findCommonAncestor, getTangentToConfigurationSparsitySegment, lieGroup
from .linalg import isOrthonormal, orthogonalization, orthonormalization
from .model import Model
from .motion import Force, Motion
from .parallel import ModelPool, abaInParallel, omp_get_max_threads, rneaInParallel
from .pseudo import LogCholeskyParameters, PseudoInertia
from .rebuilt import appendModel, buildReducedModel, transformJointIntoMimic
from .regressors import (
    bodyRegressor,
    computeJointTorqueRegressor,
    computeKineticEnergyRegressor,
    computePotentialEnergyRegressor,
    computeStaticRegressor,
    frameBodyRegressor,
    jointBodyRegressor,
)
from .robot_wrapper import RobotWrapper
from .rotations import AngleAxis, Quaternion, XAxis, YAxis, ZAxis, skew, skewSquare, unSkew
from .samples import buildSampleModelHumanoid, buildSampleModelHumanoidRandom, buildSampleModelManipulator
from .se3 import SE3
from .srdf import loadReferenceConfigurations, loadReferenceConfigurationsFromXML, loadRotorParameters
from .symmetric import Symmetric3
from .tangent import compactTangentMap, tangentMap, tangentMapProduct, tangentMapTransposeProduct
from .versions import (
    PINOCCHIO_MAJOR_VERSION,
    PINOCCHIO_MINOR_VERSION,
    PINOCCHIO_PATCH_VERSION,
    WITH_COLLISION,
    WITH_CPPAD,
    WITH_HPP_FCL,
    WITH_HPP_FCL_BINDINGS,
    WITH_OPENMP,
    WITH_SDFORMAT,
    WITH_URDFDOM,
    ScalarType,
    __version__,
    checkVersionAtLeast,
    printVersion,
)

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Say what to use instead of a name that Pinocchio has and this face has not."""
        return missing(name)
