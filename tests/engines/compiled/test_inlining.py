"""``inline`` functions: they compute what Python does, leave no machine code of their own, and may raise."""

from __future__ import annotations

import json
import math
import os
import pickle
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from llvmlite import binding
from numba import njit
from numba.core import compiler

import spatialdyn as sd
from spatialdyn.algebra.scalars import inline, inline_unoptimized, no_inline, sin
from spatialdyn.engines.compiled import disk_cache, inlining, numba_kernels
from spatialdyn.engines.compiled.jit import hand_over

COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="about compiled code")


@no_inline
def apart(x: float) -> float:
    """A ``no_inline`` function."""
    made: float = sin(x) + 1.0
    return made


@inline
def inside(x: Any, k: int) -> float:
    """An ``inline`` function, as recursions are."""
    return apart(x[k]) * 2.0


@inline_unoptimized
def between(x: Any) -> float:
    """An ``inline_unoptimized`` function, which calls kernels."""
    total = 0.0
    for k in range(len(x)):
        total += inside(x, k)
        if total > 100.0:
            raise ValueError("too much")
    return total


def outermost(x: Any) -> float:
    """The caller, compiled by itself."""
    return between(x)


@pytest.fixture(autouse=True)
def registered() -> None:
    """Numba has the functions of this file."""
    hand_over()


def test_inlined_functions_compute_what_python_does() -> None:
    x = np.array([0.3, -1.2, 2.0])
    expected = sum(2.0 * (math.sin(a) + 1.0) for a in x)
    assert outermost(x) == expected
    assert njit(outermost)(x) == pytest.approx(
        expected, rel=4e-16, abs=0.0
    )  # a sum of three, in another order of fusing


def test_what_an_inlined_function_raises_arrives() -> None:
    with pytest.raises(ValueError, match="too much"):
        njit(outermost)(np.zeros(60))


@COMPILED
def test_inlined_functions_have_no_machine_code() -> None:
    kernel: Any = njit(outermost)
    kernel(np.ones(2))
    (made,) = kernel.overloads.values()
    defined = {name for name in made.library.codegen._engine._defined_symbols if "NumbaEnv" not in name}
    assert any("outermost" in name for name in defined)
    assert any("apart" in name and __name__ in name for name in defined)
    assert not any(word in name and __name__ in name for name in defined for word in ("6inside", "7between"))


class Store:
    """Keeps functions of this file by name."""

    def __init__(self) -> None:
        self.there: dict[str, bytes] = {}
        self.found: list[str] = []

    def digest(self, function: Any, state: Any) -> str:
        """The name of a function and its types, if it is of this file."""
        return f"{function.__name__} {state.args}" if function.__module__ == __name__ else ""

    def read(self, digest: str) -> Any:
        """What is there."""
        if digest in self.there:
            self.found.append(digest.split()[0])
            return pickle.loads(self.there[digest])
        return None

    def write(self, digest: str, content: Any) -> None:
        """Keep it."""
        self.there[digest] = pickle.dumps(content)


@COMPILED
def test_what_is_kept_is_not_compiled_again_and_computes_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store()
    monkeypatch.setattr(inlining.Inlining, "cache", store)

    def answer() -> tuple[bytes, list[str]]:
        scope: dict[str, Any] = {"sin": sin, "inline": inline}
        exec(  # functions that Numba does not know yet
            "def part(x):\n    return sin(x) * 1.1 + x\n\n"
            "def whole(x):\n    return part(x[0]) * part(x[1]) + part(x[2])\n",
            scope | {"__name__": __name__}, scope,
        )  # fmt: skip
        for name in ("part", "whole"):
            scope[name].__globals__.update(scope)
            inline(scope[name])
        hand_over()
        whole = scope["whole"]
        store.found.clear()
        y = njit(lambda x: whole(x))(np.array([0.3, -1.2, 2.0]))
        return np.float64(y).tobytes(), sorted(store.found)

    first, found = answer()
    assert not found
    assert {name.split()[0] for name in store.there} == {"part", "whole"}
    assert answer() == (first, ["whole"])  # which holds the other


@COMPILED
def test_code_with_other_functions_or_addresses_in_it_is_not_kept() -> None:
    """Names of functions may be those of others in the next process, of which the linker would take one."""

    def content(*names: str, addresses: bool = False) -> Any:
        code = "\n".join(f"define i64 @{name}() {{ ret i64 1 }}" for name in names)
        library = SimpleNamespace(
            _final_module=binding.parse_assembly(code + "\ndeclare i64 @far()"), has_dynamic_globals=addresses, name="x"
        )
        own = SimpleNamespace(llvm_func_name="own", typemap={}, calltypes={})
        return inlining._content(SimpleNamespace(library=library, fndesc=own, signature="s"))

    assert content("own")[1:3] == content("own", "NRT_incref")[1:3] == ("s", "x")
    assert content("own", "other") is None
    assert content("own", addresses=True) is None


@COMPILED
def test_a_kernel_in_a_new_process_is_made_of_kept_functions(tmp_path: Path) -> None:
    script = """
import json, sys, time
import numpy as np
import spatialdyn as sd
from numba.core import event
compiled = []
class Compiled(event.Listener):
    def on_start(self, started):
        name = started.data["name"]
        if name.startswith("native_lowering"):
            compiled.append(name.partition("[")[2][:-1])
    def on_end(self, ended):
        pass
event.register("numba:run_pass", Compiled())
model = sd.load_urdf("two_link")
out = np.empty(2)
sd.kernels.neutral(model.bodies, out)
print(json.dumps([out.tobytes().hex(), compiled]))
"""
    environment = {**os.environ, "SPATIALDYN_CACHE_DIR": str(tmp_path)}
    runs = []
    for _ in range(2):
        ran = subprocess.run(
            [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
        )
        runs.append(json.loads(ran.stdout))
        for kernel in tmp_path.glob("*" + disk_cache.KERNEL):
            kernel.unlink()
    (first, compiled), (second, again) = runs
    assert first == second
    assert compiled[-1] == again[-1] == "neutral_user"
    assert {"neutral", "all_finite"} <= set(compiled)
    assert not {"neutral", "all_finite"} & set(again)


def test_the_passes_left_out_are_numbas() -> None:
    """A pass of another name in another version of Numba would run again, and no test would fail."""
    state = compiler.StateDict()
    flags: Any = compiler.Flags
    state.flags, state.func_ir = flags(), None
    builder: Any = compiler.DefaultPassBuilder
    there = {found.__name__ for found, _ in builder.define_nopython_pipeline(state).passes}
    assert there >= inlining._WITHOUT


def run_without_passes(tmp_path: Path, lines: str) -> Any:
    """What a fresh Python prints as JSON where Numba has the parts that ``inlining`` is made of elsewhere."""
    script = f'import sys\nsys.modules["spatialdyn.engines.compiled.inlining"] = None\n{lines}'
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path)}
    ran = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    return json.loads(ran.stdout)


@COMPILED
def test_without_the_passes_inlined_functions_compile_as_numba_has_them(tmp_path: Path) -> None:
    lines = """
from numba import njit
from spatialdyn.algebra import scalars
from spatialdyn.algebra.euclidean import Vec, cross
from spatialdyn.algebra.scalars import inline_unoptimized
from spatialdyn.engines.compiled.jit import hand_over
try:
    from spatialdyn.engines.compiled import inlining
    raise SystemExit("inlining can be imported")
except ImportError:
    pass

@inline_unoptimized
def of_cross(x):
    a = cross(Vec(x, 2.0, 3.0), Vec(0.0, 1.0, scalars.sin(x)))
    return a.x, a.y, a.z

hand_over()
print(list(njit(lambda x: of_cross(x))(0.5)))
"""
    expected = np.cross([0.5, 2.0, 3.0], [0.0, 1.0, math.sin(0.5)])
    np.testing.assert_allclose(run_without_passes(tmp_path, lines), expected, rtol=1e-15)


@COMPILED
@pytest.mark.slow(quick="test_without_the_passes_inlined_functions_compile_as_numba_has_them")
def test_without_the_passes_recursions_compile_as_numba_has_them(tmp_path: Path) -> None:
    lines = """
import spatialdyn as sd
print(sd.rnea(sd.load_urdf("two_link"), [0.3, 0.4], [1.0, 2.0], [0.0, 1.0]).tolist())
"""
    expected = sd.rnea(sd.load_urdf("two_link"), [0.3, 0.4], [1.0, 2.0], [0.0, 1.0])
    np.testing.assert_allclose(run_without_passes(tmp_path, lines), expected, rtol=1e-14)
