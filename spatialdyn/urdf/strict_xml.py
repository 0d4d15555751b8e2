"""The strict reader of a URDF's XML: it raises for what is broken and returns only what dynamics needs, as values.

Every error is a UrdfError that names file, line, element, attribute and value. An element becomes a Part, whose
attributes are numbers and names that are valid, so the caller has nothing to repair.

The function that parses imports lxml.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable
from typing import Any, NamedTuple, NoReturn

from ..errors import UrdfError, literal
from ..model.robot import WITH_AXIS
from ..model.robot_checks import is_number, quoted

URDF_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
LIMITED = ("revolute", "prismatic")
SIZE_LIMIT = 64 * 2**20  # bytes; the largest file of example-robot-data has 0.2 MB
RIGHT = 0.5 * math.pi
NEAR = 1e-9  # rad: an angle this near a right angle was probably meant to be one

OTHERS = {"sdf": "SDF", "mujoco": "MJCF", "COLLADA": "a mesh", "html": "a web page"}  # formats mistaken for URDF

# Attributes of an element: ! marks a required one; the value names its check.
_MARKED_ATTRIBUTES: dict[str, dict[str, str]] = {
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
_MARKED_CHILDREN: dict[str, tuple[str, ...]] = {
    "robot": ("link", "joint"),
    "link": ("inertial",),
    "inertial": ("origin", "mass!", "inertia!"),
    "joint": ("origin", "parent!", "child!", "axis", "limit", "dynamics", "mimic"),
}
_ATTRIBUTES = {
    tag: {key.rstrip("!"): (key.endswith("!"), kind) for key, kind in keys.items()}
    for tag, keys in _MARKED_ATTRIBUTES.items()
}  # {element: {attribute: (whether it is required, its check)}}
_CHILDREN = {tag: {key.rstrip("!"): key.endswith("!") for key in keys} for tag, keys in _MARKED_CHILDREN.items()}
_OF_NO_CONCERN = {  # defined by URDF, not used by dynamics
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
_DEFINITIONS = ("arg", "property", "macro")  # of xacro: they define values and elements, and are none until called
_CONDITIONS = ("if", "unless")  # of xacro: their content belongs to the element that holds them
_UNDECLARED = "undeclared:"  # begins the namespace given to an undeclared prefix
_NO_NAMESPACE = re.compile(r"Namespace prefix ([A-Za-z_][A-Za-z0-9_.-]*) (?:for \S+ )?on \S+ is not defined")
_PASSES = 8  # of the parser, each reports up to 100 undeclared prefixes
_BEFORE_ROOT = re.compile(rb"\s+|<\?.*?\?>|<!--.*?-->", re.DOTALL)


def sane_text(label: str, text: str | bytes) -> tuple[str, bytes]:
    """Text as bytes. Raises UrdfError if it is too large, is not XML or declares a document type."""
    if isinstance(text, bytes) and text.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = text.decode("utf-16", errors="replace")  # what PowerShell's > writes
    if isinstance(text, str):
        # drops the declaration, whose encoding is no longer true; a lone surrogate becomes invalid XML
        text = re.sub(r"\A\ufeff?(\s*)<\?xml[^>]*\?>", r"\1", text).encode("utf-8", errors="xmlcharrefreplace")
    if len(text) > SIZE_LIMIT:
        raise UrdfError(f"{label}: has more than {SIZE_LIMIT} bytes, expected at most that")
    start = text.removeprefix(b"\xef\xbb\xbf")
    head = start.lstrip()[:12]
    if not head:
        raise UrdfError(f"{label}: is empty, expected a <robot> element")
    if not head.startswith(b"<") or b"\0" in text:
        raise UrdfError(f"{label}: starts with {literal(head)} and is no XML text, expected a <robot> element")
    at = _root_at(start)
    if start[at : at + 9].upper() == b"<!DOCTYPE":
        shown = start[at : at + 40].split(b"\n")[0].decode("utf-8", errors="replace")
        line = start.count(b"\n", 0, at) + 1
        raise UrdfError(
            f"{label}:{line}: has the document type {literal(shown)}, expected none (no entity is ever read)"
        )
    return label, start


def _root_at(text: bytes) -> int:
    """Offset of the outermost element, or of what is in its place."""
    at = 0
    while part := _BEFORE_ROOT.match(text, at):
        at = part.end()
    return at


def _declaring(text: bytes, prefixes: Iterable[str]) -> bytes:
    """The XML with prefixes declared in its outermost element; line numbers stay."""
    tag = re.compile(rb"<[^\s/>]+").match(text, _root_at(text))
    at = tag.end() if tag else 0
    declared = "".join(f' xmlns:{prefix}="{_UNDECLARED}{prefix}"' for prefix in prefixes)
    return text[:at] + declared.encode() + text[at:]


class Part(NamedTuple):
    """A checked element: its known attributes, numbers as floats, and its known children.

    values    {attribute: name, number or three numbers}, without those left out
    children  in the order of the file
    """

    tag: str
    values: dict[str, Any]
    children: list[Part]


class StrictReader:
    """Reads one URDF strictly: ``read`` returns its Part, ``where`` file and line, ``notes`` the oddities.

    ``doubts`` are the notes that deserve a warning: leftovers that hold no link or joint, and those that may, where
    ``skip_leftovers`` leaves them out, as Pinocchio's reader does.
    """

    def __init__(self, label: str, snap: float | None, skip_leftovers: bool = False) -> None:
        self.label = label
        self.snap = snap
        self.skip_leftovers = skip_leftovers
        self.lines: dict[tuple[str, str], int] = {}
        self.notes: list[str] = []
        self.doubts: list[str] = []
        self._ignored: Counter[str] = Counter()
        self._left: Counter[str] = Counter()
        self._skipped: Counter[str] = Counter()
        self._without_axis: dict[str, None] = {}  # joints, each once
        self._undeclared: list[str] = []
        self._angles: list[float] = []

    def where(self, kind: str, name: str) -> str:
        """``file:line: `` of a link or joint, else ``file: ``."""
        line = self.lines.get((kind, name))
        return f"{self.label}: " if line is None else f"{self.label}:{line}: "

    def read(self, data: bytes) -> Part:
        """The robot, with only what dynamics needs, all of it checked. Raises UrdfError."""
        root = self._parse(data)
        if root.getroottree().docinfo.internalDTD is not None:
            raise UrdfError(f"{self.label}: has a document type, expected none (no entity is ever read)")
        if self._tag(root) != "robot":
            other = OTHERS.get(self._tag(root))
            hint = f", for {other} is not read" if other else ""
            self._refuse(root, f"<{_short(str(root.tag))}> is the outermost element, expected <robot>{hint}")
        robot = self._part(root, "robot", "")
        self.doubts += [
            f"ignored, as it holds no link or joint: {what} ({n}x)" for what, n in sorted(self._left.items())
        ]
        if self._skipped:
            what = ", ".join(f"{what} ({n}x)" for what, n in sorted(self._skipped.items()))
            self.doubts.append(f"not read, as Pinocchio does not, though it may stand for links and joints: {what}")
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
        return robot

    def outermost(self, data: bytes) -> Any:
        """The element of a text that ``read`` has read, for what it leaves out."""
        return self._parse(data)

    def _parse(self, data: bytes) -> Any:
        """The outermost element; undeclared prefixes get a namespace. Raises UrdfError."""
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
        """The element's name; empty for comments, other namespaces and xacro's definitions.

        Raises UrdfError for what may stand for a link or joint, or returns an empty name if such leftovers are skipped.
        """
        what, expected = self._leftover(element)
        if what and not self.skip_leftovers:
            self._refuse(element, f"{what} {expected}")
        name = element.tag
        if not isinstance(name, str):
            return ""
        if name[0] != "{":  # of no namespace
            return name
        return "" if element.prefix or _is_xacro(element) else name.rpartition("}")[2]

    def _leftover(self, element: Any) -> tuple[str, str]:
        """What may stand for a link or joint, and what was expected: elements of xacro that are no definitions, and of
        undeclared prefixes; empty for other elements.
        """
        if not isinstance(element.tag, str) or element.tag[0] != "{":
            return "", ""
        space, _, tag = element.tag.rpartition("}")
        if _is_xacro(element):
            if tag in (*_DEFINITIONS, *_CONDITIONS) and not _stands_for_elements(element):
                return "", ""
            return f"<xacro:{tag}>", "is left, expected a URDF in which xacro has expanded every macro"
        if space[1:].startswith(_UNDECLARED):
            shown = f"<{_short(space[1 + len(_UNDECLARED) :])}:{_short(tag)}>"
            return shown, "has a prefix that no xmlns declares, expected one that is declared, or none"
        return "", ""

    def _part(self, element: Any, tag: str, owner: str) -> Part:
        """The Part of an element, with its known attributes and children; ``owner`` is its link or joint."""
        values: dict[str, Any] = {}
        for key, (required, kind) in _ATTRIBUTES[tag].items():
            value = self._value(element, tag, key, required, kind, owner)
            if value is not None:
                values[key] = value
            if key == "name":
                owner = f'{tag} "{value}"'
                self.lines[tag, value] = element.sourceline
        for key in element.attrib:
            if key not in _ATTRIBUTES[tag] and not key.startswith("{") and f"@{key}" not in _OF_NO_CONCERN.get(tag, ()):
                self._ignored[f"attribute {_short(key)} of <{tag}>"] += 1
        part = Part(tag, values, self._children(element, tag, owner) if tag in _CHILDREN else [])
        if tag == "joint":
            self._check_joint(element, part, owner)
        return part

    def _children(self, element: Any, tag: str, owner: str) -> list[Part]:
        """The known children of an element that may have some."""
        known, made, seen = _CHILDREN[tag], [], set()
        for child in element:
            name = self._tag(child)
            if name == "axis" and child.get("xyz") is None and element.get("type") not in WITH_AXIS:
                self._without_axis.setdefault(element.get("name"))
            elif name in known:
                if tag != "robot" and name in seen:
                    self._refuse(child, f"<{tag}> of {owner} has a second <{name}>, expected one")
                seen.add(name)
                made.append(self._part(child, name, owner))
            elif name and name not in _OF_NO_CONCERN.get(tag, ()):
                self._ignored[f"<{_short(name)}> in <{tag}>"] += 1
            elif leftover := self._leftover(child)[0]:
                self._skipped[leftover] += 1
            elif not name and isinstance(child.tag, str) and _is_xacro(child):
                self._left[f"<xacro:{child.tag.rpartition('}')[2]}>"] += 1
        for name, required in known.items():
            if required and name not in seen:
                self._refuse(element, f"<{tag}> of {owner} has no <{name}>, expected one")
        return made

    def _value(self, element: Any, tag: str, name: str, required: bool, kind: str, owner: str) -> Any:
        """The value of an attribute: a name, a float or a list of three; None if it is left out."""
        value = element.get(name)
        of = f" of {owner}" if owner else ""
        if value is None:
            if required:
                self._refuse(element, f"<{tag}>{of} has no attribute {name}, expected {_WANTED[kind]}")
            return None
        problem, numbers = _numbers(value, kind)
        if problem:
            self._refuse(element, f'<{tag} {name}="{_short(value)}">{of} {problem}, expected {_WANTED[kind]}')
        if name == "rpy":
            self._angles += numbers
            numbers = [snapped(angle, self.snap) for angle in numbers]
        return value if not numbers else numbers if kind == "three numbers" else numbers[0]

    def _check_joint(self, element: Any, joint: Part, owner: str) -> None:
        """Checks of a whole joint: raises UrdfError for a null axis, lower > upper, or a mimic of itself."""
        kind, name = joint.values["type"], joint.values["name"]
        for child in element:
            tag = self._tag(child)
            if tag == "axis" and kind in WITH_AXIS and not any(map(float, child.get("xyz").split())):
                self._refuse(child, f'<axis xyz="{child.get("xyz")}"> of {owner} has norm 0, expected a nonzero vector')
            if tag == "limit" and kind in LIMITED:
                lower, upper = (float(child.get("lower", 0)), float(child.get("upper", 0)))
                if not lower <= upper:
                    self._refuse(child, f'<limit lower="{lower}" upper="{upper}"> of {owner}, expected lower <= upper')
                if lower == math.inf or upper == -math.inf:
                    self._refuse(child, f'<limit lower="{lower}" upper="{upper}"> of {owner} leaves no position')
            if tag == "mimic" and child.get("joint") == name:
                self._refuse(
                    child, f'<mimic joint="{child.get("joint")}"> of {owner} names itself, expected another joint'
                )


def _is_xacro(element: Any) -> bool:
    """Whether an element is of xacro, which goes by the prefix alone; by its namespace too, where that names xacro."""
    return element.prefix == "xacro" or "xacro" in element.tag.rpartition("}")[0]


def _stands_for_elements(element: Any) -> bool:
    """Whether a definition or condition of xacro holds a link or joint, what may become one, or what is read here."""
    for inner in element.iterdescendants("*"):
        tag = inner.tag.rpartition("}")[2]
        if tag in ("link", "joint") or (_is_xacro(inner) and tag not in (*_DEFINITIONS, *_CONDITIONS)):
            return True
    owner = element.getparent()
    read = {} if owner is None else _CHILDREN.get(owner.tag.rpartition("}")[2], {})
    return not _given(element).isdisjoint(read)


def _given(element: Any) -> set[str]:
    """Names of the elements that a condition of xacro gives to what holds it, also through conditions inside it."""
    tag = element.tag.rpartition("}")[2]
    if not _is_xacro(element):
        return {tag}
    return set().union(*map(_given, element.iterchildren("*"))) if tag in _CONDITIONS else set()


def _numbers(value: str, kind: str) -> tuple[str, list[float]]:
    """The defect of an attribute of a kind, in words, or an empty string; and its numbers, if any."""
    if kind == "name":
        return ("" if value.strip() else "is empty"), []
    if kind == "joint type":
        return ("" if value in URDF_KINDS else "is not a joint type of URDF"), []
    parts = value.split()
    wanted = 3 if kind == "three numbers" else 1
    for part in parts:
        if not is_number(part):
            return f"holds {_short(part)!r}, which is no number", []
    if len(parts) != wanted:
        return f"has {len(parts)} number{'s' * (len(parts) != 1)}", []
    numbers = list(map(float, parts))
    if kind == "bound":
        return ("is not a number" if math.isnan(numbers[0]) else ""), numbers
    if not all(map(math.isfinite, numbers)):
        return "is not finite", numbers
    if kind == "mass" and numbers[0] < 0.0:
        return "is negative", numbers
    return "", numbers


def _short(text: str) -> str:
    """Text cut to 60 characters, on one line."""
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
