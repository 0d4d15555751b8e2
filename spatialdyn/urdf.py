"""From a URDF to a checked Robot: where the text comes from, a strict reading of it, and the numbers.

A source becomes bytes; a strict pass over its XML refuses what is broken, naming file, line, element, attribute and
value, and keeps only what dynamics needs; yourdfpy reads that copy, so it never meets a mesh, nor anything that it
would silently repair; its description becomes a ``Robot``. What is odd but sound is kept and said in ``Robot.notes``.

yourdfpy and lxml cost a second to import: they are imported inside the functions that read.
"""

from __future__ import annotations

import difflib
import io
import math
import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InertiaError, ModelError, UrdfError
from .model import Model, assemble
from .robot import (
    WITH_AXIS,
    Joint,
    Link,
    Mimic,
    Robot,
    check_inertias,
    check_tree,
    make_joint,
    make_link,
    nowhere,
    pose_matrix,
    quoted,
    rpy_matrix,
)

Array = NDArray[np.float64]
Where = Callable[[str, str], str]  # ("link" | "joint", name) -> where it stands, a prefix of messages

URDF_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
LIMITED = ("revolute", "prismatic")
SIZE_LIMIT = 64 * 2**20  # bytes; the largest robot of example-robot-data has 0.2 MB
RIGHT = 0.5 * math.pi
NEAR = 1e-9  # rad: an angle this close to a right one, but not at it, was meant to be one


def load_urdf(
    source: Any,
    root: str = "fixed",
    gravity: ArrayLike = (0.0, 0.0, -9.81),
    continuous: str = "angle",
    mimic: bool = False,
    inertia: str = "warn",
    snap: float | None = None,
) -> Model:
    """The Model of a robot described in URDF.

    source      path; URDF text (str or bytes that start with ``<``); open file; ``yourdfpy.URDF``; or the name of a
                robot in ``urdf/`` or in the installed example-robot-data (``find_robot`` has the rule)
    root        "fixed", or "floating": the root link gets six freedoms
    gravity     (3,) acceleration of gravity in the world [m/s²]
    continuous  "angle": one coordinate; "cos_sin": Pinocchio's pair
    mimic       True makes mimic joints dependent; False treats them as ordinary joints
    inertia     on inertias no body can have: "warn" keeps them, "strict" raises, "repair" projects them
    snap        angles of placements within ``snap`` [rad] of a right angle are rounded to it; None rounds none

    A ``yourdfpy.URDF`` skips the strict reading of the XML (it may have been read with repairs); its values are still
    checked.

    Raises  UrdfError naming file, line, element, attribute and value; InertiaError under ``inertia="strict"``;
            ModelError for a bad ``root``, ``continuous`` or mimic chain.

    >>> load_urdf("pendulum").nv
    1
    """
    robot, where = _read(source, inertia, snap, stacklevel=4)
    if mimic:
        _check_leaders(robot, where)
    return assemble(robot, root=root, gravity=gravity, continuous=continuous, mimic=mimic)


def read_urdf(source: Any, inertia: str = "warn", snap: float | None = None) -> Robot:
    """The checked Robot of a URDF: ``load_urdf`` before it becomes a table. Arguments and errors are the same."""
    return _read(source, inertia, snap, stacklevel=4)[0]


def _read(source: Any, inertia: str, snap: float | None, stacklevel: int) -> tuple[Robot, Where]:
    """The robot, and where its links and joints stand."""
    if snap is not None and not (0.0 <= snap < 0.5 * RIGHT):
        raise UrdfError(f"snap is {snap!r}, expected an angle from 0 to pi/4, or None")
    if _is_yourdfpy(source):
        robot = _robot(source.robot, nowhere, [], snap)
        return check_inertias(robot, inertia, stacklevel=stacklevel), nowhere
    label, data = _bytes_of(source)
    reader = _StrictReader(label, snap)
    sound = reader.read(data)
    import yourdfpy

    description = yourdfpy.URDF.load(io.BytesIO(sound), build_scene_graph=False, load_meshes=False).robot
    robot = _robot(description, reader.where, reader.notes, None)
    return check_inertias(robot, inertia, reader.where, stacklevel), reader.where


def _check_leaders(robot: Robot, where: Where) -> None:
    """Refuse a mimic of a joint that is not there: an error only once mimics count."""
    names = {joint.name for joint in robot.joints}
    for joint in robot.joints:
        if joint.mimic is not None and joint.mimic.leader not in names:
            raise UrdfError(
                f'{where("joint", joint.name)}<mimic joint="{joint.mimic.leader}"> of joint "{joint.name}" '
                f'names no joint of robot "{robot.name}", expected one'
            )


# --- where the text comes from ----------------------------------------------------------------------------


def _is_yourdfpy(source: Any) -> bool:
    """Whether the source is a yourdfpy.URDF; importing nothing, for it cannot be one unless yourdfpy is imported."""
    module = sys.modules.get("yourdfpy")
    return module is not None and isinstance(source, module.URDF)


def _bytes_of(source: Any) -> tuple[str, bytes]:
    """A name for messages, and the XML in UTF-8 or the encoding it declares. Raises UrdfError."""
    if isinstance(source, (bytes, bytearray)):
        return _checked("<text>", bytes(source))
    if isinstance(source, str):
        if source.lstrip("\ufeff \t\r\n").startswith("<"):
            return _checked("<text>", source)
        return _read_path(_path_of(source))
    if isinstance(source, os.PathLike):
        return _read_path(Path(os.fsdecode(source)))
    if hasattr(source, "read"):
        name = getattr(source, "name", None)
        label = os.path.basename(name) if isinstance(name, str) else "<file>"
        try:
            return _checked(label, source.read(SIZE_LIMIT + 1))
        except UnicodeDecodeError as error:
            raise UrdfError(f"{label}: is no text ({error.reason}), expected a <robot> element") from None
    raise UrdfError(
        f"source is of type {type(source).__name__}, expected a path, URDF text, an open file, a yourdfpy.URDF "
        "or the name of a robot"
    )


def _read_path(path: Path) -> tuple[str, bytes]:
    if path.is_dir():
        raise UrdfError(f"{path} is a directory, expected a URDF file")
    try:
        size = path.stat().st_size
        if size > SIZE_LIMIT:
            raise UrdfError(f"{path.name}: has {size} bytes, expected at most {SIZE_LIMIT}")
        with path.open("rb") as file:
            return _checked(path.name, file.read(SIZE_LIMIT + 1))
    except FileNotFoundError:
        raise UrdfError(f"{path}: no such file, expected a URDF file") from None
    except (OSError, ValueError) as error:
        if isinstance(error, UrdfError):
            raise
        raise UrdfError(f"{path}: cannot be read ({error}), expected a URDF file") from error


_BEFORE_ROOT = re.compile(rb"\s+|<\?.*?\?>|<!--.*?-->", re.DOTALL)


def _checked(label: str, text: str | bytes) -> tuple[str, bytes]:
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


# --- robots by name ---------------------------------------------------------------------------------------


def _own_folder() -> Path:
    """The folder of the package's own models: inside it in a wheel, beside it in a checkout."""
    package = Path(__file__).resolve().parent
    inside = package / "urdf_files"
    return inside if inside.is_dir() else package.parent / "urdf"


def _example_folder() -> Path | None:
    """The folder of robots of the installed example-robot-data, a package of files only; None if there is none."""
    share = Path("share", "example-robot-data", "robots")
    places = [Path(entry, "cmeel.prefix", share) for entry in sys.path if entry]
    prefixes = [sys.prefix, os.environ.get("CONDA_PREFIX") or sys.prefix]
    places += [Path(prefix, *inner, share) for prefix in prefixes for inner in ((), ("Library",))]
    return next((place for place in places if place.is_dir()), None)


def example_robots() -> list[Path]:
    """The URDF files of the installed example-robot-data, sorted; empty if it is not installed."""
    folder = _example_folder()
    return sorted(folder.rglob("*.urdf")) if folder else []


def robot_names() -> dict[str, Path]:
    """Every robot that can be loaded by name, with its file: our own first, then example-robot-data.

    The name is the file's without its suffix; where several files share it, their folder stands before it.
    """
    own = {path.stem: path for path in sorted(_own_folder().glob("*.urdf"))}
    examples = example_robots()
    count = Counter([path.stem for path in examples] + list(own))
    folder = _example_folder() or Path()
    for path in examples:
        name = path.stem if count[path.stem] == 1 else f"{path.relative_to(folder).parts[0]}/{path.stem}"
        own.setdefault(name, path)
    return own


def find_robot(name: str) -> Path:
    """The file of the robot called ``name``, in ``urdf/``, then in the installed example-robot-data.

    The first of these rules that finds a file decides; the name may be led by folders, as in ``b1_description/b1``:

    1. a file NAME.urdf ("panda"; "anymal" is two files, so it needs its folder);
    2. a file NAME_robot.urdf ("ur5");
    3. files NAME_*.urdf, if all extend one of them ("talos_full": talos_full_v2, although there is talos_full_v2_box);
    4. the only file of a folder NAME_* ("hector").

    Raises UrdfError listing the candidates if there are several, or close names if there is none.
    """
    *folders, stem = name.split("/")
    own = _own_folder() / f"{stem}.urdf"
    if not folders and stem and own.is_file():
        return own
    base = _example_folder() or Path()
    pool = {path: path.relative_to(base).parts[:-1] for path in example_robots()}
    pool = {path: inside for path, inside in pool.items() if _in_order(folders, inside)}
    longer = [path for path in pool if path.stem.startswith(stem + "_")]
    least = min(longer, key=lambda path: len(path.stem), default=None)
    if least and all(p == least or p.stem.startswith(least.stem + "_") for p in longer):
        longer = [least]
    rules = (
        [path for path in pool if path.stem == stem],
        [path for path in pool if path.stem == stem + "_robot"],
        longer,
        [path for path, inside in pool.items() if inside and f"{inside[0]}_".startswith(f"{stem}_")],
    )
    found = next((paths for paths in rules if paths and stem), [])
    if len(found) == 1:
        return found[0]
    names = {path: label for label, path in robot_names().items()}
    if found:
        raise UrdfError(f'robot name "{name}" is ambiguous, expected one of {quoted((names[p] for p in found), 20)}')
    close = difflib.get_close_matches(name, names.values(), n=3, cutoff=0.5)
    hint = f"; close names are {quoted(close)}" if close else ""
    hint += "" if example_robots() else "; example-robot-data is not installed"
    raise UrdfError(f"{_short(name)!r} is neither a file nor the name of a robot, expected one of them{hint}")


def _in_order(some: Sequence[str], of: Sequence[str]) -> bool:
    """Whether the folders named occur in a path, in their order."""
    rest = iter(of)
    return all(folder in rest for folder in some)


def _path_of(source: str) -> Path:
    """A string as a path if there is such a file, else as a name, else as the path it was meant to be."""
    path = Path(source)
    if os.path.isfile(source) or path.suffix in (".urdf", ".xml", ".xacro") or path.is_absolute():
        return path
    try:
        return find_robot(source)
    except UrdfError:
        if source and os.path.isdir(source):
            return path
        raise


# --- the strict reading -----------------------------------------------------------------------------------

# What an element may hold. An attribute ends in ! where it is required; its kind says how it is checked.
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
    "limit": {
        "lower": "bound",
        "upper": "bound",
        "velocity": "bound",
        "effort": "bound",
    },
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
    "robot": (
        "material",
        "transmission",
        "gazebo",
        "sensor",
        "ros2_control",
        "@version",
    ),
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
_NUMBER = re.compile(
    r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|inf(?:inity)?|nan)",
    re.IGNORECASE,
)


class _StrictReader:
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
            self._refuse(
                root,
                f"<{_short(str(root.tag))}> is the outermost element, expected <robot>",
            )
        sound = self._copy(root, "")
        self.notes += [
            f"ignored, as URDF does not define it: {what} ({n}x)" for what, n in sorted(self._ignored.items())
        ]
        self.notes += _angle_notes(self._angles, self.snap)
        return bytes(etree.tostring(sound))

    def _refuse(self, element: Any, message: str) -> NoReturn:
        raise UrdfError(f"{self.label}:{element.sourceline}: {message}")

    def _tag(self, element: Any) -> str:
        """The element's name; empty for comments and for other people's namespaces."""
        if not isinstance(element.tag, str):
            return ""
        space, _, tag = element.tag.rpartition("}")
        if "xacro" in space:
            self._refuse(
                element,
                f"<xacro:{tag}> is left, expected a URDF in which xacro has expanded every macro",
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
                self._refuse(
                    element,
                    f"<{sound.tag}>{of} has no attribute {name}, expected {_WANTED[kind]}",
                )
            return
        problem, numbers = _numbers(value, kind)
        if problem:
            shown = f'<{sound.tag} {name}="{_short(value)}">'
            self._refuse(element, f"{shown}{of} {problem}, expected {_WANTED[kind]}")
        if name == "rpy":
            self._angles += numbers
            numbers = [_snapped(angle, self.snap) for angle in numbers]
        sound.set(name, " ".join(map(repr, numbers)) if numbers else value)

    def _check_joint(self, element: Any, joint: Any, owner: str) -> None:
        """What only shows once the whole joint is read: a null axis, limits the wrong way round, mimic of itself."""
        for child in element:
            tag = self._tag(child)
            if tag == "axis" and joint.get("type") in WITH_AXIS and not any(map(float, child.get("xyz").split())):
                self._refuse(
                    child,
                    f'<axis xyz="{child.get("xyz")}"> of {owner} has norm 0, expected a nonzero vector',
                )
            if tag == "limit" and joint.get("type") in LIMITED:
                lower, upper = (
                    float(child.get("lower", 0)),
                    float(child.get("upper", 0)),
                )
                if not lower <= upper:
                    self._refuse(
                        child,
                        f'<limit lower="{lower}" upper="{upper}"> of {owner}, expected lower <= upper',
                    )
                if lower == math.inf or upper == -math.inf:
                    self._refuse(
                        child,
                        f'<limit lower="{lower}" upper="{upper}"> of {owner} leaves no position',
                    )
            if tag == "mimic" and child.get("joint") == joint.get("name"):
                self._refuse(
                    child,
                    f'<mimic joint="{child.get("joint")}"> of {owner} names itself, expected another joint',
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


def _off_right(angle: float) -> float:
    """Distance of an angle from the nearest multiple of a right angle [rad]."""
    return abs(angle - round(angle / RIGHT) * RIGHT)


def _snapped(angle: float, snap: float | None) -> float:
    return angle if snap is None or _off_right(angle) > snap else round(angle / RIGHT) * RIGHT


def _angle_notes(angles: Iterable[float], snap: float | None) -> list[str]:
    near = NEAR if snap is None else snap
    count = sum(4e-16 * max(1.0, abs(angle)) < _off_right(angle) <= near for angle in angles)
    if not count:
        return []
    what = f"{count} angle{'s' * (count > 1)} within {near:g} of a right angle"
    return [f"{what} kept as written (snap={near:g} rounds them)" if snap is None else f"{what} rounded to it"]


def _rpy_of(R: Array) -> list[float]:
    """Roll, pitch, yaw of a rotation; at a right angle of pitch, where only one of the others counts, the roll is 0."""
    cos_pitch = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], cos_pitch)
    if cos_pitch < NEAR:
        return [0.0, pitch, math.atan2(-R[0, 1], R[1, 1])]
    return [math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])]


# --- from a description to a Robot ------------------------------------------------------------------------


def _robot(description: Any, where: Where, notes: list[str], snap: float | None) -> Robot:
    """The Robot of a yourdfpy description, its values checked. Raises UrdfError naming the link or joint."""
    for kind, things in (
        ("robot", [description]),
        ("link", description.links),
        ("joint", description.joints),
    ):
        for thing in things:
            if not isinstance(thing.name, str) or not thing.name.strip():
                raise UrdfError(f"{where('', '')}a {kind} has name {thing.name!r}, expected a name")
    angles: list[float] = []
    links = [_at(where("link", link.name), _link, link, snap, angles) for link in description.links]
    joints = [_at(where("joint", joint.name), _joint, joint, snap, angles) for joint in description.joints]
    notes = notes + _link_notes(description) + _joint_notes(description)
    if where is nowhere:  # else the strict reading has counted them, as they were written
        notes += _angle_notes(angles, snap)
    return _at("", check_tree, description.name, links, joints, notes, where)


def _at(place: str, make: Callable[..., Any], *arguments: Any) -> Any:
    """``make(*arguments)``; what it refuses becomes a UrdfError that begins with the place."""
    try:
        return make(*arguments)
    except (InertiaError, ModelError, UrdfError) as error:
        raise UrdfError(f"{place}{error}") from None


def _pose(origin: Any, what: str, snap: float | None, angles: list[float]) -> Array:
    """A yourdfpy origin as a pose (4, 4), rotation entries below 1e-15 zero; its angles are added to ``angles``."""
    X = pose_matrix(origin, what)
    R = X[:3, :3]
    rpy = _rpy_of(R)
    angles += rpy
    if snap is not None and any(0.0 < _off_right(angle) <= snap for angle in rpy):
        R[:] = rpy_matrix(*(_snapped(angle, snap) for angle in rpy))
    R[abs(R) < 1e-15] = 0.0
    return X


def _link(link: Any, snap: float | None, angles: list[float]) -> Link:
    """A Link in its own frame; without <inertial> it has no mass."""
    given = link.inertial
    if given is None:
        return Link(link.name)
    for part in ("mass", "inertia"):
        if getattr(given, part) is None:
            raise UrdfError(f'<inertial> of link "{link.name}" has no {part}, expected one')
    X = _pose(given.origin, f'<origin> of <inertial> of link "{link.name}"', snap, angles)
    R = X[:3, :3]
    made = make_link(link.name, (given.mass, X[:3, 3], given.inertia))
    I = R @ np.reshape(made.inertia, (3, 3)) @ R.T
    return make_link(link.name, (given.mass, X[:3, 3], 0.5 * (I + I.T)))


def _joint(joint: Any, snap: float | None, angles: list[float]) -> Joint:
    """A Joint; what its kind has no use for (the limits of a continuous joint, say) is left out."""
    if joint.type not in URDF_KINDS:
        raise UrdfError(f'joint "{joint.name}" has type {joint.type!r}, expected one of {", ".join(URDF_KINDS)}')
    limit, dynamics, mimic = joint.limit, joint.dynamics, joint.mimic
    lower, upper = -math.inf, math.inf
    if limit is not None and joint.type in LIMITED:
        lower, upper = _or(limit.lower, 0.0), _or(limit.upper, 0.0)
    velocity, effort = (math.inf if limit is None else _or(getattr(limit, k), math.inf) for k in ("velocity", "effort"))
    return make_joint(
        Joint(
            joint.name,
            joint.type,
            joint.parent,
            joint.child,
            tuple(_pose(joint.origin, f'<origin> of joint "{joint.name}"', snap, angles).ravel().tolist()),
            tuple(np.ravel((1.0, 0.0, 0.0) if joint.axis is None else joint.axis).tolist()),
            lower,
            upper,
            math.inf if velocity < 0.0 else velocity,
            math.inf if effort < 0.0 else effort,
            0.0 if dynamics is None else _or(dynamics.damping, 0.0),
            0.0 if dynamics is None else _or(dynamics.friction, 0.0),
            mimic=None if mimic is None else Mimic(mimic.joint, _or(mimic.multiplier, 1.0), _or(mimic.offset, 0.0)),
        )
    )


def _or(value: Any, default: float) -> float:
    """A number that may be missing, or still be text (yourdfpy leaves damping and friction so)."""
    return default if value is None else float(value)


# --- what is odd but sound --------------------------------------------------------------------------------


def _note(names: list[str], one: str, many: str) -> list[str]:
    """A note about a link or joint, or about many of them; none if there are no names."""
    return [f"{one if len(names) == 1 else f'{len(names)} {many}'}: {quoted(names)}"] if names else []


def _link_notes(description: Any) -> list[str]:
    moved = {joint.child for joint in description.joints if joint.type != "fixed"}
    bare = [link.name for link in description.links if link.inertial is None and link.name in moved]
    empty = [link.name for link in description.links if link.inertial is not None and link.inertial.mass == 0.0]
    turning = [link.name for link in description.links if link.name in empty and np.any(link.inertial.inertia)]
    return [
        *_note(
            bare,
            "link that moves has no <inertial>",
            "links that move have no <inertial>",
        ),
        *_note(empty, "link has mass 0", "links have mass 0"),
        *_note(
            turning,
            "link has mass 0 but a rotational inertia",
            "links have mass 0 but a rotational inertia",
        ),
    ]


def _joint_notes(description: Any) -> list[str]:
    names = {joint.name for joint in description.joints}
    limited = [joint for joint in description.joints if joint.type in LIMITED]
    free = [joint.name for joint in limited if joint.limit is None]
    bounded = [joint for joint in limited if joint.limit is not None]
    partial = [joint.name for joint in bounded if joint.limit.lower is None or joint.limit.upper is None]
    negative = [
        joint.name
        for joint in description.joints
        if joint.limit is not None and min(_or(joint.limit.velocity, 0.0), _or(joint.limit.effort, 0.0)) < 0.0
    ]
    skewed = [
        joint.name
        for joint in description.joints
        if joint.type in WITH_AXIS and joint.axis is not None and abs(np.linalg.norm(joint.axis) - 1.0) > 1e-6
    ]
    lost = [j.name for j in description.joints if j.mimic is not None and j.mimic.joint not in names]
    return [
        *_note(
            free,
            "joint has no <limit>, so it is unlimited",
            "joints have no <limit>, so they are unlimited",
        ),
        *_note(
            partial,
            "<limit> lacks lower or upper, taken as 0",
            "<limit>s lack lower or upper, taken as 0",
        ),
        *_note(
            negative,
            "velocity or effort limit < 0 is none",
            "velocity or effort limits < 0 are none",
        ),
        *_note(
            skewed,
            "axis is not of unit length, normalised",
            "axes are not of unit length, normalised",
        ),
        *_note(
            lost,
            "<mimic> names no joint of the robot",
            "<mimic>s name no joint of the robot",
        ),
    ]
