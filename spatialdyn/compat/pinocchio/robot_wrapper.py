"""RobotWrapper: a model, its data, and the functions of this package as methods."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .algorithms import centroidal, configuration, dynamics, jacobians, kinematics
from .coverage.coverage import OutOfScopeAttributeError, OutOfScopeError
from .model.geometry import buildModelsFromUrdf, createDatas
from .model.model import Model
from .model.model_surgery import buildReducedModel
from .types.arguments import ValueRuntimeError
from .types.frame import LOCAL
from .types.inertia import Inertia
from .types.motion import Force, Motion
from .types.se3 import SE3
from .visualize import MeshcatVisualizer

__all__ = ["RobotWrapper"]

Array = NDArray[np.float64]
OTHER_FILES = "initFromMJCF initFromSDF"


class RobotWrapper:
    """A robot: ``RobotWrapper(model)`` or ``RobotWrapper.BuildFromURDF(filename, package_dirs, root_joint)``.

    model, data        a Model and its Data; ``rebuildData`` makes a new Data after joints or frames were added
    q0, v0             the neutral configuration, and zero velocity
    index in methods   of a joint; in those whose name begins with frame, of a frame

    Methods call the function that their docstring names, on the robot's model and data.
    """

    _instead: ClassVar[dict[str, str]] = {
        **dict.fromkeys(OTHER_FILES.split(), "only URDFs are read, expected BuildFromURDF"),
    }

    def __init__(
        self,
        model: Model | None = None,
        collision_model: Any = None,
        visual_model: Any = None,
        constraint_models: Any = None,
        verbose: bool = False,
    ) -> None:
        self.model = Model() if model is None else model
        self.collision_model, self.visual_model = collision_model, visual_model
        self.constraint_models = constraint_models
        self.rebuildData()
        self.q0, self.v0 = configuration.neutral(self.model), np.zeros(self.nv)
        self.viz: Any = None

    @staticmethod
    def BuildFromURDF(filename: Any, *arguments: Any, **named: Any) -> RobotWrapper:
        """The robot of a URDF file; arguments as of ``buildModelsFromUrdf``."""
        robot = RobotWrapper()
        robot.initFromURDF(filename, *arguments, **named)
        return robot

    @staticmethod
    def BuildFromMJCF(filename: Any, *arguments: Any, **named: Any) -> RobotWrapper:
        """Raises NotImplementedError: only URDFs are read."""
        raise NotImplementedError("BuildFromMJCF: only URDFs are read, expected BuildFromURDF")

    @staticmethod
    def BuildFromSDF(filename: Any, *arguments: Any, **named: Any) -> RobotWrapper:
        """Raises NotImplementedError: only URDFs are read."""
        raise NotImplementedError("BuildFromSDF: only URDFs are read, expected BuildFromURDF")

    def initFromURDF(self, filename: Any, *arguments: Any, **named: Any) -> None:
        """Load a URDF file into this object; arguments as of ``buildModelsFromUrdf``."""
        RobotWrapper.__init__(self, *buildModelsFromUrdf(filename, *arguments, **named))

    def rebuildData(self) -> None:
        """Make a new Data for the model as it is now."""
        self.data, self.collision_data, self.visual_data = createDatas(
            self.model, self.collision_model, self.visual_model
        )

    def buildReducedRobot(
        self, list_of_joints_to_lock: Iterable[int | str], reference_configuration: Any = None
    ) -> RobotWrapper:
        """The robot with joints, given by name or index, locked at a configuration, the neutral one by default."""
        joints = [self.model.getJointId(x) if isinstance(x, str) else x for x in list_of_joints_to_lock]
        q = configuration.neutral(self.model) if reference_configuration is None else reference_configuration
        return RobotWrapper(buildReducedModel(self.model, joints, q), self.collision_model, self.visual_model)

    def __getattr__(self, name: str) -> Any:
        if name in self._instead:
            raise OutOfScopeAttributeError(f"{name}: {self._instead[name]}")
        raise AttributeError(f"a RobotWrapper has no attribute {name!r}")

    # --- viewers: see ``visualize`` --------------------------------------------------------------------------

    @property
    def viewer(self) -> Any:
        """The visualizer's viewer; None if there is none."""
        return None if self.viz is None else self.viz.viewer

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

    def loadViewerModel(self, *arguments: Any, **named: Any) -> None:
        """Call the visualizer's method of this name."""
        self._visualizer().loadViewerModel(*arguments, **named)

    def display(self, q: Any) -> None:
        """Call the visualizer's method of this name."""
        self._visualizer().display(q)

    def displayCollisions(self, visibility: bool) -> None:
        """Call the visualizer's method of this name."""
        self._visualizer().displayCollisions(visibility)

    def displayVisuals(self, visibility: bool) -> None:
        """Call the visualizer's method of this name."""
        self._visualizer().displayVisuals(visibility)

    def getViewerNodeName(self, geometry_object: Any, geometry_type: Any) -> Any:
        """Call the visualizer's method of this name."""
        return self._visualizer().getViewerNodeName(geometry_object, geometry_type)

    def play(self, q_trajectory: Any, dt: float) -> None:
        """Call the visualizer's method of this name."""
        self._visualizer().play(q_trajectory, dt)

    @property
    def nq(self) -> int:
        """Number of coordinates."""
        return self.model.nq

    @property
    def nv(self) -> int:
        """Number of velocities."""
        return self.model.nv

    def index(self, name: str) -> int:
        """Index of the joint of that name."""
        return self.model.getJointId(name)

    # --- the robot as a whole ------------------------------------------------------------------------------

    def com(self, q: Any = None, v: Any = None, a: Any = None) -> Any:
        """Centre of mass; with v the tuple (position, velocity), with a (position, velocity, acceleration)."""
        if q is None:
            centroidal.centerOfMass(self.model, self.data)
            return self.data.com[0]
        if v is None:
            return centroidal.centerOfMass(self.model, self.data, q)
        if a is None:
            centroidal.centerOfMass(self.model, self.data, q, v)
            return self.data.com[0], self.data.vcom[0]
        centroidal.centerOfMass(self.model, self.data, q, v, a)
        return self.data.com[0], self.data.vcom[0], self.data.acom[0]

    def vcom(self, q: Any, v: Any) -> Array:
        """Velocity of the centre of mass."""
        centroidal.centerOfMass(self.model, self.data, q, v)
        found: Array = self.data.vcom[0]
        return found

    def acom(self, q: Any, v: Any, a: Any) -> Array:
        """Acceleration of the centre of mass."""
        centroidal.centerOfMass(self.model, self.data, q, v, a)
        found: Array = self.data.acom[0]
        return found

    def Jcom(self, q: Any) -> Array:
        """``jacobianCenterOfMass``."""
        return centroidal.jacobianCenterOfMass(self.model, self.data, q)

    def centroidalMomentum(self, q: Any, v: Any) -> Force:
        """``computeCentroidalMomentum``."""
        return centroidal.computeCentroidalMomentum(self.model, self.data, q, v)

    def centroidalMap(self, q: Any) -> Any:
        """``computeCentroidalMap``."""
        return centroidal.computeCentroidalMap(self.model, self.data, q)

    def centroidal(self, q: Any, v: Any) -> tuple[Force, Array, Inertia]:
        """``ccrba``: momentum hg, map Ag and inertia Ig."""
        centroidal.ccrba(self.model, self.data, q, v)
        return self.data.hg, self.data.Ag, self.data.Ig

    def centroidalMomentumVariation(self, q: Any, v: Any, a: Any) -> Force:
        """``computeCentroidalMomentumTimeVariation``."""
        return centroidal.computeCentroidalMomentumTimeVariation(self.model, self.data, q, v, a)

    # --- dynamics ------------------------------------------------------------------------------------------

    def mass(self, q: Any) -> Any:
        """``crba``: the mass matrix."""
        return dynamics.crba(self.model, self.data, q)

    def nle(self, q: Any, v: Any) -> Any:
        """``nonLinearEffects``."""
        return dynamics.nonLinearEffects(self.model, self.data, q, v)

    def gravity(self, q: Any) -> Any:
        """``computeGeneralizedGravity``."""
        return dynamics.computeGeneralizedGravity(self.model, self.data, q)

    # --- joints --------------------------------------------------------------------------------------------

    def forwardKinematics(self, q: Any, v: Any = None, a: Any = None) -> None:
        """``forwardKinematics``."""
        kinematics.forwardKinematics(self.model, self.data, q, v, a)

    def placement(self, q: Any, index: int, update_kinematics: bool = True) -> SE3:
        """Pose of a joint in the world."""
        if update_kinematics:
            kinematics.forwardKinematics(self.model, self.data, q)
        found: SE3 = self.data.oMi[index]
        return found

    def velocity(
        self, q: Any, v: Any, index: int, update_kinematics: bool = True, reference_frame: Any = LOCAL
    ) -> Motion:
        """``getVelocity``, after forwardKinematics if ``update_kinematics``."""
        if update_kinematics:
            kinematics.forwardKinematics(self.model, self.data, q, v)
        return kinematics.getVelocity(self.model, self.data, index, reference_frame)

    def acceleration(
        self, q: Any, v: Any, a: Any, index: int, update_kinematics: bool = True, reference_frame: Any = LOCAL
    ) -> Motion:
        """``getAcceleration``, after forwardKinematics if ``update_kinematics``."""
        if update_kinematics:
            kinematics.forwardKinematics(self.model, self.data, q, v, a)
        return kinematics.getAcceleration(self.model, self.data, index, reference_frame)

    def classicalAcceleration(
        self, q: Any, v: Any, a: Any, index: int, update_kinematics: bool = True, reference_frame: Any = LOCAL
    ) -> Motion:
        """``getClassicalAcceleration``, after forwardKinematics if ``update_kinematics``."""
        if update_kinematics:
            kinematics.forwardKinematics(self.model, self.data, q, v, a)
        return kinematics.getClassicalAcceleration(self.model, self.data, index, reference_frame)

    def computeJointJacobian(self, q: Any, index: int) -> Array:
        """``computeJointJacobian``."""
        return jacobians.computeJointJacobian(self.model, self.data, q, index)

    def getJointJacobian(self, index: int, rf_frame: Any = LOCAL) -> Array:
        """``getJointJacobian``."""
        return jacobians.getJointJacobian(self.model, self.data, index, rf_frame)

    def computeJointJacobians(self, q: Any) -> Array:
        """``computeJointJacobians``."""
        return jacobians.computeJointJacobians(self.model, self.data, q)

    # --- frames --------------------------------------------------------------------------------------------

    def framesForwardKinematics(self, q: Any) -> None:
        """``framesForwardKinematics``."""
        kinematics.framesForwardKinematics(self.model, self.data, q)

    def framePlacement(self, q: Any, index: int, update_kinematics: bool = True) -> SE3:
        """Pose of a frame in the world."""
        if update_kinematics:
            kinematics.forwardKinematics(self.model, self.data, q)
        return kinematics.updateFramePlacement(self.model, self.data, index)

    def frameVelocity(
        self, q: Any, v: Any, index: int, update_kinematics: bool = True, reference_frame: Any = LOCAL
    ) -> Motion:
        """``getFrameVelocity``, after forwardKinematics if ``update_kinematics``."""
        if update_kinematics:
            kinematics.forwardKinematics(self.model, self.data, q, v)
        return kinematics.getFrameVelocity(self.model, self.data, index, reference_frame)

    def frameAcceleration(
        self, q: Any, v: Any, a: Any, index: int, update_kinematics: bool = True, reference_frame: Any = LOCAL
    ) -> Motion:
        """``getFrameAcceleration``, after forwardKinematics if ``update_kinematics``."""
        if update_kinematics:
            kinematics.forwardKinematics(self.model, self.data, q, v, a)
        return kinematics.getFrameAcceleration(self.model, self.data, index, reference_frame)

    def frameClassicalAcceleration(
        self, q: Any, v: Any, a: Any, index: int, update_kinematics: bool = True, reference_frame: Any = LOCAL
    ) -> Motion:
        """``getFrameClassicalAcceleration``, after forwardKinematics if ``update_kinematics``."""
        if update_kinematics:
            kinematics.forwardKinematics(self.model, self.data, q, v, a)
        return kinematics.getFrameClassicalAcceleration(self.model, self.data, index, reference_frame)

    def getFrameJacobian(self, frame_id: int, rf_frame: Any = LOCAL) -> Array:
        """``getFrameJacobian``."""
        return jacobians.getFrameJacobian(self.model, self.data, frame_id, rf_frame)

    def computeFrameJacobian(self, q: Any, frame_id: int) -> Array:
        """``computeFrameJacobian``."""
        return jacobians.computeFrameJacobian(self.model, self.data, q, frame_id)

    def updateGeometryPlacements(self, q: Any = None, visual: bool = False) -> None:
        """Raises OutOfScopeError: geometry is out of scope."""
        raise OutOfScopeError("updateGeometryPlacements: geometry is out of scope of spatialdyn; place it by data.oMi")
