"""``install``: which module ``import pinocchio`` is, in whose imports, until when, and what is refused."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

import spatialdyn

ROOT = str(Path(spatialdyn.__file__).parents[1])
HEAD = "import spatialdyn.compat.pinocchio as pin\npin.install()\n"


def run(code: str, *folders: Path) -> str:
    """What a new process prints that runs this code; folders are looked in for modules. It must succeed."""
    paths = [*map(str, folders), ROOT, *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def client(tmp_path: Path) -> Path:
    """A folder with a package that imports Pinocchio in the forms that packages do, and makes models."""
    package = tmp_path / "client_of_pinocchio"
    package.mkdir()
    (package / "__init__.py").write_text("""
import pinocchio
import pinocchio as pin
import pinocchio.rpy as r
import pinocchio.utils
import pinocchio.visualize
from pinocchio import SE3, rnea, JointModelFreeFlyer
from pinocchio.robot_wrapper import RobotWrapper
from pinocchio.utils import *
from .deeper import neutral

def load(path):
    return RobotWrapper.BuildFromURDF(path, [], JointModelFreeFlyer())

def arm() -> pin.Model:
    model = pin.Model()
    model.addJoint(0, pin.JointModelRX(), SE3.Identity(), "a")
    return model
""")
    (package / "deeper.py").write_text(
        "def neutral(model):\n    import pinocchio.explog\n    return pinocchio.neutral(model)"
    )
    return tmp_path


def test_packages_that_are_imported_later_import_this_package(client: Path) -> None:
    urdf = Path(ROOT) / "urdf" / "two_link.urdf"
    printed = run(
        f"""{HEAD}
import importlib.util, sys
import numpy as np
import client_of_pinocchio as client
assert client.pinocchio is client.pin is pin
assert client.r is pin.rpy and client.RobotWrapper is pin.RobotWrapper and client.rnea is pin.rnea
robot = client.load({str(urdf)!r})
q = client.neutral(robot.model)
print(pin.rnea(robot.model, robot.data, q, np.zeros(8), np.zeros(8)).shape, type(client.arm()) is pin.Model)
for name, module in list(sys.modules.items()):
    if name.startswith("pinocchio."):
        assert module is sys.modules["spatialdyn.compat." + name], name
        assert module.__spec__.name == module.__name__ == "spatialdyn.compat." + name
assert importlib.util.find_spec("pinocchio") is pin.__spec__
""",
        client,
    )
    assert printed == "(8,) True\n"


def test_casadi_under_pinocchios_name_is_this_packages() -> None:
    pytest.importorskip("casadi")
    run(f"{HEAD}import pinocchio.casadi as cpin\nassert cpin.__name__ == 'spatialdyn.compat.pinocchio.casadi'")
    run(f"{HEAD}from pinocchio import casadi as cpin\nassert cpin.__name__ == 'spatialdyn.compat.pinocchio.casadi'")


def test_robots_of_example_robot_data_are_models_of_this_package() -> None:
    """Where its loaders, a package beside its files, are installed."""
    if importlib.util.find_spec("example_robot_data") is None:
        pytest.skip("example-robot-data-loaders is not installed")
    code = """
import warnings
warnings.simplefilter("ignore", UserWarning)
import example_robot_data
robot = example_robot_data.load("panda")
assert type(robot.model) is pin.Model
print(pin.rnea(robot.model, robot.data, robot.q0, robot.v0, robot.v0).shape)
"""
    assert run(HEAD + code) == "(9,)\n"


def test_uninstall_gives_pinocchio_back(client: Path) -> None:
    stands_for_the_wheel = client / "pinocchio"
    stands_for_the_wheel.mkdir()
    (stands_for_the_wheel / "__init__.py").write_text("own = True\n")
    code = f"""{HEAD}
import sys
import pinocchio, pinocchio.utils
assert pinocchio is pin
pin.install()
pin.uninstall()
assert not any(name.partition(".")[0] == "pinocchio" for name in sys.modules)
assert not any(type(finder).__module__.startswith("spatialdyn") for finder in sys.meta_path)
import pinocchio
assert pinocchio.own
pin.uninstall()
assert sys.modules["pinocchio"] is pinocchio
try:
    pin.install()
except ValueError as error:
    print(error)
"""
    printed = run(code, client)
    assert printed.startswith("pinocchio is imported already, from ")
    assert printed.rstrip().endswith("__init__.py, expected install() before its first import")


def test_pinocchio_itself_in_the_process_is_named() -> None:
    pytest.importorskip("pinocchio")
    code = "import pinocchio\nimport spatialdyn.compat.pinocchio as pin\ntry:\n    pin.install()\n"
    assert "pinocchio is imported already, from " in run(f"{code}except ValueError as error:\n    print(error)")


# --- what is refused --------------------------------------------------------------------------------------

REFUSED = """
import importlib
for name in {names!r}:
    try:
        importlib.import_module(name)
    except ImportError as error:
        print(type(error).__name__, error)
"""


def refusals(*names: str, folders: tuple[Path, ...] = ()) -> list[str]:
    """The class and text of the error that importing each module raises once this package is installed."""
    return run(HEAD + REFUSED.format(names=names), *folders).splitlines()


@pytest.mark.parametrize("mark", [b"libpinocchio_default.so.4", b"_ZN9pinocchio4rnea", b"?rnea@pinocchio@@YA"])
def test_an_extension_module_compiled_against_pinocchio_is_refused_by_name(tmp_path: Path, mark: bytes) -> None:
    """The file is no library: loading it would be another error."""
    for at, content in (("linked", b"\x7fELF" + mark), ("free", b"\x7fELF lib")):
        package = tmp_path / at
        package.mkdir()
        (package / "__init__.py").write_text("import pinocchio\nfrom . import core\n")
        (package / f"core{EXTENSION_SUFFIXES[0]}").write_bytes(content)
    linked, free = refusals("linked", "free", folders=(tmp_path,))
    assert linked.startswith("OutOfScopeImportError linked.core is compiled against Pinocchio's C++ library")
    assert free.startswith("ImportError")
    assert (
        run(
            "import sys\nsys.modules['pinocchio'] = sys\ntry:\n    import linked\nexcept ImportError as x:\n    "
            "print(type(x).__name__)",
            tmp_path,
        )
        == "ImportError\n"
    )  # as without install


def test_what_links_nothing_of_pinocchio_is_imported() -> None:
    run(HEAD + "import numpy, numba")


@pytest.mark.parametrize("name", ["coal", "eigenpy", "hppfcl"])
def test_libraries_that_pinocchio_links_are_imported(name: str) -> None:
    if importlib.util.find_spec(name) is None:
        pytest.skip(f"{name} is not installed")
    run(HEAD + f"import warnings\nwarnings.simplefilter('ignore')\nimport {name}")


def test_modules_of_pinocchio_that_are_not_here_are_named() -> None:
    found = refusals("pinocchio.pinocchio_pywrap_default", "pinocchio.serialization", "pinocchio.nonsense")
    assert found[0].startswith("OutOfScopeImportError pinocchio.pinocchio_pywrap_default is not supported: internals")
    assert found[1].startswith("OutOfScopeImportError pinocchio.serialization is not supported: archives: pickle")
    assert found[2] == "ModuleNotFoundError No module named 'pinocchio.nonsense'"


def test_a_comparison_with_pinocchio_does_not_compare_this_package_with_itself() -> None:
    code = """
from spatialdyn.validate import pinocchio
try:
    pinocchio()
except ValueError as error:
    print(error)
"""
    wanted = "pinocchio is spatialdyn.compat.pinocchio, expected Pinocchio itself, as after its uninstall()"
    assert run(HEAD + code).rstrip() == wanted
