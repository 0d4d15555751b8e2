"""Springs of series-elastic joints in simulations: their torques, and the largest step at which a method is stable."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.dynamics import calls
from ..engines.compiled import numba_kernels
from ..errors import ModelError, SimulationError
from ..model.model import Model
from ..recursions.springs import SPRING_TORQUE, add_springs
from .system import System

Array = NDArray[np.float64]
GROWS = 1e-6  # above 1, of the largest factor of a step: free motions have double factors of 1, known to √eps
HALVINGS = 40  # of an interval of steps
UNFIT = ("variational",)  # methods whose torques depend on no position


def has_springs(model: Model) -> bool:
    """Whether a model has springs between rotors and joints."""
    return bool(model.bodies["spring"].any())


# --- a step, traced -------------------------------------------------------------------------------------


def traced_springs(rows: Any, q: Any, v: Any) -> Any:
    """The torques of the springs, as recorded numbers; None without any."""
    if not any(row.spring for row in rows):
        return None
    made = np.zeros(len(v), object)
    add_springs(rows, q, v, made)
    return made


# --- a step by kernels ----------------------------------------------------------------------------------


def spring_kernel() -> Callable[..., Array]:
    """``(table, q, v) -> torques of the springs``."""
    kernel = numba_kernels.sample_kernel(numba_kernels.variant(SPRING_TORQUE, frozenset({"v"})))

    def pull(table: Any, q: Array, v: Array) -> Array:
        made = np.empty(len(v))
        kernel(table, np.ascontiguousarray(q), np.ascontiguousarray(v), made)
        return made

    return pull


def sprung(kernels: Any) -> Any:
    """The kernels of a family whose acceleration, or ṗ, has the torques of the springs in it."""
    pull = spring_kernel()
    if hasattr(kernels, "accelerate"):

        def accelerate(system: System, q: Any, v: Any, a: Any) -> int:
            tau = system.tau + pull(system.table, q, v)
            code: int = kernels.accelerate(system._replace(tau=tau, kernels=kernels), q, v, a)
            return code

        return kernels._replace(accelerate=accelerate)

    def field(system: System, q: Any, p: Any, rates: Any) -> int:
        code: int = kernels.field(system._replace(kernels=kernels), q, p, rates)
        rates[1] += pull(system.table, q, rates[0])
        return code

    return kernels._replace(field=field)


# --- stability ------------------------------------------------------------------------------------------


def check_springs(model: Model, method: str, q: Array, dt: float) -> None:
    """Refuse a method, or a step dt of an explicit one at which springs would make motions grow, by the M at q.

    Raises SimulationError naming the joint of the stiffest spring and the largest stable step.
    """
    if not has_springs(model):
        return
    if model.mimic_matrix is not None:
        raise ModelError(f'model "{model.name}" has springs and mimic joints, expected one of them (mimic=False)')
    if method in UNFIT:
        raise SimulationError(f'method is "{method}", expected another with springs, such as gauss4')
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


def _frequency(model: Model, M: Array, i: int) -> float:
    """k (1/I + 1/n²J) of the spring of row i, I and J the entries on the diagonal of M."""
    b = model.bodies[i]
    return float(b["stiffness"] * (1.0 / M[b["spring"] - 1, b["spring"] - 1] + b["gear"] ** 2 / M[i - 1, i - 1]))


def largest_factor(model: Model, method: str, q: Array, h: float) -> float:
    """The largest magnitude by which a step h multiplies a motion of v̇ = -M⁻¹ (K x + D v), M that at q."""
    n, K, D = model.nv, np.zeros((model.nv, model.nv)), np.zeros((model.nv, model.nv))
    for i in np.flatnonzero(model.bodies["spring"]):
        b = model.bodies[i]
        pull = np.zeros(n)
        pull[i - 1], pull[b["spring"] - 1] = b["gear"], -1.0
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


STEPS: dict[str, Callable[[Array, float], Array]] = {
    "explicit_euler": _euler,
    "semi_implicit_euler": _semi_implicit,
    "velocity_verlet": _verlet,
    "rk4": _rk4,
}
