"""Adaptive laws: ``SlotineLi`` and ``NaturalAdaptation`` follow a path while they learn masses and inertias."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..actuation.friction import Friction, check_friction
from ..calls.arguments import as_array, as_number, check_model, within_range
from ..calls.dynamics import calls
from ..errors import InertiaError, ModelError, NonFiniteError, ShapeError, SimulationError, literal
from ..model.model import Model
from ..recursions.control.adaptive_specs import adaptive_spec
from .laws import Law, _is_matrix, _reference, gain_of
from .paths import Path

Array = NDArray[np.float64]
ROUNDED = 1e-9  # relative to the largest column of Y: rounded right angles in a file make zero columns this large
EXCITED = 1e-6  # relative to the largest eigenvalue of ∫ Yᵀ Y, scaled to a unit diagonal: smaller ones are not excited


class ExcitationRecord(NamedTuple):
    """How a motion excites the parameters that a law learns, from ∫ Yᵀ Y dt with each column scaled to 1.

    rank         number of combinations of parameters that act on the torques: only these can be learnt
    parameters   number of parameters to learn
    condition    largest over least eigenvalue of these combinations: how unevenly they are learnt
    eigenvalues  (parameters,) in falling order
    """

    rank: int
    parameters: int
    condition: float
    eigenvalues: Array


class Adaptive(Law):
    """The common part of both laws."""

    smooth = False

    def __init__(
        self, natural: bool, model: Model, rates: ArrayLike, gain: ArrayLike, path: Path | ArrayLike,
        own: dict[str, Array], deadzone: float, composite: float, bandwidth: float, friction: Friction | None,
        friction_gain: ArrayLike, held: bool | float,
    ) -> None:  # fmt: skip
        """Set the inputs ``own`` of one law, and the inputs that both have."""
        self.model = model
        if model.mimic_matrix is not None:
            raise ModelError(f'robot "{model.name}" has joints that mimic others, expected none for adaptive laws')
        if model.bodies["geared"].any() or model.bodies["coupled"].any():
            raise ModelError(f'robot "{model.name}" has rotors on moving links or differentials, expected none')
        reference, _ = _reference(path)
        one, two = gain_of("rates", rates, model.nv), gain_of("gain", gain, model.nv)
        zone = as_number(deadzone)
        if not 0.0 <= zone < math.inf:
            raise SimulationError(f"deadzone is {literal(deadzone)}, expected 0 or more [rad/s]")
        values = {"rates": one, "gain": two, **own, "deadzone": np.array([zone])}
        weight, width = as_number(composite), as_number(bandwidth)
        if not 0.0 <= weight < math.inf:
            raise SimulationError(f"composite is {literal(composite)}, expected 0 or more")
        if not 0.0 < width < math.inf:
            raise SimulationError(f"bandwidth is {literal(bandwidth)}, expected a finite number above 0 [1/s]")
        self._predicts = weight > 0.0
        if self._predicts:
            values |= {"composite": np.array([weight]), "bandwidth": np.array([width])}
        if friction is not None:
            values |= _friction(model, friction, friction_gain)
        self.friction = friction is not None
        core = adaptive_spec(natural, _is_matrix(one), _is_matrix(two), self.friction, self._predicts)
        super().__init__(core, values, reference, held)
        self.checks = (*self.checks, self._check)

    def _check(self, model: Model) -> None:
        """Raise ModelError for a model with other joints."""
        if model.nv != self.model.nv or model.njoints != self.model.njoints:
            raise ModelError(
                f'robot "{model.name}" has {model.njoints} joints and {model.nv} freedoms, expected those of '
                f'"{self.model.name}", {self.model.njoints} and {self.model.nv}, whose parameters the law learns'
            )

    def estimates(self, run: Any) -> Array:
        """The estimated inertial parameters (..., njoints, 10) at the times of a Trajectory or Rollout."""
        raise NotImplementedError

    def frictions(self, run: Any) -> Array:
        """Estimates (..., 2, nv) of dry friction and damping. Raises SimulationError if the law learns no friction."""
        if not self.friction:
            raise SimulationError("the law learns no friction, expected one with friction=")
        found: Array = self.values["friction"] + _state_of(run, "worn")
        return found

    def excitation(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> ExcitationRecord:
        """How a motion q (N, nq), v, a (N, nv) excites the parameters to learn. Tracking needs no excitation, but only
        excited combinations converge.
        """
        Y = np.asarray(calls["modified_torque_regressor"](self.model, q, v, v, a))
        chosen = np.broadcast_to(self._learnt(), Y.shape[-2:]).ravel()
        W = Y.reshape(-1, chosen.size)[:, chosen]
        size = np.linalg.norm(W, axis=0)
        felt = size > ROUNDED * size.max(initial=0.0)
        W = np.where(felt, W / np.where(felt, size, 1.0), 0.0)
        w = np.sort(np.linalg.eigvalsh(W.T @ W))[::-1].clip(0.0)
        seen = w > EXCITED * max(w.max(initial=0.0), np.finfo(float).tiny)
        rank = int(seen.sum())
        return ExcitationRecord(rank, int(chosen.sum()), float(w[0] / w[rank - 1]) if rank else math.inf, w)

    def _learnt(self) -> Any:
        """Which of the parameters (njoints, 10) are learnt."""
        raise NotImplementedError


class SlotineLi(Adaptive):
    """Adaptive control: tau = M̂ a_r + Ĉ v_r + ĝ - K s with estimates that learn by π̂⁺ = π̂ - h Γ Yᵀ s.

    model          Model of the joints; its own masses do not count
    rates, gain    Λ [1/s] and K [N m s/rad | N s/m], as of ``Passivity``
    path           Path, or positions to hold (nq,)
    parameters     (njoints, 10)  first estimates, in the order of ``inertial_parameters``
    Gamma          number or (njoints, 10), 0 or more: how fast each is learnt; 0 keeps it
    bounds         (least, most), each (njoints, 10): the estimates stay between
    deadzone       |s| up to which the law does not learn [rad/s]: it would take errors from noise and friction for mass
    composite      c, 0 or more: learns also from the error of predicted torques, by y = Yᵀ s + c Wᵀ e, so estimates
                   continue to improve when tracking is already good. h c Γ |W|² must stay below 2. The torque that acts
                   must be that of the law: no limits, no other law, and only the friction that the law compensates
    bandwidth      [1/s] of the filters that give W and e without accelerations
    friction       Friction, first estimates of coulomb and viscous, with smoothing: the law learns and compensates them
    friction_gain  number or (2, nv): how fast friction is learnt
    held           as in ``Control``; estimates change from step to step

    V = ½ sᵀM s + ½ π̃ᵀΓ⁻¹π̃ falls along motions: V̇ = -sᵀK s, because Ṁ - 2C is skew. The path is tracked with any
    estimates; they converge to the true parameters only if the motion excites them: ``excitation``. Estimates may
    become unphysical, with a negative mass; those of ``NaturalAdaptation`` never do.
    Raises  SimulationError, ShapeError, ModelError
    Source  Slotine and Li, On the adaptive control of robot manipulators (1987); Composite adaptive control of robot
            manipulators (1989).

    >>> import numpy as np, spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> guess = 0.5 * sd.inertial_parameters(model)
    >>> law = sd.SlotineLi(model, 5.0, 10.0, sd.quintic([0.0, 0.0], [1.0, 0.5], 1.0), guess, 0.5)
    >>> run = sd.simulate(model, [0.0, 0.0], [0.0, 0.0], 2.0, 2e-3, control=law)
    >>> law.estimates(run).shape
    (1001, 3, 10)
    """

    def __init__(
        self, model: Model, rates: ArrayLike, gain: ArrayLike, path: Path | ArrayLike, parameters: ArrayLike,
        Gamma: ArrayLike, *, bounds: Sequence[ArrayLike] | None = None, deadzone: float = 0.0,
        composite: float = 0.0, bandwidth: float = 10.0, friction: Friction | None = None,
        friction_gain: ArrayLike = 1.0, held: bool | float = True,
    ) -> None:  # fmt: skip
        """See the class."""
        check_model(model)
        first = _table(model, "parameters", parameters)
        step = _table(model, "Gamma", Gamma, spread=True)
        if (step < 0.0).any():
            raise SimulationError(f"Gamma has {step.min():.6g}, expected 0 or more")
        least, most = np.full_like(first, -1e300), np.full_like(first, 1e300)
        if bounds is not None:
            if not isinstance(bounds, Sequence) or len(bounds) != 2:
                raise SimulationError(f"bounds is {literal(bounds)}, expected (least, most)")
            least, most = (_table(model, "bounds", x, spread=True, finite=False) for x in bounds)
            out = (first < least) | (first > most)
            if out.any():
                j, k = np.argwhere(out)[0]
                raise SimulationError(
                    f'parameter {k} of joint "{model.names[j]}" is {first[j, k]:.6g}, expected between bounds '
                    f"{least[j, k]:.6g} and {most[j, k]:.6g}"
                )
        own = {"first": first, "step": step, "least": least, "most": most}
        super().__init__(
            False, model, rates, gain, path, own, deadzone, composite, bandwidth, friction, friction_gain, held
        )

    def estimates(self, run: Any) -> Array:
        """See ``Adaptive``."""
        found: Array = self.values["first"] + _state_of(run, "learnt")
        return found

    def _learnt(self) -> Any:
        return self.values["step"] > 0.0


class NaturalAdaptation(Adaptive):
    """Adaptive control as ``SlotineLi``; estimates stay physical for any step: P̂⁺ = G exp(-h/γ GᵀLG) Gᵀ.

    P̂ = G Gᵀ is the pseudo-inertia of a body, positive definite exactly if a body with this mass, centre of mass and
    inertia exists. The distance that γ weights does not depend on units or frames, so one number serves all bodies.

    model          Model of the joints; its own masses do not count
    rates, gain    as in ``SlotineLi``
    path           Path, or positions to hold (nq,)
    parameters     (njoints, 10)  first estimates; bodies to learn must have a volume: no point masses, rods or discs
    gamma          number or (njoints,), above 0: a small one learns fast; inf keeps the estimate of a body, as is
                   necessary for a body without mass
    deadzone, composite, bandwidth, friction, friction_gain, held  as in ``SlotineLi``

    If h/γ GᵀLG is larger than 1, it is reduced to 1: with such a small γ P̂ would become singular at once.
    Raises  InertiaError naming the joint whose body has no volume; SimulationError, ShapeError, ModelError
    Source  Lee, Kwon and Park, A natural adaptive control law for robot manipulators (2018).

    >>> import numpy as np, spatialdyn as sd
    >>> b = sd.ModelBuilder("rod").add_body("rod", None, "revolute", (0, 1, 0), inertia=(1.0, (0.3, 0, 0), np.eye(3)))
    >>> model = b.build()
    >>> law = sd.NaturalAdaptation(model, 5.0, 4.0, [0.8], 0.5 * sd.inertial_parameters(model), 10.0)
    >>> run = sd.simulate(model, [0.0], [0.0], 1.0, 2e-3, control=law)
    >>> bool((law.estimates(run)[:, 1, 0] > 0).all())
    True
    """

    def __init__(
        self, model: Model, rates: ArrayLike, gain: ArrayLike, path: Path | ArrayLike, parameters: ArrayLike,
        gamma: ArrayLike, *, deadzone: float = 0.0, composite: float = 0.0, bandwidth: float = 10.0,
        friction: Friction | None = None, friction_gain: ArrayLike = 1.0, held: bool | float = True,
    ) -> None:  # fmt: skip
        """See the class."""
        check_model(model)
        given = as_array("gamma", gamma)
        if given.shape not in ((), (model.njoints,)):
            raise ShapeError(f"gamma has shape {given.shape}, expected a number or ({model.njoints},)")
        if not (given > 0.0).all():
            raise SimulationError(f"gamma is {given.tolist()}, expected numbers above 0")
        with np.errstate(over="ignore"):
            step = np.broadcast_to(1.0 / given, (model.njoints,)).copy()
        within_range("1 / gamma", step)
        step[0] = 0.0
        own = {"first": _factors(model, _table(model, "parameters", parameters), step > 0.0), "step": step}
        super().__init__(
            True, model, rates, gain, path, own, deadzone, composite, bandwidth, friction, friction_gain, held
        )

    def estimates(self, run: Any) -> Array:
        """See ``Adaptive``."""
        G = self.values["first"] + _state_of(run, "learnt")
        return parameters_of(G @ np.swapaxes(G, -1, -2))

    def pseudo_inertias(self, run: Any) -> Array:
        """P̂ (..., njoints, 4, 4) of a Trajectory or Rollout at its times, row 0 zero."""
        G = self.values["first"] + _state_of(run, "learnt")
        found: Array = G @ np.swapaxes(G, -1, -2)
        return found

    def _learnt(self) -> Any:
        return self.values["step"][:, None] > 0.0


def _state_of(run: Any, name: str) -> Array:
    states: Any = getattr(run, "states", None)
    if not isinstance(states, Mapping):
        raise SimulationError(f"run is {literal(run)}, expected a Trajectory or Rollout of this law")
    if name not in states:
        raise SimulationError(f"run has states {', '.join(states) or 'none'}, expected one of this law, with {name}")
    return np.asarray(states[name])


def _table(model: Model, name: str, value: ArrayLike, spread: bool = False, finite: bool = True) -> Array:
    """Numbers (njoints, 10), row 0 zero; with ``spread`` also from one number. Raises ShapeError, NonFiniteError."""
    x = as_array(name, value)
    shape = (model.njoints, 10)
    if x.shape != shape and not (spread and x.ndim == 0):
        raise ShapeError(f"{name} has shape {x.shape}, expected {'a number or ' if spread else ''}{shape}")
    if np.isnan(x).any() or (finite and not np.isfinite(x).all()):
        raise NonFiniteError(f"{name} has numbers that are not finite, expected finite ones")
    found = np.broadcast_to(x, shape).clip(-1e300, 1e300)
    if not spread:
        found[0] = 0.0
    return found


def _friction(model: Model, friction: Any, gain: ArrayLike) -> dict[str, Array]:
    """The inputs for learning friction. Raises ModelError, ShapeError, SimulationError."""
    given = check_friction(model, friction)
    if given.smoothing is None:
        raise ModelError("friction has no smoothing, expected one: the law's sign is tanh(v/ε)")
    n = model.nv
    step = as_array("friction_gain", gain)
    if step.shape not in ((), (2, n)):
        raise ShapeError(f"friction_gain has shape {step.shape}, expected a number or (2, {n})")
    if not ((step >= 0.0) & np.isfinite(step)).all():
        raise SimulationError(f"friction_gain is {step.tolist()}, expected finite numbers of 0 or more")
    return {
        "smoothing": np.array(given.smoothing), "friction": np.stack([given.coulomb, given.viscous]),
        "friction_step": np.broadcast_to(step, (2, n)).copy(),
    }  # fmt: skip


def pseudo_inertia(pi: Array) -> Array:
    """P (..., 4, 4) = [Σ h; hᵀ m] of parameters (..., 10)."""
    P = np.zeros((*pi.shape[:-1], 4, 4))
    xx, xy, yy, xz, yz, zz = (pi[..., k] for k in range(4, 10))
    half = 0.5 * (xx + yy + zz)
    for k, I in enumerate((xx, yy, zz)):
        P[..., k, k] = half - I
        P[..., k, 3] = P[..., 3, k] = pi[..., 1 + k]
    for (i, j), I in (((0, 1), xy), ((0, 2), xz), ((1, 2), yz)):
        P[..., i, j] = P[..., j, i] = -I
    P[..., 3, 3] = pi[..., 0]
    return P


def parameters_of(P: Array) -> Array:
    """π (..., 10) of pseudo-inertias (..., 4, 4)."""
    xx, yy, zz = P[..., 0, 0], P[..., 1, 1], P[..., 2, 2]
    rotational = (yy + zz, -P[..., 0, 1], zz + xx, -P[..., 0, 2], -P[..., 1, 2], xx + yy)
    return np.stack([P[..., 3, 3], P[..., 0, 3], P[..., 1, 3], P[..., 2, 3], *rotational], -1)


def _factors(model: Model, parameters: Array, learnt: NDArray[np.bool_]) -> Array:
    """Factors (njoints, 4, 4) of pseudo-inertias, row 0 zero. Raises InertiaError naming the joint."""
    G = np.zeros((model.njoints, 4, 4))
    for j, P in enumerate(pseudo_inertia(parameters)):
        if j == 0:
            continue
        w, U = np.linalg.eigh(P)
        if not learnt[j] and w[0] >= -1e-12 * abs(w).max():  # a rod or a massless body, which is not learnt
            G[j] = U * np.sqrt(w.clip(0.0))
            continue
        if not w[0] > 1e-12 * w[-1] or not w[-1] > 0.0:
            raise InertiaError(
                f'body of joint "{model.names[j]}" has a pseudo-inertia with the eigenvalue {w[0]:.3g}, largest '
                f"{w[-1]:.3g}, expected all above 0: those of a mass with volume"
            )
        G[j] = np.linalg.cholesky(P)
    return G
