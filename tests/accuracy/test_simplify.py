"""A smaller model: its freedoms, savings, and cost by another computation."""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np
import pytest
from trees import random_inertia, random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels

simplified = importlib.import_module("spatialdyn.accuracy.simplify")  # the package has the function under that name
SAMPLES = simplified.SAMPLES

MERGED = 1e-12  # of the largest entry: locked joints merge bodies, which rounds otherwise (seen: 3e-15)


def arm(masses: tuple[float, ...] = (3.0, 2.0, 1.0), **properties: float) -> sd.Model:
    """Bodies of these masses in a row, the last of them on a joint limited to [0.5, 1]."""
    rng, builder = np.random.default_rng(0), sd.ModelBuilder("arm")
    for k, mass in enumerate(masses):
        whole, com, I = random_inertia(rng)
        limits = (0.5, 1.0) if k == len(masses) - 1 else (-math.inf, math.inf)
        builder.add_body(
            f"b{k}", f"b{k - 1}" if k else None, "revolute", np.eye(3)[k % 3], rng.uniform(-0.5, 0.5, 3),
            (mass, com, mass / whole * I), f"j{k}", limits, **properties,
        )  # fmt: skip
    return builder.build()


# --- the smaller model -----------------------------------------------------------------------------------


def test_nothing_asked_for_changes_nothing() -> None:
    model = arm()
    small, savings = sd.simplify(model)
    assert small == model
    assert savings.nv == (3, 3)
    assert all(change.absolute == 0.0 for change in savings.cost.values())
    assert all(before == after for before, after in savings.operations.values())


def test_locked_joints_are_those_of_reduced() -> None:
    model = arm()
    small, savings = sd.simplify(model, lock={"j1": 0.3})
    assert small == model.reduced({"j1": 0.3})
    assert savings.locked == {"j1": 0.3}


def test_a_name_alone_is_locked_at_rest_or_at_the_nearest_limit() -> None:
    assert sd.simplify(arm(), lock=["j1", "j2"])[1].locked == {"j1": 0.0, "j2": 0.5}
    assert sd.simplify(arm(), lock="j1")[1].locked == {"j1": 0.0}


def test_every_kind_of_joint_can_be_locked_by_its_name() -> None:
    model = random_tree(3, 6, floating=True).model
    small, savings = sd.simplify(model, lock=model.names[2:])
    assert small.nv == 6
    assert set(savings.locked) == set(model.names[2:])
    assert sd.simplify(model, lock=model.names[1:])[0].nv == 0


def test_light_links_merge_with_all_they_carry() -> None:
    """A light body that carries a heavy one stays: its joint moves both."""
    assert set(sd.simplify(arm((3.0, 0.01, 0.001)), merge_lighter_than=0.1)[1].locked) == {"j1", "j2"}
    assert sd.simplify(arm((3.0, 0.01, 1.0)), merge_lighter_than=0.1)[1].locked == {}


def test_a_value_given_goes_before_merging() -> None:
    assert sd.simplify(arm((3.0, 2.0, 0.001)), lock={"j2": 0.9}, merge_lighter_than=0.1)[1].locked == {"j2": 0.9}


def test_dropped_properties_are_zero_and_the_others_stay() -> None:
    model = arm(armature=0.5, damping=2.0, friction=3.0)
    small, savings = sd.simplify(model, drop="armature")
    assert not small.armature.any()
    assert (small.damping == 2.0).all()
    assert savings.dropped == ("armature",)
    bare = sd.simplify(model, drop=("damping", "friction", "gravity"))[0]
    assert not np.concatenate([bare.damping, bare.friction, bare.gravity]).any()
    assert (bare.armature == 0.5).all()


# --- savings and cost ------------------------------------------------------------------------------------


def test_fewer_joints_take_fewer_operations() -> None:
    savings = sd.simplify(arm(), lock=["j2"])[1]
    assert savings.nv == (3, 2)
    assert set(savings.operations) == set(savings.ns) == {"rnea", "aba", "crba"}
    assert all(0 < after < before for before, after in savings.operations.values())
    assert all(time > 0.0 for pair in savings.ns.values() for time in pair)


def test_dropping_armature_costs_its_entry_of_m() -> None:
    """By hand: M is off by the armature on its diagonal, τ by that times q̈."""
    model = arm(armature=0.25)
    cost = sd.simplify(model, drop="armature")[1].cost
    assert cost["M"].absolute == pytest.approx(0.25, rel=1e-12, abs=0.0)
    q = sd.random_configuration(model, np.random.default_rng(0), SAMPLES)
    assert cost["M"].relative == pytest.approx(0.25 / abs(sd.crba(model, q)).max(), rel=1e-12, abs=0.0)
    assert cost["tau"].absolute > 0.0
    assert cost["a"].absolute > 0.0


def test_the_cost_is_a_sample_and_says_of_how_many() -> None:
    """By hand: the largest change of M of an arm over the states, and the 99.9 % quantile."""
    model = arm()
    small, savings = sd.simplify(model, lock={"j2": 0.75})
    assert savings.states == SAMPLES
    q = sd.random_configuration(model, np.random.default_rng(0), SAMPLES)
    off = abs(sd.crba(model, q)[:, :2, :2] - sd.crba(small, q[:, :2])).max(axis=(1, 2))
    M = savings.cost["M"]
    assert M.absolute == pytest.approx(off.max(), rel=1e-12, abs=0.0)
    assert M.most == pytest.approx(np.quantile(off, 0.999), rel=1e-12, abs=0.0)
    assert 0.0 < M.most < M.absolute
    assert M.absolute == pytest.approx(M.relative * abs(sd.crba(model, q)[:, :2, :2]).max(), rel=1e-12, abs=0.0)
    line = next(line for line in str(savings).splitlines() if line.startswith("M "))
    assert f"changes by {M.absolute:.3g} in the worst of {SAMPLES} sampled states" in line
    assert f"by {M.most:.3g} in 99.9 % of them" in line
    assert "up to" not in line


@pytest.mark.skipif(numba_kernels.PLAIN, reason="4096 states are on lanes")
def test_4096_states_bound_what_others_change_by_to_a_tenth() -> None:
    """64 states missed a quarter for a UR5; the quantile is alike in two samples."""
    assert SAMPLES == 4096
    model = arm()
    small, savings = sd.simplify(model, lock={"j2": 0.75})
    q = sd.random_configuration(model, np.random.default_rng(99), SAMPLES)
    off = abs(sd.crba(model, q)[:, :2, :2] - sd.crba(small, q[:, :2])).max(axis=(1, 2))
    assert off.max() <= 1.1 * savings.cost["M"].absolute
    assert np.quantile(off, 0.999) == pytest.approx(savings.cost["M"].most, rel=0.1)


def test_long_robots_are_compared_in_fewer_states(monkeypatch: pytest.MonkeyPatch) -> None:
    assert sd.simplify(arm(), lock=["j2"])[1].states == SAMPLES
    monkeypatch.setattr(simplified.recording, "MOST_ROWS", 2)
    assert sd.simplify(arm(), lock=["j2"])[1].states == simplified.FEW == 64


def test_dropping_gravity_costs_no_entry_of_m() -> None:
    cost = sd.simplify(arm(), drop="gravity")[1].cost
    assert cost["M"].absolute == 0.0
    assert cost["tau"].absolute > 1.0


def test_a_joint_that_cannot_be_elsewhere_costs_no_m_and_no_tau() -> None:
    """A slider without room: M and τ of the rest are the same, and q̈ is not, as the joint may yield."""
    builder, rng = sd.ModelBuilder("m"), np.random.default_rng(1)
    builder.add_body("arm", None, "revolute", (0, 1, 0), inertia=random_inertia(rng))
    builder.add_body("tip", "arm", "prismatic", (1, 0, 0), (0.1, 0.2, 0.3), random_inertia(rng), "slide", (0.2, 0.2))
    cost = sd.simplify(builder.build(), lock=["slide"])[1].cost
    assert cost["M"].relative <= MERGED
    assert cost["tau"].relative <= MERGED
    assert cost["a"].relative > 1e-3


def test_a_lighter_body_costs_less() -> None:
    costs = [sd.simplify(arm((3.0, 2.0, mass)), lock=["j2"])[1].cost for mass in (1.0, 1e-3)]
    for name in ("M", "tau", "a"):
        assert 0.0 < costs[1][name].relative < 0.1 * costs[0][name].relative


def test_where_nothing_is_left_to_move_nothing_is_compared() -> None:
    small, savings = sd.simplify(arm(), lock=["j0", "j1", "j2"])
    assert (small.nv, savings.cost, savings.states) == (0, {}, 0)
    assert "nothing is left that moves" in str(savings)
    assert "changes by" not in str(savings)


@pytest.mark.parametrize("number", [np.float32, np.int64, np.float16, float, int])
def test_a_mass_is_any_real_number(number: Any) -> None:
    assert set(sd.simplify(arm((3.0, 0.5, 0.1)), merge_lighter_than=number(1))[1].locked) == {"j1", "j2"}


def test_the_report_reads() -> None:
    text = str(sd.simplify(arm(armature=0.1), lock=["j2"], drop="armature")[1])
    assert text.startswith("freedoms  3 -> 2")
    assert "j2" in text
    assert "operations" in text
    assert "dropped   armature" in text


# --- refusals --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"drop": "mass"}, "drop has 'mass', expected some of armature"),
        ({"merge_lighter_than": -1.0}, "merge_lighter_than is -1.0, expected"),
        ({"merge_lighter_than": math.nan}, "merge_lighter_than is nan, expected"),
        ({"merge_lighter_than": "x"}, "merge_lighter_than is 'x', expected"),
        ({"lock": ["j9"]}, 'joint "j9" is not in robot "arm"'),
        ({"lock": {"j1": [0.0, 1.0]}}, 'joint "j1" is locked at'),
        ({"lock": 3}, "lock is 3, expected"),
        ({"lock": [["j1"]]}, "is not in robot"),
        ({"lock": {"j1": 10**400}}, 'joint "j1" is locked at'),
        ({"drop": 3}, "drop is 3, expected some of armature"),
        ({"merge_lighter_than": True}, "merge_lighter_than is True, expected"),
        ({"merge_lighter_than": 10**400}, "expected a finite mass >= 0"),
    ],
)
def test_what_makes_no_sense_is_refused(how: dict[str, Any], message: str) -> None:
    with pytest.raises(sd.SpatialDynError) as caught:
        sd.simplify(arm(), **how)
    assert message in str(caught.value)


def gripper(mimic: bool = True) -> sd.Model:
    """An arm of two joints with a hand of two fingers, of which the second follows the first."""
    builder = sd.ModelBuilder("gripper")
    for k, parent in enumerate((None, "b0")):
        builder.add_body(
            f"b{k}", parent, axis=np.eye(3)[k], inertia=(2.0, (0.1, 0, 0.2), np.eye(3)), joint_name=f"j{k}"
        )
    finger = (0.03, (0.01, 0, 0.02), 1e-3 * np.eye(3))
    for name, follow in (("lead", None), ("other", {"leader": "lead", "multiplier": -0.5, "offset": 0.1})):
        builder.add_body(name, "b1", "prismatic", (0, 1, 0), inertia=finger, joint_name=name, mimic=follow)
    return builder.build(mimic=mimic)


def test_joints_that_mimic_are_locked_with_the_joint_that_they_mimic() -> None:
    """Fingers of 0.03 kg each are light together; the cost is that of the tree with both locked, by M = Gᵀ M G."""
    model = gripper()
    assert sd.simplify(model, merge_lighter_than=0.05)[1].locked == {}
    small, savings = sd.simplify(model, merge_lighter_than=0.07)
    assert savings.locked == {"lead": 0.0, "other": 0.1}
    assert savings.nv == (3, 2)
    assert small == model.reduced(savings.locked)
    with pytest.raises(sd.ModelError, match='joint "other" mimics "lead", which is to be locked; lock both'):
        sd.simplify(model, lock=["lead"])
    locked = sd.simplify(model, lock={"lead": 0.02}, merge_lighter_than=0.07)[1].locked
    assert locked == {"lead": 0.02, "other": 0.1 - 0.5 * 0.02}
    with pytest.raises(sd.ModelError, match='joint "lead" is locked at'):
        sd.simplify(model, lock={"lead": [0.1, 0.2]}, merge_lighter_than=0.07)
    q = sd.random_configuration(model, np.random.default_rng(0), savings.states)
    free, G = gripper(mimic=False), np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -0.5]])
    whole = np.concatenate([q, 0.1 - 0.5 * q[:, 2:]], axis=1)
    M = G.T @ np.asarray(sd.crba(free, whole)) @ G
    change = abs(np.asarray(sd.crba(small, q[:, :2])) - M[:, :2, :2]).max()
    assert savings.cost["M"].absolute == pytest.approx(change, rel=1e-9)
    assert change > 1e-3


def test_a_joint_that_mimics_keeps_its_place_in_a_smaller_model() -> None:
    """Gravity is dropped from its leader's torque too, and M stays."""
    model = gripper()
    small, savings = sd.simplify(model, lock={"j1": 0.3}, drop="gravity")
    assert [x.name for x in small.joints[1:]] == ["j0", "lead", "other"]
    assert small.mimic_matrix is not None
    assert savings.nv == (3, 2)
    _, savings = sd.simplify(model, drop="gravity")
    assert savings.cost["M"].absolute == 0.0
    q = sd.random_configuration(model, np.random.default_rng(0), savings.states)
    g = abs(np.asarray(sd.generalized_gravity(model, q))).max()
    assert savings.cost["tau"].absolute == pytest.approx(g, rel=1e-9)
