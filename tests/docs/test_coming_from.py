"""Cheat sheets: both columns of a table are run, side by side, and give the same numbers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spatialdyn.commands import cli
from spatialdyn.docs import blocks

SPAN = re.compile(r"`([^`]+)`")
ROWS = re.compile(r"^\| ([^|]+) \| (`.*`[^|]*) \| (`.*`) \|$", re.MULTILINE)
RUN = ("pinocchio", "mujoco")  # sheets whose other column is run
SAID = ("drake", "rbdl", "robotics_toolbox")
CLOSE = 1e-10  # of entries of order 1 to 100; recursions of two libraries differ by 1e-13


def rows(sheet: str) -> list[tuple[str, list[str], list[str]]]:
    """Task, the other library's code, ours; of several pieces the last is the value."""
    return [
        (x.strip(), SPAN.findall(y), SPAN.findall(z)) for x, y, z in ROWS.findall(blocks.read(f"coming_from/{sheet}"))
    ]


def value(code: list[str], names: dict[str, Any]) -> Any:
    for piece in code[:-1]:
        exec(piece, names)
    return eval(code[-1], names)


def prepared(sheet: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The names that the sheet's blocks define."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": sheet}
    assert blocks.run(f"coming_from/{sheet}", cli.main, names) == []
    return names


@pytest.mark.parametrize("sheet", RUN)
def test_both_columns_give_the_same_numbers(sheet: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if sheet == "pinocchio":
        pytest.importorskip("pinocchio")
    else:
        pytest.importorskip("mujoco")
    names = prepared(sheet, tmp_path, monkeypatch)
    wrong = {}
    for task, theirs, ours in rows(sheet):
        one, other = np.asarray(value(theirs, names)), np.asarray(value(ours, names))
        one = np.triu(one) + np.triu(one, 1).T if task == "mass matrix" else one  # Pinocchio may fill one triangle
        if one.shape != other.shape or not np.allclose(one, other, rtol=CLOSE, atol=CLOSE):
            wrong[task] = (one, other)
    assert wrong == {}
    assert len(rows(sheet)) >= 9


@pytest.mark.parametrize("sheet", SAID)
def test_our_column_runs_where_the_other_library_is_not_installed(
    sheet: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "SymbolicManipulator" in blocks.read(f"coming_from/{sheet}"):
        pytest.importorskip("sympy")
    names = prepared(sheet, tmp_path, monkeypatch)
    found = rows(sheet)
    assert len(found) >= 9
    for task, theirs, ours in found:
        assert theirs, task
        assert value(ours, names) is not None, task
