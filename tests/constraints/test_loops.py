"""Constraints as objects, and loops: their names, checks, assembly, projection, mobility."""

from __future__ import annotations

import doctest
import math
import pickle
from typing import Any

import numpy as np
import pytest
from mechanisms import every_kind, four_bar, four_bar_state, pin_of
from trees import random_tree

import spatialdyn as sd
from spatialdyn.constraints import contact, dynamics, kinds, loops, table

EPS = np.finfo(float).eps


# --- objects --------------------------------------------------------------------------------------------


def test_constraints_are_values() -> None:
    """Equal contents are equal and hash alike, also from another equal model and through a pickle; nothing changes."""
    model, other = four_bar(), four_bar()
    held, same, longer = pin_of(model), pin_of(other), pin_of(model, c=0.41)
    assert held == same == pickle.loads(pickle.dumps(held))
    assert hash(held) == hash(same)
    assert held != longer
    assert len({held, same, longer}) == 2
    assert held.table == same.table != longer.table
    assert (len(held), held.nc, [x.part for x in held.equations]) == (1, 3, ["x", "y", "z"])
    assert repr(held) == "<Constraints of four_bar: 3 equations, pin>"
    with pytest.raises(AttributeError, match="immutable"):
        held.nc = 4
    with pytest.raises(AttributeError, match="immutable"):
        del held.items
    with pytest.raises(AttributeError, match="cannot assign"):
        held.items[0].axes = "x"  # type: ignore[misc]
    point = sd.PointConstraint("a", "b", at_a=np.array([1.0, 0, 0]))
    assert point == sd.PointConstraint("a", "b", at_a=[1, 0, 0])
    assert hash(point) == hash(sd.PointConstraint("a", "b", at_a=[1, 0, 0]))


def test_labels_name_the_frames_or_are_given() -> None:
    assert sd.PointConstraint("LF_FOOT").label == "PointConstraint('LF_FOOT')"
    assert sd.HingeConstraint("a", "b").label == "HingeConstraint('a', 'b')"
    assert sd.CouplerConstraint("j", "k").label == "CouplerConstraint('j', 'k')"
    assert sd.RollingConstraint("wheel", None, 0.1, name="front").label == "front"
    _, held, _ = every_kind(0)
    assert len({x.label for x in held.equations}) > 20
    assert all(x.constraint in held.items for x in held.equations)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: sd.PointConstraint("a", axes="xx"), r"PointConstraint\('a'\) has axes 'xx', expected one to three"),
        (lambda: sd.PointConstraint("a", axes=""), "has axes '', expected one to three"),
        (lambda: sd.PointConstraint(3), "PointConstraint has frame_a 3, expected a name"),
        (lambda: sd.PointConstraint("a", at_a=[1, 2]), r"has at_a shape \(2,\), expected a position \(3,\) or a pose"),
        (lambda: sd.WeldConstraint("a", at_b=2 * np.eye(4)), r"has at_b \[\[2.0, .* expected a position"),
        (lambda: sd.WeldConstraint("a", at_b=[0, 0, math.nan]), "has at_b .*nan.*expected a position"),
        (lambda: sd.HingeConstraint("a", axis=(0, 0, 0)), r"has axis \(0, 0, 0\), expected a nonzero vector"),
        (lambda: sd.DistanceConstraint("a"), "has length nan, expected a finite number above 0"),
        (lambda: sd.DistanceConstraint("a", length=-0.1), "has length -0.1, expected a finite number above 0"),
        (lambda: sd.CouplerConstraint("a", "b", ratio=math.inf), "has ratio inf, expected a finite number"),
        (lambda: sd.RollingConstraint("a", None, 0.0), "has radius 0.0, expected a finite number above 0"),
        (lambda: sd.VelocityConstraint([[0, 0], [0, 1]]), "expected finite rows .* each with an entry that is not 0"),
        (lambda: sd.VelocityConstraint([math.nan]), "expected finite rows"),
    ],
)
def test_numbers_that_no_constraint_has(make: Any, text: str) -> None:
    with pytest.raises(sd.ConstraintError, match=text):
        make()


def test_names_are_checked_by_the_robot() -> None:
    model = four_bar()

    def refused(*items: Any) -> str:
        with pytest.raises(sd.SpatialDynError) as caught:
            sd.Constraints(model, items)
        return f"{type(caught.value).__name__}: {caught.value}"

    assert '"rockr"' in refused(sd.PointConstraint("rockr"))
    assert "did you mean rocker" in refused(sd.PointConstraint("rockr"))
    same = refused(sd.PointConstraint("crank", "crank", at_a=(0.1, 0, 0)))
    assert same == (
        "ConstraintError: PointConstraint('crank', 'crank'): frame \"crank\" does not move from frame \"crank\", "
        "expected two bodies"
    )
    assert "does not move from the world" in refused(sd.PointConstraint("base"))
    assert 'frame "base" does not move' in refused(sd.RollingConstraint("base", None, 0.1))
    assert "couples a joint to itself" in refused(sd.CouplerConstraint("crank_joint", "crank_joint"))
    assert refused(sd.CouplerConstraint("crank", "rocker_joint")).startswith("ModelError")
    assert "has rows of 2, expected 3" in refused(sd.VelocityConstraint([1.0, 2.0]))
    assert "constraints have a str, expected one of PointConstraint" in refused("pin")
    with pytest.raises(sd.ConstraintError, match="constraints are 3, expected a list"):
        sd.Constraints(model, 3)  # type: ignore[arg-type]
    ball = random_tree(1, 4, ("spherical",)).model
    joint = next(j.name for j in ball.joints[1:] if j.nv == 3)
    other = next(j.name for j in ball.joints[1:] if j.name != joint)
    with pytest.raises(
        sd.ConstraintError, match=rf'couples joint "{joint}" \(spherical\), expected a position that is'
    ):
        sd.Constraints(ball, [sd.CouplerConstraint(joint, other)])


def test_constraints_come_from_toml() -> None:
    pytest.importorskip("tomllib")
    model = four_bar()
    text = """
    [[constraint]]
    kind = "hinge"
    frame_a = "coupler"
    frame_b = "rocker"
    at_a = [0.5, 0, 0]
    at_b = [0.4, 0, 0]
    name = "pin"

    [[constraint]]
    kind = "velocity"
    A = [[1, 0, 0]]
    """
    wanted = sd.Constraints(model, [*pin_of(model, kind="hinge"), sd.VelocityConstraint([1, 0, 0])])
    assert sd.Constraints.of_toml(model, text) == wanted
    assert sd.Constraints.of_toml(model, "").nc == 0


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("[[constraint]", "^constraints are no TOML: "),
        ("[constraint]", r"have one \[constraint\], expected entries \[\[constraint\]\] alone"),
        ("[[loop]]", r"have loop, expected entries"),
        ("[[constraint]]\nkind = 'pin'", "constraint 0 of the TOML text has kind 'pin', expected one of point, weld, "),
        ("[[constraint]]\nkind = 'point'\nframe = 'a'", "constraint 0 of the TOML text has frame, expected some of fr"),
        ("[[constraint]]\nkind = 'point'", "constraint 0 of the TOML text lacks frame_a, expected frame_a, frame_b"),
        ("[[constraint]]\nkind = 'point'\nframe_a = 3", "PointConstraint has frame_a 3, expected a name"),
        ("x = " + 1000 * "[" + 1000 * "]", "^constraints are no TOML: "),
        ("x = " + 5000 * "1", "^constraints are no TOML: "),
        (
            f"[[constraint]]\nkind = 'coupler'\njoint = 'a'\nto = 'b'\nratio = {400 * '1'}",
            "has ratio 1.*, expected a fin",
        ),
        (5, "^TOML is a int, expected its text$"),
        (None, "^TOML is a NoneType, expected its text$"),
        (b"", "^TOML is a bytes, expected its text$"),
    ],
)
def test_what_toml_cannot_be(text: Any, wanted: str) -> None:
    pytest.importorskip("tomllib")
    with pytest.raises(sd.ConstraintError, match=wanted):
        sd.Constraints.of_toml(four_bar(), text)


# --- closing --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["point", "hinge"])
def test_a_four_bar_is_assembled_from_far(kind: str) -> None:
    model, (q, _) = four_bar(), four_bar_state()
    held = pin_of(model, kind=kind)
    start = q + np.array([0.0, 0.8, -0.5])
    found = sd.close_loops(model, held, start, free=["coupler_joint", "rocker_joint"])
    assert found[0] == q[0]  # it was not free to move
    assert abs(found - q).max() <= 1e-11
    everything = sd.close_loops(model, held, start)
    assert abs(sd.constraint_error(model, held, everything)).max() <= 1e-12
    assert everything[0] != q[0]


def test_a_loop_that_cannot_close_is_named() -> None:
    """Rods of 0.2, 0.5 and 0.4 m do not reach over 2 m."""
    model = four_bar(d=2.0)
    with pytest.raises(sd.ConstraintError, match=r"^pin x is open by 900 mm, expected .*; another q to start from may"):
        sd.close_loops(model, pin_of(model), [0.1, 0.2, 3.0])
    closed, (q, _) = four_bar(), four_bar_state()
    with pytest.raises(sd.ModelError, match='free has joint "elbow", which robot "four_bar" does not have'):
        sd.close_loops(closed, pin_of(closed), q, free=["elbow"])
    with pytest.raises(sd.ConstraintError, match="tolerance is 0, expected a finite number above 0"):
        sd.close_loops(closed, pin_of(closed), q, tolerance=0)
    with pytest.raises(sd.ShapeError, match=r"q has shape \(1, 3\), expected \(3,\)"):
        sd.close_loops(closed, pin_of(closed), q[None])
    with pytest.raises(sd.NonFiniteError, match=r"q is \[0.0, nan, 0.0\], expected finite numbers"):
        sd.close_loops(closed, pin_of(closed), [0.0, np.nan, 0.0])


def test_a_weld_half_a_turn_off_is_not_closed() -> None:
    """The sine of half a turn is 0, but the axes do not agree."""
    made = sd.ModelBuilder("gate")
    made.add_body("leaf", None, "revolute", (0, 0, 1), (0, 0, 0), (1.0, (0, 0, 0), np.eye(3)))
    model = made.build()
    held = sd.Constraints(model, [sd.WeldConstraint("leaf", name="latch")])
    assert sd.close_loops(model, held, [0.3]) == pytest.approx([0.0], abs=1e-12)
    with pytest.raises(sd.ConstraintError, match=r"^latch is closed half a turn off, expected axes that agree"):
        sd.project_configuration(model, held, [math.pi])
    hinge = sd.Constraints(model, [sd.HingeConstraint("leaf", axis=(1, 0, 0), name="pin")])
    with pytest.raises(sd.ConstraintError, match=r"^pin is closed half a turn off in sample 1"):
        sd.project_configuration(model, hinge, [[0.0], [math.pi]])


@pytest.mark.parametrize("seed", range(3))
def test_projections_are_the_shortest_in_kinetic_energy(seed: int) -> None:
    """q moves along M⁻¹ Jᵀ to first order, v exactly; a second projection changes nothing."""
    model, (q, v) = four_bar(), four_bar_state()
    held, rng = pin_of(model, axes="xy"), np.random.default_rng(seed)
    off, wild = q + 1e-4 * rng.normal(size=3), v + rng.normal(size=3)
    closed = sd.project_configuration(model, held, off)
    assert abs(sd.constraint_error(model, held, closed)).max() <= 1e-12
    J, M = sd.constraint_jacobian(model, held, closed), sd.crba(model, closed)
    free = np.linalg.svd(J)[2][2:]
    assert abs(free @ M @ (closed - off)).max() <= 1e-3 * abs(M @ (closed - off)).max()
    kept = sd.project_velocity(model, held, closed, wild)
    assert abs(J @ kept).max() <= 1e2 * EPS * abs(J).max() * abs(wild).max()
    assert abs(free @ M @ (kept - wild)).max() <= 1e3 * EPS * abs(M).max() * abs(wild).max()
    assert abs(sd.project_velocity(model, held, closed, kept) - kept).max() <= 1e2 * EPS * abs(kept).max()
    endless = np.where(np.arange(model.nv) == 0, np.inf, wild)
    assert np.isnan(sd.project_velocity(model, held, closed, endless)[0])  # none is nearest, and NumPy warns of nothing


def test_projection_of_a_batch_with_quaternions() -> None:
    model, held, s = every_kind(2)
    one = sd.Constraints(model, held.items[:1])
    q = sd.close_loops(model, one, s.q)
    several = sd.integrate(model, q, 1e-3 * np.random.default_rng(0).normal(size=(9, model.nv)))
    closed = sd.project_configuration(model, one, several)
    assert closed.shape == (9, model.nq)
    assert abs(sd.constraint_error(model, one, closed)).max() <= 1e-12
    assert abs(sd.normalize(model, closed) - closed).max() <= 1e-12


def test_projection_says_what_stays_open() -> None:
    model = four_bar(d=2.0)
    held = pin_of(model, b=1.5)
    near = sd.close_loops(model, held, [0.1, 0.2, 3.0])
    stretched = np.array([math.pi, 0.0, 0.0])  # all rods on one line, away from each other: no step closes it
    text = r"^pin x is open by .* mm in sample 1, expected at most 1e-12; close_loops assembles from farther away$"
    with pytest.raises(sd.ConstraintError, match=text):
        sd.project_configuration(model, held, [near, stretched])


# --- mobility -------------------------------------------------------------------------------------------


def test_mobility_beside_grueblers_count() -> None:
    """A spatial hinge in a planar loop: Grübler counts -2 free velocities, there is one."""
    model, (q, _) = four_bar(), four_bar_state()
    assert sd.mobility(model, pin_of(model), q) == (1, 2, 0)
    assert sd.mobility(model, pin_of(model, kind="hinge"), q) == (1, 2, -2)
    assert sd.mobility(model, sd.Constraints(model, []), q) == (3, 0, 3)


def test_independent_joints_determine_the_others() -> None:
    model, (q, v) = four_bar(), four_bar_state()
    held = pin_of(model)
    (k,) = sd.independent_joints(model, held, q)
    J = sd.constraint_jacobian(model, held, q)
    rest = [i for i in range(3) if i != k]
    found = np.linalg.lstsq(J[:, rest], -J[:, k] * v[k], rcond=None)[0]
    assert found == pytest.approx(v[rest])
    model, held, s = every_kind(0)
    one = sd.Constraints(model, held.items[:1])
    independent = sd.independent_joints(model, one, s.q)
    assert len(independent) == sd.mobility(model, one, s.q).free == model.nv - 3
    rest = sorted({*range(model.nv)} - {*independent})
    assert np.linalg.matrix_rank(sd.constraint_jacobian(model, one, s.q)[:, rest]) == 3


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_joints_that_depend_on_each_other_are_not_both_left_out(sign: float) -> None:
    """Of equal joints: two whose columns are parallel, of which one alone can be solved for, and a third one."""
    builder = sd.ModelBuilder("four")
    for k in range(4):
        builder.add_body(f"b{k}", inertia=(1.0, (0.3, 0, 0), np.eye(3)))
    model = builder.build()
    A = np.array([[10.0 * sign, 9.9 * sign, 0.0, 0.0], [5.0, 4.95, 1.0, 0.0]])
    assert sd.independent_joints(model, sd.Constraints(model, [sd.VelocityConstraint(A)]), np.zeros(4)) == (1, 3)


@pytest.mark.parametrize("module", [contact, dynamics, kinds, loops, table])
def test_the_examples_of_the_docstrings_hold(module: Any) -> None:
    if module is table:
        pytest.importorskip("tomllib")
    assert doctest.testmod(module).failed == 0


def test_what_fits_no_batch_is_refused_by_name() -> None:
    model = sd.load_urdf("two_link")
    held = sd.Constraints(model, [sd.PointConstraint("tip", axes="x")])
    q, v = np.zeros((3, 2)), np.zeros((2, 2))
    for call in (sd.project_velocity, sd.impact):
        with pytest.raises(sd.ShapeError, match=r"^batch shapes do not broadcast: q \(3,\), v \(2,\)$"):
            call(model, held, q, v)
        with pytest.raises(sd.ShapeError, match=r"^v has shape \(3,\), expected \(\.\.\., 2\)$"):
            call(model, held, q, np.zeros(3))


@pytest.mark.parametrize("first", [True, False])
def test_an_input_that_is_none_is_refused_and_not_read(first: bool) -> None:
    """A program recorded without it read whatever lay there."""
    model = sd.load_urdf("two_link")
    held = sd.Constraints(model, [sd.PointConstraint("tip", axes="x")])
    q, v, tau = [0.5, -0.3], [1.0, 2.0], [0.1, 0.2]
    calls = {
        sd.constraint_jacobian: (q,), sd.constraint_error: (q,), sd.constraint_drift: (q, v), sd.delassus: (q,),
        sd.constrained_dynamics: (q, v, tau), sd.constrained_dynamics_derivatives: (q, v, tau), sd.impact: (q, v),
    }  # fmt: skip
    for call, good in calls.items():
        if not first:
            call(model, held, *good)
        for k in range(len(good)):
            given = [None if i == k else x for i, x in enumerate(good)]
            name = ("q", "v", "tau")[k]
            with pytest.raises(sd.ShapeError, match=f"^{name} has dtype object, expected real numbers$"):
                call(model, held, *given)
