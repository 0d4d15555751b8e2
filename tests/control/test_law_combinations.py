"""Every law, in every pair with a reference, robot, effect, method, call, way to hold it and way to combine it."""

from __future__ import annotations

import itertools
import re
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
import scenes
from combinations import PARTS, options, robot, start

import spatialdyn as sd

DT, STEPS = 1e-3, 3
LEARN = ("SlotineLi", "NaturalAdaptation")
FACTORS: dict[str, tuple[str, ...]] = {
    "law": (
        "PD", "PDGravity", "PDPlus", "ComputedTorque", "Passivity", "StateFeedback", *LEARN, "EnergyShaping", "Gravity",
        "Impedance",
    ),
    "reference": ("goal", "steps", "spline", "quintic", "trapezoid", "fourier"),
    "robot": PARTS,
    "effect": (
        "none", "friction", "lugre", "smooth", "limits", "contacts", "couplers", "stabilized", "current", "voltage",
        "fext", "springs", "work",
    ),
    "method": tuple(sd.integrators),
    "call": ("simulate", "rollout"),
    "held": ("stages", "step", "period"),
    "wrap": ("alone", "limited", "sum", "limited sum"),
}  # fmt: skip
SOLVED = ("friction", "lugre", "limits", "contacts", "current", "voltage")  # with the velocities of a step
HELD = ("couplers", "stabilized")
STAGES = ("symplectic_euler", "implicit_midpoint", "gauss4", "gauss6")
REFUSED = {  # pairs that cannot be, by the reason
    "impulses and velocities are found together$": [
        ("effect", x, "method", y) for x in SOLVED for y in sd.integrators if y != "semi_implicit_euler"
    ],
    r"constraints.* act.*, expected one of explicit_euler": [  # stages drift off, without stabilization SciPy's too
        *[("effect", x, "method", y) for x in HELD for y in STAGES],
        *[("effect", "couplers", "method", y) for y in ("dop853", "radau")],
    ],
    "it keeps φ = 0$": [("effect", "stabilized", "method", y) for y in ("stormer_verlet", "variational")],
    "(is held over a step|change at the end of a step), expected a fixed step for it": [  # SciPy's methods adapt theirs
        *[("held", x, "method", y) for x in ("step", "period") for y in ("dop853", "radau")],
        *[("law", x, "method", y) for x in LEARN for y in ("dop853", "radau")],
    ],
    "has joints that mimic others, expected none for adaptive laws": [("law", x, "robot", "gripper") for x in LEARN],
}  # fmt: skip
Row = dict[str, str]


def refused(a: str, x: str, b: str, y: str) -> str:
    """The reason why a choice of one factor cannot be with one of another; "" if it can."""
    pairs = ((a, x, b, y), (b, y, a, x))
    return next((why for why, those in REFUSED.items() if any(p in those for p in pairs)), "")


def three_cannot_be(row: Row) -> bool:
    """Whether a law has to learn of rotors on moving links, whose momenta no ten parameters have; or momenta of a
    position that is no number stay on constraints.
    """
    if row.get("robot") != "floating":
        return False
    learns = row.get("law") in LEARN and row.get("effect") == "springs"
    return learns or (row.get("effect") in HELD and row.get("method") == "stormer_verlet")


def rows(pairs: set[tuple[str, str, str, str]]) -> list[Row]:
    """Few choices of one of each of FACTORS in which these pairs occur and none that cannot be: greedily, the same each
    time.
    """
    left, made = set(pairs), []
    while left:
        a, x, b, y = min(left)
        row = {a: x, b: y}
        for c in FACTORS:
            if c not in row:
                fit = [z for z in FACTORS[c] if not any(refused(c, z, d, row[d]) for d in row)]
                fit = [z for z in fit if not three_cannot_be({**row, c: z})]
                turn = len(made) % len(fit)  # of equals another one each time
                fit = fit[turn:] + fit[:turn]
                row[c] = max(fit, key=lambda z, c=c: sum(_pair(c, z, d, row[d]) in left for d in row))
        left -= {_pair(*p) for p in _pairs_of(row)}
        made.append({name: row[name] for name in FACTORS})
    return made


def _pair(a: str, x: str, b: str, y: str) -> tuple[str, str, str, str]:
    return (a, x, b, y) if a < b else (b, y, a, x)


def _pairs_of(row: Row) -> Iterator[tuple[str, str, str, str]]:
    for a, b in itertools.combinations(row, 2):
        yield _pair(a, row[a], b, row[b])


@cache
def whole() -> tuple[set[tuple[str, str, str, str]], set[tuple[str, str, str, str]]]:
    """All pairs that can be, and those that cannot."""
    can: set[tuple[str, str, str, str]] = set()
    cannot: set[tuple[str, str, str, str]] = set()
    for a, b in itertools.combinations(FACTORS, 2):
        for x, y in itertools.product(FACTORS[a], FACTORS[b]):
            (cannot if refused(a, x, b, y) else can).add(_pair(a, x, b, y))
    return can, cannot


def reference(name: str, model: sd.Model) -> Any:
    """What a law follows from the start, slowly."""
    q, _ = start(model)
    end = sd.integrate(model, q, 0.01 * np.arange(1.0, model.nv + 1.0))
    makers: dict[str, Callable[[], Any]] = {
        "goal": lambda: end, "steps": lambda: np.stack([q, end, q]),
        "spline": lambda: sd.spline([0.0, 0.002, 0.5], np.stack([q, end, q]), model, limits=False),
        "quintic": lambda: sd.quintic(q, end, 0.5, model, limits=False),
        "trapezoid": lambda: sd.trapezoid(q, end, 0.2, 2.0, model, limits=False),
        "fourier": lambda: sd.fourier(*np.full((2, 2, model.nv), 0.02), 2.0, q, model, limits=False),
    }  # fmt: skip
    return makers[name]()


def law_of(row: Row, model: sd.Model) -> sd.Control:
    """The law of a row."""
    held: Any = {"stages": False, "step": True, "period": 2.0 * DT}[row["held"]]
    n, name, to = model.nv, row["law"], reference(row["reference"], model)
    pi = sd.inertial_parameters(model)
    gamma = np.where(pi[:, 0] > 0.0, 10.0, np.inf)
    at = to if isinstance(to, np.ndarray) else to(0.1).q  # of laws that follow no Path
    makers: dict[str, Callable[[], sd.Control]] = {
        "Gravity": lambda: sd.Gravity(held), "EnergyShaping": lambda: sd.EnergyShaping(0.2, 0.1, at, held=held),
        "Passivity": lambda: sd.Passivity(2.0, 0.1, to, held),
        "StateFeedback": lambda: sd.StateFeedback(0.05 * np.eye(n, 2 * n), at, held=held),
        "SlotineLi": lambda: sd.SlotineLi(model, 2.0, 0.1, to, 0.9 * pi, 0.01, held=held),
        "NaturalAdaptation": lambda: sd.NaturalAdaptation(model, 2.0, 0.1, to, 0.9 * pi, gamma, held=held),
        "Impedance": lambda: sd.Impedance(
            model, "tip", sd.frame_placement(model, at, "tip"), 2.0, 0.1, joint_damping=0.05, held=held
        ),
    }  # fmt: skip
    law = makers[name]() if name in makers else getattr(sd, name)(0.2, 0.1, to, held=held)
    if "sum" in row["wrap"]:
        law = sd.PD(0.1, 0.02, start(model)[0], held=held is not False) + law
    return law.limited_by(np.full(n, 0.5)) if "limited" in row["wrap"] else law


def attempt(row: Row) -> str:
    """Run a row; the text of the error that refuses it, "" if it runs."""
    model = robot(row["robot"], row["effect"] == "springs")
    q, v = start(model)
    try:
        given = options(model, row["effect"])
        scene, rest = scenes.split(model, given)
        rest["control"] = law_of(row, model)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if row["call"] == "simulate":
                run: Any = sd.simulate(scene, q, v, STEPS * DT, DT, row["method"], **rest)
            else:
                rest.pop("record", None)
                run = sd.rollout(scene, np.stack([q, q]), v, dt=DT, steps=STEPS, method=row["method"], **rest)
                assert (run.q[0] == run.q[1]).all()
    except (sd.SimulationError, sd.ModelError) as error:
        return str(error)
    assert all(np.isfinite(x).all() for x in (run.q, run.v, *run.states.values()))
    return ""


def check(chosen: list[Row]) -> None:
    """Each of these runs."""
    wrong = []
    for row in chosen:
        try:
            found = attempt(row)
        except Exception as error:
            found = repr(error)[:300]
        if found:
            wrong.append((row, found))
    assert wrong == []


def test_pairs_that_cannot_be_are_refused_for_a_reason_of_physics() -> None:
    """Each pair with something harmless otherwise."""
    plain: Row = {name: x[0] for name, x in FACTORS.items()} | {"method": "semi_implicit_euler"}
    for a, x, b, y in sorted(whole()[1]):
        assert re.search(refused(a, x, b, y), attempt({**plain, a: x, b: y})), (a, x, b, y)


def test_each_choice_runs_with_some_of_the_others() -> None:
    singles = [min(p for p in whole()[0] if (name, x) in (p[:2], p[2:])) for name, z in FACTORS.items() for x in z]
    check(rows(set(singles))[::3])


@pytest.mark.slow(quick="test_each_choice_runs_with_some_of_the_others")
@pytest.mark.parametrize("law", FACTORS["law"])
def test_all_pairs_run_that_can(law: str) -> None:
    chosen = rows(whole()[0])
    assert whole()[0] <= {p for row in chosen for p in _pairs_of(row)}
    check([x for x in chosen if x["law"] == law])
