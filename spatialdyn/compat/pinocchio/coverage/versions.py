"""The version of Pinocchio whose names and conventions this package has, and its build options."""

from __future__ import annotations

from .coal_package import has_coal

__all__ = [
    "PINOCCHIO_MAJOR_VERSION", "PINOCCHIO_MINOR_VERSION", "PINOCCHIO_PATCH_VERSION", "WITH_COLLISION", "WITH_CPPAD",
    "WITH_HPP_FCL", "WITH_HPP_FCL_BINDINGS", "WITH_OPENMP", "WITH_SDFORMAT", "WITH_URDFDOM", "ScalarType",
    "__raw_version__", "__version__", "checkVersionAtLeast", "printVersion",
]  # fmt: skip

PINOCCHIO_MAJOR_VERSION, PINOCCHIO_MINOR_VERSION, PINOCCHIO_PATCH_VERSION = 4, 1, 0
VERSION = (PINOCCHIO_MAJOR_VERSION, PINOCCHIO_MINOR_VERSION, PINOCCHIO_PATCH_VERSION)
__version__ = __raw_version__ = ".".join(map(str, VERSION))

WITH_URDFDOM = True  # robots are read from URDF
WITH_COLLISION = WITH_HPP_FCL = WITH_HPP_FCL_BINDINGS = has_coal()  # with it collisions are computed
WITH_CPPAD = WITH_SDFORMAT = WITH_OPENMP = False
ScalarType = float


def printVersion(delimiter: str = ".") -> str:
    """The version as text; as in Pinocchio, nothing is printed."""
    return delimiter.join(map(str, VERSION))


def checkVersionAtLeast(major: int, minor: int, patch: int) -> bool:
    """Whether the version is that one or a later one."""
    return (major, minor, patch) <= VERSION
