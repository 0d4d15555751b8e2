"""Files of runs, in NumPy's npz format: the parts of a ``Trajectory`` by name, without its robot.

A scene is kept as its TOML text, with a digest of its robot.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.files import check_ending
from ..errors import SpatialDynError, literal

Array = NDArray[np.float64]
ARRAY_FILES = (".npz",)
ARRAYS = ("t", "q", "v", "p", "tau", "energy")
AXES = (1, 2, 2, 2, 2, 1)  # number of axes of each
WORDS = {"method": str, "dt": float, "robot": str, "interrupted": bool}
STATE, CONTACT = "state ", "contact "  # prefixes, in a file, of states and of records of contacts
SPRINGS = "spring_energy"
SCENE = "scene"  # entry of a file: the key of the scene's model and its TOML text


def write(run: Any, path: Any) -> None:
    """Write a Trajectory. Raises SpatialDynError for another ending, or if the file cannot be written."""
    check_ending("path", path, ARRAY_FILES)
    parts = {part: np.asarray(getattr(run, part)) for part in (*ARRAYS, *WORDS)}
    parts |= {STATE + part: x for part, x in run.states.items()}
    if run.contacts is not None:
        parts |= {CONTACT + part: x for part, x in run.contacts._asdict().items()}
    if run.spring_energy is not None:
        parts[SPRINGS] = run.spring_energy
    if run.scene is not None:
        parts[SCENE] = np.array([run.scene.model.key, run.scene.to_toml()])
    try:
        with nullcontext(path) if hasattr(path, "write") else open(path, "wb") as file:
            np.savez_compressed(file, allow_pickle=False, **parts)
    except (OSError, ValueError) as error:  # ValueError for an invalid name
        raise SpatialDynError(f"{literal(path)} cannot be written: {error}") from error


def read(path: Any, run_of: Callable[..., Any], contacts_of: Callable[..., Any]) -> tuple[Any, str | None, str]:
    """The Trajectory of a file, the key of its robot (None without a scene), and the text of its scene.

    Raises SpatialDynError if the file cannot be read, is damaged or holds something else.
    """
    name = _file_name(path)
    try:
        parts = _arrays(name)
        values: list[Any] = [*(parts.pop(x) for x in ARRAYS), *(parts.pop(x).item() for x in WORDS)]
        made = run_of(*values)
        springs = parts.pop(SPRINGS, None)
        states = {x.removeprefix(STATE): parts.pop(x) for x in [*parts] if x.startswith(STATE)}
        fields = {x.removeprefix(CONTACT): parts.pop(x) for x in [*parts] if x.startswith(CONTACT)}
        contacts = contacts_of(**fields) if fields else None
        made = replace(made, states=states, contacts=contacts, spring_energy=springs)
        key, text = _scene_of(parts.pop(SCENE, None))
        _check_parts(made, parts)
    except Exception as error:  # for damaged bytes zipfile, zlib and NumPy raise undocumented errors
        why = f"it has no part {error}" if isinstance(error, KeyError) else error or type(error).__name__
        raise SpatialDynError(f"{literal(path)} holds no trajectory: {why}") from error
    return made, key, text


def _file_name(path: Any) -> str | PathLike[str]:
    """The name of a file. Raises SpatialDynError, also for a number, which ``open`` takes for a file descriptor."""
    if not isinstance(path, (str, PathLike)):
        raise SpatialDynError(f"path is {literal(path)}, expected the name of a file")
    return path


def _arrays(path: str | PathLike[str]) -> dict[str, Array]:
    """The arrays of an npz file, each verified by its checksum, which ``np.load`` may not reach."""
    import zipfile

    with open(path, "rb") as file, zipfile.ZipFile(file) as archive:
        files = {name.removesuffix(".npy"): io.BytesIO(archive.read(name)) for name in archive.namelist()}
    return {name: np.lib.format.read_array(data, allow_pickle=False) for name, data in files.items()}


def _scene_of(part: Array | None) -> tuple[str | None, str]:
    """The key of the model of a run and the text of its scene; None without one."""
    if part is None:
        return None, ""
    if part.dtype.kind != "U" or part.shape != (2,):
        raise ValueError(f"scene is {part.dtype} of shape {part.shape}, expected two texts")
    return str(part[0]), str(part[1])


def _check_parts(run: Any, unknown: Mapping[str, Array]) -> None:
    """Raise ValueError naming a part of a file that no trajectory has, or that has another form."""
    for name in unknown:
        raise ValueError(f"{literal(name)} is no part of one")
    for name, kind in WORDS.items():
        if type(getattr(run, name)) is not kind:
            raise ValueError(f"{name} is {literal(getattr(run, name))}, expected a {kind.__name__}")
    parts: dict[str, tuple[Any, int]] = {name: (getattr(run, name), n) for name, n in zip(ARRAYS, AXES, strict=True)}
    if run.spring_energy is not None:
        parts[SPRINGS] = run.spring_energy, 1
    more = {**run.states, **({} if run.contacts is None else run.contacts._asdict())}
    for name, (x, axes) in {**parts, **{name: (x, max(1, x.ndim)) for name, x in more.items()}}.items():
        if x.dtype != np.float64 or x.ndim != axes or len(x) != len(run.t):
            raise ValueError(
                f"{name} is {x.dtype} of shape {x.shape}, expected float64 of {axes} axes, {len(run.t)} rows"
            )
    if not run.v.shape == run.p.shape == run.tau.shape:
        raise ValueError(f"v, p and tau have shapes {run.v.shape}, {run.p.shape}, {run.tau.shape}, expected one")
