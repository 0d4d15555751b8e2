"""Pinocchio: the module, its model of a robot, its result of a call."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.kinds import ANGLE, PAIR, kind_of
from ..calls.arguments import core_shape
from ..errors import SpatialDynError, literal, pip_install
from ..model.model import Frame, Joint, Model
from ..recursions import SPECS
from ..urdf.load import find_robot
from .calls import REFERENCES, Call
from .states import States

Array = NDArray[np.float64]

SYMMETRIC = ("xx", "xy", "xz", "xy", "yy", "yz", "xz", "yz", "zz")  # entries of a symmetric matrix, row by row
_CONTINUOUS = """<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/>
  <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="{axis}"/></joint></robot>"""


def pinocchio() -> Any:
    """The module. Raises SpatialDynError with the pip command if it is not installed."""
    try:
        import pinocchio as pin
    except ImportError:
        raise SpatialDynError(f"pinocchio is not installed; {pip_install('validate')}") from None
    if pin.__name__ != "pinocchio":
        raise SpatialDynError(f"pinocchio is {pin.__name__}, expected Pinocchio itself, as after its uninstall()")
    return pin


def pinocchio_model(source: Any, root: str = "fixed") -> Any:
    """Pinocchio's model of a path, URDF text or robot name. Raises SpatialDynError with the reason if it fails."""
    pin = pinocchio()
    base = (pin.JointModelFreeFlyer(),) if root == "floating" else ()
    try:
        if isinstance(source, (str, bytes)) and source[:1] in ("<", b"<"):
            return pin.buildModelFromXML(source if isinstance(source, str) else source.decode(), *base)
        return pin.buildModelFromUrdf(str(_file_of(source)), *base)
    except (ValueError, RuntimeError) as error:
        if isinstance(error, SpatialDynError):
            raise
        raise SpatialDynError(f"Pinocchio refuses {literal(str(source)[:80])}: {str(error).splitlines()[0]}") from None


def pinocchio_twin(model: Model) -> Any:
    """Pinocchio's model of a Model, made joint by joint: same order, frames, inertias, armatures and gravity.

    Raises SpatialDynError naming a joint that Pinocchio lacks: one that mimics, a planar one without (cos, sin).
    """
    pin = pinocchio()
    made = pin.Model()
    made.name, made.gravity = model.name, pin.Motion(model.gravity, np.zeros(3))
    for k, joint in enumerate(model.joints[1:], 1):
        made.addJoint(joint.parent, _pinocchio_joint(pin, model, joint), pin.SE3(joint.placement), joint.name)
        made.addJointFrame(k)
        made.appendBodyToJoint(k, _pinocchio_inertia(pin, model.bodies[joint.row]["inertia"]), pin.SE3.Identity())
    types = {"link": pin.FrameType.BODY, "joint": pin.FrameType.FIXED_JOINT}
    moving = set(model.names[1:])
    for frame in model.frames:
        if frame.kind == "link" or frame.name not in moving:
            made.addFrame(pin.Frame(frame.name, frame.joint, pin.SE3(frame.placement), types[frame.kind]))
    made.armature = model.armature
    geared = next((j.name for j in model.robot.joints if j.rotor is not None or j.shared is not None), None)
    if geared is not None:
        raise SpatialDynError(f'joint "{geared}" has a rotor, which Pinocchio lacks, expected its armature alone')
    return made


def _pinocchio_joint(pin: Any, model: Model, joint: Joint) -> Any:
    if joint.mimic is not None:
        raise SpatialDynError(f'joint "{joint.name}" mimics another, expected none (mimic=False) to compare a Model')
    kind = kind_of(joint.kind, model.options.continuous)
    if kind.turn == PAIR and kind.motion == "turn":  # its axis can be set by a URDF alone
        return pin.buildModelFromXML(_CONTINUOUS.format(axis=" ".join(map(repr, joint.axis.tolist())))).joints[1]
    if kind.motion:
        name = {"turn": "Revolute", "slide": "Prismatic", "screw": "Helical"}[kind.motion]
        pitch = (joint.pitch,) if kind.motion == "screw" else ()
        return getattr(pin, f"JointModel{name}Unaligned")(np.array(joint.axis), *pitch)
    group = {"SO(3)": "Spherical", "SE(3)": "FreeFlyer", "SE(2)": "Planar"}[kind.group]
    if kind.turn == ANGLE:
        raise SpatialDynError(
            f'joint "{joint.name}" is planar with an angle, which Pinocchio lacks, expected continuous="cos_sin"'
        )
    return getattr(pin, f"JointModel{group}")()


def _pinocchio_inertia(pin: Any, body: Any) -> Any:
    """A rigid inertia about its frame's origin as Pinocchio's, about the centre of mass."""
    m, h, I = float(body["m"]), np.array(list(body["h"])), np.array([body["I"][x] for x in SYMMETRIC]).reshape(3, 3)
    c = h / m if m > 0.0 else np.zeros(3)
    return pin.Inertia(m, c, I - m * (c @ c * np.eye(3) - np.outer(c, c)))


def _file_of(source: Any) -> Path:
    if isinstance(source, os.PathLike) or os.path.isfile(source):
        return Path(source)
    return find_robot(source)


class Peer:
    """Pinocchio's model and data, and the indices of a Model's frames in it."""

    def __init__(self, pin: Any, pin_model: Any, model: Model) -> None:
        self.pin, self.ours, self.model, self.data = pin, model, pin_model, pin_model.createData()
        kinds = {pin.FrameType.BODY: "link", pin.FrameType.JOINT: "joint", pin.FrameType.FIXED_JOINT: "joint"}
        places = {(kinds.get(frame.type), frame.name): k for k, frame in enumerate(pin_model.frames)}
        self.frames = [self._place(frame, places) for frame in model.frames]
        self.references = [getattr(pin.ReferenceFrame, reference.upper()) for reference in REFERENCES]

    def _place(self, frame: Frame, places: Mapping[tuple[str | None, str], int]) -> int:
        try:
            return places[frame.kind, frame.name]
        except KeyError:
            raise SpatialDynError(f'{frame.kind} frame "{frame.name}" is not in Pinocchio\'s model') from None

    def inputs(self, call: Call, states: States, k: int) -> list[Any]:
        """One sample as Pinocchio takes it: external forces as a StdVec_Force."""
        values: list[Any] = []
        for name in call.inputs.split():
            value = getattr(states, name)[k]
            if name == "fext":
                forces = self.pin.StdVec_Force()
                forces.extend([self.pin.Force(force) for force in value])
                value = forces
            values.append(float(value) if name == "t" else value)
        return values

    def mass_matrices(self, states: States) -> Array:
        """M (samples, nv, nv)."""
        return np.array([self.pin.crba(self.model, self.data, q) for q in states.q])

    def function(self, call: Call) -> Callable[..., Any]:
        """The function to call."""
        return getattr(self.pin, call.peer) if isinstance(call.peer, str) else partial(call.peer, self.pin)

    def arguments(self, call: Call) -> tuple[Any, ...]:
        """The arguments before the inputs."""
        return (self.model, self.data) if call.data else (self.model,)

    def __call__(self, call: Call, states: States, k: int) -> Array:
        """Pinocchio's result for one sample, in the shape of the public call's."""
        answer = self.function(call)(*self.arguments(call), *self.inputs(call, states, k))
        if not call.frame:
            found = _array(answer if call.result is None else call.result(self.data))
            return found.reshape(self._core(call)) if call.name in SPECS else found
        look = getattr(self.pin, call.frame)
        references: list[tuple[Any, ...]] = [(code,) for code in self.references[: len(call.references)]] or [()]
        all_found = np.array(
            [[_array(look(self.model, self.data, frame, *code)) for code in references] for frame in self.frames]
        )
        if call.name == "jacobian_dot_times_v":
            moved: Array = all_found.reshape((*all_found.shape[:2], 6, self.model.nv)) @ states.v[k]
            return moved
        if call.name == "frame_acceleration_derivatives":  # the first are those of the velocity
            all_found = all_found[:, :, 1:]
        return all_found.reshape((*all_found.shape[:2], *self._core(call)))

    def _core(self, call: Call) -> tuple[int, ...]:
        """Shape of one result: Pinocchio returns a matrix of one column as a vector."""
        return core_shape(self.ours, SPECS[call.name].output)


def _array(value: Any) -> Array:
    """A Pinocchio result as an array: poses (4, 4), motions and forces (6,), several of them stacked."""
    if isinstance(value, (tuple, list)):
        return np.array([_array(part) for part in value])
    for name in ("vector", "homogeneous"):
        if hasattr(value, name):
            return np.array(getattr(value, name))
    return np.array(value, dtype=float)
