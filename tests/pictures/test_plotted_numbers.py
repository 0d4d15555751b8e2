"""What plots show is held against the numbers: each line by its name, each axis by the dimension of its unit.

A robot twice as heavy, three times as long, whose seconds are five times as long moves in the same way. Each quantity
grows by what its dimension says, so a unit on an axis is right if the lines on it grow by what the unit says.
"""

from __future__ import annotations

import itertools
import math
import re
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.accuracy.results import Option, Tradeoff, mark_pareto
from spatialdyn.pictures import comparison_plots, contact_plots, trajectory_plots

pytest.importorskip("matplotlib")
KINDS = ("revolute", "continuous", "prismatic", "spherical", "floating", "planar", "helical")
MASS, LENGTH, TIME = 2.0, 3.0, 5.0  # how much larger the robot is, and how much slower
DIMENSION = {  # of a unit: powers of mass, length, time
    "rad": (0, 0, 0), "1": (0, 0, 0), "kg": (1, 0, 0), "m": (0, 1, 0), "m²": (0, 2, 0), "s": (0, 0, 1),
    "N": (1, 1, -2), "J": (1, 2, -2),
}  # fmt: skip
SYMBOLS = {"q": "q", "v": "v", "p": "p", "tau": "τ"}
SAMPLES = 7
MU = ("b0", "b3", "b6")  # links with points
CLOSE = 1e-9  # relative: sums of products round otherwise


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    """Deprecations inside matplotlib are no errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", PendingDeprecationWarning)
        yield


def growth(unit: str) -> float:
    """How much a quantity in a unit, "kg m²/s" say, grows with the robot."""
    above, _, below = unit.partition("/")
    powers = np.sum([DIMENSION[x] for x in above.split()], axis=0) - np.sum(
        [DIMENSION[x] for x in below.split()] or [(0, 0, 0)], axis=0
    )
    return float(np.prod(np.power([MASS, LENGTH, TIME], powers)))


def robot(seed: int, continuous: str = "angle", grown: bool = False, kinds: Any = KINDS) -> sd.Model:
    """A chain of all kinds of joint with limits, or the same grown."""
    rng = np.random.default_rng(seed)
    m, l, t = (MASS, LENGTH, TIME) if grown else (1.0, 1.0, 1.0)
    builder = sd.ModelBuilder("chain")
    for k, kind in enumerate(rng.permutation(kinds)):
        place, com, mass = rng.normal(size=3), rng.normal(size=3), rng.uniform(0.5, 2.0)
        effort, velocity, upper, armature = rng.uniform(0.5, 2.0, 4)
        slides = kind == "prismatic"
        own = dict(axis=rng.normal(size=3), pitch=0.3 * l * (kind == "helical"))
        if kind in ("revolute", "prismatic"):
            own |= dict(
                limits=sd.JointLimits(-1.5 * upper * l**slides, upper * l**slides, velocity * l**slides / t,
                effort * m * l ** (2 - slides) / t**2), armature=armature * m * l ** (2 * (not slides)),
            )  # fmt: skip
        inertia = (mass * m, com * l, m * l**2 * np.diag([0.3, 0.4, 0.5]))
        builder.add_body(f"b{k}", f"b{k - 1}" if k else None, str(kind), placement=place * l, inertia=inertia,
                         joint_name=f"_{kind}$", **own)  # fmt: skip
    return builder.build(continuous=continuous, gravity=(0.0, 0.0, -9.81 * l / t**2))


def parts(model: sd.Model, pairs: bool) -> tuple[list[tuple[str, str, int]], list[tuple[str, str, int]]]:
    """(label, joint's kind, power of length) of each column of q and of v, by the conventions of the README."""
    turn = {"spherical": ["qx", "qy", "qz", "qw"], "floating": ["qx", "qy", "qz", "qw"]}
    turn |= {"planar": ["cos", "sin"] if pairs else ["angle"], "continuous": ["cos", "sin"] if pairs else [""]}
    rate = {"spherical": ["ωx", "ωy", "ωz"], "floating": ["ωx", "ωy", "ωz"], "planar": ["ω"]}
    places = {"floating": ["x", "y", "z"], "planar": ["x", "y"], "prismatic": [""]}
    of_q, of_v = [], []
    for joint in model.joints[1:]:
        lengths = places.get(joint.kind, [])
        rest = [] if joint.kind == "prismatic" else [""]
        for found, turning in ((of_q, turn.get(joint.kind, rest)), (of_v, rate.get(joint.kind, rest))):
            found += [(f"{joint.name} {x}".strip(), joint.kind, 1) for x in lengths]
            found += [(f"{joint.name} {x}".strip(), joint.kind, 0) for x in turning]
    return of_q, of_v


def motion(seed: int, continuous: str = "angle", grown: bool = False, kinds: Any = KINDS) -> sd.Trajectory:
    """Random states of a random robot, with the momenta, torques and energies that they have."""
    model = robot(seed, continuous, grown, kinds)
    l, t = (LENGTH, TIME) if grown else (1.0, 1.0)
    rng = np.random.default_rng(seed + 1)
    scale = np.array([l**power for _, _, power in parts(model, continuous == "cos_sin")[1]])
    start = np.asarray(sd.neutral(model))
    q = np.asarray(sd.integrate(model, start, rng.normal(size=(SAMPLES, model.nv)) * scale))
    v, a = (rng.normal(size=(SAMPLES, model.nv)) * scale / t**k for k in (1, 2))
    p = np.einsum("nij,nj->ni", np.asarray(sd.crba(model, q)), v)
    energy = np.asarray(sd.kinetic_energy(model, q, v)) + np.asarray(sd.potential_energy(model, q))
    times = 0.1 * t * np.arange(SAMPLES)
    return sd.Trajectory(
        times, q, v, p, np.asarray(sd.rnea(model, q, v, a)), energy, "rk4", 0.1 * t, "chain", model=model
    )


def rolled(seed: int, grown: bool = False) -> sd.Rollout:
    """The states of five motions."""
    runs = [motion(seed, grown=grown)]
    q, v = (np.stack([np.roll(getattr(runs[0], name), k, axis=0) for k in range(5)]) for name in ("q", "v"))
    return sd.Rollout(q, v, runs[0].t, runs[0].model)


def touched(grown: bool = False, terrain: Any = None) -> sd.Trajectory:
    """A motion with a record of contacts: each point's impulse within its cone, or none."""
    run = motion(7, grown=grown)
    model, rng = run.model, np.random.default_rng(8)
    mu = dict(zip(MU, (0.3, 0.6, 0.9), strict=True))
    contacts = sd.Contacts(model, dict.fromkeys(MU, 0.1 * (LENGTH if grown else 1.0)), friction=mu, terrain=terrain)
    pushed, turned = rng.uniform(1.0, 2.0, (SAMPLES, 3)), rng.uniform(0.0, 2.0 * np.pi, (SAMPLES, 3))
    pushed[rng.uniform(size=pushed.shape) < 0.3] = 0.0
    share = rng.uniform(0.0, 1.0, (SAMPLES, 3)) * contacts.friction
    impulse = pushed[..., None] * np.stack([share * np.cos(turned), share * np.sin(turned), np.ones((SAMPLES, 3))], -1)
    scale = growth("kg m/s") if grown else 1.0
    gap = (LENGTH if grown else 1.0) * rng.normal(size=(SAMPLES, 3))
    record = sd.ContactRecord(scale * impulse, gap, np.zeros(SAMPLES), np.zeros((SAMPLES, model.nv)))
    return sd.Trajectory(**{**vars(run), "contacts": record, "scene": sd.Scene(model, contacts=contacts)})


def ledger(grown: bool = False) -> sd.EnergyLedger:
    """Works of either sign."""
    rng = np.random.default_rng(5)
    scale = growth("J") if grown else 1.0
    work = {kind: scale * rng.normal(size=(SAMPLES, 3)) for kind in ("torque", "friction", "contacts")}
    error = 1e-3 * scale * rng.normal(size=SAMPLES)
    change = sum(x.sum(axis=1) for x in work.values()) + error
    names = {kind: tuple(f"{kind} {k}" for k in range(3)) for kind in work}
    return sd.EnergyLedger(np.arange(SAMPLES) * 1.0, change, work, names, error, "chain", "rk4")


def labels(axes: Any) -> list[str]:
    """Entries of a legend, as the names were given."""
    found = [text.get_text() for text in axes.get_legend().get_texts()] if axes.get_legend() else []
    return [text.lstrip().replace(r"\$", "$") for text in found]


def shown(axes: Any) -> list[Any]:
    """The lines of a panel but for limits, edges, dots and zero lines."""
    return [x for x in axes.lines if x.get_gid() is None and len(x.get_ydata()) == SAMPLES]


def unit_of(label: str) -> str:
    """The unit on an axis; 1 for a share or a unit norm."""
    found = re.search(r"\[(.*)\]", label)
    return found[1] if found else "1"


# --- names and values -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("continuous", ["angle", "cos_sin"])
@pytest.mark.parametrize("name", ["q", "v", "p", "tau"])
def test_each_line_of_a_trajectory_is_the_column_of_its_name(name: str, continuous: str) -> None:
    run = motion(1, continuous)
    of_q, of_v = parts(run.model, continuous == "cos_sin")
    at = {label: k for k, (label, _, _) in enumerate(of_q if name == "q" else of_v)}
    values, found = getattr(run, name), []
    for axes in run.plot(name).axes:
        assert re.split("[ ,]", axes.get_ylabel())[0] == SYMBOLS[name]
        for label, line in zip(labels(axes), shown(axes), strict=True):
            np.testing.assert_array_equal(line.get_ydata(), values[:, at[label]])
            np.testing.assert_array_equal(line.get_xdata(), run.t)
            found.append(label)
        limits = {"q": (run.model.lower, run.model.upper), "v": (-run.model.velocity_limit, run.model.velocity_limit),
                  "tau": (-run.model.effort_limit, run.model.effort_limit)}.get(name, ())  # fmt: skip
        wanted = {x[at[label]] for x in limits for label in labels(axes)} - {math.inf, -math.inf}
        assert {line.get_ydata()[0] for line in axes.lines if line.get_gid() == "limit"} == wanted
    assert sorted(found) == sorted(at)


@pytest.mark.parametrize("name", ["q", "v", "p", "tau"])
def test_each_panel_of_a_comparison_is_the_column_of_its_name(name: str) -> None:
    kinds = ("revolute", "prismatic", "floating")
    first = motion(2, kinds=kinds)
    second = sd.Trajectory(**{**vars(first), name: getattr(first, name) + 0.25})
    of_q, of_v = parts(first.model, False)
    panels = sd.plot([first, second], name).axes
    assert len(panels) == getattr(first, name).shape[1]
    for axes, (label, _, _), column in zip(panels, of_q if name == "q" else of_v, itertools.count(), strict=False):
        assert re.split("[ ,]", axes.get_ylabel())[0] == SYMBOLS[name]
        assert axes.get_title().lstrip().replace(r"\$", "$") == label
        for line, run in zip(axes.lines, (first, second), strict=True):
            np.testing.assert_array_equal(line.get_ydata(), getattr(run, name)[:, column])


def test_the_difference_is_the_largest_of_its_unit() -> None:
    first, second = motion(2), motion(2)
    second = sd.Trajectory(**{**vars(second), "q": second.q[::-1].copy()})
    apart = abs(np.asarray(sd.difference(first.model, first.q, second.q)))
    power = np.array([power for _, _, power in parts(first.model, False)[1]])
    for axes in sd.plot([first, second], "difference").axes:
        wanted = apart[:, power == (unit_of(axes.get_ylabel()) == "m")].max(axis=1)
        wanted[wanted == 0.0] = np.nan
        np.testing.assert_allclose(axes.lines[0].get_ydata(), wanted, rtol=CLOSE)


@pytest.mark.parametrize("name", ["q", "v"])
def test_each_band_of_a_rollout_is_of_the_column_of_its_name(name: str) -> None:
    found = rolled(3)
    at = {label: k for k, (label, _, _) in enumerate(parts(found.model, False)[name == "v"])}
    values, seen = getattr(found, name), []
    for axes in found.plot(name, sample=2).axes:
        assert re.split("[ ,]", axes.get_ylabel())[0] == SYMBOLS[name]
        edges, ones = ([x for x in axes.lines if x.get_gid() == gid] for gid in ("edge", "sample"))
        for k, (label, line) in enumerate(zip(labels(axes), shown(axes), strict=True)):
            low, middle, high = np.percentile(values[:, :, at[label]], (5, 50, 95), axis=0)
            for drawn, wanted in ((edges[2 * k], low), (line, middle), (edges[2 * k + 1], high)):
                np.testing.assert_allclose(drawn.get_ydata(), wanted, rtol=CLOSE)
            filled = axes.collections[k].get_paths()[0].vertices[:, 1]
            np.testing.assert_allclose((filled.min(), filled.max()), (low.min(), high.max()), rtol=CLOSE)
            np.testing.assert_array_equal(ones[k].get_ydata(), values[2, :, at[label]])
            assert {x.get_color() for x in (*edges[2 * k : 2 * k + 2], ones[k])} == {line.get_color()}
            seen.append(label)
    assert sorted(seen) == sorted(at)


def test_energies_are_those_of_the_states() -> None:
    run = motion(4)
    both, drift = run.plot("energy").axes
    wanted = {
        "T kinetic": np.asarray(sd.kinetic_energy(run.model, run.q, run.v)),
        "V potential": np.asarray(sd.potential_energy(run.model, run.q)),
        "T + V": run.energy,
    }
    assert labels(both) == list(wanted)
    for label, line in zip(labels(both), both.lines, strict=True):
        np.testing.assert_allclose(line.get_ydata(), wanted[label], rtol=CLOSE)
    np.testing.assert_array_equal(drift.lines[0].get_ydata()[1:], abs(run.energy - run.energy[0])[1:])
    total, drifts = sd.plot([run, run], "energy").axes
    np.testing.assert_array_equal(total.lines[1].get_ydata(), run.energy)
    np.testing.assert_array_equal(drifts.lines[1].get_ydata()[1:], abs(run.energy - run.energy[0])[1:])


def test_phases_and_shares_of_limits_are_those_of_the_joints() -> None:
    run = motion(4)
    model = run.model
    for axes in run.plot("phase").axes:
        for label, line in zip(labels(axes), shown(axes), strict=True):
            joint = model.joint(label)
            np.testing.assert_array_equal(line.get_xdata(), run.q[:, joint.idx_q])
            np.testing.assert_array_equal(line.get_ydata(), run.v[:, joint.idx_v])
    of = {"q": (run.q, model.lower, model.upper), "v": (run.v, -model.velocity_limit, model.velocity_limit),
          "τ": (run.tau, -model.effort_limit, model.effort_limit)}  # fmt: skip
    panels = run.plot("limits").axes
    assert [axes.get_ylabel().split()[0] for axes in panels] == list(of)
    for axes in panels:
        values, lower, upper = of[axes.get_ylabel().split()[0]]
        assert sorted(labels(axes)) == ["_prismatic$", "_revolute$"]
        for label, line in zip(labels(axes), shown(axes), strict=True):
            at = model.joint(label).idx_q if values is run.q else model.joint(label).idx_v
            share = line.get_ydata()  # -1 at the lower limit, 1 at the upper one
            wanted = lower[at] + 0.5 * (share + 1.0) * (upper[at] - lower[at])
            np.testing.assert_allclose(values[:, at], wanted, rtol=CLOSE, atol=CLOSE)


@pytest.mark.parametrize("terrain", [None, sd.Plane((0.2, -0.1, 1.0))])
def test_forces_of_points_are_impulses_over_steps_in_their_cones(terrain: Any) -> None:
    run = touched(terrain=terrain)
    assert run.contacts is not None
    n = np.array(run.scene.contacts.terrain.normal)
    force = run.contacts.impulse / run.dt
    along = force @ n
    across = np.linalg.norm(force - along[..., None] * n, axis=-1)
    with np.errstate(invalid="ignore"):
        share = np.where(along > 0.0, across / (run.scene.contacts.friction * along), np.nan)
    gap, normal, used, cone = run.plot("contacts").axes
    for axes, wanted in ((gap, run.contacts.gap), (normal, along), (used, share)):
        assert labels(axes) == list(MU)
        for k, line in enumerate(shown(axes)):
            np.testing.assert_allclose(line.get_ydata(), wanted[:, k], rtol=CLOSE, atol=CLOSE)
    for k, line in enumerate(shown(cone)):
        np.testing.assert_allclose(line.get_xdata(), across[:, k], rtol=CLOSE, atol=CLOSE)
        np.testing.assert_allclose(line.get_ydata(), along[:, k], rtol=CLOSE, atol=CLOSE)
    edges = sorted(x.get_xdata()[1] / x.get_ydata()[1] for x in cone.lines if x.get_gid() == "cone")
    assert edges == pytest.approx([0.3, 0.6, 0.9])
    assert cone.get_ylim()[1] >= along.max()


def test_forces_of_a_run_stay_in_their_cones_on_hills_and_in_a_short_last_step() -> None:
    """Where points slide the share is 1 to rounding: it is taken on the slopes that the steps were."""
    model = sd.load_urdf("floating_body", root="floating")
    hills = sd.Heightfield(0.05 * np.sin(np.arange(30.0)).reshape(5, 6), 0.3, (-0.6, -0.7))
    name = model.robot.root
    contacts = sd.Contacts(model, {name: 0.1}, friction=0.2, terrain=hills)
    q = np.array(sd.neutral(model))
    q[2] -= sd.contact_gaps(model, contacts, q)[0]
    v = np.zeros(model.nv)
    v[0] = 1.0
    run = sd.simulate(sd.Scene(model, contacts=contacts), q, v, 0.1005, 1e-3, record="contacts")
    forces = contact_plots.point_forces(run)
    assert run.contacts is not None
    last = run.contacts.impulse[-1, 0] / 0.0005
    assert np.hypot(forces.normal[-1], forces.tangential[-1]) == pytest.approx(np.linalg.norm(last))
    sliding = forces.share[np.isfinite(forces.share)]
    assert len(sliding) > 20
    assert np.median(sliding) == pytest.approx(1.0, abs=1e-9)
    assert sliding.max() < 1.0 + 1e-9


def test_a_plot_of_contacts_says_what_it_lacks() -> None:
    run = touched()
    for change, words in (
        ({"contacts": None}, 'has no record of contacts, expected simulate(..., record="contacts")'),
        ({"scene": None}, "loaded without its model, expected one to draw contacts"),
        ({"scene": sd.Scene(run.model)}, "has no contact points, expected some to draw"),
    ):
        with pytest.raises(sd.SpatialDynError, match=re.escape(words)):
            sd.Trajectory(**{**vars(run), **change}).plot("contacts")


def test_works_have_their_signs_and_their_names() -> None:
    found = ledger()
    assert any((x.sum(axis=1) < 0.0).any() for x in found.work.values())
    works, error = found.plot().axes
    wanted = {"change of T + V": found.change, **{f"work of {kind}": x.sum(axis=1) for kind, x in found.work.items()}}
    assert labels(works) == list(wanted)
    for label, line in zip(labels(works), shown(works), strict=True):
        np.testing.assert_array_equal(line.get_ydata(), wanted[label])
    np.testing.assert_array_equal(error.lines[0].get_ydata(), abs(found.error))
    for kind, x in found.work.items():
        axes = found.plot(kind=kind).axes[0]
        assert axes.get_ylabel() == f"work of {kind} [J]"
        for label, line in zip(labels(axes), shown(axes), strict=True):
            np.testing.assert_array_equal(line.get_ydata(), x[:, found.labels[kind].index(label)])


@pytest.mark.parametrize(("task", "cost"), [("crba", 1.0), ("simulate", 1e-6)])
def test_errors_and_costs_are_those_of_the_options(task: str, cost: float) -> None:
    names = [f"way {k}" if task == "crba" else f"rk{k}, dt 0.01" for k in range(3)]
    options = [
        Option(name, "", 10.0 ** -(k + 3), 0.0, 1.0, 7.0 * (k + 1), promised=10.0**-k) for k, name in enumerate(names)
    ]
    found = Tradeoff("arm", task, mark_pareto(options), 4, 64, 1.0, 0.0, "truth")
    (axes,) = found.plot().axes
    for name, option, line in zip(labels(axes), options, axes.lines[::2], strict=False):
        assert option.name.startswith(name)
        assert (line.get_xdata()[0], line.get_ydata()[0]) == pytest.approx((cost * option.ns, option.error))
    spans = [part for lines in axes.collections for part in lines.get_segments()]
    assert sorted(spans[k][0, 0] for k in range(3)) == pytest.approx([cost * x.ns for x in options])
    for (x, low), (_, high) in spans:
        option = min(options, key=lambda one: abs(cost * one.ns - x))
        assert (low, high) == pytest.approx((option.error, option.promised))


# --- units ----------------------------------------------------------------------------------------------------


def compared(what: str, grown: bool) -> Any:
    """Two runs beside each other, the second backwards."""
    run = motion(6, grown=grown, kinds=KINDS[:5])
    return sd.plot([run, sd.Trajectory(**{**vars(run), "q": run.q[::-1].copy()})], what)


FIGURES = {
    **{x: lambda grown, x=x: motion(6, grown=grown).plot(x) for x in trajectory_plots.WHAT if x != "contacts"},
    "contacts": lambda grown: touched(grown).plot("contacts"),
    **{f"{x} compared": lambda grown, x=x: compared(x, grown) for x in comparison_plots.COMPARED},
    **{f"{x} rolled": lambda grown, x=x: rolled(6, grown).plot(x) for x in "qv"},
    "works": lambda grown: ledger(grown).plot(),
    "works of one kind": lambda grown: ledger(grown).plot(kind="friction"),
}


@pytest.mark.parametrize("name", FIGURES)
def test_what_an_axis_shows_has_the_dimension_of_its_unit(name: str) -> None:
    before, after = (FIGURES[name](grown).axes for grown in (False, True))
    assert len(before) == len(after) > 0
    compared = 0
    for one, other in zip(before, after, strict=True):
        assert one.get_ylabel() == other.get_ylabel()
        factor = growth(unit_of(one.get_ylabel()))
        for line, grown in zip(one.lines, other.lines, strict=True):
            y, wanted = np.asarray(line.get_ydata(), float), np.asarray(grown.get_ydata(), float)
            np.testing.assert_allclose(wanted, factor * y, rtol=CLOSE, atol=1e-12 * abs(factor), equal_nan=True)
            compared += len(y) > 1 and bool(np.nan_to_num(y).any())
        if "[" in one.get_xlabel():
            across = growth(unit_of(one.get_xlabel()))
            for line, grown in zip(shown(one), shown(other), strict=True):
                if one.get_xlabel().startswith("q"):
                    np.testing.assert_allclose(grown.get_xdata(), across * np.asarray(line.get_xdata()), rtol=CLOSE)
    assert compared
