"""Every call equals Pinocchio on every URDF of example-robot-data, fixed and floating, 4 random states each, or 20.

Where Pinocchio has no answer, or no float64 answer can meet the bound, the rows are listed here by robot: a row that
joins or leaves a list is a failure.
"""

from __future__ import annotations

import math
import re
import warnings
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robots import ROBOTS
from slow import slow_but

import spatialdyn as sd
from spatialdyn.calls import dynamics
from spatialdyn.engines import run
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.urdf.load import example_robots, find_robot
from spatialdyn.validate import (
    BOUND,
    OMITTED,
    RAISED,
    VALUE_BOUND,
    Comparison,
    Row,
    compare_with_pinocchio,
    pinocchio_model,
)

pytest.importorskip("pinocchio")
if not ROBOTS:
    pytest.skip("example-robot-data is not installed", allow_module_level=True)

ROOTS = ("fixed", "floating")
RECORDED = 9  # freedoms: larger robots by the table kernel, which programs of every robot are held to elsewhere
REFUSED = "ur3"  # its <robot> has no name
AT_ONCE = {  # robots of every kind of joint and root, small enough to be recorded; their like and the larger ones wait
    "TwoDofs", "double_pendulum_continuous", "finger_edu", "iris_simple", "panda", "quadrotor_base",
}  # fmt: skip
OTHERS = [name for name in ROBOTS if name not in {*AT_ONCE, REFUSED}]
LOADED = [name for name in ROBOTS if name != REFUSED]
MAIN = ("rnea", "crba", "aba", "coriolis_matrix", "frame_jacobian", "center_of_mass", "kinetic_energy")
FEW, MANY = (4, 20) if not numba_kernels.PLAIN else (1, 1)  # states of a robot
FREEDOMS = math.inf if not numba_kernels.PLAIN else 9  # of a robot that plain Python gets through in some seconds
BOUND_MIMIC = 1e-12  # scaled: both sides are our own sums, in another order

# Massless bodies at the ends of chains: Pinocchio's aba and Minv are not finite, ours raise; rnea = M a + bias instead.
SINGULAR = {"romeo", "romeo_laas_small"}
# No freedoms under a fixed root: no mass moves, and Pinocchio's frame Jacobians crash the process.
EMPTY = {"iris_simple", "quadrotor_base"}
# M has a condition number of 1e8 (human) and 4e10 (icub). The exact answers to 60 digits, rounded to float64, miss
# their right-hand sides by 6e-11 and 3e-8: 1e-11 is out of reach of float64 there. Pinocchio's inverse of a floating
# Pinocchio's M of icub is off by 1e-9 and more, ours by 1e-12: it is no oracle for those values.
ILL_CONDITIONED = {"human", "icub"}
NO_PEER = "Pinocchio has no such call"  # an identity is checked, which the row names


def in_turn(names: list[str], first: int = 0) -> list[tuple[str, str]]:
    """Each robot under one root, fixed and floating in turn."""
    return [(name, ROOTS[(k + first) % 2]) for k, name in enumerate(names)]


def test_69_robots_of_which_68_load() -> None:
    assert len(ROBOTS) == len(example_robots()) == 69
    assert len(LOADED) == 68
    readme = Path(sd.__file__).parents[1] / "README.md"
    if readme.exists():  # not of an installed package
        assert {*re.findall(r"(\d+) robots", readme.read_text(encoding="utf-8"))} == {"68"}


def test_ur3_is_refused_here_and_by_pinocchio() -> None:
    with pytest.raises(sd.UrdfError, match="has no attribute name"):
        sd.load_urdf(ROBOTS[REFUSED])
    with pytest.raises(sd.SpatialDynError, match="Pinocchio refuses"):
        pinocchio_model(ROBOTS[REFUSED])


@pytest.mark.parametrize(
    ("name", "root"),
    slow_but(in_turn(sorted(AT_ONCE)), sorted({*in_turn(sorted(AT_ONCE)), *in_turn(LOADED)})),
)
def test_every_call_equals_pinocchio(name: str, root: str) -> None:
    """By programs where they are not too long; under the other root by the table kernel, in many states."""
    hold_every_call(name, root, FEW)


@pytest.mark.parametrize(("name", "root"), in_turn(OTHERS)[::2])
def test_the_main_calls_equal_pinocchio(name: str, root: str) -> None:
    """Of the robots whose every call waits, by the table kernel."""
    if numba_kernels.PLAIN and load(ROBOTS[name], root=root).nv > FREEDOMS:
        pytest.skip(f"NUMBA_DISABLE_JIT: more than {FREEDOMS} freedoms")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "program", lambda *arguments: None)
        patch.setattr(dynamics, "plan_of", dynamics.plan_of.__wrapped__)
        comparison = compare_with_pinocchio(ROBOTS[name], root, samples=FEW, calls=MAIN)
    assert [row for row in comparison.rows if not row.ok] == []
    assert len(comparison.rows) > len(MAIN)


@pytest.mark.slow(quick="test_every_call_equals_pinocchio")
@pytest.mark.parametrize(("name", "root"), [x for k, x in enumerate(in_turn(LOADED, 1)) if k % 4 < 2])
def test_every_call_equals_pinocchio_in_many_states(name: str, root: str) -> None:
    """Of one robot in two, half of them on fixed roots, under the root that they do not have above."""
    hold_every_call(name, root, MANY)


@pytest.mark.slow(quick="test_every_call_equals_pinocchio")
def test_derivatives_at_an_acceleration_of_few_digits_are_held_to_what_is_known_of_it() -> None:
    """Of icub, by its program, whose acceleration is not that of aba to the last digits that a float64 holds."""
    comparison = compare_with_pinocchio(ROBOTS["icub"], "fixed", calls=["aba_derivatives"])
    row = comparison.row("aba_derivatives")
    assert row.ok
    assert row.note.startswith(RAISED)
    assert BOUND < row.bound < 1e-7


def hold_every_call(name: str, root: str, samples: int) -> None:
    """Compare a robot with Pinocchio's; every row holds, and what a row notes is listed above."""
    if numba_kernels.PLAIN and load(ROBOTS[name], root=root).nv > FREEDOMS:
        pytest.skip(f"NUMBA_DISABLE_JIT: more than {FREEDOMS} freedoms")
    with pytest.MonkeyPatch.context() as patch:
        if samples == MANY or load(ROBOTS[name], root=root).nv > RECORDED:
            patch.setattr(run, "program", lambda *arguments: None)
            patch.setattr(dynamics, "plan_of", dynamics.plan_of.__wrapped__)
        comparison = compare_with_pinocchio(ROBOTS[name], root, samples=samples)
    assert [row for row in comparison.rows if not row.ok] == []

    rows = [row for row in comparison.rows if not row.note.startswith(NO_PEER)]
    noted = {row.call: row.note for row in rows if row.note}
    instead = {call for call, note in noted.items() if "instead" in note}
    raised = {row.call for row in rows if row.bound not in (BOUND, VALUE_BOUND) and row.call != "joint order"}
    skipped = {row.call for row in rows if row.error is None}
    assert raised == {call for call, note in noted.items() if note.startswith(RAISED)}
    if name in SINGULAR:
        massless = {"center_of_mass_velocity_derivatives"}  # Pinocchio has nan for a subtree without mass
        assert instead == massless | {
            "aba", "aba (fext)", "aba_refined", "aba_square_root", "crba_solve", "minverse", "aba_derivatives",
        }  # fmt: skip
    elif name in EMPTY and root == "fixed":
        assert instead == {"frame_jacobian", "frame_jacobian_dot", "jacobian_dot_times_v"}
    else:
        assert not instead
    if name not in ILL_CONDITIONED:
        assert not raised
    if name in EMPTY and root == "fixed":
        of_mass = {"center_of_mass", "center_of_mass_velocity", "center_of_mass_acceleration"}
        assert skipped == of_mass | {"centroidal_momentum", "centroidal_momentum_rate"}
    elif name in ILL_CONDITIONED:
        assert {call for call, note in noted.items() if note.startswith(OMITTED)} >= skipped
    else:
        assert not skipped
    if name not in ILL_CONDITIONED | SINGULAR | EMPTY:
        assert not noted


PLANAR = """<robot name="slider">
  <link name="base"/>
  <link name="puck"><inertial><origin xyz="0.1 0.2 0.3"/><mass value="2"/>
    <inertia ixx="0.3" ixy="0" ixz="0.01" iyy="0.2" iyz="0" izz="0.25"/></inertial></link>
  <link name="rod"><inertial><origin xyz="0 0.1 0"/><mass value="1"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.1"/></inertial></link>
  <joint name="slide" type="planar"><parent link="base"/><child link="puck"/><axis xyz="{axis}"/></joint>
  <joint name="swing" type="revolute"><parent link="puck"/><child link="rod"/><axis xyz="1 0 0"/>
    <origin xyz="0.2 0 0.1" rpy="0.3 0 0.2"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""


def test_a_plane_normal_to_z_equals_pinocchio() -> None:
    comparison = compare_with_pinocchio(PLANAR.format(axis="0 0 1"), samples=MANY)
    assert comparison.ok
    assert all(row.note == "" or row.note.startswith(NO_PEER) for row in comparison.rows)


def test_a_plane_that_pinocchio_gets_wrong_is_held_by_identities() -> None:
    comparison = compare_with_pinocchio(PLANAR.format(axis="1 0 2"), samples=MANY)
    assert comparison.ok
    assert all(
        "ignores the axis" in row.note or row.note.startswith(NO_PEER)
        for row in comparison.rows
        if row.call != "joint order"
    )
    assert comparison.row("rnea").note.endswith("rnea = M a + bias instead")
    assert sum(row.error is not None for row in comparison.rows) > 20


@pytest.mark.parametrize("calls", slow_but([[*MAIN, "minverse"]], [[*MAIN, "minverse"], None]))
def test_a_model_is_compared_as_it_is(calls: Any) -> None:
    """Gravity, rotors, loads, locked joints and joints of every kind are the Model's."""
    b = sd.ModelBuilder("kinds")
    body = (2.0, (0.1, -0.2, 0.3), np.diag([0.1, 0.2, 0.25]))
    b.add_body("a", None, "planar", inertia=body)
    for k, kind in enumerate(("revolute", "continuous", "prismatic", "spherical", "helical", "floating")):
        pitch = {"pitch": 0.1} if kind == "helical" else {}
        place = np.array([0.3, 0.1 * k, -0.2])
        b.add_body(f"l{k}", f"l{k - 1}" if k else "a", kind, (0.6, 0.0, 0.8), place, body, armature=0.2, **pitch)
    b.add_body("tip", "l4", "fixed", placement=(0.1, 0.2, 0.3), inertia=(0.5, (0.0, 0.0, 0.1), 0.01 * np.eye(3)))
    model = b.build(continuous="cos_sin", gravity=(1.0, 2.0, -3.0))
    other = model.with_(payload={"tip": (5.0, (0, 0, 0), 0.1 * np.eye(3))}).reduced(["l2_joint"])
    for one in (model, other, sd.load_urdf("ur5", root="floating"), sd.load_urdf("two_link", continuous="angle")):
        comparison = compare_with_pinocchio(one, samples=MANY, calls=calls)
        assert comparison.ok, comparison.worst
        assert (comparison.robot, comparison.root) == (one.name, one.options.root)
        own = {row.call for row in comparison.rows if row.note and not row.note.startswith(NO_PEER)}
        assert own <= {"kinetic_energy", "frame_acceleration_derivatives", "aba (values)", "aba (fext, values)"}


def test_repr_of_a_comparison_is_one_useful_line() -> None:
    good, bad = Row("rnea", 0.0, BOUND, True), Row("aba", 1.0, BOUND, False)
    head = "<Comparison of arm, fixed root, nv 2, 20 states: "
    assert repr(Comparison("arm", "fixed", 2, 2, 20, (good,))) == head + "agrees in 1 rows>"
    assert repr(Comparison("arm", "fixed", 2, 2, 20, (good, bad))) == head + "disagrees in aba>"


def test_a_model_that_pinocchio_lacks_is_refused_by_name() -> None:
    with pytest.raises(
        sd.SpatialDynError, match="root is 'floating', expected \"fixed\", which the Model was made with"
    ):
        compare_with_pinocchio(sd.load_urdf("two_link"), "floating")
    with pytest.raises(sd.SpatialDynError, match='joint "slide" is planar with an angle'):
        compare_with_pinocchio(sd.load_urdf(PLANAR.format(axis="0 0 1")))
    with pytest.raises(sd.SpatialDynError, match="mimics another, expected none"):
        compare_with_pinocchio(sd.load_urdf("tree", mimic=True))


def test_batches_of_another_size_and_seed_agree_too() -> None:
    assert compare_with_pinocchio("panda", samples=1, seed=7).ok
    with pytest.raises(sd.SpatialDynError, match="samples is 0, expected a whole number of 1 to"):
        compare_with_pinocchio("panda", samples=0)


# --- mimic joints: v_full = G v, so tau = Gᵀ tau_full and M = Gᵀ M_full G -----------------------------------


def load(source: Any, **options: Any) -> sd.Model:
    """A Model, without the warnings about inertias."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sd.load_urdf(source, **options)


def with_mended_mimics(path: Path) -> tuple[str, int]:
    """The text of a URDF, and how many mimics of it named no joint; those of alex_psyonic lack the side of their own.

    "Left_index_q2" mimics "index_q1" there, which becomes "Left_index_q1".
    """
    tree = ET.parse(path).getroot()
    names = {joint.get("name") for joint in tree.iter("joint")}
    count = 0
    for joint in tree.iter("joint"):
        mimic = joint.find("mimic")
        if mimic is not None and mimic.get("joint") not in names:
            mimic.set("joint", f"{str(joint.get('name')).split('_')[0]}_{mimic.get('joint')}")
            count += 1
    return ET.tostring(tree, encoding="unicode"), count


def mimic_map(text: str, full: sd.Model, model: sd.Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """G (full.nv, model.nv), A (full.nq, model.nq) and b with q_full = A q + b, read from the URDF's text."""
    joints = {joint.get("name"): joint for joint in ET.fromstring(text).findall("joint")}

    def follow(name: str) -> tuple[str, float, float]:
        """The joint that moves this one, or nothing if that is fixed; multiplier and offset."""
        mimic = joints[name].find("mimic") if name in joints else None
        if name in joints and joints[name].get("type") == "fixed":
            return "", 0.0, 0.0
        if mimic is None:
            return name, 1.0, 0.0
        multiplier, offset = float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0))
        leader, ratio, shift = follow(str(mimic.get("joint")))
        return leader, multiplier * ratio, multiplier * shift + offset

    G, A, b = np.zeros((full.nv, model.nv)), np.zeros((full.nq, model.nq)), np.zeros(full.nq)
    for joint in full.joints[1:]:
        leader, ratio, offset = follow(joint.name)
        b[joint.idx_q] = offset
        if not leader:
            continue
        lead = model.joint(leader)
        for k in range(joint.nv):
            G[joint.idx_v + k, lead.idx_v + k] = ratio
        for k in range(joint.nq):
            A[joint.idx_q + k, lead.idx_q + k] = ratio
    return G, A, b


@pytest.mark.parametrize("root", ROOTS)
@pytest.mark.parametrize(
    "name",
    slow_but(
        ["panda", "baxter"], ["panda", "baxter", "pr2", "tiago_pro", "romeo", "alex_psyonic_hands", "talos_full_v2"]
    ),
)
def test_mimic_joints_are_the_whole_tree_contracted_with_g(name: str, root: str) -> None:
    text, _ = with_mended_mimics(find_robot(name))
    full, model = load(text, root=root), load(text, root=root, mimic=True)
    G, A, b = mimic_map(text, full, model)
    assert model.nv < full.nv
    rng = np.random.default_rng(3)
    v, a, step = (rng.normal(size=(MANY, model.nv)) for _ in range(3))
    q = sd.integrate(model, sd.neutral(model), step)
    q_full = q @ A.T + b

    tau = sd.rnea(full, q_full, v @ G.T, a @ G.T) @ G
    M = G.T @ sd.crba(full, q_full) @ G
    assert abs(sd.rnea(model, q, v, a) - tau).max() <= BOUND_MIMIC * max(1.0, abs(tau).max())
    assert abs(sd.crba(model, q) - M).max() <= BOUND_MIMIC * max(1.0, abs(M).max())


def test_mimics_of_joints_that_do_not_exist_matter_only_where_mimics_count() -> None:
    path = find_robot("alex_psyonic_hands")
    assert with_mended_mimics(path)[1] == 8
    assert load(path).nv == 39
    with pytest.raises(sd.UrdfError, match="names no joint"):
        load(path, mimic=True)
