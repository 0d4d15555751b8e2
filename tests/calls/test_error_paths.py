"""What a call cannot answer by its program it answers, or refuses, without compiling: in cold processes too."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inputs import options, random_inputs
from plain import by_table
from trees import random_tree

import spatialdyn as sd
from spatialdyn.calls.dynamics import calls
from spatialdyn.engines import by_table_kernel, run
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.failed import ALL_OK
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import Spec

COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing compiles")
MOST_SECONDS = 1.0  # of CPU for a call
INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
LINK = f'<link name="{{0}}"><inertial><mass value="1"/>{INERTIA}</inertial></link>'
WEAK = f"""<robot name="weak">{LINK.format("base")}{LINK.format("upper")}<link name="tip"/>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="wrist" type="continuous"><parent link="upper"/><child link="tip"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
</joint></robot>"""

SCRIPT = f"""
import sys, time
import numpy as np
import spatialdyn as sd
from spatialdyn.recursions.spec import Spec
from inputs import options, random_inputs
from spatialdyn.calls.dynamics import calls
from spatialdyn.engines.compiled.numba_kernels import variant
from spatialdyn.recursions import SPECS

case = sys.argv[1]
model = sd.load_urdf({WEAK!r} if case == "singular" else "two_link")

def spoil(x):
    if case == "refused":
        return np.append(x, x[..., :1], -1)
    if case != "singular":
        x = x.copy()
        x.reshape(-1)[0] = np.nan if case == "nan" else 1e9
    return x

for name, spec in SPECS.items():
    for batch in ((), (3,)):
        given = random_inputs(model, variant(spec, ()), batch=batch)
        at = next((k for k, x in enumerate(given) if x.size and x.ndim > len(batch)), None)
        if at is None:
            continue
        given[at] = spoil(given[at])
        began, said = time.process_time(), ""
        try:
            calls[name](model, *given, **options(model, spec))
        except sd.SpatialDynError as error:
            said = type(error).__name__
        print(name, len(batch), time.process_time() - began, said)
        if case == "singular" and spec.pivots:
            assert said == "InertiaError", (name, said)
        if case == "refused":
            assert said == "ShapeError", (name, said)
"""

OTHERS = """
import sys, time
import numpy as np
import spatialdyn as sd

model, zero, nan, far = sd.load_urdf("two_link"), np.zeros(2), np.array([np.nan, 0.2]), np.array([1e9, 0.2])
held = np.zeros((2, 10, 2))
cases = {
    "specialize": lambda: [sd.specialize(model, sd.aba)(x, zero, zero) for x in (nan, far, np.array([far, zero]))],
    "float32": lambda: sd.specialize(model, sd.aba, dtype=np.float32)(far, zero, zero),
    "payload": lambda: sd.specialize(model, sd.rnea, inputs="payload")(far, zero, zero, np.zeros(10)),
    "bounded": lambda: sd.bounded(model, sd.rnea)(far, zero, zero),
    "derivative": lambda: sd.specialize(model, sd.aba, derivative="jvp")(far, *[zero] * 5),
    "forward_dynamics": lambda: [
        sd.forward_dynamics(model, nan, zero, zero, method=x)
        for x in ("aba", "crba", "refined", "square_root", "extended")
    ],
    "step": lambda: [sd.step(model, x, zero, zero, dt=0.01) for x in (nan, far)],
    "rollout": lambda: [sd.rollout(model, np.array([x, zero]), np.zeros((2, 2)), held, dt=0.01) for x in (far, nan)],
    "simulate": lambda: sd.simulate(model, far, zero, 0.01, dt=0.001),
    "diverges": lambda: sd.simulate(model, [1.0, 2.0], [1e3, -1e5], 2.0, dt=0.1),
}
for name, case in cases.items():
    began, said = time.process_time(), ""
    try:
        case()
    except sd.SpatialDynError as error:
        said = type(error).__name__
    print(name, time.process_time() - began, said)
assert "numba" not in sys.modules
"""


def cold(code: str, folder: Path, *words: str) -> str:
    """What a process with an empty cache prints."""
    tests = Path(__file__).parents[1]
    path = os.pathsep.join([str(tests), str(tests.parent), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "SPATIALDYN_CACHE_DIR": str(folder), "PYTHONPATH": path}
    done = subprocess.run(
        [sys.executable, "-c", code, *words], env=environment, capture_output=True, text=True, check=False
    )
    assert not done.returncode, done.stderr
    return done.stdout


def bare(name: str) -> Spec:
    """A call without its optional inputs."""
    return numba_kernels.variant(SPECS[name], ())


@COMPILED
@pytest.mark.parametrize("case", ["nan", "big", "singular", "refused"])
def test_no_call_compiles_for_long_to_refuse_or_to_answer_nan(case: str, tmp_path: Path) -> None:
    said = cold(SCRIPT, tmp_path, case)
    spent = {tuple(line.split()[:2]): float(line.split()[2]) for line in said.splitlines()}
    assert len(spent) > 100
    assert max(spent.values()) <= MOST_SECONDS, {call: x for call, x in spent.items() if x > MOST_SECONDS}


@COMPILED
def test_neither_do_programs_and_motions(tmp_path: Path) -> None:
    lines = [line.split() for line in cold(OTHERS, tmp_path).splitlines()]
    assert {words[0]: words[2] for words in lines if words[2:]} == {
        "derivative": "SpatialDynError", "rollout": "SimulationError", "diverges": "SimulationError",
    }  # fmt: skip
    spent = {words[0]: float(words[1]) for words in lines}
    assert max(spent.values()) <= 3 * MOST_SECONDS, spent  # several calls each, which compile their own programs


@COMPILED
@pytest.mark.parametrize(
    "name", ["rnea", "aba", "crba", "integrate", "frame_velocity", "kinetic_energy", "christoffel_symbols"]
)
def test_a_sample_beyond_the_program_has_the_table_kernels_meaning(name: str) -> None:
    """NaN where the recursion meets it, angles of 1e9 to rounding, no other sample touched."""
    model = sd.load_urdf("panda")
    given = random_inputs(model, bare(name), batch=(6,))
    plain = calls[name](model, *given, **options(model, SPECS[name]))
    given[0][1, 0], given[0][3, 2], given[-1][4, ..., -1] = np.nan, 1e9, np.inf
    found = calls[name](model, *given, **options(model, SPECS[name]))
    np.testing.assert_array_equal(found[[0, 2, 5]], plain[[0, 2, 5]])
    if "row" in {x.name for x in SPECS[name].present}:
        return
    table = np.stack([by_table(model, name, [x[k] for x in given], found[k].shape) for k in (1, 3, 4)])
    shown, sound = found[[1, 3, 4]], np.isfinite(table)
    np.testing.assert_array_equal(np.isfinite(shown), sound)
    for x, y, of in zip(shown, table, sound, strict=True):
        np.testing.assert_allclose(x[of], y[of], rtol=0.0, atol=1e-12 * abs(y[of]).max(initial=0.0))


@COMPILED
@pytest.mark.parametrize("name", ["rnea", "aba", "forward_kinematics"])
def test_its_bits_depend_on_that_sample_alone(name: str) -> None:
    model = sd.load_urdf("panda", root="floating")
    given = random_inputs(model, bare(name), batch=(3000,))
    given[0][::2, 9] += 1e9
    whole = calls[name](model, *given)
    for k in (0, 1022, 1024, 2998):
        np.testing.assert_array_equal(calls[name](model, *(x[k] for x in given)), whole[k])
    np.testing.assert_array_equal(calls[name](model, *(x[7:2000] for x in given)), whole[7:2000])


@COMPILED
def test_errors_name_the_first_sample_and_how_many() -> None:
    model = sd.load_urdf("two_link", root="floating")
    q, v, tau = (np.zeros((5, n)) for n in (model.nq, model.nv, model.nv))
    q[:, 6] = 1.0
    q[1, 7] = np.nan
    q[3:, 3] = 0.5
    with pytest.raises(sd.ConfigurationError, match="in sample 3, the first of 2"):
        sd.aba(model, q, v, tau)
    weak = sd.load_urdf(WEAK)
    state = np.zeros((5, 2))
    state[0, 0] = np.nan
    for call in (sd.aba, sd.aba_square_root):
        with pytest.raises(
            sd.InertiaError, match='joint "wrist" has zero articulated inertia in sample 1, the first of 4'
        ):
            call(weak, state, np.zeros((5, 2)), np.zeros((5, 2)))
    fast = np.full((4, model.nv), 1e200)
    fast[0] = 0.0
    with pytest.raises(sd.NonFiniteError, match="in sample 1, the first of 3"):
        sd.rnea(model, np.broadcast_to(q[0], (4, model.nq)), fast, fast)


@COMPILED
def test_a_call_without_a_program_answers_nan_in_numpy_whatever_came_before(monkeypatch: pytest.MonkeyPatch) -> None:
    model = sd.load_urdf("two_link")
    given = random_inputs(model, bare("aba_square_root"), batch=(4,))
    given[1][2, 0] = np.nan
    compiled = sd.aba_square_root(model, *given)
    assert np.isnan(compiled[2]).all()
    assert np.isfinite(compiled[[0, 1, 3]]).all()
    monkeypatch.setattr(numba_kernels, "batch_kernel", None)  # not callable
    alone = by_table_kernel.run_table_kernel(
        bare("aba_square_root"), model, [x[2:3] for x in given], (), np.empty((1, 2))
    )
    assert list(alone.samples) == [0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again: Any = sd.aba_square_root(model, *(x[2] for x in given))
    np.testing.assert_array_equal(again, compiled[2])


@COMPILED
def test_what_numpy_would_take_long_for_is_not_tried_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """n^3 operations on the derivatives of a long chain: its kernel is compiled, or read from the cache, at once."""
    model = random_tree(1, 150, ["revolute"]).model
    asked: list[str] = []
    monkeypatch.setattr(by_table_kernel, "run_in_numpy", lambda spec, *others: asked.append(spec.name) or ALL_OK)
    for name in ("crba_solve", "aba_derivatives"):
        spec = bare(name)
        monkeypatch.setattr(numba_kernels, "is_made", lambda spec: False)
        given = [x.reshape((1, -1)) for x in random_inputs(model, spec)]
        assert run.preview(spec, model, given, (), 1) is ALL_OK
    assert asked == ["crba_solve"]
    many = [np.repeat(x.reshape((1, -1)), 64, axis=0) for x in random_inputs(model, bare("crba_solve"))]
    assert run.preview(bare("crba_solve"), model, many, (), 64) is ALL_OK
    assert asked == ["crba_solve"]
