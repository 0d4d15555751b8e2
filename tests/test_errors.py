"""Hints of what to install: packages of the extras, by commands that work wherever this library came from."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import spatialdyn
from spatialdyn.errors import EXTRAS, pip_install

PACKAGE = Path(spatialdyn.__file__).parent
OF_TESTS = {"test", "bench"}  # extras that no message names


def test_the_table_of_extras_is_pyprojects() -> None:
    project = PACKAGE.parent / "pyproject.toml"
    if not project.exists():
        pytest.skip("an installed package has no pyproject.toml")
    table = project.read_text(encoding="utf-8").partition("[project.optional-dependencies]\n")[2].partition("\n\n")[0]
    found = {}
    for line in table.splitlines():
        extra, _, needed = line.partition(" = ")
        found[extra] = tuple(re.findall(r'"([\w.-]+)', needed))
    assert {extra: packages for extra, packages in found.items() if extra not in OF_TESTS} == EXTRAS
    assert set(found) >= OF_TESTS


def test_no_hint_installs_this_package_from_an_index() -> None:
    """It is on none: ``pip install "spatialdyn[plot]"`` fails."""
    named = {path.name for path in PACKAGE.rglob("*.py") if "spatialdyn[" in path.read_text(encoding="utf-8")}
    assert named == set()
    pages = {path.name: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.md")}
    assert [name for name, text in pages.items() if re.search(r"pip install \"?spatialdyn", text)] == []
    hints = [
        (path.name, line.strip())
        for path in PACKAGE.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        for words in re.findall(r"pip install ([\w-]+)", line)
        if words not in {"pandas", "xacro"} | {package for packages in EXTRAS.values() for package in packages}
    ]
    assert hints == []


def test_the_command_names_all_packages_of_an_extra() -> None:
    assert pip_install("plot") == "pip install matplotlib"
    assert pip_install("view") == "pip install viser pycollada"
