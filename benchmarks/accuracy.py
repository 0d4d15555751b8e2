"""Digits of each call: errors against the exact engine, on the corpus, long chains and chains of unequal masses.

``python benchmarks/accuracy.py [--states 4] [--robots panda icub ...]`` prints tables in units of float64's eps
2.2e-16, and of float32 for the lanes; ``--json FILE`` writes them too. accuracy.json beside this file holds the whole
table: errors as they are, "singular" where a joint has zero articulated inertia. Errors are against a reference of
more than 100 digits:

rnea   largest error over largest torque
crba   largest error of an entry over √(M_ii M_jj)
aba    largest error over largest acceleration; forward.py beside this file has the other methods
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import spatialdyn as sd
from spatialdyn.urdf.load import example_robots, robot_names

Array = NDArray[np.float64]
EPS = float(np.finfo(float).eps)
BITS = 120
ROD = (1.0, (0.0, 0.0, 0.5), np.diag([1 / 12, 1 / 12, 1e-3]))
CALLS = ("rnea", "crba", "aba")
WRONG_NAME = "ur3"  # its <robot> has none
TIPS = (1e3, 1e6, 1e9, 1e12)
LIGHT = (1e-3, 1e-6, 1e-9, 1e-12)


class State(NamedTuple):
    """A configuration, velocities, accelerations and torques."""

    q: Array
    v: Array
    a: Array
    tau: Array


def state(model: sd.Model, rng: np.random.Generator) -> State:
    """A random state: angles uniform on the circle, the rest normal."""
    step = rng.uniform(-np.pi, np.pi, model.nv)
    v, a, tau = rng.normal(size=(3, model.nv))
    return State(sd.integrate(model, sd.neutral(model), step), v, a, tau)


def inputs(name: str, s: State) -> tuple[Array, ...]:
    """The inputs of a call, from a state."""
    return {"rnea": (s.q, s.v, s.a), "crba": (s.q,), "aba": (s.q, s.v, s.tau)}[name]


def error(name: str, found: Any, truth: Any) -> float:
    """The error of a result, as defined in the module's docstring."""
    if not np.size(truth):
        return 0.0
    wrong = abs(np.asarray(found).astype(object) - truth).astype(float)
    if name != "crba":
        size = float(abs(truth).max())
        return float(wrong.max()) / size if size else float(wrong.max())
    scale = np.sqrt(np.diagonal(truth).astype(float))
    scale = scale[:, None] * scale
    seen = scale > 0  # a joint without mass behind it has a row of zeros
    return float(max((wrong[seen] / scale[seen]).max(initial=0.0), wrong[~seen].max(initial=0.0)))


def measured(model: sd.Model, name: str, s: State, call: Any = None, bits: int = BITS) -> float:
    """The error of a call, or of ``call`` instead, in one state."""
    given = inputs(name, s)
    return error(name, (call or getattr(sd, name))(model, *given), sd.exact(model, getattr(sd, name), bits)(*given))


# --- robots ---------------------------------------------------------------------------------------------------


def chain(n: int, spatial: bool, masses: Sequence[float] | None = None) -> sd.Model:
    """Rods of 1 m end to end: hinges about y, or about x and y in turn. Every rotation is exact."""
    builder = sd.ModelBuilder(f"{'spatial' if spatial else 'planar'}{n}")
    for k in range(n):
        m = 1.0 if masses is None else masses[k]
        parent, placement = (f"b{k - 1:04d}", (0, 0, 1.0)) if k else (None, None)
        axis = (1, 0, 0) if spatial and k % 2 else (0, 1, 0)
        builder.add_body(f"b{k:04d}", parent, "revolute", axis, placement, (m, ROD[1], m * ROD[2]))
    return builder.build()


def uneven() -> Iterator[tuple[str, list[float]]]:
    """Masses of seven links of which one or more are far heavier or lighter than the others."""
    for m in TIPS:
        yield f"tip {m:g}", [1.0] * 6 + [m]
    for m in LIGHT:
        yield f"light tip {m:g}", [1.0] * 6 + [m]
        yield f"light middle {m:g}", [1.0] * 3 + [m] + [1.0] * 3
        yield f"light base {m:g}", [m] + [1.0] * 6
        yield f"alternating {m:g}", [1.0, m] * 3 + [1.0]


def lopsided() -> Iterator[tuple[str, sd.Model]]:
    """Spatial chains of such links."""
    for name, masses in uneven():
        yield name, chain(7, True, masses)


def corpus(names: Sequence[str] = ()) -> Iterator[tuple[str, sd.Model]]:
    """The robots of example-robot-data, fixed and floating."""
    known = set(example_robots())
    for name, path in robot_names().items():
        if path not in known or name == WRONG_NAME or (names and name not in names):
            continue
        for root in ("fixed", "floating"):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                yield f"{name} {root}", sd.load_urdf(path, root=root)


# --- tables ---------------------------------------------------------------------------------------------------


def worst(model: sd.Model, states: int, seed: int = 0) -> dict[str, float | str]:
    """The largest error of each call over random states, or the error that it raises."""
    rng = np.random.default_rng(seed)
    found: dict[str, float | str] = {}
    for s in [state(model, rng) for _ in range(states)]:
        for name in CALLS:
            try:
                here = measured(model, name, s)
            except sd.InertiaError:
                found[name] = "singular"
            else:
                found[name] = max(here, float(found.get(name, 0.0)))
        for name in CALLS:
            key = f"{name} float32"
            try:
                program = sd.specialize(model, getattr(sd, name), dtype=np.float32)
                here = measured(model, name, s, lambda _, *x, program=program: program(*x))
            except sd.InertiaError:
                found[key] = "singular"
            else:
                found[key] = max(here, float(found.get(key, 0.0)))
    return found


def line(name: str, found: dict[str, float | str]) -> str:
    """A row of the table: float64 in units of its eps, float32 as it is."""
    cells = [x if isinstance(x, str) else f"{x / EPS:.1f}" if "32" not in k else f"{x:.1e}" for k, x in found.items()]
    return f"{name:32s}" + "".join(f"{c:>12s}" for c in cells)


def robots(without: Sequence[str], names: Sequence[str]) -> Iterator[tuple[str, str, sd.Model]]:
    """(table, name, model) of everything that is measured."""
    if "chains" not in without:
        for n in (10, 30, 100, 300):
            for spatial in (False, True):
                model = chain(n, spatial)
                yield "chains", model.name, model
    if "lopsided" not in without:
        yield from (("lopsided", *x) for x in lopsided())
    if "corpus" not in without:
        yield from (("corpus", *x) for x in corpus(names))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--states", type=int, default=2)
    parser.add_argument("--robots", nargs="*", default=())
    parser.add_argument("--without", nargs="*", default=(), choices=("corpus", "chains", "lopsided"))
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    tables: dict[str, dict[str, dict[str, float | str]]] = {}
    print(f"{'':32s}" + "".join(f"{name:>12s}" for name in (*CALLS, *(f"{c} f32" for c in CALLS))))
    for table, name, model in robots(chosen.without, chosen.robots):
        found = tables.setdefault(table, {})[name] = worst(model, chosen.states)
        print(line(name, found), flush=True)
    if chosen.json:
        chosen.json.write_text(json.dumps({"states": chosen.states, **tables}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
