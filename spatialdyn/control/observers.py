"""Observers: the torque of contacts from motor torques and motion, and the velocity of a base from its momentum."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..algebra.scalars import EPS
from ..calls.arguments import as_array, as_finite, as_flag, as_number, broadcast, check_model, within_range
from ..calls.dynamics import calls, checked_call
from ..engines.compiled.numba_kernels import user_kernel
from ..errors import ConstraintError, ModelError, ShapeError, SpatialDynError, literal
from ..model.model import Model
from ..recursions.control.observer import OBSERVER
from ..recursions.momenta.base_velocity import BASE, BASE_VELOCITY

Array = NDArray[np.float64]


class MomentumObserver:
    """The torque on each joint that motors, gravity and inertia do not explain: contacts, without force sensors.

    model  Model without mimic joints
    gain   K, above 0, a number or (nv,) [1/s]: the residual follows the torque like 1 - exp(-K t)
    dt     time between updates [s]

    ``update(q, v, tau)`` returns the residual (..., nv) [N m | N], with the axes of samples of its arguments, which
    must be the same in all updates. The residual follows the external torque as a first-order filter,
    ṙ = K (τ_ext - r), to order 2 in dt, in every joint, also of floating bases. All torques that are neither in tau nor
    in the model appear in the residual: subtract friction and motors' losses from tau.
    ``momentum_observer_step`` is one step as a function; ``kernel`` is for loops in ``@njit``, and
    ``sd.specialize(model, sd.momentum_observer_step).c_code()`` is C code.

    Raises  SpatialDynError for a gain or dt that is not above 0, ModelError for joints that mimic others
    Source  De Luca and Mattone, Sensorless robot collision detection and hybrid force/motion control (2005).

    >>> import numpy as np, spatialdyn as sd
    >>> model, q = sd.load_urdf("two_link"), np.array([0.3, 0.4])
    >>> observer = sd.MomentumObserver(model, 50.0, 1e-3)
    >>> hold = sd.generalized_gravity(model, q)
    >>> for _ in range(400):  # at rest though the motors pull with 1 N m more: something holds the first joint
    ...     r = observer.update(q, [0.0, 0.0], hold + [1.0, 0.0])
    >>> r.round(3).tolist()
    [-1.0, 0.0]
    """

    def __init__(self, model: Model, gain: ArrayLike, dt: float) -> None:
        """See the class."""
        self.model = _plain(check_model(model), "MomentumObserver")
        K = as_array("gain", gain)
        if K.shape not in ((), (model.nv,)):
            raise ShapeError(f"gain has shape {K.shape}, expected a number or ({model.nv},)")
        if not ((K > 0.0) & np.isfinite(K)).all():
            raise SpatialDynError(f"gain is {K.tolist()}, expected finite numbers above 0")
        step = as_number(dt)
        if not 0.0 < step < math.inf:
            raise SpatialDynError(f"dt is {literal(dt)}, expected a finite number above 0")
        self.gain: Array = np.broadcast_to(K, (model.nv,)).copy()
        self.dt = step
        self.memory: Array | None = None

    def __repr__(self) -> str:
        return f"<MomentumObserver of {self.model.name}: gain {self.gain.tolist()} 1/s, dt {self.dt:g} s>"

    def reset(self) -> None:
        """Forget all updates: the next update counts as the first."""
        self.memory = None

    def update(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> Array:
        """The residual (..., nv) at a state q (..., nq), v (..., nv) whose motors give tau (..., nv).

        The first update assumes no contact: its residual is 0. Raises ShapeError, also for other axes of samples than
        before, and NonFiniteError; an error leaves the observer unchanged.
        """
        n = self.model.nv
        given = as_finite("q", q), as_finite("v", v), as_finite("tau", tau)
        if self.memory is None:
            p = np.asarray(calls["momentum"](self.model, *given[:2]))
            rate = np.asarray(calls["momentum_rate"](self.model, *given))
            batch = np.broadcast_shapes(p.shape, rate.shape)
            self.memory = np.concatenate([np.broadcast_to(x, batch) for x in (p, rate, np.zeros(n))], -1)
        else:
            batch = broadcast(["q", "v", "tau"], [x.shape[:-1] for x in given])
            if batch != self.memory.shape[:-1]:
                raise ShapeError(
                    f"q, v and tau have axes of samples {batch}, expected those of the updates before, "
                    f"{self.memory.shape[:-1]}: reset() begins anew"
                )
            self.memory = momentum_observer_step(self.model, *given, self.gain, self.dt, self.memory)
        return self.memory[..., 2 * n :].copy()

    @staticmethod
    def kernel() -> Callable[..., Any]:
        """``f(model.bodies, q, v, tau, gain, dt, memory, after)`` for loops in ``@njit``, like those of ``sd.kernels``.
        All arguments but dt are arrays; it writes the memory z, β, r (3 nv,) after a step to ``after``. At the
        beginning z is ``momentum``, β is ``momentum_rate`` and r is 0.
        """
        return _kernel()


def momentum_observer_step(
    model: Model, q: ArrayLike, v: ArrayLike, tau: ArrayLike, gain: ArrayLike, dt: ArrayLike, memory: ArrayLike
) -> Array:
    """The memory (..., 3 nv) of a momentum observer after a step: p₀ + ∫(β + r) dt, the rate β and the residual r.

    q, v, tau  (..., nq), (..., nv), (..., nv)  at the end of the step
    gain       (..., nv) [1/s]
    dt         the step [s]
    memory     (..., 3 nv)  before the step

    Raises  ShapeError; ModelError for joints that mimic others

    >>> import numpy as np, spatialdyn as sd
    >>> model = sd.load_urdf("pendulum")
    >>> sd.momentum_observer_step(model, [0.0], [0.0], [0.0], [10.0], 1e-3, np.zeros(3)).shape
    (3,)
    """
    _plain(check_model(model), "momentum_observer_step")
    return checked_call(OBSERVER, model, (q, v, tau, gain, dt, memory), (), None)  # type: ignore[no-any-return]


momentum_observer_step.spec = OBSERVER  # type: ignore[attr-defined]  # for ``specialize`` and ``exact``


@cache
def _kernel() -> Callable[..., Any]:
    return user_kernel(OBSERVER)


def _plain(model: Model, what: str) -> Model:
    if model.mimic_matrix is not None:
        raise ModelError(f'robot "{model.name}" has joints that mimic others, expected none for {what}')
    return model


def detection_thresholds(residuals: ArrayLike, sigmas: float = 6.0) -> Array:
    """Thresholds (nv,) of a residual: |mean| + sigmas times the standard deviation in motions without contact.

    residuals  (..., N, nv)  from motions without contact, with the friction and model errors to expect

    Raises ShapeError, SpatialDynError

    >>> import numpy as np, spatialdyn as sd
    >>> noise = np.random.default_rng(0).normal(size=(10000, 2)) * [0.1, 0.2]
    >>> sd.detection_thresholds(noise).round(1).tolist()
    [0.6, 1.2]
    """
    x = as_finite("residuals", residuals)
    if x.ndim < 2 or x.shape[-2] < 2:
        raise ShapeError(f"residuals has shape {x.shape}, expected (..., N, nv) with N of 2 or more")
    k = as_number(sigmas)
    if not 0.0 < k < math.inf:
        raise SpatialDynError(f"sigmas is {literal(sigmas)}, expected a finite number above 0")
    flat = x.reshape(-1, x.shape[-1])
    found: Array = abs(flat.mean(0)) + k * flat.std(0)
    return found


class ContactWrench(NamedTuple):
    """A wrench on a frame.

    wrench   (..., 6)  force and torque at the frame's origin, in its axes [N | N m]: among all that give the residual,
             the least one in the norm that ``length`` weights
    rank     (...)     how many of its six directions the joint torques determine
    missing  (..., 6, 6)  rows: directions that the joint torques do not determine; the other rows are 0
    error    (..., nv) torques that no wrench on this frame explains [N m | N]
    """

    wrench: Array
    rank: NDArray[np.intp]
    missing: Array
    error: Array


def contact_wrench(
    model: Model, q: ArrayLike, residual: ArrayLike, frame: str, *, least: bool = False, length: float = 0.3
) -> ContactWrench:
    """The wrench F on a frame that explains a residual r of ``MomentumObserver``: Jᵀ F = r.

    q         (..., nq), residual (..., nv)
    least     whether to return the least such wrench if the joint torques do not determine all of it
    length    [m]  weights moments against forces for ``least``

    Raises  ConstraintError, naming the joints, if they determine fewer than six directions and ``least`` is False;
            ModelError, ShapeError

    >>> import numpy as np, spatialdyn as sd
    >>> model, q = sd.load_urdf("ur5"), [0.1, -1.0, 1.2, 0.3, 0.5, 0.2]
    >>> push = np.array([5.0, 0.0, -2.0, 0.1, 0.0, 0.0])
    >>> r = sd.frame_jacobian(model, q, "tool0").T @ push
    >>> bool(np.allclose(sd.contact_wrench(model, q, r, "tool0").wrench, push))
    True
    """
    J = np.asarray(calls["frame_jacobian"](model, q, frame))
    r = as_array("residual", residual)
    if r.shape[-1:] != (model.nv,):
        raise ShapeError(f"residual has shape {r.shape}, expected (..., {model.nv})")
    broadcast(["q", "residual"], [J.shape[:-2], r.shape[:-1]])
    size = as_number(length)
    if not 0.0 < size < math.inf:
        raise SpatialDynError(f"length is {literal(length)}, expected a finite number above 0")
    scale = np.array([1.0, 1.0, 1.0, size, size, size])
    with np.errstate(over="ignore"):
        scaled = J / scale[:, None]
    within_range("a Jacobian divided by length", scaled[np.isfinite(J).all((-2, -1))])
    unknown = ~np.isfinite(scaled).all((-2, -1))  # samples with NaN have no decomposition
    U, s, Vt = np.linalg.svd(np.where(unknown[..., None, None], 0.0, scaled), full_matrices=True)  # of scaled wrenches
    k = min(6, model.nv)
    told = s > max(6, model.nv) * EPS**0.5 * s[..., :1]
    rank = told.sum(-1)
    if not as_flag("least", least) and (rank < 6).any():
        at = np.unravel_index(int(np.argmin(rank)), rank.shape)
        blind = U[at][:, int(rank[at]) :].T / scale
        what = "; ".join(str((x / abs(x).max()).round(3).tolist()) for x in blind)
        raise ConstraintError(
            f'the joints upstream of "{frame}" determine {int(rank[at])} of 6 directions of a wrench, '
            f"expected 6: they miss {what} (force, torque in its axes); least=True gives the least wrench"
        )
    way = np.einsum("...ij,...j->...i", Vt, r)[..., :k]
    gains = np.where(told, way / np.where(told, s, 1.0), 0.0)
    wrench = np.einsum("...ij,...j->...i", U[..., :k], gains) / scale
    full = np.concatenate([told, np.zeros((*told.shape[:-1], 6 - k), np.bool_)], -1)
    missing = np.where(full[..., None], 0.0, np.swapaxes(U, -1, -2))
    error = r - np.einsum("...ij,...i->...j", J, wrench)
    return ContactWrench(wrench, rank, missing, error)


def base_velocity(model: Model, q: ArrayLike, v_joints: ArrayLike, momentum: ArrayLike) -> Array:
    """Velocity v_b of a floating base at joint velocities and a momentum of the whole robot: M_bb⁻¹ (h - M_bj q̇_j).

    q         (..., nq) [rad | m]
    v_joints  (..., nv - 6)  velocities of the joints [rad/s | m/s]
    momentum  (..., 6)  linear, and angular about the centre of mass, in the world, as from ``centroidal_momentum``;
              constant if no forces act [kg m/s | kg m²/s]

    Returns v_b (..., 6), linear first, in the base's own frame.
    Raises  ModelError for a robot without a floating base, or with joints that mimic others; ShapeError
    Source  after Featherstone, RBDA (2008), tables 5.1 and 6.2.

    >>> import numpy as np, spatialdyn as sd
    >>> solid = (1.0, (0.1, 0.0, 0.0), 0.1 * np.eye(3))
    >>> b = sd.ModelBuilder("satellite", "world").add_body("bus", None, "floating", inertia=solid)
    >>> model = b.add_body("arm", "bus", axis=(0, 0, 1), placement=(0.5, 0, 0), inertia=solid).build()
    >>> q = sd.neutral(model)
    >>> v = np.append(sd.base_velocity(model, q, [1.0], np.zeros(6)), 1.0)
    >>> bool(abs(sd.centroidal_momentum(model, q, v)).max() < 1e-15)
    True
    """
    model = _plain(check_model(model), "base_velocity")
    base = model.joints[1] if model.njoints > 1 else None
    if base is None or base.kind != "floating" or any(int(b["parent"]) == 0 for b in model.bodies[2:]):
        raise ModelError(f'robot "{model.name}" has no floating base that carries all of it, expected one')
    joints = as_array("v_joints", v_joints)
    if joints.shape[-1:] != (model.nv - BASE,):
        raise ShapeError(f"v_joints has shape {joints.shape}, expected (..., {model.nv - BASE})")
    v = np.concatenate([np.zeros((*joints.shape[:-1], BASE)), joints], -1)
    return checked_call(BASE_VELOCITY, model, (q, v, momentum), (), None)  # type: ignore[no-any-return]
