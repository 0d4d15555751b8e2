"""The largest step at which a method is stable with springs, or with smooth friction near rest.

Both make a linear motion v̇ = -M⁻¹ (K x + D v) near a configuration. A step of the method itself from each unit state
gives its matrix, whose eigenvalues are the factors by which motions grow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.dynamics import calls
from ..calls.failures import joint_of_velocity
from ..errors import SimulationError
from ..model.model import Model
from .effects.effect import find
from .effects.friction import SmoothFriction
from .effects.springs import Springs
from .methods.explicit import ExplicitKernels
from .methods.methods import EXPLICIT_METHODS
from .scene import Scene
from .system import OK, State, System, held_torque

Array = NDArray[np.float64]
KICKED = ("stormer_verlet", "variational")  # steps with half a kick at both ends
GROWS = 1e-6  # tolerance above 1 of a step's largest factor: free motions have double factors of 1, accurate to √eps
HALVINGS = 40  # of the interval that holds the largest stable step


def check_smooth_friction(scene: Scene, method: str, dt: float) -> None:
    """Raise SimulationError, with the largest stable step, if smooth friction is unstable with M at the neutral q."""
    effect, model = find(scene.effects, SmoothFriction), scene.model
    if effect is None or method not in EXPLICIT_METHODS or not model.nv:
        return
    _, viscous, static, _ = effect.friction.law
    slope, Minv = static / effect.friction.smoothing + viscous, calls["minverse"](model, calls["neutral"](model))
    most = _largest_step(method, Minv, np.zeros_like(Minv), np.diag(slope), dt)
    if dt > most:
        root = np.sqrt(slope)
        k = int(np.argmax(abs(np.linalg.eigh(root[:, None] * Minv * root)[1][:, -1])))
        raise SimulationError(
            f"dt is {dt:g} s, expected at most {most:.3g} s, where {method} is stable with the smooth friction of "
            f'joint "{joint_of_velocity(model, k).name}", {slope[k]:.3g} N m s/rad at rest; a larger smoothing '
            'allows more, and friction_method="implicit" any'
        )


def check_springs(scene: Scene, method: str, q: Array, dt: float) -> None:
    """Raise SimulationError naming the stiffest spring's joint and the largest stable step, if springs are unstable
    with M at q.
    """
    model = scene.model
    if find(scene.effects, Springs) is None or method not in (*EXPLICIT_METHODS, *KICKED):
        return
    rows = np.flatnonzero(model.bodies["spring"])
    K, D = np.zeros((model.nv, model.nv)), np.zeros((model.nv, model.nv))
    for i in rows:
        b, pull = model.bodies[i], _pull(model, int(i))
        K += b["stiffness"] * np.outer(pull, pull)
        D += b["spring_damping"] * np.outer(pull, pull)
    most = _largest_step(method, np.asarray(calls["minverse"](model, q)), K, D, dt)
    if dt > most:
        M = np.asarray(calls["crba"](model, q))
        stiffest = max(rows, key=lambda i: _frequency(model, M, int(i)))
        joint = next(j.name for j in model.joints[1:] if j.row == model.bodies["spring"][stiffest])
        raise SimulationError(
            f"dt is {dt:g} s, expected at most {most:.3g} s, where {method} is stable with the spring of joint "
            f'"{joint}"'
        )


def _pull(model: Model, i: int) -> Array:
    """(nv,) by which the stretch θ/n - q of the spring of row i grows with each velocity."""
    b, pull = model.bodies[i], np.zeros(len(model.bodies) - 1)
    pull[i - 1], pull[b["spring"] - 1] = b["gear"], -1.0
    return pull if model.mimic_matrix is None else pull @ model.mimic_matrix


def _frequency(model: Model, M: Array, i: int) -> float:
    """k (1/I + 1/n²J) of the spring of row i, I and J the entries on the diagonal of M."""
    return float(model.bodies[i]["stiffness"] * (_pull(model, i) ** 2 / np.diagonal(M)).sum())


def _largest_step(method: str, Minv: Array, K: Array, D: Array, dt: float) -> float:
    """dt if a step of dt is stable, else the largest stable step."""
    low, high = 0.0, dt
    if _largest_factor(method, Minv, K, D, dt) <= 1.0 + GROWS:
        return dt
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _largest_factor(method, Minv, K, D, middle) <= 1.0 + GROWS else (low, middle)
    return low


def _largest_factor(method: str, Minv: Array, K: Array, D: Array, h: float) -> float:
    """The largest factor by which a step h multiplies a motion of v̇ = -M⁻¹ (K x + D v)."""
    step = _kicked if method in KICKED else _taken
    return float(abs(np.linalg.eigvals(step(method, -Minv @ K, -Minv @ D, h))).max())


def _taken(method: str, A: Array, B: Array, h: float) -> Array:
    """The map of (x, v) by a step of an explicit method on v̇ = A x + B v, taken from all unit states at once."""

    def kernel(value: Callable[..., Array]) -> Callable[..., int]:
        def write(table: Any, *arrays: Any) -> int:
            arrays[-1][:] = value(*arrays[:-1])
            return OK

        return write

    n, accelerate, move = len(A), kernel(lambda x, v: A @ x + B @ v), kernel(lambda x, u: x + u)
    rate, turn = kernel(lambda u, v: v), kernel(lambda steps, v, w: steps * w)
    x, v = np.eye(2 * n)[None, :n], np.eye(2 * n)[None, n:]  # one vector of matrices: methods loop over vectors
    kernels = ExplicitKernels(accelerate, None, move, rate, turn)
    system = System(kernels, held_torque, *(None,) * 7, np.zeros(3))
    EXPLICIT_METHODS[method](system, 0.0, h, State(x, v, None, np.zeros_like(x), None, np.zeros((10, *x.shape))))
    return np.vstack([x[0], v[0]])


def _kicked(method: str, A: Array, B: Array, h: float) -> Array:
    """The same of Störmer's and the variational method, whose kicks are at the mean velocity."""
    n = len(A)
    one, none = np.eye(n), np.zeros((n, n))
    half = np.linalg.solve(one - 0.5 * h * B, np.hstack([0.5 * h * A, one]))
    ahead = np.hstack([one, none]) + h * half
    return np.vstack([ahead, half + 0.5 * h * (A @ ahead + B @ half)])
