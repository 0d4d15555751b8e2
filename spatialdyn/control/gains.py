"""Gains of control laws by pole placement and Riccati's equation."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, as_count, as_flag, broadcast, check_model, within_range
from ..calls.dynamics import calls
from ..calls.random_configurations import random_configuration
from ..errors import NonFiniteError, ShapeError, SpatialDynError, literal, pip_install
from ..model.model import Model
from ..waiting import watch
from .laws import StateFeedback

Array = NDArray[np.float64]
MARGIN = 1e-12  # relative to the largest entry of A: a pole nearer to the border of stability counts as on it


class Gains(NamedTuple):
    """Kp and Kd, to unpack into a law."""

    Kp: Array
    Kd: Array


def critical_gains(omega: ArrayLike, zeta: ArrayLike = 1.0) -> Gains:
    """Kp = ω², Kd = 2 ζ ω for ``ComputedTorque``: errors have frequency ω and damping ratio ζ, critical at 1.

    omega  number or (nv,), above 0 [rad/s]
    zeta   number or (nv,), above 0

    For ``PD`` and similar laws multiply both by the largest diagonal of M. With a torque held over steps of
    semi_implicit_euler such a mode is stable below ``largest_step``.
    Raises SpatialDynError, ShapeError; NonFiniteError for numbers beyond the range of float64

    >>> import spatialdyn as sd
    >>> [float(x) for x in sd.critical_gains(10.0, 0.7)]
    [100.0, 14.0]
    """
    w, z = _modes(omega, zeta)
    with np.errstate(over="ignore"):
        found = Gains(w * w + 0.0 * z, 2.0 * z * w)
    within_range("a gain", *found)
    return found


def largest_step(omega: ArrayLike, zeta: ArrayLike) -> Array:
    """The step [s] below which a mode of frequency ω and damping ζ is stable under a torque held over steps of
    semi_implicit_euler: (2 √(1 + ζ²) - 2 ζ) / ω.

    Raises SpatialDynError, ShapeError; NonFiniteError for numbers beyond the range of float64

    >>> import spatialdyn as sd
    >>> round(float(sd.largest_step(1.0, 0.7)), 3)
    1.041
    """
    w, z = _modes(omega, zeta)
    with np.errstate(over="ignore", under="ignore"):
        found = np.asarray(2.0 / (np.hypot(1.0, z) + z) / w)
    within_range("a step", found)
    return found


def _modes(omega: ArrayLike, zeta: ArrayLike) -> tuple[Array, Array]:
    """Frequencies and dampings, which broadcast."""
    w, z = _positive("omega", omega), _positive("zeta", zeta)
    broadcast(["omega", "zeta"], [w.shape, z.shape])
    return w, z


def _positive(name: str, value: ArrayLike) -> Array:
    x = as_array(name, value)
    if not ((x > 0.0) & np.isfinite(x)).all():
        raise SpatialDynError(f"{name} is {x.tolist()}, expected finite numbers above 0")
    return x


@watch.call("gravity_stiffness_bound")
def gravity_stiffness_bound(model: Model, samples: int = 1000, seed: int = 0) -> float:
    """The largest slope of gravity, max ‖∂g/∂q‖₂ [N m/rad], over random configurations within the limits.

    With PD and the constant g(q_d), q_d is the only equilibrium if the least eigenvalue of Kp is above the true
    maximum; the sampled maximum is a little below it. With g(q) (``PDGravity``) any Kp above 0 is enough.

    Raises SpatialDynError

    >>> import spatialdyn as sd
    >>> round(sd.gravity_stiffness_bound(sd.load_urdf("pendulum")), 3)
    4.905
    """
    check_model(model)
    if not (n := as_count(samples, 10**7)):
        raise SpatialDynError(f"samples is {literal(samples)}, expected a whole number from 1 to 10000000")
    q = random_configuration(model, seed, (n,))
    slope = np.asarray(calls["generalized_gravity_derivatives"](model, q))
    return float(np.linalg.norm(slope, 2, axis=(-2, -1)).max(initial=0.0))


class LQR(NamedTuple):
    """K (m, n), P (n, n) and the poles (n,) of the closed loop; ``feedback(q, v, tau)`` is the law."""

    K: Array
    P: Array
    poles: NDArray[Any]
    discrete: bool = False

    def feedback(
        self, q: ArrayLike, v: ArrayLike | None = None, tau: ArrayLike | None = None, joints: ArrayLike | None = None
    ) -> StateFeedback:
        """The law tau = tau₀ - K (q ⊖ q₀, v - v₀); ``joints`` are the freedoms that K drives, if not all."""
        return StateFeedback(self.K, q, v, tau, joints, held=self.discrete)


@watch.call("lqr")
def lqr(A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, *, discrete: bool = False) -> LQR:
    """The gain K of u = -K x that minimizes ∫ xᵀQx + uᵀRu along ẋ = A x + B u, or the sum along x⁺ = A x + B u.

    A (n, n), B (n, m)  as ``linearize`` returns them; for a robot with fewer motors than freedoms B has the columns of
                        its motors, B[:, [0]]
    Q (n, n), R (m, m)  symmetric, Q positive semidefinite, R positive definite
    discrete            whether A and B are those of a step

    SciPy solves Riccati's equation. Raises  SpatialDynError naming the eigenvalue of Q or R, for a system that no
    feedback stabilizes, or if a mode that does not decay by itself has no weight in Q; ShapeError; ImportError without
    SciPy

    >>> import numpy as np, spatialdyn as sd
    >>> found = sd.lqr([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], np.eye(2), [[1.0]])
    >>> found.K.round(6).tolist()
    [[1.0, 1.732051]]
    """
    try:
        from scipy import linalg
    except ImportError as error:
        raise ImportError(f"lqr needs SciPy: {pip_install('simulation')}") from error
    discrete = as_flag("discrete", discrete)
    a, b = as_array("A", A), as_array("B", B)
    if a.ndim != 2 or a.shape[0] != a.shape[1] or not a.size:
        raise ShapeError(f"A has shape {a.shape}, expected (n, n), n of 1 or more")
    if b.ndim != 2 or len(b) != len(a) or not b.size:
        raise ShapeError(f"B has shape {b.shape}, expected ({len(a)}, m), m of 1 or more")
    weights = []
    for name, value, size, strict in (("Q", Q, len(a), False), ("R", R, b.shape[1], True)):
        x = as_array(name, value)
        if x.shape != (size, size):
            raise ShapeError(f"{name} has shape {x.shape}, expected {(size, size)}")
        if not np.isfinite(x).all() or abs(x - x.T).max() > 1e-9 * abs(x).max(initial=1e-300):
            raise SpatialDynError(f"{name} is {x.tolist()}, expected a symmetric matrix")
        least = float(np.linalg.eigvalsh(x).min())
        if least <= 0.0 if strict else least < -1e-12 * abs(x).max():
            raise SpatialDynError(
                f"{name} has the eigenvalue {least:.6g}, expected {'above 0' if strict else '0 or more'}"
            )
        weights.append(x)
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise NonFiniteError("A or B has numbers that are not finite, expected finite ones")
    q, r = weights
    solve = linalg.solve_discrete_are if discrete else linalg.solve_continuous_are
    try:
        P = solve(a, b, q, r)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise SpatialDynError(f"no feedback stabilizes A, B ({error}), expected a stabilizable system") from error
    K = np.linalg.solve(r + b.T @ P @ b, b.T @ P @ a) if discrete else np.linalg.solve(r, b.T @ P)
    poles = np.linalg.eigvals(a - b @ K)
    most = float(abs(poles).max() - 1.0 if discrete else poles.real.max())
    if most > -MARGIN * max(1.0, float(abs(a).max())):
        raise SpatialDynError(
            f"Q leaves a mode unweighted that does not decay: the closed loop has the pole "
            f"{poles[(abs(poles) if discrete else poles.real).argmax()]:.6g}, expected a Q that sees it"
        )
    return LQR(K, P, poles, discrete)
