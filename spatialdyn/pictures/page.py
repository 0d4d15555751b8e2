"""Reports: one HTML page of a result, without links to the network, with the code to compute the result again."""

from __future__ import annotations

import base64
import platform
import string
import sys
import warnings
from datetime import datetime, timezone
from html import escape
from importlib import metadata
from typing import TYPE_CHECKING, Any

import numpy as np

from ..accuracy.findings import Diagnosis
from ..accuracy.results import EACH_JOINT, FRONT, Tradeoff
from ..calls.files import check_ending
from ..engines.programs.llvm import host_cpu
from ..errors import SpatialDynError, pip_install
from ..model.model import Model
from ..simulation.trajectory import Trajectory
from ..urdf.load import robot_names
from .figures import need_matplotlib, svg_of
from .markup import PAGE_FILES, bullets, code, facts, line
from .notebook import (
    digits_tables,
    findings_table,
    model_line,
    oddities,
    options_table,
    trajectory_facts,
    trajectory_table,
    tree_table,
)
from .robot_rows import kinds_of
from .tradeoff_plots import plot_tradeoff
from .trajectory_plots import plot_trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LINKS = 500  # rows of a tree
JOINTS = 12  # freedoms up to which the torques and phases are drawn too

PAGE = string.Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
body { font: 15px/1.45 system-ui, sans-serif; color: #1a1a1a; background: #fff; max-width: 62rem; margin: 2rem auto;
  padding: 0 1rem }
h1 { font-size: 1.5rem; margin-bottom: 0.2rem }
h2 { font-size: 1.1rem; margin: 2rem 0 0.5rem; border-bottom: 1px solid #ccc }
img { max-width: 100%; display: block }
iframe { width: 100%; box-sizing: border-box; height: 30rem; border: 1px solid #ccc }
pre { background: #f5f5f5; padding: 0.7rem; overflow-x: auto }
section { overflow-x: auto }
.note { color: #666 }
@media print { iframe { display: none } body { margin: 0 } }
</style>
</head>
<body>
<h1>$title</h1>
<p class="note">$subtitle</p>
$sections
</body>
</html>
""")


def report_trajectory(run: Trajectory, path: Any) -> None:
    """``Trajectory.report``."""
    _ready(path)
    if not len(run):
        raise SpatialDynError(f"trajectory of {run.robot} is empty, expected samples to report")
    sections = [
        ("The run", facts({**trajectory_facts(run), **made_by()})),
        *_robot(run.model, "The trajectory was loaded without its model, so there is no tree and no player."),
        *([] if run.model is None else [("The motion", player(run))]),
        ("Plots", "".join(map(picture, _plots(run)))),
        ("Numbers", trajectory_table(run, LINKS)),
        ("Again", code(again_trajectory(run))),
    ]
    write(path, f"{run.robot}: {run.method}, {run.t[-1] - run.t[0]:g} s", "simulation", sections)


def report_tradeoff(found: Tradeoff, path: Any) -> None:
    """``Tradeoff.report``."""
    _ready(path)
    about = {
        "task": found.task.replace("_", " "),
        "states": str(found.states),
        "samples a call": str(found.batch) if found.batch else "",
        "motion": f"{found.duration:g} s" if found.duration else "",
        "reference": found.truth,
    }
    asked = f"batch={found.batch}" if found.batch else f"duration={found.duration!r}"
    sections = [
        ("The trade", facts({**about, **made_by()})),
        *_robot(found.subject, "The model is not at hand."),
        ("Error against cost", picture((f"error against cost of {found.task}", plot_tradeoff(found, None, None)))),
        ("Numbers", options_table(found, LINKS) + line(FRONT) + line(EACH_JOINT)),
        ("Again", code(f"{_load(found.subject, found.model)}\nsd.trade(model, {found.task!r}, {asked})")),
    ]
    what = f"simulations of {found.duration:g} s" if found.duration else found.task.replace("_", " ")
    write(path, f"{found.model}: {what}", "error against cost", sections)


def report_diagnosis(found: Diagnosis, path: Any) -> None:
    """``Diagnosis.report``."""
    _ready(path)
    sections = [
        ("Findings", findings_table(found)),
        ("Digits", digits_tables(found)),
        *_robot(found.subject, "The model is not at hand."),
        ("Made by", facts(made_by())),
        ("Again", code(f"{_load(found.subject, found.name)}\nsd.diagnose(model)")),
    ]
    worst = {"ok": "no findings"}.get(found.severity, f"the worst finding: {found.severity}")
    write(path, f"{found.name}: diagnosis", worst, sections)


# --- parts ----------------------------------------------------------------------------------------------------


def _plots(run: Trajectory) -> list[tuple[str, Figure]]:
    """Figures with their names, only those that have content for this run."""
    wanted = [("positions and velocities", ["q", "v"]), ("energy", ["energy"])]
    if np.nan_to_num(run.tau).any():
        wanted.insert(1, ("torques", ["tau"]))
    model = run.model
    if model is not None:
        bounded = np.isfinite(model.upper - model.lower).any() or np.isfinite(model.velocity_limit).any()
        wanted += [("limits", ["limits"])] * bool(bounded)
        single = any(joint.nv == 1 for joint in model.joints[1:])
        wanted += [("phases", ["phase"])] * (single and model.nv <= JOINTS)
    touches = run.scene is not None and run.scene.contacts is not None and bool(len(run.scene.contacts))
    wanted += [("contacts", ["contacts"])] * (touches and run.contacts is not None)
    return [(name, plot_trajectory(run, what, None, None, None)) for name, what in wanted]


def picture(named: tuple[str, Figure]) -> str:
    """A figure as an SVG inside the page, apart from the page's own elements."""
    name, figure = named
    data = base64.b64encode(svg_of(figure).encode()).decode()
    return f'<img alt="{escape(name)}" src="data:image/svg+xml;base64,{data}">'


def player(run: Trajectory) -> str:
    """The motion in three dimensions, in a frame of its own, or the reason why it is missing."""
    try:
        import viser  # noqa: F401

        from .view import view
    except ImportError:
        return f'<p class="note">The player needs viser: {pip_install("view")}, and make this report again.</p>'
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of meshes that are missing: the page says it
            scene = view(run)
        try:
            inner: str = scene.html()
        finally:
            scene.close()
    except SpatialDynError as error:
        return f'<p class="note">{escape(f"There is no player: {error}")}</p>'
    lost = line("boxes stand for meshes that are not drawn:") + bullets(scene.missing) if scene.missing else ""
    lost += line("of meshes that are broken in part the rest is drawn:") + bullets(scene.faulty) if scene.faulty else ""
    return f'<iframe sandbox="allow-scripts" title="player" srcdoc="{escape(inner, quote=True)}"></iframe>{lost}'


def _robot(model: Model | None, without: str) -> list[tuple[str, str]]:
    if model is None:
        return [("The robot", f'<p class="note">{escape(without)}</p>')]
    joints = f"{len(model.robot.joints)} joints: {kinds_of(model.robot.joints)}"
    return [
        (
            "The robot",
            line(model_line(model)) + line(joints) + tree_table(model, LINKS) + oddities(model, unfolded=True),
        )
    ]


def made_by() -> dict[str, str]:
    """The date, the versions and the machine of a result."""
    version = sys.modules[__name__.partition(".")[0]].__version__
    processor, _, width, fma = host_cpu.host()
    return {
        "made": datetime.now(timezone.utc).astimezone().strftime("%Y-%m-%d %H:%M %Z"),
        "by": f"spatialdyn {version}, Python {platform.python_version()}, NumPy {np.__version__}, "
        f"Numba {metadata.version('numba')}",
        "on": f"{platform.system()} {platform.machine()}, {processor}, vectors of {width} bytes"
        + (", fused multiply-add" if fma else ""),
    }


def again_trajectory(run: Trajectory) -> str:
    """Lines of Python that compute a trajectory again."""
    lines = [_load(run.model, run.robot)]
    text = run.scene.to_toml() if run.scene is not None else ""
    acts = "scene" if text.strip() else "model"
    if text.strip():
        lines.append(f"scene = sd.Scene.from_toml(model, {text!r})")
    torque, held = "", run.tau[0]
    if np.array_equal(run.tau, np.broadcast_to(held, run.tau.shape)):
        torque = f", torque={held.tolist()}" if held.any() else ""
    else:
        lines.append("torque = ...  # torques changed over time, by a function or an array that the run does not keep")
        torque = ", torque=torque"
    every = max(1, round(float(run.t[1] - run.t[0]) / run.dt)) if len(run) > 1 else 1
    lines += [
        f"q0 = {run.q[0].tolist()}",
        f"v0 = {run.v[0].tolist()}",
        f"run = sd.simulate({acts}, q0, v0, {float(run.t[-1] - run.t[0])!r}, {run.dt!r}, {run.method!r}{torque}, "
        f"record={every if run.contacts is None else (every, 'contacts')})",
    ]
    return "\n".join(lines)


def _load(model: Model | None, name: str) -> str:
    """The lines that load a model, and check that it is the same."""
    lines = ["import spatialdyn as sd", ""]
    if model is None:
        return "\n".join([*lines, f"model = sd.load_urdf({name!r})  # by its name: the file is not known"])
    options, source = model.options, model.robot.source
    named = next((short for short, path in robot_names().items() if source and str(path) == source), None)
    given = [repr(named or source or name)]
    given += [f"root={options.root!r}"] * (options.root != "fixed")
    given += [f"gravity={tuple(options.gravity)!r}"] * (tuple(options.gravity) != (0.0, 0.0, -9.81))
    given += [f"continuous={options.continuous!r}"] * (options.continuous != "angle")
    given += ["mimic=True"] * bool(options.mimic)
    note = "" if source else "  # by its name, or from wherever it was loaded"
    lines += [f"model = sd.load_urdf({', '.join(given)}){note}"]
    return "\n".join([*lines, f"assert model.key == {model.key!r}  # else it is another robot"])


def _ready(path: Any) -> None:
    """Raise SpatialDynError without matplotlib, or if path names no page."""
    need_matplotlib()
    check_ending("path", path, PAGE_FILES)


def write(path: Any, title: str, subtitle: str, sections: list[tuple[str, str]]) -> None:
    """Write the page. Raises SpatialDynError if the file cannot be written."""
    made = "\n".join(f"<section><h2>{escape(name)}</h2>{inner}</section>" for name, inner in sections)
    text = PAGE.substitute(title=escape(title), subtitle=escape(subtitle), sections=made)
    try:
        if hasattr(path, "write"):
            path.write(text)
        else:
            with open(path, "w", encoding="utf-8") as file:
                file.write(text)
    except (OSError, ValueError) as error:  # the latter of a name that is none
        raise SpatialDynError(f"report cannot be written to {path}: {getattr(error, 'strerror', error)}") from error
