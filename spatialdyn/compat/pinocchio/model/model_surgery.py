"""Models built from models: ``buildReducedModel``, ``transformJointIntoMimic``, ``appendModel``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ....errors import ModelError, ShapeError
from ..types.arguments import ArgumentError, by_name, described, expected
from ..types.frame import FIXED_JOINT, JOINT, Frame
from ..types.se3 import SE3
from .geometry import CollisionPair, GeometryModel
from .joint import JointModel
from .joint_tree import ARRAYS
from .joints import JointModelMimic, Mimic
from .model import Model

__all__ = ["appendModel", "buildReducedModel", "transformJointIntoMimic"]


def buildReducedModel(model: Model, *arguments: Any, **named: Any) -> Any:
    """A model with some joints locked: their bodies move to the parent joint, their frames stay.

    geom_model               optional GeometryModel or list of them, whose objects move to the joints that are left;
                             returned with the model, as new ones
    list_of_joints_to_lock   indices of joints
    reference_configuration  (nq,) at which they are locked

    Raises ModelError for an index that is not a joint's or occurs twice, or of a joint that another one mimics;
    ShapeError.
    """
    geometry = ["list_of_geom_models" if "list_of_geom_models" in named else "geom_model"]
    geometry *= len(arguments) + len(named) == 3
    names = " ".join([*geometry, "list_of_joints_to_lock reference_configuration"])
    given = by_name("buildReducedModel", names, arguments, named, 3)
    made = _reduced(model, given["list_of_joints_to_lock"], given["reference_configuration"])
    if not geometry:
        return made.whole
    shapes = given[geometry[0]]
    if isinstance(shapes, GeometryModel):
        return made.whole, made.geometry(shapes)
    return made.whole, [made.geometry(x) for x in shapes]


def _reduced(model: Model, joints: Iterable[int], q: Any) -> _Part:
    expected(model, Model, "model")
    if not isinstance(q, np.ndarray):
        raise ArgumentError(f"reference_configuration is {described(q)}, expected an array")
    if isinstance(joints, str) or not isinstance(joints, Iterable):
        raise ArgumentError(f"list_of_joints_to_lock is {described(joints)}, expected indices")
    if q.size != model.nq:
        raise ShapeError(f"reference_configuration has {q.size} numbers, expected {model.nq}")
    locked: dict[int, SE3] = {}
    for index in joints:
        if not isinstance(index, (int, np.integer)):
            raise ArgumentError(f"joint index is {described(index)}, expected a number")
        at = model._check_joint(index)
        if at == 0 or at in locked:
            raise ModelError(f"joint index {at} cannot be locked, expected each joint once and not the universe")
        data = model.joints[at].createData()
        model.joints[at].calc(data, q)
        locked[at] = data.M
    for follower, leader in zip(model.mimicking_joints, model.mimicked_joints, strict=True):
        if leader in locked and follower not in locked:
            raise ModelError(f'joint "{model.names[follower]}" mimics "{model.names[leader]}", expected both locked')
    return _rebuilt(model, locked, {})


def transformJointIntoMimic(
    input_model: Model, index_mimicked: int, index_mimicking: int, scaling: float, offset: float
) -> Model:
    """A model in which one joint follows another: q = scaling q' + offset.

    Raises ModelError unless both have one coordinate and the leader comes first.
    """
    expected(input_model, Model, "input_model")
    leader, follower = input_model._check_joint(index_mimicked), input_model._check_joint(index_mimicking)
    if not 0 < leader < follower:
        raise ModelError(f"joint {follower} cannot mimic joint {leader}, expected one before it")
    motion = input_model.joints[follower]
    mimic = JointModelMimic.of(motion, input_model.joints[leader], scaling, offset)
    return _rebuilt(input_model, {}, {follower: mimic}).whole


def appendModel(modelA: Model, modelB: Model, *arguments: Any, **named: Any) -> Any:
    """A model in which the universe of B is fixed to a frame of A.

    geom_modelA, geom_modelB  optional GeometryModels of both; one with the objects and pairs of both is returned with
                              the model: A's objects come first, and objects of A and of B make pairs if they are on
                              different joints
    frame_in_modelA           index of the frame
    aMb                       SE3, pose of B's universe in it

    B's joints come after the subtree of the frame's joint, so that all are depth first. Gravity is that of A.
    Raises ModelError for a missing frame, or a name that both have.
    """
    geometry = "geom_modelA geom_modelB " * (len(arguments) + len(named) == 4)
    given = by_name("appendModel", f"{geometry}frame_in_modelA aMb", arguments, named, 4 if geometry else 2)
    shapes = [expected(given[name], GeometryModel, name) for name in geometry.split()]
    made = _appended(modelA, modelB, given["frame_in_modelA"], given["aMb"])
    return (made[0], _appended_geometry(made, shapes)) if shapes else made[0]


def _appended(modelA: Model, modelB: Model, frame_in_modelA: int, aMb: SE3) -> tuple[Model, _Part, _Part]:
    """The model, and its parts."""
    expected(modelA, Model, "modelA")
    expected(modelB, Model, "modelB")
    expected(aMb, SE3, "aMb")
    if not isinstance(frame_in_modelA, (int, np.integer)):
        raise ArgumentError(f"frame_in_modelA is {described(frame_in_modelA)}, expected the index of a frame")
    if not 0 <= int(frame_in_modelA) < modelA.nframes:
        raise ModelError(f"frame index is {frame_in_modelA}, expected one from 0 to {modelA.nframes - 1}")
    _check_names(modelA, modelB)
    at = modelA.frames[int(frame_in_modelA)]
    last = max([at.parentJoint, *modelA.subtrees[at.parentJoint]])
    whole = _empty_like(modelA)
    A, B = _Part(modelA, whole), _Part(modelB, whole)
    A.fix(0, _Carrier(0, SE3.Identity()))
    for k in range(modelA.njoints):
        A.add(k)
        if k == last:
            carrier = A.carriers[at.parentJoint]
            B.fix(0, _Carrier(carrier.joint, carrier.placement * at.placement * aMb))
            B.frames[0] = A.frames[int(frame_in_modelA)]
            for j in range(modelB.njoints):
                B.add(j)
    vars(whole)["nbodies"] = 1 + modelA.njoints + modelB.njoints  # as Pinocchio counts them
    _copy_configurations(whole, A, B)
    return whole, A, B


def _appended_geometry(made: tuple[Model, _Part, _Part], shapes: list[GeometryModel]) -> GeometryModel:
    """The objects and pairs of both."""
    whole, parts, first = GeometryModel(), made[1:], 0
    for part, given in zip(parts, shapes, strict=True):
        first = whole.ngeoms
        for x in part.geometry(given).geometryObjects:
            whole.addGeometryObject(x)
        for pair in given.collisionPairs:
            whole.addCollisionPair(CollisionPair(pair.first + first, pair.second + first))
    for i, one in enumerate(whole.geometryObjects[:first]):
        for j, other in enumerate(whole.geometryObjects[first:], first):
            if one.parentJoint != other.parentJoint:
                whole.addCollisionPair(CollisionPair(i, j))
    return whole


def _check_names(A: Model, B: Model) -> None:
    for what, a, b in (("joint", A.names, B.names), ("frame", [f.name for f in A.frames], [f.name for f in B.frames])):
        both = sorted({*a[1:]} & {*b[1:]})
        if both:
            raise ModelError(f'both models have a {what} "{both[0]}", expected distinct names')


def _rebuilt(model: Model, locked: Mapping[int, SE3], replaced: Mapping[int, JointModel]) -> _Part:
    """A model, as a part, with some joints locked at a pose, others replaced; frames keep their indices."""
    whole = _empty_like(model)
    part = _Part(model, whole)
    part.fix(0, _Carrier(0, SE3.Identity()))
    for k in range(1, model.njoints):
        if k in locked:
            carrier = part.carriers[model.parents[k]]
            part.fix(k, _Carrier(carrier.joint, carrier.placement * model.jointPlacements[k] * locked[k]))
        else:
            part.add_joint(k, replaced.get(k))
    part.frames = {at: at for at in range(model.nframes)}
    for at, frame in enumerate(model.frames[1:], start=1):
        part.add_frame(at)
        if frame.parentJoint in locked and frame.type == JOINT:
            whole.frames[at].type, whole.frames[at].inertia = FIXED_JOINT, model.inertias[frame.parentJoint]
    vars(whole)["nbodies"] = whole.njoints
    _copy_configurations(whole, part)
    return part


# --- copying piece by piece ----------------------------------------------------------------------------------


class _Carrier(NamedTuple):
    """The joint that carries a body in the new model, and the body's placement on it."""

    joint: int
    placement: SE3


class _Part:
    """A model that is copied into a new one: old joint -> carrier, old frame -> new index."""

    def __init__(self, model: Model, whole: Model) -> None:
        self.model, self.whole = model, whole
        self.carriers: dict[int, _Carrier] = {}
        self.joints: list[int] = []  # the joints that are joints of the new model
        self.frames = {0: 0}

    def fix(self, k: int, carrier: _Carrier) -> None:
        """Fix the body of joint k to a joint of the new model."""
        self.carriers[k] = carrier
        self.whole._add_inertia(carrier.joint, self.model.inertias[k], carrier.placement)

    def add(self, k: int) -> None:
        """Copy joint k unless it is fixed, then its frames but the universe's."""
        if k not in self.carriers:
            self.add_joint(k)
        for at, frame in enumerate(self.model.frames):
            if frame.parentJoint == k and at:
                self.add_frame(at)

    def add_joint(self, k: int, joint: JointModel | None = None) -> None:
        """Copy joint k, or its replacement, with its inertia, which contains those of its frames."""
        model, whole, given = self.model, self.whole, self.model.joints[k]
        carrier = self.carriers[model.parents[k]]
        new = given if joint is None else joint
        if isinstance(new, Mimic):
            leader = whole.joints[self.carriers[new.leader].joint]
            new = JointModelMimic.of(new, leader, new.scaling, new.offset)
        q, v = (slice(at, at + n) for at, n in ((given.idx_q, new.nq), (given.idx_v, new.nv)))
        values = {name: x[q if ARRAYS[name].of_q else v] for name, x in model._arrays.items()}
        index = whole._add(carrier.joint, new, carrier.placement * model.jointPlacements[k], model.names[k], values)
        whole.inertias[index] = model.inertias[k]
        self.carriers[k] = _Carrier(index, SE3.Identity())
        self.joints.append(k)

    def add_frame(self, at: int) -> None:
        """Copy a frame."""
        frame = self.model.frames[at]
        carrier = self.carriers[frame.parentJoint]
        before, placement = self.frames.get(frame.parentFrame, 0), carrier.placement * frame.placement
        self.frames[at] = self.whole.nframes
        self.whole.frames.append(Frame(frame.name, carrier.joint, before, placement, frame.type, frame.inertia))

    def geometry(self, given: GeometryModel) -> GeometryModel:
        """The objects of the model on the joints of the new one, and their pairs."""
        found: GeometryModel = expected(given, GeometryModel, "geom_model").copy()
        for x in found.geometryObjects:
            carrier = self.carriers[x.parentJoint]
            x.parentJoint, x.placement = carrier.joint, carrier.placement * x.placement
            x.parentFrame = self.frames.get(x.parentFrame, x.parentFrame)
        return found


def _empty_like(model: Model) -> Model:
    """An empty model with the name and gravity of another."""
    made = Model()
    made.name, made.gravity = model.name, model.gravity
    return made


def _copy_configurations(whole: Model, *parts: _Part) -> None:
    """Copy reference configurations; joints of a part that has none of that name are neutral."""
    for name in dict.fromkeys(name for part in parts for name, _ in part.model.referenceConfigurations.items()):
        q = whole._neutral()
        for part in parts:
            given: Any = part.model.referenceConfigurations.get(name)
            for k in part.joints if given is not None else ():
                old, new = part.model.joints[k], whole.joints[part.carriers[k].joint]
                q[new.idx_q : new.idx_q + new.nq] = given[old.idx_q : old.idx_q + new.nq]
        whole.referenceConfigurations[name] = q
