"""Calls on any arrays give the results of plain float64 ones, finite where the inputs are, or raise a SpatialDynError.

The models, calls and values come from the table of calls; shapes, layouts, dtypes and extremes are drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from functools import cache
from typing import Any

import numpy as np
import pytest
from fuzzing import cases
from hypothesis import given
from hypothesis import strategies as st
from inputs import MAIN_CALLS, options, random_input, sorted_inputs
from trees import random_tree

import spatialdyn as sd
from spatialdyn.calls.arguments import core_shape
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.recursions import SPECS

LANES = 512  # the least batch that runs on lanes
ON_LANES = ("rnea", "crba", "aba")
DTYPES = (np.float64, np.float32)
EXTREME = (
    0.0, -0.0, 5e-324, -1e-308, 1e-160, 1e-16, 0.5, -1.0, 1e5, -1.1e5, 1e15, 1e100, 1e154, -1e155, 1e200, 1e300,
    1.7976931348623157e308, -1.7976931348623157e308,
)  # fmt: skip
NOT_FINITE = (math.nan, math.inf, -math.inf)
BATCHES = ((), (), (1,), (3,), (2, 3), (2, 1), (1, 3), (0,), (4,), (3, 0))
SOLID = 0.1 * np.eye(3)


# --- models ---------------------------------------------------------------------------------------------------


def _hand(weighs: bool = True) -> sd.Model:
    """A floating hand, two of its fingers following the first; they weigh nothing in a hand that is fixed."""
    builder = sd.ModelBuilder("hand").set_inertia("base", (1.0, (0.0, 0.0, 0.1), SOLID))
    for k, leader in enumerate((None, "f0_joint", "f1_joint")):
        mimic = None if leader is None else {"leader": leader, "multiplier": 2.0 * k, "offset": 0.1}
        body = (0.5, (0.1, 0.2, k), SOLID) if weighs else None
        builder.add_body(f"f{k}", None, "revolute", (k, 1, 2), (0.1, k, 0.2), body, mimic=mimic)
    return builder.build(root="floating" if weighs else "fixed", mimic=True)


def _wrist(mass: float, tip: float) -> sd.Model:
    """Two hinges and a slide of one mass, or none, and a tip."""
    builder = sd.ModelBuilder("wrist")
    for k, kind in enumerate(("revolute", "prismatic", "revolute")):
        m = tip if k == 2 else mass
        body = (m, (0.1, 0.2, 0.3), m * SOLID) if m else None
        builder.add_body(f"b{k}", f"b{k - 1}" if k else None, kind, np.eye(3)[k], (0.1, 0.0, 0.3), body)
    return builder.build()


MODELS: dict[str, Callable[[], sd.Model]] = {
    "tree": lambda: random_tree(3, 6).model,
    "floating": lambda: random_tree(5, 7, floating=True, continuous="cos_sin").model,
    "arm": lambda: random_tree(2, 5, ["revolute", "prismatic", "continuous"]).model,
    "hand": _hand,
    "idle hand": lambda: _hand(False),
    "post": lambda: sd.ModelBuilder("post").build(),
    "light": lambda: _wrist(1.0, 1e-300),
    "heavy": lambda: _wrist(1.0, 1e150),
    "idle tip": lambda: _wrist(1.0, 0.0),
    "massless": lambda: _wrist(0.0, 1.0),
}


@cache
def model_called(name: str) -> sd.Model:
    """One of MODELS, made once."""
    return MODELS[name]()


@cache
def program(model: str, name: str, dtype: Any) -> sd.Specialized:
    """One of ON_LANES as a program."""
    return sd.specialize(model_called(model), getattr(sd, name), dtype=dtype)


# --- arrays ---------------------------------------------------------------------------------------------------


def strided(x: Any) -> Any:
    """Every other entry of a larger array, along each axis."""
    whole = np.full([2 * n for n in x.shape], 7.0)
    whole[(slice(None, None, 2),) * x.ndim] = x
    return whole[(slice(None, None, 2),) * x.ndim]


def unaligned(x: Any) -> Any:
    """At an odd address."""
    raw = np.zeros(x.nbytes + 1, np.uint8)
    made = raw[1:].view(np.float64).reshape(x.shape)
    made[...] = x
    return made


def read_only(x: Any) -> Any:
    """A copy that cannot be written to."""
    x = x.copy()
    x.flags.writeable = False
    return x


# How an array may be given: what reads as the same numbers, and what does not or should be refused.
FORMS: dict[str, Callable[[Any], Any]] = {
    "plain": lambda x: x,
    "list": lambda x: x.tolist(),
    "tuple": lambda x: tuple(x.tolist()) if x.ndim else x,
    "columns first": np.asfortranarray,
    "backwards": lambda x: x[(slice(None, None, -1),) * x.ndim].copy()[(slice(None, None, -1),) * x.ndim],
    "strided": strided,
    "unaligned": unaligned,
    "read only": read_only,
    "repeated": lambda x: np.broadcast_to(x, (2, *x.shape)),
    "one axis more": lambda x: x[None],
    "swapped bytes": lambda x: x.astype(x.dtype.newbyteorder()),
    "memory": lambda x: memoryview(np.ascontiguousarray(x)) if x.size and x.ndim else x,
    "subclass": lambda x: x.view(type("Sub", (np.ndarray,), {})),
    "float32": lambda x: np.clip(x, -3e38, 3e38).astype(np.float32),
    "float16": lambda x: np.clip(x, -6e4, 6e4).astype(np.float16),
    "long double": lambda x: x.astype(np.longdouble),
    "int": lambda x: np.nan_to_num(np.clip(x, -1e9, 1e9)).astype(np.int64),
    "unsigned": lambda x: np.nan_to_num(np.clip(abs(x), 0, 200)).astype(np.uint8),
}
BAD: dict[str, Callable[[Any], Any]] = {
    "none": lambda x: None,
    "word": lambda x: "word",
    "bytes": lambda x: b"123",
    "complex": lambda x: x.astype(complex),
    "bool": lambda x: x.astype(bool),
    "object": lambda x: x.astype(object),
    "text": lambda x: x.astype(str),
    "dates": lambda x: np.zeros(x.shape, "M8[s]"),
    "ragged": lambda x: [[1.0, 2.0], [3.0]],
    "number": lambda x: 0.5,
    "huge number": lambda x: 10**400,
    "set": lambda x: {1.0},
    "mapping": lambda x: {"q": 1.0},
    "iterator": lambda x: iter([1.0]),
    "function": lambda x: len,
    "record": lambda x: np.zeros(x.shape, [("a", float)]),
    "longer": lambda x: np.zeros((*x.shape, 2)) if not x.ndim else np.concatenate([x, x[..., :1]], axis=-1),
    "shorter": lambda x: x[..., 1:] if x.ndim else None,
    "transposed": lambda x: x.T,
    "scalar": lambda x: np.float64(0.5),
}
OUTS: dict[str, Callable[[tuple[int, ...]], Any]] = {
    "right": np.zeros,
    "larger": lambda shape: np.zeros((2, *shape)),
    "float32": lambda shape: np.zeros(shape, np.float32),
    "swapped bytes": lambda shape: np.zeros(shape, np.dtype(float).newbyteorder()),
    "read only": lambda shape: read_only(np.zeros(shape)),
    "columns first": lambda shape: np.zeros(shape[::-1]).T,
    "strided": lambda shape: strided(np.zeros(shape)),
    "unaligned": lambda shape: unaligned(np.zeros(shape)),
    "repeated": lambda shape: np.broadcast_to(np.zeros(()), shape),
    "list": lambda shape: np.zeros(shape).tolist(),
    "number": lambda shape: 0.0,
    "word": lambda shape: "out",
}

forms = st.sampled_from([*FORMS, *FORMS, *BAD])
spoils = st.lists(
    st.tuples(st.integers(0, 9), st.integers(0, 999), st.sampled_from(EXTREME * 3 + NOT_FINITE)), max_size=3
)


def values_of(model: sd.Model, name: str, batches: list[tuple[int, ...]], seed: int) -> list[Any]:
    """Sound values of a call's inputs, each of a batch shape of its own."""
    rng = np.random.default_rng(seed)
    return [random_input(model, x, rng, b) for x, b in zip(sorted_inputs(SPECS[name]), batches, strict=False)]


def spoil(values: list[Any], changes: list[Any]) -> None:
    """Put extreme numbers into some places."""
    for which, at, number in changes:
        x = values[which % len(values)] if values else np.empty(0)
        if x.size and x.ndim:
            x.flat[at % x.size] = number


def finite_samples(model: sd.Model, name: str, values: list[Any], batch: tuple[int, ...]) -> Any:
    """Which samples of a batch have finite inputs."""
    ok = np.ones(batch, bool)
    for argument, x in zip(sorted_inputs(SPECS[name]), values, strict=True):
        if x is not None:
            axes = tuple(range(-len(argument.shape), 0))
            ok &= np.broadcast_to(np.isfinite(np.asarray(x, float)).all(axis=axes), batch)
    return ok


def sound(found: Any, core: tuple[int, ...], ok: Any) -> None:
    """Results are of the shape that is due, and finite where the inputs are."""
    found = np.asarray(found)
    assert found.dtype == np.float64 or found.dtype == np.float32
    assert found.shape == ok.shape + core
    finite = np.isfinite(found).all(axis=tuple(range(len(ok.shape), found.ndim)))
    assert (finite | ~ok).all()


def refused(run: Callable[[], Any]) -> Any:
    """The result. Returns None if a SpatialDynError is raised."""
    try:
        return run()
    except sd.SpatialDynError as error:
        assert len(str(error)) > 20  # noqa: PT017 - a refusal says something
        return None


def call(model: Any, name: str, values: list[Any], **more: Any) -> Any:
    """The public call by the names of its inputs; None if it is refused."""
    given_ = dict(zip([x.name for x in sorted_inputs(SPECS[name])], values, strict=True))
    return refused(lambda: getattr(sd, name)(model, **given_, **options(model, SPECS[name]), **more))


# --- tests ----------------------------------------------------------------------------------------------------


def of_calls(names: Collection[str]) -> Any:
    """Calls of some names with arrays of any form, sound or spoilt, and an ``out`` or none."""
    return given(
        st.sampled_from(list(MODELS)),
        st.sampled_from(list(names)),
        st.lists(st.sampled_from(BATCHES), min_size=4, max_size=4),
        spoils,
        st.lists(forms, min_size=4, max_size=4),
        st.sampled_from([None, None, *OUTS]),
        st.integers(0, 999),
    )


@cases(200)
@of_calls(MAIN_CALLS)
def test_arrays_of_the_main_calls_are_taken_as_their_numbers_or_refused(
    which: str, name: str, batches: Any, changes: Any, shapes: Any, out: Any, seed: int
) -> None:
    hold_arrays(which, name, batches, changes, shapes, out, seed)


@pytest.mark.slow(quick="test_arrays_of_the_main_calls_are_taken_as_their_numbers_or_refused")
@cases(800)
@of_calls(SPECS)
def test_any_array_is_taken_as_its_numbers_or_refused(
    which: str, name: str, batches: Any, changes: Any, shapes: Any, out: Any, seed: int
) -> None:
    hold_arrays(which, name, batches, changes, shapes, out, seed)


def hold_arrays(which: str, name: str, batches: Any, changes: Any, shapes: Any, out: Any, seed: int) -> None:
    """A call takes arrays as their numbers and leaves them alone, or refuses them; ``out`` is whole or left alone."""
    model, spec = model_called(which), SPECS[name]
    values = values_of(model, name, batches, seed)
    spoil(values, changes)
    given_ = [(FORMS | BAD)[form](x) for form, x in zip(shapes, values, strict=False)]
    before = [x.copy() if isinstance(x, np.ndarray) else None for x in given_]
    found = call(model, name, given_)
    for x, copied in zip(given_, before, strict=True):
        if isinstance(x, np.ndarray) and x.dtype != object:
            assert x.tobytes() == copied.tobytes()
    if found is None:
        return
    arrays = [None if x is None else np.array(x, dtype=np.float64, order="C") for x in given_]
    again = call(model, name, arrays)
    np.testing.assert_array_equal(found, again)
    lead = [x.shape[: x.ndim - len(a.shape)] for x, a in zip(arrays, sorted_inputs(spec), strict=True) if x is not None]
    batch = np.broadcast_shapes(*lead)
    core = core_shape(model, spec.output)
    sound(found, core, finite_samples(model, name, arrays, batch))
    if out is not None:
        target = OUTS[out](batch + core)
        written = call(model, name, given_, out=target)
        assert written is None or written is target
        if written is not None:
            np.testing.assert_array_equal(np.reshape(written, batch + core), found)


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing runs on lanes")
@cases(400)
@given(
    st.sampled_from(["floating", "light", "heavy", "massless"]),
    st.sampled_from(ON_LANES),
    st.sampled_from([None, *DTYPES]),
    st.integers(LANES, LANES + 40),
    st.lists(st.booleans(), min_size=4, max_size=4),
    spoils,
    st.integers(0, 999),
)
def test_a_batch_on_lanes_is_finite_where_its_input_is_or_refused(
    which: str, name: str, dtype: Any, n: int, alone: Any, changes: Any, seed: int
) -> None:
    """The public call and programs in float64 and float32, some inputs one sample for all."""
    model, spec = model_called(which), SPECS[name]
    values = values_of(model, name, [(1,) if one else (n,) for one in alone], seed)[: len(spec.present)]
    spoil(values, changes)
    values = [x for x, a in zip(values, sorted_inputs(spec), strict=True) if not a.optional]
    try:
        found = program(which, name, dtype)(*values) if dtype else getattr(sd, name)(model, *values)
    except sd.SpatialDynError:
        return
    batch = (n,) if n in [len(x) for x in values] else (1,)
    more = [None] * (len(sorted_inputs(spec)) - len(values))
    if dtype is np.float32:
        with np.errstate(over="ignore"):
            values = [x.astype(np.float32) for x in values]
    sound(found, core_shape(model, spec.output), finite_samples(model, name, [*values, *more], batch))


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: there are no programs")
@cases(500)
@given(
    st.sampled_from([("floating", "aba"), ("arm", "rnea"), ("massless", "crba")]),
    st.sampled_from(DTYPES),
    st.lists(st.sampled_from(BATCHES), min_size=4, max_size=4),
    spoils,
    st.lists(forms, min_size=4, max_size=4),
    st.sampled_from([None, None, *OUTS]),
    st.integers(0, 999),
)
def test_a_program_takes_any_array_as_its_numbers_or_refuses(
    what: tuple[str, str], dtype: Any, batches: Any, changes: Any, shapes: Any, out: Any, seed: int
) -> None:
    which, name = what
    model, made = model_called(which), program(which, name, dtype)
    given_ = values_of(model, name, batches, seed)[: 1 if name == "crba" else 3]
    spoil(given_, changes)
    given_ = [(FORMS | BAD)[form](x) for form, x in zip(shapes, given_, strict=False)]
    found = refused(lambda: made(*given_))
    if found is None:
        return
    arrays = [np.array(x, dtype=np.float64, order="C") for x in given_]
    np.testing.assert_array_equal(found, made(*arrays))
    batch = np.broadcast_shapes(*(x.shape[:-1] for x in arrays))
    core = core_shape(model, SPECS[name].output)
    optional = [None] * (len(sorted_inputs(SPECS[name])) - len(arrays))
    sound(found, core, finite_samples(model, name, [*arrays, *optional], batch))
    if out is not None:
        target = OUTS[out](batch + core)
        written = refused(lambda: made(*given_, out=target))
        if written is not None:
            assert written is target
            np.testing.assert_array_equal(written, found)


@cases(300)
@given(
    st.sampled_from([None, 0, "panda", [], {}, np.zeros(3), sd.Model, float("nan")]),
    st.sampled_from(list(SPECS)),
    st.sampled_from(list(FORMS)),
)
def test_what_is_no_model_is_refused(model: Any, name: str, form: str) -> None:
    spec = SPECS[name]
    values = values_of(model_called("arm"), name, [()] * 4, 0)
    chosen = options(model_called("arm"), spec)
    with pytest.raises(sd.ModelError):
        getattr(sd, name)(model, *[FORMS[form](x) for x in values if not isinstance(x, float)], **chosen)
