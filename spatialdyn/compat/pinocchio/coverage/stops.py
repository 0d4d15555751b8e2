"""What stops a script that is written for Pinocchio, beside its own faults: ``stops``."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from .coal_package import has_coal
from .coverage import UNKNOWN
from .porting import Use, parsed

NAME, VIEWER, GEOMETRY, LIBRARY, FOREIGN = "a name", "a viewer", "geometry", "a C++ library", "a foreign Model"
OLD = "a name that Pinocchio 4.1 lacks too"
KINDS = (LIBRARY, NAME, VIEWER, GEOMETRY, OLD, FOREIGN)

# packages that are compiled against Pinocchio's C++ library
_LINKED = """
    aligator biconvex_mpc_cpp casadi_kin_dyn centroidal_mpc crocoddyl force_feedback_mpc gepetto hpp jiminy_py
    libquadruped_reactive_walking linear_feedback_controller mim_solvers ndcurves pinocchio_bindings placo proxddp
    simple_mpc sobec tsid"""
# packages in Python that import Pinocchio, and hand over its objects unless ``install`` runs first
_CLIENTS = """
    bullet_utils dex_retargeting example_robot_data figaroh meshcat_shapes pink pyroboplan qpmpc robot_descriptions
    robot_properties_bolt robot_properties_solo"""
LINKED, CLIENTS = frozenset(_LINKED.split()), frozenset(_CLIENTS.split())
SHAPES = ("coal", "hppfcl")  # of the package coal, which this package takes
OF_SHAPES = re.compile("[Cc]ollision|[Dd]istance|[Gg]eom|[Mm]esh|BroadPhase|ContactPatch|coal|hppfcl")


class Stop(NamedTuple):
    """What stops a script: of a kind, one of ``KINDS``, the name or package, and the lines."""

    kind: str
    what: str
    lines: tuple[int, ...]

    @property
    def counts(self) -> bool:
        """Whether it stops a script that runs under Pinocchio 4.1, and ``install`` before its imports is no cure."""
        return self.kind not in (FOREIGN, OLD)


def stops(source: str, found: Iterable[Use]) -> list[Stop]:
    """What stops a script: packages that it imports, and those of its names that are not here or always raise.

    source  text of the script
    found   its ``uses``
    """
    made = [Stop(_kind(use), use.name, use.lines) for use in found if not use.works]
    if not has_coal():
        made += [Stop(GEOMETRY, x.name, x.lines) for x in found if x.works and "package coal" in x.raises]
    imported: dict[str, list[int]] = {}
    for name, line in _imports(parsed(source)):
        imported.setdefault(name, []).append(line)
    for name, lines in imported.items():
        kind = LIBRARY if name in LINKED else FOREIGN if name in CLIENTS else None
        if name in SHAPES and not has_coal():
            kind = GEOMETRY
        if kind:
            made.append(Stop(kind, name, tuple(sorted(set(lines)))))
    return sorted(made, key=lambda stop: (KINDS.index(stop.kind), stop.lines, stop.what))


def _kind(use: Use) -> str:
    name = use.name
    if use.status == UNKNOWN:
        return OLD
    if name.startswith(("visualize", "RobotWrapper.view")) or "Viewer" in name:
        return VIEWER
    return GEOMETRY if OF_SHAPES.search(name) or use.note.startswith("geometry") else NAME


def _imports(tree: ast.Module) -> Iterator[tuple[str, int]]:
    """The packages that a script imports, with lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name.partition(".")[0], node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0], node.lineno
