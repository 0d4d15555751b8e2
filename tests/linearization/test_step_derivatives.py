"""Derivatives of steps: by hand, against differences in 240 bits, as symplectic maps, along trajectories, errors."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
import scenes
from dense import Array
from example_runs import robots
from slow import slow_but
from trees import random_inertia, random_placement, random_tree

import spatialdyn as sd
from spatialdyn.algebra.euclidean import Vec
from spatialdyn.algebra.lie import log_jacobian, log_jacobian_times_derivative
from spatialdyn.algebra.spatial import Motion
from spatialdyn.bodies.kinds import LENGTHS, NV
from spatialdyn.calls import by_program
from spatialdyn.calls.dynamics import checked_call
from spatialdyn.calls.exact import Exact
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record import recording
from spatialdyn.linearization.step_derivatives import NO_LAW
from spatialdyn.recursions.derivatives.step_derivatives import MOTION, STEPS
from spatialdyn.simulation.steps import step_specs

EXPLICIT = ("explicit_euler", "semi_implicit_euler", "velocity_verlet", "rk4")
IMPLICIT = ("symplectic_euler", "stormer_verlet", "implicit_midpoint", "gauss4", "gauss6", "variational")
EXACT = 1e-12  # relative to the largest entry
ROUNDING = 1e-11  # of A'ΩA, and of sums through M⁻¹, whose condition number is some 1e2 in these trees
DIFFERENCE = 3e-7  # of central differences of a step, over 2e-5
BITS = 240


def state(model: Any, seed: int = 0) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    return sd.random_configuration(model, rng), rng.normal(size=model.nv), rng.normal(size=model.nv)


def joints_of(kind: str, count: int = 2, gravity: float = -9.81) -> Any:
    """A chain of joints of one kind without armature, which on joints of several freedoms is of no Lagrangian."""
    return random_tree(3, count, (kind,), branching=0.0, armature=False, gravity=(0, 0, gravity)).model


def mixed() -> Any:
    """A planar joint, a spherical and a revolute one, with (cos, sin) pairs, armature and dead ends: 7 freedoms."""
    builder = sd.ModelBuilder("mixed")
    inertia = random_inertia(np.random.default_rng(2))
    builder.add_body("a", None, "planar", (0.6, 0, 0.8), None, inertia)
    builder.add_body("b", "a", "spherical", (1, 0, 0), random_placement(np.random.default_rng(3)), inertia)
    builder.add_body(
        "c", "a", "continuous", (0, 1, 0), random_placement(np.random.default_rng(4)), inertia, armature=0.1
    )
    return builder.build(continuous="cos_sin")


def quadruped() -> Any:
    """ANYmal on a floating base: 18 freedoms."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the inertia of its base link is all but zero
        return sd.load_urdf("anymal_b_simple_description/anymal", root="floating")


# --- by hand --------------------------------------------------------------------------------------------


def test_a_pendulums_step_has_the_textbooks_derivatives() -> None:
    """q̈ = -(g/l) sin q + τ/(m l²)."""
    builder = sd.ModelBuilder("pendulum")
    builder.add_body("rod", None, "revolute", (0, 1, 0), None, (2.0, (0, 0, -0.7), np.zeros((3, 3))))
    model, q, h = builder.build(), 0.4, 0.1
    slope, inverse = -9.81 / 0.7 * np.cos(q), 1.0 / (2.0 * 0.49)
    A, B = sd.linearize(model, [q], [0.3], [0.5])
    np.testing.assert_allclose(A, [[0.0, 1.0], [slope, 0.0]], rtol=0, atol=1e-13)
    np.testing.assert_allclose(B, [[0.0], [inverse]], rtol=0, atol=1e-13)
    A, B = sd.step_derivatives(model, [q], [0.3], [0.5], h, "explicit_euler")
    np.testing.assert_allclose(A, [[1.0, h], [h * slope, 1.0]], rtol=0, atol=1e-13)
    A, B = sd.step_derivatives(model, [q], [0.3], [0.5], h)
    np.testing.assert_allclose(A, [[1.0 + h * h * slope, h], [h * slope, 1.0]], rtol=0, atol=1e-13)
    np.testing.assert_allclose(B, [[h * h * inverse], [h * inverse]], rtol=0, atol=1e-13)


def test_a_step_of_a_free_spinning_ball_turns_what_was_before_it() -> None:
    """Without a torque R⁺ = R exp(h ω): δq⁺ = exp(-h ω) δq + h J(h ω) δω, J the right Jacobian."""
    builder = sd.ModelBuilder("ball")
    builder.add_body("ball", None, "spherical", inertia=(1.0, (0, 0, 0), 0.4 * np.eye(3)))
    model, w, h = builder.build(gravity=(0, 0, 0)), np.array([0.0, 0.0, 2.0]), 0.25
    angle = h * w[2]
    c, s = np.cos(angle), np.sin(angle)
    back = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    J = np.array([[s, 1 - c, 0.0], [c - 1, s, 0.0], [0.0, 0.0, angle]]) / angle
    for method in EXPLICIT:
        A, _ = sd.step_derivatives(model, [0.1, 0.7, 0.1, 0.7], w, np.zeros(3), h, method)
        np.testing.assert_allclose(A[:3], np.hstack([back, h * J]), rtol=0, atol=1e-13)
        np.testing.assert_allclose(A[3:], np.hstack([np.zeros((3, 3)), np.eye(3)]), rtol=0, atol=1e-13)


# --- the truth ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.03, 0.999, 1.001, 2.5, 4.0])
def test_the_inverse_jacobian_of_exp_has_its_derivative_near_zero_and_far(angle: float) -> None:
    """Against differences in 60 digits, on both sides of the border between series and closed form."""
    pytest.importorskip("mpmath")
    context = sd.exact(sd.load_urdf("two_link"), sd.aba, BITS).context
    rng = np.random.default_rng(5)
    axis, v, x = rng.normal(size=(3, 3))
    m, x = np.concatenate([angle * axis / np.linalg.norm(axis), v]), np.concatenate([x, rng.normal(size=3)])

    def rate(m: Any) -> Any:
        T = log_jacobian(motion(m), 1.0)
        J, K = (np.array(part, object).reshape(3, 3) for part in (T.J, T.K))
        return np.concatenate([J @ x[:3], J @ x[3:] + K @ x[:3]])

    T = log_jacobian_times_derivative(motion(m), motion(x))
    J, K = (np.array(part).reshape(3, 3) for part in (T.J, T.K))
    found = np.block([[J, np.zeros((3, 3))], [K, J]])
    step, columns = context.mpf(10) ** -20, []
    for e in np.eye(6):
        ahead, behind = (rate(np.array([context.mpf(float(a)) + s * step * b for a, b in zip(m, e, strict=True)]))
                         for s in (1, -1))  # fmt: skip
        columns.append(((ahead - behind) / (2 * step)).astype(float))
    np.testing.assert_allclose(found, np.array(columns).T, rtol=0, atol=1e-13)


def motion(m: Any) -> Motion:
    return Motion(Vec(*m[:3]), Vec(*m[3:]))


def differences(model: Any, q: Array, v: Array, tau: Array, h: float, method: str, columns: Any) -> Array:
    """Columns of (A, B): central differences over 2e-30 of the step itself in 240 bits."""
    after_q, after_v = (Exact(model, s, sd.exact(model, sd.aba, BITS)._arithmetic, {}, BITS)
                        for s in step_specs(method))  # fmt: skip
    integrate, difference = sd.exact(model, sd.integrate, BITS), sd.exact(model, sd.difference, BITS)
    context, n, found = after_q.context, model.nv, []
    given = [np.array([context.mpf(float(x)) for x in y], object) for y in (q, v, tau)]
    step = context.mpf(10) ** -30
    middle = after_q(given[0], given[1], h, given[2])
    for k in columns:
        ends = []
        for sign in (1, -1):
            e = np.array([sign * step * (j == k % n) for j in range(n)], object)
            moved = [integrate(given[0], e) if k < n else given[0], *given[1:]]
            if k >= n:
                moved[k // n] = given[k // n] + e
            state = moved[0], moved[1], h, moved[2]
            ends.append(np.concatenate([difference(middle, after_q(*state)), after_v(*state)]))
        found.append(((ends[0] - ends[1]) / (2 * step)).astype(float))
    return np.array(found).T


@pytest.mark.parametrize(
    ("method", "name"),
    slow_but(
        [("explicit_euler", "planar"), ("rk4", "spherical"), ("semi_implicit_euler", "floating")],
        [(x, name) for x in EXPLICIT for name in ("two_link", "floating", "spherical", "planar")],
    ),
)
def test_explicit_steps_have_the_derivatives_of_240_bits(method: str, name: str) -> None:
    """The joints of several freedoms turn by 1.3 rad: beyond the series."""
    pytest.importorskip("mpmath")
    model = sd.load_urdf(name) if name == "two_link" else joints_of(name, 1, gravity=0.0)
    q, v, tau = state(model, 7)
    h, tau = 1.3 / float(np.linalg.norm(v[-3:])) if model.nv > 2 else 0.05, 0.01 * tau
    A, B = sd.step_derivatives(model, q, v, tau, h, method)
    n = model.nv
    columns = sorted({0, n - 1, n, n + n // 2, 2 * n - 1, 3 * n - 1})
    truth = differences(model, q, v, tau, h, method, columns)
    np.testing.assert_allclose(np.hstack([A, B])[:, columns], truth, rtol=0, atol=EXACT * abs(truth).max())


@robots
@pytest.mark.parametrize("method", EXPLICIT[:2])
def test_a_quadrupeds_steps_have_the_derivatives_of_240_bits(method: str) -> None:
    """Its floating base turned, thrown and pushed; a column of each of q, v and tau, in base and legs."""
    pytest.importorskip("mpmath")
    model = quadruped()
    q, v, tau = state(model, 7)
    A, B = sd.step_derivatives(sd.Scene(model, friction=False), q, v, tau, 0.01, method)
    columns = [4, 23, 50]
    truth = differences(model, q, v, tau, 0.01, method, columns)
    np.testing.assert_allclose(np.hstack([A, B])[:, columns], truth, rtol=0, atol=EXACT * abs(truth).max())


@pytest.mark.parametrize("method", ["implicit_midpoint", "symplectic_euler", "stormer_verlet"])
def test_implicit_steps_have_the_derivatives_of_240_bits(method: str) -> None:
    """The equations of the method, iterated in 240 bits, on Hamilton's equations of two links."""
    pytest.importorskip("mpmath")
    model, h = sd.load_urdf("two_link"), 0.02
    q, v, tau = np.array([0.5, -0.3]), np.array([1.0, 2.0]), np.array([0.3, 0.2])
    field = sd.exact(model, sd.hamilton_field, BITS)
    momentum, velocity = sd.exact(model, sd.momentum, BITS), sd.exact(model, sd.velocity_from_momentum, BITS)

    def step(q: Any, v: Any, tau: Any) -> Any:
        p = momentum(q, v)
        q1, p1 = q, p
        for _ in range(22):
            if method == "implicit_midpoint":
                dq, dp = field((q + q1) / 2, (p + p1) / 2, tau)
                q1, p1 = q + h * dq, p + h * dp
            elif method == "symplectic_euler":
                dq, dp = field(q, p1, tau)
                q1, p1 = q + h * dq, p + h * dp
            else:
                dq, dp = field(q, p1, tau)
                p1 = p + h * dp / 2
                q1 = q + h * (dq + field(q1, p1, tau)[0]) / 2
        if method == "stormer_verlet":
            p1 = p1 + h * field(q1, p1, tau)[1] / 2
        return np.concatenate([q1, velocity(q1, p1)])

    given = np.array([field.context.mpf(float(x)) for x in (*q, *v, *tau)], object)
    small, h = field.context.mpf(10) ** -12, field.context.mpf(h)
    columns, chosen = [], (0, 3, 4)
    for k in chosen:
        e = np.array([small * (j == k) for j in range(6)], object)
        ahead, behind = (step(*np.split(given + s * e, 3)) for s in (1, -1))
        columns.append(((ahead - behind) / (2 * small)).astype(float))
    found = np.hstack(sd.step_derivatives(model, q, v, tau, float(h), method))[:, chosen]
    np.testing.assert_allclose(found, np.array(columns).T, rtol=0, atol=EXACT * abs(found).max())


# --- symplectic maps ------------------------------------------------------------------------------------


def omega(model: Any, p: Array) -> Array:
    """Ω of the frame (X_i, ∂/∂p_j): p_m c^m_ij where [X_i, X_j] = c^m_ij X_m, and ±1 between the two."""
    n = model.nv
    W = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])

    def hat(f: Array) -> Array:
        return np.array([[0.0, -f[2], f[1]], [f[2], 0.0, -f[0]], [-f[1], f[0], 0.0]])

    for i, row in enumerate(model.bodies[1:]):
        freedoms, lengths = NV[row["kind"]], LENGTHS[row["kind"]]
        here = slice(i, i + freedoms)
        if freedoms == 6:
            f = hat(p[i : i + 3])
            W[here, here] -= np.block([[np.zeros((3, 3)), f], [f, hat(p[i + 3 : i + 6])]])
        elif freedoms == 3 and lengths == 0:
            W[here, here] -= hat(p[here])
        elif freedoms == 3:
            turned = np.zeros((3, 3))
            turned[2, :2] = p[i + 1], -p[i]
            W[here, here] += turned - turned.T
    return W


def in_momenta(model: Any, q: Array, v: Array) -> Array:
    """(δq, δp) of (δq, δv)."""
    n = model.nv
    by_q = np.einsum("ijk,j->ik", sd.mass_matrix_derivatives(model, q), v)
    return np.block([[np.eye(n), np.zeros((n, n))], [by_q, sd.crba(model, q)]])


ROBOTS = ("two_link", "spherical", "planar", "floating")
# each method on two robots, each two robots by three methods
BY_TURNS = [(method, name) for k, method in enumerate(IMPLICIT) for name in ROBOTS[k % 2 :: 2]]


@pytest.mark.parametrize(("method", "name"), BY_TURNS)
def test_symplectic_methods_have_symplectic_derivatives(method: str, name: str) -> None:
    """A'ΩA = Ω in (q, p), on the group of the joints; a torque held in a turning frame is no gradient, so none acts."""
    model = sd.load_urdf(name) if name == "two_link" else joints_of(name, 2)
    q, v, tau = state(model, 3)
    h, tau = 0.02, 0.0 * tau
    A, _ = sd.step_derivatives(model, q, v, tau, h, method)
    run = sd.simulate(model, q, v, h, h, method)
    A = in_momenta(model, run.q[-1], run.v[-1]) @ A @ np.linalg.inv(in_momenta(model, q, v))
    before, after = omega(model, run.p[0]), omega(model, run.p[-1])
    assert abs(A.T @ after @ A - before).max() < ROUNDING * abs(before).max()


@robots
@pytest.mark.slow(quick="test_symplectic_methods_have_symplectic_derivatives")
def test_a_quadrupeds_midpoint_rule_is_symplectic() -> None:
    model = quadruped()
    q, v, tau = state(model, 3)
    A, _ = sd.step_derivatives(sd.Scene(model, friction=False), q, v, 0.0 * tau, 0.005, "implicit_midpoint")
    run = sd.simulate(sd.Scene(model, friction=False), q, v, 0.005, 0.005, "implicit_midpoint")
    A = in_momenta(model, run.q[-1], run.v[-1]) @ A @ np.linalg.inv(in_momenta(model, q, v))
    before, after = omega(model, run.p[0]), omega(model, run.p[-1])
    assert abs(A.T @ after @ A - before).max() < ROUNDING * abs(before).max()


def test_rk4_has_not() -> None:
    model = sd.load_urdf("two_link")
    q, v, tau = state(model, 3)
    A, _ = sd.step_derivatives(model, q, v, 0.0 * tau, 0.1, "rk4")
    q1, v1 = sd.step(model, q, v, 0.0 * tau, 0.1, "rk4")
    A = in_momenta(model, q1, v1) @ A @ np.linalg.inv(in_momenta(model, q, v))
    assert 1e-9 < abs(A.T @ omega(model, q) @ A - omega(model, q)).max() < 1e-3


# --- every method -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", [*EXPLICIT, *IMPLICIT])
def test_every_method_has_the_derivatives_of_its_own_step(method: str) -> None:
    """Of ``simulate``, by differences; joints of all kinds, quaternions and pairs, under torques."""
    model = mixed()
    q, v, tau = state(model, 1)
    h, n, e = 0.01, model.nv, 1e-5
    A, B = sd.step_derivatives(model, q, v, tau, h, method)

    def after(q: Array, v: Array, tau: Array) -> tuple[Array, Array]:
        run = sd.simulate(model, q, v, h, h, method, torque=tau)
        return run.q[-1], run.v[-1]

    rng = np.random.default_rng(0)
    for _ in range(3):
        dq, dv, dtau = rng.normal(size=(3, n))
        one, two = (after(sd.integrate(model, q, s * dq), v + s * dv, tau + s * dtau) for s in (e, -e))
        moved = np.concatenate([sd.difference(model, two[0], one[0]), one[1] - two[1]]) / (2 * e)
        wanted = A @ np.concatenate([dq, dv]) + B @ dtau
        np.testing.assert_allclose(moved, wanted, rtol=0, atol=DIFFERENCE * abs(wanted).max())


@pytest.mark.parametrize("method", slow_but(["rk4"], ["semi_implicit_euler", "rk4", "gauss4", "variational"]))
def test_external_forces_are_held_in_their_frames(method: str) -> None:
    model = mixed()
    (q, v, tau), fext = state(model, 5), np.random.default_rng(6).normal(size=(model.njoints, 6))
    h, e, d = 0.01, 1e-5, np.random.default_rng(2).normal(size=model.nv)
    A, _ = sd.step_derivatives(model, q, v, tau, h, method, fext=fext)
    one, two = (
        sd.simulate(sd.Scene(model, fext=fext), sd.integrate(model, q, x * d), v, h, h, method, torque=tau)
        for x in (e, -e)
    )
    moved = np.concatenate([sd.difference(model, two.q[-1], one.q[-1]), one.v[-1] - two.v[-1]]) / (2 * e)
    wanted = A[:, : model.nv] @ d
    np.testing.assert_allclose(moved, wanted, rtol=0, atol=DIFFERENCE * abs(wanted).max())
    without, _ = sd.step_derivatives(model, q, v, tau, h, method)
    assert abs(without - A).max() > 1e-6


def test_the_product_along_a_run_is_the_derivative_of_its_end() -> None:
    model, h, steps = sd.load_urdf("two_link"), 0.02, 50
    tau = 0.3 * np.random.default_rng(4).normal(size=(steps, 2))
    run = sd.simulate(model, [0.5, -0.3], [1.0, 2.0], steps * h, h, "rk4", torque=tau)
    A, B = sd.step_derivatives(model, run.q[:-1], run.v[:-1], run.tau[:-1], h, "rk4")
    whole = np.linalg.multi_dot(A[::-1])
    d, e = np.array([0.3, -0.2, 0.5, 0.1]), 1e-6
    one, two = (sd.simulate(model, [0.5 + s * d[0], -0.3 + s * d[1]], [1.0 + s * d[2], 2.0 + s * d[3]], steps * h, h,
                            "rk4", torque=tau) for s in (e, -e))  # fmt: skip
    moved = np.concatenate([one.q[-1] - two.q[-1], one.v[-1] - two.v[-1]]) / (2 * e)
    np.testing.assert_allclose(moved, whole @ d, rtol=0, atol=1e-7 * abs(moved).max())
    assert B.shape == (steps, 4, 2)


# --- continuous time --------------------------------------------------------------------------------------


def test_the_linear_system_is_the_limit_of_steps() -> None:
    """(A(h) - A(-h))/2h of a smooth method, over h²."""
    model = mixed()
    q, v, tau = state(model, 1)
    A, B = sd.linearize(model, q, v, tau)
    h = 1e-4
    ahead, back = (sd.step_derivatives(model, q, v, tau, s, "rk4") for s in (h, -h))
    np.testing.assert_allclose((ahead[0] - back[0]) / (2 * h), A, rtol=0, atol=1e-6 * abs(A).max())
    np.testing.assert_allclose((ahead[1] - back[1]) / (2 * h), B, rtol=0, atol=1e-6 * abs(B).max())
    by_q, by_v, inverse = sd.aba_derivatives(model, q, v, tau)
    n = model.nv
    np.testing.assert_allclose(A[n:], np.hstack([by_q, by_v]), rtol=0, atol=ROUNDING * abs(A).max())
    np.testing.assert_allclose(B[n:], inverse, rtol=0, atol=ROUNDING * abs(B).max())


@pytest.mark.parametrize("floating", [False, True])
def test_the_linear_system_of_geared_joints_has_the_derivatives_of_aba(floating: bool) -> None:
    """Of rotors on skew axes, whose couples are in the bias and in M."""
    rng = np.random.default_rng(4)
    builder = sd.ModelBuilder(root="b0")
    builder.set_inertia("b0", random_inertia(rng))
    for k in range(1, 5):
        rotor = sd.Rotor(0.01, 7.0, tuple(rng.normal(size=3)))
        axis, inertia = rng.normal(size=3), random_inertia(rng)
        builder.add_body(f"b{k}", f"b{k - 1}", "revolute", axis, random_placement(rng), inertia, rotor=rotor)
    model = builder.build(**({"root": "floating"} if floating else {}))
    n, (q, v, tau) = model.nv, state(model)
    A, B = sd.linearize(model, q, v, tau)
    found = A[n:, :n], A[n:, n:], B[n:]
    for one, wanted in zip(found, sd.aba_derivatives(model, q, v, tau), strict=True):
        np.testing.assert_allclose(one, wanted, rtol=0, atol=ROUNDING * abs(wanted).max())


def test_with_a_step_and_a_method_it_is_that_of_a_step() -> None:
    model = sd.load_urdf("two_link")
    q, v, tau = state(model)
    A, B = sd.linearize(model, q, v, tau, 0.01, "rk4")
    assert (A == sd.step_derivatives(model, q, v, tau, 0.01, "rk4")[0]).all()
    assert (B == sd.step_derivatives(model, q, v, tau, 0.01, "rk4")[1]).all()


# --- batches ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["semi_implicit_euler", "rk4", "gauss4", "variational"])
def test_a_batch_is_its_samples(method: str) -> None:
    """Of any leading shape, with a step of its own for each sample."""
    model = joints_of("spherical")
    rng = np.random.default_rng(0)
    q = sd.random_configuration(model, rng, 18).reshape(3, 6, model.nq)
    v, tau = rng.normal(size=(2, 3, 6, model.nv))
    dt = rng.uniform(0.001, 0.05, (3, 1))
    A, B = sd.step_derivatives(model, q, v, tau, dt, method)
    assert A.shape == (3, 6, 2 * model.nv, 2 * model.nv)
    assert B.shape == (3, 6, 2 * model.nv, model.nv)
    for at in ((0, 0), (1, 4), (2, 5)):
        one = sd.step_derivatives(model, q[at], v[at], tau[at], float(dt[at[0], 0]), method)
        np.testing.assert_allclose(A[at], one[0], rtol=0, atol=EXACT)
        np.testing.assert_allclose(B[at], one[1], rtol=0, atol=EXACT * abs(B).max())


def test_lanes_are_used_from_the_first_sample_on_and_give_the_bits_of_single_calls() -> None:
    model = sd.load_urdf("two_link")
    rng = np.random.default_rng(0)
    q, v, tau = rng.normal(size=(3, 16, 2))
    A, B = sd.step_derivatives(model, q, v, tau, 0.01)
    for k in range(16):
        one = sd.step_derivatives(model, q[k], v[k], tau[k], 0.01)
        assert (A[k] == one[0]).all()
        assert (B[k] == one[1]).all()


@pytest.mark.parametrize(
    ("method", "least"), [("explicit_euler", 26), ("semi_implicit_euler", 26), ("velocity_verlet", 17), ("rk4", 12)]
)
def test_models_of_more_freedoms_have_no_program(method: str, least: int) -> None:
    spec = numba_kernels.variant(STEPS[method], frozenset())
    short = [recording.fits((spec,), joints_of("revolute", count).bodies) for count in (least - 1, least)]
    assert short == [True, False]


@pytest.mark.slow(quick="test_lanes_are_used_from_the_first_sample_on_and_give_the_bits_of_single_calls")
def test_the_table_kernel_agrees_with_the_program() -> None:
    """It runs robots too long for a program, and samples beyond a program's range."""
    model = joints_of("planar")
    q, v, tau = state(model)
    for spec in (STEPS["velocity_verlet"], MOTION):
        step = () if spec is MOTION else (np.array([0.02]),)
        given = (q, v, tau, None, *step, *NO_LAW)
        one, other = (checked_call(spec, model, given, (), None, by_table=x) for x in (False, True))
        np.testing.assert_allclose(one, other, rtol=0, atol=EXACT * abs(one).max())


@pytest.mark.parametrize("odd", [np.nan, np.inf])
@pytest.mark.parametrize("method", slow_but(["gauss4"], ["semi_implicit_euler", "gauss4", "variational"]))
def test_what_is_not_finite_stays_in_its_sample(method: str, odd: float) -> None:
    model = sd.load_urdf("two_link")
    q, v, tau = np.random.default_rng(0).normal(size=(3, 6, 2))
    q[2, 1] = tau[4, 1] = odd
    sound = [0, 1, 3, 5]
    both = sd.step_derivatives(model, *(x.reshape(2, 3, 2) for x in (q, v, tau)), 0.01, method)
    for found, alone in zip(
        both, sd.step_derivatives(model, q[sound], v[sound], tau[sound], 0.01, method), strict=True
    ):
        rows = found.reshape((6, *found.shape[2:]))
        assert np.isnan(rows[2]).any()
        np.testing.assert_array_equal(rows[sound], alone)
    (A, _), still = both, sd.step_derivatives(model, q[2], v[2], tau[2], 0.01, method)
    np.testing.assert_array_equal(still[0], A[0, 2])


# --- errors -----------------------------------------------------------------------------------------------


def test_what_cannot_be_is_named() -> None:
    model = sd.load_urdf("two_link")
    q, v, tau = np.zeros((3, 4, 2))
    with pytest.raises(sd.SpatialDynError, match=r"method is 'rk5', expected one of explicit_euler, .*variational$"):
        sd.step_derivatives(model, q, v, tau, 0.01, "rk5")
    with pytest.raises(sd.SpatialDynError, match=r"method is 'dop853', whose steps adapt to a tolerance"):
        sd.step_derivatives(model, q, v, tau, 0.01, "dop853")
    with pytest.raises(sd.ShapeError, match=r"v has shape \(3,\), expected \(..., 2\)"):
        sd.step_derivatives(model, q, np.zeros(3), tau, 0.01)
    with pytest.raises(sd.ShapeError, match=r"tau has shape \(1,\), expected \(..., 2\)"):
        sd.step_derivatives(model, q, v, [1.0], 0.01, "gauss4")
    with pytest.raises(sd.ShapeError, match="batch shapes do not broadcast"):
        sd.step_derivatives(model, q, v, tau, np.full(3, 0.01))
    for method in ("rk4", "gauss4"):
        with pytest.raises(sd.SpatialDynError, match="dt is nan, expected finite numbers"):
            sd.step_derivatives(model, q, v, tau, np.nan, method)
    with pytest.raises(sd.SpatialDynError, match="dt is given and no method, expected both"):
        sd.linearize(model, q, v, tau, 0.01)
    with pytest.raises(sd.ModelError, match="model is a str, expected"):
        sd.step_derivatives("two_link", q, v, tau, 0.01)


def test_an_implicit_step_that_does_not_settle_is_named_with_its_sample() -> None:
    model = sd.load_urdf("two_link")
    q, v = np.zeros((2, 3, 2))
    v[1] = 40.0, -90.0
    with pytest.raises(sd.SimulationError, match=r"^sample 1: gauss4 .*try dt = "):
        sd.step_derivatives(model, q, v, np.zeros(2), 0.2, "gauss4")
    v[2], q[0] = v[1], np.nan  # a sample that is left out does not move the others' places
    with pytest.raises(sd.SimulationError, match=r"^sample 1, the first of 2: gauss4 .*try dt = "):
        sd.step_derivatives(model, q, v, np.zeros(2), 0.2, "gauss4")
    with pytest.raises(sd.SimulationError, match=r"^sample \(0, 1\), the first of 2: gauss4 .*try dt = "):
        sd.step_derivatives(model, q[None], v[None], np.zeros(2), 0.2, "gauss4")
    with pytest.raises(sd.SimulationError, match=r"^gauss4 .*try dt = "):
        sd.step_derivatives(model, q[1], v[1], np.zeros(2), 0.2, "gauss4")


@pytest.mark.parametrize("method", ["semi_implicit_euler", "rk4", "gauss4"])
def test_a_turn_beyond_pi_is_named_with_its_sample(method: str) -> None:
    model = joints_of("spherical", 1)
    q = np.tile([0.0, 0.0, 0.0, 1.0], (4, 1))
    v = np.zeros((4, 3))
    v[2] = 0.0, 0.0, 33.0
    with pytest.raises(sd.SimulationError, match=rf"turns by .* rad in a step of {method} in sample 2, .*less than π"):
        sd.step_derivatives(model, q, v, np.zeros(3), 0.1, method)
    v[2] = 0.0, 0.0, 20.0
    sd.step_derivatives(model, q, v, np.zeros(3), 0.1, "semi_implicit_euler")


@pytest.mark.slow(quick="test_what_cannot_be_is_named")
def test_friction_and_joints_without_inertia_are_named() -> None:
    builder = sd.ModelBuilder("pair")
    for name in "ab":
        builder.add_body(name, axis=(0, 1, 0), inertia=(1.0, (0, 0, 0.1), 0.01 * np.eye(3)), joint_name=name)
    with pytest.raises(
        sd.SimulationError,
        match="by implicit steps acts in the scene, expected constant forces, constraints, springs, viscous friction",
    ):
        sd.linearize(sd.Scene(builder.build(), friction=sd.Friction(0.1)), [0.0] * 2, [0.0] * 2, [0.0] * 2)
    empty = sd.ModelBuilder("empty")
    empty.add_body("hollow", joint_name="lazy")
    for method in ("semi_implicit_euler", "gauss4"):
        with pytest.raises(sd.InertiaError, match='joint "lazy" has zero articulated inertia'):
            sd.step_derivatives(empty.build(), [0.0], [0.0], [0.0], 0.01, method)


def test_springs_are_stiffness_in_continuous_time() -> None:
    """M v̇ = k (θ/n - q) ± d (θ̇/n - q̇) + m g l sin q, of a rod on its tip and the rotor that drives it."""
    elastic = sd.ModelBuilder("elastic")
    elastic.add_body("a", axis=(0, 1, 0), inertia=(1.0, (0, 0, 0.1), 0.01 * np.eye(3)), joint_name="a")
    k, d, n, rotor = 100.0, 0.3, 20.0, 1e-4
    elastic.add_series_elastic("a", k, d, rotor, n)
    model = elastic.build()
    rod = model.joint("a").idx_v
    pull = np.full(2, 1.0 / n)
    pull[rod] = -1.0
    weight, M = np.zeros((2, 2)), np.full(2, rotor)
    weight[rod, rod], M[rod] = 9.81 * 0.1, 0.01 + 0.01
    A, B = sd.linearize(model, np.zeros(2), np.zeros(2), np.zeros(2))
    wanted = (weight - k * np.outer(pull, pull)) / M[:, None], -d * np.outer(pull, pull) / M[:, None]
    np.testing.assert_allclose(A[2:], np.hstack(wanted), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(B[2:], np.diag(1.0 / M), rtol=1e-12, atol=1e-12)


def test_friction_of_the_urdf_is_left_out_with_a_warning_unless_that_is_meant() -> None:
    builder = sd.ModelBuilder("stiff")
    builder.add_body("a", axis=(0, 1, 0), inertia=(1.0, (0, 0, 0.1), 0.01 * np.eye(3)), damping=0.3)
    model = builder.build()
    with pytest.warns(
        UserWarning, match='robot "stiff" has joint damping or friction, which derivatives of steps leave'
    ):
        sd.step_derivatives(model, [0.1], [0.2], [0.0], 0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sd.step_derivatives(sd.Scene(model, friction=False), [0.1], [0.2], [0.0], 0.01)
        sd.linearize(sd.Scene(model, friction=False), [0.1], [0.2], [0.0])


@pytest.mark.parametrize("method", EXPLICIT)
def test_smooth_friction_acts_in_every_stage(method: str) -> None:
    """Against the chain rule where it is taken at the state alone, else differences of runs with it; one joint creeps,
    one is on the fall of Stribeck's curve, and batches are lanes.
    """
    model, h = sd.load_urdf("two_link"), 0.01
    q, v, tau = np.array([0.5, -0.3]), np.array([0.05, 0.4]), np.array([0.3, 0.2])
    friction = sd.Friction([0.3, 0.2], [0.1, 0.05], [0.5, 0.4], [0.1, 0.3], smoothing=[0.1, 0.2])
    scene = sd.Scene(model, friction=friction, friction_method="smooth")
    A, B = sd.step_derivatives(scene, q, v, tau, h, method)
    lanes = sd.step_derivatives(scene, *(np.tile(x, (9, 1)) for x in (q, v, tau)), h, method)
    for x, y in zip((A, B), lanes, strict=True):
        np.testing.assert_allclose(y, np.broadcast_to(x, y.shape), rtol=0, atol=EXACT)
    if "euler" in method:
        e, rub = 1e-6, sd.friction_torque(model, v, friction)
        slope = (
            np.diag(sd.friction_torque(model, v + e, friction) - sd.friction_torque(model, v - e, friction))
        ) / 2e-6
        bare, wanted = sd.step_derivatives(sd.Scene(model, friction=False), q, v, tau + rub, h, method)
        np.testing.assert_allclose(B, wanted, rtol=0, atol=EXACT)
        np.testing.assert_allclose(A, bare + np.hstack([np.zeros((4, 2)), B @ slope]), rtol=0, atol=1e-9)
        return
    e, d = 1e-5, np.random.default_rng(2).normal(size=(3, 2))
    words = {"dt": h, "steps": 1, "method": method, "friction": friction, "friction_method": "smooth"}
    one, two = (scenes.rollout(model, q + s * d[0], v + s * d[1], tau + s * d[2], **words) for s in (e, -e))
    moved = np.concatenate([one.q[-1] - two.q[-1], one.v[-1] - two.v[-1]]) / (2 * e)
    np.testing.assert_allclose(moved, A @ d[:2].ravel() + B @ d[2], rtol=0, atol=DIFFERENCE)


def test_smooth_friction_in_continuous_time_is_the_chain_rule() -> None:
    model, q, v = sd.load_urdf("two_link"), [0.5, -0.3], np.array([0.05, 0.4])
    friction = sd.Friction([0.3, 0.2], [0.1, 0.05], [0.5, 0.4], [0.1, 0.3], smoothing=[0.1, 0.2])
    A, B = sd.linearize(sd.Scene(model, friction=friction), q, v, [0.3, 0.2])
    smooth = sd.Scene(model, friction=friction, friction_method="smooth")
    np.testing.assert_array_equal(np.hstack(sd.linearize(smooth, q, v, [0.3, 0.2])), np.hstack([A, B]))
    rub, e = sd.friction_torque(model, v, friction), 1e-6
    slope = np.diag(sd.friction_torque(model, v + e, friction) - sd.friction_torque(model, v - e, friction)) / (2 * e)
    bare, same = sd.linearize(sd.Scene(model, friction=False), q, v, np.add(rub, [0.3, 0.2]))
    np.testing.assert_allclose(A, bare + np.hstack([np.zeros((4, 2)), B @ slope]), rtol=0, atol=1e-8)
    np.testing.assert_allclose(B, same, rtol=0, atol=EXACT)
    with pytest.raises(sd.SimulationError, match='method is "gauss4" and friction acts, expected semi_implicit_euler'):
        sd.step_derivatives(sd.Scene(model, friction=friction), q, v, [0.3, 0.2], 0.01, "gauss4")


def test_friction_is_of_the_law_by_which_a_step_takes_it() -> None:
    """With a smoothing its step is dry all the same, unless the scene says that it is smooth."""
    model, q, v, tau, h = sd.load_urdf("two_link"), [0.5, -0.3], np.array([0.0, 0.4]), [0.3, 0.2], 0.01
    law = {"coulomb": [50.0, 0.2], "viscous": [0.1, 0.05]}
    dry = sd.Scene(model, friction=sd.Friction(**law, smoothing=0.1))
    found = sd.step_derivatives(dry, q, v, tau, h)
    plain = sd.step_derivatives(sd.Scene(model, friction=sd.Friction(**law)), q, v, tau, h)
    assert found.active.tolist() == ["sticks", "slides"]
    np.testing.assert_array_equal(np.hstack(found), np.hstack(plain))
    assert abs(found.A[2]).max() < EXACT
    assert sd.step(dry, q, v, tau, h)[1][0] == 0.0
    assert sd.step_derivatives(dry, np.zeros((0, 2)), np.zeros((0, 2)), tau, h).A.shape == (0, 4, 4)
    with pytest.raises(sd.SimulationError, match=r"by implicit steps acts in the .*: Coulomb's law has no"):
        sd.linearize(sd.Scene(model, friction=sd.Friction(**law)), q, v, tau)
    damped = sd.Scene(model, friction=sd.Friction(viscous=[0.1, 0.05]))
    bare, by_tau = sd.linearize(sd.Scene(model, friction=False), q, v, tau - [0.1, 0.05] * v)
    wanted = bare - np.hstack([np.zeros((4, 2)), by_tau * [0.1, 0.05]])
    np.testing.assert_allclose(sd.linearize(damped, q, v, tau)[0], wanted, rtol=0, atol=1e-12)
    bent = sd.Scene(model, friction=sd.Friction(**law, bristle_stiffness=50.0), friction_method="lugre")
    with pytest.raises(sd.SimulationError, match="a Friction with smoothing: bristles are a state beside q"):
        sd.linearize(bent, q, v, tau)


@pytest.mark.slow(quick="test_what_cannot_be_is_named")
def test_a_robot_without_joints_has_none() -> None:
    model = sd.ModelBuilder("stone").build()
    for method in ("semi_implicit_euler", "gauss4"):
        A, B = sd.step_derivatives(model, [], [], [], 0.01, method)
        assert A.shape == B.shape == (0, 0)
    assert sd.linearize(model, [], [], [])[0].shape == (0, 0)


def test_programs_that_run_in_numpy_give_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Samples that lanes leave undone: angles beyond the short sine's range."""
    model = sd.load_urdf("two_link")
    q, v, tau = state(model)
    A, _ = sd.step_derivatives(model, q, v, tau, 0.01, "variational")
    monkeypatch.setattr(by_program, "fits", lambda specs, bodies, static=(): False)
    np.testing.assert_allclose(sd.step_derivatives(model, q, v, tau, 0.01, "variational")[0], A, rtol=0, atol=EXACT)
