"""What a script uses of Pinocchio, read off its source by ``ast``: nothing of it is run.

Names are found behind ``import pinocchio as pin`` in any of its forms. Of variables only the obvious is known: what
was made by buildModelFrom..., createData, RobotWrapper or a class is one of those, and its members are looked up too.
"""

from __future__ import annotations

import ast
from typing import NamedTuple

from ....errors import SpatialDynError
from .coverage import OUT_OF_SCOPE, SUPPORTED, UNKNOWN, entry, face
from .pinocchio_names import NAMES

ROOT = "pinocchio"
MAKERS = {  # what calls of these names make
    "buildModelFromUrdf": "Model",
    "buildModelFromXML": "Model",
    "buildReducedModel": "Model",
    "buildSampleModelManipulator": "Model",
    "buildSampleModelHumanoid": "Model",
    "buildSampleModelHumanoidRandom": "Model",
    "appendModel": "Model",
    "createData": "Data",
    "BuildFromURDF": "RobotWrapper",
    "buildReducedRobot": "RobotWrapper",
}
FIRSTS = {"buildModelsFromUrdf": "Model", "createDatas": "Data"}  # the first of what calls of these names make
PARTS = {("RobotWrapper", "model"): "Model", ("RobotWrapper", "data"): "Data"}
STATIC = {"", "Identity", "Random", "Zero"}  # what a class makes objects of itself by; "" is calling it
CLASSES = {"Model", "Data", "RobotWrapper", "SE3", "Motion", "Force", "Inertia", "Symmetric3", "Quaternion", "Frame"}


class Use(NamedTuple):
    """A name of Pinocchio's in a script: the lines on which it stands, and what the face makes of it."""

    name: str
    lines: tuple[int, ...]
    status: str
    note: str


def uses(source: str) -> list[Use]:
    """The names of Pinocchio's that a script uses, sorted: those that are missing first.

    source  text of the script
    Raises SpatialDynError naming the line if it is no Python
    """
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError) as error:
        line = getattr(error, "lineno", None)
        where = "" if line is None else f"line {line}: "
        raise SpatialDynError(f"{where}{getattr(error, 'msg', error)}, expected a Python script") from None
    reader = _Reader()
    reader.visit(tree)
    found = [
        Use(name.replace("#", "."), tuple(sorted(set(lines))), *entry(name.replace("#", "."))[1:])
        for name, lines in reader.found.items()
    ]
    order = (UNKNOWN, OUT_OF_SCOPE)
    return sorted(found, key=lambda use: (use.status not in order, use.status == SUPPORTED, use.lines, use.name))


class _Reader(ast.NodeVisitor):
    """Goes through a script and keeps what its names stand for: ``aliases`` modules and names, ``kinds`` objects."""

    def __init__(self) -> None:
        self.found: dict[str, list[int]] = {}
        self.aliases: dict[str, str] = {}  # a name or attribute, as text -> dotted name, "" for the package
        self.assigned: set[str] = set()  # those of them that an assignment made
        self.kinds: dict[str, str] = {}  # a variable or attribute, as text -> class of what it holds

    def note(self, name: str, line: int) -> None:
        if name:
            self.found.setdefault(name, []).append(line)

    # -- imports

    def visit_Import(self, node: ast.Import) -> None:
        for alias in node.names:
            first, _, rest = alias.name.partition(".")
            if first == ROOT:
                self.aliases[alias.asname or first] = rest if alias.asname else ""
                self.note(rest, node.lineno)

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        first, _, inside = (node.module or "").partition(".")
        if first != ROOT or node.level:
            return
        for alias in node.names:
            if alias.name == "*":
                self.aliases |= {name: name for name in NAMES} if not inside else {}
                self.note(inside, node.lineno)
                continue
            # a name of a file of the package is the package's own, except where that is no part of the face
            own = alias.name if alias.name in NAMES or not inside else f"{inside}.{alias.name}"
            self.aliases[alias.asname or alias.name] = own
            self.note(own, node.lineno)

    # -- names

    def dotted(self, node: ast.expr) -> str | None:
        """What an expression names in Pinocchio; "" for the package, None for nothing of it."""
        if not isinstance(node, (ast.Name, ast.Attribute)):
            return None
        alias = self.aliases.get(ast.unparse(node))
        if alias is not None or isinstance(node, ast.Name):
            return alias
        inside = self.dotted(node.value)
        return None if inside is None else _own(f"{inside}.{node.attr}".lstrip("."))

    def kind(self, node: ast.expr) -> str | None:
        """The class of what an expression gives, where that is plain."""
        if isinstance(node, (ast.Name, ast.Attribute)):
            known = self.kinds.get(ast.unparse(node))
            if known is None and isinstance(node, ast.Attribute):
                return PARTS.get((self.kind(node.value) or "", node.attr))
            return known
        if isinstance(node, ast.Call):
            called = self.dotted(node.func)
            last = node.func.attr if isinstance(node.func, ast.Attribute) else called
            made, _, by = (called or "").partition(".")
            if made in CLASSES and by in STATIC:
                return made
            return MAKERS.get(last or "") if called is not None or last == "createData" else None
        return None

    def visit_Assign(self, node: ast.Assign) -> None:
        self.generic_visit(node)
        for target in node.targets:
            if isinstance(target, (ast.Tuple, ast.List)) and target.elts and isinstance(node.value, ast.Call):
                called = self.dotted(node.value.func) or ""
                self.hold(target.elts[0], None, FIRSTS.get(called))
            else:
                self.hold(target, self.dotted(node.value), self.kind(node.value))

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        self.generic_visit(node)
        if node.value is not None:
            self.hold(node.target, self.dotted(node.value), self.kind(node.value))

    def hold(self, target: ast.expr, alias: str | None, kind: str | None) -> None:
        """Keep what a variable or attribute is from here on: a name of Pinocchio's, or an object of one of its classes.

        What was imported stays so, for ``except ImportError: pin = None``.
        """
        if not isinstance(target, (ast.Name, ast.Attribute)):
            return
        text = ast.unparse(target)
        if alias is not None:
            self.aliases[text] = alias
            self.assigned.add(text)
        elif text in self.assigned:
            self.assigned.remove(text)
            del self.aliases[text]
        if kind is not None:
            self.kinds[text] = kind
        else:
            self.kinds.pop(text, None)

    def visit_Name(self, node: ast.Name) -> None:
        if isinstance(node.ctx, ast.Load):
            self.note(self.aliases.get(node.id) or "", node.lineno)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        name = self.dotted(node)
        if name is not None:
            self.note(_shown(name), node.lineno)
            return
        of = self.kind(node.value)
        if of is not None:
            self.note(f"{of}#{node.attr}", node.lineno)
        self.generic_visit(node)


def _own(name: str) -> str:
    """A dotted name without the module where that only shows what is the package's own."""
    module, _, rest = name.partition(".")
    first = rest.partition(".")[0]
    there = vars(face())
    shown = first in NAMES and first in there and getattr(there.get(module), first, None) is there[first]
    return rest if shown else name


def _shown(name: str) -> str:
    """A dotted name as far as the face has to answer for it: a module's or class's own member, not the member's."""
    return ".".join(name.split(".")[:2])
