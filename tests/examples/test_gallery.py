"""The gallery: every example has its title, what to learn and to look at, a length to read at once, and runs."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import spatialdyn as sd
from spatialdyn.commands import cli
from spatialdyn.errors import EXTRAS, pip_install
from spatialdyn.examples import gallery

NAMES = gallery.names()
LENGTH = (15, 60)  # lines of code, without docstrings and empty ones
PAGES = {"troubleshooting"}  # of eight small ones
SOLVERS = {"ilqr": 175, "swing_up_lqr": 80, "pushed_while_standing": 80}  # and searches
PACKAGES = {"scipy": "simulation", "sympy": "symbolic", "mpmath": "exact"}  # by the extra that installs each


def source(name: str) -> str:
    return inspect.getsource(gallery.module(name))


def lines_of_code(text: str) -> int:
    """Lines that are neither empty nor a comment nor of a docstring."""
    lines = {k for k, line in enumerate(text.splitlines(), 1) if line.strip() and not line.strip().startswith("#")}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            lines -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(lines)


def test_the_order_names_every_example_once() -> None:
    assert tuple(NAMES) == gallery.ORDER


@pytest.mark.parametrize("name", NAMES)
def test_an_example_opens_with_what_one_learns_and_what_to_look_at(name: str) -> None:
    text = inspect.getdoc(gallery.module(name)) or ""
    assert re.match(r".{30,120}\.?\n\nLearn    \S", text), text
    assert "\nLook at  " in text
    least, most = LENGTH
    assert least <= lines_of_code(source(name)) <= SOLVERS.get(name, 2 * most if name in PAGES else most)
    assert source(name).endswith('if __name__ == "__main__":\n    start(main)\n')


@pytest.mark.parametrize("name", NAMES)
def test_an_example_names_in_its_first_lines_what_it_needs(name: str) -> None:
    text, code = inspect.getdoc(gallery.module(name)) or "", source(name)
    head, _, needs = text.partition("\nNeeds    ")
    words = set(re.findall(r"[\w-]+", needs.partition("\n\n")[0]))
    named = {extra for extra, packages in EXTRAS.items() if words & {*packages}}
    used = set(re.findall(r'need\("\w+(?:\.\w+)*", "(\w+)"\)', code))
    robots = set(re.findall(r'load_urdf\("(\w+)"|robot: str = "(\w+)"', code))
    own = {"two_link", "three_link", "pendulum", "tree", "floating_body"}
    used |= {"validate"} if any("".join(robot) not in own for robot in robots) else set()
    assert used - {"plot"} - ({"validate"} if "if it is installed" in head else set()) == named


@pytest.mark.parametrize(("package", "extra"), PACKAGES.items())
def test_a_missing_package_is_named_with_the_line_that_installs_it(
    package: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in [package, *(x for x in sys.modules if x.startswith(f"{package}."))]:
        monkeypatch.setitem(sys.modules, module, None)
    name = {"scipy": "cart_pole_lqr", "sympy": "arms_in_symbols", "mpmath": "exercise_1_numbers"}[package]
    with pytest.raises(sd.SpatialDynError, match=f"{package} is not installed; {pip_install(extra)}"):
        gallery.module(name).main()


def test_the_command_lists_runs_and_prints(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["example"]) == 0
    listed = capsys.readouterr().out
    assert all(f"{name} " in listed and gallery.title(name) in " ".join(listed.split()) for name in NAMES)
    assert cli.main(["example", "first_steps"]) == 0
    ran = capsys.readouterr().out
    assert ran.startswith("First steps")
    assert "by the library" in ran
    assert cli.main(["example", "first_steps", "--source"]) == 0
    assert capsys.readouterr().out == source("first_steps")


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["first_step"], 'example is "first_step", expected .*first_steps'),
        (["gallery"], 'example is "gallery", expected'),
        (["first_steps", "--save", "x.png"], "--save was given, expected none: first_steps has no picture"),
        (["first_steps", "--quick"], "--quick was given, expected none"),
        (["last_exercise_3_mass_matrix", "--save", "no/x.png"], "--save is 'no/x.png', expected a name in a folder"),
    ],
)
def test_what_an_example_has_not_is_named(argv: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["example", *argv]) == 2
    assert re.search(message, capsys.readouterr().err)


def test_an_example_runs_as_a_module_and_saves_its_picture(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    path = tmp_path / "m.png"
    run = [sys.executable, "-W", "error", "-m", "spatialdyn.examples.last_exercise_3_mass_matrix"]
    done = subprocess.run([*run, "--save", str(path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert path.read_bytes()[:4] == b"\x89PNG"
    done = subprocess.run([*run, "--save", str(tmp_path / "m.nope")], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert re.match(r"last_exercise_3_mass_matrix: --save is .*expected a name that ends in one of .png, ", done.stderr)
