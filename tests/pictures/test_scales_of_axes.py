"""Axes of plots: what differs by rounding alone is drawn as a flat line, what moves fills its panel."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd

pytest.importorskip("matplotlib")
ROUNDING = 1e-15  # as far as robots at rest move
VISIBLE = 1e-6  # rad: a motion that a user may look for
ROD = (1.0, (0.0, 0.0, 0.5), np.diag([0.1, 0.1, 0.01]))


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    """Deprecations inside matplotlib are no errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", PendingDeprecationWarning)
        yield


def robot(scale: float = 1.0) -> sd.Model:
    """A floating base, an angle and a slide; of a size [m] and a mass of its cube [kg]."""
    inertia = (ROD[0] * scale**3, np.multiply(ROD[1], scale), ROD[2] * scale**5)
    builder = sd.ModelBuilder("small").add_body("trunk", joint="floating", inertia=inertia)
    builder.add_body("turn", "trunk", placement=(0.0, 0.0, scale), inertia=inertia)
    builder.add_body("slide", "turn", "prismatic", placement=(0.0, 0.0, scale), inertia=inertia)
    return builder.build()


def resting(model: sd.Model, size: float = ROUNDING, seed: int = 0) -> sd.Trajectory:
    """A robot at rest, but for noise in every number."""
    rng = np.random.default_rng(seed)
    v = size * rng.normal(size=(50, model.nv))
    q = np.asarray(sd.integrate(model, np.tile(np.asarray(sd.neutral(model)), (50, 1)), v))
    return sd.Trajectory(
        np.linspace(0.0, 1.0, 50), q, v, size * rng.normal(size=v.shape), size * rng.normal(size=v.shape),
        3.0 + size * rng.normal(size=50), "rk4", 0.02, model.name, model=model,
    )  # fmt: skip


def account(size: float) -> sd.EnergyLedger:
    t, work = np.linspace(0.0, 1.0, 50), {"torque": size * np.random.default_rng(1).normal(size=(50, 2))}
    return sd.EnergyLedger(t, work["torque"].sum(axis=1), work, {"torque": ("a", "b")}, 0.0 * t, "small", "rk4")


def rolled(run: sd.Trajectory) -> sd.Rollout:
    q, v = (np.stack([np.roll(getattr(run, name), k, axis=0) for k in range(6)]) for name in ("q", "v"))
    return sd.Rollout(q, v, run.t, run.model)


FIGURES = {
    **{what: lambda run, what=what: run.plot(what) for what in ("q", "v", "p", "tau", "energy", "phase")},
    **{f"{what} compared": lambda run, what=what: sd.plot([run, resting(run.model, seed=1)], what)
       for what in ("q", "v", "p", "tau", "energy")},
    **{f"{what} rolled": lambda run, what=what: rolled(run).plot(what, sample=1) for what in ("q", "v")},
}  # fmt: skip


def share(axes: Any) -> float:
    """The height of the lines over that of the panel."""
    y = np.concatenate([np.asarray(line.get_ydata(), float) for line in axes.lines if line.get_gid() != "limit"])
    low, high = axes.get_ylim()
    return float((y.max() - y.min()) / (high - low))


@pytest.mark.parametrize("name", FIGURES)
def test_rounding_errors_are_drawn_as_flat_lines(name: str) -> None:
    figure = FIGURES[name](resting(robot()))
    linear = [axes for axes in figure.axes if axes.get_yscale() == "linear" and "|" not in axes.get_ylabel()]
    assert linear
    figure.draw_without_rendering()
    for axes in linear:
        several = {round(float(np.mean(line.get_ydata())), 9) for line in axes.lines if len(line.get_ydata()) > 1}
        if len(several) == 1:  # else the panel is as high as lines are apart
            assert share(axes) < 1e-6
        assert axes.yaxis.get_offset_text().get_text() == ""
        low, high = axes.get_ylim()
        assert all(low < y.min() <= y.max() < high for y in (np.asarray(line.get_ydata()) for line in axes.lines))
        if name == "phase":
            assert np.diff(axes.get_xlim())[0] > 1e-3


def test_works_of_rounding_errors_are_flat() -> None:
    for figure in (account(ROUNDING).plot(), account(ROUNDING).plot(kind="torque")):
        assert share(figure.axes[0]) < 1e-6
    assert share(account(1e-9).plot().axes[0]) > 0.7


@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_a_small_motion_fills_its_panel(name: str, size: float) -> None:
    """Of a robot a thousand times smaller too: its lengths, masses and torques are no rounding errors."""
    model = robot(size)
    moves = resting(model, VISIBLE)
    lengths = [0, 1, 2, 7]  # columns of v
    q, v, p, tau = (x.copy() for x in (moves.q, moves.v, moves.p, moves.tau))
    q[:, [0, 1, 2, 8]] *= size
    v[:, lengths] *= size
    for x in (p, tau):
        x *= size**5
        x[:, lengths] /= size
    run = sd.Trajectory(**{**vars(moves), "q": q, "v": v, "p": p, "tau": tau})
    for axes in FIGURES[name](run).axes:
        if axes.get_yscale() == "linear" and "energy" not in name and "|" not in axes.get_ylabel():
            flat = "unit norm" in axes.get_ylabel() and axes.get_title().endswith("qw")  # to second order
            assert flat or share(axes) > 0.7


def test_an_energy_that_a_motion_keeps_is_flat_beside_what_it_exchanges() -> None:
    model = sd.load_urdf("two_link")
    good, bad = (sd.simulate(model, [1.0, 0.5], [0.0, 0.0], 1.0, 0.02, how) for how in ("gauss4", "explicit_euler"))
    assert share(sd.plot([good, good], "energy").axes[0]) < 1e-3
    assert share(sd.plot([good, bad], "energy").axes[0]) > 0.7
    without = sd.Trajectory(**{**vars(good), "model": None})
    assert share(sd.plot([without, without], "energy").axes[0]) < 1e-3
