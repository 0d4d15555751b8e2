"""``to_mjcf``: a model's robot as MJCF, which MuJoCo compiles to the same equation of motion."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import check_model
from ..errors import SpatialDynError, literal
from ..model.assembly import IDENTITY, ROOT_JOINT
from ..model.model import Model
from ..model.physical_inertia import parallel_axis
from ..model.robot import Link, Robot, RobotJoint
from ..model.robot_checks import quoted
from ..waiting import watch
from .to_urdf import NO_TEXT, numbers

Array = NDArray[np.float64]
TYPES = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "spherical": "ball", "floating": "free"}
WORLD = "world"
LEAST = 1e-15  # mjMINVAL, below which MuJoCo treats a mass or moment as zero


class Placed(NamedTuple):
    """A joint of a body, and its place in the body's frame at q = 0."""

    joint: RobotJoint
    X: Array


def to_mjcf(model: Model) -> str:
    """The robot of a model as the text of an MJCF file: bodies, inertias, joints, mimic joints as equalities.

    model  Model, of a fixed or a floating root

    MuJoCo compiles it to the same M, bias and forward dynamics, to rounding, with qpos and qvel in the order of q and
    v: ``to_mujoco`` converts states. Joints have damping, friction, ranges, efforts (``actuatorfrcrange``) and
    armatures; a link without mass between two joints becomes a second joint of the next body. There are no shapes, so
    no contacts, and no actuators. MJCF has no velocity limits: they are left out with a UserWarning.

    Links that are fixed together keep their own inertias; if MuJoCo would refuse one of them (a point mass, or a moving
    link without mass), the moving link gets the sum. If the sum is no valid inertia, such as a point mass that moves,
    MuJoCo refuses it by name when it compiles the text.

    Raises  SpatialDynError naming the joint for parts that MJCF lacks: planar and helical joints, rotors, motors that
            joints share, springs, a floating joint that is not in the world at the identity, an armature on a floating
            joint, or one that differs between freedoms; and for names that XML cannot hold, or a link "world" that is
            not the root

    >>> import spatialdyn as sd
    >>> print(to_mjcf(sd.load_urdf("two_link")).splitlines()[0])
    <mujoco model="two_link">
    """
    robot, options = check_model(model).robot, model.options
    floats = options.root == "floating"
    for joint in robot.joints:
        _refuse(joint, robot.root)
    for what in (robot.name, *(x.name for x in robot.links), *(x.name for x in robot.joints)):
        if NO_TEXT.search(what):
            raise SpatialDynError(f"{literal(what)} has a character that XML cannot hold, expected a name without it")
    links, children = {x.name: x for x in robot.links}, robot.children
    solid = _solid(robot)
    if WORLD in links and (robot.root != WORLD or floats or links[WORLD].mass):
        raise SpatialDynError(
            'link "world" is not a fixed root without mass, expected one, or another name: MJCF has it'
        )
    fast = [j.name for j in robot.joints if math.isfinite(j.velocity) and j.kind != "fixed"]
    if fast:
        warnings.warn(f"velocity limits of joints {quoted(fast, 4)} are left out: MJCF has none", stacklevel=2)
    lines = [
        f"<mujoco model={quoteattr(robot.name)}>",
        '  <compiler angle="radian" autolimits="true" inertiafromgeom="false"/>',
        f'  <option gravity="{numbers(options.gravity)}"/>',
        "  <worldbody>",
    ]
    base = np.reshape(options.base, (4, 4))
    first = [Placed(RobotJoint(ROOT_JOINT, "floating", "", robot.root, IDENTITY), np.eye(4))] if floats else []
    # still to write: a link with its place and joints, or the line that closes a body
    stack: list[tuple[str, Array, list[Placed]] | str] = [(robot.root, base, first)]
    with watch.call("to_mjcf"):
        while stack:
            item = stack.pop()
            if isinstance(item, str):
                lines.append(item)
                continue
            name, X, joints = item
            if joints and (behind := _goes_on(links[name], joints, children[name])) is not None:
                Y = np.reshape(behind.placement, (4, 4))
                back = np.linalg.inv(Y)
                earlier = [Placed(x.joint, back @ x.X) for x in joints]
                stack.append((behind.child, X @ Y, [*earlier, Placed(behind, np.eye(4))]))
                continue
            pad = "    "
            if name != WORLD:
                lines.append(
                    f'{pad}<body name={quoteattr(name)} pos="{numbers(X[:3, 3])}" quat="{numbers(_quaternion(X))}">'
                )
                lines += [pad + "  " + x for x in (*_inertial(solid[name]), *map(_joint, joints))]
                stack.append(f"{pad}</body>")
            for joint in reversed(children[name]):
                made = [] if joint.kind == "fixed" else [Placed(joint, np.eye(4))]
                stack.append((joint.child, np.reshape(joint.placement, (4, 4)), made))
    lines.append("  </worldbody>")
    moves = {j.name for j in robot.joints if j.kind != "fixed"}
    followers = [j for j in robot.joints if j.mimic is not None and {j.name, j.mimic.leader} <= moves]
    if followers:
        lines += ["  <equality>", *map(_equality, followers), "  </equality>"]
    return "\n".join([*lines, "</mujoco>", ""])


def _refuse(joint: RobotJoint, root: str) -> None:
    """Raise SpatialDynError for a joint that MJCF cannot hold."""
    what = ""
    if joint.kind != "fixed" and joint.kind not in TYPES:
        what = f"is {joint.kind}"
    elif joint.spring is not None:
        what = f'is a rotor behind the spring of "{joint.spring.joint}"'
    elif joint.shared is not None:
        what = f'shares motors with "{joint.shared[0]}"'
    elif joint.rotor is not None:
        what = "has a rotor"
    elif isinstance(joint.armature, tuple) and len({*joint.armature}) > 1:
        what = f"has armatures {joint.armature}"
    elif joint.kind == "floating" and np.any(joint.armature):
        what = f"is floating and has armature {joint.armature}, along the body's axes"
    elif joint.kind == "floating" and (joint.parent != root or joint.placement != IDENTITY):
        what = "is floating and not at the identity of the root link"
    if what:
        raise SpatialDynError(f'joint "{joint.name}" {what}, which MJCF cannot hold')


def _goes_on(link: Link, joints: list[Placed], children: list[RobotJoint]) -> RobotJoint | None:
    """The only joint behind a link without inertia, so that both become one body; None for another link."""
    bare = not _has_inertia(link)
    plain = len(children) == 1 and children[0].kind not in ("fixed", "floating")
    return children[0] if bare and plain and joints[0].joint.kind != "floating" else None


def _solid(robot: Robot) -> dict[str, Link]:
    """The links by name; a rigid body is summed up in its moving link if MuJoCo would refuse one of its links."""
    links, children, made = {x.name: x for x in robot.links}, robot.children, {}
    for moving in [robot.root, *(j.child for j in robot.joints if j.kind != "fixed")]:
        body = [(moving, np.eye(4))]
        for name, X in body:  # grows during the loop
            body += [(j.child, X @ np.reshape(j.placement, (4, 4))) for j in children[name] if j.kind == "fixed"]
        parts = [(links[name], X) for name, X in body]
        heavy = any(_has_inertia(x) for x, _ in parts)
        if heavy and not (_has_inertia(links[moving]) and all(_accepted(x) for x, _ in parts if _has_inertia(x))):
            made.update({x.name: Link(x.name) for x, _ in parts})
            made[moving] = _sum(moving, parts)
        else:
            made.update({x.name: x for x, _ in parts})
    return made


def _has_inertia(link: Link) -> bool:
    return bool(link.mass or any(link.inertia))


def _accepted(link: Link) -> bool:
    """Whether MuJoCo accepts an inertia: a mass, positive moments, none above the sum of the others."""
    a, b, c = np.linalg.eigvalsh(np.reshape(link.inertia, (3, 3))).tolist()
    return link.mass > LEAST and a > LEAST and a + b >= c


def _sum(name: str, parts: list[tuple[Link, Array]]) -> Link:
    """Links at poses in the frame of a link as one link."""
    mass = sum(x.mass for x, _ in parts)
    places = [X[:3, :3] @ np.array(x.com) + X[:3, 3] for x, X in parts]
    com = sum((x.mass * c for (x, _), c in zip(parts, places, strict=True)), np.zeros(3)) / (mass or 1.0)
    I = np.zeros((3, 3))
    for (x, X), c in zip(parts, places, strict=True):
        I += parallel_axis(X[:3, :3] @ np.reshape(x.inertia, (3, 3)) @ X[:3, :3].T, x.mass, c - com)
    return Link(name, mass, tuple(com.tolist()), tuple((0.5 * (I + I.T)).ravel().tolist()))


def _inertial(link: Link) -> Iterator[str]:
    if _has_inertia(link):
        xx, xy, xz, _, yy, yz, _, _, zz = link.inertia
        full = numbers((xx, yy, zz, xy, xz, yz))
        yield f'<inertial pos="{numbers(link.com)}" mass="{link.mass!r}" fullinertia="{full}"/>'


def _joint(placed: Placed) -> str:
    joint, X = placed
    words = [f'name={quoteattr(joint.name)} type="{TYPES[joint.kind]}"']
    if joint.kind != "floating":
        words.append(f'pos="{numbers(X[:3, 3])}"')
    if joint.kind in ("revolute", "continuous", "prismatic"):
        words.append(f'axis="{numbers(X[:3, :3] @ np.array(joint.axis))}"')
        if math.isfinite(joint.lower) and math.isfinite(joint.upper) and joint.lower < joint.upper:
            words.append(f'range="{joint.lower!r} {joint.upper!r}"')
        if math.isfinite(joint.effort) and joint.effort > 0.0:
            words.append(f'actuatorfrcrange="{-joint.effort!r} {joint.effort!r}"')
    armature = joint.armature[0] if isinstance(joint.armature, tuple) else joint.armature
    values = {"damping": joint.damping, "frictionloss": joint.friction, "armature": armature}
    words += [f'{name}="{x!r}"' for name, x in values.items() if x]
    return f"<joint {' '.join(words)}/>"


def _equality(joint: RobotJoint) -> str:
    m = joint.mimic
    assert m is not None
    line = f'joint1={quoteattr(joint.name)} joint2={quoteattr(m.leader)} polycoef="{m.offset!r} {m.multiplier!r} 0 0 0"'
    return f"    <joint {line}/>"


def _quaternion(X: Array) -> Array:
    """w x y z of the rotation of a pose: the largest of the four from its square, the others from products with it."""
    R = X[:3, :3]
    squares = np.array([1 + np.trace(R), *(1 + 2 * R[k, k] - np.trace(R) for k in range(3))])
    k = int(np.argmax(squares))
    S = np.array(
        [
            [0.0, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], 0.0, R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
            [R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], 0.0, R[1, 2] + R[2, 1]],
            [R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], 0.0],
        ]
    )
    q = S[k]
    q[k] = squares[k]
    return np.asarray(q / np.linalg.norm(q))
