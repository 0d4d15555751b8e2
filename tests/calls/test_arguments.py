"""Arguments that calls accept and refuse: batches, dtypes, ``out``, numbers that are not finite, singular joints."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import pytest
from inputs import MAIN_CALLS, options, public, random_inputs, sorted_inputs
from numpy.typing import NDArray
from slow import slow_but, thinned
from trees import random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import Argument

Array = NDArray[np.float64]
EPS = np.finfo(float).eps
FLOAT32 = 1e-4  # of the largest entry: float32 input is off by 6e-8, a tree's acceleration far more than that
SOLID = 0.1 * np.eye(3)
TAKING = [name for name, spec in SPECS.items() if spec.present]
INDEPENDENT = {("dintegrate", "q")}  # an answer that an input does not change, seen from the body
SLOW = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: minutes of plain Python")
WHICH = [pytest.param("model", marks=SLOW), "gripper"]  # of ten samples and more
PIVOTING = [name for name, spec in SPECS.items() if spec.pivots]


def moves(argument: Argument) -> bool:
    """Whether an input has entries of its own in each sample, and not one number."""
    return bool(argument.shape)


@pytest.fixture(scope="module")
def model() -> sd.Model:
    """A floating tree with quaternions and (cos, sin) pairs."""
    return random_tree(5, 12, floating=True, continuous="cos_sin").model


@pytest.fixture(scope="module")
def gripper() -> sd.Model:
    """A floating hand of three fingers, two of which mimic the first."""
    builder = sd.ModelBuilder("gripper").set_inertia("base", (1.0, (0.0, 0.0, 0.1), SOLID))
    for k, (kind, mimic) in enumerate(
        [("revolute", None), ("revolute", ("f0_joint", -1.5, 0.1)), ("prismatic", ("f1_joint", 0.3, 0.0))]
    ):
        how = None if mimic is None else {"leader": mimic[0], "multiplier": mimic[1], "offset": mimic[2]}
        builder.add_body(f"f{k}", None, kind, (k, 1, 2), (0.1, k, 0.2), (0.5, (0.1, 0.2, k), SOLID), mimic=how)
    made = builder.build(root="floating", mimic=True)
    assert made.mimic_matrix is not None
    return made


def refusal(call: Callable[[], Any], kind: type[Exception] = sd.ShapeError) -> str:
    """The message with which a call refuses."""
    with pytest.raises(kind) as caught:
        call()
    assert type(caught.value) is kind
    return str(caught.value)


def at(values: list[Array], index: Any) -> list[Array]:
    """One sample of each."""
    return [x[index] for x in values]


# --- batches --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", slow_but(MAIN_CALLS, thinned(MAIN_CALLS, TAKING, 0)))
@pytest.mark.parametrize("which", WHICH)
def test_leading_shapes_broadcast(request: pytest.FixtureRequest, which: str, name: str) -> None:
    """(3, 1) with (4,) with none is (3, 4)."""
    model: sd.Model = request.getfixturevalue(which)
    spec = SPECS[name]
    shapes = [(3, 1), (4,), (), (4,)][: len(sorted_inputs(spec))]
    values = [random_inputs(model, spec, k, shape)[k] for k, shape in enumerate(shapes)]
    found = public(model, spec, values)
    batch = np.broadcast_shapes(*shapes)
    full = [np.broadcast_to(x, (*batch, *x.shape[len(s) :])) for x, s in zip(values, shapes, strict=True)]
    for index in np.ndindex(*batch):
        np.testing.assert_allclose(found[index], public(model, spec, at(full, index)), rtol=1e-12, atol=1e-12)
    assert found.shape[: len(batch)] == batch


@pytest.mark.parametrize("name", slow_but(MAIN_CALLS, thinned(MAIN_CALLS, TAKING, 1)))
@pytest.mark.parametrize("which", ["model", "gripper"])
def test_an_empty_batch_has_an_empty_answer(request: pytest.FixtureRequest, which: str, name: str) -> None:
    model: sd.Model = request.getfixturevalue(which)
    spec = SPECS[name]
    one = np.shape(public(model, spec, random_inputs(model, spec)))
    for shape in ((0,), (3, 0)):
        assert public(model, spec, random_inputs(model, spec, 0, shape)).shape == (*shape, *one)
    values = random_inputs(model, spec)
    if len(values) > 1:
        values[0] = values[0][None][:0]
        assert public(model, spec, values).shape == (0, *one)


WITHOUT = ["rnea", "crba", "aba", "aba_derivatives", "crba_solve", "frame_placement"]


@pytest.mark.parametrize("name", slow_but(WITHOUT, thinned(WITHOUT, SPECS, 2)))
def test_a_model_without_freedom_has_answers_without_entries(name: str) -> None:
    builder = sd.ModelBuilder("bench").add_body(
        "leg", None, "fixed", placement=(0, 0, 1), inertia=(2, (0, 0, 0), SOLID)
    )
    model, spec = builder.build(), SPECS[name]
    assert (model.nq, model.nv) == (0, 0)
    known = {"nq": 0, "nv": 0, "njoints": 1}
    for batch in ((), (3,)):
        values = random_inputs(model, spec, 0, batch)
        if name.startswith(("center_of_mass", "centroidal_momentum")) and "nv" not in spec.output.shape:
            assert "not finite" in refusal(lambda values=values: public(model, spec, values), sd.NonFiniteError)
            continue  # nothing moves, so no mass has a centre
        found = np.asarray(public(model, spec, values))
        core = tuple(known[s] if isinstance(s, str) else s for s in spec.output.shape)
        assert found.shape == (*(batch if values else ()), *core)
        assert np.isfinite(found).all()
    if name == "frame_placement":
        np.testing.assert_array_equal(sd.frame_placement(model, [], "leg")[:3, 3], (0, 0, 1))


@pytest.mark.parametrize("name", [name for name, spec in SPECS.items() if not spec.output.shape])
def test_a_number_is_a_float_for_one_sample_and_an_array_for_many(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    values = random_inputs(model, spec)
    assert type(public(model, spec, values)) is float
    assert type(public(model, spec, [x.tolist() for x in values])) is float
    several = public(model, spec, random_inputs(model, spec, 0, (2, 3)))
    assert several.shape == (2, 3)
    out = np.empty(())
    assert public(model, spec, values, out=out) is out
    assert float(out) == public(model, spec, values)
    assert type(sd.total_mass(model)) is float


@pytest.mark.parametrize("name", slow_but(MAIN_CALLS, thinned(MAIN_CALLS, TAKING, 2)))
def test_results_are_float64_whatever_the_input(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    values = random_inputs(model, spec, 0, (2,))
    expected = public(model, spec, values)
    assert expected.dtype == np.float64
    assert expected.flags.c_contiguous
    assert expected.flags.writeable
    forms: list[Callable[[Array], Any]] = [
        lambda x: x.tolist(),
        lambda x: tuple(map(list, x)) if x.ndim > 1 else tuple(x),
        lambda x: np.repeat(x, 2, axis=-1)[..., ::2],
        lambda x: np.asfortranarray(x),
        lambda x: x.astype(">f8"),
    ]
    for form in forms:
        found = public(model, spec, [form(x) for x in values])
        assert found.dtype == np.float64
        np.testing.assert_array_equal(found, expected)
    short = public(model, spec, [x.astype(np.float32) for x in values])
    assert short.dtype == np.float64
    assert abs(short - expected).max() <= FLOAT32 * max(1.0, abs(expected).max())


@pytest.mark.parametrize("dtype", [int, np.int8, np.uint16, np.float16, np.longdouble])
def test_whole_numbers_are_numbers(dtype: Any) -> None:
    arm = sd.load_urdf("two_link")
    q, v, a = np.array([1, 0], dtype), np.array([2, 3], dtype), np.array([0, 1], dtype)
    np.testing.assert_array_equal(sd.rnea(arm, q, v, a), sd.rnea(arm, [1.0, 0.0], [2.0, 3.0], [0.0, 1.0]))


# --- out ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("which", "name"),
    slow_but(
        [*(("model", x) for x in MAIN_CALLS), ("gripper", "rnea"), ("gripper", "aba")],
        [(which, x) for which in ("model", "gripper") for x in SPECS],
    ),
)
def test_the_result_is_written_to_out_and_is_out(request: pytest.FixtureRequest, which: str, name: str) -> None:
    model: sd.Model = request.getfixturevalue(which)
    spec = SPECS[name]
    for batch in ((), (2, 3)):
        values = random_inputs(model, spec, 0, batch)
        expected = np.asarray(public(model, spec, values))
        out = np.full(expected.shape, np.nan)
        assert public(model, spec, values, out=out) is out
        np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize("name", slow_but(MAIN_CALLS, thinned(MAIN_CALLS, SPECS, 3)))
def test_an_out_that_does_not_fit_is_refused_and_left_alone(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    values = random_inputs(model, spec, 0, (2,))
    shape = np.shape(public(model, spec, values))
    locked = np.full(shape, 7.0)
    locked.flags.writeable = False
    wrong = {
        "shape": np.full((*shape, 1), 7.0),
        "float32": np.full(shape, 7.0, np.float32),
        "int64": np.full(shape, 7),
        "float64": np.full(shape, 7.0, ">f8"),
        "list": np.full(shape, 7.0).tolist(),
        "writable": locked,
    }
    if len(shape) > 1:
        wrong |= {"C order": np.full(shape, 7.0, order="F"), "(1, ": np.full((1, *shape[1:]), 7.0)}
    wrong["order"] = np.full((*shape, 2), 7.0)[..., 0]
    for word, out in wrong.items():
        message = refusal(lambda out=out: public(model, spec, values, out=out))
        assert message.startswith("out ")
        assert word in message
        assert (np.asarray(out) == 7.0).all()


@pytest.mark.parametrize(("name", "into"), [("integrate", 0), ("normalize", 0), ("rnea", 1), ("rnea", 2), ("aba", 2)])
def test_an_out_that_is_an_input_is_refused_by_name(model: sd.Model, name: str, into: int) -> None:
    """An algorithm may read what it has written over."""
    spec = SPECS[name]
    for batch in ((), (3,)):
        values = random_inputs(model, spec, 0, batch)
        kept = values[into].copy()
        for out in (values[into], values[into][...]):
            message = refusal(lambda out=out, values=values: public(model, spec, values, out=out))
            assert message.startswith(f"out overlaps {sorted_inputs(spec)[into].name} in memory")
        np.testing.assert_array_equal(values[into], kept)


# --- shapes and dtypes ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TAKING)
def test_a_wrong_last_axis_is_refused_by_name_and_shape(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    for k, argument in enumerate(sorted_inputs(spec)):
        if not moves(argument):
            continue
        for batch in ((), (2,)):
            values = random_inputs(model, spec, 0, batch)
            good = values[k]
            for wrong in (good[..., :-1], np.concatenate([good, good], -1), np.array(1.0), good[..., :0]):
                values[k] = wrong
                message = refusal(lambda values=values: public(model, spec, values))
                core = ", ".join(map(str, good.shape[len(batch) :]))
                assert message == f"{argument.name} has shape {wrong.shape}, expected (..., {core})"


@pytest.mark.parametrize("name", [name for name in TAKING if len(sorted_inputs(SPECS[name])) > 1])
def test_batches_that_do_not_broadcast_are_refused_by_name_and_shape(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    names = [x.name for x in sorted_inputs(spec)]
    values = random_inputs(model, spec, 0, (3,))
    values[0] = values[0][:2]
    message = refusal(lambda: public(model, spec, values))
    assert message.startswith(f"batch shapes do not broadcast: {names[0]} (2,), {names[1]} (3,)")


@pytest.mark.parametrize("name", TAKING)
def test_what_is_no_array_of_real_numbers_is_refused_by_name(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    for k, argument in enumerate(sorted_inputs(spec)):
        values: list[Any] = random_inputs(model, spec, 0, (2,))
        good = values[k]
        wrong = {
            "complex128": good + 0j,
            "object": good.astype(object),
            "bool": good > 0.0,
            "<U": good.astype(str),
            "|S": good.astype(bytes),
            "datetime64": good.astype("datetime64[s]"),
            "ragged": [[0.0, 1.0], [0.0]],
            "dtype": {"a": 1.0},
            "<U3": "abc",
        }
        for word, value in wrong.items():
            values[k] = value
            message = refusal(lambda values=values: public(model, spec, values))
            assert message.startswith(f"{argument.name} ")
            assert word in message
            assert "expected" in message
        for value in ([], [[]], (), {}, set(), object(), [None], [1.0, "a"], np.array(None), (x for x in good), [1j]):
            values[k] = value
            assert f"{argument.name} " in refusal(lambda values=values: public(model, spec, values))


@pytest.mark.parametrize("name", slow_but(MAIN_CALLS, thinned(MAIN_CALLS, TAKING, 4)))
def test_none_is_refused_where_it_is_no_default(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    for k, argument in enumerate(sorted_inputs(spec)):
        values: list[Any] = random_inputs(model, spec)
        values[k] = None
        if argument.optional:
            assert np.isfinite(public(model, spec, values)).all()
        else:
            assert refusal(lambda values=values: public(model, spec, values)).startswith(f"{argument.name} ")


@pytest.mark.parametrize("name", SPECS)
@pytest.mark.parametrize("wrong", ["panda", None, 3, np.zeros(3)])
def test_what_is_no_model_is_refused_by_type(model: sd.Model, name: str, wrong: Any) -> None:
    spec = SPECS[name]
    values, more = random_inputs(model, spec), options(model, spec)
    message = refusal(lambda: getattr(sd, name)(wrong, *values[: len(sorted_inputs(spec))], **more), sd.ModelError)
    assert message == f"model is a {type(wrong).__name__}, expected a spatialdyn Model"


def test_forces_on_the_world_are_ignored(model: sd.Model) -> None:
    q, v, a, fext = random_inputs(model, SPECS["rnea"])
    expected = sd.rnea(model, q, v, a, fext)
    fext[0] = 1e6
    np.testing.assert_array_equal(sd.rnea(model, q, v, a, fext), expected)


# --- frames and references ------------------------------------------------------------------------------

FRAMED = [name for name, spec in SPECS.items() if "row" in {x.name for x in spec.present}]


@pytest.mark.parametrize("name", FRAMED)
def test_a_frame_is_given_by_name_or_as_itself(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    values = random_inputs(model, spec)
    for frame in model.frames:
        expected = getattr(sd, name)(model, *values, frame)
        np.testing.assert_array_equal(getattr(sd, name)(model, *values, f"{frame.kind}:{frame.name}"), expected)
        np.testing.assert_array_equal(getattr(sd, name)(model, *values, frame=frame.name), expected)  # names are unique


@pytest.mark.parametrize("name", FRAMED)
def test_an_unknown_frame_is_refused_by_name(model: sd.Model, name: str) -> None:
    values = random_inputs(model, SPECS[name])
    for wrong in ("b000", "b0003_tipp", "", "link:j0002"):
        message = refusal(lambda wrong=wrong: getattr(sd, name)(model, *values, wrong), sd.ModelError)
        assert f'frame "{wrong}" is not in robot "{model.name}"' in message
    for wrong in (3, None, ("b0001",)):
        message = refusal(lambda wrong=wrong: getattr(sd, name)(model, *values, wrong), sd.ModelError)
        assert message == f'frame is {wrong!r}, expected the name of one of robot "{model.name}"'


@pytest.mark.parametrize("name", [name for name in FRAMED if "reference" in {x.name for x in SPECS[name].present}])
def test_an_unknown_reference_is_refused_by_name(model: sd.Model, name: str) -> None:
    values = random_inputs(model, SPECS[name])
    frame = model.frames[-1]
    for wrong in ("LOCAL", "body", "", 1, None, ["local"]):
        message = refusal(lambda wrong=wrong: getattr(sd, name)(model, *values, frame, wrong), sd.SpatialDynError)
        assert message == f"reference is {wrong!r}, expected one of local, world, local_world_aligned"
    default = getattr(sd, name)(model, *values, frame)
    np.testing.assert_array_equal(getattr(sd, name)(model, *values, frame, "local"), default)
    assert abs(getattr(sd, name)(model, *values, frame, "world") - default).max() > 1e-3


# --- quaternions and (cos, sin) pairs -------------------------------------------------------------------

UNIT_PARTS = {"floating": slice(3, 7), "spherical": slice(0, 4), "continuous": slice(0, 2), "planar": slice(2, 4)}
JUDGING = [name for name, spec in SPECS.items() if any(x.unit_norm for x in spec.present)]


def unit_joints(model: sd.Model) -> list[tuple[sd.Joint, slice]]:
    """One joint of each kind with coordinates of unit norm, and where they are in q."""
    found = {}
    for joint in model.joints[1:]:
        if joint.kind in UNIT_PARTS:
            part = UNIT_PARTS[joint.kind]
            found[joint.kind] = joint, slice(joint.idx_q + part.start, joint.idx_q + part.stop)
    assert set(found) == set(UNIT_PARTS)
    return list(found.values())


@pytest.mark.parametrize("name", slow_but({*MAIN_CALLS} & {*JUDGING}, thinned({*MAIN_CALLS} & {*JUDGING}, JUDGING, 5)))
def test_a_norm_that_is_not_one_is_refused_by_joint_and_norm(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    for joint, part in unit_joints(model):
        for k, argument in enumerate(sorted_inputs(spec)):
            if not argument.unit_norm:
                continue
            for factor in (0.0, 0.5, 1.0 - 2e-6, 1.0 + 2e-6, 3.0, 1e160):
                values = random_inputs(model, spec)
                values[k][part] *= factor
                message = refusal(lambda values=values: public(model, spec, values), sd.ConfigurationError)
                assert f'for joint "{joint.name}", expected 1 within 1e-6' in message
                assert message.startswith(f"{argument.name} holds a ")
                assert ("quaternion" if part.stop - part.start == 4 else "(cos, sin) pair") in message
                norm = float(re.findall(r"norm ([\d.e+-]+)", message)[0])
                assert abs(norm - factor) < 1e-8 * max(1.0, factor)
                if factor > 0.0:  # the cure
                    values[k] = sd.normalize(model, values[k])
                    assert np.isfinite(public(model, spec, values)).all()


@pytest.mark.parametrize("name", slow_but({*MAIN_CALLS} & {*JUDGING}, thinned({*MAIN_CALLS} & {*JUDGING}, JUDGING, 6)))
def test_a_norm_within_a_millionth_of_one_passes(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    for _, part in unit_joints(model):
        for factor in (1.0 - 0.9e-6, 1.0 + 0.9e-6):
            values = random_inputs(model, spec)
            values[0][part] *= factor
            assert np.isfinite(public(model, spec, values)).all()


def test_the_first_of_the_samples_with_a_wrong_norm_is_named(model: sd.Model) -> None:
    joint, part = unit_joints(model)[1]
    q = sd.random_configuration(model, np.random.default_rng(0), (2, 4))
    q[0, 3, part] *= 1.5
    q[1, 1, part] *= 2.0
    message = refusal(lambda: sd.crba(model, q), sd.ConfigurationError)
    assert f'of norm 1.5 for joint "{joint.name}" in sample (0, 3), the first of 2, expected 1' in message
    message = refusal(lambda: sd.crba(model, q[0]), sd.ConfigurationError)
    assert f'joint "{joint.name}" in sample 3, expected 1' in message


def test_normalize_takes_any_norm_but_zero(model: sd.Model) -> None:
    q = sd.random_configuration(model, np.random.default_rng(0))
    far = q.copy()
    for _, part in unit_joints(model):
        far[part] *= 1e200
    np.testing.assert_allclose(sd.normalize(model, far), q, rtol=4 * EPS)
    for _, part in unit_joints(model):
        null = q.copy()
        null[part] = 0.0
        message = refusal(lambda null=null: sd.normalize(model, null), sd.ConfigurationError)
        assert "of norm 0" in message
        assert "is the cure" not in message  # it was what was called


# --- numbers that are not finite ------------------------------------------------------------------------


@pytest.mark.parametrize("name", slow_but(MAIN_CALLS, thinned(MAIN_CALLS, TAKING, 7)))
@pytest.mark.parametrize("which", WHICH)
def test_nan_in_a_sample_is_nan_there_and_nowhere_else(request: pytest.FixtureRequest, which: str, name: str) -> None:
    model: sd.Model = request.getfixturevalue(which)
    spec = SPECS[name]
    for k, argument in enumerate(sorted_inputs(spec)):
        values = random_inputs(model, spec, 0, (5,))
        expected = np.array([public(model, spec, at(values, s)) for s in range(5)])
        values[k][2] = np.nan
        found = public(model, spec, values)
        np.testing.assert_allclose(found[[0, 1, 3, 4]], expected[[0, 1, 3, 4]], rtol=1e-12, atol=1e-12)
        assert np.isnan(found[2]).any() != ((name, argument.name) in INDEPENDENT)
        alone = np.asarray(public(model, spec, at(values, 2)))
        np.testing.assert_array_equal(np.isnan(alone), np.isnan(found[2]))


@pytest.mark.parametrize("name", slow_but(MAIN_CALLS, thinned(MAIN_CALLS, TAKING, 8)))
@pytest.mark.parametrize("bad", [math.nan, *(pytest.param(x, marks=SLOW) for x in (math.inf, -math.inf))])
def test_one_entry_that_is_not_finite_is_no_error_and_stays_in_its_sample(
    model: sd.Model, name: str, bad: float
) -> None:
    """Whether it comes out depends on whether the answer depends on it: M does not depend on where a base stands."""
    spec = SPECS[name]
    for k, argument in enumerate(sorted_inputs(spec)):
        values = random_inputs(model, spec, 0, (3,))
        expected = public(model, spec, values)
        entry = (1,) * (1 + len(argument.shape))
        values[k][entry] = bad
        found = public(model, spec, values)
        np.testing.assert_array_equal(found[[0, 2]], expected[[0, 2]])
        public(model, spec, at(values, 1))


def test_a_result_that_overflows_is_an_error_naming_the_sample(model: sd.Model) -> None:
    q, v, a, _ = random_inputs(model, SPECS["rnea"], 0, (2, 3))
    huge = v.copy()
    huge[0, 1] = huge[1, 2] = 1e200
    message = refusal(lambda: sd.rnea(model, q, huge, a), sd.NonFiniteError)
    assert message.startswith("rnea of finite input is not finite in sample (0, 1), the first of 2, expected ")
    message = refusal(lambda: sd.rnea(model, q[0], huge[0], a[0]), sd.NonFiniteError)
    assert message.startswith("rnea of finite input is not finite in sample 1, expected ")
    message = refusal(lambda: sd.rnea(model, q[0, 1], huge[0, 1], a[0, 1]), sd.NonFiniteError)
    assert message.startswith("rnea of finite input is not finite, expected ")
    huge[0, 1, 0] = np.nan  # not finite input: no error
    huge[1, 2, 0] = np.inf
    found = sd.rnea(model, q, huge, a)
    assert np.isnan(found[0, 1]).any()
    assert not np.isfinite(found[1, 2]).all()


@pytest.mark.parametrize(
    "name", slow_but(MAIN_CALLS, [name for name in TAKING if "v" in {x.name for x in SPECS[name].present}])
)
def test_finite_input_gives_finite_output_or_an_error(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    for size in (1e100, 1e160, 1.7e308):
        values = random_inputs(model, spec)
        values[[x.name for x in sorted_inputs(spec)].index("v")][:] = size
        try:
            found = public(model, spec, values)
        except (sd.NonFiniteError, sd.ConfigurationError):
            continue
        assert np.isfinite(found).all()


# --- joints with zero articulated inertia ---------------------------------------------------------------


def chain(*bodies: tuple[str, Any, float], offset: Any = None, **more: Any) -> sd.Model:
    """A chain of joints (kind, axis) with point-like bodies of given masses, one on the other."""
    builder = sd.ModelBuilder("chain")
    for k, (kind, axis, mass) in enumerate(bodies):
        inertia = (mass, (0.0, 0.0, 0.0), mass * np.diag([0.1, 0.2, 0.15]))
        builder.add_body(f"b{k}", f"b{k - 1}" if k else None, kind, axis, offset, inertia, f"j{k}", **more)
    return builder.build()


X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
SINGULAR = {
    "leaf": (chain(("revolute", Z, 1.0), ("revolute", Y, 1.0), ("revolute", Z, 0.0), offset=(0.1, 0.2, 0.3)), "j2"),
    "only": (chain(("prismatic", X, 0.0)), "j0"),
    "coaxial": (chain(("revolute", Z, 0.0), ("revolute", Z, 1.0)), "j0"),
    "coaxial slider": (chain(("revolute", Y, 1.0), ("prismatic", X, 0.0), ("prismatic", X, 2.0)), "j1"),
    "next to nothing": (chain(("prismatic", X, 1e-17), ("prismatic", X, 1.0)), "j0"),
    "next to a mountain": (chain(("prismatic", X, 1.0), ("prismatic", X, 1e17)), "j0"),
    "spherical": (chain(("revolute", Z, 1.0), ("spherical", Z, 0.0)), "j1"),
    "floating": (chain(("floating", Z, 0.0)), "j0"),
    "point mass": (
        sd.ModelBuilder().add_body("b", axis=Z, inertia=(1.0, (0, 0, 1), np.zeros((3, 3))), joint_name="j").build(),
        "j",
    ),
}


@pytest.mark.parametrize(
    ("name", "case"),
    slow_but(
        [("aba", case) for case in SINGULAR],
        [(name, case) for name in PIVOTING for case in SINGULAR],
    ),
)
def test_a_joint_of_zero_articulated_inertia_is_named(name: str, case: str) -> None:
    model, joint = SINGULAR[case]
    spec = SPECS[name]
    if name == "aba_square_root" and case.startswith("next to"):
        assert np.isfinite(public(model, spec, random_inputs(model, spec))).all()
        return  # it forms no sums of inertias, so it can tell: see test_forward
    for batch in ((), (3,)):
        values = random_inputs(model, spec, 0, batch)
        message = refusal(lambda values=values: public(model, spec, values), sd.InertiaError)
        assert message.startswith(f'joint "{joint}" has zero articulated inertia')
        assert ("in sample 0, the first of 3" in message) == bool(batch)


@pytest.mark.parametrize("case", SINGULAR)
def test_rnea_and_crba_are_finite_at_zero_articulated_inertia(case: str) -> None:
    model, _ = SINGULAR[case]
    q, v, a, fext = random_inputs(model, SPECS["rnea"])
    M = sd.crba(model, q)
    assert np.isfinite(M).all()
    assert np.linalg.matrix_rank(M) < model.nv
    expected = M @ a + sd.nonlinear_effects(model, q, v)
    np.testing.assert_allclose(sd.rnea(model, q, v, a), expected, rtol=1e-12, atol=1e-12)
    assert np.isfinite(sd.rnea(model, q, v, a, fext)).all()


def test_a_gimbal_is_singular_where_its_axes_meet_and_nowhere_else() -> None:
    """Massless rings: the outer joint loses its inertia at q1 = 0, in that sample only."""
    model = chain(("revolute", Z, 0.0), ("revolute", Y, 0.0), ("revolute", Z, 1.0))
    q = np.array([[0.1, 0.5, 0.2], [0.1, -0.4, 0.3], [0.3, 0.0, 0.7], [0.0, 1e-3, 0.0], [1.0, 0.0, 2.0]])
    sound = [0, 1, 3]
    v, tau = np.ones((2, 5, 3))
    for call, more in ((sd.aba, (v, tau)), (sd.minverse, ())):
        message = refusal(lambda call=call, more=more: call(model, q, *more), sd.InertiaError)
        assert message.startswith('joint "j0" has zero articulated inertia in sample 2, the first of 2')
        assert np.isfinite(call(model, q[sound], *(x[sound] for x in more))).all()
    np.testing.assert_allclose(sd.crba(model, q[sound]) @ sd.minverse(model, q[sound]), [np.eye(3)] * 3, atol=1e-8)


def test_a_singular_sample_with_nan_is_nan_and_no_error() -> None:
    model, _ = SINGULAR["leaf"]
    q, v, tau = np.zeros((3, 3))
    v[0] = np.nan
    assert np.isnan(sd.aba(model, q, v, tau)).any()
    assert np.isnan(sd.minverse(model, [np.nan, 0.0, 0.0])).any()


@pytest.mark.parametrize(
    "masses",
    [(1e-12, 1.0), (1.0, 1e-12), (1e-12, 1e-12), (1e12, 1.0), (1e-100, 1e-100), (1e100, 1e88)],
)
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_light_bodies_are_bodies(kind: str, masses: tuple[float, float]) -> None:
    """No absolute tolerance: a millionth of a microgram next to a kilogram, coaxial, is still inverted."""
    model = chain((kind, X, masses[0]), (kind, X, masses[1]))
    unit = [m * (0.1 if kind == "revolute" else 1.0) for m in masses]  # τ of a = (1, 0), then only the first feels it
    q, v = [0.3, -0.2], [0.0, 0.0]
    model = model.with_(gravity=(0.0, 0.0, 0.0))
    a = sd.aba(model, q, v, [unit[0], 0.0])
    np.testing.assert_allclose(a, [1.0, -1.0], rtol=1e-3)
    assert np.isfinite(sd.minverse(model, q)).all()


def test_joints_far_away_raise_no_alarm() -> None:
    """The bound that kernels look at grows with travel; the composite inertia about the axis does not."""
    model = chain(("revolute", Z, 1.0), ("prismatic", Z, 1.0), ("revolute", Z, 1.0))
    q, zero = np.array([0.1, 1e12, 0.2]), np.zeros(3)
    expected = sd.aba(model, [0.1, 0.0, 0.2], zero, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(sd.aba(model, q, zero, [1.0, 2.0, 3.0]), expected, rtol=1e-12)
    np.testing.assert_allclose(sd.aba(model, [q] * 2, zero, [1.0, 2.0, 3.0]), [expected] * 2, rtol=1e-12)


def test_armature_is_inertia_enough() -> None:
    for kind in ("revolute", "prismatic"):
        model = chain((kind, Z, 0.0), armature=0.25)
        np.testing.assert_array_equal(sd.aba(model, [0.3], [2.0], [1.0]), [4.0])
        np.testing.assert_array_equal(sd.minverse(model, [0.3]), [[4.0]])


def test_mimic_joints_of_zero_inertia_are_named_too() -> None:
    for masses, refused in (((0.0, 0.0), True), ((0.0, 1.0), False), ((1.0, 0.0), False)):
        builder = sd.ModelBuilder("pair")
        builder.add_body("b0", axis=Y, inertia=(masses[0], (1, 0, 0), masses[0] * SOLID), joint_name="lead")
        builder.add_body(
            "b1", axis=Y, inertia=(masses[1], (1, 0, 0), masses[1] * SOLID), joint_name="follow",
            mimic={"leader": "lead", "multiplier": 2.0, "offset": 0.0},
        )  # fmt: skip
        model = builder.build(mimic=True)
        for call, more in ((sd.aba, ([0.2], [0.3])), (sd.minverse, ())):
            if refused:
                message = refusal(lambda call=call, more=more, model=model: call(model, [0.1], *more), sd.InertiaError)
                assert message.startswith('joint "lead" has zero articulated inertia')
            else:
                assert np.isfinite(call(model, [0.1], *more)).all()


def test_a_nan_beside_it_hides_no_singular_sample_of_a_model_with_followers() -> None:
    builder = sd.ModelBuilder("pair").add_body("b0", axis=Y, joint_name="lead")
    builder.add_body("b1", axis=Y, mimic={"leader": "lead", "multiplier": 2.0, "offset": 0.0})
    model = builder.build(mimic=True)
    refusal(lambda: sd.aba(model, [[np.nan], [0.1]], [[0.0]] * 2, [[1.0]] * 2), sd.InertiaError)
    refusal(lambda: sd.minverse(model, [[np.nan], [0.1]]), sd.InertiaError)


@pytest.mark.parametrize("name", ["rnea", "aba", "generalized_gravity", "minverse"])
def test_a_follower_driven_out_of_range_is_an_error_and_no_warning(gripper: sd.Model, name: str) -> None:
    """Its coordinate is finite input times a multiplier: an infinite one comes of no infinite input."""
    spec = SPECS[name]
    values = random_inputs(gripper, numba_kernels.variant(spec, frozenset()), 0, (2,))
    values[0][1, -1] = 1.7e308
    message = refusal(lambda: public(gripper, numba_kernels.variant(spec, frozenset()), values), sd.NonFiniteError)
    assert "of finite input is not finite in sample 1, expected" in message
    values[0][1, -1] = np.inf
    assert np.isfinite(public(gripper, numba_kernels.variant(spec, frozenset()), values)[0]).all()


# --- byte orders, frames of other models, tables, payloads ------------------------------------------------------------


def test_foreign_byte_order_is_converted_whatever_came_before() -> None:
    """Numba's fingerprint of an array leaves out its byte order: argument checks must not."""
    model = sd.load_urdf("two_link")
    q, z = np.array([0.3, -0.4]), np.zeros(2)
    expected = sd.rnea(model, q, z, z)
    for native in (np.frombuffer(q.tobytes()), np.zeros(17, np.uint8)[1:].view(float)):
        sd.rnea(model, native, z, z)
    swapped = np.frombuffer(q.astype(">f8").tobytes(), ">f8")
    assert (sd.rnea(model, swapped, z, z) == expected).all()
    assert (sd.rnea(model, q.astype(">f8"), z.astype(">f8"), z) == expected).all()
    with pytest.raises(sd.ShapeError, match=">f8"):
        sd.rnea(model, q, z, z, out=np.zeros(2, ">f8"))


def test_a_frame_of_another_model_is_looked_up_by_name() -> None:
    model = sd.load_urdf("two_link")
    frame = model.frame("tip")
    reduced = model.reduced(lock={"joint1": 0.5})
    q = np.array([0.3])
    assert (sd.frame_placement(reduced, q, frame) == sd.frame_placement(reduced, q, "tip")).all()


def test_the_table_cannot_be_made_writable() -> None:
    model = sd.load_urdf("two_link")
    with pytest.raises(ValueError, match="WRITEABLE"):
        model.bodies.flags.writeable = True
    with pytest.raises(AttributeError, match="immutable"):
        model.__init__(model.robot, model.options)


def test_a_payload_that_is_no_body_is_refused() -> None:
    model = sd.load_urdf("two_link")
    with pytest.raises(sd.InertiaError, match='payload of frame "tip"'):
        model.with_(payload={"tip": (1.0, (0, 0, 0), np.diag([1.0, 1.0, 30.0]))})


@pytest.mark.parametrize(
    "wrong",
    [{"axis": "z"}, {"placement": "x"}, {"limits": None}, {"limits": (1,)}, {"mimic": "y"}, {"armature": "a"},
     {"placement": ((1, 2, 3), (0, 0))}, {"inertia": (1, (0, 0, 0), 1j * np.eye(3))}],
    ids=str,
)  # fmt: skip
def test_a_builder_refuses_what_is_no_number_by_name(wrong: dict[str, Any]) -> None:
    with pytest.raises(sd.SpatialDynError, match="hand"):
        sd.ModelBuilder("arm").add_body("hand", **wrong)


# --- calls that take more than arrays -------------------------------------------------------------------------------

LONG = np.longdouble("1e4000")  # infinite where there is no such number
FOREIGN: dict[str, Any] = {
    "none": None, "whole": 3, "minus": -1, "nought": 0, "huge": 10**400, "word": "x", "bytes": b"x", "list": [],
    "mapping": {}, "nan": math.nan, "inf": math.inf, "object": object(), "float32": np.float32(1), "int64": np.int64(1),
    "true": True, "numpy true": np.True_, "complex": 1j, "function": len, "nested": [[3]], "array": np.array(1.0),
    "of complex": np.zeros(2, complex), "of objects": np.zeros(2, object), "of words": np.array(["a", "b"]),
    "of bools": np.zeros(2, bool), "of dates": np.zeros(2, "M8[s]"), "huge ones": [10**400, 1],
    "several": np.ones((3, 1, 7)), "type": int, "masked": np.ma.masked_array([0.1, 0.2], [0, 1]),
    "a masked number": np.ma.masked_array(0.1, True), "masked in a list": [0.1, np.ma.masked],
    "a list of masked": [np.ma.masked_array([0.1, 0.2], [0, 1])], "a tuple": (np.zeros(2), np.zeros(3)),
    **({"long": np.array([LONG, 0]), "a long number": LONG} if np.isfinite(LONG) else {}),
}  # fmt: skip
COUNTS = ("whole", "int64")
NUMBERS = ("whole", "float32", "int64")
TRADED: dict[str, tuple[str, ...]] = {
    "task": (), "states": ("none", *COUNTS), "batch": ("none", *COUNTS), "duration": NUMBERS, "methods": ("none",)
}  # fmt: skip
REST = [0.0, 0.0]
# What each call is given otherwise, and for each of its arguments what of FOREIGN it takes.
ROOMS: dict[str, tuple[Callable[..., Any], dict[str, Any], dict[str, tuple[str, ...]]]] = {
    "trade": (sd.trade, {}, TRADED),
    "trade simulate": (sd.trade, {"task": "simulate"}, TRADED),
    "recommend": (sd.recommend, {}, {**TRADED, "tolerance": (*NUMBERS, "huge", "inf", "a long number")}),
    "simplify": (
        sd.simplify, {},
        {"lock": ("none", "list", "mapping"), "merge_lighter_than": (*NUMBERS, "nought"), "drop": ("list", "mapping")},
    ),
    "diagnose": (sd.diagnose, {}, {"q": ("none",)}),
    "exact": (
        sd.exact, {"call": sd.aba},
        {"call": (), "bits": ("none",), "frame": ("none",), "reference": (), "classical": ()},
    ),
    "exact of a frame": (
        sd.exact, {"call": sd.frame_acceleration, "frame": "tip"},
        {"bits": ("none",), "frame": (), "reference": (), "classical": ("true", "numpy true")},
    ),
    "forward_dynamics": (
        sd.forward_dynamics, {"q": REST, "v": REST, "tau": REST},
        {"q": (), "v": (), "tau": (), "fext": ("none",), "method": (), "out": ("none",)},
    ),
    "simulate": (
        sd.simulate, {"q0": REST, "v0": REST, "duration": 1.0, "dt": 0.1},
        {"q0": (), "v0": (), "duration": (*NUMBERS, "nought"), "dt": NUMBERS, "method": ("none",), "rtol": NUMBERS,
         "atol": NUMBERS, "record": ("none", *COUNTS, "huge"), "fext": ("none",)},
    ),
    "scene": (
        sd.Scene, {},
        {"constraints": ("none",), "stabilization": ("none",), "contacts": ("none",),
         "friction": ("none", "true", "numpy true"), "friction_method": (), "limits": ("true", "numpy true"),
         "motor": ("none",), "drive": (), "fext": ("none",)},
    ),
    "friction_torque": (
        sd.friction_torque, {"v": REST, "friction": True},
        {"v": (), "friction": ("true", "numpy true"), "out": ("none",)},
    ),
    "friction": (
        sd.Friction.of, {},
        {name: (*NUMBERS, *(("nought",) if name in ("coulomb", "viscous", "bristle_stiffness") else ()), "array",
                *(("none",) if name not in ("coulomb", "viscous") else ()),
                *(("nought",) if name in ("static", "bristle_damping") else ()),
                *(("mapping",) if name not in ("stribeck_velocity", "smoothing") else ()))
         for name in ("coulomb", "viscous", "static", "stribeck_velocity", "smoothing", "bristle_stiffness",
                      "bristle_damping")},
    ),
    "torque_limits": (
        sd.torque_limits, {"v": REST, "motor": sd.Motor([0.1, 0.1], 1.0, 24.0)}, {"v": (), "motor": ()},
    ),
    "rollout": (
        sd.rollout, {"q0": REST, "v0": REST, "dt": 0.1, "steps": 2},
        {"q0": (), "v0": (), "tau": ("none",), "dt": (*NUMBERS, "array"), "steps": ("array", *NUMBERS, "nought"),
         "method": ("none",), "control": ("none",), "states": ("none", "mapping"),
         "record": ("none", *COUNTS, "huge"), "cost": ("none",), "dtype": (), "check": ("true", "numpy true")},
    ),
    "constrained_dynamics": (
        sd.constrained_dynamics, {"q": REST, "v": REST, "tau": REST, "J": np.eye(2), "drift": REST},
        {"q": (), "v": (), "tau": (), "J": (), "drift": (), "damping": (*NUMBERS, "nought")},
    ),
    "impact": (
        sd.impact, {"q": REST, "v": REST, "J": np.eye(2)},
        {"q": (), "v": (), "J": (), "restitution": ("nought", "float32", "int64"), "damping": (*NUMBERS, "nought")},
    ),
    "specialize": (
        sd.specialize, {"calls": sd.rnea},
        {"calls": (), "dtype": ("none",), "fixed": ("none", "mapping"), "inputs": ("list", "mapping"),
         "outputs": ("none", "nought"), "frame": ("none",), "reference": (), "classical": ()},
    ),
    "step": (
        sd.step, {"q": REST, "v": REST, "tau": REST, "dt": 0.1},
        {"q": (), "v": (), "tau": (), "dt": (*NUMBERS, "minus", "nought", "array", "list", "nested", "several"),
         "method": (), "fext": ("none",)},
    ),
    "wrench_at": (
        sd.wrench_at, {"q": REST, "frame": "tip", "force": np.zeros(6)},
        {"q": (), "frame": (), "force": (), "reference": ()},
    ),
    "random_configuration": (
        sd.random_configuration, {"rng": np.random.default_rng(0)},
        {
            "rng": ("none", "whole", "nought", "huge", "int64"),
            "shape": ("whole", "nought", "list", "mapping", "int64", "true", "numpy true", "of objects")
        },
    ),
    "frame_acceleration": (
        sd.frame_acceleration, {"q": REST, "v": REST, "a": REST, "frame": "tip"},
        {"q": (), "v": (), "a": (), "frame": (), "reference": (), "classical": ("true", "numpy true"),
         "out": ("none",)},
    ),
    "hamilton_equations": (
        sd.hamilton_equations, {"q": REST, "p": REST},
        {"q": (), "p": (), "tau": ("none",), "fext": ("none",)},
    ),
    "to_mujoco": (sd.to_mujoco, {"q": REST, "v": REST}, {"q": (), "v": (), "joints": ("none",)}),
    "from_drake": (sd.from_drake, {"q": REST, "v": REST}, {"q": (), "v": (), "joints": ("none",)}),
}  # fmt: skip


@pytest.mark.parametrize(("room", "name"), [(room, x) for room, (_, _, taken) in ROOMS.items() for x in taken])
def test_what_an_argument_cannot_be_is_refused_by_an_error_of_ours(room: str, name: str) -> None:
    call, given, taken = ROOMS[room]
    arm = sd.load_urdf("two_link")
    for label, value in FOREIGN.items():
        if label in taken[name]:
            continue
        with pytest.raises(sd.SpatialDynError) as caught:
            call(arm, **{**given, name: value})
        assert len(str(caught.value)) > 15, label


@pytest.mark.parametrize("room", ROOMS)
def test_every_room_refuses_what_is_no_model(room: str) -> None:
    call, given, _ = ROOMS[room]
    for value in FOREIGN.values():
        with pytest.raises(sd.ModelError, match="expected a spatialdyn Model"):
            call(value, **given)


# Calls that make a model, and for each of their arguments what of FOREIGN they take.
MAKERS: dict[str, tuple[Callable[..., Any], dict[str, Any], dict[str, tuple[str, ...]]]] = {
    "assemble": (
        sd.assemble, {"robot": sd.load_urdf("two_link").robot},
        {"robot": (), "root": (), "gravity": (), "continuous": (), "mimic": ("nought", "true", "numpy true")},
    ),
    "load_urdf": (
        sd.load_urdf, {"source": "two_link"},
        {"source": (), "root": (), "gravity": (), "continuous": (), "mimic": ("nought", "true", "numpy true"),
         "inertia": (), "snap": ("none", "nought")},
    ),
    "add_body": (
        lambda **given: sd.ModelBuilder("arm").add_body(**given), {"name": "hand"},
        {"name": ("word",), "parent": ("none",), "joint": (), "axis": (), "placement": ("none",),
         "inertia": ("none",), "joint_name": ("none", "word"), "limits": (), "mimic": ("none",)},
    ),
    "with_": (
        sd.load_urdf("two_link").with_, {},
        {"gravity": ("none",), "armature": ("none", "mapping"), "payload": ("none", "mapping")},
    ),
    "reduced": (sd.load_urdf("two_link").reduced, {}, {"lock": ("none", "list", "mapping")}),
}  # fmt: skip


@pytest.mark.parametrize(("maker", "name"), [(maker, x) for maker, (_, _, taken) in MAKERS.items() for x in taken])
def test_what_an_option_cannot_be_is_refused_by_an_error_of_ours(maker: str, name: str) -> None:
    make, given, taken = MAKERS[maker]
    for label, value in FOREIGN.items():
        if label in taken[name]:
            continue
        with pytest.raises(sd.SpatialDynError) as caught:
            make(**{**given, name: value})
        assert len(str(caught.value)) > 15, label


# --- arrays that are not what they look like ------------------------------------------------------------------------


def masks(shape: tuple[int, ...]) -> list[Any]:
    """Arrays of that shape with a mask, which NumPy drops on the way to plain ones."""
    whole = np.ma.masked_array(np.zeros(shape), np.ones(shape))
    return [whole, np.ma.masked_array(np.zeros(shape)), list(whole), tuple(whole), [np.ma.masked] * shape[0]]


@pytest.mark.parametrize("name", TAKING)
def test_a_masked_array_is_refused_by_name(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    for k, argument in enumerate(sorted_inputs(spec)):
        for batch in ((), (2,)):
            values: list[Any] = random_inputs(model, spec, 0, batch)
            for value in masks(np.shape(values[k]) or (1,)):
                values[k] = value
                message = refusal(lambda values=values: public(model, spec, values))
                assert message == f"{argument.name} is masked, expected an array without a mask, which would be lost"


@pytest.mark.parametrize("shape", [(7,), (3, 7)])
def test_an_array_that_is_not_in_memory_is_refused_by_name(model: sd.Model, shape: tuple[int, ...]) -> None:
    """NumPy would compute the one without a word, and fetch the other."""
    lazy = pytest.importorskip("dask.array").zeros(shape)

    class OnGpu:
        __cuda_array_interface__: ClassVar[Any] = {"shape": shape, "typestr": "<f8", "data": (0, False), "version": 3}
        ndim = len(shape)

        def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
            raise AssertionError("fetched")

    zero = np.zeros(shape)
    for given, said in ((lazy, "v is a Dask Array, expected an array in memory"), (OnGpu(), "v is a OnGpu on a GPU")):
        with pytest.raises(sd.ShapeError, match=said):
            sd.rnea(model, zero, given, zero)
        with pytest.raises(sd.ShapeError, match=said.replace("v is", "q is")):
            sd.specialize(model, sd.rnea)(given, zero, zero)


def test_a_masked_out_is_refused() -> None:
    arm = sd.load_urdf("two_link")
    program = sd.specialize(arm, sd.rnea)
    for run in (lambda **out: sd.rnea(arm, REST, REST, REST, **out), lambda **out: program(REST, REST, REST, **out)):
        for _ in range(2):
            assert "out is " in refusal(lambda run=run: run(out=np.ma.masked_array([0.0, 0.0], [0, 1])))


def test_a_program_refuses_masked_arrays_too() -> None:
    program = sd.specialize(sd.load_urdf("two_link"), sd.rnea)
    for value in masks((2,)):
        for _ in range(2):
            assert "a is masked" in refusal(lambda value=value: program(REST, REST, value))
    still = np.zeros(2)
    for warm in (False, True):  # the fast path of plain arrays, before it is compiled and after
        for value in masks((2,))[:2]:
            assert "q is masked" in refusal(lambda value=value: program(value, still, still))
            assert "out is" in refusal(lambda value=value: program(still, still, still, out=value))
        assert warm or np.isfinite(program(still, still, still)).all()
    with pytest.raises(sd.ShapeError, match="v is masked"):
        sd.exact(sd.load_urdf("two_link"), sd.rnea)(REST, masks((2,))[0], REST)


@pytest.mark.skipif(not np.isfinite(LONG), reason="a long double is a double")
@pytest.mark.parametrize("name", TAKING)
def test_numbers_beyond_float64_are_refused_by_name(model: sd.Model, name: str) -> None:
    spec = SPECS[name]
    for k, argument in enumerate(sorted_inputs(spec)):
        values: list[Any] = random_inputs(model, spec)
        values[k] = np.array(values[k], np.longdouble)
        values[k][...] = -LONG
        message = refusal(lambda values=values: public(model, spec, values), sd.NonFiniteError)
        assert message == f"{argument.name} holds 1e+4000, expected the range of float64"


@pytest.mark.parametrize("name", [name for name in TAKING if len(SPECS[name].present) > 1])
def test_none_in_a_batch_for_lanes_is_refused_by_name(name: str) -> None:
    """A batch of a size that goes straight to its program."""
    arm, spec = sd.load_urdf("two_link"), SPECS[name]
    for k, argument in enumerate(sorted_inputs(spec)):
        if not argument.optional:
            values: list[Any] = random_inputs(arm, spec, 0, (512,))
            values[k] = None
            assert refusal(lambda values=values: public(arm, spec, values)).startswith(f"{argument.name} ")


def test_what_drives_constraints_broadcasts_or_is_refused_by_name() -> None:
    arm, J = sd.load_urdf("two_link"), np.eye(2)[:1]
    for tau in ([], np.zeros((3, 2)), np.zeros(3)):
        assert "tau" in refusal(lambda tau=tau: sd.constrained_dynamics(arm, np.zeros((2, 2)), REST, tau, J, [0.0]))
    assert "q (), v (2,), J (3,)" in refusal(lambda: sd.impact(arm, REST, np.zeros((2, 2)), np.zeros((3, 1, 2))))


def test_a_model_without_freedom_stands_still() -> None:
    post, none = sd.ModelBuilder("post").build(), np.zeros(0)
    for batch in ((), (3,)):
        found = sd.rollout(post, np.zeros((*batch, 0)), np.zeros((*batch, 0)), dt=0.1, steps=4)
        assert [x.shape for x in found] == [(*batch, 4, 0)] * 2
        found = sd.rollout(post, np.zeros((*batch, 0)), np.zeros((*batch, 0)), np.zeros((4, 0)), dt=0.1)
        assert [x.shape for x in found] == [(*batch, 4, 0)] * 2
        q, J = np.zeros((*batch, 0)), np.zeros((*batch, 0, 0))
        assert [x.shape for x in sd.impact(post, q, q, J)] == [(*batch, 0)] * 2
        assert [x.shape for x in sd.constrained_dynamics(post, q, q, q, J, q)] == [(*batch, 0)] * 2
    for call in (
        lambda: sd.impact(post, none, none, np.zeros((2, 0))),
        lambda: sd.constrained_dynamics(post, none, none, none, np.zeros((2, 0)), np.zeros(2)),
    ):
        assert "J has rank 0, expected its 2 rows to be independent" in refusal(call, sd.ConstraintError)
    assert (sd.impact(post, none, none, np.zeros((2, 0)), damping=0.1).impulse == 0.0).all()
