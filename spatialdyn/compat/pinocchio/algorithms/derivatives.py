"""Derivatives of torques, accelerations, motions and momenta under Pinocchio's names.

∂/∂q is along ``integrate(q, e_k)``. Results are tuples of new arrays.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....calls import dynamics
from ....calls.arguments import core_shape
from ....engines.compiled import numba_kernels
from ....errors import SpatialDynError
from ....recursions import SPECS
from ....recursions.spec import LOCAL_WORLD_ALIGNED as ALIGNED
from ....recursions.spec import WORLD as IN_WORLD
from ..data.data import Data, library_of
from ..data.dispatch import compute, compute_copy, fast_call
from ..data.frame_arguments import IDENTITY, frame_argument, index_argument, joint_index, reference_code
from ..data.last_call import Run
from ..model.model import Model
from ..types.arguments import ArgumentError, ValueRuntimeError, expected
from ..types.se3 import SE3
from .jacobians import _single

__all__ = [
    "computeABADerivatives", "computeCentroidalDynamicsDerivatives", "computeForwardKinematicsDerivatives",
    "computeGeneralizedGravityDerivatives", "computeRNEADerivatives", "computeStaticTorqueDerivatives",
    "getCenterOfMassVelocityDerivatives", "getCentroidalDynamicsDerivatives", "getFrameAccelerationDerivatives",
    "getFrameVelocityDerivatives", "getJointAccelerationDerivatives", "getJointVelocityDerivatives",
    "getPointClassicAccelerationDerivatives", "getPointVelocityDerivatives",
]  # fmt: skip

Array = NDArray[np.float64]
_dynamics: Any = dynamics  # Any: its stub names the public calls alone

# --- torques and accelerations -----------------------------------------------------------------------------


def computeRNEADerivatives(
    model: Model, data: Data, q: Any, v: Any, a: Any, fext: Any = None
) -> tuple[Array, Array, Array]:
    """∂tau/∂q, ∂tau/∂v and ∂tau/∂a = M, (nv, nv) each, also ``data.dtau_dq``, ``data.dtau_dv`` and ``data.M``.

    q     (nq,)            joint positions
    v, a  (nv,)            joint velocities and accelerations
    fext  list of njoints  Force on each joint's body, fixed in the joint's frame

    Raises ArgumentError (a TypeError) for a wrong type, ShapeError (a ValueError) for a wrong size.
    """
    by_q, by_v, M = _rnea_derivatives(model, data, q, v, a, fext)
    return by_q, by_v, M


def _computeRNEADerivatives(model: Model, data: Data, q: Any, v: Any, a: Any, fext: Any = None) -> Array:
    return compute_copy(model, data, "rnea_derivatives", q, v, a, fext=fext)


def computeABADerivatives(model: Model, data: Data, *given: Any, **named: Any) -> tuple[Array, Array, Array]:
    """∂ddq/∂q, ∂ddq/∂v and ∂ddq/∂tau = M⁻¹, (nv, nv) each, also ``data.ddq_dq``, ``data.ddq_dv`` and ``data.Minv``.

    ``(model, data, q, v, tau[, fext])``, or ``(model, data[, fext])`` at the inputs of the last ``aba``.

    Raises as computeRNEADerivatives, and InertiaError naming a joint with zero articulated inertia.
    """
    values = [*given, *(named.pop(name) for name in ("q", "v", "tau", "fext") if name in named)]
    if named or len(values) not in (0, 1, 3, 4):
        raise ArgumentError(f"computeABADerivatives got {len(values)} arguments, expected q, v, tau and fext")
    if len(values) < 3:
        library_of(model, data)
        run: Any = _last(data, "aba", "aba_world")
        if run is None:
            raise ArgumentError("q is not given and aba was not called with this data, expected either")
        if run.fext is not None and not values:
            raise ArgumentError("fext is not given and the last aba had some, expected them here too")
        values = [run.q.copy(), run.v.copy(), run.tau.copy(), *values]
    by_q, by_v, Minv = _aba_derivatives(model, data, *values)
    return by_q, by_v, Minv


def _computeABADerivatives(model: Model, data: Data, q: Any, v: Any, tau: Any, fext: Any = None) -> Array:
    return compute_copy(model, data, "aba_derivatives", q, v, tau, fext=fext)


def _computeGeneralizedGravityDerivatives(model: Model, data: Data, q: Any) -> Array:
    """∂g/∂q (nv, nv) of the gravity torques."""
    return compute_copy(model, data, "gravity_derivatives", q)


def computeStaticTorqueDerivatives(model: Model, data: Data, q: Any, fext: Any) -> Array:
    """∂tau/∂q (nv, nv) of the static torques g(q) - Σ Jᵀ fext; fext as in computeRNEADerivatives."""
    if fext is None:
        raise ArgumentError("fext is None, expected a list of Force")
    return compute_copy(model, data, "static_derivatives", q, fext=fext)


def _last(data: Data, *kinds: str) -> Run | None:
    """The latest call of these kinds, if any."""
    runs: list[Run] = [run for kind in kinds if (run := data._runs.get(kind)) is not None and run.stamp]
    return max(runs, key=lambda run: run.stamp, default=None)


# --- frames ------------------------------------------------------------------------------------------------


def computeForwardKinematicsDerivatives(model: Model, data: Data, q: Any, v: Any, a: Any = None) -> None:
    """Record q, v and a for the derivatives of velocities and, with a, of accelerations below."""
    if a is None:
        _kinematics1(model, data, q, v)
    else:
        _kinematics2(model, data, q, v, a)


def _velocities(model: Model, data: Data, q: Any, v: Any) -> None:
    compute(model, data, "kinematics_derivatives1", q, v)


def _accelerations(model: Model, data: Data, q: Any, v: Any, a: Any) -> None:
    compute(model, data, "kinematics_derivatives2", q, v, a)


def _kinematics(model: Model, data: Data, accelerations: bool = False) -> Run:
    """The last call whose inputs derivatives of frames take. Raises ValueRuntimeError if there was none."""
    library_of(model, data)
    kinds = ("kinematics_derivatives2", "rnea_derivatives", "centroidal_derivatives")
    run = _last(data, *kinds, *([] if accelerations else ["kinematics_derivatives1"]))
    if run is None:
        raise ValueRuntimeError(
            "derivatives were not computed, expected computeForwardKinematicsDerivatives"
            + (" with accelerations" if accelerations else "")
            + " to be called before"
        )
    return run


def _call_about_frame(name: str, run: Run, row: int, placement: Array, *static: int) -> Array:
    """A call of the library about a frame at the inputs of a run: by its table kernel, or in full with mimic joints."""
    spec, model = SPECS[name], run.library.model
    values = [getattr(run, x.name) for x in spec.present if not x.static]
    if model.mimic_matrix is None:
        out = np.empty(core_shape(model, spec.output))
        if not _single(name)(getattr(model, numba_kernels.TABLE), *values, row, placement, *static, out):
            return out
    found: Array = _dynamics.checked_call(spec, model, values, (row, placement, *static), None, by_table=True)
    return found


def _frame_derivatives(name: str, run: Run, joint: int, placement: Array, code: int, *static: int) -> Array:
    """Derivatives of the motion of a frame on a joint; in LOCAL_WORLD_ALIGNED as Pinocchio defines them.

    There they are those in WORLD, translated to the frame's origin as a fixed point.
    """
    row = int(run.library.rows[joint])
    if code != ALIGNED:
        return _call_about_frame(name, run, row, placement, code, *static)
    found = _call_about_frame(name, run, row, placement, IN_WORLD, *static)
    x = _call_about_frame("frame_placement", run, row, placement)[:3, 3]
    found[:, :3] += np.cross(found[:, 3:], x, axisa=1, axisc=1)
    return found


def _velocity(run: Run, joint: int, placement: Array, reference_frame: Any) -> tuple[Array, Array]:
    by_q, J = _frame_derivatives("frame_velocity_derivatives", run, joint, placement, reference_code(reference_frame))
    return by_q, J


def _acceleration(run: Run, joint: int, placement: Array, reference_frame: Any) -> tuple[Array, Array, Array, Array]:
    by_q, by_v, J = _frame_derivatives(
        "frame_acceleration_derivatives", run, joint, placement, reference_code(reference_frame), 0
    )
    return _velocity(run, joint, placement, reference_frame)[0], by_q, by_v, J


def getJointVelocityDerivatives(model: Model, data: Data, joint_id: int, reference_frame: Any) -> tuple[Array, Array]:
    """∂V/∂q and ∂V/∂v, (6, nv) each, of a joint's frame; needs computeForwardKinematicsDerivatives.

    In LOCAL_WORLD_ALIGNED ∂V/∂q is, as in Pinocchio, that of the velocity at the frame's origin as a fixed point.
    """
    run = _kinematics(model, data)
    return _velocity(run, joint_index(model, joint_id), IDENTITY, reference_frame)


def getJointAccelerationDerivatives(
    model: Model, data: Data, joint_id: int, reference_frame: Any
) -> tuple[Array, Array, Array, Array]:
    """∂V/∂q, ∂A/∂q, ∂A/∂v and ∂A/∂a, (6, nv) each, of the spatial acceleration A of a joint's frame.

    It needs computeForwardKinematicsDerivatives with a; see getJointVelocityDerivatives.
    """
    run = _kinematics(model, data, True)
    return _acceleration(run, joint_index(model, joint_id), IDENTITY, reference_frame)


def getFrameVelocityDerivatives(model: Model, data: Data, *frame: Any, **named: Any) -> tuple[Array, Array]:
    """∂V/∂q and ∂V/∂v of a frame: ``(model, data, frame_id, reference_frame)`` or ``(model, data, joint_id, placement,
    reference_frame)``; see getJointVelocityDerivatives.
    """
    return _velocity(_kinematics(model, data), *_frame(model, frame, named))


def getFrameAccelerationDerivatives(
    model: Model, data: Data, *frame: Any, **named: Any
) -> tuple[Array, Array, Array, Array]:
    """∂V/∂q, ∂A/∂q, ∂A/∂v and ∂A/∂a of a frame, arguments as of getFrameVelocityDerivatives."""
    return _acceleration(_kinematics(model, data, True), *_frame(model, frame, named))


def _frame(model: Model, frame: tuple[Any, ...], named: dict[str, Any]) -> tuple[int, Array, Any]:
    return frame_argument(model, *index_argument(frame, named), {"reference_frame": None, **named})


def getPointVelocityDerivatives(
    model: Model, data: Data, joint_id: int, placement: Any, reference_frame: Any
) -> tuple[Array, Array]:
    """∂v/∂q and ∂v/∂v, (3, nv) each, of the velocity of a point fixed to a joint; LOCAL or LOCAL_WORLD_ALIGNED."""
    run = _kinematics(model, data)
    place = _point(model, run, joint_id, placement, reference_frame)
    by_q, J = _call_about_frame("frame_velocity_derivatives", run, *place)
    return by_q[:3].copy(), J[:3].copy()


def getPointClassicAccelerationDerivatives(
    model: Model, data: Data, joint_id: int, placement: Any, reference_frame: Any
) -> tuple[Array, Array, Array, Array]:
    """∂v/∂q, ∂a/∂q, ∂a/∂v and ∂a/∂a, (3, nv) each, of the acceleration a of a point fixed to a joint."""
    by_q, _ = getPointVelocityDerivatives(model, data, joint_id, placement, reference_frame)
    run = _kinematics(model, data, True)
    place = _point(model, run, joint_id, placement, reference_frame)
    classical = _call_about_frame("frame_acceleration_derivatives", run, *place, 1)
    return by_q, classical[0, :3].copy(), classical[1, :3].copy(), classical[2, :3].copy()


def _point(model: Model, run: Run, joint_id: Any, placement: Any, reference_frame: Any) -> tuple[int, Array, int]:
    """Row of the table, placement and reference code of a point."""
    joint, place = joint_index(model, joint_id), expected(placement, SE3, "placement")._x
    code = reference_code(reference_frame)
    if code == IN_WORLD:
        raise SpatialDynError("reference frame is WORLD, expected LOCAL or LOCAL_WORLD_ALIGNED")
    return int(run.library.rows[joint]), place, code


# --- the robot as a whole ----------------------------------------------------------------------------------


def computeCentroidalDynamicsDerivatives(
    model: Model, data: Data, q: Any, v: Any, a: Any
) -> tuple[Array, Array, Array, Array]:
    """∂h/∂q, ∂(dh/dt)/∂q, ∂(dh/dt)/∂v and ∂(dh/dt)/∂a = Ag, (6, nv) each, of the centroidal momentum h."""
    by_q, rate_by_q, rate_by_v, Ag = _centroidal_derivatives(model, data, q, v, a)
    return by_q, rate_by_q, rate_by_v, Ag


def _computeCentroidalDynamicsDerivatives(model: Model, data: Data, q: Any, v: Any, a: Any) -> Array:
    return compute_copy(model, data, "centroidal_derivatives", q, v, a)


def getCentroidalDynamicsDerivatives(model: Model, data: Data) -> tuple[Array, Array, Array, Array]:
    """``computeCentroidalDynamicsDerivatives`` at the inputs of the last computeRNEADerivatives."""
    library_of(model, data)
    run = _last(data, "rnea_derivatives", "centroidal_derivatives")
    if run is None:
        raise ValueRuntimeError("derivatives were not computed, expected computeRNEADerivatives to be called before")
    return computeCentroidalDynamicsDerivatives(model, data, run.q.copy(), run.v.copy(), run.a.copy())


def getCenterOfMassVelocityDerivatives(model: Model, data: Data) -> Array:
    """∂vcom/∂q (3, nv) at the inputs of the last call that filled ``data.vcom``."""
    library_of(model, data)
    run: Run | None = data.latest("vcom")
    if run is None:
        raise ValueRuntimeError("data.vcom was not computed, expected centerOfMass with q and v to be called before")
    found = dynamics.table_call("center_of_mass_velocity_derivatives", run.library.model, run.q, run.v)
    return np.array(found[0])


_kinematics1 = fast_call(_velocities, "kinematics_derivatives1")
_kinematics2 = fast_call(_accelerations, "kinematics_derivatives2")
_rnea_derivatives = fast_call(_computeRNEADerivatives, "rnea_derivatives", parameters=", fext=None")
_aba_derivatives = fast_call(_computeABADerivatives, "aba_derivatives", parameters=", fext=None")
_centroidal_derivatives = fast_call(_computeCentroidalDynamicsDerivatives, "centroidal_derivatives")
computeGeneralizedGravityDerivatives = fast_call(_computeGeneralizedGravityDerivatives, "gravity_derivatives")
