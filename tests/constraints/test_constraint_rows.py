"""J, φ and J̇ v of every kind of constraint: by differences, by frames' own Jacobians, on every engine."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mechanisms import every_kind, four_bar, pin_of
from slow import slow_but
from trees import random_state, random_tree

import spatialdyn as sd
from spatialdyn.bodies.constraint_table import CONSTRAINTS
from spatialdyn.bodies.static_table import StaticTable
from spatialdyn.calls.dynamics import checked_call
from spatialdyn.constraints.kinds import across
from spatialdyn.engines import run
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.recursions.constraints import constrained, constraint_rows
from spatialdyn.recursions.constraints.constrained_friction import HELD_BRISTLES
from spatialdyn.recursions.constraints.constraint_derivatives import DERIVATIVES
from spatialdyn.recursions.spec import Spec

EPS = np.finfo(float).eps
STEP = 1e-5  # of central differences, whose error is STEP² and EPS / STEP
CLOSE = 1e-8  # of differences, relative to the largest number
SAME = 1e3 * EPS  # of two engines: sums of some dozen terms in another order


def moved(model: sd.Model, s: Any, t: float) -> Any:
    """q a time t along the motion of constant joint velocities."""
    return sd.integrate(model, s.q, t * s.v)


def pose_of(at: Any) -> np.ndarray:
    X = np.eye(4)
    if at is not None:
        X[:3, 3] = np.array(at)[:3, 3]
        X[:3, :3] = np.array(at)[:3, :3]
    return X


def error_of(model: sd.Model, q: np.ndarray, x: Any) -> list[float]:
    """φ of a constraint of positions, from the poses of its frames."""
    if isinstance(x, sd.CouplerConstraint):
        at = [q[model.joint(name).idx_q] for name in (x.joint, x.to)]
        return [at[0] - x.ratio * at[1] - x.offset]
    A = sd.frame_placement(model, q, x.frame_a) @ pose_of(x.at_a)
    B = (np.eye(4) if x.frame_b is None else sd.frame_placement(model, q, x.frame_b)) @ pose_of(x.at_b)
    X = np.linalg.inv(B) @ A
    R, p = X[:3, :3], X[:3, 3]
    if isinstance(x, sd.DistanceConstraint):
        return [(p @ p - x.length**2) / (2.0 * x.length)]
    if isinstance(x, sd.PointConstraint):
        return [p["xyz".index(letter)] for letter in x.axes]
    if isinstance(x, sd.WeldConstraint):
        return [*p, *(0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]))]
    u = np.array(x.axis)
    return [*p, *(axis @ R @ u for axis in across(u))]


@pytest.mark.parametrize("seed", range(4))
def test_errors_are_those_of_the_frames_poses(seed: int) -> None:
    model, held, s = every_kind(seed, floating=seed % 2 == 0)
    found, at = sd.constraint_error(model, held, s.q), 0
    for x in held:
        count = sum(e.constraint is x for e in held.equations)
        if not isinstance(x, (sd.VelocityConstraint, sd.RollingConstraint)):
            np.testing.assert_allclose(found[at : at + count], error_of(model, s.q, x), rtol=1e-11, atol=1e-12)
        at += count
    assert at == held.nc


@pytest.mark.parametrize("seed", range(4))
def test_errors_change_by_the_jacobian(seed: int) -> None:
    model, held, s = every_kind(seed, floating=seed % 2 == 0)
    J = sd.constraint_jacobian(model, held, s.q)
    ahead, behind = (sd.constraint_error(model, held, moved(model, s, t)) for t in (STEP, -STEP))
    found = (ahead - behind) / (2 * STEP)
    positions = np.array(
        [not isinstance(x.constraint, (sd.VelocityConstraint, sd.RollingConstraint)) for x in held.equations]
    )
    assert abs(found - J @ s.v)[positions].max() <= CLOSE * abs(J @ s.v).max()
    assert (ahead[~positions] == 0.0).all()
    assert positions.sum() == held.nc - 8


@pytest.mark.parametrize("seed", range(4))
def test_the_drift_is_the_rate_of_jv(seed: int) -> None:
    """Along q ∘ exp(t v) joint velocities are constant: d/dt J v is J̇ v."""
    model, held, s = every_kind(seed, floating=seed % 2 == 0)
    drift = sd.constraint_drift(model, held, s.q, s.v)
    ahead, behind = (sd.constraint_jacobian(model, held, moved(model, s, t)) @ s.v for t in (STEP, -STEP))
    assert abs((ahead - behind) / (2 * STEP) - drift).max() <= CLOSE * abs(drift).max()


def test_a_foot_on_the_ground_has_the_rows_of_its_frame() -> None:
    made = random_tree(4, 7, ("revolute", "spherical"), floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(4))
    foot, at = model.frames[-1].name, "local_world_aligned"
    held = sd.Constraints(model, [sd.PointConstraint(foot)])
    J, drift = sd.constraint_jacobian(model, held, s.q), sd.constraint_drift(model, held, s.q, s.v)
    wanted = sd.frame_jacobian(model, s.q, foot, at)[:3]
    assert abs(J - wanted).max() <= SAME * abs(wanted).max()
    of_frame = sd.jacobian_dot_times_v(model, s.q, s.v, foot, at)[:3]
    assert abs(drift - of_frame).max() <= SAME * abs(of_frame).max()
    place = sd.frame_placement(model, s.q, foot)[:3, 3]
    assert abs(sd.constraint_error(model, held, s.q) - place).max() <= SAME * abs(place).max()


def test_what_carries_both_frames_drops_out_exactly_far_from_the_origin() -> None:
    """A loop on a robot a megametre away: no column of the base, and no digit of the others is lost."""
    made = sd.ModelBuilder("far")
    made.add_body("trunk", None, "floating", inertia=(1.0, (0, 0, 0), np.eye(3)))
    for name, y in (("left", 0.1), ("right", -0.1)):
        made.add_body(name, "trunk", "revolute", (0, 0, 1), (0, y, 0), (1.0, (0.1, 0, 0), 0.01 * np.eye(3)))
    model = made.build()
    held = sd.Constraints(model, [sd.PointConstraint("left", "right", at_a=(0.2, 0, 0), at_b=(0.3, 0, 0))])
    near, far = np.array([0, 0, 0, 0, 0, 0, 1.0, 0.3, 0.4]), np.array([1e6, -1e6, 0, 0, 0, 0, 1.0, 0.3, 0.4])
    for call in (sd.constraint_jacobian, sd.constraint_error):
        assert call(model, held, near).tolist() == call(model, held, far).tolist()
    assert (sd.constraint_jacobian(model, held, far)[:, :6] == 0.0).all()


# --- engines --------------------------------------------------------------------------------------------


def answers(
    spec: Spec, model: sd.Model, held: sd.Constraints, values: tuple[Any, ...], compiled: bool
) -> dict[str, Any]:
    """One sample by every engine: plain Python, the program alone and in a batch, and if ``compiled`` the table kernel,
    which takes seconds to compile.
    """
    static = (held.table,)
    names = [x.name for x in spec.present if not x.static]
    given = dict(zip(names, values, strict=True)) | {"constraints": held.table.rows}
    one = checked_call(spec, model, values, static, None)
    out = np.empty(one.shape)
    spec.run(model.bodies, np.zeros(model.nv + 1, spec.work), given, out)
    batch = checked_call(
        spec, model, tuple(x if x is None or not np.ndim(x) else np.tile(x, (9, 1)) for x in values), static, None
    )
    present = frozenset(name for name, x in zip(names, values, strict=True) if x is not None)
    assert numba_kernels.PLAIN or run.program(numba_kernels.variant(spec, present), model, static) is not None
    table = {"table kernel": checked_call(spec, model, values, static, None, by_table=True)} if compiled else {}
    return {"Python": out, "program": one, "program, batch": batch[4], **table}


SPECS = {
    spec.name: spec
    for spec in (
        constraint_rows.JACOBIAN, constraint_rows.ERROR, constraint_rows.DRIFT, constrained.DELASSUS,
        constrained.MOTION, constrained.RESPONSE, constrained.ROWS, DERIVATIVES, HELD_BRISTLES,
    )
}  # fmt: skip


EVERY = [("constrained_motion", False), *((name, True) for name in SPECS)]


@pytest.mark.parametrize(("name", "compiled"), slow_but([EVERY[0], ("constraint_drift", True)], EVERY))
def test_all_engines_agree(name: str, compiled: bool) -> None:
    model, held, s = every_kind(3)
    spec, rng = SPECS[name], np.random.default_rng(0)
    held = sd.Constraints(model, held.items if name.startswith("constraint_") else [held.items[k] for k in (0, 5, 7)])
    values = {"q": s.q, "v": s.v, "tau": s.tau, "rhs": rng.normal(size=held.nc), "rate": None, "fext": None}
    values |= {"chosen": None, "rank": None}
    values |= {"a": rng.normal(size=model.nv), "force": rng.normal(size=held.nc), "dt": 1e-3}
    law = ("bristles", "coulomb", "viscous", "static", "stribeck", "stiffness", "damping")
    values |= dict(zip(law, rng.uniform(0.5, 1.0, size=(len(law), model.nv)), strict=True))
    found = answers(spec, model, held, tuple(values[x.name] for x in spec.present if not x.static), compiled)
    for engine, x in found.items():
        assert abs(x - found["Python"]).max() <= 1e3 * SAME * abs(found["Python"]).max(), engine
    assert found["program"].tolist() == found["program, batch"].tolist()


def test_a_program_keeps_frames_where_they_are() -> None:
    """Programs move origins of bodies along their axes, here of all three, where no frame is seen from a body."""
    made, parent = sd.ModelBuilder("arm"), None
    for k, (axis, at) in enumerate((((0, 0, 1), (0, 0, 0.3)), ((0, 1, 0), (0.2, 0.1, 0)), ((0, 1, 0), (0, -0.2, 0.4)))):
        made.add_body(f"b{k}", parent, "revolute", axis, at, (1.0, (0.1, 0.2, 0.3), 0.1 * np.eye(3)))
        parent = f"b{k}"
    model, rng = made.build(), np.random.default_rng(0)
    q, v, tau = rng.normal(size=(3, 3))
    held = sd.Constraints(model, [sd.PointConstraint("b2", axes="xz", at_a=(0.1, 0.2, 0.3))])
    found = sd.constrained_dynamics(model, held, q, v, tau).a
    J, drift = sd.constraint_jacobian(model, held, q), sd.constraint_drift(model, held, q, v)
    M, free = sd.crba(model, q), sd.aba(model, q, v, tau)
    wanted = free - np.linalg.solve(M, J.T @ np.linalg.solve(J @ np.linalg.solve(M, J.T), J @ free + drift))
    assert abs(found - wanted).max() <= 1e3 * SAME * abs(wanted).max()


def test_one_program_is_not_taken_for_another() -> None:
    """Tables of one shape and other numbers: what a table holds is in every cache's key."""
    model = four_bar()
    q = np.array([[0.3, 0.4, 0.5]] * 9)
    seen = []
    for length in (0.4, 0.3, 0.4):
        held = pin_of(model, c=length)
        for x in (q, q[0]):
            seen.append(np.atleast_2d(sd.constraint_error(model, held, x))[0].tolist())
    assert seen[0] == seen[1] == seen[4] == seen[5]
    assert seen[2] == seen[3] != seen[0]
    first, second = (pin_of(model, c=c).table for c in (0.4, 0.3))
    specs = (constraint_rows.ERROR,)
    keys = {
        batch_kernels._digest(specs, model.key, (x,), np.float64, batch_kernels.ALL, False, False)
        for x in (first, second)
    }
    assert len(keys) == 2


def test_a_static_table_is_a_copy_hashed_by_its_content() -> None:
    rows = np.zeros(2, CONSTRAINTS)
    rows[0]["last_row"], rows[0]["nc"] = 1, 3
    a, b = StaticTable(rows, ("nc",)), StaticTable(rows, ("nc",))
    rows[1]["value"] = 1.0
    c = StaticTable(rows, ("nc",))
    assert a == b != c
    assert hash(a) == hash(b)
    assert a.sizes == {"nc": 3}
    assert repr(a) != repr(c)
    with pytest.raises(ValueError, match="read-only"):
        a.rows[1]["value"] = 2.0
