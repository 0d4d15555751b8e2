"""Every two options of ``identify`` together, of robots with all kinds of joints: they run, or break a rule by name."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
from example_runs import compiled

import spatialdyn as sd

SOLID = (1.0, (0.1, 0.05, 0.2), np.diag([0.1, 0.12, 0.09]))
CHOICES: dict[str, tuple[Any, ...]] = {
    "robot": ("hinges", "floating", "spherical", "sliding", "mimic"),
    "log": ("a", "v", "q", "two", "generator"),
    "method": ("ols", "wls", "log_cholesky", "sdp"),
    "parameters": ("inertial", "friction", "inertial+friction", "inertial+friction+armature+offset"),
    "prior": (None, 0.1),
    "form": (None, "torque", "momentum"),
    "hold": (None, "after", "before"),
    "delay": (0.0, 0.015, True),
    "window": (1, 3),
    "cutoff": (None, 15.0),
    "v_min": (0.0, 0.05),
    "rows": ("all", "base"),
    "remove": (None, 0.3),
    "of": ("all", "load", "some"),
}
RULES: dict[str, Callable[[dict[str, Any]], bool]] = {  # what is refused, and where
    'form is "torque" and hold': lambda x: x["form"] == "torque" and x["hold"] is not None,
    "expected None for method": lambda x: x["prior"] is not None and x["method"] in ("ols", "wls"),
    'rows is "base", expected "all"': lambda x: x["rows"] == "base" and x["robot"] != "floating",
    "recording is 'a generator'": lambda x: x["log"] == "generator" and x["delay"] is True,
    "the torques of these rows are all 0": lambda x: x["rows"] == "base" and x["delay"] is True,
    'bodies is .*"inertial"': lambda x: x["of"] == "some" and "inertial" not in x["parameters"],
    "recording has no v, expected it of robot": lambda x: x["log"] == "q" and x["robot"] in ("floating", "spherical"),
}


@cache
def robot(kind: str) -> sd.Model:
    builder = sd.ModelBuilder(kind, "world")
    if kind in ("floating", "spherical"):
        builder.add_body("first", "world" if kind == "floating" else None, kind, inertia=SOLID)
        return builder.add_body("last", "first", "revolute", (0, 1, 0), (0.1, 0.0, 0.2), SOLID).build()
    slides = kind == "sliding"
    builder.add_body("first", None, "prismatic" if slides else "revolute", (0, 0, 1) if slides else (0, 1, 0),
                     inertia=SOLID, joint_name="z")  # fmt: skip
    follows = {"mimic": {"leader": "z", "multiplier": 0.7, "offset": 0.1}} if kind == "mimic" else {}
    builder.add_body("middle", "first", "revolute", (1, 0, 0), (0.0, 0.1, 0.3), None if slides else SOLID, **follows)
    builder.add_body("last", "middle", "revolute", (0, 1, 0), (0.1, 0.0, 0.2), SOLID)
    return builder.build(mimic=True) if follows else builder.build()


@cache
def columns(kind: str, seed: int) -> dict[str, Any]:
    """A motion of 4 s, its torques with friction, and of a floating base the wrench that moves it."""
    model, rng = robot(kind), np.random.default_rng(seed)
    t = np.linspace(0.0, 4.0, 401)
    at = sd.fourier(*(rng.normal(size=(2, 3, model.nv)) * 1.5), 0.25, sd.neutral(model), model, False)
    q, v, a = at(t)
    own = np.arange(model.nv) >= {"floating": 6, "spherical": 3}.get(kind, 0)  # of one freedom
    tau = sd.rnea(model, q, v, a) + own * (0.3 * v + 0.4 * np.sign(v))
    wrenches = None
    if kind == "floating":
        J = sd.frame_jacobian(model, q, "first")
        force = np.linalg.solve(np.swapaxes(J[:, :, :6], 1, 2), tau[:, :6, None])[..., 0]
        tau, wrenches = (tau - np.einsum("nij,ni->nj", J, force))[:, 6:], {"first": force}
    return {"t": t, "q": q, "tau": tau + 0.01 * rng.normal(size=tau.shape), "v": v, "a": a, "wrenches": wrenches}


def recordings(kind: str, log: str) -> Any:
    if log in ("two", "generator"):
        logs = [sd.Recording(**columns(kind, seed)) for seed in (0, 1)]
        return logs if log == "two" else iter(logs)
    left = {"a": {}, "v": {"a": None}, "q": {"a": None, "v": None}}[log]
    return sd.Recording(**{**columns(kind, 0), **left})


def every_pair() -> Iterator[tuple[dict[str, Any], list[str]]]:
    """Rows in which any two choices meet, the best of 60 random ones each, with the rules that they break.

    Rows break none but where the two choices themselves do.
    """
    names, rng = list(CHOICES), np.random.default_rng(0)
    pairs = {
        ((a, i), (b, j))
        for a, b in itertools.combinations(names, 2)
        for i in range(len(CHOICES[a])) for j in range(len(CHOICES[b]))
    }  # fmt: skip
    while pairs:
        first = min(pairs)
        tried = []
        for _ in range(60):
            row = {name: int(rng.integers(len(CHOICES[name]))) for name in names} | dict(first)
            words = {name: CHOICES[name][k] for name, k in row.items()}
            broken = [said for said, holds in RULES.items() if holds(words)]
            met = pairs & set(itertools.combinations(row.items(), 2))
            tried.append((-len(broken), len(met), words, broken, met))
        *_, words, broken, met = max(tried, key=lambda x: x[:2])
        pairs -= {first} if broken else met
        yield words, broken


def identified(row: dict[str, Any]) -> sd.Identified:
    options = dict(row)
    kind, log, of = (options.pop(name) for name in ("robot", "log", "of"))
    options |= {"all": {}, "load": {"payload": "last"}, "some": {"bodies": robot(kind).joints[-1].name}}[of]
    return sd.identify(recordings(kind, log), robot(kind), **options)


@compiled
def test_every_two_options_run_or_are_refused_for_a_reason() -> None:
    pytest.importorskip("cvxpy")
    refused = set()
    for row, broken in every_pair():
        if broken:
            refused |= {*broken}
            with pytest.raises(sd.IdentificationError, match="|".join(broken)):
                identified(row)
            continue
        found = identified(row)
        for numbers in (found.beta, found.parameters, found.noise, found.covariance):
            assert np.isfinite(numbers).all(), row
        assert found.to_json(), row
        if found.consistent:
            assert found.model().nv == found.start.nv, row
    assert refused == {*RULES}
