"""Model: the tree of joints with its limits, its frames and its reference configurations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from ....errors import ModelError
from ....model.robot_checks import missing
from ..coverage.strictness import strict
from ..types.arguments import OMITTED, ArgumentError, Array, expected, of_pinocchio
from ..types.bases import Copied, Registered
from ..types.containers import StdMap_String_VectorXd
from ..types.frame import ANY_FRAME, BODY, FIXED_JOINT, JOINT, Frame, FrameType
from ..types.se3 import SE3
from ..types.tracked_list import OwnedList
from .from_pinocchio import pinocchio_state
from .joint import JointModel
from .joint_tree import ARRAYS, ATTRIBUTES, BY_LIMIT, LIMITS, Indices, Tree, attribute, limit
from .numbers import Numbers
from .serialization_format import FORMAT, Stored, fill, state

__all__ = ["Model"]

FIXED = {*ATTRIBUTES} - {"name", "jointPlacements"}  # derived from others, or lists whose entries alone are assigned
COPIED = [x for x in ATTRIBUTES if x not in ("inertias", "jointPlacements")]  # one by one; those are of the numbers


class Configuration(NamedTuple):
    """An entry of ``referenceConfigurations``, as iteration yields it."""

    name: str
    q: Array

    def key(self) -> str:
        """Its name."""
        return self.name

    def data(self) -> Array:
        """Its configuration."""
        return self.q


class Configurations(StdMap_String_VectorXd):
    """Configurations by name; iteration yields pairs, as with Pinocchio's map."""

    def __iter__(self) -> Iterator[Any]:
        return (Configuration(name, q) for name, q in self.items())


class Model(Tree, Stored, Copied):
    """A robot as Pinocchio's Model holds it; see ``Tree`` for its joints.

    frames                   list of Frame
    nframes, nbodies         numbers of frames, and of appended bodies with the universe
    referenceConfigurations  configurations by name

    A model may be edited at any time; the next call sees it: ``model.armature[0] = 1``, ``model.armature = x``,
    ``model.inertias[2].mass = 3``, ``model.jointPlacements[1].translation[2] += 0.1``. Arrays read before ``addJoint``,
    and frames or joints that were replaced, no longer belong to the model: read them again.
    """

    __slots__ = ("_plans",)  # where builtins read it
    _format = FORMAT
    frames: list[Frame] = attribute("Frames on the joints, a list to write into.")
    referenceConfigurations: dict[str, Array] = attribute("Configurations by name.")

    def __init__(self, clone: Any = OMITTED) -> None:
        """A model with the universe alone, or a copy of another, also of one of Pinocchio's own class.

        Raises ModelError for a joint of Pinocchio's whose kind is not here.
        """
        if isinstance(clone, Model):
            self._copy(clone)
            return
        self._sealed = False
        super().__init__()
        universe = Frame("universe", 0, 0, SE3.Identity(), FIXED_JOINT)
        self._frames_by_name: dict[str, list[int]] | None = None  # frame indices; None after an edit
        self.frames = [universe]
        self.referenceConfigurations = Configurations()
        self._sealed = True
        if of_pinocchio(clone, "Model"):
            fill(self, pinocchio_state(clone))
        elif clone is not OMITTED:
            expected(clone, Model, "clone")

    def _copy(self, other: Model) -> None:
        """Take over copies of all that another model has, and of its LibraryModel."""
        own, given, owner = vars(self), vars(other), self._begin()
        for name in COPIED:
            x = given[name]
            kind = type(x)
            if kind is Indices:
                own[name] = Indices(x)
            elif kind is list:
                own[name] = [*map(Indices, x)]
            else:
                own[name] = x.for_owner(owner) if isinstance(x, OwnedList) else x
        own["_frames_by_name"] = None  # frame indices; None after an edit
        own["frames"] = given["frames"].for_owner(self._owner_of("_frame_placements", "_frames_by_name"))
        own["_arrays"] = {name: x.copy() for name, x in other._arrays.items()}
        self._hold(Numbers(other.njoints, other.nv, other._numbers.block.copy()))
        own["referenceConfigurations"] = Configurations(
            {name: np.array(q) for name, q in other.referenceConfigurations.items()}
        )
        library, before = given["_library"], given["_library_before"]
        own["_edited"] = other._edited or (before is not None and before.edited)
        if library is not None:
            own["_library"] = own["_library_before"] = library.copy(self._numbers.block)
        own["_sealed"] = True

    def __setattr__(self, name: str, value: Any) -> None:
        if name in FIXED and self._sealed:
            raise AttributeError(f"{name} of a Model cannot be assigned, only written into or changed by building")
        if isinstance(value, OwnedList) and value is vars(self).get(name):  # of +=, which wrote in place
            return
        if name == "name":
            expected(value, str, "name of a Model")
        if name == "jointPlacements" and self._sealed:
            self.jointPlacements.write(value)
            return
        if name == "frames":
            owner = self._owner_of("_frame_placements", "_frames_by_name")
            value = OwnedList(owner, Frame, value)
            owner.changed()
        super().__setattr__(name, value)

    nframes: Any = property(lambda self: len(self.frames), doc="Number of frames.")

    # --- building ------------------------------------------------------------------------------------------

    def addJoint(
        self, parent_id: int, joint_model: JointModel, joint_placement: SE3, joint_name: str, *limits: Any, **named: Any
    ) -> int:
        """Add a joint; returns its index.

        parent_id        index of the parent joint
        joint_model      copied
        joint_placement  SE3 in the parent's frame
        limits           none; max_effort, max_velocity, min_config, max_config; or min_effort, max_effort,
                         min_velocity, max_velocity, min_config, max_config, [config_limit_margin,] min_friction,
                         max_friction, damping: arrays of the joint's nq or nv numbers

        Raises ModelError for an index that is not a joint's, ShapeError naming a limit, ArgumentError.
        """
        parent = self._check_joint(parent_id)
        expected(joint_model, JointModel, "joint_model")
        expected(joint_placement, SE3, "joint_placement")
        expected(joint_name, str, "joint_name")
        names = LIMITS.get(len(limits) + len(named))
        if names is None or not {*names[len(limits) :]} >= {*named}:
            raise ArgumentError(f"addJoint got {len(limits) + len(named)} limits, expected 0, 4, 9 or 10")
        given = {**dict(zip(names, limits, strict=False)), **named}
        values = {BY_LIMIT[name].name: limit(joint_name, name, value, joint_model) for name, value in given.items()}
        if len(given) == 4:  # Pinocchio writes lowerVelocityLimit = upperVelocityLimit
            values |= {f"lower{kind}Limit": -values[f"upper{kind}Limit"] for kind in ("Effort", "Velocity")}
        return self._add(parent, joint_model, joint_placement, joint_name, values)

    def _add(self, parent: int, joint: JointModel, placement: SE3, name: str, values: Mapping[str, Array]) -> int:
        """Add a joint with its entries of the model's arrays by name, else the defaults; returns its index."""
        index = self._append_joint(parent, joint, placement, name)
        for array, x in ARRAYS.items():
            new = values.get(array, np.full(x.size(joint), x.default))
            if array == "armature":
                self.armature[len(self.armature) - len(new) :] = new  # a part of the numbers
            else:
                self._arrays[array] = np.concatenate([self._arrays[array], new])
        return index

    def addFrame(self, frame: Frame, append_inertia: bool = True) -> int:
        """Add a frame, and its inertia to its joint's; returns its index.

        A frame of the same name and type is not added again. Raises ModelError for a parent that does not exist.
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
            self._add_inertia(joint, frame.inertia, frame.placement)
        self.frames.append(frame)
        return len(self.frames) - 1

    def addJointFrame(self, joint_id: int, frame_id: int = 0) -> int:
        """Add a joint's frame with a parent frame (-1: that of the parent joint); returns its index."""
        joint = self._check_joint(joint_id)
        before = frame_id if frame_id >= 0 else self._frame_of(self.parents[joint])
        return self.addFrame(Frame(self.names[joint], joint, before, SE3.Identity(), JOINT))

    def addBodyFrame(self, body_name: str, parentJoint: int, body_placement: SE3, previous_frame: int = -1) -> int:
        """Add a body's frame on a joint with a parent frame (-1: the joint's); returns its index."""
        joint = self._check_joint(parentJoint)
        before = previous_frame if previous_frame >= 0 else self._frame_of(joint)
        return self.addFrame(Frame(body_name, joint, before, body_placement, BODY))

    def _frame_of(self, joint: int) -> int:
        found = self._frame(self.names[joint], JOINT | FIXED_JOINT)
        if found is None:
            raise ModelError(f'joint "{self.names[joint]}" has no frame, expected addJointFrame to be called before')
        return found

    # --- names ---------------------------------------------------------------------------------------------

    def _frames(self, name: str, kinds: int) -> list[int]:
        named = self._frames_by_name
        if named is None:
            named = self._frames_by_name = {}
            for k, frame in enumerate(self.frames):
                named.setdefault(frame.name, []).append(k)
        frames = self.frames
        return [k for k in named.get(name, ()) if frames[k].type & kinds]

    def _frame(self, name: str, kinds: int) -> int | None:
        found = self._frames(name, kinds)
        if len(found) > 1:
            listed = " and ".join(f"{k} of type {self.frames[k].type.name}" for k in found)
            raise ModelError(f'frame "{name}" is frame {listed}, expected a FrameType that leaves one of them')
        return found[0] if found else None

    def getFrameId(self, name: str, type: int = ANY_FRAME) -> int:
        """Index of the frame of that name and type.

        Returns nframes if there is none. Raises ModelError, a ValueError, if there are several, and in strict mode if
        there is none.
        """
        found = self._frame(expected(name, str, "frame name"), type)
        if found is None and strict():
            others = [self.frames[k].type.name for k in self._frames(name, ANY_FRAME)]
            if others:
                kinds = " or ".join(kind.name for kind in FrameType if kind & type)
                raise ModelError(f'frame "{name}" is of type {" and ".join(others)}, expected type {kinds}')
            names = [frame.name for frame in self.frames if frame.type & type]
            raise ModelError(missing("frame", name, self.name, names))
        return self.nframes if found is None else found

    def getBodyId(self, name: str) -> int:
        """Index of the body's frame of that name. Raises ModelError as getFrameId does."""
        return self.getFrameId(name, BODY)

    def existFrame(self, name: str, type: int = ANY_FRAME) -> bool:
        """Whether a frame has that name and type."""
        return bool(self._frames(expected(name, str, "frame name"), type))

    def existBodyName(self, name: str) -> bool:
        """Whether a body's frame has that name."""
        return self.existFrame(name, BODY)

    # --- the whole -----------------------------------------------------------------------------------------

    _state, _become, __setstate__ = state, fill, fill

    def check(self, data: Any) -> bool:
        """Whether a Data was made for a model of this size."""
        return bool(data.model is self or (len(data.oMi), len(data.oMf)) == (self.njoints, self.nframes))

    def createData(self) -> Any:
        """A Data for the results of the algorithms."""
        return Registered.classes["Data"](self)

    def hasConfigurationLimit(self) -> list[bool]:
        """Whether each coordinate can have a limit."""
        return [has for joint in self.joints[1:] for has in joint.hasConfigurationLimit]

    def hasConfigurationLimitInTangent(self) -> list[bool]:
        """Whether the coordinate of each velocity can have a limit."""
        return [has for joint in self.joints[1:] for has in joint.hasConfigurationLimitInTangent]

    def copy(self) -> Model:
        """An independent copy."""
        return Model(self)

    cast = copy  # the only scalar type is float64

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Model) and state(self) == state(other)

    __hash__ = object.__hash__

    def __reduce__(self) -> tuple[Any, ...]:
        return Model, (), state(self)

    def __repr__(self) -> str:
        lines = [f"Nb joints = {self.njoints} (nq={self.nq},nv={self.nv})"]
        lines += [f"  Joint {k} {self.names[k]}: parent={self.parents[k]}" for k in range(self.njoints)]
        return "\n".join([*lines, ""])
