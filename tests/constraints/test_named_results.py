"""Each field of the named results of constraints and contact, by its law."""

from __future__ import annotations

import numpy as np
import pytest
from grounded import DT, G, mass
from mechanisms import four_bar, four_bar_state, pin_of

import spatialdyn as sd

CLOSE = 1e-11


def test_constrained_motion_has_accelerations_forces_residual_and_rank() -> None:
    model, held, (q, v) = four_bar(), pin_of(four_bar()), four_bar_state()
    made = sd.constrained_dynamics(model, held, q, v, [0.1, 0.0, 0.0])
    assert isinstance(made, sd.ConstrainedMotion)
    assert made._fields == ("a", "force", "residual", "rank")
    J, gamma = sd.constraint_jacobian(model, held, q), sd.constraint_drift(model, held, q, v)
    assert abs(J @ made.a + gamma).max() <= CLOSE
    assert abs(sd.rnea(model, q, v, made.a) - [0.1, 0.0, 0.0] - J.T @ made.force).max() <= CLOSE
    assert (made.residual, made.rank) == (pytest.approx(0.0, abs=1e-12), 2)


def test_impacts_have_velocities_and_impulses() -> None:
    model, held, (q, _) = four_bar(), pin_of(four_bar()), four_bar_state()
    v, M, J = np.array([1.0, 0.5, -0.3]), sd.crba(model, q), sd.constraint_jacobian(model, held, q)
    tabled = sd.impact(model, held, q, v)
    assert isinstance(tabled, sd.ConstrainedImpact)
    assert tabled._fields == ("v", "impulse", "residual", "rank")
    given = sd.impact(model, q, v, J[:2])
    assert isinstance(given, sd.Impact)
    assert given._fields == ("v", "impulse")
    for made, rows in ((tabled, J), (given, J[:2])):
        assert abs(rows @ made.v).max() <= CLOSE
        assert abs(M @ (made.v - v) - rows.T @ made.impulse).max() <= CLOSE
    assert (tabled.residual, tabled.rank) == (pytest.approx(0.0, abs=1e-12), 2)


def test_constrained_derivatives_have_one_array_of_each_pair() -> None:
    model, held, (q, v) = four_bar(), pin_of(four_bar()), four_bar_state()
    tau, h = np.array([0.1, 0.0, 0.2]), 1e-6
    made = sd.constrained_dynamics_derivatives(model, held, q, v, tau)
    assert isinstance(made, sd.ConstrainedDerivatives)
    assert made._fields == tuple(f"d{x}_d{y}" for x in ("a", "force") for y in ("q", "v", "tau"))
    e = np.array([0.3, -0.2, 0.5])
    ahead, back = (sd.constrained_dynamics(model, held, q, v, tau + s * h * e) for s in (1, -1))
    np.testing.assert_allclose(made.da_dtau @ e, (ahead.a - back.a) / (2 * h), rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(made.dforce_dtau @ e, (ahead.force - back.force) / (2 * h), rtol=0.0, atol=1e-6)
    ahead, back = (sd.constrained_dynamics(model, held, q, v + s * h * e, tau) for s in (1, -1))
    np.testing.assert_allclose(made.da_dv @ e, (ahead.a - back.a) / (2 * h), rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(made.dforce_dv @ e, (ahead.force - back.force) / (2 * h), rtol=0.0, atol=1e-5)
    ahead, back = (sd.constrained_dynamics(model, held, q + s * h * e, v, tau) for s in (1, -1))
    np.testing.assert_allclose(made.da_dq @ e, (ahead.a - back.a) / (2 * h), rtol=0.0, atol=1e-3)
    np.testing.assert_allclose(made.dforce_dq @ e, (ahead.force - back.force) / (2 * h), rtol=0.0, atol=1e-3)


def test_mobility_counts_what_is_free_what_is_independent_and_gruebler() -> None:
    model, held, (q, _) = four_bar(), pin_of(four_bar()), four_bar_state()
    made = sd.mobility(model, held, q)
    assert isinstance(made, sd.Mobility)
    assert made._asdict() == {"free": 1, "rank": 2, "gruebler": 0}


def test_a_contact_record_has_impulses_gaps_residuals_and_stops() -> None:
    model = mass()
    contacts = sd.Contacts(model, {"z": 0.0}, friction=0.3)
    run = sd.rollout(
        sd.Scene(model, contacts=contacts), np.zeros(3), [1.0, 0.0, 0.0], dt=DT, steps=3, record="contacts"
    )
    made = run.contacts
    assert isinstance(made, sd.ContactRecord)
    assert {name: x.shape for name, x in made._asdict().items()} == {
        "impulse": (3, 1, 3), "gap": (3, 1), "residual": (3,), "stop": (3, 3),
    }  # fmt: skip
    np.testing.assert_allclose(made.impulse[:, 0], np.tile([-0.3 * G * DT, 0.0, G * DT], (3, 1)), atol=1e-15)
    assert abs(made.gap).max() <= 1e-15
    assert made.residual.max() <= 1e-12
    assert (made.stop == 0.0).all()
