"""The strict reading of a URDF's XML: what is broken is refused by name, and only what dynamics needs is kept.

Every refusal is an UrdfError that names file, line, element, attribute and value. What is left is sound, so whatever
reads it next has nothing to repair.

lxml is imported inside the function that parses.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable
from typing import Any, NoReturn

from .errors import UrdfError
from .robot import WITH_AXIS

URDF_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
LIMITED = ("revolute", "prismatic")
SIZE_LIMIT = 64 * 2**20  # bytes; the largest robot of example-robot-data has 0.2 MB
RIGHT = 0.5 * math.pi
NEAR = 1e-9  # rad: an angle this close to a right one, but not at it, was meant to be one

# What an element may hold. An attribute ends in ! where it is required; its kind says how it is checked.
OTHERS = {"sdf": "SDF", "mujoco": "MJCF", "COLLADA": "a mesh", "html": "a web page"}  # what is taken for a URDF

_ATTRIBUTES: dict[str, dict[str, str]] = {
    "robot": {"name!": "name"},
    "link": {"name!": "name"},
    "inertial": {},
    "mass": {"value!": "mass"},
    "inertia": {f"i{ab}!": "number" for ab in ("xx", "xy", "xz", "yy", "yz", "zz")},
    "origin": {"xyz": "three numbers", "rpy": "three numbers"},
    "joint": {"name!": "name", "type!": "joint type"},
    "parent": {"link!": "name"},
    "child": {"link!": "name"},
    "axis": {"xyz!": "three numbers"},
    "limit": {"lower": "bound", "upper": "bound", "velocity": "bound", "effort": "bound"},
    "dynamics": {"damping": "number", "friction": "number"},
    "mimic": {"joint!": "name", "multiplier": "number", "offset": "number"},
}
_CHILDREN: dict[str, tuple[str, ...]] = {
    "robot": ("link", "joint"),
    "link": ("inertial",),
    "inertial": ("origin", "mass!", "inertia!"),
    "joint": ("origin", "parent!", "child!", "axis", "limit", "dynamics", "mimic"),
}
_OF_NO_CONCERN = {  # defined, but of no concern to dynamics
    "robot": ("material", "transmission", "gazebo", "sensor", "ros2_control", "@version"),
    "link": ("visual", "collision", "@type"),
    "joint": ("calibration", "safety_controller"),
}
_WANTED = {
    "name": "a name",
    "joint type": "one of " + ", ".join(URDF_KINDS),
    "number": "a finite number",
    "mass": "a finite number >= 0",
    "bound": "a number",
    "three numbers": "3 finite numbers",
}
_NUMBER = re.compile(r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|inf(?:inity)?|nan)", re.IGNORECASE)
_BEFORE_ROOT = re.compile(rb"\s+|<\?.*?\?>|<!--.*?-->", re.DOTALL)


def sane_text(label: str, text: str | bytes) -> tuple[str, bytes]:
    """Text as bytes, if it is of a sane size, looks like XML and declares no document type."""
    if isinstance(text, bytes) and text.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = text.decode("utf-16", errors="replace")  # what PowerShell's > writes
    if isinstance(text, str):
        # the declaration goes, for its encoding is no longer true; a lone surrogate becomes what XML refuses
        text = re.sub(r"\A\ufeff?(\s*)<\?xml[^>]*\?>", r"\1", text).encode("utf-8", errors="xmlcharrefreplace")
    if len(text) > SIZE_LIMIT:
        raise UrdfError(f"{label}: has more than {SIZE_LIMIT} bytes, expected at most that")
    start = text.removeprefix(b"\xef\xbb\xbf")
    head = start.lstrip()[:12]
    if not head:
        raise UrdfError(f"{label}: is empty, expected a <robot> element")
    if not head.startswith(b"<") or b"\0" in text:
        raise UrdfError(f"{label}: starts with {head!r} and is no XML text, expected a <robot> element")
    at = 0
    while part := _BEFORE_ROOT.match(start, at):
        at = part.end()
    if start[at : at + 9].upper() == b"<!DOCTYPE":
        shown = start[at : at + 40].split(b"\n")[0].decode("utf-8", errors="replace")
        line = start.count(b"\n", 0, at) + 1
        raise UrdfError(f"{label}:{line}: has the document type {shown!r}, expected none (no entity is ever read)")
    return label, start


class StrictReader:
    """Reads one URDF strictly: ``read`` gives the sound copy; ``where`` and ``notes`` are for what comes after it."""

    def __init__(self, label: str, snap: float | None) -> None:
        self.label = label
        self.snap = snap
        self.lines: dict[tuple[str, str], int] = {}
        self.notes: list[str] = []
        self._ignored: Counter[str] = Counter()
        self._angles: list[float] = []

    def where(self, kind: str, name: str) -> str:
        """``file:line: `` of a link or joint; ``file: `` for anything else."""
        line = self.lines.get((kind, name))
        return f"{self.label}: " if line is None else f"{self.label}:{line}: "

    def read(self, data: bytes) -> bytes:
        """The URDF with nothing but what dynamics needs, every part of it checked. Raises UrdfError."""
        from lxml import etree

        parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
        try:
            root = etree.fromstring(data, parser)
        except etree.XMLSyntaxError as error:
            line, _ = error.position
            raise UrdfError(
                f"{self.label}:{line}: is not well-formed XML ({error.msg}), expected a whole file"
            ) from None
        if root.getroottree().docinfo.internalDTD is not None:
            raise UrdfError(f"{self.label}: has a document type, expected none (no entity is ever read)")
        if self._tag(root) != "robot":
            other = OTHERS.get(self._tag(root))
            hint = f", for {other} is not read" if other else ""
            self._refuse(root, f"<{_short(str(root.tag))}> is the outermost element, expected <robot>{hint}")
        sound = self._copy(root, "")
        self.notes += [
            f"ignored, as URDF does not define it: {what} ({n}x)" for what, n in sorted(self._ignored.items())
        ]
        self.notes += angle_notes(self._angles, self.snap)
        return bytes(etree.tostring(sound))

    def _refuse(self, element: Any, message: str) -> NoReturn:
        raise UrdfError(f"{self.label}:{element.sourceline}: {message}")

    def _tag(self, element: Any) -> str:
        """The element's name; empty for comments and for other people's namespaces."""
        if not isinstance(element.tag, str):
            return ""
        space, _, tag = element.tag.rpartition("}")
        if "xacro" in space:
            self._refuse(element, f"<xacro:{tag}> is left, expected a URDF in which xacro has expanded every macro")
        return "" if element.prefix else tag

    def _copy(self, element: Any, owner: str) -> Any:
        """The element with its known attributes and children, checked; ``owner`` is the link or joint it belongs to."""
        tag = self._tag(element)
        sound = element.makeelement(tag)
        for key, kind in _ATTRIBUTES[tag].items():
            self._copy_attribute(element, sound, key, kind, owner)
            if key == "name!":
                owner = f'{tag} "{sound.get("name")}"'
                self.lines[tag, sound.get("name")] = element.sourceline
        known = [key.rstrip("!") for key in _ATTRIBUTES[tag]]
        for key in element.attrib:
            if key not in known and not key.startswith("{") and f"@{key}" not in _OF_NO_CONCERN.get(tag, ()):
                self._ignored[f"attribute {_short(key)} of <{tag}>"] += 1
        self._copy_children(element, sound, owner)
        if tag == "joint":
            self._check_joint(element, sound, owner)
        return sound

    def _copy_children(self, element: Any, sound: Any, owner: str) -> None:
        tag = sound.tag
        known = {key.rstrip("!"): key.endswith("!") for key in _CHILDREN.get(tag, ())}
        for child in element:
            name = self._tag(child)
            if name in known:
                if tag != "robot" and sound.find(name) is not None:
                    self._refuse(child, f"<{tag}> of {owner} has a second <{name}>, expected one")
                sound.append(self._copy(child, owner))
            elif name and tag in _CHILDREN and name not in _OF_NO_CONCERN.get(tag, ()):
                self._ignored[f"<{_short(name)}> in <{tag}>"] += 1
        for name, required in known.items():
            if required and sound.find(name) is None:
                self._refuse(element, f"<{tag}> of {owner} has no <{name}>, expected one")

    def _copy_attribute(self, element: Any, sound: Any, key: str, kind: str, owner: str) -> None:
        name, value = key.rstrip("!"), element.get(key.rstrip("!"))
        of = f" of {owner}" if owner else ""
        if value is None:
            if key.endswith("!"):
                self._refuse(element, f"<{sound.tag}>{of} has no attribute {name}, expected {_WANTED[kind]}")
            return
        problem, numbers = _numbers(value, kind)
        if problem:
            shown = f'<{sound.tag} {name}="{_short(value)}">'
            self._refuse(element, f"{shown}{of} {problem}, expected {_WANTED[kind]}")
        if name == "rpy":
            self._angles += numbers
            numbers = [snapped(angle, self.snap) for angle in numbers]
        sound.set(name, " ".join(map(repr, numbers)) if numbers else value)

    def _check_joint(self, element: Any, joint: Any, owner: str) -> None:
        """What only shows once the whole joint is read: a null axis, limits the wrong way round, mimic of itself."""
        for child in element:
            tag = self._tag(child)
            if tag == "axis" and joint.get("type") in WITH_AXIS and not any(map(float, child.get("xyz").split())):
                self._refuse(child, f'<axis xyz="{child.get("xyz")}"> of {owner} has norm 0, expected a nonzero vector')
            if tag == "limit" and joint.get("type") in LIMITED:
                lower, upper = (float(child.get("lower", 0)), float(child.get("upper", 0)))
                if not lower <= upper:
                    self._refuse(child, f'<limit lower="{lower}" upper="{upper}"> of {owner}, expected lower <= upper')
                if lower == math.inf or upper == -math.inf:
                    self._refuse(child, f'<limit lower="{lower}" upper="{upper}"> of {owner} leaves no position')
            if tag == "mimic" and child.get("joint") == joint.get("name"):
                self._refuse(
                    child, f'<mimic joint="{child.get("joint")}"> of {owner} names itself, expected another joint'
                )


def _numbers(value: str, kind: str) -> tuple[str, list[float]]:
    """What is wrong with an attribute of a kind, in words, or nothing; and its numbers if it holds numbers."""
    if kind == "name":
        return ("" if value.strip() else "is empty"), []
    if kind == "joint type":
        return ("" if value in URDF_KINDS else "is not a joint type of URDF"), []
    parts = value.split()
    wanted = 3 if kind == "three numbers" else 1
    for part in parts:
        if not _NUMBER.fullmatch(part):
            return f"holds {_short(part)!r}, which is no number", []
    if len(parts) != wanted:
        return f"has {len(parts)} number{'s' * (len(parts) != 1)}", []
    numbers = [float(part) for part in parts]
    if any(math.isnan(x) or (math.isinf(x) and kind != "bound") for x in numbers):
        return "is not finite" if kind != "bound" else "is not a number", numbers
    if kind == "mass" and numbers[0] < 0.0:
        return "is negative", numbers
    return "", numbers


def _short(text: str) -> str:
    """Text fit for one line of a message."""
    line = " ".join(text.split())
    return line if len(line) <= 60 else line[:57] + "..."


# --- angles near a right one ------------------------------------------------------------------------------


def off_right(angle: float) -> float:
    """Distance of an angle from the nearest multiple of a right angle [rad]."""
    return abs(angle - round(angle / RIGHT) * RIGHT)


def snapped(angle: float, snap: float | None) -> float:
    return angle if snap is None or off_right(angle) > snap else round(angle / RIGHT) * RIGHT


def angle_notes(angles: Iterable[float], snap: float | None) -> list[str]:
    near = NEAR if snap is None else snap
    count = sum(4e-16 * max(1.0, abs(angle)) < off_right(angle) <= near for angle in angles)
    if not count:
        return []
    what = f"{count} angle{'s' * (count > 1)} within {near:g} of a right angle"
    return [f"{what} kept as written (snap={near:g} rounds them)" if snap is None else f"{what} rounded to it"]
