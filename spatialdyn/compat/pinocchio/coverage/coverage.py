"""What of Pinocchio the face has: every public name is supported, supported with a difference, or out of scope.

A name that is out of scope raises ``OutOfScopeError``, a NotImplementedError that says what to use instead; nothing is
silently missing. Asked for as an attribute it is an AttributeError too, so that hasattr is False; imported it is an
ImportError. ``coverage()`` lists them all.
"""

from __future__ import annotations

import difflib
import importlib
import re
import sys
import types
from fnmatch import fnmatchcase
from functools import cache
from typing import Any, NamedTuple, NoReturn

from ....errors import SpatialDynError
from .differences import DIFFERENCES
from .pinocchio_names import NAMES

SUPPORTED, DIFFERENT, OUT_OF_SCOPE, UNKNOWN = "supported", "supported with a difference", "out of scope", "unknown"

_GEOMETRY = "geometry and collisions: coal or trimesh, placed by forwardKinematics and updateFramePlacements"
_CONSTRAINTS = (
    "constraint solvers: forwardDynamics or impulseDynamics with the constraints' Jacobian, "
    "computeKKTContactDynamicMatrixInverse for the matrix"
)
_MJCF = "MJCF and SDF: spatialdyn.from_mujoco of a mujoco.MjModel, or a URDF"
_HELICAL = "a joint that URDF does not have: JointModelComposite of those there are"
_NOT_ITS = "a module that the wheel happens to show: import it by its own name"
_CONTAINER = "a container of C++: a list or dict of Python"

INSTEAD: tuple[tuple[str, str], ...] = (
    (
        "ADMM* PGS* Lanczos* Tridiagonal* Delassus* computeDelassusMatrix computeDampedDelassusMatrixInverse",
        _CONSTRAINTS,
    ),
    ("Constraint* Contact ContactCholesky* *ConstraintModel *ConstraintData", _CONSTRAINTS),
    ("PointContact* FrameAnchor* PointAnchor* JointFriction* JointLimit* Baumgarte*", _CONSTRAINTS),
    (
        "*FrictionCone FrictionCoefficientMatrix getFrictionCoefficientMatrix BoxSet FullSpaceCone ZeroCone",
        _CONSTRAINTS,
    ),
    ("NonNegativeOrthantCone ProximalSettings constraintDynamics initConstraintDynamics lcaba", _CONSTRAINTS),
    ("computeConstraintDynamicsDerivatives computeImpulseDynamicsDerivatives contactInverseDynamics", _CONSTRAINTS),
    ("computeInverseDynamicsConstraintForces convertToRigidConstraintModel getConstraint*", _CONSTRAINTS),
    ("computeJointMinimalOrdering StdVec_Contact", _CONSTRAINTS),
    ("buildModel*MJCF* buildModels*MJCF* buildModels*Sdf buildModelsAndConstraints* buildModelAnd*", _MJCF),
    ("JointModelH? JointDataH? JointModelHelical* JointDataHelical* JointModelEllipsoid JointDataEllipsoid", _HELICAL),
    ("BroadPhase* TreeBroadPhase* StdVec_TreeBroadPhase* StdVec_BroadPhase* Distance*", _GEOMETRY),
    ("CollisionC* CollisionG* CollisionO* CollisionR*", _GEOMETRY),
    ("StdVec_Collision* StdVec_Distance* StdVec_Compute* StdVec_coal* StdVec_Geometry* Compute*", _GEOMETRY),
    ("GeometryPool Mesh* CachedMeshLoader Physics*", _GEOMETRY),
    ("buildGeom* buildSampleGeometry* computeCollision*", _GEOMETRY),
    ("computeDistance computeDistances computeContactPatch* computeBodyRadius removeCollision*", _GEOMETRY),
    ("updateGeometryPlacements coal hppfcl", _GEOMETRY),
    ("*KinematicHessian *KinematicHessians", "second derivatives of kinematics: differences of getJointJacobian"),
    ("*KinematicRegressor", "regressors of placement errors: columns of getJointJacobian, moved by SE3.actInv"),
    ("CONCRETE ICE METAL PLASTIC WOOD", _GEOMETRY),
    ("AUTOMATIC MANUAL CONSTANT LINEAR OSQP SPECTRAL", _CONSTRAINTS),
    ("JointData?*", "one class of joint data for all kinds: JointData"),
    ("StdVec_Data StdVec_Model StdVec_JointDataVector StdVec_JointModelVector", _CONTAINER),
    ("serialization", "archives: pickle, Model.saveToText, saveToXML and saveToBinary"),
    ("sharedMemory", "a switch for the binding's arrays: results are copies, fields of Data live"),
    ("graph", "building models as graphs: Model.addJoint, spatialdyn.ModelBuilder"),
    ("casadi", "symbols: spatialdyn.SymbolicManipulator, or spatialdyn.specialize for a program in C or Python"),
    ("romeo_wrapper windows_dll_manager derivative", "parts of the wheel that are no interface"),
    ("inspect sys numpy pin pinocchio_pywrap_default submodules module_info", _NOT_ITS),
    ("boost_type_index std_type_index map_indexing_suite_*", _CONTAINER),
    ("DeprecatedBool LogLevel Exception", "a detail of the binding"),
)


MEMBERS = {"saveToText", "saveToXML", "saveToBinary", "lowerVelocityLimit", "visualize"}


class OutOfScopeError(SpatialDynError, NotImplementedError):
    """A name of Pinocchio that the face does not have on purpose."""


class OutOfScopeAttributeError(OutOfScopeError, AttributeError):
    """The same of an attribute; hasattr is False."""


class OutOfScopeImportError(OutOfScopeError, ImportError):
    """The same of an import; Python would put an error of its own, without advice, in place of an AttributeError."""


class Entry(NamedTuple):
    """What the face makes of a name: ``supported``, ``supported with a difference``, ``out of scope``, and why.

    A name that Pinocchio 4.1 does not have either is ``unknown``.
    """

    name: str
    status: str
    note: str = ""


def face() -> types.ModuleType:
    """The package itself, imported when asked for: it imports this module."""
    return importlib.import_module(__package__.rpartition(".")[0])


def instead(name: str) -> str:
    """What to use in place of a name that is out of scope; empty if none is."""
    for patterns, what in INSTEAD:
        if any(fnmatchcase(name, pattern) for pattern in patterns.split()):
            return what
    return ""


def coverage() -> dict[str, Entry]:
    """Every public name of Pinocchio 4.1, and what the face makes of it.

    >>> import spatialdyn.compat.pinocchio as pin
    >>> pin.coverage()["rnea"].status
    'supported'
    >>> print(pin.coverage()["computeCollisions"].note)
    geometry and collisions: coal or trimesh, placed by forwardKinematics and updateFramePlacements
    """
    return {name: entry(name) for name in sorted(NAMES)}


def entry(name: str) -> Entry:
    """What the face makes of one name, dotted for a module's or a class's own."""
    first, *rest = name.split(".")
    package = face()
    if first in vars(package):
        at = getattr(package, first)
        for k, member in enumerate(rest):
            if not _there(at, member):
                where = ("a " if isinstance(at, type) else "") + ".".join([first, *rest[:k]])
                note = getattr(at, "_instead", {}).get(member) or f"{where} has no {member}"
                return Entry(name, OUT_OF_SCOPE, note)
            at = getattr(at, member, None)
        note = difference(name)
        return Entry(name, DIFFERENT if note else SUPPORTED, note)
    note = instead(first)
    if note:
        return Entry(name, OUT_OF_SCOPE, note)
    if first in NAMES:
        return Entry(name, OUT_OF_SCOPE, "not written yet")
    return Entry(name, UNKNOWN, "Pinocchio 4.1 has no such name" + _meant(first))


def _there(at: Any, member: str) -> bool:
    """Whether something has a member; of a class that is enough which a fresh object of it has."""
    if hasattr(at, member) or not isinstance(at, type):
        return hasattr(at, member)
    try:
        return hasattr(at(), member)
    except (TypeError, NotImplementedError, SpatialDynError):
        return False


def missing(name: str) -> NoReturn:
    """What the package raises for a name it does not have.

    Raises OutOfScopeError for one of Pinocchio's, AttributeError for any other
    """
    if name in NAMES or instead(name):
        kind = OutOfScopeImportError if _imported() else OutOfScopeAttributeError
        raise kind(f"pinocchio.{name} is not supported: {entry(name).note}")
    raise AttributeError(f"module {__package__!r} has no attribute {name!r}{_meant(name)}")


def missing_module(name: str) -> NoReturn:
    """What a module raises that stands for one of Pinocchio's, ``pinocchio.visualize`` say. Raises OutOfScopeError."""
    last = name.rpartition(".")[2]
    raise OutOfScopeImportError(f"pinocchio.{last} is not supported: {instead(last)}")


def _imported() -> bool:
    """Whether a package's ``__getattr__``, which asks ``missing``, was called for ``from package import name``."""
    caller = sys._getframe(3).f_code
    return caller.co_name == "_handle_fromlist" and "importlib" in caller.co_filename


def _meant(name: str) -> str:
    near = difflib.get_close_matches(name, NAMES, n=1)
    return f"; did you mean {near[0]}?" if near else ""


def difference(name: str) -> str:
    """What is different about a name, or a dotted one's last part; empty if nothing is."""
    return _differences().get(name) or _differences().get(name.rpartition(".")[2], "")


@cache
def _differences() -> dict[str, str]:
    """What is different about names that the table of differences mentions, unless strict mode makes it so."""
    found: dict[str, list[str]] = {}
    for x in DIFFERENCES:
        if x.switched:
            continue
        for name in re.findall(r"[\w.]+", x.what):
            if name.split(".")[0] in NAMES | MEMBERS:
                found.setdefault(name, []).append(f"{x.what}: {x.here}, in Pinocchio {x.pinocchio}")
    return {name: "; ".join(notes) for name, notes in found.items()}
