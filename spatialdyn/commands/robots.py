"""The robot of a command: its arguments, and its Model."""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import SpatialDynError, literal
from ..model.model import Model
from ..sources.load import load as load_robot

ROBOT = "path of a URDF, MJCF or xacro file, or one of the names that `spatialdyn info` lists"
Array = NDArray[np.float64]
ROOTS = ("fixed", "floating")


def add_robot(parser: argparse.ArgumentParser) -> None:
    """Add the arguments ROBOT and --root."""
    parser.add_argument("robot", metavar="ROBOT", help=ROBOT)
    add_root(parser)


def add_root(parser: argparse.ArgumentParser) -> None:
    """Add the argument --root."""
    parser.add_argument("--root", choices=ROOTS, default="fixed", help="what the root link does (default: fixed)")


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """Add the argument --quiet."""
    parser.add_argument("--quiet", action="store_true", help="no progress on stderr")


def add_package_dirs(parser: argparse.ArgumentParser) -> None:
    """Add the argument --package-dir."""
    parser.add_argument(
        "--package-dir", action="append", default=[], metavar="DIR",
        help="holds packages of package:// names of meshes; repeatable",
    )  # fmt: skip


def load(arguments: argparse.Namespace, mimic: bool = False) -> Model:
    """The model, without warnings except of downloads, as ``info`` shows oddities of the file.

    Raises SpatialDynError as ``sources.load``.

    mimic  whether mimic joints follow their leaders; commands that describe the file, or use symbols, leave them free
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("default", message=".*robot_descriptions, which clones")
        return load_robot(arguments.robot, root=arguments.root, mimic=mimic)


def parse_numbers(option: str, text: str | None, count: int) -> Array | None:
    """Numbers separated by commas. Raises SpatialDynError unless there are ``count``."""
    if text is None:
        return None
    try:
        x = np.array([float(part) for part in text.split(",")])
    except ValueError:
        raise SpatialDynError(f"{option} is {literal(text)}, expected numbers separated by commas") from None
    if len(x) != count:
        raise SpatialDynError(f"{option} has {len(x)} numbers, expected {count}")
    return x


def text_of(option: str, path: str) -> str:
    """The text of a file. Raises SpatialDynError."""
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SpatialDynError(f"{option} is {literal(path)}, which cannot be read: {error}") from None
