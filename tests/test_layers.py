"""Which room may import which, touch files, print: the table of rooms, checked against the sources."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path

import pytest

import spatialdyn
from spatialdyn.calls.dynamics import calls
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.compiled.stamp import COMPILED, package_folder
from spatialdyn.recursions import SPECS

PACKAGE = Path(spatialdyn.__file__).parent

# Each room and the rooms right below it. A room may import what is below it, however far down, and nothing else.
BELOW: dict[str, tuple[str, ...]] = {
    "errors": (),
    "waiting": (),
    "algebra": (),
    "bodies": ("algebra",),
    "recursions": ("bodies",),
    "model": ("bodies", "errors", "waiting"),
    "urdf": ("model",),
    "engines": ("recursions", "errors", "waiting"),
    "calls": ("model", "engines"),
    "actuation": ("calls",),
    "constraints": ("calls",),
    "lagrangian": ("calls", "urdf"),
    "interop": ("calls",),
    "control": ("actuation",),
    "sources": ("constraints", "actuation", "urdf"),
    "simulation": ("lagrangian", "sources", "control"),
    "linearization": ("simulation",),
    "monitors": ("simulation",),
    "operational": ("simulation",),
    "embedded": ("simulation",),
    "identification": ("simulation",),
    "studies": ("simulation",),
    "accuracy": ("identification",),
    "validate": ("interop", "urdf"),
    "pictures": ("validate", "accuracy", "monitors"),
    "compat": ("pictures", "accuracy", "interop", "urdf", "sources"),
    "__init__": ("accuracy", "linearization", "operational", "validate", "pictures", "sources", "studies", "embedded"),
    "examples": ("__init__", "compat"),
    "docs": ("examples",),
    "commands": ("docs",),
    "__main__": ("commands",),
}
# What lies in a room of several, low to high: each may import those before it.
FLOORS: dict[str, tuple[str, ...]] = {
    "engines": (
        "locks", "threads", "interrupt", "memory", "object_layout", "tables", "compiled", "programs",
        "numbers", "failed", "by_table_kernel", "run", "extended",
    ),
    "compat": ("native", "pinocchio"),
    "compat.pinocchio": ("coverage", "types", "model", "data", "algorithms"),
}  # fmt: skip
LOOSE = {"__init__", "__main__", "errors", "waiting"}  # the only modules at the package's root
# Imports that go up nonetheless, made by a function when it is called.
UPWARD: dict[tuple[str, str], str] = {
    (room, "pictures"): "methods that draw"
    for room in (
        "calls",
        "model",
        "lagrangian",
        "simulation",
        "monitors",
        "control",
        "identification",
        "accuracy",
        "validate",
    )
} | {("calls", "interop"): "methods that hand a program to another framework"}
# Functions below ``pictures`` that draw: each is a docstring, one import from there, and one call.
DRAW: dict[str, set[str]] = {
    "model.model": {"_repr_html_"},
    "lagrangian.symbolic_manipulator": {"_repr_html_"},
    "simulation.trajectory": {"plot", "report", "_repr_html_"},
    "simulation.rollout_result": {"plot", "_repr_html_"},
    "monitors.ledger": {"plot"},
    "calls.progress": {"bar"},
    "control.paths": {"plot"},
    "monitors.monitors": {"plot"},
    "identification.identified": {"report"},
    "accuracy.requirement": {"plot", "_repr_html_"},
    "accuracy.results": {"plot", "report", "_repr_html_"},
    "accuracy.findings": {"report", "_repr_html_"},
    "validate.rows": {"_repr_html_"},
}

# What functions change in a module nonetheless, under a lock: caches and settings that no result depends on.
CHANGED = {
    "engines.programs.run.batch_kernels": {"_programs", "_codes"}, "engines.compiled.disk_cache": {"_done"},
    "algebra.scalars": {"_waiting"}, "engines.compiled.numba_kernels": {"_made"},
    "engines.interrupt": {"_at_work"}, "engines.locks": {"_forking", "_made", "_held"},
}  # fmt: skip

# what recursions import of their own room
SHARED = {
    "spec", "momenta.energy", "tree.rnea", "tree.crba", "tree.aba", "momenta.coriolis", "momenta.hamilton",
    "tree.kinematics", "momenta.centroidal", "tree.ltdl", "derivatives.derivatives", "tree.square_root_rows",
    "tree.square_root_inertia", "coordinates.configuration_off_norm", "tree.rnea_off_norm", "steps", "signatures",
    "constraints.constraint_rows", "constraints.dense", "tree.rotors", "constraints.constrained",
    "contact.coulomb_cone", "joints.friction", "coordinates.configuration", "contact.contact_rows", "tree.aba_motors",
    "tree.regressor", "momenta.adaptive_regressors", "control.control_laws",
    "control.adaptive_laws", "control.composite_laws",
    "control.inverse_kinematics", "contact.impulses", "contact.impulse_rows", "contact.newton_step", "control.paths",
    "coordinates.coordinate_rates", "contact.impulse_step",
}  # fmt: skip
TOUCH_FILES = {"urdf", "sources", "engines", "pictures", "docs", "studies", "embedded", "waiting"}  # and a fork
# themselves, a script, and loops in TOML; two read an environment variable
SAVE = {
    "simulation.trajectory", "identification.recording", "identification.tables",
    "compat.pinocchio.model.serialization_format", "commands.port", "commands.robots", "commands.excite",
    "commands.identify",
    "compat.pinocchio.coverage.strictness", "compat.pinocchio.visualize.visualizers", "examples.c_export",
}  # fmt: skip
NAME_FILES = {"validate", "commands", "examples"}  # pass a file name to Pinocchio; width of the terminal; pictures
PRINT = {"commands", "examples"}
LOGS = "calls.progress"  # which engines report to by a function that it hands them
COMPILES_ITS_OWN = {"examples.own_loop", "examples.ilqr"}  # loops as users write them: the stamp names neither
FILE_MODULES = {"io", "os", "pathlib", "shutil", "tempfile", "glob", "fileinput", "mmap"}
FILE_CALLS = {
    "open", "read_text", "read_bytes", "write_text", "write_bytes", "glob", "rglob", "iterdir", "unlink", "mkdir",
    "fromfile", "tofile", "loadtxt", "savetxt", "genfromtxt", "memmap",
}  # fmt: skip
LATE = {
    "yourdfpy", "lxml", "trimesh", "pinocchio", "rich", "scipy", "mpmath", "matplotlib", "sympy", "pandas", "viser",
    "IPython", "qpsolvers", "casadi", "jax", "torch", "mujoco", "xacrodoc", "robot_descriptions", "sphinx",
    "cvxpy", "clarabel", "dask", "distributed", "daqp", "cuda", "cupy",
}  # fmt: skip
HEAVY = {"numba", "llvmlite", "concurrent.futures"}  # no import of the package needs them
MUTATORS = {"append", "extend", "insert", "add", "update", "setdefault", "pop", "popitem", "clear", "remove", "discard"}


FILES = {".".join(path.relative_to(PACKAGE).with_suffix("").parts): path for path in sorted(PACKAGE.rglob("*.py"))}
NAMES = sorted(FILES)


@cache
def tree_of(name: str) -> ast.Module:
    """Syntax tree of a module, of its dotted name below the package."""
    return ast.parse(FILES[name].read_text(encoding="utf-8"))


def holds_for(names: list[str]) -> Callable[[Callable[[str], None]], Callable[[], None]]:
    """A test of every one of these modules; fails with those that fail."""

    def over(test: Callable[[str], None]) -> Callable[[], None]:
        def of_all() -> None:
            wrong = {}
            for name in names:
                try:
                    test(name)
                except AssertionError as error:
                    wrong[name] = str(error)
            assert names
            assert wrong == {}

        return of_all

    return over


@cache
def nodes(name: str) -> list[ast.AST]:
    """Every node of a module's syntax tree."""
    return list(ast.walk(tree_of(name)))


def room_of(name: str) -> str:
    """The room in which a module lives."""
    return name.split(".")[0]


def home_of(name: str) -> str:
    """The room of a module as the stamp names it: a folder, of ``compat`` its own folders."""
    parts = name.split(".")
    return "/".join(parts[: 2 if parts[0] == "compat" else 1])


def everything_below(room: str) -> set[str]:
    """All rooms that a room stands on; a room that BELOW lacks fails the tests of the table alone."""
    return {room}.union(*(everything_below(lower) for lower in BELOW.get(room, ())))


def own_imports(name: str) -> Iterator[str]:
    """Dotted names below the package of the modules that a module imports, wherever in it."""
    package = ["spatialdyn", *name.split(".")[:-1]]
    for node in nodes(name):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[2] or "__init__" for alias in node.names if is_own(alias.name))
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) + 1 - node.level] if node.level else []
            source = ".".join([*base, *(node.module or "").split(".")]).rstrip(".")
            if is_own(source):
                inner = source.partition(".")[2]
                for alias in node.names:
                    deeper = f"{inner}.{alias.name}".lstrip(".")
                    yield deeper if is_module(deeper) else inner or "__init__"


def is_own(source: str) -> bool:
    """Whether a dotted name is of this package."""
    return source.split(".")[0] == "spatialdyn"


def is_module(name: str) -> bool:
    """Whether a dotted name below the package is a module or a folder of them."""
    return name in FILES or f"{name}.__init__" in FILES


def foreign_imports(name: str) -> set[str]:
    """Top-level names of the other packages that a module imports, wherever in it."""
    found = set()
    for node in nodes(name):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add((node.module or "").split(".")[0])
    return found


def called(name: str) -> Iterator[tuple[str, str]]:
    """Calls in a module: ("", f) for f(...), ("x", f) for x.f(...)."""
    for node in nodes(name):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            yield "", node.func.id
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            value = node.func.value
            yield value.id if isinstance(value, ast.Name) else "?", node.func.attr


# --- imports --------------------------------------------------------------------------------------------


def test_every_module_has_its_room_in_the_table() -> None:
    assert {room_of(name) for name in NAMES} <= set(BELOW)


def test_the_table_has_no_circle_and_no_unknown_room() -> None:
    order = list(TopologicalSorter(BELOW).static_order())
    assert set(order) == set(BELOW)


@holds_for(NAMES)
def test_no_module_imports_one_above_or_beside_it(name: str) -> None:
    room = room_of(name)
    exempt = {above for below, above in UPWARD if below == room}
    above = {imported for imported in own_imports(name) if room_of(imported) not in everything_below(room)}
    assert {imported for imported in above if room_of(imported) not in exempt} == set()


def test_every_exempt_import_is_still_made_and_by_a_function() -> None:
    for below, above in UPWARD:
        names = [name for name in NAMES if room_of(name) == below]
        assert above in {room_of(imported) for name in names for imported in own_imports(name)}
        for name in names:
            top = {(node.module or "") for node in tree_of(name).body if isinstance(node, ast.ImportFrom)}
            assert above not in {part for module in top for part in module.split(".")}


@holds_for([name for name in NAMES if "pictures" not in everything_below(room_of(name))])
def test_what_draws_below_pictures_is_one_late_import_and_one_call(name: str) -> None:
    found = set()
    for function in ast.walk(tree_of(name)):
        if isinstance(function, ast.FunctionDef) and any(_imports_pictures(node) for node in ast.walk(function)):
            found.add(function.name)
            body = function.body[1:] if ast.get_docstring(function) else function.body
            assert [type(node) for node in body] in ([ast.ImportFrom, ast.Return], [ast.ImportFrom, ast.Expr])
    assert found == DRAW.get(name, set())


def _imports_pictures(node: ast.AST) -> bool:
    return isinstance(node, ast.ImportFrom) and "pictures" in (node.module or "").split(".")


def test_modules_of_one_room_import_each_other_in_no_circle() -> None:
    graph = {name: {m for m in own_imports(name) if m != name and room_of(m) == room_of(name)} for name in NAMES}
    list(TopologicalSorter(graph).static_order())  # raises CycleError


@holds_for([name for name in NAMES if room_of(name) == "recursions"])
def test_recursions_know_tables_and_numbers_only(name: str) -> None:
    own = set(own_imports(name))
    assert {room_of(m) for m in own} <= {"recursions", *everything_below("bodies")}
    if not name.endswith("__init__"):
        assert {m for m in own if room_of(m) == "recursions"} <= {f"recursions.{shared}" for shared in SHARED}
    # an array library in here would be the place where a recursion allocates; Spec names a dtype
    arrays = {"numpy"} if name == "recursions.spec" else set()
    assert foreign_imports(name) & {"numpy", "numba", "llvmlite", "scipy"} <= arrays


@holds_for([name for name in NAMES if room_of(name) == "recursions"])
def test_signatures_of_recursions_name_what_they_take(name: str) -> None:
    """``bodies: Bodies``, not ``bodies: Any``."""
    for node in nodes(name):
        if isinstance(node, ast.FunctionDef):
            kinds = [ast.unparse(x.annotation) for x in node.args.args if x.annotation]
            assert "Any" not in kinds, node.name


@holds_for([name for name in NAMES if room_of(name) == "engines"])
def test_engines_know_recursions_by_their_specs_only(name: str) -> None:
    seen = {m for m in own_imports(name) if room_of(m) == "recursions"}
    assert seen <= {"recursions", "recursions.spec"}
    words = {node.value for node in nodes(name) if isinstance(node, ast.Constant)}
    words |= {node.id for node in nodes(name) if isinstance(node, ast.Name)}
    words |= {node.attr for node in nodes(name) if isinstance(node, ast.Attribute)}
    assert words & set(SPECS) == set()


@pytest.mark.parametrize("room", FLOORS)
def test_floors_of_a_room_import_downward(room: str) -> None:
    floors = [f"{room}.{floor}" for floor in FLOORS[room]]

    def floor_of(name: str) -> int | None:
        """The index of a module's floor, a folder or the module itself; None outside them."""
        return next((k for k, floor in enumerate(floors) if f"{name}.".startswith(f"{floor}.")), None)

    assert {floor_of(name) for name in NAMES} >= set(range(len(floors)))  # each is there
    for name in NAMES:
        own = floor_of(name)
        for imported in own_imports(name) if own is not None else ():
            assert (floor_of(imported) or 0) <= own, (name, imported)


def test_no_file_stands_loose_at_the_root() -> None:
    assert {path.stem for path in PACKAGE.glob("*.py")} == LOOSE


def test_no_room_has_the_name_of_a_public_call() -> None:
    """``sd.view`` would turn into a package of that name as soon as it is imported."""
    assert set(BELOW) & set(spatialdyn.__all__) == set()


# --- files and output -----------------------------------------------------------------------------------


@holds_for([name for name in NAMES if room_of(name) not in TOUCH_FILES and name not in SAVE])
def test_only_some_rooms_touch_files(name: str) -> None:
    assert {f for _, f in called(name)} & FILE_CALLS == set()
    assert {f for of, f in called(name) if of in ("np", "numpy", "pickle", "json")} & {"load", "save", "dump"} == set()
    if room_of(name) not in NAME_FILES:
        assert foreign_imports(name) & FILE_MODULES == set()


@holds_for(NAMES)
def test_only_commands_and_examples_print_and_one_module_logs(name: str) -> None:
    assert ("logging" in foreign_imports(name)) == (name == LOGS)
    if room_of(name) not in PRINT:
        assert ("", "print") not in set(called(name))
        attributes = {node.attr for node in nodes(name) if isinstance(node, ast.Attribute)}
        assert attributes & {"stdout", "stderr"} == set()


# --- what may not be in any module ----------------------------------------------------------------------


@holds_for(NAMES)
def test_slow_and_optional_packages_are_imported_when_needed(name: str) -> None:
    late: set[str] = set()
    stack: list[ast.AST] = [tree_of(name)]
    while stack:
        node = stack.pop()
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            continue
        if isinstance(node, ast.Import):
            late |= {alias.name.split(".")[0] for alias in node.names} & LATE
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            late |= {(node.module or "").split(".")[0]} & LATE
        stack += ast.iter_child_nodes(node)
    assert late == set()


@pytest.mark.parametrize(
    ("name", "but"),
    [
        ("spatialdyn", set()),
        pytest.param(
            "spatialdyn.compat.pinocchio",
            {"llvmlite", "concurrent.futures"},
            marks=pytest.mark.skipif(numba_kernels.PLAIN, reason="its builtins are Python at once"),
        ),
    ],
)
def test_importing_the_package_imports_none_of_them(name: str, but: set[str]) -> None:
    """Importing Numba takes 0.2 s and brings SciPy where there is one; concurrent.futures is a thread pool's."""
    code = f"""
import sys, {name}
heavy = {(LATE | HEAVY) - but!r}
print(*sorted(name for name in sys.modules if name in heavy))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=PACKAGE.parent, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize("words", [["--help"], ["info", "two_link"], ["info", "--json"]])
def test_the_command_line_imports_what_it_uses(words: list[str]) -> None:
    code = f"""
import contextlib, io, sys
from spatialdyn.commands import cli
with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()) as shown:
    cli.main({words!r})
assert shown.getvalue()
heavy = {(LATE | HEAVY) - {"rich", "lxml"}!r} | {{"spatialdyn.accuracy", "spatialdyn.simulation", "spatialdyn.compat"}}
print(*sorted(name for name in sys.modules if name in heavy))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=PACKAGE.parent, check=True)
    assert done.stdout.split() == []


def test_public_names_that_are_imported_late_are_declared_for_type_checkers() -> None:
    """Under ``if TYPE_CHECKING``, from the module that has them."""
    branch = next(node for node in tree_of("__init__").body if isinstance(node, ast.If))
    lines = [node for node in branch.body if isinstance(node, ast.ImportFrom)]
    assert ast.unparse(branch.test) == "TYPE_CHECKING"
    declared = {alias.name: line.module for line in lines for alias in line.names}
    assert declared.pop("*") == "calls.dynamics"  # those of SPECS
    assert declared == spatialdyn._MODULE_OF
    for name, module in spatialdyn._MODULE_OF.items():
        assert getattr(spatialdyn, name) is getattr(import_module(f"spatialdyn.{module}"), name)
    for name in SPECS:
        assert getattr(spatialdyn, name) is calls[name]
    assert {x for x in vars(spatialdyn) if x in spatialdyn.__all__} == set(spatialdyn.__all__)  # kept once asked for


def test_rooms_are_attributes_of_the_package_without_an_import() -> None:
    code = """
import sys, spatialdyn
for room in spatialdyn._ROOMS:
    assert f"spatialdyn.{room}" not in sys.modules, room
    assert getattr(spatialdyn, room) is sys.modules[f"spatialdyn.{room}"]
"""
    subprocess.run([sys.executable, "-c", code], cwd=PACKAGE.parent, check=True)


@holds_for(NAMES)
def test_no_module_sets_attributes_of_what_another_one_made(name: str) -> None:
    """A class is whole where it is defined: nothing is put on it from outside when a module is imported."""
    imported = {x.asname or x.name for node in nodes(name) if isinstance(node, ast.ImportFrom) for x in node.names}
    changed = set()
    for statement in tree_of(name).body:
        if isinstance(statement, (ast.FunctionDef, ast.ClassDef)):
            continue
        for node in ast.walk(statement):
            if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store) and isinstance(node.value, ast.Name):
                changed.add(node.value.id)
            elif isinstance(node, ast.Call) and ast.unparse(node.func) == "setattr":
                changed.add(ast.unparse(node.args[0]))
    assert changed & imported == set()


def compiles(name: str) -> bool:
    """Whether a module makes functions for compiled code."""
    imported = {alias.name for node in nodes(name) if isinstance(node, ast.ImportFrom) for alias in node.names}
    makers = {"inline", "inline_unoptimized", "no_inline", "kernel_from_text", "njit"}
    makers |= {"register_jitable", "overload", "intrinsic", "compiled_as"}
    return bool(imported & makers) or bool({"numba", "llvmlite"} & foreign_imports(name))


@holds_for([name for name in NAMES if home_of(name) not in COMPILED and name not in COMPILES_ITS_OWN])
def test_what_the_stamp_leaves_out_compiles_nothing(name: str) -> None:
    assert not compiles(name)


def test_the_stamp_starts_from_the_package() -> None:
    assert package_folder() == PACKAGE.resolve()


def test_the_stamp_names_rooms_that_compile() -> None:
    compiling = {name for name in NAMES if compiles(name)}
    assert COMPILES_ITS_OWN <= compiling
    assert {home_of(name) for name in compiling - COMPILES_ITS_OWN} | {"bodies"} == set(COMPILED)


@holds_for([name for name in NAMES if home_of(name) in COMPILED])
def test_compiled_code_takes_no_constant_from_a_room_that_the_stamp_leaves_out(name: str) -> None:
    taken = set()
    for node in nodes(name):
        if isinstance(node, ast.ImportFrom) and node.module and node.level > name.count("."):
            constants = {alias.name for alias in node.names if alias.name.isupper()}
            taken |= set() if home_of(node.module) in COMPILED else constants
    assert taken == set()


@holds_for(NAMES)
def test_no_module_sets_fastmath_true(name: str) -> None:
    """``fastmath=True`` deletes checks for NaN."""
    asked = [node.value for node in nodes(name) if isinstance(node, ast.keyword) and node.arg == "fastmath"]
    for node in nodes(name):
        if isinstance(node, ast.Dict):
            pairs = zip(node.keys, node.values, strict=True)
            asked += [value for key, value in pairs if isinstance(key, ast.Constant) and key.value == "fastmath"]
    for value in asked:
        assert isinstance(value, ast.Set)
        assert {ast.literal_eval(flag) for flag in value.elts} == {"contract"}


def test_every_recursion_is_written_once() -> None:
    """Under its own name; the Pinocchio names are other functions, some of the same name."""
    written = Counter(
        node.name
        for name in NAMES
        if room_of(name) != "compat"
        for node in nodes(name)
        if isinstance(node, ast.FunctionDef)
    )
    assert {name: written[name] for name in {"rnea", "crba", "aba"}} == {"rnea": 1, "crba": 1, "aba": 1}
    assert {spec.recursion.__name__ for spec in SPECS.values() if written[spec.recursion.__name__] != 1} == set()


def test_facts_are_written_once() -> None:
    """The unit of rounding, and the velocity of a body from its parent's."""
    numbers = [
        name for name in NAMES for node in nodes(name)
        if isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value in (2.0**-52, 4e-16, 2e-6)
    ]  # fmt: skip
    assert sorted(numbers) == ["algebra.rotations", "algebra.scalars", "urdf.strict_xml"]  # the last: of an angle
    velocities = "motion_to_child(pose_of(here.X), motion_of(parent.v))", "motion_to_child(X, motion_of(parent.v))"
    lines = {name: ast.unparse(tree_of(name)) for name in NAMES if room_of(name) == "recursions"}
    assert {name for name, text in lines.items() if any(line in text for line in velocities)} == {"recursions.steps"}


@holds_for(NAMES)
def test_no_function_changes_what_its_module_holds(name: str) -> None:
    """Not by ``global``, nor by writing into a module's table, list or dict."""
    tree = tree_of(name)
    assert not any(isinstance(node, ast.Global) for node in nodes(name))
    held = {
        target.id
        for node in tree.body
        if isinstance(node, (ast.Assign, ast.AnnAssign))
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name)
    }
    found = set()
    for function in nodes(name) if held else ():
        if not isinstance(function, ast.FunctionDef):
            continue
        inside = list(ast.walk(function))
        local = {node.id for node in inside if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
        local |= {argument.arg for argument in inside if isinstance(argument, ast.arg)}
        for node in inside:
            changed: ast.AST | None = None
            if isinstance(node, (ast.Subscript, ast.Attribute)) and isinstance(node.ctx, (ast.Store, ast.Del)):
                changed = node.value
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in MUTATORS:
                changed = node.func.value
            if isinstance(changed, ast.Name) and changed.id in held - local:
                found.add(changed.id)
    assert found == CHANGED.get(name, set())


def test_tests_lie_in_folders_named_as_the_rooms() -> None:
    """tests/ROOM/test_*.py; what is of no single room, the package as a whole and its README, is at their root."""
    here = Path(__file__).parent
    folders = {path.parent.relative_to(here).as_posix() for path in here.rglob("test_*.py")} - {"."}
    # tests of the Pinocchio names are of whole scripts and classes, not one per module
    assert folders - {"compat"} <= {str(p.parent.relative_to(PACKAGE).as_posix()) for p in PACKAGE.rglob("__init__.py")}
    loose = {path.stem for path in here.glob("test_*.py")}
    assert loose == {
        "test_layers", "test_readme", "test_benchmarks", "test_seed", "test_dense", "test_words", "test_slow",
        "test_skips", "test_tolerances", "test_values",
        "test_errors", "test_odd_arguments", "test_public_names", "test_project",
    }  # fmt: skip
