"""Motions of robots with mimic joints: those of the same mechanism under couplers, by every method, energy kept."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scenes
from numpy.typing import NDArray
from slow import slow_but

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec, V
from spatialdyn.recursions.tree.rnea import rnea

Array = NDArray[np.float64]
COUPLED = 1e-10  # of the motion under constraints with projection, which are the same steps
BODY = (0.8, (0.0, 0.02, -0.2), np.diag([0.02, 0.03, 0.01]))
FINGER = (0.1, (0.0, 0.0, 0.05), np.diag([2e-4, 3e-4, 1e-4]))
DT, STEPS = 1e-3, 60
EXPLICIT = ("explicit_euler", "semi_implicit_euler", "velocity_verlet", "rk4")
FIXED = [name for name, x in sd.integrators.items() if x.family is not None]


def gripper(mimic: bool = True, springs: bool = False) -> sd.Model:
    """An arm with two fingers, one a slider, that follow a third by other ratios; a spring drives that one."""
    builder = sd.ModelBuilder("gripper").add_body("arm", axis=(0, 1, 0), inertia=BODY, joint_name="lift", damping=0.1)
    builder.add_body("wrist", "arm", axis=(1, 0, 0), inertia=BODY, joint_name="turn", placement=_at(0.0, 0.0, -0.4))
    first = {"damping": 0.05, "friction": 0.02, "limits": (-0.4, 0.4)}
    builder.add_body(
        "thumb", "wrist", axis=(0, 0, 1), inertia=FINGER, joint_name="grip", placement=_at(0.1, 0, 0), **first
    )
    follow = {"leader": "grip", "multiplier": -0.5, "offset": 0.1}
    builder.add_body(
        "index",
        "wrist",
        axis=(0, 1, 0),
        inertia=FINGER,
        joint_name="index",
        placement=_at(-0.1, 0, 0),
        mimic=follow,
        damping=0.04,
        friction=0.01,
    )
    slide = {"leader": "grip", "multiplier": 0.2}
    builder.add_body("jaw", "index", "prismatic", axis=(1, 0, 0), inertia=FINGER, joint_name="jaw", mimic=slide)
    if springs:
        builder.add_series_elastic("grip", 3.0, 0.01, 2e-5, 20.0)
    return builder.build(mimic=mimic)


def _at(x: float, y: float, z: float) -> Array:
    made = np.eye(4)
    made[:3, 3] = x, y, z
    return made


MODEL, FREE = gripper(), gripper(False)
COUPLERS = [sd.CouplerConstraint("index", "grip", -0.5, 0.1), sd.CouplerConstraint("jaw", "grip", 0.2)]
Q0, V0, TAU0 = np.array([0.4, -0.2, 0.3]), np.array([0.5, 1.0, -2.0]), np.array([0.1, -0.05, 0.02])
OWN = [FREE.joint(name).idx_v for name in ("lift", "turn", "grip")]
SAME = [MODEL.joint(name).idx_v for name in ("lift", "turn", "grip")]


def whole(q: Array, v: Array) -> tuple[Array, Array]:
    """The state of the whole tree."""
    return q[..., MODEL.mimic_index] * MODEL.mimic_ratio + MODEL.mimic_offset, v @ np.asarray(MODEL.mimic_matrix).T


def run(model: sd.Model, method: str | None = None, **more: Any) -> Any:
    """A short motion; of the free tree under couplers."""
    q, v = (Q0, V0) if model is MODEL else whole(Q0, V0)
    if model is FREE:
        more["constraints"] = sd.Constraints(FREE, COUPLERS)
    return scenes.simulate(model, q, v, STEPS * DT, DT, method, **{"friction": False, **more})


@pytest.mark.parametrize("method", slow_but(("semi_implicit_euler", "rk4"), (*EXPLICIT, "variational")))
def test_a_motion_is_that_of_the_tree_under_couplers(method: str) -> None:
    ours, theirs = run(MODEL, method), run(FREE, method)
    for mine, other in ((ours.q, theirs.q), (ours.v, theirs.v)):
        assert abs(mine[:, SAME] - other[:, OWN]).max() < COUPLED * abs(other).max()
    q, v = whole(ours.q, ours.v)
    np.testing.assert_allclose(q, theirs.q, atol=COUPLED)
    np.testing.assert_allclose(v, theirs.v, atol=10 * COUPLED)


@pytest.mark.parametrize("method", slow_but(("rk4", "gauss4"), sd.integrators))
def test_energy_is_kept_to_the_order_of_the_method(method: str) -> None:
    """Halving the step reduces the error of the energy by 2^order, down to rounding."""
    coarse, fine = (sd.simulate(sd.Scene(MODEL, friction=False), Q0, V0, 0.2, dt, method) for dt in (4e-3, 2e-3))
    errors = [abs(x.energy - x.energy[0]).max() for x in (coarse, fine)]
    order = sd.integrators[method].order if sd.integrators[method].family is not None else 0
    assert errors[1] <= max(0.8 * errors[0] / 2.0 ** (order - 1) if order else errors[0], 1e-9)


@pytest.mark.parametrize("method", slow_but(("rk4", "gauss4"), FIXED))
def test_a_torque_function_takes_the_same_steps(method: str) -> None:
    """It runs in Python, where the reduced recursions are public calls."""
    asked = run(MODEL, method, torque=lambda t, q, v: TAU0)
    np.testing.assert_allclose(asked.q, run(MODEL, method, torque=TAU0).q, rtol=1e-13, atol=1e-14)


def test_external_forces_act_on_the_whole_tree() -> None:
    """A force on a finger that follows: by its power on the free tree."""
    push = np.zeros((MODEL.njoints, 6))
    push[MODEL.joint("index").row if MODEL.njoints == len(MODEL.bodies) else 4] = [0.3, -0.2, 0.5, 0.01, 0.02, 0.0]
    ours, theirs = run(MODEL, "rk4", fext=push), run(FREE, "rk4", fext=push)
    assert abs(ours.q[-1, SAME] - theirs.q[-1, OWN]).max() < COUPLED
    assert abs(ours.q[-1] - run(MODEL, "rk4").q[-1]).max() > 1e-4


@pytest.mark.parametrize("method", ["rk4", "semi_implicit_euler", "variational"])
def test_springs_drive_joints_that_lead_others(method: str) -> None:
    """As on the free tree under couplers; their torques and energy are its."""
    ours, theirs = gripper(True, True), gripper(False, True)
    couplers, rotor = sd.Constraints(theirs, COUPLERS), "grip_rotor"

    def placed(model: sd.Model, x: Array, of_grip: float, tree: sd.Model) -> Array:
        made = np.zeros(model.nv)
        for joint in tree.joints[1:]:
            if tree is FREE or joint.mimic is None:
                made[model.joint(joint.name).idx_v] = x[joint.idx_v]
        made[model.joint(rotor).idx_v] = of_grip
        return made

    q, v = placed(ours, Q0, 20.0 * Q0[2] + 0.5, MODEL), placed(ours, V0, 20.0 * V0[2], MODEL)
    whole_q, whole_v = whole(Q0, V0)
    whole_q, whole_v = placed(theirs, whole_q, 20.0 * Q0[2] + 0.5, FREE), placed(theirs, whole_v, 20.0 * V0[2], FREE)
    assert sd.spring_energy(ours, q) == pytest.approx(sd.spring_energy(theirs, whole_q), rel=1e-12)
    mine = sd.simulate(sd.Scene(ours, friction=False), q, v, 0.03, 5e-4, method)
    other = sd.simulate(sd.Scene(theirs, friction=False, constraints=couplers), whole_q, whole_v, 0.03, 5e-4, method)
    names = ("lift", "turn", "grip", rotor)
    places = [[model.joint(name).idx_v for name in names] for model in (ours, theirs)]
    assert abs(mine.q[:, places[0]] - other.q[:, places[1]]).max() < 100 * COUPLED * abs(other.q).max()
    np.testing.assert_allclose(mine.energy - mine.energy[0], other.energy - other.energy[0], atol=1e-7)
    many = sd.rollout(sd.Scene(ours, friction=False), q, v, dt=5e-4, steps=60, method=method)
    np.testing.assert_allclose(many.q, mine.q[1:], rtol=1e-12)


def test_a_rollout_is_many_simulations() -> None:
    rng = np.random.default_rng(1)
    q, v, tau = Q0 + 0.1 * rng.normal(size=(5, 3)), rng.normal(size=(5, 3)), rng.normal(size=(5, 3)) * 0.1
    many = sd.rollout(sd.Scene(MODEL, friction=False), q, v, tau[:, None], dt=DT, steps=STEPS)
    for k in range(5):
        one = sd.simulate(
            sd.Scene(MODEL, friction=False), q[k], v[k], STEPS * DT, DT, "semi_implicit_euler", torque=tau[k]
        )
        np.testing.assert_allclose(many.q[k], one.q[1:], rtol=1e-14 if numba_kernels.PLAIN else 0.0)
    hold = sd.PD(kp=np.full(3, 5.0), kd=np.full(3, 1.0), q_ref=Q0)
    held = sd.rollout(sd.Scene(MODEL, friction=False), q, v, dt=DT, steps=20000, control=hold, record="last")
    at_rest = np.linalg.solve(np.diag([5.0] * 3), -sd.generalized_gravity(MODEL, held.q)[..., None])[..., 0] + Q0
    np.testing.assert_allclose(held.q, at_rest, atol=1e-3)


def test_a_law_takes_the_models_own_coordinates_and_may_call_recursions() -> None:
    """Gravity compensation by the RNEA, on rows that follow: the robot stays."""
    work = sd.recursions.SPECS["rnea"].work

    def weightless(bodies: Any, scratch: Any, q: Any, v: Any, tau: Any) -> None:
        rnea(bodies, scratch, q, [0.0 * x for x in v], None, None, tau)

    law = Spec("weightless", weightless, work, (Q, V), TAU, "g(q).", "")
    still = sd.simulate(sd.Scene(MODEL, friction=False), Q0, np.zeros(3), 0.2, DT, "rk4", control=sd.Control(law))
    assert abs(still.q - Q0).max() < 1e-12
    asked = sd.simulate(
        sd.Scene(MODEL, friction=False),
        Q0,
        np.zeros(3),
        0.02,
        DT,
        "rk4",
        control=sd.Control(law),
        torque=lambda t, q, v: 0.0 * v,
    )
    assert abs(asked.q - Q0).max() < 1e-12

    def walker(bodies: Any, q: Any, v: Any, tau: Any) -> None:
        tau[0] = bodies[1].X.p.x * v[0]

    bad = Spec("walker", walker, None, (Q, V), TAU, "", "")
    with pytest.raises(sd.ModelError, match='spec "walker" walks the tree of a robot with mimic joints'):
        sd.simulate(sd.Scene(MODEL, friction=False), Q0, V0, 0.02, DT, "rk4", control=sd.Control(bad))


def test_a_cost_sums_the_models_own_coordinates() -> None:
    def effort(bodies: Any, q: Any, v: Any, tau: Any, cost: Any) -> None:
        cost[0] = v[2] * v[2]

    spec = Spec("effort", effort, None, (Q, V, TAU), Argument("cost", (1,), "", "of a step"), "", "")
    ran = sd.rollout(sd.Scene(MODEL, friction=False), Q0, V0, dt=DT, steps=STEPS, cost=sd.Cost(spec), record=1)
    before = np.concatenate([V0[2:], ran.v[:-1, 2]])
    np.testing.assert_allclose(np.asarray(ran.cost).ravel()[-1], (before**2).sum(), rtol=1e-2)


@pytest.mark.parametrize("method", slow_but(("rk4", "semi_implicit_euler"), FIXED))
def test_derivatives_of_a_step_are_those_of_differences(method: str) -> None:
    h, n = 1e-6, MODEL.nv
    A, B = sd.step_derivatives(sd.Scene(MODEL, friction=False), Q0, V0, TAU0, 5e-3, method)
    rates = np.zeros((2 * n, 3 * n))
    for k in range(3 * n):
        d = np.zeros(3 * n)
        d[k] = h
        ends = []
        for s in (1, -1):
            q = sd.integrate(MODEL, Q0, s * d[:n])
            ran = sd.simulate(
                sd.Scene(MODEL, friction=False),
                q,
                V0 + s * d[n : 2 * n],
                5e-3,
                5e-3,
                method,
                torque=TAU0 + s * d[2 * n :],
            )
            ends.append(np.concatenate([ran.q[-1], ran.v[-1]]))
        rates[:, k] = (ends[0] - ends[1]) / (2 * h)
    np.testing.assert_allclose(np.hstack([A, B]), rates, atol=2e-8 * abs(rates).max())


def test_linearize_is_the_limit_of_a_step_and_step_takes_it() -> None:
    A, B = sd.linearize(sd.Scene(MODEL, friction=False), Q0, V0, TAU0)
    dt = 1e-7
    by_state, by_tau = sd.step_derivatives(sd.Scene(MODEL, friction=False), Q0, V0, TAU0, dt, "explicit_euler")
    np.testing.assert_allclose((by_state - np.eye(6)) / dt, A, atol=1e-6 * abs(A).max())
    np.testing.assert_allclose(by_tau / dt, B, rtol=1e-6, atol=1e-9)
    q, v = sd.step(MODEL, Q0, V0, TAU0, DT, "rk4")
    one = sd.simulate(sd.Scene(MODEL, friction=False), Q0, V0, DT, DT, "rk4", torque=TAU0)
    np.testing.assert_allclose(q, one.q[-1], rtol=1e-13)
    np.testing.assert_allclose(v, one.v[-1], rtol=1e-12)


def test_limits_stop_the_joint_that_leads() -> None:
    v0 = [0.5, 1.0, -8.0]
    free = sd.simulate(sd.Scene(MODEL, friction=False), Q0, v0, 0.5, DT)
    ran = sd.simulate(sd.Scene(MODEL, limits=True, friction=False), Q0, v0, 0.5, DT)
    at = MODEL.joint("grip").idx_q
    assert free.method == "rk4"
    assert ran.method == "semi_implicit_euler"
    assert free.q[:, at].min() < -0.5
    assert ran.q[:, at].min() > -0.401
    asked = sd.simulate(sd.Scene(MODEL, limits=True, friction=False), Q0, v0, 0.05, DT, torque=lambda t, q, v: 0.0 * v)
    np.testing.assert_allclose(asked.q, ran.q[:51], atol=1e-12)


def test_friction_of_joints_that_follow_acts_on_their_leader() -> None:
    """Smooth friction and damping of every joint of the free tree under couplers."""
    ours = sd.Friction.of(MODEL)
    k = MODEL.joint("grip").idx_v
    assert ours.viscous[k] == pytest.approx(0.05 + 0.25 * 0.04)
    assert ours.coulomb[k] == pytest.approx(0.02 + 0.5 * 0.01)
    damped = {"friction": sd.Friction.of(MODEL, coulomb=0.0, static=0.0, smoothing=0.1), "friction_method": "smooth"}
    other = {"friction": sd.Friction.of(FREE, coulomb=0.0, static=0.0, smoothing=0.1), "friction_method": "smooth"}
    mine, theirs = run(MODEL, "rk4", **damped), run(FREE, "rk4", **other)
    assert abs(mine.q[-1, SAME] - theirs.q[-1, OWN]).max() < COUPLED
    assert abs(mine.q[-1] - run(MODEL, "rk4").q[-1]).max() > 1e-4


@pytest.mark.parametrize("way", ["implicit", "lugre", "smooth"])
def test_friction_runs_in_programs_and_in_python_alike(way: str) -> None:
    rubs = sd.Friction(coulomb=0.05, viscous=0.1, smoothing=0.2, bristle_stiffness=50.0, bristle_damping=0.5)
    given = {"friction": rubs, "friction_method": way}
    mine, asked = run(MODEL, torque=TAU0, **given), run(MODEL, torque=lambda t, q, v: TAU0, **given)
    assert mine.method == ("rk4" if way == "smooth" else "semi_implicit_euler")
    np.testing.assert_allclose(asked.q, mine.q, atol=1e-12)
    motor = sd.Motor(torque_constant=0.05, resistance=1.0, voltage=24.0, ratio=10.0)
    if way == "implicit":
        np.testing.assert_allclose(run(MODEL, torque=TAU0, motor=motor, **given).q[-1], mine.q[-1], atol=0.1)


def test_work_is_recorded_and_closes_the_ledger() -> None:
    ran = run(MODEL, "rk4", torque=TAU0, record="work")
    assert abs(sd.energy_ledger(ran).error).max() < 1e-9


HELD = [
    sd.PointConstraint("jaw", axes="y", at_b=sd.frame_placement(MODEL, Q0, "jaw")[:3, 3]),
    sd.VelocityConstraint([[0.3, 1.0, 0.2]]),
]


def held(model: sd.Model) -> sd.Constraints:
    """A finger that follows stays in a plane, and joints with coordinates of their own turn together."""
    if model is MODEL:
        return sd.Constraints(MODEL, HELD)
    A = np.zeros((1, FREE.nv))
    A[0, OWN] = np.asarray(HELD[1].A)[0, SAME]  # type: ignore[union-attr]
    return sd.Constraints(FREE, [HELD[0], sd.VelocityConstraint(A), *COUPLERS])


def ground(model: sd.Model, **more: Any) -> sd.Contacts:
    """A slope into which one finger runs, and along it; another is just above it."""
    here, ahead = (sd.frame_placement(MODEL, x, "jaw")[:3, 3] for x in (Q0, Q0 + 1e-6 * V0))
    way = (here - ahead) / np.linalg.norm(here - ahead)
    normal = way + 0.5 * np.cross(way, [0.6, 0.0, 0.8])
    flat, points = sd.Plane(normal / np.linalg.norm(normal), 0.0), {"jaw": 0.02, "thumb": 0.01}
    gap = sd.contact_gaps(MODEL, sd.Contacts(MODEL, points, terrain=flat), Q0).min()
    return sd.Contacts(model, points, 0.5, terrain=sd.Plane(flat.normal, gap - 1e-3), tolerance=1e-12, **more)


@pytest.mark.parametrize("method", slow_but(("semi_implicit_euler",), EXPLICIT))
@pytest.mark.parametrize("stabilization", [None, 0.02])
def test_constraints_hold_joints_that_follow(method: str, stabilization: float | None) -> None:
    """As on the free tree under couplers beside them; nothing is gained or lost."""
    scenes_of = [sd.Scene(x, friction=False, constraints=held(x), stabilization=stabilization) for x in (MODEL, FREE)]
    v0 = sd.project_velocity(MODEL, held(MODEL), Q0, V0)
    q, v = whole(Q0, v0)
    ours = sd.simulate(scenes_of[0], Q0, v0, STEPS * DT, DT, method)
    theirs = sd.simulate(scenes_of[1], q, v, STEPS * DT, DT, method)
    scale = 1.0 if stabilization is None else 1e4  # the couplers there are open by what a stage leaves
    assert abs(ours.q[:, SAME] - theirs.q[:, OWN]).max() < scale * COUPLED
    assert abs(ours.v[:, SAME] - theirs.v[:, OWN]).max() < 10 * scale * COUPLED
    many = sd.rollout(scenes_of[0], Q0, v0, dt=DT, steps=STEPS, method=method)
    np.testing.assert_allclose(many.q, ours.q[1:], rtol=0.0, atol=1e-13)


def test_rows_of_constraints_are_of_the_whole_tree() -> None:
    """Where the joint that follows comes first."""
    made = sd.ModelBuilder("pair").add_body("a", axis=(0, 1, 0), inertia=BODY, joint_name="z")
    follow = {"leader": "z", "multiplier": -0.5, "offset": 0.1}
    model = made.add_body("b", axis=(1, 0, 0), inertia=BODY, joint_name="b", mimic=follow).build(mimic=True)
    held = sd.Constraints(model, [sd.VelocityConstraint([[2.0]]), sd.CouplerConstraint("b", "z", 0.25, 0.3)])
    np.testing.assert_allclose(sd.constraint_jacobian(model, held, [0.4]), [[2.0], [-0.75]])
    np.testing.assert_allclose(sd.constraint_error(model, held, [0.4]), [0.0, -0.75 * 0.4 + 0.1 - 0.3])


def test_constrained_dynamics_are_those_of_the_tree_under_couplers() -> None:
    (q, v), G, load = whole(Q0, V0), np.asarray(MODEL.mimic_matrix), np.zeros(FREE.nv)
    load[OWN] = TAU0[SAME]
    ours = sd.constrained_dynamics(MODEL, held(MODEL), Q0, V0, TAU0)
    theirs = sd.constrained_dynamics(FREE, held(FREE), q, v, load)
    np.testing.assert_allclose(G @ ours.a, theirs.a, rtol=1e-11)
    np.testing.assert_allclose(ours.force, theirs.force[:2], rtol=1e-11)
    J, drift = sd.constraint_jacobian(MODEL, held(MODEL), Q0), sd.constraint_drift(MODEL, held(MODEL), Q0, V0)
    np.testing.assert_allclose(J, sd.constraint_jacobian(FREE, held(FREE), q)[:2] @ G, atol=1e-15)
    np.testing.assert_allclose(sd.constrained_dynamics(MODEL, Q0, V0, TAU0, J, drift).a, ours.a, rtol=1e-11)
    exact = sd.exact(MODEL, sd.constrained_dynamics, 100, constraints=held(MODEL))(Q0, V0, TAU0)
    np.testing.assert_allclose(ours.a, np.array(exact[0], float), rtol=1e-12)
    found, e = sd.constrained_dynamics_derivatives(MODEL, held(MODEL), Q0, V0, TAU0), 1e-6
    for k, unit in enumerate(e * np.eye(3)):
        ends = [sd.constrained_dynamics(MODEL, held(MODEL), Q0 + s * unit, V0, TAU0) for s in (1, -1)]
        np.testing.assert_allclose(found.da_dq[:, k], (ends[0].a - ends[1].a) / (2 * e), rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(
            found.dforce_dq[:, k], (ends[0].force - ends[1].force) / (2 * e), rtol=1e-6, atol=1e-6
        )


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_fingers_that_follow_touch_the_ground(restitution: float) -> None:
    """As on the free tree under couplers, impulses included."""
    q, v = whole(Q0, V0)
    given: dict[str, Any] = {"record": "contacts"}
    ours, theirs = (sd.Scene(x, friction=False, contacts=ground(x, restitution=restitution)) for x in (MODEL, FREE))
    theirs = theirs.with_(constraints=sd.Constraints(FREE, COUPLERS))
    mine, other = sd.simulate(ours, Q0, V0, STEPS * DT, DT, **given), sd.simulate(theirs, q, v, STEPS * DT, DT, **given)
    assert abs(mine.contacts.impulse).max() > 0.01
    np.testing.assert_allclose(mine.contacts.impulse, other.contacts.impulse, atol=1e-11)
    np.testing.assert_allclose(whole(mine.q, mine.v)[0], other.q, atol=1e-12)
    one = sd.contact_step(MODEL, ground(MODEL, restitution=restitution), Q0, V0, np.zeros(3), DT)
    np.testing.assert_allclose(one.q, mine.q[1], atol=1e-14)


def test_a_gripper_with_all_that_acts_is_the_tree_under_couplers_with_all_that_acts() -> None:
    """A held finger, contact, dry friction, limits and a motor; what rubs in a follower rubs in its leader."""
    q, v = whole(Q0, sd.project_velocity(MODEL, held(MODEL), Q0, V0))
    runs = []
    for model, start in ((MODEL, (Q0, v[OWN])), (FREE, (q, v))):
        rest = {"contacts": ground(model), "constraints": held(model), "friction": True, "limits": True}
        runs.append(sd.simulate(sd.Scene(model, **rest), *start, STEPS * DT, DT))
    assert abs(runs[0].q[:, SAME] - runs[1].q[:, OWN]).max() < 1e-9


def test_a_joint_that_follows_stops_its_leader_at_its_own_limits() -> None:
    made = sd.ModelBuilder("pair").add_body("a", axis=(0, 1, 0), inertia=BODY, joint_name="a", limits=(-1.0, 1.0))
    follow = {"leader": "a", "multiplier": -0.5, "offset": 0.1}
    made.add_body("b", axis=(1, 0, 0), inertia=BODY, joint_name="b", mimic=follow, limits=(-0.1, 3.0))
    model = made.build(mimic=True)
    ran = sd.simulate(sd.Scene(model, limits=True), [0.3], [2.0], 0.3, DT)
    assert ran.q.max() == pytest.approx(0.4, abs=1e-6)
    for name in "cd":
        made.add_body(name, axis=(1, 0, 0), inertia=BODY, joint_name=name, mimic=follow, limits=(2.0, 3.0))
    model = made.build(mimic=True)
    text = '"c" mimics "a" with limits 2 to 3; joint "d" mimics "a" with limits 2 to 3, expected some that a position'
    with pytest.raises(sd.ModelError, match=text):
        sd.Scene(model, limits=True)
    assert sd.Scene(model).acts == ()


@pytest.mark.parametrize("offset", [-0.3, 1.2])
def test_a_joint_that_stays_beyond_its_own_limits_is_refused_by_name(offset: float) -> None:
    """A follower of ratio 0 stays at its offset, wherever its leader is."""
    made = sd.ModelBuilder("pair").add_body("a", axis=(0, 1, 0), inertia=BODY, joint_name="a", limits=(-1.0, 1.0))
    for name, at in (("b", 0.5), ("c", offset)):
        follow = {"leader": "a", "multiplier": 0.0, "offset": at}
        made.add_body(name, axis=(1, 0, 0), inertia=BODY, joint_name=name, mimic=follow, limits=(-0.2, 1.0))
    text = f'^joint "c" mimics "a" by ratio 0, at {offset:g}, with limits -0.2 to 1, expected some that a position'
    with pytest.raises(sd.ModelError, match=text):
        sd.Scene(made.build(mimic=True), limits=True)


def test_trade_and_recommend_measure_them() -> None:
    table = sd.trade(MODEL, "forward_dynamics", states=64, batch=64)
    assert {x.code.partition("(")[0] for x in table.options} >= {"sd.aba", "sd.crba_solve"}
    best = sd.recommend(MODEL, "mass_matrix", 1e-10, states=64, batch=64)
    np.testing.assert_allclose(best(Q0), sd.crba(MODEL, Q0), rtol=1e-10)


def test_mujoco_joint_equalities_move_alike() -> None:
    """With stiff equalities and MuJoCo's RK4, to what its soft constraints allow."""
    mujoco = pytest.importorskip("mujoco")
    xml = """<mujoco><option timestep="0.0002" integrator="RK4" gravity="0 0 -9.81"/><compiler angle="radian"/>
    <default><equality solref="0.0008 1" solimp="0.9999 0.9999 0.001"/></default><worldbody>
    <body name="arm"><inertial pos="0 0.02 -0.2" mass="0.8" fullinertia="0.02 0.03 0.01 0 0 0"/>
     <joint name="lift" type="hinge" axis="0 1 0"/>
     <body name="wrist" pos="0 0 -0.4"><inertial pos="0 0.02 -0.2" mass="0.8" fullinertia="0.02 0.03 0.01 0 0 0"/>
      <joint name="turn" type="hinge" axis="1 0 0"/>
      <body name="thumb" pos="0.1 0 0"><inertial pos="0 0 0.05" mass="0.1" fullinertia="2e-4 3e-4 1e-4 0 0 0"/>
       <joint name="grip" type="hinge" axis="0 0 1"/></body>
      <body name="index" pos="-0.1 0 0"><inertial pos="0 0 0.05" mass="0.1" fullinertia="2e-4 3e-4 1e-4 0 0 0"/>
       <joint name="index" type="hinge" axis="0 1 0"/>
       <body name="jaw"><inertial pos="0 0 0.05" mass="0.1" fullinertia="2e-4 3e-4 1e-4 0 0 0"/>
        <joint name="jaw" type="slide" axis="1 0 0"/></body></body></body></body></worldbody>
    <equality><joint joint1="index" joint2="grip" polycoef="0.1 -0.5 0 0 0"/>
     <joint joint1="jaw" joint2="grip" polycoef="0 0.2 0 0 0"/></equality></mujoco>"""
    theirs = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(theirs)
    q, v = whole(Q0, V0)
    order = [FREE.joint(name).idx_v for name in ("lift", "turn", "grip", "index", "jaw")]
    data.qpos[:], data.qvel[:] = q[order], v[order]
    for _ in range(500):
        mujoco.mj_step(theirs, data)
    ours = sd.simulate(sd.Scene(MODEL, friction=False), Q0, V0, 0.1, 2e-4, "rk4")
    assert abs(ours.q[-1, SAME] - data.qpos[:3]).max() < 1e-4
