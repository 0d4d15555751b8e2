"""What the face says of itself: the version of Pinocchio whose names and numbers it has, and what it is built with."""

from __future__ import annotations

from typing import Any

PINOCCHIO_MAJOR_VERSION, PINOCCHIO_MINOR_VERSION, PINOCCHIO_PATCH_VERSION = 4, 1, 0
_VERSION = (PINOCCHIO_MAJOR_VERSION, PINOCCHIO_MINOR_VERSION, PINOCCHIO_PATCH_VERSION)
WITH_URDFDOM = True
WITH_COLLISION = WITH_CPPAD = WITH_OPENMP = WITH_SDFORMAT = False


def printVersion(delimiter: str = ".") -> str:
    """The version of Pinocchio that the face stands for, as text; nothing is printed."""
    return delimiter.join(map(str, _VERSION))


def checkVersionAtLeast(major: int, minor: int, patch: int) -> bool:
    """Whether that version is no older than another."""
    return (major, minor, patch) <= _VERSION


def createDatas(*models: Any) -> tuple[Any, ...]:
    """A Data for each Model; None for None."""
    return tuple([None if model is None else model.createData() for model in models])
