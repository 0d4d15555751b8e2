"""Models and results in notebooks, as HTML. Names that come from a file are escaped."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..accuracy.findings import Diagnosis
from ..accuracy.requirement import COLUMNS, Requirement
from ..accuracy.results import EACH_JOINT, FRONT, Recommendation, Tradeoff
from ..bodies.kinds import kind_of
from ..errors import SpatialDynError
from ..model.model import Model
from ..simulation.rollout_result import Rollout
from ..simulation.trajectory import Trajectory
from ..validate.rows import Comparison, Row
from .coordinates import SYMBOLS, UNITS, Coordinate, coordinates
from .markup import block, bullets, code, facts, folded, heading, line, table
from .robot_rows import neutral_outside, tree_rows
from .tradeoff_plots import cost

if TYPE_CHECKING:
    from ..lagrangian.symbolic_manipulator import SymbolicManipulator

LINKS = 60  # of a robot in a notebook
SMALL = 3  # freedoms up to which M is shown in symbols

# --- robots ---------------------------------------------------------------------------------------------------


def model_html(model: Model) -> str:
    """Size, tree with masses and limits, and oddities of the source."""
    return block(heading(model_line(model)), tree_table(model, LINKS), oddities(model))


def model_line(model: Model) -> str:
    """A robot in one line."""
    return (
        f"{model.name}: {model.options.root} root, {model.nv} freedoms (nq {model.nq}), "
        f"{len(model.robot.links)} links, {model.total_mass:.6g} kg that move"
    )


def tree_table(model: Model, most: int) -> str:
    """A row per link: its mass, joint, limits of position, velocity and effort."""
    return table(
        ("link", "kg", "joint", "kind", "v", "range", "velocity", "effort"),
        ([*row, *_limits(model, row[2])] for row in tree_rows(model)),
        numbers=(1, 4, 5, 6, 7), most=most,
    )  # fmt: skip


def _limits(model: Model, joint: str) -> tuple[str, str]:
    """Limits of velocity and effort of a joint of one freedom, empty where there are none."""
    found = model.joint(joint) if joint in model.names else None
    if found is None or found.nv != 1:
        return "", ""
    slides = kind_of(found.kind).motion == "slide"
    velocity, effort = model.velocity_limit[found.idx_v], model.effort_limit[found.idx_v]
    return (
        f"{velocity:.4g} {UNITS['v'][slides]}" if np.isfinite(velocity) else "",
        f"{effort:.4g} {UNITS['tau'][slides]}" if np.isfinite(effort) else "",
    )


def oddities(model: Model, unfolded: bool = False) -> str:
    """The oddities of a robot's source and of its neutral configuration, or a line that there are none."""
    lines = [*(f"neutral is outside the limits: {x}" for x in neutral_outside(model)), *model.robot.notes]
    title = f"{len(lines)} odd thing{'s' if len(lines) > 1 else ''} about the robot"
    return folded(title, bullets(lines), unfolded) if lines else line("nothing is odd about the robot")


# --- motions --------------------------------------------------------------------------------------------------


def trajectory_html(run: Trajectory) -> str:
    """The simulation, and the first, last and extreme values of its coordinates."""
    return block(heading(f"trajectory of {run.robot}"), facts(trajectory_facts(run)), trajectory_table(run, 24))


def trajectory_facts(run: Trajectory) -> dict[str, str]:
    """The simulation in words."""
    if not len(run):
        return {"method": run.method, "samples": "0"}
    change = run.energy - run.energy[0]
    return {
        "method": f"{run.method}, dt {run.dt:g} s",
        "samples": f"{len(run)} of {run.t[0]:g} to {run.t[-1]:g} s" + (", interrupted" if run.interrupted else ""),
        "energy T + V": f"{run.energy[0]:.9g} J, changes by {change[-1]:.3g} J, by at most {abs(change).max():.3g} J",
    }


def trajectory_table(run: Trajectory, most: int) -> str:
    """A row per column of q, v and tau."""
    if not len(run):
        return ""
    headings = ("", "unit", "first", "last", "least", "largest", "limits")
    still = line("no torque acts") if not np.nan_to_num(run.tau).any() else ""
    return table(headings, _columns(run), numbers=(2, 3, 4, 5, 6), most=most) + still


def _columns(run: Trajectory) -> Iterator[list[str]]:
    for name in ("q", "v", *["tau"] * bool(np.nan_to_num(run.tau).any())):
        values: NDArray[np.float64] = getattr(run, name)
        for x in coordinates(run.model, name, values.shape[1]):
            y = values[:, x.column]
            ends = (y[0], y[-1], y.min(), y.max())
            beyond = "beyond " * bool(y.min() < x.lower or y.max() > x.upper)
            label = f"{SYMBOLS[name]} {x.label}" if x.joint else x.label
            yield [label, x.unit, *(f"{v:.5g}" for v in ends), beyond + _range(x)]


def _range(x: Coordinate) -> str:
    return f"{x.lower:.4g} .. {x.upper:.4g}" if np.isfinite(x.lower) or np.isfinite(x.upper) else ""


def rollout_html(found: Rollout) -> str:
    """Numbers of samples and steps, and quantiles of the last recorded state."""
    batch = found.q if found.t.ndim == 0 else found.q[..., -1:, :].reshape(-1, found.q.shape[-1])
    last = np.atleast_2d(batch)
    lost = int((~np.isfinite(found.q)).reshape(len(found.q), -1).any(axis=1).sum()) if found.q.ndim == 3 else 0
    steps = "the last state only" if found.t.ndim == 0 else f"{found.q.shape[-2]} recorded"
    at = f"{float(np.ravel(found.t)[-1]):g} s" if found.t.size else "0 s"
    about = facts({
        "samples": f"{len(last)}" + (f", {lost} of them not finite" if lost else ""), "states": f"{steps}, to {at}",
        "numbers": str(found.q.dtype),
    })  # fmt: skip
    last = last[np.isfinite(last).all(axis=1)]
    if not last.size:
        return block(heading(f"rollout of {found.model.name}"), about)
    low, middle, high = np.percentile(last.astype(float), (5, 50, 95), axis=0)
    rows = [
        [f"q {x.label}", x.unit, *(f"{y[x.column]:.5g}" for y in (low, middle, high)), _range(x)]
        for x in coordinates(found.model, "q", last.shape[1])
    ]
    headings = (f"at {at}", "unit", "5 %", "median", "95 %", "limits")
    return block(heading(f"rollout of {found.model.name}"), about, table(headings, rows, numbers=(2, 3, 4, 5), most=24))


# --- accuracy -------------------------------------------------------------------------------------------------


def tradeoff_html(found: Tradeoff) -> str:
    """The table of options."""
    return block(heading(found.head), options_table(found), line(FRONT), line(EACH_JOINT))


def options_table(found: Tradeoff, most: int = 80) -> str:
    """A row per option, as in ``str``, in the unit of the plot."""
    scale, unit = cost(found)
    rows = [[*row[:5], f"{scale * x.ns:.4g}", row[6]] for row, x in zip(found.rows(), found.options, strict=True)]
    return table(("", "option", "error", "bound", "worst joint", unit, "code"), rows, numbers=(2, 3, 4, 5), most=most)


def recommendation_html(found: Recommendation) -> str:
    """The line to write, the reason, and the table from which it was chosen."""
    of = f"{found.tradeoff.task} of {found.tradeoff.model} within {found.tolerance:g}"
    reasons = bullets(found.why.split("; "))
    return block(heading(of), code(found.code), reasons, folded("all options", tradeoff_html(found.tradeoff)))


def requirement_html(found: Requirement) -> str:
    """The table of parts, the conclusion, and the lines to write."""
    rows = table(COLUMNS, found.table(), numbers=(2, 3, 4))
    return block(heading(found.head), rows, line(found.foot), code(found.code))


def diagnosis_html(found: Diagnosis) -> str:
    """Findings, digits and the stiffest joint."""
    return block(heading(f"{found.name}: {found.severity}"), findings_table(found), digits_tables(found))


def findings_table(found: Diagnosis) -> str:
    """A row per finding, the worst first."""
    if not found.findings:
        return line("no findings")
    rows = [[f.severity, f.kind, f.link, f.message, f.remedy] for f in found.findings]
    return table(("severity", "kind", "link", "finding", "remedy"), rows)


def digits_tables(found: Diagnosis) -> str:
    """The condition of M, digits of calls, and the stiffest joint."""
    about = {f"condition of M, scaled, {where}": f"{x:.2g}" for where, x in found.condition.items()}
    if found.stiffest is not None:
        s = found.stiffest
        limit = f"dt {s.dt:.3g} s" if s.rate > 0.0 else f"dt = {2.0 * s.inertia:.3g} / damping"
        slides = found.subject is not None and kind_of(found.subject.joint(s.joint).kind).motion == "slide"
        unit = "kg m² | kg" if found.subject is None else "kg" if slides else "kg m²"
        about["stiffest joint"] = f"{s.joint} moves {s.inertia:.3g} {unit}: explicit Euler is stable to {limit}"
    parts = [facts(about)]
    if found.digits:
        rows = [
            [m, *(f"{d[k]:.1f}" if k in d else "" for k in ("float64", "float32"))] for m, d in found.digits.items()
        ]
        title = f"digits of forward dynamics, the worst of {found.states} states"
        parts.append(table((title, "float64", "float32"), rows, numbers=(1, 2)))
    if found.programs:
        rows = [[call, f"{d['single']:.1f}", f"{d['batch']:.1f}"] for call, d in found.programs.items()]
        parts.append(table(("digits of programs", "single", "batch"), rows, numbers=(1, 2)))
    return "".join(parts)


def comparison_html(found: Comparison) -> str:
    """A row per call: its error, the bound, and times if they were taken."""
    agreed = f"agrees with Pinocchio in {len(found.rows)} rows" if found.ok else "DISAGREES with Pinocchio"
    timed = any(row.ours_us for row in found.rows)
    headings = ["", "call", "error", "bound", *["ours µs", "Pinocchio µs", "ratio"] * timed, "note"]
    rows = [
        [
            "" if row.ok else "✗", row.call, _figure(row.error), _figure(row.bound),
            *[_time(row.ours_us), _time(row.pin_us), _time(row.ratio)] * timed, row.note,
        ]
        for row in found.rows
    ]  # fmt: skip
    of = f"{found.robot}, {found.root} root, nv {found.nv}, {found.samples} states: {agreed}"
    return block(heading(of), table(headings, rows, numbers=range(2, 7 if timed else 4)), *_failed(found.rows))


def _failed(rows: tuple[Row, ...]) -> list[str]:
    bad = [row.call for row in rows if not row.ok]
    return [line(f"beyond its bound: {', '.join(bad)}")] if bad else []


def _figure(x: float | None) -> str:
    return "-" if x is None else "0" if x == 0.0 else f"{x:.1e}"


def _time(x: float | None) -> str:
    return "" if x is None else f"{x:.2f}"


# --- symbols --------------------------------------------------------------------------------------------------


def symbols_html(s: SymbolicManipulator) -> str:
    """The robot, the symbols and their meanings, and M of a small robot."""
    of = f"{s.model.name} in symbols: {s.model.nv} freedoms"
    rows: list[list[str]] = [
        [str(x), s.meaning.get(x, ""), "" if number is None else f"{float(number):.6g}"]
        for x, number in s.parameters.items()
    ]
    parts = [table(("symbol", "meaning", "value"), rows, numbers=(2,), most=60)] if rows else [
        line("all numbers are the robot's own, as fractions")
    ]  # fmt: skip
    parts.append(bullets(map(str, s.assumptions)))
    if 0 < s.model.nv <= SMALL:
        try:
            parts.append(f"<div>$$M(q) = {escape(s.latex('M'))}$$</div>")
        except SpatialDynError:
            parts.append(line("M is beyond the limit of products"))
    return block(heading(of), *parts)
