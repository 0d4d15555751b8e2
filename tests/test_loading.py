"""The work from a text to a Model, and of showing it, grows as the robot does: counted, not timed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yourdfpy

import spatialdyn as sd
from spatialdyn.cli import main
from spatialdyn.errors import ModelError
from spatialdyn.robot import Joint, Link, check_tree

N = 40  # joints; robots of N, 2 N and 3 N are compared
DEEP = 100  # joints of a printed robot: as many digits as 2 and 3 times that, and a comb deeper than what is set in
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
    """How many lines of Python a call runs, its own and those of what it calls; of all files or of one folder's."""
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
    work(n)  # imports, caches
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
@pytest.mark.parametrize("mimic", [False, True])
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


@pytest.mark.parametrize(("shape", "arguments"), [("chain", []), ("star", []), ("comb", []), ("comb", ["--json"])])
def test_lines_and_letters_of_info_grow_as_the_robot(
    shape: str,
    arguments: list[str],
    tmp_path: Any,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "rich.box", None)  # its caches make the count depend on what was printed before

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
        joints = [Joint(f"j{k}", "fixed", f"l{k - 1}" if k > 1 else f"l{n - 1}", f"l{k}", eye) for k in range(1, n)]

        def refused() -> None:
            with pytest.raises(ModelError, match='link "l1" hangs on a cycle of joints'):
                check_tree("r", links, joints)

        return lines(refused)

    assert curvature(work) < CURVATURE
