"""Forward dynamics by every method: its digits on chains of unequal links, beside Pinocchio and MuJoCo, and its cost.

``python benchmarks/forward.py [--json FILE] [--only errors|many|costs] [--rounds 15] [--states 3000]`` prints the
largest forward error max|a - a*| / max|a*| over random states, and the median in brackets; a* is ABA in 120 bits on the
Model's doubles. "one ulp" is the change of a* when every input changes by an ulp. Then the largest error of each method
in many states of one chain of each shape, as a batch, and in brackets over the change of a* by an ulp in that state (at
least half an eps); there a* is ABA in double-double, checked against 160 bits. Then the time of a call and of a sample
of a batch, which is that of parallel axes oblique to their frames too, and in brackets over ABA's. forward.json beside
this file holds all of it.

Joints are about coordinate axes and frames are translated, not rotated, so that all three libraries hold the same
numbers, except that MuJoCo rotates inertias to their principal axes. Rods are those of accuracy.py; links of any shape
are random in every state.
"""

from __future__ import annotations

import argparse
import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from accuracy import BITS, ROD, TIPS, State, error, state, uneven
from measure import interleaved
from numpy.typing import NDArray

import spatialdyn as sd
from spatialdyn.accuracy.references import truths
from spatialdyn.calls.forward_dynamics import EXTENDED, METHODS
from spatialdyn.engines.extended import MOST_ROWS

Array = NDArray[np.float64]
AXES = np.eye(3)
LARGEST = 300  # joints of Pinocchio's longest chain: its Data takes 72 n³ bytes, 72 GB at 1000
TRIES = 6
PEERS = ("pin.aba", "mujoco")
NAMES = (*METHODS, *PEERS, "one ulp")


class Case(NamedTuple):
    """A kind of chain.

    spatial  whether axes alternate; else all are parallel
    masses   of its links
    shaped   whether links have random shapes; else they are rods
    states   number of states
    """

    spatial: bool
    masses: Sequence[float]
    states: int
    shaped: bool = False

    @property
    def name(self) -> str:
        """Number of links, their shape and axes, in words."""
        return f"{len(self.masses)} {'links' if self.shaped else 'rods'}, {'spatial' if self.spatial else 'planar'}"


def cases() -> Iterator[tuple[str, Case]]:
    """All cases, by name."""
    for n, states in ((10, 100), (100, 10), (1000, 1)):
        for spatial in (False, True):
            case = Case(spatial, [1.0] * n, states)
            yield case.name, case
    for name, masses in uneven():
        heavy = name.startswith("tip")
        for spatial in (False, True) if heavy else (True,):
            case = Case(spatial, masses, 100 if heavy else 20)
            yield f"{case.name}, {name}", case
    for m in (1.0, *TIPS):
        for spatial in (False, True):
            case = Case(spatial, [1.0] * 6 + [m], 20, shaped=True)
            yield f"{case.name}, tip {m:g}", case
    case = Case(True, [1.0] * 3 + [1e12] + [1.0] * 3, 20, shaped=True)
    yield f"{case.name}, middle 1e+12", case


class Body(NamedTuple):
    """A link: the axis of its joint and its position on the previous link; mass, com (3,) and inertia (3, 3)."""

    axis: Any
    place: Any
    mass: float
    com: Any
    inertia: Any


def rods(case: Case) -> list[Body]:
    """Rods of 1 m, end to end."""
    length, com, inertia = np.array([0.0, 0.0, 1.0]), np.array(ROD[1]), ROD[2]
    return [
        Body(AXES[0 if case.spatial and k % 2 else 1], length if k else 0.0 * length, m, com, m * inertia)
        for k, m in enumerate(case.masses)
    ]


def shapes(case: Case, rng: np.random.Generator) -> list[Body]:
    """Links of six mass points each, hinges at random positions."""
    made = []
    for mass in case.masses:
        points, weights = rng.uniform(-0.3, 0.3, size=(6, 3)), rng.uniform(0.1, 1.0, size=6)
        points, weights = points + rng.uniform(-0.2, 0.2, size=3), weights / weights.sum()
        com = weights @ points
        second = ((points - com) * weights[:, None]).T @ (points - com)
        axis = AXES[rng.integers(3) if case.spatial else 2]
        made.append(Body(axis, rng.uniform(-0.5, 0.5, 3), mass, com, mass * (np.trace(second) * np.eye(3) - second)))
    return made


# --- libraries ----------------------------------------------------------------------------------------------


def ours(chain: list[Body]) -> sd.Model:
    """As a Model."""
    builder = sd.ModelBuilder("chain")
    for k, b in enumerate(chain):
        parent = f"b{k - 1:04d}" if k else None
        builder.add_body(f"b{k:04d}", parent, "revolute", b.axis, b.place, (b.mass, b.com, b.inertia))
    return builder.build()


def with_pinocchio(chain: list[Body]) -> Callable[[Any, Any, Any], Any]:
    """Pinocchio's ABA of a chain."""
    model, joint = pin.Model(), 0
    for k, b in enumerate(chain):
        made = pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ()
        joint = model.addJoint(joint, made[int(np.argmax(b.axis))], pin.SE3(np.eye(3), b.place), f"b{k:04d}")
        model.appendBodyToJoint(joint, pin.Inertia(b.mass, b.com, b.inertia), pin.SE3.Identity())
    data = model.createData()
    return lambda q, v, tau: pin.aba(model, data, q, v, tau)


def with_mujoco(chain: list[Body]) -> Callable[[Any, Any, Any], Any]:
    """MuJoCo's forward dynamics of a chain, through M. Raises ValueError for a link that MuJoCo does not accept."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.compiler.boundmass = spec.compiler.boundinertia = 0.0
    spec.option.gravity = (0.0, 0.0, -9.81)
    body = spec.worldbody
    for k, b in enumerate(chain):
        I, body = b.inertia, body.add_body(name=f"b{k:04d}", pos=b.place, mass=b.mass, ipos=b.com)
        body.explicitinertial = True
        if np.count_nonzero(I - np.diag(np.diagonal(I))):
            body.fullinertia = (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
        else:
            body.inertia = np.diagonal(I)
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=b.axis)
    model = spec.compile()
    data = mujoco.MjData(model)

    def run(q: Any, v: Any, tau: Any) -> Any:
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, v, tau
        mujoco.mj_forward(model, data)
        return data.qacc.copy()

    return run


def ways(chain: list[Body], model: sd.Model, peers: Sequence[str] = PEERS) -> dict[str, Callable[..., Any]]:
    """{name: function} of all methods of forward dynamics, and of the peers that accept the chain."""
    made: dict[str, Callable[..., Any]] = {
        method: lambda q, v, tau, method=method: sd.forward_dynamics(model, q, v, tau, method=method)
        for method in METHODS
    }
    if "pin.aba" in peers and len(chain) <= LARGEST:
        made["pin.aba"] = with_pinocchio(chain)
    if "mujoco" in peers:
        with contextlib.suppress(ValueError):
            made["mujoco"] = with_mujoco(chain)
    return made


# --- digits -------------------------------------------------------------------------------------------------


class Measured(NamedTuple):
    """A chain in a state, the exact accelerations, and the error of every method."""

    model: sd.Model
    state: State
    truth: Any
    errors: dict[str, float]


def measured(case: Case, peers: Sequence[str] = PEERS) -> Iterator[Measured]:
    """All states of a case."""
    rng = np.random.default_rng(7)
    chain = rods(case)
    model = ours(chain)
    for _ in range(case.states):
        if case.shaped:
            chain = shapes(case, rng)
            model = ours(chain)
        s = state(model, rng)
        given = s.q, s.v, s.tau
        truth = sd.exact(model, sd.aba, BITS)(*given)
        yield Measured(
            model, s, truth, {k: error("aba", f(*given), truth) for k, f in ways(chain, model, peers).items()}
        )


def moved(model: sd.Model, s: State, truth: Any) -> float:
    """The change of the exact forward dynamics when every input changes by an ulp, up or down at random.

    Arithmetic that rounds its inputs, or the sine of one, cannot be expected to do better.
    """
    rng, most = np.random.default_rng(0), 0.0
    for _ in range(TRIES):
        near = (np.nextafter(x, np.where(rng.random(x.shape) < 0.5, np.inf, -np.inf)) for x in (s.q, s.v, s.tau))
        most = max(most, error("aba", sd.exact(model, sd.aba, BITS)(*near), truth))
    return most


def errors(case: Case) -> dict[str, dict[str, float]]:
    """Of every method: the median, the 90 % quantile and the largest error."""
    found: dict[str, list[float]] = {}
    for x in measured(case):
        here = dict(x.errors)
        if len(case.masses) <= LARGEST:
            here["one ulp"] = moved(x.model, x.state, x.truth)
        for name, e in here.items():
            found.setdefault(name, []).append(e)
    levels = {"median": 0.5, "most": 0.9, "worst": 1.0}
    return {name: {k: float(np.quantile(e, x)) for k, x in levels.items()} for name, e in found.items()}


# --- digits of many states ------------------------------------------------------------------------------------

EVERY = (*METHODS, EXTENDED)
OBLIQUE = (1.0, *TIPS)


def oblique(tip: float) -> sd.Model:
    """Seven links of random shapes about parallel axes oblique to their frames, the tip heavier by a factor."""
    rng = np.random.default_rng(7)
    axis = rng.normal(size=3)
    case = Case(True, [1.0] * 6 + [tip], 1, shaped=True)
    return ours([body._replace(axis=axis) for body in shapes(case, rng)])


def of_each_shape() -> Iterator[tuple[str, sd.Model]]:
    """A chain of each shape that is short enough for SIMD lanes, and those about oblique axes."""
    for name, case in cases():
        if len(case.masses) <= MOST_ROWS:
            yield name, ours(shapes(case, np.random.default_rng(7)) if case.shaped else rods(case))
    for tip in OBLIQUE:
        yield f"7 links, oblique, tip {tip:g}", oblique(tip)


def many(model: sd.Model, states: int) -> dict[str, dict[str, float]]:
    """Of every method the 90 % quantile, the largest error, and the largest in units of the change by an ulp."""
    rng = np.random.default_rng(7)
    q, (v, tau) = rng.uniform(-np.pi, np.pi, (states, model.nq)), rng.normal(size=(2, states, model.nv))
    given = [q, v, tau]
    truth, _ = truths(model, "aba", given)
    size = abs(truth).max(axis=1)
    ulp = np.zeros(states)
    for _ in range(TRIES):
        near = [np.nextafter(x, np.where(rng.random(x.shape) < 0.5, np.inf, -np.inf)) for x in given]
        ulp = np.maximum(ulp, abs(truths(model, "aba", near, 0)[0] - truth).max(axis=1) / size)
    found = {"one ulp": ulp}
    for method in EVERY:
        found[method] = abs(sd.forward_dynamics(model, *given, method=method) - truth).max(axis=1) / size
    least = np.maximum(ulp, 0.5 * np.finfo(float).eps)
    return {
        name: {"most": float(np.quantile(e, 0.9)), "worst": float(e.max()), "in ulps": float((e / least).max())}
        for name, e in found.items()
    }


# --- cost ---------------------------------------------------------------------------------------------------

WITH_LAST = Case(True, [1.0] * 7, 1, shaped=True)


def costs(rounds: int, samples: int = 4096) -> dict[str, dict[str, float]]:
    """Microseconds of a call from Python, and nanoseconds per sample of a batch on one thread, of 7 links.

    "oblique" is "batch" for frames turned every way, where no entry of a rotation is 0 or 1.
    """
    chain = shapes(WITH_LAST, np.random.default_rng(0))
    model = ours(chain)
    s = state(model, np.random.default_rng(0))
    sd.compile(model, ("aba", "aba_refined", "crba_solve"))  # else what is timed may be interpreted
    runs = {name: (lambda run=run: run(s.q, s.v, s.tau)) for name, run in ways(chain, model).items()}
    runs[EXTENDED] = lambda: sd.forward_dynamics(model, s.q, s.v, s.tau, method=EXTENDED)
    call = {name: 1e6 * t for name, t in interleaved(runs, rounds, 0.02).items()}
    return {
        "call": call,
        **{name: batch(m, rounds, samples) for name, m in (("batch", model), ("oblique", oblique(1.0)))},
    }


def batch(model: sd.Model, rounds: int, samples: int) -> dict[str, float]:
    """Nanoseconds per sample of a batch on one thread, of every method."""
    q, v, tau = np.random.default_rng(0).normal(size=(3, samples, model.nv))
    sd.compile(model, ("aba", "aba_refined", "crba_solve"))
    runs = {method: (lambda method=method: sd.forward_dynamics(model, q, v, tau, method=method)) for method in EVERY}
    sd.set_num_threads(1)
    return {name: 1e9 * t / samples for name, t in interleaved(runs, rounds, 0.05).items()}


def main() -> None:
    """Print the tables."""
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--only", choices=("errors", "many", "costs"))
    parser.add_argument("--states", type=int, default=3000, help="of each shape in the second table")
    parser.add_argument("--json", type=Path, help="written; what is not run is kept")
    chosen = parser.parse_args()
    path: Path | None = chosen.json
    results: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path and path.exists() else {}
    if chosen.only in (None, "errors"):
        print(f"{'worst (median) error of accelerations':40s}" + "".join(f"{name:>19s}" for name in NAMES))
        results["errors"] = {}
        for name, case in cases():
            found = errors(case)
            results["errors"][name] = {"states": case.states, **found}
            cells = [f"{x['worst']:.1e} ({x['median']:.0e})" if (x := found.get(k)) else "" for k in NAMES]
            print(f"{name:40s}" + "".join(f"{c:>19s}" for c in cells), flush=True)
    if chosen.only in (None, "many"):
        names = (*EVERY, "one ulp")
        print(f"{f'{chosen.states} states: worst error (in ulps)':40s}" + "".join(f"{name:>19s}" for name in names))
        results["many"] = {"states": chosen.states, "chains": {}}
        for name, model in of_each_shape():
            found = results["many"]["chains"][name] = many(model, chosen.states)
            cells = [f"{found[k]['worst']:.1e} ({found[k]['in ulps']:.1g})" for k in names]
            print(f"{name:40s}" + "".join(f"{c:>19s}" for c in cells), flush=True)
    if chosen.only in (None, "costs"):
        results["costs"] = costs(chosen.rounds)
        titles = {
            "call": "µs a call, 7 links",
            "batch": "ns a sample of a batch",
            "oblique": "the same, oblique frames",
        }
        for what, words in titles.items():
            found = results["costs"][what]
            cells = [f"{name} {x:.2f} ({x / found['aba']:.2g})" for name, x in found.items()]
            print(f"{words:40s}" + "".join(f"{c:>28s}" for c in cells))
    if path:
        path.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
