"""``Impedance``, a law that makes a frame yield like a spring and a damper, and the damping for a given stiffness."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, as_finite, check_model, frame_row_and_placement, pose_fault
from ..errors import ModelError, NonFiniteError, ShapeError, SimulationError
from ..model.model import Frame, Model
from ..recursions.control.impedance import impedance_spec
from .laws import Law, gain_of

Array = NDArray[np.float64]
SAME = 1e-9  # relative difference of entries that must be equal


class Impedance(Law):
    """Cartesian impedance: tau = g + Jᵀ (K e - D ẋ) - b v. The frame yields like a spring and a damper in the world.

    model          Model that has the frame
    frame          a link's or joint's name
    target         (4, 4), (T, 4, 4) or (B, T, 4, 4)  pose in the world, or one for each step
    K              number, (6,) or (6, 6), above 0, linear first, in the axes of the world [N/m | N m/rad]. Rotations
                   have one stiffness for all directions: otherwise the torque has no potential
    D              number, (6,) or (6, 6), 0 or above [N s/m | N m s/rad]: ``cartesian_damping``
    velocity, acceleration  (6,) or (T, 6)  of the target: the law then adds the force Λ(q) for its acceleration
    joint_damping  b, number or (nv,), 0 or above: for motions that do not move the frame [N m s/rad | N s/m]
    held           as in ``Control``

    V = ½ (ẋ - ẋ_d)ᵀΛ(ẋ - ẋ_d) + ½ eᵀK e, with the changing Λ(q), falls without contact; the robot is passive towards
    contacts. Do not use the law near a half turn from the target, or if J loses rank in motion.
    Raises  ModelError, SimulationError naming the eigenvalue, ShapeError, NonFiniteError
    Source  Hogan, Impedance control: an approach to manipulation (1985); Ott, Cartesian impedance control (2008).

    >>> import numpy as np, spatialdyn as sd
    >>> model, q = sd.load_urdf("ur5"), [0.1, -1.0, 1.2, 0.3, 0.5, 0.2]
    >>> there = sd.frame_placement(model, q, "tool0")
    >>> law = sd.Impedance(model, "tool0", there, [400.0] * 3 + [20.0] * 3, 40.0)
    >>> bool(np.allclose(law(model, 0.0, q, np.zeros(6)), sd.generalized_gravity(model, q)))
    True
    """

    def __init__(
        self, model: Model, frame: str | Frame, target: ArrayLike, K: ArrayLike, D: ArrayLike, *,
        velocity: ArrayLike | None = None, acceleration: ArrayLike | None = None, joint_damping: ArrayLike = 0.0,
        held: bool | float = False,
    ) -> None:  # fmt: skip
        """See the class."""
        self.model, self.frame = check_model(model), model.frame(frame)
        row, placement = frame_row_and_placement(model, frame)
        if row == 0:
            raise ModelError(f'frame "{self.frame.name}" does not move, expected one of a body')
        stiffness, damping = _six("K", K, 0.0), _six("D", D, None)
        turn = stiffness[3:, 3:]
        if abs(stiffness[:3, 3:]).max() > 0.0 or abs(turn - turn[0, 0] * np.eye(3)).max() > SAME * abs(turn).max():
            raise SimulationError(
                f"K has the rows of rotations {stiffness[3:].tolist()}, expected one number times 1 and no coupling"
            )
        joints = gain_of("joint_damping", joint_damping, model.nv, None)
        if joints.shape != (model.nv,):
            raise ShapeError(f"joint_damping has shape {joints.shape}, expected a number or ({model.nv},)")
        values: dict[str, Any] = {
            "stiffness": stiffness, "damping": damping, "joint_damping": joints, "frame_in_body": np.array(placement),
            "target": _target(target), "row": row,
        }  # fmt: skip
        moving = velocity is not None or acceleration is not None
        if moving:
            for name, x in (("v_x", velocity), ("a_x", acceleration)):
                values[name] = (
                    np.zeros(6) if x is None else as_finite("velocity" if name == "v_x" else "acceleration", x)
                )
                if values[name].shape[-1:] != (6,):
                    word = "velocity" if name == "v_x" else "acceleration"
                    raise ShapeError(f"{word} has shape {values[name].shape}, expected (6,), (T, 6) or (B, T, 6)")
        super().__init__(impedance_spec(moving), {}, values, held)
        self.checks = (self._check,)

    def _check(self, model: Model) -> None:
        """Raise ModelError if the robot lacks the frame or has it elsewhere; masses and gravity do not matter."""
        if model is self.model:
            return
        name = f"{self.frame.kind}:{self.frame.name}"
        (row, placement), mine = (frame_row_and_placement(x, name) for x in (model, self.model))
        if model.nq != self.model.nq or row != mine[0] or (placement != mine[1]).any():
            raise ModelError(
                f'frame "{self.frame.name}" of robot "{model.name}" is on another body, or elsewhere on it, than in '
                f'"{self.model.name}", of which the law holds it'
            )


def cartesian_damping(Lambda: ArrayLike, K: ArrayLike, zeta: ArrayLike = 0.7) -> Array:
    """The damping D that gives each mode of a mass Λ on springs K the ratio ζ exactly, by double diagonalization.

    Lambda  (..., m, m)  operational-space inertia, as from ``operational_space``, positive definite
    K       (..., m, m) or (m,)  stiffness, positive definite
    zeta    number or (m,), 0 or above: damping ratios of the modes, the slowest first

    With K Q = Λ Q Ω² and QᵀΛ Q = 1, D = Q⁻ᵀ 2 ζ Ω Q⁻¹. If Λ(q) changes much, compute D again; 2 ζ √K would ignore Λ.
    Raises  ShapeError; SimulationError for a matrix that is not symmetric, or naming an eigenvalue that is not above 0

    >>> import numpy as np, spatialdyn as sd
    >>> sd.cartesian_damping(np.diag([1.0, 4.0]), [100.0, 100.0], 0.5).round(9).tolist()
    [[10.0, 0.0], [0.0, 20.0]]
    """
    mass, springs = as_finite("Lambda", Lambda), as_finite("K", K)
    if springs.ndim == 1:
        springs = np.diag(springs)
    for name, x in (("Lambda", mass), ("K", springs)):
        if x.ndim < 2 or x.shape[-1] != x.shape[-2] or x.shape[-1] != mass.shape[-1]:
            raise ShapeError(f"{name} has shape {x.shape}, expected (..., m, m) of one m")
        off = abs(x - np.swapaxes(x, -1, -2)).max(initial=0.0)
        if off > SAME * abs(x).max(initial=0.0):
            raise SimulationError(f"{name} is not symmetric, by up to {off:.6g}, expected a symmetric matrix")
        low = float(np.linalg.eigvalsh(x).min(initial=np.inf))
        if not low > 0.0:
            raise SimulationError(f"{name} has the eigenvalue {low:.6g}, expected above 0")
    ratio = as_array("zeta", zeta)
    if ratio.shape not in ((), (mass.shape[-1],)) or not ((ratio >= 0.0) & np.isfinite(ratio)).all():
        raise SimulationError(f"zeta is {ratio.tolist()}, expected a number or ({mass.shape[-1]},) of 0 or more")
    L = np.linalg.cholesky(mass)
    back = np.linalg.inv(L)
    w, U = np.linalg.eigh(back @ springs @ np.swapaxes(back, -1, -2))
    Q_inv = np.swapaxes(L @ U, -1, -2)  # Q = L⁻ᵀ U, so that QᵀΛ Q = 1
    found: Array = np.swapaxes(Q_inv, -1, -2) @ ((2.0 * ratio * np.sqrt(w))[..., None] * Q_inv)
    return found


def _six(name: str, value: ArrayLike, least: float | None) -> Array:
    """A matrix (6, 6). Raises SimulationError naming the eigenvalue, ShapeError."""
    x = gain_of(name, value, 6, least)
    if x.shape not in ((6,), (6, 6)):
        raise ShapeError(f"{name} has shape {x.shape}, expected a number, (6,) or (6, 6)")
    return np.diag(x) if x.ndim == 1 else x


def _target(target: Any) -> Array:
    """Poses (..., 4, 4). Raises ShapeError, NonFiniteError, SimulationError."""
    X = as_array("target", target)
    if X.shape[-2:] != (4, 4) or X.ndim > 4:
        raise ShapeError(f"target has shape {X.shape}, expected (4, 4), (T, 4, 4) or (B, T, 4, 4)")
    if not np.isfinite(X).all():
        raise NonFiniteError("target has numbers that are not finite, expected poses")
    if fault := pose_fault(X):
        raise SimulationError(f"target has {fault}")
    return X
