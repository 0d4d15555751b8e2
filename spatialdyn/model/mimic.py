"""Mimic joints: the leader of each one, and the coordinates of the full tree as functions of the model's own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies.kinds import CODES, kind_of
from ..errors import ModelError
from .joint_rows import Joint, frozen, joint_transform
from .robot import Mimic, Robot, RobotJoint

Array = NDArray[np.float64]
Places = NDArray[np.intp]
ONE_COORDINATE = tuple(word for word in CODES if kind_of(word).nq == 1)
BOTH = 'expected both to have one coordinate (continuous="angle")'


def resolve_mimics(robot: Robot) -> tuple[Robot, dict[str, Mimic]]:
    """The robot with mimics of fixed joints made fixed, and {name: Mimic} of the others with chains resolved.

    Raises ModelError naming the joint whose leader is missing or has several coordinates, or the joints of a cycle.
    """
    by_name = {joint.name: joint for joint in robot.joints}
    joints, leaders = [], {}
    whole: dict[str, Mimic] = {}
    for joint in robot.joints:
        if joint.mimic is not None and joint.kind != "fixed":
            mimic = _follow(joint, by_name, whole, robot.name)
            last = by_name[mimic.leader]
            if joint.kind not in ONE_COORDINATE:
                raise ModelError(f'{joint.kind} joint "{joint.name}" mimics "{last.name}", {BOTH}')
            if last.kind == "fixed":
                with np.errstate(over="ignore", invalid="ignore"):  # ``assembly`` refuses what is not finite
                    X_J = joint_transform(joint.kind, joint.axis, [mimic.offset], pitch=joint.pitch)
                    X = np.reshape(joint.placement, (4, 4)) @ X_J
                joint = replace(joint, kind="fixed", placement=tuple(X.ravel().tolist()))
            else:
                leaders[joint.name] = mimic
        joints.append(joint)
    return replace(robot, joints=tuple(joints)), leaders


def _follow(joint: RobotJoint, by_name: Mapping[str, RobotJoint], whole: dict[str, Mimic], robot: str) -> Mimic:
    """The Mimic equivalent to a joint's chain of mimics; written to ``whole``, as are those of the chain's joints."""
    at, passed = joint, {joint.name: joint}
    while at.name not in whole and at.mimic is not None and at.kind != "fixed":
        leader = at.mimic.leader
        if leader not in by_name:
            raise ModelError(f'joint "{at.name}" mimics "{leader}", which robot "{robot}" does not have')
        if leader in passed:
            raise ModelError(f"joints {_shown_chain([*passed, leader])} mimic each other in a circle")
        at = passed[leader] = by_name[leader]
    rest = whole.get(at.name, Mimic(at.name))
    for name in reversed([name for name in passed if name != at.name]):
        own = passed[name].mimic or Mimic(name)
        rest = Mimic(rest.leader, own.multiplier * rest.multiplier, own.offset + own.multiplier * rest.offset)
        if not (math.isfinite(rest.multiplier) and math.isfinite(rest.offset)):
            raise ModelError(
                f'joint "{name}" mimics "{rest.leader}" with multiplier {rest.multiplier} and offset {rest.offset} '
                "in all, expected finite numbers"
            )
        whole[name] = rest
    return rest


def _shown_chain(names: list[str], most: int = 8) -> str:
    """Names with arrows between them; of a long chain the first and the last two."""
    return " -> ".join(names if len(names) <= most else [*names[: most - 2], "...", *names[-2:]])


class Mimics(NamedTuple):
    """q = q_model[source] * ratio + offset (nq of the full tree) and v = matrix @ v_model; joints with new indices."""

    joints: list[Joint]
    matrix: Array | None
    source: Places
    ratio: Array
    offset: Array


def mimic_map(joints: list[Joint], leaders: Mapping[str, Mimic]) -> Mimics:
    """The map from the model's coordinates to the full tree's; without mimics ``matrix`` is None."""
    nq, nv = sum(j.nq for j in joints), sum(j.nv for j in joints)
    source, ratio, offset = np.arange(nq), np.ones(nq), np.zeros(nq)
    if not leaders:
        return Mimics(joints, None, frozen(source, np.intp), frozen(ratio), frozen(offset))
    where = {j.name: k for k, j in enumerate(joints)}
    new_q = np.cumsum([0] + [0 if j.name in leaders else j.nq for j in joints]).tolist()
    new_v = np.cumsum([0] + [0 if j.name in leaders else j.nv for j in joints]).tolist()
    G = np.zeros((nv, new_v[-1]))
    placed = []
    for k, j in enumerate(joints):
        m = leaders.get(j.name)
        lead = k if m is None else where[m.leader]
        if m is None:
            source[j.idx_q : j.idx_q + j.nq] = range(new_q[k], new_q[k] + j.nq)
            G[j.idx_v : j.idx_v + j.nv, new_v[k] : new_v[k] + j.nv] = np.eye(j.nv)
        else:
            if j.nq != 1 or joints[lead].nq != 1:
                raise ModelError(f'joint "{j.name}" mimics "{m.leader}", {BOTH}')
            source[j.idx_q], ratio[j.idx_q], offset[j.idx_q] = new_q[lead], m.multiplier + 0.0, m.offset + 0.0
            G[j.idx_v, new_v[lead]] = m.multiplier + 0.0
        mimic = None if m is None else (lead, m.multiplier, m.offset)
        placed.append(j._replace(idx_q=new_q[lead], idx_v=new_v[lead], mimic=mimic))
    return Mimics(placed, frozen(G), frozen(source, np.intp), frozen(ratio), frozen(offset))
