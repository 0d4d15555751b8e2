"""``pinocchio.casadi``: the names most used, as expressions of CasADi, SX or MX, by ``spatialdyn.specialize``.

Numbers of a Model are constants. Derivatives are by entries of q: step quaternions and pairs by ``integrate``.
"""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace as Data
from typing import Any

from ...algebra.euclidean import Mat3
from ...calls import dynamics
from ...calls.specialize import specialize
from ...engines.programs.record.program import Program
from ...engines.programs.record.tracer import Tape
from ...interop.casadi import walk
from ...interop.frameworks import framework
from ..native import operators
from .model.library_model import library_model


class Model:
    """A copy of a Model, whose numbers become constants: ``Model(model)``. Its attributes are the model's."""

    def __init__(self, model: Any) -> None:
        self._model = model.copy()

    def __getattr__(self, name: str) -> Any:
        return getattr(vars(self).get("_model"), name)

    createData = staticmethod(Data)  # calls write tau, ddq, M, Minv, g, nle, oMi, oMf to it


@lru_cache(maxsize=64)
def _function(model: Any, call: str) -> Any:
    return specialize(model, getattr(dynamics, call)).to_casadi()


def _call(call: str, field: str = "") -> Any:
    """A function ``(model, data, ...)`` that also writes a field of data; without a field it takes no data."""

    def function(model: Model, *arguments: Any) -> Any:
        found = _function(library_model(model._model).model, call)(*arguments[bool(field) :])
        if field:
            setattr(arguments[0], field, found)
        return found

    function.__doc__ = f"``spatialdyn.{call}`` as an expression{', also data.' * bool(field)}{field}."
    return function


rnea, aba, crba = _call("rnea", "tau"), _call("aba", "ddq"), _call("crba", "M")
computeMinverse, computeGeneralizedGravity = _call("minverse", "Minv"), _call("generalized_gravity", "g")
nonLinearEffects, integrate, difference = _call("nonlinear_effects", "nle"), _call("integrate"), _call("difference")


def forwardKinematics(model: Model, data: Data, q: Any) -> None:
    """Write ``data.oMi``, the poses of the joints: rotation (3, 3), translation (3, 1), homogeneous (4, 4)."""
    library = library_model(model._model)
    rows = _function(library.model, "forward_kinematics")(q)
    data.oMi = [_pose(rows[int(k), :].reshape((4, 4)).T) for k in library.joint_map]


def framesForwardKinematics(model: Model, data: Data, q: Any) -> None:
    """``forwardKinematics``, and ``data.oMf``, the poses of the frames."""
    forwardKinematics(model, data, q)
    data.oMf = [_pose(data.oMi[x.parentJoint].homogeneous @ x.placement.homogeneous) for x in model.frames]


def _pose(X: Any) -> Any:
    return Data(homogeneous=X, rotation=X[:3, :3], translation=X[:3, 3])


def log3(R: Any) -> Any:
    """The rotation vector (3, 1) [rad], of length up to π, of a rotation (3, 3)."""
    casadi, tape = framework("casadi"), Tape()
    x, log = casadi.SX.sym("R", 3, 3), operators.log_matrix(Mat3(*map(tape.input, range(9))))
    lines = walk(casadi, Program(tape, log, 9), [x[k // 3, k % 3] for k in range(9)])
    return casadi.Function("log3", [x], [casadi.vertcat(*lines)])(R)
