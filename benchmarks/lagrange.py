"""Coriolis matrices, derivatives, rollouts and simulations against their peers, correctness asserted first.

    python benchmarks/lagrange.py [--quick]

Prints tables and, unless --quick, writes lagrange.json beside this file. Needs
``pip install ".[validate,bench]"``.
"""

from __future__ import annotations

import argparse
import json
import warnings
from pathlib import Path
from typing import Any

import machine
import mujoco
import mujoco.rollout
import numpy as np
import pinocchio as pin
from cases import Case, aligned, case
from contestants import mujoco_model
from measure import interleaved
from tables import draw

import spatialdyn as sd

HERE = Path(__file__).parent
CLOSE = 1e-10  # of the largest entry
SAMPLES, STATES, STEPS, DT = 8192, 1024, 200, 1e-3
FEWER = 2048  # of three matrices per sample
CHECKED = 500  # compared steps of a simulation
ROBOTS = ("ur5", "panda", "talos_full")
DERIVATIVES = {
    "rnea_derivatives": ("qva", pin.computeRNEADerivatives),
    "aba_derivatives": ("qvt", pin.computeABADerivatives),
}


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer rounds, nothing written")
    quick = parser.parse_args().quick
    rounds, seconds = (3, 0.01) if quick else (15, 0.1)
    results: dict[str, Any] = {"machine": machine.machine(), "samples": SAMPLES, "states": STATES, "steps": STEPS}
    results["coriolis"] = {name: coriolis(case(name, SAMPLES), rounds, seconds) for name in ROBOTS}
    results["derivatives"] = {
        f"{name} {call}": derivatives(case(name, FEWER), call, rounds, seconds)
        for name in ROBOTS
        for call in DERIVATIVES
    }
    results["rollout"] = {method: rollout(case("panda", STATES), method, rounds) for method in INTEGRATORS}
    results["simulate"] = simulate(case("panda", 8), rounds)
    show(results)
    if not quick:
        text = json.dumps(results, indent=1) + "\n"
        (HERE / "lagrange.json").write_text(text, encoding="utf-8")


def same(ours: Any, theirs: Any, what: str) -> None:
    """Raise AssertionError before timing unless results are equal."""
    error = abs(np.asarray(ours) - theirs).max() / max(1.0, abs(np.asarray(theirs)).max())
    if not error <= CLOSE:
        raise SystemExit(f"{what}: differs by {error:.1e} of its largest entry, expected {CLOSE:.0e}")


def coriolis(robot: Case, rounds: int, seconds: float) -> dict[str, Any]:
    """C of a batch against a loop over Pinocchio; Γ and dM/dq, which Pinocchio has not."""
    model, theirs, data = robot.ours, robot.theirs, robot.theirs.createData()
    q, v = robot.state["q"], robot.state["v"]
    out = np.empty((len(q), model.nv, model.nv))
    part = list(zip(q[:256], v[:256], strict=True))
    sd.compile(model, (sd.coriolis_matrix, sd.christoffel_symbols, sd.mass_matrix_derivatives))  # else interpreted

    def loop() -> None:
        for x, y in part:
            pin.computeCoriolisMatrix(theirs, data, x, y)

    sd.coriolis_matrix(model, q, v, out=out)
    for k in range(0, 256, 16):
        same(out[k], pin.computeCoriolisMatrix(theirs, data, q[k], v[k]), f"C of {robot.name}")
    times = interleaved(
        {
            "ours": lambda: sd.coriolis_matrix(model, q, v, out=out),
            "pin": loop,
            "symbols": lambda: sd.christoffel_symbols(model, q[0]),
            "derivatives": lambda: sd.mass_matrix_derivatives(model, q[0]),
        },
        rounds,
        seconds,
    )
    ours, peer = times["ours"] / len(q) * 1e9, times["pin"] / len(part) * 1e9
    written = model.nv**2 * 8 / ours
    return {
        "ours_ns": ours, "pin_ns": peer, "ratio": peer / ours,
        "bytes_per_ns": written, "share_of_stores": written / max(machine.stores().values()),
        "christoffel_us": times["symbols"] * 1e6, "derivatives_us": times["derivatives"] * 1e6,
    }  # fmt: skip


def derivatives(robot: Case, call: str, rounds: int, seconds: float) -> dict[str, Any]:
    """A batch against a loop over Pinocchio, which gives the same three matrices; and one sample against one."""
    letters, peer = DERIVATIVES[call]
    model, theirs, data, function = robot.ours, robot.theirs, robot.theirs.createData(), getattr(sd, call)
    given = [robot.state[letter] for letter in letters]
    one, out = [x[0] for x in given], aligned((len(given[0]), 3, model.nv, model.nv))
    part = list(zip(*(x[:256] for x in given), strict=True))
    sd.compile(model, (function,))  # else what is timed may be interpreted

    def loop() -> None:
        for x in part:
            peer(theirs, data, *x)

    function(model, *given, out=out)
    for k in range(0, 256, 16):
        for mine, his in zip(out[k], peer(theirs, data, *part[k]), strict=True):
            same(mine, his, f"{call} of {robot.name}")
    times = interleaved(
        {
            "ours": lambda: function(model, *given, out=out),
            "pin": loop,
            "ours_one": lambda: function(model, *one),
            "pin_one": lambda: peer(theirs, data, *one),
        },
        rounds,
        seconds,
    )
    ours, his = times["ours"] / len(out) * 1e9, times["pin"] / len(part) * 1e9
    written = 3 * model.nv**2 * 8 / ours
    return {
        "ours_ns": ours, "pin_ns": his, "ratio": his / ours, "bytes_per_ns": written,
        "share_of_stores": written / max(machine.stores().values()),
        "ours_us": times["ours_one"] * 1e6, "pin_us": times["pin_one"] * 1e6,
    }  # fmt: skip


INTEGRATORS = {
    "semi_implicit_euler": mujoco.mjtIntegrator.mjINT_EULER,
    "rk4": mujoco.mjtIntegrator.mjINT_RK4,
}


def rollout(robot: Case, method: str, rounds: int) -> dict[str, Any]:
    """Steps of many states, each with its torques, on one thread, against MuJoCo: no contacts, limits, damping."""
    model, q, v = robot.ours, robot.state["q"], 0.1 * robot.state["v"]
    tau = np.random.default_rng(7).standard_normal((len(q), STEPS, model.nv))
    theirs = mujoco_model(robot.theirs)
    theirs.opt.timestep, theirs.opt.integrator = DT, INTEGRATORS[method]
    data = mujoco.MjData(theirs)
    state = np.concatenate([np.zeros((len(q), 1)), q, v], 1)
    held = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)

    def peer() -> Any:
        return mujoco.rollout.rollout(theirs, data, state, tau, control_spec=held, skip_checks=False)[0]

    def ours() -> sd.Rollout:
        return sd.rollout(sd.Scene(model, friction=False), q, v, tau, dt=DT, method=method)

    same(ours().q[:, :50], peer()[:, :50, 1 : 1 + model.nq], f"rollout by {method}")
    times = interleaved({"ours": ours, "mujoco": peer}, rounds, 0.2)
    rate = {name: len(q) * STEPS / seconds for name, seconds in times.items()}
    return {"ours_per_s": rate["ours"], "mujoco_per_s": rate["mujoco"], "ratio": rate["ours"] / rate["mujoco"]}


def simulate(robot: Case, rounds: int) -> dict[str, Any]:
    """One robot by RK4 against a Python loop over Pinocchio."""
    model, theirs, data = robot.ours, robot.theirs, robot.theirs.createData()
    q0, v0, tau, steps = robot.state["q"][0], np.zeros(model.nv), np.zeros(model.nv), 5000

    def loop(steps: int = steps) -> Any:
        q, v, h = q0.copy(), v0.copy(), DT
        for _ in range(steps):
            a1 = pin.aba(theirs, data, q, v, tau).copy()
            v2 = v + 0.5 * h * a1
            a2 = pin.aba(theirs, data, pin.integrate(theirs, q, 0.5 * h * v), v2, tau).copy()
            v3 = v + 0.5 * h * a2
            a3 = pin.aba(theirs, data, pin.integrate(theirs, q, 0.5 * h * v2), v3, tau).copy()
            v4 = v + h * a3
            a4 = pin.aba(theirs, data, pin.integrate(theirs, q, h * v3), v4, tau).copy()
            q = pin.integrate(theirs, q, h / 6.0 * (v + 2.0 * (v2 + v3) + v4))
            v = v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        return q

    def ours() -> sd.Trajectory:
        warnings.simplefilter("ignore")  # that simulate ignores damping, as Pinocchio does
        return sd.simulate(model, q0, v0, steps * DT, DT, method="rk4", record=CHECKED)

    same(ours().q[1], loop(CHECKED), "simulate by rk4")  # a falling arm amplifies rounding later
    times = interleaved({"ours": ours, "pin": loop}, rounds, 0.1)
    return {name + "_us": t / steps * 1e6 for name, t in times.items()} | {"ratio": times["pin"] / times["ours"]}


def show(results: dict[str, Any]) -> None:
    """The tables."""
    rows = []
    for name, c in results["coriolis"].items():
        rates = [f"{c['bytes_per_ns']:.1f}", f"{c['share_of_stores']:.0%}"]
        own = [f"{c['christoffel_us']:.1f}", f"{c['derivatives_us']:.1f}"]
        rows.append([name, f"{c['ours_ns']:.0f}", f"{c['pin_ns']:.0f}", f"{c['ratio']:.1f}", *rates, *own])
    headings = ["robot", "C, ns", "pinocchio", "ratio", "stored, B/ns", "of the limit", "Γ, µs", "dM/dq, µs"]
    draw("Coriolis matrix, batch of 8192 on one thread; Γ and dM/dq of one sample", headings, rows)
    rows = []
    for name, c in results["derivatives"].items():
        rates = [f"{c['bytes_per_ns']:.1f}", f"{c['share_of_stores']:.0%}"]
        single = [f"{c['ours_us']:.1f}", f"{c['pin_us']:.1f}"]
        rows.append([name, f"{c['ours_ns']:.0f}", f"{c['pin_ns']:.0f}", f"{c['ratio']:.1f}", *rates, *single])
    headings = ["robot, call", "ns", "pinocchio", "ratio", "stored, B/ns", "of the limit", "one, µs", "pinocchio, µs"]
    draw(f"Derivatives, batch of {FEWER} on one thread; and one sample", headings, rows)
    rows = [
        [name, f"{r['ours_per_s'] / 1e6:.2f}", f"{r['mujoco_per_s'] / 1e6:.3f}", f"{r['ratio']:.1f}"]
        for name, r in results["rollout"].items()
    ]
    draw(
        "rollout of panda, 1024 x 200 steps on one thread, million steps a second",
        ["method", "sd", "mujoco", "ratio"],
        rows,
    )
    s = results["simulate"]
    row = [f"{s['ours_us']:.2f}", f"{s['pin_us']:.2f}", f"{s['ratio']:.1f}"]
    draw("one panda by rk4, µs a step", ["sd", "loop over pinocchio", "ratio"], [row])


if __name__ == "__main__":
    main()
