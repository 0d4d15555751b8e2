"""Paths: by hand, by differences, on groups, in limits, and what they refuse."""

from __future__ import annotations

import numpy as np
import pytest

import spatialdyn as sd

STEP = 1e-5  # s, of central differences
SLOPE = 1e-7  # their error: h² times a third derivative of some 10, and eps / h²


def body() -> sd.Model:
    """A floating body that carries a ball joint, a slide, and beside them a planar joint."""
    solid = (1.0, (0.1, 0.0, 0.2), 0.1 * np.eye(3))
    builder = sd.ModelBuilder("body", "world").add_body("base", None, "floating", inertia=solid)
    builder.add_body("ball", "base", "spherical", inertia=solid)
    builder.add_body("slide", "ball", "prismatic", (0, 1, 0), inertia=solid)
    return builder.add_body("cart", None, "planar", (0, 0, 1), inertia=solid).build()


def slopes(path: sd.Path, model: sd.Model | None, t: float) -> tuple[np.ndarray, np.ndarray]:
    """v and a by central differences of q and v."""
    before, after = path(t - STEP), path(t + STEP)
    way = after.q - before.q if model is None else sd.difference(model, before.q, after.q)
    return way / (2.0 * STEP), (after.v - before.v) / (2.0 * STEP)


def test_a_spline_meets_its_points_and_is_smooth_in_between() -> None:
    times, points = [0.0, 0.5, 1.5, 2.0], np.random.default_rng(0).normal(size=(4, 3))
    path = sd.spline(times, points)
    assert abs(path(times).q - points).max() < 1e-14
    assert abs(path([0.0, 2.0]).v).max() < 1e-14
    for knot in times[1:-1]:  # q, v and a are continuous
        left, right = path(knot - 1e-12), path(knot + 1e-12)
        assert all(abs(x - y).max() < 1e-9 for x, y in zip(left, right, strict=True))
    natural = sd.spline(times, points, ends="natural")
    assert abs(natural([0.0, 2.0]).a).max() < 1e-13
    for t in (0.3, 0.7, 1.9):
        assert all(abs(x - y).max() < SLOPE for x, y in zip(slopes(path, None, t), path(t)[1:], strict=True))


def test_a_quintic_is_the_minimum_jerk_polynomial() -> None:
    path, x = sd.quintic([1.0, 2.0], [2.0, 0.0], 4.0), 0.25
    s = 10 * x**3 - 15 * x**4 + 6 * x**5
    assert abs(path(1.0).q - [1.0 + s, 2.0 - 2.0 * s]).max() < 1e-14
    peaks = path.peaks()
    assert abs(peaks.v - np.array([1.0, 2.0]) * 15 / 8 / 4).max() < 1e-12
    assert abs(peaks.a - np.array([1.0, 2.0]) * 10 / np.sqrt(3) / 16).max() < 1e-12
    assert abs(peaks.lowest - [1.0, 0.0]).max() < 1e-12
    assert abs(path([-1.0, 5.0]).q - [[1.0, 2.0], [2.0, 0.0]]).max() == 0.0  # at rest outside
    assert not path([-1.0, 5.0]).v.any()
    assert not path(5.0).a.any()


def test_a_trapezoid_keeps_its_bounds_and_no_other_does_it_faster() -> None:
    path = sd.trapezoid([0.0, 0.0], [1.0, -0.5], [0.5, 0.5], [1.0, 0.1])
    t = np.linspace(0.0, path.duration, 2001)
    v, a = path(t)[1:]
    assert abs(v).max() <= 0.5 + 1e-12
    assert abs(a[:, 1]).max() <= 0.1 + 1e-12
    assert abs(path(path.duration).q - [1.0, -0.5]).max() < 1e-12
    short = sd.trapezoid([0.0], [0.04], 1.0, 1.0)  # never as fast as it may be
    assert abs(short.duration - 0.4) < 1e-14
    assert abs(short.peaks().v[0] - 0.2) < 1e-14
    slower = sd.trapezoid([0.0], [1.0], 0.5, 1.0)
    assert abs(slower.duration - (1.0 / 0.5 + 0.5 / 1.0)) < 1e-12


def test_a_fourier_path_is_periodic_and_its_own_derivative() -> None:
    draw = np.random.default_rng(1)
    path = sd.fourier(draw.normal(size=(3, 2)), draw.normal(size=(3, 2)), 0.25, [0.1, 0.2])
    assert path.duration == 4.0
    assert abs(path(0.3).q - path(4.3).q).max() < 1e-13
    assert all(abs(x - y).max() < SLOPE for x, y in zip(slopes(path, None, 0.8), path(0.8)[1:], strict=True))
    mean = path(np.linspace(0.0, 4.0, 4000, endpoint=False)).q.mean(0)
    assert abs(mean - [0.1, 0.2]).max() < 1e-12


@pytest.mark.parametrize("kind", ["spline", "fourier"])
def test_velocity_and_acceleration_on_groups_are_rates_of_the_motion(kind: str) -> None:
    model, draw = body(), np.random.default_rng(2)
    if kind == "spline":
        points = sd.integrate(model, sd.neutral(model), 0.6 * draw.normal(size=(4, model.nv)))
        path = sd.spline([0.0, 1.0, 2.0, 3.0], points, model)
        assert abs(sd.difference(model, path([0.0, 1.0, 2.0, 3.0]).q, points)).max() < 1e-13
    else:
        path = sd.fourier(*draw.normal(size=(2, 2, model.nv)), 0.3, sd.neutral(model), model)
    for t in (0.4, 1.3, 2.6):
        found = zip(slopes(path, model, t), path(t)[1:], strict=True)
        assert all(abs(x - y).max() < 10.0 * SLOPE for x, y in found)


def test_a_path_between_two_configurations_is_that_of_interpolate() -> None:
    model = body()
    q1 = sd.neutral(model)
    q0 = sd.integrate(model, q1, 0.5 * np.random.default_rng(1).normal(size=model.nv))
    path = sd.quintic(q0, q1, 1.0, model)
    x = 0.3
    s = 10 * x**3 - 15 * x**4 + 6 * x**5
    assert abs(sd.difference(model, path(x).q, sd.interpolate(model, q0, q1, s))).max() < 1e-13


def test_peaks_of_polynomials_are_exact_where_samples_are_near() -> None:
    path = sd.spline([0.0, 1.0, 2.5, 3.0], np.random.default_rng(3).normal(size=(4, 2)))
    t = np.linspace(0.0, 3.0, 20001)
    q, v, a = path(t)
    peaks = path.peaks()
    assert abs(peaks.v - abs(v).max(0)).max() < 1e-6
    assert abs(peaks.a - abs(a).max(0)).max() < 1e-2 * peaks.a.max()
    assert (peaks.highest >= q.max(0) - 1e-12).all()
    assert abs(peaks.highest - q.max(0)).max() < 1e-6


def test_a_path_beyond_limits_is_refused_by_joint() -> None:
    builder = sd.ModelBuilder("arm").add_body(
        "rod", None, limits=sd.JointLimits(-1.0, 1.0, velocity=2.0), inertia=(1.0, (0, 0, 1), np.eye(3))
    )
    model = builder.build()
    with pytest.raises(sd.SpatialDynError, match=r'joint "rod.*" to 1.5, expected its limits, -1 to 1'):
        sd.quintic([0.0], [1.5], 1.0, model)
    with pytest.raises(sd.SpatialDynError, match=r"at 3.75, expected at most 2"):
        sd.quintic([0.0], [1.0], 0.5, model)
    assert sd.quintic([0.0], [1.0], 0.5, model, limits=False).duration == 0.5
    sd.quintic([0.0], [1.0], 2.0, model)  # touches its limit
    with pytest.raises(sd.SpatialDynError, match=r'path 2 moves joint "rod.*" to -1.2, expected'):
        sd.quintic([[0.0], [0.5], [-1.2]], [0.1], 4.0, model)


@pytest.mark.parametrize("use", ["call", "rollout", "simulate", "check"])
def test_a_path_of_numbers_is_held_to_the_limits_of_the_robot_that_it_meets(use: str) -> None:
    def met(path: sd.Path, model: sd.Model) -> None:
        law = sd.PDPlus(1.0, 1.0, path)
        if use == "call":
            law(model, 0.0, [0.0], [0.0])
        elif use == "check":
            path.check_model(model)
        elif use == "rollout":
            sd.rollout(model, [0.0], [0.0], dt=0.01, steps=1, control=law)
        else:
            sd.simulate(model, [0.0], [0.0], 0.01, 0.01, control=law)

    def arm(most: float, fast: float) -> sd.Model:
        rod = sd.JointLimits(-1.0, most, velocity=fast)
        return sd.ModelBuilder("arm").add_body("rod", limits=rod, inertia=(1.0, (0, 0, 1), np.eye(3))).build()

    for path in (sd.quintic([0.0], [1.5], 2.0), sd.quintic([[0.0], [0.1]], [1.5], 2.0)[0]):
        with pytest.raises(sd.SpatialDynError, match=r'path moves joint "rod.*" to 1.5, expected its limits, -1 to 1'):
            met(path, arm(1.0, 10.0))
        with pytest.raises(sd.SpatialDynError, match=r"at 1.40625, expected at most 1, its limit"):
            met(path, arm(2.0, 1.0))
        met(path, arm(2.0, 10.0))
    met(sd.quintic([0.0], [1.5], 2.0, limits=False), arm(1.0, 1.0))
    met(sd.quintic([[0.0], [0.1]], [1.5], 2.0, limits=False)[0], arm(1.0, 1.0))


def test_a_path_serves_robots_of_its_joints_whatever_they_weigh() -> None:
    solid = (1.0, (0.1, 0.0, 0.2), 0.1 * np.eye(3))
    free = sd.ModelBuilder("free", "world").add_body("base", None, "floating", inertia=solid)
    model = free.add_body("arm", "base", axis=(0, 0, 1), inertia=solid, limits=(-1.0, 1.0)).build()
    q = sd.integrate(model, sd.neutral(model), np.full(7, 0.2))
    path = sd.quintic(sd.neutral(model), q, 1.0, model)
    law = sd.ComputedTorque(9.0, 6.0, path)
    loaded = model.with_(payload={"arm": (2.0, [0.0, 0.0, 0.1], np.zeros((3, 3)))})
    for other in (loaded, model.with_(gravity=[0.0, 0.0, -1.62])):
        at = path(0.5)
        want = sd.rnea(other, at.q, at.v, at.a)
        assert abs(law(other, 0.5, at.q, at.v) - want).max() < 1e-12 * abs(want).max()
    hold = sd.Impedance(model, "arm", np.eye(4), 100.0, 10.0)
    hold.checks[0](loaded)
    for kind, name in (("prismatic", "arm"), ("revolute", "leg")):
        other = sd.ModelBuilder("other", "world").add_body("base", None, "floating", inertia=solid)
        built = other.add_body(name, "base", kind, (0, 0, 1), inertia=solid, limits=(-1.0, 1.0)).build()
        with pytest.raises(sd.SpatialDynError, match=f'other joints: revolute "arm.*" is not {kind} "{name}'):
            path.check_model(built)
    narrow = sd.ModelBuilder("narrow", "world").add_body("base", None, "floating", inertia=solid)
    built = narrow.add_body("arm", "base", axis=(0, 0, 1), inertia=solid, limits=(-0.1, 0.1)).build()
    with pytest.raises(sd.SpatialDynError, match=r"to 0.2, expected its limits, -0.1 to 0.1"):
        path.check_model(built)


def test_paths_refuse_what_is_none() -> None:
    model = body()
    with pytest.raises(sd.SpatialDynError, match=r"times is .* expected increasing"):
        sd.spline([0.0, 0.0], [[1.0], [2.0]])
    with pytest.raises(sd.ShapeError, match=r"points has shape \(3, 1\)"):
        sd.spline([0.0, 1.0], [[1.0], [2.0], [3.0]])
    with pytest.raises(sd.NonFiniteError, match="points"):
        sd.spline([0.0, 1.0], [[1.0], [np.nan]])
    with pytest.raises(sd.SpatialDynError, match="T is 0, expected"):
        sd.quintic([0.0], [1.0], 0)
    for T in (1e-100, 1e100):
        with pytest.raises(
            sd.SpatialDynError, match=r"T is .*, expected a finite number above 0, from 1e-50 to 1e\+50"
        ):
            sd.quintic([0.0], [1.0], T)
    with pytest.raises(sd.SpatialDynError, match="v_max"):
        sd.trapezoid([0.0], [1.0], -1.0, 1.0)
    with pytest.raises(sd.SpatialDynError, match="q1 is q0"):
        sd.trapezoid([0.0], [0.0], 1.0, 1.0)
    with pytest.raises(sd.ShapeError, match=r"batch shapes do not broadcast: q0 \(2,\), q1 \(3,\)"):
        sd.quintic(np.zeros((2, 1)), np.ones((3, 1)), 1.0)
    with pytest.raises(sd.ShapeError, match="one alone"):
        sd.quintic([0.0], [1.0], 1.0)[0]
    far = sd.integrate(model, sd.neutral(model), np.r_[np.zeros(3), 3.1, np.zeros(model.nv - 4)])
    with pytest.raises(sd.SpatialDynError, match=r"turns joint .* by 3.1 rad"):
        sd.quintic(sd.neutral(model), far, 1.0, model)
    with pytest.raises(sd.SpatialDynError, match=r'2 coordinates that are numbers, expected the .* "body"'):
        sd.quintic([0.0, 0.0], [1.0, 1.0], 1.0).check_model(model)
    with pytest.raises(sd.SpatialDynError, match='path is of robot "body", expected one of "two_link"'):
        sd.quintic(sd.neutral(model), sd.neutral(model), 1.0, model).check_model(sd.load_urdf("two_link"))


@pytest.mark.parametrize("kind", ["spline", "quintic", "trapezoid", "fourier"])
def test_paths_of_samples_are_each_its_own(kind: str) -> None:
    model, draw = body(), np.random.default_rng(5)
    q = sd.integrate(model, sd.neutral(model), 0.5 * draw.normal(size=(3, 4, model.nv)))
    rates = draw.normal(size=(3, 2, 2, model.nv))
    make = {
        "spline": lambda b: sd.spline([0.0, 0.3, 0.8, 1.0], q[b], model),
        "quintic": lambda b: sd.quintic(q[b][..., 0, :], q[0, 3], 1.0, model),
        "trapezoid": lambda b: sd.trapezoid(q[b][..., 0, :], q[b][..., 1, :], 0.5, 1.0 + np.arange(model.nv), model),
        "fourier": lambda b: sd.fourier(rates[b][..., 0, :, :], rates[b][..., 1, :, :], 1.0, q[0, 0], model),
    }[kind]
    whole = make(np.arange(3))
    assert whole.batch == (3,)
    t = np.array([-0.1, 0.0, 0.31, 0.8, 1.7])
    for b in range(3):
        one = make(b)
        assert whole[b].duration == one.duration
        for many, alone, own in zip(whole(t[:, None]), one(t), whole[b](t), strict=True):
            assert abs(many[:, b] - alone).max() < 1e-13
            assert (own == many[:, b]).all()
        peaks = zip(whole.peaks(), one.peaks(), strict=True)
        assert all(abs(x[b] - y).max() < (1e-12 if kind != "trapezoid" else 0.05) for x, y in peaks)  # on other samples
    assert abs(whole([0.1, 0.2, 0.3]).q[1] - make(1)(0.2).q).max() < 1e-13


def test_extremes_of_several_cubics_are_those_of_fine_samples() -> None:
    points = np.random.default_rng(6).normal(size=(50, 5, 3))
    path = sd.spline([0.0, 0.4, 1.0, 1.5, 2.0], points)
    found = path(np.linspace(0.0, 2.0, 4001)[:, None])
    peaks = path.peaks()
    for value, wanted in (
        (peaks.highest, found.q.max(0)), (peaks.lowest, found.q.min(0)), (peaks.v, abs(found.v).max(0)),
        (peaks.a, abs(found.a).max(0)),
    ):  # fmt: skip
        assert abs(value - wanted).max() < 1e-5 * abs(wanted).max() * (1000 if value is peaks.a else 1)
    assert (peaks.highest >= found.q.max(0) - 1e-12).all()


def test_a_path_is_drawn() -> None:
    figure = sd.quintic([0.0, 0.0], [1.0, 2.0], 2.0).plot()
    assert [len(x.lines) for x in figure.axes] == [2, 2, 2]
    with pytest.raises(sd.ShapeError, match=r"is 2 paths, expected one to draw"):
        sd.quintic([[0.0], [1.0]], [2.0], 2.0).plot()
