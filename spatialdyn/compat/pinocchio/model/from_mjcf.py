"""Models from MJCF: ``buildModelFromMJCF``, through MuJoCo's compiled model.

Joints and frames have the names and the order of Pinocchio's reader; numbers are MuJoCo's, where Pinocchio's reader
leaves out the places of joints in their bodies, gravity, bodies beside the first and others without a name.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ....errors import ModelError, SpatialDynError
from ....model.joint_rows import joint_transform
from ....sources.load import compiled_file
from ....sources.mjmodel import Tree, inertia_of, mjmodel_gravity, model_name, reflected, tree_of
from ....sources.mjmodel_scene import equality_ends
from ....sources.mjmodel_values import FREE, HINGE, KINDS, SLIDE, floats_of, name_of, pose_of
from ..types.arguments import ArgumentError, Array, described, expected
from ..types.frame import BODY, FIXED_JOINT, OP_FRAME, Frame
from ..types.inertia import Inertia
from ..types.motion import Motion
from ..types.se3 import SE3
from .constraints import ContactType, RigidConstraintModel, StdVec_RigidConstraintModel
from .from_urdf import UNIT_BOUND, one_axis
from .joint import JointModel
from .joints import JointModelComposite, JointModelFreeFlyer, JointModelSpherical
from .model import Model

__all__ = ["buildModelAndLegacyConstraintsFromMJCF", "buildModelFromMJCF"]

ROOT_NAME = "root_joint"


class Part(NamedTuple):
    """A joint of a body: its model, place after the joint or body before it, and position limits (nq,)."""

    number: int
    model: Any
    placement: SE3
    lower: Array
    upper: Array


def buildModelFromMJCF(mjcf_filename: Any, root_joint: JointModel | None = None, root_joint_name: Any = None) -> Any:
    """The Model of an MJCF file, as MuJoCo compiles it (pip install mujoco).

    mjcf_filename    str or Path
    root_joint       joint model between the universe and the bodies of the world; without it they are as the file says
    root_joint_name  its name, "root_joint" by default; if it is given the result is, as Pinocchio's, that of
                     ``buildModelAndLegacyConstraintsFromMJCF``

    Joints of one body are one JointModelComposite, ``Composite_`` and the name of the first. Keyframes, and ``qpos0``,
    are ``referenceConfigurations``. Raises SpatialDynError with MuJoCo's message for what is no MJCF.
    """
    if root_joint_name is not None:
        return buildModelAndLegacyConstraintsFromMJCF(mjcf_filename, root_joint, root_joint_name)
    return model_of(compiled(mjcf_filename), root_joint)


def buildModelAndLegacyConstraintsFromMJCF(
    mjcf_filename: Any, root_joint: JointModel | None = None, root_joint_name: str = ROOT_NAME
) -> tuple[Model, Any]:
    """(model, contacts) of an MJCF file: ``buildModelFromMJCF``, and a RigidConstraintModel for each connect and weld.

    Equalities that are not active are left out.
    """
    m = compiled(mjcf_filename)
    model = model_of(m, root_joint, root_joint_name)
    return model, constraints_of(m, model)


def compiled(mjcf_filename: Any) -> Any:
    """The MjModel of an MJCF file. Raises ArgumentError, SpatialDynError."""
    if not isinstance(mjcf_filename, str) and not hasattr(mjcf_filename, "__fspath__"):
        raise ArgumentError(f"mjcf_filename is {described(mjcf_filename)}, expected a str or Path")
    return compiled_file(str(mjcf_filename))


def body_frame(tree: Tree, model: Model, body: int) -> int:
    """The frame of a body of an MjModel; 0 of the world. Raises ModelError for a body that the model does not have."""
    if body == 0:
        return 0
    found = model.getFrameId(tree.link_of[body], BODY)
    if found >= model.nframes:
        raise ModelError(f'model "{model.name}" has no body "{tree.link_of[body]}", expected one built of this MJCF')
    return found


def constraints_of(m: Any, model: Model) -> Any:
    """A contact for each active connect and weld."""
    import mujoco

    tree, made = tree_of(m), StdVec_RigidConstraintModel()
    kinds = {int(mujoco.mjtEq.mjEQ_CONNECT): ("connect", ContactType.CONTACT_3D),
             int(mujoco.mjtEq.mjEQ_WELD): ("weld", ContactType.CONTACT_6D)}  # fmt: skip
    for e in range(m.neq):
        if int(m.eq_type[e]) not in kinds or not m.eq_active0[e]:
            continue
        kind, contact = kinds[int(m.eq_type[e])]
        bodies, places = equality_ends(m, e, kind)
        ends: list[Any] = []
        for body, X in zip(bodies, places, strict=True):
            frame = model.frames[body_frame(tree, model, body)]
            ends += [frame.parentJoint, frame.placement * SE3(X)]
        constraint = RigidConstraintModel(contact, model, *ends)
        constraint.name = name_of(m, mujoco.mjtObj.mjOBJ_EQUALITY, e)
        made.append(constraint)
    return made


def model_of(m: Any, root_joint: JointModel | None = None, root_joint_name: str = ROOT_NAME) -> Model:
    """The Model of an MjModel, perhaps on a root joint."""
    if root_joint is not None and not isinstance(root_joint, JointModel):
        raise ArgumentError(f"root_joint is {described(root_joint)}, expected a joint model")
    tree, model = tree_of(m), Model()
    model.name = model_name(m)
    model.gravity = Motion(np.array([*mjmodel_gravity(m), 0.0, 0.0, 0.0]))
    carrier = 0
    if root_joint is not None:
        free = [tree.joint_of[j] for j in range(m.njnt) if int(m.jnt_type[j]) == FREE]
        if free:
            raise SpatialDynError(f'root_joint is given and the file has the free joint "{free[0]}", expected one')
        name = expected(root_joint_name, str, "root_joint_name")
        carrier = model.addJointFrame(model.addJoint(0, root_joint, SE3.Identity(), name), 0)
    frames = {0: carrier}
    for body in range(m.nbody):
        if body:
            frames[body] = _add_body(m, tree, model, body, frames[int(m.body_parentid[body])])
        for site in np.flatnonzero(np.asarray(m.site_bodyid) == body).tolist():
            X = SE3(pose_of(m.site_pos[site], m.site_quat[site]))
            at = model.frames[frames[body]]
            name = name_of(m, mujoco_site(), site) or tree.site_of[site]
            model.addFrame(Frame(name, at.parentJoint, frames[body], at.placement * X, OP_FRAME))
    if root_joint is None:
        _add_configurations(m, model)
    return model


def mujoco_site() -> Any:
    """The kind of object that a site is."""
    import mujoco

    return mujoco.mjtObj.mjOBJ_SITE


def _add_body(m: Any, tree: Tree, model: Model, body: int, before: int) -> int:
    """Add a body and its joints; returns its frame."""
    name, carrier = tree.link_of[body], model.frames[before]
    X = carrier.placement * SE3(pose_of(m.body_pos[body], m.body_quat[body]))
    mass, com, I = inertia_of(m, body) or (0.0, np.zeros(3), np.zeros((3, 3)))
    inertia = Inertia.over(np.array([mass, *com, I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2]]))
    parts = [*_parts(m, body)]
    if not parts:
        if before == 0:
            return model.addFrame(Frame(name, 0, 0, X, BODY, inertia))
        at = model.addFrame(Frame(f"{name}_fixed", carrier.parentJoint, before, X, FIXED_JOINT, inertia))
        return model.addFrame(Frame(name, carrier.parentJoint, at, X, BODY))
    first = tree.joint_of[parts[0].number]
    free = int(m.jnt_type[parts[0].number]) == FREE
    placement = SE3.Identity() if free else X * parts[0].placement
    joint, called = parts[0].model, first
    if len(parts) > 1:
        joint, called = JointModelComposite(joint), f"Composite_{first}"
        for part in parts[1:]:
            joint.addJoint(part.model, part.placement)
    limits = {"min_config": np.concatenate([x.lower for x in parts]),
              "max_config": np.concatenate([x.upper for x in parts]), **_of_freedoms(m, body)}  # fmt: skip
    index = model.addJoint(carrier.parentJoint, joint, placement, called, **limits)
    dofs = slice(int(m.body_dofadr[body]), int(m.body_dofadr[body]) + int(m.body_dofnum[body]))
    own = slice(model.idx_vs[index], model.idx_vs[index] + model.nvs[index])
    model.armature[own] = np.asarray(m.dof_armature)[dofs] + reflected(m)[dofs]
    back = np.eye(4)
    back[:3, 3] = 0.0 if free else -np.asarray(m.jnt_pos[parts[-1].number])
    if mass:
        model.appendBodyToJoint(index, inertia, SE3(back))
    frame = model.addBodyFrame(name, index, SE3(back), model.addJointFrame(index, before))
    return int(frame)


def _parts(m: Any, body: int) -> Iterator[Part]:
    """The joints of a body, each placed from the one before it."""
    count, first = int(m.body_jntnum[body]), int(m.body_jntadr[body])
    before = np.zeros(3)
    for j in range(first, first + count):
        kind = int(m.jnt_type[j])
        X = np.eye(4)
        X[:3, 3] = np.asarray(m.jnt_pos[j]) - before
        before = np.array(m.jnt_pos[j])
        if kind in (HINGE, SLIDE):
            axis, ref = floats_of(m.jnt_axis[j]), float(m.qpos0[m.jnt_qposadr[j]])
            back = joint_transform(KINDS[kind], np.array(axis), np.array([-ref]), "angle", 0.0) if ref else np.eye(4)
            lower, upper = floats_of(m.jnt_range[j]) if m.jnt_limited[j] else (-math.inf, math.inf)
            yield Part(j, one_axis(KINDS[kind], axis), SE3(X @ back), np.array([lower]), np.array([upper]))
        else:
            free = kind == FREE
            upper_of = np.array([math.inf] * 3 * free + [UNIT_BOUND] * 4)
            made = JointModelFreeFlyer() if free else JointModelSpherical()
            yield Part(j, made, SE3(X), -upper_of, upper_of)


def _of_freedoms(m: Any, body: int) -> dict[str, Array]:
    """The arguments of ``addJoint`` of all freedoms of a body's joints."""
    dofs = range(int(m.body_dofadr[body]), int(m.body_dofadr[body]) + int(m.body_dofnum[body]))
    effort = np.array([
        float(abs(m.jnt_actfrcrange[m.dof_jntid[d]]).max()) if m.jnt_actfrclimited[m.dof_jntid[d]] else math.inf
        for d in dofs
    ])  # fmt: skip
    fast, friction = np.full(len(dofs), math.inf), np.array([float(m.dof_frictionloss[d]) for d in dofs])
    return {"min_effort": -effort, "max_effort": effort, "min_velocity": -fast, "max_velocity": fast,
            "min_friction": -friction, "max_friction": friction,
            "damping": np.array([float(m.dof_damping[d]) for d in dofs])}  # fmt: skip


def _add_configurations(m: Any, model: Model) -> None:
    """qpos0 and the keyframes, quaternions x y z w."""
    import mujoco

    keys = {name_of(m, mujoco.mjtObj.mjOBJ_KEY, k): m.key_qpos[k] for k in range(m.nkey)}
    for name, qpos in {**keys, "qpos0": m.qpos0}.items():
        q = np.array(qpos, float)
        for j in range(m.njnt):
            if int(m.jnt_type[j]) not in (HINGE, SLIDE):
                at = int(m.jnt_qposadr[j]) + 3 * (int(m.jnt_type[j]) == FREE)
                q[at : at + 4] = np.roll(q[at : at + 4], -1)
        if name:
            model.referenceConfigurations[name] = q
