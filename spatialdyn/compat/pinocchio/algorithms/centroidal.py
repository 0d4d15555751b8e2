"""Masses, centres of mass, centroidal momentum under Pinocchio's names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..data.data import Data, library_of
from ..data.dispatch import compute, compute_copy, fast_call
from ..data.field_recipes import subtree_masses, world_com
from ..data.frame_arguments import frame_index, joint_index
from ..data.last_call import Run
from ..model.model import Model
from ..types.arguments import ArgumentError, ValueRuntimeError, described
from ..types.frame import ACCELERATION, KinematicLevel
from ..types.inertia import Inertia
from ..types.motion import Force

__all__ = [
    "ccrba", "centerOfMass", "computeCentroidalMap", "computeCentroidalMapTimeVariation",
    "computeCentroidalMomentum", "computeCentroidalMomentumTimeVariation", "computeSubtreeMasses",
    "computeSupportedForceByFrame", "computeSupportedInertiaByFrame", "computeTotalMass", "dccrba",
    "getJacobianSubtreeCenterOfMass", "jacobianCenterOfMass", "jacobianSubtreeCenterOfMass",
]  # fmt: skip

Array = NDArray[np.float64]


def _last(model: Model, data: Data, field: str = "oMi") -> Run:
    """The last call that filled a field. Raises ValueRuntimeError if there was none."""
    library_of(model, data)
    run: Run | None = data.latest(field)
    if run is None:
        raise ValueRuntimeError("q is not given and data was not computed, expected forwardKinematics before")
    return run


# --- masses and their centre -----------------------------------------------------------------------------


def computeTotalMass(model: Model, data: Data | None = None) -> float:
    """Mass of all moving bodies [kg], also ``data.mass[0]``; bodies on the universe do not count."""
    mass = _masses(model)
    if data is not None:
        library_of(model, data)
        data.mass[0] = mass[0]
    return float(mass[0])


def computeSubtreeMasses(model: Model, data: Data) -> None:
    """Mass of each joint's subtree: ``data.mass``."""
    library_of(model, data)
    data.put("mass", _masses(model))


def _masses(model: Model) -> Array:
    inertias = np.array([inertia._x for inertia in model.inertias]).reshape(-1, 10)
    return subtree_masses(inertias, np.array(model.parents, np.intp))


def centerOfMass(model: Model, data: Data, *given: Any, **named: Any) -> Array:
    """Centre of mass of all moving bodies (3,), also ``data.com[0]``; its velocity and acceleration in ``data``.

    ``(model, data, q[, v[, a]][, compute_subtree_coms])``; ``(model, data[, kinematic_level][, compute_subtree_coms])``
    at the inputs of the last forwardKinematics. ``data.com[k]`` is the centre of joint k's subtree, in its frame;
    vcom and acom likewise, whatever ``compute_subtree_coms``.
    """
    if not named and len(given) < 4 and {*map(type, given)} == {np.ndarray}:
        return _center(model, data, given)
    values = [*given, *(named[name] for name in ("q", "v", "a", "kinematic_level") if name in named)]
    unknown = {*named} - {"q", "v", "a", "kinematic_level", "compute_subtree_coms"}
    if unknown:
        raise ArgumentError(
            f"centerOfMass got {', '.join(sorted(unknown))}, expected q, v, a, kinematic_level or compute_subtree_coms"
        )
    if values and isinstance(values[-1], (bool, np.bool_)):
        values.pop()
    if values and isinstance(values[0], np.ndarray):
        if len(values) > 3:
            raise ArgumentError(f"centerOfMass got {len(values)} arrays, expected q, v and a at most")
        return _center(model, data, values)
    level = values[0] if values else ACCELERATION
    if len(values) > 1 or not isinstance(level, (int, KinematicLevel)):
        raise ArgumentError(f"centerOfMass got {', '.join(map(described, values))}, expected arrays or a level")
    run = _last(model, data)
    inputs = [run.q.copy()]
    if level >= 1:
        moving = data.latest("v") or run
        inputs.append(moving.v.copy())
    if level >= 2:
        inputs.append((data.latest("a") or run).a.copy())
    return _center(model, data, inputs)


def _center(model: Model, data: Data, values: Sequence[Any]) -> Array:
    found: Array = _COM[len(values) - 1](model, data, *values)
    return found


def _com0(model: Model, data: Data, q: Any) -> Array:
    return compute_copy(model, data, "com0", q)


def _com1(model: Model, data: Data, q: Any, v: Any) -> Array:
    return compute_copy(model, data, "com1", q, v)


def _com2(model: Model, data: Data, q: Any, v: Any, a: Any) -> Array:
    return compute_copy(model, data, "com2", q, v, a)


def jacobianCenterOfMass(model: Model, data: Data, q: Any = None, compute_subtree_coms: bool = True) -> Array:
    """Jacobian of the centre of mass (3, nv) in the world, also ``data.Jcom``; without q at the last call's."""
    if q is None or isinstance(q, (bool, np.bool_)):
        q = _last(model, data).q.copy()
    found: Array = _com_jacobian(model, data, q)
    return found


def _jacobianCenterOfMass(model: Model, data: Data, q: Any) -> Array:
    return compute_copy(model, data, "com_jacobian", q)


def jacobianSubtreeCenterOfMass(model: Model, data: Data, *given: Any, **named: Any) -> Array:
    """Jacobian (3, nv) of the centre of mass of a joint's subtree, in the world.

    ``(model, data, q, subtree_root_joint_id)``, or ``(model, data, subtree_root_joint_id)`` at the last call's q.
    """
    values = [*given, *(named[name] for name in ("q", "subtree_root_joint_id") if name in named)]
    if len(values) not in (1, 2):
        raise ArgumentError(f"jacobianSubtreeCenterOfMass got {len(values)} arguments, expected q and a joint")
    q = values[0] if len(values) == 2 else _last(model, data).q.copy()
    compute(model, data, "com_jacobian", q)
    return getJacobianSubtreeCenterOfMass(model, data, values[-1])


def getJacobianSubtreeCenterOfMass(model: Model, data: Data, subtree_root_joint_id: int) -> Array:
    """Jacobian (3, nv) of the centre of mass of a joint's subtree, at the q of ``data.J``.

    A joint within the subtree moves its own subtree; one that carries the root joint moves the whole of it.
    """
    root, run = joint_index(model, subtree_root_joint_id), _last(model, data, "J")
    if model.mimicking_joints:
        raise NotImplementedError("Jacobians of subtrees' centres of mass with mimic joints are not supported")
    m, c, J = subtree_masses(run.bodies, run.parents), world_com(run), data.array("J")
    out = np.zeros((3, model.nv))
    below, above = set(model.subtrees[root]) if root else set(range(1, model.njoints)), set(model.supports[root])
    for k in range(1, model.njoints):
        if k in below or k in above:
            moved = k if k in below else root
            own = slice(model.idx_vs[k], model.idx_vs[k] + model.nvs[k])
            out[:, own] = m[moved] / m[root] * (J[:3, own] + np.cross(J[3:, own].T, c[moved]).T)
    return out


# --- centroidal momentum ---------------------------------------------------------------------------------


def _ccrba(model: Model, data: Data, q: Any, v: Any) -> Array:
    """Centroidal momentum matrix Ag (6, nv), also ``data.Ag``; the momentum is ``data.hg``."""
    return compute_copy(model, data, "ccrba", q, v)


def _dccrba(model: Model, data: Data, q: Any, v: Any) -> Array:
    """Time derivative of the centroidal momentum matrix (6, nv), also ``data.dAg``."""
    return compute_copy(model, data, "dccrba", q, v)


def _computeCentroidalMap(model: Model, data: Data, q: Any) -> Array:
    """Centroidal momentum matrix Ag (6, nv), also ``data.Ag``."""
    return compute_copy(model, data, "map", q)


def _computeCentroidalMapTimeVariation(model: Model, data: Data, q: Any, v: Any) -> Array:
    """Time derivative of the centroidal momentum matrix (6, nv), also ``data.dAg``."""
    return compute_copy(model, data, "map_dot", q, v)


def computeCentroidalMomentum(model: Model, data: Data, q: Any = None, v: Any = None) -> Force:
    """Momentum about the centre of mass, also ``data.hg``; without q, v at the last call's."""
    if q is None:
        run = _last(model, data, "v")
        q, v = run.q.copy(), run.v.copy()
    return Force.over(_momentum(model, data, q, v))


def computeCentroidalMomentumTimeVariation(
    model: Model, data: Data, q: Any = None, v: Any = None, a: Any = None
) -> Force:
    """Rate of the momentum about the centre of mass, also ``data.dhg``; without q, v, a at the last call's."""
    if q is None:
        run = _last(model, data, "a")
        q, v, a = run.q.copy(), run.v.copy(), run.a.copy()
    return Force.over(_momentum_dot(model, data, q, v, a))


def _momentum0(model: Model, data: Data, q: Any, v: Any) -> Array:
    return compute_copy(model, data, "momentum", q, v)


def _momentum1(model: Model, data: Data, q: Any, v: Any, a: Any) -> Array:
    return compute_copy(model, data, "momentum_dot", q, v, a)


# --- what a frame supports -------------------------------------------------------------------------------


def _supported(model: Model, frame: int) -> Inertia:
    """Inertia of a frame and of its child frames on the same joint, in the joint's frame."""
    joint, found = model.frames[frame].parentJoint, {frame}
    for k in range(frame + 1, len(model.frames)):
        if model.frames[k].parentJoint == joint and model.frames[k].parentFrame in found:
            found.add(k)
    total: Inertia = Inertia.Zero()
    for k in found:
        total += model.frames[k].placement.act(model.frames[k].inertia)
    return total


def computeSupportedInertiaByFrame(model: Model, data: Data, frame_id: int, with_subtree: bool) -> Inertia:
    """Inertia of a frame and its child frames on its joint, in the frame; with_subtree: and of the joint's subtree.

    with_subtree needs ``data.oMi``.
    """
    library_of(model, data)
    k = frame_index(model, frame_id)
    frame, total = model.frames[k], _supported(model, k)
    if with_subtree:
        here = data.oMi[frame.parentJoint]
        for i in model.subtrees[frame.parentJoint]:
            if i != frame.parentJoint:
                total = total + here.actInv(data.oMi[i].act(model.inertias[i]))
    found: Inertia = frame.placement.actInv(total)
    return found


def computeSupportedForceByFrame(model: Model, data: Data, frame_id: int) -> Force:
    """Force that supports a frame, its child frames and the joints on its joint, in the frame.

    From ``data.a_gf``, v, f and liMi, as rnea fills them.
    """
    library_of(model, data)
    k = frame_index(model, frame_id)
    frame, total = model.frames[k], _supported(model, k)
    a, v = data.a_gf[frame.parentJoint], data.v[frame.parentJoint]
    force = total * a + v.cross(total * v)
    for child in model.children[frame.parentJoint]:
        force = force + data.liMi[child].act(data.f[child])
    found: Force = frame.placement.actInv(force)
    return found


_COM = fast_call(_com0, "com0"), fast_call(_com1, "com1"), fast_call(_com2, "com2")
_momentum, _momentum_dot = fast_call(_momentum0, "momentum"), fast_call(_momentum1, "momentum_dot")
_com_jacobian = fast_call(_jacobianCenterOfMass, "com_jacobian")
ccrba, dccrba = fast_call(_ccrba, "ccrba"), fast_call(_dccrba, "dccrba")
computeCentroidalMap = fast_call(_computeCentroidalMap, "map")
computeCentroidalMapTimeVariation = fast_call(_computeCentroidalMapTimeVariation, "map_dot")
