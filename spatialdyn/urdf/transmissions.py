"""The transmissions of a URDF whose law is known: ROS' simple and differential ones.

With the reductions n of actuators and N of joints, as ros_control defines them,

    simple          q = θ / n + offset
    differential    q₁ = (θ₁/n₁ + θ₂/n₂) / 2N₁ + offset₁,    q₂ = (θ₁/n₁ - θ₂/n₂) / 2N₂ + offset₂

Its FourBarLinkageTransmission maps efforts and velocities by matrices that do not keep power, so neither is taken.
Source: ros_control, transmission_interface, the classes' documentation (2013).
"""

from __future__ import annotations

import json
import math
import warnings
from typing import Any

import numpy as np

from ..errors import ModelError, literal
from ..model.model import Model
from ..model.robot_checks import quoted
from ..model.transmission import Transmission
from ..waiting import watch
from .sources import bytes_of, is_yourdfpy
from .strict_xml import StrictReader

REDUCTIONS = ("mechanicalReduction", "mechanical_reduction")
ONE_COORDINATE = ("revolute", "continuous", "prismatic")
SIMPLE, DIFFERENTIAL = "SimpleTransmission", "DifferentialTransmission"


class _UnsoundError(Exception):
    """Why a transmission is left out."""


def read_transmissions(source: Any) -> tuple[Transmission, ...]:
    """The transmissions of a URDF: SimpleTransmission and DifferentialTransmission, also those in <ros2_control>.

    Source: ros_control, transmission_interface (2013), for what their reductions and offsets mean.

    source  path, text, open file, or name of a robot, as for ``load_urdf``; not a yourdfpy.URDF, which has none. Or a
            Model, for those of its file; those of MJCF are the gears of actuators on joints

    A URDF has no inertias of rotors: ``sd.Transmission(t.joints, t.matrix, rotor_inertia)`` adds them. Left out, with
    one warning that names each and why: other types, whose law is not in the file; transmissions of joints that do not
    move, are missing, have several coordinates, or are driven twice; reductions that are 0, not a number, or given
    twice; a differential whose roles are not actuator1, actuator2, joint1, joint2.

    Returns Transmissions in the order of the file.
    Raises  UrdfError as ``load_urdf``.

    >>> import spatialdyn as sd
    >>> text = '''<robot name="r"><link name="a"/><link name="b"/>
    ...   <joint name="j" type="revolute"><parent link="a"/><child link="b"/></joint>
    ...   <transmission name="t"><type>transmission_interface/SimpleTransmission</type><joint name="j"/>
    ...     <actuator name="m"><mechanicalReduction>50</mechanicalReduction></actuator></transmission></robot>'''
    >>> sd.read_transmissions(text)
    (<Transmission of j: q̇ = [[0.02]] θ̇>,)
    """
    if isinstance(source, Model):
        if source.robot.declared or not source.robot.source:
            return tuple(Transmission(**x) for x in json.loads(source.robot.declared or "{}").get("transmission", ()))
        source = source.robot.source
    if is_yourdfpy(source):
        raise ModelError("source is a yourdfpy.URDF, expected a path or text: it has no transmissions")
    label, data = bytes_of(source)
    reader = StrictReader(label, None)
    with watch.call("read_transmissions"):
        kinds = {p.values["name"]: p.values["type"] for p in reader.read(data).children if p.tag == "joint"}
    made: list[Transmission] = []
    left: list[str] = []
    driven: set[str] = set()
    root = reader.outermost(data)
    for element in [
        x for part in (root, *root.iterchildren("ros2_control")) for x in part.iterchildren("transmission")
    ]:
        try:
            found = _transmission(element, kinds)
            twice = sorted(driven & set(found.joints))
            if twice:
                raise _UnsoundError(f"drives {quoted(twice)}, as another does")
        except (_UnsoundError, ModelError) as reason:
            left.append(f'"{element.get("name")}" {reason}')
            continue
        driven |= set(found.joints)
        made.append(found)
    if left:
        shown = "; ".join(left[:8] + [f"and {len(left) - 8} more"] * (len(left) > 8))
        warnings.warn(f"{label}: transmissions are left out: {shown}", stacklevel=2)
    return tuple(made)


def _transmission(element: Any, kinds: dict[str, str]) -> Transmission:
    """The Transmission of an element. Raises _UnsoundError, ModelError."""
    law = (element.findtext("type") or element.get("type") or element.findtext("plugin") or "").strip()
    kind = law.rpartition("/")[2]
    package = law.rpartition("/")[0]
    if kind not in (SIMPLE, DIFFERENTIAL) or package not in ("", "transmission_interface"):
        raise _UnsoundError(f'has type "{law}"')
    joints, actuators = element.findall("joint"), element.findall("actuator")
    count = 1 if kind == SIMPLE else 2
    if (len(joints), len(actuators)) != (count, count):
        raise _UnsoundError(f"has {len(joints)} joints and {len(actuators)} actuators, expected {count} of each")
    if count == 2:
        joints, actuators = _by_role(joints, "joint"), _by_role(actuators, "actuator")
    for joint in joints:
        name = joint.get("name")
        if name not in kinds:
            raise _UnsoundError(f'drives "{name}", which is no joint of the robot')
        if kinds[name] not in ONE_COORDINATE:
            raise _UnsoundError(f'drives "{name}", which is {kinds[name]}')
    offset = [_number(joint, ("offset",), 0.0) for joint in joints]
    N, n = ([_number(x, REDUCTIONS, 1.0) for x in part] for part in (joints, actuators))
    if count == 1:
        given = [x for x in (N[0], n[0], _number(element, REDUCTIONS, 1.0)) if x != 1.0]
        if len(given) > 1:
            raise _UnsoundError(f"has reductions {given}, expected one")
        matrix = [[1.0 / _nonzero(given[0] if given else 1.0)]]
    else:
        half = [[0.5 / (_nonzero(N[k]) * _nonzero(n[i])) for i in (0, 1)] for k in (0, 1)]
        matrix = [half[0], [half[1][0], -half[1][1]]]
    names = [joint.get("name") for joint in joints]
    motors = [x.get("name") or "" for x in actuators]
    return Transmission(names, np.array(matrix), offset=offset, actuators=motors)


def _by_role(elements: list[Any], what: str) -> list[Any]:
    """Two elements in the order of their roles, as text or attribute."""
    roles = {(x.findtext("role") or x.get("role") or "").strip(): x for x in elements}
    try:
        return [roles[f"{what}1"], roles[f"{what}2"]]
    except KeyError:
        raise _UnsoundError(f"has {what}s of roles {sorted(roles)}, expected {what}1 and {what}2") from None


def _number(element: Any, tags: tuple[str, ...], default: float) -> float:
    """The number in the one child of these tags."""
    texts = [(x.text or "").strip() for tag in tags for x in element.findall(tag)]
    if len(texts) > 1:
        raise _UnsoundError(f"has {tags[0]} {len(texts)} times")
    try:
        value = float(texts[0]) if texts else default
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _UnsoundError(f"has {tags[0]} {literal(texts[0][:40])}, expected a finite number")
    return value


def _nonzero(x: float) -> float:
    if x == 0.0:
        raise _UnsoundError("has a reduction of 0")
    return x
