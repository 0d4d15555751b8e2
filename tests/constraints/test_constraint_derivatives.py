"""Derivatives of constraints and of dynamics under them: by differences, by symmetry, by Pinocchio."""

from __future__ import annotations

import doctest
import warnings
from typing import Any

import numpy as np
import pytest
from mechanisms import every_kind, four_bar, four_bar_state, pin_of
from slow import slow_but

import spatialdyn as sd
from spatialdyn.constraints import derivatives
from spatialdyn.recursions.constraints import constraint_derivatives
from spatialdyn.urdf.load import find_robot

EPS = np.finfo(float).eps
STEP = 1e-5  # of central differences, whose error is STEP² and EPS / STEP
CLOSE = 1e-8  # of differences, relative to the largest number
NAMES = ("da_dq", "da_dv", "da_dtau", "dforce_dq", "dforce_dv", "dforce_dtau")
FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
Array = np.ndarray


def rows_of(model: sd.Model, held: sd.Constraints, s: Any, a: Array, force: Array, rate: float | None) -> Array:
    """The recursion as the Python it is."""
    out = np.empty((2 * held.nc + model.nv, model.nv))
    work = np.zeros(model.nv + 1, constraint_derivatives.WORK)
    given = s.q, s.v, a, force, held.table.rows, rate
    constraint_derivatives.constraint_derivatives(model.bodies, work, *given, out)
    return out


def along(model: sd.Model, f: Any, q: Array, v: Array) -> tuple[Array, Array]:
    """∂f/∂q along integrate(q, e_k) and ∂f/∂v, by central differences."""
    units = STEP * np.eye(model.nv)
    by_q = [f(sd.integrate(model, q, e), v) - f(sd.integrate(model, q, -e), v) for e in units]
    by_v = [f(q, v + e) - f(q, v - e) for e in units]
    return np.stack(by_q, axis=-1) / (2 * STEP), np.stack(by_v, axis=-1) / (2 * STEP)


@pytest.mark.parametrize(("seed", "rate"), slow_but([(0, 3.0)], [(0, 3.0), (1, None), (2, None), (3, 3.0)]))
def test_rows_of_every_kind_change_as_they_say(seed: int, rate: float | None) -> None:
    """∂(J a + J̇ v + 2 J v rate + φ rate²) and ∂(Jᵀ force), with joints of several freedoms."""
    model, held, s = every_kind(seed, floating=seed % 2 == 0)
    rng = np.random.default_rng(seed)
    a, force, r = rng.normal(size=model.nv), rng.normal(size=held.nc), rate or 0.0

    def f(q: Array, v: Array) -> Array:
        J, drift = sd.constraint_jacobian(model, held, q), sd.constraint_drift(model, held, q, v)
        phi = sd.constraint_error(model, held, q)
        return np.concatenate([J @ a + drift + 2 * r * J @ v + r * r * phi, J.T @ force])

    found, (by_q, by_v) = rows_of(model, held, s, a, force, rate), along(model, f, s.q, s.v)
    nc = held.nc
    assert abs(found[:nc] - by_q[:nc]).max() <= CLOSE * abs(by_q[:nc]).max()
    assert abs(found[nc : 2 * nc] - by_v[:nc]).max() <= CLOSE * abs(by_v[:nc]).max()
    assert abs(found[2 * nc :] - by_q[nc:]).max() <= CLOSE * abs(by_q[nc:]).max()


def test_forces_of_positions_have_a_potential() -> None:
    """∂(Jᵀ λ)/∂q is the second derivative of λ·φ: symmetric where joints have one freedom and equations a φ."""
    model, (q, v) = four_bar(), four_bar_state()
    rod = sd.DistanceConstraint("crank", "rocker", 0.3, at_a=(0, 0.1, 0.2))
    weld = sd.WeldConstraint("coupler", "rocker", at_a=(0.1, 0.2, 0.3))
    held = sd.Constraints(model, [*pin_of(model, kind="hinge"), rod, weld])

    class State:
        pass

    s: Any = State()
    s.q, s.v = q, v
    force = np.random.default_rng(0).normal(size=held.nc)
    P = rows_of(model, held, s, v, force, None)[2 * held.nc :]
    assert abs(P).max() > 0.1
    assert abs(P - P.T).max() <= 100 * EPS * abs(P).max()


def consistent() -> tuple[sd.Model, sd.Constraints, Any]:
    """A floating tree under constraints that do not contradict each other."""
    model, held, s = every_kind(0)
    return model, sd.Constraints(model, [held.items[k] for k in (0, 5, 6, 7)]), s


@pytest.mark.parametrize("stabilization", slow_but([0.2], [None, 0.2]))
def test_derivatives_are_those_of_the_dynamics(stabilization: float | None) -> None:
    model, held, s = consistent()
    fext = np.random.default_rng(1).normal(size=(model.njoints, 6))
    found = sd.constrained_dynamics_derivatives(model, held, s.q, s.v, s.tau, stabilization, fext)

    def f(q: Array, v: Array) -> Array:
        made = sd.constrained_dynamics(model, held, q, v, s.tau, stabilization, fext=fext)
        return np.concatenate([made.a, made.force])

    by_q, by_v = along(model, f, s.q, s.v)
    n = model.nv
    for x, wanted in zip(
        (found.da_dq, found.dforce_dq, found.da_dv, found.dforce_dv),
        (by_q[:n], by_q[n:], by_v[:n], by_v[n:]),
        strict=True,
    ):
        assert abs(x - wanted).max() <= 10 * CLOSE * abs(wanted).max()
    J, M = sd.constraint_jacobian(model, held, s.q), sd.crba(model, s.q)
    assert abs(M @ found.da_dtau - J.T @ found.dforce_dtau - np.eye(n)).max() <= 1e4 * EPS
    assert abs(J @ found.da_dtau).max() <= 1e4 * EPS * abs(J).max() * abs(found.da_dtau).max()


def test_equations_that_depend_on_others_change_nothing() -> None:
    """A planar loop held in space: its hinge has 3 equations too many, whose forces and derivatives are 0."""
    model, (q, v) = four_bar(), four_bar_state()
    one, both = pin_of(model, axes="xy"), pin_of(model, kind="hinge")
    least = sd.constrained_dynamics_derivatives(model, one, q, v, [0.1, 0.2, 0.3])
    found = sd.constrained_dynamics_derivatives(model, both, q, v, [0.1, 0.2, 0.3])
    for name in NAMES:
        x, wanted = getattr(found, name), getattr(least, name)
        assert abs(x[: len(wanted)] - wanted).max() <= 1e5 * EPS * abs(wanted).max(), name
        assert (x[len(wanted) :] == 0.0).all(), name
    several = sd.constrained_dynamics_derivatives(model, both, np.tile(q, (2, 9, 1)), v, [0.1, 0.2, 0.3])
    for name in NAMES:
        assert getattr(several, name).shape == (2, 9, *getattr(found, name).shape)
        assert abs(getattr(several, name)[1, 4] - getattr(found, name)).max() <= 1e4 * EPS * 1e3


def test_feet_on_the_ground_have_pinocchios_derivatives() -> None:
    """In the world's axes a held point is the same constraint for both, moving or not."""
    pin = pytest.importorskip("pinocchio")
    path = str(find_robot("solo12"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = sd.load_urdf(path, root="floating")
    theirs = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())
    held = sd.Constraints(model, [sd.PointConstraint(foot) for foot in FEET])
    models, datas, data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData(), theirs.createData()
    for foot in FEET:
        frame = next(f for f in theirs.frames if f.name == foot and f.type == pin.FrameType.BODY)
        kind, at = pin.ContactType.CONTACT_3D, pin.LOCAL_WORLD_ALIGNED
        models.append(pin.RigidConstraintModel(kind, theirs, frame.parentJoint, frame.placement, at))
        datas.append(models[-1].createData())
    pin.initConstraintDynamics(theirs, data, models, datas)
    rng, settings = np.random.default_rng(0), pin.ProximalSettings(1e-14, 1e-12, 10)
    q = sd.random_configuration(model, rng)
    v, tau = rng.normal(size=(2, model.nv))
    pin.constraintDynamics(theirs, data, q, v, tau, models, datas, settings)
    wanted = pin.computeConstraintDynamicsDerivatives(theirs, data, models, datas, settings)
    found = sd.constrained_dynamics_derivatives(model, held, q, v, tau)
    J = sd.constraint_jacobian(model, held, q)
    cond = np.linalg.cond(np.block([[sd.crba(model, q), J.T], [J, np.zeros((12, 12))]]))
    for name, y in zip(NAMES, wanted, strict=True):
        assert abs(getattr(found, name) - y).max() <= (1e-12 + 1e4 * EPS * cond) * abs(y).max(), name


def test_what_derivatives_refuse() -> None:
    model, (q, v) = four_bar(), four_bar_state()
    held = pin_of(model)
    with pytest.raises(sd.ConstraintError, match="expected a time in seconds above 0"):
        sd.constrained_dynamics_derivatives(model, held, q, v, np.zeros(3), -1.0)
    with pytest.raises(sd.ModelError, match="constraints are of another model"):
        sd.constrained_dynamics_derivatives(four_bar(0.3), held, q, v, np.zeros(3))
    with pytest.raises(sd.ShapeError, match=r"tau has shape \(2,\)"):
        sd.constrained_dynamics_derivatives(model, held, q, v, np.zeros(2))


def test_the_examples_of_the_docstring_hold() -> None:
    assert doctest.testmod(derivatives).failed == 0
