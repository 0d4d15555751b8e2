"""A spinning rotor on a leg: what the armature on the diagonal of M leaves out, for gears of 6 to 37.

Learn    sd.Rotor(inertia, ratio, axis) on a joint: n² J on the diagonal of M, as an armature, and n J of its angular
         momentum on the link that carries the motor. In every call, at the cost of one vector a joint.
Look at  the share of the rotors' own effect that the diagonal alone misses: 1/n, times a number of the motion. It is
         small behind a gear of 37 and a good part behind one of 6, as legs with quasi-direct drives have. A rotor that
         is a body of its own, tied to its joint by a mimic, gives the same numbers.
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write

REFLECTED = 0.072  # n² J of each rotor [kg m²]: 2e-3 behind a gear of 6, 5e-5 behind one of 37


def leg(ratio: float, rotors: str) -> sd.Model:
    """A trunk on a free base and a leg of three joints, its rotors "none", "diagonal", "exact" or "bodies"."""
    J = REFLECTED / ratio**2
    b = sd.ModelBuilder("leg", root="trunk").set_inertia("trunk", (8.0, (0, 0, 0), np.diag([0.1, 0.3, 0.3])))
    joints = {"hip": ((1, 0, 0), (0.2, 0.1, 0)), "thigh": ((0, 1, 0), (0, 0.1, 0)), "shank": ((0, 1, 0), (0, 0, -0.3))}
    parent = "trunk"
    for name, (axis, at) in joints.items():
        turning = {"leader": name, "multiplier": ratio} if rotors == "bodies" else None
        motor = (0.3, (0, 0, 0), J * (0.5 * np.eye(3) + 0.5 * np.outer(axis, axis)))
        kind = "continuous" if rotors == "bodies" else "fixed"
        b.add_body(f"{name}_motor", parent, kind, axis, at, motor, mimic=turning)  # its mass, turning or not
        exact, armature = sd.Rotor(J, ratio) if rotors == "exact" else None, REFLECTED * (rotors == "diagonal")
        own = (1.0, (0, 0, -0.15), np.diag([0.01, 0.01, 0.001]))
        b.add_body(name, parent, "revolute", axis, at, own, name, armature=armature, rotor=exact)
        parent = name
    return b.build(root="floating", mimic=rotors == "bodies")


def main(quick: bool = False, save: str | None = None) -> dict[float, dict[str, float]]:
    """Print the errors of random motions; returns them by ratio: "rotors", "tau", "a" and "bodies"."""
    rng, samples = np.random.default_rng(0), 100 if quick else 2000
    found: dict[float, dict[str, float]] = {}
    print(f"{'ratio':>5} {'of the rotors':>14} {'of torques':>11} {'of accelerations':>17} {'exact - bodies':>15}")
    for n in (6.0, 7.0, 8.0, 9.0, 10.0, 37.0):
        models = {rotors: leg(n, rotors) for rotors in ("none", "diagonal", "exact", "bodies")}
        q = sd.random_configuration(models["none"], rng, samples)
        v, a = rng.normal(size=(2, samples, 9)) * np.r_[np.ones(6), 6.0 * np.ones(3)]
        tau = {rotors: sd.rnea(model, q, v, a)[:, 6:] for rotors, model in models.items()}
        bias = tau["exact"] - tau["none"]
        off, size = np.linalg.norm(tau["diagonal"] - tau["exact"]), np.linalg.norm(tau["exact"])
        push = np.pad(tau["exact"], ((0, 0), (6, 0)))
        qdd = {rotors: sd.aba(models[rotors], q, v, push) for rotors in ("diagonal", "exact")}
        found[n] = {
            "rotors": float(off / np.linalg.norm(bias)),
            "tau": float(off / size),
            "a": float(np.linalg.norm(qdd["diagonal"] - qdd["exact"]) / np.linalg.norm(qdd["exact"])),
            "bodies": float(np.linalg.norm(tau["bodies"] - tau["exact"]) / size),
        }
        x = found[n]
        print(f"{n:5.0f} {x['rotors']:14.2%} {x['tau']:11.2%} {x['a']:17.2%} {x['bodies']:15.1e}")
    if save:
        figure, axes = picture()
        axes.loglog(list(found), [x["rotors"] for x in found.values()], "o-", label="of the rotors' effect")
        axes.loglog(list(found), [x["a"] for x in found.values()], "o-", label="of the accelerations")
        axes.set(xlabel="gear ratio n", ylabel="left out by the diagonal", title="Rotors of a leg in random motions")
        axes.legend()
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
