"""``load``: a robot from a file, text or name of any format, by the reader of that format."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from ..errors import SpatialDynError, UrdfError, literal, pip_install
from ..model.model import Model
from ..urdf.load import find_robot, load_urdf, robot_names
from ..urdf.sources import is_yourdfpy
from ..urdf.strict_xml import SIZE_LIMIT
from ..waiting import watch
from .descriptions import description_file, description_names
from .mjmodel import from_mjmodel, need_mujoco
from .xacro import is_xacro, urdf_of_xacro

EARTH = (0.0, 0.0, -9.81)
OTHERS = (".xml", ".xacro", ".mjcf", ".mjb", ".sdf", ".world")  # endings of files that are no URDF
BEFORE_ROOT = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s+|<\?.*?\?>|<!--.*?-->|<!DOCTYPE[^>]*>)*<([^\s/>!?]+)", re.DOTALL)
SDF = (
    "is SDF, which no reader here takes, expected URDF or MJCF: the package sdformat-mjcf makes MJCF of SDF, which "
    "sd.load reads"
)


@watch.call("load")
def load(
    source: Any,
    root: str = "fixed",
    gravity: ArrayLike | None = None,
    continuous: str = "angle",
    mimic: bool = False,
    inertia: str = "warn",
    snap: float | None = None,
    xacro: Mapping[str, Any] | None = None,
) -> Model:
    """The Model of a robot of any format: URDF, MJCF, xacro, or a name.

    source   path, text (str or bytes), open file; name of a robot in ``urdf/``, example-robot-data or
             robot_descriptions ("panda_mj_description"); ``mujoco.MjModel``, ``mujoco.MjSpec``, ``yourdfpy.URDF``
    gravity  (3,) [m/s²]; if left out, that of an MJCF file, else (0, 0, -9.81)
    xacro    {argument: value} of a xacro file, may be empty
    root, continuous, mimic, inertia, snap  as in ``load_urdf``; snap for URDF only

    The outermost element determines the reader: ``<robot>`` goes to ``load_urdf``, ``<mujoco>`` to MuJoCo (pip install
    mujoco), whose compiled model ``from_mjmodel`` reads. A file is xacro if it has that suffix, or if ``xacro`` is
    given: the package xacrodoc expands it, and evaluates the Python expressions in it. Compiled MuJoCo models (.mjb)
    are read too. SDF is refused; the error names a package that reads it.

    Names of robot_descriptions are looked up last. At the first use of such a name that package clones a repository,
    and a UserWarning says so.

    Further declarations of the file act in the scene ``sd.Scene.of(model)``: damping, friction, limits; from MJCF also
    loops, contacts of feet with its ground and DC motors. ``model.notes`` lists the declarations without a counterpart.

    Raises  UrdfError; SpatialDynError for a source that is no robot, another format, MJCF that MuJoCo refuses, a
            missing package; otherwise as ``load_urdf``

    >>> load("pendulum") == load_urdf("pendulum")
    True
    """
    options: dict[str, Any] = {"root": root, "continuous": continuous, "mimic": mimic, "inertia": inertia}
    urdf = {**options, "gravity": EARTH if gravity is None else gravity, "snap": snap}
    mjcf = {**options, "gravity": gravity}
    if xacro is not None and not isinstance(xacro, Mapping):
        raise SpatialDynError(f"xacro is {literal(xacro)}, expected a mapping of arguments to values")
    kind = type(source)
    if kind.__module__.partition(".")[0] == "mujoco" and kind.__name__ in ("MjModel", "MjSpec"):
        return from_mjmodel(source, **_without_snap(mjcf, snap))
    if is_yourdfpy(source):
        return load_urdf(source, **urdf)
    data, path = _read(source)
    if xacro is not None or (path and is_xacro(path)):
        return load_urdf(urdf_of_xacro(data, path, xacro or {}), **urdf)
    if path.endswith(".mjb"):
        return from_mjmodel(_compiled(None, path), **_without_snap(mjcf, snap))
    tag = outermost(data)
    if tag == "mujoco":
        return from_mjmodel(_compiled(data, path), **_without_snap(mjcf, snap))
    if tag == "sdf":
        raise SpatialDynError(f"{path or '<text>'} {SDF}")
    return load_urdf(path or (source if data is None else data), **urdf)


def _without_snap(options: dict[str, Any], snap: float | None) -> dict[str, Any]:
    if snap is not None:
        raise SpatialDynError(f"snap is {literal(snap)}, expected None: it is of URDF alone")
    return options


def outermost(data: bytes | None) -> str:
    """The tag of the outermost element; empty if there is none."""
    found = BEFORE_ROOT.match(data or b"")
    return found[1].decode(errors="replace") if found else ""


def _read(source: Any) -> tuple[bytes | None, str]:
    """The bytes of a source and the path of its file, empty if it has none; None for what ``load_urdf`` refuses."""
    if isinstance(source, (bytes, bytearray)):
        return bytes(source), ""
    if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<"):
        return source.encode("utf-8", errors="xmlcharrefreplace"), ""
    if isinstance(source, (str, os.PathLike)):
        path = _file(os.fsdecode(source) if isinstance(source, os.PathLike) else source)
        try:
            with Path(path).open("rb") as file:
                return (b"" if path.endswith(".mjb") else file.read(SIZE_LIMIT + 1)), os.path.abspath(path)
        except (OSError, ValueError) as error:
            if isinstance(error, FileNotFoundError) and Path(path).suffix.lower() in OTHERS:
                raise UrdfError(f"{path}: no such file, expected a robot's: MJCF, xacro or URDF") from None
            return None, ""  # load_urdf says what is wrong
    if hasattr(source, "read"):
        given = source.read(SIZE_LIMIT + 1)
        return (given.encode("utf-8", errors="xmlcharrefreplace") if isinstance(given, str) else bytes(given)), ""
    return None, ""


def _file(name: str) -> str:
    """The file that a path or a name means: a file, a robot's by name, then that of a robot_descriptions name."""
    looks = Path(name).suffix.lower() in (".urdf", *OTHERS)
    if not name or "\0" in name or os.path.isfile(name) or looks or os.path.isabs(name) or os.path.isdir(name):
        return name
    try:
        return str(find_robot(name))
    except UrdfError as error:
        if name in description_names():
            return description_file(name)
        near = difflib.get_close_matches(name, [*description_names(), *robot_names()], 3, 0.6)
        more = [x for x in near if x in description_names()]
        hint = f"; of robot_descriptions: {', '.join(more)}" if more else ""
        if name.endswith("_description") and not description_names():
            hint = f"; robot_descriptions is not installed; {pip_install('descriptions')}"
        raise UrdfError(f"{error}{hint}") from None


def compiled_file(path: str) -> Any:
    """The MjModel of an MJCF file. Raises SpatialDynError with MuJoCo's message."""
    return _compiled(None, path)


def _compiled(data: bytes | None, path: str) -> Any:
    """The MjModel of a file or text. Raises SpatialDynError with MuJoCo's message."""
    mujoco = need_mujoco()
    try:
        if path.endswith(".mjb"):
            return mujoco.MjModel.from_binary_path(path)
        if path:
            return mujoco.MjModel.from_xml_path(path)
        return mujoco.MjModel.from_xml_string((data or b"").decode("utf-8"))
    except (ValueError, UnicodeDecodeError) as error:
        said = " ".join(str(error).split())
        raise SpatialDynError(f"{path or '<text>'}: MuJoCo refuses it: {said}") from None
