"""Cost of tasks: the inertia of a frame, torques of tasks, laws that adapt or yield, and whole bodies; one thread.

    python benchmarks/tasks.py [--quick]

Every Λ⁻¹ is asserted equal to J M⁻¹ Jᵀ, every task met, and every whole body's answer equal to another solver's, before
anything is measured. Needs ``pip install ".[validate,bench,wbc]" quadprog``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from time import process_time
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.pushed_while_standing import talos
from spatialdyn.operational.quadratic import EQUAL, raw

Array = np.ndarray
BATCH = 8192
INTERPRETED = 60_000  # calls after which a program of 17 000 lines is compiled
CLOSE = 1e-10  # relative, of two ways to M⁻¹
SAME = 1e-5  # of accelerations [m/s²] between solvers


def least(function: Callable[[], Any], count: int, rounds: int) -> float:
    """Least processor time of a call [s], of some rounds of ``count`` calls each."""
    best = np.inf
    for _ in range(rounds):
        begin = process_time()
        for _ in range(count):
            function()
        best = min(best, (process_time() - begin) / count)
    return best


def inertia(name: str, frame: str, rounds: int) -> None:
    """Λ⁻¹ of a frame in a batch and in a call, beside aba."""
    model, rng = sd.load_urdf(name), np.random.default_rng(0)
    q = sd.random_configuration(model, rng, (BATCH,))
    out, v, a = np.empty((BATCH, 6, 6)), rng.normal(size=(BATCH, model.nv)), np.empty((BATCH, model.nv))
    sd.compile(model, [sd.operational_space_inertia_inverse, sd.aba], frame=frame)
    found, J = sd.operational_space_inertia_inverse(model, q, frame, out=out), sd.frame_jacobian(model, q, frame)
    wanted = J @ sd.minverse(model, q) @ J.swapaxes(1, 2)
    assert abs(found - wanted).max() <= CLOSE * abs(wanted).max()
    lanes = least(lambda: sd.operational_space_inertia_inverse(model, q, frame, out=out), 1, 10 * rounds) / BATCH
    forward = least(lambda: sd.aba(model, q, v, v, out=a), 1, 10 * rounds) / BATCH
    one = q[0].copy()
    single = least(lambda: sd.operational_space_inertia_inverse(model, one, frame), 1000, rounds)
    print(f"{name:8} Λ⁻¹ {lanes * 1e9:6.1f} ns a sample (aba {forward * 1e9:.1f}), {single * 1e6:.2f} µs a call")


def torques(rounds: int) -> None:
    """Two tasks and a posture of a Panda, and the dynamics of its hand."""
    model, rng = sd.load_urdf("panda"), np.random.default_rng(0)
    q, v = sd.random_configuration(model, rng), rng.normal(size=model.nv)
    tasks = [sd.FrameTask("panda_hand", acceleration=rng.normal(size=3), axes=x, name=x) for x in ("xyz", "rxyz")]
    found = sd.task_torque(model, q, v, tasks, v)
    assert max(abs(x).max() for x in found.missed) < 1e-9
    both = least(lambda: sd.task_torque(model, q, v, tasks, v), 50, rounds)
    space = least(lambda: sd.operational_space(model, q, v, "panda_hand"), 50, rounds)
    print(f"panda    two tasks and a posture {both * 1e6:.0f} µs, operational_space {space * 1e6:.0f} µs")


def laws(rounds: int) -> None:
    """Closed loops of laws on lanes, against the open loop."""
    model, n, steps = sd.load_urdf("ur5").reduced(lock=["wrist_3_joint"]), 1024, 20
    rng, pi = np.random.default_rng(0), sd.inertial_parameters(model)
    q, v = 0.3 * rng.normal(size=(n, model.nv)) + [0.1, -1.0, 1.2, 0.3, 0.5], np.zeros((n, model.nv))
    X, goal = sd.frame_placement(model, q[0], "wrist_2_link"), np.array([0.1, -1.0, 1.2, 0.3, 0.5])
    known: dict[str, sd.Control | None] = {
        "open loop": None,
        "Impedance": sd.Impedance(model, "wrist_2_link", X, 100.0, 20.0),
        "SlotineLi": sd.SlotineLi(model, 5.0, 5.0, goal, 0.8 * pi, 0.1),
        "NaturalAdaptation": sd.NaturalAdaptation(model, 5.0, 5.0, goal, 0.8 * pi, 10.0),
    }
    for name, law in known.items():

        def run(law: Any = law) -> Any:
            return sd.rollout(model, q, v, dt=1e-3, steps=steps, control=law, record="last", check=False)

        first, again = run(), run()
        assert (first.q == again.q).all()
        print(f"ur5 of 5 {name:18} {least(run, 1, rounds) / (n * steps) * 1e9:7.1f} ns a step")


def bodies(rounds: int) -> None:
    """A QP of Talos on two feet: assembly and solution."""
    model, points, q = talos()
    contacts = sd.Contacts(model, points, friction=0.7)
    q[2] -= sd.contact_gaps(model, contacts, q).min()
    v, c = np.zeros(model.nv), sd.center_of_mass(model, q)
    body = sd.WholeBody(sd.Scene(model, contacts=contacts), [sd.ComTask(c), sd.PostureTask(q, weight=0.1)])
    found = body.solve(q, v)
    other = sd.WholeBody(body.scene, body.tasks, solver="quadprog").solve(q, v)
    assert abs(found.a - other.a).max() < SAME
    weight = 9.81 * model.total_mass
    assert abs(found.forces[:, 2].sum() - weight) < 1e-6 * weight

    for _ in range(INTERPRETED):
        body.program(q, v)
    program = body.program(q, v)
    whole = least(lambda: body.solve(q, v), 50, rounds)
    put, solved = least(lambda: body.program(q, v), 50, rounds), least(lambda: raw("daqp", program), 50, rounds)
    print(
        f"talos    {len(program.g)} variables, {len(program.rows)} rows, {(program.sense == EQUAL).sum()} of them "
        f"equations: assembly {put * 1e6:.0f} µs, daqp {solved * 1e6:.0f} µs, whole call {whole * 1e6:.0f} µs"
    )


def main() -> None:
    """Check and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer rounds")
    rounds = 3 if parser.parse_args().quick else 20
    sd.set_num_threads(1)
    for name, frame in (("ur5", "tool0"), ("panda", "panda_hand")):
        inertia(name, frame, rounds)
    torques(rounds)
    laws(rounds)
    bodies(rounds)


if __name__ == "__main__":
    main()
