"""Private names of Numba, NumPy, CPython and mpmath are used in a few files only, and listed here.

A new version of one of them may rename these: a name that is not listed, or in another file, fails.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

import spatialdyn

PACKAGE = Path(spatialdyn.__file__).parent
COMPILED = "engines/compiled/"
FOREIGN = {"numba", "numpy", "llvmlite", "ctypes"}
PUBLIC = {
    "numba",
    "numba.extending",
    "numpy",
    "numpy.linalg",
    "numpy.typing",
    "numpy.lib.stride_tricks",
    "llvmlite",
    "llvmlite.binding",
}
OF_TUPLES = {"_asdict", "_replace", "_fields", "_make"}  # documented by named tuples

# name -> the files that may use it
BORROWED: dict[str, set[str]] = {
    # how inlined functions are compiled
    "numba.core.codegen.JITCodeLibrary": {COMPILED + "inlining.py"},
    "numba.core.compiler.CompilerBase": {COMPILED + "lane_typing.py"},
    "numba.core.compiler.Compiler": {COMPILED + "lane_typing.py"},
    "numba.core.compiler.CompileResult": {COMPILED + "inlining.py"},
    "numba.core.environment.Environment": {COMPILED + "inlining.py"},
    "_final_module": {COMPILED + "inlining.py"},
    "numba.core.compiler.DefaultPassBuilder": {COMPILED + "inlining.py"},
    "numba.core.compiler_machinery.LoweringPass": {COMPILED + "inlining.py"},
    "numba.core.compiler_machinery.register_pass": {COMPILED + "inlining.py"},
    "numba.core.typed_passes.IRLegalization": {COMPILED + "inlining.py"},
    "_finalize_dynamic_globals": {COMPILED + "inlining.py"},
    # the cache of compiled functions
    "numba.core.caching._Cache": {COMPILED + "numba_cache.py"},
    "numba.core.compiler": {COMPILED + "numba_cache.py"},
    "numba.core.runtime.rtsys": {COMPILED + "numba_cache.py"},
    "numba.core.serialize": {COMPILED + "numba_cache.py"},
    "_rebuild": {COMPILED + "numba_cache.py"},
    "_reduce": {COMPILED + "numba_cache.py"},
    # a dispatcher without conversions of arguments and long error messages
    "_cache": {COMPILED + "jit.py", COMPILED + "tiers.py"},
    "_compile_for_args": {COMPILED + "jit.py"},
    "numba.core.compiler_lock.global_compiler_lock": {COMPILED + "jit.py"},
    "_search_new_conversions": {COMPILED + "jit.py"},
    "_explain_matching_error": {COMPILED + "jit.py"},
    # addresses and arrays in compiled code
    "numba.np.arrayobj": {COMPILED + "jit.py", COMPILED + "lane_arrays.py"},
    "_getvalue": {COMPILED + "jit.py", COMPILED + "lane_arrays.py"},
    "numba.core.cgutils": {COMPILED + x for x in ("jit.py", "lane_arrays.py", "lane_typing.py", "lanes.py")},
    # numbers, arrays and matrices of lanes: types, their operators and conversions
    "numba.core.datamodel.models": {COMPILED + "lane_arrays.py", COMPILED + "lanes.py"},
    "numba.core.datamodel.registry.register_default": {COMPILED + "lane_arrays.py", COMPILED + "lanes.py"},
    "numba.core.typeconv.castgraph.Conversion": {COMPILED + "lanes.py"},
    "numba.core.typing.templates.AbstractTemplate": {COMPILED + "lane_arrays.py", COMPILED + "lanes.py"},
    "numba.core.typing.templates.infer_global": {COMPILED + x for x in ("jit.py", "lane_arrays.py", "lanes.py")},
    "numba.core.typing.templates.make_intrinsic_template": {COMPILED + "jit.py"},
    "numba.core.typing.templates.signature": {COMPILED + "lane_arrays.py", COMPILED + "lanes.py"},
    # CPython builtins that read NumPy's array objects
    "ctypes": {
        "compat/native/operator_kernels.py",
        "engines/compiled/entries.py",
        "engines/compiled/memory.py",
        "engines/object_layout.py",
        "engines/programs/gpu/arrays.py",
        "engines/programs/gpu/device.py",
        "engines/programs/run/batch_kernels.py",
        "engines/programs/run/interpreter.py",
        "engines/programs/run/single_call.py",
        "engines/programs/run/time_loop.py",
        "engines/programs/run/xla_handler.py",
        "examples/c_export.py",
    },
    "ctypes.pythonapi": {
        "engines/object_layout.py",
        "engines/programs/gpu/arrays.py",
    },
    "_ARRAY_API": {"engines/object_layout.py"},
    # the end of a process whose threads compile
    "_exit": {"engines/interrupt.py"},
    # how IPython shows a figure
    "_repr_png_": {"pictures/figures.py"},
    # mpmath's numbers as integers and exponents
    "_mpf_": {"engines/numbers/multiprecision.py"},
    # the caller's module: the face's coverage reports it, and it is the __module__ of what the face makes from rows
    "_getframe": {"compat/pinocchio/coverage/coverage.py", "compat/pinocchio/types/arguments.py"},
}
OVERRIDDEN = {  # methods and attributes of Numba's classes that ours override
    "_finalize_final_module": COMPILED + "inlining.py", "_optimize_final_module": COMPILED + "inlining.py",
    "_finalized": COMPILED + "inlining.py",
}  # fmt: skip


@cache
def nodes(file: str) -> list[ast.AST]:
    """Every node of a module's syntax tree."""
    return list(ast.walk(trees()[file]))


@cache
def own_names() -> set[str]:
    """Names that the modules define: functions, classes, arguments, variables, attributes of self, slots."""
    found = set()
    for file in trees():
        for node in nodes(file):
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                found.add(node.name)
            elif isinstance(node, ast.arg):
                found.add(node.arg)
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                found.add(node.id)
            elif isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store):
                found.add(getattr(node.slice, "value", ""))  # an entry of __dict__
            elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
                if isinstance(node.value, ast.Name) and node.value.id in ("self", "cls"):
                    found.add(node.attr)
            elif isinstance(node, ast.Assign) and any(getattr(t, "id", "") == "__slots__" for t in node.targets):
                found |= {x.value for x in ast.walk(node) if isinstance(x, ast.Constant)}
    return found


def dotted(node: ast.expr) -> str:
    """The text of ``a.b.c``; "" of another expression."""
    parts = []
    while isinstance(node, ast.Attribute):
        parts.append(node.attr)
        node = node.value
    return ".".join([node.id, *reversed(parts)]) if isinstance(node, ast.Name) else ""


def borrowed(inside: Iterable[ast.AST], own: set[str]) -> Iterator[str]:
    """The private names of other packages that a module of these nodes uses."""
    known = own | OF_TUPLES
    for node in inside:
        if isinstance(node, ast.ImportFrom) and node.level == 0 and (node.module or "").split(".")[0] in FOREIGN:
            for alias in node.names:
                if node.module not in PUBLIC or alias.name.startswith("_"):
                    yield f"{node.module}.{alias.name}"
        elif isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name.split(".")[0] in FOREIGN and a.name not in PUBLIC)
        elif isinstance(node, ast.Attribute):
            name = dotted(node)
            if name == "ctypes.pythonapi" or name.startswith(("numba.core", "numba.np", "np.core", "np._core")):
                yield name
            if node.attr.startswith("_") and not node.attr.startswith("__") and node.attr not in known:
                yield node.attr
        elif (
            isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("getattr", "setattr") and len(node.args) > 1
        ):
            name = getattr(node.args[1], "value", "")
            if isinstance(name, str) and name.startswith("_") and not name.startswith("__") and name not in own:
                yield name


@cache
def trees() -> dict[str, ast.Module]:
    """Syntax tree of every module, by its path in the package."""
    return {
        path.relative_to(PACKAGE).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
        for path in sorted(PACKAGE.rglob("*.py"))
    }


def test_private_parts_of_other_packages_stand_in_the_files_named_for_them() -> None:
    found: dict[str, set[str]] = {}
    own = own_names()
    for file in trees():
        for name in borrowed(nodes(file), own):
            found.setdefault(name, set()).add(file)
    assert found == BORROWED


def test_what_replaces_numbas_own_methods_stands_in_one_file() -> None:
    names = {file: {getattr(n, kind, "") for n in nodes(file) for kind in ("name", "attr")} for file in trees()}
    for name, file in OVERRIDDEN.items():
        assert {f for f, known in names.items() if name in known} == {file}


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("from numba.core import types", "numba.core.types"),
        ("from numba.core.caching import _Cache", "numba.core.caching._Cache"),
        ("from numba import _dispatcher", "numba._dispatcher"),
        ("import numba.core.registry", "numba.core.registry"),
        ("import ctypes", "ctypes"),
        ("from ctypes import pythonapi", "ctypes.pythonapi"),
        ("from numpy._core import umath", "numpy._core.umath"),
        ("x = np._core.umath", "np._core.umath"),
        ("dispatcher._make_finalizer()", "_make_finalizer"),
        ("dispatcher._can_compile = False", "_can_compile"),
        ('getattr(dispatcher, "_compiler")', "_compiler"),
    ],
)
def test_another_borrowed_name_is_found(line: str, name: str) -> None:
    assert name in set(borrowed(ast.walk(ast.parse(line)), own_names()))
