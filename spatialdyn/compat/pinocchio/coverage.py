"""Which of Pinocchio's names this face has, and what to use instead of the others."""

from __future__ import annotations

import re
import sys
from typing import NamedTuple

from .differences import DIFFERENCES
from .names import NAMES

SUPPORTED, DIFFERENT, MISSING = "supported", "different", "out of scope"
COLLISIONS = "geometry and collisions are out of scope; coal, trimesh or pinocchio itself have them"
CONSTRAINTS = (
    "constraint models and their solvers are out of scope; spatialdyn.crba, nonlinear_effects and frame Jacobians give "
    "the KKT system of a contact"
)
# names of one kind, and what to do without them; the first that matches counts
INSTEAD = (
    (r"Mjcf|MJCF|Sdf", "MJCF and SDF are out of scope; convert the file to URDF"),
    (r"coal|hppfcl|Collision|Distance|Geom|BroadPhase|Mesh|ContactPatch|BodyRadius|\bContact$|_Contact$", COLLISIONS),
    (
        r"JointModelH|JointModelEllipsoid",
        "helical and ellipsoid joints are out of scope; a rotation and a translation that mimics it are a screw",
    ),
    (r"StdVec_(Data|Model)$", "a list holds several"),
    (r"KinematicHessian", "kinematic Hessians are out of scope; difference the Jacobians along integrate"),
    (r"MinimalOrdering|graph", "joint order is that of the model; appendModel and addJoint build trees"),
    (r"PhysicsMaterial|ICE|METAL|PLASTIC|WOOD|CONCRETE|FrictionCoefficient", "materials are out of scope"),
    (
        r"Constraint|Contact|Cone|ADMM|PGS|Delassus|Friction|Baumgarte|BoxSet|Proximal|Lanczos|Tridiagonal|lcaba|KKT"
        r"|(forward|impulse|Impulse|constraint)Dynamics|contactInverse|AUTOMATIC|CONSTANT|LINEAR|MANUAL|OSQP|SPECTRAL",
        CONSTRAINTS,
    ),
    (r"JointData|StdVec_Joint", "joint.createData() makes the JointData of any joint; a list holds several"),
    (
        r"RNEADerivatives|ABADerivatives|Derivatives$",
        "derivatives are not in this face yet; difference the calls along integrate",
    ),
    (r"Regressor", "regressors are not in this face yet; results are linear in masses, first moments and inertias"),
    (
        r"InParallel|ModelPool|omp_get|sharedMemory|cholesky",
        "spatialdyn's own calls take batches and share them between threads: spatialdyn.rnea with q (n, nq)",
    ),
    (r"serialization", "a Model has saveToText, saveToXML, saveToBinary and pickles"),
    (r"Exception", "errors are spatialdyn.SpatialDynError, a ValueError"),
    (
        r"boost_type|std_type|DeprecatedBool|LogLevel|deprecated|inspect|numpy|^pin$|pywrap|shortcuts|^sys$|module_info"
        r"|submodules|map_indexing",
        "it belongs to the binding of Pinocchio, not to its functions",
    ),
)


class Entry(NamedTuple):
    """A name of Pinocchio's, whether it is supported, different or out of scope, and why or what to use instead."""

    name: str
    status: str
    note: str = ""


class OutOfScope(NotImplementedError, AttributeError):
    """A name of Pinocchio's that this face has not; the message says what to use instead."""


def coverage() -> tuple[Entry, ...]:
    """Every public name of Pinocchio 4.1: supported, different (and how) or out of scope (and what to use instead)."""
    return tuple(entry(name) for name in NAMES)


def entry(name: str) -> Entry:
    """What there is to say of a name of Pinocchio's, or of an attribute of one: ``rpy.matrixToRpy``."""
    first, _, attribute = name.partition(".")
    module = vars(sys.modules[__package__ or ""])
    if first not in module:
        return Entry(name, MISSING, instead(first))
    if attribute and not hasattr(module[first], attribute):
        return Entry(name, MISSING, f"{first} has no {attribute} here")
    notes = [
        f"{found.what}: here {found.here} (Pinocchio: {found.pinocchio})"
        for found in DIFFERENCES
        if {name, first} & {*re.findall(r"[\w.]+", found.what)}
    ]
    return Entry(name, DIFFERENT, "; ".join(notes)) if notes else Entry(name, SUPPORTED)


def instead(name: str) -> str:
    """What to use instead of a name that is out of scope."""
    return next((advice for pattern, advice in INSTEAD if re.search(pattern, name)), "it is not in this face")


def absent(name: str) -> AttributeError:
    """The error for a name that this face has not."""
    if name in NAMES:
        return OutOfScope(f"pinocchio's {name} is not in spatialdyn.compat.pinocchio: {instead(name)}")
    return AttributeError(f"module 'spatialdyn.compat.pinocchio' has no attribute {name!r}, nor has pinocchio 4.1")
