"""A quadruped and a humanoid that stand on their feet by a quadratic program, and are pushed.

Learn    sd.WholeBody finds joint torques for a robot whose base has no motor: accelerations and forces of the feet at
         once, within friction, torques and limits, so that the centre of mass and the posture come back.
Look at  the largest impulse in N s that each survives, found by bisection, and three seconds of standing after it.
         Talos weighs 886 N on soles of 20 by 12 cm, which alone hold it: the forces may only push, and their centre
         has to stay under the feet. Where no torque within all limits is left, the smallest relaxation is taken, and it
         has a name.
Needs    pip install example-robot-data daqp
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, picture, start, write
from spatialdyn.model.robot import Link, RobotJoint

DT, START, PUSHED, UP, HALVES = 4e-3, 0.1, 0.1, 0.8, 3  # UP: of its height, below which a robot has fallen
SOLE = ((0.1, 0.06), (0.1, -0.06), (-0.1, 0.06), (-0.1, -0.06))


def talos() -> tuple[sd.Model, dict[str, float], Any]:
    """Talos with a frame at each corner of its soles, its points, and bent knees."""
    robot = sd.load_urdf("talos_reduced", root="floating").robot
    links, joints, points = list(robot.links), list(robot.joints), {}
    for side in ("left", "right"):
        for k, (x, y) in enumerate(SOLE):
            name, X = f"{side}_corner_{k}", np.eye(4)
            X[:2, 3], points[name] = (x, y), 0.0
            links.append(Link(name))
            joints.append(RobotJoint(f"{name}_joint", "fixed", f"{side}_sole_link", name, tuple(X.ravel().tolist())))
    model = sd.assemble(replace(robot, links=tuple(links), joints=tuple(joints)), root="floating")
    q = np.r_[sd.neutral(model)[:7], np.clip(sd.neutral(model)[7:], model.lower[7:] + 0.05, model.upper[7:] - 0.05)]
    for side in ("left", "right"):
        for k, angle in ((3, -0.4), (4, 0.8), (5, -0.4)):
            q[model.joint(f"leg_{side}_{k}_joint").idx_q] = angle
    return model, points, q


def solo() -> tuple[sd.Model, dict[str, float], Any]:
    """Solo12, the spheres of its feet, and bent knees."""
    model = sd.load_urdf("solo12", root="floating")
    q = sd.neutral(model).copy()
    legs = {"FL": 1, "FR": 1, "HL": -1, "HR": -1}
    for leg, bend in legs.items():
        q[model.joint(f"{leg}_HFE").idx_q], q[model.joint(f"{leg}_KFE").idx_q] = 0.7 * bend, -1.4 * bend
    return model, {f"{leg}_FOOT": 0.016 for leg in legs}, q


def standing(robot: tuple[sd.Model, dict[str, float], Any], frame: str) -> tuple[sd.WholeBody, Any, str]:
    """The law by which a robot's centre of mass, frame and posture come back; it on its feet; the frame to push."""
    model, points, q = robot
    contacts = sd.Contacts(model, points, friction=0.7)
    q[2] -= sd.contact_gaps(model, contacts, q).min()
    scene, c = sd.Scene(model, contacts=contacts, friction=False), sd.center_of_mass(model, q)
    base = sd.FrameTask(frame, target=sd.frame_placement(model, q, frame), axes="rxyz", Kp=50.0)
    tasks = [sd.ComTask(c, Kp=30.0, weight=10.0), base, sd.PostureTask(q, Kp=50.0, weight=0.1)]
    return sd.WholeBody(scene, tasks, dt=DT, infeasible="relax"), q, frame


def stand(robot: tuple[sd.WholeBody, Any, str], impulse: float, seconds: float) -> tuple[Any, Any, bool]:
    """Times, the centre of mass's distance from where it was, and whether it stays up, of a robot that is pushed."""
    (body, stance, frame), model = robot, robot[0].model

    def push(t: float, q: Any, v: Any) -> Any:
        return sd.wrench_at(model, q, frame, np.eye(6)[0] * impulse / PUSHED * (START <= t < START + PUSHED))

    try:
        run = sd.simulate(body.scene, stance, np.zeros(model.nv), seconds, DT, torque=body, fext=push, record=5)
    except sd.SpatialDynError:  # a robot on its back, whose feet no torque can hold
        return np.zeros(1), np.ones(1), False
    c, found = sd.center_of_mass(model, stance), sd.center_of_mass(model, run.q)
    return run.t, np.linalg.norm(found - c, axis=1), bool(found[:, 2].min() > UP * c[2])


def largest(robot: tuple[sd.WholeBody, Any, str], impulse: float, seconds: float) -> float:
    """The largest impulse [N s] that it survives, from one that it does: doubled until it falls, then bisected."""
    step = impulse
    while stand(robot, impulse + step, seconds)[2]:
        impulse, step = impulse + step, 2.0 * step
    for _ in range(HALVES):
        step *= 0.5
        if stand(robot, impulse + step, seconds)[2]:
            impulse += step
    return impulse


def main(quick: bool = False, save: str | None = None) -> dict[str, Any]:
    """Print the largest impulse that each robot survives, how far it moves it and where it ends; returns those motions.

    Quick: Solo12 alone, pushed by 1 N s.
    """
    need("daqp", "wbc")
    robots: dict[str, Any] = {"Solo12": (solo, "base_link", 1.0), "Talos": (talos, "torso_2_link", 16.0)}
    found = {}
    for name, (make, frame, impulse) in list(robots.items())[: 1 if quick else 2]:
        robot = standing(make(), frame)
        most = impulse if quick else largest(robot, impulse, 2.1)
        found[name] = most, *stand(robot, most, 1.1 if quick else 3.2)
        off, word = found[name][2], "" if quick else "survives"
        print(f"{name} {word} {most:g} N s: {off.max():.3f} m off its place, {off[-1]:.1e} m at the end")
    if save:
        figure, axes = picture()
        for name, (most, t, off, _) in found.items():
            axes.plot(t, off, label=f"{name}, {most:g} N s")
        axes.set(xlabel="t [s]", ylabel="centre of mass from where it was [m]")
        axes.legend()
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)
