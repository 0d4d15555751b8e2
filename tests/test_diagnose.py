"""What a diagnosis says of models that have one thing wrong, and the digits it predicts beside those measured."""

from __future__ import annotations

import itertools
import json
import math
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from dense import Array
from trees import random_inertia, random_tree

import spatialdyn as sd
from spatialdyn import cli
from spatialdyn.dynamics import calls
from spatialdyn.engines import jit
from spatialdyn.forward import METHODS
from spatialdyn.trade.digits import EPS, predicted_digits

compiled = pytest.mark.skipif(jit.PLAIN, reason="float32 is a program")
AXES = np.eye(3)
PROMISED = 0.9  # of the cases are within a digit of what is measured
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


CASES = (
    *[((1.0,) * 6 + (10.0**k,), planar) for k in (0, 3, 6, 9, 12, -6, -12) for planar in (False, True)],
    *[((1.0,) * 3 + (10.0**k,) + (1.0,) * 3, False) for k in (-12, 12)],
    *[((1.0,) * 12, planar) for planar in (False, True)],
)


# --- digits ----------------------------------------------------------------------------------------------


@pytest.mark.skipif(jit.PLAIN, reason="heavy: measured by compiled calls")
def test_predicted_digits_are_within_one_of_those_measured() -> None:
    """Heavy and light tips and middles, and long chains; other states than those that predict."""
    pytest.importorskip("mpmath")
    off = []
    for seed, (masses, planar) in enumerate(CASES):
        model = chain(masses, seed, planar)
        fresh = states(model, 1000 + seed)
        wanted = [sd.exact(model, sd.aba)(*s).astype(float) for s in fresh]
        predicted = predicted_digits(model, states(model, seed))
        for method in METHODS:
            found = [sd.forward_dynamics(model, *s, method=method) for s in fresh]
            off.append(predicted[method]["float64"] - measured(found, wanted, "float64"))
    assert np.mean(abs(np.array(off)) <= 1.0) >= PROMISED


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
    found = sd.diagnose(chain((3.0, 2.0, 1.0), 0))
    assert found.findings == ()
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
    """What the findings about a heavy tip recommend."""
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
    assert found.stiffest.inertia == pytest.approx(inertia, rel=1e-14)
    assert found.stiffest.dt == pytest.approx(2.0 * inertia / 700.0, rel=1e-14)
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


# --- limits ----------------------------------------------------------------------------------------------


def test_every_kind_of_joint_and_a_floating_root_are_looked_at() -> None:
    for continuous in ("angle", "cos_sin"):
        found = sd.diagnose(random_tree(3, 4, floating=True, continuous=continuous).model)
        assert set(found.digits) == set(METHODS)
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
