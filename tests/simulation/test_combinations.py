"""Every pair of effects runs or is refused for a reason of physics, on one of three robots in turn, each effect on all.

Runs are finite, samples of a rollout (by one of the methods) have the bits of a run, work closes the ledger, and files
keep the scene.
"""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
from combinations import PARTS, case, sets, start

import spatialdyn as sd

DT, STEPS = 1e-3, 3
EXPLICIT, CANONICAL = tuple(sd.integrators)[:4], tuple(sd.integrators)[4:9]
REASONS = (
    "impulses and velocities are found together$",  # a method in momenta or of stages knows no impulses
    "gears rub, and motors brake, within its step$",  # so they need friction that is solved for
    r'"(sym\w+|imp\w+|gauss\d)" and .*constraints.* act.*, expected one of',  # RATTLE is their form under constraints
    r'"(dop853|radau)" and .*constraints.* act.*, expected one of explicit_',  # without stabilization they drift
    "it keeps φ = 0$",  # nothing is left to stabilize
    "expected joints whose position is one number; method variational takes all$",  # RATTLE in q̇
    "(is held over a step|change at the end of a step), expected a fixed step for it",  # SciPy's adapt theirs
)


def method_of(k: int, robot: int) -> str:
    """On one robot the method that takes every scene, on another an explicit one, on the third one of the other
    families; others for the next pair.
    """
    family = (CANONICAL[k % 5], "variational", ("dop853", "radau")[k % 2])[(k + robot) % 3]
    return ("semi_implicit_euler", EXPLICIT[(k + robot) % 4], family)[(k + 2 * robot) % 3]


def attempt(model: sd.Model, given: dict[str, Any], method: str, path: Path, many: bool) -> str:
    """Run, roll out where asked, and save; the text of the error that refuses it, "" if it runs."""
    q, v = start(model)
    scene, rest = scenes.split(model, given)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            run = sd.simulate(scene, q, v, STEPS * DT, DT, method, **rest)
        except (sd.SimulationError, sd.ModelError) as error:
            refused = str(error)
            with pytest.raises((sd.SimulationError, sd.ModelError), match=re.escape(refused)):
                sd.rollout(scene, q, v, dt=DT, steps=STEPS, method=method, **{**rest, "record": None})
            return refused
        assert all(np.isfinite(x).all() for x in (run.q, run.v, run.energy, *run.states.values()))
        if "record" in rest:
            assert abs(sd.energy_ledger(run).error).max() < 5e-3  # J, of 3 steps of first order from 1 J
            return ""
        if many:
            runs = sd.rollout(scene, np.stack([q, q]), v, dt=DT, steps=STEPS, method=method, **rest)
            np.testing.assert_allclose(runs.q[1], run.q[1:], rtol=0.0, atol=1e-13)
            np.testing.assert_allclose(runs.v[1], run.v[1:], rtol=0.0, atol=1e-11)
    run.save(path)
    assert sd.Trajectory.load(path, model).scene == scene
    return ""


@pytest.mark.slow(quick="test_each_effect_alone_runs_or_is_refused_for_a_reason_of_physics")
@pytest.mark.parametrize("name", PARTS)
def test_pairs_run_or_are_refused_for_a_reason_of_physics(name: str, tmp_path: Path) -> None:
    """Each pair on one of the robots, by a method of each family in turn."""
    pairs = [x for x in sets(2) if len(x) == 2]
    check(name, pairs[PARTS.index(name) :: len(PARTS)], tmp_path / "run.npz")


@pytest.mark.parametrize("name", PARTS)
def test_each_effect_alone_runs_or_is_refused_for_a_reason_of_physics(name: str, tmp_path: Path) -> None:
    check(name, list(sets(1)), tmp_path / "run.npz")


def check(name: str, chosen: list[tuple[str, ...]], path: Path) -> None:
    """Each set of effects on one robot."""
    wrong, ran = [], 0
    for k, effects in enumerate(chosen):
        try:
            model, given = case(name, effects)
            scenes.split(model, given)
        except (sd.ModelError, sd.SimulationError) as error:
            wrong += [] if any(re.search(x, str(error)) for x in REASONS) else [(effects, str(error))]
            continue
        place = list(PARTS).index(name)
        method = method_of(k, place)
        try:
            refused = attempt(model, given, method, path, many=(k - place) % 3 == 0)
        except Exception as error:
            wrong.append((effects, method, repr(error)[:300]))
            continue
        if refused and not any(re.search(x, refused) for x in REASONS):
            wrong.append((effects, method, refused))
        ran += not refused
    assert wrong == []
    assert ran >= len(chosen) / 6
