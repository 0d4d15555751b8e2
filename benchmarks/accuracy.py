"""How many digits each call has: errors against the exact engine, over the corpus, long chains and lopsided robots.

``python benchmarks/accuracy.py [--states 4] [--robots panda icub ...]`` prints tables in units of float64's eps
2.2e-16, and of float32 for the lanes; ``--json FILE`` writes them too. accuracy.json beside this file holds the whole
table: errors as they are, "singular" where a joint moves no inertia. Errors are against truth that rounds to more than
100 digits:

rnea   largest error over largest torque
crba   largest error of an entry over √(M_ii M_jj)
aba    largest error over largest acceleration
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
from spatialdyn.urdf import example_robots, robot_names

Array = NDArray[np.float64]
EPS = float(np.finfo(float).eps)
BITS = 120
LARGEST = 300  # chain that Pinocchio is given
ROD = (1.0, (0.0, 0.0, 0.5), np.diag([1 / 12, 1 / 12, 1e-3]))
CALLS = ("rnea", "crba", "aba")
WRONG_NAME = "ur3"  # its <robot> has none
METHODS = ("aba", "crba", "refined", "square_root")
TIPS = (1e3, 1e6, 1e9, 1e12)
LIGHT = (1e-3, 1e-6, 1e-9, 1e-12)


class State(NamedTuple):
    """A configuration, velocities, accelerations and torques."""

    q: Array
    v: Array
    a: Array
    tau: Array


def state(model: sd.Model, rng: np.random.Generator) -> State:
    """A random state: angles all round, the rest normal."""
    step = rng.uniform(-np.pi, np.pi, model.nv)
    v, a, tau = rng.normal(size=(3, model.nv))
    return State(sd.integrate(model, sd.neutral(model), step), v, a, tau)


def inputs(name: str, s: State) -> tuple[Array, ...]:
    """What a call takes of a state."""
    return {"rnea": (s.q, s.v, s.a), "crba": (s.q,), "aba": (s.q, s.v, s.tau)}[name]


def error(name: str, found: Any, truth: Any) -> float:
    """The error of a call, measured as the head of this file says."""
    if not np.size(truth):
        return 0.0
    wrong = abs(np.asarray(found).astype(object) - truth).astype(float)
    if name != "crba":
        size = float(abs(truth).max())
        return float(wrong.max()) / size if size else float(wrong.max())
    scale = np.sqrt(np.diagonal(truth).astype(float))
    scale = scale[:, None] * scale
    seen = scale > 0  # a joint that moves no mass has a row of zeros
    return float(max((wrong[seen] / scale[seen]).max(initial=0.0), wrong[~seen].max(initial=0.0)))


def measured(model: sd.Model, name: str, s: State, call: Any = None, bits: int = BITS) -> float:
    """The error of a call, or of ``call`` in its place, at one state."""
    given = inputs(name, s)
    return error(name, (call or getattr(sd, name))(model, *given), sd.exact(model, getattr(sd, name), bits)(*given))


# --- robots ---------------------------------------------------------------------------------------------------


def chain(n: int, spatial: bool, masses: Sequence[float] | None = None) -> sd.Model:
    """Rods of a metre end to end: hinges about y, or about x and y in turn. Every rotation is exact."""
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


def peers(spatial: bool, masses: Sequence[float], s: State, truth: Any) -> dict[str, float]:
    """Errors of Pinocchio's aba and MuJoCo's forward dynamics on the same chain; what gives no number is left out.

    Pinocchio's Data of n joints in a row takes 72 n³ bytes: of a thousand, 72 GB.
    """
    import mujoco
    import pinocchio as pin

    other, joint = pin.Model(), 0
    spec = mujoco.MjSpec()
    spec.compiler.boundmass = spec.compiler.boundinertia = 0.0
    spec.option.gravity = (0.0, 0.0, -9.81)
    body = spec.worldbody
    for k, m in enumerate(masses):
        about_x, place = spatial and k % 2 == 1, np.array([0.0, 0.0, 1.0 if k else 0.0])
        hinge = pin.JointModelRX() if about_x else pin.JointModelRY()
        joint = other.addJoint(joint, hinge, pin.SE3(np.eye(3), place), f"b{k:04d}")
        other.appendBodyToJoint(joint, pin.Inertia(m, np.array(ROD[1]), m * ROD[2]), pin.SE3.Identity())
        body = body.add_body(
            name=f"b{k:04d}", pos=place, mass=m, ipos=ROD[1], inertia=m * np.diag(ROD[2]), explicitinertial=True
        )
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=(1, 0, 0) if about_x else (0, 1, 0))
    found = {}
    if len(masses) <= LARGEST:
        found["pin.aba"] = error("aba", pin.aba(other, other.createData(), s.q, s.v, s.tau), truth)
    try:
        model = spec.compile()
    except ValueError:  # a mass or inertia that it takes for none
        return found
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qfrc_applied[:] = s.q, s.v, s.tau
    mujoco.mj_forward(model, data)
    return {**found, "mujoco": error("aba", np.array(data.qacc), truth)}


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
    """The largest error of each call over random states; what it raises in place of one."""
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


class Spread(NamedTuple):
    """Errors over states."""

    usual: float  # the median
    most: float  # nine of ten are below
    worst: float


def spread(errors: Sequence[float]) -> Spread:
    """What a list of errors says."""
    return Spread(*(float(x) for x in np.quantile(errors, (0.5, 0.9, 1.0))))


def moved(model: sd.Model, s: State, truth: Any, tries: int = 6) -> float:
    """How far the exact forward dynamics goes when every input moves by an ulp, up or down by chance.

    No arithmetic that rounds its inputs, or a sine of one, can be expected to come closer.
    """
    rng, most = np.random.default_rng(0), 0.0
    for _ in range(tries):
        near = (np.nextafter(x, np.where(rng.random(x.shape) < 0.5, np.inf, -np.inf)) for x in (s.q, s.v, s.tau))
        most = max(most, error("aba", sd.exact(model, sd.aba, BITS)(*near), truth))
    return most


def forward_cases() -> Iterator[tuple[str, bool, list[float], int]]:
    """(name, whether spatial, masses, states) of what forward dynamics is measured on."""
    for n, states in ((10, 100), (100, 10), (1000, 1)):
        for spatial in (False, True):
            yield f"{n} links, {'spatial' if spatial else 'planar'}", spatial, [1.0] * n, states
    for name, masses in uneven():
        for spatial in (False, True) if name.startswith("tip") else (True,):
            kind = "spatial" if spatial else "planar"
            yield f"7 links, {kind}, {name}", spatial, masses, 100 if name.startswith("tip") else 20


def forward_errors(spatial: bool, masses: list[float], states: int) -> dict[str, Spread]:
    """Errors of forward dynamics by every method of ours, and of Pinocchio and MuJoCo, at the same states."""
    model, rng = chain(len(masses), spatial, masses), np.random.default_rng(7)
    found: dict[str, list[float]] = {}
    for s in [state(model, rng) for _ in range(states)]:
        truth = sd.exact(model, sd.aba, BITS)(s.q, s.v, s.tau)
        here = {m: error("aba", sd.forward_dynamics(model, s.q, s.v, s.tau, method=m), truth) for m in METHODS}
        here |= peers(spatial, masses, s, truth)
        if len(masses) <= 100:
            here["one ulp"] = moved(model, s, truth)
        for name, x in here.items():
            found.setdefault(name, []).append(x)
    return {name: spread(x) for name, x in found.items()}


def forward_table() -> dict[str, dict[str, Any]]:
    """``forward_errors`` of all cases, printed: the worst, and the median in brackets."""
    names, table = (*METHODS, "pin.aba", "mujoco", "one ulp"), {}
    print(f"\n{'error of forward dynamics: worst (median)':40s}" + "".join(f"{name:>20s}" for name in names))
    for name, spatial, masses, states in forward_cases():
        found = forward_errors(spatial, masses, states)
        table[name] = {"states": states, **{k: x._asdict() for k, x in found.items()}}
        cells = [f"{x.worst:.1e} ({x.usual:.0e})" if (x := found.get(k)) else "" for k in names]
        print(f"{name:40s}" + "".join(f"{c:>20s}" for c in cells), flush=True)
    return table


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
    parser.add_argument("--without", nargs="*", default=(), choices=("corpus", "chains", "lopsided", "forward"))
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    tables: dict[str, dict[str, dict[str, float | str]]] = {}
    print(f"{'':32s}" + "".join(f"{name:>12s}" for name in (*CALLS, *(f"{c} f32" for c in CALLS))))
    for table, name, model in robots(chosen.without, chosen.robots):
        found = tables.setdefault(table, {})[name] = worst(model, chosen.states)
        print(line(name, found), flush=True)
    forward = {} if "forward" in chosen.without else {"forward": forward_table()}
    if chosen.json:
        made = {"states": chosen.states, **tables, **forward}
        chosen.json.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
