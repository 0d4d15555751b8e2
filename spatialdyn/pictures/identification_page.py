"""``Identified.report``: parameters with intervals, residuals, unobserved parameters, and another motion."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..identification.identified import COLUMNS, Identified, Validation
from ..identification.recording import Recording
from ..identification.unknowns import freedoms_of
from .figures import FAINT, dash, need_matplotlib, new_figure, tidy
from .markup import bullets, facts, folded, heading, line, table
from .page import LINKS, _ready, made_by, picture, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

JOINTS = 8  # freedoms drawn
POINTS = 1500  # of a curve
NAMED = 0.95  # correlation of two parameters that is listed


def report_identified(found: Identified, path: Any, validation: Recording | None) -> None:
    """``Identified.report``."""
    _ready(path)
    judged = None if validation is None else found.validate(validation)
    sections = [
        ("The fit", facts({**_facts(found), **made_by()}) + _notes(found)),
        ("Parameters", picture(("base parameters with 95 % intervals", plot_intervals(found))) + _table(found)),
        ("Residuals", _residuals(found)),
        ("What the recording shows", _seen(found)),
        *([] if not found.eigenvalues else [("Inertias", _inertias(found))]),
        *([] if judged is None else [("Another motion", _validation(found, judged))]),
    ]
    kind = ", inertias that bodies can have" if _all_positive(found) else ", some inertias that no body has"
    write(path, f"{found.start.name}: identification", found.method + kind * bool(found.eigenvalues), sections)


def _facts(found: Identified) -> dict[str, str]:
    settings = found.settings
    late = "" if not found.delay and not found.delay_deviation else f"{1e3 * found.delay:.4g} ms"
    late += f" ± {1.96e3 * found.delay_deviation:.2g} ms" if found.delay_deviation else ""
    return {
        "robot": found.start.name,
        "method": found.method + (f", {found.steps} steps" if found.steps else ""),
        "equations": f"{int(found.rows.sum())} of form {settings.form}"
        + (f", means of {settings.window}" if settings.window > 1 else ""),
        "torques": {None: "of their times", "after": "held until the next sample", "before": "held up to their sample"}[
            settings.hold
        ],
        "delay": late,
        "base parameters": f"{found.base.rank} of {len(found.names)}",
        "condition": f"{found.condition:.3g}",
    }


def _notes(found: Identified) -> str:
    return heading("Notes") + bullets(found.notes) if found.notes else line("nothing is odd about the recording")


def _table(found: Identified) -> str:
    rows = found.table()
    text = line(
        "A name with + n stands for a sum, as torques depend on that alone. Units are kg, kg m and kg m² of bodies, "
        "N m and N m s of turning joints. σ % is the deviation's share of the value, model the value that the "
        "identification began from."
    )
    sums = bullets((found.base.text(k) for k in range(found.base.rank)), most=LINKS)
    return table(COLUMNS, rows, numbers=(1, 2, 3, 4), most=LINKS) + text + folded("The sums", sums)


def _residuals(found: Identified) -> str:
    names = _freedoms(found)
    rows = [
        [
            name,
            str(n),
            f"{s:.4g}",
            "-" if math.isnan(p) else "yes" if p >= 0.01 else "no",
            "-" if math.isnan(p) else f"{p:.2g}",
        ]
        for name, n, s, p in zip(names, found.rows.tolist(), found.noise.tolist(), found.white.tolist(), strict=True)
    ]
    drawn = line("Residuals over time [N m | N]") if len(found.t) else ""
    drawn += picture(("residuals over time", plot_residuals(found))) if len(found.t) else ""
    return table(("freedom", "equations", "deviation", "white", "probability"), rows, numbers=(1, 2, 4)) + drawn


def _seen(found: Identified) -> str:
    parts = [picture(("singular values and correlation", plot_information(found)))]
    poor = found.poor
    parts.append(
        heading("Hardly seen: a deviation over 30 % of the value, or no motion of it") + line(", ".join(poor))
        if poor
        else line("each base parameter is seen")
    )
    if found.removed:
        parts.append(heading("Removed, the worst first") + bullets(found.removed))
    if found.bounds:
        parts.append(heading("Held at 0") + bullets(found.bounds))
    C, labels = abs(found.correlation), found.base.labels
    pairs = [(C[i, j], i, j) for i in range(len(C)) for j in range(i) if C[i, j] > NAMED]
    listed = [f"{labels[j]} and {labels[i]}: {c:.3f}" for c, i, j in sorted(pairs, reverse=True)]
    return "".join(parts) + (heading(f"Correlated above {NAMED}") + bullets(listed, most=20) if listed else "")


def _inertias(found: Identified) -> str:
    rows = [[name, *(f"{x:.4g}" for x in values), "yes" if values[0] > 0.0 else "no"]
            for name, values in found.eigenvalues.items()]  # fmt: skip
    text = "Eigenvalues of each body's pseudo-inertia; a body exists if all are above 0."
    return line(text) + table(("body", "least", "", "", "largest", "exists"), rows, numbers=(1, 2, 3, 4))


def _validation(found: Identified, judged: Validation) -> str:
    names = _freedoms(found)
    rows = [[name, f"{r:.4g}", f"{n:.4g}", f"{q:.3g}", f"{100.0 * s:.2g} %"] for name, r, n, q, s in zip(
        names, judged.rms, judged.noise, judged.ratio, judged.share, strict=True)]  # fmt: skip
    head = ("freedom", "rms of the difference", "noise of the fit", "ratio", "of the torque's deviation")
    drawn = picture(("torques measured and predicted", plot_torques(found, judged)))
    return table(head, rows, numbers=(1, 2, 3, 4)) + line("Torques measured and predicted [N m | N]") + drawn


# --- figures --------------------------------------------------------------------------------------------------


def plot_intervals(found: Identified) -> Figure:
    """Change of each base parameter from the model's, in units of its own size, with its interval."""
    own = found.base.K @ found.settings.unknowns.present
    half = np.where(np.isfinite(found.half_width), found.half_width, 0.0)
    size = np.maximum.reduce([abs(own), abs(found.beta), 3.0 * half, np.full(len(own), 1e-300)])
    n = len(size)
    figure = new_figure(9.5, 1.2 + 0.17 * n)
    axes = figure.subplots()
    y = np.arange(n)[::-1]
    change, bar = (found.beta - own) / size, half / size
    ok = found.seen
    axes.errorbar(
        np.clip(change, -3, 3)[ok], y[ok], xerr=np.minimum(bar, 3)[ok], fmt="o", markersize=3.5, linewidth=1.2
    )
    axes.axvline(0.0, color=FAINT, linewidth=0.9)
    axes.set_yticks(y, found.base.labels, fontsize="x-small")
    axes.set_xlim(-2.1, 2.1)
    axes.set_ylim(-0.8, n - 0.2)
    axes.set_xlabel(
        "change from the model, in units of the larger of both values, or of three half widths; 0 is the model's value"
    )
    tidy(axes)
    return figure


def plot_residuals(found: Identified) -> Figure:
    """Residuals of the first freedoms over time, in units of their deviations."""
    shown = min(JOINTS, found.residuals.shape[1])
    figure = new_figure(9.5, 1.1 * shown + 0.5)
    step = max(1, len(found.t) // POINTS)
    names = _freedoms(found)
    for k, axes in enumerate(np.atleast_1d(figure.subplots(shown, 1, sharex=True))):
        axes.plot(found.t[::step], found.residuals[::step, k], linewidth=0.6)
        axes.set_ylabel(names[k], fontsize="x-small", rotation=0, ha="right")
        tidy(axes)
    axes.set_xlabel("t [s]")
    return figure


def plot_information(found: Identified) -> Figure:
    """Singular values of the base's columns, and the correlation of its parameters."""
    need_matplotlib()
    figure = new_figure(9.5, 4.2)
    left, right = figure.subplots(1, 2)
    left.semilogy(
        np.arange(1, len(found.singular_values) + 1), found.singular_values, "o-", markersize=3, linewidth=1.0
    )
    left.set(xlabel="number", ylabel="singular value")
    tidy(left)
    n = len(found.correlation) + 0.5
    drawn = right.imshow(found.correlation, cmap="RdBu", vmin=-1.0, vmax=1.0, extent=(0.5, n, n, 0.5))
    right.set(xlabel="base parameter", ylabel="base parameter", title="correlation")
    figure.colorbar(drawn, ax=right, shrink=0.8)
    return figure


def plot_torques(found: Identified, judged: Validation) -> Figure:
    """Torques of the first freedoms, measured and predicted."""
    shown = min(JOINTS, judged.tau.shape[1])
    figure = new_figure(9.5, 1.3 * shown + 0.6)
    step = max(1, len(judged.t) // POINTS)
    names = _freedoms(found)
    for k, axes in enumerate(np.atleast_1d(figure.subplots(shown, 1, sharex=True))):
        for style, (label, y) in enumerate((("measured", judged.tau), ("predicted", judged.predicted))):
            axes.plot(
                judged.t[::step], y[::step, k], linewidth=1.4 - 0.5 * style, linestyle=dash(style, 9), label=label
            )
        axes.set_ylabel(names[k], fontsize="x-small", rotation=0, ha="right")
        tidy(axes)
        if not k:
            axes.legend(fontsize="x-small", ncols=2, loc="upper right")
    axes.set_xlabel("t [s]")
    return figure


def _freedoms(found: Identified) -> list[str]:
    """A name of each freedom that has rows."""
    return freedoms_of(found.start)[: len(found.noise)]


def _all_positive(found: Identified) -> bool:
    return all(values[0] > 0.0 for values in found.eigenvalues.values())
