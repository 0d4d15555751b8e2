"""Loops: their assembly, their projection, and their mobility."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..algebra.scalars import EPS
from ..calls.arguments import as_array, as_items, as_number
from ..calls.dynamics import calls
from ..errors import ConstraintError, ModelError, NonFiniteError, ShapeError, literal
from ..model.model import Model
from ..waiting import watch
from .dynamics import constraint_error, constraint_jacobian, constraint_rate, response, velocity_response
from .kinds import AXES, Constraint, HingeConstraint, WeldConstraint, placed
from .table import Constraints, check_constraints

Array = NDArray[np.float64]
SWEEPS = 50  # limit of Newton's steps from a near start; three suffice
TRIALS = 500  # limit of damped steps of an assembly
DEPENDENT = 1e-9  # relative singular value below which equations count as dependent in a mobility


class Mobility(NamedTuple):
    """Number of free velocities, number of independent equations, and Grübler's count nv - nc."""

    free: int
    rank: int
    gruebler: int


@watch.call("project_configuration")
def project_configuration(model: Model, constraints: Constraints, q: ArrayLike, tolerance: float = 1e-12) -> Array:
    """The configuration near q that meets constraints: Newton's steps along M⁻¹ Jᵀ, the shortest in kinetic energy.

    model        Model
    constraints  Constraints of this model
    q            (..., nq)  joint positions, within some 1e-2 of closed [rad | m]
    tolerance    largest |φ| that counts as closed [m | rad]

    Returns q (..., nq).
    Raises  ConstraintError naming the constraint, and by how much it is open, if Newton's steps do not close it

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> held = sd.Constraints(model, [sd.CouplerConstraint("joint2", "joint1", ratio=-2.0)])
    >>> q = sd.project_configuration(model, held, [0.25, -0.49])
    >>> bool(abs(sd.constraint_error(model, held, q)).max() < 1e-12)
    True
    """
    least = _tolerance(tolerance)
    check_constraints(model, constraints)
    here = np.array(as_array("q", q))
    if not constraints.nc:
        return here
    phi = constraint_error(model, constraints, here)
    for _ in range(SWEEPS):
        if not phi.size or not (abs(phi) > least).any():  # NaN stays NaN
            break
        change = response(model, constraints, here, -phi, check=False)[0]
        if not np.isfinite(change[np.isfinite(phi).all(axis=-1)]).all():
            break
        here = calls["integrate"](model, here, change)
        phi = constraint_error(model, constraints, here)
    raise_if_open(constraints, here, phi, least, "; close_loops assembles from farther away")
    return here


def project_velocity(model: Model, constraints: Constraints, q: ArrayLike, v: ArrayLike) -> Array:
    """The velocity nearest to v, in kinetic energy, with J v = 0: v after a perfectly inelastic impact.

    model        Model
    constraints  Constraints of this model
    q            (..., nq)  joint positions [rad | m]
    v            (..., nv)  joint velocities [rad/s | m/s]

    Returns v (..., nv).
    Raises  as ``constraint_jacobian``

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> held = sd.Constraints(model, [sd.PointConstraint("tip", axes="x")])
    >>> v = sd.project_velocity(model, held, [0.5, -0.3], [1.0, 2.0])
    >>> bool(abs(sd.constraint_jacobian(model, held, [0.5, -0.3]) @ v).max() < 1e-14)
    True
    """
    v, rate = constraint_rate(model, constraints, q, v)
    change = velocity_response(model, constraints, q, v, -rate)[0]
    with np.errstate(invalid="ignore"):  # infinite ones have none nearest: NaN
        made: Array = v + change
    return made


@watch.call("close_loops")
def close_loops(
    model: Model, constraints: Constraints, q: ArrayLike, free: Iterable[str] | None = None, tolerance: float = 1e-12
) -> Array:
    """Assemble a mechanism: find a configuration that meets constraints, from a start that may be far away.

    Source: Gauss-Newton, damped after Levenberg, A method for the solution of certain non-linear problems in least
    squares (1944).

    model        Model
    constraints  Constraints of this model
    q            (nq,)  joint positions to start from [rad | m]
    free         names of the joints that may move; all if left out
    tolerance    largest |φ| that counts as closed [m | rad]

    Returns q (nq,). Of several assemblies it is one near the start.
    Raises  ConstraintError naming the constraint that stays open and by how much; another start may close it

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> held = sd.Constraints(model, [sd.PointConstraint("tip", axes="xz", at_b=(0.4, 0.0, -0.5))])
    >>> q = sd.close_loops(model, held, [0.1, 0.2])
    >>> bool(abs(sd.frame_placement(model, q, "tip")[[0, 2], 3] - [0.4, -0.5]).max() < 1e-12)
    True
    """
    least = _tolerance(tolerance)
    check_constraints(model, constraints)
    here = np.array(as_array("q", q))
    if here.shape != (model.nq,):
        raise ShapeError(f"q has shape {here.shape}, expected ({model.nq},)")
    if not np.isfinite(here).all():
        raise NonFiniteError(f"q is {here.tolist()}, expected finite numbers")
    moving = _moving(model, free)
    phi, damping = constraint_error(model, constraints, here), 1e-3
    for _ in range(TRIALS):
        if not phi.size or abs(phi).max() <= least:
            break
        J = constraint_jacobian(model, constraints, here)[:, moving]
        normal, slope = J.T @ J, J.T @ phi
        step = np.zeros(model.nv)
        largest = float(np.diag(normal).max(initial=0.0))
        step[moving] = -np.linalg.lstsq(normal + damping * largest * np.eye(moving.sum()), slope, rcond=None)[0]
        trial = calls["integrate"](model, here, step)
        left = constraint_error(model, constraints, trial)
        if left @ left < phi @ phi:
            here, phi, damping = trial, left, max(1e-15, 0.1 * damping)
        elif damping > 1e12:
            break
        else:
            damping *= 4.0
    raise_if_open(constraints, here, phi, least, "; another q to start from may close it")
    return here


def mobility(model: Model, constraints: Constraints, q: ArrayLike) -> Mobility:
    """Mobility of a mechanism at q: nv - rank J free velocities, and Grübler's count, which ignores geometry.

    model        Model
    constraints  Constraints of this model
    q            (nq,)  joint positions [rad | m]

    Returns Mobility (free, rank, gruebler). A planar loop closed by a hinge has gruebler -2 and free 1; if the rank is
    lower than nearby, q is a branch point, from which the mechanism may move in several ways.
    Raises  as ``constraint_jacobian``; NonFiniteError for a q that is not finite

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> held = sd.Constraints(model, [sd.PointConstraint("tip")])
    >>> sd.mobility(model, held, [0.5, -0.3])
    Mobility(free=0, rank=2, gruebler=-1)
    """
    rank = _rank(_scaled(model, constraints, q))
    return Mobility(model.nv - rank, rank, model.nv - constraints.nc)


def independent_joints(model: Model, constraints: Constraints, q: ArrayLike) -> tuple[int, ...]:
    """Indices of independent velocities, which determine all others under the constraints near q.

    Source: after Wehage and Haug, Generalized coordinate partitioning for dimension reduction in analysis of
    constrained dynamic systems (1982), by elimination with complete pivoting.

    model        Model
    constraints  Constraints of this model
    q            (nq,)  joint positions [rad | m]

    Returns as many indices as ``mobility`` has free velocities, in order.
    Raises  as ``constraint_jacobian``

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> held = sd.Constraints(model, [sd.PointConstraint("tip", axes="x")])
    >>> len(sd.independent_joints(model, held, [0.5, -0.3]))
    1
    """
    J = _scaled(model, constraints, q)
    rank, left = _rank(J), list(range(model.nv))
    for _ in range(rank):
        row, column = np.unravel_index(int(np.argmax(abs(J[:, left]))), (len(J), len(left)))
        at = left.pop(int(column))
        J = J - np.outer(J[:, at] / J[row, at], J[row])
        J[row] = 0.0
    return tuple(left)


# --- parts ------------------------------------------------------------------------------------------------


def raise_if_open(constraints: Constraints, q: Array, phi: Array, least: float, cure: str) -> None:
    """Raise ConstraintError for the first sample and constraint with |φ| above ``least``, or turned by half a turn.

    phi  (..., nc)
    """
    if not phi.size:
        return
    bad = np.argwhere((abs(phi) > least).any(axis=-1) | ~np.isfinite(phi).all(axis=-1) & np.isfinite(q).all(axis=-1))
    turned = [x for x in constraints if isinstance(x, (HingeConstraint, WeldConstraint))]
    if len(bad):
        index = tuple(int(k) for k in bad[0])
        where = "" if not index else f" in sample {index[0] if len(index) == 1 else index}"
        equation = constraints.equations[int(np.argmax(abs(phi[index])))]
        open_by = abs(phi[index]).max()
        amount = f"{1e3 * open_by:.4g} mm" if equation.part in AXES and equation.part else f"{open_by:.4g}"
        raise ConstraintError(f"{equation.label} is open by {amount}{where}, expected at most {least:g}{cure}")
    for x in turned:
        for index in np.ndindex(q.shape[:-1]):
            if np.isfinite(q[index]).all() and _half_turned(constraints.model, x, q[index]):
                where = "" if not index else f" in sample {index[0] if len(index) == 1 else index}"
                raise ConstraintError(f"{x.label} is closed half a turn off{where}, expected axes that agree{cure}")


def _half_turned(model: Model, x: HingeConstraint | WeldConstraint, q: Array) -> bool:
    """Whether the axes of a closed hinge, or any axis of a weld, point the wrong way."""
    A = calls["frame_placement"](model, q, x.frame_a) @ placed(x.at_a)
    B = placed(x.at_b) if x.frame_b is None else calls["frame_placement"](model, q, x.frame_b) @ placed(x.at_b)
    R = B[:3, :3].T @ A[:3, :3]
    return (
        bool(np.trace(R) < 0.0)
        if isinstance(x, WeldConstraint)
        else bool(np.array(x.axis) @ R @ np.array(x.axis) < 0.0)
    )


def _tolerance(tolerance: Any) -> float:
    number = as_number(tolerance)
    if not 0.0 < number < np.inf:
        raise ConstraintError(f"tolerance is {literal(tolerance)}, expected a finite number above 0")
    return number


def _moving(model: Model, free: Iterable[str] | None) -> NDArray[np.bool_]:
    """Which velocities are those of named joints."""
    moving = np.full(model.nv, free is None)
    for name in () if free is None else as_items("free", free, str, "names of joints"):
        joint = next((j for j in model.joints[1:] if j.name == name), None)
        if joint is None:
            raise ModelError(f'free has joint "{name}", which robot "{model.name}" does not have as a moving one')
        moving[joint.idx_v : joint.idx_v + joint.nv] = True
    return moving


def _scaled(model: Model, constraints: Constraints, q: ArrayLike) -> Array:
    """J (nc, nv) in velocities of unit kinetic energy, each constraint's rows by their largest entry."""
    J = constraint_jacobian(model, constraints, q)
    if J.ndim != 2:
        raise ShapeError(f"q has shape {np.shape(q)}, expected ({model.nq},)")
    if not np.isfinite(np.asarray(q, np.float64)).all():  # NaN has no rank
        raise NonFiniteError(f"q is {np.asarray(q).tolist()}, expected finite numbers")
    J = J / np.sqrt(np.diag(calls["crba"](model, q)))
    owners: list[Constraint] = [x.constraint for x in constraints.equations]
    for x in constraints:
        rows = [k for k, owner in enumerate(owners) if owner is x]
        J[rows] /= max(abs(J[rows]).max(initial=0.0), np.finfo(float).tiny)
    made: Array = J
    return made


def _rank(J: Array) -> int:
    singular = np.linalg.svd(J, compute_uv=False) if J.size else np.empty(0)
    return int((singular > max(DEPENDENT, max(J.shape) * EPS) * singular.max(initial=0.0)).sum())
