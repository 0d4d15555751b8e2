"""Loops of an MJCF text, MuJoCo's format: its ``<equality>`` as constraints on a robot that has the same names.

Semantics follow MuJoCo's XML reference, element equality; tests compare them with MuJoCo. The parsing function imports
lxml.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..algebra.rotations import UNIT_TOLERANCE
from ..calls.arguments import as_array
from ..calls.dynamics import calls
from ..errors import ConstraintError, ShapeError
from ..model.model import Model
from ..model.robot_checks import is_number
from .kinds import Constraint, CouplerConstraint, PointConstraint, WeldConstraint

Array = NDArray[np.float64]
SOFT = ("solref", "solimp", "torquescale", "class")  # softness in MuJoCo; constraints here are rigid
KNOWN = {  # element: its attributes
    "connect": ("name", "active", "body1", "body2", "anchor", "site1", "site2", *SOFT),
    "weld": ("name", "active", "body1", "body2", "relpose", "anchor", "site1", "site2", *SOFT),
    "joint": ("name", "active", "joint1", "joint2", "polycoef", *SOFT),
}


def constraints_of_mjcf(model: Model, text: str, q: ArrayLike | None) -> list[Constraint]:
    """The constraints of the active equalities of a text; see ``Constraints.of_mjcf``."""
    from lxml import etree

    if not isinstance(text, str):
        raise ConstraintError(f"MJCF is a {type(text).__name__}, expected its text")
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        root = etree.fromstring(text.encode(), parser)
    except (etree.XMLSyntaxError, UnicodeEncodeError) as error:  # UnicodeEncodeError for half a surrogate pair
        raise ConstraintError(f"MJCF is not well-formed XML ({error}), expected a whole text") from None
    if root.getroottree().docinfo.internalDTD is not None:
        raise ConstraintError("MJCF has a document type, expected none (no entity is ever read)")
    if root.tag not in ("mujoco", "equality"):
        raise ConstraintError(f"<{root.tag}> is the outermost element, expected <mujoco> or <equality>")
    closed = np.array(calls["neutral"](model) if q is None else as_array("q", q))
    if closed.shape != (model.nq,):
        raise ShapeError(f"q has shape {closed.shape}, expected ({model.nq},)")
    return [_constraint(model, closed, element) for element in _equalities(root)]


def _equalities(root: Any) -> Iterator[Any]:
    """The elements of all active equalities, checked."""
    sections = [root] if root.tag == "equality" else [x for x in root if x.tag in ("equality", "include")]
    for section in sections:
        for element in [section] if section.tag == "include" else section:
            if not isinstance(element.tag, str):
                continue  # a comment
            if element.tag not in KNOWN:
                _refuse(element, f"is not read, expected {', '.join(KNOWN)} in one text")
            unknown = [key for key in element.attrib if key not in KNOWN[element.tag]]
            if unknown:
                _refuse(element, f"has {unknown[0]}, expected some of {', '.join(KNOWN[element.tag])}")
            active = element.get("active", "true")
            if active not in ("true", "false"):
                _refuse(element, f'has active="{active}", expected true or false')
            if active == "true":
                yield element


def _constraint(model: Model, q: Array, element: Any) -> Constraint:
    """The constraint of an element; if its numbers do not define the closed pose, it is closed at q."""
    name = element.get("name")
    if element.tag == "joint":
        first, second = element.get("joint1"), element.get("joint2")
        if first is None or second is None:
            _refuse(element, "lacks joint1 or joint2, expected both")
        a = np.zeros(5)
        given = _numbers(element, "polycoef", (1, 2, 3, 4, 5), [0.0, 1.0])
        a[: len(given)] = given
        if a[2:].any():
            _refuse(element, f'has polycoef="{element.get("polycoef")}", expected a straight line: 0 but for two')
        y, x = (q[model.joint(joint).idx_q] for joint in (first, second))
        return CouplerConstraint(first, second, a[1], a[0] + y - a[1] * x, name=name)
    if element.get("site1") is not None or element.get("site2") is not None:
        if element.get("site1") is None or element.get("site2") is None:
            _refuse(element, "has one of site1 and site2, expected both")
        both = element.get("site1"), element.get("site2")
        kind = PointConstraint if element.tag == "connect" else WeldConstraint
        return kind(*both, name=name)
    first, second = element.get("body1"), element.get("body2")
    if first is None:
        _refuse(element, "lacks body1, expected the name of a link")
    if element.tag == "connect":
        if element.get("anchor") is None:
            _refuse(element, "lacks anchor, expected three numbers")
        at = np.eye(4)
        at[:3, 3] = _numbers(element, "anchor", (3,), [])
        there = _seen(model, q, first, second) @ at
        if _world(first):
            return PointConstraint(second, at_a=there[:3, 3], at_b=at[:3, 3], name=name)
        return PointConstraint(first, _body(second), at_a=at[:3, 3], at_b=there[:3, 3], name=name)
    relative = _relpose(element)
    if relative is None:
        relative = np.asarray(np.linalg.inv(_seen(model, q, first, second)))
    if _world(first):
        return WeldConstraint(second, at_b=relative, name=name)
    return WeldConstraint(first, _body(second), at_a=relative, name=name)


def _world(name: str | None) -> bool:
    return name is None or name == "world"


def _body(name: str | None) -> str | None:
    """A body as a frame; None for the world."""
    return None if _world(name) else name


def _seen(model: Model, q: Array, first: str, second: str | None) -> Array:
    """The pose of the first body in the second, at q."""
    poses = [np.eye(4) if _world(x) else calls["frame_placement"](model, q, x) for x in (second, first)]
    found: Array = np.linalg.inv(poses[0]) @ poses[1]
    return found


def _relpose(element: Any) -> Array | None:
    """The pose of body2 in body1; None if the quaternion is zero, which means the initial pose."""
    given = _numbers(element, "relpose", (7,), [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    (x, y, z), quaternion = given[:3], np.array(given[3:])
    norm = float(np.linalg.norm(quaternion))
    if norm == 0.0:
        return None
    if abs(norm - 1.0) > UNIT_TOLERANCE:
        _refuse(element, f'has relpose="{element.get("relpose")}", expected a quaternion w x y z of norm 1, or zeros')
    w, *u = quaternion / norm
    cross = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
    made = np.eye(4)
    made[:3, :3] += 2.0 * (w * cross + cross @ cross)
    made[:3, 3] = x, y, z
    return made


def _numbers(element: Any, key: str, counts: tuple[int, ...], default: list[float]) -> list[float]:
    """An attribute as finite numbers."""
    text = element.get(key)
    if text is None:
        return default
    found = [float(x) for x in text.split() if is_number(x)]
    if len(found) < len(text.split()) or len(found) not in counts or not np.isfinite(found).all():
        _refuse(element, f'has {key}="{text}", expected {" or ".join(map(str, counts))} finite numbers')
    return found


def _refuse(element: Any, what: str) -> NoReturn:
    name = element.get("name")
    label = f"<{element.tag}>" if name is None else f'<{element.tag} name="{name}">'
    raise ConstraintError(f"{label} in line {element.sourceline} of the MJCF {what}")
