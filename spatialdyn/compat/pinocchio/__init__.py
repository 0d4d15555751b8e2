"""The library under the names and conventions of Pinocchio: ``import spatialdyn.compat.pinocchio as pin``.

Vectors are [linear; angular]; a free flyer has q = [x y z, quaternion x y z w] and v in its own axes; continuous
joints have q = [cos, sin]; external forces are given in the joints' own frames. ``differences()`` lists what
differs from Pinocchio on purpose; with ``strict(True)`` missing names and coordinates off their unit norm are errors;
after ``install()`` other packages that import ``pinocchio`` import this one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from . import cholesky as cholesky
from . import deprecation as deprecation
from . import explog as explog
from . import liegroups as liegroups
from . import linalg as linalg
from . import robot_wrapper as robot_wrapper
from . import rpy as rpy
from . import shortcuts as shortcuts
from . import utils as utils
from . import visualize as visualize
from .algorithms.calls import *
from .algorithms.centroidal import *
from .algorithms.collisions import *
from .algorithms.configuration import *
from .algorithms.constrained import *
from .algorithms.constraint_cholesky import *
from .algorithms.derivatives import *
from .algorithms.dynamics import *
from .algorithms.jacobians import *
from .algorithms.kinematics import *
from .algorithms.parallel import *
from .algorithms.rigid_constraints import *
from .coverage.coal_package import coal as coal
from .coverage.coal_package import hppfcl as hppfcl
from .coverage.coverage import coverage as coverage
from .coverage.coverage import missing
from .coverage.differences import differences as differences
from .coverage.strictness import strict as strict
from .coverage.versions import *
from .data.data import *
from .deprecation import deprecated as deprecated
from .explog import *
from .importing import *
from .liegroups import LieGroup as LieGroup
from .liegroups import findCommonAncestor as findCommonAncestor
from .liegroups import getTangentToConfigurationSparsitySegment as getTangentToConfigurationSparsitySegment
from .liegroups import lieGroup as lieGroup
from .linalg import isOrthonormal as isOrthonormal
from .linalg import orthogonalization as orthogonalization
from .linalg import orthonormalization as orthonormalization
from .model.constraints import *
from .model.from_mjcf import *
from .model.from_urdf import *
from .model.geometry import *
from .model.geometry_from_mjcf import *
from .model.geometry_from_urdf import *
from .model.geometry_object import *
from .model.joint import *
from .model.joints import *
from .model.model import *
from .model.model_surgery import *
from .model.sample_models import *
from .model.srdf import *
from .robot_wrapper import *
from .types.containers import *
from .types.frame import *
from .types.inertia import *
from .types.motion import *
from .types.pseudo_inertia import *
from .types.random import *
from .types.rotations import *
from .types.se3 import *
from .types.symmetric import *

# not Pinocchio's
_OWN = "Any TYPE_CHECKING algorithms annotations data deprecation importing missing model types visualize"

if not TYPE_CHECKING:  # with a module __getattr__ type checkers would accept every name
    __all__ = sorted(name for name in globals() if name[0] != "_" and name not in _OWN.split())

    def __getattr__(name: str) -> Any:
        """Raise an error that says what to use instead of a name of Pinocchio's that is out of scope."""
        return missing(name)
