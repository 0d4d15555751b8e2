"""Batches of models with mimic joints by the table kernels of the whole tree: right, and with the bits of a sample."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from inputs import no_programs_of_rows, public, random_inputs
from slow import slow_but
from test_mimic_rows import CLOSE, claw, wanted

import spatialdyn as sd
from spatialdyn.engines import mimic_batches
from spatialdyn.engines.compiled import lane_batches, lane_names, numba_kernels
from spatialdyn.recursions import REDUCTION, SPECS

QUICK = ("rnea", "crba", "aba")
COUNT = 13  # samples: no multiple of a width
PLAIN = 1e-12  # of the largest entry: plain Python takes the same sums without fused multiply-add


@pytest.fixture(autouse=True)
def no_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    no_programs_of_rows(monkeypatch)


def batch(name: str, model: sd.Model, count: int = COUNT) -> tuple[list[Any], Any]:
    """Random inputs of a call, and its results."""
    values = random_inputs(model, SPECS[name], 3, (count,))
    return values, np.asarray(public(model, SPECS[name], values))


@pytest.mark.parametrize("name", slow_but(QUICK, [x for x in SPECS if SPECS[x].inputs]))
def test_each_call_is_that_of_the_whole_tree_and_of_plain_python(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model, free = claw(True), claw(True, mimic=False)
    values, found = batch(name, model)
    for k in range(COUNT):
        np.testing.assert_array_equal(public(model, SPECS[name], [x[k] for x in values]), found[k])
    few = [0, COUNT - 1]
    for k in few:
        right = wanted(model, free, name, [x[k] for x in values])
        assert abs(found[k] - right).max(initial=0.0) <= CLOSE * max(abs(right).max(initial=0.0), 1e-300)
    monkeypatch.setattr(mimic_batches, "fits", lambda spec: False)
    plain = np.asarray(public(model, SPECS[name], [x[few] for x in values]))
    scale = abs(plain).max(initial=1e-300)
    assert abs(plain - found[few]).max(initial=0.0) <= (PLAIN if SPECS[name].through_M is None else CLOSE) * scale


@pytest.mark.skipif(numba_kernels.PLAIN or not lane_names.fits(SPECS["crba"]), reason="no lanes here")
@pytest.mark.slow(quick="test_each_call_is_that_of_the_whole_tree_and_of_plain_python")
@pytest.mark.parametrize("name", ["rnea", "aba", "crba", "minverse", "frame_jacobian", "hamilton_field"])
def test_lanes_have_the_bits_of_one_sample(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model, made = claw(False), []
    _, found = batch(name, model)
    monkeypatch.setattr(lane_batches.LaneBatches, "compile_seconds", 0.0)
    lane_batches._batches.cache_clear()
    np.testing.assert_array_equal(batch(name, model)[1], found)
    reduced = mimic_batches.reduced(model)
    assert reduced is not None
    values = {"row": model.nv, "placement": np.eye(4), "reference": 0}
    static = tuple(values[x.name] for x in SPECS[name].present if x.static)
    spec = numba_kernels.variant(SPECS[name], {"fext"} & {x.name for x in SPECS[name].present})
    reduced.visit(made.append, spec, static)
    assert all(lane_batches.batches(x).is_made for x in made)
    assert made


def test_a_big_angle_a_nan_and_a_singular_pose_have_their_own_answers() -> None:
    model = claw(False)
    values, right = batch("rnea", model)
    turned = model.joint("m").idx_q
    values[0][2, turned] = np.nan
    values[0][4, turned] += 1e9
    found = np.asarray(public(model, SPECS["rnea"], values))
    assert np.isnan(found[2]).any()
    np.testing.assert_array_equal(np.delete(found, [2, 4], 0), np.delete(right, [2, 4], 0))
    assert np.isfinite(found[4]).all()
    builder = sd.ModelBuilder("x").add_body("a", None, "prismatic", axis=(1, 0, 0), joint_name="out")
    builder.add_body("b", "a", axis=(0, 0, 1), joint_name="turn", armature=1.0)
    mass, follow = (1.0, (0.0, 0.0, 0.0), np.zeros((3, 3))), {"leader": "out", "multiplier": 1.0}
    builder.add_body("c", "b", "prismatic", axis=(1, 0, 0), inertia=mass, joint_name="again", mimic=follow)
    slider = builder.build(mimic=True)
    q = np.zeros((4, 2))
    q[2:, slider.joint("turn").idx_q] = np.pi
    with pytest.raises(sd.InertiaError, match="singular in sample 2, the first of 2"):
        sd.aba(slider, q, 0.0 * q, 0.0 * q)


def test_a_quaternion_off_its_norm_is_named() -> None:
    model = claw(False)
    q = np.tile(np.asarray(sd.neutral(model)), (3, 1))
    q[1, :4] *= 1.1
    for call in (sd.rnea, sd.aba):
        with pytest.raises(sd.ConfigurationError, match='for joint "s" in sample 1'):
            call(model, q, np.zeros(model.nv), np.zeros(model.nv))


def test_a_call_through_the_mass_matrix_runs_its_kernels() -> None:
    model, seen = claw(False), []
    reduced = mimic_batches.reduced(model)
    assert reduced is not None
    reduced.visit(seen.append, numba_kernels.variant(SPECS["aba"], ()), ())
    crba, rnea = SPECS[REDUCTION.mass_matrix], numba_kernels.variant(SPECS["rnea"], ("v", "a"))
    assert seen == [crba, REDUCTION.factored, rnea, REDUCTION.solved]


def test_samples_with_gravity_of_their_own_are_those_of_edited_models_and_leave_the_model_its_own() -> None:
    model, count = claw(False), 3
    gravity = np.random.default_rng(4).normal(size=(count, 3))
    values, _ = batch("rnea", model, count)
    q, v, a = values[:3]
    right = np.asarray(sd.rnea(model, q, v, a))
    found = np.asarray(sd.specialize(model, sd.rnea, inputs="gravity")(q, v, a, gravity))
    for k in range(count):
        np.testing.assert_array_equal(found[k], sd.rnea(model.with_(gravity=gravity[k]), q[k], v[k], a[k]))
    np.testing.assert_array_equal(sd.rnea(model, q, v, a), right)
