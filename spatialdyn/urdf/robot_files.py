"""Robots by name: the library's URDF files, and those of an installed example-robot-data."""

from __future__ import annotations

import difflib
import os
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from ..errors import UrdfError, literal, pip_install
from ..model.robot_checks import quoted

SHORT_NAMES = {  # of robots of which example-robot-data has several files: the one that README and benchmarks mean
    "anymal": "anymal_b_simple_description/anymal",
    "anymal_b": "anymal_b_simple_description/anymal",
    "talos": "talos_full_v2",
}


def _own_folder() -> Path:
    """The folder of the library's URDF files: inside the package in a wheel, beside it in a checkout."""
    package = Path(str(sys.modules[__name__.partition(".")[0]].__file__)).resolve().parent
    inside = package / "urdf_files"
    return inside if inside.is_dir() else package.parent / "urdf"


def _example_folder() -> Path | None:
    """The robots' folder of the installed example-robot-data, a package of files only; None without it."""
    share = Path("share", "example-robot-data", "robots")
    places = [Path(entry, "cmeel.prefix", share) for entry in sys.path if entry]
    prefixes = [sys.prefix, os.environ.get("CONDA_PREFIX") or sys.prefix]
    places += [Path(prefix, *inner, share) for prefix in prefixes for inner in ((), ("Library",))]
    return next((place for place in places if place.is_dir()), None)


def example_robots() -> list[Path]:
    """The URDF files of the installed example-robot-data, sorted; empty if it is not installed."""
    folder = _example_folder()
    if folder is None:
        return []
    walk = os.walk(folder)  # faster than Path.rglob
    return sorted(Path(at, file) for at, _, files in walk for file in files if file.endswith(".urdf"))


def robot_names() -> dict[str, Path]:
    """{name: file} of every robot: the library's first, then example-robot-data's.

    The name is the file's without suffix, preceded by its folder where several files share it.
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
    """The file of a robot, in ``urdf/``, then in the installed example-robot-data.

    The first of these rules that finds a file decides; folders may precede the name, as in ``b1_description/b1``:

    1. a file NAME.urdf ("panda");
    2. a file NAME_robot.urdf ("ur5");
    3. files NAME_*.urdf, if all extend one of them ("talos_full": talos_full_v2, although there is talos_full_v2_box);
    4. the only file of a folder NAME_* ("hector").

    ``SHORT_NAMES`` come before them: "anymal" and "talos" are several files.

    Raises UrdfError listing the candidates if there are several, or close names if there is none.
    """
    *folders, stem = SHORT_NAMES.get(name, name).split("/")
    own = _own_folder() / f"{stem}.urdf"
    if not folders and stem and os.path.isfile(own):  # False, not OSError, for a name of 300 letters
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
    hint += "" if example_robots() else f"; example-robot-data is not installed; {pip_install('validate')}"
    shown = name if len(name) <= 60 else name[:57] + "..."
    raise UrdfError(f"{literal(shown)} is neither a file nor the name of a robot, expected one of them{hint}")


def _in_order(some: Sequence[str], of: Sequence[str]) -> bool:
    """Whether folders occur in a path in that order."""
    rest = iter(of)
    return all(folder in rest for folder in some)
