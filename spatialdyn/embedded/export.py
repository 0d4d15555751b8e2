"""``export``: calls, control laws and steps of a scene as files for a controller's chip."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from ..calls.arguments import check_model
from ..calls.specialize_request import dtype_of
from ..errors import SpatialDynError, literal
from ..model.model import Model
from ..simulation.scene import Scene
from .chip_text import type_of
from .functions import check_name, functions_of
from .texts import MARK, files_of

VERSION = "1.0.0"  # version of an export as an Arduino library


def export(
    scene: Scene | Model,
    functions: Mapping[str, Any],
    folder: str | os.PathLike[str],
    name: str = "robot",
    dtype: DTypeLike = np.float64,
) -> tuple[Path, ...]:
    """C for a controller's chip: calls, control laws and steps as one C99 file that allocates nothing.

    scene      Model, or for steps a Scene
    functions  {name of a function: what it computes}: a public call such as ``sd.rnea``, or several; a result of
               ``sd.specialize``, with its fixed inputs, payloads and frames; ``sd.step``, or
               ``functools.partial(sd.step, method="rk4")``; a control law such as ``sd.ComputedTorque(...)``, whose
               gains and path become constants and whose clock is an input, or a law's Spec, or one of "pd",
               "pd_gravity", "pd_plus", "computed_torque", "passivity_based" and "cosine_shaping", whose gains and
               references are inputs
    folder     created if needed. An earlier export in it is replaced, other files are not
    name       name of the files and prefix of the functions' names: robot_torque for "torque" of "robot"
    dtype      float64 for double, or float32 for float

    The folder has ``src/NAME.c``, ``.h`` (with units) and ``.hpp``; ``rust/NAME.rs``; ``src/NAME_check.c``, which
    compares its results with answers recorded on this machine, and ``check/main.c``, which prints how many agree; a
    CMakeLists.txt, which also serves as that of an ESP-IDF component, and a library.properties with a sketch, which
    make the folder an Arduino library. Names in it are the given names and those of arrays, none of the robot's.

    Every function ``int NAME_torque(const double q[6], ..., double tau[6])`` returns 0, or 1 if its results are
    invalid: for an angle above 1e5 rad, or a result that is not finite; quaternions are used as given. Of the C
    library only sqrt is called, and only without ``-fno-math-errno``. If the processor has fused multiply-add, or with
    ``-mfma``, results are those of this library to the bit, otherwise to rounding. In float, numbers must stay within
    its range: unlike ``specialize``, no float64 is used instead. Loops and branches of steps in contact are loops and
    branches in C.

    Returns the paths of the files, ``src/NAME.h`` first.
    Raises  SpatialDynError for a name that C, C++ or Rust do not allow, for a function without a program, naming it,
            and for a folder with other files of those names; the errors of ``specialize``

    >>> import tempfile
    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = sd.export(model, {"torque": sd.rnea, "law": "computed_torque"}, folder, name="arm")
    ...     [line for line in made[0].read_text().splitlines() if line.startswith("int arm_torque")]
    ['int arm_torque(const double q[2], const double v[2], const double a[2], double tau[2]);']
    """
    if not isinstance(scene, Scene):
        check_model(scene)
    check_name("name", name)
    if not isinstance(functions, Mapping) or not functions:
        raise SpatialDynError(f"functions is {literal(functions)}, expected a dict such as {{'torque': sd.rnea}}")
    if {"check", "is_fused"} & set(functions):
        raise SpatialDynError("functions have check or is_fused, expected other names: the files have those")
    try:
        root = Path(folder)
    except TypeError:
        root = Path("\0")
    if "\0" in str(root):
        raise SpatialDynError(f"folder is {literal(folder)}, expected the path of a folder")
    kind = type_of(dtype_of(dtype))
    texts = files_of(name, functions_of(scene, functions, dtype), kind, VERSION)
    for path in texts:
        _check_place(root / path)
    return tuple(_written(root / path, text) for path, text in texts.items())


def _check_place(place: Path) -> None:
    """Raise SpatialDynError if a file exists there that no export has made."""
    try:
        made = not place.exists() or MARK in place.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise SpatialDynError(f"{place} cannot be written: {error}") from error
    if not made:
        raise SpatialDynError(f"{place} is there, and no export has made it: expected another folder or name")


def _written(place: Path, text: str) -> Path:
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise SpatialDynError(f"{place} cannot be written: {error}") from error
    return place
