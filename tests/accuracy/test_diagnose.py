"""Findings on models with one oddity each, and predicted digits against measured ones."""

from __future__ import annotations

import importlib
import itertools
import json
import math
import warnings
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from dense import Array
from inputs import empty_memory
from trees import random_inertia, random_tree

import spatialdyn as sd
from spatialdyn.accuracy import predicted_digits as digits_module
from spatialdyn.accuracy import references
from spatialdyn.accuracy.predicted_digits import EPS, predicted_digits, program_errors
from spatialdyn.calls.dynamics import calls
from spatialdyn.calls.forward_dynamics import EXTENDED, METHODS
from spatialdyn.commands import cli
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.record.regroup import regroup
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.urdf.load import example_robots

rules = importlib.import_module("spatialdyn.accuracy.diagnose")  # the package has the function under that name
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="float32 is a program")
AXES = np.eye(3)
PROMISED = 0.9  # of the cases are within a digit of the measured ones
BAR = (1.0, (0.3, 0.0, 0.0), np.diag([0.01, 0.02, 0.02]))


def chain(masses: Sequence[float], seed: int, planar: bool = False, armature: float = 0.0) -> sd.Model:
    """Bodies of these masses, random of shape, on joints about coordinate axes, frames shifted and not turned."""
    rng, builder = np.random.default_rng(seed), sd.ModelBuilder("chain")
    for k, mass in enumerate(masses):
        axis = AXES[2] if planar else AXES[rng.integers(3)]
        whole, com, I = random_inertia(rng)
        placement = rng.uniform(-0.5, 0.5, size=3)
        parent = f"b{k - 1:03d}" if k else None
        builder.add_body(
            f"b{k:03d}", parent, "revolute", axis, placement, (mass, com, mass / whole * I), armature=armature
        )
    return builder.build()


def states(model: sd.Model, seed: int) -> list[tuple[Array, Array, Array]]:
    """Three random states q, v, tau of revolute joints."""
    rng = np.random.default_rng(seed)
    return [(rng.uniform(-3.0, 3.0, model.nv), *rng.normal(size=(2, model.nv))) for _ in range(3)]


def measured(found: list[Any], wanted: list[Array], dtype: str) -> float:
    """Digits of the largest entry, the worst of some samples."""
    error = max(float(abs(x - y).max() / abs(y).max()) for x, y in zip(found, wanted, strict=True))
    return -math.log10(min(1.0, max(EPS[dtype], error)))


@compiled
def test_a_robot_is_diagnosed_without_table_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of five calls and methods take a minute to compile."""
    for name in ("sample_kernel", "batch_kernel"):
        monkeypatch.setattr(numba_kernels, name, None)  # not callable
    found = sd.diagnose(sd.load_urdf("two_link"))
    assert found.severity == "ok"
    assert {*found.digits} == {*METHODS, EXTENDED}
    assert min(of["float64"] for of in found.digits.values()) > 13.0


CASES = (
    *[((1.0,) * 6 + (10.0**k,), planar) for k in (0, 3, 6, 9, 12, -6, -12) for planar in (False, True)],
    *[((1.0,) * 3 + (10.0**k,) + (1.0,) * 3, False) for k in (-12, 12)],
    *[((1.0,) * 12, planar) for planar in (False, True)],
)


# --- digits ----------------------------------------------------------------------------------------------


@pytest.mark.slow(quick="test_a_heavy_tip_costs_aba_its_digits_and_the_square_root_form_none")
@pytest.mark.skipif(numba_kernels.PLAIN, reason="heavy: measured by compiled calls")
def test_predicted_digits_are_within_one_of_those_measured() -> None:
    """Heavy and light tips and middles, and long chains; other states than those that predict."""
    pytest.importorskip("mpmath")
    off = []
    for seed, (masses, planar) in enumerate(CASES):
        model = chain(masses, seed, planar)
        fresh = states(model, 1000 + seed)
        wanted = [sd.exact(model, sd.aba)(*s).astype(float) for s in fresh]
        predicted = predicted_digits(model, states(model, seed))
        for method in (*METHODS, EXTENDED):
            found = [sd.forward_dynamics(model, *s, method=method) for s in fresh]
            off.append(predicted[method]["float64"] - measured(found, wanted, "float64"))
    assert np.mean(abs(np.array(off)) <= 1.0) >= PROMISED


@pytest.mark.slow(quick="test_a_heavy_tip_costs_aba_its_digits_and_the_square_root_form_none")
@compiled
def test_predicted_digits_of_float32_are_within_one_of_those_measured() -> None:
    """To a tip of 1e4: beyond, programs find pivots next to 0 and turn to float64."""
    pytest.importorskip("mpmath")
    off = []
    for seed, k in itertools.product(range(2), (0, 2, 4)):
        model = chain((1.0,) * 6 + (10.0**k,), seed)
        fresh, predicted = states(model, 1000 + seed), predicted_digits(model, states(model, seed))
        wanted = [sd.exact(model, sd.aba)(*s).astype(float) for s in fresh]
        for method in ("aba", "crba", "refined"):
            program = sd.specialize(model, calls[METHODS[method]], dtype=np.float32)
            found = [program(*(np.float32(x) for x in s)) for s in fresh]
            off.append(predicted[method]["float32"] - measured(found, wanted, "float32"))
    assert np.mean(abs(np.array(off)) <= 1.0) >= PROMISED


def test_a_heavy_tip_costs_aba_its_digits_and_the_square_root_form_none() -> None:
    model = chain((1.0,) * 6 + (1e9,), 3)
    digits = predicted_digits(model, states(model, 3))
    assert digits["aba"]["float64"] < 10.0
    assert digits["refined"]["float64"] > 12.0
    assert digits["square_root"]["float64"] > 13.0
    assert digits["aba"]["float32"] < 1.0


@pytest.mark.parametrize(("mass", "digits"), [(1.0, True), (1e-20, True), (1e25, True), (1e-42, False), (1e39, False)])
def test_a_link_out_of_the_range_of_float32_is_named(mass: float, digits: bool) -> None:
    """Digits are predicted where float32 still has some, and the link is named where programs turn to float64."""
    model = chain((1.0, mass), 4)
    found = sd.diagnose(model)
    assert found.digits["aba"]["float64"] > 10.0
    named = {f.link: f for f in found.of("range")}
    assert ("b001" in named) == (mass != 1.0)
    if named:
        assert f"of {mass:.4g} kg" in named["b001"].message
        assert "units" in named["b001"].remedy
    light = chain((mass, mass), 4)
    assert (sd.diagnose(light).digits["aba"]["float32"] > 5.0) == digits


def test_one_seed_predicts_the_same_again() -> None:
    model = chain((1.0, 1.0, 1e4), 5)
    assert sd.diagnose(model) == sd.diagnose(model)


# --- findings --------------------------------------------------------------------------------------------


def test_nothing_is_odd_about_a_plain_arm() -> None:
    model = chain((3.0, 2.0, 1.0), 0)
    found = sd.diagnose(model)
    assert found.findings == ()
    assert found.subject is model
    assert "subject" not in found.to_dict()
    assert found.severity == "ok"
    assert found.condition["neutral"] >= 1.0


@pytest.mark.parametrize(("moments", "severity"), [((1, 1, 9), "warning"), ((1, 1, -9), "error")])
def test_an_impossible_inertia_is_named(moments: tuple[float, ...], severity: str) -> None:
    """An error where motions can have negative energy, so that M need not be positive definite."""
    builder = sd.ModelBuilder("m")
    builder.add_body("slab", None, "revolute", (0, 1, 0), inertia=(1.0, (1, 0, 0), np.diag(moments)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = sd.diagnose(builder.build())
    (finding,) = found.of("inertia")
    assert (finding.severity, finding.link) == (severity, "slab")
    assert "repair" in finding.remedy
    assert found.severity == severity


def test_an_inertia_without_mass_is_named() -> None:
    builder = sd.ModelBuilder("m").add_body(
        "ghost", None, "revolute", inertia=(0.0, (0, 0, 0), np.diag([1.0, 1.0, 1.0]))
    )
    (finding,) = sd.diagnose(builder.build()).of("inertia")
    assert (finding.severity, finding.link) == ("warning", "ghost")


def test_a_heavy_body_on_light_ones_is_named_and_a_light_one_is_not() -> None:
    found = sd.diagnose(chain((1.0,) * 6 + (1e9,), 3))
    assert [f.link for f in found.of("mass ratio")] == ["b006"]
    digits = found.of("digits")
    assert digits[0].link == "b006"
    assert "refined" in digits[0].remedy or "square_root" in digits[0].remedy
    light = sd.diagnose(chain((1.0,) * 6 + (1e-9,), 3))
    assert light.of("mass ratio") == light.of("digits") == ()


def test_a_negative_inertia_is_an_error_and_no_warning_of_numpy() -> None:
    """Warnings are errors here: its root is taken of no negative number."""
    builder = sd.ModelBuilder("odd")
    builder.add_body("a", None, "revolute", (0, 0, 1), None, (1.0, (0.0, 0.0, 0.0), np.diag([1.0, 1.0, -0.1])))
    with pytest.warns(UserWarning, match="principal moments"):
        model = builder.build()
    found = sd.diagnose(model)
    assert found.severity == "error"
    assert [f.link for f in found.of("singular")] == ["a"]


def test_armature_is_a_remedy() -> None:
    """The remedies of findings about a heavy tip."""
    masses = (1.0,) * 6 + (1e6,)
    bare, geared = sd.diagnose(chain(masses, 3)), sd.diagnose(chain(masses, 3, armature=1e4))
    assert geared.digits["aba"]["float64"] > bare.digits["aba"]["float64"] + 1.0


def test_a_joint_that_moves_nothing_is_an_error() -> None:
    builder = sd.ModelBuilder("m").add_body("arm", None, "revolute", (0, 1, 0), inertia=BAR)
    builder.add_body("tool", "arm", "revolute", (0, 0, 1))
    found = sd.diagnose(builder.build())
    (finding,) = found.of("singular")
    assert (finding.severity, finding.link) == ("error", "tool")
    assert found.stiffest is None
    assert found.digits == {}


def test_bodies_that_no_motion_feels_are_named() -> None:
    """A mass point on the axis it turns about, and a base that is fixed."""
    builder = sd.ModelBuilder("m").set_inertia("base", BAR)
    builder.add_body("pin", None, "revolute", (0, 0, 1), inertia=(2.0, (0, 0, 0.5), np.zeros((3, 3))))
    builder.add_body("arm", "pin", "revolute", (0, 1, 0), inertia=BAR)
    assert {f.link for f in sd.diagnose(builder.build()).of("unfelt")} == {"base", "pin"}
    assert sd.diagnose(builder.build(root="floating")).of("unfelt") == ()


def test_the_largest_step_is_where_explicit_euler_stops_to_decay() -> None:
    """By hand: one joint of inertia I and damping d decays at d / I."""
    builder = sd.ModelBuilder("m").add_body("arm", None, "revolute", (0, 0, 1), inertia=BAR, damping=700.0)
    found = sd.diagnose(builder.build())
    inertia = 0.02 + 0.3**2
    assert found.stiffest is not None
    assert found.stiffest.inertia == pytest.approx(inertia, rel=1e-14, abs=0.0)
    assert found.stiffest.dt == pytest.approx(2.0 * inertia / 700.0, rel=1e-14, abs=0.0)
    (finding,) = found.of("time step")
    assert finding.link == "arm"


@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_a_damped_arm_grows_just_above_its_largest_step(factor: float) -> None:
    model = chain((3.0, 2.0, 1.0), 2)
    builder = sd.ModelBuilder("damped")
    for k, joint in enumerate(model.robot.joints):
        link = model.robot.links[k + 1]
        inertia = (link.mass, link.com, np.reshape(link.inertia, (3, 3)))
        place = np.reshape(joint.placement, (4, 4))
        builder.add_body(link.name, joint.parent, "revolute", joint.axis, place, inertia, damping=1.0 + k)
    q = [0.3, -0.2, 0.5]
    damped = builder.build(gravity=(0, 0, 0))
    found = sd.diagnose(damped, q)
    assert found.stiffest is not None
    step = np.eye(3) - factor * found.stiffest.dt * sd.minverse(damped, q) @ np.diag(damped.damping)
    assert (max(abs(np.linalg.eigvals(step))) > 1.0) == (factor > 1.0)


def test_without_damping_the_lightest_joint_is_named() -> None:
    found = sd.diagnose(chain((3.0, 2.0, 1.0), 2))
    assert found.stiffest is not None
    assert (found.stiffest.rate, found.stiffest.dt) == (0.0, math.inf)


def test_a_given_state_is_the_only_one() -> None:
    model = chain((3.0, 2.0), 2)
    M = sd.crba(model, [0.1, 0.2])
    scale = np.sqrt(np.diag(M))
    found = sd.diagnose(model, [0.1, 0.2]).condition
    assert found == {"given": pytest.approx(np.linalg.cond(M / np.outer(scale, scale)), rel=1e-12)}


def test_the_condition_does_not_depend_on_units() -> None:
    """A finger of a gram on an arm of a tonne has M of any condition, and none once it is scaled."""
    found = sd.diagnose(chain((1e3, 1e-3), 2))
    assert found.condition["sampled"] < 1e3


@pytest.mark.parametrize("q", [[0.1], [[0.1, 0.2]], "x"])
def test_a_wrong_shape_is_refused(q: Any) -> None:
    with pytest.raises(sd.ShapeError):
        sd.diagnose(chain((1.0, 1.0), 0), q)


def test_nan_is_refused() -> None:
    with pytest.raises(sd.NonFiniteError, match="finite"):
        sd.diagnose(chain((1.0, 1.0), 0), [math.nan, 0.0])


# --- mass ratios ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("masses", "severity"),
    [
        ((1.0, 999.0), None),
        ((1.0, 1001.0), "note"),
        ((1.0, 1.0, 1001.0), "note"),  # exactly two carriers leave it next to nothing to cancel
        ((1.0, 1.0, 1.0, 1001.0), "warning"),
        ((1.0, 1.0, 1.0, 999.0), None),
        ((10.0, 1e-3, 20.0), None),  # heavy, light, heavier: one heavy carrier is enough
        ((10.0, 1e-3, 1e-3, 9e3), None),
        ((10.0, 1e-3, 1e-3, 11e3), "warning"),
    ],
)
def test_a_body_is_held_against_the_heaviest_that_carries_it(masses: tuple[float, ...], severity: str | None) -> None:
    found = list(rules._mass_ratios(chain(masses, 1)))
    assert [(f.severity, f.link) for f in found] == ([(severity, f"b{len(masses) - 1:03d}")] if severity else [])


def test_bodies_on_massless_ones_only_say_so() -> None:
    builder = sd.ModelBuilder("m").add_body("a", None, "revolute").add_body("b", "a", "revolute", inertia=BAR)
    (finding,) = rules._mass_ratios(builder.build())
    assert "hangs on bodies without mass only, at 1 kg" in finding.message


# --- units ------------------------------------------------------------------------------------------------


def rescaled(name: str, moments: float, lengths: float, only: str | None = None) -> sd.Model:
    """A robot whose rotational inertias, or centers of mass and places of children, are so many times as large."""
    robot = sd.load_urdf(name).robot
    builder = sd.ModelBuilder("copy", robot.root)
    by_name = {link.name: link for link in robot.links}

    def inertia(link: Any) -> Any:
        scale = (1.0, 1.0) if only not in (None, link.name) else (moments, lengths)
        return link.mass, np.array(link.com) * scale[1], np.reshape(link.inertia, (3, 3)) * scale[0]

    placed, joints = {robot.root}, list(robot.joints)
    while joints:
        joint = next(j for j in joints if j.parent in placed)
        joints.remove(joint)
        placed.add(joint.child)
        place = np.reshape(joint.placement, (4, 4)).copy()
        place[:3, 3] *= 1.0 if only not in (None, joint.parent) else lengths
        parent = None if joint.parent == robot.root else joint.parent
        kind, child = ("fixed" if joint.kind == "fixed" else "revolute"), by_name[joint.child]
        words = {} if kind == "fixed" else {"axis": joint.axis}
        builder.add_body(child.name, parent, kind, placement=place, inertia=inertia(child), **words)
    return builder.build()


def units(model: sd.Model) -> list[tuple[str, str]]:
    """The findings about units: the link, and which of the two remedies."""
    return [(f.link, "inertias" if "inertias" in f.remedy else "lengths") for f in rules._units(model)]


@pytest.mark.skipif(not example_robots(), reason="example-robot-data is not installed")
@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_millimetres_are_seen_in_one_link_and_in_all(name: str) -> None:
    """In kg mm² of inertia, and in mm of length; in both, lengths alone show it."""
    model = sd.load_urdf(name)
    assert units(rescaled(name, 1.0, 1.0)) == []
    assert [what for _, what in units(rescaled(name, 1e6, 1.0))] == ["inertias"]
    assert [what for _, what in units(rescaled(name, 1.0, 1e3))] == ["lengths"]
    assert [what for _, what in units(rescaled(name, 1e6, 1e3))] == ["lengths"]
    for joint in model.joints[2:6]:
        link = next(j.parent for j in model.robot.joints if j.name == joint.name)
        assert units(rescaled(name, 1e6, 1.0, link)) == [(link, "inertias")]
        assert units(rescaled(name, 1.0, 1e3, link)) == [(link, "lengths")]


@pytest.mark.skipif(not example_robots(), reason="example-robot-data is not installed")
def test_units_of_the_robots_at_hand_are_not_in_doubt() -> None:
    """One in three: all 68 are silent, seen once; tiago_dual and double_pendulum come closest."""
    named = {path.parent.name + "/" + path.stem: path for path in example_robots()}
    for name in ("tiago_dual", "double_pendulum_simple", "icub", "human", "simple_humanoid", "ur10_robot", "baxter"):
        for path in [path for key, path in named.items() if key.endswith("/" + name)][:1]:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                assert units(sd.load_urdf(path)) == [], name


def bar(radius: float, reach: float) -> sd.Model:
    """One body of 2 kg with this radius of gyration, whose center of mass is so far off its joint."""
    moments = 2.0 * radius**2 * np.array([1.0, 1.0, 1.0])
    builder = sd.ModelBuilder("m")
    return builder.add_body("bar", None, "revolute", (0, 1, 0), None, (2.0, (reach, 0, 0), np.diag(moments))).build()


@pytest.mark.parametrize(
    ("radius", "reach", "found"),
    [
        (2.99, 0.001, []),
        (3.01, 0.001, ["inertias"]),
        (5.0, 0.0501, []),
        (5.0, 0.0499, ["inertias"]),
        (1e3, 0.0, []),  # a flywheel on its axis shows no lengths
        (0.01, 29.9, []),
        (0.01, 30.1, ["lengths"]),
        (0.401, 40.0, []),
        (0.399, 40.0, ["lengths"]),
        (100.0, 299.0, []),
        (100.0, 301.0, ["lengths"]),
    ],
)
def test_units_are_in_doubt_from_there_on(radius: float, reach: float, found: list[str]) -> None:
    assert [what for _, what in units(bar(radius, reach))] == found


def test_a_wide_link_beside_long_ones_is_no_matter_of_units() -> None:
    """A drum without extent of its own at the end of a boom of its size."""
    drum = (2.0, (0.0, 0.0, 0.001), np.diag([200.0, 200.0, 200.0]))
    builder = sd.ModelBuilder("m").add_body("boom", None, "revolute", (0, 1, 0), None, (5.0, (2, 0, 0), np.eye(3)))
    builder.add_body("drum", "boom", "revolute", (0, 0, 1), (4.0, 0, 0), drum)
    assert units(builder.build()) == []


# --- thresholds -------------------------------------------------------------------------------------------


def of_digits(float64: float, float32: float, refined: float = 15.0, elsewhere: float = 15.0) -> list[Any]:
    """The findings about digits that ABA has so many of, at the first of two positions."""
    model = chain((1.0, 1.0), 0)
    table = {m: {"float64": float64, "float32": float32} for m in METHODS}
    table["refined"] = {"float64": refined, "float32": 6.0}
    table[EXTENDED] = {"float64": 15.4}
    errors = np.array([10.0**-float64, 10.0**-elsewhere])
    return list(rules._digits(model, table, errors, np.zeros((2, 2)), "neutral"))


def test_digits_have_two_thresholds_in_float64_and_two_in_float32() -> None:
    assert of_digits(10.01, 3.01) == []
    assert [f.severity for f in of_digits(9.99, 3.01)] == ["warning"]
    assert [f.severity for f in of_digits(6.01, 3.01)] == ["warning"]
    assert [f.severity for f in of_digits(5.99, 3.01)] == ["error"]
    (finding,) = of_digits(10.01, 2.99)
    assert (finding.severity, "turn to float64" in finding.message) == ("note", False)
    assert "turn to float64" in of_digits(10.01, 0.99)[0].message
    assert "turn to float64" not in of_digits(10.01, 1.01)[0].message


def test_the_remedy_is_a_method_that_keeps_a_digit_more_or_none() -> None:
    assert of_digits(5.0, 6.0, refined=10.1)[0].remedy == 'take method="refined", which keeps 10'
    every = 'take method="refined", which keeps {}, or "extended", which keeps 15'
    assert of_digits(5.0, 6.0, refined=9.9)[0].remedy == every.format(10)
    assert of_digits(5.0, 6.0, refined=6.1)[0].remedy == every.format(6)
    (finding,) = of_digits(5.0, 6.0, refined=5.9)
    assert finding.remedy.startswith('take method="extended", which keeps 15, or give the joint an armature')
    assert "no method in float64 keeps more" in finding.remedy


def test_extended_has_all_digits_but_those_of_a_double_double_that_aba_loses() -> None:
    for tip, least, most in ((1.0, 15.6, 15.7), (1e9, 15.6, 15.7), (1e18, 12.0, 15.7)):
        model = chain((1.0,) * 6 + (tip,), 3)
        some = states(model, 3)
        found = digits_module.method_errors(model, [np.array([s[k] for s in some]) for k in range(3)])
        assert set(found[EXTENDED]) == {"float64"}
        _, certainty = references.truths(model, "aba", [np.array([s[k] for s in some[:2]]) for k in range(3)])
        assert found[EXTENDED]["float64"][:2].max() >= certainty
        assert least < predicted_digits(model, some)[EXTENDED]["float64"] < most


def test_a_state_that_loses_alone_is_named() -> None:
    assert "in neutral, and 15 elsewhere" in of_digits(5.0, 6.0)[0].message
    assert "in neutral" not in of_digits(5.0, 6.0, elsewhere=4.0)[0].message


@pytest.mark.parametrize(("condition", "named"), [(0.99e8, False), (1.01e8, True)])
def test_a_condition_is_ill_from_half_the_digits_on(condition: float, named: bool) -> None:
    c = (condition - 1.0) / (condition + 1.0)  # of [[1, c], [c, 1]] it is (1 + c) / (1 - c)
    found, said = rules._conditions(chain((1.0, 1.0), 0), np.array([[[4.0, 6.0 * c], [6.0 * c, 9.0]]]), "given")
    assert found["given"] == pytest.approx(condition, rel=1e-6)
    assert bool(said) == named


@pytest.mark.parametrize(("damping", "named"), [(0.99, False), (1.01, True)])
def test_a_step_below_a_millisecond_is_named(damping: float, named: bool) -> None:
    """2 I / d is 1 ms for I = 0.11 kg m² and d = 220 N m s."""
    builder = sd.ModelBuilder("m").add_body("arm", None, "revolute", (0, 0, 1), inertia=BAR, damping=220.0 * damping)
    model = builder.build()
    assert bool(list(rules._time_step(model, rules._stiffest(model, sd.crba(model, [[0.0]]))))) == named


@pytest.mark.parametrize(("least", "severity"), [(-1e-13, "error"), (-1e-15, "warning")])
def test_negative_energy_is_distinguished_from_rounding(least: float, severity: str) -> None:
    model = sd.ModelBuilder("m").add_body("slab", None, "revolute", inertia=(1.0, (0, 0, 0), np.eye(3))).build()
    bodies = model.bodies.copy()
    bodies["inertia"][1] = (1.0, (0.0, 0.0, 0.0), (least, 0.0, 0.0, 1.0, 0.0, 1.0))
    changed = SimpleNamespace(bodies=bodies, joints=model.joints, frame=model.frame)
    assert rules._gives_energy(changed, "slab") == (severity == "error")


@pytest.mark.parametrize(("off", "named"), [(0.0, True), (1.0e-7, True), (1.4e-7, False)])
def test_a_body_is_unfelt_to_rounding_only(off: float, named: bool) -> None:
    """A mass point on an oblique axis, or some metres off it: its inertia is below 64 eps of its terms, or not."""
    axis = np.array([1.0, 1.0, 0.0]) / math.sqrt(2.0)
    builder = sd.ModelBuilder("m")
    builder.add_body("pin", None, "revolute", axis, None, (1.0, (*axis[:2], off), np.zeros((3, 3))))
    builder.add_body("rod", "pin", "revolute", (0, 0, 1), inertia=BAR)
    assert ("pin" in {f.link for f in rules._unfelt(builder.build(), np.zeros((1, 2)))}) == named


def test_of_a_body_with_mass_all_around_no_jacobian_is_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A program of each frame's Jacobian would take a minute for a chain of 300 bodies."""
    monkeypatch.setitem(rules.calls, "frame_jacobian", None)  # not callable
    model = sd.load_urdf("panda")
    assert list(rules._unfelt(model, np.zeros((1, model.nq)))) == []


def of_programs(alone: float, batch: float) -> bool:
    """Whether a program of that error gives a finding."""
    model = chain((1.0, 1.0), 0)
    return bool(list(rules._programs(model, {"aba": (np.full(8, alone), np.full(8, batch))})))


def test_a_program_loses_if_it_is_ten_times_and_sixteen_eps_worse() -> None:
    eps = EPS["float64"]
    assert not of_programs(0.0, 15.9 * eps)
    assert of_programs(0.0, 16.1 * eps)
    assert not of_programs(1e-9, 0.99e-8)
    assert of_programs(1e-9, 1.01e-8)
    assert of_programs(1e-9, math.inf)


def test_programs_are_judged_in_usual_states_too() -> None:
    """If both are alike in the worst state, the median shows the loss."""
    model, alone, batch = chain((1.0, 1.0), 0), np.full(9, 1e-16), np.full(9, 1e-12)
    alone[0] = batch[0] = 1e-3
    (finding,) = rules._programs(model, {"aba": (alone, batch)})
    assert "aba 12.0 of 15.7" in finding.message


# --- programs ---------------------------------------------------------------------------------------------


def without_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """No program is read or kept, for those made here are wrong."""
    empty_memory(monkeypatch)
    monkeypatch.setattr(batch_kernels, "_from_disk_cache", lambda *arguments: None)
    monkeypatch.setattr(batch_kernels.disk_cache, "write", lambda *arguments: None)


@compiled
def test_sound_programs_lose_nothing() -> None:
    found = sd.diagnose(chain((3.0, 2.0, 1.5), 8))
    assert set(found.programs) == {"rnea", "crba", "aba", "aba_refined", "minverse"}
    assert all(min(x.values()) > 13.0 for x in found.programs.values())
    assert found.of("programs") == ()
    assert "digits of programs" in str(found)
    assert json.loads(found.to_json())["programs"] == found.programs


@compiled
@pytest.mark.parametrize(("solved", "names"), [(True, {"aba", "aba_refined", "minverse"}), (False, {"rnea", "crba"})])
def test_a_fault_in_the_programs_is_seen(monkeypatch: pytest.MonkeyPatch, solved: bool, names: set[str]) -> None:
    """Subtracting a ring of 1e4 kg m² from a body and adding it again leaves 12 digits."""
    without_disk(monkeypatch)

    def rough(rows: Any, of: bool = False) -> None:
        regroup(rows, of)
        if of == solved:
            for row in rows[1:]:
                I = row.inertia.I
                I.xx, I.yy, I.zz = ((float(x) + 1e4) - 1e4 for x in (I.xx, I.yy, I.zz))

    monkeypatch.setattr(recording, "regroup", rough)
    found = sd.diagnose(chain((3.0, 2.0, 1.0 + 0.125 * solved), 81))
    (finding,) = found.of("programs")
    assert finding.severity == "warning"
    assert "spatialdyn.kernels" in finding.remedy
    for name, digits in found.programs.items():
        assert (f"{name} {digits['batch']:.1f} of {digits['single']:.1f}" in finding.message) == (name in names), name
        assert (digits["batch"] < 13.5) == (name in names), name


@compiled
def test_programs_are_judged_in_the_samples_that_have_an_answer() -> None:
    builder = sd.ModelBuilder("m")
    for k in range(2):
        builder.add_body(f"b{k}", f"b{k - 1}" if k else None, "revolute", (0, 0, 1), (k, 0, 0), BAR)
    model = builder.build()
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (8, 2))
    q[3] = np.nan
    found = program_errors(model, [q, np.zeros((8, 2)), np.ones((8, 2))])
    assert set(found) == set(digits_module.INPUTS)
    assert all(np.isfinite(batch).all() and len(batch) == len(alone) == 7 for alone, batch in found.values())


@compiled
@pytest.mark.parametrize(("short", "names"), [(2, set(digits_module.INPUTS)), (1, {"rnea", "aba"})])
def test_of_long_robots_two_programs_are_judged(monkeypatch: pytest.MonkeyPatch, short: int, names: set[str]) -> None:
    monkeypatch.setattr(digits_module, "SHORT", short)
    assert set(sd.diagnose(chain((1.0, 1.0), 0)).programs) == names


# --- limits ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("nv", "looked", "states"), [(2, 9, rules.STATES + 1), (257, 2, min(rules.STATES, 117) + 1)])
def test_long_robots_are_looked_at_in_fewer_states(nv: int, looked: int, states: int) -> None:
    positions, arrays = rules._states(chain((1.0,) * nv, 0), None)
    assert (len(positions), *map(len, arrays)) == (looked, states, states, states)
    assert (arrays[0][0] == 0.0).all()


def test_the_number_of_states_is_said() -> None:
    found = sd.diagnose(chain((1.0, 1.0), 0))
    assert found.states == rules.STATES + 1
    assert f"the worst of {found.states} states" in str(found)
    assert json.loads(found.to_json())["states"] == found.states


@pytest.mark.skipif(numba_kernels.PLAIN or not example_robots(), reason="example-robot-data, and heavy")
def test_neutral_is_one_of_the_states() -> None:
    """There iCub's neck moves 1e-11 of its inertia, and ABA is off by half a percent; n eps is far below."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = sd.load_urdf("icub")
    q, v, tau = np.asarray(sd.neutral(model)), *np.random.default_rng(0).normal(size=(2, model.nv))
    errors = digits_module.method_errors(model, [q[None], v[None], tau[None]])
    assert 1e-3 < errors["aba"]["float64"][0] < 1e-1
    table = {m: {d: digits_module.digits_of(e) for d, e in found.items()} for m, found in errors.items()}
    finding = next(rules._digits(model, table, errors["aba"]["float64"], q[None], ""))
    assert finding.severity == "error"
    assert 'hangs on joint "neck_roll", which moves 1e-11 of its inertia' in finding.message


def test_every_kind_of_joint_and_a_floating_root_are_looked_at() -> None:
    for continuous in ("angle", "cos_sin"):
        found = sd.diagnose(random_tree(3, 4, floating=True, continuous=continuous).model)
        assert set(found.digits) == {*METHODS, EXTENDED}
        assert found.severity == "ok"


def test_a_model_that_does_not_move_has_nothing_to_say() -> None:
    found = sd.diagnose(sd.ModelBuilder("rock").build())
    assert (found.findings, found.condition, found.digits, found.stiffest) == ((), {}, {}, None)
    assert str(found) == "rock: ok"


def test_mimic_joints_have_no_digits() -> None:
    builder = sd.ModelBuilder("m").add_body("a", None, "revolute", (0, 0, 1), inertia=BAR, joint_name="lead")
    builder.add_body("b", "a", "revolute", (0, 0, 1), (0.3, 0, 0), BAR, mimic={"leader": "lead", "multiplier": -1.0})
    found = sd.diagnose(builder.build(mimic=True))
    assert found.digits == {}
    assert found.stiffest is not None


# --- text and JSON ---------------------------------------------------------------------------------------


def test_text_and_json_say_the_same() -> None:
    found = sd.diagnose(chain((1.0,) * 6 + (1e9,), 3))
    record = json.loads(found.to_json())
    assert record["severity"] == found.severity
    assert [f["message"] for f in record["findings"]] == [f.message for f in found.findings]
    assert all(f.message in str(found) and f.remedy in str(found) for f in found.findings)
    assert record["stiffest"]["dt"] is None
    assert repr(found).startswith(f"<Diagnosis chain: {found.severity}, ")


def test_the_worst_comes_first() -> None:
    order = [f.severity for f in sd.diagnose(chain((1.0,) * 6 + (1e12,), 3)).findings]
    assert order == sorted(order, key=["error", "warning", "note"].index)
    assert len(set(order)) > 1


def test_check_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["check", "two_link"]) == 0
    assert capsys.readouterr().out.startswith("two_link: ok")
    assert cli.main(["check", "two_link", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["findings"] == []
    assert cli.main(["check", "no_such_robot"]) == 2


def test_bristles_that_may_give_energy_are_named() -> None:
    """Around a slow cycle about rest LuGre friction gives energy where b < σ1 (F_s - F_c)/F_c, and takes it above."""
    model = sd.load_urdf("two_link")
    rests = dict(static=[1.5, 1.0], stribeck_velocity=1e-3, bristle_stiffness=1e5, bristle_damping=300.0)
    found = sd.diagnose(model, friction=sd.Friction([1.0, 1.0], [149.0, 0.0], **rests)).of("friction")
    assert [(x.severity, x.link) for x in found] == [("warning", model.names[1].replace("joint", "link"))]
    assert (
        'hangs on joint "joint1", whose bristles may give energy: its damping of 149 is below 150' in found[0].message
    )
    assert not sd.diagnose(model, friction=sd.Friction([1.0, 1.0], [150.0, 0.0], **rests)).of("friction")
    assert not sd.diagnose(model, friction=True).of("friction")
    with pytest.raises(sd.ModelError, match="friction is 3"):
        sd.diagnose(model, friction=3)  # type: ignore[arg-type]
