"""What stands for the geometry that Pinocchio returns with some models: this face has none."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from .builders import buildModelFromUrdf
from .frame import Enum
from .model import Model


class GeometryType(Enum):
    """What a geometry is for."""

    VISUAL = 0
    COLLISION = 1


VISUAL, COLLISION = GeometryType


class GeometryModel:
    """Stands for a geometry that was not read; all one can do with it is to pass it on.

    Raises NotImplementedError for whatever else is asked of it.
    """

    def createData(self) -> GeometryModel:
        """Another of its kind."""
        return GeometryModel()

    def copy(self) -> GeometryModel:
        """Another of its kind."""
        return GeometryModel()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise NotImplementedError(
            f"geometry is out of scope of spatialdyn, which has no {name} of it; for shapes and collisions read the "
            "URDF with yourdfpy and trimesh, or with pinocchio itself"
        )


def buildModelsFromUrdf(filename: Any, *arguments: Any, **named: Any) -> tuple[Any, ...]:
    """The Model of a URDF file, and what stands for its geometries.

    filename         str or Path
    package_dirs     not looked at
    root_joint       joint model between the universe and the root link; without it the root link is fixed
    root_joint_name  its name, "root_joint" by default; may be left out in a call by position
    verbose          without effect
    meshLoader       not looked at
    geometry_types   as many GeometryModels are returned; by default two, for collisions and for looks
    mimic            True: joints that mimic others have no coordinates

    Raises what ``buildModelFromUrdf`` does.
    """
    names = ["package_dirs", "root_joint", "verbose", "meshLoader", "geometry_types", "mimic"]
    if len(arguments) >= 3 and isinstance(arguments[2], str):
        names.insert(2, "root_joint_name")
    given = dict(zip(names, arguments, strict=False))
    known = {*names, "root_joint_name"}
    if len(arguments) > len(names) or {*given} & {*named} or not {*named} <= known:
        raise TypeError(f"buildModelsFromUrdf got {len(arguments)} arguments and {', '.join(named)}, expected {known}")
    given |= named
    kinds = given.get("geometry_types")
    kinds = (COLLISION, VISUAL) if kinds is None else kinds if isinstance(kinds, Iterable) else [kinds]
    passed = {name: given[name] for name in ("root_joint", "root_joint_name") if given.get(name) is not None}
    model = buildModelFromUrdf(filename, mimic=bool(given.get("mimic", False)), **passed)
    return model, *(GeometryModel() for _ in kinds)


def createDatas(*models: Model | GeometryModel | None) -> tuple[Any, ...]:
    """``createData()`` of each model; None for None."""
    return tuple(None if model is None else model.createData() for model in models)
