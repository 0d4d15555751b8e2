"""The package coal, which computes collisions and distances: imported when something needs it."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any

from ....errors import pip_install
from .coverage import OutOfScopeAttributeError, OutOfScopeError


def has_coal() -> bool:
    """Whether coal is installed, without importing it."""
    return installed("coal")


def installed(package: str) -> bool:
    """Whether a package is installed, without importing it."""
    try:
        return find_spec(package) is not None
    except ValueError:  # blocked by a None in sys.modules
        return False


def coal_for(what: str) -> Any:
    """coal. Raises OutOfScopeError naming it, and what needs it."""
    try:
        found = import_module("coal")
    except ImportError as error:
        raise OutOfScopeError(
            f"{what} takes the package coal, which is not installed; {pip_install('collision')}"
        ) from error
    return found


class LateCoal(ModuleType):
    """``pinocchio.coal`` and ``pinocchio.hppfcl``: the package coal, imported when a name of it is asked for."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        try:
            found = coal_for(f"pinocchio.{self.__name__}.{name}")
        except OutOfScopeError as error:
            raise OutOfScopeAttributeError(str(error)) from error
        return getattr(found, name)


coal, hppfcl = LateCoal("coal"), LateCoal("hppfcl")
