"""Models and data as text and back, in a JSON format of this library; XML and binary files wrap it.

Files hold plain numbers and names; reading one runs no code. Pinocchio's archives are not read.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, unescape

import numpy as np

from ....errors import SpatialDynError
from ..types.frame import Frame, FrameType
from ..types.inertia import Inertia
from ..types.motion import Motion
from ..types.se3 import SE3
from .joint import joint_of

FORMAT = "spatialdyn.compat.pinocchio model 1"

# --- a model as plain numbers and names --------------------------------------------------------------------


def state(model: Any) -> dict[str, Any]:
    """A model as lists of numbers and names."""
    joints = zip(model.names, model.parents, model.joints, model.jointPlacements, model.inertias, strict=True)
    return {
        "format": FORMAT, "name": model.name, "nbodies": model.nbodies, "gravity": numbers(model.gravity),
        "joints": [
            {"name": name, "parent": int(parent), "joint": x.state(), "placement": numbers(X), "inertia": numbers(I)}
            for name, parent, x, X, I in joints
        ],
        "frames": [frame_state(x) for x in model.frames],
        "arrays": {name: x.tolist() for name, x in model._arrays.items()},
        "configurations": {name: np.asarray(q).tolist() for name, q in model.referenceConfigurations.items()},
    }  # fmt: skip


def frame_state(frame: Frame) -> dict[str, Any]:
    """A frame as numbers and names."""
    return {
        "name": frame.name, "joint": frame.parentJoint, "before": frame.parentFrame,
        "placement": numbers(frame.placement), "type": frame.type.name, "inertia": numbers(frame.inertia),
    }  # fmt: skip


def fill(model: Any, given: Mapping[str, Any]) -> None:
    """Set a model to a state."""
    model.__init__()
    model.name = given["name"]
    model.gravity = _value(Motion, given["gravity"])
    for k, entry in enumerate(given["joints"]):
        placement = _value(SE3, entry["placement"])
        if k:
            model._append_joint(entry["parent"], joint_of(entry["joint"]), placement, entry["name"])
        model.names[k], model.jointPlacements[k] = entry["name"], placement
        model.inertias[k] = _value(Inertia, entry["inertia"])
    vars(model)["nbodies"] = given["nbodies"]
    del model.frames[:]
    for x in given["frames"]:
        place, inertia = _value(SE3, x["placement"]), _value(Inertia, x["inertia"])
        model.frames.append(Frame(x["name"], x["joint"], x["before"], place, FrameType[x["type"]], inertia))
    armature = model._arrays["armature"]
    model._arrays.update({name: np.array(x, dtype=float) for name, x in given["arrays"].items()})
    armature[:], model._arrays["armature"] = model._arrays["armature"], armature
    for name, q in given["configurations"].items():
        model.referenceConfigurations[name] = np.array(q, dtype=float)


def numbers(value: Any) -> list[float]:
    """The numbers of an SE3, Motion or Inertia, row by row."""
    x: list[float] = value._x.ravel().tolist()
    return x


def _value(kind: Any, numbers: list[float]) -> Any:
    x = np.array(numbers, dtype=float)
    return kind.over(x.reshape(4, 4) if kind is SE3 else x)


class Stored:
    """Save and load methods of Model and Data.

    ``_state()`` gives a dict with a ``"format"``, ``_become(state)`` takes one over.
    """

    _format: str
    _state: Any
    _become: Any

    def saveToString(self) -> str:
        """The state as text."""
        return json.dumps(self._state())

    def loadFromString(self, string: str) -> None:
        """Take over the state in a text. Raises SpatialDynError if it holds none of this kind."""
        _load(self, string, "the text")

    def saveToText(self, filename: str | os.PathLike[str]) -> None:
        """Write the state to a text file."""
        Path(filename).write_text(self.saveToString(), encoding="utf-8")

    def loadFromText(self, filename: str | os.PathLike[str]) -> None:
        """Take over the state in a text file. Raises SpatialDynError if it holds none of this kind."""
        _load(self, _read(filename).decode("utf-8", errors="replace"), filename)

    def saveToXML(self, filename: str | os.PathLike[str], tag_name: str) -> None:
        """Write the state to an XML file of one element."""
        text = f'<?xml version="1.0" encoding="utf-8"?>\n<{tag_name}>{escape(self.saveToString())}</{tag_name}>\n'
        Path(filename).write_text(text, encoding="utf-8")

    def loadFromXML(self, filename: str | os.PathLike[str], tag_name: str) -> None:
        """Take over the state in an XML file. Raises SpatialDynError if it holds none of this kind."""
        text = _read(filename).decode("utf-8", errors="replace")
        _, found, rest = text.partition(f"<{tag_name}>")
        if not found:
            raise SpatialDynError(f"{filename} has no element <{tag_name}>, expected one written by saveToXML")
        _load(self, unescape(rest.partition(f"</{tag_name}>")[0]), filename)

    def saveToBinary(self, filename: str | os.PathLike[str]) -> None:
        """Write the state to a binary file."""
        _path(filename).write_bytes(zlib.compress(self.saveToString().encode()))

    def loadFromBinary(self, filename: str | os.PathLike[str]) -> None:
        """Take over the state in a binary file. Raises SpatialDynError if it holds none of this kind."""
        try:
            text = zlib.decompress(_read(_path(filename))).decode()
        except (zlib.error, UnicodeDecodeError):
            raise SpatialDynError(f"{filename} was not written by saveToBinary, expected a file that was") from None
        _load(self, text, filename)


def _path(filename: Any) -> Path:
    if not isinstance(filename, (str, os.PathLike)):
        raise NotImplementedError(
            f"saveToBinary and loadFromBinary take files only, not a {type(filename).__name__}; give a path"
        )
    return Path(filename)


def _read(filename: Any) -> bytes:
    try:
        return Path(filename).read_bytes()
    except OSError as error:
        raise SpatialDynError(f"{filename} cannot be read ({error}), expected a stored model or data") from None


def _load(one: Any, text: str, source: Any) -> None:
    """Take over the state in a text; unchanged if that fails."""
    kind = one._format.split()[-2]
    try:
        given = json.loads(text)
        if not isinstance(given, dict) or given.get("format") != one._format:
            raise ValueError
        made = type(one)()
        made._become(given)
        one._become(made._state())
    except (AttributeError, KeyError, TypeError, ValueError):
        raise SpatialDynError(f"{source} holds no {kind} written by saveToText and its like, expected one") from None
