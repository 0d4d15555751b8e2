"""The compiled engine: one result for any caller, number of calls and batch, and never a stale one."""

from __future__ import annotations

import copy
import doctest
import json
import pickle
import shutil
import sys
import threading
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from inputs import EPS, MAIN_CALLS, PACKAGE, kernel_inputs, options, public, random_inputs, run_python, sorted_inputs
from numpy.typing import NDArray
from slow import slow_but, thinned
from trees import random_tree

import spatialdyn as sd
from spatialdyn.algebra.records import object_twin
from spatialdyn.bodies.table import BODIES
from spatialdyn.engines.compiled import disk_cache, numba_kernels
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import Spec

Array = NDArray[np.float64]
ROUNDING = 1e-12  # of the largest entry: what fused products change in sums over ten bodies
CONDITIONED = 1e-9  # the same after solving for the accelerations of a random tree
COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")


def tolerance(name: str) -> float:
    """How far plain Python and compiled code may be apart."""
    return CONDITIONED if SPECS[name].pivots else ROUNDING


@pytest.fixture(scope="module")
def model() -> sd.Model:
    """A floating tree with every kind of joint, in the layout with the most coordinates."""
    made = random_tree(5, 12, floating=True, continuous="cos_sin").model
    assert {j.kind for j in made.joints[1:]} == set(random_kinds())
    return made


def random_kinds() -> tuple[str, ...]:
    """The kinds of joint that move."""
    return ("revolute", "continuous", "prismatic", "spherical", "floating", "planar")


def output(model: sd.Model, spec: Spec) -> Array:
    """An array for the output of one sample, NaN."""
    known = {"nq": model.nq, "nv": model.nv, "njoints": model.njoints}
    return np.full([known[s] if isinstance(s, str) else s for s in spec.output.shape or (1,)], np.nan)


def near(x: Any, y: Any, bound: float) -> None:
    """Equal within a bound relative to the largest entry."""
    x, y = np.asarray(x), np.asarray(y)
    assert x.shape == y.shape
    assert abs(x - y).max(initial=0.0) <= bound * max(1.0, abs(y).max(initial=0.0))


# --- one source -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", slow_but(MAIN_CALLS, SPECS))
def test_plain_python_equals_compiled_code(model: sd.Model, name: str) -> None:
    """On scratch and outputs full of NaN: a recursion reads only entries that it has written."""
    spec = SPECS[name]
    values = random_inputs(model, spec)
    given = dict(zip((x.name for x in spec.present), kernel_inputs(model, spec, values), strict=True))
    out = output(model, spec)
    work = None
    if spec.work is not None:
        work = np.frombuffer(b"\xff" * (len(model.bodies) * spec.work.itemsize), spec.work).copy()
    spec.run(model.bodies, work, given, out, lambda size: np.full(size, np.nan))
    near(np.squeeze(out) if not spec.output.shape else out, public(model, spec, values), tolerance(name))


class Exact:
    """An exact number: a fraction that takes floats at their exact binary value, as an engine for reference values."""

    def __init__(self, value: Any) -> None:
        self.value = Fraction(value)

    def __add__(self, other: Any) -> Exact:
        return Exact(self.value + exact(other))

    def __sub__(self, other: Any) -> Exact:
        return Exact(self.value - exact(other))

    def __rsub__(self, other: Any) -> Exact:
        return Exact(exact(other) - self.value)

    def __mul__(self, other: Any) -> Exact:
        return Exact(self.value * exact(other))

    def __neg__(self) -> Exact:
        return Exact(-self.value)

    __radd__, __rmul__ = __add__, __mul__


def exact(x: Any) -> Fraction:
    """The value of a number."""
    return x.value if isinstance(x, Exact) else Fraction(x)


def exact_table(table: Any, dtype: np.dtype[Any]) -> Any:
    """A table as rows whose floats are Exact; zeros without a table."""
    twin = np.zeros(len(table), object_twin(dtype)).view(np.recarray)

    def fill(to: Any, of: Any) -> None:
        for name in to.dtype.names:
            if to[name].dtype.names:
                fill(to[name], of[name])
            elif to[name].dtype == object:
                to[name] = [Exact(x) for x in of[name]]
            else:
                to[name] = of[name]

    fill(twin, table)
    return twin


def exactly(spec: Spec, model: sd.Model, *inputs: Any) -> list[Fraction]:
    """A recursion on exact numbers: a vector of nv."""
    work = exact_table(np.zeros(len(model.bodies), spec.work), spec.work)
    out = np.full(model.nv, None, object)
    given = [None if x is None else [Exact(entry) for entry in x] for x in inputs]
    spec.recursion(exact_table(model.bodies, BODIES), work, *given, out)
    return [entry.value for entry in out]


def test_rnea_of_sliders_is_exact_on_exact_numbers() -> None:
    """τ_i = Σ_{j >= i} m_j S_i·(Σ_{k <= j} S_k a_k - g): each slider carries its subtree."""
    builder = sd.ModelBuilder("gantry")
    axes = [(1.0, 0.0, 0.0), (0.6, 0.0, 0.8), (1.0, 2.0, 2.0), (0.0, 0.0, -1.0)]
    masses = [5.3, 0.7, 2.1, 1e-3]
    for k, (axis, mass) in enumerate(zip(axes, masses, strict=True)):
        parent = f"b{k - 1}" if k else None
        com = (0.1 * k, -0.2, 0.3)
        builder.add_body(f"b{k}", parent, "prismatic", axis, (0.3, 0.1 * k, -0.7), (mass, com, 0.1 * np.eye(3)))
    model = builder.build(gravity=(0.3, -0.1, -9.81))
    q, v, a = [0.1, 0.2, -0.3, 1e6], [1e-9, 3.0, 0.7, -2.0], [0.5, 1e3, -0.25, 1e-3]

    S = [[Fraction(x) for x in row["S"]["v"].tolist()] for row in model.bodies[1:]]
    m = [Fraction(x) for x in model.bodies["inertia"]["m"][1:].tolist()]
    g = [Fraction(x) for x in model.gravity.tolist()]
    seen = [[sum(S[k][x] * Fraction(a[k]) for k in range(j + 1)) - g[x] for x in range(3)] for j in range(4)]
    tau = [sum(m[j] * sum(S[i][x] * seen[j][x] for x in range(3)) for j in range(i, 4)) for i in range(4)]

    assert exactly(SPECS["rnea"], model, q, v, a, None) == tau
    assert exactly(SPECS["generalized_gravity"], model, q, None, None, None) == [
        sum(m[j] * sum(-S[i][x] * g[x] for x in range(3)) for j in range(i, 4)) for i in range(4)
    ]
    compiled = sd.rnea(model, q, v, a)
    scale = max(map(float, tau))
    assert all(abs(float(Fraction(x) - t)) <= 16 * EPS * scale for x, t in zip(compiled.tolist(), tau, strict=True))


SCRIPT_CALLS = """
import pickle, sys
from pathlib import Path
import numpy as np
import spatialdyn as sd
out = []
for model, name, arguments, options in pickle.loads(Path(sys.argv[1]).read_bytes()):
    try:
        out.append(getattr(sd, name)(model, *arguments, **options))
    except sd.SpatialDynError as error:
        out.append((type(error).__name__, str(error)))
Path(sys.argv[2]).write_bytes(pickle.dumps(out))
"""


@pytest.mark.slow(quick="test_plain_python_equals_compiled_code")
def test_without_numba_every_call_and_every_error_is_the_same(model: sd.Model, tmp_path: Path) -> None:
    """NUMBA_DISABLE_JIT=1 is how one debugs: a breakpoint in a recursion is reached."""
    arm = sd.ModelBuilder("arm").add_body("b", axis=(0, 1, 0), inertia=(2.0, (0, 0, -1), np.zeros((3, 3)))).build()
    empty = sd.ModelBuilder("empty").add_body("b", axis=(0, 1, 0)).build()
    tasks: list[tuple[sd.Model, str, list[Any], dict[str, Any]]] = []
    for batch in ((), (2, 1)):
        for name, spec in SPECS.items():
            required = random_inputs(model, numba_kernels.variant(spec, frozenset()), batch=batch)
            tasks.append((model, name, required, options(model, spec)))
    rng = np.random.default_rng(0)
    q, v = sd.random_configuration(model, rng), rng.normal(size=model.nv)
    tasks += [
        (model, "rnea", [q, v, v], {"fext": rng.normal(size=(model.njoints, 6))}),
        (arm, "aba", [[0.1], [1], [2]], {}),
    ]
    held = np.isclose(sd.normalize(model, 2 * q), q)  # by a unit norm, which float32 would round
    short = np.where(held, sd.neutral(model), q).astype(np.float32)
    forms = [np.stack([q] * model.nq), q.tolist(), short, np.asfortranarray(np.stack([q] * 3))]
    tasks += [(model, name, [form], {}) for form in forms for name in ("crba", "generalized_gravity", "normalize")]
    tasks += [
        (arm, "crba", [form], {}) for form in ([1], np.array([1]), np.ones((1, 1)), np.ones((1, 1, 1)), np.ones((0, 1)))
    ]
    sound = len(tasks)
    tasks += [
        (model, "rnea", [1.1 * q, v, v], {}),
        (model, "crba", [q[:-1]], {}),
        (model, "crba", [q + 1j], {}),
        (empty, "aba", [[0.0], [0.0], [1.0]], {}),
        (empty, "minverse", [[[0.0], [0.5]]], {}),
        (arm, "rnea", [[0.1], [1.0], [1e308]], {}),
    ]
    tasks += [
        (arm, "rnea", [[0.1], [np.nan], [0.0]], {}),
        (arm, "crba", [[np.inf]], {}),
        (arm, "integrate", [[1.0], [np.inf]], {}),
    ]
    (tmp_path / "tasks").write_bytes(pickle.dumps(tasks))
    run_python(SCRIPT_CALLS, str(tmp_path / "tasks"), str(tmp_path / "plain"), NUMBA_DISABLE_JIT="1")
    plain = pickle.loads((tmp_path / "plain").read_bytes())
    for k, ((which, name, arguments, more), there) in enumerate(zip(tasks, plain, strict=True)):
        try:
            here = getattr(sd, name)(which, *arguments, **more)
        except sd.SpatialDynError as error:
            here = (type(error).__name__, str(error))
        assert type(here) is type(there), (k, name)
        if isinstance(here, tuple):
            assert here == there
            assert k >= sound
        else:
            np.testing.assert_array_equal(np.isfinite(here), np.isfinite(there))
            near(np.nan_to_num(there), np.nan_to_num(here), tolerance(name))


# --- one result -----------------------------------------------------------------------------------------


@pytest.mark.skipif(
    numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: minutes of plain Python, where a batch is a loop of samples"
)
@pytest.mark.parametrize("name", slow_but(MAIN_CALLS, SPECS))
def test_results_are_the_same_to_the_bit_in_every_batch(model: sd.Model, name: str) -> None:
    """Single, batch of one, any place in any batch, inputs repeated or broadcast."""
    spec = SPECS[name]
    values = random_inputs(model, spec, batch=(11,))
    alone = np.array([public(model, spec, [x[k] for x in values]) for k in range(11)])
    if not values:
        return
    np.testing.assert_array_equal(public(model, spec, values), alone)
    np.testing.assert_array_equal(public(model, spec, [x[3:4] for x in values]), alone[3:4])
    np.testing.assert_array_equal(public(model, spec, [x[4::-2] for x in values]), alone[4::-2])
    np.testing.assert_array_equal(
        public(model, spec, [x[:6].reshape(3, 2, *x.shape[1:]) for x in values]).reshape(alone[:6].shape), alone[:6]
    )
    if len(values) > 1:
        held = [values[0], *(x[5] for x in values[1:])]
        repeated = [values[0], *(np.repeat(x[5:6], 11, axis=0) for x in values[1:])]
        np.testing.assert_array_equal(public(model, spec, held), public(model, spec, repeated))
        np.testing.assert_array_equal(public(model, spec, held)[5], alone[5])


def test_equal_models_give_equal_bits(model: sd.Model) -> None:
    twin = copy.deepcopy(model)
    assert twin.address != model.address
    for name in ("rnea", "crba", "aba", "integrate", "frame_jacobian"):
        spec = SPECS[name]
        values = random_inputs(model, spec)
        np.testing.assert_array_equal(public(twin, spec, values), public(model, spec, values))


@pytest.mark.parametrize("name", slow_but(MAIN_CALLS, SPECS))
def test_inputs_are_left_as_they_were_and_may_be_read_only(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    for batch in ((), (3,)):
        values = random_inputs(model, spec, batch=batch)
        kept = [x.copy() if batch or x.shape else x for x in values]
        expected = public(model, spec, values)
        for x, y in zip(values, kept, strict=True):
            np.testing.assert_array_equal(x, y)
            np.asarray(x).flags.writeable = False
        np.testing.assert_array_equal(public(model, spec, values), expected)


# --- threads --------------------------------------------------------------------------------------------


def test_eight_threads_get_the_answers_of_one(model: sd.Model) -> None:
    n, rounds = (2, 1) if numba_kernels.PLAIN else (32, 30)
    inputs = {name: random_inputs(model, SPECS[name], batch=(n,)) for name in ("rnea", "crba", "aba")}
    alone = {name: public(model, SPECS[name], values) for name, values in inputs.items()}
    start, wrong = threading.Barrier(8), []

    def work(seed: int) -> None:
        try:
            rng = np.random.default_rng(seed)
            start.wait()
            for _ in range(rounds):
                for name, values in inputs.items():
                    k = rng.permutation(n)
                    if not np.array_equal(public(model, SPECS[name], [x[k] for x in values]), alone[name][k]):
                        wrong.append(f"{name} of a batch")
                    if not np.array_equal(public(model, SPECS[name], [x[k[0]] for x in values]), alone[name][k[0]]):
                        wrong.append(f"{name} of a sample")
        except BaseException as error:
            wrong.append(repr(error))

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


SCRIPT_FIRST_CALLS = """
import pickle, sys, threading
from pathlib import Path
import numpy as np
import spatialdyn as sd
model, q, v = pickle.loads(Path(sys.argv[1]).read_bytes())
start, found = threading.Barrier(8), [None] * 8
def work(k):
    start.wait()
    found[k] = [sd.rnea(model, q, v, v), sd.rnea(model, q[None], v, v)[0], sd.crba(model, q), sd.aba(model, q, v, v)]
threads = [threading.Thread(target=work, args=(k,)) for k in range(8)]
for t in threads: t.start()
for t in threads: t.join()
Path(sys.argv[2]).write_bytes(pickle.dumps(found))
"""


def test_eight_threads_may_make_the_first_call(model: sd.Model, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    q, v = sd.random_configuration(model, rng), rng.normal(size=model.nv)
    expected = [sd.rnea(model, q, v, v), sd.rnea(model, q[None], v, v)[0], sd.crba(model, q), sd.aba(model, q, v, v)]
    (tmp_path / "task").write_bytes(pickle.dumps((model, q, v)))
    run_python(SCRIPT_FIRST_CALLS, str(tmp_path / "task"), str(tmp_path / "found"))
    found = pickle.loads((tmp_path / "found").read_bytes())
    for results in found:
        for x, y in zip(results, expected, strict=True):
            np.testing.assert_array_equal(x, y)


@COMPILED
@pytest.mark.parametrize("name", ["rnea", "crba", "aba"])
def test_kernels_release_the_gil(model: sd.Model, name: str) -> None:
    """Another thread counts while one kernel runs.

    With a switch interval of a minute a thread runs only if the other gives way of its own: the counter does so at
    each step, the kernel only by releasing the lock.
    """
    n = 2000
    spec = numba_kernels.variant(SPECS[name], frozenset())
    values = random_inputs(model, spec, batch=(n,))
    out = np.empty((n, *output(model, spec).shape))
    arguments = [part for x in values for part in (x, 1)]
    kernel = numba_kernels.batch_kernel(spec)
    count, stop, started = [0], threading.Event(), threading.Event()

    def counter() -> None:
        while not stop.is_set():
            count[0] += 1
            started.set()
            time.sleep(0)

    interval = sys.getswitchinterval()
    thread = threading.Thread(target=counter)
    try:
        sys.setswitchinterval(60.0)
        thread.start()
        started.wait()
        grown = False
        for _ in range(1000):
            before = count[0]
            kernel(getattr(model, numba_kernels.TABLE), n, *arguments, out, status := np.empty(n, np.int8))
            grown = count[0] > before
            if grown:
                break
        assert not status.any()
    finally:
        stop.set()
        sys.setswitchinterval(interval)
        thread.join()
    assert grown


# --- compiled once, and anew ----------------------------------------------------------------------------


@COMPILED
@pytest.mark.parametrize("name", ["rnea", "crba", "aba", "frame_jacobian", "kinetic_energy", "interpolate"])
def test_no_input_compiles_a_second_kernel(model: sd.Model, name: str) -> None:
    spec = numba_kernels.variant(SPECS[name], frozenset())
    values = random_inputs(model, spec)
    public(model, spec, values)
    public(model, spec, [np.asarray(x)[None] for x in values])
    bare = [numba_kernels.sample_kernel(spec), numba_kernels.batch_kernel(spec)]
    before = [list(kernel.signatures) for kernel in bare]
    forms: list[Callable[[Array], Any]] = [
        lambda x: x.tolist(),
        lambda x: np.repeat(x, 2, axis=-1)[..., ::2] if x.ndim else x,
        lambda x: x[..., ::-1].copy()[..., ::-1] if x.ndim else x,
        lambda x: np.asfortranarray(np.stack([x, x])),
        lambda x: np.stack([x] * 6).reshape(2, 3, *x.shape),
        lambda x: np.broadcast_to(x, (4, *x.shape)),
        lambda x: x.astype(x.dtype.newbyteorder()),
        lambda x: memoryview(x.copy()) if x.ndim else float(x),
        lambda x: np.frombuffer(b"?" + x.tobytes(), np.uint8)[1:].view(float).reshape(x.shape),
    ]
    expected = public(model, spec, values)
    for form in forms:
        found = np.asarray(public(model, spec, [form(np.asarray(x)) for x in values]))
        np.testing.assert_array_equal(found, np.broadcast_to(expected, found.shape))
    single = [np.asarray(x, np.float32) for x in values]
    near(public(model, spec, single), expected, 1e-4)
    public(
        model,
        spec,
        [v if x.unit_norm else np.asarray(v, int) for x, v in zip(sorted_inputs(spec), values, strict=True)],
    )
    assert [list(kernel.signatures) for kernel in bare] == before
    assert [len(signatures) for signatures in before] == [1, 1]


COPY = """
import json
import numpy as np
import spatialdyn as sd
from spatialdyn.calls.dynamics import table_call
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.recursions import SPECS
builder = sd.ModelBuilder("arm")
body = (1.0, (0.1, 0, 0.5), np.eye(3))
for k in range(3):
    builder.add_body(f"b{k}", f"b{k - 1}" if k else None, axis=(0, 1, k), placement=(0, 0, 1), inertia=body)
model = builder.build()
q, v, tau = np.array([0.1, 0.2, 0.3]), np.array([1.0, -2.0, 0.5]), np.empty(3)
own = sd.kernels.generalized_gravity
own(model.bodies, q, tau)
np.testing.assert_allclose(table_call("generalized_gravity", model, q), tau, rtol=1e-14)  # on lanes
np.testing.assert_allclose(sd.generalized_gravity(model, q), tau, rtol=1e-14)
table_call("momentum", model, q, v)
kernels = [numba_kernels.sample_kernel(numba_kernels.variant(SPECS["momentum"], frozenset())), own]
hits = [sum(kernel.stats.cache_hits.values()) for kernel in kernels]
print(json.dumps({"tau": tau.tolist(), "hits": hits, "stamp": numba_kernels.STAMP, "of": sd.__file__}))
"""


@COMPILED
@pytest.mark.slow(quick="engines/programs/test_digests.py::test_every_kernel_captures_the_stamp")
def test_a_stale_cache_is_impossible(tmp_path: Path) -> None:
    """A helper edited in a copy of the package gives its new answer; unedited code comes out of the cache."""
    package, cache = tmp_path / "spatialdyn", tmp_path / "cache"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))

    def answer() -> dict[str, Any]:
        text = run_python(COPY, package=package, NUMBA_CACHE_DIR=str(cache), PYTHONDONTWRITEBYTECODE="1")
        found: dict[str, Any] = json.loads(text)
        assert Path(found["of"]).parent == package
        return found

    def compiled() -> list[Path]:
        return sorted(cache.rglob("*" + disk_cache.KERNEL))

    first = answer()
    made = compiled()
    assert first["hits"] == [0, 0]
    assert made

    again = answer()
    assert again == first | {"hits": [1, 1]}
    assert compiled() == made

    source = package / "algebra" / "spatial.py"
    text = source.read_text(encoding="utf-8")
    line = "    return dot(S.w, f.n) + dot(S.v, f.f)\n"
    assert text.count(line) == 1
    source.write_text(text.replace(line, "    return 2.0 * (dot(S.w, f.n) + dot(S.v, f.f))\n"), encoding="utf-8")
    edited = answer()
    assert edited["tau"] == [2.0 * t for t in first["tau"]]
    assert edited["hits"] == [0, 0]
    assert edited["stamp"] != first["stamp"]
    assert set(compiled()) > set(made)

    source.write_text(text, encoding="utf-8")
    assert answer() == first | {"hits": [1, 1]}

    reader = package / "urdf" / "load.py"  # no compiled code depends on it
    reader.write_text('"""Edited. """\n' + reader.read_text(encoding="utf-8").partition('"""\n')[2], encoding="utf-8")
    assert answer() == first | {"hits": [1, 1]}


OWN = """
import json, numpy as np, spatialdyn as sd
from spatialdyn.algebra.scalars import inline
from spatialdyn.engines import run
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.recursions.spec import Argument, Q, Spec

@inline
def scaled(bodies, q, out):
    for i in range(len(q)):
        out[i] = FACTOR * q[i]

spec = Spec("scaled", scaled, None, (Q,), Argument("out", ("nq",), "rad", ""), "", "")
model, out, many = sd.load_urdf("two_link"), np.empty(2), np.empty((3, 2))
assert numba_kernels.sample_kernel(spec)(model.address, np.ones(2), out) == 0
run.batch(spec, model, [np.ones((3, 2))], (), many)
print(json.dumps([out[0], many[2, 1]]))
"""


@COMPILED
def test_a_recursion_of_a_script_is_compiled_as_it_is_in_each_run(tmp_path: Path) -> None:
    """Its module can be imported by no other process, and the stamp says nothing of an edit of it."""
    for factor in (2.0, 3.0):
        text = f"FACTOR = {factor}" + OWN
        assert json.loads(run_python(text, SPATIALDYN_CACHE_DIR=str(tmp_path))) == [factor, factor]


# --- kernels in a user's own compiled code --------------------------------------------------------------


# a kernel of each shape of inputs and results; a user kernel takes two seconds to compile, those below have aba
USER_KERNELS = {"crba", "kinetic_energy", "integrate"}


@pytest.mark.parametrize("name", slow_but(USER_KERNELS, thinned(USER_KERNELS, SPECS, 1)))
def test_open_kernel_equals_the_public_call(model: sd.Model, name: str) -> None:
    """``kernels.X(bodies, inputs, out)``; the test after this one has the optional inputs."""
    spec = numba_kernels.variant(SPECS[name], frozenset())
    values = random_inputs(model, spec)
    out = output(model, spec)
    getattr(sd.kernels, name)(model.bodies, *kernel_inputs(model, spec, values), out)
    expected = public(model, spec, values)
    near(out if spec.output.shape else out[0], expected, tolerance(name))


@COMPILED
def test_kernels_run_in_jitted_code_with_forces_last(model: sd.Model) -> None:
    rnea, aba = sd.kernels.rnea, sd.kernels.aba

    @numba.njit
    def round_trip(bodies: Any, q: Any, v: Any, a: Any, fext: Any) -> Any:
        tau, back = np.empty_like(v), np.empty_like(v)
        rnea(bodies, q, v, a, tau, fext)
        aba(bodies, q, v, tau, back, fext)
        return tau, back

    q, v, a, fext = random_inputs(model, SPECS["rnea"])
    tau, back = round_trip(model.bodies, q, v, a, fext)
    near(tau, sd.rnea(model, q, v, a, fext), ROUNDING)
    assert abs(tau - sd.rnea(model, q, v, a)).max() > 1e-3  # the forces count
    near(back, a, CONDITIONED)


@COMPILED
def test_kernels_raise_value_errors_in_jitted_code(model: sd.Model) -> None:
    aba = sd.kernels.aba

    @numba.njit
    def accelerate(bodies: Any, q: Any, v: Any, tau: Any, a: Any) -> None:
        aba(bodies, q, v, tau, a)

    q, v, tau, _ = random_inputs(model, SPECS["aba"])
    a = np.empty(model.nv)
    accelerate(model.bodies, q, v, tau, a)
    for wrong in ((q[:-1], v, tau, a), (q, v[1:], tau, a), (q, v, np.append(tau, 0.0), a), (q, v, tau, a[:-1])):
        with pytest.raises(ValueError, match="size"):
            accelerate(model.bodies, *wrong)
    with pytest.raises(ValueError, match="unit norm"):
        accelerate(model.bodies, 1.1 * q, v, tau, a)
    with pytest.raises(ValueError, match="not finite"):
        accelerate(model.bodies, q, 1e200 * v, tau, a)
    empty = sd.ModelBuilder("empty").add_body("b").build()
    with pytest.raises(ValueError, match="zero articulated inertia"):
        accelerate(empty.bodies, np.zeros(1), np.zeros(1), np.ones(1), np.zeros(1))


def test_the_example_in_the_documentation_of_kernels_runs() -> None:
    found = doctest.DocTestFinder().find(numba_kernels.Kernels, "Kernels", globs={})
    runner = doctest.DocTestRunner()
    results = [runner.run(test) for test in found if test.examples]
    assert sum(result.attempted for result in results) > 4
    assert sum(result.failed for result in results) == 0


def test_kernels_have_the_names_of_the_calls_and_no_other() -> None:
    assert set(dir(sd.kernels)) == {*SPECS, "STAMP"}
    assert sd.kernels.STAMP == numba_kernels.STAMP
    with pytest.raises(AttributeError, match="no kernel 'rnae', expected one of"):
        sd.kernels.rnae


def test_functions_made_of_text_belong_to_no_file() -> None:
    """Python looks up the lines of a function in its file, and may fail to parse them."""
    assert not Path(numba_kernels.kernel_from_text("nothing", ["x"], ["return x"], {}).__code__.co_filename).exists()
