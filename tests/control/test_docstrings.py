"""Examples in the docstrings of control, of what scenes and requirements are called with, and of steps."""

from __future__ import annotations

import doctest
from importlib import import_module

import pytest
from plain import compiled

MODULES = (
    "control.adaptive", "control.gains", "control.impedance", "control.inverse_kinematics", "control.laws",
    "monitors.monitors", "control.motions", "control.observers", "control.paths", "control.control",
    "accuracy.requires",
    "operational.hierarchy", "operational.space", "operational.tasks", "operational.whole_body",
    "identification.base", "identification.excitation", "identification.identify", "identification.recording",
    "constraints.contact_dynamics", "linearization.step_derivatives", "linearization.closed_step",
)  # fmt: skip
COMPILED = ("control.adaptive", "control.laws", "control.control")  # simulations


@pytest.mark.parametrize("name", [pytest.param(x, marks=compiled) if x in COMPILED else x for x in MODULES])
def test_the_examples_of_the_docstrings_hold(name: str) -> None:
    if name == "control.gains":
        pytest.importorskip("scipy")
    if name == "operational.whole_body":
        pytest.importorskip("qpsolvers")
    tried = doctest.testmod(import_module(f"spatialdyn.{name}"))
    assert (tried.failed, tried.attempted > 0) == (0, True)
