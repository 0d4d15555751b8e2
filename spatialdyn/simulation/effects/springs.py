"""Springs of series-elastic joints: their torques, and the largest step at which a method is stable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...calls.dynamics import calls
from ...errors import SimulationError
from ...model.model import Model
from ...recursions.joints.springs import SPRING_TORQUE
from ..arithmetic import Arithmetic
from . import work
from .effect import Effect

Array = NDArray[np.float64]
GROWS = 1e-6  # tolerance above 1 of a step's largest factor: free motions have double factors of 1, accurate to √eps
HALVINGS = 40  # of the interval that holds the largest stable step


def has_springs(model: Model) -> bool:
    """Whether a model has springs between rotors and joints."""
    return bool(model.bodies["spring"].any())


@dataclass(frozen=True, eq=False)
class Springs(Effect):
    """The springs of the model."""

    name = "springs"
    work = work.SPRINGS

    def torque(self, at: Arithmetic, q: Any, v: Any) -> Any:
        (made,) = at.evaluate(SPRING_TORQUE, q=q, v=v).values()
        return made


# --- stability ------------------------------------------------------------------------------------------


def check_springs(model: Model, method: str, q: Array, dt: float) -> None:
    """Refuse a method that springs rule out, or a step dt at which an explicit method is unstable with M at q.

    Raises SimulationError naming the joint of the stiffest spring and the largest stable step.
    """
    if not has_springs(model):
        return
    if method not in STEPS or largest_factor(model, method, q, dt) <= 1.0 + GROWS:
        return
    low, high = 0.0, dt
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if largest_factor(model, method, q, middle) <= 1.0 + GROWS else (low, middle)
    rows = np.flatnonzero(model.bodies["spring"])
    M = np.asarray(calls["crba"](model, q))
    stiffest = max(rows, key=lambda i: _frequency(model, M, int(i)))
    joint = next(j.name for j in model.joints[1:] if j.row == model.bodies["spring"][stiffest])
    raise SimulationError(
        f'dt is {dt:g} s, expected at most {low:.3g} s, where {method} is stable with the spring of joint "{joint}"'
    )


def _pull(model: Model, i: int) -> Array:
    """(nv,) by which the stretch θ/n - q of the spring of row i grows with each velocity."""
    b, pull = model.bodies[i], np.zeros(len(model.bodies) - 1)
    pull[i - 1], pull[b["spring"] - 1] = b["gear"], -1.0
    return pull if model.mimic_matrix is None else pull @ model.mimic_matrix


def _frequency(model: Model, M: Array, i: int) -> float:
    """k (1/I + 1/n²J) of the spring of row i, I and J the entries on the diagonal of M."""
    return float(model.bodies[i]["stiffness"] * (_pull(model, i) ** 2 / np.diagonal(M)).sum())


def largest_factor(model: Model, method: str, q: Array, h: float) -> float:
    """The largest factor by which a step h multiplies a motion of v̇ = -M⁻¹ (K x + D v), with M at q."""
    n, K, D = model.nv, np.zeros((model.nv, model.nv)), np.zeros((model.nv, model.nv))
    for i in np.flatnonzero(model.bodies["spring"]):
        b, pull = model.bodies[i], _pull(model, int(i))
        K += b["stiffness"] * np.outer(pull, pull)
        D += b["spring_damping"] * np.outer(pull, pull)
    Minv = np.asarray(calls["minverse"](model, q))
    one, none = np.eye(n), np.zeros((n, n))
    A = np.block([[none, one], [-Minv @ K, -Minv @ D]])
    return float(abs(np.linalg.eigvals(STEPS[method](A, h))).max())


def _euler(A: Array, h: float) -> Array:
    return np.asarray(np.eye(len(A)) + h * A)


def _semi_implicit(A: Array, h: float) -> Array:
    n = len(A) // 2
    move = np.eye(2 * n)
    move[:n, n:] = h * np.eye(n)
    push = np.eye(2 * n)
    push[n:] += h * A[n:]
    return np.asarray(move @ push)


def _verlet(A: Array, h: float) -> Array:
    n = len(A) // 2
    ahead = np.eye(2 * n)
    ahead[:n] += h * A[:n] + 0.5 * h * h * A[n:] @ np.eye(2 * n)
    guess = ahead.copy()
    guess[n:] += h * A[n:]
    made = ahead.copy()
    made[n:] += 0.5 * h * (A[n:] + A[n:] @ guess)
    return np.asarray(made)


def _rk4(A: Array, h: float) -> Array:
    made, term = np.eye(len(A)), np.eye(len(A))
    for k in range(1, 5):
        term = term @ A * (h / k)
        made = made + term
    return made


def _kicked(A: Array, h: float) -> Array:
    """The map of a step with half a kick at both ends, at the mean velocity: Störmer's and variational methods."""
    n = len(A) // 2
    K, D, one, none = A[n:, :n], A[n:, n:], np.eye(n), np.zeros((n, n))
    half = np.linalg.solve(one - 0.5 * h * D, np.hstack([0.5 * h * K, one]))
    ahead = np.hstack([one, none]) + h * half
    return np.vstack([ahead, half + 0.5 * h * (K @ ahead + D @ half)])


STEPS: dict[str, Callable[[Array, float], Array]] = {
    "explicit_euler": _euler,
    "semi_implicit_euler": _semi_implicit,
    "velocity_verlet": _verlet,
    "rk4": _rk4,
    "stormer_verlet": _kicked,
    "variational": _kicked,
}
