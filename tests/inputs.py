"""Random inputs of any call, by its Spec; and Python in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import spatialdyn as sd
from spatialdyn.calls import dynamics
from spatialdyn.engines import run
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.recursions.spec import Argument, Spec

Array = NDArray[np.float64]
PACKAGE = Path(sd.__file__).parent
EPS = np.finfo(float).eps
MAIN_CALLS = (  # whose table kernels are compiled at once where the others wait for -m slow
    "rnea", "crba", "aba", "minverse", "coriolis_matrix", "frame_jacobian", "center_of_mass", "kinetic_energy",
    "integrate", "difference", "neutral",
)  # fmt: skip
WORDS = {"reference": "world", "classical": True}


def random_input(model: sd.Model, argument: Argument, rng: np.random.Generator, batch: tuple[int, ...] = ()) -> Array:
    """Random values of an argument of a call: unit quaternions, numbers about 1."""
    if argument.shape == ("nq",):
        return sd.random_configuration(model, rng, batch)
    known = {"nq": model.nq, "nv": model.nv, "njoints": model.njoints}
    return rng.normal(size=(*batch, *(known[s] if isinstance(s, str) else s for s in argument.shape)))


def sorted_inputs(spec: Spec) -> list[Argument]:
    """What a call takes sample by sample, in the order of its public signature: optional inputs last."""
    return sorted((x for x in spec.present if not x.static), key=lambda x: x.optional)


def random_inputs(model: sd.Model, spec: Spec, seed: int = 0, batch: tuple[int, ...] = ()) -> list[Array]:
    """Random values of ``sorted_inputs``."""
    rng = np.random.default_rng(seed)
    return [random_input(model, x, rng, batch) for x in sorted_inputs(spec)]


def options(model: sd.Model, spec: Spec) -> dict[str, Any]:
    """What a call takes besides: a frame in the middle of the tree, a reference."""
    static = {x.name for x in spec.present if x.static}
    frame = {"frame": model.frames[2 * len(model.frames) // 3]} if "row" in static else {}
    return frame | {word: value for word, value in WORDS.items() if word in static}


def public(model: sd.Model, spec: Spec, values: list[Any], **more: Any) -> Any:
    """The public call of a spec; values as of ``random_inputs``."""
    names = [x.name for x in sorted_inputs(spec)]
    return getattr(sd, spec.name)(model, **dict(zip(names, values, strict=True)), **options(model, spec), **more)


def kernel_inputs(model: sd.Model, spec: Spec, values: list[Array]) -> list[Any]:
    """What a recursion or kernel takes, in the order of the spec's inputs."""
    by_name: dict[str, Any] = {x.name: v for x, v in zip(sorted_inputs(spec), values, strict=True)}
    given = options(model, spec)
    if given.get("frame"):
        by_name |= {"row": model.joints[given["frame"].joint].row, "placement": given["frame"].placement}
    by_name |= {"reference": 1, "classical": 1}
    return [by_name[x.name] for x in spec.present]


def empty_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """No program and no machine code in memory, until the end of the test."""
    for held in ("_programs", "_codes"):
        monkeypatch.setattr(batch_kernels, held, OrderedDict())


def no_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the calls of a new model run without programs, as those of robots too large for one."""
    monkeypatch.setattr(run, "program", lambda *given: None)
    monkeypatch.setattr(dynamics, "plan_of", dynamics.plan_of.__wrapped__)  # a plan without memory


def no_programs_of_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take all models as too large for a program, until the end of the test: no later test finds a plan without one."""
    monkeypatch.setattr(recording, "most_rows", lambda spec: 1)
    monkeypatch.setattr(run, "program", run._program.__wrapped__)
    monkeypatch.setattr(dynamics, "plan_of", dynamics.plan_of.__wrapped__)


def run_python(code: str, *arguments: str, package: Path = PACKAGE, **environment: str) -> str:
    """What a fresh Python prints, with the package of a given folder; warnings are errors there."""
    found = os.environ | {"PYTHONPATH": str(package.parent)} | environment
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, *arguments],
        capture_output=True, text=True, env=found, cwd=package.parent, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout
