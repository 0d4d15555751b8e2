"""The records of the joint kinds agree with what the package does, and the helical joint is a screw."""

from __future__ import annotations

import math
import pickle
from typing import Any

import dense
import mpmath
import numpy as np
import pytest
from slow import slow_but
from trees import SCREWS, random_state, random_tree

import spatialdyn as sd
from spatialdyn.bodies import kinds
from spatialdyn.bodies.joints import pitch_of
from spatialdyn.bodies.kinds import CODES, KINDS, kind_of
from spatialdyn.calls.dynamics import calls, table_call
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.model.joint_rows import joint_transform, subspace
from spatialdyn.model.robot import JOINT_KINDS, WITH_AXIS

EPS = np.finfo(float).eps
ROUNDING = 64 * EPS  # of the largest entry: a few dozen products of numbers of order one
SOLVED = 1e-9  # the same after solving for the accelerations of a random tree
SINGLE = 1e-4  # float32 over six bodies in a row
DIGITS = 1e-70  # rounding of 240 bits, times a condition number of 100
STEPPED = 1e-9  # after 100 steps of order 4
PITCH = 0.3
BODY = (1.5, (0.2, -0.3, 0.4), np.diag([0.1, 0.2, 0.25]))
AXIS = np.array([1.0, -2.0, 2.0]) / 3.0
LAYOUTS = ("angle", "cos_sin")
COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")


def close(x: Any, y: Any, bound: float = ROUNDING) -> None:
    x, y = np.asarray(x), np.asarray(y)
    assert x.shape == y.shape
    assert abs(x - y).max(initial=0.0) <= bound * max(1.0, abs(y).max(initial=0.0))


def one_joint(word: str, continuous: str = "angle", **fields: Any) -> sd.Model:
    """A body on one joint of that kind."""
    pitch = PITCH if word == "helical" else 0.0
    fields = {"axis": AXIS, "placement": ((0.1, 0.2, 0.3), (0.4, 0.5, 0.6)), "pitch": pitch, **fields}
    builder = sd.ModelBuilder().add_body("body", joint=word, inertia=BODY, joint_name="j", **fields)
    return builder.build(continuous=continuous)


# --- the records ------------------------------------------------------------------------------------------


def test_every_code_has_its_record_and_every_record_a_word() -> None:
    codes = {name: x for name, x in vars(kinds).items() if name.isupper() and isinstance(x, int)}
    codes = {name: x for name, x in codes.items() if name not in ("ANGLE", "PAIR", "QUATERNION")}
    assert sorted(codes.values()) == list(range(len(KINDS))) == [kind.code for kind in KINDS]
    assert {code for pair in CODES.values() for code in pair} == set(codes.values()) - {kinds.CONTINUED}
    assert JOINT_KINDS == ("fixed", *CODES)
    assert set(WITH_AXIS) == {"revolute", "continuous", "prismatic", "planar", "helical"}


def test_groups_and_tuples_are_those_of_the_records() -> None:
    groups = {"R": kinds.R1, "SO(2)": kinds.SO2, "SE(2)": kinds.SE2, "SO(3)": kinds.SO3, "SE(3)": kinds.SE3}
    assert sorted(code for codes in groups.values() for code in codes) == [kind.code for kind in KINDS[1:]]
    freedoms = {"R": 1, "SO(2)": 1, "SE(2)": 3, "SO(3)": 3, "SE(3)": 6}
    for kind in KINDS[1:]:
        assert kind.code in groups[kind.group]
        assert kind.nv == freedoms[kind.group]
        assert (kinds.NQ[kind.code], kinds.NV[kind.code], kinds.LENGTHS[kind.code]) == (kind.nq, kind.nv, kind.lengths)
        assert kinds.UNITS[kind.code] == (0 if kind.unit is None else kind.unit.stop - kind.unit.start)
        assert (kind.motion != "") == (kind.nv == 1)
    assert sorted((*kinds.TURNS, *kinds.SLIDES, *kinds.SCREWS)) == [k.code for k in KINDS if k.motion]


@pytest.mark.parametrize("continuous", LAYOUTS)
@pytest.mark.parametrize("word", CODES)
def test_a_record_says_what_a_model_and_its_calls_do(word: str, continuous: str) -> None:
    kind, model, rng = kind_of(word, continuous), one_joint(word, continuous), np.random.default_rng(0)
    joint = model.joints[1]
    assert (joint.kind, joint.nq, joint.nv) == (word, kind.nq, kind.nv) == (word, model.nq, model.nv)
    assert int(model.bodies["kind"][1]) == kind.code
    assert tuple(sd.neutral(model).tolist()) == kind.undisplaced
    assert kinds.unit_parts(model.bodies) == ([] if kind.unit is None else [tuple(range(model.nq))[kind.unit]])
    q = sd.random_configuration(model, rng, (20,))
    unit = kind.unit or slice(0, 0)
    others = np.setdiff1d(np.arange(model.nq), np.arange(model.nq)[unit])
    assert (abs(q[:, others]) <= math.pi).all()
    if kind.unit is not None:
        close(np.linalg.norm(q[:, unit], axis=1), np.ones(20))
        with pytest.raises(sd.ConfigurationError, match="expected 1 within 1e-6"):
            sd.crba(model, 1.1 * q[0])
        with pytest.raises(sd.ModelError, match="expected a part of unit norm"):
            model.reduced({"j": 1.1 * q[0]})
    normal = sd.normalize(model, 3.0 * q)
    close(normal[:, unit], q[:, unit])
    assert (normal[:, others] == 3.0 * q[:, others]).all()


@pytest.mark.parametrize("continuous", LAYOUTS)
@pytest.mark.parametrize("word", CODES)
def test_a_joint_moves_by_the_exponential_of_its_subspace(word: str, continuous: str) -> None:
    """X_J is the identity where nothing is displaced, and X_J(q ∘ exp(v)) = X_J(q) exp(S v) everywhere."""
    kind, model, rng = kind_of(word, continuous), one_joint(word, continuous), np.random.default_rng(1)
    pitch = model.joints[1].pitch
    S = subspace(word, AXIS, pitch)
    assert S.shape == (kind.nv, 6)
    close(joint_transform(word, AXIS, kind.undisplaced, continuous, pitch), np.eye(4))
    for q, v in zip(sd.random_configuration(model, rng, (5,)), rng.normal(size=(5, kind.nv)), strict=True):
        after = joint_transform(word, AXIS, sd.integrate(model, q, v), continuous, pitch)
        step = dense.expm(dense.hat(dense.flip(v @ S)))
        close(after, joint_transform(word, AXIS, q, continuous, pitch) @ step)
        close(sd.difference(model, q, sd.integrate(model, q, 0.3 * v)), 0.3 * v)


# --- a helical joint by hand ------------------------------------------------------------------------------


def test_a_screw_lifts_its_load_by_its_pitch() -> None:
    """M = I + m p², g = m g p, and half a turn lifts by p π."""
    m, p, J = 2.0, -0.3, 0.7
    inertia = (m, (0, 0, 0), np.diag([J / 2, J / 2, J]))
    builder = sd.ModelBuilder().add_body("nut", None, "helical", inertia=inertia, pitch=p)
    model = builder.build()
    close(sd.crba(model, [0.4]), [[J + m * p * p]])
    close(sd.generalized_gravity(model, [0.4]), [m * 9.81 * p])
    close(sd.aba(model, [0.4], [5.0], [0.0]), [-m * 9.81 * p / (J + m * p * p)])
    close(
        sd.forward_kinematics(model, [math.pi])[1], [[-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 1, p * math.pi], [0, 0, 0, 1]]
    )
    assert (model.joints[1].kind, model.joints[1].pitch) == ("helical", p)
    assert model.bodies["inertia_bound"]["x"][1] >= J + m * p * p


@pytest.mark.parametrize("pitch", [-0.3, 0.05, 2.5])
def test_the_pitch_of_a_row_is_that_of_its_joint(pitch: float) -> None:
    axis = np.array([1.0, -2.0, 3.0])
    model = sd.ModelBuilder().add_body("nut", None, "helical", axis, inertia=(1, (0, 0, 0), np.eye(3)), pitch=pitch)
    assert pitch_of(model.build().bodies[1]) == pytest.approx(pitch, rel=1e-14)


STATES = {
    "rnea": "q v a", "crba": "q", "coriolis_matrix": "q v", "minverse": "q", "aba": "q v tau", "centroidal_map": "q",
    "christoffel_symbols": "q", "joint_torque_regressor": "q v a", "rnea_derivatives": "q v a",
    "forward_kinematics": "q",
}  # fmt: skip


def twins(made: str, pitch: float, instead: str) -> tuple[sd.Model, sd.Model, dict[str, Any]]:
    """A tree in which joints have one kind or the other, and a state."""
    models = []
    for word in (made, instead):
        rng = np.random.default_rng(3)
        builder = sd.ModelBuilder()
        for k, joint in enumerate((word, "revolute", word, "spherical", "prismatic", word)):
            axis, shift = rng.normal(size=(2, 3))
            own = {"pitch": pitch} if joint == "helical" else {}
            builder.add_body(f"b{k}", f"b{k - 1 - k // 4}" if k else None, joint, axis, (shift, shift), BODY, **own)
        models.append(builder.build())
    rng = np.random.default_rng(4)
    v, a, tau = rng.normal(size=(3, models[0].nv))
    return models[0], models[1], {"q": sd.random_configuration(models[1], rng), "v": v, "a": a, "tau": tau}


@pytest.mark.parametrize("name", slow_but(["rnea", "crba", "aba", "forward_kinematics"], STATES))
def test_a_screw_of_pitch_0_is_a_hinge_to_the_bit(name: str) -> None:
    screw, hinge, s = twins("helical", 0.0, "revolute")
    given = [s[x] for x in STATES[name].split()]
    assert (table_call(name, screw, *given) == table_call(name, hinge, *given)).all()


@pytest.mark.parametrize("name", ["rnea", "crba", "generalized_gravity", "aba"])
def test_a_screw_of_a_huge_pitch_is_a_slider(name: str) -> None:
    """At pitch p the coordinate is x/p: torques grow by p, M by p², and the angle x/p is next to 0."""
    p, states = 1e7, {**STATES, "generalized_gravity": "q"}
    screw, slider, s = twins("helical", p, "prismatic")
    which = np.array([j.idx_v for j in slider.joints[1:] if screw.joint(j.name).kind == "helical"])
    places = np.array([j.idx_q for j in slider.joints[1:] if screw.joint(j.name).kind == "helical"])
    scale = np.ones(slider.nv)
    scale[which] = p
    own = {**s, "q": s["q"].copy(), "v": s["v"] / scale, "a": s["a"] / scale, "tau": s["tau"] * scale}
    own["q"][places] /= p
    given = states[name].split()
    found, wanted = (np.asarray(calls[name](m, *(x[k] for k in given))) for m, x in ((screw, own), (slider, s)))
    found = {"crba": lambda x: x / scale / scale[:, None], "aba": lambda x: x * scale}.get(name, lambda x: x / scale)(
        found
    )
    close(found, wanted, 1e3 / p)


def test_a_screw_is_a_slider_geared_to_a_hinge() -> None:
    """A hinge that carries a slider of the same axis, q_slide = p q_hinge: M, bias and g are Gᵀ of theirs."""
    screw = one_joint("helical")
    rig = sd.ModelBuilder().add_body("a", joint="revolute", axis=AXIS, placement=((0.1, 0.2, 0.3), (0.4, 0.5, 0.6)))
    rig.add_body("b", "a", "prismatic", AXIS, None, BODY)
    both, G, q, v = rig.build(), np.array([1.0, PITCH]), 0.7, 1.3
    close(sd.crba(screw, [q]), [[G @ sd.crba(both, q * G) @ G]])
    close(sd.nonlinear_effects(screw, [q], [v]), [G @ sd.nonlinear_effects(both, q * G, v * G)])
    close(sd.forward_kinematics(screw, [q])[1], sd.forward_kinematics(both, q * G)[2])


# --- a helical joint in models ----------------------------------------------------------------------------


def test_pitches_that_are_none_are_refused_by_name() -> None:
    for pitch, message in (
        (math.nan, 'joint "j" has pitch nan, expected a finite number'),
        (math.inf, 'joint "j" has pitch inf, expected a finite number'),
        ("1", "joint \"j\" has pitch '1', expected 1 number"),
    ):
        with pytest.raises(sd.ModelError, match=message):
            one_joint("helical", pitch=pitch)
    with pytest.raises(sd.ModelError, match=r'joint "j" is revolute and has pitch 0\.1, expected a helical joint'):
        one_joint("revolute", pitch=0.1)
    with pytest.raises(sd.ModelError, match='joint "j" has axis of norm 0'):
        one_joint("helical", axis=(0, 0, 0))
    with pytest.raises(sd.InertiaError, match='joint "j" moves an inertia that is beyond the largest float'):
        one_joint("helical", pitch=1e200)


def test_models_with_screws_are_copied_locked_and_cut() -> None:
    made = random_tree(7, 6, SCREWS, floating=True)
    model, s = made.model, random_state(made.tree, np.random.default_rng(0))
    assert pickle.loads(pickle.dumps(model)) == model
    assert one_joint("helical", pitch=0.1).key != one_joint("helical", pitch=0.2).key
    locked = next(j for j in model.joints if j.kind == "helical")
    part = model.reduced({locked.name: s.q[locked.idx_q]})
    keep_q, keep_v = (np.delete(np.arange(n), at) for n, at in ((model.nq, locked.idx_q), (model.nv, locked.idx_v)))
    close(sd.crba(part, s.q[keep_q]), sd.crba(model, s.q)[np.ix_(keep_v, keep_v)])
    heavier = model.with_(armature={locked.name: 3.0}, gravity=(0, 0, 1))
    assert [j.pitch for j in heavier.joints] == [j.pitch for j in model.joints]
    small, _ = sd.simplify(one_joint("helical"), drop="gravity")
    assert small.joints[1].pitch == PITCH


def test_a_screw_may_follow_and_be_followed() -> None:
    def build(mimic: bool) -> sd.Model:
        builder = sd.ModelBuilder().add_body("a", joint="helical", pitch=0.5, inertia=BODY)
        builder.add_body("b", "a", "revolute", AXIS, (1, 0, 0), BODY)
        follows = {"mimic": {"leader": "b_joint", "multiplier": -2.0, "offset": 0.1}} if mimic else {}
        return builder.add_body("c", "b", "helical", AXIS, (0, 1, 0), BODY, pitch=-0.2, **follows).build(mimic=mimic)

    follower, whole = build(True), build(False)
    G = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, -2.0]])
    q, v, a = np.random.default_rng(0).normal(size=(3, 2))
    offset = np.array([0.0, 0.0, 0.1])
    close(sd.rnea(follower, q, v, a), G.T @ sd.rnea(whole, G @ q + offset, G @ v, G @ a))


# --- a helical joint in every engine ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def screws() -> sd.Model:
    """A floating tree half of whose joints are helical."""
    model: sd.Model = random_tree(7, 6, SCREWS, floating=True).model
    assert [j.kind for j in model.joints].count("helical") > 2
    return model


@pytest.mark.parametrize("name", ["rnea", "crba", "aba", "coriolis_matrix", "integrate"])
def test_programs_answer_as_single_calls_do(screws: sd.Model, name: str) -> None:
    rng = np.random.default_rng(0)
    s = {"q": sd.random_configuration(screws, rng, (9,))}
    s |= {x: rng.normal(size=(9, screws.nv)) for x in ("v", "a", "tau")}
    given = [s[x] for x in {**STATES, "integrate": "q v"}[name].split()]
    wanted = np.array([calls[name](screws, *(x[k] for x in given)) for k in range(9)])
    close(calls[name](screws, *given), wanted, SOLVED if name == "aba" else ROUNDING)
    single = sd.specialize(screws, calls[name], dtype=np.float32)(*(x.astype(np.float32) for x in given))
    close(single, wanted, SINGLE * (100.0 if name == "aba" else 1.0))


def test_exact_numbers_of_a_screw_have_all_their_digits() -> None:
    model = one_joint("helical", axis=(0, 0, 1), placement=(0.0, 0.0, 0.0))
    q = mpmath.mpf("0.7")
    found = sd.exact(model, sd.forward_kinematics, 240)(np.array([q], object))
    with mpmath.workprec(300):
        assert abs(found[1][2][3] - mpmath.mpf(PITCH) * q) <= DIGITS
    assert abs(float(found[1][0][0]) - math.cos(0.7)) <= EPS
    with pytest.raises(sd.SpatialDynError, match="expected a call that takes its sine and cosine only"):
        sd.exact(model, sd.forward_kinematics, None)([1])


def test_symbols_of_a_screw_are_the_textbooks() -> None:
    sympy = pytest.importorskip("sympy")
    builder = sd.ModelBuilder().add_body(
        "nut", None, "helical", inertia=(2.0, (0.1, 0, 0), np.diag([1.0, 1.0, 0.5])), pitch=0.25
    )
    s = sd.SymbolicManipulator(builder.build(), {"m_1": "m_1", "g": "g"})
    m, g = (next(x for x in s.parameters if str(x) == name) for name in ("m_1", "g"))
    assert sympy.simplify(s.g()[0] - m * g / 4) == 0
    assert sympy.simplify(s.V() - m * g * s.q[0] / 4) == 0
    assert sympy.simplify(s.M()[0] - (m / 100 + sympy.Rational(1, 2) + m / 16)) == 0


@pytest.mark.slow(quick="test_every_kind_moves_alike_by_every_family_of_integrators")
@COMPILED
@pytest.mark.parametrize(
    "method", slow_but(["rk4", "gauss4"], ["rk4", "variational", "gauss4", "stormer_verlet", "implicit_midpoint"])
)
def test_every_family_of_integrators_keeps_a_screws_energy(method: str) -> None:
    """The nut falls along its thread at a constant acceleration: q = q0 + a t²/2."""
    J, m, p = 0.7, 2.0, 0.3
    builder = sd.ModelBuilder().add_body("nut", None, "helical", inertia=(m, (0, 0, 0), np.diag([J, J, J])), pitch=p)
    run = sd.simulate(builder.build(), [0.2], [0.0], 1.0, 0.01, method)
    a = -m * 9.81 * p / (J + m * p * p)
    close(run.q[-1], [0.2 + 0.5 * a], 1e-11)
    close(run.energy, np.full(len(run.t), run.energy[0]), 1e-11)


@COMPILED
@pytest.mark.parametrize(
    ("method", "continuous"),
    slow_but([("dop853", LAYOUTS[-1])], [(x, layout) for x in ("dop853", "gauss4") for layout in LAYOUTS]),
)
def test_every_kind_moves_alike_by_every_family_of_integrators(method: str, continuous: str) -> None:
    """Rates of q (dop853) and canonical coordinates (gauss4) know every kind that ``integrate`` (rk4) knows."""
    builder = sd.ModelBuilder()
    for word in CODES:
        builder.add_body(word, None, word, AXIS, (0.1, 0.2, 0.3), BODY, pitch=PITCH if word == "helical" else 0.0)
    model, rng = builder.build(continuous=continuous), np.random.default_rng(3)
    q, v = sd.random_configuration(model, rng), rng.normal(size=model.nv)
    wanted, found = (sd.simulate(model, q, v, 0.1, 0.001, by) for by in ("rk4", method))
    close(sd.difference(model, wanted.q[-1], found.q[-1]), np.zeros(model.nv), STEPPED)


def test_a_screws_momentum_is_one_quantity_where_nothing_acts_on_it() -> None:
    """It is neither a shift nor a turn: one p is conserved without gravity, none with it."""
    model = one_joint("helical")
    assert [x.name for x in sd.conserved_quantities(model)] == ["energy"]
    free = sd.conserved_quantities(model.with_(gravity=(0, 0, 0)))
    assert [(x.name, x.unit) for x in free[1:]] == [("momentum of j", "kg m²/s")]
    assert free[1].value([0.3], [0.7]) == 0.7
