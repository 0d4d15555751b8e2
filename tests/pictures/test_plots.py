"""Plots: what is drawn, in which unit, under which name; colours; files. Pictures themselves are judged by eye."""

from __future__ import annotations

import itertools
import math
import pickle
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from slow import slow_but

import spatialdyn as sd
from spatialdyn.accuracy.results import Option, Tradeoff, mark_pareto
from spatialdyn.errors import ModelError, SpatialDynError
from spatialdyn.pictures import comparison_plots, figures, tradeoff_plots, trajectory_plots
from spatialdyn.pictures.coordinates import coordinates

pytest.importorskip("matplotlib")
N = 21
ROD = (1.0, (0.0, 0.0, 0.5), np.diag([0.1, 0.1, 0.01]))
# OKLab distance to one eye or another below which two lines look alike; the least of COLOURS is 0.081
APART = 0.08


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    """Deprecations inside matplotlib are no errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", PendingDeprecationWarning)
        yield


@pytest.fixture(scope="module")
def mixed() -> sd.Model:
    """A base that floats, an angle with limits, a slide, an angle in two numbers."""
    builder = sd.ModelBuilder("mixed $x$")
    builder.add_body("trunk", None, "floating", (0, 0, 1), None, ROD, joint_name="free")
    builder.add_body("a", "trunk", "revolute", (0, 1, 0), (0, 0, 1.0), ROD, joint_name="_turn", limits=(-1.0, 2.0))
    builder.add_body("b", "a", "prismatic", (0, 0, 1), (0, 0, 1.0), ROD, joint_name="slide")
    return builder.build()


def motion(model: sd.Model, count: int = N, tau: float = 0.0, method: str = "rk4", dt: float = 0.1) -> sd.Trajectory:
    """A trajectory of made-up numbers: drawing needs no simulation."""
    t = dt * np.arange(count)
    v = np.sin(t)[:, None] * np.arange(1.0, model.nv + 1.0)
    start = np.broadcast_to(np.asarray(sd.neutral(model)), (count, model.nq))
    q = np.asarray(sd.integrate(model, start, v))
    return sd.Trajectory(t, q, v, 2.0 * v, np.full_like(v, tau), 5.0 + 1e-6 * t, method, dt, model.name, model=model)


def labels(axes: Any) -> list[str]:
    """Entries of a legend."""
    return [text.get_text() for text in axes.get_legend().get_texts()] if axes.get_legend() else []


# --- columns ------------------------------------------------------------------------------------------------


def test_columns_have_the_joints_names_units_and_limits(mixed: sd.Model) -> None:
    q, v = coordinates(mixed, "q", mixed.nq), coordinates(mixed, "v", mixed.nv)
    assert [x.label for x in q] == [*(f"free {c}" for c in ("x", "y", "z", "qx", "qy", "qz", "qw")), "_turn", "slide"]
    assert [x.unit for x in q] == ["m"] * 3 + ["1"] * 4 + ["rad", "m"]
    assert [x.unit for x in v] == ["m/s"] * 3 + ["rad/s"] * 3 + ["rad/s", "m/s"]
    assert [x.column for x in q] == list(range(mixed.nq))
    assert (q[7].lower, q[7].upper) == (-1.0, 2.0)
    assert [x.unit for x in coordinates(mixed, "tau", mixed.nv)][-2:] == ["N m", "N"]


def test_an_angle_in_two_numbers_has_both(mixed: sd.Model) -> None:
    model = sd.load_urdf("pendulum", continuous="cos_sin")
    joint = model.names[1]
    assert [x.label for x in coordinates(model, "q", 2)] == [f"{joint} cos", f"{joint} sin"]
    assert [x.unit for x in coordinates(model, "v", 1)] == ["rad/s"]


# --- one trajectory -----------------------------------------------------------------------------------------


def test_radians_metres_and_quaternions_have_axes_of_their_own(mixed: sd.Model) -> None:
    figure = motion(mixed).plot(["q", "tau"])
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "q [m]", "q, of unit norm", "q [rad]", "τ [N]", "τ [N m]",
    ]  # fmt: skip
    assert labels(figure.axes[2]) == [" _turn"]
    limits = [line for line in figure.axes[2].lines if line.get_gid() == "limit"]
    assert [line.get_ydata()[0] for line in limits] == [-1.0, 2.0]


def test_joints_are_chosen_by_name_and_unknown_ones_refused(mixed: sd.Model) -> None:
    run = motion(mixed)
    (axes,) = run.plot("q", joints="slide").axes
    assert np.array_equal(axes.lines[0].get_ydata(), run.q[:, 8])
    with pytest.raises(ModelError, match='"slid"'):
        run.plot("q", joints=["slid"])
    for joints in ([], 5):
        with pytest.raises(SpatialDynError, match="joints is"):
            run.plot("q", joints=joints)


def test_energy_is_in_parts_and_its_change_on_a_log_axis(mixed: sd.Model) -> None:
    parts, drift = motion(mixed).plot("energy").axes
    assert labels(parts) == ["T kinetic", "V potential", "T + V"]
    T, V, total = (line.get_ydata() for line in parts.lines)
    assert np.allclose(T + V, total, rtol=1e-14)
    assert drift.get_yscale() == "log"
    still = motion(sd.load_urdf("pendulum"))
    flat = sd.Trajectory(**{**vars(still), "energy": np.ones(N)}).plot("energy").axes[1]
    assert flat.get_yscale() == "linear"
    assert "exactly 0" in flat.texts[0].get_text()


def test_phases_are_of_single_freedoms_and_unwrap_pairs(mixed: sd.Model) -> None:
    turn, slide = motion(mixed).plot("phase").axes
    assert (turn.get_xlabel(), turn.get_ylabel()) == ("q [rad]", "v [rad/s]")
    assert (slide.get_xlabel(), slide.get_ylabel()) == ("q [m]", "v [m/s]")
    model = sd.load_urdf("pendulum", continuous="cos_sin")
    t = np.linspace(0.0, 1.0, N)
    q = np.stack([np.cos(9.0 * t), np.sin(9.0 * t)], axis=1)
    run = sd.Trajectory(**{**vars(motion(model)), "t": t, "q": q})
    (axes,) = run.plot("phase").axes
    assert np.allclose(axes.lines[0].get_xdata(), 9.0 * t)
    with pytest.raises(SpatialDynError, match="no joint of one freedom"):
        motion(mixed).plot("phase", joints="free")


def test_limits_are_fractions_and_name_what_is_beyond(mixed: sd.Model) -> None:
    run = motion(mixed)
    (axes,) = run.plot("limits").axes
    share = axes.lines[2].get_ydata()
    assert np.allclose(share, (run.q[:, 7] - 0.5) / 1.5)
    assert [text.get_text() for text in axes.texts] == ["beyond: _turn"]
    model = sd.ModelBuilder("strong").add_body("a", limits=sd.JointLimits(-1.0, 1.0, effort=2.0), inertia=ROD).build()
    for tau, shown in ((0.0, ["q / position limit"]), (3.0, ["q / position limit", "τ / effort limit"])):
        assert [axes.get_ylabel() for axes in motion(model, tau=tau).plot("limits").axes] == shown  # no empty panel
    with pytest.raises(SpatialDynError, match="no limits"):
        motion(sd.load_urdf("two_link")).plot("limits")


def test_names_are_no_formulas(mixed: sd.Model) -> None:
    figure = motion(mixed).plot("q")
    assert figure.axes[0].get_title(loc="left").startswith(r"mixed \$x\$")
    figures.svg_of(figure)


def test_many_lines_have_as_many_colours() -> None:
    builder = sd.ModelBuilder("chain")
    for k in range(30):
        builder.add_body(f"b{k:02d}", f"b{k - 1:02d}" if k else None, "revolute", (1, 0, 0), None, ROD)
    (axes,) = motion(builder.build()).plot("q").axes
    assert len({line.get_color() for line in axes.lines}) == 30
    assert len(labels(axes)) == 30


def test_a_name_has_one_colour_in_all_panels_and_no_two_names_the_same(mixed: sd.Model) -> None:
    figure = motion(mixed).plot(["q", "energy"], joints=["_turn", "slide"])
    shown: dict[str, set[str]] = {}
    for axes in figure.axes:
        for line, name in zip([x for x in axes.lines if x.get_gid() != "limit"], labels(axes), strict=False):
            shown.setdefault(name, set()).add(line.get_color())
    assert len(shown) == 5
    assert len(set().union(*shown.values())) == 5
    assert [line.get_color() for line in figure.axes[3].lines] == list(shown["T + V"])


def test_legends_are_whole_and_leave_the_axes_their_width() -> None:
    builder = sd.ModelBuilder("chain")
    for k in range(44):
        name = f"a_long_name_of_body_{k:02d}"
        builder.add_body(name, f"a_long_name_of_body_{k - 1:02d}" if k else None, "revolute", (1, 0, 0), None, ROD)
    figure = motion(builder.build()).plot(["q", "v"])
    figure.draw_without_rendering()
    for axes in figure.axes:
        assert axes.get_legend().get_window_extent().x1 <= figure.bbox.x1
        assert axes.get_legend().get_window_extent().height <= 1.1 * axes.bbox.height
        assert axes.bbox.width > 4.5 * figure.dpi


def test_limits_that_joints_share_are_grey_and_dotted_as_no_motion_is() -> None:
    builder = sd.ModelBuilder("two")
    builder.add_body("a", limits=(-1.0, 2.0), inertia=ROD).add_body("b", "a", limits=(-1.0, 3.0), inertia=ROD)
    (axes,) = motion(builder.build()).plot("q").axes
    limits = {line.get_ydata()[0]: line for line in axes.lines if line.get_gid() == "limit"}
    motions = [line for line in axes.lines if line.get_gid() != "limit"]
    assert [limits[x].get_color() for x in (-1.0, 2.0, 3.0)] == [figures.FAINT, *(x.get_color() for x in motions)]
    assert figures.LIMIT not in figures.DASHES
    assert [text.get_text() for text in axes.texts] == ["dotted: limits"]


def test_axes_of_the_user_are_drawn_into_and_counted(mixed: sd.Model, tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    own = Figure()
    rows = own.subplots(3, 1)
    assert motion(mixed).plot("q", ax=rows, path=tmp_path / "own.png") is own
    assert all(axes.lines for axes in rows)
    assert (tmp_path / "own.png").stat().st_size > 1000
    with pytest.raises(SpatialDynError, match=r"ax holds 1 axes, expected 3: q \[m\], q \[1\], q \[rad\]"):
        motion(mixed).plot("q", ax=rows[0])
    with pytest.raises(SpatialDynError, match="expected Matplotlib axes"):
        motion(mixed).plot("q", ax=3)


@pytest.mark.parametrize("what", ["x", [], ["q", "x"], 5, None])
def test_what_cannot_be_drawn_is_named(mixed: sd.Model, what: Any) -> None:
    with pytest.raises(SpatialDynError, match=r"plot of .*, expected some of q, v, tau, p, energy, phase, limits"):
        motion(mixed).plot(what)


def test_a_file_in_place_of_a_quantity_names_the_argument_it_goes_to(mixed: sd.Model) -> None:
    with pytest.raises(SpatialDynError, match=r"plot of 'a.png', .*; plot\(path='a.png'\) writes a file"):
        motion(mixed).plot("a.png")


def test_a_trajectory_without_its_model_is_numbered(mixed: sd.Model, tmp_path: Path) -> None:
    motion(mixed).save(tmp_path / "run.npz")
    run = sd.Trajectory.load(tmp_path / "run.npz")
    axes = run.plot(["v", "energy"]).axes
    assert axes[0].get_ylabel() == "v [rad/s | m/s]"
    assert labels(axes[0])[0] == "v0"
    assert labels(axes[1]) == ["T + V"]
    for what in ("phase", "limits"):
        with pytest.raises(SpatialDynError, match="loaded without its model"):
            run.plot(what)


@pytest.mark.parametrize("count", slow_but([1], [1, 2]))
def test_one_sample_is_drawn_and_none_refused(mixed: sd.Model, count: int) -> None:
    run = motion(mixed, count)
    run.plot(["q", "v", "tau", "p", "energy", "phase", "limits"])._repr_png_()
    with pytest.raises(SpatialDynError, match="empty"):
        motion(mixed, 0).plot()


def test_a_figure_shows_itself_in_a_notebook_and_can_be_pickled(mixed: sd.Model) -> None:
    figure = pickle.loads(pickle.dumps(motion(mixed).plot("q")))
    png, size = figure._repr_png_()
    assert png.startswith(b"\x89PNG")
    assert size["width"] == int(80 * figure.get_size_inches()[0])


# --- several ------------------------------------------------------------------------------------------------


def test_runs_are_compared_a_panel_a_coordinate_a_colour_a_run(mixed: sd.Model) -> None:
    runs = [motion(mixed), motion(mixed, method="gauss4"), motion(mixed, 2 * N, dt=0.05)]
    figure = sd.plot(runs, ["q", "energy"])
    assert len(figure.axes) == mixed.nq + 2
    assert len({line.get_color() for line in figure.axes[0].lines}) == 3
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["rk4, dt 0.1 s", "gauss4, dt 0.1 s", "rk4, dt 0.05 s"]
    again = sd.plot(runs, "q", labels=["a", "b", "$c"], joints="slide")
    assert [text.get_text() for text in again.legends[0].get_texts()] == ["a", "b", r"\$c"]
    assert len(again.axes) == 1
    assert len({str(line._dash_pattern) for line in figure.axes[0].lines}) == 3
    assert [axes.get_title() for axes in figure.axes[-2:]] == ["energy", "drift of energy"]


def test_the_difference_is_taken_where_times_agree(mixed: sd.Model) -> None:
    first = motion(mixed)
    finer = motion(mixed, 2 * N, dt=0.05)
    finer.q[:, 8] += 1e-3
    metres, radians = sd.plot([first, finer], "difference").axes
    t, apart = metres.lines[0].get_data()
    assert np.allclose(t, first.t, atol=1e-12)
    assert np.allclose(apart, 1e-3)
    assert radians.get_ylabel().endswith("[rad]")
    same = sd.plot([first, first], "difference").axes[0]
    assert "exactly 0" in same.texts[0].get_text()
    late = sd.Trajectory(**{**vars(first), "t": first.t + 0.03})
    with pytest.raises(SpatialDynError, match="times in common"):
        sd.plot([first, late], "difference")
    with pytest.raises(SpatialDynError, match="two runs or more"):
        sd.plot([first], "difference")


def test_what_cannot_be_compared_is_named(mixed: sd.Model) -> None:
    run, other = motion(mixed), motion(sd.load_urdf("two_link"))
    for runs, words in (([run, other], "expected one robot"), ([], "expected trajectories"), (5, "expected traj"),
                        ([run, 3], "Trajectory, int")):  # fmt: skip
        with pytest.raises(SpatialDynError, match=words):
            sd.plot(runs)
    with pytest.raises(SpatialDynError, match="labels has 1 names, expected 2"):
        sd.plot([run, run], labels=["a"])
    with pytest.raises(SpatialDynError, match="single Trajectory"):
        sd.plot(run, labels=["a"])
    with pytest.raises(SpatialDynError, match=r"expected at most 24; choose some with joints=\[names\]"):
        sd.plot([run, run], ["q", "v", "p", "tau"])
    assert len(sd.plot(run, "v").axes) == 2


# --- rollouts -----------------------------------------------------------------------------------------------


def batch(model: sd.Model, samples: int) -> sd.Rollout:
    """Made-up states: sample k is k times the first."""
    t = 0.01 * np.arange(1.0, 11.0)
    v = np.arange(float(samples))[:, None, None] * np.sin(t)[:, None] * np.ones(model.nv)
    q = v.copy() if model.nq == model.nv else np.repeat(v[..., :1], model.nq, axis=-1)
    return sd.Rollout(q, v, t, model)


def test_a_rollout_unpacks_and_knows_its_times() -> None:
    model = sd.load_urdf("two_link")
    q0 = np.array([0.1, 0.2])
    found = sd.rollout(model, q0, np.zeros(2), dt=0.5e-3, steps=6, record=2)
    q, v = found
    assert q is found.q is found[0]
    assert v is found.v is found[1]
    assert len(found) == 2
    assert np.allclose(found.t, [1e-3, 2e-3, 3e-3])
    assert found.model is model
    last = sd.rollout(model, q0, np.zeros(2), dt=0.5e-3, steps=6, record="last")
    assert (last.t.shape, float(last.t)) == ((), 3e-3)
    with pytest.raises(SpatialDynError, match='record=1 in place of "last"'):
        last.plot()


def test_a_rollout_is_its_median_and_band() -> None:
    found = batch(sd.load_urdf("two_link"), 101)
    figure = found.plot("v", sample=100)
    (axes,) = figure.axes
    assert labels(axes) == ["joint1", "joint2"]
    for lines in (axes.lines[:4], axes.lines[4:]):
        low, high, middle, one = (line.get_ydata() for line in lines)
        for y, share in ((low, 5.0), (middle, 50.0), (high, 95.0), (one, 100.0)):
            assert np.allclose(y, share * np.sin(found.t))
    assert "thin: sample 100" in [text.get_text() for text in figure.legends[0].get_texts()]
    for sample in (101, -1, "x"):
        with pytest.raises(SpatialDynError, match="sample is"):
            found.plot(sample=sample)
    with pytest.raises(SpatialDynError, match="expected some of q, v"):
        found.plot("tau")
    with pytest.raises(SpatialDynError, match="expected one of q, v"):
        found.plot(["q", "v"])


def test_samples_that_are_not_finite_are_left_out_and_counted() -> None:
    found = batch(sd.load_urdf("two_link"), 3)
    found.q[2, 5] = np.nan
    figure = found.plot()
    assert "1 not finite and left out" in figure.get_suptitle()
    assert np.isfinite(figure.axes[0].lines[2].get_ydata()).all()
    found.q[:] = np.nan
    assert "3 not finite and left out" in found.plot().get_suptitle()


def test_a_single_start_is_a_line() -> None:
    whole = batch(sd.load_urdf("two_link"), 2)
    found = sd.Rollout(whole.q[1], whole.v[1], whole.t, whole.model)
    figure = found.plot()
    assert [np.array_equal(line.get_ydata(), found.q[:, k]) for k, line in enumerate(figure.axes[0].lines)] == [
        True
    ] * 2
    assert not figure.legends


def test_a_rollout_has_the_panels_of_a_trajectory(mixed: sd.Model) -> None:
    for name in ("q", "v"):
        rolled, run = batch(mixed, 20).plot(name), motion(mixed).plot(name)
        assert [axes.get_ylabel() for axes in rolled.axes] == [axes.get_ylabel() for axes in run.axes]
        assert [labels(axes) for axes in rolled.axes] == [labels(axes) for axes in run.axes]
    chain = sd.ModelBuilder("chain")
    for k in range(30):
        chain.add_body(f"b{k:02d}", f"b{k - 1:02d}" if k else None, "revolute", (1, 0, 0), None, ROD)
    assert len(batch(chain.build(), 5).plot().axes) == 1


# --- error against cost -------------------------------------------------------------------------------------


def simulated() -> Tradeoff:
    """Made-up errors and costs of two methods at three steps each."""
    options = [
        Option(f"{name}, dt {dt:.3g}", "sd.simulate(...)", c * dt**order, 0.0, 2 * c * dt**order, 1e5 * w / dt)
        for name, order, c, w in (("rk4", 4, 1.0, 1.0), ("gauss6", 6, 1.0, 3.0))
        for dt in (0.1, 0.01, 0.001)
    ]
    lost = Option("radau, rtol 1e-06", "", math.inf, math.inf, math.inf, 1e7)
    return Tradeoff("arm", "simulate", mark_pareto([*options, lost]), 4, 0, 1.0, 0.0, "truth")


def test_steps_are_labelled_and_costs_are_ms_and_times_real_time() -> None:
    figure = simulated().plot()
    axes = figure.axes[0]
    shown = {text.get_text() for text in axes.texts}
    assert shown == {"0.1", "0.01", "0.001"}
    assert labels(axes)[:2] == ["rk4", "gauss6"]
    x, y = axes.lines[0].get_data()
    assert np.allclose(x, [1.0, 10.0, 100.0])  # ms: 1e5 ns / dt
    assert np.allclose(y, [1e-4, 1e-8, 1e-12])
    assert axes.get_xlabel() == "ms of computing for a second of motion"
    (top,) = axes.child_axes
    assert top.get_xlabel() == "times faster than real time"
    figure.draw_without_rendering()
    assert np.allclose(sorted(top.get_xlim()), sorted(1000.0 / np.array(axes.get_xlim())))


def test_the_front_is_a_stair_through_the_best() -> None:
    found = simulated()
    line = found.plot().axes[0].lines[-1]
    assert [1e6 * x for x in line.get_xdata()] == pytest.approx([x.ns for x in found.front])
    assert line.get_drawstyle() == "steps-post"


def test_calls_keep_their_unit_and_no_colour_is_used_twice(tmp_path: Path) -> None:
    options = [Option(f"way {k}", "", 10.0**-k, 0.0, 1.0, 10.0 * (k + 1)) for k in range(20)]
    found = Tradeoff("arm", "mass_matrix", mark_pareto(options), 4, 64, 0.0, 0.0, "truth")
    (axes,) = sd.plot(found, path=tmp_path / "t.svg").axes
    assert axes.get_xlabel() == "ns a sample"
    assert len({line.get_color() for line in axes.lines[:-1]}) == 20
    assert not axes.child_axes
    assert (tmp_path / "t.svg").read_text().startswith("<?xml")
    for path in (5, tmp_path / "nowhere" / "t.png", tmp_path / "t.xyz"):
        with pytest.raises(
            SpatialDynError,
            match=r"path is 5|plot cannot be written to|t.xyz', expected a name that ends in one of .png, ",
        ):
            found.plot(path)


def test_a_short_logarithmic_axis_has_more_ticks_than_one() -> None:
    options = [Option(f"way {k}", "", 10.0**-k, 0.0, 1.0, 170.0 * (k + 1)) for k in range(15)]
    figure = Tradeoff("arm", "mass_matrix", mark_pareto(options), 4, 64, 0.0, 0.0, "truth").plot()
    figure.draw_without_rendering()
    (axes,) = figure.axes
    ticks = {
        side: [t.get_text() for t, at in zip(axis.get_ticklabels(), axis.get_ticklocs(), strict=True) if a < at < b]
        for side, axis, (a, b) in (("x", axes.xaxis, axes.get_xlim()), ("y", axes.yaxis, axes.get_ylim()))
    }
    assert ticks["x"] == ["200", "500", "1000", "2000"]
    assert not any("cdot" in text for text in ticks["y"])
    assert figures._power(2e5, None) == r"$2 \cdot 10^{5}$"
    assert figures._power(1e-5, None) == "$10^{-5}$"


@pytest.mark.parametrize(("number", "text"), [(1e-06, "1e-6"), (0.0125, "0.013"), (1e-12, "1e-12"), (0.1, "0.1")])
def test_numbers_are_short(number: float, text: str) -> None:
    assert tradeoff_plots.short(number) == text


# --- colours ------------------------------------------------------------------------------------------------

# one row per eye: linear RGB as seen without one kind of cone, Machado, Oliveira and Fernandes (2009), severity 1
EYES = {
    "all cones": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
}


def seen(colours: Any, eye: str) -> Any:
    """OKLab of colours (n, 3) as an eye sees them."""
    from matplotlib.colors import to_rgb

    rgb = np.array([to_rgb(c) for c in colours])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    to_lms = np.array(
        [[0.4122214708, 0.5363325363, 0.0514459929], [0.2119034982, 0.6806995451, 0.1073969566],
         [0.0883024619, 0.2817188376, 0.6299787005]]
    )  # fmt: skip
    to_lab = np.array(
        [[0.2104542553, 0.7936177850, -0.0040720468], [1.9779984951, -2.4285922050, 0.4505937099],
         [0.0259040371, 0.7827717662, -0.8086757660]]
    )  # fmt: skip
    return np.cbrt(np.clip(linear @ EYES[eye].T, 0.0, 1.0) @ to_lms.T) @ to_lab.T


@pytest.mark.parametrize("eye", EYES)
def test_colours_differ_to_every_eye(eye: str) -> None:
    lab = seen(figures.COLOURS, eye)
    apart = {(i, j): float(np.linalg.norm(lab[i] - lab[j])) for i, j in itertools.combinations(range(len(lab)), 2)}
    assert min(apart.values()) > APART, min(apart, key=lambda pair: apart[pair])


@pytest.mark.parametrize("count", [1, 12, 13, 44])
def test_no_colour_comes_twice(count: int) -> None:
    made = figures.colours(count)
    assert len(set(made)) == count
    assert len({figures.dash(k, count) for k in range(min(count, 4))}) == (1 if count <= 4 else 4)


def test_lines_beyond_the_palette_get_lighter() -> None:
    lightness = seen(figures.colours(30), "all cones")[:, 0]
    assert (np.diff(lightness) > 0.0).all()
    assert lightness[-1] < 0.9  # still seen on white


def test_where_matplotlib_is_missing_it_is_named(mixed: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for draw in (motion(mixed).plot, simulated().plot, lambda: sd.plot([motion(mixed)])):
        with pytest.raises(SpatialDynError, match="matplotlib is not installed; pip install matplotlib"):
            draw()


def test_documented_names_of_plots_are_those_that_work(mixed: sd.Model) -> None:
    for name in trajectory_plots.WHAT:
        assert f'"{name}"' in (sd.Trajectory.plot.__doc__ or "")
    for name in comparison_plots.COMPARED:
        assert f'"{name}"' in (sd.plot.__doc__ or "")


# --- ledgers --------------------------------------------------------------------------------------------


def account(model: sd.Model) -> sd.EnergyLedger:
    """A ledger of made-up numbers."""
    t = 0.1 * np.arange(N)
    work = {
        kind: scale * np.sin(t)[:, None] * np.ones(model.nv) for kind, scale in (("torque", 2.0), ("friction", -1.0))
    }
    names = tuple(x.label for x in coordinates(model, "v", model.nv))
    change = sum(x.sum(axis=1) for x in work.values()) + 1e-6 * t
    return sd.EnergyLedger(t, change, work, dict.fromkeys(work, names), 1e-6 * t, model.name, "rk4")


def test_a_ledger_shows_energy_works_and_the_error_on_a_log_axis(mixed: sd.Model, tmp_path: Path) -> None:
    found = account(mixed)
    works, error = found.plot(path=tmp_path / "ledger.png").axes
    assert labels(works) == ["change of T + V", "work of torque", "work of friction"]
    assert works.get_ylabel() == "energy and work [J]"
    np.testing.assert_array_equal(works.lines[2].get_ydata(), found.work["torque"].sum(axis=1))
    assert (error.get_ylabel(), error.get_yscale()) == ("|ε| [J]", "log")
    assert (tmp_path / "ledger.png").read_bytes()[:4] == b"\x89PNG"
    joints = found.plot(kind="friction").axes[0]
    assert len(labels(joints)) == mixed.nv
    assert joints.get_ylabel() == "work of friction [J]"
    with pytest.raises(SpatialDynError, match="kind is 'contact', expected one of torque, friction"):
        found.plot(kind="contact")
    with pytest.raises(SpatialDynError, match="expected 2"):
        found.plot(ax=joints)
