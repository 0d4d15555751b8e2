"""Exact rotors: every call against the same robot with each rotor as a body of its own, tied to its joint by G."""

from __future__ import annotations

import pickle
from typing import Any

import dense
import numpy as np
import pytest
from plain import EXACT, close, plainly, states
from slow import slow_but
from trees import random_inertia, random_placement, random_unit

import spatialdyn as sd
from spatialdyn.calls.dynamics import calls, table_call
from spatialdyn.engines.programs.record.recording import record
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.joints.friction import BRISTLE_STEP, FRICTION_STEP

Array = np.ndarray
TURNING = ("revolute", "prismatic", "helical", "continuous")


def axisymmetric(rng: np.random.Generator, axis: Array, at: Array) -> tuple[tuple[float, Array, Array], float]:
    """A rotor's inertia, as links take it, with its com on the line through ``at`` along the axis; and J."""
    J, across, mass = rng.uniform(2e-3, 2e-2), rng.uniform(2e-3, 2e-2), rng.uniform(0.1, 0.5)
    across = max(across, 0.6 * J)
    inertia = across * np.eye(3) + (J - across) * np.outer(axis, axis)
    return (mass, at + rng.uniform(-0.1, 0.1) * axis, inertia), J


def pair(seed: int, n: int = 6, floating: bool = False, skew: bool = True) -> tuple[sd.Model, sd.Model]:
    """A model with rotors, and the same with a body for each of them and mimic=True."""
    rng = np.random.default_rng(seed)
    geared, explicit = sd.ModelBuilder("geared", root="b0"), sd.ModelBuilder("explicit", root="b0")
    if floating:
        inertia = random_inertia(rng)
        geared.set_inertia("b0", inertia)
        explicit.set_inertia("b0", inertia)
    for k in range(1, n + 1):
        parent = f"b{rng.integers(max(0, k - 2), k)}"
        kind = "spherical" if k == 3 and not floating else TURNING[rng.integers(4)]
        axis, placement, inertia = random_unit(rng, 3), random_placement(rng), random_inertia(rng)
        own: dict[str, Any] = {"pitch": 0.1} if kind == "helical" else {}
        rotor = None
        if kind != "spherical":
            e = random_unit(rng, 3) if skew and k % 3 else axis
            ratio = rng.uniform(3.0, 10.0) * (-1) ** k
            at = np.array([*rng.uniform(-0.2, 0.2, size=3)])
            body, J = axisymmetric(rng, e, at)
            rotor = sd.Rotor(J, ratio, tuple(e))
            X = np.eye(4)
            X[:3, 3] = at
            body = (body[0], body[1] - at, body[2])
            geared.add_body(f"r{k}", parent, "fixed", placement=placement @ X, inertia=body, joint_name=f"z{k}")
            explicit.add_body(
                f"r{k}", parent, "continuous", e, placement @ X, body, joint_name=f"z{k}",
                mimic={"leader": f"j{k}", "multiplier": ratio, "offset": rng.normal()},
            )  # fmt: skip
        for builder in (geared, explicit):
            builder.add_body(
                f"b{k}", parent, kind, axis, placement, inertia, joint_name=f"j{k}",
                rotor=rotor if builder is geared else None, **own,
            )  # fmt: skip
    options: dict[str, Any] = {"root": "floating"} if floating else {}
    return geared.build(**options), explicit.build(mimic=True, **options)


PAIRS = [(1, 6, False), (2, 6, False), (3, 5, True), (4, 6, True)]
PROJECTED = (
    "rnea nonlinear_effects generalized_gravity static_torque crba kinetic_energy momentum momentum_rate "
    "coriolis_matrix mass_matrix_dot coriolis_transpose_times_velocity modified_rnea christoffel_symbols "
    "mass_matrix_derivatives rnea_derivatives generalized_gravity_derivatives static_torque_derivatives"
)
OF_ALL_BODIES = (  # a fixed root carries the rotors on it, whose mass counts where they are bodies
    "potential_energy center_of_mass center_of_mass_velocity center_of_mass_acceleration com_jacobian "
    "center_of_mass_velocity_derivatives centroidal_momentum centroidal_momentum_rate centroidal_map "
    "centroidal_map_dot centroidal_dynamics_derivatives"
)


@pytest.fixture(scope="module", params=PAIRS, ids=str)
def both(request: pytest.FixtureRequest) -> tuple[sd.Model, sd.Model]:
    return pair(*request.param)


# --- by hand ----------------------------------------------------------------------------------------------


def turntable(ratio: float = 5.0, J: float = 0.02) -> sd.Model:
    """A turntable with a second one on its axis, whose motor's rotor turns on the first."""
    b = sd.ModelBuilder("turntable")
    b.add_body("lower", None, "revolute", (0, 0, 1), inertia=(1.0, (0, 0, 0), np.diag([0.5, 0.5, 0.3])))
    b.add_body(
        "upper", "lower", "revolute", (0, 0, 1), inertia=(1.0, (0, 0, 0), np.diag([0.2, 0.2, 0.1])),
        rotor=sd.Rotor(J, ratio),
    )  # fmt: skip
    return b.build()


def test_a_rotor_couples_two_turntables_on_one_axis() -> None:
    """T = ½ I1 ω1² + ½ I2 (ω1 + q̇)² + n J q̇ ω1 + ½ n² J q̇²."""
    n, J = 5.0, 0.02
    M = plainly(turntable(n, J), "crba", {"q": np.zeros((1, 2))})
    np.testing.assert_allclose(M, [[0.4, 0.1 + n * J], [0.1 + n * J, 0.1 + n * n * J]], rtol=1e-15)


def test_a_spinning_rotor_resists_tilting_as_a_gyroscope_does() -> None:
    """On a body that turns at Ω about x with a rotor at n q̇ about z, the couple about y is n J q̇ Ω x z = -n J q̇ Ω."""
    b = sd.ModelBuilder("gimbal").add_body("frame", None, "spherical", inertia=(1.0, (0, 0, 0), np.eye(3)))
    b.add_body("wheel", "frame", "revolute", (0, 0, 1), rotor=sd.Rotor(0.01, 40.0))
    x = {"q": np.array([[0.0, 0.0, 0.0, 1.0, 0.0]]), "v": np.array([[3.0, 0.0, 0.0, 7.0]])}
    tau = plainly(b.build(gravity=(0, 0, 0)), "nonlinear_effects", x)
    np.testing.assert_allclose(tau, [0.0, -40.0 * 0.01 * 7.0 * 3.0, 0.0, 0.0], rtol=1e-15, atol=1e-16)


# --- against rotors that are bodies -------------------------------------------------------------------------


@pytest.mark.parametrize("name", PROJECTED.split())
def test_every_call_is_that_of_rotors_as_bodies(both: tuple[sd.Model, sd.Model], name: str) -> None:
    """Gᵀ of the full tree, where each rotor is a body that follows its joint at n q̇."""
    geared, explicit = both
    x = states(geared)
    close(plainly(geared, name, x), plainly(explicit, name, x))


@pytest.mark.parametrize("name", OF_ALL_BODIES.split())
@pytest.mark.parametrize("of", [x for x in PAIRS if x[2]], ids=str)
def test_momenta_of_the_robot_count_the_rotors(of: tuple[int, int, bool], name: str) -> None:
    geared, explicit = pair(*of)
    x = states(geared)
    close(plainly(geared, name, x), plainly(explicit, name, x))


def test_calls_that_solve_invert_the_projected_mass_matrix(both: tuple[sd.Model, sd.Model]) -> None:
    geared, explicit = both
    x = states(geared)
    M, bias = plainly(explicit, "crba", x), plainly(explicit, "nonlinear_effects", x)
    a = np.linalg.solve(M, x["tau"][0] - bias)
    cond = np.linalg.cond(M) * np.finfo(float).eps
    for name in ("aba", "aba_refined", "crba_solve"):
        close(plainly(geared, name, x), a, EXACT + 10 * cond)
    close(plainly(geared, "minverse", x), np.linalg.inv(M), EXACT + 10 * cond)
    v = np.linalg.solve(M, x["p"][0])
    close(plainly(geared, "velocity_from_momentum", x), v, EXACT + 10 * cond)
    T = 0.5 * x["p"][0] @ v
    close(plainly(geared, "hamiltonian", x) - plainly(geared, "potential_energy", x), T, 100 * EXACT)
    rates = plainly(geared, "hamilton_field", x)
    close(rates[0], v, EXACT + 10 * cond)
    close(rates[1], plainly(explicit, "momentum_rate", {**x, "v": v[None]}), EXACT + 10 * cond)
    by = plainly(explicit, "rnea_derivatives", {**x, "a": a[None]})
    found = plainly(geared, "aba_derivatives", x)
    for k, expected in enumerate((-np.linalg.solve(M, by[0]), -np.linalg.solve(M, by[1]), np.linalg.inv(M))):
        close(found[k], expected, EXACT + 30 * cond)


def test_joints_transmit_what_they_do_between_rotors_as_bodies(both: tuple[sd.Model, sd.Model]) -> None:
    geared, explicit = both
    x = states(geared)
    one, other = plainly(geared, "joint_forces", x), plainly(explicit, "joint_forces", x)
    for k, joint in enumerate(geared.joints):
        close(one[k], other[explicit.names.index(joint.name)], 1e-12)


def test_mass_matrix_and_torque_are_those_of_the_dense_oracle() -> None:
    """A tree of explicit bodies in 6 x 6 matrices, projected by its own G: nothing of it is the library's."""
    rng = np.random.default_rng(7)
    e, n, J, at = random_unit(rng, 3), -7.0, 0.03, np.array([0.1, -0.2, 0.05])
    parts = [random_inertia(rng) for _ in range(3)]
    axes, places = [random_unit(rng, 3) for _ in range(2)], [random_placement(rng) for _ in range(2)]
    X = places[1].copy()
    X[:3, 3] += X[:3, :3] @ at
    rotor = (0.4, np.zeros(3), 0.02 * np.eye(3) + (J - 0.02) * np.outer(e, e))
    bodies = [dense.Body(0, "floating", mass=parts[0][0], com=parts[0][1], inertia=parts[0][2])]
    for k in (0, 1):
        m, c, I = parts[k + 1]
        bodies.append(dense.Body(k + 1, "revolute", axes[k], places[k], m, c, I))
    bodies.append(dense.Body(2, "revolute", e, X, *rotor))
    tree = dense.Tree(tuple(bodies))
    b = sd.ModelBuilder("legged", root="b").set_inertia("b", parts[0])
    b.add_body("b1", "b", "revolute", axes[0], places[0], parts[1])
    b.add_body("b2", "b1", "revolute", axes[1], places[1], parts[2], rotor=sd.Rotor(J, n, tuple(e)))
    b.add_body("r", "b1", "fixed", placement=X, inertia=rotor)
    model = b.build(root="floating")
    x = states(model)
    G = np.vstack([np.eye(8), np.eye(8)[7] * n])
    q = np.append(x["q"][0], 0.3)
    close(plainly(model, "crba", x), G.T @ dense.crba(tree, q) @ G)
    close(plainly(model, "rnea", x), G.T @ dense.rnea(tree, q, G @ x["v"][0], G @ x["a"][0]), 2e-13)


@pytest.mark.parametrize("name", ["rnea", "coriolis_matrix", "rnea_derivatives", "momentum_rate"])
def test_the_identity_holds_to_60_digits(name: str) -> None:
    """The axes and inertias of both models differ by roundoff of the floats alone; here there is none."""
    pytest.importorskip("mpmath")
    geared, explicit = pair(5, 4, True, skew=False)
    x = states(geared)
    spec = SPECS[name]
    values = [x[i.name][0] for i in spec.present if not i.optional]
    one, other = (np.asarray(sd.exact(m, calls[name], bits=240)(*values)) for m in (geared, explicit))
    assert float(abs(one - other).max()) < 1e-14 * float(abs(other).max())
    truth = np.asarray(sd.exact(geared, calls[name], bits=240)(*values), float)
    close(plainly(geared, name, x), truth)


# --- in every engine ----------------------------------------------------------------------------------------

ENGINES = ("rnea", "crba", "aba", "aba_square_root", "coriolis_matrix", "rnea_derivatives", "momentum")


def leg(n: float = 9.0, along: bool = True) -> sd.Model:
    """A floating trunk with two legs, whose origins programs move and whose inertias they regroup."""
    b = sd.ModelBuilder("legs", root="trunk").set_inertia("trunk", (10.0, (0, 0, 0), np.diag([0.3, 0.4, 0.5])))
    rotor = sd.Rotor(2e-3, n, None if along else (0.6, 0.0, 0.8))
    for side, y in (("l", 0.2), ("r", -0.2)):
        parent = "trunk"
        for name, axis, at in (
            ("hip", (1, 0, 0), (0.3, y, 0.1)),
            ("thigh", (0, 1, 0), (0.0, y / 2, 0.0)),
            ("shank", (0, 1, 0), (0.0, 0.0, -0.4)),
        ):
            own = (1.0, (0.01, 0.0, -0.2), np.diag([0.03, 0.03, 0.004]))
            b.add_body(f"{side}_{name}", parent, "revolute", axis, at, own, rotor=rotor)
            parent = f"{side}_{name}"
    return b.build(root="floating")


@pytest.mark.parametrize("along", [True, False])
def test_programs_agree_with_plain_python(along: bool) -> None:
    """Programs regroup inertias and move origins; the axis of a rotor stays in its body."""
    model = leg(along=along)
    x = states(model, count=9)
    for name in ENGINES:
        values, truth = true(model, name, x)
        close(calls[name](model, *values), truth, 1e-12)
        close(calls[name](model, *(v[3] for v in values)), truth[3], 1e-12)


@pytest.mark.parametrize("name", slow_but(["crba", "aba"], ENGINES))
def test_table_kernels_agree_with_plain_python(name: str) -> None:
    for along in (True, False):
        model = leg(along=along)
        values, truth = true(model, name, states(model, count=9))
        close(table_call(name, model, *values), truth, 1e-12)


def true(model: sd.Model, name: str, x: dict[str, np.ndarray]) -> tuple[list[np.ndarray], np.ndarray]:
    """The inputs of a call in all states, and its results in plain Python."""
    values = [x[i.name] for i in SPECS[name].present if not i.optional]
    of = "aba_refined" if name == "aba_square_root" else name
    return values, np.array([plainly(model, of, x, k) for k in range(len(x["q"]))])


def test_square_roots_keep_digits_where_a_rotor_is_heavy_beside_its_link() -> None:
    geared, _ = pair(8, 6, True)
    x = states(geared)
    found = table_call("aba_square_root", geared, x["q"], x["v"], x["tau"])
    close(found[0], plainly(geared, "aba_refined", x), 1e-11)


def test_constrained_dynamics_and_friction_steps_use_the_rotors_mass_matrix() -> None:
    model = leg()
    x = states(model)
    q, v, tau = (x[k][0] for k in ("q", "v", "tau"))
    held = sd.Constraints(model, [sd.PointConstraint("l_shank")])
    found = sd.constrained_dynamics(model, held, q, v, tau)
    J = sd.constraint_jacobian(model, held, q)
    M, bias = plainly(model, "crba", x), plainly(model, "nonlinear_effects", x)
    close(M @ found.a, tau - bias + J.T @ found.force, 1e-12)
    after = sd.rollout(sd.Scene(model, friction=sd.Friction(0.0, np.zeros(model.nv))), q, v, tau, dt=1e-3, steps=1)
    wanted = v + 1e-3 * np.linalg.solve(M, tau - bias)
    base = model.frames[0].name if model.frames[0].joint == 1 else next(f.name for f in model.frames if f.joint == 1)
    before, turned = (sd.frame_placement(model, x, base)[:3, :3] for x in (q, after.q[0]))
    wanted[:3] = turned.T @ before @ (wanted[:3] + 1e-3 * np.cross(v[3:6], v[:3]))  # in the axes after the step
    close(after.v[0], wanted, 1e-12)


# --- cost of rotors that are not there --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", [s.name for s in SPECS.values() if s.traceable and "row" not in {i.name for i in s.present}]
)
def test_without_a_rotor_its_numbers_are_not_read(name: str) -> None:
    """NaN in the columns of rows without a rotor changes no operation: nothing is computed with them."""
    spec, model = SPECS[name], sd.load_urdf("two_link")
    spoiled = model.bodies.copy()
    for x in "xyz":
        spoiled["rotor"][x] = np.nan
    one, other = (record([spec], bodies).program for bodies in (model.bodies, spoiled))
    assert [*map(tuple, one.lines)] == [*map(tuple, other.lines)]


@pytest.mark.parametrize("spec", [FRICTION_STEP, BRISTLE_STEP], ids=lambda s: s.name)
def test_steps_with_friction_do_not_read_them_either(spec: Any) -> None:
    model = sd.load_urdf("two_link")
    spoiled = model.bodies.copy()
    spoiled["rotor"]["z"] = np.nan
    one, other = (len(record([spec], bodies).program.lines) for bodies in (model.bodies, spoiled))
    assert one == other


def test_a_rotor_costs_aba_little() -> None:
    with_rotors = leg()
    without = with_rotors.with_(rotors={j: None for j in with_rotors.names[2:]}, armature=None)
    bare = without.with_(armature={j: 9.0**2 * 2e-3 for j in with_rotors.names[2:]})
    one, other = (len(record([SPECS["aba"]], m.bodies).program.lines) for m in (with_rotors, bare))
    assert other < one < 1.06 * other


# --- what the diagonal leaves out ---------------------------------------------------------------------------------


def left_out(n: float) -> float:
    """Error of the torques of armatures alone, relative to all that the rotors add, on the legs."""
    geared = leg(n)
    plain = geared.with_(rotors={j: None for j in geared.names[2:]})
    diagonal = plain.with_(armature={j: n * n * 2e-3 for j in geared.names[2:]})
    x = states(geared, count=20)
    tau = [[plainly(m, "rnea", x, k) for k in range(20)] for m in (geared, diagonal, plain)]
    exact, approximate, none = (np.array(t)[:, 6:] for t in tau)
    return float(np.linalg.norm(approximate - exact) / np.linalg.norm(exact - none))


def test_the_armature_alone_is_off_by_one_over_n() -> None:
    errors = {n: left_out(n) for n in (6.0, 10.0, 37.0)}
    assert 0.05 < errors[6.0] < 0.4
    for n, error in errors.items():
        assert abs(error * n / (errors[37.0] * 37.0) - 1.0) < 0.1, n


# --- models -------------------------------------------------------------------------------------------------------


def test_regressors_are_those_of_the_bodies_alone() -> None:
    """Y π is the torque of a robot whose rotors do not turn, as it is without armatures."""
    geared = leg(along=False)
    bare, x = geared.with_(rotors={j: None for j in geared.names[2:]}), states(geared)
    Y, pi = plainly(geared, "joint_torque_regressor", x), plainly(geared, "inertial_parameters", x)
    close((Y * pi).sum((1, 2)), plainly(bare, "rnea", x))
    Y = plainly(geared, "kinetic_energy_regressor", x)
    close((Y * pi).sum(), plainly(bare, "kinetic_energy", x))


def test_a_rotor_with_more_inertia_than_its_link_is_found_by_the_joints_name() -> None:
    """The link before the joint is to hold the rotor's own inertia: without it M is indefinite."""
    with pytest.raises(sd.InertiaError, match='joint "lower_joint"'):
        sd.aba(turntable(1.0, 1.0), [0.0, 0.0], [0.0, 0.0], [1.0, 0.0])


def test_models_keep_their_rotors() -> None:
    model, _ = pair(1)
    again = pickle.loads(pickle.dumps(model))
    assert again == model
    assert hash(again) == hash(model)
    assert again.key == model.key
    other = model.with_(rotors={"j2": None})
    assert other != model
    assert other.key != model.key
    heavier = model.with_(gravity=(0.0, 0.0, -1.0), payload={"b2": (1.0, (0, 0, 0), np.eye(3))})
    np.testing.assert_array_equal(heavier.bodies["rotor"], model.bodies["rotor"])
    np.testing.assert_array_equal(heavier.armature, model.armature)


def test_a_joint_that_is_locked_before_a_rotor_turns_its_axis() -> None:
    """The body behind the lock merges into the one before it, and the rotor then turns on that."""
    geared, explicit = pair(6, 5, True)
    locked = {"j2": 0.7}
    x = states(geared.reduced(locked))
    if "z2" in {j.name for j in explicit.robot.joints}:
        locked["z2"] = 0.1
    one, other = geared.reduced({"j2": 0.7}), explicit.reduced(locked)
    for name in ("rnea", "crba", "coriolis_matrix"):
        close(plainly(one, name, x), plainly(other, name, x), 1e-12)
    assert one.robot.joints[[j.name for j in one.robot.joints].index("j2")].rotor is None


def test_a_rotor_takes_the_place_of_the_armature() -> None:
    model = sd.load_urdf("two_link").with_(armature={"joint2": 0.5})
    geared = model.with_(rotors={"joint2": sd.Rotor(1e-3, -10.0, (0, 2, 0))})
    np.testing.assert_allclose(geared.armature, [0.0, 0.1], rtol=1e-15)
    assert geared.robot.joints[1].rotor == sd.Rotor(1e-3, -10.0, (0.0, 1.0, 0.0))
    assert not geared.with_(rotors={"joint2": None}).armature.any()
    on_world = model.with_(rotors={"joint1": sd.Rotor(1e-3, 10.0)})
    np.testing.assert_allclose(on_world.armature, [0.1, 0.5], rtol=1e-15)
    assert not on_world.bodies["geared"].any()
    smaller, _ = sd.simplify(geared, drop="armature")
    assert not smaller.armature.any()
    assert not smaller.bodies["geared"].any()


@pytest.mark.parametrize(
    ("rotor", "words"),
    [
        (sd.Rotor(0.0, 5.0), '"joint2" has a rotor of inertia 0.0, expected a finite number above 0'),
        (sd.Rotor(np.nan, 5.0), "inertia nan"),
        (sd.Rotor(1e-3, 0.0), "ratio 0.0, expected a finite number other than 0"),
        (sd.Rotor(1e-3, 5.0, (0, 0, 0)), "expected three finite numbers, not all 0"),
        (sd.Rotor(1e-3, 5.0, (0, 1)), "expected 3 numbers"),
        (1e-3, "expected a Rotor"),
    ],
)
def test_bad_rotors_are_refused_by_the_joints_name(rotor: Any, words: str) -> None:
    with pytest.raises(sd.ModelError, match=words):
        sd.load_urdf("two_link").with_(rotors={"joint2": rotor})


def test_what_has_no_place_for_rotors_refuses_them_by_name() -> None:
    model = sd.load_urdf("two_link").with_(rotors={"joint2": sd.Rotor(1e-3, 5.0)})
    with pytest.raises(sd.ModelError, match='joint "joint2" has a rotor, whose n² J is its armature'):
        model.with_(armature={"joint2": 0.1})
    with pytest.raises(sd.ModelError, match='joint "nosuch"'):
        model.with_(rotors={"nosuch": None})
    with pytest.raises(sd.ModelError, match=r"has armature 0\.1 beside a rotor"):
        sd.ModelBuilder().add_body("a", armature=0.1, rotor=sd.Rotor(1e-3, 5.0))
    with pytest.raises(sd.ModelError, match="is spherical, expected a joint of one freedom for a rotor"):
        sd.ModelBuilder().add_body("a", joint="spherical", rotor=sd.Rotor(1e-3, 5.0))
    with pytest.raises(sd.ModelError, match='model "two_link" has rotors, expected none for armatures as inputs'):
        sd.specialize(model, sd.rnea, inputs="armature")
    pytest.importorskip("pinocchio")
    with pytest.raises(sd.SpatialDynError, match='joint "joint2" has a rotor, which Pinocchio lacks'):
        sd.compare_with_pinocchio(model)


def test_identities_hold_with_rotors() -> None:
    model = leg()
    x = states(model, count=3)
    dq, M, C = (
        np.array([plainly(model, name, x, k) for k in range(3)]) for name in ("momentum", "crba", "coriolis_matrix")
    )
    close(dq, (M @ x["v"][..., None])[..., 0])
    dM = np.array([plainly(model, "mass_matrix_dot", x, k) for k in range(3)])
    close(dM, C + C.swapaxes(-1, -2))


def test_symbols_have_the_rotor_too() -> None:
    sympy = pytest.importorskip("sympy")
    model = sd.load_urdf("two_link").with_(rotors={"joint2": sd.Rotor(0.003, 6.0)})
    s = sd.SymbolicManipulator(model)
    q = [0.3, -0.4]
    M = np.array(s.M().subs(dict(zip(s.q, q, strict=True))).evalf(17), float)
    np.testing.assert_allclose(M, plainly(model, "crba", {"q": np.array([q])}), rtol=1e-15)
    named = sd.SymbolicManipulator(model, "symbols")
    assert sympy.Symbol("J_2", real=True) in named.M()[0, 1].free_symbols


@pytest.mark.parametrize("method", slow_but(["gauss4"], ["gauss4", "variational"]))
def test_free_motion_keeps_energy_and_the_momentum_of_rotors(method: str) -> None:
    model = leg().with_(gravity=(0.0, 0.0, 0.0))
    x = states(model, 3)
    v0 = 0.5 * x["v"][0]
    run = sd.simulate(model, x["q"][0], v0, 0.2, 1e-3, method)
    assert abs(run.energy - run.energy[0]).max() < (1e-9 if method == "gauss4" else 1e-4) * run.energy[0]
    h = sd.centroidal_momentum(model, run.q, run.v)
    np.testing.assert_allclose(h, np.broadcast_to(h[0], h.shape), rtol=0.0, atol=1e-9 * abs(h).max())  # as without


@pytest.mark.slow(quick="simulation/test_integrators.py::test_order_of_convergence")
def test_the_variational_method_converges_to_the_motion_at_order_2() -> None:
    model = leg().with_(gravity=(0.0, 0.0, 0.0))
    x = states(model, 4)
    q0, v0 = x["q"][0], 0.5 * x["v"][0]
    truth = sd.simulate(model, q0, v0, 0.1, 1e-3, "gauss6").v[-1]
    errors = [abs(sd.simulate(model, q0, v0, 0.1, h, "variational").v[-1] - truth).max() for h in (4e-3, 2e-3)]
    assert 3.5 < errors[0] / errors[1] < 4.5
