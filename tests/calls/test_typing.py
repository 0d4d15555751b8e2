"""The stub through which type checkers see the public calls, which are made from specs when the package loads.

``python tests/calls/test_typing.py`` writes it anew after a spec has changed.
"""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
from pathlib import Path

import pytest

import spatialdyn
import spatialdyn as sd
from spatialdyn.calls import dynamics
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import Spec

STUB = Path(dynamics.__file__).with_suffix(".pyi")
ROOT = Path(spatialdyn.__file__).parents[1]
WORDS = {"frame": "str | Frame", "reference": "Reference", "classical": "bool", "out": "Array | None"}
HEAD = '''"""The public calls, for type checkers: made from ``recursions.SPECS`` by tests/calls/test_typing.py."""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..model.model import Frame, Model
from ..recursions.spec import Spec

Array = NDArray[np.float64]
Reference = Literal["local", "world", "local_world_aligned"]

__all__ = {names}
calls: dict[str, Callable[..., Any]]
python_calls: dict[str, Callable[..., Any]]

def checked_call(spec: Spec, model: Model, values: tuple[Any, ...], static: tuple[Any, ...], out: Any) -> Any: ...
def set_num_threads(n: int) -> None: ...
def table_call(name: str, model: Model, *values: Any) -> Any: ...
def total_mass(model: Model) -> float: ...
'''


def declaration(spec: Spec) -> str:
    """One function of the stub, from the signature it really has."""
    parameters = ["model: Model"]
    for name, p in list(inspect.signature(dynamics.calls[spec.name]).parameters.items())[1:]:
        kind = WORDS.get(name, "ArrayLike" if p.default is p.empty else "ArrayLike | None")
        parameters.append(f"{name}: {kind}" + ("" if p.default is p.empty else " = ..."))
    result = "Array" if spec.output.shape else "float | Array"
    line = f"def {spec.name}({', '.join(parameters)}) -> {result}: ..."
    if len(line) <= 120:
        return line + "\n"
    inner = f"    {', '.join(parameters)}"
    if len(inner) <= 120:
        return f"def {spec.name}(\n{inner}\n) -> {result}: ...\n"
    return f"def {spec.name}(\n" + "".join(f"    {p},\n" for p in parameters) + f") -> {result}: ...\n"


def stub() -> str:
    names = sorted(["set_num_threads", "total_mass", *SPECS])
    listed = "[\n" + "".join(f'    "{name}",\n' for name in names) + "]"
    return HEAD.replace("{names}", listed) + "".join(declaration(spec) for spec in SPECS.values())


def test_stub_declares_every_call_as_it_is() -> None:
    assert STUB.read_text(encoding="utf-8") == stub(), "run python tests/calls/test_typing.py"


USER = """
import numpy as np
import spatialdyn
import spatialdyn as sd
import spatialdyn.compat.pinocchio as pin
from spatialdyn.compat.pinocchio import SE3, rnea

model = sd.load_urdf("two_link")
tau: np.ndarray = sd.rnea(model, [0.1, 0.2], np.zeros(2), np.zeros(2))
T = sd.kinetic_energy(model, tau, tau)
J = sd.frame_jacobian(model, tau, "tip", reference="world")
mass: float = sd.total_mass(model)
other = sd.ModelBuilder("robot").add_body("a").build()
nq: int = other.nq
placement: SE3 = pin.SE3.Identity()
same = pin.rnea is rnea
arm = pin.buildSampleModelManipulator()
data = arm.createData()
torque: np.ndarray = rnea(arm, data, tau, tau, tau, [pin.Force.Zero()])
moved: pin.Motion = pin.getFrameVelocity(arm, data, 1, pin.LOCAL)
energy: float = pin.computeKineticEnergy(arm, data)
"""


# packages that a few functions need, whose thousands of files take mypy longer than the library
UNREAD = "cvxpy", "dask", "distributed", "IPython", "jax", "jaxlib", "qpsolvers", "sphinx", "trimesh", "viser"
SKIP = """
[[tool.mypy.overrides]]
module = {modules}
follow_imports = "skip"
"""


@pytest.mark.slow(quick="test_stub_declares_every_call_as_it_is")
def test_package_and_a_users_script_pass_mypy_strict(tmp_path: Path) -> None:
    """At once, by the package's own configuration but for what it imports of UNREAD, which is Any."""
    script, configuration = tmp_path / "script.py", tmp_path / "pyproject.toml"
    script.write_text(USER, encoding="utf-8")
    own = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    skip = SKIP.format(modules=json.dumps([f"{name}.*" for name in UNREAD]))
    configuration.write_text(own + skip, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--config-file", str(configuration), "--no-incremental"]
    command += ["spatialdyn", str(script)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stdout[-3000:]


def test_every_public_name_has_a_docstring() -> None:
    bare = [name for name in sd.__all__ if not (getattr(sd, name).__doc__ or "").strip()]
    assert bare == []


def test_help_gives_shapes_units_and_errors() -> None:
    text = sd.aba.__doc__
    for part in ("q         (..., nq)", "[rad | m]", "fext", "ShapeError", "InertiaError", "Featherstone", "Returns"):
        assert part in text
    assert list(inspect.signature(sd.aba).parameters) == ["model", "q", "v", "tau", "fext", "out"]


if __name__ == "__main__":
    STUB.write_text(stub(), encoding="utf-8")
