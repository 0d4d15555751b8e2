"""The bytes of a URDF: from a path, text, an open file or the name of a robot (``robot_files`` finds those)."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

from ..errors import UrdfError, literal
from .robot_files import find_robot
from .strict_xml import SIZE_LIMIT, sane_text

LONGEST_NAME = 4096  # characters of a path


def is_yourdfpy(source: Any) -> bool:
    """Whether the source is a yourdfpy.URDF, without importing yourdfpy: if it is one, that is imported."""
    module = sys.modules.get("yourdfpy")
    return module is not None and isinstance(source, module.URDF)


def file_of(source: Any) -> str:
    """The absolute path of the file that a source of ``load_urdf`` is; empty for text, streams and a yourdfpy.URDF."""
    if isinstance(source, str) and not source.lstrip("\ufeff \t\r\n").startswith("<"):
        return os.path.abspath(_path_of(source))
    name = os.fsdecode(source) if isinstance(source, os.PathLike) else getattr(source, "name", None)
    return os.path.abspath(name) if isinstance(name, str) and os.path.isfile(name) else ""


def read_source(source: Any) -> tuple[str, bytes]:
    """``file_of`` a source of ``load_urdf``, and its text, unchecked. Raises UrdfError if it cannot be read."""
    return file_of(source), bytes_of(source)[1]


def bytes_of(source: Any) -> tuple[str, bytes]:
    """A name for messages, and the XML in UTF-8 or its declared encoding. Raises UrdfError."""
    if isinstance(source, (bytes, bytearray)):
        return sane_text("<text>", bytes(source))
    if isinstance(source, str):
        if source.lstrip("\ufeff \t\r\n").startswith("<"):
            return sane_text("<text>", source)
        return read_path(_path_of(source))
    if isinstance(source, os.PathLike):
        return read_path(source)
    if hasattr(source, "read"):
        name = getattr(source, "name", None)
        label = os.path.basename(name) if isinstance(name, str) else "<file>"
        try:
            return sane_text(label, source.read(SIZE_LIMIT + 1))
        except UnicodeDecodeError as error:
            raise UrdfError(f"{label}: is no text ({error.reason}), expected a <robot> element") from None
    raise UrdfError(
        f"source is of type {type(source).__name__}, expected a path, URDF text, an open file, a yourdfpy.URDF "
        "or the name of a robot"
    )


def read_path(path: str | os.PathLike[str], what: str = "a URDF file") -> tuple[str, bytes]:
    """The name and text of a URDF or SRDF file. Raises UrdfError."""
    path = Path(os.fsdecode(path))
    if os.path.isdir(path):
        raise UrdfError(f"{path} is a directory, expected {what}")
    try:
        size = path.stat().st_size
        if size > SIZE_LIMIT:
            raise UrdfError(f"{path.name}: has {size} bytes, expected at most {SIZE_LIMIT}")
        with path.open("rb") as file:
            return sane_text(path.name, file.read(SIZE_LIMIT + 1))
    except FileNotFoundError:
        raise UrdfError(f"{path}: no such file, expected {what}") from None
    except (OSError, ValueError) as error:
        if isinstance(error, UrdfError):
            raise
        raise UrdfError(f"{path}: cannot be read ({error}), expected {what}") from error


def _path_of(source: str) -> Path:
    """The path that a string names: a file, else a robot's file, else the string itself."""
    path = Path(source)
    if len(source) > LONGEST_NAME:
        raise UrdfError(
            f"source is {literal(source[:40])}... of {len(source)} characters, expected URDF text, a path or a name"
        )
    if os.path.isfile(source) or path.suffix in (".urdf", ".xml", ".xacro") or path.is_absolute():
        return path
    try:
        return find_robot(source)
    except UrdfError:
        if source and os.path.isdir(source):
            return path
        raise
