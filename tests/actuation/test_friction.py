"""Friction's coefficients are checked by joint and compared by content; its torque is the formula's."""

from __future__ import annotations

import pickle
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from trees import random_tree

import spatialdyn as sd
from spatialdyn.urdf.load import example_robots


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    return sd.load_urdf("two_link")


def test_the_urdfs_damping_and_friction_are_of_the_model() -> None:
    model = sd.load_urdf("tree")
    found = sd.Friction.of(model)
    np.testing.assert_array_equal(found.coulomb, model.friction)
    np.testing.assert_array_equal(found.viscous, model.damping)
    np.testing.assert_array_equal(found.static, model.friction)
    assert found.viscous.any()
    assert found.stribeck_velocity is None


@pytest.mark.skipif(not example_robots(), reason="robots of example-robot-data")
def test_a_floating_base_has_no_friction() -> None:
    found = sd.Friction.of(sd.load_urdf("talos_full", root="floating"))
    assert not found.coulomb[:6].any()
    assert found.viscous[6:].any()


def test_it_is_read_only_hashed_and_compared_by_content(arm: sd.Model) -> None:
    one = sd.Friction([1.0, 2.0], 0.0, smoothing=0.1)
    other = sd.Friction(np.array([1, 2]), [-0.0, 0.0], [1.0, 2.0], smoothing=[0.1, 0.1])
    assert one == other
    assert hash(one) == hash(other)
    assert pickle.loads(pickle.dumps(one)) == one
    assert one != sd.Friction([1.0, 2.0], 0.0, stribeck_velocity=0.1)  # the same numbers under another name
    assert one != sd.Friction([1.0, 2.5], 0.0, smoothing=0.1)
    with pytest.raises(ValueError, match="read-only"):
        one.coulomb[0] = 3.0
    given = np.array([1.0, 2.0])
    made = sd.Friction(given, 0.0)
    given[0] = 9.0
    assert made.coulomb[0] == 1.0
    assert "coulomb [1., 2.]" in repr(made)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"coulomb": [1.0, -1.0]}, '"joint2": coulomb is -1, expected a finite number of 0 or more'),
        ({"viscous": [np.nan, 0.0]}, '"joint1": viscous is nan'),
        ({"viscous": [np.inf, 0.0]}, '"joint1": viscous is inf'),
        ({"static": {"joint1": 1.0, "joint2": 0.5}}, '"joint2": static is 0.5, expected at least its Coulomb frict'),
        ({"stribeck_velocity": [0.0, 1.0]}, '"joint1": stribeck velocity is 0, expected a finite number above 0'),
        ({"smoothing": [1.0, -2.0]}, '"joint2": smoothing is -2, expected a finite number above 0'),
        ({"bristle_stiffness": {"joint1": -1.0}}, '"joint1": bristle stiffness is -1'),
        ({"bristle_damping": [-1.0, 0.0]}, '"joint1": bristle damping is -1'),
        ({"viscous": {"elbow": 1.0}}, 'joint "elbow"'),
        ({"smoothing": {"joint2": 1.0}}, 'no smoothing of joint "joint1", expected one of every joint, or one number'),
    ],
)
def test_bad_coefficients_are_named_by_joint(arm: sd.Model, changes: dict[str, Any], words: str) -> None:
    given = {"coulomb": [1.0, 1.0], "viscous": 0.0, **changes}
    with pytest.raises(sd.ModelError, match=words):
        sd.Friction.of(arm, **given)


@pytest.mark.parametrize("name", [x.name for x in fields(sd.Friction)])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf, [0.5, -0.1], {"joint1": -2.0}, {"joint1": np.nan}, {3: 1.0}])
def test_bad_coefficients_are_refused_when_made(name: str, value: Any) -> None:
    with pytest.raises(sd.ModelError, match=name.replace("_", "[ _]")):
        sd.Friction(**{name: value})


@pytest.mark.parametrize("name", [x.name for x in fields(sd.Friction)])
def test_a_number_or_numbers_by_joint_are_those_of_a_robot(arm: sd.Model, name: str) -> None:
    base = {"static": 9.0} if name != "static" else {}
    whole = getattr(sd.Friction(**base, **{name: 0.5}).check(arm), name)
    np.testing.assert_array_equal(whole, [0.5, 0.5])
    each = sd.Friction(**base, **{name: {"joint2": 0.25, "joint1": 0.5}})
    np.testing.assert_array_equal(getattr(each.check(arm), name), [0.5, 0.25])
    assert each == sd.Friction(**base, **{name: {"joint1": 0.5, "joint2": 0.25}})
    assert each != sd.Friction(**base, **{name: {"joint1": 0.5, "joint2": 0.5}})
    assert pickle.loads(pickle.dumps(each)) == each
    assert hash(each) == hash(pickle.loads(pickle.dumps(each)))
    assert name in repr(each)


def test_one_coefficient_is_enough(arm: sd.Model) -> None:
    """The others are 0; a robot of any size takes it, in every call with friction."""
    only = sd.Friction(viscous=5)
    np.testing.assert_allclose(sd.friction_torque(arm, [0.5, -2.0], only), [-2.5, 10.0])
    run = sd.simulate(sd.Scene(arm, friction=only), [0.1, 0.2], [0.0, 0.0], 0.05, 1e-3)
    many = sd.rollout(sd.Scene(arm, friction=only), [0.1, 0.2], [0.0, 0.0], dt=1e-3, steps=50)
    np.testing.assert_array_equal(run.q[1:], many.q)
    by_name = sd.Friction(viscous={"joint1": 5, "joint2": 5})
    np.testing.assert_array_equal(
        sd.simulate(sd.Scene(arm, friction=by_name), [0.1, 0.2], [0.0, 0.0], 0.05, 1e-3).q, run.q
    )
    A, _ = sd.step_derivatives(
        sd.Scene(arm, friction=sd.Friction(viscous=5, smoothing=0.1)), [0.1, 0.2], [0, 0], [0, 0], 1e-3
    )
    assert A.shape == (4, 4)


def test_sizes_that_do_not_match_are_refused(arm: sd.Model) -> None:
    with pytest.raises(sd.ShapeError, match=r"coulomb \(3,\), viscous \(2,\)"):
        sd.Friction([1, 1, 1], [0, 1])
    with pytest.raises(sd.ShapeError, match=r"coulomb \(1, 2\)"):
        sd.Friction([[1, 1]], 0)
    with pytest.raises(sd.ShapeError, match='friction has 3 freedoms, expected the 2 of robot "two_link"'):
        sd.friction_torque(arm, [0, 0], sd.Friction([1, 1, 1], 0))
    with pytest.raises(sd.ShapeError, match=r"v has shape \(3,\)"):
        sd.friction_torque(arm, [0, 0, 0], sd.Friction([1, 1], 0))
    with pytest.raises(sd.ModelError, match=r"friction is 0\.5, expected a Friction, or True"):
        sd.friction_torque(arm, [0, 0], 0.5)  # type: ignore[arg-type]


def test_torques_are_the_formulas(arm: sd.Model) -> None:
    fc, b, fs, vs, e = (np.array(x) for x in ([1.0, 2.0], [0.1, 0.0], [1.5, 2.5], [0.2, 0.1], [0.01, 0.5]))
    v = np.random.default_rng(0).normal(size=(3, 4, 2)) * 0.3
    v[0, 0] = 0.0
    level = fc + (fs - fc) * np.exp(-((v / vs) ** 2))
    sharp = sd.friction_torque(arm, v, sd.Friction(fc, b, fs, vs))
    np.testing.assert_allclose(sharp, -level * np.sign(v) - b * v, rtol=1e-14)
    smooth = sd.friction_torque(arm, v, sd.Friction(fc, b, fs, vs, smoothing=e))
    np.testing.assert_allclose(smooth, -level * np.tanh(v / e) - b * v, rtol=1e-13, atol=1e-15)
    plain = sd.friction_torque(arm, v, sd.Friction(fc, b, fs))  # the static level acts at rest alone
    np.testing.assert_allclose(plain, -fc * np.sign(v) - b * v, rtol=1e-14)
    out = np.empty(v.shape)
    assert sd.friction_torque(arm, v, sd.Friction(fc, b, fs), out=out) is out
    np.testing.assert_array_equal(out, plain)
    np.testing.assert_array_equal(sd.friction_torque(arm, v[1, 2], sd.Friction(fc, b, fs)), plain[1, 2])


def test_far_velocities_and_nan_are_told_apart(arm: sd.Model) -> None:
    friction = sd.Friction([1.0, 2.0], 0.0, 3.0, stribeck_velocity=1e-3, smoothing=1e-3)
    v = np.array([[1e3, -1e3], [np.nan, 1e3], [1e-300, -1e-300]])
    found = sd.friction_torque(arm, v, friction)
    np.testing.assert_array_equal(found[0], [-1.0, 2.0])
    assert np.isnan(found[1, 0])
    assert abs(found[2]).max() <= 1e-15


def test_friction_of_true_is_the_urdfs() -> None:
    model = sd.load_urdf("tree")
    v = np.ones(model.nv)
    np.testing.assert_allclose(sd.friction_torque(model, v, True), -(model.friction + model.damping), rtol=1e-15)


# --- the regressor --------------------------------------------------------------------------------------


def test_the_regressor_of_friction_goes_on_where_that_of_torques_ends() -> None:
    """(Y, F) (π, F_c, b) is what motors give, in batches too."""
    model = random_tree(5, 4).model
    rng, n = np.random.default_rng(0), model.nv
    q, (v, a) = sd.random_configuration(model, rng, (6,)), rng.normal(size=(2, 6, n))
    v[:, 0] = 0.0
    friction = sd.Friction(rng.uniform(0.1, 1.0, n), rng.uniform(0.1, 1.0, n))
    F = sd.friction_regressor(model, v)
    assert F.shape == (6, n, 2, n)
    columns = np.concatenate([sd.joint_torque_regressor(model, q, v, a).reshape(6, n, -1), F.reshape(6, n, -1)], axis=2)
    parameters = np.concatenate([np.ravel(sd.inertial_parameters(model)), friction.coulomb, friction.viscous])
    wanted = sd.rnea(model, q, v, a) - sd.friction_torque(model, v, friction) - model.armature * a
    np.testing.assert_allclose(columns @ parameters, wanted, rtol=0.0, atol=1e-11)
    np.testing.assert_array_equal(F[0, :, 0], np.diag(np.sign(v[0])))
    np.testing.assert_array_equal(sd.friction_regressor(model, v[0]), F[0])


def test_the_regressor_of_friction_refuses_mimic_joints() -> None:
    made = sd.ModelBuilder("pair").add_body("a", None, "revolute", inertia=(1.0, (0, 0, 0), np.eye(3)))
    made.add_body("b", "a", "revolute", inertia=(1.0, (0, 0, 0), np.eye(3)), mimic={"leader": "a_joint"})
    with pytest.raises(sd.ModelError, match='model "pair" has mimic joints'):
        sd.friction_regressor(made.build(mimic=True), [0.0])
