"""``install``: ``import pinocchio``, in every module that is imported later, is this package."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ExtensionFileLoader, ModuleSpec, PathFinder
from types import ModuleType

from ...errors import SpatialDynError
from .coverage.coverage import OutOfScopeImportError, instead

__all__ = ["install", "uninstall"]

FACE, NAME = __package__, "pinocchio"
LINKED = (b"libpinocchio", b"9pinocchio", b"@pinocchio@@")  # the library's file, its namespace as compilers write it


class Importer(MetaPathFinder, Loader):
    """Imports the modules of this package under Pinocchio's names: ``pinocchio.rpy`` is the module ``rpy`` itself.

    Extension modules compiled against Pinocchio take the objects of its wheel alone: they are refused.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The spec of a module of Pinocchio; None of any other, and of one that is not here.

        Raises OutOfScopeImportError for a module that takes Pinocchio's C++, or is out of scope.
        """
        root, _, inside = fullname.partition(".")
        if root != NAME:
            _refuse_linked(fullname, PathFinder.find_spec(fullname, path, target))
            return None
        if importlib.util.find_spec(FACE + fullname[len(NAME) :]) is not None:
            return importlib.util.spec_from_loader(fullname, self)
        if instead(inside):
            raise OutOfScopeImportError(f"{fullname} is not supported: {instead(inside)}")
        return None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """The module of this package."""
        module = importlib.import_module(FACE + spec.name[len(NAME) :])
        self.own = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Nothing to run: the module ran under its own name, whose spec it keeps."""
        module.__spec__ = self.own


IMPORTER = Importer()


def install() -> None:
    """Make ``import pinocchio`` this package, in every module that the process imports from now on.

    Its submodules too: ``pinocchio.utils``, ``pinocchio.visualize``, ``pinocchio.casadi`` ... Packages in Python, such
    as pink, example_robot_data and robot_descriptions, then make and take the objects of this one; to import a module
    that is compiled against Pinocchio (crocoddyl, tsid, aligator, mim_solvers ...) is an ImportError that names it.
    Undone by ``uninstall()``; a process that is started anew does not have it. ``spatialdyn run SCRIPT.py`` does it for
    a script. Raises SpatialDynError if Pinocchio itself is imported already.
    """
    if IMPORTER in sys.meta_path:
        return
    for name in sorted(sys.modules):
        if name.partition(".")[0] == NAME:
            where = getattr(sys.modules[name], "__file__", None)
            raise SpatialDynError(
                f"{name} is imported already, from {where}, expected install() before its first import"
            )
    sys.meta_path.insert(0, IMPORTER)


def uninstall() -> None:
    """Undo ``install``: the next ``import pinocchio`` imports Pinocchio; modules that have this package keep it."""
    if IMPORTER in sys.meta_path:
        sys.meta_path.remove(IMPORTER)
        for name in [name for name in sys.modules if name.partition(".")[0] == NAME]:
            del sys.modules[name]


def _refuse_linked(name: str, spec: ModuleSpec | None) -> None:
    """Raise OutOfScopeImportError for an extension module that is compiled against Pinocchio."""
    if spec is None or not isinstance(spec.loader, ExtensionFileLoader) or spec.origin is None:
        return
    content = spec.loader.get_data(spec.origin)
    if any(mark in content for mark in LINKED):
        raise OutOfScopeImportError(
            f"{name} is compiled against Pinocchio's C++ library and takes the objects of its wheel alone, expected "
            f"modules in Python while {FACE} is installed as {NAME}"
        )
