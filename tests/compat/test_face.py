"""The table of names, and the stub through which editors and type checkers see its functions.

``python tests/compat/test_face.py`` writes the stub anew after a row has changed.
"""

from __future__ import annotations

import ctypes
import gc
import inspect
import pickle
import weakref
from pathlib import Path

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as pin
from spatialdyn.compat.pinocchio.algorithms import calls
from spatialdyn.compat.pinocchio.algorithms.table import FACES
from spatialdyn.compat.pinocchio.data.face import REQUIRED, Face, Input
from spatialdyn.compat.pinocchio.data.field_recipes import CALL_KINDS
from spatialdyn.compat.pinocchio.types.arguments import OMITTED
from spatialdyn.compat.pinocchio.types.tracked_list import OwnedList
from spatialdyn.engines.programs.run import single_call

STUB = Path(calls.__file__).with_suffix(".pyi")
HEAD = '''"""The functions of ``table.FACES``, for type checkers: made by tests/compat/test_face.py."""

from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from ..data.data import Data
from ..model.model import Model
from ..types.frame import Convention, KinematicLevel, ReferenceFrame
from ..types.motion import Force, Motion
from ..types.se3 import SE3
from ..types.tracked_list import Rows

Array = NDArray[np.float64]
Numbers = NDArray[Any]
Forces = list[Force] | Rows

__all__ = {names}
'''


def parameter(x: Input) -> str:
    if x.default is REQUIRED:
        return f"{x.name}: {x.type}"
    return f"{x.name}: {x.type}{' | None' * (x.default is None)} = ..."


def declaration(face: Face) -> str:
    """One function of the stub, or its overloads."""
    lines = []
    for inputs in face.overloads or [face.inputs]:
        parameters = ", ".join([*["model: Model", "data: Data"][: len(face.first)], *map(parameter, inputs)])
        lines += ["@overload"] * bool(face.overloads)
        line = f"def {face.name}({parameters}) -> {face.returns}: ..."
        if len(line) > 120:
            listed = parameters if len(parameters) <= 115 else parameters.replace(", ", ",\n    ")
            line = f"def {face.name}(\n    {listed}\n) -> {face.returns}: ..."
        lines.append(line)
    return "\n".join(lines)


def stub() -> str:
    listed = "[\n" + "".join(f'    "{name}",\n' for name in sorted([*(face.name for face in FACES), "nle"])) + "]"
    return "\n".join([HEAD.replace("{names}", listed), *map(declaration, FACES), "", "nle = nonLinearEffects", ""])


def test_stub_declares_every_row() -> None:
    assert STUB.read_text(encoding="utf-8") == stub(), "run python tests/compat/test_face.py"


@pytest.mark.parametrize("face", FACES, ids=lambda face: face.name)
def test_function_is_as_its_row_says(face: Face) -> None:
    function = getattr(pin, face.name)
    parameters = inspect.signature(function).parameters
    assert [*parameters] == [*face.first, *(x.name for x in face.inputs)]
    defaults = [parameters[x.name].default for x in face.inputs]
    wanted = [inspect.Parameter.empty if x.default is REQUIRED else x.default for x in face.inputs]
    assert defaults == [x if x is not OMITTED or OMITTED in defaults else ... for x in wanted]  # a builtin's is text
    assert function.__doc__.startswith(face.doc)
    assert all(x.name in function.__doc__ for x in face.inputs if x.about)
    assert function.__name__ == function.__qualname__ == face.name
    assert function.__module__ == calls.__name__
    assert pickle.loads(pickle.dumps(function)) is function


def test_rows_name_kinds_of_calls_whose_fields_they_fill() -> None:
    """A field is computed at its first read: after the call of a row none of its fields is what it was before."""
    model = pin.buildSampleModelManipulator()
    q, v = pin.randomConfiguration(model), np.ones(model.nv)
    for face in FACES:
        if face.fields and not any(x.role == "f" and x.default is REQUIRED for x in face.inputs):
            data = model.createData()
            vectors = [{"q": q}.get(x.name, v) for x in face.inputs if x.role == "x"]
            getattr(pin, face.name)(model, data, *vectors)
            assert {*face.fields} == {*CALL_KINDS[face.call[-1]].fills}
            assert all(data.latest(field) is not None for field in face.fields), face.name


def test_builtins_answer_and_decline_as_the_functions_behind_them() -> None:
    """Each call twice: the first is checked in Python, the second answered by the plan of its Run, where one is."""
    model, other = pin.buildSampleModelManipulator(), pin.buildSampleModelManipulator()
    data, q, v = model.createData(), np.full(6, 0.2), np.full(6, 0.3)
    forces = [pin.Force(np.full(6, float(k))) for k in range(model.njoints)]
    other.armature = np.ones(6)
    free, pushed, heavy = (
        pin.rnea(x, x.createData(), q, v, v, *f) for x, f in ((model, ()), (model, [forces]), (other, ()))
    )
    assert not np.allclose(free, pushed)
    assert not np.allclose(free, heavy)
    for _ in range(2):
        np.testing.assert_array_equal(pin.rnea(model, data, q, a=v, v=v), free)
        np.testing.assert_allclose(pin.rnea(model, data, q, v, v, forces), pushed, rtol=1e-14)
        np.testing.assert_array_equal(pin.rnea(other, data, q, v, v), heavy)
        for wrong in (model, None, pin.Data.__new__(pin.Data)):
            with pytest.raises((TypeError, AttributeError)):
                pin.rnea(model, wrong, q, v, v)
        for given in ((), (q,), (q, v), (q, v, None), (q, v, v, None), (q, v, v, None, v), (q, v, v[:5])):
            with pytest.raises((TypeError, ValueError)):
                pin.rnea(model, data, *given)
        with pytest.raises(TypeError):
            pin.forwardKinematics(model, data, q, None, v[:2])
        assert pin.forwardKinematics(model, data, q, v) is None
        assert type(pin.computeKineticEnergy(model, data)) is float
        assert type(pin.computeCentroidalMomentum(model, data)) is pin.Force


@pytest.mark.parametrize("name", ["crba", "aba"])
def test_conventions_fill_their_own_fields_at_every_call(name: str) -> None:
    """The first call checks the arguments, the next are a builtin's; neither takes a number for a Convention."""
    model, rest = pin.buildSampleModelManipulator(), [np.ones(6)] * (2 * (name == "aba"))
    data, call, world = model.createData(), getattr(pin, name), pin.Convention.WORLD
    for angle in (0.1, 0.2, 0.3):
        q, fresh = np.full(6, angle), model.createData()
        for convention in (pin.Convention.LOCAL, world):
            call(model, data, q, *rest, convention=convention)
            call(model, fresh, q, *rest, convention=convention)
        pin.computeJointJacobians(model, fresh, q)
        np.testing.assert_allclose(data.J, fresh.J, atol=1e-14)
        np.testing.assert_allclose(
            pin.getJointJacobian(model, data, 6, pin.WORLD),
            pin.getJointJacobian(model, fresh, 6, pin.WORLD),
            atol=1e-14,
        )
        for wrong in (None, 0, 1, 2):
            with pytest.raises(TypeError, match="convention is"):
                call(model, data, q, *rest, convention=wrong)


def test_getters_read_the_latest_call_also_where_calls_alternate() -> None:
    """Of each getter the first call is checked in Python; later ones are builtins about the inputs of one call."""
    model = pin.buildSampleModelManipulator()
    data, v, place = model.createData(), np.full(6, 0.3), pin.SE3.Random()
    calls = [
        lambda data, q: pin.computeJointJacobians(model, data, q),
        lambda data, q: pin.computeJointJacobiansTimeVariation(model, data, q, v),
        lambda data, q: pin.computeAllTerms(model, data, q, v),
    ]
    for n, order in enumerate([0, 1, 0, 2, 1, 1, 2, 0, 1, 0]):
        q, fresh = np.full(6, 0.1 * n), model.createData()
        calls[order](data, q)
        pin.computeJointJacobians(model, fresh, q)
        for reference in (pin.LOCAL, pin.WORLD, pin.LOCAL_WORLD_ALIGNED):
            for name, about in (
                ("getFrameJacobian", (3, reference)),
                ("getFrameJacobian", (3, place, reference)),
                ("getJointJacobian", (4, reference)),
            ):
                getter = getattr(pin, name)
                np.testing.assert_allclose(getter(model, data, *about), getter(model, fresh, *about), atol=1e-14)


def test_a_frame_may_be_given_in_any_form() -> None:
    """Twice each: checked in Python, then by a builtin, where one takes arguments of that form."""
    model = pin.buildSampleModelManipulator()
    data, q, v = model.createData(), np.full(6, 0.2), np.full(6, 0.3)
    frame = model.frames[-1]
    joint, place = frame.parentJoint, frame.placement
    for _ in range(2):
        for reference in (pin.LOCAL, pin.WORLD, pin.LOCAL_WORLD_ALIGNED):
            q = q + 0.1
            pin.forwardKinematics(model, data, q, v)
            forms = [
                pin.getFrameVelocity(model, data, model.nframes - 1, reference),
                pin.getFrameVelocity(model, data, reference_frame=reference, frame_id=model.nframes - 1),
                pin.getFrameVelocity(model, data, joint, place, reference),
                pin.getFrameVelocity(model, data, joint_id=joint, placement=place, reference_frame=reference),
            ]
            if reference == pin.LOCAL:
                forms += [
                    pin.getFrameVelocity(model, data, model.nframes - 1),
                    pin.getFrameVelocity(model, data, joint, place),
                ]
            for found in forms[1:]:
                np.testing.assert_allclose(found.vector, forms[0].vector, atol=1e-14)
    with pytest.raises(IndexError):
        pin.getFrameVelocity(model, data, model.nframes)


def test_plans_of_a_model_follow_its_edits() -> None:
    model = pin.buildSampleModelManipulator()
    q, ones = pin.neutral(model), np.ones(6)
    for mass in (1.0, 2.0):
        for _ in range(2):
            model.inertias[2].mass = mass
            assert pin.computeTotalMass(model) == pytest.approx(sum(x.mass for x in model.inertias[1:]), rel=1e-15)
    for _ in range(2):
        assert pin.isNormalized(model, q)
        assert pin.isSameConfiguration(model, q, q, 0.0)
        np.testing.assert_array_equal(pin.integrate(model, v=ones, q=q), ones)
        np.testing.assert_array_equal(pin.interpolate(model, q, ones, 0.5), 0.5 * ones)
        assert pin.randomConfiguration(model, -ones, upper_bound=ones).shape == (6,)
        model.upperPositionLimit = np.full(6, 0.5)
        model.lowerPositionLimit[:] = 0.5
        np.testing.assert_array_equal(pin.randomConfiguration(model), np.full(6, 0.5))
        for wrong in (None, [0.0] * 6, np.ones(5)):
            with pytest.raises((TypeError, ValueError)):
                pin.integrate(model, q, wrong)
        with pytest.raises(TypeError):
            pin.neutral(None)
    model.addJoint(6, pin.JointModelSpherical(), pin.SE3.Identity(), "wrist")
    assert pin.neutral(model).shape == pin.randomConfiguration(model).shape == (10,)
    q = pin.neutral(model)
    assert pin.isNormalized(model, q)
    assert not pin.isNormalized(model, 2.0 * q)
    assert pin.isSameConfiguration(model, q, -q, 1e-9)


def test_strict_mode_checks_norms_of_configurations_that_were_planned() -> None:
    model = pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    q = np.array([0.0, 0.0, 0.0, 2.0])
    for _ in range(2):
        pin.integrate(model, q, np.zeros(3))
    before = pin.strict(True)
    try:
        with pytest.raises(ValueError, match="norm"):
            pin.integrate(model, q, np.zeros(3))
    finally:
        pin.strict(before)


def test_a_copy_of_a_model_is_freed_at_once() -> None:
    """It is in no cycle: the garbage of many copies would slow everything else."""
    model = pin.buildSampleModelManipulator()
    pin.neutral(model)
    pin.rnea(model, model.createData(), *np.zeros((3, 6)))
    gc.disable()
    try:
        copy = model.copy()
        assert pin.computeTotalMass(copy) == pin.computeTotalMass(model)
        copy.armature[0] = 1.0
        pin.neutral(copy)
        parts = [weakref.ref(x) for x in (copy, *(x for x in vars(copy).values() if isinstance(x, OwnedList)))]
        assert len(parts) > 3
        del copy
        assert [x() for x in parts] == [None] * len(parts)
    finally:
        gc.enable()


if __name__ == "__main__":
    STUB.write_text(stub(), encoding="utf-8")


@pytest.mark.skipif(not single_call.READY, reason="nothing is compiled, or Python is not as expected")
def test_a_plan_outlives_an_edit_of_its_model_during_the_call() -> None:
    """As by another thread, which may run while an entry is in plain Python."""
    model = pin.buildSampleModelManipulator()
    q, seen = pin.neutral(model), []
    pin.isNormalized(model, q)
    plan = weakref.ref(model._plans["isNormalized"])

    def edit(*addresses: int) -> int:
        model.names[1] = "another"
        seen.append((plan() is not None, "isNormalized" in model._plans))
        return 0  # the call is Python's

    entry = ctypes.PYFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 3)(edit)
    words = ctypes.cast(entry, ctypes.c_void_p).value or 0, 0, single_call.NO_LIMIT.ctypes.data
    single_call.change(model._plans["isNormalized"], words, entry)
    assert pin.isNormalized(model, q)
    assert seen == [(True, False)]
    assert plan() is None
    assert pin.isNormalized(model, q)
