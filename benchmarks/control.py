"""Cost of control: laws against their RNEA, closed loops against open ones, inverse kinematics; one thread.

    python benchmarks/control.py [--quick]

Every law's torques are asserted equal to its line with M, C and g formed, every closed loop to its torques fed to
single steps, and every pose that is reached to forward kinematics, before anything is measured. Needs
``pip install ".[validate,bench]"``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np
from measure import interleaved
from tables import draw

import spatialdyn as sd

Array = np.ndarray
ROBOTS = ("two_link", "ur5", "panda")
STATES, STEPS, DT = 1024, 50, 1e-3
CALLED = 32768  # states of a call of a law, around which Python takes some 10 µs
POSES, ALL_POSES = 1024, 10_000
CLOSE = 1e-9  # relative, of torques by two formulas; M is multiplied out in one of them
REACHED = 1e-8  # [rad, m]


def laws_on(model: sd.Model, path: Any) -> dict[str, sd.Control]:
    """The laws, by name, along a path or to a goal, as stiff in every joint as its inertia allows."""
    Kp, Kd, inertia = 40.0, 12.0, np.diagonal(sd.crba(model, sd.neutral(model)))
    return {
        "Gravity": sd.Gravity(), "PDGravity": sd.PDGravity(Kp * inertia, Kd * inertia, path),
        "PDPlus": sd.PDPlus(Kp * inertia, Kd * inertia, path), "ComputedTorque": sd.ComputedTorque(Kp, Kd, path),
        "Passivity": sd.Passivity(Kp / Kd, Kd * inertia, path),
    }  # fmt: skip


def lines(model: sd.Model, q: Array, v: Array, at: sd.PathPoint) -> dict[str, Array]:
    """The torques by M, C and g."""
    M, C, g = sd.crba(model, q), sd.coriolis_matrix(model, q, v), sd.generalized_gravity(model, q)
    e, de, inertia = at.q - q, at.v - v, np.diagonal(sd.crba(model, sd.neutral(model)))
    w, a = at.v + 40.0 / 12.0 * e, at.a + 40.0 / 12.0 * de
    return {
        "Gravity": g, "PDGravity": g + inertia * (40.0 * e - 12.0 * v),
        "PDPlus": M @ at.a + C @ at.v + g + inertia * (40.0 * e + 12.0 * de),
        "ComputedTorque": M @ (at.a + 40.0 * e + 12.0 * de) + C @ v + g,
        "Passivity": M @ a + C @ w + g - 12.0 * inertia * (v - w),
    }  # fmt: skip


def check(model: sd.Model, path: sd.Path, q: Array, v: Array) -> float:
    """The largest relative difference of laws and loops from what is formed by hand; AssertionError beyond CLOSE."""
    worst = 0.0
    for name, law in laws_on(model, path).items():
        found = law(model, 0.3, q[:100], v[:100])
        for k in range(0, 100, 10):
            wanted = lines(model, q[k], v[k], path(0.3))[name]
            worst = max(worst, float(abs(found[k] - wanted).max() / max(1.0, abs(wanted).max())))
        run = sd.rollout(sd.Scene(model, friction=False), q[:9], v[:9], dt=DT, steps=3, control=law)
        x, w = q[0], v[0]
        for k in range(3):
            x, w = sd.step(model, x, w, law(model, k * DT, x, w), DT)
        worst = max(worst, float(abs(run.v[0, -1] - w).max() / max(1.0, abs(w).max())))
    assert worst < CLOSE, worst
    return worst


def costs(model: sd.Model, q: Array, v: Array, rounds: int, seconds: float) -> dict[str, float]:
    """Nanoseconds of a law, of RNEA, and of steps of closed and open loops."""
    several, moving = (np.tile(x, (CALLED // STATES, 1)) for x in (q, v))
    a = np.random.default_rng(2).normal(size=moving.shape)
    goal = 0.5 * (q[0] + q[1])
    paths: dict[str, Any] = {
        "goal": goal, "quintic": sd.quintic(q[0], goal, 1.0, limits=False),
        "spline": sd.spline(np.linspace(0.0, 1.0, 12), np.linspace(q[0], goal, 12), limits=False),
    }  # fmt: skip
    ways: dict[str, Callable[[], Any]] = {
        "RNEA": lambda: sd.rnea(model, several, moving, a), "g(q)": lambda: sd.generalized_gravity(model, several),
        "modified RNEA": lambda: sd.modified_rnea(model, several, moving, a, a),
    }  # fmt: skip
    for name, law in laws_on(model, goal).items():
        ways[f"{name} called"] = lambda law=law: law(model, 0.0, several, moving)
    few, scene = STATES * STEPS, sd.Scene(model, friction=False)
    tau = np.zeros((STEPS, model.nv))

    def loop(law: sd.Control | None) -> Callable[[], Any]:
        asked: dict[str, Any] = {"tau": tau} if law is None else {"steps": STEPS, "control": law}
        return lambda: sd.rollout(scene, q, v, dt=DT, record="last", **asked)

    ways["open loop"] = loop(None)
    for kind, path in paths.items():
        for name, law in laws_on(model, path).items():
            if kind == "goal" or name not in ("Gravity", "PDGravity"):
                ways[f"{name} to a {kind}"] = loop(law)
    times = interleaved(ways, rounds, seconds)
    return {name: 1e9 * x / (few if "loop" in name or " to a " in name else CALLED) for name, x in times.items()}


def reach(rounds: int, seconds: float) -> list[list[str]]:
    """Rows of inverse kinematics: poses, from where, share that is reached, milliseconds."""
    rows = []
    for name, frame in (("ur5", "tool0"), ("panda", "panda_hand")):
        model = sd.load_urdf(name)
        whole = sd.frame_placement(model, sd.random_configuration(model, 5, (ALL_POSES,)), frame)
        for begin, starts in (("the middle", None), ("anywhere", sd.random_configuration(model, 6, (ALL_POSES,)))):
            found = sd.solve_ik(model, {frame: whole}, starts, restarts=20)
            off = sd.frame_placement(model, found.q, frame) - whole
            assert (np.linalg.norm(off[found.converged, :3, 3], axis=-1) < 2.0 * REACHED).all()
            assert (abs(off[found.converged]) < 2.0 * REACHED).all()
            assert ((found.q >= model.lower) & (found.q <= model.upper)).all()
            poses, q0 = whole[:POSES], None if starts is None else starts[:POSES]
            ways = {name: lambda m=model, f=frame, p=poses, s=q0: sd.solve_ik(m, {f: p}, s)}
            took = interleaved(ways, rounds, seconds)[name]
            rows.append([name, begin, f"{found.converged.mean():.2%}", f"{1e3 * took:.1f}"])
    return rows


def main() -> None:
    """Check, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer rounds")
    parser.add_argument("--robot", choices=ROBOTS, help="one robot alone")
    asked = parser.parse_args()
    rounds, seconds = (3, 0.02) if asked.quick else (15, 0.1)
    sd.set_num_threads(1)
    called, closed = [], []
    for name in [asked.robot] if asked.robot else ROBOTS:
        model = sd.load_urdf(name)
        draws = np.random.default_rng(1)
        q, v = sd.random_configuration(model, 1, (STATES,)), 0.3 * draws.normal(size=(STATES, model.nv))
        worst = check(model, sd.quintic(q[0], 0.5 * (q[0] + q[1]), 1.0, limits=False), q, v)
        ns = costs(model, q, v, rounds, seconds)
        of = {"Gravity": "g(q)", "PDGravity": "g(q)", "ComputedTorque": "RNEA"}
        for law in laws_on(model, q[0]):
            mine, base = ns[f"{law} called"], ns[of.get(law, "modified RNEA")]
            called.append([name, law, f"{mine:.0f}", f"{base:.0f}", f"{mine / base:.2f}", f"{worst:.0e}"])
            for kind in ("goal", "quintic", "spline"):
                if f"{law} to a {kind}" in ns:
                    own, free = ns[f"{law} to a {kind}"], ns["open loop"]
                    closed.append([name, law, kind, f"{own:.0f}", f"{free:.0f}", f"{own / free:.2f}"])
    draw("laws, a call of a batch, ns", ["robot", "law", "law", "its RNEA", "ratio", "worst error"], called)
    draw("loops, a step, ns", ["robot", "law", "reference", "closed", "open", "ratio"], closed)
    if not asked.robot:
        share, time = f"of {ALL_POSES} reached within 20 restarts", f"ms for {POSES} poses"
        draw("inverse kinematics", ["robot", "from", share, time], reach(rounds, seconds))


if __name__ == "__main__":
    main()
