"""The list of examples, and what all of them share: how they run, packages that may be missing, pictures."""

from __future__ import annotations

import argparse
import difflib
import inspect
import pkgutil
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from spatialdyn.calls.files import check_ending
from spatialdyn.calls.progress import messages
from spatialdyn.errors import SpatialDynError, pip_install
from spatialdyn.pictures.figures import COLOURS, ENDINGS, FILE_DPI, new_figure, tidy
from spatialdyn.waiting import watch

SHARED = {"gallery", "optimal_control"}  # by examples, and none itself
CHAPTER = "Lagrange's and Hamilton's mechanics and joint-space dynamics, the text that this library began with"
ORDER = (  # in which a reader may take them; test_gallery.py holds it complete
    "first_steps", "arms_in_symbols", "gravity_compensation", "inverse_kinematics", "grid_of_poses",
    "pd_with_gravity", "computed_torque_and_pd_plus", "what_a_law_leaves_out", "feeling_a_push", "pressing_on_a_wall",
    "learning_masses", "double_pendulum", "stick_slip", "energy_ledger", "spinning_top", "principles",
    "bouncing_ball", "box_on_an_incline", "falling_quadruped", "space_robot", "trotting_quadruped",
    "four_bar_and_slider_crank", "sleigh_and_rolling_disc", "rolling_is_no_variation", "cart_pole_lqr",
    "swing_up_by_energy", "acrobot_by_energy", "inertia_wheel_pendulum", "swing_up_lqr", "ilqr", "standing_lqr",
    "panda_identification", "pushed_while_standing", "payload_identification", "friction_of_a_joint",
    "payloads_on_lanes", "payload_study", "series_elastic_joint", "rotor_on_a_leg", "rotors_of_a_geared_arm",
    "what_a_scene_requires", "standing_or_trotting", "price_of_a_digit", "error_bar_of_a_torque", "own_loop",
    "many_processes", "mppi_on_lanes", "gradient_of_a_design", "friction_network", "c_export", "casadi_export",
    "porting_a_pinocchio_script", "vector_environment", "exercise_1_numbers", "exercise_3_pendulum",
    "exercise_4_spatial_arm", "exercise_5_hamilton", "exercise_7_two_ways_to_coriolis", "last_exercise_1_christoffel",
    "last_exercise_2_legendre", "last_exercise_3_mass_matrix", "last_exercise_5_single_body", "troubleshooting",
)  # fmt: skip
OPTIONS = {
    "quick": "quick setting",
    "long": "long setting",
    "save": "picture",
    "robot": "robot to choose",
}  # of the main functions


def names() -> list[str]:
    """The examples, in the order in which a reader may take them."""
    found = {module.name for module in pkgutil.iter_modules([str(Path(__file__).parent)])} - SHARED
    return sorted(found, key=lambda name: (ORDER.index(name) if name in ORDER else len(ORDER), name))


def module(name: str) -> ModuleType:
    """The module of an example. Raises SpatialDynError, with close names, if there is none."""
    if name not in names():
        close = difflib.get_close_matches(name, names(), 3, 0.4)
        hint = f"; close names are {', '.join(close)}" if close else ""
        raise SpatialDynError(f'example is "{name}", expected one that `spatialdyn example` lists{hint}')
    return import_module(f"spatialdyn.examples.{name}")


def title(name: str) -> str:
    """The first line of an example."""
    return (inspect.getdoc(module(name)) or "").partition("\n")[0]


def checked(name: str, main: Callable[..., Any], **given: Any) -> dict[str, Any]:
    """The options that were given, of quick, save and robot; None and False count as not given.

    Raises SpatialDynError naming one that the example does not have, or a folder that is not there
    """
    options = {option: value for option, value in given.items() if value not in (None, False)}
    for option in options:
        if option not in inspect.signature(main).parameters:
            raise SpatialDynError(f"--{option} was given, expected none: {name} has no {OPTIONS[option]}")
    if "save" in options:
        picture()  # before a long run: Matplotlib may be missing
        check_ending("--save", options["save"], ENDINGS)
        if not Path(options["save"]).parent.is_dir():
            raise SpatialDynError(f"--save is {options['save']!r}, expected a name in a folder that is there")
    return options


def start(main: Callable[..., Any], argv: Sequence[str] | None = None) -> None:
    """Run an example as a program: its options are the arguments of its main function."""
    home = sys.modules[main.__module__]
    name = Path(str(home.__file__)).stem
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(prog=f"spatialdyn.examples.{name}", description=home.__doc__, formatter_class=raw)
    add_options(parser, main)

    def say(text: str) -> None:
        print(f"{name}: {text}", file=sys.stderr, flush=True)

    try:
        with messages(say), watch.call("the example"):
            main(**checked(name, main, **vars(parser.parse_args(argv))))
    except SpatialDynError as error:
        sys.exit(f"{name}: {error}")


def add_options(parser: argparse.ArgumentParser, main: Callable[..., Any] | None = None) -> None:
    """Add --quick, --long, --save and --robot, those that a main function has, all by default."""
    has = OPTIONS if main is None else inspect.signature(main).parameters
    if "quick" in has:
        parser.add_argument("--quick", action="store_true", help="a smaller run")
    if "long" in has:
        parser.add_argument("--long", action="store_true", help="a larger run, of minutes")
    if "save" in has:
        parser.add_argument("--save", metavar="FILE", help="write its picture to a PNG, SVG or PDF file")
    if "robot" in has:
        parser.add_argument("--robot", metavar="ROBOT", help="path of a URDF, or the name of a robot")


def need(package: str, extra: str) -> Any:
    """A package, imported. Raises SpatialDynError with the line that installs it if it is missing."""
    try:
        return import_module(package)
    except ImportError:
        name = package.partition(".")[0]
        raise SpatialDynError(f"{name} is not installed; {pip_install(extra)}") from None


def picture(columns: int = 1, width: float = 7.0, height: float = 4.0) -> tuple[Any, Any]:
    """A Matplotlib figure and its axes, several if there are columns, in the colours of all plots."""
    figure = new_figure(width, height)
    axes = figure.subplots(1, columns)
    for one in [axes] if columns == 1 else axes:
        one.set_prop_cycle(color=COLOURS)
        tidy(one)
    return figure, axes


def write(figure: Any, path: str) -> None:
    """Write a figure to a file. Raises SpatialDynError if that fails."""
    try:
        figure.savefig(path, dpi=FILE_DPI)
    except (OSError, ValueError) as error:
        raise SpatialDynError(f"--save is {path!r}, which cannot be written: {error}") from error
    print(f"drawn {path}")
