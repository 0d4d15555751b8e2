"""Shared parts of all plots: colours, line styles, a new figure, writing it to a file, its picture in a notebook.

No figure uses pyplot: no global state changes, and any thread may draw.
"""

from __future__ import annotations

import functools
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..calls.files import check_ending
from ..errors import SpatialDynError, literal, pip_install

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Chosen one after another, each as far as possible from the colours before it in OKLab and in lightness, for normal
# vision and for eyes without one of the three cones (Machado, Oliveira and Fernandes, 2009): the first few differ most.
COLOURS = (
    "#1f5fa8", "#d95f02", "#002d00", "#00b4dc", "#8c3cf0", "#4b0069",
    "#ffa569", "#784b4b", "#b487a5", "#0000b4", "#6987ff", "#2d7887",
)  # fmt: skip
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (6, 1.5, 1.5, 1.5)),
    (0, (8, 1.5, 1.5, 1.5, 1.5, 1.5)),
)  # distinguish lines without colour
LIMIT = (0, (1, 2))  # dots, which no line of a motion has
ROWS = 22  # the most rows of a legend
SMALL = 12  # entries above which a legend has smaller print
MARKERS = "osD^vPX*<>hp"
FAINT = "0.55"  # the grey of limits and fronts
NOTEBOOK_DPI = 160  # of a picture in a notebook, which is shown at
SHOWN_DPI = 80
FILE_DPI = 130
ENDINGS = (".png", ".svg", ".pdf", ".jpg", ".jpeg", ".webp", ".eps", ".tif", ".tiff")  # a GIF is expected to move


def colours(count: int) -> list[Any]:
    """Different colours: of COLOURS, or for more lines of a ramp from dark to light, ordered for any eyes."""
    if count <= len(COLOURS):
        return list(COLOURS[:count])
    matplotlib = need_matplotlib()
    return [matplotlib.colors.to_hex(c) for c in matplotlib.colormaps["viridis"](np.linspace(0.0, 0.92, count))]


def dash(k: int, count: int) -> Any:
    """The line style of line k of so many: all solid up to four, else neighbours differ."""
    return "-" if count <= 4 else DASHES[k % len(DASHES)]


def need_matplotlib() -> Any:
    """The package matplotlib. Raises SpatialDynError where it is not installed."""
    try:
        import matplotlib
        import matplotlib.colors
        import matplotlib.figure
    except ImportError as error:
        raise SpatialDynError(f"matplotlib is not installed; {pip_install('plot')}") from error
    return matplotlib


def new_figure(width: float, height: float) -> Figure:
    """A figure [inches] that a notebook shows as it is, with no magic command."""
    figure: Figure = need_matplotlib().figure.Figure(figsize=(width, height), layout="constrained")
    setattr(figure, "_repr_png_", functools.partial(notebook_png, figure))  # noqa: B010  a new attribute to mypy
    return figure


def notebook_png(figure: Figure) -> tuple[bytes, dict[str, int]]:
    """A figure as IPython displays it: PNG, and the size at which to show it [pixels]."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=NOTEBOOK_DPI)
    width, height = (int(x * SHOWN_DPI) for x in figure.get_size_inches())
    return buffer.getvalue(), {"width": width, "height": height}


def svg_of(figure: Figure) -> str:
    """A figure as SVG text, the same for the same figure."""
    buffer = io.StringIO()
    with need_matplotlib().rc_context({"svg.hashsalt": "spatialdyn"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def check_path(path: Any) -> Any:
    """A name with the ending of a picture, an open file or None. Raises SpatialDynError for anything else."""
    return None if path is None else check_ending("path", path, ENDINGS)


def written(figure: Figure, path: Any) -> Figure:
    """The figure, written to a file unless path is None. Raises SpatialDynError if it cannot be."""
    if path is not None:
        try:
            figure.savefig(path, dpi=FILE_DPI)
        except (OSError, ValueError) as error:
            raise SpatialDynError(f"plot cannot be written to {path}: {error}") from error
    return figure


def given_axes(ax: Any, wanted: Sequence[str]) -> tuple[Figure, list[Axes]] | None:
    """The figure and axes of the argument ``ax``, one axes per name of a panel; None if it is None.

    Raises SpatialDynError for another number of them, or for something else than axes.
    """
    if ax is None:
        return None
    found = list(np.ravel(np.array(ax, dtype=object)))
    if not found or not all(hasattr(x, "plot") and hasattr(x, "figure") for x in found):
        raise SpatialDynError(f"ax is {literal(ax)}, expected Matplotlib axes")
    if len(found) != len(wanted):
        raise SpatialDynError(f"ax holds {len(found)} axes, expected {len(wanted)}: {', '.join(wanted)}")
    return found[0].figure, found


def one_axes(ax: Any, name: str, path: Any) -> tuple[Figure, Axes]:
    """The figure and axes of a plot of one panel, new ones where ``ax`` is None. Raises what the checks above raise."""
    check_path(path)
    given = given_axes(ax, [name])
    if given is not None:
        return given[0], given[1][0]
    figure = new_figure(9.5, 5.2)
    return figure, figure.subplots()


def by_logarithms(axes: Axes, across: str, up: str, x: float, y: float | None = None) -> None:
    """Logarithmic axes with these labels, around what is drawn, with margins of these shares."""
    axes.set(xscale="log", yscale="log", xlabel=across, ylabel=up)
    axes.margins(x=x, y=y)
    axes.autoscale_view()
    log_ticks(axes.xaxis)
    log_ticks(axes.yaxis)


def plain(text: str) -> str:
    """A name as a label: no formula between dollars, and no underscore first, which hides a legend's entry."""
    shown = text.replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown


def tidy(axes: Axes) -> None:
    """Faint grid, no box."""
    axes.grid(color="0.9", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def legend(axes: Axes, handles: Sequence[Any], labels: Sequence[str], title: str | None = None) -> None:
    """A legend beside the axes, in as many columns as it takes; none for a single line without a name."""
    if handles:
        axes.legend(
            handles, [plain(label) for label in labels], loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False,
            fontsize="small" if len(handles) <= SMALL else "x-small", ncols=-(-len(handles) // ROWS), handlelength=3.0,
            borderaxespad=0.3, title=title, title_fontsize="small",
        )  # fmt: skip


def legend_height(entries: int) -> float:
    """The height that a legend of so many entries takes [inches]."""
    columns = max(1, -(-entries // ROWS))
    return (0.19 if entries <= SMALL else 0.165) * -(-entries // columns) + 0.3


def log_ticks(axis: Any, limits: tuple[float, float] | None = None) -> None:
    """Ticks of a logarithmic axis at powers of ten, as many as fit; at 2 and 5 times them too where few are in view.

    limits  of the axis, where they are not final: of an axis that is the function of another
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    low, high = sorted(axis.get_view_interval() if limits is None else limits)
    few = 0.0 < low and np.floor(np.log10(high)) - np.ceil(np.log10(low)) < 1.0
    axis.set_major_locator(LogLocator(base=10.0, subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=8))
    axis.set_major_formatter(FuncFormatter(_power))
    axis.set_minor_locator(NullLocator())


def _power(x: float, _: Any) -> str:
    """A number in the common form: 0.01, 200, 10⁵, 2·10⁵."""
    if not x > 0.0 or 1e-2 <= x <= 1e4:
        return f"{x:g}" if x > 0.0 else ""
    exponent = int(np.floor(np.log10(x) + 1e-9))
    first = round(x / 10.0**exponent)
    times = "" if first == 1 else rf"{first} \cdot "
    return f"${times}10^{{{exponent}}}$"


def ink(colour: str) -> str:
    """A colour darkened enough for a label on white."""
    rgb = need_matplotlib().colors.to_rgb(colour)
    return str(need_matplotlib().colors.to_hex([0.7 * x for x in rgb])) if sum(rgb) > 1.5 else colour


def place_labels(axes: Axes, wanted: Sequence[tuple[float, float, str, Any]], size: float = 7.0) -> None:
    """Write labels at points (x, y, text, colour) if there is room above, below, right or left; else none.

    The limits of the axes must be final. Earlier labels go first.
    """
    from matplotlib.patheffects import withStroke
    from matplotlib.transforms import Bbox

    figure: Any = axes.figure
    figure.draw_without_rendering()
    taken: list[Any] = []
    dot = 3.0 * figure.dpi / 72.0
    spots = [axes.transData.transform((x, y)) for x, y, _, _ in wanted]
    dots = [Bbox.from_extents(x - dot, y - dot, x + dot, y + dot) for x, y in spots]
    for k, (x, y, text, colour) in enumerate(wanted):
        for dx, dy, ha, va in ((4, 3, "left", "bottom"), (4, -3, "left", "top"), (-4, -3, "right", "top"),
                               (-4, 3, "right", "bottom")):  # fmt: skip
            label = axes.annotate(
                plain(text), (x, y), xytext=(dx, dy), textcoords="offset points", ha=ha, va=va, fontsize=size,
                color=ink(colour), annotation_clip=True, path_effects=[withStroke(linewidth=2.0, foreground="white")],
            )  # fmt: skip
            box = label.get_window_extent()
            others = [other for j, other in enumerate(dots) if j != k]
            inside = axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1
            inside &= axes.bbox.y0 <= box.y0 and box.y1 <= axes.bbox.y1
            if inside and not any(box.overlaps(other) for other in (*taken, *others)):
                taken.append(box)
                break
            label.remove()
