"""Exact rotors: every call against the same robot with each rotor as a body of its own, tied to its joint by G."""

from __future__ import annotations

import copy
import math
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import dense
from trees import random_inertia, random_placement, random_rotation, random_unit

import spatialdyn as sd
from spatialdyn.calls.dynamics import calls
from spatialdyn.engines.programs.recording import record
from spatialdyn.engines.programs.tracer import evaluate, table
from spatialdyn.recursions import SPECS

Array = np.ndarray
EXACT = 1e-13  # relative: roundoff of a few bodies
TURNING = ("revolute", "prismatic", "helical", "continuous")


def axisymmetric(rng: np.random.Generator, axis: Array, at: Array) -> tuple[tuple[float, Array, Array], float]:
    """A rotor's inertia, as links take it, with its com on the line through ``at`` along the axis; and J."""
    J, across, mass = rng.uniform(2e-3, 2e-2), rng.uniform(2e-3, 2e-2), rng.uniform(0.1, 0.5)
    across = max(across, 0.6 * J)
    inertia = across * np.eye(3) + (J - across) * np.outer(axis, axis)
    return (mass, at + rng.uniform(-0.1, 0.1) * axis, inertia), J


def pair(seed: int, n: int = 6, floating: bool = False, skew: bool = True) -> tuple[sd.Model, sd.Model]:
    """A model with rotors, and the same with a body for each of them and mimic=True."""
    rng = np.random.default_rng(seed)
    geared, explicit = sd.ModelBuilder("geared", root="b0"), sd.ModelBuilder("explicit", root="b0")
    if floating:
        inertia = random_inertia(rng)
        geared.set_inertia("b0", inertia)
        explicit.set_inertia("b0", inertia)
    for k in range(1, n + 1):
        parent = f"b{rng.integers(max(0, k - 2), k)}"
        kind = "spherical" if k == 3 and not floating else TURNING[rng.integers(4)]
        axis, placement, inertia = random_unit(rng, 3), random_placement(rng), random_inertia(rng)
        own: dict[str, Any] = {"pitch": 0.1} if kind == "helical" else {}
        rotor = None
        if kind != "spherical":
            e = random_unit(rng, 3) if skew and k % 3 else axis
            ratio = rng.uniform(3.0, 10.0) * (-1) ** k
            at = np.array([*rng.uniform(-0.2, 0.2, size=3)])
            body, J = axisymmetric(rng, e, at)
            rotor = sd.Rotor(J, ratio, tuple(e))
            X = np.eye(4)
            X[:3, 3] = at
            body = (body[0], body[1] - at, body[2])
            geared.add_body(f"r{k}", parent, "fixed", placement=placement @ X, inertia=body, joint_name=f"z{k}")
            explicit.add_body(
                f"r{k}", parent, "continuous", e, placement @ X, body, joint_name=f"z{k}",
                mimic={"leader": f"j{k}", "multiplier": ratio, "offset": rng.normal()},
            )  # fmt: skip
        for builder in (geared, explicit):
            builder.add_body(
                f"b{k}", parent, kind, axis, placement, inertia, joint_name=f"j{k}",
                rotor=rotor if builder is geared else None, **own,
            )  # fmt: skip
    options: dict[str, Any] = {"root": "floating"} if floating else {}
    return geared.build(**options), explicit.build(mimic=True, **options)


def states(model: sd.Model, seed: int = 0, count: int = 4) -> dict[str, Array]:
    rng = np.random.default_rng(seed)
    q = sd.random_configuration(model, rng, count)
    return {"q": q, **{name: rng.normal(size=(count, model.nv)) for name in ("v", "a", "tau", "p", "v_r", "a_r")}}


PAIRS = [(1, 6, False), (2, 6, False), (3, 5, True), (4, 6, True)]
IDENTICAL = (
    "rnea nonlinear_effects generalized_gravity crba aba aba_refined aba_square_root crba_solve minverse kinetic_energy "
    "potential_energy momentum velocity_from_momentum hamiltonian momentum_rate hamilton_field coriolis_matrix "
    "mass_matrix_dot coriolis_transpose_times_velocity modified_rnea christoffel_symbols mass_matrix_derivatives "
    "rnea_derivatives aba_derivatives generalized_gravity_derivatives center_of_mass center_of_mass_velocity "
    "center_of_mass_acceleration com_jacobian center_of_mass_velocity_derivatives"
).split()
CENTROIDAL = "centroidal_momentum centroidal_momentum_rate centroidal_map centroidal_map_dot centroidal_dynamics_derivatives".split()


def inputs_of(name: str, x: dict[str, Array]) -> list[Array]:
    return [x[i.name] for i in SPECS[name].present if not i.static and not i.optional]


def close(one: Any, other: Any, tolerance: float = EXACT) -> None:
    one, other = np.asarray(one), np.asarray(other)
    assert one.shape == other.shape
    assert abs(one - other).max() <= tolerance * max(abs(other).max(), 1e-300)
