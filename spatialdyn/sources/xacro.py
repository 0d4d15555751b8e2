"""xacro: ROS' macro language for URDF, expanded by the package xacrodoc. It evaluates Python expressions."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

from ..errors import SpatialDynError, literal, pip_install
from ..model.robot_checks import quoted


def is_xacro(path: str) -> bool:
    """Whether a file is xacro by its suffix; nothing else makes one, for expressions in it are evaluated."""
    return path.lower().endswith(".xacro")


def urdf_of_xacro(data: bytes | None, path: str, arguments: Mapping[str, Any]) -> str:
    """The URDF of a xacro file, or of text without includes beside it.

    arguments  {name: value} of its ``<xacro:arg>``; True and False become the words of XML

    Raises SpatialDynError with the message of xacro, for a package it does not find say; for an argument that the file
    does not ask for; without xacrodoc.
    """
    try:
        from xacrodoc import XacroDoc
    except ImportError as error:
        raise SpatialDynError(f"xacro needs xacrodoc: {pip_install('ros')}") from error
    given = Arguments((str(name), _word(value)) for name, value in arguments.items())
    unknown = list(given)
    try:
        if path:
            made = str(XacroDoc.from_file(os.path.abspath(path), subargs=given).to_urdf_string())
        else:
            made = str(XacroDoc.from_string((data or b"").decode("utf-8"), subargs=given).to_urdf_string())
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except Exception as error:  # xacro raises what its expressions raise
        said = " ".join(str(error).split()) or type(error).__name__
        raise SpatialDynError(f"{path or '<text>'}: xacro refuses it: {said}") from error
    unknown = [name for name in unknown if name not in given.asked]
    if unknown:
        known = f"those of {quoted(sorted(given.asked))}" if given.asked else "none: it has no arguments"
        raise SpatialDynError(f"{path or '<text>'}: xacro is given {quoted(unknown)}, expected {known}")
    return made


class Arguments(dict[str, str]):
    """Arguments for a xacro file, and the names of those that it reads: xacro ignores all others."""

    def __init__(self, given: Iterable[tuple[str, str]]) -> None:
        super().__init__(given)
        self.asked: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.asked.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.asked.add(name)
        return super().__getitem__(name)


def _word(value: Any) -> str:
    try:
        return str(value).lower() if isinstance(value, bool) else str(value)
    except Exception as error:  # of any class of the caller's; of an int of 4301 digits
        raise SpatialDynError(f"a value in xacro is {literal(value)}: {error}") from error
