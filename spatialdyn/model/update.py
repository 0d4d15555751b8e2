"""A Model with other numbers in the same tree, made from the parts that did not change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..algebra.euclidean import Vec
from ..algebra.records import put_vec
from ..algebra.spatial import add_inertia, compose, identity_pose, inertia_to_parent
from ..bodies.table import ANY_NORM
from ..errors import ModelError
from .assembly import NOTHING, Tables, about_origin, completed, digest, put_rotor, refuse_overflow
from .joint_rows import Joint, matrix_from_pose, pose_from_matrix, put_joint, subspace
from .model import Model
from .robot import Link, RobotJoint


def edited(
    model: Model,
    links: Mapping[int, Link],
    joints: Mapping[int, RobotJoint],
    gravity: tuple[float, float, float] | None = None,
    any_norm: bool | None = None,
) -> Model:
    """The Model with some links and joints replaced, bit for bit as if assembled anew.

    model    without mimic and fixed joints, so that each joint carries one link
    links    index in ``robot.links`` -> a Link of the same name
    joints   index in ``robot.joints`` -> a RobotJoint that differs in placement, armature and rotor alone
    gravity  (3,) [m/s²]; unchanged if None
    any_norm whether q may be off its unit norm; unchanged if None

    Raises ModelError for other models; ModelError, InertiaError naming the joint whose placement or inertia overflows.
    """
    if model.mimic_matrix is not None or len(model.robot.joints) + 1 != model.njoints:
        raise ModelError(f'model "{model.name}" has other than one link for each moving joint, expected no fixed ones')
    robot, options, bodies = model.robot, model.options, model.bodies.copy()
    all_links, all_joints, rows = list(robot.links), list(robot.joints), list(model.joints)
    child = {joint.child: joint.name for joint in all_joints} if links else {}
    for at, link in links.items():
        all_links[at] = link
        if link.name in child:
            body = inertia_to_parent(identity_pose(), about_origin(link))
            bodies["inertia"][model.joint(child[link.name]).row] = add_inertia(NOTHING, body)
    for at, given in joints.items():
        k, all_joints[at] = model._joint_index[given.name], given
        first = rows[k].row - rows[k].nv + 1
        bodies["armature"][first : rows[k].row + 1] = given.armature
        if given.placement != robot.joints[at].placement:
            rows[k] = put_placement(model, bodies, given)
        put_rotor(bodies, first, given, pose_from_matrix(rows[k].placement).R if rows[k].parent else None)
    if gravity is not None:
        options = replace(options, gravity=gravity)
        put_vec(bodies[0].gravity, Vec(*gravity))
    if any_norm is not None:
        options = replace(options, any_norm=any_norm)
        bodies[0].kind = ANY_NORM if any_norm else 0
    bodies = completed(bodies)
    refuse_overflow(robot.name, bodies, rows)
    armature = np.array(bodies["armature"][1:])
    armature.flags.writeable = False
    taken: dict[str, Any] = {name: getattr(model, name) for name in Tables._fields}
    robot = replace(robot, links=tuple(all_links), joints=tuple(all_joints))
    own: dict[str, Any] = {
        "robot": robot,
        "key": digest(bodies),
        "bodies": bodies,
        "joints": tuple(rows),
        "armature": armature,
    }
    made = object.__new__(Model)
    made._hold(Tables(**{**taken, **own}), options)
    return made


def put_placement(model: Model, bodies: NDArray[Any], joint: RobotJoint) -> Joint:
    """Write the placement of a joint to a table of bodies; returns the Joint with it."""
    row = model.joints[model._joint_index[joint.name]]
    first, base = row.row - row.nv + 1, identity_pose() if row.parent else pose_from_matrix(model.options.base)
    X = compose(base, pose_from_matrix(joint.placement))
    S = subspace(joint.kind, joint.axis, joint.pitch)
    put_joint(bodies, first, int(bodies["kind"][first]), X, S, row.idx_q)
    bodies["parent"][first] = model.joints[row.parent].row
    return row._replace(placement=matrix_from_pose(X))
