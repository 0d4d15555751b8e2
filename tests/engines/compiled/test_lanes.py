"""Kernels on lanes: the bits of one sample in every width, faults in their own sample, and when they are compiled."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache, lru_cache
from typing import Any

import numpy as np
import pytest
from inputs import no_programs_of_rows
from trees import random_tree

import spatialdyn as sd
from spatialdyn.bodies.table import BODIES
from spatialdyn.engines import by_table_kernel, run
from spatialdyn.engines.compiled import lane_batches, lane_kernels, lane_names, numba_kernels
from spatialdyn.engines.compiled.numba_settings import PLAIN
from spatialdyn.engines.numbers.samples import Evaluation
from spatialdyn.engines.programs.record import recording
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.derivatives.step_derivatives import MOTION as STEP
from spatialdyn.recursions.spec import Spec
from spatialdyn.recursions.tree.operational_inertia import COUPLING

pytestmark = pytest.mark.skipif(PLAIN or not lane_names.fits(SPECS["crba"]), reason="no lanes here")
COUNT = 13  # samples: no multiple of a width
ROUNDING = 1e-13  # of the largest entry of a result, over 15 random joints; measured 3e-15
NOTHING = 1e-16  # as the coupling of frames whose branches meet in the ground alone, but for rounding
SCALES = {"aba": 1e3, "aba_derivatives": 1e3, "crba_solve": 1e3}  # a solve in a badly conditioned tree
EVERY_WIDTH = ("rnea", "aba", "crba")
PLACEMENT = np.array([[0, -1, 0, 0.3], [1, 0, 0, 0.2], [0, 0, 1, 0.1], [0, 0, 0, 1.0]])
STATIC = {"placement": PLACEMENT, "other_placement": np.eye(4), "classical": 1}


@cache
def model(seed: int) -> sd.Model:
    """Fifteen joints of all kinds: twelve trees have every kind, both layouts, rotors and both roots."""
    layout = "cos_sin" if seed % 3 == 0 else "angle"
    found: sd.Model = random_tree(seed, 14, floating=seed % 2 == 1, continuous=layout).model
    return found


def inputs(spec: Spec, of: sd.Model, seed: int) -> list[np.ndarray]:
    """Random values of the varying inputs."""
    rng = np.random.default_rng(seed)
    shapes = [(k, x, recording.shape_of(x, of.bodies, ()) or (1,)) for k, x in enumerate(spec.present) if not x.static]
    return [
        np.ascontiguousarray(sd.random_configuration(of, seed + k, COUNT)) if x.unit_norm
        else rng.normal(size=(COUNT, *shape))
        for k, x, shape in shapes
    ]  # fmt: skip


def static_inputs(spec: Spec, of: sd.Model, reference: int) -> tuple[Any, ...]:
    """Values of the static inputs: a frame on the last body."""
    values = {**STATIC, "row": of.nv, "other_row": of.joints[3].idx_v + of.joints[3].nv, "reference": reference}
    return tuple(values[x.name] for x in spec.present if x.static)


def result(
    kernel: Callable[..., int], spec: Spec, of: sd.Model, given: list[np.ndarray], static: tuple[Any, ...] = ()
) -> tuple[Any, Any]:
    """Results and statuses of a batch kernel."""
    out = np.full((COUNT, *(recording.shape_of(spec.output, of.bodies, ()) or (1,))), np.nan)
    status = np.full(len(out), 99, np.int8)
    failed = kernel(of.address, len(out), *(y for x in given for y in (x, 1)), *static, out, status)
    assert failed == np.count_nonzero(status)
    return out, status


def check(spec: Spec, width: int, seeds: Sequence[int] = range(12)) -> None:
    """One sample, and exact numbers; those are found once for every width."""
    lanes, one = lane_kernels.kernel(spec, width), numba_kernels.batch_kernel(spec)
    for seed in seeds:
        given, static = inputs(spec, model(seed), seed), static_inputs(spec, model(seed), seed % 3)
        wanted, _ = result(one, spec, model(seed), given, static)
        found, status = result(lanes, spec, model(seed), given, static)
        assert not status.any()
        np.testing.assert_array_equal(found, wanted)
        exact = evaluated(spec, seed)
        bound = SCALES.get(spec.name, 1.0) * ROUNDING * (abs(exact).max() + NOTHING)
        np.testing.assert_allclose(found.reshape(exact.shape), exact, rtol=0.0, atol=bound)


@lru_cache(maxsize=12)
def evaluated(spec: Spec, seed: int) -> np.ndarray:
    """The results of a spec by the interpreter of samples (COUNT, size)."""
    given, static = inputs(spec, model(seed), seed), static_inputs(spec, model(seed), seed % 3)
    size = math.prod(recording.shape_of(spec.output, model(seed).bodies, ()))
    found, statuses = np.empty((COUNT, size)), np.empty(COUNT, np.int8)
    Evaluation(spec, model(seed).bodies, static)(given, found, statuses)
    return found


@pytest.mark.parametrize("name", ["generalized_gravity", "crba"])
def test_lanes_have_the_bits_of_one_sample_and_are_right(name: str) -> None:
    check(numba_kernels.variant(SPECS[name], ()), lane_names.width())


@pytest.mark.slow(quick="test_lanes_have_the_bits_of_one_sample_and_are_right")
@pytest.mark.parametrize("of", [x for x in (*SPECS.values(), COUPLING) if x.on_lanes], ids=lambda x: x.name)
def test_every_call_on_lanes(of: Spec) -> None:
    """With its optional inputs; the three of EVERY_WIDTH without them too, and by one other width in turn."""
    every, own = of.name in EVERY_WIDTH, lane_names.width()
    others = [x for x in (2, 4, 8) if x != own]
    for width in (own, others[EVERY_WIDTH.index(of.name) % len(others)]) if every else (own,):
        spec = numba_kernels.variant(of, tuple(x.name for x in of.present if x.optional))
        check(spec, width, range(12) if width == own and every else range(len(of.name) % 3, 12, 3))
    if every and any(x.optional for x in of.present):
        check(numba_kernels.variant(of, ()), own, range(len(of.name) % 3, 12, 3))


def check_edited(spec: Spec, seeds: Sequence[int], widths: Sequence[int]) -> None:
    """Samples with tables of their own: the bits of a kernel of one sample on that sample's table."""
    one = numba_kernels.batch_kernel(spec)
    for seed in seeds:
        of, rng = model(seed), np.random.default_rng(seed)
        given, static = inputs(spec, of, seed), static_inputs(spec, of, seed % 3)
        tables = np.repeat(of.bodies[None], COUNT, axis=0)
        factor = rng.uniform(0.5, 2.0, size=(COUNT, 1))
        for field in ("inertia", "armature", "inertia_bound", "coupling"):
            scaled(tables, field, factor)
        scaled(tables, "gravity", rng.normal(size=(COUNT, 1)))
        shape = recording.shape_of(spec.output, of.bodies, ()) or (1,)
        wanted, status = np.empty((COUNT, *shape)), np.empty(1, np.int8)
        for k in range(COUNT):
            own, sample = tables[k].copy(), [y for x in given for y in (x[k : k + 1], 1)]
            assert not one(own.ctypes.data, 1, *sample, *static, wanted[k : k + 1], status)
        for w in widths:
            found, left = np.empty_like(wanted), np.empty(COUNT, np.int8)
            known = [y for x in given for y in (x, 1)]
            assert not lane_kernels.kernel(spec, w, edited=True)(
                tables.ctypes.data, COUNT, *known, *static, found, left
            )
            np.testing.assert_array_equal(found, wanted)


def scaled(tables: Any, field: str, factor: np.ndarray) -> None:
    """Multiply the numbers of a field by those of each sample."""
    part = tables[field]
    for name in part.dtype.names or ():
        scaled(part, name, factor)
    if not part.dtype.names:
        part *= factor


def test_samples_with_tables_of_their_own_have_the_bits_of_one() -> None:
    check_edited(numba_kernels.variant(SPECS["generalized_gravity"], ()), range(12), (1, lane_names.width()))


@pytest.mark.slow(quick="test_samples_with_tables_of_their_own_have_the_bits_of_one")
@pytest.mark.parametrize(
    ("name", "alone"),
    [(x, k % 2 == 1) for k, x in enumerate((*EVERY_WIDTH, "minverse", "momentum_rate", "body_regressor"))],
)
def test_more_calls_with_tables_of_their_own(name: str, alone: bool) -> None:
    """On lanes, or one sample at a time, in turn."""
    check_edited(numba_kernels.variant(SPECS[name], ()), range(12), (1 if alone else lane_names.width(),))


def test_calls_run_on_lanes_unless_they_branch_on_values_or_are_made_of_others() -> None:
    assert [x.name for x in SPECS.values() if not x.on_lanes] == ["aba_square_root"]
    assert not STEP.on_lanes


def test_compiling_on_lanes_leaves_numbas_types_and_typing_as_they_were() -> None:
    from numba import njit, types
    from numba.core.errors import TypingError
    from numba.core.registry import cpu_target

    from spatialdyn.algebra.euclidean import Vec

    lane_kernels.kernel(numba_kernels.variant(SPECS["generalized_gravity"], ()), lane_names.width())
    assert not {"unify", "can_convert_to"} & (vars(types.NamedUniTuple).keys() | vars(types.NamedTuple).keys())
    assert type(cpu_target.typing_context).__module__.startswith("numba.")

    @njit
    def of_two_types(first: bool) -> Any:
        x = Vec(1.0, 2.0, 3.0)
        if first:
            x = Vec(1, 2, 3)
        return x.x

    with pytest.raises(TypingError, match="Cannot unify"):
        of_two_types(True)


@pytest.fixture
def lanes(monkeypatch: pytest.MonkeyPatch) -> None:
    """No programs, and lanes at once."""
    no_programs_of_rows(monkeypatch)
    monkeypatch.setattr(lane_batches.LaneBatches, "compile_seconds", 0.0)
    lane_batches._batches.cache_clear()


@pytest.mark.usefixtures("lanes")
def test_a_batch_is_its_samples_one_by_one_whatever_is_wrong_with_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Angles that the C library turns, and more NaN than NumPy is given."""
    of = random_tree(1, 9, kinds=("revolute",)).model
    q = np.random.default_rng(0).normal(size=(40, of.nq))
    q[3], q[17, 0], q[18] = 1e6, np.nan, 3e7
    monkeypatch.setattr(by_table_kernel, "few_samples", lambda *given: 0)
    alone = np.array([sd.generalized_gravity(of, x) for x in q])
    found = sd.generalized_gravity(of, q)
    assert lane_batches.batches(numba_kernels.variant(SPECS["generalized_gravity"], ())).is_made
    np.testing.assert_array_equal(found, alone)
    assert np.isnan(found[17]).any()
    assert np.isfinite(np.delete(found, 17, axis=0)).all()


@pytest.mark.usefixtures("lanes")
def test_the_sample_that_fails_is_named() -> None:
    of = random_tree(2, 9, kinds=("revolute", "spherical")).model
    q = sd.random_configuration(of, 0, 20)
    joint = next(j for j in of.joints if j.nq == 4)
    q[11, joint.idx_q : joint.idx_q + 4] *= 1.5
    with pytest.raises(sd.ConfigurationError, match=f'joint "{joint.name}" in sample 11, expected 1'):
        sd.generalized_gravity(of, q)


@pytest.mark.usefixtures("lanes")
def test_float32_overflows_as_before_and_a_step_of_zero_serves_all() -> None:
    of = random_tree(3, 9, kinds=("revolute",)).model
    q = np.random.default_rng(1).normal(size=(20, of.nq))
    k = sd.specialize(of, sd.generalized_gravity, dtype=np.float32)
    q32 = q.astype(np.float32)
    found = k(q32)
    np.testing.assert_array_equal(found, sd.generalized_gravity(of, q32.astype(float)).astype(np.float32))


def test_one_sample_answers_until_compiling_pays(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = numba_kernels.variant(SPECS["generalized_gravity"], ())
    asked: list[int] = []
    monkeypatch.setattr(lane_kernels, "is_stored", lambda spec, width, edited: False)
    monkeypatch.setattr(lane_kernels, "kernel", lambda spec, width, edited: asked.append(width) or (lambda *given: 0))
    numba_kernels.batch_kernel(spec)
    tiers = lane_batches.LaneBatches(spec, lane_names.width())
    given = inputs(spec, model(0), 0)
    tiers.prepare(COUNT)
    wanted, _ = result(numba_kernels.batch_kernel(spec), spec, model(0), given)
    found, _ = result(tiers, spec, model(0), given)
    np.testing.assert_array_equal(found, wanted)
    assert not asked
    tiers.spend(tiers.compile_seconds)
    tiers.prepare(1)
    assert not asked  # one sample has no use for lanes
    tiers.prepare(COUNT)
    assert asked == [lane_names.width()]


def test_a_first_batch_compiles_the_kernel_on_lanes_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """One sample runs on lanes too, until the kernel of one sample pays."""
    spec = numba_kernels.variant(SPECS["generalized_gravity"], ())
    one = numba_kernels.batch_kernel(spec)
    lanes = lane_kernels.kernel(spec, lane_names.width())
    asked: list[str] = []
    monkeypatch.setattr(numba_kernels, "is_made", lambda spec: False)
    monkeypatch.setattr(lane_batches, "one_is_stored", lambda spec: False)
    monkeypatch.setattr(lane_kernels, "is_stored", lambda spec, width, edited: False)
    monkeypatch.setattr(numba_kernels, "batch_kernel", lambda spec: asked.append("one") or one)
    monkeypatch.setattr(lane_kernels, "kernel", lambda spec, width, edited: asked.append("lanes") or lanes)
    given = [x[:1].copy() for x in inputs(spec, model(0), 0)]
    alone, status, wanted = np.empty((1, model(0).nv)), np.empty(1, np.int8), np.empty((1, model(0).nv))
    one(model(0).address, 1, *(y for x in given for y in (x, 1)), wanted, status)
    batches = lane_batches.LaneBatches(spec, lane_names.width())
    batches.prepare(COUNT)
    for _ in range(2):
        batches.prepare(1)
        assert batches(model(0).address, 1, *(y for x in given for y in (x, 1)), alone, status) == 0
        np.testing.assert_array_equal(alone, wanted)
    assert asked == ["lanes"]
    batches.spend(batches.compile_seconds)
    batches.prepare(1)
    assert asked == ["lanes", "one"]
    first = lane_batches.LaneBatches(spec, lane_names.width())
    first.prepare(1)
    assert asked == ["lanes", "one", "one"]  # one sample does not wait for lanes


@pytest.mark.parametrize("stored", [True, False])
def test_one_sample_leaves_lanes_for_its_own_kernel_on_disk(monkeypatch: pytest.MonkeyPatch, stored: bool) -> None:
    spec = numba_kernels.variant(SPECS["generalized_gravity"], ())
    asked: list[str] = []
    monkeypatch.setattr(numba_kernels, "is_made", lambda spec: False)
    monkeypatch.setattr(lane_batches, "one_is_stored", lambda spec: asked.append("disk") or stored)
    monkeypatch.setattr(numba_kernels, "batch_kernel", lambda spec: asked.append("one"))
    batches = lane_batches.LaneBatches(spec, lane_names.width())
    batches._code = lambda *given: 0  # lanes are in memory
    for _ in range(3):
        batches.prepare(1)
    assert asked == (["disk", "one"] if stored else ["disk"])


def test_the_disk_holds_the_kernel_of_one_sample(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    spec = numba_kernels.variant(SPECS["generalized_gravity"], ())
    numba_kernels.sample_kernel.__wrapped__(spec)
    assert lane_batches.one_is_stored(spec)
    monkeypatch.setenv("SPATIALDYN_CACHE_DIR", str(tmp_path))
    assert not lane_batches.one_is_stored(spec)


def test_results_larger_than_the_caches_are_left_to_one_sample() -> None:
    """The table is empty but for its sizes: none of it is read."""
    spec, n = numba_kernels.variant(SPECS["crba"], ()), 2600
    bodies = np.zeros(n + 1, BODIES)
    bodies[0]["q_index"] = bodies[0]["last_row"] = n
    kernel = lane_kernels.kernel(spec, lane_names.width())
    given = np.zeros((1, n)), 1, np.empty((1, n, n)), np.empty(1, np.int8)
    assert kernel(bodies.ctypes.data, 1, *given) == lane_kernels.TOO_LARGE


@pytest.mark.usefixtures("lanes")
@pytest.mark.skipif(lane_names.width() < lane_kernels.WIDE, reason="the lanes here are narrow")
def test_large_mass_matrices_run_on_half_of_the_lanes() -> None:
    of, spec = random_tree(1, 380, kinds=("revolute",), branching=0.1).model, numba_kernels.variant(SPECS["crba"], ())
    q = np.random.default_rng(0).normal(size=(9, of.nq))
    alone = np.array([sd.crba(of, x) for x in q])
    np.testing.assert_array_equal(sd.crba(of, q), alone)
    assert lane_batches.batches(spec, lane_kernels.WIDE // 2).is_made
    assert (alone == 0.0).any()  # of rows on other branches


def test_the_mass_matrix_of_a_long_chain_has_no_program() -> None:
    of = random_tree(1, 65, kinds=("revolute",), branching=0.0).model
    assert run.program(SPECS["crba"], of, ()) is None
    assert recording.fits((SPECS["crba"],), of.bodies)  # which ``specialize`` goes by


# --- the number ---------------------------------------------------------------------------------------------


def test_a_product_and_a_sum_are_rounded_once_and_comparisons_have_no_truth() -> None:
    from numba import njit
    from numba.core.errors import TypingError

    from spatialdyn.engines.compiled import jit, lane_arrays

    jit.hand_over()

    @njit
    def fused(x: Any, out: Any) -> None:
        y = lane_arrays.lanes_of(x)
        z = lane_arrays.lanes_of(out)
        z[0] = y[0] * y[1] + y[2]
        z[1] = y[2] - y[0] * y[1]

    a = 1.0 + 2.0**-30
    x, out = np.array([a, a, -1.0]), np.empty(2)
    fused(x, out)
    exact = Fraction(a) * Fraction(a)
    assert out.tolist() == [float(exact - 1), float(-1 - exact)]
    assert math.fsum([a * a, -1.0]) != out[0]

    @njit
    def branches(x: Any) -> bool:
        return bool(lane_arrays.lanes_of(x)[0] > 0.0)

    with pytest.raises(TypingError):
        branches(x)
