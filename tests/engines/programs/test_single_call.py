"""Public calls of one sample: what the builtin answers itself, and what it leaves to the Python function."""

from __future__ import annotations

import ctypes
import gc
import inspect
import pickle
import sys
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from inputs import no_programs_of_rows, options, random_inputs
from trees import random_tree

import spatialdyn as sd
from spatialdyn.calls import dynamics
from spatialdyn.engines import object_layout, run
from spatialdyn.engines.compiled import entries, lane_names, numba_kernels
from spatialdyn.engines.compiled.numba_kernels import variant
from spatialdyn.engines.programs.run import single_call, tiered_program
from spatialdyn.recursions import SPECS

pytestmark = pytest.mark.skipif(not dynamics.BUILTINS, reason="nothing is compiled, or Python is not as expected")
MODELS = {"two_link": lambda: sd.load_urdf("two_link"), "floating": lambda: random_tree(2, 2, floating=True).model}


@pytest.fixture
def arm() -> sd.Model:
    return MODELS["two_link"]().with_(gravity=(0.1, 0.2, -9.7))  # of its own: no plans yet


def inputs(model: sd.Model) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(0)
    return sd.random_configuration(model, rng), rng.normal(size=model.nv), rng.normal(size=model.nv)


@pytest.fixture
def python(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the calls that go on to ``checked_call``."""
    seen: list[str] = []
    right = dynamics.checked_call

    def checked(spec: Any, *given: Any) -> Any:
        seen.append(spec.name)
        return right(spec, *given)

    for function in dynamics.python_calls.values():
        monkeypatch.setitem(function.__globals__, "checked_call", checked)
    return seen


def test_the_second_call_of_a_model_is_answered_by_the_builtin(arm: sd.Model, python: list[str]) -> None:
    q, v, a = inputs(arm)
    first = sd.rnea(arm, q, v, a)
    assert python == ["rnea"]
    for given, more in (
        ((q, v, a), {}),
        ((q, v), {"a": a}),
        ((), {"a": a, "q": q, "v": v}),
        ((q, v, a, None), {}),
        ((q, v, a, None, None), {}),
        ((q, v, a), {"fext": None, "out": None}),
    ):
        found = sd.rnea(arm, *given, **more)
        np.testing.assert_array_equal(found, first)
        assert found.dtype == np.float64
        assert found.flags.carray
        assert found.flags.owndata
    out = np.empty(2)
    assert sd.rnea(arm, q, v, a, out=out) is out
    np.testing.assert_array_equal(out, first)
    assert python == ["rnea"]


def test_one_sample_in_any_form_is_answered_by_the_program(
    arm: sd.Model, python: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lists, integers, float32, strided and byte-swapped arrays are converted, and then take the same way."""
    q, v, a = np.array([0.5, -0.25]), np.array([1.0, 2.0]), np.array([3.0, -4.0])
    expected = sd.rnea(arm, q, v, a)
    fext = np.zeros((arm.njoints, 6))
    fext[1, 2] = 7.0
    loaded = sd.rnea(arm, q, v, a, fext)
    J = sd.frame_jacobian(arm, q, arm.frames[-1].name, "world")
    monkeypatch.setattr(run, "batch", None)  # not callable
    python.clear()
    forms: list[Callable[[np.ndarray], Any]] = [
        np.ndarray.tolist,
        lambda x: tuple(map(float, x)),
        lambda x: x.astype(np.float32),
        lambda x: x.astype(">f8"),
        lambda x: np.repeat(x, 2)[::2],
        lambda x: list(x),
    ]
    for form in forms:
        np.testing.assert_array_equal(sd.rnea(arm, form(q), v, form(a)), expected)
        np.testing.assert_array_equal(sd.rnea(arm, form(q), v, a=form(a), fext=fext.tolist()), loaded)
        np.testing.assert_array_equal(sd.frame_jacobian(arm, form(q), arm.frames[-1].name, "world"), J)
    assert len(python) == 3 * len(forms) - 2  # numbers that are apart are read by the builtin
    np.testing.assert_array_equal(sd.rnea(arm, q, [1, 2], (3, -4)), expected)


def test_numbers_of_any_kind_are_one_sample(arm: sd.Model, python: list[str]) -> None:
    q0, q1 = np.array([0.5, -0.25]), np.array([-0.75, 1.5])
    expected = sd.interpolate(arm, q0, q1, 0.5)
    python.clear()
    np.testing.assert_array_equal(sd.interpolate(arm, q0, q1, np.float64(0.5)), expected)
    assert python == []
    for number in (np.float32(0.5), np.array(0.5)):
        np.testing.assert_array_equal(sd.interpolate(arm, q0, q1, number), expected)
    np.testing.assert_array_equal(sd.interpolate(arm, q0, q1, 1), sd.interpolate(arm, q0, q1, 1.0))
    assert python == 3 * ["interpolate"]
    for number in (np.nan, np.float64(np.nan), np.array(np.nan)):  # the program declines them
        assert np.isnan(sd.interpolate(arm, q0, q1, number)).all()
    assert len(python) == 3 + 1 + 1 + 2


def test_each_choice_of_optional_inputs_has_its_plan(arm: sd.Model, python: list[str]) -> None:
    q, v, a = inputs(arm)
    fext = np.random.default_rng(1).normal(size=(arm.njoints, 6))
    loaded = [sd.rnea(arm, q, v, a, fext) for _ in range(2)]
    assert python == ["rnea"]
    np.testing.assert_array_equal(*loaded)
    np.testing.assert_array_equal(sd.rnea(arm, q, v, a, fext=fext), loaded[0])
    free = sd.rnea(arm, q, v, a)
    assert python == ["rnea"] * 2
    assert (free != loaded[0]).all()
    np.testing.assert_array_equal(sd.rnea(arm, q, v, a, np.zeros_like(fext)), free)
    assert python == ["rnea"] * 2


def test_frames_and_words(arm: sd.Model, python: list[str]) -> None:
    q, v, a = inputs(arm)
    name = arm.frames[-1].name
    answers: dict[Any, Any] = {}
    for _ in range(2):
        for frame in (name, arm.frames[1].name):
            for reference in ("local", "world", "local_world_aligned"):
                for classical in (False, True):
                    found = sd.frame_acceleration(arm, q, v, a, frame, reference=reference, classical=classical)
                    known = answers.setdefault((frame, reference, classical), found)
                    np.testing.assert_array_equal(found, known)
            np.testing.assert_array_equal(sd.frame_acceleration(arm, q, v, a, frame), answers[frame, "local", False])
            some = sd.frame_acceleration(arm, q, v, a, frame, classical=True)
            np.testing.assert_array_equal(some, answers[frame, "local", True])
    assert len(python) == 12
    some = (("local", False), ("local_world_aligned", True), ("world", False))
    assert len({answers[(name, *x)].tobytes() for x in some}) == 3
    before = len(python)
    sd.frame_acceleration(arm, q, v, a, arm.frame(name))  # a Frame has no place in the table of words
    assert len(python) == before + 1


@pytest.mark.parametrize("wrong", ["frame", "reference", "classical"])
def test_wrong_words_are_refused_each_time(arm: sd.Model, wrong: str) -> None:
    q, v, a = inputs(arm)
    given = {"frame": arm.frames[-1].name, "reference": "local", "classical": False}
    values = {"frame": ["none_such", 3, None, []], "reference": ["here", 1, True, []], "classical": [1, "no", [], 0.0]}
    sd.frame_acceleration(arm, q, v, a, **given)
    for value in values[wrong] * 2:
        with pytest.raises(sd.SpatialDynError, match=wrong):
            sd.frame_acceleration(arm, q, v, a, **{**given, wrong: value})


def not_answered(model: sd.Model, q: Any, v: Any, a: Any) -> list[tuple[Any, ...]]:
    """Arguments that the builtin leaves to Python, some valid and some not."""
    swapped = v.astype(v.dtype.newbyteorder())
    shifted = np.empty(8 * len(v) + 1, np.uint8)[1:].view(np.float64) if sys.byteorder else v
    shifted[:] = v

    class Kind(np.ndarray):
        pass

    return [
        (q, v.tolist(), a),
        (q, v.astype(np.float32), a),
        (q, swapped, a),
        (q, shifted, a),
        (q, v[None], a),
        (q, v.view(Kind), a),
        (q, np.ma.array(v), a),
        (q, v[:1], a),
        (q, 0.1, a),
        (q, None, a),
        (q, v),
        (q, v, a, None, None, None),
        (np.full_like(q, np.nan), v, a),
        (np.full_like(q, 1e9), v, a),
        (np.full_like(q, 1e308), v, np.full_like(a, 1e308)),
    ]


def outcome(call: Callable[..., Any], *given: Any, **more: Any) -> tuple[Any, str]:
    try:
        return call(*given, **more), ""
    except Exception as error:
        return None, f"{type(error).__name__}: {error}"


def test_what_is_not_answered_is_as_without_the_builtin(arm: sd.Model, python: list[str]) -> None:
    q, v, a = inputs(arm)
    sd.rnea(arm, q, v, a)
    plain = dynamics.python_calls["rnea"]
    for given in not_answered(arm, q, v, a):
        before = len(python)
        found = outcome(sd.rnea, arm, *given)
        if "TypeError" not in found[1]:
            assert python[before:] == ["rnea"]
        wanted = outcome(plain, arm, *given)
        np.testing.assert_array_equal(found[0], wanted[0])
        assert found[1] == wanted[1]
    for more in ({"v": v}, {"none": 1}, {"out": q}, {"out": np.empty(3)}, {"out": np.empty((2, 2))[:, 0]}, {"out": []}):
        assert outcome(sd.rnea, arm, q, v, a, **more)[1] == outcome(plain, arm, q, v, a, **more)[1] != ""
    read_only = np.empty(2)
    read_only.flags.writeable = False
    assert "writable" in outcome(sd.rnea, arm, q, v, a, out=read_only)[1]
    for model in (None, 3, "two_link"):
        with pytest.raises(sd.ModelError, match="expected a spatialdyn Model"):
            sd.rnea(model, q, v, a)
    with pytest.raises(TypeError, match="missing 4 required"):
        sd.rnea()


def test_out_may_not_overlap_an_input_by_a_single_number(arm: sd.Model) -> None:
    q, v, a = inputs(arm)
    wanted = sd.rnea(arm, q, v, a)
    memory = np.zeros(6)
    for k in range(5):
        memory[2:4] = v
        out = memory[k : k + 2]
        if abs(k - 2) < 2:
            with pytest.raises(sd.ShapeError, match="out overlaps v"):
                sd.rnea(arm, q, memory[2:4], a, out=out)
            np.testing.assert_array_equal(memory[2:4], v)
        else:
            np.testing.assert_array_equal(sd.rnea(arm, q, memory[2:4], a, out=out), wanted)


def test_numbers_in_and_out(arm: sd.Model, python: list[str]) -> None:
    q, v, _ = inputs(arm)
    energies = [sd.kinetic_energy(arm, q, v) for _ in range(2)]
    assert [type(x) for x in energies] == [float] * 2
    assert energies[0] == energies[1]
    q1 = sd.integrate(arm, q, v)
    python.clear()
    between = [sd.interpolate(arm, q, q1, 0.25) for _ in range(2)]
    assert python == ["interpolate"]
    np.testing.assert_array_equal(*between)
    np.testing.assert_array_equal(sd.interpolate(arm, q, q1, np.float64(0.25)), between[0])
    np.testing.assert_array_equal(sd.interpolate(arm, q, q1, 0), q)


@pytest.mark.parametrize("name", sorted(SPECS))
def test_signature_name_and_pickle(name: str) -> None:
    call = getattr(sd, name)
    assert inspect.signature(call) == inspect.signature(dynamics.python_calls[name])
    assert call.__doc__ == dynamics.docstring(SPECS[name])
    assert (call.__name__, call.__module__) == (name, "spatialdyn.calls.dynamics")
    assert pickle.loads(pickle.dumps(call)) is call
    assert inspect.isbuiltin(call)


def test_references_are_counted(arm: sd.Model) -> None:
    q, v, a = inputs(arm)
    sd.rnea(arm, q, v, a)
    frame = arm.frames[-1].name
    sd.frame_jacobian(arm, q, frame, reference="world")
    out, wrong = np.empty(2), np.full(2, np.nan)
    sd.kinetic_energy(arm, q, v)
    sd.frame_jacobian(arm, q, frame)
    sd.rnea(arm, q, wrong, a)  # by the table kernel, which is compiled now
    objects = [q, v, a, out, None, arm, frame, wrong]
    gc.collect()
    before = [sys.getrefcount(x) for x in objects]
    for _ in range(1000):
        sd.rnea(arm, q, v, a, out=out)
        sd.rnea(arm, q, v, a, None)
        sd.frame_jacobian(arm, q, frame, reference="world")
        sd.frame_jacobian(arm, q, frame)
        sd.kinetic_energy(arm, q, v)
    for _ in range(50):
        sd.rnea(arm, q, wrong, a)
    after = [sys.getrefcount(x) for x in objects]
    assert max(abs(x - y) for x, y in zip(before, after, strict=True)) < 40


def test_where_cpython_exports_no_vectorcall_a_functions_own_slot_is_called(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in CPython 3.10; positions, keywords and errors go through."""
    if not hasattr(ctypes.pythonapi, "_PyFunction_Vectorcall"):
        pytest.skip("CPython 3.13 exports PyObject_Vectorcall only")
    known, usual = single_call._process(), object_layout.vectorcall()
    slot = object_layout.api("_PyFunction_Vectorcall")
    assert usual in known
    monkeypatch.setattr(single_call, "_process", lambda: tuple(slot if x == usual else x for x in known))
    plan = single_call.plan((0, 0, single_call.NO_LIMIT.ctypes.data), [(2,)], [(2,)])

    def python(*given: Any, **more: Any) -> Any:
        return given, more if more != {"wrong": 1} else {}["wrong"]

    call = single_call.bound(python, [single_call.Parameter("x", single_call.ARRAY)], plan)
    assert call([1.0, 2.0]) == (([1.0, 2.0],), {})
    assert call("x", y=2, z=None) == (("x",), {"y": 2, "z": None})
    with pytest.raises(KeyError):
        call(wrong=1)


def test_without_builtins_one_plain_path_answers(arm: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    q, v, a = inputs(arm)
    wanted = [sd.rnea(arm, q, v, a) for _ in range(2)][-1]
    monkeypatch.setattr(dynamics, "BUILTINS", False)
    plain = dynamics._public_function(SPECS["rnea"])
    assert inspect.isfunction(plain)
    other = MODELS["two_link"]().with_(gravity=(0.1, 0.2, -9.7))
    for given in ((q, v, a), (q.tolist(), v, a)):
        np.testing.assert_array_equal(plain(other, *given), wanted)
    assert not other._plans
    np.testing.assert_array_equal(plain(other, q[None], v, a)[0], wanted)
    with pytest.raises(sd.ShapeError, match="out overlaps q"):
        plain(other, q, v, a, out=q)


@pytest.mark.parametrize("samples", [1, 5, 700])
def test_history_chooses_how_a_program_runs_and_nothing_else(samples: int) -> None:
    """Interpreted and compiled, alone and in batches: the same bits."""
    model = MODELS["floating"]()
    fresh = model.with_(gravity=(0.0, 0.3, -9.6))
    q, v, a = random_inputs(fresh, SPECS["rnea"], batch=(samples,))[:3]
    program = run.program(variant(SPECS["rnea"], ()), fresh, ())
    assert program is not None
    interpreted = sd.rnea(fresh, q, v, a)
    alone = np.array([sd.rnea(fresh, *x) for x in zip(q, v, a, strict=True)])
    program.program._calls[0] = 0
    program.program.spend(np.inf)
    compiled_ = sd.rnea(fresh, q, v, a)
    later = np.array([sd.rnea(fresh, *x) for x in zip(q, v, a, strict=True)])
    assert fresh._plans["rnea"][0] == program.program.compiled(one=True).code.entry
    for found in (alone, compiled_, later):
        np.testing.assert_array_equal(found, interpreted)


def test_a_program_is_compiled_when_its_calls_are_used_up(arm: sd.Model) -> None:
    q, v, a = inputs(arm)
    sd.rnea(arm, q, v, a)
    program = run.program(variant(SPECS["rnea"], ()), arm, ())
    assert program is not None
    tiers = program.program
    entry = arm._plans["rnea"][0]
    if entry == tiers.interpreted.entry:  # else it was on disk
        tiers._calls[0] = 3
        for left in (2, 1, 0):
            sd.rnea(arm, q, v, a)
            assert tiers._calls[0] == left
        assert arm._plans["rnea"][0] == entry
        sd.rnea(arm, q, v, a)
        assert arm._plans["rnea"][0] != entry
    assert not single_call.exhausted(arm._plans["rnea"])
    assert tiered_program.COMPILE_SECONDS[0] > 0.0


# --- models without a program -------------------------------------------------------------------------------

LARGE = ("generalized_gravity", "crba", "frame_jacobian", "kinetic_energy")  # vectors, a matrix, words, a float
on_lanes = pytest.mark.skipif(not lane_names.fits(SPECS["crba"]), reason="the table kernel here has other bits")


def large(name: str, monkeypatch: pytest.MonkeyPatch) -> sd.Model:
    """A model that counts as too large for a program, when the table kernels of a call are compiled."""
    no_programs_of_rows(monkeypatch)
    spec = variant(SPECS[name], ())
    numba_kernels.batch_kernel(spec)
    entries.sample_entry(spec).compile_now()
    model: sd.Model = random_tree(5, 9, floating=True).model
    return model


@on_lanes
@pytest.mark.parametrize("name", LARGE)
def test_the_second_call_without_a_program_is_answered_by_the_table_kernel(
    name: str, python: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    model, spec = large(name, monkeypatch), variant(SPECS[name], ())
    words = {word: getattr(x, "name", x) for word, x in options(model, spec).items()}
    call = partial(getattr(sd, name), model, **words)
    given, other = random_inputs(model, spec, 3), random_inputs(model, spec, 4)
    first = call(*given)
    for values in (given, other, given):
        python.clear()
        found = call(*values)
        assert not python
        np.testing.assert_array_equal(found, call(*[np.array([x, x]) for x in values])[0])
    np.testing.assert_array_equal(found, first)
    assert not np.array_equal(first, call(*other))


@on_lanes
def test_a_sample_that_a_table_kernel_refuses_goes_on_to_python(
    python: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = large("generalized_gravity", monkeypatch)
    q = sd.random_configuration(model, 1)
    wanted = sd.generalized_gravity(model, q)
    with pytest.raises(sd.ConfigurationError, match="norm"):
        sd.generalized_gravity(model, 2.0 * q)
    q[0], missing = np.nan, q.copy()
    missing[-1] = np.nan
    assert np.isnan(sd.generalized_gravity(model, missing)).any()
    memory = np.concatenate([sd.random_configuration(model, 1), wanted])
    with pytest.raises(sd.ShapeError, match="overlap"):
        sd.generalized_gravity(model, memory[: model.nq], out=memory[1 : 1 + model.nv])
    assert python == ["generalized_gravity"] * 4


@on_lanes
def test_a_table_kernel_is_compiled_for_single_calls_once_that_pays(
    python: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    model, spec = large("generalized_gravity", monkeypatch), variant(SPECS["generalized_gravity"], ())
    fresh = entries.CompiledEntry(entries.sample_entry(spec)._made_by)
    monkeypatch.setattr(entries, "sample_entry", lambda spec: fresh)
    q = sd.random_configuration(model, 1)
    for _ in range(3):
        wanted = sd.generalized_gravity(model, q)
    assert len(python) == 3
    assert fresh._spent == pytest.approx(3 * run.CHECKS_SECONDS)
    fresh.spend(fresh.compile_seconds)
    for _ in range(3):
        np.testing.assert_array_equal(sd.generalized_gravity(model, q), wanted)
    assert len(python) == 4


@on_lanes
def test_other_threads_run_python_during_a_call_of_a_large_model() -> None:
    """No thread is made to give way here, so another one runs only if the call itself lets it."""
    model = random_tree(1, 400, kinds=("revolute",), branching=0.0).model
    q = sd.random_configuration(model, 1)
    sd.crba(model, q)
    entries.sample_entry(variant(SPECS["crba"], ())).compile_now()
    sd.crba(model, q)
    gate, ran = threading.Lock(), []
    gate.acquire()
    thread = threading.Thread(target=lambda: ran.append(gate.acquire()))
    thread.start()
    before = sys.getswitchinterval()
    try:
        sys.setswitchinterval(1e3)
        gate.release()
        for _ in range(2000):
            if ran:
                break
            sd.crba(model, q)
        assert ran
    finally:
        sys.setswitchinterval(before)
        thread.join()


def test_a_mass_matrix_of_many_zeros_has_a_program() -> None:
    """What counts is what M holds: that of a tree of short branches is compiled fast, that of a chain is not."""
    spec = variant(SPECS["crba"], ())
    tree = random_tree(3, 100, kinds=("revolute",), branching=0.6).model
    chain = random_tree(1, 65, kinds=("revolute",), branching=0.0).model
    assert np.count_nonzero(sd.crba(tree, sd.neutral(tree))) < 65**2 < tree.nv**2
    assert run.program(spec, tree, ()) is not None
    assert run.program(spec, chain, ()) is None
