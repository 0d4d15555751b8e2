"""Where this face differs from Pinocchio on purpose.

Those with ``switched`` are Pinocchio's way unless ``strict(True)`` was called or the environment variable
SPATIALDYN_STRICT is 1; the others hold always.
"""

from __future__ import annotations

from typing import NamedTuple


class Difference(NamedTuple):
    """What is concerned, what Pinocchio does, what this face does, and whether it does so in strict mode only."""

    what: str
    pinocchio: str
    here: str
    switched: bool = False


DIFFERENCES = (
    Difference(
        "getFrameId, getBodyId, getJointId of a name that is not there",
        "the number of frames or joints",
        "an error that names what is like it",
        True,
    ),
    Difference(
        "aba, computeMinverse with a joint that moves no inertia",
        "NaN or infinite entries",
        "InertiaError naming the joint",
    ),
    Difference(
        "randomConfiguration where a limit is not finite",
        "infinite or NaN coordinates",
        "coordinates from a range of width 2",
    ),
    Difference(
        "lowerVelocityLimit, and lowerEffortLimit of the sample models", "the upper limit", "the upper limit's negative"
    ),
    Difference(
        "models whose joints are not depth first",
        "wrong mass matrices, without a word",
        "ModelError naming the joint at the first call",
    ),
    Difference(
        "crba where joints of several freedoms stand between a mimic joint and its leader",
        "not the mass matrix that its rnea has",
        "that of rnea",
    ),
    Difference(
        "GeometryModel, GeometryData, GeometryObject, CollisionPair: what takes a collision library",
        "results of coal",
        "OutOfScopeError, a NotImplementedError and AttributeError",
    ),
    Difference(
        "RigidConstraintModel, RigidConstraintData: what takes a constraint solver",
        "Jacobians, errors, forces",
        "OutOfScopeError, a NotImplementedError",
    ),
    Difference(
        "visualize, visualize.BaseVisualizer, visualize.MeshcatVisualizer, visualize.GepettoVisualizer, "
        "visualize.ViserVisualizer, visualize.RVizVisualizer, visualize.Panda3dVisualizer, RobotWrapper.initViewer, "
        "RobotWrapper.loadViewerModel, RobotWrapper.display, RobotWrapper.play",
        "a picture",
        "nothing, and one warning",
    ),
    Difference(
        "joint indices that are not there (appendBodyToJoint, addFrame)",
        "memory is overwritten",
        "ModelError naming the index",
    ),
    Difference(
        "computeCentroidalMapTimeVariation",
        "no derivative of Ag: the motion of the centre of mass is left out",
        "it is",
    ),
    Difference(
        "dJ, dAg, C of models with composite or universal joints or ZYX angles, dJ and C with mimic joints",
        "wrong: the motion of their axes in the body is left out",
        "derivatives of J and Ag, and a C with dM/dt = C + Cᵀ",
    ),
    Difference(
        "computeKineticEnergy with armature on a JointModelRevoluteUnaligned", "that rotor is left out", "it counts"
    ),
    Difference(
        "models with mimic joints: aba, computeMinverse, computeAllTerms, energies, dccrba", "an error", "the answer"
    ),
    Difference("computeJointJacobians, data.J with mimic joints", "a column for each follower as well", "(6, nv)"),
    Difference(
        "data: a after aba, com, vcom, acom, mass, J, Ag, h, f where a call leaves intermediate results",
        "those",
        "what the name says, or as before",
    ),
    Difference(
        "data.dhg, data.f of a second computeAllTerms with one data", "added to what was there", "as after the first"
    ),
    Difference("centres of mass of joints that carry no mass", "NaN", "the joint's origin, at rest"),
    Difference("data fields that are scratch: Yaba, Fcrb, U, D, joints ...", "there", "AttributeError saying so"),
    Difference(
        "getFrameJacobian, getJointJacobian before computeJointJacobians", "zeros", "an error that names what to call"
    ),
    Difference(
        "getFrameJacobian after forwardKinematics at another q", "a mixture of both", "the Jacobian where data.J is"
    ),
    Difference("indices of joints and frames that are not there, in getters", "a crash or memory", "RangeError"),
    Difference(
        "quaternions and (cos, sin) pairs off their unit norm by more than 1e-6", "taken", "ConfigurationError", True
    ),
    Difference(
        "configurations off their unit norm, not strict: difference, interpolate, distance where Pinocchio has NaN, as "
        "to the limits of a free flyer",
        "NaN or infinite entries",
        "finite: of joints with several coordinates those beyond 1e30 count as that",
    ),
    Difference(
        "configurations off their unit norm, not strict: dDifference, what Pinocchio computes in the world's axes or "
        "with inertias it turns: crba, computeMinverse, computeCoriolisMatrix, aba in WORLD, computeAllTerms, ccrba, "
        "dccrba, computeJointTorqueRegressor, and derivatives",
        "numbers that contradict its rnea and aba, for the matrix of such a q is no rotation",
        "those of the same matrix by this face's formulas, or InertiaError",
    ),
    Difference("arrays of the other byte order", "read as they stand", "read as what they are"),
    Difference("aba with too few external forces", "memory behind them", "ShapeError"),
    Difference("compactTangentMap of a joint of more than six velocities", "memory is overwritten", "ShapeError"),
    Difference("frame Jacobians of a model without freedoms", "a crash", "an array (6, 0)"),
    Difference("axes of unaligned joints that are not of unit length", "wrong joints", "normalised; an error if null"),
    Difference("gravity with an angular part", "an angular acceleration of the world", "ModelError"),
    Difference(
        "assigning an array of the wrong size to a limit or an armature", "accepted", "ShapeError naming the attribute"
    ),
    Difference("inertias no body can have in a URDF", "kept", "kept, and named in a warning"),
    Difference("a planar joint of a URDF whose axis is not z", "its axis is ignored", "ignored too, with a warning"),
    Difference("a revolute joint of a URDF without limits", "an error", "an unlimited joint"),
    Difference(
        "broken or half-read URDF", "what urdfdom makes of it", "UrdfError naming file, line, element and attribute"
    ),
    Difference("negative effort or velocity limits of a URDF", "kept", "no limit"),
    Difference("appendModel: gravity, name and armature", "defaults", "gravity and name of A, armature of both"),
    Difference("buildReducedModel: parent frame of a locked joint's frame", "the frame itself", "the frame before it"),
    Difference(
        "forwardDynamics, impulseDynamics with constraints that depend on each other, undamped",
        "what rounding makes of it",
        "ConstraintError naming the rank",
    ),
    Difference(
        "forwardDynamics, impulseDynamics with a damping below 0 or a restitution not from 0 to 1",
        "accepted",
        "ConstraintError",
    ),
    Difference(
        "data.M behind forwardDynamics, impulseDynamics, computeKKTContactDynamicMatrixInverse",
        "its lower triangle holds what was there before",
        "both triangles are filled",
    ),
    Difference("GeometryModel, buildModelsFromUrdf", "the shapes of the URDF", "what stands for them and is empty"),
    Difference("cholesky.solve, cholesky.computeMinv before cholesky.decompose", "zeros", "InertiaError"),
    Difference(
        "computeJointTorqueRegressor, computeKineticEnergyRegressor of models with mimic joints",
        "an error",
        "columns for each joint, rows for the independent velocities",
    ),
    Difference(
        "jointBodyRegressor, frameBodyRegressor of an index that is not there", "memory is read", "ModelError naming it"
    ),
    Difference(
        "appendModel where the name of a frame's parent is that of several frames",
        "an error",
        "the answer: frames are known by their index",
    ),
    Difference(
        "computeJointJacobian, computeFrameJacobian: the joints and frames that do not carry the one asked for",
        "liMi, oMi, oMf stay as they were",
        "they are placed at q as well",
    ),
    Difference(
        "framesForwardKinematics, updateFramePlacements with a data made before a frame was added",
        "memory is overwritten",
        "ShapeError",
    ),
    Difference(
        "writing into data what a later call starts from: J, dJ before getFrameJacobian, v before computeKineticEnergy",
        "what was written counts",
        "what the last call was given counts; oMi, liMi, v, a count where frames, velocities, accelerations are read",
    ),
    Difference("loadRotorParameters called twice", "adds the rotors to the armature twice", "once"),
    Difference(
        "saveToText, saveToXML, saveToBinary", "Boost archives", "files of this face, which Pinocchio does not read"
    ),
    Difference(
        "setIndexes, joint axes: what model.joints[i] gives", "a JointModel that holds any kind", "the joint itself"
    ),
    Difference(
        "Jexp6, Jlog6, log6 near the identity, log3, log6 near half a turn",
        "up to 1e-7 off at angles of 1e-3, and 4e-14 off near half a turn",
        "exact to rounding at every angle",
    ),
    Difference("Hlog3 at the identity", "NaN", "half the cross product, its limit"),
    Difference("SE3(), Inertia(), Symmetric3(), Quaternion(), AngleAxis()", "what memory held", "identity or zero"),
    Difference("an Inertia less a heavier one", "a centre of mass divided by 2e-16", "the body that adds up again"),
    Difference("Inertia.FromDynamicParameters, Inertia.inverse without mass", "NaN or infinite", "InertiaError"),
    Difference("Quaternion.FromTwoVectors of a null vector", "no rotation", "an error"),
    Difference("Symmetric3.inverse, Symmetric3.rhsMult", "write to a copy", "write to the array given"),
    Difference("Symmetric3.vxs, Symmetric3.svx, isOrthonormal, orthonormalization", "refuse every array", "work"),
    Difference("pickling Quaternion, AngleAxis, Symmetric3", "refused", "works"),
    Difference("rpy.matrixToRpy at a right angle of pitch", "some roll and yaw that fit", "roll 0"),
    Difference("operations of a LieGroup on arrays of a wrong size", "memory is overwritten", "ShapeError"),
    Difference(
        "derivatives of models with composite or universal joints or ZYX angles",
        "wrong by what their axes turn",
        "right",
    ),
    Difference(
        "getJointAccelerationDerivatives, getFrameAccelerationDerivatives by q in WORLD, of what spherical and planar "
        "joints carry that hang on others",
        "not the derivatives of its own accelerations",
        "those",
    ),
    Difference(
        "derivatives of frames, centroidal dynamics and centres of mass without the call that has to come before",
        "zeros, or what was before",
        "an error that names the call",
    ),
    Difference("utils.mprint", "prints", "NotImplementedError; nothing here writes to the terminal"),
    Difference(
        "RobotWrapper.com() before forwardKinematics",
        "the centre of mass with every joint placed at the origin",
        "an error that names what to call",
    ),
    Difference(
        "computeRNEADerivatives, computeABADerivatives, computeForwardKinematicsDerivatives, "
        "computeGeneralizedGravityDerivatives, computeCentroidalDynamicsDerivatives of models with mimic joints",
        "an error",
        "derivatives by the independent coordinates and velocities",
    ),
    Difference(
        "computeMinverse(model, data), computeABADerivatives(model, data) after aba in its LOCAL convention",
        "wrong numbers",
        "those at what aba was given",
    ),
    Difference(
        "computeMinverse(model, data), computeABADerivatives(model, data) without an aba before",
        "zeros or wrong numbers",
        "an error that says so",
    ),
    Difference(
        "buildReducedModel of joint 0 or of one that is not there",
        "left out of the list, without a word",
        "ModelError naming the index",
    ),
    Difference(
        "the first call after an edit of a model",
        "costs what any call does",
        "makes the library's model anew first, which takes some 2 ms at nine joints",
    ),
    Difference(
        "np.asarray(x)[0] = 1, memoryview, np.nditer and out= of random generators, where x is Model.armature or an "
        "array of a Model's placement, inertia or gravity",
        "write",
        "an error: x is read-only to them; x[0] = 1 or Model.armature = y write",
    ),
    Difference(
        "what is held of Model.armature across addJoint, or of a frame or joint across its replacement",
        "memory that was freed, or the new one",
        "the old one, no longer the model's; read it from the model again",
    ),
    Difference("Random, setRandom, sample models", "Eigen's random numbers", "NumPy's; pin.seed starts them"),
)


def differences() -> tuple[Difference, ...]:
    """Where this face differs from Pinocchio on purpose."""
    return DIFFERENCES
