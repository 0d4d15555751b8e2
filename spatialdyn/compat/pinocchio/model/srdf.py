"""SRDF files: reference configurations, rotor parameters and pairs of links that never collide.

lxml is imported inside the function that parses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from ....errors import UrdfError
from ....model.robot_checks import is_number
from ....urdf.sources import read_path
from ..types.arguments import expected, path
from ..types.frame import BODY
from .geometry import GeometryModel
from .joint import JointModel
from .model import Model

__all__ = [
    "loadReferenceConfigurations", "loadReferenceConfigurationsFromXML", "loadRotorParameters", "removeCollisionPairs",
    "removeCollisionPairsFromXML",
]  # fmt: skip


def loadReferenceConfigurations(model: Model, srdf_filename: Any, verbose: bool = False) -> None:
    """Read the configurations of an SRDF file into ``model.referenceConfigurations``.

    Joints of the file that the model does not have are ignored, for a file may serve several models; joints of the
    model that the file does not name are neutral. ``verbose`` has no effect.

    Raises UrdfError naming file, line and value.
    """
    _configurations(model, *_file(srdf_filename))


def loadReferenceConfigurationsFromXML(model: Model, srdf_xml_stream: str, verbose: bool = False) -> None:
    """Read the configurations of SRDF text, as ``loadReferenceConfigurations`` does."""
    _configurations(model, "<text>", expected(srdf_xml_stream, str, "srdf_xml_stream").encode())


def loadRotorParameters(model: Model, srdf_filename: Any, verbose: bool = False) -> bool:
    """Read the rotors of an SRDF file into ``rotorInertia``, ``rotorGearRatio`` and ``armature``.

    A rotor adds its inertia times its squared ratio to the armature of its joint, in place of the rotor that the model
    had before: reading a file twice changes nothing. Returns True.

    Raises UrdfError naming file, line and value, or a file without rotors.
    """
    label, text = _file(srdf_filename)
    root = _parsed(label, expected(model, Model, "model"), text)
    found = list(root.iter("rotor_params"))
    if not found:
        raise UrdfError(f"{label}: has no <rotor_params>, expected one")
    for element in (joint for rotors in found for joint in rotors.iter("joint")):
        (inertia,) = _numbers(label, element, "mass")
        (ratio,) = _numbers(label, element, "gear_ratio")
        for joint in _joints(model, element):
            at = slice(joint.idx_v, joint.idx_v + joint.nv)
            model.armature[at] -= model.rotorInertia[at] * model.rotorGearRatio[at] ** 2
            model.rotorInertia[at], model.rotorGearRatio[at] = inertia, ratio
            model.armature[at] += inertia * ratio**2
    return True


def removeCollisionPairs(model: Model, geom_model: GeometryModel, srdf_filename: Any, verbose: bool = False) -> None:
    """Remove the pairs of objects on links that ``<disable_collisions>`` of an SRDF file names.

    Links that the model does not have are ignored, for a file may serve several models. ``verbose`` has no effect.
    Raises UrdfError for a file that cannot be read.
    """
    _remove_pairs(model, geom_model, *_file(srdf_filename))


def removeCollisionPairsFromXML(
    model: Model, geom_model: GeometryModel, srdf_xml_stream: str, verbose: bool = False
) -> None:
    """Remove the pairs that SRDF text names, as ``removeCollisionPairs`` does."""
    _remove_pairs(model, geom_model, "<text>", expected(srdf_xml_stream, str, "srdf_xml_stream").encode())


def _remove_pairs(model: Model, geom_model: GeometryModel, label: str, text: bytes) -> None:
    root = _parsed(label, expected(model, Model, "model"), text)
    objects = expected(geom_model, GeometryModel, "geom_model").geometryObjects
    bodies = {frame.name: k for k, frame in enumerate(model.frames) if frame.type == BODY}
    apart = {
        frozenset((bodies[a], bodies[b]))
        for a, b in ((x.get("link1"), x.get("link2")) for x in root.iter("disable_collisions"))
        if a in bodies and b in bodies and a != b
    }
    geom_model.collisionPairs[:] = [
        x
        for x in geom_model.collisionPairs
        if frozenset((objects[x.first].parentFrame, objects[x.second].parentFrame)) not in apart
    ]


def _file(filename: Any) -> tuple[str, bytes]:
    return read_path(path(filename, "srdf_filename"), "an SRDF file")


def _parsed(label: str, model: Model, text: bytes) -> Any:
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        return etree.fromstring(text, parser)
    except etree.XMLSyntaxError as error:
        raise UrdfError(f"{label}:{error.position[0]}: is not well-formed XML ({error.msg}), expected SRDF") from None


def _configurations(model: Model, label: str, text: bytes) -> None:
    root = _parsed(label, expected(model, Model, "model"), text)
    for state in root.iter("group_state"):
        name = state.get("name")
        if name is None:
            raise UrdfError(f"{label}:{state.sourceline}: <group_state> has no attribute name, expected one")
        q = model._neutral()
        for element in state.iter("joint"):
            values = _numbers(label, element, "value")
            for joint in _joints(model, element):
                if len(values) == 1 and joint.steps()[0].kind == "continuous" and joint.nq == 2:
                    values = [math.cos(values[0]), math.sin(values[0])]
                if len(values) != joint.nq:
                    raise UrdfError(
                        f'{label}:{element.sourceline}: joint "{element.get("name")}" has {len(values)} values, '
                        f"expected {joint.nq}"
                    )
                q[joint.idx_q : joint.idx_q + joint.nq] = values
        model.referenceConfigurations[name] = q


def _joints(model: Model, element: Any) -> Iterator[JointModel]:
    """The joint that an element names, if the model has it and it has coordinates."""
    name = element.get("name")
    if name in model.names[1:]:
        joint = model.joints[model.names.index(name)]
        if joint.nq:
            yield joint


def _numbers(label: str, element: Any, attribute: str) -> list[float]:
    parts = (element.get(attribute) or "").split()
    if not parts or not all(is_number(part) and math.isfinite(float(part)) for part in parts):
        raise UrdfError(
            f'{label}:{element.sourceline}: <{element.tag} {attribute}="{element.get(attribute)}"> of joint '
            f'"{element.get("name")}", expected finite numbers'
        )
    return [float(part) for part in parts]
