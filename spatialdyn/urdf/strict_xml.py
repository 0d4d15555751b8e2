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

from ..errors import UrdfError
from ..model.robot import WITH_AXIS, quoted

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
_DEFINITIONS = ("arg", "property")  # of xacro: they stand for values, not for elements that a URDF would hold
_UNDECLARED = "undeclared:"  # begins the namespace that a prefix without one is given
_NO_NAMESPACE = re.compile(r"Namespace prefix ([A-Za-z_][A-Za-z0-9_.-]*) (?:for \S+ )?on \S+ is not defined")
_PASSES = 8  # of the parser, each of which names up to a hundred undeclared prefixes
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
    at = _root_at(start)
    if start[at : at + 9].upper() == b"<!DOCTYPE":
        shown = start[at : at + 40].split(b"\n")[0].decode("utf-8", errors="replace")
        line = start.count(b"\n", 0, at) + 1
        raise UrdfError(f"{label}:{line}: has the document type {shown!r}, expected none (no entity is ever read)")
    return label, start


def _root_at(text: bytes) -> int:
    """Where the outermost element begins, or what stands in its place."""
    at = 0
    while part := _BEFORE_ROOT.match(text, at):
        at = part.end()
    return at


def _declaring(text: bytes, prefixes: Iterable[str]) -> bytes:
    """The XML with prefixes declared in its outermost element; lines stay where they are."""
    tag = re.compile(rb"<[^\s/>]+").match(text, _root_at(text))
    at = tag.end() if tag else 0
    declared = "".join(f' xmlns:{prefix}="{_UNDECLARED}{prefix}"' for prefix in prefixes)
    return text[:at] + declared.encode() + text[at:]


class StrictReader:
    """Reads one URDF strictly: ``read`` gives the sound copy; ``where`` and ``notes`` are for what comes after it.

    ``doubts`` are those of the notes that say what a stricter reader would refuse: leftovers that hold no link or
    joint.
    """

    def __init__(self, label: str, snap: float | None) -> None:
        self.label = label
        self.snap = snap
        self.lines: dict[tuple[str, str], int] = {}
        self.notes: list[str] = []
        self.doubts: list[str] = []
        self._ignored: Counter[str] = Counter()
        self._left: Counter[str] = Counter()
        self._without_axis: list[str] = []
        self._undeclared: list[str] = []
        self._angles: list[float] = []

    def where(self, kind: str, name: str) -> str:
        """``file:line: `` of a link or joint; ``file: `` for anything else."""
        line = self.lines.get((kind, name))
        return f"{self.label}: " if line is None else f"{self.label}:{line}: "

    def read(self, data: bytes) -> bytes:
        """The URDF with nothing but what dynamics needs, every part of it checked. Raises UrdfError."""
        from lxml import etree

        root = self._parse(data)
        if root.getroottree().docinfo.internalDTD is not None:
            raise UrdfError(f"{self.label}: has a document type, expected none (no entity is ever read)")
        if self._tag(root) != "robot":
            other = OTHERS.get(self._tag(root))
            hint = f", for {other} is not read" if other else ""
            self._refuse(root, f"<{_short(str(root.tag))}> is the outermost element, expected <robot>{hint}")
        sound = self._copy(root, "")
        self.doubts += [
            f"ignored, as it holds no link or joint: {what} ({n}x)" for what, n in sorted(self._left.items())
        ]
        if self._undeclared:
            many = "es" * (len(self._undeclared) > 1)
            self.doubts.append(
                f"no xmlns declares the prefix{many} {quoted(sorted(self._undeclared))}, under which nothing is read"
            )
        if self._without_axis:
            self.doubts.append(f"ignored, as the joint has no axis: <axis> without xyz of {quoted(self._without_axis)}")
        self.notes += self.doubts
        self.notes += [
            f"ignored, as URDF does not define it: {what} ({n}x)" for what, n in sorted(self._ignored.items())
        ]
        self.notes += angle_notes(self._angles, self.snap)
        return bytes(etree.tostring(sound))

    def _parse(self, data: bytes) -> Any:
        """The outermost element; prefixes that nothing declares get a namespace. Raises UrdfError."""
        from lxml import etree

        for _ in range(_PASSES):
            parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
            try:
                return etree.fromstring(_declaring(data, self._undeclared), parser)
            except etree.XMLSyntaxError as error:
                refused = error
            found = [_NO_NAMESPACE.fullmatch(entry.message) for entry in parser.error_log]
            more = dict.fromkeys(part[1] for part in found if part and part[1] not in self._undeclared)
            if not more:
                break
            self._undeclared += more
        line, _ = refused.position
        raise UrdfError(f"{self.label}:{line}: is not well-formed XML ({refused.msg}), expected a whole file")

    def _refuse(self, element: Any, message: str) -> NoReturn:
        raise UrdfError(f"{self.label}:{element.sourceline}: {message}")

    def _tag(self, element: Any) -> str:
        """The element's name; empty for comments, for other people's namespaces, and for xacro's definitions.

        Refused is what may stand for a link or joint: anything else of xacro, and prefixes that nothing declares.
        """
        if not isinstance(element.tag, str):
            return ""
        space, _, tag = element.tag.rpartition("}")
        if "xacro" in space:
            if tag in _DEFINITIONS and not any(map(_stands_for_elements, element.iterdescendants())):
                return ""
            self._refuse(element, f"<xacro:{tag}> is left, expected a URDF in which xacro has expanded every macro")
        if space[1:].startswith(_UNDECLARED):
            shown = f"<{_short(space[1 + len(_UNDECLARED) :])}:{_short(tag)}>"
            self._refuse(
                element, f"{shown} has a prefix that no xmlns declares, expected one that is declared, or none"
            )
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
            if name == "axis" and child.get("xyz") is None and element.get("type") not in WITH_AXIS:
                self._without_axis.append(element.get("name"))
            elif name in known:
                if tag != "robot" and sound.find(name) is not None:
                    self._refuse(child, f"<{tag}> of {owner} has a second <{name}>, expected one")
                sound.append(self._copy(child, owner))
            elif name and tag in _CHILDREN and name not in _OF_NO_CONCERN.get(tag, ()):
                self._ignored[f"<{_short(name)}> in <{tag}>"] += 1
            elif not name and isinstance(child.tag, str) and "xacro" in child.tag.rpartition("}")[0]:
                self._left[f"<xacro:{child.tag.rpartition('}')[2]}>"] += 1
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


def _stands_for_elements(element: Any) -> bool:
    """Whether an element inside a definition of xacro is a link or joint, or may become one."""
    if not isinstance(element.tag, str):
        return False
    space, _, tag = element.tag.rpartition("}")
    return tag in ("link", "joint") or "xacro" in space


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
