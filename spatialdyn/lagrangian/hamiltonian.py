"""Hamilton's equations and the Poisson bracket, in joint velocities of any kind.

The state is (q, p) with p = M(q) v. If every v_i is the rate of a coordinate, p is canonical: Ω = Σ dq_i ∧ dp_i.
The velocities of spherical, floating and planar joints are quasi-velocities, twists in the body's frame with
[X_j, X_k] = c^m_jk X_m (``lie_brackets``). With θ^i the forms dual to X_i, so that θ^i(q̇) = v_i, the canonical one-form
is p_i θ^i and

    Ω = Σ θ^i ∧ dp_i + ½ Σ p_m c^m_jk θ^j ∧ θ^k,    {q-function f, p_j} = X_j f,    {p_j, p_k} = -c^m_jk p_m,

the same Ω and bracket as in any chart, written in another frame. A map of (q, p) is symplectic if it preserves this Ω;
preserving Σ θ^i ∧ dp_i alone is not enough.

Rotor inertia (armature) on a floating or planar joint, or one that differs by axis on a spherical joint, is an
exception. It is added to M only, so the equation of motion M q̈ + C v + g = τ lacks the term by which the frame's
rotation changes the rotor's momentum: p = M v and ṗ are those of this equation and the energy is conserved, but H does
not generate ṗ, and no method preserves Ω. On every other joint H generates ṗ.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, as_number, check_model
from ..calls.dynamics import calls
from ..errors import NonFiniteError, ShapeError, SpatialDynError, literal
from ..model.model import Model
from ..waiting import watch
from .lie_brackets import structure_constants

Array = NDArray[np.float64]
Observable = Callable[[Array, Array], float]

LEAST_STEP = 1e-12  # below this step differences are rounding
STEP = 4e-3  # of 6th-order differences: h⁶/140 of truncation is 3e-17 f⁽⁷⁾, rounding 2 eps/h = 1e-13 of f
WEIGHTS = ((1, 45.0 / 60.0), (2, -9.0 / 60.0), (3, 1.0 / 60.0))  # of f(kh) - f(-kh), over h


def hamilton_equations(
    model: Model, q: ArrayLike, p: ArrayLike, tau: ArrayLike | None = None, fext: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Hamilton's equations v = ∂H/∂p, ṗ = -∂H/∂q + tau: ``v, dp = hamilton_equations(model, q, p)``, in O(n).

    Source: v = M⁻¹ p after Featherstone, RBDA (2008), table 7.1; ṗ = Cᵀ v + tau - g is derived here.

    In quasi-velocities ṗ_j = -X_j H - p_m c^m_jk v_k + tau_j, by the same sweep; q moves with v, towards
    integrate(q, v dt).

    q      (..., nq)          joint positions [rad | m]
    p      (..., nv)          joint momenta M(q) v [kg m²/s | kg m/s]
    tau    (..., nv)          joint torques [N m | N]; zero if left out
    fext   (..., njoints, 6)  force on each joint's body, in the joint's frame, linear first [N | N m]; zero if left out

    Returns v (..., nv) [rad/s | m/s] and dp (..., nv) [N m | N].
    Raises  the errors of hamilton_field: ShapeError, ConfigurationError, InertiaError, NonFiniteError.

    >>> import numpy as np, spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> q, v = np.array([0.5, -0.3]), np.array([1.0, 2.0])
    >>> found, dp = hamilton_equations(model, q, sd.momentum(model, q, v))
    >>> bool(abs(found - v).max() < 1e-12)
    True
    """
    check_model(model)
    rates = calls["hamilton_field"](model, q, p, np.zeros(model.nv) if tau is None else tau, fext)
    return rates[..., 0, :], rates[..., 1, :]


@watch.call("poisson_bracket")
def poisson_bracket(
    model: Model, F: Observable, G: Observable, q: ArrayLike, p: ArrayLike, step: float = STEP
) -> float:
    """Poisson bracket {F, G} of two functions of (q, p), at one state; Ḟ = {F, H} along a free motion.

    Source: the definition, by central differences of order 6.

        {F, G} = Σ_i (X_i F ∂G/∂p_i - ∂F/∂p_i X_i G) - Σ_ijm p_m c^m_ij ∂F/∂p_i ∂G/∂p_j

    with X_i F the derivative along integrate(q, e_i). If v are rates of coordinates, X_i = ∂/∂q_i and c = 0, and this
    is the textbook bracket. For the quasi-velocities of spherical, floating and planar joints, with
    {p_i, p_j} = -c^m_ij p_m, the last sum gives the same bracket; without it neither Ḟ = {F, H} nor Jacobi's identity
    would hold.

    F, G   functions of (q (nq), p (nv)) that return a number; each is called 12 nv times
    q      (nq,)  joint positions [rad | m]
    p      (nv,)  joint momenta [kg m²/s | kg m/s]
    step   step of the differences, in q [rad | m], and in p times max(1, |p_i|)

    Returns {F, G}, with an error of about 1e-12 of F G for functions that vary over a radian or a metre.
    Raises  ShapeError for more than one state; SpatialDynError if a function returns no number or the step is not
            positive; NonFiniteError if a number, of q or p too, is not finite.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> round(poisson_bracket(model, lambda q, p: q[0], lambda q, p: p[0], [0.5, -0.3], [1.0, 2.0]), 9)
    1.0
    """
    check_model(model)
    q, p = as_array("q", q), as_array("p", p)
    for name, x, size in (("q", q, model.nq), ("p", p, model.nv)):
        if x.shape != (size,):
            raise ShapeError(f"{name} has shape {x.shape}, expected ({size},): a bracket is of one state")
        if not np.isfinite(x).all():
            raise NonFiniteError(f"{name} is {literal(x)}, expected finite numbers")
    if not LEAST_STEP <= as_number(step) < np.inf:
        raise SpatialDynError(f"step is {literal(step)}, expected a positive number, {LEAST_STEP:g} at least")
    for f, name in ((F, "F"), (G, "G")):
        if not callable(f):
            raise SpatialDynError(f"{name} is {literal(f)}, expected a function of (q, p)")
    dF, dG = (_gradients(model, f, name, q, p, float(step)) for f, name in ((F, "F"), (G, "G")))
    gyroscopic = np.einsum("m,mij,i,j->", p, structure_constants(model), dF[1], dG[1])
    return float(dF[0] @ dG[1] - dF[1] @ dG[0] - gyroscopic)


def _gradients(model: Model, f: Observable, name: str, q: Array, p: Array, step: float) -> tuple[Array, Array]:
    """X_i f and ∂f/∂p_i, (nv,) each."""
    by_q, by_p = np.zeros(model.nv), np.zeros(model.nv)
    scale = step * np.maximum(1.0, abs(p))
    for k, weight in WEIGHTS:
        for sign in (1.0, -1.0):
            moved = calls["integrate"](model, q, sign * k * step * np.eye(model.nv))
            pushed = p + sign * k * np.diag(scale)
            by_q += (sign * weight / step) * np.array([_number(f(x, p), name) for x in moved])
            by_p += (sign * weight / scale) * np.array([_number(f(q, x), name) for x in pushed])
    return by_q, by_p


def _number(value: object, name: str) -> float:
    """A value that is one finite number. Raises SpatialDynError naming the function."""
    x = np.asarray(value)
    if x.dtype.kind not in "fiu" or x.size != 1:
        raise SpatialDynError(f"{name} returned {literal(value)}, expected a number")
    if not np.isfinite(x).all():
        raise NonFiniteError(f"{name} returned {literal(value)}, expected a finite number")
    return float(x.reshape(()))
