"""The transmissions of URDFs: of ROS' two laws by hand, of real robots, and what is left out by name."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import spatialdyn as sd

HEAD = '<robot name="r"><link name="a"/>'
JOINTS = "".join(
    f'<link name="l{k}"/><joint name="j{k}" type="{kind}"><parent link="a"/><child link="l{k}"/>'
    '<limit velocity="1" effort="1"/></joint>'
    for k, kind in enumerate(("revolute", "revolute", "fixed", "floating"), 1)
)
TWO = (
    '<transmission name="w"><type>transmission_interface/DifferentialTransmission</type>'
    '<actuator name="m2"><role>actuator2</role><mechanicalReduction>11</mechanicalReduction></actuator>'
    '<actuator name="m1"><role>actuator1</role><mechanicalReduction>-7</mechanicalReduction></actuator>'
    '<joint name="j1"><role>joint1</role><offset>0.25</offset><mechanicalReduction>3</mechanicalReduction></joint>'
    '<joint name="j2"><role>joint2</role><offset>0.75</offset><mechanicalReduction>-2</mechanicalReduction></joint>'
    "</transmission>"
)


def simple(name: str, joint: str, n: str = "50", law: str = "SimpleTransmission") -> str:
    return (
        f'<transmission name="{name}"><type>transmission_interface/{law}</type><joint name="{joint}"/>'
        f'<actuator name="m"><mechanicalReduction>{n}</mechanicalReduction></actuator></transmission>'
    )


def read(*texts: str) -> tuple[sd.Transmission, ...]:
    return sd.read_transmissions(f"{HEAD}{JOINTS}{''.join(texts)}</robot>")


def test_a_simple_transmission_divides_by_its_reduction() -> None:
    (t,) = read(simple("t", "j1"))
    assert t == sd.Transmission("j1", 0.02, actuators="m")
    pr2 = '<transmission name="t" type="SimpleTransmission"><actuator name="m"/><joint name="j1"/>'
    (t,) = read(pr2 + "<mechanicalReduction>-79.5</mechanicalReduction></transmission>")
    assert t.matrix[0, 0] == 1.0 / -79.5
    ros2 = (
        '<transmission name="t"><plugin>transmission_interface/SimpleTransmission</plugin><actuator name="m" role="a"/>'
    )
    (t,) = read(
        ros2
        + '<joint name="j1"><offset>0.5</offset><mechanical_reduction>4</mechanical_reduction></joint></transmission>'
    )
    assert (t.matrix[0, 0], t.offset[0]) == (0.25, 0.5)
    assert len(read(f'<ros2_control name="c">{simple("t", "j1")}</ros2_control>')) == 1


def test_a_differential_has_half_the_sum_and_half_the_difference() -> None:
    """ros_control: τ_j1 = N1 (n1 τ1 + n2 τ2), τ_j2 = N2 (n1 τ1 - n2 τ2), and the velocities of the same power."""
    (t,) = read(TWO)
    n, N = (-7.0, 11.0), (3.0, -2.0)  # of distinct primes, whose products differ
    np.testing.assert_allclose(
        t.matrix, [[0.5 / (N[0] * n[0]), 0.5 / (N[0] * n[1])], [0.5 / (N[1] * n[0]), -0.5 / (N[1] * n[1])]], rtol=1e-15
    )
    efforts = np.array([[N[0] * n[0], N[0] * n[1]], [N[1] * n[0], -N[1] * n[1]]])
    np.testing.assert_allclose(np.linalg.inv(t.matrix).T, efforts, rtol=1e-14)
    assert (t.actuators, t.offset.tolist()) == (("m1", "m2"), [0.25, 0.75])


def test_the_four_bar_law_of_ros_does_not_keep_power() -> None:
    """Which is why it is left out: (velocities per actuator)ᵀ (efforts per actuator) is not the identity."""
    n1, n2, N1, N2 = 50.0, 30.0, 2.0, 1.5
    v = np.array([[1 / (N1 * n1), 0.0], [-1 / (N1 * n1 * N2), 1 / (n2 * N2)]])
    tau = np.array([[N1 * n1, 0.0], [-N2 * N1 * n1, N2 * n2]])
    assert abs(v.T @ tau - np.eye(2)).max() > 0.1
    with pytest.warns(UserWarning, match='"f" has type "transmission_interface/FourBarLinkageTransmission"'):
        assert read(simple("f", "j1", law="FourBarLinkageTransmission")) == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (simple("t", "j1", law="HalfDifferentialTransmission"), '"t" has type "transmission_interface/Half'),
        (simple("t", "j1").replace("transmission_interface/", "hey5/"), '"t" has type "hey5/SimpleTransmission"'),
        (simple("t", "nosuch"), '"t" drives "nosuch", which is no joint of the robot'),
        (simple("t", "j3"), '"t" drives "j3", which is fixed'),
        (simple("t", "j4"), '"t" drives "j4", which is floating'),
        (simple("t", "j1", "0"), '"t" has a reduction of 0'),
        (simple("t", "j1", "fifty"), "has mechanicalReduction 'fifty', expected a finite number"),
        (simple("t", "j1", "nan"), "expected a finite number"),
        (simple("t", "j1").replace('<joint name="j1"/>', ""), "has 0 joints and 1 actuators, expected 1 of each"),
        (TWO.replace("actuator2", "left"), "has actuators of roles"),
        (TWO.replace('name="j2"', 'name="j1"'), "expected names, each once"),
    ],
)
def test_what_is_not_sound_is_left_out_by_name(text: str, words: str) -> None:
    with pytest.warns(UserWarning, match="transmissions are left out") as heard:
        assert read(text, simple("other", "j2")) != ()
    assert words in str(heard[0].message)


def test_a_joint_is_driven_once() -> None:
    with pytest.warns(UserWarning, match='"second" drives "j1", as another does'):
        assert len(read(simple("first", "j1"), simple("second", "j1"))) == 1


@pytest.mark.parametrize(
    ("robot", "found", "differential", "left"),
    [("talos_left_arm", 6, 1, ""), ("pr2", 14, 0, 'fl_caster_rotation_joint", which is fixed')],
)
@pytest.mark.filterwarnings("ignore")
def test_real_robots_have_theirs(robot: str, found: int, differential: int, left: str) -> None:
    """Counted in the files: the casters of the PR2 are fixed there, its wrists and grippers have laws of their own."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        made = sd.read_transmissions(robot)
    assert sum(len(t.joints) == 2 for t in made) == differential
    assert len(made) == found
    assert left in "".join(str(w.message) for w in heard)
    drives = [sd.Transmission(t.joints, t.matrix, np.full(len(t.joints), 1e-4), t.offset) for t in made]
    geared = sd.load_urdf(robot).with_(transmissions=drives)
    assert (geared.armature > 0.0).sum() == sum(len(t.joints) for t in made)
