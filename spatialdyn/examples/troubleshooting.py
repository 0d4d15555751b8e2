"""The chapter's troubleshooting table: each symptom made on purpose, and the call that finds its cause.

Learn    which call to reach for: diagnose, verify_skew_symmetry, check_conservation, the rank of a regressor, and to
         compare term by term rather than τ as a whole.
Look at  the line "found by" of each symptom. Two entries of the table are out of date: pin.crba returns both triangles
         from Python, and a Verlet that is explicit does not cure the drift of Hamilton's equations when M depends on q.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import start

Q, V = np.array([0.5, -0.3, 0.8]), np.array([1.0, 2.0, -0.7])


def arm() -> sd.Model:
    """The 3R arm on which the symptoms are made."""
    return sd.load_urdf("three_link")


def mass_matrix_is_not_positive_definite() -> tuple[str, Any]:
    """Cholesky fails, for a link has an inertia that no body has."""
    builder = sd.ModelBuilder("arm")
    builder.add_body("forearm", inertia=(1.0, (0.1, 0, 0), np.diag([0.05, 0.05, -0.02])))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it says so at once, in fact
        model = builder.build()
    try:
        np.linalg.cholesky(sd.crba(model, [0.0]))
    except np.linalg.LinAlgError:
        finding = sd.diagnose(model).of("inertia")[0]
        return f'sd.diagnose(model): link "{finding.link}" {finding.message}', finding
    raise AssertionError("Cholesky did not fail")


def rnea_differs_from_its_terms() -> tuple[str, Any]:
    """M a + C v + g is not rnea, for M is an upper triangle only. Some of v and a set to 0 tell which term it is."""
    model, a = arm(), np.array([0.3, 0.1, -0.2])
    half = np.triu(sd.crba(model, Q))  # as Pinocchio's crba has it in C++; here and from Python both are filled

    def residual(v: np.ndarray, a: np.ndarray) -> float:
        terms = half @ a + sd.coriolis_matrix(model, Q, v) @ v + sd.generalized_gravity(model, Q)
        return float(abs(sd.rnea(model, Q, v, a) - terms).max())

    left = {"v = a = 0": residual(0 * V, 0 * a), "a = 0": residual(V, 0 * a), "v = 0": residual(0 * V, a)}
    shown = ", ".join(f"{name} leaves {x:.1e}" for name, x in left.items())
    return f"one term at a time: {shown}: gravity and C are right, M is not", left


def coriolis_matrix_is_not_skew() -> tuple[str, Any]:
    """Ṁ - 2C is not skew-symmetric, for C is a valid one (its C v is right) but not that of the Christoffel symbols."""
    model = arm()
    C = sd.ChristoffelC(model).not_christoffel(Q, V, skew=False)
    found = sd.verify_skew_symmetry(model, Q, V, C)
    return f"sd.verify_skew_symmetry(model, q, v, C): {found!r}", (found, C @ V - sd.coriolis_matrix(model, Q, V) @ V)


def controller_gains_energy() -> tuple[str, Any]:
    """τ = M a_r + C v_r + g - K s: V = ½ sᵀ M s grows, for the C of the controller is not the one that proofs need."""
    model, K = arm(), 0.02
    rates = {}
    other = sd.ChristoffelC(model).not_christoffel(Q, V, skew=False)
    for name, C in {"Christoffel's C": sd.coriolis_matrix(model, Q, V), "another C": other}.items():
        N = sd.mass_matrix_dot(model, Q, V) - 2 * C
        s = np.linalg.eigh(0.5 * (N + N.T))[1][:, -1]  # V̇ = ½ sᵀ N s - K sᵀ s, s the worst error
        rates[name] = float(0.5 * s @ N @ s - K * s @ s)
    text = ", ".join(f"V̇ = {rate:+.3f} W with {name}" for name, rate in rates.items())
    return f"V̇ from sᵀ(Ṁ - 2C)s of the controller's own C: {text}; use sd.modified_rnea", rates


def energy_drifts() -> tuple[str, Any]:
    """The energy of a free motion drifts, for the method does not keep Ω: the slope stands out of its own error."""
    model, reports = sd.load_urdf("two_link"), {}
    for method in ("rk4", "velocity_verlet", "stormer_verlet"):
        run = sd.simulate(model, [1.5, 0.3], [0.0, 0.0], 100.0, 0.02, method)
        reports[method] = sd.check_conservation(run)[0]
    text = "; ".join(f"{name} {x.slope:+.1e} ± {x.slope_error:.0e} W" for name, x in reports.items())
    return f"sd.check_conservation(run): {text}", reports


def formula_differs_from_the_library() -> tuple[str, Any]:
    """A formula on paper gives other torques, for it counts q1 from below: M agrees, g does not."""
    model, q = sd.load_urdf("two_link"), np.array([0.4, -0.9])
    M = np.array([[3 + 2 * np.cos(q[1]), 1 + np.cos(q[1])], [1 + np.cos(q[1]), 1.0]])
    g = 9.81 * np.array([2 * np.sin(q[0]) + np.sin(q.sum()), np.sin(q.sum())])
    library = {"M": sd.crba(model, q), "g": sd.generalized_gravity(model, q)}
    shifted = sd.generalized_gravity(model, q - [np.pi / 2, 0.0])
    found = {
        "M": abs(M - library["M"]).max(),
        "g": abs(g - library["g"]).max(),
        "g at q1 - 90°": abs(g - shifted).max(),
    }
    shown = ", ".join(f"{name} {x:.1e}" for name, x in found.items())
    return f"the terms apart: {shown}; a zero of q1 elsewhere", found


def parameters_do_not_converge() -> tuple[str, Any]:
    """Adaptation or identification does not converge, for the motion does not excite: its regressor lacks rank."""
    model, rng, ranks = arm(), np.random.default_rng(0), {}
    for name, size in {"one pose": (0, 0, 0), "poses": (3, 0, 0), "motion": (3, 2, 5)}.items():
        q, v, a = (Q * (k == 0) + s * rng.uniform(-1, 1, (200, 3)) for k, s in enumerate(size))
        Y = sd.joint_torque_regressor(model, q, v, a)[:, :, 1:].reshape(600, 30)  # without the world's columns
        ranks[name] = int(np.linalg.matrix_rank(Y, tol=1e-9 * np.linalg.norm(Y, 2)))
    text = ", ".join(f"{rank} by {name}" for name, rank in ranks.items())
    return f"rank of sd.joint_torque_regressor: of 30 parameters {text}; no motion sees more", ranks


def rotors_spoil_identification() -> tuple[str, Any]:
    """Torques that were measured do not fit, for the rotors are not in the model: what is left is r² J times q̈."""
    model, rng = arm(), np.random.default_rng(0)
    ratio, rotor = 100.0, 2e-5  # r² J = 0.2 kg m², as much as the links themselves have
    real = model.with_(armature={name: ratio**2 * rotor for name in model.names[1:]})
    q, v, a = rng.normal(size=(3, 50, 3))
    left = sd.rnea(real, q, v, a) - sd.rnea(model, q, v, a)
    slope = (left * a).sum(0) / (a * a).sum(0)
    share = sd.crba(real, Q).diagonal() / sd.crba(model, Q).diagonal() - 1.0
    text = f"{slope.round(6).tolist()} kg m², {share.round(2).tolist()} of M's diagonal"
    return f"regress τ - rnea on q̈: {text}; model.with_(armature=...)", slope


SYMPTOMS: tuple[Callable[[], tuple[str, Any]], ...] = (
    mass_matrix_is_not_positive_definite, rnea_differs_from_its_terms, coriolis_matrix_is_not_skew,
    controller_gains_energy, energy_drifts, formula_differs_from_the_library, parameters_do_not_converge,
    rotors_spoil_identification,
)  # fmt: skip


def main() -> dict[str, Any]:
    """Make every symptom and print what finds it; returns what was found, by symptom."""
    found = {}
    for symptom in SYMPTOMS:
        text, found[symptom.__name__] = symptom()
        print(f"symptom   {symptom.__doc__}\nfound by  {text}\n")
    return found


if __name__ == "__main__":
    start(main)
