"""The public names of Pinocchio 4.1's Python module that are out of scope, with what to use instead."""

from __future__ import annotations

import itertools
import re

# what to use instead; indented lines name what for, with choices in braces, and * for names of other versions too
_TABLE = """
other constraints and solvers: constraintDynamics of RigidConstraintModel, forwardDynamics and impulseDynamics with a
Jacobian, spatialdyn.Constraints
    ADMM* ADMMConstraintSolver ADMMProximalRule ADMMSolver{Result,Settings,Stats} ADMMUpdateRule PGS*
    PGSConstraintSolver PGSSolver{Result,Settings,Stats} Lanczos* LanczosDecomposition Tridiagonal*
    TridiagonalSymmetricMatrix Delassus* DelassusCholeskyExpression DelassusOperator{CholeskyExpression,Dense,Sparse}
    Constraint* {,StdVec_}Constraint{Data,Model} ConstraintSelectionType {,StdVec_}Contact *ConstraintModel
    *ConstraintData {FrameAnchor,PointAnchor,PointContact,JointFriction,JointLimit}*
    {,StdVec_}{FrameAnchor,PointAnchor,PointContact,JointFriction,JointLimit}Constraint{Data,Model} *FrictionCone
    {,Dual}CoulombFrictionCone {,get}FrictionCoefficientMatrix BoxSet FullSpaceCone ZeroCone NonNegativeOrthantCone
    lcaba computeImpulseDynamicsDerivatives contactInverseDynamics computeInverseDynamicsConstraintForces
    computeDampedDelassusMatrixInverse computeJointMinimalOrdering convertToRigidConstraintModel AUTOMATIC MANUAL
    CONSTANT LINEAR OSQP SPECTRAL
several models of a file, SDF: buildModelFromMJCF and buildModelFromUrdf; spatialdyn.from_mujoco converts states
    buildModels*Sdf buildModelsAndConstraints* buildModelAnd* buildModelAndConstraintsFromMJCF
    buildModelFromMJCFAndRootJoint
    buildModelsAndConstraintsFrom{MJCF,Sdf} buildModelsFromSdf
a joint that URDF does not have: JointModelComposite of those there are
    Joint{Data,Model}Ellipsoid
geometry and collisions: computeCollisions, computeDistances, and the classes of the package coal itself
    {,StdVec_}{,Tree}BroadPhase* {,Tree}BroadPhaseManagerPool_DynamicAABBTreeCollisionManager
    {,Tree}BroadPhaseManager_{DynamicAABBTree,DynamicAABBTreeArray,IntervalTree,Naive,SSaP,SaP}CollisionManager
    StdVec_{,Tree}BroadPhaseManager_DynamicAABBTreeCollisionManager {,StdVec_}Distance* {,StdVec_}DistanceResult
    Collision{C,G,O,R}* CollisionCallBack{Base,Collect,Default} CollisionGeometry {,StdVec_}Collision{Object,Result}
    {,StdVec_}Compute* {,StdVec_}Compute{Collision,Distance} StdVec_{coal,GeometryD,GeometryM}*
    StdVec_coal_CollisionObjectPointer StdVec_Geometry{Data,Model} GeometryPool Mesh* {,Cached}MeshLoader
    Physics* PhysicsMaterial{,Type} buildGeom* computeCollision* computeCollisionsInParallel
    computeContactPatch* computeContactPatch{,es} computeBodyRadius CONCRETE ICE METAL PLASTIC WOOD
second derivatives of kinematics: finite differences of getJointJacobian
    *KinematicHessian{,s} computeJointKinematicHessians get{Frame,Joint}KinematicHessian
one class for all kinds: JointData
    JointData?* JointData{Composite,FreeFlyer,HX,HY,HZ,HelicalUnaligned,Mimic,PX,PY,PZ,Planar,PrismaticUnaligned}
    JointData{RUBX,RUBY,RUBZ,RX,RY,RZ,RevoluteUnaligned,RevoluteUnboundedUnalignedTpl,Spherical,SphericalZYX}
    JointData{Translation,Universal}
a container of C++: a list or dict of Python
    StdVec_{Data,Model,JointDataVector,JointModelVector} {boost,std}_type_index map_indexing_suite_*
    map_indexing_suite_StdMap_String_VectorXd_entry
archives: pickle, Model.saveToText, saveToXML and saveToBinary
    serialization
a switch of the binding's arrays: results are copies, fields of Data are written in place
    sharedMemory
building models as graphs: Model.addJoint, spatialdyn.ModelBuilder
    graph
internals of the wheel: the same names of the package itself
    romeo_wrapper* windows_dll_manager* derivative* pinocchio_pywrap* pinocchio_pywrap_default
a foreign module in the wheel's namespace: import it by its own name
    inspect sys numpy pin submodules module_info
a detail of the binding
    DeprecatedBool LogLevel Exception
"""


def _words(text: str) -> list[str]:
    """Its words, each choice in braces made: ``a{b,c}`` is ``ab`` and ``ac``."""
    choices = ([part.split(",") for part in re.split("[{}]", word)] for word in text.split())
    return ["".join(x) for parts in choices for x in itertools.product(*parts)]


INSTEAD = tuple(
    (tuple(_words(names)), " ".join(what.split()))
    for what, names in re.findall(r"((?:^\S.*\n)+)((?:^ .*\n)+)", _TABLE, re.MULTILINE)
)
OUT_OF_SCOPE = frozenset(word for words, _ in INSTEAD for word in words if "*" not in word)
