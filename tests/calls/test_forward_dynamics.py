"""Forward dynamics by every method: they agree, and each has the error that its docstring states."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pytest
from dense import Array
from slow import slow_but
from trees import random_inertia, random_placement, random_state, random_tree

import spatialdyn as sd
from spatialdyn.accuracy.references import truths
from spatialdyn.calls.forward_dynamics import METHODS, extended_runs_on_lanes
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.extended import MOST_ROWS
from spatialdyn.engines.programs.record import recording
from spatialdyn.recursions import SPECS

EPS = np.finfo(float).eps
AGREE = 5e-12  # of the largest entry: random trees of a dozen joints are conditioned up to 1e4 (seen: 2e-13)
EXACT = 1e-13  # of the largest entry, what the square-root form promises throughout
REFINED = 1e-14  # of the largest entry, to a tip of 1e9 (seen: 2e-15); one step would leave 3e-14
LOST = 1e-10  # what ABA loses at least with a tip of 1e9: beside that, the figures above mean something
AXES = np.eye(3)
KINDS = ("revolute", "continuous", "prismatic", "spherical", "floating", "planar")


def error(found: Any, wanted: Any) -> float:
    """Largest difference of the largest entry."""
    return float(abs(found - wanted).max() / abs(wanted).max())


def chain(masses: Sequence[float], seed: int, axes: Array | None = None) -> sd.Model:
    """Bodies of these masses, random of shape, on joints about coordinate axes: random ones, or the given in turn.

    Frames are shifted, not turned: all rotations of the table are exact, so that the truth does not depend on the
    algorithm that computes it.
    """
    rng, builder = np.random.default_rng(seed), sd.ModelBuilder("chain")
    for k, mass in enumerate(masses):
        axis = AXES[rng.integers(3)] if axes is None else axes[k % len(axes)]
        whole, com, I = random_inertia(rng)
        placement = rng.uniform(-0.5, 0.5, size=3)
        inertia = (mass, com, mass / whole * I)
        builder.add_body(f"b{k:03d}", f"b{k - 1:03d}" if k else None, "revolute", axis, placement, inertia)
    return builder.build()


def state(model: sd.Model, seed: int) -> tuple[Array, Array, Array]:
    """Random q, v, tau of revolute joints."""
    rng = np.random.default_rng(seed)
    v, tau = rng.normal(size=(2, model.nv))
    return rng.uniform(-3.0, 3.0, model.nv), v, tau


def truth(model: sd.Model, q: Array, v: Array, tau: Array) -> Array:
    """ABA in 240 bits, rounded at the very end."""
    return np.asarray(sd.exact(model, sd.aba)(q, v, tau).astype(float))


# --- by hand ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_a_pendulum_falls_as_its_formula_says(method: str) -> None:
    rod = (2.0, (0.5, 0.0, 0.0), np.diag([0.0, 2.0 / 12.0, 2.0 / 12.0]))
    model = sd.ModelBuilder("rod").add_body("rod", None, "revolute", (0, 1, 0), None, rod, armature=0.1).build()
    q, tau = 0.3, 0.7
    wanted = (tau + 2.0 * 9.81 * 0.5 * np.cos(q)) / (2.0 / 3.0 + 0.1)
    found = sd.forward_dynamics(model, [q], [5.0], [tau], method=method)
    assert abs(found[0] - wanted) <= 8 * EPS * wanted


# --- one answer -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize("seed", slow_but([0, 1], range(4)))
def test_methods_agree_on_random_trees(seed: int, floating: bool, method: str) -> None:
    """All kinds of joint, armatures, branches, and forces on the bodies."""
    made = random_tree(seed, 9, floating=floating, continuous=("angle", "cos_sin")[seed % 2])
    model, s = made.model, random_state(made.tree, np.random.default_rng(seed))
    for fext in (None, s.fext):
        found = sd.forward_dynamics(model, s.q, s.v, s.tau, fext, method)
        assert error(found, sd.aba(model, s.q, s.v, s.tau, fext)) <= AGREE
        assert error(sd.rnea(model, s.q, s.v, found, fext), s.tau) <= AGREE


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_joint_alone(kind: str, method: str) -> None:
    made = random_tree(40, 3, [kind], branching=0.0)
    model, s = made.model, random_state(made.tree, np.random.default_rng(1))
    found = sd.forward_dynamics(model, s.q, s.v, s.tau, method=method)
    assert error(found, sd.exact(model, sd.aba)(s.q, s.v, s.tau).astype(float)) <= AGREE


@pytest.mark.parametrize("method", METHODS)
def test_a_broad_tree_folds_its_children(method: str) -> None:
    """Eight chains on one body: more rows than its stack has room for."""
    builder = sd.ModelBuilder("star")
    rng = np.random.default_rng(5)
    builder.add_body("hub", None, "floating", inertia=random_inertia(rng))
    for k in range(8):
        for j in range(2):
            parent = f"b{k}0" if j else "hub"
            builder.add_body(
                f"b{k}{j}", parent, "revolute", rng.normal(size=3), rng.normal(size=3), random_inertia(rng)
            )
    model = builder.build()
    q, (v, tau) = sd.random_configuration(model, rng), rng.normal(size=(2, model.nv))
    found = sd.forward_dynamics(model, q, v, tau, method=method)
    assert error(found, sd.exact(model, sd.aba)(q, v, tau).astype(float)) <= AGREE


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("armature", [1e-12, 1e-3, 1.0, 1e3, 1e12])
def test_armatures_of_any_size_keep_their_digits(method: str, armature: float) -> None:
    """Where the rotor is most of what a joint moves, and where it is next to nothing of it."""
    builder, rng = sd.ModelBuilder("arm"), np.random.default_rng(3)
    for k in range(5):
        parent, rotor = (f"b{k - 1}", armature) if k else (None, 0.0)
        place, axis, body = rng.uniform(-0.5, 0.5, 3), AXES[k % 3], random_inertia(rng)
        builder.add_body(f"b{k}", parent, "revolute", axis, place, body, armature=rotor)
    model = builder.build()
    q, v, tau = state(model, 3)
    wanted = truth(model, q, v, tau)
    found = sd.forward_dynamics(model, q, v, tau, method=method)
    assert error(found, wanted) <= EXACT
    if armature >= 1e3:  # those that hardly move as well: τ, and inertial forces of the size of 1, over the armature
        assert abs(found - wanted)[1:].max() <= 1e-12 * max(1.0 / armature, abs(wanted[1:]).max())


def test_batches_are_their_samples() -> None:
    made = random_tree(3, 6, ["revolute", "spherical"])
    rng = np.random.default_rng(0)
    q = sd.random_configuration(made.model, rng, (3, 4))
    v, tau = rng.normal(size=(4, made.model.nv)), rng.normal(size=made.model.nv)
    for method in METHODS:
        out = np.empty((3, 4, made.model.nv))
        assert sd.forward_dynamics(made.model, q, v, tau, method=method, out=out) is out
        alone = [[sd.forward_dynamics(made.model, q[i, j], v[j], tau, method=method) for j in range(4)] for i in (0, 2)]
        np.testing.assert_array_equal(out[[0, 2]], alone)


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")
@pytest.mark.parametrize("method", slow_but({*METHODS} - {"square_root"}, METHODS))  # whose kernel compiles for 10 s
def test_batches_over_threads_are_those_of_one(method: str) -> None:
    made = random_tree(4, 5, ["revolute"])
    rng = np.random.default_rng(0)
    q, v, tau = rng.normal(size=(3, 700, made.model.nv))
    q[431, 2] = np.nan
    try:
        sd.set_num_threads(1)
        one = sd.forward_dynamics(made.model, q, v, tau, method=method)
        sd.set_num_threads(3)
        np.testing.assert_array_equal(sd.forward_dynamics(made.model, q, v, tau, method=method), one)
    finally:
        sd.set_num_threads(1)
    sound = np.arange(700) != 431
    assert np.isfinite(one[sound]).all()
    assert np.isnan(one[431]).any()
    assert error(one[sound], sd.aba(made.model, q[sound], v[sound], tau[sound])) <= AGREE


def test_what_branches_on_values_is_no_program_and_the_others_are() -> None:
    made = random_tree(4, 5, ["revolute"])
    fit = {name: recording.fits((SPECS[name],), made.model.bodies) for name in METHODS.values()}
    assert fit == {"aba": True, "crba_solve": True, "aba_refined": True, "aba_square_root": False}
    special = sd.specialize(made.model, sd.aba_square_root)
    assert special.engine == "untraced"
    q, v, tau = np.random.default_rng(0).normal(size=(3, made.model.nv))
    np.testing.assert_array_equal(special(q, v, tau), sd.aba_square_root(made.model, q, v, tau))


def test_mimic_joints_go_through_the_mass_matrix() -> None:
    builder, rng = sd.ModelBuilder("gripper"), np.random.default_rng(0)
    builder.add_body("a", None, "revolute", (0, 0, 1), None, random_inertia(rng), joint_name="lead")
    builder.add_body("b", "a", "revolute", (0, 1, 0), (0.3, 0, 0), random_inertia(rng))
    builder.add_body("c", "b", "revolute", (0, 0, 1), (0.3, 0, 0), random_inertia(rng), mimic={"leader": "lead"})
    model = builder.build(mimic=True)
    q, v, tau = rng.normal(size=(3, 2))
    for method in METHODS:
        a = sd.forward_dynamics(model, q, v, tau, method=method)
        assert error(sd.rnea(model, q, v, a), tau) <= AGREE


# --- digits -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axes", [None, AXES, AXES[2:]], ids=["random", "xyz", "planar"])
@pytest.mark.parametrize("tip", [1e3, 1e6, 1e9, 1e12])
def test_a_heavy_tip_costs_no_digits(tip: float, axes: Array | None) -> None:
    for seed in range(3):
        model = chain([1.0] * 6 + [tip], seed, axes)
        q, v, tau = state(model, 100 + seed)
        wanted = truth(model, q, v, tau)
        assert error(sd.aba_square_root(model, q, v, tau), wanted) <= EXACT
        if tip <= 1e9:
            assert error(sd.aba_refined(model, q, v, tau), wanted) <= REFINED
            if seed == 0 and not numba_kernels.PLAIN:  # on the lanes
                many = sd.aba_refined(model, *(np.tile(x, (512, 1)) for x in (q, v, tau)))
                assert error(many[-1], wanted) <= REFINED
    if tip >= 1e9:
        assert error(sd.aba(model, q, v, tau), wanted) >= LOST


@pytest.mark.parametrize("masses", [(1e-17, 1.0), (1.0, 1e17), (1.0, 1e25)])
def test_the_square_root_form_tells_a_light_joint_from_an_idle_one(masses: tuple[float, float]) -> None:
    """Two sliders along one another: M is singular to float64, its root is not until the ratio is near 1e30."""
    builder = sd.ModelBuilder("sliders")
    for k, mass in enumerate(masses):
        builder.add_body(f"b{k}", f"b{k - 1}" if k else None, "prismatic", (1, 0, 0), None, (mass, np.zeros(3), AXES))
    model = builder.build()
    given = np.array([0.1, -0.2]), np.array([0.3, 0.4]), np.array([2.0, -1.0])
    assert error(sd.aba_square_root(model, *given), truth(model, *given)) <= EXACT
    with pytest.raises(sd.InertiaError, match="b0"):
        sd.aba(model, *given)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("light", [1e-3, 1e-6, 1e-9, 1e-12])
def test_light_links_cost_no_digits(light: float, method: str) -> None:
    for masses in ([1.0] * 6 + [light], [1.0] * 3 + [light] + [1.0] * 3, [light, 1.0] * 3 + [1.0]):
        model = chain(masses, 7)
        q, v, tau = state(model, 7)
        assert error(sd.forward_dynamics(model, q, v, tau, method=method), truth(model, q, v, tau)) <= EXACT


@pytest.mark.parametrize("method", METHODS)
def test_massless_links_may_stand_where_something_moves_behind_them(method: str) -> None:
    builder, rng = sd.ModelBuilder("wrist"), np.random.default_rng(2)
    builder.add_body("a", None, "revolute", (0, 0, 1), None, random_inertia(rng))
    builder.add_body("b", "a", "revolute", (1, 0, 0), (0.2, 0.1, 0.3))
    builder.add_body("c", "b", "prismatic", (0, 1, 0), (0.0, 0.1, -0.2))
    builder.add_body("d", "c", "revolute", (0, 1, 0), (0.1, 0.0, 0.2), random_inertia(rng))
    point = (1.5, (0.1, 0.2, -0.3), np.zeros((3, 3)))
    builder.add_body("e", "d", "revolute", (0, 0, 1), (0.1, 0.0, 0.2), point)
    model = builder.build()
    q, v, tau = state(model, 2)
    assert error(sd.forward_dynamics(model, q, v, tau, method=method), truth(model, q, v, tau)) <= EXACT


def test_inertia_that_no_body_has_keeps_its_square_root() -> None:
    """The triangle inequality broken, as files have it: M is positive definite nonetheless."""
    rng, builder = np.random.default_rng(6), sd.ModelBuilder("wrong")
    for k in range(4):
        R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        I = R @ np.diag([0.1, 0.2, 0.9]) @ R.T
        inertia = (1.0, rng.normal(size=3), 0.5 * (I + I.T))
        builder.add_body(f"b{k}", f"b{k - 1}" if k else None, "revolute", AXES[k % 3], rng.normal(size=3), inertia)
    with pytest.warns(UserWarning, match="principal moments"):
        model = builder.build()
    q, v, tau = state(model, 6)
    assert error(sd.aba_square_root(model, q, v, tau), truth(model, q, v, tau)) <= EXACT


def test_inertia_that_has_no_square_root_is_refused() -> None:
    """A negative principal moment, which the others carry: ABA has an answer to it."""
    builder = sd.ModelBuilder("odd")
    builder.add_body("a", None, "revolute", (0, 0, 1), None, (1.0, (1, 0, 0), np.diag([-0.1, 1, 1])), joint_name="bad")
    with pytest.warns(UserWarning, match="principal moments"):
        model = builder.build()
    assert np.isfinite(sd.aba(model, [0.1], [0.2], [0.3])).all()
    with pytest.raises(sd.InertiaError, match="bad"):
        sd.aba_square_root(model, [0.1], [0.2], [0.3])


@pytest.mark.parametrize("method", ["aba", "refined", "square_root"])
def test_long_chains_keep_their_digits(method: str) -> None:
    model = chain([1.0] * 60, 1)
    q, v, tau = state(model, 1)
    assert error(sd.forward_dynamics(model, q, v, tau, method=method), truth(model, q, v, tau)) <= EXACT


# --- double-double ----------------------------------------------------------------------------------------

ULPS = 4.0  # times what an ulp of q, v and tau moves the exact answer: lanes take the sine of an angle an ulp away


def oblique_chain(tip: float) -> sd.Model:
    """Seven links about parallel axes that lie along no axis of a frame: each turn rounds off the plane of the rest."""
    rng, builder = np.random.default_rng(0), sd.ModelBuilder("oblique")
    axis = rng.normal(size=3)
    for k in range(7):
        mass, com, I = random_inertia(rng)
        scale = (tip if k == 6 else 1.0) / mass
        body = (mass * scale, com, scale * I)
        builder.add_body(f"b{k}", f"b{k - 1}" if k else None, "revolute", axis, rng.uniform(-0.5, 0.5, 3), body)
    return builder.build()


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: double-double of hundreds of samples takes minutes")
@pytest.mark.parametrize("tip", slow_but([1e9], [1.0, 1e6, 1e9]))
def test_extended_keeps_its_digits_where_refinement_does_not(tip: float) -> None:
    model, n = oblique_chain(tip), 512
    rng = np.random.default_rng(1)
    q, (v, tau) = rng.uniform(-3.0, 3.0, (n, model.nv)), rng.normal(size=(2, n, model.nv))
    given = [q, v, tau]
    wanted, doubt = truths(model, "aba", given)
    assert doubt < 1e-20
    near = [np.nextafter(x, np.where(rng.random(x.shape) < 0.5, np.inf, -np.inf)) for x in given]
    scale = abs(wanted).max(axis=1)
    moved = abs(truths(model, "aba", near, 0)[0] - wanted).max(axis=1) / scale
    lanes = abs(sd.forward_dynamics(model, *given, method="extended") - wanted).max(axis=1) / scale
    assert (lanes <= ULPS * np.maximum(moved, 0.5 * EPS)).all()
    alone = sd.forward_dynamics(model, q[3], v[3], tau[3], method="extended")
    assert error(alone, wanted[3]) <= 0.5 * EPS  # rounded once, at the very end
    if tip > 1.0:
        refined = abs(sd.aba_refined(model, *given) - wanted).max(axis=1) / scale
        assert refined.max() > 1e4 * lanes.max()


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: double-double of hundreds of samples takes minutes")
@pytest.mark.parametrize("forces", slow_but([True], [False, True]))
def test_extended_takes_what_every_method_takes(forces: bool) -> None:
    """All kinds of joint, forces, batches that broadcast, an angle beyond the short sine, and a NaN in a sample."""
    made = random_tree(0, 5, ["revolute", "spherical"], floating=True)
    model, rng, n = made.model, np.random.default_rng(0), 512
    states = [random_state(made.tree, rng) for _ in range(8)]
    pick = rng.integers(8, size=n)
    q, v, tau = (np.array([getattr(s, name) for s in states])[pick] for name in ("q", "v", "tau"))
    fext = states[0].fext if forces else None
    turning = next(j for j in model.joints[1:] if j.kind == "revolute")
    q[5, turning.idx_q] += 3e5
    v[7, 0] = np.nan
    found = sd.forward_dynamics(model, q, v, tau, fext, "extended")
    assert np.isnan(found[7]).any()
    for k in (0, 5, 6, n - 1):
        args = (q[k], v[k], tau[k]) if fext is None else (q[k], v[k], tau[k], fext)
        wanted = sd.exact(model, sd.aba)(*args).astype(float)
        near = [error(sd.exact(model, sd.aba)(np.nextafter(q[k], s * np.inf), *args[1:]), wanted) for s in (1, -1)]
        assert error(found[k], wanted) <= ULPS * max(*near, 0.5 * EPS)
        assert error(sd.forward_dynamics(model, *args, method="extended"), wanted) <= EPS
    out = np.empty((2, 3, model.nv))
    assert sd.forward_dynamics(model, q[0], v[:3], tau[:1].repeat(2, 0)[:, None], fext, "extended", out=out) is out
    np.testing.assert_array_equal(out[1], out[0])
    alone = sd.forward_dynamics(model, q[0], v[1], tau[0], fext, "extended")
    np.testing.assert_array_equal(out[0, 1], alone)


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: double-double of a long chain takes minutes")
def test_extended_takes_robots_too_long_for_a_program() -> None:
    model = chain([1.0] * (MOST_ROWS + 1), 1)
    q, v, tau = state(model, 1)
    many = sd.forward_dynamics(model, *(np.tile(x, (512, 1)) for x in (q, v, tau)), method="extended")
    np.testing.assert_array_equal(many[-1], truth(model, q, v, tau))


def test_extended_refuses_what_aba_refuses() -> None:
    model = sd.load_urdf(cart_pole(), root="floating")
    with pytest.raises(sd.InertiaError, match="root_joint"):
        sd.forward_dynamics(model, sd.neutral(model), *np.zeros((2, model.nv)), method="extended")
    with pytest.raises(sd.ShapeError):
        sd.forward_dynamics(model, np.zeros(3), *np.zeros((2, model.nv)), method="extended")


@pytest.mark.parametrize("armature", [1e15, 1e20])
def test_a_joint_behind_a_huge_rotor_keeps_its_own_digits(armature: float) -> None:
    """What a rotor leaves of its joint's acceleration is next to nothing of the parent's: it is found apart from it."""
    for seed in range(6):
        builder, rng = sd.ModelBuilder("arm"), np.random.default_rng(seed)
        for k in range(5):
            place, body = rng.uniform(-0.5, 0.5, 3), random_inertia(rng)
            rotor, parent = armature if k == 3 else 0.0, f"b{k - 1}" if k else None
            builder.add_body(f"b{k}", parent, "revolute", AXES[k % 3], place, body, armature=rotor)
        model = builder.build()
        q, v, tau = state(model, seed)
        wanted = truth(model, q, v, tau)
        assert (abs(sd.aba_square_root(model, q, v, tau) - wanted) <= EXACT * abs(wanted)).all()


# --- units ------------------------------------------------------------------------------------------------


def arm(mass: float, length: float, time: float) -> sd.Model:
    """An arm in other units: axes and placements oblique, a slider, armatures, a heavy tip."""
    builder, rng = sd.ModelBuilder("arm"), np.random.default_rng(9)
    for k, kind in enumerate(["revolute", "prismatic", "revolute", "revolute", "revolute"]):
        m, com, I = random_inertia(rng)
        m, I = (1e4 * m, 1e4 * I) if k == 4 else (m, I)
        rotor = 0.3 * mass * (length**2 if kind == "revolute" else 1.0) if k in (1, 2) else 0.0
        parent, axis, place = f"b{k - 1}" if k else None, rng.normal(size=3), random_placement(rng)
        place[:3, 3] *= length
        body = (mass * m, length * com, mass * length**2 * I)
        builder.add_body(f"b{k}", parent, kind, axis, place, body, armature=rotor)
    return builder.build(gravity=(0.0, 0.0, -9.81 * length / time**2))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("powers", [(-300, -100, 0), (200, 60, 30), (2, -3, 7), (-40, 11, -20)])
def test_units_of_powers_of_two_change_no_bit(powers: tuple[int, int, int], method: str) -> None:
    """Mass 2^a, length 2^b, time 2^c: no tolerance is hidden anywhere."""
    mass, length, time = (2.0**k for k in powers)
    here, there = arm(1.0, 1.0, 1.0), arm(mass, length, time)
    lengths = np.array([1.0, length, 1.0, 1.0, 1.0])
    q, v, tau = state(here, 9)
    a = sd.forward_dynamics(here, q, v, tau, method=method)
    torque = tau * (mass * length**2 / time**2) / lengths
    b = sd.forward_dynamics(there, q * lengths, v * lengths / time, torque, method=method)
    np.testing.assert_array_equal(b * time**2 / lengths, a)


# --- refusals ---------------------------------------------------------------------------------------------


EVERY = [(method, 60) for method in METHODS]


@pytest.mark.parametrize(("method", "samples"), slow_but(EVERY, [*EVERY, ("aba", 600)]))  # whose kernel is compiled
def test_a_joint_of_zero_articulated_inertia_is_named(method: str, samples: int) -> None:
    builder, rng = sd.ModelBuilder("arm"), np.random.default_rng(0)
    builder.add_body("a", None, "revolute", (0, 0, 1), None, random_inertia(rng))
    builder.add_body("b", "a", "revolute", (1, 0, 0), (0.2, 0.1, 0.3), joint_name="idle")
    model = builder.build()
    with pytest.raises(sd.InertiaError, match="idle"):
        sd.forward_dynamics(model, [0.1, 0.2], [1.0, 2.0], [0.0, 1.0], method=method)
    with pytest.raises(sd.InertiaError, match=r"idle.*sample 0"):
        sd.forward_dynamics(model, np.ones((samples, 2)), [1.0, 2.0], [0.0, 1.0], method=method)


def test_two_joints_that_make_one_another_idle_are_found() -> None:
    """Parallel axes through one point: M is singular, though each joint moves a body."""
    builder, rng = sd.ModelBuilder("arm"), np.random.default_rng(0)
    builder.add_body("a", None, "revolute", (0, 0, 1), None, joint_name="first")
    builder.add_body("b", "a", "revolute", (0, 0, 1), None, random_inertia(rng))
    model = builder.build()
    for method in METHODS:
        with pytest.raises(sd.InertiaError, match="first"):
            sd.forward_dynamics(model, [0.1, 0.2], [1.0, 2.0], [0.0, 1.0], method=method)


def test_another_method_is_refused_by_its_name() -> None:
    model = sd.load_urdf("two_link")
    for method in ("lu", None, ["aba"]):
        with pytest.raises(sd.SpatialDynError, match=r"method is .*, expected one of aba, crba, refined, square_root"):
            sd.forward_dynamics(model, [0, 0], [0, 0], [0, 0], method=method)  # type: ignore[arg-type]


def cart_pole(cart: tuple[float, float] = (1.0, 1.0), axis: str = "1 0 0") -> str:
    """URDF of a cart, (mass, principal moment), and a pole on a root without mass: floating, it slides for nothing."""

    def inertial(mass: float, moment: float, z: float) -> str:
        I = f'ixx="{moment}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"'
        return f'<inertial><origin xyz="0 0 {z}"/><mass value="{mass}"/><inertia {I}/></inertial>'

    return f"""<robot name="cart_pole"><link name="rail"/>
        <link name="cart">{inertial(*cart, 0.0)}</link><link name="pole">{inertial(0.1, 1.0, 0.5)}</link>
        <joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="{axis}"/>
          <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
        <joint name="swing" type="continuous"><parent link="cart"/><child link="pole"/><origin xyz="0 0 0.1"/>
          <axis xyz="0 1 0"/></joint></robot>"""


def floating_cart_pole(oblique: bool) -> sd.Model:
    """The same, built, its slider along an axis of frames or oblique to them."""
    builder, rng = sd.ModelBuilder("cart_pole"), np.random.default_rng(0)
    along, place = (rng.normal(size=3), random_placement(rng)) if oblique else (AXES[0], None)
    builder.add_body("rail", None, "floating", joint_name="root_joint")
    builder.add_body("cart", "rail", "prismatic", along, place, random_inertia(rng))
    builder.add_body("pole", "cart", "revolute", (0, 1, 0), (0, 0, 0.1), random_inertia(rng))
    return builder.build()


@pytest.mark.parametrize(
    ("robot", "method"),
    slow_but(
        [("built", "aba"), ("urdf", "square_root"), ("oblique", "square_root")],
        [*((robot, m) for robot in ("built", "urdf") for m in METHODS), ("oblique", "square_root")],
    ),
)
def test_a_root_without_mass_that_a_joint_undoes_is_refused_in_every_state(robot: str, method: str) -> None:
    model = sd.load_urdf(cart_pole(), root="floating") if robot == "urdf" else floating_cart_pole(robot == "oblique")
    rng = np.random.default_rng(0)
    for _ in range(12):
        q, (v, tau) = sd.random_configuration(model, rng), rng.normal(size=(2, model.nv))
        with pytest.raises(sd.InertiaError, match="root_joint"):
            sd.forward_dynamics(model, q, v, tau, method=method)


@pytest.mark.parametrize("robot", ["tree", "massless root"])
@pytest.mark.parametrize("name", slow_but({"rnea", "crba", "aba", *[*SPECS][::3]}, SPECS))
def test_no_answer_depends_on_what_scratch_held_before(name: str, robot: str) -> None:
    """Compiled, scratch is memory as it is found; a joint without rows of inertia once read what was never written."""
    spec, rng = SPECS[name], np.random.default_rng(1)
    model = floating_cart_pole(False) if robot == "massless root" else random_tree(2, 5).model
    if spec.work is None:
        return
    q = sd.random_configuration(model, rng)
    sizes = {"nq": model.nq, "nv": model.nv, "njoints": model.njoints}
    inputs: dict[str, Any] = {}
    for x in spec.present:
        shape = tuple(sizes[k] if isinstance(k, str) else k for k in x.shape)
        if x.static:
            inputs[x.name] = np.eye(4) if shape else model.joints[-1].row if x.name == "row" else 1
        else:
            inputs[x.name] = q if x.unit_norm else rng.normal(size=shape) if shape else 0.3
    found = []
    for junk in (0.0, 3.7):
        work = np.zeros(len(model.bodies), spec.work)
        work.view(np.float64)[:] = junk
        out = np.zeros(tuple(sizes[k] if isinstance(k, str) else k for k in spec.output.shape) or (1,))
        with np.errstate(all="ignore"):
            beside = spec.run(model.bodies, work, inputs, out, partial(np.full, fill_value=junk))
        found.append(np.concatenate([out.ravel(), *(x.ravel() for x in beside[: spec.pivots])]))
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("cart", [(1.0, 1.0), (0.1, 0.01)], ids=["cart", "light cart"])
def test_compare_says_what_is_singular_of_a_root_without_mass(cart: tuple[float, float]) -> None:
    pytest.importorskip("pinocchio")
    compared = sd.compare_with_pinocchio(cart_pole(cart), "floating", samples=4, calls=METHODS.values())
    assert compared.ok, [row for row in compared.rows if not row.ok]
    rows = {row.call: row for row in compared.rows}
    for name in METHODS.values():
        assert "M is singular" in rows[name].note
        assert "root_joint" in rows[name].note


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: no programs")
def test_models_with_mimic_joints_have_a_program_in_double_double() -> None:
    """Through M, which the program of the full tree is not."""
    model, rng = sd.load_urdf("tree", mimic=True), np.random.default_rng(0)
    assert extended_runs_on_lanes(model)
    q, (v, tau) = sd.random_configuration(model, rng, 600), rng.normal(size=(2, 600, model.nv))
    many = sd.forward_dynamics(model, q, v, tau, method="extended")
    truth = sd.exact(model, sd.aba)(q[:3], v[:3], tau[:3]).astype(float)
    assert (abs(many[:3] - truth) <= np.spacing(abs(truth))).all()
    few = sd.forward_dynamics(model, q[:3], v[:3], tau[:3], method="extended")
    np.testing.assert_array_equal(few, truth)
