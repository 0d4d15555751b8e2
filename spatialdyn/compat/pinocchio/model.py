"""Model: the tree of joints with its limits, its frames and its reference configurations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import ModelError, ShapeError
from ...model import missing
from .arguments import ArgumentError, described, expected
from .containers import StdMap_String_VectorXd
from .frame import ANY_FRAME, BODY, FIXED_JOINT, JOINT, Frame
from .joints import JointModel
from .live import live
from .owned import Owned
from .se3 import SE3
from .stored import Stored, fill, state
from .tree import Listener, Tree

Array = NDArray[np.float64]
NO_LIMIT = float(np.finfo(float).max)  # what Pinocchio writes where addJoint is given no limits

# name -> what addJoint puts there, for each coordinate or velocity
POSITIONS = {"lowerPositionLimit": -NO_LIMIT, "upperPositionLimit": NO_LIMIT, "positionLimitMargin": 0.0}
VELOCITIES = {
    "lowerEffortLimit": -NO_LIMIT,
    "upperEffortLimit": NO_LIMIT,
    "lowerVelocityLimit": -NO_LIMIT,
    "upperVelocityLimit": NO_LIMIT,
    "lowerDryFrictionLimit": 0.0,
    "upperDryFrictionLimit": 0.0,
    "damping": 0.0,
    "armature": 0.0,
    "rotorInertia": 0.0,
    "rotorGearRatio": 1.0,
}
ARRAYS = {**POSITIONS, **VELOCITIES}
FRICTION = ("min_friction", "max_friction", "damping")
BOTH = ("min_effort", "max_effort", "min_velocity", "max_velocity", "min_config", "max_config")
LIMITS = {  # the arguments of addJoint behind the name, by how many there are
    0: (),
    4: ("max_effort", "max_velocity", "min_config", "max_config"),
    9: (*BOTH, *FRICTION),
    10: (*BOTH, "config_limit_margin", *FRICTION),
}
PLACES = {
    "min_config": "lowerPositionLimit",
    "max_config": "upperPositionLimit",
    "config_limit_margin": "positionLimitMargin",
    "min_effort": "lowerEffortLimit",
    "max_effort": "upperEffortLimit",
    "min_velocity": "lowerVelocityLimit",
    "max_velocity": "upperVelocityLimit",
    "min_friction": "lowerDryFrictionLimit",
    "max_friction": "upperDryFrictionLimit",
    "damping": "damping",
}


class Configuration(NamedTuple):
    """An entry of ``referenceConfigurations``, as iterating gives it."""

    name: str
    q: Array

    def key(self) -> str:
        """Its name."""
        return self.name

    def data(self) -> Array:
        """Its configuration."""
        return self.q


class Configurations(StdMap_String_VectorXd):
    """Configurations by name; iterating gives pairs, as Pinocchio's map does."""

    def __iter__(self) -> Iterator[Any]:
        return (Configuration(name, q) for name, q in self.items())


def _array(name: str, meaning: str) -> Any:
    """An attribute that is an array of the model's; assigning copies."""

    def read(self: Model) -> Array:
        found: Array = self._arrays[name]
        return live(found, self._edited) if name == "armature" else found

    def write(self: Model, value: Any) -> None:
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
            raise ArgumentError(f"{name} is {described(value)}, expected an array of numbers")
        n = self.nq if name in POSITIONS else self.nv
        if value.shape not in ((n,), (n, 1)):
            raise ShapeError(f"{name} has shape {value.shape}, expected ({n},)")
        self._arrays[name] = np.array(value, dtype=float).reshape(n)
        if name == "armature":
            self._made = None

    return property(read, write, doc=meaning)


class Model(Tree, Stored):
    """A robot as Pinocchio's Model holds it; see ``Tree`` for its joints.

    frames                   list of Frame
    nframes, nbodies         numbers of frames, and of bodies appended with the universe
    referenceConfigurations  configurations by name
    """

    lowerPositionLimit = _array("lowerPositionLimit", "(nq,) least coordinates.")
    upperPositionLimit = _array("upperPositionLimit", "(nq,) largest coordinates.")
    positionLimitMargin = _array("positionLimitMargin", "(nq,) distance kept from the limits; without effect.")
    lowerEffortLimit = _array("lowerEffortLimit", "(nv,) least forces of the joints.")
    upperEffortLimit = _array("upperEffortLimit", "(nv,) largest forces of the joints.")
    lowerVelocityLimit = _array("lowerVelocityLimit", "(nv,) least velocities.")
    upperVelocityLimit = _array("upperVelocityLimit", "(nv,) largest velocities.")
    lowerDryFrictionLimit = _array("lowerDryFrictionLimit", "(nv,) least dry friction; without effect.")
    upperDryFrictionLimit = _array("upperDryFrictionLimit", "(nv,) largest dry friction; without effect.")
    damping = _array("damping", "(nv,) viscous friction; without effect.")
    armature = _array("armature", "(nv,) reflected inertias of the rotors, added to the diagonal of M.")
    rotorInertia = _array("rotorInertia", "(nv,) inertias of the rotors; without effect, see ``armature``.")
    rotorGearRatio = _array("rotorGearRatio", "(nv,) ratios of the gears; without effect.")
    effortLimit = upperEffortLimit
    velocityLimit = upperVelocityLimit
    friction = upperDryFrictionLimit
    createData: Any  # given by the module of Data, which stands on this one

    def __init__(self, clone: Model | None = None) -> None:
        """A model of nothing but the universe, or a copy of another."""
        super().__init__()
        self._arrays: dict[str, Array] = {name: np.empty(0) for name in ARRAYS}
        universe = Frame("universe", 0, 0, SE3.Identity(), FIXED_JOINT)
        self.frames: list[Frame] = Owned(Listener(self, "_placed"), Frame, [universe])
        self.referenceConfigurations: dict[str, Array] = Configurations()
        if clone is not None:
            fill(self, state(expected(clone, Model, "clone")))
            self.strict = clone.strict

    @property
    def nframes(self) -> int:
        """Number of frames."""
        return len(self.frames)

    # --- building ------------------------------------------------------------------------------------------

    def addJoint(
        self, parent_id: int, joint_model: JointModel, joint_placement: SE3, joint_name: str, *limits: Any, **named: Any
    ) -> int:
        """Add a joint; returns its index.

        parent_id        index of the joint that carries it
        joint_model      of which a copy is kept
        joint_placement  SE3 in the parent's frame
        limits           nothing; max_effort, max_velocity, min_config, max_config; or min_effort, max_effort,
                         min_velocity, max_velocity, min_config, max_config, [config_limit_margin,] min_friction,
                         max_friction, damping: arrays of the joint's nq or nv numbers

        Raises ModelError for an index that is no joint's, ShapeError naming a limit, ArgumentError.
        """
        parent = self._check_joint(parent_id)
        expected(joint_model, JointModel, "joint_model")
        expected(joint_placement, SE3, "joint_placement")
        expected(joint_name, str, "joint_name")
        names = LIMITS.get(len(limits) + len(named))
        if names is None or not {*names[len(limits) :]} >= {*named}:
            raise ArgumentError(f"addJoint got {len(limits) + len(named)} limits, expected 0, 4, 9 or 10")
        given = {**dict(zip(names, limits, strict=False)), **named}
        values = {PLACES[name]: _limit(joint_name, name, value, joint_model) for name, value in given.items()}
        if len(given) == 4:  # Pinocchio writes the largest velocity for the least, too
            values |= {f"lower{kind}Limit": -values[f"upper{kind}Limit"] for kind in ("Effort", "Velocity")}
        return self._add(parent, joint_model, joint_placement, joint_name, values)

    def _add(self, parent: int, joint: JointModel, placement: SE3, name: str, values: Mapping[str, Array]) -> int:
        """Add a joint whose entries of the model's arrays are given by name; returns its index."""
        index = self._hang(parent, joint, placement, name)
        for array, default in ARRAYS.items():
            n = joint.nq if array in POSITIONS else joint.nv
            self._arrays[array] = np.concatenate([self._arrays[array], values.get(array, np.full(n, default))])
        return index

    def addFrame(self, frame: Frame, append_inertia: bool = True) -> int:
        """Add a frame, and its inertia to what its joint carries; returns its index.

        A frame of the same name and type is not added again. Raises ModelError for a parent that is not there.
        """
        expected(frame, Frame, "frame")
        joint = self._check_joint(frame.parentJoint)
        if not 0 <= frame.parentFrame < self.nframes:
            raise ModelError(
                f'frame "{frame.name}" has parent frame {frame.parentFrame}, expected 0 to {self.nframes - 1}'
            )
        found = self._frame(frame.name, frame.type)
        if found is not None:
            return found
        if append_inertia:
            self._load(joint, frame.inertia, frame.placement)
        self.frames.append(frame)
        return self.nframes - 1

    def addJointFrame(self, joint_id: int, frame_id: int = 0) -> int:
        """Add the frame of a joint, behind a frame (-1: the frame of the joint's parent); returns its index."""
        joint = self._check_joint(joint_id)
        before = frame_id if frame_id >= 0 else self._frame_of(self.parents[joint])
        return self.addFrame(Frame(self.names[joint], joint, before, SE3.Identity(), JOINT))

    def addBodyFrame(self, body_name: str, parentJoint: int, body_placement: SE3, previous_frame: int = -1) -> int:
        """Add the frame of a body on a joint, behind a frame (-1: the joint's); returns its index."""
        joint = self._check_joint(parentJoint)
        before = previous_frame if previous_frame >= 0 else self._frame_of(joint)
        return self.addFrame(Frame(body_name, joint, before, body_placement, BODY))

    def _frame_of(self, joint: int) -> int:
        found = self._frame(self.names[joint], JOINT | FIXED_JOINT)
        if found is None:
            raise ModelError(f'joint "{self.names[joint]}" has no frame, expected addJointFrame to be called before')
        return found

    # --- names ---------------------------------------------------------------------------------------------

    def _frame(self, name: str, kinds: int) -> int | None:
        for k, frame in enumerate(self.frames):
            if frame.name == name and frame.type & kinds:
                return k
        return None

    def getFrameId(self, name: str, type: int = ANY_FRAME) -> int:
        """Index of the frame of that name and type. Raises ModelError if none is (nframes if not ``strict``)."""
        found = self._frame(expected(name, str, "frame name"), type)
        if found is None and self.strict:
            raise ModelError(missing("frame", name, self.name, [frame.name for frame in self.frames]))
        return self.nframes if found is None else found

    def getBodyId(self, name: str) -> int:
        """Index of the body's frame of that name. Raises ModelError if there is none (nframes if not ``strict``)."""
        return self.getFrameId(name, BODY)

    def existFrame(self, name: str, type: int = ANY_FRAME) -> bool:
        """Whether a frame has that name and type."""
        return self._frame(expected(name, str, "frame name"), type) is not None

    def existBodyName(self, name: str) -> bool:
        """Whether a body's frame has that name."""
        return self.existFrame(name, BODY)

    # --- the whole -----------------------------------------------------------------------------------------

    def check(self, data: Any) -> bool:
        """Whether a Data was made for a model of this size."""
        return bool(data.model is self or (len(data.oMi), len(data.oMf)) == (self.njoints, self.nframes))

    def hasConfigurationLimit(self) -> list[bool]:
        """For each coordinate whether it can have a limit."""
        return [has for joint in self.joints[1:] for has in joint.hasConfigurationLimit]

    def hasConfigurationLimitInTangent(self) -> list[bool]:
        """For each velocity whether its coordinate can have a limit."""
        return [has for joint in self.joints[1:] for has in joint.hasConfigurationLimitInTangent]

    def copy(self) -> Model:
        """An equal model of its own."""
        return Model(self)

    def cast(self) -> Model:
        """A copy: there is one type of number."""
        return Model(self)

    def __copy__(self) -> Model:
        return Model(self)

    def __deepcopy__(self, memo: Any) -> Model:
        return Model(self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Model) and state(self) == state(other)

    __hash__ = object.__hash__

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (state(self), self.strict)

    def __repr__(self) -> str:
        lines = [f"Nb joints = {self.njoints} (nq={self.nq},nv={self.nv})"]
        lines += [f"  Joint {k} {self.names[k]}: parent={self.parents[k]}" for k in range(self.njoints)]
        return "\n".join([*lines, ""])


def _restored(given: Mapping[str, Any], strict: bool) -> Model:
    """The model of a state."""
    model = Model()
    fill(model, given)
    model.strict = strict
    return model


def _limit(joint: str, name: str, value: Any, model: JointModel) -> Array:
    """A limit of a joint as nq or nv numbers."""
    if not isinstance(value, np.ndarray):
        raise ArgumentError(f'{name} of joint "{joint}" is {described(value)}, expected an array')
    n = model.nq if "config" in name else model.nv
    if value.size != n:
        raise ShapeError(f'{name} of joint "{joint}" has {value.size} numbers, expected {n}')
    return np.array(value, dtype=float).reshape(n)
