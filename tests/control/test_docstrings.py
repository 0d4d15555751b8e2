"""Examples in the docstrings of control, and of what scenes and requirements are called with."""

from __future__ import annotations

import doctest
from importlib import import_module

import pytest

MODULES = (
    "control.gains", "control.inverse_kinematics", "control.laws", "control.monitors", "control.observers",
    "control.paths", "laws.control", "accuracy.requires", "identification.base", "identification.excitation",
    "identification.identify", "identification.recording", "operational.hierarchy", "operational.space",
    "operational.tasks",
)  # fmt: skip


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_the_docstrings_hold(name: str) -> None:
    if name == "control.gains":
        pytest.importorskip("scipy")
    tried = doctest.testmod(import_module(f"spatialdyn.{name}"))
    assert (tried.failed, tried.attempted > 0) == (0, True)
