"""Operational-space dynamics of a frame: Λ (J a + J̇ v) + μ + p = F, and the coupling of two frames."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_finite, check_model, frame_row_and_placement, reference_code
from ..calls.dynamics import calls, checked_call
from ..model.model import Frame, Model
from ..recursions.tree.operational_inertia import COUPLING
from ..waiting import watch
from .spectral import ALL_AXES, DAMPING, LENGTH, axes_of, lengths_of, share_of, spectral_inverse

Array = NDArray[np.float64]


class OperationalSpace(NamedTuple):
    """The dynamics of a frame along m axes: Λ (J a + J̇ v) + μ + p = F with F = J̄ᵀ τ.

    Lambda  (..., m, m)   operational-space inertia (J M⁻¹ Jᵀ)⁻¹ [kg | kg m | kg m²]
    mu      (..., m)      Coriolis and centrifugal force J̄ᵀ C v - Λ J̇ v [N | N m]
    p       (..., m)      gravity J̄ᵀ g [N | N m]
    J_bar   (..., nv, m)  dynamically consistent inverse M⁻¹ Jᵀ Λ of J
    N       (..., nv, nv) 1 - J̄ J: torques Nᵀ τ₀ do not accelerate the frame; N a is the part of a with J N a = 0
    rank    (...)         number of directions in which Λ is the exact inverse
    weak    (..., m, m)   rows: the other directions, in the metric of lengths; 0 elsewhere
    C       (..., m, m)   (J̄ᵀ C - Λ J̇) J̄, the Coriolis matrix of a motion J̄ ẋ: dΛ/dt = C + Cᵀ
    """

    Lambda: Array
    mu: Array
    p: Array
    J_bar: Array
    N: Array
    rank: NDArray[np.intp]
    weak: Array
    C: Array


@watch.call("operational_space")
def operational_space(
    model: Model, q: ArrayLike, v: ArrayLike, frame: str | Frame, reference: str = "local", axes: str = ALL_AXES, *,
    length: float = LENGTH, damping: float = DAMPING,
) -> OperationalSpace:  # fmt: skip
    """The dynamics of a frame: inertia, Coriolis force, gravity, the consistent inverse of J and its null space.

    model      Model
    q          (..., nq)  joint positions [rad | m]
    v          (..., nv)  joint velocities [rad/s | m/s]
    frame      a link's or joint's name
    reference  local, world or local_world_aligned: axes of J, J̇ v and all results
    axes       letters of xyz, and for rotations after an r: "xyz" for a point, "xyz rz"
    length     [m] by which rotations are compared with translations
    damping    share of the mobility's largest eigenvalue below which a direction is weak: there Λ stays below
               1.125 / (damping · largest) instead of growing without bound, and N keeps the direction free

    Returns OperationalSpace (Lambda, mu, p, J_bar, N, rank, weak, C). If rank is m, all are exact.
    Raises  ModelError for an unknown frame; SpatialDynError for axes, length or damping; ShapeError, NonFiniteError,
            InertiaError
    Source  Khatib, A unified approach for motion and force control of robot manipulators (1987).

    >>> import numpy as np, spatialdyn as sd
    >>> model, q, v = sd.load_urdf("ur5"), [0.1, -1.0, 1.2, 0.3, 0.5, 0.2], np.ones(6)
    >>> x = sd.operational_space(model, q, v, "tool0")
    >>> tau = np.arange(6.0)
    >>> acceleration = sd.frame_acceleration(model, q, v, sd.aba(model, q, v, tau), "tool0")
    >>> bool(np.allclose(x.Lambda @ acceleration + x.mu + x.p, x.J_bar.T @ tau))
    True
    """
    rows = axes_of(axes)
    lengths, share = lengths_of(rows, length), share_of(damping)
    check_model(model)
    q, v = as_finite("q", q), as_finite("v", v)
    J = np.asarray(calls["frame_jacobian"](model, q, frame, reference))[..., rows, :]
    dJ = np.asarray(calls["frame_jacobian_dot"](model, q, v, frame, reference))[..., rows, :]
    A = np.asarray(calls["operational_space_inertia_inverse"](model, q, frame, reference))[..., rows, :][..., rows]
    inverse, C = np.asarray(calls["minverse"](model, q)), np.asarray(calls["coriolis_matrix"](model, q, v))
    Lambda, rank, weak = spectral_inverse(A, lengths, share)
    J_bar = inverse @ np.swapaxes(J, -1, -2) @ Lambda
    back = np.swapaxes(J_bar, -1, -2)
    force = back @ C - Lambda @ dJ  # of joint velocities
    return OperationalSpace(
        Lambda, times(force, v), times(back, np.asarray(calls["generalized_gravity"](model, q))), J_bar,
        np.eye(model.nv) - J_bar @ J, rank, weak, force @ J_bar,
    )  # fmt: skip


def operational_space_coupling(
    model: Model, q: ArrayLike, frame: str | Frame, other: str | Frame, reference: str = "local",
    out: Array | None = None,
) -> Array:  # fmt: skip
    """J M⁻¹ J₂ᵀ (..., 6, 6) of two frames: the acceleration of one per force on the other, without computing M.

    model      Model
    q          (..., nq)  joint positions [rad | m]
    frame      name of the link or joint that is accelerated
    other      name of the link or joint on which the force acts
    reference  local, world or local_world_aligned, for each frame its own
    out        (..., 6, 6)  written in place if given

    Returns the coupling, linear first [1/kg | 1/(kg m) | 1/(kg m²)]; with ``operational_space_inertia_inverse`` of both
    frames it gives the mobility of two hands together.
    Raises  as ``operational_space_inertia_inverse``
    Source  after Jain, Robot and Multibody Dynamics (2011).

    >>> import numpy as np, spatialdyn as sd
    >>> model, q = sd.load_urdf("two_link"), [0.5, -0.3]
    >>> there = sd.operational_space_coupling(model, q, "tip", "link1")
    >>> back = sd.operational_space_coupling(model, q, "link1", "tip")
    >>> bool(np.allclose(there, back.T))
    True
    """
    static = (
        *frame_row_and_placement(check_model(model), frame), *frame_row_and_placement(model, other),
        reference_code(reference),
    )  # fmt: skip
    found: Array = checked_call(COUPLING, model, (q,), static, out)
    return found


def times(A: Any, x: Any) -> Array:
    """A x, for matrices and vectors with any leading axes."""
    found: Array = np.einsum("...ij,...j->...i", A, x)
    return found
