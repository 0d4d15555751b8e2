"""The robot that a command is about: its argument, and its Model."""

from __future__ import annotations

import argparse
import warnings

from ..model.model import Model
from ..urdf.load import load_urdf

ROBOT = "path of a URDF, or one of the names that `spatialdyn info` lists"
ROOTS = ("fixed", "floating")


def add_robot(parser: argparse.ArgumentParser) -> None:
    """The arguments ROBOT and --root, of a command about one robot."""
    parser.add_argument("robot", metavar="ROBOT", help=ROBOT)
    add_root(parser)


def add_root(parser: argparse.ArgumentParser) -> None:
    """The argument --root."""
    parser.add_argument("--root", choices=ROOTS, default="fixed", help="what the root link does (default: fixed)")


def load(arguments: argparse.Namespace) -> Model:
    """The model, without warnings: ``info`` tells what is odd about the file. Raises UrdfError as ``load_urdf``."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load_urdf(arguments.robot, root=arguments.root)
