"""RobotWrapper: a model, its data, and the functions of this package as methods."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from inspect import Parameter, Signature
from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np

from .algorithms import calls, collisions, configuration, jacobians, kinematics
from .coverage.coverage import refused
from .data.data import library_of
from .model.geometry import createDatas
from .model.geometry_from_mjcf import buildModelsFromMJCF
from .model.geometry_from_urdf import buildModelsFromUrdf
from .model.model import Model
from .model.model_surgery import buildReducedModel
from .types.arguments import ValueRuntimeError, of_pinocchio
from .types.frame import LOCAL
from .visualize.visualizers import Visualizer

__all__ = ["RobotWrapper"]


class RobotWrapper:
    """A robot: ``RobotWrapper(model)`` or ``RobotWrapper.BuildFromURDF(filename, package_dirs, root_joint)``.

    model, data        a Model, one of Pinocchio's own class converted, and its Data; ``rebuildData`` makes a new Data
                       after joints or frames were added
    q0, v0             the neutral configuration, and zero velocity
    index in methods   of a joint; in those whose name begins with frame, of a frame

    Methods call the function that their docstring names, on the robot's model and data.
    """

    nq = property(lambda self: self.model.nq, doc="Number of coordinates.")
    nv = property(lambda self: self.model.nv, doc="Number of velocities.")

    def __init__(
        self,
        model: Any = None,
        collision_model: Any = None,
        visual_model: Any = None,
        constraint_models: Any = None,
        verbose: bool = False,
    ) -> None:
        self.model = Model(model) if of_pinocchio(model, "Model") else Model() if model is None else model
        self.collision_model, self.visual_model = collision_model, visual_model
        self.constraint_models = constraint_models
        self.rebuildData()
        self.q0, self.v0 = configuration.neutral(self.model), np.zeros(self.nv)
        self.viz: Any = None

    @staticmethod
    def BuildFromURDF(filename: Any, *arguments: Any, **named: Any) -> RobotWrapper:
        """The robot of a URDF file; arguments as of ``buildModelsFromUrdf``."""
        return RobotWrapper(*buildModelsFromUrdf(filename, *arguments, **named))

    @staticmethod
    def BuildFromMJCF(filename: Any, *arguments: Any, **named: Any) -> RobotWrapper:
        """The robot of an MJCF file (pip install mujoco); arguments as of ``buildModelsFromMJCF``."""
        robot = RobotWrapper()
        robot.initFromMJCF(filename, *arguments, **named)
        return robot

    BuildFromSDF, initFromSDF = refused("RobotWrapper.BuildFromSDF"), refused("RobotWrapper.initFromSDF")

    def updateGeometryPlacements(self, q: Any = None, visual: bool = False) -> None:
        """Place the collision geometry, or the visual one, at q, or by ``data.oMi`` as it is."""
        which = "visual" if visual else "collision"
        geometry, data = getattr(self, f"{which}_model"), getattr(self, f"{which}_data")
        if geometry is None:
            raise ValueRuntimeError(f"the robot has no {which}_model, expected one")
        collisions.updateGeometryPlacements(self.model, self.data, geometry, data, q)

    def initFromURDF(self, filename: Any, *arguments: Any, **named: Any) -> None:
        """Load a URDF file into this object; arguments as of ``buildModelsFromUrdf``."""
        RobotWrapper.__init__(self, *buildModelsFromUrdf(filename, *arguments, **named))

    def initFromMJCF(self, filename: Any, *arguments: Any, **named: Any) -> None:
        """Load an MJCF file into this object; arguments as of ``buildModelsFromMJCF``."""
        model, constraints, collision, visual = buildModelsFromMJCF(filename, *arguments, **named)
        RobotWrapper.__init__(self, model, collision, visual, constraints)

    def rebuildData(self) -> None:
        """Make a new Data for the model as it is now."""
        models = self.model, self.collision_model, self.visual_model
        self.data, self.collision_data, self.visual_data = createDatas(*models)

    def buildReducedRobot(
        self, list_of_joints_to_lock: Iterable[int | str], reference_configuration: Any = None
    ) -> RobotWrapper:
        """The robot with joints, given by name or index, locked at a configuration, the neutral one by default."""
        joints = [self.model.getJointId(x) if isinstance(x, str) else x for x in list_of_joints_to_lock]
        q = configuration.neutral(self.model) if reference_configuration is None else reference_configuration
        given = [x for x in (self.collision_model, self.visual_model) if x is not None]
        model, shapes = buildReducedModel(self.model, given, joints, q)
        made = iter(shapes)
        collision = None if self.collision_model is None else next(made)
        return RobotWrapper(model, collision, None if self.visual_model is None else next(made))

    def index(self, name: str) -> int:
        """Index of the joint of that name."""
        return self.model.getJointId(name)

    def com(self, q: Any = None, v: Any = None, a: Any = None) -> Any:
        """Centre of mass; with v the tuple (position, velocity), with a (position, velocity, acceleration)."""
        if q is None:
            calls.centerOfMass(self.model, self.data)
            return self.data.com[0]
        found = calls.centerOfMass(self.model, self.data, *_given(q, v, a))
        more = [] if v is None else [self.data.vcom[0]] if a is None else [self.data.vcom[0], self.data.acom[0]]
        return (self.data.com[0], *more) if more else found

    def vcom(self, q: Any, v: Any) -> Any:
        """``centerOfMass``: ``data.vcom[0]``."""
        calls.centerOfMass(self.model, self.data, q, v)
        return self.data.vcom[0]

    def acom(self, q: Any, v: Any, a: Any) -> Any:
        """``centerOfMass``: ``data.acom[0]``."""
        calls.centerOfMass(self.model, self.data, q, v, a)
        return self.data.acom[0]

    def centroidal(self, q: Any, v: Any) -> Any:
        """``ccrba``: ``data.hg, Ag, Ig``."""
        calls.ccrba(self.model, self.data, q, v)
        return self.data.hg, self.data.Ag, self.data.Ig

    def forwardKinematics(self, q: Any, v: Any = None, a: Any = None) -> None:
        """``forwardKinematics``."""
        calls.forwardKinematics(self.model, self.data, *_given(q, v, a))

    def placement(self, q: Any, index: int, update_kinematics: bool = True) -> Any:
        """``data.oMi[index]``, after forwardKinematics if ``update_kinematics``."""
        library_of(self.model, self.data)
        if update_kinematics:
            calls.forwardKinematics(self.model, self.data, q)
        return self.data.oMi[index]

    # --- viewers: see ``visualize`` --------------------------------------------------------------------------

    viewer = property(lambda self: getattr(self.viz, "viewer", None), doc="The visualizer's viewer; None without one.")

    def setVisualizer(self, visualizer: Any, init: bool = True, copy_models: bool = False) -> None:
        """Set the visualizer; ``init`` calls its constructor with this robot's models."""
        if init:
            visualizer.__init__(self.model, self.collision_model, self.visual_model, copy_models)
        self.viz = visualizer

    def initViewer(self, share_data: bool = True, *arguments: Any, **named: Any) -> None:
        """Call the visualizer's ``initViewer``; without a visualizer one of ``Visualizer.default()`` is made."""
        if self.viz is None:
            data = (self.data, self.collision_data, self.visual_data) if share_data else (None, None, None)
            models = self.model, self.collision_model, self.visual_model
            self.viz = Visualizer.default()(*models, not share_data, *data)
        self.viz.initViewer(*arguments, **named)

    def _visualizer(self) -> Any:
        if self.viz is None:
            raise ValueRuntimeError("the robot has no visualizer, expected initViewer or setVisualizer before")
        return self.viz


def _given(*state: Any) -> tuple[Any, ...]:
    """The arrays before the first None."""
    return tuple(takewhile(lambda x: x is not None, state))


# --- methods that call a function, or the visualizer's method of their name ----------------------------------


class Method(NamedTuple):
    """A method: its name, the function that it calls on the robot's model and data, and its parameters.

    moved  so many parameters are the state at which it calls forwardKinematics first, unless update_kinematics is
           False; the function gets the others
    """

    name: str
    call: Callable[..., Any]
    parameters: tuple[str, ...]
    moved: int = 0


DEFAULTS = {"update_kinematics": True, "reference_frame": LOCAL, "rf_frame": LOCAL}
Q, QV, QVA = ("q",), ("q", "v"), ("q", "v", "a")
PLACED, MOVED = ("index", "update_kinematics"), ("index", "update_kinematics", "reference_frame")
METHODS = (
    Method("Jcom", calls.jacobianCenterOfMass, Q),
    Method("centroidalMomentum", calls.computeCentroidalMomentum, QV),
    Method("centroidalMap", calls.computeCentroidalMap, Q),
    Method("centroidalMomentumVariation", calls.computeCentroidalMomentumTimeVariation, QVA),
    Method("mass", calls.crba, Q),
    Method("nle", calls.nonLinearEffects, QV),
    Method("gravity", calls.computeGeneralizedGravity, Q),
    Method("velocity", calls.getVelocity, (*QV, *MOVED), 2),
    Method("acceleration", calls.getAcceleration, (*QVA, *MOVED), 3),
    Method("classicalAcceleration", calls.getClassicalAcceleration, (*QVA, *MOVED), 3),
    Method("computeJointJacobian", jacobians.computeJointJacobian, (*Q, "index")),
    Method("getJointJacobian", calls.getJointJacobian, ("index", "rf_frame")),
    Method("computeJointJacobians", calls.computeJointJacobians, Q),
    Method("framesForwardKinematics", kinematics.framesForwardKinematics, Q),
    Method("framePlacement", kinematics.updateFramePlacement, (*Q, *PLACED), 1),
    Method("frameVelocity", calls.getFrameVelocity, (*QV, *MOVED), 2),
    Method("frameAcceleration", calls.getFrameAcceleration, (*QVA, *MOVED), 3),
    Method("frameClassicalAcceleration", calls.getFrameClassicalAcceleration, (*QVA, *MOVED), 3),
    Method("getFrameJacobian", calls.getFrameJacobian, ("frame_id", "rf_frame")),
    Method("computeFrameJacobian", jacobians.computeFrameJacobian, (*Q, "frame_id")),
)


def _method(row: Method) -> Any:
    """The method of a row, named and documented."""
    name, call, parameters, moved = row
    kind, empty = Parameter.POSITIONAL_OR_KEYWORD, Parameter.empty
    signature = Signature([Parameter(x, kind, default=DEFAULTS.get(x, empty)) for x in ("self", *parameters)])
    defaults = [DEFAULTS[x] for x in parameters if x in DEFAULTS]
    least = len(parameters) - len(defaults)

    def method(self: RobotWrapper, *given: Any, **named: Any) -> Any:
        if named or not least <= len(given) <= len(parameters):
            bound = signature.bind(self, *given, **named)
            bound.apply_defaults()
            given = bound.args[1:]
        values = (*given, *defaults[len(given) - least :])
        if moved:
            state, (index, moves, *reference) = values[:moved], values[moved:]
            if moves:
                calls.forwardKinematics(self.model, self.data, *state)
            values = (index, *reference)
        return call(self.model, self.data, *values)

    method.__name__, method.__qualname__ = name, f"RobotWrapper.{name}"
    after = ", after forwardKinematics if ``update_kinematics``" * (moved > 0)
    method.__doc__ = f"``{call.__name__}``{after}."
    method.__signature__ = signature  # type: ignore[attr-defined]
    return method


def _of_visualizer(name: str) -> Any:
    def method(self: RobotWrapper, *arguments: Any, **named: Any) -> Any:
        return getattr(self._visualizer(), name)(*arguments, **named)

    method.__name__, method.__qualname__, method.__doc__ = name, f"RobotWrapper.{name}", "The visualizer's method."
    return method


for _row in METHODS:
    setattr(RobotWrapper, _row.name, _method(_row))
for _name in ("loadViewerModel", "display", "displayCollisions", "displayVisuals", "getViewerNodeName", "play"):
    setattr(RobotWrapper, _name, _of_visualizer(_name))
