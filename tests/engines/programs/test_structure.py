"""Structures: models that differ in numbers alone share machine code, and nothing else changes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from inputs import empty_memory, random_inputs
from slow import slow_but
from trees import random_tree

import spatialdyn as sd
from spatialdyn.algebra import scalars
from spatialdyn.engines import by_table_kernel, run
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.llvm import simd
from spatialdyn.engines.programs.record import recording, structure
from spatialdyn.engines.programs.record.kernel_layout import Float32Range, KernelLayout
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Tape
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.engines.programs.run.tiered_program import TieredProgram
from spatialdyn.recursions import SPECS

pytestmark = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: no programs")


def bare(name: str) -> Any:
    return numba_kernels.variant(SPECS[name], frozenset())


def loaded(seed: int) -> sd.Model:
    """An arm with a load of random mass, centre and inertia at its last link."""
    rng = np.random.default_rng(seed)
    com, A = 0.05 * rng.normal(size=3), 0.1 * rng.normal(size=(3, 3))
    inertia = np.diag([0.02, 0.03, 0.04]) + 1e-2 * A @ A.T
    return arm().with_(payload={arm().frames[-1].name: (rng.uniform(0.5, 2.0), com, inertia)})


def arm() -> sd.Model:
    return random_tree(4, 5, ["revolute"]).model


def of(name: str, model: sd.Model) -> str:
    return structure.digest(*recording.record((bare(name),), model.bodies))


def program(*constants: float, inputs: int = 2) -> Program:
    """Sums of products of the inputs and constants."""
    tape = Tape()
    x = [tape.input(k) for k in range(inputs)]
    return Program(tape, [sum(c * y for c, y in zip(constants, x, strict=True))], inputs)


LAYOUT = KernelLayout((2,), ((0,),))


@pytest.mark.parametrize("name", ["rnea", "crba", "aba"])
def test_payloads_share_one_structure(name: str) -> None:
    """With signs kept in the constants: a centre of mass on the other side is the same structure."""
    made = [of(name, loaded(seed)) for seed in range(6)]
    assert len(set(made)) == 1


def test_a_structure_is_without_values_and_with_all_else() -> None:
    made = program(2.0, 3.0)
    known = structure.digest(made, LAYOUT)
    assert structure.digest(program(-0.5, 1e300), LAYOUT) == known
    others = [
        (program(1.0, 3.0), LAYOUT),  # 1 is absorbed
        (program(2.0, 0.0), LAYOUT),
        (program(2.0, 2.0), LAYOUT),  # one constant
        (made, KernelLayout((1, 1), ((0,),))),
        (made, KernelLayout((2,), ((0, 0),))),
        (made, KernelLayout((2,), ((0,),), units=((0, 1),))),
        (made, KernelLayout((2,), ((0,),), pivots=((0, 1.0),))),
        (made, KernelLayout((2,), ((0,),), norms=((0,),))),
        (made, KernelLayout((2,), ((0,),), range=Float32Range(1.0, 0.0, None))),
        (made, KernelLayout((2,), ((0,),), range=Float32Range(1.0, 0.0, (0,)))),
    ]
    names = [structure.digest(*of) for of in others]
    assert len({known, *names}) == len(names) + 1
    bounds = [KernelLayout((2,), ((0,),), pivots=((0, least),)) for least in (0.5, 2.0)]
    assert len({structure.digest(made, layout) for layout in bounds}) == 1


def test_code_without_checks_of_results_is_for_bounded_programs_only() -> None:
    """A sine times a constant: the code of a small one, which cannot overflow, is not that of a large one."""

    def of(factor: float) -> str:
        tape = Tape()
        return structure.digest(Program(tape, [factor * scalars.sin(tape.input(0))], 1), KernelLayout((1,), ((0,),)))

    assert of(2.0) == of(3.0) != of(1e31)


def test_numbers_are_constants_then_bounds() -> None:
    made = program(2.0, -3.0)
    layout = KernelLayout((2,), ((0,),), pivots=((0, 0.25),), range=Float32Range(4.0, 0.5, None))
    numbers = structure.Numbers(made, layout)
    np.testing.assert_array_equal(numbers.values(np.float64), [2.0, -3.0, 0.25, 16.0, 0.25, 0.0])
    assert [numbers.values(np.float64)[k] for k in numbers.of_line.values()] == [2.0, -3.0]
    assert structure.Numbers(program(1e300, 2.0), LAYOUT).values(np.float32)[0] == np.inf


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("one", [True, False])
@pytest.mark.parametrize("name", slow_but(["aba"], ["rnea", "aba"]))
def test_shared_code_gives_the_bits_of_own_code(
    monkeypatch: pytest.MonkeyPatch, name: str, one: bool, dtype: Any
) -> None:
    """The second model compiles nothing, and answers as if it had."""
    empty_memory(monkeypatch)
    monkeypatch.setattr(batch_kernels, "_from_disk_cache", lambda digest, kind: None)
    first, second = loaded(0), loaded(1)
    options = recording.ProgramOptions(ranged=dtype == np.float32)
    values = [x.astype(dtype).reshape(67, -1) for x in random_inputs(first, bare(name), batch=(67,))]

    def answer(model: sd.Model) -> Any:
        kernel = batch_kernels.kernel((bare(name),), model.bodies, model.key, (), dtype, options, one)
        assert kernel is not None
        out = np.empty((67, model.nv), dtype)
        rejected = kernel(values, [out])
        assert rejected is not None
        return out, rejected

    own = answer(second)
    batch_kernels.forget()
    other = answer(first)
    monkeypatch.setattr(simd, "compile_program", None)  # not callable
    shared = answer(second)
    for x, y in zip(own, shared, strict=True):
        np.testing.assert_array_equal(x, y)
    assert (shared[0] != other[0]).any()


def test_a_model_of_a_known_structure_is_compiled_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its first batch and its first call take the code of the other, without interpreting."""
    empty_memory(monkeypatch)
    monkeypatch.setattr(batch_kernels, "_from_disk_cache", lambda digest, kind: None)
    spec, first, second = bare("rnea"), loaded(0), loaded(1)
    made = TieredProgram((spec,), first.bodies, first.key)
    for one in (True, False):
        made.compiled(one)
    tiers = TieredProgram((spec,), second.bodies, second.key)
    assert tiers.batch(8).code is made.compiled(one=False).code
    assert tiers.single()[0][0] == made.compiled(one=True).code.entry
    assert tiers.single()[0][1] != made.compiled(one=True).numbers.ctypes.data
    assert "interpreted" not in vars(tiers)


def test_public_calls_of_many_payloads_are_right(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each against the table kernel."""
    run.forget_programs()
    for seed in range(4):
        model = loaded(seed)
        q, v, a = random_inputs(model, bare("rnea"), seed, (5,))
        sd.compile(model, calls=[sd.rnea])
        wanted = np.empty((5, model.nv))
        by_table_kernel.run_table_kernel(bare("rnea"), model, (q, v, a), (), wanted)
        np.testing.assert_allclose(sd.rnea(model, q, v, a), wanted, rtol=1e-13, atol=1e-13)
        np.testing.assert_array_equal(sd.rnea(model, q[0], v[0], a[0]), sd.rnea(model, q, v, a)[0])


def test_large_results_are_prepared_for_or_written_by_the_code_at_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled code that goes through the CPU caches is better than none, until the other pays."""
    empty_memory(monkeypatch)
    monkeypatch.setattr(batch_kernels, "_from_disk_cache", lambda digest, kind: None)
    spec, model = bare("crba"), arm()
    tiers = TieredProgram((spec,), model.bodies, model.key)
    assert tiers.batch(1, stream=True) is tiers.batch(1)  # both interpreted
    plain = tiers.compiled(one=False)
    assert tiers.batch(1, stream=True) is plain
    tiers.spend(tiers.compile_seconds)
    assert tiers.batch(1, stream=True) is tiers.compiled(one=False, stream=True)
    assert tiers.compiled(one=False, stream=True) is not plain
    prepared: list[tuple[bool, bool]] = []
    monkeypatch.setattr(TieredProgram, "compiled", lambda self, one, stream=False: prepared.append((one, stream)))
    for least, wanted in ((1 << 40, []), (1, [(False, True)])):
        monkeypatch.setattr(batch_kernels, "STREAM_BYTES", least)
        prepared.clear()
        assert run.compile_program(spec, model, ())
        assert prepared == [(True, False), (False, False), *wanted]
