"""Whole programs as users write them for Pinocchio, run with one import changed: the results have to be equal.

A program takes the folder of robots as its argument and leaves arrays, numbers and names in ``results``.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from slow import slow_but

import spatialdyn.compat.pinocchio as ours
from spatialdyn.urdf.robot_files import find_robot

FACE = "spatialdyn.compat.pinocchio"
PROGRAMS = sorted((Path(__file__).parent / "scripts").glob("*.py"))
TOLERANCE = 1e-10  # rollouts of hundreds of steps, and solves of condition 1e5, carry on rounding errors of 1e-15


def changed(text: str) -> str:
    """A program with its import changed, and nothing else."""
    text = text.replace("import pinocchio as pin\n", f"import {FACE} as pin\n")
    text = text.replace("import pinocchio\n", f"import {FACE} as pinocchio\n")
    return text.replace("from pinocchio", f"from {FACE}")


def run(path: Path, text: str, robots: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """``results`` of a program."""
    monkeypatch.setattr(sys, "argv", [str(path), str(robots)])
    scope: dict[str, Any] = {"__name__": "__main__", "__file__": str(path)}
    exec(compile(text, str(path), "exec"), scope)
    found: dict[str, Any] = scope["results"]
    return found


def missing(text: str) -> set[str]:
    """Names of Pinocchio that a program uses and compat does not have."""
    pin = importlib.import_module("pinocchio")
    return {name for name in dir(pin) if f"pin.{name}(" in text and name not in vars(ours)}


@pytest.mark.filterwarnings("ignore:.*principal moments")  # some of the robots have such inertias
@pytest.mark.parametrize("path", slow_but(PROGRAMS[::2], PROGRAMS), ids=lambda path: path.stem)
def test_programs_give_the_same_numbers(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pinocchio")
    pytest.importorskip("lxml")
    text = path.read_text(encoding="utf-8")
    assert changed(text) != text
    if missing(text):
        pytest.skip(f"compat lacks {missing(text)}")
    robots = find_robot("panda").parents[2]
    theirs = run(path, text, robots, monkeypatch)
    mine = run(path, changed(text), robots, monkeypatch)
    assert mine.keys() == theirs.keys()
    for name, expected in theirs.items():
        if isinstance(expected, (float, np.ndarray)):
            assert np.shape(mine[name]) == np.shape(expected), name
            size = max(1.0, np.abs(expected).max(initial=0.0)) if isinstance(expected, np.ndarray) else abs(expected)
            assert np.abs(mine[name] - expected).max(initial=0.0) <= TOLERANCE * max(1.0, size), name
        else:
            assert mine[name] == expected, name


def test_there_are_programs_of_ten_kinds() -> None:
    assert len(PROGRAMS) >= 10
