"""The names of Pinocchio that a script uses and the imports to change, read from its syntax tree: no code of it runs.

Names are found after ``import pinocchio as pin`` in any of its forms. Of variables only the plain cases are known:
results of buildModelFrom..., createData, RobotWrapper or a class of Pinocchio, whose members are looked up too.
"""

from __future__ import annotations

import ast
import warnings
from typing import NamedTuple

from ....errors import SpatialDynError
from .coverage import DIFFERENT, OUT_OF_SCOPE, SUPPORTED, compat_package, entry, names, raises

TOO_DEEP = "holds an expression that is nested too deep to be read, expected a Python script"
ROOT, FACE = "pinocchio", "spatialdyn.compat.pinocchio"
_MADE = {  # class -> functions that make an object of it
    "Model": "buildModelFromUrdf buildModelFromXML buildModelFromMJCF buildReducedModel appendModel "
    "buildSampleModelManipulator buildSampleModelHumanoid buildSampleModelHumanoidRandom",
    "GeometryModel": "buildGeomFromUrdf buildGeomFromMJCF buildSampleGeometryModelHumanoid "
    "buildSampleGeometryModelManipulator",
    "RobotWrapper": "BuildFromURDF BuildFromMJCF buildReducedRobot",
}
DATA = {"Model": "Data", "GeometryModel": "GeometryData"}  # of each model's createData
OF_SHAPES = ("collision", "visual", "geom")  # in names of models of geometry
MAKERS = {function: kind for kind, functions in _MADE.items() for function in functions.split()}
FIRSTS = {"buildModelsFromUrdf": "Model", "createDatas": "Data"}  # function -> class of its first result
PARTS = {("RobotWrapper", "model"): "Model", ("RobotWrapper", "data"): "Data"}
PARTS |= {("RobotWrapper", f"{kind}_{end}"): f"Geometry{end.capitalize()}"
          for kind in ("collision", "visual") for end in ("model", "data")}  # fmt: skip
STATIC = {"Identity", "Random", "Zero"}  # members of a class that return an object of it
CLASSES = {"Model", "Data", "RobotWrapper", "SE3", "Motion", "Force", "Inertia", "Symmetric3", "Quaternion", "Frame"}
CLASSES |= {"GeometryModel", "GeometryData", "visualize.MeshcatVisualizer", "visualize.ViserVisualizer"}


class Use(NamedTuple):
    """A name of Pinocchio in a script: the lines that use it, its status here and why.

    raises  when a name that is there raises on arguments that scripts usually pass, and what to do; "" for others
    """

    name: str
    lines: tuple[int, ...]
    status: str
    note: str
    raises: str = ""

    @property
    def works(self) -> bool:
        """Whether the name is there, and not to raise an error alone."""
        return self.status in (SUPPORTED, DIFFERENT)


class Change(NamedTuple):
    """A line of a script that imports Pinocchio, and the line to put in its place."""

    line: int
    before: str
    after: str


def uses(source: str) -> list[Use]:
    """The names of Pinocchio that a script uses: missing ones first, then those that may raise or differ.

    source  text of the script
    Raises SpatialDynError naming the line of a syntax error, or for expressions nested too deep to be read
    """
    reader = _Reader()
    tree = parsed(source)
    try:
        reader.visit(tree)
    except RecursionError:
        raise SpatialDynError(TOO_DEEP) from None
    named = [(name, _use(name.replace("#", "."), lines)) for name, lines in reader.found.items()]
    found = [use for name, use in named if name not in reader.stored or use.works]
    return sorted(found, key=lambda use: (use.works, not use.raises, use.status == SUPPORTED, use.lines, use.name))


def _use(name: str, lines: list[int]) -> Use:
    _, status, note = entry(name)
    when = raises(name)
    if when.startswith("always"):
        status, note = OUT_OF_SCOPE, "always raises" + when.removeprefix("always")
    return Use(name, tuple(sorted(set(lines))), status, note, when)


def changes(source: str) -> list[Change]:
    """The imports of Pinocchio in a script, each with the line that imports this package in its place.

    Raises as ``uses``.
    """
    found = []
    for node in ast.walk(parsed(source)):
        if isinstance(node, ast.Import) and any(alias.name.partition(".")[0] == ROOT for alias in node.names):
            after = "import " + ", ".join(map(_face_import, node.names))
        elif isinstance(node, ast.ImportFrom) and not node.level and (node.module or "").partition(".")[0] == ROOT:
            module = FACE + (node.module or "").removeprefix(ROOT)
            after = ast.unparse(ast.ImportFrom(module, node.names, 0))
        else:
            continue
        found.append(Change(node.lineno, ast.unparse(node), after))
    return sorted(found)


def _face_import(alias: ast.alias) -> str:
    first, _, rest = alias.name.partition(".")
    if first != ROOT:
        return ast.unparse(alias)
    inside = f".{rest}" if rest and alias.asname else ""  # without a name of its own it binds the package
    return f"{FACE}{inside} as {alias.asname or ROOT}"


def parsed(source: str) -> ast.Module:
    """The syntax tree of a script. Raises as ``uses``."""
    try:
        with warnings.catch_warnings():  # of the script's own oddities, as "\d"
            warnings.simplefilter("ignore")
            return ast.parse(source)
    except (RecursionError, MemoryError):  # of the parser's own stack
        raise SpatialDynError(TOO_DEEP) from None
    except (SyntaxError, ValueError) as error:
        line = getattr(error, "lineno", None)
        where = "" if line is None else f"line {line}: "
        raise SpatialDynError(f"{where}{getattr(error, 'msg', error)}, expected a Python script") from None


class _Reader(ast.NodeVisitor):
    """Visits a script and tracks its names: ``aliases`` of modules and names, ``kinds`` of objects."""

    def __init__(self) -> None:
        self.found: dict[str, list[int]] = {}
        self.stored: set[str] = set()  # members that the script sets: its own where Pinocchio has none
        self.aliases: dict[str, str] = {}  # a name or attribute, as text -> dotted name, "" for the package
        self.assigned: set[str] = set()  # aliases made by an assignment
        self.kinds: dict[str, str] = {}  # a variable or attribute, as text -> class of its value

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
                self.aliases |= {name: name for name in names()} if not inside else {}
                self.note(inside, node.lineno)
                continue
            # a name in a submodule is the package's unless the package does not have it
            own = alias.name if alias.name in names() or not inside else f"{inside}.{alias.name}"
            self.aliases[alias.asname or alias.name] = own
            self.note(own, node.lineno)

    # -- names

    def dotted(self, node: ast.expr) -> str | None:
        """The dotted name in Pinocchio of an expression; "" for the package, None for other things."""
        if not isinstance(node, (ast.Name, ast.Attribute)):
            return None
        alias = self.aliases.get(ast.unparse(node))
        if alias is not None or isinstance(node, ast.Name):
            return alias
        inside = self.dotted(node.value)
        return None if inside is None else _own(f"{inside}.{node.attr}".lstrip("."))

    def kind(self, node: ast.expr) -> str | None:
        """The class of an expression's value in plain cases, else None."""
        if isinstance(node, (ast.Name, ast.Attribute)):
            known = self.kinds.get(ast.unparse(node))
            if known is None and isinstance(node, ast.Attribute):
                return PARTS.get((self.kind(node.value) or "", node.attr))
            return known
        if isinstance(node, ast.Call):
            called = self.dotted(node.func)
            last = node.func.attr if isinstance(node.func, ast.Attribute) else called
            made, _, by = (called or "").rpartition(".")
            if last == "createData" and isinstance(node.func, ast.Attribute):
                return self._data_of(node.func.value)
            if called in CLASSES:
                return called
            if made in CLASSES and by in STATIC:
                return made
            return MAKERS.get(last or "") if called is not None else None
        return None

    def _data_of(self, model: ast.expr) -> str | None:
        """The class of ``createData()`` of a model, known or else named as one of Pinocchio's is in most scripts."""
        known = self.kind(model)
        if known is not None:
            return DATA.get(known)
        name = ast.unparse(model).rpartition(".")[2].lower()
        usual = name in ("model", "rmodel") or name.endswith(("robot_model", "pin_model", "pinocchio_model"))
        return "Data" if usual and not any(part in name for part in OF_SHAPES) else None

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
        """Record what a variable or attribute is from here on: an alias, or an object of a class.

        Imported names keep their alias, for ``except ImportError: pin = None``.
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
        self.kinds.pop(text, None)
        if kind is not None:
            self.kinds[text] = kind

    def visit_Name(self, node: ast.Name) -> None:
        if isinstance(node.ctx, ast.Load):
            self.note(self.aliases.get(node.id) or "", node.lineno)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        name = self.dotted(node)
        if name is not None:
            self.note(".".join(name.split(".")[:2]), node.lineno)  # a member of a module or class, not members of that
            return
        of = self.kind(node.value)
        if of is not None:
            self.note(f"{of}#{node.attr}", node.lineno)
            if isinstance(node.ctx, ast.Store):
                self.stored.add(f"{of}#{node.attr}")
        self.generic_visit(node)


def _own(name: str) -> str:
    """A dotted name without its submodule if the package has the same object at its root."""
    module, _, rest = name.partition(".")
    first = rest.partition(".")[0]
    there = vars(compat_package())
    shown = first in names() and first in there and getattr(there.get(module), first, None) is there[first]
    return rest if shown else name
