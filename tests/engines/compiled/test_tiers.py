"""Functions that plain Python runs until compiling them pays: the same bits, and when they are compiled."""

from __future__ import annotations

import ctypes
import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from slow import slow_but
from trees import random_state, random_tree

from spatialdyn.algebra.scalars import cos, sin
from spatialdyn.engines.compiled import angles, entries, numba_kernels, tiers
from spatialdyn.engines.programs.run import single_call
from spatialdyn.recursions import SPECS

pytestmark = pytest.mark.skipif(not single_call.READY, reason="nothing is compiled, or Python is not as expected")


class Counted(tiers.Tier):
    """A function that is compiled in no time."""

    def __init__(self, stored: bool) -> None:
        super().__init__()
        self.stored, self.asked = stored, 0

    def _is_stored(self, *arguments: Any) -> bool:
        self.asked += 1
        return self.stored

    def _compile(self) -> Any:
        return len


def test_a_function_is_compiled_once_plain_python_took_as_long() -> None:
    tier = Counted(stored=False)
    assert tier.code() is tier.code() is None
    assert tier.in_plain_python(abs, (-1,)) == 1
    assert tier.code() is None
    tier._spent += tier.compile_seconds
    assert tier.code() is len
    assert tier.asked == 1  # the disk is read once


def test_a_function_whose_code_is_on_disk_is_loaded_at_once() -> None:
    assert Counted(stored=True).code() is len


@pytest.mark.parametrize("error", [OverflowError, MemoryError])
def test_an_entry_that_raises_in_plain_python_does_not_apply(error: type[BaseException]) -> None:
    """Its caller then computes the call another way."""
    raised: list[int] = []

    def plain(*given: int) -> int:
        if len(raised) % 2 == 0:
            raised.append(1)
            raise error
        raised.append(0)
        return 7

    entry = entries.Entry(plain, lambda: plain)
    call = ctypes.PYFUNCTYPE(*[ctypes.c_int64] * 4)(entry.address)
    assert [call(0, 0, 0) for _ in range(4)] == [0, 7, 0, 7]


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_what_interrupts_an_entry_is_raised_by_its_builtin_once(error: type[BaseException]) -> None:
    """The function for other arguments is not called then."""
    interrupt, otherwise = error("now"), iter("no call")

    def plain(*given: int) -> int:
        if next(stops):
            raise interrupt
        return 0

    entry, stops = entries.Entry(plain, lambda: plain), iter([True, False, True])
    plan = single_call.plan(entry.words(0), [(3,), ()], [(2,)], single_call.SEVERAL, entry)
    call = single_call.bound(lambda x: next(otherwise), [single_call.Parameter("x", single_call.ARRAY)], plan)
    for expected in (None, "n", None):
        if expected:
            assert call(np.zeros(2)) == expected
        else:
            with pytest.raises(error) as found:
                call(np.zeros(2))
            assert found.value is interrupt


def test_a_product_and_a_sum_are_rounded_once() -> None:
    a, b, c = 1.0 + 2.0**-30, 1.0 - 2.0**-30, -1.0
    assert angles.fma(a, b, c) == -(2.0**-60)
    assert a * b + c == 0.0
    assert math.copysign(1.0, angles.fma(-0.0, 1.0, -0.0)) == -1.0


def test_sines_have_the_bits_of_the_kernels() -> None:
    from spatialdyn.engines.compiled import jit

    rng = np.random.default_rng(0)
    q = np.concatenate([rng.uniform(-8.0, 8.0, 200), [0.0, -0.0, math.pi, -math.pi / 2.0, 1e7, 1e300, 1e-300]])
    turned, found = angles.turned(q), np.empty((3, len(q)))
    kernel = numba_kernels.kernel_from_text(
        "turned_for_a_test", ["q", "out"], ["stamp", "turned(q, out)"], {"turned": jit.turned}
    )
    jit.numba_jit(kernel, contract=False)(q, found)
    np.testing.assert_array_equal([[x, cos(x), sin(x)] for x in turned], found.T)
    np.testing.assert_allclose(found[2, :200], np.sin(q[:200]), atol=2e-16)
    assert float(Fraction(turned[0])) == q[0]


@pytest.mark.parametrize("name", slow_but(["frame_jacobian"], ["rnea", "aba", "frame_jacobian"]))
def test_table_kernels_have_the_same_bits_in_plain_python(name: str) -> None:
    made = random_tree(2, 7, floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(0))
    kernel = tiers.TableKernel(numba_kernels.variant(SPECS[name], frozenset()))
    given = {"rnea": (s.q, s.v, s.a), "aba": (s.q, s.v, s.tau)}.get(name, (s.q, model.nv, np.eye(4), 2))
    found = np.empty((2, *((6, model.nv) if name == "frame_jacobian" else (model.nv,))))
    assert kernel.plain(model.address, *given, found[0]) == numba_kernels.OK
    kernel.compile_now()
    assert kernel(model.address, *given, found[1]) == numba_kernels.OK
    np.testing.assert_array_equal(*found)
