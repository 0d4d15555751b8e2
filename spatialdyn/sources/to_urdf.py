"""``to_urdf``: a model's robot as URDF that is read back with the same numbers."""

from __future__ import annotations

import itertools
import math
import re
import warnings
from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import check_model
from ..errors import SpatialDynError, literal
from ..model.model import Model
from ..model.robot import Link, Robot, RobotJoint
from ..model.robot_checks import rpy_matrix, rpy_of
from ..waiting import watch

Array = NDArray[np.float64]
KINDS = ("fixed", "revolute", "continuous", "prismatic", "floating", "planar")
NO_TEXT = re.compile("[\\x00-\\x08\\x0b\\x0c\\x0e-\\x1f\\ud800-\\udfff\\ufffe\\uffff]")  # not in XML
STEPS = (0, 1, -1, 2, -2)  # neighbours of an angle, in units of its last place
UNWRITTEN = (1.0, 0.0, 0.0)  # the axis of a joint without <axis>
RIGHT = 0.5 * math.pi
LOCKED = 1e-8  # rad: for a pitch this near a right angle, only the sum or difference of roll and yaw matters
ROUNDED = 1e-13  # rad: bound on the error of an angle after conversion to a rotation and back
TINY = 1e-14  # change of a rotation's entries by a pitch of rounding size


def to_urdf(model: Model) -> str:
    """The robot of a model as the text of a URDF: links with their inertias, joints with their limits and damping.

    model  Model

    ``load_urdf`` of the text gives an equal robot. Numbers have all of their digits. Placements are equal to the bit if
    some angles give that rotation, as for every robot that was read from a URDF; else they are equal to rounding.
    Options of the loading call (a floating root, gravity, ``continuous``, ``mimic``) are no part of a URDF; shapes and
    meshes are left out, since a model does not keep them.

    ``load_urdf`` orders joints by the bytes of their names: a UserWarning says so if the model has another order.

    Raises  SpatialDynError naming the joint for parts that URDF lacks: spherical and helical joints, armatures,
            rotors, motors that joints share, springs; and for a name that XML cannot hold

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link").with_(payload={"tip": (0.5, (0, 0, 0), np.zeros((3, 3)))})
    >>> sd.load_urdf(to_urdf(model)) == model
    True
    """
    robot = check_model(model).robot
    for joint in robot.joints:
        _refuse(joint)
    for what in (robot.name, *(x.name for x in robot.links), *(x.name for x in robot.joints)):
        if NO_TEXT.search(what):
            raise SpatialDynError(f"{literal(what)} has a character that XML cannot hold, expected a name without it")
    _warn_of_order(robot)
    lines = [f"<robot name={quoteattr(robot.name)}>"]
    with watch.call("to_urdf"):
        for link in robot.links:
            lines += _link(link)
        for joint in robot.joints:
            lines += _joint(joint)
    return "\n".join([*lines, "</robot>", ""])


def _refuse(joint: RobotJoint) -> None:
    """Raise SpatialDynError for a joint that URDF cannot hold."""
    what = ""
    if joint.kind not in KINDS:
        what = f"is {joint.kind}"
    elif joint.spring is not None:
        what = f'is a rotor behind the spring of "{joint.spring.joint}"'
    elif joint.shared is not None:
        what = f'shares motors with "{joint.shared[0]}"'
    elif joint.rotor is not None:
        what = "has a rotor"
    elif np.any(joint.armature):
        what = f"has armature {joint.armature}"
    if what:
        raise SpatialDynError(f'joint "{joint.name}" {what}, which URDF cannot hold')


def _warn_of_order(robot: Robot) -> None:
    for children in robot.children.values() if robot.ordered else ():
        names = [j.name.encode() for j in children]
        if names != sorted(names):
            text = f'joints of robot "{robot.name}" come in another order when its URDF is read: byte order of names'
            warnings.warn(text, stacklevel=3)
            return


def _link(link: Link) -> Iterator[str]:
    if not (link.mass or any(link.com) or any(link.inertia)):
        yield f"  <link name={quoteattr(link.name)}/>"
        return
    xx, xy, xz, _, yy, yz, _, _, zz = link.inertia
    yield f"  <link name={quoteattr(link.name)}>"
    yield f'    <inertial><origin xyz="{numbers(link.com)}"/><mass value="{link.mass!r}"/>'
    yield f'      <inertia ixx="{xx!r}" ixy="{xy!r}" ixz="{xz!r}" iyy="{yy!r}" iyz="{yz!r}" izz="{zz!r}"/></inertial>'
    yield "  </link>"


def _joint(joint: RobotJoint) -> Iterator[str]:
    X = np.reshape(joint.placement, (4, 4))
    yield f'  <joint name={quoteattr(joint.name)} type="{joint.kind}">'
    yield f'    <origin xyz="{numbers(X[:3, 3])}" rpy="{numbers(angles_of(X[:3, :3]))}"/>'
    yield f"    <parent link={quoteattr(joint.parent)}/><child link={quoteattr(joint.child)}/>"
    if joint.kind not in ("fixed", "floating") or joint.axis != UNWRITTEN:
        yield f'    <axis xyz="{numbers(joint.axis)}"/>'
    limits = {"velocity": joint.velocity, "effort": joint.effort}
    written = [f'{name}="{x!r}"' for name, x in limits.items() if math.isfinite(x)]
    if joint.kind in ("revolute", "prismatic") and (written or math.isfinite(joint.lower + joint.upper)
                                                     or joint.lower > -math.inf or joint.upper < math.inf):  # fmt: skip
        written = [f'lower="{joint.lower!r}" upper="{joint.upper!r}"', *written]
    if written:
        yield f"    <limit {' '.join(written)}/>"
    if joint.damping or joint.friction:
        yield f'    <dynamics damping="{joint.damping!r}" friction="{joint.friction!r}"/>'
    if joint.mimic is not None:
        m = joint.mimic
        line = f'multiplier="{m.multiplier!r}" offset="{m.offset!r}"'
        yield f"    <mimic joint={quoteattr(m.leader)} {line}/>"
    yield "  </joint>"


def numbers(x: object) -> str:
    """Numbers with all of their digits, so that they are read back to the bit."""
    return " ".join(repr(float(y) + 0.0) for y in np.ravel(np.asarray(x, float)))


def angles_of(R: Array) -> tuple[float, ...]:
    """Roll, pitch, yaw whose rotation equals R to the bit, with few digits if possible; else the nearest angles.

    Tried are also angles beyond half a turn, pitches beyond a quarter, both angles where roll and yaw turn about the
    same axis, and pitches of 1e-16, since files contain all of these.
    """
    near = rpy_of(R)
    wanted = R + 0.0
    tried = itertools.chain(
        (tuple(round(x, d) for x in near) for d in range(1, 17)),
        itertools.product(*(_neighbours(x) for x in near)),
        _written(near),
        _locked(near) if abs(abs(near[1]) - RIGHT) < LOCKED else (),
        _pitched(near, R),
    )
    return next((x for x in tried if (rpy_matrix(*x) + 0.0 == wanted).all()), tuple(near))


def _neighbours(x: float) -> list[float]:
    """An angle and its neighbours within a few units of its last place; only itself if it is zero."""
    return [x + k * math.ulp(x) for k in STEPS] if x else [0.0]


def _short(x: float, turns: bool = True) -> list[float]:
    """An angle, and that a turn away, as the fewest decimals that it is to rounding, and as it is."""
    if abs(x) < TINY:
        return sorted({float(f"{x:.{d}e}") + 0.0 for d in range(17)}, key=lambda y: len(repr(y)))
    found: dict[float, None] = {}
    for y in [x, x - math.copysign(2.0 * math.pi, x)] if turns else [x]:
        digits = next((d for d in range(1, 16) if abs(round(y, d) - y) < ROUNDED), 16)
        found |= dict.fromkeys(round(y, d) + 0.0 for d in (digits, digits + 1, 17))
    return [*found]


def _written(near: list[float]) -> Iterator[tuple[float, ...]]:
    """Ways to write a rotation in few digits, with a pitch beyond a quarter of a turn too."""
    roll, pitch, yaw = near
    other = [roll + math.pi, math.copysign(math.pi, pitch) - pitch, yaw + math.pi]
    for given in (near, other, [roll - math.pi, -math.copysign(math.pi, pitch) - pitch, yaw - math.pi]):
        yield from itertools.product(*map(_short, given))


def _locked(near: list[float]) -> Iterator[tuple[float, ...]]:
    """Ways to write a rotation whose pitch is a quarter of a turn: any roll goes with a yaw."""
    _, pitch, yaw = near
    sign = math.copysign(1.0, pitch)
    for size, digits in itertools.product((RIGHT, math.pi), range(2, 17)):
        for roll in (round(size, digits), -round(size, digits)):
            for turned in _short(yaw + sign * roll):
                yield from ((roll, x, turned) for x in _short(pitch, turns=False))


def _pitched(near: list[float], R: Array) -> Iterator[tuple[float, ...]]:
    """Ways to write a rotation with a tiny pitch, which shows in an entry that is small itself."""
    for roll, yaw in itertools.product(_short(near[0]), _short(near[2])):
        level = rpy_matrix(roll, 0.0, yaw)
        off = R - level
        slope = (rpy_matrix(roll, 1e-3, yaw) - level) / math.sin(1e-3)
        i, j = np.unravel_index(int(np.argmax(abs(off))), (3, 3))
        if off[i, j] and abs(slope[i, j]) > 1e-9 and abs(off).max() < TINY:
            pitch = float(off[i, j] / slope[i, j])
            yield from ((roll, float(f"{pitch:.{d}e}"), yaw) for d in range(17))
