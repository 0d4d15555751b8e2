"""Forward dynamics by every method: its digits on chains of unequal links, beside Pinocchio and MuJoCo, and its cost.

``python benchmarks/forward.py`` prints the largest forward error max|a - a*| / max|a*| over a few random chains and
states of each kind, a* by ABA in 240 bits on the doubles of our model, then the time of a call. Joints turn about
coordinate axes and frames are shifted, not turned, so that all three libraries hold the same numbers, except that
MuJoCo turns inertias to their principal axes.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pinocchio as pin
from measure import interleaved

import spatialdyn as sd
from spatialdyn.forward import METHODS

SEEDS = range(3)
AXES = np.eye(3)
SPATIAL, PLANAR = 3, 1  # how many of the last axes joints turn about


class Case(NamedTuple):
    """A kind of chain: what it is called, the masses of its links, and about which axes its joints turn."""

    name: str
    masses: tuple[float, ...]
    kind: int = SPATIAL


CASES = (
    *(Case(f"7 links, tip 1e{k}", (1.0,) * 6 + (10.0**k,)) for k in (0, 3, 6, 9, 12)),
    *(Case(f"7 links, planar, tip 1e{k}", (1.0,) * 6 + (10.0**k,), PLANAR) for k in (3, 6, 9, 12)),
    *(Case(f"7 links, tip 1e-{k}", (1.0,) * 6 + (10.0**-k,)) for k in (6, 12)),
    Case("7 links, middle 1e-12", (1.0,) * 3 + (1e-12,) + (1.0,) * 3),
    Case("7 links, middle 1e12", (1.0,) * 3 + (1e12,) + (1.0,) * 3),
    *(Case(f"{n} links", (1.0,) * n) for n in (10, 100)),
    *(Case(f"{n} links, planar", (1.0,) * n, PLANAR) for n in (10, 100)),
)


class Body(NamedTuple):
    """A link: the axis of its joint, where that sits on the last one, its mass, com (3,) and inertia (3, 3) there."""

    axis: Any
    place: Any
    mass: float
    com: Any
    inertia: Any


def bodies(case: Case, seed: int) -> list[Body]:
    """Links of random shape."""
    rng, made = np.random.default_rng(seed), []
    for mass in case.masses:
        points, weights = rng.uniform(-0.3, 0.3, size=(6, 3)), rng.uniform(0.1, 1.0, size=6)
        points, weights = points + rng.uniform(-0.2, 0.2, size=3), weights / weights.sum()
        com = weights @ points
        second = ((points - com) * weights[:, None]).T @ (points - com)
        axis = AXES[2 - rng.integers(case.kind)]
        made.append(Body(axis, rng.uniform(-0.5, 0.5, 3), mass, com, mass * (np.trace(second) * np.eye(3) - second)))
    return made


def ours(chain: list[Body]) -> sd.Model:
    """As a Model."""
    builder = sd.ModelBuilder("chain")
    for k, b in enumerate(chain):
        parent = f"b{k - 1:03d}" if k else None
        builder.add_body(f"b{k:03d}", parent, "revolute", b.axis, b.place, (b.mass, b.com, b.inertia))
    return builder.build()


def with_pinocchio(chain: list[Body]) -> Callable[[Any, Any, Any], Any]:
    """Its ABA of that chain."""
    model, joint = pin.Model(), 0
    for k, b in enumerate(chain):
        made = pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ()
        joint = model.addJoint(joint, made[int(np.argmax(b.axis))], pin.SE3(np.eye(3), b.place), f"b{k:03d}")
        model.appendBodyToJoint(joint, pin.Inertia(b.mass, b.com, b.inertia), pin.SE3.Identity())
    data = model.createData()
    return lambda q, v, tau: pin.aba(model, data, q, v, tau)


def with_mujoco(chain: list[Body]) -> Callable[[Any, Any, Any], Any]:
    """Its forward dynamics of that chain, through M."""
    text = ['<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"/><worldbody>']
    for b in chain:
        I = b.inertia
        full = words([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]])
        text.append(
            f'<body pos="{words(b.place)}"><joint type="hinge" axis="{words(b.axis)}"/>'
            f'<inertial pos="{words(b.com)}" mass="{b.mass!r}" fullinertia="{full}"/>'
        )
    text.append("</body>" * len(chain) + "</worldbody></mujoco>")
    model = mujoco.MjModel.from_xml_string("".join(text))
    data = mujoco.MjData(model)

    def run(q: Any, v: Any, tau: Any) -> Any:
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, v, tau
        mujoco.mj_forward(model, data)
        return data.qacc.copy()

    return run


def words(numbers: Any) -> str:
    """To the last digit."""
    return " ".join(repr(float(x)) for x in numbers)


def ways(chain: list[Body], model: sd.Model) -> dict[str, Callable[..., Any]]:
    """Every way to the accelerations."""
    made: dict[str, Callable[..., Any]] = {
        method: lambda q, v, tau, method=method: sd.forward_dynamics(model, q, v, tau, method=method)
        for method in METHODS
    }
    for name, build in (("pin.aba", with_pinocchio), ("MuJoCo", with_mujoco)):
        try:
            made[name] = build(chain)
        except ValueError as error:  # MuJoCo's compiler has bounds on inertias
            made[name] = refusing(error)
    return made


def refusing(error: ValueError) -> Callable[..., Any]:
    """What stands for a library that does not take a chain."""

    def run(*arguments: Any) -> Any:
        raise error

    return run


def state(n: int, seed: int) -> tuple[Any, Any, Any]:
    """Random q, v, tau."""
    rng = np.random.default_rng(100 + seed)
    v, tau = rng.normal(size=(2, n))
    return rng.uniform(-3.0, 3.0, n), v, tau


def errors(case: Case) -> dict[str, float]:
    """The largest error of every way; NaN for one that refused."""
    worst: dict[str, float] = {}
    for seed in SEEDS:
        chain = bodies(case, seed)
        model = ours(chain)
        given = state(model.nv, seed)
        truth = sd.exact(model, sd.aba)(*given).astype(float)
        for name, run in ways(chain, model).items():
            try:
                error = float(abs(run(*given) - truth).max() / abs(truth).max())
            except ValueError:
                error = np.nan
            worst[name] = float(np.maximum(worst.get(name, 0.0), error))
    return worst


def times(rounds: int) -> dict[str, float]:
    """Microseconds of a call from Python on 7 links."""
    chain = bodies(CASES[0], 0)
    model = ours(chain)
    given = state(model.nv, 0)
    runs = {name: (lambda run=run: run(*given)) for name, run in ways(chain, model).items()}
    return {name: 1e6 * t for name, t in interleaved(runs, rounds, 0.02).items()}


def batch_times(rounds: int, samples: int = 4096) -> dict[str, float]:
    """Nanoseconds of a sample of a batch of 7 links, one thread."""
    model = ours(bodies(CASES[0], 0))
    q, v, tau = np.random.default_rng(0).normal(size=(3, samples, model.nv))
    runs = {method: (lambda method=method: sd.forward_dynamics(model, q, v, tau, method=method)) for method in METHODS}
    return {name: 1e9 * t / samples for name, t in interleaved(runs, rounds, 0.05).items()}


def main() -> int:
    """Print the tables; ``--rounds N`` for the timing."""
    rounds = int(sys.argv[sys.argv.index("--rounds") + 1]) if "--rounds" in sys.argv else 15
    names = [*METHODS, "pin.aba", "MuJoCo"]
    print(f"{'forward error':26}", *(f"{name:>12}" for name in names))
    for case in CASES:
        found = errors(case)
        print(f"{case.name:26}", *(f"{found[name]:12.0e}" for name in names), flush=True)
    call, batch = times(rounds), batch_times(rounds)
    print(f"{'µs a call, 7 links':26}", *(f"{call[name]:12.2f}" for name in names))
    print(f"{'ns a sample of a batch':26}", *(f"{batch[name]:12.1f}" for name in METHODS))
    return 0


if __name__ == "__main__":
    sys.exit(main())
