"""Whether contact steps converge: what their solver is held to, on many states, beside the quick tests' few.

``python benchmarks/converge.py [--quick] [--only NAME ...]`` prints, for each claim, what is asked and what is found:

* blocks   the impulse of one point against brute force over directions, 10 000 blocks of four kinds
* drops    1000 boxes of 4 and 8 corners dropped at random, μ of 0 to 1.5, restitution of 0 to 0.5
* pushed   a quadruped on its feet, pushed 100 times where friction nearly jams them
* trunks   a quadruped with dry joints that trots, or sinks under its trunk of 1 kg to 1000 t
* hexapod  18 dry joints and six feet: 36 rows that depend on each other, begun from the step before
* limits   a quadruped on dry joints whose motion runs into its joints' limits
* loops    mechanisms with redundant equations: 10 s with every method, 4 s beside an oracle by a pseudo-inverse
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from tables import draw

import spatialdyn as sd

sys.path[:0] = [str(Path(__file__).parents[1] / "tests" / x) for x in ("", "recursions", "constraints", "simulation")]
from grounded import hold, quadruped, stance, trot  # noqa: E402
from test_coulomb_cone import NEAR, blocks, slides_by_angle, solve  # noqa: E402
from test_redundant_loops import PAIRS, REDUNDANT, moves_as_one, runs_on  # noqa: E402

Array = np.ndarray
SOLVED, ABORT = 1e-6, 1e-2  # [m/s | rad/s]
DT = 2e-3
Row = list[str]


def one_point(quick: bool) -> list[Row]:
    """Blocks that are off by more than rounding, of those that slide; and those where sticking was passed over."""
    count, off, slid, missed, worst = (200 if quick else 2500), 0, 0, 0, 0.0
    for kind, seed in (("mild", 1), ("steep", 2), ("rod", 3), ("rod", 4)):
        for B, r, mu in blocks(count, kind, seed):
            (f, sticks, slides), *_ = solve(B, r, mu)
            found, stuck = np.array(f), -np.linalg.solve(B, r)
            missed += bool(not sticks and stuck[0] > 0.0 and np.hypot(*stuck[1:]) < mu * stuck[0])
            if slides and mu > 0.0:
                slid += 1
                near = min((abs(x - found).max() for x in slides_by_angle(B, r, mu)), default=np.inf)
                worst = max(worst, near / abs(found).max())
                off += bool(near > NEAR * abs(found).max())
    return [[f"{4 * count} blocks, {slid} slide", "0 wrong", f"{off} wrong, {missed} should stick, within {worst:.1e}"]]


def body(corners: int) -> sd.Model:
    """A box with its corners."""
    x, y, z = 0.4, 0.3, 0.2
    inertia = np.diag([y * y + z * z, x * x + z * z, x * x + y * y]) / 12.0
    made = sd.ModelBuilder("box").add_body("box", None, "floating", inertia=(1.0, (0, 0, 0), inertia))
    places = [s for s in itertools.product((-0.5, 0.5), repeat=3) if corners == 8 or s[2] < 0.0]
    for k, (a, b, c) in enumerate(places):
        made.add_body(f"c{k}", "box", "fixed", placement=(a * x, b * y, c * z))
    return made.build()


def share(residual: Array) -> str:
    """What a table says of residuals (samples, steps)."""
    aborts = int((residual.max(axis=-1) > ABORT).sum())
    return f"{aborts} aborts of {len(residual)}, {(residual <= SOLVED).mean():.3%} solved, worst {residual.max():.1e}"


def dropped(quick: bool) -> list[Row]:
    """Boxes that fall on corners and edges, turning."""
    rows = []
    pairs = list(itertools.product((0.0, 0.3, 0.8, 1.5), (0.0, 0.25, 0.5)))
    for corners in (4, 8):
        model, rng, found = body(corners), np.random.default_rng(corners), []
        each = 4 if quick else 42
        for mu, e in pairs:
            contacts = sd.Contacts(model, {f"c{k}": 0.0 for k in range(corners)}, friction=mu, restitution=e)
            turns = rng.standard_normal((each, 4))
            q = np.c_[np.zeros((each, 3)), turns / np.linalg.norm(turns, axis=1, keepdims=True)]
            q[:, 2] -= sd.contact_gaps(model, contacts, q).min(axis=1) - 0.05
            v = rng.standard_normal((each, 6)) * np.array([1, 1, 1, 3, 3, 3])
            run = sd.rollout(sd.Scene(model, contacts=contacts), q, v, dt=DT, steps=300, record="contacts", check=False)
            assert run.contacts is not None
            assert np.isfinite(run.q).all()
            found.append(run.contacts.residual)
        rows.append([f"boxes of {corners} corners", "0 aborts, 99.9 %", share(np.concatenate(found))])
    return rows


def pushed(quick: bool) -> list[Row]:
    """σ .3 m/s and .4 rad/s of the trunk at μ = .8."""
    model, feet = quadruped()
    contacts, rng, n = sd.Contacts(model, feet, friction=0.8), np.random.default_rng(3), 16 if quick else 100
    q, v = stance(model, contacts), np.zeros((n, 18))
    v[:, :6] = rng.standard_normal((n, 6)) * np.array([0.3] * 3 + [0.4] * 3)
    scene = sd.Scene(model, contacts=contacts)
    run = sd.rollout(scene, q, v, dt=DT, steps=200, control=hold(model, q), record="contacts", check=False)
    assert run.contacts is not None
    return [["pushed stance", f"0 of {n}", share(run.contacts.residual)]]


def trotting(model: sd.Model, feet: dict[str, float], kp: float, dry: float, steps: int, limits: bool = False) -> Any:
    """Residuals of a trot on dry joints."""
    contacts = sd.Contacts(model, feet, friction=0.8)
    q = stance(model, contacts)
    legs = np.r_[np.zeros(6), np.ones(model.nv - 6)]
    scene = sd.Scene(model, contacts=contacts, friction=sd.Friction(dry * legs, 0.0), limits=limits)
    law = sd.PD(kp * legs, 0.025 * kp * legs, trot(model, q, steps, DT))
    run = sd.rollout(scene, q, np.zeros(model.nv), dt=DT, control=law, record="contacts", check=False)
    assert run.contacts is not None
    return run


def trunks(quick: bool) -> list[Row]:
    """Joints without friction, with that of light legs, and with what just holds the weight; heavy trunks sink, and
    steps count until they meet the ground.
    """
    rows, steps = [], 100 if quick else 200
    for kg, dry in itertools.product((1.0, 1e2, 1e4, 1e6), (0.0, 1.0, 0.2 * 9.81)):
        model, feet = quadruped(kg)
        level = dry if dry <= 1.0 else dry * 0.25 * kg  # what holds a quarter of the weight at .2 m
        run = trotting(model, feet, 80.0, level, steps)
        text = f"trunk of {kg:g} kg, dry joints of {level:.3g} N m" if dry else f"trunk of {kg:g} kg"
        above = np.minimum.accumulate(np.r_[True, run.q[:-1, 2] > 0.0])  # later states are none of a real robot
        rows.append([text, "0 aborts, 99.9 %", share(run.contacts.residual[None, above])])
    return rows


def hexapod() -> tuple[sd.Model, dict[str, float]]:
    """Six legs of three joints."""
    made = sd.ModelBuilder("hexapod", root="trunk")
    made.set_inertia("trunk", (10.0, (0, 0, 0), np.diag([0.1, 0.3, 0.35])))
    for k, (a, b) in enumerate(itertools.product((0.35, 0.0, -0.35), (1, -1))):
        parts = {
            "hip": ("trunk", (1, 0, 0), (a, 0.1 * b, 0)), "thigh": (f"hip{k}", (0, 1, 0), (0, 0.07 * b, 0)),
            "shank": (f"thigh{k}", (0, 1, 0), (0, 0, -0.25)),
        }  # fmt: skip
        for name, (parent, axis, at) in parts.items():
            mass = (0.5, (0, 0, 0 if name == "hip" else -0.1), 2e-3 * np.eye(3))
            made.add_body(f"{name}{k}", parent, "revolute", axis, at, mass)
        made.add_body(f"foot{k}", f"shank{k}", "fixed", placement=(0, 0, -0.25))
    return made.build(root="floating"), {f"foot{k}": 0.02 for k in range(6)}


def six_legs(quick: bool) -> list[Row]:
    """A tripod gait."""
    model, feet = hexapod()
    contacts, steps = sd.Contacts(model, feet, friction=0.8), 200 if quick else 1000
    q, t = sd.neutral(model), DT * np.arange(steps)
    at = {j.name.removesuffix("_joint"): j.idx_q for j in model.joints[1:]}
    for k in range(6):
        q[at[f"thigh{k}"]], q[at[f"shank{k}"]] = 0.7, -1.4
    q[2] += 1.0
    q[2] -= sd.contact_gaps(model, contacts, q).min()
    reference = np.tile(q, (steps, 1))
    for k in range(6):
        phase = 2.0 * np.pi * t / 0.4 + (0.0 if k in (0, 3, 4) else np.pi)
        lift = np.maximum(np.sin(phase), 0.0)
        reference[:, at[f"thigh{k}"]] += 0.3 * lift + 0.1 * np.cos(phase)
        reference[:, at[f"shank{k}"]] -= 0.6 * lift
    legs = np.r_[np.zeros(6), np.ones(18)]
    scene = sd.Scene(model, contacts=contacts, friction=sd.Friction(1.0 * legs, 0.0))
    law = sd.PD(80.0 * legs, 2.0 * legs, reference)
    run = sd.rollout(scene, q, np.zeros(24), dt=DT, control=law, record="contacts", check=False)
    assert run.contacts is not None
    return [["36 redundant rows, from the step before", "99.5 %", share(run.contacts.residual[None])]]


def limited(quick: bool) -> list[Row]:
    """Trots whose knees and thighs are asked to go beyond their limits, with and without dry joints."""
    rows, steps = [], 200 if quick else 1000
    for dry in (0.0, 1.0):
        model, feet = quadruped(limits=0.1)
        run = trotting(model, feet, 80.0, dry, steps, limits=True)
        stops = (run.contacts.stop != 0.0).any(axis=-1).mean()
        text = f"{share(run.contacts.residual[None])}; a joint stops in {stops:.0%} of the steps"
        rows.append([f"limits and {'dry joints' if dry else 'no dry joints'}", "measured", text])
    return rows


def loops(quick: bool) -> list[Row]:
    """Runs that stay closed, by what their energy varies."""
    rows = []
    for name, method in PAIRS[::5] if quick else PAIRS:
        rows.append([f"{name}, {method}", "10 s, closed", tried(runs_on, name, method, 10.0)])
    rows += [
        [f"{name}, rk4", "4 s as the oracle", tried(moves_as_one, name, 4.0)]
        for name in list(REDUNDANT)[: 1 if quick else None]
    ]
    return rows


def tried(check: Any, *given: Any) -> str:
    """What a check finds, or what it raises."""
    try:
        return f"yes, dE {check(*given):.1e} J"
    except (AssertionError, sd.SpatialDynError) as error:
        return f"no: {str(error).splitlines()[0] if str(error) else 'off'}"


CLAIMS = {
    "blocks": one_point, "drops": dropped, "pushed": pushed, "trunks": trunks, "hexapod": six_legs, "limits": limited,
    "loops": loops,
}  # fmt: skip


def main() -> None:
    """Measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer states")
    parser.add_argument("--only", nargs="+", choices=tuple(CLAIMS), default=list(CLAIMS), help="claims to measure")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    sd.set_num_threads(1)
    for name in chosen.only:
        began = time.process_time()
        rows = CLAIMS[name](chosen.quick)
        draw(f"{name}, {time.process_time() - began:.0f} s", ["what", "asked", "found"], rows)


if __name__ == "__main__":
    main()
