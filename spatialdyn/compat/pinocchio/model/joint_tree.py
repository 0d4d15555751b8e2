"""The joints of a Model: kinds, parents, bodies, and indices of their coordinates and velocities."""

from __future__ import annotations

from typing import Any
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from ....errors import ModelError, ShapeError
from ....model.robot_checks import missing
from ..coverage.strictness import MODELS, strict
from ..types.arguments import NUMBERS, OMITTED, ArgumentError, Array, described, expected
from ..types.bases import Owner
from ..types.inertia import Inertia
from ..types.motion import Motion
from ..types.se3 import SE3
from ..types.tracked_list import Listed, OwnedList, Rows
from .joint import JointModel
from .joints import JointModelRX, Mimic
from .numbers import Numbers

NO_LIMIT = float(np.finfo(float).max)  # Pinocchio's value for "no limit"
FRICTION = ("min_friction", "max_friction", "damping")
BOTH = ("min_effort", "max_effort", "min_velocity", "max_velocity", "min_config", "max_config")
LIMITS = {  # limit arguments of addJoint, by their number
    0: (),
    4: ("max_effort", "max_velocity", "min_config", "max_config"),
    9: (*BOTH, *FRICTION),
    10: (*BOTH, "config_limit_margin", *FRICTION),
}


class Entries:
    """An array of a model: (nq,) or (nv,), as its docstring begins; assignment copies.

    default  of a joint that ``addJoint`` gets no limits for
    limit    the argument of ``addJoint`` for a joint's entries, if any
    """

    name = ""

    def __init__(self, default: float, doc: str, limit: str = "") -> None:
        self.default, self.limit, self.__doc__ = default, limit, doc
        self.of_q = doc.startswith("(nq,)")

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = self.name or name  # the first of several

    def size(self, of: Any) -> int:
        """Number of entries of a model or a joint."""
        return int(of.nq if self.of_q else of.nv)

    def __get__(self, model: Any, kind: Any = None) -> Any:
        if model is None:
            return self
        return model._arrays[self.name]

    def __set__(self, model: Any, value: Any) -> None:
        if not isinstance(value, np.ndarray) or value.dtype.kind not in NUMBERS:
            raise ArgumentError(f"{self.name} is {described(value)}, expected an array of numbers")
        n = self.size(model)
        if value.shape not in ((n,), (n, 1)):
            raise ShapeError(f"{self.name} has shape {value.shape}, expected ({n},)")
        model._arrays[self.name][...] = np.asarray(value).reshape(n)  # in place: held arrays see it, as in Pinocchio


GRAVITY = (0.0, 0.0, -9.81)


class Indices(list[int], Listed):
    """A list of indices."""

    __slots__ = ()


class Joints(OwnedList[JointModel]):
    """The joints of a model, each of the class JointModel, as in Pinocchio."""

    def _own(self, value: JointModel) -> JointModel:
        return super()._own(value).held()

    def __setitem__(self, at: Any, value: Any) -> None:
        raise ModelError(
            f"joints[{at}] of a Model cannot be assigned, for the indices of all joints follow from it; expected "
            "addJoint on a new Model, buildReducedModel or transformJointIntoMimic"
        )


class Attribute:
    """What an attribute of each model is on the class: its documentation."""

    def __init__(self, doc: str) -> None:
        self.__doc__ = doc


def attribute(doc: str) -> Any:
    """The ``Attribute`` of an attribute, of the type that the attribute has in a model."""
    return Attribute(doc)


class Tree:
    """The part of a Model that concerns joints; index 0 is the universe.

    Lists have an entry for each joint (njoints,); an edit of one takes effect at the next call.
    """

    name: str = attribute("The name of the robot.")
    nq: int = attribute("Number of coordinates.")
    nv: int = attribute("Number of velocities.")
    nvExtended: int = attribute("Number of velocities without mimicking.")
    nbodies: int = attribute("Number of appended bodies with the universe.")
    names: list[str] = attribute("Names of the joints, a list to write into.")
    parents: list[int] = attribute("Parents of the joints, a list to write into.")
    joints: list[JointModel] = attribute("The joints, a list to write into.")
    idx_qs: Indices = attribute("First index of each joint's coordinates.")
    nqs: Indices = attribute("Number of each joint's coordinates.")
    idx_vs: Indices = attribute("First index of each joint's velocities.")
    nvs: Indices = attribute("Number of each joint's velocities.")
    idx_vExtendeds: Indices = attribute("First index of each joint's velocities without mimicking.")
    nvExtendeds: Indices = attribute("Number of each joint's velocities without mimicking.")
    supports: list[Indices] = attribute("For each joint those that carry it, and itself.")
    subtrees: list[Indices] = attribute("For each joint itself and those that it carries.")
    children: list[Indices] = attribute("For each joint those right after it.")
    mimicking_joints: Indices = attribute("The joints that mimic another.")
    mimicked_joints: Indices = attribute("The joints that they mimic.")
    mimic_joint_supports: list[Indices] = attribute("For each joint the mimic joints that carry it.")
    jointPlacements: Rows = attribute("SE3 of each joint in its parent's frame, a list to write into.")
    inertias: Rows = attribute("Inertia of each joint's bodies, a list to write into.")
    _arrays: dict[str, Array]
    _numbers: Numbers
    _gravity: Motion
    _library: Any  # LibraryModel, None after an edit of the tree and where norms are checked anew
    _library_before: Any  # the last LibraryModel, None after an edit of the tree
    _frame_placements: Any  # FramePlacements, None after an edit of a frame
    _builtins: Any  # builtins by key, of rows of the table without a Data
    _plans: dict[str, Any]  # their plans
    _edited: Any  # whether it is the copy of one that was edited; None after an edit of the tree

    lowerPositionLimit = Entries(-NO_LIMIT, "(nq,) least coordinates.", "min_config")
    upperPositionLimit = Entries(NO_LIMIT, "(nq,) largest coordinates.", "max_config")
    positionLimitMargin = Entries(0.0, "(nq,) margin to the limits; without effect.", "config_limit_margin")
    lowerEffortLimit = Entries(-NO_LIMIT, "(nv,) least forces of the joints.", "min_effort")
    upperEffortLimit = effortLimit = Entries(NO_LIMIT, "(nv,) largest forces of the joints.", "max_effort")
    lowerVelocityLimit = Entries(-NO_LIMIT, "(nv,) least velocities.", "min_velocity")
    upperVelocityLimit = velocityLimit = Entries(NO_LIMIT, "(nv,) largest velocities.", "max_velocity")
    lowerDryFrictionLimit = Entries(0.0, "(nv,) least dry friction; without effect.", "min_friction")
    upperDryFrictionLimit = friction = Entries(0.0, "(nv,) largest dry friction; without effect.", "max_friction")
    damping = Entries(0.0, "(nv,) viscous friction; without effect.", "damping")
    armature = Entries(0.0, "(nv,) reflected inertias of the rotors, added to the diagonal of M.")
    rotorInertia = Entries(0.0, "(nv,) inertias of the rotors; without effect, see ``armature``.")
    rotorGearRatio = Entries(1.0, "(nv,) ratios of the gears; without effect.")
    gravity981 = np.array(GRAVITY)
    gravity981.flags.writeable = False

    def __init__(self) -> None:
        owner, own = self._begin(), vars(self)
        own["_arrays"] = {name: np.empty(0) for name in ARRAYS}
        own.update(name="", nq=0, nv=0, nvExtended=0, nbodies=1)
        own["names"] = OwnedList(owner, str, ["universe"])
        own["parents"] = OwnedList(owner, (int, np.integer), [0])
        own["joints"] = Joints(owner, JointModel, [JointModelRX()])
        own |= {name: Indices([0]) for name in ("idx_qs", "nqs", "idx_vs", "nvs", "idx_vExtendeds", "nvExtendeds")}
        own |= {"supports": [Indices([0])], "subtrees": [Indices()], "children": [Indices()]}
        own |= {"mimicking_joints": Indices(), "mimicked_joints": Indices(), "mimic_joint_supports": [Indices([0])]}
        numbers = Numbers(1, 0)
        numbers.gravity[:3], numbers.placements[0] = GRAVITY, np.eye(4)
        self._hold(numbers)

    def _begin(self) -> Owner:
        """Note the model, without anything yet; returns the owner of the values of its tree."""
        MODELS.add(self)
        self._plans = {}
        caches = ("_library", "_library_before", "_edited")
        vars(self).update(dict.fromkeys(caches))
        self._forget()
        return self._owner_of(*caches)

    def _forget(self) -> None:
        """Drop what follows from the LibraryModel."""
        vars(self).update(_frame_placements=None, _builtins=None)
        self._plans.clear()

    def _hold(self, numbers: Numbers) -> None:
        """Have the numbers be those of the model, and its values views of them."""
        own = vars(self)
        if "_numbers" in own:
            self._gravity._x = numbers.gravity
            self.jointPlacements.move(numbers.placements)
            self.inertias.move(numbers.inertias)
        else:
            own["_gravity"] = Motion.over(numbers.gravity)
            own["jointPlacements"], own["inertias"] = Rows(numbers.placements, SE3), Rows(numbers.inertias, Inertia)
        own["_numbers"], own["_arrays"]["armature"] = numbers, numbers.armature

    def _owner_of(self, *caches: str) -> Owner:
        """The owner of values of which these cached attributes are made; a write sets them to None."""
        here, nothing = ref(self), dict.fromkeys(caches)  # its lists would be a cycle: a copy is freed at once

        def changed() -> None:
            model = here()
            if model is not None:
                vars(model).update(nothing)
                model._forget()

        return Owner(changed)

    njoints: Any = property(lambda self: len(self.joints), doc="Number of joints, with the universe.")

    @property
    def gravity(self) -> Motion:
        """Acceleration of gravity; only its linear part may differ from 0."""
        return self._gravity

    @gravity.setter
    def gravity(self, value: Motion) -> None:
        self._gravity._x[...] = expected(value, Motion, "gravity")._x

    def _check_joint(self, index: Any) -> int:
        at = int(index)
        if not 0 <= at < self.njoints:
            raise ModelError(f"joint index is {at}, expected one from 0 to {self.njoints - 1}")
        return at

    def _append_joint(self, parent: int, joint: JointModel, placement: SE3, name: str) -> int:
        """Append a copy of a joint; returns its index."""
        index, joint = int(self.njoints), joint.copy()
        self._assign_indices(index, joint, name)
        self.joints.append(joint)
        self.names.append(name)
        self.parents.append(parent)
        self._hold(self._numbers.grown(placement._x, joint.nv))
        self.supports.append(Indices([*self.supports[parent], index]))
        self.subtrees.append(Indices())
        self.children.append(Indices())
        self.children[parent].append(index)
        for above in self.supports[index]:
            self.subtrees[above].append(index)
        follows = [index] if isinstance(joint, Mimic) else []
        self.mimic_joint_supports.append(Indices([*self.mimic_joint_supports[parent], *follows]))
        return index

    def _assign_indices(self, index: int, joint: JointModel, name: str) -> None:
        """Set the indices of a new joint in q and v: after all others, or its leader's."""
        leader, q, v = joint.leader, self.nq, self.nv
        if isinstance(joint, Mimic):
            if leader is None or not 0 < leader < index:
                raise ModelError(f'joint "{name}" mimics joint {leader}, expected one from 1 to {index - 1}')
            q, v = self.idx_qs[leader], self.idx_vs[leader]
            self.mimicking_joints.append(index)
            self.mimicked_joints.append(leader)
        joint.setIndexes(index, q, v, self.nvExtended)
        own = vars(self)
        for x in ("q", "v", "vExtended"):
            own[f"idx_{x}s"].append(getattr(joint, f"idx_{x}"))
            own[f"n{x}s"].append(getattr(joint, f"n{x}"))
            own[f"n{x}"] += getattr(joint, f"n{x}")

    def appendBodyToJoint(self, joint_id: int, body_inertia: Inertia, body_placement: SE3 = OMITTED) -> None:
        """Add a body, at a placement in the joint's frame, to the inertia of a joint.

        Raises ModelError for an index that is not a joint's.
        """
        at = self._check_joint(joint_id)
        expected(body_inertia, Inertia, "body_inertia")
        if body_placement is not OMITTED:
            expected(body_placement, SE3, "body_placement")
        self._add_inertia(at, body_inertia, body_placement)
        vars(self)["nbodies"] += 1

    def _add_inertia(self, joint: int, inertia: Inertia, placement: SE3) -> None:
        self.inertias[joint] = self.inertias[joint] + (inertia if placement is OMITTED else placement.act(inertia))

    def getJointId(self, name: str) -> int:
        """Index of the joint of that name. njoints if there is none, ModelError in strict mode."""
        expected(name, str, "joint name")
        if name in self.names:
            return self.names.index(name)
        if strict():
            raise ModelError(missing("joint", name, self.name, self.names))
        return int(self.njoints)

    def existJointName(self, name: str) -> bool:
        """Whether a joint has that name."""
        expected(name, str, "joint name")
        return name in self.names

    @property
    def span_indexes_vector(self) -> list[Indices]:
        """For each joint the indices of v that move it."""
        own = [
            range(at, at + max(n, joint.nvExtended > n))
            for at, n, joint in zip(self.idx_vs, self.nvs, self.joints, strict=True)
        ]
        own[0] = range(0)
        return [Indices(sorted({at for k in above for at in own[k]})) for above in self.supports]

    @property
    def sparsity_pattern_vector(self) -> list[NDArray[np.bool_]]:
        """For each joint an array (nv,): whether a velocity moves it."""
        made = np.zeros((self.njoints, self.nv), bool)
        for row, span in zip(made, self.span_indexes_vector, strict=True):
            row[span] = True
        return list(made)

    def _neutral(self) -> Array:
        return np.array([x for joint in self.joints[1:] for x in joint.neutral()])

    def getChildJoints(self) -> list[int]:
        """The joints without children."""
        return Indices(k for k in range(1, self.njoints) if not self.children[k])


ATTRIBUTES = [name for name, x in vars(Tree).items() if isinstance(x, Attribute)]
ARRAYS = {x.name: x for x in vars(Tree).values() if isinstance(x, Entries)}
BY_LIMIT = {x.limit: x for x in ARRAYS.values()}


def limit(joint: str, name: str, value: Any, model: JointModel) -> Array:
    """A limit of a joint as (nq,) or (nv,) numbers."""
    if not isinstance(value, np.ndarray):
        raise ArgumentError(f'{name} of joint "{joint}" is {described(value)}, expected an array')
    n = BY_LIMIT[name].size(model)
    if value.size != n:
        raise ShapeError(f'{name} of joint "{joint}" has {value.size} numbers, expected {n}')
    return np.array(value, dtype=float).reshape(n)
