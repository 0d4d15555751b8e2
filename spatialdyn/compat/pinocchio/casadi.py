"""``pinocchio.casadi``: the names that clients use, as expressions of CasADi, by programs of ``spatialdyn.specialize``.

Expressions are SX or MX; numbers of a Model are constants. Derivatives are by entries of q: step quaternions and
pairs by ``integrate``.
"""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace
from typing import Any

from ...calls import dynamics
from ...calls.exported import derivatives_of, exported
from ...calls.specialize_request import read_request
from ...calls.specialized import recorded
from ...interop.casadi import to_casadi
from ...interop.frameworks import framework
from . import liegroups as _groups
from .casadi_values import SE3, Force, Motion, exp3, exp3_quat, exp6, log3, log6, log6_quat, matrix
from .model.constraints import ContactType, ProximalSettings
from .model.library_model import library_model
from .types.arguments import all_expected, expected
from .types.frame import LOCAL, LOCAL_WORLD_ALIGNED, WORLD, ReferenceFrame

__all__ = [
    "LOCAL", "LOCAL_WORLD_ALIGNED", "SE3", "WORLD", "ContactType", "Data", "Force", "Model", "Motion",
    "ProximalSettings", "ReferenceFrame", "RigidConstraintModel", "StdVec_Force", "aba", "centerOfMass",
    "computeABADerivatives", "computeAllTerms", "computeCoriolisMatrix", "computeFrameJacobian",
    "computeGeneralizedGravity", "computeJointJacobians", "computeKineticEnergy", "computeMechanicalEnergy",
    "computeMinverse", "computePotentialEnergy", "computeRNEADerivatives", "constraintDynamics", "crba",
    "difference", "exp3", "exp3_quat", "exp6", "forwardDynamics", "forwardKinematics", "framesForwardKinematics",
    "getFrameAcceleration", "getFrameClassicalAcceleration", "getFrameJacobian", "getFrameVelocity",
    "initConstraintDynamics", "integrate", "jacobianCenterOfMass", "liegroups", "log3", "log6", "log6_quat", "nle",
    "nonLinearEffects", "rnea", "updateFramePlacements",
]  # fmt: skip


class Data(SimpleNamespace):
    """Results as expressions: what a call of the same name writes to Pinocchio's Data."""


class Model:
    """A copy of a Model, whose numbers become constants: ``Model(model)``. Its attributes are the model's."""

    def __init__(self, model: Any) -> None:
        self._model = model.copy()

    def __getattr__(self, name: str) -> Any:
        return getattr(vars(self).get("_model"), name)

    createData = staticmethod(Data)


class StdVec_Force(list):  # type: ignore[type-arg]
    """A list of Force."""


@lru_cache(maxsize=64)
def _function(model: Any, call: str, forces: bool, jacobian: bool) -> Any:
    """A call as a function of CasADi: its program is recorded, and not compiled, which takes twice as long."""
    given = "fext" if forces else ()
    request = read_request(model, getattr(dynamics, call), float, {}, given, None, None, "local", False, None)
    made = exported(request, recorded(request, request.options._replace(straight=True)), "c")
    return to_casadi(made, derivatives_of(request, made) if jacobian else None)


def _value(model: Model, call: str, *inputs: Any, forces: bool = False) -> Any:
    """A call on expressions; those of MX are one node with the library's own Jacobian, which others do not need."""
    casadi, given = framework("casadi"), [matrix(x) for x in inputs]
    jacobian = any(isinstance(x, casadi.MX) for x in given)
    return _function(library_model(model._model).model, call, forces, jacobian)(*given)


def _call(call: str, field: str = "") -> Any:
    """A function ``(model, data, ...)`` that also writes a field of data; without a field it takes no data."""

    def function(model: Model, *arguments: Any) -> Any:
        found = _value(model, call, *arguments[bool(field) :])
        if field:
            setattr(arguments[0], field, found)
        return found

    function.__doc__ = f"``spatialdyn.{call}`` as an expression{', also data.' * bool(field)}{field}."
    return function


def _with_forces(call: str, field: str) -> Any:
    def function(model: Model, data: Data, q: Any, v: Any, x: Any, fext: Any = None) -> Any:
        if fext is None or not len(fext):
            found = _value(model, call, q, v, x)
        else:
            given = [x.vector.T for x in all_expected(fext, Force, "fext")]
            found = _value(model, call, q, v, x, framework("casadi").vertcat(*given), forces=True)
        setattr(data, field, found)
        return found

    function.__doc__ = f"``spatialdyn.{call}`` as an expression, also data.{field}; fext a list of Force, if given."
    return function


rnea, aba = _with_forces("rnea", "tau"), _with_forces("aba", "ddq")
crba, computeCoriolisMatrix = _call("crba", "M"), _call("coriolis_matrix", "C")
computeMinverse, computeGeneralizedGravity = _call("minverse", "Minv"), _call("generalized_gravity", "g")
nonLinearEffects, integrate, difference = _call("nonlinear_effects", "nle"), _call("integrate"), _call("difference")
nle = nonLinearEffects
jacobianCenterOfMass = _call("com_jacobian", "Jcom")
computeKineticEnergy = _call("kinetic_energy", "kinetic_energy")
computePotentialEnergy = _call("potential_energy", "potential_energy")


def computeMechanicalEnergy(model: Model, data: Data, q: Any, v: Any) -> Any:
    """Kinetic plus potential energy, all three also in data."""
    data.mechanical_energy = computeKineticEnergy(model, data, q, v) + computePotentialEnergy(model, data, q)
    return data.mechanical_energy


def _parts(x: Any, n: int) -> tuple[Any, ...]:
    """The matrices (n, n) that lie in rows of a result."""
    return tuple(x[k, :].reshape((n, n)).T for k in range(x.shape[0]))


def computeRNEADerivatives(model: Model, data: Data, q: Any, v: Any, a: Any) -> tuple[Any, ...]:
    """∂τ by q, along ``integrate``, v and a; also ``data.dtau_dq``, ``data.dtau_dv``, ``data.M``."""
    found = _parts(_value(model, "rnea_derivatives", q, v, a), model.nv)
    data.dtau_dq, data.dtau_dv, data.M = found
    return found


def computeABADerivatives(model: Model, data: Data, q: Any, v: Any, tau: Any) -> tuple[Any, ...]:
    """∂a by q, along ``integrate``, v and τ; also ``data.ddq_dq``, ``data.ddq_dv``, ``data.Minv``."""
    found = _parts(_value(model, "aba_derivatives", q, v, tau), model.nv)
    data.ddq_dq, data.ddq_dv, data.Minv = found
    return found


# --- kinematics --------------------------------------------------------------------------------------------


def forwardKinematics(model: Model, data: Data, q: Any, v: Any = None, a: Any = None) -> None:
    """Write the poses of the joints ``data.oMi``; with v their velocities ``data.v``, with a ``data.a``."""
    joints = [int(k) for k in library_model(model._model).joint_map]
    rows = _value(model, "forward_kinematics", q)
    data.oMi = [SE3(rows[k, :].reshape((4, 4)).T) for k in joints]
    for field, call, given in (("v", "joint_velocities", (q, v)), ("a", "joint_accelerations", (q, v, a))):
        if given[-1] is not None:
            rows = _value(model, call, *given)
            setattr(data, field, [Motion(rows[k, :].T) for k in joints])


def updateFramePlacements(model: Model, data: Data) -> None:
    """Write the poses of the frames ``data.oMf``, from ``data.oMi``."""
    data.oMf = [data.oMi[x.parentJoint] * SE3(x.placement) for x in model.frames]


def framesForwardKinematics(model: Model, data: Data, q: Any) -> None:
    """``forwardKinematics``, and ``data.oMf``, the poses of the frames."""
    forwardKinematics(model, data, q)
    updateFramePlacements(model, data)


def _in_reference(model: Model, data: Data, frame_id: int, m: Motion, reference: ReferenceFrame) -> Motion:
    """A motion of a frame's joint, in the joint's frame, in a reference at the frame."""
    frame = model.frames[frame_id]
    X = data.oMi[frame.parentJoint]
    if expected(reference, ReferenceFrame, "reference_frame") == WORLD:
        return X.act(m)  # type: ignore[no-any-return]
    here = SE3(frame.placement).actInv(m)
    turn = SE3((X * SE3(frame.placement)).rotation, [0.0, 0.0, 0.0])
    return here if reference == LOCAL else turn.act(here)  # type: ignore[no-any-return]


def getFrameVelocity(model: Model, data: Data, frame_id: int, reference_frame: Any = LOCAL) -> Motion:
    """Velocity of a frame, from ``data.v``."""
    return _in_reference(model, data, frame_id, data.v[model.frames[frame_id].parentJoint], reference_frame)


def getFrameAcceleration(model: Model, data: Data, frame_id: int, reference_frame: Any = LOCAL) -> Motion:
    """Spatial acceleration of a frame, from ``data.a``."""
    return _in_reference(model, data, frame_id, data.a[model.frames[frame_id].parentJoint], reference_frame)


def getFrameClassicalAcceleration(model: Model, data: Data, frame_id: int, reference_frame: Any = LOCAL) -> Motion:
    """Classical acceleration of a frame, from ``data.v`` and ``data.a``."""
    v, a = (get(model, data, frame_id, reference_frame) for get in (getFrameVelocity, getFrameAcceleration))
    return Motion(a.linear + framework("casadi").cross(v.angular, v.linear), a.angular)


def computeJointJacobians(model: Model, data: Data, q: Any) -> Any:
    """Jacobians of all joints in the world (6, nv), also ``data.J``; writes ``data.oMi``."""
    forwardKinematics(model, data, q)
    data.J = _value(model, "joint_jacobians", q)
    return data.J


def getFrameJacobian(model: Model, data: Data, frame_id: int, reference_frame: Any) -> Any:
    """Jacobian (6, nv) of a frame, from ``data.J`` and ``data.oMi``."""
    frame = model.frames[frame_id]
    expected(reference_frame, ReferenceFrame, "reference_frame")
    return _jacobian_at(model, data, frame.parentJoint, frame.placement, reference_frame)


def _jacobian_at(model: Model, data: Data, joint: int, placement: Any, reference: ReferenceFrame) -> Any:
    """Jacobian (6, nv) of a frame on a joint."""
    casadi = framework("casadi")
    carries = casadi.DM.zeros(6, model.nv)
    for k in model.supports[joint]:
        carries[:, model.idx_vs[k] : model.idx_vs[k] + model.nvs[k]] = 1.0
    J, X = data.J * carries, data.oMi[joint] * SE3(placement)
    if reference == WORLD:
        return J
    return (X.inverse() if reference == LOCAL else SE3(casadi.DM.eye(3), -X.translation)).action @ J


def computeFrameJacobian(model: Model, data: Data, q: Any, frame_id: int, reference_frame: Any = LOCAL) -> Any:
    """Jacobian (6, nv) of a frame at q."""
    computeJointJacobians(model, data, q)
    return getFrameJacobian(model, data, frame_id, reference_frame)


def centerOfMass(model: Model, data: Data, q: Any, v: Any = None, a: Any = None) -> Any:
    """Centre of mass (3,), also ``data.com[0]``; with v and a ``data.vcom[0]`` and ``data.acom[0]``."""
    forwardKinematics(model, data, q, v, a)
    data.com = [_value(model, "center_of_mass", q)]
    if v is not None:
        data.vcom = [_value(model, "center_of_mass_velocity", q, v)]
    if a is not None:
        data.acom = [_value(model, "center_of_mass_acceleration", q, v, a)]
    return data.com[0]


def computeAllTerms(model: Model, data: Data, q: Any, v: Any) -> None:
    """Write M, nle, g, J, Ag, hg, com, vcom, Jcom, oMi, v and the energies to data."""
    centerOfMass(model, data, q, v)
    computeJointJacobians(model, data, q)
    forwardKinematics(model, data, q, v)
    for call in (crba, computeGeneralizedGravity, jacobianCenterOfMass):
        call(model, data, q)
    nonLinearEffects(model, data, q, v)
    computeMechanicalEnergy(model, data, q, v)
    data.Ag, data.hg = _value(model, "centroidal_map", q), Force(_value(model, "centroidal_momentum", q, v))


# --- constraints -------------------------------------------------------------------------------------------


def forwardDynamics(
    model: Model, data: Data, q: Any, v: Any, tau: Any, constraint_jacobian: Any, constraint_drift: Any,
    damping: float = 0.0,
) -> Any:  # fmt: skip
    """Accelerations a (nv,): M a + b = τ + Jᵀ λ and J a + γ = -damping λ; also ``data.ddq`` and ``data.lambda_c``."""
    casadi, J = framework("casadi"), matrix(constraint_jacobian)
    crba(model, data, q)
    nonLinearEffects(model, data, q, v)
    K = casadi.vertcat(casadi.horzcat(data.M, J.T), casadi.horzcat(J, -damping * casadi.DM.eye(J.shape[0])))
    x = casadi.solve(K, casadi.vertcat(matrix(tau) - data.nle, -matrix(constraint_drift)))
    data.ddq, data.lambda_c = x[: model.nv], -x[model.nv :]
    return data.ddq


class RigidConstraintModel:
    """A contact of a frame on a joint with the world: ``(contact_type, model, joint1_id, joint1_placement
    [, reference_frame])``; the gains of errors are zero.
    """

    def __init__(self, contact_type: Any, model: Model, joint1_id: int, placement: Any, reference: Any = LOCAL) -> None:
        self.type, self.joint1_id = expected(contact_type, ContactType, "contact_type"), int(joint1_id)
        self.joint1_placement, self.reference_frame = placement, expected(reference, ReferenceFrame, "reference_frame")
        self.name = ""

    def residualSize(self) -> int:
        """Number of constraints: 3 or 6."""
        return 3 if self.type == ContactType.CONTACT_3D else 6

    createData = staticmethod(Data)


def initConstraintDynamics(model: Model, data: Data, contact_models: Any, contact_datas: Any = None) -> None:
    """Check a list of RigidConstraintModel; nothing has to be prepared here."""
    all_expected(contact_models, RigidConstraintModel, "contacts")


def constraintDynamics(
    model: Model, data: Data, q: Any, v: Any, tau: Any, contact_models: Any, contact_datas: Any = None,
    settings: ProximalSettings | None = None,
) -> Any:  # fmt: skip
    """Accelerations (nv,) under contacts, damped by the mu of ``settings``; also ``data.ddq``, ``data.lambda_c``."""
    casadi, blocks, drifts = framework("casadi"), [], []
    forwardKinematics(model, data, q, v, casadi.DM.zeros(model.nv, 1))
    computeJointJacobians(model, data, q)
    motions = _value(model, "joint_velocities", q, v), _value(model, "joint_accelerations", q, v, [0.0] * model.nv)
    joints = library_model(model._model).joint_map
    for x in all_expected(contact_models, RigidConstraintModel, "contacts"):
        place, k = SE3(x.joint1_placement), int(joints[x.joint1_id])
        aligned = x.reference_frame == LOCAL_WORLD_ALIGNED
        J = _jacobian_at(model, data, x.joint1_id, place, LOCAL_WORLD_ALIGNED if aligned else LOCAL)
        velocity, acceleration = (place.actInv(Motion(rows[k, :].T)) for rows in motions)
        drift = acceleration.vector
        if x.residualSize() == 3:
            drift = acceleration.linear + casadi.cross(velocity.angular, velocity.linear)
        if aligned:
            turn = (data.oMi[x.joint1_id] * place).rotation
            drift = casadi.diagcat(*[turn] * (x.residualSize() // 3)) @ drift
        blocks.append(J[: x.residualSize(), :])
        drifts.append(drift)
    mu = 0.0 if settings is None else settings.mu
    return forwardDynamics(model, data, q, v, tau, casadi.vertcat(*blocks), casadi.vertcat(*drifts), mu)


# --- Lie groups --------------------------------------------------------------------------------------------


class _Group:
    """A Lie group: ``integrate(q, v)`` and ``difference(q0, q1)`` of expressions."""

    def __init__(self, group: Any) -> None:
        self.name, self.nq, self.nv, self._model = group.name, group.nq, group.nv, Model(group._model)

    def integrate(self, q: Any, v: Any) -> Any:
        """q moved by v."""
        return integrate(self._model, q, v)

    def difference(self, q0: Any, q1: Any) -> Any:
        """What takes q0 to q1."""
        return difference(self._model, q0, q1)


class liegroups:
    """The groups of ``pinocchio.liegroups`` on expressions."""

    R1, R2, R3, SO2, SO3, SE2, SE3 = (
        staticmethod(lambda name=name: _Group(getattr(_groups, name)()))
        for name in ("R1", "R2", "R3", "SO2", "SO3", "SE2", "SE3")
    )
