"""RobotWrapper: a model, its data, and the functions of this package as methods."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from ...engines.compiled.generated import function_from_text
from .algorithms import calls, collisions, configuration, jacobians, kinematics
from .coverage.coverage import refused
from .model.geometry import createDatas
from .model.geometry_from_mjcf import buildModelsFromMJCF
from .model.geometry_from_urdf import buildModelsFromUrdf
from .model.model import Model
from .model.model_surgery import buildReducedModel
from .types.arguments import ValueRuntimeError, of_pinocchio
from .types.frame import LOCAL
from .visualize.visualizers import MeshcatVisualizer

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
        found = calls.centerOfMass(self.model, self.data, q, v, a)
        more = [] if v is None else [self.data.vcom[0]] if a is None else [self.data.vcom[0], self.data.acom[0]]
        return (self.data.com[0], *more) if more else found

    # --- viewers: see ``visualize`` --------------------------------------------------------------------------

    viewer = property(lambda self: getattr(self.viz, "viewer", None), doc="The visualizer's viewer; None without one.")

    def setVisualizer(self, visualizer: Any, init: bool = True, copy_models: bool = False) -> None:
        """Set the visualizer; ``init`` calls its constructor with this robot's models."""
        if init:
            visualizer.__init__(self.model, self.collision_model, self.visual_model, copy_models)
        self.viz = visualizer

    def initViewer(self, share_data: bool = True, *arguments: Any, **named: Any) -> None:
        """Call the visualizer's ``initViewer``; without a visualizer a MeshcatVisualizer is made."""
        if self.viz is None:
            data = (self.data, self.collision_data, self.visual_data) if share_data else (None, None, None)
            models = self.model, self.collision_model, self.visual_model
            self.viz = MeshcatVisualizer(*models, not share_data, *data)
        self.viz.initViewer(*arguments, **named)

    def _visualizer(self) -> Any:
        if self.viz is None:
            raise ValueRuntimeError("the robot has no visualizer, expected initViewer or setVisualizer before")
        return self.viz


# --- methods that call a function, or the visualizer's method of their name ----------------------------------

# method(parameters) -> function(what it is passed after model and data); fields of the data after the call that the
# method returns. A method with update_kinematics calls forwardKinematics first, with the parameters before ``index``.
_MOVED = "update_kinematics=True, reference_frame=LOCAL"
_METHODS = f"""
vcom(q, v) -> centerOfMass(q, v); vcom[0]
acom(q, v, a) -> centerOfMass(q, v, a); acom[0]
Jcom(q) -> jacobianCenterOfMass(q)
centroidalMomentum(q, v) -> computeCentroidalMomentum(q, v)
centroidalMap(q) -> computeCentroidalMap(q)
centroidal(q, v) -> ccrba(q, v); hg; Ag; Ig
centroidalMomentumVariation(q, v, a) -> computeCentroidalMomentumTimeVariation(q, v, a)
mass(q) -> crba(q)
nle(q, v) -> nonLinearEffects(q, v)
gravity(q) -> computeGeneralizedGravity(q)
forwardKinematics(q, v=None, a=None) -> forwardKinematics(q, v, a)
placement(q, index, update_kinematics=True) -> library_of(); oMi[index]
velocity(q, v, index, {_MOVED}) -> getVelocity(index, reference_frame)
acceleration(q, v, a, index, {_MOVED}) -> getAcceleration(index, reference_frame)
classicalAcceleration(q, v, a, index, {_MOVED}) -> getClassicalAcceleration(index, reference_frame)
computeJointJacobian(q, index) -> computeJointJacobian(q, index)
getJointJacobian(index, rf_frame=LOCAL) -> getJointJacobian(index, rf_frame)
computeJointJacobians(q) -> computeJointJacobians(q)
framesForwardKinematics(q) -> framesForwardKinematics(q)
framePlacement(q, index, update_kinematics=True) -> updateFramePlacement(index)
frameVelocity(q, v, index, {_MOVED}) -> getFrameVelocity(index, reference_frame)
frameAcceleration(q, v, a, index, {_MOVED}) -> getFrameAcceleration(index, reference_frame)
frameClassicalAcceleration(q, v, a, index, {_MOVED}) -> getFrameClassicalAcceleration(index, reference_frame)
getFrameJacobian(frame_id, rf_frame=LOCAL) -> getFrameJacobian(frame_id, rf_frame)
computeFrameJacobian(q, frame_id) -> computeFrameJacobian(q, frame_id)
loadViewerModel(*arguments, **named) -> visualizer
display(q) -> visualizer
displayCollisions(visibility) -> visualizer
displayVisuals(visibility) -> visualizer
getViewerNodeName(geometry_object, geometry_type) -> visualizer
play(q_trajectory, dt) -> visualizer
"""


def _method(row: str) -> Any:
    """The method of a row, named and documented."""
    head, call, *fields = re.split(" -> |; ", row)
    name, _, parameters = head.rstrip(")").partition("(")
    function, _, passed = call.partition("(")
    moves, state = "update_kinematics" in parameters, parameters.partition("index")[0]
    text = [f"def {name}(self, {parameters}):"]
    text += ["    if update_kinematics:", f"        placed(self.model, self.data, {state})"] * moves
    if call == "visualizer":
        text, about = [*text, f"    return self._visualizer().{name}({parameters})"], "The visualizer's method"
    else:
        found = ", ".join(f"self.data.{x}" for x in fields)
        text += [f"    found = call(self.model, self.data, {passed}", f"    return {found or 'found'}"]
        about = f"``{function}``" + (f": ``data.{', '.join(fields)}``" if fields else "")
    scope = {"LOCAL": LOCAL, "placed": calls.forwardKinematics, "call": _FUNCTIONS.get(function)}
    method = function_from_text(name, text, {"__name__": __name__, **scope}, f"RobotWrapper.{name}")
    after = ", after forwardKinematics if ``update_kinematics``" * moves
    method.__qualname__, method.__doc__ = f"RobotWrapper.{name}", f"{about}{after}."
    return method


_FUNCTIONS = {name: x for at in (calls, jacobians, kinematics) for name, x in vars(at).items()}
for _row in _METHODS.strip().split("\n"):
    setattr(RobotWrapper, _row.partition("(")[0], _method(_row))
