"""The compiled operators on small arrays equal their source in plain Python."""

from __future__ import annotations

import sys
import weakref
from typing import Any

import numpy as np
import pytest

from spatialdyn.algebra import euclidean, lie, public_arrays, spatial
from spatialdyn.compat.native import operator_kernels, operators
from spatialdyn.engines import object_layout
from spatialdyn.engines.compiled import numba_kernels

EPS = float(np.finfo(float).eps)
MOST = float(np.finfo(float).max)  # the wheel's limit where there is none

compiled = pytest.mark.skipif(not object_layout.READY or numba_kernels.PLAIN, reason="nothing is compiled")

OPERATIONS: dict[str, tuple[Any, ...]] = {  # the function, the kinds of its arguments, and of its result
    "compose": (spatial.compose, "pose", "pose", "pose"),
    "inverse": (spatial.inverse, "pose", "pose"),
    "relative": (operators.relative_pose, "pose", "pose", "pose"),
    "motion_to_parent": (spatial.motion_to_parent, "pose", "motion", "motion"),
    "motion_to_child": (spatial.motion_to_child, "pose", "motion", "motion"),
    "force_to_parent": (spatial.force_to_parent, "pose", "force", "force"),
    "force_to_child": (spatial.force_to_child, "pose", "force", "force"),
    "body_to_parent": (operators.body_to_parent, "pose", "body", "body"),
    "body_to_child": (operators.body_to_child, "pose", "body", "body"),
    "cross_motion": (spatial.cross_motion, "motion", "motion", "motion"),
    "cross_force": (spatial.cross_force, "motion", "force", "force"),
    "momentum": (operators.body_momentum, "body", "motion", "force"),
    "add_body": (operators.add_bodies, "body", "body", "body"),
    "sub_body": (operators.without, "body", "body", "body"),
    "from_xyzquat": (operators.pose_of_seven, "seven", "pose"),
    "to_xyzquat": (operators.seven_of_pose, "pose", "seven"),
    "exp6": (operators.exp_pose, "motion", "pose"),
    "log6": (operators.log_pose, "pose", "motion"),
    "log6_jacobian": (operators.log_pose_jacobian, "pose", "tangent"),
    "quat_matrix": (lie.matrix, "quat", "rot"),
    "matrix_quat": (operators.quaternion_of_matrix, "rot", "quat"),
    "quat_product": (lie.product, "quat", "quat", "quat"),
}
SHAPES = operator_kernels.SHAPES


def operator(function: Any, *kinds: str) -> Any:
    """The operator of these kinds, of the result last."""
    *takes, made = kinds
    return operator_kernels.Operator(function, {f"x{k}": kind for k, kind in enumerate(takes)}, made)


def computed(name: str, *given: Any) -> Any:
    """The result of the operator in plain Python."""
    return operator(*OPERATIONS[name]).in_plain_python(*given)


def given(kind: str, rng: np.random.Generator) -> Any:
    """A random array of a kind."""
    x = rng.standard_normal(SHAPES[kind])
    if kind in ("pose", "seven", "quat"):
        q = rng.standard_normal(4)
        q /= np.linalg.norm(q)
        if kind == "quat":
            return q
        seven = np.concatenate([rng.standard_normal(3), q])
        return seven if kind == "seven" else computed("from_xyzquat", seven)
    return abs(x) if kind == "body" else x


@compiled
@pytest.mark.parametrize("name", OPERATIONS)
def test_compiled_operators_have_the_bits_of_their_source(name: str) -> None:
    function, *takes, made = OPERATIONS[name]
    own = operator(function, *takes, made)
    routine = own.routine()
    routine.entry.compile_now()
    call = routine.bind({f"class{k}": 0 for k in range(3)} | {"slot": 0, "made": 0})
    for seed in range(5):
        rng = np.random.default_rng(seed)
        inputs = [given(kind, rng) for kind in takes]
        before, plain = [x.copy() for x in inputs], np.full(SHAPES[made], np.nan)
        out = call(*inputs)
        arguments = [
            getattr(public_arrays, f"read_{kind}")(x.tolist() if x.ndim == 1 else x)
            for kind, x in zip(takes, inputs, strict=True)
        ]
        getattr(public_arrays, f"write_{made}")(plain, function(*arguments))
        np.testing.assert_array_equal(out, plain)
        np.testing.assert_array_equal(out, own.in_plain_python(*inputs))
        assert all(np.array_equal(x, y) for x, y in zip(inputs, before, strict=True))


@pytest.mark.parametrize("name", ["compose", "force_to_child", "add_body"])
def test_kernels_have_the_bits_of_the_operators(name: str) -> None:
    _, one, other, made = OPERATIONS[name]
    rng, kernel = np.random.default_rng(0), getattr(operator_kernels, name)
    A, B, out, again = given(one, rng), given(other, rng), np.empty(SHAPES[made]), np.empty(SHAPES[made])
    kernel(A, B, out)
    np.testing.assert_array_equal(out, computed(name, A, B))
    kernel.compile_now()
    kernel(A, B, again)
    np.testing.assert_array_equal(out, again)


def test_an_input_may_be_the_output() -> None:
    rng = np.random.default_rng(0)
    A, B, out = given("pose", rng), given("pose", rng), np.empty((4, 4))
    operator_kernels.compose(A, B, out)
    operator_kernels.compose(A, B, A)
    assert np.array_equal(A, out)


@pytest.mark.parametrize(
    "turn", [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (1, -1, 1, -1), (1, 1e-9, 0, 0)]
)
def test_quaternion_of_a_matrix_is_exact_at_half_a_turn(turn: tuple[float, ...]) -> None:
    q = np.array(turn, float) / np.linalg.norm(turn)
    back = computed("matrix_quat", computed("quat_matrix", q))
    assert min(np.abs(back - q).max(), np.abs(back + q).max()) <= 4 * EPS


def test_a_kernel_is_made_at_its_first_call_and_once() -> None:
    made: list[int] = []
    function = operator_kernels.deferred(lambda: made.append(1) or (lambda x: x + 1))
    assert made == []
    assert (function(1), function(2), made) == (2, 3, [1])


def test_a_rotational_inertia_is_judged() -> None:
    for J, fault in (
        (np.eye(3), operators.SOUND),
        (np.zeros((3, 3)), operators.SOUND),
        (np.diag([1.0, 1.0, 0.0]), operators.SOUND),
        (np.diag([1.0, 1.0, -1e-13]), operators.SOUND),  # a rounding error
        (np.diag([1.0, 1.0, -0.1]), operators.NEGATIVE),
        (np.diag([-1.0, -1.0, 0.1]), operators.NEGATIVE),
        (np.arange(9.0).reshape(3, 3), operators.ASYMMETRIC),
    ):
        assert operators.fault_of_inertia(public_arrays.read_rot(J)) == fault


def test_random_rotations_are_uniform() -> None:
    """Shoemake's map of a grid of the unit cube: all moments of degree two and four of a uniform unit quaternion."""
    at = (np.arange(20) + 0.5) / 20
    u = np.stack(np.meshgrid(at, at, at), axis=-1).reshape(-1, 3)
    q = np.array([operators.random_rotation(euclidean.Vec(*x)) for x in u.tolist()])
    np.testing.assert_allclose((q * q).sum(1), 1.0, rtol=0.0, atol=4 * EPS)
    np.testing.assert_allclose(q.T @ q / len(q), np.eye(4) / 4.0, rtol=0.0, atol=1e-12)
    fourth = np.einsum("ni,nj->ij", q * q, q * q) / len(q)
    np.testing.assert_allclose(fourth, (1.0 + 2.0 * np.eye(4)) / 24.0, rtol=0.0, atol=1e-3)


def test_near_and_same_count_each_entry() -> None:
    a = np.array([3.0, 0.0, 4.0])
    for k in range(3):
        b = a.copy()
        b[k] += 1e-3
        assert (operators.same(a, b), operators.same(a, a)) == (0.0, 1.0)
        assert (operators.near(a, b, 2.1e-4), operators.near(a, b, 1.9e-4)) == (1.0, 0.0)
    assert operators.near(a, np.full(3, np.nan), 1.0) == operators.same(a, np.full(3, np.nan)) == 0.0


# --- on objects --------------------------------------------------------------------------------------------


class Box:
    """An object that holds an array in a slot."""

    __slots__ = ("__dict__", "x")

    def __init__(self, x: Any) -> None:
        self.x = x


class Other(Box):
    """Another class."""

    __slots__ = ()


def bound(*operation: Any) -> Any:
    slot = object_layout.slot_offset(Box, "x")
    return operator(*operation).bind(slot, {"Pose": Box, "Motion": Box})


@compiled
def test_objects_are_read_and_made() -> None:
    rng = np.random.default_rng(0)
    A, B = given("pose", rng), given("pose", rng)
    compose, out = bound(spatial.compose, "Pose", "Pose|pose", "Pose"), computed("compose", A, B)
    for other in (Box(B), B, np.asfortranarray(B), np.repeat(B, 2, axis=1)[:, ::2]):
        made = compose(Box(A), other)
        assert type(made) is Box
        assert np.array_equal(made.x, out)
        made.note = 1
        assert made.x.flags.writeable
        assert made.x.flags.owndata
    power = bound(spatial.power, "motion", "force", "number")
    assert power(np.ones(6), np.arange(6.0)) == 15.0
    assert type(power(np.ones(6), np.arange(6.0))) is float


@compiled
def test_an_object_that_does_not_apply_gives_none() -> None:
    A, compose = Box(np.eye(4)), bound(spatial.compose, "Pose", "Pose|pose", "Pose")
    wrong = (
        Other(np.eye(4)),
        1,
        None,
        "x",
        [1.0],
        np.eye(3),
        np.eye(4, dtype=np.float32),
        np.zeros(4),
        Box.__new__(Box),
    )
    for x in (*wrong, Box(np.eye(3)), Box(1), np.eye(4).astype(">f8")):
        assert compose(A, x) is None
        assert compose(x, A) is None
    assert compose(np.eye(4), A) is compose(A) is compose() is compose(A, A, A) is None


LIMITS = np.array([[-2.0, 3.0], [-MOST, 3.0], [-2.0, MOST], [-MOST, MOST], [-np.inf, 3.0], [-np.inf, np.inf]]).T
RANGES = np.array([[-2.0, 3.0], [1.0, 3.0], [-2.0, 0.0], [-1.0, 1.0], [1.0, 3.0], [-1.0, 1.0]]).T


def test_a_bound_that_is_none_is_two_away() -> None:
    for low, high, first, last in zip(*LIMITS.tolist(), *RANGES.tolist(), strict=True):
        assert operators.between(low, high, 0.0) == first
        assert operators.between(low, high, 1.0) == last


@compiled
def test_draws_are_those_of_the_generator() -> None:
    generator, twin = np.random.default_rng(5), np.random.default_rng(5)
    draw = operator_kernels.draw_between(generator, 6)
    draws = twin.random(6)
    expected = [operators.between(*x) for x in zip(*LIMITS.tolist(), draws.tolist(), strict=True)]
    assert np.abs(draw(*LIMITS) - expected).max() <= 4 * EPS
    generator.bit_generator.state = np.random.default_rng(5).bit_generator.state
    assert np.abs(draw(*LIMITS) - expected).max() <= 4 * EPS
    assert draw(LIMITS[0], LIMITS[1, :5]) is draw(LIMITS, LIMITS) is draw(1, 2) is None


@compiled
def test_objects_and_arrays_are_freed() -> None:
    """A result holds the one reference to its array, and no call holds one to its arguments."""
    compose = bound(spatial.compose, "Pose", "Pose|pose", "Pose")
    A = Box(np.eye(4))
    made = compose(A, A)
    counts = sys.getrefcount(A), sys.getrefcount(A.x), sys.getrefcount(Box)
    held = sys.getrefcount(made.x)
    assert held == 2  # its slot, and the argument of the call
    for _ in range(1000):
        compose(A, A)
        compose(A, 1)
    assert counts == (sys.getrefcount(A), sys.getrefcount(A.x), sys.getrefcount(Box))
    left = weakref.ref(made.x)
    del made
    assert left() is None


@pytest.mark.parametrize("least", [1e-3, 1e-9, -1e-9, -1e-3, -1.0])
def test_an_inertia_is_faulty_if_and_only_if_an_eigenvalue_is_negative(least: float) -> None:
    """In any orientation; the determinant alone is positive of two negative ones."""
    rng = np.random.default_rng(0)
    for others in ((2.0, 5.0), (3.0, 1.0), (-3.0 if least < 0.0 else 3.0, 7.0)):
        for _ in range(50):
            Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
            J = (Q * [least, *others]) @ Q.T
            J = 0.5 * (J + J.T)
            wanted = operators.NEGATIVE if least < 0.0 else operators.SOUND
            assert operators.fault_of_inertia(euclidean.Mat3(*J.ravel().tolist())) == wanted
            for k in np.ndindex(3, 3):
                if k[0] != k[1]:
                    off = J.copy()
                    off[k] += 1e-10 * abs(J).sum()
                    assert operators.fault_of_inertia(euclidean.Mat3(*off.ravel().tolist())) == operators.ASYMMETRIC


def test_random_rotations_are_of_unit_norm_and_uniform() -> None:
    """Over the unit cube the second and fourth moments are those of the sphere."""
    n = 16
    cube = (np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 3) + 0.5) / n
    q = np.array([operators.random_rotation(euclidean.Vec(*u)) for u in cube.tolist()])
    np.testing.assert_allclose((q * q).sum(1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(q.T @ q / len(q), np.eye(4) / 4.0, atol=1e-14)
    fourth = np.einsum("si,sj->ij", q * q, q * q) / len(q)  # 1/8 on the diagonal, 1/24 off it
    np.testing.assert_allclose(fourth, (np.ones((4, 4)) + 2.0 * np.eye(4)) / 24.0, atol=1e-3)


def test_a_listed_operator_is_the_operator_row_by_row() -> None:
    rng = np.random.default_rng(1)
    a, b = np.empty((3, 4, 4)), rng.normal(size=(5, 6))
    exp6 = operator_kernels.Operator(operators.exp_pose, {"v": "motion"}, "pose")
    for X in a:
        X[...] = exp6.in_plain_python(rng.normal(size=6))
    places, out = np.array([2, 0, 0, 1, 2]), np.empty((5, 6))
    motion_to_parent = operator_kernels.Operator(spatial.motion_to_parent, {"X": "pose", "m": "motion"}, "motion")
    operator_kernels.motions_to_parent(a, places, b, out)
    for k, place in enumerate(places):
        np.testing.assert_array_equal(out[k], motion_to_parent.in_plain_python(a[place], b[k]))
