"""The state after a step from the velocities that the step finds, its correction onto constraints, and derivatives.

A step finds velocities x in the axes at its beginning. Floating and planar joints first travel by their linear velocity
along these axes and then turn; their linear velocity is then expressed in the axes at the end. Under constraints one
Newton step in the metric of M brings q back onto the constraints.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies.kinds import SE2, SE3
from ..bodies.table import independent
from ..calls.dynamics import calls
from ..constraints.dynamics import constraint_error, constraint_jacobian
from ..constraints.table import Constraints
from ..model.model import Model
from .constrained_methods import jacobian_slopes

Array = NDArray[Any]


def led(model: Model, q: Array, x: Array, moved: Array, h: Array) -> tuple[Array, Array, Array, Array]:
    """q⁺, v⁺ and their derivatives, of n steps from q: returns q⁺, its displacements, v⁺ and its changes.

    Derivatives are along m directions; the first are the unit directions of q.

    x      (n, nv) velocities that the step finds
    moved  (n, nv, m) derivatives of x
    h      (n,)
    """
    (n, nv), m, h = x.shape, moved.shape[2], h[:, None]
    unit = np.broadcast_to(np.eye(nv, m), (n, nv, m))
    travels = np.zeros(nv)
    for part, _ in travellers(model):
        travels[part] = 1.0
    first, rest = h * travels * x, h * (1.0 - travels) * x
    by_q, by_step = np.moveaxis(calls["dintegrate"](model, q, first), 1, 0)
    here = by_q @ unit + by_step @ (h[..., None] * travels[:, None] * moved)
    middle = calls["integrate"](model, q, first)
    by_q, by_step = np.moveaxis(calls["dintegrate"](model, middle, rest), 1, 0)
    turned = by_step @ (h[..., None] * (1.0 - travels)[:, None] * moved)
    here, changed, after = by_q @ here + turned, moved.copy(), x.copy()
    for part, angular in travellers(model):
        back = by_q[np.ix_(range(n), part, part)]
        along_now = np.einsum("nij,nj->ni", back, x[:, part])
        after[:, part] = along_now
        changed[:, part] = back @ moved[:, part]
        if len(angular) == 3:
            changed[:, part] += np.cross(along_now[:, :, None], turned[:, angular], axis=1)
        else:
            across = np.stack([along_now[:, 1], -along_now[:, 0]], axis=1)
            changed[:, part] += across[:, :, None] * turned[:, angular]
    return calls["integrate"](model, middle, rest), here, after, changed


def travellers(model: Model) -> list[tuple[list[int], list[int]]]:
    """The freedoms (linear, angular) of each joint that both travels and turns."""
    found = []
    for i, row in enumerate(independent(model.bodies)[1:]):
        if row["kind"] in SE3 or row["kind"] in SE2:
            count, last = (3, 6) if row["kind"] in SE3 else (2, 3)
            found.append((list(range(i, i + count)), list(range(i + count, i + last))))
    return found


class Closing(NamedTuple):
    """The correction that closes constraints, for n samples; ``kept`` (n, nc) says which equations a step keeps."""

    model: Model
    held: Constraints
    kept: list[NDArray[np.bool_]]

    def back(
        self, q: Array, moved: Array, end: Array, end_moved: Array, damping: Array | None = None,
        by_damping: Array | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """The solution y of M y = Cᵀ ρ, C y = -φ(end), with M and C at q, and its derivative (n, nv, m).

        moved, end_moved     derivatives of q and of ``end``
        damping, by_damping  (n, nv) added to the diagonal of M, and its derivative (n, nv, m)
        """
        model, held, (n, nv) = self.model, self.held, (len(q), self.model.nv)
        M = np.array(calls["crba"](model, q))
        if damping is not None:
            M = M + np.eye(nv) * damping[..., None]
        C, turned = constraint_jacobian(model, held, q), jacobian_slopes(model, held, q)
        phi, ahead = constraint_error(model, held, end), constraint_jacobian(model, held, end)
        y, by, systems, rho = np.zeros((n, nv)), np.zeros((n, nv, moved.shape[2])), [], np.zeros((n, held.nc))
        for k, rows in enumerate(self.kept):
            K = np.block([[M[k], -C[k][rows].T], [C[k][rows], np.zeros((rows.sum(), rows.sum()))]])
            found = np.linalg.solve(K, np.r_[np.zeros(nv), -phi[k][rows]])
            y[k], rho[k][rows] = found[:nv], found[nv:]
            systems.append(K)
        zero = np.zeros_like(y)
        by_M, still = (calls["rnea_derivatives"](model, q, zero, x)[:, 0] for x in (y, zero))
        push = still - by_M + np.einsum("nijk,ni->njk", turned, rho)
        for k, rows in enumerate(self.kept):
            pushed = push[k] @ moved[k]
            if by_damping is not None:
                pushed = pushed - y[k][:, None] * by_damping[k]
            close = -(ahead[k][rows] @ end_moved[k]) - np.einsum("ijk,j->ik", turned[k][rows], y[k]) @ moved[k]
            by[k] = np.linalg.solve(systems[k], np.concatenate([pushed, close]))[:nv]
        return y, by
