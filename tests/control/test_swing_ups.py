"""Swing-ups by energy as control laws, recorded with their steps: the times of the notes' own integrations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.algebra.scalars import cos, sin
from spatialdyn.examples.acrobot_by_energy import KD, KP, KV, G, acrobot
from spatialdyn.examples.cart_pole_lqr import cart_pole
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec, V

GAINS = Argument("gains", (4,), "", "gains and gravity")


def pump_pendulum(bodies: Any, q: Any, v: Any, gains: Any, tau: Any) -> None:
    """τ = -k q̇ (E - E*), of a mass of 1 kg on a rod of 1 m."""
    tau[0] = -gains[0] * v[0] * (0.5 * v[0] * v[0] - gains[3] * cos(q[0]) - gains[3])


def pump_cart(bodies: Any, q: Any, v: Any, gains: Any, tau: Any) -> None:
    """The force for ẍ = u, u = k (θ̇ cos θ Ẽ - x - ẋ), θ from hanging; q[1] is from upright."""
    c, s, g = cos(q[1]), sin(q[1]), gains[3]
    u = gains[0] * (v[1] * c * (0.5 * v[1] * v[1] + g * c - g) - q[0] - v[0])
    tau[0] = 2.0 * u + (g * s - u * c) * c - v[1] * v[1] * s
    tau[1] = 0.0 * u


def pump_acrobot(bodies: Any, q: Any, v: Any, gains: Any, tau: Any) -> None:
    """Its M, h, det M and energy written out: rods of 1 and 2 m, 1 kg each."""
    kD, kP, kV, g = gains[0], gains[1], gains[2], gains[3]
    c, s, up, down = cos(q[1]), sin(q[1]), sin(q[0] + q[1]), cos(q[0] + q[1])
    M00, M01, M11 = 2.663 + 2.0 * c, 1.33 + c, 1.33
    h0 = -s * v[1] * (2.0 * v[0] + v[1]) + g * (1.5 * sin(q[0]) + up)
    h1 = s * v[0] * v[0] + g * up
    kinetic = 0.5 * (M00 * v[0] * v[0] + 2.0 * M01 * v[0] * v[1] + M11 * v[1] * v[1])
    lack, D = kinetic - g * (1.5 * cos(q[0]) + down) - 2.5 * g, M00 * M11 - M01 * M01
    tau[0] = 0.0 * lack
    tau[1] = -((kV * v[1] + kP * q[1]) * D + kD * (M01 * h0 - M00 * h1)) / (kD * M00 + lack * D)


def law(recursion: Any, *gains: float) -> sd.Control:
    return sd.Control(Spec(recursion.__name__, recursion, None, (Q, V, GAINS), TAU, "", ""), {"gains": gains})


def test_a_pendulum_has_the_energy_of_the_upright_rest_at_5_55_s() -> None:
    rod = sd.ModelBuilder("pendulum").add_body("rod", axis=(0, 1, 0), inertia=(1.0, (0, 0, -1.0), np.zeros((3, 3))))
    pump = law(pump_pendulum, 0.5, 0.0, 0.0, 9.81).limited_by([2.0])
    run = sd.simulate(rod.build(), [0.01], [0.0], 8.0, 2e-3, "rk4", control=pump)
    off = abs(0.5 * run.v[:, 0] ** 2 - 9.81 * np.cos(run.q[:, 0]) - 9.81)
    assert run.t[np.argmax(off < 0.01)] == pytest.approx(5.55, abs=0.01)
    assert off[run.t > 5.56].max() < 0.02


def test_a_cart_pole_is_where_an_lqr_catches_it_at_5_99_s() -> None:
    """From 0.1 rad off hanging: nearly upright and at rest, as at no time before."""
    pytest.importorskip("scipy")
    model, rest = cart_pole(1.0, 1.0, 1.0), np.zeros(2)
    run = sd.simulate(model, [0.0, np.pi - 0.1], rest, 5.99, 0.01, "rk4", control=law(pump_cart, 0.2, 0.0, 0.0, 9.81))
    angle = run.q[:, 1] - 2.0 * np.pi * np.round(run.q[:, 1] / (2.0 * np.pi))
    near = (abs(angle) < 0.15) & (abs(run.v[:, 1]) < 0.1)
    assert near[-1]
    assert not near[run.t < 5.9].any()
    A, B = sd.linearize(model, rest, rest, rest)
    upright = np.array([0.0, run.q[-1, 1] - angle[-1]])
    gains = sd.lqr(A, B[:, [0]], np.eye(4), np.eye(1))
    caught = sd.simulate(model, run.q[-1], run.v[-1], 15.0, 0.01, "rk4", control=gains.feedback(upright, joints=[0]))
    assert abs(caught.q[-1] - upright).max() < 1e-3
    assert abs(caught.q[:, 1] - upright[1]).max() < 0.2


def test_an_acrobot_is_near_the_top_at_56_7_s_by_energy_alone() -> None:
    """Its V never rises; at 56.7 s the state is 0.14 from the upright rest, nearer than at any time before."""
    model = acrobot()
    run = sd.simulate(model, [0.5, 0.0], [0.0, 0.0], 58.0, 0.01, "rk4", control=law(pump_acrobot, KD, KP, KV, G))
    off = np.linalg.norm(np.c_[run.q[:, 0] % (2.0 * np.pi) - np.pi, run.q[:, 1], run.v], axis=1)
    at = int(np.argmin(abs(run.t - 56.7)))
    assert off[at] == pytest.approx(0.134, abs=0.006)
    assert run.t[off.argmin()] == pytest.approx(56.73, abs=0.03)
    lack = run.energy - float(sd.potential_energy(model, [np.pi, 0.0]))
    fallen = 0.5 * (lack**2 + KD * run.v[:, 1] ** 2 + KP * run.q[:, 1] ** 2)
    assert np.diff(fallen).max() < 1e-11 * fallen[0]
