"""Analytic derivatives that the bridges to frameworks are held to."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any, NamedTuple

import numpy as np
import pytest
from trees import random_tree

import spatialdyn as sd

CLOSE = 1e-12  # of the largest entry: the sums are a few dozen long


class Late:
    """A framework, imported when a test first uses it: torch takes 2.5 s, in every process that collects the tests."""

    def __init__(self, name: str) -> None:
        self._name = name
        if importlib.util.find_spec(name) is None:
            pytest.skip(f"{name} is not installed", allow_module_level=True)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # pytest reads such attributes of all names in a module
            raise AttributeError(name)
        return getattr(importlib.import_module(self._name), name)


class Case(NamedTuple):
    """A batch of states of one model and the derivatives of aba there: (batch, nv, nv) by q, v and tau."""

    model: sd.Model
    given: tuple[np.ndarray, np.ndarray, np.ndarray]
    by: tuple[np.ndarray, np.ndarray, np.ndarray]


def arm() -> Case:
    """A chain of revolute and prismatic joints in five states."""
    model = random_tree(3, 3, kinds=("revolute", "prismatic"), branching=0.0).model
    q, v, tau = np.random.default_rng(0).standard_normal((3, 5, model.nv))
    by_q, by_v, by_tau = np.moveaxis(sd.aba_derivatives(model, q, v, tau), -3, 0)
    return Case(model, (q, v, tau), (by_q, by_v, by_tau))


def close(found: object, wanted: object) -> None:
    """Equal to CLOSE of the largest entry, and of the same shape."""
    found, wanted = np.asarray(found), np.asarray(wanted)
    assert found.shape == wanted.shape
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=CLOSE * max(1.0, abs(wanted).max()))


def by_mass_and_place(model: sd.Model, joint: str, state: tuple[np.ndarray, ...], at: tuple[float, np.ndarray]) -> list:
    """Derivatives of rnea by a body's mass and centre of mass: differences, exact because τ is linear in the one and
    quadratic in the other.
    """
    k = sd.specialize(model, sd.rnea, inputs=[f"mass:{joint}", f"com:{joint}"])
    mass, com = at
    by_mass = k(*state, mass + 1.0, com) - k(*state, mass, com)
    by_com = [0.5 * (k(*state, mass, com + e) - k(*state, mass, com - e)) for e in np.eye(3)]
    return [by_mass, np.stack(by_com, -1)]
