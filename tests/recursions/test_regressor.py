"""Regressors: by hand, by identities with what they are linear in, column by column, and at the limits.

Pinocchio on every robot is in test_corpus.py, on floats and in its own shapes in compat/test_regressors.py.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from dense import Array
from trees import RandomTree, State, random_state, random_tree, tree_case

import spatialdyn as sd
from spatialdyn.algebra.euclidean import Sym, Vec
from spatialdyn.algebra.records import put_inertia
from spatialdyn.algebra.spatial import Inertia
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.record.tracer import table
from spatialdyn.recursions import SPECS

EPS = np.finfo(float).eps
CLOSE = 256 * EPS  # of the largest entry: sums over a dozen bodies, each of a few rounded products
TREES = [*((seed, floating) for seed in range(3) for floating in (False, True)), (3, True)]


@pytest.fixture(params=TREES, ids=lambda p: f"{p[0]}-{'floating' if p[1] else 'fixed'}", scope="module")
def case(request: pytest.FixtureRequest) -> tuple[RandomTree, Any, State]:
    return tree_case(*request.param)


def close(x: Any, y: Any, scale: float = 1.0) -> None:
    x, y = np.asarray(x), np.asarray(y)
    assert x.shape == y.shape
    assert abs(x - y).max(initial=0.0) <= CLOSE * max(scale, abs(y).max(initial=0.0))


def armatures(model: Any) -> Array:
    return np.asarray(model.bodies["armature"][1:])


def parameters_of(mass: float, com: Any, inertia: Any) -> Array:
    """π of a body of an inertia about its centre of mass."""
    c = np.asarray(com, float)
    about = np.asarray(inertia, float) + mass * (c @ c * np.eye(3) - np.outer(c, c))
    return np.r_[mass, mass * c, about[0, 0], about[0, 1], about[1, 1], about[0, 2], about[1, 2], about[2, 2]]


# --- by hand --------------------------------------------------------------------------------------------


def test_pendulum_has_the_textbooks_row() -> None:
    """τ = Izz q̈ + g (hx cos q - hy sin q) for an axis along z and gravity along -y."""
    body = (1.5, (0.3, 0.1, 0.2), np.diag([0.2, 0.3, 0.4]))
    builder = sd.ModelBuilder("pendulum")
    builder.add_body("bob", None, "revolute", (0, 0, 1), (0, 0, 0), body)
    model = builder.build(gravity=(0.0, -9.81, 0.0))
    q, v, a = 0.4, 2.0, -0.7
    Y = sd.joint_torque_regressor(model, [q], [v], [a])
    c, s = np.cos(q), np.sin(q)
    close(Y[0, 1], [0, 9.81 * c, -9.81 * s, 0, 0, 0, 0, 0, 0, a])
    close(sd.kinetic_energy_regressor(model, [q], [v])[1], [0, 0, 0, 0, 0, 0, 0, 0, 0, 0.5 * v * v])
    close(sd.potential_energy_regressor(model, [q])[1], [0, 9.81 * s, 9.81 * c, 0, 0, 0, 0, 0, 0, 0])
    close(sd.static_regressor(model, [q])[:, 1], np.array([[0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]]) / 1.5)
    close(sd.inertial_parameters(model)[1], parameters_of(*body))


# --- identities -----------------------------------------------------------------------------------------


def test_torque_is_y_pi_and_armature(case: tuple[RandomTree, Any, State]) -> None:
    _, model, s = case
    Y, pi = sd.joint_torque_regressor(model, s.q, s.v, s.a), sd.inertial_parameters(model)
    close(np.einsum("ijk,jk->i", Y, pi) + armatures(model) * s.a, sd.rnea(model, s.q, s.v, s.a))


def test_energies_and_centre_of_mass_are_y_pi(case: tuple[RandomTree, Any, State]) -> None:
    _, model, s = case
    pi = sd.inertial_parameters(model)
    rotors = 0.5 * armatures(model) @ (s.v * s.v)
    close((sd.kinetic_energy_regressor(model, s.q, s.v) * pi).sum() + rotors, sd.kinetic_energy(model, s.q, s.v))
    close((sd.potential_energy_regressor(model, s.q) * pi).sum(), sd.potential_energy(model, s.q))
    close(np.einsum("ijk,jk->i", sd.static_regressor(model, s.q), pi[:, :4]), sd.center_of_mass(model, s.q))


def test_regressors_without_accelerations_are_linear_in_pi(case: tuple[RandomTree, Any, State]) -> None:
    """Of M a_r + C v_r + g with the C of Christoffel's symbols, of p = M v, and of Cᵀ v."""
    _, model, s = case
    pi, rotors = sd.inertial_parameters(model), armatures(model)

    def of(Y: Array) -> Array:
        return np.einsum("ijk,jk->i", Y, pi)

    v_r, a_r = s.tau, s.a
    torque = sd.modified_rnea(model, s.q, s.v, v_r, a_r)
    close(of(sd.modified_torque_regressor(model, s.q, s.v, v_r, a_r)) + rotors * a_r, torque, abs(torque).max())
    close(of(sd.momentum_regressor(model, s.q, s.v)) + rotors * s.v, sd.momentum(model, s.q, s.v))
    close(of(sd.coriolis_transpose_regressor(model, s.q, s.v)), sd.coriolis_transpose_times_velocity(model, s.q, s.v))


UNITS = [
    Inertia(*(float(k == 0), Vec(*(float(k == 1 + i) for i in range(3))), Sym(*(float(k == at) for at in order))))
    for order in [(4, 5, 7, 6, 8, 9)]
    for k in range(10)
]  # the k-th parameter alone


@pytest.mark.parametrize("seed", [0, 1])
def test_each_column_is_the_torque_of_that_parameter_alone(seed: int) -> None:
    """The recursion rnea runs on tables of bodies that have one parameter each, energies likewise."""
    made = random_tree(seed, 4, floating=bool(seed), armature=False)
    model, s = made.model, random_state(made.tree, np.random.default_rng(seed))
    Y = sd.joint_torque_regressor(model, s.q, s.v, s.a)
    T, V = sd.kinetic_energy_regressor(model, s.q, s.v), sd.potential_energy_regressor(model, s.q)
    adaptive = sd.modified_torque_regressor(model, s.q, s.v, s.tau, s.a)
    P, C = sd.momentum_regressor(model, s.q, s.v), sd.coriolis_transpose_regressor(model, s.q, s.v)
    for joint in model.joints[1:]:
        for k, unit in enumerate(UNITS):
            rows = table(model.bodies)
            for row in range(1, len(model.bodies)):
                put_inertia(rows[row].inertia, Inertia(0.0, Vec(0.0, 0.0, 0.0), Sym(*[0.0] * 6)))
            put_inertia(rows[joint.row].inertia, unit)
            at = model.names.index(joint.name)
            close(_run("rnea", rows, (s.q, s.v, s.a, None), model.nv), Y[:, at, k])
            close(_run("modified_rnea", rows, (s.q, s.v, s.tau, s.a), model.nv), adaptive[:, at, k])
            close(_run("momentum", rows, (s.q, s.v), model.nv), P[:, at, k])
            close(_run("coriolis_transpose_times_velocity", rows, (s.q, s.v), model.nv), C[:, at, k])
            close(_run("kinetic_energy", rows, (s.q, s.v), 1)[0], T[at, k])
            close(_run("potential_energy", rows, (s.q,), 1)[0], V[at, k])


def _run(name: str, rows: Any, inputs: tuple[Any, ...], n: int) -> Array:
    spec, out = SPECS[name], np.zeros(n)
    work = np.zeros(len(rows), spec.work).view(np.recarray)
    spec.recursion(rows, work, *inputs, out)
    return out


def test_a_load_on_a_frame_adds_its_body_regressor() -> None:
    """A payload adds Jᵀ Y π to the torque, with J the frame's Jacobian in its own coordinates."""
    made = random_tree(3, 5, floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(3))
    load = (2.0, (0.1, -0.2, 0.3), np.diag([0.3, 0.4, 0.5]))
    loaded = sd.specialize(model, sd.rnea, inputs=f"payload:{model.frames[-1].name}")
    payload = [load[0], *load[1], 0.3, 0.0, 0.0, 0.4, 0.0, 0.5]
    J = sd.frame_jacobian(model, s.q, model.frames[-1])
    force = sd.body_regressor(model, s.q, s.v, s.a, model.frames[-1]) @ parameters_of(*load)
    bare = sd.rnea(model, s.q, s.v, s.a)
    found = loaded(s.q, s.v, s.a, payload)
    close(J.T @ force, found - bare, abs(found).max())


def test_body_regressor_of_a_joints_frame_gives_the_force_on_its_body(case: tuple[RandomTree, Any, State]) -> None:
    """A body on which nothing hangs is moved by its joint alone: τ = Sᵀ f."""
    _, model, s = case
    last = model.joints[-1]
    J = sd.frame_jacobian(model, s.q, f"joint:{last.name}")
    f = sd.body_regressor(model, s.q, s.v, s.a, f"joint:{last.name}") @ sd.inertial_parameters(model)[-1]
    at = slice(last.idx_v, last.idx_v + last.nv)
    tau = sd.rnea(model, s.q, s.v, s.a) - armatures(model) * s.a
    close(J[:, at].T @ f, tau[at], abs(f).max())


def test_on_a_frame_of_the_world_only_gravity_acts() -> None:
    model = random_tree(0, 3).model
    world = next(f for f in model.frames if f.joint == 0)
    still = np.zeros(model.nv)
    Y = sd.body_regressor(model, sd.neutral(model), still, still, world)
    R = world.placement[:3, :3]
    close(Y @ np.r_[2.0, np.zeros(9)], np.r_[R.T @ (0, 0, 2.0 * 9.81), 0, 0, 0])


# --- which parameters enter -----------------------------------------------------------------------------


def test_joints_below_and_the_world_have_no_columns(case: tuple[RandomTree, Any, State]) -> None:
    _, model, s = case
    Y = sd.joint_torque_regressor(model, s.q, s.v, s.a)
    assert not Y[:, 0].any()
    for k, joint in enumerate(model.joints[1:], start=1):
        carriers, at = set(), k
        while at:
            carriers.add(at)
            at = model.joints[at].parent
        for other, above in enumerate(model.joints[1:], start=1):
            if other not in carriers:
                assert not Y[above.idx_v : above.idx_v + above.nv, k].any(), (joint.name, above.name)


MIMIC = """<robot name="gripper"><link name="base"/>
<link name="a"><inertial><origin xyz="0.1 0 0.05"/><mass value="1"/>
  <inertia ixx="0.3" ixy="0" ixz="0.01" iyy="0.2" iyz="0" izz="0.25"/></inertial></link>
<link name="b"><inertial><origin xyz="0.1 0.2 0.05"/><mass value="2"/>
  <inertia ixx="0.3" ixy="0" ixz="0.01" iyy="0.2" iyz="0" izz="0.25"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/><origin xyz="0.2 0.1 0.3"/>
  <limit lower="-3" upper="3" effort="1" velocity="1"/><mimic joint="j1" multiplier="-0.5" offset="0.2"/></joint>
</robot>"""


@pytest.mark.parametrize("root", ["fixed", "floating"])
def test_a_mimic_joints_body_keeps_its_columns(root: str) -> None:
    model = sd.load_urdf(MIMIC, root=root, mimic=True)
    rng = np.random.default_rng(0)
    q, v, a = sd.random_configuration(model, rng), *rng.normal(size=(2, model.nv))
    pi, Y = sd.inertial_parameters(model), sd.joint_torque_regressor(model, q, v, a)
    assert pi.shape == (model.njoints, 10)
    close(np.einsum("ijk,jk->i", Y, pi), sd.rnea(model, q, v, a))
    close((sd.kinetic_energy_regressor(model, q, v) * pi).sum(), sd.kinetic_energy(model, q, v))


# --- other ways of running ------------------------------------------------------------------------------


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is traced")
def test_batches_on_lanes_equal_single_samples() -> None:
    made = random_tree(5, 5, floating=True)
    model, rng, n = made.model, np.random.default_rng(5), 512
    states = [random_state(made.tree, rng) for _ in range(n)]
    q, v, a = (np.array([getattr(s, name) for s in states]) for name in "qva")
    assert recording.fits((SPECS["joint_torque_regressor"],), model.bodies)
    for call, inputs in (
        (sd.joint_torque_regressor, (q, v, a)),
        (sd.kinetic_energy_regressor, (q, v)),
        (sd.potential_energy_regressor, (q,)),
        (sd.static_regressor, (q,)),
    ):
        found = call(model, *inputs)
        for k in (0, n // 2, n - 1):
            close(found[k], call(model, *(x[k] for x in inputs)))


def test_y_has_an_exact_value() -> None:
    pytest.importorskip("mpmath")
    model = random_tree(1, 3).model
    q = sd.random_configuration(model, np.random.default_rng(1))
    v, a = np.random.default_rng(2).normal(size=(2, model.nv))
    truth = sd.exact(model, sd.joint_torque_regressor)(q, v, a)
    close(sd.joint_torque_regressor(model, q, v, a), truth)


# --- limits ---------------------------------------------------------------------------------------------


def test_no_joints_have_no_columns() -> None:
    rock = sd.ModelBuilder("rock", root="rock").build()
    assert sd.joint_torque_regressor(rock, [], [], []).shape == (0, 1, 10)
    for found in (sd.inertial_parameters(rock), sd.kinetic_energy_regressor(rock, [], [])):
        assert found.shape == (1, 10)
        assert not found.any()


def test_a_robot_without_mass_has_a_torque_regressor_and_no_static_one() -> None:
    builder = sd.ModelBuilder("ghost")
    builder.add_body("a", None, "prismatic", (0, 0, 1))
    model = builder.build()
    close(sd.joint_torque_regressor(model, [0.1], [0.2], [0.3])[0, 1, 0], 9.81 + 0.3)
    with pytest.raises(sd.NonFiniteError):
        sd.static_regressor(model, [0.1])
