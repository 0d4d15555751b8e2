"""Pages that benchmarks write are those of the figures that they keep."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from typing import Any

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
if not (BENCHMARKS / "scale.py").exists():
    pytest.skip("the benchmarks are not here", allow_module_level=True)


def script(name: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A benchmark as a module of another name."""
    found = importlib.util.spec_from_file_location(f"benchmark_of_{name}", BENCHMARKS / f"{name}.py")
    assert found is not None
    assert found.loader is not None
    made = importlib.util.module_from_spec(found)
    monkeypatch.setattr(sys, "path", [*sys.path, str(BENCHMARKS.parent / "tests" / "embedded")])
    found.loader.exec_module(made)
    return made


def kept(name: str) -> Any:
    return json.loads((BENCHMARKS / f"{name}.json").read_text(encoding="utf-8"))


def test_the_page_of_scale_is_made_of_its_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    scale = script("scale", monkeypatch)
    assert scale.PAGE.read_text(encoding="utf-8") == scale.page(kept("studies"))


def test_the_page_of_platforms_is_made_of_its_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    chips = script("chips", monkeypatch)
    assert chips.PAGE.read_text(encoding="utf-8") == chips.page(kept("chips")["sizes"])
    assert all(x["data"] == x["bss"] == 0 for x in kept("chips")["sizes"])


def test_a_cluster_is_as_busy_as_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """A scheduler that takes 1 s for a chunk of 4 s keeps 4 of 8 workers busy; 2 chunks given out keep 2."""
    scale = script("scale", monkeypatch)
    assert scale.makespan(scale.Cluster(1, 1, 0.0), 10, 4.0) == 40.0
    assert scale.makespan(scale.Cluster(8, 1, 1.0), 1000, 4.0) == 1004.0
    assert scale.makespan(scale.Cluster(8, 1, 0.0), 1000, 4.0, ahead=2) == 2000.0
    assert scale.used(scale.Cluster(4, 2, 0.0), 7.0) == 1.0
