"""Models from MJCF: ``buildModelFromMJCF``, through MuJoCo's compiled model.

Joints and frames have the names and the order of Pinocchio's reader; numbers are MuJoCo's, where Pinocchio's reader
leaves out the places of joints in their bodies, gravity, bodies beside the first and others without a name.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ....errors import ModelError, SpatialDynError
from ....model.robot import Link, RobotJoint
from ....sources.load import compiled_file
from ....sources.mjmodel import Tree, mjmodel_gravity, model_name, need_mujoco, tree_of
from ....sources.mjmodel_scene import equality_ends
from ....sources.mjmodel_values import FREE, HINGE, SLIDE, name_of
from ..types.arguments import ArgumentError, Array, described, expected, path
from ..types.frame import BODY, FIXED_JOINT, OP_FRAME, Frame
from ..types.motion import Motion
from ..types.se3 import SE3
from .constraints import ContactType, RigidConstraintModel, StdVec_RigidConstraintModel
from .from_urdf import inertia_of, joint_model, placed, position_limits
from .joint import JointModel
from .joints import JointModelComposite
from .model import Model

__all__ = ["buildModelAndLegacyConstraintsFromMJCF", "buildModelFromMJCF"]

ROOT_NAME = "root_joint"


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
    return compiled_file(str(path(mjcf_filename, "mjcf_filename")))


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
    mujoco, tree, made = need_mujoco(), tree_of(m), StdVec_RigidConstraintModel()
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
        free = [joint.name for joint in tree.joints if joint.kind == "floating"]
        if free:
            raise SpatialDynError(f'root_joint is given and the file has the free joint "{free[0]}", expected one')
        name = expected(root_joint_name, str, "root_joint_name")
        carrier = model.addJointFrame(model.addJoint(0, root_joint, SE3.Identity(), name), 0)
    frames, onto = {0: carrier}, {joint.child: joint for joint in tree.joints}
    links = {link.name: link for link in tree.links}
    for body in range(m.nbody):
        if body:
            above, link = int(m.body_parentid[body]), links[tree.link_of[body]]
            joints = [onto[link.name]]
            while joints[0].parent != tree.link_of[above]:
                joints.insert(0, onto[joints[0].parent])
            frames[body] = _add_body(model, link, joints, frames[above], _of_freedoms(m, body))
        for site in np.flatnonzero(np.asarray(m.site_bodyid) == body).tolist():
            at, here = model.frames[frames[body]], tree.site_of[site]
            name = name_of(m, need_mujoco().mjtObj.mjOBJ_SITE, site) or here
            model.addFrame(Frame(name, at.parentJoint, frames[body], at.placement * placed(onto[here]), OP_FRAME))
    if root_joint is None:
        _add_configurations(m, model)
    return model


def _add_body(model: Model, link: Link, joints: list[RobotJoint], before: int, limits: dict[str, Array]) -> int:
    """Add a body on a chain of joints, the last perhaps fixed, with limits of its freedoms; returns its frame."""
    carrier, inertia = model.frames[before], inertia_of(link)
    place, moving = carrier.placement * placed(joints[0]), [joint for joint in joints if joint.kind != "fixed"]
    if not moving:
        if before == 0:
            return model.addFrame(Frame(link.name, 0, 0, place, BODY, inertia))
        at = model.addFrame(Frame(f"{link.name}_fixed", carrier.parentJoint, before, place, FIXED_JOINT, inertia))
        return model.addFrame(Frame(link.name, carrier.parentJoint, at, place, BODY))
    parts = [joint_model(joint) for joint in moving]
    made, name = parts[0], moving[0].name
    if len(parts) > 1:
        made, name = JointModelComposite(made), f"Composite_{name}"
        for joint, part in zip(moving[1:], parts[1:], strict=True):
            made.addJoint(part, placed(joint))
    bounds = zip(*map(position_limits, moving, parts), strict=True)
    limits |= zip(("min_config", "max_config"), map(np.concatenate, bounds), strict=True)
    index = model.addJoint(carrier.parentJoint, made, place, name, **limits)
    rotors = [np.broadcast_to(joint.armature, part.nv) for joint, part in zip(moving, parts, strict=True)]
    model.armature[model.idx_vs[index] : model.idx_vs[index] + made.nv] = np.concatenate(rotors)
    back = placed(joints[-1]) if joints[-1].kind == "fixed" else SE3.Identity()
    if link.mass:
        model.appendBodyToJoint(index, inertia, back)
    frame = model.addBodyFrame(link.name, index, back, model.addJointFrame(index, before))
    return int(frame)


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
    keys = {name_of(m, need_mujoco().mjtObj.mjOBJ_KEY, k): m.key_qpos[k] for k in range(m.nkey)}
    for name, qpos in {**keys, "qpos0": m.qpos0}.items():
        q = np.array(qpos, float)
        for j in range(m.njnt):
            if int(m.jnt_type[j]) not in (HINGE, SLIDE):
                at = int(m.jnt_qposadr[j]) + 3 * (int(m.jnt_type[j]) == FREE)
                q[at : at + 4] = np.roll(q[at : at + 4], -1)
        if name:
            model.referenceConfigurations[name] = q
