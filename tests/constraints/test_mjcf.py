"""Equalities of MJCF as constraints: MuJoCo's own rows, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mechanisms import four_bar, four_bar_state, pin_of

import spatialdyn as sd

pytest.importorskip("lxml")
BODY = """<body name="{name}" pos="{x} 0 0"><joint name="{name}_joint" axis="0 0 1"/>
  <inertial pos="{half} 0 0" mass="{mass}" diaginertia="1e-3 1e-3 1e-3"/>{inside}</body>"""
CONNECT = '<connect name="pin" body1="coupler" body2="rocker" anchor="0.5 0 0"/>'


def mjcf(equalities: str) -> str:
    """The four-bar in MJCF; its loop is open at qpos0."""

    def body(name: str, x: float, length: float, inside: str = "") -> str:
        return BODY.format(name=name, x=x, half=length / 2, mass=length, inside=inside)

    coupler = body("coupler", 0.2, 0.5, '<site name="tip" pos="0.5 0 0"/>')
    bodies = body("crank", 0.0, 0.2, coupler) + body("rocker", 0.5, 0.4, '<site name="end" pos="0.4 0 0"/>')
    return f"<mujoco><worldbody>{bodies}</worldbody><equality>{equalities}</equality></mujoco>"


def same_rows(J: Any, K: Any) -> bool:
    """Whether two matrices have one row space."""
    K = K[abs(K).max(axis=1) > 1e-12]
    ranks = [np.linalg.matrix_rank(x, tol=1e-9) for x in (J, K, np.vstack([J, K]))]
    return len({*ranks}) == 1 and ranks[0] > 0


@pytest.mark.parametrize(
    "equality",
    [
        CONNECT,
        '<connect body1="coupler" anchor="0.5 0 0"/>',
        '<connect body1="world" body2="coupler" anchor="0.5 0.1 0"/>',
        '<weld body1="coupler" body2="rocker"/>',
        '<weld body1="rocker" body2="coupler" relpose="0.3 0.2 0 0.6 0 0 0.8"/>',
        '<weld body1="world" body2="rocker" relpose="0.5 0 0 0.6 0 0 0.8"/>',
        '<weld body1="crank"/>',
        '<joint joint1="rocker_joint" joint2="crank_joint" polycoef="0.3 -2 0 0 0"/>',
        '<joint joint1="rocker_joint" joint2="crank_joint"/>',
    ],
)
def test_rows_and_errors_are_mujocos(equality: str) -> None:
    """Where ours closes it MuJoCo finds it closed, and both matrices span the same."""
    mujoco = pytest.importorskip("mujoco")
    model = four_bar()
    held = sd.Constraints.of_mjcf(model, mjcf(equality))
    theirs = mujoco.MjModel.from_xml_string(mjcf(equality))
    data = mujoco.MjData(theirs)
    for start in ([0.3, 0.4, 0.5], [0.0, 0.0, 0.0]):
        q = np.array(start)
        try:
            q = sd.close_loops(model, held, q)
        except sd.ConstraintError:
            continue  # what does not close from here
        data.qpos[:] = q
        mujoco.mj_forward(theirs, data)
        assert abs(data.efc_pos).max() <= 1e-9
        rows = np.array(data.efc_J).reshape(-1, 3)
        assert same_rows(sd.constraint_jacobian(model, held, q), rows)
        return
    pytest.fail("no start closes it")


def test_a_loop_is_closed_where_it_is_said_to_be() -> None:
    """MuJoCo takes the second anchor from qpos0, where this loop would be open: q says where it is closed."""
    model, (q, v) = four_bar(), four_bar_state()
    held = sd.Constraints.of_mjcf(model, f"<equality>{CONNECT}</equality>", q)
    assert abs(sd.constraint_error(model, held, q)).max() <= 1e-15
    assert held.items[0].label == "pin"
    wanted = sd.constrained_dynamics(model, pin_of(model), q, v, np.zeros(3)).a
    assert sd.constrained_dynamics(model, held, q, v, np.zeros(3)).a == pytest.approx(wanted, abs=1e-10)


def test_what_is_not_active_is_left_out() -> None:
    model = four_bar()
    text = mjcf(f'<!-- a loop -->{CONNECT}<joint joint1="rocker_joint" joint2="crank_joint" active="false"/>')
    assert len(sd.Constraints.of_mjcf(model, text)) == 1
    assert len(sd.Constraints.of_mjcf(model, "<mujoco/>")) == 0
    sites = '<equality><connect site1="coupler" site2="rocker"/></equality>'
    assert sd.Constraints.of_mjcf(model, sites).items == (sd.PointConstraint("coupler", "rocker"),)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("<mujoco>", "MJCF is not well-formed XML"),
        ("<robot/>", "<robot> is the outermost element, expected <mujoco> or <equality>"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', "MJCF has a document type"),
        (
            "<equality>\n<tendon tendon1='a'/></equality>",
            "^<tendon> in line 2 of the MJCF is not read, expected connect, ",
        ),
        ("<mujoco><include file='a.xml'/></mujoco>", "^<include> in line 1 of the MJCF is not read"),
        (
            "<equality><weld name='w' body1='crank' pose='1'/></equality>",
            '^<weld name="w"> in line 1 of the MJCF has pose',
        ),
        ("<equality><weld body2='crank'/></equality>", "lacks body1"),
        ("<equality><connect body1='crank'/></equality>", "lacks anchor, expected three numbers"),
        ("<equality><connect body1='crank' anchor='1 2'/></equality>", 'has anchor="1 2", expected 3 finite numbers'),
        ("<equality><connect site1='crank'/></equality>", "has one of site1 and site2"),
        (
            "<equality><weld body1='crank' relpose='0 0 0 2 0 0 0'/></equality>",
            "expected a quaternion w x y z of norm 1",
        ),
        (
            "<equality><weld body1='crank' relpose='0 0 0 1.00001 0 0 0'/></equality>",
            "expected a quaternion w x y z of norm 1",
        ),
        ("<equality><weld body1='crank' active='1'/></equality>", 'has active="1", expected true or false'),
        ("<equality><joint joint1='crank_joint'/></equality>", "lacks joint1 or joint2, expected both"),
        (
            "<equality><joint joint1='crank_joint' joint2='rocker_joint' polycoef='0 1 2'/></equality>",
            'has polycoef="0 1 2", expected a straight line',
        ),
        ("<equality><connect body1='crnk' anchor='0 0 0'/></equality>", '"crnk"'),
        (3, "MJCF is a int, expected its text"),
        ("<equality>\udc80</equality>", "^MJCF is not well-formed XML"),
        ("<equality><connect body1='crank' anchor='1_0 0 0'/></equality>", 'has anchor="1_0 0 0", expected 3 finite'),
        ("<equality><connect body1='crank' anchor='1 ٣ 0'/></equality>", 'has anchor="1 ٣ 0", expected 3 finite'),
        ("<equality><connect body1='crank' anchor='1 nan 0'/></equality>", 'has anchor="1 nan 0", expected 3 finite'),
    ],
)
def test_what_mjcf_cannot_be(text: Any, wanted: str) -> None:
    with pytest.raises(sd.SpatialDynError, match=wanted):
        sd.Constraints.of_mjcf(four_bar(), text)
