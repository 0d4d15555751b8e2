"""Odd values of every parameter of every public name: answered, or refused by an error of this library.

One value at a time takes the place of a valid argument of ``valid_calls``. Then the call returns, or raises a
SpatialDynError, an error that its docstring names, or a TypeError that a ``raise`` of this package made on purpose; a
warning counts as an error.
"""

from __future__ import annotations

import ast
import copy
import inspect
import linecache
import math
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import valid_calls
from valid_calls import arguments, function, other, places, targets

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.threads import thread_pool
from spatialdyn.recursions import SPECS
from spatialdyn.waiting import Watch

PACKAGE = Path(sd.__file__).parent


def deep(levels: int) -> Any:
    """A list in lists."""
    made: Any = [1.0]
    for _ in range(levels - 1):
        made = [made]
    return made


ODD: dict[str, Any] = {
    "None": None,
    "5": 5,
    "-1": -1,
    "10**5000": 10**5000,  # of more digits than Python prints
    "1e300": 1e300,
    "-0.0": -0.0,
    "5e-324": 5e-324,
    "True": True,
    "nan": math.nan,
    "inf": math.inf,
    "x": "x",
    "nothing": "",
    "bytes": b"x",
    "surrogate": "\udc80",
    "[[1]]": [[1]],
    "[]": [],
    "{}": {},
    "{x: x}": {"x": "x"},
    "object": object(),
    "complex": np.array([1j, 2.0]),
    "objects": np.array([None, "x"], object),
    "no axis": np.array(None, object),
    "structured": np.zeros(2, [("a", float), ("b", int)]),
    "masked": np.ma.masked_array([1.0, 2.0], [False, True]),
    "bools": np.array([True, False]),
    "large": np.array([1e300, -1e300]),
    "small": np.array([5e-324, -0.0]),
    "nans": np.array([math.nan, 1.0]),
    "infs": np.array([math.inf, 1.0]),
    "ragged": [[1.0], [1.0, 2.0]],
    "33 axes": deep(33),
    "65 axes": deep(65),
    "(2, 3, 7)": np.ones((2, 3, 7)),
    "empty": np.empty((0, 2)),
    "model": None,  # another model
    "generator": None,  # of words
}


TAKES_LONG = {("compile", "calls"): ("None",)}  # all calls
SHORT = {  # a formula, or one that runs in slices, which are named once there is a second one
    "base_velocity", "cartesian_damping", "constrained_dynamics", "constrained_dynamics of J",
    "constrained_dynamics_derivatives", "constraint_drift", "constraint_error", "constraint_jacobian",
    "contact_gaps", "contact_step", "contact_wrench", "critical_gains", "delassus", "detection_thresholds", "exact",
    "forward_dynamics", "fourier", "friction_regressor", "friction_torque", "from_drake", "from_mujoco",
    "hamilton_equations", "hamilton_simulation", "impact", "impact of J", "independent_joints", "largest_step",
    "linearize", "mobility", "momentum_observer_step", "operational_space_coupling", "project_velocity", "quintic",
    "rollout", "set_num_threads", "simulate", "spline", "spring_energy", "spring_torque", "step",
    "step_derivatives", "study", "to_actuators", "to_drake", "to_joints", "to_mujoco", "torque_limits",
    "total_mass", "trapezoid", "wrench_at",
}  # fmt: skip
PACKAGES = {  # by the beginning of a name
    "from_mjmodel": "mujoco", "from_pinocchio": "pinocchio", "compare_with_pinocchio": "pinocchio",
    "Symbolic": "sympy", "view": "viser",
    "plot": "matplotlib", "Tradeoff": "matplotlib", "Trajectory": "matplotlib", "Rollout": "matplotlib",
    "EnergyLedger": "matplotlib", "Diagnosis": "matplotlib", "Specialized": "casadi", "Exact": "mpmath",
    "exact": "mpmath", "trade": "mpmath", "recommend": "mpmath", "Recommendation": "mpmath",
    "Requirement": "matplotlib", "Identified": "matplotlib", "WholeBody": "qpsolvers",
}  # fmt: skip


COMPILED = (
    "Promise", "bounded", "excitation", "export", "hamilton_simulation", "simulate", "specialize", "recommend",
    "requires", "Requirement",
)  # fmt: skip


def odd(name: str) -> Any:
    """A new value of that name: calls with ``out`` write into theirs."""
    made: dict[str, Any] = {"model": other, "generator": lambda: (x for x in "ab")}
    return made[name]() if name in made else copy.deepcopy(ODD[name])


@cache
def raising(file: str) -> list[range]:
    """The lines of the ``raise`` statements of a file."""
    tree = ast.parse("".join(linecache.getlines(file)))
    return [range(x.lineno, (x.end_lineno or x.lineno) + 1) for x in ast.walk(tree) if isinstance(x, ast.Raise)]


def on_purpose(error: TypeError) -> bool:
    """Whether a ``raise`` of this package made the error."""
    trace = error.__traceback__
    assert trace is not None
    while trace.tb_next is not None:
        trace = trace.tb_next
    file = trace.tb_frame.f_code.co_filename
    return file.startswith(str(PACKAGE)) and any(trace.tb_lineno in lines for lines in raising(file))


def documented(call: Callable[..., Any], error: BaseException) -> bool:
    """Whether the docstring of a call, or of its class, names the error."""
    owner = getattr(call, "__self__", None)
    texts = [inspect.getdoc(x) or "" for x in (call, owner if inspect.isclass(owner) else type(owner))]
    return any(type(error).__name__ in text for text in texts)


def called(target: str, given: dict[str, Any]) -> None:
    """Call a target with arguments by name; those of ``*name`` by that name, too, one or a tuple of them."""
    given = dict(given)
    starred = [given.pop(x.name) for x in places(target) if x.kind is x.VAR_POSITIONAL and x.name in given]
    spread = starred[0] if starred and isinstance(starred[0], tuple) else starred
    made = function(target)(*spread, **given)
    if target == "view":
        made.stage.stop()


def complaint(target: str, given: dict[str, Any]) -> str:
    """What is wrong with how a call answers; empty if nothing is."""
    try:
        called(target, given)
    except sd.SpatialDynError:
        pass
    except Exception as error:
        if not (isinstance(error, TypeError) and on_purpose(error)) and not documented(function(target), error):
            return f"{type(error).__name__}: {error}"[:200]
    return ""


def parameters(target: str) -> list[str]:
    """The parameters that a target may be given by name, and those of ``*name``."""
    named = [x.name for x in places(target) if x.kind is not x.VAR_KEYWORD]
    rest = [x for x in arguments(target) if x not in named]
    return [x for x in named if not (rest and x == "given")] + rest


def need(name: str) -> None:
    """Skip the test where a package that a name is of is not installed, or what it is made of is not compiled."""
    if numba_kernels.PLAIN and name in COMPILED:
        pytest.skip("NUMBA_DISABLE_JIT: without programs, or minutes of plain Python")
    for start, package in PACKAGES.items():
        if name.startswith(start):
            pytest.importorskip(package)


def of(name: str) -> list[str]:
    """The targets of a public name: itself, if it is not a record, and its methods."""
    return [x for x in targets() if x.partition(" of ")[0].partition(".")[0] == name]


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files to load, by name: written once, which takes longer than most calls."""
    folder = tmp_path_factory.mktemp("saved")
    valid_calls.run().save(folder / "run.npz")
    valid_calls.log().save(folder / "log.csv")
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(autouse=True)
def _elsewhere(saved: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """In a folder with a file to load, as some calls write files of odd names; with as many threads after it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    for name, content in saved.items():
        Path(name).write_bytes(content)
    yield
    thread_pool.ask(None)


@pytest.mark.parametrize("name", sorted(sd.__all__))
def test_valid_arguments_are_answered(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that one odd value is what is refused; a public name without a row of arguments fails.

    Calls whose time has no bound are named by ``waiting.watch`` as they begin.
    """
    need(name)
    begun: list[Any] = []
    right = Watch.after
    monkeypatch.setattr(Watch, "after", lambda self, text: right(self, begun.append(text) or text))
    for target in of(name):
        given = arguments(target)
        begun.clear()
        called(target, given)
        assert begun or target in SHORT or not long(target), target


def long(target: str) -> bool:
    """Whether the time of a call grows with what it is given; those on batches of samples are named by the engines."""
    name, _, method = target.partition(" of ")[0].partition(".")
    if method:
        return method in ("plot", "report", "load", "save", "validate")
    return name not in SPECS and not inspect.isclass(getattr(sd, name))


def test_missing_and_unknown_arguments_are_refused_in_the_public_names() -> None:
    """As Python's own message has it, or a ``raise`` here; not that of a private function behind the call."""
    wrong = {}
    for target in targets():
        name = target.partition(" of ")[0]
        if (numba_kernels.PLAIN and name.startswith(COMPILED)) or "." in name:
            continue
        for given in ({}, {"nope": 1}):
            try:
                function(name)(**given)
            except TypeError as error:
                said = re.match(r"(?:(\w+)\.)?(\w+)\(\) ", str(error))
                if said and not {name, function(name).__name__} & {*said.groups()}:
                    wrong[target] = str(error)
            except sd.SpatialDynError:
                pass
    for call in (sd.constrained_dynamics, sd.impact):
        words = rf"{call.__name__} of (a Jacobian|Constraints): missing .*expected \(model, "
        for first in ((), ([0.0, 0.0],), (valid_calls.held(),)):
            with pytest.raises(TypeError, match=words):
                call(valid_calls.model(), *first)  # type: ignore[call-overload]
    assert wrong == {}


@pytest.mark.parametrize("name", sorted(sd.__all__))
def test_odd_values_are_answered_or_refused_with_reason(name: str) -> None:
    need(name)
    wrong = {
        (target, parameter, value): said
        for target in of(name)
        for parameter in parameters(target)
        for value in ODD
        if value not in TAKES_LONG.get((target, parameter), ())
        if (said := complaint(target, arguments(target) | {parameter: odd(value)}))
    }
    assert wrong == {}


@pytest.mark.parametrize("name", sorted(sd.__all__))
def test_batches_that_do_not_fit_are_answered_or_refused_with_reason(name: str) -> None:
    need(name)
    wrong = {
        (target, parameter): said
        for target in of(name)
        for parameter, given in misfits(target)
        if (said := complaint(target, given))
    }
    assert wrong == {}


def misfits(target: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Arguments whose arrays have axes that do not broadcast: three of one beside two of the others."""
    given = arguments(target)
    arrays = [name for name, x in given.items() if isinstance(x, np.ndarray) and x.ndim]
    for name in arrays:
        yield name, given | {x: np.stack([given[x]] * (3 if x == name else 2)) for x in arrays}
