"""Status of every public name of Pinocchio: supported, supported with a difference, or out of scope.

A name that is out of scope raises ``OutOfScopeError``, a NotImplementedError that says what to use instead. As an
attribute it is an AttributeError too, so that hasattr is False; in an import it is an ImportError. ``coverage()``
lists all names.
"""

from __future__ import annotations

import difflib
import importlib
import re
import sys
import types
from collections.abc import Iterable
from fnmatch import fnmatchcase
from functools import cache
from typing import Any, ClassVar, NamedTuple, NoReturn

from ....errors import SpatialDynError
from .differences import DIFFERENCES
from .pinocchio_names import INSTEAD
from .pinocchio_names import OUT_OF_SCOPE as ABSENT

SUPPORTED, DIFFERENT, OUT_OF_SCOPE, UNKNOWN = "supported", "supported with a difference", "out of scope", "unknown"

_DEPENDENT = "where constraints depend on each other, undamped: give a damping, or mu in ProximalSettings"
_FOREIGN = "for files that Pinocchio wrote, and its StreamBuffer: pickle, or build the model from its URDF"
COLLISIONS = "computeCollisions, computeDistances, and the package coal itself"
RAISES: tuple[tuple[str, str], ...] = (  # names that are there and raise on arguments that scripts usually pass
    ("utils.mprint", "always: print(numpy.array2string(M))"),
    ("Symmetric3.decomposeltI", "always: numpy.linalg.cholesky(S.matrix())"),
    ("RobotWrapper.BuildFromSDF RobotWrapper.initFromSDF", "always: SDF is not read, BuildFromURDF or BuildFromMJCF"),
    ("buildGeomFromMJCF buildModel*MJCF RobotWrapper.BuildFromMJCF", "without the package mujoco"),
    (
        "computeCollision computeCollisions computeDistance computeDistances GeometryObject.CreateCapsule",
        "without the package coal",
    ),
    ("*Visualizer.create_video_ctx", "always: visualizers make no videos, spatialdyn.view(...).save writes a page"),
    ("*Visualizer.captureImage", "until a browser shows the page"),
    ("forwardDynamics impulseDynamics constraintDynamics", _DEPENDENT),
    ("*.loadFromText *.loadFromXML *.loadFromBinary *.loadFromString", _FOREIGN),
)
OWN = {"coverage", "differences", "install", "strict", "uninstall"}  # names that Pinocchio does not have
MEMBERS = {"saveToText", "saveToXML", "saveToBinary", "lowerVelocityLimit", "visualize"}


class OutOfScopeError(SpatialDynError, NotImplementedError):
    """A name of Pinocchio that is out of scope."""


class OutOfScopeAttributeError(OutOfScopeError, AttributeError):
    """An attribute that is out of scope; hasattr is False."""


class OutOfScopeImportError(OutOfScopeError, ImportError):
    """An import that is out of scope; of an AttributeError Python would drop the message."""


def refused(name: str) -> Any:
    """A function that only raises OutOfScopeError, with the advice of the name's row of ``RAISES``."""
    text = f"{name} is not offered: {raises(name).removeprefix('always: ')}"

    def function(*arguments: Any, **named: Any) -> NoReturn:
        raise OutOfScopeError(text)

    function.__name__, function.__doc__ = name.rpartition(".")[2], f"Raises OutOfScopeError: {text}."
    return function


class Partial:
    """Base of classes that lack members of Pinocchio's: ``_instead`` says of each what to use instead."""

    _instead: ClassVar[dict[str, str]] = {}

    def __getattr__(self, name: str) -> Any:
        if name in self._instead:
            raise OutOfScopeAttributeError(f"{type(self).__name__}.{name}: {self._instead[name]}")
        raise AttributeError(f"a {type(self).__name__} has no attribute {name!r}")


class Entry(NamedTuple):
    """Status of a name: ``supported``, ``supported with a difference``, ``out of scope``, with a note that says why.

    A name that Pinocchio 4.1 does not have is ``unknown``.
    """

    name: str
    status: str
    note: str = ""


def compat_package() -> types.ModuleType:
    """The package compat.pinocchio, imported late: it imports this module."""
    return importlib.import_module(__package__.rpartition(".")[0])


@cache
def names() -> frozenset[str]:
    """The public names of Pinocchio 4.1's Python module: those that are here, and those out of scope."""
    return ABSENT | {*compat_package().__all__} - OWN


def instead(name: str) -> str:
    """Advice for a name that is out of scope; "" for other names."""
    return _matching(INSTEAD, name)


def raises(name: str) -> str:
    """When a name that is there raises on arguments that scripts usually pass, and what to do; "" for others."""
    return _matching(((names.split(), what) for names, what in RAISES), name)


def _matching(table: Iterable[tuple[Iterable[str], str]], name: str) -> str:
    return next((what for patterns, what in table if any(fnmatchcase(name, x) for x in patterns)), "")


def coverage() -> dict[str, Entry]:
    """Every public name of Pinocchio 4.1 with its status here.

    >>> import spatialdyn.compat.pinocchio as pin
    >>> pin.coverage()["rnea"].status
    'supported'
    >>> print(pin.coverage()["computeBodyRadius"].note)
    geometry and collisions: computeCollisions, computeDistances, and the classes of the package coal itself
    """
    return {name: entry(name) for name in sorted(names())}


def entry(name: str) -> Entry:
    """Status of one name; dotted for a member of a module or class."""
    first, *rest = name.split(".")
    package = compat_package()
    if first == "casadi":  # imported apart, as in Pinocchio
        importlib.import_module(f"{package.__name__}.casadi")
    if first in vars(package):
        at = getattr(package, first)
        for k, member in enumerate(rest):
            if not _has(at, member):
                where = ("a " if isinstance(at, type) else "") + ".".join([first, *rest[:k]])
                note = getattr(at, "_instead", {}).get(member) or f"{where} has no {member}"
                return Entry(name, OUT_OF_SCOPE, note)
            at = getattr(at, member, None)
        note = difference(name)
        return Entry(name, DIFFERENT if note else SUPPORTED, note)
    note = instead(first)
    if note:
        return Entry(name, OUT_OF_SCOPE, note)
    return Entry(name, UNKNOWN, "Pinocchio 4.1 has no such name" + _suggestion(first))


def _has(at: Any, member: str) -> bool:
    """Whether an object has a member; a class also if a new object of it does."""
    if hasattr(at, member) or not isinstance(at, type):
        return hasattr(at, member)
    if member in getattr(at, "__annotations__", {}):
        return True
    try:
        return hasattr(at(), member)
    except (TypeError, NotImplementedError, SpatialDynError):
        return False


def missing(name: str) -> NoReturn:
    """Raise the package's error for a missing name.

    Raises OutOfScopeError for a name of Pinocchio's, AttributeError for any other
    """
    if instead(name):
        kind = OutOfScopeImportError if _imported() else OutOfScopeAttributeError
        raise kind(f"pinocchio.{name} is not supported: {entry(name).note}")
    raise AttributeError(f"module {compat_package().__name__!r} has no attribute {name!r}{_suggestion(name)}")


def _imported() -> bool:
    """Whether the package's ``__getattr__``, the caller of ``missing``, runs for ``from package import name``."""
    caller = sys._getframe(3).f_code
    return caller.co_name == "_handle_fromlist" and "importlib" in caller.co_filename


def _suggestion(name: str) -> str:
    near = difflib.get_close_matches(name, names(), n=1)
    return f"; did you mean {near[0]}?" if near else ""


def difference(name: str) -> str:
    """The differences of a name, or of a dotted name's last part; "" if none."""
    return _differences().get(name) or _differences().get(name.rpartition(".")[2], "")


@cache
def _differences() -> dict[str, str]:
    """The differences by name, without those of strict mode alone."""
    found: dict[str, list[str]] = {}
    for x in DIFFERENCES:
        if x.switched:
            continue
        subject = re.split(r" (?:after|before|with) ", x.what)[0]
        for name in dict.fromkeys(re.findall(r"[\w.]+", subject)):
            if name.split(".")[0] in names() | MEMBERS:
                found.setdefault(name, []).append(f"{x.what}: {x.here}, in Pinocchio {x.pinocchio}")
    return {name: "; ".join(notes) for name, notes in found.items()}
