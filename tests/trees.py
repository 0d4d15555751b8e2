"""Two models by hand, and seeded random trees, each as the oracle's ``dense.Tree`` and as a ``ModelBuilder``'s robot.

The library orders joints depth first, children in byte order of joint name. Joints are called j0001, j0002, ... in
the order in which they are made, and a new one hangs on the last or on one of its ancestors: that numbering is depth
first, so body i of the tree is joint i of the model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from dense import NV, Array, Body, Tree, pose, rotation_of

from spatialdyn.model import Model
from spatialdyn.model.builder import ModelBuilder

KINDS = ("revolute", "continuous", "prismatic", "spherical", "floating", "planar")
SCREWS = (*KINDS, *("helical",) * len(KINDS))  # half of them helical; KINDS stays, for it is what seeds draw from
AXES = np.vstack([np.eye(3), -np.eye(3)])


class State(NamedTuple):
    """A random state: q (nq,), v (nv,), a (nv,), tau (nv,), fext (njoints, 6)."""

    q: Array
    v: Array
    a: Array
    tau: Array
    fext: Array


@dataclass(frozen=True)
class RandomTree:
    """One random robot, for the oracle (``tree``) and for the library (``model``)."""

    tree: Tree
    builder: ModelBuilder
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def model(self) -> Any:
        """The library's Model, built when asked for."""
        return self.builder.build(**self.options)


def random_unit(rng: np.random.Generator, n: int) -> Array:
    """A unit vector (n,), uniform on the sphere."""
    u = rng.normal(size=n)
    return np.asarray(u / np.linalg.norm(u))


def random_rotation(rng: np.random.Generator) -> Array:
    """A rotation (3, 3), uniform."""
    return rotation_of(random_unit(rng, 4))


def random_axis(rng: np.random.Generator) -> Array:
    """A unit vector (3,), one time in three along a coordinate axis."""
    return AXES[rng.integers(6)].copy() if rng.random() < 1 / 3 else random_unit(rng, 3)


def random_placement(rng: np.random.Generator) -> Array:
    """A pose (4, 4), one time in four without rotation, one time in eight without offset."""
    R = np.eye(3) if rng.random() < 1 / 4 else random_rotation(rng)
    return pose(R, np.zeros(3) if rng.random() < 1 / 8 else rng.uniform(-0.5, 0.5, size=3))


def of_points(masses: Array, points: Array) -> tuple[float, Array, Array]:
    """Mass, com (3,) and inertia (3, 3) about the com of point masses (n,) at points (n, 3)."""
    mass = masses.sum()
    com = masses @ points / mass
    arms = points - com
    second = (arms * masses[:, None]).T @ arms
    return float(mass), com, np.trace(second) * np.eye(3) - second


def random_inertia(rng: np.random.Generator) -> tuple[float, Array, Array]:
    """Mass, com (3,) and inertia (3, 3) about the com of six random point masses."""
    points = rng.uniform(-0.3, 0.3, size=(6, 3)) + rng.uniform(-0.2, 0.2, size=3)
    return of_points(rng.uniform(0.1, 1.0, size=6), points)


def merged(a: tuple[float, Array, Array], b: tuple[float, Array, Array], T: Array) -> tuple[float, Array, Array]:
    """Inertia of bodies a and b made one, in the frame of a; T is the pose (4, 4) of b's frame in a's."""
    parts = [a, (b[0], T[:3, :3] @ b[1] + T[:3, 3], T[:3, :3] @ b[2] @ T[:3, :3].T)]
    mass = a[0] + b[0]
    com = sum(m * c for m, c, _ in parts) / mass
    inertia = np.zeros((3, 3))
    for m, c, about_c in parts:
        arm = c - com
        inertia += about_c + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, np.asarray(com), 0.5 * (inertia + inertia.T)


def random_tree(
    seed: int,
    n_joints: int,
    kinds: Sequence[str] = KINDS,
    floating: bool = False,
    continuous: str = "angle",
    branching: float = 0.3,
    armature: bool = True,
    fixed: bool = True,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
) -> RandomTree:
    """A random tree of ``n_joints`` moving joints besides the floating root.

    kinds       the library's joint types, drawn evenly
    floating    the root link is a body with a free-flyer (``root="floating"``), number 1
    continuous  "angle" or "cos_sin", the layout of continuous and planar joints
    branching   chance that a body hangs higher than on the one before it
    armature    half of the joints have one
    fixed       a quarter of the bodies are two links joined by a fixed joint, which carries what comes after
    gravity     (3,) [m/s²]
    """
    rng = np.random.default_rng(seed)
    builder = ModelBuilder(f"random{seed}", root="b0000")
    cs = {"angle": "", "cos_sin": "_cs"}[continuous]
    dense_kind = {"continuous": "revolute" if continuous == "angle" else "continuous_cs", "planar": f"planar{cs}"}
    bodies: list[Body] = []
    # per body: the link on which children hang, its pose in the body, and its ancestors, itself the last
    ends: list[tuple[str, Array]] = [("b0000", np.eye(4))]
    line = [0]
    inertia = random_inertia(rng)
    builder.set_inertia("b0000", inertia)  # on a fixed root it counts nowhere
    if floating:
        bodies.append(Body(0, "floating", mass=inertia[0], com=inertia[1], inertia=inertia[2]))
        ends.append(("b0000", np.eye(4)))
        line.append(1)
    for _ in range(n_joints):
        number = len(bodies) + 1
        while len(line) > 1 + floating and rng.random() < branching:
            line.pop()
        parent = line[-1]
        link, at = ends[parent]
        kind = str(rng.choice(list(kinds)))
        axis, placement, inertia = random_axis(rng), random_placement(rng), random_inertia(rng)
        rotor = float(rng.uniform(0.01, 0.5)) if armature and rng.random() < 0.5 else 0.0
        pitch = float(rng.normal(scale=0.5)) if kind == "helical" else 0.0
        name, joint = f"b{number:04d}", f"j{number:04d}"
        builder.add_body(name, link, kind, axis, placement, inertia, joint_name=joint, armature=rotor, pitch=pitch)
        end = (name, np.eye(4))
        if fixed and rng.random() < 0.25:
            T, further = random_placement(rng), random_inertia(rng)
            tip = f"{name}_tip"
            builder.add_body(tip, name, "fixed", placement=T, inertia=further, joint_name=f"j{number:04d}_tip")
            inertia, end = merged(inertia, further, T), (tip, T)
        bodies.append(Body(parent, dense_kind.get(kind, kind), axis, at @ placement, *inertia, rotor, pitch))
        ends.append(end)
        line.append(number)
    options = dict(root="floating" if floating else "fixed", gravity=tuple(gravity), continuous=continuous)
    return RandomTree(Tree(tuple(bodies), tuple(gravity)), builder, options)


def tree_case(seed: int, floating: bool) -> tuple[RandomTree, Any, State]:
    """A random tree, its model and a state; half the joints of seed 3 are helical, odd seeds have (cos, sin) pairs.

    With a fifth joint that of seed 1 would be too large for programs, and its table kernels take seconds to compile.
    """
    kinds = SCREWS if seed == 3 else KINDS
    made = random_tree(seed, 4 if seed == 1 else 6, kinds, floating, "cos_sin" if seed % 2 else "angle")
    return made, made.model, random_state(made.tree, np.random.default_rng(seed))


def random_state(tree: Tree, rng: np.random.Generator) -> State:
    """Uniform rotations and angles, the rest normal; the forces on the bodies about as large as their weights."""
    q: list[float] = []
    for body in tree.bodies:
        angle = rng.uniform(-np.pi, np.pi)
        pair = [np.cos(angle), np.sin(angle)]
        place = rng.normal(size=3)
        quaternion = random_unit(rng, 4)
        q += {
            "revolute": [angle],
            "prismatic": [place[0]],
            "helical": [angle],
            "continuous_cs": pair,
            "spherical": [*quaternion],
            "floating": [*place, *quaternion],
            "planar": [*place[:2], angle],
            "planar_cs": [*place[:2], *pair],
        }[body.kind]
    nv = sum(NV[body.kind] for body in tree.bodies)
    v, a, tau = rng.normal(size=(3, nv))
    return State(np.array(q, float), v, a, 10.0 * tau, 10.0 * rng.normal(size=(tree.njoints, 6)))


def pendulum(**options: Any) -> Model:
    """A point mass of 1 kg on a rod of 1 m that turns about y."""
    builder = ModelBuilder("pendulum")
    builder.add_body("rod", axis=(0, 1, 0), inertia=(1.0, (0.0, 0.0, -1.0), np.zeros((3, 3))), **options)
    return builder.build()


def every_joint(continuous: str = "angle") -> Model:
    """One joint of every kind."""
    builder = ModelBuilder("all")
    parent = None
    for k, kind in enumerate(("floating", "revolute", "continuous", "prismatic", "spherical", "planar")):
        name = f"b{k}"
        builder.add_body(
            name, parent, kind, (1, 2, 2), (0.1, 0.2, 0.3), (1.0, (0.1, 0.0, 0.2), 0.1 * np.eye(3)), kind,
            limits=(-0.25, 0.75) if kind in ("revolute", "prismatic") else (-math.inf, math.inf),
        )  # fmt: skip
        parent = name
    return builder.build(continuous=continuous)
