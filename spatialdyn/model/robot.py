"""The checked robot: links and joints by name, before merging, ordering and tabulation.

``urdf.load_urdf`` makes one from a file, ``ModelBuilder`` from calls; ``model.assemble`` makes it a Model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..bodies.kinds import CODES, kind_of

Array = NDArray[np.float64]

JOINT_KINDS = ("fixed", *CODES)
WITH_AXIS = tuple(word for word in CODES if kind_of(word).axis)


@dataclass(frozen=True)
class Link:
    """A rigid body: mass [kg], com (3,) [m] and inertia (3, 3) about the com [kg m²], all in the link's frame."""

    name: str
    mass: float = 0.0
    com: tuple[float, ...] = (0.0, 0.0, 0.0)
    inertia: tuple[float, ...] = (0.0,) * 9


@dataclass(frozen=True)
class Mimic:
    """q = multiplier · q(leader) + offset."""

    leader: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class JointLimits:
    """What bounds a joint, of every coordinate: positions, and the velocity and effort of its drive, both ways.

    lower, upper  positions [rad | m]
    velocity      largest speed [rad/s | m/s]
    effort        largest torque or force [N m | N]

    >>> import spatialdyn as sd
    >>> builder = sd.ModelBuilder("arm").add_body("rod", limits=sd.JointLimits(-1.0, 2.0, effort=30.0))
    >>> builder.build().effort_limit
    array([30.])
    """

    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf


@dataclass(frozen=True)
class Rotor:
    """The rotor of a joint's motor, which turns on the link before the joint at ``ratio`` times the joint's velocity.

    inertia  J about the axis on which it turns [kg m²]; the parent link's inertia has to include the locked rotor: its
             mass, and its inertia with J about the axis
    ratio    n: its velocity relative to that link over q̇, of either sign [1 | rad/m]
    axis     (3,) on which it turns, in the joint's frame at q = 0, which the parent link carries: of any length but 0;
             the joint's own axis if left out

    It adds n² J to the diagonal of M, as an armature does, and couples the link with the joint through n J, which an
    armature leaves out: about 1/n of the rotor's effect.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link").with_(rotors={"joint2": sd.Rotor(1e-3, ratio=6.0)})
    >>> model.armature
    array([0.   , 0.036])
    """

    inertia: float
    ratio: float
    axis: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Spring:
    """The spring between a rotor, whose joint has it, and the joint that it drives, both of one coordinate.

    joint      name of the joint that it drives
    stiffness  k at that joint [N m/rad | N/m]
    damping    d at that joint [N m s/rad | N s/m]
    ratio      n: turns of the rotor per unit of the joint, of either sign [1 | rad/m]
    """

    joint: str
    stiffness: float
    damping: float = 0.0
    ratio: float = 1.0


@dataclass(frozen=True)
class RobotJoint:
    """A joint from link ``parent`` to link ``child``.

    placement  (16,)  pose of the joint, and of the child's frame at q = 0, in the parent link, row-major
    axis       (3,)   unit vector in the joint's frame: axis of rotation or translation, normal of a plane
    lower, upper      position limits [rad | m], infinite where there are none (joints of one freedom)
    velocity, effort  limits [rad/s | m/s], [N m | N]
    damping, friction act in simulations that ask for it (``Friction.of``), and on no other result
    armature          reflected rotor inertia [kg m² | kg] of every freedom of the joint, or one for each. It is added
                      to the diagonal of M and nothing else, as in Pinocchio. C has no part of it, so on a floating or
                      planar joint, whose frame rotates, M v does not change as a true rotor's momentum does
    pitch             travel of a helical joint along its axis per radian [m/rad]; 0 for all others
    rotor             of a joint of one freedom: the exact form of its armature, which is then n² J
    shared            (name, inertia) of the joint right before it whose motors it shares, and what they have off the
                      diagonal of M between the two: see ``Transmission``
    spring            of a rotor that is a joint of its own: what drives another joint, in simulations
    """

    name: str
    kind: str
    parent: str
    child: str
    placement: tuple[float, ...]
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf
    damping: float = 0.0
    friction: float = 0.0
    armature: float | tuple[float, ...] = 0.0
    mimic: Mimic | None = None
    pitch: float = 0.0
    rotor: Rotor | None = None
    shared: tuple[str, float] | None = None
    spring: Spring | None = None


@dataclass(frozen=True)
class Robot:
    """Links and joints that form a tree with one root.

    notes    oddities of the source
    source   absolute path of the URDF that it was read from, empty if from none: meshes are looked for there. Robots
             that differ in notes and source alone are equal
    ordered  children are in the order of ``joints``, not in byte order of their names
    declared what the source declares beside bodies and joints, as JSON: "scene", options of a Scene as ``from_toml``
             has them, and "transmission"; empty if nothing. ``Scene.of`` and ``read_transmissions`` read it. It does
             not count for equality either
    """

    name: str
    root: str
    links: tuple[Link, ...]
    joints: tuple[RobotJoint, ...]
    notes: tuple[str, ...] = field(default=(), compare=False)
    ordered: bool = False
    source: str = field(default="", compare=False, repr=False)
    declared: str = field(default="", compare=False, repr=False)

    @property
    def children(self) -> dict[str, list[RobotJoint]]:
        """{link: joints to its children}, in the order of the walk: byte order of the joints' names."""
        table: dict[str, list[RobotJoint]] = {link.name: [] for link in self.links}
        for joint in self.joints if self.ordered else sorted(self.joints, key=lambda j: j.name.encode()):
            table[joint.parent].append(joint)
        return table
