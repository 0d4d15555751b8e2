"""Loading at its limits: many links, with the work counted, and the largest numbers."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yourdfpy
from slow import slow_but

import spatialdyn as sd
from spatialdyn.commands.cli import main
from spatialdyn.errors import ModelError
from spatialdyn.model.physical_inertia import nearest_physical, symmetric
from spatialdyn.model.robot import Link, RobotJoint
from spatialdyn.model.robot_checks import check_tree, make_link
from spatialdyn.model.update import edited

# --- many links -------------------------------------------------------------------------------------------

N = 20  # joints; robots of N, 2 N and 3 N are compared
DEEP = (
    100  # joints of a printed robot: twice and three times as many have as many digits; a comb deeper than the indent
)
CURVATURE = 4.0  # lines or comparisons per joint, N of which one walk to the root from every link makes
INERTIAL = '<inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'

# parent of joint k, its mass, its leader
SHAPES: dict[str, Callable[[int], tuple[int, float, int | None]]] = {
    "chain": lambda k: (k - 1, 1.0, None),
    "star": lambda k: (0, 1.0, None),
    "comb": lambda k: (k - 1 if k % 2 else max(0, k - 2), 1.0, None),
    "massless": lambda k: (k - 1, 0.0, None),
    "mimic chain": lambda k: (k - 1, 1.0, k - 1 if k > 1 else None),
    "mimic star": lambda k: (k - 1, 1.0, 1 if k > 1 else None),
    "mimic chain backwards": lambda k: (k - 1, 1.0, k + 1),
}
shapes = pytest.mark.parametrize("shape", SHAPES)


def text(shape: str, n: int) -> str:
    """A robot of n revolute joints; the last leads where each follows the next."""
    parts = ['<robot name="r"><link name="l0"/>']
    for k in range(1, n + 1):
        parent, mass, leader = SHAPES[shape](k)
        mimic = "" if leader is None or leader > n else f'<mimic joint="j{leader}" multiplier="-1" offset="0.5"/>'
        parts.append(
            f'<link name="l{k}">{INERTIAL.format(mass)}</link><joint name="j{k}" type="revolute">'
            f'<parent link="l{parent}"/><child link="l{k}"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>'
            f'<limit lower="-1" upper="1"/>{mimic}</joint>'
        )
    return "\n".join([*parts, "</robot>"])


def lines(call: Callable[[], object], folder: str = "") -> int:
    """Lines of Python that a call runs, calls included; of all files or of one folder."""
    count = 0

    def trace(frame: Any, event: str, argument: Any) -> Any:
        nonlocal count
        count += event == "line"
        return trace if frame.f_code.co_filename.startswith(folder) else None

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    finally:
        sys.settrace(before)
    return count


def curvature(work: Callable[[int], int], n: int = N) -> float:
    """By how much work outgrows the robot: the second difference over n, 2 n and 3 n joints, per joint."""
    work(3)  # imports, caches
    one, two, three = (work(count * n) for count in (1, 2, 3))
    assert one > n
    return abs(three - 2 * two + one) / n


class Name(str):
    """A name that counts how often it is compared or hashed, which a search through a list does once an entry."""

    count = 0

    def __eq__(self, other: object) -> bool:
        Name.count += 1
        return str.__eq__(self, other)

    def __hash__(self) -> int:
        Name.count += 1
        return str.__hash__(self)


def described(shape: str, n: int) -> yourdfpy.URDF:
    """The robot as a description of yourdfpy, all of its names counted."""
    links, joints = [yourdfpy.Link(Name("l0"))], []
    for k in range(1, n + 1):
        parent, mass, leader = SHAPES[shape](k)
        links.append(yourdfpy.Link(Name(f"l{k}"), yourdfpy.Inertial(mass=mass, inertia=np.eye(3))))
        mimic = None if leader is None or leader > n else yourdfpy.Mimic(Name(f"j{leader}"))
        ends = dict(parent=Name(f"l{parent}"), child=Name(f"l{k}"))
        joints.append(yourdfpy.Joint(Name(f"j{k}"), type="continuous", origin=np.eye(4), mimic=mimic, **ends))
    return yourdfpy.URDF(yourdfpy.Robot("r", links, joints), build_scene_graph=False)


def test_the_count_sees_a_search_through_a_list_and_a_walk_to_the_root() -> None:
    """Else the tests below would pass whatever the code does."""

    def search(n: int) -> int:
        names, Name.count = [Name(k) for k in range(n)], 0
        assert all(Name(k) in names for k in range(n))
        return Name.count

    def walk(n: int) -> None:
        for k in range(n):
            while k:
                k -= 1

    assert curvature(search) > N / 2
    assert curvature(lambda n: lines(lambda: walk(n))) > N / 2


@shapes
@pytest.mark.parametrize("mimic", slow_but([True], [False, True]))
def test_lines_run_from_text_to_model_grow_as_the_robot(shape: str, mimic: bool) -> None:
    assert curvature(lambda n: lines(lambda: sd.load_urdf(text(shape, n), mimic=mimic))) < CURVATURE


@shapes
@pytest.mark.parametrize("mimic", [False, True])
def test_comparisons_of_names_grow_as_the_robot(shape: str, mimic: bool) -> None:
    def work(n: int) -> int:
        urdf, Name.count = described(shape, n), 0
        sd.load_urdf(urdf, mimic=mimic)
        return Name.count

    assert curvature(work) < CURVATURE


SHOWN: list[tuple[str, list[str]]] = [("chain", []), ("star", []), ("comb", []), ("comb", ["--json"])]


@pytest.mark.parametrize(("shape", "arguments"), slow_but(SHOWN[::3], SHOWN))
def test_lines_and_letters_of_info_grow_as_the_robot(
    shape: str,
    arguments: list[str],
    tmp_path: Any,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "rich.box", None)  # its caches make the count depend on earlier prints

    letters = {}

    def work(n: int) -> int:
        path = tmp_path / f"{n}.urdf"
        path.write_text(text(shape, n))
        count = lines(lambda: main(["info", str(path), *arguments]), str(Path(sd.__file__).parent))
        letters[n] = len(capsys.readouterr().out)
        return count

    assert curvature(work, DEEP) < CURVATURE
    assert curvature(letters.__getitem__, DEEP) < CURVATURE


@pytest.mark.parametrize("shape", ["chain", "star", "comb"])
def test_letters_of_a_printed_model_grow_as_the_robot(shape: str) -> None:
    assert curvature(lambda n: len(str(sd.load_urdf(text(shape, n)))), DEEP) < CURVATURE


def test_a_cycle_is_found_in_steps_that_grow_as_the_robot() -> None:
    """A ring beside the tree, of which every link would be walked round."""
    eye = tuple(np.eye(4).ravel().tolist())

    def work(n: int) -> int:
        links = [Link(f"l{k}") for k in range(n)]
        joints = [
            RobotJoint(f"j{k}", "fixed", f"l{k - 1}" if k > 1 else f"l{n - 1}", f"l{k}", eye) for k in range(1, n)
        ]

        def refused() -> None:
            with pytest.raises(ModelError, match='link "l1" hangs on a cycle of joints'):
                check_tree("r", links, joints)

        return lines(refused)

    assert curvature(work) < CURVATURE


# --- numbers next to the largest float --------------------------------------------------------------------

HUGE = 1.7e308
BALL = (1.0, (0.0, 0.0, 0.1), np.eye(3))
ARM = """<robot name="arm"><link name="base"/>
<link name="hand"><inertial><origin xyz="{com}" rpy="{rpy}"/><mass value="{mass}"/>
<inertia ixx="{moment}" ixy="{product}" ixz="0" iyy="{moment}" iyz="0" izz="{moment}"/></inertial></link>
<joint name="elbow" type="{kind}"><parent link="base"/><child link="hand"/><axis xyz="{axis}"/></joint>
<link name="tip"><inertial><mass value="{mass}"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="wrist" type="{wrist}"><parent link="hand"/><child link="tip"/><origin xyz="{place}"/></joint></robot>"""
USUAL = dict(
    com="0 0 0.1", rpy="0 0 0", mass="2", moment="1", product="0", kind="revolute", axis="0 1 0", wrist="fixed",
    place="0 0 1",
)  # fmt: skip
MOVES = 'joint "elbow" moves an inertia that is beyond the largest float'
FAR = 'link "hand" has mass {} at a distance of {}, whose inertia about the link\'s origin is beyond the largest float'


def loaded(policy: str = "warn", **given: str) -> sd.Model:
    """The arm with some values in place of the usual; the one warning that may come is about inertias."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message='robot "arm": link', category=UserWarning)
        return sd.load_urdf(ARM.format(**{**USUAL, **given}), inertia=policy)


@pytest.mark.parametrize("policy", ["warn", "strict", "repair"])
@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"moment": "1e308"}, ""),
        ({"moment": "1e308", "rpy": "0.3 0.4 0.5"}, ""),
        ({"moment": "1.2e308"}, MOVES),
        ({"moment": "1.7e308", "rpy": "0.3 0.4 0.5", "kind": "prismatic"}, ""),
        (
            {"moment": "1.7e308", "product": "1.7e308", "rpy": "0 0 0.8"},
            """:2: link "hand" has an inertia that is beyond the largest float in the link's frame""",
        ),
        ({"mass": "1e308"}, MOVES),
        ({"mass": "1e308", "com": "0 0 10"}, FAR.format("1e+308", "10")),
        ({"com": "0 1e200 0"}, FAR.format("2", "1e+200")),
        ({"place": "1e200 0 0"}, MOVES),
        ({"place": "1e200 0 0", "wrist": "revolute"}, MOVES),
        ({"place": "1e308 1e308 1e308", "wrist": "revolute", "mass": "1e-300"}, MOVES),
        ({"com": "1e200 1e200 1e200", "mass": "0"}, ""),
        ({"place": "1e308 0 0", "mass": "0"}, ""),
        ({"moment": "4e307", "kind": "prismatic"}, ""),
        ({"mass": "4e307", "kind": "prismatic", "place": "0 0 0.1"}, ""),
        ({"axis": "1.7e308 1.7e308 1.7e308"}, ""),
        ({"axis": "5e-324 0 0"}, ""),
        ({"moment": "5e-324", "mass": "1e-323"}, ""),
    ],
)
def test_huge_numbers_make_a_finite_model_or_an_error_of_ours(
    policy: str, given: dict[str, str], expected: str
) -> None:
    """Never a RuntimeWarning: here every warning is an error."""
    if not expected:
        finite(loaded(policy, **given))
        return
    with pytest.raises(sd.SpatialDynError) as caught:
        loaded(policy, **given)
    assert expected in str(caught.value)


def finite(model: sd.Model) -> None:
    """Nothing about a model is NaN or infinite but its limits."""
    parts = [model.bodies[name] for name in ("inertia", "inertia_bound", "X", "S", "armature")]
    while parts:
        part = parts.pop()
        if part.dtype.names:
            parts += [part[name] for name in part.dtype.names]
        else:
            assert np.isfinite(part).all()
    assert np.isfinite(model.total_mass)
    assert all(np.isfinite(frame.placement).all() for frame in model.frames)


def test_a_symmetric_inertia_keeps_its_bits_at_either_end_of_the_floats() -> None:
    I = np.array([[1.7e308, 5e-324, 0.1], [5e-324, 1.6e308, 3e-320], [0.1, 3e-320, 1.5e308]])
    assert (symmetric(I) == I).all()
    assert (np.reshape(make_link("l", (1.0, (0, 0, 0), I)).inertia, (3, 3)) == I).all()
    skewed = I + np.array([[0, 0, 2e-17], [0, 0, 0], [0, 0, 0]])
    assert (symmetric(skewed) == symmetric(skewed).T).all()


def test_repair_of_huge_inertias_is_that_of_small_ones() -> None:
    I = np.array([[1.0, 0.1, 0.2], [0.1, 2.0, 0.3], [0.2, 0.3, 5.0]])
    np.testing.assert_array_equal(nearest_physical(2.0**1020 * I), 2.0**1020 * nearest_physical(I))
    assert not np.isfinite(nearest_physical(np.diag([-HUGE, HUGE, HUGE]) * [1, 1, 1.05])).all()
    with pytest.raises(sd.InertiaError, match=r'link "hand" has .* repaired it is beyond the largest float'):
        sd.ModelBuilder().add_body("hand", inertia=(1.0, (0, 0, 0), np.diag([-HUGE, HUGE, 1.05 * HUGE]))).robot(
            "repair"
        )


def build(**fields: Any) -> sd.Model:
    model: sd.Model = sd.ModelBuilder("r").add_body("a", **{"inertia": BALL, "joint_name": "j", **fields}).build()
    return model


def far_slide() -> sd.Model:
    return build(joint="prismatic", axis=(1, 0, 0), placement=(1.5e308, 0, 0))


def followers(multiplier: float, offset: float) -> sd.Model:
    b = sd.ModelBuilder("r").add_body("a", inertia=BALL, joint_name="a")
    for leader, name in ("ab", "bc", "cd"):
        b.add_body(name, inertia=BALL, joint_name=name, mimic=dict(leader=leader, multiplier=multiplier, offset=offset))
    return b.build(mimic=True)


def led_by_a_fixed_joint() -> sd.Model:
    b = sd.ModelBuilder("r").add_body("a", joint="fixed", joint_name="a")
    b.add_body("s", None, "prismatic", (1, 0, 0), (1.5e308, 0, 0), BALL, "s", mimic=dict(leader="a", offset=1.5e308))
    return b.build(mimic=True)


def twice_loaded() -> sd.Model:
    load = (1e308, (0, 0, 0), np.eye(3))
    return build(joint="prismatic").with_(payload={"a": load}).with_(payload={"a": load})


def three_masses() -> sd.Model:
    b = sd.ModelBuilder("r")
    for k in range(3):
        b.add_body(f"l{k}", joint="prismatic", inertia=(1e308, (0, 0, 0), np.eye(3)))
    return b.build()


def two_fixed() -> sd.Model:
    b = sd.ModelBuilder("r").add_body("a", None, "fixed", placement=(1.5e308, 0, 0))
    return b.add_body("b", "a", "fixed", placement=(1.5e308, 0, 0), joint_name="weld").build()


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: build(placement=((0, 0, 0), (math.inf, 0, 0))), "has rpy (inf, 0, 0), expected finite numbers"),
        (lambda: build(placement=np.full((4, 4), 1e308)), 'placement of joint "j" is no pose'),
        (lambda: build(inertia=(1.0, (0, 0, 0), HUGE * np.array([[1, -1, 0], [1, 1, 0], [0, 0, 1]]))), "not symmetric"),
        (lambda: far_slide().reduced({"j": 1.5e308}), 'joint "j" stands at [inf, nan, nan] in the body that carries'),
        (lambda: build(joint="spherical").reduced({"j": [1e308] * 4}), "expected a part of unit norm"),
        (lambda: followers(1e200, 0.0), 'joint "c" mimics "a" with multiplier inf and offset 0.0 in all, expected'),
        (lambda: followers(2.0, 1e308), 'joint "c" mimics "a" with multiplier 4.0 and offset inf in all, expected'),
        (led_by_a_fixed_joint, 'joint "s" stands at [inf, nan, nan] in the body that carries it, expected finite'),
        (twice_loaded, 'link "a" of 1e+308 kg with a payload of 1e+308 kg has an inertia that is beyond the largest'),
        (three_masses, 'robot "r" has a total mass that is beyond the largest float'),
        (two_fixed, 'joint "weld" stands at [inf, 0.0, 0.0] in the body that carries it, expected finite numbers'),
        (lambda: edited(build(), {1: Link("a", 1e308, (10.0, 0.0, 0.0))}, {}), 'link "a" has mass 1e+308 and com'),
        (lambda: edited(build(), {1: Link("a", HUGE, (0.0,) * 3, (HUGE,) * 9)}, {}), 'joint "j" moves an inertia that'),
    ],
)
def test_products_that_overflow_are_refused_by_name(make: Callable[[], sd.Model], expected: str) -> None:
    with pytest.raises(sd.SpatialDynError) as caught:
        make()
    assert expected in str(caught.value)
