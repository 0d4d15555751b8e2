"""``spatialdyn view ROBOT``: a robot in the browser, with a slider for each joint, or in a page to keep."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from ..calls.files import check_ending
from ..pictures.markup import PAGE_FILES
from ..pictures.robot_shapes import SHAPES
from ..pictures.stage import has_screen, viser_module
from ..pictures.view import view
from ..pictures.viewer import View
from ..simulation.scene import Scene
from .robots import add_package_dirs, add_robot, load, parse_numbers, text_of
from .targets import check_file


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    add_robot(parser)
    parser.add_argument("--q", metavar="Q", help="joint positions, separated by commas (default: neutral)")
    parser.add_argument("--shapes", choices=SHAPES, default="visual", help="what is drawn (default: visual)")
    parser.add_argument(
        "--scene", metavar="FILE", help="what acts on the robot, drawn too: a TOML file, see sd.Scene.from_toml"
    )
    add_package_dirs(parser)
    parser.add_argument("--save", metavar="FILE", help="write one page that needs no network (.html), open none")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    check_page("--save", arguments.save)
    text = "" if arguments.scene is None else text_of("--scene", arguments.scene)
    model = load(arguments, mimic="[[constraint]]" not in text)
    acts = Scene.from_toml(model, text) if text else model
    q = parse_numbers("--q", arguments.q, model.nq)
    with notes():
        shown = view(acts, q, shapes=arguments.shapes, package_dirs=arguments.package_dir, open=False)
    if arguments.save:
        print(f"saved   {shown.save(arguments.save)}")
    else:
        keep_open(shown)
    return 0


def check_page(option: str, path: str | None) -> None:
    """Raise SpatialDynError unless a page can be written to a file of this name, and viser is there; None passes."""
    if path is not None:
        check_ending(option, path, PAGE_FILES)
    check_file(option, path)
    viser_module()


@contextmanager
def notes() -> Iterator[None]:
    """Print warnings as notes."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for warning in caught:
        print(f"note    {warning.message}")


def keep_open(scene: View) -> None:
    """Open a tab of the browser and wait for Ctrl-C, which raises KeyboardInterrupt."""
    how = "Ctrl-C ends it" if has_screen() else "open it in a browser; Ctrl-C ends it"
    print(f"shown   {scene.url} ({how})", flush=True)
    try:
        if has_screen():
            scene.open_tab()
        scene.wait()
    finally:
        scene.close()
