"""Robots on the ground for tests, and the law of contact by dense matrices and positions of frames."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from dense import Array
from scipy.linalg import expm

import spatialdyn as sd
from spatialdyn.recursions.coordinates.coordinate_rates import add_begun

G = 9.81
DT = 1e-3
RISING = max(5.0 * DT, 1e-2)  # [s] in which a depth would be left at the speed of its first step


def mass(slope: float = 0.0, kg: float = 1.0) -> sd.Model:
    """A point mass without rotation; gravity leans by the slope, so that the plane z = 0 falls towards x."""
    made = sd.ModelBuilder("mass")
    made.add_body("x", None, "prismatic", (1, 0, 0)).add_body("y", "x", "prismatic", (0, 1, 0))
    made.add_body("z", "y", "prismatic", (0, 0, 1), inertia=(kg, (0, 0, 0), 0.1 * np.eye(3)))
    return made.build(gravity=(G * math.sin(slope), 0.0, -G * math.cos(slope)))


def box(slope: float = 0.0, size: tuple[float, float, float] = (0.4, 0.3, 0.2)) -> tuple[sd.Model, list[str]]:
    """A box of 1 kg and the names of its four lower corners."""
    x, y, z = size
    made = sd.ModelBuilder("box")
    inertia = np.diag([y * y + z * z, x * x + z * z, x * x + y * y]) / 12.0
    made.add_body("box", None, "floating", inertia=(1.0, (0, 0, 0), inertia))
    names = []
    for k, (a, b) in enumerate(itertools.product((-1, 1), repeat=2)):
        names.append(f"corner{k}")
        made.add_body(names[-1], "box", "fixed", placement=(0.5 * a * x, 0.5 * b * y, -0.5 * z))
    return made.build(gravity=(G * math.sin(slope), 0.0, -G * math.cos(slope))), names


def about(x: float, by: float, most: float) -> tuple[float, float]:
    """Limits about a position, at most ±most."""
    return max(x - by, -most), min(x + by, most)


def quadruped(trunk: float = 8.0, limits: float = math.inf) -> tuple[sd.Model, dict[str, float]]:
    """A quadruped of 13 kg that is symmetric in x and in y, and the radii of its feet.

    limits  of its thighs and knees, about their stance; by default wide ones
    """
    made = sd.ModelBuilder("quadruped", root="trunk")
    made.set_inertia("trunk", (trunk, (0, 0, 0), trunk / 8.0 * np.diag([0.06, 0.2, 0.24])))
    for name, a, b in (("lf", 1, 1), ("lh", -1, 1), ("rf", 1, -1), ("rh", -1, -1)):
        hip, thigh, shank = (f"{name}_{part}" for part in ("hip", "thigh", "shank"))
        at = {"hip": (0.25 * a, 0.1 * b, 0), "thigh": (0, 0.07 * b, 0), "shank": (0, 0, -0.25)}
        made.add_body(hip, "trunk", "revolute", (1, 0, 0), at["hip"], (0.5, (0, 0, 0), 1e-3 * np.eye(3)))
        made.add_body(
            thigh, hip, "revolute", (0, 1, 0), at["thigh"], (0.6, (0, 0, -0.1), np.diag([4e-3, 4e-3, 6e-4])),
            limits=about(0.7 * a, limits, 1.5),
        )  # fmt: skip
        made.add_body(
            shank, thigh, "revolute", (0, 1, 0), at["shank"], (0.15, (0, 0, -0.1), np.diag([1e-3, 1e-3, 1e-4])),
            limits=about(-1.4 * a, limits, 2.5),
        )  # fmt: skip
        made.add_body(f"{name}_foot", shank, "fixed", placement=(0, 0, -0.25))
    return made.build(root="floating"), {f"{name}_foot": 0.02 for name in ("lf", "lh", "rf", "rh")}


def stance(model: sd.Model, contacts: sd.Contacts) -> Array:
    """The quadruped on its feet, knees inward."""
    q = sd.neutral(model)
    for joint in model.joints[2:]:
        front = 1.0 if joint.name[1] == "f" else -1.0
        q[joint.idx_q] = front * {"hip": 0.0, "thigh": 0.7, "shank": -1.4}[joint.name.split("_")[1]]
    q[2] += 1.0
    q[2] -= sd.contact_gaps(model, contacts, q).min()
    return q


def hold(model: sd.Model, q: Array, reference: Array | None = None) -> sd.PD:
    """A stiff control law of all joints but the base, to a configuration or a reference (steps, nq)."""
    kp, kd = np.full(model.nv, 80.0), np.full(model.nv, 2.0)
    kp[:6] = kd[:6] = 0.0
    return sd.PD(kp, kd, q if reference is None else reference)


def trot(model: sd.Model, q: Array, steps: int, dt: float, period: float = 0.4) -> Array:
    """References (steps, nq) of a trot from a stance: diagonal legs lift in turn."""
    found, t = np.tile(q, (steps, 1)), dt * np.arange(steps)
    for joint in model.joints[2:]:
        leg, part = joint.name.split("_")[:2]
        front = 1.0 if leg[1] == "f" else -1.0
        phase = 2.0 * math.pi * t / period + (0.0 if leg in ("lf", "rh") else math.pi)
        lift = np.maximum(np.sin(phase), 0.0)
        found[:, joint.idx_q] += {
            "hip": 0.0 * t, "thigh": 0.3 * front * lift + 0.1 * np.cos(phase), "shank": -0.6 * front * lift,
        }[part]  # fmt: skip
    return found


def jacobian(contacts: sd.Contacts, q: Array) -> Array:
    """J (k, 3, nv) of the lowest points, in the world's axes, by frame Jacobians."""
    model, rows = contacts.model, []
    normal = np.array(contacts.terrain.normal)
    for name, radius in zip(contacts.names, contacts.radii, strict=True):
        J = sd.frame_jacobian(model, q, name, "local_world_aligned")
        rows.append(J[:3] + np.cross(J[3:], -radius * normal, axis=0))
    return np.array(rows).reshape((-1, 3, model.nv))


def in_first_axes(model: sd.Model, after: Array, v: Array, dt: float) -> tuple[Array, Array]:
    """Velocities after a step in the axes at its beginning, and what a step adds to v there without any force.

    Floating and planar joints turn by dt ω of the velocities after it; of free bodies, the form that keeps momenta.
    """
    x, d = after.copy(), np.zeros(model.nv)
    for joint in model.joints[1:]:
        k = joint.idx_v
        if joint.kind == "floating":
            x[k : k + 3] = expm(dt * np.cross(np.eye(3), after[k + 3 : k + 6])) @ after[k : k + 3]
        elif joint.kind == "planar":
            c, s = math.cos(dt * after[k + 2]), math.sin(dt * after[k + 2])
            x[k : k + 2] = np.array([[c, -s], [s, c]]) @ after[k : k + 2]
    add_begun(model.bodies, dt, v, d)
    return x, d


def off_the_law(contacts: sd.Contacts, q: Array, v: Array, tau: Array, dt: float, step: Any) -> float:
    """By how much a step misses the equation of motion, Signorini's condition and Coulomb's law, without restitution.

    In m/s and rad/s: impulses are compared times the inverse inertia that each point feels.
    """
    model = contacts.model
    M, bias, J = sd.crba(model, q), sd.nonlinear_effects(model, q, v), jacobian(contacts, q)
    normal = np.array(contacts.terrain.normal)
    x, begun = in_first_axes(model, step.v, v, dt)
    momentum = M @ (x - v - begun) - dt * (tau - bias) - np.einsum("kin,ki->n", J, step.impulse)
    worst = abs(np.linalg.solve(M, momentum)).max()
    centres = [sd.frame_placement(model, q, name)[:3, 3] for name in contacts.names]
    for k, (centre, mu) in enumerate(zip(centres, contacts.friction, strict=True)):
        gap = float(centre @ normal) - contacts.terrain.height - contacts.radii[k]
        u, f = J[k] @ x, step.impulse[k]
        scale = float(normal @ J[k] @ np.linalg.solve(M, J[k].T) @ normal)
        fn, un = float(f @ normal), float(u @ normal) + (gap / dt if gap > 0.0 else gap / max(5.0 * dt, 1e-2))
        ft, ut = f - fn * normal, u - float(u @ normal) * normal
        slides = float(np.linalg.norm(ut))
        most = mu * fn
        along = ft + (most * ut / slides if slides > 1e-9 else 0.0 * ut)
        beyond = max(float(np.linalg.norm(ft)) - most, 0.0)
        terms = [
            abs(gap - step.gap[k]), abs(min(scale * fn, un)), scale * beyond,
            scale * float(np.linalg.norm(along)) * (slides > 1e-9),
        ]  # fmt: skip
        worst = max(worst, *terms)
    return float(worst)
