"""Robots that stand: a box on its corners, and Talos on the corners of its soles."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.model.robot import Link, RobotJoint

Array = np.ndarray


@cache
def box() -> tuple[sd.Model, sd.Scene, Any]:
    """A box with an arm, and the configuration in which it stands on four corners."""
    solid = (5.0, (0, 0, 0), 0.05 * np.eye(3))
    b = sd.ModelBuilder("box", "world").add_body("box", None, "floating", inertia=solid)
    for k, (x, y) in enumerate(((0.1, 0.1), (0.1, -0.1), (-0.1, 0.1), (-0.1, -0.1))):
        b.add_body(f"corner{k}", "box", "fixed", placement=(x, y, -0.1))
    link, limits = (1.0, (0.0, 0, 0.1), 0.01 * np.eye(3)), sd.JointLimits(-1.0, 1.0, 3.0, 20.0)
    b.add_body("upper", "box", "revolute", (0, 1, 0), (0, 0, 0.1), link, "shoulder", limits=limits)
    b.add_body("fore", "upper", "revolute", (1, 0, 0), (0, 0, 0.2), link, "elbow", limits=limits)
    model = b.build()
    contacts = sd.Contacts(model, {f"corner{k}": 0.0 for k in range(4)}, friction=0.6)
    q = sd.neutral(model).copy()
    q[2] = 0.1
    return model, sd.Scene(model, contacts=contacts), q


@cache
def talos() -> tuple[sd.Model, sd.Scene, Any]:
    """Talos with frames at the corners of its soles, and a configuration with bent knees."""
    robot = sd.load_urdf("talos_reduced", root="floating").robot
    links, joints, names = list(robot.links), list(robot.joints), []
    for side in ("left", "right"):
        for k, (x, y) in enumerate(((0.1, 0.06), (0.1, -0.06), (-0.1, 0.06), (-0.1, -0.06))):
            names.append(f"{side}_corner_{k}")
            links.append(Link(names[-1]))
            X = np.eye(4)
            X[:2, 3] = x, y
            joints.append(
                RobotJoint(f"{names[-1]}_joint", "fixed", f"{side}_sole_link", names[-1], tuple(X.ravel().tolist()))
            )
    model = sd.assemble(replace(robot, links=tuple(links), joints=tuple(joints)), root="floating")
    contacts = sd.Contacts(model, dict.fromkeys(names, 0.0), friction=0.7)
    q = sd.neutral(model).copy()
    q[7:] = np.clip(q[7:], model.lower[7:] + 0.05, model.upper[7:] - 0.05)
    for side in ("left", "right"):
        for k, angle in ((3, -0.4), (4, 0.8), (5, -0.4)):
            q[model.joint(f"leg_{side}_{k}_joint").idx_q] = angle
    q[2] -= sd.contact_gaps(model, contacts, q).min()
    return model, sd.Scene(model, contacts=contacts), q


@cache
def gripper(mimic: bool = True) -> tuple[sd.Model, sd.Scene, Any]:
    """The box on its corners, with an arm of two fingers: the second follows the first and carries a ball."""
    limits = sd.JointLimits(-1.0, 1.0, 3.0, 20.0)
    b = sd.ModelBuilder("gripper", "world").add_body(
        "box", None, "floating", inertia=(5.0, (0, 0, 0), 0.05 * np.eye(3))
    )
    for k, (x, y) in enumerate(((0.1, 0.1), (0.1, -0.1), (-0.1, 0.1), (-0.1, -0.1))):
        b.add_body(f"corner{k}", "box", "fixed", placement=(x, y, -0.1))
    finger = (0.4, (0.02, 0.01, 0.1), 0.01 * np.eye(3))
    b.add_body("upper", "box", "revolute", (0, 1, 0), (0, 0, 0.1), finger, "shoulder", limits=limits)
    b.add_body("first", "upper", "revolute", (1, 0, 0), (0, 0.1, 0.2), finger, "first", limits=limits)
    follow = {"leader": "first", "multiplier": -0.8, "offset": 0.1}
    slower = sd.JointLimits(-0.3, 1.0, 2.0, 20.0)
    b.add_body("second", "upper", "revolute", (1, 0, 0), (0, -0.1, 0.2), finger, "second", slower, mimic=follow)
    b.add_body("ball", "second", "revolute", (0, 1, 0), (0, 0, 0.2), finger, "wrist", limits=limits)
    model = b.build(mimic=mimic)
    contacts = sd.Contacts(model, {f"corner{k}": 0.0 for k in range(4)}, friction=0.6)
    q = sd.neutral(model).copy()
    q[2] = 0.1
    if not mimic:
        q[model.joint("second").idx_q] = 0.1
    return model, sd.Scene(model, contacts=contacts), q
