"""Derivatives of torques, accelerations and momenta: by hand, by identities, on complex numbers, by differences.

Pinocchio is the oracle for the joints that it has, in a tree of all of them here, on every robot in test_corpus.py.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from complex_steps import CLOSE, EPS, JOINT, LINK, STEP, close, tangent
from dense import Array
from slow import slow_but
from trees import RandomTree, State, random_inertia, random_state, random_tree, tree_case

import spatialdyn as sd
from spatialdyn.algebra.records import object_twin
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record import recording
from spatialdyn.recursions import SPECS

TREES = [*((seed, floating) for seed in range(2) for floating in (False, True)), (3, True)]
INVERSE = 2**16 * EPS  # of what goes through M⁻¹, whose condition number is some 1e3 in these trees
PEERS = 1e-11  # of the largest entry: both sides are float64, sums over a dozen bodies in other frames
SIXTH = ((1, 45.0), (2, -9.0), (3, 1.0))  # of central differences, over 60 h: the error is of the order h⁶

# joints of the tree behind its spherical or planar one: Pinocchio's ∂A/∂q in the world's axes, by those joints, is not
# what differences of its own accelerations are
BEHIND = (3, 4, 6, 7)

# derivative: (what it is the derivative of, by which inputs)
OF = {
    "rnea_derivatives": ("rnea", "q v a"),
    "aba_derivatives": ("aba", "q v tau"),
    "generalized_gravity_derivatives": ("generalized_gravity", "q"),
    "static_torque_derivatives": ("static_torque", "q"),
    "center_of_mass_velocity_derivatives": ("center_of_mass_velocity", "q v"),
    "frame_velocity_derivatives": ("frame_velocity", "q v"),
    "frame_acceleration_derivatives": ("frame_acceleration", "q v a"),
}
STATIC = [("local", False), ("world", False), ("local_world_aligned", False), ("local", True), ("world", True)]
STATIC += [("local_world_aligned", True)]
PLACEMENT = np.array([[0.6, -0.8, 0.0, 0.3], [0.8, 0.6, 0.0, -0.2], [0.0, 0.0, 1.0, 0.5], [0.0, 0.0, 0.0, 1.0]])


@pytest.fixture(params=TREES, ids=lambda p: f"{p[0]}-{'floating' if p[1] else 'fixed'}", scope="module")
def case(request: pytest.FixtureRequest) -> tuple[RandomTree, Any, State]:
    return tree_case(*request.param)


# --- by hand --------------------------------------------------------------------------------------------


def test_a_pendulums_torque_has_the_textbooks_derivatives() -> None:
    """τ = m l² q̈ + m g l sin q."""
    builder = sd.ModelBuilder("pendulum")
    builder.add_body("rod", None, "revolute", (0, 1, 0), None, (2.0, (0, 0, -0.7), np.zeros((3, 3))))
    model, q = builder.build(), 0.4
    stiffness = 2.0 * 9.81 * 0.7 * np.cos(q)
    close(sd.rnea_derivatives(model, [q], [0.3], [0.5]).ravel(), [stiffness, 0.0, 2.0 * 0.49])
    close(sd.aba_derivatives(model, [q], [0.3], [0.5]).ravel(), [-stiffness / 0.98, 0.0, 1.0 / 0.98])
    close(sd.generalized_gravity_derivatives(model, [q]), [[stiffness]])


def test_a_free_bodys_gravity_turns_with_it() -> None:
    """g = (-m Rᵀg, -c × m Rᵀg): by a turn e the force changes by m (Rᵀg × e), by a shift not at all."""
    builder = sd.ModelBuilder("stone", root="stone")
    c = np.array([0.1, -0.2, 0.3])
    builder.set_inertia("stone", (2.0, tuple(c), 0.1 * np.eye(3)))
    model = builder.build(root="floating")
    q = np.array([5.0, 6.0, 7.0, 0.5, -0.5, 0.5, 0.5])
    D = sd.generalized_gravity_derivatives(model, q)
    g = sd.frame_placement(model, q, "stone")[:3, :3].T @ [0, 0, -9.81]
    turned = np.array([2.0 * np.cross(e, g) for e in np.eye(3)]).T
    close(D, np.block([[np.zeros((3, 3)), turned], [np.zeros((3, 3)), np.cross(c, turned.T).T]]))


# --- identities -----------------------------------------------------------------------------------------


def test_by_the_acceleration_it_is_m_and_symmetric_to_the_bit(case: Any) -> None:
    _, model, s = case
    M = sd.rnea_derivatives(model, s.q, s.v, s.a)[2]
    assert (M == M.T).all()
    close(M, sd.crba(model, s.q))


def test_by_the_velocity_it_is_twice_c_for_coordinates_and_on_v_itself(case: Any) -> None:
    """The bias is a quadratic form in v, of which 2 C v is the derivative along v."""
    _, model, s = case
    twice = 2.0 * sd.coriolis_matrix(model, s.q, s.v)
    close(sd.rnea_derivatives(model, s.q, s.v, s.a)[1] @ s.v, twice @ s.v)
    made = random_tree(8, 6, ("revolute", "continuous", "prismatic"))
    model, s = made.model, random_state(made.tree, np.random.default_rng(8))
    close(sd.rnea_derivatives(model, s.q, s.v, s.a)[1], 2.0 * sd.coriolis_matrix(model, s.q, s.v))


def test_what_an_acceleration_adds_by_q_is_the_derivative_of_m(case: Any) -> None:
    _, model, s = case
    added = sd.rnea_derivatives(model, s.q, s.v, s.a)[0] - sd.rnea_derivatives(model, s.q, s.v, 0.0 * s.a)[0]
    close(added, np.einsum("ijk,j->ik", sd.mass_matrix_derivatives(model, s.q), s.a))


def test_at_rest_it_is_that_of_the_static_torque(case: Any) -> None:
    _, model, s = case
    rest = sd.rnea_derivatives(model, s.q, 0.0 * s.v, 0.0 * s.a, s.fext)[0]
    close(sd.static_torque_derivatives(model, s.q, s.fext), rest)
    close(sd.static_torque_derivatives(model, s.q, 0.0 * s.fext), sd.generalized_gravity_derivatives(model, s.q))


@pytest.mark.parametrize("seed", range(3))
def test_gravity_is_the_gradient_of_an_energy(seed: int) -> None:
    """Its derivatives by coordinates are symmetric."""
    made = random_tree(seed, 8, ("revolute", "continuous", "prismatic"))
    q = random_state(made.tree, np.random.default_rng(seed)).q
    D = sd.generalized_gravity_derivatives(made.model, q)
    close(D, D.T)


def test_forward_derivatives_are_minus_the_inverse_mass_times_those_of_inverse_dynamics(case: Any) -> None:
    _, model, s = case
    da = sd.aba_derivatives(model, s.q, s.v, s.tau, s.fext)
    a = sd.aba(model, s.q, s.v, s.tau, s.fext)
    dtau = sd.rnea_derivatives(model, s.q, s.v, a, s.fext)
    M = sd.crba(model, s.q)
    close(da[:2], -np.linalg.solve(M, dtau[:2]), INVERSE)
    close(da[2], sd.minverse(model, s.q), INVERSE)


def test_momentum_by_velocity_and_its_rate_by_acceleration_are_the_centroidal_map(case: Any) -> None:
    _, model, s = case
    _, _, by_v, Ag = sd.centroidal_dynamics_derivatives(model, s.q, s.v, s.a)
    close(Ag, sd.centroidal_map(model, s.q))
    close(by_v @ s.v, 2.0 * sd.centroidal_map_dot(model, s.q, s.v) @ s.v)


def test_a_free_robots_base_feels_the_rate_of_momentum() -> None:
    """The base's torques are the force on the robot and its moment about the base: row by row the same derivatives."""
    made = random_tree(5, 5, floating=True, gravity=(0.0, 0.0, 0.0))
    model, s = made.model, random_state(made.tree, np.random.default_rng(5))
    q = s.q.copy()
    q[:7] = 0, 0, 0, 0, 0, 0, 1
    D = sd.rnea_derivatives(model, q, s.v, s.a)
    dh = sd.centroidal_dynamics_derivatives(model, q, s.v, s.a)
    close(D[1, :3], dh[2, :3])
    close(D[0, :3, 6:], dh[1, :3, 6:])  # the base's own axes turn with it
    c, J = sd.center_of_mass(model, q), sd.com_jacobian(model, q)
    force = sd.rnea(model, q, s.v, s.a)[:3]
    close(D[0, 3:6, 6:], (dh[1, 3:] + np.cross(c, dh[1, :3].T).T + np.cross(J.T, force).T)[:, 6:])


# --- complex steps, and differences of the truth ---------------------------------------------------------


def complex_steps(spec: Any, model: Any, given: dict[str, Any], by: str) -> Array:
    """∂/∂x_k = Im f(x + i h e_k) / h, exact to rounding: the recursion runs on complex numbers."""
    n, columns = len(model.bodies) - 1, []
    along = tangent(model, given["q"]) if by == "q" else np.eye(n)
    for direction in along:
        work = np.zeros(n + 1, object_twin(spec.work)).view(np.recarray)
        moved = {**given, by: [complex(x, STEP * y) for x, y in zip(given[by], direction, strict=True)]}
        out = np.zeros([n if size == "nv" else size for size in spec.output.shape], complex)
        spec.run(model.bodies, work, moved, out, lambda shape: np.zeros(shape, complex))
        columns.append(out.imag / STEP)
    return np.stack(columns, -1)


def state_of(s: State, model: Any, reference: str, classical: bool) -> dict[str, Any]:
    """What the calls take of a state; the frame stands on the last body."""
    static = {"row": len(model.bodies) - 1, "placement": PLACEMENT, "classical": int(classical)}
    return {**s._asdict(), **static, "reference": ("local", "world", "local_world_aligned").index(reference)}


@pytest.mark.parametrize(
    ("name", "seed", "floating"),
    slow_but([(x, 0, True) for x in [*OF][::6]], [(x, *tree) for x in OF for tree in ((0, True), (1, False))]),
)
def test_derivatives_equal_complex_steps(name: str, seed: int, floating: bool) -> None:
    made = random_tree(seed, 3, floating=floating, continuous="cos_sin" if seed else "angle")
    model, s = made.model, random_state(made.tree, np.random.default_rng(seed))
    spec, of = SPECS[name], SPECS[OF[name][0]]
    asked = {x.name for x in spec.present if x.static}
    for reference, classical in STATIC if "classical" in asked else STATIC[: 3 if asked else 1]:
        given = state_of(s, model, reference, classical)
        out = np.zeros([model.nv if size == "nv" else size for size in spec.output.shape])
        work = np.zeros(len(model.bodies), spec.work).view(np.recarray)
        spec.run(model.bodies, work, given, out, np.zeros)
        for part, by in zip(out if " " in OF[name][1] else [out], OF[name][1].split(), strict=True):
            close(part, complex_steps(of, model, given, by), INVERSE if spec.pivots else CLOSE)


def test_derivatives_of_the_momentum_and_its_rate_equal_complex_steps() -> None:
    """dh/dt = Σ ∂h/∂q_k v_k + Ag a, so that its derivatives are those of three calls."""
    made = random_tree(2, 5, floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(2))
    given = s._asdict()
    dh, ddh, by_v, Ag = sd.centroidal_dynamics_derivatives(model, s.q, s.v, s.a)
    close(dh, complex_steps(SPECS["centroidal_momentum"], model, given, "q"))
    close(Ag, complex_steps(SPECS["centroidal_momentum"], model, given, "v"))
    maps = complex_steps(SPECS["centroidal_map"], model, given, "q")
    rates = {x: complex_steps(SPECS["centroidal_map_dot"], model, given, x) for x in "qv"}
    close(ddh, np.einsum("mik,i->mk", maps, s.a) + np.einsum("mik,i->mk", rates["q"], s.v))
    dAg = sd.centroidal_map_dot(model, s.q, s.v)
    close(by_v, dAg + np.einsum("mik,i->mk", rates["v"], s.v))


@pytest.mark.parametrize("name", slow_but(["aba_derivatives"], ["rnea_derivatives", "aba_derivatives"]))
def test_derivatives_equal_sixth_order_differences_of_the_truth(name: str) -> None:
    """In 240 bits a step of 1e-9 leaves 1e-54 of the series and 1e-62 of rounding."""
    pytest.importorskip("mpmath")
    made = random_tree(4, 2, ("spherical", "revolute", "planar"), floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(4))
    of, by = sd.exact(model, getattr(sd, OF[name][0])), OF[name][1].split()
    moved = sd.exact(model, sd.integrate)
    h, given = 2.0**-30, [getattr(s, x) for x in by]

    def along(k: int, e: Array, t: float) -> Any:
        one = [moved(x, t * e) if k == j == 0 else x + t * e if k == j else x for j, x in enumerate(given)]
        return of(*one, s.fext)

    found = getattr(sd, name)(model, *given, s.fext)
    for k, part in enumerate(found):
        columns = []
        for e in np.eye(model.nv)[:: 1 if k == 0 else 3]:
            total = sum(w * (along(k, e, m * h) - along(k, e, -m * h)) for m, w in SIXTH)
            columns.append((total / (60.0 * h)).astype(float))
        close(part[:, :: 1 if k == 0 else 3], np.stack(columns, -1), INVERSE if name == "aba_derivatives" else CLOSE)


# --- Pinocchio ------------------------------------------------------------------------------------------


def tree_of_all_joints(pin: Any, rng: np.random.Generator) -> Any:
    """A tree with each kind of joint that both have, under a free-flyer, with armatures."""
    model = pin.Model()
    unit = rng.normal(size=3)
    unit /= np.linalg.norm(unit)
    kinds = [
        pin.JointModelFreeFlyer(), pin.JointModelRX(), pin.JointModelSpherical(), pin.JointModelPY(),
        pin.JointModelRevoluteUnaligned(unit), pin.JointModelPlanar(), pin.JointModelRUBZ(),
        pin.JointModelPrismaticUnaligned(unit), pin.JointModelRZ(),
    ]  # fmt: skip
    for k, (kind, parent) in enumerate(zip(kinds, (0, 1, 2, 3, 2, 5, 6, 1, 8), strict=True)):
        joint = model.addJoint(parent, kind, pin.SE3.Random(), f"j{k}")
        model.appendBodyToJoint(joint, pin.Inertia(*random_inertia(rng)), pin.SE3.Identity())
        if kind.nv == 1:
            model.armature[model.joints[joint].idx_v] = rng.uniform(0.1, 0.5)
    return model


def test_a_tree_of_all_shared_joints_equals_pinocchio() -> None:
    pin = pytest.importorskip("pinocchio")
    pin.seed(1)
    rng = np.random.default_rng(1)
    theirs = tree_of_all_joints(pin, rng)
    model, data = sd.from_pinocchio(theirs), theirs.createData()
    q = sd.random_configuration(model, rng)
    v, a, tau = rng.normal(size=(3, model.nv))
    fext = rng.normal(size=(model.njoints, 6))
    forces = pin.StdVec_Force()
    forces.extend([pin.Force(f) for f in fext])
    close(sd.rnea_derivatives(model, q, v, a), pin.computeRNEADerivatives(theirs, data, q, v, a), PEERS)
    close(sd.rnea_derivatives(model, q, v, a, fext), pin.computeRNEADerivatives(theirs, data, q, v, a, forces), PEERS)
    close(sd.aba_derivatives(model, q, v, tau), pin.computeABADerivatives(theirs, data, q, v, tau), PEERS)
    found = pin.computeABADerivatives(theirs, data, q, v, tau, forces)
    close(sd.aba_derivatives(model, q, v, tau, fext), found, PEERS)
    close(
        sd.generalized_gravity_derivatives(model, q), pin.computeGeneralizedGravityDerivatives(theirs, data, q), PEERS
    )
    found = pin.computeStaticTorqueDerivatives(theirs, data, q, forces)
    close(sd.static_torque_derivatives(model, q, fext), found, PEERS)
    found = pin.computeCentroidalDynamicsDerivatives(theirs, data, q, v, a)
    close(sd.centroidal_dynamics_derivatives(model, q, v, a), found, PEERS)
    for number, reference in itertools.product(range(1, 10), ("local", "world")):
        there, name = getattr(pin.ReferenceFrame, reference.upper()), f"joint:{model.names[number]}"
        pin.computeForwardKinematicsDerivatives(theirs, data, q, v, a)
        found = pin.getJointVelocityDerivatives(theirs, data, number, there)
        close(sd.frame_velocity_derivatives(model, q, v, name, reference), found, PEERS)
        found = pin.getJointAccelerationDerivatives(theirs, data, number, there)[1:]
        if reference == "world" and number in BEHIND:
            continue
        close(sd.frame_acceleration_derivatives(model, q, v, a, name, reference), found, PEERS)


# --- limits ---------------------------------------------------------------------------------------------


def test_where_a_free_robot_stands_does_not_matter_to_the_bit() -> None:
    made = random_tree(7, 5, floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(7))
    far = s.q.copy()
    far[:3] = 1e6, -1e5, 3.0
    np.testing.assert_array_equal(sd.rnea_derivatives(model, far, s.v, s.a), sd.rnea_derivatives(model, s.q, s.v, s.a))


def test_branches_from_the_world_do_not_couple() -> None:
    builder = sd.ModelBuilder("pair")
    for side in "ab":
        body = (1.0, (0.1, 0.2, 0.3), 0.1 * np.eye(3))
        builder.add_body(f"{side}1", None, "revolute", (0, 1, 0), (0.3, 0, 0), body)
        builder.add_body(f"{side}2", f"{side}1", "revolute", (1, 1, 0), (0.3, 0, 0), body)
    model, x = builder.build(), np.array([0.1, 0.2, 0.3, 0.4])
    for D in (sd.rnea_derivatives(model, x, x, x), sd.aba_derivatives(model, x, x, x)):
        assert not D[:, :2, 2:].any()
        assert not D[:, 2:, :2].any()
        assert D[:, 0, 1].all()


@pytest.mark.slow(quick="test_derivatives_equal_complex_steps")
def test_no_freedoms_have_empty_derivatives() -> None:
    none = sd.ModelBuilder("rock", root="rock").build()
    assert sd.rnea_derivatives(none, [], [], []).shape == (3, 0, 0)
    assert sd.aba_derivatives(none, [], [], []).shape == (3, 0, 0)
    assert sd.static_torque_derivatives(none, [], np.zeros((1, 6))).shape == (0, 0)
    assert sd.frame_velocity_derivatives(none, [], [], "rock").shape == (2, 6, 0)


def test_a_joint_that_moves_nothing_is_named() -> None:
    builder = sd.ModelBuilder("hollow")
    builder.add_body("b1", None, "revolute", (0, 0, 1), None, (1.0, (0.3, 0.7, 0), np.eye(3)))
    builder.add_body("b2", "b1", "revolute", (0, 0, 1), None, None, joint_name="idle")
    model = builder.build()
    with pytest.raises(sd.InertiaError, match='joint "idle" has zero articulated inertia'):
        sd.aba_derivatives(model, [0.1, 0.2], [0.0, 0.0], [0.0, 0.0])
    assert np.isfinite(sd.rnea_derivatives(model, [0.1, 0.2], [0.0, 0.0], [0.0, 0.0])).all()


@pytest.mark.parametrize("root", ["fixed", "floating"])
def test_mimic_joints_contract_every_axis_with_g(root: str) -> None:
    """v_full = G v with constant G: what is left of the whole tree's derivatives is Gᵀ ∂τ G, and forward M⁻¹ of it."""
    links = "".join(LINK.format(n, 0.1 * k, 1 + k) for k, n in enumerate("abc"))
    mimic = '<mimic joint="j1" multiplier="-0.5" offset="0.2"/>'
    joints = JOINT.format("j1", "base", "a", "0 0 1", "") + JOINT.format("j2", "a", "b", "0 1 0", "")
    joints += JOINT.format("j3", "b", "c", "1 0 0", mimic)
    text = f'<robot name="gripper"><link name="base"/>{links}{joints}</robot>'
    if root == "floating":
        text = text.replace('<link name="base"/>', LINK.format("base", 0.2, 3.0))
    model, full = (sd.load_urdf(text, root=root, mimic=mimic) for mimic in (True, False))
    rng = np.random.default_rng(2)
    q = sd.random_configuration(model, rng)
    v, a, tau = rng.normal(size=(3, model.nv))
    G = model.mimic_matrix
    whole = q[model.mimic_index] * model.mimic_ratio + model.mimic_offset
    D = sd.rnea_derivatives(model, q, v, a)
    close(D, G.T @ sd.rnea_derivatives(full, whole, G @ v, G @ a) @ G)
    close(D[2], sd.crba(model, q))
    a = sd.aba(model, q, v, tau)
    D, M = sd.rnea_derivatives(model, q, v, a), sd.crba(model, q)
    da = sd.aba_derivatives(model, q, v, tau)
    close(M @ da, np.stack([-D[0], -D[1], np.eye(model.nv)]), INVERSE)
    many = sd.aba_derivatives(model, np.stack([q, q]), v, tau)
    close(many[1], da, INVERSE)
    frame = "joint:j3"
    by_full = sd.frame_velocity_derivatives(full, whole, G @ v, frame)
    close(sd.frame_velocity_derivatives(model, q, v, frame), by_full @ G)


# --- programs -------------------------------------------------------------------------------------------


def test_a_program_of_forward_derivatives_is_as_long_as_its_products() -> None:
    small, large = (random_tree(2, n, ("revolute",), fixed=False).model for n in (20, 30))
    spec = SPECS["aba_derivatives"]
    assert recording.fits((spec,), small.bodies)
    assert not recording.fits((spec,), large.bodies)
    assert recording.fits((spec,), large.bodies, 3 * 30**2)
    assert recording.fits((SPECS["rnea_derivatives"],), large.bodies)


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is traced")
def test_a_program_of_some_entries_gives_those() -> None:
    made = random_tree(5, 4, floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(5))
    D = sd.rnea_derivatives(model, s.q, s.v, s.a)
    k = sd.specialize(model, sd.rnea_derivatives)
    close(k(s.q, s.v, s.a), D)
    some = sd.specialize(model, sd.rnea_derivatives, outputs=[0, 5, 7])
    close(some(s.q, s.v, s.a), D[:, [0, 5, 7]][:, :, [0, 5, 7]])
    assert some.operations["mul"] < k.operations["mul"] / 2
