"""Control laws: their torques from M, C and g, their closed loops, and what they are made of together."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd

ROUNDING = 1e-12  # of torques of some 10 N m
N = 3


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    """Three joints about different axes, whose inertias are alike."""
    builder = sd.ModelBuilder("arm")
    for k, axis in enumerate(((0, 0, 1), (0, 1, 0), (1, 0, 0))):
        solid = (1.0, (0.1, 0.05, 0.15), np.diag([0.3, 0.4, 0.35]))
        builder.add_body(f"b{k}", f"b{k - 1}" if k else None, "revolute", axis, (0.2, 0.1, 0.3) if k else None, solid)
    return builder.build()


def spd(seed: int, n: int = N) -> np.ndarray:
    """A symmetric positive matrix."""
    A = np.random.default_rng(seed).normal(size=(n, n))
    return A @ A.T + np.eye(n)


def laws(path: Any) -> dict[str, sd.Control]:
    return {
        "pd": sd.PD(spd(1), spd(2), path, held=False), "pd_gravity": sd.PDGravity(spd(1), spd(2), path),
        "pd_plus": sd.PDPlus(spd(1), spd(2), path), "computed_torque": sd.ComputedTorque(spd(1), spd(2), path),
        "passivity": sd.Passivity(spd(1), spd(2), path),
    }  # fmt: skip


def formula(name: str, model: sd.Model, q: np.ndarray, v: np.ndarray, at: sd.PathPoint) -> np.ndarray:
    """The line of the textbook, with M, C and g formed."""
    M, C, g = sd.crba(model, q), sd.coriolis_matrix(model, q, v), sd.generalized_gravity(model, q)
    Kp, Kd, e, de = spd(1), spd(2), sd.difference(model, q, at.q), at.v - v
    lines = {
        "pd": lambda: Kp @ e + Kd @ de,
        "pd_gravity": lambda: g + Kp @ e - Kd @ v,
        "pd_plus": lambda: M @ at.a + C @ at.v + g + Kp @ e + Kd @ de,
        "computed_torque": lambda: M @ (at.a + Kp @ e + Kd @ de) + C @ v + g,
        "passivity": lambda: M @ (at.a + Kp @ de) + C @ (at.v + Kp @ e) + g - Kd @ (v - at.v - Kp @ e),
    }
    return np.asarray(lines[name]())


def test_laws_that_are_made_of_others_pickle(arm: sd.Model) -> None:
    """They are sent to other processes, each of which has one Spec of equal laws, and so one program."""
    path = sd.quintic(np.zeros(N), np.ones(N), 2.0)
    on_path, hold = sd.PDPlus(9.0, 6.0, path), sd.PD(4.0, 3.0, np.zeros(N), held=0.01)
    known = on_path.limited_by(5.0) + hold
    at = 0.3, np.full(N, 0.1), np.full(N, 0.2)
    for law in (on_path, hold, known, known + sd.Gravity()):
        sent = [pickle.loads(pickle.dumps(law)) for _ in range(2)]
        assert sent[0].spec is sent[1].spec
        assert sent[0](arm, *at).tobytes() == law(arm, *at).tobytes()
    assert pickle.loads(pickle.dumps(known)).spec is known.spec


@pytest.mark.parametrize("name", laws([0.0] * N))
def test_a_law_is_its_line_in_the_textbook(name: str, arm: sd.Model) -> None:
    draw = np.random.default_rng(3)
    path = sd.fourier(*draw.normal(size=(2, 2, N)), 0.5, draw.normal(size=N))
    t, q, v = draw.uniform(0.0, 2.0, 100), draw.normal(size=(100, N)), draw.normal(size=(100, N))
    found = laws(path)[name](arm, t, q, v)
    for k in range(100):
        want = formula(name, arm, q[k], v[k], path(t[k]))
        assert abs(found[k] - want).max() < ROUNDING * max(1.0, abs(want).max())
    assert (laws(path)[name](arm, t[7], q[7], v[7]) == found[7]).all()  # to the bit, alone


def test_a_law_is_exact_a_program_its_derivative_and_c() -> None:
    model = sd.load_urdf("two_link")
    path = sd.spline([0.0, 0.5, 1.0, 1.5], [[0.0, 0.0], [1.0, 0.5], [0.2, 0.1], [0.3, 0.3]])
    law, t, q, v = sd.ComputedTorque(10.0, 5.0, path), 0.7, np.array([0.3, 0.4]), np.array([0.1, 0.2])
    names = [x.name for x in law.torque_spec.present]
    given = [np.asarray({"q": q, "v": v, "clock": [t]}.get(x, law.values.get(x))) for x in names]
    found = law(model, t, q, v)
    truth = sd.exact(model, law)(*given).astype(float)
    assert abs(found - truth).max() < ROUNDING
    program = sd.specialize(model, law, derivative="jvp")
    along = [np.ones(1) if x == "clock" else np.zeros_like(y, float) for x, y in zip(names, given, strict=True)]
    torque, rate = program(*given, *along)
    step = 1e-6
    slope = (law(model, t + step, q, v) - law(model, t - step, q, v)) / (2.0 * step)
    assert (torque == found).all()
    assert abs(rate - slope).max() < 1e-6 * abs(slope).max()
    assert "coefficients[" in sd.specialize(model, law).c_code()


def test_laws_of_groups_and_of_mimic_joints_are_theirs() -> None:
    solid = (1.0, (0.1, 0.0, 0.2), 0.1 * np.eye(3))
    free = sd.ModelBuilder("free", "world").add_body("base", None, "floating", inertia=solid)
    model = free.add_body("arm", "base", "spherical", inertia=solid).build()
    draw = np.random.default_rng(4)
    q = sd.integrate(model, sd.neutral(model), 0.3 * draw.normal(size=model.nv))
    path = sd.quintic(sd.neutral(model), q, 2.0, model)
    v = draw.normal(size=model.nv)
    at, gains = path(0.7), (np.full(model.nv, 3.0), np.full(model.nv, 2.0))
    e = sd.difference(model, q, at.q)
    want = sd.rnea(model, q, v, at.a + 3.0 * e + 2.0 * (at.v - v))
    assert abs(sd.ComputedTorque(*gains, path)(model, 0.7, q, v) - want).max() < ROUNDING * abs(want).max()
    finger = sd.ModelBuilder("finger").add_body("a", None, "revolute", (0, 1, 0), inertia=solid)
    finger.add_body("b", "a", "revolute", (0, 1, 0), (0.4, 0, 0), solid, mimic={"leader": "a_joint", "multiplier": 0.5})
    mimic = finger.add_body("c", "b", "revolute", (0, 1, 0), (0.4, 0, 0), solid).build(mimic=True)
    q, v = np.array([0.4, -0.2]), np.array([1.0, 2.0])
    want = sd.modified_rnea(mimic, q, v, v + 1.0, v)
    found = sd.PDPlus(1e-9, 1e-9, sd.spline([0.0, 1.0], [[0.0, 0.0], [1.0, 1.0]]))(mimic, 0.0, q, v)
    assert found.shape == want.shape
    assert abs(sd.Gravity()(mimic, 0.0, q, v) - sd.generalized_gravity(mimic, q)).max() < ROUNDING


def test_computed_torque_follows_a_path_to_order_four_by_rk4(arm: sd.Model) -> None:
    """Its clock is read at the times of the stages: samples held over steps would make it of order 1."""
    path = sd.fourier([[1.0, 0.5, -0.5]], [[0.2, -0.4, 0.6]], 0.5, [0.1, 0.2, 0.3])
    law = sd.ComputedTorque(*sd.critical_gains(4.0), path)
    start, errors = path(0.0), []
    for dt in (0.02, 0.01, 0.005):
        run = sd.simulate(arm, start.q + 0.1, start.v, 1.0, dt, "rk4", control=law)
        exact = path(run.t).q + (0.1 * (1.0 + 4.0 * run.t) * np.exp(-4.0 * run.t))[:, None]  # e'' + 8 e' + 16 e = 0
        errors.append(abs(run.q - exact).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4.0, abs=0.3)
    assert errors[2] < 1e-8
    assert run.states["clock"][-1] == pytest.approx(1.0, abs=1e-12)


def test_a_rollout_on_lanes_is_simulate(arm: sd.Model) -> None:
    path = sd.quintic([0.0] * N, [0.5, -0.4, 0.3], 0.5)
    law, starts = sd.Passivity(3.0, 4.0, path) + sd.Gravity(), 0.1 * np.random.default_rng(5).normal(size=(9, N))
    found = sd.rollout(arm, starts, np.zeros(N), dt=0.01, steps=20, method="rk4", control=law)
    alone = sd.simulate(arm, starts[4], np.zeros(N), 0.2, 0.01, "rk4", control=law)
    assert abs(found.q[4] - alone.q[1:]).max() < ROUNDING


def test_pd_with_gravity_rests_exactly_at_its_goal(arm: sd.Model) -> None:
    goal = np.array([0.4, -0.2, 0.3])
    law = sd.PDGravity(20.0, 12.0, goal)
    run = sd.simulate(arm, np.zeros(N), np.zeros(N), 20.0, 0.01, control=law)
    assert abs(run.q[-1] - goal).max() < 1e-9
    assert abs(run.v[-1]).max() < 1e-9


@pytest.mark.parametrize("method", ["implicit_midpoint", "stormer_verlet"])
def test_symplectic_methods_keep_their_order_under_a_law(method: str, arm: sd.Model) -> None:
    """They evaluate the law where they evaluate forces: held over a step it would be of order 1."""
    law, rest = sd.PDGravity(20.0, 12.0, np.array([0.4, -0.2, 0.3])), np.zeros(N)
    exact = sd.simulate(arm, rest, rest, 0.2, 0.01, "rk4", control=law).q[-1]  # to 3e-8
    errors = [
        abs(sd.simulate(arm, rest, rest, 0.2, dt, method, control=law).q[-1] - exact).max() for dt in (0.02, 0.01)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_gauss_follows_a_path_to_its_order(arm: sd.Model) -> None:
    """The clock is that of each stage: half a step of it before the motion and half after would make it order 2."""
    law, rest = sd.ComputedTorque(*sd.critical_gains(8.0), sd.quintic(np.zeros(N), [1.0, 0.5, -0.4], 1.0)), np.zeros(N)
    ends = [sd.simulate(arm, rest + 0.1, rest, 0.16, dt, "gauss4", control=law).q[-1] for dt in (0.08, 0.04, 0.02)]
    assert np.log2(abs(ends[1] - ends[0]).max() / abs(ends[2] - ends[1]).max()) == pytest.approx(4.0, abs=0.3)


def test_lyapunov_functions_of_the_laws_fall(arm: sd.Model) -> None:
    """V' = -ė·Kd ė of PD+, -s·K s of passivity-based control, -v·Kd v of energy shaping."""
    path = sd.fourier([[1.0, 0.5, -0.5]], [[0.2, -0.4, 0.6]], 0.5, [0.1, 0.2, 0.3])
    shaping = sd.EnergyShaping(20.0, 3.0, [0.3, 0.2, 0.1], "cosine")

    def of_plus(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        at = path(t)
        e, de = at.q - q, at.v - v
        return np.asarray(sd.kinetic_energy(arm, q, de) + 0.5 * np.einsum("ni,ij,nj->n", e, spd(1), e))

    def of_slotine(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        at = path(t)
        return np.asarray(sd.kinetic_energy(arm, q, v - at.v - (at.q - q) @ spd(1)))

    for law, V in (
        (laws(path)["pd_plus"], of_plus), (laws(path)["passivity"], of_slotine),
        (shaping, lambda t, q, v: shaping.energy(arm, q, v)),
    ):  # fmt: skip
        run = sd.simulate(arm, [0.5, -0.5, 0.2], [0.3, 0.1, -0.4], 2.0, 2e-3, control=law)
        found = V(run.t, run.q, run.v)
        assert np.diff(found).max() < 1e-12 * found[0]
        assert found[-1] < 0.5 * found[0]


# --- together -------------------------------------------------------------------------------------------


def test_laws_add(arm: sd.Model) -> None:
    path = sd.quintic([0.0] * N, [0.5, -0.4, 0.3], 0.5)
    parts = sd.PD(10.0, 2.0, path, held=False), sd.Gravity(), sd.PDPlus(1.0, 1.0, path)
    both = parts[0] + parts[1] + parts[2]
    q, v = np.array([0.1, 0.2, 0.3]), np.array([1.0, -1.0, 0.5])
    want = sum(x(arm, 0.2, q, v) for x in parts)
    assert abs(both(arm, 0.2, q, v) - want).max() < ROUNDING
    run = sd.simulate(arm, q, v, 0.1, 0.01, "rk4", control=both)
    assert list(run.states) == ["clock"]  # which they share
    adaptive = sd.simulate(arm, q, v, 0.1, 0.1, "dop853", control=both)
    assert abs(adaptive.q[-1] - run.q[-1]).max() < 1e-6
    with pytest.raises(TypeError):
        both + 3  # type: ignore[operator]


def test_a_held_law_beside_one_that_is_not_is_held_alone(arm: sd.Model) -> None:
    """By hand: PD's torque at the beginning of each step, beside g(q) at every stage."""
    hold, q, v = sd.PD(30.0, 5.0, [0.3, 0.2, 0.1]), np.zeros(N), np.zeros(N)
    run = sd.simulate(arm, q, v, 0.2, 0.02, "rk4", control=hold + sd.Gravity())
    for k in range(10):
        tau = hold(arm, 0.0, q, v)
        end = sd.simulate(arm, q, v, 0.02, 0.02, "rk4", torque=tau, control=sd.Gravity())
        q, v = end.q[-1], end.v[-1]
        assert abs(run.q[k + 1] - q).max() < ROUNDING
    with pytest.raises(sd.SimulationError, match="is held over a step"):
        sd.simulate(arm, q, v, 0.2, 0.02, "dop853", control=hold + sd.Gravity())


def test_a_law_with_a_period_is_taken_anew_once_in_it(arm: sd.Model) -> None:
    goal = [0.3, 0.2, 0.1]
    slow = sd.PD(30.0, 5.0, goal, held=0.05)
    q, v = np.zeros(N), np.zeros(N)
    run = sd.simulate(arm, q, v, 0.2, 0.01, "rk4", control=slow)
    lanes = sd.rollout(arm, np.tile(q, (3, 1)), v, dt=0.01, steps=20, method="rk4", control=slow)
    assert abs(lanes.q[1] - run.q[1:]).max() < ROUNDING
    for k in range(20):
        if k % 5 == 0:
            tau = sd.PD(30.0, 5.0, goal)(arm, 0.0, q, v)
        end = sd.simulate(arm, q, v, 0.01, 0.01, "rk4", torque=tau)
        q, v = end.q[-1], end.v[-1]
        assert abs(run.q[k + 1] - q).max() < ROUNDING
    rates = sd.PD(30.0, 5.0, goal, held=0.05) + sd.PDGravity(3.0, 1.0, goal, held=0.02) + sd.Gravity()
    mixed = sd.simulate(arm, np.zeros(N), np.zeros(N), 0.2, 0.01, "rk4", control=rates)
    assert {"time_left_1", "time_left_2", "held_torque_1", "held_torque_2"} <= {*mixed.states} or len(mixed.states) == 4


def test_sums_of_sums_keep_every_law_and_limit(arm: sd.Model) -> None:
    """Their inputs have one name each: four laws of one kind, and limits within limits."""
    q, v = np.full(N, 0.1), np.zeros(N)
    laws = [sd.PD(k, 0.1 * k, np.full(N, 0.3 * k), held=False) for k in range(1, 6)]
    wanted = sum(law(arm, 0.0, q, v) for law in laws)
    one, first, last = laws[0], (laws[0] + laws[1]) + (laws[2] + laws[3]), laws[0] + (laws[1] + (laws[2] + laws[3]))
    for law in laws[1:]:
        one = one + law
    np.testing.assert_allclose(one(arm, 0.0, q, v), wanted, rtol=1e-14)
    for law in (first + laws[4], last + laws[4], laws[4] + first):
        np.testing.assert_allclose(law(arm, 0.0, q, v), wanted, rtol=1e-14)

    small, large = np.array([0.5, 1.0, 2.0]), np.full(N, 1.5)
    inner, outer = np.clip(wanted, -small, small), np.clip(wanted, -large, large)
    assert (one.limited_by(small).limited_by(large)(arm, 0.0, q, v) == np.clip(inner, -large, large)).all()
    assert (one.limited_by(large).limited_by(small)(arm, 0.0, q, v) == np.clip(outer, -small, small)).all()
    mixed = (one.limited_by(small) + laws[0].limited_by(large)).limited_by(large)
    beside = np.clip(laws[0](arm, 0.0, q, v), -large, large)
    np.testing.assert_allclose(mixed(arm, 0.0, q, v), np.clip(inner + beside, -large, large), rtol=1e-14)
    run = sd.rollout(arm, q, v, dt=1e-3, steps=2, control=mixed, method="rk4")
    assert (sd.simulate(arm, q, v, 2e-3, 1e-3, control=mixed).q[1:] == run.q).all()


def test_limits_clip_the_sum(arm: sd.Model) -> None:
    most = np.array([3.0, np.inf, 0.5])
    law = sd.PD(100.0, 5.0, [1.0, 1.0, -1.0]) + sd.Gravity()
    q, v = np.zeros(N), np.zeros(N)
    whole = law(arm, 0.0, q, v)
    assert (law.limited_by(most)(arm, 0.0, q, v) == np.clip(whole, -most, most)).all()
    assert (law.limited_by(3.0)(arm, 0.0, q, v) == np.clip(whole, -3.0, 3.0)).all()
    run = sd.rollout(arm, q, v, dt=1e-3, steps=5, control=law.limited_by(most))
    first = sd.step(arm, q, v, np.clip(whole, -most, most), 1e-3)
    assert abs(run.q[0] - first[0]).max() < ROUNDING
    with pytest.raises(sd.SimulationError, match=r"limits is .* expected"):
        law.limited_by([0.0, 1.0, 1.0])


def test_a_cost_is_summed_beside_laws_at_different_rates(arm: sd.Model) -> None:
    from spatialdyn.recursions.spec import TAU, Argument, Spec

    def toil(bodies: Any, tau: Any, cost: Any) -> None:
        cost[0] = tau[0] * tau[0]

    cost = sd.Cost(Spec("toil_of_laws", toil, None, (TAU,), Argument("cost", (1,), "", ""), "", ""))
    law = sd.PD(30.0, 5.0, [0.3, 0.2, 0.1], held=0.02) + sd.Gravity()
    run = sd.rollout(arm, np.zeros(N), np.zeros(N), dt=0.01, steps=10, control=law, cost=cost, record=1)
    assert np.isfinite(run.cost).all()
    plain = sd.rollout(arm, np.zeros(N), np.zeros(N), dt=0.01, steps=10, control=law)
    assert abs(run.q - plain.q).max() < ROUNDING


def test_references_may_vary_by_sample_and_step(arm: sd.Model) -> None:
    goals = np.random.default_rng(6).normal(size=(4, 5, N))
    found = sd.rollout(arm, np.zeros(N), np.zeros(N), dt=0.01, control=sd.PDPlus(10.0, 3.0, goals))
    alone = sd.rollout(arm, np.zeros(N), np.zeros(N), dt=0.01, control=sd.PDPlus(10.0, 3.0, goals[2]))
    assert found.q.shape == (4, 5, N)
    assert (found.q[2] == alone.q).all()


def test_samples_follow_paths_and_clocks_of_their_own(arm: sd.Model) -> None:
    draw = np.random.default_rng(7)
    path = sd.spline([0.0, 0.04, 0.08, 0.12, 0.2], 0.3 * draw.normal(size=(4, 5, N)))
    q, v = 0.1 * draw.normal(size=(4, N)), np.zeros((4, N))
    run = sd.rollout(arm, q, v, dt=0.01, steps=15, control=sd.ComputedTorque(30.0, 8.0, path))
    of_one = sd.ComputedTorque(30.0, 8.0, path[2])
    alone = sd.rollout(arm, q[2], v[2], dt=0.01, steps=15, control=of_one)
    assert (run.q[2] == alone.q).all()
    torque = sd.ComputedTorque(30.0, 8.0, path)(arm, 0.05, q, v)
    assert (torque[2] == of_one(arm, 0.05, q[2], v[2])).all()
    clocks = draw.uniform(-0.05, 0.2, (4, 1))  # so that lanes are in other segments
    run = sd.rollout(arm, q, v, dt=0.01, steps=15, control=of_one, states={"clock": clocks})
    for b in range(4):
        alone = sd.rollout(arm, q[b], v[b], dt=0.01, steps=15, control=of_one, states={"clock": clocks[b]})
        assert (run.q[b] == alone.q).all()
    single = sd.simulate(
        arm, q[1], v[1], 0.15, 0.01, "semi_implicit_euler", control=of_one, states={"clock": clocks[1]}
    )
    assert (run.q[1] == single.q[1:]).all()
    with pytest.raises(sd.ShapeError, match=r"centre of spec .* has shape \(4, 1, 3\)"):
        sd.simulate(arm, q[0], v[0], 0.1, 0.01, control=sd.PDPlus(1.0, 1.0, path))


# --- gains ----------------------------------------------------------------------------------------------


def test_gains_that_are_none_are_refused_by_their_eigenvalue(arm: sd.Model) -> None:
    path = sd.quintic([0.0] * N, [1.0] * N, 1.0)
    bad = np.diag([1.0, 2.0, -0.5])
    with pytest.raises(sd.SimulationError, match=r"Kp has the eigenvalue -0.5, expected above 0"):
        sd.ComputedTorque(bad, 1.0, path)
    with pytest.raises(sd.SimulationError, match="Kd is not symmetric, by up to 1, expected"):
        sd.PDPlus(1.0, np.eye(N) + np.eye(N, k=1), path)
    with pytest.raises(sd.SimulationError, match="kd has the eigenvalue -1, expected 0 or more"):
        sd.PD([1.0] * N, [-1.0] * N, [0.0] * N)
    with pytest.raises(sd.NonFiniteError, match="q_d is"):
        sd.PDGravity(1.0, 1.0, [np.nan] * N)
    with pytest.raises(sd.SpatialDynError, match='2 coordinates that are numbers, expected the 3 of robot "arm"'):
        sd.simulate(arm, [0.0] * N, [0.0] * N, 0.1, 0.01, control=sd.PDPlus(1.0, 1.0, sd.quintic([0, 0], [1, 1], 1.0)))
    with pytest.raises(sd.SimulationError, match="held is -1"):
        sd.Gravity(held=-1)
    with pytest.raises(sd.NonFiniteError, match=r"v_ref is \[nan"):
        sd.PD(1.0, 1.0, [0.0] * N, [np.nan] * N)


def test_values_that_are_not_finite_are_refused_by_name(arm: sd.Model) -> None:
    from spatialdyn.recursions.spec import TAU, Argument, Q, Spec

    def pull(bodies: Any, q: Any, reach: Any, tau: Any) -> None:
        for i in range(len(tau)):
            tau[i] = reach[i] - q[i]

    spec, rest = Spec("pull", pull, None, (Q, Argument("reach", ("nv",), "rad", "")), TAU, "", ""), np.zeros(N)
    law = sd.Control(spec, {"reach": [0.0, np.nan, 0.0]})
    said = 'reach of spec "pull" has numbers that are not finite'
    with pytest.raises(sd.NonFiniteError, match=said):
        sd.rollout(arm, rest, rest, dt=0.01, steps=2, control=law)
    with pytest.raises(sd.NonFiniteError, match=said):
        sd.simulate(arm, rest, rest, 0.1, 0.01, control=law)
    goals = np.zeros((5, 2, N))
    goals[3, 1, 0] = np.nan
    with pytest.raises(sd.SimulationError, match=f"sample 3: {said}"):
        sd.rollout(arm, rest, rest, dt=0.01, control=sd.Control(spec, {"reach": goals}))
    found = sd.rollout(arm, rest, rest, dt=0.01, control=sd.Control(spec, {"reach": goals}), check=False)
    assert np.isfinite(found.q).all((1, 2)).tolist() == [True, True, True, False, True]


def test_lqr_holds_what_falls() -> None:
    pytest.importorskip("scipy")
    model = sd.load_urdf("two_link")
    up, rest = np.array([-np.pi / 2, 0.0]), np.zeros(2)
    hold = sd.generalized_gravity(model, up)
    for dt in (None, 0.01):
        A, B = sd.linearize(model, up, rest, hold, dt, *(() if dt is None else ("semi_implicit_euler",)))
        found = sd.lqr(A, B, np.eye(4), 0.1 * np.eye(2), discrete=dt is not None)
        assert (abs(found.poles).max() < 1.0) if dt else (found.poles.real.max() < 0.0)
        run = sd.simulate(
            model, up + 0.1, rest, 20.0, 0.01, "semi_implicit_euler", control=found.feedback(up, tau=hold)
        )
        assert abs(run.q[-1] - up).max() < 1e-3
    with pytest.raises(sd.SpatialDynError, match="R has the eigenvalue 0, expected above 0"):
        sd.lqr(A, B, np.eye(4), np.zeros((2, 2)))
    with pytest.raises(sd.SpatialDynError, match="no feedback stabilizes"):
        sd.lqr(2.0 * np.eye(2), np.zeros((2, 1)), np.eye(2), np.eye(1))


def test_a_closed_step_is_stable_below_the_bound_and_names_its_joint() -> None:
    """ω h < 2 √(1 + ζ²) - 2 ζ, exact for one joint without gravity under a torque held over the step."""
    solid = (1.0, (0.0, 0.0, 0.5), 0.1 * np.eye(3))
    model = sd.ModelBuilder("rod").add_body("rod", None, axis=(0, 0, 1), inertia=solid).build()
    inertia, h = float(sd.crba(model, [0.0])[0, 0]), 0.01
    for zeta in (0.1, 0.7):
        most = float(sd.largest_step(1.0, zeta)) / h
        for part, stable in ((0.999, True), (1.001, False)):
            Kp, Kd = sd.critical_gains(part * most, zeta)
            law = sd.PD([inertia * float(Kp)], [inertia * float(Kd)], [0.0])
            found = sd.closed_step(model, law, [0.0], [0.0], h, "semi_implicit_euler")
            assert (found.radius < 1.0) == stable
    with pytest.raises(sd.SimulationError, match='most in joint "rod'):
        found.check()
    arm = sd.load_urdf("ur5")
    stiff = sd.PD(np.r_[100.0, 100.0, 100.0, 10.0, 10.0, 500.0], 1.0, np.zeros(6))
    assert sd.closed_step(arm, stiff, np.zeros(6), np.zeros(6), 0.02, "semi_implicit_euler").joint == arm.joints[6].name
    two = sd.load_urdf("two_link")  # whose second joint is shaken more by a stiff first one than that itself
    for k in (0, 1):
        gains = np.where(np.arange(2) == k, 1e5, 10.0)
        found = sd.closed_step(two, sd.PD(gains, 1.0, np.zeros(2)), np.zeros(2), np.zeros(2), 0.05)
        assert found.joint == two.joints[1 + k].name


@pytest.mark.parametrize("call", ["simulate", "rollout"])
def test_a_law_too_stiff_for_its_step_is_warned_of_once_by_joint(call: str) -> None:
    """At the bound of one joint without gravity; not of a law that lets a pendulum fall, which is no fault of dt."""
    solid = (1.0, (0.0, 0.0, 0.5), 0.1 * np.eye(3))
    model = sd.ModelBuilder("rod").add_body("rod", None, axis=(0, 0, 1), inertia=solid).build()
    inertia, h = float(sd.crba(model, [0.0])[0, 0]), 0.01 if call == "simulate" else 0.02

    def run(law: sd.Control, dt: float = h, check: bool = True) -> None:
        if call == "simulate":
            sd.simulate(model, [0.0], [0.0], 3 * dt, dt, "semi_implicit_euler", control=law)
        else:
            sd.rollout(model, np.zeros((2, 1)), [0.0], dt=dt, steps=3, control=law, check=check)

    def law(part: float, zeta: float) -> sd.Control:
        Kp, Kd = sd.critical_gains(part * float(sd.largest_step(1.0, zeta)) / h, zeta)
        return sd.PD([inertia * float(Kp)], [inertia * float(Kd)], [0.0])

    for zeta in (0.1, 0.7):
        run(law(0.999, zeta))  # warnings are errors here
        stiff = law(1.001, zeta)
        if call == "rollout":
            run(stiff, check=False)
        said = rf'too stiff for steps of {h:g} s .* joint "rod.*or a dt of {0.5 * h:g} s'
        with pytest.warns(UserWarning, match=said):
            run(stiff)
        run(stiff)
        run(stiff, 0.5 * h)
    with pytest.warns(UserWarning, match="too stiff"):
        run((stiff + sd.Gravity()).limited_by([50.0]))
    falling = sd.ModelBuilder("falling").add_body("rod", None, axis=(0, 1, 0), inertia=solid).build()
    for method in ("rk4", "semi_implicit_euler"):
        sd.simulate(falling, [0.0], [0.0], 0.2, 0.05, method, control=sd.PD([0.1], [0.01], [0.0]))


def test_the_stiffness_of_gravity_is_that_of_the_notes() -> None:
    assert sd.gravity_stiffness_bound(sd.load_urdf("ur5"), 20000) == pytest.approx(64.4, abs=1.0)


def test_a_number_is_a_gain_for_each_freedom_of_any_robot(arm: sd.Model) -> None:
    """Of a floating base nq is 7 and nv 6: a reference (nq,) does not tell how many gains there are."""
    solid = (1.0, (0.1, 0.0, 0.2), 0.1 * np.eye(3))
    free = sd.ModelBuilder("free", "world").add_body("base", None, "floating", inertia=solid).build()
    q_d = sd.neutral(free)
    q, v = sd.integrate(free, q_d, np.full(6, 0.1)), np.full(6, 0.2)
    each = np.full(6, 3.0)
    for make in (sd.PD, sd.PDGravity, sd.PDPlus, sd.ComputedTorque, sd.Passivity, sd.EnergyShaping):
        assert (make(3.0, 3.0, q_d)(free, 0.0, q, v) == make(each, each, q_d)(free, 0.0, q, v)).all()
    shaping, many = sd.EnergyShaping(3.0, 3.0, q_d, held=0.1), sd.EnergyShaping(each, each, q_d)
    assert shaping.energy(free, q, v) == pytest.approx(many.energy(free, q, v), rel=1e-15)
    both = (sd.PD(3.0, 1.0, q_d) + sd.PD(each, 1.0, q_d, held=0.02)).limited_by(each)
    assert np.isfinite(sd.rollout(free, q, v, dt=0.01, steps=3, control=both).q).all()
    matrix = sd.EnergyShaping(3.0 * np.eye(N), 1.0, np.zeros(N))
    assert matrix.energy(arm, np.ones(N), np.zeros(N)) == pytest.approx(4.5)
    with pytest.raises(sd.ShapeError, match=r"kp of spec .* has shape \(4,\), expected \(3,\)"):
        sd.EnergyShaping(np.ones(4), 1.0, np.zeros(N)).energy(arm, np.ones(N), np.zeros(N))


def test_state_feedback_drives_each_freedom_once() -> None:
    with pytest.raises(sd.SimulationError, match=r"joints are \[0, 0\], expected each once"):
        sd.StateFeedback(np.ones((2, 6)), np.zeros(3), joints=[0, 0])


def test_lqr_refuses_a_cost_that_leaves_it_unstable() -> None:
    pytest.importorskip("scipy")
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    step = np.eye(2) + 0.1 * A, 0.1 * B
    for a, b, discrete in ((A, B, False), (*step, True)):
        with pytest.raises(sd.SpatialDynError, match="Q leaves a mode unweighted that does not decay"):
            sd.lqr(a, b, np.zeros((2, 2)), [[1.0]], discrete=discrete)
    assert not sd.lqr(A - np.eye(2), B, np.zeros((2, 2)), [[1.0]]).K.any()  # which is stable by itself
    for a, b in ((np.zeros((0, 0)), np.zeros((0, 0))), (A, np.zeros((2, 0)))):
        with pytest.raises(sd.ShapeError, match="of 1 or more"):
            sd.lqr(a, b, np.eye(len(a)), np.zeros((0, 0)))


def test_a_period_does_not_hide_an_input_of_its_name(arm: sd.Model) -> None:
    """The law's own input "period" keeps its value: its torque is 3 in the first step."""
    from spatialdyn.recursions.spec import TAU, Argument, Q, Spec

    def pull(bodies: Any, q: Any, period: Any, tau: Any) -> None:
        for i in range(len(tau)):
            tau[i] = period[0] - q[i]

    spec = Spec("pull_of_period", pull, None, (Q, Argument("period", (1,), "", "")), TAU, "", "")
    law = sd.Control(spec, {"period": [3.0]}, held=0.02)
    assert (law(arm, 0.0, np.zeros(N), np.zeros(N)) == 3.0).all()
    twice = sd.rollout(arm, np.zeros(N), np.zeros(N), dt=0.01, steps=4, control=law)
    assert set(twice.states) == {"time_left", "held_torque"}


def test_a_law_keeps_copies_of_its_values(arm: sd.Model) -> None:
    """What is kept between calls is of its values as they are."""
    kp, goal, q, v = np.full(N, 4.0), np.full(N, 0.5), np.zeros(N), np.zeros(N)
    law = sd.PD(kp, 1.0, goal)
    before = law(arm, 0.0, q, v)
    kp[:], goal[:] = 0.0, 0.0
    assert (law(arm, 0.0, q, v) == before).all()
    with pytest.raises(ValueError, match="read-only"):
        law.values["q_ref"][0] = 1.0
    law.values["q_ref"] = np.ones(N)  # which may be written to
    assert (law(arm, 0.0, q, v) == 2.0 * before).all()
    law.values["q_ref"][:] = 0.0
    assert not law(arm, 0.0, q, v).any()
    other = sd.ModelBuilder("rod").add_body("rod", None, axis=(0, 0, 1)).build()
    with pytest.raises(sd.ShapeError, match=r"has shape \(3,\), expected \(1,\)"):
        law(other, 0.0, [0.0], [0.0])


@pytest.mark.parametrize("kind", ["trapezoid", "spline", "quintic"])
def test_a_jump_of_acceleration_leaves_an_error_of_order_one(kind: str) -> None:
    """By rk4 with steps that end at the jumps, whose one side is taken for both; order 4 before the first."""
    model = sd.load_urdf("two_link")
    path = {
        "trapezoid": sd.trapezoid([0.0, 0.0], [0.5, -0.25], 1.0, 2.0), "quintic": sd.quintic([0, 0], [0.5, -0.25], 1.0),
        "spline": sd.spline([0.0, 0.4, 1.0], [[0.0, 0.0], [0.3, 0.1], [0.2, 0.2]]),
    }[kind]  # fmt: skip
    law, first = sd.ComputedTorque(*sd.critical_gains(4.0), path), 0.4
    whole, before = [], []
    for dt in (0.02, 0.01, 0.005):
        run = sd.simulate(model, [0.0, 0.0], [0.0, 0.0], 1.2, dt, "rk4", control=law)
        off = abs(run.q - path(run.t).q).max(1)
        whole.append(off.max())
        before.append(off[run.t < first + 0.5 * dt].max())
    order = 4.0 if kind == "quintic" else 1.0
    assert np.log2(whole[0] / whole[1]) == pytest.approx(order, abs=0.1)
    assert np.log2(whole[1] / whole[2]) == pytest.approx(order, abs=0.1)
    assert np.log2(before[0] / before[1]) == pytest.approx(4.0, abs=0.2)
