"""Examples in the docstrings of control, and of what scenes and requirements are called with."""

from __future__ import annotations

import doctest
from importlib import import_module

import pytest

MODULES = (
    "control.adaptive", "control.gains", "control.impedance", "control.inverse_kinematics", "control.laws",
    "control.monitors", "control.motions", "control.observers", "control.paths", "laws.control", "accuracy.requires",
    "operational.hierarchy", "operational.space", "operational.tasks", "operational.whole_body",
    "identification.base", "identification.excitation", "identification.identify", "identification.recording",
)  # fmt: skip


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_the_docstrings_hold(name: str) -> None:
    if name == "control.gains":
        pytest.importorskip("scipy")
    if name == "operational.whole_body":
        pytest.importorskip("qpsolvers")
    tried = doctest.testmod(import_module(f"spatialdyn.{name}"))
    assert (tried.failed, tried.attempted > 0) == (0, True)
