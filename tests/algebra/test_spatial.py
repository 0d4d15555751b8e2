"""Every spatial operator against the 6 x 6 matrix it stands for."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any, get_type_hints

import numpy as np
import pytest
from dense import Array, crf, crm, flip, plucker, skew, spatial_inertia
from trees import random_inertia, random_placement

from spatialdyn.algebra import articulated as ar
from spatialdyn.algebra import coriolis_factor as cp
from spatialdyn.algebra import euclidean as eu
from spatialdyn.algebra import public_arrays, records
from spatialdyn.algebra import spatial as sp
from spatialdyn.algebra.articulated import Articulated
from spatialdyn.algebra.coriolis_factor import CoriolisFactor
from spatialdyn.algebra.euclidean import Mat3, Sym, Vec
from spatialdyn.algebra.spatial import Force, Inertia, Motion, Pose

CLOSE = 64 * np.finfo(float).eps  # of the largest entry: products of three 6 x 6 matrices
SEEDS = range(6)
UPPER = np.triu_indices(3)


# --- between tuples and matrices ------------------------------------------------------------------------


def vec(a: Array) -> Vec:
    return Vec(*np.asarray(a).tolist())


def rot(A: Array) -> Mat3:
    return Mat3(*np.asarray(A).ravel().tolist())


def sym(A: Array) -> Sym:
    return Sym(*np.asarray(A)[UPPER].tolist())


def full(A: Sym) -> Array:
    return np.array([[A.xx, A.xy, A.xz], [A.xy, A.yy, A.yz], [A.xz, A.yz, A.zz]])


def square(A: Mat3) -> Array:
    return np.reshape(A, (3, 3))


def motion(m: Array) -> Motion:
    return Motion(vec(m[:3]), vec(m[3:]))


def force(f: Array) -> Force:
    return Force(vec(f[:3]), vec(f[3:]))


def flat(m: Motion | Force) -> Array:
    return np.array([*m[0], *m[1]])


def pose(T: Array) -> Pose:
    return Pose(rot(T[:3, :3]), vec(T[:3, 3]))


def placed(X: Pose) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = square(X.R), X.p
    return T


def body(mass: float, com: Array, inertia: Array) -> Inertia:
    c = np.asarray(com)
    return Inertia(mass, vec(mass * c), sym(inertia + mass * (c @ c * np.eye(3) - np.outer(c, c))))


def of_body(I: Inertia) -> Array:
    return np.block([[full(I.I), skew(I.h)], [skew(I.h).T, I.m * np.eye(3)]])


def of_articulated(A: Articulated) -> Array:
    return np.block([[full(A.I), square(A.H)], [square(A.H).T, full(A.M)]])


def close(x: Any, y: Any) -> None:
    x, y = np.asarray(x, float), np.asarray(y, float)
    assert x.shape == y.shape
    assert abs(x - y).max() <= CLOSE * max(1.0, abs(y).max())


class Sample:
    """Random quantities as arrays."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.a, self.b = rng.normal(size=(2, 3))
        self.m, self.v, self.f, self.g = rng.normal(size=(4, 6))
        self.A, self.B = rng.normal(size=(2, 3, 3))
        self.P = self.A + self.A.T
        self.T, self.U = random_placement(rng), random_placement(rng)
        self.T[:3, 3], self.U[:3, 3] = rng.normal(size=(2, 3))
        self.X = plucker(self.T)
        self.inertia, self.other = random_inertia(rng), random_inertia(rng)
        S = rng.normal(size=(6, 6))
        self.K = S @ S.T  # any articulated inertia: symmetric positive definite
        self.s = float(rng.normal())


@pytest.fixture(params=SEEDS)
def x(request: pytest.FixtureRequest) -> Sample:
    return Sample(request.param)


def artic(K: Array) -> Articulated:
    return Articulated(sym(K[:3, :3]), rot(K[:3, 3:]), sym(K[3:, 3:]))


# --- three-vectors and 3 x 3 matrices -------------------------------------------------------------------

THREE: dict[str, tuple[Callable[[Sample], Any], Callable[[Sample], Any]]] = {
    "add": (lambda x: eu.add(vec(x.a), vec(x.b)), lambda x: x.a + x.b),
    "sub": (lambda x: eu.sub(vec(x.a), vec(x.b)), lambda x: x.a - x.b),
    "neg": (lambda x: eu.neg(vec(x.a)), lambda x: -x.a),
    "scale": (lambda x: eu.scale(x.s, vec(x.a)), lambda x: x.s * x.a),
    "dot": (lambda x: eu.dot(vec(x.a), vec(x.b)), lambda x: x.a @ x.b),
    "cross": (lambda x: eu.cross(vec(x.a), vec(x.b)), lambda x: skew(x.a) @ x.b),
    "rotate": (lambda x: eu.rotate(rot(x.A), vec(x.a)), lambda x: x.A @ x.a),
    "unrotate": (lambda x: eu.unrotate(rot(x.A), vec(x.a)), lambda x: x.A.T @ x.a),
    "matmul": (lambda x: square(eu.matmul(rot(x.A), rot(x.B))), lambda x: x.A @ x.B),
    "transpose": (lambda x: square(eu.transpose(rot(x.A))), lambda x: x.A.T),
    "add_mat3": (lambda x: square(eu.add_mat3(rot(x.A), rot(x.B))), lambda x: x.A + x.B),
    "apply_sym": (lambda x: eu.apply_sym(sym(x.P), vec(x.a)), lambda x: x.P @ x.a),
    "add_sym": (lambda x: full(eu.add_sym(sym(x.P), sym(x.B + x.B.T))), lambda x: x.P + x.B + x.B.T),
    "sub_sym": (lambda x: full(eu.sub_sym(sym(x.P), sym(x.B + x.B.T))), lambda x: x.P - x.B - x.B.T),
    "congruence": (lambda x: full(eu.congruence(rot(x.B), sym(x.P))), lambda x: x.B @ x.P @ x.B.T),
    "acceleration_matrix": (
        lambda x: square(eu.acceleration_matrix(vec(x.a), vec(x.b))),
        lambda x: skew(x.b) + skew(x.a) @ skew(x.a),
    ),
    "newton_euler_moment": (
        lambda x: eu.newton_euler_moment(sym(x.P), vec(x.a), vec(x.b), eu.acceleration_matrix(vec(x.a), vec(x.b))),
        lambda x: x.P @ x.b + np.cross(x.a, x.P @ x.a),
    ),
    "identity": (lambda x: square(eu.identity()), lambda x: np.eye(3)),
    "zero": (lambda x: eu.zero(), lambda x: np.zeros(3)),
    "zero_mat3": (lambda x: square(eu.zero_mat3()), lambda x: np.zeros((3, 3))),
    "zero_sym": (lambda x: full(eu.zero_sym()), lambda x: np.zeros((3, 3))),
}

# --- motions, forces and poses --------------------------------------------------------------------------

SIX: dict[str, tuple[Callable[[Sample], Any], Callable[[Sample], Any]]] = {
    "add_motion": (lambda x: flat(sp.add_motion(motion(x.m), motion(x.v))), lambda x: x.m + x.v),
    "sub_motion": (lambda x: flat(sp.sub_motion(motion(x.m), motion(x.v))), lambda x: x.m - x.v),
    "scale_motion": (lambda x: flat(sp.scale_motion(x.s, motion(x.m))), lambda x: x.s * x.m),
    "add_force": (lambda x: flat(sp.add_force(force(x.f), force(x.g))), lambda x: x.f + x.g),
    "sub_force": (lambda x: flat(sp.sub_force(force(x.f), force(x.g))), lambda x: x.f - x.g),
    "scale_force": (lambda x: flat(sp.scale_force(x.s, force(x.f))), lambda x: x.s * x.f),
    "zero_motion": (lambda x: flat(sp.zero_motion()), lambda x: np.zeros(6)),
    "zero_force": (lambda x: flat(sp.zero_force()), lambda x: np.zeros(6)),
    "power": (lambda x: sp.power(motion(x.m), force(x.f)), lambda x: x.m @ x.f),
    "cross_motion": (lambda x: flat(sp.cross_motion(motion(x.v), motion(x.m))), lambda x: crm(x.v) @ x.m),
    "cross_force": (lambda x: flat(sp.cross_force(motion(x.v), force(x.f))), lambda x: crf(x.v) @ x.f),
    "compose": (lambda x: placed(sp.compose(pose(x.T), pose(x.U))), lambda x: x.T @ x.U),
    "inverse": (lambda x: placed(sp.inverse(pose(x.T))), lambda x: np.linalg.inv(x.T)),
    "identity_pose": (lambda x: placed(sp.identity_pose()), lambda x: np.eye(4)),
    "motion_to_child": (lambda x: flat(sp.motion_to_child(pose(x.T), motion(x.m))), lambda x: x.X @ x.m),
    "motion_to_parent": (
        lambda x: flat(sp.motion_to_parent(pose(x.T), motion(x.m))),
        lambda x: np.linalg.solve(x.X, x.m),
    ),
    "force_to_parent": (lambda x: flat(sp.force_to_parent(pose(x.T), force(x.f))), lambda x: x.X.T @ x.f),
    "force_to_child": (
        lambda x: flat(sp.force_to_child(pose(x.T), force(x.f))),
        lambda x: np.linalg.solve(x.X.T, x.f),
    ),
}

# --- inertias -------------------------------------------------------------------------------------------

BODIES: dict[str, tuple[Callable[[Sample], Any], Callable[[Sample], Any]]] = {
    "momentum": (
        lambda x: flat(sp.momentum(body(*x.inertia), motion(x.v))),
        lambda x: spatial_inertia(*x.inertia) @ x.v,
    ),
    "add_inertia": (
        lambda x: of_body(sp.add_inertia(body(*x.inertia), body(*x.other))),
        lambda x: spatial_inertia(*x.inertia) + spatial_inertia(*x.other),
    ),
    "inertia_to_parent": (
        lambda x: of_body(sp.inertia_to_parent(pose(x.T), body(*x.inertia))),
        lambda x: x.X.T @ spatial_inertia(*x.inertia) @ x.X,
    ),
    "inertia_rate": (
        lambda x: of_body(sp.inertia_rate(body(*x.inertia), motion(x.v))),
        lambda x: crf(x.v) @ spatial_inertia(*x.inertia) - spatial_inertia(*x.inertia) @ crm(x.v),
    ),
    "no_articulated": (lambda x: of_articulated(ar.no_articulated()), lambda x: np.zeros((6, 6))),
    "articulated": (
        lambda x: of_articulated(ar.articulated(body(*x.inertia))),
        lambda x: spatial_inertia(*x.inertia),
    ),
    "add_articulated": (
        lambda x: of_articulated(ar.add_articulated(artic(x.K), artic(2.0 * x.K))),
        lambda x: 3.0 * x.K,
    ),
    "articulated_force": (lambda x: flat(ar.articulated_force(artic(x.K), motion(x.m))), lambda x: x.K @ x.m),
    "subtract_outer": (
        lambda x: of_articulated(ar.subtract_outer(artic(x.K), force(x.f), force(x.s * x.f))),
        lambda x: x.K - x.s * np.outer(x.f, x.f),
    ),
    "articulated_to_parent": (
        lambda x: of_articulated(ar.articulated_to_parent(pose(x.T), artic(x.K))),
        lambda x: x.X.T @ x.K @ x.X,
    ),
    "rotate_articulated": (
        lambda x: of_articulated(ar.rotate_articulated(rot(x.T[:3, :3]), artic(x.K))),
        lambda x: turn(x.T[:3, :3]).T @ x.K @ turn(x.T[:3, :3]),
    ),
    "articulated_at_parent": (
        lambda x: of_articulated(ar.articulated_at_parent(vec(x.a), artic(x.K))),
        lambda x: shift(x.a).T @ x.K @ shift(x.a),
    ),
    "parallel_axis": (
        lambda x: full(eu.parallel_axis(sym(x.P), vec(x.a), vec(x.b), vec(x.b + x.s * x.a))),
        lambda x: x.P + x.a @ (2.0 * x.b + x.s * x.a) * np.eye(3) - np.outer(x.b, x.a) - np.outer(x.a, x.b + x.s * x.a),
    ),
}


def skew_of_force(f: Array) -> Array:
    """f×̄*, (6, 6): (f×̄*) m = m ×* f."""
    return np.block([[-skew(f[:3]), -skew(f[3:])], [-skew(f[3:]), np.zeros((3, 3))]])


def factor_matrix(I: Array, v: Array) -> Array:
    """½ (v×* I + (I v)×̄* - I v×), (6, 6)."""
    return 0.5 * (crf(v) @ I + skew_of_force(I @ v) - I @ crm(v))


def of_factor(B: CoriolisFactor) -> Array:
    o = np.zeros((3, 3))
    return np.block([[square(B.P), o], [-skew(B.p), o]])


def turn(R: Array) -> Array:
    """Motion transform (6, 6) from the axes that R is given in to those of orientation R."""
    T = np.eye(4)
    T[:3, :3] = R
    return plucker(T)


def shift(p: Array) -> Array:
    """Motion transform (6, 6) to a parallel frame whose origin lies at p."""
    T = np.eye(4)
    T[:3, 3] = p
    return plucker(T)


def in_axes(R: Array) -> Array:
    """Motion transform (6, 6) from axes of orientation R, which need not be a rotation."""
    return np.kron(np.eye(2), R)


FACTORS: dict[str, tuple[Callable[[Sample], Any], Callable[[Sample], Any]]] = {
    "rotate_motion": (lambda x: flat(sp.rotate_motion(rot(x.A), motion(x.m))), lambda x: in_axes(x.A) @ x.m),
    "rotate_force": (lambda x: flat(sp.rotate_force(rot(x.A), force(x.f))), lambda x: in_axes(x.A) @ x.f),
    "motion_at_child": (lambda x: flat(sp.motion_at_child(vec(x.a), motion(x.m))), lambda x: shift(x.a) @ x.m),
    "force_at_child": (
        lambda x: flat(sp.force_at_child(vec(x.a), force(x.f))),
        lambda x: np.linalg.solve(shift(x.a).T, x.f),
    ),
    "force_at_parent": (lambda x: flat(sp.force_at_parent(vec(x.a), force(x.f))), lambda x: shift(x.a).T @ x.f),
    "rotate_inertia": (
        lambda x: of_body(sp.rotate_inertia(rot(x.T[:3, :3]), body(*x.inertia))),
        lambda x: in_axes(x.T[:3, :3]) @ spatial_inertia(*x.inertia) @ in_axes(x.T[:3, :3]).T,
    ),
    "inertia_at_parent": (
        lambda x: of_body(sp.inertia_at_parent(vec(x.a), body(*x.inertia))),
        lambda x: shift(x.a).T @ spatial_inertia(*x.inertia) @ shift(x.a),
    ),
    "second_moment": (lambda x: full(eu.second_moment(sym(x.P))), lambda x: 0.5 * np.trace(x.P) * np.eye(3) - x.P),
    "coriolis_factor": (
        lambda x: of_factor(cp.coriolis_factor(body(*x.inertia), motion(x.v))),
        lambda x: factor_matrix(spatial_inertia(*x.inertia), x.v),
    ),
    "add_coriolis_factor": (
        lambda x: of_factor(
            cp.add_coriolis_factor(CoriolisFactor(rot(x.A), vec(x.a)), CoriolisFactor(rot(x.B), vec(x.b)))
        ),
        lambda x: of_factor(CoriolisFactor(rot(x.A + x.B), vec(x.a + x.b))),
    ),
    "coriolis_factor_at_parent": (
        lambda x: of_factor(cp.coriolis_factor_at_parent(vec(x.a), CoriolisFactor(rot(x.A), vec(x.b)))),
        lambda x: shift(x.a).T @ of_factor(CoriolisFactor(rot(x.A), vec(x.b))) @ shift(x.a),
    ),
    "coriolis_times": (
        lambda x: flat(cp.coriolis_times(CoriolisFactor(rot(x.A), vec(x.b)), motion(x.m))),
        lambda x: of_factor(CoriolisFactor(rot(x.A), vec(x.b))) @ x.m,
    ),
    "coriolis_transpose_times": (
        lambda x: np.r_[cp.coriolis_transpose_times(CoriolisFactor(rot(x.A), vec(x.b)), motion(x.m)), np.zeros(3)],
        lambda x: of_factor(CoriolisFactor(rot(x.A), vec(x.b))).T @ x.m,
    ),
    "coriolis_force": (
        lambda x: flat(cp.coriolis_force(body(*x.inertia), motion(x.v), motion(x.m))),
        lambda x: factor_matrix(spatial_inertia(*x.inertia), x.v) @ x.m,
    ),
}
OPERATORS = THREE | SIX | BODIES | FACTORS


@pytest.mark.parametrize("name", OPERATORS)
def test_operator_is_the_matrix_it_stands_for(x: Sample, name: str) -> None:
    made, expected = OPERATORS[name]
    close(made(x), expected(x))


def test_every_operator_is_held_to_a_matrix() -> None:
    offered = {
        name
        for room in (eu, sp, cp, ar)
        for name, f in vars(room).items()
        if callable(f) and getattr(f, "__module__", "") == room.__name__
    }
    assert offered - {kind.__name__ for kind in records.TYPES} == set(OPERATORS)


def test_subtract_outer_leaves_no_inertia_along_the_joint(x: Sample) -> None:
    A, S = artic(x.K), motion(x.m)
    U = ar.articulated_force(A, S)
    D = sp.power(S, U)
    left = ar.subtract_outer(A, U, sp.scale_force(1.0 / D, U))
    assert abs(flat(ar.articulated_force(left, S))).max() <= CLOSE * abs(flat(U)).max()


def test_power_does_not_depend_on_the_frame(x: Sample) -> None:
    X = pose(x.T)
    here = sp.power(motion(x.m), force(x.f))
    close(sp.power(sp.motion_to_parent(X, motion(x.m)), sp.force_to_parent(X, force(x.f))), here)


def test_inertia_rate_is_the_derivative_along_the_motion(x: Sample) -> None:
    """Of a body that moves with v for ±h, in the coordinates of its first pose."""
    I, h = body(*x.inertia), 1e-5

    def carried(t: float) -> Array:
        X = np.eye(6) - t * crm(x.v) + 0.5 * t * t * crm(x.v) @ crm(x.v)
        return X.T @ of_body(I) @ X

    by_difference = (carried(h) - carried(-h)) / (2.0 * h)
    assert abs(of_body(sp.inertia_rate(I, motion(x.v))) - by_difference).max() < 1e-8  # h² and eps/h


def test_coriolis_factor_is_antisymmetric_in_its_two_motions(x: Sample) -> None:
    """a·B(I, v) b = -v·B(I, a) b: one number serves six Christoffel symbols."""
    I, (a, b, v) = body(*x.inertia), (motion(m) for m in (x.m, x.f, x.v))
    forward, back = (
        sp.power(a, cp.coriolis_times(cp.coriolis_factor(I, v), b)),
        sp.power(v, cp.coriolis_times(cp.coriolis_factor(I, a), b)),
    )
    assert abs(forward + back) <= CLOSE * max(1.0, abs(forward))


def test_a_force_along_a_force_is_an_error_by_construction() -> None:
    f = force(np.arange(6.0))
    with pytest.raises(AttributeError):
        sp.power(f, f)
    with pytest.raises(AttributeError):
        sp.cross_motion(motion(np.arange(6.0)), f)


def test_operators_are_exact_on_exact_numbers() -> None:
    """The numbers may be anything with + - * /: 3 x 3 rotations of a rational angle stay orthonormal exactly."""
    c, s, o, i = Fraction(3, 5), Fraction(4, 5), Fraction(0), Fraction(1)
    X = Pose(Mat3(c, -s, o, s, c, o, o, o, i), Vec(Fraction(1, 3), Fraction(2, 7), i))
    back = sp.compose(X, sp.inverse(X))
    assert back == Pose(Mat3(i, o, o, o, i, o, o, o, i), Vec(o, o, o))
    assert all(type(entry) is Fraction for part in back for entry in part)


# --- tables ---------------------------------------------------------------------------------------------

FIELDS = {
    Vec: (records.put_vec, records.vec_of),
    Mat3: (records.put_mat3, records.mat3_of),
    Sym: (records.put_sym, records.sym_of),
    Motion: (records.put_motion, records.motion_of),
    Force: (records.put_force, records.force_of),
    Pose: (records.put_pose, records.pose_of),
    Inertia: (records.put_inertia, records.inertia_of),
    Articulated: (records.put_articulated, records.articulated_of),
    CoriolisFactor: (records.put_coriolis_factor, records.coriolis_factor_of),
}


def numbered(kind: Any, count: list[int]) -> Any:
    """A tuple of that type whose numbers are all different."""
    parts = []
    for name in kind._fields:
        inner = get_type_hints(kind)[name]
        if hasattr(inner, "_fields"):
            parts.append(numbered(inner, count))
        else:
            count[0] += 1
            parts.append(float(count[0]))
    return kind(*parts)


@pytest.mark.parametrize("kind", records.TYPES)
def test_a_table_gives_back_what_was_written(kind: Any) -> None:
    table = np.zeros(3, records.table_dtype(before=float, field=kind, after=int))
    put, read = FIELDS[kind]
    value = numbered(kind, [0])
    put(table[1].field, value)
    assert read(table[1].field) == value
    assert read(table[0].field) == read(table[2].field) == numbered_zero(kind)
    assert table[1].before == 0.0
    assert table[1].after == 0


def numbered_zero(kind: Any) -> Any:
    """A tuple of that type of zeros."""
    hints = get_type_hints(kind)
    return kind(*(numbered_zero(hints[n]) if hasattr(hints[n], "_fields") else 0.0 for n in kind._fields))


@pytest.mark.parametrize("kind", records.TYPES)
def test_an_object_twin_holds_any_number_and_counts_with_integers(kind: Any) -> None:
    dtype = records.table_dtype(number=float, field=kind, count=int)
    twin = records.object_twin(dtype)
    assert twin.names == dtype.names
    assert twin["count"] == dtype["count"]
    assert twin["number"] == np.dtype(object)
    table = np.zeros(1, twin)
    put, read = FIELDS[kind]
    value = numbered(kind, [0])
    put(table[0].field, value)
    table[0].number = third = Fraction(1, 3)
    assert read(table[0].field) == value
    assert table[0].number is third


# --- public arrays --------------------------------------------------------------------------------------


def test_public_vectors_are_linear_first(x: Sample) -> None:
    out = np.empty(6)
    public_arrays.write_motion(out, motion(x.m))
    np.testing.assert_array_equal(out, flip(x.m))
    public_arrays.write_force(out, force(x.f))
    np.testing.assert_array_equal(out, flip(x.f))
    assert public_arrays.read_force(out) == force(x.f)
    public_arrays.write_vec(out[:3], vec(x.a))
    np.testing.assert_array_equal(out[:3], x.a)


def test_public_poses_are_four_by_four(x: Sample) -> None:
    out = np.empty((4, 4))
    public_arrays.write_pose(out, pose(x.T))
    np.testing.assert_array_equal(out, x.T)
    assert public_arrays.read_pose(out) == pose(x.T)
