"""The oracle is consistent with itself, with closed forms, and with Pinocchio."""

from __future__ import annotations

from typing import Any

import dense
import numpy as np
import pytest
from dense import Array, Body, Tree
from trees import KINDS, SCREWS, RandomTree, random_state, random_tree

EPS = np.finfo(float).eps
IDENTITY = 2000 * EPS  # relative to the largest number: 6 x 6 products along a dozen bodies, M up to 1e4 in condition
DIFFERENCE = 1e-7  # central differences with steps of 1e-5: eps / step of rounding, step² of truncation
PINOCCHIO = 1e-12

TREES = {
    "chain": lambda: random_tree(1, 6, ("revolute", "prismatic"), branching=0.0),
    "tree": lambda: random_tree(2, 10),
    "pairs": lambda: random_tree(3, 10, continuous="cos_sin"),
    "floating": lambda: random_tree(4, 9, floating=True, continuous="cos_sin", gravity=(1.0, -2.0, 3.0)),
    "screws": lambda: random_tree(6, 7, SCREWS),
    "one": lambda: random_tree(5, 1, ("prismatic",), fixed=False),
}


@pytest.fixture(params=TREES)
def tree(request: pytest.FixtureRequest) -> Tree:
    made: RandomTree = TREES[request.param]()
    return made.tree


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def assert_close(x: Any, y: Any, tolerance: float, what: str = "") -> None:
    """|x - y| <= tolerance max(1, |y|), the largest entries."""
    x, y = np.asarray(x), np.asarray(y)
    assert x.shape == y.shape, what
    assert abs(x - y).max(initial=0.0) <= tolerance * max(1.0, abs(y).max(initial=0.0)), what


def along(tree: Tree, q: Array, v: Array, function: Any, step: float = 1e-5) -> Any:
    """Time derivative of function(q) while q moves with v."""
    ahead, behind = (np.asarray(function(dense.integrate(tree, q, s * v))) for s in (step, -step))
    return (ahead - behind) / (2.0 * step)


# --- by hand --------------------------------------------------------------------------------------------


def test_pendulum_has_the_textbook_equation() -> None:
    m, length, q, v = 1.5, 0.7, 0.4, 2.0
    rod = Tree((Body(0, "revolute", (0, 1, 0), mass=m, com=(0, 0, -length)),))
    assert_close(dense.crba(rod, [q]), [[m * length**2]], EPS)
    assert_close(dense.bias(rod, [q], [v]), [m * 9.81 * length * np.sin(q)], 4 * EPS)
    assert_close(dense.potential_energy(rod, [q]), -m * 9.81 * length * np.cos(q), 4 * EPS)
    assert_close(dense.kinetic_energy(rod, [q], [v]), 0.5 * m * (length * v) ** 2, 4 * EPS)


def test_free_body_falls(rng: np.random.Generator) -> None:
    made = random_tree(6, 0, floating=True).tree
    q, *_ = random_state(made, rng)
    fall = dense.aba(made, q, np.zeros(6), np.zeros(6))
    assert_close(fall, np.r_[dense.rotation_of(q[3:]).T @ made.gravity, np.zeros(3)], IDENTITY)


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.6, 0, 0.8), (1e-9, 0, -1)])
def test_shortest_rotation_takes_z_to_the_axis(axis: tuple[float, float, float]) -> None:
    Q = dense.shortest_rotation(axis)
    assert_close(Q[:, 2], axis, 4 * EPS)
    assert_close(Q @ Q.T, np.eye(3), 4 * EPS)
    assert_close((np.trace(Q) - 1) / 2, axis[2], 4 * EPS)  # the cosine of its angle is zᵀaxis: no shorter one exists


def test_planar_joint_is_two_sliders_and_a_hinge(rng: np.random.Generator) -> None:
    made = random_tree(7, 1, ("planar",), fixed=False).tree
    body = made.bodies[0]
    Q = dense.shortest_rotation(body.axis)
    chain = Tree(
        (
            Body(0, "prismatic", Q[:, 0], body.placement),
            Body(1, "prismatic", Q[:, 1]),
            Body(2, "revolute", body.axis, np.eye(4), body.mass, body.com, body.inertia),
        )
    )
    q, v, *_ = random_state(made, rng)
    c, s = np.cos(q[2]), np.sin(q[2])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])  # q̇ of the chain = turn v
    M = dense.crba(made, q) - body.armature * np.eye(3)
    assert_close(dense.placements(made, q)[1], dense.placements(chain, q)[3], IDENTITY)
    assert_close(M, turn.T @ dense.crba(chain, q) @ turn, IDENTITY)
    rates_dot = v[2] * turn @ np.array([-v[1], v[0], 0.0])  # d/dt of turn v at constant v
    assert_close(dense.bias(made, q, v), turn.T @ dense.rnea(chain, q, turn @ v, rates_dot), IDENTITY)


# --- identities -----------------------------------------------------------------------------------------


def test_rnea_is_m_a_plus_bias(tree: Tree, rng: np.random.Generator) -> None:
    q, v, a, _, fext = random_state(tree, rng)
    assert_close(dense.crba(tree, q) @ a + dense.bias(tree, q, v), dense.rnea(tree, q, v, a), IDENTITY)
    forces = sum(dense.jacobian(tree, q, i).T @ fext[i] for i in range(1, tree.njoints))
    assert_close(dense.rnea(tree, q, v, a) - forces, dense.rnea(tree, q, v, a, fext), IDENTITY)


def test_aba_inverts_rnea(tree: Tree, rng: np.random.Generator) -> None:
    q, v, _, tau, fext = random_state(tree, rng)
    assert_close(dense.rnea(tree, q, v, dense.aba(tree, q, v, tau, fext), fext), tau, IDENTITY)


def test_mass_matrix_is_the_sum_over_bodies(tree: Tree, rng: np.random.Generator) -> None:
    q = random_state(tree, rng).q
    M = dense.crba(tree, q)
    assert_close(M, M.T, IDENTITY)
    assert_close(M, dense.mass_matrix_by_jacobians(tree, q), IDENTITY)
    assert_close(dense.minverse(tree, q) @ M, np.eye(tree.nv), 100 * IDENTITY)


def test_energies_are_those_of_the_equation(tree: Tree, rng: np.random.Generator) -> None:
    q, v, *_ = random_state(tree, rng)
    assert_close(dense.kinetic_energy(tree, q, v), 0.5 * v @ dense.crba(tree, q) @ v, IDENTITY)
    slope = along(tree, q, v, lambda q: dense.potential_energy(tree, q))
    assert_close(slope, v @ dense.gravity_torque(tree, q), DIFFERENCE)


def test_power_is_the_change_of_energy(tree: Tree, rng: np.random.Generator) -> None:
    q, v, a, *_ = random_state(tree, rng)

    def energy(t: float) -> float:
        now, rate = dense.integrate(tree, q, t * v), v + t * a  # q̇ is right at t = 0, which is where we look
        return dense.kinetic_energy(tree, now, rate) + dense.potential_energy(tree, now)

    h = 1e-5
    assert_close((energy(h) - energy(-h)) / (2 * h), v @ dense.rnea(tree, q, v, a), DIFFERENCE)


def test_difference_inverts_integrate(tree: Tree, rng: np.random.Generator) -> None:
    q, v, *_ = random_state(tree, rng)
    v *= 3.0 / max(3.0, np.linalg.norm(v))  # difference sees rotations up to π
    for size in (1e-12, 1e-3, 1.0):
        there = dense.integrate(tree, q, size * v)
        assert abs(dense.difference(tree, q, there) - size * v).max() <= 100 * EPS * max(1.0, abs(q).max())
    assert (dense.integrate(tree, q, 0 * v) == q).all()
    start = dense.neutral(tree)
    there = dense.integrate(tree, start, dense.difference(tree, start, q))
    assert_close(dense.placements(tree, there), dense.placements(tree, q), IDENTITY)  # q and -q of a quaternion agree


def test_integrate_is_the_exponential_of_the_twist(tree: Tree, rng: np.random.Generator) -> None:
    q, v, *_ = random_state(tree, rng)
    there = dense.integrate(tree, q, v)
    for body, at, to in zip(tree.bodies, tree.q_slices[1:], tree.v_slices[1:], strict=True):
        step = dense.expm(dense.hat(dense.flip(dense.subspace(body) @ v[to])))
        assert_close(dense.joint_pose(body, there[at]), dense.joint_pose(body, q[at]) @ step, 100 * EPS)


def test_velocities_are_the_motion_of_the_placements(tree: Tree, rng: np.random.Generator) -> None:
    q, v, *_ = random_state(tree, rng)
    rate = along(tree, q, v, lambda q: dense.placements(tree, q))
    for T, dT, local in zip(dense.placements(tree, q), rate, dense.velocities(tree, q, v), strict=True):
        assert_close(dense.invert(T) @ dT, dense.hat(local), DIFFERENCE)


@pytest.mark.parametrize("reference", dense.REFERENCES)
def test_jacobians_give_velocities_and_accelerations(tree: Tree, rng: np.random.Generator, reference: str) -> None:
    q, v, a, *_ = random_state(tree, rng)
    vel = dense.velocities(tree, q, v, reference)
    acc = dense.accelerations(tree, q, v, a, reference, classical=reference == "local_world_aligned")
    offset = dense.pose(dense.rotation_of([0.5, 0.5, -0.5, 0.5]), (0.1, 0.2, -0.3))
    for i in range(1, tree.njoints):
        J = dense.jacobian(tree, q, i, reference)
        assert_close(J @ v, vel[i], IDENTITY)
        assert_close(J @ a + dense.jacobian_dot_times_v(tree, q, v, i, reference), acc[i], IDENTITY)
    for i in {1, tree.njoints - 1}:
        rate = along(tree, q, v, lambda q: dense.jacobian(tree, q, i, reference, offset))  # noqa: B023
        assert_close(dense.jacobian_dot(tree, q, v, i, reference, offset), rate, DIFFERENCE)


def test_com_moves_as_its_jacobian_says(tree: Tree, rng: np.random.Generator) -> None:
    q, v, a, *_ = random_state(tree, rng)
    assert_close(along(tree, q, v, lambda q: dense.com(tree, q)), dense.com_velocity(tree, q, v), DIFFERENCE)
    drift = along(tree, q, v, lambda q: dense.com_velocity(tree, q, v))
    assert_close(dense.com_jacobian(tree, q) @ a + drift, dense.com_acceleration(tree, q, v, a), DIFFERENCE)


def test_centroidal_map_gives_the_momentum(tree: Tree, rng: np.random.Generator) -> None:
    q, v, *_ = random_state(tree, rng)
    h = dense.centroidal_momentum(tree, q, v)
    assert_close(dense.centroidal_map(tree, q) @ v, h, IDENTITY)
    assert_close(dense.total_mass(tree) * dense.com_velocity(tree, q, v), h[:3], IDENTITY)
    rate = along(tree, q, v, lambda q: dense.centroidal_map(tree, q))
    assert_close(dense.centroidal_map_dot(tree, q, v), rate, DIFFERENCE)


def test_free_robot_keeps_its_momentum(rng: np.random.Generator) -> None:
    made = random_tree(8, 6, floating=True, armature=False).tree
    q, v, _, tau, _ = random_state(made, rng)
    tau[:6] = 0.0  # nothing holds the base
    a = dense.aba(made, q, v, tau)
    rate = dense.centroidal_map(made, q) @ a + dense.centroidal_map_dot(made, q, v) @ v
    weight = dense.total_mass(made) * np.asarray(made.gravity)
    assert_close(rate, np.r_[weight, np.zeros(3)], IDENTITY)


# --- limits ---------------------------------------------------------------------------------------------


def test_empty_tree_answers() -> None:
    empty = Tree(())
    assert dense.rnea(empty, [], [], []).shape == dense.aba(empty, [], [], []).shape == (0,)
    assert dense.crba(empty, []).shape == (0, 0)
    assert dense.potential_energy(empty, []) == dense.kinetic_energy(empty, [], []) == 0.0
    assert (dense.placements(empty, []) == np.eye(4)).all()


def test_random_trees_are_the_same_for_a_seed_and_cover_every_kind() -> None:
    one, two = random_tree(2, 10), random_tree(2, 10)
    assert one.builder.robot() == two.builder.robot()
    kinds = {b.kind for make in TREES.values() for b in make().tree.bodies}
    assert kinds == set(dense.NV)


@pytest.mark.parametrize("floating", [False, True])
def test_joint_names_are_in_depth_first_order(floating: bool) -> None:
    made = random_tree(9, 20, floating=floating, branching=0.5)
    children, names = made.builder.robot().children, []

    def visit(link: str) -> None:
        for joint in children[link]:
            if joint.kind != "fixed":
                names.append(joint.name)
            visit(joint.child)

    visit("b0000")
    assert names == [f"j{i:04d}" for i in range(1 + floating, 21 + floating)]
    assert len(set(made.tree.parents)) < 18  # it does branch


# --- against Pinocchio ----------------------------------------------------------------------------------


def turn(body: Body) -> Array:
    """Rotation (3, 3) of Pinocchio's body frame in ours: its planar and unbounded joints are built about z alone."""
    return dense.shortest_rotation(body.axis) if body.kind in ("planar_cs", "continuous_cs") else np.eye(3)


def to_pinocchio(pin: Any, tree: Tree) -> Any:
    """The same tree as a Pinocchio model, with the body frames of ``turn``."""
    kinds = {
        "revolute": lambda b: pin.JointModelRevoluteUnaligned(np.asarray(b.axis, float)),
        "prismatic": lambda b: pin.JointModelPrismaticUnaligned(np.asarray(b.axis, float)),
        "helical": lambda b: pin.JointModelHelicalUnaligned(np.asarray(b.axis, float), b.pitch),
        "continuous_cs": lambda b: pin.JointModelRUBZ(),
        "spherical": lambda b: pin.JointModelSpherical(),
        "floating": lambda b: pin.JointModelFreeFlyer(),
        "planar_cs": lambda b: pin.JointModelPlanar(),
    }
    model = pin.Model()
    model.gravity = pin.Motion(np.array(tree.gravity), np.zeros(3))
    turns = [np.eye(3), *(turn(b) for b in tree.bodies)]
    for i, b in enumerate(tree.bodies, 1):
        placement = dense.pose(turns[max(b.parent, 0)].T) @ b.placement @ dense.pose(turns[i])
        model.addJoint(max(b.parent, 0), kinds[b.kind](b), pin.SE3(placement), f"j{i}")
        Q = turns[i].T
        inertia = pin.Inertia(b.mass, Q @ np.asarray(b.com), Q @ np.asarray(b.inertia) @ Q.T)
        model.appendBodyToJoint(i, inertia, pin.SE3.Identity())
    model.armature = np.array([b.armature for b in tree.bodies for _ in range(dense.NV[b.kind])])
    return model


@pytest.mark.parametrize("seed", range(6))
def test_oracle_equals_pinocchio(seed: int) -> None:
    """From seed 4 on with helical joints."""
    pin = pytest.importorskip("pinocchio")
    kinds, gravity = SCREWS if seed > 3 else KINDS, (0.3, -0.2, -9.7)
    tree = random_tree(20 + seed, 9, kinds, bool(seed % 2), "cos_sin", gravity=gravity).tree
    model = to_pinocchio(pin, tree)
    data = model.createData()
    armature = model.armature.copy()
    assert (model.nq, model.nv, model.njoints) == (tree.nq, tree.nv, tree.njoints)
    q, v, a, tau, fext = random_state(tree, np.random.default_rng(seed))
    turns = [dense.pose(Q) for Q in [np.eye(3), *(turn(b) for b in tree.bodies)]]
    forces = pin.StdVec_Force([pin.SE3(Q).actInv(pin.Force(f)) for Q, f in zip(turns, fext, strict=True)])

    def same(ours: Any, theirs: Any, what: str) -> None:
        assert_close(ours, theirs, PINOCCHIO, what)

    same(dense.rnea(tree, q, v, a, fext), pin.rnea(model, data, q, v, a, forces), "rnea")
    same(dense.aba(tree, q, v, tau, fext), pin.aba(model, data, q, v, tau, forces), "aba")
    M = np.triu(pin.crba(model, data, q))
    same(np.triu(dense.crba(tree, q)), M, "crba")
    same(dense.bias(tree, q, v), pin.nonLinearEffects(model, data, q, v), "bias")
    same(dense.gravity_torque(tree, q), pin.computeGeneralizedGravity(model, data, q), "gravity")
    same(dense.minverse(tree, q), pin.computeMinverse(model, data, q), "minverse")
    # Pinocchio 4.1 leaves the armature of JointModelRevoluteUnaligned and HelicalUnaligned out of T, not out of M
    hinges = [b.kind in ("revolute", "helical") for b in tree.bodies for _ in range(dense.NV[b.kind])]
    lost = 0.5 * float(np.sum((model.armature * v**2)[hinges]))
    model.armature = np.where(hinges, 0.0, model.armature)
    theirs = pin.computeKineticEnergy(model, data, q, v)
    same(dense.kinetic_energy(tree, q, v) - lost, theirs, "kinetic energy")
    model.armature = armature
    same(dense.potential_energy(tree, q), pin.computePotentialEnergy(model, data, q), "potential energy")
    pin.centerOfMass(model, data, q, v, a)
    same(dense.com(tree, q), data.com[0], "com")
    same(dense.com_velocity(tree, q, v), data.vcom[0], "com velocity")
    same(dense.com_acceleration(tree, q, v, a), data.acom[0], "com acceleration")
    same(dense.com_jacobian(tree, q), pin.jacobianCenterOfMass(model, data, q), "com jacobian")
    pin.dccrba(model, data, q, v)
    same(dense.centroidal_map(tree, q), data.Ag, "Ag")
    same(dense.centroidal_momentum(tree, q, v), data.hg.vector, "hg")
    same(dense.centroidal_map_dot(tree, q, v), data.dAg, "dAg")
    same(dense.integrate(tree, q, v), pin.integrate(model, q, v), "integrate")
    there = random_state(tree, np.random.default_rng(99)).q
    same(dense.difference(tree, q, there), pin.difference(model, q, there), "difference")

    pin.forwardKinematics(model, data, q, v, a)
    pin.computeJointJacobiansTimeVariation(model, data, q, v)
    frames = dict(local=pin.LOCAL, world=pin.WORLD, local_world_aligned=pin.LOCAL_WORLD_ALIGNED)
    for i in range(1, tree.njoints):
        same(dense.placements(tree, q)[i] @ turns[i], data.oMi[i].homogeneous, "placement")
    for reference, theirs in frames.items():
        vel = dense.velocities(tree, q, v, reference)
        spatial, classical = (dense.accelerations(tree, q, v, a, reference, kind) for kind in (False, True))
        for i in range(1, tree.njoints):
            Q = pin.SE3(turns[i]).toActionMatrixInverse() if reference == "local" else np.eye(6)
            same(Q @ vel[i], pin.getVelocity(model, data, i, theirs).vector, "velocity")
            same(Q @ spatial[i], pin.getAcceleration(model, data, i, theirs).vector, "acceleration")
            same(Q @ classical[i], pin.getClassicalAcceleration(model, data, i, theirs).vector, "classical")
            J = Q @ dense.jacobian(tree, q, i, reference)
            same(J, pin.getJointJacobian(model, data, i, theirs), f"{reference} jacobian")
            Jd = Q @ dense.jacobian_dot(tree, q, v, i, reference)
            same(Jd, pin.getJointJacobianTimeVariation(model, data, i, theirs), f"{reference} jacobian dot")
