"""Specialized programs: the results of the public calls, with fewer operations and fewer inputs."""

from __future__ import annotations

import pickle
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from inputs import empty_memory
from numpy.typing import NDArray
from slow import slow_but
from trees import random_inertia, random_tree

import spatialdyn as sd
from spatialdyn.calls.specialize import specialize
from spatialdyn.calls.specialized import Specialized
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.engines.programs.transform import float32_range
from spatialdyn.recursions import SPECS
from spatialdyn.urdf.robot_files import find_robot

Array = NDArray[np.float64]
EPS = np.finfo(float).eps
CLOSE = 64 * EPS  # of the largest entry: two orders of the same sums
SOLVED = 1e-9  # the same after solving for the accelerations of a random tree
SINGLE = 1e-4  # float32 (eps 6e-8) over twelve bodies in a row
COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")


@pytest.fixture(scope="module")
def model() -> sd.Model:
    """A floating tree with every kind of joint."""
    return random_tree(5, 8, floating=True, continuous="cos_sin").model


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    """A chain of revolute and prismatic joints."""
    return random_tree(3, 5, kinds=("revolute", "prismatic"), branching=0.0).model


@pytest.fixture(scope="module")
def ur5() -> sd.Model:
    """The robot whose operations are counted."""
    try:
        find_robot("ur5")
    except sd.UrdfError:
        pytest.skip("example-robot-data is not installed")
    return sd.load_urdf("ur5")


class State:
    """Random inputs of a batch shape."""

    def __init__(self, model: sd.Model, batch: tuple[int, ...] = (), seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.q = sd.random_configuration(model, rng, batch)
        self.v, self.a, self.tau = rng.normal(size=(3, *batch, model.nv))
        self.fext = rng.normal(size=(*batch, model.njoints, 6))


def close(x: Any, y: Any, bound: float = CLOSE) -> bool:
    """Whether two results agree, relative to the largest entry; NaN with NaN."""
    x, y = np.asarray(x), np.asarray(y)
    assert x.shape == y.shape
    scale = max(1.0, np.abs(y[np.isfinite(y)]).max(initial=0.0))
    return bool(np.array_equal(np.isnan(x), np.isnan(y)) and np.nanmax(np.abs(x - y), initial=0.0) <= bound * scale)


def work(k: Specialized) -> int:
    """Products and sums of a program."""
    return k.operations["mul"] + k.operations["add"]


CALLS: dict[str, tuple[Callable[..., Any], tuple[str, ...], float]] = {
    "rnea": (sd.rnea, ("q", "v", "a"), 4 * CLOSE),
    "nonlinear_effects": (sd.nonlinear_effects, ("q", "v"), 4 * CLOSE),
    "generalized_gravity": (sd.generalized_gravity, ("q",), 4 * CLOSE),
    "static_torque": (sd.static_torque, ("q", "fext"), 4 * CLOSE),
    "crba": (sd.crba, ("q",), 4 * CLOSE),
    "aba": (sd.aba, ("q", "v", "tau"), SOLVED),
    "minverse": (sd.minverse, ("q",), SOLVED),
    "kinetic_energy": (sd.kinetic_energy, ("q", "v"), 4 * CLOSE),
    "forward_kinematics": (sd.forward_kinematics, ("q",), 4 * CLOSE),
    "joint_jacobians": (sd.joint_jacobians, ("q",), 4 * CLOSE),
    "centroidal_momentum": (sd.centroidal_momentum, ("q", "v"), 4 * CLOSE),
    "integrate": (sd.integrate, ("q", "v"), 4 * CLOSE),
}


# --- the plain calls, without options ----------------------------------------------------------------------


@pytest.mark.parametrize("name", slow_but([*CALLS][::4], CALLS))
def test_a_program_answers_as_the_plain_call_does(model: sd.Model, name: str) -> None:
    call, inputs, bound = CALLS[name]
    s = State(model, (21,))
    k = specialize(model, call)
    values = [getattr(s, x) for x in inputs]
    expected = call(model, *values)
    assert close(k(*values), expected, bound)
    one = k(*[x[0] for x in values])
    assert type(one) is type(call(model, *[x[0] for x in values]))
    for _ in range(2):  # the first compiles the program for single samples
        assert close(k(*[x[0] for x in values]), expected[0], bound)


@COMPILED
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_sample_has_one_answer_alone_and_wherever_it_stands(model: sd.Model, dtype: Any) -> None:
    s = State(model, (17,))
    k = specialize(model, sd.rnea, dtype=dtype)
    q, v, a = (x.astype(dtype) for x in (s.q, s.v, s.a))
    expected = k(q, v, a)
    for n in range(18):
        assert np.array_equal(k(q[:n], v[:n], a[:n]), expected[:n])
    for n in range(17):
        assert np.array_equal(k(q[n], v[n], a[n]), expected[n])


def test_inputs_of_any_layout_and_kind_are_read(model: sd.Model) -> None:
    s = State(model, (3, 5))
    k = specialize(model, sd.rnea)
    expected = sd.rnea(model, s.q, s.v, s.a)
    wide = np.zeros((3, 5, 2 * model.nv))
    wide[..., ::2] = s.v
    frozen = s.a.copy()
    frozen.flags.writeable = False
    assert close(k(s.q, wide[..., ::2], frozen), expected, 4 * CLOSE)
    assert close(k(s.q.tolist(), s.v.astype(">f8"), s.a), expected, 4 * CLOSE)
    assert close(k(s.q[0, 0], s.v, s.a[:, :1]), sd.rnea(model, s.q[0, 0], s.v, s.a[:, :1]), 4 * CLOSE)
    one = s.q[1, 2], wide[1, 2, ::2], frozen[1, 2]
    for _ in range(2):
        assert close(k(*one), expected[1, 2], 4 * CLOSE)
        assert close(k(one[0].tolist(), *one[1:]), expected[1, 2], 4 * CLOSE)
        assert close(k(one[0], s.v[1, 2].astype(">f8"), one[2]), expected[1, 2], 4 * CLOSE)


def test_out_is_written_and_returned(model: sd.Model) -> None:
    k = specialize(model, sd.rnea)
    for batch in ((), (1,), (0,), (9,), (2, 3)):
        s = State(model, batch)
        out = np.full((*batch, model.nv), np.nan)
        assert k(s.q, s.v, s.a, out=out) is out
        assert close(out, sd.rnea(model, s.q, s.v, s.a), 4 * CLOSE)


def test_optional_forces_are_an_input_if_listed(model: sd.Model) -> None:
    s = State(model, (9,))
    k = specialize(model, sd.rnea, inputs="fext")
    assert close(k(s.q, s.v, s.a, s.fext), sd.rnea(model, s.q, s.v, s.a, s.fext), 4 * CLOSE)
    assert close(k(s.q[0], s.v[0], s.a[0], s.fext[0]), sd.rnea(model, s.q[0], s.v[0], s.a[0], s.fext[0]), 4 * CLOSE)


@pytest.mark.parametrize("reference", ["local", "world"])
def test_frames_are_those_of_the_plain_call(model: sd.Model, reference: str) -> None:
    s, frame = State(model, (9,)), model.frames[-1]
    k = specialize(model, [sd.frame_placement, sd.frame_jacobian], frame=frame, reference=reference)
    X, J = k(s.q)
    assert close(X, sd.frame_placement(model, s.q, frame), 4 * CLOSE)
    assert close(J, sd.frame_jacobian(model, s.q, frame, reference), 4 * CLOSE)


# --- several calls -----------------------------------------------------------------------------------------


def test_calls_of_one_program_share_their_work(model: sd.Model) -> None:
    s = State(model, (11,))
    k = specialize(model, [sd.crba, sd.nonlinear_effects])
    assert k.signature == "(q (nq,), v (nv,)) -> (M (nv, nv), tau (nv,))"
    M, bias = k(s.q, s.v)
    assert close(M, sd.crba(model, s.q), 4 * CLOSE)
    assert close(bias, sd.nonlinear_effects(model, s.q, s.v), 4 * CLOSE)
    out = np.empty_like(M), np.empty_like(bias)
    assert k(s.q, s.v, out=out)[0] is out[0]
    assert np.array_equal(out[0], M)
    one = k(s.q[3], s.v[3])
    again = k(s.q[3], s.v[3], out=(np.empty(M.shape[1:]), np.empty(bias.shape[1:])))
    assert isinstance(one, tuple)
    assert all(np.array_equal(x, y[3]) and np.array_equal(x, z) for x, y, z in zip(one, (M, bias), again, strict=True))
    alone = [specialize(model, call) for call in (sd.crba, sd.nonlinear_effects)]
    assert work(k) < sum(map(work, alone))
    assert k.operations["sincos"] == max(x.operations["sincos"] for x in alone)


def test_numbers_stand_beside_arrays(arm: sd.Model) -> None:
    s = State(arm, (4,))
    k = specialize(arm, [sd.kinetic_energy, sd.crba])
    for at in (0, 1):
        T, M = k(s.q[at], s.v[at])
        assert T == pytest.approx(0.5 * s.v[at] @ M @ s.v[at], rel=1e-12, abs=0.0)
    assert k(s.q, s.v)[0].shape == (4,)


# --- fixed inputs ------------------------------------------------------------------------------------------


def test_rnea_at_rest_is_the_gravity_program(ur5: sd.Model) -> None:
    s = State(ur5, (9,))
    whole, k = specialize(ur5, sd.rnea), specialize(ur5, sd.rnea, fixed={"v": 0, "a": 0})
    assert k.signature == "(q (nq,)) -> tau (nv,)"
    assert close(k(s.q), sd.generalized_gravity(ur5, s.q))
    assert 3 * work(k) <= work(whole)
    assert work(k) <= work(specialize(ur5, sd.generalized_gravity))


def test_a_fixed_joint_leaves_the_inputs_and_the_program(model: sd.Model) -> None:
    s = State(model, (9,))
    joint = model.joints[3]
    rows = slice(joint.idx_v, joint.idx_v + joint.nv)
    k = specialize(model, sd.rnea, fixed={"v": {joint.name: 0.5}, "a": np.arange(model.nv)})
    v = s.v.copy()
    v[:, rows] = 0.5
    left = np.delete(s.v, rows, axis=1)
    assert k.signature == f"(q (nq,), v ({model.nv - joint.nv},)) -> tau (nv,)"
    expected = sd.rnea(model, s.q, v, np.arange(model.nv))
    assert close(k(s.q, left), expected, 4 * CLOSE)
    assert close(k(s.q[1], left[1]), expected[1], 4 * CLOSE)
    assert work(k) < work(specialize(model, sd.rnea))


def test_forces_may_be_fixed_but_for_some_joints(arm: sd.Model) -> None:
    s = State(arm, (9,))
    hand = arm.names[-1]
    k = specialize(arm, sd.rnea, inputs="fext", fixed={"fext": {name: 0 for name in arm.names if name != hand}})
    assert k.signature.endswith("fext (1, 6)) -> tau (nv,)")
    fext = np.zeros_like(s.fext)
    fext[:, -1] = s.fext[:, -1]
    assert close(k(s.q, s.v, s.a, s.fext[:, -1:]), sd.rnea(arm, s.q, s.v, s.a, fext), 4 * CLOSE)
    always = specialize(arm, sd.rnea, fixed={"fext": fext[0]})
    assert close(always(s.q, s.v, s.a), sd.rnea(arm, s.q, s.v, s.a, fext[0]), 4 * CLOSE)
    assert work(specialize(arm, sd.rnea, fixed={"fext": 0})) == work(specialize(arm, sd.rnea))


def test_with_all_inputs_fixed_nothing_is_left_to_do(arm: sd.Model) -> None:
    s = State(arm)
    k = specialize(arm, sd.aba, fixed={"q": s.q, "v": s.v, "tau": s.tau})
    assert k.signature == "() -> a (nv,)"
    assert work(k) == 0
    for _ in range(2):
        assert close(k(), sd.aba(arm, s.q, s.v, s.tau), SOLVED)


def test_a_joint_may_be_fixed_in_q(model: sd.Model) -> None:
    s = State(model, (9,))
    root = model.joints[1]
    q = s.q.copy()
    q[:, :7] = q[0, :7]
    k = specialize(model, sd.crba, fixed={"q": {root.name: q[0, :7]}})
    assert close(k(q[:, 7:]), sd.crba(model, q), 4 * CLOSE)


# --- what is wanted ----------------------------------------------------------------------------------------


def test_dropped_outputs_leave_the_program(model: sd.Model) -> None:
    s = State(model, (9,))
    joint = model.joints[4]
    rows = list(range(joint.idx_v, joint.idx_v + joint.nv))
    k = specialize(model, sd.rnea, outputs=joint.name)
    expected = sd.rnea(model, s.q, s.v, s.a)[:, rows]
    assert k.signature.endswith(f"-> tau ({joint.nv},)")
    assert close(k(s.q, s.v, s.a), expected, 4 * CLOSE)
    assert close(k(s.q[0], s.v[0], s.a[0]), expected[0], 4 * CLOSE)
    assert work(k) < work(specialize(model, sd.rnea))


def test_matrices_and_jacobians_are_cut_along_every_axis_of_joints(model: sd.Model) -> None:
    s, rows = State(model, (9,)), [2, 0, model.nv - 1]
    M, J = specialize(model, [sd.crba, sd.joint_jacobians], outputs=rows)(s.q)
    assert close(M, sd.crba(model, s.q)[:, rows][:, :, rows], 4 * CLOSE)
    assert close(J, sd.joint_jacobians(model, s.q)[:, :, rows], 4 * CLOSE)
    X = specialize(model, sd.forward_kinematics, outputs=[model.names[-1]])(s.q)
    assert close(X, sd.forward_kinematics(model, s.q)[:, -1:], 4 * CLOSE)


# --- parameters as inputs ----------------------------------------------------------------------------------


def load(seed: int) -> tuple[Array, tuple[float, Array, Array]]:
    """A payload as ten numbers and as model.with_ takes it."""
    mass, com, I = random_inertia(np.random.default_rng(seed))
    return np.array([mass, *com, *I[np.triu_indices(3)]]), (mass, com, I)


@pytest.mark.parametrize("name", slow_but(["rnea"], ["rnea", "crba", "aba", "minverse"]))
def test_a_payload_given_is_a_payload_built_in(model: sd.Model, name: str) -> None:
    call, inputs, bound = CALLS[name]
    frame = f"link:{model.frames[-1].name}" if model.frames[-1].kind == "link" else model.frames[-1].name
    k = specialize(model, call, inputs={"payload": frame})
    s = State(model, (9,))
    values = [getattr(s, x) for x in inputs]
    loads = [load(seed) for seed in range(9)]
    result = k(*values, np.array([numbers for numbers, _ in loads]))
    for at, (numbers, inertia) in enumerate(loads):
        loaded = model.with_(payload={frame: inertia})
        expected = call(loaded, *[x[at] for x in values])
        assert close(result[at], expected, bound)
        assert close(k(*[x[at] for x in values], numbers), expected, bound)
    assert close(k(*values, loads[0][0])[5], k(*values, np.array([loads[0][0]] * 9))[5], 0.0)
    assert close(k(*values, np.zeros(10)), call(model, *values), bound)


def test_gravity_and_armature_may_be_given(model: sd.Model) -> None:
    s = State(model, (9,))
    k = specialize(model, sd.rnea, inputs=("gravity", "armature"))
    assert k.signature == "(q (nq,), v (nv,), a (nv,), gravity (3,), armature (nv,)) -> tau (nv,)"
    g = np.array([1.0, -2.0, 3.0])
    expected = sd.rnea(model.with_(gravity=g), s.q, s.v, s.a) + 0.5 * s.a
    assert close(k(s.q, s.v, s.a, g, model.armature + 0.5), expected, 4 * CLOSE)
    assert close(k(s.q[0], s.v[0], s.a[0], g, model.armature + 0.5), expected[0], 4 * CLOSE)


def test_mass_com_and_inertia_of_a_body_may_be_given(arm: sd.Model) -> None:
    s, name = State(arm, (9,)), arm.names[3]
    row = arm.bodies[arm.joint(name).row]
    h = np.array(row["inertia"]["h"].tolist())
    mass = float(row["inertia"]["m"])
    com = h / mass
    J = np.array(row["inertia"]["I"].tolist())
    about = J - mass * (com @ com * np.eye(3) - np.outer(com, com))[np.triu_indices(3)]
    k = specialize(arm, sd.rnea, inputs=[f"mass:{name}", f"com:{name}", f"inertia:{name}"])
    assert k.signature.endswith(f"mass:{name} (), com:{name} (3,), inertia:{name} (6,)) -> tau (nv,)")
    expected = sd.rnea(arm, s.q, s.v, s.a)
    assert close(k(s.q, s.v, s.a, mass, com, about), expected, 4 * CLOSE)
    heavier = specialize(arm, sd.rnea, inputs=f"mass:{name}")
    assert close(heavier(s.q, s.v, s.a, mass), expected, 4 * CLOSE)
    point = arm.with_(payload={f"joint:{name}": (2.0, com, np.zeros((3, 3)))})
    for m in (mass + 2.0, np.full(9, mass + 2.0)):
        assert close(heavier(s.q, s.v, s.a, m), sd.rnea(point, s.q, s.v, s.a), 4 * CLOSE)
    one = heavier(s.q[2], s.v[2], s.a[2], mass + 2.0)
    assert close(one, sd.rnea(point, s.q[2], s.v[2], s.a[2]), 4 * CLOSE)


def test_a_program_is_compiled_once_for_all_values(arm: sd.Model) -> None:
    k = specialize(arm, sd.rnea, inputs="payload")
    s = State(arm)
    k(s.q, s.v, s.a, load(0)[0])
    before = k.compile_seconds
    for seed in range(5):
        k(s.q, s.v, s.a, load(seed)[0])
    assert k.compile_seconds == before


# --- what a program leaves to others -----------------------------------------------------------------------


def test_samples_beyond_the_program_are_recomputed(model: sd.Model) -> None:
    s = State(model, (13,))
    joint = next(j for j in model.joints if j.kind == "revolute")
    s.q[3, joint.idx_q] += 2e6 * np.pi
    s.v[7, 2] = np.nan
    frame = model.frames[-1].name
    many = np.array([load(seed)[0] for seed in range(13)])
    k = specialize(model, sd.rnea, fixed={"a": 0}, inputs={"payload": frame})
    for loads in (many, many[3]):
        result = k(s.q, s.v, loads)
        for at in (3, 7, 8):
            mine = loads if loads.ndim == 1 else loads[at]
            I = np.zeros((3, 3))
            I[np.triu_indices(3)] = mine[4:]
            I += np.triu(I, 1).T
            loaded = model.with_(payload={frame: (mine[0], mine[1:4], I)})
            expected = sd.rnea(loaded, s.q[at], s.v[at], np.zeros(model.nv))
            assert close(result[at], expected, 1e-9)
            assert close(k(s.q[at], s.v[at], mine), expected, 1e-9)
    part = specialize(model, sd.rnea, outputs=[1, 4])(s.q, s.v, s.a)
    assert close(part, sd.rnea(model, s.q, s.v, s.a)[:, [1, 4]], 1e-9)


def test_float32_is_as_good_as_its_numbers(model: sd.Model) -> None:
    s = State(model, (13,))
    for call, values in ((sd.rnea, (s.q, s.v, s.a)), (sd.crba, (s.q,)), (sd.forward_kinematics, (s.q,))):
        k = specialize(model, call, dtype=np.float32)
        result = k(*[x.astype(np.float32) for x in values])
        assert result.dtype == np.float32
        assert close(result, call(model, *values), SINGLE)
        assert k(*[x[0] for x in values]).dtype == np.float32
    k = specialize(model, sd.rnea, dtype=np.float32)
    s.v[5, 0] = np.nan
    far = s.q.astype(np.float32)
    at = next(j for j in model.joints if j.kind == "revolute").idx_q
    far[4, at] = 3e5
    expected = sd.rnea(model, far, s.v, s.a)
    assert close(k(far, s.v, s.a), expected, SINGLE)
    out = np.empty((13, model.nv), np.float32)
    assert k(far, s.v, s.a, out=out) is out


def test_a_joint_of_zero_articulated_inertia_is_named_with_its_sample(arm: sd.Model) -> None:
    name = arm.names[-1]
    k = specialize(arm, sd.aba, inputs=[f"mass:{name}", f"inertia:{name}", "armature"])
    s = State(arm, (9,))
    mass, inertia = np.ones(9), np.tile([0.1, 0, 0, 0.1, 0, 0.1], (9, 1))
    given = [mass, inertia, np.zeros(arm.nv)]
    k(s.q, s.v, s.tau, *given)
    mass[6], inertia[6] = 0.0, 0.0
    with pytest.raises(sd.InertiaError, match=f'joint "{name}" has zero articulated inertia in sample 6'):
        k(s.q, s.v, s.tau, *given)
    with pytest.raises(sd.InertiaError, match=f'joint "{name}" has zero articulated inertia'):
        k(s.q[6], s.v[6], s.tau[6], 0.0, inertia[6], np.zeros(arm.nv))


def test_a_joint_of_zero_articulated_inertia_in_every_state_leaves_no_program() -> None:
    builder = sd.ModelBuilder("empty", root="base")
    builder.add_body("a", "base", "prismatic", [0, 0, 1], np.eye(4), (0.0, np.zeros(3), np.zeros((3, 3))))
    k = specialize(builder.build(), sd.aba)
    assert k.engine == "untraced"
    with pytest.raises(sd.InertiaError, match='model "empty" has a joint with zero articulated inertia'):
        _ = k.operations
    for batch in ((), (3,)):
        with pytest.raises(sd.InertiaError, match="has zero articulated inertia"):
            k(*np.zeros((3, *batch, 1)))


def test_bad_samples_raise_as_in_the_plain_call(model: sd.Model) -> None:
    k = specialize(model, sd.rnea)
    s = State(model, (9,))
    s.q[4, 3:7] *= 1.1
    with pytest.raises(sd.ConfigurationError, match=r"norm 1\.1 for joint .* in sample 4, expected 1"):
        k(s.q, s.v, s.a)
    with pytest.raises(sd.ConfigurationError, match="expected 1 within"):
        k(s.q[4], s.v[4], s.a[4])
    s = State(model, (9,))
    s.v[2] = 1e200
    with pytest.raises(sd.NonFiniteError, match="in sample 2"):
        k(s.q, s.v, s.a)
    with pytest.raises(sd.NonFiniteError, match="range of float32"):
        specialize(model, sd.rnea, dtype=np.float32)(s.q, s.v, s.a)


def test_long_programs_run_untraced(arm: sd.Model, model: sd.Model) -> None:
    chain = random_tree(1, recording.most_rows(SPECS["rnea"]) + 1, kinds=("revolute",), branching=0.0).model
    k = specialize(chain, sd.rnea, fixed={"a": 0}, outputs=[0])
    assert k.engine == "untraced"
    s = State(chain, (3,))
    assert close(k(s.q, s.v), sd.nonlinear_effects(chain, s.q, s.v)[:, :1], CLOSE)
    assert specialize(model, sd.difference).engine == ("untraced" if numba_kernels.PLAIN else "lanes")
    assert specialize(arm, sd.rnea).engine == ("untraced" if numba_kernels.PLAIN else "lanes")


def test_parameters_of_each_sample_without_a_program(monkeypatch: pytest.MonkeyPatch) -> None:
    """A batch is its samples one by one, an angle beyond the polynomials and a NaN among them, and edited models'."""
    monkeypatch.setattr(recording, "most_rows", lambda spec: 1)
    tree = random_tree(4, 7, kinds=("revolute", "prismatic")).model
    body, rng, count = tree.robot.links[5].name, np.random.default_rng(0), 11
    k = specialize(tree, sd.generalized_gravity, inputs=[f"payload:{body}", "gravity"], outputs=[0, 3])
    assert k.engine == "untraced"
    q, load, g = rng.normal(size=(count, tree.nq)), np.zeros((count, 10)), rng.normal(size=(count, 3))
    load[:, :4] = rng.uniform(0.1, 1.0, size=(count, 4))
    turns = next(j.idx_q for j in tree.joints[1:] if j.kind == "revolute")
    q[5, turns], q[7, turns] = 1e7, np.nan
    found = k(q, load, g)
    np.testing.assert_array_equal(found, [k(*x) for x in zip(q, load, g, strict=True)])
    assert np.isnan(found[7]).any()
    for at in (0, 5, 10):
        other = tree.with_(gravity=g[at], payload={body: (load[at, 0], load[at, 1:4], np.zeros((3, 3)))})
        assert close(found[at], sd.generalized_gravity(other, q[at])[[0, 3]], CLOSE)


# --- errors ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"calls": sd.total_mass}, "calls has total_mass, expected public calls"),
        ({"calls": sd.forward_dynamics}, "calls has forward_dynamics, expected its method: aba, crba_solve, aba_ref"),
        ({"calls": []}, r"calls is \[\], expected a public call"),
        ({"calls": [sd.crba, sd.crba]}, "calls has crba twice"),
        ({"calls": ["rnea"]}, "calls has 'rnea', expected public calls"),
        ({"dtype": np.int32}, "dtype is .*int32.*, expected float64 or float32"),
        ({"fixed": {"tau": 0}}, 'fixed has "tau", expected one of q, v, a'),
        ({"fixed": {"v": [1.0, 2.0]}}, r"fixed v has shape \(2,\), expected \(5,\) or a number"),
        ({"fixed": {"v": np.nan}}, "fixed v is nan, expected finite numbers"),
        ({"fixed": {"v": {"missing": 0}}}, 'joint "missing" is not in robot'),
        ({"fixed": {"v": {"universe": 0}}}, 'v has no entries of joint "universe"'),
        ({"inputs": "colour"}, "inputs has 'colour', expected fext, rate, gravity"),
        ({"inputs": "mass"}, "inputs has 'mass', expected fext, rate, gravity"),
        ({"inputs": "mass:missing"}, 'joint "missing" is not in robot'),
        ({"inputs": ("gravity", "gravity")}, 'inputs has "gravity" twice'),
        ({"inputs": "payload:b0000"}, 'frame "b0000" is fixed in the world'),
        ({"outputs": "missing"}, 'joint "missing" is not in robot'),
        ({"outputs": 5}, "outputs has 5, expected joint names or indices below 5"),
        ({"outputs": []}, "outputs is empty"),
        ({"outputs": [1, 1]}, "expected each entry of tau once"),
        ({"calls": sd.center_of_mass, "outputs": [0]}, "no result has an entry per joint"),
        ({"calls": sd.frame_jacobian}, "frame is None, expected the name of one"),
        ({"frame": "b0001"}, "frame is 'b0001', expected None"),
        ({"reference": "world"}, "reference is 'world', expected the default"),
        ({"reference": "moon"}, "reference is 'moon', expected one of local"),
        ({"classical": True}, "classical is True, expected the default"),
    ],
)
def test_what_cannot_be_made_is_named(arm: sd.Model, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(sd.SpatialDynError, match=message):
        specialize(arm, **{"calls": sd.rnea, **arguments})


def test_a_payload_of_a_branching_robot_needs_a_frame(model: sd.Model) -> None:
    with pytest.raises(sd.ModelError, match=r'"payload" without a frame.*ends in \d+ joints; expected "payload:FRAME"'):
        specialize(model, sd.rnea, inputs="payload")


def test_a_fixed_quaternion_has_to_be_of_unit_norm(model: sd.Model) -> None:
    with pytest.raises(sd.ConfigurationError, match='for joint "root_joint", expected a norm within 1e-6 of 1'):
        specialize(model, sd.crba, fixed={"q": {"root_joint": np.ones(7)}})


def test_a_function_that_has_the_name_of_a_call_is_none(arm: sd.Model) -> None:
    def rnea(*given: Any) -> None:
        """Another one."""

    with pytest.raises(sd.SpatialDynError, match="calls has rnea, expected public calls"):
        specialize(arm, rnea)


def test_wrong_arrays_are_named(arm: sd.Model) -> None:
    k = specialize(arm, sd.rnea)
    s = State(arm)
    for _ in range(2):
        with pytest.raises(sd.ShapeError, match=r"q has shape \(3,\), expected \(..., 5\)"):
            k(s.q[:3], s.v, s.a)
        with pytest.raises(sd.ShapeError, match="batch shapes do not broadcast"):
            k(np.zeros((2, 5)), np.zeros((3, 5)), s.a)
        with pytest.raises(sd.ShapeError, match="a has dtype object"):
            k(s.q, s.v, [None] * 5)
        with pytest.raises(sd.ShapeError, match=r"out is shape \(3,\), float64, expected an array of shape \(5,\)"):
            k(s.q, s.v, s.a, out=np.empty(3))
        with pytest.raises(sd.ShapeError, match=r"out is shape .*float32, expected an array of shape"):
            k(s.q, s.v, s.a, out=np.empty(5, np.float32))
        with pytest.raises(sd.ShapeError, match="out overlaps v in memory"):
            k(s.q, s.v, s.a, out=s.v)
        with pytest.raises(sd.ShapeError, match="not a writable array in C order"):
            k(s.q, s.v, s.a, out=np.empty(10)[::2])
        with pytest.raises(TypeError):
            k(s.q, s.v)
        k(s.q, s.v, s.a)
    several = specialize(arm, [sd.crba, sd.rnea])
    shared = np.empty(30)
    for _ in range(2):
        with pytest.raises(sd.ShapeError, match="expected a tuple of 2 arrays"):
            several(s.q, s.v, s.a, out=np.empty((5, 5)))
        with pytest.raises(sd.ShapeError, match="out overlaps another out"):
            several(s.q, s.v, s.a, out=(shared[:25].reshape(5, 5), shared[20:25]))
        several(s.q, s.v, s.a)


# --- the object --------------------------------------------------------------------------------------------


def test_a_program_shows_itself(arm: sd.Model) -> None:
    k = specialize(arm, sd.rnea)
    assert isinstance(k, Specialized)
    assert "rnea" in repr(k)
    assert k.signature in repr(k)
    assert k.program.listing().count("output[") == arm.nv
    assert set(k.operations) >= {"mul", "add", "div", "sqrt", "sincos", "depth"}
    assert k.model is arm


def test_a_program_pickles(arm: sd.Model) -> None:
    k = specialize(arm, sd.rnea, fixed={"a": 0}, outputs=[1])
    s = State(arm)
    assert np.array_equal(pickle.loads(pickle.dumps(k))(s.q, s.v), k(s.q, s.v))


@COMPILED
def test_other_requests_have_other_programs(arm: sd.Model) -> None:
    s = State(arm, (9,))
    results = [specialize(arm, sd.rnea, fixed={"a": x})(s.q, s.v) for x in (0.0, 1.0, 2.0)]
    assert close(results[0] + results[2], 2 * results[1], 16 * CLOSE)
    assert not close(results[0], results[1])


def test_eight_threads_get_the_answers_of_one(model: sd.Model) -> None:
    n, rounds = (8, 1) if numba_kernels.PLAIN else (40, 20)
    s = State(model, (n,))
    k = specialize(model, [sd.crba, sd.nonlinear_effects])
    expected = specialize(model, [sd.crba, sd.nonlinear_effects])(s.q, s.v)
    wrong: list[int] = []

    def task(first: int) -> None:
        for at in range(first, n, 8):
            for _ in range(rounds):
                one, all_ = k(s.q[at], s.v[at]), k(s.q, s.v)
                wrong.extend(at for x, y, z in zip(one, all_, expected, strict=True)
                             if not (np.array_equal(x, z[at]) and np.array_equal(y, z)))  # fmt: skip

    threads = [threading.Thread(target=task, args=(first,)) for first in range(8)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert wrong == []


@COMPILED
def test_a_robot_far_beyond_the_range_of_float32_is_refused_by_name() -> None:
    model = sd.load_urdf("two_link").with_(gravity=[0.0, 0.0, -1e120])
    for call in (sd.rnea, sd.aba):
        with pytest.raises(sd.NonFiniteError, match="float32"):
            specialize(model, call, dtype=np.float32)(*np.ones((3, 2)))


@COMPILED
def test_zeros_of_either_sign_drive_nothing_in_float32(arm: sd.Model) -> None:
    """At rest without gravity all results are 0, which float32 holds: no sample is left to float64."""
    k = specialize(arm.with_(gravity=(0.0, 0.0, 0.0)), sd.rnea, dtype=np.float32)
    assert k._kernel is not None
    q = State(arm, (16,)).q.astype(np.float32)
    for zero in (0.0, -0.0):
        v, out = np.full((16, arm.nv), zero, np.float32), np.ones((16, arm.nv), np.float32)
        left = k._kernel([q, v, v], [out])
        assert left is not None
        assert len(left) == 0
        assert not out.any()


def test_a_rotor_beyond_the_range_of_float32_is_seen(arm: sd.Model) -> None:
    for value in (1e20, 1e-30):
        builder = sd.ModelBuilder().add_body("a", armature=value)
        bodies = builder.build().bodies
        assert float32_range.beyond(bodies) == [1]
    assert float32_range.beyond(arm.bodies) == []


# --- threads ------------------------------------------------------------------------------------------------


@pytest.fixture
def three_threads(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """Any batch of more than two tiles runs over three threads; a list that takes the threads of each batch."""
    sizes: list[int] = []
    run = batch_kernels.Kernel._part

    def counted(self: Any, n: int, arguments: Any, threads: int) -> Any:
        sizes.append(threads)
        return run(self, n, arguments, threads)

    monkeypatch.setattr(batch_kernels.Kernel, "_part", counted)
    monkeypatch.setattr(batch_kernels, "THREAD_BYTES", 1)
    empty_memory(monkeypatch)  # read at load
    sd.set_num_threads(3)
    yield sizes
    sd.set_num_threads(1)


def by_one_thread(k: Specialized, *values: Any) -> Any:
    """The same without threads."""
    sd.set_num_threads(1)
    try:
        return k(*values)
    finally:
        sd.set_num_threads(3)


@COMPILED
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_threads_change_no_bit_of_any_result(model: sd.Model, three_threads: list[int], dtype: Any) -> None:
    """Two results, forces, a payload for all or for each, batches of two axes, samples that the program leaves."""
    n, rng = 1003, np.random.default_rng(6)
    s = State(model, (n,))
    angle = next(j.idx_q for j in model.joints if j.kind == "revolute")
    s.q[[5, 900], angle] = 1e6, np.nan
    s.v[1002, 3] = np.nan
    s.fext[700, 2, 1] = 1e12  # beyond what float32 answers for
    payload = np.abs(rng.normal(size=(n, 10)))
    k = specialize(model, [sd.rnea, sd.kinetic_energy], dtype, inputs={"fext": None, "payload": model.frames[-1].name})
    values = [s.q, s.v, s.a, s.fext, payload]
    for some in (values, [*values[:4], payload[7]], [s.q, s.v[3], s.a[:1], s.fext[11], payload]):
        wanted = by_one_thread(k, *some)
        three_threads.clear()
        found = k(*some)
        assert three_threads == [3]
        for x, y in zip(found, wanted, strict=True):
            np.testing.assert_array_equal(x, y)
    folded = k(*(x.reshape(17, 59, *x.shape[1:]) for x in values))
    for x, y in zip(folded, by_one_thread(k, *values), strict=True):
        np.testing.assert_array_equal(x.reshape(y.shape), y)
    out = tuple(np.empty_like(x) for x in wanted)
    k(*some, out=out)
    for x, y in zip(out, wanted, strict=True):
        np.testing.assert_array_equal(x, y)
