"""Forward dynamics and impacts under constraints: given by their Jacobian, or by a table of ``Constraints``."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.table import joint_table
from ..calls.arguments import as_array, as_number, batch_shape, broadcast
from ..calls.dynamics import calls
from ..calls.failures import raise_if_singular
from ..engines import threads
from ..engines.compiled import numba_kernels
from ..engines.compiled.table_kernels import kernel
from ..errors import ConstraintError, InertiaError, ShapeError, literal
from ..model.model import Model
from ..recursions.constraints.constrained import CHOSEN, MOTION
from ..recursions.constraints.kkt import bordered_inverse, constrained_samples
from ..recursions.spec import TAU
from ..waiting import watch
from .dynamics import ConstrainedImpact, ConstrainedMotion, constrained_impact, constrained_motion
from .kinds import Constraint
from .table import Constraints, check_constraints

Array = NDArray[np.float64]
Result = TypeVar("Result")
RANKS = (3, 3, 2, 2, 1, 2, 2, 2, 2, 2, 1)  # axes of the kernel's arrays


class Constrained(NamedTuple):
    """Accelerations a (..., nv) under constraints, and the constraint forces (..., m)."""

    a: Array
    force: Array


class Impact(NamedTuple):
    """Velocities v (..., nv) after an impact, and the constraints' impulses (..., m)."""

    v: Array
    impulse: Array


class Solved(NamedTuple):
    """x and λ of M x = r + Jᵀ λ, J x + γ = -μ λ; for the last sample also L (D on the diagonal), Y = J L⁻¹ and C."""

    x: Array
    force: Array
    L: Array
    Y: Array
    C: Array


@overload
def constrained_dynamics(
    model: Model,
    constraints: Constraints,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    stabilization: float | None = None,
    minimum_norm: bool = False,
    fext: ArrayLike | None = None,
) -> ConstrainedMotion: ...


@overload
def constrained_dynamics(
    model: Model, q: ArrayLike, v: ArrayLike, tau: ArrayLike, J: ArrayLike, drift: ArrayLike, damping: float = 0.0
) -> Constrained: ...


def constrained_dynamics(model: Model, *given: Any, **named: Any) -> Constrained | ConstrainedMotion:
    """Forward dynamics under constraints: M a + C v + g = tau + Jᵀ force and J a + J̇ v = 0.

    ``constrained_dynamics(model, constraints, q, v, tau, stabilization=None, minimum_norm=False, fext=None)`` takes a
    table of Constraints, ``constrained_dynamics(model, q, v, tau, J, drift, damping=0.0)`` any Jacobian J with
    independent rows.

    Source: after Featherstone, RBDA (2008), section 8.1, with a factor of M as sparse as the tree. Of the accelerations
    that meet the constraints, a is nearest to the unconstrained one in the metric of M (Gauss's principle).

    constraints    Constraints of this model
    q              (..., nq)     joint positions [rad | m]
    v              (..., nv)     joint velocities [rad/s | m/s]
    tau            (..., nv)     joint torques [N m | N]
    stabilization  T [s]: J a + J̇ v + 2 J v / T + φ / T² = 0, so that errors φ decay like exp(-t/T). Take T as several
                   steps of the integrator; None for J a + J̇ v = 0
    minimum_norm   if equations are dependent: True gives the force with the least sum of squares, which does not depend
                   on their order; False gives the whole force to the equations that come first
    fext           (..., njoints, 6)  force on each joint's body, in the joint's frame, linear first [N | N m]
    J              (..., m, nv)  Jacobian, such as rows of ``frame_jacobian`` at the feet
    drift          (..., m)      J̇ v (``jacobian_dot_times_v`` for feet), plus stabilization terms
    damping                      0 or more; above 0 the constraints are soft, J a + drift = -damping force, and rows
                                 of J may be dependent

    Returns ConstrainedMotion (a, force, residual, rank): (..., nv), (..., nc), and for each sample a residual and the
    number of independent equations. Equations that depend on others drop out: their force is 0, and ``residual`` is
    their violation when the others hold, relative to their terms. The last of dependent equations drop out; if a nearly
    dependent one would then remain, elimination with the largest pivots chooses the equations to keep. With J, returns
    Constrained (a, force).
    Raises
        ConstraintError naming the constraints that contradict others, and the sample; for constraints of another model;
            with J, naming the rank, if rows are dependent and there is no damping
        InertiaError for a singular M, ShapeError

    >>> import numpy as np, spatialdyn as sd
    >>> model, q, v = sd.load_urdf("two_link"), [0.5, -0.3], [1.0, 2.0]
    >>> held = sd.Constraints(model, [sd.PointConstraint("tip", axes="xz")])
    >>> a, force, residual, rank = sd.constrained_dynamics(model, held, q, v, [0.0, 0.0])
    >>> J = sd.frame_jacobian(model, q, "tip", "local_world_aligned")[[0, 2]]
    >>> drift = sd.jacobian_dot_times_v(model, q, v, "tip", "local_world_aligned")[[0, 2]]
    >>> same, _ = sd.constrained_dynamics(model, q, v, [0.0, 0.0], J, drift)
    >>> rank, bool(abs(a - same).max() < 1e-12)
    (2, True)
    """
    if _of_table(model, given, named):
        return _called("constrained_dynamics of Constraints", constrained_motion, model, given, named)
    return _called("constrained_dynamics of a Jacobian", _with_jacobian, model, given, named)


constrained_dynamics.spec = replace(  # type: ignore[attr-defined]  # for ``exact``, with equations in their order
    MOTION, inputs=tuple(None if x == CHOSEN else x for x in MOTION.inputs)
)


def _of_table(model: Model, given: tuple[Any, ...], named: dict[str, Any]) -> bool:
    """Whether a call has a table of Constraints. Raises ConstraintError for single constraints instead of a table."""
    first = given[0] if given else named.get("constraints")
    items = first if isinstance(first, (list, tuple)) else [first]
    if "constraints" in named or any(isinstance(x, (Constraint, str)) for x in items):
        check_constraints(model, first)
    return isinstance(first, Constraints)


def _called(
    what: str, function: Callable[..., Result], model: Model, given: tuple[Any, ...], named: dict[str, Any]
) -> Result:
    """A function's result. Raises TypeError, naming the public call, for arguments that the call does not take."""
    try:
        return function(model, *given, **named)
    except TypeError:
        signature = inspect.signature(function)
        try:
            signature.bind(model, *given, **named)
        except TypeError as error:
            expected = ", ".join(signature.parameters)
            raise TypeError(f"{what}: {error}, expected ({expected})") from None
        raise


def _with_jacobian(
    model: Model, q: ArrayLike, v: ArrayLike, tau: ArrayLike, J: ArrayLike, drift: ArrayLike, damping: float = 0.0
) -> Constrained:
    """``constrained_dynamics`` with a Jacobian."""
    M, bias = calls["crba"](model, q), calls["nonlinear_effects"](model, q, v)
    given, J, gamma = as_array("tau", tau), as_array("J", J), as_array("drift", drift)
    broadcast(["tau", "q and v"], [batch_shape(model, TAU, given), bias.shape[:-1]])
    solved = solve(model, M, given - bias, J, gamma, damping)
    return Constrained(solved.x, solved.force)


@overload
def impact(
    model: Model, constraints: Constraints, q: ArrayLike, v: ArrayLike, restitution: float = 0.0
) -> ConstrainedImpact: ...


@overload
def impact(
    model: Model, q: ArrayLike, v: ArrayLike, J: ArrayLike, restitution: float = 0.0, damping: float = 0.0
) -> Impact: ...


def impact(model: Model, *given: Any, **named: Any) -> Impact | ConstrainedImpact:
    """Velocities after an impact: M (v⁺ - v) = Jᵀ impulse and J v⁺ = -restitution J v - damping impulse.

    ``impact(model, constraints, q, v, restitution=0.0)`` takes Constraints, all of which act in the impact;
    ``impact(model, q, v, J, restitution=0.0, damping=0.0)`` takes the Jacobian of the points that hit.

    constraints  Constraints of this model
    q            (..., nq)     joint positions [rad | m]
    v            (..., nv)     joint velocities before the impact [rad/s | m/s]
    J            (..., m, nv)  Jacobian of the points that hit
    restitution                from 0 (perfectly inelastic) to 1 (no energy is lost)
    damping                    0 or more, as in ``constrained_dynamics``

    Returns ConstrainedImpact (v, impulse, residual, rank), as ``constrained_dynamics`` does; with J, Impact
    (v, impulse): (..., nv) and (..., m).
    Raises as ``constrained_dynamics``, and ConstraintError for a restitution that is not from 0 to 1

    >>> import spatialdyn as sd
    >>> model, q = sd.load_urdf("two_link"), [0.5, -0.3]
    >>> J = sd.frame_jacobian(model, q, "tip", "local_world_aligned")[[0, 2]]
    >>> after, impulse = sd.impact(model, q, [1.0, 2.0], J)
    >>> bool(abs(after).max() < 1e-12)
    True
    """
    if _of_table(model, given, named):
        return _called("impact of Constraints", constrained_impact, model, given, named)
    return _called("impact of a Jacobian", _impact_of_points, model, given, named)


def _impact_of_points(
    model: Model, q: ArrayLike, v: ArrayLike, J: ArrayLike, restitution: float = 0.0, damping: float = 0.0
) -> Impact:
    """``impact`` with a Jacobian."""
    elastic = as_number(restitution)
    if not 0.0 <= elastic <= 1.0:
        raise ConstraintError(f"restitution is {literal(restitution)}, expected 0 to 1")
    M, J, v = calls["crba"](model, q), as_array("J", J), as_array("v", v)
    if J.ndim < 2 or v.ndim < 1 or J.shape[-1] != v.shape[-1]:
        raise ShapeError(f"v has shape {v.shape} and J {J.shape}, expected (..., {model.nv}) and (..., m, {model.nv})")
    broadcast(["q", "v", "J"], [M.shape[:-2], v.shape[:-1], J.shape[:-2]])
    gamma = (1.0 + elastic) * (J @ v[..., None])[..., 0]
    solved = solve(model, M, np.zeros(model.nv), J, gamma, damping)
    with np.errstate(invalid="ignore"):  # for samples that are not finite
        return Impact(v + solved.x, solved.force)


def solve(model: Model, M: Array, r: Array, J: Array, gamma: Array, damping: float = 0.0) -> Solved:
    """x (..., nv) and λ (..., m) of M x = r + Jᵀ λ, J x + γ = -damping λ. Raises as ``constrained_dynamics``."""
    softness = as_number(damping)
    if not 0.0 <= softness < math.inf:
        raise ConstraintError(f"damping is {literal(damping)}, expected a finite number of 0 or more")
    n, m = model.nv, J.shape[-2] if J.ndim > 1 else 0
    cores = {"q": (M, (n, n)), "tau": (r, (n,)), "J": (J, (m, n)), "drift": (gamma, (m,))}
    for name, (x, core) in cores.items():
        if x.ndim < len(core) or x.shape[x.ndim - len(core) :] != core:
            wanted = "m, " * (name == "J") + ("m" if name == "drift" else str(n))
            raise ShapeError(f"{name} has shape {x.shape}, expected (..., {wanted})")
    leads = [x.shape[: x.ndim - len(core)] for x, core in cores.values()]
    batch = broadcast(list(cores), leads) if any(leads) else ()
    count = math.prod(batch)
    Ms, rs, Js, gammas = (_samples(x, batch, core) for x, core in cores.values())
    out, force, rank = np.empty((count, n)), np.empty((count, m)), np.empty(count)
    factors = np.empty((n, n)), np.empty((m, n)), np.empty((m, m))
    run = kernel(constrained_samples, *RANKS)
    rows, soft = joint_table(model.bodies), np.array([softness])
    table = getattr(rows, numba_kernels.TABLE)
    with watch.work(f"a batch of {count} samples"):
        for first, end in threads.slices(count, n + 1, n * n + m * (n + m)):
            given = (x[first:end] for x in (Ms, Js, rs, gammas))
            run(table, *given, soft, *factors, *(x[first:end] for x in (out, force, rank)))
    if (rank != m).any():
        _raise_rank(model, Ms, m, rank, batch)
    return Solved(out.reshape((*batch, n)), force.reshape((*batch, m)), *factors)


def inverse(model: Model, solved: Solved) -> Array:
    """Inverse (nv + m, nv + m) of [M Jᵀ; J -μ 1] for the last sample of ``solved``, from its factors."""
    m, n = solved.Y.shape
    out = np.empty((n + m, n + m))
    run, rows = kernel(bordered_inverse, 2, 2, 2, 1, 1, 1, 2), joint_table(model.bodies)
    run(
        getattr(rows, numba_kernels.TABLE),
        solved.L,
        solved.Y,
        solved.C,
        np.empty(m),
        np.empty(n),
        np.empty(m),
        out,
    )
    return out


def _samples(x: Array, batch: tuple[int, ...], core: tuple[int, ...]) -> Array:
    """An input as (samples, *core) in C order and writable; copied only if needed."""
    if x.shape == batch + core and x.flags.c_contiguous and x.flags.writeable and x.size:
        return x.reshape((-1, *core))
    whole = np.empty(batch + core)
    whole[...] = x
    return whole.reshape((-1, *core)) if whole.size else np.empty((math.prod(batch), *core))


def _raise_rank(model: Model, M: Array, m: int, rank: Array, batch: tuple[int, ...]) -> None:
    """Raise InertiaError or ConstraintError for the first sample whose rank is not m."""
    k = int(np.flatnonzero(rank != m)[0])
    where = "" if not batch else f"sample {tuple(int(i) for i in np.unravel_index(k, batch))}: "
    if rank[k] < 0:
        raise_if_singular(model, M[k])
        raise InertiaError(f'{where}the mass matrix of "{model.name}" is not positive definite')
    raise ConstraintError(
        f"{where}J has rank {int(rank[k])}, expected its {m} rows to be independent, or a larger damping"
    )
