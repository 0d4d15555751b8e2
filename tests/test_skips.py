"""What tests skip for want of: nothing that the extras of the suite do not install; and what a person has set."""

from __future__ import annotations

import ast
import importlib.metadata
import os
import re
import sys
from pathlib import Path

from environment import VARIABLES

import spatialdyn

TESTS = Path(__file__).parent
PROJECT = TESTS.parent / "pyproject.toml"
SKIPPED = re.compile(r"importorskip\(\s*[\"']([\w.]+)[\"']")
NAME = re.compile(r"[A-Za-z0-9._-]+")


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def extra(name: str) -> set[str]:
    """Names of the distributions of an extra, through those that it names."""
    (listed,) = re.findall(rf"^{name} = (\[.*\])$", PROJECT.read_text(encoding="utf-8"), re.MULTILINE)
    found = set()
    for line in ast.literal_eval(listed):
        own = re.fullmatch(r"spatialdyn\[([\w,]+)\]", line)
        found |= set().union(*map(extra, own[1].split(","))) if own else {NAME.match(line)[0]}
    return found


def installed(names: set[str]) -> set[str]:
    """These distributions and what they require, as far as it is here."""
    found: set[str] = set()
    waiting = {*names}
    while waiting:
        name = normal(waiting.pop())
        if name in found:
            continue
        found.add(name)
        try:
            lines = importlib.metadata.requires(name) or ()
        except importlib.metadata.PackageNotFoundError:
            continue
        waiting |= {NAME.match(line)[0] for line in lines if "extra ==" not in line}  # type: ignore[index]
    return found


def test_what_tests_skip_for_want_of_is_in_the_extras_of_the_suite() -> None:
    wanted = {x for path in TESTS.rglob("*.py") for x in SKIPPED.findall(path.read_text(encoding="utf-8"))}
    assert "mujoco" in wanted
    there = installed(extra("test") | extra("validate") | {"numpy", "numba", "yourdfpy"})
    provided = {**importlib.metadata.packages_distributions(), "pinocchio": ["pin"]}  # whose files are elsewhere
    for module in {x.partition(".")[0] for x in wanted} - {*sys.stdlib_module_names}:
        owners = {normal(x) for x in provided.get(module, [module])}
        assert owners & there, f"{module} is in no extra of the suite"


def test_no_file_of_tests_needs_pinocchio_to_be_read() -> None:
    """There is no wheel of it on Windows, and the oldest dependencies are tested without it; ``wheel.pin`` skips."""
    for path in TESTS.rglob("*.py"):
        if path.name == "wheel.py" or path.parent.name == "scripts":  # which tests run as texts
            continue
        for x in ast.parse(path.read_text(encoding="utf-8")).body:
            names = [x.module or ""] if isinstance(x, ast.ImportFrom) else [n.name for n in getattr(x, "names", [])]
            assert "pinocchio" not in {name.partition(".")[0] for name in names}, path


def test_variables_that_a_person_has_set_for_the_library_are_not_those_of_the_suite() -> None:
    sources = Path(spatialdyn.__file__).parent.rglob("*.py")
    read = {x for path in sources for x in re.findall(r"SPATIALDYN_[A-Z_]+", path.read_text(encoding="utf-8"))}
    assert read == {*VARIABLES}
    assert not read & {*os.environ}
