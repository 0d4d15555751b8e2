"""``spatialdyn export ROBOT``: calls, control laws and steps as C for a controller's chip."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from ..calls.specialize import specialize
from ..embedded.export import export
from ..embedded.functions import LAWS, call_of
from ..errors import SpatialDynError, literal
from ..model.model import Model
from ..recursions import SPECS
from ..simulation.scene import Scene
from .printing import shown
from .robots import add_quiet, add_robot, load, text_of


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    add_robot(parser)
    parser.add_argument(
        "--calls", default="rnea", metavar="NAMES",
        help=f'calls, separated by commas, "step" or laws: {", ".join(LAWS)} (default: rnea)',
    )  # fmt: skip
    parser.add_argument("--to", required=True, metavar="DIR", help="folder of the files, made if it is not there")
    parser.add_argument("--name", default="robot", help="of the files, and before the names of functions")
    parser.add_argument("--float", action="store_true", help="in float, not double")
    parser.add_argument("--frame", metavar="FRAME", help="of calls of a frame")
    parser.add_argument("--reference", default="local", metavar="R", help="of those calls (default: local)")
    parser.add_argument("--scene", metavar="FILE", help="what acts in a step, as Scene.to_toml writes it")
    add_quiet(parser)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    dtype = np.float32 if arguments.float else np.float64
    names = [name.strip() for name in arguments.calls.split(",")]
    if len(set(names)) < len(names):
        raise SpatialDynError(f"--calls has {literal(arguments.calls)}, expected each call once")
    with shown("exporting", "functions", arguments.quiet):
        model = load(arguments, mimic=True)
        scene: Model | Scene = model
        if arguments.scene is not None:
            scene = Scene.from_toml(model, text_of("--scene", arguments.scene))
        wanted: dict[str, Any] = {}
        for name in names:
            call = call_of(name)
            if name in SPECS and any(x.name == "frame" or x.shape == (4, 4) for x in SPECS[name].present if x.static):
                call = specialize(model, call, dtype, frame=arguments.frame, reference=arguments.reference)  # type: ignore[arg-type]
            wanted[name] = call
        made = export(scene, wanted, arguments.to, arguments.name, dtype)
    for path in made:
        print(path.relative_to(Path(arguments.to)))
    return 0
