"""Calls of models with mimic joints, recorded: those of the whole tree, with free joints, reduced by G."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from inputs import public, random_inputs, sorted_inputs
from numpy.typing import NDArray
from slow import slow_but

import spatialdyn as sd
from spatialdyn.engines import by_table_kernel
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import Argument

Array = NDArray[np.float64]
EPS = np.finfo(float).eps
COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: no programs")
FAR = 1e9  # [rad] beyond the range of programs
CLOSE = 1e-11  # of the largest entry; M of a claw has a condition number of some 1e3
INERTIA = (1.0, (0.1, -0.2, 0.3), np.diag([0.1, 0.2, 0.15]))
LIGHT = (0.3, (0.02, 0.05, -0.1), np.diag([0.01, 0.02, 0.03]))
QUICK = ("rnea", "crba", "aba", "aba_derivatives", "integrate", "frame_jacobian", "hamilton_field", "com_jacobian")


def claw(floating: bool, mimic: bool = True) -> sd.Model:
    """Joints that follow with other ratios and offsets: one before its leader in the tree, one a slider, two of one."""
    builder = sd.ModelBuilder("claw")
    early = {"leader": "m", "multiplier": -0.7, "offset": 0.2}
    builder.add_body("body", None, "fixed", inertia=INERTIA)  # of a floating root
    builder.add_body("b0", "body", "spherical", inertia=INERTIA, joint_name="s")
    builder.add_body("b1", "b0", axis=(0, 1, 0), inertia=INERTIA, joint_name="a", mimic=early)
    builder.add_body("b2", "b1", axis=(1, 0, 0), inertia=LIGHT, joint_name="b")
    builder.add_body("b3", "b0", axis=(0, 0, 1), inertia=INERTIA, joint_name="m")
    slider = {"leader": "b", "multiplier": 0.13, "offset": -0.05}
    builder.add_body("b4", "b3", "prismatic", axis=(1, 2, 2), inertia=LIGHT, joint_name="n", mimic=slider)
    builder.add_body("b5", "b4", "planar", axis=(1, 0, 1), inertia=INERTIA, joint_name="o")
    builder.add_body(
        "b6", "b5", axis=(0, 1, 1), inertia=LIGHT, joint_name="p", mimic={"leader": "m", "multiplier": 3.0}
    )
    return builder.build(mimic=mimic, root="floating" if floating else "fixed")


@pytest.fixture(scope="module", params=[False, True], ids=["fixed", "floating"])
def models(request: pytest.FixtureRequest) -> tuple[sd.Model, sd.Model]:
    """With joints that follow, and with all free."""
    return claw(request.param), claw(request.param, mimic=False)


def of_tree(model: sd.Model, argument: Argument, x: Array) -> Array:
    """An input of the whole tree."""
    G = model.mimic_matrix
    if argument.shape == ("nq",):
        return x[..., model.mimic_index] * model.mimic_ratio + model.mimic_offset
    if argument.shape == ("nv",) and argument.is_force:
        return x @ np.linalg.pinv(G)  # any torques that do the work of x
    return x @ G.T if argument.shape == ("nv",) else x


def of_model(model: sd.Model, argument: Argument, x: Array) -> Array:
    """An output reduced by G, entry by entry."""
    letters = "abcd"[: len(argument.shape)]
    free = np.eye(len(model.mimic_matrix))[:, model.free_v]
    for k, size in enumerate(argument.shape):
        if size == "nv":
            each = free if argument.per_coordinate else model.mimic_matrix
            x = np.einsum(f"...{letters},{letters[k]}z->...{letters.replace(letters[k], 'z')}", x, each)
        elif size == "nq":
            x = np.take(x, model.free_q, k - len(argument.shape))
    return x


def wanted(model: sd.Model, free: sd.Model, name: str, values: list[Array]) -> Array:
    """The result of a call by those of the tree with free joints."""
    spec = SPECS[name]
    given = dict(zip((x.name for x in sorted_inputs(spec)), values, strict=True))

    def whole(name: str, **more: Any) -> Array:
        spec, known = SPECS[name], given | more
        inputs = sorted_inputs(spec)
        found = public(free, spec, [of_tree(model, x, known[x.name]) for x in inputs])
        return of_model(model, spec.output, np.asarray(found))

    if spec.through_M is None:
        return whole(name)
    M = whole("crba")
    if name == "minverse":
        return np.linalg.inv(M)
    if name == "operational_space_inertia_inverse":
        J = whole("frame_jacobian")
        return J @ np.linalg.solve(M, J.T)
    if name in ("velocity_from_momentum", "hamiltonian", "hamilton_field"):
        v = np.linalg.solve(M, given["p"])
        if name == "velocity_from_momentum":
            return v
        if name == "hamiltonian":
            return 0.5 * given["p"] @ v + whole("potential_energy")
        return np.stack([v, whole("momentum_rate", v=v)])
    a = np.linalg.solve(M, given["tau"] - whole("rnea", a=0.0 * given["v"]))
    if name != "aba_derivatives":
        return a
    by = whole("rnea_derivatives", a=a)
    return np.stack([-np.linalg.solve(M, by[0]), -np.linalg.solve(M, by[1]), np.linalg.inv(M)])


@pytest.mark.parametrize("name", slow_but(QUICK, SPECS))
def test_each_call_is_that_of_the_whole_tree_reduced(models: tuple[sd.Model, sd.Model], name: str) -> None:
    spec, (model, free) = SPECS[name], models
    values = random_inputs(model, spec, 3, (4,))
    found = np.asarray(public(model, spec, values))
    for k in range(4 if values else 0):
        sample = [x[k] for x in values]
        right = wanted(model, free, name, sample)
        assert abs(found[k] - right).max(initial=0.0) <= CLOSE * max(abs(right).max(initial=0.0), 1e-300)
        np.testing.assert_array_equal(public(model, spec, sample), found[k])  # one and many: the same bits
    if not values:
        np.testing.assert_array_equal(found, of_model(model, spec.output, np.asarray(public(free, spec, []))))


@pytest.mark.parametrize("name", ["rnea", "aba", "crba", "minverse", "integrate", "frame_velocity", "aba_derivatives"])
def test_a_big_angle_and_a_nan_have_their_own_answers(models: tuple[sd.Model, sd.Model], name: str) -> None:
    spec, (model, free) = SPECS[name], models
    values = random_inputs(model, spec, 5, (6,))
    right = np.asarray(public(model, spec, values))
    turned = model.joint("m").idx_q  # two joints follow, both turn
    values[0][2, turned] = np.nan
    values[0][4, turned] += FAR
    found = np.asarray(public(model, spec, values))
    assert np.isnan(found[2]).any()
    np.testing.assert_array_equal(np.delete(found, [2, 4], 0), np.delete(right, [2, 4], 0))
    far = wanted(model, free, name, [x[4] for x in values])
    assert abs(found[4] - far).max() <= 1e-5 * abs(far).max()  # an ulp of 3e9 rad is 5e-7


@COMPILED
def test_what_a_program_rejects_compiles_no_table_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    """The program runs in NumPy."""
    model = claw(False)
    monkeypatch.setattr(by_table_kernel, "run_table_kernel", lambda *given, **more: pytest.fail("the table kernel ran"))
    q, v = sd.random_configuration(model, np.random.default_rng(0), (3,)), np.ones((3, model.nv))
    q[1, model.joint("m").idx_q] = np.nan
    assert np.isnan(sd.aba(model, q, v, v)[1]).all()


def test_a_quaternion_off_its_norm_and_a_singular_joint_are_named() -> None:
    model = claw(False)
    q = np.tile(np.asarray(sd.neutral(model)), (3, 1))
    q[1, :4] *= 1.1
    with pytest.raises(sd.ConfigurationError, match='for joint "s" in sample 1'):
        sd.rnea(model, q, np.zeros(model.nv), np.zeros(model.nv))
    builder = sd.ModelBuilder("point").add_body("b0", axis=(0, 0, 1), joint_name="lead")
    builder.add_body("b1", None, "prismatic", axis=(1, 0, 0), inertia=INERTIA, joint_name="slide")
    builder.add_body("b2", "b1", axis=(0, 1, 0), mimic={"leader": "lead", "multiplier": 2.0})
    point = builder.build(mimic=True)
    with pytest.raises(sd.InertiaError, match='joint "lead" has zero articulated inertia'):
        sd.aba(point, [0.0, 0.0], [0.0, 0.0], [0.0, 0.0])


def test_a_robot_that_is_singular_in_one_pose_is_named_with_the_sample() -> None:
    """A mass on two sliders, one turned by the first joint, that cancel at half a turn."""
    builder = sd.ModelBuilder("x").add_body("a", None, "prismatic", axis=(1, 0, 0), joint_name="out")
    builder.add_body("b", "a", axis=(0, 0, 1), joint_name="turn", armature=1.0)
    mass = (1.0, (0.0, 0.0, 0.0), np.zeros((3, 3)))
    follow = {"leader": "out", "multiplier": 1.0}
    builder.add_body("c", "b", "prismatic", axis=(1, 0, 0), inertia=mass, joint_name="again", mimic=follow)
    model = builder.build(mimic=True)
    q = np.zeros((4, 2))
    q[2:, model.joint("turn").idx_q] = np.pi
    with pytest.raises(sd.InertiaError, match="singular in sample 2, the first of 2"):
        sd.aba(model, q, 0.0 * q, 0.0 * q)
    assert np.isfinite(sd.aba(model, q[:2], 0.0 * q[:2], 0.0 * q[:2])).all()


@COMPILED
@pytest.mark.parametrize("call", [sd.rnea, sd.aba, sd.crba, sd.minverse], ids=lambda call: call.__name__)
def test_exact_answers_and_bounds_hold(models: tuple[sd.Model, sd.Model], call: Any) -> None:
    model, spec = models[0], SPECS[call.__name__]
    values = [
        x for x, of in zip(random_inputs(model, spec, 7, (5,)), sorted_inputs(spec), strict=True) if of.name != "fext"
    ]
    truth = sd.exact(model, call)(*values)
    found, bound = sd.bounded(model, call)(*values)
    error = abs((truth - found).astype(float))
    assert (error <= bound).all()
    assert error.max() <= 1e-12 * abs(found).max()
    np.testing.assert_array_equal(found, call(model, *values))


@COMPILED
def test_programs_take_parameters_derivatives_and_float32() -> None:
    model = claw(True)
    rng = np.random.default_rng(2)
    q, (v, tau) = sd.random_configuration(model, rng), rng.normal(size=(2, model.nv))
    k = sd.specialize(model, sd.aba, inputs=["payload:b6", "armature"])
    load = np.array([0.4, 0.1, 0.0, 0.2, 0.01, 0.0, 0.0, 0.02, 0.0, 0.03])
    other = model.with_(payload={"b6": (0.4, [0.1, 0.0, 0.2], np.diag([0.01, 0.02, 0.03]))})
    armature = 0.1 * np.arange(1.0, model.nv + 1)
    found = k(q, v, tau, load, model.armature)
    np.testing.assert_allclose(found, sd.aba(other, q, v, tau), rtol=1e-10)
    bigger = sd.crba(other, q) + np.diag(armature)
    bias = sd.rnea(other, q, v, np.zeros(model.nv))
    np.testing.assert_allclose(k(q, v, tau, load, armature), np.linalg.solve(bigger, tau - bias), rtol=1e-9)
    far = np.tile(q, (2, 1))
    far[1, model.joint("m").idx_q] += FAR
    at = k(far, v, tau, load, model.armature)
    np.testing.assert_array_equal(at[0], found)
    np.testing.assert_allclose(at[1], sd.aba(other, far[1], v, tau), rtol=1e-5)
    a, da = sd.specialize(model, sd.aba, derivative="jvp")(q, v, tau, *(1e-6 * x for x in (v, tau, v)))
    by_q, by_v, by_tau = sd.aba_derivatives(model, q, v, tau)
    np.testing.assert_allclose(da, 1e-6 * (by_q @ v + by_v @ tau + by_tau @ v), rtol=1e-9)
    quick = sd.specialize(model, sd.aba, dtype=np.float32)(q, v, tau)
    assert abs(quick - a).max() < 1e-3 * abs(a).max()


def test_double_double_keeps_more_digits() -> None:
    model = claw(False)
    rng = np.random.default_rng(4)
    q, (v, tau) = sd.random_configuration(model, rng, (3,)), rng.normal(size=(2, 3, model.nv))
    truth = sd.exact(model, sd.aba)(q, v, tau).astype(float)
    np.testing.assert_array_equal(sd.forward_dynamics(model, q, v, tau, method="extended"), truth)
