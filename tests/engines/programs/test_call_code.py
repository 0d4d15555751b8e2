"""Builtins on table kernels and routines: argument checks, results and reference counts."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import tracemalloc
from typing import Any, NamedTuple

import numpy as np
import pytest
from trees import random_state, random_tree
from unfused import unfused

import spatialdyn as sd
from spatialdyn.algebra.scalars import inline
from spatialdyn.compat.native import recorded_calls
from spatialdyn.engines import run
from spatialdyn.engines.compiled import entries, numba_kernels
from spatialdyn.engines.compiled.memory import at
from spatialdyn.engines.programs.run import single_call
from spatialdyn.engines.programs.run.call_code import CallCode
from spatialdyn.engines.programs.run.routine import Choice, Index, Routine, Truth
from spatialdyn.recursions import SPECS

pytestmark = pytest.mark.skipif(not single_call.READY, reason="nothing is compiled, or Python is not as expected")


@inline
def _twice(x: Any, s: float, n: int, out: Any) -> bool:
    """2 s x for an s of up to 1."""
    for k in range(n):
        out[k] = s * (x[k] + x[k])
    return s <= 1.0


@inline
def _same(x: Any, out: Any) -> bool:
    out[0] = x
    return True


@pytest.fixture(scope="module")
def model() -> Any:
    return random_tree(2, 7, floating=True).model


@pytest.fixture(scope="module")
def state() -> Any:
    return random_state(random_tree(2, 7, floating=True).tree, np.random.default_rng(0))


def of_spec(name: str) -> Any:
    return numba_kernels.variant(SPECS[name], frozenset())


def builtin(code: CallCode, model: sd.Model) -> Any:
    return recorded_calls.recorded_call(code, {"nq": model.nq, "nv": model.nv, "njoints": model.njoints})


def bound(name: str, model: sd.Model) -> Any:
    entries.table_entry(of_spec(name)).compile_now()
    return builtin(CallCode(of_spec(name), model), model)


def test_an_entry_does_the_same_in_plain_python(model: Any, state: Any) -> None:
    s = state
    for name, given in (("rnea", (s.q, s.v, s.a)), ("crba", (s.q,)), ("interpolate", (s.q, s.q, 0.25))):
        code, fresh = CallCode(of_spec(name), model), entries.table_entry.__wrapped__(of_spec(name))
        code._words[0] = ctypes.cast(fresh._callback, ctypes.c_void_p).value
        plain, compiled = builtin(code, model), bound(name, model)
        np.testing.assert_array_equal(plain(*given), compiled(*given))
        for call in (plain, compiled):
            assert call(*given, 1) is call(2.0 * s.q, *given[1:]) is None
        fresh._spent = fresh.compile_seconds  # compiling pays: the caller takes the compiled entry
        assert plain(*given) is None


def test_an_entry_is_renewed_once_its_calls_are_used_up(model: Any, state: Any) -> None:
    """An interpreted program answers until it is compiled; then compiled code, with the same bits."""
    s, spec = state, of_spec("rnea")
    program = run.program(spec, model.with_(gravity=[0.0, 0.0, -9.7]), ()).program
    program._at_hand = lambda *given, **named: None  # as with an empty cache
    code = CallCode(spec, model, program)
    call = builtin(code, model)
    first = call(s.q, s.v, s.a)
    assert not code.renew()
    program.compiled(one=True)
    assert call(s.q, s.v, s.a) is None
    del program._at_hand
    assert code.renew()
    np.testing.assert_array_equal(call(s.q, s.v, s.a), first)
    code.use_table()
    np.testing.assert_array_equal(call(s.q, s.v, s.a), unfused("rnea", model, s.q, s.v, s.a))


def test_a_builtin_gives_the_bits_of_the_call(model: Any, state: Any) -> None:
    s = state
    found = bound("rnea", model)(s.q, s.v, s.a)
    np.testing.assert_array_equal(found, unfused("rnea", model, s.q, s.v, s.a))
    assert type(found) is np.ndarray
    assert found.flags.owndata
    assert found.flags.writeable
    M = bound("crba", model)(s.q)
    np.testing.assert_array_equal(M, unfused("crba", model, s.q))
    assert M.flags.c_contiguous


def test_numbers_that_are_apart_are_read_where_they_are(model: Any, state: Any) -> None:
    s = state
    call, expected = bound("rnea", model), unfused("rnea", model, s.q, s.v, s.a)
    np.testing.assert_array_equal(call(s.q, np.stack([s.v, s.a], 1)[:, 0], s.a), expected)
    np.testing.assert_array_equal(call(s.q, s.v[::-1].copy()[::-1], s.a), expected)
    read_only = s.a.copy()
    read_only.flags.writeable = False
    np.testing.assert_array_equal(call(s.q, s.v, read_only), expected)


def unaligned(x: Any) -> Any:
    room = np.empty(x.nbytes + 1, np.uint8)[1:].view(np.float64)
    room[:] = x
    return room


@pytest.mark.parametrize(
    "wrong",
    [
        list, tuple, np.float32, lambda x: x.astype(">f8"), lambda x: x[:-1], lambda x: x[:, None],
        lambda x: None, lambda x: x.view(np.int64), lambda x: np.float64(1.0), unaligned, lambda x: x * np.nan,
        lambda x: 3, lambda x: np.array(1.0), lambda x: x.view(type("Other", (np.ndarray,), {})),
    ],
)  # fmt: skip
def test_other_arguments_are_rejected(model: Any, state: Any, wrong: Any) -> None:
    s = state
    assert bound("rnea", model)(s.q, wrong(s.v), s.a) is None


def test_the_number_of_arguments_is_checked(model: Any, state: Any) -> None:
    call, s = bound("rnea", model), state
    assert call() is call(s.q, s.v) is call(s.q, s.v, s.a, s.a) is None


def test_a_number_is_a_float(model: Any, state: Any) -> None:
    call, s = bound("interpolate", model), state
    np.testing.assert_array_equal(call(s.q, s.q, 0.5), unfused("interpolate", model, s.q, s.q, 0.5))
    np.testing.assert_array_equal(call(s.q, s.q, np.float64(0.5)), call(s.q, s.q, 0.5))
    assert call(s.q, s.q, 1) is call(s.q, s.q, None) is call(s.q, s.q, np.array(0.5)) is None


def test_an_index_is_an_int_in_range_and_leaves_no_error() -> None:
    routine = Routine(_same, {"x": Index("below")}, ())
    call = routine.bind({"below": 2})
    assert (call(0), call(1)) == (0.0, 1.0)
    for wrong in (-1, 2, 10**30, -(10**30), 1.0, True, np.int64(1), None, "1"):
        assert call(wrong) is None


def test_a_choice_is_the_place_of_an_object() -> None:
    objects = "first", object(), 3.5
    words = {f"w{k}": id(x) for k, x in enumerate(objects)}
    routine = Routine(_same, {"x": Choice(tuple(words))}, ())
    call = routine.bind(words, objects)
    assert [call(x) for x in objects] == [0.0, 1.0, 2.0]
    assert call(object()) is call(4.0) is call() is None


def test_a_routine_is_compiled_once_that_pays() -> None:
    """Plain Python answers first; the call at the change is answered too."""
    routine = Routine(_twice, {"x": ("n",), "s": ()}, ("n",))
    call, x = routine.bind({"n": 3}), np.arange(3.0)
    expected = 0.5 * (x + x)
    if routine.entry._code is None:
        np.testing.assert_array_equal(call(x, 0.5), expected)
        routine.entry._spent = routine.entry.compile_seconds
    np.testing.assert_array_equal(call(x, 0.5), expected)
    matrix = np.arange(12.0).reshape(3, 4)
    np.testing.assert_array_equal(call(matrix[:, 1], 0.5), matrix[:, 1])
    np.testing.assert_array_equal(call(matrix[::-1, 1], 1.0), 2.0 * matrix[::-1, 1])
    assert call(x, 2.0) is call(x[:2], 0.5) is call(x, 1) is None


class _Line(NamedTuple):
    slope: int
    places: int


@inline
def _on_line(x: float, n: int, line: _Line, out: Any) -> bool:
    """slope x + the numbers at ``places``."""
    places = at(line.places, (n,))
    for k in range(n):
        out[k] = line.slope * x + places[k]
    return True


def test_words_may_come_in_a_record() -> None:
    places = np.arange(3.0)
    routine = Routine(_on_line, {"x": ()}, ("n",))
    call = routine.bind({"n": 3, "slope": 2, "places": places.ctypes.data}, places)
    np.testing.assert_array_equal(call(5.0), [10.0, 11.0, 12.0])
    routine.entry._spent = routine.entry.compile_seconds
    np.testing.assert_array_equal(call(5.0), [10.0, 11.0, 12.0])
    places[0] = 4.0
    np.testing.assert_array_equal(call(5.0), [14.0, 11.0, 12.0])
    out = np.empty(3)
    assert routine.function(5.0, 3, _Line(2, places.ctypes.data), out)
    np.testing.assert_array_equal(out, [14.0, 11.0, 12.0])


def test_a_number_may_be_a_truth_and_another_function_may_answer() -> None:
    routine = Routine(_same, {"x": ()}, Truth())
    call = routine.bind({}, otherwise=lambda x: f"not {x}")
    assert call(0.0) is False
    assert call(-1.0) is call(np.nan) is True
    assert call(1) == "not 1"


def test_inputs_may_stand_at_addresses_and_be_recorded() -> None:
    x, memory, stamp, now = np.arange(3.0), np.zeros(4), np.zeros(2, np.int64), np.zeros(1)
    routine = Routine(_twice, {"x": ("n",), "s": ()}, ("n",))
    held = routine.bind({"n": 3, "x": x, "s": x[1:]})
    words = {"clock": stamp.ctypes.data, "time": stamp[1:].ctypes.data, "memory": memory.ctypes.data}
    words |= {"now": now.ctypes.data, "then": x.ctypes.data, "bytes": 8, "count": 2}  # the result is not recorded
    noted = routine.bind({"n": 3}, x, memory, stamp, now, record=single_call.record(**words))
    np.testing.assert_array_equal(held(), 2.0 * x)
    np.testing.assert_array_equal(noted(x + 1.0, 0.25), 0.5 * (x + 1.0))
    np.testing.assert_array_equal(memory, [1.0, 2.0, 3.0, 0.25])
    assert stamp.tolist() == [1, 1]
    assert noted(x, 2.0) is None
    now[0] = 1.0  # the two blocks differ
    assert noted(x, 0.5) is None
    np.testing.assert_array_equal(memory, [1.0, 2.0, 3.0, 0.25])
    assert stamp.tolist() == [1, 1]


def test_references_are_counted(model: Any, state: Any) -> None:
    call, s = bound("rnea", model), state
    assert sys.getrefcount(call(s.q, s.v, s.a)) == sys.getrefcount(np.empty(1))
    before = [sys.getrefcount(x) for x in (None, True, np.ndarray, s.q, np.dtype(float))]
    for _ in range(10000):
        call(s.q, s.v, s.a)
        call(s.q, s.v)
        call(s.q, s.v * np.nan, s.a)
    after = [sys.getrefcount(x) for x in (None, True, np.ndarray, s.q, np.dtype(float))]
    assert max(abs(a - b) for a, b in zip(after, before, strict=True)) < 100


def test_no_memory_leaks(model: Any, state: Any) -> None:
    call, s = bound("crba", model), state
    bad = 2.0 * s.q
    call(s.q)
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(1000):
            call(s.q)
            call(bad)
        assert tracemalloc.get_traced_memory()[0] - before < 10 * model.nv**2 * 8
    finally:
        tracemalloc.stop()


def test_a_builtin_keeps_what_it_points_at(state: Any) -> None:
    made = random_tree(2, 7, floating=True).model
    s, call = state, bound("rnea", made)
    expected = unfused("rnea", made, s.q, s.v, s.a)
    del made
    np.testing.assert_array_equal(call(s.q, s.v, s.a), expected)


def test_functions_may_outlive_what_they_are_made_by() -> None:
    """Garbage collected together, in any order: freed memory is overwritten, so a late access shows."""
    script = """
import gc
from spatialdyn.engines.programs.run.routine import Routine
for k in range(3):
    def nothing(one: int) -> bool:
        return True
    made = Routine(nothing, {})
    functions = [made.bind({"one": 1}) for _ in range(20)]
    assert all(f() for f in functions)
    functions.append((functions, made))
    made.functions = functions
    del made, functions
    gc.collect()
print("done")
"""
    environment = {**os.environ, "PYTHONMALLOC": "malloc", "MALLOC_PERTURB_": "255"}
    ran = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert ran.stdout == "done\n", ran.stderr
