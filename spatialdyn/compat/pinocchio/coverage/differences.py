"""Table of the differences from Pinocchio on purpose."""

from __future__ import annotations

import re
from typing import NamedTuple


class Difference(NamedTuple):
    """A subject, what Pinocchio does, what this package does, and whether it does so in strict mode alone.

    Strict mode is ``strict(True)`` or the environment variable SPATIALDYN_STRICT=1.
    """

    what: str
    pinocchio: str
    here: str
    switched: bool = False


# subject | Pinocchio | here, and "| strict" where that holds in strict mode alone; indented lines continue a row
_TABLE = """
getFrameId, getBodyId, getJointId of a name that is not there | the number of frames or joints | an error that names
    similar ones | strict
aba, computeMinverse of a joint with zero articulated inertia | NaN or infinite entries | InertiaError naming the
    joint
randomConfiguration where a limit is not finite | infinite or NaN coordinates | coordinates from a range of width 2
lowerVelocityLimit, and lowerEffortLimit of the sample models | the upper limit | the upper limit's negative
models whose joints are not depth first | wrong mass matrices, silently | ModelError naming the joint at the first
    call
crba where joints of several freedoms stand between a mimic joint and its leader | a mass matrix that contradicts its
    rnea | the mass matrix of rnea
computeCollisions, computeDistances, computeCollision, computeDistance without the package coal | none is built
    without it | OutOfScopeError, a NotImplementedError that names it
computeCollisions, computeDistances of a GeometryModel without objects | no collision | ModelError; without pairs a
    warning
buildGeomFromUrdf, buildModelsFromUrdf of a URDF whose meshes are not found | ValueError | the folders above the URDF
    are searched too; an error when the shape is needed
GeometryData: collision_functors, contactPatchRequests and their kin, radius | members | OutOfScopeError, an
    AttributeError
RigidConstraintModel, RigidConstraintData: setCompliance, retrieveCompliance; lambdas_joint1,
    extended_motion_propagators_joint1 and _joint2 | one contact's part of a solver, its scratch | OutOfScopeError, an
    AttributeError
data.constraint_chol, data.contact_chol | the factors of the last call, written in place | new factors after a call
RigidConstraintData: contact_acceleration and its kin, contact1_acceleration_drift, contact2_acceleration_drift |
    written by constraintDynamics | zero
constraintDynamics, impulseDynamics of contacts that depend on each other with mu = 0, the default | nan |
    ConstraintError naming the rank
constraintDynamics before initConstraintDynamics | an error or nan | its answer: nothing has to be prepared
getConstraintsJacobian, getConstraintJacobian, and compute of data.constraint_chol, before the contacts' data were
    computed | their last placements, or zeros | J at the q of data.oMi
computeDelassusMatrix in LOCAL_WORLD_ALIGNED, or between two joints | in the axes of frame 1, the second joint left
    out | J M⁻¹ Jᵀ with the J of getConstraintsJacobian
impulseDynamics of contacts between two joints | J v after the impact is another | J v after the impact is -r_coeff J
    v before it
computeConstraintDynamicsDerivatives of a CONTACT_6D in LOCAL_WORLD_ALIGNED with a gain Kp | off by some 10 % | the
    derivative of its constraintDynamics
visualize.BaseVisualizer, visualize.GepettoVisualizer, visualize.RVizVisualizer, visualize.Panda3dVisualizer | a
    picture | nothing, and one warning
visualize, visualize.MeshcatVisualizer, visualize.ViserVisualizer, RobotWrapper.initViewer,
    RobotWrapper.loadViewerModel, RobotWrapper.display, RobotWrapper.play | a picture in MeshCat or viser | a picture
    in viser, of the file's geometry or else of the inertias; without viser nothing, and one warning
joint indices that are not there (appendBodyToJoint, addFrame) | memory is overwritten | ModelError naming the index
computeCentroidalMapTimeVariation | no derivative of Ag: the motion of the centre of mass is left out | the derivative
    of Ag
dJ, dAg, C of models with composite or universal joints or ZYX angles, dJ and C with mimic joints | wrong: the motion
    of their axes in the body is left out | derivatives of J and Ag, and a C with dM/dt = C + Cᵀ
computeKineticEnergy with armature on a JointModelRevoluteUnaligned, JointModelHelicalUnaligned | the rotor is left
    out | the rotor counts
JointModelHX, JointModelHY, JointModelHZ, JointModelHelicalUnaligned without a pitch | any | 0
JointModelHX, JointModelHY, JointModelHZ that differ in pitch | equal | not equal
hasConfigurationLimit of helical joints | [True, True], with nq = 1 | [True]
models with mimic joints: aba, computeMinverse, computeAllTerms, energies, dccrba | an error | the result
computeJointJacobians, data.J with mimic joints | a column for each mimic joint too | (6, nv)
data: a after aba, com, vcom, acom, mass, J, Ag, h, f where a call leaves intermediate results | intermediate results
    | the quantity of that name, or the value before the call
data.dhg, data.f of a second computeAllTerms with one data | added to the first call's | as after the first call
centres of mass of joints that carry no mass | NaN | the joint's origin, at rest
data fields that are scratch: Yaba, Fcrb, U, D, joints ... | present | AttributeError saying so
getFrameJacobian, getJointJacobian before computeJointJacobians | zeros | an error that names the call to make first
getFrameJacobian after forwardKinematics at another q | a mixture of both | the Jacobian at the q of data.J
indices of joints and frames that are not there, in getters | a crash or memory | RangeError
copies of a Data, pickled ones too | its scratch goes with it | its fields do: what is computed from an earlier call's
    arguments, such as getFrameJacobian, centerOfMass(model, data) or computeMinverse(model, data), says that the call
    has to come first
data.oMf after getFrameJacobian, getFrameJacobianTimeVariation, computeFrameKinematicRegressor | placed by them | as
    before: updateFramePlacements or framesForwardKinematics place it
calls without q after an edit of a joint's placement | from the oMi and liMi of before | from the q of before, on the
    edited model
computeJointKinematicRegressor, computeFrameKinematicRegressor, computeStaticRegressor, computePotentialEnergyRegressor,
    jointBodyRegressor, frameBodyRegressor of models with mimic joints | an error | the result
constraintDynamics, forwardDynamics, impulseDynamics, computeKKTContactDynamicMatrixInverse, cholesky.decompose,
    jacobianSubtreeCenterOfMass, getJacobianSubtreeCenterOfMass of models with mimic joints | an error | the result,
    for the independent velocities
quaternions and (cos, sin) pairs off their unit norm by more than 1e-6 | accepted | ConfigurationError | strict
configurations off their unit norm, not strict: difference, interpolate, distance where Pinocchio has NaN, as to the
    limits of a free flyer | NaN or infinite entries | finite: coordinates of joints with several are clipped to 1e30
configurations off their unit norm, not strict: dDifference, what Pinocchio computes in the world's axes or with
    rotated inertias: crba, computeMinverse, computeCoriolisMatrix, aba in WORLD, computeAllTerms, ccrba, dccrba,
    computeJointTorqueRegressor, and derivatives | numbers that contradict its rnea and aba, for the matrix of such a
    q is not a rotation | results of the same matrix by the formulas here, or InertiaError
configurations off their unit norm, not strict: getFrameJacobian, getJointJacobian, and computeFrameJacobian in WORLD
    and LOCAL_WORLD_ALIGNED | columns of data.J, in LOCAL taken back by inverses of rotations, which such matrices are
    not | columns of the LOCAL computeFrameJacobian, in WORLD and LOCAL_WORLD_ALIGNED as oMf moves and turns them
configurations off their unit norm, not strict: computeJointJacobiansTimeVariation, getFrameJacobianTimeVariation,
    getJointJacobianTimeVariation, computeCentroidalMap, and data.vcom, data.acom of centerOfMass | sums of motions
    and inertias turned into the world's axes by matrices that are no rotations | sums by this package's formulas,
    with the same matrices
arrays of the other byte order | bytes are read unswapped | read correctly
aba with too few external forces | memory after them is read | ShapeError
compactTangentMap of a joint of more than six velocities | memory is overwritten | ShapeError
frame Jacobians of a model without freedoms | a crash | an array (6, 0)
Jacobians, their derivatives and centroidal maps of models with one freedom: nv = 1 | one-dimensional, (6,) or (3,) |
    (6, 1), (3, 1), as for any nv
axes of unaligned joints that are not unit vectors | wrong joints | normalised; an error if zero
gravity with an angular part | an angular acceleration of the world | ModelError
assigning an array of the wrong size to a limit or an armature | accepted | ShapeError naming the attribute
inertias that no body can have in a URDF | accepted | accepted, and named in a warning
a planar joint of a URDF whose axis is not z | its axis is ignored | ignored too, with a warning
a revolute joint of a URDF without limits | an error | an unlimited joint
elements of xacro that are left in a URDF | left out, silently | left out, with a warning; spatialdyn.load_urdf refuses
    them
broken or half-read URDF | the part that urdfdom reads | UrdfError naming file, line, element and attribute
negative effort or velocity limits of a URDF | accepted | no limit
appendModel: gravity, name and armature | defaults | gravity and name of A, armature of both
buildReducedModel: parent frame of a locked joint's frame | the frame itself | the parent frame
forwardDynamics, impulseDynamics with constraints that depend on each other, undamped | rounding errors |
    ConstraintError naming the rank
forwardDynamics, impulseDynamics with a damping below 0 or a restitution not from 0 to 1 | accepted | ConstraintError
data.M after forwardDynamics, impulseDynamics, computeKKTContactDynamicMatrixInverse | its lower triangle is not
    written | both triangles are filled
cholesky.decompose before crba; cholesky.solve, cholesky.computeMinv before cholesky.decompose | zeros or NaN |
    InertiaError
computeJointTorqueRegressor, computeKineticEnergyRegressor of models with mimic joints | an error | columns for each
    joint, rows for the independent velocities
jointBodyRegressor, frameBodyRegressor of an index that is not there | memory is read | ModelError naming the index
appendModel where the name of a frame's parent is that of several frames | an error | the result: frames are
    identified by index
computeJointJacobian, computeFrameJacobian: joints that do not carry the given one | liMi, oMi are not written | liMi,
    oMi are written at q, unless the field was read before
framesForwardKinematics, updateFramePlacements with a data made before a frame was added | memory is overwritten |
    ShapeError
writing data fields that a later call reads: J, dJ before getFrameJacobian, v before computeKineticEnergy | the
    written values count | the last call's inputs count; written oMi, liMi, v, a count in getters of frames and
    motions
loadRotorParameters called twice | adds the rotors to the armature twice | once
saveToText, saveToXML, saveToBinary | Boost archives | files of this package, which Pinocchio does not read
attributes of a kind, such as axis, of model.joints[i] | by extract() | of the JointModel itself too
model.joints[k] = ... | replaces a joint without its indices | ModelError that says what to do
matrices of results, of Data and of SE3, such as data.M, data.J and rotation | in Fortran order | in C order, with the
    same entries
Jexp6, Jlog6, log6 near the identity, log3, log6 near half a turn | up to 1e-7 off at angles of 1e-3, and 4e-14 off
    near half a turn | exact to rounding at every angle
Hlog3 at the identity | NaN | half the cross product, its limit
rpy.matrixToRpy of a roll of half a turn with entries of -0, or with a pitch of a quarter turn | one of the triples
    that are equal to rounding | another of them
items of lists of Data: com[0, 1], mass[True], com[0] = [1, 2, 3], a slice | a list, a number, a TypeError, a StdVec |
    a TypeError, an array, the vector, a list
items of a slice of a list of a Model or Data, as model.inertias[1:3] | copies | those of the list: an edit counts
computeSupportedForceByFrame of a frame on the universe, as frame 0 | of bodies on the universe alone | with
    what the joints on the universe transmit, as of any other frame
computeSupportedInertiaByFrame with_subtree, of a frame on the universe | the body of joint 1 is left out | it counts
isinstance(JointModelFreeFlyer(), JointModel) | False | True
an SE3 where the package coal expects its Transform3s, as in coal.collide | converted | a TypeError of coal's: give
    coal.Transform3s(M.rotation, M.translation)
SE3(), Motion(), Force(), Inertia(), Symmetric3(), Quaternion(), AngleAxis() | uninitialized memory | identity or zero
what computeRNEADerivatives, computeABADerivatives return | views of data.dtau_dq and its kin, which the next call
    overwrites | new arrays
an Inertia less a heavier one | a centre of mass divided by 2e-16 | the body that, added again, gives the first
Inertia.FromDynamicParameters, Inertia.inverse without mass | NaN or infinite | InertiaError
Inertia.inertia set to a matrix with a negative eigenvalue | accepted | ValueRuntimeError, a RuntimeError | strict
np.array(x) of a Motion or Force x | read-only, as np.asarray(x) | a writable copy
Quaternion.FromTwoVectors of a null vector | no rotation | an error
Symmetric3.inverse, Symmetric3.rhsMult | write to a copy | write to the array given
Symmetric3.vxs, Symmetric3.svx, isOrthonormal, orthonormalization | refuse every array | work
isSameConfiguration | lengths and angles agree to prec of their size, quaternions by coefficients: 0 and 1e-14 never
    agree | no entry of the difference exceeds prec
pickling Quaternion, AngleAxis, Symmetric3 | refused | works
operations of a LieGroup on arrays of a wrong size | memory is overwritten | ShapeError
derivatives of models with composite or universal joints or ZYX angles | wrong by the rotation of their axes | correct
getJointAccelerationDerivatives, getFrameAccelerationDerivatives by q in WORLD, of bodies on spherical and planar
    joints that are not on the universe | not the derivatives of its own accelerations | the derivatives of the
    accelerations
derivatives of frames, centroidal dynamics and centres of mass without the call that has to come before | zeros, or
    earlier results | an error that names the call
utils.mprint | prints | NotImplementedError: the library never prints
RobotWrapper.com() before forwardKinematics | the centre of mass with every joint placed at the origin | an error that
    names the call to make first
computeRNEADerivatives, computeABADerivatives, computeForwardKinematicsDerivatives,
    computeGeneralizedGravityDerivatives, computeStaticTorqueDerivatives, getFrameVelocityDerivatives,
    computeCentroidalDynamicsDerivatives of models with mimic joints | an error | derivatives by the independent
    coordinates and velocities
computeMinverse(model, data), computeABADerivatives(model, data) after aba in its LOCAL convention | wrong numbers |
    results at the inputs of aba
computeMinverse(model, data), computeABADerivatives(model, data) without an aba before | zeros or wrong numbers | an
    error that says so
buildReducedModel of joint 0 or of one that does not exist | ignored, silently | ModelError naming the index
the first call after an edit of a model's joints | costs as any call | assembles the library's model again, in some
    milliseconds; an edit of numbers alone costs microseconds
references to Model.armature after addJoint, or to a frame or joint after its replacement | freed memory, or the new
    object | the old object, no longer the model's; read it from the model again
buildModelFromMJCF: gravity, the place of a joint in its body (pos), bodies beside the first of the world, those
    without a name, the place and sites of a fixed first body, limits of a free joint's position, damping and
    frictionloss of a ball | left out, or 1.01 | MuJoCo's own, of the model that it compiles
buildGeomFromMJCF, buildModelsFromMJCF: meshes, colours without rgba, the turn of round geoms about their axis | the
    mesh file, white, its own | MuJoCo's triangles, its grey, its own
buildModelFromMJCF, buildModelsFromMJCF of what MuJoCo refuses, as a connect without an anchor | read in part |
    SpatialDynError with MuJoCo's message
buildGeomFromMJCF, buildModelsFromMJCF of a height field or an SDF | an error or nothing | SpatialDynError naming it
buildSampleGeometryModelHumanoid: meshPath of chest2_object, a capsule | SPHERE | CAPSULE
Random, setRandom, sample models | Eigen's random numbers | NumPy's; pin.seed starts them
"""


def _difference(row: str) -> Difference:
    what, pinocchio, here, *switched = " ".join(row.split()).split(" | ")
    return Difference(what, pinocchio, here, bool(switched))


DIFFERENCES = tuple(_difference(row) for row in re.split(r"\n(?! )", _TABLE.strip()))


def differences() -> tuple[Difference, ...]:
    """The differences from Pinocchio on purpose."""
    return DIFFERENCES
