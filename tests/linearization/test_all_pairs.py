"""Every pair of effects, by a method of each family, has a derivative or is refused for a reason of physics.

On an arm that is fixed, one that floats or a gripper with a mimic joint, in turn: derivatives agree with central
differences of the step, along states that meet the constraints, where points slide or stick, joints stop and motors
drive.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from typing import Any

import combinations
import numpy as np
import pytest
import scenes
from combinations import PARTS, case, sets, start
from dense import Array
from plain import compiled

import spatialdyn as sd

DT = 1e-3
DIFFERENCE = 1e-7  # of the entries of A and B
LIMIT = 1e-5  # of those of continuous time: what a step of CLOSE leaves
CLOSE = 1e-6  # [s]
AT_LIMIT = -0.4496  # [rad] reaches its limit within a step
IN = 1e-4  # [m] in the ground
E = 1e-6  # of central differences
ONLY_IN_RUNS = {"control", "held law", "work"}
REASONS = (
    "impulses and velocities are found together$",
    "gears rub, and motors brake, within its step$",
    "adapt to a tolerance and have no derivative",
    r'"(sym\w+|imp\w+|gauss\d)" and .*constraints.* act.*, expected one of',  # RATTLE is their form under constraints
    r'"(dop853|radau)" and .*constraints.* act.*, expected one of explicit_',  # they end no step with a projection
    "it keeps φ = 0$",
    "expected joints whose position is one number; method variational takes all$",
)


def scene_of(name: str, effects: tuple[str, ...], e: float = 0.0) -> tuple[sd.Scene, Array, Array]:
    """The scene, whose steps are solved to rounding, and a state in which its laws act. Raises as the library does."""
    model, given = case(name, effects)
    q, v = start(model, AT_LIMIT)
    if "contacts" in effects:
        facing = wall(model, q, v, steep=name == "floating")
        (gap,) = sd.contact_gaps(model, sd.Contacts(model, {"tip": 0.02}, terrain=sd.Plane(facing, 0.0)), q)
        ground = sd.Plane(facing, gap + IN)
        given["contacts"] = sd.Contacts(
            model,
            {"tip": 0.02},
            3.0 if name == "arm" and e == 0.0 else 0.6,
            restitution=e,
            terrain=ground,
            tolerance=1e-13,
        )
    elif "limits" in effects:
        given["contacts"] = sd.Contacts(model, {}, tolerance=1e-13)
    return scenes.split(model, given)[0], q, v


def wall(model: sd.Model, q: Array, v: Array, steep: bool) -> Array:
    """The normal of a plane that the tip runs into, or across."""
    here, ahead = (sd.frame_placement(model, x, "tip")[:3, 3] for x in (q, sd.integrate(model, q, 1e-6 * v)))
    way = (here - ahead) / np.linalg.norm(here - ahead)
    across = np.cross(way, [0.6, 0.0, 0.8])
    return np.asarray(way + (2.0 if steep else 0.1) * across / np.linalg.norm(across))


def moves(scene: sd.Scene, q: Array, v: Array, z: dict[str, Array] | None) -> tuple[list[Array], Array]:
    """States q, v, tau and bristles (12, ...), half of them by E to one side of a state in each of 6 ways, and half to
    the other; and the ways.
    """
    model, e, n = scene.model, E, scene.model.nv
    ways = np.random.default_rng(0).normal(size=(6, 4 * n))
    by = np.split(e * np.concatenate([ways, -ways]), 4, axis=1)
    x, u = np.asarray(sd.integrate(model, np.tile(q, (12, 1)), np.ascontiguousarray(by[0]))), v + by[1]
    if scene.constraints is not None:
        x = np.asarray(sd.project_configuration(model, scene.constraints, x))
        u = np.asarray(sd.project_velocity(model, scene.constraints, x, u))
    given = [x, u, torque(model) + by[2], *([] if z is None else [z["bristles"] + by[3]])]
    moved = [sd.difference(model, np.tile(q, (12, 1)), x), u, *given[3:], given[2]]
    return given, np.hstack([(y[:6] - y[6:]) / (2.0 * e) for y in moved])


def torque(model: sd.Model) -> Array:
    return np.asarray(0.2 * np.random.default_rng(1).normal(size=model.nv))


def check(scene: sd.Scene, q: Array, v: Array, method: str) -> Any:
    """The derivatives of a step, which central differences agree with."""
    model = scene.model
    z = (
        {"bristles": 1e-3 * np.random.default_rng(2).normal(size=model.nv)}
        if scene.friction_method == "lugre"
        else None
    )
    found = sd.step_derivatives(scene, q, v, torque(model), DT, method, states=z)
    given, moved = moves(scene, q, v, z)
    end = sd.step(scene, q, v, torque(model), DT, method, states=z)[0]
    after = sd.step(scene, *given[:3], DT, method, states=None if z is None else {"bristles": given[3]})
    ends = [sd.difference(model, np.tile(end, (12, 1)), after[0]), after[1]]
    ends += [] if z is None else [after[2]["bristles"]]
    wanted = np.hstack([(y[:6] - y[6:]) / (2.0 * E) for y in ends])
    most = DIFFERENCE * max(1.0, abs(wanted).max())
    np.testing.assert_allclose(moved @ np.hstack(found).T, wanted, rtol=0, atol=most)
    assert not found.switching.any()
    return found


def check_continuous(scene: sd.Scene, q: Array, v: Array) -> None:
    """Those of continuous time, which a short step by the explicit Euler method leads to."""
    tau = torque(scene.model)
    A, B = sd.linearize(scene, q, v, tau)
    by_state, by_tau = sd.step_derivatives(scene, q, v, tau, CLOSE, "explicit_euler")
    _, moved = moves(scene, q, v, None)
    n = scene.model.nv
    close = (moved[:, : 2 * n] @ by_state.T + moved[:, 2 * n :] @ by_tau.T - moved[:, : 2 * n]) / CLOSE
    rates = moved[:, : 2 * n] @ A.T + moved[:, 2 * n :] @ B.T
    np.testing.assert_allclose(close, rates, rtol=0, atol=LIMIT * max(1.0, abs(rates).max()))


def methods_of(scene: sd.Scene, k: int, thirds: bool) -> Iterator[str]:
    """Of those that step the scene one of each family, and one of the others, in turn; or a k-th third of all."""
    fit, every = scene.methods, tuple(sd.integrators)
    if thirds:
        yield from every[k % 3 :: 3]
        return
    for family in (every[:4], every[4:9], every[9:10]):
        known = [x for x in family if x in fit]
        if known:
            yield known[k % len(known)]
    unfit = [x for x in every if x not in fit] or ["dop853"]
    yield unfit[k % len(unfit)]


def wrongs(name: str, effects: tuple[str, ...], k: int, thirds: bool, seen: set[str]) -> Iterator[Any]:
    """What is wrong with a set of effects on a robot; states that points and joints are in are added to ``seen``."""

    def physics(error: Exception) -> bool:
        return any(re.search(x, str(error)) for x in REASONS)

    try:
        scene, q, v = scene_of(name, effects)
    except (sd.ModelError, sd.SimulationError) as error:
        if not physics(error):
            yield effects, str(error)
        return
    for method in methods_of(scene, k, thirds):
        try:
            seen.update(check(scene, q, v, method).active.tolist())
            seen.add(method)
        except (sd.SimulationError, sd.SpatialDynError) as error:
            if method in sd.integrators and method in scene.methods and method not in ("dop853", "radau"):
                yield effects, method, str(error)  # what steps has a derivative
            elif not physics(error):
                yield effects, method, str(error)
        except AssertionError as error:
            yield effects, method, str(error)
    if scene.solves or scene.friction_method == "lugre":
        try:
            sd.linearize(scene, q, v, torque(scene.model))
            yield effects, "continuous"
        except sd.SimulationError as error:
            if not re.search("impulses act in steps|bristles are a state beside q and v", str(error)):
                yield effects, "continuous", str(error)
    else:
        try:
            check_continuous(scene, q, v)
        except (AssertionError, sd.SpatialDynError) as error:
            yield effects, "continuous", str(error)


def found_wrong(
    name: str, chosen: list[tuple[int, tuple[str, ...]]], thirds: bool = False
) -> tuple[list[Any], set[str]]:
    wrong: list[Any] = []
    seen: set[str] = set()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for k, effects in chosen:
            wrong += wrongs(name, effects, k, thirds, seen)
    return wrong, seen


BESIDE = ("friction", "lugre", "limits", "current", "voltage", "springs")  # each on one robot, in turn; loops on both


@pytest.mark.parametrize(
    ("name", "effect"),
    [("arm", "couplers"), ("floating", "couplers"), *((("arm", "floating")[k % 2], x) for k, x in enumerate(BESIDE))],
)
def test_a_point_bounces_beside_all_else(name: str, effect: str) -> None:
    """A tip that is thrown back: while loops hold it, joints rub, stop and bend, and motors drive.

    Of an arm of two freedoms that a loop leaves the tip moves in a plane: what friction and the load do there is one.
    """
    pair = next(x for x in EFFECTS if set(x) == {"contacts", effect})
    scene, q, v = scene_of(name, pair, e=0.5)
    if (name, effect) == ("arm", "couplers"):
        with pytest.raises(sd.SimulationError, match='tip" bounces where constraints or joints that stick could take'):
            check(scene, q, v, "semi_implicit_euler")
        return
    assert check(scene, q, v, "semi_implicit_euler").active[0] in ("bounces", "glances")


EFFECTS = [x for x in sets(2) if not ONLY_IN_RUNS & set(x)]
THIN = 12  # one of so many sets is quick


@compiled
@pytest.mark.parametrize("name", PARTS)
def test_some_pairs_have_derivatives_by_a_method_of_each_family(name: str) -> None:
    place = PARTS.index(name)
    wrong, seen = found_wrong(name, [(k, x) for k, x in enumerate(EFFECTS) if k % THIN == 3 * place])
    assert wrong == []
    assert seen & set(sd.integrators)


@pytest.mark.slow(quick="test_some_pairs_have_derivatives_by_a_method_of_each_family")
@pytest.mark.parametrize("name", PARTS)
def test_all_pairs_have_derivatives_or_are_refused_for_a_reason_of_physics(name: str) -> None:
    place, names = PARTS.index(name), combinations.EFFECTS
    pairs = [(k, x) for k, x in enumerate(EFFECTS) if len(x) == 2]
    pairs = [(k, x) for k, x in pairs if sum(map(names.index, x)) % len(PARTS) == place]  # each on one robot
    wrong, seen = found_wrong(name, pairs)
    assert wrong == []
    expected = {"lower limit", "slides", "commanded", "bends", *(["sticks"] if name == "arm" else [])}
    assert expected <= seen


@pytest.mark.slow(quick="test_some_pairs_have_derivatives_by_a_method_of_each_family")
@pytest.mark.parametrize("name", PARTS)
def test_each_effect_alone_has_derivatives_by_all_methods(name: str) -> None:
    """On each robot a third of the methods, so that on one of them each effect has each."""
    alone = [x for x in EFFECTS if len(x) < 2]
    wrong, seen = found_wrong(name, [(k + PARTS.index(name), x) for k, x in enumerate(alone)], thirds=True)
    assert wrong == []
    assert len(seen & set(sd.integrators)) == 10
