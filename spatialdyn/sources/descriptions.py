"""Robots of the package robot_descriptions by name. It clones their repositories with git at first use."""

from __future__ import annotations

import os
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

from ..errors import SpatialDynError

FILES = ("URDF_PATH", "MJCF_PATH", "XACRO_PATH")


def description_names() -> frozenset[str]:
    """Names of the descriptions; none if the package is not installed."""
    try:
        from robot_descriptions import DESCRIPTIONS
    except ImportError:
        return frozenset()
    return frozenset(name for name, found in DESCRIPTIONS.items() if found.has_urdf or found.has_mjcf)


def description_file(name: str) -> str:
    """The URDF, MJCF or xacro file of a description; warns if its repository is to be cloned first.

    Raises SpatialDynError if it cannot be cloned.
    """
    from robot_descriptions import DESCRIPTIONS
    from robot_descriptions._repositories import REPOSITORIES

    cache, repository = cache_folder(), REPOSITORIES[DESCRIPTIONS[name].repository]
    url = repository.url
    if not (cache / repository.cache_path).is_dir():
        warnings.warn(f'"{name}" is of robot_descriptions, which clones {url} into {cache}', stacklevel=6)
    try:
        module: Any = import_module(f"robot_descriptions.{name}")
    except (KeyboardInterrupt, SystemExit):
        raise
    except Exception as error:  # of git, in several classes
        said = " ".join(str(error).split())[:300]
        raise SpatialDynError(f'"{name}": robot_descriptions cannot clone {url}: {said}') from error
    for attribute in FILES:
        if hasattr(module, attribute):
            return str(getattr(module, attribute))
    raise SpatialDynError(f'"{name}" of robot_descriptions has none of {", ".join(FILES)}, expected one')


def cache_folder() -> Path:
    """The folder in which robot_descriptions keeps its clones."""
    return Path(os.path.expanduser(os.environ.get("ROBOT_DESCRIPTIONS_CACHE", "~/.cache/robot_descriptions")))
