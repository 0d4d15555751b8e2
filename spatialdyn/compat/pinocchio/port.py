"""What a script uses of Pinocchio, and whether this face has it; the script is read, never run."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from ...errors import SpatialDynError
from .coverage import MISSING, SUPPORTED, entry
from .names import NAMES

PACKAGE = "pinocchio"
FACE = "spatialdyn.compat.pinocchio"


class Use(NamedTuple):
    """A name of Pinocchio's that a script uses, the lines where it does, and what there is to say of it."""

    name: str
    lines: tuple[int, ...]
    status: str
    note: str


def uses(script: str, label: str = "<script>") -> tuple[Use, ...]:
    """The names of Pinocchio's that a script uses, in the order of their first use.

    Found are names that are imported, and attributes of what stands for the module: ``pin.rnea``, ``pin.rpy.x``.
    Raises SpatialDynError for text that is no Python.
    """
    try:
        tree = ast.parse(script)
    except (SyntaxError, ValueError) as error:
        raise SpatialDynError(f"{label} is no Python ({error}), expected a script") from None
    found: dict[str, list[int]] = {}
    for name, line in sorted([*_imported(tree), *_attributes(tree, _aliases(tree))], key=lambda use: use[1]):
        found.setdefault(name, []).append(line)
    return tuple(Use(name, tuple(dict.fromkeys(lines)), *_said_of(name)) for name, lines in found.items())


def _said_of(name: str) -> tuple[str, str]:
    """Status and note of a dotted name below the package."""
    first = name.partition(".")[0]
    if first == "*":
        return SUPPORTED, "each name it brings counts by itself"
    if first not in NAMES:
        return MISSING, f"pinocchio 4.1 itself has no {first}; visualizers and other extras are not in {FACE}"
    return entry(name)[1:]


def _aliases(tree: ast.Module) -> Mapping[str, str]:
    """The names that stand for the package or a module of it, and their dotted names below the package."""
    found: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                top, _, inner = alias.name.partition(".")
                if top == PACKAGE:
                    found[alias.asname or top] = inner if alias.asname else ""
        elif isinstance(node, ast.ImportFrom) and not node.level and (node.module or "").split(".")[0] == PACKAGE:
            base = (node.module or "").partition(".")[2]
            for alias in node.names:
                found[alias.asname or alias.name] = f"{base}.{alias.name}".lstrip(".")
    return found


def _imported(tree: ast.Module) -> Iterator[tuple[str, int]]:
    """Names that import statements bring, and their lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                top, _, inner = alias.name.partition(".")
                if top == PACKAGE and inner:
                    yield inner, node.lineno
        elif isinstance(node, ast.ImportFrom) and not node.level and (node.module or "").split(".")[0] == PACKAGE:
            base = (node.module or "").partition(".")[2]
            for alias in node.names:
                yield ("*" if alias.name == "*" and not base else f"{base}.{alias.name}".strip(".*")), node.lineno


def _attributes(tree: ast.Module, aliases: Mapping[str, str]) -> Iterator[tuple[str, int]]:
    """Attributes of what stands for the package, as long a chain as there is, and their lines."""
    inner = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Attribute) or id(node) in inner:
            continue
        parts, at = [node.attr], node.value
        while isinstance(at, ast.Attribute):
            parts, at = [at.attr, *parts], at.value
        if isinstance(at, ast.Name) and at.id in aliases:
            dotted = [*filter(None, [aliases[at.id]]), *parts]
            yield ".".join(dotted[:2]), node.lineno
